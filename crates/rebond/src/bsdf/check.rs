//! Whether a BSDF is what it should be: positive, reciprocal, no source of energy, and sampled as its density says.
//!
//! ```text
//! f ≥ 0                                        positivity
//! f(ωi, ωo) / ηo² = f(ωo, ωi) / ηi²            reciprocity; η the index on the side of the direction (Veach 1997, §5.2)
//! ∫ f |cosθo| dωo ≤ 1 for every ωi             energy: no more light leaves than arrives
//! ∫ f |cosθi| dωi ≤ 1 for every ωo             the same read backwards, which differs only where f is not reciprocal
//! ```
//!
//! Energy is judged by a one-sided test of the mean of importance-sampled weights, samplers by Pearson's χ² over cells of
//! θ × φ that follow the lobe. Each is one test among many, so its level is that of all together after Šidák (1967).

use super::measured::Tables;
use super::{Bsdf, BsdfSample, TransportMode};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::{Sampler, SamplerSettings, Stream, warp};
use rebond_lanes::scalar::Index1;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Chance that a sound BSDF fails one of its tests, all of one property taken together.
pub const SIGNIFICANCE: f64 = 0.01;

/// The level of each of `tests` tests of which together a share of [`SIGNIFICANCE`] may fail by chance.
pub fn sidak(tests: usize) -> f64 {
    // 1 − (1 − α)^(1/n) without the digits that subtraction loses.
    -((-SIGNIFICANCE).ln_1p() / tests.max(1) as f64).exp_m1()
}

/// What scatters: BSDFs in shares that add up to 1, all with the same frame. Most materials are one BSDF; a mix has several.
#[derive(Clone, Debug)]
pub struct Material {
    parts: Vec<(f32, Bsdf<'static, f32>)>,
    tables: Arc<Tables>,
}

/// What a material is meant to satisfy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Claims {
    /// f(ωi, ωo) = f(ωo, ωi), but for η².
    pub reciprocity: bool,
    /// No more light leaves than arrives.
    pub energy: bool,
}

/// A direction by its angles from the normal and from the tangent, in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// From the normal; above 90 within the surface.
    pub theta: f64,
    /// From the tangent, in [0, 360).
    pub phi: f64,
}

impl Angles {
    /// Of a unit vector in the local frame.
    pub fn of(w: Vec3<f32>) -> Self {
        let [x, y, z] = w.array().map(f64::from);
        Self { theta: x.hypot(y).atan2(z).to_degrees(), phi: y.atan2(x).rem_euclid(TAU).to_degrees() }
    }

    /// The unit vector.
    pub fn direction(self) -> Vec3<f32> {
        let ((st, ct), (sp, cp)) = (self.theta.to_radians().sin_cos(), self.phi.to_radians().sin_cos());
        vec3((st * cp) as f32, (st * sp) as f32, ct as f32)
    }
}

/// Values of f over many pairs.
#[derive(Clone, Copy, Debug)]
pub struct Positivity {
    /// How many values were looked at.
    pub values: u64,
    /// The smallest.
    pub smallest: f32,
    /// How many were negative or not finite.
    pub bad: u64,
}

/// The least reciprocal pair.
#[derive(Clone, Copy, Debug)]
pub struct Reciprocity {
    /// How many pairs were looked at.
    pub pairs: u64,
    /// |f − f'| / (max(f, f') + 0.05): relative, but for values too small to keep their digits.
    pub asymmetry: f64,
    /// One direction of the least reciprocal pair.
    pub from: Angles,
    /// The other.
    pub to: Angles,
    /// f with light from `from` to `to`, over η² of the side of `to`.
    pub forth: f32,
    /// The other way.
    pub back: f32,
}

/// The share of light from or to one direction.
#[derive(Clone, Copy, Debug)]
pub struct Albedo {
    /// The direction.
    pub at: Angles,
    /// [`TransportMode::Importance`] if light arrives from there, else it leaves to there.
    pub mode: TransportMode,
    /// Largest channel of the albedo.
    pub mean: f64,
    /// Its standard error.
    pub error: f64,
}

/// Albedos over many directions.
#[derive(Clone, Debug)]
pub struct Energy {
    /// All of them.
    pub albedos: Vec<Albedo>,
    /// The level of each test.
    pub level: f64,
    /// How many of them exceed 1.
    pub excesses: usize,
    /// The one nearest to the normal that exceeds 1.
    pub first_excess: Option<Albedo>,
    /// The largest.
    pub largest: Albedo,
    /// The smallest.
    pub smallest: Albedo,
}

