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
//! and B). With the power heuristic η is squared as all densities are.
//!
//! | `mode` | ways |
//! |---|---|
//! | `vcm` | all |
//! | `bidirectional` | connections: the integrator of that name |
//! | `merging` | merging at every vertex, and light that the eye meets: bidirectional photon mapping (Vorba 2011) |
//! | `photon` | merging at the first vertex that neither mirrors nor is glass, of weight 1: progressive photon mapping |
//! | `light` | connections to the lens, of weight 1: light tracing |
//!
//! Pixels go in bands of up to 1024 tiles, each with the walks of its own pixels. Walks stay in memory until their band is done: up to
//! 2¹⁸ of them, whatever the size of the picture, with some 450 bytes for each of their vertices.

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::film::Film;
use crate::math::{Rgb, Vec3};
use crate::render::{
    Dimensions, Integrator, Observer, Pass, PathClasses, PathExpression, PathState, Rays, Sample, ShadowRay, Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{
    DIRECTION, Ending, LENS, MOMENT, PER_BOUNCE, PIXEL, POSITION, SOURCE, light_dimensions,
};
use crate::transport::{Heuristic, Placed, PointGrid, Roulette, Sheets, SubPath, Vertex, first_radius, see, see_source, shrunk};
use rebond_bvh::Ray;
use rebond_lanes::scalar::Index1;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::num::NonZeroU32;
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
    /// Which paths count; all if not given.
    pub paths: Option<PathExpression>,
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
            paths: None,
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
    ("paths", "which paths count: numbers of vertices such as 2 or 3..4, or an expression such as LS+DE; all"),
];

impl VcmSettings {
    pub(super) fn leaves_out(&self) -> Option<String> {
        let by_depth = self.max_depth.map(|d| format!("paths of more than max_depth={d} segments are left out"));
        let by_class = self.paths.as_ref().map(|p| format!("only the paths {p} are shown"));
        let by_mode = match self.mode {
            VcmMode::Light => Some("what the eye sees in mirrors and glass is left out, unless the camera has a lens"),
            VcmMode::Bidirectional => None,
            _ => Some("light is blurred by a radius that shrinks with every sample"),
        };
        let all: Vec<String> = by_depth.into_iter().chain(by_class).chain(by_mode.map(String::from)).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

/// Tiles of a band at most.
const BAND: u64 = 1024;

/// Dimensions of the sample values that a bounce of the eye's walk uses for its light.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;

/// A vertex of a light's walk, for eyes that come by.
#[derive(Clone, Copy, Debug, Default)]
struct Lit {
    p: [f32; 3],
    w: [f32; 3],
    throughput: [f32; 3],
    /// Its place in its walk; 0 is the first surface.
    number: u32,
    near: f64,
    far: f64,
    /// The tile of its walk, and its place there.
    tile: u32,
    place: u32,
}

impl Placed for Lit {
    fn place(&self) -> [f32; 3] {
        self.p
    }
}

/// The light's walks of a tile.
#[derive(Default)]
struct Walks<'a> {
    vertices: Vec<Vertex<'a>>,
    /// Where the walk beside each sample ends.
    ends: Vec<u32>,
    lit: Vec<Lit>,
}

impl<'a> Walks<'a> {
    fn of(&self, slot: u32) -> &[Vertex<'a>] {
        let first = if slot == 0 { 0 } else { self.ends[slot as usize - 1] };
        &self.vertices[first as usize..self.ends[slot as usize] as usize]
    }
}

/// What the samples of a band share.
#[derive(Clone, Copy)]
struct Now {
    time: f32,
    moment: f32,
    /// Light's walks for each of the eye's: over the picture, for connections to the lens.
    light_paths: f32,
    radius: f32,
    /// 1 / (π r² N).
    scale: f32,
    /// η, in the terms of the heuristic; 0 if nothing is merged.
    eta: f64,
}

/// The light's walks of a band, ready to be met.
struct Band<'b, 'a> {
    walks: &'b [Walks<'a>],
    grid: &'b PointGrid<Lit>,
    first_tile: u32,
}

/// What a worker keeps from sample to sample.
struct Work<'w> {
    sampler: Sampler,
    sheets: Sheets<'w>,
    rays: Rays,
    now: Now,
}

