//! Facets of rough metal and glass that are not GGX's with height-correlated masking: their f as a factor on that of those.
//!
//! Their distribution may be [Beckmann's](super::beckmann). And what is hidden from one direction may be so independently of the
//! other (Smith 1967; Walter et al. 2007, eq. 23), as in Mitsuba, though facets that stand high are seen better from both:
//!
//! ```text
//! G₂ = 1 / (1 + Λ(ωi) + Λ(ωo))                correlated (Heitz 2014, eq. 99)
//! G₂ = 1 / ((1 + Λ(ωi)) (1 + Λ(ωo)))          separable
//! ```
//!
//! All are drawn as GGX of the same roughness: what is visible from one direction does not hang on the other.

use super::Lobe;
use super::beckmann;
use super::ggx::Ggx;
use crate::math::Vec3;
use rebond_lanes::{Mask, Real};

/// The parameter that tells what facets a lobe has: the sum of the two below, 0 for GGX with correlated masking.
pub const KIND: usize = 8;
/// Beckmann's distribution.
pub const BECKMANN: f32 = 1.0;
/// Separable masking.
pub const SEPARABLE: f32 = 2.0;

/// f of a lobe over that of GGX facets with correlated masking, where `h` is the facet's normal; 1 in lanes that have those.
#[inline(always)]
pub fn over_ggx<F: Real>(lobe: &Lobe<F>, ggx: Ggx<F>, a: Vec3<F>, b: Vec3<F>, h: Vec3<F>) -> F {
    let kind = lobe.p[KIND];
    let chosen = kind.gt(F::zero());
    if chosen.none() {
        return F::one();
    }
    F::select(chosen, factor(kind, ggx, a, b, h), F::one())
}

#[inline(never)]
fn factor<F: Real>(kind: F, ggx: Ggx<F>, a: Vec3<F>, b: Vec3<F>, h: Vec3<F>) -> F {
    let separable = kind.ge(F::splat(SEPARABLE));
    let beckmann = F::select(separable, kind - SEPARABLE, kind).gt(F::zero());
    let (mut la, mut lb, mut density) = (ggx.lambda(a), ggx.lambda(b), F::one());
    let of_ggx = la + lb + 1.0;
    if beckmann.any() {
        density = F::select(beckmann, beckmann::density_over_ggx(ggx, h), density);
        la = F::select(beckmann, beckmann::lambda(ggx, a), la);
        lb = F::select(beckmann, beckmann::lambda(ggx, b), lb);
    }
    density * (of_ggx / F::select(separable, (la + 1.0) * (lb + 1.0), la + lb + 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::check::Angles;
    use crate::bsdf::tests::material;
    use crate::bsdf::{Model, TransportMode};

    /// Facets of α = 1 have D = 1/π, and 1 + Λ = (1 + cosθ) / 2 cosθ. So `f = 1 / π (1 + cosθi) (1 + cosθo)` where they are masked
    /// separately, whose albedo is `2 (1 − ln 2) / (1 + cosθ)`, and `1 / 2π (cosθi + cosθo)` where heights are correlated: never less.
    #[test]
    fn the_roughest_metal_is_known() {
        let metal = |kind| material(Model::RoughConductor, [0.0, 0.0, 0.0, 9.0, 9.0, 9.0, 1.0, 1.0, kind], [1.0; 3]);
        let (correlated, separable) = (metal(0.0), metal(SEPARABLE));
        for theta in [0.0, 30.0, 60.0, 80.0, 87.0_f64] {
            let from = Angles { theta, phi: 20.0 };
            let cos = theta.to_radians().cos();
            for (theta, phi) in [(10.0, 100.0), (50.0, 20.0), (75.0, 220.0)] {
                let to = Angles { theta, phi };
                let f = |m: &crate::bsdf::check::Material| {
                    f64::from(m.eval(from.direction(), to.direction(), TransportMode::Radiance).0[1])
                };
                let other = theta.to_radians().cos();
                for (found, exact) in [
                    (f(&separable), 1.0 / ((1.0 + cos) * (1.0 + other))),
                    (f(&correlated), 1.0 / (2.0 * (cos + other))),
                ] {
                    let exact = exact / std::f64::consts::PI;
                    assert!((found / exact - 1.0).abs() < 1e-4, "{from:?} {to:?}: {found} for {exact}");
                }
                assert!(f(&separable) <= f(&correlated) * 1.0001);
            }
            let exact = 2.0 * (1.0 - 2.0_f64.ln()) / (1.0 + cos);
            let found = separable.albedo(from, TransportMode::Radiance, 100_000, 7);
            assert!((found.mean - exact).abs() < 5.0 * found.error + 1e-4, "{found:?} for {exact}");
        }
    }
}
