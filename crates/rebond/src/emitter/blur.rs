//! Surroundings blurred by a lobe: a mirror in them looks as Phong's surface of the same lobe does in the sharp ones.
//!
//! ```text
//! L'(d) = (r+1)/2π ∫ L(ω) max(0, ω·d)ʳ dω = Σ k_l L_lm Y_lm(d)
//! k_0 = 1,    k_1 = (r+1) / (r+2),    k_l = k_{l−2} (r − l + 2) / (r + l + 1)
//! ```
//!
//! A lobe around an axis scales all spherical harmonics of one degree alike (Funk and Hecke's theorem; for Phong's lobe
//! Ramamoorthi and Hanrahan 2002), so the image is taken apart into harmonics and put together again from the scaled ones.

use super::EnvironmentImage;
use crate::math::{Vec3, vec3};
use rebond_lanes::{F32x16, Real};
use std::f64::consts::{PI, TAU};

/// Degrees that the lobe scales by less are left out.
const NEGLIGIBLE: f64 = 1e-5;

/// k_l, up to the last degree that counts.
fn factors(r: f64) -> Vec<f64> {
    let mut k = vec![1.0, (r + 1.0) / (r + 2.0)];
    while k[k.len() - 2..].iter().any(|k| k.abs() > NEGLIGIBLE) {
        let l = k.len() as f64;
        k.push(k[k.len() - 2] * (r - l + 2.0) / (r + l + 1.0));
    }
    k
}

/// A grid of rows of θ and columns of φ, at the centres of texels, with the waves cos mφ and sin mφ.
struct Waves {
    rows: usize,
    columns: usize,
    /// For each m and each sixteen columns.
    cos_sin: Vec<[F32x16; 2]>,
}

impl Waves {
    fn new(rows: usize, orders: usize) -> Self {
        let columns = 2 * rows;
        let wave = |m: usize, first: usize| {
            let angle = |x: usize| m as f64 * (x as f64 + 0.5) / columns as f64 * TAU;
            let lanes = |f: fn(f64) -> f64| {
                (0..16).fold(F32x16::zero(), |v, lane| v.with_lane(lane, f(angle(first + lane)) as f32))
            };
            [lanes(f64::cos), lanes(f64::sin)]
        };
        let cos_sin = (0..orders).flat_map(|m| (0..columns / 16).map(move |c| wave(m, 16 * c))).collect();
        Self { rows, columns, cos_sin }
    }

    fn theta(&self, row: usize) -> f64 {
        (row as f64 + 0.5) * PI / self.rows as f64
    }

    fn of_order(&self, m: usize) -> &[[F32x16; 2]] {
        let n = self.columns / 16;
        &self.cos_sin[m * n..(m + 1) * n]
    }
}

/// The normalised associated Legendre functions, by their recurrence in l: `P_l = a_l (cosθ P_{l−1} − P_{l−2} / a_{l−1})`.
struct Legendre {
    degrees: usize,
    /// a and the inverse of the one before, for each m and each l from m + 1.
    factors: Vec<[f64; 2]>,
}

impl Legendre {
    fn new(degrees: usize) -> Self {
        let a = |l: usize, m: usize| ((4 * l * l - 1) as f64 / (l * l - m * m) as f64).sqrt();
        let pair = |l: usize, m: usize| [a(l, m), if l > m + 1 { 1.0 / a(l - 1, m) } else { 0.0 }];
        let factors = (0..degrees).flat_map(|m| (m + 1..degrees).map(move |l| pair(l, m))).collect();
        Self { degrees, factors }
    }

    /// Calls `f` with l, m and the function of θ.
    fn each(&self, theta: f64, mut f: impl FnMut(usize, usize, f64)) {
        let (sin, cos) = theta.sin_cos();
        let mut diagonal = (1.0 / (4.0 * PI)).sqrt();
        let mut factors = self.factors.iter();
        for m in 0..self.degrees {
            if m > 0 {
                diagonal *= sin * ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            }
            let (mut before, mut this) = (0.0, diagonal);
            f(m, m, this);
            for (l, [a, inverse]) in (m + 1..self.degrees).zip(&mut factors) {
                (before, this) = (this, a * (cos * this - inverse * before));
                f(l, m, this);
            }
        }
    }
}

