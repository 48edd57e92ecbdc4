//! The pixels of a pass, handed out tile by tile; and their sums, handed back.

use super::{Observer, Pass, Rays, Region};
use crate::film::{Batch, Film, Splats};
use crate::sampling::Sampler;
use rebond_lanes::{Index, Mask, Real};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Side of a tile in pixels.
pub const SIDE: u32 = 16;
/// Pixels of a tile.
pub const TILE: usize = (SIDE * SIDE) as usize;

/// Samples per pixel of one visit to a tile: what is lost at most when a render is told to stop.
pub const VISIT: u32 = Batch::CAPACITY;

/// The tiles of a pass, visited once for every [`VISIT`] samples: all of them for the first, then all for the next. A
/// visit belongs to one thread, which adds up its samples and hands the sums over when all are done; sums are exact, so
/// no order shows in them.
pub struct Tiles<'a> {
    pass: &'a Pass,
    film: &'a Mutex<Film>,
    observer: &'a dyn Observer,
    next: AtomicU64,
    columns: u32,
    tiles: u64,
    visits: u64,
    rays: Mutex<Rays>,
}

/// A visit to a tile: the tile's first pixel relative to the region, its size, the samples of each pixel, and what each of
/// them counts.
#[derive(Clone, Debug)]
pub struct Tile {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
    pub samples: Range<u32>,
    pub weight: f32,
}

/// As many samples as there are lanes.
#[derive(Clone, Copy, Debug)]
pub struct Samples<F: Real> {
    /// Pixels in the whole picture.
    pub x: F::Index,
    pub y: F::Index,
    /// Their numbers there.
    pub pixel: F::Index,
    /// Indices of the samples.
    pub index: F::Index,
    /// Places in the tile.
    pub slot: F::Index,
    /// Lanes that have one.
    pub mask: F::Mask,
}

impl<F: Real> Samples<F> {
    fn gather(samples: &[Sample]) -> Self {
        let lanes = |f: &dyn Fn(&Sample) -> u32| {
            samples.iter().enumerate().fold(F::Index::splat(0), |v, (i, s)| v.with_lane(i, f(s)))
        };
        Self {
            x: lanes(&|s| s.x),
            y: lanes(&|s| s.y),
            pixel: lanes(&|s| s.pixel),
            index: lanes(&|s| s.index),
            slot: lanes(&|s| s.slot),
            mask: F::Mask::from_bits(((1_u64 << samples.len()) - 1) as u32),
        }
    }
}

/// One sample of one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// Pixel in the whole picture.
    pub x: u32,
    pub y: u32,
    /// Its number there.
    pub pixel: u32,
    /// Index of the sample.
    pub index: u32,
    /// Place in the tile.
    pub slot: u32,
}

impl<'a> Tiles<'a> {
    pub fn new(film: &'a Mutex<Film>, pass: &'a Pass, observer: &'a dyn Observer) -> Self {
        let [columns, rows] = tiles_of(&pass.region);
        let tiles = u64::from(columns) * u64::from(rows);
        let of_tile = |t: u32| pass.samples_of(t as usize).0.len() as u64;
        let most = match &pass.shares {
            None => pass.samples.len() as u64,
            Some(shares) => (0..shares.len() as u32).map(of_tile).max().unwrap_or(0),
        };
        let visits = tiles * most.div_ceil(u64::from(VISIT));
        let rays = Mutex::new(Rays::default());
        Self { pass, film, observer, next: AtomicU64::new(0), columns, tiles, visits, rays }
    }

    /// Some of the tiles of a pass of no more than [`VISIT`] samples, by their numbers.
    pub fn only(film: &'a Mutex<Film>, pass: &'a Pass, observer: &'a dyn Observer, tiles: Range<u64>) -> Self {
        let all = Self::new(film, pass, observer);
        Self { next: AtomicU64::new(tiles.start), visits: all.visits.min(tiles.end), ..all }
    }

    /// How many tiles there are.
    pub fn count(&self) -> u64 {
        self.tiles
    }

    /// The number of a tile.
    pub fn number(&self, tile: &Tile) -> u32 {
        tile.y / SIDE * self.columns + tile.x / SIDE
    }

    /// How many pixels these tiles have.
    pub fn pixels(&self, tiles: Range<u64>) -> u64 {
        let (columns, region) = (u64::from(self.columns), &self.pass.region);
        let side = |at: u64, size: u32| u64::from(SIDE.min(size - at as u32 * SIDE));
        tiles.map(|n| side(n % columns, region.width) * side(n / columns, region.height)).sum()
    }

    /// The sample values to use.
    pub fn sampler(&self, sampler: &Sampler) -> Sampler {
        self.pass.sampler(sampler)
    }

