//! A density on a grid, constant on each cell, sampled by descending a tree of sums.
//!
//! Unlike a table of aliases the descent is continuous in u, so it keeps the stratification of its input (hierarchical
//! sample warping, Clarberg et al. 2005). Each node is one record: the sums of its up to four children.

use rebond_lanes::{Index, Real, Record};

/// A piecewise constant density on the cells of a grid.
#[derive(Clone, Debug)]
pub struct Grid {
    tree: Tree,
    nodes: Vec<Record>,
    /// 1 / sum of the weights.
    scale: f32,
}

/// Densities on grids of one size, chosen by number.
#[derive(Clone, Debug)]
pub struct Grids {
    size: [u32; 2],
    tree: Tree,
    /// Nodes of each grid.
    stride: u32,
    /// The nodes of one grid after the other; the root's sums add up to 1.
    nodes: Vec<Record>,
}

/// Levels from the root; the last one's children are the cells.
#[derive(Clone, Debug)]
struct Tree(Vec<Level>);

#[derive(Clone, Copy, Debug)]
struct Level {
    /// Place of its first node.
    start: u32,
    /// log₂ of the nodes in a row.
    row_bits: u32,
    /// By how many bits the position grows along x and y from here to the children: 0 or 1.
    grows: [u32; 2],
}

/// A cell, the place within it, and its probability.
#[derive(Clone, Copy, Debug)]
pub struct Cell<F: Real> {
    /// Column.
    pub x: F::Index,
    /// Row.
    pub y: F::Index,
    /// What is left of u: uniform in [0, 1)², independent of the cell.
    pub u: [F; 2],
    /// Probability of the cell.
    pub probability: F,
}

impl Tree {
    /// The tree over these weights, its nodes, and their sum.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` weights.
    fn new(size: [u32; 2], weights: &[f32]) -> (Self, Vec<[f64; 4]>, f64) {
        assert_eq!(weights.len(), size[0] as usize * size[1] as usize);
        let bits = size.map(|n| n.next_power_of_two().ilog2());
        let mut width = 1_usize << bits[0];
        let mut sums = vec![0.0_f64; width << bits[1]];
        for (row, from) in sums.chunks_mut(width).zip(weights.chunks(size[0] as usize)) {
            row.iter_mut().zip(from).for_each(|(sum, w)| *sum = f64::from(*w));
        }
        // From the cells up: halve whatever side is longer than one, always at least one level.
        let mut from_below: Vec<(Level, Vec<[f64; 4]>)> = Vec::new();
        let (mut bx, mut by) = (bits[0], bits[1]);
        while from_below.is_empty() || bx + by > 0 {
            let grows = [bx.min(1), by.min(1)];
            (bx, by) = (bx - grows[0], by - grows[1]);
            let children = |i: usize| {
                let (x, y) = ((i & ((1 << bx) - 1)) << grows[0], (i >> bx) << grows[1]);
                let sum = |right: bool, lower: bool| {
                    let exists = (!right || grows[0] == 1) && (!lower || grows[1] == 1);
                    if exists { sums[(y + usize::from(lower)) * width + x + usize::from(right)] } else { 0.0 }
                };
                [sum(false, false), sum(true, false), sum(false, true), sum(true, true)]
            };
            let all: Vec<[f64; 4]> = (0..1_usize << (bx + by)).map(children).collect();
            sums = all.iter().map(|c| c.iter().sum()).collect();
            from_below.push((Level { start: 0, row_bits: bx, grows }, all));
            width = 1 << bx;
        }
        let (mut levels, mut nodes) = (Vec::new(), Vec::new());
        for (level, sums) in from_below.into_iter().rev() {
            levels.push(Level { start: nodes.len() as u32, ..level });
            nodes.extend(sums);
        }
        (Self(levels), nodes, sums[0])
    }

    /// A cell of the grid whose nodes start at `first`; its probability times the sum of the weights.
    #[inline(always)]
    fn descend<F: Real>(&self, nodes: &[Record], first: F::Index, u: [F; 2]) -> Cell<F> {
        let [mut ux, mut uy] = u;
        let (mut x, mut y) = (F::Index::splat(0), F::Index::splat(0));
        let mut weight = F::zero();
        let below_one = F::splat(super::sampler::ONE_MINUS_EPSILON);
        for level in &self.0 {
            let node = first + F::Index::splat(level.start) + (y << level.row_bits) + x;
            let [a, b, c, d] = F::record(nodes, node);
            let (lower, v) = split(uy, a + b, c + d);
            let (p, q) = (F::select(lower, c, a), F::select(lower, d, b));
            let (right, w) = split(ux, p, q);
            weight = F::select(right, q, p);
            (ux, uy) = (w.min(below_one), v.min(below_one));
            let one = |m| F::Index::select(m, F::Index::splat(1), F::Index::splat(0));
            (x, y) = ((x << level.grows[0]) + one(right), (y << level.grows[1]) + one(lower));
        }
        Cell { x, y, u: [ux, uy], probability: weight }
    }
}

impl Grid {
    /// Cells chosen in proportion to finite, non-negative weights, `size[0]` to a row; `None` if they are all 0.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` weights.
    pub fn new(size: [u32; 2], weights: &[f32]) -> Option<Self> {
        let (tree, nodes, total) = Tree::new(size, weights);
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let nodes = nodes.iter().map(|sums| Record(sums.map(|v| v as f32))).collect();
        Some(Self { tree, nodes, scale: (1.0 / total) as f32 })
    }

