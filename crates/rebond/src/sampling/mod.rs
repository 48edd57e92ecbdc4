//! Random numbers as a pure function, and what turns them into points, directions and choices.

mod discrete;
mod grid;
mod lattice;
mod measure;
mod order;
mod sampler;
mod spherical;
pub mod warp;

pub use discrete::Discrete;
pub use grid::{Cell, Grid, Grids, linear};
pub use measure::{PdfArea, PdfSolidAngle};
pub(crate) use sampler::{Place, mix};
pub use sampler::{Sampler, SamplerSettings, Stream};
pub use spherical::{SphericalRectangle, SphericalTriangle};
