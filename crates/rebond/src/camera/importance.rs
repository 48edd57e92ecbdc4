//! The camera as light meets it: where a point is seen, and what it counts there.
//!
//! A pixel's value is the mean of radiance over its filter, `I = ∫ f(r) L(ray through r) dr` with r in pixels. Per solid angle
//! at the lens, rays have the density
//!
//! ```text
//! g(ω) = h² / (A cos³θ)
//! ```
//!
//! in pixels per sr, with θ the angle to the normal of lens and picture, h the distance of a picture plane and A the area that
//! a pixel has in it: as from a pinhole, so through a thin lens, where the plane in focus is such a plane. Parallel rays have the
//! density 1/A per area across the picture plane. Light that leaves a point towards the lens therefore counts
//!
//! ```text
//! X = L cosθ' g(ω) / d²        at its raster position, through a point of the lens that is drawn uniformly
//! ```
//!
//! (Veach 1997, §8.3: the importance We = g / (A_lens cosθ), over the density 1/A_lens of the lens point). A near clip leaves
//! out what is nearer along the axis: light that comes from beyond it passes freely from there on.

use super::{Aperture, Camera, Projection};
use crate::math::{Vec3, vec3};
use crate::sampling::{PdfArea, PdfSolidAngle};
use rebond_lanes::{Mask, Real};

/// How the camera sees a point.
#[derive(Clone, Copy, Debug)]
pub struct Sight<F: Real> {
    /// The point of the lens through which it does.
    pub lens: Vec3<F>,
    /// How far the way there must be free: up to the lens, or to the near clip.
    pub end: Vec3<F>,
    /// Unit direction from the point to there.
    pub w: Vec3<F>,
    /// Where on the picture, in pixels from the top left; it may be beyond the edges.
    pub raster: [F; 2],
    /// What a unit of area at the point counts that faces the camera: g(ω)/d², or 1/A for parallel rays. For points that are
    /// infinitely far, g(ω) per solid angle. 0 if they are not seen.
    pub importance: F,
    /// Density per area of the lens with which light that leaves the point along `w` with density 1 per solid angle would
    /// arrive, over that of the lens point; 0 if the lens cannot be hit. For infinite points, of light of density 1 per area.
    pub found: F,
}

/// Where light crosses the lens.
#[derive(Clone, Copy, Debug)]
pub struct LensHit<F: Real> {
    /// Distance along the ray.
    pub t: F,
    /// How far the way must be free: up to there, or to the near clip.
    pub free: F,
    /// Where on the picture.
    pub raster: [F; 2],
    /// cosθ at the lens.
    pub cos: F,
    /// Whether it does cross it.
    pub mask: F::Mask,
}

/// The camera at one time.
struct Placed<F: Real> {
    /// Local axes in the world.
    axes: [Vec3<F>; 3],
    origin: Vec3<F>,
    /// Unit normal of the picture.
    normal: Vec3<F>,
    /// Rows of the inverse.
    inverse: [Vec3<F>; 3],
    /// Area of the local unit square in the picture's plane.
    area: F,
}

impl<F: Real> Placed<F> {
    #[inline(always)]
    fn new([x, y, z, origin]: [Vec3<F>; 4]) -> Self {
        let across = x.cross(y);
        let area = across.length();
        let scale = across.dot(z).recip();
        let inverse = [y.cross(z) * scale, z.cross(x) * scale, across * scale];
        Self { axes: [x, y, z], origin, normal: across * area.recip(), inverse, area }
    }

    #[inline(always)]
    fn to_local(&self, v: Vec3<F>) -> Vec3<F> {
        vec3(self.inverse[0].dot(v), self.inverse[1].dot(v), self.inverse[2].dot(v))
    }
}

impl Camera {
    /// The time of a moment in [0, 1) of the shutter.
    pub fn time<F: Real>(&self, moment: F) -> F {
        moment * (self.shutter[1] - self.shutter[0]) + self.shutter[0]
    }

    /// The opening of the lens in local coordinates; of no size if it is a point.
    fn aperture(&self) -> Aperture {
        match self.projection {
            Projection::ThinLens { aperture, .. } => aperture,
            Projection::Perspective { .. } | Projection::Orthographic { .. } => Aperture::round(0.0),
        }
    }

