//! Colours: linear Rec. 709 RGB.

use rebond_lanes::{Mask, Real};
use std::ops::{Add, AddAssign, Mul, MulAssign};

/// Radiance, throughput or reflectance in linear Rec. 709.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rgb<F: Real> {
    /// Red.
    pub r: F,
    /// Green.
    pub g: F,
    /// Blue.
    pub b: F,
}

impl<F: Real> Rgb<F> {
    /// From three numbers.
    #[inline(always)]
    pub fn new(r: F, g: F, b: F) -> Self {
        Self { r, g, b }
    }
    /// The same colour in every lane.
    #[inline(always)]
    pub fn splat(c: [f32; 3]) -> Self {
        Self::new(F::splat(c[0]), F::splat(c[1]), F::splat(c[2]))
    }
    /// The grey of this value.
    #[inline(always)]
    pub fn grey(x: F) -> Self {
        Self::new(x, x, x)
    }
    /// Black.
    #[inline(always)]
    pub fn black() -> Self {
        Self::splat([0.0; 3])
    }
    /// White, 1.
    #[inline(always)]
    pub fn white() -> Self {
        Self::splat([1.0; 3])
    }
    /// The first three words of a record.
    #[inline(always)]
    pub fn of_record(r: [F; 4]) -> Self {
        Self::new(r[0], r[1], r[2])
    }
    /// One lane.
    pub fn lane(self, i: usize) -> [f32; 3] {
        [self.r.lane(i), self.g.lane(i), self.b.lane(i)]
    }
    /// Relative luminance
    #[inline(always)]
    pub fn luminance(self) -> F {
        self.r * LUMINANCE[0] + self.g * LUMINANCE[1] + self.b * LUMINANCE[2]
    }
    /// The largest channel.
    #[inline(always)]
    pub fn max(self) -> F {
        self.r.max(self.g).max(self.b)
    }
    /// Whether any channel differs from 0.
    #[inline(always)]
    pub fn is_lit(self) -> F::Mask {
        !(self.r.eq(F::zero()) & self.g.eq(F::zero()) & self.b.eq(F::zero()))
    }
    /// `a` where `mask`, else `b`.
    #[inline(always)]
    pub fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Self::new(F::select(mask, a.r, b.r), F::select(mask, a.g, b.g), F::select(mask, a.b, b.b))
    }
    /// Black outside `mask`.
    #[inline(always)]
    pub fn masked(self, mask: F::Mask) -> Self {
        if mask.all() { self } else { Self::select(mask, self, Self::black()) }
    }
    /// Each channel mapped.
    #[inline(always)]
    pub fn map(self, f: impl Fn(F) -> F) -> Self {
        Self::new(f(self.r), f(self.g), f(self.b))
    }
}

/// Weights of red, green and blue in the relative luminance (Rec. 709).
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Relative luminance of an RGB triple.
pub fn luminance(c: [f32; 3]) -> f32 {
    LUMINANCE[0] * c[0] + LUMINANCE[1] * c[1] + LUMINANCE[2] * c[2]
}

impl<F: Real> Add for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.r + o.r, self.g + o.g, self.b + o.b)
    }
}
impl<F: Real> Mul for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self::new(self.r * o.r, self.g * o.g, self.b * o.b)
    }
}
impl<F: Real> Mul<F> for Rgb<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: F) -> Self {
        Self::new(self.r * s, self.g * s, self.b * s)
    }
}
impl<F: Real> AddAssign for Rgb<F> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl<F: Real> MulAssign for Rgb<F> {
    #[inline(always)]
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}
