//! Scenes of other programs: what all importers share.
//!
//! An importer reads a file and makes an [`Imported`] of it: a [`SceneDescription`], the meshes and images that it had to make,
//! and where everything came from. What rebond has no equal for is an error at its place, or, if the import is to be lenient, a
//! warning there.

use crate::document::{Span, place_of};
use crate::error::Error;
use glam::{DMat4, DVec3};
use rebond::film::Image;
use rebond::scene::SceneDescription;
use rebond::scene::description::{CameraDescription, FovAxis, ImageTexture, LookAt, Transform, TransformStep};
use rebond::shape::MeshData;
use rebond::texture::{Encoding, TextureFilter, UvMap, Wrap};
use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How strict an import is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportOptions {
    /// Leave out what cannot be had, with a warning, instead of giving up.
    pub lenient: bool,
    /// Open files outside of the scene's folder too.
    pub allow_outside: bool,
}

/// A scene of another program.
#[derive(Clone, Debug, Default)]
pub struct Imported {
    /// The scene.
    pub description: SceneDescription,
    /// Where its files are.
    pub files: Assets,
    /// What was left out, or is only nearly the same.
    pub warnings: Vec<Error>,
    /// Samples per pixel that the file asks for.
    pub samples: Option<u32>,
    /// Where the description's parts came from.
    pub places: Places,
}

/// Where the parts of a description came from: paths in the description, such as `shapes[3].material`, with their places.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// The files.
    sources: Sources,
    /// A file's number, and what of its text.
    parts: BTreeMap<String, Part>,
    /// What the file itself calls the parts, where it has no lines to speak of.
    names: BTreeMap<String, String>,
}

/// Files by name, with their texts.
pub(crate) type Sources = Vec<(String, Arc<str>)>;

/// The number of a file, and what of its text, if that is known.
pub(crate) type Part = (usize, Option<Span>);

impl Places {
    /// Notes where the part of that path came from.
    pub(crate) fn note(&mut self, path: impl Into<String>, part: Part) {
        self.parts.insert(path.into(), part);
    }

    /// Notes what the file calls the part of that path.
    pub(crate) fn name(&mut self, path: impl Into<String>, name: impl Into<String>) {
        self.names.insert(path.into(), name.into());
    }

    /// The same places, of these files.
    pub(crate) fn of(self, sources: Sources) -> Self {
        Self { sources, ..self }
    }

    /// Forgets element i of a list; those after it come one earlier.
    pub(crate) fn remove(&mut self, list: &str, i: usize) {
        let moved = |path: String| {
            let number =
                path.strip_prefix(list).and_then(|rest| rest.strip_prefix('[')).and_then(|rest| rest.split_once(']'));
            let Some((number, rest)) = number else { return Some(path) };
            match number.parse::<usize>() {
                Ok(n) if n == i => None,
                Ok(n) if n > i => Some(format!("{list}[{}]{rest}", n - 1)),
                _ => Some(path),
            }
        };
        let parts = std::mem::take(&mut self.parts);
        self.parts = parts.into_iter().filter_map(|(path, part)| moved(path).map(|path| (path, part))).collect();
        let names = std::mem::take(&mut self.names);
        self.names = names.into_iter().filter_map(|(path, name)| moved(path).map(|path| (path, name))).collect();
    }

    /// An error about the value of that path: at the place of the narrowest part known.
    pub fn error_at(&self, path: &str, message: impl Into<String>) -> Error {
        let ends = path.char_indices().filter(|(_, c)| matches!(c, '.' | '[')).map(|(i, _)| i);
        let mut prefixes: Vec<&str> = ends.map(|i| &path[..i]).collect();
        prefixes.push(path);
        let found = prefixes.iter().rev().find_map(|p| self.parts.get(*p));
        let message = message.into();
        let message = match prefixes.iter().rev().find_map(|p| self.names.get(*p)) {
            Some(name) => format!("{name}: {message}"),
            None => message,
        };
        let error = Error { path: path.to_string(), ..Error::new(message) };
        let Some((number, span)) = found else { return error };
        let Some((file, text)) = self.sources.get(*number) else { return error };
        let place = span.clone().map(|span| Box::new(place_of(text, span)));
        Error { file: Some(file.clone()), place, ..error }
    }
}

