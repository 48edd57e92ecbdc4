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
//! Pixels go in bands of up to 1024 tiles, each with the walks of its own pixels. A walk of light is connected to the eye's walk of its
//! pixel, then forgotten but for its particles, some 150 bytes for each vertex of up to 2¹⁸ walks, whatever the size of the picture:
//! those are what the next band is merged with, or the first of the next sample, so that walks are traced once. Where none were kept,
//! because rendering begins here, η changes, or the shutter is open for longer than a moment, those of the band before are traced for
//! their particles alone; the very first band merges with walks of no sample. Expectations do not depend on which walks these are. What
//! must be one is η, for weights to add up: it is that of the first of samples 2ʲ to 2ʲ⁺¹, and of a band of mean size, though radii
//! shrink and N may be another.
//!
//! Pixels that are merged with the same particles vary together, and a pixel's splats with what it is merged with a sample later: its
//! variance is some per cent more than the film says, that of a block of pixels may be half as much again (docs/decisions.md).
//!
//! | counted | |
//! |---|---|
//! | `light_walks` | walks from the light, those that were traced again too |
//! | `light_walks_lost` | those that left the scene before they met anything but mirrors and glass |
//! | `particles_stored` | vertices of walks that the eye's walks were merged with, or might have been |
//! | `particles_wasted` | those that no walk of the eye came near |

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::film::Film;
use crate::render::{
    Dimensions, Engine, Integrator, Observer, Pass, PathClasses, PathState, Rays, Samples, Tile, Tiles,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, LENS, MOMENT, PER_BOUNCE, PIXEL, light_dimensions};
use crate::transport::{
    Heuristic, NOT_BY_LIGHT, Neighbours, Particle, PointGrid, Roulette, Sheets, Source, SubPath, Vertex, Walk, Ways,
    first_radius, shrunk,
};
use rebond_bvh::Trace;
use rebond_lanes::scalar::Index1;
use rebond_lanes::{F32x16, Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::num::NonZeroU32;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

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
    /// The first radius; 0.3 % of half the diagonal of what the eye meets if not given.
    pub radius: Option<f32>,
    /// How much of the square of the radius a sample leaves; 3/4 if not given.
    pub alpha: Option<f32>,
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
            alpha: None,
            max_depth: None,
            rr_depth: 3,
            roulette: Roulette::default(),
            survival: 0.95,
            heuristic: Heuristic::default(),
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("mode", "ways to find a path: vcm, bidirectional, merging, photon or light; vcm"),
    ("radius", "the first radius of merging; 0.3 % of half the diagonal of what is seen"),
    ("alpha", "how slowly the radius shrinks, between 0 and 1; 0.75"),
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("rr_depth", "segments of either walk after which Russian roulette begins; 3"),
    ("roulette", "how walks end: none, constant, albedo or throughput; throughput"),
    ("survival", "probability of survival (constant), or the most it may be; 0.95"),
    ("heuristic", "how the ways to find a path are weighed: balance or power; power"),
];

