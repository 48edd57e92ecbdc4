//! Light that paths bring to pixels which did not ask for it.
//!
//! ```text
//! I_j ≈ 1/N Σ_k X_kj        all N paths of the film, whichever pixel began them; X_kj is what path k brings to pixel j
//! ```
//!
//! Pixels' own samples are divided by how many each pixel got, splats by how many paths there were: the two are kept apart
//! and added when the film is developed. Sums are exact here too, so that no order shows.
//!
//! The variance is known by the squares of X_kj, in which everything that one path brings to one pixel is added up first. It
//! holds for each pixel by itself. Pixels that one path reaches are tied together, which no number per pixel can say: means over
//! many pixels vary more or less than the sum of these variances says; so do those whose samples look at the same particles of light
//! (`photon`, `vcm`). Where that matters, take the spread of several films.

use super::accumulator::{LARGEST_SAMPLE, Pixel, SQUARE_BITS, SQUARES_REACH, VALUE_BITS, WEIGHT_BITS};
use rebond_lanes::prefetch;

/// How many splats ahead their pixels are asked for.
const AHEAD: usize = 16;

/// What one path brings to one pixel.
#[derive(Clone, Copy, Debug)]
struct Splat {
    /// 0 is the picture, n its layer n − 1.
    sheet: u32,
    pixel: u32,
    light: [f32; 3],
}

/// What a run of paths of one weight brings.
#[derive(Clone, Debug, Default)]
pub struct Splats {
    list: Vec<Splat>,
    /// Those of each of the paths under way.
    under_way: Vec<Vec<Splat>>,
    paths: u64,
}

impl Splats {
    /// Light for a pixel, of one of the paths under way. `sheet` is 0 for the picture, n for its layer n − 1.
    pub fn add(&mut self, path: usize, sheet: usize, pixel: usize, light: [f32; 3]) {
        if self.under_way.len() <= path {
            self.under_way.resize_with(path + 1, Vec::new);
        }
        let (sheet, pixel, splats) = (sheet as u32, pixel as u32, &mut self.under_way[path]);
        match splats.iter_mut().find(|s| (s.sheet, s.pixel) == (sheet, pixel)) {
            Some(splat) => splat.light.iter_mut().zip(light).for_each(|(sum, x)| *sum += x),
            None => splats.push(Splat { sheet, pixel, light }),
        }
    }

    /// No paths, as at first.
    pub fn clear(&mut self) {
        self.list.clear();
        self.paths = 0;
    }

    /// The paths under way, so many, have ended; the next ones begin.
    pub fn end_paths(&mut self, paths: usize) {
        self.under_way.iter_mut().for_each(|splats| self.list.append(splats));
        self.paths += paths as u64;
    }
}

/// The fixed-point number next to x towards 0, if it has fewer than 127 bits.
#[inline(always)]
fn fixed(x: f64, fraction_bits: i32) -> i128 {
    let bits = x.to_bits();
    let (mantissa, exponent) = ((bits & ((1 << 52) - 1)) | 1 << 52, (bits >> 52 & 0x7ff) as i32);
    let shift = exponent - 1075 + fraction_bits;
    let magnitude = if shift >= 0 { i128::from(mantissa) << shift } else { i128::from(mantissa >> (-shift).min(63)) };
    if x < 0.0 { -magnitude } else { magnitude }
}

/// What one pixel received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Received {
    sum: [i128; 3],
    squares: [i128; 3],
}

impl Received {
    fn of(light: [f32; 3]) -> Self {
        let (sum, squares) = (light.map(f64::from), light.map(|x| f64::from(x) * f64::from(x)));
        let square = |x: f64| if x < f64::powi(2.0, 60) { fixed(x, SQUARE_BITS) } else { SQUARES_REACH };
        Self { sum: sum.map(|x| fixed(x, VALUE_BITS)), squares: squares.map(square) }
    }

    #[inline(always)]
    fn merge(&mut self, other: &Self) {
        for c in 0..3 {
            self.sum[c] += other.sum[c];
            self.squares[c] = (self.squares[c] + other.squares[c]).min(SQUARES_REACH);
        }
    }
}

/// All splats of a film: of the picture and of its layers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gathered {
    /// Pixels of each sheet; empty while it has received nothing.
    sheets: Vec<Vec<Received>>,
    /// Paths, their weights and the squares of those, in the units of a [`Pixel`].
    paths: u64,
    weights: u64,
    squared_weights: u64,
    dropped: u64,
}

impl Gathered {
    /// Adds what paths of this weight, a power of two between 2⁻⁸ and 2⁸, bring to a film of so many pixels.
    pub fn add(&mut self, splats: &Splats, weight: f32, pixels: usize) {
        let unit = (weight * f32::powi(2.0, WEIGHT_BITS)) as u64;
        self.paths += splats.paths;
        self.weights += splats.paths * unit;
        self.squared_weights += splats.paths * unit * unit;
        for (number, splat) in splats.list.iter().enumerate() {
            // Pixels are far apart: those of splats to come are on their way meanwhile.
            if let Some(soon) = splats.list.get(number + AHEAD) {
                let pixel = &self.sheet(soon.sheet as usize, pixels)[soon.pixel as usize];
                prefetch(&pixel.sum);
                prefetch(&pixel.squares[2]);
            }
            let light = splat.light.map(|x| x * weight);
            if light.iter().all(|x| x.abs() < LARGEST_SAMPLE) {
                self.sheet(splat.sheet as usize, pixels)[splat.pixel as usize].merge(&Received::of(light));
            } else {
                // It is a layer's as well; it is one all the same.
                self.dropped += u64::from(splat.sheet == 0);
            }
        }
    }

