//! Triangles and parallelograms by solid angle: against uniform, against Lambert's formula, against area sampling.

use super::*;
use crate::testing::{chi2_counts, random_pairs, seeded_pairs, t_test_p_value};
use crate::transport::irradiance::{from_parallel_disk, from_polygon, from_sphere};
use LightSampling::{Area, SolidAngle};
use glam::DVec3;
use rebond_lanes::scalar::Index1;

/// A flat light: a corner and two edges.
#[derive(Clone, Copy)]
struct Flat {
    name: &'static str,
    p: [V; 3],
    parallelogram: bool,
}

impl Flat {
    fn scaled(self, s: f32) -> Self {
        Self { p: self.p.map(|v| v * s), ..self }
    }
    fn emitter(self) -> Emitter {
        let (p, radiance) = (self.p, [1.0; 3]);
        if self.parallelogram { Emitter::Parallelogram { p, radiance } } else { Emitter::Triangle { p, radiance } }
    }
    fn at(self, x: f64, y: f64) -> DVec3 {
        let [p, a, b] = self.p.map(|v| v.as_dvec3());
        p + a * x + b * y
    }
    fn corners(self) -> Vec<DVec3> {
        let coordinates: &[[f64; 2]] = if self.parallelogram {
            &[[0., 0.], [1., 0.], [1., 1.], [0., 1.]]
        } else {
            &[[0., 0.], [1., 0.], [0., 1.]]
        };
        coordinates.iter().map(|[x, y]| self.at(*x, *y)).collect()
    }
    /// Coordinates along the edges of a point of its plane.
    fn coordinates(self, point: DVec3) -> [f64; 2] {
        let [p, a, b] = self.p.map(|v| v.as_dvec3());
        let (n, d) = (a.cross(b), point - p);
        [d.cross(b).dot(n) / n.length_squared(), a.cross(d).dot(n) / n.length_squared()]
    }
    /// Triangles of a fine grid over it, as coordinates.
    fn cells(self, side: usize) -> Vec<[[f64; 2]; 3]> {
        let at = |i: usize, j: usize| [i as f64 / side as f64, j as f64 / side as f64];
        let squares = (0..side * side).map(|k| (k % side, k / side));
        let lower = |(i, j)| [at(i, j), at(i + 1, j), at(i, j + 1)];
        let upper = |(i, j)| [at(i + 1, j + 1), at(i, j + 1), at(i + 1, j)];
        squares
            .flat_map(|s| [lower(s), upper(s)])
            .filter(|c| self.parallelogram || c.iter().map(|[x, y]| x + y).sum::<f64>() < 3.0)
            .collect()
    }
    /// By area; f64.
    fn solid_angle(self, p: DVec3, cell: [[f64; 2]; 3]) -> f64 {
        let [a, b, c] = cell.map(|[x, y]| self.at(x, y) - p);
        // Edges from coordinates, so that small cells keep their digits.
        let (ab, ac) = (b - a, c - a);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * a.dot(ab.cross(ac)).abs().atan2(denominator)
    }
    fn whole(self, p: DVec3) -> f64 {
        self.cells(1).iter().map(|c| self.solid_angle(p, *c)).sum()
    }
}

/// In or near the plane z = 1, facing down.
fn lights() -> [Flat; 4] {
    let v = V::new;
    [
        Flat { name: "rectangle", p: [v(-1.0, -0.5, 1.0), V::Y, V::X * 2.0], parallelogram: true },
        Flat { name: "strip", p: [v(-1.0, -0.5, 1.0), V::Y * 0.02, V::X * 2.0], parallelogram: true },
        Flat {
            name: "parallelogram",
            p: [v(-1.0, -0.5, 0.9), v(0.3, 1.1, 0.2), v(1.7, 0.4, 0.0)],
            parallelogram: true,
        },
        Flat { name: "triangle", p: [v(-0.8, -0.7, 1.1), v(0.6, 1.4, -0.1), v(1.5, 0.1, -0.2)], parallelogram: false },
    ]
}

