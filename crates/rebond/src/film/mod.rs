//! Where samples are gathered, exactly, and developed to an image.

mod image;

pub use image::{Channel, Image, Layer};
