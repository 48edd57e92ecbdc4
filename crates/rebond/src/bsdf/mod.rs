//! How surfaces scatter: `f_r`, without the cosine.
//!
//! A [`Bsdf`] is plain data: which model, its parameters, the frame it stands in, and where tables are. The models are one file each, in
//! local coordinates (z = shading normal); this file dispatches over the models present among the lanes and holds the
//! two things that are the same for all: the agreement of shading and geometric normals, and the correction that makes
//! scattering with shading normals adjoint (Veach 1997, §5.3.2). Directions point away from the surface.

mod albedo;
mod ashikhmin_shirley;
mod beckmann;
mod blinn_phong;
pub mod capture;
pub mod check;
mod compensated_conductor;
mod conductor;
mod dielectric;
mod diffuse;
mod facets;
pub mod fresnel;
mod ggx;
pub use facets::{BECKMANN, SEPARABLE};
pub use ggx::SMOOTH;
pub mod measured;
mod mirror;
mod oren_nayar;
mod phong;
mod plastic;
mod principled;
mod principled_thin;
mod rough_conductor;
mod rough_dielectric;
mod thin_dielectric;

use crate::math::{Frame, Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use measured::Tables;
use rebond_lanes::{Index, Mask, Real};

/// What is carried along a path: radiance when it starts at the camera, importance when it starts at a light.
/// Refraction scales radiance by 1/η² but not power, and shading normals make scattering asymmetric; both corrections
/// hang on this.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportMode {
    /// The path starts at the camera; the direction sampled is where light comes from.
    Radiance,
    /// The path starts at a light; the direction sampled is where light goes.
    Importance,
}

impl TransportMode {
    /// What a walk from the other end carries.
    pub fn opposite(self) -> Self {
        match self {
            Self::Radiance => Self::Importance,
            Self::Importance => Self::Radiance,
        }
    }
}

/// What happens to light at a vertex of a path (Heckbert 1990, §2). It hangs on the model and the two directions alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Event {
    /// Reflected by a diffuse surface.
    Diffuse = 0,
    /// Reflected in any other way.
    Glossy,
    /// Reflected into a single direction.
    Specular,
    /// Passed on to the other side.
    Transmitted,
}

impl Event {
    /// Every event, in the order of their numbers.
    pub const ALL: [Event; 4] = [Event::Diffuse, Event::Glossy, Event::Specular, Event::Transmitted];

    /// The letter that stands for it.
    pub fn symbol(self) -> u8 {
        b"DGST"[self as usize]
    }
}

/// The models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Model {
    /// Lambert's.
    Diffuse = 0,
    /// The perfect mirror.
    Mirror,
    /// Smooth glass.
    Dielectric,
    /// Smooth metal.
    Conductor,
    /// GGX glass.
    RoughDielectric,
    /// GGX metal.
    RoughConductor,
    /// Phong's, energy-conserving.
    Phong,
    /// Phong's as the lecture prints it.
    PhongLecture,
    /// Blinn and Phong's, energy-conserving.
    BlinnPhong,
    /// Blinn and Phong's as the lecture prints it.
    BlinnPhongLecture,
    /// Oren and Nayar's rough diffuse surface.
    OrenNayar,
    /// Ashikhmin and Shirley's anisotropic lobe over a diffuse base.
    AshikhminShirley,
    /// A pane of smooth glass.
    ThinDielectric,
    /// A diffuse base under a GGX coat.
    Plastic,
    /// GGX metal with what its facets exchange.
    CompensatedConductor,
    /// Metal, plastic or glass under sheen and clearcoat.
    Principled,
    /// A sheet that reflects and passes light, specularly and diffusely.
    PrincipledThin,
    /// A table over the angles of both directions.
    Angles,
    /// A table over the angles of half vector and difference.
    HalfDifference,
    /// A table that follows the lobe.
    Adaptive,
}

