//! Shapes.

use super::textures::Lie;
use super::{Importer, Object, Result, Spot, Use, color};
use crate::import::{SIDES, free_name, steps, tube};
use glam::{DMat4, DVec3};
use rebond::scene::description::{
    Color, EmitterDescription, ImageTexture, InstanceDescription, MaterialDescription, MaterialRef, Mesh, MeshFile,
    NumberTexture, Outline, ShapeDescription, Simple, Sphere, Texture,
};
use std::f64::consts::{FRAC_PI_2, PI};
use std::rc::Rc;

/// What any shape has.
struct Common {
    material: Option<MaterialRef>,
    emission: Option<Color>,
    matrix: DMat4,
}

/// How a shape shines.
enum Shine {
    Evenly(Color),
    Image(ImageTexture),
}

impl Importer {
    /// A shape of the scene.
    pub fn top_shape(&mut self, o: &Rc<Object>) -> Result<()> {
        match o.plugin.as_str() {
            // Translated where it is placed.
            "shapegroup" => Ok(()),
            "instance" => {
                let Some((group, at)) = self.children(o, &["shape"])?.into_iter().next() else {
                    return Err(self.error(&o.at, "an instance without a shape group"));
                };
                if group.plugin != "shapegroup" {
                    return Err(self.error(&at, "an instance is of a shapegroup"));
                }
                let group = self.group(&group)?;
                let to_world = steps(self.transform(o)?);
                self.finish(o)?;
                self.push(o, ShapeDescription::Instance(InstanceDescription { group, to_world }));
                Ok(())
            }
            "merge" => {
                for (inner, at) in self.children(o, &["shape"])? {
                    self.within(&inner, &at, |me| me.top_shape(&inner))?;
                }
                self.finish(o)
            }
            _ => {
                if let Some(shape) = self.shape(o)? {
                    self.push(o, shape);
                }
                Ok(())
            }
        }
    }

    fn push(&mut self, o: &Object, shape: ShapeDescription) {
        let path = format!("shapes[{}]", self.scene.shapes.len());
        self.note_shape(o, &path);
        self.scene.shapes.push(shape);
    }

    fn note_shape(&mut self, o: &Object, path: &str) {
        self.places.note(path, o.at.part());
        let parts = [("bsdf", "material"), ("emitter", "emission"), ("emitter", "material.radiance")];
        for (tag, key) in parts {
            if let Ok(children) = self.children(o, &[tag])
                && let Some((child, _)) = children.first()
            {
                self.places.note(format!("{path}.{key}"), child.at.part());
            }
        }
    }

    /// The name of a shape group, which is translated once.
    fn group(&mut self, o: &Rc<Object>) -> Result<String> {
        let address = Rc::as_ptr(o) as usize;
        if let Some(name) = self.groups.get(&address) {
            return Ok(name.clone());
        }
        let name = o.id.clone().unwrap_or_else(|| "group".into());
        let name = free_name(&name, "", |n| self.scene.groups.contains_key(n));
        self.groups.insert(address, name.clone());
        let mut shapes = Vec::new();
        for (inner, at) in self.children(o, &["shape"])? {
            if inner.plugin == "instance" {
                self.unsupported(&at, "an instance within a shape group")?;
                continue;
            }
            let lights = self.scene.emitters.len();
            if let Some(shape) = self.shape(&inner)? {
                if self.scene.emitters.len() > lights {
                    self.scene.emitters.truncate(lights);
                    self.unsupported(&at, "a \"directionalarea\" within a shape group")?;
                }
                self.note_shape(&inner, &format!("groups.{name}[{}]", shapes.len()));
                shapes.push(shape);
            }
        }
        if o.has("to_world") {
            self.unsupported(&o.at, "a transform of a shape group: only its instances are placed")?;
            self.passed_over(o, &["to_world"]);
        }
        self.finish(o)?;
        self.scene.groups.insert(name.clone(), shapes);
        Ok(name)
    }