/// The warnings of an import, and whether what is missing is one of them or the end.
#[derive(Debug, Default)]
pub(crate) struct Report {
    pub lenient: bool,
    pub warnings: Vec<Error>,
    /// Hashes of those.
    pub known: HashSet<u64>,
}

impl Report {
    /// Something that rebond has no equal for.
    pub fn unsupported(&mut self, error: Error) -> Result<(), Error> {
        if !self.lenient {
            let help = error.help.clone().map_or_else(String::new, |h| format!("{h}; "));
            return Err(error.with_help(format!("{help}--lenient goes on without")));
        }
        self.warn(error);
        Ok(())
    }

    /// Something that is not quite the same.
    pub fn warn(&mut self, error: Error) {
        let mut hasher = DefaultHasher::new();
        (&error.file, &error.path, &error.message, error.line(), error.column()).hash(&mut hasher);
        if self.known.insert(hasher.finish()) {
            self.warnings.push(error);
        }
    }
}

/// Pixels of images that an importer makes of others.
const MOST_PIXELS: u64 = 1 << 26;

/// Files of an imported scene: those of its folder, and what its importer made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Assets {
    folder: PathBuf,
    allow_outside: bool,
    /// Meshes by the names that the description calls them.
    pub meshes: BTreeMap<String, Arc<MeshData>>,
    /// Images likewise.
    pub images: BTreeMap<String, Arc<Image>>,
}

impl Assets {
    /// Of a scene in that folder.
    pub fn new(folder: &Path, options: ImportOptions) -> Self {
        Self { folder: folder.to_path_buf(), allow_outside: options.allow_outside, ..Self::default() }
    }

    /// The folder that names of files are relative to.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The contents of a file, unless it lies outside of the scene's folder and that is not allowed.
    pub fn read(&self, file: &str) -> Result<Vec<u8>, String> {
        let path = self.path(file)?;
        std::fs::read(&path).map_err(|e| format!("cannot read \"{}\": {e}", path.display()))
    }

    /// Where a file is, if it may be opened: `..` and links are followed before that is decided.
    pub fn path(&self, file: &str) -> Result<PathBuf, String> {
        let path = self.folder.join(file);
        let whole = |p: &Path| p.canonicalize().map_err(|e| format!("cannot read \"{}\": {e}", path.display()));
        let here = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        if !self.allow_outside && !whole(&path)?.starts_with(whole(here)?) {
            return Err(format!("\"{file}\" is outside of the scene's folder; --allow-outside opens it"));
        }
        Ok(path)
    }

    /// Keeps a mesh under a name that no other has, and returns that: `name.ply`.
    pub(crate) fn add_mesh(&mut self, name: &str, mesh: MeshData) -> String {
        let free = free_name(name, ".ply", |n| self.meshes.contains_key(n) || self.folder.join(n).exists());
        self.meshes.insert(free.clone(), Arc::new(mesh));
        free
    }

    /// Whether one more image of so many pixels may be made.
    pub(crate) fn has_room_for(&self, width: u32, height: u32) -> Result<(), String> {
        let pixels = |width: u32, height: u32| u64::from(width) * u64::from(height);
        let made: u64 = self.images.values().map(|i| pixels(i.width, i.height)).sum();
        match made + pixels(width, height) <= MOST_PIXELS {
            true => Ok(()),
            false => Err(format!("images in so many colours have more than {MOST_PIXELS} pixels")),
        }
    }

