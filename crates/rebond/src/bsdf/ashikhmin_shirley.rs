//! Ashikhmin and Shirley's anisotropic Phong lobe over a diffuse base (2000). `color` is the reflectance Rd of the base,
//! `p[0..3]` that of the lobe at normal incidence, Rs; `p[3]` and `p[4]` are its exponents along and across the tangent.
//!
//! ```text
//! fs = √((nu+1)(nv+1)) / 8π · (n·h)^(nu cos²φh + nv sin²φh) / ((h·ωi) max(n·ωi, n·ωo)) · F(h·ωi)      eq. 4
//! fd = 28 Rd / 23π · (1 − Rs) (1 − (1 − n·ωi/2)⁵) (1 − (1 − n·ωo/2)⁵)                                  eq. 5
//! F(c) = Rs + (1 − Rs)(1 − c)⁵                                                                        Schlick 1994
//! ```
//!
//! Half of the directions are drawn from the lobe's half vectors, half by cosine, or all from the one that is not black.

use super::{BsdfSample, BsdfValue, Lobe, both_above, reflect_about};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::{Real, math};
use std::f32::consts::{FRAC_1_PI, PI};

#[inline(always)]
fn fifth<F: Real>(x: F) -> F {
    let x2 = x * x;
    x2 * x2 * x
}

/// The chance of drawing from the base.
#[inline(always)]
fn share_of_base<F: Real>(lobe: &Lobe<F>) -> F {
    let lit = |c: Rgb<F>| F::select(c.is_lit(), F::one(), F::zero());
    let specular = Rgb::new(lobe.p[0], lobe.p[1], lobe.p[2]);
    let (base, gloss) = (lit(lobe.color * specular.map(|rs| F::one() - rs)), lit(specular));
    F::select(base.gt(F::zero()), base / (base + gloss), F::zero())
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let (nu, nv) = (lobe.p[3], lobe.p[4]);
    let specular = Rgb::new(lobe.p[0], lobe.p[1], lobe.p[2]);
    let sum = a + b;
    let length = sum.length();
    let h = sum * length.recip();
    // a·h, the same from both sides to the last digit.
    let a_h = length * 0.5;
    let sin2 = h.x * h.x + h.y * h.y;
    // 1 − cos² keeps no digits near the pole, where the exponent does not matter.
    let along = F::select(sin2.gt(F::splat(1e-20)), h.x * h.x / sin2, F::splat(0.5));
    let exponent = nu * along + nv * (F::one() - along);
    let power = math::pow(h.z.min(F::one()), exponent) * ((nu + 1.0) * (nv + 1.0)).sqrt();
    let schlick = fifth((F::one() - a_h).relu());
    let gloss = power * (FRAC_1_PI / 8.0) / (a_h * a.z.max(b.z));
    let side = |cos: F| F::one() - fifth(F::one() - cos * 0.5);
    let base = side(a.z) * side(b.z) * (28.0 / (23.0 * PI));
    let channel = |rd: F, rs: F| rd * (F::one() - rs) * base + (rs + (F::one() - rs) * schlick) * gloss;
    let f = Rgb::new(
        channel(lobe.color.r, specular.r),
        channel(lobe.color.g, specular.g),
        channel(lobe.color.b, specular.b),
    );
    let share = share_of_base(lobe);
    let pdf = share * cosine_hemisphere_pdf(b).0 + (F::one() - share) * power * (FRAC_1_PI / 8.0) / a_h;
    BsdfValue { f, pdf: PdfSolidAngle(pdf) }.masked(both_above(a, b))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F) -> BsdfSample<F> {
    let (nu, nv) = (lobe.p[3], lobe.p[4]);
    // tanφ = √((nu+1)/(nv+1)) tan 2πu (eq. 9, for all quadrants at once); cosθ = (1−u)^(1/(n+1)) (eq. 10).
    let (sin, cos) = math::sin_cos(u[1] * (2.0 * PI));
    let (x, y) = (cos * (nv + 1.0).sqrt(), sin * (nu + 1.0).sqrt());
    let inverse = (x * x + y * y).sqrt().recip();
    let (cos_phi, sin_phi) = (x * inverse, y * inverse);
    let exponent = nu * cos_phi * cos_phi + nv * sin_phi * sin_phi;
    let z = math::pow(F::one() - u[0], (exponent + 1.0).recip());
    let r = (F::one() - z * z).safe_sqrt();
    let h = vec3(r * cos_phi, r * sin_phi, z);
    let base = choice.lt(share_of_base(lobe));
    let b = Vec3::select(base, cosine_hemisphere(u), reflect_about(a, h));
    let value = eval(lobe, a, b);
    let good = both_above(a, b) & (base | a.dot(h).gt(F::zero())) & value.pdf.0.gt(F::zero());
    let weight = value.f * (b.z / value.pdf.0);
    BsdfSample::glossy(b, Rgb::select(good, weight, Rgb::black()), value.pdf.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::tests::quadrature;

    #[test]
    fn half_vectors_are_normalised_and_the_base_has_its_albedo() {
        let lobe = |rd: f32, rs: f32, nu: f32, nv: f32| Lobe {
            color: Rgb::grey(rd),
            p: [rs, rs, rs, nu, nv, 0.0, 0.0, 0.0, 0.0],
        };
        // From straight above, all half vectors within 45° give directions above the surface.
        let up = Vec3::splat([0.0, 0.0, 1.0]);
        let mass = quadrature(|b| f64::from(eval(&lobe(0.0, 0.5, 200.0, 800.0), up, b).pdf.0));
        assert!((mass - 1.0).abs() < 1e-3, "{mass}");
        // ∫ fd cosθ from above where Rs = 0: 28/23 Rd · 31/32 · 2∫ (1 − (1 − c/2)⁵) c dc, and with x = 1 − c/2 the
        // integral of the fifth power is 8 [x⁶/6 − x⁷/7] from 1/2 to 1.
        let inner: f64 = 1.0 - 8.0 * (1.0 / 6.0 - 1.0 / 7.0 - 0.5_f64.powi(6) / 6.0 + 0.5_f64.powi(7) / 7.0);
        let exact = 28.0 / 23.0 * 31.0 / 32.0 * 0.8 * inner;
        let base = |b: Vec3<f32>| {
            let f = |rd| eval(&lobe(rd, 0.0, 10.0, 10.0), up, b).f.g;
            f64::from((f(0.8) - f(0.0)) * b.z.max(0.0))
        };
        assert!((quadrature(base) - exact).abs() < 1e-3, "{} for {exact}", quadrature(base));
    }
}
