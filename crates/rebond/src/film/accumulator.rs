//! Exact sums.
//!
//! Float sums hang on their order. A film must not: the same bits have to come out for any number of threads, and for
//! [0, a) and [a, b) rendered apart and merged. So sums are wide fixed-point integers, to which every f32 within range
//! is added without error (below 2⁻⁶⁴ it is rounded once, when it is converted).

use super::{Channel, Image, Layer};
use crate::math;

/// Fraction bits of the sums of values and of squares. An i128 then reaches to 9·10¹⁸; sums of squares saturate there,
/// and lose the variance of samples below about 10⁻⁹.
const VALUE_BITS: i32 = 64;
const SQUARE_BITS: i32 = 64;

/// Values of this size and beyond are taken for errors, as infinities and NaN are.
pub const LARGEST_SAMPLE: f32 = 4_294_967_296.0; // 2³²

/// A finite number as a multiple of 2^−bits, rounded towards zero; the largest i128 if it is out of reach.
#[inline(always)]
fn fixed(x: f64, bits: i32) -> i128 {
    let b = x.to_bits();
    let exponent = (b >> 52 & 0x7ff) as i32;
    let mantissa = ((b & ((1 << 52) - 1)) | 1 << 52) as i128;
    let shift = exponent - 1075 + bits;
    let magnitude = match shift {
        75.. => i128::MAX,
        0.. => mantissa << shift,
        _ => mantissa >> (-shift).min(127),
    };
    if x < 0.0 { -magnitude } else { magnitude }
}

/// The f64 nearest to a multiple of 2^−bits.
fn float(x: i128, bits: i32) -> f64 {
    x as f64 * f64::powi(2.0, -bits)
}

/// What one pixel has received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pixel {
    sum: [i128; 3],
    squares: [i128; 3],
    samples: u64,
    dropped: u64,
}

impl Pixel {
    /// Adds one sample. A sample that is not finite counts as black, and is counted.
    #[inline(always)]
    pub fn add(&mut self, rgb: [f32; 3]) {
        self.samples += 1;
        if !rgb.iter().all(|x| x.abs() < LARGEST_SAMPLE) {
            self.dropped += 1;
            return;
        }
        for (c, x) in rgb.iter().enumerate() {
            let x = f64::from(*x);
            self.sum[c] += fixed(x, VALUE_BITS);
            self.squares[c] = self.squares[c].saturating_add(fixed(x * x, SQUARE_BITS));
        }
    }

    /// Adds what another one received.
    pub fn merge(&mut self, other: &Self) {
        for c in 0..3 {
            self.sum[c] += other.sum[c];
            self.squares[c] = self.squares[c].saturating_add(other.squares[c]);
        }
        self.samples += other.samples;
        self.dropped += other.dropped;
    }

    /// Samples received.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Their mean.
    pub fn mean(&self) -> [f64; 3] {
        self.sum.map(|s| float(s, VALUE_BITS) / (self.samples.max(1)) as f64)
    }

    /// The variance of one sample (unbiased); 0 with fewer than two, infinite where the squares are out of reach.
    pub fn variance(&self) -> [f64; 3] {
        let n = self.samples as f64;
        let mean = self.mean();
        std::array::from_fn(|c| {
            if self.squares[c] == i128::MAX {
                return f64::INFINITY;
            }
            let sum_of_squares = float(self.squares[c], SQUARE_BITS) - n * mean[c] * mean[c];
            if self.samples < 2 { 0.0 } else { (sum_of_squares / (n - 1.0)).max(0.0) }
        })
    }
}

/// The picture being made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Film {
    width: u32,
    height: u32,
    pixels: Vec<Pixel>,
}

