//! Scene files: TOML, or what another program wrote, to a [`Scene`], with every error at its place in the file.

use crate::document::Document;
use crate::error::{Error, Place};
use crate::gltf::read_gltf;
use crate::import::{Assets, ImportOptions, Imported, Places};
use crate::mitsuba::read_mitsuba;
use crate::pbrt::read_pbrt;
use crate::wavefront::read_obj_scene;
use crate::{from_toml, read_image, read_image_raw, read_measured, read_obj, read_ply, read_solution, write_ply};
use rebond::bsdf::check::Material;
use rebond::bsdf::measured::Measured;
use rebond::film::Image;
use rebond::integrators::IntegratorError;
use rebond::integrators::radiosity::Solution;
use rebond::scene::description::{MaterialRef, ShapeDescription};
use rebond::scene::{BuildError, MeshSource, Resources, Scene, SceneDescription, build, material};
use rebond::shape::MeshData;
use rebond::texture::Encoding;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A scene that is part of the program.
#[derive(Clone, Copy, Debug)]
pub struct BuiltIn {
    /// Its name.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! built_in {
    ($($name:literal),* $(,)?) => {
        &[$(BuiltIn { name: $name, text: include_str!(concat!("../../../scenes/", $name, ".toml")) }),*]
    };
}

/// The scenes that are part of the program.
pub const BUILT_IN_SCENES: &[BuiltIn] = built_in![
    "caustic-mirror",
    "cornell-box",
    "cornell-spheres",
    "dragon",
    "furnace",
    "glossy-spheres",
    "indirect-room",
    "many-lights",
    "material-gallery",
    "phong-300",
    "phong-300-blurred-light",
    "phong-60",
    "phong-60-blurred-light",
    "phong-lamp",
    "point-lights",
    "sky",
    "smallpt",
    "veach-bidir",
    "veach-mis",
];

/// The files that those scenes name.
const BUILT_IN_FILES: &[(&str, &[u8])] = &[
    ("backdrop.ply", include_bytes!("../../../scenes/backdrop.ply")),
    ("ball.ply", include_bytes!("../../../scenes/ball.ply")),
    ("checker.png", include_bytes!("../../../scenes/checker.png")),
    ("dragon.ply", include_bytes!("../../../scenes/dragon.ply")),
    ("hammered.png", include_bytes!("../../../scenes/hammered.png")),
    ("holes.png", include_bytes!("../../../scenes/holes.png")),
    ("lanterns-amber.ply", include_bytes!("../../../scenes/lanterns-amber.ply")),
    ("lanterns-azure.ply", include_bytes!("../../../scenes/lanterns-azure.ply")),
    ("lanterns-ivory.ply", include_bytes!("../../../scenes/lanterns-ivory.ply")),
    ("lanterns-jade.ply", include_bytes!("../../../scenes/lanterns-jade.ply")),
    ("lanterns-rose.ply", include_bytes!("../../../scenes/lanterns-rose.ply")),
    ("lanterns-violet.ply", include_bytes!("../../../scenes/lanterns-violet.ply")),
    ("pot.ply", include_bytes!("../../../scenes/pot.ply")),
    ("sky.hdr", include_bytes!("../../../scenes/sky.hdr")),
    ("weave.png", include_bytes!("../../../scenes/weave.png")),
    ("window.hdr", include_bytes!("../../../scenes/window.hdr")),
];

/// Where the files of a scene are.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneFiles {
    /// In this folder, and wherever absolute paths lead.
    Folder(PathBuf),
    /// Of an imported scene.
    Imported(Arc<Assets>),
    /// Part of the program.
    BuiltIn,
}