    fn shape(&mut self, o: &Rc<Object>) -> Result<Option<ShapeDescription>> {
        let shape = match o.plugin.as_str() {
            "sphere" => {
                let c = self.common(o, Lie::Flipped)?;
                let center = self.vector(o, "center")?.unwrap_or(DVec3::ZERO);
                let radius = self.number_or(o, "radius", 1.0)?;
                // Mirrored, a sphere of Mitsuba's is turned inside out.
                let flip_normals = self.flag(o, "flip_normals", false)? != (c.matrix.determinant() < 0.0);
                ShapeDescription::Sphere(Sphere {
                    center: center.as_vec3().to_array(),
                    radius,
                    flip_normals,
                    material: c.material,
                    emission: c.emission,
                    to_world: steps(c.matrix),
                })
            }
            "rectangle" => ShapeDescription::Rectangle(self.simple(o, Lie::Same)?),
            "disk" => ShapeDescription::Disk(self.simple(o, Lie::Swapped)?),
            "cube" => {
                // Mitsuba's are mirrored, but its maps of normals take no notice.
                let simple = self.simple(o, Lie::Flipped)?;
                match &simple.material {
                    Some(m) if self.wears_images(m) => ShapeDescription::Mesh(cube(simple)),
                    _ => ShapeDescription::Cube(simple),
                }
            }
            "cylinder" => self.cylinder(o)?,
            "obj" => {
                let flipped = self.flag(o, "flip_tex_coords", true)?;
                ShapeDescription::Obj(self.mesh_file(o, flipped)?)
            }
            "ply" => {
                let flipped = self.flag(o, "flip_tex_coords", false)?;
                ShapeDescription::Ply(self.mesh_file(o, flipped)?)
            }
            "serialized" => self.serialized(o)?,
            _ => {
                self.unknown_plugin(o)?;
                return Ok(None);
            }
        };
        self.finish(o)?;
        Ok(Some(shape))
    }

    fn common(&mut self, o: &Object, lie: Lie) -> Result<Common> {
        // Where a lamp may show an image: rebond's spheres and disks do not.
        let image_lie = (!matches!(o.plugin.as_str(), "sphere" | "disk")).then_some(lie);
        let emitters = self.children(o, &["emitter"])?;
        let mut beams = false;
        let shine = match &emitters[..] {
            [] => None,
            [(emitter, at)] if emitter.plugin == "directionalarea" => {
                beams = self.beams(o, emitter, at)?;
                None
            }
            [(emitter, at)] => self.shine(emitter, at, image_lie)?,
            _ => return Err(self.error(&o.at, "a shape with several emitters")),
        };
        let inline = |m| MaterialRef::Inline(Box::new(m));
        let material = match &self.children(o, &["bsdf"])?[..] {
            // What shines and is of no material reflects nothing.
            [] => (beams || shine.is_some())
                .then(|| inline(MaterialDescription::Diffuse { reflectance: Texture::grey(0.0) })),
            [(bsdf, at)] => Some(self.material(bsdf, at, lie)?),
            _ => return Err(self.error(&o.at, "a shape with several BSDFs")),
        };
        let (material, emission) = match (shine, material) {
            (Some(Shine::Image(radiance)), Some(material)) => {
                let scale = Color([1.0; 3]);
                (Some(inline(MaterialDescription::Glow { radiance, scale, material })), None)
            }
            (Some(Shine::Evenly(emission)), material) => (material, Some(emission)),
            (_, material) => (material, None),
        };
        for (child, at) in self.children(o, &["medium", "sensor"])? {
            self.unsupported(&at, format!("a {} of a shape", child.tag))?;
        }
        self.passed_over(o, &["silhouette_sampling_weight"]);
        Ok(Common { material, emission, matrix: self.transform(o)? })
    }

    /// Adds the lights of a shape whose points shine along their normals; false if it is of another kind than those that can.
    fn beams(&mut self, o: &Object, emitter: &Rc<Object>, at: &Spot) -> Result<bool> {
        self.passed_over(emitter, &["sampling_weight"]);
        let irradiance = self.light(emitter, "radiance")?;
        self.finish(emitter)?;
        let inwards = if self.flag(o, "flip_normals", false)? { -1.0 } else { 1.0 };
        let side = |turn: DMat4, at: f64| turn * DMat4::from_translation(DVec3::Z * at);
        let sides = match o.plugin.as_str() {
            "rectangle" | "disk" => vec![DMat4::IDENTITY],
            "cube" => {
                let turns = [DMat4::from_rotation_x, DMat4::from_rotation_y];
                let quarters = [-1.0, 1.0].map(|quarter: f64| quarter * FRAC_PI_2);
                let four = turns.into_iter().flat_map(|turn| quarters.map(|angle| side(turn(angle), 1.0)));
                four.chain([side(DMat4::IDENTITY, 1.0), side(DMat4::from_rotation_x(PI), 1.0)]).collect()
            }
            _ => {
                let message = "a \"directionalarea\" of anything but a rectangle, a disk or a cube";
                self.unsupported(at, message)?;
                return Ok(false);
            }
        };
        let m = self.transform(o)?;
        let shape = if o.plugin == "disk" { Outline::Disk } else { Outline::Rectangle };
        for side in sides {
            let to_world = steps(m * side * DMat4::from_scale(DVec3::new(1.0, 1.0, inwards)));
            self.places.note(format!("emitters[{}]", self.scene.emitters.len()), at.part());
            self.scene.emitters.push(EmitterDescription::DirectionalArea { to_world, shape, irradiance });
        }
        Ok(true)
    }

