//! Measurements on a grid that follows the lobe, as the RGL database has them (Dupuy and Jakob 2018).
//!
//! For some directions ωo of the viewer, values stand on a grid over the unit square. Its point s belongs to the half
//! vector m for which
//!
//! ```text
//! u(m) = (√(2θm/π), φm/2π + ½),   φm − φo in place of φm where the material is isotropic
//! s = (∫₀^x p(x', y) dx' / ∫₀¹ p(x', y) dx',  ∫₀^y ∫₀¹ p(x', y') dx' dy')   at (x, y) = u(m)
//! ```
//!
//! with p the visible normals seen from ωo, bilinear between their samples and normalised: where there are many, samples
//! are dense. There
//!
//! ```text
//! f_r cosθi = c(s) D(u(m)) / (4 σ(u(ωo)))        c alone if the file says so; D the normals, σ their projected area
//! ```
//!
//! Between the ωo that were measured, p and c are interpolated linearly in φo and θo; beyond them they stay as they are.
//! Materials whose φo span a half or a quarter of a turn, from −180° on, repeat or mirror themselves.
//!
//! In memory a normal takes 16 bytes, and so does a colour.

use super::{Between, Tables, check_values, tilt, turn};
use crate::math::{Rgb, Vec3, vec3};
use rebond_lanes::{Index, Mask, Real, Record};
use std::f32::consts::PI;

/// Values on grids of one size, the first side varying fastest; one grid, or one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid2<T> {
    /// Samples along the sides, the outer ones on the edges of the unit square.
    pub size: [u32; 2],
    /// The values.
    pub values: Vec<T>,
}

/// The table.
#[derive(Clone, Debug, PartialEq)]
pub struct AdaptiveTable {
    theta: Vec<f32>,
    phi: Vec<f32>,
    normals: Grid2<f32>,
    area: Grid2<f32>,
    visible: Grid2<f32>,
    color: Grid2<[f32; 3]>,
    jacobian: bool,
    /// Parts of a turn that the φ span: 1, 2 or 4.
    reduction: u32,
}

impl AdaptiveTable {
    /// A table for viewers at angles `theta` and `phi` (radians): D, σ, and p and c, a grid each for every θ of every φ.
    ///
    /// # Errors
    /// If sizes do not fit, angles do not grow, a value is negative or not finite, or normals are nowhere.
    pub fn new(
        theta: Vec<f32>,
        phi: Vec<f32>,
        normals: Grid2<f32>,
        area: Grid2<f32>,
        visible: Grid2<f32>,
        color: Grid2<[f32; 3]>,
        jacobian: bool,
    ) -> Result<Self, String> {
        for (name, angles) in [("theta_i", &theta), ("phi_i", &phi)] {
            if angles.is_empty() || angles.len() > 1 << 12 {
                return Err(format!("{name} has {} angles; a table has from 1 to 4096", angles.len()));
            }
            if !angles.iter().all(|a| a.is_finite()) || !angles.windows(2).all(|w| w[0] < w[1]) {
                return Err(format!("the angles of {name} do not grow from one to the next"));
            }
        }
        let reduction = match phi.len() {
            0..=2 => 1,
            n => match (2.0 * PI / (phi[n - 1] - phi[0])).round() {
                1.0 => 1,
                2.0 => 2,
                4.0 => 4,
                _ => return Err("phi_i spans neither a whole turn nor a half or a quarter of one".into()),
            },
        };
        let grids = theta.len() * phi.len();
        let sizes = [
            ("ndf", normals.size, normals.values.len(), 1, 1),
            ("sigma", area.size, area.values.len(), 1, 1),
            ("vndf", visible.size, visible.values.len(), grids, 2),
            ("the colours", color.size, color.values.len(), grids, 1),
        ];
        for (name, [x, y], found, grids, least) in sizes {
            let wanted = u64::from(x) * u64::from(y);
            if x < least || y < least || wanted.checked_mul(grids as u64) != Some(found as u64) || found > 1 << 28 {
                return Err(format!("{name}: {found} values for {grids} × {y} × {x}"));
            }
        }
        check_values("ndf", &normals.values)?;
        check_values("sigma", &area.values)?;
        check_values("vndf", &visible.values)?;
        check_values("the colours", color.values.as_flattened())?;
        if jacobian && area.values.iter().all(|v| *v == 0.0) {
            return Err("sigma is 0 everywhere".into());
        }
        let cells = visible.values.chunks((visible.size[0] * visible.size[1]) as usize);
        if let Some(grid) = cells.enumerate().find_map(|(i, c)| c.iter().all(|v| *v == 0.0).then_some(i)) {
            return Err(format!("vndf is 0 everywhere in grid {grid}"));
        }
        Ok(Self { theta, phi, normals, area, visible, color, jacobian, reduction })
    }

    /// Whether half vectors count from the viewer's azimuth.
    pub fn is_isotropic(&self) -> bool {
        self.phi.len() <= 2
    }

    /// Bytes of its numbers.
    pub fn bytes(&self) -> usize {
        let grids = [&self.normals.values, &self.area.values, &self.visible.values];
        grids.iter().map(|v| size_of_val(&***v)).sum::<usize>() + size_of_val(&*self.color.values)
    }

