//! Parameters of materials that vary over a surface: roughness and metal by images, these and colours by what a mesh knows of
//! its vertices and faces.

use super::Surface;
use crate::bsdf::{Lobe, SMOOTH};
use crate::math::Rgb;
use crate::texture::Textures;
use rebond_lanes::{Index, Mask, Real, Record};

/// Where a number is read, and what its red, green and blue count.
#[derive(Clone, Copy, Debug, Default)]
pub struct NumberFrom {
    /// A texture's number + 1, or [`ATTRIBUTE`] and an attribute's number; 0 if the number is the same everywhere.
    pub source: u32,
    /// Weights of its channels.
    pub weights: [f32; 3],
}

/// The bit that tells attributes from textures.
pub const ATTRIBUTE: u32 = 1 << 31;

/// What varies of a material.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// α, or its root.
    pub roughness: NumberFrom,
    /// Whether it is its root.
    pub is_root: bool,
    /// αx is α over this, αy is α times this.
    pub aspect: f32,
    /// Share of metal.
    pub metallic: NumberFrom,
    /// Where αy is read, if not where αx is. No model has this and metal.
    pub across: Option<NumberFrom>,
    /// The attribute that multiplies the colour: its number + 1, or 0.
    pub color: u32,
}

impl Row {
    /// Whether anything varies.
    pub fn is_any(&self) -> bool {
        let across = self.across.is_some_and(|from| from.source != 0);
        self.roughness.source != 0 || self.metallic.source != 0 || across || self.color != 0
    }
}

/// What varies of all materials of which something does.
#[derive(Clone, Debug, Default)]
pub struct Varied {
    /// Three records each: [source of roughness, of metal or αy, attribute of colour + 1, flags] (words); weights of the roughness and
    /// its aspect; weights of the metal or αy.
    rows: Vec<Record>,
    /// Of each attribute of a mesh: [its first value, the mesh's first vertex, whether it is of faces, –] (words).
    attributes: Vec<Record>,
    values: Vec<Record>,
}

const RECORDS: u32 = 3;

/// Flags: roughness is a root; the second number is not metal but αy.
const IS_ROOT: u32 = 1;
const IS_ACROSS: u32 = 2;

/// What values are found by.
pub struct Tables<'a> {
    /// Images.
    pub textures: &'a Textures,
    /// Corners of triangles and their shapes.
    pub primitives: &'a [Record],
    /// Shapes.
    pub shapes: &'a [Record],
}

/// A point of a primitive.
#[derive(Clone, Copy, Debug)]
pub struct Place<F: Real> {
    /// Texture coordinates.
    pub uv: [F; 2],
    /// The primitive.
    pub primitive: F::Index,
    /// Weights of its second and third corner.
    pub weights: [F; 2],
}

impl<F: Real> Place<F> {
    /// Where a ray met a surface.
    #[inline(always)]
    pub fn of(surface: &Surface<F>) -> Self {
        Self { uv: surface.uv, primitive: surface.primitive, weights: surface.weights }
    }

    /// Of which only the texture coordinates are known.
    pub fn at(uv: [F; 2]) -> Self {
        Self { uv, primitive: F::Index::splat(0), weights: [F::zero(); 2] }
    }
}

/// The number before, where there is one.
#[inline(always)]
fn before<F: Real>(number: F::Index, there: F::Mask) -> F::Index {
    F::Index::select(there, number, F::Index::splat(1)) - F::Index::splat(1)
}

impl Varied {
    /// Adds a row and returns its number + 1.
    pub fn add(&mut self, row: Row) -> u32 {
        let Row { roughness, is_root, aspect, metallic, across, color } = row;
        let flags = if is_root { IS_ROOT } else { 0 } | if across.is_some() { IS_ACROSS } else { 0 };
        let second = across.unwrap_or(metallic);
        self.rows.push(Record::words([roughness.source, second.source, color, flags]));
        let [r, g, b] = roughness.weights;
        self.rows.push(Record([r, g, b, aspect]));
        let [r, g, b] = second.weights;
        self.rows.push(Record([r, g, b, 0.0]));
        self.rows.len() as u32 / RECORDS
    }

    /// Adds an attribute of the mesh whose first vertex this is, and returns its number.
    pub fn add_attribute(&mut self, values: &[[f32; 3]], first_vertex: u32, of_faces: bool) -> u32 {
        self.attributes.push(Record::words([self.values.len() as u32, first_vertex, u32::from(of_faces), 0]));
        self.values.extend(values.iter().map(|[r, g, b]| Record([*r, *g, *b, 0.0])));
        self.attributes.len() as u32 - 1
    }

