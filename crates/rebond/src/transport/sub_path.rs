//! Sub-paths: random walks from the eye and from the light, one function for both; in lanes, all of one length.
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
//! heuristic sums are of squares; what is kept of them is their root, so that all are ratios of densities.
//!
//! Densities leave Russian roulette out: weights need only be functions of the path that add up to 1. At mirrors and glass r and
//! p hold the same probability of a branch, which is left out of both.

use super::Roulette;
use crate::bsdf::{Bsdf, BsdfValue, TransportMode};
use crate::emitter::{Emission, EmitterHit, LightSampling};
use crate::math::{Rgb, Vec3};
use crate::render::{Dimensions, PathState};
use crate::sampling::Sampler;
use crate::scene::{Scene, Surface};
use rebond_bvh::{Hit, Ray, Trace};
use rebond_lanes::{Index, Mask, Real};
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
    /// Two densities together: their sum, or the root of that of their squares.
    #[inline(always)]
    pub fn sum<F: Real>(self, a: F, b: F) -> F {
        match self {
            Self::Balance => a + b,
            Self::Power => {
                // Squares of ratios, since those of densities may be beyond f32.
                let most = a.max(b);
                let ratio = (a.min(b) / most.max(F::splat(f32::MIN_POSITIVE))).min(F::one());
                most * (ratio * ratio + 1.0).sqrt()
            }
        }
    }

    /// The weight of a way, where all that take fewer vertices from one end have these densities over its own, and all that take
    /// fewer from the other end those.
    #[inline(always)]
    pub fn weight<F: Real>(self, others: [F; 2]) -> F {
        // The bound comes first, since it is what a NaN becomes.
        let [a, b] = others.map(|x| x.min(F::splat(1e18)));
        match self {
            Self::Balance => (a + 1.0 + b).recip(),
            Self::Power => (a * a + 1.0 + b * b).recip(),
        }
    }
}

/// Surface points of sub-paths.
#[derive(Clone, Copy, Debug)]
pub struct Vertex<'a, F: Real = f32> {
    /// Where; `wo` is the direction to the vertex before.
    pub surface: Surface<F>,
    /// How it scatters.
    pub bsdf: Bsdf<'a, F>,
    /// What light (or importance) that arrives here counts.
    pub throughput: Rgb<F>,
    /// A of this vertex.
    pub near: F,
    /// B of this vertex.
    pub far: F,
    /// Number of the [`Event`](crate::bsdf::Event) by which the walk went on.
    pub event: F::Index,
    /// Lanes whose walk came here.
    pub mask: F::Mask,
}

impl<F: Real> Vertex<'_, F> {
    /// Σ, for a walk from the other end that finds this vertex with density `found` and would go on with density `on`; in the
    /// terms of the heuristic.
    #[inline(always)]
    pub fn others(&self, heuristic: Heuristic, found: F, on: F) -> F {
        found * heuristic.sum(self.near, on * self.far)
    }

    /// |cosθ| of a direction at the geometric surface.
    #[inline(always)]
    pub fn cos(&self, w: Vec3<F>) -> F {
        self.surface.ng.dot(w).abs()
    }

    /// The BSDF from the vertex before to the direction `w`.
    #[inline(always)]
    pub fn eval(&self, w: Vec3<F>, mode: TransportMode, mask: F::Mask) -> BsdfValue<F> {
        self.bsdf.eval(self.surface.wo, w, mode, mask)
    }

    /// The same, and the density with which a walk from the other end would go on from there to the vertex before.
    #[inline(always)]
    pub fn eval_both_ways(&self, w: Vec3<F>, mode: TransportMode, mask: F::Mask) -> (BsdfValue<F>, F) {
        let (value, back) = self.bsdf.eval_both_ways(self.surface.wo, w, mode, mask);
        (value, back.0)
    }
}

/// The vertices of a walk but for its origin. They are large, so they are made where they stay, in memory that the next walk uses
/// again.
#[derive(Debug)]
pub struct Walk<'a, F: Real = f32> {
    vertices: Vec<Vertex<'a, F>>,
    len: usize,
}

