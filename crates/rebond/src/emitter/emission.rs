//! Light as it leaves its emitters: rays, where path tracing backwards begins.
//!
//! | emitter | position | direction |
//! |---|---|---|
//! | surfaces | uniform by area, 1/A | cosθ/π to the side of the normal |
//! | point | – | uniform over the sphere, 1/4π |
//! | spot | – | uniform over its cone |
//! | directional | uniform over a disk across the beam, as large as the scene, 1/πR² | – |
//! | environment | the same | as [`Environment::sample`](super::Environment::sample) draws it |
//!
//! What starts infinitely far starts from the disk that touches the sphere around the scene.

use super::{Emitters, KINDS, Kind, POINT_ERROR};
use crate::math::{Frame, Rgb, Vec3, offset_from_surface};
use crate::sampling::warp::{
    cosine_hemisphere, cosine_hemisphere_pdf, uniform_cone, uniform_cone_pdf, uniform_disk, uniform_sphere,
    uniform_sphere_pdf, uniform_triangle,
};
use crate::sampling::{PdfArea, PdfSolidAngle};
use rebond_bvh::Ray;
use rebond_lanes::{math, scalar::Index1};
use std::f32::consts::PI;

/// The densities with which a ray leaves an emitter. What is not drawn, as the position of a point, counts 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct EmissionPdf {
    /// Of the position: on the emitter, or on the disk before the scene.
    pub position: PdfArea<f32>,
    /// Of the direction.
    pub direction: PdfSolidAngle<f32>,
}

/// A ray that leaves an emitter.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Where it starts.
    pub o: Vec3<f32>,
    /// Bound of the error of that, per axis.
    pub error: f32,
    /// Geometric normal there; zero if it is no surface.
    pub normal: Vec3<f32>,
    /// Unit direction it goes.
    pub d: Vec3<f32>,
    /// `Le |cosθ| / (pdf(position) pdf(direction))`; for points intensity, for beams irradiance over the pdf there is. In W.
    pub weight: Rgb<f32>,
    /// Its densities, of this emitter alone.
    pub pdf: EmissionPdf,
}

impl Emission {
    /// The ray, moved off its surface.
    pub fn ray(&self, time: f32) -> Ray<f32> {
        let o = offset_from_surface(self.o, self.error, self.normal, self.d);
        Ray { o: o.array(), d: self.d.array(), tmax: f32::INFINITY, time }
    }
}

impl Emitters {
    /// With the sphere that the scene lies in, which infinite emitters shine on.
    pub(crate) fn around(self, center: [f32; 3], radius: f32) -> Self {
        Self { sphere: (center, radius), ..self }
    }

    fn kind(&self, emitter: u32) -> Kind {
        KINDS[self.record::<f32>(Index1(emitter), 0)[3].to_bits() as usize]
    }

    /// Whether it is infinitely far.
    pub fn is_infinite(&self, emitter: u32) -> bool {
        matches!(self.kind(emitter), Kind::Directional | Kind::Environment)
    }

    /// Whether a ray can find it.
    pub fn is_hittable(&self, emitter: u32) -> bool {
        !matches!(self.kind(emitter), Kind::Point | Kind::Spot | Kind::Directional)
    }

    /// Density per area of the disk that infinite emitters shine from.
    fn disk_pdf(&self) -> PdfArea<f32> {
        PdfArea(1.0 / (PI * self.sphere.1 * self.sphere.1))
    }

