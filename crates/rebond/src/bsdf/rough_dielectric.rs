//! GGX glass (Walter et al. 2007, eqs. 20 and 21). `p[0]` is the index of the inside over the outside, `p[6]` and `p[7]`
//! are αx and αy, `p[8]` tells [other facets](super::facets); `color` tints. What leaves a facet for another is lost, on
//! either side.

use super::ggx::Ggx;
use super::{BsdfSample, BsdfValue, Lobe, TransportMode, facets, fresnel, reflect_about};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::PdfSolidAngle;
use rebond_lanes::{Mask, Real};

/// The boundary as seen from `a`: everything mirrored so that a is above.
struct Boundary<F: Real> {
    ggx: Ggx<F>,
    outside: F::Mask,
    eta: F,
    a: Vec3<F>,
}

impl<F: Real> Boundary<F> {
    #[inline(always)]
    fn new(lobe: &Lobe<F>, a: Vec3<F>) -> Self {
        let outside = a.z.gt(F::zero());
        let eta = F::select(outside, lobe.p[0], lobe.p[0].recip());
        Self { ggx: Ggx { ax: lobe.p[6], ay: lobe.p[7] }, outside, eta, a: vec3(a.x, a.y, a.z.abs()) }
    }

    #[inline(always)]
    fn mirrored(&self, w: Vec3<F>) -> Vec3<F> {
        vec3(w.x, w.y, F::select(self.outside, w.z, -w.z))
    }

    /// dω_h/dω_b of refraction: `η² |b·h| / (a·h + η b·h)²`.
    #[inline(always)]
    fn jacobian(&self, a_h: F, b_h: F) -> F {
        let sum = a_h + self.eta * b_h;
        self.eta * self.eta * b_h.abs() / (sum * sum)
    }
}

/// What refraction does to radiance but not to power.
#[inline(always)]
fn squeeze<F: Real>(eta: F, mode: TransportMode) -> F {
    match mode {
        TransportMode::Radiance => (eta * eta).recip(),
        TransportMode::Importance => F::one(),
    }
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>, mode: TransportMode) -> BsdfValue<F> {
    let side = Boundary::new(lobe, a);
    let (a, b) = (side.a, side.mirrored(b));
    let reflects = b.z.gt(F::zero());
    // The same sum from both sides, outer direction + η · inner direction, so that rounding is reciprocal as well.
    let eta = lobe.p[0];
    let through = Vec3::select(side.outside, a + b * eta, b + a * eta);
    let sum = Vec3::select(reflects, a + b, through);
    let length = sum.length();
    let h = sum * length.recip();
    let h = Vec3::select(h.z.lt(F::zero()), -h, h);
    let (a_h, b_h) = (a.dot(h), b.dot(h));
    let (above, _) = fresnel::dielectric(a_h.relu(), side.eta);
    let below = fresnel::of_cosines(a_h, b_h.abs(), side.eta);
    let reflectance = F::select(reflects, above, below);
    let (d, la) = (side.ggx.d(h), side.ggx.lambda(a));
    let lb = side.ggx.lambda(vec3(b.x, b.y, b.z.abs()));
    let other = facets::over_ggx(lobe, side.ggx, a, b, h);
    let facets = d * a_h / a.z; // × G1 is the density of visible normals, × G2 / |b_z| the value
    // η² |b·h| / (a·h + η b·h)², of which the sum is ±1 times the length, over η seen from within.
    let refracts = b_h.abs() * F::select(side.outside, eta * eta, F::one()) / (length * length);
    let jacobian = F::select(reflects, (a_h * 4.0).recip(), refracts);
    let share = F::select(reflects, reflectance, F::one() - reflectance);
    let both = facets * jacobian * share;
    let value = both * other / (b.z.abs() * (la + lb + 1.0));
    let value = F::select(reflects, value, value * squeeze(side.eta, mode));
    // A facet must be seen from its own side by both: b on its upper side in reflection, on the lower in refraction.
    let possible = a_h.gt(F::zero()) & ((reflects & b_h.gt(F::zero())) | b_h.lt(F::zero()).and_not(reflects));
    let possible = possible & value.is_finite();
    BsdfValue { f: lobe.color * value, pdf: PdfSolidAngle(both / (la + 1.0)) }.masked(possible)
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F, mode: TransportMode) -> BsdfSample<F> {
    let side = Boundary::new(lobe, a);
    let a = side.a;
    let h = side.ggx.sample_visible(a, u);
    let a_h = a.dot(h);
    let (reflectance, cos_t) = fresnel::dielectric(a_h.relu(), side.eta);
    let reflects = choice.lt(reflectance);
    let b = Vec3::select(reflects, reflect_about(a, h), fresnel::refract(a, h, a_h, cos_t, side.eta));
    let la = side.ggx.lambda(a);
    let lb = side.ggx.lambda(vec3(b.x, b.y, b.z.abs()));
    let weight = (la + 1.0) / (la + lb + 1.0) * F::select(reflects, F::one(), squeeze(side.eta, mode));
    let weight = weight * facets::over_ggx(lobe, side.ggx, a, b, h);
    let facets = side.ggx.d(h) * a_h / (a.z * (la + 1.0));
    let jacobian = F::select(reflects, (a_h * 4.0).recip(), side.jacobian(a_h, b.dot(h)));
    let pdf = facets * jacobian * F::select(reflects, reflectance, F::one() - reflectance);
    let above = b.z.gt(F::zero());
    let good = ((reflects & above) | (b.z.lt(F::zero())).and_not(reflects)) & pdf.gt(F::zero()) & pdf.is_finite();
    BsdfSample {
        w: side.mirrored(b),
        weight: Rgb::select(good, lobe.color * weight, Rgb::black()),
        pdf: PdfSolidAngle(pdf),
        specular: F::Mask::splat(false),
        eta: F::select(reflects, F::one(), side.eta),
    }
}
