//! Measured materials: files written here, read by the library, against values worked out here in f64 from the published
//! descriptions of the formats; and pictures of a material and of its table.

use proptest::prelude::*;
use rebond::bsdf::TransportMode;
use rebond::bsdf::capture::{CaptureError, CaptureSettings, capture, error};
use rebond::bsdf::check::{Angles, Effort, LARGEST_DISAGREEMENT, Material, sampling_directions};
use rebond::bsdf::measured::{AdaptiveTable, Grid2, Measured};
use rebond::film::Film;
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, Engine, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{SceneFiles, SceneSource, read_measured, write_table};
use statrs::distribution::{ContinuousCDF, Normal};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

type V = [f64; 3];

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn half(a: V, b: V) -> V {
    let sum = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    sum.map(|x| x / dot(sum, sum).sqrt())
}

fn polar(theta: f64, phi: f64) -> V {
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

/// Directions that the library and this file mean alike: f64s that are f32s.
fn rounded(w: V) -> V {
    Angles { theta: theta(w).to_degrees(), phi: w[1].atan2(w[0]).to_degrees() }.direction().lane(0).map(f64::from)
}

fn theta(w: V) -> f64 {
    w[0].hypot(w[1]).atan2(w[2])
}

fn material(bytes: &[u8], name: &str) -> Material {
    read_measured(bytes, name).expect("a good file").material().expect("a small table")
}

/// f with light from one direction towards another.
fn f(material: &Material, light: V, viewer: V) -> V {
    let w = |w: V| Angles { theta: theta(w).to_degrees(), phi: w[1].atan2(w[0]).to_degrees() }.direction();
    material.eval(w(viewer), w(light), TransportMode::Radiance).0.map(f64::from)
}

/// Numbers in [0, 1).
fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn direction(random: &mut impl FnMut() -> f64) -> V {
    rounded(polar((0.02 + 0.97 * random()).acos(), TAU * random()))
}

// ---- GGX, from which files are made ----

const COLOR: V = [0.9, 0.6, 0.3];

fn ggx_d(m: V, [ax, ay]: [f64; 2]) -> f64 {
    let s = (m[0] / ax).powi(2) + (m[1] / ay).powi(2) + m[2] * m[2];
    1.0 / (PI * ax * ay * s * s)
}

/// Area of the microsurface seen from w: cosθ (1 + Λ).
fn ggx_sigma(w: V, [ax, ay]: [f64; 2]) -> f64 {
    0.5 * (w[2] + (w[2] * w[2] + (ax * w[0]).powi(2) + (ay * w[1]).powi(2)).sqrt())
}

/// f of facets of reflectance 1, with heights correlated.
fn ggx(light: V, viewer: V, alpha: [f64; 2]) -> f64 {
    let (l, v) = (ggx_sigma(light, alpha) / light[2], ggx_sigma(viewer, alpha) / viewer[2]);
    ggx_d(half(light, viewer), alpha) / ((l + v - 1.0) * 4.0 * light[2] * viewer[2])
}

// ---- MERL ----

/// A file of these samples along θh, θd and φd; the values at the middle of what each stands for.
fn write_merl(size: [usize; 3], value: impl Fn(f64, f64, f64) -> V) -> Vec<u8> {
    let [h, d, p] = size;
    let mut bytes: Vec<u8> = size.iter().flat_map(|n| (*n as i32).to_le_bytes()).collect();
    for (channel, scale) in [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0].into_iter().enumerate() {
        for i in 0..h * d * p {
            let middle = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
            let theta_h = middle(i / p / d, h).powi(2) * PI / 2.0;
            let (theta_d, phi_d) = (middle(i / p % d, d) * PI / 2.0, middle(i % p, p) * PI);
            bytes.extend((value(theta_h, theta_d, phi_d)[channel] / scale).to_le_bytes());
        }
    }
    bytes
}

/// Light and viewer of these angles, the half vector at azimuth `phi_h` (Rusinkiewicz 1998).
fn of_half_difference(theta_h: f64, phi_h: f64, theta_d: f64, phi_d: f64) -> [V; 2] {
    let about_y = |w: V, t: f64| [w[0] * t.cos() + w[2] * t.sin(), w[1], w[2] * t.cos() - w[0] * t.sin()];
    let about_z = |w: V, t: f64| [w[0] * t.cos() - w[1] * t.sin(), w[0] * t.sin() + w[1] * t.cos(), w[2]];
    [phi_d, phi_d + PI].map(|phi_d| about_z(about_y(polar(theta_d, phi_d), theta_h), phi_h))
}

fn brushed(theta_h: f64, theta_d: f64, phi_d: f64) -> V {
    let lobe = 20.0 * (-30.0 * theta_h * theta_h).exp() * (1.0 + theta_d) * (2.0 + (2.0 * phi_d).cos());
    [0.1 + lobe, 0.2 + 0.5 * lobe, 0.05 + 0.1 * lobe]
}

/// In the middle of what a sample stands for, f is what the published look-up takes from the file: the number at
/// φd + 180 (θd + 90 θh) of the channel's plane, scaled.
#[test]
fn merl_files_are_looked_up_as_published() {
    let bytes = write_merl([90, 90, 180], brushed);
    assert_eq!(bytes.len(), 12 + 3 * 8 * 90 * 90 * 180);
    let material = material(&bytes, "x.binary");
    let mut random = random(1);
    let mut looked_up = 0;
    while looked_up < 2000 {
        let [i, j, k] = [90, 90, 180].map(|n| (random() * f64::from(n)) as usize);
        let theta_h = ((i as f64 + 0.5) / 90.0).powi(2) * PI / 2.0;
        let (theta_d, phi_d) = ((j as f64 + 0.5) / 90.0 * PI / 2.0, (k as f64 + 0.5) / 180.0 * PI);
        let [light, viewer] = of_half_difference(theta_h, TAU * random(), theta_d, phi_d);
        if light[2] < 0.02 || viewer[2] < 0.02 {
            continue;
        }
        looked_up += 1;
        let at = |channel: usize| {
            let number = k + 180 * (j + 90 * i) + channel * 90 * 90 * 180;
            f64::from_le_bytes(bytes[12 + 8 * number..][..8].try_into().expect("eight bytes"))
        };
        let expected = [at(0) / 1500.0, at(1) * 1.15 / 1500.0, at(2) * 1.66 / 1500.0];
        for found in [f(&material, light, viewer), f(&material, viewer, light)] {
            for c in 0..3 {
                // The nearer half vectors of f32s are to the pole, the fewer digits of φd there are.
                assert!(
                    (found[c] / expected[c] - 1.0).abs() < 1e-3 + 2e-7 / theta_h,
                    "{i} {j} {k}: {found:?} for {expected:?}"
                );
            }
        }
    }
}

/// Elsewhere it is interpolated linearly between the middles: exact for what is linear in √θh and θd.
#[test]
fn merl_files_are_interpolated_between_samples() {
    let bytes = write_merl([30, 20, 12], |h, d, _| [1.0 + (h / (PI / 2.0)).sqrt(), 2.0 + d, 1.0]);
    let material = material(&bytes, "x.binary");
    let mut random = random(2);
    for _ in 0..2000 {
        let (light, viewer) = (direction(&mut random), direction(&mut random));
        let h = half(light, viewer);
        // Up to the first middle and from the last on, values stay as they are.
        let x = (theta(h) / (PI / 2.0)).sqrt().clamp(0.5 / 30.0, 1.0 - 0.5 / 30.0);
        let d = dot(light, h).min(1.0).acos().clamp(0.5 / 20.0 * PI / 2.0, (1.0 - 0.5 / 20.0) * PI / 2.0);
        let found = f(&material, light, viewer);
        for (found, expected) in found.into_iter().zip([1.0 + x, 2.0 + d, 1.0]) {
            assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
        }
    }
}

// ---- RGL ----

/// A field of a tensor file.
#[derive(Clone)]
enum Field {
    Floats(Vec<usize>, Vec<f64>),
    Bytes(Vec<u8>),
}

fn write_tensors(fields: &[(&str, Field)]) -> Vec<u8> {
    let mut bytes = b"tensor_file\0\x01\x00".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut places = Vec::new();
    for (name, field) in fields {
        let (kind, shape) = match field {
            Field::Floats(shape, _) => (10, shape.clone()),
            Field::Bytes(data) => (1, vec![data.len()]),
        };
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(kind);
        places.push(bytes.len());
        bytes.extend([0; 8]);
        shape.iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes()));
    }
    for (place, (_, field)) in places.into_iter().zip(fields) {
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        let at = bytes.len() as u64;
        bytes[place..place + 8].copy_from_slice(&at.to_le_bytes());
        match field {
            Field::Floats(_, data) => data.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes())),
            Field::Bytes(data) => bytes.extend(data),
        }
    }
    bytes
}

