//! One material for most things, with the parameters that glTF 2.0 and Blender's Principled BSDF have in common (after Burley
//! 2012). `color` is the base colour c; `p` is metallic m, transmission t, the index η of the inside over the outside, the
//! reflectance F0 at normal incidence of what is no metal, the weight k of the clearcoat and its roughness α, then αx and αy
//! of the base, and the weight s of the sheen.
//!
//! ```text
//! f        = k fcoat + K(ωi) K(ωo) [ s' fsheen + S(ωi) S(ωo) fbase ]
//! fbase    = m fmetal + (1−m)(1−t) fplastic + (1−m) t fglass
//! fmetal   = D G₂ / (4 cosθi cosθo) · (c + (1−c)(1−h·ω)⁵)
//! fplastic = D G₂ / (4 cosθi cosθo) · (F0 + (1−F0)(1−h·ω)⁵) + c/π (1−E(θi))(1−E(θo)) / (1−Ē)
//! fglass   as a rough dielectric, what it lets through coloured by √c, so that going in and coming out colour by c
//! fsheen   = (1−h·ω)⁵,    s' = s (1−m);     fcoat is GGX of F0 = 0.04
//! K(ω)     = 1 − k Ecoat(θ),    S(ω) = 1 − s' ∫ fsheen cosθ;     both 1 on the inner side
//! ```
//!
//! Each layer passes on what it does not reflect, on the way in and on the way out, so all is reciprocal and nothing reflects
//! more than it receives. Layers over the base lose a little, up to 0.03 where they are anisotropic
//! ([`albedo`](super::albedo)), and rough metal what its facets exchange.

