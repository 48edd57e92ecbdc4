//! Lambert's: `f_r = ρ/π`.

use super::{BsdfSample, BsdfValue, Lobe, both_above};
use crate::math::{Rgb, Vec3};
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::Real;
use std::f32::consts::FRAC_1_PI;

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    BsdfValue { f: lobe.color * F::splat(FRAC_1_PI), pdf: cosine_hemisphere_pdf(b) }.masked(both_above(a, b))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    let w = cosine_hemisphere(u);
    BsdfSample::glossy(w, Rgb::select(both_above(a, w), lobe.color, Rgb::black()), cosine_hemisphere_pdf(w).0)
}
