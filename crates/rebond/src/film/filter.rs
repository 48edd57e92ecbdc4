//! Reconstruction filters, importance-sampled: a sample lands in one pixel, at an offset drawn from the filter.
//!
//! All are separable. A filter with negative lobes is drawn from |f| and gives some samples a negative weight.

use rebond_lanes::{Index, Mask, Real, Record};
use serde::{Deserialize, Serialize};

/// Which filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum FilterSettings {
    /// 1 within `radius`.
    Box {
        /// Half-width in pixels.
        #[serde(default = "half")]
        radius: f32,
    },
    /// Linear from the centre to `radius`.
    Tent {
        /// Half-width in pixels.
        #[serde(default = "one")]
        radius: f32,
    },
    /// A Gaussian, shifted to vanish at its radius.
    Gaussian {
        /// Standard deviation in pixels.
        #[serde(default = "half")]
        stddev: f32,
        /// Half-width in pixels; four standard deviations if not given.
        #[serde(default)]
        radius: Option<f32>,
    },
    /// Mitchell and Netravali's cubic (1988).
    Mitchell {
        /// Their B.
        #[serde(default = "third", rename = "B", alias = "b")]
        b: f32,
        /// Their C.
        #[serde(default = "third", rename = "C", alias = "c")]
        c: f32,
    },
    /// The four-term Blackman–Harris window.
    BlackmanHarris {
        /// Half-width in pixels.
        #[serde(default = "three_halves")]
        radius: f32,
    },
}

fn half() -> f32 {
    0.5
}
fn one() -> f32 {
    1.0
}
fn third() -> f32 {
    1.0 / 3.0
}
fn three_halves() -> f32 {
    1.5
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self::Gaussian { stddev: 0.5, radius: None }
    }
}

impl FilterSettings {
    /// Half-width in pixels.
    pub fn radius(&self) -> f32 {
        match *self {
            Self::Box { radius } | Self::Tent { radius } | Self::BlackmanHarris { radius } => radius,
            Self::Gaussian { stddev, radius } => radius.unwrap_or(4.0 * stddev),
            Self::Mitchell { .. } => 2.0,
        }
    }

    /// The value at distance x from the centre, of one dimension; not normalised.
    pub fn eval(&self, x: f64) -> f64 {
        let x = x.abs();
        let radius = f64::from(self.radius());
        if x > radius {
            return 0.0;
        }
        match *self {
            Self::Box { .. } => 1.0,
            Self::Tent { .. } => 1.0 - x / radius,
            Self::Gaussian { stddev, .. } => {
                let bell = |x: f64| (-0.5 * (x / f64::from(stddev)).powi(2)).exp();
                bell(x) - bell(radius)
            }
            Self::Mitchell { b, c } => {
                let (b, c) = (f64::from(b), f64::from(c));
                let p = if x < 1.0 {
                    [12.0 - 9.0 * b - 6.0 * c, -18.0 + 12.0 * b + 6.0 * c, 0.0, 6.0 - 2.0 * b]
                } else {
                    [-b - 6.0 * c, 6.0 * b + 30.0 * c, -12.0 * b - 48.0 * c, 8.0 * b + 24.0 * c]
                };
                (((p[0] * x + p[1]) * x + p[2]) * x + p[3]) / 6.0
            }
            Self::BlackmanHarris { .. } => {
                let t = std::f64::consts::PI * (x / radius + 1.0);
                0.35875 - 0.48829 * t.cos() + 0.14128 * (2.0 * t).cos() - 0.01168 * (3.0 * t).cos()
            }
        }
    }
}

/// A filter ready to be sampled: the inverse of its distribution function, tabulated.
#[derive(Clone, Debug)]
pub struct Filter {
    /// Interval i of the distribution: [offset at its start, offset at its end, weight, density at its start over the
    /// mean of those at both ends].
    inverse: Vec<Record>,
    /// Whether offsets are simply uniform.
    uniform: Option<f32>,
    settings: FilterSettings,
    /// The filter's values at even distances from 0 to its radius, its integral being 1, and how far it is to the next.
    values: Vec<Record>,
    /// Of those, how many to a pixel.
    per_unit: f32,
}

