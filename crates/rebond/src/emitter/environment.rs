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
/// high and end at a pole, where the weights of the outermost texels hold.
#[derive(Clone, Debug)]
pub struct EnvironmentImage {
    size: [u32; 2],
    texels: Vec<Record>,
    /// Luminance × sinθ of each texel, and of that to its right, below it, and both: the corners of a cell.
    corners: Vec<Record>,
    /// 1 / integral of the interpolated weight over the unit square.
    scale: f32,
    grid: Grid,
    /// Local axes in world coordinates.
    frame: [[f32; 3]; 3],
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
        let weight = |x: usize, y: usize| luminance(texels[y * w + x % w]) * sin(y);
        // Row j of cells lies between the rows j − 1 and j of texels.
        let rows = |j: usize| [j.saturating_sub(1), j.min(h - 1)];
        let corner = |i: usize| {
            let (x, [above, below]) = (i % w, rows(i / w));
            [weight(x, above), weight(x + 1, above), weight(x, below), weight(x + 1, below)]
        };
        let corners: Vec<Record> = (0..w * (h + 1)).map(|i| Record(corner(i))).collect();
        let height = |j: usize| if j == 0 || j == h { 0.5 } else { 1.0 };
        let cells: Vec<f32> =
            corners.iter().enumerate().map(|(i, c)| c.0.iter().sum::<f32>() / 4.0 * height(i / w)).collect();
        let integral = cells.iter().map(|c| f64::from(*c)).sum::<f64>() / (w * h) as f64;
        let grid = Grid::new([size[0], size[1] + 1], &cells)?;
        let solid: f64 = (0..h).map(|y| f64::from(sin(y)) * w as f64).sum();
        let mean = std::array::from_fn(|c| {
            let sum: f64 = texels.iter().enumerate().map(|(i, t)| f64::from(t[c]) * f64::from(sin(i / w))).sum();
            (sum / solid) as f32
        });
        let records = texels.iter().map(|t| Record([t[0], t[1], t[2], 0.0])).collect();
        Some(Self { size, texels: records, corners, scale: (1.0 / integral) as f32, grid, frame, mean })
    }

    fn frame<F: Real>(&self) -> Frame<F> {
        let [s, t, n] = self.frame.map(Vec3::splat);
        Frame { s, t, n }
    }

    fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>, Rgb<F>) {
        let (width, height) = (self.size[0], self.size[1]);
        let cell = self.grid.sample(u);
        let [a, b, c, d] = F::record(&self.corners, cell.y * F::Index::splat(width) + cell.x);
        // Down the cell by the sums of its edges, then across at that height.
        let down = linear(cell.u[1], a + b, c + d);
        let (left, right) = (a + (c - a) * down, b + (d - b) * down);
        let across = linear(cell.u[0], left, right);
        let density = (left + (right - left) * across) * self.scale;
        let x = (F::from_index(cell.x) + across + 0.5) * (1.0 / width as f32);
        let first = cell.y.eq(F::Index::splat(0));
        let last = cell.y.eq(F::Index::splat(height));
        let within = F::select(first, down * 0.5 + 0.5, F::select(last, down * 0.5, down));
        let y = (F::from_index(cell.y) + within - 0.5) * (1.0 / height as f32);
        let (sin_theta, cos_theta) = math::sin_cos(y * PI);
        let (sin_phi, cos_phi) = math::sin_cos((x - 0.5) * (2.0 * PI));
        let local = vec3(sin_theta * sin_phi, cos_theta, -(sin_theta * cos_phi));
        let x = x - x.floor();
        (self.frame().to_world(local), Self::density(density, sin_theta), self.radiance([x, y]))
    }

    /// Per square of the image to per solid angle: `dω = 2π² sinθ du dv`.
    fn density<F: Real>(density: F, sin_theta: F) -> PdfSolidAngle<F> {
        let pdf = density * (0.5 * FRAC_1_PI * FRAC_1_PI) / sin_theta;
        PdfSolidAngle(F::select(sin_theta.gt(F::zero()), pdf, F::zero()))
    }

    /// Radiance that arrives along −w, and the density with which [`EnvironmentImage::sample`] draws w.
    fn eval<F: Real>(&self, w: Vec3<F>) -> (Rgb<F>, PdfSolidAngle<F>) {
        let d = self.frame().to_local(w);
        let [u, v] = [math::atan2(d.x, -d.z) * (0.5 * FRAC_1_PI) + 0.5, math::acos(d.y) * FRAC_1_PI];
        let (width, height) = (self.size[0] as f32, self.size[1] as f32);
        let x = u * width - 0.5;
        let x = F::select(x.lt(F::zero()), x + width, x);
        let y = v * height + 0.5;
        let column = x.to_index().min(F::Index::splat(self.size[0] - 1));
        let row = y.relu().to_index().min(F::Index::splat(self.size[1]));
        let [a, b, c, e] = F::record(&self.corners, row * F::Index::splat(self.size[0]) + column);
        // In the outermost rows upper and lower weights are the same, so that their half height does not matter.
        let (across, down) = (x - F::from_index(column), y - F::from_index(row));
        let (left, right) = (a + (c - a) * down, b + (e - b) * down);
        let sin_theta = (d.x * d.x + d.z * d.z).sqrt();
        (self.radiance([u, v]), Self::density((left + (right - left) * across) * self.scale, sin_theta))
    }

    /// Radiance at a place of the image.
    fn radiance<F: Real>(&self, [u, v]: [F; 2]) -> Rgb<F> {
        let (width, height) = (self.size[0] as f32, self.size[1] as f32);
        let (x, y) = (u * width - 0.5, (v * height - 0.5).clamp(0.0, height - 1.0));
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let around = |x: F| {
            let x = F::select(x.lt(F::zero()), x + width, x);
            F::select(x.ge(F::splat(width)), x - width, x).to_index()
        };
        let row = |y: F| {
            let start = y.min(F::splat(height - 1.0)).to_index() * F::Index::splat(self.size[0]);
            let texel = |x: F| Rgb::of_record(F::record(&self.texels, start + around(x)));
            texel(x0) * (F::one() - fx) + texel(x0 + 1.0) * fx
        };
        row(y0) * (F::one() - fy) + row(y0 + 1.0) * fy
    }
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
            Self::Image(image) => (image.texels.len() + image.corners.len()) * size_of::<Record>() + image.grid.bytes(),
        }
    }
}
