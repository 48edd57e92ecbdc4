//! Exact sums.
//!
//! Float sums hang on their order. A film must not: the same bits have to come out for any number of threads, and for
//! [0, a) and [a, b) rendered apart and merged. So sums are wide fixed-point integers, to which every f32 within range
//! is added without error (below 2⁻⁶⁴ it is rounded once, when it is converted).
//!
//! Samples reach them by way of a [`Batch`], which is as exact: it adds up f64s that are cut into pieces so short that
//! a few of them lose nothing.

use super::splats::{Gathered, Splats};
use super::{Channel, Image, Layer};
use crate::math::{self, Moments};

/// Fraction bits of the sums of values and of squares. Sums of squares lose the variance of samples below about 10⁻⁹.
pub(super) const VALUE_BITS: i32 = 64;
pub(super) const SQUARE_BITS: i32 = 64;

/// Where sums of squares stop, 2⁶¹ or 2·10¹⁸: once there they stay, in whatever order they are added.
pub(super) const SQUARES_REACH: i128 = 1 << 125;

/// Values of this size and beyond are taken for errors, as infinities and NaN are.
pub const LARGEST_SAMPLE: f32 = 4_294_967_296.0; // 2³²

/// The f64 nearest to a multiple of 2^−bits.
fn float(x: i128, bits: i32) -> f64 {
    x as f64 * f64::powi(2.0, -bits)
}

/// What one pixel receives in a row, up to [`Batch::CAPACITY`] samples.
///
/// Each row holds one piece of the three channels' numbers: multiples of one power of two, so small that the sum of a
/// batch still fits into the 53 bits of an f64. The fourth column is there for the machine's sake.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(32))]
pub struct Batch {
    values: [[f64; 4]; 2],
    squares: [[f64; 4]; 3],
    samples: u32,
    dropped: u32,
}

/// Last bit of each piece, as a power of two. Values are below 2³², so that no piece is longer than 48 bits.
const VALUE_PIECES: [i32; 2] = [-16, -VALUE_BITS];
const SQUARE_PIECES: [i32; 3] = [21, -22, -SQUARE_BITS];

/// Adds `x` to its sums piece by piece; what is below the last piece is rounded.
#[inline(always)]
fn add_pieces<const N: usize>(sums: &mut [[f64; 4]; N], pieces: [i32; N], mut x: [f64; 4]) {
    for (sum, last_bit) in sums.iter_mut().zip(pieces) {
        // Beside a number of this size there is no room for smaller bits.
        let magnet = 1.5 * f64::from_bits(((1023 + 52 + last_bit) as u64) << 52);
        for c in 0..4 {
            let piece = (x[c] + magnet) - magnet;
            sum[c] += piece;
            x[c] -= piece;
        }
    }
}

/// The sum of the pieces as a multiple of the last one's last bit; [`SQUARES_REACH`] if it is beyond.
fn sum_of_pieces<const N: usize>(sums: &[[f64; 4]; N], pieces: [i32; N], channel: usize) -> i128 {
    let lowest = pieces[N - 1];
    let mut total = 0;
    for (sum, last_bit) in sums.iter().zip(pieces) {
        // The sum of a batch is less than 2⁵³ of these.
        let n = i128::from((sum[channel] * f64::powi(2.0, -last_bit)) as i64);
        let shift = (last_bit - lowest) as u32;
        // Beyond 2¹²⁶ the pieces still to come, which may be negative, bring nothing back within reach.
        if n >> (126 - shift) > 0 {
            return SQUARES_REACH;
        }
        total += n << shift;
    }
    total.min(SQUARES_REACH)
}

impl Batch {
    /// Samples that it holds at most.
    pub const CAPACITY: u32 = 32;

    /// Adds one sample, which counts as much as `weight`, a power of two. A sample that is not finite counts as black, and is
    /// counted.
    #[inline(always)]
    pub fn add(&mut self, rgb: [f32; 3], weight: f32) {
        debug_assert!(self.samples < Self::CAPACITY);
        self.samples += 1;
        let rgb = rgb.map(|x| x * weight);
        if !rgb.iter().all(|x| x.abs() < LARGEST_SAMPLE) {
            self.dropped += 1;
            return;
        }
        let [r, g, b] = rgb.map(f64::from);
        let x = [r, g, b, 0.0];
        add_pieces(&mut self.values, VALUE_PIECES, x);
        add_pieces(&mut self.squares, SQUARE_PIECES, x.map(|x| x * x));
    }
}

