//! In which order the pairs of a path's first bounces take Sobol's points.
//!
//! Padding shuffles the order of the points for each pair at random, which leaves how two pairs go together to chance.
//! Here the orders are chosen: sample i takes point M i, the bits of i times a matrix modulo 2. M has ones on its diagonal and
//! nothing below it, so each aligned run of 2ᵏ samples takes an aligned run of 2ᵏ points: every pair is as good by itself as
//! the Sobol points are. What is above the diagonal makes the pairs good together.

use rebond_lanes::{Index, Mask, Real};

/// Bits of an order. Those above stay as they are, so that more samples repeat the order.
const BITS: usize = 10;

/// The columns of M for the first and the second bounce.
///
/// Found column by column: with each, the first 2ᵏ samples of the pixel's pair (in Sobol's own order), the first bounce's and
/// the second's have the least mean of Π (1 + ω(x)), the squared error of a random function under an Owen scramble: ω(x) = 1 − 3/2ᵃ
/// for x in [2⁻ᵃ, 2¹⁻ᵃ), which is Σ 2^(1−2l) walₖ(x) over the levels l and the Walsh functions 2^(l−1) ≤ k < 2ˡ of each.
const ORDERS: [[u32; BITS]; 2] = [[1, 2, 5, 11, 16, 33, 67, 254, 365, 565], [1, 2, 4, 15, 16, 41, 76, 226, 272, 843]];

/// The points that the samples of these indices take at a bounce: at the first and the second, counted from 0, those of the order;
/// later the `other` ones.
#[inline(always)]
pub(super) fn of_bounce<F: Real>(index: F::Index, bounce: F::Index, other: impl FnOnce() -> F::Index) -> F::Index {
    let (first, second) = (bounce.eq(F::Index::splat(0)), bounce.eq(F::Index::splat(1)));
    let early = first | second;
    // Most groups of lanes are all early or all late.
    if early.none() {
        return other();
    }
    let one = F::Index::splat(1);
    let mut point = (index >> BITS as u32) << BITS as u32;
    for k in 0..BITS {
        let [a, b] = ORDERS.map(|columns| F::Index::splat(columns[k]));
        let bit = (index >> k as u32) & one;
        point = point ^ (bit * F::Index::select(first, a, b));
    }
    if early.all() { point } else { F::Index::select(early, point, other()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::sampler::sobol_second_reversed;
    use rebond_lanes::scalar::Index1;

    fn times(columns: &[u32], index: u32) -> u32 {
        let low = columns.iter().enumerate().filter(|(k, _)| index >> k & 1 == 1).fold(0, |x, (_, c)| x ^ c);
        index >> BITS << BITS | low
    }

    /// 1 + ω of the two coordinates of a point.
    fn factors(point: u32) -> f64 {
        let omega = |x: u32| if x == 0 { 1.0 } else { 1.0 - 3.0 * 0.5_f64.powi(x.leading_zeros() as i32 + 1) };
        (1.0 + omega(point.reverse_bits())) * (1.0 + omega(sobol_second_reversed(Index1(point)).0.reverse_bits()))
    }

    #[test]
    fn orders_are_products() {
        for index in [0, 1, 2, 3, 700, 1023, 1024, 123_456, u32::MAX] {
            for (bounce, columns) in ORDERS.iter().enumerate() {
                let point = of_bounce::<f32>(Index1(index), Index1(bounce as u32), || unreachable!());
                assert_eq!(point.0, times(columns, index));
            }
            assert_eq!(of_bounce::<f32>(Index1(index), Index1(2), || Index1(7)).0, 7);
        }
    }

    /// No column could be replaced by a better one, and aligned runs stay aligned runs.
    #[test]
    fn columns_are_the_best() {
        let mut before: Vec<f64> = (0..1 << BITS).map(factors).collect();
        for columns in ORDERS {
            for k in 0..BITS {
                let n = 1 << (k + 1);
                let error = |column: u32| -> f64 {
                    let all: Vec<u32> = columns[..k].iter().copied().chain([column]).collect();
                    (0..n).map(|i| before[i] * factors(times(&all, i as u32))).sum::<f64>() / n as f64
                };
                assert_eq!(columns[k] >> k, 1);
                let best = (1 << k..2 << k).map(error).fold(f64::INFINITY, f64::min);
                assert!(error(columns[k]) <= best * (1.0 + 1e-9), "column {k}: {}, {best}", error(columns[k]));
            }
            before.iter_mut().enumerate().for_each(|(i, b)| *b *= factors(times(&columns, i as u32)));
        }
    }
}