/// Numbers on a grid over the unit square, the first side varying fastest.
#[derive(Clone)]
struct Square {
    size: [usize; 2],
    values: Vec<f64>,
}

impl Square {
    fn at(&self, x: usize, y: usize) -> f64 {
        self.values[y * self.size[0] + x]
    }

    fn bilinear(&self, u: [f64; 2]) -> f64 {
        let cell = |u: f64, n: usize| {
            let x = u.clamp(0.0, 1.0) * (n - 1) as f64;
            let i = (x as usize).min(n - 2);
            (i, x - i as f64)
        };
        let ((i, x), (j, y)) = (cell(u[0], self.size[0]), cell(u[1], self.size[1]));
        let row = |j: usize| self.at(i, j) * (1.0 - x) + self.at(i + 1, j) * x;
        row(j) * (1.0 - y) + row(j + 1) * y
    }

    /// ∫ over x from 0 to `end`, at a height; trapezia are exact.
    fn along(&self, end: f64, y: f64) -> f64 {
        let n = self.size[0] - 1;
        let mut sum = 0.0;
        for i in 0..n {
            let (a, b) = (i as f64 / n as f64, ((i + 1) as f64 / n as f64).min(end));
            if b > a {
                sum += (b - a) * (self.bilinear([a, y]) + self.bilinear([b, y])) / 2.0;
            }
        }
        sum
    }