    /// The radiance of an area light, which may be an image if it is said how that lies.
    fn shine(&mut self, o: &Rc<Object>, at: &Spot, image_lie: Option<Lie>) -> Result<Option<Shine>> {
        if o.plugin != "area" {
            let error = self.error(at, format!("the emitter \"{}\" of a shape is not supported", o.plugin));
            self.report.unsupported(error)?;
            return Ok(None);
        }
        self.passed_over(o, &["sampling_weight"]);
        let texture = o.get("radiance").map(|p| self.object(p)).transpose()?.flatten();
        let shine = match (texture.filter(|t| t.plugin == "bitmap"), image_lie) {
            (Some(texture), Some(lie)) => Shine::Image(self.bitmap(&texture, lie, true)?),
            _ => Shine::Evenly(self.light(o, "radiance")?),
        };
        self.finish(o)?;
        Ok(Some(shine))
    }

    /// What an emitter sends out, which must be the same everywhere.
    pub fn light(&mut self, o: &Object, name: &str) -> Result<Color> {
        let Some(p) = o.get(name) else { return Ok(Color([1.0; 3])) };
        if let Some(c) = self.color(p, Use::Light)? {
            return Ok(color(c));
        }
        let Some(texture) = self.object(p)? else { return self.wrong(p, "a colour") };
        self.unsupported(&p.at, format!("a {} for the \"{name}\" of a light: its mean is", texture.plugin))?;
        Ok(Color(self.mean(&texture)?.unwrap_or([1.0; 3])))
    }

    fn simple(&mut self, o: &Object, lie: Lie) -> Result<Simple> {
        let c = self.common(o, lie)?;
        let flip_normals = self.flag(o, "flip_normals", false)?;
        Ok(Simple { flip_normals, material: c.material, emission: c.emission, to_world: steps(c.matrix) })
    }

    fn mesh_file(&mut self, o: &Object, flipped: bool) -> Result<MeshFile> {
        let Some((file, at)) = self.text(o, "filename")? else {
            return Err(self.error(&o.at, "the filename is missing"));
        };
        let file = self.find(&file, &at)?;
        let [normals, uvs] = self.normals_and_uvs(&file, &at)?;
        // Those that triangles have by themselves are the same.
        let c = self.common(o, if flipped && uvs { Lie::Flipped } else { Lie::Same })?;
        self.placed(o, c, file, normals)
    }

    /// A mesh in a file that has normals or has none.
    fn placed(&mut self, o: &Object, c: Common, file: String, normals: bool) -> Result<MeshFile> {
        let face_normals = self.flag(o, "face_normals", false)?;
        let flip = self.flag(o, "flip_normals", false)?;
        // Mirrored, Mitsuba's meshes are turned inside out, but for those that bring normals.
        let inside_out = c.matrix.determinant() < 0.0 && (face_normals || !normals);
        Ok(MeshFile {
            file,
            face_normals,
            smooth_normals: !face_normals,
            flip_normals: flip != inside_out,
            material: c.material,
            emission: c.emission,
            to_world: steps(c.matrix),
        })
    }

    /// Whether an OBJ or PLY file has normals, and texture coordinates.
    fn normals_and_uvs(&self, file: &str, at: &Spot) -> Result<[bool; 2]> {
        let bytes = self.assets.read(file).map_err(|m| self.error(at, m))?;
        let is_ply = bytes.starts_with(b"ply");
        let mut found = [false; 2];
        for line in bytes.split(|b| *b == b'\n').map(|l| l.trim_ascii()) {
            if is_ply && line == b"end_header" {
                break;
            }
            let mut words = line.split(|b| b.is_ascii_whitespace()).filter(|w| !w.is_empty());
            let word = if !is_ply {
                words.next()
            } else if line.starts_with(b"property") {
                words.next_back()
            } else {
                None
            };
            match word {
                Some(b"vn" | b"nx") => found[0] = true,
                Some(b"vt" | b"u" | b"s" | b"texture_u" | b"texture_s") => found[1] = true,
                _ => {}
            }
        }
        Ok(found)
    }

