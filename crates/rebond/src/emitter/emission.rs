//! Light as it leaves its emitters: rays, where path tracing backwards begins.
//!
//! | emitter | position | direction |
//! |---|---|---|
//! | surfaces | uniform by area, 1/A; on a sphere mostly from its cap, if it has one | cosθ/π to the side of the normal |
//! | point | – | uniform over the sphere, 1/4π |
//! | spot | – | uniform over its cone |
//! | projector | – | as its image's `sample` draws it |
//! | directional | uniform over a disk across the beam, as large as the scene, 1/πR² | – |
//! | directional-area | uniform by area, 1/A | – |
//! | environment | as directional | as [`Environment::sample`](super::Environment::sample) draws it |
//!
//! What starts infinitely far starts from the disk that touches the sphere around the scene.

use super::{Emitters, KINDS, Kind, UNHITTABLE, point_of_sphere};
use crate::math::{Frame, Rgb, Vec3, offset_from_surface};
use crate::sampling::warp::{
    cosine_hemisphere, cosine_hemisphere_pdf, uniform_cone, uniform_cone_pdf, uniform_disk, uniform_sphere,
    uniform_sphere_pdf, uniform_triangle,
};
use crate::sampling::{PdfArea, PdfSolidAngle};
use rebond_bvh::Ray;
use rebond_lanes::{Index, Mask, Real, math};
use std::f32::consts::PI;

/// The densities with which a ray leaves an emitter. What is not drawn, as the position of a point, counts 1.
#[derive(Clone, Copy, Debug)]
pub struct EmissionPdf<F: Real> {
    /// Of the position: on the emitter, or on the disk before the scene.
    pub position: PdfArea<F>,
    /// Of the direction.
    pub direction: PdfSolidAngle<F>,
}

/// A ray that leaves an emitter.
#[derive(Clone, Copy, Debug)]
pub struct Emission<F: Real> {
    /// Where it starts.
    pub o: Vec3<F>,
    /// Bound of the error of that, per axis.
    pub error: F,
    /// Geometric normal there; zero if it is no surface.
    pub normal: Vec3<F>,
    /// Unit direction it goes.
    pub d: Vec3<F>,
    /// `Le |cosθ| / (pdf(position) pdf(direction))`; for points intensity, for beams irradiance over the pdf there is. In W.
    pub weight: Rgb<F>,
    /// Its densities, of this emitter alone.
    pub pdf: EmissionPdf<F>,
}

impl<F: Real> EmissionPdf<F> {
    fn new(position: F, direction: F) -> Self {
        Self { position: PdfArea(position), direction: PdfSolidAngle(direction) }
    }

    #[inline(always)]
    fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Self::new(F::select(mask, a.position.0, b.position.0), F::select(mask, a.direction.0, b.direction.0))
    }
}

impl<F: Real> Emission<F> {
    fn none() -> Self {
        let (nothing, z) = (F::zero(), Vec3::splat([0.0, 0.0, 1.0]));
        let pdf = EmissionPdf::new(F::one(), F::one());
        Self { o: Vec3::zero(), error: nothing, normal: Vec3::zero(), d: z, weight: Rgb::black(), pdf }
    }

    #[inline(always)]
    fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Self {
            o: Vec3::select(mask, a.o, b.o),
            error: F::select(mask, a.error, b.error),
            normal: Vec3::select(mask, a.normal, b.normal),
            d: Vec3::select(mask, a.d, b.d),
            weight: Rgb::select(mask, a.weight, b.weight),
            pdf: EmissionPdf::select(mask, a.pdf, b.pdf),
        }
    }

    /// From a surface that shines evenly.
    #[inline(always)]
    fn of_surface(o: Vec3<F>, error: F, normal: Vec3<F>, radiance: Rgb<F>, density: F, u: [F; 2]) -> Self {
        let local = cosine_hemisphere(u);
        let pdf = EmissionPdf { position: PdfArea(density), direction: cosine_hemisphere_pdf(local) };
        // Le cosθ / (1/A · cosθ/π).
        let weight = radiance * (F::splat(PI) / density);
        Self { o, error, normal, d: Frame::around(normal).to_world(local), weight, pdf }
    }

    /// From a point into a direction that was drawn with this density.
    #[inline(always)]
    fn of_point(o: Vec3<F>, d: Vec3<F>, intensity: Rgb<F>, direction: PdfSolidAngle<F>) -> Self {
        let pdf = EmissionPdf { position: PdfArea(F::one()), direction };
        Self { o, error: F::zero(), normal: Vec3::zero(), d, weight: intensity * direction.0.recip(), pdf }
    }

    /// The ray, moved off its surface.
    pub fn ray(&self, time: F) -> Ray<F> {
        let o = offset_from_surface(self.o, self.error, self.normal, self.d);
        Ray { o: o.array(), d: self.d.array(), tmax: F::splat(f32::INFINITY), time }
    }
}

