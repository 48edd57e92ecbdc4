//! Sub-paths: random walks from the eye and from the light, one function for both.
//!
//! A path x_0 … x_k can be found in many ways: its first vertices from one end, the rest from the other. From the end where
//! x_0 is, let p_i be the density (per area) with which a walk finds x_i after x_{i−1}, and r_i that of the walk from the other
//! end. All ways that take fewer vertices from this end than x_0 … x_i, their densities over that of the way at hand, add up to
//!
//! ```text
//! Σ_i = r_i (A_i + q_i B_i)
//! A_i = c_i / p_i                                      the way that connects x_{i−1} and x_i
//! B_i = cosθ_{i−1} / (d² p_i) · (A_{i−1} + q_{i−1} B_{i−1})     all shorter ones
//! ```
//!
//! where q_i is the density per solid angle with which the other walk would go on from x_i to x_{i−1}, known only when it is
//! known where that walk comes from. c_i is 1 where both ends of that edge scatter in more than single directions, else 0; c_1
//! is the density with which x_0 is drawn for connections, over p_0. So two numbers per vertex are all that multiple importance
//! sampling needs (Georgiev 2012, §4, where they are dVCM and dVC; the ratios are those of Veach 1997, §10.3). With the power
//! heuristic every density is squared, in sums too.
//!
//! Densities leave Russian roulette out: weights need only be functions of the path that add up to 1. At mirrors and glass r and
//! p hold the same probability of a branch, which is left out of both.

use super::Roulette;
use crate::bsdf::{Bsdf, TransportMode};
use crate::emitter::{Emission, EmitterHit, LightSampling};
use crate::math::{Rgb, Vec3};
use crate::render::{Dimensions, PathState};
use crate::scene::{Scene, Surface};
use rebond_bvh::{Hit, Ray};
use rebond_lanes::scalar::Index1;
use serde::{Deserialize, Serialize};

/// How the ways to find a path are weighed against each other (Veach 1997, §9.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Heuristic {
    /// By their densities.
    Balance,
    /// By the squares of their densities.
    #[default]
    Power,
}

impl Heuristic {
    /// A density, or a ratio of them, as it goes into weights.
    #[inline(always)]
    pub fn of(self, density: f32) -> f64 {
        let density = f64::from(density);
        match self {
            Self::Balance => density,
            Self::Power => density * density,
        }
    }
}

/// A surface point of a sub-path.
#[derive(Clone, Copy, Debug)]
pub struct Vertex<'a> {
    /// Where; `wo` is the direction to the vertex before.
    pub surface: Surface<f32>,
    /// How it scatters.
    pub bsdf: Bsdf<'a, f32>,
    /// What light (or importance) that arrives here counts.
    pub throughput: Rgb<f32>,
    /// A of this vertex.
    pub near: f64,
    /// B of this vertex.
    pub far: f64,
    /// Number of the [`Event`](crate::bsdf::Event) by which the walk went on.
    pub event: u32,
}

impl Vertex<'_> {
    /// Σ, for a walk from the other end that finds this vertex with density `found` and would go on with density `on`; in the
    /// terms of the heuristic.
    #[inline(always)]
    pub fn others(&self, heuristic: Heuristic, found: f32, on: f32) -> f64 {
        heuristic.of(found) * (self.near + heuristic.of(on) * self.far)
    }

    /// |cosθ| of a direction at the geometric surface.
    #[inline(always)]
    pub fn cos(&self, w: Vec3<f32>) -> f32 {
        self.surface.ng.dot(w).abs()
    }
}

/// Where the walk from the light began.
#[derive(Clone, Copy, Debug)]
struct Source {
    emitter: u32,
    /// Probability of its choice.
    probability: f32,
    emission: Emission,
}

/// When and how walks end by chance.
#[derive(Clone, Copy, Debug)]
pub struct Ending {
    /// The roulette.
    pub roulette: Roulette,
    /// The most that survival may be.
    pub survival: f32,
    /// Segments after which it begins.
    pub rr_depth: u32,
}

