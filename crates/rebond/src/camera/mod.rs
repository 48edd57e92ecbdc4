//! Cameras: perspective, thin lens, orthographic; at rest or moving.

mod importance;
mod lens;

pub use importance::{LensHit, Sight};
pub use lens::{Aperture, FEWEST_BLADES, MOST_BLADES};

use crate::math::{Vec3, vec3};
use glam::DAffine3;
use rebond_lanes::Real;

/// What kind of camera, in local coordinates: it looks along +z, +y is up and +x left.
#[derive(Clone, Copy, Debug)]
pub enum Projection {
    /// Through a point. The picture's half extents at distance 1.
    Perspective {
        /// Half width and half height at distance 1.
        extent: [f32; 2],
    },
    /// Through an ideal lens.
    ThinLens {
        /// Half width and half height at distance 1.
        extent: [f32; 2],
        /// Its opening.
        aperture: Aperture,
        /// Distance along z that is in focus.
        focus: f32,
    },
    /// Parallel.
    Orthographic {
        /// Half width and half height.
        extent: [f32; 2],
    },
}

/// A camera.
#[derive(Clone, Debug)]
pub struct Camera {
    projection: Projection,
    /// (time, camera-to-world), linearly interpolated.
    motion: Vec<(f32, [Vec3<f32>; 4])>,
    shutter: [f32; 2],
    size: [f32; 2],
    /// The picture's centre, in its plane.
    center: [f32; 2],
    near_clip: f32,
}

/// A ray from the camera.
#[derive(Clone, Copy, Debug)]
pub struct CameraRay<F: Real> {
    /// Origin.
    pub o: Vec3<F>,
    /// Unit direction.
    pub d: Vec3<F>,
    /// Time.
    pub time: F,
}

impl Camera {
    /// A camera for pictures of `size` pixels. The matrices are the columns x, y, z and the origin.
    pub fn new(projection: Projection, motion: &[(f32, DAffine3)], shutter: [f32; 2], size: [u32; 2]) -> Self {
        let columns = |m: &DAffine3| {
            let v = |v: glam::DVec3| Vec3::splat(v.as_vec3().to_array());
            [v(m.matrix3.x_axis), v(m.matrix3.y_axis), v(m.matrix3.z_axis), v(m.translation)]
        };
        let motion = motion.iter().map(|(t, m)| (*t, columns(m))).collect();
        Self { projection, motion, shutter, size: size.map(|x| x as f32), center: [0.0; 2], near_clip: 0.0 }
    }

    /// The same camera that sees nothing nearer than this along its axis; of no effect if it is orthographic.
    pub fn with_near_clip(self, near_clip: f32) -> Self {
        Self { near_clip, ..self }
    }

    /// The same camera whose picture is centred there, x and y in the plane of its extents, and not on the axis.
    pub fn with_center(self, center: [f32; 2]) -> Self {
        Self { center, ..self }
    }

    /// Width and height of the picture, in pixels.
    pub fn size(&self) -> [f32; 2] {
        self.size
    }

    /// Whether what is near is left out.
    pub fn has_near_clip(&self) -> bool {
        self.near_clip != 0.0
    }

    /// Whether rays need a time.
    pub fn has_shutter(&self) -> bool {
        self.shutter[0] != self.shutter[1]
    }

    /// Whether rays need a point on a lens.
    pub fn has_lens(&self) -> bool {
        matches!(self.projection, Projection::ThinLens { .. })
    }

    /// The ray through a point of the picture (in pixels, from the top left), a point of the lens and a moment of the
    /// shutter, the last two by numbers in [0, 1).
    #[inline(always)]
    pub fn ray<F: Real>(&self, raster: [F; 2], lens: [F; 2], moment: F) -> CameraRay<F> {
        let time = moment * (self.shutter[1] - self.shutter[0]) + self.shutter[0];
        let [x_axis, y_axis, z_axis, origin] = self.at(time);
        // Right and down on the picture are −x and −y here.
        let x = F::one() - raster[0] * (2.0 / self.size[0]);
        let y = F::one() - raster[1] * (2.0 / self.size[1]);
        let world = |v: Vec3<F>| x_axis.mul_add(v.x, y_axis.mul_add(v.y, z_axis * v.z));
        let within = |[w, h]: [f32; 2]| [x * w + self.center[0], y * h + self.center[1]];
        match self.projection {
            Projection::Perspective { extent } => {
                let [x, y] = within(extent);
                let d = vec3(x, y, F::one());
                let d = world(d);
                CameraRay { o: d.mul_add(F::splat(self.near_clip), origin), d: d.normalized(), time }
            }
            Projection::ThinLens { extent, aperture, focus } => {
                let [x, y] = within(extent).map(|x| x * focus);
                let in_focus = vec3(x, y, F::splat(focus));
                let [lx, ly] = aperture.sample(lens);
                let o = vec3(lx, ly, F::zero());
                let d = world(in_focus - o);
                let o = d.mul_add(F::splat(self.near_clip / focus), world(o) + origin);
                CameraRay { o, d: d.normalized(), time }
            }
            Projection::Orthographic { extent } => {
                let [x, y] = within(extent);
                let o = vec3(x, y, F::zero());
                CameraRay { o: world(o) + origin, d: z_axis.normalized(), time }
            }
        }
    }