    /// The same for an image: `name.exr`.
    pub(crate) fn add_image(&mut self, name: &str, image: Image) -> String {
        let same = self.images.iter().find(|(_, known)| ***known == image);
        if let Some((known, _)) = same {
            return known.clone();
        }
        let free = free_name(name, ".exr", |n| self.images.contains_key(n) || self.folder.join(n).exists());
        self.images.insert(free.clone(), Arc::new(image));
        free
    }
}

/// The transform of one matrix; none if it does nothing.
pub(crate) fn steps(m: DMat4) -> Transform {
    if m == DMat4::IDENTITY {
        return Transform::default();
    }
    let rows = [0, 1, 2].map(|i| m.row(i).as_vec4().to_array());
    Transform(vec![TransformStep { matrix: Some(rows.to_vec()), ..TransformStep::default() }])
}

/// The side of a picture along which a field of view is measured.
pub(crate) fn side(axis: FovAxis, [width, height]: [f64; 2]) -> f64 {
    match axis {
        FovAxis::X => width,
        FovAxis::Y => height,
        FovAxis::Smaller => width.min(height),
        FovAxis::Larger => width.max(height),
    }
}

/// The field of view of `length`, degrees, if that of `side` is this. What is none stays as it is, for the scene to refuse.
pub(crate) fn field_of(length: f64, fov: f32, side: f64) -> f32 {
    if !(fov > 0.0 && fov < 180.0) {
        return fov;
    }
    let half = (f64::from(fov).to_radians() / 2.0).tan() * length / side;
    (2.0 * half.atan()).to_degrees() as f32
}

/// Whether a transform keeps angles: it turns, mirrors, moves and scales alike along all axes.
pub(crate) fn even(m: DMat4) -> bool {
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.truncate());
    let size = axes[0].length_squared();
    (0..3).all(|i| (0..3).all(|j| (axes[i].dot(axes[j]) - if i == j { size } else { 0.0 }).abs() <= 1e-6 * size))
}

/// Cuts what a camera sees in a picture of `full` pixels down to the part of it from (x, y) on, of w by h pixels: that becomes the picture.
pub(crate) fn cut(camera: &mut CameraDescription, full: [u32; 2], [x, y, w, h]: [u32; 4]) {
    let [width, height] = full.map(f64::from);
    let [x, y, w, h] = [x, y, w, h].map(f64::from);
    // From the middle of the whole to that of the part, in pixels to the right and down.
    let (right, down) = (x + (w - width) / 2.0, y + (h - height) / 2.0);
    match camera {
        CameraDescription::Perspective { fov, fov_axis, principal_point_offset, .. }
        | CameraDescription::ThinLens { fov, fov_axis, principal_point_offset, .. } => {
            *fov = field_of(w, *fov, side(*fov_axis, [width, height]));
            *fov_axis = FovAxis::X;
            let [across, along] = principal_point_offset.map(f64::from);
            *principal_point_offset = [((across * width + right) / w) as f32, ((along * height + down) / h) as f32];
        }
        CameraDescription::Orthographic { to_world, .. } => {
            let scale = DMat4::from_scale(DVec3::new(w / width, w / width, 1.0));
            let moved = DMat4::from_translation(DVec3::new(-right, -down, 0.0) * 2.0 / width);
            to_world.0.splice(0..0, steps(moved * scale).0);
        }
    }
}

/// The box around points; those that are not finite do not count.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a [f32; 3]>) -> [DVec3; 2] {
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |b, p| {
        let p = DVec3::from(p.map(f64::from));
        if p.is_finite() { [b[0].min(p), b[1].max(p)] } else { b }
    })
}

