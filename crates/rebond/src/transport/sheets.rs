//! Where light goes: to its pixel or to others, to the picture and to the layers it belongs to.

use crate::film::{Batch, Filter, Splats};
use crate::math::Rgb;
use crate::render::{PathClasses, Region, TILE};
use rebond_lanes::scalar::Index1;

/// What one tile's samples bring.
pub struct Sheets<'a> {
    classes: Option<&'a PathClasses>,
    filter: &'a Filter,
    region: Region,
    /// Layers beside those of the classes.
    extra: usize,
    own: Vec<[Batch; TILE]>,
    splats: Splats,
    /// Light of the sample under way for its own pixel.
    sample: Vec<[f32; 3]>,
}

impl<'a> Sheets<'a> {
    /// Nothing yet. A film has the layers of the classes, then `extra` ones.
    pub fn new(classes: Option<&'a PathClasses>, filter: &'a Filter, region: Region, extra: usize) -> Self {
        let sheets = 1 + classes.map_or(0, PathClasses::layers) + extra;
        let own = vec![[Batch::default(); TILE]; sheets];
        Self { classes, filter, region, extra, own, splats: Splats::default(), sample: vec![[0.0; 3]; sheets] }
    }

    /// The automaton's state of a path after these events, from the eye on.
    pub fn state(&self, start: u32, events: impl IntoIterator<Item = u32>) -> u32 {
        let Some(classes) = self.classes else { return 0 };
        events.into_iter().fold(start, |state, event| classes.step::<f32>(Index1(state), Index1(event)).0)
    }

    /// Where light of a path in this state goes: a layer's number + 1, or 0 if it does not count.
    fn layer(&self, state: u32) -> usize {
        self.classes.map_or(1, |classes| classes.light::<f32>(Index1(state)).0 as usize)
    }

    /// Whether light of a path in this state counts.
    pub fn counts(&self, state: u32) -> bool {
        self.layer(state) != 0
    }

    /// The sheets for light of a path in this state, each with what it weighs there: the picture, its layer, and the two of
    /// its strategy, where it counts in full too.
    fn sheets(&self, state: u32, strategy: Option<usize>, weight: f32) -> impl Iterator<Item = (usize, f32)> + use<> {
        let (layer, layers) = (self.layer(state), self.sample.len() - 1 - self.extra);
        let strategy = strategy.map(|number| 1 + layers + 2 * number).filter(|_| layer != 0);
        let sheets = [
            (layer != 0).then_some((0, weight)),
            (1..=layers).contains(&layer).then_some((layer, weight)),
            strategy.map(|weighted| (weighted, weight)),
            strategy.map(|weighted| (weighted + 1, 1.0)),
        ];
        sheets.into_iter().flatten()
    }

    /// Light for the pixel of the sample under way.
    pub fn add(&mut self, state: u32, strategy: Option<usize>, light: Rgb<f32>, weight: f32) {
        for (sheet, weight) in self.sheets(state, strategy, weight) {
            self.sample[sheet].iter_mut().zip((light * weight).lane(0)).for_each(|(sum, x)| *sum += x);
        }
    }

    /// Light at a raster position, for one of the pixels whose filters reach it, by two numbers in [0, 1). What falls beside the
    /// region is lost.
    pub fn splat(
        &mut self,
        state: u32,
        strategy: Option<usize>,
        (raster, u): ([f32; 2], [f32; 2]),
        light: Rgb<f32>,
        weight: f32,
    ) {
        let (region, size) = (self.region, [self.region.width, self.region.height].map(i64::from));
        let reach = self.filter.reach() + 1.0;
        let at = [raster[0] - region.x as f32, raster[1] - region.y as f32];
        if !(0..2).all(|i| at[i] > -reach && at[i] < size[i] as f32 + reach) {
            return;
        }
        let ([x, y], share) = self.filter.splat(raster, u);
        let (x, y) = (x - i64::from(region.x), y - i64::from(region.y));
        if (0..size[0]).contains(&x) && (0..size[1]).contains(&y) {
            for (sheet, weight) in self.sheets(state, strategy, weight) {
                self.splats.add(sheet, (y * size[0] + x) as usize, (light * (weight * share)).lane(0));
            }
        }
    }

    /// The sample under way, of the pixel at this place of its tile, has ended, and its light's path with it.
    pub fn end_sample(&mut self, slot: u32, weight: f32) {
        for (batches, light) in self.own.iter_mut().zip(&mut self.sample) {
            batches[slot as usize].add(std::mem::take(light), weight);
        }
        self.splats.end_path();
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