/// Receivers: below, close, far, off to the side, grazing, behind.
fn receivers() -> Vec<V> {
    let mut all: Vec<V> = [
        [0.1, 0.0, 0.0],
        [0.2, 0.1, 0.9],
        [0.05, 0.02, 0.97],
        [-0.9, -0.4, 0.85],
        [3.0, 2.0, -20.0],
        [300.0, -200.0, -2000.0],
        [4.0, 0.3, 0.9],
        [1.2, 0.2, 0.8],
        [0.3, 1.5, 0.99],
        [-40.0, 3.0, 0.5],
        [300.0, -1.0, -30.0],
        [30.0, 30.0, -5.0],
        [-1.0, -0.5, 0.5],
        [0.4, 0.2, 2.0],
        [5.0, 0.0, 1.5],
    ]
    .map(V::from_array)
    .to_vec();
    all.extend(
        random_pairs(12)
            .zip(random_pairs(24).skip(12))
            .map(|([x, y], [z, s])| V::new(x * 2.0 - 1.0, y * 2.0 - 1.0, 1.0 - 2.0 * z) * 10.0_f32.powf(s * 2.0 - 1.0)),
    );
    all
}

fn vector(v: V) -> Vec3<f32> {
    Vec3::splat(v.to_array())
}

fn dvec(v: Vec3<f32>) -> DVec3 {
    V::new(v.x, v.y, v.z).as_dvec3()
}

fn draw(
    emitters: &Emitters,
    p: V,
    sampling: LightSampling,
    u: impl Iterator<Item = [f32; 2]>,
) -> impl Iterator<Item = EmitterSample<f32>> {
    u.map(move |u| emitters.sample(Index1(0), vector(p), 0.0, sampling, u, true))
}

/// Whether [`SolidAngle`] falls back to area from here: the density then is not the same everywhere.
fn by_area(emitters: &Emitters, p: V) -> bool {
    let pdf = |s: EmitterSample<f32>| s.pdf.0;
    let some: Vec<f32> = draw(emitters, p, SolidAngle, random_pairs(8)).map(pdf).collect();
    some.iter().any(|x| *x != some[0])
}

#[test]
fn points_are_uniform_by_solid_angle() {
    for light in lights() {
        let emitters = Emitters::new(&[light.emitter()], vec![]);
        for p in receivers() {
            let name = format!("{} from {p}", light.name);
            assert!(!by_area(&emitters, p), "{name}: fell back to area");
            let (from, side, n) = (p.as_dvec3(), 12, 60_000);
            let cells = light.cells(side);
            let solid_angles: Vec<f64> = cells.iter().map(|c| light.solid_angle(from, *c)).collect();
            let whole: f64 = solid_angles.iter().sum();
            let mut counts = vec![0; cells.len()];
            let order: std::collections::HashMap<[usize; 3], usize> = cells
                .iter()
                .enumerate()
                .map(|(k, c)| {
                    let [x, y] = [0, 1].map(|a| c.iter().map(|v| v[a]).sum::<f64>() / 3.0 * side as f64);
                    ([x as usize, y as usize, usize::from(x.fract() + y.fract() > 1.0)], k)
                })
                .collect();
            for s in draw(&emitters, p, SolidAngle, random_pairs(n)) {
                let inside = |x: f64| (x * side as f64).clamp(0.0, side as f64 - 1e-6);
                let [x, y] = light.coordinates(dvec(s.point)).map(inside);
                let (i, j, above) = (x as usize, y as usize, x.fract() + y.fract() > 1.0);
                // Beyond the long edge of a triangle by rounding only.
                let above = above && (light.parallelogram || i + j + 1 < side);
                counts[order[&[i, j, usize::from(above)]]] += 1;
                assert!((f64::from(s.pdf.0) * whole - 1.0).abs() < 2e-5, "{name}: pdf {} of {}", s.pdf.0, 1.0 / whole);
            }
            let expected: Vec<f64> = solid_angles.iter().map(|a| a / whole * f64::from(n)).collect();
            chi2_counts(&name, &counts, &expected);
        }
    }
}

