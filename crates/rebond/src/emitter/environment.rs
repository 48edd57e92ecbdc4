//! Light from infinitely far: the same from everywhere, or an equirectangular image.

use crate::math::{Frame, Rgb, Vec3, luminance, vec3};
use crate::sampling::warp::{uniform_sphere, uniform_sphere_pdf};
use crate::sampling::{Grid, PdfSolidAngle, linear};
use rebond_lanes::{Index, Real, Record, math};
use std::f32::consts::{FRAC_1_PI, PI};

/// The surroundings of a scene.
#[derive(Clone, Debug)]
pub enum Environment {
    /// The same radiance from everywhere.
    Constant([f32; 3]),
    /// An image.
    Image(Box<EnvironmentImage>),
}

/// An equirectangular image around the scene: its centre towards local −z, its top towards local +y; interpolated
/// linearly, and sampled in proportion to luminance × solid angle, interpolated likewise.
///
/// A cell of the sampling grid lies between the centres of four texels; those of the first and last row are half as
/// high and end at a pole, where the outermost texels hold.
#[derive(Clone, Debug)]
pub struct EnvironmentImage {
    size: [u32; 2],
    /// The corners of the cells, `size[0] + 1` to a row: the texels, with the outermost rows and the first column
    /// again. [r, g, b, weight].
    corners: Vec<Record>,
    /// 1 / integral of the interpolated weight over the unit square.
    scale: f32,
    grid: Grid,
    /// Local axes in world coordinates.
    pub(super) frame: [[f32; 3]; 3],
    mean: [f32; 3],
}

impl EnvironmentImage {
    /// From linear RGB texels, row by row from the top, and the local axes in the world (orthonormal). `None` if it is
    /// black.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` texels.
    pub fn new(size: [u32; 2], texels: &[[f32; 3]], frame: [[f32; 3]; 3]) -> Option<Self> {
        let (w, h) = (size[0] as usize, size[1] as usize);
        assert_eq!(texels.len(), w * h);
        let sin = |y: usize| (PI * (y as f32 + 0.5) / h as f32).sin();
        let corner = |i: usize| {
            let (x, y) = (i % (w + 1) % w, (i / (w + 1)).saturating_sub(1).min(h - 1));
            let [r, g, b] = texels[y * w + x];
            Record([r, g, b, luminance([r, g, b]) * sin(y)])
        };
        let corners: Vec<Record> = (0..(w + 1) * (h + 2)).map(corner).collect();
        let weight = |i: usize| corners[i].0[3];
        let cell = |i: usize| {
            let (x, y) = (i % w, i / w);
            let first = y * (w + 1) + x;
            let sum = weight(first) + weight(first + 1) + weight(first + w + 1) + weight(first + w + 2);
            sum / 4.0 * if y == 0 || y == h { 0.5 } else { 1.0 }
        };
        let cells: Vec<f32> = (0..w * (h + 1)).map(cell).collect();
        let integral = cells.iter().map(|c| f64::from(*c)).sum::<f64>() / (w * h) as f64;
        let grid = Grid::new([size[0], size[1] + 1], &cells)?;
        let solid: f64 = (0..h).map(|y| f64::from(sin(y)) * w as f64).sum();
        let mean = std::array::from_fn(|c| {
            let sum: f64 = texels.iter().enumerate().map(|(i, t)| f64::from(t[c]) * f64::from(sin(i / w))).sum();
            (sum / solid) as f32
        });
        Some(Self { size, corners, scale: (1.0 / integral) as f32, grid, frame, mean })
    }

    /// Mean over all directions.
    pub(super) fn mean(&self) -> [f32; 3] {
        self.mean
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.corners.len() * size_of::<Record>() + self.grid.bytes()
    }

    pub(super) fn frame<F: Real>(&self) -> Frame<F> {
        let [s, t, n] = self.frame.map(Vec3::splat);
        Frame { s, t, n }
    }

    /// The corners of a cell: upper left and right, lower left and right.
    #[inline(always)]
    fn cell<F: Real>(&self, column: F::Index, row: F::Index) -> [[F; 4]; 4] {
        let first = row * F::Index::splat(self.size[0] + 1) + column;
        let corner = |n: u32| F::record(&self.corners, first + F::Index::splat(n));
        [corner(0), corner(1), corner(self.size[0] + 1), corner(self.size[0] + 2)]
    }