/// One χ² test.
#[derive(Clone, Copy, Debug)]
pub struct ChiSquare {
    /// Direction that was given.
    pub at: Angles,
    /// The statistic.
    pub chi2: f64,
    /// Degrees of freedom.
    pub degrees: f64,
    /// Chance of a statistic as large; 0 if a sample fell where the density is 0, or the density integrates to more
    /// than 1.
    pub p: f64,
    /// Whether the density could be integrated well enough to judge by: lobes narrower than f32 directions resolve cannot.
    pub decided: bool,
    /// Integral of the density over all directions.
    pub mass: f64,
}

/// χ² tests over many directions.
#[derive(Clone, Debug)]
pub struct Sampling {
    /// All of them; none for materials that are wholly specular.
    pub tests: Vec<ChiSquare>,
    /// The level of each.
    pub level: f64,
    /// How many failed.
    pub failures: usize,
    /// How many could not be decided.
    pub undecided: usize,
    /// Largest relative difference of a sample's weight from f·cos/pdf as evaluated, and of its density from the one
    /// evaluated.
    pub disagreement: f64,
}

/// All that was found.
#[derive(Clone, Debug)]
pub struct Report {
    /// What the material is meant to satisfy.
    pub claims: Claims,
    /// Whether f ≥ 0.
    pub positivity: Positivity,
    /// Whether f is symmetric.
    pub reciprocity: Reciprocity,
    /// Whether light is lost at most.
    pub energy: Energy,
    /// Whether samples follow their density.
    pub sampling: Sampling,
}

/// How hard to look.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Pairs of directions for positivity and reciprocity.
    pub pairs: u32,
    /// Samples for each albedo.
    pub albedo_samples: u32,
    /// Samples for each χ² test.
    pub chi2_samples: u32,
    /// Of random numbers.
    pub seed: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self { pairs: 20_000, albedo_samples: 20_000, chi2_samples: 100_000, seed: 1 }
    }
}

/// Asymmetry up to which a BSDF counts as reciprocal: what is left of f32 near critical angles and horizons.
pub const LARGEST_ASYMMETRY: f64 = 2e-3;
/// Difference up to which a weight counts as f·cos/pdf.
pub const LARGEST_DISAGREEMENT: f64 = 4e-3;
/// Excess of an albedo over 1 that is rounding: a cosine of 0.002 has lost three of seven digits.
const ROUNDING: f64 = 1e-4;

impl Report {
    /// Whether f is finite and never negative.
    pub fn is_positive(&self) -> bool {
        self.positivity.bad == 0
    }
    /// Whether f is symmetric.
    pub fn is_reciprocal(&self) -> bool {
        self.reciprocity.asymmetry <= LARGEST_ASYMMETRY
    }
    /// Whether no albedo exceeds 1.
    pub fn conserves_energy(&self) -> bool {
        self.energy.excesses == 0
    }
    /// Whether samples follow their density, and weights are f·cos/pdf; none if nothing speaks against it but not all could
    /// be decided.
    pub fn is_sampled_right(&self) -> Option<bool> {
        let sampling = &self.sampling;
        if sampling.failures > 0 || sampling.disagreement > LARGEST_DISAGREEMENT {
            return Some(false);
        }
        (sampling.undecided == 0).then_some(true)
    }
    /// Whether all that the material claims was shown to hold. Every material claims to be positive and sampled right.
    pub fn holds(&self) -> bool {
        self.is_positive()
            && self.is_sampled_right() == Some(true)
            && (self.is_reciprocal() || !self.claims.reciprocity)
            && (self.conserves_energy() || !self.claims.energy)
    }
}

