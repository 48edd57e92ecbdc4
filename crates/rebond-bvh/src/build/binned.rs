//! The binary tree by the surface area heuristic over bins.
//!
//! I. Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. Below [`SWEEP`] references the
//! heuristic is evaluated at every place (Macdonald and Booth 1990). The tree is a function of the references alone:
//! every node knows its places in the arrays beforehand, and maxima and counts do not depend on the order of threads.

use super::bounds::{Binary, Bounds, Reference};
use rayon::prelude::*;

pub(crate) const BINS: usize = 32;
/// Up to so many references all splits are tried.
pub(crate) const SWEEP: usize = 6;
/// Below this depth, halves by number: no input makes the tree deeper than this and 32.
const DEEP: u32 = 64;
/// Subtrees above this are built side by side.
const PARALLEL: usize = 2048;
/// Nodes above this are binned by several threads.
const PARALLEL_BINS: usize = 1 << 16;

/// How far the tree goes down, and whether it looks at areas at all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Most references of a leaf.
    pub leaf: usize,
    /// Halve by number everywhere.
    pub balanced: bool,
}

/// Fills `nodes` with the tree over `references` and reorders those. `nodes` has 2·n − 1 places, n > 0; its first is
/// the root.
pub(crate) fn build(references: &mut [Reference], nodes: &mut [Binary], shape: Shape) {
    let (bounds, centers) = references
        .par_chunks(PARALLEL_BINS / 8)
        .map(enclose)
        .reduce(|| (Bounds::EMPTY, Bounds::EMPTY), |a, b| (a.0.or(&b.0), a.1.or(&b.1)));
    subtree(references, nodes, (0, 0), bounds, centers, 0, shape);
}

/// The box of the references and that of their centres.
pub(crate) fn enclose(references: &[Reference]) -> (Bounds, Bounds) {
    references.iter().fold((Bounds::EMPTY, Bounds::EMPTY), |(b, c), r| (b.or(&r.bounds), c.or(&r.bounds.center2_box())))
}

fn subtree(
    references: &mut [Reference],
    nodes: &mut [Binary],
    (first, base): (u32, u32),
    bounds: Bounds,
    centers: Bounds,
    depth: u32,
    shape: Shape,
) {
    let n = references.len();
    if n <= shape.leaf {
        nodes[0] = Binary::leaf(&bounds, first, n as u32);
        return;
    }
    let (middle, left, right) = if n == 2 {
        let side = |r: &Reference| (r.bounds, r.bounds.center2_box());
        (1, side(&references[0]), side(&references[1]))
    } else if shape.balanced || depth > DEEP {
        halve(references, &centers)
    } else if n <= SWEEP {
        sweep(references, &centers)
    } else {
        match best_split(references, &centers) {
            Some(split) => split.partition(references),
            None => halve(references, &centers),
        }
    };
    let (references_left, references_right) = references.split_at_mut(middle);
    let (head, tail) = nodes.split_at_mut(2 * middle);
    let right_base = base + 2 * middle as u32;
    head[0] = Binary::new(&bounds, base + 1, right_base);
    let mut build_left =
        || subtree(references_left, &mut head[1..], (first, base + 1), left.0, left.1, depth + 1, shape);
    let mut build_right = || {
        let places = (first + middle as u32, right_base);
        subtree(references_right, tail, places, right.0, right.1, depth + 1, shape);
    };
    if n > PARALLEL {
        rayon::join(build_left, build_right);
    } else {
        build_left();
        build_right();
    }
}

type Halves = (usize, (Bounds, Bounds), (Bounds, Bounds));

/// Two halves by number along the widest axis.
pub(crate) fn halve(references: &mut [Reference], centers: &Bounds) -> Halves {
    let axis = widest(centers);
    let middle = references.len() / 2;
    references.select_nth_unstable_by(middle, |a, b| {
        a.bounds.center2(axis).total_cmp(&b.bounds.center2(axis)).then(a.primitive().cmp(&b.primitive()))
    });
    let (left, right) = references.split_at(middle);
    (middle, enclose(left), enclose(right))
}

fn widest(centers: &Bounds) -> usize {
    let e: [f32; 3] = std::array::from_fn(|k| centers.0[4 + k] + centers.0[k]);
    if e[0] >= e[1] && e[0] >= e[2] {
        0
    } else if e[1] >= e[2] {
        1
    } else {
        2
    }
}

