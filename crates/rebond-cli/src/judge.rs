//! Whether two pictures have one expectation.

use rebond::compare::{Estimate, Welch, welch};
use rebond::film::{Film, Image};
use serde_json::{Value, json};

/// A channel of a picture, with what is known of it.
pub struct Means {
    mean: Vec<f32>,
    variance: Vec<f32>,
    samples: Vec<f32>,
}

impl Means {
    /// The green of a film.
    pub fn of(film: &Film) -> Self {
        Self::sum(std::slice::from_ref(film))
    }

    /// The green of the sum of pictures.
    pub fn sum(films: &[Film]) -> Self {
        let values: Vec<Vec<_>> = films.iter().map(|f| f.values().collect()).collect();
        let pixels = films.first().map_or(0, |f| f.pixels().len());
        let per_pixel = |f: &dyn Fn(usize) -> f64| (0..pixels).map(|i| f(i) as f32).collect();
        let samples = |f: &Film, i: usize| f.pixels()[i].effective_samples().round();
        Self {
            mean: per_pixel(&|i| values.iter().map(|v| v[i].mean[1]).sum()),
            variance: per_pixel(&|i| values.iter().map(|v| v[i].variance[1]).sum()),
            samples: per_pixel(&|i| films.iter().map(|f| samples(f, i)).fold(f64::INFINITY, f64::min)),
        }
    }

    /// A channel of a picture that knows its variance, as those do that rebond writes as EXR.
    fn of_channel(image: &Image, name: &str) -> Option<Self> {
        let data = |layer: &str, name: &str| {
            let channels = &image.layer(layer)?.channels;
            channels.iter().find(|c| c.name == name).map(|c| c.data.clone())
        };
        Some(Self { mean: data("", name)?, variance: data("variance", name)?, samples: data("samples", "Y")? })
    }

    /// The sum over all pixels, and its standard error.
    pub fn total(&self) -> [f64; 2] {
        let sum = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
        [sum(&self.mean), sum(&self.variance).sqrt()]
    }

    /// Its light over that of another picture, and the standard error.
    pub fn over(&self, other: &Self) -> [f64; 2] {
        let ([a, a_error], [b, b_error]) = (self.total(), other.total());
        [a / b, (a_error / b).hypot(a * b_error / (b * b))]
    }

    fn estimate(&self) -> Estimate<'_> {
        Estimate { mean: &self.mean, variance: &self.variance, samples: &self.samples }
    }

    /// Whether another picture has the same expectation: Welch's test of blocks of this many pixels squared.
    pub fn test(&self, other: &Self, [width, height]: [u32; 2], block: u32, level: f64) -> Welch {
        welch(self.estimate(), other.estimate(), width, height, block, level).expect("pictures of one size")
    }
}

/// The relMSE that the noise of a picture makes of it as a reference.
pub fn noise(film: &Film) -> f64 {
    let of = |v: rebond::film::Value| (0..3).map(|c| v.variance[c] / (v.mean[c].powi(2) + 0.01)).sum::<f64>() / 3.0;
    film.values().map(of).sum::<f64>() / film.pixels().len() as f64
}

/// One test per channel, where both pictures know their variance, and there is any.
pub fn t_tests(a: &Image, b: &Image, block: u32, level: f64) -> Option<Vec<(&'static str, Welch)>> {
    let one = |c: &'static str| {
        let (first, second) = (Means::of_channel(a, c)?, Means::of_channel(b, c)?);
        let test = welch(first.estimate(), second.estimate(), a.width, a.height, block, level).ok()?;
        (test.tested > 0).then_some((c, test))
    };
    ["R", "G", "B"].into_iter().map(one).collect()
}

pub fn verdict(test: &Welch) -> &'static str {
    if test.passes() { "they agree" } else { "they differ" }
}

pub fn of_test(test: &Welch) -> Value {
    json!({ "blocks": test.tested, "below_level": test.below_alpha, "significant": test.significant,
        "below_level_p": test.below_alpha_p, "passes": test.passes() })
}