impl<F: Real> Default for Walk<'_, F> {
    fn default() -> Self {
        Self { vertices: Vec::new(), len: 0 }
    }
}

impl<'a, F: Real> Walk<'a, F> {
    /// No vertices, as at first.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// One more, as [`SubPath::arrive`] has it, and those before it.
    #[inline(never)]
    pub fn arrive(
        &mut self,
        path: &mut SubPath<'a, F>,
        hit: &Hit<F>,
        u: &Dimensions<F>,
        mask: F::Mask,
    ) -> (&mut Vertex<'a, F>, &[Vertex<'a, F>]) {
        match self.vertices.get_mut(self.len) {
            Some(place) => path.meet(place, hit, u, mask),
            None => self.vertices.push(path.arrive(hit, u, mask)),
        }
        let (before, from_here) = self.vertices.split_at_mut(self.len);
        self.len += 1;
        (&mut from_here[0], before)
    }

    /// All vertices.
    pub fn vertices(&self) -> &[Vertex<'a, F>] {
        &self.vertices[..self.len]
    }
}

/// Where walks from the light begin.
#[derive(Clone, Copy, Debug)]
pub struct Source<F: Real = f32> {
    /// Which emitter.
    pub emitter: F::Index,
    /// Probability of its choice.
    pub probability: F,
    /// The ray that leaves it.
    pub emission: Emission<F>,
}

impl<F: Real> Source<F> {
    /// One of the emitters, and a ray from it, by the values of a start; `None` in a scene without light.
    pub fn draw(scene: &Scene, u: &Dimensions<F>, time: F, mask: F::Mask) -> Option<Self> {
        let (emitter, probability) = scene.light_sampler().source(|| u.value(SOURCE))?;
        let emission = scene.emitters().emit(emitter, time, u.pair(POSITION), u.pair(DIRECTION), mask);
        Some(Self { emitter, probability, emission })
    }
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

/// Walks under way: rays, and what they carry.
#[derive(Clone, Copy)]
pub struct SubPath<'a, F: Real = f32> {
    scene: &'a Scene,
    mode: TransportMode,
    heuristic: Option<Heuristic>,
    /// The ray under way.
    pub ray: Ray<F>,
    /// Where it started, on the surface itself.
    pub from: Vec3<F>,
    /// Shading normal there; zero at the eye and the light.
    pub normal: Vec3<F>,
    /// What the first ray counts, and what became of that since.
    start: Rgb<F>,
    carried: Rgb<F>,
    eta_squared: F,
    /// A of the next vertex, but for cosθ and d² there.
    pub near: F,
    /// B.
    pub far: F,
    /// Whether the ray is one of parallel ones, so that d² does not count.
    pub from_far: F::Mask,
    /// Whether the ray left in a direction that only its sampler finds.
    pub specular: F::Mask,
    /// Whether it left what is hidden from the eye, as points and beams are.
    pub hidden: F::Mask,
    /// Segments, the ray under way included.
    pub segments: u32,
    source: Option<Source<F>>,
}

/// Dimensions of the sample values of one bounce.
const BSDF_CHOICE: u32 = 2;
const BSDF_DIRECTION: u32 = 3;
const MIX_CHOICE: u32 = 4;
const ROULETTE: u32 = 5;
/// How many dimensions a bounce uses; the first two are free.
pub const PER_BOUNCE: u32 = 6;

impl<'a, F: Real> SubPath<'a, F> {
    /// From the eye, along camera rays. For each of its paths there are `light_paths` that may be connected to the eye. Without
    /// a heuristic nothing is made ready for weights.
    pub fn from_eye(scene: &'a Scene, heuristic: Option<Heuristic>, path: &PathState<F>, light_paths: f32) -> Self {
        let (camera, d, time) = (scene.camera(), path.direction(), path.time);
        let (mut near, mut far) = (F::zero(), F::zero());
        if heuristic.is_some() {
            near = camera.density(d, time).0.recip() * light_paths;
            if camera.has_lens() {
                far = near * camera.cos(d, time) / camera.lens_pdf(time).0;
            }
        }
        Self {
            scene,
            mode: TransportMode::Radiance,
            heuristic,
            ray: path.ray(),
            from: camera.lens_of(path.origin(), d, time),
            normal: Vec3::zero(),
            start: path.throughput(),
            carried: Rgb::white(),
            eta_squared: F::one(),
            near,
            far,
            from_far: F::Mask::splat(camera.is_parallel()),
            specular: F::Mask::splat(true),
            hidden: F::Mask::splat(false),
            segments: 1,
            source: None,
        }
    }

