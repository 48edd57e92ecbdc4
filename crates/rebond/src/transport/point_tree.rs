//! The nearest of many points: a balanced kd-tree (Bentley 1975).
//!
//! It is implicit: node n has the children 2n + 1 and 2n + 2, halves of its points are told apart by their median along the longer
//! side of their bounds, and leaves, all at one depth, hold up to sixteen points, whose distances are computed at once.
//!
//! The k nearest are gathered in a list of 2k candidates. When it is full the farther half is dropped by selection, and the radius
//! shrinks to the k-th: constant work per candidate, where a heap would take log k.

use rebond_lanes::{F32x16, Mask, Real};

/// Points of a leaf at most.
const LEAF: usize = 16;

/// Points, ready to be asked.
#[derive(Clone, Debug, Default)]
pub struct PointTree {
    /// Levels of nodes above the leaves.
    depth: u32,
    /// Where each node is split, and along which axis.
    splits: Vec<(f32, u32)>,
    /// Coordinates, leaf by leaf; infinite where a leaf has fewer points.
    places: [Vec<f32>; 3],
    /// Which point is at each place; [`NOTHING`] where there is none.
    order: Vec<u32>,
}

/// At a place without a point.
pub const NOTHING: u32 = u32::MAX;

/// A point on its way to its leaf.
#[derive(Clone, Copy)]
struct Item {
    p: [f32; 3],
    number: u32,
}

/// What a query found, kept from one to the next.
#[derive(Clone, Debug, Default)]
pub struct Nearest {
    /// Bits of the squared distance, then place: whole numbers in the order of distance.
    candidates: Vec<u64>,
}

impl Nearest {
    /// The places found, each with its squared distance, in no order.
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> {
        self.candidates.iter().map(|c| (*c as u32 as usize, f32::from_bits((*c >> 32) as u32)))
    }
}

impl PointTree {
    /// A tree over these points, built by so many threads.
    pub fn new(points: &[[f32; 3]], threads: usize) -> Self {
        let depth = points.len().div_ceil(LEAF).max(1).next_power_of_two().ilog2();
        let (nodes, leaves) = ((1 << depth) - 1, 1 << depth);
        let mut items: Vec<Item> = points.iter().zip(0..).map(|(p, number)| Item { p: *p, number }).collect();
        let mut splits = vec![(0.0, 0); nodes];
        // Level by level: the nodes of one are slices of the items that have nothing to do with each other.
        let mut slices = vec![&mut items[..]];
        for level in 0..depth {
            let first = (1 << level) - 1;
            let nodes = &mut splits[first..2 * first + 1];
            let share = slices.len().div_ceil(threads.max(1));
            std::thread::scope(|scope| {
                for (slices, nodes) in slices.chunks_mut(share).zip(nodes.chunks_mut(share)) {
                    let work = move || slices.iter_mut().zip(nodes).for_each(|(items, node)| *node = halve(items));
                    if share < 1 << level { drop(scope.spawn(work)) } else { work() }
                }
            });
            slices = slices.into_iter().flat_map(|items| <[_; 2]>::from(items.split_at_mut(items.len() / 2))).collect();
        }
        let mut places = [0; 3].map(|_| vec![f32::INFINITY; leaves * LEAF]);
        let mut order = vec![NOTHING; leaves * LEAF];
        for (leaf, items) in slices.iter().enumerate() {
            for (i, item) in items.iter().enumerate() {
                (0..3).for_each(|axis| places[axis][leaf * LEAF + i] = item.p[axis]);
                order[leaf * LEAF + i] = item.number;
            }
        }
        Self { depth, splits, places, order }
    }

    /// The number of the point at each place, or [`NOTHING`].
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Bytes it takes.
    pub fn bytes(&self) -> usize {
        self.splits.len() * 8 + self.order.len() * 16
    }

    /// Finds the `k` nearest within a squared distance. Returns the squared distance of the k-th; the given one if they are fewer.
    pub fn nearest(&self, p: [f32; 3], k: usize, most: f32, found: &mut Nearest) -> f32 {
        let candidates = &mut found.candidates;
        candidates.clear();
        let capacity = k.saturating_mul(2).max(LEAF);
        let mut radius = most;
        self.visit(p, most, |place, d2, within| {
            // A hint: what is beyond the radius will not be visited.
            candidates.push(u64::from(d2.to_bits()) << 32 | place as u64);
            if candidates.len() >= capacity {
                radius = cut(candidates, k);
                *within = radius;
            }
        });
        if candidates.len() >= k && k > 0 {
            radius = cut(candidates, k);
        }
        radius
    }

    /// The nearest that passes, within a squared distance: its place and its squared distance.
    pub fn nearest_where(&self, p: [f32; 3], most: f32, passes: impl Fn(usize) -> bool) -> Option<(usize, f32)> {
        let mut best = None;
        self.visit(p, most, |place, d2, within| {
            if d2 < *within && passes(place) {
                *within = d2;
                best = Some((place, d2));
            }
        });
        best
    }

