//! Sixteen truth values as the bits of one of AVX-512's mask registers.

use std::arch::x86_64::*;
use wide::{f32x16, u32x16};

/// Bit i is lane i.
pub(super) type Lanes = u16;

/// Both types are sixteen numbers of four bytes in a row.
#[inline(always)]
fn floats(x: f32x16) -> __m512 {
    // SAFETY: any 64 bytes are a `__m512`.
    unsafe { std::mem::transmute::<[f32; 16], __m512>(bytemuck::cast(x)) }
}

#[inline(always)]
fn integers(x: u32x16) -> __m512i {
    // SAFETY: any 64 bytes are a `__m512i`.
    unsafe { std::mem::transmute::<[u32; 16], __m512i>(bytemuck::cast(x)) }
}

macro_rules! comparisons {
    ($($name:ident $type:ty, $registers:ident, $intrinsic:ident $(::<$how:ident>)?;)*) => {$(
        #[inline(always)]
        pub(super) fn $name(a: $type, b: $type) -> Lanes {
            // SAFETY: AVX-512F is there: this module is built for nothing else.
            unsafe { $intrinsic $(::<$how>)? ($registers(a), $registers(b)) }
        }
    )*};
}
comparisons! {
    lt f32x16, floats, _mm512_cmp_ps_mask::<_CMP_LT_OQ>;
    le f32x16, floats, _mm512_cmp_ps_mask::<_CMP_LE_OQ>;
    eq f32x16, floats, _mm512_cmp_ps_mask::<_CMP_EQ_OQ>;
    integers_lt u32x16, integers, _mm512_cmplt_epu32_mask;
    integers_eq u32x16, integers, _mm512_cmpeq_epi32_mask;
}

/// `a` where `mask`, else `b`.
#[inline(always)]
pub(super) fn select(mask: Lanes, a: f32x16, b: f32x16) -> f32x16 {
    // SAFETY: AVX-512F is there: this module is built for nothing else; and any 64 bytes are sixteen floats.
    let chosen = unsafe { std::mem::transmute::<__m512, [f32; 16]>(_mm512_mask_blend_ps(mask, floats(b), floats(a))) };
    f32x16::new(chosen)
}

#[inline(always)]
pub(super) fn splat(b: bool) -> Lanes {
    if b { Lanes::MAX } else { 0 }
}

#[inline(always)]
pub(super) fn from_bits(bits: u32) -> Lanes {
    bits as Lanes
}

#[inline(always)]
pub(super) fn bits(mask: Lanes) -> u32 {
    u32::from(mask)
}

#[inline(always)]
pub(super) fn any(mask: Lanes) -> bool {
    mask != 0
}

#[inline(always)]
pub(super) fn all(mask: Lanes) -> bool {
    mask == Lanes::MAX
}