    /// Returns the steps that searching its angles takes.
    pub(super) fn store(&self, heads: &mut Vec<Record>, values: &mut Vec<Record>) -> u32 {
        let (np, nt) = (self.phi.len() as u32, self.theta.len() as u32);
        let mut starts = [0; 7];
        let mut part = |i: usize, records: &mut dyn Iterator<Item = Record>| {
            starts[i] = values.len() as u32;
            values.extend(records);
        };
        let number = |x: &f32| Record([*x, 0.0, 0.0, 0.0]);
        part(0, &mut self.phi.iter().map(number));
        part(1, &mut self.theta.iter().map(number));
        part(2, &mut cells(&self.normals));
        part(3, &mut cells(&self.area));
        let (grid, rows) = self.visible_normals();
        part(4, &mut grid.into_iter());
        part(5, &mut rows.iter().map(number));
        part(6, &mut self.color.values.iter().map(|c| Record([c[0], c[1], c[2], 0.0])));
        let flags = self.reduction | if self.jacobian { JACOBIAN } else { 0 };
        heads.push(Record::words([np, nt, flags, 0]));
        let sizes = [self.normals.size, self.area.size, self.visible.size, self.color.size];
        heads.push(Record::words([sizes[0][0], sizes[0][1], sizes[1][0], sizes[1][1]]));
        heads.push(Record::words([sizes[2][0], sizes[2][1], sizes[3][0], sizes[3][1]]));
        heads.push(Record::words([starts[0], starts[1], starts[2], starts[3]]));
        heads.push(Record::words([starts[4], starts[5], starts[6], 0]));
        np.max(nt).next_power_of_two().ilog2()
    }

    /// [p, p of the next column, ∫ p along the row up to here, ∫ p along the whole row] for each sample, and the share of
    /// the rows before each row.
    fn visible_normals(&self) -> (Vec<Record>, Vec<f32>) {
        let [nx, ny] = self.visible.size.map(|n| n as usize);
        let (dx, dy) = (1.0 / (nx - 1) as f64, 1.0 / (ny - 1) as f64);
        let (mut samples, mut rows) = (Vec::with_capacity(self.visible.values.len()), Vec::new());
        for grid in self.visible.values.chunks(nx * ny) {
            let mut up_to = vec![0.0_f64; nx * ny];
            for (sums, row) in up_to.chunks_mut(nx).zip(grid.chunks(nx)) {
                for i in 1..nx {
                    sums[i] = sums[i - 1] + 0.5 * dx * (f64::from(row[i - 1]) + f64::from(row[i]));
                }
            }
            let whole = |r: usize| up_to[r * nx + nx - 1];
            let total: f64 = (1..ny).map(|r| 0.5 * dy * (whole(r - 1) + whole(r))).sum();
            let mut before = 0.0;
            for r in 0..ny {
                rows.push((before / total) as f32);
                before += 0.5 * dy * (whole(r) + whole((r + 1).min(ny - 1)));
                for c in 0..nx {
                    let p = |c: usize| f64::from(grid[r * nx + c.min(nx - 1)]);
                    let numbers = [p(c), p(c + 1), up_to[r * nx + c], whole(r)];
                    samples.push(Record(numbers.map(|x| (x / total) as f32)));
                }
            }
        }
        (samples, rows)
    }
}

const JACOBIAN: u32 = 8;

/// Each sample with its neighbours: to the right, above, and both.
fn cells(grid: &Grid2<f32>) -> impl Iterator<Item = Record> {
    let [nx, ny] = grid.size.map(|n| n as usize);
    let at = move |x: usize, y: usize| grid.values[y.min(ny - 1) * nx + x.min(nx - 1)];
    (0..nx * ny).map(move |i| {
        let (x, y) = (i % nx, i / nx);
        Record([at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)])
    })
}

/// A value of a grid that [`cells`] wrote.
#[inline(always)]
fn bilinear<F: Real>(tables: &Tables, start: F::Index, size: [F::Index; 2], u: [F; 2]) -> F {
    let (x, y) = (edge_to_edge(u[0], size[0]), edge_to_edge(u[1], size[1]));
    let [a, b, c, d] = F::record(&tables.values, start + y.at[0] * size[0] + x.at[0]);
    (a * x.weight[0] + b * x.weight[1]) * y.weight[0] + (c * x.weight[0] + d * x.weight[1]) * y.weight[1]
}

#[inline(always)]
fn edge_to_edge<F: Real>(u: F, n: F::Index) -> Between<F> {
    Between::clamped(u * (F::from_index(n) - 1.0), n)
}