    /// Calls `f` for each point nearer than a squared distance, which `f` may lessen.
    #[inline(always)]
    fn visit(&self, p: [f32; 3], most: f32, mut f: impl FnMut(usize, f32, &mut f32)) {
        // Where a half was left for later: its node, and how far its box is from p along each axis.
        let mut stack = [(0_u32, [0.0_f32; 3]); 32];
        let mut waiting = 1;
        let mut within = most;
        let first_leaf = (1_u32 << self.depth) - 1;
        let at = p.map(F32x16::splat);
        while waiting > 0 {
            waiting -= 1;
            let (mut node, off) = stack[waiting];
            if off[0] * off[0] + off[1] * off[1] + off[2] * off[2] >= within {
                continue;
            }
            while node < first_leaf {
                let (split, axis) = self.splits[node as usize];
                let axis = axis as usize;
                let to = p[axis] - split;
                let below = to < 0.0;
                let (near, far) = if below { (2 * node + 1, 2 * node + 2) } else { (2 * node + 2, 2 * node + 1) };
                let mut beyond = off;
                beyond[axis] = to;
                stack[waiting] = (far, beyond);
                waiting += 1;
                node = near;
            }
            let from = (node - first_leaf) as usize * LEAF;
            let [x, y, z] = [0, 1, 2].map(|axis| F32x16::load(&self.places[axis][from..from + LEAF]) - at[axis]);
            let d2 = x * x + y * y + z * z;
            let mut lanes = d2.lt(F32x16::splat(within)).bits();
            if lanes == 0 {
                continue;
            }
            let mut distances = [0.0; LEAF];
            d2.store(&mut distances);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                f(from + lane, distances[lane], &mut within);
            }
        }
    }
}

/// Keeps the k nearest; the squared distance of the last of them.
fn cut(candidates: &mut Vec<u64>, k: usize) -> f32 {
    let (_, last, _) = candidates.select_nth_unstable(k - 1);
    let radius = f32::from_bits((*last >> 32) as u32);
    candidates.truncate(k);
    radius
}

/// Halves points at their median along the longest side of their bounds.
fn halve(items: &mut [Item]) -> (f32, u32) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in items.iter() {
        for i in 0..3 {
            low[i] = low[i].min(item.p[i]);
            high[i] = high[i].max(item.p[i]);
        }
    }
    let side = |i: &usize| high[*i] - low[*i];
    let axis = (0..3).max_by(|a, b| side(a).total_cmp(&side(b))).unwrap_or(0);
    if items.is_empty() {
        return (0.0, 0);
    }
    let middle = items.len() / 2;
    let (_, median, _) = items.select_nth_unstable_by(middle, |a, b| a.p[axis].total_cmp(&b.p[axis]));
    (median.p[axis], axis as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::seeded_pairs;

    /// The k nearest, and the nearest that passes, of points on planes, of equal points, of few and of none.
    #[test]
    fn finds_what_brute_force_finds() {
        for n in [0_u32, 1, 15, 16, 17, 100, 2500] {
            let pairs = seeded_pairs(n, 1).zip(seeded_pairs(n, 2));
            let point = |([x, y], [z, kind]): ([f32; 2], [f32; 2])| match kind {
                0.0..0.3 => [x, y, 0.5],
                0.3..0.4 => [0.25; 3],
                _ => [x, y, z],
            };
            let points: Vec<[f32; 3]> = pairs.map(point).collect();
            let tree = PointTree::new(&points, 1);
            let other = PointTree::new(&points, 3);
            assert_eq!((&tree.order, &tree.splits), (&other.order, &other.splits));
            let mut found = Nearest::default();
            for ([x, y], [z, _]) in seeded_pairs(100, 3).zip(seeded_pairs(100, 4)) {
                let q = [x, y, z];
                let d2 = |p: &[f32; 3]| (0..3).map(|i| (p[i] - q[i]) * (p[i] - q[i])).sum::<f32>();
                let mut distances: Vec<f32> = points.iter().map(d2).collect();
                distances.sort_by(f32::total_cmp);
                for (k, most) in
                    [(1, f32::INFINITY), (7, f32::INFINITY), (500, f32::INFINITY), (20, 0.05), (usize::MAX, 0.1)]
                {
                    let radius = tree.nearest(q, k, most, &mut found);
                    let expected: Vec<f32> = distances.iter().copied().filter(|d| *d < most).take(k).collect();
                    let mut got: Vec<f32> = found.iter().map(|(_, d2)| d2).collect();
                    got.sort_by(f32::total_cmp);
                    assert_eq!(got.len(), expected.len(), "{n} points, {k} nearest");
                    got.iter().zip(&expected).for_each(|(a, b)| assert!((a - b).abs() <= 1e-6 * b.abs().max(1e-3)));
                    assert_eq!(radius, if expected.len() < k { most } else { got[k - 1] });
                }
                let even = |place: usize| tree.order[place].is_multiple_of(2);
                let nearest = tree
                    .nearest_where(q, f32::INFINITY, even)
                    .map(|(place, _)| d2(&points[tree.order[place] as usize]));
                let expected = points.iter().step_by(2).map(d2).min_by(f32::total_cmp);
                assert_eq!(nearest, expected);
            }
        }
    }
}
