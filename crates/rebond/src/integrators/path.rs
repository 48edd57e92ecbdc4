//! Path tracing (Kajiya 1986). Unbiased, unless `max_depth` cuts paths off.
//!
//! ```text
//! L(x, ωo) ≈ Le + Ld + Lind
//! Ld   = w(light) · Le(y → x) f_r V |cosθ| / pdf(light)          one point y of one emitter
//! Lind = f_r |cosθ| / pdf(bsdf) · L(x', −ωi)                     one direction ωi; its Le weighed w(bsdf)
//! ```
//!
//! | `mode` | w(light) | w(bsdf) |
//! |---|---|---|
//! | `implicit` | 0: light is found by chance | 1 |
//! | `explicit` | 1 | 0: what Ld has is not counted again |
//! | `mis` | pdf(light)² / (pdf(light)² + pdf(bsdf)²) | 1 − w(light): the power heuristic (Veach 1997, §9.2.4) |
//!
//! Where only one of the two can find the light (points and beams, mirrors and glass, the eye's own ray), it has the
//! weight 1 in every mode. Implicit paths never find points and beams.
//!
//! Past `rr_depth` segments paths end by Russian roulette ([`Roulette`]).

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::render::journal::{Journal, Weight};
use crate::render::{Bounce, PathExpression, PathState, Shade, ShadowRay};
use crate::scene::{Scene, is_hit};
use crate::transport::{Roulette, power_heuristic};
use rebond_bvh::Hit;
use rebond_lanes::{Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// How light that arrives directly is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathMode {
    /// By paths that happen to hit it.
    Implicit,
    /// By points on lights.
    Explicit,
    /// By both, weighed against each other.
    #[default]
    Mis,
}

/// Settings of path tracing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PathSettings {
    /// Longest path in segments: 1 is emitted light only, 2 direct light too. Unlimited if not given.
    pub max_depth: Option<NonZeroU32>,
    /// Segments after which Russian roulette begins.
    pub rr_depth: u32,
    /// How direct light is estimated.
    pub mode: PathMode,
    /// How long paths end.
    pub roulette: Roulette,
    /// Survival probability, or the most it may be.
    pub survival: f32,
    /// How points of triangles and parallelograms are drawn.
    pub light_sampling: LightSampling,
    /// Which paths count; all if not given.
    pub paths: Option<PathExpression>,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self {
            max_depth: None,
            rr_depth: 5,
            mode: PathMode::default(),
            roulette: Roulette::default(),
            survival: 0.95,
            light_sampling: LightSampling::Area,
            paths: None,
        }
    }
}

