//! Sixteen truth values as lanes.

use wide::{f32x8, f32x16, u32x16};

/// The bits of every lane are all 0 or all 1.
pub(super) type Lanes = f32x16;

#[inline(always)]
pub(super) fn lt(a: f32x16, b: f32x16) -> Lanes {
    a.simd_lt(b)
}

#[inline(always)]
pub(super) fn le(a: f32x16, b: f32x16) -> Lanes {
    a.simd_le(b)
}

#[inline(always)]
pub(super) fn eq(a: f32x16, b: f32x16) -> Lanes {
    a.simd_eq(b)
}

#[inline(always)]
pub(super) fn integers_lt(a: u32x16, b: u32x16) -> Lanes {
    bytemuck::cast(a.simd_lt(b))
}

#[inline(always)]
pub(super) fn integers_eq(a: u32x16, b: u32x16) -> Lanes {
    bytemuck::cast(a.simd_eq(b))
}

/// `a` where `mask`, else `b`.
#[inline(always)]
pub(super) fn select(mask: Lanes, a: f32x16, b: f32x16) -> f32x16 {
    mask.select(a, b)
}

#[inline(always)]
pub(super) fn splat(b: bool) -> Lanes {
    bytemuck::cast(u32x16::splat(if b { u32::MAX } else { 0 }))
}

#[inline(always)]
pub(super) fn from_bits(bits: u32) -> Lanes {
    let lane_bit = u32x16::new(std::array::from_fn(|i| 1 << i));
    integers_eq(u32x16::splat(bits) & lane_bit, lane_bit)
}

#[inline(always)]
pub(super) fn bits(mask: Lanes) -> u32 {
    mask.to_bitmask()
}

#[inline(always)]
pub(super) fn any(mask: Lanes) -> bool {
    let [a, b]: [f32x8; 2] = bytemuck::cast(mask);
    (a | b).any()
}

#[inline(always)]
pub(super) fn all(mask: Lanes) -> bool {
    let [a, b]: [f32x8; 2] = bytemuck::cast(mask);
    (a & b).all()
}
