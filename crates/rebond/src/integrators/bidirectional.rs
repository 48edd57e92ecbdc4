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
    Dimensions, Integrator, Observer, Pass, PathClasses, PathExpression, PathState, Rays, Sample, ShadowRay, Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{DIRECTION, Ending, LENS, PER_BOUNCE, PIXEL, POSITION, SOURCE, light_dimensions};
use crate::transport::{Heuristic, Roulette, Sheets, SubPath, Vertex, see, see_source};
use rebond_bvh::Ray;
use rebond_lanes::scalar::Index1;
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
struct Work<'a> {
    sampler: Sampler,
    /// Vertices of the light's walk, without its origin.
    light: Vec<Vertex<'a>>,
    sheets: Sheets<'a>,
    rays: Rays,
    /// Light's walks for each of the eye's.
    light_paths: f32,
}

impl<'a> Bidirectional<'a> {
    pub(super) fn new(
        settings: &BidirectionalSettings,
        scene: &'a Scene,
        sampler: Sampler,
        classes: Option<PathClasses>,
    ) -> Result<Self, IntegratorError> {
        let BidirectionalSettings { max_depth, rr_depth, roulette, survival, heuristic, .. } = *settings;
        super::check_ending(roulette, survival, max_depth)?;
        super::check_light_walks(scene)?;
        if settings.strategies && max_depth.is_none_or(|d| d.get() > DEEPEST) {
            return Err(IntegratorError {
                message: format!("strategies=true lays paths of at most {DEEPEST} segments into layers"),
                help: format!("add max_depth=N with N up to {DEEPEST}"),
            });
        }
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        let ending = Ending { roulette, survival, rr_depth };
        Ok(Self { scene, sampler, classes, max_depth, ending, heuristic, layers: settings.layers().len() })
    }

    /// The layers of a pair.
    fn strategy(&self, s: u32, t: u32) -> Option<usize> {
        (self.layers > 0).then(|| strategy(s, t))
    }

    fn sample(&self, sample: &Sample, work: &mut Work<'a>) {
        let [x, y, pixel, index] = [sample.x, sample.y, sample.pixel, sample.index].map(Index1);
        let eye = PathState::start(self.scene, &work.sampler, x, y, pixel, index, Index1(0));
        self.light_walk(sample, eye.time, work);
        self.eye_walk(&eye, work);
    }

    /// The walk from the light: t = 1 and t = 0 on the way, its vertices kept.
    fn light_walk(&self, sample: &Sample, time: f32, work: &mut Work<'a>) {
        work.light.clear();
        let (scene, camera, h) = (self.scene, self.scene.camera(), self.heuristic);
        let sampler = work.sampler;
        let dimensions = |number| light_dimensions(&sampler, sample.pixel, sample.index, number);
        let u = dimensions(0);
        let Some((emitter, probability)) = scene.light_sampler().source(u.value(SOURCE)) else { return };
        let emission = scene.emitters().emit(emitter, u.pair(POSITION), u.pair(DIRECTION));

        // s = 1, t = 1.
        if let Some(seen) = see_source(scene, emitter, probability, &emission, u.pair(LENS), time) {
            work.rays.shadow += 1;
            if !scene.occluded(&seen.ray, true) {
                let infinite = scene.emitters().is_infinite(emitter);
                // The direction towards the lens is another than the walk's.
                let pdf = scene.emitters().emission_pdf(emitter, emission.normal, seen.sight.w);
                let (here, on) =
                    if infinite { (pdf.direction.0, pdf.position.0) } else { (pdf.position.0, pdf.direction.0) };
                let by_eye = h.of(seen.sight.importance * seen.cos / (work.light_paths * here * probability));
                let by_light = h.of(on * seen.sight.found);
                let weight = (1.0 / (by_eye + 1.0 + by_light)) as f32;
                let at = (seen.sight.raster, u.pair(PIXEL));
                work.sheets.splat(0, self.strategy(1, 1), at, seen.light, weight);
            }
        }
        if !emission.weight.is_lit() {
            return;
        }

        let mut path = SubPath::from_light(scene, Some(h), emitter, probability, &emission, time);
        // Only through the lens do the longest paths have all their segments from here.
        let longest = if camera.has_lens() { self.max_depth } else { self.max_depth - 1 };
        while path.segments <= longest {
            work.rays.add(path.segments, 1);
            let hit = scene.intersect(&path.ray, true, false);
            let u = dimensions(path.segments);
            if camera.has_lens() {
                self.cross_lens(&path, hit.t, u.pair(PIXEL), work);
            }
            if !is_hit(&hit) {
                return;
            }
            let mut vertex = path.arrive(&hit, &u);
            if path.segments >= self.max_depth {
                return;
            }
            self.connect_to_lens(&vertex, path.segments + 1, [u.pair(LENS), u.pair(PIXEL)], time, work);
            let goes_on = path.scatter(&mut vertex, &u, &self.ending);
            work.light.push(vertex);
            if !goes_on {
                return;
            }
        }
    }