impl Emitters {
    /// With the sphere that the scene lies in, which infinite emitters shine on.
    pub(crate) fn around(self, center: [f32; 3], radius: f32) -> Self {
        Self { sphere: (center, radius), ..self }
    }

    /// Calls `f` for each kind of emitters present, with its lanes.
    #[inline(always)]
    fn each_kind<F: Real>(&self, emitter: F::Index, mask: F::Mask, mut f: impl FnMut(Kind, F::Mask)) {
        if self.present.is_power_of_two() {
            return f(KINDS[self.present.trailing_zeros() as usize], mask);
        }
        let kind = self.record::<F>(emitter, 0)[3].to_bits();
        for k in KINDS {
            if self.present >> k as u32 & 1 == 1 {
                let lanes = mask & kind.eq(F::Index::splat(k as u32));
                if lanes.any() {
                    f(k, lanes);
                }
            }
        }
    }

    #[inline(always)]
    fn are<F: Real>(&self, emitter: F::Index, kinds: &[Kind]) -> F::Mask {
        let mut found = F::Mask::splat(false);
        self.each_kind::<F>(emitter, F::Mask::splat(true), |kind, lanes| {
            if kinds.contains(&kind) {
                found = found | lanes;
            }
        });
        found
    }

    /// Lanes whose emitter is infinitely far.
    #[inline(always)]
    pub fn is_infinite<F: Real>(&self, emitter: F::Index) -> F::Mask {
        self.are::<F>(emitter, &[Kind::Directional, Kind::Environment])
    }

    /// Lanes whose emitter shines in parallel rays, so that distance does not count, or is infinitely far.
    #[inline(always)]
    pub fn is_parallel<F: Real>(&self, emitter: F::Index) -> F::Mask {
        self.are::<F>(emitter, &[Kind::Directional, Kind::DirectionalArea, Kind::Environment])
    }

    /// Lanes whose emitter a ray can find.
    #[inline(always)]
    pub fn is_hittable<F: Real>(&self, emitter: F::Index) -> F::Mask {
        !self.are::<F>(emitter, &UNHITTABLE)
    }

    /// Density per area of the disk that infinite emitters shine from.
    fn disk_pdf<F: Real>(&self) -> PdfArea<F> {
        PdfArea(F::splat(1.0 / (PI * self.sphere.1 * self.sphere.1)))
    }

