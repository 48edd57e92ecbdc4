//! Shapes, and the one kind of image that only pbrt has.

use super::parse::{Parameters, Spot};
use super::{Importer, Result};
use crate::import::{Assets, SIDES, steps, tube};
use glam::{DMat4, DVec3, Vec3};
use rebond::film::Image;
use rebond::scene::description::{MaterialDescription, MaterialRef, MeshFile, ShapeDescription, Simple, Sphere};
use rebond::shape::MeshData;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

/// Cuts of a bilinear patch along each side.
const CUTS: usize = 16;
/// Triangles that subdivision and patches may come to in a scene.
const MOST_TRIANGLES: usize = 1 << 20;

impl Importer<'_> {
    pub fn shape(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a shape")?;
        let p = self.words.parameters()?;
        let mut material = self.state.material.clone();
        if let Some(opacity) = self.alpha(&p)? {
            material = MaterialRef::Inline(Box::new(MaterialDescription::Mask { opacity, material }));
        }
        let (material, emission, reverse) = (Some(material), self.state.light, self.state.reverse);
        let m = self.state.matrix;
        let ply = |file: String, m: DMat4| {
            ShapeDescription::Ply(MeshFile {
                file,
                face_normals: false,
                smooth_normals: false,
                flip_normals: reverse,
                material: material.clone(),
                emission,
                to_world: steps(m),
            })
        };
        let shape = match &*kind {
            "sphere" => {
                for name in ["zmin", "zmax", "phimax"] {
                    self.whole(&p, name, "a part of a sphere: the whole is")?;
                }
                let radius = self.number(&p, "radius", 1.0)?;
                ShapeDescription::Sphere(Sphere {
                    center: [0.0; 3],
                    radius,
                    flip_normals: reverse,
                    material,
                    emission,
                    to_world: steps(m),
                })
            }
            "disk" => {
                for name in ["innerradius", "phimax"] {
                    self.whole(&p, name, "a part of a disk: the whole is")?;
                }
                let (radius, height) =
                    (f64::from(self.number(&p, "radius", 1.0)?), f64::from(self.number(&p, "height", 0.0)?));
                let own =
                    DMat4::from_translation(DVec3::Z * height) * DMat4::from_scale(DVec3::new(radius, radius, 1.0));
                ShapeDescription::Disk(Simple { flip_normals: reverse, material, emission, to_world: steps(m * own) })
            }
            "cylinder" => {
                self.whole(&p, "phimax", "a part of a cylinder: the whole is")?;
                let radius = f64::from(self.number(&p, "radius", 1.0)?);
                let (lo, hi) = (f64::from(self.number(&p, "zmin", -1.0)?), f64::from(self.number(&p, "zmax", 1.0)?));
                self.warn(at, format!("a cylinder becomes a prism of {SIDES} sides"));
                let file = match self.assets.meshes.contains_key("cylinder.ply") {
                    true => "cylinder.ply".to_string(),
                    false => self.assets.add_mesh("cylinder", tube()),
                };
                let own =
                    DMat4::from_translation(DVec3::Z * lo) * DMat4::from_scale(DVec3::new(radius, radius, hi - lo));
                ply(file, m * own)
            }
            "trianglemesh" | "bilinearmesh" | "loopsubdiv" => {
                let mut mesh = self.mesh(&p, &kind, at)?;
                if kind == "bilinearmesh" {
                    self.warn(at, format!("bilinear patches that are not flat are cut into {CUTS} by {CUTS}"));
                }
                if kind == "loopsubdiv" {
                    let levels = self.count(&p, "levels", 3)?;
                    let times = 4_usize.checked_pow(levels).unwrap_or(usize::MAX);
                    self.cut(mesh.triangles.len().saturating_mul(times), at)?;
                    mesh = subdivided(mesh, levels);
                }
                let file = self.assets.add_mesh("mesh", mesh);
                ply(file, m)
            }
            "plymesh" => {
                let Some((name, at)) = self.word(&p, "filename")? else {
                    return Err(self.error(at, "the filename is missing"));
                };
                for name in ["displacement", "edgelength"] {
                    if let Some(q) = p.get(name) {
                        self.unsupported(q.at, "displacement")?;
                    }
                }
                let mut file = self.find(&name, at)?;
                if file.ends_with(".gz") {
                    let bytes = self.assets.read(&file).and_then(|b| super::unpack(&b));
                    let mesh = bytes.map_err(|m| self.error(at, format!("\"{file}\": {m}")))?;
                    let mesh = crate::read_ply(&mesh, &file).map_err(|e| self.error(at, e.to_string()))?;
                    file = self.assets.add_mesh("mesh", mesh);
                }
                ply(file, m)
            }
            _ => {
                self.unsupported(at, format!("the shape \"{kind}\" is not supported"))?;
                return Ok(());
            }
        };
        self.finish(&p, &format!("the shape \"{kind}\""))?;
        self.push(at, shape);
        Ok(())
    }

    /// Counts triangles that stand in no file.
    fn cut(&mut self, triangles: usize, at: Spot) -> Result<()> {
        self.cut = self.cut.saturating_add(triangles);
        if self.cut > MOST_TRIANGLES {
            return Err(
                self.error(at, format!("subdivision and patches would come to more than {MOST_TRIANGLES} triangles"))
            );
        }
        Ok(())
    }

    /// A parameter that would leave a part of a shape.
    fn whole(&mut self, p: &Parameters, name: &str, message: &str) -> Result<()> {
        match p.get(name) {
            Some(q) => self.unsupported(q.at, message),
            None => Ok(()),
        }
    }

    fn rows<const N: usize>(&self, p: &Parameters, names: &[&str]) -> Result<Option<Vec<[f32; N]>>> {
        let Some(q) = names.iter().find_map(|n| p.get(n)) else { return Ok(None) };
        if !q.numbers.len().is_multiple_of(N) {
            return Err(self.error(q.at, format!("\"{}\" has {} numbers, no multiple of {N}", q.name, q.numbers.len())));
        }
        Ok(Some(q.numbers.chunks_exact(N).map(|c| std::array::from_fn(|i| c[i] as f32)).collect()))
    }

    fn mesh(&mut self, p: &Parameters, kind: &str, at: Spot) -> Result<MeshData> {
        let Some(positions) = self.rows::<3>(p, &["P"])? else {
            return Err(self.error(at, "the points P are missing"));
        };
        let normals = self.rows::<3>(p, &["N"])?;
        let uvs = self.rows::<2>(p, &["uv", "st"])?;
        let _ = p.get("S");
        let corners = if kind == "bilinearmesh" { 4 } else { 3 };
        let order: Vec<u32> = match p.get("indices") {
            Some(q) => {
                let index =
                    |x: &f64| (x.fract() == 0.0 && *x >= 0.0 && *x < positions.len() as f64).then_some(*x as u32);
                let order: Option<Vec<u32>> = q.numbers.iter().map(index).collect();
                order.ok_or_else(|| {
                    self.error(q.at, format!("an index that is none of the {} points", positions.len()))
                })?
            }
            None if positions.len() == corners => (0..corners as u32).collect(),
            None => return Err(self.error(at, "the indices are missing")),
        };
        if order.is_empty() || !order.len().is_multiple_of(corners) {
            return Err(self.error(at, format!("{} indices are no multiple of {corners}", order.len())));
        }
        for (what, length) in
            [("normals", normals.as_ref().map(Vec::len)), ("texture coordinates", uvs.as_ref().map(Vec::len))]
        {
            if length.is_some_and(|n| n != positions.len()) {
                return Err(self.error(at, format!("there are not as many {what} as points")));
            }
        }
        if corners == 4 {
            self.cut(order.len() / 4 * 2 * CUTS * CUTS, at)?;
            return Ok(patches(&positions, normals.as_deref(), uvs.as_deref(), &order));
        }
        let triangles = order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        Ok(MeshData { positions, normals, uvs, triangles })
    }
}