/// Pixels along an axis whose values a splat keeps; filters of a radius beyond 4 are looked up twice.
const KEPT: usize = 8;

/// Intervals of the table of values: linear between them, a filter is off by less than 10⁻⁶.
const VALUES: usize = 4096;

/// The table has three zones of intervals of equal probability: the lower tail, the middle and the upper tail. Within
/// an interval the density is taken as linear.
const ZONE: usize = 256;
/// Probability of each tail.
const TAIL: f64 = 1.0 / 32.0;

/// The probability up to the start of interval i.
fn probability_below(i: usize) -> f64 {
    let (zone, share) = (i / ZONE, (i % ZONE) as f64 / ZONE as f64);
    match zone {
        0 => share * TAIL,
        1 => TAIL + share * (1.0 - 2.0 * TAIL),
        2 => 1.0 - TAIL + share * TAIL,
        _ => 1.0,
    }
}

impl Filter {
    /// The filter of these settings, which must have a positive radius.
    pub fn new(settings: FilterSettings) -> Self {
        if let FilterSettings::Box { radius } = settings {
            return Self { inverse: Vec::new(), uniform: Some(radius), settings, values: Vec::new(), per_unit: 0.0 };
        }
        let radius = f64::from(settings.radius());
        let fine = 1 << 16;
        let width = 2.0 * radius / f64::from(fine);
        let values: Vec<f64> = (0..fine).map(|i| settings.eval(-radius + (f64::from(i) + 0.5) * width)).collect();
        let absolute: f64 = values.iter().map(|v| v.abs()).sum();
        let signed: f64 = values.iter().sum();
        let mut edges = vec![(-radius, 0.0)]; // (offset, signed integral up to it)
        let (mut sum, mut signed_sum) = (0.0, 0.0);
        for (i, v) in values.iter().enumerate() {
            let (start, next) = (-radius + i as f64 * width, sum + v.abs());
            while edges.len() < 3 * ZONE && next >= probability_below(edges.len()) * absolute {
                let part = (probability_below(edges.len()) * absolute - sum) / v.abs();
                edges.push((start + part * width, signed_sum + part * v));
            }
            (sum, signed_sum) = (next, signed_sum + v);
        }
        edges.resize(3 * ZONE, (radius, signed_sum));
        edges.push((radius, signed));
        // A weight is the signed integral of its interval, over the probability of being there.
        let interval = |(i, e): (usize, &[(f64, f64)])| {
            let probability = probability_below(i + 1) - probability_below(i);
            let weight = (e[1].1 - e[0].1) / signed / probability;
            let (at_start, at_end) = (settings.eval(e[0].0).abs(), settings.eval(e[1].0).abs());
            let start = if at_start + at_end > 0.0 { 2.0 * at_start / (at_start + at_end) } else { 1.0 };
            Record([e[0].0 as f32, e[1].0 as f32, weight as f32, start as f32])
        };
        let inverse = edges.windows(2).enumerate().map(interval).collect();
        let value = |i: usize| settings.eval(radius * i as f64 / VALUES as f64) / (signed * width);
        let values =
            (0..VALUES).map(|i| Record([value(i) as f32, (value(i + 1) - value(i)) as f32, 0.0, 0.0])).collect();
        Self { inverse, uniform: None, settings, values, per_unit: VALUES as f32 / radius as f32 }
    }