#[test]
fn a_hit_has_the_density_it_is_drawn_with() {
    for sampling in [Area, SolidAngle] {
        let all: Vec<Emitter> = lights().map(Flat::emitter).to_vec();
        let emitters = Emitters::new(&all, vec![]);
        // In the plane and on the rim as well.
        let plane = [V::new(0.1, 0.2, 1.0), V::new(-1.0, -0.5, 1.0), V::new(5.0, 0.1, 1.0), V::new(0.3, -0.5, 0.9999)];
        for p in receivers().into_iter().chain(plane) {
            for (i, u) in random_pairs(400).enumerate() {
                let emitter = Index1(i as u32 % 4);
                let s = emitters.sample(emitter, vector(p), 0.0, sampling, u, true);
                let (to, normal) = (s.point - vector(p), s.normal);
                let pdf = emitters.pdf(&EmitterHit { emitter, from: vector(p), to, normal, time: 0.0 }, sampling, true);
                assert_eq!(s.pdf.0, pdf.0, "emitter {i} from {p}");
                assert!(s.weight.r.is_finite() && s.weight.r >= 0.0 && !s.point.length().is_nan(), "{s:?}");
                let front = to.dot(normal) < 0.0 && pdf.0 > 0.0;
                assert!((s.weight.r > 0.0) == front && (!front || (s.weight.r * pdf.0 - 1.0).abs() < 1e-5), "{s:?}");
            }
        }
    }
}

/// In the plane of the light, and nearer to it or to an edge than f32 tells directions apart, points are drawn by area.
#[test]
fn what_cannot_be_told_is_drawn_by_area() {
    for light in lights() {
        let emitters = Emitters::new(&[light.emitter()], vec![]);
        let n = light.p[1].cross(light.p[2]).normalize();
        let [corner, e1, e2] = light.p;
        let on_edge = corner + e1 * 0.5;
        let inside = corner + e1 * 0.3 + e2 * 0.2 + n * 1e-7;
        for p in [on_edge, corner, on_edge + n * (1e-4 * e1.length()), inside] {
            for (a, b) in
                draw(&emitters, p, SolidAngle, random_pairs(100)).zip(draw(&emitters, p, Area, random_pairs(100)))
            {
                assert_eq!(
                    (a.point.array(), a.weight.r, a.pdf.0),
                    (b.point.array(), b.weight.r, b.pdf.0),
                    "{} {p}",
                    light.name
                );
            }
        }
    }
}

#[test]
fn points_lie_on_the_light_in_any_unit() {
    for light in lights() {
        for p in receivers() {
            let one: Vec<_> =
                draw(&Emitters::new(&[light.emitter()], vec![]), p, SolidAngle, random_pairs(200)).collect();
            for exponent in -6..=6 {
                let scale = 10.0_f32.powi(exponent);
                let scaled = light.scaled(scale);
                let emitters = Emitters::new(&[scaled.emitter()], vec![]);
                let [a, b, c] = scaled.p.map(|v| v.as_dvec3());
                let n = b.cross(c).normalize();
                for (s, unit) in draw(&emitters, p * scale, SolidAngle, random_pairs(200)).zip(&one) {
                    let point = dvec(s.point);
                    let error = f64::from(s.error);
                    // A bound per axis bounds the distance along n by its 1-norm.
                    assert!((point - a).dot(n).abs() <= error * n.abs().element_sum(), "{} {scale}", light.name);
                    let slack = 2.0 * error * (b.length() + c.length()) / b.cross(c).length();
                    let [x, y] = scaled.coordinates(point);
                    let rim = if light.parallelogram { x.max(y) } else { x + y };
                    assert!(x >= -slack && y >= -slack && rim <= 1.0 + 2.0 * slack, "{} {scale}: {x}, {y}", light.name);
                    // pdfs are per steradian: no unit shows, but for what rounding of the corners does from afar.
                    let off = f64::from(s.pdf.0) / f64::from(unit.pdf.0) - 1.0;
                    let bound = 1e-5 + 4.0 * error / (point - (p * scale).as_dvec3()).dot(n).abs();
                    assert!(off.abs() < bound, "{} from {p} × {scale}: {} for {}", light.name, s.pdf.0, unit.pdf.0);
                }
            }
        }
    }
}