impl Film {
    /// A black film.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![Pixel::default(); width as usize * height as usize] }
    }

    /// A black film, or `None` if there is not enough memory for it.
    pub fn try_new(width: u32, height: u32) -> Option<Self> {
        let mut pixels = Vec::new();
        let n = width as usize * height as usize;
        pixels.try_reserve_exact(n).ok()?;
        pixels.resize(n, Pixel::default());
        Some(Self { width, height, pixels })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row by row from the top left.
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// The pixels, to be added to.
    pub fn pixels_mut(&mut self) -> &mut [Pixel] {
        &mut self.pixels
    }

    /// Adds what another film of the same size received: for disjoint ranges of samples, the film of their union.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn merge(&mut self, other: &Film) {
        assert_eq!((self.width, self.height), (other.width, other.height), "films of different sizes");
        for (a, b) in self.pixels.iter_mut().zip(&other.pixels) {
            a.merge(b);
        }
    }

    /// All samples received.
    pub fn samples(&self) -> u64 {
        self.pixels.iter().map(|p| p.samples).sum()
    }

    /// Samples that were not finite and counted as black.
    pub fn dropped_samples(&self) -> u64 {
        self.pixels.iter().map(|p| p.dropped).sum()
    }

    /// The estimated relative error of the picture: the root of the mean over pixels of the squared standard error of
    /// the luminance, over the squared luminance (+ 0.01 of the mean luminance squared, so that black pixels count
    /// little). Samples count as independent, so stratified ones do better than this says. Infinite while some pixel
    /// has fewer than two samples.
    pub fn relative_error(&self) -> f64 {
        let luminance = |c: [f64; 3]| math::LUMINANCE.iter().zip(c).map(|(w, x)| f64::from(*w) * x).sum::<f64>();
        let mean = self.pixels.iter().map(|p| luminance(p.mean())).sum::<f64>() / self.pixels.len() as f64;
        let one = |p: &Pixel| {
            if p.samples < 2 {
                return f64::INFINITY;
            }
            // The channels of a sample rise and fall together: standard deviations add up.
            let deviation = luminance(p.variance().map(f64::sqrt));
            let l = luminance(p.mean());
            deviation * deviation / p.samples as f64 / (l * l + 0.01 * mean * mean).max(f64::MIN_POSITIVE)
        };
        (self.pixels.iter().map(one).sum::<f64>() / self.pixels.len() as f64).sqrt()
    }

    /// The mean of all pixels.
    pub fn mean(&self) -> [f64; 3] {
        let n = self.pixels.len() as f64;
        self.pixels.iter().fold([0.0; 3], |sum, p| {
            let m = p.mean();
            std::array::from_fn(|c| sum[c] + m[c] / n)
        })
    }

    /// The picture, the variance of its pixels (of the mean, not of one sample) and their sample counts, as layers.
    pub fn develop(&self) -> Image {
        let colours = |f: &dyn Fn(&Pixel) -> [f64; 3]| -> Vec<[f32; 3]> {
            self.pixels.iter().map(|p| f(p).map(|x| x as f32)).collect()
        };
        let of_mean = |p: &Pixel| p.variance().map(|v| v / p.samples.max(1) as f64);
        let samples = Channel { name: "Y".into(), data: self.pixels.iter().map(|p| p.samples as f32).collect() };
        Image {
            width: self.width,
            height: self.height,
            layers: vec![
                Layer::rgb("", &colours(&Pixel::mean)),
                Layer::rgb("variance", &colours(&of_mean)),
                Layer { name: "samples".into(), channels: vec![samples] },
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_exact_and_free_of_order(values in prop::collection::vec(prop::array::uniform3(-1e6f32..1e9), 1..60), cut in 0usize..60) {
            let mut whole = Pixel::default();
            values.iter().for_each(|v| whole.add(*v));
            let mut reversed = Pixel::default();
            values.iter().rev().for_each(|v| reversed.add(*v));
            prop_assert_eq!(whole, reversed);
            let (mut a, mut b) = (Pixel::default(), Pixel::default());
            let (first, second) = values.split_at(cut.min(values.len()));
            first.iter().for_each(|v| a.add(*v));
            second.iter().for_each(|v| b.add(*v));
            a.merge(&b);
            prop_assert_eq!(whole, a);
            for c in 0..3 {
                let exact = values.iter().map(|v| f64::from(v[c])).sum::<f64>() / values.len() as f64;
                prop_assert!((whole.mean()[c] - exact).abs() <= 1e-12 * exact.abs().max(1e6));
            }
        }

        #[test]
        fn fixed_point_goes_there_and_back(x in prop_oneof![-1e9f32..1e9, -1.0f32..1.0, -1e-9f32..1e-9]) {
            let x = f64::from(x);
            prop_assert!((float(fixed(x, VALUE_BITS), VALUE_BITS) - x).abs() <= f64::powi(2.0, -64));
        }
    }

    #[test]
    fn variance_and_bad_samples() {
        let mut p = Pixel::default();
        [1.0, 2.0, 3.0, 4.0].iter().for_each(|x| p.add([*x, 5.0, 0.0]));
        assert_eq!(p.mean(), [2.5, 5.0, 0.0]);
        assert!((p.variance()[0] - 5.0 / 3.0).abs() < 1e-12 && p.variance()[1].abs() < 1e-9);
        // Squares may be out of reach; the mean is not touched.
        let mut bright = Pixel::default();
        [3e9, 4e9, 1.0].iter().for_each(|x| bright.add([*x; 3]));
        assert_eq!((bright.mean()[0], bright.dropped), (7_000_000_001.0 / 3.0, 0));
        assert_eq!(bright.variance()[0], f64::INFINITY);
        let mut dim = Pixel::default();
        [1e-8, 3e-8].iter().for_each(|x| dim.add([*x; 3]));
        assert!((dim.variance()[0] / 2e-16 - 1.0).abs() < 1e-3);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
            p.add([0.0, bad, 0.0]);
        }
        assert_eq!((p.samples, p.dropped, p.mean()), (8, 4, [1.25, 2.5, 0.0]));
    }
}
