//! Improving a binary tree by moving subtrees to better places.
//!
//! D. Meister, J. Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy Optimization", Eurographics 2018: for
//! every subtree the best place to put it is searched for; the moves that do not touch the same nodes are then made,
//! greatest gain first.

use super::bounds::{Binary, Bounds};
use rayon::prelude::*;

/// Most passes over the tree.
const PASSES: usize = 8;
/// A pass that gains less than this part of the cost is the last.
const ENOUGH: f64 = 4e-3;
/// Most subtrees that are tried in a pass.
const BATCH: usize = 60_000;

#[derive(Clone, Copy)]
struct Move {
    gain: f32,
    what: u32,
    /// The node it becomes the sibling of.
    to: u32,
}

/// Betters the tree, which is and stays in depth-first order, its root first.
pub(crate) fn improve(nodes: &mut Vec<Binary>) {
    if nodes.len() < 7 {
        return;
    }
    let mut parents = vec![0_u32; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        if node.count().is_none() {
            parents[node.left as usize] = i as u32;
            parents[node.right as usize] = i as u32;
        }
    }
    let mut cost = f64::INFINITY;
    let mut locked = vec![0_u32; nodes.len()];
    let mut keys = Vec::new();
    for pass in 1..=PASSES as u32 {
        let now = area(nodes);
        if cost.is_finite() && now > cost * (1.0 - ENOUGH) {
            break;
        }
        cost = now;
        let mut moves: Vec<Move> = {
            let nodes = &*nodes;
            candidates(nodes, &mut keys).par_iter().filter_map(|key| best_move(nodes, &parents, *key as u32)).collect()
        };
        moves.par_sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.what.cmp(&b.what)));
        for step in moves {
            reinsert(nodes, &mut parents, &mut locked, pass, step);
        }
    }
    order(nodes);
}

/// The area of all nodes, added up in the same order by any number of threads.
fn area(nodes: &[Binary]) -> f64 {
    let chunk = |nodes: &[Binary]| nodes.iter().map(|node| f64::from(node.bounds().area())).sum::<f64>();
    nodes.par_chunks(1 << 14).map(chunk).collect::<Vec<f64>>().iter().sum()
}

/// The subtrees to be moved: the eighth of largest area. With all of them a tree of 3392 triangles took five times as
/// long and was no better. The lower half of each of the `keys` tells one.
fn candidates<'a>(nodes: &[Binary], keys: &'a mut Vec<u64>) -> &'a [u64] {
    let batch = (nodes.len() / 8).clamp(1, BATCH);
    // Areas are not negative, so that their bits are in their order.
    let key = |i: usize| u64::from(!nodes[i].bounds().area().to_bits()) << 32 | i as u64;
    (1..nodes.len()).into_par_iter().map(key).collect_into_vec(keys);
    keys.select_nth_unstable(batch);
    &keys[..batch]
}

/// The place where a subtree costs least.
fn best_move(nodes: &[Binary], parents: &[u32], what: u32) -> Option<Move> {
    let bounds = nodes[what as usize].bounds();
    let parent = parents[what as usize];
    if parent == 0 {
        return None; // the root's children stay
    }
    let area = bounds.area();
    let sibling = |of: u32| {
        let node = &nodes[parents[of as usize] as usize];
        if node.left == of { node.right } else { node.left }
    };
    // Taking it out removes its parent; every box above shrinks.
    let mut gain_above = nodes[parent as usize].bounds().area();
    let mut best = (0.0, 0);
    let mut pivot = parent;
    let mut pivot_bounds = nodes[sibling(what) as usize].bounds();
    let mut side = sibling(what);
    let mut stack: Vec<(u32, f32)> = Vec::with_capacity(64);
    loop {
        stack.push((side, gain_above));
        while let Some((at, gain)) = stack.pop() {
            if gain - area <= best.0 {
                continue;
            }
            let node = &nodes[at as usize];
            let merged = node.bounds().or(&bounds).area();
            if gain - merged > best.0 {
                best = (gain - merged, at);
            }
            let gain = gain - (merged - node.bounds().area());
            if gain - area > best.0 && node.count().is_none() {
                stack.push((node.left, gain));
                stack.push((node.right, gain));
            }
        }
        // One level up: the box without the subtree.
        let above = parents[pivot as usize];
        if pivot == 0 {
            break;
        }
        if pivot != parent {
            let here = &nodes[pivot as usize].bounds();
            pivot_bounds = pivot_bounds.or(&nodes[side as usize].bounds());
            gain_above += here.area() - pivot_bounds.area();
        }
        if above == pivot {
            break;
        }
        side = sibling(pivot);
        pivot = above;
    }
    (best.0 > 1e-6 * area && best.1 != sibling(what)).then_some(Move { gain: best.0, what, to: best.1 })
}