/// Where an angle stands in a list of them.
#[inline(always)]
fn search<F: Real>(tables: &Tables, start: F::Index, n: F::Index, angle: F) -> Between<F> {
    let angle_at = |i: F::Index| F::record(&tables.values, start + i)[0];
    let mut i = F::Index::splat(0);
    for step in (0..tables.search_steps).rev() {
        let next = i + F::Index::splat(1 << step);
        let further = next.lt(n) & angle_at(next).le(angle);
        i = F::Index::select(further, next, i);
    }
    let next = (i + F::Index::splat(1)).min(n - F::Index::splat(1));
    let (a, b) = (angle_at(i), angle_at(next));
    let part = F::select(b.gt(a), (angle - a) / (b - a), F::zero()).clamp(0.0, 1.0);
    Between { at: [i, next], weight: [F::one() - part, part] }
}

#[inline(always)]
pub(super) fn f<F: Real>(tables: &Tables, table: F::Index, light: Vec3<F>, viewer: Vec3<F>) -> Rgb<F> {
    let head = |n: u32| tables.head::<F>(table, n);
    let (one, is) = (F::Index::splat(1), |bits: F::Index, b: u32| (bits & F::Index::splat(b)).ne(F::Index::splat(0)));
    let isotropic = head(0)[2].ne(F::Index::splat(0));
    let [n_phi, n_theta, flags, _] = head(1);
    let [normals_x, normals_y, area_x, area_y] = head(2);
    let [visible_x, visible_y, color_x, color_y] = head(3);
    let [phi_start, theta_start, normals_start, area_start] = head(4);
    let [visible_start, rows_start, color_start, _] = head(5);

    // Into the part of the turn that was measured.
    let down = |x: F| F::one().copy_sign(-x);
    let (half, quarter) = (is(flags, 2), is(flags, 4));
    let y_sign = F::select(half | quarter, down(viewer.y), F::one());
    let x_sign = F::select(quarter, down(viewer.x), F::select(half, y_sign, F::one()));
    let fold = |w: Vec3<F>| vec3(w.x * x_sign, w.y * y_sign, w.z);
    let (light, viewer) = (fold(light), fold(viewer));

    let m = (light + viewer).normalized();
    let (tilt_o, turn_o) = (tilt(viewer), turn(viewer));
    let turn_m = F::select(isotropic, turn(m) - turn_o, turn(m)) + 0.5;
    let u = [tilt(m).sqrt(), turn_m - turn_m.floor()];
    let phi = search(tables, phi_start, n_phi, turn_o * (2.0 * PI));
    let theta = search(tables, theta_start, n_theta, tilt_o * (0.5 * PI));
    let corner = |k: usize| (phi.at[k / 2] * n_theta + theta.at[k % 2], phi.weight[k / 2] * theta.weight[k % 2]);
    let corners: &[usize] = if n_phi.eq(one).all() { &[0, 1] } else { &[0, 1, 2, 3] };
    let share = |k: usize| if corners.len() == 2 { theta.weight[k] } else { corner(k).1 };

    // s: how much of p comes before u.
    let cell = |u: F, n: F::Index| {
        let x = u * (F::from_index(n) - 1.0);
        let i = x.to_index().min(n - F::Index::splat(2));
        (i, x - F::from_index(i))
    };
    let ((column, x), (row, y)) = (cell(u[0], visible_x), cell(u[1], visible_y));
    let zero = F::zero();
    let (mut lower, mut upper, mut before) = ([zero; 4], [zero; 4], zero);
    for &k in corners {
        let (grid, weight) = (corner(k).0, share(k));
        let rows = grid * visible_y + row;
        let at = visible_start + rows * visible_x + column;
        let (a, b) = (F::record(&tables.values, at), F::record(&tables.values, at + visible_x));
        for i in 0..4 {
            lower[i] += a[i] * weight;
            upper[i] += b[i] * weight;
        }
        before += F::record(&tables.values, rows_start + rows)[0] * weight;
    }
    let mix = |i: usize| lower[i] + (upper[i] - lower[i]) * y;
    let (width, height) = ((F::from_index(visible_x) - 1.0).recip(), (F::from_index(visible_y) - 1.0).recip());
    let whole = mix(3);
    let so_far = mix(2) + (mix(0) + (mix(1) - mix(0)) * x * 0.5) * x * width;
    let s = [
        F::select(whole.gt(zero), so_far / whole, zero).clamp(0.0, 1.0),
        (before + (lower[3] + (upper[3] - lower[3]) * y * 0.5) * y * height).clamp(0.0, 1.0),
    ];

    let (x, y) = (edge_to_edge(s[0], color_x), edge_to_edge(s[1], color_y));
    let mut color = Rgb::black();
    for &k in corners {
        let grid = color_start + corner(k).0 * color_x * color_y;
        for j in [0, 1] {
            for i in [0, 1] {
                let value = F::record(&tables.values, grid + y.at[j] * color_x + x.at[i]);
                color += Rgb::of_record(value) * (share(k) * y.weight[j] * x.weight[i]);
            }
        }
    }
    let d = bilinear(tables, normals_start, [normals_x, normals_y], u);
    let u_o = [tilt_o.sqrt(), turn_o + 0.5];
    let sigma = bilinear(tables, area_start, [area_x, area_y], u_o);
    let factor = F::select(is(flags, JACOBIAN), d / (sigma * 4.0), F::one()) / light.z;
    Rgb::select(factor.is_finite(), color * factor, Rgb::black())
}