    /// ∫ over x along each row of samples.
    fn rows(&self) -> Vec<f64> {
        let n = self.size[1] - 1;
        (0..=n).map(|j| self.along(1.0, j as f64 / n as f64)).collect()
    }

    /// ∫∫ over all x and y from 0 to `end`; between rows their integral is linear.
    fn up_to(rows: &[f64], end: f64) -> f64 {
        let n = (rows.len() - 1) as f64;
        let cell = |j: usize| {
            let part = (end * n - j as f64).clamp(0.0, 1.0);
            (rows[j] + (rows[j + 1] - rows[j]) * part / 2.0) * part / n
        };
        (0..rows.len() - 1).map(cell).sum()
    }

    fn normalized(mut self) -> Self {
        let total = Self::up_to(&self.rows(), 1.0);
        self.values.iter_mut().for_each(|v| *v /= total);
        self
    }

    /// Where a point of the square lies among all before it, in shares.
    fn share(&self, u: [f64; 2]) -> [f64; 2] {
        let rows = self.rows();
        [self.along(u[0], u[1]) / self.along(1.0, u[1]), Self::up_to(&rows, u[1]) / Self::up_to(&rows, 1.0)]
    }

    /// The inverse, by bisection.
    fn point(&self, rows: &[f64], s: [f64; 2]) -> [f64; 2] {
        let bisect = |f: &dyn Fn(f64) -> f64, target: f64| {
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..40 {
                let middle = (low + high) / 2.0;
                if f(middle) < target { low = middle } else { high = middle }
            }
            (low + high) / 2.0
        };
        let all = Self::up_to(rows, 1.0);
        let y = bisect(&|y| Self::up_to(rows, y) / all, s[1]);
        let row = self.along(1.0, y);
        [bisect(&|x| self.along(x, y) / row, s[0]), y]
    }
}

/// Points of the square are directions: (√(2θ/π), φ/2π + ½).
fn to_square(w: V, from: f64) -> [f64; 2] {
    [(theta(w) * 2.0 / PI).sqrt(), ((w[1].atan2(w[0]) - from) / TAU + 0.5).rem_euclid(1.0)]
}

fn of_square(u: [f64; 2]) -> V {
    polar(u[0] * u[0] * PI / 2.0, (2.0 * u[1] - 1.0) * PI)
}

fn square(size: [usize; 2], f: impl Fn([f64; 2]) -> f64) -> Square {
    let at = |i: usize| [(i % size[0]) as f64 / (size[0] - 1) as f64, (i / size[0]) as f64 / (size[1] - 1) as f64];
    Square { size, values: (0..size[0] * size[1]).map(|i| f(at(i))).collect() }
}

struct Rgl {
    alpha: [f64; 2],
    theta: Vec<f64>,
    phi: Vec<f64>,
    jacobian: bool,
    /// Wavelengths in place of colours, at all of which the value is that of green.
    spectra: Option<Vec<f64>>,
}

