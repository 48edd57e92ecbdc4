//! One ray through the tree.

use crate::Filter;
use crate::node::{Child, ONE_PLUS, Target};
use crate::ray::{Best, SingleRay};
use crate::shape::Shape;
use crate::simd::{self, Lanes, Simd};
use crate::tree::Tree;
use std::mem::MaybeUninit;

/// Places of the stack.
pub(crate) const STACK: usize = 512;

/// What to do at a leaf that is neither a node nor triangles.
pub(crate) trait Shapes {
    fn closest(&self, shape: &Shape, ray: &SingleRay, best: &mut Best);
    fn occluded(&self, shape: &Shape, ray: &SingleRay, tmax: f32) -> bool;
}

/// Spheres and disks of one instance.
pub(crate) struct Solid<'a, K> {
    pub instance: u32,
    pub filter: &'a K,
}

impl<K: Filter> Shapes for Solid<'_, K> {
    fn closest(&self, shape: &Shape, ray: &SingleRay, best: &mut Best) {
        let primitive = shape.primitive();
        for t in shape.roots(ray.o, ray.d) {
            if best.yields_to(t, primitive, self.instance) && self.filter.keep(primitive, self.instance, t, 0.0) {
                *best = Best { t, u: 0.0, v: 0.0, primitive, instance: self.instance };
            }
        }
    }
    fn occluded(&self, shape: &Shape, ray: &SingleRay, tmax: f32) -> bool {
        shape
            .roots(ray.o, ray.d)
            .into_iter()
            .any(|t| 0.0 < t && t <= tmax && self.filter.keep(shape.primitive(), self.instance, t, 0.0))
    }
}

/// Room for children yet to be visited.
type Places<T> = [MaybeUninit<T>; STACK];

/// A stack that was never used.
#[inline(always)]
fn no_places<T>() -> Places<T> {
    [const { MaybeUninit::uninit() }; STACK]
}

/// Puts `x` on the stack.
///
/// # Safety
/// `len` < [`STACK`].
#[inline(always)]
unsafe fn push<T>(places: &mut Places<T>, len: &mut usize, x: T) {
    debug_assert!(*len < STACK);
    // SAFETY: the caller's promise.
    unsafe { places.get_unchecked_mut(*len) }.write(x);
    *len += 1;
}

/// Element `i`.
///
/// # Safety
/// It was pushed.
#[inline(always)]
unsafe fn at<T: Copy>(places: &Places<T>, i: usize) -> T {
    // SAFETY: the caller's promise.
    unsafe { places.get_unchecked(i).assume_init() }
}

/// A child and where the ray enters it; ordered by that.
#[inline(always)]
fn key(enter: f32, child: Child) -> u64 {
    u64::from(enter.to_bits()) << 32 | u64::from(child.0)
}

/// Asks for the first cache lines of a child.
#[inline(always)]
pub(crate) fn prefetch(tree: &Tree, child: Child) {
    let (at, lines): (*const i8, usize) = match child.target() {
        Target::Node(index) => (tree.nodes().as_ptr().wrapping_add(index as usize).cast(), 4),
        Target::Blocks { first, .. } => (tree.blocks().as_ptr().wrapping_add(first as usize).cast(), 3),
        Target::Shape(_) => return,
    };
    for line in 0..lines {
        simd::prefetch(at.wrapping_add(64 * line));
    }
}

