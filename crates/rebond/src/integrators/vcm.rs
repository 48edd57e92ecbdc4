//! Vertex connection and merging (Georgiev, Křivánek, Davidovič, Slusallek 2012; Hachisuka, Pantaleoni, Jensen 2012). Without bias in
//! the limit: the radius shrinks from sample to sample (Knaus and Zwicker 2011).
//!
//! Bidirectional path tracing finds a path of k + 1 vertices by connecting x_i and x_{i+1}, one from the eye and one from the light.
//! Merging adds one way for each vertex between the ends: both walks come to x_i, within r of each other, and are taken for one.
//! A light's walk then serves every eye that comes by, N of them in an iteration:
//!
//! ```text
//! C = α_y f_r(z; ω_y, ω_z) α_z / (π r² N)        y of any light's walk, |y − z| < r
//! p_merge = p(y_0 … y) p(z … z_0) η              η = N π r²
//! ```
//!
//! so merging at x_i has η r_i times the density of the way that connects x_i, found from here, to its neighbour from there; r_i is
//! the density with which the other end finds x_i. In the sums of `transport/sub_path.rs`,
//!
//! ```text
//! Σ_i = r_i (A_i + q_i B_i)        A_i = c_i / p_i + η        where x_i scatters in more than single directions
//! w_merge = 1 / ((A_y + q_y B_y) / η + (A_z + q_z B_z) / η − 1)
//! ```
//!
//! and B carries it on by itself: nothing else changes (Georgiev 2012, §4, has a third number, dVM, for what is here a part of A
//! and B). With the power heuristic these are sums of squares, η is squared as all densities are.
//!
//! | `mode` | ways |
//! |---|---|
//! | `vcm` | all |
//! | `bidirectional` | connections: the integrator of that name |
//! | `merging` | merging at every vertex, and light that the eye meets: bidirectional photon mapping (Vorba 2011) |
//! | `photon` | merging at the first vertex that neither mirrors nor is glass, of weight 1: progressive photon mapping |
//! | `light` | connections to the lens, of weight 1: light tracing |
//!
//! Pixels go in bands of up to 1024 tiles, each with the walks of its own pixels. Of these only the particles stay until the band is
//! done, some 100 bytes for each vertex of up to 2¹⁸ walks, whatever the size of the picture: for connections a walk is
//! traced again beside the eye's, by the same sample values.

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::film::Film;
use crate::math::Vec3;
use crate::render::{
    Dimensions, Engine, Integrator, Observer, Pass, PathClasses, PathState, Rays, Samples, ShadowRay, Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, LENS, MOMENT, PER_BOUNCE, PIXEL, light_dimensions};
use crate::transport::{
    Connection, Heuristic, Neighbours, Particle, PointGrid, Roulette, Sheets, Source, SubPath, Vertex, first_radius,
    see, see_source, shrunk,
};
use rebond_bvh::{Ray, Trace};
use rebond_lanes::scalar::Index1;
use rebond_lanes::{F32x16, Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::num::NonZeroU32;
use std::ops::Range;
use std::sync::Mutex;

/// Which ways to find a path are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VcmMode {
    /// All.
    #[default]
    Vcm,
    /// Connections.
    Bidirectional,
    /// Merging at every vertex.
    Merging,
    /// Merging at the first vertex that it can be done at.
    Photon,
    /// Connections to the lens.
    Light,
}

/// Settings of vertex connection and merging.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VcmSettings {
    /// Which ways to find a path are used.
    pub mode: VcmMode,
    /// The first radius; 0.3 % of half the diagonal of the scene if not given.
    pub radius: Option<f32>,
    /// How much of the square of the radius a sample leaves.
    pub alpha: f32,
    /// Longest path in segments: 1 is emitted light only, 2 direct light too. Unlimited if not given.
    pub max_depth: Option<NonZeroU32>,
    /// Segments of either walk after which Russian roulette begins.
    pub rr_depth: u32,
    /// How walks end.
    pub roulette: Roulette,
    /// Survival probability, or the most it may be.
    pub survival: f32,
    /// How the ways to find a path are weighed.
    pub heuristic: Heuristic,
}