/// A walk under way: a ray, and what it carries.
#[derive(Clone, Copy)]
pub struct SubPath<'a> {
    scene: &'a Scene,
    mode: TransportMode,
    heuristic: Option<Heuristic>,
    /// The ray under way.
    pub ray: Ray<f32>,
    /// Where it started, on the surface itself.
    pub from: Vec3<f32>,
    /// Shading normal there; zero at the eye and the light.
    pub normal: Vec3<f32>,
    /// What the first ray counts, and what became of that since.
    start: Rgb<f32>,
    carried: Rgb<f32>,
    eta_squared: f32,
    /// A and B of the next vertex, but for cosθ and d² there.
    pub near: f64,
    /// B.
    pub far: f64,
    /// Whether the ray comes from infinitely far, so that d² does not count.
    pub from_far: bool,
    /// Whether the ray left in a direction that only its sampler finds.
    pub specular: bool,
    /// Segments, the ray under way included.
    pub segments: u32,
    source: Option<Source>,
}

/// Dimensions of the sample values of one bounce.
const BSDF_CHOICE: u32 = 2;
const BSDF_DIRECTION: u32 = 3;
const MIX_CHOICE: u32 = 4;
const ROULETTE: u32 = 5;
/// How many dimensions a bounce uses; the first two are free.
pub const PER_BOUNCE: u32 = 6;

impl<'a> SubPath<'a> {
    /// From the eye, along a camera ray. For each of its paths there are `light_paths` that may be connected to the eye. Without
    /// a heuristic nothing is made ready for weights.
    pub fn from_eye(scene: &'a Scene, heuristic: Option<Heuristic>, path: &PathState<f32>, light_paths: f32) -> Self {
        let (camera, d) = (scene.camera(), path.direction());
        let (mut near, mut far) = (0.0, 0.0);
        if let Some(h) = heuristic {
            let each = light_paths / camera.density(d, path.time).0;
            near = h.of(each);
            if camera.has_lens() {
                far = h.of(each * camera.cos(d, path.time) / camera.lens_pdf(path.time).0);
            }
        }
        Self {
            scene,
            mode: TransportMode::Radiance,
            heuristic,
            ray: path.ray(),
            from: path.origin(),
            normal: Vec3::zero(),
            start: path.throughput(),
            carried: Rgb::white(),
            eta_squared: 1.0,
            near,
            far,
            from_far: camera.is_parallel(),
            specular: true,
            segments: 1,
            source: None,
        }
    }

    /// From a light, which was chosen with this probability.
    pub fn from_light(
        scene: &'a Scene,
        heuristic: Option<Heuristic>,
        emitter: u32,
        probability: f32,
        emission: &Emission,
        time: f32,
    ) -> Self {
        let emitters = scene.emitters();
        let (position, direction) = (emission.pdf.position.0, emission.pdf.direction.0);
        let infinite = emitters.is_infinite(emitter);
        let (mut near, mut far) = (0.0, 0.0);
        if let Some(h) = heuristic {
            let (cos, next) =
                if infinite { (1.0, position) } else { (emission.normal.dot(emission.d).abs(), direction) };
            near = h.of(1.0 / next);
            if emitters.is_hittable(emitter) {
                far = h.of(cos / (position * direction * probability));
            }
        }
        Self {
            scene,
            mode: TransportMode::Importance,
            heuristic,
            ray: emission.ray(time),
            from: emission.o,
            normal: Vec3::zero(),
            start: emission.weight * (1.0 / probability),
            carried: Rgb::white(),
            eta_squared: 1.0,
            near,
            far,
            from_far: infinite,
            specular: false,
            segments: 1,
            source: Some(Source { emitter, probability, emission: *emission }),
        }
    }

    /// Where the ray starts.
    pub fn origin(&self) -> Vec3<f32> {
        Vec3::splat(self.ray.o)
    }

    /// Its unit direction.
    pub fn direction(&self) -> Vec3<f32> {
        Vec3::splat(self.ray.d)
    }

    /// What the ray counts.
    pub fn throughput(&self) -> Rgb<f32> {
        self.start * self.carried
    }

