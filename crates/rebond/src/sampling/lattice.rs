//! The generators of the lattices that sample values are points of.

use super::sampler::{PAIRS, Place};
use rebond_lanes::{Index, Mask, Real};

/// Those of the pairs of dimensions that one lattice holds: of the place in the pixel, of the lens, and of the two pairs
/// of the first and of the second bounce.
///
/// Found component by component, in the order pixel, bounces, lens (Cools, Kuo and Nuyens, "Constructing embedded lattice
/// rules for multivariate integration", SIAM J. Sci. Comput. 2006). Each is the odd number below 2¹² for which the sum of
/// ln e² over the first 2² to 2¹² points is least, from 2⁴ to 2⁸ counted twice; e² is the mean of Π (1 + 0.1 ω(x)) less 1 over
/// the points, ω(x) = 2π² (x² − x + 1/6), times that of ω(x) ω(y) for the second of a pair. Then bits are added one by
/// one, by e² over the first 2¹³ to 2²⁰ points.
pub(super) const PLANES: [[u32; 2]; 6] =
    [[1, 201_433], [311_997, 468_859], [99_557, 38_371], [651_475, 194_327], [509_263, 921_703], [786_837, 1_028_429]];
/// Bounces whose pairs are among them.
const JOINT_BOUNCES: u32 = 2;
/// That of a pair that stands alone.
const PADDED: [u32; 2] = [1, 2_583_525];

/// Which two dimensions of which lattice a pair of values is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane<F: Real> {
    pub generator: [F::Index; 2],
    /// The lanes of the lattice that a pixel has for all of [`PLANES`].
    pub joint: F::Mask,
}

