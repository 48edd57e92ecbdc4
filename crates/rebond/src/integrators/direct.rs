//! Direct light: emission, and what arrives from emitters without a bounce. Unbiased, one sample of
//!
//! ```text
//! Lo(x, ωo) = Le + ∫ Le(x', −ωi) f_r V |cosθi| dωi                        over directions
//!           = Le + Σ_lights ∫ Le(y → x) f_r V |cosθi| |cosθ'| / d² dA     over their surfaces
//! ```
//!
//! for each camera ray, its ωi or y drawn as `sampling` says:
//!
//! | `sampling` | draws | density |
//! |---|---|---|
//! | `area` | points of the lights, all surfaces alike | 1/ΣA |
//! | `solid-angle` | directions to the lights, uniform over each | 1/Ω for one of them, chosen by power |
//! | `light` | points of the lights | ∝ Le, over all of them |
//! | `cosine` | directions | \|cosθi\|/π |
//! | `bsdf` | directions | ∝ f_r \|cosθi\|, as far as the model can |
//! | `mis` | one point as `light`, one direction as `bsdf` | weighed by the power heuristic (Veach 1997, ch. 9) |
//! | `product` | one of `candidates` of both kinds | → ∝ Le f_r \|cosθi\|, by resampling |
//!
//! Resampling (Talbot, Cline, Egbert 2005) draws M candidates x_i, weighs them w_i = p̂(x_i)/(Σ_j n_j p_j(x_i)) (the balance
//! heuristic over its n_j candidates of each kind), takes one with probability w_i/Σw and counts it f/p̂ · Σw. Its p̂ is the
//! luminance of the integrand without V: what noise is left is that of shadows. Directions stand as candidates for
//! surroundings only, since to know what else they meet takes a ray.
//!
//! What only one sampler finds is always left to it: light in mirrors and glass to `bsdf`, light of points and beams to
//! `light`.

use super::IntegratorError;
use crate::bsdf::{Bsdf, BsdfSample, TransportMode};
use crate::emitter::{EmitterSample, LightSampling};
use crate::math::{Frame, Moments, Rgb, Vec3};
use crate::render::{Bounce, Dimensions, PathState, Shade, ShadowRay};
use crate::sampling::warp::cosine_hemisphere;
use crate::sampling::{Discrete, PdfSolidAngle};
use crate::scene::{Scene, Surface, is_hit};
use crate::transport::power_heuristic;
use rebond_bvh::Hit;
use rebond_lanes::{Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::num::NonZeroU32;

/// How light that arrives is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectSampling {
    /// Points of lights, all their surfaces alike. (Surroundings, points and beams have no area: each is asked as often
    /// as a surface of mean area.)
    Area,
    /// Directions to lights, uniform over the solid angle of one, which is chosen by what it emits.
    SolidAngle,
    /// Points of lights by what they emit.
    Light,
    /// Directions by the cosine.
    Cosine,
    /// Directions by the BSDF.
    Bsdf,
    /// `light` and `bsdf`, weighed against each other.
    #[default]
    Mis,
    /// By the product of light and BSDF.
    Product,
}

/// A factor of the integrand, shown by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Factor {
    /// Le: what the light sends this way (of points and beams their irradiance), shadows or not.
    Le,
    /// V: 1 where nothing is in the way.
    V,
    /// f_r |cosθi|.
    Bsdf,
}

/// Settings of direct light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DirectSettings {
    /// How light that arrives is found.
    pub sampling: DirectSampling,
    /// Whether lights throw shadows. Without, `sampling` must draw points of lights.
    pub shadows: bool,
    /// Only this emitter, counted from 0; all if not given.
    pub light: Option<u32>,
    /// Only this factor of the integrand, averaged over points that `area`, `solid-angle` or `light` draw.
    pub factor: Option<Factor>,
    /// How many candidates `product` draws.
    pub candidates: NonZeroU32,
}