/// Bilinear patches as triangles; flat ones as two, others as many. Corners are at (0, 0), (1, 0), (0, 1), (1, 1).
fn patches(positions: &[[f32; 3]], normals: Option<&[[f32; 3]]>, uvs: Option<&[[f32; 2]]>, order: &[u32]) -> MeshData {
    let mut mesh = MeshData { normals: Some(Vec::new()), uvs: Some(Vec::new()), ..MeshData::default() };
    for patch in order.chunks_exact(4) {
        let p = [0, 1, 2, 3].map(|i| Vec3::from(positions[patch[i] as usize]));
        let bend = (p[0] + p[3] - p[1] - p[2]).length();
        let size = (p[3] - p[0]).length().max((p[2] - p[1]).length());
        let n = if bend < 1e-5 * size { 1 } else { CUTS };
        let first = mesh.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                let w = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
                let mean = |q: [Vec3; 4]| q[0] * w[0] + q[1] * w[1] + q[2] * w[2] + q[3] * w[3];
                mesh.positions.push(mean(p).to_array());
                let du = (p[1] - p[0]) * (1.0 - v) + (p[3] - p[2]) * v;
                let dv = (p[2] - p[0]) * (1.0 - u) + (p[3] - p[1]) * u;
                let normal = match normals {
                    Some(all) => mean([0, 1, 2, 3].map(|k| Vec3::from(all[patch[k] as usize]))),
                    None => du.cross(dv),
                };
                mesh.normals.get_or_insert_default().push(normal.normalize_or_zero().to_array());
                let uv = match uvs {
                    Some(all) => std::array::from_fn(|c| (0..4).map(|k| w[k] * all[patch[k] as usize][c]).sum()),
                    None => [u, v],
                };
                mesh.uvs.get_or_insert_default().push(uv);
            }
        }
        let at = |i: usize, j: usize| first + (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    mesh
}

