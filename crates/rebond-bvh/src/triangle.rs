//! Four triangles at a time, watertight.
//!
//! S. Woop, C. Benthin, I. Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. The corners, relative to the
//! ray's origin, are sheared so that the ray becomes the z axis; a triangle is hit when the origin lies on the same
//! side of its three edges in the xy plane. A corner is sheared by the same arithmetic in whatever triangle it occurs,
//! and the sign of an edge function a·b − c·d over floats is exact: both products are rounded, rounding is monotone,
//! and where the products come out equal they are taken again in f64, which holds them exactly. (For that reason no
//! fused multiply-add may be used there.) So the sheared triangles of a closed mesh cover the plane without a gap.

use crate::Filter;
use crate::ray::{Best, SingleRay};
use crate::simd::{Lanes, Simd};

/// Up to four triangles; unused places repeat the last one.
#[derive(Clone, Copy, Debug, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Block {
    /// First corner of the four, second corner of the four; along x, y, z.
    pub ab: [[f32; 8]; 3],
    /// Third corners; along x, y, z.
    pub c: [[f32; 4]; 3],
    /// Primitives, [`THIN`] or not.
    words: [u32; 4],
}

/// Marks a triangle longer than [`SLENDER`] times its mean width: rounding would move a hit along it.
const THIN: u32 = 1 << 31;
const SLENDER: f64 = 32.0;

/// What a block says to a ray: the edge functions of the triangles that may be hit.
struct Edges<S: Simd> {
    /// The triangles whose edges the ray passes all on one side.
    inside: u32,
    /// Those of them where an edge function is zero.
    doubtful: u32,
    u: S::F4,
    v: S::F4,
    w: S::F4,
    /// Sheared x and y of the first two corners and of the third, and unsheared z.
    ab: [S::F8; 3],
    c: [S::F4; 3],
}

impl Block {
    /// The block of 1 to 4 triangles.
    pub fn new(triangles: &[([[f32; 3]; 3], u32)]) -> Self {
        let mut block = Self { ab: [[0.0; 8]; 3], c: [[0.0; 4]; 3], words: [0; 4] };
        for i in 0..4 {
            let (corners, primitive) = triangles[i.min(triangles.len() - 1)];
            for k in 0..3 {
                block.ab[k][i] = corners[0][k];
                block.ab[k][i + 4] = corners[1][k];
                block.c[k][i] = corners[2][k];
            }
            block.words[i] = primitive | if is_thin(corners) { THIN } else { 0 };
        }
        block
    }

    /// Primitives have numbers below this.
    pub const MAX_PRIMITIVES: usize = THIN as usize;

    /// The number of triangle `i`.
    #[inline(always)]
    pub fn primitive(&self, i: usize) -> u32 {
        self.words[i] & !THIN
    }
    /// Whether triangle `i` wants more digits.
    #[inline(always)]
    pub fn is_thin(&self, i: usize) -> bool {
        self.words[i] & THIN != 0
    }
    /// Bit `i`: triangle `i` is thin.
    #[inline(always)]
    fn thin(&self) -> u32 {
        self.words.iter().enumerate().fold(0, |bits, (i, word)| bits | (word >> 31) << i)
    }
    /// The corners of triangle `i`.
    pub fn corners(&self, i: usize) -> [[f32; 3]; 3] {
        [self.ab.map(|x| x[i]), self.ab.map(|x| x[i + 4]), self.c.map(|x| x[i])]
    }

