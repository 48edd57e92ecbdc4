//! Points whose intensity over directions is an image: projectors, spots with a slide, lamps that were measured all around.
//!
//! A slide is a window of the plane at distance 1 before the point, across its local +z. Where ω meets that at (x, y), θ off the axis,
//!
//! ```text
//! I(ω) = c · texel(x, y) · beam(θ)        or, if it is the plane that is lit as the image says,    I(ω) = c · texel(x, y) / cos³θ
//! ```
//!
//! since the plane's irradiance is E = I cos³θ. Directions are drawn by their places in the window, dω = cos³θ dA, in proportion to a
//! weight that is the texel's luminance, times cos³θ in the first case, at the corners of cells, interpolated between them.
//!
//! Cells lie between the centres of four texels; those at the rim are half as wide and end there. Texels without interpolation
//! are cells themselves.

use super::EnvironmentImage;
use super::environment::between;
use crate::math::{Frame, Rgb, Vec3, luminance, vec3};
use crate::sampling::{Grid, PdfSolidAngle, linear};
use crate::texture::{TextureFilter, Wrap};
use glam::Vec3 as V;
use rebond_lanes::{Index, Mask, Real, Record, math};

/// Points along each side of a window, at least, at which its power is added up.
const POINTS: u32 = 128;

/// Intensity over directions, by an image.
#[derive(Clone, Debug)]
pub enum IntensityImage {
    /// That of a slide.
    Slide(Box<Slide>),
    /// From everywhere around: what surroundings would show from the point.
    Around(Box<EnvironmentImage>),
}

/// Where a slide is, and how light spreads behind it.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    /// Half width and half height at distance 1.
    pub extent: [f32; 2],
    /// Local axes in the world, orthonormal: the image's left and top, and where it is seen.
    pub frame: [[f32; 3]; 3],
    /// Whether the image is what the plane receives, not what leaves the point.
    pub even: bool,
    /// Half-angles of full and of no light, radians.
    pub beam: Option<[f32; 2]>,
}

/// An image in a window.
#[derive(Clone, Debug)]
pub struct Slide {
    window: Window,
    /// Of the image.
    size: [u32; 2],
    interpolated: bool,
    /// Corners of cells, row by row: [r, g, b, weight].
    corners: Vec<Record>,
    /// 1 / integral of the weight over the unit square.
    scale: f32,
    grid: Grid,
    power: [f32; 3],
}

impl Window {
    /// The place in the window's plane of one in the unit square, from its upper left corner.
    fn place<F: Real>(&self, [x, y]: [F; 2]) -> Vec3<F> {
        let [w, h] = self.extent;
        vec3((F::one() - x * 2.0) * w, (F::one() - y * 2.0) * h, F::one())
    }

    /// The factor on a texel, of which 1/cos²θ is known.
    fn factor<F: Real>(&self, r2: F) -> F {
        let beam = match self.beam {
            None => F::one(),
            Some([full, none]) => {
                let ramp = 1.0 / (none - full).max(1e-6);
                ((F::splat(none) - math::acos(r2.sqrt().recip())) * ramp).clamp(0.0, 1.0)
            }
        };
        if self.even { beam * r2 * r2.sqrt() } else { beam }
    }

    fn axes<F: Real>(&self) -> Frame<F> {
        let [s, t, n] = self.frame.map(Vec3::splat);
        Frame { s, t, n }
    }

    /// Half-angle of a cone around the axis that holds it.
    fn angle(&self) -> f32 {
        let corner = self.extent[0].hypot(self.extent[1]).atan();
        self.beam.map_or(corner, |[_, none]| corner.min(none))
    }
}

