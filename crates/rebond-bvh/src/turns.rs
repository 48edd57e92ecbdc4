//! Sixteen rays through a tree, each on its own way but one step after another, so that what one waits for arrives while
//! the others work.
//!
//! First all that are at a node take a step, then all that were at a leaf before. So nothing asks which of the two a ray
//! has reached, and children are sorted without a branch: what a processor foresees wrongly would cost more.

use crate::Filter;
use crate::node::{Child, ONE_PLUS, Target};
use crate::query::each;
use crate::ray::{Best, Rays};
use crate::simd::{self, Lanes, Simd, Sorted};
use crate::single::{STACK, Shapes, Solid};
use crate::tree::Tree;
use std::hint::select_unpredictable;
use std::mem::MaybeUninit;

const RAYS: usize = 16;
/// Below what a ray needs lies one place that is never visited, and eight children are written at once; `Tree::new` asks
/// for eight places more than any way down takes.
const PLACES: usize = STACK + 8;

type Places<T> = [MaybeUninit<T>; PLACES];

/// Where a ray is, and what it left to visit.
struct Walk {
    current: Child,
    /// Places in use, the nearest child last: 1 when nothing is left, 0 when the walk is over.
    len: usize,
    places: Places<u32>,
}

impl Walk {
    /// Begins at `root`.
    #[inline(always)]
    fn start(place: &mut MaybeUninit<Self>, root: Child) {
        let walk = place.as_mut_ptr();
        // SAFETY: every field is given a value but the places above the first, which need none. In one piece, all
        // places would be copied.
        unsafe {
            (&raw mut (*walk).current).write(root);
            (&raw mut (*walk).len).write(1);
            (&raw mut (*walk).places).cast::<u32>().write(0);
        }
    }

    /// What was pushed last.
    #[inline(always)]
    fn last(&self) -> Child {
        debug_assert!((1..PLACES).contains(&self.len));
        // SAFETY: everything below `len` was written, and a walk that is not over has 1 or more there.
        Child(unsafe { self.places.get_unchecked(self.len - 1).assume_init() })
    }

    /// Pushes the first `n` of eight children, the last of which is `nearest`, and goes there; with n = 0, to what was
    /// left last.
    #[inline(always)]
    fn descend(&mut self, children: [u32; 8], n: usize, nearest: Child) {
        // Not taken from the stack if it was just written there: it takes long to come back.
        self.current = select_unpredictable(n > 0, nearest, self.last());
        let len = self.len;
        self.len = len + n - 1;
        // SAFETY: there is room for the lowest place, for all pushes on the way, and for eight more; see `PLACES`.
        unsafe { self.places.as_mut_ptr().add(len).cast::<[u32; 8]>().write_unaligned(children) };
    }

    /// From a block of triangles goes to the next, if some of its leaf are left, or to what was left last.
    #[inline(always)]
    fn leave(&mut self, blocks_left: u32) {
        self.current = select_unpredictable(blocks_left > 0, self.current.next_block(), self.last());
        self.len -= usize::from(blocks_left == 0);
    }
}

/// Rays that wait for their turn, by their bits.
struct Waiting {
    at_nodes: u32,
    at_leaves: u32,
}

impl Waiting {
    fn new(root: Child, rays: u32) -> Self {
        if root.is_leaf() { Self { at_nodes: 0, at_leaves: rays } } else { Self { at_nodes: rays, at_leaves: 0 } }
    }

    /// Those whose turn it is, at nodes and at leaves; none when all walks are over.
    #[inline(always)]
    fn take(&mut self) -> Option<(u32, u32)> {
        let Self { at_nodes, at_leaves } = std::mem::replace(self, Self { at_nodes: 0, at_leaves: 0 });
        (at_nodes | at_leaves != 0).then_some((at_nodes, at_leaves))
    }

    /// Lets ray `i` wait for what it has reached, and says whether there is anything.
    #[inline(always)]
    fn add(&mut self, i: usize, walk: &Walk, tree: &Tree) -> bool {
        let (more, leaf) = (walk.len > 0, walk.current.is_leaf());
        self.at_nodes |= u32::from(more & !leaf) << i;
        self.at_leaves |= u32::from(more & leaf) << i;
        prefetch(tree, walk.current);
        more
    }
}

/// Asks for a child, without a branch.
#[inline(always)]
fn prefetch(tree: &Tree, child: Child) {
    let node = tree.nodes().as_ptr().wrapping_add(child.0 as usize).cast::<i8>();
    let block = tree.blocks().as_ptr().wrapping_add(child.first_block() as usize).cast::<i8>();
    let at = select_unpredictable(child.is_leaf(), block, node);
    for line in 0..4 {
        simd::prefetch(at.wrapping_add(64 * line));
    }
}