    /// Offsets from the pixel's centre along both axes, and the sample's weight (mean 1).
    #[inline(always)]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> ([F; 2], F) {
        if let Some(radius) = self.uniform {
            return (u.map(|u| (u * 2.0 - 1.0) * radius), F::one());
        }
        let axis = |u: F| {
            let (tail, middle) = (TAIL as f32, 1.0 - 2.0 * TAIL as f32);
            let zone = ZONE as f32;
            let lower = u * (zone / tail);
            let inner = (u - tail) * (zone / middle) + zone;
            let upper = (u - (1.0 - tail)) * (zone / tail) + 2.0 * zone;
            let scaled = F::select(u.lt(F::splat(tail)), lower, F::select(u.lt(F::splat(1.0 - tail)), inner, upper));
            let i = scaled.to_index();
            let [start, end, weight, d] = F::record(&self.inverse, i);
            let share = scaled - F::from_index(i);
            // Where the integral of the density d + 2(1 − d)x reaches this share.
            let rest = F::splat(2.0) - d;
            let root = (d * d * (F::one() - share) + rest * rest * share).sqrt();
            let x = F::select(share.gt(F::zero()), share * 2.0 / (d + root), F::zero());
            (start + (end - start) * x, weight)
        };
        let ((x, wx), (y, wy)) = (axis(u[0]), axis(u[1]));
        ([x, y], wx * wy)
    }

    /// The pixels that light at these raster positions goes to, each one of those whose filters reach it, by two numbers in [0, 1);
    /// and what it counts there. Pixel j gets it with probability |f(r − j)| / Σ|f|, where it counts ±Σ|f|: f(r − j) in the mean,
    /// which is what samples of pixel j bring.
    #[inline(never)]
    pub fn splat<F: Real>(&self, raster: [F; 2], u: [F; 2]) -> ([F; 2], F) {
        let radius = self.settings.radius();
        if self.uniform == Some(0.5) {
            // Pixels do not overlap.
            return (raster.map(F::floor), F::one());
        }
        let pixels = (2.0 * radius).ceil() as usize;
        let axis = |r: F, u: F| {
            let center = r - 0.5;
            // The lowest of the whole numbers from here to `end`.
            let first = -(F::splat(radius) - center).floor();
            let end = center + radius;
            let look_up = |j: usize| {
                let at = first + j as f32;
                F::select(at.lt(end), self.value(center - at), F::zero())
            };
            let mut kept = [F::zero(); KEPT];
            kept.iter_mut().take(pixels).enumerate().for_each(|(j, value)| *value = look_up(j));
            let value = |j: usize| if j < KEPT { kept[j] } else { look_up(j) };
            let all = (0..pixels).fold(F::zero(), |sum, j| sum + value(j).abs());
            let (mut rest, mut chosen, mut share) = (u * all, first, F::zero());
            let mut open = F::Mask::splat(true);
            for j in 0..pixels {
                let v = value(j);
                let takes = open.and_not(v.eq(F::zero()));
                chosen = F::select(takes, first + j as f32, chosen);
                share = F::select(takes, all.copy_sign(v), share);
                rest -= v.abs();
                open = open.and_not(takes & rest.lt(F::zero()));
            }
            (chosen, share)
        };
        let ((x, wx), (y, wy)) = (axis(raster[0], u[0]), axis(raster[1], u[1]));
        ([x, y], wx * wy)
    }

    /// The filter at distance x along one axis, its integral being 1.
    #[inline(always)]
    fn value<F: Real>(&self, x: F) -> F {
        if let Some(radius) = self.uniform {
            return F::select(x.abs().le(F::splat(radius)), F::splat(0.5 / radius), F::zero());
        }
        let at = (x.abs() * self.per_unit).min(F::splat(VALUES as f32));
        let i = at.to_index().min(F::Index::splat(VALUES as u32 - 1));
        let [a, slope, ..] = F::record(&self.values, i);
        slope.mul_add(at - F::from_index(i), a)
    }

    /// How far from a pixel's centre light may still count, in pixels.
    pub fn reach(&self) -> f32 {
        self.settings.radius()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIGNIFICANCE, chi2_p_value, random_pairs};

    /// Draws follow |f| (χ² over one axis) and weights make every bin's signed mass that of f.
    #[test]
    fn offsets_follow_the_filter() {
        let filters = [
            FilterSettings::Box { radius: 0.5 },
            FilterSettings::Tent { radius: 1.0 },
            FilterSettings::Gaussian { stddev: 0.5, radius: None },
            FilterSettings::Gaussian { stddev: 0.5, radius: Some(0.8) },
            FilterSettings::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
            FilterSettings::BlackmanHarris { radius: 1.5 },
        ];
        for settings in filters {
            let (filter, radius) = (Filter::new(settings), f64::from(settings.radius()));
            let (bins, n) = (50, 200_000);
            let bin_integral = |i: usize, f: &dyn Fn(f64) -> f64| {
                let fine = 400;
                let x =
                    |k: usize| -radius + 2.0 * radius * (i as f64 + (k as f64 + 0.5) / f64::from(fine)) / bins as f64;
                (0..fine as usize).map(|k| f(x(k))).sum::<f64>()
            };
            let absolute: Vec<f64> = (0..bins).map(|i| bin_integral(i, &|x| settings.eval(x).abs())).collect();
            let signed: Vec<f64> = (0..bins).map(|i| bin_integral(i, &|x| settings.eval(x))).collect();
            let (all, all_signed) = (absolute.iter().sum::<f64>(), signed.iter().sum::<f64>());
            let (mut count, mut weights, mut total) = (vec![0.0; bins], vec![0.0; bins], 0.0);
            for u in random_pairs(n) {
                let ([x, _], weight) = filter.sample(u);
                let i = (((f64::from(x) + radius) / (2.0 * radius) * bins as f64) as usize).min(bins - 1);
                count[i] += 1.0;
                // The other axis's weight has mean 1 and is independent.
                weights[i] += f64::from(weight);
                total += f64::from(weight);
            }
            let mut chi2 = 0.0;
            for i in 0..bins {
                let expected = absolute[i] / all * f64::from(n);
                chi2 += if expected > 5.0 { (count[i] - expected).powi(2) / expected } else { 0.0 };
                let share = weights[i] / f64::from(n);
                assert!((share - signed[i] / all_signed).abs() < 4e-3, "{settings:?}: bin {i} has {share}");
            }
            let p = chi2_p_value(chi2, bins as f64 - 1.0);
            assert!(p > SIGNIFICANCE, "{settings:?}: χ² {chi2}, p {p}");
            assert!((total / f64::from(n) - 1.0).abs() < 6e-3, "{settings:?}: mean weight {}", total / f64::from(n));
        }
    }

    /// Light at one place brings each pixel what the pixel's filter is there.
    #[test]
    fn splats_bring_the_filter() {
        for settings in [
            FilterSettings::Box { radius: 0.5 },
            FilterSettings::Box { radius: 0.8 },
            FilterSettings::Tent { radius: 1.0 },
            FilterSettings::Gaussian { stddev: 0.5, radius: None },
            FilterSettings::Gaussian { stddev: 0.5, radius: Some(0.8) },
            FilterSettings::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
            FilterSettings::BlackmanHarris { radius: 1.5 },
        ] {
            let filter = Filter::new(settings);
            let fine = 100_000;
            let radius = f64::from(settings.radius());
            let integral: f64 = (0..fine)
                .map(|i| settings.eval(radius * (2.0 * (f64::from(i) + 0.5) / f64::from(fine) - 1.0)))
                .sum::<f64>()
                * 2.0
                * radius
                / f64::from(fine);
            for raster in [[3.5_f32, 3.5], [3.01, 4.3], [2.77, 3.99]] {
                let n = 100_000;
                // Sums and sums of squares of what nine by nine pixels get.
                let mut sums = vec![[0.0; 2]; 81];
                for u in random_pairs(n) {
                    let ([x, y], weight) = filter.splat(raster, u);
                    let sum = &mut sums[(y * 9.0 + x) as usize];
                    *sum = [sum[0] + f64::from(weight), sum[1] + f64::from(weight).powi(2)];
                }
                for (i, [sum, squares]) in sums.into_iter().enumerate() {
                    let f = |r: f32, j: usize| settings.eval(f64::from(r) - j as f64 - 0.5) / integral;
                    let expected = f(raster[0], i % 9) * f(raster[1], i / 9);
                    let n = f64::from(n);
                    let error = ((squares / n - (sum / n).powi(2)).max(0.0) / n).sqrt();
                    // 4.5 standard errors: 1 in 100 000, for less than 1500 numbers; and what quadrature leaves.
                    let off = (sum / n - expected).abs();
                    assert!(
                        off <= 4.5 * error + 2e-5,
                        "{settings:?} at {raster:?}, pixel {i}: {} for {expected}",
                        sum / n
                    );
                }
            }
        }
    }
}
