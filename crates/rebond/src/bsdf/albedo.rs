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
//! (the split of Karis 2013). What tells a rough surface from a smooth one is `1 − r0` and `r1 − r0 (1 − μ)⁵`. For small α
//! both hang on μ/α, so they stand over the roots of `s = μ (1 + α) / (μ + α)` and of α, and are interpolated linearly; the
//! averages are those of the interpolants, so that what a model hands on adds up. All are computed once, when a model first
//! needs them. Anisotropic facets have a coarser table of what tells them from isotropic ones, and are overrated by its error.

use super::ggx::Ggx;
use super::reflect_about;
use crate::math::{Vec3, vec3};
use rebond_lanes::{F32x16, Index, Mask, Real, Record};
use std::sync::LazyLock;

/// Values along √s, and along √α.
const COLUMNS: usize = 64;
const ROWS: usize = 56;
/// Averages along √α.
const AVERAGES: usize = 256;
/// Averages of anisotropic facets along the ratio of the roughnesses, and along √α.
const ANISOTROPIC_AVERAGES: [usize; 2] = [8, 40];
/// Values along s, the azimuth, the ratio of the roughnesses and √α of what anisotropy changes.
const STRETCHES: [usize; 4] = [24, 6, 5, 9];
/// The least ratio.
const NARROWEST: f32 = 0.1;
/// By how much the albedo of the narrowest facets is overrated, which is the error of its tables.
const MARGIN: f32 = 0.014;
/// Values of the sheen along μ.
const SHEEN: usize = 40;
/// Roughness that stands for none: what hangs on μ/α only no longer changes.
const LEAST: f32 = 1e-4;

/// Cells of four corners, so that one fetch serves a whole interpolation.
struct Tables {
    /// 1 − r0.
    lost: Vec<Record>,
    /// r1 − r0 (1 − μ)⁵.
    rest: Vec<Record>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);
static AVERAGE: LazyLock<Vec<Record>> = LazyLock::new(averages);
static ANISOTROPIC: LazyLock<[Vec<Record>; 2]> = LazyLock::new(anisotropic_averages);
static STRETCH: LazyLock<Vec<Record>> = LazyLock::new(stretches);
static SHEENS: LazyLock<Vec<Record>> = LazyLock::new(sheens);

/// Place i of n in [0, 1].
fn place(i: usize, n: usize) -> f32 {
    i as f32 / (n - 1) as f32
}

/// α of a row.
fn roughness(j: usize, rows: usize) -> f32 {
    place(j, rows).powi(2).max(LEAST)
}

/// (1 − c)⁵.
#[inline(always)]
pub fn schlick<F: Real>(cos: F) -> F {
    let x = (F::one() - cos).relu();
    let x2 = x * x;
    x2 * x2 * x
}

/// The sixteen lanes added up.
fn sum(x: F32x16) -> f64 {
    (0..16).map(|lane| f64::from(x.lane(lane))).sum()
}

/// i + 0, i + 1, … i + 15.
fn count_from(i: usize) -> F32x16 {
    (0..16).fold(F32x16::zero(), |v, lane| v.with_lane(lane, (i + lane) as f32))
}

