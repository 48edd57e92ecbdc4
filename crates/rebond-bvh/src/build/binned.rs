//! The binary tree by the surface area heuristic over bins.
//!
//! I. Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. Below [`SWEEP`] references the
//! heuristic is evaluated at every place (Macdonald and Booth 1990). The tree is a function of the references alone:
//! maxima and counts do not depend on the order of threads, and its parts are put together in their own order.

use super::bounds::{Binary, Bounds, F4, Reference};
use crate::simd::Lanes;
use rayon::prelude::*;

/// Most bins along an axis.
pub(crate) const BINS: usize = 32;
/// Up to so many references all splits are tried.
pub(crate) const SWEEP: usize = 6;
/// Below this depth, halves by number: no input makes the tree deeper than this and 32.
const DEEP: u32 = 64;
/// Of more references than this, a coarse build looks at every fourth.
const SAMPLED: usize = 4096;
/// Subtrees above this are built side by side.
const PARALLEL: usize = 2048;
/// Nodes above this are binned by several threads.
const PARALLEL_BINS: usize = 1 << 16;

/// How far the tree goes down, and how closely it looks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    /// Most references of a leaf.
    pub leaf: usize,
    /// Halve by number everywhere.
    pub balanced: bool,
    /// Fewer bins.
    pub coarse: bool,
}

/// The tree over `references`, which it reorders, n > 0: its root first, every subtree in one piece and behind its
/// parent, the left side's before the right side's.
pub(crate) fn build(references: &mut [Reference], shape: Shape) -> Vec<Binary> {
    let (bounds, centers) = references
        .par_chunks(PARALLEL_BINS / 8)
        .map(enclose)
        .reduce(|| (Bounds::EMPTY, Bounds::EMPTY), |a, b| (a.0.or(&b.0), a.1.or(&b.1)));
    let all = Piece { references, first: 0, bounds, centers, depth: 0 };
    if shape.leaf == 1 {
        let mut nodes = Binary::places(2 * all.references.len() - 1);
        all.fill(shape, &mut nodes, 0);
        return nodes;
    }
    all.part(shape).into_nodes()
}

/// The box of the references and that of their centres.
pub(crate) fn enclose(references: &[Reference]) -> (Bounds, Bounds) {
    references.iter().fold((Bounds::EMPTY, Bounds::EMPTY), |(b, c), r| (b.or(&r.bounds), c.or(&r.bounds.center2_box())))
}

/// Some references on their way down the tree.
struct Piece<'a> {
    references: &'a mut [Reference],
    /// The place of the first.
    first: u32,
    bounds: Bounds,
    centers: Bounds,
    depth: u32,
}

/// A part of the tree.
enum Part {
    Fork(Bounds, Box<(Part, Part)>),
    /// Children as places in the list.
    Subtree(Vec<Binary>),
}

