//! A diffuse base under a GGX coat: plastic, varnish, glazed pottery. `color` is the reflectance ρ of the base, `p[0]` the
//! index η of the coat over the outside (≥ 1), `p[1]` is 1 where what passes between base and coat shifts the colour, `p[6]`
//! the roughness α of the coat, which is smooth as α → 0.
//!
//! ```text
//! f = F D G₂ / (4 cosθi cosθo) + ρ'/π (1 − E(θi)) (1 − E(θo)) / (1 − Ē)
//! ρ' = ρ,    or  ρ (1 − Ri) / (1 − ρ Ri)  with the internal reflectance  Ri = 1 − (1 − Ē)/η²
//! ```
//!
//! E is the coat's albedo and Ē its average ([`albedo`](super::albedo)): the base gets what the coat does not reflect, on the
//! way in and on the way out, so that a white base makes a white surface at every angle (Kelemen and Szirmay-Kalos 2001).
//! Fresnel's term is Schlick's (1994). Light that the coat throws back to the base is coloured again, as in the form with
//! Ri; leaving that out keeps the base's own colour.

use super::albedo::{Reflected, isotropic, reflection, schlick};
use super::{BsdfSample, BsdfValue, Lobe, both_above, reflect_about};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::Real;
use std::f32::consts::FRAC_1_PI;

/// Reflectance of the coat at normal incidence.
#[inline(always)]
fn at_normal<F: Real>(eta: F) -> F {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// The chance of drawing from the coat as seen from `mu`.
#[inline(always)]
fn share_of_coat<F: Real>(lobe: &Lobe<F>, e: F) -> F {
    let base = (F::one() - e) * lobe.color.max();
    e / (e + base).max(F::splat(1e-9))
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let (eta, alpha) = (lobe.p[0], lobe.p[6]);
    let f0 = at_normal(eta);
    let h = (a + b).normalized();
    let (coat, pdf_coat) = reflection(isotropic(alpha), a, b, h);
    let fresnel = f0 + (F::one() - f0) * schlick(a.dot(h));
    let (ea, eb) = (Reflected::at(a.z.relu(), alpha).with(f0), Reflected::at(b.z.relu(), alpha).with(f0));
    let passed = F::one() - Reflected::average(alpha).with(f0);
    let base = (F::one() - ea) * (F::one() - eb) / passed * FRAC_1_PI;
    let outwards = passed / (eta * eta);
    let shifts = lobe.p[1].gt(F::zero());
    let channel = |rho: F| {
        let shifted = rho * outwards / (F::one() - rho * (F::one() - outwards));
        F::select(shifts, shifted, rho) * base + fresnel * coat
    };
    let share = share_of_coat(lobe, ea);
    let pdf = share * pdf_coat + (F::one() - share) * cosine_hemisphere_pdf(b).0;
    let f = Rgb::new(channel(lobe.color.r), channel(lobe.color.g), channel(lobe.color.b));
    BsdfValue { f, pdf: PdfSolidAngle(pdf) }.masked(both_above(a, b))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F) -> BsdfSample<F> {
    let (eta, alpha) = (lobe.p[0], lobe.p[6]);
    let e = Reflected::at(a.z.relu(), alpha).with(at_normal(eta));
    let coat = choice.lt(share_of_coat(lobe, e));
    let facet = reflect_about(a, isotropic(alpha).sample_visible(a, u));
    let b = Vec3::select(coat, facet, cosine_hemisphere(u));
    let value = eval(lobe, a, b);
    let good = both_above(a, b) & value.pdf.0.gt(F::zero());
    BsdfSample::glossy(b, Rgb::select(good, value.f * (b.z / value.pdf.0), Rgb::black()), value.pdf.0)
}
