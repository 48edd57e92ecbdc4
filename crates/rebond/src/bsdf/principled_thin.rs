//! A sheet without thickness, such as a leaf, paper or a bubble: the thin form of Disney's BSDF (Burley 2015), with the parameters of
//! Mitsuba's `principledthin`. `color` is the base colour c; `p` is the share s of what is specular, the index η of the sheet, the
//! share d of the rest that passes, the flatness w, the weight k of the sheen, the share t of tint in what is reflected, αx and αy of
//! roughness r = (αx αy)^¼, and the share of tint in the sheen.
//!
//! ```text
//! reflected  s F' D G₁ G₁ / (4 cosθi cosθo) + (1−s)(1−d) [ c/π ((1−w) fd + w fss) + k T (1−h·ω)⁵ ]
//! passed     s c (1−F) D' G₁' G₁' / (4 cosθi cosθo) + (1−s) d c/π
//! F' = (1−t) F + t (f0 + (1−f0)(1−h·ω)⁵),    f0 = c/Y(c) ((η−1)/(η+1))²
//! fd = (1 − f(θi)/2)(1 − f(θo)/2) + R (f(θi) + f(θo) + f(θi) f(θo) (R−1)),    f(θ) = (1−cosθ)⁵,    R = 2 r (h·ω)²
//! fss = 5/4 ((1 + (R/2 − 1) f(θi))(1 + (R/2 − 1) f(θo)) (1/(cosθi + cosθo) − ½) + ½)
//! ```
//!
//! F is Fresnel's, T the tint of the sheen, between white and c/Y(c). What passes is what facets of α' = (0.65 η − 0.35)² α would
//! reflect, mirrored to the other side: nothing is bent. Both sides are the same. It is reciprocal. But its diffuse part is as bright as
//! artists wanted it: white and of roughness 1 it reflects 29/28 of what it receives from straight above and 1.5 times as much as it gets at the
//! horizon, and sheen comes on top; roughness 0.3 gives back less than it gets. So does glass without a tint.

use super::albedo::{schlick, sheen};
use super::ggx::{Ggx, SMOOTH};
use super::{BsdfSample, BsdfValue, Lobe, fresnel, reflect_about};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::{Mask, Real};
use std::f32::consts::FRAC_1_PI;

/// Facets that reflect, or in lanes of `passes` those that let light through.
#[inline(always)]
fn facets<F: Real>(lobe: &Lobe<F>, passes: F::Mask) -> Ggx<F> {
    let narrower = lobe.p[1] * 0.65 - 0.35;
    let scale = F::select(passes, narrower * narrower, F::one());
    let alpha = |alpha: F| (alpha * scale).max(F::splat(SMOOTH));
    Ggx { ax: alpha(lobe.p[6]), ay: alpha(lobe.p[7]) }
}

/// Between white and the hue of a colour.
#[inline(always)]
fn tint<F: Real>(color: Rgb<F>, share: F) -> Rgb<F> {
    let luminance = color.luminance();
    let over = F::select(luminance.gt(F::zero()), luminance.recip(), F::zero());
    color.map(|c| {
        let hue = F::select(luminance.gt(F::zero()), c * over, F::one());
        F::one() + (hue - 1.0) * share
    })
}

/// Fresnel's term, and with its tint, at a cosine to the facet.
#[inline(always)]
fn reflectance<F: Real>(lobe: &Lobe<F>, cos: F) -> (F, Rgb<F>) {
    let (plain, _) = fresnel::dielectric(cos.relu(), lobe.p[1]);
    let share = lobe.p[5];
    let root = (lobe.p[1] - 1.0) / (lobe.p[1] + 1.0);
    let tinted = tint(lobe.color, F::one()).map(|hue| {
        let f0 = hue * (root * root);
        plain + (f0 + (F::one() - f0) * schlick(cos) - plain) * share
    });
    (plain, tinted)
}

/// Chances to draw what is reflected and what passes, specularly; then what is reflected and what passes diffusely.
#[inline(always)]
fn shares<F: Real>(lobe: &Lobe<F>, mu: F) -> [F; 4] {
    let [specular, _, passes, _, fuzz, ..] = lobe.p;
    let (plain, tinted) = reflectance(lobe, mu);
    let (rest, color) = (F::one() - specular, lobe.color.max());
    let weights = [
        specular * tinted.max(),
        specular * (F::one() - plain) * color,
        rest * (F::one() - passes) * (color + fuzz * sheen(mu)),
        rest * passes * color,
    ];
    let sum = weights[0] + weights[1] + weights[2] + weights[3];
    let scale = F::select(sum.gt(F::zero()), sum.recip(), F::zero());
    weights.map(|w| w * scale)
}