impl Piece<'_> {
    /// Puts a tree whose leaves have one reference each where it stays: n of them make 2n − 1 nodes, of which the first
    /// has the number `base`.
    fn fill(self, shape: Shape, nodes: &mut [Binary], base: u32) {
        let n = self.references.len();
        if n == 1 {
            nodes[0] = Binary::leaf(&self.bounds, self.first, 1);
            return;
        }
        let bounds = self.bounds;
        let (left, right) = self.split(shape);
        let middle = 2 * left.references.len();
        let (head, tail) = nodes.split_at_mut(middle);
        let right_base = base + middle as u32;
        head[0] = Binary::new(&bounds, base + 1, right_base);
        let fill_left = || left.fill(shape, &mut head[1..], base + 1);
        let fill_right = || right.fill(shape, tail, right_base);
        if n > PARALLEL {
            rayon::join(fill_left, fill_right);
        } else {
            fill_left();
            fill_right();
        }
    }

    /// Built by several threads as far as that pays.
    fn part(self, shape: Shape) -> Part {
        if self.references.len() <= PARALLEL {
            let mut nodes = Vec::with_capacity(2 * self.references.len() / 3);
            self.subtree(shape, &mut nodes);
            return Part::Subtree(nodes);
        }
        let bounds = self.bounds;
        let (left, right) = self.split(shape);
        Part::Fork(bounds, Box::new(rayon::join(|| left.part(shape), || right.part(shape))))
    }

    fn subtree(self, shape: Shape, nodes: &mut Vec<Binary>) {
        let n = self.references.len();
        if n <= shape.leaf {
            nodes.push(Binary::leaf(&self.bounds, self.first, n as u32));
            return;
        }
        let place = nodes.len();
        nodes.push(Binary::new(&self.bounds, place as u32 + 1, 0));
        let (left, right) = self.split(shape);
        left.subtree(shape, nodes);
        nodes[place].right = nodes.len() as u32;
        right.subtree(shape, nodes);
    }

    fn split(self, shape: Shape) -> (Self, Self) {
        let Self { references, first, centers, depth, .. } = self;
        let n = references.len();
        let (middle, left, right) = if n == 2 {
            let side = |r: &Reference| (r.bounds, r.bounds.center2_box());
            (1, side(&references[0]), side(&references[1]))
        } else if shape.balanced || depth > DEEP {
            halve(references, &centers)
        } else if n <= SWEEP {
            sweep(references, &centers)
        } else {
            match best_split(references, &centers, shape.coarse) {
                Some(split) => split.partition(references),
                None => halve(references, &centers),
            }
        };
        let (here, there) = references.split_at_mut(middle);
        let piece =
            |references, first, (bounds, centers)| Self { references, first, bounds, centers, depth: depth + 1 };
        (piece(here, first, left), piece(there, first + middle as u32, right))
    }
}