    /// Half width and half height of the picture in its plane.
    fn extent(&self) -> [f32; 2] {
        match self.projection {
            Projection::Perspective { extent }
            | Projection::ThinLens { extent, .. }
            | Projection::Orthographic { extent } => extent,
        }
    }

    /// Whether all rays are parallel, so that no light that is not has a place on the picture.
    pub fn is_parallel(&self) -> bool {
        matches!(self.projection, Projection::Orthographic { .. })
    }

    /// Distance along the axis of what is not left out.
    fn near(&self) -> f32 {
        if self.is_parallel() { 0.0 } else { self.near_clip }
    }

    /// The point of the lens from which a ray comes that starts at `o`.
    #[inline(always)]
    pub fn lens_of<F: Real>(&self, o: Vec3<F>, d: Vec3<F>, time: F) -> Vec3<F> {
        let near = self.near();
        if near == 0.0 { o } else { o - d * (Placed::new(self.at(time)).to_local(d).z.recip() * near) }
    }

    /// A sphere around every place of the lens, if light can hit it.
    pub fn lens_bounds(&self) -> Vec<([f32; 3], f32)> {
        let around = |m: &[Vec3<f32>; 4]| (m[3].array(), self.aperture().radius() * (m[0].length() + m[1].length()));
        if self.has_lens() { self.motion.iter().map(|(_, m)| around(m)).collect() } else { Vec::new() }
    }

    /// Density per area of points of the lens; infinite if it is a point.
    #[inline(always)]
    pub fn lens_pdf<F: Real>(&self, time: F) -> PdfArea<F> {
        PdfArea((Placed::new(self.at(time)).area * self.aperture().area()).recip())
    }

    /// cosθ of a direction to the picture's normal.
    #[inline(always)]
    pub fn cos<F: Real>(&self, d: Vec3<F>, time: F) -> F {
        Placed::new(self.at(time)).normal.dot(d).abs()
    }

    /// Pixels per solid angle around the unit direction `d` of a ray; for parallel rays pixels per area across them.
    #[inline(always)]
    pub fn density<F: Real>(&self, d: Vec3<F>, time: F) -> PdfSolidAngle<F> {
        PdfSolidAngle(self.density_of(&Placed::new(self.at(time)), d))
    }

    #[inline(always)]
    fn density_of<F: Real>(&self, placed: &Placed<F>, d: Vec3<F>) -> F {
        let [width, height] = self.extent();
        let pixel = placed.area * (4.0 * width * height / (self.size[0] * self.size[1]));
        let cos = placed.normal.dot(d).abs();
        if self.is_parallel() {
            return (pixel * cos).recip();
        }
        let h = placed.axes[2].dot(placed.normal);
        h * h / (pixel * cos * cos * cos)
    }

    /// The raster position of the ray from a point of the lens, in local coordinates, into a local direction.
    #[inline(always)]
    fn raster_of<F: Real>(&self, lens: [F; 2], d: Vec3<F>) -> [F; 2] {
        let extent = self.extent();
        [0, 1].map(|i| {
            let along = d.array()[i] / d.z;
            let at = match self.projection {
                Projection::Perspective { .. } => along,
                Projection::ThinLens { focus, .. } => along + lens[i] * focus.recip(),
                Projection::Orthographic { .. } => lens[i],
            };
            (F::one() - (at - self.center[i]) * extent[i].recip()) * (0.5 * self.size[i])
        })
    }

    /// How the camera sees the point `p`, through the point of its lens that two numbers in [0, 1) choose.
    #[inline(always)]
    pub fn see<F: Real>(&self, p: Vec3<F>, lens: [F; 2], time: F) -> Sight<F> {
        let placed = Placed::new(self.at(time));
        if self.is_parallel() {
            let local = placed.to_local(p - placed.origin);
            let d = placed.axes[2].normalized();
            let seen = local.z.gt(F::zero());
            let lens = p - placed.axes[2] * local.z;
            return Sight {
                lens,
                end: lens,
                w: -d,
                raster: self.raster_of([local.x, local.y], vec3(F::zero(), F::zero(), F::one())),
                importance: F::select(seen, self.density_of(&placed, d), F::zero()),
                found: F::zero(),
            };
        }
        let (at, point) = self.lens_point(&placed, lens);
        let to = p - point;
        let d2 = to.length_squared();
        let mut sight = self.sight(&placed, at, point, to * d2.sqrt().recip());
        let seen = placed.to_local(to).z.gt(F::splat(self.near())) & d2.gt(F::zero());
        sight.importance = F::select(seen, sight.importance / d2, F::zero());
        sight.found = sight.found / d2;
        sight
    }