impl Default for DirectSettings {
    fn default() -> Self {
        Self {
            sampling: DirectSampling::default(),
            shadows: true,
            light: None,
            factor: None,
            candidates: NonZeroU32::new(16).expect("16 is not 0"),
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("sampling", "how light is found: area, solid-angle, light, cosine, bsdf, mis or product; mis"),
    ("shadows", "whether lights throw shadows; true"),
    ("light", "number of the one emitter to count; all if not given"),
    ("factor", "one factor of the integrand alone: le, v or bsdf"),
    ("candidates", "how many candidates product draws; 16"),
];

/// The estimator.
pub struct Direct {
    settings: DirectSettings,
    /// The choice among emitters by area.
    by_area: Option<Discrete>,
    /// How a point of a light is drawn.
    light_sampling: LightSampling,
}

/// Dimensions of the sample values.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;
const BSDF_CHOICE: u32 = 2;
const BSDF_DIRECTION: u32 = 3;
const MIX_CHOICE: u32 = 4;
/// Candidates follow, each with these.
const CANDIDATES: u32 = 5;
const CHOICE: u32 = 0;
const PLACE: u32 = 1;
const KEEP: u32 = 2;
const PER_CANDIDATE: u32 = 3;
/// The most candidates that are drawn.
const MOST_CANDIDATES: u32 = 1024;

impl Direct {
    pub(super) fn new(settings: DirectSettings, scene: &Scene) -> Result<Self, IntegratorError> {
        use DirectSampling::{Area, Light, Product, SolidAngle};
        let emitters = scene.emitters();
        let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
        if let Some(light) = settings.light
            && light as usize >= emitters.len()
        {
            let message = format!("there is no emitter {light}: the scene has {}", emitters.len());
            return error(message, "emitters are counted from 0; `rebond info` says how many there are");
        }
        if settings.factor.is_some() && !matches!(settings.sampling, Area | Light | SolidAngle) {
            let message = "a factor of the integrand is averaged over points of lights".to_owned();
            return error(message, "add sampling=light, area or solid-angle");
        }
        if !settings.shadows && !matches!(settings.sampling, Area | Light | SolidAngle | Product) {
            let message =
                "light without shadows cannot be found by directions: rays would have to pass walls".to_owned();
            return error(message, "add sampling=light, area, solid-angle or product");
        }
        if settings.candidates.get() > MOST_CANDIDATES {
            return error(format!("candidates = {}", settings.candidates), "1024 are the most");
        }
        let by_area = (settings.sampling == Area).then(|| {
            // Points and beams count like the mean surface.
            let areas: Vec<Option<f32>> =
                (0..emitters.len() as u32).map(|i| emitters.area(i).map(|a| a.min(f32::MAX))).collect();
            let known: Moments = areas.iter().flatten().map(|a| f64::from(*a)).collect();
            let mean = if known.count() == 0 { 1.0 } else { known.mean() as f32 };
            Discrete::new(&areas.iter().map(|a| a.unwrap_or(mean)).collect::<Vec<f32>>())
        });
        let light_sampling =
            if settings.sampling == SolidAngle { LightSampling::SolidAngle } else { LightSampling::Area };
        Ok(Self { settings, by_area: by_area.flatten(), light_sampling })
    }

    /// Whether the light of this emitter is asked for.
    #[inline(always)]
    fn counts<F: Real>(&self, emitter: F::Index) -> F::Mask {
        self.settings.light.map_or(F::Mask::splat(true), |light| emitter.eq(F::Index::splat(light)))
    }

    /// Light for a surface from one emitter, weighed for all.
    #[inline(always)]
    fn sample_light<F: Real>(
        &self,
        scene: &Scene,
        surface: &Surface<F>,
        normal: Vec3<F>,
        choice: impl FnOnce() -> F,
        place: [F; 2],
        mask: F::Mask,
    ) -> Option<EmitterSample<F>> {
        let (emitter, probability) = match (self.settings.light, &self.by_area) {
            (Some(light), _) => (F::Index::splat(light), F::one()),
            (None, Some(by_area)) => by_area.sample(choice()),
            (None, None) => scene.light_sampler().sample(surface.p, normal, choice, mask)?,
        };
        let light = scene.emitters().sample(emitter, surface.p, surface.time, self.light_sampling, place, mask);
        Some(light.chosen_with(probability))
    }

    /// The probability with which [`Direct::sample_light`] asks this emitter.
    #[inline(always)]
    fn probability<F: Real>(&self, scene: &Scene, p: Vec3<F>, n: Vec3<F>, emitter: F::Index, mask: F::Mask) -> F {
        match (self.settings.light, &self.by_area) {
            (Some(_), _) => F::one(),
            (None, Some(by_area)) => by_area.probability(emitter),
            (None, None) => scene.light_sampler().probability(p, n, emitter, mask),
        }
    }

    /// What light found by a ray counts; `pdf` is that of the ray, ∞ if only its sampler finds it.
    #[inline(always)]
    fn weight<F: Real>(&self, pdf: F, light_pdf: impl FnOnce() -> F) -> F {
        if self.settings.sampling == DirectSampling::Mis { power_heuristic(pdf, light_pdf()) } else { F::one() }
    }

    /// A ray to a point on a light that was drawn alone.
    #[inline(always)]
    fn towards_light<F: Real>(
        &self,
        scene: &Scene,
        path: &PathState<F>,
        surface: &Surface<F>,
        bsdf: &Bsdf<F>,
        u: &Dimensions<F>,
        mask: F::Mask,
    ) -> Option<ShadowRay<F>> {
        let n = bsdf.normal();
        let light = self.sample_light(scene, surface, n, || u.value(LIGHT_CHOICE), u.pair(LIGHT_POINT), mask)?;
        let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, mask);
        let cos = n.dot(light.wi).abs();
        let only_here = light.pdf.0.le(F::zero());
        let weight = match self.settings.sampling {
            DirectSampling::Cosine | DirectSampling::Bsdf => F::select(only_here, F::one(), F::zero()),
            DirectSampling::Mis => F::select(only_here, F::one(), power_heuristic(light.pdf.0, value.pdf.0)),
            _ => F::one(),
        };
        let contribution = match self.settings.factor {
            None => value.f * light.weight * (cos * weight),
            Some(Factor::Le) => light.weight * F::select(only_here, F::one(), light.pdf.0),
            Some(Factor::V) => Rgb::white().masked(light.weight.is_lit()),
            Some(Factor::Bsdf) => (value.f * cos).masked(light.weight.is_lit()),
        };
        let event = bsdf.event(surface.wo, light.wi);
        ShadowRay::new(surface, &light, path.time, path.throughput() * contribution, event, mask)
    }

    /// A ray to one of many candidates.
    #[inline(always)]
    fn towards_resampled<F: Real>(
        &self,
        scene: &Scene,
        path: &PathState<F>,
        surface: &Surface<F>,
        bsdf: &Bsdf<F>,
        u: &Dimensions<F>,
        mask: F::Mask,
    ) -> Option<ShadowRay<F>> {
        let n = bsdf.normal();
        let surroundings = || {
            let all = scene.emitters().environments.iter();
            all.filter(|(number, _)| self.settings.light.is_none_or(|light| light == *number))
        };
        let total = self.settings.candidates.get();
        let directions = if surroundings().next().is_some() { total / 2 } else { 0 };
        let points = total - directions;
        let (of_points, of_directions) = (F::splat(points as f32), F::splat(directions as f32));

        let mut chosen = EmitterSample::none();
        let (mut sum, mut colour) = (F::zero(), Rgb::black());
        // Keeps each candidate with probability weight/Σweights so far. What is left of `keep` within its share is
        // returned, to decide once more.
        let mut offer = |light: EmitterSample<F>, value: Rgb<F>, weight: F, keep: F| {
            let weight = F::select(weight.gt(F::zero()), weight, F::zero());
            sum += weight;
            let at = keep * sum;
            let kept = mask & at.lt(weight);
            chosen = EmitterSample::select(kept, light, chosen);
            colour = Rgb::select(kept, value * value.luminance().recip(), colour);
            let rest = F::select(kept, at / weight, (at - weight) / (sum - weight));
            F::select(rest.is_finite(), rest, keep)
        };
        for k in 0..total {
            let at = CANDIDATES + k * PER_CANDIDATE;
            let (choice, place, mut keep) = (|| u.value(at + CHOICE), u.pair(at + PLACE), u.value(at + KEEP));
            if k < points {
                let light = self.sample_light(scene, surface, n, choice, place, mask)?;
                let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, mask);
                // f/p of this kind alone.
                let term = value.f * light.weight * n.dot(light.wi).abs();
                // A direction finds the surroundings, and no point, beam or surface.
                let of_bsdf = F::select(light.infinite, value.pdf.0, F::zero()) * of_directions;
                let p = light.pdf.0;
                let all = F::select(p.gt(F::zero()), p / (of_points * p + of_bsdf), of_points.recip());
                offer(light, term, term.luminance() * all, keep);
            } else {
                let next = bsdf.sample(surface.wo, place, choice, TransportMode::Radiance, mask);
                for (number, environment) in surroundings() {
                    let (radiance, pdf) = environment.eval(next.w);
                    let of_light = pdf.0 * self.probability(scene, surface.p, n, F::Index::splat(*number), mask);
                    let light = EmitterSample { wi: next.w, infinite: F::Mask::splat(true), ..EmitterSample::none() };
                    let term = next.weight * radiance;
                    let all = next.pdf.0 / (of_points * of_light + of_directions * next.pdf.0);
                    keep = offer(light, term, term.luminance() * all, keep);
                }
            }
        }
        let event = bsdf.event(surface.wo, chosen.wi);
        ShadowRay::new(surface, &chosen, path.time, path.throughput() * colour * sum, event, mask)
    }
}