    /// A ray from an emitter, by four numbers in [0, 1).
    pub fn emit(&self, emitter: u32, position: [f32; 2], direction: [f32; 2]) -> Emission {
        let record = |n: u32| self.record::<f32>(Index1(emitter), n);
        let vector = |n: u32| Vec3::of_record(record(n));
        let value = Rgb::of_record(record(0));
        let [x, y, z, density] = record(1);
        let place = crate::math::vec3(x, y, z);
        let surface = |o: Vec3<f32>, error: f32, normal: Vec3<f32>| {
            let local = cosine_hemisphere(direction);
            let pdf = EmissionPdf { position: PdfArea(density), direction: cosine_hemisphere_pdf(local) };
            let d = Frame::around(normal).to_world(local);
            // Le cosθ / (1/A · cosθ/π).
            Emission { o, error, normal, d, weight: value * (PI / density), pdf }
        };
        let flat = |[a, b]: [f32; 2]| {
            let (e1, e2) = (vector(2), vector(3));
            let error = (place.max_abs() + e1.max_abs() + e2.max_abs()) * POINT_ERROR;
            surface(e1.mul_add(a, e2.mul_add(b, place)), error, vector(4))
        };
        let point = |d: Vec3<f32>, weight: Rgb<f32>, pdf: PdfSolidAngle<f32>| {
            let pdf = EmissionPdf { position: PdfArea(1.0), direction: pdf };
            Emission { o: place, error: 0.0, normal: Vec3::zero(), d, weight: weight * (1.0 / pdf.direction.0), pdf }
        };
        match self.kind(emitter) {
            Kind::Triangle => flat(uniform_triangle(position)),
            Kind::Parallelogram => flat(position),
            Kind::Disk => flat(uniform_disk(position)),
            Kind::Sphere => {
                let [radius, sign, ..] = record(2);
                let n = uniform_sphere(position);
                surface(place + n * radius, (place.max_abs() + radius) * POINT_ERROR, n * sign)
            }
            Kind::Point => point(uniform_sphere(direction), value, uniform_sphere_pdf()),
            Kind::Spot => {
                let [cutoff, ramp, ..] = record(2);
                let one_minus_cos = one_minus_cos(cutoff);
                let local = uniform_cone(direction, one_minus_cos);
                let falloff = ((cutoff - math::acos(local.z)) * ramp).clamp(0.0, 1.0);
                point(Frame::around(vector(4)).to_world(local), value * falloff, uniform_cone_pdf(one_minus_cos))
            }
            Kind::Directional => self.beam(-place, position, value, PdfSolidAngle(1.0)),
            Kind::Environment => {
                let (_, environment) =
                    self.environments.iter().find(|(number, _)| *number == emitter).expect("its surroundings");
                let (w, pdf, radiance) = environment.sample(direction);
                let weight = (radiance * (1.0 / pdf.0)).masked(pdf.0 > 0.0);
                self.beam(-w, position, weight, pdf)
            }
        }
    }

    /// A ray into the direction `d`, from the disk before the scene.
    fn beam(&self, d: Vec3<f32>, position: [f32; 2], weight: Rgb<f32>, direction: PdfSolidAngle<f32>) -> Emission {
        let (center, radius) = (Vec3::splat(self.sphere.0), self.sphere.1);
        let [x, y] = uniform_disk(position).map(|x| x * radius);
        let frame = Frame::around(d);
        let o = center + frame.s * x + frame.t * y - d * radius;
        let pdf = EmissionPdf { position: self.disk_pdf(), direction };
        Emission { o, error: 0.0, normal: Vec3::zero(), d, weight: weight * (1.0 / pdf.position.0), pdf }
    }

    /// The densities with which [`Emitters::emit`] draws a ray into the unit direction `d`, from a point with geometric normal
    /// `normal` where the emitter is a surface.
    pub fn emission_pdf(&self, emitter: u32, normal: Vec3<f32>, d: Vec3<f32>) -> EmissionPdf {
        let record = |n: u32| self.record::<f32>(Index1(emitter), n);
        let (position, direction) = match self.kind(emitter) {
            Kind::Triangle | Kind::Parallelogram | Kind::Disk | Kind::Sphere => {
                (PdfArea(record(1)[3]), PdfSolidAngle(normal.dot(d).max(0.0) / PI))
            }
            Kind::Point => (PdfArea(1.0), uniform_sphere_pdf()),
            Kind::Spot => {
                let cutoff = record(2)[0];
                let within = math::acos(Vec3::of_record(record(4)).dot(d)) < cutoff;
                let pdf = uniform_cone_pdf(one_minus_cos(cutoff));
                (PdfArea(1.0), if within { pdf } else { PdfSolidAngle(0.0) })
            }
            Kind::Directional => (self.disk_pdf(), PdfSolidAngle(1.0)),
            Kind::Environment => {
                let of = |number: u32| self.environments.iter().find(|(n, _)| *n == number);
                (self.disk_pdf(), of(emitter).map_or(PdfSolidAngle(0.0), |(_, e)| e.eval(-d).1))
            }
        };
        EmissionPdf { position, direction }
    }
}