impl Slide {
    /// From linear RGB texels, row by row from the top; interpolated at the rim as `wrap` says. `None` if it is black.
    ///
    /// # Panics
    /// If there are not `size[0] · size[1]` texels.
    pub fn new(window: Window, size: [u32; 2], texels: &[[f32; 3]], filter: TextureFilter, wrap: Wrap) -> Option<Self> {
        let [w, h] = size.map(|n| n as usize);
        assert_eq!(texels.len(), w * h);
        let interpolated = filter == TextureFilter::Bilinear;
        // Along a side: the place of a corner, and the two texels whose mean is there.
        let along = |i: usize, n: usize| match i {
            _ if !interpolated => ((i as f32 + 0.5) / n as f32, [i, i]),
            0 => (0.0, [if wrap == Wrap::Repeat { n - 1 } else { 0 }, 0]),
            i if i > n => (1.0, [n - 1, if wrap == Wrap::Repeat { 0 } else { n - 1 }]),
            i => ((i as f32 - 0.5) / n as f32, [i - 1, i - 1]),
        };
        let more = if interpolated { 2 } else { 0 };
        let mut corners = Vec::with_capacity((w + more) * (h + more));
        for j in 0..h + more {
            let (v, rows) = along(j, h);
            for i in 0..w + more {
                let (u, columns) = along(i, w);
                let texel = |x: usize, y: usize| texels[rows[y] * w + columns[x]];
                let four = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
                let [r, g, b] = std::array::from_fn(|k| four.iter().map(|t| t[k]).sum::<f32>() * 0.25);
                let r2: f32 = window.place([u, v]).length_squared();
                let share = if window.even { 1.0 } else { 1.0 / (r2 * r2.sqrt()) };
                corners.push(Record([r, g, b, luminance([r, g, b]) * share]));
            }
        }
        let cells = size.map(|n| n + u32::from(interpolated));
        let mut slide =
            Self { window, size, interpolated, corners, scale: 1.0, grid: Grid::new([1, 1], &[1.0])?, power: [0.0; 3] };
        let steps = size.map(|n| POINTS.div_ceil(n));
        let (mut weights, mut sum, mut power) = (Vec::new(), 0.0, [0.0_f64; 3]);
        let solid = f64::from(4.0 * window.extent[0] * window.extent[1]) / f64::from(size[0]) / f64::from(size[1]);
        for j in 0..cells[1] {
            for i in 0..cells[0] {
                let four = slide.cell::<f32>(rebond_lanes::scalar::Index1(i), rebond_lanes::scalar::Index1(j));
                let area = slide.width(i, 0) * slide.width(j, 1);
                let weight = four.iter().map(|corner| corner[3]).sum::<f32>() / 4.0 * area;
                weights.push(weight);
                sum += f64::from(weight);
                for k in 0..steps[0] * steps[1] {
                    let at = [(k % steps[0]) as f32 + 0.5, (k / steps[0]) as f32 + 0.5];
                    let at = [0, 1].map(|side| at[side] / steps[side] as f32);
                    let (color, _) = between(&four, at[0], at[1]);
                    let place = [slide.within(i as f32, at[0], 0), slide.within(j as f32, at[1], 1)];
                    let r2: f32 = window.place(place).length_squared();
                    let factor =
                        f64::from(window.factor(r2) * area / (r2 * r2.sqrt())) * solid / f64::from(steps[0] * steps[1]);
                    power.iter_mut().zip(color.lane(0)).for_each(|(p, c)| *p += f64::from(c) * factor);
                }
            }
        }
        slide.grid = Grid::new(cells, &weights)?;
        slide.scale = (f64::from(size[0]) * f64::from(size[1]) / sum) as f32;
        slide.power = power.map(|p| p as f32);
        Some(slide)
    }

    /// Whether a column or row of cells is half as wide as a texel.
    fn is_rim<F: Real>(&self, number: F, side: usize) -> F::Mask {
        let rim = number.le(F::zero()) | number.ge(F::splat(self.size[side] as f32));
        F::Mask::splat(self.interpolated) & rim
    }

    /// Width of a cell, in texels.
    fn width(&self, number: u32, side: usize) -> f32 {
        if self.is_rim(number as f32, side) { 0.5 } else { 1.0 }
    }

    /// The place in [0, 1] along a side of one in [0, 1) along a cell.
    #[inline(always)]
    fn within<F: Real>(&self, number: F, t: F, side: usize) -> F {
        let wide = F::select(self.is_rim(number, side), t * 0.5, t);
        let start = if self.interpolated { (number - 0.5).relu() } else { number };
        (start + wide) * (1.0 / self.size[side] as f32)
    }