impl Default for VcmSettings {
    fn default() -> Self {
        Self {
            mode: VcmMode::default(),
            radius: None,
            alpha: 0.75,
            max_depth: None,
            rr_depth: 5,
            roulette: Roulette::default(),
            survival: 0.95,
            heuristic: Heuristic::default(),
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("mode", "ways to find a path: vcm, bidirectional, merging, photon or light; vcm"),
    ("radius", "the first radius of merging; 0.3 % of half the diagonal of the scene"),
    ("alpha", "how slowly the radius shrinks, between 0 and 1; 0.75"),
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("rr_depth", "segments of either walk after which Russian roulette begins; 5"),
    ("roulette", "how walks end: none, constant, albedo or throughput; throughput"),
    ("survival", "probability of survival (constant), or the most it may be; 0.95"),
    ("heuristic", "how the ways to find a path are weighed: balance or power; power"),
];

impl VcmSettings {
    pub(super) fn leaves_out(&self) -> Option<String> {
        let by_depth = self.max_depth.map(|d| format!("paths of more than max_depth={d} segments are left out"));
        let by_mode = match self.mode {
            VcmMode::Light => Some("what the eye sees in mirrors and glass is left out, unless the camera has a lens"),
            VcmMode::Bidirectional => None,
            _ => Some("light is blurred by a radius that shrinks with every sample"),
        };
        let all: Vec<String> = by_depth.into_iter().chain(by_mode.map(String::from)).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

/// Tiles of a band at most.
const BAND: u64 = 1024;

/// Dimensions of the sample values that a bounce of the eye's walk uses for its light.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;

/// What the samples of a band share.
#[derive(Clone, Copy)]
struct Now {
    moment: f32,
    /// Light's walks for each of the eye's: over the picture, for connections to the lens.
    light_paths: f32,
    radius: f32,
    /// 1 / (π r² N).
    scale: f32,
    /// η; 0 if nothing is merged.
    eta: f32,
}

/// What a worker keeps from sample to sample.
struct Work<'a, F: Real> {
    sampler: Sampler,
    now: Now,
    /// Vertices of the light's walks, without their origins.
    light: Vec<Vertex<'a, F>>,
    neighbours: Neighbours,
    sheets: Sheets<'a, F>,
    rays: Rays,
}

/// The estimator at work.
pub struct Vcm<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    mode: VcmMode,
    first_radius: f32,
    alpha: f32,
    max_depth: u32,
    ending: Ending,
    heuristic: Heuristic,
}

impl<'a> Vcm<'a> {
    pub(super) fn new(
        settings: &VcmSettings,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
    ) -> Result<Self, IntegratorError> {
        let VcmSettings { mode, radius, alpha, max_depth, rr_depth, roulette, survival, heuristic } = *settings;
        super::check_ending(roulette, survival, max_depth)?;
        super::check_radius(radius, alpha)?;
        let first_radius = radius.unwrap_or_else(|| first_radius(scene));
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        let ending = Ending { roulette, survival, rr_depth };
        Ok(Self { scene, sampler, engine, mode, first_radius, alpha, max_depth, ending, heuristic })
    }

    fn connects(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Bidirectional)
    }

    fn merges(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Merging | VcmMode::Photon)
    }

    /// The weight of a way, as [`Heuristic::weight`] has it, if there are others.
    #[inline(always)]
    fn weight<F: Real>(&self, others: [F; 2]) -> F {
        match self.mode {
            VcmMode::Photon | VcmMode::Light => F::one(),
            _ => self.heuristic.weight(others),
        }
    }

    /// A ray is about to leave: the way that would connect its ends, if that is none of those used.
    #[inline(always)]
    fn leave<F: Real>(&self, path: &mut SubPath<'a, F>) {
        if !self.connects() {
            path.near = F::zero();
        }
    }

    /// A walk is at vertices where another may be merged with it: that way is one more from now on.
    #[inline(always)]
    fn may_merge<F: Real>(&self, path: &mut SubPath<'a, F>, vertex: &mut Vertex<'a, F>, now: &Now) {
        if now.eta > 0.0 {
            let with = self.heuristic.sum(path.near, F::splat(now.eta));
            path.near = F::select(vertex.bsdf.is_specular(), path.near, with);
            vertex.near = path.near;
        }
    }

