//! Smooth metal: a mirror whose reflectance is Fresnel's. `p[0..3]` is η, `p[3..6]` is k; `color` tints.

use super::{BsdfSample, Lobe, fresnel, mirror};
use crate::math::{Rgb, Vec3};
use rebond_lanes::Real;

/// The complex index of the channels.
#[inline(always)]
pub fn index<F: Real>(lobe: &Lobe<F>) -> (Rgb<F>, Rgb<F>) {
    let p = &lobe.p;
    (Rgb::new(p[0], p[1], p[2]), Rgb::new(p[3], p[4], p[5]))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>) -> BsdfSample<F> {
    let (eta, k) = index(lobe);
    let mut sample = mirror::sample(lobe, a);
    sample.weight *= fresnel::conductor(a.z.abs(), eta, k);
    sample
}