impl SceneFiles {
    pub(crate) fn read(&self, file: &str) -> Result<Vec<u8>, String> {
        match self {
            Self::BuiltIn => {
                let found = BUILT_IN_FILES.iter().find(|(name, _)| *name == file);
                found.map(|(_, bytes)| bytes.to_vec()).ok_or_else(|| format!("there is no built-in file \"{file}\""))
            }
            Self::Folder(folder) => {
                let path = folder.join(file);
                std::fs::read(&path).map_err(|e| format!("cannot read \"{}\": {e}", path.display()))
            }
            Self::Imported(assets) => assets.read(file),
        }
    }
}

impl SceneFiles {
    /// Tells a digest what a name stands for, if there is a file of that name, or an importer made one.
    fn digest(&self, name: &str, digest: &mut Sha256) -> Result<(), String> {
        let mut update = |bytes: &[u8]| {
            digest.update(bytes.len().to_le_bytes());
            digest.update(bytes);
        };
        match self {
            Self::Imported(assets) if assets.meshes.contains_key(name) => update(&write_ply(&assets.meshes[name])),
            Self::Imported(assets) if assets.images.contains_key(name) => {
                for channel in assets.images[name].layers.iter().flat_map(|layer| &layer.channels) {
                    update(&channel.data.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>());
                }
            }
            Self::BuiltIn if !BUILT_IN_FILES.iter().any(|(known, _)| *known == name) => {}
            Self::Folder(folder) if !folder.join(name).is_file() => {}
            Self::Imported(assets) if !assets.folder().join(name).is_file() => {}
            _ => update(&self.read(name)?),
        }
        Ok(())
    }

    /// The solution of radiosity in a file, for the scene that it is of; or what is wrong with it.
    pub fn solution(&self, file: &str, scene: &Scene) -> Result<Solution, String> {
        read_solution(&self.read(file)?, file, scene).map_err(|e| format!("\"{file}\": {}", e.message))
    }
}

impl Resources for SceneFiles {
    fn mesh(&self, file: &str, source: MeshSource) -> Result<MeshData, String> {
        if let Self::Imported(assets) = self
            && let Some(mesh) = assets.meshes.get(file)
        {
            return Ok(MeshData::clone(mesh));
        }
        let bytes = self.read(file)?;
        let mesh = match source {
            MeshSource::Obj => read_obj(&bytes, file),
            MeshSource::Ply => read_ply(&bytes, file),
        };
        mesh.map_err(|e| e.to_string())
    }

    fn image(&self, file: &str, encoding: Encoding) -> Result<Image, String> {
        if let Self::Imported(assets) = self
            && let Some(image) = assets.images.get(file)
        {
            return Ok(Image::clone(image));
        }
        let bytes = self.read(file)?;
        let image = match encoding {
            Encoding::Auto => read_image(&bytes, file),
            Encoding::Linear => read_image_raw(&bytes, file),
        };
        image.map_err(|e| format!("\"{file}\": {}", e.message))
    }

    fn measured(&self, file: &str) -> Result<Measured, String> {
        read_measured(&self.read(file)?, file).map_err(|e| format!("\"{file}\": {}", e.message))
    }
}

/// A scene as it was read: its description, and where that came from.
#[derive(Clone, Debug)]
pub struct SceneSource {
    /// What the text says. May be changed before it is built.
    pub description: SceneDescription,
    /// Short name: the built-in scene's, or the file's without its extension.
    pub name: String,
    /// What of another program's scene was left out, or is only nearly the same.
    pub warnings: Vec<Error>,
    /// Samples per pixel that the file asks for, if it does.
    pub samples: Option<u32>,
    origin: Origin,
    files: SceneFiles,
    path: Option<PathBuf>,
}

/// Where the parts of a description came from.
#[derive(Clone, Debug)]
enum Origin {
    Document(Box<Document>),
    Places(Places),
}

/// Elements that a lenient import leaves out because nothing can be built with them.
const MOST_LEFT_OUT: usize = 64;

/// What scene files end in.
const EXTENSIONS: &str = ".toml, or .xml (Mitsuba 3), .pbrt or .pbrt.gz (pbrt-v4), .gltf and .glb, .obj";