    /// Draws the walks from the light; `each` is told of every ray, with what it hits, and of every vertex.
    fn light_walk<F: Trace>(
        &self,
        samples: &Samples<F>,
        work: &mut Work<'a, F>,
        begin: impl FnOnce(&Source<F>, &Dimensions<F>, F, &mut Work<'a, F>),
        crosses: impl Fn(&SubPath<'a, F>, F, &Dimensions<F>, F::Mask, &mut Work<'a, F>),
        mut each: impl FnMut(&mut Vertex<'a, F>, &mut SubPath<'a, F>, &Dimensions<F>, &mut Work<'a, F>),
    ) {
        let (scene, sampler, now) = (self.scene, work.sampler, work.now);
        let dimensions = |number| light_dimensions::<F>(&sampler, samples.pixel, samples.index, number);
        let u = dimensions(0);
        let time = scene.camera().time(F::splat(now.moment));
        let Some(source) = Source::draw(scene, &u, time, samples.mask) else { return };
        begin(&source, &u, time, work);
        let mut path = SubPath::from_light(scene, Some(self.heuristic), &source, time);
        let mut alive = samples.mask & source.emission.weight.is_lit();
        // Only through the lens do the longest paths have all their segments from here.
        let longest = if scene.camera().has_lens() { self.max_depth } else { self.max_depth - 1 };
        while alive.any() && path.segments <= longest {
            self.leave(&mut path);
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, false);
            let u = dimensions(path.segments);
            crosses(&path, hit.t, &u, alive, work);
            alive = alive & is_hit(&hit);
            if alive.none() || path.segments >= self.max_depth {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, alive);
            each(&mut vertex, &mut path, &u, work);
            alive = path.scatter(&mut vertex, &u, &self.ending);
        }
    }

    /// From the light, for any eye: t = 1 and t = 0 on the way, particles kept.
    fn emit<F: Trace>(&self, samples: &Samples<F>, particles: &mut Vec<Particle>, work: &mut Work<'a, F>) {
        let to_lens = self.connects() || self.mode == VcmMode::Light;
        let numbers = |u: &Dimensions<F>| [u.pair(LENS), u.pair(PIXEL)];
        let now = work.now;
        self.light_walk(
            samples,
            work,
            |source, u, time, work| {
                if to_lens {
                    self.connect_source(source, numbers(u), time, samples.mask, work);
                }
            },
            |path, end, u, alive, work| {
                if to_lens && self.scene.camera().has_lens() {
                    self.cross_lens(path, end, u.pair(PIXEL), alive, work);
                }
            },
            |vertex, path, u, work| {
                if self.merges() {
                    // Without the merging here, which is taken into account where it is done.
                    let kept = vertex.mask.and_not(vertex.bsdf.is_specular());
                    Particle::keep(vertex, path.segments, kept, |_, particle| particles.push(particle));
                }
                self.may_merge(path, vertex, &now);
                if to_lens {
                    self.connect_to_lens(vertex, numbers(u), path.ray.time, work);
                }
            },
        );
    }

    /// The same walks again, their vertices kept.
    fn walk_beside<F: Trace>(&self, samples: &Samples<F>, work: &mut Work<'a, F>) {
        let now = work.now;
        let mut light = std::mem::take(&mut work.light);
        light.clear();
        // The last vertex has not been left yet when it is kept, but nobody asks how it was.
        let rays = std::mem::take(&mut work.rays);
        self.light_walk(
            samples,
            work,
            |_, _, _, _| (),
            |_, _, _, _, _| (),
            |vertex, path, _, _| {
                self.may_merge(path, vertex, &now);
                light.push(*vertex);
            },
        );
        (work.light, work.rays) = (light, rays);
    }

    /// s = 1, t = 1.
    fn connect_source<F: Trace>(
        &self,
        source: &Source<F>,
        [lens, pixel]: [[F; 2]; 2],
        time: F,
        mask: F::Mask,
        work: &mut Work<'a, F>,
    ) {
        let Some(seen) = see_source(self.scene, source, lens, time, mask) else { return };
        let infinite = self.scene.emitters().is_infinite::<F>(source.emitter);
        let drawn = &source.emission.pdf;
        let here = F::select(infinite, drawn.direction.0, drawn.position.0) * source.probability;
        let by_eye = seen.sight.importance * seen.cos / (here * work.now.light_paths);
        let weight = self.weight([by_eye, seen.pdf * seen.sight.found]);
        let connection = seen.connection(PathClasses::start::<F>(), None, weight);
        work.sheets.connect_to_lens(&connection, (seen.sight.raster, pixel), seen.mask);
    }

    /// t = 1.
    fn connect_to_lens<F: Trace>(
        &self,
        vertex: &Vertex<'a, F>,
        [lens, pixel]: [[F; 2]; 2],
        time: F,
        work: &mut Work<'a, F>,
    ) {
        let Some(seen) = see(self.scene, vertex, lens, time) else { return };
        let (h, sight) = (self.heuristic, seen.sight);
        let back = vertex.pdf_back(sight.w, TransportMode::Radiance, seen.mask);
        let by_eye = vertex.others(h, sight.importance * seen.cos / F::splat(work.now.light_paths), back);
        let weight = self.weight([by_eye, seen.pdf * sight.found]);
        let connection = seen.connection(PathClasses::start::<F>(), None, weight);
        work.sheets.connect_to_lens(&connection, (sight.raster, pixel), seen.mask);
    }

    /// t = 0: light crosses the lens before it meets anything at distance `end`.
    fn cross_lens<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        end: F,
        pixel: [F; 2],
        alive: F::Mask,
        work: &mut Work<'a, F>,
    ) {
        let (camera, h, time) = (self.scene.camera(), self.heuristic, path.ray.time);
        let crossing = camera.crossing(path.origin(), path.direction(), time);
        let mut mask = alive & crossing.mask & crossing.free.lt(end);
        if self.mode == VcmMode::Light {
            // Where nothing else would find it.
            mask = mask & path.specular;
        }
        if mask.none() {
            return;
        }
        let (g, lens) = (camera.density(path.direction(), time).0, camera.lens_pdf(time).0);
        let per_cos = crossing.cos.recip();
        let light = path.throughput() * (g * lens * per_cos);
        let near = path.near * F::select(path.from_far, F::one(), crossing.t * crossing.t);
        let by_eye = lens * per_cos * h.sum(near, path.far * (g / F::splat(work.now.light_paths)));
        let (weight, at) = (self.weight([by_eye, F::zero()]), (crossing.raster, pixel));
        work.sheets.splat(PathClasses::start::<F>(), None, at, light, weight, mask);
    }