    fn sheet(&mut self, sheet: usize, pixels: usize) -> &mut [Received] {
        if self.sheets.len() <= sheet {
            self.sheets.resize_with(sheet + 1, Vec::new);
        }
        let received = &mut self.sheets[sheet];
        if received.is_empty() {
            received.resize(pixels, Received::default());
        }
        received
    }

    /// Adds what another film of as many pixels gathered.
    pub fn merge(&mut self, other: &Self) {
        for (number, from) in other.sheets.iter().enumerate().filter(|(_, from)| !from.is_empty()) {
            self.sheet(number, from.len()).iter_mut().zip(from).for_each(|(a, b)| a.merge(b));
        }
        self.paths += other.paths;
        self.weights += other.weights;
        self.squared_weights += other.squared_weights;
        self.dropped += other.dropped;
    }

    /// Splats that were not finite.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// What is known of a pixel, as if all paths had been samples of its own; `None` while its sheet received nothing.
    pub fn pixel(&self, sheet: usize, pixel: usize) -> Option<Pixel> {
        let received = self.sheets.get(sheet)?.get(pixel)?;
        let counts = [self.weights, self.squared_weights, self.paths];
        Some(Pixel::of_sums(received.sum, received.squares, counts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Path = Vec<(usize, [f32; 3])>;

    fn splats(paths: &[Path]) -> Splats {
        let mut splats = Splats::default();
        for path in paths {
            path.iter().for_each(|(pixel, light)| splats.add(0, 0, *pixel, *light));
            splats.end_paths(1);
        }
        splats
    }

    fn gathered(runs: &[(Vec<Path>, f32)]) -> Gathered {
        let mut all = Gathered::default();
        runs.iter().for_each(|(paths, weight)| all.add(&splats(paths), *weight, 4));
        all
    }

    proptest! {
        /// Any order, any cut; the mean and the variance are those of the definition.
        #[test]
        fn sums_are_exact(paths in prop::collection::vec(prop::collection::vec((0usize..4, prop::array::uniform3(0.0f32..1e6)), 0..4), 2..40), cut in 0usize..40) {
            let whole = gathered(&[(paths.clone(), 1.0)]);
            let mut reversed = paths.clone();
            reversed.reverse();
            prop_assert_eq!(&whole, &gathered(&[(reversed, 1.0)]));
            let (a, b) = paths.split_at(cut.min(paths.len()));
            let (mut first, second) = (gathered(&[(a.to_vec(), 1.0)]), gathered(&[(b.to_vec(), 1.0)]));
            first.merge(&second);
            prop_assert_eq!(&whole, &first);
            for pixel in 0..4 {
                let values: crate::math::Moments = paths
                    .iter()
                    .map(|path| f64::from(path.iter().filter(|s| s.0 == pixel).map(|s| s.1[1]).sum::<f32>()))
                    .collect();
                let Some(p) = whole.pixel(0, pixel) else { continue };
                prop_assert!((p.mean()[1] - values.mean()).abs() <= 1e-9 * values.mean());
                prop_assert!((p.variance()[1] - values.variance()).abs() <= 1e-6 * values.variance());
            }
        }
    }

    #[test]
    fn weights_and_bad_splats() {
        let path = |light: f32| vec![(1, [light, 0.0, -light])];
        let mut all = gathered(&[(vec![path(3.0)], 4.0), (vec![path(1.0), path(2.0)], 0.5)]);
        let mean = (12.0 + 0.5 + 1.0) / 5.0;
        assert_eq!(all.pixel(0, 1).map(|p| p.mean()), Some([mean, 0.0, -mean]));
        assert_eq!(all.pixel(0, 0).map(|p| p.mean()), Some([0.0; 3]));
        all.add(&splats(&[path(f32::NAN), path(1e30)]), 1.0, 4);
        assert_eq!((all.dropped(), all.paths), (2, 5));
        // Squares out of reach leave the mean alone.
        let bright = gathered(&[(vec![path(4e9), path(1.0)], 1.0)]).pixel(0, 1).expect("light");
        assert_eq!((bright.mean()[0], bright.variance()[0]), (2_000_000_000.5, f64::INFINITY));
    }

    #[test]
    fn numbers_are_fixed() {
        for x in [0.0, 1.0, -1.5, 3.7e-5, 4.2e9, -1e-30, f64::powi(2.0, -64), 1e-25] {
            assert_eq!(fixed(x, 64), (x * f64::powi(2.0, 64)) as i128, "{x}");
        }
    }
}
