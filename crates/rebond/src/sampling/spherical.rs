//! Triangles and rectangles uniformly by solid angle.
//!
//! The map of triangles is Arvo's ("Stratified Sampling of Spherical Triangles", 1995): `u[0]` cuts the spherical triangle by an arc
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

/// A rectangle [x, x + w] × [y, y + h] × {z} as seen from the origin, z > 0: the map of Ureña, Fajardo and King ("An
/// Area-Preserving Parametrization for Spherical Rectangles", 2013). `u[0]` cuts it by a line of constant x, `u[1]` goes
/// along that line. Strata keep their shape better than in two triangles.
///
/// The solid angle of [0, x] × [y0, y1] is `asin(b1 c) − asin(b0 c)` with `b = y/√(y² + z²)`, `c = x/√(x² + z²)`. Solved for x,
///
/// ```text
/// tan²ψ = x²/z² = sin²φ / Q(φ),   Q(φ) = (b1 − b0)² + 2 b0 b1 (1 − cosφ) − sin²φ
/// ```
///
/// and here x is found as a difference from the rectangle's side, by factors, so that narrow rectangles lose no digits.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle<F: Real> {
    x: F,
    y: F,
    z: F,
    w: F,
    h: F,
    solid_angle: F,
}

/// `1 − cos` from the sine and the cosine.
#[inline(always)]
fn versine<F: Real>(sin: F, cos: F) -> F {
    F::select(cos.gt(F::zero()), sin * sin / (cos + 1.0), F::one() - cos)
}

/// `b/√(b² + d²) − a/√(a² + d²)` for b = a + l.
#[inline(always)]
fn difference_of_sines<F: Real>(a: F, l: F, d: F) -> F {
    let b = a + l;
    let (ra, rb) = ((a * a + d * d).sqrt(), (b * b + d * d).sqrt());
    let factors = d * d * l * (a + b) / ((b * ra + a * rb) * ra * rb);
    F::select((a * b).gt(F::zero()), factors, b / rb - a / ra)
}

impl<F: Real> SphericalRectangle<F> {
    /// From a corner, the lengths of the edges, and the solid angle.
    #[inline(always)]
    pub fn new([x, y, z]: [F; 3], [w, h]: [F; 2], solid_angle: F) -> Self {
        Self { x, y, z, w, h, solid_angle }
    }

    /// Where [`SphericalRectangle::sample`] may be asked: not at grazing angles, at which f32 does not suffice.
    #[inline(always)]
    pub fn is_sound(&self) -> F::Mask {
        let extent = self.x.abs() + self.y.abs() + self.w + self.h;
        self.z.gt(extent * 0.05)
    }

