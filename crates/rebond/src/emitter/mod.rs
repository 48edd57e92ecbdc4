//! Lights: what a point receives from them, drawn and weighed.
//!
//! All emitters stand in one flat table, five records each, and are addressed by number. Which of them a point asks is
//! the business of a [`LightSampler`].

mod blur;
mod emission;
mod environment;
mod glow;
mod light_list;
mod light_sampler;
mod light_tree;
mod projector;

pub use emission::{Emission, EmissionPdf};
pub use environment::{Environment, EnvironmentImage};
pub use glow::{Glow, Picture};
pub use light_sampler::{LightChoice, LightSampler};
pub use projector::{IntensityImage, Slide, Window};

use crate::math::{Frame, Keyframes, LUMINANCE, Matrix, Rgb, Vec3};
use crate::sampling::warp::{uniform_cone, uniform_cone_pdf, uniform_disk, uniform_sphere, uniform_triangle};
use crate::sampling::{PdfArea, PdfSolidAngle, SphericalRectangle, SphericalTriangle};
use glam::Vec3 as V;
use rebond_lanes::{Index, Mask, Real, Record, math};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::ops::Range;

/// A time, and the rows of an affine matrix at it.
pub type Keyframe = (f32, [[f32; 4]; 3]);

/// The number of no emitter.
pub const NO_EMITTER: u32 = u32::MAX;

/// How points of triangles and parallelograms are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightSampling {
    /// Uniformly by area.
    #[default]
    Area,
    /// Uniformly by solid angle; by area from within about a thousandth of their size of their plane or of an edge.
    SolidAngle,
}

