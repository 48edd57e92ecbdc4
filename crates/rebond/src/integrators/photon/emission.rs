//! Photons on their way from the lights.
//!
//! ```text
//! Φ_p = Le |cosθ| / (pdf(point) pdf(direction)) · Π f_r |cosθ| / (pdf q) / N        in W, where photon p of N walks arrives
//! ```
//!
//! A walk leaves one at each surface it meets that scatters in more than single directions, and ends by Russian roulette with the
//! albedo, so that photons hardly differ in power.

use crate::bsdf::TransportMode;
use crate::math::Vec3;
use crate::render::{Observer, Rays, in_order};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{DIRECTION, Ending, MOMENT, POSITION, SOURCE, light_dimensions};
use crate::transport::{Placed, Roulette, SubPath, Vertex};

/// How walks end.
const ENDING: Ending = Ending { roulette: Roulette::Albedo, survival: 0.95, rr_depth: 1 };
/// Walks of one job.
const JOB: u32 = 1024;
/// Jobs between two looks at how many photons there are.
const ROUND: u32 = 256;
/// Photons after which no further walk is begun, and N is what was begun: 1.1 GB in their tree, thrice that while it is filled.
const MOST: u64 = 1 << 24;

/// A photon where it is stored.
#[derive(Clone, Copy, Debug)]
pub struct Photon {
    /// Where.
    pub p: [f32; 3],
    /// Segments of its path of light.
    pub segments: u32,
    /// Unit direction to where it came from.
    pub w: Vec3<f32>,
    /// Geometric normal of the surface, on that side.
    pub normal: Vec3<f32>,
    /// N Φ_p.
    pub power: [f32; 3],
}

impl Default for Photon {
    fn default() -> Self {
        Self { p: [0.0; 3], segments: 0, w: Vec3::zero(), normal: Vec3::zero(), power: [0.0; 3] }
    }
}

impl Placed for Photon {
    fn place(&self) -> [f32; 3] {
        self.p
    }
}

impl Photon {
    /// f_r Φ_p N of it for the eye at a vertex near by. The estimate is one of flux through the surface as it is, radiance is
    /// reflected by the surface as it is shaded: so cosines differ.
    #[inline(always)]
    pub fn reflected(&self, vertex: &Vertex<'_>) -> [f32; 3] {
        let f = vertex.bsdf.eval(vertex.surface.wo, self.w, TransportMode::Radiance, true).f;
        let factor = (vertex.bsdf.normal().dot(self.w) / vertex.surface.ng.dot(self.w)).abs();
        let [r, g, b] = self.power;
        if factor.is_finite() { [f.r * r * factor, f.g * g * factor, f.b * b * factor] } else { [0.0; 3] }
    }
}

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
    /// By job.
    pub photons: Vec<Vec<Photon>>,
    pub counts: Counts,
    pub rays: Rays,
}

/// What emits them.
#[derive(Clone, Copy)]
pub struct Emission<'a> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
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
                let mut emitted = (Vec::new(), Counts::default(), Rays::default());
                if !observer.should_stop() {
                    (start..walks.min(start + JOB)).for_each(|walk| self.walk(walk, sequence, moment, &mut emitted));
                }
                emitted
            };
            for (photons, counts, rays) in in_order((jobs - first).min(ROUND) as usize, threads, job) {
                all.photons.push(photons);
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

    fn walk(
        &self,
        number: u32,
        sequence: u32,
        moment: Option<f32>,
        (photons, counts, rays): &mut (Vec<Photon>, Counts, Rays),
    ) {
        let (scene, camera) = (self.scene, self.scene.camera());
        let dimensions = |bounce| light_dimensions(&self.sampler, number, sequence, bounce);
        counts.emitted += 1;
        let before = photons.len();
        let u = dimensions(0);
        if let Some((emitter, probability)) = scene.light_sampler().source(u.value(SOURCE)) {
            let moment = moment.unwrap_or_else(|| if camera.has_shutter() { u.value(MOMENT) } else { 0.0 });
            let emission = scene.emitters().emit(emitter, u.pair(POSITION), u.pair(DIRECTION));
            let mut path = SubPath::from_light(scene, None, emitter, probability, &emission, camera.time(moment));
            let mut mirrored = true;
            while emission.weight.is_lit() && path.segments <= self.max_depth {
                rays.add(path.segments, 1);
                let hit = scene.intersect(&path.ray, true, false);
                if !is_hit(&hit) {
                    counts.lost += 1;
                    break;
                }
                let u = dimensions(path.segments);
                let mut vertex = path.arrive(&hit, &u);
                if !vertex.bsdf.is_specular() {
                    let kept = match self.keep {
                        Keep::All => true,
                        Keep::Indirect => path.segments > 1,
                        Keep::Caustic => path.segments > 1 && mirrored,
                    };
                    if kept {
                        photons.push(photon(&vertex, path.segments));
                    }
                    mirrored = false;
                    if self.keep == Keep::Caustic {
                        break;
                    }
                }
                if !path.scatter(&mut vertex, &u, &ENDING) {
                    break;
                }
            }
        }
        counts.stored += (photons.len() - before) as u64;
        counts.wasted += u64::from(photons.len() == before);
    }
}

fn photon(vertex: &Vertex<'_>, segments: u32) -> Photon {
    let surface = &vertex.surface;
    Photon {
        p: surface.p.array(),
        segments,
        w: surface.wo,
        normal: surface.ng.facing(surface.wo),
        power: vertex.throughput.lane(0),
    }
}
