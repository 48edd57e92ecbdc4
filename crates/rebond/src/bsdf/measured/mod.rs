//! Materials that were measured, or captured from others: `f_r` out of tables.
//!
//! | model | what it is | source |
//! |---|---|---|
//! | [`AngleTable`] | the lecture's `f_r[θi][φi][θo][φo][colour]` | `rebond capture`, or a gonioreflectometer |
//! | [`HalfDifferenceTable`] | angles of the half vector and of the light about it | MERL's database (Matusik et al. 2003) |
//! | [`AdaptiveTable`] | a grid that follows the lobe | RGL's database (Dupuy and Jakob 2018) |
//!
//! Each evaluates as its own file says: values are looked up where they stand, nothing is resampled. Directions for all
//! three are drawn from one kind of distribution, tabulated when the material is built (`directions.rs`). A table is read
//! as `f_r(ωi, ωo)` with ωo towards the viewer, so that data that are not reciprocal keep their meaning on paths from
//! lights.

mod adaptive;
mod angles;
mod directions;
mod half_difference;

pub use adaptive::{AdaptiveTable, Grid2};
pub use angles::AngleTable;
pub use half_difference::HalfDifferenceTable;

use super::check::Material;
use super::{Bsdf, BsdfSample, BsdfValue, Lobe, Model, PARAMETERS, TransportMode, both_above};
use crate::math::{Frame, Rgb, Vec3};
use crate::sampling::PdfSolidAngle;
use directions::Directions;
use rebond_lanes::{Index, Real, Record, math, scalar::Index1};
use std::f32::consts::FRAC_1_PI;

/// One material's measurements.
#[derive(Clone, Debug)]
pub enum Measured {
    /// The lecture's table.
    Angles(AngleTable),
    /// MERL's.
    HalfDifference(HalfDifferenceTable),
    /// RGL's.
    Adaptive(AdaptiveTable),
}

impl Measured {
    /// The model that reads it.
    pub fn model(&self) -> Model {
        match self {
            Self::Angles(_) => Model::Angles,
            Self::HalfDifference(_) => Model::HalfDifference,
            Self::Adaptive(_) => Model::Adaptive,
        }
    }

    /// Whether turning both directions about the normal changes nothing.
    pub fn is_isotropic(&self) -> bool {
        match self {
            Self::Angles(t) => t.is_isotropic(),
            Self::HalfDifference(_) => true,
            Self::Adaptive(t) => t.is_isotropic(),
        }
    }

    /// The material by itself, in the frame (x, y, z).
    ///
    /// # Errors
    /// If the table is too large.
    pub fn material(&self) -> Result<Material, String> {
        let mut tables = Tables::default();
        let number = tables.add(self)?;
        let mut p = [0.0; PARAMETERS];
        p[0] = f32::from_bits(number);
        let axis = |x, y, z| crate::math::vec3(x, y, z);
        let frame = Frame { s: axis(1.0, 0.0, 0.0), t: axis(0.0, 1.0, 0.0), n: axis(0.0, 0.0, 1.0) };
        let model = self.model() as u32;
        let bsdf = Bsdf::new(Index1(model), 1 << model, Lobe { color: Rgb::white(), p }, frame, frame.n, true);
        Ok(Material::new(vec![(1.0, bsdf)]).with_tables(tables))
    }

    /// Bytes of the numbers as they were measured, four for each.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Angles(t) => t.bytes(),
            Self::HalfDifference(t) => t.bytes(),
            Self::Adaptive(t) => t.bytes(),
        }
    }
}

/// The measured materials of a scene.
#[derive(Clone, Debug, Default)]
pub struct Tables {
    /// [`HEAD`] records for each table: [first value, first distribution, isotropic, –] (words), then what its model wants.
    heads: Vec<Record>,
    values: Vec<Record>,
    directions: Option<Directions>,
    /// log₂ of the longest list of angles there is, rounded up.
    search_steps: u32,
}

/// None.
pub(super) static NO_TABLES: Tables =
    Tables { heads: Vec::new(), values: Vec::new(), directions: None, search_steps: 0 };

/// Records that describe a table.
const HEAD: u32 = 6;

/// Share of the directions that are drawn by cosine, so that none that reflects is out of reach.
const COSINE_SHARE: f32 = 0.1;