use super::albedo::{Reflected, isotropic, reflection, schlick, sheen};
use super::ggx::Ggx;
use super::{BsdfSample, BsdfValue, Lobe, TransportMode, reflect_about, rough_dielectric};
use crate::math::{Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use rebond_lanes::{Mask, Real};
use std::f32::consts::FRAC_1_PI;

/// F0 of the clearcoat, of index 1.5.
const COAT: f32 = 0.04;

/// The material as seen from one direction.
struct Layers<F: Real> {
    metallic: F,
    transmission: F,
    f0: F,
    coat: F,
    coat_alpha: F,
    sheen: F,
    ggx: Ggx<F>,
}

/// Chances of drawing from each layer.
struct Shares<F: Real> {
    coat: F,
    cosine: F,
    facets: F,
    glass: F,
}

impl<F: Real> Layers<F> {
    #[inline(always)]
    fn new(lobe: &Lobe<F>) -> Self {
        let p = &lobe.p;
        Self {
            metallic: p[0],
            transmission: p[1],
            f0: p[3],
            coat: p[4],
            coat_alpha: p[5],
            sheen: p[8] * (F::one() - p[0]),
            ggx: Ggx { ax: p[6], ay: p[7] },
        }
    }

    /// Albedo of the clearcoat.
    #[inline(always)]
    fn coat_albedo(&self, mu: F) -> F {
        self.coat * Reflected::at(mu, self.coat_alpha).with(F::splat(COAT))
    }

    /// What the layers over the base let through to it.
    #[inline(always)]
    fn passes(&self, mu: F) -> F {
        (F::one() - self.coat_albedo(mu)) * (F::one() - self.sheen * sheen(mu))
    }

    /// By how much each layer is thought to reflect light to a direction above.
    #[inline(always)]
    fn shares(&self, lobe: &Lobe<F>, a: Vec3<F>) -> Shares<F> {
        let above = a.z.gt(F::zero());
        let mu = a.z.relu();
        let coat = self.coat_albedo(mu);
        let sheen = self.sheen * sheen(mu);
        let base = (F::one() - coat) * (F::one() - sheen);
        let reflected = Reflected::around(self.ggx, a);
        let dielectric = (F::one() - self.metallic) * (F::one() - self.transmission);
        let e = reflected.with(self.f0);
        let facets = base * (self.metallic * reflected.with(lobe.color.max()) + dielectric * e);
        let cosine = (F::one() - coat) * sheen + base * dielectric * (F::one() - e) * lobe.color.max();
        let glass = base * (F::one() - self.metallic) * self.transmission;
        let sum = coat + cosine + facets + glass;
        let scale = F::select(sum.gt(F::zero()), sum.recip(), F::zero());
        let pick = |x: F| F::select(above, x * scale, F::zero());
        // From within there is only glass.
        let inside = F::select(glass.gt(F::zero()), F::one(), F::zero());
        Shares {
            coat: pick(coat),
            cosine: pick(cosine),
            facets: pick(facets),
            glass: F::select(above, glass * scale, inside),
        }
    }
}

/// The same as a rough dielectric.
#[inline(always)]
fn glass<F: Real>(lobe: &Lobe<F>) -> Lobe<F> {
    let p = &lobe.p;
    let zero = F::zero();
    Lobe { color: Rgb::white(), p: [p[2], zero, zero, zero, zero, zero, p[6], p[7], zero] }
}

#[inline(never)]
pub fn eval<F: Real>(lobe: Lobe<F>, a: Vec3<F>, b: Vec3<F>, mode: TransportMode) -> BsdfValue<F> {
    let lobe = &lobe;
    let layers = Layers::new(lobe);
    let shares = layers.shares(lobe, a);
    let zero = F::zero();
    let (above_a, above_b) = (a.z.gt(zero), b.z.gt(zero));
    let above = above_a & above_b;
    let (mu_a, mu_b) = (a.z.relu(), b.z.relu());
    let through = F::select(above_a, layers.passes(mu_a), F::one()) * F::select(above_b, layers.passes(mu_b), F::one());

    // What is reflected above.
    let h = (a + b).normalized();
    let grazing = schlick(a.dot(h));
    let (facets, pdf_facets) = reflection(layers.ggx, a, b, h);
    let (coat, pdf_coat) = reflection(isotropic(layers.coat_alpha), a, b, h);
    let coat = layers.coat * coat * (grazing * (1.0 - COAT) + COAT);
    let under_coat = (F::one() - layers.coat_albedo(mu_a)) * (F::one() - layers.coat_albedo(mu_b));
    let sheen = layers.sheen * grazing * under_coat;
    let not_metal = F::one() - layers.metallic;
    let dielectric = not_metal * (F::one() - layers.transmission);
    let lost = (F::one() - Reflected::average_around(layers.ggx).with(layers.f0)).max(F::splat(1e-6));
    let e = |w: Vec3<F>| Reflected::around(layers.ggx, w).with(layers.f0);
    let diffuse = (F::one() - e(a)) * (F::one() - e(b)) / lost * FRAC_1_PI * dielectric;
    let gloss = dielectric * (layers.f0 + (F::one() - layers.f0) * grazing) * facets;
    let channel = |c: F| {
        let metal = layers.metallic * (c + (F::one() - c) * grazing) * facets;
        coat + sheen + through * (metal + gloss + c * diffuse)
    };
    let reflected = Rgb::new(channel(lobe.color.r), channel(lobe.color.g), channel(lobe.color.b)).masked(above);
    let cosine = cosine_hemisphere_pdf(b).0;
    let pdf = shares.coat * pdf_coat + shares.cosine * cosine + shares.facets * pdf_facets;
    let mut value = BsdfValue { f: reflected, pdf: PdfSolidAngle(F::select(above, pdf, zero)) };

    // Glass, from both sides.
    let clear = not_metal * layers.transmission;
    if shares.glass.gt(zero).any() {
        let glass = rough_dielectric::eval(&glass(lobe), a, b, mode);
        let crosses = above_a ^ above_b;
        let root = Rgb::new(lobe.color.r.sqrt(), lobe.color.g.sqrt(), lobe.color.b.sqrt());
        value.f += glass.f * Rgb::select(crosses, root, Rgb::white()) * (clear * through);
        value.pdf.0 += glass.pdf.0 * shares.glass;
    }
    value
}

#[inline(never)]
pub fn sample<F: Real>(lobe: Lobe<F>, a: Vec3<F>, u: [F; 2], choice: F, mode: TransportMode) -> BsdfSample<F> {
    let layers = Layers::new(&lobe);
    let shares = layers.shares(&lobe, a);
    let coat = choice.lt(shares.coat);
    let until_cosine = shares.coat + shares.cosine;
    let cosine = choice.lt(until_cosine).and_not(coat);
    let until_facets = until_cosine + shares.facets;
    let is_glass = choice.ge(until_facets) & shares.glass.gt(F::zero());
    let ggx = Ggx {
        ax: F::select(coat, layers.coat_alpha, layers.ggx.ax),
        ay: F::select(coat, layers.coat_alpha, layers.ggx.ay),
    };
    let facet = reflect_about(a, ggx.sample_visible(a, u));
    let mut w = Vec3::select(cosine, cosine_hemisphere(u), facet);
    let mut eta = F::one();
    let mut good = F::Mask::splat(true);
    if is_glass.any() {
        let rest = ((choice - until_facets) / shares.glass).clamp(0.0, 0.999_999_94);
        let s = rough_dielectric::sample(&glass(&lobe), a, u, rest, mode);
        w = Vec3::select(is_glass, s.w, w);
        eta = F::select(is_glass, s.eta, eta);
        good = s.weight.is_lit() | !is_glass;
    }
    let value = eval(lobe, a, w, mode);
    let above = a.z.gt(F::zero()) & w.z.gt(F::zero());
    let good = good & (is_glass | above) & value.pdf.0.gt(F::zero());
    let weight = value.f * (w.z.abs() / value.pdf.0);
    BsdfSample {
        w,
        weight: Rgb::select(good, weight, Rgb::black()),
        pdf: value.pdf,
        specular: F::Mask::splat(false),
        eta,
    }
}