/// What one pixel has received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pixel {
    /// Of samples times their weights, and of the squares of that.
    sum: [i128; 3],
    squares: [i128; 3],
    /// Of weights in units of 2⁻⁸, and of their squares in units of 2⁻¹⁶.
    weights: u64,
    squared_weights: u64,
    samples: u64,
    dropped: u64,
}

/// Bits of a weight below 1; those above are as many.
pub(super) const WEIGHT_BITS: i32 = 8;

impl Pixel {
    /// A pixel of these sums; `counts` are the sum of its weights, that of their squares and the number of samples.
    pub(super) fn of_sums(sum: [i128; 3], squares: [i128; 3], counts: [u64; 3]) -> Self {
        let [weights, squared_weights, samples] = counts;
        Self { sum, squares, weights, squared_weights, samples, dropped: 0 }
    }

    /// Adds a batch of samples of this weight, a power of two between 2⁻⁸ and 2⁸.
    pub fn add(&mut self, batch: &Batch, weight: f32) {
        let weight = (weight * f32::powi(2.0, WEIGHT_BITS)) as u64;
        self.weights += u64::from(batch.samples) * weight;
        self.squared_weights += u64::from(batch.samples) * weight * weight;
        for c in 0..3 {
            self.sum[c] += sum_of_pieces(&batch.values, VALUE_PIECES, c);
            let squares = sum_of_pieces(&batch.squares, SQUARE_PIECES, c);
            self.squares[c] = (self.squares[c] + squares).min(SQUARES_REACH);
        }
        self.samples += u64::from(batch.samples);
        self.dropped += u64::from(batch.dropped);
    }

    /// Adds what another one received.
    pub fn merge(&mut self, other: &Self) {
        for c in 0..3 {
            self.sum[c] += other.sum[c];
            self.squares[c] = (self.squares[c] + other.squares[c]).min(SQUARES_REACH);
        }
        self.weights += other.weights;
        self.squared_weights += other.squared_weights;
        self.samples += other.samples;
        self.dropped += other.dropped;
    }

    /// Samples received.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Their mean.
    pub fn mean(&self) -> [f64; 3] {
        let weights = self.weights.max(1) as f64 * f64::powi(2.0, -WEIGHT_BITS);
        self.sum.map(|s| float(s, VALUE_BITS) / weights)
    }

    /// How many samples of equal weight would be as good: (Σw)² / Σw².
    pub fn effective_samples(&self) -> f64 {
        let (sum, of_squares) = (self.weights as f64, self.squared_weights as f64);
        if self.samples == 0 { 0.0 } else { sum * sum / of_squares }
    }

    /// The variance of one sample (unbiased); 0 with fewer than two, infinite where the squares are out of reach.
    pub fn variance(&self) -> [f64; 3] {
        let n = self.effective_samples();
        let squared_weights = self.squared_weights as f64 * f64::powi(2.0, -2 * WEIGHT_BITS);
        let mean = self.mean();
        std::array::from_fn(|c| {
            if self.squares[c] == SQUARES_REACH {
                return f64::INFINITY;
            }
            let spread = float(self.squares[c], SQUARE_BITS) - squared_weights * mean[c] * mean[c];
            let degrees = squared_weights * (1.0 - 1.0 / n);
            if self.samples < 2 || degrees <= 0.0 { 0.0 } else { (spread / degrees).max(0.0) }
        })
    }

    /// What is known of each channel's expectation.
    pub fn moments(&self) -> [Moments; 3] {
        let (n, mean, variance) = (self.effective_samples().round() as u64, self.mean(), self.variance());
        std::array::from_fn(|c| Moments::new(n, mean[c], variance[c]))
    }
}

