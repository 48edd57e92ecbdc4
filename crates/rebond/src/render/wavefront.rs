//! The production engine: a wave of paths in SIMD lanes.
//!
//! The paths of a wave lie side by side in columns, one per field. Each round fills the wave up with new paths, then
//! takes group after group of sixteen through one bounce; those that live on are written back without gaps, those that
//! end are added to their pixels. Where many rays of a group leave the scene, the paths of the others wait for more of
//! their kind between ray and surface.

use super::bounce::{bounce, trace};
use super::path_classes::PathClasses;
use super::path_state::{FIELDS, PathState, Shade};
use super::tiles::{Sample, TILE, Tile, Tiles, VISIT};
use super::{Integrator, Observer, Pass, Rays};
use crate::film::{Batch, Film};
use crate::math::Rgb;
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use rebond_bvh::Hit;
use rebond_lanes::{F32x16, Index, Mask, Real};
use std::sync::Mutex;

/// Paths in a wave.
const WAVE: usize = 1024;
/// Length of a column: compressing sixteen lanes may write past the last path.
const STRIDE: usize = WAVE + LANES;
const LANES: usize = F32x16::LANES;
/// Paths of a group that suffice for going on without others.
const ENOUGH: u32 = 12;

type Lanes = <F32x16 as Real>::Mask;

pub struct Wavefront<'a, S> {
    pub scene: &'a Scene,
    pub sampler: Sampler,
    pub shade: S,
    pub classes: Option<PathClasses>,
}

impl<S: Shade> Integrator for Wavefront<'_, S> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| Worker::new(self, tiles).run())
    }
}

/// A tile some of whose paths are under way.
struct OpenTile {
    tile: Tile,
    /// Sums of the picture, and of each layer.
    pixels: Vec<[Batch; TILE]>,
    /// Light of each sample by layers; see [`OpenTile::place`].
    layers: Vec<[f32; 3]>,
    /// Samples not yet finished.
    left: u32,
}

impl OpenTile {
    fn new(tile: Tile, left: u32, layers: usize) -> Self {
        let of_samples = vec![[0.0; 3]; layers * TILE * VISIT as usize];
        Self { tile, pixels: vec![[Batch::default(); TILE]; 1 + layers], layers: of_samples, left }
    }

    /// Where the light of a sample in a layer is kept.
    fn place(&self, layer: usize, pixel: usize, sample: u32) -> usize {
        (layer * TILE + pixel) * VISIT as usize + (sample - self.tile.samples.start) as usize
    }

    /// Hands the light of all samples over to the sums of the layers.
    fn sum_layers(&mut self) {
        for (layer, sums) in self.pixels[1..].iter_mut().enumerate() {
            for (pixel, sum) in sums[..(self.tile.width * self.tile.height) as usize].iter_mut().enumerate() {
                let first = (layer * TILE + pixel) * VISIT as usize;
                for light in &self.layers[first..first + self.tile.samples.len()] {
                    sum.add(*light, self.tile.weight);
                }
            }
        }
    }
}

struct Worker<'a, S> {
    engine: &'a Wavefront<'a, S>,
    tiles: &'a Tiles<'a>,
    sampler: Sampler,
    columns: Vec<f32>,
    paths: usize,
    waiting: Waiting,
    open: Vec<Option<Box<OpenTile>>>,
    /// The tile that new paths come from: its place in `open`, and its next sample.
    source: Option<(usize, u32)>,
    rays: Rays,
}

