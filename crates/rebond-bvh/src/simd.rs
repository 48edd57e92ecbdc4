//! Four and eight floats at a time: AVX2 where the target has it, arrays everywhere.
//!
//! Only what the kernels need. Both implementations are compiled and tested wherever they can run.

/// `N` floats.
pub(crate) trait Lanes<const N: usize>: Copy {
    fn splat(x: f32) -> Self;
    fn load(from: &[f32; N]) -> Self;
    fn array(self) -> [f32; N];
    fn add(self, b: Self) -> Self;
    fn sub(self, b: Self) -> Self;
    fn mul(self, b: Self) -> Self;
    fn div(self, b: Self) -> Self;
    /// `self·m + a`, in one or two roundings.
    fn mul_add(self, m: Self, a: Self) -> Self;
    /// `a − self·m`, in one or two roundings.
    fn neg_mul_add(self, m: Self, a: Self) -> Self;
    /// The smaller; `b` when either is NaN.
    fn min(self, b: Self) -> Self;
    /// The larger; `b` when either is NaN.
    fn max(self, b: Self) -> Self;
    /// Bit `i` says whether lane `i` is `< b`; false for NaN.
    fn lt(self, b: Self) -> u32;
    /// Bit `i` says whether lane `i` is `≤ b`; false for NaN.
    fn le(self, b: Self) -> u32;
}

/// An instruction set.
pub(crate) trait Simd: Copy + Send + Sync + 'static {
    type F4: Lanes<4>;
    type F8: Lanes<8>;
    /// Lanes 0 to 3.
    fn low(x: Self::F8) -> Self::F4;
    /// Lanes 4 to 7.
    fn high(x: Self::F8) -> Self::F4;
    /// The same four lanes, twice.
    fn twice(x: Self::F4) -> Self::F8;
    /// Columns for rows.
    fn transpose(rows: [Self::F8; 8]) -> [Self::F8; 8];
    /// The words whose bit is set in `mask`, side by side; the rest is unspecified.
    fn compress(words: &[u32; 8], mask: u32) -> [u32; 8];
    /// The words of the lanes where `x` ≤ `limit`, by descending x. No x is negative.
    fn sort(words: &[u32; 8], x: Self::F8, limit: Self::F8) -> Sorted;
}

/// Words in order; of the arrays, the first `n`.
#[derive(Clone, Copy)]
pub(crate) struct Sorted {
    pub words: [u32; 8],
    /// What they are ordered by, rounded down by up to seven units in the last place.
    pub x: [f32; 8],
    pub n: usize,
    /// The word of least x; unspecified if `n` is 0.
    pub last: u32,
}

/// The bits that [`Simd::sort`] rounds off, to keep the number of the lane there.
const LANE: u32 = 7;

/// Arrays, left to the compiler.
#[derive(Clone, Copy)]
#[allow(dead_code)] // where there is AVX2, only the tests use it
pub(crate) struct Portable;

#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Array<const N: usize>([f32; N]);

#[allow(dead_code)]
impl<const N: usize> Array<N> {
    #[inline(always)]
    fn zip(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], b.0[i])))
    }
    #[inline(always)]
    fn bits(self, b: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..N).fold(0, |bits, i| bits | u32::from(f(self.0[i], b.0[i])) << i)
    }
}

