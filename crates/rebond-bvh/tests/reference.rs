//! The same hits as exact arithmetic over all triangles.

mod common;
use common::*;
use rayon::prelude::*;
use rebond_bvh::{Accel, Disk, Geometry, MISS, Preset, Ray, Sphere};
use rebond_lanes::{F32x16, Index, Mask, Real};

/// Rounding of the ray's frame: a line may pass a triangle this far off, relative to its distance and coordinates.
const ACROSS: f64 = 6.0e-7;

/// Spheres around triangles, to leave out those that a ray is far from.
struct Around {
    center: [Vec<f64>; 3],
    radius: Vec<f64>,
}

impl Around {
    fn new(corners: &[[[f32; 3]; 3]]) -> Self {
        let centers: Vec<[f64; 3]> = corners
            .iter()
            .map(|c| std::array::from_fn(|k| c.iter().map(|p| f64::from(p[k])).sum::<f64>() / 3.0))
            .collect();
        let distance =
            |p: &[f32; 3], c: &[f64; 3]| (0..3).map(|k| (f64::from(p[k]) - c[k]).powi(2)).sum::<f64>().sqrt();
        let radius = corners.iter().zip(&centers).map(|(t, c)| t.iter().map(|p| distance(p, c)).fold(0.0, f64::max));
        Self { radius: radius.collect(), center: [0, 1, 2].map(|k| centers.iter().map(|c| c[k]).collect()) }
    }

    /// The triangles that the ray's line may come near, with room for every rounding.
    fn near(&self, ray: &Ray<f32>) -> Vec<usize> {
        let (o, d) = (ray.o.map(f64::from), ray.d.map(f64::from));
        let inverse = 1.0 / d.iter().map(|x| x * x).sum::<f64>();
        let [x, y, z] = &self.center;
        let mut outside = vec![0.0; self.radius.len()];
        for (i, outside) in outside.iter_mut().enumerate() {
            let c = [x[i] - o[0], y[i] - o[1], z[i] - o[2]];
            let squared = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
            let along = c[0] * d[0] + c[1] * d[1] + c[2] * d[2];
            let reach = self.radius[i] * self.radius[i] * 1.001 + 1e-9 * squared;
            *outside = squared - along * along * inverse - reach;
        }
        (0..outside.len()).filter(|&i| outside[i] <= 0.0).collect()
    }
}

fn check(name: &str, geometry: &Geometry, accels: &[Accel], rays: &[Ray<f32>]) {
    let corners: Vec<_> = geometry.triangles.iter().map(|t| t.map(|i| geometry.positions[i as usize])).collect();
    let around = Around::new(&corners);
    rays.par_chunks_exact(16).for_each(|group| {
        let truths: Vec<_> = group.iter().map(|ray| truth(&corners, &around, ray)).collect();
        for accel in accels {
            compare(name, accel, group, &truths);
        }
    });
}

/// Where a ray surely stops; and what it may hit, at which t, give or take.
type Truth = (f64, Vec<(u32, f64, f64)>);

fn truth(corners: &[[[f32; 3]; 3]], around: &Around, ray: &Ray<f32>) -> Truth {
    let size = f64::from(ray.d.iter().map(|x| x * x).sum::<f32>().sqrt());
    let (mut sure, mut all) = (f64::INFINITY, Vec::new());
    for primitive in around.near(ray) {
        let corners = corners[primitive];
        let Some(hit) = reference(corners, ray.o, ray.d) else { continue };
        // How far the corners are from the origin bounds the error of their sheared places.
        let reach = corners.iter().flat_map(|p| (0..3).map(|k| f64::from((p[k] - ray.o[k]).abs()))).fold(0.0, f64::max);
        let error = ACROSS * reach;
        if hit.margin < -error {
            continue;
        }
        let slack = 1e-5 * hit.t.abs() + 4.0 * error / (hit.cosine * size);
        if hit.t + slack > 0.0 && hit.t - slack <= f64::from(ray.tmax) {
            if hit.margin > error && hit.t - slack > 0.0 && hit.t + slack < f64::from(ray.tmax) {
                sure = sure.min(hit.t + slack);
            }
            all.push((primitive as u32, hit.t, slack));
        }
    }
    (sure, all)
}

