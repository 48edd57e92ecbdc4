//! Ways to solve `L = S + T L`, T = diag(ρ) F, for each colour.
//!
//! | name | how | memory for N patches |
//! |---|---|---|
//! | `inverse` | (I − T)⁻¹ once, then one product for any S | 4 N² bytes a colour |
//! | `jacobi` | L ← S + T L, all patches at once | 2 N² bytes |
//! | `gauss-seidel` | the same, patch after patch, each from the newest values | 2 N² bytes |
//! | `progressive` | what is unshot, brightest patch first; shows an image at once | 4 N² bytes, or as little as 1000 N |
//! | `hierarchical` | exchange between parts as large as an error allows | 16 bytes a link |
//!
//! S is what patches send out of themselves: what they emit, and what they reflect of lights that are no patches.

pub mod hierarchical;
pub mod inverse;
pub mod iterative;
pub mod progressive;

use super::form_factors::Symmetric;
use rebond_lanes::{F32x16, Real};

/// A number for each patch, colour by colour.
pub type Channels = [Vec<f32>; 3];

/// What is to be solved.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Areas of the patches.
    pub areas: Vec<f64>,
    /// S.
    pub source: Channels,
    /// ρ.
    pub reflectance: Channels,
}

/// Iterations end when no patch changes by more than this share of the mean of what is reflected, or of what is sent out.
pub const TOLERANCE: f32 = 2e-6;
/// … or after this many, solved or not. Patches are shot so many times at most, on average.
pub const MOST_ITERATIONS: u32 = 2000;

impl Problem {
    /// Nothing, for each patch.
    pub fn zeros(&self) -> Channels {
        std::array::from_fn(|_| vec![0.0; self.areas.len()])
    }

    /// Means over the surfaces.
    pub fn mean(&self, values: &Channels) -> [f32; 3] {
        let total: f64 = self.areas.iter().sum();
        values.each_ref().map(|v| {
            let sum: f64 = v.iter().zip(&self.areas).map(|(x, a)| f64::from(*x) * a).sum();
            (sum / total) as f32
        })
    }

    /// Σ A |a − b| over Σ A S, all colours together: by how much two lights differ, over what the sources send.
    pub fn difference(&self, a: &Channels, b: &Channels) -> f64 {
        let power = |c: &[f32], of: &dyn Fn(usize, f32) -> f32| -> f64 {
            c.iter().enumerate().zip(&self.areas).map(|((i, x), area)| f64::from(of(i, *x).abs()) * area).sum()
        };
        let apart: f64 = (0..3).map(|c| power(&a[c], &|i, x| x - b[c][i])).sum();
        let sent: f64 = self.source.iter().map(|s| power(s, &|_, x| x)).sum();
        if sent > 0.0 { apart / sent } else { 0.0 }
    }

    /// What counts as no change: a share of the mean of what is reflected, in the brightest colour.
    pub fn threshold(&self, light: &Channels) -> f32 {
        let (all, source) = (self.mean(light), self.mean(&self.source));
        let reflected = (0..3).map(|c| all[c] - source[c]).fold(0.0, f32::max);
        let sent = all.into_iter().fold(0.0, f32::max);
        TOLERANCE * if reflected > 1e-3 * sent { reflected } else { sent }
    }
}

/// Σ a_j x_j over the columns of `a`.
fn dot_one(a: &[f32], x: &[f32]) -> f64 {
    let (whole, rest) = a.as_chunks::<16>();
    let mut sum = F32x16::zero();
    for (k, chunk) in whole.iter().enumerate() {
        sum = F32x16::load(chunk).mul_add(F32x16::load(&x[16 * k..]), sum);
    }
    let lanes: f64 = (0..16).map(|l| f64::from(sum.lane(l))).sum();
    let tail = rest.iter().zip(&x[16 * whole.len()..]);
    lanes + tail.map(|(a, x)| f64::from(*a) * f64::from(*x)).sum::<f64>()
}

/// The same for each colour.
fn dot(a: &[f32], x: &Channels) -> [f64; 3] {
    x.each_ref().map(|x| dot_one(a, x))
}

/// y_j += a_j s for each colour.
fn add_scaled(a: &[f32], s: [f32; 3], y: &mut Channels) {
    for (y, s) in y.iter_mut().zip(s) {
        if s != 0.0 {
            y.iter_mut().zip(a).for_each(|(y, a)| *y += a * s);
        }
    }
}

/// `ρ_i / A_i`: what light `Σ_j A_i F_ij L_j` adds to L_i.
fn gain(problem: &Problem, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| f64::from(problem.reflectance[c][i]) / problem.areas[i])
}

/// The residual of `L = S + T L`, over what the sources send.
pub fn residual(matrix: &Symmetric, problem: &Problem, light: &Channels) -> f64 {
    problem.difference(&iterative::step(matrix, problem, light), light)
}