/// 1 − cos, without cancellation.
fn one_minus_cos(angle: f32) -> f32 {
    let half = (0.5 * angle).sin();
    2.0 * half * half
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitter::{Emitter, Environment, EnvironmentImage};
    use crate::testing::{SIGNIFICANCE, chi2_directions, chi2_square, seeded_pairs, t_test_p_value};
    use glam::Vec3 as V;

    const RADIUS: f32 = 3.0;
    const RADIANCE: [f32; 3] = [0.7, 1.3, 2.1];

    fn emitters() -> Vec<Emitter> {
        let normal = V::new(0.3, -0.5, 0.7).normalize();
        let p = [V::new(1.0, 0.2, -0.4), V::new(0.9, 0.1, 0.2), V::new(-0.2, 0.8, 0.4)];
        let sphere =
            |inwards| Emitter::Sphere { center: V::new(0.2, 0.1, -0.3), radius: 0.6, inwards, radiance: RADIANCE };
        let spot = |inner: f32, outer: f32| Emitter::Spot {
            position: V::ONE,
            axis: normal,
            angles: [inner.to_radians(), outer.to_radians()],
            intensity: RADIANCE,
        };
        vec![
            Emitter::Triangle { p, radiance: RADIANCE },
            Emitter::Parallelogram { p, radiance: RADIANCE },
            sphere(false),
            sphere(true),
            Emitter::Disk { center: V::NEG_ONE, normal, radius: 0.5, radiance: RADIANCE },
            Emitter::Point { position: V::ONE, intensity: RADIANCE },
            spot(10.0, 45.0),
            spot(89.0, 90.0),
            Emitter::Directional { direction: normal, irradiance: RADIANCE },
            Emitter::Environment { number: 0, mean: [0.4; 3] },
        ]
    }

    fn table() -> Emitters {
        let texels: Vec<[f32; 3]> = (0..32).map(|i| [0.2 + (i * 7 % 11) as f32 * 0.3; 3]).collect();
        let frame = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]];
        let image = EnvironmentImage::new([8, 4], &texels, frame).expect("light");
        let environment = Environment::Image(Box::new(image));
        Emitters::new(&emitters(), vec![environment]).around([0.5, -0.5, 0.25], RADIUS)
    }

    /// χ² of directions; about the emitter's normal, those of surfaces.
    #[test]
    fn directions_follow_their_densities() {
        let table = table();
        for emitter in [0, 1, 2, 3, 4, 5, 6, 7, 9] {
            // One position, so that there is one normal.
            let normal = table.emit(emitter, [0.3, 0.6], [0.5; 2]).normal;
            let frame = Frame::around(if normal.length() > 0.0 { normal } else { Vec3::splat([0.0, 0.0, 1.0]) });
            // The edge of the cone would cut bins.
            let axis = V::new(0.3, -0.5, 0.7).normalize().to_array();
            let frame = if emitter == 6 || emitter == 7 { Frame::around(Vec3::splat(axis)) } else { frame };
            let sample = |u| {
                let e = table.emit(emitter, [0.3, 0.6], u);
                let same = table.emission_pdf(emitter, e.normal, e.d);
                assert!(
                    (same.direction.0 / e.pdf.direction.0 - 1.0).abs() < 2e-3,
                    "{emitter}: {same:?} for {:?}",
                    e.pdf
                );
                assert!((same.position.0 / e.pdf.position.0 - 1.0).abs() < 1e-5);
                Some(frame.to_local(e.d))
            };
            let pdf = |w| table.emission_pdf(emitter, normal, frame.to_world(w)).direction.0;
            chi2_directions(&format!("emitter {emitter}"), sample, pdf);
        }
    }

    /// χ² of positions over what they are drawn from, each mapped to the unit square.
    #[test]
    fn positions_follow_their_densities() {
        let table = table();
        let normal = V::new(0.3, -0.5, 0.7).normalize();
        let o = |emitter: u32, u: [f32; 2]| V::from(table.emit(emitter, u, [0.5; 2]).o.array());
        let [p, a, b] = [V::new(1.0, 0.2, -0.4), V::new(0.9, 0.1, 0.2), V::new(-0.2, 0.8, 0.4)];
        let along = |x: V| {
            let n = a.cross(b);
            [(x - p).cross(b).dot(n) / n.length_squared(), a.cross(x - p).dot(n) / n.length_squared()]
        };
        chi2_square("triangle", |u| along(o(0, u)), |[x, y]| if x + y < 1.0 { 2.0 } else { 0.0 });
        chi2_square("parallelogram", |u| along(o(1, u)), |_| 1.0);
        let disk = |[x, y]: [f32; 2]| if (x - 0.5).powi(2) + (y - 0.5).powi(2) < 0.25 { 4.0 / PI } else { 0.0 };
        let (s, t) = normal.any_orthonormal_pair();
        let in_plane = |x: V, radius: f32| [x.dot(s), x.dot(t)].map(|c| c / (2.0 * radius) + 0.5);
        chi2_square("disk", |u| in_plane(o(4, u) - V::NEG_ONE, 0.5), disk);
        let center = V::new(0.5, -0.5, 0.25);
        chi2_square("beam", |u| in_plane(o(8, u) - center, RADIUS), disk);
        for u in seeded_pairs(100, 3) {
            assert!((o(8, u) - center).dot(normal) + RADIUS < 1e-5, "the beam starts before the scene");
        }
        // Archimedes: height and angle on a sphere are uniform.
        for emitter in [2, 3] {
            let on_sphere = |u: [f32; 2]| {
                let n = (o(emitter, u) - V::new(0.2, 0.1, -0.3)) / 0.6;
                [n.z * 0.5 + 0.5, (n.y.atan2(n.x) / (2.0 * PI)).rem_euclid(1.0)]
            };
            chi2_square("sphere", on_sphere, |_| 1.0);
        }
    }

    /// The mean weight is the emitter's power; that of surfaces, points and beams does not vary.
    #[test]
    fn weights_are_power() {
        let table = table();
        for (number, emitter) in emitters().iter().enumerate() {
            let power = match emitter {
                // Texels are not the picture, which is interpolated between them.
                Emitter::Environment { .. } => {
                    let (rows, columns) = (400, 800);
                    let mut sum = 0.0;
                    for i in 0..rows * columns {
                        let theta = (f64::from(i / columns) + 0.5) / f64::from(rows) * std::f64::consts::PI;
                        let phi = (f64::from(i % columns) + 0.5) / f64::from(columns) * std::f64::consts::TAU;
                        let w = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|x| x as f32);
                        sum += f64::from(table.environments[0].1.eval(Vec3::<f32>::splat(w)).0.g) * theta.sin();
                    }
                    let cell = 2.0 * std::f64::consts::PI.powi(2) / f64::from(rows * columns);
                    sum * cell * std::f64::consts::PI * f64::from(RADIUS * RADIUS)
                }
                finite => finite.power(RADIUS)[1],
            };
            let pairs = seeded_pairs(40_000, 1).zip(seeded_pairs(40_000, 2));
            let weights: Vec<f64> = pairs.map(|(u, v)| f64::from(table.emit(number as u32, u, v).weight.g)).collect();
            if matches!(number, 6 | 7 | 9) {
                let p = t_test_p_value(&weights, power);
                assert!(p > SIGNIFICANCE, "{number}: p {p} for {power}");
            } else {
                weights.iter().for_each(|w| assert!((w / power - 1.0).abs() < 1e-5, "{number}: {w} for {power}"));
            }
        }
    }
}