/// The estimator at work.
pub struct Vcm<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    classes: Option<PathClasses>,
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
        classes: Option<PathClasses>,
    ) -> Result<Self, IntegratorError> {
        let VcmSettings { mode, radius, alpha, max_depth, rr_depth, roulette, survival, heuristic, .. } = *settings;
        super::check_ending(roulette, survival, max_depth)?;
        super::check_light_walks(scene)?;
        super::check_radius(radius, alpha)?;
        let first_radius = radius.unwrap_or_else(|| first_radius(scene));
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        let ending = Ending { roulette, survival, rr_depth };
        Ok(Self { scene, sampler, classes, mode, first_radius, alpha, max_depth, ending, heuristic })
    }

    fn connects(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Bidirectional)
    }

    fn merges(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Merging | VcmMode::Photon)
    }

    /// 1/Σ, if there are other ways.
    fn weight(&self, sum: impl FnOnce() -> f64) -> f32 {
        if matches!(self.mode, VcmMode::Photon | VcmMode::Light) { 1.0 } else { (1.0 / sum()) as f32 }
    }

    /// A ray is about to leave: the way that would connect its ends, if that is none of those used.
    fn leave(&self, path: &mut SubPath<'a>) {
        if !self.connects() {
            path.near = 0.0;
        }
    }

    /// A walk is at a vertex where another may be merged with it.
    fn may_merge(&self, path: &mut SubPath<'a>, vertex: &mut Vertex<'a>, now: &Now) {
        if now.eta > 0.0 && !vertex.bsdf.is_specular() {
            path.near += now.eta;
            vertex.near = path.near;
        }
    }

    /// The walk from the light: t = 1 and t = 0 on the way, its vertices kept.
    fn light_walk(&self, s: &Sample, tile: u32, walks: &mut Walks<'a>, work: &mut Work<'_>) {
        let (scene, camera, h, now) = (self.scene, self.scene.camera(), self.heuristic, work.now);
        let sampler = work.sampler;
        let dimensions = |number| light_dimensions(&sampler, s.pixel, s.index, number);
        let u = dimensions(0);
        let Some((emitter, probability)) = scene.light_sampler().source(u.value(SOURCE)) else { return };
        let emission = scene.emitters().emit(emitter, u.pair(POSITION), u.pair(DIRECTION));
        let to_lens = self.connects() || self.mode == VcmMode::Light;

        // s = 1, t = 1.
        if to_lens && let Some(seen) = see_source(scene, emitter, probability, &emission, u.pair(LENS), now.time) {
            work.rays.shadow += 1;
            if !scene.occluded(&seen.ray, true) {
                let weight = self.weight(|| {
                    // The direction towards the lens is another than the walk's.
                    let pdf = scene.emitters().emission_pdf(emitter, emission.normal, seen.sight.w);
                    let infinite = scene.emitters().is_infinite(emitter);
                    let (position, direction) = (pdf.position.0, pdf.direction.0);
                    let (here, on) = if infinite { (direction, position) } else { (position, direction) };
                    let by_eye = h.of(seen.sight.importance * seen.cos / (now.light_paths * here * probability));
                    by_eye + 1.0 + h.of(on * seen.sight.found)
                });
                work.sheets.splat(0, None, (seen.sight.raster, u.pair(PIXEL)), seen.light, weight);
            }
        }
        if !emission.weight.is_lit() {
            return;
        }

        let mut path = SubPath::from_light(scene, Some(h), emitter, probability, &emission, now.time);
        let first = walks.vertices.len();
        // Only through the lens do the longest paths have all their segments from here.
        let crosses = camera.has_lens() && to_lens;
        let longest = if crosses { self.max_depth } else { self.max_depth - 1 };
        while path.segments <= longest {
            self.leave(&mut path);
            work.rays.add(path.segments, 1);
            let hit = scene.intersect(&path.ray, true, false);
            let u = dimensions(path.segments);
            if crosses && (self.connects() || path.specular) {
                self.cross_lens(&path, hit.t, u.pair(PIXEL), &walks.vertices[first..], work);
            }
            if !is_hit(&hit) {
                return;
            }
            let mut vertex = path.arrive(&hit, &u);
            if path.segments >= self.max_depth {
                return;
            }
            self.may_merge(&mut path, &mut vertex, &now);
            if to_lens {
                let numbers = [u.pair(LENS), u.pair(PIXEL)];
                self.connect_to_lens(&vertex, &walks.vertices[first..], numbers, work);
            }
            if self.merges() && !vertex.bsdf.is_specular() {
                walks.lit.push(Lit {
                    p: vertex.surface.p.array(),
                    w: vertex.surface.wo.array(),
                    throughput: vertex.throughput.lane(0),
                    number: path.segments - 1,
                    near: vertex.near,
                    far: vertex.far,
                    tile,
                    place: walks.vertices.len() as u32,
                });
            }
            let goes_on = path.scatter(&mut vertex, &u, &self.ending);
            walks.vertices.push(vertex);
            if !goes_on {
                return;
            }
        }
    }

    /// t = 1, with what went before on the light's walk.
    fn connect_to_lens(
        &self,
        vertex: &Vertex<'a>,
        before: &[Vertex<'a>],
        [lens, pixel]: [[f32; 2]; 2],
        work: &mut Work<'_>,
    ) {
        let now = work.now;
        let Some((seen, value, last)) = see(self.scene, vertex, lens, now.time) else { return };
        let (h, sight) = (self.heuristic, seen.sight);
        let state = work.sheets.state(0, std::iter::once(last).chain(events_before(before)));
        if !work.sheets.counts(state) {
            return;
        }
        work.rays.shadow += 1;
        if self.scene.occluded(&seen.ray, true) {
            return;
        }
        let weight = self.weight(|| {
            let back = vertex.bsdf.eval(sight.w, vertex.surface.wo, TransportMode::Radiance, true).pdf.0;
            let by_eye = vertex.others(h, sight.importance * seen.cos / now.light_paths, back);
            by_eye + 1.0 + h.of(value.pdf.0 * sight.found)
        });
        work.sheets.splat(state, None, (sight.raster, pixel), seen.light, weight);
    }

    /// t = 0: light crosses the lens before it meets anything at distance `end`.
    fn cross_lens(&self, path: &SubPath<'a>, end: f32, pixel: [f32; 2], before: &[Vertex<'a>], work: &mut Work<'_>) {
        let (camera, h, now) = (self.scene.camera(), self.heuristic, work.now);
        let crossing = camera.crossing(path.origin(), path.direction(), now.time);
        if !crossing.mask || crossing.t >= end {
            return;
        }
        let state = work.sheets.state(0, events_before(before));
        let (g, lens) = (camera.density(path.direction(), now.time).0, camera.lens_pdf(now.time).0);
        let light = path.throughput() * (g * lens / crossing.cos);
        let weight = self.weight(|| {
            let per_cos = h.of(1.0 / crossing.cos);
            let distance = if path.from_far { 1.0 } else { h.of(crossing.t * crossing.t) };
            let by_eye = h.of(lens) * path.near * distance * per_cos
                + h.of(lens * g / now.light_paths) * path.far * per_cos;
            1.0 + by_eye
        });
        work.sheets.splat(state, None, (crossing.raster, pixel), light, weight);
    }

    /// The walk from the eye, connected and merged at every vertex.
    fn eye_walk(&self, s: &Sample, light: &[Vertex<'a>], band: &Band<'_, 'a>, work: &mut Work<'_>) {
        let (scene, now) = (self.scene, work.now);
        let [x, y, pixel, index] = [s.x, s.y, s.pixel, s.index].map(Index1);
        let eye = PathState::start_at(scene, &work.sampler, [x, y], pixel, index, Index1(0), Some(now.moment));
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), &eye, now.light_paths);
        if !self.connects() {
            path.far = 0.0;
        }
        let mut state = work.sheets.state(0, []);
        loop {
            self.leave(&mut path);
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
                self.may_merge(&mut path, &mut vertex, &now);
                if self.connects() {
                    self.ask_light(&path, &vertex, state, &u, work);
                    self.connect_walks(&path, &vertex, light, state, work);
                }
                if self.merges() {
                    self.merge(&path, &vertex, band, state, work);
                }
                if self.mode == VcmMode::Photon {
                    return;
                }
            }
            if !path.scatter(&mut vertex, &u, &self.ending) {
                return;
            }
            state = work.sheets.state(state, [vertex.event]);
        }
    }

    /// s = 0: the surroundings.
    fn escape(&self, path: &SubPath<'a>, state: u32, work: &mut Work<'_>) {
        let (scene, h, w) = (self.scene, self.heuristic, path.direction());
        for (number, environment) in &scene.emitters().environments {
            let (radiance, pdf) = environment.eval(w);
            if !radiance.is_lit() {
                continue;
            }
            let weight = self.weight(|| {
                let source = scene.light_sampler().source_probability(*number);
                let position = scene.emitters().emission_pdf(*number, Vec3::zero(), -w).position.0;
                let drawn = match path.segments {
                    // The eye draws no points of lights; parallel rays of it meet none that light draws.
                    1 if scene.camera().is_parallel() => 0.0,
                    1 => source,
                    _ => scene.light_sampler().probability(path.from, path.normal, Index1(*number), true),
                };
                1.0 + h.of(drawn * pdf.0) * path.near + h.of(source * pdf.0 * position) * path.far
            });
            work.sheets.add(state, None, path.throughput() * radiance, weight);
        }
    }

    /// s = 0: a surface that shines.
    fn hit_light(&self, path: &SubPath<'a>, vertex: &Vertex<'a>, state: u32, work: &mut Work<'_>) {
        let (scene, h, surface) = (self.scene, self.heuristic, &vertex.surface);
        let radiance = scene.emitted(surface, true);
        if !radiance.is_lit() {
            return;
        }
        let weight = self.weight(|| {
            let source = scene.light_sampler().source_probability(surface.emitter.0);
            let pdf = scene.emitters().emission_pdf(surface.emitter.0, surface.ng, surface.wo);
            let drawn = if path.segments == 1 {
                source * pdf.position.0
            } else {
                let choice = scene.light_sampler().probability(path.from, path.normal, surface.emitter, true);
                let hit = surface.seen_from(path.from);
                choice * scene.emitters().pdf(&hit, LightSampling::Area, true).to_area(hit.to, hit.normal).0
            };
            1.0 + h.of(drawn) * vertex.near + h.of(source * pdf.position.0 * pdf.direction.0) * vertex.far
        });
        work.sheets.add(state, None, vertex.throughput * radiance, weight);
    }

    /// s = 1: a point of a light, drawn for this vertex.
    fn ask_light(&self, path: &SubPath<'a>, vertex: &Vertex<'a>, state: u32, u: &Dimensions<f32>, work: &mut Work<'_>) {
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
        work.sheets.add(state, None, contribution, weight);
    }

    /// s ≥ 2 and t ≥ 2: to every vertex of the light's walk beside.
    fn connect_walks(
        &self,
        path: &SubPath<'a>,
        z: &Vertex<'a>,
        light: &[Vertex<'a>],
        state: u32,
        work: &mut Work<'_>,
    ) {
        let h = self.heuristic;
        // Segments: those of the eye's walk, the connection, and s − 1 of the light's.
        let most = (self.max_depth - path.segments - 1) as usize;
        for number in 0..light.len().min(most) {
            let y = &light[number];
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
            let brought = z.throughput * at_z.f * at_y.f * y.throughput * (cosines / d2);
            if !brought.is_lit() {
                continue;
            }
            let events = [z.bsdf.event(z.surface.wo, w).0, y.bsdf.event(y.surface.wo, -w).0];
            let state = work.sheets.state(state, events.into_iter().chain(events_before(&light[..number])));
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
            work.sheets.add(state, None, brought, weight);
        }
    }

    /// Merging: with every vertex of light within the radius.
    fn merge(&self, path: &SubPath<'a>, z: &Vertex<'a>, band: &Band<'_, 'a>, state: u32, work: &mut Work<'_>) {
        let (bsdf, wo, now) = (&z.bsdf, z.surface.wo, work.now);
        let longest = self.max_depth - path.segments;
        band.grid.within(z.surface.p.array(), |y, _| {
            if y.number + 1 > longest {
                return;
            }
            let w = Vec3::splat(y.w);
            let value = bsdf.eval(wo, w, TransportMode::Radiance, true);
            // Light is counted by the surface as it is, and reflected by the surface as it is shaded.
            let factor = (bsdf.normal().dot(w) / z.surface.ng.dot(w)).abs();
            let light = z.throughput * value.f * Rgb::splat(y.throughput) * (factor * now.scale);
            if !light.is_lit() || !factor.is_finite() {
                return;
            }
            let state = match &self.classes {
                None => state,
                Some(_) => {
                    let walk = &band.walks[(y.tile - band.first_tile) as usize].vertices;
                    let (place, number) = (y.place as usize, y.number as usize);
                    let events = std::iter::once(bsdf.event(wo, w).0);
                    work.sheets.state(state, events.chain(events_before(&walk[place - number..place])))
                }
            };
            if !work.sheets.counts(state) {
                return;
            }
            let weight = self.weight(|| {
                let back = bsdf.eval(w, wo, TransportMode::Importance, true).pdf.0;
                let by_light = z.near + self.heuristic.of(back) * z.far;
                let by_eye = y.near + self.heuristic.of(value.pdf.0) * y.far;
                (by_eye + by_light) / now.eta - 1.0
            });
            work.sheets.add(state, None, light, weight);
        });
    }

    /// One sample of each pixel of these tiles.
    fn band(
        &self,
        tiles: std::ops::Range<u64>,
        now: Now,
        grid: &mut PointGrid<Lit>,
        (film, pass, observer): (&Mutex<Film>, &Pass, &dyn Observer),
    ) -> Rays {
        let first_tile = tiles.start as u32;
        let count = (tiles.end - tiles.start) as usize;
        let walks: Mutex<Vec<Walks<'a>>> = Mutex::new((0..count).map(|_| Walks::default()).collect());
        let work = |tiles: &Tiles<'_>| Work {
            sampler: tiles.sampler(&self.sampler),
            sheets: Sheets::new(self.classes.as_ref(), self.scene.filter(), pass.region, 0),
            rays: Rays::default(),
            now,
        };

        // From the lights.
        let traced = Mutex::new(Rays::default());
        Tiles::only(film, pass, observer, tiles.clone()).run(|tiles| {
            while let Some(tile) = tiles.next() {
                let (mut work, mut own) = (work(tiles), Walks::default());
                let number = tiles.number(&tile);
                for s in tiles.samples_from(&tile, 0) {
                    self.light_walk(&s, number, &mut own, &mut work);
                    own.ends.push(own.vertices.len() as u32);
                    work.sheets.end_sample(s.slot, tile.weight);
                }
                tiles.splat(&tile, work.sheets.splats());
                traced.lock().unwrap_or_else(|e| e.into_inner()).merge(&work.rays);
                walks.lock().unwrap_or_else(|e| e.into_inner())[(number - first_tile) as usize] = own;
            }
        });
        let mut rays = traced.into_inner().unwrap_or_else(|e| e.into_inner());
        if observer.should_stop() {
            return rays;
        }
        let walks = walks.into_inner().unwrap_or_else(|e| e.into_inner());
        let parts: Vec<&[Lit]> = walks.iter().map(|w| &w.lit[..]).collect();
        grid.fill(&parts, now.radius, pass.threads);

        // From the eye.
        let band = Band { walks: &walks, grid, first_tile };
        rays.merge(&Tiles::only(film, pass, observer, tiles).run(|tiles| {
            while let Some(tile) = tiles.next() {
                let mut work = work(tiles);
                let own = &band.walks[(tiles.number(&tile) - first_tile) as usize];
                for s in tiles.samples_from(&tile, 0) {
                    if self.mode != VcmMode::Light {
                        self.eye_walk(&s, own.of(s.slot), &band, &mut work);
                    }
                    work.sheets.end_sample(s.slot, tile.weight);
                }
                tiles.done(&tile, work.sheets.own(), &mut work.rays);
            }
        }));
        rays
    }
}

