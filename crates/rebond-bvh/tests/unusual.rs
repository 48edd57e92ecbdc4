//! Empty scenes, bad input, rays that are not numbers, instances.

mod common;
use common::*;
use rebond_bvh::{Accel, BuildError, BuildOptions, Geometry, Instance, MISS, Preset, Ray, Sphere};
use rebond_lanes::{F32x16, Index, Mask, Mask16, Real};

fn build(geometries: Vec<Geometry>, instances: Vec<Instance>) -> Result<Accel, BuildError> {
    Accel::build(geometries, instances, &BuildOptions::default()).map(|built| built.0)
}

#[test]
fn nothing() {
    for accel in [
        build(vec![], vec![]).unwrap(),
        build(vec![Geometry::default()], vec![instance(0, IDENTITY)]).unwrap(),
        build(vec![blob(1, 0.0)], vec![]).unwrap(),
        build(vec![Geometry::default()], vec![instance(0, IDENTITY), instance(0, IDENTITY)]).unwrap(),
    ] {
        let (lo, hi) = accel.bounds();
        assert!(lo[0] > hi[0]);
        let ray = ray([0.0; 3], [0.0, 0.0, 1.0]);
        assert_eq!(closest(&accel, &ray), None);
        assert!(!accel.occluded(&ray, true));
    }
}

#[test]
fn errors_and_counts() {
    let broken = Geometry { positions: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 2], [0, 1, 3]], ..Default::default() };
    assert_eq!(
        build(vec![Geometry::default(), broken], vec![]).unwrap_err(),
        BuildError::VertexOutOfRange { geometry: 1, triangle: 1 }
    );
    assert_eq!(
        build(vec![], vec![instance(3, IDENTITY)]).unwrap_err(),
        BuildError::MissingGeometry { instance: 0, geometry: 3 }
    );
    let mut flat = IDENTITY;
    flat[1][1] = 0.0;
    assert_eq!(
        build(vec![blob(1, 0.0)], vec![instance(0, IDENTITY), instance(0, flat)]).unwrap_err(),
        BuildError::SingularMatrix { instance: 1 }
    );
    flat[1][1] = f32::NAN;
    assert_eq!(
        build(vec![blob(1, 0.0)], vec![instance(0, flat)]).unwrap_err(),
        BuildError::NonFiniteMatrix { instance: 0 }
    );
    let mut mesh = blob(2, 0.0);
    let n = mesh.triangles.len() as u32;
    mesh.positions.push([f32::NAN, 0.0, 0.0]);
    mesh.positions.push([0.0, f32::INFINITY, 0.0]);
    let last = mesh.positions.len() as u32 - 1;
    mesh.triangles.insert(0, [0, 0, 1]);
    mesh.triangles.insert(1, [0, 1, last]);
    mesh.triangles.insert(2, [0, 1, last - 1]);
    mesh.spheres.push(Sphere { center: [0.0; 3], radius: -1.0 });
    mesh.spheres.push(Sphere { center: [9.0, 0.0, 0.0], radius: 1.0 });
    let (accel, report) = Accel::build(vec![mesh], vec![instance(0, IDENTITY)], &BuildOptions::default()).unwrap();
    assert_eq!((report.degenerate_triangles, report.non_finite_triangles, report.invalid_shapes), (1, 2, 1));
    assert_eq!(closest(&accel, &ray([20.0, 0.0, 0.0], [-1.0, 0.0, 0.0])), Some((n + 4, 10.0)));
    assert!((3..n + 3).contains(&closest(&accel, &ray([0.0; 3], [0.3, 0.2, 1.0])).unwrap().0));
}

