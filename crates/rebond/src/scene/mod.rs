//! The scene: a [`SceneDescription`] is built once to an immutable [`Scene`], which answers queries.

mod build;
pub mod description;
mod faces;
mod pilot;
mod surface;
mod transform;
mod varied;

pub use build::{MeshSource, Resources, build, material};
pub use description::SceneDescription;
pub use faces::{DiffusePart, Face, Obstacle};
pub use surface::Surface;

use crate::bsdf::measured::Tables;
use crate::bsdf::{Bsdf, Lobe, Model, PARAMETERS};
use crate::camera::Camera;
use crate::emitter::{EmitterHit, EmitterSample, Emitters, LightSampler, LightSampling};
use crate::film::{Aov, Filter};
use crate::math::{Frame, Keyframes, Rgb, Vec3};
use crate::texture::Textures;
use rebond_bvh::{Accel, Hit, Ray, Trace};
use rebond_lanes::{Index, Mask, Real, Record, scalar::Index1};
use varied::Place;

/// What is wrong with a description, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {message}")]
pub struct BuildError {
    /// Place in the description, such as `shapes[3].radius`.
    pub path: String,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub help: Option<String>,
}

impl BuildError {
    pub(crate) fn new(path: impl Into<String>, message: impl Into<String>) -> Self {
        Self { path: path.into(), message: message.into(), help: None }
    }
    pub(crate) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// What a scene is made of, for reports.
#[derive(Clone, Debug, Default)]
pub struct SceneStatistics {
    /// Triangles, each group's counted once.
    pub triangles: u64,
    /// Spheres and disks.
    pub analytic_shapes: u64,
    /// Instances of groups and of moving shapes; 0 if everything stands in one space.
    pub instances: u64,
    /// Emitters; every triangle of a shining mesh is one.
    pub emitters: u64,
    /// Materials, those within others included.
    pub materials: u64,
    /// Bytes of the ray accelerator.
    pub accelerator_bytes: u64,
    /// Bytes of all else.
    pub table_bytes: u64,
    /// Seconds it took to build the ray accelerator.
    pub accelerator_seconds: f64,
    /// What was skipped or looks wrong, in words.
    pub warnings: Vec<String>,
}

/// A scene, ready for light.
pub struct Scene {
    accel: Accel,
    /// Triangles: [corner, corner, corner, shape] (words). Spheres and disks: [place in `analytic`, –, –, shape].
    primitives: Vec<Record>,
    /// [x, y, z, u].
    vertices: Vec<Record>,
    /// [nx, ny, nz, v]; empty if no shape has normals or UVs.
    normals: Vec<Record>,
    /// [material, emitter of its first primitive or none, flags, first primitive] (words).
    shapes: Vec<Record>,
    /// Spheres and disks, three records each: [centre, radius], [x axis, side of the normal],
    /// [z axis, handedness].
    analytic: Vec<Record>,
    /// Where the instances are.
    instances: Keyframes,
    /// Materials: `MATERIAL_RECORDS` each.
    materials: Vec<Record>,
    textures: Textures,
    varied: varied::Varied,
    measured: Tables,
    features: Features,
    emitters: Emitters,
    light_sampler: LightSampler,
    camera: Camera,
    filter: Filter,
    aovs: Vec<Aov>,
    statistics: SceneStatistics,
    names: faces::Names,
    /// Of each instance.
    extents: Vec<faces::Extent>,
}

/// What a scene has at all, so that what it has not costs nothing.
#[derive(Clone, Copy, Debug, Default)]
struct Features {
    /// Bit m: some material is of model m.
    models: u32,
    normals: bool,
    analytic: bool,
    instances: bool,
    mixes: bool,
    two_sided: bool,
    tangents: bool,
    emissive_shapes: bool,
    /// Some material has holes.
    masks: bool,
    /// Some material tilts its shading frame.
    maps: bool,
    /// Some material has a parameter that varies.
    varied: bool,
    /// The eye sees no lights.
    hides_emitters: bool,
}

/// Flags of a shape.
const HAS_NORMALS: u32 = 1;
const HAS_UVS: u32 = 2;
const IS_SPHERE: u32 = 4;
const IS_DISK: u32 = 8;
/// Each of its primitives is an emitter of its own.
const EMITTER_PER_PRIMITIVE: u32 = 16;

/// Records of a material: [model, texture + 1, row of [`varied`] + 1, flags] (words), [colour, last parameter], parameters, parameters. A mix: [MIX, a, b, flags]
/// (words), [weight of b, –, –, –]. A two-sided one: [TWO_SIDED, front, back, –] (words). One with holes: [MASK, material,
/// texture + 1, flags] (words), [opacity, –, –, –]. One whose frame tilts: [NORMAL_MAP or BUMP_MAP, material, texture,
/// flags] (words), [scale, –, –, –].
const MATERIAL_RECORDS: u32 = 4;
/// The model word of a mix.
const MIX: u32 = 1000;
/// The model word of a two-sided material.
const TWO_SIDED: u32 = 1001;
/// The model word of a material with holes.
const MASK: u32 = 1002;
/// The model word of a material with a map of normals.
const NORMAL_MAP: u32 = 1003;
/// The model word of a material with a map of heights.
const BUMP_MAP: u32 = 1004;

impl Scene {
    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The reconstruction filter.
    pub fn filter(&self) -> &Filter {
        &self.filter
    }

