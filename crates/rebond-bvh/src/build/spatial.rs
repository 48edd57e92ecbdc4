//! The binary tree with spatial splits: where the boxes of a node's two sides overlap, triangles may be cut at a plane
//! and go to both.
//!
//! M. Stich, H. Friedrich, A. Dietrich, "Spatial Splits in Bounding Volume Hierarchies", HPG 2009. Every node owns a
//! range of the references with room for those that cuts will add, shared out to its sides by number, so that the tree
//! is built side by side and is the same for any number of threads.

use super::binned::{SWEEP, best_split, enclose, halve, sweep};
use super::bounds::{Binary, Bounds, Reference};
use super::collapse::Primitives;

/// Most places where a plane may cut, and one.
const BINS: usize = 16;
/// Boxes that overlap by less than this part of the root's area, or of the node's, are left alone.
const OVERLAP: f32 = 1e-5;
const OVERLAP_HERE: f32 = 0.03;
/// Fewer references than this are not cut.
const FEWEST: usize = 4;
/// Below this depth nothing is cut, below the next one halves are made by number.
const DEEP: u32 = 48;
const TOO_DEEP: u32 = 64;
/// Subtrees above this are built side by side.
const PARALLEL: usize = 1024;

/// Fills `nodes`, 2 · places − 1 of them, with the tree over the first `n` of `references`, whose other places are room
/// for more.
pub(crate) fn build(references: &mut [Reference], n: usize, nodes: &mut [Binary], primitives: &impl Primitives) {
    let (bounds, centers) = enclose(&references[..n]);
    let builder = Builder { primitives, least_overlap: OVERLAP * bounds.area() };
    builder.subtree(references, n, nodes, (0, 0), bounds, centers, 0);
}

struct Builder<'a, P> {
    primitives: &'a P,
    least_overlap: f32,
}

/// A plane across an axis.
#[derive(Clone, Copy)]
struct Cut {
    cost: f32,
    axis: usize,
    at: f32,
}