#[test]
fn lanes_draw_what_one_draws() {
    use rebond_lanes::F32x16;
    let emitters = Emitters::new(&lights().map(Flat::emitter), vec![]);
    for p in receivers() {
        let us: Vec<[f32; 2]> = random_pairs(16).collect();
        let u = [0, 1].map(|k| F32x16::load(&us.iter().map(|u| u[k]).collect::<Vec<_>>()));
        let number = (0..16).fold(Index::splat(0), |v: <F32x16 as Real>::Index, i| v.with_lane(i, i as u32 % 4));
        let wide = emitters.sample::<F32x16>(
            number,
            Vec3::splat(p.to_array()),
            F32x16::zero(),
            SolidAngle,
            u,
            Mask::splat(true),
        );
        for (i, u) in us.iter().enumerate() {
            let one = emitters.sample::<f32>(Index1(i as u32 % 4), vector(p), 0.0, SolidAngle, *u, true);
            assert_eq!((wide.point.lane(i), wide.pdf.0.lane(i)), (one.point.lane(0), one.pdf.0));
        }
    }
}

/// Irradiance per unit radiance, one value a sample.
fn irradiances(emitters: &Emitters, p: V, n: V, sampling: LightSampling, seed: u64) -> Vec<f64> {
    let value = |s: EmitterSample<f32>| f64::from(s.weight.r * s.wi.dot(vector(n)).max(0.0));
    draw(emitters, p, sampling, seeded_pairs(40_000, seed)).map(value).collect()
}

const SEEDS: [u64; 3] = [1, 2, 3];
/// Of a whole family of tests.
const LEVEL: f64 = 0.01;

/// Judges means against exact values, all at once at [`LEVEL`] by Šidák's correction.
fn judge(tests: &[(String, Vec<f64>, f64)]) {
    let each = 1.0 - (1.0 - LEVEL).powf(1.0 / tests.len() as f64);
    for (name, samples, exact) in tests {
        let (p, mean) = (t_test_p_value(samples, *exact), samples.iter().sum::<f64>() / samples.len() as f64);
        assert!(p > each, "{name}: mean {mean}, exact {exact}, p {p:.1e}");
    }
}

#[test]
fn both_samplings_give_lamberts_irradiance() {
    let normals = [V::Z, V::new(0.6, 0.0, 0.8), V::new(-0.8, 0.6, 0.0)];
    for seed in SEEDS {
        let mut tests = Vec::new();
        let mut cut = 0;
        for light in lights() {
            let emitters = Emitters::new(&[light.emitter()], vec![]);
            let corners = light.corners();
            // Area sampling has no small variance close to the light: a mean of heavy tails is not normal.
            for p in [[0.1, 0.0, 0.0], [0.3, 0.4, 0.5], [2.0, 1.0, -1.0], [3.0, 2.0, -20.0], [-2.0, 0.3, 0.4]] {
                for n in normals {
                    let p = V::from_array(p);
                    let exact = from_polygon(p.as_dvec3(), n.as_dvec3(), &corners);
                    let below = corners.iter().filter(|c| (**c - p.as_dvec3()).dot(n.as_dvec3()) < 0.0).count();
                    cut += usize::from(below > 0 && below < corners.len());
                    for sampling in [Area, SolidAngle] {
                        let name = format!("{} from {p} normal {n}, {sampling:?}, seed {seed}", light.name);
                        tests.push((name, irradiances(&emitters, p, n, sampling, seed), exact));
                    }
                }
            }
            // By solid angle the tails are bounded: also close to it.
            let front = light.p[1].cross(light.p[2]).normalize();
            for (x, y, height) in [(0.4, 0.3, 0.05), (0.5, 0.2, 0.005), (1.1, 0.2, 0.1)] {
                for n in normals {
                    let p = light.at(x, y).as_vec3() + front * height;
                    let exact = from_polygon(p.as_dvec3(), n.as_dvec3(), &corners);
                    let name = format!("{} from {p} normal {n}, seed {seed}", light.name);
                    tests.push((name, irradiances(&emitters, p, n, SolidAngle, seed), exact));
                }
            }
        }
        assert!(cut >= 8, "the horizon cut {cut} lights only");
        judge(&tests);
    }
}

