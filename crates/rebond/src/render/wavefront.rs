//! The production engine: a wave of paths in SIMD lanes.
//!
//! The paths of a wave lie side by side in columns, one per field. Each round fills the wave up with new paths, then
//! takes group after group of sixteen through one bounce; those that live on are written back without gaps, those that
//! end are added to their pixels.

use super::path_state::{FIELDS, PathState, Shade};
use super::tiles::{Sample, TILE, Tile, Tiles};
use super::{Integrator, Observer, Pass};
use crate::film::{Batch, Film};
use crate::sampling::Sampler;
use crate::scene::Scene;
use rebond_lanes::{F32x16, Index, Mask, Real};
use std::sync::Mutex;

/// Paths in a wave.
const WAVE: usize = 1024;
/// Length of a column: compressing sixteen lanes may write past the last path.
const STRIDE: usize = WAVE + LANES;
const LANES: usize = F32x16::LANES;

pub struct Wavefront<'a, S> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
    pub shade: S,
}

impl<S: Shade> Integrator for Wavefront<'_, S> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> u64 {
        Tiles::new(film, pass, observer).run(|tiles| Worker::new(self, tiles).run())
    }
}

/// A tile some of whose paths are under way.
struct OpenTile {
    tile: Tile,
    pixels: [Batch; TILE],
    /// Samples not yet finished.
    left: u32,
}

struct Worker<'a, S> {
    engine: &'a Wavefront<'a, S>,
    tiles: &'a Tiles<'a>,
    columns: Vec<f32>,
    paths: usize,
    open: Vec<Option<Box<OpenTile>>>,
    /// The tile that new paths come from: its place in `open`, and its next sample.
    source: Option<(usize, u32)>,
    rays: u64,
}

impl<'a, S: Shade> Worker<'a, S> {
    fn new(engine: &'a Wavefront<'a, S>, tiles: &'a Tiles<'a>) -> Self {
        Self { engine, tiles, columns: vec![0.0; FIELDS * STRIDE], paths: 0, open: Vec::new(), source: None, rays: 0 }
    }

    fn run(&mut self) {
        loop {
            let under_way = self.paths;
            self.refill();
            if self.paths == 0 {
                return;
            }
            let (paths, mut kept) = (self.paths, 0);
            for at in (0..paths).step_by(LANES) {
                let active = <F32x16 as Real>::Mask::from_bits(((1_u64 << (paths - at).min(LANES)) - 1) as u32);
                kept += self.bounce(at, active, at >= under_way, kept);
            }
            self.paths = kept;
        }
    }

    /// Takes one group a bounce further; writes those that live on at `to`, and returns how many they are.
    fn bounce(&mut self, at: usize, active: <F32x16 as Real>::Mask, coherent: bool, to: usize) -> usize {
        let scene = self.engine.scene;
        let mut path = PathState::<F32x16>::load(&self.columns, STRIDE, at, &self.engine.sampler);
        let hit = scene.intersect(&path.ray(), active, coherent);
        self.rays += u64::from(active.count());
        let bounce = self.engine.shade.shade(scene, &mut path, &hit, active);
        if let Some(shadow) = bounce.shadow {
            let blocked = scene.occluded(&shadow.ray, shadow.mask);
            path.add_contribution(shadow.contribution, shadow.mask.and_not(blocked));
            self.rays += u64::from(shadow.mask.count());
        }
        let ended = active.and_not(bounce.alive);
        if ended.any() {
            self.finish(&path, ended.bits());
        }
        path.compress(bounce.alive & active, &mut self.columns, STRIDE, to)
    }

    /// Adds the paths of these lanes to their pixels.
    #[inline(always)]
    fn finish(&mut self, path: &PathState<F32x16>, mut lanes: u32) {
        let [mut r, mut g, mut b, mut slot] = [[0.0; LANES]; 4];
        path.lr.store(&mut r);
        path.lg.store(&mut g);
        path.lb.store(&mut b);
        F32x16::from_bits(path.slot).store(&mut slot);
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let slot = slot[lane].to_bits() as usize;
            let place = &mut self.open[slot / TILE];
            let open = place.as_mut().expect("paths of an open tile");
            open.pixels[slot % TILE].add([r[lane], g[lane], b[lane]]);
            open.left -= 1;
            if open.left == 0 {
                self.tiles.done(&open.tile, &open.pixels, std::mem::take(&mut self.rays));
                *place = None;
            }
        }
    }

    /// New paths, until the wave is full or there are no more.
    fn refill(&mut self) {
        while self.paths < WAVE {
            let Some((place, next)) = self.source.or_else(|| self.open_tile()) else { return };
            let tile = self.open[place].as_ref().expect("the source is open").tile.clone();
            let total = self.tiles.samples_of(&tile);
            let n = (total - next).min((WAVE - self.paths).min(LANES) as u32);
            self.start(place, &tile, next, n);
            self.source = (next + n < total).then_some((place, next + n));
        }
    }

    fn open_tile(&mut self) -> Option<(usize, u32)> {
        let tile = self.tiles.next()?;
        let left = self.tiles.samples_of(&tile);
        let open = Some(Box::new(OpenTile { tile, pixels: [Batch::default(); TILE], left }));
        let place = match self.open.iter().position(Option::is_none) {
            Some(free) => free,
            None => {
                self.open.push(None);
                self.open.len() - 1
            }
        };
        self.open[place] = open;
        Some((place, 0))
    }

    /// Samples `first..first + n` of a tile, n ≤ 16.
    fn start(&mut self, place: usize, tile: &Tile, first: u32, n: u32) {
        let mut samples = [Sample::default(); LANES];
        for (place, sample) in samples.iter_mut().zip(self.tiles.samples_from(tile, first)) {
            *place = sample;
        }
        let gather =
            |f: &dyn Fn(usize) -> u32| (0..LANES).fold(<F32x16 as Real>::Index::splat(0), |v, i| v.with_lane(i, f(i)));
        let path = PathState::<F32x16>::start(
            self.engine.scene,
            &self.engine.sampler,
            gather(&|i| samples[i].x),
            gather(&|i| samples[i].y),
            gather(&|i| samples[i].pixel),
            gather(&|i| samples[i].index),
            gather(&|i| samples[i].slot + (place * TILE) as u32),
        );
        let mask = Mask::from_bits(((1_u64 << n) - 1) as u32);
        self.paths += path.compress(mask, &mut self.columns, STRIDE, self.paths);
    }
}
