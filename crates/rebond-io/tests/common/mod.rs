//! What tests of renders share. Not every file uses all of it.
#![allow(dead_code)]

use rebond::compare::{Estimate, welch};
use rebond::film::{Film, Image};
use rebond::integrators::IntegratorSettings;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{SceneFiles, SceneSource, from_settings};

pub fn settings(text: &str) -> IntegratorSettings {
    from_settings(text).expect("settings").0
}

pub fn parse(text: &str) -> SceneSource {
    SceneSource::parse(text, "test.toml", "test", SceneFiles::BuiltIn).expect("a scene")
}

pub fn small(name: &str, size: [u32; 2]) -> SceneSource {
    let mut source = SceneSource::open(name).expect("a built-in scene");
    (source.description.film.width, source.description.film.height) = (size[0], size[1]);
    source
}

pub struct Job {
    pub engine: Engine,
    pub sampler: SamplerSettings,
    pub seed: u64,
    pub samples: std::ops::Range<u32>,
    pub threads: usize,
}

impl Default for Job {
    fn default() -> Self {
        let (engine, sampler) = (Engine::Wavefront, SamplerSettings::default());
        Self { engine, sampler, seed: 1, samples: 0..16, threads: 2 }
    }
}

pub fn film(source: &SceneSource, integrator: &str, job: &Job) -> Film {
    let scene = source.build().expect("a good scene");
    let integrator = settings(integrator).integrator(&scene, Sampler::new(job.sampler, job.seed), job.engine);
    let integrator = integrator.expect("settings that go together");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(job.samples.len() as u32), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), job.samples.start, &budget, job.threads, &());
    assert_eq!(film.dropped_samples(), 0);
    film
}

struct Channels {
    mean: Vec<f32>,
    variance: Vec<f32>,
    samples: Vec<f32>,
}

fn channel(image: &Image, c: usize) -> Channels {
    let data = |layer: &str, c: usize| image.layer(layer).expect("a layer").channels[c].data.clone();
    Channels { mean: data("", c), variance: data("variance", c), samples: data("samples", 0) }
}

/// Whether two pictures have one expectation: Welch's test of blocks of pixels, each channel at `level`.
pub fn judge(a: &Image, b: &Image, block: u32, level: f64) -> Result<(), String> {
    for c in 0..3 {
        let (x, y) = (channel(a, c), channel(b, c));
        let first = Estimate { mean: &x.mean, variance: &x.variance, samples: &x.samples };
        let second = Estimate { mean: &y.mean, variance: &y.variance, samples: &y.samples };
        let w = welch(first, second, a.width, a.height, block, level).expect("a test");
        assert!(w.tested > 0);
        if !w.passes() {
            return Err(format!("channel {c}: {} of {} blocks, p {}", w.significant, w.tested, w.below_alpha_p));
        }
    }
    Ok(())
}

/// They have, in blocks of 8 × 8.
pub fn agree(a: &Image, b: &Image, level: f64, what: &str) {
    judge(a, b, 8, level).unwrap_or_else(|e| panic!("{what}, {e}"));
}

/// The mean of a picture's green, and the two-sided chance of one this far from `expected`. Pixels are independent:
/// their samples hang on their numbers.
pub fn t_test(film: &Film, expected: f64) -> (f64, f64) {
    let moments: Moments = film.pixels().iter().map(|p| p.mean()[1]).collect();
    // Where every pixel is the same number but for f32's rounding there is no noise to judge by.
    let exact = (moments.mean() - expected).abs() <= 1e-6 * expected;
    (moments.mean(), if exact { 1.0 } else { moments.p_value(expected) })
}