impl Part {
    fn into_nodes(self) -> Vec<Binary> {
        if let Self::Subtree(nodes) = self {
            return nodes;
        }
        let mut nodes = Vec::with_capacity(self.len());
        self.put(&mut nodes);
        nodes
    }
    fn len(&self) -> usize {
        match self {
            Self::Fork(_, sides) => 1 + sides.0.len() + sides.1.len(),
            Self::Subtree(nodes) => nodes.len(),
        }
    }
    fn put(self, nodes: &mut Vec<Binary>) {
        let place = nodes.len();
        match self {
            Self::Fork(bounds, sides) => {
                nodes.push(Binary::new(&bounds, place as u32 + 1, 0));
                sides.0.put(nodes);
                nodes[place].right = nodes.len() as u32;
                sides.1.put(nodes);
            }
            Self::Subtree(subtree) => nodes.extend(subtree.into_iter().map(|mut node| {
                if node.count().is_none() {
                    node.left += place as u32;
                    node.right += place as u32;
                }
                node
            })),
        }
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

/// The best of all splits along the three axes, for 2 to [`SWEEP`] references.
pub(crate) fn sweep(references: &mut [Reference], centers: &Bounds) -> Halves {
    let n = references.len();
    let mut best = (f32::INFINITY, n / 2, [0, 1, 2, 3, 4, 5]);
    for axis in 0..3 {
        if !(centers.0[axis] + centers.0[4 + axis] > 0.0) {
            continue;
        }
        let order = sorted(references, axis);
        let mut right = [0.0; SWEEP];
        let mut bounds = Bounds::EMPTY;
        for i in (1..n).rev() {
            bounds = bounds.or(&references[order[i]].bounds);
            right[i] = bounds.area() * (n - i) as f32;
        }
        bounds = Bounds::EMPTY;
        for i in 1..n {
            bounds = bounds.or(&references[order[i - 1]].bounds);
            let cost = bounds.area() * i as f32 + right[i];
            if cost < best.0 {
                best = (cost, i, order);
            }
        }
    }
    let (_, middle, order) = best;
    let mut copy = [references[0]; SWEEP];
    copy[..n].copy_from_slice(references);
    for (r, &i) in references.iter_mut().zip(&order) {
        *r = copy[i];
    }
    let (left, right) = references.split_at(middle);
    (middle, enclose(left), enclose(right))
}

/// The places of up to [`SWEEP`] references in order of their centres; equal ones as they lie.
fn sorted(references: &[Reference], axis: usize) -> [usize; SWEEP] {
    let mut keys = [f32::INFINITY; SWEEP];
    for (key, r) in keys.iter_mut().zip(references) {
        let x = r.bounds.center2(axis);
        *key = if x.is_nan() { 0.0 } else { x };
    }
    let mut order = [0; SWEEP];
    for i in 0..references.len() {
        let before = |j: usize| usize::from(if j < i { keys[j] <= keys[i] } else { keys[j] < keys[i] });
        let rank: usize = (0..SWEEP).map(before).sum();
        order[rank] = i;
    }
    order
}

/// Bins along three axes.
struct Bins<const N: usize> {
    bounds: [[Bounds; N]; 3],
    counts: [[u32; N]; 3],
}

/// Which bin a centre falls into.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    lo2: [f32; 4],
    /// 0 along axes that have no extent.
    scale: [f32; 4],
    last: f32,
}

/// Adding it to a small number rounds that to the nearest integer and leaves it in the lowest bits.
const ROUND: f32 = 12_582_912.0;

impl Grid {
    fn new(centers: &Bounds, bins: usize) -> Self {
        let mut grid = Self { lo2: [0.0; 4], scale: [0.0; 4], last: (bins - 1) as f32 };
        for k in 0..3 {
            let scale = bins as f32 * 0.9999 / (centers.0[4 + k] + centers.0[k]);
            if scale.is_finite() {
                (grid.lo2[k], grid.scale[k]) = (centers.lo(k), scale);
            }
        }
        grid
    }
    #[inline(always)]
    fn place(&self, center2: f32, k: usize) -> u32 {
        let x = (center2 - self.lo2[k]) * self.scale[k] - 0.5;
        let x = if x > 0.0 { x } else { 0.0 };
        let x = if x < self.last { x } else { self.last };
        (x + ROUND).to_bits()
    }
    /// The bins of a centre along x, y and z, in the lowest bits.
    #[inline(always)]
    fn places(&self, bounds: &Bounds) -> [u32; 4] {
        let x = bounds.centers2().sub(F4::load(&self.lo2)).mul(F4::load(&self.scale)).sub(F4::splat(0.5));
        x.max(F4::splat(0.0)).min(F4::splat(self.last)).add(F4::splat(ROUND)).array().map(f32::to_bits)
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
    /// The two sides' boxes,
    pub sides: [Bounds; 2],
    /// unless only some of the references were looked at.
    sampled: bool,
}

/// The cheapest split; none if all centres are the same.
pub(crate) fn best_split(references: &[Reference], centers: &Bounds, coarse: bool) -> Option<Split> {
    let n = if coarse { references.len() / 4 } else { references.len() };
    let step = if coarse && references.len() > SAMPLED { 4 } else { 1 };
    let split = match n {
        0..=3 => Bins::<4>::of(references, 1, centers).best(centers),
        4..=32 => Bins::<8>::of(references, 1, centers).best(centers),
        33..=512 => Bins::<16>::of(references, 1, centers).best(centers),
        _ if references.len() <= PARALLEL_BINS => Bins::<BINS>::of(references, step, centers).best(centers),
        _ => references
            .par_chunks(PARALLEL_BINS / 4)
            .map(|chunk| Bins::<BINS>::of(chunk, step, centers))
            .reduce_with(Bins::and)
            .and_then(|bins| bins.best(centers)),
    };
    split.map(|split| Split { sampled: step > 1, ..split })
}

impl<const N: usize> Bins<N> {
    fn of(references: &[Reference], step: usize, centers: &Bounds) -> Self {
        let grid = Grid::new(centers, N);
        let mut bins = Self { bounds: [[Bounds::EMPTY; N]; 3], counts: [[0; N]; 3] };
        for r in references.iter().step_by(step) {
            let places = grid.places(&r.bounds);
            for k in 0..3 {
                let bin = places[k] as usize & (N - 1);
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
    fn best(&self, centers: &Bounds) -> Option<Split> {
        let grid = Grid::new(centers, N);
        // The first of equals; areas beyond f32 leave every cost infinite, and any split will do.
        let mut best: Option<(f32, usize, usize)> = None;
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
                right[i] = (bounds.area() * count as f32, count);
            }
            (bounds, count) = (Bounds::EMPTY, 0);
            for i in 1..N {
                bounds = bounds.or(&self.bounds[axis][i - 1]);
                count += self.counts[axis][i - 1];
                let (right_cost, right_count) = right[i];
                let cost = bounds.area() * count as f32 + right_cost;
                if count > 0 && right_count > 0 && best.is_none_or(|best| cost < best.0) {
                    best = Some((cost, axis, i));
                }
            }
        }
        best.map(|(cost, axis, bin)| {
            let sides = [&self.bounds[axis][..bin], &self.bounds[axis][bin..]]
                .map(|bins| bins.iter().fold(Bounds::EMPTY, |bounds, b| bounds.or(b)));
            Split { cost, axis, bin, grid, sides, sampled: false }
        })
    }
}

impl Split {
    /// Moves the left side's references before the right side's.
    pub fn partition(&self, references: &mut [Reference]) -> Halves {
        if self.sampled { self.move_all::<true>(references) } else { self.move_all::<false>(references) }
    }

