//! Whether two pictures have one expectation.

use rebond::compare::{Estimate, Welch, welch};
use rebond::film::Film;
use serde_json::{Value, json};

/// The green of a picture, with what is known of it.
pub struct Means {
    mean: Vec<f32>,
    variance: Vec<f32>,
    samples: Vec<f32>,
}

impl Means {
    pub fn of(film: &Film) -> Self {
        Self::sum(std::slice::from_ref(film))
    }

    /// Of the sum of pictures.
    pub fn sum(films: &[Film]) -> Self {
        let pixels = films.first().map_or(0, |f| f.pixels().len());
        let all = |i: usize| films.iter().map(move |f| f.pixels()[i].moments(1));
        let per_pixel = |f: &dyn Fn(usize) -> f64| (0..pixels).map(|i| f(i) as f32).collect();
        Self {
            mean: per_pixel(&|i| all(i).map(|m| m.mean()).sum()),
            variance: per_pixel(&|i| all(i).map(|m| m.variance_of_mean()).sum()),
            samples: per_pixel(&|i| all(i).map(|m| m.count() as f64).fold(f64::INFINITY, f64::min)),
        }
    }

    /// The sum over all pixels, and its standard error.
    pub fn total(&self) -> [f64; 2] {
        let sum = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
        [sum(&self.mean), sum(&self.variance).sqrt()]
    }

    fn estimate(&self) -> Estimate<'_> {
        Estimate { mean: &self.mean, variance: &self.variance, samples: &self.samples }
    }

    /// Whether another picture has the same expectation: Welch's test of blocks of this many pixels squared.
    pub fn test(&self, other: &Self, [width, height]: [u32; 2], block: u32, level: f64) -> Welch {
        welch(self.estimate(), other.estimate(), width, height, block, level).expect("pictures of one size")
    }
}

pub fn verdict(test: &Welch) -> &'static str {
    if test.passes() { "they agree" } else { "they differ" }
}

pub fn of_test(test: &Welch) -> Value {
    json!({ "blocks": test.tested, "below_level": test.below_alpha, "significant": test.significant,
        "below_level_p": test.below_alpha_p, "passes": test.passes() })
}