impl Tables {
    /// Adds a material's measurements and returns their number.
    ///
    /// # Errors
    /// If all of them together are too many to be numbered.
    pub fn add(&mut self, measured: &Measured) -> Result<u32, String> {
        let (number, start) = (self.heads.len() as u32 / HEAD, self.values.len() as u32);
        let isotropic = measured.is_isotropic();
        let directions = self.directions.get_or_insert_with(Directions::new);
        self.heads.push(Record::words([start, directions.len(), u32::from(isotropic), 0]));
        match measured {
            Measured::Angles(t) => t.store(&mut self.heads, &mut self.values),
            Measured::HalfDifference(t) => t.store(&mut self.heads, &mut self.values),
            Measured::Adaptive(t) => {
                self.search_steps = self.search_steps.max(t.store(&mut self.heads, &mut self.values))
            }
        }
        if self.values.len() > u32::MAX as usize {
            return Err("all measured materials together have more than 2^32 values".into());
        }
        self.heads.resize(((number + 1) * HEAD) as usize, Record::default());
        let mut directions = self.directions.take().unwrap_or_else(Directions::new);
        directions.push(isotropic, |viewer, light| {
            let table = <rebond_lanes::F32x16 as Real>::Index::splat(number);
            self.f(measured.model(), table, light, viewer)
        });
        self.directions = Some(directions);
        Ok(number)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.heads.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.heads) + size_of_val(&*self.values) + self.directions.as_ref().map_or(0, Directions::bytes)
    }

    /// Words of a table's head.
    #[inline(always)]
    fn head<F: Real>(&self, table: F::Index, record: u32) -> [F::Index; 4] {
        F::words(&self.heads, table * F::Index::splat(HEAD) + F::Index::splat(record))
    }

    /// f_r of a table for two directions above the surface.
    #[inline(always)]
    fn f<F: Real>(&self, model: Model, table: F::Index, light: Vec3<F>, viewer: Vec3<F>) -> Rgb<F> {
        match model {
            Model::HalfDifference => half_difference::f(self, table, light, viewer),
            Model::Adaptive => adaptive::f(self, table, light, viewer),
            _ => angles::f(self, table, light, viewer),
        }
    }

    /// f_r and the density of drawing `b` given `a`. `table` holds the bits of the table's number.
    // Apart and by value, so that models without tables keep their numbers in registers.
    #[inline(never)]
    pub(super) fn eval<F: Real>(
        &self,
        model: Model,
        table: F,
        a: Vec3<F>,
        b: Vec3<F>,
        mode: TransportMode,
    ) -> BsdfValue<F> {
        let table = table.to_bits();
        let above = both_above(a, b);
        let (light, viewer) = match mode {
            TransportMode::Radiance => (b, a),
            TransportMode::Importance => (a, b),
        };
        let f = self.f(model, table, light, viewer);
        let Some(directions) = &self.directions else { return BsdfValue::zero() };
        let [_, first, isotropic, _] = self.head::<F>(table, 0);
        let tabulated = directions.pdf(first, isotropic.ne(F::Index::splat(0)), a, b);
        let pdf = tabulated * (1.0 - COSINE_SHARE) + b.z * (COSINE_SHARE * FRAC_1_PI);
        // Directions that turn out black count as failed.
        BsdfValue { f, pdf: PdfSolidAngle(pdf) }.masked(above & f.is_lit())
    }

    /// A direction given `a`.
    #[inline(never)]
    pub(super) fn sample<F: Real>(
        &self,
        model: Model,
        table: F,
        a: Vec3<F>,
        u: [F; 2],
        choice: F,
        mode: TransportMode,
    ) -> BsdfSample<F> {
        let Some(directions) = &self.directions else { return BsdfSample::failed() };
        let [_, first, isotropic, _] = self.head::<F>(table.to_bits(), 0);
        let cosine = choice.lt(F::splat(COSINE_SHARE));
        let rest = (choice - COSINE_SHARE) * (1.0 / (1.0 - COSINE_SHARE));
        let b = directions.sample(first, isotropic.ne(F::Index::splat(0)), a, u, rest.relu());
        let b = Vec3::select(cosine, crate::sampling::warp::cosine_hemisphere(u), b);
        let value = self.eval(model, table, a, b, mode);
        let good = both_above(a, b) & value.pdf.0.gt(F::zero());
        BsdfSample::glossy(b, Rgb::select(good, value.f * (b.z / value.pdf.0), Rgb::black()), value.pdf.0)
    }
}

/// Angle from the normal over 90°, of a direction above the surface.
#[inline(always)]
fn tilt<F: Real>(w: Vec3<F>) -> F {
    math::atan2((w.x * w.x + w.y * w.y).sqrt(), w.z) * (2.0 * FRAC_1_PI)
}

/// Angle about the normal over 360°, in (−½, ½].
#[inline(always)]
fn turn<F: Real>(w: Vec3<F>) -> F {
    math::atan2(w.y, w.x) * (0.5 * FRAC_1_PI)
}

/// A place between two samples: their numbers, and how far it is from the first to the second.
#[derive(Clone, Copy)]
struct Between<F: Real> {
    at: [F::Index; 2],
    weight: [F; 2],
}

impl<F: Real> Between<F> {
    /// Between samples at 0, 1, …, n − 1; the outer ones go on beyond.
    #[inline(always)]
    fn clamped(x: F, n: F::Index) -> Self {
        let x = x.relu().min(F::from_index(n) - 1.0);
        let i = x.to_index();
        let last = n - F::Index::splat(1);
        let part = x - F::from_index(i);
        Self { at: [i, (i + F::Index::splat(1)).min(last)], weight: [F::one() - part, part] }
    }

    /// Between samples of a circle at 0, 1, …, n − 1 of n.
    #[inline(always)]
    fn around(turns: F, n: F::Index) -> Self {
        let last = n - F::Index::splat(1);
        let x = (turns - turns.floor()) * F::from_index(n);
        let i = x.to_index().min(last);
        let next = F::Index::select(i.eq(last), F::Index::splat(0), i + F::Index::splat(1));
        let part = (x - F::from_index(i)).min(F::one());
        Self { at: [i, next], weight: [F::one() - part, part] }
    }
}

/// Whether every number is finite and none negative; the place of the first that is not.
fn check_values<'a>(what: &str, values: impl IntoIterator<Item = &'a f32>) -> Result<(), String> {
    match values.into_iter().enumerate().find(|(_, x)| !(**x >= 0.0 && x.is_finite())) {
        None => Ok(()),
        Some((i, x)) => Err(format!("value {i} of {what} is {x}; values are finite and not negative")),
    }
}

#[cfg(test)]
mod tests;