impl Material {
    /// A material of these shares, which add up to 1.
    pub fn new(parts: Vec<(f32, Bsdf<'static, f32>)>) -> Self {
        Self { parts, tables: Arc::default() }
    }

    /// The same with the tables of those parts that are measured.
    pub fn with_tables(self, tables: Tables) -> Self {
        Self { tables: Arc::new(tables), ..self }
    }

    /// What it claims: what all of its parts do.
    pub fn claims(&self) -> Claims {
        let all = |f: fn(Claims) -> bool| self.parts.iter().all(|(_, b)| f(b.claims()));
        Claims { reciprocity: all(|c| c.reciprocity), energy: all(|c| c.energy) }
    }

    /// Whether light passes to the other side.
    pub fn transmits(&self) -> bool {
        self.parts.iter().any(|(_, b)| b.transmits())
    }

    /// Whether it has no density at all.
    pub fn is_specular(&self) -> bool {
        self.parts.iter().all(|(_, b)| b.is_specular())
    }

    /// Whether some of its light leaves in single directions.
    pub fn is_partly_specular(&self) -> bool {
        self.parts.iter().any(|(_, b)| b.is_specular())
    }

    /// The frame in which all directions of this module are given.
    fn world(&self, w: Vec3<f32>) -> Vec3<f32> {
        self.parts[0].1.frame.to_world(w)
    }
    fn local(&self, w: Vec3<f32>) -> Vec3<f32> {
        self.parts[0].1.frame.to_local(w)
    }

    /// f and the density of sampling `b` given `a`, both in the local frame; specular parts have none.
    pub fn eval(&self, a: Vec3<f32>, b: Vec3<f32>, mode: TransportMode) -> ([f32; 3], f32) {
        let (a, b) = (self.world(a), self.world(b));
        let (mut f, mut pdf) = (Rgb::black(), 0.0);
        for (share, part) in &self.parts {
            let value = part.with_tables(&self.tables).eval(a, b, mode, true);
            f += value.f * *share;
            pdf += value.pdf.0 * share;
        }
        (f.lane(0), pdf)
    }

    /// A direction given `a`, both in the local frame; from three numbers besides the one that picks a part.
    pub(super) fn sample(
        &self,
        a: Vec3<f32>,
        part: f32,
        u: [f32; 2],
        choice: f32,
        mode: TransportMode,
    ) -> BsdfSample<f32> {
        let mut left = part;
        let mut chosen = &self.parts[self.parts.len() - 1].1;
        for (share, bsdf) in &self.parts {
            if left < *share {
                chosen = bsdf;
                break;
            }
            left -= share;
        }
        let mut sample = chosen.with_tables(&self.tables).sample(self.world(a), u, || choice, mode, true);
        sample.w = self.local(sample.w);
        sample
    }

    /// The index of the inside over the outside, for light that passes.
    fn index(&self) -> f32 {
        self.parts.iter().find_map(|(_, b)| b.index_inside()).unwrap_or(1.0)
    }

    /// Finds out all there is to find out.
    pub fn check(&self, effort: &Effort) -> Report {
        let (positivity, reciprocity) = self.check_pairs(effort);
        Report {
            claims: self.claims(),
            positivity,
            reciprocity,
            energy: self.check_energy(effort, &energy_directions(self.transmits())),
            sampling: self.check_sampling(effort, &sampling_directions(self.transmits())),
        }
    }

    fn check_pairs(&self, effort: &Effort) -> (Positivity, Reciprocity) {
        let mut positivity = Positivity { values: 0, smallest: f32::INFINITY, bad: 0 };
        let nowhere = Angles { theta: 0.0, phi: 0.0 };
        let mut worst = Reciprocity { pairs: 0, asymmetry: 0.0, from: nowhere, to: nowhere, forth: 0.0, back: 0.0 };
        let index = |w: Vec3<f32>| if w.z < 0.0 { self.index() } else { 1.0 };
        for (i, u) in numbers(effort.seed, effort.pairs).enumerate() {
            let mut a = warp::uniform_sphere(u.pair(0));
            if !self.transmits() {
                a.z = a.z.abs();
            }
            // Half of the pairs as the material would draw them: narrow lobes are not found by chance.
            let b = if i % 2 == 0 {
                warp::uniform_sphere(u.pair(1))
            } else {
                let s = self.sample(a, u.value(4), u.pair(1), u.value(3), TransportMode::Importance);
                if s.specular || !s.weight.is_lit() {
                    continue;
                }
                s.w
            };
            let f = |a: Vec3<f32>, b: Vec3<f32>| self.eval(a, b, TransportMode::Importance).0;
            let (forth, back) = (f(a, b), f(b, a));
            for x in forth.iter().chain(&back) {
                positivity.values += 1;
                positivity.smallest = positivity.smallest.min(*x);
                positivity.bad += u64::from(!(*x >= 0.0 && x.is_finite()));
            }
            worst.pairs += 1;
            for channel in 0..3 {
                let (forth, back) = (forth[channel] / index(b).powi(2), back[channel] / index(a).powi(2));
                let asymmetry = f64::from((forth - back).abs() / (forth.max(back) + 0.05));
                if asymmetry > worst.asymmetry {
                    worst = Reciprocity {
                        pairs: worst.pairs,
                        asymmetry,
                        from: Angles::of(a),
                        to: Angles::of(b),
                        forth,
                        back,
                    };
                }
            }
        }
        (positivity, worst)
    }

    /// The albedo for one direction. Radiance through a boundary is counted without its squeeze.
    pub fn albedo(&self, at: Angles, mode: TransportMode, samples: u32, seed: u64) -> Albedo {
        let a = at.direction();
        let (mut sum, mut squares) = ([0.0_f64; 3], [0.0_f64; 3]);
        for u in numbers(seed, samples) {
            let s = self.sample(a, u.value(4), u.pair(1), u.value(3), mode);
            let squeeze = if mode == TransportMode::Radiance { s.eta * s.eta } else { 1.0 };
            for (channel, w) in s.weight.lane(0).into_iter().enumerate() {
                let w = f64::from(w * squeeze);
                sum[channel] += w;
                squares[channel] += w * w;
            }
        }
        let n = f64::from(samples);
        let channel = (0..3).max_by(|i, j| sum[*i].total_cmp(&sum[*j])).unwrap_or(0);
        let mean = sum[channel] / n;
        let variance = (squares[channel] / n - mean * mean).max(0.0) * n / (n - 1.0);
        Albedo { at, mode, mean, error: (variance / n).sqrt() }
    }

    /// Albedos for these directions, read both ways.
    pub fn check_energy(&self, effort: &Effort, directions: &[Angles]) -> Energy {
        let modes = [TransportMode::Importance, TransportMode::Radiance];
        let albedos: Vec<Albedo> = directions
            .iter()
            .flat_map(|at| modes.map(|mode| self.albedo(*at, mode, effort.albedo_samples, effort.seed)))
            .collect();
        let level = sidak(albedos.len());
        // The mean of so many weights is normal.
        let quantile = Normal::standard().inverse_cdf(1.0 - level);
        let exceeds = |a: &&Albedo| a.mean.is_nan() || a.mean > 1.0 + ROUNDING + quantile * a.error;
        let tilt = |a: &Albedo| 90.0 - (a.at.theta - 90.0).abs();
        let first_excess = albedos.iter().filter(exceeds).min_by(|a, b| tilt(a).total_cmp(&tilt(b))).copied();
        let excesses = albedos.iter().filter(exceeds).count();
        let by_mean = |a: &&Albedo, b: &&Albedo| a.mean.total_cmp(&b.mean);
        let nothing = Albedo { at: Angles { theta: 0.0, phi: 0.0 }, mode: modes[0], mean: 0.0, error: 0.0 };
        let largest = albedos.iter().max_by(by_mean).copied().unwrap_or(nothing);
        let smallest = albedos.iter().min_by(by_mean).copied().unwrap_or(nothing);
        Energy { albedos, level, excesses, first_excess, largest, smallest }
    }

    /// χ² tests for these directions.
    pub fn check_sampling(&self, effort: &Effort, directions: &[Angles]) -> Sampling {
        let mut tests = Vec::new();
        let mut disagreement = 0.0_f64;
        if !self.is_specular() {
            for (i, at) in directions.iter().enumerate() {
                let (test, d) = self.chi2(*at, effort.chi2_samples, effort.seed.wrapping_add(i as u64));
                tests.extend(test);
                disagreement = disagreement.max(d);
            }
        }
        let level = sidak(tests.len());
        let undecided = tests.iter().filter(|t| !t.decided).count();
        let failures = tests.iter().filter(|t| t.decided && t.p < level).count();
        Sampling { tests, level, failures, undecided, disagreement }
    }

    /// A χ² test of directions drawn given one, and the largest disagreement of their weights with f·cos/pdf; no test where
    /// nothing can be drawn.
    fn chi2(&self, at: Angles, samples: u32, seed: u64) -> (Option<ChiSquare>, f64) {
        let (a, mode) = (at.direction(), TransportMode::Radiance);
        let mut disagreement = 0.0_f64;
        // Drawn from numbers of their own, for the cells not to hang on what is tested.
        let before = numbers(!seed, samples / 16).filter_map(|u| {
            let s = self.sample(a, u.value(4), u.pair(1), u.value(3), mode);
            (!s.specular && s.weight.is_lit()).then_some(s.w)
        });
        let mut cells = Cells::new(before);
        for (i, u) in numbers(seed, samples).enumerate() {
            let s = self.sample(a, u.value(4), u.pair(1), u.value(3), mode);
            // What has no density of its own counts as having failed.
            if s.specular || !s.weight.is_lit() {
                cells.failed += 1;
                continue;
            }
            cells.add(s.w);
            if i % 16 == 0 && self.parts.len() == 1 {
                let (f, pdf) = self.eval(a, s.w, mode);
                let apart = |x: f32, y: f32| f64::from((x / y - 1.0).abs());
                // Grazing directions lose digits in the cosine.
                let cos = s.w.z.abs();
                let slack = 1.0 / (1.0 + 1e-3 / f64::from(cos));
                let weight = apart(f[1] * cos / pdf, s.weight.g);
                let worse = apart(pdf, s.pdf.0).max(if s.weight.g > 1e-6 { weight } else { 0.0 });
                disagreement = disagreement.max(if worse.is_nan() { f64::INFINITY } else { worse * slack });
            }
        }
        if cells.failed == samples {
            return (None, disagreement);
        }
        (Some(cells.compare(at, samples, |w| f64::from(self.eval(a, w, mode).1))), disagreement)
    }
}

/// Independent random numbers, some for each of `n`.
pub(super) fn numbers(seed: u64, n: u32) -> impl Iterator<Item = Numbers> {
    let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
    (0..n).map(move |i| Numbers(sampler.stream(Index1(i), Index1(0))))
}

pub(super) struct Numbers(Stream<f32>);

impl Numbers {
    pub(super) fn pair(&self, dimension: u32) -> [f32; 2] {
        self.0.pair(Index1(dimension))
    }
    pub(super) fn value(&self, dimension: u32) -> f32 {
        self.0.value(Index1(dimension))
    }
}

/// From upright to grazing, at three azimuths, and below for what transmits.
fn energy_directions(below: bool) -> Vec<Angles> {
    let thetas = [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0, 88.0, 89.0, 89.5, 89.9];
    let above = thetas.into_iter().flat_map(|theta| [0.0, 40.0, 90.0].map(|phi| Angles { theta, phi }));
    let mut all: Vec<Angles> = above.collect();
    if below {
        let mirrored: Vec<Angles> = all.iter().map(|a| Angles { theta: 180.0 - a.theta, phi: a.phi }).collect();
        all.extend(mirrored);
    }
    all
}

/// Directions for the tests of samplers.
pub fn sampling_directions(below: bool) -> Vec<Angles> {
    let mut all: Vec<Angles> = [(3.0, 10.0), (25.0, 200.0), (45.0, 100.0), (65.0, 310.0), (80.0, 45.0), (88.0, 160.0)]
        .map(|(theta, phi)| Angles { theta, phi })
        .to_vec();
    if below {
        all.extend([(95.0, 70.0), (120.0, 33.0), (160.0, 200.0)].map(|(theta, phi)| Angles { theta, phi }));
    }
    all
}

/// Directions drawn beforehand that a cell holds at most, of one in sixteen of those to be tested.
const CELL: usize = 12;
/// Those that a leaf holds at most with a margin around it, half its size to each side.
const LEAF: usize = 24;
/// The smallest side of a leaf, radians: some sixteen steps of f32.
const FINEST: f64 = 1e-6;

/// A part of the sphere by θ and φ, radians.
#[derive(Clone, Copy)]
struct Rectangle {
    theta: [f64; 2],
    phi: [f64; 2],
}

impl Rectangle {
    /// Its longer side on the sphere, and whether that is along φ.
    fn longer_side(&self) -> (f64, bool) {
        let height = self.theta[1] - self.theta[0];
        let width = (self.phi[1] - self.phi[0]) * ((self.theta[0] + self.theta[1]) / 2.0).sin();
        (height.max(width), width > height)
    }