    /// A direction, its density, and the radiance that arrives against it.
    #[inline(always)]
    pub(super) fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>, Rgb<F>) {
        let (width, height) = (self.size[0], self.size[1]);
        let cell = self.grid.sample(u);
        let corners = self.cell(cell.x, cell.y);
        let (a, b, c, d) = (corners[0][3], corners[1][3], corners[2][3], corners[3][3]);
        // Down the cell by the sums of its edges, then across at that height.
        let down = linear(cell.u[1], a + b, c + d);
        let across = linear(cell.u[0], a + (c - a) * down, b + (d - b) * down);
        let (radiance, weight) = between(&corners, across, down);
        let x = (F::from_index(cell.x) + across + 0.5) * (1.0 / width as f32);
        let first = cell.y.eq(F::Index::splat(0));
        let last = cell.y.eq(F::Index::splat(height));
        let within = F::select(first, down * 0.5 + 0.5, F::select(last, down * 0.5, down));
        let y = (F::from_index(cell.y) + within - 0.5) * (1.0 / height as f32);
        let (sin_theta, cos_theta) = math::sin_cos(y * PI);
        let (sin_phi, cos_phi) = math::sin_cos((x - 0.5) * (2.0 * PI));
        let local = vec3(sin_theta * sin_phi, cos_theta, -(sin_theta * cos_phi));
        (self.frame().to_world(local), self.density(weight, sin_theta), radiance)
    }

    /// Per square of the image to per solid angle: `dω = 2π² sinθ du dv`.
    #[inline(always)]
    fn density<F: Real>(&self, weight: F, sin_theta: F) -> PdfSolidAngle<F> {
        let pdf = weight * (self.scale * 0.5 * FRAC_1_PI * FRAC_1_PI) / sin_theta;
        PdfSolidAngle(F::select(sin_theta.gt(F::zero()), pdf, F::zero()))
    }

    /// Radiance that arrives along −w, and the density with which [`EnvironmentImage::sample`] draws w.
    #[inline(always)]
    pub(super) fn eval<F: Real>(&self, w: Vec3<F>) -> (Rgb<F>, PdfSolidAngle<F>) {
        let d = self.frame().to_local(w);
        let [u, v] = [math::atan2(d.x, -d.z) * (0.5 * FRAC_1_PI) + 0.5, math::acos(d.y) * FRAC_1_PI];
        let (width, height) = (self.size[0] as f32, self.size[1] as f32);
        let x = u * width - 0.5;
        let x = F::select(x.lt(F::zero()), x + width, x);
        let y = v * height + 0.5;
        let column = x.to_index().min(F::Index::splat(self.size[0] - 1));
        let row = y.relu().to_index().min(F::Index::splat(self.size[1]));
        // In the outermost rows upper and lower corners are the same, so that their half height does not matter.
        let (across, down) = (x - F::from_index(column), y - F::from_index(row));
        let (radiance, weight) = between(&self.cell(column, row), across, down);
        (radiance, self.density(weight, (d.x * d.x + d.z * d.z).sqrt()))
    }
}

/// Radiance and weight at a place of a cell.
#[inline(always)]
pub(super) fn between<F: Real>([a, b, c, d]: &[[F; 4]; 4], across: F, down: F) -> (Rgb<F>, F) {
    let at = |k: usize| {
        let (left, right) = (a[k] + (c[k] - a[k]) * down, b[k] + (d[k] - b[k]) * down);
        left + (right - left) * across
    };
    (Rgb::new(at(0), at(1), at(2)), at(3))
}

impl Environment {
    /// Radiance averaged over all directions.
    pub fn mean(&self) -> [f32; 3] {
        match self {
            Self::Constant(c) => *c,
            Self::Image(image) => image.mean,
        }
    }

    /// A direction in which there is light, its density, and the radiance that arrives against it.
    #[inline]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>, Rgb<F>) {
        match self {
            Self::Constant(c) => (uniform_sphere(u), uniform_sphere_pdf(), Rgb::splat(*c)),
            Self::Image(image) => image.sample(u),
        }
    }

    /// Radiance that arrives along −w, and the density with which [`Environment::sample`] draws w.
    #[inline]
    pub fn eval<F: Real>(&self, w: Vec3<F>) -> (Rgb<F>, PdfSolidAngle<F>) {
        match self {
            Self::Constant(c) => (Rgb::splat(*c), uniform_sphere_pdf()),
            Self::Image(image) => image.eval(w),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Constant(_) => 0,
            Self::Image(image) => image.bytes(),
        }
    }
}
