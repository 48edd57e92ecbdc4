//! Sixteen truth values as lanes.

use crate::Mask;
use std::ops::{BitAnd, BitOr, BitXor, Not};
use wide::{f32x16, u32x16};

/// Sixteen truth values.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Mask16(f32x16); // every lane's bits are all 0 or all 1

#[inline(always)]
pub(super) fn lt(a: f32x16, b: f32x16) -> Mask16 {
    Mask16(a.simd_lt(b))
}

#[inline(always)]
pub(super) fn le(a: f32x16, b: f32x16) -> Mask16 {
    Mask16(a.simd_le(b))
}

#[inline(always)]
pub(super) fn eq(a: f32x16, b: f32x16) -> Mask16 {
    Mask16(a.simd_eq(b))
}

#[inline(always)]
pub(super) fn integers_lt(a: u32x16, b: u32x16) -> Mask16 {
    Mask16(bytemuck::cast(a.simd_lt(b)))
}

#[inline(always)]
pub(super) fn integers_eq(a: u32x16, b: u32x16) -> Mask16 {
    Mask16(bytemuck::cast(a.simd_eq(b)))
}

/// `a` where `mask`, else `b`.
#[inline(always)]
pub(super) fn select(mask: Mask16, a: f32x16, b: f32x16) -> f32x16 {
    mask.0.select(a, b)
}

macro_rules! operator {
    ($($operator:ident $function:ident),*) => {$(
        impl $operator for Mask16 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(self.0.$function(other.0))
            }
        }
    )*};
}
operator!(BitAnd bitand, BitOr bitor, BitXor bitxor);

impl Not for Mask16 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Mask for Mask16 {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        Self(bytemuck::cast(u32x16::splat(if b { u32::MAX } else { 0 })))
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        let lane_bit = u32x16::new(std::array::from_fn(|i| 1 << i));
        integers_eq(u32x16::splat(bits) & lane_bit, lane_bit)
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.to_bitmask()
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0.any()
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0.all()
    }
}