/// 1 − r0 and r1 − r0 (1 − μ)⁵ at one point: means over visible normals, by midpoints over `16 · wide` × `high` random numbers.
fn integrals(mu: f32, ggx: Ggx<f32>, phi: f32, wide: usize, high: usize) -> [f32; 2] {
    let ggx = Ggx { ax: F32x16::splat(ggx.ax), ay: F32x16::splat(ggx.ay) };
    let r = (1.0 - mu * mu).sqrt();
    let a = Vec3::<F32x16>::splat([r * phi.cos(), r * phi.sin(), mu]);
    let (la, straight) = (ggx.lambda(a), schlick(a.z));
    let (mut lost, mut rest) = (F32x16::zero(), F32x16::zero());
    for j in 0..high {
        for i in 0..wide {
            // Closer together towards the steepest normals, of which few reflect much.
            let x = (j as f32 + 0.5) / high as f32;
            let u = [(count_from(16 * i) + 0.5) / (16 * wide) as f32, F32x16::splat(1.0 - x * x)];
            let h = ggx.sample_visible(a, u);
            let b = reflect_about(a, h);
            let lb = ggx.lambda(b);
            let gone = F32x16::select(b.z.gt(F32x16::zero()), lb / (la + lb + 1.0), F32x16::one());
            lost += gone * (2.0 * x);
            rest += (F32x16::one() - gone) * (schlick(a.dot(h)) - straight) * (2.0 * x);
        }
    }
    [lost, rest].map(|x| (sum(x) / (16 * wide * high) as f64) as f32)
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

/// The cells between values of `rows` rows.
fn cells(values: &[f32], columns: usize) -> Vec<Record> {
    let rows: Vec<&[f32]> = values.chunks(columns).collect();
    let cell = |pair: &[&[f32]], i: usize| Record([pair[0][i], pair[0][i + 1], pair[1][i], pair[1][i + 1]]);
    rows.windows(2).flat_map(|pair| (0..columns - 1).map(move |i| cell(pair, i))).collect()
}

impl Tables {
    fn new() -> Self {
        let node = |k: usize| {
            let (s, alpha) = (place(k % COLUMNS, COLUMNS).powi(2), roughness(k / COLUMNS, ROWS));
            // At μ = 0 itself Λ is infinite.
            let mu = (s * alpha / (alpha + (1.0 - s))).max(1e-5 * alpha);
            integrals(mu, Ggx { ax: alpha, ay: alpha }, 0.0, 2, 40)
        };
        let nodes: Vec<[f32; 2]> = (0..COLUMNS * ROWS).map(node).collect();
        let [lost, rest] = [0, 1].map(|k| cells(&nodes.iter().map(|n| n[k]).collect::<Vec<_>>(), COLUMNS));
        Self { lost, rest }
    }
}

/// A direction above anisotropic facets in the coordinates of their tables.
struct Azimuth<F: Real> {
    /// The larger roughness.
    alpha: F,
    /// The smaller over it.
    ratio: F,
    /// The roughness along the direction.
    along: F,
    /// That of isotropic facets that reflect much alike: with the slopes along a direction that grazes, which is all that
    /// masking knows of, and with those of all azimuths from above.
    seen: F,
}

impl<F: Real> Azimuth<F> {
    #[inline(always)]
    fn new(ggx: Ggx<F>, w: Vec3<F>) -> Self {
        let (x2, y2) = (ggx.ax * ggx.ax, ggx.ay * ggx.ay);
        let (mean, apart) = ((x2 + y2) * 0.5, (x2 - y2) * 0.5);
        let (wx2, wy2) = (w.x * w.x, w.y * w.y);
        // From straight above there is no azimuth.
        let cos_2phi = F::select((wx2 + wy2).gt(F::zero()), (wx2 - wy2) / (wx2 + wy2), F::zero());
        let (alpha, least) = (ggx.ax.max(ggx.ay), ggx.ax.min(ggx.ay));
        Self {
            alpha,
            ratio: least / alpha,
            along: (mean + apart * cos_2phi).safe_sqrt().max(least),
            seen: (mean + apart * (wx2 - wy2)).safe_sqrt(),
        }
    }
}

/// By how much 1 − r0 and r1 of anisotropic facets differ from those of isotropic ones of [`Azimuth::seen`], at both ends of
/// a cell of s.
fn stretches() -> Vec<Record> {
    let [columns, azimuths, ratios, rows] = STRETCHES;
    let node = |k: usize| {
        let alpha = roughness(k / (columns * azimuths * ratios), rows);
        let ratio = ratio(place(k / (columns * azimuths) % ratios, ratios));
        let v = place(k / columns % azimuths, azimuths).powi(2);
        if ratio > 0.999 {
            return [0.0; 2];
        }
        let along = alpha * (ratio + v * (1.0 - ratio));
        let cos2 = (((along / alpha).powi(2) - ratio * ratio) / (1.0 - ratio * ratio)).clamp(0.0, 1.0);
        let s = place(k % columns, columns);
        let mu = (s * along / (along + (1.0 - s))).max(1e-5 * along);
        let ggx = Ggx { ax: alpha, ay: alpha * ratio };
        let phi = cos2.sqrt().acos();
        let r = (1.0 - mu * mu).sqrt();
        let seen = Azimuth::new(ggx, vec3(r * phi.cos(), r * phi.sin(), mu)).seen;
        let [lost, rest] = integrals(mu, ggx, phi, 1, 40);
        let (straight, like) = (schlick(mu), Reflected::at(mu, seen));
        [lost - like.lost, rest + (1.0 - lost) * straight - like.r1]
    };
    let nodes: Vec<[f32; 2]> = (0..columns * azimuths * ratios * rows).map(node).collect();
    let pairs = nodes.chunks(columns).flat_map(|row| row.windows(2));
    pairs.map(|p| Record([p[0][0], p[1][0], p[0][1], p[1][1]])).collect()
}

/// 2 ∫ E μ dμ of the interpolants, at midpoints of √μ; lanes weigh the same.
fn average(e: impl Fn(F32x16) -> Reflected<F32x16>, steps: usize, mu: impl Fn(usize) -> F32x16) -> [f64; 2] {
    let (mut lost, mut r1, mut all) = (0.0, 0.0, 0.0);
    for k in 0..steps {
        let x = mu(k);
        let weight = x * x * x;
        let e = e(x * x);
        (lost, r1, all) = (lost + sum(e.lost * weight), r1 + sum(e.r1 * weight), all + sum(weight));
    }
    [lost / all, r1 / all]
}

/// What is lost over α, which varies little, and r1, at both ends of a cell of √α.
fn averages() -> Vec<Record> {
    let one = |j: usize| {
        let alpha = roughness(j, AVERAGES);
        let [lost, r1] =
            average(|mu| Reflected::at(mu, F32x16::splat(alpha)), 32, |k| (count_from(16 * k) + 0.5) / 512.0);
        [(lost / f64::from(alpha)) as f32, r1 as f32]
    };
    let all: Vec<[f32; 2]> = (0..AVERAGES).map(one).collect();
    all.windows(2).map(|w| Record([w[0][0], w[1][0], w[0][1], w[1][1]])).collect()
}

/// The ratio of the roughnesses at a place in [0, 1].
fn ratio(place: f32) -> f32 {
    (NARROWEST.sqrt() + place * (1.0 - NARROWEST.sqrt())).powi(2)
}

/// The place of a ratio.
#[inline(always)]
fn place_of_ratio<F: Real>(ratio: F) -> F {
    (ratio.safe_sqrt() - NARROWEST.sqrt()) * (1.0 / (1.0 - NARROWEST.sqrt()))
}

/// The same for the larger α, with what is lost over it.
fn anisotropic_averages() -> [Vec<Record>; 2] {
    let [ratios, rows] = ANISOTROPIC_AVERAGES;
    // Midpoints of a quarter of the azimuths, for two values of μ at once.
    let lanes = |f: &dyn Fn(usize) -> f32| (0..16).fold(F32x16::zero(), |v, lane| v.with_lane(lane, f(lane)));
    let phi = |lane: usize| ((lane % 8) as f32 + 0.5) * std::f32::consts::FRAC_PI_2 / 8.0;
    let (cos, sin) = (lanes(&|lane| phi(lane).cos()), lanes(&|lane| phi(lane).sin()));
    let one = |k: usize| {
        let (alpha, ratio) = (roughness(k / ratios, rows), ratio(place(k % ratios, ratios)));
        let ggx = Ggx { ax: F32x16::splat(alpha), ay: F32x16::splat(alpha * ratio) };
        let around = |mu: F32x16| {
            let r = (F32x16::one() - mu * mu).safe_sqrt();
            Reflected::around(ggx, vec3(r * cos, r * sin, mu))
        };
        let [lost, r1] = average(around, 64, |k| lanes(&|lane| (2 * k + lane / 8) as f32 + 0.5) / 128.0);
        [(lost / f64::from(alpha)) as f32, r1 as f32]
    };
    let all: Vec<[f32; 2]> = (0..ratios * rows).map(one).collect();
    [0, 1].map(|k| cells(&all.iter().map(|n| n[k]).collect::<Vec<_>>(), ratios))
}

fn sheens() -> Vec<Record> {
    let values: Vec<f32> = (0..SHEEN).map(|i| sheen_integral(place(i, SHEEN))).collect();
    values.windows(2).map(|w| Record([w[0], w[1], 0.0, 0.0])).collect()
}

/// The cell of a coordinate in [0, 1] among `n` values, and the place within it.
#[inline(always)]
fn cell<F: Real>(x: F, n: usize) -> (F::Index, F) {
    let x = x.clamp(0.0, 1.0) * (n - 1) as f32;
    let i = x.floor().min(F::splat((n - 2) as f32));
    (i.to_index(), x - i)
}

/// Between the four corners of a cell.
#[inline(always)]
fn between<F: Real>(cells: &[Record], index: F::Index, x: F, y: F) -> F {
    let [a, b, c, d] = F::record(cells, index);
    let (low, high) = (a + (b - a) * x, c + (d - c) * x);
    low + (high - low) * y
}

/// r0 and r1 for one roughness.
#[derive(Clone, Copy, Debug)]
pub struct Reflected<F: Real> {
    /// 1 − r0: what white facets do not reflect. Has its digits where that is little.
    pub lost: F,
    /// The integral with (1 − h·ω)⁵.
    pub r1: F,
}

impl<F: Real> Reflected<F> {
    /// At the cosine μ ≥ 0, for α > 0.
    #[inline(always)]
    pub fn at(mu: F, alpha: F) -> Self {
        let s = mu * (alpha + 1.0) / (mu + alpha);
        let ((i, x), (j, y)) = (cell(s.safe_sqrt(), COLUMNS), cell(alpha.safe_sqrt(), ROWS));
        let index = j * F::Index::splat((COLUMNS - 1) as u32) + i;
        let lost = between(&TABLES.lost, index, x, y);
        Self { lost, r1: between(&TABLES.rest, index, x, y) + (F::one() - lost) * schlick(mu) }
    }

    /// The averages over directions of cosine law.
    #[inline(always)]
    pub fn average(alpha: F) -> Self {
        let (j, y) = cell(alpha.safe_sqrt(), AVERAGES);
        let [a, b, c, d] = F::record(&AVERAGE, j);
        Self { lost: (a + (b - a) * y) * alpha, r1: c + (d - c) * y }
    }

    /// For a direction above facets that may be anisotropic. Of those it is thought to be a little more than it is, for nothing
    /// to be given away twice.
    #[inline(always)]
    pub fn around(ggx: Ggx<F>, w: Vec3<F>) -> Self {
        let mu = w.z.relu();
        let at = Azimuth::new(ggx, w);
        let like = Self::at(mu, at.seen);
        let isotropic = ggx.ax.eq(ggx.ay);
        if isotropic.all() {
            return like;
        }
        let [columns, azimuths, ratios, rows] = STRETCHES;
        let least = at.ratio * at.alpha;
        let apart = at.alpha - least;
        let v = F::select(apart.gt(F::zero()), (at.along - least) / apart, F::zero()).safe_sqrt();
        let ((i, x), (j, y)) = (cell(mu * (at.along + 1.0) / (mu + at.along), columns), cell(v, azimuths));
        let ((k, z), (l, t)) = (cell(place_of_ratio(at.ratio), ratios), cell(at.alpha.safe_sqrt(), rows));
        let n = |n: usize| F::Index::splat(n as u32);
        let first = ((l * n(ratios) + k) * n(azimuths) + j) * n(columns - 1) + i;
        let mut sums = [F::zero(); 2];
        for corner in 0..8 {
            let [up, beside, along] = [corner >> 2, corner >> 1 & 1, corner & 1];
            let weight = |one: usize, place: F| if one == 1 { place } else { F::one() - place };
            let weight = weight(up, t) * weight(beside, z) * weight(along, y);
            let [a, b, c, d] =
                F::record(&STRETCH, first + n(((up * ratios + beside) * azimuths + along) * (columns - 1)));
            sums = [sums[0] + weight * (a + (b - a) * x), sums[1] + weight * (c + (d - c) * x)];
        }
        let more = (F::one() - at.ratio) * MARGIN;
        let lost = F::select(isotropic, like.lost, (like.lost + sums[0] - more).relu());
        Self { lost, r1: F::select(isotropic, like.r1, (like.r1 + sums[1] + more).min(F::one() - lost)) }
    }

    /// The averages of [`Reflected::around`].
    #[inline(always)]
    pub fn average_around(ggx: Ggx<F>) -> Self {
        let (alpha, isotropic) = (ggx.ax.max(ggx.ay), ggx.ax.eq(ggx.ay));
        let like = Self::average(alpha);
        if isotropic.all() {
            return like;
        }
        let [ratios, rows] = ANISOTROPIC_AVERAGES;
        let ratio = ggx.ax.min(ggx.ay) / alpha;
        let ((i, x), (j, y)) = (cell(place_of_ratio(ratio), ratios), cell(alpha.safe_sqrt(), rows));
        let index = j * F::Index::splat((ratios - 1) as u32) + i;
        let [lost, r1] = &*ANISOTROPIC;
        let (lost, r1) = (between(lost, index, x, y) * alpha, between(r1, index, x, y));
        Self { lost: F::select(isotropic, like.lost, lost), r1: F::select(isotropic, like.r1, r1) }
    }

    /// E for a reflectance F0 at normal incidence.
    #[inline(always)]
    pub fn with(self, f0: F) -> F {
        f0 * (F::one() - self.lost) + (F::one() - f0) * self.r1
    }
}

/// ∫ (1 − h·ω)⁵ cosθi dωi for ω at the cosine μ.
#[inline(always)]
pub fn sheen<F: Real>(mu: F) -> F {
    let (i, x) = cell(mu, SHEEN);
    let [a, b, ..] = F::record(&SHEENS, i);
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
    use crate::bsdf::SMOOTH;

    /// Between the nodes, against the integral itself by many more points.
    #[test]
    fn interpolation_is_within_its_bound() {
        for alpha in [SMOOTH, 0.0017, 0.004, 0.012, 0.03, 0.1, 0.33, 0.6, 0.97] {
            for theta in [8.0_f32, 36.0, 63.0, 78.0, 86.0, 88.8, 89.5, 89.9, 89.97] {
                let mu = theta.to_radians().cos();
                let [lost, rest] = integrals(mu, isotropic(alpha), 0.0, 8, 256);
                let found = Reflected::at(mu, alpha);
                let exact = rest + (1.0 - lost) * schlick(mu);
                for (found, exact) in [(found.lost, lost), (found.r1, exact)] {
                    assert!((found - exact).abs() < 1.5e-3, "{theta}°, α {alpha}: {found} for {exact}");
                }
            }
        }
    }

    #[test]
    fn averages_are_those_of_the_interpolants() {
        let n = 200_000;
        let mu = |i: u32| ((i as f32 + 0.5) / n as f32).powi(2);
        for alpha in [SMOOTH, 0.0013, 0.0082, 0.05, 0.27, 0.8, 1.0_f32] {
            let [mut lost, mut r1] = [0.0_f64; 2];
            for mu in (0..n).map(mu) {
                let (e, weight) = (Reflected::at(mu, alpha), f64::from(mu).powf(1.5) * 4.0 / f64::from(n));
                (lost, r1) = (lost + f64::from(e.lost) * weight, r1 + f64::from(e.r1) * weight);
            }
            let found = Reflected::average(alpha);
            assert!((f64::from(found.lost) / lost - 1.0).abs() < 3e-3, "α {alpha}: {} for {lost}", found.lost);
            assert!((f64::from(found.r1) - r1).abs() < 1e-4, "α {alpha}: {} for {r1}", found.r1);
            // One way to be anisotropic is hardly to be.
            let around = Reflected::average_around(Ggx { ax: alpha * 0.9999, ay: alpha });
            assert!(
                (around.lost - found.lost).abs() < 1e-3 && (around.r1 - found.r1).abs() < 1e-3,
                "α {alpha}: {around:?}"
            );
        }
    }

    #[test]
    fn anisotropic_facets_are_never_underrated() {
        for (big, ratio) in
            [(1.0, 0.1), (1.0, 0.155), (1.0, 0.6), (0.7, 0.17), (0.5, 0.1), (0.3, 0.3), (0.2, 0.15), (0.03, 0.1)]
        {
            for theta in [0.0_f32, 20.0, 40.0, 60.0, 75.0, 85.0, 88.0, 89.0, 89.9] {
                for phi in [0.0_f32, 10.0, 20.0, 33.0, 45.0, 60.0, 70.0, 80.0, 85.0, 90.0] {
                    let (ggx, (theta, phi)) =
                        (Ggx { ax: big, ay: big * ratio }, (theta.to_radians(), phi.to_radians()));
                    let w = vec3(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                    let [lost, rest] = integrals(w.z, ggx, phi, 8, 128);
                    let exact = Reflected { lost, r1: rest + (1.0 - lost) * schlick(w.z) };
                    for f0 in [0.04, 0.3, 1.0] {
                        let more = Reflected::around(ggx, w).with(f0) - exact.with(f0);
                        assert!(more > -5e-4 && more < 0.035, "α {big}, ratio {ratio}, F0 {f0}: {more} at {w:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn limits() {
        // A mirror reflects all, or Schlick's term, whose average is 1/21.
        for mu in [0.05_f32, 0.25, 1.0] {
            let mirror = Reflected::at(mu, LEAST);
            assert!(mirror.lost.abs() < 1e-3 && (mirror.r1 - schlick(mu)).abs() < 1e-3, "{mirror:?} at {mu}");
        }
        let average = Reflected::average(LEAST);
        assert!(average.lost < 1e-3 && (average.r1 - 1.0 / 21.0).abs() < 1e-3, "{average:?}");
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
