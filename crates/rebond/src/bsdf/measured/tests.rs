//! Tables against their definitions, samplers against their densities, lanes against single points.

use super::*;
use crate::bsdf::capture::{CaptureSettings, capture};
use crate::bsdf::check::{Angles, Effort, sampling_directions};
use crate::bsdf::tests::samples_agree;
use crate::math::vec3;
use crate::testing::random_pairs;
use rebond_lanes::F32x16;

/// Numbers in [0, 1) that hang on a seed only.
fn noise(seed: u32) -> impl Fn(usize) -> f32 {
    move |i| {
        let mut x = (i as u32).wrapping_mul(0x9e37_79b9) ^ seed.wrapping_mul(0x85eb_ca6b);
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        ((x ^ (x >> 16)) >> 8) as f32 / 16_777_216.0
    }
}

fn colors(n: usize, seed: u32) -> Vec<[f32; 3]> {
    let value = noise(seed);
    (0..n).map(|i| [0, 1, 2].map(|c| value(3 * i + c) + 0.1)).collect()
}

fn random_angles(size: [u32; 4], seed: u32) -> AngleTable {
    AngleTable::new(size, colors(AngleTable::count(size).expect("a size"), seed)).expect("a table")
}

/// A lobe around the half vector, over a base, with values that hang on all three angles.
fn half_difference(size: [u32; 3], narrow: f32) -> HalfDifferenceTable {
    let [h, d, p] = size;
    let value = |i: u32| {
        let part = |k: u32, n: u32| (k as f32 + 0.5) / n as f32;
        let (x, y, z) = (part(i / p / d, h), part(i / p % d, d), part(i % p, p));
        let lobe = (-narrow * x.powi(4)).exp() * (1.0 + 3.0 * y) * (1.5 + (std::f32::consts::TAU * z).cos());
        [0.1 + lobe * narrow * 0.01, 0.2 + lobe * narrow * 0.02, 0.05]
    };
    HalfDifferenceTable::new(size, (0..h * d * p).map(value).collect()).expect("a table")
}

/// Angles that grow unevenly up to about the horizon, and about the normal over a share of a turn.
fn random_adaptive(tilts: u32, turns: u32, share: f32, jacobian: bool, seed: u32) -> AdaptiveTable {
    let value = noise(seed);
    let theta = (0..tilts).map(|i| (i as f32 / tilts as f32).powf(0.8) * 1.55).collect();
    let phi = match turns {
        1 => vec![0.0],
        n => (0..n).map(|i| PI * (2.0 * share * i as f32 / (n - 1) as f32 - 1.0)).collect(),
    };
    let numbers = |n: usize, from: usize| (0..n).map(|i| value(from + i) + 0.05).collect::<Vec<f32>>();
    let grids = (tilts * turns) as usize;
    let grid =
        |x: u32, y: u32, n: usize, from: usize| Grid2 { size: [x, y], values: numbers((x * y) as usize * n, from) };
    let color = Grid2 { size: [7, 6], values: colors(42 * grids, seed + 1) };
    AdaptiveTable::new(theta, phi, grid(9, 5, 1, 0), grid(6, 3, 1, 1000), grid(11, 8, grids, 2000), color, jacobian)
        .expect("a table")
}

use std::f32::consts::PI;

fn phong(exponent: f32, size: [u32; 4]) -> AngleTable {
    let mut p = [0.0; PARAMETERS];
    p[0] = exponent;
    let frame = Frame { s: vec3(1.0, 0.0, 0.0), t: vec3(0.0, 1.0, 0.0), n: vec3(0.0, 0.0, 1.0) };
    let lobe = Lobe { color: Rgb::splat([0.9, 0.8, 0.7]), p };
    let model = Model::Phong as u32;
    let bsdf = Bsdf::new(Index1(model), 1 << model, lobe, frame, frame.n, true);
    let settings = CaptureSettings { size, samples: 0, noise: 0.0, seed: 1 };
    capture(&Material::new(vec![(1.0, bsdf)]), &settings).expect("a table")
}

