//! A density on the unit square, constant on each cell of a grid, sampled by descending a quadtree of sums.
//!
//! Unlike a table of aliases the descent is continuous in u, so it keeps the stratification of its input (hierarchical
//! sample warping, Clarberg et al. 2005). Each node is one record: the sums of its four children.

use rebond_lanes::{Index, Real, Record};

/// A piecewise constant density on [0, 1)².
#[derive(Clone, Debug)]
pub struct Grid {
    size: [u32; 2],
    levels: u32,
    /// Levels from the root; level l holds 4^l nodes, row by row.
    nodes: Vec<Record>,
    /// Where each level starts.
    start: Vec<u32>,
    /// cells / total of the weights.
    scale: f32,
}

impl Grid {
    /// A density proportional to finite, non-negative weights, `size[0]` to a row; `None` if they are all 0.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` weights.
    pub fn new(size: [u32; 2], weights: &[f32]) -> Option<Self> {
        assert_eq!(weights.len(), size[0] as usize * size[1] as usize);
        let levels = size[0].max(size[1]).next_power_of_two().ilog2().max(1);
        let side = 1_usize << levels;
        let mut sums = vec![0.0_f64; side * side];
        for (y, row) in weights.chunks(size[0] as usize).enumerate() {
            for (x, w) in row.iter().enumerate() {
                sums[y * side + x] = f64::from(*w);
            }
        }
        let mut by_level = Vec::new();
        for level in (0..levels).rev() {
            let side = 1_usize << level;
            let four = |y: usize, x: usize| {
                let at = 2 * y * 2 * side + 2 * x;
                [sums[at], sums[at + 1], sums[at + 2 * side], sums[at + 2 * side + 1]]
            };
            let children: Vec<[f64; 4]> = (0..side * side).map(|i| four(i / side, i % side)).collect();
            by_level.push(children.iter().map(|c| Record(c.map(|v| v as f32))).collect::<Vec<_>>());
            sums = children.iter().map(|c| c.iter().sum()).collect();
        }
        let total = sums[0];
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        by_level.reverse();
        let start = by_level.iter().scan(0, |at, l| Some(std::mem::replace(at, *at + l.len() as u32))).collect();
        let cells = f64::from(size[0]) * f64::from(size[1]);
        Some(Self { size, levels, nodes: by_level.concat(), start, scale: (cells / total) as f32 })
    }

    /// A point of [0, 1)² and its density, from u in [0, 1)².
    #[inline]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> ([F; 2], F) {
        let [mut ux, mut uy] = u;
        let (mut x, mut y) = (F::Index::splat(0), F::Index::splat(0));
        let mut weight = F::zero();
        let below_one = F::splat(super::sampler::ONE_MINUS_EPSILON);
        for level in 0..self.levels {
            let node = F::Index::splat(self.start[level as usize]) + (y << level) + x;
            let [a, b, c, d] = F::record(&self.nodes, node);
            let (top, bottom) = (a + b, c + d);
            let (lower, v) = split(uy, top, bottom);
            let (p, q) = (F::select(lower, c, a), F::select(lower, d, b));
            let (right, w) = split(ux, p, q);
            weight = F::select(right, q, p);
            (ux, uy) = (w.min(below_one), v.min(below_one));
            let one = |m| F::Index::select(m, F::Index::splat(1), F::Index::splat(0));
            (x, y) = ((x << 1) + one(right), (y << 1) + one(lower));
        }
        let point = [
            (F::from_index(x) + ux) * (1.0 / self.size[0] as f32),
            (F::from_index(y) + uy) * (1.0 / self.size[1] as f32),
        ];
        (point, weight * self.scale)
    }

    /// The density at a point of [0, 1)².
    #[inline]
    pub fn pdf<F: Real>(&self, p: [F; 2]) -> F {
        let cell = |p: F, n: u32| (p.relu() * n as f32).to_index().min(F::Index::splat(n - 1));
        let (x, y) = (cell(p[0], self.size[0]), cell(p[1], self.size[1]));
        let level = self.levels - 1;
        let node = F::Index::splat(self.start[level as usize]) + ((y >> 1) << level) + (x >> 1);
        let [a, b, c, d] = F::record(&self.nodes, node);
        let odd = |i: F::Index| (i & F::Index::splat(1)).eq(F::Index::splat(1));
        F::select(odd(y), F::select(odd(x), d, c), F::select(odd(x), b, a)) * self.scale
    }
}

/// Whether u in [0, 1) falls to the second of two shares, and its place within the share.
#[inline(always)]
fn split<F: Real>(u: F, first: F, second: F) -> (F::Mask, F) {
    let at = u * (first + second);
    // A share of nothing is never taken, whatever rounding does.
    let takes_second = (at.ge(first) & second.gt(F::zero())) | first.le(F::zero());
    let within = F::select(takes_second, (at - first) / second, at / first);
    (takes_second, within.relu())
}