/// Makes a move, unless another one of this pass has touched its nodes.
fn reinsert(nodes: &mut [Binary], parents: &mut [u32], locked: &mut [u32], pass: u32, step: Move) {
    let (what, to) = (step.what, step.to);
    let parent = parents[what as usize];
    let node = nodes[parent as usize];
    let sibling = if node.left == what { node.right } else { node.left };
    let above = parents[parent as usize];
    let to_parent = parents[to as usize];
    let touched = [what, to, parent, sibling, above, to_parent];
    if to == parent || touched.iter().any(|&i| locked[i as usize] == pass) || parent == 0 || to == 0 {
        return;
    }
    // Not below itself.
    let mut at = to;
    while at != 0 {
        if at == what {
            return;
        }
        at = parents[at as usize];
    }
    for i in touched {
        locked[i as usize] = pass;
    }
    // The sibling takes the parent's place, and the parent goes between `to` and what was above it.
    let replace = |nodes: &mut [Binary], of: u32, old: u32, new: u32| {
        let node = &mut nodes[of as usize];
        if node.left == old {
            node.left = new;
        } else {
            node.right = new;
        }
    };
    replace(nodes, above, parent, sibling);
    parents[sibling as usize] = above;
    let to_parent = parents[to as usize];
    replace(nodes, to_parent, to, parent);
    parents[parent as usize] = to_parent;
    nodes[parent as usize].left = what;
    nodes[parent as usize].right = to;
    parents[to as usize] = parent;
    parents[what as usize] = parent;
    // Not by `refit`, which ends where nothing changes: in its new place the same box is new.
    let bounds = nodes[what as usize].bounds().or(&nodes[to as usize].bounds());
    nodes[parent as usize].set_bounds(&bounds);
    refit(nodes, parents, above);
    refit(nodes, parents, to_parent);
}

/// Makes the box of a node that of its sides, and so on upwards until one stays as it was.
fn refit(nodes: &mut [Binary], parents: &[u32], mut at: u32) {
    loop {
        let node = nodes[at as usize];
        let bounds: Bounds = nodes[node.left as usize].bounds().or(&nodes[node.right as usize].bounds());
        if bounds == node.bounds() {
            break;
        }
        nodes[at as usize].set_bounds(&bounds);
        if at == 0 {
            break;
        }
        at = parents[at as usize];
    }
}

/// Depth first, without unused places.
pub(crate) fn order(nodes: &mut Vec<Binary>) {
    let mut ordered: Vec<Binary> = Vec::with_capacity(nodes.len());
    let mut stack = vec![(0_u32, u32::MAX)];
    while let Some((old, parent)) = stack.pop() {
        let place = ordered.len() as u32;
        if parent != u32::MAX {
            let parent = &mut ordered[parent as usize];
            // The left child is visited first.
            if parent.left == u32::MAX {
                parent.left = place;
            } else {
                parent.right = place;
            }
        }
        let mut node = nodes[old as usize];
        if node.count().is_none() {
            stack.push((node.right, place));
            stack.push((node.left, place));
            node.left = u32::MAX;
            node.right = 0;
        }
        ordered.push(node);
    }
    *nodes = ordered;
}

#[cfg(test)]
mod tests {
    use super::super::binned::{self, Shape};
    use super::super::bounds::Reference;
    use super::*;

    /// However many boxes are alike, a node's is that of its sides after all moves, and no leaf is lost.
    #[test]
    fn boxes_fit() {
        let mut word = 1_u32;
        let mut random = |below: u32| {
            word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            ((word >> 16) % below) as f32
        };
        for (n, grid) in if cfg!(miri) { [(40, 3), (40, 9)] } else { [(3000, 3), (3000, 9)] } {
            let mut references: Vec<_> = (0..n)
                .map(|i| {
                    let p: [[f32; 3]; 2] = std::array::from_fn(|_| std::array::from_fn(|_| random(grid)));
                    let of = |f: fn(f32, f32) -> f32| std::array::from_fn(|k| f(p[0][k], p[1][k]));
                    Reference::new(Bounds::new(of(f32::min), of(f32::max)), i)
                })
                .collect();
            let mut nodes = binned::build(&mut references, Shape { leaf: 1, balanced: false, coarse: false });
            let before = area(&nodes);
            improve(&mut nodes);
            assert!(cfg!(miri) || area(&nodes) < before);
            assert_eq!(nodes.len(), 2 * n as usize - 1);
            let mut seen = vec![false; n as usize];
            for node in &nodes {
                if node.count().is_some() {
                    assert!(!std::mem::replace(&mut seen[node.left as usize], true));
                    assert_eq!(node.bounds().corners(), references[node.left as usize].bounds.corners());
                } else {
                    let sides = [node.left, node.right].map(|side| nodes[side as usize].bounds());
                    assert_eq!(node.bounds(), sides[0].or(&sides[1]));
                }
            }
            assert!(seen.iter().all(|&seen| seen));
        }
    }
}