#[test]
fn rays_that_are_not_numbers_miss() {
    let mesh = together([
        blob(8, 0.1),
        Geometry { spheres: vec![Sphere { center: [0.0; 3], radius: 0.1 }], ..Default::default() },
    ]);
    let scenes = [
        accel(&mesh, Preset::Default),
        accel(&blob(1, 0.0), Preset::Default),
        build(
            vec![mesh],
            vec![
                instance(0, IDENTITY),
                instance(0, [[2.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]),
            ],
        )
        .unwrap(),
    ];
    let odd =
        [0.0, -0.0, 1.0, -1.0, 1e-45, 1e-38, 1e-20, 1e20, 3e38, f32::MAX, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
    let mut random = Random::new(4);
    for accel in &scenes {
        let mut pick = || odd[random.below(odd.len())];
        for i in 0..1_500 {
            let mut o: [f32; 3] = std::array::from_fn(|_| pick());
            if i % 2 == 0 {
                o = [0.3, 0.2, 0.1];
            }
            let d: [f32; 3] = std::array::from_fn(|_| pick());
            let ray = Ray { o, d, tmax: if i % 3 == 0 { pick() } else { f32::INFINITY }, time: pick() };
            let hit = accel.closest(&ray, true, i % 5 == 0);
            let dark = accel.occluded(&ray, true);
            let finite = o.iter().chain(&d).all(|x| x.is_finite()) && d != [0.0; 3] && ray.tmax >= 0.0;
            if !finite {
                assert!(hit.primitive.lane(0) == MISS && !dark, "{ray:?}");
            }
            assert_eq!(hit.primitive.lane(0) != MISS, dark, "{ray:?}");
            let wide = Ray {
                o: o.map(F32x16::splat),
                d: d.map(F32x16::splat),
                tmax: F32x16::splat(ray.tmax),
                time: F32x16::splat(ray.time),
            };
            let mask = <F32x16 as Real>::Mask::from_bits(0x00f3);
            let packet = accel.closest(&wide, mask, i % 5 == 0);
            for lane in 0..16 {
                let expected = if mask.bits() >> lane & 1 == 1 { hit.primitive.lane(0) } else { MISS };
                assert_eq!(packet.primitive.lane(lane), expected, "{ray:?}");
            }
            assert_eq!(accel.occluded(&wide, mask).bits(), if dark { 0x00f3 } else { 0 }, "{ray:?}");
        }
        let inside = ray([0.3, 0.2, 0.1], [1.0, 2.0, -1.0]);
        let (primitive, t) = closest(accel, &inside).unwrap();
        for scale in [1e-30_f32, 1e-15, 1e15, 1e30] {
            let (p, s) = closest(accel, &ray(inside.o, inside.d.map(|x| x * scale))).unwrap();
            assert!(p == primitive && (s * scale / t - 1.0).abs() < 1e-5);
        }
    }
}

/// From the inside of a closed box nothing escapes and distances are right, whatever the units of the scene and of the
/// rays' directions, for one ray and for sixteen, in trees of any size.
#[test]
fn every_scale() {
    for n in [1, 8] {
        for power in -20..=20 {
            let s = 10.0_f32.powi(power);
            let mesh = room(n, [-s; 3], [s; 3]);
            let accel = accel(&mesh, Preset::Fast);
            let mut random = Random::new(7);
            for size in [1.0, 1e5, 1e-5_f32] {
                let rays: Vec<_> = (0..16)
                    .map(|_| {
                        let o = random.point([-0.7 * s; 3], [0.7 * s; 3]);
                        ray(o, random.direction().map(|x| x * size))
                    })
                    .collect();
                let wide = wide(&rays);
                let all = <F32x16 as Real>::Mask::splat(true);
                let packets = [true, false].map(|coherent| accel.closest(&wide, all, coherent));
                assert!(accel.occluded(&wide, all).all(), "{n} {s} {size}");
                for (i, ray) in rays.iter().enumerate() {
                    let wall = |k: usize| {
                        (f64::from(s).copysign(f64::from(ray.d[k])) - f64::from(ray.o[k])) / f64::from(ray.d[k])
                    };
                    let expected = wall(0).min(wall(1)).min(wall(2));
                    let one = closest(&accel, ray).map_or(f32::NAN, |hit| hit.1);
                    for t in [one, packets[0].t.lane(i), packets[1].t.lane(i)] {
                        assert!((f64::from(t) / expected - 1.0).abs() < 1e-5, "{n} {s} {size}: {t} for {expected}");
                    }
                    assert!(accel.occluded(ray, true), "{n} {s} {size}");
                }
            }
        }
    }
}

#[test]
fn vast_scenes() {
    let mesh = moved(blob(4, 0.0), [1e30; 3], [0.0; 3]);
    let accel = accel(&mesh, Preset::Default);
    let mut random = Random::new(6);
    for _ in 0..500 {
        let (_, t) = closest(&accel, &ray([0.0; 3], random.direction())).unwrap();
        assert!((9e29..1.1e30).contains(&t));
    }
}

#[test]
fn instances_are_moved_copies() {
    let turn = [[0.0, -2.0, 0.0, 3.0], [1.5, 0.0, 0.25, -1.0], [0.0, 0.0, -1.0, 0.5]];
    let through = |m: &[[f32; 4]; 3], p: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|i| m[i][0] * p[0] + m[i][1] * p[1] + m[i][2] * p[2] + m[i][3])
    };
    let (a, b) = (blob(6, 0.3), room(2, [-0.5; 3], [0.5; 3]));
    let (na, nb) = (a.triangles.len() as u32, b.triangles.len() as u32);
    let placed =
        build(vec![a.clone(), b.clone()], vec![instance(1, turn), instance(0, IDENTITY), instance(0, turn)]).unwrap();
    let move_all = |mut g: Geometry| {
        g.positions.iter_mut().for_each(|p| *p = through(&turn, *p));
        g
    };
    let flat = accel(&together([move_all(b), a.clone(), move_all(a)]), Preset::Default);
    let mut random = Random::new(8);
    let mut hits = 0;
    for _ in 0..4000 {
        let ray = ray(random.point([-3.0; 3], [5.0; 3]), random.direction());
        let one = placed.closest(&ray, true, false);
        let other = flat.closest(&ray, true, false);
        let expected = match other.primitive.lane(0) {
            MISS => (MISS, MISS),
            i if i < nb => (0, na + i),
            i if i < nb + na => (1, i - nb),
            i => (2, i - nb - na),
        };
        if (one.instance.lane(0), one.primitive.lane(0)) == expected {
            hits += 1;
            assert!(one.t == other.t || (one.t - other.t).abs() <= 1e-4 * one.t.max(1.0));
        }
        assert_eq!(placed.occluded(&ray, true), one.primitive.lane(0) != MISS);
    }
    assert!(hits > 3990, "{hits}");
}