    /// The cell in which a place along a side is, and where in it.
    #[inline(always)]
    fn cell_at<F: Real>(&self, x: F, side: usize) -> (F::Index, F) {
        let n = self.size[side];
        let x = x * n as f32;
        let last = if self.interpolated { n } else { n - 1 };
        let shifted = if self.interpolated { x + 0.5 } else { x };
        let cell = shifted.to_index().min(F::Index::splat(last));
        let number = F::from_index(cell);
        let start = if self.interpolated { (number - 0.5).relu() } else { number };
        let t = x - start;
        (cell, F::select(self.is_rim(number, side), t * 2.0, t).clamp(0.0, 1.0))
    }

    /// The corners of a cell: upper left and right, lower left and right.
    #[inline(always)]
    fn cell<F: Real>(&self, column: F::Index, row: F::Index) -> [[F; 4]; 4] {
        let (stride, step) = if self.interpolated { (self.size[0] + 2, 1) } else { (self.size[0], 0) };
        let first = row * F::Index::splat(stride) + column;
        let corner = |n: u32| F::record(&self.corners, first + F::Index::splat(n));
        [corner(0), corner(step), corner(step * stride), corner(step * (stride + 1))]
    }

    /// Per area of the window to per solid angle.
    #[inline(always)]
    fn density<F: Real>(&self, weight: F, r2: F) -> PdfSolidAngle<F> {
        let [w, h] = self.window.extent;
        PdfSolidAngle(weight * (self.scale / (4.0 * w * h)) * r2 * r2.sqrt())
    }

    #[inline(always)]
    fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>, Rgb<F>) {
        let cell = self.grid.sample(u);
        let corners = self.cell(cell.x, cell.y);
        let (a, b, c, d) = (corners[0][3], corners[1][3], corners[2][3], corners[3][3]);
        let down = linear(cell.u[1], a + b, c + d);
        let across = linear(cell.u[0], a + (c - a) * down, b + (d - b) * down);
        let (color, weight) = between(&corners, across, down);
        let place = [self.within(F::from_index(cell.x), across, 0), self.within(F::from_index(cell.y), down, 1)];
        let local = self.window.place(place);
        let r2 = local.length_squared();
        let w = self.window.axes().to_world(local * r2.sqrt().recip());
        (w, self.density(weight, r2), color * self.window.factor(r2))
    }

    #[inline(always)]
    fn eval<F: Real>(&self, w: Vec3<F>) -> (Rgb<F>, PdfSolidAngle<F>) {
        let local = self.window.axes().to_local(w);
        let across = |x: F, extent: f32| (F::one() - x / local.z * extent.recip()) * 0.5;
        let [x, y] = [across(local.x, self.window.extent[0]), across(local.y, self.window.extent[1])];
        let unit = |x: F| x.ge(F::zero()) & x.le(F::one());
        let lit = local.z.gt(F::zero()) & unit(x) & unit(y);
        let inside = |x: F| F::select(lit, x, F::zero());
        let ((column, across), (row, down)) = (self.cell_at(inside(x), 0), self.cell_at(inside(y), 1));
        let (color, weight) = between(&self.cell(column, row), across, down);
        let r2 = F::select(lit, (local.z * local.z).recip(), F::one());
        let pdf = self.density(weight, r2);
        ((color * self.window.factor(r2)).masked(lit), PdfSolidAngle(F::select(lit, pdf.0, F::zero())))
    }
}

