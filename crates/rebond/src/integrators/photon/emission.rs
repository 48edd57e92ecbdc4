//! Photons on their way from the lights.
//!
//! ```text
//! Φ_p = Le |cosθ| / (pdf(point) pdf(direction)) · Π f_r |cosθ| / (pdf q) / N        in W, where photon p of N walks arrives
//! ```
//!
//! A walk leaves one at each surface it meets that scatters in more than single directions, and ends by Russian roulette with the
//! albedo, so that photons hardly differ in power.

use crate::math::Vec3;
use crate::render::{Engine, Observer, Rays, in_order};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, MOMENT, light_dimensions};
use crate::transport::{Particle, Roulette, Source, SubPath};
use rebond_bvh::Trace;
use rebond_lanes::{F32x16, Index, Mask};

/// How walks end.
const ENDING: Ending = Ending { roulette: Roulette::Albedo, survival: 0.95, rr_depth: 1 };
/// Walks of one job.
const JOB: u32 = 1024;
/// Jobs between two looks at how many photons there are.
const ROUND: u32 = 256;
/// Photons after which no further walk is begun, and N is what was begun. In their tree they take 76 bytes or up to twice that,
/// more than twice as much while it is filled: with twice this number 6 GB were measured.
const MOST: u64 = 1 << 23;

/// Which photons are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// All.
    All,
    /// All but those that come from the light directly.
    Indirect,
    /// Those that met mirrors and glass only, and some of it.
    Caustic,
}

/// What became of walks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Walks begun.
    pub emitted: u64,
    /// Photons stored.
    pub stored: u64,
    /// Walks that left the scene.
    pub lost: u64,
    /// Walks that stored nothing.
    pub wasted: u64,
}

impl Counts {
    /// For reports.
    pub fn named(&self) -> [(&'static str, u64); 4] {
        [
            ("photons_emitted", self.emitted),
            ("photons_stored", self.stored),
            ("photons_lost", self.lost),
            ("photons_wasted", self.wasted),
        ]
    }

    pub fn merge(&mut self, other: &Self) {
        self.emitted += other.emitted;
        self.stored += other.stored;
        self.lost += other.lost;
        self.wasted += other.wasted;
    }
}

/// Photons, in the order of their walks.
#[derive(Default)]
pub struct Emitted {
    /// By job; N times their power.
    pub photons: Vec<Vec<Particle>>,
    /// Geometric normals where they lie, on their side.
    pub normals: Vec<Vec<Vec3<f32>>>,
    pub counts: Counts,
    pub rays: Rays,
}

/// What one job emits.
#[derive(Default)]
struct Job {
    photons: Vec<Particle>,
    normals: Vec<Vec3<f32>>,
    counts: Counts,
    rays: Rays,
}

/// What emits them.
#[derive(Clone, Copy)]
pub struct Emission<'a> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
    pub engine: Engine,
    pub max_depth: u32,
    pub keep: Keep,
}

impl Emission<'_> {
    /// Photons of so many walks, by the sequence of this number; at one moment of the shutter, or at their own. `None` if it was
    /// told to stop.
    pub fn emit(
        &self,
        walks: u32,
        sequence: u32,
        moment: Option<f32>,
        threads: usize,
        observer: &dyn Observer,
    ) -> Option<Emitted> {
        let jobs = walks.div_ceil(JOB);
        let mut all = Emitted::default();
        for first in (0..jobs).step_by(ROUND as usize) {
            let job = |number: usize| {
                let start = (first + number as u32) * JOB;
                let (walks, mut job) = (start..walks.min(start.saturating_add(JOB)), Job::default());
                if !observer.should_stop() {
                    match self.engine {
                        Engine::Wavefront => self.walks::<F32x16>(walks, sequence, moment, &mut job),
                        Engine::Scalar => self.walks::<f32>(walks, sequence, moment, &mut job),
                    }
                }
                job
            };
            for Job { photons, normals, counts, rays } in in_order((jobs - first).min(ROUND) as usize, threads, job) {
                all.photons.push(photons);
                all.normals.push(normals);
                all.counts.merge(&counts);
                all.rays.merge(&rays);
            }
            if observer.should_stop() {
                return None;
            }
            if all.counts.stored >= MOST {
                break;
            }
        }
        Some(all)
    }

    fn walks<F: Trace>(&self, numbers: std::ops::Range<u32>, sequence: u32, moment: Option<f32>, job: &mut Job) {
        let lane = (0..F::LANES).fold(F::Index::splat(0), |v, i| v.with_lane(i, i as u32));
        for first in numbers.clone().step_by(F::LANES) {
            let number = F::Index::splat(first) + lane;
            self.walk::<F>(number, number.lt(F::Index::splat(numbers.end)), sequence, moment, job);
        }
    }

    fn walk<F: Trace>(&self, number: F::Index, mask: F::Mask, sequence: u32, moment: Option<f32>, job: &mut Job) {
        let (scene, camera) = (self.scene, self.scene.camera());
        let dimensions = |bounce| light_dimensions::<F>(&self.sampler, number, F::Index::splat(sequence), bounce);
        let u = dimensions(0);
        let drawn = || if camera.has_shutter() { u.value(MOMENT) } else { F::zero() };
        let time = camera.time(moment.map_or_else(drawn, F::splat));
        let mut kept_any = F::Mask::splat(false);
        if let Some(source) = Source::draw(scene, &u, time, mask) {
            let mut path = SubPath::from_light(scene, None, &source, time);
            let (mut alive, mut mirrored) = (mask & source.emission.weight.is_lit(), mask);
            while alive.any() && path.segments <= self.max_depth {
                job.rays.add(path.segments, alive.count());
                let hit = scene.intersect(&path.ray, alive, false);
                let found = alive & is_hit(&hit);
                job.counts.lost += u64::from(alive.and_not(found).count());
                if found.none() {
                    break;
                }
                let u = dimensions(path.segments);
                let mut vertex = path.arrive(&hit, &u, found);
                let lands = found.and_not(vertex.bsdf.is_specular());
                let kept = match self.keep {
                    Keep::All => lands,
                    _ if path.segments == 1 => F::Mask::splat(false),
                    Keep::Indirect => lands,
                    Keep::Caustic => lands & mirrored,
                };
                if kept.any() {
                    let normal = vertex.surface.ng.facing(vertex.surface.wo);
                    Particle::keep(&vertex, path.segments, kept, |lane, particle| {
                        job.photons.push(particle);
                        let [x, y, z] = normal.lane(lane);
                        job.normals.push(Vec3 { x, y, z });
                    });
                    job.counts.stored += u64::from(kept.count());
                    kept_any = kept_any | kept;
                }
                mirrored = mirrored.and_not(lands);
                if self.keep == Keep::Caustic {
                    vertex.mask = found.and_not(lands);
                    if vertex.mask.none() {
                        break;
                    }
                }
                alive = path.scatter(&mut vertex, &u, &ENDING);
            }
        }
        job.counts.emitted += u64::from(mask.count());
        job.counts.wasted += u64::from(mask.and_not(kept_any).count());
    }
}