/// A light, as it goes into the table. Radiance leaves surfaces to the side of their normal.
#[derive(Clone, Copy, Debug)]
pub enum Emitter {
    /// The triangle p, p + e1, p + e2.
    Triangle {
        /// A corner, and the edges from it.
        p: [V; 3],
        /// Radiance.
        radiance: [f32; 3],
    },
    /// The parallelogram p, p + e1, p + e1 + e2, p + e2.
    Parallelogram {
        /// A corner, and the edges from it.
        p: [V; 3],
        /// Radiance.
        radiance: [f32; 3],
    },
    /// A sphere.
    Sphere {
        /// Centre.
        center: V,
        /// Radius.
        radius: f32,
        /// Whether its normal, and so its light, points inwards.
        inwards: bool,
        /// Radiance.
        radiance: [f32; 3],
    },
    /// A disk.
    Disk {
        /// Centre.
        center: V,
        /// Unit normal.
        normal: V,
        /// Radius.
        radius: f32,
        /// Radiance.
        radiance: [f32; 3],
    },
    /// A point.
    Point {
        /// Where.
        position: V,
        /// Intensity.
        intensity: [f32; 3],
    },
    /// A point that shines into a cone.
    Spot {
        /// Where.
        position: V,
        /// Unit axis.
        axis: V,
        /// Half-angles of full and of no light, radians.
        angles: [f32; 2],
        /// Intensity on the axis.
        intensity: [f32; 3],
    },
    /// A point that shines through the image of this number in [`Emitters::projecting`].
    Projector {
        /// Which.
        number: u32,
        /// Where.
        position: V,
        /// Unit axis and half-angle of a cone that holds all of its light.
        cone: (V, f32),
        /// Power.
        power: [f32; 3],
    },
    /// Parallel light.
    Directional {
        /// Unit direction it goes.
        direction: V,
        /// Irradiance.
        irradiance: [f32; 3],
    },
    /// Parallel light from a surface, to the side and along its normal; as such it is met by no ray.
    DirectionalArea {
        /// A corner of a parallelogram and the edges from it, or the centre and half axes of an ellipse.
        p: [V; 3],
        /// Whether it is the ellipse.
        round: bool,
        /// Irradiance.
        irradiance: [f32; 3],
    },
    /// The surroundings, of this number in [`Emitters::environments`].
    Environment {
        /// Which.
        number: u32,
        /// Their mean radiance.
        mean: [f32; 3],
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
enum Kind {
    Triangle,
    Parallelogram,
    Sphere,
    Disk,
    Point,
    Spot,
    Projector,
    Directional,
    DirectionalArea,
    Environment,
}

const KINDS: [Kind; 10] = [
    Kind::Triangle,
    Kind::Parallelogram,
    Kind::Sphere,
    Kind::Disk,
    Kind::Point,
    Kind::Spot,
    Kind::Projector,
    Kind::Directional,
    Kind::DirectionalArea,
    Kind::Environment,
];

/// Points and beams.
const UNHITTABLE: [Kind; 5] = [Kind::Point, Kind::Spot, Kind::Projector, Kind::Directional, Kind::DirectionalArea];

const RECORDS: u32 = 5;

/// Largest cosine that counts as a right angle. Corners are rounded; the point drawn is off by as little of an edge.
const RIGHT_ANGLE: f64 = 1e-5;

impl Emitter {
    /// Power in W (per colour channel), for the choice among emitters; `scene_radius` is what infinite ones shine on.
    pub fn power(&self, scene_radius: f32) -> [f64; 3] {
        use std::f64::consts::PI;
        let area = |a: V, b: V| area_vector(a, b).length();
        let squared = |x: f32| f64::from(x) * f64::from(x);
        let disk = PI * squared(scene_radius);
        let (c, factor) = match *self {
            Self::Triangle { p: [_, a, b], radiance } => (radiance, PI * 0.5 * area(a, b)),
            Self::Parallelogram { p: [_, a, b], radiance } => (radiance, PI * area(a, b)),
            Self::Sphere { radius, radiance, .. } => (radiance, PI * 4.0 * PI * squared(radius)),
            Self::Disk { radius, radiance, .. } => (radiance, PI * PI * squared(radius)),
            Self::Point { intensity, .. } => (intensity, 4.0 * PI),
            Self::Spot { angles, intensity, .. } => {
                let [inner, outer] = angles.map(f64::from);
                // A ramp in the angle, integrated over the sphere.
                let ramp = if outer > inner { (inner.sin() - outer.sin()) / (outer - inner) } else { -outer.cos() };
                (intensity, 2.0 * PI * (1.0 + ramp))
            }
            Self::Projector { power, .. } => (power, 1.0),
            Self::Directional { irradiance, .. } => (irradiance, disk),
            Self::DirectionalArea { p: [_, a, b], round, irradiance } => {
                (irradiance, if round { PI * area(a, b) } else { area(a, b) })
            }
            Self::Environment { mean, .. } => (mean, 4.0 * PI * disk),
        };
        c.map(|c| if c == 0.0 { 0.0 } else { f64::from(c) * factor })
    }

    /// Gives a triangle or a parallelogram another radiance.
    pub fn set_radiance(&mut self, to: [f32; 3]) {
        if let Self::Triangle { radiance, .. } | Self::Parallelogram { radiance, .. } = self {
            *radiance = to;
        }
    }

    /// A sphere, or a point, that holds the emitter at all times of its motion, of its power at the first: what a choice among
    /// emitters knows of one that moves.
    pub fn hull(&self, motion: &[Keyframe]) -> Self {
        let matrix = |rows: &[[f32; 4]; 3]| {
            let column = |c: usize| V::new(rows[0][c], rows[1][c], rows[2][c]);
            glam::Affine3A::from_cols(column(0).into(), column(1).into(), column(2).into(), column(3).into())
        };
        let (points, reach) = match *self {
            Self::Triangle { p: [p, a, b], .. } => (vec![p, p + a, p + b], 0.0),
            Self::Parallelogram { p: [p, a, b], .. } => (vec![p, p + a, p + b, p + a + b], 0.0),
            Self::Sphere { center, radius, .. } | Self::Disk { center, radius, .. } => (vec![center], radius),
            Self::Point { position, .. } | Self::Spot { position, .. } => (vec![position], 0.0),
            Self::Projector { .. }
            | Self::Directional { .. }
            | Self::DirectionalArea { .. }
            | Self::Environment { .. } => return *self,
        };
        let (mut lo, mut hi) = (V::INFINITY, V::NEG_INFINITY);
        for (_, rows) in motion {
            let m = matrix(rows);
            let longest = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(|c| c.length_squared());
            let reach = reach * longest.iter().sum::<f32>().sqrt();
            for p in &points {
                let p = m.transform_point3(*p);
                (lo, hi) = (lo.min(p - reach), hi.max(p + reach));
            }
        }
        let m = matrix(&motion[0].1);
        let scale = m.matrix3.determinant().abs().cbrt();
        let vector = |v: V| m.transform_vector3(v);
        let now = match *self {
            Self::Triangle { p: [p, a, b], radiance } => Self::Triangle { p: [p, vector(a), vector(b)], radiance },
            Self::Parallelogram { p: [p, a, b], radiance } => {
                Self::Parallelogram { p: [p, vector(a), vector(b)], radiance }
            }
            Self::Sphere { center, radius, inwards, radiance } => {
                Self::Sphere { center, radius: radius * scale, inwards, radiance }
            }
            Self::Disk { center, normal, radius, radiance } => {
                Self::Disk { center, normal, radius: radius * scale, radiance }
            }
            other => other,
        };
        let power = now.power(0.0);
        let (center, radius) = (lo.midpoint(hi), (hi - lo).length() / 2.0);
        let radiance = |p: f64| p / (4.0 * (std::f64::consts::PI * f64::from(radius)).powi(2));
        if power.iter().all(|p| radiance(*p) < f64::from(f32::MAX)) {
            return Self::Sphere { center, radius, inwards: false, radiance: power.map(|p| radiance(p) as f32) };
        }
        Self::Point { position: center, intensity: power.map(|p| (p / (4.0 * std::f64::consts::PI)) as f32) }
    }

    fn records(&self) -> [Record; RECORDS as usize] {
        let word = |c: [f32; 3], kind: Kind| Record::with_word(c[0], c[1], c[2], kind as u32);
        let with = |v: V, w: f32| Record([v.x, v.y, v.z, w]);
        let none = Record::default();
        match *self {
            Self::Triangle { p: [p, a, b], radiance } => {
                let n = area_vector(a, b);
                [
                    word(radiance, Kind::Triangle),
                    with(p, (2.0 / n.length()) as f32),
                    with(a, 0.0),
                    with(b, 0.0),
                    with(n.normalize().as_vec3(), 0.0),
                ]
            }
            Self::Parallelogram { p: [p, a, b], radiance } => {
                let n = area_vector(a, b);
                let (da, db) = (a.as_dvec3(), b.as_dvec3());
                let rectangle = da.dot(db).abs() < RIGHT_ANGLE * da.length() * db.length();
                [
                    word(radiance, Kind::Parallelogram),
                    with(p, (1.0 / n.length()) as f32),
                    with(a, if rectangle { 1.0 } else { 0.0 }),
                    with(b, 0.0),
                    with(n.normalize().as_vec3(), 0.0),
                ]
            }
            Self::Sphere { center, radius, inwards, radiance } => {
                let sign = if inwards { -1.0 } else { 1.0 };
                [
                    word(radiance, Kind::Sphere),
                    with(center, 1.0 / (4.0 * PI * radius * radius)),
                    Record([radius, sign, 0.0, 0.0]),
                    none,
                    none,
                ]
            }
            Self::Disk { center, normal, radius, radiance } => {
                let (a, b) = normal.any_orthonormal_pair();
                let density = 1.0 / (PI * radius * radius);
                [
                    word(radiance, Kind::Disk),
                    with(center, density),
                    with(a * radius, 0.0),
                    with(b * radius, 0.0),
                    with(normal, 0.0),
                ]
            }
            Self::Point { position, intensity } => {
                [word(intensity, Kind::Point), with(position, 0.0), none, none, none]
            }
            Self::Spot { position, axis, angles, intensity } => {
                let ramp = 1.0 / (angles[1] - angles[0]).max(1e-6);
                [
                    word(intensity, Kind::Spot),
                    with(position, 0.0),
                    Record([angles[1], ramp, 0.0, 0.0]),
                    none,
                    with(axis, 0.0),
                ]
            }
            Self::Projector { position, .. } => {
                [word([0.0; 3], Kind::Projector), with(position, 0.0), none, none, none]
            }
            Self::Directional { direction, irradiance } => {
                [word(irradiance, Kind::Directional), with(-direction, 0.0), none, none, none]
            }
            Self::DirectionalArea { p: [p, a, b], round, irradiance } => {
                let n = area_vector(a, b);
                let area = n.length() * if round { std::f64::consts::PI } else { 1.0 };
                [
                    word(irradiance, Kind::DirectionalArea),
                    with(p, (1.0 / area) as f32),
                    with(a, 0.0),
                    with(b, 0.0),
                    with(n.normalize().as_vec3(), if round { 1.0 } else { 0.0 }),
                ]
            }
            Self::Environment { number, mean } => {
                [word(mean, Kind::Environment), Record::words([number, 0, 0, 0]), none, none, none]
            }
        }
    }
}

/// All emitters of a scene.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    table: Vec<Record>,
    /// Bit k: some emitter is of kind k.
    present: u32,
    /// How some of them move. The last number of an emitter's record 3 is that of its motion + 1 (word), 0 if it rests.
    motions: Option<Keyframes>,
    /// Some spheres are drawn from by a cap of theirs: axis and 1 − cosine of its half-angle in record 4, 0 if by none.
    capped: bool,
    /// The surroundings, each with its emitter's number.
    pub environments: Vec<(u32, Environment)>,
    /// The images that points shine through, each with its emitter's number.
    projectors: Vec<(u32, IntensityImage)>,
    /// Centre and radius of what infinite emitters shine on.
    sphere: ([f32; 3], f32),
    /// Images of those that show some.
    glow: Option<Box<Glow>>,
}

/// Light from one emitter at a point.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSample<F: Real> {
    /// Unit direction to it.
    pub wi: Vec3<F>,
    /// The point on it; unused where `infinite`.
    pub point: Vec3<F>,
    /// Bound of the error of `point`, per axis.
    pub error: F,
    /// Geometric normal at `point`.
    pub normal: Vec3<F>,
    /// Radiance along −wi, over the density: `Le / pdf`, or for points and beams their irradiance on a surface that
    /// faces them. Black where there is none.
    pub weight: Rgb<F>,
    /// Density of wi, of this emitter alone; 0 where only this sampler finds it.
    pub pdf: PdfSolidAngle<F>,
    /// Whether it is infinitely far.
    pub infinite: F::Mask,
}

