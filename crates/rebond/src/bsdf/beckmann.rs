//! Beckmann's distribution of facets, whose slopes are Gaussian, and Smith's Λ of them (Walter et al. 2007, eq. 25; Heitz 2014,
//! eq. 68, whose error function is that of Abramowitz and Stegun 1964, 7.1.26):
//!
//! ```text
//! D(h) = exp(−t) / (π αx αy cos⁴θ)        t = ((hx/αx)² + (hy/αy)²) / hz²
//! Λ(ω) = exp(−a²) / (2 a √π) − erfc(a) / 2        a = ωz / √((αx ωx)² + (αy ωy)²)
//! ```
//!
//! It is drawn as GGX of the same roughness, whose D is 1 / (π αx αy cos⁴θ (1 + t)²): its tails are heavier, so that the
//! factor between the two, exp(−t) (1 + t)², is 4/e at most. Seen from above the squares of weights come to 5/4 in the mean.

use super::ggx::Ggx;
use crate::math::Vec3;
use rebond_lanes::{Real, math};
use std::f32::consts::PI;

/// D over that of GGX facets.
#[inline(always)]
pub fn density_over_ggx<F: Real>(ggx: Ggx<F>, h: Vec3<F>) -> F {
    let (x, y) = (h.x / ggx.ax, h.y / ggx.ay);
    // Beyond, nothing is left of the exponential.
    let t = (x.mul_add(x, y * y) / (h.z * h.z)).min(F::splat(80.0));
    math::exp(-t) * ((t + 1.0) * (t + 1.0))
}

/// Smith's Λ of facets of these roughnesses.
#[inline(always)]
pub fn lambda<F: Real>(Ggx { ax, ay }: Ggx<F>, w: Vec3<F>) -> F {
    let (x, y) = (w.x * ax, w.y * ay);
    let a = (w.z.abs() / x.mul_add(x, y * y).sqrt()).min(F::splat(9.0));
    let t = a.mul_add(F::splat(0.327_591_1), F::one()).recip();
    let polynomial = [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6]
        .into_iter()
        .fold(F::splat(1.061_405_4), |sum, c| sum.mul_add(t, F::splat(c)));
    math::exp(-a * a) * ((a * (2.0 * PI.sqrt())).recip() - polynomial * t * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::tests::quadrature;
    use crate::math::vec3;

    /// The facets that are seen from a direction, together, are as large as the surface seen from there, for any direction and
    /// roughness: what Λ is for.
    #[test]
    fn visible_facets_cover_the_surface() {
        for (ax, ay) in [(0.5, 0.5), (0.3, 0.8), (1.0, 1.0)] {
            let ggx = Ggx { ax, ay };
            for (theta, phi) in [(0.0_f32, 0.0_f32), (30.0, 20.0), (60.0, 200.0), (80.0, 75.0)] {
                let (t, p) = (theta.to_radians(), phi.to_radians());
                let w = vec3(t.sin() * p.cos(), t.sin() * p.sin(), t.cos());
                let seen = quadrature(|h| {
                    let (x, y) = (h.x / ax, h.y / ay);
                    let slopes = f64::from((x * x + y * y) / (h.z * h.z));
                    let d = (-slopes).exp() / (std::f64::consts::PI * f64::from(ax * ay) * f64::from(h.z).powi(4));
                    if h.z > 0.0 { d * f64::from(w.dot(h).max(0.0)) } else { 0.0 }
                });
                let said = f64::from(w.z * (1.0 + lambda(ggx, w)));
                assert!((seen - said).abs() < 1e-4 * said, "{ax} {ay} {theta} {phi}: {seen} {said}");
            }
        }
    }
}