impl Model {
    /// Every model, in the order of their numbers.
    pub const ALL: [Model; 20] = [
        Model::Diffuse,
        Model::Mirror,
        Model::Dielectric,
        Model::Conductor,
        Model::RoughDielectric,
        Model::RoughConductor,
        Model::Phong,
        Model::PhongLecture,
        Model::BlinnPhong,
        Model::BlinnPhongLecture,
        Model::OrenNayar,
        Model::AshikhminShirley,
        Model::ThinDielectric,
        Model::Plastic,
        Model::CompensatedConductor,
        Model::Principled,
        Model::PrincipledThin,
        Model::Angles,
        Model::HalfDifference,
        Model::Adaptive,
    ];

    /// What the model claims. The lecture prints its lobes as BRDFs, so they claim what a BRDF must be. Measurements are what
    /// they are; only the half vector's angles cannot tell the two directions apart. A principled sheet is as bright as artists
    /// wanted it.
    pub fn claims(self) -> check::Claims {
        check::Claims {
            reciprocity: !matches!(self, Model::Angles | Model::Adaptive),
            energy: !self.is_measured() && self != Model::PrincipledThin,
        }
    }

    /// Whether it reads a table.
    pub fn is_measured(self) -> bool {
        matches!(self, Model::Angles | Model::HalfDifference | Model::Adaptive)
    }

    /// Bit m: model m is specular.
    const SPECULAR: u32 = 1 << Model::Mirror as u32
        | 1 << Model::Dielectric as u32
        | 1 << Model::Conductor as u32
        | 1 << Model::ThinDielectric as u32;

    /// Bit m: model m may pass light to the other side.
    const TRANSMITS: u32 = 1 << Model::Dielectric as u32
        | 1 << Model::RoughDielectric as u32
        | 1 << Model::ThinDielectric as u32
        | 1 << Model::Principled as u32
        | 1 << Model::PrincipledThin as u32;

    /// Bit m: model m reflects diffusely.
    const DIFFUSE: u32 = 1 << Model::Diffuse as u32 | 1 << Model::OrenNayar as u32;

    /// Bit m: model m reflects into lobes only, no part of it diffusely.
    const LOBES: u32 = 1 << Model::RoughDielectric as u32
        | 1 << Model::RoughConductor as u32
        | 1 << Model::CompensatedConductor as u32;

    /// Whether all of its light leaves in one or two single directions, which no other sampler can find.
    #[inline(always)]
    pub fn is_specular(self) -> bool {
        Self::SPECULAR >> self as u32 & 1 == 1
    }
}

/// How many numbers describe a lobe besides its colour.
pub const PARAMETERS: usize = 9;

/// The parameters of a model; each says which it reads.
#[derive(Clone, Copy, Debug)]
pub struct Lobe<F: Real> {
    /// Reflectance or tint.
    pub color: Rgb<F>,
    /// Further parameters.
    pub p: [F; PARAMETERS],
}

/// The value of a BSDF for a pair of directions and the density with which it samples the second given the first.
#[derive(Clone, Copy, Debug)]
pub struct BsdfValue<F: Real> {
    /// `f_r`, in sr⁻¹, without the cosine. Specular models have none.
    pub f: Rgb<F>,
    /// Density.
    pub pdf: PdfSolidAngle<F>,
}

/// A direction drawn from a BSDF.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample<F: Real> {
    /// The direction.
    pub w: Vec3<F>,
    /// `f_r · |cosθ| / pdf`; black where the sample failed.
    pub weight: Rgb<F>,
    /// Density; for specular models the probability of the branch that was taken.
    pub pdf: PdfSolidAngle<F>,
    /// Whether the direction is one that only this sampler finds.
    pub specular: F::Mask,
    /// Relative index of refraction that the path passed (side of `w` over side of the known direction); 1 for
    /// reflection.
    pub eta: F,
}

impl<F: Real> BsdfValue<F> {
    fn zero() -> Self {
        Self { f: Rgb::black(), pdf: PdfSolidAngle(F::zero()) }
    }
    fn masked(self, mask: F::Mask) -> Self {
        Self { f: self.f.masked(mask), pdf: PdfSolidAngle(F::select(mask, self.pdf.0, F::zero())) }
    }
}

