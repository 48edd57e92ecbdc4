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
    /// The words whose bit is set in `mask`, side by side; the rest is unspecified.
    fn compress(words: &[u32; 8], mask: u32) -> [u32; 8];
}

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
    fn compress(words: &[u32; 8], mask: u32) -> [u32; 8] {
        let mut out = [0; 8];
        let mut n = 0;
        for (i, word) in words.iter().enumerate() {
            out[n & 7] = *word;
            n += (mask >> i & 1) as usize;
        }
        out
    }
}

#[cfg(all(target_arch = "x86_64", target_feature = "avx2", target_feature = "fma"))]
mod avx2 {
    use super::{Lanes, Simd};
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
    }

    #[test]
    fn instruction_sets_agree() {
        agree::<Portable>();
        agree::<Native>();
    }
}