/// Sixteen rays at a time find what each finds by itself, to the bit, among instances of all sizes that move, that lie in
/// the same place, and that rays have to enter by themselves.
#[test]
fn instances_in_turns() {
    let mut random = Random::new(12);
    let mut parts = vec![blob(6, 0.3), room(2, [-0.5; 3], [0.5; 3])];
    parts[1].spheres.push(Sphere { center: [0.1, 0.0, 0.0], radius: 0.2 });
    let scaled = |x: f32, p: [f32; 3]| [[x, 0.0, 0.0, p[0]], [0.0, x, 0.0, p[1]], [0.0, 0.0, x, p[2]]];
    let mut instances = vec![instance(0, IDENTITY), instance(0, scaled(1.0, [0.0; 3]))];
    for i in 0..if cfg!(miri) { 6 } else { 60 } {
        let size = [1.0, 0.3, 1e-7, 2.0][i % 4];
        let keyframes = [0.0, 0.5, 2.0].map(|time| (time, scaled(size, random.point([-3.0; 3], [3.0; 3]))));
        let keyframes = keyframes[..if i % 3 == 0 { 3 } else { 1 }].to_vec();
        instances.push(Instance { geometry: i as u32 % 2, keyframes });
    }
    let towards: Vec<[f32; 3]> = instances.iter().map(|i| i.keyframes[0].1.map(|row| row[3])).collect();
    let accel = build(parts, instances).unwrap();
    let odd = |primitive: u32, instance: u32, _: f32, _: f32| !(primitive + instance).is_multiple_of(3);
    let mut found = [0; 3];
    for round in 0..if cfg!(miri) { 4 } else { 2000 } {
        let rays: [Ray<f32>; 16] = std::array::from_fn(|i| {
            let o = random.point([-5.0; 3], [5.0; 3]);
            let to = towards[random.below(towards.len())];
            let d = if i % 4 == 0 { random.direction() } else { std::array::from_fn(|k| to[k] - o[k]) };
            let tmax = if i % 5 == 0 { 2.0 * random.unit() } else { f32::INFINITY };
            Ray { o, d, tmax, time: if round % 3 == 0 { 0.0 } else { random.between(-0.5, 2.5) } }
        });
        let mask = Mask16::from_bits([0xffff, 0x7f13][round % 2]);
        let hits = accel.closest(&wide(&rays), mask, round % 5 == 0);
        let some = accel.closest_where(&wide(&rays), mask, false, &odd);
        let [dark, less] = [accel.occluded(&wide(&rays), mask), accel.occluded_where(&wide(&rays), mask, &odd)];
        for (i, ray) in rays.iter().enumerate().filter(|(i, _)| mask.bits() >> i & 1 == 1) {
            for (one, all) in
                [(accel.closest(ray, true, false), &hits), (accel.closest_where(ray, true, false, &odd), &some)]
            {
                assert_eq!((one.t, one.u, one.v), (all.t.lane(i), all.u.lane(i), all.v.lane(i)), "{ray:?}");
                let names = [one.instance, one.primitive].map(|x| x.lane(0));
                assert_eq!(names, [all.instance, all.primitive].map(|x| x.lane(i)), "{ray:?}");
                found[0] += usize::from(names[0] != MISS);
                found[1] += usize::from(names[0] != MISS && names[0] % 4 == 0);
            }
            assert_eq!(
                (dark.bits() >> i & 1 == 1, less.bits() >> i & 1 == 1),
                (accel.occluded(ray, true), accel.occluded_where(ray, true, &odd))
            );
            found[2] += usize::from(dark.bits() >> i & 1 == 1);
        }
    }
    // Those of size 1e-7 have the numbers 4, 8, and so on.
    assert!(cfg!(miri) || found[0] > 20_000 && found[1] > 1000 && found[2] > 10_000, "{found:?}");
}