    /// A ray from an emitter at a time, by four numbers in [0, 1).
    #[inline(never)]
    pub fn emit<F: Real>(
        &self,
        emitter: F::Index,
        time: F,
        position: [F; 2],
        direction: [F; 2],
        mask: F::Mask,
    ) -> Emission<F> {
        let value = Rgb::of_record(self.record::<F>(emitter, 0));
        let flat = |[a, b]: [F; 2]| {
            let flat = self.flat(emitter, time);
            let [e1, e2] = flat.edges;
            let o = e1.mul_add(a, e2.mul_add(b, flat.p0));
            Emission::of_surface(o, flat.error(), flat.normal, value, flat.density, direction)
        };
        let mut emission = Emission::none();
        self.each_kind::<F>(emitter, mask, |kind, lanes| {
            let e = match kind {
                Kind::Triangle => flat(uniform_triangle(position)),
                Kind::Parallelogram => flat(position),
                Kind::Disk => flat(uniform_disk(position)),
                Kind::Sphere => {
                    let (center, radius, sign, density) = self.ball(emitter, time);
                    let cap = self.cap(emitter, radius, sign.gt(F::zero()));
                    let (by_cap, position) = cap.way(position);
                    let n = Vec3::select(by_cap, cap.normal(position), uniform_sphere(position));
                    let (o, n, error) = point_of_sphere(center, radius, n);
                    let density = cap.mixed(cap.density().0, density, n);
                    Emission::of_surface(o, error, n * sign, value, density, direction)
                }
                Kind::Point => {
                    let d = uniform_sphere(direction);
                    Emission::of_point(self.place(emitter, time), d, value, uniform_sphere_pdf())
                }
                Kind::Spot => {
                    let [cutoff, ramp, ..] = self.record::<F>(emitter, 2);
                    let one_minus_cos = one_minus_cos(cutoff);
                    let local = uniform_cone(direction, one_minus_cos);
                    let falloff = ((cutoff - math::acos(local.z)) * ramp).clamp(0.0, 1.0);
                    let (place, d) =
                        (self.place(emitter, time), Frame::around(self.axis(emitter, time)).to_world(local));
                    Emission::of_point(place, d, value * falloff, uniform_cone_pdf(one_minus_cos))
                }
                Kind::Projector => self.project(emitter, time, direction, lanes),
                Kind::Directional => {
                    let d = -Vec3::of_record(self.record::<F>(emitter, 1));
                    self.beam(d, position, value, PdfSolidAngle(F::one()))
                }
                Kind::DirectionalArea => {
                    let (flat, round) = self.flat_beam(emitter, time);
                    let disk = uniform_disk(position);
                    let [a, b] = [0, 1].map(|i| F::select(round, disk[i], position[i]));
                    let o = flat.edges[0].mul_add(a, flat.edges[1].mul_add(b, flat.p0));
                    let (pdf, weight) = (EmissionPdf::new(flat.density, F::one()), value * flat.density.recip());
                    Emission { o, error: flat.error(), normal: flat.normal, d: flat.normal, weight, pdf }
                }
                Kind::Environment => {
                    let drawn = self.sample_environment(emitter, direction, lanes);
                    self.beam(-drawn.wi, position, drawn.weight, drawn.pdf)
                }
            };
            emission = if lanes.all() { e } else { Emission::select(lanes, e, emission) };
        });
        if let Some(glow) = &self.glow {
            emission.weight *= glow.at(emitter, &self.flat(emitter, time), emission.o, mask);
        }
        emission
    }

    /// A ray through the image of a projector.
    #[inline(never)]
    fn project<F: Real>(&self, emitter: F::Index, time: F, u: [F; 2], mask: F::Mask) -> Emission<F> {
        let (place, mut emission) = (self.place(emitter, time), Emission::none());
        for (number, image) in &self.projectors {
            let lanes = mask & emitter.eq(F::Index::splat(*number));
            if lanes.any() {
                let (d, pdf, intensity) = image.sample(u);
                let mut drawn = Emission::of_point(place, d, intensity, pdf);
                drawn.weight = drawn.weight.masked(pdf.0.gt(F::zero()));
                emission = Emission::select(lanes, drawn, emission);
            }
        }
        emission
    }

    /// A ray into the direction `d`, from the disk before the scene.
    #[inline(always)]
    fn beam<F: Real>(&self, d: Vec3<F>, position: [F; 2], weight: Rgb<F>, direction: PdfSolidAngle<F>) -> Emission<F> {
        let (center, radius) = (Vec3::splat(self.sphere.0), self.sphere.1);
        let [x, y] = uniform_disk(position).map(|x| x * radius);
        let frame = Frame::around(d);
        let o = center + frame.s * x + frame.t * y - d * F::splat(radius);
        let pdf = EmissionPdf { position: self.disk_pdf(), direction };
        Emission { o, error: F::zero(), normal: Vec3::zero(), d, weight: weight * pdf.position.0.recip(), pdf }
    }