impl<F: Real> EmitterSample<F> {
    pub(crate) fn none() -> Self {
        Self {
            wi: Vec3::splat([0.0, 0.0, 1.0]),
            point: Vec3::zero(),
            error: F::zero(),
            normal: Vec3::zero(),
            weight: Rgb::black(),
            pdf: PdfSolidAngle(F::zero()),
            infinite: F::Mask::splat(false),
        }
    }

    /// The sample of an emitter that was asked with this probability, weighed for all.
    #[inline(always)]
    pub fn chosen_with(mut self, probability: F) -> Self {
        self.weight = self.weight * probability.recip();
        self.pdf.0 *= probability;
        self
    }

    #[inline(always)]
    pub(crate) fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Self {
            wi: Vec3::select(mask, a.wi, b.wi),
            point: Vec3::select(mask, a.point, b.point),
            error: F::select(mask, a.error, b.error),
            normal: Vec3::select(mask, a.normal, b.normal),
            weight: Rgb::select(mask, a.weight, b.weight),
            pdf: PdfSolidAngle(F::select(mask, a.pdf.0, b.pdf.0)),
            infinite: (mask & a.infinite) | b.infinite.and_not(mask),
        }
    }
}

/// A surface point that a path hit, as far as its emitter must know it.
#[derive(Clone, Copy, Debug)]
pub struct EmitterHit<F: Real> {
    /// Number of the emitter.
    pub emitter: F::Index,
    /// The receiving point.
    pub from: Vec3<F>,
    /// From the receiving point to the hit.
    pub to: Vec3<F>,
    /// Geometric normal at the hit.
    pub normal: Vec3<F>,
    /// When it was hit.
    pub time: F,
}

/// A flat emitter at some time: the point `p0 + b1 e1 + b2 e2`.
struct Flat<F: Real> {
    p0: Vec3<F>,
    edges: [Vec3<F>; 2],
    normal: Vec3<F>,
    density: F,
    /// Whether its edges are known to be at right angles.
    rectangle: F::Mask,
}

/// Error bound of a point with coordinates of this size.
pub(crate) const POINT_ERROR: f32 = 16.0 * f32::EPSILON / 2.0;

/// The point of a sphere where its normal is about `n`, that normal, and the point's error bound. With the length of the normal
/// put right and one rounding of the sum, a large sphere's point is as good as its own coordinates: what is off by more
/// would shine from behind a wall that the sphere is sunk into.
#[inline(always)]
fn point_of_sphere<F: Real>(center: Vec3<F>, radius: F, n: Vec3<F>) -> (Vec3<F>, Vec3<F>, F) {
    let n = n * (n.length_squared().mul_add(F::splat(-0.5), F::splat(1.5)));
    let p = n.mul_add(radius, center);
    (p, n, p.max_abs() * POINT_ERROR + radius * (2.0 * f32::EPSILON))
}

impl Emitters {
    /// A table of these emitters and surroundings.
    pub fn new(emitters: &[Emitter], environments: Vec<Environment>) -> Self {
        let table: Vec<Record> = emitters.iter().flat_map(Emitter::records).collect();
        let kind = |i: usize| table[i * RECORDS as usize].0[3].to_bits();
        let present = (0..emitters.len()).fold(0, |bits, i| bits | 1 << kind(i));
        let numbers = (0..emitters.len()).filter(|i| kind(*i) == Kind::Environment as u32).map(|i| i as u32);
        let environments = numbers.zip(environments).collect();
        let (sphere, projectors) = (([0.0; 3], 1.0), Vec::new());
        Self { table, present, motions: None, capped: false, environments, projectors, sphere, glow: None }
    }

