//! Engines that run estimators: which paths, in what order, until when.

mod budget;
mod path_state;
mod scalar;
mod tiles;
mod wavefront;

pub use budget::{Budget, RenderStatistics, render};
pub use path_state::{Bounce, Dimensions, PathState, Shade, ShadowRay};

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
    /// Adds the samples of a pass to a film of the region's size. Returns the number of rays traced.
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> u64;
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
    /// Makes an estimator an integrator.
    pub fn integrator<'a, S: Shade + 'a>(
        self,
        scene: &'a Scene,
        sampler: Sampler,
        shade: S,
    ) -> Box<dyn Integrator + 'a> {
        match self {
            Self::Wavefront => Box::new(wavefront::Wavefront { scene, sampler, shade }),
            Self::Scalar => Box::new(scalar::Scalar { scene, sampler, shade }),
        }
    }
}