    #[inline(always)]
    fn at<F: Real>(&self, time: F) -> [Vec3<F>; 4] {
        let lanes = |m: &[Vec3<f32>; 4]| m.map(|v| Vec3::splat(v.array()));
        let mut now = lanes(&self.motion[0].1);
        for pair in self.motion.windows(2) {
            let ((t0, a), (t1, b)) = (&pair[0], &pair[1]);
            let share = ((time - *t0) / (t1 - t0)).clamp(0.0, 1.0);
            let after = time.ge(F::splat(*t0));
            let (a, b) = (lanes(a), lanes(b));
            now = std::array::from_fn(|i| Vec3::select(after, a[i] + (b[i] - a[i]) * share, now[i]));
        }
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn camera(projection: Projection) -> Camera {
        Camera::new(projection, &[(0.0, DAffine3::IDENTITY)], [0.0, 0.0], [200, 100])
    }

    #[test]
    fn rays_go_where_the_picture_says() {
        let c = camera(Projection::Perspective { extent: [1.0, 0.5] });
        let centre = c.ray([100.0_f32, 50.0], [0.5; 2], 0.0);
        assert_eq!((centre.o.array(), centre.d.array()), ([0.0; 3], [0.0, 0.0, 1.0]));
        let corner = c.ray([0.0_f32, 0.0], [0.5; 2], 0.0).d;
        assert!((corner - vec3(1.0, 0.5, 1.0).normalized()).length() < 1e-6, "top left is +x, +y");
        let parallel = camera(Projection::Orthographic { extent: [2.0, 1.0] }).ray([150.0_f32, 75.0], [0.5; 2], 0.0);
        assert_eq!((parallel.o.array(), parallel.d.array()), ([-1.0, -0.5, 0.0], [0.0, 0.0, 1.0]));
    }

    #[test]
    fn a_lens_focuses() {
        let aperture = Aperture::round(0.3);
        let c = camera(Projection::ThinLens { extent: [1.0, 0.5], aperture, focus: 4.0 });
        let mut furthest = 0.0_f32;
        for lens in crate::testing::random_pairs(500) {
            let r = c.ray([30.0_f32, 70.0], lens, 0.0);
            // All meet where the pinhole's ray does, at depth 4: x = 4·(1 − 0.3), y = 4·0.5·(1 − 1.4).
            let meets = r.o + r.d * (4.0 / r.d.z);
            assert!((meets - vec3(2.8, -0.8, 4.0)).length() < 1e-5);
            furthest = furthest.max(r.o.length());
        }
        assert!(furthest > 0.28 && furthest <= 0.3);
    }

    #[test]
    fn rays_start_where_the_near_clip_says() {
        let extent = [1.0, 0.5];
        let lens = Projection::ThinLens { extent, aperture: Aperture::round(0.3), focus: 4.0 };
        for projection in [Projection::Perspective { extent }, lens] {
            let whole = camera(projection);
            let cut = whole.clone().with_near_clip(1.5);
            for u in crate::testing::random_pairs(100) {
                let (a, b) = (whole.ray([30.0_f32, 70.0], u, 0.0), cut.ray([30.0, 70.0], u, 0.0));
                assert!((b.o.z - 1.5).abs() < 1e-6 && a.d.array() == b.d.array());
                assert!((a.o + a.d * (1.5 / a.d.z) - b.o).length() < 1e-6);
            }
        }
    }

    #[test]
    fn a_moving_camera_is_where_it_is() {
        let motion = [0.0, 1.0, 3.0].map(|t| (t, DAffine3::from_translation(DVec3::X * f64::from(t) * f64::from(t))));
        let c = Camera::new(Projection::Perspective { extent: [1.0; 2] }, &motion, [-1.0, 5.0], [2, 2]);
        let x = |moment: f32| c.ray([1.0, 1.0], [0.5; 2], moment).o.x;
        // Times −1, 0.5, 2 and 5 of a motion through x = 0, 1, 9 at 0, 1, 3.
        for (moment, want) in [(0.0, 0.0), (0.25, 0.5), (0.5, 5.0), (1.0, 9.0)] {
            assert!((x(moment) - want).abs() < 1e-5, "{moment}: {} for {want}", x(moment));
        }
    }
}
