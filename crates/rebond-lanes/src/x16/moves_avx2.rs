//! Moving bits, lanes and records with AVX2.

use super::REVERSAL;
use crate::Record;
use std::arch::x86_64::{
    __m256, __m256i, _mm_load_ps, _mm_loadl_epi64, _mm_loadu_si128, _mm256_and_si256, _mm256_broadcastsi128_si256,
    _mm256_castpd_ps, _mm256_castps_pd, _mm256_castps128_ps256, _mm256_cvtepu8_epi32, _mm256_insertf128_ps,
    _mm256_loadu_ps, _mm256_or_si256, _mm256_permutevar8x32_ps, _mm256_set1_epi8, _mm256_shuffle_epi8,
    _mm256_srli_epi32, _mm256_storeu_ps, _mm256_unpackhi_pd, _mm256_unpackhi_ps, _mm256_unpacklo_pd,
    _mm256_unpacklo_ps,
};
use wide::{f32x16, u32x16};

/// The bits of every lane in reverse order.
#[inline(always)]
pub(super) fn reverse_bits(x: u32x16) -> u32x16 {
    // SAFETY: AVX2 is there (cfg); sixteen bytes are read from sixteen; any 64 bytes are two `__m256i` and sixteen
    // integers.
    unsafe {
        let everywhere = |bytes: &[u8; 16]| _mm256_broadcastsi128_si256(_mm_loadu_si128(bytes.as_ptr().cast()));
        let [low, high, bytes] = REVERSAL.each_ref().map(everywhere);
        let half = _mm256_set1_epi8(15);
        let eight = |x: __m256i| {
            let low = _mm256_shuffle_epi8(low, _mm256_and_si256(x, half));
            let high = _mm256_shuffle_epi8(high, _mm256_and_si256(_mm256_srli_epi32::<4>(x), half));
            _mm256_shuffle_epi8(_mm256_or_si256(low, high), bytes)
        };
        let x = std::mem::transmute::<[u32; 16], [__m256i; 2]>(*x.as_array());
        u32x16::new(std::mem::transmute::<[__m256i; 2], [u32; 16]>(x.map(eight)))
    }
}

/// For each set of eight lanes their numbers, side by side.
static SIDE_BY_SIDE: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut set = 0;
    while set < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < 8 {
            if set >> lane & 1 == 1 {
                table[set][n] = lane;
                n += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

/// The lanes whose bits are set, side by side; returns how many they are. What is behind them is unspecified.
#[inline(always)]
pub(super) fn compress(x: f32x16, bits: u32, to: &mut [f32; 16]) -> usize {
    let (first, second) = ((bits & 255) as usize, (bits >> 8 & 255) as usize);
    let n = first.count_ones() as usize;
    // SAFETY: AVX2 is there (cfg); eight bytes are read from eight, eight floats each from the halves of sixteen; eight
    // are written at 0 and at n ≤ 8 of sixteen.
    unsafe {
        let packed = |half: usize, set: usize| {
            let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(SIDE_BY_SIDE[set].as_ptr().cast()));
            _mm256_permutevar8x32_ps(_mm256_loadu_ps(x.as_array().as_ptr().add(8 * half)), order)
        };
        _mm256_storeu_ps(to.as_mut_ptr(), packed(0, first));
        _mm256_storeu_ps(to.as_mut_ptr().add(n), packed(1, second));
    }
    n + second.count_ones() as usize
}

/// The first, second, third and fourth numbers of the records at these places.
///
/// # Safety
/// The places are in the table.
#[inline(always)]
pub(super) unsafe fn records(table: &[Record], at: &[u32; 16]) -> [f32x16; 4] {
    // Register k takes the records of lanes k and k+4; transposing the 4×4 blocks of four such registers then leaves
    // the lanes in order.
    // SAFETY: AVX2 is there (cfg); the places are in the table (caller), whose records are 16-aligned.
    let lanes: [[f32; 16]; 4] = unsafe {
        let one = |lane: usize| _mm_load_ps(table.get_unchecked(at[lane] as usize).0.as_ptr());
        let two = |k: usize| _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(one(k)), one(k + 4));
        let low = |p, q| _mm256_castpd_ps(_mm256_unpacklo_pd(_mm256_castps_pd(p), _mm256_castps_pd(q)));
        let high = |p, q| _mm256_castpd_ps(_mm256_unpackhi_pd(_mm256_castps_pd(p), _mm256_castps_pd(q)));
        let eight = |k: usize| {
            let (a, b, c, d) = (two(k), two(k + 1), two(k + 2), two(k + 3));
            let (ab_xy, ab_zw) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (cd_xy, cd_zw) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            [low(ab_xy, cd_xy), high(ab_xy, cd_xy), low(ab_zw, cd_zw), high(ab_zw, cd_zw)]
        };
        let (first, second) = (eight(0), eight(8));
        std::mem::transmute::<[[__m256; 2]; 4], [[f32; 16]; 4]>(std::array::from_fn(|word| [first[word], second[word]]))
    };
    lanes.map(f32x16::new)
}
