//! Boxes as the builders want them.

use crate::simd::{Lanes, Native, Simd};

pub(crate) type F4 = <Native as Simd>::F4;
type F8 = <Native as Simd>::F8;

/// −lower x, y, z, then upper x, y, z, each padded to four: growing is one maximum of eight. The padding holds anything.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Bounds(pub [f32; 8]);

impl Bounds {
    pub const EMPTY: Self = Self([f32::NEG_INFINITY; 8]);

    #[inline(always)]
    pub fn point(p: [f32; 3]) -> Self {
        Self([-p[0], -p[1], -p[2], 0.0, p[0], p[1], p[2], 0.0])
    }
    pub fn new(lo: [f32; 3], hi: [f32; 3]) -> Self {
        Self([-lo[0], -lo[1], -lo[2], 0.0, hi[0], hi[1], hi[2], 0.0])
    }
    #[inline(always)]
    pub fn lo(&self, k: usize) -> f32 {
        -self.0[k]
    }
    #[inline(always)]
    pub fn hi(&self, k: usize) -> f32 {
        self.0[4 + k]
    }
    pub fn corners(&self) -> ([f32; 3], [f32; 3]) {
        (std::array::from_fn(|k| self.lo(k)), std::array::from_fn(|k| self.hi(k)))
    }
    #[inline(always)]
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        Self(F8::load(&self.0).max(F8::load(&other.0)).array())
    }
    #[inline(always)]
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self(F8::load(&self.0).min(F8::load(&other.0)).array())
    }
    /// Half the surface; 0 for an empty box.
    #[inline(always)]
    pub fn area(&self) -> f32 {
        let both = F8::load(&self.0);
        let [x, y, z, _] = Native::high(both).add(Native::low(both)).max(F4::splat(0.0)).array();
        x * (y + z) + y * z
    }
    /// Itself, or nothing; without a branch.
    #[inline(always)]
    pub fn or_empty(self, itself: bool) -> Self {
        let (mask, nothing) = (u32::from(itself).wrapping_neg(), f32::NEG_INFINITY.to_bits());
        Self(std::array::from_fn(|i| f32::from_bits(self.0[i].to_bits() & mask | nothing & !mask)))
    }
    /// Whether nothing was put in.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.0[0] == f32::NEG_INFINITY
    }
    /// Twice the centre.
    #[inline(always)]
    pub fn center2(&self, k: usize) -> f32 {
        self.0[4 + k] - self.0[k]
    }
    /// Twice the centre; the fourth is anything.
    #[inline(always)]
    pub fn centers2(&self) -> F4 {
        let both = F8::load(&self.0);
        Native::high(both).sub(Native::low(both))
    }
    /// Twice the centre, as a box.
    #[inline(always)]
    pub fn center2_box(&self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - self.0[i ^ 4]))
    }
}

/// A primitive, or a part of one, on its way into the tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    /// Its padding holds the primitive, as a number that is neither tiny nor huge: those are slow to calculate with.
    pub bounds: Bounds,
}

const PRIMITIVE: u32 = 0x4000_0000;

impl Reference {
    pub fn new(mut bounds: Bounds, primitive: u32) -> Self {
        bounds.0[3] = f32::from_bits(PRIMITIVE | primitive);
        bounds.0[7] = 0.0;
        Self { bounds }
    }
    /// Which primitive of the geometry.
    #[inline(always)]
    pub fn primitive(&self) -> u32 {
        self.bounds.0[3].to_bits() & !PRIMITIVE
    }
}

/// A node of the binary tree; all zeros where there is none.
#[derive(Clone, Copy, Debug, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Binary {
    minus_lo: [f32; 3],
    /// Left child, or a leaf's first reference.
    pub left: u32,
    hi: [f32; 3],
    /// Right child, or [`Binary::LEAF`] plus a leaf's number of references.
    pub right: u32,
}

impl Binary {
    pub const LEAF: u32 = 1 << 31;

    pub fn new(bounds: &Bounds, left: u32, right: u32) -> Self {
        let [x, y, z, _, hx, hy, hz, _] = bounds.0;
        Self { minus_lo: [x, y, z], left, hi: [hx, hy, hz], right }
    }
    pub fn leaf(bounds: &Bounds, first: u32, count: u32) -> Self {
        Self::new(bounds, first, Self::LEAF | count)
    }
    /// Room for so many.
    pub fn places(n: usize) -> Vec<Self> {
        bytemuck::allocation::zeroed_vec(n)
    }
    #[inline(always)]
    pub fn bounds(&self) -> Bounds {
        let ([x, y, z], [hx, hy, hz]) = (self.minus_lo, self.hi);
        Bounds([x, y, z, 0.0, hx, hy, hz, 0.0])
    }
    pub fn set_bounds(&mut self, bounds: &Bounds) {
        *self = Self::new(bounds, self.left, self.right);
    }
    /// A leaf's number of references.
    #[inline(always)]
    pub fn count(&self) -> Option<u32> {
        (self.right & Self::LEAF != 0).then_some(self.right & !Self::LEAF)
    }
}
