//! Adaptive sampling: tiles where the estimated error is large get more samples, those where it is small fewer.
//!
//! A pass of W samples per pixel gives each pixel of tile t a power of two times as many, n = W 2ʲ, and each of them counts
//! W/n. Then every pass has the same weight in every pixel, whatever was seen before, and
//!
//! ```text
//! I ≈ Σ_passes W · (1/n Σ f(X_i)/pdf(X_i)) / Σ_passes W
//! ```
//!
//! is unbiased: n hangs on earlier passes only, and given those each pass has the expectation I, since it draws sample values of
//! its own (the next points of one sequence would lie where those before left gaps). Pooling all samples alike
//! would not be (Kirk and Arvo 1991): pixels whose first samples happened to be black would keep them.
//!
//! The mean squared error at a given cost is least for n ∝ √(variance of one sample), by Lagrange's multiplier. Here that is the
//! variance relative to the pixel's value, averaged over the tile so that it is known well enough.

use super::Region;
use super::tiles::{SIDE, tiles_of};
use crate::film::Film;

/// Fewest and most samples of a pass, as powers of two times their mean.
const LEAST: i32 = -3;
const MOST: i32 = 4;

/// What a tile gets in a pass: log₂ of its samples over those of the pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share(i32);

impl Share {
    /// The samples of each pixel in a pass of `mean`, and what each of them counts.
    pub(super) fn samples(self, mean: u32) -> (u32, f32) {
        (if self.0 < 0 { mean >> -self.0 } else { mean << self.0 }, f32::powi(2.0, -self.0))
    }
}

/// What the tiles get in a pass of `mean` samples per pixel, judged by the film so far.
pub fn shares(film: &Film, region: &Region, mean: u32) -> Vec<Share> {
    exponents(&errors(film, region), mean).into_iter().map(Share).collect()
}

/// The pixels of a tile, and √(relative variance of one sample) there.
type Judged = (f64, f64);

/// What is known of each tile; none while something is not.
fn errors(film: &Film, region: &Region) -> Vec<Judged> {
    let [columns, rows] = tiles_of(region);
    let mut sums = vec![(0.0, 0.0); columns as usize * rows as usize];
    let width = film.width() as usize;
    for (i, (squared, pixel)) in film.squared_errors().zip(film.pixels()).enumerate() {
        let (x, y) = (i % width, i / width);
        let tile = (y / SIDE as usize) * columns as usize + x / SIDE as usize;
        sums[tile].0 += 1.0;
        sums[tile].1 += squared * pixel.effective_samples();
    }
    sums.into_iter().map(|(pixels, sum)| (pixels, (sum / pixels).sqrt())).collect()
}

/// The power of two for each tile, nearest to its share of the samples, so that their mean over pixels is about `mean`.
fn exponents(tiles: &[Judged], mean: u32) -> Vec<i32> {
    let largest = tiles.iter().fold(0.0, |most: f64, (_, error)| most.max(*error));
    if largest == 0.0 || !tiles.iter().all(|(_, error)| error.is_finite()) {
        return vec![0; tiles.len()];
    }
    // Fewer samples than one there are not, nor any but whole numbers of them.
    let least = LEAST.max(-(mean.trailing_zeros() as i32));
    let of_scale = |scale: f64| {
        tiles.iter().map(move |(_, e)| (e * scale).log2().round().clamp(f64::from(least), f64::from(MOST)) as i32)
    };
    let pixels: f64 = tiles.iter().map(|(pixels, _)| pixels).sum();
    let cost = |scale: f64| of_scale(scale).zip(tiles).map(|(j, (p, _))| p * f64::powi(2.0, j)).sum::<f64>() / pixels;
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
        // Of different sizes, as at the edge of a picture.
        let tiles: Vec<Judged> =
            (0..64).map(|i| (if i % 8 == 0 { 16.0 } else { 256.0 }, f64::powi(2.0, i % 4))).collect();
        let exponents = exponents(&tiles, 64);
        for ((_, error), j) in tiles.iter().zip(&exponents) {
            assert_eq!(f64::from(*j) - f64::from(exponents[0]), error.log2());
        }
        let pixels: f64 = tiles.iter().map(|t| t.0).sum();
        let cost = exponents.iter().zip(&tiles).map(|(j, t)| t.0 * f64::powi(2.0, *j)).sum::<f64>() / pixels;
        assert!(cost <= 1.0 && cost > 0.5, "{cost}");
    }

    #[test]
    fn what_is_not_known_is_sampled_evenly() {
        assert_eq!(exponents(&[(256.0, 1.0), (256.0, f64::INFINITY)], 16), [0, 0]);
        assert_eq!(exponents(&[(256.0, 0.0), (256.0, 0.0)], 16), [0, 0]);
        // An odd number of samples has no half.
        assert!(exponents(&[(256.0, 1.0), (256.0, 1e-9)], 17).iter().all(|j| *j >= 0));
        assert_eq!((Share(-2).samples(16), Share(3).samples(5)), ((4, 4.0), (40, 0.125)));
    }
}