    /// Whether it holds a point, or comes within half its size of it.
    fn is_near(&self, [theta, phi]: [f64; 2], margin: f64) -> bool {
        let within = |[lo, hi]: [f64; 2], x: f64| {
            let margin = margin * (hi - lo);
            x >= lo - margin && x < hi + margin
        };
        within(self.theta, theta) && within(self.phi, phi)
    }
}

enum Node {
    /// Cut in two at a θ or a φ.
    Cut { along_phi: bool, at: f64, halves: [usize; 2] },
    /// Part of a cell.
    Leaf(usize),
}

/// Counts of directions in cells that are small where directions are dense. A tree halves θ × φ until few directions drawn
/// beforehand fall in a leaf or near it. So leaves grow gradually with the distance from a lobe, however narrow it is,
/// and a density that samples follow varies little within one. A cell is one or more leaves.
struct Cells {
    nodes: Vec<Node>,
    leaves: Vec<(Rectangle, usize)>,
    counts: Vec<u32>,
    failed: u32,
    /// Whether directions are denser than f32 tells apart.
    blurred: bool,
}

impl Cells {
    fn new(before: impl Iterator<Item = Vec3<f32>>) -> Self {
        let mut cells = Self { nodes: Vec::new(), leaves: Vec::new(), counts: Vec::new(), failed: 0, blurred: false };
        // φ is cut open at 0, and has two sides there.
        let points =
            before.flat_map(|w| [-TAU, 0.0, TAU].map(|turn| [theta_phi(w)[0], theta_phi(w)[1] + turn])).collect();
        cells.grow(Rectangle { theta: [0.0, PI], phi: [0.0, TAU] }, points, None);
        cells
    }