    /// The densities with which [`Emitters::emit`] draws a ray into the unit direction `d`, from a point with geometric normal
    /// `normal` where the emitter is a surface.
    #[inline(never)]
    pub fn emission_pdf<F: Real>(
        &self,
        emitter: F::Index,
        time: F,
        normal: Vec3<F>,
        d: Vec3<F>,
        mask: F::Mask,
    ) -> EmissionPdf<F> {
        let mut pdf = EmissionPdf::new(F::one(), F::zero());
        self.each_kind::<F>(emitter, mask, |kind, lanes| {
            let of_kind = match kind {
                Kind::Triangle | Kind::Parallelogram | Kind::Disk => {
                    EmissionPdf::new(self.flat(emitter, time).density, normal.dot(d).relu() * (1.0 / PI))
                }
                Kind::Sphere => {
                    let (_, radius, sign, density) = self.ball(emitter, time);
                    let cap = self.cap(emitter, radius, sign.gt(F::zero()));
                    let density = cap.mixed(cap.density().0, density, normal);
                    EmissionPdf::new(density, normal.dot(d).relu() * (1.0 / PI))
                }
                Kind::Point => EmissionPdf { position: PdfArea(F::one()), direction: uniform_sphere_pdf() },
                Kind::Spot => {
                    let cutoff = self.record::<F>(emitter, 2)[0];
                    let within = math::acos(self.axis(emitter, time).dot(d)).lt(cutoff);
                    let cone = uniform_cone_pdf(one_minus_cos(cutoff));
                    EmissionPdf::new(F::one(), F::select(within, cone.0, F::zero()))
                }
                Kind::Projector => {
                    let direction = self.projectors.iter().fold(F::zero(), |found, (number, image)| {
                        F::select(emitter.eq(F::Index::splat(*number)), image.eval(d).1.0, found)
                    });
                    EmissionPdf::new(F::one(), direction)
                }
                Kind::Directional => EmissionPdf { position: self.disk_pdf(), direction: PdfSolidAngle(F::one()) },
                Kind::DirectionalArea => EmissionPdf::new(self.flat(emitter, time).density, F::one()),
                Kind::Environment => {
                    let direction = self.environments.iter().fold(F::zero(), |found, (number, environment)| {
                        F::select(emitter.eq(F::Index::splat(*number)), environment.eval(-d).1.0, found)
                    });
                    EmissionPdf { position: self.disk_pdf(), direction: PdfSolidAngle(direction) }
                }
            };
            pdf = if lanes.all() { of_kind } else { EmissionPdf::select(lanes, of_kind, pdf) };
        });
        pdf
    }
}

