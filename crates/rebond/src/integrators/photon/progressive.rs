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

use super::emission::{Counts, Emission, Keep, Photon};
use super::{PhotonSettings, ask_light, found_light, look};
use crate::bsdf::Event;
use crate::film::{Batch, Film};
use crate::math::Rgb;
use crate::render::{Dimensions, Integrator, Observer, Pass, PathState, Rays, Sample, TILE, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, MOMENT, PER_BOUNCE, light_dimensions};
use crate::transport::{Kernel, PointGrid, Roulette, first_radius, shrunk};
use rebond_lanes::scalar::Index1;
use std::f32::consts::PI;
use std::num::NonZeroU32;
use std::sync::Mutex;

/// The estimator at work.
pub struct Progressive<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    photons: u32,
    first_radius: f32,
    alpha: f32,
    kernel: Kernel,
    max_depth: u32,
    counts: Mutex<Counts>,
}

/// What the samples of one iteration share.
struct Iteration<'a> {
    grid: &'a PointGrid<Photon>,
    moment: f32,
    radius: f32,
    /// 1/N.
    scale: f32,
}

/// A walk of the eye goes on once more, if at all.
const ALWAYS: Ending = Ending { roulette: Roulette::None, survival: 1.0, rr_depth: u32::MAX };

impl<'a> Progressive<'a> {
    pub fn new(settings: &PhotonSettings, scene: &'a Scene, sampler: Sampler) -> Self {
        Self {
            scene,
            sampler,
            photons: settings.photons.get(),
            first_radius: settings.radius.unwrap_or_else(|| first_radius(scene)),
            alpha: settings.alpha,
            kernel: settings.kernel,
            max_depth: settings.max_depth.map_or(u32::MAX, NonZeroU32::get),
            counts: Mutex::default(),
        }
    }

    /// L along a ray of the eye, times what it counts.
    fn radiance(&self, now: &Iteration, s: &Sample, sampler: &Sampler, rays: &mut Rays) -> Rgb<f32> {
        let [x, y, pixel, index] = [s.x, s.y, s.pixel, s.index].map(Index1);
        let eye = PathState::start_at(self.scene, sampler, [x, y], pixel, index, Index1(0), Some(now.moment));
        let (mut light, seen) = look(self.scene, &eye, self.max_depth, rays);
        let Some((mut path, mut vertex)) = seen else { return light };
        let longest = self.max_depth - path.segments;

        // Direct light: on glossy surfaces by directions as well.
        let u = Dimensions::new(eye.stream(), Index1(path.segments - 1), PER_BOUNCE);
        let (wo, n) = (vertex.surface.wo, vertex.bsdf.normal());
        let glossy = vertex.bsdf.event(wo, n).0 != Event::Diffuse as u32;
        light += ask_light(self.scene, &path, &vertex, &u, glossy, rays);

        // What photons bring.
        let (mut sum, inverse) = ([0.0; 3], 1.0 / (now.radius * now.radius));
        now.grid.within(vertex.surface.p.array(), |photon, d2| {
            if photon.segments <= longest {
                let weight = self.kernel.value(d2 * inverse);
                sum.iter_mut().zip(photon.reflected(&vertex)).for_each(|(sum, x)| *sum += x * weight);
            }
        });
        light += vertex.throughput * Rgb::splat(sum) * (inverse * now.scale / PI);

        if glossy && path.scatter(&mut vertex, &u, &ALWAYS) {
            rays.add(path.segments, 1);
            let hit = self.scene.intersect(&path.ray, true, false);
            let u = Dimensions::new(eye.stream(), Index1(path.segments - 1), PER_BOUNCE);
            let there = is_hit(&hit).then(|| path.arrive(&hit, &u));
            light += found_light(self.scene, &path, &vertex, there.as_ref());
        }
        light
    }
}

impl Integrator for Progressive<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let (mut all, mut grid) = (Rays::default(), PointGrid::default());
        for iteration in pass.samples.clone() {
            let camera = self.scene.camera();
            // No walk has this number.
            let u = light_dimensions(&self.sampler, u32::MAX, iteration, 0);
            let moment = if camera.has_shutter() { u.value(MOMENT) } else { 0.0 };
            let emission = Emission {
                scene: self.scene,
                sampler: self.sampler,
                max_depth: self.max_depth,
                keep: Keep::Indirect,
            };
            let Some(emitted) = emission.emit(self.photons, iteration, Some(moment), pass.threads, observer) else {
                break;
            };
            all.merge(&emitted.rays);
            self.counts.lock().unwrap_or_else(|e| e.into_inner()).merge(&emitted.counts);
            let radius = shrunk(self.first_radius, self.alpha, iteration);
            let parts: Vec<&[Photon]> = emitted.photons.iter().map(|p| &p[..]).collect();
            grid.fill(&parts, radius, pass.threads);
            let now = Iteration { grid: &grid, moment, radius, scale: 1.0 / emitted.counts.emitted.max(1) as f32 };

            let one = Pass { samples: iteration..iteration + 1, ..pass.clone() };
            all.merge(&Tiles::new(film, &one, observer).run(|tiles| {
                let (sampler, mut rays) = (tiles.sampler(&self.sampler), Rays::default());
                while let Some(tile) = tiles.next() {
                    let mut pixels = [Batch::default(); TILE];
                    for s in tiles.samples_from(&tile, 0) {
                        let light = self.radiance(&now, &s, &sampler, &mut rays);
                        pixels[s.slot as usize].add(light.lane(0), tile.weight);
                    }
                    tiles.done(&tile, &[pixels], &mut rays);
                }
            }));
        }
        all
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.counts.lock().unwrap_or_else(|e| e.into_inner()).named().to_vec()
    }
}