impl VcmSettings {
    pub(super) fn leaves_out(&self) -> Option<String> {
        let by_depth = self.max_depth.map(|d| format!("paths of more than max_depth={d} segments are left out"));
        let by_mode = match self.mode {
            VcmMode::Light => Some(NOT_BY_LIGHT),
            VcmMode::Bidirectional => None,
            _ => Some("light is blurred by a radius that shrinks with every sample"),
        };
        let all: Vec<String> = by_depth.into_iter().chain(by_mode.map(String::from)).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

/// How much of the square of the radius a sample leaves, if nothing else is asked for.
const ALPHA: f32 = 0.75;

/// The sample whose walks the very first band is merged with. No picture has it: with those of sample 0, which the next sample is
/// merged with, these two would not be independent of each other.
const BEFORE_ALL: u32 = u32::MAX - 1;

/// Tiles of a band at most.
const BAND: u64 = 1024;

/// What the samples of a band share.
#[derive(Clone, Copy)]
struct Now {
    moment: f32,
    radius: f32,
    /// 1 / (π r² N).
    scale: f32,
    /// η; 0 if nothing is merged.
    eta: f32,
    /// Whether particles are kept for the next band.
    keeps: bool,
}

/// A band at one sample, and the sample and the band whose walks it is merged with.
struct Step {
    tiles: Range<u64>,
    before: (u32, Range<u64>),
}

/// What a worker keeps from sample to sample.
struct Work<'a, F: Real> {
    sampler: Sampler,
    now: Now,
    /// The light's walks.
    light: Walk<'a, F>,
    particles: Vec<Particle>,
    /// How many of light's walks were begun, and how many were lost.
    walks: u64,
    lost: u64,
    neighbours: Neighbours,
    ways: Ways<'a, F>,
    rays: Rays,
}

/// Memory that bands fill anew.
#[derive(Default)]
struct Kept {
    grid: PointGrid<Particle>,
    /// Those for the next band, by tile.
    particles: Vec<Vec<Particle>>,
    /// Lists of a tile's particles.
    spare: Vec<Vec<Particle>>,
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
    counts: Counts,
}

/// What became of light.
#[derive(Default)]
struct Counts {
    /// Walks traced from the light, repeated ones too.
    emitted: AtomicU64,
    /// Those that left the scene before they met anything but mirrors and glass.
    lost: AtomicU64,
    /// Particles that there were to merge with.
    stored: AtomicU64,
    /// Those that nothing was merged with.
    wasted: AtomicU64,
}

impl Counts {
    fn add(to: &AtomicU64, more: u64) {
        to.fetch_add(more, Ordering::Relaxed);
    }
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
        super::check_radius(radius, alpha.unwrap_or(ALPHA))?;
        if let VcmMode::Bidirectional | VcmMode::Light = mode
            && (radius.is_some() || alpha.is_some())
        {
            let name = if radius.is_some() { "radius" } else { "alpha" };
            let message = format!("{name} is a matter of merging, and this mode has none");
            return Err(IntegratorError { message, help: format!("leave out {name}, or use mode=vcm") });
        }
        let first_radius = radius.unwrap_or_else(|| first_radius(scene));
        let max_depth = max_depth.map_or(u32::MAX, NonZeroU32::get);
        let ending = Ending { roulette, survival, rr_depth };
        let alpha = alpha.unwrap_or(ALPHA);
        let counts = Counts::default();
        Ok(Self { scene, sampler, engine, mode, first_radius, alpha, max_depth, ending, heuristic, counts })
    }

