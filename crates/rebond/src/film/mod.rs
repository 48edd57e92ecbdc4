//! Where samples are gathered, exactly, and developed to an image.

mod accumulator;
mod aov;
mod filter;
mod image;
mod splats;

pub use accumulator::{Batch, Film, LARGEST_SAMPLE, Pixel, Value};
pub use aov::Aov;
pub use filter::{Filter, FilterSettings};
pub use image::{Channel, Image, Layer};
pub use splats::Splats;