    /// The vertex that the ray hit. Mixed materials draw one of their parts.
    pub fn arrive(&mut self, hit: &Hit<f32>, u: &Dimensions<f32>) -> Vertex<'a> {
        let surface = self.scene.surface(&self.ray, hit, true);
        let bsdf = self.scene.bsdf(&surface, || u.value(MIX_CHOICE), true);
        if let Some(h) = self.heuristic {
            if let Some(source) = &self.source
                && self.segments == 1
            {
                self.near *= h.of(self.drawn(source, &surface, bsdf.normal()));
            }
            let per_cos = h.of(1.0 / surface.ng.dot(surface.wo).abs().max(f32::MIN_POSITIVE));
            if !self.from_far {
                self.near *= h.of((surface.p - self.from).length_squared());
            }
            self.near *= per_cos;
            self.far *= per_cos;
        }
        let (near, far) = (self.near, self.far);
        Vertex { surface, bsdf, throughput: self.throughput(), near, far, event: 0 }
    }

    /// c_1: the density with which a surface draws the light's point, over that with which the walk began there.
    fn drawn(&self, source: &Source, at: &Surface<f32>, normal: Vec3<f32>) -> f32 {
        let (emitters, emitter) = (self.scene.emitters(), Index1(source.emitter));
        let asked = self.scene.light_sampler().probability(at.p, normal, emitter, true);
        let choice = asked / source.probability;
        if emitters.is_infinite(source.emitter) || !emitters.is_hittable(source.emitter) {
            return choice;
        }
        let (to, n) = (source.emission.o - at.p, source.emission.normal);
        let hit = EmitterHit { emitter, from: at.p, to, normal: n, time: self.ray.time };
        let drawn = emitters.pdf(&hit, LightSampling::Area, true).to_area(to, n);
        choice * drawn.0 / source.emission.pdf.position.0
    }

    /// Goes on from a vertex; whether the walk does.
    pub fn scatter(&mut self, vertex: &mut Vertex<'a>, u: &Dimensions<f32>, ending: &Ending) -> bool {
        let (bsdf, wo) = (&vertex.bsdf, vertex.surface.wo);
        let next = bsdf.sample(wo, u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE), self.mode, true);
        if !next.weight.is_lit() {
            return false;
        }
        self.carried *= next.weight;
        self.eta_squared *= next.eta * next.eta;
        if self.segments >= ending.rr_depth {
            let eta = if self.mode == TransportMode::Radiance { self.eta_squared } else { 1.0 };
            let survival = ending.roulette.survival(ending.survival, next.weight, self.carried * eta);
            if u.value(ROULETTE) >= survival {
                return false;
            }
            self.carried = self.carried * (1.0 / survival);
        }
        if let Some(h) = self.heuristic {
            let cos = vertex.cos(next.w);
            if next.specular {
                (self.near, self.far) = (0.0, h.of(cos) * self.far);
            } else {
                let back = bsdf.eval(next.w, wo, opposite(self.mode), true).pdf.0;
                let pdf = next.pdf.0;
                self.far = h.of(cos / pdf) * (self.near + h.of(back) * self.far);
                self.near = h.of(1.0 / pdf);
            }
        }
        vertex.event = bsdf.event(wo, next.w).0;
        (self.from, self.normal) = (vertex.surface.p, bsdf.normal());
        (self.ray.o, self.ray.d) = (vertex.surface.leave(next.w).array(), next.w.array());
        (self.from_far, self.specular) = (false, next.specular);
        self.segments += 1;
        true
    }
}

/// What the walk from the other end carries.
fn opposite(mode: TransportMode) -> TransportMode {
    match mode {
        TransportMode::Radiance => TransportMode::Importance,
        TransportMode::Importance => TransportMode::Radiance,
    }
}

/// The dimensions of bounces of walks from the light begin here.
const FIRST_OF_LIGHT: u32 = 1 << 16;

/// The sample values of the light's walk beside sample `index` of a pixel: of its start (0) or one of its bounces. The walks
/// of one sample of all pixels share one sequence, so that together they leave the lights well spread.
pub fn light_dimensions(sampler: &crate::sampling::Sampler, pixel: u32, index: u32, number: u32) -> Dimensions<f32> {
    let stream = sampler.stream(Index1(index), Index1(pixel));
    Dimensions::new(stream, Index1(FIRST_OF_LIGHT + number), LIGHT_PER_BOUNCE)
}

/// Of those: through which point of the lens a vertex is seen, and which pixel gets it.
pub const LENS: u32 = 6;
/// Which of the pixels whose filters reach it.
pub const PIXEL: u32 = 7;
const LIGHT_PER_BOUNCE: u32 = 8;
/// At the start: the light, its point, its direction, and the moment.
pub const SOURCE: u32 = 0;
/// Its point.
pub const POSITION: u32 = 1;
/// Its direction.
pub const DIRECTION: u32 = 2;
/// The moment of the shutter.
pub const MOMENT: u32 = 3;
