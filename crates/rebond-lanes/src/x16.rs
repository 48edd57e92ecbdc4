//! Sixteen lanes, over the crate `wide`.

use crate::{Index, Mask, Real, Record};
use std::ops::{Add, AddAssign, BitAnd, BitOr, BitXor, Div, Mul, MulAssign, Neg, Not, Shl, Shr, Sub, SubAssign};
use wide::{f32x16, u32x16};

#[cfg_attr(target_feature = "avx512f", path = "x16/mask_registers.rs")]
#[cfg_attr(not(target_feature = "avx512f"), path = "x16/mask_lanes.rs")]
mod mask;

/// Sixteen truth values.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Mask16(mask::Lanes);

/// Sixteen numbers.
#[derive(Clone, Copy, Debug, Default)]
#[repr(transparent)]
pub struct F32x16(f32x16);

/// Sixteen unsigned integers.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Index16(u32x16);

macro_rules! operator {
    ($($type:ident: $($operator:ident $function:ident),*;)*) => {$($(
        impl $operator for $type {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(self.0.$function(other.0))
            }
        }
    )*)*};
}
operator! {
    F32x16: Add add, Sub sub, Mul mul, Div div;
    Mask16: BitAnd bitand, BitOr bitor, BitXor bitxor;
    Index16: Add add, Sub sub, Mul mul, BitAnd bitand, BitOr bitor, BitXor bitxor;
}

macro_rules! operator_f32 {
    ($($operator:ident $function:ident),*) => {$(
        impl $operator<f32> for F32x16 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: f32) -> Self {
                Self(self.0.$function(f32x16::splat(other)))
            }
        }
    )*};
}
operator_f32!(Add add, Sub sub, Mul mul, Div div);

macro_rules! assign {
    ($($operator:ident $function:ident $symbol:tt),*) => {$(
        impl $operator for F32x16 {
            #[inline(always)]
            fn $function(&mut self, other: Self) {
                *self = *self $symbol other;
            }
        }
    )*};
}
assign!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

macro_rules! shift {
    ($($operator:ident $function:ident),*) => {$(
        impl $operator<u32> for Index16 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, by: u32) -> Self {
                Self(self.0.$function(by))
            }
        }
    )*};
}
shift!(Shl shl, Shr shr);

impl Neg for F32x16 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Not for Mask16 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Not for Index16 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

#[inline(always)]
fn integers(x: f32x16) -> u32x16 {
    bytemuck::cast(x)
}

#[inline(always)]
fn floats(x: u32x16) -> f32x16 {
    bytemuck::cast(x)
}

impl Mask for Mask16 {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        Self(mask::splat(b))
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        Self(mask::from_bits(bits))
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        mask::bits(self.0)
    }
    #[inline(always)]
    fn any(self) -> bool {
        mask::any(self.0)
    }
    #[inline(always)]
    fn all(self) -> bool {
        mask::all(self.0)
    }
}