    /// From a light.
    pub fn from_light(scene: &'a Scene, heuristic: Option<Heuristic>, source: &Source<F>, time: F) -> Self {
        let (emitters, emission) = (scene.emitters(), &source.emission);
        let (position, direction) = (emission.pdf.position.0, emission.pdf.direction.0);
        let parallel = emitters.is_parallel::<F>(source.emitter);
        let (mut near, mut far) = (F::zero(), F::zero());
        let mut hidden = F::Mask::splat(scene.hides_emitters());
        if heuristic.is_some() {
            let cos = F::select(parallel, F::one(), emission.normal.dot(emission.d).abs());
            near = F::select(parallel, position, direction).recip();
            let hittable = emitters.is_hittable::<F>(source.emitter);
            far = F::select(hittable, cos / (position * direction * source.probability), F::zero());
            hidden = hidden | !hittable;
        }
        Self {
            scene,
            mode: TransportMode::Importance,
            heuristic,
            ray: emission.ray(time),
            from: emission.o,
            normal: Vec3::zero(),
            start: emission.weight * source.probability.recip(),
            carried: Rgb::white(),
            eta_squared: F::one(),
            near,
            far,
            from_far: parallel,
            specular: F::Mask::splat(false),
            hidden,
            segments: 1,
            source: Some(*source),
        }
    }

    /// Where the ray starts.
    pub fn origin(&self) -> Vec3<F> {
        let [x, y, z] = self.ray.o;
        Vec3 { x, y, z }
    }

    /// Its unit direction.
    pub fn direction(&self) -> Vec3<F> {
        let [x, y, z] = self.ray.d;
        Vec3 { x, y, z }
    }

    /// What the ray counts.
    pub fn throughput(&self) -> Rgb<F> {
        self.start * self.carried
    }

    /// Where the rays of `mask`, which meet something at the distance `met`, end for an eye that they come from: there, or farther if
    /// it sees no lights.
    #[inline(always)]
    pub fn end(&self, met: F, mask: F::Mask) -> F
    where
        F: Trace,
    {
        if self.scene.hides_emitters() && mask.any() { self.scene.see(&self.ray, mask).t } else { met }
    }