/// The best of all splits along the three axes, for a handful of references.
pub(crate) fn sweep(references: &mut [Reference], centers: &Bounds) -> Halves {
    let n = references.len();
    let mut best = (f32::INFINITY, 0, n / 2);
    let mut sorted = [0; 3];
    for axis in 0..3 {
        if !(centers.0[axis] + centers.0[4 + axis] > 0.0) {
            continue;
        }
        sort(references, axis);
        sorted[axis] = 1;
        let mut right = [0.0; SWEEP];
        let mut bounds = Bounds::EMPTY;
        for i in (1..n).rev() {
            bounds = bounds.or(&references[i].bounds);
            right[i] = bounds.area() * (n - i) as f32;
        }
        bounds = Bounds::EMPTY;
        for i in 1..n {
            bounds = bounds.or(&references[i - 1].bounds);
            let cost = bounds.area() * i as f32 + right[i];
            if cost < best.0 {
                best = (cost, axis, i);
            }
        }
    }
    // The references lie in the order of the last axis that was tried.
    if (best.1 + 1..3).any(|axis| sorted[axis] == 1) {
        sort(references, best.1);
    }
    let (left, right) = references.split_at(best.2);
    (best.2, enclose(left), enclose(right))
}

fn sort(references: &mut [Reference], axis: usize) {
    for i in 1..references.len() {
        let x = references[i];
        let mut j = i;
        while j > 0 && before(&x, &references[j - 1], axis) {
            references[j] = references[j - 1];
            j -= 1;
        }
        references[j] = x;
    }
}

#[inline(always)]
fn before(a: &Reference, b: &Reference, axis: usize) -> bool {
    let (x, y) = (a.bounds.center2(axis), b.bounds.center2(axis));
    x < y || x == y && a.primitive() < b.primitive()
}

/// Bins along three axes.
struct Bins<const N: usize> {
    bounds: [[Bounds; N]; 3],
    counts: [[u32; N]; 3],
}

/// Which bin a centre falls into.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    lo2: [f32; 3],
    scale: [f32; 3],
    bins: usize,
}

impl Grid {
    pub fn new(centers: &Bounds, n: usize) -> Self {
        let bins = if n <= 32 {
            8
        } else if n <= 512 {
            16
        } else {
            BINS
        };
        Self {
            lo2: std::array::from_fn(|k| centers.lo(k)),
            scale: std::array::from_fn(|k| {
                let extent = centers.0[4 + k] + centers.0[k];
                if extent > 0.0 { bins as f32 * 0.9999 / extent } else { 0.0 }
            }),
            bins,
        }
    }
    #[inline(always)]
    fn bin(&self, bounds: &Bounds, k: usize) -> usize {
        let x = (bounds.center2(k) - self.lo2[k]) * self.scale[k];
        (x as i32 as usize).min(self.bins - 1)
    }
}

/// A place to split at.
#[derive(Clone, Copy)]
pub(crate) struct Split {
    pub cost: f32,
    axis: usize,
    /// First bin of the right side.
    bin: usize,
    grid: Grid,
    /// The two sides' boxes.
    pub sides: [Bounds; 2],
}

/// The cheapest split; none if all centres fall into one bin.
pub(crate) fn best_split(references: &[Reference], centers: &Bounds) -> Option<Split> {
    let grid = Grid::new(centers, references.len());
    match grid.bins {
        8 => Bins::<8>::of(references, &grid).best(grid),
        16 => Bins::<16>::of(references, &grid).best(grid),
        _ if references.len() <= PARALLEL_BINS => Bins::<BINS>::of(references, &grid).best(grid),
        _ => references
            .par_chunks(PARALLEL_BINS / 4)
            .map(|chunk| Bins::<BINS>::of(chunk, &grid))
            .reduce_with(Bins::and)
            .and_then(|bins| bins.best(grid)),
    }
}