/// A camera from which all of a box is seen, from the front and a little above, and its film's size.
pub(crate) fn camera_before([lo, hi]: [DVec3; 2]) -> (CameraDescription, [u32; 2]) {
    let (center, radius) =
        if lo.is_finite() && hi.is_finite() { ((lo + hi) / 2.0, (hi - lo).length() / 2.0) } else { (DVec3::ZERO, 1.0) };
    let radius = radius.max(1e-6);
    let distance = 1.05 * radius / 20.0_f64.to_radians().sin();
    let origin = center + DVec3::new(0.3, 0.25, 1.0).normalize() * distance;
    let vector = |v: DVec3| v.as_vec3().to_array();
    let look_at = LookAt { origin: vector(origin), target: vector(center), up: [0.0, 1.0, 0.0] };
    let camera = CameraDescription::Perspective {
        to_world: Transform(vec![TransformStep { look_at: Some(look_at), ..TransformStep::default() }]),
        fov: 40.0,
        fov_axis: FovAxis::Smaller,
        principal_point_offset: [0.0; 2],
        near_clip: 0.0,
        shutter_open: 0.0,
        shutter_close: 0.0,
    };
    (camera, [960, 540])
}

/// Sides of the prism that stands for a cylinder: its area is off by a ten-thousandth.
pub(crate) const SIDES: u32 = 256;

/// The mantle of the cylinder of radius 1 from z = 0 to 1: u goes around it, v up.
pub(crate) fn tube() -> MeshData {
    let mut mesh = MeshData { normals: Some(Vec::new()), uvs: Some(Vec::new()), ..MeshData::default() };
    for i in 0..=SIDES {
        let u = i as f32 / SIDES as f32;
        let (sin, cos) = (f64::from(i % SIDES) * std::f64::consts::TAU / f64::from(SIDES)).sin_cos();
        for z in [0.0, 1.0] {
            mesh.positions.push([cos as f32, sin as f32, z]);
            mesh.normals.get_or_insert_default().push([cos as f32, sin as f32, 0.0]);
            mesh.uvs.get_or_insert_default().push([u, z]);
        }
    }
    mesh.triangles = (0..SIDES).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect();
    mesh
}

/// An image whose texels are squares, again and again: of checkerboards.
pub fn squares(image: String, to_uv: UvMap) -> ImageTexture {
    ImageTexture {
        image,
        encoding: Encoding::Linear,
        wrap: Wrap::Repeat,
        wrap_v: None,
        filter: TextureFilter::Nearest,
        repeat: [1.0; 2],
        to_uv: Some(to_uv),
        channel: None,
    }
}