fn compare(name: &str, accel: &Accel, group: &[Ray<f32>], truths: &[Truth]) {
    let wide = wide(group);
    let all = <F32x16 as Real>::Mask::splat(true);
    let packets = [false, true].map(|coherent| accel.closest(&wide, all, coherent));
    let shadows = accel.occluded(&wide, all);
    for (i, (ray, (sure, all))) in group.iter().zip(truths).enumerate() {
        let sure = *sure;
        let judge = |path: &str, primitive: u32, t: f32| {
            if primitive == MISS {
                assert!(sure == f64::INFINITY, "{name}, {path}: {ray:?} misses what is at {sure}");
                return;
            }
            let (_, exact, slack) = *all
                .iter()
                .find(|hit| hit.0 == primitive)
                .unwrap_or_else(|| panic!("{name}, {path}: {ray:?} does not hit {primitive}"));
            assert!((f64::from(t) - exact).abs() <= slack, "{name}, {path}: {ray:?} {t} for {exact}");
            assert!(exact - slack <= sure, "{name}, {path}: {ray:?} hits {exact} behind {sure}");
        };
        let one = accel.closest(ray, true, false);
        judge("single", one.primitive.lane(0), one.t);
        for packet in &packets {
            judge("packet", packet.primitive.lane(i), packet.t.lane(i));
        }
        for (path, dark) in [("single", accel.occluded(ray, true)), ("packet", shadows.bits() >> i & 1 == 1)] {
            assert!(dark || sure == f64::INFINITY, "{name}, {path}: {ray:?} passes what is at {sure}");
            assert!(!dark || !all.is_empty(), "{name}, {path}: {ray:?} is stopped by nothing");
        }
    }
}

fn meshes() -> Vec<(&'static str, Geometry)> {
    let mut random = Random::new(1);
    let plain = soup(300, 0.3, &mut random);
    let twice = together([plain.clone(), plain.clone()]);
    let shapes = [
        ("one", soup(1, 1.0, &mut random)),
        ("few", soup(20, 0.5, &mut random)),
        ("sixty", soup(60, 0.5, &mut random)),
        ("soup", plain),
        ("dust", soup(1000, 0.01, &mut random)),
        ("duplicates", twice),
        ("slivers", slivers(400, &mut random)),
        ("blob in a room", together([blob(6, 0.3), room(2, [-2.0; 3], [2.0; 3])])),
        (
            "flat boxes",
            together((0..20).map(|i| room(2, [-1.0, i as f32 * 0.1 - 1.0, -1.0], [1.0, i as f32 * 0.1 - 1.0, 1.0]))),
        ),
    ];
    let far: Vec<_> = shapes.iter().take(7).map(|(_, mesh)| moved(mesh.clone(), [3.0; 3], [1e4, -1e4, 5e3])).collect();
    let dragon = dragon();
    let tiny = moved(shapes[3].1.clone(), [1e-6; 3], [0.0; 3]);
    let vast = moved(shapes[3].1.clone(), [1e12; 3], [0.0; 3]);
    shapes
        .into_iter()
        .chain(far.into_iter().map(|mesh| ("far away", mesh)))
        .chain([("tiny", tiny), ("vast", vast), ("dragon", dragon)])
        .collect()
}

/// The scanned dragon of the built-in scene.
fn dragon() -> Geometry {
    let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/dragon.ply")).unwrap();
    let end = b"end_header\n";
    let start = file.windows(end.len()).position(|window| window == end).unwrap() + end.len();
    let header = std::str::from_utf8(&file[..start]).unwrap();
    let count = |what: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {what} ")));
        line.unwrap().parse().unwrap()
    };
    let (vertices, faces) = file[start..].split_at(24 * count("vertex"));
    let word = |bytes: &[u8], i: usize| <[u8; 4]>::try_from(&bytes[4 * i..4 * i + 4]).unwrap();
    let position = |vertex: &[u8]| std::array::from_fn(|k| f32::from_le_bytes(word(vertex, k)));
    let triangle = |face: &[u8]| std::array::from_fn(|k| u32::from_le_bytes(word(&face[1..], k)));
    assert_eq!(faces.len(), 13 * count("face"));
    Geometry {
        positions: vertices.chunks_exact(24).map(position).collect(),
        triangles: faces.chunks_exact(13).map(triangle).collect(),
        ..Default::default()
    }
}

fn rays(geometry: &Geometry, n: usize, random: &mut Random) -> Vec<Ray<f32>> {
    let lo: [f32; 3] = std::array::from_fn(|k| geometry.positions.iter().map(|p| p[k]).fold(f32::INFINITY, f32::min));
    let hi: [f32; 3] =
        std::array::from_fn(|k| geometry.positions.iter().map(|p| p[k]).fold(f32::NEG_INFINITY, f32::max));
    let center: [f32; 3] = std::array::from_fn(|k| (lo[k] + hi[k]) / 2.0);
    let size = (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f32::max);
    let (lo, hi) = (center.map(|c| c - 0.8 * size), center.map(|c| c + 0.8 * size));
    (0..n)
        .map(|i| {
            let o = random.point(lo, hi);
            let mut d = match i % 4 {
                0 => sub(geometry.positions[random.below(geometry.positions.len())], o),
                1 => sub(random.point(lo, hi), o),
                _ => random.direction(),
            };
            if i % 5 == 0 {
                d[random.below(3)] = 0.0;
            }
            if i % 10 == 0 {
                d[random.below(3)] = -0.0;
            }
            let tmax = if i % 7 == 0 { size * random.unit() } else { f32::INFINITY };
            Ray { o, d: if d == [0.0; 3] { [1.0, 0.0, 0.0] } else { d }, tmax, time: 0.0 }
        })
        .collect()
}

