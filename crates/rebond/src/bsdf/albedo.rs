//! How much a GGX surface reflects: tables of its albedo, from which layered and compensated models take what is left for
//! them.
//!
//! With Schlick's Fresnel term (1994) `F = F0 + (1 − F0)(1 − h·ω)⁵` the albedo of one bounce off isotropic facets is
//!
//! ```text
//! E(μ) = F0 r0(μ, α) + (1 − F0) r1(μ, α)
//! r0 = ∫ D G₂ / (4 cosθi cosθo) cosθi dωi,    r1 the same with (1 − h·ω)⁵ under the integral
//! Ē = 2 ∫ E(μ) μ dμ
//! ```
//!
//! (the split of Karis 2013). Both integrals are computed once, when a model first needs them, over √μ and √α, and
//! interpolated linearly; the averages are those of the interpolants, so that what a model hands on adds up.

use super::ggx::Ggx;
use super::reflect_about;
use crate::math::{Vec3, vec3};
use rebond_lanes::{Index, Real, Record};
use std::sync::LazyLock;

/// Values along √μ, and along √α.
const N: usize = 40;
/// Midpoints of the two random numbers of a visible normal.
const QUADRATURE: [usize; 2] = [24, 80];

/// Cells of four corners, so that one fetch serves a whole interpolation.
struct Tables {
    r0: Vec<Record>,
    r1: Vec<Record>,
    /// Averages of r0 at both ends of a cell of √α, and of r1.
    averages: Vec<Record>,
    /// Albedo of the sheen at both ends of a cell of μ.
    sheen: Vec<Record>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);

fn node(i: usize) -> f32 {
    let x = i as f32 / (N - 1) as f32;
    x * x
}

/// (1 − c)⁵.
#[inline(always)]
pub fn schlick<F: Real>(cos: F) -> F {
    let x = (F::one() - cos).relu();
    let x2 = x * x;
    x2 * x2 * x
}

/// r0 and r1 at one point: the mean weight of visible normals.
fn integrals(mu: f32, alpha: f32) -> [f32; 2] {
    if alpha == 0.0 {
        return [1.0, schlick(mu)];
    }
    let mu = mu.max(1e-4);
    let ggx = Ggx { ax: alpha, ay: alpha };
    let a = vec3((1.0 - mu * mu).sqrt(), 0.0, mu);
    let la = ggx.lambda(a);
    let [columns, rows] = QUADRATURE;
    let (mut r0, mut r1) = (0.0_f64, 0.0_f64);
    for i in 0..columns {
        for j in 0..rows {
            // The other half of the azimuths mirrors this one.
            let u = [(i as f32 + 0.5) / (2 * columns) as f32, (j as f32 + 0.5) / rows as f32];
            let h = ggx.sample_visible(a, u);
            let b = reflect_about(a, h);
            if b.z > 0.0 {
                let weight = (la + 1.0) / (la + ggx.lambda(b) + 1.0);
                r0 += f64::from(weight);
                r1 += f64::from(weight * schlick(a.dot(h)));
            }
        }
    }
    let n = (columns * rows) as f64;
    [(r0 / n) as f32, (r1 / n) as f32]
}

/// ∫ (1 − h·ω)⁵ cosθi dωi.
fn sheen_integral(mu: f32) -> f32 {
    let a = vec3((1.0 - mu * mu).sqrt(), 0.0, mu);
    let (rows, columns) = (128, 64);
    let mut sum = 0.0_f64;
    for i in 0..rows {
        // Even steps of cos² are even steps of cosθ dω.
        let z = ((i as f32 + 0.5) / rows as f32).sqrt();
        let r = (1.0 - z * z).sqrt();
        for j in 0..columns {
            let phi = (j as f32 + 0.5) / columns as f32 * std::f32::consts::PI;
            let b = vec3(r * phi.cos(), r * phi.sin(), z);
            sum += f64::from(schlick(a.dot((a + b).normalized())));
        }
    }
    (sum / f64::from(rows * columns) * std::f64::consts::PI) as f32
}

impl Tables {
    fn new() -> Self {
        let mut nodes = vec![[[0.0; 2]; N]; N];
        for (j, row) in nodes.iter_mut().enumerate() {
            for (i, value) in row.iter_mut().enumerate() {
                *value = integrals(node(i), node(j));
            }
        }
        let cells = |k: usize| {
            let mut cells = Vec::with_capacity((N - 1) * (N - 1));
            for pair in nodes.windows(2) {
                for i in 0..N - 1 {
                    cells.push(Record([pair[0][i][k], pair[0][i + 1][k], pair[1][i][k], pair[1][i + 1][k]]));
                }
            }
            cells
        };
        // 2∫ E μ dμ with μ = x², E linear in x: 4∫ E x³ dx, cell by cell.
        let average = |j: usize, k: usize| {
            let step = 1.0 / (N - 1) as f64;
            let mut sum = 0.0;
            for i in 0..N - 1 {
                let (x0, x1) = (i as f64 * step, (i + 1) as f64 * step);
                let (e0, e1) = (f64::from(nodes[j][i][k]), f64::from(nodes[j][i + 1][k]));
                let slope = (e1 - e0) / step;
                let power = |n: i32| x1.powi(n) - x0.powi(n);
                sum += (e0 - slope * x0) * power(4) + slope * 4.0 / 5.0 * power(5);
            }
            sum as f32
        };
        let averages =
            (0..N - 1).map(|j| Record([average(j, 0), average(j + 1, 0), average(j, 1), average(j + 1, 1)])).collect();
        let sheen: Vec<f32> = (0..N).map(|i| sheen_integral(i as f32 / (N - 1) as f32)).collect();
        let sheen = sheen.windows(2).map(|w| Record([w[0], w[1], 0.0, 0.0])).collect();
        Self { r0: cells(0), r1: cells(1), averages, sheen }
    }
}

