//! Photon mapping with a radius that shrinks (Hachisuka, Ogaki, Jensen 2008; Hachisuka and Jensen 2009), as a mean of independent
//! iterations (Knaus and Zwicker 2011). Without bias in the limit.
//!
//! ```text
//! I ≈ 1/n Σ_i I_i        I_i: one camera ray per pixel, photons of iteration i within r_i of where it lands
//! ```
//!
//! Sample i of every pixel belongs to iteration i, whose photons and radius hang on i alone: so a pixel needs no state of its own,
//! and ranges of samples merge as those of every other integrator. Direct light is sampled, photons bring the rest. All that
//! happens in an iteration happens at one moment of the shutter.

use super::emission::{Counts, Emission, Keep};
use super::{ALPHA, ENDING, PhotonSettings, ask_light, found_light, look};
use crate::bsdf::{Event, TransportMode};
use crate::film::{Batch, Film};
use crate::math::Rgb;
use crate::render::{Dimensions, Engine, Integrator, Observer, Pass, PathState, Rays, Samples, TILE, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{MOMENT, PER_BOUNCE, light_dimensions};
use crate::transport::{Kernel, Neighbours, Particle, PointGrid, first_radius, shrunk};
use rebond_bvh::Trace;
use rebond_lanes::scalar::Index1;
use rebond_lanes::{F32x16, Index, Mask};
use std::f32::consts::PI;
use std::num::NonZeroU32;
use std::sync::Mutex;

/// The estimator at work.
pub struct Progressive<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    photons: u32,
    first_radius: f32,
    alpha: f32,
    kernel: Kernel,
    max_depth: u32,
    counts: Mutex<Counts>,
}

/// What the samples of one iteration share.
struct Iteration<'a> {
    grid: &'a PointGrid<Particle>,
    moment: f32,
    radius: f32,
    /// 1/N.
    scale: f32,
}

/// What a worker keeps from sample to sample.
struct Work {
    sampler: Sampler,
    neighbours: Neighbours,
    rays: Rays,
}

impl<'a> Progressive<'a> {
    pub fn new(settings: &PhotonSettings, scene: &'a Scene, sampler: Sampler, engine: Engine) -> Self {
        Self {
            scene,
            sampler,
            engine,
            photons: settings.photons.get(),
            first_radius: settings.radius.unwrap_or_else(|| first_radius(scene)),
            alpha: settings.alpha.unwrap_or(ALPHA),
            kernel: settings.kernel,
            max_depth: settings.max_depth.map_or(u32::MAX, NonZeroU32::get),
            counts: Mutex::default(),
        }
    }

    /// L along rays of the eye, times what it counts.
    fn radiance<F: Trace>(&self, now: &Iteration<'_>, samples: &Samples<F>, work: &mut Work) -> Rgb<F> {
        let Samples { x, y, pixel, index, slot, mask } = *samples;
        let scene = self.scene;
        let moment = Some(F::splat(now.moment));
        let eye = PathState::start_at(scene, &work.sampler, [x, y], pixel, index, slot, moment);
        let neighbours = &mut work.neighbours;
        look(scene, &eye, mask, self.max_depth, &mut work.rays, |path, vertex, rays| {
            let lands = vertex.mask;
            neighbours.ask(now.grid, vertex.surface.p, lands);

            // Direct light: on glossy surfaces by directions as well.
            let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
            let (wo, n) = (vertex.surface.wo, vertex.bsdf.normal());
            let glossy = lands & vertex.bsdf.event(wo, n).ne(F::Index::splat(Event::Diffuse as u32));
            let mut light = ask_light(scene, path, vertex, &u, glossy, lands, rays);
            neighbours.find(now.grid);

            // What photons bring.
            let (mut sum, inverse) = (Rgb::black(), 1.0 / (now.radius * now.radius));
            neighbours.each(now.grid, self.max_depth - path.segments, |near| {
                let f = vertex.eval(near.w, TransportMode::Radiance, near.mask).f;
                sum += near.reflected(vertex, f) * self.kernel.value(near.squared * inverse);
            });
            light += vertex.throughput * sum * F::splat(inverse * now.scale / PI);

            if glossy.any() {
                let (mut path, mut vertex) = (*path, *vertex);
                vertex.mask = glossy;
                let alive = path.scatter(&mut vertex, &u, &ENDING);
                if alive.any() {
                    rays.add(path.segments, alive.count());
                    let hit = scene.intersect(&path.ray, alive, false);
                    let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
                    let found = alive & is_hit(&hit);
                    if found.any() {
                        let there = path.arrive(&hit, &u, found);
                        light += found_light(scene, &path, &vertex, Some(&there), found);
                    }
                    let escaped = alive.and_not(found);
                    if escaped.any() {
                        light += found_light(scene, &path, &vertex, None, escaped);
                    }
                }
            }
            light
        })
    }

    fn run<F: Trace>(&self, now: &Iteration<'_>, tiles: &Tiles<'_>) {
        let sampler = tiles.sampler(&self.sampler);
        let mut work = Work { sampler, neighbours: Neighbours::default(), rays: Rays::default() };
        while let Some(tile) = tiles.next() {
            let mut pixels = [Batch::default(); TILE];
            for samples in tiles.lanes_of::<F>(&tile) {
                let light = self.radiance(now, &samples, &mut work);
                for lane in 0..samples.mask.count() as usize {
                    pixels[samples.slot.lane(lane) as usize].add(light.lane(lane), tile.weight);
                }
            }
            tiles.done(&tile, &[pixels], &mut work.rays);
        }
    }
}

impl Integrator for Progressive<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let (mut all, mut grid) = (Rays::default(), PointGrid::default());
        for iteration in pass.samples.clone() {
            let camera = self.scene.camera();
            // No walk has this number.
            let u = light_dimensions::<f32>(&self.sampler, Index1(iteration), Index1(u32::MAX), 0);
            let moment = if camera.has_shutter() { u.value(MOMENT) } else { 0.0 };
            let (scene, sampler, engine, max_depth) = (self.scene, self.sampler, self.engine, self.max_depth);
            let emission = Emission { scene, sampler, engine, max_depth, keep: Keep::Indirect };
            let Some(emitted) = emission.emit(self.photons, iteration, Some(moment), pass.threads, observer) else {
                break;
            };
            all.merge(&emitted.rays);
            self.counts.lock().unwrap_or_else(|e| e.into_inner()).merge(&emitted.counts);
            let radius = shrunk(self.first_radius, self.alpha, iteration);
            let parts: Vec<&[Particle]> = emitted.photons.iter().map(|p| &p[..]).collect();
            grid.fill(&parts, radius, pass.threads);
            let now = Iteration { grid: &grid, moment, radius, scale: 1.0 / emitted.counts.emitted.max(1) as f32 };
            let one = Pass { samples: iteration..iteration + 1, ..pass.clone() };
            all.merge(&Tiles::new(film, &one, observer).run(|tiles| match self.engine {
                Engine::Wavefront => self.run::<F32x16>(&now, tiles),
                Engine::Scalar => self.run::<f32>(&now, tiles),
            }));
        }
        all
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.counts.lock().unwrap_or_else(|e| e.into_inner()).named().to_vec()
    }
}