    /// The walks from the eye, connected and merged at every vertex.
    fn eye_walk<F: Trace>(&self, samples: &Samples<F>, grid: &PointGrid<Particle>, work: &mut Work<'a, F>) {
        let (scene, now) = (self.scene, work.now);
        let Samples { x, y, pixel, index, slot, mask } = *samples;
        let moment = Some(F::splat(now.moment));
        let eye = PathState::start_at(scene, &work.sampler, [x, y], pixel, index, slot, moment);
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), &eye, now.light_paths);
        if !self.connects() {
            path.far = F::zero();
        }
        let mut alive = mask;
        while alive.any() {
            self.leave(&mut path);
            let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, path.segments == 1);
            let found = alive & is_hit(&hit);
            self.escape(&path, alive.and_not(found), work);
            if found.none() {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, found);
            self.hit_light(&path, &vertex, work);
            if path.segments >= self.max_depth {
                return;
            }
            let diffuse = found.and_not(vertex.bsdf.is_specular());
            if diffuse.any() {
                if self.merges() {
                    self.merge(&path, &vertex, diffuse, grid, work);
                }
                self.may_merge(&mut path, &mut vertex, &now);
                if self.connects() {
                    self.ask_light(&path, &vertex, &u, diffuse, work);
                    self.connect_walks(&path, &vertex, diffuse, work);
                }
            }
            if self.mode == VcmMode::Photon {
                vertex.mask = found.and_not(diffuse);
                if vertex.mask.none() {
                    return;
                }
            }
            alive = path.scatter(&mut vertex, &u, &self.ending);
        }
    }

    /// s = 0: the surroundings.
    fn escape<F: Trace>(&self, path: &SubPath<'a, F>, mask: F::Mask, work: &mut Work<'a, F>) {
        if mask.none() {
            return;
        }
        let (scene, h, w) = (self.scene, self.heuristic, path.direction());
        for (number, environment) in &scene.emitters().environments {
            let (radiance, pdf) = environment.eval(w);
            let emitter = F::Index::splat(*number);
            let source = scene.light_sampler().source_probability::<F>(emitter);
            let position = scene.emitters().emission_pdf(emitter, path.ray.time, Vec3::zero(), -w, mask).position.0;
            let drawn = match path.segments {
                // The eye draws no points of lights; parallel rays of it meet none that light draws.
                1 if scene.camera().is_parallel() => F::zero(),
                1 => source,
                _ => scene.light_sampler().probability(path.from, path.normal, emitter, mask),
            };
            let by_light = pdf.0 * h.sum(drawn * path.near, source * position * path.far);
            let weight = self.weight([by_light, F::zero()]);
            let light = path.throughput() * radiance;
            work.sheets.add(PathClasses::start::<F>(), None, light, weight, mask & radiance.is_lit());
        }
    }

    /// s = 0: a surface that shines.
    fn hit_light<F: Trace>(&self, path: &SubPath<'a, F>, vertex: &Vertex<'a, F>, work: &mut Work<'a, F>) {
        let (scene, h, surface) = (self.scene, self.heuristic, &vertex.surface);
        let radiance = scene.emitted(surface, vertex.mask);
        let lit = vertex.mask & radiance.is_lit();
        if lit.none() {
            return;
        }
        let (emitters, choice) = (scene.emitters(), scene.light_sampler());
        let source = choice.source_probability::<F>(surface.emitter);
        let pdf = emitters.emission_pdf(surface.emitter, surface.time, surface.ng, surface.wo, lit);
        let drawn = if path.segments == 1 {
            source * pdf.position.0
        } else {
            let hit = surface.seen_from(path.from);
            choice.probability(path.from, path.normal, surface.emitter, lit)
                * emitters.pdf(&hit, LightSampling::Area, lit).to_area(hit.to, hit.normal).0
        };
        let by_light = h.sum(drawn * vertex.near, source * pdf.position.0 * pdf.direction.0 * vertex.far);
        let weight = self.weight([by_light, F::zero()]);
        work.sheets.add(PathClasses::start::<F>(), None, vertex.throughput * radiance, weight, lit);
    }

    /// s = 1: a point of a light, drawn for this vertex.
    fn ask_light<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        vertex: &Vertex<'a, F>,
        u: &Dimensions<F>,
        mask: F::Mask,
        work: &mut Work<'a, F>,
    ) {
        let (scene, h, surface, bsdf) = (self.scene, self.heuristic, &vertex.surface, &vertex.bsdf);
        let choice = || u.value(LIGHT_CHOICE);
        let Some((emitter, choice)) = scene.light_sampler().sample(surface.p, bsdf.normal(), choice, mask) else {
            return;
        };
        let (place, time) = (u.pair(LIGHT_POINT), path.ray.time);
        let light = scene.emitters().sample(emitter, surface.p, time, LightSampling::Area, place, mask);
        let value = vertex.eval(light.wi, TransportMode::Radiance, mask);
        let brings = value.f * light.weight * (bsdf.normal().dot(light.wi).abs() / choice);
        let contribution = vertex.throughput * brings;
        let event = F::Index::splat(0);
        let Some(shadow) = ShadowRay::new(surface, &light, time, contribution, event, mask) else { return };
        // What is not drawn, as the place of a point, has the density 1 here and there.
        let hittable = light.pdf.0.gt(F::zero());
        let to = light.point - surface.p;
        let by_area = F::select(light.infinite, light.pdf.0, light.pdf.to_area(to, light.normal).0);
        let drawn = F::select(hittable, by_area, F::one());
        let source = scene.light_sampler().source_probability::<F>(emitter);
        let pdf = scene.emitters().emission_pdf(emitter, time, light.normal, -light.wi, shadow.mask);
        let distance = F::select(light.infinite, F::one(), to.length_squared());
        let found = source * pdf.position.0 * pdf.direction.0 * vertex.cos(light.wi) / (distance * choice * drawn);
        let back = vertex.pdf_back(light.wi, TransportMode::Importance, shadow.mask);
        let by_eye = F::select(hittable, value.pdf.0 / (choice * light.pdf.0), F::zero());
        let weight = h.weight([by_eye, vertex.others(h, found, back)]);
        let state = PathClasses::start::<F>();
        let connection = Connection { ray: shadow.ray, light: contribution, weight, state, strategy: None };
        work.sheets.connect(&connection, shadow.mask);
    }

    /// s ≥ 2 and t ≥ 2: to every vertex of the light's walk beside.
    fn connect_walks<F: Trace>(&self, path: &SubPath<'a, F>, z: &Vertex<'a, F>, mask: F::Mask, work: &mut Work<'a, F>) {
        let h = self.heuristic;
        // Segments: those of the eye's walk, the connection, and s − 1 of the light's.
        let most = (self.max_depth - path.segments - 1) as usize;
        for y in &work.light[..work.light.len().min(most)] {
            let mask = mask & y.mask.and_not(y.bsdf.is_specular());
            if mask.none() {
                continue;
            }
            let across = y.surface.p - z.surface.p;
            let d2 = across.length_squared();
            let w = across * d2.sqrt().recip();
            let at_z = z.eval(w, TransportMode::Radiance, mask);
            let mask = mask & at_z.f.is_lit();
            if mask.none() {
                continue;
            }
            let at_y = y.eval(-w, TransportMode::Importance, mask);
            let cosines = (z.bsdf.normal().dot(w) * y.bsdf.normal().dot(w)).abs();
            let light = z.throughput * at_z.f * at_y.f * y.throughput * (cosines / d2);
            let mask = mask & light.is_lit();
            if mask.none() {
                continue;
            }
            let o = z.surface.leave(w);
            let d = y.surface.leave(-w) - o;
            let ray = Ray { o: o.array(), d: d.array(), tmax: F::one(), time: path.ray.time };
            let back_z = z.pdf_back(w, TransportMode::Importance, mask);
            let back_y = y.pdf_back(-w, TransportMode::Radiance, mask);
            let by_eye = y.others(h, at_z.pdf.0 * y.cos(w) / d2, back_y);
            let by_light = z.others(h, at_y.pdf.0 * z.cos(w) / d2, back_z);
            let (weight, state) = (h.weight([by_eye, by_light]), PathClasses::start::<F>());
            work.sheets.connect(&Connection { ray, light, weight, state, strategy: None }, mask);
        }
    }

    /// Merging: with every particle within the radius. A of neither walk has the merging here in it yet.
    fn merge<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        z: &Vertex<'a, F>,
        mask: F::Mask,
        grid: &PointGrid<Particle>,
        work: &mut Work<'a, F>,
    ) {
        let (h, now, longest) = (self.heuristic, work.now, self.max_depth - path.segments);
        let (sheets, per_eta) = (&mut work.sheets, F::splat(now.eta.recip()));
        work.neighbours.each(grid, z.surface.p, longest, mask, |y| {
            let (reflected, pdf) = y.reflected(z);
            let light = z.throughput * reflected * F::splat(now.scale);
            let lit = y.mask & light.is_lit();
            if lit.none() {
                return;
            }
            let back = z.pdf_back(y.w, TransportMode::Importance, lit);
            let by_eye = h.sum(y.sums[0], pdf * y.sums[1]) * per_eta;
            let by_light = h.sum(z.near, back * z.far) * per_eta;
            let weight = self.weight([by_eye, by_light]);
            sheets.add(PathClasses::start::<F>(), None, light, weight, lit);
        });
    }

    fn work<F: Trace>(&'a self, tiles: &Tiles<'_>, pass: &Pass, now: Now) -> Work<'a, F> {
        Work {
            sampler: tiles.sampler(&self.sampler),
            now,
            light: Vec::new(),
            neighbours: Neighbours::default(),
            sheets: Sheets::new(None, self.scene, pass.region, 0),
            rays: Rays::default(),
        }
    }

    /// One sample of each pixel of these tiles.
    fn band<F: Trace>(
        &self,
        tiles: Range<u64>,
        now: Now,
        grid: &mut PointGrid<Particle>,
        (film, pass, observer): (&Mutex<Film>, &Pass, &dyn Observer),
    ) -> Rays {
        // From the lights.
        let particles = Mutex::new(Vec::new());
        let traced = Mutex::new(Rays::default());
        Tiles::only(film, pass, observer, tiles.clone()).run(|tiles| {
            let mut work = self.work::<F>(tiles, pass, now);
            while let Some(tile) = tiles.next() {
                let mut own = Vec::new();
                for samples in tiles.lanes_of::<F>(&tile) {
                    self.emit(&samples, &mut own, &mut work);
                    work.sheets.end_samples(samples.slot, samples.mask, tile.weight, &mut work.rays);
                }
                tiles.splat(&tile, work.sheets.splats());
                work.sheets.clear();
                particles.lock().unwrap_or_else(|e| e.into_inner()).push((tiles.number(&tile), own));
            }
            traced.lock().unwrap_or_else(|e| e.into_inner()).merge(&work.rays);
        });
        let mut rays = traced.into_inner().unwrap_or_else(|e| e.into_inner());
        if observer.should_stop() {
            return rays;
        }
        let mut particles = particles.into_inner().unwrap_or_else(|e| e.into_inner());
        particles.sort_unstable_by_key(|(number, _)| *number);
        let parts: Vec<&[Particle]> = particles.iter().map(|(_, own)| &own[..]).collect();
        grid.fill(&parts, now.radius, pass.threads);

        // From the eye.
        let grid = &*grid;
        rays.merge(&Tiles::only(film, pass, observer, tiles).run(|tiles| {
            let mut work = self.work::<F>(tiles, pass, now);
            while let Some(tile) = tiles.next() {
                for samples in tiles.lanes_of::<F>(&tile) {
                    if self.connects() {
                        self.walk_beside(&samples, &mut work);
                    }
                    if self.mode != VcmMode::Light {
                        self.eye_walk(&samples, grid, &mut work);
                    }
                    work.sheets.end_samples(samples.slot, samples.mask, tile.weight, &mut work.rays);
                }
                tiles.done(&tile, work.sheets.own(), &mut work.rays);
                work.sheets.clear();
            }
        }));
        rays
    }
}

