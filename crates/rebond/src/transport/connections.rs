//! Light on its way: rays that must be free for it to arrive, of many samples, traced as many at a time as there are lanes.
//!
//! Of sixteen pairs of vertices few can be connected: some walks have ended, some vertices face away or lie in one plane. So
//! the rays of those that can wait side by side until a packet of them is full.

use super::sheets::Place;
use crate::math::Rgb;
use crate::scene::Scene;
use rebond_bvh::{Ray, Trace};
use rebond_lanes::{Index, Mask, Real};

/// What arrives if its ray is free.
#[derive(Clone, Copy, Debug)]
pub struct Connection<F: Real> {
    /// What must be free.
    pub ray: Ray<F>,
    /// Light, not weighed.
    pub light: Rgb<F>,
    /// Its weight.
    pub weight: F,
    /// The automaton's state of the path.
    pub state: F::Index,
    /// How the path was found, if that has layers of its own.
    pub strategy: Option<usize>,
}

/// Light of one sample that has arrived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    /// Lane of the sample.
    pub lane: usize,
    /// Light, not weighed.
    pub light: [f32; 3],
    /// Its weight.
    pub weight: f32,
    /// Number of its layer + 1.
    pub layer: usize,
    /// How the path was found.
    pub strategy: Option<usize>,
    /// Which pixel it is for, if for any.
    pub pixel: usize,
}

const COLUMNS: usize = 15;
/// Length of a column: compressing sixteen lanes may write past the last ray.
const STRIDE: usize = 32;

/// Connections that wait.
#[derive(Debug)]
pub(super) struct Connections {
    columns: [[f32; STRIDE]; COLUMNS],
    /// Of those for any pixel: raster position, and two numbers to choose one.
    places: [[f32; STRIDE]; 4],
    waiting: usize,
}

impl Default for Connections {
    fn default() -> Self {
        Self { columns: [[0.0; STRIDE]; COLUMNS], places: [[0.0; STRIDE]; 4], waiting: 0 }
    }
}

impl Connections {
    /// Adds those of the lanes of `mask`. There is room for as many as there are lanes once [`Connections::trace`] has been called.
    #[inline(always)]
    pub fn add<F: Real>(&mut self, c: &Connection<F>, layer: F::Index, place: Option<Place<F>>, mask: F::Mask) {
        let lanes = (0..F::LANES).fold(F::Index::splat(0), |v, i| v.with_lane(i, i as u32));
        let strategy = F::Index::splat(c.strategy.map_or(0, |s| s as u32 + 1));
        let ([ox, oy, oz], [dx, dy, dz]) = (c.ray.o, c.ray.d);
        let [lanes, layer, strategy] = [lanes, layer, strategy].map(F::from_bits);
        let (tmax, time, Rgb { r, g, b }, w) = (c.ray.tmax, c.ray.time, c.light, c.weight);
        let numbers: [F; COLUMNS] = [ox, oy, oz, dx, dy, dz, tmax, time, r, g, b, w, lanes, layer, strategy];
        for (column, number) in self.columns.iter_mut().zip(numbers) {
            number.compress(mask, &mut column[self.waiting..]);
        }
        if let Some(([x, y], [u, v])) = place {
            for (column, number) in self.places.iter_mut().zip([x, y, u, v]) {
                number.compress(mask, &mut column[self.waiting..]);
            }
        }
        self.waiting += mask.count() as usize;
    }

    /// Traces those that fill all lanes; the others, too, if these are the `last`. Tells what arrives, in the order in which it was
    /// added. If there are `pixels`, the rays lead to the eye, and of what arrives they say which pixels it is for, what it counts
    /// there, and which of it is for any.
    #[inline(always)]
    pub fn trace<F: Trace>(
        &mut self,
        scene: &Scene,
        pixels: Option<impl Fn(Place<F>, F::Mask) -> (F::Index, F, F::Mask)>,
        last: bool,
        mut arrives: impl FnMut(Arrival),
    ) {
        while self.waiting >= F::LANES || (last && self.waiting > 0) {
            let n = self.waiting.min(F::LANES);
            let mut free = self.free::<F>(scene, pixels.is_some(), n);
            let (mut pixel, mut share) = (F::Index::splat(0), F::one());
            if let Some(pixels) = &pixels {
                let place = |number: usize| F::load(&self.places[number]);
                (pixel, share, free) = pixels(([place(0), place(1)], [place(2), place(3)]), free);
            }
            let at = |column: usize, i: usize| self.columns[column][i];
            let mut lanes = free.bits();
            while lanes != 0 {
                let i = lanes.trailing_zeros() as usize % STRIDE;
                lanes &= lanes - 1;
                let word = |column: usize| at(column, i).to_bits() as usize;
                arrives(Arrival {
                    lane: word(12),
                    light: [at(8, i), at(9, i), at(10, i)].map(|x| x * share.lane(i)),
                    weight: at(11, i),
                    layer: word(13),
                    strategy: word(14).checked_sub(1),
                    pixel: pixel.lane(i) as usize,
                });
            }
            self.waiting -= n;
            if self.waiting > 0 {
                let columns = self.columns.iter_mut().chain(&mut self.places);
                columns.for_each(|column| F::load(&column[n..]).store(column));
            }
        }
    }

    /// Which of the first `n` are free. Apart, since tracing is much code.
    #[inline(never)]
    fn free<F: Trace>(&self, scene: &Scene, to_eye: bool, n: usize) -> F::Mask {
        let column = |number: usize| F::load(&self.columns[number]);
        let ray = Ray {
            o: [column(0), column(1), column(2)],
            d: [column(3), column(4), column(5)],
            tmax: column(6),
            time: column(7),
        };
        let mask = F::Mask::from_bits(((1_u64 << n) - 1) as u32);
        mask.and_not(if to_eye { scene.hidden(&ray, mask) } else { scene.occluded(&ray, mask) })
    }
}