impl<F: Real> Plane<F> {
    /// That of a place.
    #[inline(always)]
    pub fn of(place: Place<F>) -> Self {
        let joint = |row: usize| Self { generator: PLANES[row].map(F::Index::splat), joint: F::Mask::splat(true) };
        let mut plane = Self { generator: PADDED.map(F::Index::splat), joint: F::Mask::splat(false) };
        match place {
            Place::Pixel => joint(0),
            Place::Lens => joint(1),
            Place::Bounce(number, n) if n / 2 < PAIRS => {
                for early in 0..JOINT_BOUNCES {
                    let (here, row) = (number.eq(F::Index::splat(early)), PLANES[(2 + early * PAIRS + n / 2) as usize]);
                    let select = |i: usize| F::Index::select(here, F::Index::splat(row[i]), plane.generator[i]);
                    plane = Self { generator: [select(0), select(1)], joint: plane.joint | here };
                }
                plane
            }
            _ => plane,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// ω at the multiples of 1/n.
    fn omega(n: u32) -> Vec<f64> {
        let at = |i: u32| f64::from(i) / f64::from(n);
        (0..n).map(|i| 2.0 * PI * PI * (at(i) * at(i) - at(i) + 1.0 / 6.0)).collect()
    }

    /// The components in the order in which they were found.
    fn components() -> Vec<u32> {
        [0, 2, 3, 4, 5, 1].iter().flat_map(|&plane| PLANES[plane]).collect()
    }

    /// Σ of ω's along one component, what the components before it gave, and the one before it.
    struct Points {
        n: u32,
        omega: Vec<f64>,
        product: Vec<f64>,
        before: u32,
    }

    impl Points {
        fn new(n: u32) -> Self {
            let omega = omega(n);
            let product = omega.iter().map(|w| 1.0 + 0.1 * w).collect();
            Self { n, omega, product, before: 1 }
        }

        fn at(&self, z: u32) -> impl Iterator<Item = f64> + '_ {
            (0..self.n).map(move |i| self.omega[(i.wrapping_mul(z) & (self.n - 1)) as usize])
        }

        /// ln e² if the next component is z.
        fn measure(&self, z: u32, second: bool) -> f64 {
            let n = f64::from(self.n);
            let all = self.at(z).zip(&self.product).map(|(w, p)| (1.0 + 0.1 * w) * p).sum::<f64>() / n - 1.0;
            let pair = || self.at(z).zip(self.at(self.before)).map(|(a, b)| a * b).sum::<f64>() / n;
            all.ln() + if second { pair().ln() } else { 0.0 }
        }

        fn take(&mut self, z: u32) {
            let factors: Vec<f64> = self.at(z).map(|w| 1.0 + 0.1 * w).collect();
            self.product.iter_mut().zip(factors).for_each(|(p, f)| *p *= f);
            self.before = z;
        }
    }

    /// No component could be replaced by a better one.
    #[test]
    fn components_are_the_best() {
        let mut points: Vec<(u32, Points)> = (2..=12).map(|k| (k, Points::new(1 << k))).collect();
        for (d, z) in components().into_iter().enumerate().skip(1) {
            let measure = |z: u32| -> f64 {
                let weight = |k: u32| if (4..=8).contains(&k) { 2.0 } else { 1.0 };
                points.iter().map(|(k, p)| weight(*k) * p.measure(z, d % 2 == 1)).sum()
            };
            let mine = measure(z & 4095);
            let best = (1..4096).step_by(2).map(measure).fold(f64::INFINITY, f64::min);
            assert!(mine <= best + 1e-6, "component {d}: {mine}, {best}");
            points.iter_mut().for_each(|(_, p)| p.take(z & 4095));
        }
    }

    /// Nor could any of its bits.
    #[test]
    fn bits_are_the_best() {
        for k in 13..=20 {
            let (mut points, below) = (Points::new(1 << k), (1 << k) - 1);
            for (d, z) in components().into_iter().enumerate().skip(1) {
                let measure = |z: u32| points.measure(z & below, d % 2 == 1);
                let (mine, other) = (measure(z), measure(z ^ 1 << (k - 1)));
                assert!(mine <= other + 1e-6, "bit {} of component {d}: {mine}, {other}", k - 1);
                points.take(z & below);
            }
        }
    }

    /// From 128 points on no two components are the same or opposite: such dimensions would have the same values but for a
    /// constant. Fewer points have too few odd numbers for twelve components.
    #[test]
    fn components_differ() {
        for k in 7..=20 {
            let (n, all) = (1_u32 << k, components());
            for (i, a) in all.iter().enumerate() {
                for b in &all[..i] {
                    assert!((a + b) % n != 0 && a.abs_diff(*b) % n != 0, "{a}, {b}, {n} points");
                }
            }
        }
    }

    /// The points of each plane are nowhere much nearer to each other than those of the densest packing, a triangular one.
    #[test]
    fn points_keep_their_distance() {
        for [a, b] in PLANES.into_iter().chain([PADDED]) {
            for k in 2..=20 {
                let n = 1_i64 << k;
                // All differences are sums of (a, b), (n, 0) and (0, n); Gauss' reduction of the first two after a → 1.
                let inverse = (1..n).step_by(2).find(|i| i * i64::from(a) % n == 1).expect("odd numbers have one");
                let (mut u, mut v) = ([1, inverse * i64::from(b) % n], [0, n]);
                let dot = |u: [i64; 2], v: [i64; 2]| u[0] * v[0] + u[1] * v[1];
                loop {
                    if dot(u, u) > dot(v, v) {
                        std::mem::swap(&mut u, &mut v);
                    }
                    let m = (dot(u, v) as f64 / dot(u, u) as f64).round() as i64;
                    v = [v[0] - m * u[0], v[1] - m * u[1]];
                    if dot(v, v) >= dot(u, u) {
                        break;
                    }
                }
                let shortest = dot(u, u) as f64 / (n * n) as f64;
                let packed = 2.0 / 3.0_f64.sqrt() / n as f64;
                assert!((shortest / packed).sqrt() > 0.39, "({a}, {b}), 2^{k}: {}", (shortest / packed).sqrt());
            }
        }
    }
}
