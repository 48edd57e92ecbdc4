//! Sixteen rays through a tree, each on its own way but one step after another, so that what one waits for arrives while
//! the others work.
//!
//! First all that are at a node take a step, then all that were at a leaf before. So nothing asks which of the two a ray
//! has reached, and children are sorted without a branch: what a processor foresees wrongly would cost more.

use crate::accel::{Accel, Slices};
use crate::instance::transform;
use crate::node::{Child, ONE_PLUS, Target};
use crate::query::each;
use crate::ray::{Best, Rays, SingleRay};
use crate::shape::Shape;
use crate::simd::{self, Lanes, Simd, Sorted};
use crate::single::{STACK, Shapes, Solid};
use crate::tree::Tree;
use crate::{Filter, MISS};
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
    fn start(place: &mut MaybeUninit<Self>, root: Child) -> &Self {
        let walk = place.as_mut_ptr();
        // SAFETY: every field is given a value but the places above the first, which need none. In one piece, all
        // places would be copied.
        unsafe {
            (&raw mut (*walk).current).write(root);
            (&raw mut (*walk).len).write(1);
            (&raw mut (*walk).places).cast::<u32>().write(0);
            place.assume_init_ref()
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
        debug_assert!(len + 8 <= PLACES);
        self.len = len + n - 1;
        // SAFETY: there is room for the lowest place, for all pushes on the way, and for eight more; see `PLACES`.
        unsafe { self.places.as_mut_ptr().add(len).cast::<[u32; 8]>().write_unaligned(children) };
    }

    /// Goes down from an instance's `root`, and out of it when that is done.
    #[inline(always)]
    fn enter(&mut self, root: Child) {
        debug_assert!(self.len < PLACES);
        // SAFETY: there is room for the places of both trees and this one between them; see `Slices::in_turns`.
        unsafe { self.places.get_unchecked_mut(self.len) }.write(Child::OUT.0);
        self.len += 1;
        self.current = root;
    }

    /// From a block of triangles goes to the next, if some of its leaf are left, or to what was left last.
    #[inline(always)]
    fn leave(&mut self, blocks_left: u32) {
        self.current = select_unpredictable(blocks_left > 0, self.current.next_block(), self.last());
        self.len -= usize::from(blocks_left == 0);
    }
}

/// Rays that wait for their turn, by their bits.
#[derive(Default)]
struct Waiting {
    at_nodes: u32,
    at_leaves: u32,
}

impl Waiting {
    /// Those whose turn it is, at nodes and at leaves; none when all walks are over.
    #[inline(always)]
    fn take(&mut self) -> Option<(u32, u32)> {
        let Self { at_nodes, at_leaves } = std::mem::take(self);
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

/// Where each ray is.
pub(crate) trait Place {
    /// Whether there may be instances.
    const INSTANCES: bool;
    /// The tree that ray `i` is in, and the ray in that tree's space.
    fn tree(&self, i: usize) -> &Tree;
    fn ray(&self, i: usize) -> &SingleRay;
    /// The instance that this tree is of.
    fn instance(&self, i: usize) -> u32;
    /// Brings ray `i` into an instance's space, of which it returns the root.
    fn enter(&mut self, i: usize, instance: u32) -> Entered;
    /// And back.
    fn leave(&mut self, i: usize);
}

/// What became of a ray at an instance.
pub(crate) enum Entered {
    At(Child),
    /// It does not get in.
    Never,
    /// It has to go in by itself.
    Alone,
}

/// One tree for all.
pub(crate) struct Here<'a> {
    pub tree: &'a Tree,
    pub rays: &'a Rays,
    pub instance: u32,
}

impl Place for Here<'_> {
    const INSTANCES: bool = false;
    #[inline(always)]
    fn tree(&self, _: usize) -> &Tree {
        self.tree
    }
    #[inline(always)]
    fn ray(&self, i: usize) -> &SingleRay {
        self.rays.lane(i)
    }
    #[inline(always)]
    fn instance(&self, _: usize) -> u32 {
        self.instance
    }
    #[inline(always)]
    fn enter(&mut self, _: usize, _: u32) -> Entered {
        Entered::Never
    }
    #[inline(always)]
    fn leave(&mut self, _: usize) {}
}

/// A tree over the instances, which may be another for each ray's time, or the tree of one of these.
pub(crate) struct Among<'a> {
    accel: &'a Accel,
    times: &'a [f32; RAYS],
    /// What the rays are outside of all instances.
    outside: (&'a Rays, [&'a Tree; RAYS]),
    rays: Rays,
    trees: [&'a Tree; RAYS],
    instances: [u32; RAYS],
}