    /// t = 1, with s vertices of light.
    fn connect_to_lens(
        &self,
        vertex: &Vertex<'a>,
        s: u32,
        [lens, pixel]: [[f32; 2]; 2],
        time: f32,
        work: &mut Work<'a>,
    ) {
        let Some((seen, value, last)) = see(self.scene, vertex, lens, time) else { return };
        let (h, sight) = (self.heuristic, seen.sight);
        let state = work.sheets.state(0, std::iter::once(last).chain(events_before(&work.light)));
        if !work.sheets.counts(state) {
            return;
        }
        work.rays.shadow += 1;
        if self.scene.occluded(&seen.ray, true) {
            return;
        }
        let back = vertex.bsdf.eval(sight.w, vertex.surface.wo, TransportMode::Radiance, true).pdf.0;
        let by_eye = vertex.others(h, sight.importance * seen.cos / work.light_paths, back);
        let by_light = h.of(value.pdf.0 * sight.found);
        let weight = (1.0 / (by_eye + 1.0 + by_light)) as f32;
        work.sheets.splat(state, self.strategy(s, 1), (sight.raster, pixel), seen.light, weight);
    }

    /// t = 0: light crosses the lens before it meets anything at distance `end`.
    fn cross_lens(&self, path: &SubPath<'a>, end: f32, pixel: [f32; 2], work: &mut Work<'a>) {
        let (camera, h, time) = (self.scene.camera(), self.heuristic, path.ray.time);
        let crossing = camera.crossing(path.origin(), path.direction(), time);
        if !crossing.mask || crossing.t >= end {
            return;
        }
        let state = work.sheets.state(0, events_before(&work.light));
        let (g, lens) = (camera.density(path.direction(), time).0, camera.lens_pdf(time).0);
        let light = path.throughput() * (g * lens / crossing.cos);
        let per_cos = h.of(1.0 / crossing.cos);
        let distance = if path.from_far { 1.0 } else { h.of(crossing.t * crossing.t) };
        let by_eye =
            h.of(lens) * path.near * distance * per_cos + h.of(lens * g / work.light_paths) * path.far * per_cos;
        let weight = (1.0 / (1.0 + by_eye)) as f32;
        work.sheets.splat(state, self.strategy(path.segments + 1, 0), (crossing.raster, pixel), light, weight);
    }