    /// Runs a worker on each thread; returns the rays they traced.
    pub fn run(&self, worker: impl Fn(&Self) + Sync) -> Rays {
        let threads = self.pass.threads.clamp(1, self.visits.clamp(1, 1024) as usize);
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(|| worker(self));
            }
            worker(self);
        });
        std::mem::take(&mut *self.rays.lock().unwrap_or_else(|e| e.into_inner()))
    }

    /// The next tile; `None` when all are taken or it is time to stop.
    pub fn next(&self) -> Option<Tile> {
        while !self.observer.should_stop() {
            let n = self.next.fetch_add(1, Ordering::Relaxed);
            if n >= self.visits {
                return None;
            }
            let (tile, visit) = ((n % self.tiles) as u32, (n / self.tiles) as u32);
            let (all, weight) = self.pass.samples_of(tile as usize);
            let first = all.start + visit * VISIT;
            if first >= all.end {
                continue;
            }
            let (x, y) = (tile % self.columns * SIDE, tile / self.columns * SIDE);
            let r = &self.pass.region;
            let samples = first..all.end.min(first.saturating_add(VISIT));
            return Some(Tile { x, y, width: SIDE.min(r.width - x), height: SIDE.min(r.height - y), samples, weight });
        }
        None
    }

    /// How many samples a visit has.
    pub fn samples_of(&self, tile: &Tile) -> u32 {
        tile.width * tile.height * tile.samples.len() as u32
    }

    /// The samples of a visit from the `n`-th on: all of a pixel, then those of the next.
    #[inline(always)]
    pub fn samples_from(&self, tile: &Tile, n: u32) -> impl Iterator<Item = Sample> {
        let (tile, r) = (tile.clone(), &self.pass.region);
        let per_pixel = tile.samples.len() as u32;
        let (mut slot, mut index) = (n / per_pixel, n % per_pixel);
        let (mut x, mut y) = (slot % tile.width, slot / tile.width);
        // One division at the start is enough: the rest is counting.
        std::iter::from_fn(move || {
            let (at_x, at_y) = (r.x + tile.x + x, r.y + tile.y + y);
            let pixel = at_y.wrapping_mul(r.full_width).wrapping_add(at_x);
            let sample = (y < tile.height).then_some(Sample {
                x: at_x,
                y: at_y,
                pixel,
                index: tile.samples.start + index,
                slot,
            });
            index += 1;
            if index == per_pixel {
                (index, slot, x) = (0, slot + 1, x + 1);
                if x == tile.width {
                    (x, y) = (0, y + 1);
                }
            }
            sample
        })
    }

    /// All samples of a visit, by lanes.
    pub fn lanes_of<F: Real>(&self, tile: &Tile) -> impl Iterator<Item = Samples<F>> {
        let mut samples = self.samples_from(tile, 0);
        std::iter::from_fn(move || {
            let mut some = [Sample::default(); 16];
            let n = some[..F::LANES].iter_mut().zip(&mut samples).map(|(place, s)| *place = s).count();
            (n > 0).then(|| Samples::gather(&some[..n]))
        })
    }

    /// Hands over what a tile's samples bring to any pixels.
    pub fn splat(&self, tile: &Tile, splats: &Splats) {
        self.film.lock().unwrap_or_else(|e| e.into_inner()).splat(splats, tile.weight);
    }

    /// Hands the sums of a tile over, the picture's and each layer's, and the rays traced since the last time.
    pub fn done(&self, tile: &Tile, pixels: &[[Batch; TILE]], rays: &mut Rays) {
        self.add(tile, 0, pixels);
        self.observer.advance(u64::from(self.samples_of(tile)), rays.total());
        self.rays.lock().unwrap_or_else(|e| e.into_inner()).merge(&std::mem::take(rays));
    }

    /// The same for layers from this one on, beside a picture whose samples these are.
    pub fn beside(&self, tile: &Tile, first: usize, pixels: &[[Batch; TILE]], rays: &mut Rays) {
        self.add(tile, first + 1, pixels);
        self.rays.lock().unwrap_or_else(|e| e.into_inner()).merge(&std::mem::take(rays));
    }

    /// Adds to sheets from this one on, of which the first is the picture.
    fn add(&self, tile: &Tile, first: usize, pixels: &[[Batch; TILE]]) {
        let mut film = self.film.lock().unwrap_or_else(|e| e.into_inner());
        let width = film.width();
        for (sheet, batches) in (first..).zip(pixels) {
            let sums = if sheet == 0 { film.pixels_mut() } else { film.layer_pixels_mut(sheet - 1) };
            for (i, p) in batches[..(tile.width * tile.height) as usize].iter().enumerate() {
                let (x, y) = (tile.x + i as u32 % tile.width, tile.y + i as u32 / tile.width);
                sums[(y * width + x) as usize].add(p, tile.weight);
            }
        }
    }
}

/// Columns and rows of tiles.
pub fn tiles_of(region: &Region) -> [u32; 2] {
    [region.width.div_ceil(SIDE), region.height.div_ceil(SIDE)]
}