impl<'a, S: Shade> Worker<'a, S> {
    fn new(engine: &'a Wavefront<'a, S>, tiles: &'a Tiles<'a>) -> Self {
        let (columns, rays) = (vec![0.0; FIELDS * STRIDE], Rays::default());
        Self {
            engine,
            tiles,
            sampler: tiles.sampler(&engine.sampler),
            columns,
            paths: 0,
            waiting: Waiting::new(),
            open: Vec::new(),
            source: None,
            rays,
        }
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
                kept = self.trace(at, first_lanes(paths - at), at >= under_way, kept);
                kept = self.shade_waiting(LANES, kept);
            }
            kept = self.shade_waiting(1, kept);
            self.paths = kept;
        }
    }

    /// Traces the rays of one group. Paths whose bounce is over already and which live on are written at `to`; returns where
    /// they end.
    fn trace(&mut self, at: usize, active: Lanes, coherent: bool, to: usize) -> usize {
        let mut path = PathState::<F32x16>::load(&self.columns, STRIDE, at, &self.sampler);
        let hit = trace(self.engine.scene, &path, active, coherent);
        let mut left = active;
        while left.any() {
            let first = path.depth.lane(left.bits().trailing_zeros() as usize % LANES);
            let same = left & path.depth.eq(Index::splat(first));
            self.rays.add(first, same.count());
            left = left.and_not(same);
        }
        let found = active & is_hit(&hit);
        if found.count() >= ENOUGH || found.none() {
            return self.shade(&mut path, &hit, active, to);
        }
        self.waiting.add(&path, &hit, found);
        self.shade(&mut path, &hit, active.and_not(found), to)
    }

    /// Takes those that wait through their bounce, groups of at least this size.
    fn shade_waiting(&mut self, least: usize, mut to: usize) -> usize {
        while self.waiting.paths >= least {
            let (mut path, hit, active) = self.waiting.take(&self.sampler);
            to = self.shade(&mut path, &hit, active, to);
        }
        to
    }

    /// Takes one group through what its rays hit; writes those that live on at `to`, and returns where they end.
    #[inline(never)]
    fn shade(&mut self, path: &mut PathState<F32x16>, hit: &Hit<F32x16>, active: Lanes, to: usize) -> usize {
        let engine = self.engine;
        let open = &mut self.open;
        let classes = engine.classes.as_ref();
        let deposit = |path: &PathState<F32x16>, layer: <F32x16 as Real>::Index, light: Rgb<F32x16>| {
            if classes.is_some_and(|c| c.layers() > 0) {
                deposit(open, path, layer, light);
            }
        };
        let step = bounce(engine.scene, &engine.shade, classes, path, hit, active, deposit, &mut ());
        self.rays.shadow += u64::from(step.shadow_rays.count());
        let ended = active.and_not(step.alive);
        if ended.any() {
            self.finish(path, ended.bits());
        }
        if step.alive.none() {
            return to;
        }
        to + path.compress(step.alive, &mut self.columns, STRIDE, to)
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
            open.pixels[0][slot % TILE].add([r[lane], g[lane], b[lane]], open.tile.weight);
            open.left -= 1;
            if open.left == 0 {
                open.sum_layers();
                self.tiles.done(&open.tile, &open.pixels, &mut self.rays);
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
        let layers = self.engine.classes.as_ref().map_or(0, PathClasses::layers);
        let open = Some(Box::new(OpenTile::new(tile, left, layers)));
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
            &self.sampler,
            gather(&|i| samples[i].x),
            gather(&|i| samples[i].y),
            gather(&|i| samples[i].pixel),
            gather(&|i| samples[i].index),
            gather(&|i| samples[i].slot + (place * TILE) as u32),
        );
        self.paths += path.compress(first_lanes(n as usize), &mut self.columns, STRIDE, self.paths);
    }
}

/// The first `n` lanes, or all.
fn first_lanes(n: usize) -> Lanes {
    Lanes::from_bits(((1_u64 << n.min(LANES)) - 1) as u32)
}

/// Paths whose rays are traced, but which have not been through what they hit.
struct Waiting {
    columns: Vec<f32>,
    hits: Vec<f32>,
    paths: usize,
}

impl Waiting {
    /// Room for one path less than a group, and a group.
    const STRIDE: usize = 2 * LANES;

    fn new() -> Self {
        Self { columns: vec![0.0; FIELDS * Self::STRIDE], hits: vec![0.0; 5 * Self::STRIDE], paths: 0 }
    }

    /// Adds the paths of `mask`; fewer than a group may wait already.
    fn add(&mut self, path: &PathState<F32x16>, hit: &Hit<F32x16>, mask: Lanes) {
        let (primitive, instance) = (F32x16::from_bits(hit.primitive), F32x16::from_bits(hit.instance));
        let numbers = [hit.t, hit.u, hit.v, primitive, instance];
        for (number, column) in numbers.into_iter().zip(self.hits.chunks_exact_mut(Self::STRIDE)) {
            number.compress(mask, &mut column[self.paths..]);
        }
        self.paths += path.compress(mask, &mut self.columns, Self::STRIDE, self.paths);
    }

    /// Those that came last, as many as a group takes.
    fn take(&mut self, sampler: &Sampler) -> (PathState<F32x16>, Hit<F32x16>, Lanes) {
        let active = first_lanes(self.paths);
        self.paths = self.paths.saturating_sub(LANES);
        let [t, u, v, primitive, instance] =
            std::array::from_fn(|i| F32x16::load(&self.hits[i * Self::STRIDE + self.paths..]));
        let hit = Hit { t, u, v, primitive: primitive.to_bits(), instance: instance.to_bits() };
        (PathState::load(&self.columns, Self::STRIDE, self.paths, sampler), hit, active)
    }
}

/// Keeps light by layers, lane by lane.
#[inline(never)]
fn deposit(
    open: &mut [Option<Box<OpenTile>>],
    path: &PathState<F32x16>,
    layer: <F32x16 as Real>::Index,
    light: Rgb<F32x16>,
) {
    let mut lanes = (light.is_lit() & layer.ne(Index::splat(0))).bits();
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize % LANES;
        lanes &= lanes - 1;
        let slot = path.slot.lane(lane) as usize;
        let tile = open[slot / TILE].as_mut().expect("paths of an open tile");
        let place = tile.place(layer.lane(lane) as usize - 1, slot % TILE, path.sample.lane(lane));
        tile.layers[place].iter_mut().zip(light.lane(lane)).for_each(|(sum, x)| *sum += x);
    }
}
