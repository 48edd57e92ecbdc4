//! Bidirectional path tracing (Lafortune and Willems 1993; Veach and Guibas 1994; Veach 1997, ch. 10). Unbiased, unless
//! `max_depth` cuts paths off.
//!
//! A walk from the eye, z_0 z_1 …, and one from a light, y_0 y_1 …, are connected in every way: s vertices of the light's and t of
//! the eye's make a path of s + t vertices.
//!
//! ```text
//! I ≈ Σ_{s,t} w_{s,t} C_{s,t}      C_{s,t} = α_y f_r(y) |cosθ_y| V/d² |cosθ_z| f_r(z) α_z
//! ```
//!
//! | s, t | the path is found |
//! |---|---|
//! | s = 0 | by the eye's walk, which hits the light |
//! | s = 1 | by a point of a light, drawn for the end of the eye's walk: y_0 itself is not used |
//! | s ≥ 2, t ≥ 2 | by connecting two walks |
//! | t = 1 | by connecting the light's walk to a point of the lens: light for whichever pixel sees it |
//! | t = 0 | by the light's walk, which crosses the lens (if it is none of a pinhole) |
//!
//! Each path counts w_{s,t} = p_{s,t}^β / Σ p^β over all ways to find it: β = 1 is the balance heuristic, 2 the power heuristic.
//! `transport/sub_path.rs` has the sums. For each sample of a pixel there is one walk from the light, so that ways with t ≤ 1
//! have as many samples as the region has pixels; their densities count that often.

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::film::Film;
use crate::math::Vec3;
use crate::render::{
    Dimensions, Engine, Integrator, Observer, Pass, PathClasses, PathExpression, PathState, Rays, Samples, ShadowRay,
    Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, LENS, PER_BOUNCE, PIXEL, light_dimensions};
use crate::transport::{Connection, Heuristic, Roulette, Sheets, Source, SubPath, Vertex, see, see_source};
use rebond_bvh::{Ray, Trace};
use rebond_lanes::{F32x16, Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;
use std::sync::Mutex;

/// Settings of bidirectional path tracing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BidirectionalSettings {
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
    /// Whether each (s,t) has layers of its own, weighed and not.
    pub strategies: bool,
    /// Which paths count; all if not given.
    pub paths: Option<PathExpression>,
}

impl Default for BidirectionalSettings {
    fn default() -> Self {
        Self {
            max_depth: None,
            rr_depth: 5,
            roulette: Roulette::default(),
            survival: 0.95,
            heuristic: Heuristic::default(),
            strategies: false,
            paths: None,
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("rr_depth", "segments of either walk after which Russian roulette begins; 5"),
    ("roulette", "how walks end: none, constant, albedo or throughput; throughput"),
    ("survival", "probability of survival (constant), or the most it may be; 0.95"),
    ("heuristic", "how the ways to find a path are weighed: balance or power; power"),
    ("strategies", "true: layers for each number s of light's and t of eye's vertices, weighed and not; false"),
    ("paths", "which paths count: numbers of vertices such as 2 or 3..4, or an expression such as LS+DE; all"),
];

/// The deepest paths whose strategies have layers.
const DEEPEST: u32 = 8;

/// The pairs (s, t) of paths of at most so many segments, by length and s.
fn strategies(max_depth: u32) -> impl Iterator<Item = [u32; 2]> {
    (2..=max_depth + 1).flat_map(|vertices| (0..=vertices).map(move |s| [s, vertices - s]))
}

/// The place of a pair among them.
fn strategy(s: u32, t: u32) -> usize {
    let vertices = s + t;
    // 3 + 4 + … + vertices pairs of shorter paths.
    (vertices * (vertices + 1) / 2 - 3 + s) as usize
}

impl BidirectionalSettings {
    pub(super) fn leaves_out(&self) -> Option<String> {
        let by_depth = self.max_depth.map(|d| format!("paths of more than max_depth={d} segments are left out"));
        let by_class = self.paths.as_ref().map(|p| format!("only the paths {p} are shown"));
        by_depth.or(by_class)
    }

    pub(super) fn layers(&self) -> Vec<String> {
        let depth = self.max_depth.map_or(0, NonZeroU32::get).min(DEEPEST);
        let pairs = strategies(if self.strategies { depth } else { 0 });
        pairs.flat_map(|[s, t]| [format!("s{s}-t{t}"), format!("s{s}-t{t}-unweighted")]).collect()
    }
}

/// The estimator at work.
pub struct Bidirectional<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    classes: Option<PathClasses>,
    max_depth: u32,
    ending: Ending,
    heuristic: Heuristic,
    /// Layers of strategies.
    layers: usize,
}

/// Dimensions of the sample values that a bounce of the eye's walk uses for its light.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;

/// What a worker keeps from sample to sample.
struct Work<'a, F: Real> {
    sampler: Sampler,
    /// Vertices of the light's walks, without their origins.
    light: Vec<Vertex<'a, F>>,
    sheets: Sheets<'a, F>,
    rays: Rays,
    /// Light's walks for each of the eye's.
    light_paths: f32,
}