/// Loop's subdivision (1987), its points then moved to the limit surface (Hoppe et al. 1994), with smooth normals.
fn subdivided(mut mesh: MeshData, levels: u32) -> MeshData {
    for _ in 0..levels {
        let around = Neighbours::of(&mesh);
        let old = |i: u32| Vec3::from(mesh.positions[i as usize]);
        let even = |(i, edge): (usize, &Rim)| {
            let p = old(i as u32);
            match (&edge.boundary[..], edge.all.len()) {
                (&[a, b], _) => p * 0.75 + (old(a) + old(b)) * 0.125,
                (_, 0) => p,
                (_, n) => {
                    let beta = beta(n);
                    p * (1.0 - n as f32 * beta) + edge.all.iter().map(|j| old(*j)).sum::<Vec3>() * beta
                }
            }
        };
        let mut positions: Vec<[f32; 3]> = around.rims.iter().enumerate().map(|r| even(r).to_array()).collect();
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for (edge, opposite) in &around.edges {
            let [a, b] = edge.map(old);
            let middle = match opposite[..] {
                [c, d] => (a + b) * 0.375 + (old(c) + old(d)) * 0.125,
                _ => (a + b) * 0.5,
            };
            middles.insert(*edge, positions.len() as u32);
            positions.push(middle.to_array());
        }
        let middle = |a: u32, b: u32| middles[&[a.min(b), a.max(b)]];
        let cut = |[a, b, c]: &[u32; 3]| {
            let (x, y, z) = (middle(*a, *b), middle(*b, *c), middle(*c, *a));
            [[*a, x, z], [x, *b, y], [z, y, *c], [x, y, z]]
        };
        mesh.triangles = mesh.triangles.iter().flat_map(cut).collect();
        mesh.positions = positions;
    }
    let around = Neighbours::of(&mesh);
    let old = |i: u32| Vec3::from(mesh.positions[i as usize]);
    let limit = |(i, edge): (usize, &Rim)| {
        let p = old(i as u32);
        match (&edge.boundary[..], edge.all.len()) {
            (&[a, b], _) => p * 0.6 + (old(a) + old(b)) * 0.2,
            (_, 0) => p,
            (_, n) => {
                let gamma = 1.0 / (n as f32 + 3.0 / (8.0 * beta(n)));
                p * (1.0 - n as f32 * gamma) + edge.all.iter().map(|j| old(*j)).sum::<Vec3>() * gamma
            }
        }
    };
    mesh.positions = around.rims.iter().enumerate().map(|r| limit(r).to_array()).collect();
    mesh.uvs = None;
    mesh.normals = Some(mesh.smooth_normals());
    mesh
}

