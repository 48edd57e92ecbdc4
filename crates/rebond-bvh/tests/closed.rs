//! Nothing gets through a closed mesh.

mod common;
use common::*;
use rebond_bvh::{Accel, Geometry, MISS, Preset, Ray};
use rebond_lanes::{F32x16, Index, Mask, Real};

/// Rays that left a closed mesh, of `n` sent from inside at corners, edges and points of its triangles.
fn escapes(geometry: &Geometry, accel: &Accel, inside: impl Fn(&mut Random) -> [f32; 3], n: usize, seed: u64) -> usize {
    let mut random = Random::new(seed);
    let mut escaped = 0;
    let mut rays = Vec::new();
    for i in 0..n {
        let o = inside(&mut random);
        let triangle = geometry.triangles[random.below(geometry.triangles.len())];
        let [a, b, c] = triangle.map(|i| geometry.positions[i as usize]);
        let (s, t) = (random.unit(), random.unit());
        let target: [f32; 3] = match i % 4 {
            0 => a,
            1 => std::array::from_fn(|k| a[k] + (b[k] - a[k]) * s),
            2 => std::array::from_fn(|k| (a[k] + b[k]) * 0.5),
            _ => std::array::from_fn(|k| a[k] + (b[k] - a[k]) * s * (1.0 - t) + (c[k] - a[k]) * t),
        };
        let mut d = sub(target, o);
        if i % 3 == 0 {
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            d = d.map(|x| x / length);
        }
        let ray = ray(o, d);
        escaped += usize::from(closest(accel, &ray).is_none());
        escaped += usize::from(!accel.occluded(&ray, true));
        rays.push(ray);
        if rays.len() == 16 {
            escaped += escapes_of_16(accel, &rays);
            rays.clear();
        }
    }
    escaped
}

fn escapes_of_16(accel: &Accel, rays: &[Ray<f32>]) -> usize {
    let ray = wide(rays);
    let all = <F32x16 as Real>::Mask::splat(true);
    let mut escaped = 16 - accel.occluded(&ray, all).count() as usize;
    for coherent in [false, true] {
        let hit = accel.closest(&ray, all, coherent);
        escaped += (0..16).filter(|&i| hit.primitive.lane(i) == MISS).count();
        for (i, ray) in rays.iter().enumerate() {
            let one = accel.closest(ray, true, coherent);
            assert_eq!(one.primitive.lane(0), hit.primitive.lane(i), "{ray:?}");
            assert_eq!((one.t, one.u, one.v), (hit.t.lane(i), hit.u.lane(i), hit.v.lane(i)), "{ray:?}");
        }
    }
    escaped
}

fn closed(n: usize) {
    let center = |random: &mut Random| random.point([-0.2; 3], [0.2; 3]);
    let origin = |_: &mut Random| [0.0; 3];
    for preset in [Preset::Fast, Preset::Default, Preset::Quality] {
        for (seed, mesh) in
            [blob(1, 0.0), blob(2, 0.0), blob(24, 0.4), room(1, [-1.0; 3], [1.0; 3]), room(9, [-1.0; 3], [1.0; 3])]
                .into_iter()
                .enumerate()
        {
            let accel = accel(&mesh, preset);
            assert_eq!(escapes(&mesh, &accel, center, n, seed as u64), 0, "mesh {seed}");
            assert_eq!(escapes(&mesh, &accel, origin, n, seed as u64), 0, "mesh {seed} from its centre");
            for far in [[1e4, 0.0, -1e4], [0.0, 1e4, 3.0]] {
                let mesh = moved(mesh.clone(), [1.0; 3], far);
                let accel = common::accel(&mesh, preset);
                let center = |random: &mut Random| {
                    let p = random.point([-0.2; 3], [0.2; 3]);
                    std::array::from_fn(|k| p[k] + far[k])
                };
                assert_eq!(escapes(&mesh, &accel, center, n, seed as u64), 0, "mesh {seed} at {far:?}");
            }
            let flat = [1.0, 1e-3, 40.0];
            let mesh = moved(mesh, flat, [0.0; 3]);
            let accel = common::accel(&mesh, preset);
            let center = |random: &mut Random| {
                let p = random.point([-0.2; 3], [0.2; 3]);
                std::array::from_fn(|k| p[k] * flat[k])
            };
            assert_eq!(escapes(&mesh, &accel, center, n, seed as u64), 0, "mesh {seed}, flat");
        }
    }
}

#[test]
fn nothing_escapes() {
    closed(2000);
}

/// Ten million rays and more.
#[test]
#[ignore = "minutes"]
fn nothing_escapes_of_many() {
    closed(200_000);
}

/// Along axes and diagonals through a grid's corners every product is exact and every edge function can be zero.
#[test]
fn axis_aligned_through_corners() {
    let mesh = room(8, [0.0; 3], [8.0; 3]);
    let accel = accel(&mesh, Preset::Default);
    for x in 0..=8 {
        for y in 0..=8 {
            for z in 0..=8 {
                let o = [x as f32, y as f32, z as f32];
                for dx in -1..=1 {
                    for dy in -1..=1 {
                        for dz in -1..=1 {
                            let d = [dx as f32, dy as f32, dz as f32];
                            let stays = o.iter().all(|x| 0.0 < *x && *x < 8.0);
                            if d != [0.0; 3] && stays {
                                for d in [d, d.map(|x| if x == 0.0 { -0.0 } else { x }), d.map(|x| x * 1e-30)] {
                                    assert!(closest(&accel, &ray(o, d)).is_some(), "{o:?} {d:?}");
                                    assert!(accel.occluded(&ray(o, d), true), "{o:?} {d:?}");
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// From far away at a sphere's triangles: what enters must leave.
#[test]
fn far_field() {
    far(20_000);
}

#[test]
#[ignore = "minutes"]
fn far_field_of_many() {
    far(5_000_000);
}

fn far(n: usize) {
    let mesh = blob(24, 0.0);
    let accel = accel(&mesh, Preset::Default);
    let mut random = Random::new(5);
    for _ in 0..n {
        let away = random.direction();
        let target = random.direction().map(|x| x * random.between(0.0, 0.98));
        let distance = 10.0_f32.powf(random.between(0.5, 3.0));
        let o = away.map(|x| x * distance);
        let ray = ray(o, sub(target, o));
        let (first, t) = closest(&accel, &ray).expect("the sphere is hit");
        assert!(t < 1.0);
        // Entered through one triangle, it meets another at the far side.
        let beyond = Ray { o: std::array::from_fn(|k| o[k] + ray.d[k]), d: ray.d, tmax: f32::INFINITY, time: 0.0 };
        let (second, _) = closest(&accel, &beyond).expect("the far side is hit");
        assert_ne!(first, second);
    }
}
