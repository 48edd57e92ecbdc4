//! Random numbers as a pure function, and what turns them into points, directions and choices.

mod discrete;
mod grid;
mod lattice;
mod measure;
mod sampler;
mod spherical;
pub mod warp;

pub use discrete::Discrete;
pub use grid::{Cell, Grid, Grids, linear};
pub(crate) use lattice::Plane;
pub use measure::{PdfArea, PdfSolidAngle};
pub(crate) use sampler::mix;
pub use sampler::{Sampler, SamplerSettings, Stream};
pub use spherical::{SphericalRectangle, SphericalTriangle};