    fn serialized(&mut self, o: &Object) -> Result<ShapeDescription> {
        let Some((name, at)) = self.text(o, "filename")? else {
            return Err(self.error(&o.at, "the filename is missing"));
        };
        let file = self.find(&name, &at)?;
        let index = match self.number(o, "shape_index")?.unwrap_or(0.0) {
            i if i >= 0.0 && i.fract() == 0.0 => i as usize,
            i => return Err(self.error(&o.at, format!("{i} is no shape_index"))),
        };
        let flipped = self.flag(o, "flip_tex_coords", false)?;
        let bytes = self.assets.read(&file).map_err(|m| self.error(&at, m))?;
        let mesh = super::serialized::read(&bytes, index).map_err(|m| self.error(&at, format!("\"{file}\": {m}")))?;
        let c = self.common(o, if flipped && mesh.uvs.is_some() { Lie::Flipped } else { Lie::Same })?;
        let normals = mesh.normals.is_some();
        let stem = std::path::Path::new(&file).file_stem().map_or("mesh".into(), |s| s.to_string_lossy().into_owned());
        let file = self.assets.add_mesh(&format!("{stem}-{index}"), mesh);
        Ok(ShapeDescription::Ply(self.placed(o, c, file, normals)?))
    }

    /// An open tube.
    fn cylinder(&mut self, o: &Object) -> Result<ShapeDescription> {
        let c = self.common(o, Lie::Same)?;
        let p0 = self.vector(o, "p0")?.unwrap_or(DVec3::ZERO);
        let p1 = self.vector(o, "p1")?.unwrap_or(DVec3::Z);
        let radius = self.number(o, "radius")?.unwrap_or(1.0);
        let flip_normals = self.flag(o, "flip_normals", false)?;
        let Some(z) = (p1 - p0).try_normalize() else { return Err(self.error(&o.at, "p0 and p1 are the same point")) };
        let (x, y) = z.any_orthonormal_pair();
        let height = (p1 - p0).length();
        let place = DMat4::from_cols(
            (x * radius).extend(0.0),
            (y * radius).extend(0.0),
            (z * height).extend(0.0),
            p0.extend(1.0),
        );
        self.warn(&o.at, format!("a cylinder becomes a prism of {SIDES} sides"));
        let file = match self.assets.meshes.contains_key("cylinder.ply") {
            true => "cylinder.ply".to_string(),
            false => self.assets.add_mesh("cylinder", tube()),
        };
        Ok(ShapeDescription::Ply(MeshFile {
            file,
            face_normals: false,
            smooth_normals: false,
            flip_normals,
            material: c.material,
            emission: c.emission,
            to_world: steps(c.matrix * place),
        }))
    }

    /// Whether a material has an image in it.
    fn wears_images(&self, material: &MaterialRef) -> bool {
        use MaterialDescription as M;
        let description = match material {
            MaterialRef::Named(name) => match self.scene.materials.get(name) {
                Some(m) => m,
                None => return false,
            },
            MaterialRef::Inline(m) => m,
        };
        let image = |t: &Texture| matches!(t, Texture::Image(_));
        let varies = |t: &NumberTexture| t.constant().is_none();
        match description {
            M::Glow { .. } | M::NormalMap { .. } | M::BumpMap { .. } => true,
            M::Mask { opacity, material } => image(opacity) || self.wears_images(material),
            M::TwoSided { front, back } => {
                self.wears_images(front) || back.as_ref().is_some_and(|b| self.wears_images(b))
            }
            M::Mix { a, b, .. } => self.wears_images(a) || self.wears_images(b),
            M::Diffuse { reflectance } | M::Mirror { reflectance } => image(reflectance),
            M::Dielectric { tint, alpha, alpha_u, alpha_v, .. }
            | M::Conductor { tint, alpha, alpha_u, alpha_v, .. } => {
                image(tint) || [alpha, alpha_u, alpha_v].into_iter().flatten().any(varies)
            }
            M::ThinDielectric { tint, .. } => image(tint),
            M::Plastic { diffuse_reflectance, alpha, .. } => image(diffuse_reflectance) || varies(alpha),
            M::Principled { base_color, metallic, roughness, .. } => {
                image(base_color) || varies(metallic) || varies(roughness)
            }
            M::PrincipledThin { base_color, roughness, .. } => image(base_color) || varies(roughness),
            M::Phong { .. }
            | M::BlinnPhong { .. }
            | M::OrenNayar { .. }
            | M::AshikhminShirley { .. }
            | M::Measured { .. } => false,
        }
    }
}

