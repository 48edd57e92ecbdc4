//! How much a particle counts by its distance (Silverman 1986, §2.6 and §4.2), and how the radius of an estimate shrinks.
//!
//! With x = d/r, in units of 1/(π r²), so that the integral over the disk is 1:
//!
//! | `kernel` | value |
//! |---|---|
//! | `constant` | 1 |
//! | `cone` | 3 (1 − x) (Jensen 1996, its k = 1) |
//! | `epanechnikov` | 2 (1 − x²) |

use crate::scene::Scene;
use rebond_lanes::Real;
use serde::{Deserialize, Serialize};

/// How much a particle counts by its distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// All the same: flux over area.
    #[default]
    Constant,
    /// Less in proportion to distance.
    Cone,
    /// Less in proportion to its square.
    Epanechnikov,
}

impl Kernel {
    /// The kernel times π r², at a squared distance over r² of less than 1.
    #[inline(always)]
    pub fn value<F: Real>(self, squared: F) -> F {
        match self {
            Self::Constant => F::one(),
            Self::Cone => (F::one() - squared.sqrt()) * 3.0,
            Self::Epanechnikov => (F::one() - squared) * 2.0,
        }
    }
}

/// The first radius of a progressive estimate where none is given: 0.3 % of half the diagonal of the box around what the eye meets,
/// by whatever paths.
pub fn first_radius(scene: &Scene) -> f32 {
    let seen = scene.extent_seen();
    let (low, high) = scene.bounds();
    let [x, y, z] = [0, 1, 2].map(|i| high[i] - low[i]);
    0.003 * 0.5 * if seen > 0.0 { seen } else { x.hypot(y).hypot(z) }
}

/// The radius of iteration n = 0, 1, … of a progressive estimate whose first is r_0 (Knaus and Zwicker 2011, eq. 15):
///
/// ```text
/// r_{n+1}² = r_n² (n + 1 + α) / (n + 2)
/// ```
///
/// The mean over N iterations then has a variance of order N^−α and a bias of order N^(α−1): both vanish for 0 < α < 1.
pub fn shrunk(first: f32, alpha: f32, iteration: u32) -> f32 {
    // The product is Γ(n + 1 + α) / (Γ(1 + α) Γ(n + 2)).
    let (n, alpha) = (f64::from(iteration), f64::from(alpha));
    let ln = |x: f64| statrs::function::gamma::ln_gamma(x);
    let squared = (ln(n + 1.0 + alpha) - ln(1.0 + alpha) - ln(n + 2.0)).exp();
    (f64::from(first) * squared.sqrt()) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_integrate_to_one() {
        for kernel in [Kernel::Constant, Kernel::Cone, Kernel::Epanechnikov] {
            // Over the disk, uniform in the squared distance.
            let n = 10_000;
            let sum: f64 = (0..n).map(|i| f64::from(kernel.value((i as f32 + 0.5) / n as f32))).sum();
            assert!((sum / f64::from(n) - 1.0).abs() < 1e-4, "{kernel:?}");
        }
    }

    #[test]
    fn radii_follow_the_recurrence() {
        let (mut squared, alpha) = (4.0_f64, 2.0 / 3.0);
        for n in 0..1000 {
            let r = f64::from(shrunk(2.0, alpha as f32, n));
            assert!((r * r / squared - 1.0).abs() < 1e-5, "{n}");
            squared *= (f64::from(n) + 1.0 + alpha) / (f64::from(n) + 2.0);
        }
    }
}