impl<const N: usize> Lanes<N> for Array<N> {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; N])
    }
    #[inline(always)]
    fn load(from: &[f32; N]) -> Self {
        Self(*from)
    }
    #[inline(always)]
    fn array(self) -> [f32; N] {
        self.0
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        self.zip(b, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, m: Self, a: Self) -> Self {
        self.mul(m).add(a)
    }
    #[inline(always)]
    fn neg_mul_add(self, m: Self, a: Self) -> Self {
        a.sub(self.mul(m))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.zip(b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.zip(b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn lt(self, b: Self) -> u32 {
        self.bits(b, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        self.bits(b, |a, b| a <= b)
    }
}

impl Simd for Portable {
    type F4 = Array<4>;
    type F8 = Array<8>;
    #[inline(always)]
    fn low(x: Array<8>) -> Array<4> {
        Array(std::array::from_fn(|i| x.0[i]))
    }
    #[inline(always)]
    fn high(x: Array<8>) -> Array<4> {
        Array(std::array::from_fn(|i| x.0[i + 4]))
    }
    #[inline(always)]
    fn twice(x: Array<4>) -> Array<8> {
        Array(std::array::from_fn(|i| x.0[i & 3]))
    }
    #[inline(always)]
    fn transpose(rows: [Array<8>; 8]) -> [Array<8>; 8] {
        std::array::from_fn(|i| Array(std::array::from_fn(|j| rows[j].0[i])))
    }
    #[inline(always)]
    fn compress(words: &[u32; 8], mask: u32) -> [u32; 8] {
        let mut out = [0; 8];
        let mut n = 0;
        for (i, word) in words.iter().enumerate() {
            out[n & 7] = *word;
            n += (mask >> i & 1) as usize;
        }
        out
    }
    #[inline(always)]
    fn sort(words: &[u32; 8], x: Array<8>, limit: Array<8>) -> Sorted {
        let kept = x.le(limit);
        let mut keys: [u64; 8] = std::array::from_fn(|i| {
            let key = u64::from(x.0[i].to_bits() & !LANE) << 32 | u64::from(words[i]);
            if kept >> i & 1 == 1 { key } else { 0 }
        });
        keys.sort_unstable_by_key(|&key| std::cmp::Reverse(key));
        let n = kept.count_ones() as usize;
        let words = keys.map(|key| key as u32);
        Sorted { words, x: keys.map(|key| f32::from_bits((key >> 32) as u32)), n, last: words[n.saturating_sub(1) % 8] }
    }
}

#[cfg(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma"))]
mod avx2 {
    use super::{LANE, Lanes, Simd, Sorted};
    use std::arch::x86_64::*;

    /// 128- and 256-bit registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2;

    macro_rules! lanes {
        ($type:ty, $n:literal, $splat:ident $load:ident $store:ident $add:ident $sub:ident $mul:ident $div:ident
         $fmadd:ident $fnmadd:ident $min:ident $max:ident $cmp:ident $movemask:ident) => {
            impl Lanes<$n> for $type {
                #[inline(always)]
                fn splat(x: f32) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $splat(x) }
                }
                #[inline(always)]
                fn load(from: &[f32; $n]) -> Self {
                    // SAFETY: the target has AVX2 (cfg); exactly as many floats as the reference covers are read.
                    unsafe { $load(from.as_ptr()) }
                }
                #[inline(always)]
                fn array(self) -> [f32; $n] {
                    let mut out = [0.0; $n];
                    // SAFETY: the target has AVX2 (cfg); exactly as many floats as the array holds are written.
                    unsafe { $store(out.as_mut_ptr(), self) };
                    out
                }
                #[inline(always)]
                fn add(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $add(self, b) }
                }
                #[inline(always)]
                fn sub(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $sub(self, b) }
                }
                #[inline(always)]
                fn mul(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $mul(self, b) }
                }
                #[inline(always)]
                fn div(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $div(self, b) }
                }
                #[inline(always)]
                fn mul_add(self, m: Self, a: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $fmadd(self, m, a) }
                }
                #[inline(always)]
                fn neg_mul_add(self, m: Self, a: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $fnmadd(self, m, a) }
                }
                #[inline(always)]
                fn min(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $min(self, b) }
                }
                #[inline(always)]
                fn max(self, b: Self) -> Self {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $max(self, b) }
                }
                #[inline(always)]
                fn lt(self, b: Self) -> u32 {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $movemask($cmp::<_CMP_LT_OQ>(self, b)) as u32 }
                }
                #[inline(always)]
                fn le(self, b: Self) -> u32 {
                    // SAFETY: the target has AVX2 and FMA (cfg on this module).
                    unsafe { $movemask($cmp::<_CMP_LE_OQ>(self, b)) as u32 }
                }
            }
        };
    }
    lanes!(__m128, 4, _mm_set1_ps _mm_loadu_ps _mm_storeu_ps _mm_add_ps _mm_sub_ps _mm_mul_ps _mm_div_ps
        _mm_fmadd_ps _mm_fnmadd_ps _mm_min_ps _mm_max_ps _mm_cmp_ps _mm_movemask_ps);
    lanes!(__m256, 8, _mm256_set1_ps _mm256_loadu_ps _mm256_storeu_ps _mm256_add_ps _mm256_sub_ps _mm256_mul_ps
        _mm256_div_ps _mm256_fmadd_ps _mm256_fnmadd_ps _mm256_min_ps _mm256_max_ps _mm256_cmp_ps _mm256_movemask_ps);

    /// For every mask, the places of its set bits, four bits each.
    static SET_BITS: [u32; 256] = {
        let mut table = [0; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut i, mut n) = (0, 0);
            while i < 8 {
                if mask >> i & 1 == 1 {
                    table[mask] |= (i as u32) << (4 * n);
                    n += 1;
                }
                i += 1;
            }
            mask += 1;
        }
        table
    };

    impl Simd for Avx2 {
        type F4 = __m128;
        type F8 = __m256;
        #[inline(always)]
        fn low(x: __m256) -> __m128 {
            // SAFETY: the target has AVX2 (cfg on this module).
            unsafe { _mm256_castps256_ps128(x) }
        }
        #[inline(always)]
        fn high(x: __m256) -> __m128 {
            // SAFETY: the target has AVX2 (cfg on this module).
            unsafe { _mm256_extractf128_ps::<1>(x) }
        }
        #[inline(always)]
        fn twice(x: __m128) -> __m256 {
            // SAFETY: the target has AVX2 (cfg on this module).
            unsafe { _mm256_set_m128(x, x) }
        }
        #[inline(always)]
        fn transpose([a, b, c, d, e, f, g, h]: [__m256; 8]) -> [__m256; 8] {
            // SAFETY: the target has AVX2 (cfg on this module).
            unsafe {
                // Within each half, four columns of four rows.
                let quarter = |a, b, c, d| {
                    let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
                    let (ab_high, cd_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
                    [
                        _mm256_shuffle_ps::<0b01_00_01_00>(ab, cd),
                        _mm256_shuffle_ps::<0b11_10_11_10>(ab, cd),
                        _mm256_shuffle_ps::<0b01_00_01_00>(ab_high, cd_high),
                        _mm256_shuffle_ps::<0b11_10_11_10>(ab_high, cd_high),
                    ]
                };
                let (upper, lower) = (quarter(a, b, c, d), quarter(e, f, g, h));
                std::array::from_fn(|i| match i {
                    0..4 => _mm256_permute2f128_ps::<0x20>(upper[i], lower[i]),
                    _ => _mm256_permute2f128_ps::<0x31>(upper[i - 4], lower[i - 4]),
                })
            }
        }
        #[inline(always)]
        fn compress(words: &[u32; 8], mask: u32) -> [u32; 8] {
            let mut out = [0; 8];
            // SAFETY: the target has AVX2 (cfg); eight words are read from eight and written to eight.
            unsafe {
                let shifts = _mm256_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28);
                let places = _mm256_set1_epi32(SET_BITS[(mask & 0xff) as usize] as i32);
                let places = _mm256_srlv_epi32(places, shifts); // the permutation looks at the low three bits only
                let words = _mm256_loadu_si256(words.as_ptr().cast());
                let sorted = _mm256_permutevar8x32_epi32(words, places);
                _mm256_storeu_si256(out.as_mut_ptr().cast(), sorted);
            }
            out
        }
        #[inline(always)]
        fn sort(words: &[u32; 8], x: __m256, limit: __m256) -> Sorted {
            let mut sorted = Sorted { words: [0; 8], x: [0.0; 8], n: 0, last: 0 };
            // SAFETY: the target has AVX2 (cfg); eight words are read from eight and written to eight.
            unsafe {
                // As integers, floats that are not negative are ordered as they are; what is left out comes last.
                let kept = _mm256_cmp_ps::<_CMP_LE_OQ>(x, limit);
                let left_out = _mm256_xor_si256(_mm256_castps_si256(kept), _mm256_set1_epi32(-1));
                let lane_bits = _mm256_set1_epi32(LANE as i32);
                let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                let key = _mm256_or_si256(_mm256_andnot_si256(lane_bits, _mm256_castps_si256(x)), lane);
                let mut key = _mm256_or_si256(key, left_out);
                // Batcher's bitonic network, every comparison in the same direction.
                macro_rules! exchange {
                    ($other:expr, $upper:literal) => {
                        let other = $other;
                        let (most, least) = (_mm256_max_epi32(key, other), _mm256_min_epi32(key, other));
                        key = _mm256_blend_epi32::<$upper>(most, least);
                    };
                }
                exchange!(_mm256_shuffle_epi32::<0b10_11_00_01>(key), 0b1010_1010);
                exchange!(_mm256_shuffle_epi32::<0b00_01_10_11>(key), 0b1100_1100);
                exchange!(_mm256_shuffle_epi32::<0b10_11_00_01>(key), 0b1010_1010);
                let turned = _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0);
                exchange!(_mm256_permutevar8x32_epi32(key, turned), 0b1111_0000);
                exchange!(_mm256_shuffle_epi32::<0b01_00_11_10>(key), 0b1100_1100);
                exchange!(_mm256_shuffle_epi32::<0b10_11_00_01>(key), 0b1010_1010);
                sorted.n = _mm256_movemask_ps(kept).count_ones() as usize;
                let words = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(words.as_ptr().cast()), key);
                _mm256_storeu_si256(sorted.words.as_mut_ptr().cast(), words);
                let x = _mm256_andnot_si256(lane_bits, key);
                _mm256_storeu_si256(sorted.x.as_mut_ptr().cast(), x);
                let last = _mm256_permutevar8x32_epi32(words, _mm256_set1_epi32(sorted.n as i32 - 1));
                sorted.last = _mm256_cvtsi256_si32(last) as u32;
            }
            sorted
        }
    }
}

