//! Where light goes: to its pixel or to others, to the picture and to the layers it belongs to.

use super::Connection;
use super::connections::{Arrival, Connections};
use crate::film::{Batch, Splats};
use crate::math::Rgb;
use crate::render::{PathClasses, Rays, Region, TILE};
use crate::scene::Scene;
use rebond_bvh::Trace;
use rebond_lanes::{Index, Mask, Real};

/// Light for any pixel: its raster position, and two numbers in [0, 1) to choose one of those whose filters reach it.
pub type Place<F> = ([F; 2], [F; 2]);

/// What a tile's samples bring. What one sample brings is added up in an order of its own, so that none shows of what else is
/// under way.
pub struct Sheets<'a, F: Real = f32> {
    scene: &'a Scene,
    classes: Option<&'a PathClasses>,
    region: Region,
    /// Layers beside those of the classes.
    extra: usize,
    own: Vec<[Batch; TILE]>,
    splats: Splats,
    /// Light of the samples under way for their own pixels.
    samples: Vec<Rgb<F>>,
    /// The same, of connections.
    connected: Vec<[[f32; 3]; 16]>,
    /// Connections that wait to be traced: for pixels of their own, and for any.
    to_own: Connections,
    to_any: Connections,
    /// What of the latter has arrived.
    arrived: Vec<Arrival>,
    rays: u64,
}

impl<'a, F: Trace> Sheets<'a, F> {
    /// Nothing yet. A film has the layers of the classes, then `extra` ones.
    pub fn new(classes: Option<&'a PathClasses>, scene: &'a Scene, region: Region, extra: usize) -> Self {
        let sheets = 1 + classes.map_or(0, PathClasses::layers) + extra;
        Self {
            scene,
            classes,
            region,
            extra,
            own: vec![[Batch::default(); TILE]; sheets],
            splats: Splats::default(),
            samples: vec![Rgb::black(); sheets],
            connected: vec![[[0.0; 3]; 16]; sheets],
            to_own: Connections::default(),
            to_any: Connections::default(),
            arrived: Vec::new(),
            rays: 0,
        }
    }

    /// Nothing again, for the next tile.
    pub fn clear(&mut self) {
        self.own.iter_mut().for_each(|batches| batches.fill(Batch::default()));
        self.splats.clear();
    }

    /// The automaton's state of a path after these events, from the eye on.
    #[inline(always)]
    pub fn state(&self, start: F::Index, events: impl IntoIterator<Item = F::Index>) -> F::Index {
        let Some(classes) = self.classes else { return start };
        events.into_iter().fold(start, |state, event| classes.step::<F>(state, event))
    }

    /// Where light of paths in this state goes: a layer's number + 1, or 0 if it does not count.
    #[inline(always)]
    fn layer(&self, state: F::Index) -> F::Index {
        self.classes.map_or(F::Index::splat(1), |classes| classes.light::<F>(state))
    }

    /// Layers of classes.
    fn layers(&self) -> usize {
        self.samples.len() - 1 - self.extra
    }

    /// The two sheets of a strategy.
    fn sheets_of(&self, strategy: usize) -> [usize; 2] {
        let first = 1 + self.layers() + 2 * strategy;
        [first, first + 1]
    }

    /// Light for the pixels of the samples under way: for the picture, its layer, and the two of its strategy, where it counts
    /// in full too.
    #[inline(always)]
    pub fn add(&mut self, state: F::Index, strategy: Option<usize>, light: Rgb<F>, weight: F, mask: F::Mask) {
        let layer = self.layer(state);
        let mask = mask & layer.ne(F::Index::splat(0));
        let weighed = (light * weight).masked(mask);
        self.samples[0] += weighed;
        for number in 1..=self.layers() {
            self.samples[number] += weighed.masked(layer.eq(F::Index::splat(number as u32)));
        }
        if let Some(strategy) = strategy {
            let [weighed_sheet, full_sheet] = self.sheets_of(strategy);
            self.samples[weighed_sheet] += weighed;
            self.samples[full_sheet] += light.masked(mask);
        }
    }