    /// The same emitters, with the images of those that are projectors.
    pub fn projecting(mut self, emitters: &[Emitter], images: Vec<IntensityImage>) -> Self {
        let numbers = emitters.iter().zip(0..).filter(|(e, _)| matches!(e, Emitter::Projector { .. })).map(|(_, i)| i);
        self.projectors = numbers.zip(images).collect();
        self
    }

    /// The same emitters, some of which show images. Before they move.
    pub fn glowing(self, glow: Glow) -> Self {
        Self { glow: Some(Box::new(glow)), ..self }
    }

    /// The same emitters, some of which move: `motions` has ranges of their numbers, as they are before any motion. Flat ones
    /// may be sheared, spheres stay spheres; points and spots move too.
    pub fn moving(mut self, motions: &[(Range<u32>, Vec<Keyframe>)]) -> Self {
        if motions.is_empty() {
            return self;
        }
        for (number, (emitters, keyframes)) in motions.iter().enumerate() {
            let [x, y, z] = keyframes[0].1.map(|row| V::from_slice(&row[..3]));
            let mirrors = x.dot(y.cross(z)) < 0.0;
            for emitter in emitters.clone() {
                let first = (emitter * RECORDS) as usize;
                let kind = KINDS[self.table[first].0[3].to_bits() as usize];
                if mirrors && matches!(kind, Kind::Triangle | Kind::Parallelogram | Kind::Disk) {
                    // The normal of the edges stays on the side that it is on.
                    self.table.swap(first + 2, first + 3);
                    if let Some(glow) = &mut self.glow {
                        glow.swap_edges(emitter);
                    }
                }
                self.table[first + 3].0[3] = f32::from_bits(number as u32 + 1);
            }
        }
        self.motions = Some(Keyframes::new(motions.iter().map(|(_, keyframes)| &keyframes[..])));
        self
    }

    /// Whether some move.
    pub fn has_moving(&self) -> bool {
        self.motions.is_some()
    }

    /// Whether some are spheres.
    pub(crate) fn has_spheres(&self) -> bool {
        self.present >> Kind::Sphere as u32 & 1 != 0
    }

    /// Whether this is a sphere that rests and shines outwards.
    pub(crate) fn is_sphere(&self, emitter: u32) -> bool {
        let at = |n: u32, i: usize| self.table[(emitter * RECORDS + n) as usize].0[i];
        emitter != NO_EMITTER && at(0, 3).to_bits() == Kind::Sphere as u32 && at(2, 1) > 0.0 && at(3, 3).to_bits() == 0
    }

    /// Says that little of a sphere that rests is ever met but a cap of it, around the unit vector `axis`, of this 1 − cosine of
    /// its half-angle. From outside, most samples then are points of the cap, uniformly by area, and the others directions of
    /// the sphere's cone; their density is the mixture's. Most of the light that leaves it starts from there too.
    pub fn set_cap(&mut self, emitter: u32, axis: Vec3<f32>, one_minus_cos: f32) {
        debug_assert!(self.is_sphere(emitter));
        let [x, y, z] = axis.array();
        self.table[(emitter * RECORDS + 4) as usize] = Record([x, y, z, one_minus_cos]);
        self.capped = true;
    }

