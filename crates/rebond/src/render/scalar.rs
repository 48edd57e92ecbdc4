//! The reference engine: one path after the other.

use super::path_state::{PathState, Shade};
use super::tiles::{TILE, Tiles};
use super::{Integrator, Observer, Pass};
use crate::film::{Batch, Film};
use crate::sampling::Sampler;
use crate::scene::Scene;
use rebond_lanes::scalar::Index1;
use std::sync::Mutex;

pub struct Scalar<'a, S> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
    pub shade: S,
}

impl<S: Shade> Scalar<'_, S> {
    /// The radiance of one path, and the rays it took.
    fn trace(&self, mut path: PathState<f32>) -> ([f32; 3], u64) {
        let mut rays = 0;
        loop {
            let hit = self.scene.intersect(&path.ray(), true, true);
            rays += 1;
            let bounce = self.shade.shade(self.scene, &mut path, &hit, true);
            if let Some(shadow) = bounce.shadow.filter(|s| s.mask) {
                rays += 1;
                let blocked = self.scene.occluded(&shadow.ray, true);
                path.add_contribution(shadow.contribution, !blocked);
            }
            if !bounce.alive {
                return (path.radiance().lane(0), rays);
            }
        }
    }
}

impl<S: Shade> Integrator for Scalar<'_, S> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> u64 {
        Tiles::new(film, pass, observer).run(|tiles| {
            while let Some(tile) = tiles.next() {
                let (mut pixels, mut rays) = ([Batch::default(); TILE], 0);
                for s in tiles.samples_from(&tile, 0) {
                    let [x, y, pixel, index, slot] = [s.x, s.y, s.pixel, s.index, s.slot].map(Index1);
                    let path = PathState::start(self.scene, &self.sampler, x, y, pixel, index, slot);
                    let (radiance, its_rays) = self.trace(path);
                    pixels[s.slot as usize].add(radiance);
                    rays += its_rays;
                }
                tiles.done(&tile, &pixels, rays);
            }
        })
    }
}