    /// What the film shows beside the picture.
    pub fn aovs(&self) -> &[Aov] {
        &self.aovs
    }

    /// The emitters.
    pub fn emitters(&self) -> &Emitters {
        &self.emitters
    }

    /// The choice among emitters.
    pub fn light_sampler(&self) -> &LightSampler {
        &self.light_sampler
    }

    /// The name that the description gives a material, if it does.
    pub fn material_name(&self, material: u32) -> Option<&str> {
        self.names.materials.iter().find(|(number, _)| *number == material).map(|(_, name)| &**name)
    }

    /// What it is made of.
    pub fn statistics(&self) -> &SceneStatistics {
        &self.statistics
    }

    /// Lower and upper corner of all surfaces.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        self.accel.bounds()
    }

    /// Diagonal of the box around what paths from the camera meet, but for the few that stray; 0 if they meet nothing. By some
    /// thousand paths, the same ones each time.
    pub fn extent_seen(&self) -> f32 {
        pilot::extent(self)
    }

    /// The first surface along each ray of `mask`. `coherent` rays start near one another and go the same way.
    #[inline(always)]
    pub fn intersect<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, coherent: bool) -> Hit<F> {
        if self.features.masks {
            return self.intersect_masked(ray, mask, coherent);
        }
        self.accel.closest(ray, mask, coherent)
    }

    /// Whether anything lies on the rays of `mask`.
    #[inline(always)]
    pub fn occluded<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> F::Mask {
        if self.features.masks {
            return self.occluded_masked(ray, mask);
        }
        self.accel.occluded(ray, mask)
    }

    /// Whether the eye sees no lights: its rays pass those that have a surface, and find no surroundings.
    #[inline(always)]
    pub fn hides_emitters(&self) -> bool {
        self.features.hides_emitters
    }

    /// The first surface along each ray of `mask`; past lights, if those are hidden from the eye and the rays `start` there.
    #[inline(always)]
    pub fn meet<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, start: bool) -> Hit<F> {
        if self.features.hides_emitters && start {
            return self.see(ray, mask);
        }
        self.intersect(ray, mask, start)
    }

    /// Whether anything lies on the rays of `mask`, one end of which is the eye's.
    #[inline(always)]
    pub fn hidden<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> F::Mask {
        if self.features.hides_emitters {
            return self.hidden_past_lights(ray, mask);
        }
        self.occluded(ray, mask)
    }

    /// What the eye sees along its own rays of `mask` where it sees no lights.
    // Apart, so that scenes whose lights are seen keep their loops short.
    #[inline(never)]
    pub fn see<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> Hit<F> {
        self.accel.closest_where(ray, mask, true, &|p, i, u, v| !self.shines(p) && self.stops(p, i, u, v))
    }

    #[inline(never)]
    fn hidden_past_lights<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> F::Mask {
        self.accel.occluded_where(ray, mask, &|p, i, u, v| !self.shines(p) && self.stops(p, i, u, v))
    }

    /// Whether a primitive is a light.
    fn shines(&self, primitive: u32) -> bool {
        let shape = f32::words(&self.primitives, Index1(primitive))[3];
        f32::words(&self.shapes, shape)[1].0 != crate::emitter::NO_EMITTER
    }

    // Apart, so that scenes without holes keep their loops short.
    #[inline(never)]
    fn intersect_masked<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask, coherent: bool) -> Hit<F> {
        self.accel.closest_where(ray, mask, coherent, &|p, i, u, v| self.stops(p, i, u, v))
    }

    #[inline(never)]
    fn occluded_masked<F: Trace>(&self, ray: &Ray<F>, mask: F::Mask) -> F::Mask {
        self.accel.occluded_where(ray, mask, &|p, i, u, v| self.stops(p, i, u, v))
    }

    /// Whether a ray ends at this point of a primitive. Where the opacity is between 0 and 1 that is drawn by a hash of the
    /// point, so that rays of all kinds meet one and the same surface (as in Pharr, Jakob, Humphreys 2023, §7.1.1).
    fn stops(&self, primitive: u32, instance: u32, u: f32, v: f32) -> bool {
        let corners = f32::words(&self.primitives, Index1(primitive));
        let [material, _, flags, _] = f32::words(&self.shapes, corners[3]);
        let first = Index1(material.0 * MATERIAL_RECORDS);
        let [kind, _, texture, _] = f32::words(&self.materials, first);
        if kind.0 != MASK {
            return true;
        }
        let mut opacity = f32::record(&self.materials, Index1(first.0 + 1))[0];
        if texture.0 != 0 {
            let uv = if flags.0 & HAS_UVS != 0 {
                let w = 1.0 - u - v;
                let across = |table: &[Record]| {
                    let at = |i: usize| f32::record(table, corners[i])[3];
                    w * at(0) + u * at(1) + v * at(2)
                };
                [across(&self.vertices), across(&self.normals)]
            } else {
                [u, v]
            };
            opacity *= self.textures.eval(Index1(texture.0 - 1), uv).luminance();
        }
        opacity >= 1.0 || opacity > hash(primitive, instance, u, v)
    }

    /// Radiance that the surface sends back along the ray that found it.
    #[inline(always)]
    pub fn emitted<F: Real>(&self, surface: &Surface<F>, mask: F::Mask) -> Rgb<F> {
        if !self.features.emissive_shapes {
            return Rgb::black();
        }
        let lit = mask & surface.is_emitter() & surface.front();
        if lit.none() {
            return Rgb::black();
        }
        self.emitters.radiance_at(surface.emitter, surface.p, surface.time, lit).masked(lit)
    }

    /// Density per solid angle with which [`Scene::sample_light`] at `p` would have found what a ray from there hit.
    #[inline(always)]
    pub fn light_pdf<F: Real>(
        &self,
        p: Vec3<F>,
        n: Vec3<F>,
        hit: &EmitterHit<F>,
        sampling: LightSampling,
        mask: F::Mask,
    ) -> F {
        self.emitters.pdf(hit, sampling, mask).0 * self.light_sampler.probability(p, n, hit.emitter, mask)
    }

    /// Light for a point `p` with normal `n` at a time: from one emitter, chosen by `choice`, weighed for all; its `pdf` is that
    /// of the choice and the direction together. `None` in a scene without light.
    #[expect(clippy::too_many_arguments)]
    #[inline(always)]
    pub fn sample_light<F: Real>(
        &self,
        p: Vec3<F>,
        n: Vec3<F>,
        time: F,
        sampling: LightSampling,
        choice: impl FnOnce() -> F,
        u: [F; 2],
        mask: F::Mask,
    ) -> Option<EmitterSample<F>> {
        let (emitter, probability) = self.light_sampler.sample(p, n, choice, mask)?;
        Some(self.emitters.sample(emitter, p, time, sampling, u, mask).chosen_with(probability))
    }

    /// Radiance of all surroundings along the unit direction `w`.
    #[inline(always)]
    pub fn sky<F: Real>(&self, w: Vec3<F>) -> Rgb<F> {
        self.emitters.environments.iter().fold(Rgb::black(), |sum, (_, environment)| sum + environment.eval(w).0)
    }

    /// Light of the surroundings along the unit direction `w` as seen from `p`: each one's radiance and the density
    /// with which [`Scene::sample_light`] would have found it.
    #[inline(always)]
    pub fn surroundings<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, w: Vec3<F>) -> impl Iterator<Item = (Rgb<F>, F)> {
        self.emitters.environments.iter().map(move |(number, environment)| {
            let mask = F::Mask::splat(true);
            let probability = self.light_sampler.probability(p, n, F::Index::splat(*number), mask);
            let (radiance, pdf) = environment.eval(w);
            (radiance, pdf.0 * probability)
        })
    }

    /// The BSDF of a surface. Mixes are resolved by drawing one of their parts, by `choice` in [0, 1).
    #[inline(always)]
    pub fn bsdf<F: Real>(&self, surface: &Surface<F>, choice: impl FnOnce() -> F, mask: F::Mask) -> Bsdf<'_, F> {
        let at = |material: F::Index, n: u32| material * F::Index::splat(MATERIAL_RECORDS) + F::Index::splat(n);
        let record = |material: F::Index, n: u32| F::record(&self.materials, at(material, n));
        let mut material = surface.material;
        let (mut frame, mut ng) = (surface.frame, surface.ng);
        let mut head = F::words(&self.materials, at(material, 0));
        if self.features.masks {
            let masked = mask & head[0].eq(F::Index::splat(MASK));
            if masked.any() {
                material = F::Index::select(masked, head[1], material);
                head = F::words(&self.materials, at(material, 0));
            }
        }
        if self.features.two_sided {
            let two_sided = mask & head[0].eq(F::Index::splat(TWO_SIDED));
            if two_sided.any() {
                let behind = two_sided.and_not(surface.front());
                material = F::Index::select(two_sided, F::Index::select(behind, head[2], head[1]), material);
                // Turned about the first tangent, so that the frame stays right-handed.
                (frame.n, ng) = (Vec3::select(behind, -frame.n, frame.n), Vec3::select(behind, -ng, ng));
                frame.t = Vec3::select(behind, -frame.t, frame.t);
                head = F::words(&self.materials, at(material, 0));
            }
        }
        if self.features.maps {
            // Before mixes, for maps over them; and at every turn, for maps within.
            self.tilt(surface, &mut frame, &mut material, &mut head, mask);
        }
        if self.features.mixes {
            let mut u = choice();
            loop {
                let mixed = mask & head[0].eq(F::Index::splat(MIX));
                if mixed.none() {
                    break;
                }
                let weight = record(material, 1)[0];
                let takes_b = u.lt(weight);
                // What is left of u within its share serves the next level.
                let rest = F::select(takes_b, u / weight, (u - weight) / (F::one() - weight));
                u = F::select(mixed, rest, u);
                material = F::Index::select(mixed, F::Index::select(takes_b, head[2], head[1]), material);
                head = F::words(&self.materials, at(material, 0));
                if self.features.maps {
                    self.tilt(surface, &mut frame, &mut material, &mut head, mask);
                }
            }
        }
        let first = record(material, 1);
        let mut color = Rgb::of_record(first);
        if !self.textures.is_empty() {
            let textured = mask & head[1].ne(F::Index::splat(0));
            if textured.any() {
                let texel = self.textures.eval(head[1] - F::Index::splat(1), surface.uv);
                color *= Rgb::select(textured, texel, Rgb::white());
            }
        }
        let p = if self.features.models & !(1 << Model::Diffuse as u32 | 1 << Model::Mirror as u32) == 0 {
            [F::zero(); PARAMETERS]
        } else {
            let (a, b) = (record(material, 2), record(material, 3));
            [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], first[3]]
        };
        let mut lobe = Lobe { color, p };
        if self.features.varied {
            lobe = self.varied.apply(&self.tables(), head[2], Place::of(surface), lobe, mask);
        }
        Bsdf::new(head[0], self.features.models, lobe, frame, ng, mask).with_tables(&self.measured)
    }

    /// What parameters that vary are found by.
    fn tables(&self) -> varied::Tables<'_> {
        varied::Tables { textures: &self.textures, primitives: &self.primitives, shapes: &self.shapes }
    }

    /// Tilts the shading frames of lanes whose material is a map of normals or heights, and goes on to what is under it.
    #[inline(never)]
    fn tilt<F: Real>(
        &self,
        surface: &Surface<F>,
        frame: &mut Frame<F>,
        material: &mut F::Index,
        head: &mut [F::Index; 4],
        mask: F::Mask,
    ) {
        let is = |kind: u32| mask & head[0].eq(F::Index::splat(kind));
        let (normals, heights) = (is(NORMAL_MAP), is(BUMP_MAP));
        let mapped = normals | heights;
        if mapped.none() {
            return;
        }
        let at = |material: F::Index, n: u32| material * F::Index::splat(MATERIAL_RECORDS) + F::Index::splat(n);
        let texture = F::Index::select(mapped, head[2], F::Index::splat(0));
        let scale = F::record(&self.materials, at(*material, 1))[0];
        let n = surface.normal_under(&self.textures, texture, scale, heights);
        // From behind, of a two-sided material, the same relief is seen.
        let n = n.facing(frame.n);
        let tilted = Frame::with_tangent(n, frame.s);
        let pick = |a: Vec3<F>, b: Vec3<F>| Vec3::select(mapped, a, b);
        *frame = Frame { s: pick(tilted.s, frame.s), t: pick(tilted.t, frame.t), n: pick(tilted.n, frame.n) };
        *material = F::Index::select(mapped, head[1], *material);
        *head = F::words(&self.materials, at(*material, 0));
    }

    /// Where a ray found a surface, for the lanes of `mask` (all of which hit something).
    #[inline(always)]
    pub fn surface<F: Real>(&self, ray: &Ray<F>, hit: &Hit<F>, mask: F::Mask) -> Surface<F> {
        surface::surface(self, ray, hit, mask)
    }
}