    /// Bytes that their images hold.
    pub(crate) fn image_bytes(&self) -> usize {
        let projectors = self.projectors.iter().map(|(_, image)| image.bytes()).sum::<usize>();
        self.glow.as_ref().map_or(0, |glow| glow.bytes()) + projectors
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.table.len() / RECORDS as usize
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    #[inline(always)]
    fn record<F: Real>(&self, emitter: F::Index, number: u32) -> [F; 4] {
        // All lanes of a scene with one emitter read the same.
        if self.table.len() == RECORDS as usize {
            let Record([a, b, c, d]) = self.table[number as usize];
            return [F::splat(a), F::splat(b), F::splat(c), F::splat(d)];
        }
        F::record(&self.table, emitter * F::Index::splat(RECORDS) + F::Index::splat(number))
    }

    /// Whether some are points or beams, which no ray meets.
    pub fn has_unhittable(&self) -> bool {
        UNHITTABLE.iter().any(|k| self.present >> *k as u32 & 1 == 1)
    }

    /// The area of an emitter; none if it is no surface.
    pub fn area(&self, emitter: u32) -> Option<f32> {
        let at = |n: u32| self.table[(emitter * RECORDS + n) as usize].0[3];
        let kind = KINDS[at(0).to_bits() as usize];
        matches!(kind, Kind::Triangle | Kind::Parallelogram | Kind::Sphere | Kind::Disk).then(|| at(1).recip())
    }

    /// Radiance that a surface emitter sends to the side of its normal from its point `p`.
    #[inline(always)]
    pub fn radiance_at<F: Real>(&self, emitter: F::Index, p: Vec3<F>, time: F, mask: F::Mask) -> Rgb<F> {
        let radiance = Rgb::of_record(self.record(emitter, 0));
        match &self.glow {
            None => radiance,
            Some(glow) => radiance * glow.at(emitter, &self.flat(emitter, time), p, mask),
        }
    }

    /// The mean of that over the emitter.
    pub fn mean_radiance(&self, emitter: u32) -> [f32; 3] {
        let means = self.glow.as_ref().map_or(&[][..], |glow| glow.means());
        match means.binary_search_by_key(&emitter, |(e, _)| *e) {
            Ok(i) => means[i].1,
            Err(_) => {
                let Record([r, g, b, _]) = self.table[(emitter * RECORDS) as usize];
                [r, g, b]
            }
        }
    }

    /// The matrices of lanes whose emitter moves, and which they are.
    #[inline(always)]
    fn motion<F: Real>(&self, emitter: F::Index, time: F) -> Option<(Matrix<F>, F::Mask)> {
        let motions = self.motions.as_ref()?;
        let number = self.record::<F>(emitter, 3)[3].to_bits();
        let moves = number.ne(F::Index::splat(0));
        let number = F::Index::select(moves, number - F::Index::splat(1), F::Index::splat(0));
        Some((motions.at(number, time, moves), moves))
    }

    #[inline(always)]
    fn flat<F: Real>(&self, emitter: F::Index, time: F) -> Flat<F> {
        let [x, y, z, density] = self.record::<F>(emitter, 1);
        let [x1, y1, z1, rectangle] = self.record::<F>(emitter, 2);
        let (p0, normal) = (crate::math::vec3(x, y, z), Vec3::of_record(self.record(emitter, 4)));
        let edges = [crate::math::vec3(x1, y1, z1), Vec3::of_record(self.record(emitter, 3))];
        let rest = Flat { p0, edges, normal, density, rectangle: rectangle.gt(F::zero()) };
        match self.motion(emitter, time) {
            None => rest,
            Some((m, moves)) => rest.moved(&m, moves),
        }
    }

    /// Centre, radius, side of the normal and density of a sphere.
    #[inline(always)]
    fn ball<F: Real>(&self, emitter: F::Index, time: F) -> (Vec3<F>, F, F, F) {
        let [x, y, z, density] = self.record::<F>(emitter, 1);
        let [radius, sign, ..] = self.record::<F>(emitter, 2);
        let center = crate::math::vec3(x, y, z);
        let Some((m, moves)) = self.motion(emitter, time) else { return (center, radius, sign, density) };
        let scale = F::select(moves, m.vector(Vec3::splat([1.0, 0.0, 0.0])).length(), F::one());
        (Vec3::select(moves, m.point(center), center), radius * scale, sign, density / (scale * scale))
    }

    /// The cap by which a sphere of this radius is drawn from in some of the lanes that are well outside it.
    #[inline(always)]
    fn cap<F: Real>(&self, emitter: F::Index, radius: F, outside: F::Mask) -> Cap<F> {
        if !self.capped {
            let (axis, nothing) = (Vec3::splat([0.0, 0.0, 1.0]), F::zero());
            return Cap { axis, one_minus_cos: nothing, radius, used: F::Mask::splat(false) };
        }
        let [x, y, z, one_minus_cos] = self.record::<F>(emitter, 4);
        let used = outside & one_minus_cos.gt(F::zero());
        Cap { axis: crate::math::vec3(x, y, z), one_minus_cos, radius, used }
    }

    /// Where a point or a spot is.
    #[inline(always)]
    fn place<F: Real>(&self, emitter: F::Index, time: F) -> Vec3<F> {
        let point = Vec3::of_record(self.record(emitter, 1));
        self.motion(emitter, time).map_or(point, |(m, moves)| Vec3::select(moves, m.point(point), point))
    }

    /// Where a spot points.
    #[inline(always)]
    fn axis<F: Real>(&self, emitter: F::Index, time: F) -> Vec3<F> {
        let axis = Vec3::of_record(self.record(emitter, 4));
        self.motion(emitter, time).map_or(axis, |(m, moves)| Vec3::select(moves, m.vector(axis).normalized(), axis))
    }

    /// Light of the given emitters at the point `p` at a time, from u in [0, 1)².
    #[inline(always)]
    pub fn sample<F: Real>(
        &self,
        emitter: F::Index,
        p: Vec3<F>,
        time: F,
        sampling: LightSampling,
        u: [F; 2],
        mask: F::Mask,
    ) -> EmitterSample<F> {
        let [r, g, b, kind] = self.record::<F>(emitter, 0);
        let (value, kind) = (Rgb::new(r, g, b), kind.to_bits());
        let single = self.present.is_power_of_two();
        let mut sample = EmitterSample::none();
        for k in KINDS {
            if self.present >> k as u32 & 1 == 0 {
                continue;
            }
            let lanes = if single { mask } else { mask & kind.eq(F::Index::splat(k as u32)) };
            if lanes.none() {
                continue;
            }
            let s = match k {
                Kind::Triangle | Kind::Parallelogram => {
                    let parallelogram = k == Kind::Parallelogram;
                    let by_area = if parallelogram { u } else { uniform_triangle(u) };
                    match sampling {
                        LightSampling::Area => Self::sample_flat(&self.flat(emitter, time), p, value, by_area),
                        LightSampling::SolidAngle => {
                            self.sample_polygon(&self.flat(emitter, time), p, value, parallelogram, [u, by_area], lanes)
                        }
                    }
                }
                Kind::Disk => Self::sample_flat(&self.flat(emitter, time), p, value, uniform_disk(u)),
                Kind::Sphere => self.sample_sphere(emitter, p, time, value, u),
                Kind::Point => self.sample_point(emitter, p, time, value),
                Kind::Spot => self.sample_spot(emitter, p, time, value),
                Kind::Projector => self.sample_projector(emitter, p, time, lanes),
                Kind::Directional => EmitterSample {
                    wi: Vec3::of_record(self.record(emitter, 1)),
                    weight: value,
                    infinite: F::Mask::splat(true),
                    ..EmitterSample::none()
                },
                Kind::DirectionalArea => self.sample_directional_area(emitter, p, time, value),
                Kind::Environment => self.sample_environment(emitter, u, lanes),
            };
            sample = if single { s } else { EmitterSample::select(lanes, s, sample) };
        }
        if let Some(glow) = &self.glow {
            sample.weight *= glow.at(emitter, &self.flat(emitter, time), sample.point, mask);
        }
        sample.weight = sample.weight.masked(mask);
        sample
    }

    /// A point of a flat surface: `p0 + b1 e1 + b2 e2`.
    #[inline(always)]
    fn sample_flat<F: Real>(flat: &Flat<F>, p: Vec3<F>, radiance: Rgb<F>, b: [F; 2]) -> EmitterSample<F> {
        let (p0, [e1, e2]) = (flat.p0, flat.edges);
        let point = e1.mul_add(b[0], e2.mul_add(b[1], p0));
        Self::from_surface_point(p, point, flat.normal, flat.error(), radiance, PdfArea(flat.density))
    }

    /// A point of a triangle or a parallelogram, uniform by solid angle where that can be computed.
    #[inline(always)]
    fn sample_polygon<F: Real>(
        &self,
        flat: &Flat<F>,
        p: Vec3<F>,
        radiance: Rgb<F>,
        parallelogram: bool,
        [u, by_area]: [[F; 2]; 2],
        mask: F::Mask,
    ) -> EmitterSample<F> {
        let seen = flat.seen_polygon(p, parallelogram);
        let b = seen.sample(u, mask);
        let b = [0, 1].map(|i| F::select(seen.sound, b[i], by_area[i]));
        let mut sample = Self::sample_flat(flat, p, radiance, b);
        let lit = seen.sound & (sample.point - p).dot(sample.normal).lt(F::zero());
        sample.weight = Rgb::select(seen.sound, (radiance * seen.solid_angle).masked(lit), sample.weight);
        sample.pdf.0 = F::select(seen.sound, seen.solid_angle.recip(), sample.pdf.0);
        sample
    }

    #[inline(always)]
    fn from_surface_point<F: Real>(
        p: Vec3<F>,
        point: Vec3<F>,
        normal: Vec3<F>,
        error: F,
        radiance: Rgb<F>,
        density: PdfArea<F>,
    ) -> EmitterSample<F> {
        let to = point - p;
        let pdf = density.to_solid_angle(to, normal);
        let lit = to.dot(normal).lt(F::zero()) & pdf.0.gt(F::zero()) & pdf.0.is_finite();
        EmitterSample {
            wi: to.normalized(),
            point,
            error,
            normal,
            weight: (radiance * pdf.0.recip()).masked(lit),
            pdf,
            infinite: F::Mask::splat(false),
        }
    }

    /// A sphere seen from outside: a direction of the cone that it fills; from inside: a point of it.
    #[inline(always)]
    fn sample_sphere<F: Real>(
        &self,
        emitter: F::Index,
        p: Vec3<F>,
        time: F,
        radiance: Rgb<F>,
        u: [F; 2],
    ) -> EmitterSample<F> {
        let (center, radius, sign, density) = self.ball(emitter, time);
        let to_center = center - p;
        let cone = SphereCone::new(to_center, radius);

        let cap = self.cap(emitter, radius, cone.well_outside(radius));
        let (by_cap, u) = cap.way(u);

        let w = uniform_cone(u, cone.one_minus_cos);
        let wi = Frame::around(to_center * cone.distance.recip()).to_world(w);
        // The near root by the product of the two: without cancellation, also close to a large sphere.
        let product = (cone.distance - radius) * (cone.distance + radius);
        let middle = cone.distance * w.z;
        let reach = product / (middle + (middle * middle - product).safe_sqrt());
        let (point, n, error) = point_of_sphere(center, radius, (wi * reach - to_center).normalized());
        let pdf = uniform_cone_pdf(cone.one_minus_cos);
        let mut outside = EmitterSample {
            wi,
            point,
            error,
            normal: n * sign,
            weight: (radiance * pdf.0.recip()).masked(sign.gt(F::zero())),
            pdf,
            infinite: F::Mask::splat(false),
        };
        if cap.used.any() {
            let (point, n, error) = point_of_sphere(center, radius, cap.normal(u));
            let from_cap = Self::from_surface_point(p, point, n, error, radiance, cap.density());
            outside = EmitterSample::select(by_cap, from_cap, outside);
            let lit = outside.weight.is_lit();
            let both = cap.mixture(pdf, outside.point - p, outside.normal);
            outside.pdf = both;
            outside.weight = (radiance * both.0.recip()).masked(lit);
        }
        if cone.outside.all() {
            return outside;
        }
        let (point, n, error) = point_of_sphere(center, radius, uniform_sphere(u));
        let inside = Self::from_surface_point(p, point, n * sign, error, radiance, PdfArea(density));
        EmitterSample::select(cone.outside, outside, inside)
    }

    #[inline(always)]
    fn sample_point<F: Real>(&self, emitter: F::Index, p: Vec3<F>, time: F, intensity: Rgb<F>) -> EmitterSample<F> {
        let point = self.place(emitter, time);
        let to = point - p;
        let d2 = to.length_squared();
        let apart = d2.gt(F::zero());
        EmitterSample {
            wi: to.normalized(),
            point,
            weight: (intensity * d2.recip()).masked(apart),
            ..EmitterSample::none()
        }
    }

    #[inline(always)]
    fn sample_spot<F: Real>(&self, emitter: F::Index, p: Vec3<F>, time: F, intensity: Rgb<F>) -> EmitterSample<F> {
        let mut sample = self.sample_point(emitter, p, time, intensity);
        let [cutoff, ramp, ..] = self.record::<F>(emitter, 2);
        let angle = math::acos(-sample.wi.dot(self.axis(emitter, time)));
        sample.weight = sample.weight * ((cutoff - angle) * ramp).clamp(0.0, 1.0);
        sample
    }

    #[inline(never)]
    fn sample_projector<F: Real>(&self, emitter: F::Index, p: Vec3<F>, time: F, mask: F::Mask) -> EmitterSample<F> {
        let mut sample = self.sample_point(emitter, p, time, Rgb::white());
        let mut intensity = Rgb::black();
        for (number, image) in &self.projectors {
            let lanes = mask & emitter.eq(F::Index::splat(*number));
            if lanes.any() {
                intensity = Rgb::select(lanes, image.eval(-sample.wi).0, intensity);
            }
        }
        sample.weight *= intensity;
        sample
    }

    /// A point is in the light of the one point that it lies before.
    #[inline(never)]
    fn sample_directional_area<F: Real>(
        &self,
        emitter: F::Index,
        p: Vec3<F>,
        time: F,
        irradiance: Rgb<F>,
    ) -> EmitterSample<F> {
        let (flat, round) = self.flat_beam(emitter, time);
        let (n, [e1, e2], from) = (flat.normal, flat.edges, p - flat.p0);
        let per_area = flat.density * F::select(round, F::splat(PI), F::one());
        let (x, y) = (from.cross(e2).dot(n) * per_area, e1.cross(from).dot(n) * per_area);
        let within = |x: F| x.ge(F::zero()) & x.le(F::one());
        let (circle, square) = ((x * x + y * y).le(F::one()), within(x) & within(y));
        let inside = (round & circle) | square.and_not(round);
        EmitterSample {
            wi: -n,
            point: e1.mul_add(x, e2.mul_add(y, flat.p0)),
            error: flat.error(),
            normal: n,
            weight: irradiance.masked(inside & from.dot(n).gt(F::zero())),
            ..EmitterSample::none()
        }
    }

    /// The surface of a beam, and whether it is round.
    #[inline(always)]
    fn flat_beam<F: Real>(&self, emitter: F::Index, time: F) -> (Flat<F>, F::Mask) {
        (self.flat(emitter, time), self.record::<F>(emitter, 4)[3].gt(F::zero()))
    }

    #[inline(always)]
    fn sample_environment<F: Real>(&self, emitter: F::Index, u: [F; 2], mask: F::Mask) -> EmitterSample<F> {
        let mut sample = EmitterSample::none();
        for (number, environment) in &self.environments {
            let lanes = mask & emitter.eq(F::Index::splat(*number));
            if lanes.none() {
                continue;
            }
            let (wi, pdf, radiance) = environment.sample(u);
            let weight = (radiance * pdf.0.recip()).masked(pdf.0.gt(F::zero()));
            let s = EmitterSample { wi, weight, pdf, infinite: F::Mask::splat(true), ..EmitterSample::none() };
            sample = if self.environments.len() == 1 { s } else { EmitterSample::select(lanes, s, sample) };
        }
        sample
    }

    /// The density with which [`Emitters::sample`] would have found a surface point that a path hit.
    #[inline(always)]
    pub fn pdf<F: Real>(&self, hit: &EmitterHit<F>, sampling: LightSampling, mask: F::Mask) -> PdfSolidAngle<F> {
        let kind = self.record::<F>(hit.emitter, 0)[3].to_bits();
        let mut density = self.record::<F>(hit.emitter, 1)[3];
        if self.motions.is_some() {
            // Where it is a sphere, that is set below.
            density = self.flat(hit.emitter, hit.time).density;
        }
        let mut by_area = PdfArea(density).to_solid_angle(hit.to, hit.normal);
        if sampling == LightSampling::SolidAngle {
            for k in [Kind::Triangle, Kind::Parallelogram] {
                if self.present >> k as u32 & 1 == 0 {
                    continue;
                }
                let lanes = mask & kind.eq(F::Index::splat(k as u32));
                if lanes.any() {
                    let seen = self.flat(hit.emitter, hit.time).seen_polygon(hit.from, k == Kind::Parallelogram);
                    by_area.0 = F::select(lanes & seen.sound, seen.solid_angle.recip(), by_area.0);
                }
            }
        }
        if self.present >> Kind::Sphere as u32 & 1 == 0 {
            return by_area;
        }
        let sphere = mask & kind.eq(F::Index::splat(Kind::Sphere as u32));
        if sphere.none() {
            return by_area;
        }
        let (_, radius, sign, density) = self.ball(hit.emitter, hit.time);
        if self.motions.is_some() {
            by_area.0 = F::select(sphere, PdfArea(density).to_solid_angle(hit.to, hit.normal).0, by_area.0);
        }
        // The centre as seen from the receiving point: by the normal at the hit.
        let to_center = hit.to - hit.normal * (radius * sign);
        let cone = SphereCone::new(to_center, radius);
        let mut by_cone = uniform_cone_pdf(cone.one_minus_cos);
        let cap = self.cap(hit.emitter, radius, sphere & cone.well_outside(radius));
        if cap.used.any() {
            by_cone = cap.mixture(by_cone, hit.to, hit.normal);
        }
        PdfSolidAngle(F::select(sphere & cone.outside, by_cone.0, by_area.0))
    }
}

impl<F: Real> Flat<F> {
    /// Bound of the error of its points, per axis.
    #[inline(always)]
    fn error(&self) -> F {
        (self.p0.max_abs() + self.edges[0].max_abs() + self.edges[1].max_abs()) * POINT_ERROR
    }