impl<F: Real> BsdfSample<F> {
    /// A sample of a model with a density, in reflection.
    #[inline(always)]
    fn glossy(w: Vec3<F>, weight: Rgb<F>, pdf: F) -> Self {
        Self { w, weight, pdf: PdfSolidAngle(pdf), specular: F::Mask::splat(false), eta: F::one() }
    }
    fn failed() -> Self {
        Self::glossy(Vec3::splat([0.0, 0.0, 1.0]), Rgb::black(), F::zero())
    }
    #[inline(always)]
    pub(crate) fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        Self {
            w: Vec3::select(mask, a.w, b.w),
            weight: Rgb::select(mask, a.weight, b.weight),
            pdf: PdfSolidAngle(F::select(mask, a.pdf.0, b.pdf.0)),
            specular: (mask & a.specular) | b.specular.and_not(mask),
            eta: F::select(mask, a.eta, b.eta),
        }
    }
}

/// A BSDF at a point.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf<'a, F: Real> {
    /// Model of each lane.
    model: F::Index,
    /// Bit m: some lane has model m.
    present: u32,
    lobe: Lobe<F>,
    /// Shading frame.
    frame: Frame<F>,
    /// Geometric normal.
    ng: Vec3<F>,
    /// What measured models read.
    tables: &'a Tables,
}

impl<F: Real> Bsdf<'static, F> {
    /// A BSDF that is not measured. `candidates` has bit m set for each model m that the lanes of `mask` may have.
    #[inline(always)]
    pub fn new(model: F::Index, candidates: u32, lobe: Lobe<F>, frame: Frame<F>, ng: Vec3<F>, mask: F::Mask) -> Self {
        let present = if candidates.is_power_of_two() {
            candidates
        } else {
            let is_there = |m: u32| candidates >> m & 1 == 1 && (model.eq(F::Index::splat(m)) & mask).any();
            (0..Model::ALL.len() as u32).filter(|m| is_there(*m)).fold(0, |bits, m| bits | 1 << m)
        };
        Self { model, present, lobe, frame, ng, tables: &measured::NO_TABLES }
    }

    /// The same with tables; the first parameter of a measured model holds the bits of its table's number.
    #[inline(always)]
    pub fn with_tables(self, tables: &Tables) -> Bsdf<'_, F> {
        let mut bsdf: Bsdf<'_, F> = self;
        bsdf.tables = tables;
        bsdf
    }
}

