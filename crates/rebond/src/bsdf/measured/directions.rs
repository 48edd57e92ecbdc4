//! What directions of measured materials are drawn from: half vectors, for some directions of the viewer.
//!
//! A half vector has the coordinates s = 1 − cosθh ∈ [0, 1] and φh, which for isotropic materials counts from the known
//! direction. Rows of a grid part s at (r/[`ROWS`])⁴, which for small angles is evenly in √θh; columns part φh evenly. The
//! density q per solid angle is known at the corners of the cells and bilinear within them, so that a cell is sampled
//! exactly and q is continuous. Directions reflected about h have the density
//!
//! ```text
//! pdf(b | a) = Σ_j w_j(a) q_j(h) / (4 a·h),    h = (a + b)/|a + b|                      (Torrance and Sparrow 1967)
//! ```
//!
//! with the weights of linear interpolation between the tabulated directions: one of them is drawn by its weight, then
//! the half vector. At the corners q is `f cosθ · 4 a·h`, the mean of the channels.

use super::{Between, turn};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::{Grids, linear};
use rebond_lanes::{F32x16, Index, Real, Record, math};
use std::f32::consts::PI;

const ROWS: u32 = 64;
const COLUMNS: u32 = 32;
const CELLS: u32 = ROWS * COLUMNS;
/// Tabulated directions from the normal to the horizon, evenly in √(1 − cosθ): of isotropic materials, and of others.
const TILTS: [u32; 2] = [32, 16];
/// And about the normal.
const TURNS: [u32; 2] = [1, 16];

#[derive(Clone, Debug)]
pub struct Directions {
    /// [`CELLS`] for each tabulated direction: q at a cell's corners.
    cells: Vec<Record>,
    grids: Grids,
}

/// Lower end of a row of cells.
#[inline(always)]
fn edge<F: Real>(row: F) -> F {
    let x = row * (1.0 / ROWS as f32);
    let x2 = x * x;
    x2 * x2
}

/// 1 − cosθ without the digits that subtraction loses.
#[inline(always)]
fn one_minus_cos<F: Real>(w: Vec3<F>) -> F {
    (w.x * w.x + w.y * w.y) / (w.z + 1.0)
}

/// The direction of 1 − cosθ = s at an azimuth in turns.
#[inline(always)]
fn direction<F: Real>(s: F, turns: F) -> Vec3<F> {
    let sin = (s * (F::splat(2.0) - s)).safe_sqrt();
    let (y, x) = math::sin_cos(turns * (2.0 * PI));
    vec3(sin * x, sin * y, F::one() - s)
}

/// q within a cell.
#[inline(always)]
fn within<F: Real>([a, b, c, d]: [F; 4], across: F, down: F) -> F {
    let (left, right) = (a + (c - a) * down, b + (d - b) * down);
    left + (right - left) * across
}

impl Directions {
    pub fn new() -> Self {
        Self { cells: Vec::new(), grids: Grids::new([COLUMNS, ROWS]) }
    }