/// A direction by the cosine, on the side of the viewer or, through what transmits, on either.
#[inline(always)]
fn by_cosine<F: Real>(bsdf: &Bsdf<F>, wo: Vec3<F>, u: [F; 2], choice: F, mask: F::Mask) -> BsdfSample<F> {
    let n = bsdf.normal().facing(wo);
    let either = bsdf.may_transmit();
    let behind = either & choice.lt(F::splat(0.5));
    let local = cosine_hemisphere(u);
    let w = Frame::around(Vec3::select(behind, -n, n)).to_world(local);
    let share = F::select(either, F::splat(2.0), F::one());
    let value = bsdf.eval(wo, w, TransportMode::Radiance, mask);
    BsdfSample {
        w,
        weight: value.f * (share * PI),
        pdf: PdfSolidAngle(local.z / (share * PI)),
        specular: F::Mask::splat(false),
        eta: F::one(),
    }
}

impl Shade for Direct {
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F> {
        let u = path.dimensions(0);
        let found = active & is_hit(hit);
        let (from, normal) = (path.from(), path.normal());
        let shows_light = self.settings.factor.is_none();

        let escaped = active.and_not(found);
        if shows_light && escaped.any() {
            for (number, environment) in &scene.emitters().environments {
                let emitter = F::Index::splat(*number);
                let (radiance, pdf) = environment.eval(path.direction());
                let weight = self.weight(path.pdf, || pdf.0 * self.probability(scene, from, normal, emitter, escaped));
                path.add(radiance * weight, escaped & self.counts::<F>(emitter));
            }
        }
        if found.none() {
            return Bounce::end();
        }
        let surface = scene.surface(&path.ray(), hit, found);
        if shows_light {
            let emission = scene.emitted(&surface, found);
            let lit = found & emission.is_lit() & self.counts::<F>(surface.emitter);
            if lit.any() {
                let weight = self.weight(path.pdf, || {
                    let hit = surface.seen_from(path.origin());
                    let probability = self.probability(scene, from, normal, surface.emitter, lit);
                    scene.emitters().pdf(&hit, self.light_sampling, lit).0 * probability
                });
                path.add(emission * weight, lit);
            }
        }
        let first = found & path.depth.lt(F::Index::splat(2));
        if first.none() {
            return Bounce::end();
        }
        let bsdf = scene.bsdf(&surface, || u.value(MIX_CHOICE), first);
        let specular = first & bsdf.is_specular();
        let spread = first.and_not(specular);

        let mut shadow = None;
        if spread.any() {
            shadow = match self.settings.sampling {
                DirectSampling::Product => self.towards_resampled(scene, path, &surface, &bsdf, &u, spread),
                _ => self.towards_light(scene, path, &surface, &bsdf, &u, spread),
            };
        }
        let shadowless = !self.settings.shadows || matches!(self.settings.factor, Some(Factor::Le | Factor::Bsdf));
        if shadowless && let Some(shadow) = &mut shadow {
            // A ray of no length meets nothing.
            shadow.ray.tmax = F::zero();
        }

        let by_bsdf = match self.settings.sampling {
            DirectSampling::Bsdf | DirectSampling::Mis => first,
            _ => specular,
        };
        let by_bsdf = if shows_light { by_bsdf } else { F::Mask::splat(false) };
        let cosine = self.settings.sampling == DirectSampling::Cosine;
        if !cosine && by_bsdf.none() {
            return Bounce::last(shadow);
        }
        let (direction, choice) = (u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE));
        let mut next = bsdf.sample(surface.wo, direction, choice, TransportMode::Radiance, by_bsdf);
        let mut alive = by_bsdf;
        if cosine {
            next = BsdfSample::select(spread, by_cosine(&bsdf, surface.wo, direction, choice(), spread), next);
            alive = first;
        }
        let alive = alive & next.weight.is_lit();
        let pdf = F::select(next.specular, F::splat(f32::INFINITY), next.pdf.0);
        path.go(&surface, bsdf.normal(), &next, pdf);
        path.depth = path.depth + F::Index::splat(1);
        Bounce { alive, event: bsdf.event(surface.wo, next.w), shadow }
    }
}