    /// Whether a row, by its number + 1, asks for an attribute.
    pub fn has_attribute(&self, row: u32) -> bool {
        let Some(row) = row.checked_sub(1) else { return false };
        let [roughness, second, color, _] = self.rows[(row * RECORDS) as usize].0.map(f32::to_bits);
        (roughness | second) & ATTRIBUTE != 0 || color != 0
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.rows.len() + self.attributes.len() + self.values.len()) * size_of::<Record>()
    }

    /// The lobe at a place of materials whose rows have these numbers + 1, or 0. Roughness is `p[6]` and `p[7]` of every
    /// model that has any, metal `p[0]` of the principled one.
    // Apart, so that scenes without such materials keep their loops short.
    #[inline(never)]
    pub fn apply<F: Real>(
        &self,
        tables: &Tables,
        row: F::Index,
        place: Place<F>,
        mut lobe: Lobe<F>,
        mask: F::Mask,
    ) -> Lobe<F> {
        let none = F::Index::splat(0);
        let varied = mask & row.ne(none);
        if varied.none() {
            return lobe;
        }
        let at = before::<F>(row, varied) * F::Index::splat(RECORDS);
        let [roughness, second, color, flags] = F::words(&self.rows, at);
        let has = |flag: u32| (flags & F::Index::splat(flag)).ne(none);
        let number = |source: F::Index, there: F::Mask, [r, g, b, _]: [F; 4]| {
            let attribute = there & (source & F::Index::splat(ATTRIBUTE)).ne(none);
            let image = there.and_not(attribute);
            let mut found = Rgb::black();
            if image.any() {
                found = tables.textures.eval(before::<F>(source, image), place.uv);
            }
            if attribute.any() {
                let number = source - F::Index::splat(ATTRIBUTE);
                found = Rgb::select(attribute, self.value(tables, number, &place, attribute), found);
            }
            found.r * r + found.g * g + found.b * b
        };
        let rough = varied & roughness.ne(none);
        if rough.any() {
            let weights = F::record(&self.rows, at + F::Index::splat(1));
            let (x, aspect) = (number(roughness, rough, weights), weights[3]);
            let alpha = F::select(has(IS_ROOT), x * x, x);
            let both = rough.and_not(has(IS_ACROSS));
            lobe.p[6] = F::select(rough, (alpha / aspect).clamp(SMOOTH, 1.0), lobe.p[6]);
            lobe.p[7] = F::select(both, (alpha * aspect).max(F::splat(SMOOTH)), lobe.p[7]);
        }
        let there = varied & second.ne(none);
        if there.any() {
            let x = number(second, there, F::record(&self.rows, at + F::Index::splat(2)));
            let across = there & has(IS_ACROSS);
            lobe.p[0] = F::select(there.and_not(across), x.clamp(0.0, 1.0), lobe.p[0]);
            lobe.p[7] = F::select(across, x.clamp(SMOOTH, 1.0), lobe.p[7]);
        }
        let colored = varied & color.ne(none);
        if colored.any() {
            let value = self.value(tables, before::<F>(color, colored), &place, colored);
            lobe.color *= Rgb::select(colored, value, Rgb::white());
        }
        lobe
    }

    /// The value of an attribute: between a triangle's corners, or of the whole triangle.
    fn value<F: Real>(&self, tables: &Tables, attribute: F::Index, place: &Place<F>, mask: F::Mask) -> Rgb<F> {
        let none = F::Index::splat(0);
        let [start, first_vertex, of_faces, _] = F::words(&self.attributes, F::Index::select(mask, attribute, none));
        let primitive = F::Index::select(mask, place.primitive, none);
        let [a, b, c, shape] = F::words(tables.primitives, primitive);
        let value = |i: F::Index| Rgb::of_record(F::record(&self.values, start + i));
        let of_faces = mask & of_faces.ne(none);
        let mut found = Rgb::black();
        if of_faces.any() {
            let [.., first_primitive] = F::words(tables.shapes, shape);
            found = value(primitive - first_primitive);
        }
        if !of_faces.all() {
            let [u, v] = place.weights;
            let corner = |i: F::Index| value(i - first_vertex);
            let between = corner(a) * (F::one() - u - v) + corner(b) * u + corner(c) * v;
            found = Rgb::select(of_faces, found, between);
        }
        found
    }
}