    /// The vertices that the rays of `mask` hit. Mixed materials draw one of their parts.
    #[inline(never)]
    pub fn arrive(&mut self, hit: &Hit<F>, u: &Dimensions<F>, mask: F::Mask) -> Vertex<'a, F> {
        self.vertex(hit, u, mask)
    }

    #[inline(always)]
    fn vertex(&mut self, hit: &Hit<F>, u: &Dimensions<F>, mask: F::Mask) -> Vertex<'a, F> {
        let surface = self.scene.surface(&self.ray, hit, mask);
        let bsdf = self.scene.bsdf(&surface, || u.value(MIX_CHOICE), mask);
        let (throughput, event) = (self.throughput(), F::Index::splat(0));
        self.come_to(&surface, bsdf.normal(), mask);
        Vertex { surface, bsdf, throughput, near: self.near, far: self.far, event, mask }
    }

    /// The same, made where it stays.
    #[inline(always)]
    fn meet(&mut self, at: &mut Vertex<'a, F>, hit: &Hit<F>, u: &Dimensions<F>, mask: F::Mask) {
        at.surface = self.scene.surface(&self.ray, hit, mask);
        at.bsdf = self.scene.bsdf(&at.surface, || u.value(MIX_CHOICE), mask);
        self.come_to(&at.surface, at.bsdf.normal(), mask);
        (at.throughput, at.near, at.far) = (self.throughput(), self.near, self.far);
        (at.event, at.mask) = (F::Index::splat(0), mask);
    }

    /// A and B at a surface.
    #[inline(always)]
    fn come_to(&mut self, surface: &Surface<F>, normal: Vec3<F>, mask: F::Mask) {
        if self.heuristic.is_some() {
            if let Some(source) = &self.source
                && self.segments == 1
            {
                self.near *= self.drawn(source, surface, normal, mask);
            }
            let per_cos = surface.ng.dot(surface.wo).abs().max(F::splat(f32::MIN_POSITIVE)).recip();
            let d2 = (surface.p - self.from).length_squared();
            self.near *= F::select(self.from_far, F::one(), d2) * per_cos;
            self.far *= per_cos;
        }
    }

    /// c_1: the density with which a surface draws the light's point, over that with which the walk began there.
    fn drawn(&self, source: &Source<F>, at: &Surface<F>, normal: Vec3<F>, mask: F::Mask) -> F {
        let (emitters, emitter) = (self.scene.emitters(), source.emitter);
        let choice = self.scene.light_sampler().probability(at.p, normal, emitter, mask) / source.probability;
        let placed = emitters.is_hittable::<F>(emitter).and_not(emitters.is_infinite::<F>(emitter));
        if placed.none() {
            return choice;
        }
        let (to, n) = (source.emission.o - at.p, source.emission.normal);
        let hit = EmitterHit { emitter, from: at.p, to, normal: n, time: self.ray.time };
        let drawn = emitters.pdf(&hit, LightSampling::Area, mask).to_area(to, n).0 / source.emission.pdf.position.0;
        choice * F::select(placed, drawn, F::one())
    }

    /// Goes on from vertices; the lanes whose walks do.
    #[inline(never)]
    pub fn scatter(&mut self, vertex: &mut Vertex<'a, F>, u: &Dimensions<F>, ending: &Ending) -> F::Mask {
        let (bsdf, wo, mask) = (&vertex.bsdf, vertex.surface.wo, vertex.mask);
        let next = bsdf.sample(wo, u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE), self.mode, mask);
        let mut alive = mask & next.weight.is_lit();
        if alive.none() {
            return alive;
        }
        self.carried *= next.weight;
        self.eta_squared *= next.eta * next.eta;
        if self.segments >= ending.rr_depth {
            let eta = if self.mode == TransportMode::Radiance { self.eta_squared } else { F::one() };
            let survival = ending.roulette.survival(ending.survival, next.weight, self.carried * eta);
            alive = alive.and_not(u.value(ROULETTE).ge(survival));
            if alive.none() {
                return alive;
            }
            self.carried = self.carried * survival.recip();
        }
        if let Some(h) = self.heuristic {
            let cos = vertex.cos(next.w);
            let per_pdf = next.pdf.0.recip();
            let back = bsdf.pdf(next.w, wo, self.mode.opposite(), alive.and_not(next.specular)).0;
            let far = cos * per_pdf * h.sum(self.near, back * self.far);
            self.far = F::select(next.specular, cos * self.far, far);
            self.near = F::select(next.specular, F::zero(), per_pdf);
        }
        vertex.event = bsdf.event(wo, next.w);
        (self.from, self.normal) = (vertex.surface.p, bsdf.normal());
        (self.ray.o, self.ray.d) = (vertex.surface.leave(next.w).array(), next.w.array());
        (self.from_far, self.specular) = (F::Mask::splat(false), next.specular);
        let hides = F::Mask::splat(self.scene.hides_emitters());
        self.hidden = hides & vertex.surface.is_emitter();
        self.segments += 1;
        alive
    }
}

/// The dimensions of bounces of walks from the light begin here.
const FIRST_OF_LIGHT: u32 = 1 << 16;

/// The sample values of the light's walks beside samples `index` of pixels: of their start (0) or one of their bounces. The
/// walks of one sample of all pixels share one sequence, so that together they leave the lights well spread.
#[inline(always)]
pub fn light_dimensions<F: Real>(sampler: &Sampler, pixel: F::Index, index: F::Index, number: u32) -> Dimensions<F> {
    let stream = sampler.without_rows().stream(index, pixel);
    Dimensions::new(stream, F::Index::splat(FIRST_OF_LIGHT + number), LIGHT_PER_BOUNCE)
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
