//! glTF 2.0 (Khronos 2021), `.gltf` and `.glb`.
//!
//! | glTF | rebond |
//! |---|---|
//! | cameras look along −z | along +z: turned by half a turn |
//! | (0, 0) of an image is its upper left | its lower left: v of every mesh becomes 1 − v |
//! | candela, lux, nits | the same numbers, in W·sr⁻¹, W·m⁻², W·sr⁻¹·m⁻² |
//! | a film | none: the camera's aspect ratio, 540 pixels high |
//! | what is not double-sided is not drawn from behind | it is black from behind |
//!
//! Read are the scene's nodes with their meshes, cameras and lights, and these extensions: `KHR_lights_punctual`,
//! `KHR_materials_clearcoat`, `_emissive_strength`, `_ior`, `_sheen`, `_specular`, `_transmission`, `_unlit`, `_volume` (its index
//! matters, its absorption is not supported), `KHR_mesh_quantization`, `KHR_texture_transform`. Nothing moves: animations are at rest.

mod accessor;
mod materials;

use self::accessor::Numbers;
use self::materials::Shine;
use crate::error::Error;
use crate::import::{Assets, ImportOptions, Imported, Places, Report, bounds, camera_before, free_name, steps};
use ::gltf::json::{
    Root,
    camera::Type as CameraType,
    material::AlphaMode,
    mesh::{Mode, Semantic},
    scene::Node,
    validation::Checked,
};
use glam::{DMat4, DQuat, DVec3, DVec4};
use rebond::scene::SceneDescription;
use rebond::scene::description::{
    CameraDescription, Color, EmitterDescription, FovAxis, InstanceDescription, MaterialRef, MeshFile,
    ShapeDescription, Transform,
};
use rebond::shape::MeshData;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;

type Result<T, E = Error> = std::result::Result<T, E>;

/// Nodes within each other.
const DEEPEST: usize = 256;
/// Nodes of a scene, those that are there twice counted twice.
const MOST_NODES: usize = 1 << 20;
/// Numbers that are read and kept, for each byte of the buffers and beyond those: a file may name the same bytes again and again.
const NUMBERS_PER_BYTE: u64 = 8;
const MOST_NUMBERS: u64 = 1 << 24;
/// Height of a film, pixels.
const HEIGHT: f64 = 540.0;

/// Extensions that are read.
const KNOWN: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Reads a scene, `.gltf` or `.glb`; `file` is what errors call it, `folder` where its files are.
pub fn read_gltf(bytes: &[u8], file: &str, folder: &Path, options: ImportOptions) -> Result<Imported> {
    let named = |message: String| Error::new(message).with_file(file);
    let (json, bin) = split(bytes).map_err(named)?;
    let value: Value = serde_json::from_slice(json).map_err(|e| not_json(json, &e, file))?;
    let root: Root = serde_json::from_slice(json).map_err(|e| not_json(json, &e, file))?;
    if !root.asset.version.starts_with("2.") {
        return Err(named(format!("glTF of version {} is not supported: 2.0 is", root.asset.version)));
    }
    // Which versions the file needs at least.
    let needs = root.asset.min_version.as_deref().unwrap_or("2.0");
    let parts: Option<Vec<u32>> = needs.split('.').map(|part| part.parse().ok()).collect();
    if parts.is_none_or(|parts| parts.as_slice() > [2, 0].as_slice()) {
        return Err(named(format!("the file needs glTF of version {needs}: 2.0 is supported")));
    }
    let mut importer = Importer {
        file: file.to_string(),
        root,
        value,
        bin,
        buffers: BTreeMap::new(),
        accessors: BTreeMap::new(),
        assets: Assets::new(folder, options),
        report: Report { lenient: options.lenient, ..Report::default() },
        scene: SceneDescription::default(),
        places: Places::default(),
        meshes: BTreeMap::new(),
        shared: BTreeMap::new(),
        materials: BTreeMap::new(),
        images: BTreeMap::new(),
        uses: BTreeMap::new(),
        nodes: 0,
        zeros: 0,
        numbers: 0,
        bytes: bin.map_or(0, |b| b.len() as u64),
        clips: None,
        shines: false,
        bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY],
    };
    importer.scene()?;
    Ok(Imported {
        description: importer.scene,
        files: importer.assets,
        warnings: importer.report.warnings,
        samples: None,
        places: importer.places.of(vec![(importer.file, "".into())]),
    })
}