/// The events of a walk from the light, the last first.
fn events_before(vertices: &[Vertex<'_>]) -> impl Iterator<Item = u32> {
    vertices.iter().rev().map(|v| v.event)
}

impl Integrator for Vcm<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let (mut rays, mut grid) = (Rays::default(), PointGrid::default());
        let camera = self.scene.camera();
        for iteration in pass.samples.clone() {
            // No walk has this number. What is merged must be at the same time.
            let u = light_dimensions(&self.sampler, u32::MAX, iteration, 0);
            let moment = if camera.has_shutter() { u.value(MOMENT) } else { 0.0 };
            let radius = shrunk(self.first_radius, self.alpha, iteration);
            let one = Pass { samples: iteration..iteration + 1, shares: None, ..pass.clone() };
            let all = Tiles::new(film, &one, observer).count();
            for first in (0..all).step_by(BAND as usize) {
                let tiles = first..all.min(first + BAND);
                let paths = Tiles::new(film, &one, observer).pixels(tiles.clone()) as f32;
                let eta = if self.merges() { self.heuristic.of(PI * radius * radius * paths) } else { 0.0 };
                let scale = 1.0 / (PI * radius * radius * paths);
                let light_paths = pass.region.pixels() as f32;
                let now = Now { time: camera.time(moment), moment, light_paths, radius, scale, eta };
                rays.merge(&self.band(tiles, now, &mut grid, (film, &one, observer)));
                if observer.should_stop() {
                    return rays;
                }
            }
        }
        rays
    }
}
