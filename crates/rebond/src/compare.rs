//! How far one picture is from another: error numbers, what an eye would see of them ([`Pair::flip`]), and whether two
//! renderings can be of the same scene at all ([`welch`]).

use crate::math::LUMINANCE;
use rayon::prelude::*;
use statrs::distribution::{Binomial, ContinuousCDF, DiscreteCDF, StudentsT};

/// Why two pictures cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// A list of pixels is not as long as the size asks.
    #[error("{found} values for {width}×{height} pixels")]
    Length {
        /// How many values there are.
        found: usize,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// There is no pixel.
    #[error("an image of {width}×{height} pixels cannot be compared")]
    Empty {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// A block of no pixels, or a level that is no probability between 0 and 1.
    #[error("blocks of 0 pixels, or a level not between 0 and 1")]
    Setting,
}

/// Two pictures of one size in linear Rec.709, row by row from the top left.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    reference: &'a [[f32; 3]],
    test: &'a [[f32; 3]],
    width: usize,
    height: usize,
}

/// Pixels per degree at which FLIP is evaluated unless told otherwise: a 0.7 m wide 4K screen seen from 0.7 m
/// (Andersson et al. 2020).
pub const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// The visible difference of two pictures: 0 none, 1 the most there can be.
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Mean over all pixels.
    pub mean: f64,
    /// One value per pixel.
    pub map: Vec<f32>,
}

fn check<T>(values: &[T], width: u32, height: u32) -> Result<(), CompareError> {
    match values.len() {
        _ if width == 0 || height == 0 => Err(CompareError::Empty { width, height }),
        found if found != width as usize * height as usize => Err(CompareError::Length { found, width, height }),
        _ => Ok(()),
    }
}

impl<'a> Pair<'a> {
    /// Pairs a picture with its reference.
    pub fn new(reference: &'a [[f32; 3]], test: &'a [[f32; 3]], width: u32, height: u32) -> Result<Self, CompareError> {
        check(reference, width, height)?;
        check(test, width, height)?;
        Ok(Self { reference, test, width: width as usize, height: height as usize })
    }

    fn colours(&self) -> impl Iterator<Item = [(f64, f64); 3]> {
        let both = self.reference.iter().zip(self.test);
        both.map(|(r, x)| std::array::from_fn(|c| (f64::from(r[c]), f64::from(x[c]))))
    }

    fn mean_over_pixels(&self, error: impl Fn([(f64, f64); 3]) -> f64) -> f64 {
        self.colours().map(error).sum::<f64>() / self.reference.len() as f64
    }

    /// Mean squared error over pixels and channels.
    pub fn mse(&self) -> f64 {
        self.mean_over_pixels(|p| p.iter().map(|(r, x)| (x - r).powi(2)).sum::<f64>() / 3.0)
    }

    /// The square root of [`Pair::mse`].
    pub fn rmse(&self) -> f64 {
        self.mse().sqrt()
    }

    /// Mean of $(x-r)^2/(r^2+0.01)$ over channels and pixels, without the worst pixels: `trim` is the fraction of
    /// pixels left out (0 for none, 0.001 to tame fireflies). Rousselle, Knaus, Zwicker, "Adaptive Sampling and
    /// Reconstruction using Greedy Error Minimization" (2011).
    pub fn rel_mse(&self, trim: f64) -> f64 {
        let error = |p: [(f64, f64); 3]| p.iter().map(|(r, x)| (x - r).powi(2) / (r * r + 0.01)).sum::<f64>() / 3.0;
        let mut errors: Vec<f64> = self.colours().map(error).collect();
        let keep = errors.len() - (trim.clamp(0.0, 1.0) * errors.len() as f64) as usize;
        if keep < errors.len() {
            // NaN of either sign counts as worst of all.
            errors.select_nth_unstable_by(keep, |a, b| a.is_nan().cmp(&b.is_nan()).then(a.total_cmp(b)));
        }
        errors[..keep].iter().sum::<f64>() / keep.max(1) as f64
    }

    /// Mean of test minus reference for each channel: 0 for an unbiased test up to noise.
    pub fn mean_signed_error(&self) -> [f64; 3] {
        std::array::from_fn(|c| self.mean_over_pixels(|p| p[c].1 - p[c].0))
    }

