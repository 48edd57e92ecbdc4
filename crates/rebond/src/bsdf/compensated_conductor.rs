//! GGX metal that keeps what its facets throw at one another. Parameters as of the rough conductor, with αx = αy = `p[6]`.
//!
//! One bounce loses `1 − E(θ)` of the light, E being the albedo of white facets. It comes back with the same falloff on
//! both sides, coloured by all the bounces it took (Kulla and Conty 2017; the colour as of Hill 2018):
//!
//! ```text
//! f = F D G₂ / (4 cosθi cosθo) + Fm (1 − E(θi)) (1 − E(θo)) / (π (1 − Ē)),    Fm = F̄² Ē / (1 − F̄ (1 − Ē))
//! ```
//!
//! F̄ is Fresnel's term averaged over directions of cosine law. White metal (F = 1) reflects all it receives, within the
//! error of the table of E, 0.002.

use super::albedo::{Reflected, isotropic, reflection};
use super::{BsdfSample, BsdfValue, Lobe, both_above, conductor, fresnel, reflect_about};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::Real;
use std::f32::consts::FRAC_1_PI;

/// F̄ = 2 ∫ F(μ) μ dμ, by Gauss's rule of four points.
#[inline(always)]
pub fn average_fresnel<F: Real>(eta: Rgb<F>, k: Rgb<F>) -> Rgb<F> {
    let at = |mu: f32, weight: f32| fresnel::conductor(F::splat(mu), eta, k) * F::splat(2.0 * mu * weight);
    let outer = at(0.069_431_84, 0.173_927_42) + at(0.930_568_16, 0.173_927_42);
    outer + at(0.330_009_5, 0.326_072_58) + at(0.669_990_52, 0.326_072_58)
}

#[inline(always)]
pub fn eval<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let alpha = lobe.p[6];
    let (eta, k) = conductor::index(lobe);
    let h = (a + b).normalized();
    let (once, pdf_once) = reflection(isotropic(alpha), a, b, h);
    let (from_a, from_b) = (Reflected::at(a.z.relu(), alpha).lost, Reflected::at(b.z.relu(), alpha).lost);
    let lost = Reflected::average(alpha).lost;
    let again = from_a * from_b / lost * FRAC_1_PI;
    let (f, average) = (fresnel::conductor(a.dot(h), eta, k) * lobe.color, average_fresnel(eta, k) * lobe.color);
    let channel = |f: F, average: F| {
        let colour = average * average * (F::one() - lost) / (F::one() - average * lost);
        f * once + colour * again
    };
    let value = Rgb::new(channel(f.r, average.r), channel(f.g, average.g), channel(f.b, average.b));
    let pdf = (F::one() - from_a) * pdf_once + from_a * cosine_hemisphere_pdf(b).0;
    BsdfValue { f: value, pdf: PdfSolidAngle(pdf) }.masked(both_above(a, b))
}

/// One bounce with probability E, more with the rest.
#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F) -> BsdfSample<F> {
    let alpha = lobe.p[6];
    let once = choice.lt(F::one() - Reflected::at(a.z.relu(), alpha).lost);
    let facet = reflect_about(a, isotropic(alpha).sample_visible(a, u));
    let b = Vec3::select(once, facet, cosine_hemisphere(u));
    let value = eval(lobe, a, b);
    let good = both_above(a, b) & value.pdf.0.gt(F::zero());
    BsdfSample::glossy(b, Rgb::select(good, value.f * (b.z / value.pdf.0), Rgb::black()), value.pdf.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_average_of_fresnels_term_is_exact_enough() {
        for (eta, k) in [(0.143_f32, 3.983_f32), (1.442, 1.603), (1.657, 9.224), (2.0, 0.5)] {
            let n = 20_000;
            let f = |i: u32| {
                let mu = (i as f32 + 0.5) / n as f32;
                f64::from(fresnel::conductor(mu, Rgb::grey(eta), Rgb::grey(k)).g * mu) * 2.0 / f64::from(n)
            };
            let exact: f64 = (0..n).map(f).sum();
            let found = f64::from(average_fresnel(Rgb::grey(eta), Rgb::grey(k)).g);
            assert!((found - exact).abs() < 1e-3, "η {eta}, k {k}: {found} for {exact}");
        }
    }
}