impl<const N: usize> Bins<N> {
    fn of(references: &[Reference], grid: &Grid) -> Self {
        let mut bins = Self { bounds: [[Bounds::EMPTY; N]; 3], counts: [[0; N]; 3] };
        for r in references {
            for k in 0..3 {
                let bin = grid.bin(&r.bounds, k) & (N - 1);
                bins.counts[k][bin] += 1;
                bins.bounds[k][bin] = bins.bounds[k][bin].or(&r.bounds);
            }
        }
        bins
    }
    fn and(mut self, other: Self) -> Self {
        for k in 0..3 {
            for i in 0..N {
                self.bounds[k][i] = self.bounds[k][i].or(&other.bounds[k][i]);
                self.counts[k][i] += other.counts[k][i];
            }
        }
        self
    }
    fn best(&self, grid: Grid) -> Option<Split> {
        let mut best: Option<Split> = None;
        for axis in 0..3 {
            if grid.scale[axis] == 0.0 {
                continue;
            }
            let mut right = [(0.0, 0_u32); N];
            let mut bounds = Bounds::EMPTY;
            let mut count = 0;
            for i in (1..N).rev() {
                bounds = bounds.or(&self.bounds[axis][i]);
                count += self.counts[axis][i];
                right[i] = (bounds.area(), count);
            }
            (bounds, count) = (Bounds::EMPTY, 0);
            for i in 1..N {
                bounds = bounds.or(&self.bounds[axis][i - 1]);
                count += self.counts[axis][i - 1];
                let (right_area, right_count) = right[i];
                let cost = bounds.area() * count as f32 + right_area * right_count as f32;
                let cost = if count == 0 || right_count == 0 { f32::NAN } else { cost };
                // Areas beyond f32 leave every cost infinite: the first split will do.
                let better = best.as_ref().map_or(!cost.is_nan(), |b| cost < b.cost);
                if better {
                    best = Some(Split { cost, axis, bin: i, grid, sides: [bounds, Bounds::EMPTY] });
                }
            }
        }
        if let Some(split) = &mut best {
            split.sides[1] = self.bounds[split.axis][split.bin..].iter().fold(Bounds::EMPTY, |bounds, b| bounds.or(b));
        }
        best
    }
}

impl Split {
    /// Moves the left side's references to the front.
    pub fn partition(&self, references: &mut [Reference]) -> Halves {
        let is_left = |r: &Reference| self.grid.bin(&r.bounds, self.axis) < self.bin;
        let (mut i, mut j) = (0, references.len());
        let (mut left, mut right) = (Bounds::EMPTY, Bounds::EMPTY);
        loop {
            while i < j && is_left(&references[i]) {
                left = left.or(&references[i].bounds.center2_box());
                i += 1;
            }
            while i < j && !is_left(&references[j - 1]) {
                right = right.or(&references[j - 1].bounds.center2_box());
                j -= 1;
            }
            if i >= j {
                break;
            }
            references.swap(i, j - 1);
        }
        (i, (self.sides[0], left), (self.sides[1], right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(boxes: &[([f32; 3], [f32; 3])], shape: Shape) -> (Vec<Reference>, Vec<Binary>) {
        let mut references: Vec<_> =
            boxes.iter().enumerate().map(|(i, b)| Reference::new(Bounds::new(b.0, b.1), i as u32)).collect();
        let mut nodes = Binary::places(2 * boxes.len() - 1);
        build(&mut references, &mut nodes, shape);
        (references, nodes)
    }

    /// Checks the boxes and returns the leaves' primitives.
    fn primitives(references: &[Reference], nodes: &[Binary], at: u32, depth: u32) -> Vec<u32> {
        let node = &nodes[at as usize];
        assert!(depth < 100);
        if let Some(count) = node.count() {
            return references[node.left as usize..][..count as usize].iter().map(|r| r.primitive()).collect();
        }
        let mut all = Vec::new();
        for child in [node.left, node.right] {
            let inside = nodes[child as usize].bounds().corners();
            let outside = node.bounds().corners();
            assert!((0..3).all(|k| outside.0[k] <= inside.0[k] && inside.1[k] <= outside.1[k]));
            all.extend(primitives(references, nodes, child, depth + 1));
        }
        all
    }

    #[test]
    fn every_primitive_once() {
        let n = if cfg!(miri) { 60 } else { 1000 };
        let spread: Vec<_> = (0..n)
            .map(|i| {
                let p = [(i * 37 % 101) as f32, (i * 53 % 97) as f32, (i % 7) as f32];
                (p, p.map(|x| x + 1.0))
            })
            .collect();
        let same = vec![([1.0; 3], [2.0; 3]); n / 3];
        let skewed: Vec<_> =
            (0..n as i32 / 4).map(|i| ([2.0_f32.powi(i - 125); 3], [2.0_f32.powi(i - 125); 3])).collect();
        for boxes in [&spread[..], &same, &skewed, &spread[..1], &spread[..2], &spread[..3]] {
            for shape in [
                Shape { leaf: 1, balanced: false },
                Shape { leaf: 4, balanced: false },
                Shape { leaf: 1, balanced: true },
            ] {
                let (references, nodes) = tree(boxes, shape);
                let mut found = primitives(&references, &nodes, 0, 0);
                found.sort_unstable();
                assert!(found.iter().copied().eq(0..boxes.len() as u32));
            }
        }
    }
}