    fn grow(&mut self, r: Rectangle, mut near: Vec<[f64; 2]>, cell: Option<usize>) -> usize {
        near.retain(|p| r.is_near(*p, 0.5));
        let inside = near.iter().filter(|p| r.is_near(**p, 0.0)).count();
        let (side, along_phi) = r.longer_side();
        let fine = side < FINEST;
        let cell = if cell.is_none() && (inside <= CELL || fine) {
            self.counts.push(0);
            Some(self.counts.len() - 1)
        } else {
            cell
        };
        let number = self.nodes.len();
        if let Some(cell) = cell
            && (near.len() <= LEAF || fine)
        {
            self.blurred |= inside > CELL;
            self.nodes.push(Node::Leaf(cell));
            self.leaves.push((r, cell));
            return number;
        }
        let [lo, hi] = if along_phi { r.phi } else { r.theta };
        let at = (lo + hi) / 2.0;
        self.nodes.push(Node::Leaf(0));
        let halves = [[lo, at], [at, hi]].map(|range| {
            let half = if along_phi { Rectangle { phi: range, ..r } } else { Rectangle { theta: range, ..r } };
            self.grow(half, near.clone(), cell)
        });
        self.nodes[number] = Node::Cut { along_phi, at, halves };
        number
    }

    fn add(&mut self, w: Vec3<f32>) {
        let [theta, phi] = theta_phi(w);
        let mut node = 0;
        let cell = loop {
            match &self.nodes[node] {
                Node::Leaf(cell) => break *cell,
                Node::Cut { along_phi, at, halves } => {
                    node = halves[usize::from(if *along_phi { phi } else { theta } >= *at)];
                }
            }
        };
        self.counts[cell] += 1;
    }