/// Puts the nearest hit in the subtree `start` into `best` if it comes before.
#[inline(always)]
pub(crate) fn closest<S: Simd, const PREFETCH: bool, K: Filter>(
    tree: &Tree,
    start: Child,
    ray: &SingleRay,
    instance: u32,
    filter: &K,
    shapes: &impl Shapes,
    best: &mut Best,
) {
    let mut places = no_places::<u64>();
    let (mut current, mut len, mut limit) = (start, 0, best.t * ONE_PLUS);
    'walk: loop {
        match current.target() {
            Target::Node(index) => {
                // SAFETY: `Tree::new` has checked every child.
                let node = unsafe { tree.nodes().get_unchecked(index as usize) };
                let (mut mask, enter) = node.enter::<S>(ray, S::F8::splat(limit));
                if mask != 0 {
                    let enter = enter.array();
                    let mut next = || {
                        let i = mask.trailing_zeros() as usize & 7;
                        mask &= mask - 1;
                        let child = node.children[i];
                        if PREFETCH {
                            prefetch(tree, child);
                        }
                        (key(enter[i], child), mask)
                    };
                    let (first, rest) = next();
                    if rest == 0 {
                        current = Child(first as u32);
                        continue 'walk;
                    }
                    let (second, rest) = next();
                    let (mut near, mut far) = (first.min(second), first.max(second));
                    if rest == 0 {
                        // SAFETY: `Tree::new` has checked that the stack is large enough for all pushes on the way.
                        unsafe { push(&mut places, &mut len, far) };
                        current = Child(near as u32);
                        continue 'walk;
                    }
                    let (third, rest) = next();
                    let middle;
                    (middle, far) = (third.min(far), third.max(far));
                    let second;
                    (near, second) = (near.min(middle), near.max(middle));
                    if rest == 0 {
                        // SAFETY: as above.
                        unsafe {
                            push(&mut places, &mut len, far);
                            push(&mut places, &mut len, second);
                        }
                        current = Child(near as u32);
                        continue 'walk;
                    }
                    // SAFETY: as above.
                    unsafe {
                        push(&mut places, &mut len, far);
                        push(&mut places, &mut len, second);
                        push(&mut places, &mut len, near);
                    }
                    let bottom = len - 3;
                    let mut rest = rest;
                    while rest != 0 {
                        let (x, left) = next();
                        rest = left;
                        let mut i = len;
                        // SAFETY: places from `bottom` to `len` were pushed, and there is room for one more, as above.
                        unsafe {
                            push(&mut places, &mut len, x);
                            while i > bottom && at(&places, i - 1) < x {
                                *places.get_unchecked_mut(i) = *places.get_unchecked(i - 1);
                                i -= 1;
                            }
                            places.get_unchecked_mut(i).write(x);
                        }
                    }
                }
            }
            Target::Blocks { first, count } => {
                for i in first..first + count {
                    // SAFETY: `Tree::new` has checked every child.
                    let block = unsafe { tree.blocks().get_unchecked(i as usize) };
                    block.closest::<S>(ray, instance, filter, best);
                }
                limit = best.t * ONE_PLUS;
            }
            Target::Shape(index) => {
                shapes.closest(&tree.shapes()[index as usize], ray, best);
                limit = best.t * ONE_PLUS;
            }
        }
        loop {
            if len == 0 {
                return;
            }
            len -= 1;
            // SAFETY: everything below `len` was pushed.
            let key = unsafe { at(&places, len) };
            if f32::from_bits((key >> 32) as u32) <= limit {
                current = Child(key as u32);
                continue 'walk;
            }
        }
    }
}

/// Whether the ray hits anything in the subtree `start` before `tmax`.
#[inline(always)]
pub(crate) fn occluded<S: Simd, const PREFETCH: bool, K: Filter>(
    tree: &Tree,
    start: Child,
    ray: &SingleRay,
    instance: u32,
    filter: &K,
    shapes: &impl Shapes,
    tmax: f32,
) -> bool {
    let mut places = no_places::<u32>();
    let (mut current, mut len) = (start, 0);
    loop {
        match current.target() {
            Target::Node(index) => {
                // SAFETY: `Tree::new` has checked every child.
                let node = unsafe { tree.nodes().get_unchecked(index as usize) };
                let (mut rest, _) = node.enter::<S>(ray, S::F8::splat(tmax * ONE_PLUS));
                if rest != 0 {
                    // Not taken from the stack: what was just written there takes long to come back.
                    let last = 31 - rest.leading_zeros();
                    current = node.children[last as usize & 7];
                    rest ^= 1 << last;
                    if rest != 0 {
                        let children = S::compress(&node.children.map(|child| child.0), rest);
                        // SAFETY: `Tree::new` has checked that the stack is large enough for all pushes on the way and
                        // eight more.
                        unsafe { places.as_mut_ptr().add(len).cast::<[u32; 8]>().write_unaligned(children) };
                        len += rest.count_ones() as usize;
                    }
                    while PREFETCH && rest != 0 {
                        prefetch(tree, node.children[rest.trailing_zeros() as usize & 7]);
                        rest &= rest - 1;
                    }
                    continue;
                }
            }
            Target::Blocks { first, count } => {
                for i in first..first + count {
                    // SAFETY: `Tree::new` has checked every child.
                    let block = unsafe { tree.blocks().get_unchecked(i as usize) };
                    if block.occluded::<S>(ray, instance, filter, tmax) {
                        return true;
                    }
                }
            }
            Target::Shape(index) => {
                if shapes.occluded(&tree.shapes()[index as usize], ray, tmax) {
                    return true;
                }
            }
        }
        if len == 0 {
            return false;
        }
        len -= 1;
        // SAFETY: everything below `len` was pushed.
        current = Child(unsafe { at(&places, len) });
    }
}