    #[inline(always)]
    fn move_all<const SAMPLED: bool>(&self, references: &mut [Reference]) -> Halves {
        let first_right = self.bin as u32 + ROUND.to_bits();
        let mut middle = 0;
        let (mut left, mut right) = (Bounds::EMPTY, Bounds::EMPTY);
        let mut sides = if SAMPLED { [Bounds::EMPTY; 2] } else { self.sides };
        for i in 0..references.len() {
            // Without a branch, which would be mispredicted half of the time: the right side's first changes places
            // with this one, whichever side this one is of.
            let r = references[i];
            let is_left = self.grid.place(r.bounds.center2(self.axis), self.axis) < first_right;
            let center = r.bounds.center2_box();
            left = left.or(&center.or_empty(is_left));
            right = right.or(&center.or_empty(!is_left));
            if SAMPLED {
                sides = [sides[0].or(&r.bounds.or_empty(is_left)), sides[1].or(&r.bounds.or_empty(!is_left))];
            }
            references[i] = references[middle];
            references[middle] = r;
            middle += usize::from(is_left);
        }
        (middle, (sides[0], left), (sides[1], right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(boxes: &[([f32; 3], [f32; 3])], shape: Shape) -> (Vec<Reference>, Vec<Binary>) {
        let mut references: Vec<_> =
            boxes.iter().enumerate().map(|(i, b)| Reference::new(Bounds::new(b.0, b.1), i as u32)).collect();
        let nodes = build(&mut references, shape);
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
        let huge: Vec<_> = spread.iter().map(|(lo, hi)| (*lo, *hi)).chain([([f32::MIN; 3], [f32::MAX; 3])]).collect();
        for boxes in [&spread[..], &same, &skewed, &huge, &spread[..1], &spread[..2], &spread[..3]] {
            for shape in [
                Shape { leaf: 1, balanced: false, coarse: false },
                Shape { leaf: 4, balanced: false, coarse: true },
                Shape { leaf: 1, balanced: true, coarse: false },
            ] {
                let (references, nodes) = tree(boxes, shape);
                let mut found = primitives(&references, &nodes, 0, 0);
                found.sort_unstable();
                assert!(found.iter().copied().eq(0..boxes.len() as u32));
            }
        }
    }
}
