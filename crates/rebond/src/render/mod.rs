//! Engines that run estimators: which paths, in what order, until when.

mod adaptive;
mod bounce;
mod budget;
mod in_order;
pub mod journal;
pub mod path_classes;
mod path_state;
mod scalar;
mod tiles;
mod wavefront;

pub use adaptive::Share;
pub use budget::{Budget, RenderStatistics, render};
pub(crate) use in_order::in_order;
pub use journal::Story;
pub use path_classes::{PathClasses, PathExpression, PathLayer};
pub use path_state::{Bounce, Dimensions, PathState, Shade, ShadowRay};
pub(crate) use tiles::{Sample, Samples, TILE, Tile, Tiles};

use crate::film::Film;
use crate::sampling::Sampler;
use crate::scene::Scene;
use std::ops::Range;
use std::sync::Mutex;

/// A part of the picture, in pixels from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
    /// Width of the whole picture, by which its pixels are numbered.
    pub full_width: u32,
}

impl Region {
    /// The whole of a picture.
    pub fn whole(width: u32, height: u32) -> Self {
        Self { x: 0, y: 0, width, height, full_width: width }
    }

    /// How many pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}

/// One pass over a region: these samples of each of its pixels.
#[derive(Clone, Debug)]
pub struct Pass {
    /// Where.
    pub region: Region,
    /// Sample indices.
    pub samples: Range<u32>,
    /// How many threads to use.
    pub threads: usize,
    /// What each tile gets instead, so that samples go where they help most.
    pub shares: Option<Vec<Share>>,
}

impl Pass {
    /// The samples of a tile, and what each of them counts.
    fn samples_of(&self, tile: usize) -> (Range<u32>, f32) {
        match &self.shares {
            None => (self.samples.clone(), 1.0),
            Some(shares) => {
                let (n, weight) = shares[tile].samples(self.samples.len() as u32);
                (0..n, weight)
            }
        }
    }

    /// The sample values of this pass: those of the render, or, where earlier passes decided what it is, independent ones.
    fn sampler(&self, sampler: &Sampler) -> Sampler {
        if self.shares.is_some() { sampler.salted(self.samples.start) } else { *sampler }
    }
}

/// Rays traced.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rays {
    /// Rays of paths, by the number of the segment: those of the camera first.
    pub by_depth: Vec<u64>,
    /// Rays that asked whether anything is in the way.
    pub shadow: u64,
}

impl Rays {
    /// Counts `n` rays of that segment; the camera's is 1.
    #[inline(always)]
    pub fn add(&mut self, depth: u32, n: u32) {
        let place = (depth.max(1) - 1) as usize;
        if self.by_depth.len() <= place {
            self.by_depth.resize(place + 1, 0);
        }
        self.by_depth[place] += u64::from(n);
    }

    /// Adds others.
    pub fn merge(&mut self, other: &Self) {
        if self.by_depth.len() < other.by_depth.len() {
            self.by_depth.resize(other.by_depth.len(), 0);
        }
        self.by_depth.iter_mut().zip(&other.by_depth).for_each(|(a, b)| *a += b);
        self.shadow += other.shadow;
    }

    /// All of them.
    pub fn total(&self) -> u64 {
        self.by_depth.iter().sum::<u64>() + self.shadow
    }
}

/// Told how a render goes; asked whether to go on. Called from many threads, some thousand times a second at most.
pub trait Observer: Sync {
    /// This many more samples are done, for which this many rays were traced.
    fn advance(&self, samples: u64, rays: u64) {
        let _ = (samples, rays);
    }
    /// A pass is over; the estimated relative error, where it is known.
    fn pass_done(&self, samples_per_pixel: u32, error: f64) {
        let _ = (samples_per_pixel, error);
    }
    /// Whether to stop soon. What was rendered by then is kept.
    fn should_stop(&self) -> bool {
        false
    }
}

impl Observer for () {}

/// An algorithm at work on a scene: fills a film pass by pass. The same seed gives the same bits, for any number of
/// threads and any division into passes.
pub trait Integrator: Sync {
    /// Adds the samples of a pass to a film of the region's size, which has the layers of this integrator. Returns the rays
    /// traced.
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays;

    /// What it counted so far beside samples and rays, by name.
    fn counts(&self) -> Vec<(&'static str, u64)> {
        Vec::new()
    }

    /// What went otherwise than it was asked to so far, in words.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// Traces one sample of a pixel of a picture so wide, and tells what became of it; `None` by those that cannot.
    fn tell(&self, pixel: [u32; 2], full_width: u32, sample: u32) -> Option<Story> {
        let _ = (pixel, full_width, sample);
        None
    }
}

/// How camera-path estimators run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Engine {
    /// Many paths at once in SIMD lanes.
    #[default]
    Wavefront,
    /// One path after the other: the reference.
    Scalar,
}

impl Engine {
    /// Makes an estimator an integrator. With `classes` only their light counts, in their layers.
    pub fn integrator<'a, S: Shade + 'a>(
        self,
        scene: &'a Scene,
        sampler: Sampler,
        shade: S,
        classes: Option<PathClasses>,
    ) -> Box<dyn Integrator + 'a> {
        match self {
            Self::Wavefront => Box::new(wavefront::Wavefront { scene, sampler, shade, classes }),
            Self::Scalar => Box::new(scalar::Scalar { scene, sampler, shade, classes }),
        }
    }
}