impl IntensityImage {
    /// A direction in which there is light, its density, and the intensity in it.
    #[inline]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> (Vec3<F>, PdfSolidAngle<F>, Rgb<F>) {
        match self {
            Self::Slide(slide) => slide.sample(u),
            Self::Around(image) => image.sample(u),
        }
    }

    /// Intensity in the unit direction `w`, and the density with which [`IntensityImage::sample`] draws that.
    #[inline]
    pub fn eval<F: Real>(&self, w: Vec3<F>) -> (Rgb<F>, PdfSolidAngle<F>) {
        match self {
            Self::Slide(slide) => slide.eval(w),
            Self::Around(image) => image.eval(w),
        }
    }

    /// Power in W, nearly.
    pub fn power(&self) -> [f32; 3] {
        match self {
            Self::Slide(slide) => slide.power,
            Self::Around(image) => image.mean().map(|x| 4.0 * std::f32::consts::PI * x),
        }
    }

    /// Axis and half-angle of a cone that holds all directions with light.
    pub fn cone(&self) -> (V, f32) {
        match self {
            Self::Slide(slide) => (V::from(slide.window.frame[2]), slide.window.angle()),
            Self::Around(_) => (V::Z, std::f32::consts::PI),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Slide(slide) => slide.corners.len() * size_of::<Record>() + slide.grid.bytes(),
            Self::Around(image) => image.bytes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIGNIFICANCE, chi2_directions, chi2_square, seeded_pairs, t_test_p_value};

    const FRAME: [[f32; 3]; 3] = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]];

    fn slides() -> Vec<(&'static str, IntensityImage)> {
        let texels: Vec<[f32; 3]> = (0..20).map(|i| [(i * 7 % 11) as f32, (i * 5 % 4) as f32, 0.2]).collect();
        let window = |even, beam| Window { extent: [1.2, 0.7], frame: FRAME, even, beam };
        let slide = |window, filter, wrap| {
            let slide = Slide::new(window, [5, 4], &texels, filter, wrap);
            IntensityImage::Slide(Box::new(slide.expect("light")))
        };
        let (bilinear, nearest) = (TextureFilter::Bilinear, TextureFilter::Nearest);
        let around = EnvironmentImage::new([5, 4], &texels, FRAME).expect("light");
        vec![
            ("a plane, repeated", slide(window(true, None), bilinear, Wrap::Repeat)),
            ("a plane of squares", slide(window(true, None), nearest, Wrap::Clamp)),
            ("intensities", slide(window(false, None), bilinear, Wrap::Clamp)),
            ("intensities in a beam", slide(window(false, Some([0.3, 0.7])), bilinear, Wrap::Clamp)),
            ("squares in a beam", slide(window(false, Some([0.3, 0.7])), nearest, Wrap::Repeat)),
            ("all around", IntensityImage::Around(Box::new(around))),
        ]
    }

    /// χ² of directions, in the window or all around, and what is said of a direction as of a sample.
    #[test]
    fn directions_follow_their_densities() {
        let frame = Frame { s: Vec3::splat(FRAME[0]), t: Vec3::splat(FRAME[1]), n: Vec3::splat(FRAME[2]) };
        for (name, image) in slides() {
            let mut strays = 0;
            for u in seeded_pairs(2000, 4) {
                let (w, pdf, color) = image.sample::<f32>(u);
                let (again, density) = image.eval(w);
                let same = |a: f32, b: f32| (a - b).abs() <= 2e-3 * b.abs().max(0.05);
                // At the edges of squares and of the window rounding decides.
                strays += usize::from(!(same(density.0, pdf.0) && same(again.r, color.r) && same(again.g, color.g)));
            }
            assert!(strays <= 4, "{name}: {strays}");
            let IntensityImage::Slide(slide) = &image else {
                let drawn = |u| Some(frame.to_local(image.sample::<f32>(u).0));
                chi2_directions(name, drawn, |w| image.eval::<f32>(frame.to_world(w)).1.0);
                continue;
            };
            let [w, h] = slide.window.extent;
            let place = |u| {
                let d = frame.to_local(image.sample::<f32>(u).0);
                [0.5 - 0.5 * d.x / (d.z * w), 0.5 - 0.5 * d.y / (d.z * h)]
            };
            let density = |p| {
                let d: Vec3<f32> = slide.window.place(p);
                let cos = d.length().recip();
                image.eval(frame.to_world(d * cos)).1.0 * cos.powi(3) * 4.0 * w * h
            };
            chi2_square(name, place, density);
        }
    }

    /// The mean weight is the integral of the intensity, and that is the power said.
    #[test]
    fn weights_are_power() {
        for (name, image) in slides() {
            let n = 1500;
            let mut sum = [0.0_f64; 3];
            for i in 0..2 * n * n {
                let (z, phi) =
                    (1.0 - (f64::from(i / (2 * n)) + 0.5) * 2.0 / f64::from(n), f64::from(i % (2 * n)) + 0.5);
                let (phi, r) = (phi / f64::from(n) * std::f64::consts::PI, (1.0 - z * z).sqrt());
                let w = Vec3::<f32>::splat([r * phi.cos(), r * phi.sin(), z].map(|x| x as f32));
                let value = image.eval(w).0.lane(0);
                (0..3).for_each(|k| sum[k] += f64::from(value[k]));
            }
            let integral = sum.map(|s| s * 2.0 * std::f64::consts::PI / f64::from(n * n));
            for (power, integral) in image.power().into_iter().zip(integral) {
                // Those from around are by their texels.
                let most = if name == "all around" { 0.1 } else { 3e-3 };
                assert!((f64::from(power) / integral - 1.0).abs() < most, "{name}: {power} for {integral}");
            }
            let weights: Vec<f64> = seeded_pairs(40_000, 1)
                .map(|u| {
                    let (_, pdf, color) = image.sample::<f32>(u);
                    f64::from(color.g / pdf.0)
                })
                .collect();
            let p = t_test_p_value(&weights, integral[1]);
            assert!(p > SIGNIFICANCE, "{name}: p {p} for {}", integral[1]);
        }
    }

    /// A plane that is lit alike by a white slide, closed forms of its power, and where its corners are.
    #[test]
    fn slides_are_where_they_belong() {
        let window = Window { extent: [1.2, 0.7], frame: FRAME, even: true, beam: None };
        let slide = |size, texels: &[[f32; 3]], filter, wrap| {
            let slide = Slide::new(window, size, texels, filter, wrap).expect("light");
            IntensityImage::Slide(Box::new(slide))
        };
        let toward = |x: f32, y: f32| {
            let local = Vec3::<f32>::splat([x, y, 1.0]);
            window.axes().to_world(local.normalized())
        };
        let white = slide([1, 1], &[[2.0; 3]], TextureFilter::Bilinear, Wrap::Clamp);
        for [x, y] in [[0.0, 0.0], [1.1, 0.6], [-0.4, 0.5]] {
            // E = I cos³θ.
            let cos = 1.0 / (1.0 + x * x + y * y).sqrt();
            assert!((white.eval(toward(x, y)).0.r * cos.powi(3) - 2.0).abs() < 1e-4);
        }
        assert!((white.power()[0] / (2.0 * 4.0 * 1.2 * 0.7) - 1.0).abs() < 1e-5);
        for outside in [toward(1.21, 0.0), toward(0.0, -0.71), -toward(0.0, 0.0)] {
            assert_eq!(white.eval(outside).0.r, 0.0);
        }
        // Top row 1, 2; bottom row 3, 4: +x is to the left.
        let texels = [1.0, 2.0, 3.0, 4.0].map(|x| [x; 3]);
        let flat = |image: &IntensityImage, x: f32, y: f32| {
            let r2 = 1.0 + x * x + y * y;
            image.eval(toward(x, y)).0.r / (r2 * r2.sqrt())
        };
        let squares = slide([2, 2], &texels, TextureFilter::Nearest, Wrap::Clamp);
        for (want, [x, y]) in [(1.0, [0.2, 0.1]), (2.0, [-1.1, 0.6]), (3.0, [0.1, -0.1]), (4.0, [-0.5, -0.5])] {
            assert!((flat(&squares, x, y) - want).abs() < 1e-4, "{want}");
        }
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-3, "{a} for {b}");
        let clamped = slide([2, 2], &texels, TextureFilter::Bilinear, Wrap::Clamp);
        close(flat(&clamped, 0.0, 0.0), 2.5);
        close(flat(&clamped, 1.1999, 0.35), 1.0);
        close(flat(&clamped, 0.6, 0.0), 2.0);
        let repeated = slide([2, 2], &texels, TextureFilter::Bilinear, Wrap::Repeat);
        close(flat(&repeated, 1.1999, 0.35), 1.5);
        close(flat(&repeated, 0.9, 0.35), 1.25);
        assert!(Slide::new(window, [1, 1], &[[0.0; 3]], TextureFilter::Nearest, Wrap::Clamp).is_none());
    }
}
