//! `Real`: a number on a light path, either one `f32` or sixteen of them.
//!
//! Everything that happens along a path (vectors, warps, Fresnel terms, lobes, emitters, cameras, samplers) is written
//! once, as `fn f<F: Real>(..)`. With `F = f32` it is the readable reference, with `F = `[`F32x16`] the production
//! engine. A comparison gives a [`Mask`]; `select` and `any` take the place of `if`.
//!
//! The two agree bit for bit: every operation of the trait is either exact, correctly rounded, or built from such
//! operations in the same order ([`math`]). `min`/`max` return the second operand when either is NaN.
//!
//! ```
//! use rebond_lanes::{F32x16, Real};
//! fn fourth_power<F: Real>(x: F) -> F {
//!     let x2 = x * x;
//!     x2 * x2
//! }
//! assert_eq!(fourth_power(3.0_f32), 81.0);
//! assert_eq!(fourth_power(F32x16::splat(3.0)).lane(7), 81.0);
//! ```

pub mod math;
pub mod scalar;
mod x16;

pub use x16::{F32x16, Index16, Mask16};

use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, BitOr, BitXor, Div, Mul, MulAssign, Neg, Not, Shl, Shr, Sub, SubAssign};

/// Four floats that are fetched together: the unit of every scene table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Record(pub [f32; 4]);

// SAFETY: four f32 (16 bytes) at alignment 16: no padding, and any bit pattern is a value.
unsafe impl bytemuck::Zeroable for Record {}
// SAFETY: as above.
unsafe impl bytemuck::Pod for Record {}

impl Record {
    /// A record whose last word is an integer, kept as its bits.
    pub fn with_word(x: f32, y: f32, z: f32, word: u32) -> Self {
        Self([x, y, z, f32::from_bits(word)])
    }
    /// A record of four integers, kept as their bits.
    pub fn words(words: [u32; 4]) -> Self {
        Self(words.map(f32::from_bits))
    }
}