    /// Compares with a density; cells expected to hold fewer than five are pooled.
    fn compare(&self, at: Angles, samples: u32, density: impl Fn(Vec3<f32>) -> f64) -> ChiSquare {
        let integrand = |theta: f64, phi: f64| {
            let w = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|x| x as f32);
            density(Vec3::splat(w)) * theta.sin()
        };
        let n = f64::from(samples);
        let mut mass = vec![(0.0, 0.0); self.counts.len()];
        for (r, cell) in &self.leaves {
            let (value, error) = adaptive(&integrand, r.theta, r.phi, 1, 8);
            mass[*cell] = (mass[*cell].0 + value, mass[*cell].1 + error);
        }
        // Where samples are not what the integral says, look closer before judging, and twice where it says there is nothing:
        // the support may be thin.
        for (least, most, tolerance) in [(4, 12, 9.0), (7, 14, f64::INFINITY)] {
            let strange: Vec<bool> = (self.counts.iter().zip(&mass))
                .map(|(count, (mass, _))| (f64::from(*count), mass * n))
                .map(|(count, expected)| {
                    (count - expected).powi(2) > tolerance * expected.max(1.0) || expected < 1e-6 && count > 2.0
                })
                .collect();
            strange.iter().zip(&mut mass).filter(|(strange, _)| **strange).for_each(|(_, mass)| *mass = (0.0, 0.0));
            for (r, cell) in self.leaves.iter().filter(|(_, cell)| strange[*cell]) {
                let (value, error) = adaptive(&integrand, r.theta, r.phi, least, most);
                mass[*cell] = (mass[*cell].0 + value, mass[*cell].1 + error);
            }
        }
        let total: f64 = mass.iter().map(|(m, _)| m).sum();
        // A shortfall as small as the error of the quadrature is not failing samples.
        let (scale, failing) =
            if self.failed == 0 && (total - 1.0).abs() < 2e-3 { (1.0 / total, 0.0) } else { (1.0, 1.0 - total) };
        let (mut chi2, mut used, mut impossible) = (0.0, 0, total > 1.002);
        let (mut pool, mut pool_expected) = (0.0, 0.0);
        let counts = self.counts.iter().copied().chain([self.failed]);
        for (count, expected) in counts.zip(mass.iter().map(|(m, _)| m * scale).chain([failing.max(0.0)])) {
            let (count, expected) = (f64::from(count), expected * n);
            // Rounding may carry a sample or two across the edge of the support.
            impossible |= expected < 1e-6 && count > 2.0;
            if expected >= 5.0 {
                chi2 += (count - expected).powi(2) / expected;
                used += 1;
            } else {
                pool += count;
                pool_expected += expected;
                if pool_expected >= 5.0 {
                    chi2 += (pool - pool_expected).powi(2) / pool_expected;
                    used += 1;
                    (pool, pool_expected) = (0.0, 0.0);
                }
            }
        }
        let degrees = f64::from(used - 1);
        // With all in one cell there is nothing to compare but that it is all.
        let p = match ChiSquared::new(degrees) {
            _ if impossible => 0.0,
            Ok(distribution) => distribution.sf(chi2),
            Err(_) => f64::from(u8::from(chi2 < 10.0)),
        };
        // What the error of the quadrature alone would add to χ², against half of χ²'s own standard deviation.
        let doubt: f64 = mass.iter().map(|(m, error)| (error * n).powi(2) / (m * n).max(1.0)).sum();
        let decided = !self.blurred && doubt <= 0.5 * (2.0 * degrees.max(1.0)).sqrt();
        ChiSquare { at, chi2, degrees, p, decided, mass: total }
    }
}

