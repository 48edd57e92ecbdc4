//! Adaptive sampling: tiles where the estimated error is large get more samples, those where it is small fewer.
//!
//! A pass of W samples per pixel gives each pixel of tile t a power of two times as many, n = W 2ʲ, and each of them counts
//! W/n. Then every pass has the same weight in every pixel, whatever was seen before, and
//!
//! ```text
//! I ≈ Σ_passes W · (1/n Σ f(X_i)/pdf(X_i)) / Σ_passes W
//! ```
//!
//! is unbiased: n hangs on earlier passes only, and given those each pass has the expectation I. Pooling all samples alike
//! would not be (Kirk and Arvo 1991): pixels whose first samples happened to be black would keep them.
//!
//! The mean squared error at a given cost is least for n ∝ √(variance of one sample), by Lagrange's multiplier. Here that is the
//! variance relative to the pixel's value, averaged over the tile so that it is known well enough.

use super::Region;
use super::tiles::{SIDE, tiles_of};
use crate::film::Film;
use std::ops::Range;

/// Fewest and most samples of a pass, as powers of two times their mean.
const LEAST: i32 = -3;
const MOST: i32 = 4;

/// What a tile gets in a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Index of its first sample.
    first: u32,
    /// log₂ of its samples over those of the pass.
    exponent: i32,
}

impl Share {
    /// The samples of each pixel in a pass of `mean`, and what each of them counts.
    pub(super) fn samples(&self, mean: u32) -> (Range<u32>, f32) {
        (self.first..self.first.saturating_add(scaled(mean, self.exponent)), f32::powi(2.0, -self.exponent))
    }
}

/// n 2ʲ, where that is a whole number.
fn scaled(n: u32, exponent: i32) -> u32 {
    if exponent < 0 { n >> -exponent } else { n << exponent }
}

/// Hands out the samples of a render.
pub struct Adaptive {
    tiles: [u32; 2],
    /// Index of the first sample that each tile has not taken.
    next: Vec<u32>,
}

impl Adaptive {
    pub fn new(region: &Region, first: u32) -> Self {
        let tiles = tiles_of(region);
        Self { tiles, next: vec![first; tiles[0] as usize * tiles[1] as usize] }
    }

    /// What the tiles get in a pass of `mean` samples per pixel, judged by the film so far.
    pub fn shares(&mut self, film: &Film, mean: u32) -> Vec<Share> {
        let exponents = exponents(&self.errors(film), mean);
        let share = |(next, exponent): (&mut u32, i32)| {
            let n = scaled(mean, exponent);
            // Runs of 2ᵏ Sobol points are nets only where they start at a multiple of 2ᵏ.
            let first = next.checked_next_multiple_of(n.next_power_of_two()).unwrap_or(*next);
            *next = first.saturating_add(n);
            Share { first, exponent }
        };
        self.next.iter_mut().zip(exponents).map(share).collect()
    }

    /// √(relative variance of one sample) of each tile; none while it is not known.
    fn errors(&self, film: &Film) -> Vec<Option<f64>> {
        let mut sums = vec![(0.0, 0.0); self.next.len()];
        let width = film.width() as usize;
        for (i, (squared, pixel)) in film.squared_errors().zip(film.pixels()).enumerate() {
            let (x, y) = (i % width, i / width);
            let tile = (y / SIDE as usize) * self.tiles[0] as usize + x / SIDE as usize;
            sums[tile].0 += squared * pixel.effective_samples();
            sums[tile].1 += 1.0;
        }
        sums.into_iter().map(|(sum, n)| (sum / n).sqrt()).map(|e| e.is_finite().then_some(e)).collect()
    }
}

/// The power of two for each tile, nearest to its share of the samples, so that their mean is about `mean`.
fn exponents(errors: &[Option<f64>], mean: u32) -> Vec<i32> {
    let Some(errors) = errors.iter().copied().collect::<Option<Vec<f64>>>() else { return vec![0; errors.len()] };
    // Fewer samples than one there are not, nor any but whole numbers of them.
    let least = LEAST.max(-(mean.trailing_zeros() as i32));
    let of_scale = |scale: f64| {
        errors.iter().map(move |e| (e * scale).log2().round().clamp(f64::from(least), f64::from(MOST)) as i32)
    };
    let cost = |scale: f64| of_scale(scale).map(|j| f64::powi(2.0, j)).sum::<f64>() / errors.len() as f64;
    let largest = errors.iter().copied().fold(0.0, f64::max);
    if largest == 0.0 {
        return vec![0; errors.len()];
    }
    // The cost grows with the scale, in small steps: bisection.
    let (mut low, mut high) = (1e-3 / largest, 1e-3 / largest);
    while cost(high) < 1.0 && high * largest < 1e12 {
        high *= 2.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if cost(middle) <= 1.0 { low = middle } else { high = middle }
    }
    of_scale(low).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_error_at_the_same_cost() {
        let errors: Vec<Option<f64>> = (0..64).map(|i| Some(f64::powi(2.0, i % 4))).collect();
        let exponents = exponents(&errors, 64);
        for (e, j) in errors.iter().zip(&exponents) {
            assert_eq!(f64::from(*j) - f64::from(exponents[0]), e.map_or(0.0, f64::log2));
        }
        let cost = exponents.iter().map(|j| f64::powi(2.0, *j)).sum::<f64>() / 64.0;
        assert!(cost <= 1.0 && cost > 0.5, "{cost}");
    }

    #[test]
    fn what_is_not_known_is_sampled_evenly() {
        assert_eq!(exponents(&[Some(1.0), None], 16), [0, 0]);
        assert_eq!(exponents(&[Some(0.0), Some(0.0)], 16), [0, 0]);
        // An odd number of samples has no half.
        assert!(exponents(&[Some(1.0), Some(1e-9)], 17).iter().all(|j| *j >= 0));
    }

    #[test]
    fn runs_start_at_multiples() {
        let region = Region::whole(32, 16);
        let mut adaptive = Adaptive { tiles: tiles_of(&region), next: vec![5, 40] };
        let shares = adaptive.shares(&Film::new(32, 16), 16);
        assert_eq!(shares.iter().map(|s| s.samples(16)).collect::<Vec<_>>(), [(16..32, 1.0), (48..64, 1.0)]);
        assert_eq!(Share { first: 8, exponent: -2 }.samples(16), (8..12, 4.0));
    }
}