/// GGX of an alpha, measured as that file has it.
fn write_rgl(file: &Rgl) -> Vec<u8> {
    const VISIBLE: [usize; 2] = [40, 36];
    const COLORS: [usize; 2] = [16, 18];
    let Rgl { alpha, theta, phi, jacobian, spectra } = file;
    let floats = |shape: &[usize], data: Vec<f64>| Field::Floats(shape.to_vec(), data);
    let normals = square([64, 48], |u| ggx_d(of_square(u), *alpha));
    let area = square([32, 24], |u| ggx_sigma(of_square(u), *alpha));
    let (mut visible, mut colors) = (Vec::new(), Vec::new());
    let channels = spectra.as_ref().map_or(vec![0, 1, 2], |w| vec![1; w.len()]);
    for phi in phi {
        for theta in theta {
            let viewer = polar(*theta, *phi);
            let grid = square(VISIBLE, |u| {
                let m = of_square(u);
                ggx_d(m, *alpha) * dot(viewer, m).max(0.0) * m[2].acos().sin() * u[0] + 1e-4
            });
            visible.extend(&grid.values);
            // Nearly along the surface nothing is measured.
            let rows = grid.rows();
            let value = square(COLORS, |s| {
                let u = grid.point(&rows, s);
                let m = of_square(u);
                let light: V = std::array::from_fn(|i| 2.0 * dot(viewer, m) * m[i] - viewer[i]);
                if light[2] < 1e-3 {
                    return 0.0;
                }
                let factor =
                    if *jacobian { 4.0 * area.bilinear(to_square(viewer, 0.0)) / normals.bilinear(u) } else { 1.0 };
                ggx(light, viewer, *alpha) * light[2] * factor
            });
            channels.iter().for_each(|c| colors.extend(value.values.iter().map(|v| v * COLOR[*c])));
        }
    }
    let grids = [phi.len(), theta.len()];
    let mut fields = vec![
        ("description", Field::Bytes(b"GGX".to_vec())),
        ("theta_i", floats(&[theta.len()], theta.clone())),
        ("phi_i", floats(&[phi.len()], phi.clone())),
        ("ndf", floats(&[48, 64], normals.values)),
        ("sigma", floats(&[24, 32], area.values)),
        ("vndf", floats(&[grids[0], grids[1], VISIBLE[1], VISIBLE[0]], visible)),
        ("jacobian", Field::Bytes(vec![u8::from(*jacobian)])),
    ];
    let shape = [grids[0], grids[1], channels.len(), COLORS[1], COLORS[0]];
    match spectra {
        None => fields.push(("rgb", floats(&shape, colors))),
        Some(wavelengths) => {
            fields.push(("spectra", floats(&shape, colors)));
            fields.push(("wavelengths", floats(&[wavelengths.len()], wavelengths.clone())));
        }
    }
    write_tensors(&fields)
}

/// The fields of a tensor file, by its description.
fn read_tensors(bytes: &[u8]) -> BTreeMap<String, (Vec<usize>, Vec<f64>)> {
    let number = |at: &mut usize, n: usize| {
        let value = bytes[*at..*at + n].iter().rev().fold(0_usize, |sum, b| sum << 8 | usize::from(*b));
        *at += n;
        value
    };
    let mut at = 14;
    let mut fields = BTreeMap::new();
    for _ in 0..number(&mut at, 4) {
        let length = number(&mut at, 2);
        let name = String::from_utf8(bytes[at..at + length].to_vec()).expect("a name");
        at += length;
        let (dimensions, kind, place) = (number(&mut at, 2), number(&mut at, 1), number(&mut at, 8));
        let shape: Vec<usize> = (0..dimensions).map(|_| number(&mut at, 8)).collect();
        let data = &bytes[place..];
        let value = |i: usize| match kind {
            10 => f64::from(f32::from_le_bytes(data[4 * i..4 * i + 4].try_into().expect("four bytes"))),
            _ => f64::from(data[i]),
        };
        let values = (0..shape.iter().product()).map(value).collect();
        fields.insert(name, (shape, values));
    }
    fields
}

/// f_r by the description of Dupuy and Jakob: densities are interpolated first and integrated then.
fn rgl_value(fields: &BTreeMap<String, (Vec<usize>, Vec<f64>)>, mut light: V, mut viewer: V) -> V {
    let (phi, theta_list) = (&fields["phi_i"].1, &fields["theta_i"].1);
    let isotropic = phi.len() <= 2;
    if !isotropic {
        let span = phi[phi.len() - 1] - phi[0];
        let up = |x: f64| if x.is_sign_negative() { 1.0 } else { -1.0 };
        let (x, y) = match (TAU / span).round() as u32 {
            1 => (1.0, 1.0),
            2 => (up(viewer[1]), up(viewer[1])),
            _ => (up(viewer[0]), up(viewer[1])),
        };
        for w in [&mut light, &mut viewer] {
            (w[0], w[1]) = (w[0] * x, w[1] * y);
        }
    }
    let between = |list: &[f64], x: f64| -> Vec<(usize, f64)> {
        match list.iter().rposition(|a| *a <= x) {
            None => vec![(0, 1.0)],
            Some(i) if i + 1 == list.len() => vec![(i, 1.0)],
            Some(i) => {
                let part = (x - list[i]) / (list[i + 1] - list[i]);
                vec![(i, 1.0 - part), (i + 1, part)]
            }
        }
    };
    let phi_o = viewer[1].atan2(viewer[0]);
    let mut grids = Vec::new();
    for (i, a) in between(phi, phi_o) {
        grids.extend(between(theta_list, theta(viewer)).iter().map(|(j, b)| (i * theta_list.len() + j, a * b)));
    }
    let m = half(light, viewer);
    let u = to_square(m, if isotropic { phi_o } else { 0.0 });
    let part = |name: &str, grid: usize| {
        let (shape, values) = &fields[name];
        let [y, x] = [shape[shape.len() - 2], shape[shape.len() - 1]];
        Square { size: [x, y], values: values[grid * x * y..(grid + 1) * x * y].to_vec() }
    };
    let mut blend = part("vndf", 0);
    blend.values.fill(0.0);
    for (grid, weight) in &grids {
        let one = part("vndf", *grid).normalized();
        blend.values.iter_mut().zip(one.values).for_each(|(sum, v)| *sum += weight * v);
    }
    let s = blend.share(u);
    let factor = match fields["jacobian"].1[0] as u32 {
        0 => 1.0,
        _ => part("ndf", 0).bilinear(u) / (4.0 * part("sigma", 0).bilinear(to_square(viewer, 0.0))),
    };
    std::array::from_fn(|c| {
        let value: f64 = grids.iter().map(|(grid, w)| w * part("rgb", 3 * grid + c).bilinear(s)).sum();
        value * factor / light[2]
    })
}

