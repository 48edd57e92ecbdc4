//! The Monte Carlo estimator.
//!
//! ```text
//! ∫ f(x) dx ≈ F̄ = 1/N Σ f(X_i) / pdf(X_i),   E[F̄] = ∫ f   wherever pdf > 0 where f ≠ 0
//! ```
//!
//! Three choices make an estimator: the numbers u in [0, 1) (independent, stratified, of low discrepancy: a
//! [`Sampler`]'s), the warp that turns them into X of density pdf (importance sampling), and f. The
//! integrators are this with paths for X.

use crate::math::Moments;
use crate::sampling::{Sampler, SamplerSettings};
use rebond_lanes::scalar::Index1;

/// The numbers in [0, 1) that one dimension of `n` samples gets.
pub fn numbers(settings: SamplerSettings, seed: u64, n: u32) -> impl Iterator<Item = f64> {
    let sampler = Sampler::new(settings, seed);
    (0..n).map(move |i| f64::from(sampler.stream::<f32>(Index1(0), Index1(i)).value(Index1(0))))
}

/// A point and the density with which it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn<X> {
    /// The point.
    pub x: X,
    /// Its density.
    pub pdf: f64,
}

/// The mean of `f(X) / pdf(X)` over the points that `warp` makes of `numbers`. Its standard error is right for
/// independent numbers; for others take the spread of several estimates.
pub fn estimate<U, X>(
    numbers: impl IntoIterator<Item = U>,
    warp: impl Fn(U) -> Drawn<X>,
    f: impl Fn(X) -> f64,
) -> Moments {
    let term = |u| {
        let Drawn { x, pdf } = warp(u);
        f(x) / pdf
    };
    numbers.into_iter().map(term).collect()
}

/// ∫₀¹ √(1 − x²) dx = π/4, the lecture's example.
pub mod quarter_disk {
    use super::Drawn;

    /// Its value.
    pub const VALUE: f64 = std::f64::consts::FRAC_PI_4;

    /// The integrand.
    pub fn f(x: f64) -> f64 {
        (1.0 - x * x).max(0.0).sqrt()
    }

    /// Every x alike.
    pub fn uniform(u: f64) -> Drawn<f64> {
        Drawn { x: u, pdf: 1.0 }
    }

    /// By the parabola that the integrand begins as: pdf = 6/5 (1 − x²/2). Its distribution function (6x − x³)/5 = u is
    /// solved by x = √8 sin(asin(5u/√32)/3).
    pub fn importance(u: f64) -> Drawn<f64> {
        let x = 8.0_f64.sqrt() * ((5.0 * u / 32.0_f64.sqrt()).asin() / 3.0).sin();
        Drawn { x, pdf: 1.2 * (1.0 - 0.5 * x * x) }
    }

    /// The variance of one term with uniform x: ∫ f² − (π/4)².
    pub fn variance_uniform() -> f64 {
        2.0 / 3.0 - VALUE * VALUE
    }

    /// The same with [`importance`]: ∫ f²/pdf − (π/4)².
    pub fn variance_importance() -> f64 {
        (2.0 - 2.0_f64.sqrt() * 0.5_f64.sqrt().atanh()) / 1.2 - VALUE * VALUE
    }
}

/// The slope of log y over log x by least squares: −1/2 for the error of independent samples over their number.
pub fn log_log_slope(points: &[[f64; 2]]) -> f64 {
    let logs: Vec<[f64; 2]> = points.iter().map(|p| p.map(f64::ln)).collect();
    let n = logs.len() as f64;
    let [mx, my] = [0, 1].map(|k| logs.iter().map(|p| p[k]).sum::<f64>() / n);
    let (mut xy, mut xx) = (0.0, 0.0);
    for [x, y] in logs {
        xy += (x - mx) * (y - my);
        xx += (x - mx) * (x - mx);
    }
    xy / xx
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::SIGNIFICANCE;

    #[test]
    fn mean_and_variance_are_those_of_theory() {
        for seed in [1, 2, 3] {
            let drawn = || numbers(SamplerSettings::Independent {}, seed, 200_000);
            for (warp, variance) in [
                (quarter_disk::uniform as fn(f64) -> Drawn<f64>, quarter_disk::variance_uniform()),
                (quarter_disk::importance, quarter_disk::variance_importance()),
            ] {
                let mean = estimate(drawn(), warp, quarter_disk::f);
                let of_squares: Moments = drawn()
                    .map(|u| {
                        let Drawn { x, pdf } = warp(u);
                        (quarter_disk::f(x) / pdf - quarter_disk::VALUE).powi(2)
                    })
                    .collect();
                assert!(mean.p_value(quarter_disk::VALUE) > SIGNIFICANCE, "{mean:?}");
                assert!(of_squares.p_value(variance) > SIGNIFICANCE, "{of_squares:?} for {variance}");
            }
        }
    }

    /// u = F(x): what is drawn has the density that is said.
    #[test]
    fn the_warp_inverts_its_distribution() {
        for i in 0..=100 {
            let u = f64::from(i) / 100.0;
            let x = quarter_disk::importance(u).x;
            assert!(((6.0 * x - x * x * x) / 5.0 - u).abs() < 1e-14);
        }
    }

    /// Independent numbers err like N^(−1/2); strata and nets by more than a whole power faster here.
    #[test]
    fn errors_fall_as_fast_as_theory_says() {
        let slope = |settings: fn(u32) -> SamplerSettings| {
            let points: Vec<[f64; 2]> = (2..10)
                .map(|k| {
                    let n = 1 << k;
                    let squares: Moments = (0..400)
                        .map(|seed| estimate(numbers(settings(n), seed, n), quarter_disk::uniform, quarter_disk::f))
                        .map(|m| (m.mean() - quarter_disk::VALUE).powi(2))
                        .collect();
                    [f64::from(n), squares.mean().sqrt()]
                })
                .collect();
            log_log_slope(&points)
        };
        let independent = slope(|_| SamplerSettings::Independent {});
        let stratified = slope(|samples| SamplerSettings::Stratified { samples });
        let sobol = slope(|_| SamplerSettings::Sobol {});
        // An error of ε in each logarithm, four octaves to either side: ±0.05 is five standard errors.
        assert!((independent + 0.5).abs() < 0.05, "{independent}");
        assert!(stratified < -1.3 && sobol < -1.3, "{stratified} {sobol}");
    }

    #[test]
    fn slopes() {
        let line: Vec<[f64; 2]> = (1..9).map(|i| [f64::from(i), 3.0 * f64::from(i).powf(-0.5)]).collect();
        assert!((log_log_slope(&line) + 0.5).abs() < 1e-12);
    }
}
