//! Each emitter: χ² of its directions against its density, and irradiance against closed forms.

use super::*;
use crate::math::luminance;
use crate::testing::{SIGNIFICANCE, chi2_directions, random_pairs, t_test_p_value};
use rebond_lanes::scalar::Index1;

fn sample(e: Emitter, environments: Vec<Environment>, p: [f32; 3], n: usize) -> Vec<EmitterSample<f32>> {
    let emitters = Emitters::new(&[e], environments);
    random_pairs(n as u32)
        .map(|u| emitters.sample(Index1(0), Vec3::splat(p), 0.0, LightSampling::Area, u, true))
        .collect()
}

/// Irradiance at p on a surface with normal +z, with its samples.
fn irradiance(e: Emitter, environments: Vec<Environment>, p: [f32; 3]) -> Vec<f64> {
    sample(e, environments, p, 100_000).iter().map(|s| f64::from(s.weight.r * s.wi.z.max(0.0))).collect()
}

const LIGHT: [f32; 3] = [2.0, 1.0, 0.5];

fn rectangle(height: f32) -> Emitter {
    // [−1, 1]² at this height, facing down.
    Emitter::Parallelogram { p: [V::new(-1.0, -1.0, height), V::Y * 2.0, V::X * 2.0], radiance: LIGHT }
}

fn sphere(center: V, radius: f32, inwards: bool) -> Emitter {
    Emitter::Sphere { center, radius, inwards, radiance: LIGHT }
}

#[test]
fn irradiance_has_its_closed_form() {
    let check = |name: &str, samples: Vec<f64>, exact: f64| {
        let (p, mean) = (t_test_p_value(&samples, exact), samples.iter().sum::<f64>() / samples.len() as f64);
        assert!(p > SIGNIFICANCE, "{name}: mean {mean}, exact {exact}, p {p:.1e}");
    };
    // A rectangle a × b parallel above one of its corners' feet, height h: the form factor of a differential element
    // (Howell's catalogue B-3), four quarters of it around the centre.
    let quarter = |a: f64, b: f64, h: f64| {
        let (x, y) = (a / h, b / h);
        let part = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
        (part(x, y) + part(y, x)) / std::f64::consts::TAU
    };
    for h in [0.3, 1.0, 4.0] {
        let exact = 2.0 * std::f64::consts::PI * 4.0 * quarter(1.0, 1.0, h);
        check("rectangle", irradiance(rectangle(h as f32), vec![], [0.0; 3]), exact);
    }
    // A triangle with its right angle above the point is one half of the square by symmetry.
    let triangle = Emitter::Triangle { p: [V::new(0.0, 0.0, 1.0), V::Y, V::X + V::Y], radiance: LIGHT };
    check(
        "triangle",
        irradiance(triangle, vec![], [0.0; 3]),
        2.0 * std::f64::consts::PI * quarter(1.0, 1.0, 1.0) / 2.0,
    );
    // A disk of radius r on the axis at height h, and a sphere: π L sin²θ.
    let disk = Emitter::Disk { center: V::Z * 2.0, normal: V::NEG_Z, radius: 1.0, radiance: LIGHT };
    check("disk", irradiance(disk, vec![], [0.0; 3]), 2.0 * std::f64::consts::PI / 5.0);
    for (d, r) in [(2.0, 1.0), (10.0, 0.01), (1.01, 1.0)] {
        let exact = 2.0 * std::f64::consts::PI * r * r / (d * d);
        check("sphere", irradiance(sphere(V::Z * d as f32, r as f32, false), vec![], [0.0; 3]), exact);
    }
    // Inside a shining sphere it is π L wherever one stands.
    for p in [[0.0; 3], [0.3, 0.2, -0.4]] {
        check("inside a sphere", irradiance(sphere(V::ZERO, 1.0, true), vec![], p), 2.0 * std::f64::consts::PI);
    }
    // Surroundings: π L; and an image cos-weighted towards +y: L = 1 + y, E(+z) = π.
    check(
        "constant",
        irradiance(Emitter::Environment { number: 0, mean: LIGHT }, vec![Environment::Constant(LIGHT)], [0.0; 3]),
        2.0 * std::f64::consts::PI,
    );
    let (w, h) = (64, 256);
    let texels: Vec<[f32; 3]> = (0..w * h).map(|i| [1.0 + (PI * ((i / w) as f32 + 0.5) / h as f32).cos(); 3]).collect();
    let image = |frame| {
        Environment::Image(Box::new(EnvironmentImage::new([w as u32, h as u32], &texels, frame).expect("light")))
    };
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mean = Emitter::Environment { number: 0, mean: [1.0; 3] };
    check("image", irradiance(mean, vec![image(upright)], [0.0; 3]), std::f64::consts::PI);
    // Turned so that local +y is world +z: E = π + ∫ cos² = π + 2π/3.
    let turned = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    check("turned image", irradiance(mean, vec![image(turned)], [0.0; 3]), std::f64::consts::PI * (1.0 + 2.0 / 3.0));
}