fn angles(n: usize, from: f64, to: f64) -> Vec<f64> {
    (0..n).map(|i| f64::from((from + (to - from) * i as f64 / (n - 1) as f64) as f32)).collect()
}

fn rgl_files() -> Vec<(&'static str, Rgl)> {
    let theta = || angles(6, 0.0, 1.45);
    let file = |alpha, phi, jacobian| Rgl { alpha, theta: theta(), phi, jacobian, spectra: None };
    vec![
        ("isotropic", file([0.3, 0.3], vec![0.0], true)),
        ("isotropic without normals", file([0.5, 0.5], vec![0.0], false)),
        ("whole turn", file([0.5, 0.25], angles(13, -PI, PI), true)),
        ("half a turn", file([0.5, 0.25], angles(7, -PI, 0.0), true)),
        ("a quarter of a turn", file([0.25, 0.5], angles(4, -PI, -PI / 2.0), true)),
    ]
}

#[test]
fn rgl_files_are_evaluated_as_published() {
    for (name, file) in rgl_files() {
        let bytes = write_rgl(&file);
        let (material, fields) = (material(&bytes, "x.bsdf"), read_tensors(&bytes));
        let mut random = random(3);
        let (mut compared, mut near) = (0, 0);
        for _ in 0..400 {
            let (light, viewer) = (direction(&mut random), direction(&mut random));
            let (found, expected) = (f(&material, light, viewer), rgl_value(&fields, light, viewer));
            for c in 0..3 {
                let apart = (found[c] - expected[c]).abs();
                assert!(apart < 2e-3 * expected[c] + 1e-4, "{name}: {found:?} for {expected:?}, {light:?} {viewer:?}");
            }
            // What the numbers stand for: GGX itself, away from what is not measured.
            if light[2] > 0.2 && viewer[2] > 0.2 {
                let exact = ggx(light, viewer, file.alpha) * COLOR[1];
                compared += 1;
                near += u32::from((found[1] / exact - 1.0).abs() < 0.15);
            }
        }
        assert!(f64::from(near) > 0.9 * f64::from(compared), "{name}: {near} of {compared} are near GGX");
    }
}

#[test]
fn grey_spectra_are_grey() {
    let theta = angles(4, 0.0, 1.4);
    let spectra = Some(vec![360.0, 430.0, 500.0, 550.0, 600.0, 680.0, 1000.0]);
    let grey = Rgl { alpha: [0.4; 2], theta, phi: vec![0.0], jacobian: true, spectra };
    let colored = Rgl { spectra: None, theta: grey.theta.clone(), phi: vec![0.0], ..grey };
    let (a, b) = (material(&write_rgl(&grey), "x.bsdf"), material(&write_rgl(&colored), "x.bsdf"));
    let mut random = random(4);
    for _ in 0..200 {
        let (light, viewer) = (direction(&mut random), direction(&mut random));
        let (found, expected) = (f(&a, light, viewer), f(&b, light, viewer)[1]);
        assert!(found.iter().all(|x| (x - expected).abs() <= 1e-5 * expected), "{found:?} for {expected}");
    }
}

/// The samplers of what was read, as `rebond bsdf` judges them.
#[test]
fn files_are_sampled_as_they_are_evaluated() {
    let merl = write_merl([90, 45, 36], brushed);
    let files = rgl_files().into_iter().map(|(name, file)| (name, write_rgl(&file))).chain([("MERL", merl)]);
    for (name, bytes) in files {
        let material = material(&bytes, name);
        let found = material.check_sampling(&Effort::default(), &sampling_directions(false));
        assert!(
            found.failures == 0 && found.undecided == 0 && found.disagreement < LARGEST_DISAGREEMENT,
            "{name}: {found:?}"
        );
    }
}

// ---- bad files ----

fn good_files() -> Vec<(&'static str, Vec<u8>)> {
    let rgl = Rgl { alpha: [0.4; 2], theta: vec![0.0, 1.0], phi: vec![0.0], jacobian: true, spectra: None };
    let table = rebond::bsdf::measured::AngleTable::new([2, 1, 3, 4], vec![[0.1, 0.2, 0.3]; 24]).expect("a table");
    vec![
        ("x.binary", write_merl([3, 4, 5], brushed)),
        ("x.bsdf", write_rgl(&rgl)),
        ("x.safetensors", write_table(&table, "test")),
    ]
}

