//! Sample values: a pure function of (seed, pixel, sample index, dimension).
//!
//! Nothing here has state, so any one sample of any pixel can be replayed, by any thread, in any lane, in any order.
//!
//! The default is Owen-scrambled Sobol points, padded: every pair of dimensions takes the first two Sobol dimensions
//! under an index shuffle and a scramble of its own, both by hashing (Burley, "Practical hash-based Owen scrambling",
//! JCGT 2020), with the permutation of Laine and Karras as improved by Vegdahl (2021). Every run of 2ᵏ samples that
//! starts at a multiple of 2ᵏ is a (0, m, 2)-net in each pair. Only the place in the pixel and the pairs of the first two
//! bounces of a path are not shuffled at random, but take the points in orders that make them good together (`order.rs`).
//!
//! For many samples there is a rank-1 lattice sequence with random shifts (Cranley and Patterson 1976; Hickernell, Hong,
//! L'Ecuyer and Lemieux, "Extensible lattice sequences for quasi-Monte Carlo quadrature", SIAM J. Sci. Comput. 2000): sample i is
//! φ(i) z + shift, modulo 1, φ(i) being the bits of i behind the binary point in reverse order. What matters most to a
//! pixel, its place, the lens, and the light and the direction of the first two bounces of a path, are dimensions of one
//! lattice (`lattice.rs`); all further dimensions are padded, each pair by a lattice of its own. Fewer than 128 samples of so many
//! dimensions coincide in some pairs of them.

use super::lattice::Plane;
use super::order;
use rebond_lanes::{Index, Real};
use serde::{Deserialize, Serialize};

/// Which sample values to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SamplerSettings {
    /// Owen-scrambled Sobol points, padded in pairs.
    Sobol {},
    /// A rank-1 lattice sequence, randomly shifted; for 128 samples and more.
    Lattice {},
    /// Independent, uniform.
    Independent {},
    /// Jittered strata: each block of `samples` samples (rounded up to a power of two) has one sample in every stratum.
    Stratified {
        /// Samples per block; those of the whole render if not given.
        #[serde(default)]
        samples: u32,
    },
}

impl Default for SamplerSettings {
    fn default() -> Self {
        Self::Sobol {}
    }
}

/// A source of sample values.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    settings: SamplerSettings,
    seed: u32,
    /// log₂ of the number of strata.
    strata_bits: u32,
}

/// One sample of one pixel: what the values of all its dimensions hang on.
#[derive(Clone, Copy, Debug)]
pub struct Stream<F: Real> {
    pixel_hash: F::Index,
    index: F::Index,
    sampler: Sampler,
}

/// What a pair of values of a path is for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place<F: Real> {
    /// The place in the pixel.
    Pixel,
    /// That on the lens.
    Lens,
    /// Dimension n of a bounce; bounces are counted from 0. Of the dimensions 0 and 1 only one may be a pair's, and of 2 and 3: light's
    /// and the direction's.
    Bounce(F::Index, u32),
    /// Something else.
    Anywhere,
}

/// Pairs of a bounce that go together with the pixel's place.
pub(super) const PAIRS: u32 = 2;

/// A good mixer of 32 bits (Wellons' `lowbias32`).
#[inline(always)]
pub(crate) fn mix<I: Index>(x: I) -> I {
    let x = (x ^ (x >> 16)) * I::splat(0x7feb_352d);
    let x = (x ^ (x >> 15)) * I::splat(0x846c_a68b);
    x ^ (x >> 16)
}

/// Laine–Karras permutation, Vegdahl's constants: bit k of the result hangs on bits 0..=k of `x` only.
#[inline(always)]
fn laine_karras<I: Index>(x: I, seed: I) -> I {
    let x = x ^ (x * I::splat(0x3d20_adea));
    let x = x + seed;
    let x = x * ((seed >> 16) | I::splat(1));
    let x = x ^ (x * I::splat(0x0552_6c56));
    x ^ (x * I::splat(0x53a2_2864))
}