#[test]
fn moving_instances() {
    let keyframes = vec![(0.0, IDENTITY), (1.0, [[1.0, 0.0, 0.0, 10.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])];
    let accel = build(vec![room(1, [-1.0; 3], [1.0; 3])], vec![Instance { geometry: 0, keyframes }]).unwrap();
    let at = |time: f32| Ray { o: [-20.0, 0.3, 0.1], d: [1.0, 0.0, 0.0], tmax: f32::INFINITY, time };
    for (time, t) in [(-1.0, 19.0), (0.0, 19.0), (0.5, 24.0), (1.0, 29.0), (2.0, 29.0)] {
        assert!((closest(&accel, &at(time)).unwrap().1 - t).abs() < 1e-4);
    }
    let (lo, hi) = accel.bounds();
    assert!(lo[0] <= -1.0 && hi[0] >= 11.0 && hi[0] < 11.01);
}

#[test]
fn filters_see_through() {
    let mesh = together((0..100).map(|i| moved(room(1, [-1.0; 3], [1.0; 3]), [1.0, 1.0, 0.0], [0.0, 0.0, i as f32])));
    let accel = accel(&mesh, Preset::Default);
    let ray = ray([0.3, 0.2, -1.0], [0.0, 0.0, 1.0]);
    let keep = |primitive: u32, _: u32, _: f32, _: f32| primitive / 12 == 70;
    let hit = accel.closest_where(&ray, true, false, &keep);
    assert_eq!((hit.primitive.lane(0) / 12, hit.t), (70, 71.0));
    assert!(accel.occluded_where(&ray, true, &keep));
    assert!(!accel.occluded_where(&Ray { tmax: 70.5, ..ray }, true, &keep));
}

#[test]
fn same_tree_for_any_number_of_threads() {
    let mesh = together([blob(60, 0.3), soup(3000, 0.2, &mut Random::new(9))]);
    let describe = |threads: usize, preset: Preset| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        format!("{:?}", pool.install(|| accel(&mesh, preset)))
    };
    for preset in [Preset::Fast, Preset::Default, Preset::Quality] {
        assert!(describe(1, preset) == describe(3, preset));
    }
}