    /// LDR-FLIP, the difference a person sees who flips between two pictures. Values are cut to 0…1 first (NaN to 0);
    /// expose and tone-map them before. `pixels_per_degree` is the resolution of the viewer, usually
    /// [`PIXELS_PER_DEGREE`].
    ///
    /// Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator for
    /// Alternating Images" (2020).
    pub fn flip(&self, pixels_per_degree: f32) -> Flip {
        let density =
            if pixels_per_degree.is_finite() { pixels_per_degree.clamp(1.0, 1000.0) } else { PIXELS_PER_DEGREE };
        let [reference, test] = [self.reference, self.test].map(|p| self.seen(p, f64::from(density)));
        let most = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(QC);
        let pixel = |(r, x): (&Seen, &Seen)| {
            // Colour metric and its redistribution: large differences are compressed.
            let colour = hyab(r.colour, x.colour).powf(QC);
            let (knee, share) = (0.4 * most, 0.95);
            let colour = if colour < knee {
                colour * share / knee
            } else {
                share + (colour - knee) / (most - knee) * (1.0 - share)
            };
            // Feature metric: edges and points that are in only one of the pictures.
            let feature = (r.edge - x.edge).abs().max((r.point - x.point).abs());
            let feature = (feature * std::f64::consts::FRAC_1_SQRT_2).clamp(0.0, 1.0).sqrt();
            // Final difference.
            colour.clamp(0.0, 1.0).powf(1.0 - feature) as f32
        };
        let map: Vec<f32> = reference.par_iter().zip(&test).map(pixel).collect();
        Flip { mean: map.iter().map(|&v| f64::from(v)).sum::<f64>() / map.len() as f64, map }
    }

    /// HDR-FLIP: for each pixel the largest [`Pair::flip`] of all exposures at which something of the reference is shown. They
    /// reach, in steps of at most a stop, from the one at which its brightest pixel is tone-mapped to 0.85 to that
    /// at which its median luminance is. No exposure need be chosen.
    ///
    /// Andersson, Nilsson, Shirley, Akenine-Möller, "Visualizing Errors in Rendered High Dynamic Range Images" (2021).
    pub fn hdr_flip(&self, pixels_per_degree: f32) -> Flip {
        let mut largest = Flip { mean: 0.0, map: vec![0.0; self.reference.len()] };
        for exposure in self.exposures() {
            let gain = exposure.exp2();
            let [reference, test] = [self.reference, self.test].map(|pixels| {
                pixels.par_iter().map(|p| p.map(|v| filmic(f64::from(v) * gain) as f32)).collect::<Vec<_>>()
            });
            let shown = Pair { reference: &reference, test: &test, ..*self };
            let flip = shown.flip(pixels_per_degree);
            largest.map.iter_mut().zip(flip.map).for_each(|(most, v)| *most = most.max(v));
        }
        largest.mean = largest.map.iter().map(|&v| f64::from(v)).sum::<f64>() / largest.map.len() as f64;
        largest
    }

