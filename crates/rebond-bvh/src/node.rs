//! The node of the tree: eight boxes side by side.

use crate::ray::SingleRay;
use crate::simd::{Lanes, Simd};

/// Eight children; 256 bytes, four cache lines.
#[derive(Clone, Copy, Debug, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// Lower x, upper x, lower y, upper y, lower z, upper z of every child; an unused child has lower = +∞ and
    /// upper = −∞, which no ray meets.
    pub planes: [[f32; 8]; 6],
    pub children: [Child; 8],
}

impl Node {
    pub const EMPTY: Self = Self {
        planes: [
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
        ],
        children: [Child(0); 8],
    };

    /// Which children the ray may enter up to `limit`, a t times [`ONE_PLUS`], and where it enters each.
    ///
    /// Never false for a box that holds a hit: see [`SingleRay`].
    #[inline(always)]
    pub fn enter<S: Simd>(&self, ray: &SingleRay, limit: S::F8) -> (u32, S::F8) {
        let (enter, leave) = self.interval::<S>(ray, limit);
        (enter.le(leave), enter)
    }

    /// Where the ray enters each child, if at all, and leaves it; see [`Node::enter`].
    #[inline(always)]
    pub fn interval<S: Simd>(&self, ray: &SingleRay, limit: S::F8) -> (S::F8, S::F8) {
        let plane = |row: usize| {
            debug_assert!(row < 6);
            // SAFETY: `SingleRay` makes its near planes 2k or 2k + 1 for k < 3; the far plane is the other of the two.
            S::F8::load(unsafe { self.planes.get_unchecked(row) })
        };
        let near =
            |k: usize| plane(ray.near_plane()[k]).mul_add(S::F8::splat(ray.inverse[k]), S::F8::splat(ray.near[k]));
        let far = |k: usize| {
            plane(ray.near_plane()[k] ^ 1).mul_add(S::F8::splat(ray.inverse_far[k]), S::F8::splat(ray.far[k]))
        };
        let enter = near(0).max(near(1)).max(near(2).max(S::F8::splat(0.0)));
        let leave = far(0).min(far(1)).min(far(2).min(limit));
        (enter, leave)
    }
}

/// Covers the relative error of a box's entry and exit against each other and against a hit's `t`.
pub(crate) const ONE_PLUS: f32 = 1.0 + 8.0 * f32::EPSILON;

/// What a slot of a node refers to: another node, up to four blocks of triangles, or one other shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Zeroable)]
#[repr(transparent)]
pub(crate) struct Child(pub u32);

const LEAF: u32 = 1 << 31;
const SHAPE: u32 = 1 << 30;
const BLOCK_BITS: u32 = 28;

/// A [`Child`], unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    Node(u32),
    Blocks { first: u32, count: u32 },
    Shape(u32),
}

impl Child {
    pub const MAX_BLOCKS: usize = 1 << BLOCK_BITS;
    pub const MAX_SHAPES: usize = SHAPE as usize;
    /// No shape: back out of an instance.
    pub const OUT: Self = Self(u32::MAX);

    pub fn node(index: u32) -> Self {
        debug_assert!(index < LEAF);
        Self(index)
    }
    /// 1 to 4 blocks.
    pub fn blocks(first: u32, count: u32) -> Self {
        debug_assert!((1..=4).contains(&count) && first < 1 << BLOCK_BITS);
        Self(LEAF | (count - 1) << BLOCK_BITS | first)
    }
    pub fn shape(index: u32) -> Self {
        debug_assert!(index < SHAPE);
        Self(LEAF | SHAPE | index)
    }
    /// Whether it is not a node.
    #[inline(always)]
    pub fn is_leaf(self) -> bool {
        self.0 & LEAF != 0
    }
    #[inline(always)]
    pub fn target(self) -> Target {
        if self.0 & LEAF == 0 {
            Target::Node(self.0)
        } else if self.0 & SHAPE == 0 {
            Target::Blocks { first: self.first_block(), count: (self.0 >> BLOCK_BITS & 3) + 1 }
        } else {
            Target::Shape(self.0 & (SHAPE - 1))
        }
    }
    /// Of a child that is blocks, the first.
    #[inline(always)]
    pub fn first_block(self) -> u32 {
        self.0 & ((1 << BLOCK_BITS) - 1)
    }
    /// Of a child of several blocks, the same without the first.
    #[inline(always)]
    pub fn next_block(self) -> Self {
        Self(self.0.wrapping_sub((1 << BLOCK_BITS) - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_unpack() {
        assert_eq!(Child::node(7).target(), Target::Node(7));
        assert_eq!(Child::blocks(9, 4).target(), Target::Blocks { first: 9, count: 4 });
        assert_eq!(Child::blocks((1 << 28) - 1, 1).target(), Target::Blocks { first: (1 << 28) - 1, count: 1 });
        assert_eq!(Child::blocks(9, 4).next_block(), Child::blocks(10, 3));
        assert_eq!(Child::shape(3).target(), Target::Shape(3));
        assert_eq!(size_of::<Node>(), 256);
    }
}
