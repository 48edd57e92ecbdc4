//! Wavefront OBJ as a scene: a mesh for each material, and the materials of its libraries (MTL).
//!
//! | OBJ | rebond |
//! |---|---|
//! | surfaces, seen from both sides | two-sided materials; they shine (`Ke`) to the side of their normals |
//! | no camera | one in front of everything |
//! | no lights | an even sky, if nothing shines |
//!
//! What the numbers of a material become is told in `materials.rs`.

mod library;
mod materials;

use crate::error::Error;
use crate::import::{Assets, ImportOptions, Imported, Places, Report, bounds, camera_before};
use crate::meshes::{Named, read_obj_parts};
use library::Material;
use rebond::scene::SceneDescription;
use rebond::scene::description::{
    Color, EmitterDescription, MaterialDescription, MaterialRef, MeshFile, ShapeDescription, Texture, Transform,
};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads a scene; `file` is what errors call it, `folder` where its files are.
pub fn read_obj_scene(bytes: &[u8], file: &str, folder: &Path, options: ImportOptions) -> Result<Imported, Error> {
    let parts = read_obj_parts(bytes, file)?;
    let mut importer = Importer {
        assets: Assets::new(folder, options),
        report: Report { lenient: options.lenient, ..Report::default() },
        library: BTreeMap::new(),
        tinted: BTreeMap::new(),
    };
    let at = |named: &Named, message: String| Error {
        place: Some(Box::new(named.place.clone())),
        ..Error::new(message).with_file(file)
    };
    for named in &parts.libraries {
        importer.open(named).map_err(|m| at(named, m)).or_else(|e| importer.report.unsupported(e))?;
    }
    let mut scene = SceneDescription::default();
    let mut places = Places::default();
    let whole = bounds(parts.parts.iter().flat_map(|(_, mesh)| &mesh.positions));
    let stem = Path::new(file).file_stem().map_or("mesh".into(), |s| s.to_string_lossy().into_owned());
    for (named, mesh) in parts.parts {
        let (name, emission) = match &named {
            None => ("default".to_string(), None),
            Some(named) => match importer.library.get(&named.name).cloned() {
                Some(material) => (named.name.clone(), importer.emission(&material)?),
                None => {
                    let error = at(named, format!("there is no material \"{}\" in its libraries", named.name));
                    importer.report.unsupported(error.with_help("a material is declared by `newmtl` in a `mtllib`"))?;
                    ("default".to_string(), None)
                }
            },
        };
        if !scene.materials.contains_key(&name) {
            let description = match importer.library.get(&name).cloned() {
                Some(material) => importer.describe(&material)?,
                None => two_sided(MaterialDescription::Diffuse { reflectance: Texture::grey(0.5) }),
            };
            let label = format!("the material \"{name}\"");
            places.note(format!("materials.{name}"), (0, None));
            places.name(format!("materials.{name}"), label);
            scene.materials.insert(name.clone(), description);
        }
        let label = format!("the faces of the material \"{name}\"");
        let path = format!("shapes[{}]", scene.shapes.len());
        places.note(path.clone(), (0, None));
        places.name(path, label);
        scene.shapes.push(ShapeDescription::Ply(MeshFile {
            file: importer.assets.add_mesh(&format!("{stem}-{name}"), mesh),
            face_normals: false,
            smooth_normals: false,
            flip_normals: false,
            material: Some(MaterialRef::Named(name)),
            emission,
            to_world: Transform::default(),
        }));
    }
    (scene.camera, [scene.film.width, scene.film.height]) = camera_before(whole);
    let shines = |s: &ShapeDescription| matches!(s, ShapeDescription::Ply(m) if m.emission.is_some());
    if !scene.shapes.iter().any(shines) {
        importer.report.warn(Error::new("nothing shines: an even sky of radiance 1 lights it").with_file(file));
        scene.emitters.push(EmitterDescription::Constant { radiance: Color([1.0; 3]) });
    }
    Ok(Imported {
        description: scene,
        files: importer.assets,
        warnings: importer.report.warnings,
        samples: None,
        places: places.of(vec![(file.to_string(), "".into())]),
    })
}

struct Importer {
    assets: Assets,
    report: Report,
    library: BTreeMap<String, Material>,
    /// Images times colours, by what they are of.
    tinted: BTreeMap<(String, bool, [u32; 3]), String>,
}

impl Importer {
    /// Reads the libraries that a line names: one whose name may have spaces in it, or several.
    fn open(&mut self, named: &Named) -> Result<(), String> {
        let whole = named.name.replace('\\', "/");
        let names: Vec<&str> = match self.assets.path(&whole) {
            Ok(_) => vec![&whole],
            Err(_) => whole.split_whitespace().collect(),
        };
        for name in names {
            let bytes = self.assets.read(name)?;
            for material in library::read(&String::from_utf8_lossy(&bytes), name) {
                // The first of a name counts.
                self.library.entry(material.name.clone()).or_insert(material);
            }
        }
        Ok(())
    }
}

/// The same from both sides.
fn two_sided(front: MaterialDescription) -> MaterialDescription {
    MaterialDescription::TwoSided { front: MaterialRef::Inline(Box::new(front)), back: None }
}

#[cfg(test)]
mod tests;