impl SceneSource {
    /// Reads a built-in scene by name, or a file by path; another program's strictly.
    pub fn open(scene: &str) -> Result<Self, Error> {
        Self::open_with(scene, ImportOptions::default())
    }

    /// Reads a built-in scene by name, or a file by path. Its format is known by its extension.
    pub fn open_with(scene: &str, options: ImportOptions) -> Result<Self, Error> {
        if let Some(b) = BUILT_IN_SCENES.iter().find(|b| b.name == scene) {
            return Self::parse(b.text, &format!("{scene}.toml (built in)"), scene, SceneFiles::BuiltIn);
        }
        let path = Path::new(scene);
        let names: Vec<&str> = BUILT_IN_SCENES.iter().map(|b| b.name).collect();
        let lower_case = |p: &Path| p.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let mut extension = lower_case(path);
        let inner = path.file_stem().map(Path::new);
        let packed = extension.as_deref() == Some("gz") && inner.and_then(lower_case).as_deref() == Some("pbrt");
        if packed {
            extension = Some("pbrt".into());
        }
        match extension.as_deref() {
            Some("toml" | "xml" | "pbrt" | "gltf" | "glb" | "obj") => {}
            Some(_) if path.exists() => {
                let error = Error::new(format!("cannot tell the format of \"{scene}\""));
                return Err(error.with_help(format!("scene files end in {EXTENSIONS}")));
            }
            _ => {
                let help = match crate::deserialize::nearest(scene, &names) {
                    Some(near) => {
                        format!("did you mean \"{near}\"? built-in scenes: {}; or give a .toml file", names.join(", "))
                    }
                    None => format!("built-in scenes: {}; or give a .toml file", names.join(", ")),
                };
                return Err(Error::new(format!("there is no scene \"{scene}\"")).with_help(help));
            }
        }
        let bytes = std::fs::read(path).map_err(|e| Error::new(format!("cannot read the scene \"{scene}\": {e}")))?;
        let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let bytes = match packed {
            true => crate::pbrt::unpack(&bytes).map_err(|m| Error::new(m).with_file(scene))?,
            false => bytes,
        };
        let name = if packed { inner.and_then(Path::file_stem) } else { path.file_stem() };
        let name = name.map_or_else(|| "scene".into(), |s| s.to_string_lossy().into_owned());
        let from = Some(path.to_path_buf());
        let imported = |scene: Imported| {
            let mut source = Self { path: from.clone(), ..Self::imported(scene, &name) };
            if options.lenient {
                source.leave_out();
            }
            source
        };
        if let Some("gltf" | "glb") = extension.as_deref() {
            return Ok(imported(read_gltf(&bytes, scene, &folder, options)?));
        }
        if let Some("obj") = extension.as_deref() {
            return Ok(Self { path: from, ..Self::imported(read_obj_scene(&bytes, scene, &folder, options)?, &name) });
        }
        let text = String::from_utf8(bytes).map_err(|e| not_text(e.as_bytes(), e.utf8_error().valid_up_to(), scene))?;
        match extension.as_deref() {
            Some("xml") => Ok(imported(read_mitsuba(&text, scene, &folder, options)?)),
            Some("pbrt") => Ok(imported(read_pbrt(&text, scene, &folder, options)?)),
            _ => Ok(Self { path: from, ..Self::parse(&text, scene, &name, SceneFiles::Folder(folder))? }),
        }
    }

    /// Reads a scene from its text; `file` is what errors call it.
    pub fn parse(text: &str, file: &str, name: &str, files: SceneFiles) -> Result<Self, Error> {
        let (description, document) = from_toml(text, file)?;
        let origin = Origin::Document(Box::new(document));
        Ok(Self { description, name: name.into(), warnings: Vec::new(), samples: None, origin, files, path: None })
    }

    /// Another program's scene.
    pub fn imported(scene: Imported, name: &str) -> Self {
        Self {
            description: scene.description,
            name: name.into(),
            warnings: scene.warnings,
            samples: scene.samples,
            origin: Origin::Places(scene.places),
            files: SceneFiles::Imported(Arc::new(scene.files)),
            path: None,
        }
    }