/// The text and the binary chunk of a file.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if word(4) != Some(2) {
        return Err("binary glTF of another version than 2".into());
    }
    let (mut json, mut bin, mut at) = (None, None, 12);
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let chunk = (at + 8).checked_add(length as usize).and_then(|end| bytes.get(at + 8..end));
        let chunk = chunk.ok_or("a chunk of this file ends after its end")?;
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if bin.is_none() => bin = Some(chunk),
            // To be passed over.
            _ => {}
        }
        at += 8 + chunk.len();
    }
    Ok((json.ok_or("there is no JSON in this file")?, bin))
}

fn not_json(json: &[u8], e: &serde_json::Error, file: &str) -> Error {
    let text = String::from_utf8_lossy(json);
    let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1));
    let start = lines.into_iter().nth(e.line().saturating_sub(1)).unwrap_or(0);
    let at = text.floor_char_boundary((start + e.column().saturating_sub(1)).min(text.len()));
    let mut place = crate::document::place_of(&text, at..at);
    // A file may be one line.
    if place.source_line.chars().count() > 200 {
        place.source_line = String::new();
    }
    let words = e.to_string();
    let words = words.rsplit_once(" at line").map_or(&*words, |(words, _)| words);
    Error { place: Some(Box::new(place)), ..Error::new(format!("not valid glTF: {words}")) }.with_file(file)
}

/// A mesh as it is used: a shape for each of its primitives.
#[derive(Clone)]
struct Primitive {
    file: String,
    material: Option<usize>,
    /// Whether its vertices have colours.
    colored: bool,
    bounds: [DVec3; 2],
}

/// Accessors of positions, normals, texture coordinates, colours and indices, and how those are meant.
type Made = (usize, Option<usize>, Option<usize>, Option<usize>, Option<usize>, u8);

/// The camera that is used, and how far it is said to see.
struct Clips {
    path: String,
    from: DVec3,
    axis: DVec3,
    near: f32,
    far: f32,
}

struct Importer<'a> {
    file: String,
    root: Root,
    /// The same, for what extensions say.
    value: Value,
    bin: Option<&'a [u8]>,
    buffers: BTreeMap<usize, Vec<u8>>,
    accessors: BTreeMap<usize, Rc<Numbers>>,
    assets: Assets,
    report: Report,
    scene: SceneDescription,
    places: Places,
    meshes: BTreeMap<usize, Vec<Primitive>>,
    /// Meshes by what they are made of.
    shared: BTreeMap<Made, (String, [DVec3; 2])>,
    /// Names of materials, by number and whether the colours of vertices colour them, and how they shine.
    materials: BTreeMap<(usize, bool), (String, Shine)>,
    images: BTreeMap<(usize, bool), rebond::film::Image>,
    /// How many nodes have a mesh.
    uses: BTreeMap<usize, usize>,
    nodes: usize,
    /// Rows without a buffer so far.
    zeros: u64,
    /// Numbers read and kept, and bytes of buffers, so far.
    numbers: u64,
    bytes: u64,
    clips: Option<Clips>,
    /// Some surface does.
    shines: bool,
    bounds: [DVec3; 2],
}