    /// The same emitter as its motion takes it along in some lanes. The area grows as the product of the edges does.
    #[inline(always)]
    fn moved(&self, m: &Matrix<F>, moves: F::Mask) -> Self {
        let edges = self.edges.map(|e| m.vector(e));
        // Squares of squares of large or small lengths would be beyond f32.
        let unit = self.edges[0].max_abs().max(self.edges[1].max_abs()).recip();
        let cross = |[a, b]: [Vec3<F>; 2]| (a * unit).cross(b * unit);
        let (before, now) = (cross(self.edges), cross(edges));
        let length = now.length();
        Self {
            p0: Vec3::select(moves, m.point(self.p0), self.p0),
            edges: [0, 1].map(|i| Vec3::select(moves, edges[i], self.edges[i])),
            normal: Vec3::select(moves, now * length.recip(), self.normal),
            density: F::select(moves, self.density * before.length() / length, self.density),
            rectangle: self.rectangle.and_not(moves),
        }
    }

    /// A triangle or a parallelogram as seen from `p`, in units of the farthest of what matters.
    #[inline(always)]
    fn seen_polygon(&self, p: Vec3<F>, parallelogram: bool) -> SeenPolygon<F> {
        let (apex, [e1, e2]) = (self.p0 - p, self.edges);
        let scale = apex.max_abs().max(e1.max_abs()).max(e2.max_abs()).recip();
        let (apex, e1, e2) = (apex * scale, e1 * scale, e2 * scale);
        // Twice the area of each triangle, from f64; squared last, since lengths squared may be beyond f32.
        let side = self.density.recip().sqrt() * scale;
        let twice = side * side * if parallelogram { 1.0 } else { 2.0 };
        let height = apex.dot(self.normal).abs();
        let mut seen = SeenPolygon::new(apex, [e1, e2], height * twice, parallelogram);
        if parallelogram {
            let (w, h) = (e1.length(), e2.length());
            let corner = [apex.dot(e1) / w, apex.dot(e2) / h, height];
            seen.rectangle = SphericalRectangle::new(corner, [w, h], seen.solid_angle);
            seen.is_rectangle = seen.sound & self.rectangle & seen.rectangle.is_sound();
        }
        seen
    }
}

/// A triangle; or a parallelogram as a fan of two triangles, which the square is mapped to continuously, or, in the lanes
/// of `is_rectangle`, as a rectangle. All densities are 1/Ω.
struct SeenPolygon<F: Real> {
    fan: [SphericalTriangle<F>; 2],
    solid_angle: F,
    sound: F::Mask,
    parallelogram: bool,
    rectangle: SphericalRectangle<F>,
    is_rectangle: F::Mask,
}

impl<F: Real> SeenPolygon<F> {
    #[inline(always)]
    fn new(apex: Vec3<F>, edges: [Vec3<F>; 2], volume: F, parallelogram: bool) -> Self {
        if !parallelogram {
            let whole = SphericalTriangle::new(apex, edges, volume);
            return Self::of_fan([whole; 2], whole.solid_angle(), whole.is_sound(), parallelogram);
        }
        let diagonal = edges[0] + edges[1];
        let fan = [[edges[0], diagonal], [diagonal, edges[1]]].map(|e| SphericalTriangle::new(apex, e, volume));
        let solid_angle = fan[0].solid_angle() + fan[1].solid_angle();
        Self::of_fan(fan, solid_angle, fan[0].is_sound() & fan[1].is_sound(), parallelogram)
    }