impl<'a> Bidirectional<'a> {
    pub(super) fn new(
        settings: &BidirectionalSettings,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
        classes: Option<PathClasses>,
    ) -> Result<Self, IntegratorError> {
        let BidirectionalSettings { max_depth, rr_depth, roulette, survival, heuristic, .. } = *settings;
        super::check_ending(roulette, survival, max_depth)?;
        if settings.strategies && max_depth.is_none_or(|d| d.get() > DEEPEST) {
            return Err(IntegratorError {
                message: format!("strategies=true lays paths of at most {DEEPEST} segments into layers"),
                help: format!("add max_depth=N with N up to {DEEPEST}"),
            });
        }
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        let ending = Ending { roulette, survival, rr_depth };
        let layers = settings.layers().len();
        Ok(Self { scene, sampler, engine, classes, max_depth, ending, heuristic, layers })
    }

    /// The layers of a pair.
    fn strategy(&self, s: u32, t: u32) -> Option<usize> {
        (self.layers > 0).then(|| strategy(s, t))
    }

    fn trace<F: Trace>(&self, samples: &Samples<F>, work: &mut Work<'a, F>) {
        let Samples { x, y, pixel, index, slot, .. } = *samples;
        let eye = PathState::start(self.scene, &work.sampler, x, y, pixel, index, slot);
        self.light_walk(samples, eye.time, work);
        self.eye_walk(&eye, samples.mask, work);
    }