    /// The exposures of HDR-FLIP, in stops.
    fn exposures(&self) -> Vec<f64> {
        let luminance = |p: &[f32; 3]| p.iter().zip(LUMINANCE).map(|(x, w)| f64::from(*x) * f64::from(w)).sum::<f64>();
        let finite = |v: f64| if v.is_finite() { v.max(0.0) } else { 0.0 };
        let mut all: Vec<f64> = self.reference.iter().map(luminance).map(finite).collect();
        let brightest = all.iter().fold(0.0, |most: f64, v| most.max(*v));
        let middle = all.len() / 2;
        let median = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
        if brightest <= 0.0 {
            return vec![0.0];
        }
        // Where the curve reaches 0.85: (0.85 k₃ − k₀) x² + (0.85 k₄ − k₁) x + 0.85 k₅ = 0, its larger root.
        let [a, b, c] = [0.85 * FILMIC[2] - FILMIC[0], 0.85 * FILMIC[3] - FILMIC[1], 0.85 * FILMIC[4]];
        let white = (-b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
        let [first, last] = [brightest, median.max(f64::from(f32::EPSILON))].map(|v| (white / v).log2());
        let steps = ((last - first).ceil() as usize).clamp(2, 64);
        (0..steps).map(|k| first + (last - first) * k as f64 / (steps - 1) as f64).collect()
    }

    /// What the eye makes of each pixel.
    fn seen(&self, pixels: &[[f32; 3]], density: f64) -> Vec<Seen> {
        let clean = |v: f32| if v.is_nan() { 0.0 } else { f64::from(v).clamp(0.0, 1.0) };
        let opponent: Vec<[f64; 3]> = pixels.par_iter().map(|p| to_opponent(p.map(clean))).collect();
        let [achromatic, red_green, blue_yellow] =
            std::array::from_fn(|c| opponent.iter().map(|p| p[c]).collect::<Vec<_>>());

        // Spatial filtering: the eye's contrast sensitivity blurs each opponent channel by its own sum of Gaussians
        // a √(π/b) exp(-π² x²/b), x in degrees.
        let gaussian = |b: f64, radius: i32| {
            let value = |x: i32| (-(std::f64::consts::PI * f64::from(x) / density).powi(2) / b).exp();
            (-radius..=radius).map(value).collect::<Vec<f64>>()
        };
        let radius = (3.0 * (0.04f64 / 2.0).sqrt() / std::f64::consts::PI * density).ceil() as i32;
        let blur = |plane: &[f64], terms: &[(f64, f64)]| {
            let terms: Vec<_> =
                terms.iter().map(|(a, b)| (a * (std::f64::consts::PI / b).sqrt(), gaussian(*b, radius))).collect();
            let total: f64 = terms.iter().map(|(weight, g)| weight * g.iter().sum::<f64>().powi(2)).sum();
            let mut sum = vec![0.0; plane.len()];
            for (weight, g) in &terms {
                let rows: Vec<f64> = g.iter().map(|v| v * weight / total).collect();
                let blurred = self.convolve(plane, &rows, g);
                sum.iter_mut().zip(blurred).for_each(|(s, v)| *s += v);
            }
            sum
        };
        let a = blur(&achromatic, &[(1.0, 0.0047)]);
        let rg = blur(&red_green, &[(1.0, 0.0053)]);
        let by = blur(&blue_yellow, &[(34.1, 0.04), (13.5, 0.025)]);

        // Feature detection: first and second derivatives of a Gaussian as wide as the features to be seen, 0.082°; their positive
        // and negative weights each sum to one.
        let sigma = 0.5 * 0.082 * density;
        let radius = (3.0 * sigma).ceil() as i32;
        let kernel = |weight: &dyn Fn(f64) -> f64| {
            let values = (-radius..=radius).map(|x| f64::from(x) / sigma).map(|x| weight(x) * (-x * x / 2.0).exp());
            let values: Vec<f64> = values.collect();
            let sum = |sign: f64| values.iter().map(|v| (v * sign).max(0.0)).sum::<f64>().max(f64::MIN_POSITIVE);
            let (up, down) = (sum(1.0), sum(-1.0));
            values.iter().map(|v| v / if *v > 0.0 { up } else { down }).collect::<Vec<f64>>()
        };
        let (smooth, edge, point) = (kernel(&|_| 1.0), kernel(&|x| -x), kernel(&|x| x * x - 1.0));
        let grey: Vec<f64> = achromatic.iter().map(|v| (v + 16.0) / 116.0).collect();
        let length = |kernel: &[f64]| {
            let (x, y) = (self.convolve(&grey, kernel, &smooth), self.convolve(&grey, &smooth, kernel));
            x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect::<Vec<f64>>()
        };
        let (edges, points) = (length(&edge), length(&point));

        let to_rgb = glam::DMat3::from_cols_array_2d(&TO_XYZ).transpose().inverse();
        let pixel = |i: usize| {
            let colour = hunt_lab(from_opponent(to_rgb, [a[i], rg[i], by[i]]).map(|v| v.clamp(0.0, 1.0)));
            Seen { colour, edge: edges[i], point: points[i] }
        };
        (0..pixels.len()).into_par_iter().map(pixel).collect()
    }

    /// A separable convolution; beyond the border the border repeats.
    fn convolve(&self, plane: &[f64], along_x: &[f64], along_y: &[f64]) -> Vec<f64> {
        let (width, height) = (self.width, self.height);
        let mut rows = vec![0.0; plane.len()];
        let radius = along_x.len() / 2;
        rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each_init(Vec::new, |wide, (out, row)| {
            wide.clear();
            wide.resize(radius, row[0]);
            wide.extend_from_slice(row);
            wide.resize(width + 2 * radius, row[width - 1]);
            for (k, w) in along_x.iter().enumerate() {
                out.iter_mut().zip(&wide[k..]).for_each(|(out, v)| *out += w * v);
            }
        });
        let mut both = vec![0.0; plane.len()];
        both.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            for (k, w) in along_y.iter().enumerate() {
                let row = (y + k).saturating_sub(along_y.len() / 2).min(height - 1) * width;
                out.iter_mut().zip(&rows[row..row + width]).for_each(|(out, v)| *out += w * v);
            }
        });
        both
    }
}