    #[inline(always)]
    fn of_fan(fan: [SphericalTriangle<F>; 2], solid_angle: F, sound: F::Mask, parallelogram: bool) -> Self {
        let rectangle = SphericalRectangle::new([F::one(); 3], [F::one(); 2], solid_angle);
        Self { fan, solid_angle, sound, parallelogram, rectangle, is_rectangle: F::Mask::splat(false) }
    }

    /// Coordinates along the edges.
    #[inline(always)]
    fn sample(&self, u: [F; 2], mask: F::Mask) -> [F; 2] {
        if !self.parallelogram {
            let [s, t] = self.fan[0].sample(u);
            return [(F::one() - s) * t, s * t];
        }
        let across = if self.is_rectangle.any() { self.rectangle.sample(u) } else { u };
        if (mask & self.sound).and_not(self.is_rectangle).none() {
            return across;
        }
        let area = u[0] * self.solid_angle;
        let [first, second] = self.fan.map(|t| t.solid_angle());
        let in_second = area.ge(first);
        let rest = F::select(in_second, (area - first) / second, area / first).min(F::one());
        let [s, t] = SphericalTriangle::select(in_second, self.fan[1], self.fan[0]).sample([rest, u[1]]);
        let fan = [F::select(in_second, t * (F::one() - s), t), F::select(in_second, t, s * t)];
        [0, 1].map(|i| F::select(self.is_rectangle, across[i], fan[i]))
    }
}

/// The share of samples that are drawn from a cap.
const CAP_SHARE: f32 = 0.75;

/// The part of a sphere that most samples are drawn from.
struct Cap<F: Real> {
    axis: Vec3<F>,
    one_minus_cos: F,
    radius: F,
    /// Lanes in which there is one.
    used: F::Mask,
}

impl<F: Real> Cap<F> {
    fn density(&self) -> PdfArea<F> {
        PdfArea((self.radius * self.radius * self.one_minus_cos * (2.0 * PI)).recip())
    }

