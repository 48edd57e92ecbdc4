//! Progressive refinement (Cohen et al. 1988): the patch with the most unshot light sends it to all others, and so on. A picture is
//! there after the first few, and no row of F is needed before its patch's turn.
//!
//! ```text
//! i = argmax A_i ΔL_i:    ΔL_j += ρ_j F_ji ΔL_i,   L_j += ρ_j F_ji ΔL_i for all j;   ΔL_i = 0
//! ```
//!
//! What is unshot is shown as if it came from everywhere alike, `ρ_j Σ A ΔL / Σ A (1 − ρ̄)`, until it has been shot.

use super::{Channels, MOST_ITERATIONS, Problem};
use crate::integrators::radiosity::form_factors::{FormFactors, scale_of};
use crate::render::Observer;
use rayon::prelude::*;

/// Shooting ends when what is unshot has come down to this share of what the sources send out.
pub const ENOUGH: f64 = 2e-6;
/// Patches whose light one thread takes to.
const PART: usize = 1024;

/// Shooting under way.
pub struct Shooting {
    /// What has been reflected. Apart from the sources, beside which small light would be lost.
    reflected: [Vec<f64>; 3],
    unshot: [Vec<f64>; 3],
    /// Rows of A_i F_ij that were needed, as long as they are allowed to be kept.
    rows: Vec<Option<Vec<f32>>>,
    /// What each patch's row is multiplied by, as far as it has been needed.
    scale: Vec<Option<f32>>,
    kept: u64,
    memory: u64,
    /// Power of the sources, over π.
    sent: f64,
    /// Patches shot, those shot again included.
    pub shots: u64,
    /// Rays traced.
    pub rays: u64,
}

impl Shooting {
    /// Before the first shot. Rows are kept within this many bytes.
    pub fn new(problem: &Problem, memory: u64) -> Self {
        let n = problem.areas.len();
        let mut shooting = Self {
            reflected: std::array::from_fn(|_| vec![0.0; n]),
            unshot: problem.source.each_ref().map(|s| s.iter().map(|x| f64::from(*x)).collect()),
            rows: vec![None; n],
            scale: vec![None; n],
            kept: 0,
            memory,
            sent: 0.0,
            shots: 0,
            rays: 0,
        };
        shooting.sent = shooting.left(problem).1;
        shooting
    }

    fn power(&self, problem: &Problem, i: usize) -> f64 {
        self.unshot.iter().map(|c| c[i].abs()).sum::<f64>() * problem.areas[i]
    }

    /// The patch with the most unshot power, and what all have.
    fn left(&self, problem: &Problem) -> (usize, f64) {
        let (mut brightest, mut most, mut sum) = (0, 0.0, 0.0);
        for i in 0..problem.areas.len() {
            let power = self.power(problem, i);
            sum += power;
            if power > most {
                (brightest, most) = (i, power);
            }
        }
        (brightest, sum)
    }

    /// Whether it has taken as long as it may.
    fn is_tired(&self) -> bool {
        self.shots >= u64::from(MOST_ITERATIONS) * self.rows.len() as u64
    }

    /// What is unshot over what the sources send, if it gave up with so much.
    pub fn residual(&self, problem: &Problem) -> Option<f64> {
        (self.is_tired() && self.sent > 0.0).then(|| self.left(problem).1 / self.sent)
    }

    /// Shoots until what is left is below this share of what the sources sent, or it gives up. False if told to stop.
    pub fn shoot_until(
        &mut self,
        share: f64,
        factors: &FormFactors,
        problem: &Problem,
        observer: &dyn Observer,
    ) -> bool {
        let n = problem.areas.len();
        loop {
            let (i, left) = self.left(problem);
            if left <= share * self.sent || left == 0.0 || self.is_tired() {
                return true;
            }
            if observer.should_stop() {
                return false;
            }
            let (row, known) = match self.rows[i].take() {
                Some(row) => (row, true),
                None => {
                    let mut row = vec![0.0; n];
                    let parts = row.par_chunks_mut(PART).enumerate();
                    let rays: u64 = parts.map(|(p, out)| factors.row(i, p * PART..(p * PART + out.len()), out)).sum();
                    observer.advance(0, rays);
                    self.rays += rays;
                    (row, false)
                }
            };
            if self.scale[i].is_none() {
                // What it received before its row was known is brought down now.
                let sum: f64 = row.iter().map(|x| f64::from(*x)).sum();
                let scale = scale_of(sum / problem.areas[i]);
                for c in 0..3 {
                    let (source, scale) = (f64::from(problem.source[c][i]), f64::from(scale));
                    self.reflected[c][i] *= scale;
                    self.unshot[c][i] = source + scale * (self.unshot[c][i] - source);
                }
                self.scale[i] = Some(scale);
            }
            for c in 0..3 {
                let shot = std::mem::take(&mut self.unshot[c][i]);
                if shot == 0.0 {
                    continue;
                }
                for (j, exchange) in row.iter().enumerate() {
                    let gain = f64::from(problem.reflectance[c][j]) / problem.areas[j];
                    let more = gain * f64::from(*exchange) * shot * f64::from(self.scale[j].unwrap_or(1.0));
                    self.reflected[c][j] += more;
                    self.unshot[c][j] += more;
                }
            }
            self.shots += 1;
            let bytes = 4 * n as u64;
            if known || self.kept + bytes <= self.memory {
                self.kept += if known { 0 } else { bytes };
                self.rows[i] = Some(row);
            }
        }
    }

    /// Bytes of the rows that were kept.
    pub fn bytes(&self) -> u64 {
        self.kept
    }

    /// L so far, and what is unshot as if it came from everywhere alike.
    pub fn with_ambient(&self, problem: &Problem) -> Channels {
        let total: f64 = problem.areas.iter().sum();
        let reflectance = problem.mean(&problem.reflectance);
        std::array::from_fn(|c| {
            let unshot: f64 = self.unshot[c].iter().zip(&problem.areas).map(|(x, a)| x * a).sum();
            let ambient = unshot / total / f64::from(1.0 - reflectance[c]).max(1e-3);
            let of = |i: usize| {
                let ambient = f64::from(problem.reflectance[c][i]) * ambient;
                (f64::from(problem.source[c][i]) + self.reflected[c][i] + ambient) as f32
            };
            (0..problem.areas.len()).map(of).collect()
        })
    }
}
