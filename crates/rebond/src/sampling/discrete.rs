//! A choice among n with given weights, in constant time (Walker's alias method, built as by Vose 1991).

use rebond_lanes::{Index, Real, Record};

/// A discrete distribution.
#[derive(Clone, Debug)]
pub struct Discrete {
    /// [probability of staying, alias (word), probability of this one, probability of the alias].
    table: Vec<Record>,
}

impl Discrete {
    /// A distribution proportional to the weights, which are finite and not negative; `None` if they are all 0.
    pub fn new(weights: &[f32]) -> Option<Self> {
        let total: f64 = weights.iter().map(|w| f64::from(*w)).sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let n = weights.len();
        let probability: Vec<f64> = weights.iter().map(|w| f64::from(*w) / total).collect();
        let mut stay: Vec<f64> = probability.iter().map(|p| p * n as f64).collect();
        let mut alias: Vec<usize> = (0..n).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|i| stay[*i] < 1.0);
        while let (Some(s), Some(l)) = (small.pop(), large.last().copied()) {
            alias[s] = l;
            stay[l] -= 1.0 - stay[s];
            if stay[l] < 1.0 {
                small.push(l);
                large.pop();
            }
        }
        // What rounding left over stays where it is, but for a choice of no weight, which goes to a likely one.
        let likely = (0..n).fold(0, |best, i| if probability[i] > probability[best] { i } else { best });
        let table = (0..n).map(|i| {
            let (stay, alias) = match (alias[i] == i, probability[i] > 0.0) {
                (true, true) => (1.0, i),
                (true, false) => (0.0, likely),
                _ => (stay[i] as f32, alias[i]),
            };
            Record([stay, f32::from_bits(alias as u32), probability[i] as f32, probability[alias] as f32])
        });
        Some(Self { table: table.collect() })
    }

    /// How many there are to choose from.
    pub fn len(&self) -> usize {
        self.table.len()
    }

    /// Never: a distribution has at least one choice.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    /// A choice and its probability, for u in [0, 1).
    #[inline(always)]
    pub fn sample<F: Real>(&self, u: F) -> (F::Index, F) {
        if self.table.len() == 1 {
            return (F::Index::splat(0), F::one());
        }
        let scaled = u * self.table.len() as f32;
        let cell = scaled.to_index().min(F::Index::splat(self.table.len() as u32 - 1));
        let [stay, alias, own, other] = F::record(&self.table, cell);
        let stays = (scaled - F::from_index(cell)).lt(stay);
        (F::Index::select(stays, cell, alias.to_bits()), F::select(stays, own, other))
    }

    /// The probability of a choice.
    #[inline(always)]
    pub fn probability<F: Real>(&self, choice: F::Index) -> F {
        if self.table.len() == 1 { F::one() } else { F::record(&self.table, choice)[2] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rebond_lanes::scalar::Index1;

    proptest! {
        /// Sweeping u over a fine grid gives each choice its share.
        #[test]
        fn shares_are_the_weights(weights in prop::collection::vec(prop_oneof![Just(0.0f32), 0.0f32..10.0], 1..40)) {
            let total: f32 = weights.iter().sum();
            let Some(d) = Discrete::new(&weights) else { prop_assert_eq!(total, 0.0); return Ok(()) };
            let n = 40_000;
            let mut count = vec![0; weights.len()];
            for i in 0..n {
                let (choice, p) = d.sample((i as f32 + 0.5) / n as f32);
                prop_assert_eq!(p, d.probability::<f32>(choice));
                prop_assert!(p > 0.0);
                count[choice.0 as usize] += 1;
            }
            for (c, w) in count.iter().zip(&weights) {
                prop_assert!((*c as f32 / n as f32 - w / total).abs() < 2.0 * weights.len() as f32 / n as f32 + 1e-5);
            }
            prop_assert_eq!(d.probability::<f32>(Index1(0)), (f64::from(weights[0]) / weights.iter().map(|w| f64::from(*w)).sum::<f64>()) as f32);
        }
    }
}
