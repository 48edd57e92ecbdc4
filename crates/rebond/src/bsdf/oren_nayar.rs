//! Oren and Nayar's rough diffuse surface (1994), in the energy-preserving form of Portsmouth, Kutz and Hill (2025).
//! `p[0]` is the roughness r in [0, 1]; `color` is the albedo ρ of its facets.
//!
//! ```text
//! f  = ρ/π A (1 + r s/t) + ρm/π (1 − E(θi)) (1 − E(θo)) / (1 − Ē)
//! s  = ωi·ωo − cosθi cosθo,    t = max(cosθi, cosθo) where s > 0, else 1
//! A  = 1 / (1 + (1/2 − 2/3π) r)
//! E(θ) = A (1 + r/π G(θ)),     G(θ) = sinθ (θ − sinθ cosθ) + 2/3 (tanθ (1 − sin³θ) − sinθ)
//! Ē  = A (1 + (2/3 − 28/15π) r),    ρm = ρ² Ē / (1 − ρ (1 − Ē))
//! ```
//!
//! The first term is Fujii's fit, of albedo ρ E(θ); the second gives back what its facets exchange among one another. So
//! a white surface (ρ = 1) reflects all it receives, at every angle and roughness, and the albedo is
//! `ρ E(θ) + ρm (1 − E(θ))`.

use super::{BsdfSample, BsdfValue, Lobe, both_above};
use crate::math::{Rgb, Vec3};
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::{Real, math};
use std::f32::consts::{FRAC_1_PI, PI};

/// A.
#[inline(always)]
fn scale<F: Real>(r: F) -> F {
    (r * (0.5 - 2.0 / (3.0 * PI)) + 1.0).recip()
}

/// E: the albedo of Fujii's term over ρ.
#[inline(always)]
fn single<F: Real>(cos: F, r: F) -> F {
    let sin = (F::one() - cos * cos).safe_sqrt();
    let theta = math::atan2(sin, cos);
    // tanθ (1 − sin³θ) without its 0/0 at the horizon: 1 − sin³θ = cos²θ (1 + sinθ + sin²θ) / (1 + sinθ).
    let tail = sin * cos * (sin * sin + sin + 1.0) / (sin + 1.0);
    let g = sin * (theta - sin * cos) + (tail - sin) * (2.0 / 3.0);
    scale(r) * (r * g * FRAC_1_PI + 1.0)
}

#[inline(always)]
fn value<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> Rgb<F> {
    let r = lobe.p[0];
    let s = a.x * b.x + a.y * b.y;
    let t = F::select(s.gt(F::zero()), a.z.max(b.z), F::one());
    let once = scale(r) * (r * s / t + 1.0) * FRAC_1_PI;
    let average = scale(r) * (r * (2.0 / 3.0 - 28.0 / (15.0 * PI)) + 1.0);
    // At r = 0 nothing is left to exchange, and this is 0/0.
    let lost = (F::one() - average).max(F::splat(1e-7));
    let again = (F::one() - single(a.z, r)) * (F::one() - single(b.z, r)) / lost * FRAC_1_PI;
    let channel = |rho: F| {
        let rho_m = rho * rho * average / (F::one() - rho * (F::one() - average));
        rho * once + rho_m * again
    };
    Rgb::new(channel(lobe.color.r), channel(lobe.color.g), channel(lobe.color.b))
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    BsdfValue { f: value(lobe, a, b), pdf: cosine_hemisphere_pdf(b) }.masked(both_above(a, b))
}

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2]) -> BsdfSample<F> {
    let w = cosine_hemisphere(u);
    let weight = value(lobe, a, w) * F::splat(PI);
    BsdfSample::glossy(w, Rgb::select(both_above(a, w), weight, Rgb::black()), cosine_hemisphere_pdf(w).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::tests::quadrature;

    #[test]
    fn albedo_has_its_closed_form_and_white_stays_white() {
        for r in [0.0_f32, 0.3, 0.7, 1.0] {
            for theta in [0.0_f32, 30.0, 60.0, 85.0, 89.0] {
                let a = Vec3::splat([theta.to_radians().sin(), 0.0, theta.to_radians().cos()]);
                let lobe = Lobe { color: Rgb::splat([1.0, 0.6, 0.2]), p: [r, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] };
                let albedo = |channel: fn(Rgb<f32>) -> f32| {
                    quadrature(|b| f64::from(channel(eval(&lobe, a, b).f) * b.z.max(0.0)))
                };
                assert!((albedo(|f| f.r) - 1.0).abs() < 1e-3, "white, r {r} at {theta}°: {}", albedo(|f| f.r));
                let e = single(a.z, r);
                let average = scale(r) * (1.0 + r * (2.0 / 3.0 - 28.0 / (15.0 * PI)));
                let rho_m = 0.36 * average / (1.0 - 0.6 * (1.0 - average));
                let exact = f64::from(0.6 * e + rho_m * (1.0 - e));
                assert!((albedo(|f| f.g) - exact).abs() < 1e-3, "r {r} at {theta}°: {} for {exact}", albedo(|f| f.g));
            }
        }
    }

    #[test]
    fn without_roughness_it_is_lamberts() {
        let lobe = Lobe { color: Rgb::splat([0.9, 0.5, 0.1]), p: [0.0_f32; 9] };
        let (a, b) = (Vec3::splat([0.6, 0.0, 0.8]), Vec3::splat([0.0, -0.8, 0.6]));
        let (rough, flat) = (eval(&lobe, a, b), crate::bsdf::diffuse::eval(&lobe, a, b));
        for channel in 0..3 {
            assert!((rough.f.lane(0)[channel] - flat.f.lane(0)[channel]).abs() < 1e-6);
        }
    }

    #[test]
    fn rough_surfaces_send_light_back() {
        let lobe = Lobe { color: Rgb::splat([0.5; 3]), p: [1.0_f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] };
        let (a, across) = (Vec3::splat([0.8, 0.0, 0.6]), Vec3::splat([-0.8, 0.0, 0.6]));
        assert!(eval(&lobe, a, a).f.g > 1.5 * eval(&lobe, a, across).f.g);
    }
}