/// A cube whose faces have the texture coordinates of Mitsuba's, but for v, which grows upwards.
fn cube(simple: Simple) -> Mesh {
    // Each face from where (u, v) is (0, 0), by way of (1, 0) and (1, 1), to (0, 1).
    const FACES: [[[f32; 3]; 4]; 6] = [
        [[1.0, -1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, -1.0, -1.0]],
        [[1.0, 1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, 1.0]],
        [[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0]],
        [[1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [-1.0, -1.0, 1.0]],
        [[-1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]],
        [[1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]],
    ];
    let face = |i: u32| if simple.flip_normals { vec![i, i + 3, i + 2, i + 1] } else { vec![i, i + 1, i + 2, i + 3] };
    Mesh {
        positions: FACES.concat(),
        faces: (0..6).map(|f| face(4 * f)).collect(),
        normals: None,
        uvs: Some([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].repeat(6)),
        attributes: Default::default(),
        material: simple.material,
        emission: simple.emission,
        to_world: simple.to_world,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use rebond::scene::description::Transform;

    #[test]
    fn the_cube_faces_outwards() {
        let simple = Simple { flip_normals: false, material: None, emission: None, to_world: Transform::default() };
        let mesh = cube(simple);
        for f in &mesh.faces {
            let p: Vec<Vec3> = f.iter().map(|i| Vec3::from(mesh.positions[*i as usize])).collect();
            assert!((p[1] - p[0]).cross(p[2] - p[0]).dot(p[0] + p[2]) > 0.0);
        }
    }

    #[test]
    fn a_scene_of_one_long_line_is_not_kept_with_each_shape() {
        let spheres = "<shape type=\"sphere\"/>".repeat(20_000);
        let text = format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"/>{spheres}<shape type=\"cylinder\"/></scene>"
        );
        let options = crate::ImportOptions { lenient: true, ..Default::default() };
        let scene = crate::mitsuba::read_mitsuba(&text, "a.xml", std::path::Path::new(""), options).expect("a scene");
        assert!(scene.warnings.iter().all(|w| w.place.as_ref().is_none_or(|p| p.source_line.is_empty())));
        let error = scene.places.error_at("shapes[20000].to_world", "no");
        assert_eq!((error.line(), error.column()), (Some(1), Some(1 + text.find("<shape type=\"cy").expect("there"))));
        assert_eq!(error.snippet().lines().count(), 2, "{}", error.snippet());
    }

    #[test]
    fn only_texture_coordinates_of_the_file_are_flipped() {
        let folder = tempfile::tempdir().expect("a folder");
        let material = |extension: &str, text: &str, flip: bool| {
            std::fs::write(folder.path().join(format!("m.{extension}")), text).expect("a mesh");
            let text = format!(
                "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><emitter type=\"constant\"/><shape type=\"{extension}\"><string name=\"filename\" value=\"m.{extension}\"/>
                <boolean name=\"flip_tex_coords\" value=\"{flip}\"/>
                <bsdf type=\"diffuse\"><texture type=\"checkerboard\" name=\"reflectance\"/></bsdf></shape></scene>"
            );
            let options = crate::ImportOptions { lenient: true, ..Default::default() };
            let scene = crate::mitsuba::read_mitsuba(&text, "a.xml", folder.path(), options)
                .unwrap_or_else(|e| panic!("{}", e.snippet()));
            match &scene.description.shapes[..] {
                [ShapeDescription::Obj(m) | ShapeDescription::Ply(m)] => m.material.clone(),
                other => panic!("{other:?}"),
            }
        };
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let obj_with = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
        let ply = |uvs: &str, row: &str| {
            let head =
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
            let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
            format!("{head}{uvs}{faces}0 0 0{row}\n1 0 0{row}\n0 1 0{row}\n3 0 1 2\n")
        };
        let (without, with) = (ply("", ""), ply("property float u\nproperty float v\n", " 0 0"));
        for (extension, plain, own) in [("obj", obj, obj_with), ("ply", &without, &with)] {
            assert_eq!(material(extension, plain, true), material(extension, plain, false), "{extension}");
            assert_ne!(material(extension, own, true), material(extension, own, false), "{extension}");
        }
    }
}