fn agree(n: usize) {
    let mut random = Random::new(2);
    for (name, mesh) in meshes() {
        let rays = rays(&mesh, n, &mut random);
        let accels = [Preset::Fast, Preset::Default, Preset::Quality].map(|preset| accel(&mesh, preset));
        check(name, &mesh, &accels, &rays);
    }
}

#[test]
fn same_hits() {
    agree(480);
}

/// Along a triangle a thousand times as long as wide, rounding moves a hit a thousand times as far.
#[test]
fn thin_triangles() {
    let mut random = Random::new(7);
    let mesh = slivers(200, &mut random);
    let rays: Vec<_> = (0..8000)
        .map(|i| {
            let [a, b, c] = mesh.triangles[i % 200].map(|v| mesh.positions[v as usize]);
            let along = random.unit();
            let target = std::array::from_fn(|k| a[k] + along * (0.5 * (b[k] + c[k]) - a[k]));
            let o = random.point([-1.5; 3], [1.5; 3]);
            ray(o, sub(target, o))
        })
        .collect();
    check("thin", &mesh, &[accel(&mesh, Preset::Default)], &rays);
}

/// A million rays a mesh.
#[test]
#[ignore = "minutes"]
fn same_hits_of_many() {
    agree(1_000_000);
}

#[test]
fn spheres_and_disks() {
    let mut random = Random::new(3);
    let mut geometry = soup(50, 0.2, &mut random);
    for _ in 0..40 {
        geometry.spheres.push(Sphere { center: random.point([-1.0; 3], [1.0; 3]), radius: random.between(0.01, 0.3) });
        geometry.disks.push(Disk {
            center: random.point([-1.0; 3], [1.0; 3]),
            normal: random.direction(),
            radius: random.between(0.01, 0.3),
        });
    }
    let accel = accel(&geometry, Preset::Default);
    let mut kinds = [0; 4];
    for _ in 0..5000 {
        let ray = ray(random.point([-1.5; 3], [1.5; 3]), random.direction());
        let dot = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| f64::from(a[k]) * f64::from(b[k])).sum::<f64>();
        let mut best = (f64::INFINITY, MISS);
        let mut offer = |t: f64, primitive: usize| {
            if t > 0.0 && t < best.0 {
                best = (t, primitive as u32);
            }
        };
        for (i, triangle) in geometry.triangles.iter().enumerate() {
            if let Some(hit) = reference(triangle.map(|i| geometry.positions[i as usize]), ray.o, ray.d)
                && hit.margin >= 0.0
            {
                offer(hit.t, i);
            }
        }
        for (i, sphere) in geometry.spheres.iter().enumerate() {
            let o = sub(ray.o, sphere.center);
            let (a, b, c) = (dot(ray.d, ray.d), dot(o, ray.d), dot(o, o) - f64::from(sphere.radius).powi(2));
            let root = (b * b - a * c).sqrt();
            offer((-b - root) / a, 50 + i);
            offer((-b + root) / a, 50 + i);
        }
        for (i, disk) in geometry.disks.iter().enumerate() {
            let o = sub(ray.o, disk.center);
            let t = -dot(o, disk.normal) / dot(ray.d, disk.normal);
            let p: [f32; 3] = std::array::from_fn(|k| o[k] + ray.d[k] * t as f32);
            if dot(p, p) <= f64::from(disk.radius).powi(2) {
                offer(t, 90 + i);
            }
        }
        let hit = accel.closest(&ray, true, false);
        // A grazed rim may go either way.
        if hit.primitive.lane(0) == best.1 {
            kinds[if best.1 == MISS { 3 } else { (best.1 as usize).saturating_sub(10) / 40 }] += 1;
            if best.1 != MISS {
                assert!((f64::from(hit.t) - best.0).abs() < 1e-5 * best.0.max(0.1), "{} {}", hit.t, best.0);
                assert!(accel.occluded(&ray, true));
            }
        }
    }
    assert!(kinds.iter().sum::<i32>() >= 4995 && kinds.iter().all(|&n| n > 50), "{kinds:?}");
}