#[test]
fn directions_follow_their_densities() {
    let image = {
        let texels: Vec<[f32; 3]> =
            (0..32 * 16).map(|i| if i % 37 < 3 { [40.0, 3.0, 1.0] } else { [0.0, 0.1, 0.2] }).collect();
        EnvironmentImage::new([32, 16], &texels, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]).expect("light")
    };
    // Surfaces: the density at a direction is asked at the point where it meets the surface.
    type Meet = Box<dyn Fn(Vec3<f32>) -> Option<(Vec3<f32>, Vec3<f32>)>>;
    let plane: Meet = Box::new(|w| {
        let to = w * (0.7 / w.z);
        (w.z > 0.0 && to.x.abs() <= 1.0 && to.y.abs() <= 1.0).then_some((to, Vec3::splat([0.0, 0.0, -1.0])))
    });
    let ball = |center: [f32; 3], r: f32| -> Meet {
        Box::new(move |w| {
            let c = Vec3::splat(center);
            let (b, q) = (w.dot(c), c.dot(c) - r * r);
            let root = b * b - q;
            let t = if q > 0.0 { b - root.max(0.0).sqrt() } else { b + root.max(0.0).sqrt() };
            (root >= 0.0 && t > 0.0).then(|| (w * t, (w * t - c).normalized()))
        })
    };
    let cases: Vec<(&str, Emitter, Meet)> = vec![
        ("rectangle", rectangle(0.7), plane),
        ("sphere from outside", sphere(V::new(1.0, 0.5, 1.0), 0.9, false), ball([1.0, 0.5, 1.0], 0.9)),
        ("sphere by a cap", sphere(V::new(1.0, 0.5, 1.0), 0.9, false), ball([1.0, 0.5, 1.0], 0.9)),
        ("sphere from inside", sphere(V::new(0.3, 0.2, 0.1), 0.9, true), {
            let b = ball([0.3, 0.2, 0.1], 0.9);
            Box::new(move |w| b(w).map(|(to, n)| (to, -n)))
        }),
    ];
    for (name, e, meet) in cases {
        let mut emitters = Emitters::new(&[e], vec![]);
        if let ("sphere by a cap", Emitter::Sphere { center, .. }) = (name, e) {
            let axis = (V::new(0.1, -0.3, 0.2) - center).normalize();
            emitters.set_cap(0, Vec3::splat(axis.to_array()), 0.1);
        }
        let draw = |u| Some(emitters.sample(Index1(0), Vec3::zero(), 0.0, LightSampling::Area, u, true).wi);
        let pdf = |w: Vec3<f32>| match meet(w) {
            None => 0.0,
            Some((to, normal)) => {
                emitters
                    .pdf(
                        &EmitterHit { emitter: Index1(0), from: Vec3::zero(), to, normal, time: 0.0 },
                        LightSampling::Area,
                        true,
                    )
                    .0
            }
        };
        chi2_directions(name, draw, pdf);
    }
    let environment = Environment::Image(Box::new(image));
    chi2_directions("image", |u| Some(environment.sample(u).0), |w| environment.eval(w).1.0);
    // What a sample says of itself is what is said of its direction, but for directions that round to another texel.
    let strays = random_pairs(2000).filter(|u| {
        let (w, pdf, radiance) = environment.sample::<f32>(*u);
        let (other, again) = environment.eval(w);
        (again.0 / pdf.0 - 1.0).abs() > 1e-3 || (other.r / radiance.r - 1.0).abs() > 1e-2
    });
    assert!(strays.count() < 20);
    // Density follows radiance: L/pdf hardly varies, away from the poles (sinθ bends within the outermost rows).
    let weight = |u| {
        let (w, pdf, radiance) = environment.sample::<f32>(u);
        // This image's top is world +z.
        (w.z.abs() < 0.9).then(|| luminance(radiance.lane(0)) / pdf.0)
    };
    let weights: Vec<f32> = random_pairs(4000).filter_map(weight).collect();
    let n = weights.len() as f32;
    let mean = weights.iter().sum::<f32>() / n;
    let variance = weights.iter().map(|w| (w / mean - 1.0).powi(2)).sum::<f32>() / n;
    assert!(variance < 5e-3, "relative variance of L/pdf: {variance}");
}

