//! GGX metal: `f_r = F D G₂ / (4 cosθi cosθo)` (Walter et al. 2007, eq. 20). `p[0..3]` is η, `p[3..6]` is k, `p[6]` and
//! `p[7]` are αx and αy, `p[8]` tells [other facets](super::facets); `color` tints. What leaves a facet for another is lost:
//! of white isotropic metal of GGX `1 − r0` as in [`albedo`](super::albedo), ln 2 at α = 1 from straight above.

use super::ggx::Ggx;
use super::{BsdfSample, BsdfValue, Lobe, both_above, conductor, facets, fresnel, reflect_about};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use rebond_lanes::Real;

#[inline(always)]
fn of_lobe<F: Real>(lobe: &Lobe<F>) -> Ggx<F> {
    Ggx { ax: lobe.p[6], ay: lobe.p[7] }
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let ggx = of_lobe(lobe);
    let h = (a + b).normalized();
    let (eta, k) = conductor::index(lobe);
    let reflectance = fresnel::conductor(a.dot(h), eta, k) * lobe.color;
    let (d, la, lb) = (ggx.d(h), ggx.lambda(a), ggx.lambda(b));
    let quarter = d / (a.z * 4.0);
    let reflectance = reflectance * facets::over_ggx(lobe, ggx, a, b, h);
    BsdfValue { f: reflectance * (quarter / (b.z * (la + lb + 1.0))), pdf: PdfSolidAngle(quarter / (la + 1.0)) }
        .masked(both_above(a, b))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    let ggx = of_lobe(lobe);
    let h = ggx.sample_visible(a, u);
    let b = reflect_about(a, h);
    let (eta, k) = conductor::index(lobe);
    let (la, lb) = (ggx.lambda(a), ggx.lambda(b));
    let weight = fresnel::conductor(a.dot(h), eta, k) * lobe.color * ((la + 1.0) / (la + lb + 1.0));
    let weight = weight * facets::over_ggx(lobe, ggx, a, b, h);
    let pdf = ggx.d(h) / (a.z * 4.0 * (la + 1.0));
    BsdfSample::glossy(b, Rgb::select(both_above(a, b), weight, Rgb::black()), pdf)
}