/// The angles of a unit vector, radians.
fn theta_phi(w: Vec3<f32>) -> [f64; 2] {
    let Angles { theta, phi } = Angles::of(w);
    [theta.to_radians(), phi.to_radians()]
}

/// An integral over a rectangle by Gauss's rule of 2 × 2 points, quartered between `least` and `most` times until
/// quartering changes nothing that samples could show; and by how much the last quartering changed it where there were to
/// be no more.
fn adaptive(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], least: u32, most: u32) -> (f64, f64) {
    fn rule(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
        let at = |r: [f64; 2], s: f64| r[0] + (r[1] - r[0]) * (0.5 + s * 0.288_675_134_594_812_9);
        let sum: f64 =
            [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(s, t)| f(at(x, s), at(y, t))).iter().sum();
        sum * (x[1] - x[0]) * (y[1] - y[0]) / 4.0
    }
    fn refine(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], whole: f64, least: u32, most: u32) -> (f64, f64) {
        let middle = |r: [f64; 2]| (r[0] + r[1]) / 2.0;
        let (mx, my) = (middle(x), middle(y));
        let quarters =
            [([x[0], mx], [y[0], my]), ([x[0], mx], [my, y[1]]), ([mx, x[1]], [y[0], my]), ([mx, x[1]], [my, y[1]])];
        let values = quarters.map(|(x, y)| rule(f, x, y));
        let sum: f64 = values.iter().sum();
        let change = (sum - whole).abs();
        if least == 0 && change < 2e-7 {
            return (sum, 0.0);
        }
        if most == 0 {
            return (sum, change);
        }
        let parts = quarters.iter().zip(values);
        let parts = parts.map(|((x, y), value)| refine(f, *x, *y, value, least.saturating_sub(1), most - 1));
        parts.fold((0.0, 0.0), |(a, b), (value, error)| (a + value, b + error))
    }
    refine(f, x, y, rule(f, x, y), least, most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Frame;

    #[test]
    fn the_level_of_many_tests() {
        assert!((sidak(1) - 0.01).abs() < 1e-12);
        assert!(((1.0 - sidak(20)).powi(20) - 0.99).abs() < 1e-12);
    }

    #[test]
    fn a_sampler_that_strays_is_found() {
        // Directions of cosine law, against a density that is uniform, and against one that is cosine but shifted.
        let cells = drawn(warp::cosine_hemisphere);
        let against = |density: fn(Vec3<f32>) -> f64| judged(&cells, density).0;
        assert!(against(|w| f64::from(w.z.max(0.0)) / PI) > 1e-3);
        assert_eq!(against(|w| f64::from(u8::from(w.z > 0.0)) / TAU), 0.0);
        assert!(against(|w| f64::from(w.z.max(0.0) * (1.0 + 0.2 * w.x)) / PI) < 1e-6);
        // Half of the density missing without any sample failing.
        assert!(against(|w| 0.5 * f64::from(w.z.max(0.0)) / PI) < 1e-6);
    }

    fn drawn(sample: impl Fn([f32; 2]) -> Vec3<f32>) -> Cells {
        let mut cells = Cells::new(numbers(4, 6250).map(|u| sample(u.pair(1))));
        numbers(3, 100_000).for_each(|u| cells.add(sample(u.pair(1))));
        cells
    }

    /// p, and whether that decides.
    fn judged(cells: &Cells, density: impl Fn(Vec3<f32>) -> f64) -> (f64, bool) {
        let found = cells.compare(Angles { theta: 0.0, phi: 0.0 }, 100_000, density);
        (found.p, found.decided)
    }

    /// A disk of directions of this radius around some axis, by its chord for the digits.
    fn disk(radius: f64, u: [f32; 2]) -> Vec3<f32> {
        let frame = Frame::around(AXIS.direction());
        let (r, phi) = (f64::from(u[0]).sqrt() * radius, f64::from(u[1]) * TAU);
        let [x, y] = [(r * phi.cos()) as f32, (r * phi.sin()) as f32];
        frame.to_world(vec3(x, y, 1.0)).normalized()
    }

    const AXIS: Angles = Angles { theta: 50.0, phi: 130.0 };

    #[test]
    fn narrow_lobes_are_judged() {
        let around = AXIS.direction();
        for radius in [0.1, 1e-2, 1e-3, 1e-4] {
            let cells = drawn(|u| disk(radius, u));
            // A disk has a sharp edge, a cone beside it has a tail: neither may be mistaken for the other.
            let chord = |w: Vec3<f32>| f64::from((w - around).length());
            let cone = |w: Vec3<f32>| (1.0 - chord(w) / radius).max(0.0) * 3.0 / (PI * radius * radius);
            let cone_drawn = drawn(|u| {
                // The distance from the axis has density 6 x (1 − x).
                let x = (0..30).fold([0.0, 1.0], |[lo, hi]: [f64; 2], _| {
                    let x = (lo + hi) / 2.0;
                    if x * x * (3.0 - 2.0 * x) < f64::from(u[0]) { [x, hi] } else { [lo, x] }
                });
                disk(radius * x[0], [1.0, u[1]])
            });
            let (p, decided) = judged(&cone_drawn, cone);
            assert!(decided && p > 1e-3, "radius {radius}: p = {p}");
            assert_eq!(judged(&cells, cone).0, 0.0, "radius {radius}");
            // Shifted by a tenth of its size.
            let shift = Frame::around(around).s * (0.1 * radius) as f32;
            let shifted = |w: Vec3<f32>| cone(w - shift);
            assert!(judged(&cone_drawn, shifted).0 < 1e-6, "radius {radius}");
        }
        // Ten steps of f32 are no lobe.
        let cells = drawn(|u| disk(6e-7, u));
        assert!(!judged(&cells, |w| f64::from(u8::from((w - around).length() < 6e-7)) / (PI * 3.6e-13)).1);
    }
}