fn message(bytes: &[u8], name: &str) -> String {
    read_measured(bytes, name).expect_err("a bad file").to_string()
}

#[test]
fn bad_files_are_refused_with_a_reason() {
    for (name, good) in good_files() {
        assert!(read_measured(&good, name).is_ok(), "{name}");
        assert!(message(&good[..good.len() - 5], name).contains(name), "the file is named");
        message(b"", name);
        if name != "x.bsdf" {
            // Fields of a tensor file stand anywhere, so that it may be longer than they are.
            message(&[&good[..], b"12345678"].concat(), name);
        }
        // The last number, whichever field it is of.
        let mut bad = good.clone();
        let n = bad.len();
        if name == "x.binary" {
            bad[n - 8..].copy_from_slice(&f64::NAN.to_le_bytes());
        } else {
            bad[n - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        assert!(message(&bad, name).contains("NaN"), "{}", message(&bad, name));
    }
    let [merl, rgl, table] = good_files().try_into().expect("three");
    // Sizes that are lies.
    let mut huge = merl.1;
    huge[..4].copy_from_slice(&i32::MAX.to_le_bytes());
    assert!(message(&huge, "x.binary").contains("2147483647 × 4 × 5"), "{}", message(&huge, "x.binary"));
    huge[..12].copy_from_slice(&[0xff; 12]);
    assert!(message(&huge, "x.binary").contains("want"));
    let without = |name: &str| {
        let place = rgl.1.windows(name.len()).position(|w| w == name.as_bytes()).expect("a field");
        let mut bytes = rgl.1.clone();
        bytes[place] = b'_';
        message(&bytes, "x.bsdf")
    };
    for field in ["theta_i", "phi_i", "ndf", "sigma", "rgb", "jacobian"] {
        assert!(without(field).contains(&format!("`{field}`")), "{}", without(field));
    }
    let mut newer = rgl.1.clone();
    newer[12] = 2;
    assert!(message(&newer, "x.bsdf").contains("version 2.0"));
    let swap = |from: &str, to: &str| {
        let place = table.1.windows(from.len()).position(|w| w == from.as_bytes()).expect("the words");
        [&table.1[..place], to.as_bytes(), &table.1[place + from.len()..]].concat()
    };
    assert!(message(&swap("version=1;", "version=7;"), "x.safetensors").contains("version=7"));
    assert!(message(&swap("\"f_r\"", "\"brr\""), "x.safetensors").contains("`f_r`"));
    assert!(message(&swap("[2,1,3,4,3]", "[2,1,3,2,6]"), "x.safetensors").contains("[2, 1, 3, 2, 6]"));
}

/// What chance would not hit upon.
#[test]
fn hostile_files_end_in_words_and_soon() {
    for wavelengths in [vec![f64::NAN], vec![400.0, f64::INFINITY], vec![500.0, 400.0]] {
        let spectra = Some(wavelengths);
        let file = Rgl { alpha: [0.4; 2], theta: vec![0.0, 1.0], phi: vec![0.0], jacobian: true, spectra };
        assert!(message(&write_rgl(&file), "x.bsdf").contains("wavelengths"));
    }
    // No angles, so that sides whose product is beyond all numbers hold nothing.
    let none = |shape: &[usize]| Field::Floats(shape.to_vec(), Vec::new());
    let one = || Field::Floats(vec![1, 1], vec![1.0]);
    let fields = [
        ("theta_i", none(&[0])),
        ("phi_i", none(&[0])),
        ("ndf", one()),
        ("sigma", one()),
        ("vndf", none(&[0, 0, 2, 2])),
        ("jacobian", Field::Bytes(vec![1])),
        ("rgb", none(&[0, 0, 3, 1 << 40, 1 << 40])),
    ];
    assert!(message(&write_tensors(&fields), "x.bsdf").contains("`rgb`"));
    let grid = |values: &[f32], x: u32| Grid2 { size: [x, x], values: values.to_vec() };
    let color = Grid2 { size: [1, 1], values: vec![[0.5; 3]] };
    let sigma = |s| {
        AdaptiveTable::new(
            vec![0.0],
            vec![0.0],
            grid(&[1.0], 1),
            grid(&[s], 1),
            grid(&[1.0; 4], 2),
            color.clone(),
            true,
        )
    };
    assert!(sigma(1.0).is_ok());
    assert_eq!(sigma(0.0).expect_err("no area"), "sigma is 0 everywhere");
    // A column of nothing but missing values is filled in one pass.
    let empty = write_merl([1, 300_000, 1], |_, _, _| [-1.0; 3]);
    assert!(read_measured(&empty, "x.binary").is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Whatever stands in a file, reading it ends with a table that reflects or with an error.
    #[test]
    fn damaged_files_do_no_harm(
        file in 0..3_usize,
        cut in prop::option::of(0.0..1.0_f64),
        damage in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 0..12),
        early in any::<bool>(),
    ) {
        let (name, mut bytes) = good_files().swap_remove(file);
        // Headers are where damage does most.
        let reach = if early { bytes.len().min(400) } else { bytes.len() } as f64;
        for (place, byte) in damage {
            bytes[(place * reach) as usize] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate((cut * bytes.len() as f64) as usize);
        }
        if let Ok(measured) = read_measured(&bytes, name) {
            let material = measured.material().expect("a small table");
            let value = f(&material, polar(0.5, 1.0), polar(0.7, 2.0));
            prop_assert!(value.iter().all(|x| *x >= 0.0));
        }
    }

    #[test]
    fn any_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..200), magic in 0..3_usize) {
        let start: &[u8] = [&b""[..], b"tensor_file\0\x01\x00", b"\x40\0\0\0\0\0\0\0{\""][magic];
        let _ = read_measured(&[start, &bytes].concat(), "x");
    }
}