impl<'a> Among<'a> {
    pub fn new(accel: &'a Accel, slices: &'a Slices, rays: &'a Rays, times: &'a [f32; RAYS]) -> Self {
        let trees = times.map(|time| slices.at(time));
        Self { accel, times, outside: (rays, trees), rays: rays.clone(), trees, instances: [MISS; RAYS] }
    }
}

impl Place for Among<'_> {
    const INSTANCES: bool = true;
    #[inline(always)]
    fn tree(&self, i: usize) -> &Tree {
        self.trees[i % RAYS]
    }
    #[inline(always)]
    fn ray(&self, i: usize) -> &SingleRay {
        self.rays.lane(i)
    }
    #[inline(always)]
    fn instance(&self, i: usize) -> u32 {
        self.instances[i % RAYS]
    }
    #[inline]
    fn enter(&mut self, i: usize, instance: u32) -> Entered {
        let placed = &self.accel.instances[instance as usize];
        let tree = &self.accel.trees[placed.geometry as usize];
        // In a small tree there is nothing to wait for.
        if tree.is_small() {
            return Entered::Alone;
        }
        let (Some(root), Some(matrix)) = (tree.root(), placed.to_object(self.times[i])) else { return Entered::Never };
        let ray = self.outside.0.lane(i);
        let (o, d) = if placed.is_identity() { (ray.o, ray.d) } else { transform(&matrix, ray.o, ray.d) };
        let Some(sizes) = SingleRay::sizes(o, d, tree.extent) else { return Entered::Alone };
        self.rays.set(i, SingleRay::usual(o, d, sizes));
        (self.trees[i], self.instances[i]) = (tree, instance);
        Entered::At(root)
    }
    #[inline]
    fn leave(&mut self, i: usize) {
        let (rays, trees) = &self.outside;
        self.rays.set(i, *rays.lane(i));
        (self.trees[i], self.instances[i]) = (trees[i], MISS);
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

/// The lanes that something stops before their `tmax`. Instances that a ray has to enter by itself are left to `alone`.
#[inline(never)]
pub(crate) fn occluded<S: Simd, P: Place, K: Filter>(
    mut place: P,
    tmax: &[f32; RAYS],
    lanes: u32,
    filter: &K,
    alone: impl Fn(usize, &Shape, &SingleRay) -> bool,
) -> u32 {
    let mut walks = [const { MaybeUninit::<Walk>::uninit() }; RAYS];
    let mut waiting = Waiting::default();
    each(lanes, |i| {
        let Some(root) = place.tree(i).root() else { return };
        waiting.add(i, Walk::start(&mut walks[i], root), place.tree(i));
    });
    let mut hit = 0;
    while let Some((at_nodes, at_leaves)) = waiting.take() {
        each(at_nodes, |i| {
            // SAFETY: rays that wait have been started.
            let walk = unsafe { walks[i].assume_init_mut() };
            let Target::Node(index) = walk.current.target() else { return };
            // SAFETY: `Tree::new` has checked every child.
            let node = unsafe { place.tree(i).nodes().get_unchecked(index as usize) };
            let (mask, _) = node.enter::<S>(place.ray(i), S::F8::splat(tmax[i] * ONE_PLUS));
            let children = S::compress(&node.children.map(|child| child.0), mask);
            let last = node.children[(31 - (mask | 1).leading_zeros()) as usize % 8];
            walk.descend(children, mask.count_ones() as usize, last);
            waiting.add(i, walk, place.tree(i));
        });
        each(at_leaves, |i| {
            // SAFETY: as above.
            let walk = unsafe { walks[i].assume_init_mut() };
            let mut blocks_left = 0;
            let blocked = match walk.current.target() {
                Target::Blocks { first, count } => {
                    blocks_left = count - 1;
                    // SAFETY: as above.
                    let block = unsafe { place.tree(i).blocks().get_unchecked(first as usize) };
                    block.occluded::<S>(place.ray(i), place.instance(i), filter, tmax[i])
                }
                Target::Shape(_) if P::INSTANCES && walk.current == Child::OUT => {
                    place.leave(i);
                    false
                }
                Target::Shape(index) => {
                    let shape = &place.tree(i).shapes()[index as usize];
                    match *shape {
                        Shape::Instance(instance) if P::INSTANCES => match place.enter(i, instance) {
                            Entered::At(root) => {
                                walk.enter(root);
                                waiting.add(i, walk, place.tree(i));
                                return;
                            }
                            Entered::Never => false,
                            Entered::Alone => alone(i, &Shape::Instance(instance), place.ray(i)),
                        },
                        _ => Solid { instance: place.instance(i), filter }.occluded(shape, place.ray(i), tmax[i]),
                    }
                }
                Target::Node(_) => false,
            };
            if blocked {
                hit |= 1 << i;
            } else {
                walk.leave(blocks_left);
                waiting.add(i, walk, place.tree(i));
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
    fn start(place: &mut MaybeUninit<Self>, root: Child, tmax: f32) -> &Self {
        let nearest = place.as_mut_ptr();
        // SAFETY: as in `Walk::start`; the walk lies where a `MaybeUninit` of one may.
        unsafe {
            Walk::start(&mut *(&raw mut (*nearest).walk).cast(), root);
            (&raw mut (*nearest).enters).cast::<f32>().write(0.0);
            (&raw mut (*nearest).best).write(Best::up_to(tmax));
            place.assume_init_ref()
        }
    }

    /// As [`Walk::enter`].
    #[inline(always)]
    fn enter(&mut self, root: Child) {
        // SAFETY: as there. Before all else that is left, so that it is never left out.
        unsafe { self.enters.get_unchecked_mut(self.walk.len) }.write(0.0);
        self.walk.enter(root);
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

/// Hands the nearest hit of each lane to `found`. Instances that a ray has to enter by itself are left to `alone`.
#[inline(never)]
pub(crate) fn closest<S: Simd, P: Place, K: Filter>(
    mut place: P,
    tmax: &[f32; RAYS],
    lanes: u32,
    filter: &K,
    mut found: impl FnMut(usize, &Best),
    alone: impl Fn(usize, &Shape, &SingleRay, &mut Best),
) {
    let mut walks = [const { MaybeUninit::<Nearest>::uninit() }; RAYS];
    let mut waiting = Waiting::default();
    each(lanes, |i| {
        let Some(root) = place.tree(i).root() else { return };
        waiting.add(i, &Nearest::start(&mut walks[i], root, tmax[i]).walk, place.tree(i));
    });
    while let Some((at_nodes, at_leaves)) = waiting.take() {
        each(at_nodes, |i| {
            // SAFETY: rays that wait have been started.
            let Nearest { walk, enters, best } = unsafe { walks[i].assume_init_mut() };
            let Target::Node(index) = walk.current.target() else { return };
            // SAFETY: `Tree::new` has checked every child.
            let node = unsafe { place.tree(i).nodes().get_unchecked(index as usize) };
            let (enter, leave) = node.interval::<S>(place.ray(i), S::F8::splat(best.t * ONE_PLUS));
            let Sorted { words, x, n, last } = S::sort(&node.children.map(|child| child.0), enter, leave);
            let len = walk.len;
            walk.descend(words, n, Child(last));
            // SAFETY: as for the places of the walk, in `Walk::descend`.
            unsafe { enters.as_mut_ptr().add(len).cast::<[f32; 8]>().write_unaligned(x) };
            if !waiting.add(i, walk, place.tree(i)) {
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
                    let block = unsafe { place.tree(i).blocks().get_unchecked(first as usize) };
                    block.closest::<S>(place.ray(i), place.instance(i), filter, best);
                }
                Target::Shape(_) if P::INSTANCES && walk.current == Child::OUT => place.leave(i),
                Target::Shape(index) => {
                    let shape = &place.tree(i).shapes()[index as usize];
                    match *shape {
                        Shape::Instance(instance) if P::INSTANCES => match place.enter(i, instance) {
                            Entered::At(root) => {
                                nearest.enter(root);
                                waiting.add(i, &nearest.walk, place.tree(i));
                                return;
                            }
                            Entered::Never => {}
                            Entered::Alone => alone(i, &Shape::Instance(instance), place.ray(i), best),
                        },
                        _ => Solid { instance: place.instance(i), filter }.closest(shape, place.ray(i), best),
                    }
                }
                Target::Node(_) => {}
            }
            if best.t < before {
                nearest.forget();
            }
            nearest.walk.leave(blocks_left);
            if !waiting.add(i, &nearest.walk, place.tree(i)) {
                found(i, &nearest.best);
            }
        });
    }
}