    #[inline(always)]
    fn edges<S: Simd>(&self, ray: &SingleRay) -> Option<Edges<S>> {
        let [x, y, z] = ray.axes();
        let ab = |axis: usize, k: usize| {
            // SAFETY: the axes of a `SingleRay` are a permutation of 0, 1, 2.
            S::F8::load(unsafe { self.ab.get_unchecked(axis) }).sub(S::F8::splat(ray.origin[k]))
        };
        let c = |axis: usize, k: usize| {
            // SAFETY: the axes of a `SingleRay` are a permutation of 0, 1, 2.
            S::F4::load(unsafe { self.c.get_unchecked(axis) }).sub(S::F4::splat(ray.origin[k]))
        };
        let (ab_z, c_z) = (ab(z, 2), c(z, 2));
        let [sx, sy, _] = ray.shear;
        let ab_x = ab_z.neg_mul_add(S::F8::splat(sx), ab(x, 0));
        let ab_y = ab_z.neg_mul_add(S::F8::splat(sy), ab(y, 1));
        let c_x = c_z.neg_mul_add(S::F4::splat(sx), c(x, 0));
        let c_y = c_z.neg_mul_add(S::F4::splat(sy), c(y, 1));
        // Lanes 0 to 3: v = ax·cy − ay·cx. Lanes 4 to 7: bx·cy − by·cx, which is −u to the bit.
        let vu = ab_x.mul(S::twice(c_y)).sub(ab_y.mul(S::twice(c_x)));
        let (v, minus_u) = (S::low(vu), S::high(vu));
        let u = S::F4::splat(0.0).sub(minus_u);
        let w = S::high(ab_x).mul(S::low(ab_y)).sub(S::high(ab_y).mul(S::low(ab_x)));
        let zero = S::F4::splat(0.0);
        let (least, most) = (u.min(v).min(w), u.max(v).max(w));
        let inside = !(least.lt(zero) & zero.lt(most)) & 0xf;
        if inside == 0 {
            return None;
        }
        let doubtful = inside & !(zero.lt(least) | most.lt(zero));
        Some(Edges { inside, doubtful, u, v, w, ab: [ab_x, ab_y, ab_z], c: [c_x, c_y, c_z] })
    }

    /// Puts the nearest hit of the block into `best` if it comes before.
    #[inline(always)]
    pub fn closest<S: Simd>(&self, ray: &SingleRay, instance: u32, filter: &impl Filter, best: &mut Best) {
        if let Some(edges) = self.edges::<S>(ray) {
            let (mut hits, t, u, v) = edges.hits(self, ray, best.t);
            while hits != 0 {
                let i = hits.trailing_zeros() as usize & 3;
                hits &= hits - 1;
                let primitive = self.primitive(i);
                if best.yields_to(t[i], primitive, instance) && filter.keep(primitive, instance, u[i], v[i]) {
                    *best = Best { t: t[i], u: u[i], v: v[i], primitive, instance };
                }
            }
        }
    }

    /// Whether the ray hits any of the block before `tmax`.
    #[inline(always)]
    pub fn occluded<S: Simd>(&self, ray: &SingleRay, instance: u32, filter: &impl Filter, tmax: f32) -> bool {
        if let Some(edges) = self.edges::<S>(ray) {
            let (mut hits, _, u, v) = edges.hits(self, ray, tmax);
            while hits != 0 {
                let i = hits.trailing_zeros() as usize & 3;
                hits &= hits - 1;
                if filter.keep(self.primitive(i), instance, u[i], v[i]) {
                    return true;
                }
            }
        }
        false
    }
}

impl<S: Simd> Edges<S> {
    /// The triangles hit at 0 < t ≤ tmax, with t, u and v of each.
    #[inline(always)]
    fn hits(&self, block: &Block, ray: &SingleRay, tmax: f32) -> (u32, [f32; 4], [f32; 4], [f32; 4]) {
        let (az, bz, cz) = (S::low(self.ab[2]), S::high(self.ab[2]), self.c[2]);
        let determinant = self.u.add(self.v).add(self.w);
        let z = self.u.mul(az).add(self.v.mul(bz)).add(self.w.mul(cz));
        let inverse = S::F4::splat(1.0).div(determinant);
        let t = z.mul(S::F4::splat(ray.shear[2])).mul(inverse);
        let doubtful = self.doubtful | self.inside & block.thin();
        let hits = self.inside & !doubtful & S::F4::splat(0.0).lt(t) & t.le(S::F4::splat(tmax));
        let (u, v) = (self.v.mul(inverse), self.w.mul(inverse));
        if doubtful == 0 {
            (hits, t.array(), u.array(), v.array())
        } else {
            self.doubt(block, ray, tmax, (doubtful, hits), t, u, v)
        }
    }