    /// A cell, from u in [0, 1)².
    #[inline]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> Cell<F> {
        let cell = self.tree.descend(&self.nodes, F::Index::splat(0), u);
        Cell { probability: cell.probability * self.scale, ..cell }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes)
    }
}

impl Grids {
    /// None yet, all of `size[0]` columns and `size[1]` rows.
    pub fn new(size: [u32; 2]) -> Self {
        let (tree, nodes, _) = Tree::new(size, &vec![0.0; size[0] as usize * size[1] as usize]);
        Self { size, tree, stride: nodes.len() as u32, nodes: Vec::new() }
    }

    /// Adds a grid as [`Grid::new`] does; its number is how many there were. All 0 counts as all 1.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` weights.
    pub fn push(&mut self, weights: &[f32]) {
        let (_, mut nodes, mut total) = Tree::new(self.size, weights);
        if !(total > 0.0 && total.is_finite()) {
            (_, nodes, total) = Tree::new(self.size, &vec![1.0; weights.len()]);
        }
        self.nodes.extend(nodes.iter().map(|sums| Record(sums.map(|v| (v / total) as f32))));
    }

    /// A cell of a grid, from u in [0, 1)².
    #[inline]
    pub fn sample<F: Real>(&self, grid: F::Index, u: [F; 2]) -> Cell<F> {
        self.tree.descend(&self.nodes, grid * F::Index::splat(self.stride), u)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes)
    }
}

/// Whether u in [0, 1) falls to the second of two shares, and its place within the share.
#[inline(always)]
fn split<F: Real>(u: F, first: F, second: F) -> (F::Mask, F) {
    let at = u * (first + second);
    // A share of nothing is never taken, whatever rounding does.
    let takes_second = (at.ge(first) & second.gt(F::zero())) | first.le(F::zero());
    let within = F::select(takes_second, at - first, at) / F::select(takes_second, second, first);
    (takes_second, within.relu())
}

/// A place in [0, 1) of density linear from `a` to `b`, given u in [0, 1); 0 where both are 0.
#[inline(always)]
pub fn linear<F: Real>(u: F, a: F, b: F) -> F {
    let root = (a * a * (F::one() - u) + b * b * u).sqrt();
    let x = u * (a + b) / (a + root);
    F::select(x.gt(F::zero()), x, F::zero()).min(F::splat(super::sampler::ONE_MINUS_EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{chi2_square, random_pairs};
    use rebond_lanes::scalar::Index1;

    #[test]
    fn cells_have_their_shares() {
        for size in [[5, 4], [1, 10], [20, 1], [1, 1], [2, 5], [64, 3], [7, 9]] {
            let n = size[0] * size[1];
            let weights: Vec<f32> = (0..n).map(|i| [0.0, 1.0, 5.0, 0.2, 0.0, 30.0][(i * 7 + 1) as usize % 6]).collect();
            let total: f32 = weights.iter().sum();
            let grid = Grid::new(size, &weights).expect("some weight");
            let density = |x: u32, y: u32| weights[(y * size[0] + x) as usize] / total * n as f32;
            // The test's bins must not cut cells.
            if 20 % size[0] == 0 && 20 % size[1] == 0 {
                let place = |u: [f32; 2]| {
                    let c = grid.sample(u);
                    [(c.x.0 as f32 + c.u[0]) / size[0] as f32, (c.y.0 as f32 + c.u[1]) / size[1] as f32]
                };
                let at = |p: f32, n: u32| ((p * n as f32) as u32).min(n - 1);
                chi2_square("grid", place, |p| density(at(p[0], size[0]), at(p[1], size[1])));
            }
            for u in random_pairs(2000) {
                let c = grid.sample::<f32>(u);
                assert!(c.x.0 < size[0] && c.y.0 < size[1] && c.probability > 0.0);
                assert!((c.probability * n as f32 / density(c.x.0, c.y.0) - 1.0).abs() < 1e-5);
            }
        }
        assert!(Grid::new([2, 2], &[0.0; 4]).is_none());
    }

    #[test]
    fn grids_of_a_stack_are_the_grids_by_themselves() {
        for size in [[5, 4], [1, 10], [32, 64], [1, 1]] {
            let n = size[0] * size[1];
            let weights = |k: u32| (0..n).map(|i| ((i * 7 + k) % 6) as f32 + 0.5).collect::<Vec<f32>>();
            let mut stack = Grids::new(size);
            stack.push(&weights(0));
            stack.push(&vec![0.0; n as usize]);
            stack.push(&weights(3));
            for (number, weights) in [(0, weights(0)), (1, vec![1.0; n as usize]), (2, weights(3))] {
                let grid = Grid::new(size, &weights).expect("some weight");
                for u in random_pairs(500) {
                    let (a, b) = (stack.sample::<f32>(Index1(number), u), grid.sample::<f32>(u));
                    assert_eq!((a.x, a.y), (b.x, b.y));
                    assert!((a.probability / b.probability - 1.0).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn linear_densities() {
        for (a, b) in [(1.0_f32, 3.0), (2.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let density = |p: [f32; 2]| (a + (b - a) * p[0]) / (0.5 * (a + b));
            chi2_square("linear", |u| [linear(u[0], a, b), u[1]], density);
        }
        assert_eq!(linear(0.5, 0.0, 0.0), 0.0);
    }
}
