//! Blinn and Phong's: a lobe `cosʳθh` of the half vector. `p[0]` is r.
//!
//! The lecture prints `f_r = ρ (r+1)/2π · cosʳθh`, which is not normalised. The default divides by its albedo at normal
//! incidence, where it is largest: `f_r = ρ (r+2)(r+4) / (8π (2^{−r/2} + r)) · cosʳθh` (Giesen 2009).

use super::{BsdfSample, BsdfValue, Lobe, both_above, reflect_about};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{power_cosine, power_of_cosine};
use rebond_lanes::{Real, math};
use std::f32::consts::FRAC_1_PI;

#[inline(always)]
fn scale<F: Real>(r: F) -> F {
    (r + 2.0) * (r + 4.0) * (FRAC_1_PI / 8.0) / (math::exp2(r * -0.5) + r)
}

#[inline(always)]
fn lecture_scale<F: Real>(r: F) -> F {
    (r + 1.0) * (0.5 * FRAC_1_PI)
}

#[inline(always)]
fn eval_scaled<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>, scale: F) -> BsdfValue<F> {
    let h = (a + b).normalized();
    let l = power_of_cosine(h.z.min(F::one()), lobe.p[0]);
    let pdf = l * lecture_scale(lobe.p[0]) / (a.dot(h) * 4.0);
    BsdfValue { f: lobe.color * (l * scale), pdf: PdfSolidAngle(pdf) }.masked(both_above(a, b))
}

#[inline(always)]
fn sample_scaled<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], scale: F) -> BsdfSample<F> {
    let r = lobe.p[0];
    let h = power_cosine(u, r);
    let b = reflect_about(a, h);
    let a_h = a.dot(h);
    let pdf_h = power_of_cosine(h.z, r) * lecture_scale(r);
    // The facet must be seen from above, else b is no reflection of a.
    let good = both_above(a, b) & a_h.gt(F::zero());
    let weight = lobe.color * (scale / lecture_scale(r) * a_h * 4.0 * b.z);
    BsdfSample::glossy(b, Rgb::select(good, weight, Rgb::black()), pdf_h / (a_h * 4.0))
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    eval_scaled(lobe, a, b, scale(lobe.p[0]))
}

#[inline(always)]
pub fn eval_lecture<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    eval_scaled(lobe, a, b, lecture_scale(lobe.p[0]))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    sample_scaled(lobe, a, u, scale(lobe.p[0]))
}

#[inline(always)]
pub fn sample_lecture<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    sample_scaled(lobe, a, u, lecture_scale(lobe.p[0]))
}