/// The cell of a coordinate in [0, 1], and the place within it.
#[inline(always)]
fn cell<F: Real>(x: F) -> (F::Index, F) {
    let x = x.clamp(0.0, 1.0) * (N - 1) as f32;
    let i = x.floor().min(F::splat((N - 2) as f32));
    (i.to_index(), x - i)
}

/// r0 and r1 for one roughness.
#[derive(Clone, Copy, Debug)]
pub struct Reflected<F: Real> {
    /// The integral without Fresnel's term.
    pub r0: F,
    /// The one with (1 − h·ω)⁵.
    pub r1: F,
}

impl<F: Real> Reflected<F> {
    /// At the cosine μ ≥ 0.
    #[inline(always)]
    pub fn at(mu: F, alpha: F) -> Self {
        let ((i, x), (j, y)) = (cell(mu.safe_sqrt()), cell(alpha.safe_sqrt()));
        let index = j * F::Index::splat((N - 1) as u32) + i;
        let one = |table: &[Record]| {
            let [a, b, c, d] = F::record(table, index);
            let (low, high) = (a + (b - a) * x, c + (d - c) * x);
            low + (high - low) * y
        };
        Self { r0: one(&TABLES.r0), r1: one(&TABLES.r1) }
    }

    /// The averages over directions of cosine law.
    #[inline(always)]
    pub fn average(alpha: F) -> Self {
        let (j, y) = cell(alpha.safe_sqrt());
        let [a, b, c, d] = F::record(&TABLES.averages, j);
        Self { r0: a + (b - a) * y, r1: c + (d - c) * y }
    }

    /// E for a reflectance F0 at normal incidence.
    #[inline(always)]
    pub fn with(self, f0: F) -> F {
        f0 * self.r0 + (F::one() - f0) * self.r1
    }
}

/// ∫ (1 − h·ω)⁵ cosθi dωi for ω at the cosine μ.
#[inline(always)]
pub fn sheen<F: Real>(mu: F) -> F {
    let (i, x) = cell(mu);
    let [a, b, ..] = F::record(&TABLES.sheen, i);
    a + (b - a) * x
}

/// Facets of roughness α along both tangents.
#[inline(always)]
pub fn isotropic<F: Real>(alpha: F) -> Ggx<F> {
    Ggx { ax: alpha, ay: alpha }
}

/// `D G₂ / (4 cosθi cosθo)` and the density of reflecting about a visible normal, for a and b above.
#[inline(always)]
pub fn reflection<F: Real>(ggx: Ggx<F>, a: Vec3<F>, b: Vec3<F>, h: Vec3<F>) -> (F, F) {
    let quarter = ggx.d(h) / (a.z * 4.0);
    let (la, lb) = (ggx.lambda(a), ggx.lambda(b));
    (quarter / (b.z * (la + lb + 1.0)), quarter / (la + 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between the nodes, against the integral itself by many more points.
    #[test]
    fn interpolation_is_within_its_bound() {
        for alpha in [0.03_f32, 0.1, 0.33, 0.6, 0.97] {
            for mu in [0.02_f32, 0.07, 0.2, 0.45, 0.81, 0.99] {
                let a = vec3((1.0 - mu * mu).sqrt(), 0.0, mu);
                let ggx = isotropic(alpha);
                let n = 300;
                let mut exact = [0.0_f64; 2];
                for k in 0..n * n {
                    let u = [((k % n) as f32 + 0.5) / n as f32, ((k / n) as f32 + 0.5) / n as f32];
                    let h = ggx.sample_visible(a, u);
                    let b = reflect_about(a, h);
                    if b.z > 0.0 {
                        let weight = (ggx.lambda(a) + 1.0) / (ggx.lambda(a) + ggx.lambda(b) + 1.0);
                        exact[0] += f64::from(weight) / f64::from(n * n);
                        exact[1] += f64::from(weight * schlick(a.dot(h))) / f64::from(n * n);
                    }
                }
                let found = Reflected::at(mu, alpha);
                for (found, exact) in [(found.r0, exact[0]), (found.r1, exact[1])] {
                    assert!((f64::from(found) - exact).abs() < 3e-3, "μ {mu}, α {alpha}: {found} for {exact}");
                }
            }
        }
    }

    #[test]
    fn limits() {
        // A mirror reflects all, or Schlick's term, whose average is 1/21.
        for mu in [0.0_f32, 0.25, 1.0] {
            let mirror = Reflected::at(mu, 0.0);
            assert!((mirror.r0 - 1.0).abs() < 1e-6 && (mirror.r1 - schlick(mu)).abs() < 2e-3);
        }
        let average = Reflected::average(0.0_f32);
        assert!((average.r0 - 1.0).abs() < 1e-6 && (average.r1 - 1.0 / 21.0).abs() < 1e-3, "{average:?}");
        // From straight above, h·ω = √((1 + cosθi)/2): 2π ∫ (1 − √((1+c)/2))⁵ c dc, with s = √((1+c)/2) a polynomial.
        let n = 100_000;
        let exact: f64 = (0..n)
            .map(|i| (f64::from(i) + 0.5) / f64::from(n))
            .map(|c| (1.0 - ((1.0 + c) / 2.0).sqrt()).powi(5) * c * std::f64::consts::TAU / f64::from(n))
            .sum();
        assert!((f64::from(sheen(1.0_f32)) - exact).abs() < 1e-5);
        assert!(sheen(0.0_f32) < 1.0 && sheen(0.0_f32) > sheen(0.5));
    }
}