impl<P: Primitives> Builder<'_, P> {
    #[allow(clippy::too_many_arguments)]
    fn subtree(
        &self,
        references: &mut [Reference],
        n: usize,
        nodes: &mut [Binary],
        (first, base): (u32, u32),
        bounds: Bounds,
        centers: Bounds,
        depth: u32,
    ) {
        if n == 1 {
            nodes[0] = Binary::leaf(&bounds, first, 1);
            return;
        }
        let room = references.len();
        let split = if depth > TOO_DEEP { None } else { best_split(&references[..n], &centers, false) };
        let overlap = split.map_or(f32::INFINITY, |split| split.sides[0].and(&split.sides[1]).area());
        let least_overlap = self.least_overlap.max(OVERLAP_HERE * bounds.area());
        let cut = if room > n && n >= FEWEST && depth < DEEP && overlap > least_overlap {
            self.best_cut(&references[..n], &bounds, split.map_or(f32::INFINITY, |split| split.cost))
        } else {
            None
        };
        let sides = cut.and_then(|cut| self.cut(references, n, cut));
        let (left, right) = sides.unwrap_or_else(|| {
            let here = &mut references[..n];
            let (middle, left, right) = match split {
                Some(_) if n <= SWEEP => sweep(here, &centers),
                Some(split) => split.partition(here),
                None => halve(here, &centers),
            };
            ((middle, left), (n - middle, right))
        });
        // The left side's references lie at the front, the right side's behind them. Share out the room.
        let ((nl, left), (nr, right)) = (left, right);
        let room_left = nl + (room - nl - nr) * nl / (nl + nr);
        references.copy_within(nl..nl + nr, room_left);
        let (references_left, references_right) = references.split_at_mut(room_left);
        let (head, tail) = nodes.split_at_mut(2 * room_left);
        let right_base = base + 2 * room_left as u32;
        head[0] = Binary::new(&bounds, base + 1, right_base);
        let mut build_left = || {
            self.subtree(references_left, nl, &mut head[1..], (first, base + 1), left.0, left.1, depth + 1);
        };
        let mut build_right = || {
            let places = (first + room_left as u32, right_base);
            self.subtree(references_right, nr, tail, places, right.0, right.1, depth + 1);
        };
        if n > PARALLEL {
            rayon::join(build_left, build_right);
        } else {
            build_left();
            build_right();
        }
    }

    /// The cheapest plane, if cheaper than `limit`.
    fn best_cut(&self, references: &[Reference], bounds: &Bounds, limit: f32) -> Option<Cut> {
        let mut best: Option<Cut> = None;
        let bins = (references.len() / 2).clamp(4, BINS);
        for axis in 0..3 {
            let (lo, hi) = (bounds.lo(axis), bounds.hi(axis));
            let scale = bins as f32 * 0.9999 / (hi - lo);
            if !(hi > lo && scale.is_finite()) {
                continue;
            }
            let plane = |i: usize| lo + (hi - lo) * (i as f32 / bins as f32);
            let bin = |x: f32| (((x - lo) * scale) as usize).min(bins - 1);
            let mut boxes = [Bounds::EMPTY; BINS];
            let mut first = [0_u32; BINS];
            let mut last = [0_u32; BINS];
            for r in references {
                let (a, b) = (bin(r.bounds.lo(axis)), bin(r.bounds.hi(axis)));
                first[a] += 1;
                last[b] += 1;
                let mut rest = *r;
                for i in a..b {
                    let (left, right) = self.halves(&rest, axis, plane(i + 1));
                    boxes[i] = boxes[i].or(&left);
                    rest.bounds = Reference::new(right, r.primitive()).bounds;
                }
                boxes[b] = boxes[b].or(&rest.bounds);
            }
            let mut right_costs = [(0.0, 0); BINS];
            let (mut right, mut count) = (Bounds::EMPTY, 0);
            for i in (1..bins).rev() {
                right = right.or(&boxes[i]);
                count += last[i];
                right_costs[i] = (right.area(), count);
            }
            let (mut left, mut count) = (Bounds::EMPTY, 0);
            for i in 1..bins {
                left = left.or(&boxes[i - 1]);
                count += first[i - 1];
                let (right_area, right_count) = right_costs[i];
                let cost = left.area() * count as f32 + right_area * right_count as f32;
                if count > 0 && right_count > 0 && cost < best.map_or(limit, |b| b.cost) {
                    best = Some(Cut { cost, axis, at: plane(i) });
                }
            }
        }
        best
    }

    /// Puts the left side's references in front of the right side's; none if there is not enough room or nothing is
    /// gained.
    #[allow(clippy::type_complexity)]
    fn cut(
        &self,
        references: &mut [Reference],
        n: usize,
        cut: Cut,
    ) -> Option<((usize, (Bounds, Bounds)), (usize, (Bounds, Bounds)))> {
        let Cut { axis, at, .. } = cut;
        let (mut left, mut right, mut across) = (Vec::new(), Vec::new(), Vec::new());
        for &r in &references[..n] {
            if r.bounds.hi(axis) <= at {
                left.push(r);
            } else if r.bounds.lo(axis) >= at {
                right.push(r);
            } else {
                across.push(r);
            }
        }
        let mut boxes = [enclose(&left).0, enclose(&right).0];
        let halves: Vec<_> = across.iter().map(|r| self.halves(r, axis, at)).collect();
        for (a, b) in &halves {
            boxes = [boxes[0].or(a), boxes[1].or(b)];
        }
        let (mut nl, mut nr) = ((left.len() + across.len()) as f32, (right.len() + across.len()) as f32);
        for (r, (a, b)) in across.iter().zip(halves) {
            // Leaving a triangle whole on one side may be cheaper: the paper's section 4.4.
            let split = boxes[0].area() * nl + boxes[1].area() * nr;
            let wide = [boxes[0].or(&r.bounds), boxes[1].or(&r.bounds)];
            let only_left = wide[0].area() * nl + boxes[1].area() * (nr - 1.0);
            let only_right = boxes[0].area() * (nl - 1.0) + wide[1].area() * nr;
            let empty = |half: &Bounds| !(0..3).all(|k| half.lo(k) <= half.hi(k));
            if empty(&b) || (!empty(&a) && only_left <= split && only_left <= only_right) {
                left.push(*r);
                boxes[0] = wide[0];
                nr -= 1.0;
            } else if empty(&a) || only_right <= split {
                right.push(*r);
                boxes[1] = wide[1];
                nl -= 1.0;
            } else {
                left.push(Reference::new(a, r.primitive()));
                right.push(Reference::new(b, r.primitive()));
            }
        }
        let all = left.len() + right.len();
        if all > references.len() || left.is_empty() || right.is_empty() || left.len() == n || right.len() == n {
            return None;
        }
        references[..left.len()].copy_from_slice(&left);
        references[left.len()..all].copy_from_slice(&right);
        Some(((left.len(), enclose(&left)), (right.len(), enclose(&right))))
    }

    /// The boxes of what lies on the two sides of a plane.
    #[inline]
    fn halves(&self, r: &Reference, axis: usize, at: f32) -> (Bounds, Bounds) {
        let mut left = r.bounds;
        left.0[4 + axis] = at;
        let mut right = r.bounds;
        right.0[axis] = -at;
        if let Some((corners, _)) = self.primitives.triangle(r.primitive()) {
            let (mut a, mut b) = (Bounds::EMPTY, Bounds::EMPTY);
            for i in 0..3 {
                let (p, q) = (corners[i], corners[(i + 1) % 3]);
                if p[axis] <= at {
                    a = a.or(&Bounds::point(p));
                }
                if p[axis] >= at {
                    b = b.or(&Bounds::point(p));
                }
                if (p[axis] < at && q[axis] > at) || (p[axis] > at && q[axis] < at) {
                    // In f64 and rounded outwards, so that no point of the triangle is lost.
                    let w = (f64::from(at) - f64::from(p[axis])) / (f64::from(q[axis]) - f64::from(p[axis]));
                    let x: [f64; 3] = std::array::from_fn(|k| f64::from(p[k]) * (1.0 - w) + f64::from(q[k]) * w);
                    let mut edge = Bounds::new(x.map(|x| (x as f32).next_down()), x.map(|x| (x as f32).next_up()));
                    (edge.0[axis], edge.0[4 + axis]) = (-at, at);
                    a = a.or(&edge);
                    b = b.or(&edge);
                }
            }
            left = left.and(&a);
            right = right.and(&b);
        }
        (left, right)
    }
}