/// A neighbour's weight, by their number.
fn beta(n: usize) -> f32 {
    if n == 3 { 3.0 / 16.0 } else { 3.0 / (8.0 * n as f32) }
}

/// The vertices next to one, and those of them that lie on the mesh's boundary with it.
#[derive(Clone, Default)]
struct Rim {
    all: BTreeSet<u32>,
    boundary: Vec<u32>,
}

struct Neighbours {
    rims: Vec<Rim>,
    /// For each edge the corners opposite to it.
    edges: BTreeMap<[u32; 2], Vec<u32>>,
}

impl Neighbours {
    fn of(mesh: &MeshData) -> Self {
        let mut edges: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for [a, b, c] in [[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]] {
                edges.entry([a.min(b), a.max(b)]).or_default().push(c);
            }
        }
        let mut rims = vec![Rim::default(); mesh.positions.len()];
        for ([a, b], opposite) in &edges {
            for (i, j) in [(*a, *b), (*b, *a)] {
                rims[i as usize].all.insert(j);
                if opposite.len() == 1 {
                    rims[i as usize].boundary.push(j);
                }
            }
        }
        Self { rims, edges }
    }
}

/// A square that holds all directions, each with the same area (Clarberg 2008), as an equirectangular image.
pub fn sky(assets: &Assets, file: &str) -> Result<Image, String> {
    let image = crate::read_image(&assets.read(file)?, file).map_err(|e| e.message)?;
    let pixels = image.rgb("").filter(|p| !p.is_empty()).ok_or("it has no colours")?;
    let n = image.width as usize;
    if image.width != image.height {
        return Err(format!("an environment is a square image, not one of {}×{} pixels", image.width, image.height));
    }
    let mut out = Vec::with_capacity(2 * n * n);
    for y in 0..n {
        let (sin_theta, cos_theta) = (PI * (y as f64 + 0.5) / n as f64).sin_cos();
        for x in 0..2 * n {
            let (sin_phi, cos_phi) = (TAU * ((x as f64 + 0.5) / (2 * n) as f64 - 0.5)).sin_cos();
            // rebond's (x, y, z) are the image's (y, z, x).
            let d = DVec3::new(-sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
            let [u, v] = to_square(d).map(|s| s * n as f64 - 0.5);
            let (x0, y0) = (u.floor(), v.floor());
            let (fx, fy) = ((u - x0) as f32, (v - y0) as f32);
            let texel = |x: f64, y: f64| {
                let inside = |i: f64| (i.max(0.0) as usize).min(n - 1);
                pixels[inside(y) * n + inside(x)]
            };
            let corners = [texel(x0, y0), texel(x0 + 1.0, y0), texel(x0, y0 + 1.0), texel(x0 + 1.0, y0 + 1.0)];
            let w = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
            out.push(std::array::from_fn(|c| (0..4).map(|k| corners[k][c] * w[k]).sum()));
        }
    }
    Ok(Image::from_rgb(2 * n as u32, n as u32, &out))
}

/// Where a direction is in the square: the upper hemisphere is its inner diamond.
fn to_square(d: DVec3) -> [f64; 2] {
    let a = d.abs();
    let r = (1.0 - a.z).max(0.0).sqrt();
    let (long, short) = (a.x.max(a.y), a.x.min(a.y));
    let part = if long > 0.0 { (short / long).atan() * 2.0 / PI } else { 0.0 };
    let part = if a.x < a.y { 1.0 - part } else { part };
    let (mut u, mut v) = (r - part * r, part * r);
    if d.z < 0.0 {
        (u, v) = (1.0 - v, 1.0 - u);
    }
    [u.copysign(d.x), v.copysign(d.y)].map(|s| (s + 1.0) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_keeps_areas_and_its_corners_are_below() {
        for (d, want) in [
            (DVec3::Z, [0.5, 0.5]),
            (DVec3::X, [1.0, 0.5]),
            (DVec3::NEG_Y, [0.5, 0.0]),
            (DVec3::new(0.0, 0.0, -1.0), [1.0, 1.0]),
        ] {
            let s = to_square(d);
            assert!((s[0] - want[0]).abs() < 1e-9 && (s[1] - want[1]).abs() < 1e-9, "{d}: {s:?}");
        }
        // The Jacobian is the same everywhere: 4π of solid angle onto an area of 1.
        for [theta, phi] in [[0.3_f64, 0.2_f64], [1.1, 2.5], [2.0, 4.0], [2.9, 5.5]] {
            let at = |t: f64, p: f64| to_square(DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos()));
            let e = 1e-5;
            let (a, b, c, d) = (at(theta - e, phi), at(theta + e, phi), at(theta, phi - e), at(theta, phi + e));
            let (t, p) = ([(b[0] - a[0]), (b[1] - a[1])], [(d[0] - c[0]), (d[1] - c[1])]);
            let area = (t[0] * p[1] - t[1] * p[0]).abs() / (4.0 * e * e);
            assert!((area * 4.0 * PI / theta.sin() - 1.0).abs() < 1e-4, "{theta} {phi}: {area}");
        }
    }

    #[test]
    fn subdivision_keeps_planes_and_rounds_solids() {
        // A flat regular mesh stays in its plane; its inner points are where the limit puts regular ones: in place.
        let positions = (0..25).map(|i| [(i % 5) as f32 + (i / 5) as f32 * 0.5, (i / 5) as f32, 0.0]).collect();
        let cell = |i: u32| [[i, i + 1, i + 5], [i + 1, i + 6, i + 5]];
        let triangles = (0..4).flat_map(|y| (0..4).flat_map(move |x| cell(5 * y + x))).collect();
        let flat = MeshData { positions, triangles, ..MeshData::default() };
        let fine = subdivided(flat.clone(), 2);
        assert_eq!(fine.triangles.len(), 32 * 16);
        assert!(fine.positions.iter().all(|p| p[2] == 0.0));
        let [a, b] = [&flat, &fine].map(|m| Vec3::from(m.positions[12]));
        assert!((a - b).length() < 1e-6, "{a} {b}");
        // The limit of an octahedron's corner: γ = 1/(4 + 3/(8β)) with β = 3/32, so that it moves from 1 to 1 − 4/8.
        let positions = vec![
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ];
        let triangles = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        let solid = MeshData { positions, triangles, ..MeshData::default() };
        let corner = |levels: u32| subdivided(solid.clone(), levels).positions[0][0];
        assert!((corner(0) - 0.5).abs() < 1e-6 && (corner(3) - 0.5).abs() < 1e-5, "{} {}", corner(0), corner(3));
    }

    #[test]
    fn patches_are_flat_or_curved() {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]];
        let flat = patches(&positions, None, None, &[0, 1, 2, 3]);
        assert_eq!((flat.triangles.len(), flat.normals.expect("normals")[0]), (2, [0.0, 0.0, 1.0]));
        let bent = patches(&positions, None, None, &[0, 1, 2, 4]);
        assert_eq!(bent.triangles.len(), 2 * CUTS * CUTS);
        assert!(bent.positions.iter().all(|p| (p[2] - p[0] * p[1]).abs() < 1e-6), "z = x y");
    }
}
