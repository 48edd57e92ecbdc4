//! Phong's: a lobe `cosʳα` around the mirror direction. `p[0]` is r.
//!
//! The lecture prints `f_r = ρ (r+1)/2π · cosʳα / cosθi`, θi on the light's side: the direction that is looked for on
//! paths from the camera, the known one on paths from a light. It is neither reciprocal nor bounded at grazing angles. The
//! default is the form that is both, `f_r = ρ (r+2)/2π · cosʳα` (Lafortune and Willems 1994).

use super::{BsdfSample, BsdfValue, Lobe, TransportMode, both_above, reflect};
use crate::math::{Frame, Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{power_cosine, power_of_cosine};
use rebond_lanes::Real;
use std::f32::consts::FRAC_1_PI;

/// cosʳα / 2π.
#[inline(always)]
fn lobe_value<F: Real>(a: Vec3<F>, b: Vec3<F>, r: F) -> F {
    power_of_cosine(reflect(a).dot(b).min(F::one()), r) * (0.5 * FRAC_1_PI)
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let (r, l) = (lobe.p[0], lobe_value(a, b, lobe.p[0]));
    BsdfValue { f: lobe.color * (l * (r + 2.0)), pdf: PdfSolidAngle(l * (r + 1.0)) }.masked(both_above(a, b))
}

#[inline(always)]
pub fn eval_lecture<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>, mode: TransportMode) -> BsdfValue<F> {
    let pdf = lobe_value(a, b, lobe.p[0]) * (lobe.p[0] + 1.0);
    let cos_i = match mode {
        TransportMode::Radiance => b.z,
        TransportMode::Importance => a.z,
    };
    BsdfValue { f: lobe.color * (pdf / cos_i), pdf: PdfSolidAngle(pdf) }.masked(both_above(a, b))
}

#[inline(always)]
fn sample_lobe<F: Real>(a: Vec3<F>, r: F, u: [F; 2]) -> (Vec3<F>, F) {
    let b = Frame::around(reflect(a)).to_world(power_cosine(u, r)).normalized();
    (b, lobe_value(a, b, r) * (r + 1.0))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    let r = lobe.p[0];
    let (b, pdf) = sample_lobe(a, r, u);
    let weight = lobe.color * ((r + 2.0) / (r + 1.0) * b.z);
    BsdfSample::glossy(b, Rgb::select(both_above(a, b), weight, Rgb::black()), pdf)
}

#[inline(always)]
pub fn sample_lecture<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], mode: TransportMode) -> BsdfSample<F> {
    let (b, pdf) = sample_lobe(a, lobe.p[0], u);
    let weight = match mode {
        TransportMode::Radiance => lobe.color,
        TransportMode::Importance => lobe.color * (b.z / a.z),
    };
    BsdfSample::glossy(b, Rgb::select(both_above(a, b), weight, Rgb::black()), pdf)
}
