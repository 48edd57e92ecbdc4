//! One lane: `f32`, `bool` and a wrapping `u32`.

use crate::{Index, Mask, Real, Record};
use std::ops::{Add, BitAnd, BitOr, BitXor, Mul, Not, Shl, Shr, Sub};

impl Mask for bool {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        b
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        bits & 1 != 0
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.into()
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
}

/// A `u32` whose arithmetic wraps, as it does in lanes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Index1(pub u32);

macro_rules! index_operator {
    ($($operator:ident $function:ident $other:ty, |$a:ident, $b:ident| $value:expr;)*) => {$(
        impl $operator<$other> for Index1 {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: $other) -> Self {
                let ($a, $b) = (self, other);
                Self($value)
            }
        }
    )*};
}
index_operator! {
    Add add Self, |a, b| a.0.wrapping_add(b.0);
    Sub sub Self, |a, b| a.0.wrapping_sub(b.0);
    Mul mul Self, |a, b| a.0.wrapping_mul(b.0);
    BitAnd bitand Self, |a, b| a.0 & b.0;
    BitOr bitor Self, |a, b| a.0 | b.0;
    BitXor bitxor Self, |a, b| a.0 ^ b.0;
    Shl shl u32, |a, b| a.0 << b;
    Shr shr u32, |a, b| a.0 >> b;
}

impl Not for Index1 {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Index for Index1 {
    type Mask = bool;
    #[inline(always)]
    fn splat(i: u32) -> Self {
        Self(i)
    }
    #[inline(always)]
    fn lane(self, _: usize) -> u32 {
        self.0
    }
    #[inline(always)]
    fn with_lane(self, _: usize, value: u32) -> Self {
        Self(value)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self.0 == other.0
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn reverse_bits(self) -> Self {
        Self(self.0.reverse_bits())
    }
}

impl Real for f32 {
    type Mask = bool;
    type Index = Index1;
    const LANES: usize = 1;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f32 {
        self
    }
    #[inline(always)]
    fn with_lane(self, _: usize, value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[0] = self;
    }
    #[inline(always)]
    fn compress(self, mask: bool, to: &mut [f32]) -> usize {
        to[0] = self;
        mask.into()
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn mul_add(self, m: Self, a: Self) -> Self {
        // Where `wide` has no fused instruction it rounds twice; so must this.
        if cfg!(any(target_feature = "fma", target_arch = "aarch64")) { f32::mul_add(self, m, a) } else { self * m + a }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        f32::floor(self)
    }
    #[inline(always)]
    fn to_bits(self) -> Index1 {
        Index1(f32::to_bits(self))
    }
    #[inline(always)]
    fn from_bits(bits: Index1) -> Self {
        f32::from_bits(bits.0)
    }
    #[inline(always)]
    fn from_index(i: Index1) -> Self {
        i.0 as i32 as f32
    }
    #[inline(always)]
    fn to_index(self) -> Index1 {
        Index1(self as i32 as u32)
    }
    #[inline(always)]
    fn record(table: &[Record], index: Index1) -> [Self; 4] {
        table[(index.0 as usize).min(table.len() - 1)].0
    }
}