    /// How many directions are tabulated.
    pub fn len(&self) -> u32 {
        self.cells.len() as u32 / CELLS
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&*self.cells) + self.grids.bytes()
    }

    /// Adds the distributions of a material, whose f hangs on the directions of viewer and light.
    pub fn push(&mut self, isotropic: bool, f: impl Fn(Vec3<F32x16>, Vec3<F32x16>) -> Rgb<F32x16>) {
        let kind = usize::from(!isotropic);
        for i in 0..TURNS[kind] {
            for j in 0..TILTS[kind] {
                let t = j as f32 / (TILTS[kind] - 1) as f32;
                // Along the surface itself nothing can be said.
                let viewer = direction((t * t).min(0.99), i as f32 / TURNS[kind] as f32);
                self.push_one(viewer, isotropic, &f);
            }
        }
    }

    fn push_one(&mut self, viewer: Vec3<f32>, isotropic: bool, f: &impl Fn(Vec3<F32x16>, Vec3<F32x16>) -> Rgb<F32x16>) {
        let start = if isotropic { turn(viewer) } else { 0.0 };
        let a = Vec3::<F32x16>::splat(viewer.array());
        let corners = ((ROWS + 1) * COLUMNS) as usize;
        let mut q = vec![0.0_f32; corners];
        for (first, sixteen) in q.chunks_mut(16).enumerate() {
            let at = |lane: usize| (first * 16 + lane) as u32;
            let lanes = |f: &dyn Fn(u32) -> f32| (0..16).fold(F32x16::splat(0.0), |v, i| v.with_lane(i, f(at(i))));
            let s = edge(lanes(&|i| (i / COLUMNS) as f32));
            let h = direction(s, lanes(&|i| start + (i % COLUMNS) as f32 / COLUMNS as f32));
            let a_h = a.dot(h);
            let b = h * (a_h * 2.0) - a;
            let value = f(a, b);
            let mean = (value.r + value.g + value.b) * (b.z * a_h * (4.0 / 3.0));
            let seen = b.z.gt(F32x16::zero()) & a_h.gt(F32x16::zero()) & mean.is_finite();
            F32x16::select(seen, mean, F32x16::zero()).store(sixteen);
        }
        let corner = |row: u32, column: u32| q[(row * COLUMNS + column % COLUMNS) as usize];
        let mut weights = Vec::with_capacity(CELLS as usize);
        let mut cells = Vec::with_capacity(CELLS as usize);
        for row in 0..ROWS {
            let area = f64::from(edge((row + 1) as f32) - edge(row as f32)) * f64::from(2.0 * PI / COLUMNS as f32);
            for column in 0..COLUMNS {
                let (left, right) = (column, column + 1);
                let c = [corner(row, left), corner(row, right), corner(row + 1, left), corner(row + 1, right)];
                weights.push((c.iter().map(|x| f64::from(*x)).sum::<f64>() / 4.0 * area) as f32);
                cells.push(c);
            }
        }
        let total: f64 = weights.iter().map(|w| f64::from(*w)).sum();
        if !(total > 0.0 && total.is_finite()) {
            // Nothing is reflected: any density will do.
            cells.fill([1.0; 4]);
            for (i, w) in weights.iter_mut().enumerate() {
                let row = i as u32 / COLUMNS;
                *w = edge((row + 1) as f32) - edge(row as f32);
            }
        }
        let total = if total > 0.0 && total.is_finite() { total } else { f64::from(2.0 * PI) };
        self.cells.extend(cells.iter().map(|c| Record(c.map(|x| (f64::from(x) / total) as f32))));
        self.grids.push(&weights);
    }

    /// The tabulated directions around one: their numbers and weights. The last two are of no use if all are isotropic.
    #[inline(always)]
    fn around<F: Real>(first: F::Index, isotropic: F::Mask, a: Vec3<F>) -> ([F::Index; 4], [F; 4]) {
        let pick = |n: [u32; 2]| F::Index::select(isotropic, F::Index::splat(n[0]), F::Index::splat(n[1]));
        let (tilts, turns) = (pick(TILTS), pick(TURNS));
        let x = one_minus_cos(a).safe_sqrt() * (F::from_index(tilts) - 1.0);
        let (tilt, around) = (Between::clamped(x, tilts), Between::around(turn(a), turns));
        // With a single one, both neighbours are it.
        let second = F::select(isotropic, F::zero(), around.weight[1]);
        let turn_weight = [F::one() - second, second];
        let number = |k: usize| first + around.at[k / 2] * tilts + tilt.at[k % 2];
        let weight = |k: usize| turn_weight[k / 2] * tilt.weight[k % 2];
        ([0, 1, 2, 3].map(number), [0, 1, 2, 3].map(weight))
    }

    /// What φh counts from, in turns.
    #[inline(always)]
    fn origin<F: Real>(isotropic: F::Mask, a: Vec3<F>) -> F {
        F::select(isotropic, turn(a), F::zero())
    }

    /// Density of drawing `b` given `a`, both above the surface.
    #[inline(always)]
    pub fn pdf<F: Real>(&self, first: F::Index, isotropic: F::Mask, a: Vec3<F>, b: Vec3<F>) -> F {
        use rebond_lanes::Mask;
        let h = (a + b).normalized();
        let s = one_minus_cos(h).clamp(0.0, 1.0);
        let row = (s.sqrt().sqrt() * ROWS as f32).to_index().min(F::Index::splat(ROWS - 1));
        let (low, high) = (edge(F::from_index(row)), edge(F::from_index(row) + 1.0));
        let turns = turn(h) - Self::origin(isotropic, a);
        let x = (turns - turns.floor()) * COLUMNS as f32;
        let column = x.to_index().min(F::Index::splat(COLUMNS - 1));
        let (across, down) = (x - F::from_index(column), ((s - low) / (high - low)).clamp(0.0, 1.0));
        let (numbers, weights) = Self::around(first, isotropic, a);
        let mut q = F::zero();
        for k in 0..if isotropic.all() { 2 } else { 4 } {
            let cell = (numbers[k] * F::Index::splat(ROWS) + row) * F::Index::splat(COLUMNS) + column;
            q += within(F::record(&self.cells, cell), across, down) * weights[k];
        }
        q / (a.dot(h) * 4.0)
    }

    /// A direction given `a`; `choice` in [0, 1) is spent on the tabulated direction.
    #[inline(always)]
    pub fn sample<F: Real>(&self, first: F::Index, isotropic: F::Mask, a: Vec3<F>, u: [F; 2], choice: F) -> Vec3<F> {
        let (numbers, weights) = Self::around(first, isotropic, a);
        let mut number = numbers[0];
        let mut sum = weights[0];
        for k in 1..4 {
            number = F::Index::select(choice.ge(sum) & weights[k].gt(F::zero()), numbers[k], number);
            sum += weights[k];
        }
        let cell = self.grids.sample(number, u);
        let at = (number * F::Index::splat(ROWS) + cell.y) * F::Index::splat(COLUMNS) + cell.x;
        let q = F::record(&self.cells, at);
        let down = linear(cell.u[1], q[0] + q[1], q[2] + q[3]);
        let across = linear(cell.u[0], q[0] + (q[2] - q[0]) * down, q[1] + (q[3] - q[1]) * down);
        let (low, high) = (edge(F::from_index(cell.y)), edge(F::from_index(cell.y) + 1.0));
        let turns = (F::from_index(cell.x) + across) * (1.0 / COLUMNS as f32) + Self::origin(isotropic, a);
        let h = direction(low + (high - low) * down, turns);
        h * (a.dot(h) * 2.0) - a
    }
}