/// `name` itself, or with a number, so that `taken` does not hold. It is asked about few of many names: twice as far each time until
/// one is free, then halfway between that and one that is not.
pub(crate) fn free_name(name: &str, extension: &str, taken: impl Fn(&str) -> bool) -> String {
    let plain: String = name.chars().map(|c| if c.is_alphanumeric() || "-_ ".contains(c) { c } else { '-' }).collect();
    let numbered = |i: u64| if i == 1 { format!("{plain}{extension}") } else { format!("{plain}-{i}{extension}") };
    let (mut last, mut free) = (0, 1);
    while taken(&numbered(free)) {
        (last, free) = (free, free * 2);
    }
    while free - last > 1 {
        let middle = last + (free - last) / 2;
        *(if taken(&numbered(middle)) { &mut last } else { &mut free }) = middle;
    }
    numbered(free)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_tube_is_round_and_faces_outwards() {
        let mesh = tube();
        let mut area = 0.0;
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| Vec3::from(mesh.positions[i as usize]));
            let n = (b - a).cross(c - a);
            assert!(n.dot(Vec3::new(a.x + b.x + c.x, a.y + b.y + c.y, 0.0)) > 0.0);
            area += f64::from(n.length()) / 2.0;
        }
        assert!((area / std::f64::consts::TAU - 1.0).abs() < 1e-4, "{area}");
    }

    /// The rays of a part are those of the whole, through whatever camera.
    #[test]
    fn parts_of_pictures_are_cut_from_the_whole() {
        use crate::scene::SceneSource;
        let cameras = [
            "type = \"perspective\"\nfov = 50\nfov_axis = \"larger\"\nprincipal_point_offset = [0.3, -0.2]",
            "type = \"perspective\"\nfov = 50\nfov_axis = \"smaller\"",
            "type = \"thin-lens\"\nfov = 50\nfov_axis = \"y\"\naperture_radius = 0.2\nfocus_distance = 3",
            "type = \"orthographic\"",
        ];
        let ([width, height], part) = ([40, 30], [7, 3, 20, 24]);
        for camera in cameras {
            let text = format!(
                "film = {{ width = {width}, height = {height} }}\n[camera]\n{camera}\nto_world = {{ translate = [1, 2, 3] }}\n"
            );
            let mut source = SceneSource::parse(&text, "a", "a", crate::SceneFiles::BuiltIn).expect("a scene");
            let whole = source.build().expect("a scene");
            cut(&mut source.description.camera, [width, height], part);
            (source.description.film.width, source.description.film.height) = (part[2], part[3]);
            let cut = source.build().expect("a scene");
            for [x, y] in [[0.0_f32, 0.0], [3.5, 20.0], [20.0, 24.0]] {
                let a = whole.camera().ray([x + 7.0, y + 3.0], [0.3, 0.7], 0.0);
                let b = cut.camera().ray([x, y], [0.3, 0.7], 0.0);
                assert!((a.o - b.o).length() < 1e-5 && (a.d - b.d).length() < 1e-6, "{camera}: {a:?} for {b:?}");
            }
        }
    }

    #[test]
    fn free_names_count_up_and_are_found_fast() {
        let (mut names, asked) = (std::collections::BTreeSet::new(), std::cell::Cell::new(0));
        for i in 1..=1000 {
            let taken = |n: &str| {
                asked.set(asked.get() + 1);
                names.contains(n)
            };
            let name = free_name("a/b", ".ply", taken);
            assert_eq!(name, if i == 1 { "a-b.ply".into() } else { format!("a-b-{i}.ply") });
            names.insert(name);
        }
        assert!(asked.get() <= 1000 * 20, "{}", asked.get());
    }

    #[test]
    fn errors_are_at_the_narrowest_part_known() {
        let mut places = Places::default().of(vec![("a.xml".into(), "1\n2\n3\n4\n5\n".into())]);
        for (path, line) in [("shapes[1]", 3), ("shapes[1].material", 4), ("materials.a b", 5)] {
            let start = 2 * (line - 1);
            places.note(path, (0, Some(start..start + 1)));
        }
        let line = |path: &str| places.error_at(path, "no").line();
        assert_eq!(line("shapes[1].to_world[2]"), Some(3));
        assert_eq!(line("shapes[1].material.opacity.image"), Some(4));
        assert_eq!(line("materials.a b.alpha"), Some(5));
        assert_eq!(line("shapes[2]"), None);
        places.name("shapes[1]", "the third cube");
        assert_eq!(places.error_at("shapes[1].material", "no").message, "the third cube: no");
        assert_eq!(places.error_at("shapes[2].material", "no").message, "no");
        places.remove("shapes", 0);
        assert_eq!(places.error_at("shapes[0].material", "no").message, "the third cube: no");
        let line = |path: &str| places.error_at(path, "no").line();
        assert_eq!((line("shapes[0].material"), line("shapes[1]"), line("materials.a b")), (Some(4), None, Some(5)));
        places.remove("shapes", 0);
        assert_eq!(places.error_at("shapes[0]", "no").line(), None);
        assert_eq!(places.error_at("shapes[0]", "no").message, "no");
    }

    #[test]
    fn many_warnings_are_told_apart_fast() {
        let mut report = Report { lenient: true, ..Report::default() };
        for i in 0..100_000 {
            report.warn(Error::new(format!("warning {}", i / 2)));
        }
        assert_eq!(report.warnings.len(), 50_000);
        report.unsupported(Error::new("warning 7")).expect("a warning");
        assert_eq!(report.warnings.len(), 50_000);
    }
}
