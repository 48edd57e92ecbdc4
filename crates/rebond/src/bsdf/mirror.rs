//! The perfect mirror: all light goes to the mirror direction.

use super::{BsdfSample, Lobe, reflect};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use rebond_lanes::{Mask, Real};

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>) -> BsdfSample<F> {
    BsdfSample {
        w: reflect(a),
        weight: Rgb::select(a.z.gt(F::zero()), lobe.color, Rgb::black()),
        pdf: PdfSolidAngle(F::one()),
        specular: F::Mask::splat(true),
        eta: F::one(),
    }
}
