//! Light from infinitely far: the same from everywhere, or an equirectangular image.

use crate::math::{Frame, Rgb, Vec3, luminance, vec3};
use crate::sampling::{Grid, PdfSolidAngle};
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
/// linearly, and sampled in proportion to luminance × solid angle.
#[derive(Clone, Debug)]
pub struct EnvironmentImage {
    size: [u32; 2],
    texels: Vec<Record>,
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
        // The weight of a cell is the mean of the interpolated luminance over it, so that none is 0 where there is light.
        let l = |x: usize, y: isize| luminance(texels[y.clamp(0, h as isize - 1) as usize * w + x % w]);
        let row = |x: usize, y: isize| (l(x + w - 1, y) + 6.0 * l(x, y) + l(x + 1, y)) / 8.0;
        let weight = |x: usize, y: usize| {
            let y0 = y as isize;
            (row(x, y0 - 1) + 6.0 * row(x, y0) + row(x, y0 + 1)) / 8.0 * sin(y)
        };
        let weights: Vec<f32> = (0..w * h).map(|i| weight(i % w, i / w)).collect();
        let solid: f64 = (0..h).map(|y| f64::from(sin(y)) * w as f64).sum();
        let mean = std::array::from_fn(|c| {
            let sum: f64 = texels.iter().enumerate().map(|(i, t)| f64::from(t[c]) * f64::from(sin(i / w))).sum();
            (sum / solid) as f32
        });
        let records = texels.iter().map(|t| Record([t[0], t[1], t[2], 0.0])).collect();
        Some(Self { size, texels: records, grid: Grid::new(size, &weights)?, frame, mean })
    }

    fn frame<F: Real>(&self) -> Frame<F> {
        let [s, t, n] = self.frame.map(Vec3::splat);
        Frame { s, t, n }
    }

    fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>) {
        let ([u, v], density) = self.grid.sample(u);
        let (sin_theta, cos_theta) = math::sin_cos(v * PI);
        let (sin_phi, cos_phi) = math::sin_cos((u - 0.5) * (2.0 * PI));
        let local = vec3(sin_theta * sin_phi, cos_theta, -(sin_theta * cos_phi));
        (self.frame().to_world(local), Self::density(density, sin_theta))
    }

    /// Per square of the image to per solid angle: `dω = 2π² sinθ du dv`.
    fn density<F: Real>(density: F, sin_theta: F) -> PdfSolidAngle<F> {
        let pdf = density * (0.5 * FRAC_1_PI * FRAC_1_PI) / sin_theta;
        PdfSolidAngle(F::select(sin_theta.gt(F::zero()), pdf, F::zero()))
    }

    fn place<F: Real>(&self, w: Vec3<F>) -> [F; 2] {
        let d = self.frame().to_local(w);
        [math::atan2(d.x, -d.z) * (0.5 * FRAC_1_PI) + 0.5, math::acos(d.y) * FRAC_1_PI]
    }

    fn pdf<F: Real>(&self, w: Vec3<F>) -> PdfSolidAngle<F> {
        let p = self.place(w);
        Self::density(self.grid.pdf(p), math::sin_cos(p[1] * PI).0)
    }

    fn radiance<F: Real>(&self, w: Vec3<F>) -> Rgb<F> {
        let [u, v] = self.place(w);
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

    /// A direction in which there is light, and its density.
    #[inline]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>) {
        match self {
            Self::Constant(_) => {
                (crate::sampling::warp::uniform_sphere(u), crate::sampling::warp::uniform_sphere_pdf())
            }
            Self::Image(image) => image.sample(u),
        }
    }

    /// Density of [`Environment::sample`].
    #[inline]
    pub fn pdf<F: Real>(&self, w: Vec3<F>) -> PdfSolidAngle<F> {
        match self {
            Self::Constant(_) => crate::sampling::warp::uniform_sphere_pdf(),
            Self::Image(image) => image.pdf(w),
        }
    }

    /// Radiance that arrives along −w.
    #[inline]
    pub fn radiance<F: Real>(&self, w: Vec3<F>) -> Rgb<F> {
        match self {
            Self::Constant(c) => Rgb::splat(*c),
            Self::Image(image) => image.radiance(w),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Constant(_) => 0,
            Self::Image(image) => image.texels.len() * size_of::<Record>() * 2,
        }
    }
}