impl Importer<'_> {
    /// An error about a part of the file, such as `materials[3]`.
    fn error(&self, path: &str, message: impl Into<String>) -> Error {
        let message = message.into();
        let message = if path.is_empty() { message } else { format!("{}: {message}", self.named(path)) };
        Error::new(message).with_file(self.file.clone())
    }

    /// The path of a part, with the name that the file gives to its first element, if it does.
    fn named(&self, path: &str) -> String {
        let element = path.split_once(']').and_then(|(element, _)| element.split_once('['));
        let name = element.and_then(|(list, number)| match list {
            // As the extension has them.
            "lights" => self.at(&format!("/extensions/KHR_lights_punctual/lights/{number}/name")),
            _ => self.at(&format!("/{list}/{number}/name")),
        });
        match name.and_then(Value::as_str) {
            Some(name) if !name.is_empty() => {
                let name: String = name.chars().filter(|c| !c.is_control()).take(60).collect();
                format!("{path} (\"{name}\")")
            }
            _ => path.to_string(),
        }
    }

    /// An error of what that part of the file is made of: says so.
    fn within(&self, path: &str, error: Error) -> Error {
        if error.message.starts_with(path) {
            return error;
        }
        Error { message: format!("{}, of {}", error.message, self.named(path)), ..error }
    }

    /// Counts numbers that are read or kept.
    fn count(&mut self, path: &str, numbers: u64) -> Result<()> {
        self.numbers = self.numbers.saturating_add(numbers);
        let most = self.bytes.saturating_mul(NUMBERS_PER_BYTE).saturating_add(MOST_NUMBERS);
        if self.numbers <= most {
            return Ok(());
        }
        Err(self.error(path, "the file repeats its numbers more often than is allowed").with_help(format!(
            "at most {NUMBERS_PER_BYTE} numbers are read and kept for each byte, and {MOST_NUMBERS} more"
        )))
    }

    fn unsupported(&mut self, path: &str, message: impl Into<String>) -> Result<()> {
        let error = self.error(path, message);
        self.report.unsupported(error)
    }

    fn warn(&mut self, path: &str, message: impl Into<String>) {
        let error = self.error(path, message);
        self.report.warn(error);
    }

    /// The value at a JSON pointer.
    fn at(&self, pointer: &str) -> Option<&Value> {
        self.value.pointer(pointer)
    }

    /// The number at a JSON pointer, if there is one.
    fn number(&self, pointer: &str) -> Result<Option<f32>> {
        let Some(value) = self.at(pointer) else { return Ok(None) };
        let number = single(value);
        number.map(Some).ok_or_else(|| self.error("", format!("{pointer} is no number of single precision")))
    }

    fn numbers<const N: usize>(&self, pointer: &str) -> Result<Option<[f32; N]>> {
        let Some(value) = self.at(pointer) else { return Ok(None) };
        let list = value.as_array().and_then(|list| list.iter().map(single).collect::<Option<Vec<f32>>>());
        let numbers = list.and_then(|list| list.try_into().ok());
        numbers
            .map(Some)
            .ok_or_else(|| self.error("", format!("{pointer} is no list of {N} numbers of single precision")))
    }

    fn scene(&mut self) -> Result<()> {
        let required = self.root.extensions_required.clone();
        let optional = self.root.extensions_used.iter().filter(|name| !required.contains(name)).cloned();
        let all: Vec<(String, &str)> = optional.map(|name| (name, "")).collect();
        let all = required.into_iter().map(|name| (name, ", which the file requires")).chain(all);
        for (name, required) in all {
            if !KNOWN.contains(&name.as_str()) {
                self.unsupported("", format!("the extension {name} is not supported{required}"))?;
            }
        }
        if !self.root.animations.is_empty() {
            self.warn("animations", "everything is at rest");
        }
        let number = self.root.scene.map_or(0, |s| s.value());
        let Some(scene) = self.root.scenes.get(number) else {
            return Err(self.error("scenes", format!("there is no scene {number}")));
        };
        let roots: Vec<usize> = scene.nodes.iter().map(|n| n.value()).collect();
        let used: Vec<usize> = self.root.nodes.iter().filter_map(|n| n.mesh).map(|m| m.value()).collect();
        used.into_iter().for_each(|m| *self.uses.entry(m).or_default() += 1);
        for node in roots {
            self.node(node, DMat4::IDENTITY, &mut Vec::new())?;
        }
        match self.clips.take() {
            Some(clips) => self.check_clips(&clips),
            None => self.default_camera(),
        }
        if self.scene.emitters.is_empty() && !self.shines {
            self.warn("", "the file has no light: an even sky of radiance 1 lights it");
            self.scene.emitters.push(EmitterDescription::Constant { radiance: Color([1.0; 3]) });
        }
        Ok(())
    }

    fn node(&mut self, number: usize, parent: DMat4, above: &mut Vec<usize>) -> Result<()> {
        let path = format!("nodes[{number}]");
        let Some(node) = self.root.nodes.get(number) else {
            return Err(self.error(&path, "there is no such node"));
        };
        self.nodes += 1;
        if above.contains(&number) || above.len() > DEEPEST || self.nodes > MOST_NODES {
            return Err(self.error(&path, "this node is within itself, or there are too many"));
        }
        let m = parent * local(node);
        if !m.is_finite() {
            return Err(self.error(&path, "its transform is not finite"));
        }
        let (mesh, camera, skin) = (node.mesh.map(|m| m.value()), node.camera.map(|c| c.value()), node.skin.is_some());
        let children: Vec<usize> = node.children.iter().flatten().map(|c| c.value()).collect();
        if skin {
            self.unsupported(&path, "a skin")?;
        }
        if let Some(mesh) = mesh {
            self.mesh(mesh, m, &path)?;
        }
        if let Some(camera) = camera {
            self.camera(camera, m)?;
        }
        if let Some(light) = self.at(&format!("/nodes/{number}/extensions/KHR_lights_punctual/light")) {
            let light = light.as_u64().unwrap_or(u64::MAX);
            self.light(light, m)?;
        }
        above.push(number);
        for child in children {
            self.node(child, m, above)?;
        }
        above.pop();
        Ok(())
    }

    // ---- meshes ----

    fn mesh(&mut self, number: usize, m: DMat4, node: &str) -> Result<()> {
        if m.determinant() == 0.0 {
            let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|v| v.truncate());
            let area = x.cross(y).length() + y.cross(z).length() + z.cross(x).length();
            return match area > 0.0 {
                true => self.unsupported(node, "a transform that flattens its mesh"),
                // A usual way to hide it.
                false => Ok(()),
            };
        }
        let primitives = match self.meshes.get(&number) {
            Some(known) => known.clone(),
            None => {
                let read = self.primitives(number)?;
                self.meshes.insert(number, read.clone());
                read
            }
        };
        for p in &primitives {
            for i in 0..8 {
                let pick = |axis: usize| p.bounds[i >> axis & 1][axis];
                let corner = m.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
                self.bounds = [self.bounds[0].min(corner), self.bounds[1].max(corner)];
            }
        }
        let (mut shapes, mut shines) = (Vec::new(), false);
        for (i, p) in primitives.into_iter().enumerate() {
            let of = format!("meshes[{number}].primitives[{i}]");
            let (material, shine) = self.material(p.material, p.colored).map_err(|e| self.within(&of, e))?;
            shines |= shine != Shine::Not;
            let emission = if let Shine::Evenly(color) = shine { Some(color) } else { None };
            shapes.push(MeshFile {
                file: p.file,
                face_normals: false,
                smooth_normals: false,
                flip_normals: false,
                material: Some(MaterialRef::Named(material)),
                emission,
                to_world: Transform::default(),
            });
        }
        // Several of a kind are stored once; only the world's shapes may shine.
        let several = !shines && self.uses.get(&number).is_some_and(|n| *n > 1);
        self.shines |= shines;
        let of = format!("{}, {}", self.named(node), self.named(&format!("meshes[{number}]")));
        if several && !shapes.is_empty() {
            let name = format!("mesh {number}");
            if !self.scene.groups.contains_key(&name) {
                self.places.note(format!("groups.{name}"), (0, None));
                self.places.name(format!("groups.{name}"), self.named(&format!("meshes[{number}]")));
                self.scene.groups.insert(name.clone(), shapes.into_iter().map(ShapeDescription::Ply).collect());
            }
            self.push(ShapeDescription::Instance(InstanceDescription { group: name, to_world: steps(m) }), of);
        } else {
            for (i, shape) in shapes.into_iter().enumerate() {
                let of = format!("{of}, primitives[{i}]");
                self.push(ShapeDescription::Ply(MeshFile { to_world: steps(m), ..shape }), of);
            }
        }
        Ok(())
    }

    /// Adds a shape; `of` is what the file calls it.
    fn push(&mut self, shape: ShapeDescription, of: String) {
        let path = format!("shapes[{}]", self.scene.shapes.len());
        self.places.note(path.clone(), (0, None));
        self.places.name(path, of);
        self.scene.shapes.push(shape);
    }

    fn primitives(&mut self, number: usize) -> Result<Vec<Primitive>> {
        let Some(mesh) = self.root.meshes.get(number) else {
            return Err(self.error(&format!("meshes[{number}]"), "there is no such mesh"));
        };
        let mut out = Vec::new();
        for (i, p) in mesh.primitives.clone().into_iter().enumerate() {
            let path = format!("meshes[{number}].primitives[{i}]");
            out.extend(self.primitive(&p, &path, &format!("mesh-{number}-{i}")).map_err(|e| self.within(&path, e))?);
        }
        Ok(out)
    }

    /// A primitive, unless it is left out; its mesh, if no other has the same, is called `name`.
    fn primitive(&mut self, p: &::gltf::json::mesh::Primitive, path: &str, name: &str) -> Result<Option<Primitive>> {
        let attribute = |wanted: Semantic| p.attributes.get(&Checked::Valid(wanted)).map(|a| a.value());
        self.check_attributes(p, path)?;
        if p.targets.as_ref().is_some_and(|t| !t.is_empty()) {
            self.warn(path, "its morph targets are left out");
        }
        let Some(positions) = attribute(Semantic::Positions) else {
            self.unsupported(path, "a primitive without positions")?;
            return Ok(None);
        };
        let mode = match p.mode {
            Checked::Valid(Mode::Triangles) => 4,
            Checked::Valid(Mode::TriangleStrip) => 5,
            Checked::Valid(Mode::TriangleFan) => 6,
            _ => {
                self.unsupported(path, "points or lines")?;
                return Ok(None);
            }
        };
        let material = p.material.map(|m| m.value());
        let (normals, indices) = (attribute(Semantic::Normals), p.indices.map(|a| a.value()));
        let uvs = attribute(Semantic::TexCoords(self.uv_set(material, path)?));
        let colors = self.colors(attribute(Semantic::Colors(0)), material, path)?;
        let colored = colors.is_some();
        let made = (positions, normals, uvs, colors, indices, mode);
        if let Some((file, bounds)) = self.shared.get(&made).cloned() {
            return Ok(Some(Primitive { file, material, colored, bounds }));
        }
        let Some(mesh) = self.triangles(&made, path)? else {
            self.warn(path, "it has no triangles");
            return Ok(None);
        };
        let kept = mesh.triangles.len() as u64 * 3 + mesh.positions.len() as u64 * 8;
        self.count(path, kept)?;
        let bounds = bounds(mesh.positions.iter());
        let file = self.assets.add_mesh(name, mesh);
        self.shared.insert(made, (file.clone(), bounds));
        Ok(Some(Primitive { file, material, colored, bounds }))
    }

    fn check_attributes(&mut self, p: &::gltf::json::mesh::Primitive, path: &str) -> Result<()> {
        for semantic in p.attributes.keys() {
            match semantic {
                Checked::Valid(Semantic::Positions | Semantic::Normals) => {}
                Checked::Valid(Semantic::Tangents) => {
                    self.warn(path, "its tangents are left out: they follow its texture coordinates");
                }
                // Of which more below.
                Checked::Valid(Semantic::Colors(0)) => {}
                Checked::Valid(Semantic::Joints(_) | Semantic::Weights(_)) => {}
                // Sets of texture coordinates that no texture uses do no harm.
                Checked::Valid(Semantic::TexCoords(_)) => {}
                Checked::Valid(other) => {
                    let name = ::gltf::json::mesh::Semantic::to_string(other);
                    // Names with an underscore are an application's own.
                    if !name.starts_with('_') {
                        self.unsupported(path, format!("the attribute {name}"))?;
                    }
                }
                Checked::Invalid => self.unsupported(path, "an attribute of no known name")?,
            }
        }
        Ok(())
    }

    /// The accessor of colours that are not all white. Their alpha counts where the material's does, which is not supported.
    fn colors(&mut self, accessor: Option<usize>, material: Option<usize>, path: &str) -> Result<Option<usize>> {
        let Some(accessor) = accessor else { return Ok(None) };
        let numbers = self.accessor(accessor, path)?;
        let width = numbers.width();
        if width != 3 && width != 4 {
            return Err(self.error(path, format!("accessor {accessor} has rows of {width} numbers, not of 3 or 4")));
        }
        let mode = material.and_then(|m| self.root.materials.get(m)).map(|m| m.alpha_mode);
        let veiled = matches!(mode, Some(Checked::Valid(AlphaMode::Mask | AlphaMode::Blend)));
        if veiled && width == 4 && numbers.values.iter().skip(3).step_by(4).any(|a| *a != 1.0) {
            self.unsupported(path, "the alpha of colours of vertices")?;
        }
        let colors = numbers.values.chunks_exact(width).flat_map(|row| &row[..3]);
        let outside = colors.filter(|x| !(0.0..=1.0).contains(*x)).count();
        if outside > 0 {
            let numbers = if outside == 1 { "one number" } else { &*format!("{outside} numbers") };
            return Err(self.error(path, format!("its COLOR_0 (accessor {accessor}) has {numbers} outside of [0, 1]")));
        }
        let white = numbers.values.chunks_exact(width).all(|row| row[..3] == [1.0; 3]);
        Ok((!white).then_some(accessor))
    }

    /// The triangles of those accessors, with the vertices that they use; none if there are none.
    fn triangles(&mut self, made: &Made, path: &str) -> Result<Option<MeshData>> {
        let (positions, normals, uvs, colors, indices, mode) = *made;
        let positions = self.rows(positions, 3, path)?;
        let normals = normals.map(|a| self.rows(a, 3, path)).transpose()?;
        let uvs = uvs.map(|a| self.rows(a, 2, path)).transpose()?;
        let colors = colors.map(|a| self.accessor(a, path)).transpose()?;
        let indices = indices.map(|a| self.indices(a, path)).transpose()?;
        let count = positions.len();
        if [&normals, &uvs, &colors].into_iter().flatten().any(|a| a.len() != count) {
            return Err(self.error(path, "its attributes are not of one length"));
        }
        let every: Vec<u32> = if indices.is_some() { Vec::new() } else { (0..count as u32).collect() };
        let given = indices.as_ref().map_or(&every, |a| &a.indices);
        if let Some(bad) = given.iter().find(|i| **i as usize >= count) {
            return Err(self.error(path, format!("it names vertex {bad} of {count}")));
        }
        // Primitives often share vertices of which each uses some: those, in their order.
        let mut numbers = vec![0; count];
        given.iter().for_each(|i| numbers[*i as usize] = 1);
        let used: Vec<usize> = (0..count).filter(|i| numbers[*i] > 0).collect();
        (0..).zip(&used).for_each(|(number, i)| numbers[*i] = number);
        let order: Vec<u32> = given.iter().map(|i| numbers[*i as usize]).collect();
        let rows = |a: &Numbers| used.iter().map(|i| a.row(*i)).collect();
        let flipped = |a: &Numbers| used.iter().map(|i| a.row(*i)).map(|[u, v]: [f32; 2]| [u, 1.0 - v]).collect();
        let color = |a: &Numbers| {
            let row = |i: usize| std::array::from_fn(|c| a.values[i * a.width() + c]);
            (String::from("vertex_color"), used.iter().map(|i| row(*i)).collect())
        };
        let mut mesh = MeshData {
            attributes: colors.as_deref().map(color).into_iter().collect(),
            positions: rows(&positions),
            normals: normals.as_deref().map(rows),
            uvs: uvs.as_deref().map(flipped),
            ..MeshData::default()
        };
        let strip = |i: usize| {
            if i.is_multiple_of(2) {
                [order[i], order[i + 1], order[i + 2]]
            } else {
                [order[i + 1], order[i], order[i + 2]]
            }
        };
        mesh.triangles = match mode {
            4 => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            5 => (0..order.len().saturating_sub(2)).map(strip).collect(),
            _ => order.windows(2).skip(1).map(|e| [order[0], e[0], e[1]]).collect(),
        };
        Ok((!mesh.triangles.is_empty()).then_some(mesh))
    }

    // ---- cameras and lights ----

    fn camera(&mut self, number: usize, m: DMat4) -> Result<()> {
        let path = format!("cameras[{number}]");
        let Some(camera) = self.root.cameras.get(number) else {
            return Err(self.error(&path, "there is no such camera"));
        };
        if self.clips.is_some() {
            self.warn(&path, "a further camera: the first is used");
            return Ok(());
        }
        let kind = camera.type_;
        let (perspective, orthographic) = (camera.perspective.clone(), camera.orthographic.clone());
        // It stands where the node does, but has no size.
        let axis = |v: DVec4| v.truncate().normalize_or_zero();
        let (x, y, z) = (axis(m.x_axis), axis(m.y_axis), axis(m.z_axis));
        let place = DMat4::from_cols((-x).extend(0.0), y.extend(0.0), (-z).extend(0.0), m.w_axis);
        let (description, aspect, near, far) = match (kind, perspective, orthographic) {
            (Checked::Valid(CameraType::Perspective), Some(p), _) => {
                let camera = CameraDescription::Perspective {
                    to_world: steps(place),
                    fov: p.yfov.to_degrees(),
                    fov_axis: FovAxis::Y,
                    principal_point_offset: [0.0; 2],
                    near_clip: p.znear,
                    shutter_open: 0.0,
                    shutter_close: 0.0,
                };
                (camera, f64::from(p.aspect_ratio.unwrap_or(16.0 / 9.0)), 0.0, p.zfar.unwrap_or(f32::INFINITY))
            }
            (Checked::Valid(CameraType::Orthographic), _, Some(o)) => {
                let scale = DMat4::from_scale(DVec3::new(f64::from(o.xmag), f64::from(o.xmag), 1.0));
                let camera = CameraDescription::Orthographic {
                    to_world: steps(place * scale),
                    shutter_open: 0.0,
                    shutter_close: 0.0,
                };
                (camera, f64::from(o.xmag / o.ymag), o.znear, o.zfar)
            }
            _ => return Err(self.error(&path, "it is neither perspective nor orthographic")),
        };
        if !(aspect > 1e-3 && aspect < 1e3) {
            return Err(self.error(&path, format!("{aspect} is no ratio of width and height")));
        }
        (self.scene.film.width, self.scene.film.height) = ((HEIGHT * aspect).round() as u32, HEIGHT as u32);
        self.places.note("camera", (0, None));
        self.places.name("camera", self.named(&path));
        self.scene.camera = description;
        self.clips = Some(Clips { path, from: m.w_axis.truncate(), axis: -z, near, far });
        Ok(())
    }

    /// What a camera is said not to see, but does.
    fn check_clips(&mut self, clips: &Clips) {
        let depth = |i: usize| {
            let pick = |axis: usize| self.bounds[i >> axis & 1][axis];
            (DVec3::new(pick(0), pick(1), pick(2)) - clips.from).dot(clips.axis)
        };
        let (nearest, farthest) =
            (0..8).map(depth).fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), d| (lo.min(d), hi.max(d)));
        if farthest > f64::from(clips.far) {
            self.warn(&clips.path, "what is farther than its zfar is seen too");
        }
        if nearest < f64::from(clips.near) {
            self.warn(&clips.path, "what is nearer than its znear is seen too");
        }
    }

    /// Before the scene, so that all of it is seen.
    fn default_camera(&mut self) {
        self.warn("cameras", "there is no camera: one is put in front of everything");
        (self.scene.camera, [self.scene.film.width, self.scene.film.height]) = camera_before(self.bounds);
    }

    fn light(&mut self, number: u64, m: DMat4) -> Result<()> {
        let pointer = format!("/extensions/KHR_lights_punctual/lights/{number}");
        let path = format!("lights[{number}]");
        let Some(kind) = self.at(&format!("{pointer}/type")).and_then(Value::as_str).map(str::to_string) else {
            return Err(self.error(&path, "there is no such light, or it has no type"));
        };
        let color = self.numbers::<3>(&format!("{pointer}/color"))?.unwrap_or([1.0; 3]);
        let intensity = self.number(&format!("{pointer}/intensity"))?.unwrap_or(1.0);
        let color = Color(color.map(|c| c * intensity));
        if self.number(&format!("{pointer}/range"))?.is_some() {
            self.warn(&path, "its range, which says where light may be left out, is not heeded: it goes on for ever");
        }
        let axis = -m.z_axis.truncate().normalize_or_zero();
        let position = m.w_axis.truncate().as_vec3().to_array();
        let emitter = match kind.as_str() {
            "point" => EmitterDescription::Point { position, to_world: Transform::default(), intensity: color },
            "directional" => {
                EmitterDescription::Directional { direction: axis.as_vec3().to_array(), irradiance: color }
            }
            "spot" => {
                let outer =
                    self.number(&format!("{pointer}/spot/outerConeAngle"))?.unwrap_or(std::f32::consts::FRAC_PI_4);
                let inner = self.number(&format!("{pointer}/spot/innerConeAngle"))?.unwrap_or(0.0);
                self.warn(&path, "between its cones a spot's light falls off linearly with the angle");
                let (x, y) = axis.any_orthonormal_pair();
                let place = DMat4::from_cols(x.extend(0.0), y.extend(0.0), axis.extend(0.0), m.w_axis);
                EmitterDescription::Spot {
                    to_world: steps(place),
                    intensity: color,
                    cutoff_angle: outer.to_degrees(),
                    beam_width: Some(inner.to_degrees()),
                }
            }
            other => return self.unsupported(&path, format!("a light of type \"{other}\"")),
        };
        let part = format!("emitters[{}]", self.scene.emitters.len());
        self.places.note(part.clone(), (0, None));
        self.places.name(part, self.named(&path));
        self.scene.emitters.push(emitter);
        Ok(())
    }
}

/// A finite number of single precision.
fn single(value: &Value) -> Option<f32> {
    value.as_f64().map(|x| x as f32).filter(|x| x.is_finite())
}

/// A node's own transform.
fn local(node: &Node) -> DMat4 {
    if let Some(m) = node.matrix {
        return DMat4::from_cols_array(&m.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, rest: f64| v.map_or(DVec3::splat(rest), |v| DVec3::from(v.map(f64::from)));
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)).normalize());
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), rotation, vector(node.translation, 0.0))
}

/// A name that none of those has.
fn unused_name(name: &str, taken: impl Fn(&str) -> bool) -> String {
    free_name(if name.is_empty() { "material" } else { name }, "", taken)
}

#[cfg(test)]
mod tests;
