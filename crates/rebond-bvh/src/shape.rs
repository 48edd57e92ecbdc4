//! Spheres and disks, in f64.

use crate::{Disk, Sphere};

/// A shape that is a leaf by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    Sphere(Sphere, u32),
    Disk(Disk, u32),
    /// The place of an instance in the list.
    Instance(u32),
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn from(o: [f32; 3], c: [f32; 3]) -> [f64; 3] {
    std::array::from_fn(|k| f64::from(o[k]) - f64::from(c[k]))
}

impl Sphere {
    /// Whether rays can hit it.
    pub(crate) fn is_valid(&self) -> bool {
        self.center.iter().all(|x| x.is_finite()) && self.radius.is_finite() && self.radius > 0.0
    }

    pub(crate) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let r = self.radius * (1.0 + f32::EPSILON);
        (self.center.map(|c| (c - r).next_down()), self.center.map(|c| (c + r).next_up()))
    }

    /// Where the ray enters and leaves the sphere.
    ///
    /// The discriminant is r² − |p|², p the point of the line nearest to the centre, and the root of smaller magnitude
    /// comes from the product of the two: E. Haines et al., "Precision Improvements for Ray/Sphere Intersection",
    /// Ray Tracing Gems, 2019.
    pub(crate) fn roots(&self, o: [f32; 3], d: [f32; 3]) -> Option<[f64; 2]> {
        let t = self.roots_or_nan(o, d);
        (!t[0].is_nan()).then_some(t)
    }

    /// The same, NaN where there are none; without a branch, so that sixteen of them become vector code.
    #[inline(always)]
    fn roots_or_nan(&self, o: [f32; 3], d: [f32; 3]) -> [f64; 2] {
        let o = from(o, self.center);
        let d = d.map(f64::from);
        let r2 = f64::from(self.radius) * f64::from(self.radius);
        let a = dot(d, d);
        let b = -dot(o, d);
        let nearest: [f64; 3] = std::array::from_fn(|k| o[k] + b / a * d[k]);
        // Its root is not a number if the line misses.
        let discriminant = r2 - dot(nearest, nearest);
        let c = dot(o, o) - r2;
        let q = b + (a * discriminant).sqrt().copysign(b);
        let (t0, t1) = (if q == 0.0 { 0.0 } else { c / q }, if q == 0.0 { 0.0 } else { q / a });
        let swapped = !(t0 < t1);
        [if swapped { t1 } else { t0 }, if swapped { t0 } else { t1 }]
    }

    /// [`Sphere::roots`] of sixteen rays, to the bit; NaN for none.
    #[inline(never)]
    pub(crate) fn roots_of_each(&self, o: &[[f32; 16]; 3], d: &[[f32; 16]; 3]) -> [[f32; 16]; 2] {
        let mut out = [[0.0; 16]; 2];
        for i in 0..16 {
            let t = self.roots_or_nan([o[0][i], o[1][i], o[2][i]], [d[0][i], d[1][i], d[2][i]]);
            (out[0][i], out[1][i]) = (t[0] as f32, t[1] as f32);
        }
        out
    }
}

impl Disk {
    /// Whether rays can hit it.
    pub(crate) fn is_valid(&self) -> bool {
        let n = dot(self.normal.map(f64::from), self.normal.map(f64::from));
        self.center.iter().all(|x| x.is_finite())
            && n.is_finite()
            && n > 0.0
            && self.radius.is_finite()
            && self.radius > 0.0
    }

    pub(crate) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let n = self.normal.map(f64::from);
        let n2 = dot(n, n);
        let half: [f32; 3] = std::array::from_fn(|k| {
            let sine2 = (1.0 - n[k] * n[k] / n2).max(0.0);
            (f64::from(self.radius) * sine2.sqrt() * (1.0 + 1e-6)) as f32
        });
        (
            std::array::from_fn(|k| (self.center[k] - half[k]).next_down()),
            std::array::from_fn(|k| (self.center[k] + half[k]).next_up()),
        )
    }

    /// Where the ray meets the disk.
    pub(crate) fn root(&self, o: [f32; 3], d: [f32; 3]) -> Option<f64> {
        let o = from(o, self.center);
        let d = d.map(f64::from);
        let n = self.normal.map(f64::from);
        let t = -dot(o, n) / dot(d, n);
        let p: [f64; 3] = std::array::from_fn(|k| o[k] + t * d[k]);
        (dot(p, p) <= f64::from(self.radius) * f64::from(self.radius)).then_some(t)
    }
}

impl Shape {
    /// Up to two places where the ray meets the shape; NaN for none.
    #[inline]
    pub(crate) fn roots(&self, o: [f32; 3], d: [f32; 3]) -> [f32; 2] {
        match self {
            Self::Sphere(sphere, _) => sphere.roots(o, d).map_or([f32::NAN; 2], |t| t.map(|t| t as f32)),
            Self::Disk(disk, _) => [disk.root(o, d).map_or(f32::NAN, |t| t as f32), f32::NAN],
            Self::Instance(_) => [f32::NAN; 2],
        }
    }

    /// A ball around it.
    pub(crate) fn ball(&self) -> Option<([f32; 3], f32)> {
        match self {
            Self::Sphere(sphere, _) => Some((sphere.center, sphere.radius)),
            Self::Disk(disk, _) => Some((disk.center, disk.radius)),
            Self::Instance(_) => None,
        }
    }

    pub(crate) fn primitive(&self) -> u32 {
        match *self {
            Self::Sphere(_, primitive) | Self::Disk(_, primitive) => primitive,
            Self::Instance(instance) => instance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_sphere_far_away() {
        let sphere = Sphere { center: [0.0, 0.0, 1e6], radius: 1e-2 };
        let t = sphere.roots([0.0; 3], [0.0, 0.0, 1.0]).unwrap();
        assert!((t[0] - (1e6 - 1e-2)).abs() < 1e-8 && (t[1] - (1e6 + 1e-2)).abs() < 1e-8);
        assert!(sphere.roots([0.02, 0.0, 0.0], [0.0, 0.0, 1.0]).is_none());
    }

    #[test]
    fn from_inside_and_on_the_surface() {
        let sphere = Sphere { center: [1.0, 2.0, 3.0], radius: 2.0 };
        assert_eq!(sphere.roots([1.0, 2.0, 3.0], [0.0, 0.5, 0.0]), Some([-4.0, 4.0]));
        assert_eq!(sphere.roots([1.0, 4.0, 3.0], [0.0, -1.0, 0.0]), Some([0.0, 4.0]));
        assert_eq!(sphere.roots([1.0, 4.0, 3.0], [1.0, 0.0, 0.0]), Some([0.0, 0.0]));
    }

    #[test]
    fn disk_and_its_bounds() {
        let disk = Disk { center: [0.0, 1.0, 0.0], normal: [0.0, 1.0, 0.0], radius: 0.5 };
        assert_eq!(disk.root([0.4, 3.0, 0.0], [0.0, -2.0, 0.0]), Some(1.0));
        assert_eq!(disk.root([0.6, 3.0, 0.0], [0.0, -2.0, 0.0]), None);
        assert_eq!(disk.root([0.4, 1.0, 0.0], [1.0, 0.0, 0.0]), None);
        let (lo, hi) = disk.bounds();
        assert!(lo[0] <= -0.5 && lo[0] > -0.5001 && hi[1] - lo[1] < 1e-5);
    }
}