    fn connects(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Bidirectional)
    }

    fn merges(&self) -> bool {
        matches!(self.mode, VcmMode::Vcm | VcmMode::Merging | VcmMode::Photon)
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

    /// The walks from the light: their vertices for the eye's walks beside, t = 1 and t = 0 on the way, unless they are `only` to leave
    /// particles.
    fn light_walk<F: Trace>(&self, samples: &Samples<F>, only: bool, work: &mut Work<'a, F>) {
        work.light.clear();
        work.walks += u64::from(samples.mask.count());
        let (scene, camera, sampler, now) = (self.scene, self.scene.camera(), work.sampler, work.now);
        let to_lens = !only && (self.connects() || self.mode == VcmMode::Light);
        let dimensions = |number| light_dimensions::<F>(&sampler, samples.pixel, samples.index, number);
        let numbers = |u: &Dimensions<F>| [u.pair(LENS), u.pair(PIXEL)];
        let u = dimensions(0);
        let time = camera.time(F::splat(now.moment));
        let Some(source) = Source::draw(scene, &u, time, samples.mask) else { return };
        if to_lens {
            work.ways.connect_source(&source, numbers(&u), time, samples.mask);
        }
        let mut path = SubPath::from_light(scene, Some(self.heuristic), &source, time);
        let mut alive = samples.mask & source.emission.weight.is_lit();
        let mut stored = F::Mask::splat(false);
        // Only through the lens do the longest paths have all their segments from here.
        let longest = if camera.has_lens() { self.max_depth } else { self.max_depth - 1 };
        while alive.any() && path.segments <= longest {
            self.leave(&mut path);
            work.rays.add(path.segments, alive.count());
            let hit = scene.intersect(&path.ray, alive, false);
            let u = dimensions(path.segments);
            if to_lens && camera.has_lens() {
                work.ways.cross_lens(&[], &path, hit.t, u.pair(PIXEL), alive);
            }
            work.lost += u64::from(alive.and_not(is_hit(&hit) | stored).count());
            alive = alive & is_hit(&hit);
            if alive.none() || path.segments >= self.max_depth {
                return;
            }
            let (vertex, _) = work.light.arrive(&mut path, &hit, &u, alive);
            let kept = vertex.mask.and_not(vertex.bsdf.is_specular());
            stored = stored | kept;
            if now.keeps || only {
                // Without the merging here, which is taken into account where it is done.
                Particle::keep(vertex, path.segments, kept, |_, particle| work.particles.push(particle));
            }
            self.may_merge(&mut path, vertex, &now);
            if to_lens {
                work.ways.connect_to_lens(&[], vertex, numbers(&u), time);
            }
            alive = path.scatter(vertex, &u, &self.ending);
        }
    }

    /// The walks from the eye, connected and merged at every vertex.
    fn eye_walk<F: Trace>(&self, samples: &Samples<F>, grid: &PointGrid<Particle>, work: &mut Work<'a, F>) {
        let (scene, now) = (self.scene, work.now);
        let Samples { x, y, pixel, index, slot, mask } = *samples;
        let moment = Some(F::splat(now.moment));
        let eye = PathState::start_at(scene, &work.sampler, [x, y], pixel, index, slot, moment);
        let mut path = SubPath::from_eye(scene, Some(self.heuristic), &eye, work.ways.light_paths);
        if !self.connects() {
            path.far = F::zero();
        }
        let (mut alive, state) = (mask, PathClasses::start::<F>());
        while alive.any() {
            self.leave(&mut path);
            let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
            work.rays.add(path.segments, alive.count());
            let hit = scene.meet(&path.ray, alive, path.segments == 1);
            let found = alive & is_hit(&hit);
            work.ways.escape(&path, state, alive.and_not(found));
            if found.none() {
                return;
            }
            let mut vertex = path.arrive(&hit, &u, found);
            let diffuse = found.and_not(vertex.bsdf.is_specular());
            if self.merges() {
                work.neighbours.ask(grid, vertex.surface.p, diffuse);
            }
            work.ways.hit_light(&path, &vertex, state);
            if path.segments >= self.max_depth {
                return;
            }
            if diffuse.any() {
                let without_merging = vertex.near;
                self.may_merge(&mut path, &mut vertex, &now);
                if self.connects() {
                    work.ways.ask_light(&path, &vertex, state, &u, diffuse);
                }
                if self.merges() {
                    work.neighbours.find(grid);
                }
                if self.connects() {
                    work.ways.connect_walks(work.light.vertices(), &path, &vertex, state, diffuse);
                }
                if self.merges() {
                    self.merge(&path, &vertex, without_merging, grid, work);
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

    /// Merging: with every particle within the radius that was asked for. A of neither walk, `near` that of the eye's, has the
    /// merging here in it.
    fn merge<F: Trace>(
        &self,
        path: &SubPath<'a, F>,
        z: &Vertex<'a, F>,
        near: F,
        grid: &PointGrid<Particle>,
        work: &mut Work<'a, F>,
    ) {
        let (h, now, longest) = (self.heuristic, work.now, self.max_depth - path.segments);
        let (ways, per_eta) = (&mut work.ways, F::splat(now.eta.recip()));
        work.neighbours.each(grid, longest, |y| {
            let (value, back) = z.eval_both_ways(y.w, TransportMode::Radiance, y.mask);
            let light = z.throughput * y.reflected(z, value.f) * F::splat(now.scale);
            let lit = y.mask & light.is_lit();
            if lit.none() {
                return;
            }
            let by_eye = h.sum(y.sums[0], value.pdf.0 * y.sums[1]) * per_eta;
            let by_light = h.sum(near, back * z.far) * per_eta;
            let weight = ways.weight([by_eye, by_light]);
            ways.sheets.add(PathClasses::start::<F>(), None, light, weight, lit);
        });
    }

    /// Has a worker on each thread do these tiles: `trace` is given samples, `done` tiles that have ended. Returns the rays, and
    /// the particles by tile.
    fn each_tile<F: Trace>(
        &'a self,
        tiles: &Tiles<'_>,
        (pass, now): (&Pass, Now),
        spare: &mut Vec<Vec<Particle>>,
        trace: impl Fn(&Tile, &Samples<F>, &mut Work<'a, F>) + Sync,
        done: impl Fn(&Tile, &Tiles<'_>, &mut Work<'a, F>) + Sync,
    ) -> (Rays, Vec<Vec<Particle>>) {
        let (particles, spare) = (Mutex::new(Vec::new()), Mutex::new(spare));
        let traced = Mutex::new(Rays::default());
        let rays = tiles.run(|tiles| {
            let mut work = Work {
                sampler: tiles.sampler(&self.sampler),
                now,
                light: Walk::default(),
                particles: Vec::new(),
                walks: 0,
                lost: 0,
                neighbours: Neighbours::default(),
                ways: Ways {
                    scene: self.scene,
                    heuristic: self.heuristic,
                    alone: matches!(self.mode, VcmMode::Photon | VcmMode::Light),
                    max_depth: self.max_depth,
                    light_paths: pass.region.pixels() as f32,
                    strategies: false,
                    sheets: Sheets::new(None, self.scene, pass.region, 0),
                },
                rays: Rays::default(),
            };
            while let Some(tile) = tiles.next() {
                work.particles = spare.lock().unwrap_or_else(|e| e.into_inner()).pop().unwrap_or_default();
                for samples in tiles.lanes_of::<F>(&tile) {
                    trace(&tile, &samples, &mut work);
                }
                done(&tile, tiles, &mut work);
                let own = std::mem::take(&mut work.particles);
                particles.lock().unwrap_or_else(|e| e.into_inner()).push((tiles.number(&tile), own));
            }
            Counts::add(&self.counts.emitted, work.walks);
            Counts::add(&self.counts.lost, work.lost);
            traced.lock().unwrap_or_else(|e| e.into_inner()).merge(&work.rays);
        });
        let mut all = traced.into_inner().unwrap_or_else(|e| e.into_inner());
        all.merge(&rays);
        let mut particles = particles.into_inner().unwrap_or_else(|e| e.into_inner());
        particles.sort_unstable_by_key(|(number, _)| *number);
        (all, particles.into_iter().map(|(_, own)| own).collect())
    }

    /// One sample of each pixel of a band.
    fn step<F: Trace>(
        &'a self,
        step: &Step,
        now: Now,
        kept: &mut Kept,
        to: (&Mutex<Film>, &Pass, &dyn Observer),
    ) -> Rays {
        let (film, pass, observer) = to;
        let mut rays = Rays::default();
        if self.merges() {
            if kept.particles.is_empty() {
                let before = Pass { samples: step.before.0..step.before.0 + 1, ..pass.clone() };
                let tiles = Tiles::only(film, &before, observer, step.before.1.clone());
                let walk =
                    |_: &Tile, samples: &Samples<F>, work: &mut Work<'a, F>| self.light_walk(samples, true, work);
                let (more, particles) = self.each_tile(&tiles, (&before, now), &mut kept.spare, walk, |_, _, _| ());
                rays.merge(&more);
                kept.particles = particles;
                if observer.should_stop() {
                    return rays;
                }
            }
            let parts: Vec<&[Particle]> = kept.particles.iter().map(|own| &own[..]).collect();
            kept.grid.fill(&parts, now.radius, pass.threads);
            Counts::add(&self.counts.stored, kept.grid.len() as u64);
            kept.particles.iter_mut().for_each(Vec::clear);
            kept.spare.append(&mut kept.particles);
        }
        let (grid, tiles) = (&kept.grid, Tiles::only(film, pass, observer, step.tiles.clone()));
        let trace = |tile: &Tile, samples: &Samples<F>, work: &mut Work<'a, F>| {
            if self.mode == VcmMode::Light || self.connects() || now.keeps {
                self.light_walk(samples, false, work);
            }
            if self.mode != VcmMode::Light {
                self.eye_walk(samples, grid, work);
            }
            work.ways.sheets.end_samples(samples.slot, samples.mask, tile.weight, &mut work.rays);
        };
        let (more, particles) = self.each_tile(&tiles, (pass, now), &mut kept.spare, trace, |tile, tiles, work| {
            tiles.splat(tile, work.ways.sheets.splats());
            tiles.done(tile, work.ways.sheets.own(), &mut work.rays);
            work.ways.sheets.clear();
        });
        rays.merge(&more);
        if self.merges() {
            Counts::add(&self.counts.wasted, kept.grid.unused() as u64);
        }
        // Without particles they are only memory.
        let to = if now.keeps { &mut kept.particles } else { &mut kept.spare };
        to.extend(particles);
        rays
    }
}

impl Integrator for Vcm<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let (mut rays, mut kept) = (Rays::default(), Kept::default());
        let camera = self.scene.camera();
        let one = |iteration| Pass { samples: iteration..iteration + 1, shares: None, ..pass.clone() };
        let all = Tiles::new(film, &one(0), observer).count();
        // Of one size, so that none has few particles.
        let size = all.div_ceil(all.div_ceil(BAND).max(1)).max(1);
        let bands = all.div_ceil(size).max(1);
        let band = |number: u64| number * size..all.min((number + 1) * size);
        let of_band = pass.region.pixels() as f32 / bands as f32;
        let eta_of = |iteration: u32| {
            let first = iteration.checked_ilog2().map_or(0, |j| 1 << j);
            let radius = shrunk(self.first_radius, self.alpha, first);
            if self.merges() { PI * radius * radius * of_band } else { 0.0 }
        };
        for iteration in pass.samples.clone() {
            let one = one(iteration);
            // No walk has this number. What is merged must be at the same time.
            let u = light_dimensions::<f32>(&self.sampler, Index1(iteration), Index1(u32::MAX), 0);
            let moment = if camera.has_shutter() { u.value(MOMENT) } else { 0.0 };
            let (radius, eta) = (shrunk(self.first_radius, self.alpha, iteration), eta_of(iteration));
            for number in 0..bands {
                let before = match number.checked_sub(1) {
                    Some(number) => (iteration, band(number)),
                    None if iteration > 0 => (iteration - 1, band(bands - 1)),
                    None => (BEFORE_ALL, band(bands - 1)),
                };
                let after = number + 1 < bands || (iteration + 1 < pass.samples.end && eta_of(iteration + 1) == eta);
                let walks = Tiles::new(film, &one, observer).pixels(before.1.clone());
                let area = PI * radius * radius * walks as f32;
                let keeps = self.merges() && after && !camera.has_shutter();
                let now = Now { moment, radius, scale: area.recip(), eta, keeps };
                let (step, to) = (Step { tiles: band(number), before }, (film, &one, observer));
                rays.merge(&match self.engine {
                    Engine::Wavefront => self.step::<F32x16>(&step, now, &mut kept, to),
                    Engine::Scalar => self.step::<f32>(&step, now, &mut kept, to),
                });
                if observer.should_stop() {
                    return rays;
                }
            }
        }
        rays
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        let Counts { emitted, lost, stored, wasted } = &self.counts;
        [
            ("light_walks", emitted),
            ("light_walks_lost", lost),
            ("particles_stored", stored),
            ("particles_wasted", wasted),
        ]
        .map(|(name, count)| (name, count.load(Ordering::Relaxed)))
        .to_vec()
    }
}