/// The second Sobol dimension with its bits reversed: bit j is the sum of the bits k ⊇ j (Pascal's matrix modulo 2, by
/// Lucas' theorem), one step per bit of the positions.
#[inline(always)]
pub(super) fn sobol_second_reversed<I: Index>(index: I) -> I {
    let mut x = index;
    for (shift, without) in [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff), (16, 0x0000_ffff)]
    {
        x = x ^ ((x >> shift) & I::splat(without));
    }
    x
}

/// A permutation of the integers below 2^bits.
#[inline(always)]
fn permute<I: Index>(x: I, bits: u32, seed: I) -> I {
    let mask = I::splat((1_u64 << bits).wrapping_sub(1) as u32);
    let half = bits.div_ceil(2).max(1);
    let mut x = (x ^ seed) & mask;
    for (factor, shift) in [(0x9e37_79b1, 3), (0x85eb_ca6b, 9), (0xc2b2_ae35, 17)] {
        x = (x * I::splat(factor) + (seed >> shift)) & mask;
        x = x ^ (x >> half);
    }
    x
}

/// 24 bits to [0, 1).
#[inline(always)]
fn unit<F: Real>(bits: F::Index) -> F {
    F::from_index(bits >> 8) * (1.0 / 16_777_216.0)
}

impl Sampler {
    /// The sampler of these settings; different seeds give independent values.
    pub fn new(settings: SamplerSettings, seed: u64) -> Self {
        use rebond_lanes::scalar::Index1;
        let seed = mix(Index1(seed as u32 ^ 0x5bd1_e995)) ^ mix(Index1((seed >> 32) as u32) + Index1(1));
        let strata_bits = match settings {
            SamplerSettings::Stratified { samples } => samples.clamp(1, 1 << 20).next_power_of_two().ilog2(),
            _ => 0,
        };
        Self { settings, seed: seed.0, strata_bits }
    }

    /// The same kind of sampler with values of its own for each `salt`.
    pub fn salted(&self, salt: u32) -> Self {
        use rebond_lanes::scalar::Index1;
        Self { seed: mix(Index1(self.seed) + mix(Index1(salt) + Index1(0x9e37_79b9))).0, ..*self }
    }

    /// The same sampler, but Sobol's points in place of a lattice's: where one sequence covers the picture, as walks of
    /// light do, rows of a lattice would be seen.
    #[inline(always)]
    pub(crate) fn without_rows(&self) -> Self {
        let settings = match self.settings {
            SamplerSettings::Lattice {} => SamplerSettings::Sobol {},
            other => other,
        };
        Self { settings, ..*self }
    }

    /// The values of one sample of one pixel.
    #[inline(always)]
    pub fn stream<F: Real>(&self, pixel: F::Index, index: F::Index) -> Stream<F> {
        Stream { pixel_hash: mix(mix(pixel) + F::Index::splat(self.seed)), index, sampler: *self }
    }
}

impl<F: Real> Stream<F> {
    #[inline(always)]
    fn hash(&self, dimension: F::Index) -> F::Index {
        mix(self.pixel_hash + dimension * F::Index::splat(0x9e37_79b9))
    }

    /// The value of one dimension, in [0, 1). It stands for itself: [`Stream::pair`] of the same dimension is not
    /// independent of it.
    #[inline(always)]
    pub fn value(&self, dimension: F::Index) -> F {
        let h = self.hash(dimension);
        match self.sampler.settings {
            SamplerSettings::Lattice {} => unit(laine_karras(self.index.reverse_bits(), h) + mix(h)),
            SamplerSettings::Sobol {} => {
                // The van der Corput sequence under an Owen scramble; the shuffle of the index gives each dimension an
                // order of its own.
                let shuffled = laine_karras(self.index.reverse_bits(), h).reverse_bits();
                unit(laine_karras(shuffled, mix(h)).reverse_bits())
            }
            SamplerSettings::Independent {} => unit(mix((self.index * F::Index::splat(0x2c1b_3c6d)) ^ h)),
            SamplerSettings::Stratified { .. } => {
                let (stratum, jitter) = self.stratum(h);
                (F::from_index(stratum) + unit::<F>(jitter)) * (1.0 / (1_u32 << self.sampler.strata_bits) as f32)
            }
        }
        .min(F::splat(ONE_MINUS_EPSILON))
    }