fn tables() -> Vec<(&'static str, Measured)> {
    vec![
        ("phong 30", Measured::Angles(phong(30.0, [30, 1, 30, 60]))),
        ("phong 5, as if anisotropic", Measured::Angles(phong(5.0, [9, 16, 9, 16]))),
        ("random isotropic", Measured::Angles(random_angles([5, 1, 7, 9], 1))),
        ("random anisotropic", Measured::Angles(random_angles([4, 5, 6, 7], 2))),
        ("black", Measured::Angles(AngleTable::new([2, 1, 2, 2], vec![[0.0; 3]; 8]).expect("a table"))),
        ("broad half vectors", Measured::HalfDifference(half_difference([20, 10, 12], 30.0))),
        ("narrow half vectors", Measured::HalfDifference(half_difference([90, 30, 36], 3000.0))),
        ("coarse half vectors", Measured::HalfDifference(half_difference([3, 2, 1], 10.0))),
        ("even half vectors", Measured::HalfDifference(half_difference([1, 1, 1], 0.0))),
        ("isotropic adaptive", Measured::Adaptive(random_adaptive(5, 1, 1.0, true, 3))),
        ("isotropic adaptive of two turns", Measured::Adaptive(random_adaptive(4, 2, 1.0, false, 4))),
        ("anisotropic adaptive", Measured::Adaptive(random_adaptive(3, 9, 1.0, true, 5))),
        ("half a turn", Measured::Adaptive(random_adaptive(3, 5, 0.5, true, 6))),
        ("a quarter of a turn", Measured::Adaptive(random_adaptive(3, 4, 0.25, false, 7))),
    ]
}

fn material(measured: &Measured) -> Material {
    measured.material().expect("a small table")
}

fn directions() -> impl Iterator<Item = Vec3<f32>> {
    sampling_directions(false).into_iter().map(Angles::direction)
}

/// At least 20 pairs of a direction and a table for each model; 1 % for all of a model's together.
#[test]
fn samples_follow_their_densities() {
    for model in Model::ALL.into_iter().filter(|m| m.is_measured()) {
        let of_model = tables().into_iter().filter(|(_, m)| m.model() == model);
        samples_agree(of_model.map(|(name, measured)| {
            let found = material(&measured).check_sampling(&Effort::default(), &sampling_directions(false));
            assert_eq!(found.tests.is_empty(), name == "black");
            (name, found)
        }));
    }
}

#[test]
fn weights_are_bounded_and_densities_nowhere_missing() {
    for (name, measured) in tables() {
        let material = material(&measured);
        for a in directions() {
            for u in random_pairs(2000) {
                let b = crate::sampling::warp::cosine_hemisphere(u);
                let (f, pdf) = material.eval(a, b, TransportMode::Radiance);
                let least = if f == [0.0; 3] { 0.0 } else { b.z * COSINE_SHARE / PI * 0.999 };
                assert!(pdf.is_finite() && pdf >= least, "{name}: {pdf} at {b:?}");
                assert!(f.iter().all(|x| x.is_finite() && *x >= 0.0), "{name}: {f:?}");
                let s = material.sample(a, 0.0, u, (u[0] * 4096.0).fract(), TransportMode::Radiance);
                let weight = s.weight.lane(0);
                assert!(weight.iter().all(|w| w.is_finite() && *w >= 0.0), "{name}: {weight:?}");
            }
        }
    }
}

/// Light and viewer keep their roles whichever of them a path comes from.
#[test]
fn tables_tell_light_from_viewer() {
    let mut different = 0;
    for (name, measured) in tables() {
        let material = material(&measured);
        for a in directions() {
            for u in random_pairs(50) {
                let b = crate::sampling::warp::cosine_hemisphere(u);
                let camera = material.eval(a, b, TransportMode::Radiance).0;
                assert_eq!(camera, material.eval(b, a, TransportMode::Importance).0, "{name}");
                different += u32::from(camera != material.eval(b, a, TransportMode::Radiance).0);
            }
        }
    }
    assert!(different > 1000, "random tables are not reciprocal");
}