    /// The same once an edge function was zero or a triangle is thin.
    #[cold]
    #[inline(never)]
    #[allow(clippy::too_many_arguments)]
    fn doubt(
        &self,
        block: &Block,
        ray: &SingleRay,
        tmax: f32,
        (doubtful, mut hits): (u32, u32),
        t: S::F4,
        u: S::F4,
        v: S::F4,
    ) -> (u32, [f32; 4], [f32; 4], [f32; 4]) {
        let (mut t, mut u, mut v) = (t.array(), u.array(), v.array());
        let (ab, c) = (self.ab.map(S::F8::array), self.c.map(S::F4::array));
        for i in (0..4).filter(|i| doubtful >> i & 1 == 1) {
            let corners = [ab.map(|x| x[i]), ab.map(|x| x[i + 4]), c.map(|x| x[i])];
            let inside = self.doubtful >> i & 1 == 0
                || exact(corners.map(|p| p.map(f64::from)), f64::from(ray.shear[2])).is_some();
            let hit = if !inside {
                None
            } else if block.is_thin(i) {
                on_plane(block.corners(i), ray)
            } else {
                exact(corners.map(|p| p.map(f64::from)), f64::from(ray.shear[2]))
            };
            if let Some(hit) = hit {
                if 0.0 < hit[0] && hit[0] <= tmax {
                    hits |= 1 << i;
                }
                (t[i], u[i], v[i]) = (hit[0], hit[1], hit[2]);
            }
        }
        (hits, t, u, v)
    }
}

/// t, u, v of a triangle of sheared corners; `scale` turns their z into t.
#[cold]
pub(crate) fn exact([a, b, c]: [[f64; 3]; 3], scale: f64) -> Option<[f32; 3]> {
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let determinant = u + v + w;
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    if !inside || determinant == 0.0 {
        return None;
    }
    let t = (u * a[2] + v * b[2] + w * c[2]) * scale / determinant;
    Some([t as f32, (v / determinant) as f32, (w / determinant) as f32])
}

/// Whether the longest edge is many times as long as the height over it.
fn is_thin([a, b, c]: [[f32; 3]; 3]) -> bool {
    let minus = |p: [f32; 3], q: [f32; 3]| -> [f64; 3] { std::array::from_fn(|k| f64::from(p[k]) - f64::from(q[k])) };
    let square = |x: [f64; 3]| dot(x, x);
    let edges = [minus(b, a), minus(c, a), minus(c, b)];
    let longest = edges.map(square).into_iter().fold(0.0, f64::max);
    longest * longest > SLENDER * SLENDER * square(cross(edges[0], edges[1]))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// t, u, v where a ray that passes inside a triangle meets its plane.
#[cold]
fn on_plane(corners: [[f32; 3]; 3], ray: &SingleRay) -> Option<[f32; 3]> {
    let [a, b, c]: [[f64; 3]; 3] = corners.map(|p| std::array::from_fn(|k| f64::from(p[k]) - f64::from(ray.o[k])));
    let minus = |p: [f64; 3], q: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| p[k] - q[k]) };
    let (ab, ac, d) = (minus(b, a), minus(c, a), ray.d.map(f64::from));
    let normal = cross(ab, ac);
    let along = dot(normal, d);
    if along == 0.0 {
        return None;
    }
    let t = dot(normal, a) / along;
    let p: [f64; 3] = std::array::from_fn(|k| t * d[k] - a[k]);
    // Rounding may leave the point a little outside.
    let size = dot(normal, normal);
    let u = (dot(cross(p, ac), normal) / size).clamp(0.0, 1.0);
    let v = (dot(cross(ab, p), normal) / size).clamp(0.0, 1.0 - u);
    Some([t as f32, u as f32, v as f32])
}

/// t, u, v where a ray meets a triangle, in f64 throughout: for coordinates whose products would overflow.
#[cold]
pub(crate) fn in_f64(corners: [[f32; 3]; 3], ray: &SingleRay) -> Option<[f32; 3]> {
    let [x, y, z] = ray.axes();
    let d = ray.d.map(f64::from);
    let (sx, sy) = (d[x] / d[z], d[y] / d[z]);
    let sheared = corners.map(|p| {
        let p: [f64; 3] = std::array::from_fn(|k| f64::from(p[k]) - f64::from(ray.o[k]));
        [p[x] - sx * p[z], p[y] - sy * p[z], p[z]]
    });
    exact(sheared, 1.0 / d[z])
}
