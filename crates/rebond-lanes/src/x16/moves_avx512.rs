//! Moving bits, lanes and records with AVX-512.

use super::REVERSAL;
use crate::Record;
use std::arch::x86_64::{
    __m512, __m512i, _mm_load_ps, _mm_loadu_si128, _mm512_and_si512, _mm512_broadcast_i32x4, _mm512_castpd_ps,
    _mm512_castps_pd, _mm512_castps128_ps512, _mm512_insertf32x4, _mm512_loadu_ps, _mm512_maskz_compress_ps,
    _mm512_or_si512, _mm512_set1_epi8, _mm512_shuffle_epi8, _mm512_srli_epi32, _mm512_storeu_ps, _mm512_unpackhi_pd,
    _mm512_unpackhi_ps, _mm512_unpacklo_pd, _mm512_unpacklo_ps,
};
use wide::{f32x16, u32x16};

/// The bits of every lane in reverse order.
#[inline(always)]
pub(super) fn reverse_bits(x: u32x16) -> u32x16 {
    // SAFETY: AVX-512BW, and with it F, is there (cfg); sixteen bytes are read from sixteen; any 64 bytes are a
    // `__m512i` and sixteen integers.
    unsafe {
        let everywhere = |bytes: &[u8; 16]| _mm512_broadcast_i32x4(_mm_loadu_si128(bytes.as_ptr().cast()));
        let x = std::mem::transmute::<[u32; 16], __m512i>(*x.as_array());
        let half = _mm512_set1_epi8(15);
        let [low, high, bytes] = REVERSAL.each_ref().map(everywhere);
        let low = _mm512_shuffle_epi8(low, _mm512_and_si512(x, half));
        let high = _mm512_shuffle_epi8(high, _mm512_and_si512(_mm512_srli_epi32::<4>(x), half));
        let reversed = _mm512_shuffle_epi8(_mm512_or_si512(low, high), bytes);
        u32x16::new(std::mem::transmute::<__m512i, [u32; 16]>(reversed))
    }
}

/// The lanes whose bits are set, side by side; returns how many they are. What is behind them is unspecified.
#[inline(always)]
pub(super) fn compress(x: f32x16, bits: u32, to: &mut [f32; 16]) -> usize {
    // SAFETY: AVX-512F is there (cfg); sixteen floats are read from sixteen and written to sixteen.
    unsafe {
        let lanes = _mm512_loadu_ps(x.as_array().as_ptr());
        _mm512_storeu_ps(to.as_mut_ptr(), _mm512_maskz_compress_ps(bits as u16, lanes));
    }
    bits.count_ones() as usize
}

/// The first, second, third and fourth numbers of the records at these places.
///
/// # Safety
/// The places are in the table.
#[inline(always)]
pub(super) unsafe fn records(table: &[Record], at: &[u32; 16]) -> [f32x16; 4] {
    // Register k takes the records of lanes k, k+4, k+8 and k+12; transposing the 4×4 blocks of four such
    // registers then leaves the lanes in order.
    // SAFETY: AVX-512F is there (cfg); the places are in the table (caller), whose records are 16-aligned.
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
    lanes.map(f32x16::new)
}