#[test]
fn round_lights_give_their_closed_forms() {
    for seed in SEEDS {
        let mut tests = Vec::new();
        for (distance, radius) in [(1.1_f32, 1.0_f32), (2.0, 1.0), (5.0, 0.01)] {
            let center = V::Z * distance;
            let sphere =
                Emitters::new(&[Emitter::Sphere { center, radius, inwards: false, radiance: [1.0; 3] }], vec![]);
            // The last two cut the sphere at the horizon where it is near.
            for degrees in [0.0_f32, 45.0, 85.0, 100.0] {
                let n = V::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
                let exact = from_sphere(DVec3::ZERO, n.as_dvec3(), center.as_dvec3(), f64::from(radius));
                let name = format!("sphere {radius} at {distance}, {degrees}°, seed {seed}");
                tests.push((name, irradiances(&sphere, V::ZERO, n, Area, seed), exact));
            }
        }
        for (height, offset, radius) in [(1.0, 0.0, 1.0), (0.5, 0.3, 1.0), (2.0, 3.0, 0.7)] {
            let center = V::new(offset, 0.0, height);
            let disk = Emitters::new(&[Emitter::Disk { center, normal: V::NEG_Z, radius, radiance: [1.0; 3] }], vec![]);
            let exact = from_parallel_disk(f64::from(height), f64::from(offset), f64::from(radius));
            tests.push((format!("disk {radius}, seed {seed}"), irradiances(&disk, V::ZERO, V::Z, Area, seed), exact));
        }
        judge(&tests);
    }
}

/// Variance of both estimators of irradiance: `∫ (A cosθ cosθ'/d² − E)² dA/A` and `∫ (Ω cosθ − E)² dω/Ω`.
#[test]
#[expect(clippy::print_stdout, reason = "a table for whoever asks with --nocapture")]
fn variances_are_those_of_theory() {
    println!("{:<14} {:>8} {:>12} {:>12} {:>12} {:>12}", "light", "height", "area", "theory", "solid angle", "theory");
    let mut tests = Vec::new();
    for light in lights() {
        let emitters = Emitters::new(&[light.emitter()], vec![]);
        let corners = light.corners();
        let center = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let [_, e1, e2] = light.p.map(|v| v.as_dvec3());
        let normal = e1.cross(e2).normalize();
        let cells = light.cells(500);
        let share = e1.cross(e2).length() * if light.parallelogram { 1.0 } else { 0.5 } / cells.len() as f64;
        let area = share * cells.len() as f64;
        for height in [0.2, 1.0, 10.0] {
            let p = (center - DVec3::Z * height).as_vec3();
            let from = p.as_dvec3();
            let (whole, e) = (light.whole(from), from_polygon(from, DVec3::Z, &corners));
            let (mut by_area, mut by_solid_angle) = (0.0, 0.0);
            for c in &cells {
                let [x, y] = [0, 1].map(|a| c.iter().map(|v| v[a]).sum::<f64>() / 3.0);
                let to = light.at(x, y) - from;
                let d2 = to.length_squared();
                let (cos, per_area) = ((to.z / d2.sqrt()).max(0.0), to.dot(normal).abs() / (d2 * d2.sqrt()));
                by_area += (area * cos * per_area - e).powi(2) * share / area;
                by_solid_angle += (whole * cos - e).powi(2) * per_area * share / whole;
            }
            let row = [(Area, by_area), (SolidAngle, by_solid_angle)].map(|(sampling, variance)| {
                let samples = irradiances(&emitters, p, V::Z, sampling, 4);
                let squares: Vec<f64> = samples.iter().map(|x| (x - e).powi(2)).collect();
                let mean = squares.iter().sum::<f64>() / squares.len() as f64;
                tests.push((format!("{} at {height}, {sampling:?}", light.name), squares, variance));
                [mean, variance]
            });
            let [[a, b], [c, d]] = row;
            println!("{:<14} {height:>8} {a:>12.3e} {b:>12.3e} {c:>12.3e} {d:>12.3e}", light.name);
        }
    }
    judge(&tests);
}
