//! Sixteen truth values as the bits of one of AVX-512's mask registers.

use crate::Mask;
use std::arch::x86_64::*;
use std::ops::{BitAnd, BitOr, BitXor, Not};
use wide::{f32x16, u32x16};

/// Sixteen truth values.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Mask16(u16);

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
        pub(super) fn $name(a: $type, b: $type) -> Mask16 {
            // SAFETY: AVX-512F is there: this module is built for nothing else.
            Mask16(unsafe { $intrinsic $(::<$how>)? ($registers(a), $registers(b)) })
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
pub(super) fn select(mask: Mask16, a: f32x16, b: f32x16) -> f32x16 {
    // SAFETY: AVX-512F is there: this module is built for nothing else; and any 64 bytes are sixteen floats.
    let chosen =
        unsafe { std::mem::transmute::<__m512, [f32; 16]>(_mm512_mask_blend_ps(mask.0, floats(b), floats(a))) };
    f32x16::new(chosen)
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
        Self(if b { u16::MAX } else { 0 })
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        Self(bits as u16)
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self.0)
    }
    #[inline(always)]
    fn any(self) -> bool {
        self.0 != 0
    }
    #[inline(always)]
    fn all(self) -> bool {
        self.0 == u16::MAX
    }
}