    /// How it sees what is infinitely far into the unit direction `d`.
    #[inline(always)]
    pub fn see_far<F: Real>(&self, d: Vec3<F>, lens: [F; 2], time: F) -> Sight<F> {
        let placed = Placed::new(self.at(time));
        let (at, point) = self.lens_point(&placed, lens);
        let mut sight = self.sight(&placed, at, point, d);
        if self.is_parallel() {
            sight.importance = F::zero();
        }
        sight
    }

    #[inline(always)]
    fn lens_point<F: Real>(&self, placed: &Placed<F>, lens: [F; 2]) -> ([F; 2], Vec3<F>) {
        if !self.has_lens() {
            return ([F::zero(); 2], placed.origin);
        }
        let at = self.aperture().sample(lens);
        (at, placed.axes[0].mul_add(at[0], placed.axes[1].mul_add(at[1], placed.origin)))
    }

    #[inline(always)]
    fn sight<F: Real>(&self, placed: &Placed<F>, at: [F; 2], point: Vec3<F>, d: Vec3<F>) -> Sight<F> {
        let local = placed.to_local(d);
        let seen = local.z.gt(F::zero());
        let near = self.near();
        Sight {
            lens: point,
            end: if near == 0.0 { point } else { point + d * (local.z.recip() * near) },
            w: -d,
            raster: self.raster_of(at, local),
            importance: F::select(seen, self.density_of(placed, d), F::zero()),
            found: placed.normal.dot(d).abs() * placed.area * self.aperture().area(),
        }
    }

