//! The pixels of a pass, handed out tile by tile; and their sums, handed back.

use super::{Observer, Pass};
use crate::film::{Film, Pixel};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Side of a tile in pixels.
pub const SIDE: u32 = 16;
/// Pixels of a tile.
pub const TILE: usize = (SIDE * SIDE) as usize;

/// The tiles of a pass. A tile belongs to one thread, which adds up its samples and hands the sums over when all are
/// done; sums are exact, so no order shows in them.
pub struct Tiles<'a> {
    pass: &'a Pass,
    film: &'a Mutex<Film>,
    observer: &'a dyn Observer,
    next: AtomicU32,
    columns: u32,
    count: u32,
    rays: AtomicU64,
}

/// A tile: its first pixel relative to the region, and its size.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
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
        let count = if pass.samples.is_empty() { 0 } else { columns * rows };
        Self { pass, film, observer, next: AtomicU32::new(0), columns, count, rays: AtomicU64::new(0) }
    }

    /// Runs a worker on each thread; returns the rays they traced.
    pub fn run(&self, worker: impl Fn(&Self) + Sync) -> u64 {
        let threads = self.pass.threads.clamp(1, self.count.max(1) as usize);
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
        let (x, y) = (n % self.columns * SIDE, n / self.columns * SIDE);
        let r = &self.pass.region;
        (n < self.count).then(|| Tile { x, y, width: SIDE.min(r.width - x), height: SIDE.min(r.height - y) })
    }

    /// How many samples a tile has.
    pub fn samples_of(&self, tile: &Tile) -> u32 {
        tile.width * tile.height * self.pass.samples.len() as u32
    }

    /// Sample `n` of a tile: all samples of a pixel, then those of the next.
    #[inline(always)]
    pub fn sample(&self, tile: &Tile, n: u32) -> Sample {
        let per_pixel = self.pass.samples.len() as u32;
        let (slot, index) = (n / per_pixel, n % per_pixel);
        let r = &self.pass.region;
        let (x, y) = (r.x + tile.x + slot % tile.width, r.y + tile.y + slot / tile.width);
        Sample { x, y, pixel: y * r.full_width + x, index: self.pass.samples.start + index, slot }
    }

    /// Hands the sums of a tile over, for which `rays` were traced since the last time.
    pub fn done(&self, tile: &Tile, pixels: &[Pixel], rays: u64) {
        let mut film = self.film.lock().unwrap_or_else(|e| e.into_inner());
        let width = film.width();
        let mut samples = 0;
        for (i, p) in pixels[..(tile.width * tile.height) as usize].iter().enumerate() {
            let (x, y) = (tile.x + i as u32 % tile.width, tile.y + i as u32 / tile.width);
            film.pixels_mut()[(y * width + x) as usize].merge(p);
            samples += p.samples();
        }
        drop(film);
        self.rays.fetch_add(rays, Ordering::Relaxed);
        self.observer.advance(samples, rays);
    }
}