/// The lanes that something stops before their `tmax`.
#[inline(never)]
pub(crate) fn occluded<S: Simd, K: Filter>(
    tree: &Tree,
    rays: &Rays,
    tmax: &[f32; RAYS],
    lanes: u32,
    instance: u32,
    filter: &K,
) -> u32 {
    let Some(root) = tree.root() else { return 0 };
    let solid = Solid { instance, filter };
    let mut walks = [const { MaybeUninit::<Walk>::uninit() }; RAYS];
    each(lanes, |i| Walk::start(&mut walks[i], root));
    let mut waiting = Waiting::new(root, lanes);
    let mut hit = 0;
    while let Some((at_nodes, at_leaves)) = waiting.take() {
        each(at_nodes, |i| {
            // SAFETY: rays that wait have been started.
            let walk = unsafe { walks[i].assume_init_mut() };
            let Target::Node(index) = walk.current.target() else { return };
            // SAFETY: `Tree::new` has checked every child.
            let node = unsafe { tree.nodes().get_unchecked(index as usize) };
            let (mask, _) = node.enter::<S>(rays.lane(i), S::F8::splat(tmax[i] * ONE_PLUS));
            let children = S::compress(&node.children.map(|child| child.0), mask);
            let last = node.children[(31 - (mask | 1).leading_zeros()) as usize % 8];
            walk.descend(children, mask.count_ones() as usize, last);
            waiting.add(i, walk, tree);
        });
        each(at_leaves, |i| {
            // SAFETY: as above.
            let walk = unsafe { walks[i].assume_init_mut() };
            let mut blocks_left = 0;
            let blocked = match walk.current.target() {
                Target::Blocks { first, count } => {
                    blocks_left = count - 1;
                    // SAFETY: as above.
                    let block = unsafe { tree.blocks().get_unchecked(first as usize) };
                    block.occluded::<S>(rays.lane(i), instance, filter, tmax[i])
                }
                Target::Shape(index) => solid.occluded(&tree.shapes()[index as usize], rays.lane(i), tmax[i]),
                Target::Node(_) => false,
            };
            if blocked {
                hit |= 1 << i;
            } else {
                walk.leave(blocks_left);
                waiting.add(i, walk, tree);
            }
        });
    }
    hit
}

/// A ray on its way to its nearest hit.
struct Nearest {
    walk: Walk,
    /// Where the ray enters each of the places.
    enters: Places<f32>,
    best: Best,
}

impl Nearest {
    #[inline(always)]
    fn start(place: &mut MaybeUninit<Self>, root: Child, tmax: f32) {
        let nearest = place.as_mut_ptr();
        // SAFETY: as in `Walk::start`; the walk lies where a `MaybeUninit` of one may.
        unsafe {
            Walk::start(&mut *(&raw mut (*nearest).walk).cast(), root);
            (&raw mut (*nearest).enters).cast::<f32>().write(0.0);
            (&raw mut (*nearest).best).write(Best::up_to(tmax));
        }
    }

    /// Leaves out what begins behind the nearest hit.
    #[inline(always)]
    fn forget(&mut self) {
        let (limit, places, enters) = (self.best.t * ONE_PLUS, &mut self.walk.places, &mut self.enters);
        let mut kept = 1;
        for i in 1..self.walk.len {
            // SAFETY: everything below `len` was written, and `kept` ≤ i.
            unsafe {
                let enter = enters.get_unchecked(i).assume_init();
                *places.get_unchecked_mut(kept) = *places.get_unchecked(i);
                enters.get_unchecked_mut(kept).write(enter);
                kept += usize::from(enter <= limit);
            }
        }
        self.walk.len = kept;
    }
}

/// Hands the nearest hit of each lane to `found`.
#[inline(never)]
pub(crate) fn closest<S: Simd, K: Filter>(
    tree: &Tree,
    rays: &Rays,
    tmax: &[f32; RAYS],
    lanes: u32,
    instance: u32,
    filter: &K,
    mut found: impl FnMut(usize, &Best),
) {
    let Some(root) = tree.root() else { return };
    let solid = Solid { instance, filter };
    let mut walks = [const { MaybeUninit::<Nearest>::uninit() }; RAYS];
    each(lanes, |i| Nearest::start(&mut walks[i], root, tmax[i]));
    let mut waiting = Waiting::new(root, lanes);
    while let Some((at_nodes, at_leaves)) = waiting.take() {
        each(at_nodes, |i| {
            // SAFETY: rays that wait have been started.
            let Nearest { walk, enters, best } = unsafe { walks[i].assume_init_mut() };
            let Target::Node(index) = walk.current.target() else { return };
            // SAFETY: `Tree::new` has checked every child.
            let node = unsafe { tree.nodes().get_unchecked(index as usize) };
            let (enter, leave) = node.interval::<S>(rays.lane(i), S::F8::splat(best.t * ONE_PLUS));
            let Sorted { words, x, n, last } = S::sort(&node.children.map(|child| child.0), enter, leave);
            let len = walk.len;
            walk.descend(words, n, Child(last));
            // SAFETY: as for the places of the walk, in `Walk::descend`.
            unsafe { enters.as_mut_ptr().add(len).cast::<[f32; 8]>().write_unaligned(x) };
            if !waiting.add(i, walk, tree) {
                found(i, best);
            }
        });
        each(at_leaves, |i| {
            // SAFETY: as above.
            let nearest = unsafe { walks[i].assume_init_mut() };
            let Nearest { walk, best, .. } = nearest;
            let before = best.t;
            let mut blocks_left = 0;
            match walk.current.target() {
                Target::Blocks { first, count } => {
                    blocks_left = count - 1;
                    // SAFETY: as above.
                    let block = unsafe { tree.blocks().get_unchecked(first as usize) };
                    block.closest::<S>(rays.lane(i), instance, filter, best);
                }
                Target::Shape(index) => solid.closest(&tree.shapes()[index as usize], rays.lane(i), best),
                Target::Node(_) => {}
            }
            if best.t < before {
                nearest.forget();
            }
            nearest.walk.leave(blocks_left);
            if !waiting.add(i, &nearest.walk, tree) {
                found(i, &nearest.best);
            }
        });
    }
}