/// 1 − cos, without cancellation.
#[inline(always)]
fn one_minus_cos<F: Real>(angle: F) -> F {
    let (half, _) = math::sin_cos(angle * 0.5);
    half * half * 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitter::{Emitter, Environment, EnvironmentImage, IntensityImage, Slide, Window};
    use crate::testing::{SIGNIFICANCE, chi2_directions, chi2_square, seeded_pairs, t_test_p_value};
    use crate::texture::{TextureFilter, Wrap};
    use glam::Vec3 as V;
    use rebond_lanes::{F32x16, scalar::Index1};

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
            Emitter::Projector { number: 0, position: V::ONE, cone: slide().cone(), power: slide().power() },
            Emitter::DirectionalArea { p, round: false, irradiance: RADIANCE },
            Emitter::DirectionalArea { p, round: true, irradiance: RADIANCE },
        ]
    }

    /// A plane that is lit as an image says.
    fn slide() -> IntensityImage {
        let texels: Vec<[f32; 3]> = (0..12).map(|i| [0.1 + (i * 5 % 7) as f32; 3]).collect();
        let frame = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]];
        let window = Window { extent: [0.8, 1.1], frame, even: true, beam: None };
        let slide = Slide::new(window, [4, 3], &texels, TextureFilter::Bilinear, Wrap::Clamp);
        IntensityImage::Slide(Box::new(slide.expect("light")))
    }

    fn table() -> Emitters {
        let texels: Vec<[f32; 3]> = (0..32).map(|i| [0.2 + (i * 7 % 11) as f32 * 0.3; 3]).collect();
        let frame = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]];
        let image = EnvironmentImage::new([8, 4], &texels, frame).expect("light");
        let environment = Environment::Image(Box::new(image));
        let table = Emitters::new(&emitters(), vec![environment]).projecting(&emitters(), vec![slide()]);
        table.around([0.5, -0.5, 0.25], RADIUS)
    }

    fn emit(table: &Emitters, emitter: u32, position: [f32; 2], direction: [f32; 2]) -> Emission<f32> {
        table.emit(Index1(emitter), 0.0, position, direction, true)
    }

    /// χ² of directions; about the emitter's normal, those of surfaces.
    #[test]
    fn directions_follow_their_densities() {
        let table = table();
        for emitter in [0, 1, 2, 3, 4, 5, 6, 7, 9, 10] {
            // One position, so that there is one normal.
            let normal = emit(&table, emitter, [0.3, 0.6], [0.5; 2]).normal;
            let frame = Frame::around(if normal.length() > 0.0 { normal } else { Vec3::splat([0.0, 0.0, 1.0]) });
            // The edge of the cone would cut bins.
            let axis = V::new(0.3, -0.5, 0.7).normalize().to_array();
            let frame = if emitter == 6 || emitter == 7 { Frame::around(Vec3::splat(axis)) } else { frame };
            let sample = |u| {
                let e = emit(&table, emitter, [0.3, 0.6], u);
                let same = table.emission_pdf(Index1(emitter), 0.0, e.normal, e.d, true);
                assert!(
                    (same.direction.0 / e.pdf.direction.0 - 1.0).abs() < 2e-3,
                    "{emitter}: {same:?} for {:?}",
                    e.pdf
                );
                assert!((same.position.0 / e.pdf.position.0 - 1.0).abs() < 1e-5);
                Some(frame.to_local(e.d))
            };
            let pdf = |w| table.emission_pdf(Index1(emitter), 0.0, normal, frame.to_world(w), true).direction.0;
            chi2_directions(&format!("emitter {emitter}"), sample, pdf);
        }
    }

    /// χ² of positions over what they are drawn from, each mapped to the unit square.
    #[test]
    fn positions_follow_their_densities() {
        let table = table();
        let normal = V::new(0.3, -0.5, 0.7).normalize();
        let o = |emitter: u32, u: [f32; 2]| V::from(emit(&table, emitter, u, [0.5; 2]).o.array());
        let [p, a, b] = [V::new(1.0, 0.2, -0.4), V::new(0.9, 0.1, 0.2), V::new(-0.2, 0.8, 0.4)];
        let along = |x: V| {
            let n = a.cross(b);
            [(x - p).cross(b).dot(n) / n.length_squared(), a.cross(x - p).dot(n) / n.length_squared()]
        };
        chi2_square("triangle", |u| along(o(0, u)), |[x, y]| if x + y < 1.0 { 2.0 } else { 0.0 });
        chi2_square("parallelogram", |u| along(o(1, u)), |_| 1.0);
        chi2_square("square beam", |u| along(o(11, u)), |_| 1.0);
        let in_ellipse = |[x, y]: [f32; 2]| if x * x + y * y < 1.0 { 4.0 / PI } else { 0.0 };
        // By quarters, which are alike.
        chi2_square("round beam", |u| along(o(12, u)).map(f32::abs), in_ellipse);
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

    /// From a sphere with a cap: χ² of positions, and power.
    #[test]
    fn caps_shine_more_often_and_no_more() {
        let radius = 0.6;
        let sphere = Emitter::Sphere { center: V::new(0.2, 0.1, -0.3), radius, inwards: false, radiance: RADIANCE };
        let power = sphere.power(RADIUS)[1];
        let mut table = Emitters::new(&[sphere], vec![]).around([0.0; 3], RADIUS);
        // To the 8th of the test's 40 rows.
        let edge = (0.2 * PI).cos();
        table.set_cap(0, Vec3::splat([0.0, 0.0, 1.0]), 1.0 - edge);
        let drawn = |u: [f32; 2]| emit(&table, 0, u, [0.4, 0.3]);
        let mut weights = Vec::new();
        for u in seeded_pairs(40_000, 1) {
            let e = drawn(u);
            let again = table.emission_pdf(Index1(0), 0.0, e.normal, e.d, true);
            assert_eq!(again.position.0, e.pdf.position.0);
            weights.push(f64::from(e.weight.g));
        }
        let p = t_test_p_value(&weights, power);
        assert!(p > SIGNIFICANCE, "p {p}");
        let pdf = |n: Vec3<f32>| table.emission_pdf(Index1(0), 0.0, n, n, true).position.0 * radius * radius;
        chi2_directions("sphere with a cap", |u| Some(drawn(u).normal), pdf);
        let often = seeded_pairs(10_000, 2).filter(|u| drawn(*u).normal.z > edge).count();
        assert!(often > 7_500, "{often}");
    }

    /// The mean weight is the emitter's power; that of surfaces, points, beams and grey slides before a plane does not vary.
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
            let weights: Vec<f64> = pairs.map(|(u, v)| f64::from(emit(&table, number as u32, u, v).weight.g)).collect();
            if matches!(number, 6 | 7 | 9) {
                let p = t_test_p_value(&weights, power);
                assert!(p > SIGNIFICANCE, "{number}: p {p} for {power}");
            } else {
                weights.iter().for_each(|w| assert!((w / power - 1.0).abs() < 1e-5, "{number}: {w} for {power}"));
            }
        }
    }

    /// A point before a beam is in the light of the point where a ray that goes there starts; others are in none.
    #[test]
    fn beams_light_what_they_meet() {
        let table = table();
        for emitter in [11, 12] {
            let normal = emit(&table, emitter, [0.5; 2], [0.5; 2]).d;
            let at =
                |p: Vec3<f32>| table.sample(Index1(emitter), p, 0.0, super::super::LightSampling::Area, [0.5; 2], true);
            for u in seeded_pairs(1000, 7) {
                let e = emit(&table, emitter, u, [0.5; 2]);
                let sample = at(e.o + e.d * 1.7);
                assert_eq!((sample.weight.lane(0), sample.pdf.0), (RADIANCE, 0.0));
                assert!((sample.point - e.o).length() < 1e-5 && (sample.wi + normal).length() < 1e-6);
                assert!(!at(e.o - e.d * 0.1).weight.is_lit(), "from behind");
                // Farther out by as much as the whole is wide.
                let center = emit(&table, emitter, [0.5; 2], [0.5; 2]).o;
                let beside = center + (e.o - center) * (4.0 / (e.o - center).length()) + e.d;
                assert!(!at(beside).weight.is_lit(), "beside it");
            }
        }
    }

    /// What moves shines from where it is, with the densities of its size then: a moved table against emitters that stand there.
    #[test]
    fn what_moves_shines_from_where_it_is() {
        let moved = glam::Affine3A::from_scale_rotation_translation(
            V::splat(1.7),
            glam::Quat::from_axis_angle(V::new(1.0, 2.0, -0.5).normalize(), 0.8),
            V::new(0.3, -0.2, 0.9),
        );
        let rows = |m: glam::Affine3A| {
            let (c, t) = (m.matrix3.transpose(), m.translation);
            [(c.x_axis, t.x), (c.y_axis, t.y), (c.z_axis, t.z)].map(|(r, t)| [r.x, r.y, r.z, t])
        };
        let still: Vec<Emitter> = emitters().into_iter().take(8).collect();
        let there = still.iter().map(|e| match *e {
            Emitter::Triangle { p: [p, a, b], radiance } => {
                let v = |v| moved.transform_vector3(v);
                Emitter::Triangle { p: [moved.transform_point3(p), v(a), v(b)], radiance }
            }
            Emitter::Parallelogram { p: [p, a, b], radiance } => {
                let v = |v| moved.transform_vector3(v);
                Emitter::Parallelogram { p: [moved.transform_point3(p), v(a), v(b)], radiance }
            }
            Emitter::Sphere { center, radius, inwards, radiance } => {
                Emitter::Sphere { center: moved.transform_point3(center), radius: radius * 1.7, inwards, radiance }
            }
            Emitter::Disk { center, normal, radius, radiance } => {
                let normal = moved.transform_vector3(normal).normalize();
                Emitter::Disk { center: moved.transform_point3(center), normal, radius: radius * 1.7, radiance }
            }
            Emitter::Point { position, intensity } => {
                Emitter::Point { position: moved.transform_point3(position), intensity }
            }
            Emitter::Spot { position, axis, angles, intensity } => {
                let axis = moved.transform_vector3(axis).normalize();
                Emitter::Spot { position: moved.transform_point3(position), axis, angles, intensity }
            }
            other => other,
        });
        let there = Emitters::new(&there.collect::<Vec<_>>(), vec![]);
        let motion = vec![(0.0, rows(glam::Affine3A::IDENTITY)), (1.0, rows(moved))];
        let moving = Emitters::new(&still, vec![]).moving(&[(0..8, motion)]);
        for emitter in 0..8 {
            let means = [&moving, &there].map(|table| {
                let each = seeded_pairs(4000, 5).zip(seeded_pairs(4000, 6)).map(|(u, v)| {
                    let e = table.emit(Index1(emitter), 1.0, u, v, true);
                    let again = table.emission_pdf(Index1(emitter), 1.0, e.normal, e.d, true);
                    assert!((again.position.0 / e.pdf.position.0 - 1.0).abs() < 1e-4, "{emitter}: position");
                    assert!((again.direction.0 / e.pdf.direction.0 - 1.0).abs() < 2e-3, "{emitter}: direction");
                    V::from(e.o.array()) + V::from(e.d.array()) + V::new(e.weight.g, e.pdf.position.0, 0.0)
                });
                each.sum::<V>() / 4000.0
            });
            // Disks and spots turn about their axes: only means are the same.
            let apart = (means[0] - means[1]).length() / means[1].length();
            assert!(apart < 0.06, "{emitter}: {means:?}");
        }
    }

    /// Lanes draw what single paths do, kinds mixed.
    #[test]
    fn lanes_emit_what_single_paths_do() {
        let table = table();
        let of = |u: &[[f32; 2]], i: usize| F32x16::load(&u.iter().map(|u| u[i]).collect::<Vec<_>>());
        for seed in 0..20 {
            let (u, v): (Vec<_>, Vec<_>) = (seeded_pairs(16, seed).collect(), seeded_pairs(16, seed + 50).collect());
            let numbers =
                (0..16).fold(<F32x16 as Real>::Index::splat(0), |n, i| n.with_lane(i, (i as u32 * 7 + 3) % 13));
            let all = Mask::splat(true);
            let wide = table.emit(numbers, F32x16::zero(), [of(&u, 0), of(&u, 1)], [of(&v, 0), of(&v, 1)], all);
            let again = table.emission_pdf(numbers, F32x16::zero(), wide.normal, wide.d, all);
            for i in 0..16 {
                let one = emit(&table, numbers.lane(i), u[i], v[i]);
                let close = |a: f32, b: f32| assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "lane {i}: {a} for {b}");
                (0..3).for_each(|c| close(wide.o.lane(i)[c], one.o.array()[c]));
                (0..3).for_each(|c| close(wide.d.lane(i)[c], one.d.array()[c]));
                (0..3).for_each(|c| {
                    close(wide.weight.lane(i)[c] / (1.0 + one.weight.g), one.weight.lane(0)[c] / (1.0 + one.weight.g))
                });
                close(wide.pdf.direction.0.lane(i), one.pdf.direction.0);
                assert!((again.direction.0.lane(i) / one.pdf.direction.0 - 1.0).abs() < 2e-3);
            }
        }
    }
}