#[test]
fn angles_are_interpolated_along_four_axes() {
    for (size, seed) in [([4, 5, 6, 7], 11), ([3, 2, 1, 4], 12), ([5, 1, 7, 9], 13), ([1, 1, 1, 1], 14)] {
        let table = random_angles(size, seed);
        let material = material(&Measured::Angles(table.clone()));
        // The definition, in f64.
        let at = |i: [usize; 4]| {
            let n = size.map(|n| n as usize);
            f64::from(table.values()[((i[0] * n[1] + i[1]) * n[2] + i[2]) * n[3] + i[3]][1])
        };
        let expected = |angles: [f64; 4]| {
            let isotropic = size[1] == 1;
            let relative = if isotropic { angles[3] - angles[1] } else { angles[3] };
            let place = [angles[0] / 90.0, angles[1] / 360.0, angles[2] / 90.0, relative / 360.0];
            let mut sum = 0.0;
            for corner in 0..16 {
                let (mut index, mut weight) = ([0; 4], 1.0);
                for axis in 0..4 {
                    let (n, up) = (size[axis] as usize, corner >> axis & 1);
                    let x = place[axis] * n as f64;
                    let (low, part) = if axis % 2 == 1 {
                        (x.rem_euclid(n as f64).floor() as usize, x.rem_euclid(1.0))
                    } else {
                        let x = x.min((n - 1) as f64);
                        (x.floor() as usize, x.fract())
                    };
                    index[axis] = if axis % 2 == 1 { (low + up) % n } else { (low + up).min(n - 1) };
                    weight *= if up == 1 { part } else { 1.0 - part };
                }
                sum += weight * at(index);
            }
            sum
        };
        for (u, v) in random_pairs(500).zip(random_pairs(1000).skip(500)) {
            let angles = [u[0] * 90.0, u[1] * 360.0, v[0] * 90.0, v[1] * 360.0].map(f64::from);
            let direction = |theta, phi| Angles { theta, phi }.direction();
            let (light, viewer) = (direction(angles[0], angles[1]), direction(angles[2], angles[3]));
            if light.z.min(viewer.z) < 1e-3 || light.z.max(viewer.z) > 0.9999 {
                continue;
            }
            let found = f64::from(material.eval(viewer, light, TransportMode::Radiance).0[1]);
            let expected = expected(angles);
            assert!((found - expected).abs() < 2e-4, "{size:?} at {angles:?}: {found} for {expected}");
        }
    }
}

#[test]
fn missing_values_are_those_next_to_them() {
    let mut values = vec![[1.0, 2.0, 3.0]; 2 * 3 * 2];
    // (θh, θd, φd): the second θd of the first θh, and the first and second of the second θh, for the first φd.
    for (h, d) in [(0, 1), (1, 0), (1, 1)] {
        values[(h * 3 + d) * 2] = [-1.0, 0.0, 0.0];
    }
    values[0] = [4.0; 3];
    values[(3 + 2) * 2] = [5.0; 3];
    let table = HalfDifferenceTable::new([2, 3, 2], values).expect("a table");
    assert_eq!(table.missing(), 3);
    assert_eq!(table.values()[2], [4.0; 3], "from below");
    assert_eq!((table.values()[6], table.values()[8]), ([5.0; 3], [5.0; 3]), "from above, where there is none below");
    assert_eq!(table.values()[3], [1.0, 2.0, 3.0]);
    let nothing = HalfDifferenceTable::new([1, 2, 1], vec![[-1.0; 3]; 2]).expect("a table");
    assert_eq!((nothing.missing(), nothing.values()), (2, &[[0.0; 3]; 2][..]));
}

