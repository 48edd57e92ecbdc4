//! Light tracing: paths start at the lights, and each of their vertices is connected to the camera (Arvo 1986; Dutré,
//! Lafortune, Willems 1993; Veach 1997, §8.3 and §10.2). Biased only by what it cannot find.
//!
//! ```text
//! I_j ≈ 1/N Σ_paths Σ_vertices Φ f_r(ωi → ωo) |cosθ| V · We_j / pdf(lens)      Φ, in W, what the path carries to the vertex
//! ```
//!
//! N paths serve all pixels; We_j is the importance of pixel j (`camera/importance.rs`).
//!
//! The eye cannot be connected to a mirror or to glass: what it sees in them is left out with a pinhole or a camera of parallel
//! rays, and found by light that happens to cross the lens where there is one. Surroundings are not seen by parallel rays either.

use super::IntegratorError;
use crate::film::Film;
use crate::render::{Engine, Integrator, Observer, Pass, PathClasses, PathExpression, Rays, Samples, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, LENS, MOMENT, PIXEL, light_dimensions};
use crate::transport::{NOT_BY_LIGHT, Roulette, Sheets, Source, SubPath, Vertex, see, see_source};
use rebond_bvh::Trace;
use rebond_lanes::{F32x16, Mask, Real};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;
use std::sync::Mutex;

/// Settings of light tracing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightSettings {
    /// Longest path in segments: 1 is emitted light only, 2 direct light too. Unlimited if not given.
    pub max_depth: Option<NonZeroU32>,
    /// Segments after which Russian roulette begins.
    pub rr_depth: u32,
    /// How long paths end.
    pub roulette: Roulette,
    /// Survival probability, or the most it may be.
    pub survival: f32,
    /// Which paths count; all if not given.
    pub paths: Option<PathExpression>,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self { max_depth: None, rr_depth: 5, roulette: Roulette::default(), survival: 0.95, paths: None }
    }
}

impl LightSettings {
    pub(super) fn leaves_out(&self) -> String {
        match (&self.max_depth, &self.paths) {
            (Some(d), _) => format!("paths of more than max_depth={d} segments are left out, and {NOT_BY_LIGHT}"),
            (None, Some(p)) => format!("only the paths {p} are shown, and {NOT_BY_LIGHT}"),
            (None, None) => NOT_BY_LIGHT.into(),
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("rr_depth", "segments after which Russian roulette begins; 5"),
    ("roulette", "how long paths end: none, constant, albedo or throughput; throughput"),
    ("survival", "probability of survival (constant), or the most it may be; 0.95"),
    ("paths", "which paths count: numbers of vertices such as 2 or 3..4, or an expression such as LS+DE; all"),
];

/// The estimator at work.
pub struct Light<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    classes: Option<PathClasses>,
    max_depth: u32,
    ending: Ending,
}

/// What a worker keeps from path to path.
struct Work<'a, F: Real> {
    sampler: Sampler,
    /// What happened to the light so far.
    events: Vec<F::Index>,
    sheets: Sheets<'a, F>,
    rays: Rays,
}

impl<'a> Light<'a> {
    pub(super) fn new(
        settings: &LightSettings,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
        classes: Option<PathClasses>,
    ) -> Result<Self, IntegratorError> {
        let LightSettings { max_depth, rr_depth, roulette, survival, .. } = *settings;
        super::check_ending(roulette, survival, max_depth)?;
        let ending = Ending { roulette, survival, rr_depth };
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        Ok(Self { scene, sampler, engine, classes, max_depth, ending })
    }

    /// The paths of light beside samples of pixels.
    fn trace<F: Trace>(&self, samples: &Samples<F>, work: &mut Work<'_, F>) {
        let (scene, camera, mask, sampler) = (self.scene, self.scene.camera(), samples.mask, work.sampler);
        let dimensions = |number| light_dimensions::<F>(&sampler, samples.pixel, samples.index, number);
        let u = dimensions(0);
        let time = camera.time(if camera.has_shutter() { u.value(MOMENT) } else { F::zero() });
        let Some(source) = Source::draw(scene, &u, time, mask) else { return };

        // The light as the eye sees it.
        if let Some(seen) = see_source(scene, &source, u.pair(LENS), time, mask) {
            let at = (seen.sight.raster, u.pair(PIXEL));
            work.sheets.connect_to_lens(&seen.connection(PathClasses::start::<F>(), None, F::one()), at, seen.mask);
        }

        let mut path = SubPath::from_light(scene, None, &source, time);
        let mut alive = mask & source.emission.weight.is_lit();
        work.events.clear();
        while alive.any() {
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
            self.connect(&vertex, [u.pair(LENS), u.pair(PIXEL)], time, work);
            alive = path.scatter(&mut vertex, &u, &self.ending);
            work.events.push(vertex.event);
        }
    }

    /// By chance through the lens before it meets anything at distance `end`, where nothing else would find it.
    fn cross_lens<F: Trace>(
        &self,
        path: &SubPath<'_, F>,
        end: F,
        pixel: [F; 2],
        alive: F::Mask,
        work: &mut Work<'_, F>,
    ) {
        let (camera, time) = (self.scene.camera(), path.ray.time);
        let crossing = camera.crossing(path.origin(), path.direction(), time);
        let mask = (alive & path.specular & crossing.mask).and_not(path.hidden);
        let mask = mask & crossing.free.lt(path.end(end, mask));
        if mask.any() {
            let state = work.sheets.state(PathClasses::start::<F>(), work.events.iter().rev().copied());
            let seen = camera.density(path.direction(), time).0 * camera.lens_pdf(time).0 / crossing.cos;
            let light = path.throughput() * seen;
            work.sheets.splat(state, None, (crossing.raster, pixel), light, F::one(), mask);
        }
    }

    /// Connects vertices to the lens.
    fn connect<F: Trace>(&self, vertex: &Vertex<'_, F>, [lens, pixel]: [[F; 2]; 2], time: F, work: &mut Work<'_, F>) {
        let Some(seen) = see(self.scene, vertex, lens, time) else { return };
        let last = vertex.bsdf.event(vertex.surface.wo, seen.sight.w);
        let events = std::iter::once(last).chain(work.events.iter().rev().copied());
        let state = work.sheets.state(PathClasses::start::<F>(), events);
        let at = (seen.sight.raster, pixel);
        work.sheets.connect_to_lens(&seen.connection(state, None, F::one()), at, seen.mask);
    }

    fn run<F: Trace>(&'a self, tiles: &Tiles<'_>, pass: &Pass) {
        let sheets = Sheets::new(self.classes.as_ref(), self.scene, pass.region, 0);
        let sampler = tiles.sampler(&self.sampler);
        let mut work = Work { sampler, events: Vec::new(), sheets, rays: Rays::default() };
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

impl Integrator for Light<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| match self.engine {
            Engine::Wavefront => self.run::<F32x16>(tiles, pass),
            Engine::Scalar => self.run::<f32>(tiles, pass),
        })
    }
}