/// Asks for the cache line where a value begins, which will be read soon.
#[inline(always)]
pub fn prefetch<T>(at: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(at).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

/// A truth value per lane.
pub trait Mask:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
    + Not<Output = Self>
{
    /// The same truth value in every lane.
    fn splat(b: bool) -> Self;
    /// Lane `i` is bit `i` of `bits`.
    fn from_bits(bits: u32) -> Self;
    /// Bit `i` is lane `i`; the bits above the last lane are 0.
    fn bits(self) -> u32;
    /// Whether any lane is true.
    fn any(self) -> bool;
    /// Whether all lanes are true.
    fn all(self) -> bool;
    /// Whether no lane is true.
    fn none(self) -> bool {
        !self.any()
    }
    /// How many lanes are true.
    fn count(self) -> u32 {
        self.bits().count_ones()
    }
    /// This mask without the lanes of `other`.
    fn and_not(self, other: Self) -> Self {
        self & !other
    }
}

/// An unsigned 32-bit integer per lane; arithmetic wraps.
pub trait Index:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
    + Not<Output = Self>
    + Shl<u32, Output = Self>
    + Shr<u32, Output = Self>
{
    /// The mask that comparing two of these gives.
    type Mask: Mask;
    /// The same value in every lane.
    fn splat(i: u32) -> Self;
    /// The value of one lane.
    fn lane(self, lane: usize) -> u32;
    /// One lane replaced.
    fn with_lane(self, lane: usize, value: u32) -> Self;
    /// Lane-wise equality.
    fn eq(self, other: Self) -> Self::Mask;
    /// Lane-wise unsigned less-than.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lane-wise unsigned minimum.
    fn min(self, other: Self) -> Self;
    /// `a` where `mask`, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Lane-wise inequality.
    fn ne(self, other: Self) -> Self::Mask {
        !self.eq(other)
    }
    /// The bits of the value in reverse order.
    fn reverse_bits(self) -> Self;
}

/// A number on a path: `f32`, or sixteen lanes of it.
pub trait Real:
    Copy
    + Debug
    + Default
    + Send
    + Sync
    + 'static
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
    + Div<f32, Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// What comparing two of these gives.
    type Mask: Mask;
    /// The integers that go with it.
    type Index: Index<Mask = Self::Mask>;
    /// How many numbers there are in one: 1 or 16.
    const LANES: usize;

    /// The same value in every lane.
    fn splat(x: f32) -> Self;
    /// The value of one lane.
    fn lane(self, lane: usize) -> f32;
    /// One lane replaced.
    fn with_lane(self, lane: usize, value: f32) -> Self;
    /// The first [`Real::LANES`] values of a slice.
    ///
    /// # Panics
    /// If the slice is shorter than that.
    fn load(from: &[f32]) -> Self;
    /// Writes the first [`Real::LANES`] values of a slice.
    ///
    /// # Panics
    /// If the slice is shorter than that.
    fn store(self, to: &mut [f32]);
    /// Writes the lanes of `mask`, side by side, to the start of `to` and returns how many they are. What follows them
    /// in the first [`Real::LANES`] places of `to` is unspecified.
    ///
    /// # Panics
    /// If `to` is shorter than [`Real::LANES`].
    fn compress(self, mask: Self::Mask, to: &mut [f32]) -> usize;

    /// `a` where `mask`, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// `self < other`; false for NaN, as are the next four.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`.
    fn le(self, other: Self) -> Self::Mask;
    /// `self > other`.
    fn gt(self, other: Self) -> Self::Mask {
        other.lt(self)
    }
    /// `self >= other`.
    fn ge(self, other: Self) -> Self::Mask {
        other.le(self)
    }
    /// `self == other`.
    fn eq(self, other: Self) -> Self::Mask;
    /// `self < other ? self : other`.
    fn min(self, other: Self) -> Self;
    /// `self > other ? self : other`.
    fn max(self, other: Self) -> Self;
    /// `self · m + a`, with one rounding on machines that have the instruction, two elsewhere.
    fn mul_add(self, m: Self, a: Self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Largest integer not above.
    fn floor(self) -> Self;
    /// The bits.
    fn to_bits(self) -> Self::Index;
    /// The number with these bits.
    fn from_bits(bits: Self::Index) -> Self;
    /// The integer as a number, rounded to nearest; for values below 2³¹.
    fn from_index(i: Self::Index) -> Self;
    /// The integer part; for values in [0, 2³¹).
    fn to_index(self) -> Self::Index;
    /// The record at `index` of each lane, transposed: the lanes of the first word, of the second, and so on. An index
    /// beyond the table reads its last record.
    ///
    /// # Panics
    /// If the table is empty.
    fn record(table: &[Record], index: Self::Index) -> [Self; 4];

    /// The same for a table of integers.
    #[inline(always)]
    fn words(table: &[Record], index: Self::Index) -> [Self::Index; 4] {
        let [a, b, c, d] = Self::record(table, index);
        [a.to_bits(), b.to_bits(), c.to_bits(), d.to_bits()]
    }

    /// Zero.
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// One.
    fn one() -> Self {
        Self::splat(1.0)
    }
    /// 1 / self.
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// `max(0, self)`; 0 for NaN.
    fn relu(self) -> Self {
        self.max(Self::zero())
    }
    /// Square root of `max(0, self)`.
    fn safe_sqrt(self) -> Self {
        self.relu().sqrt()
    }
    /// Between `lo` and `hi`.
    fn clamp(self, lo: f32, hi: f32) -> Self {
        self.max(Self::splat(lo)).min(Self::splat(hi))
    }
    /// The magnitude of self with the sign of `sign`.
    fn copy_sign(self, sign: Self) -> Self {
        let s = Self::Index::splat(0x8000_0000);
        Self::from_bits((self.to_bits() & !s) | (sign.to_bits() & s))
    }
    /// Neither infinite nor NaN.
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(Self::splat(f32::INFINITY))
    }
    /// self², self·self.
    fn sqr(self) -> Self {
        self * self
    }
}