/// A number in [0, 1) out of a point of a primitive.
fn hash(primitive: u32, instance: u32, u: f32, v: f32) -> f32 {
    let mut x = 0_u32;
    for word in [primitive, instance, u.to_bits(), v.to_bits()] {
        // The finaliser `lowbias32` (Wellons 2018) after each word.
        x ^= word;
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        x ^= x >> 16;
        x = x.wrapping_add(0x9e37_79b9);
    }
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Frames are built from a tangent only where some material needs it.
#[inline(always)]
fn shading_frame<F: Real>(n: Vec3<F>, tangent: Option<Vec3<F>>) -> Frame<F> {
    match tangent {
        Some(t) => Frame::with_tangent(n, t),
        None => Frame::around(n),
    }
}

/// Lanes that hit something.
#[inline(always)]
pub fn is_hit<F: Real>(hit: &Hit<F>) -> F::Mask {
    hit.primitive.ne(F::Index::splat(rebond_bvh::MISS))
}

impl<F: Real> Surface<F> {
    /// What its emitter must know of a point that sees it.
    #[inline(always)]
    pub fn seen_from(&self, p: Vec3<F>) -> EmitterHit<F> {
        EmitterHit { emitter: self.emitter, from: p, to: self.p - p, normal: self.ng, time: self.time }
    }
    /// Lanes whose surface shines.
    #[inline(always)]
    pub fn is_emitter(&self) -> F::Mask {
        self.emitter.ne(F::Index::splat(crate::emitter::NO_EMITTER))
    }
}
