//! Elementary functions, the same polynomials for every width.
//!
//! Each is accurate to a few units in the last place over the range that shading needs; the bound that its test holds
//! stands beside it. The coefficients are minimax fits; range reductions follow Cody and Waite (1980).

// The digits of the fits, not of their roundings.
#![allow(clippy::excessive_precision)]

use crate::{Index, Real};
use std::f32::consts::{FRAC_PI_2, LN_2, LOG2_E, PI};

/// Horner's rule, highest power first.
#[inline(always)]
fn polynomial<F: Real, const N: usize>(x: F, coefficients: [f32; N]) -> F {
    let mut sum = F::splat(coefficients[0]);
    for c in &coefficients[1..] {
        sum = sum.mul_add(x, F::splat(*c));
    }
    sum
}

/// (sin x, cos x), for |x| ≤ 8192; absolute error below 1.5e-7.
#[inline(always)]
pub fn sin_cos<F: Real>(x: F) -> (F, F) {
    // x = q·π/2 + r with |r| ≤ π/4, π/2 in three parts so that the subtraction is exact enough.
    let q = (x * (2.0 / PI) + 0.5).floor();
    let r = q.mul_add(F::splat(-1.570_312_5), x);
    let r = q.mul_add(F::splat(-4.837_512_97e-4), r);
    let r = q.mul_add(F::splat(-7.549_789_95e-8), r);
    let r2 = r * r;
    let s = (r2 * r).mul_add(polynomial(r2, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]), r);
    let c = (r2 * r2).mul_add(
        polynomial(r2, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]),
        r2.mul_add(F::splat(-0.5), F::one()),
    );
    // q mod 4; q + 8192·4 is positive, and adding a multiple of four leaves the quadrant.
    let quadrant = (q + 32_768.0).to_index();
    let odd = (quadrant & F::Index::splat(1)).eq(F::Index::splat(1));
    let sin_sign = (quadrant & F::Index::splat(2)) << 30;
    let cos_sign = ((quadrant + F::Index::splat(1)) & F::Index::splat(2)) << 30;
    let (sin, cos) = (F::select(odd, c, s), F::select(odd, s, c));
    (F::from_bits(sin.to_bits() ^ sin_sign), F::from_bits(cos.to_bits() ^ cos_sign))
}

/// 2ˣ; relative error below 3e-7; 0 below −126 and ∞ from 128 on.
#[inline(always)]
pub fn exp2<F: Real>(x: F) -> F {
    let clamped = x.clamp(-126.0, 127.999_99);
    let whole = clamped.floor();
    let part = clamped - whole;
    let p = polynomial(
        part,
        [2.170_225_5e-4, 1.243_968_8e-3, 9.678_841e-3, 5.548_334_2e-2, 2.402_298_4e-1, 6.931_469_8e-1, 1.0],
    );
    let scale = F::from_bits((whole + 127.0).to_index() << 23);
    let value = F::select(x.lt(F::splat(-126.0)), F::zero(), p * scale);
    F::select(x.ge(F::splat(128.0)), F::splat(f32::INFINITY), value)
}

/// eˣ.
#[inline(always)]
pub fn exp<F: Real>(x: F) -> F {
    exp2(x * LOG2_E)
}

/// log₂ x for positive normal x; −∞ at 0 and below.
#[inline(always)]
pub fn log2<F: Real>(x: F) -> F {
    // x = 2^e · m with m in [√½, √2); ln m by the series of 2·artanh((m−1)/(m+1)).
    let bits = x.to_bits();
    let shifted = bits - F::Index::splat(0x3f35_04f3); // √½
    let exponent = shifted >> 23;
    // The exponent is signed: take it from the biased sum instead of an arithmetic shift.
    let e = F::from_index((exponent + F::Index::splat(0x80)) & F::Index::splat(0x1ff)) - 128.0;
    let m = F::from_bits((shifted & F::Index::splat(0x007f_ffff)) + F::Index::splat(0x3f35_04f3));
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let artanh = s * polynomial(s2, [0.149_634_8, 0.199_873_7, 0.333_334_1, 1.0]);
    let value = artanh.mul_add(F::splat(2.0 * LOG2_E), e);
    F::select(x.gt(F::zero()), value, F::splat(f32::NEG_INFINITY))
}

/// ln x for positive normal x; −∞ at 0 and below.
#[inline(always)]
pub fn ln<F: Real>(x: F) -> F {
    log2(x) * LN_2
}

/// xʸ for x ≥ 0; 0⁰ = 1. The relative error grows with |y · log₂ x|, to about 1e-5 where the result nears 1e-30.
#[inline(always)]
pub fn pow<F: Real>(x: F, y: F) -> F {
    let value = exp2(y * log2(x));
    F::select(y.eq(F::zero()), F::one(), value)
}

/// arccos x for x in [−1, 1] (clamped); absolute error below 1e-6.
#[inline(always)]
pub fn acos<F: Real>(x: F) -> F {
    let x = x.clamp(-1.0, 1.0);
    atan2(((F::one() - x) * (F::one() + x)).safe_sqrt(), x)
}

/// The angle of (x, y) from the x axis, in (−π, π]; absolute error below 1e-6; 0 at the origin.
#[inline(always)]
pub fn atan2<F: Real>(y: F, x: F) -> F {
    let (ax, ay) = (x.abs(), y.abs());
    let (big, small) = (ax.max(ay), ax.min(ay));
    let t = F::select(big.gt(F::zero()), small / big, F::zero());
    // Fold [tan π/8, 1] onto [−tan π/8, 0] by atan t = π/4 + atan((t−1)/(t+1)).
    let folded = t.gt(F::splat(0.414_213_56));
    let r = F::select(folded, (t - 1.0) / (t + 1.0), t);
    let r2 = r * r;
    let p = polynomial(r2, [8.053_744e-2, -1.387_768_56e-1, 1.997_771_1e-1, -3.333_294_9e-1]);
    let a = (r2 * r).mul_add(p, r);
    let a = F::select(folded, a + std::f32::consts::FRAC_PI_4, a);
    let a = F::select(ay.gt(ax), F::splat(FRAC_PI_2) - a, a);
    let a = F::select(x.lt(F::zero()), F::splat(PI) - a, a);
    a.copy_sign(y)
}
