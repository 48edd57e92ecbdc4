//! Points, directions and normals.

use rebond_lanes::Real;
use std::ops::{Add, Mul, Neg, Sub};

/// A point, a direction or a normal.
#[derive(Clone, Copy, Debug, Default)]
pub struct Vec3<F: Real> {
    /// First coordinate.
    pub x: F,
    /// Second coordinate.
    pub y: F,
    /// Third coordinate.
    pub z: F,
}

/// The vector (x, y, z).
#[inline(always)]
pub fn vec3<F: Real>(x: F, y: F, z: F) -> Vec3<F> {
    Vec3 { x, y, z }
}

impl<F: Real> Vec3<F> {
    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: [f32; 3]) -> Self {
        vec3(F::splat(v[0]), F::splat(v[1]), F::splat(v[2]))
    }
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        Self::splat([0.0; 3])
    }
    /// The first three words of a record.
    #[inline(always)]
    pub fn of_record(r: [F; 4]) -> Self {
        vec3(r[0], r[1], r[2])
    }
    /// The coordinates.
    #[inline(always)]
    pub fn array(self) -> [F; 3] {
        [self.x, self.y, self.z]
    }
    /// One lane.
    pub fn lane(self, i: usize) -> [f32; 3] {
        [self.x.lane(i), self.y.lane(i), self.z.lane(i)]
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        vec3(
            self.y.mul_add(o.z, -(self.z * o.y)),
            self.z.mul_add(o.x, -(self.x * o.z)),
            self.x.mul_add(o.y, -(self.y * o.x)),
        )
    }
    /// Squared length.
    #[inline(always)]
    pub fn length_squared(self) -> F {
        self.dot(self)
    }
    /// Length.
    #[inline(always)]
    pub fn length(self) -> F {
        self.dot(self).sqrt()
    }
    /// The unit vector of this direction; not finite for the zero vector.
    #[inline(always)]
    pub fn normalized(self) -> Self {
        self * self.length().recip()
    }
    /// `self · s + o`.
    #[inline(always)]
    pub fn mul_add(self, s: F, o: Self) -> Self {
        vec3(self.x.mul_add(s, o.x), self.y.mul_add(s, o.y), self.z.mul_add(s, o.z))
    }
    /// `a` where `mask`, else `b`.
    #[inline(always)]
    pub fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        vec3(F::select(mask, a.x, b.x), F::select(mask, a.y, b.y), F::select(mask, a.z, b.z))
    }
    /// Each coordinate's value of f.
    #[inline(always)]
    pub fn map(self, f: impl Fn(F) -> F) -> Self {
        vec3(f(self.x), f(self.y), f(self.z))
    }
    /// The largest magnitude of the coordinates.
    #[inline(always)]
    pub fn max_abs(self) -> F {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }
    /// `self` turned to the side of `reference`.
    #[inline(always)]
    pub fn facing(self, reference: Self) -> Self {
        Self::select(self.dot(reference).lt(F::zero()), -self, self)
    }
}

impl<F: Real> Add for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        vec3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}
impl<F: Real> Sub for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        vec3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}
impl<F: Real> Mul<F> for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: F) -> Self {
        vec3(self.x * s, self.y * s, self.z * s)
    }
}
impl<F: Real> Neg for Vec3<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        vec3(-self.x, -self.y, -self.z)
    }
}