#[test]
fn what_is_no_table_is_refused() {
    let ok = || vec![[1.0; 3]; 16];
    assert!(AngleTable::new([2, 2, 2, 2], ok()).is_ok());
    assert!(AngleTable::new([2, 2, 2, 3], ok()).is_err());
    assert!(AngleTable::new([0, 2, 2, 2], Vec::new()).unwrap_err().contains("θi"));
    assert!(AngleTable::new([u32::MAX; 4], ok()).unwrap_err().contains("2^28"));
    for bad in [-1.0, f32::NAN, f32::INFINITY] {
        let mut values = ok();
        values[3][1] = bad;
        assert!(AngleTable::new([2, 2, 2, 2], values.clone()).unwrap_err().contains("value 10"));
        assert_eq!(HalfDifferenceTable::new([2, 2, 4], values).is_ok(), bad == -1.0);
    }
    assert!(HalfDifferenceTable::new([u32::MAX; 3], ok()).is_err());
    let grid = |x: u32, y: u32, n: usize| Grid2 { size: [x, y], values: vec![1.0; n] };
    let adaptive = |theta: Vec<f32>, phi: Vec<f32>, vndf: Grid2<f32>| {
        let color = Grid2 { size: [2, 2], values: vec![[1.0; 3]; 4 * theta.len() * phi.len()] };
        AdaptiveTable::new(theta, phi, grid(2, 2, 4), grid(2, 2, 4), vndf, color, true)
    };
    assert!(adaptive(vec![0.0, 1.0], vec![0.0], grid(2, 2, 8)).is_ok());
    assert!(adaptive(vec![1.0, 0.0], vec![0.0], grid(2, 2, 8)).unwrap_err().contains("theta_i"));
    assert!(adaptive(vec![0.0, f32::NAN], vec![0.0], grid(2, 2, 8)).unwrap_err().contains("theta_i"));
    assert!(adaptive(vec![0.0, 1.0], vec![0.0, 0.5, 1.0], grid(2, 2, 24)).unwrap_err().contains("phi_i"));
    assert!(adaptive(vec![0.0, 1.0], vec![0.0], grid(1, 2, 4)).unwrap_err().contains("vndf"));
    let empty = Grid2 { size: [2, 2], values: vec![1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0] };
    assert!(adaptive(vec![0.0, 1.0], vec![0.0], empty).unwrap_err().contains("grid 1"));
}

