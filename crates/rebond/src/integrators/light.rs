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
use crate::render::{Integrator, Observer, Pass, PathClasses, PathExpression, Rays, Sample, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{DIRECTION, Ending, LENS, MOMENT, PIXEL, POSITION, SOURCE, Vertex, light_dimensions};
use crate::transport::{Roulette, Sheets, SubPath, see, see_source};
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
        let mirrors = "what the eye sees in mirrors and glass is left out, unless the camera has a lens";
        match (&self.max_depth, &self.paths) {
            (Some(d), _) => format!("paths of more than max_depth={d} segments are left out, and {mirrors}"),
            (None, Some(p)) => format!("only the paths {p} are shown, and {mirrors}"),
            (None, None) => mirrors.into(),
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
    classes: Option<PathClasses>,
    max_depth: u32,
    ending: Ending,
}

impl<'a> Light<'a> {
    pub(super) fn new(
        settings: &LightSettings,
        scene: &'a Scene,
        sampler: Sampler,
        classes: Option<PathClasses>,
    ) -> Result<Self, IntegratorError> {
        let LightSettings { max_depth, rr_depth, roulette, survival, .. } = *settings;
        let ending = Ending { roulette, survival, rr_depth };
        super::check_ending(roulette, survival, max_depth)?;
        super::check_light_walks(scene)?;
        Ok(Self { scene, sampler, classes, max_depth: max_depth.map_or(u32::MAX, NonZeroU32::get), ending })
    }

    /// The path of light beside a pixel's sample.
    fn trace(&self, sampler: &Sampler, s: &Sample, events: &mut Vec<u32>, sheets: &mut Sheets<'_>, rays: &mut Rays) {
        let (scene, camera) = (self.scene, self.scene.camera());
        let dimensions = |number| light_dimensions(sampler, s.pixel, s.index, number);
        let u = dimensions(0);
        let Some((emitter, probability)) = scene.light_sampler().source(u.value(SOURCE)) else { return };
        let time = camera.time(if camera.has_shutter() { u.value(MOMENT) } else { 0.0 });
        let emission = scene.emitters().emit(emitter, u.pair(POSITION), u.pair(DIRECTION));

        // The light as the eye sees it.
        if let Some(seen) = see_source(scene, emitter, probability, &emission, u.pair(LENS), time) {
            rays.shadow += 1;
            if !scene.occluded(&seen.ray, true) {
                sheets.splat(sheets.state(0, []), None, (seen.sight.raster, u.pair(PIXEL)), seen.light, 1.0);
            }
        }
        if !emission.weight.is_lit() {
            return;
        }

        let mut path = SubPath::from_light(scene, None, emitter, probability, &emission, time);
        events.clear();
        loop {
            rays.add(path.segments, 1);
            let hit = scene.intersect(&path.ray, true, false);
            // By chance through the lens, where nothing else would find it.
            let u = dimensions(path.segments);
            if path.specular && camera.has_lens() {
                let crossing = camera.crossing(path.origin(), path.direction(), time);
                if crossing.mask && crossing.t < hit.t {
                    let g = camera.density(path.direction(), time).0;
                    let light = path.throughput() * (g * camera.lens_pdf(time).0 / crossing.cos);
                    let state = sheets.state(0, events.iter().rev().copied());
                    sheets.splat(state, None, (crossing.raster, u.pair(PIXEL)), light, 1.0);
                }
            }
            if !is_hit(&hit) {
                return;
            }
            let mut vertex = path.arrive(&hit, &u);
            if path.segments < self.max_depth {
                self.connect(&vertex, events, [u.pair(LENS), u.pair(PIXEL)], time, sheets, rays);
            }
            if path.segments >= self.max_depth || !path.scatter(&mut vertex, &u, &self.ending) {
                return;
            }
            events.push(vertex.event);
        }
    }

    /// Connects a vertex to the lens.
    fn connect(
        &self,
        vertex: &Vertex<'_>,
        events: &[u32],
        [lens, pixel]: [[f32; 2]; 2],
        time: f32,
        sheets: &mut Sheets<'_>,
        rays: &mut Rays,
    ) {
        let Some((seen, _, last)) = see(self.scene, vertex, lens, time) else { return };
        let state = sheets.state(0, std::iter::once(last).chain(events.iter().rev().copied()));
        if sheets.counts(state) {
            rays.shadow += 1;
            if !self.scene.occluded(&seen.ray, true) {
                sheets.splat(state, None, (seen.sight.raster, pixel), seen.light, 1.0);
            }
        }
    }
}

impl Integrator for Light<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| {
            let (mut events, sampler) = (Vec::new(), tiles.sampler(&self.sampler));
            while let Some(tile) = tiles.next() {
                let mut sheets = Sheets::new(self.classes.as_ref(), self.scene.filter(), pass.region, 0);
                let mut rays = Rays::default();
                for s in tiles.samples_from(&tile, 0) {
                    self.trace(&sampler, &s, &mut events, &mut sheets, &mut rays);
                    sheets.end_sample(s.slot, tile.weight);
                }
                tiles.splat(&tile, sheets.splats());
                tiles.done(&tile, sheets.own(), &mut rays);
            }
        })
    }
}
