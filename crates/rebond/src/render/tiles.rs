//! The pixels of a pass, handed out tile by tile; and their sums, handed back.

use super::{Observer, Pass};
use crate::film::{Batch, Film};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Side of a tile in pixels.
pub const SIDE: u32 = 16;
/// Pixels of a tile.
pub const TILE: usize = (SIDE * SIDE) as usize;

/// Samples per pixel of one visit to a tile: what is lost at most when a render is told to stop.
const VISIT: u32 = Batch::CAPACITY;

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
    rays: AtomicU64,
}

/// A visit to a tile: the tile's first pixel relative to the region, its size, and the samples of each pixel.
#[derive(Clone, Debug)]
pub struct Tile {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
    pub samples: Range<u32>,
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
        let (columns, rows) = (pass.region.width.div_ceil(SIDE), pass.region.height.div_ceil(SIDE));
        let tiles = u64::from(columns) * u64::from(rows);
        let visits = tiles * (pass.samples.len() as u64).div_ceil(u64::from(VISIT));
        Self { pass, film, observer, next: AtomicU64::new(0), columns, tiles, visits, rays: AtomicU64::new(0) }
    }

    /// Runs a worker on each thread; returns the rays they traced.
    pub fn run(&self, worker: impl Fn(&Self) + Sync) -> u64 {
        let threads = self.pass.threads.clamp(1, self.visits.clamp(1, 1024) as usize);
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(|| worker(self));
            }
            worker(self);
        });
        self.rays.load(Ordering::Relaxed)
    }

    /// The next tile; `None` when all are taken or it is time to stop.
    pub fn next(&self) -> Option<Tile> {
        if self.observer.should_stop() {
            return None;
        }
        let n = self.next.fetch_add(1, Ordering::Relaxed);
        if n >= self.visits {
            return None;
        }
        let (tile, visit) = ((n % self.tiles) as u32, (n / self.tiles) as u32);
        let (x, y) = (tile % self.columns * SIDE, tile / self.columns * SIDE);
        let (r, all) = (&self.pass.region, &self.pass.samples);
        let first = all.start + visit * VISIT;
        let samples = first..all.end.min(first.saturating_add(VISIT));
        Some(Tile { x, y, width: SIDE.min(r.width - x), height: SIDE.min(r.height - y), samples })
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

    /// Hands the sums of a tile over, for which `rays` were traced since the last time.
    pub fn done(&self, tile: &Tile, pixels: &[Batch], rays: u64) {
        let mut film = self.film.lock().unwrap_or_else(|e| e.into_inner());
        let width = film.width();
        for (i, p) in pixels[..(tile.width * tile.height) as usize].iter().enumerate() {
            let (x, y) = (tile.x + i as u32 % tile.width, tile.y + i as u32 / tile.width);
            film.pixels_mut()[(y * width + x) as usize].add(p);
        }
        drop(film);
        self.rays.fetch_add(rays, Ordering::Relaxed);
        self.observer.advance(u64::from(self.samples_of(tile)), rays);
    }
}