impl<F: Real> Bsdf<'_, F> {
    /// The shading normal.
    pub fn normal(&self) -> Vec3<F> {
        self.frame.n
    }

    /// The normal as the choice of a light wants it ([`LightSampler`](crate::emitter::LightSampler)): none (zero) where
    /// the lobe, not the cosine, decides what light counts.
    #[inline(always)]
    pub fn receiving_normal(&self) -> Vec3<F> {
        if self.present & Model::LOBES == 0 {
            return self.frame.n;
        }
        Vec3::select(self.is_of(Model::LOBES), Vec3::zero(), self.frame.n)
    }

    /// Lanes whose model is specular: their light arrives only along sampled directions.
    #[inline(always)]
    pub fn is_specular(&self) -> F::Mask {
        self.is_of(Model::SPECULAR)
    }

    /// Lanes whose model may pass light to the other side.
    #[inline(always)]
    pub fn may_transmit(&self) -> F::Mask {
        self.is_of(Model::TRANSMITS)
    }

    /// The number of the [`Event`] that turns light from one direction into the other.
    #[inline(always)]
    pub fn event(&self, known: Vec3<F>, other: Vec3<F>) -> F::Index {
        let number = |event: Event| F::Index::splat(event as u32);
        let mut event = number(Event::Glossy);
        for (models, of_these) in [(Model::DIFFUSE, Event::Diffuse), (Model::SPECULAR, Event::Specular)] {
            event = F::Index::select(self.is_of(models), number(of_these), event);
        }
        if self.present & Model::TRANSMITS != 0 {
            let passes = (self.ng.dot(known) * self.ng.dot(other)).lt(F::zero());
            event = F::Index::select(passes, number(Event::Transmitted), event);
        }
        event
    }

    /// Lanes whose model is one of these bits.
    #[inline(always)]
    fn is_of(&self, models: u32) -> F::Mask {
        let mut found = F::Mask::splat(false);
        if self.present & models != 0 {
            self.each_model(F::Mask::splat(true), |model, lanes| {
                if models >> model as u32 & 1 == 1 {
                    found = found | lanes;
                }
            });
        }
        found
    }

    /// Calls `f` for each model present, with its lanes.
    #[inline(always)]
    fn each_model(&self, mask: F::Mask, mut f: impl FnMut(Model, F::Mask)) {
        let single = self.present.is_power_of_two();
        let mut left = self.present;
        while left != 0 {
            let model = left.trailing_zeros();
            left &= left - 1;
            let lanes = if single { mask } else { mask & self.model.eq(F::Index::splat(model)) };
            f(Model::ALL[model as usize], lanes);
        }
    }

    /// Lanes in which `w` lies on the same side of the shading and of the geometric surface. Elsewhere light would
    /// leak through, so the BSDF is 0 there.
    #[inline(always)]
    fn consistent(&self, w: Vec3<F>, local_z: F) -> F::Mask {
        (local_z * self.ng.dot(w)).gt(F::zero())
    }

    /// Veach's correction for shading normals: 1 for radiance.
    #[inline(always)]
    fn adjoint(&self, mode: TransportMode, known: Vec3<F>, known_z: F, other: Vec3<F>, other_z: F) -> F {
        match mode {
            TransportMode::Radiance => F::one(),
            TransportMode::Importance => {
                let factor = (known_z * self.ng.dot(other)) / (self.ng.dot(known) * other_z);
                F::select(factor.is_finite(), factor.abs(), F::zero())
            }
        }
    }

    /// `f_r` for the directions `known` (towards the start of the path) and `other`, and the density of sampling
    /// `other` given `known`. Zero for specular models.
    #[inline(always)]
    pub fn eval(&self, known: Vec3<F>, other: Vec3<F>, mode: TransportMode, mask: F::Mask) -> BsdfValue<F> {
        let (a, b) = (self.frame.to_local(known), self.frame.to_local(other));
        let mask = mask & self.consistent(known, a.z) & self.consistent(other, b.z);
        let mut value = BsdfValue::zero();
        self.each_model(mask, |model, lanes| {
            let v = self.eval_model(model, a, b, mode).masked(lanes);
            value = BsdfValue { f: value.f + v.f, pdf: PdfSolidAngle(value.pdf.0 + v.pdf.0) };
        });
        value.f = value.f * self.adjoint(mode, known, a.z, other, b.z);
        value
    }

    /// The same, and the density with which a walk from the other end would sample `known` given `other`.
    #[inline(always)]
    pub fn eval_both_ways(
        &self,
        known: Vec3<F>,
        other: Vec3<F>,
        mode: TransportMode,
        mask: F::Mask,
    ) -> (BsdfValue<F>, PdfSolidAngle<F>) {
        let (a, b) = (self.frame.to_local(known), self.frame.to_local(other));
        let mask = mask & self.consistent(known, a.z) & self.consistent(other, b.z);
        let (mut value, mut back) = (BsdfValue::zero(), F::zero());
        self.each_model(mask, |model, lanes| {
            let v = self.eval_model(model, a, b, mode).masked(lanes);
            value = BsdfValue { f: value.f + v.f, pdf: PdfSolidAngle(value.pdf.0 + v.pdf.0) };
            back += self.pdf_model(model, b, a, mode.opposite(), lanes);
        });
        value.f = value.f * self.adjoint(mode, known, a.z, other, b.z);
        (value, PdfSolidAngle(back))
    }

    /// The density of [`Bsdf::eval`] alone.
    #[inline(always)]
    pub fn pdf(&self, known: Vec3<F>, other: Vec3<F>, mode: TransportMode, mask: F::Mask) -> PdfSolidAngle<F> {
        let (a, b) = (self.frame.to_local(known), self.frame.to_local(other));
        let mask = mask & self.consistent(known, a.z) & self.consistent(other, b.z);
        let mut pdf = F::zero();
        self.each_model(mask, |model, lanes| pdf += self.pdf_model(model, a, b, mode, lanes));
        PdfSolidAngle(pdf)
    }

    /// What one model has, of local directions. Most surfaces are diffuse, and there it is next to nothing.
    #[inline(always)]
    fn eval_model(&self, model: Model, a: Vec3<F>, b: Vec3<F>, mode: TransportMode) -> BsdfValue<F> {
        if model == Model::Diffuse { diffuse::eval(&self.lobe, a, b) } else { self.eval_other(model, a, b, mode) }
    }

    #[inline(always)]
    fn pdf_model(&self, model: Model, a: Vec3<F>, b: Vec3<F>, mode: TransportMode, lanes: F::Mask) -> F {
        F::select(lanes, self.eval_model(model, a, b, mode).pdf.0, F::zero())
    }

    /// The same for all others. Apart: there is much of it, and many ask.
    #[inline(never)]
    fn eval_other(&self, model: Model, a: Vec3<F>, b: Vec3<F>, mode: TransportMode) -> BsdfValue<F> {
        match model {
            Model::Mirror | Model::Dielectric | Model::Conductor | Model::ThinDielectric => BsdfValue::zero(),
            Model::Diffuse => diffuse::eval(&self.lobe, a, b),
            Model::RoughDielectric => rough_dielectric::eval(&self.lobe, a, b, mode),
            Model::RoughConductor => rough_conductor::eval(&self.lobe, a, b),
            Model::Phong => phong::eval(&self.lobe, a, b),
            Model::PhongLecture => phong::eval_lecture(&self.lobe, a, b, mode),
            Model::BlinnPhong => blinn_phong::eval(&self.lobe, a, b),
            Model::BlinnPhongLecture => blinn_phong::eval_lecture(&self.lobe, a, b),
            Model::OrenNayar => oren_nayar::eval(&self.lobe, a, b),
            Model::AshikhminShirley => ashikhmin_shirley::eval(&self.lobe, a, b),
            Model::Plastic => plastic::eval(&self.lobe, a, b),
            Model::CompensatedConductor => compensated_conductor::eval(&self.lobe, a, b),
            Model::Principled => principled::eval(self.lobe, a, b, mode),
            Model::PrincipledThin => principled_thin::eval(self.lobe, a, b),
            Model::Angles | Model::HalfDifference | Model::Adaptive => {
                self.tables.eval(model, self.lobe.p[0], a, b, mode)
            }
        }
    }

    /// A direction given `known`, from three numbers in [0, 1): two for the direction, one for the choice of a lobe.
    #[inline(always)]
    pub fn sample(
        &self,
        known: Vec3<F>,
        u: [F; 2],
        choice: impl Fn() -> F,
        mode: TransportMode,
        mask: F::Mask,
    ) -> BsdfSample<F> {
        let a = self.frame.to_local(known);
        let mask = mask & self.consistent(known, a.z);
        let mut sample = BsdfSample::failed();
        self.each_model(mask, |model, lanes| {
            let s = self.sample_model(model, a, u, &choice, mode);
            sample = if lanes.all() { s } else { BsdfSample::select(lanes, s, sample) };
        });
        let (z, w) = (sample.w.z, self.frame.to_world(sample.w));
        let good = mask & self.consistent(w, z);
        sample.w = w;
        sample.weight = sample.weight.masked(good) * self.adjoint(mode, known, a.z, w, z);
        sample
    }

    /// What one model draws, in local directions; see [`Bsdf::eval_model`].
    #[inline(always)]
    fn sample_model(
        &self,
        model: Model,
        a: Vec3<F>,
        u: [F; 2],
        choice: impl Fn() -> F,
        mode: TransportMode,
    ) -> BsdfSample<F> {
        if model == Model::Diffuse {
            diffuse::sample(&self.lobe, a, u)
        } else {
            self.sample_other(model, a, u, choice, mode)
        }
    }

    #[inline(never)]
    fn sample_other(
        &self,
        model: Model,
        a: Vec3<F>,
        u: [F; 2],
        choice: impl Fn() -> F,
        mode: TransportMode,
    ) -> BsdfSample<F> {
        match model {
            Model::Diffuse => diffuse::sample(&self.lobe, a, u),
            Model::Mirror => mirror::sample(&self.lobe, a),
            Model::Dielectric => dielectric::sample(&self.lobe, a, choice(), mode),
            Model::Conductor => conductor::sample(&self.lobe, a),
            Model::RoughDielectric => rough_dielectric::sample(&self.lobe, a, u, choice(), mode),
            Model::RoughConductor => rough_conductor::sample(&self.lobe, a, u),
            Model::Phong => phong::sample(&self.lobe, a, u),
            Model::PhongLecture => phong::sample_lecture(&self.lobe, a, u, mode),
            Model::BlinnPhong => blinn_phong::sample(&self.lobe, a, u),
            Model::BlinnPhongLecture => blinn_phong::sample_lecture(&self.lobe, a, u),
            Model::OrenNayar => oren_nayar::sample(&self.lobe, a, u),
            Model::AshikhminShirley => ashikhmin_shirley::sample(&self.lobe, a, u, choice()),
            Model::ThinDielectric => thin_dielectric::sample(&self.lobe, a, choice()),
            Model::Plastic => plastic::sample(&self.lobe, a, u, choice()),
            Model::CompensatedConductor => compensated_conductor::sample(&self.lobe, a, u, choice()),
            Model::Principled => principled::sample(self.lobe, a, u, choice(), mode),
            Model::PrincipledThin => principled_thin::sample(self.lobe, a, u, choice()),
            Model::Angles | Model::HalfDifference | Model::Adaptive => {
                self.tables.sample(model, self.lobe.p[0], a, u, choice(), mode)
            }
        }
    }
}