    /// Which of the two ways to draw a point, and what is left of the numbers for that.
    #[inline(always)]
    fn way(&self, u: [F; 2]) -> (F::Mask, [F; 2]) {
        let by_cap = self.used & u[0].lt(F::splat(CAP_SHARE));
        let rest = F::select(by_cap, u[0] * CAP_SHARE.recip(), (u[0] - CAP_SHARE) * (1.0 - CAP_SHARE).recip());
        (by_cap, [F::select(self.used, rest.min(F::splat(1.0 - f32::EPSILON / 2.0)), u[0]), u[1]])
    }

    /// The normal at a point of the cap.
    #[inline(always)]
    fn normal(&self, u: [F; 2]) -> Vec3<F> {
        Frame::around(self.axis).to_world(uniform_cone(u, self.one_minus_cos))
    }

    /// The density of both ways at the normal `n`, given that of either.
    #[inline(always)]
    fn mixed(&self, by_cap: F, other: F, n: Vec3<F>) -> F {
        // |n − a|² = 2 (1 − cos), without cancellation.
        let inside = ((n - self.axis).length_squared() * 0.5).le(self.one_minus_cos);
        let both = F::select(inside, by_cap, F::zero()) * CAP_SHARE + other * (1.0 - CAP_SHARE);
        F::select(self.used, both, other)
    }

    /// The same of a point that is seen along `to`.
    #[inline(always)]
    fn mixture(&self, other: PdfSolidAngle<F>, to: Vec3<F>, n: Vec3<F>) -> PdfSolidAngle<F> {
        PdfSolidAngle(self.mixed(self.density().to_solid_angle(to, n).0, other.0, n))
    }
}

/// The cone that a sphere fills as seen from a point.
struct SphereCone<F: Real> {
    distance: F,
    outside: F::Mask,
    one_minus_cos: F,
}

impl<F: Real> SphereCone<F> {
    /// Lanes far enough from the sphere to tell the distance to a point of it.
    #[inline(always)]
    fn well_outside(&self, radius: F) -> F::Mask {
        self.outside & (self.distance - radius).gt(radius * 1e-4)
    }

    #[inline(always)]
    fn new(to_center: Vec3<F>, radius: F) -> Self {
        let d2 = to_center.length_squared();
        let sin2 = radius * radius / d2;
        let outside = sin2.lt(F::splat(0.999_99));
        // 1 − cos from sin², without cancellation.
        let one_minus_cos = sin2 / ((F::one() - sin2).safe_sqrt() + 1.0);
        Self { distance: d2.sqrt(), outside, one_minus_cos }
    }
}

/// Of the parallelogram over two edges. In f64: squares of squares of lengths are soon beyond f32.
pub(crate) fn area_vector(a: V, b: V) -> glam::DVec3 {
    a.as_dvec3().cross(b.as_dvec3())
}

/// The power of an emitter as one number, for the choice among them.
fn importance(emitter: &Emitter, scene_radius: f32) -> f64 {
    LUMINANCE.iter().zip(emitter.power(scene_radius)).map(|(w, p)| f64::from(*w) * p).sum()
}

#[cfg(test)]
mod solid_angle_tests;
#[cfg(test)]
mod tests;