struct Seen {
    /// Hunt-adjusted CIELAB of the blurred picture.
    colour: [f64; 3],
    edge: f64,
    point: f64,
}

/// Coefficients k₀, k₁, k₃, k₄, k₅ of the curve below, its input scaled by 0.6.
const FILMIC: [f64; 5] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

/// The tone curve of HDR-FLIP, $(k_0 x^2 + k_1 x)/(k_3 x^2 + k_4 x + k_5)$: Narkowicz, "ACES Filmic Tone Mapping Curve" (2015).
fn filmic(x: f64) -> f64 {
    let x = x.clamp(0.0, 1e6);
    let [k0, k1, k3, k4, k5] = FILMIC;
    (x * (k0 * x + k1) / (x * (k3 * x + k4) + k5)).clamp(0.0, 1.0)
}

/// Exponent of colour differences.
const QC: f64 = 0.7;

/// Rec.709 to CIE XYZ (D65), each row divided by its sum so that white is (1, 1, 1).
const TO_XYZ: [[f64; 3]; 3] = {
    const ROWS: [[f64; 3]; 3] = [
        [0.412_386_563, 0.357_591_491, 0.180_450_490],
        [0.212_636_822, 0.715_182_981, 0.072_180_196],
        [0.019_330_620, 0.119_197_164, 0.950_372_587],
    ];
    let mut rows = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let row = ROWS[i / 3];
        rows[i / 3][i % 3] = row[i % 3] / (row[0] + row[1] + row[2]);
        i += 1;
    }
    rows
};

fn to_xyz(rgb: [f64; 3]) -> [f64; 3] {
    TO_XYZ.map(|row| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2])
}

/// CIELAB without its cube roots: achromatic, red–green, blue–yellow.
fn to_opponent(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = to_xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The linear colour again; `to_rgb` is the inverse of [`TO_XYZ`].
fn from_opponent(to_rgb: glam::DMat3, [a, rg, by]: [f64; 3]) -> [f64; 3] {
    let y = (a + 16.0) / 116.0;
    (to_rgb * glam::DVec3::new(y + rg / 500.0, y, y - by / 200.0)).to_array()
}

/// CIELAB with chroma scaled by luminance, since dark colours look less colourful (Hunt effect).
fn hunt_lab(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let root = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = to_xyz(rgb).map(root);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Distance of two colours that holds for large differences (HyAB).
fn hyab(p: [f64; 3], q: [f64; 3]) -> f64 {
    (p[0] - q[0]).abs() + (p[1] - q[1]).hypot(p[2] - q[2])
}

/// What is known of one channel of a rendering, a number per pixel each.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    /// The mean of the pixel's samples.
    pub mean: &'a [f32],
    /// The variance of that mean: the samples' variance (by N − 1) over N.
    pub variance: &'a [f32],
    /// How many samples N the pixel has.
    pub samples: &'a [f32],
}

/// The outcome of a t-test on every block of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Welch {
    /// Blocks in a row.
    pub columns: usize,
    /// Blocks, row by row from the top left; `None` where a pixel has fewer than two samples or is not finite.
    pub blocks: Vec<Option<Block>>,
    /// How many blocks could be tested.
    pub tested: usize,
    /// The level α of the whole test.
    pub alpha: f64,
    /// The level of one block at which the probability of any false alarm among all blocks is α (Šidák 1967).
    pub block_level: f64,
    /// Blocks whose p-value is below `block_level`.
    pub significant: usize,
    /// Blocks whose p-value is below α; α times all of them are expected if the images agree.
    pub below_alpha: usize,
    /// The probability of that many or more blocks below α if the images agree.
    pub below_alpha_p: f64,
}

/// The t-test of one block of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Difference of the means, second minus first, in units of its standard error.
    pub t: f64,
    /// Degrees of freedom.
    pub dof: f64,
    /// The probability of a difference as large or larger if both images have the same expectation.
    pub p: f64,
}

