//! The reference engine: one path after the other.

use super::bounce::{bounce, trace};
use super::journal::{Journal, Story};
use super::path_classes::PathClasses;
use super::path_state::{PathState, Shade};
use super::tiles::{TILE, Tiles};
use super::{Integrator, Observer, Pass, Rays};
use crate::film::{Batch, Film};
use crate::math::Rgb;
use crate::sampling::Sampler;
use crate::scene::Scene;
use rebond_lanes::scalar::Index1;
use std::sync::Mutex;

pub struct Scalar<'a, S> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
    pub shade: S,
    pub classes: Option<PathClasses>,
}

impl<S: Shade> Scalar<'_, S> {
    /// The radiance of one path; adds its light by layers, and the rays it took.
    fn trace(
        &self,
        mut path: PathState<f32>,
        layers: &mut [[f32; 3]],
        rays: &mut Rays,
        journal: &mut impl Journal,
    ) -> [f32; 3] {
        loop {
            let depth = path.depth.0;
            let deposit = |_: &PathState<f32>, layer: Index1, light: Rgb<f32>| {
                if let Some(sum) = (layer.0 as usize).checked_sub(1).and_then(|l| layers.get_mut(l)) {
                    sum.iter_mut().zip(light.lane(0)).for_each(|(s, x)| *s += x);
                }
            };
            let classes = self.classes.as_ref();
            let hit = trace(self.scene, &path, true, true);
            let step = bounce(self.scene, &self.shade, classes, &mut path, &hit, true, deposit, journal);
            rays.add(depth, 1);
            rays.shadow += u64::from(step.shadow_rays);
            if !step.alive {
                return path.radiance().lane(0);
            }
        }
    }
}

impl<S: Shade> Integrator for Scalar<'_, S> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let layers = self.classes.as_ref().map_or(0, PathClasses::layers);
        Tiles::new(film, pass, observer).run(|tiles| {
            let sampler = tiles.sampler(&self.sampler);
            while let Some(tile) = tiles.next() {
                let mut pixels = vec![[Batch::default(); TILE]; 1 + layers];
                let mut rays = Rays::default();
                for s in tiles.samples_from(&tile, 0) {
                    let [x, y, pixel, index, slot] = [s.x, s.y, s.pixel, s.index, s.slot].map(Index1);
                    let path = PathState::start(self.scene, &sampler, x, y, pixel, index, slot);
                    let mut by_layer = vec![[0.0; 3]; layers];
                    let radiance = self.trace(path, &mut by_layer, &mut rays, &mut ());
                    for (batches, light) in pixels.iter_mut().zip(std::iter::once(radiance).chain(by_layer)) {
                        batches[s.slot as usize].add(light, tile.weight);
                    }
                }
                tiles.done(&tile, &pixels, &mut rays);
            }
        })
    }

    fn tell(&self, pixel: [u32; 2], full_width: u32, sample: u32) -> Option<Story> {
        let number = pixel[1].wrapping_mul(full_width).wrapping_add(pixel[0]);
        let [x, y, number, index, slot] = [pixel[0], pixel[1], number, sample, 0].map(Index1);
        let path = PathState::start(self.scene, &self.sampler, x, y, number, index, slot);
        let mut vertices = Vec::new();
        let radiance = self.trace(path, &mut [], &mut Rays::default(), &mut vertices);
        Some(Story { vertices, radiance })
    }
}