impl EnvironmentImage {
    /// The image blurred by Phong's lobe of exponent r ≥ 1, in texels of at most a tenth of the lobe's width. `None` if it is black.
    #[must_use]
    pub fn blurred(&self, exponent: f32) -> Option<Self> {
        let r = f64::from(exponent);
        let k = factors(r);
        let degrees = k.len();
        let legendre = Legendre::new(degrees);
        let place = |l: usize, m: usize| l * degrees + m;
        // Six rows to the shortest wave leave its scaled share exact to far less than what is left out.
        let source = Waves::new((6 * degrees).next_multiple_of(8), degrees);
        let mut harmonics = vec![[[0.0_f64; 2]; 3]; degrees * degrees];
        for row in 0..source.rows {
            let theta = source.theta(row);
            let radiance = self.row(theta, source.of_order(1));
            let waves: Vec<[[f64; 2]; 3]> = (0..degrees)
                .map(|m| {
                    let mut sums = [[F32x16::zero(); 2]; 3];
                    for (texels, waves) in radiance.iter().zip(source.of_order(m)) {
                        for (sum, texel) in sums.iter_mut().zip(texels) {
                            *sum = [texel.mul_add(waves[0], sum[0]), texel.mul_add(waves[1], sum[1])];
                        }
                    }
                    sums.map(|s| s.map(|x| (0..16).map(|lane| f64::from(x.lane(lane))).sum()))
                })
                .collect();
            let half = PI / source.rows as f64 / 2.0;
            let solid = ((theta - half).cos() - (theta + half).cos()) * TAU / source.columns as f64;
            legendre.each(theta, |l, m, p| {
                let weight = p * solid * k[l] * if m > 0 { 2.0 } else { 1.0 };
                for (sum, wave) in harmonics[place(l, m)].iter_mut().zip(&waves[m]) {
                    *sum = [sum[0] + weight * wave[0], sum[1] + weight * wave[1]];
                }
            });
        }
        let blurred = Waves::new(((10.0 * PI * (r + 1.0).sqrt()) as usize).max(128).next_multiple_of(8), degrees);
        let mut texels = Vec::with_capacity(blurred.rows * blurred.columns);
        for row in 0..blurred.rows {
            let mut orders = vec![[[0.0_f64; 2]; 3]; degrees];
            legendre.each(blurred.theta(row), |l, m, p| {
                for (sum, harmonic) in orders[m].iter_mut().zip(&harmonics[place(l, m)]) {
                    *sum = [sum[0] + p * harmonic[0], sum[1] + p * harmonic[1]];
                }
            });
            for sixteen in 0..blurred.columns / 16 {
                let mut sums = [F32x16::zero(); 3];
                for (m, order) in orders.iter().enumerate() {
                    let [cos, sin] = blurred.of_order(m)[sixteen];
                    for (sum, order) in sums.iter_mut().zip(order) {
                        *sum += cos * order[0] as f32 + sin * order[1] as f32;
                    }
                }
                // What was left out may take a little from where there is nothing.
                texels.extend((0..16).map(|lane| sums.map(|s| s.lane(lane).max(0.0))));
            }
        }
        let size = [blurred.columns as u32, blurred.rows as u32];
        Self::new(size, &texels, self.frame)
    }

    /// Radiance at a θ, sixteen columns at a time, which have these cosines and sines.
    fn row(&self, theta: f64, columns: &[[F32x16; 2]]) -> Vec<[F32x16; 3]> {
        let (sin, cos) = (theta.sin() as f32, theta.cos() as f32);
        let sixteen = |[cos_phi, sin_phi]: &[F32x16; 2]| {
            // φ is counted from the left edge of the image, behind.
            let local: Vec3<F32x16> = vec3(*sin_phi * -sin, F32x16::splat(cos), *cos_phi * sin);
            let (radiance, _) = self.eval(self.frame().to_world(local));
            [radiance.r, radiance.g, radiance.b]
        };
        columns.iter().map(sixteen).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNED: [[f32; 3]; 3] = [[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]];

    #[test]
    fn factors_are_integrals_of_legendre_polynomials() {
        // (r+1) ∫ tʳ P_l(t) dt over [0, 1].
        for r in [1.0, 2.5, 60.0] {
            let k = factors(r);
            let n = 200_000;
            let mut sums = vec![0.0; k.len().min(12)];
            for t in (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n)) {
                let (mut before, mut p) = (0.0, 1.0);
                for (l, sum) in sums.iter_mut().enumerate() {
                    *sum += (r + 1.0) * t.powf(r) * p / f64::from(n);
                    let l = l as f64;
                    (before, p) = (p, ((2.0 * l + 1.0) * t * p - l * before) / (l + 1.0));
                }
            }
            for (l, (k, sum)) in k.iter().zip(&sums).enumerate() {
                assert!((k - sum).abs() < 1e-6, "r {r}, degree {l}: {k} for {sum}");
            }
        }
    }

    /// Against the integral itself, by brute force.
    #[test]
    fn a_blur_is_a_convolution() {
        let texels: Vec<[f32; 3]> = (0..32 * 16)
            .map(|i| match (i % 32, i / 32) {
                (5..8, 3..6) => [30.0, 20.0, 10.0],
                (_, 0..8) => [0.2, 0.4, 1.0],
                _ => [0.3, 0.2, 0.1],
            })
            .collect();
        let sharp = EnvironmentImage::new([32, 16], &texels, TURNED).expect("light");
        for r in [1.0_f32, 20.0, 150.0] {
            let blurred = sharp.blurred(r).expect("light");
            for d in [[0.2, 0.97, 0.1], [0.3, -0.8, 0.52], [-0.7, 0.55, -0.4], [0.1, 0.7, 0.7], [0.9, 0.3, 0.1]] {
                let d = Vec3::<f32>::splat(d).normalized();
                let n = 1200;
                let mut exact = [0.0_f64; 3];
                for k in 0..n * n / 2 {
                    let z = 1.0 - (f64::from(k / n) + 0.5) * 4.0 / f64::from(n);
                    let (r_xy, phi) = ((1.0 - z * z).sqrt(), (f64::from(k % n) + 0.5) / f64::from(n) * TAU);
                    let w = Vec3::splat([r_xy * phi.cos(), z, r_xy * phi.sin()].map(|x| x as f32));
                    let lobe = f64::from(w.dot(d)).max(0.0).powf(f64::from(r)) * f64::from(r + 1.0) / TAU;
                    let (light, _) = sharp.eval(w);
                    for (sum, light) in exact.iter_mut().zip(light.lane(0)) {
                        *sum += f64::from(light) * lobe * 2.0 * TAU / f64::from(n * n / 2);
                    }
                }
                let (found, _) = blurred.eval(d);
                for (found, exact) in found.lane(0).into_iter().zip(exact) {
                    assert!((f64::from(found) / exact - 1.0).abs() < 5e-3, "r {r}: {found} for {exact}");
                }
            }
        }
    }
}