#[test]
fn points_and_beams_have_no_density_and_the_right_irradiance() {
    let at = |e, p: [f32; 3]| sample(e, vec![], p, 1)[0];
    let point = Emitter::Point { position: V::new(0.0, 3.0, 4.0), intensity: [50.0, 25.0, 0.0] };
    let s = at(point, [0.0; 3]);
    assert_eq!((s.weight.r, s.weight.g, s.pdf.0), (2.0, 1.0, 0.0));
    let sun = at(Emitter::Directional { direction: V::NEG_Z, irradiance: LIGHT }, [5.0; 3]);
    assert!(sun.infinite && sun.wi.z == 1.0 && sun.weight.r == 2.0);
    let angles = [20.0_f32.to_radians(), 40.0_f32.to_radians()];
    let spot = Emitter::Spot { position: V::ZERO, axis: V::Z, angles, intensity: [1.0; 3] };
    for (degrees, share) in
        [(0.0, 1.0), (19.0, 1.0), (25.0, 0.75), (30.0, 0.5), (39.9, 0.005), (41.0, 0.0), (180.0, 0.0)]
    {
        let a = f32::to_radians(degrees);
        assert!((at(spot, [a.sin(), 0.0, a.cos()]).weight.r - share).abs() < 1e-4, "{degrees}°");
    }
    // Its power: the ramp integrated numerically.
    let sum: f64 = (0..200_000)
        .map(|i| {
            let a = (f64::from(i) + 0.5) / 200_000.0 * std::f64::consts::PI;
            let ramp = ((f64::from(angles[1]) - a) / f64::from(angles[1] - angles[0])).clamp(0.0, 1.0);
            ramp * std::f64::consts::TAU * a.sin() * std::f64::consts::PI / 200_000.0
        })
        .sum();
    assert!((spot.power(1.0)[0] / sum - 1.0).abs() < 1e-4);
}

#[test]
fn the_choice_follows_power() {
    let emitters =
        [rectangle(1.0), Emitter::Point { position: V::ONE, intensity: [0.0; 3] }, sphere(V::ONE, 0.5, false)];
    let choice = LightSampler::new(&emitters, 1.0, Some(LightChoice::Power)).expect("finite powers");
    let p: Vec<f32> = (0..3).map(|i| choice.probability::<f32>(Vec3::zero(), Vec3::zero(), Index1(i), true)).collect();
    assert!((p[0] / p[2] - 4.0 / PI).abs() < 1e-5 && p[1] == 0.0);
    assert!(
        LightSampler::new(&emitters, f32::INFINITY, None).is_some(),
        "only infinite lights shine on the whole scene"
    );
    let sky = Emitter::Environment { number: 0, mean: [1.0; 3] };
    assert!(
        LightSampler::new(&[sky], f32::INFINITY, None).is_none() && LightSampler::new(&[sky], 1e30, None).is_some()
    );
    let nothing = LightSampler::new(&[], 1.0, None).expect("nothing");
    assert!(nothing.sample(Vec3::zero(), Vec3::zero(), || 0.5_f32, true).is_none());
}