impl Index for Index16 {
    type Mask = Mask16;
    #[inline(always)]
    fn splat(i: u32) -> Self {
        Self(u32x16::splat(i))
    }
    #[inline(always)]
    fn lane(self, lane: usize) -> u32 {
        self.0.as_array()[lane]
    }
    #[inline(always)]
    fn with_lane(mut self, lane: usize, value: u32) -> Self {
        self.0.as_mut_array()[lane] = value;
        self
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Mask16 {
        Mask16(mask::integers_eq(self.0, other.0))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask16 {
        Mask16(mask::integers_lt(self.0, other.0))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    #[inline(always)]
    fn select(mask: Mask16, a: Self, b: Self) -> Self {
        Self(integers(mask::select(mask.0, floats(a.0), floats(b.0))))
    }
    #[cfg(target_feature = "avx512bw")]
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        use std::arch::x86_64::{
            __m512i, _mm_loadu_si128, _mm512_and_si512, _mm512_broadcast_i32x4, _mm512_or_si512, _mm512_set1_epi8,
            _mm512_shuffle_epi8, _mm512_srli_epi32,
        };
        // Half a byte reversed, as the lower and as the upper half; the bytes of four words reversed.
        const LOW: [u8; 16] = [0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15];
        const HIGH: [u8; 16] = [0, 128, 64, 192, 32, 160, 96, 224, 16, 144, 80, 208, 48, 176, 112, 240];
        const BYTES: [u8; 16] = [3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12];
        // SAFETY: AVX-512BW, and with it F, is there (cfg); sixteen bytes are read from sixteen; any 64 bytes are a
        // `__m512i` and sixteen integers.
        unsafe {
            let everywhere = |bytes: &[u8; 16]| _mm512_broadcast_i32x4(_mm_loadu_si128(bytes.as_ptr().cast()));
            let x = std::mem::transmute::<[u32; 16], __m512i>(*self.0.as_array());
            let half = _mm512_set1_epi8(15);
            let low = _mm512_shuffle_epi8(everywhere(&HIGH), _mm512_and_si512(x, half));
            let high = _mm512_shuffle_epi8(everywhere(&LOW), _mm512_and_si512(_mm512_srli_epi32::<4>(x), half));
            let bytes = _mm512_shuffle_epi8(_mm512_or_si512(low, high), everywhere(&BYTES));
            Self(u32x16::new(std::mem::transmute::<__m512i, [u32; 16]>(bytes)))
        }
    }
}

impl Real for F32x16 {
    type Mask = Mask16;
    type Index = Index16;
    const LANES: usize = 16;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(f32x16::splat(x))
    }
    #[inline(always)]
    fn lane(self, lane: usize) -> f32 {
        self.0.as_array()[lane]
    }
    #[inline(always)]
    fn with_lane(mut self, lane: usize, value: f32) -> Self {
        self.0.as_mut_array()[lane] = value;
        self
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let lanes: [f32; 16] = from[..16].try_into().expect("sixteen values");
        Self(f32x16::new(lanes))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..16].copy_from_slice(self.0.as_array());
    }
    #[inline(always)]
    fn compress(self, mask: Mask16, to: &mut [f32]) -> usize {
        assert!(to.len() >= 16);
        #[cfg(target_feature = "avx512f")]
        {
            use std::arch::x86_64::{_mm512_loadu_ps, _mm512_maskz_compress_ps, _mm512_storeu_ps};
            let bits = mask.bits() as u16;
            // SAFETY: AVX-512F is there (cfg); sixteen floats are read from sixteen, and `to` holds at least the
            // sixteen that are written (assert).
            unsafe {
                let lanes = _mm512_loadu_ps(self.0.as_array().as_ptr());
                _mm512_storeu_ps(to.as_mut_ptr(), _mm512_maskz_compress_ps(bits, lanes));
            }
            bits.count_ones() as usize
        }
        #[cfg(not(target_feature = "avx512f"))]
        {
            let (lanes, bits) = (self.0.as_array(), mask.bits());
            let mut n = 0;
            for (lane, value) in lanes.iter().enumerate() {
                to[n.min(15)] = *value;
                n += (bits >> lane & 1) as usize;
            }
            n
        }
    }
    #[inline(always)]
    fn select(mask: Mask16, a: Self, b: Self) -> Self {
        Self(mask::select(mask.0, a.0, b.0))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask16 {
        Mask16(mask::lt(self.0, other.0))
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask16 {
        Mask16(mask::le(self.0, other.0))
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Mask16 {
        Mask16(mask::eq(self.0, other.0))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if cfg!(target_arch = "x86_64") {
            Self(self.0.fast_min(other.0))
        } else {
            Self::select(self.lt(other), self, other)
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if cfg!(target_arch = "x86_64") {
            Self(self.0.fast_max(other.0))
        } else {
            Self::select(self.gt(other), self, other)
        }
    }
    #[inline(always)]
    fn mul_add(self, m: Self, a: Self) -> Self {
        Self(self.0.mul_add(m.0, a.0))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
    #[inline(always)]
    fn to_bits(self) -> Index16 {
        Index16(integers(self.0))
    }
    #[inline(always)]
    fn from_bits(bits: Index16) -> Self {
        Self(floats(bits.0))
    }
    #[inline(always)]
    fn from_index(i: Index16) -> Self {
        Self(f32x16::from_i32x16(bytemuck::cast(i.0)))
    }
    #[inline(always)]
    fn to_index(self) -> Index16 {
        Index16(bytemuck::cast(self.0.trunc_int()))
    }
    #[inline(always)]
    fn record(table: &[Record], index: Index16) -> [Self; 4] {
        assert!(!table.is_empty());
        let last = u32::try_from(table.len() - 1).unwrap_or(u32::MAX);
        let at = index.min(Index::splat(last)).0;
        let at = at.as_array();
        #[cfg(target_feature = "avx512f")]
        {
            use std::arch::x86_64::{
                __m512, _mm_load_ps, _mm512_castpd_ps, _mm512_castps_pd, _mm512_castps128_ps512, _mm512_insertf32x4,
                _mm512_unpackhi_pd, _mm512_unpackhi_ps, _mm512_unpacklo_pd, _mm512_unpacklo_ps,
            };
            // Register k takes the records of lanes k, k+4, k+8 and k+12; transposing the 4×4 blocks of four such
            // registers then leaves the lanes in order.
            // SAFETY: AVX-512F is there (cfg); every index was clamped to the table, whose records are 16-aligned.
            let lanes: [[f32; 16]; 4] = unsafe {
                let one = |lane: usize| _mm_load_ps(table.get_unchecked(at[lane] as usize).0.as_ptr());
                let four = |k: usize| {
                    let r = _mm512_castps128_ps512(one(k));
                    let r = _mm512_insertf32x4::<1>(r, one(k + 4));
                    let r = _mm512_insertf32x4::<2>(r, one(k + 8));
                    _mm512_insertf32x4::<3>(r, one(k + 12))
                };
                let (a, b, c, d) = (four(0), four(1), four(2), four(3));
                let (ab_xy, ab_zw) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
                let (cd_xy, cd_zw) = (_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
                let low = |p, q| _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(p), _mm512_castps_pd(q)));
                let high = |p, q| _mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(p), _mm512_castps_pd(q)));
                let lanes = [low(ab_xy, cd_xy), high(ab_xy, cd_xy), low(ab_zw, cd_zw), high(ab_zw, cd_zw)];
                std::mem::transmute::<[__m512; 4], [[f32; 16]; 4]>(lanes)
            };
            lanes.map(|l| Self(f32x16::new(l)))
        }
        #[cfg(not(target_feature = "avx512f"))]
        {
            // SAFETY: every index was clamped to the table.
            let one = |lane: usize| unsafe { table.get_unchecked(at[lane] as usize).0 };
            let mut out = [[0.0; 16]; 4];
            for lane in 0..16 {
                let r = one(lane);
                for word in 0..4 {
                    out[word][lane] = r[word];
                }
            }
            out.map(|l| Self(f32x16::new(l)))
        }
    }
}
