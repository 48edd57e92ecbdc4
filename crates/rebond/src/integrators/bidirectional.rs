//! Bidirectional path tracing (Lafortune and Willems 1993; Veach and Guibas 1994; Veach 1997, ch. 10). Unbiased, unless
//! `max_depth` cuts paths off.
//!
//! A walk from the eye, z_0 z_1 …, and one from a light, y_0 y_1 …, are connected in every way: s vertices of the light's and t of
//! the eye's make a path of s + t vertices.
//!
//! ```text
//! I ≈ Σ_{s,t} w_{s,t} C_{s,t}
//! ```
//!
//! Each path counts w_{s,t} = p_{s,t}^β / Σ p^β over all ways to find it: β = 1 is the balance heuristic, 2 the power heuristic.
//! `transport/ways.rs` has the ways, `transport/sub_path.rs` the walks and the sums that weights are made of.

use super::IntegratorError;
use crate::film::Film;
use crate::render::{
    Dimensions, Engine, Integrator, Observer, Pass, PathClasses, PathExpression, PathState, Rays, Samples, Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, LENS, PER_BOUNCE, PIXEL, light_dimensions};
use crate::transport::{Heuristic, Roulette, Sheets, Source, SubPath, Walk, Ways};
use rebond_bvh::Trace;
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
            rr_depth: 3,
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
    ("rr_depth", "segments of either walk after which Russian roulette begins; 3"),
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

/// What a worker keeps from sample to sample.
struct Work<'a, F: Real> {
    sampler: Sampler,
    /// The light's walks.
    light: Walk<'a, F>,
    ways: Ways<'a, F>,
    rays: Rays,
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
        work.ways.connect_source(&source, [u.pair(LENS), u.pair(PIXEL)], time, samples.mask);

        let mut path = SubPath::from_light(scene, Some(self.heuristic), &source, time);
        let mut alive = samples.mask & source.emission.weight.is_lit();
        // Only through the lens do the longest paths have all their segments from here.
        let longest = if camera.has_lens() { self.max_depth } else { self.max_depth - 1 };
        while alive.any() && path.segments <= longest {
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, false);
            let u = dimensions(path.segments);
            if camera.has_lens() {
                work.ways.cross_lens(work.light.vertices(), &path, hit.t, u.pair(PIXEL), alive);
            }
            alive = alive & is_hit(&hit);
            if alive.none() || path.segments >= self.max_depth {
                return;
            }
            let (vertex, before) = work.light.arrive(&mut path, &hit, &u, alive);
            work.ways.connect_to_lens(before, vertex, [u.pair(LENS), u.pair(PIXEL)], time);
            alive = path.scatter(vertex, &u, &self.ending);
        }
    }

    /// The walks from the eye, connected at every vertex.
    fn eye_walk<F: Trace>(&self, eye: &PathState<F>, mask: F::Mask, work: &mut Work<'a, F>) {
        let scene = self.scene;
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), eye, work.ways.light_paths);
        let (mut state, mut alive) = (PathClasses::start::<F>(), mask);
        while alive.any() {
            let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
            work.rays.add(path.segments, alive.count());
            let hit = scene.meet(&path.ray, alive, path.segments == 1);
            let found = alive & is_hit(&hit);
            work.ways.escape(&path, state, alive.and_not(found));
            if found.none() {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, found);
            work.ways.hit_light(&path, &vertex, state);
            if path.segments >= self.max_depth {
                return;
            }
            let diffuse = found.and_not(vertex.bsdf.is_specular());
            if diffuse.any() {
                work.ways.ask_light(&path, &vertex, state, &u, diffuse);
                work.ways.connect_walks(work.light.vertices(), &path, &vertex, state, diffuse);
            }
            alive = path.scatter(&mut vertex, &u, &self.ending);
            state = work.ways.sheets.state(state, [vertex.event]);
        }
    }

    fn run<F: Trace>(&'a self, tiles: &Tiles<'_>, pass: &Pass) {
        let ways = Ways {
            scene: self.scene,
            heuristic: self.heuristic,
            alone: false,
            max_depth: self.max_depth,
            light_paths: pass.region.pixels() as f32,
            strategies: self.layers > 0,
            sheets: Sheets::new(self.classes.as_ref(), self.scene, pass.region, self.layers),
        };
        let sampler = tiles.sampler(&self.sampler);
        let mut work = Work { sampler, light: Walk::default(), ways, rays: Rays::default() };
        while let Some(tile) = tiles.next() {
            for samples in tiles.lanes_of::<F>(&tile) {
                self.trace(&samples, &mut work);
                work.ways.sheets.end_samples(samples.slot, samples.mask, tile.weight, &mut work.rays);
            }
            tiles.splat(&tile, work.ways.sheets.splats());
            tiles.done(&tile, work.ways.sheets.own(), &mut work.rays);
            work.ways.sheets.clear();
        }
    }
}

impl Integrator for Bidirectional<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| match self.engine {
            Engine::Wavefront => self.run::<F32x16>(tiles, pass),
            Engine::Scalar => self.run::<f32>(tiles, pass),
        })
    }
}