// ---- in scenes ----

fn scene(folder: &std::path::Path, text: &str) -> SceneSource {
    SceneSource::parse(text, "test.toml", "test", SceneFiles::Folder(folder.to_path_buf())).expect("a scene")
}

fn film(source: &SceneSource, engine: Engine, samples: u32) -> Film {
    let scene = source.build().expect("a good scene");
    let sampler = Sampler::new(SamplerSettings::default(), 3);
    let integrator = IntegratorSettings::default().integrator(&scene, sampler, engine).expect("settings");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(samples), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, 2, &());
    assert_eq!(film.dropped_samples(), 0);
    film
}

/// A mix of two measured materials is their linear interpolation, and sampled as such.
#[test]
fn mixes_interpolate_measured_materials() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("written");
    write("a.binary", &write_merl([30, 20, 12], brushed));
    write("b.bsdf", &write_rgl(&rgl_files().swap_remove(0).1));
    for weight in [0.0, 0.3, 1.0] {
        let text = format!(
            "[materials]\na = {{ type = 'measured', file = 'a.binary' }}\nb = {{ type = 'measured', file = 'b.bsdf' }}\n\
             mix = {{ type = 'mix', a = 'a', b = 'b', weight = {weight} }}\n"
        );
        let source = scene(folder.path(), &text);
        let [a, b, mix] = ["a", "b", "mix"].map(|name| source.material(name).expect("a material"));
        let mut random = random(5);
        for _ in 0..500 {
            let (light, viewer) = (direction(&mut random), direction(&mut random));
            let (x, y, found) = (f(&a, light, viewer), f(&b, light, viewer), f(&mix, light, viewer));
            for c in 0..3 {
                let expected = x[c] * (1.0 - weight) + y[c] * weight;
                assert!((found[c] - expected).abs() < 1e-5 * expected + 1e-9, "{found:?}");
            }
        }
        let sampling = mix.check_sampling(&Effort::default(), &sampling_directions(false));
        let sound = sampling.failures == 0 && sampling.undecided == 0;
        assert!(sound && sampling.disagreement < LARGEST_DISAGREEMENT, "{sampling:?}");
    }
    // A file is read once, however many materials name it; and what is no file is an error with its place.
    let text = "[[shapes]]\ntype = 'sphere'\nmaterial = { type = 'measured', file = 'none.bsdf' }\n";
    let error = scene(folder.path(), text).build().err().expect("no such file");
    assert_eq!((error.line(), error.message.contains("none.bsdf")), (Some(3), true), "{error}");
}

/// The unit sphere in parallel projection, so that a pixel's place says from which angle it is seen.
fn sphere(material: &str, lights: &str) -> String {
    format!(
        "[camera]\ntype = 'orthographic'\nto_world.look_at = {{ origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }}\n\
         [film]\nwidth = 96\nheight = 96\nfilter = 'box'\n\
         [materials]\nit = {material}\n[[shapes]]\ntype = 'sphere'\nmaterial = 'it'\n{lights}"
    )
}

/// Mean and variance of the mean of all pixels seen under angles of a band, by channel.
fn band(film: &Film, from: f64, to: f64) -> Option<([f64; 3], [f64; 3])> {
    let (n, mut mean, mut variance) = (96, [0.0; 3], [0.0; 3]);
    let mut count = 0.0;
    for (i, pixel) in film.pixels().iter().enumerate() {
        let place = |k: usize| (k as f64 + 0.5) / f64::from(n) * 2.0 - 1.0;
        let r = place(i % 96).hypot(place(i / 96));
        if r >= 1.0 || !(from..to).contains(&r.asin().to_degrees()) {
            continue;
        }
        count += 1.0;
        for c in 0..3 {
            mean[c] += pixel.mean()[c];
            variance[c] += pixel.variance()[c] / pixel.samples() as f64;
        }
    }
    (count > 0.0).then(|| (mean.map(|x| x / count), variance.map(|x| x / (count * count))))
}