    /// The walks from the light: t = 1 and t = 0 on the way, their vertices kept.
    fn light_walk<F: Trace>(&self, samples: &Samples<F>, time: F, work: &mut Work<'a, F>) {
        work.light.clear();
        let (scene, camera, sampler) = (self.scene, self.scene.camera(), work.sampler);
        let dimensions = |number| light_dimensions::<F>(&sampler, samples.pixel, samples.index, number);
        let u = dimensions(0);
        let Some(source) = Source::draw(scene, &u, time, samples.mask) else { return };
        self.connect_source(&source, [u.pair(LENS), u.pair(PIXEL)], time, samples.mask, work);

        let mut path = SubPath::from_light(scene, Some(self.heuristic), &source, time);
        let mut alive = samples.mask & source.emission.weight.is_lit();
        // Only through the lens do the longest paths have all their segments from here.
        let longest = if camera.has_lens() { self.max_depth } else { self.max_depth - 1 };
        while alive.any() && path.segments <= longest {
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, false);
            let u = dimensions(path.segments);
            if camera.has_lens() {
                self.cross_lens(&path, hit.t, u.pair(PIXEL), alive, work);
            }
            alive = alive & is_hit(&hit);
            if alive.none() || path.segments >= self.max_depth {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, alive);
            self.connect_to_lens(&vertex, path.segments + 1, [u.pair(LENS), u.pair(PIXEL)], time, work);
            alive = path.scatter(&mut vertex, &u, &self.ending);
            work.light.push(vertex);
        }
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
        let by_eye = seen.sight.importance * seen.cos / (here * work.light_paths);
        let weight = self.heuristic.weight([by_eye, seen.pdf * seen.sight.found]);
        let connection = seen.connection(PathClasses::start::<F>(), self.strategy(1, 1), weight);
        work.sheets.connect_to_lens(&connection, (seen.sight.raster, pixel), seen.mask);
    }

    /// t = 1, with s vertices of light.
    fn connect_to_lens<F: Trace>(
        &self,
        vertex: &Vertex<'a, F>,
        s: u32,
        [lens, pixel]: [[F; 2]; 2],
        time: F,
        work: &mut Work<'a, F>,
    ) {
        let Some(seen) = see(self.scene, vertex, lens, time) else { return };
        let (h, sight) = (self.heuristic, seen.sight);
        let last = vertex.bsdf.event(vertex.surface.wo, sight.w);
        let events = std::iter::once(last).chain(events_before(&work.light));
        let state = work.sheets.state(PathClasses::start::<F>(), events);
        let back = vertex.pdf_back(sight.w, TransportMode::Radiance, seen.mask);
        let by_eye = vertex.others(h, sight.importance * seen.cos / F::splat(work.light_paths), back);
        let weight = h.weight([by_eye, seen.pdf * sight.found]);
        let connection = seen.connection(state, self.strategy(s, 1), weight);
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
        let mask = alive & crossing.mask & crossing.free.lt(end);
        if mask.none() {
            return;
        }
        let state = work.sheets.state(PathClasses::start::<F>(), events_before(&work.light));
        let (g, lens) = (camera.density(path.direction(), time).0, camera.lens_pdf(time).0);
        let per_cos = crossing.cos.recip();
        let light = path.throughput() * (g * lens * per_cos);
        let distance = F::select(path.from_far, F::one(), crossing.t * crossing.t);
        let near = path.near * distance;
        let by_eye = lens * per_cos * h.sum(near, path.far * (g / F::splat(work.light_paths)));
        let (weight, at) = (h.weight([by_eye, F::zero()]), (crossing.raster, pixel));
        work.sheets.splat(state, self.strategy(path.segments + 1, 0), at, light, weight, mask);
    }

    /// The walks from the eye, connected at every vertex.
    fn eye_walk<F: Trace>(&self, eye: &PathState<F>, mask: F::Mask, work: &mut Work<'a, F>) {
        let scene = self.scene;
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), eye, work.light_paths);
        let (mut state, mut alive) = (PathClasses::start::<F>(), mask);
        while alive.any() {
            let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, path.segments == 1);
            let found = alive & is_hit(&hit);
            self.escape(&path, state, alive.and_not(found), work);
            if found.none() {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, found);
            self.hit_light(&path, &vertex, state, work);
            if path.segments >= self.max_depth {
                return;
            }
            let diffuse = found.and_not(vertex.bsdf.is_specular());
            if diffuse.any() {
                self.ask_light(&path, &vertex, state, &u, diffuse, work);
                self.connect_walks(&path, &vertex, state, diffuse, work);
            }
            alive = path.scatter(&mut vertex, &u, &self.ending);
            state = work.sheets.state(state, [vertex.event]);
        }
    }

    /// s = 0: the surroundings.
    fn escape<F: Trace>(&self, path: &SubPath<'a, F>, state: F::Index, mask: F::Mask, work: &mut Work<'a, F>) {
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
            let weight = h.weight([by_light, F::zero()]);
            let light = path.throughput() * radiance;
            work.sheets.add(state, self.strategy(0, path.segments + 1), light, weight, mask & radiance.is_lit());
        }
    }

    /// s = 0: a surface that shines.
    fn hit_light<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        vertex: &Vertex<'a, F>,
        state: F::Index,
        work: &mut Work<'a, F>,
    ) {
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
        let weight = h.weight([by_light, F::zero()]);
        work.sheets.add(state, self.strategy(0, path.segments + 1), vertex.throughput * radiance, weight, lit);
    }

    /// s = 1: a point of a light, drawn for this vertex.
    fn ask_light<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        vertex: &Vertex<'a, F>,
        state: F::Index,
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
        let event = bsdf.event(surface.wo, light.wi);
        let state = work.sheets.state(state, [event]);
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
        let by_light = F::select(hittable, value.pdf.0 / (choice * light.pdf.0), F::zero());
        let weight = h.weight([by_light, vertex.others(h, found, back)]);
        let strategy = self.strategy(1, path.segments + 1);
        let connection = Connection { ray: shadow.ray, light: contribution, weight, state, strategy };
        work.sheets.connect(&connection, shadow.mask);
    }

    /// s ≥ 2 and t ≥ 2: to every vertex of the light's walk.
    fn connect_walks<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        z: &Vertex<'a, F>,
        state: F::Index,
        mask: F::Mask,
        work: &mut Work<'a, F>,
    ) {
        let h = self.heuristic;
        // Segments: those of the eye's walk, the connection, and s − 1 of the light's.
        let most = (self.max_depth - path.segments - 1) as usize;
        for number in 0..work.light.len().min(most) {
            let y = &work.light[number];
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
            let events = [z.bsdf.event(z.surface.wo, w), y.bsdf.event(y.surface.wo, -w)];
            let state = work.sheets.state(state, events.into_iter().chain(events_before(&work.light[..number])));
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
            let (weight, strategy) =
                (h.weight([by_eye, by_light]), self.strategy(number as u32 + 2, path.segments + 1));
            work.sheets.connect(&Connection { ray, light, weight, state, strategy }, mask);
        }
    }

    fn run<F: Trace>(&'a self, tiles: &Tiles<'_>, pass: &Pass) {
        let sheets = Sheets::new(self.classes.as_ref(), self.scene, pass.region, self.layers);
        let (sampler, light_paths) = (tiles.sampler(&self.sampler), pass.region.pixels() as f32);
        let mut work = Work { sampler, light: Vec::new(), sheets, rays: Rays::default(), light_paths };
        while let Some(tile) = tiles.next() {
            for samples in tiles.lanes_of::<F>(&tile) {
                self.trace(&samples, &mut work);
                work.sheets.end_samples(samples.slot, samples.mask, tile.weight, &mut work.rays);
            }
            tiles.splat(&tile, work.sheets.splats());
            tiles.done(&tile, work.sheets.own(), &mut work.rays);
            work.sheets.clear();
        }
    }
}

/// The events of walks from the light, the last first.
fn events_before<F: Real>(vertices: &[Vertex<'_, F>]) -> impl Iterator<Item = F::Index> {
    vertices.iter().rev().map(|v| v.event)
}

impl Integrator for Bidirectional<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| match self.engine {
            Engine::Wavefront => self.run::<F32x16>(tiles, pass),
            Engine::Scalar => self.run::<f32>(tiles, pass),
        })
    }
}
