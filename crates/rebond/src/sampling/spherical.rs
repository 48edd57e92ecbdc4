//! Triangles uniformly by solid angle.
//!
//! The map is Arvo's ("Stratified Sampling of Spherical Triangles", 1995): `u[0]` cuts the spherical triangle by an arc
//! from its apex, `u[1]` goes along that arc. The arc's other end is found as the mirror image of a corner in a half
//! vector (as in Peters, "BRDF Importance Sampling for Polygonal Lights", 2021), and every point as a place *within the
//! flat triangle*: sums of positive terms, relative to edges, so that nothing cancels however small it is.
//!
//! With unit vectors v0, v1 (apex), v2, `q_ij = 1 + v_i·v_j` and Ω the solid angle,
//!
//! ```text
//! tan(Ω/2) = |v0·(v1×v2)| / (q01 + q12 + q02 − 2)                         Van Oosterom and Strackee 1983, eq. 8
//! y = √q01 sin(uΩ/2),   d = √(2 q12 q02) sin((1−u)Ω/2)
//! v' ∝ d (d + 2y) v0 + 2y (d + y q02) v2                                  area(v0, v1, v') = uΩ
//! ```
//!
//! For h = x v0 + y v2 and v' the image of v0 in h, `tan(area/2) = y G0 / (x q01 + y G1)` with `G0 = |v0·(v1×v2)|` and
//! `G1 = v0·v2 + v1·v2`; solved for x : y with `G0 = R sin(Ω/2)`, `q01 + G1 = R cos(Ω/2)`, `R² = 2 q01 q12 q02`.

use crate::math::Vec3;
use rebond_lanes::{Real, math};
use std::f32::consts::PI;

/// A triangle as seen from the origin.
#[derive(Clone, Copy, Debug)]
pub struct SphericalTriangle<F: Real> {
    apex: Vec3<F>,
    edges: [Vec3<F>; 2],
    /// Distances of the apex and of the ends of the edges.
    lengths: [F; 3],
    /// 1 + cos of the angles between apex and first end, apex and second, first and second.
    sums: [F; 3],
    /// Ω/2.
    half: F,
}

/// Beyond these f32 does not tell directions apart: a receiver that nearly lies on an edge or in the triangle.
const SMALLEST_SUM: f32 = 1e-6;
const LARGEST_HALF: f32 = PI - 1e-3;

impl<F: Real> SphericalTriangle<F> {
    /// The triangle `apex`, `apex + edges[0]`, `apex + edges[1]`, none of them longer than about one; `volume` is
    /// `|apex · (edges[0] × edges[1])|`, which callers know better than f32 would compute it.
    #[inline(always)]
    pub fn new(apex: Vec3<F>, edges: [Vec3<F>; 2], volume: F) -> Self {
        let ends = edges.map(|e| apex + e);
        let lengths = [apex.length(), ends[0].length(), ends[1].length()];
        // 1 + cos from sin², where it would cancel.
        let sum = |a: Vec3<F>, b: Vec3<F>, between: Vec3<F>, lengths: F| {
            let inverse = lengths.recip();
            let cos = a.dot(b) * inverse;
            let sin2 = (a.cross(between) * inverse).length_squared();
            F::select(cos.lt(F::zero()), sin2 / (F::one() - cos), cos + 1.0)
        };
        let sums = [
            sum(apex, ends[0], edges[0], lengths[0] * lengths[1]),
            sum(apex, ends[1], edges[1], lengths[0] * lengths[2]),
            sum(ends[0], ends[1], edges[1] - edges[0], lengths[1] * lengths[2]),
        ];
        let half = math::atan2(volume / (lengths[0] * lengths[1] * lengths[2]), sums[0] + sums[1] + sums[2] - 2.0);
        Self { apex, edges, lengths, sums, half }
    }

    /// `a` where `mask`, else `b`.
    #[inline(always)]
    pub fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        let vector = |a, b| Vec3::select(mask, a, b);
        let number = |a: [F; 3], b: [F; 3]| [0, 1, 2].map(|i| F::select(mask, a[i], b[i]));
        Self {
            apex: vector(a.apex, b.apex),
            edges: [vector(a.edges[0], b.edges[0]), vector(a.edges[1], b.edges[1])],
            lengths: number(a.lengths, b.lengths),
            sums: number(a.sums, b.sums),
            half: F::select(mask, a.half, b.half),
        }
    }

    /// Its solid angle.
    #[inline(always)]
    pub fn solid_angle(&self) -> F {
        self.half * 2.0
    }

    /// Where [`SphericalTriangle::sample`] may be asked. Not in the triangle's plane, nor closer than about a thousandth
    /// of its size to it, or to an edge.
    #[inline(always)]
    pub fn is_sound(&self) -> F::Mask {
        let sum = self.sums[0].min(self.sums[1]).min(self.sums[2]);
        // NaN is not.
        sum.gt(F::splat(SMALLEST_SUM)) & self.half.gt(F::splat(1e-30)) & self.half.lt(F::splat(LARGEST_HALF))
    }

    /// A point uniform by solid angle, as (s, t): `apex + t (edges[0] + s (edges[1] − edges[0]))`. The density is 1/Ω.
    #[inline(always)]
    pub fn sample(&self, u: [F; 2]) -> [F; 2] {
        let [q01, q12, q02] = self.sums;
        let (y, _) = math::sin_cos(u[0] * self.half);
        let (d, _) = math::sin_cos((F::one() - u[0]) * self.half);
        let (y, d) = (q01.sqrt() * y, (q12 * q02 * 2.0).sqrt() * d);
        let inverse = (y + d).recip();
        let (y, d) = (y * inverse, d * inverse);
        let [l1, l0, l2] = self.lengths;
        let (w0, w2) = (d * (y + 1.0) * l2, y * (d + y * q02) * (l0 * 2.0));
        let s = (w2 / (w0 + w2)).clamp(0.0, 1.0);

        let along = (self.edges[1] - self.edges[0]).mul_add(s, self.edges[0]);
        let end = self.apex + along;
        let length = end.length();
        let inverse = (l1 * length).recip();
        let (cos, sin) = (self.apex.dot(end) * inverse, self.apex.cross(along).length() * inverse);
        let whole = F::select(cos.gt(F::zero()), sin * sin / (cos + 1.0), F::one() - cos);
        // 1 − cos of the angle from the apex is uniform; a share of the chord by the law of sines.
        let part = u[1] * whole;
        let sin_part = (part * (F::splat(2.0) - part)).safe_sqrt();
        let rest = (sin * (F::one() - part) - cos * sin_part).relu();
        [s, (sin_part * l1 / (rest * length + sin_part * l1)).clamp(0.0, 1.0)]
    }
}