impl Welch {
    /// Whether nothing speaks against equal expectations at level α: no single block, nor the number of odd ones.
    pub fn passes(&self) -> bool {
        self.significant == 0 && self.below_alpha_p >= self.alpha
    }
}

/// Tests block by block (8×8 pixels are usual) whether two renderings have the same expectation.
///
/// The mean of a block of $n$ pixels has the variance $\sum_i v_i/n^2$, where the pixels are independent, as they are
/// unless splats tie them together, or particles of light that they share. Welch, "The generalization of Student's
/// problem" (1947): the difference over its standard error has Student's distribution with about
/// $(\sum v_i)^2 / \sum v_i^2/(N_i-1)$ degrees of freedom, sums over the pixels of both images.
///
/// Variances estimated from stratified or quasi-random samples are too large, which makes the test milder than α.
/// Channels are not independent of each other: test one, or each by itself.
pub fn welch(
    first: Estimate<'_>,
    second: Estimate<'_>,
    width: u32,
    height: u32,
    block: u32,
    alpha: f64,
) -> Result<Welch, CompareError> {
    for list in [first.mean, first.variance, first.samples, second.mean, second.variance, second.samples] {
        check(list, width, height)?;
    }
    if block == 0 || !(alpha > 0.0 && alpha < 1.0) {
        return Err(CompareError::Setting);
    }
    let (width, height, size) = (width as usize, height as usize, block as usize);
    let (columns, rows) = (width.div_ceil(size), height.div_ceil(size));
    let test = |index: usize| {
        let (left, top) = (index % columns * size, index / columns * size);
        let pixels =
            (top..height.min(top + size)).flat_map(|y| (left..width.min(left + size)).map(move |x| y * width + x));
        let (mut difference, mut variance, mut spread) = (0.0, 0.0, 0.0);
        for i in pixels {
            difference += f64::from(second.mean[i]) - f64::from(first.mean[i]);
            for side in [first, second] {
                let (v, n) = (f64::from(side.variance[i]), f64::from(side.samples[i]));
                if !(n >= 2.0 && v >= 0.0) {
                    return None;
                }
                variance += v;
                spread += v * v / (n - 1.0);
            }
        }
        if !(difference.is_finite() && variance.is_finite() && spread.is_finite()) {
            return None;
        }
        if variance == 0.0 {
            let (t, p) = if difference == 0.0 { (0.0, 1.0) } else { (difference.signum() * f64::INFINITY, 0.0) };
            return Some(Block { t, dof: f64::INFINITY, p });
        }
        let t = difference / variance.sqrt();
        // Beyond a million degrees of freedom nothing changes any more, and sums of squares may have underflowed.
        let dof = (variance * variance / spread).clamp(1.0, 1e6);
        let dof = if dof.is_nan() { 1e6 } else { dof };
        let p = 2.0 * StudentsT::new(0.0, 1.0, dof).ok()?.sf(t.abs());
        Some(Block { t, dof, p: p.min(1.0) })
    };
    let blocks: Vec<Option<Block>> = (0..columns * rows).into_par_iter().map(test).collect();
    let p_values = || blocks.iter().flatten().map(|b| b.p);
    let tested = p_values().count();
    let block_level = -((-alpha).ln_1p() / tested.max(1) as f64).exp_m1();
    let below_alpha = p_values().filter(|&p| p < alpha).count();
    let below_alpha_p = match (below_alpha, Binomial::new(alpha, tested as u64)) {
        (1.., Ok(binomial)) => binomial.sf(below_alpha as u64 - 1),
        _ => 1.0,
    };
    let significant = p_values().filter(|&p| p < block_level).count();
    Ok(Welch { columns, tested, alpha, block_level, significant, below_alpha, below_alpha_p, blocks })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pair<'a>(reference: &'a [[f32; 3]], test: &'a [[f32; 3]], width: u32) -> Pair<'a> {
        Pair::new(reference, test, width, reference.len() as u32 / width).unwrap()
    }

    #[test]
    fn errors_by_hand() {
        let (reference, test) = ([[0.0, 1.0, 2.0], [0.3; 3]], [[0.1, 0.5, 2.0], [0.3; 3]]);
        let pair = pair(&reference, &test, 2);
        assert!((pair.mse() - (0.01 + 0.25) / 6.0).abs() < 1e-7);
        assert!((pair.rmse() - ((0.01 + 0.25) / 6.0f64).sqrt()).abs() < 1e-7);
        let relative = (0.01 / 0.01 + 0.25 / 1.01) / 6.0;
        assert!((pair.rel_mse(0.0) - relative).abs() < 1e-6);
        // Half of two pixels is the bad one.
        assert_eq!(pair.rel_mse(0.5), 0.0);
        assert_eq!(pair.rel_mse(1.0), 0.0);
        let signed = pair.mean_signed_error();
        assert!((signed[0] - 0.05).abs() < 1e-7 && (signed[1] + 0.25).abs() < 1e-7 && signed[2] == 0.0);
    }

    #[test]
    fn nan_is_trimmed_first() {
        let reference = [[1.0; 3]; 4];
        let test = [[1.5; 3], [f32::NAN, 1.0, 1.0], [-f32::NAN; 3], [1.5; 3]];
        assert!((pair(&reference, &test, 2).rel_mse(0.5) - 0.25 / 1.01).abs() < 1e-7);
        assert!(pair(&reference, &test, 2).rel_mse(0.25).is_nan());
    }

    #[test]
    fn sizes_are_checked() {
        assert_eq!(Pair::new(&[], &[], 0, 3).unwrap_err(), CompareError::Empty { width: 0, height: 3 });
        let short = Pair::new(&[[0.0; 3]; 6], &[[0.0; 3]; 5], 2, 3).unwrap_err();
        assert_eq!(short, CompareError::Length { found: 5, width: 2, height: 3 });
        assert_eq!(short.to_string(), "5 values for 2×3 pixels");
    }

    /// A picture with edges, points and all colours, from integers so that it can be made anywhere.
    fn pattern(seed: usize) -> Vec<[f32; 3]> {
        let value = |i: usize| ((i * (seed + 3) * 7919 + i / 40 * 104_729) % 256) as f32 / 255.0;
        (0..40 * 30)
            .map(|i| if i % 40 < 20 { [value(i / 5), value(i + 1), value(i / 3)] } else { [value(i / 800), 0.25, 0.5] })
            .collect()
    }

    #[test]
    fn flip_has_known_values() {
        let mean = |a: [f32; 3], b: [f32; 3]| pair(&[a; 576], &[b; 576], 24).flip(PIXELS_PER_DEGREE).mean;
        let (black, white) = ([0.0; 3], [1.0; 3]);
        assert_eq!(mean(black, black), 0.0);
        // Green and blue are the two colours farthest apart, by definition of the metric.
        assert!((mean([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]) - 1.0).abs() < 1e-6);
        // Worked out from the paper's colour pipeline alone, in a flat picture.
        assert!((mean(black, white) - 0.967_379_8).abs() < 1e-6);
        assert!((mean([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]) - 0.986_662_3).abs() < 1e-6);
        assert!((mean([0.5; 3], [0.4, 0.5, 0.5]) - 0.205_430_7).abs() < 1e-6);
        // Of the authors' own program, flip-evaluator 1.7, whose single precision shows in flat parts of a picture.
        let flip = pair(&pattern(1), &pattern(2), 40).flip(PIXELS_PER_DEGREE);
        assert!((flip.mean - 0.234_505_5).abs() < 1e-4, "{}", flip.mean);
        for (x, y, expected) in
            [(0, 0, 0.478_019_7), (19, 10, 0.450_034_2), (35, 15, 0.008_860_3), (39, 29, 0.144_966_5)]
        {
            assert!((flip.map[y * 40 + x] - expected).abs() < 1e-4, "({x}, {y}): {}", flip.map[y * 40 + x]);
        }
    }

    #[test]
    fn hdr_flip_is_that_of_its_authors() {
        let bright = |seed| pattern(seed).iter().map(|p| p.map(|v| 8.0 * v * v)).collect::<Vec<_>>();
        let (a, b) = (bright(1), bright(2));
        // flip-evaluator 1.7 by its command "HDR": three exposures from −1.815 744 5 to 0.570 856 9.
        let exposures = pair(&a, &b, 40).exposures();
        assert_eq!(exposures.len(), 3);
        assert!((exposures[0] + 1.815_744_5).abs() < 1e-5 && (exposures[2] - 0.570_856_9).abs() < 1e-5);
        let flip = pair(&a, &b, 40).hdr_flip(PIXELS_PER_DEGREE);
        assert!((flip.mean - 0.252_914_4).abs() < 1e-4, "{}", flip.mean);
        for (x, y, expected) in [(0, 0, 0.442_192_5), (19, 10, 0.502_878), (35, 15, 0.006_155_3), (39, 29, 0.125_470_3)]
        {
            assert!((flip.map[y * 40 + x] - expected).abs() < 1e-4, "({x}, {y}): {}", flip.map[y * 40 + x]);
        }
        // Nothing to see, whatever the exposure.
        assert_eq!(pair(&[[0.0; 3]; 4], &[[0.0; 3]; 4], 2).hdr_flip(PIXELS_PER_DEGREE).mean, 0.0);
        assert!(pair(&[[f32::NAN; 3]; 4], &[[f32::INFINITY; 3]; 4], 2).hdr_flip(PIXELS_PER_DEGREE).mean <= 1.0);
    }

    #[test]
    fn flip_is_symmetric_and_bounded() {
        let (a, b) = (pattern(1), pattern(2));
        let (one, two) = (pair(&a, &b, 40).flip(PIXELS_PER_DEGREE), pair(&b, &a, 40).flip(PIXELS_PER_DEGREE));
        assert_eq!(one, two);
        assert!(one.map.iter().all(|v| (0.0..=1.0).contains(v)));
        assert_eq!(pair(&a, &a, 40).flip(PIXELS_PER_DEGREE).mean, 0.0);
        let odd = [[f32::NAN, f32::INFINITY, -1.0]];
        let clean = [[0.0, 1.0, 0.0]];
        assert_eq!(pair(&odd, &clean, 1).flip(f32::NAN).mean, 0.0);
    }

    /// A number in 0…1 from its index: SplitMix64.
    fn random(index: u64) -> f64 {
        let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A rendering whose pixels have their own brightness and noise: means, variances of them, sample counts.
    fn rendering(seed: u64, width: usize, height: usize, samples: usize, gain: f64) -> [Vec<f32>; 3] {
        let mut lists = [Vec::new(), Vec::new(), Vec::new()];
        for i in 0..width * height {
            let (brightness, noise) = (0.2 + random(i as u64), 0.3 * random(i as u64 + 1_000_000));
            let first = (seed * 1_000_000_000) + (i * samples) as u64;
            let sample = |s: usize| gain * (brightness + noise * (random(first + s as u64 + 5_000_000) - 0.5));
            let values: Vec<f64> = (0..samples).map(sample).collect();
            let n = samples as f64;
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
            [mean, variance, n].iter().zip(&mut lists).for_each(|(v, list)| list.push(*v as f32));
        }
        lists
    }

    fn estimate([mean, variance, samples]: &[Vec<f32>; 3]) -> Estimate<'_> {
        Estimate { mean, variance, samples }
    }

    #[test]
    fn p_values_are_uniform_if_images_agree() {
        // 50×40 blocks, the last column and row of them narrower. Different counts of samples.
        let (width, height) = (397, 317);
        let (a, b) = (rendering(1, width, height, 4, 1.0), rendering(2, width, height, 7, 1.0));
        let test = welch(estimate(&a), estimate(&b), width as u32, height as u32, 8, 0.01).unwrap();
        assert_eq!((test.columns, test.tested), (50, 2000));
        let mut p: Vec<f64> = test.blocks.iter().flatten().map(|b| b.p).collect();
        p.sort_by(f64::total_cmp);
        // Kolmogorov–Smirnov at 1 %: D √n < 1.628.
        let distance = p.iter().enumerate().map(|(i, p)| (p - (i as f64 + 0.5) / 2000.0).abs() + 0.5 / 2000.0);
        let distance = distance.fold(0.0, f64::max) * 2000f64.sqrt();
        assert!(distance < 1.628, "{distance}");
        assert!(test.passes(), "{} {} {}", test.significant, test.below_alpha, test.below_alpha_p);
    }

    #[test]
    fn small_counts_keep_the_level() {
        // Two samples a pixel and one pixel a block: Student's distribution at its heaviest tails.
        let (a, b) = (rendering(3, 100, 100, 3, 1.0), rendering(4, 100, 100, 3, 1.0));
        let test = welch(estimate(&a), estimate(&b), 100, 100, 1, 0.05).unwrap();
        // Uniform noise and so few samples bend the level, but not by its double.
        assert!(test.below_alpha < 1000, "{}", test.below_alpha);
        assert!(test.blocks.iter().flatten().all(|b| (2.0..=4.000_1).contains(&b.dof)));
    }

    #[test]
    fn one_percent_of_bias_is_found() {
        let (a, b) = (rendering(1, 128, 128, 16, 1.0), rendering(2, 128, 128, 16, 1.01));
        let test = welch(estimate(&a), estimate(&b), 128, 128, 8, 0.01).unwrap();
        // The bias is about 0.007, the standard error of a block about 0.0025.
        assert!(!test.passes() && test.significant > 5 && test.below_alpha_p < 1e-9);
        let back = welch(estimate(&b), estimate(&a), 128, 128, 8, 0.01).unwrap();
        assert!(test.blocks.iter().flatten().zip(back.blocks.iter().flatten()).all(|(x, y)| (x.t + y.t).abs() < 1e-9));
    }

    #[test]
    fn a_test_by_hand() {
        let one = |mean: f32, variance: f32, n: f32| [vec![mean], vec![variance], vec![n]];
        let run = |a, b| welch(estimate(&a), estimate(&b), 1, 1, 8, 0.05).unwrap();
        // Difference 2, variances of the means 0.6 and 0.4 by 10 and 6 samples: t = 2, dof = 1/(0.04 + 0.032).
        let test = run(one(1.0, 0.6, 10.0), one(3.0, 0.4, 6.0));
        let block = test.blocks[0].unwrap();
        assert!((block.t - 2.0).abs() < 1e-6 && (block.dof - 1.0 / 0.072).abs() < 1e-5);
        // Student's distribution at 13.889 degrees of freedom: 2 (1 − F(2)) = 0.065449.
        assert!((block.p - 0.065_449_26).abs() < 1e-7, "{}", block.p);
        assert!((test.block_level - 0.05).abs() < 1e-12 && test.passes());
        // No noise at all: equal or certainly not.
        assert_eq!(run(one(1.0, 0.0, 9.0), one(1.0, 0.0, 9.0)).blocks[0].unwrap().p, 1.0);
        let surely = run(one(1.0, 0.0, 9.0), one(0.5, 0.0, 9.0));
        assert_eq!((surely.blocks[0].unwrap().p, surely.blocks[0].unwrap().t), (0.0, f64::NEG_INFINITY));
        assert!(!surely.passes());
        for bad in [one(1.0, 0.1, 1.0), one(f32::NAN, 0.1, 9.0), one(1.0, f32::INFINITY, 9.0), one(1.0, -1.0, 9.0)] {
            let test = run(bad, one(1.0, 0.1, 9.0));
            assert_eq!((test.blocks[0], test.tested, test.passes()), (None, 0, true));
        }
        let fine = one(1.0, 0.1, 9.0);
        assert_eq!(welch(estimate(&fine), estimate(&fine), 1, 1, 0, 0.05), Err(CompareError::Setting));
        assert_eq!(welch(estimate(&fine), estimate(&fine), 1, 1, 8, f64::NAN), Err(CompareError::Setting));
        assert!(welch(estimate(&fine), estimate(&fine), 2, 1, 8, 0.05).is_err());
    }

    #[test]
    fn levels_of_many_blocks() {
        let (a, b) = (rendering(1, 64, 64, 4, 1.0), rendering(2, 64, 64, 4, 1.0));
        let test = welch(estimate(&a), estimate(&b), 64, 64, 8, 0.01).unwrap();
        // 1 − 0.99^(1/64).
        assert!((test.block_level - 1.570_24e-4).abs() < 1e-8, "{}", test.block_level);
    }

    proptest! {
        #[test]
        fn nothing_panics(
            pixels in proptest::collection::vec(any::<[f32; 3]>(), 12),
            lists in proptest::collection::vec(proptest::collection::vec(any::<f32>(), 12), 6),
            density in any::<f32>(), trim in any::<f64>(), block in any::<u32>(), alpha in any::<f64>(),
        ) {
            let pair = Pair::new(&pixels[..], &pixels[..], 4, 3).unwrap();
            let _ = (pair.mse(), pair.rel_mse(trim), pair.mean_signed_error(), pair.rmse());
            prop_assert!(pair.flip(density).mean == 0.0);
            let side = |i: usize| Estimate { mean: &lists[i], variance: &lists[i + 1], samples: &lists[i + 2] };
            for alpha in [alpha, 0.05] {
                let _ = welch(side(0), side(3), 4, 3, block, alpha);
                let _ = welch(side(0), side(3), 4, 3, 2, alpha);
            }
        }
    }
}