    /// Leaves out what the scene cannot be built with, with a warning for each: a shape's light, a shape, an emitter.
    fn leave_out(&mut self) {
        for _ in 0..MOST_LEFT_OUT {
            let Err(error) = build(&self.description, &self.files) else { return };
            let path = error.path.clone();
            let located = self.locate(error);
            let Origin::Places(places) = &mut self.origin else { return };
            // The element: up to the first bracket's end.
            let Some((list, i)) = path.split_once(']').and_then(|(element, _)| element.rsplit_once('[')) else {
                return;
            };
            let Ok(i) = i.parse::<usize>() else { return };
            let d = &mut self.description;
            let mut no_shapes = Vec::new();
            let shapes = match list {
                "shapes" => &mut d.shapes,
                _ => list.strip_prefix("groups.").and_then(|group| d.groups.get_mut(group)).unwrap_or(&mut no_shapes),
            };
            let mut what = "is left out";
            if list == "emitters" && i < d.emitters.len() {
                d.emitters.remove(i);
                places.remove(list, i);
            } else if i >= shapes.len() {
                return;
            } else if path.ends_with(".emission") && darken(&mut shapes[i]) {
                what = "does not shine";
            } else {
                shapes.remove(i);
                places.remove(list, i);
            }
            self.warnings.push(Error { message: format!("{}: it {what}", located.message), help: None, ..located });
        }
    }

    /// Builds the scene.
    pub fn build(&self) -> Result<Scene, Error> {
        build(&self.description, &self.files).map_err(|e| self.locate(e))
    }

    /// Why its own integrator cannot be made, with the place of that.
    pub fn refused(&self, error: IntegratorError) -> Error {
        let IntegratorError { message, help } = error;
        self.locate(BuildError { path: "integrator".into(), message, help: Some(help) })
    }

    /// One of the materials by itself, as its front looks.
    pub fn material(&self, name: &str) -> Result<Material, Error> {
        let reference = MaterialRef::Named(name.into());
        material(&self.description, &reference, &self.files).map_err(|e| match e.path.as_str() {
            // No place in the file named it.
            "material" => Error { help: e.help, ..Error::new(e.message) },
            _ => self.locate(e),
        })
    }