    /// The walk from the eye, connected at every vertex.
    fn eye_walk(&self, eye: &PathState<f32>, work: &mut Work<'a>) {
        let scene = self.scene;
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), eye, work.light_paths);
        let mut state = work.sheets.state(0, []);
        loop {
            let u = Dimensions::new(eye.stream(), Index1(path.segments - 1), PER_BOUNCE);
            work.rays.add(path.segments, 1);
            let hit = scene.intersect(&path.ray, true, true);
            if !is_hit(&hit) {
                return self.escape(&path, state, work);
            }
            let mut vertex = path.arrive(&hit, &u);
            self.hit_light(&path, &vertex, state, work);
            if path.segments >= self.max_depth {
                return;
            }
            if !vertex.bsdf.is_specular() {
                self.ask_light(&path, &vertex, state, &u, work);
                self.connect_walks(&path, &vertex, state, work);
            }
            if !path.scatter(&mut vertex, &u, &self.ending) {
                return;
            }
            state = work.sheets.state(state, [vertex.event]);
        }
    }

    /// s = 0: the surroundings.
    fn escape(&self, path: &SubPath<'a>, state: u32, work: &mut Work<'a>) {
        let (scene, h, w) = (self.scene, self.heuristic, path.direction());
        for (number, environment) in &scene.emitters().environments {
            let (radiance, pdf) = environment.eval(w);
            if !radiance.is_lit() {
                continue;
            }
            let source = scene.light_sampler().source_probability(*number);
            let position = scene.emitters().emission_pdf(*number, Vec3::zero(), -w).position.0;
            let drawn = match path.segments {
                // The eye draws no points of lights; parallel rays of it meet none that light draws.
                1 if scene.camera().is_parallel() => 0.0,
                1 => source,
                _ => scene.light_sampler().probability(path.from, path.normal, Index1(*number), true),
            };
            let by_light = h.of(drawn * pdf.0) * path.near + h.of(source * pdf.0 * position) * path.far;
            let weight = (1.0 / (1.0 + by_light)) as f32;
            work.sheets.add(state, self.strategy(0, path.segments + 1), path.throughput() * radiance, weight);
        }
    }

    /// s = 0: a surface that shines.
    fn hit_light(&self, path: &SubPath<'a>, vertex: &Vertex<'a>, state: u32, work: &mut Work<'a>) {
        let (scene, h, surface) = (self.scene, self.heuristic, &vertex.surface);
        let radiance = scene.emitted(surface, true);
        if !radiance.is_lit() {
            return;
        }
        let source = scene.light_sampler().source_probability(surface.emitter.0);
        let pdf = scene.emitters().emission_pdf(surface.emitter.0, surface.ng, surface.wo);
        let drawn = if path.segments == 1 {
            source * pdf.position.0
        } else {
            let choice = scene.light_sampler().probability(path.from, path.normal, surface.emitter, true);
            let hit = surface.seen_from(path.from);
            choice * scene.emitters().pdf(&hit, LightSampling::Area, true).to_area(hit.to, hit.normal).0
        };
        let by_light = h.of(drawn) * vertex.near + h.of(source * pdf.position.0 * pdf.direction.0) * vertex.far;
        let weight = (1.0 / (1.0 + by_light)) as f32;
        work.sheets.add(state, self.strategy(0, path.segments + 1), vertex.throughput * radiance, weight);
    }

    /// s = 1: a point of a light, drawn for this vertex.
    fn ask_light(&self, path: &SubPath<'a>, vertex: &Vertex<'a>, state: u32, u: &Dimensions<f32>, work: &mut Work<'a>) {
        let (scene, h, surface, bsdf) = (self.scene, self.heuristic, &vertex.surface, &vertex.bsdf);
        let choice = || u.value(LIGHT_CHOICE);
        let Some((emitter, choice)) = scene.light_sampler().sample(surface.p, bsdf.normal(), choice, true) else {
            return;
        };
        let (place, time) = (u.pair(LIGHT_POINT), path.ray.time);
        let light = scene.emitters().sample(emitter, surface.p, time, LightSampling::Area, place, true);
        let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, true);
        let brings = value.f * light.weight * (bsdf.normal().dot(light.wi).abs() / choice);
        let contribution = vertex.throughput * brings;
        let event = bsdf.event(surface.wo, light.wi);
        let state = work.sheets.state(state, [event.0]);
        let Some(shadow) = ShadowRay::new(surface, &light, time, contribution, event, work.sheets.counts(state)) else {
            return;
        };
        work.rays.shadow += 1;
        if scene.occluded(&shadow.ray, true) {
            return;
        }
        // What is not drawn, as the place of a point, has the density 1 here and there.
        let hittable = light.pdf.0 > 0.0;
        let to = light.point - surface.p;
        let drawn = match (hittable, light.infinite) {
            (false, _) => 1.0,
            (true, true) => light.pdf.0,
            (true, false) => light.pdf.to_area(to, light.normal).0,
        };
        let source = scene.light_sampler().source_probability(emitter.0);
        let pdf = scene.emitters().emission_pdf(emitter.0, light.normal, -light.wi);
        let distance = if light.infinite { 1.0 } else { to.length_squared() };
        let found = source * pdf.position.0 * pdf.direction.0 * vertex.cos(light.wi) / (distance * choice * drawn);
        let back = bsdf.eval(light.wi, surface.wo, TransportMode::Importance, true).pdf.0;
        let by_eye = if hittable { h.of(value.pdf.0 / (choice * light.pdf.0)) } else { 0.0 };
        let weight = (1.0 / (by_eye + 1.0 + vertex.others(h, found, back))) as f32;
        work.sheets.add(state, self.strategy(1, path.segments + 1), contribution, weight);
    }

    /// s ≥ 2 and t ≥ 2: to every vertex of the light's walk.
    fn connect_walks(&self, path: &SubPath<'a>, z: &Vertex<'a>, state: u32, work: &mut Work<'a>) {
        let h = self.heuristic;
        // Segments: those of the eye's walk, the connection, and s − 1 of the light's.
        let most = (self.max_depth - path.segments - 1) as usize;
        for number in 0..work.light.len().min(most) {
            let y = &work.light[number];
            if y.bsdf.is_specular() {
                continue;
            }
            let across = y.surface.p - z.surface.p;
            let d2 = across.length_squared();
            let w = across * (1.0 / d2.sqrt());
            let at_z = z.bsdf.eval(z.surface.wo, w, TransportMode::Radiance, true);
            if !at_z.f.is_lit() {
                continue;
            }
            let at_y = y.bsdf.eval(y.surface.wo, -w, TransportMode::Importance, true);
            let cosines = (z.bsdf.normal().dot(w) * y.bsdf.normal().dot(w)).abs();
            let light = z.throughput * at_z.f * at_y.f * y.throughput * (cosines / d2);
            if !light.is_lit() {
                continue;
            }
            let events = [z.bsdf.event(z.surface.wo, w).0, y.bsdf.event(y.surface.wo, -w).0];
            let state = work.sheets.state(state, events.into_iter().chain(events_before(&work.light[..number])));
            if !work.sheets.counts(state) {
                continue;
            }
            let o = z.surface.leave(w);
            let d = y.surface.leave(-w) - o;
            work.rays.shadow += 1;
            if self.scene.occluded(&Ray { o: o.array(), d: d.array(), tmax: 1.0, time: path.ray.time }, true) {
                continue;
            }
            let back_z = z.bsdf.eval(w, z.surface.wo, TransportMode::Importance, true).pdf.0;
            let back_y = y.bsdf.eval(-w, y.surface.wo, TransportMode::Radiance, true).pdf.0;
            let by_eye = y.others(h, at_z.pdf.0 * y.cos(w) / d2, back_y);
            let by_light = z.others(h, at_y.pdf.0 * z.cos(w) / d2, back_z);
            let weight = (1.0 / (by_eye + 1.0 + by_light)) as f32;
            work.sheets.add(state, self.strategy(number as u32 + 2, path.segments + 1), light, weight);
        }
    }
}

/// The events of a walk from the light, the last first.
fn events_before(vertices: &[Vertex<'_>]) -> impl Iterator<Item = u32> {
    vertices.iter().rev().map(|v| v.event)
}

impl Integrator for Bidirectional<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| {
            let mut light = Vec::new();
            let sampler = tiles.sampler(&self.sampler);
            while let Some(tile) = tiles.next() {
                let sheets = Sheets::new(self.classes.as_ref(), self.scene.filter(), pass.region, self.layers);
                let light_paths = pass.region.pixels() as f32;
                let (walk, rays) = (std::mem::take(&mut light), Rays::default());
                let mut work = Work { sampler, light: walk, sheets, rays, light_paths };
                for s in tiles.samples_from(&tile, 0) {
                    self.sample(&s, &mut work);
                    work.sheets.end_sample(s.slot, tile.weight);
                }
                tiles.splat(&tile, work.sheets.splats());
                tiles.done(&tile, work.sheets.own(), &mut work.rays);
                light = work.light;
            }
        })
    }
}