impl PathSettings {
    /// Which light is left out, in words.
    pub(super) fn leaves_out(&self) -> Option<String> {
        let by_depth = self.max_depth.map(|d| format!("paths of more than max_depth={d} segments are left out"));
        let by_class = self.paths.as_ref().map(|p| format!("only the paths {p} are shown"));
        match (by_depth, by_class) {
            (Some(depth), Some(class)) => Some(format!("{class}; {depth}")),
            (depth, class) => depth.or(class),
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("rr_depth", "segments after which Russian roulette begins; 5"),
    ("mode", "how direct light is estimated: implicit, explicit or mis; mis"),
    ("roulette", "how long paths end: none, constant, albedo or throughput; throughput"),
    ("survival", "probability of survival (constant), or the most it may be; 0.95"),
    ("light_sampling", "how points of flat lights are drawn: area or solid-angle; area"),
    ("paths", "which paths count: numbers of vertices such as 2 or 3..4, or an expression such as LS+DE; all"),
];

/// The estimator. How light is sampled is a constant, so that by area there is no trace of the other.
pub struct Path<const SOLID_ANGLE: bool> {
    max_depth: u32,
    rr_depth: u32,
    mode: PathMode,
    roulette: Roulette,
    survival: f32,
}

impl<const SOLID_ANGLE: bool> Path<SOLID_ANGLE> {
    const LIGHT_SAMPLING: LightSampling = if SOLID_ANGLE { LightSampling::SolidAngle } else { LightSampling::Area };

    pub(super) fn new(settings: &PathSettings, scene: &Scene) -> Result<Self, IntegratorError> {
        let PathSettings { max_depth, rr_depth, mode, roulette, survival, .. } = *settings;
        let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
        super::check_ending(roulette, survival, max_depth)?;
        if mode == PathMode::Implicit && scene.emitters().has_unhittable() {
            let message = "implicit paths never find points and beams, and the scene has some".to_owned();
            return error(message, "use mode=explicit or mode=mis, or lights with a surface");
        }
        Ok(Self { max_depth: max_depth.map_or(u32::MAX, NonZeroU32::get), rr_depth, mode, roulette, survival })
    }

    /// w(bsdf): what light counts that a ray found, drawn with density `pdf` (∞ if only its sampler draws it).
    #[inline(always)]
    fn weight_found<F: Real>(&self, pdf: F, light_pdf: impl FnOnce() -> F) -> F {
        match self.mode {
            PathMode::Implicit => F::one(),
            PathMode::Explicit => F::select(pdf.is_finite(), F::zero(), F::one()),
            PathMode::Mis => power_heuristic(pdf, light_pdf()),
        }
    }

    /// w(light): what light counts whose point was drawn with density `pdf` (0 if no ray finds it).
    #[inline(always)]
    fn weight_drawn<F: Real>(&self, pdf: F, bsdf_pdf: F) -> F {
        match self.mode {
            PathMode::Implicit => F::zero(),
            PathMode::Explicit => F::one(),
            PathMode::Mis => F::select(pdf.gt(F::zero()), power_heuristic(pdf, bsdf_pdf), F::one()),
        }
    }
}

/// Dimensions of the sample values that one bounce uses.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;
const BSDF_CHOICE: u32 = 2;
const BSDF_DIRECTION: u32 = 3;
const MIX_CHOICE: u32 = 4;
const ROULETTE: u32 = 5;
const PER_BOUNCE: u32 = 6;

impl<const SOLID_ANGLE: bool> Shade for Path<SOLID_ANGLE> {
    #[inline(always)]
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F> {
        self.shade_telling(scene, path, hit, active, &mut ())
    }

    #[inline(always)]
    fn shade_telling<F: Real>(
        &self,
        scene: &Scene,
        path: &mut PathState<F>,
        hit: &Hit<F>,
        active: F::Mask,
        journal: &mut impl Journal,
    ) -> Bounce<F> {
        let u = path.dimensions(PER_BOUNCE);
        let found = active & is_hit(hit);
        let from = path.from();

        // Le of the surroundings, on rays that left the scene.
        let escaped = active.and_not(found);
        if escaped.any() {
            for (radiance, light_pdf) in scene.surroundings(from, path.normal(), path.direction()) {
                let weight = self.weight_found(path.pdf, || light_pdf);
                journal.last(|vertex| vertex.weights.push(Weight::of(true, path.pdf, light_pdf, weight)));
                path.add(radiance * weight, escaped);
            }
        }
        if found.none() {
            return Bounce::end();
        }

        // Le of the surface that was hit.
        let surface = scene.surface(&path.ray(), hit, found);
        let emission = scene.emitted(&surface, found);
        let lit = found & emission.is_lit();
        if lit.any() {
            let seen = surface.seen_from(path.origin());
            let light_pdf = || scene.light_pdf(from, path.normal(), &seen, Self::LIGHT_SAMPLING, lit);
            let weight = self.weight_found(path.pdf, light_pdf);
            if lit.bits() & 1 == 1 {
                journal.last(|vertex| vertex.weights.push(Weight::of(true, path.pdf, light_pdf(), weight)));
            }
            path.add(emission * weight, lit);
        }
        let going_on = found & path.depth.lt(F::Index::splat(self.max_depth));
        if going_on.none() {
            return Bounce::end();
        }
        let bsdf = scene.bsdf(&surface, || u.value(MIX_CHOICE), going_on);

        // Ld: a point on a light, unless only a sampled direction can find it.
        let diffuse = going_on.and_not(bsdf.is_specular());
        let mut shadow = None;
        if self.mode != PathMode::Implicit
            && diffuse.any()
            && let Some(light) = scene.sample_light(
                surface.p,
                bsdf.receiving_normal(),
                path.time,
                Self::LIGHT_SAMPLING,
                || u.value(LIGHT_CHOICE),
                u.pair(LIGHT_POINT),
                diffuse,
            )
        {
            let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, diffuse);
            let weight = self.weight_drawn(light.pdf.0, value.pdf.0);
            if diffuse.bits() & 1 == 1 {
                journal.last(|vertex| vertex.weights.push(Weight::of(false, light.pdf.0, value.pdf.0, weight)));
            }
            let cos = bsdf.normal().dot(light.wi).abs();
            let contribution = path.throughput() * value.f * light.weight * (cos * weight);
            let event = bsdf.event(surface.wo, light.wi);
            shadow = ShadowRay::new(&surface, &light, path.time, contribution, event, diffuse);
        }

        // Lind: a direction of the BSDF.
        let next =
            bsdf.sample(surface.wo, u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE), TransportMode::Radiance, going_on);
        let mut alive = going_on & next.weight.is_lit();
        let pdf = F::select(next.specular, F::splat(f32::INFINITY), next.pdf.0);
        path.go(&surface, bsdf.receiving_normal(), &next, pdf);

        // Russian roulette.
        let gambles = alive.and_not(path.depth.lt(F::Index::splat(self.rr_depth)));
        if gambles.any() {
            let survival = self.roulette.survival(self.survival, next.weight, path.throughput() * path.eta_squared);
            if gambles.bits() & 1 == 1 {
                journal.last(|vertex| vertex.survival = Some(survival.lane(0)));
            }
            let dies = gambles & u.value(ROULETTE).ge(survival);
            alive = alive.and_not(dies);
            path.scale(F::select(gambles, survival.recip(), F::one()));
        }
        path.depth = path.depth + F::Index::splat(1);
        Bounce { alive, event: bsdf.event(surface.wo, next.w), shadow }
    }
}