    /// The values of two dimensions, each in [0, 1), spread well over the square.
    #[inline(always)]
    pub fn pair(&self, dimension: F::Index) -> [F; 2] {
        self.pair_at(dimension, Place::Anywhere)
    }

    /// The same, at this place of a path.
    #[inline(always)]
    pub(crate) fn pair_at(&self, dimension: F::Index, place: Place<F>) -> [F; 2] {
        let h = self.hash(dimension);
        let below_one = F::splat(ONE_MINUS_EPSILON);
        match self.sampler.settings {
            SamplerSettings::Lattice {} => {
                let Plane { generator: [x, y], joint } = Plane::of(place);
                let order = F::Index::select(joint, mix(self.pixel_hash), h);
                // φ(i) of the shuffled index.
                let point = laine_karras(self.index.reverse_bits(), order);
                let h2 = mix(h);
                [unit(point * x + h2), unit(point * y + mix(h2))]
            }
            SamplerSettings::Sobol {} => {
                let shuffled = || laine_karras(self.index.reverse_bits(), h).reverse_bits();
                let point = match place {
                    Place::Pixel => self.index,
                    Place::Bounce(number, n) if n / 2 < PAIRS => order::of_bounce::<F>(self.index, number, shuffled),
                    _ => shuffled(),
                };
                let h2 = mix(h);
                let x = laine_karras(point, h2).reverse_bits();
                let y = laine_karras(sobol_second_reversed(point), mix(h2)).reverse_bits();
                [unit(x), unit(y)]
            }
            SamplerSettings::Independent {} => {
                let x = mix((self.index * F::Index::splat(0x2c1b_3c6d)) ^ h);
                [unit(x), unit(mix(x ^ F::Index::splat(0x68bc_21eb)))]
            }
            SamplerSettings::Stratified { .. } => {
                let (stratum, jitter) = self.stratum(h);
                let columns = self.sampler.strata_bits / 2;
                let rows = self.sampler.strata_bits - columns;
                let x = F::from_index(stratum & F::Index::splat((1 << columns) - 1)) + unit::<F>(jitter);
                let y = F::from_index(stratum >> columns) + unit::<F>(mix(jitter));
                let x = x * (1.0 / (1_u32 << columns) as f32);
                [x.min(below_one), (y * (1.0 / (1_u32 << rows) as f32)).min(below_one)]
            }
        }
    }

    /// This sample's stratum within its block, and random bits.
    #[inline(always)]
    fn stratum(&self, h: F::Index) -> (F::Index, F::Index) {
        let bits = self.sampler.strata_bits;
        let block = self.index >> bits;
        let within = self.index & F::Index::splat((1 << bits) - 1);
        let seed = mix(h ^ (block * F::Index::splat(0x27d4_eb2f)));
        (permute(within, bits, seed), mix(seed ^ mix(within)))
    }
}