impl Bsdf<'_, f32> {
    /// Its model.
    pub fn model(&self) -> Model {
        Model::ALL[self.model.lane(0) as usize]
    }

    /// What it claims.
    pub fn claims(&self) -> check::Claims {
        self.model().claims()
    }

    /// Whether light passes to the other side.
    pub fn transmits(&self) -> bool {
        match self.model() {
            Model::Dielectric | Model::RoughDielectric | Model::ThinDielectric => true,
            Model::Diffuse
            | Model::Mirror
            | Model::Conductor
            | Model::RoughConductor
            | Model::Phong
            | Model::PhongLecture
            | Model::BlinnPhong
            | Model::BlinnPhongLecture
            | Model::OrenNayar
            | Model::AshikhminShirley
            | Model::Plastic
            | Model::CompensatedConductor
            | Model::Angles
            | Model::HalfDifference
            | Model::Adaptive => false,
            Model::Principled => self.lobe.p[1] > 0.0 && self.lobe.p[0] < 1.0,
            Model::PrincipledThin => self.lobe.p[0] > 0.0 || self.lobe.p[2] > 0.0,
        }
    }

    /// The index of the inside over the outside, where light is bent on its way through.
    pub fn index_inside(&self) -> Option<f32> {
        match self.model() {
            Model::Dielectric | Model::RoughDielectric => Some(self.lobe.p[0]),
            Model::Principled if self.transmits() => Some(self.lobe.p[2]),
            _ => None,
        }
    }
}

/// The mirror direction of w about z.
#[inline(always)]
fn reflect<F: Real>(w: Vec3<F>) -> Vec3<F> {
    crate::math::vec3(-w.x, -w.y, w.z)
}

/// The mirror direction of w about a unit vector h.
#[inline(always)]
fn reflect_about<F: Real>(w: Vec3<F>, h: Vec3<F>) -> Vec3<F> {
    h * (w.dot(h) * 2.0) - w
}

/// Lanes in which both directions are above the surface.
#[inline(always)]
fn both_above<F: Real>(a: Vec3<F>, b: Vec3<F>) -> F::Mask {
    a.z.gt(F::zero()) & b.z.gt(F::zero())
}

#[cfg(test)]
mod tests;
