//! Meshes, rays and a reference for the tests.
#![allow(dead_code, missing_docs)]

use rebond_bvh::{Accel, Affine, BuildOptions, Geometry, Instance, MISS, Preset, Ray};
use rebond_lanes::{F32x16, Index, Real};

pub const IDENTITY: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A 64-bit congruential generator with permuted output (PCG).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(2).wrapping_add(0x9e37_79b9_7f4a_7c15))
    }
    pub fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let x = ((self.0 >> 18 ^ self.0) >> 27) as u32;
        x.rotate_right((self.0 >> 59) as u32)
    }
    pub fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.word()) * n as u64) >> 32) as usize
    }
    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.word() >> 8) as f32 / (1 << 24) as f32
    }
    pub fn between(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit()
    }
    pub fn point(&mut self, lo: [f32; 3], hi: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| self.between(lo[k], hi[k]))
    }
    /// Uniform on the sphere.
    pub fn direction(&mut self) -> [f32; 3] {
        let z = self.between(-1.0, 1.0);
        let phi = self.between(0.0, std::f32::consts::TAU);
        let r = (1.0 - z * z).max(0.0).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    }
}

pub fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// An icosahedron, each face cut into n², pushed onto a bumpy sphere: closed, shared vertices.
pub fn blob(n: usize, bumps: f32) -> Geometry {
    let g = (1.0 + 5.0_f32.sqrt()) / 2.0;
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut places = std::collections::HashMap::new();
    let mut geometry = Geometry::default();
    for face in faces {
        let mut vertex = |weights: [usize; 3]| {
            let mut name: Vec<(usize, usize)> =
                (0..3).filter(|&i| weights[i] > 0).map(|i| (face[i], weights[i])).collect();
            name.sort_unstable();
            *places.entry(name.clone()).or_insert_with(|| {
                let mut p = [0.0_f32; 3];
                for (corner, weight) in name {
                    for k in 0..3 {
                        p[k] += corners[corner][k] * weight as f32 / n as f32;
                    }
                }
                let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
                let q = p.map(|x| x / length);
                let r = 1.0 + bumps * ((9.0 * q[0]).sin() * (8.0 * q[1]).sin() * (7.0 * q[2]).cos());
                geometry.positions.push(q.map(|x| x * r));
                geometry.positions.len() as u32 - 1
            })
        };
        let mut triangles = Vec::new();
        for i in 0..n {
            for j in 0..n - i {
                let at = |i: usize, j: usize| [n - i - j, i, j];
                triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < n {
                    triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
        let triangles: Vec<_> = triangles.into_iter().map(|t| t.map(&mut vertex)).collect();
        geometry.triangles.extend(triangles);
    }
    geometry
}

/// The surface of a box, each side cut into n × n squares: axis-aligned, closed.
pub fn room(n: u32, lo: [f32; 3], hi: [f32; 3]) -> Geometry {
    let mut places = std::collections::HashMap::new();
    let mut geometry = Geometry::default();
    for axis in 0..3 {
        for side in [0, n] {
            for i in 0..n {
                for j in 0..n {
                    let mut vertex = |a: u32, b: u32| {
                        let mut at = [0; 3];
                        (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, a, b);
                        *places.entry(at).or_insert_with(|| {
                            let w = at.map(|x| x as f32 / n as f32);
                            geometry.positions.push(std::array::from_fn(|k| lo[k] * (1.0 - w[k]) + hi[k] * w[k]));
                            geometry.positions.len() as u32 - 1
                        })
                    };
                    let quad = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                    geometry.triangles.push([quad[0], quad[1], quad[2]]);
                    geometry.triangles.push([quad[0], quad[2], quad[3]]);
                }
            }
        }
    }
    geometry
}

/// Triangles without order, each of about the given size.
pub fn soup(n: usize, size: f32, random: &mut Random) -> Geometry {
    let mut geometry = Geometry::default();
    for _ in 0..n {
        let center = random.point([-1.0; 3], [1.0; 3]);
        let first = geometry.positions.len() as u32;
        for _ in 0..3 {
            let offset = random.point([-size; 3], [size; 3]);
            geometry.positions.push(std::array::from_fn(|k| center[k] + offset[k]));
        }
        geometry.triangles.push([first, first + 1, first + 2]);
    }
    geometry
}

/// Long thin blades.
pub fn slivers(n: usize, random: &mut Random) -> Geometry {
    let mut geometry = Geometry::default();
    for _ in 0..n {
        let root = [random.between(-1.0, 1.0), 0.0, random.between(-1.0, 1.0)];
        let lean = random.point([-0.3, 0.4, -0.3], [0.3, 1.0, 0.3]);
        let width = 10.0_f32.powf(random.between(-5.0, -2.0));
        let side = random.point([-width; 3], [width; 3]);
        let first = geometry.positions.len() as u32;
        geometry.positions.push(root);
        geometry.positions.push(std::array::from_fn(|k| root[k] + side[k]));
        geometry.positions.push(std::array::from_fn(|k| root[k] + lean[k]));
        geometry.triangles.push([first, first + 1, first + 2]);
    }
    geometry
}

pub fn moved(mut geometry: Geometry, scale: [f32; 3], offset: [f32; 3]) -> Geometry {
    for p in &mut geometry.positions {
        *p = std::array::from_fn(|k| p[k] * scale[k] + offset[k]);
    }
    geometry
}

/// One after the other.
pub fn together(parts: impl IntoIterator<Item = Geometry>) -> Geometry {
    let mut all = Geometry::default();
    for part in parts {
        let first = all.positions.len() as u32;
        all.positions.extend(part.positions);
        all.triangles.extend(part.triangles.into_iter().map(|t| t.map(|i| i + first)));
        all.spheres.extend(part.spheres);
        all.disks.extend(part.disks);
    }
    all
}

pub fn instance(geometry: u32, matrix: Affine) -> Instance {
    Instance { geometry, keyframes: vec![(0.0, matrix)] }
}

pub fn accel(geometry: &Geometry, preset: Preset) -> Accel {
    Accel::build(vec![geometry.clone()], vec![instance(0, IDENTITY)], &BuildOptions::with_preset(preset)).unwrap().0
}

pub fn ray(o: [f32; 3], d: [f32; 3]) -> Ray<f32> {
    Ray { o, d, tmax: f32::INFINITY, time: 0.0 }
}

/// Primitive and distance of the nearest hit of one ray.
pub fn closest(accel: &Accel, ray: &Ray<f32>) -> Option<(u32, f32)> {
    let hit = accel.closest(ray, true, false);
    let primitive = hit.primitive.lane(0);
    (primitive != MISS).then_some((primitive, hit.t))
}

/// What exact arithmetic would say about a ray and a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    pub t: f64,
    /// By how much, in units of length, the line passes inside the triangle; negative: outside. Measured across the ray.
    pub margin: f64,
    /// |cosine| between ray and normal.
    pub cosine: f64,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Ray against triangle in f64; none for parallel ones.
pub fn reference(corners: [[f32; 3]; 3], o: [f32; 3], d: [f32; 3]) -> Option<Reference> {
    let wide = |p: [f32; 3]| p.map(f64::from);
    let (o, d) = (wide(o), wide(d));
    let p = corners.map(|p| {
        let p = wide(p);
        [p[0] - o[0], p[1] - o[1], p[2] - o[2]]
    });
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let normal = cross(minus(p[1], p[0]), minus(p[2], p[0]));
    let along = dot(normal, d);
    if along == 0.0 {
        return None;
    }
    let t = dot(normal, p[0]) / along;
    let length = dot(d, d).sqrt();
    let mut margin = f64::INFINITY;
    for i in 0..3 {
        let (a, b) = (p[i], p[(i + 1) % 3]);
        // Distance of the ray's line from the edge's line, signed; across the ray.
        let edge = minus(b, a);
        let across = cross(edge, d);
        let size = dot(across, across).sqrt();
        let signed = dot(a, across) / size * along.signum();
        if size > 0.0 {
            margin = margin.min(signed);
        }
    }
    Some(Reference { t, margin, cosine: along.abs() / (dot(normal, normal).sqrt() * length) })
}

/// Sixteen rays as one.
pub fn wide(rays: &[Ray<f32>]) -> Ray<F32x16> {
    let lanes = |f: &dyn Fn(&Ray<f32>) -> f32| F32x16::load(&std::array::from_fn::<f32, 16, _>(|i| f(&rays[i])));
    Ray {
        o: std::array::from_fn(|k| lanes(&|r| r.o[k])),
        d: std::array::from_fn(|k| lanes(&|r| r.d[k])),
        tmax: lanes(&|r| r.tmax),
        time: lanes(&|r| r.time),
    }
}