/// Sixteen materials of all kinds at once, and one after the other.
#[test]
fn lanes_agree_with_single_points() {
    let mut tables = Tables::default();
    let all: Vec<(Model, u32)> =
        self::tables().iter().map(|(_, m)| (m.model(), tables.add(m).expect("small tables"))).collect();
    let frame = Frame::with_tangent(vec3(0.3, -0.5, 0.8).normalized(), vec3(1.0, 0.2, 0.1));
    let wide_vector = |v: Vec3<f32>| Vec3::<F32x16>::splat(v.array());
    let lane = |i: usize| all[i % all.len()];
    let (mut p, mut model) = ([F32x16::splat(0.0); PARAMETERS], <F32x16 as Real>::Index::splat(0));
    for i in 0..16 {
        model = model.with_lane(i, lane(i).0 as u32);
        p[0] = p[0].with_lane(i, f32::from_bits(lane(i).1));
    }
    let wide_frame = Frame { s: wide_vector(frame.s), t: wide_vector(frame.t), n: wide_vector(frame.n) };
    let all_lanes = rebond_lanes::Mask::splat(true);
    let lobe = Lobe { color: Rgb::white(), p };
    let wide = Bsdf::new(model, (1 << Model::ALL.len()) - 1, lobe, wide_frame, wide_frame.n, all_lanes);
    let wide = wide.with_tables(&tables);
    for mode in [TransportMode::Radiance, TransportMode::Importance] {
        for local in directions() {
            let known = frame.to_world(local);
            for u in random_pairs(50) {
                let choice = (u[0] * 4096.0).fract();
                let other = frame.to_world(crate::sampling::warp::uniform_sphere(u));
                let s =
                    wide.sample(wide_vector(known), u.map(F32x16::splat), || F32x16::splat(choice), mode, all_lanes);
                let v = wide.eval(wide_vector(known), wide_vector(other), mode, all_lanes);
                for i in 0..16 {
                    let (model, number) = lane(i);
                    let mut p = [0.0; PARAMETERS];
                    p[0] = f32::from_bits(number);
                    let lobe = Lobe { color: Rgb::white(), p };
                    let one = Bsdf::new(Index1(model as u32), 1 << model as u32, lobe, frame, frame.n, true);
                    let one = one.with_tables(&tables);
                    let value = one.eval(known, other, mode, true);
                    assert_eq!((v.f.lane(i), v.pdf.0.lane(i)), (value.f.lane(0), value.pdf.0), "{model:?}");
                    let sample = one.sample(known, u, || choice, mode, true);
                    assert_eq!(s.weight.lane(i), sample.weight.lane(0), "{model:?}");
                    if sample.weight.is_lit() {
                        assert_eq!((s.w.lane(i), s.pdf.0.lane(i)), (sample.w.lane(0), sample.pdf.0), "{model:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn capturing_is_exact_where_it_samples() {
    let size = [6, 8, 5, 10];
    let original = material(&Measured::Angles(random_angles([3, 4, 5, 2], 21)));
    let table = capture(&original, &CaptureSettings { size, samples: 0, noise: 0.0, seed: 1 }).expect("a table");
    let again = material(&Measured::Angles(table));
    for i in 0..size.iter().product() {
        let (l, k, j, i) = (i % 10, i / 10 % 5, i / 50 % 8, i / 400);
        let direction = |tilt: u32, tilts: u32, turn: u32, turns: u32| {
            let part = |k: u32, n: u32| f64::from(k) / f64::from(n);
            Angles { theta: 90.0 * part(tilt, tilts), phi: 360.0 * part(turn, turns) }.direction()
        };
        let (light, viewer) = (direction(i, 6, j, 8), direction(k, 5, l, 10));
        // At the pole the azimuth is lost.
        if i > 0 && k > 0 {
            let f = |m: &Material| m.eval(viewer, light, TransportMode::Radiance).0[1];
            assert!((f(&original) - f(&again)).abs() < 1e-5, "{} for {}", f(&again), f(&original));
        }
    }
}

#[test]
fn averaged_values_are_means_over_their_cells() {
    // f = cosθi in the mean over [½, 1½] steps of 30°, by solid angle: half the sum of the cosines at the ends.
    let ramp = |theta: f64| theta.to_radians().cos() as f32;
    let n = 90;
    let values: Vec<[f32; 3]> = (0..n).map(|i| [ramp(f64::from(i)); 3]).collect();
    let original = material(&Measured::Angles(AngleTable::new([n, 1, 1, 1], values).expect("a table")));
    let settings = CaptureSettings { size: [3, 1, 1, 1], samples: 40_000, noise: 0.0, seed: 1 };
    let table = capture(&original, &settings).expect("a table");
    for (i, [lo, hi]) in [[0.0, 15.0], [15.0, 45.0], [45.0, 90.0]].into_iter().enumerate() {
        let exact = f64::from(ramp(lo) + ramp(hi)) / 2.0;
        // The deviation is at most a quarter of 1 − 0.7 over √40 000; the last cell's of 0.7. Beyond 89° the ramp ends.
        assert!((f64::from(table.values()[i][0]) - exact).abs() < 5.0 * 0.7 / 12.0_f64.sqrt() / 200.0, "{i}");
    }
    // Noise has the mean and the deviation that were asked for.
    let even = material(&Measured::Angles(AngleTable::new([1, 1, 1, 1], vec![[0.5; 3]]).expect("a table")));
    let settings = CaptureSettings { size: [40, 1, 40, 40], samples: 0, noise: 0.1, seed: 1 };
    let noisy = capture(&even, &settings).expect("a table");
    let n = noisy.values().len() as f64;
    let mean = noisy.values().iter().map(|v| f64::from(v[0])).sum::<f64>() / n;
    let deviation = (noisy.values().iter().map(|v| (f64::from(v[0]) - mean).powi(2)).sum::<f64>() / n).sqrt();
    assert!((mean - 0.5).abs() < 5.0 * 0.05 / n.sqrt() && (deviation - 0.05).abs() < 5.0 * 0.05 / (2.0 * n).sqrt());
}