/// Balls that fly far in no time: at its own time each ray meets what is there then, as a look at every ball says. Between
/// keyframes, on them, and before and after all of them.
#[test]
fn fast_instances_are_where_they_are() {
    let mut word = 7_u32;
    let mut random = || {
        word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (word >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let few = if cfg!(miri) { 4 } else { 100 };
    let at = |p: [f32; 3]| [[1.0, 0.0, 0.0, p[0]], [0.0, 1.0, 0.0, p[1]], [0.0, 0.0, 1.0, p[2]]];
    let paths: Vec<[[f32; 3]; 3]> = (0..few).map(|_| [0; 3].map(|_| [0; 3].map(|_| 20.0 * random()))).collect();
    let times = [1.0, 1.5, 3.0];
    let instances = paths.iter().map(|path| Instance {
        geometry: 0,
        keyframes: times.into_iter().zip(path).map(|(t, p)| (t, at(*p))).collect(),
    });
    let ball = Geometry { spheres: vec![Sphere { center: [0.0; 3], radius: 1.0 }], ..Geometry::default() };
    let accel = build(vec![ball], instances.collect()).unwrap();
    let (mut hits, rays) = (0, if cfg!(miri) { 32 } else { 4_992 });
    let mut in_turns = Vec::new();
    for i in 0..rays {
        let time = if i % 10 == 0 { [0.0, 1.0, 1.5, 3.0, 4.0][i / 10 % 5] } else { 2.0 + 1.1 * random() };
        let (o, d) = ([0; 3].map(|_| 20.0 * random()), [0; 3].map(|_| random()));
        let share = |a: f32, b: f32| ((time - a) / (b - a)).clamp(0.0, 1.0);
        let (s, first) = if time < 1.5 { (share(1.0, 1.5), 0) } else { (share(1.5, 3.0), 1) };
        // The nearest root of |o + t d − c| = r.
        let nearest = |r: f64| {
            let of_path = |path: &[[f32; 3]; 3]| {
                let to_center: [f64; 3] = std::array::from_fn(|k| {
                    let c = f64::from(path[first][k]) + f64::from(s) * f64::from(path[first + 1][k] - path[first][k]);
                    c - f64::from(o[k])
                });
                let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                let d = d.map(f64::from);
                let (a, b) = (dot(d, d), dot(to_center, d));
                let root = (b * b - a * (dot(to_center, to_center) - r * r)).sqrt();
                [(b - root) / a, (b + root) / a].into_iter().find(|t| *t > 0.0).unwrap_or(f64::INFINITY)
            };
            paths.iter().map(of_path).fold(f64::INFINITY, f64::min)
        };
        // Of balls a little larger and a little smaller: rays that graze one may go either way.
        let (a, b) = (nearest(1.0 + 1e-4), nearest(1.0 - 1e-4));
        let ray = Ray { o, d, tmax: f32::INFINITY, time };
        let hit = accel.closest(&ray, true, false);
        in_turns.push((ray, hit));
        let t = f64::from(hit.t);
        assert!(a.min(b) * (1.0 - 1e-5) <= t && t <= a.max(b) * (1.0 + 1e-5), "ray {i}: {t} is not from {a} to {b}");
        hits += u32::from(hit.t.is_finite());
    }
    assert!(hits > rays as u32 / 20, "{hits} hits");
    for sixteen in in_turns.chunks_exact(16) {
        let rays: Vec<Ray<f32>> = sixteen.iter().map(|(ray, _)| *ray).collect();
        let hit = accel.closest(&wide(&rays), Mask16::splat(true), false);
        for (i, (_, one)) in sixteen.iter().enumerate() {
            assert_eq!((hit.t.lane(i), hit.instance.lane(i)), (one.t, one.instance.lane(0)));
        }
    }
}