/// The largest f32 below one.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::lattice::PLANES;
    use crate::testing::random_pairs;
    use rebond_lanes::{F32x16, scalar::Index1};

    const ALL: [SamplerSettings; 4] = [
        SamplerSettings::Sobol {},
        SamplerSettings::Independent {},
        SamplerSettings::Stratified { samples: 64 },
        SamplerSettings::Lattice {},
    ];

    fn stream(settings: SamplerSettings, pixel: u32, index: u32) -> Stream<f32> {
        Sampler::new(settings, 7).stream(Index1(pixel), Index1(index))
    }

    #[test]
    fn lanes_draw_the_numbers_of_single_paths() {
        for settings in ALL {
            let sampler = Sampler::new(settings, 3);
            let lane_number = (0..16).fold(Index::splat(0), |v: <F32x16 as Real>::Index, i| v.with_lane(i, i as u32));
            for (pixel, index, dimension) in [(0, 0, 0), (77, 1000, 3), (1 << 30, 12345, 40)] {
                let at = |base: u32| lane_number * Index::splat(17) + Index::splat(base);
                let wide = sampler.stream::<F32x16>(at(pixel), at(index));
                let (value, pair) = (wide.value(at(dimension)), wide.pair(at(dimension)));
                let bounces = lane_number & Index::splat(3);
                let early = wide.pair_at(at(dimension), Place::Bounce(bounces, 1));
                for lane in 0..16 {
                    let one = |base: u32| Index1(base + 17 * lane as u32);
                    let narrow = sampler.stream::<f32>(one(pixel), one(index));
                    assert_eq!(value.lane(lane), narrow.value(one(dimension)));
                    assert_eq!([pair[0].lane(lane), pair[1].lane(lane)], narrow.pair(one(dimension)));
                    let place = Place::Bounce(Index1(lane as u32 & 3), 1);
                    let early = [early[0].lane(lane), early[1].lane(lane)];
                    assert_eq!(early, narrow.pair_at(one(dimension), place));
                }
            }
        }
    }

    /// The second Sobol dimension from its direction numbers: primitive polynomial x + 1, m₁ = 1, so that
    /// v_{k+1} = v_k ⊕ v_k/2.
    #[test]
    fn second_dimension_is_sobols() {
        let mut v = [1_u32 << 31; 32];
        for k in 1..32 {
            v[k] = v[k - 1] ^ (v[k - 1] >> 1);
        }
        for index in (0..100_000_u32).chain([u32::MAX, 0x8765_4321]) {
            let sobol = (0..32).filter(|k| index >> k & 1 == 1).fold(0, |s, k| s ^ v[k]);
            assert_eq!(sobol_second_reversed(Index1(index)).0.reverse_bits(), sobol);
        }
    }

    /// Each aligned run of 64 samples has one point in every elementary interval of volume 1/64.
    #[test]
    fn sobol_pairs_are_nets() {
        let places =
            [Place::Anywhere, Place::Pixel, Place::Lens, Place::Bounce(Index1(0), 1), Place::Bounce(Index1(1), 3)];
        for ((pixel, start, dimension), place) in
            [(0, 0, 0), (5, 64, 1), (999, 640, 6), (8, 1984, 0), (7, 64, 3)].into_iter().zip(places)
        {
            let points: Vec<[f32; 2]> =
                (start..start + 64).map(|i| stream(ALL[0], pixel, i).pair_at(Index1(dimension), place)).collect();
            for columns in 0..=6 {
                let (nx, ny) = (1 << columns, 64 >> columns);
                let mut seen = [false; 64];
                for [x, y] in &points {
                    let cell = (x * nx as f32) as usize * ny + (y * ny as f32) as usize;
                    assert!(!std::mem::replace(&mut seen[cell], true), "{nx}×{ny} cells");
                }
            }
            let mut seen = [false; 64];
            for i in start..start + 64 {
                let cell = (stream(ALL[0], pixel, i).value(Index1(dimension)) * 64.0) as usize;
                assert!(!std::mem::replace(&mut seen[cell], true));
            }
        }
    }

    /// φ(i) z + shift for the numbers i of an aligned run in some order: of both kinds of planes, every run of 2ᵏ samples has
    /// the points of one lattice, and they are nowhere much nearer to each other than points of the best lattice are.
    #[test]
    fn lattices_are_lattices() {
        let bounce = |number: u32, n: u32| Place::Bounce(Index1(number), n);
        let places: [Place<f32>; 8] = [
            Place::Anywhere,
            Place::Pixel,
            Place::Lens,
            bounce(0, 1),
            bounce(0, 3),
            bounce(1, 1),
            bounce(1, 3),
            bounce(2, 1),
        ];
        let around = |x: f64| x - x.round();
        for (which, place) in places.into_iter().enumerate() {
            for (pixel, start, k) in [(0, 0, 4), (5, 64, 6), (999, 1280, 8), (7, 4096, 10)] {
                let n = 1_u32 << k;
                let points: Vec<[f64; 2]> = (start..start + n)
                    .map(|i| stream(ALL[3], pixel, i).pair_at(Index1(6), place).map(f64::from))
                    .collect();
                for axis in 0..2 {
                    let mut seen = vec![false; n as usize];
                    for p in &points {
                        assert!(!std::mem::replace(&mut seen[(p[axis] * f64::from(n)) as usize], true), "{which}");
                    }
                }
                let mut least = f64::INFINITY;
                for (i, p) in points.iter().enumerate() {
                    for q in &points[..i] {
                        let [x, y] = [0, 1].map(|axis| around(p[axis] - q[axis]));
                        least = least.min(x * x + y * y);
                        // Sums of points are points: differences are whole steps of 1/n.
                        let steps = x * f64::from(n);
                        assert!((steps - steps.round()).abs() < 1e-3, "{which}");
                    }
                }
                // The densest packing of n points in the unit square.
                let best = 2.0 / 3.0_f64.sqrt() / f64::from(n);
                assert!((least / best).sqrt() > 0.4, "{which}, {n} points: {}", (least / best).sqrt());
            }
        }
    }

    /// The pixel's place and the light's point of the first bounce are dimensions of one lattice, those of the third are not:
    /// in the first case one tells the other.
    #[test]
    fn early_pairs_share_a_lattice() {
        let n = 64;
        let steps = |bounce: u32| -> Vec<u32> {
            let mut differences: Vec<u32> = (0..n)
                .map(|i| {
                    let s = stream(ALL[3], 11, i);
                    let [x, _] = s.pair_at(Index1(0), Place::Pixel);
                    let [u, _] = s.pair_at(Index1(4), Place::Bounce(Index1(bounce), 1));
                    let (z, n) = (f64::from(PLANES[2][0]), f64::from(n));
                    // u − z x is the same for all points of one lattice, modulo 1.
                    (((f64::from(u) - z * f64::from(x)).rem_euclid(1.0) * 4.0 * n).round() % (4.0 * n)) as u32
                })
                .collect();
            differences.sort_unstable();
            differences.dedup();
            differences
        };
        assert_eq!(steps(0).len(), 1, "{:?}", steps(0));
        assert!(steps(2).len() > 8, "{:?}", steps(2));
    }

    /// Edges across the pixel's place and the light's point or a direction: orders that are chosen have less variance than
    /// such as are drawn.
    #[test]
    fn early_pairs_go_together() {
        let edges: Vec<[f64; 5]> = random_pairs(5 * 40)
            .collect::<Vec<_>>()
            .chunks(5)
            .map(|u| {
                let a: Vec<f64> = u[..4].iter().map(|u| f64::from(u[0]) - 0.5).collect();
                let at: f64 = a.iter().zip(u).map(|(a, u)| a * f64::from(u[1])).sum();
                [a[0], a[1], a[2], a[3], at]
            })
            .collect();
        let variance = |settings: SamplerSettings, places: [Place<f32>; 2]| -> f64 {
            let n = 64;
            let mut sums = vec![(0.0, 0.0); edges.len()];
            for pixel in 0..200 {
                let mut below = vec![0; edges.len()];
                for i in 0..n {
                    let s = stream(settings, pixel, i);
                    let [[x, y], [u, v]] = [0, 1].map(|k| s.pair_at(Index1(9 * k as u32), places[k]).map(f64::from));
                    for ([a, b, c, d, at], below) in edges.iter().zip(&mut below) {
                        *below += u32::from(a * x + b * y + c * u + d * v < *at);
                    }
                }
                for ((sum, squares), below) in sums.iter_mut().zip(below) {
                    let mean = f64::from(below) / f64::from(n);
                    *sum += mean / 200.0;
                    *squares += mean * mean / 200.0;
                }
            }
            sums.iter().map(|(sum, squares)| squares - sum * sum).sum::<f64>() / edges.len() as f64
        };
        let padded = variance(ALL[0], [Place::Anywhere; 2]);
        let mut cases = vec![(ALL[3], 0, 1), (ALL[3], 0, 3)];
        cases.extend([(0, 1), (0, 3), (1, 1), (1, 3)].map(|(bounce, n)| (ALL[0], bounce, n)));
        for (settings, bounce, n) in cases {
            let ratio = variance(settings, [Place::Pixel, Place::Bounce(Index1(bounce), n)]) / padded;
            assert!(ratio < 0.8, "{settings:?}, bounce {bounce}, dimension {n}: {ratio}");
        }
    }

    #[test]
    fn strata_are_each_hit_once() {
        for (pixel, block, dimension) in [(0, 0, 0), (8, 3, 5)] {
            let (mut line, mut square) = ([0; 64], [0; 64]);
            for i in block * 64..(block + 1) * 64 {
                let s = stream(ALL[2], pixel, i);
                line[(s.value(Index1(dimension)) * 64.0) as usize] += 1;
                let [x, y] = s.pair(Index1(dimension));
                square[(x * 8.0) as usize * 8 + (y * 8.0) as usize] += 1;
            }
            assert_eq!((line, square), ([1; 64], [1; 64]));
        }
    }

    /// The place in the pixel, and the light's point of the first bounce.
    fn place_and_light(settings: SamplerSettings, pixel: u32) -> [f32; 4] {
        let s = stream(settings, pixel, 7);
        let [x, y] = s.pair_at(Index1(0), Place::Pixel);
        let [u, v] = s.pair_at(Index1(4), Place::Bounce(Index1(0), 1));
        [x, y, u, v]
    }

    #[test]
    fn only_a_lattice_has_rows() {
        for settings in ALL {
            let without = Sampler::new(settings, 7).without_rows().settings;
            let expected = if settings == ALL[3] { SamplerSettings::Sobol {} } else { settings };
            assert_eq!(without, expected);
        }
    }

    /// χ² of the joint distribution of any two values that one path or neighbouring paths use.
    #[test]
    fn dimensions_pixels_and_samples_are_uncorrelated() {
        for settings in ALL {
            // (first, second) value of draw i: across dimensions, across pixels, across seeds of a pair.
            type Draw = fn(SamplerSettings, u32) -> (f32, f32);
            let draws: [Draw; 7] = [
                |s, i| (stream(s, i, 0).value(Index1(0)), stream(s, i, 0).value(Index1(1))),
                |s, i| (stream(s, i, 3).pair(Index1(2))[1], stream(s, i + 1, 3).pair(Index1(2))[1]),
                |s, i| (stream(s, i, 5).pair(Index1(4))[0], stream(s, i, 5).pair(Index1(5))[0]),
                |s, i| (stream(s, i, 9).pair(Index1(4))[0], stream(s, i, 10).value(Index1(6))),
                |s, i| stream(s, i, 7).pair_at(Index1(0), Place::Pixel).into(),
                |s, i| (place_and_light(s, i)[0], place_and_light(s, i)[2]),
                |s, i| (place_and_light(s, i)[1], place_and_light(s, i)[3]),
            ];
            for (which, draw) in draws.iter().enumerate() {
                let n = 65_536;
                let mut cells = [0_u32; 256];
                for i in 0..n {
                    let (a, b) = draw(settings, i);
                    cells[(a * 16.0) as usize * 16 + (b * 16.0) as usize] += 1;
                }
                let expected = f64::from(n) / 256.0;
                let chi2: f64 = cells.iter().map(|c| (f64::from(*c) - expected).powi(2) / expected).sum();
                let p = crate::testing::chi2_p_value(chi2, 255.0);
                assert!(p > 1e-4, "{settings:?}, draw {which}: χ² {chi2}, p {p}");
            }
        }
    }

    #[test]
    fn sobol_converges_faster_than_one_over_root_n() {
        // ∫₀¹ √(1−x²) dx = π/4 with 4096 samples: error far below the 3.5e-3 of independent samples.
        let (mut sum, n) = (0.0, 4096);
        for i in 0..n {
            sum += (1.0 - f64::from(stream(ALL[0], 1, i).value(Index1(0))).powi(2)).sqrt();
        }
        assert!((sum / f64::from(n) - std::f64::consts::FRAC_PI_4).abs() < 5e-5);
    }
}