    /// Light at raster positions, for any pixels. What falls beside the region is lost.
    pub fn splat(
        &mut self,
        state: F::Index,
        strategy: Option<usize>,
        place: Place<F>,
        light: Rgb<F>,
        weight: F,
        mask: F::Mask,
    ) {
        let layer = self.layer(state);
        let (pixel, share, mask) = pixels(self.scene, &self.region, place, mask & layer.ne(F::Index::splat(0)));
        let (light, mut lanes) = (light * share, mask.bits());
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize % F::LANES;
            lanes &= lanes - 1;
            let word = |x: F::Index| x.lane(lane) as usize;
            let (light, weight) = (light.lane(lane), weight.lane(lane));
            self.splat_one(&Arrival { lane, light, weight, layer: word(layer), strategy, pixel: word(pixel) });
        }
    }

    fn splat_one(&mut self, arrival: &Arrival) {
        let Arrival { lane, light, weight, layer, strategy, pixel } = *arrival;
        let weighed = light.map(|x| x * weight);
        self.splats.add(lane, 0, pixel, weighed);
        if layer <= self.layers() {
            self.splats.add(lane, layer, pixel, weighed);
        }
        if let Some(strategy) = strategy {
            let [weighed_sheet, full_sheet] = self.sheets_of(strategy);
            self.splats.add(lane, weighed_sheet, pixel, weighed);
            self.splats.add(lane, full_sheet, pixel, light);
        }
    }

    /// Light for the pixels of the samples under way, if its rays are free.
    #[inline(always)]
    pub fn connect(&mut self, c: &Connection<F>, mask: F::Mask) {
        let layer = self.layer(c.state);
        let mask = mask & layer.ne(F::Index::splat(0));
        if mask.any() {
            self.rays += u64::from(mask.count());
            self.to_own.add(c, layer, None, mask);
            self.trace_to_own(false);
        }
    }

    /// Light for any pixels, if its rays are free.
    #[inline(always)]
    pub fn connect_to_lens(&mut self, c: &Connection<F>, place: Place<F>, mask: F::Mask) {
        let layer = self.layer(c.state);
        // Which pixels it is for is found out for what arrives.
        let mask = mask & layer.ne(F::Index::splat(0)) & may_be_within(self.scene, &self.region, place.0);
        if mask.any() {
            self.rays += u64::from(mask.count());
            self.to_any.add(c, layer, Some(place), mask);
            self.trace_to_any(false);
        }
    }

    #[inline(never)]
    fn trace_to_own(&mut self, last: bool) {
        let (layers, extra_sheets) = (self.layers(), 1 + self.layers());
        let connected = &mut self.connected;
        let nowhere_else = None::<fn(Place<F>, F::Mask) -> (F::Index, F, F::Mask)>;
        self.to_own.trace::<F>(self.scene, nowhere_else, last, |a| {
            let mut add = |sheet: usize, weight: f32| {
                connected[sheet][a.lane].iter_mut().zip(a.light).for_each(|(sum, x)| *sum += x * weight);
            };
            add(0, a.weight);
            if a.layer <= layers {
                add(a.layer, a.weight);
            }
            if let Some(strategy) = a.strategy {
                add(extra_sheets + 2 * strategy, a.weight);
                add(extra_sheets + 2 * strategy + 1, 1.0);
            }
        });
    }

    #[inline(never)]
    fn trace_to_any(&mut self, last: bool) {
        let (scene, region, arrived) = (self.scene, &self.region, &mut self.arrived);
        let pixels = |place: Place<F>, mask: F::Mask| pixels(scene, region, place, mask);
        self.to_any.trace::<F>(scene, Some(pixels), last, |arrival| arrived.push(arrival));
    }

    /// The samples under way, of the pixels at these places of their tile, have ended, and their light's paths with them.
    pub fn end_samples(&mut self, slot: F::Index, mask: F::Mask, weight: f32, rays: &mut Rays) {
        self.trace_to_own(true);
        self.trace_to_any(true);
        rays.shadow += std::mem::take(&mut self.rays);
        let lanes = mask.count() as usize;
        for ((batches, light), connected) in self.own.iter_mut().zip(&mut self.samples).zip(&mut self.connected) {
            let (light, connected) = (std::mem::take(light), std::mem::take(connected));
            for (lane, more) in connected[..lanes].iter().enumerate() {
                let light = light.lane(lane);
                let both = std::array::from_fn(|c| light[c] + more[c]);
                batches[slot.lane(lane) as usize].add(both, weight);
            }
        }
        let arrived = std::mem::take(&mut self.arrived);
        arrived.iter().for_each(|arrival| self.splat_one(arrival));
        self.arrived = arrived;
        self.arrived.clear();
        self.splats.end_paths(lanes);
    }

    /// What the pixels' own samples brought, by sheet.
    pub fn own(&self) -> &[[Batch; TILE]] {
        &self.own
    }

    /// What goes to any pixel.
    pub fn splats(&self) -> &Splats {
        &self.splats
    }
}

/// The pixels of a region that light at these places goes to, what it counts there, and in which lanes of `mask` they are of the
/// region.
#[inline(always)]
fn pixels<F: Real>(scene: &Scene, r: &Region, (raster, u): Place<F>, mask: F::Mask) -> (F::Index, F, F::Mask) {
    let near = mask & may_be_within(scene, r, raster);
    if near.none() {
        return (F::Index::splat(0), F::zero(), near);
    }
    let ([x, y], share) = scene.filter().splat(raster, u);
    let (x, y) = (x - r.x as f32, y - r.y as f32);
    let axis = |at: F, size: u32| at.ge(F::zero()) & at.lt(F::splat(size as f32));
    let within = near & axis(x, r.width) & axis(y, r.height);
    // Of other lanes it is no number.
    let (x, y) = (F::select(within, x, F::zero()), F::select(within, y, F::zero()));
    (y.to_index() * F::Index::splat(r.width) + x.to_index(), share, within)
}

/// Lanes whose place is near enough to the region for a filter to reach it.
#[inline(always)]
fn may_be_within<F: Real>(scene: &Scene, r: &Region, raster: [F; 2]) -> F::Mask {
    // Of pixels at the edges, whose centres lie half a pixel within; half of that half is for rounding.
    let reach = scene.filter().reach() - 0.25;
    let axis = |at: F, first: u32, size: u32| {
        let at = at - first as f32;
        at.gt(F::splat(-reach)) & at.lt(F::splat(size as f32 + reach))
    };
    axis(raster[0], r.x, r.width) & axis(raster[1], r.y, r.height)
}