/// In how many bands and channels a picture of the table differs from one of the material by more than `predicted` (of the
/// error of a band and its brightest albedo) says, at 1 % for all of them together.
fn beyond(
    original: &Film,
    captured: &Film,
    error: &CaptureError,
    predicted: impl Fn(f64, f64, f64) -> f64,
) -> Vec<String> {
    let bands: Vec<f64> = (0..16).map(|i| 5.0 * f64::from(i)).collect();
    let quantile = Normal::standard().inverse_cdf(0.99_f64.powf(1.0 / (3.0 * bands.len() as f64)));
    let mut found = Vec::new();
    for from in bands {
        let (Some((a, va)), Some((b, vb))) = (band(original, from, from + 5.0), band(captured, from, from + 5.0))
        else {
            continue;
        };
        // What was found within the band and next to it, since pixels have an extent.
        let near = error.directions.iter().filter(|d| (from - 1.5..from + 6.5).contains(&d.at.theta));
        let (mut even, mut bound, mut albedo) = (0.0_f64, 0.0_f64, 0.0_f64);
        for d in near {
            (even, bound) = (even.max(d.even), bound.max(d.bound));
            albedo = d.albedo.into_iter().fold(albedo, f64::max);
        }
        for c in 0..3 {
            let (difference, noise) = ((a[c] - b[c]).abs(), quantile * (va[c] + vb[c]).sqrt());
            if difference > predicted(even, bound, albedo) + noise {
                found.push(format!("{from}°, channel {c}: {} for {} ± {noise}", b[c], a[c]));
            }
        }
    }
    found
}

/// A table renders the picture of what it was captured from, within the errors that its report predicts: under even light
/// by `even`, under lights of different brightness by `bound`. The report of a finer table is not met by a coarse one.
#[test]
fn captured_materials_render_as_the_originals() {
    let folder = tempfile::tempdir().expect("a folder");
    let (even, sun) = (
        "[[emitters]]\ntype = 'constant'\nradiance = 1\n",
        "[[emitters]]\ntype = 'constant'\nradiance = 0.2\n[[shapes]]\ntype = 'disk'\nemission = 3\n\
         to_world = [{ scale = 3 }, { look_at = { origin = [6, 5, 5], target = [0, 0, 0], up = [0, 1, 0] } }]\n\
         material = { type = 'diffuse', reflectance = 0 }\n",
    );
    let cases = [
        ("{ type = 'phong', exponent = 12, reflectance = [0.9, 0.6, 0.3] }", [45, 1, 45, 90], [6, 1, 6, 12]),
        ("{ type = 'conductor', metal = 'gold', alpha = 0.35 }", [60, 1, 60, 120], [5, 1, 5, 10]),
    ];
    for (description, fine, coarse) in cases {
        let original = scene(folder.path(), &sphere(description, even));
        let material = original.material("it").expect("a material");
        let mut made = [fine, coarse].map(|size| {
            let table =
                capture(&material, &CaptureSettings { size, samples: 0, noise: 0.0, seed: 1 }).expect("a table");
            let report = error(&material, &table, 360, 1).expect("a small table");
            (Measured::Angles(table), report)
        });
        for (i, (table, _)) in made.iter_mut().enumerate() {
            let Measured::Angles(table) = table else { unreachable!("made so") };
            std::fs::write(folder.path().join(format!("{i}.safetensors")), write_table(table, "test"))
                .expect("written");
        }
        let measured = |i: usize| format!("{{ type = 'measured', file = '{i}.safetensors' }}");
        for (lights, brightest) in [(even, None), (sun, Some(3.2))] {
            let picture =
                |material: &str| film(&scene(folder.path(), &sphere(material, lights)), Engine::Wavefront, 256);
            let original = picture(description);
            let pictures = [picture(&measured(0)), picture(&measured(1))];
            let limit = |even: f64, bound: f64, albedo: f64| match brightest {
                None => even * albedo,
                Some(radiance) => radiance * bound * albedo,
            };
            for (picture, (_, report)) in pictures.iter().zip(&made) {
                let found = beyond(&original, picture, report, limit);
                assert!(found.is_empty(), "{description}: {found:?}");
            }
            if brightest.is_none() {
                let found = beyond(&original, &pictures[1], &made[0].1, limit);
                assert!(found.len() >= 3, "{description}: a coarse table is not told from a fine one: {found:?}");
            }
        }
        // Both engines, one picture.
        let text = sphere(&measured(1), even);
        let [wide, narrow] = [Engine::Wavefront, Engine::Scalar].map(|e| film(&scene(folder.path(), &text), e, 16));
        for (a, b) in wide.pixels().iter().zip(narrow.pixels()) {
            assert!((0..3).all(|c| (a.mean()[c] - b.mean()[c]).abs() < 1e-5), "{:?} {:?}", a.mean(), b.mean());
        }
    }
}
