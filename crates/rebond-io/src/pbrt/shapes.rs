//! Shapes, and environments.

use super::parse::{Parameters, Spot};
use super::{Importer, Result, Shine};
use crate::import::{SIDES, steps};
use crate::meshes::UV_NAMES;
use glam::{DMat4, DVec3, Vec3};
use rebond::film::Image;
use rebond::scene::description::{
    MaterialDescription, MaterialRef, MeshFile, ShapeDescription, Simple, Sphere, Texture,
};
use rebond::shape::MeshData;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::io::Read;

/// Cuts of a bilinear patch along each side.
const CUTS: usize = 16;
/// Rings of a sphere that has to be a mesh.
const RINGS: usize = 64;
/// Rows that an environment is brought to.
const SKY_ROWS: usize = 1024;
/// Triangles that stand in no file and that a scene may come to: of subdivision, patches and round shapes.
const MOST_TRIANGLES: usize = 1 << 21;

impl Importer<'_> {
    pub fn shape(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a shape")?;
        let p = self.words.parameters()?;
        let (reverse, m) = (self.state.reverse, self.state.matrix);
        let shine = self.shine(at);
        let (material, holes) = self.surface(&p, at, shine.is_some())?;
        let shines = shine.is_some();
        let (material, emission, glows) = match shine {
            Some(Shine { image: Some(radiance), color: scale }) => {
                let glow = MaterialDescription::Glow { radiance, scale, material };
                (MaterialRef::Inline(Box::new(glow)), None, true)
            }
            Some(Shine { image: None, color }) => (material, Some(color), false),
            None => (material, None, false),
        };
        // Where the triangles of a mesh get their coordinates from matters to what is spread over them.
        let lies = holes || self.lies(&material);
        let grouped = self.group.is_some();
        let material = Some(material);
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
                let radius = self.number(&p, "radius", 1.0)?;
                let r = f64::from(radius);
                let (zmin, zmax) = (f64::from(self.number(&p, "zmin", -r)?), f64::from(self.number(&p, "zmax", r)?));
                let sweep = self.sweep(&p)?;
                let [bottom, top] = [zmin.min(zmax), zmin.max(zmax)].map(|z| (z / r.abs()).clamp(-1.0, 1.0));
                // A radius of 0 is a mistake that others find.
                let whole = r == 0.0 || bottom == -1.0 && top == 1.0 && sweep == TAU;
                if holes || glows || !whole || !super::even(m) && (shines || grouped) {
                    self.warn(at, format!("a sphere becomes a mesh: it has holes, shows an image, is a part of one, or is stretched where only meshes may be; of {SIDES} by {RINGS} sides"));
                    let rings = (RINGS as f64 * (bottom.acos() - top.acos()) / PI).ceil().max(1.0) as usize;
                    let row = |k: usize| {
                        let v = k as f64 / rings as f64;
                        let (sin, cos) = (bottom.acos() + (top.acos() - bottom.acos()) * v).sin_cos();
                        Row { r: sin, z: cos, normal: [sin, cos], v }
                    };
                    let rows: Vec<Row> = (0..=rings).map(row).collect();
                    ply(self.lathed("sphere", &rows, sweep, at)?, m * DMat4::from_scale(DVec3::splat(r)))
                } else {
                    ShapeDescription::Sphere(Sphere {
                        center: [0.0; 3],
                        radius,
                        flip_normals: reverse,
                        material,
                        emission,
                        to_world: steps(m),
                    })
                }
            }
            "disk" => {
                let [radius, height, inner] = [("radius", 1.0), ("height", 0.0), ("innerradius", 0.0)]
                    .map(|(name, default)| self.number(&p, name, default).map(f64::from));
                let (radius, height, inner, sweep) = (radius?, height?, inner?, self.sweep(&p)?);
                let own =
                    DMat4::from_translation(DVec3::Z * height) * DMat4::from_scale(DVec3::new(radius, radius, 1.0));
                if radius != 0.0 && (lies || inner != 0.0 || sweep != TAU || grouped && !super::even(m)) {
                    // pbrt's v grows inwards.
                    self.warn(at, format!("a disk becomes a mesh of {SIDES} sides: it has images or holes, is a part of one, or is stretched in an object"));
                    let rows =
                        [(1.0, 0.0), (inner / radius, 1.0)].map(|(r, v)| Row { r, z: 0.0, normal: [0.0, 1.0], v });
                    ply(self.lathed("disk", &rows, sweep, at)?, m * own)
                } else {
                    ShapeDescription::Disk(Simple {
                        flip_normals: reverse,
                        material,
                        emission,
                        to_world: steps(m * own),
                    })
                }
            }
            "cylinder" => {
                let radius = f64::from(self.number(&p, "radius", 1.0)?);
                let (a, b) = (f64::from(self.number(&p, "zmin", -1.0)?), f64::from(self.number(&p, "zmax", 1.0)?));
                let (lo, hi) = (a.min(b), a.max(b));
                self.warn(at, format!("a cylinder becomes a prism of {SIDES} sides"));
                let rows = [0.0, 1.0].map(|z| Row { r: 1.0, z, normal: [1.0, 0.0], v: z });
                let sweep = self.sweep(&p)?;
                let file = self.lathed("cylinder", &rows, sweep, at)?;
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
                let file = self.assets.add_mesh("mesh", settled(mesh, lies));
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
                let packed = file.ends_with(".gz");
                let head = if packed { Head { normals: true, uvs: true } } else { self.head(&file, at)? };
                if packed || head.normals || lies && !head.uvs {
                    let bytes = self.assets.read(&file).and_then(|b| if packed { super::unpack(&b) } else { Ok(b) });
                    let bytes = bytes.map_err(|m| self.error(at, format!("\"{file}\": {m}")))?;
                    let mesh = crate::read_ply(&bytes, &file).map_err(|e| self.error(at, e.to_string()))?;
                    if packed || !is_settled(&mesh, lies) {
                        file = self.assets.add_mesh("mesh", settled(mesh, lies));
                    }
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
            return Err(self.error(
                at,
                format!("subdivision, patches and round shapes would come to more than {MOST_TRIANGLES} triangles"),
            ));
        }
        Ok(())
    }

    /// What the shape shines with, if it may.
    fn shine(&mut self, at: Spot) -> Option<Shine> {
        let light = self.state.light.clone()?;
        if self.group.is_some() {
            self.warn(at, "what is within an object does not shine, as in pbrt");
            return None;
        }
        Some(light)
    }

    /// What the shape is made of, and whether that has holes by an image.
    fn surface(&mut self, p: &Parameters, at: Spot, shines: bool) -> Result<(MaterialRef, bool)> {
        let material = self.state.material.clone();
        let opacity = self.alpha(p)?;
        if !shines {
            let holes = matches!(opacity, Some(Texture::Image(_)));
            return Ok(match opacity {
                Some(opacity) => {
                    (MaterialRef::Inline(Box::new(MaterialDescription::Mask { opacity, material })), holes)
                }
                None => (material, false),
            });
        }
        if opacity.is_some() {
            self.unsupported(at, "an area light with holes: it has none")?;
        }
        if let MaterialRef::Named(name) = &material
            && matches!(self.scene.materials.get(name), Some(MaterialDescription::Mask { .. }))
        {
            self.unsupported(at, "an area light that is nothing but light: it is black, and light does not pass it")?;
            return Ok((MaterialRef::Inline(Box::new(super::materials::diffuse(Texture::grey(0.0)))), false));
        }
        Ok((material, false))
    }

    /// The angle that a round shape goes around.
    fn sweep(&self, p: &Parameters) -> Result<f64> {
        let degrees = f64::from(self.number(p, "phimax", 360.0)?);
        Ok(if degrees < 360.0 { degrees.max(0.0).to_radians() } else { TAU })
    }

    /// A surface of revolution, made once.
    fn lathed(&mut self, name: &str, rows: &[Row], sweep: f64, at: Spot) -> Result<String> {
        let what = format!("{name} {rows:?} {sweep}");
        self.cut(2 * SIDES as usize * (rows.len() - 1), at)?;
        if let Some(file) = self.made.get(&what) {
            return Ok(file.clone());
        }
        let mesh = lathe(rows, sweep);
        if mesh.triangles.is_empty() {
            return Err(self.error(at, format!("nothing is left of this {name}")));
        }
        let file = self.assets.add_mesh(name, mesh);
        self.made.insert(what, file.clone());
        Ok(file)
    }

    /// Width and height of an image.
    pub fn size_of(&self, file: &str, at: Spot) -> Result<[u32; 2]> {
        let image = self.assets.read(file).and_then(|b| crate::read_image(&b, file).map_err(|e| e.message));
        let image = image.map_err(|m| self.error(at, format!("\"{file}\": {m}")))?;
        Ok([image.width, image.height])
    }

    /// A square that holds all directions, each with the same area (Clarberg 2008), as an equirectangular image: of rows enough that
    /// the edges of its texels, which are not interpolated in pbrt, stay sharp.
    pub fn sky(&mut self, file: &str, at: Spot) -> Result<Image> {
        let wrong = |me: &Self, message: String| me.error(at, format!("\"{file}\": {message}"));
        let image = self.assets.read(file).and_then(|b| crate::read_image(&b, file).map_err(|e| e.message));
        let image = image.map_err(|m| wrong(self, m))?;
        let Some(pixels) = image.rgb("").filter(|p| !p.is_empty()) else {
            return Err(wrong(self, "it has no colours".into()));
        };
        let n = image.width as usize;
        if image.width != image.height {
            let [w, h] = [image.width, image.height];
            return Err(wrong(self, format!("an environment is a square image, not one of {w}×{h} pixels")));
        }
        let rows = n * (SKY_ROWS / n).clamp(1, 16);
        self.make(6 * rows * rows, at)?;
        // Directions to a texel, along each side.
        let k = (4 * SKY_ROWS / rows).clamp(2, 16);
        let cosines: Vec<f64> = (0..rows * k).map(|y| (PI * (y as f64 + 0.5) / (rows * k) as f64).cos()).collect();
        let circle: Vec<(f64, f64)> =
            (0..2 * rows * k).map(|x| (TAU * ((x as f64 + 0.5) / (2 * rows * k) as f64 - 0.5)).sin_cos()).collect();
        let mut out = Vec::with_capacity(2 * rows * rows);
        for i in 0..2 * rows * rows {
            let (x, y) = (i % (2 * rows), i / (2 * rows));
            let mut sum = [0.0; 3];
            for j in 0..k * k {
                let (cos_theta, (sin_phi, cos_phi)) = (cosines[y * k + j / k], circle[x * k + j % k]);
                let sin_theta = (1.0 - cos_theta * cos_theta).sqrt();
                // rebond's (x, y, z) are the image's (y, z, x).
                let d = DVec3::new(-sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
                let [u, v] = to_square(d).map(|s| ((s * n as f64) as usize).min(n - 1));
                let texel = pixels[v * n + u];
                sum = std::array::from_fn(|c| sum[c] + f64::from(texel[c].max(0.0)) / (k * k) as f64);
            }
            out.push(sum.map(|x| x as f32));
        }
        Ok(Image::from_rgb(2 * rows as u32, rows as u32, &out))
    }

    /// What the beginning of a PLY file says of its vertices.
    fn head(&self, file: &str, at: Spot) -> Result<Head> {
        let mut bytes = Vec::new();
        let path = self.assets.path(file).map_err(|m| self.error(at, m))?;
        let read = std::fs::File::open(&path).and_then(|f| f.take(1 << 14).read_to_end(&mut bytes));
        read.map_err(|e| self.error(at, format!("cannot read \"{}\": {e}", path.display())))?;
        let text = String::from_utf8_lossy(&bytes);
        let head = text.split("end_header").next().unwrap_or_default();
        let properties = head.lines().filter_map(|l| l.trim().strip_prefix("property "));
        let names: Vec<&str> = properties.filter_map(|l| l.split_whitespace().last()).collect();
        let has = |wanted: &[&str]| wanted.iter().all(|name| names.contains(name));
        Ok(Head { normals: has(&["nx", "ny", "nz"]), uvs: UV_NAMES.iter().any(|pair| has(pair)) })
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
        let _ = p.get("faceIndices");
        if let Some(q) = p.get("S") {
            self.warn(q.at, "tangents are left out: they follow the texture coordinates");
        }
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
        Ok(MeshData { positions, normals, uvs, triangles, ..MeshData::default() })
    }
}