/// Mirrored so that a is above.
#[inline(always)]
fn mirrored<F: Real>(above: F::Mask, w: Vec3<F>) -> Vec3<F> {
    vec3(w.x, w.y, F::select(above, w.z, -w.z))
}

#[inline(never)]
pub fn eval<F: Real>(lobe: Lobe<F>, a: Vec3<F>, b: Vec3<F>) -> BsdfValue<F> {
    let lobe = &lobe;
    let above = a.z.gt(F::zero());
    let (a, b) = (mirrored(above, a), mirrored(above, b));
    let passes = b.z.lt(F::zero());
    let b = vec3(b.x, b.y, b.z.abs());
    let sum = a + b;
    let length = sum.length();
    // Half of the length is a·h and b·h: near the horizon neither product has the digits for both to be the same.
    let (h, cos) = (sum * length.recip(), length * 0.5);

    let ggx = facets(lobe, passes);
    let quarter = ggx.d(h) / (a.z * 4.0 * (ggx.lambda(a) + 1.0));
    let (plain, tinted) = reflectance(lobe, cos);
    let passed = lobe.color * (F::one() - plain);
    let specular = Rgb::select(passes, passed, tinted) * (lobe.p[0] * quarter / (b.z * (ggx.lambda(b) + 1.0)));

    let (fa, fb) = (schlick(a.z), schlick(b.z));
    let alpha = (lobe.p[6] * lobe.p[7]).sqrt();
    // What is as smooth as can be stands for what is wholly smooth.
    let roughness = F::select(alpha.gt(F::splat(SMOOTH)), alpha.sqrt(), F::zero());
    let retro = roughness * (cos * cos) * 2.0;
    let rough = (F::one() - fa * 0.5) * (F::one() - fb * 0.5) + retro * (fa + fb + fa * fb * (retro - 1.0));
    let ends = retro * 0.5 - 1.0;
    let flattened = (F::one() + ends * fa) * (F::one() + ends * fb);
    let flat = (flattened * ((a.z + b.z).recip() - 0.5) + 0.5) * 1.25;
    let share = F::select(passes, lobe.p[2], F::one() - lobe.p[2]) * (F::one() - lobe.p[0]);
    let over_lambert = F::select(passes, F::one(), rough + (flat - rough) * lobe.p[3]);
    let fuzz = F::select(passes, F::zero(), lobe.p[4] * schlick(cos));
    let diffuse = lobe.color * (over_lambert * FRAC_1_PI) + tint(lobe.color, lobe.p[8]) * fuzz;

    let [reflected, through, up, down] = shares(lobe, a.z);
    let (of_facets, of_cosine) = (F::select(passes, through, reflected), F::select(passes, down, up));
    let pdf = of_facets * quarter + of_cosine * cosine_hemisphere_pdf(b).0;
    let there = a.z.gt(F::zero()) & b.z.gt(F::zero());
    BsdfValue { f: specular + diffuse * share, pdf: PdfSolidAngle(pdf) }.masked(there)
}

#[inline(never)]
pub fn sample<F: Real>(lobe: Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F) -> BsdfSample<F> {
    let above = a.z.gt(F::zero());
    let up = mirrored(above, a);
    let [reflected, through, diffuse, _] = shares(&lobe, up.z);
    let first = choice.lt(reflected);
    let specular = choice.lt(reflected + through);
    let passes = specular.and_not(first) | choice.ge(reflected + through + diffuse);
    let facet = reflect_about(up, facets(&lobe, passes).sample_visible(up, u));
    let b = Vec3::select(specular, facet, cosine_hemisphere(u));
    // What facets throw below is lost.
    let seen = b.z.gt(F::zero());
    let w = mirrored(above, vec3(b.x, b.y, F::select(passes, -b.z, b.z)));
    let value = eval(lobe, a, w);
    let good = seen & value.pdf.0.gt(F::zero());
    let weight = value.f * (b.z / value.pdf.0);
    BsdfSample::glossy(w, Rgb::select(good, weight, Rgb::black()), value.pdf.0)
}
