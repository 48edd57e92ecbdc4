//! Orthonormal frames.

use super::{Vec3, vec3};
use rebond_lanes::Real;

/// An orthonormal right-handed frame; `n` is its z axis.
#[derive(Clone, Copy, Debug)]
pub struct Frame<F: Real> {
    /// x axis.
    pub s: Vec3<F>,
    /// y axis.
    pub t: Vec3<F>,
    /// z axis.
    pub n: Vec3<F>,
}

impl<F: Real> Frame<F> {
    /// Some frame around a unit normal (Duff et al. 2017, revised branchless construction).
    #[inline(always)]
    pub fn around(n: Vec3<F>) -> Self {
        let sign = F::one().copy_sign(n.z);
        let a = -(sign + n.z).recip();
        let b = n.x * n.y * a;
        let s = vec3(F::one() + sign * n.x * n.x * a, sign * b, -sign * n.x);
        let t = vec3(b, sign + n.y * n.y * a, -n.y);
        Self { s, t, n }
    }

    /// The frame around a unit normal whose x axis is nearest to `tangent`; some frame where they are parallel.
    #[inline(always)]
    pub fn with_tangent(n: Vec3<F>, tangent: Vec3<F>) -> Self {
        let s = tangent - n * n.dot(tangent);
        let length2 = s.length_squared();
        let usable = length2.gt(tangent.length_squared() * 1e-8);
        let any = Self::around(n);
        // A second projection: the first leaves rounding errors as large as what was taken away.
        let s = s * length2.sqrt().recip();
        let s = (s - n * n.dot(s)).normalized();
        let s = Vec3::select(usable, s, any.s);
        Self { s, t: n.cross(s), n }
    }

    /// World coordinates of a local vector.
    #[inline(always)]
    pub fn to_world(&self, v: Vec3<F>) -> Vec3<F> {
        self.s.mul_add(v.x, self.t.mul_add(v.y, self.n * v.z))
    }

    /// Local coordinates of a world vector.
    #[inline(always)]
    pub fn to_local(&self, v: Vec3<F>) -> Vec3<F> {
        vec3(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn frames_are_orthonormal_and_right_handed(z in -1.0f32..=1.0, phi in 0.0f32..6.3, t in prop::array::uniform3(-1.0f32..1.0)) {
            let r = (1.0 - z * z).max(0.0).sqrt();
            let n = vec3(r * phi.cos(), r * phi.sin(), z).normalized();
            for f in [Frame::around(n), Frame::with_tangent(n, Vec3::splat(t))] {
                for (a, b, want) in [(f.s, f.s, 1.0), (f.t, f.t, 1.0), (f.n, f.n, 1.0), (f.s, f.t, 0.0), (f.s, f.n, 0.0), (f.t, f.n, 0.0)] {
                    prop_assert!((a.dot(b) - want).abs() < 2e-6, "{f:?}");
                }
                prop_assert!(f.s.cross(f.t).dot(f.n) > 0.999);
                let v = Vec3::splat(t);
                prop_assert!((f.to_local(f.to_world(v)) - v).length() < 3e-6);
            }
        }
    }
}