    /// Where light along the ray from `o` into the unit direction `d` crosses the lens, if it can be hit.
    #[inline(always)]
    pub fn crossing<F: Real>(&self, o: Vec3<F>, d: Vec3<F>, time: F) -> LensHit<F> {
        let placed = Placed::new(self.at(time));
        let (from, along) = (placed.to_local(o - placed.origin), placed.to_local(d));
        let t = -from.z / along.z;
        let at = along.mul_add(t, from);
        let within = F::Mask::splat(self.has_lens()) & self.aperture().pdf([at.x, at.y]).0.gt(F::zero());
        let free = (F::splat(self.near()) - from.z) / along.z;
        LensHit {
            t,
            free,
            raster: self.raster_of([at.x, at.y], along),
            cos: placed.normal.dot(d).abs(),
            mask: within & along.z.lt(F::zero()) & free.gt(F::zero()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_pairs;
    use glam::{DAffine3, DMat3, DVec3};

    /// Cameras in a space that is turned, moved, stretched and sheared; of pictures on the axis and off it.
    fn cameras() -> Vec<Camera> {
        let matrix = DAffine3::from_mat3_translation(
            DMat3::from_cols(DVec3::new(1.2, 0.1, 0.3), DVec3::new(-0.2, 0.9, 0.1), DVec3::new(0.4, 0.2, 1.5)),
            DVec3::new(0.5, -2.0, 1.0),
        );
        let extent = [0.6, 0.3];
        let projections = [
            Projection::Perspective { extent },
            Projection::ThinLens { extent, aperture: Aperture::polygon(0.4, 5, 0.3), focus: 3.0 },
            Projection::Orthographic { extent },
        ];
        let camera = |p| Camera::new(p, &[(0.0, matrix)], [0.0, 0.0], [20, 10]);
        projections.into_iter().flat_map(|p| [camera(p), camera(p).with_center([0.5, -0.8])]).collect()
    }

    fn close(a: f32, b: f32, what: &str) {
        assert!((a - b).abs() < 2e-4 * b.abs().max(1.0), "{what}: {a} for {b}");
    }

    /// What lies on a ray is seen where the ray goes through the picture.
    #[test]
    fn points_on_rays_are_seen_there() {
        for camera in cameras() {
            for (u, lens) in random_pairs(200).zip(random_pairs(400).skip(200)) {
                let raster = [u[0] * 24.0 - 2.0, u[1] * 14.0 - 2.0];
                let ray = camera.ray(raster, lens, 0.0);
                let sight = camera.see(ray.o + ray.d * 2.5, lens, 0.0);
                assert!((sight.w + ray.d).length() < 1e-5 && (sight.lens - ray.o).length() < 1e-5);
                (0..2).for_each(|i| close(sight.raster[i], raster[i], "raster"));
                let density = camera.density(ray.d, 0.0).0;
                close(
                    sight.importance / if camera.is_parallel() { density } else { density / 6.25 },
                    1.0,
                    "importance",
                );
                assert_eq!(camera.see(ray.o - ray.d, lens, 0.0).importance, 0.0, "behind the camera");
                assert!(
                    (sight.end - sight.lens).length() == 0.0
                        && (camera.lens_of(ray.o, ray.d, 0.0) - ray.o).length() == 0.0
                );
                if camera.has_lens() {
                    let crossing = camera.crossing(ray.o + ray.d * 2.5, -ray.d, 0.0);
                    assert!(crossing.mask && !camera.crossing(ray.o + ray.d * 2.5, ray.d, 0.0).mask);
                    close(crossing.t, 2.5, "distance");
                    (0..2).for_each(|i| close(crossing.raster[i], raster[i], "raster of light"));
                    close(sight.found * 6.25 * camera.lens_pdf(0.0).0, crossing.cos, "density at the lens");
                }
            }
        }
    }

    /// A near clip changes neither place nor density of what is beyond it; what is nearer is not seen.
    #[test]
    fn near_clips_leave_out_what_is_near() {
        for camera in cameras().into_iter().filter(|c| !c.is_parallel()) {
            let cut = camera.clone().with_near_clip(1.5);
            for (u, lens) in random_pairs(200).zip(random_pairs(400).skip(200)) {
                let raster = [u[0] * 24.0 - 2.0, u[1] * 14.0 - 2.0];
                let (whole, ray) = (camera.ray(raster, lens, 0.0), cut.ray(raster, lens, 0.0));
                let (near, beyond) = (ray.o - ray.d * 0.01, ray.o + ray.d);
                assert!((cut.lens_of(ray.o, ray.d, 0.0) - whole.o).length() < 1e-5, "the lens");
                assert_eq!(cut.see(near, lens, 0.0).importance, 0.0, "nearer than the clip");
                let (a, b) = (camera.see(beyond, lens, 0.0), cut.see(beyond, lens, 0.0));
                assert_eq!((a.importance, a.found, a.raster), (b.importance, b.found, b.raster));
                assert!((b.end - ray.o).length() < 1e-5, "free from the clip on");
                assert!((cut.see_far(ray.d, lens, 0.0).end - ray.o).length() < 1e-5, "free from the clip on");
                if camera.has_lens() {
                    let crossing = cut.crossing(beyond, -ray.d, 0.0);
                    assert!(crossing.mask && !cut.crossing(near, -ray.d, 0.0).mask);
                    close(crossing.free, 1.0, "distance to the clip");
                    close(crossing.t, camera.crossing(beyond, -ray.d, 0.0).t, "distance to the lens");
                }
            }
        }
    }

    /// The density of rays is the Jacobian of the raster: pixels per solid angle, or per area across.
    #[test]
    fn densities_are_jacobians() {
        for camera in cameras() {
            for (u, lens) in random_pairs(50).zip(random_pairs(100).skip(50)) {
                let raster = [u[0] * 20.0, u[1] * 10.0];
                let step = 0.05;
                let at = |x: f32, y: f32| camera.ray([raster[0] + x, raster[1] + y], lens, 0.0);
                let of = |x: f32, y: f32| if camera.is_parallel() { at(x, y).o } else { at(x, y).d };
                let (dx, dy) = (of(step, 0.0) - of(-step, 0.0), of(0.0, step) - of(0.0, -step));
                let area = dx.cross(dy).dot(at(0.0, 0.0).d).abs() / (4.0 * step * step);
                let product = area * camera.density(at(0.0, 0.0).d, 0.0).0;
                assert!((product - 1.0).abs() < 2e-3, "{product}");
            }
        }
    }
}