    /// A point uniform by solid angle, as shares of the edges.
    #[inline(always)]
    pub fn sample(&self, u: [F; 2]) -> [F; 2] {
        let Self { x, y, z, w, h, solid_angle } = *self;
        let one = F::one();
        let sine = |a: F| a / (a * a + z * z).sqrt();
        let (b0, b1, c) = (sine(y), sine(y + h), sine(x));
        let (delta, both) = (difference_of_sines(y, h, z), b0 * b1);

        // φ0, the signed solid angle from 0 to this side.
        let (b0c, b1c) = (b0 * c, b1 * c);
        let (r0, r1) = ((one - b0c * b0c).safe_sqrt(), (one - b1c * b1c).safe_sqrt());
        let factors = c * delta * (b0 + b1) / (b1 * r0 + b0 * r1);
        let sin0 = F::select(both.gt(F::zero()), factors, b1c * r0 - b0c * r1);
        let cos0 = r0 * r1 + b0c * b1c;
        let (phi0, versine0) = (math::atan2(sin0, cos0), versine(sin0, cos0));

        let part = u[0] * solid_angle * 0.5;
        let (sin_half, cos_half) = math::sin_cos((phi0 + part * 2.0) * 0.5);
        let (sin, versine) = (sin_half * cos_half * 2.0, sin_half * sin_half * 2.0);
        let q = (delta * delta + both * versine * 2.0 - sin * sin).relu();
        let (tan, tan0) = (sin / q.sqrt(), x / z);
        // tan²ψ − tan²ψ0 = (cosφ0 − cosφ) (…) / (Q Q0).
        let q0 = (delta * delta + both * versine0 * 2.0) * (one - c * c);
        let difference = math::sin_cos(phi0 + part).0 * math::sin_cos(part).0 * 2.0;
        let bracket = (one * 2.0 - versine - versine0) * delta * delta - both * versine * versine0 * 2.0;
        let factors = difference * bracket / (q * q0 * (tan + tan0));
        let across = F::select((tan * tan0).gt(F::zero()), factors, tan - tan0) * z;
        let across = across.max(F::zero()).min(w);

        // Along the line: the sine of the elevation is uniform.
        let x = x + across;
        let d = (x * x + z * z).sqrt();
        let r = (y * y + d * d).sqrt();
        let step = u[1] * difference_of_sines(y, h, d);
        let sine0 = y / r;
        let sine = sine0 + step;
        let cos2 = (one - sine * sine).relu();
        let (tan, tan0) = (sine / cos2.sqrt(), y / d);
        let factors = step * (sine + sine0) * r * r / (cos2 * d * d * (tan + tan0));
        let along = F::select((tan * tan0).gt(F::zero()), factors, tan - tan0) * d;
        [across / w, (along / h).clamp(0.0, 1.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::vec3;
    use crate::testing::seeded_pairs;
    use glam::DVec3;

    fn solid_angle(a: DVec3, ab: DVec3, ac: DVec3) -> f64 {
        let (b, c) = (a + ab, a + ac);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * a.dot(ab.cross(ac)).abs().atan2(denominator)
    }

    /// Values of `n` tests, each of eight numbers in [0, 1).
    fn eights(n: u32) -> impl Iterator<Item = [f32; 8]> {
        let mut pairs = seeded_pairs(4 * n, 9);
        (0..n).map(move |_| {
            let four: [[f32; 2]; 4] = std::array::from_fn(|_| pairs.next().expect("as many"));
            std::array::from_fn(|i| four[i / 2][i % 2])
        })
    }

    /// Both cuts have the share that they were asked for, judged in f64, whatever the rectangle's size.
    #[test]
    fn rectangles_are_cut_where_asked() {
        let (mut tested, mut worst) = (0, [0.0_f64; 2]);
        for [a, b, c, d, e, f, g, h] in eights(100_000) {
            let far = |u: f32| (u * 2.0 - 1.0) * 10.0;
            let size = |u: f32| 10.0_f32.powf(u * 6.0 - 4.0);
            let (x, y, z, w, l) = (far(a), far(b), 0.1 + 5.0 * c, size(d), size(e));
            let up = [x, y, z, w, l].map(f64::from);
            let part = |w: f64| {
                let corner = DVec3::new(up[0], up[1], up[2]);
                let (ex, ey) = (DVec3::X * w, DVec3::Y * up[4]);
                solid_angle(corner, ex, ex + ey) + solid_angle(corner, ex + ey, ey)
            };
            let whole = part(up[3]);
            let rectangle = SphericalRectangle::new([x, y, z], [w, l], whole as f32);
            if !rectangle.is_sound() {
                continue;
            }
            let u = [f, if tested % 50 == 0 { 0.0 } else { g * h.sqrt() }];
            let [s, t] = rectangle.sample(u).map(f64::from);
            let d = (up[0] + s * up[3]).hypot(up[2]);
            let sine = |t: f64| (up[1] + t * up[4]) / (up[1] + t * up[4]).hypot(d);
            let share = (sine(t) - sine(0.0)) / (sine(1.0) - sine(0.0));
            worst[0] = worst[0].max((part(s * up[3]) / whole - f64::from(u[0])).abs());
            worst[1] = worst[1].max((share - f64::from(u[1])).abs());
            tested += 1;
        }
        assert!(tested > 30_000 && worst.iter().all(|w| *w < 1e-4), "{tested}: {worst:?}");
    }

    #[test]
    fn triangles_are_cut_where_asked() {
        let (mut tested, mut worst) = (0, [0.0_f64; 2]);
        let numbers: Vec<[f32; 8]> = eights(200_000).collect();
        for pair in numbers.chunks_exact(2) {
            let [[a, b, c, d, e, f, g, h], [i, j, k, u, v, ..]] = [pair[0], pair[1]];
            let vector = |a: f32, b: f32, c: f32, size: f32| {
                vec3(a * 2.0 - 1.0, b * 2.0 - 1.0, c * 2.0 - 1.0) * 10.0_f32.powf(size)
            };
            let apex = vector(a, b, c, 0.0);
            let edges = [vector(d, e, f, g * -5.0), vector(h, i, j, k * -5.0)];
            let up = |v: Vec3<f32>| DVec3::new(v.x.into(), v.y.into(), v.z.into());
            let (p, [e0, e1]) = (up(apex), edges.map(up));
            let volume = p.dot(e0.cross(e1)).abs();
            let triangle = SphericalTriangle::new(apex, edges, volume as f32);
            let whole = solid_angle(p, e0, e1);
            let grazing = volume < 1e-2 * p.length() * e0.cross(e1).length()
                || volume < 1e-2 * p.length() * e0.length() * e1.length();
            if !triangle.is_sound() || grazing {
                continue;
            }
            assert!((f64::from(triangle.solid_angle()) / whole - 1.0).abs() < 1e-5);
            let [s, t] = triangle.sample([u, v]).map(f64::from);
            let along = e0.lerp(e1, s);
            let one_minus_cos = |to: DVec3| {
                let (across, dot) = (p.cross(to).length(), p.dot(p + to));
                1.0 - across.atan2(dot).cos()
            };
            worst[0] = worst[0].max((solid_angle(p, e0, along) / whole - f64::from(u)).abs());
            // Half an angle squared, where 1 − cos has no digits left.
            let angle = |to: DVec3| p.cross(to).length().atan2(p.dot(p + to));
            let share = if angle(along) < 1e-3 {
                (angle(along * t) / angle(along)).powi(2)
            } else {
                one_minus_cos(along * t) / one_minus_cos(along)
            };
            worst[1] = worst[1].max((share - f64::from(v)).abs());
            tested += 1;
        }
        assert!(tested > 30_000 && worst.iter().all(|w| *w < 16.0 * f64::from(f32::EPSILON)), "{tested}: {worst:?}");
    }
}
