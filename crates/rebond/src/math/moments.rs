//! Mean and variance of what was drawn.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// How many values were drawn, their mean and their spread: all that Monte Carlo says about its own error.
///
/// Kept by Welford's recurrence (1962), joined by that of Chan, Golub and LeVeque (1979), neither of which subtracts
/// large numbers from each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: u64,
    mean: f64,
    /// Sum of the squared distances from the mean.
    spread: f64,
}

impl Moments {
    /// Of `count` values of this mean and variance (that of one value, unbiased).
    pub fn new(count: u64, mean: f64, variance: f64) -> Self {
        Self { count, mean, spread: if count < 2 { 0.0 } else { variance * (count - 1) as f64 } }
    }

    /// Adds a value.
    pub fn add(&mut self, x: f64) {
        self.count += 1;
        let off = x - self.mean;
        self.mean += off / self.count as f64;
        self.spread += off * (x - self.mean);
    }

    /// Adds what another one has received.
    pub fn merge(&mut self, other: &Self) {
        let (n, m) = (self.count as f64, other.count as f64);
        let off = other.mean - self.mean;
        self.count += other.count;
        if other.count > 0 {
            self.mean += off * m / (n + m);
            self.spread += other.spread + off * off * n * m / (n + m);
        }
    }

    /// Values received.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Their mean.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The variance of one value (unbiased); 0 with fewer than two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.spread / (self.count - 1) as f64 }
    }

    /// The variance of the mean, if the values were independent.
    pub fn variance_of_mean(&self) -> f64 {
        self.variance() / self.count.max(1) as f64
    }

    /// Its root: the standard error.
    pub fn standard_error(&self) -> f64 {
        self.variance_of_mean().sqrt()
    }

    /// An interval that holds the expectation with probability `level`, for independent values that are not too far
    /// from normal (Student 1908). Everything, with fewer than two values.
    pub fn confidence_interval(&self, level: f64) -> [f64; 2] {
        if self.count < 2 {
            return [f64::NEG_INFINITY, f64::INFINITY];
        }
        let reach = self.student().inverse_cdf(0.5 + 0.5 * level) * self.standard_error();
        [self.mean - reach, self.mean + reach]
    }

    /// The two-sided chance of a mean this far from `expected`. Where the values do not vary, 1 or 0.
    pub fn p_value(&self, expected: f64) -> f64 {
        let off = (self.mean - expected).abs();
        if off == 0.0 {
            return 1.0;
        }
        if self.count < 2 || self.spread == 0.0 {
            return 0.0;
        }
        2.0 * self.student().sf(off / self.standard_error())
    }

    fn student(&self) -> StudentsT {
        StudentsT::new(0.0, 1.0, (self.count - 1) as f64).expect("two values or more")
    }
}

impl Extend<f64> for Moments {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|x| self.add(x));
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut moments = Self::default();
        moments.extend(values);
        moments
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn as_by_definition_in_any_parts(values in prop::collection::vec(-1e3f64..1e3, 2..50), cut in 0usize..50) {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let (a, b) = values.split_at(cut.min(values.len()));
            let mut joined: Moments = a.iter().copied().collect();
            joined.merge(&b.iter().copied().collect());
            for m in [values.iter().copied().collect(), joined, Moments::new(values.len() as u64, mean, variance)] {
                prop_assert_eq!(m.count(), values.len() as u64);
                prop_assert!((m.mean() - mean).abs() < 1e-9 && (m.variance() - variance).abs() < 1e-6);
            }
        }
    }

    /// Student's table: 4 degrees of freedom, 95 %: 2.776; t = 2.776 has p = 0.05.
    #[test]
    fn intervals_are_those_of_the_table() {
        let m: Moments = [1.0, 2.0, 3.0, 4.0, 5.0].into_iter().collect();
        let reach = 2.776_445 * (2.5_f64 / 5.0).sqrt();
        let [low, high] = m.confidence_interval(0.95);
        assert!((low - (3.0 - reach)).abs() < 1e-5 && (high - (3.0 + reach)).abs() < 1e-5, "{low} {high}");
        assert!((m.p_value(3.0 + reach) - 0.05).abs() < 1e-6);
        let same: Moments = [2.0; 3].into_iter().collect();
        assert_eq!((same.p_value(2.0), same.p_value(2.1), same.confidence_interval(0.9)), (1.0, 0.0, [2.0, 2.0]));
    }
}