    /// A number that any change of the scene changes, or of the files that it names, or of this `salt`: SHA-256, in
    /// hexadecimal digits.
    pub fn digest(&self, salt: &str) -> Result<String, Error> {
        let description = serde_json::to_value(&self.description)
            .map_err(|e| Error::new(format!("cannot write the scene down: {e}")).with_file(&self.name))?;
        let mut digest = Sha256::new();
        digest.update(salt);
        digest.update(description.to_string());
        let mut left = vec![&description];
        while let Some(value) = left.pop() {
            match value {
                serde_json::Value::String(name) => self.files.digest(name, &mut digest).map_err(Error::new)?,
                serde_json::Value::Array(items) => left.extend(items),
                serde_json::Value::Object(entries) => left.extend(entries.values()),
                _ => {}
            }
        }
        Ok(digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// Where its files are.
    pub fn files(&self) -> &SceneFiles {
        &self.files
    }

    /// The file that it was read from, if it was.
    pub(crate) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    fn locate(&self, error: BuildError) -> Error {
        let at = match &self.origin {
            Origin::Document(document) => document.error_at(&error.path, error.message),
            Origin::Places(places) => places.error_at(&error.path, error.message),
        };
        Error { help: error.help, ..at }
    }
}

/// Takes a shape's light away; whether there was any.
fn darken(shape: &mut ShapeDescription) -> bool {
    use ShapeDescription as S;
    match shape {
        S::Mesh(s) => s.emission.take().is_some(),
        S::Obj(s) | S::Ply(s) => s.emission.take().is_some(),
        S::Sphere(s) => s.emission.take().is_some(),
        S::Rectangle(s) | S::Disk(s) | S::Cube(s) => s.emission.take().is_some(),
        S::Instance(_) => false,
    }
}

/// The error of a file that is text only up to its byte `valid`.
fn not_text(bytes: &[u8], valid: usize, file: &str) -> Error {
    let text = String::from_utf8_lossy(bytes);
    let line_start = text[..valid].rfind('\n').map_or(0, |i| i + 1);
    let column = text[line_start..valid].chars().count() + 1;
    // What is no text may be long, and may do anything to a terminal.
    let shown = text[line_start..].chars().take_while(|c| *c != '\n').take(column + 40);
    let source_line = shown.map(|c| if c.is_control() && c != '\t' { '\u{fffd}' } else { c }).collect();
    let place = Place { line: text[..valid].matches('\n').count() + 1, column, width: 1, source_line };
    let error = Error { place: Some(Box::new(place)), ..Error::new("not UTF-8 text") };
    error.with_file(file).with_help("save the scene as UTF-8")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lenient_imports_leave_out_what_cannot_be_built() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.xml");
        let text = r#"<scene version="3.0.0"><sensor type="perspective"/>
<shape type="sphere"><float name="radius" value="-1"/></shape>
<shape type="sphere"><float name="radius" value="3"/></shape>
<shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/></bsdf><emitter type="area"/></shape>
<emitter type="spot"><float name="cutoff_angle" value="500"/></emitter><emitter type="constant"/></scene>"#;
        std::fs::write(&path, text).expect("a file");
        let path = path.display().to_string();
        let strict = SceneSource::open(&path).and_then(|s| s.build().map(|_| ())).expect_err("a mistake");
        assert_eq!((strict.line(), &*strict.message), (Some(2), "a sphere of radius -1"));
        let source = SceneSource::open_with(&path, ImportOptions { lenient: true, ..ImportOptions::default() });
        let source = source.unwrap_or_else(|e| panic!("{}", e.snippet()));
        let warnings: Vec<_> = source.warnings.iter().map(|w| (w.line().unwrap_or(0), &*w.message)).collect();
        assert_eq!(warnings.len(), 3, "{warnings:?}");
        assert_eq!(warnings[0], (2, "a sphere of radius -1: it is left out"));
        assert!(warnings[1].0 == 4 && warnings[1].1.ends_with("it does not shine"), "{warnings:?}");
        assert!(warnings[2].0 == 5 && warnings[2].1.ends_with("it is left out"), "{warnings:?}");
        assert_eq!((source.description.shapes.len(), source.description.emitters.len()), (2, 1));
        source.build().unwrap_or_else(|e| panic!("{}", e.snippet()));
    }

    #[test]
    fn a_digest_knows_the_scene_and_its_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let ply = |x: &str| {
            let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n";
            std::fs::write(folder.path().join("m.ply"), format!("{head}{x} 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"))
                .expect("a mesh");
        };
        let digest = |fov: f32| {
            let text = format!(
                "[camera]\ntype = \"perspective\"\nfov = {fov}\n[[shapes]]\ntype = \"ply\"\nfile = \"m.ply\"\n"
            );
            let files = SceneFiles::Folder(folder.path().into());
            let source = SceneSource::parse(&text, "a.toml", "a", files).expect("a scene");
            source.digest("").expect("a digest")
        };
        ply("0");
        let first = digest(40.0);
        assert_eq!(first.len(), 64);
        assert_eq!(first, digest(40.0));
        assert_ne!(first, digest(41.0));
        ply("0.5");
        assert_ne!(first, digest(40.0));
        let built_in = |name: &str| SceneSource::open(name).expect(name).digest("").expect(name);
        assert_ne!(SceneSource::open("sky").expect("sky").digest("x").expect("a digest"), built_in("sky"));
        assert_ne!(built_in("dragon"), built_in("sky"));
    }
}