/// The picture being made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Film {
    width: u32,
    height: u32,
    pixels: Vec<Pixel>,
    /// Parts of the picture, with their names.
    layers: Vec<(String, Vec<Pixel>)>,
    /// Light of all of them that came from other pixels' samples.
    splats: Gathered,
}

/// What is known of a pixel: all its light together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Value {
    /// The mean.
    pub mean: [f64; 3],
    /// The variance of that mean, of this pixel by itself: neighbours that splats or particles of light tie together have means that
    /// vary by more or less than the sum of these.
    pub variance: [f64; 3],
}

impl Film {
    /// A black film.
    pub fn new(width: u32, height: u32) -> Self {
        Self::try_new(width, height, &[]).expect("memory for a film")
    }

    /// A black film with layers of these names, or `None` if there is not enough memory for it.
    pub fn try_new(width: u32, height: u32, layers: &[String]) -> Option<Self> {
        let black = || {
            let mut pixels = Vec::new();
            let n = width as usize * height as usize;
            pixels.try_reserve_exact(n).ok()?;
            pixels.resize(n, Pixel::default());
            Some(pixels)
        };
        let layers = layers.iter().map(|name| Some((name.clone(), black()?))).collect::<Option<_>>()?;
        Some(Self { width, height, pixels: black()?, layers, splats: Gathered::default() })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// What the pixels' own samples brought, row by row from the top left. Light that was splatted is not in it: [`Film::values`]
    /// has all.
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// The pixels, to be added to.
    pub fn pixels_mut(&mut self) -> &mut [Pixel] {
        &mut self.pixels
    }

    /// The layers: their names and pixels.
    pub fn layers(&self) -> &[(String, Vec<Pixel>)] {
        &self.layers
    }

    /// The pixels of a layer, to be added to.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn layer_pixels_mut(&mut self, layer: usize) -> &mut [Pixel] {
        &mut self.layers[layer].1
    }

    /// Adds what a run of paths brings, each of which counts as much as `weight`.
    pub fn splat(&mut self, splats: &Splats, weight: f32) {
        self.splats.add(splats, weight, self.pixels.len());
    }

    /// All light of the picture's pixels.
    pub fn values(&self) -> impl Iterator<Item = Value> {
        self.sheet(0, &self.pixels)
    }