#[cfg(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma"))]
pub(crate) use avx2::Avx2;

/// Asks for a cache line.
#[inline(always)]
pub(crate) fn prefetch<T>(at: *const T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing; any address will do.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

/// What the queries run on.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma"))]
pub(crate) type Native = Avx2;
/// What the queries run on.
#[cfg(not(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma")))]
pub(crate) type Native = Portable;

#[cfg(test)]
mod tests {
    use super::*;

    fn agree<S: Simd>() {
        let words = std::array::from_fn(|i| 10 + i as u32);
        for mask in 0..256_u32 {
            let n = mask.count_ones() as usize;
            assert_eq!(S::compress(&words, mask)[..n], Portable::compress(&words, mask)[..n]);
        }
        let mut word = 1_u32;
        let mut random = || {
            word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            [0.0, 1.0, 1.5, f32::INFINITY, f32::NAN, (word >> 8) as f32, f32::from_bits(word >> 2)]
                [(word >> 29) as usize % 7]
        };
        for _ in 0..if cfg!(miri) { 10 } else { 1000 } {
            let (x, limit) = (std::array::from_fn(|_| random()), std::array::from_fn(|_| random()));
            let sorted = S::sort(&words, S::F8::load(&x), S::F8::load(&limit));
            let mut expected: Vec<usize> = (0..8).filter(|&i| x[i] <= limit[i]).collect();
            assert_eq!(sorted.n, expected.len());
            let mut found = sorted.words[..sorted.n].to_vec();
            assert!(found.last().is_none_or(|&last| last == sorted.last));
            for (k, &word) in found.iter().enumerate() {
                let (exact, rounded) = (x[word as usize - 10], sorted.x[k]);
                assert_eq!(rounded.to_bits(), exact.to_bits() & !7);
                assert!(k == 0 || rounded <= sorted.x[k - 1]);
            }
            found.sort_unstable();
            expected.iter_mut().for_each(|i| *i += 10);
            assert_eq!(found.iter().map(|&word| word as usize).collect::<Vec<_>>(), expected);
        }
        let (nan, x) = (S::F8::splat(f32::NAN), S::F8::splat(1.0));
        assert_eq!(nan.min(x).array(), [1.0; 8]);
        assert_eq!(nan.max(x).array(), [1.0; 8]);
        assert!(x.min(nan).array()[0].is_nan() && x.max(nan).array()[0].is_nan());
        assert_eq!(nan.lt(x) | nan.le(x) | x.lt(x), 0);
        assert_eq!(x.le(x), 255);
        let ramp = S::F8::load(&std::array::from_fn(|i| i as f32));
        assert_eq!(S::low(ramp).array(), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(S::high(ramp).array(), [4.0, 5.0, 6.0, 7.0]);
        assert_eq!(S::twice(S::high(ramp)).array(), [4.0, 5.0, 6.0, 7.0, 4.0, 5.0, 6.0, 7.0]);
        assert_eq!(ramp.neg_mul_add(x, x).array()[3], -2.0);
        assert_eq!(ramp.lt(S::F8::splat(2.5)), 0b111);
        let rows = std::array::from_fn(|i| S::F8::load(&std::array::from_fn(|j| (8 * i + j) as f32)));
        for (j, column) in S::transpose(rows).into_iter().enumerate() {
            assert_eq!(column.array(), std::array::from_fn(|i| (8 * i + j) as f32));
        }
    }

    #[test]
    fn instruction_sets_agree() {
        agree::<Portable>();
        agree::<Native>();
    }
}