impl Integrator for Vcm<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let (mut rays, mut grid) = (Rays::default(), PointGrid::default());
        let camera = self.scene.camera();
        for iteration in pass.samples.clone() {
            // No walk has this number. What is merged must be at the same time.
            let u = light_dimensions::<f32>(&self.sampler, Index1(iteration), Index1(u32::MAX), 0);
            let moment = if camera.has_shutter() { u.value(MOMENT) } else { 0.0 };
            let radius = shrunk(self.first_radius, self.alpha, iteration);
            let one = Pass { samples: iteration..iteration + 1, shares: None, ..pass.clone() };
            let all = Tiles::new(film, &one, observer).count();
            // Of one size, so that none has few particles.
            let band = all.div_ceil(all.div_ceil(BAND).max(1)).max(1);
            for first in (0..all).step_by(band as usize) {
                let tiles = first..all.min(first + band);
                let paths = Tiles::new(film, &one, observer).pixels(tiles.clone()) as f32;
                let area = PI * radius * radius * paths;
                let eta = if self.merges() { area } else { 0.0 };
                let light_paths = pass.region.pixels() as f32;
                let now = Now { moment, light_paths, radius, scale: area.recip(), eta };
                let to = (film, &one, observer);
                rays.merge(&match self.engine {
                    Engine::Wavefront => self.band::<F32x16>(tiles, now, &mut grid, to),
                    Engine::Scalar => self.band::<f32>(tiles, now, &mut grid, to),
                });
                if observer.should_stop() {
                    return rays;
                }
            }
        }
        rays
    }
}