    /// All light of a layer's pixels.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn layer_values(&self, layer: usize) -> impl Iterator<Item = Value> {
        self.sheet(layer + 1, &self.layers[layer].1)
    }

    fn sheet<'a>(&'a self, number: usize, pixels: &'a [Pixel]) -> impl Iterator<Item = Value> + 'a {
        pixels.iter().enumerate().map(move |(i, own)| {
            let of = |p: &Pixel| {
                let moments = p.moments();
                (moments.map(|m| m.mean()), moments.map(|m| m.variance_of_mean()))
            };
            let (mean, variance) = of(own);
            let Some(splatted) = self.splats.pixel(number, i) else { return Value { mean, variance } };
            let more = of(&splatted);
            let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| a[c] + b[c]);
            Value { mean: sum(mean, more.0), variance: sum(variance, more.1) }
        })
    }

    /// Adds what another film of the same size received: for disjoint ranges of samples, the film of their union.
    ///
    /// # Panics
    /// If the sizes or the layers differ.
    pub fn merge(&mut self, other: &Film) {
        assert_eq!((self.width, self.height), (other.width, other.height), "films of different sizes");
        let merge = |to: &mut [Pixel], from: &[Pixel]| to.iter_mut().zip(from).for_each(|(a, b)| a.merge(b));
        merge(&mut self.pixels, &other.pixels);
        assert!(self.layers.iter().map(|l| &l.0).eq(other.layers.iter().map(|l| &l.0)), "films of different layers");
        for (to, from) in self.layers.iter_mut().zip(&other.layers) {
            merge(&mut to.1, &from.1);
        }
        self.splats.merge(&other.splats);
    }

    /// All samples received.
    pub fn samples(&self) -> u64 {
        self.pixels.iter().map(|p| p.samples).sum()
    }

    /// Samples that were not finite and counted as black.
    pub fn dropped_samples(&self) -> u64 {
        self.pixels.iter().map(|p| p.dropped).sum::<u64>() + self.splats.dropped()
    }

    /// The estimated relative error of the picture: the root of the mean over pixels of [`Film::squared_errors`]. Infinite while
    /// some pixel has fewer than two samples.
    pub fn relative_error(&self) -> f64 {
        (self.squared_errors().sum::<f64>() / self.pixels.len() as f64).sqrt()
    }

    /// The estimated squared relative error of each pixel: the squared standard error of the luminance, over the squared
    /// luminance (+ 0.01 of the picture's mean luminance squared, so that black pixels count little). Samples count as
    /// independent, so stratified ones do better than this says. Infinite with fewer than two samples.
    pub fn squared_errors(&self) -> impl Iterator<Item = f64> {
        let luminance = |c: [f64; 3]| math::LUMINANCE.iter().zip(c).map(|(w, x)| f64::from(*w) * x).sum::<f64>();
        let mean = luminance(self.mean());
        self.pixels.iter().zip(self.values()).map(move |(p, value)| {
            if p.samples < 2 {
                return f64::INFINITY;
            }
            // The channels of a sample rise and fall together: standard errors add up.
            let error = luminance(value.variance.map(f64::sqrt));
            let l = luminance(value.mean);
            error * error / (l * l + 0.01 * mean * mean).max(f64::MIN_POSITIVE)
        })
    }

    /// The mean of all pixels.
    pub fn mean(&self) -> [f64; 3] {
        let n = self.pixels.len() as f64;
        self.values().fold([0.0; 3], |sum, p| std::array::from_fn(|c| sum[c] + p.mean[c] / n))
    }

    /// The picture, the variance of its pixels (of the mean, not of one sample), their sample counts, and its parts, as layers.
    pub fn develop(&self) -> Image {
        let colours = |values: &[Value], f: fn(&Value) -> [f64; 3]| -> Vec<[f32; 3]> {
            values.iter().map(|v| f(v).map(|x| x as f32)).collect()
        };
        let whole: Vec<Value> = self.values().collect();
        let parts = self.layers.iter().enumerate().map(|(i, (name, _))| {
            let values: Vec<Value> = self.layer_values(i).collect();
            Layer::rgb(name, &colours(&values, |v| v.mean))
        });
        let samples = Channel { name: "Y".into(), data: self.pixels.iter().map(|p| p.samples as f32).collect() };
        Image {
            width: self.width,
            height: self.height,
            layers: [
                Layer::rgb("", &colours(&whole, |v| v.mean)),
                Layer::rgb("variance", &colours(&whole, |v| v.variance)),
                Layer { name: "samples".into(), channels: vec![samples] },
            ]
            .into_iter()
            .chain(parts)
            .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pixel(samples: &[[f32; 3]]) -> Pixel {
        let mut pixel = Pixel::default();
        for run in samples.chunks(Batch::CAPACITY as usize) {
            let mut batch = Batch::default();
            run.iter().for_each(|s| batch.add(*s, 1.0));
            pixel.add(&batch, 1.0);
        }
        pixel
    }

    proptest! {
        #[test]
        fn sums_are_exact_and_free_of_order(values in prop::collection::vec(prop::array::uniform3(-1e6f32..1e9), 1..60), cut in 0usize..60) {
            let whole = pixel(&values);
            let mut reversed = values.clone();
            reversed.reverse();
            prop_assert_eq!(whole, pixel(&reversed));
            let (first, second) = values.split_at(cut.min(values.len()));
            let (mut a, b) = (pixel(first), pixel(second));
            a.merge(&b);
            prop_assert_eq!(whole, a);
            for c in 0..3 {
                let exact = values.iter().map(|v| f64::from(v[c])).sum::<f64>() / values.len() as f64;
                prop_assert!((whole.mean()[c] - exact).abs() <= 1e-12 * exact.abs().max(1e6));
            }
        }

        /// Against integers: every f32 is a multiple of 2⁻¹⁴⁹, and of the pieces' last bit where it is large enough.
        #[test]
        fn pieces_lose_nothing(values in prop::collection::vec(prop_oneof![-4.2e9f32..4.2e9, -1.0f32..1.0, -1e-6f32..1e-6], 1..33)) {
            let samples: Vec<[f32; 3]> = values.iter().map(|x| [*x, 0.0, -x]).collect();
            let fixed = |x: f64, bits: i32| -> i128 {
                let (mantissa, exponent) = ((x.to_bits() & ((1 << 52) - 1)) | 1 << 52, (x.to_bits() >> 52 & 0x7ff) as i32);
                let shift = exponent - 1075 + bits;
                let magnitude = match shift {
                    _ if x == 0.0 => 0,
                    0.. => i128::from(mantissa) << shift,
                    // Rounded to even.
                    -60..0 => {
                        let (kept, rest) = (mantissa >> -shift, mantissa & ((1 << -shift) - 1));
                        let half = 1_u64 << (-shift - 1);
                        i128::from(kept + u64::from(rest > half || rest == half && kept & 1 == 1))
                    }
                    _ => 0,
                };
                if x < 0.0 { -magnitude } else { magnitude }
            };
            let p = pixel(&samples);
            let sum: i128 = values.iter().map(|x| fixed(f64::from(*x), VALUE_BITS)).sum();
            prop_assert_eq!(p.sum, [sum, 0, -sum]);
            if values.iter().all(|x| x.abs() < 3e8) {
                let squares: i128 = values.iter().map(|x| fixed(f64::from(*x).powi(2), SQUARE_BITS)).sum();
                prop_assert_eq!(p.squares, [squares, 0, squares]);
            }
        }
    }

    /// Samples that count for less come more often: the expectation stays, and the variance is that of theory.
    #[test]
    fn weights() {
        let values: Vec<f32> = (0..32).map(|i| ((i * 37) % 32) as f32).collect();
        let mut pixel = Pixel::default();
        // Σw = 8·4 + 32/4 = 40, Σw² = 8·16 + 32/16 = 130.
        for (count, weight) in [(8, 4.0), (32, 0.25)] {
            let mut batch = Batch::default();
            values[..count].iter().for_each(|x| batch.add([*x; 3], weight));
            pixel.add(&batch, weight);
        }
        let sum = |n: usize, power: i32| values[..n].iter().map(|x| f64::from(*x).powi(power)).sum::<f64>();
        let mean = (4.0 * sum(8, 1) + 0.25 * sum(32, 1)) / 40.0;
        assert!((pixel.mean()[0] - mean).abs() < 1e-12);
        let n = 40.0 * 40.0 / 130.0;
        assert!((pixel.effective_samples() - n).abs() < 1e-12);
        let variance = (16.0 * sum(8, 2) + sum(32, 2) / 16.0 - 130.0 * mean * mean) / (130.0 * (1.0 - 1.0 / n));
        assert!((pixel.variance()[0] - variance).abs() < 1e-9 * variance);
        assert_eq!(pixel.samples(), 40);
    }

    #[test]
    fn variance_and_bad_samples() {
        let mut p = pixel(&[1.0, 2.0, 3.0, 4.0].map(|x| [x, 5.0, 0.0]));
        assert_eq!(p.mean(), [2.5, 5.0, 0.0]);
        assert!((p.variance()[0] - 5.0 / 3.0).abs() < 1e-12 && p.variance()[1].abs() < 1e-9);
        // Squares may be out of reach; the mean is not touched.
        let bright = pixel(&[3e9, 4e9, 1.0].map(|x| [x; 3]));
        assert_eq!((bright.mean()[0], bright.dropped), (7_000_000_001.0 / 3.0, 0));
        assert_eq!(bright.variance()[0], f64::INFINITY);
        let dim = pixel(&[1e-8, 3e-8].map(|x| [x; 3]));
        assert!((dim.variance()[0] / 2e-16 - 1.0).abs() < 1e-3);
        p.merge(&pixel(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30].map(|bad| [0.0, bad, 0.0])));
        assert_eq!((p.samples, p.dropped, p.mean()), (8, 4, [1.25, 2.5, 0.0]));
    }
}