/// Whether a PLY file has normals, and texture coordinates.
struct Head {
    normals: bool,
    uvs: bool,
}

/// A mesh whose sides are those of its normals, where it has some: so pbrt takes them, and rebond by the order of corners. If
/// something lies on it and it has no coordinates, each triangle has pbrt's: (0, 0), (1, 0), (1, 1).
fn settled(mut mesh: MeshData, lies: bool) -> MeshData {
    // What is wrong with a file is said when the scene is built.
    let sound = mesh.triangles.iter().flatten().all(|i| (*i as usize) < mesh.positions.len());
    if sound && lies && mesh.uvs.is_none() {
        let corners = || mesh.triangles.iter().flatten().map(|i| *i as usize);
        mesh = MeshData {
            positions: corners().map(|i| mesh.positions[i]).collect(),
            normals: mesh.normals.as_ref().map(|n| corners().map(|i| n[i]).collect()),
            uvs: Some(mesh.triangles.iter().flat_map(|_| [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]).collect()),
            triangles: (0..mesh.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..MeshData::default()
        };
    }
    for i in 0..mesh.triangles.len() {
        if turned(&mesh, mesh.triangles[i]) {
            mesh.triangles[i].swap(1, 2);
        }
    }
    mesh
}

fn is_settled(mesh: &MeshData, lies: bool) -> bool {
    (!lies || mesh.uvs.is_some()) && !mesh.triangles.iter().any(|t| turned(mesh, *t))
}

/// Whether the normals of a triangle are on the other side than the order of its corners says.
fn turned(mesh: &MeshData, t: [u32; 3]) -> bool {
    let Some(normals) = &mesh.normals else { return false };
    let at = |of: &[[f32; 3]], k: usize| of.get(t[k] as usize).map_or(Vec3::ZERO, |v| Vec3::from(*v));
    let p = |k: usize| at(&mesh.positions, k);
    let sum: Vec3 = (0..3).map(|k| at(normals, k)).sum();
    (p(1) - p(0)).cross(p(2) - p(0)).dot(sum) < 0.0
}

/// A circle of a surface of revolution: its radius and height, the normal's parts outwards and upwards, and v.
#[derive(Clone, Copy, Debug)]
struct Row {
    r: f64,
    z: f64,
    normal: [f64; 2],
    v: f64,
}

/// The surface of revolution about z of these circles, from φ = 0 to `sweep`, where u is 1. Outside is to the right of the way up.
fn lathe(rows: &[Row], sweep: f64) -> MeshData {
    let sides = (f64::from(SIDES) * sweep / TAU).ceil().max(1.0) as u32;
    let mut mesh = MeshData { normals: Some(Vec::new()), uvs: Some(Vec::new()), ..MeshData::default() };
    for row in rows {
        for i in 0..=sides {
            // A whole circle ends where it began.
            let part = if i == sides && sweep == TAU { 0.0 } else { f64::from(i) / f64::from(sides) };
            let (sin, cos) = (sweep * part).sin_cos();
            let round = |r: f64, z: f64| [(r * cos) as f32, (r * sin) as f32, z as f32];
            mesh.positions.push(round(row.r, row.z));
            mesh.normals.get_or_insert_default().push(round(row.normal[0], row.normal[1]));
            // A pole is the tip of as many triangles as there are sides.
            let middle = if row.r.abs() < 1e-12 { 0.5 } else { 0.0 };
            let u = (f64::from(i) + middle) / f64::from(sides);
            mesh.uvs.get_or_insert_default().push([u as f32, row.v as f32]);
        }
    }
    for (j, pair) in rows.windows(2).enumerate() {
        let [below, above] = [0, 1].map(|k| pair[k].r.abs() >= 1e-12);
        for i in 0..sides {
            let at = |i: u32, row: usize| (j + row) as u32 * (sides + 1) + i;
            if below {
                mesh.triangles.push([at(i, 0), at(i + 1, 0), if above { at(i + 1, 1) } else { at(i, 1) }]);
            }
            if above {
                mesh.triangles.push([at(i, 0), at(i + 1, 1), at(i, 1)]);
            }
        }
    }
    mesh
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

/// Loop's subdivision (1987), its points then moved to the limit surface, with its normals (Hoppe et al. 1994). In pbrt these are
/// against the order of the corners.
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
    let next = around.next(&mesh);
    let normal = |(i, rim): (usize, &Rim)| rim.normal(i, &next[i], &mesh.positions).to_array();
    mesh.normals = Some(around.rims.iter().enumerate().map(normal).collect());
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

    /// Of each vertex which neighbour follows which, counter-clockwise.
    fn next(&self, mesh: &MeshData) -> Vec<BTreeMap<u32, u32>> {
        let mut next = vec![BTreeMap::new(); self.rims.len()];
        for [a, b, c] in &mesh.triangles {
            for [a, b, c] in [[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]] {
                next[a as usize].insert(b, c);
            }
        }
        next
    }
}

impl Rim {
    /// The normal of the limit surface at vertex i: across two tangents, each a sum of the neighbours in their order.
    fn normal(&self, i: usize, next: &BTreeMap<u32, u32>, positions: &[[f32; 3]]) -> Vec3 {
        let at = |i: u32| Vec3::from(positions[i as usize]);
        let followed: BTreeSet<u32> = next.values().copied().collect();
        let first = next.keys().find(|k| !followed.contains(k)).or_else(|| next.keys().next());
        let Some(mut last) = first.copied() else { return Vec3::ZERO };
        let mut ring = vec![at(last)];
        while let Some(n) = next.get(&last)
            && ring.len() < self.all.len()
        {
            last = *n;
            ring.push(at(last));
        }
        let (n, p) = (ring.len(), at(i as u32));
        let wave = |f: fn(f32) -> f32, step: f32| (0..n).map(|j| ring[j] * f(step * j as f32)).sum::<Vec3>();
        if self.boundary.is_empty() {
            let step = std::f32::consts::TAU / n as f32;
            return wave(f32::sin, step).cross(wave(f32::cos, step)).normalize_or_zero();
        }
        let along = ring[n - 1] - ring[0];
        let across = match n {
            2 => ring[0] + ring[1] - p * 2.0,
            3 => ring[1] - p,
            4 => (ring[1] + ring[2]) * 2.0 - ring[0] - ring[3] - p * 2.0,
            _ => {
                let step = std::f32::consts::PI / (n - 1) as f32;
                // The sine is 0 at both ends.
                wave(f32::sin, step) * (2.0 - 2.0 * step.cos()) - (ring[0] + ring[n - 1]) * step.sin()
            }
        };
        along.cross(across).normalize_or_zero()
    }
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
