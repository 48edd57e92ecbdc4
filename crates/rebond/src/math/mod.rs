//! Vectors, colours and frames over [`Real`].

mod frame;
mod keyframes;
mod moments;
mod rgb;
mod vec3;

pub use frame::Frame;
pub use keyframes::{Keyframes, Matrix};
pub use moments::Moments;
pub use rgb::{LUMINANCE, Rgb, luminance};
pub use vec3::{Vec3, vec3};

use rebond_lanes::Real;

/// A point `p` moved off its surface, to the side of `towards`, by the error of its own position: the start of a ray
/// that must not meet that surface again. `error` bounds the distance, per axis, of `p` from the true surface; `n` is
/// the geometric unit normal. (Pharr, Jakob, Humphreys 2023, §6.8.6.)
#[inline(always)]
pub fn offset_from_surface<F: Real>(p: Vec3<F>, error: F, n: Vec3<F>, towards: Vec3<F>) -> Vec3<F> {
    let reach = error * (n.x.abs() + n.y.abs() + n.z.abs());
    p + n * reach.copy_sign(n.dot(towards))
}
