//! χ² and t-tests for the unit tests.

use crate::math::{Moments, Vec3};
use crate::sampling::{Sampler, SamplerSettings};
use rebond_lanes::scalar::Index1;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Significance of every single test: a sound build fails one in ten thousand (and seeds are fixed, so it does not).
pub const SIGNIFICANCE: f64 = 1e-4;

/// The chance of a χ² at least this large.
pub fn chi2_p_value(chi2: f64, degrees: f64) -> f64 {
    ChiSquared::new(degrees).expect("positive degrees").sf(chi2)
}

/// The two-sided chance of a mean this far from `expected`.
pub fn t_test_p_value(samples: &[f64], expected: f64) -> f64 {
    let moments: Moments = samples.iter().copied().collect();
    // Within the rounding of f32 there is nothing to tell apart.
    if (moments.mean() - expected).abs() <= 1e-6 * expected.abs() { 1.0 } else { moments.p_value(expected) }
}

/// Independent uniform pairs.
pub fn random_pairs(n: u32) -> impl Iterator<Item = [f32; 2]> {
    seeded_pairs(n, 12_345)
}

/// Independent uniform pairs, others for every seed.
pub fn seeded_pairs(n: u32, seed: u64) -> impl Iterator<Item = [f32; 2]> {
    let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
    (0..n).map(move |i| sampler.stream::<f32>(Index1(i), Index1(0)).pair(Index1(0)))
}

/// Compares counts of drawn cells with expected shares; cells expected to hold fewer than five are pooled.
pub fn chi2_counts(name: &str, counts: &[u32], expected: &[f64]) {
    let (mut chi2, mut cells) = (0.0, 0);
    let (mut pooled_count, mut pooled_expected) = (0.0, 0.0);
    let mut add = |count: f64, expected: f64| {
        chi2 += (count - expected).powi(2) / expected;
        cells += 1;
    };
    for (count, expected) in counts.iter().zip(expected) {
        let count = f64::from(*count);
        // Rounding may carry a sample or two across the edge of the support.
        assert!(*expected > 1e-6 || count <= 2.0, "{name}: {count} samples where the density is 0");
        if *expected >= 5.0 {
            add(count, *expected);
        } else {
            pooled_count += count;
            pooled_expected += expected;
            if pooled_expected >= 5.0 {
                add(pooled_count, pooled_expected);
                (pooled_count, pooled_expected) = (0.0, 0.0);
            }
        }
    }
    if cells <= 1 {
        panic!("{name}: nothing to compare");
    }
    let p = chi2_p_value(chi2, f64::from(cells - 1));
    assert!(p > SIGNIFICANCE, "{name}: χ² {chi2:.1} over {cells} cells, p = {p:.2e}");
}

/// Draws points of the unit square and compares them with their density.
pub fn chi2_square(name: &str, sample: impl Fn([f32; 2]) -> [f32; 2], pdf: impl Fn([f32; 2]) -> f32) {
    const SIDE: usize = 20;
    let n = 200_000;
    let mut counts = vec![0; SIDE * SIDE];
    for u in random_pairs(n) {
        let [x, y] = sample(u).map(|v| ((v * SIDE as f32) as usize).min(SIDE - 1));
        counts[y * SIDE + x] += 1;
    }
    let cell = |i: usize| {
        let (x0, y0) = ((i % SIDE) as f64 / SIDE as f64, (i / SIDE) as f64 / SIDE as f64);
        let fine = 40;
        let mut sum = 0.0;
        for k in 0..fine * fine {
            let at = |c: f64, j: usize| (c + (j as f64 + 0.5) / (fine * SIDE) as f64) as f32;
            sum += f64::from(pdf([at(x0, k % fine), at(y0, k / fine)]));
        }
        sum / (fine * fine * SIDE * SIDE) as f64
    };
    let mass: Vec<f64> = (0..SIDE * SIDE).map(cell).collect();
    let total: f64 = mass.iter().sum();
    assert!((total - 1.0).abs() < 5e-3, "{name}: the density integrates to {total}");
    let expected: Vec<f64> = mass.iter().map(|m| m / total * f64::from(n)).collect();
    chi2_counts(name, &counts, &expected);
}

/// Draws directions and compares them with their density, over bins of cosθ × φ.
pub fn chi2_sphere(name: &str, sample: impl Fn([f32; 2]) -> Vec3<f32>, pdf: impl Fn(Vec3<f32>) -> f32) {
    chi2_directions(name, |u| Some(sample(u)), pdf);
}

/// As [`chi2_sphere`], for samplers that may fail: the density may then integrate to less than 1.
pub fn chi2_directions(name: &str, sample: impl Fn([f32; 2]) -> Option<Vec3<f32>>, pdf: impl Fn(Vec3<f32>) -> f32) {
    const ROWS: usize = 40; // of θ: even spacing resolves narrow lobes better than even cosines
    const COLUMNS: usize = 24;
    let n = 200_000;
    let mut counts = vec![0; ROWS * COLUMNS + 1];
    for u in random_pairs(n) {
        let at = match sample(u) {
            None => ROWS * COLUMNS,
            Some(w) => {
                assert!((w.length() - 1.0).abs() < 1e-4, "{name}: |w| = {}", w.length());
                let theta = f64::from(w.x).hypot(f64::from(w.y)).atan2(f64::from(w.z));
                let phi = f64::from(w.y).atan2(f64::from(w.x)).rem_euclid(std::f64::consts::TAU);
                let row = (theta / std::f64::consts::PI * ROWS as f64) as usize;
                let column = (phi / std::f64::consts::TAU * COLUMNS as f64) as usize;
                row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
            }
        };
        counts[at] += 1;
    }
    let fine = 20;
    let cell = |i: usize| {
        let (row, column) = ((i / COLUMNS) as f64, (i % COLUMNS) as f64);
        let (dtheta, dphi) =
            (std::f64::consts::PI / (ROWS * fine) as f64, std::f64::consts::TAU / (COLUMNS * fine) as f64);
        let mut sum = 0.0;
        for k in 0..fine * fine {
            let theta = (row * fine as f64 + (k / fine) as f64 + 0.5) * dtheta;
            let phi = (column * fine as f64 + (k % fine) as f64 + 0.5) * dphi;
            let w = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|x| x as f32);
            sum += f64::from(pdf(Vec3::splat(w))) * theta.sin();
        }
        sum * dtheta * dphi
    };
    let mut mass: Vec<f64> = (0..ROWS * COLUMNS).map(cell).collect();
    let total: f64 = mass.iter().sum();
    assert!(total < 1.0 + 5e-3, "{name}: the density integrates to {total}");
    mass.push((1.0 - total).max(0.0));
    if mass[ROWS * COLUMNS] < 5e-3 && counts[ROWS * COLUMNS] == 0 {
        // Quadrature error, not failing samples.
        mass[ROWS * COLUMNS] = 0.0;
        mass.iter_mut().for_each(|m| *m /= total);
    }
    let expected: Vec<f64> = mass.iter().map(|m| m * f64::from(n)).collect();
    chi2_counts(name, &counts, &expected);
}
