//! Path tracing (Kajiya 1986), explicit, with multiple importance sampling (Veach 1997, ch. 9). Unbiased, unless
//! `max_depth` cuts paths off.
//!
//! ```text
//! L(x, ωo) ≈ Le + Ld + Lind
//! Ld   = w(light) · Le(y → x) f_r V |cosθ| / pdf(light)          one point y of one emitter
//! Lind = f_r |cosθ| / pdf(bsdf) · L(x', −ωi)                     one direction ωi; its Le weighed w(bsdf)
//! w(a) = pdf(a)² / (pdf(light)² + pdf(bsdf)²)                    the power heuristic, β = 2
//! ```
//!
//! Past `rr_depth` a path survives with probability q = min(0.95, max channel of its throughput · η²), and counts 1/q
//! when it does (Russian roulette; η undoes what refraction did to radiance).

use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::render::{Bounce, PathState, Shade, ShadowRay};
use crate::scene::{Scene, is_hit};
use crate::transport::power_heuristic;
use rebond_bvh::Hit;
use rebond_lanes::{Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// How light that arrives directly is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathMode {
    /// By points on lights and by directions of the BSDF, weighed against each other.
    #[default]
    Mis,
}

/// Settings of path tracing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PathSettings {
    /// Longest path in segments: 1 is emitted light only, 2 direct light too. Unlimited if not given.
    pub max_depth: Option<NonZeroU32>,
    /// Segments after which Russian roulette begins.
    pub rr_depth: u32,
    /// How direct light is estimated.
    pub mode: PathMode,
    /// How points of triangles and parallelograms are drawn.
    pub light_sampling: LightSampling,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self { max_depth: None, rr_depth: 5, mode: PathMode::Mis, light_sampling: LightSampling::Area }
    }
}

impl PathSettings {
    /// Cutting paths off leaves out what they would have brought.
    pub fn is_biased(&self) -> bool {
        self.max_depth.is_some()
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("max_depth", "longest path in segments; unlimited if not given"),
    ("rr_depth", "segments after which Russian roulette begins; 5"),
    ("mode", "how direct light is estimated: mis"),
    ("light_sampling", "how points of flat lights are drawn: area or solid-angle; area"),
];

/// The estimator. How light is sampled is a constant, so that by area there is no trace of the other.
pub struct Path<const SOLID_ANGLE: bool> {
    max_depth: u32,
    rr_depth: u32,
}

impl<const SOLID_ANGLE: bool> Path<SOLID_ANGLE> {
    const LIGHT_SAMPLING: LightSampling = if SOLID_ANGLE { LightSampling::SolidAngle } else { LightSampling::Area };

    pub(super) fn new(settings: PathSettings) -> Self {
        Self { max_depth: settings.max_depth.map_or(u32::MAX, NonZeroU32::get), rr_depth: settings.rr_depth }
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
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F> {
        let u = path.dimensions(PER_BOUNCE);
        let found = active & is_hit(hit);
        let origin = path.origin();

        // Le of the surroundings, on rays that left the scene.
        let escaped = active.and_not(found);
        if escaped.any() {
            for (radiance, light_pdf) in scene.surroundings(origin, path.normal(), path.direction()) {
                let weight = power_heuristic(path.pdf, light_pdf);
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
            let light_pdf = scene.light_pdf(origin, path.normal(), &surface, Self::LIGHT_SAMPLING, lit);
            path.add(emission * power_heuristic(path.pdf, light_pdf), lit);
        }
        let going_on = found & path.depth.lt(F::Index::splat(self.max_depth));
        if going_on.none() {
            return Bounce::end();
        }
        let bsdf = scene.bsdf(&surface, || u.value(MIX_CHOICE), going_on);

        // Ld: a point on a light, unless only a sampled direction can find it.
        let diffuse = going_on.and_not(bsdf.is_specular());
        let mut shadow = None;
        if diffuse.any()
            && let Some(light) = scene.sample_light(
                surface.p,
                bsdf.normal(),
                path.time,
                Self::LIGHT_SAMPLING,
                || u.value(LIGHT_CHOICE),
                u.pair(LIGHT_POINT),
                diffuse,
            )
        {
            let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, diffuse);
            // A light that no direction finds has pdf 0, and this the whole weight.
            let weight = F::select(light.pdf.0.gt(F::zero()), power_heuristic(light.pdf.0, value.pdf.0), F::one());
            let cos = bsdf.normal().dot(light.wi).abs();
            let contribution = path.throughput() * value.f * light.weight * (cos * weight);
            shadow = ShadowRay::new(&surface, &light, path.time, contribution, diffuse);
        }

        // Lind: a direction of the BSDF.
        let next =
            bsdf.sample(surface.wo, u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE), TransportMode::Radiance, going_on);
        let mut alive = going_on & next.weight.is_lit();
        let pdf = F::select(next.specular, F::splat(f32::INFINITY), next.pdf.0);
        path.go(&surface, bsdf.normal(), &next, pdf);

        // Russian roulette.
        let gambles = alive.and_not(path.depth.lt(F::Index::splat(self.rr_depth)));
        if gambles.any() {
            let survival = (path.throughput().map(F::abs).max() * path.eta_squared).min(F::splat(0.95));
            let dies = gambles & u.value(ROULETTE).ge(survival);
            alive = alive.and_not(dies);
            path.scale(F::select(gambles, survival.recip(), F::one()));
        }
        path.depth = path.depth + F::Index::splat(1);
        Bounce { alive, shadow }
    }
}
