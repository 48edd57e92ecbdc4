//! From a description to a scene: names resolved, transforms multiplied out, tables filled, mistakes found.

use super::description::{
    AttributeTexture, CameraDescription, Channel, Color, Distribution, EmitterDescription, FovAxis, ImageTexture,
    LobeForm, Masking, MaterialDescription, MaterialRef, Mesh, MeshFile, Metal, NumberTexture, Outline,
    SceneDescription, ShapeDescription, Texture,
};
use super::faces::{Extent, Names};
use super::pilot;
use super::transform::Motion;
use super::varied::{ATTRIBUTE, NumberFrom, Place, Row, Tables as VariedTables, Varied};
use super::{
    BUMP_MAP, BuildError, EMITTER_PER_PRIMITIVE, Features, HAS_NORMALS, HAS_UVS, IS_DISK, IS_SPHERE, MASK,
    MATERIAL_RECORDS, MIX, NORMAL_MAP, Scene, SceneStatistics, TWO_SIDED,
};
use crate::bsdf::measured::{Measured, Tables};
use crate::bsdf::{BECKMANN, Bsdf, Lobe, Model, PARAMETERS, SEPARABLE, SMOOTH, check};
use crate::camera::{Aperture, Camera, FEWEST_BLADES, MOST_BLADES, Projection};
use crate::emitter::{
    Emitter, Emitters, Environment, EnvironmentImage, Glow, IntensityImage, Keyframe, LightSampler, NO_EMITTER,
    Picture, Slide, Window, area_vector,
};
use crate::film::{Aov, Filter, FilterSettings, Image, LARGEST_SAMPLE};
use crate::math::{Frame, Keyframes, LUMINANCE, Rgb};
use crate::shape::MeshData;
use crate::texture::{Encoding, SAME_UV, Textures, UvMap};
use glam::{DAffine3, DVec3, Vec3};
use rebond_bvh::{Accel, BuildOptions, Disk, Geometry, Instance, Sphere};
use rebond_lanes::{Record, scalar::Index1};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

type Result<T> = std::result::Result<T, BuildError>;

/// Flag of a material that is a dielectric or a sheet, or a mix that has one in it.
const HAS_DIELECTRIC: u32 = 1;

/// Which reader a mesh file needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshSource {
    /// Wavefront OBJ.
    Obj,
    /// PLY.
    Ply,
}

/// Where the files come from that a description names. The library itself opens none.
pub trait Resources {
    /// The mesh in a file, or what is wrong with it.
    fn mesh(&self, file: &str, source: MeshSource) -> std::result::Result<MeshData, String>;
    /// The image in a file, in linear values, or what is wrong with it.
    fn image(&self, file: &str, encoding: Encoding) -> std::result::Result<Image, String>;
    /// The measurements in a file, or what is wrong with it.
    fn measured(&self, file: &str) -> std::result::Result<Measured, String> {
        Err(format!("nothing here reads the measurements in \"{file}\""))
    }
}

/// Builds a scene.
pub fn build(description: &SceneDescription, resources: &dyn Resources) -> Result<Scene> {
    let size = film_size(description)?;
    let mut builder = Builder { description, resources, ..Builder::empty(description, resources) };
    let world = builder.geometry(&description.shapes, "shapes", true)?;
    let groups: Vec<(&String, u32)> = description.groups.keys().zip(1..).collect();
    let mut geometries = vec![world];
    for (name, shapes) in &description.groups {
        let geometry = builder.geometry(shapes, &format!("groups.{name}"), false)?;
        geometries.push(geometry);
    }
    let mut instances = vec![(0, Motion::rest(DAffine3::IDENTITY), String::new())];
    for (i, shape) in description.shapes.iter().enumerate() {
        if let ShapeDescription::Instance(instance) = shape {
            let path = format!("shapes[{i}]");
            let group = groups.iter().find(|(name, _)| **name == instance.group);
            let (_, number) = group.ok_or_else(|| {
                unknown(&format!("{path}.group"), "group", &instance.group, description.groups.keys())
            })?;
            let path = format!("{path}.to_world");
            instances.push((*number, instance.to_world.motion(&path)?, path));
        }
    }
    let mut primitives = geometries.iter().map(Part::count).sum::<u32>();
    for (geometry, motion, path) in std::mem::take(&mut builder.apart) {
        // Only now is it known which primitives are its own.
        if let Some(triangle) = geometry.triangles.first() {
            builder.shapes[triangle.0[3].to_bits() as usize].0[3] = f32::from_bits(primitives);
        }
        primitives += geometry.count();
        instances.push((geometries.len() as u32, motion, path));
        geometries.push(geometry);
    }
    builder.emitters()?;
    let camera = camera(&description.camera, size)?;
    let filter = filter(description.film.filter)?;
    check_aovs(&description.film.aovs)?;
    builder.finish(geometries, instances, camera, filter)
}

/// One material by itself, as its front looks at the centre of its textures, without holes and relief, in the frame (x, y, z). `material` is named in
/// the description or given in place; errors within it call it `material`.
pub fn material(
    description: &SceneDescription,
    material: &MaterialRef,
    resources: &dyn Resources,
) -> Result<check::Material> {
    let mut builder = Builder::empty(description, resources);
    let number = builder.material_ref("material", material, 0)?;
    let mut parts = Vec::new();
    builder.parts(number, 1.0, &mut parts);
    Ok(check::Material::new(parts).with_tables(builder.measured))
}

fn film_size(description: &SceneDescription) -> Result<[u32; 2]> {
    let film = &description.film;
    for (name, n) in [("width", film.width), ("height", film.height)] {
        if n == 0 || n > 65_536 {
            let error = BuildError::new(
                format!("film.{name}"),
                format!("a film {n} pixels {}", if name == "width" { "wide" } else { "high" }),
            );
            return Err(error.help("give a size from 1 to 65536"));
        }
    }
    if u64::from(film.width) * u64::from(film.height) > 1 << 28 {
        return Err(
            BuildError::new("film", "a film of more than 2^28 pixels").help("the largest square has a side of 16384")
        );
    }
    Ok([film.width, film.height])
}

/// What is shown beside the picture.
fn check_aovs(aovs: &[Aov]) -> Result<()> {
    for (i, aov) in aovs.iter().enumerate() {
        if aovs[..i].contains(aov) {
            return Err(BuildError::new(format!("film.aovs[{i}]"), format!("{} is there twice", aov.name())));
        }
    }
    Ok(())
}

fn filter(settings: FilterSettings) -> Result<Filter> {
    let radius = settings.radius();
    if !(radius > 0.0 && radius <= 64.0) {
        return Err(BuildError::new("film.filter", "the filter's radius is not within (0, 64] pixels"));
    }
    if let FilterSettings::Mitchell { b, c } = settings
        && !(b.is_finite() && c.is_finite() && (0.0..=1.0).contains(&b) && (0.0..=1.0).contains(&c))
    {
        return Err(BuildError::new("film.filter", "B and C of the Mitchell filter lie within [0, 1]"));
    }
    if let FilterSettings::Gaussian { stddev, .. } = settings
        && !(stddev > 0.0 && radius <= 16.0 * stddev)
    {
        return Err(BuildError::new("film.filter", "a Gaussian ends within 16 standard deviations, which are above 0"));
    }
    Ok(Filter::new(settings))
}

/// An unknown name, with the ones there are.
fn unknown<'a>(path: &str, what: &str, name: &str, known: impl Iterator<Item = &'a String>) -> BuildError {
    let known: Vec<&String> = known.collect();
    let nearest = known.iter().max_by(|a, b| strsim::jaro_winkler(a, name).total_cmp(&strsim::jaro_winkler(b, name)));
    let list = known.iter().map(|k| k.as_str()).collect::<Vec<_>>().join(", ");
    let help = match nearest {
        Some(n) if strsim::jaro_winkler(n, name) > 0.7 => format!("did you mean \"{n}\"? there are: {list}"),
        Some(_) => format!("there are: {list}"),
        None => format!("the scene has no {what}s"),
    };
    BuildError::new(path, format!("there is no {what} \"{name}\"")).help(help)
}

/// The brightest light a scene may have: a hundredth of what a film holds, to leave room for what focuses it.
const BRIGHTEST: f32 = LARGEST_SAMPLE / 128.0;

/// Areas of lights between these have a density, and squares of distances to them, within f32.
const SMALLEST_LIGHT: f64 = 1e-36;
const LARGEST_LIGHT: f64 = 1e36;

/// A finite number within a range.
fn number(path: &str, x: f32, range: std::ops::RangeInclusive<f32>, what: &str) -> Result<f32> {
    if x.is_finite() && range.contains(&x) {
        return Ok(x);
    }
    Err(BuildError::new(path, format!("{x} is no {what}")))
}

/// A finite colour that is not negative.
fn light(path: &str, c: Color) -> Result<[f32; 3]> {
    if !c.0.iter().all(|x| x.is_finite() && *x >= 0.0) {
        return Err(BuildError::new(path, "light is finite and not negative"));
    }
    if c.0.iter().any(|x| *x > BRIGHTEST) {
        let error = BuildError::new(path, format!("light of more than {BRIGHTEST:e} is brighter than a film can hold"));
        return Err(error.help("dim all lights of the scene alike, and raise --exposure"));
    }
    Ok(c.0)
}

fn reflectance(path: &str, c: Color) -> Result<[f32; 3]> {
    if c.0.iter().all(|x| (0.0..=1.0).contains(x)) {
        return Ok(c.0);
    }
    Err(BuildError::new(path, "a reflectance lies within [0, 1]")
        .help("a surface cannot reflect more light than it receives"))
}

/// An image, or one channel of it.
fn of_channel(mut texels: Vec<[f32; 3]>, channel: Option<Channel>) -> Vec<[f32; 3]> {
    if let Some(channel) = channel {
        texels.iter_mut().for_each(|t| *t = [t[channel as usize]; 3]);
    }
    texels
}

/// An image whose numbers are no colours.
fn as_it_is(image: &ImageTexture) -> ImageTexture {
    ImageTexture { encoding: Encoding::Linear, ..image.clone() }
}

/// Where an image lies.
fn uv_map(path: &str, texture: &ImageTexture) -> Result<UvMap> {
    if !texture.repeat.iter().all(|r| r.is_finite()) {
        return Err(BuildError::new(path, "`repeat` is not finite"));
    }
    let map = texture.to_uv.unwrap_or(SAME_UV);
    if !map.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(BuildError::new(path, "`to_uv` is not finite"));
    }
    Ok([0, 1].map(|row| map[row].map(|x| x * texture.repeat[row])))
}

/// A number in [0, 1].
fn unit(path: &str, key: &str, x: f32, what: &str) -> Result<f32> {
    number(&format!("{path}.{key}"), x, 0.0..=1.0, &format!("{what}; it lies within [0, 1]"))
}

fn exponent(path: &str, x: f32) -> Result<f32> {
    number(path, x, 0.0..=1e6, "exponent of a lobe; it lies within [0, 1e6]")
}

/// The parameter that tells what facets there are.
fn facets(distribution: Distribution, masking: Masking) -> f32 {
    let distribution = match distribution {
        Distribution::Ggx => 0.0,
        Distribution::Beckmann => BECKMANN,
    };
    let masking = match masking {
        Masking::Correlated => 0.0,
        Masking::Separable => SEPARABLE,
    };
    distribution + masking
}

/// The aspect of a brushed surface, at most 10 (Burley 2012), and α along both tangents.
fn brushed(alpha: f32, anisotropic: f32) -> (f32, [f32; 2]) {
    let aspect = (1.0 - 0.9 * anisotropic).sqrt();
    (aspect, [(alpha / aspect).clamp(SMOOTH, 1.0), (alpha * aspect).max(SMOOTH)])
}

/// The index of the inside over that of the outside.
fn relative_index(path: &str, int_ior: f32, ext_ior: f32) -> Result<f32> {
    let ior = |key: &str, x: f32| number(&format!("{path}.{key}"), x, 0.1..=100.0, "index of refraction");
    Ok(ior("int_ior", int_ior)? / ior("ext_ior", ext_ior)?)
}

/// Parameters of which all but the first few are 0.
fn first(values: &[f32]) -> [f32; PARAMETERS] {
    let mut p = [0.0; PARAMETERS];
    p[..values.len()].copy_from_slice(values);
    p
}

fn finite_point(path: &str, p: [f32; 3]) -> Result<Vec3> {
    if p.iter().all(|x| x.is_finite()) {
        Ok(Vec3::from(p))
    } else {
        Err(BuildError::new(path, "a coordinate is not finite"))
    }
}

fn camera(description: &CameraDescription, size: [u32; 2]) -> Result<Camera> {
    use CameraDescription::{Orthographic, Perspective, ThinLens};
    let (w, h) = (size[0] as f32, size[1] as f32);
    let extent = |fov: f32, axis: FovAxis| -> Result<[f32; 2]> {
        if !(fov > 0.0 && fov < 180.0) {
            return Err(BuildError::new("camera.fov", format!("{fov} is no field of view"))
                .help("give degrees between 0 and 180"));
        }
        let half = (fov.to_radians() / 2.0).tan();
        let along_x = match axis {
            FovAxis::X => true,
            FovAxis::Y => false,
            FovAxis::Smaller => w <= h,
            FovAxis::Larger => w > h,
        };
        Ok(if along_x { [half, half * h / w] } else { [half * w / h, half] })
    };
    let near = match description {
        Perspective { near_clip, .. } | ThinLens { near_clip, .. } => *near_clip,
        Orthographic { .. } => 0.0,
    };
    let near = number("camera.near_clip", near, 0.0..=f32::MAX, "distance in front of the camera")?;
    let offset = match description {
        Perspective { principal_point_offset, .. } | ThinLens { principal_point_offset, .. } => *principal_point_offset,
        Orthographic { .. } => [0.0; 2],
    };
    for x in offset {
        number("camera.principal_point_offset", x, -1e6..=1e6, "offset of a picture")?;
    }
    let (projection, to_world, shutter) = match description {
        Perspective { to_world, fov, fov_axis, shutter_open, shutter_close, .. } => {
            (Projection::Perspective { extent: extent(*fov, *fov_axis)? }, to_world, [*shutter_open, *shutter_close])
        }
        ThinLens {
            to_world,
            fov,
            fov_axis,
            aperture_radius,
            aperture_blades,
            aperture_rotation,
            focus_distance,
            shutter_open,
            shutter_close,
            ..
        } => {
            let aperture = aperture(*aperture_radius, *aperture_blades, *aperture_rotation)?;
            let focus = number(
                "camera.focus_distance",
                *focus_distance,
                f32::MIN_POSITIVE..=f32::MAX,
                "distance in front of a lens",
            )?;
            (
                Projection::ThinLens { extent: extent(*fov, *fov_axis)?, aperture, focus },
                to_world,
                [*shutter_open, *shutter_close],
            )
        }
        Orthographic { to_world, shutter_open, shutter_close } => {
            (Projection::Orthographic { extent: [1.0, h / w] }, to_world, [*shutter_open, *shutter_close])
        }
    };
    if !(shutter[0].is_finite() && shutter[1].is_finite() && shutter[0] <= shutter[1]) {
        return Err(BuildError::new("camera.shutter_close", "the shutter closes before it opens"));
    }
    let camera = Camera::new(projection, &to_world.motion("camera.to_world")?.0, shutter, size);
    let (Projection::Perspective { extent }
    | Projection::ThinLens { extent, .. }
    | Projection::Orthographic { extent }) = projection;
    Ok(camera.with_center([0, 1].map(|i| -2.0 * offset[i] * extent[i])).with_near_clip(near))
}

fn aperture(radius: f32, blades: u32, rotation: f32) -> Result<Aperture> {
    let radius = number("camera.aperture_radius", radius, 0.0..=f32::MAX, "radius of a lens")?;
    let rotation = number("camera.aperture_rotation", rotation, f32::MIN..=f32::MAX, "angle")?;
    match blades {
        0 => Ok(Aperture::round(radius)),
        FEWEST_BLADES..=MOST_BLADES => Ok(Aperture::polygon(radius, blades, rotation.to_radians())),
        _ => {
            let error = BuildError::new("camera.aperture_blades", format!("an iris of {blades} blades"));
            Err(error.help(format!("give {FEWEST_BLADES} to {MOST_BLADES} blades, or 0 for a round opening")))
        }
    }
}

/// A geometry and what stands beside it in the scene's tables.
#[derive(Default)]
struct Part {
    geometry: Geometry,
    /// Records of the spheres and of the disks, which follow the triangles' in the table of primitives.
    spheres: Vec<Record>,
    disks: Vec<Record>,
    triangles: Vec<Record>,
}

struct Builder<'a> {
    description: &'a SceneDescription,
    resources: &'a dyn Resources,
    vertices: Vec<Record>,
    normals: Vec<Record>,
    shapes: Vec<Record>,
    analytic: Vec<Record>,
    materials: Vec<Record>,
    named: BTreeMap<&'a str, u32>,
    /// The mesh whose material is being made.
    worn: Option<Worn<'a>>,
    /// Whether a material that is being made asked for an attribute of it.
    asked: bool,
    textures: Textures,
    /// Images, and theirs: several materials often have one.
    images: HashMap<String, u32>,
    varied: Varied,
    /// Images of lamps, their numbers and largest values, and which emitters show them, with the factor on them.
    glow: Textures,
    glow_images: Vec<(&'a ImageTexture, u32, [f32; 3])>,
    pictures: Vec<(Picture, [f32; 3])>,
    measured: Tables,
    /// Model and number of what was measured, by file.
    measured_files: BTreeMap<&'a str, (Model, u32)>,
    features: Features,
    emitters: Vec<Emitter>,
    /// Emitters that move, before they do.
    moving: Vec<(Range<u32>, Vec<Keyframe>)>,
    environments: Vec<Environment>,
    /// Images of projectors.
    projectors: Vec<IntensityImage>,
    /// Shapes that need an instance of their own: moving ones, and round ones that are stretched.
    apart: Vec<(Part, Motion, String)>,
    names: Names,
    warnings: Vec<String>,
    primitives_before: u32,
}

/// What materials may ask of the mesh that wears them; those that do are made for it alone.
#[derive(Default)]
struct Worn<'a> {
    attributes: BTreeMap<String, Vec<[f32; 3]>>,
    /// Their numbers, of those asked for.
    numbers: BTreeMap<String, u32>,
    vertices: usize,
    triangles: usize,
    first_vertex: u32,
    named: BTreeMap<&'a str, u32>,
}

/// Where a shape goes.
struct Placement {
    /// What is multiplied into its points now.
    baked: DAffine3,
    /// What an instance of its own does later.
    motion: Option<Motion>,
}

impl<'a> Builder<'a> {
    fn empty(description: &'a SceneDescription, resources: &'a dyn Resources) -> Self {
        Self {
            description,
            resources,
            vertices: Vec::new(),
            normals: Vec::new(),
            shapes: Vec::new(),
            analytic: Vec::new(),
            materials: Vec::new(),
            named: BTreeMap::new(),
            worn: None,
            asked: false,
            textures: Textures::default(),
            images: HashMap::new(),
            varied: Varied::default(),
            glow: Textures::default(),
            glow_images: Vec::new(),
            pictures: Vec::new(),
            measured: Tables::default(),
            measured_files: BTreeMap::new(),
            features: Features::default(),
            emitters: Vec::new(),
            moving: Vec::new(),
            environments: Vec::new(),
            projectors: Vec::new(),
            apart: Vec::new(),
            names: Names::default(),
            warnings: Vec::new(),
            primitives_before: 0,
        }
    }

    // ---- materials ----

    fn material_ref(&mut self, path: &str, material: &'a MaterialRef, depth: u32) -> Result<u32> {
        match material {
            MaterialRef::Inline(m) => self.material(path, m, depth),
            MaterialRef::Named(name) => {
                if let Some(number) = self.named.get(name.as_str()) {
                    return Ok(*number);
                }
                if let Some(number) = self.worn.as_ref().and_then(|worn| worn.named.get(name.as_str())) {
                    self.asked = true;
                    return Ok(*number);
                }
                let found = self.description.materials.get_key_value(name);
                let (name, m) =
                    found.ok_or_else(|| unknown(path, "material", name, self.description.materials.keys()))?;
                if depth > 16 {
                    return Err(BuildError::new(
                        path,
                        format!("the material \"{name}\" contains itself, or is nested too deeply"),
                    ));
                }
                let before = std::mem::replace(&mut self.asked, false);
                let number = self.material(&format!("materials.{name}"), m, depth + 1)?;
                match &mut self.worn {
                    Some(worn) if self.asked => {
                        worn.named.insert(name, number);
                        self.names.materials.push((number, name.clone()));
                    }
                    _ => {
                        self.named.insert(name, number);
                    }
                }
                self.asked |= before;
                Ok(number)
            }
        }
    }

    fn push_material(&mut self, head: [u32; 4], color: [f32; 3], p: [f32; PARAMETERS]) -> u32 {
        let number = self.materials.len() as u32 / MATERIAL_RECORDS;
        self.materials.push(Record::words(head));
        self.materials.push(Record([color[0], color[1], color[2], p[8]]));
        self.materials.push(Record([p[0], p[1], p[2], p[3]]));
        self.materials.push(Record([p[4], p[5], p[6], p[7]]));
        number
    }

    fn simple(&mut self, model: Model, path: &str, key: &str, texture: &Texture, p: [f32; PARAMETERS]) -> Result<u32> {
        self.varying(model, path, key, texture, p, Row::default())
    }

    /// A material of which more than its colour may vary.
    fn varying(
        &mut self,
        model: Model,
        path: &str,
        key: &str,
        texture: &Texture,
        p: [f32; PARAMETERS],
        row: Row,
    ) -> Result<u32> {
        let (color, texture, attribute) = self.texture(&format!("{path}.{key}"), texture)?;
        let row = Row { color: attribute, ..row };
        let row = if row.is_any() {
            self.features.varied = true;
            self.varied.add(row)
        } else {
            0
        };
        self.features.models |= 1 << model as u32;
        let inside = if matches!(model, Model::Dielectric | Model::RoughDielectric | Model::ThinDielectric) {
            HAS_DIELECTRIC
        } else {
            0
        };
        Ok(self.push_material([model as u32, texture, row, inside], color, p))
    }

    /// A factor, the number of an image + 1, and that of an attribute + 1.
    fn texture(&mut self, path: &str, texture: &Texture) -> Result<([f32; 3], u32, u32)> {
        let range = "a reflectance lies within [0, 1]";
        match texture {
            Texture::Constant(c) => Ok((reflectance(path, *c)?, 0, 0)),
            Texture::Image(image) => Ok(([1.0; 3], 1 + self.image_texture(path, image, range)?, 0)),
            Texture::Attribute(attribute) => {
                let image = match &attribute.image {
                    Some(image) => 1 + self.image_texture(path, image, range)?,
                    None => 0,
                };
                Ok((attribute.scale.0, image, 1 + self.attribute(path, attribute, range)?))
            }
        }
    }

    /// The number of an attribute whose values, times its factor, lie within [0, 1].
    fn attribute(&mut self, path: &str, texture: &AttributeTexture, range: &str) -> Result<u32> {
        let AttributeTexture { attribute: name, scale, .. } = texture;
        let path = format!("{path}.attribute");
        self.asked = true;
        let Some(worn) = &mut self.worn else {
            let error = BuildError::new(
                path,
                format!("\"{name}\" is an attribute, and what has this material here is no mesh"),
            );
            return Err(error.help("attributes are those of the mesh that wears the material"));
        };
        let Some(values) = worn.attributes.get(name) else {
            let known: Vec<&str> = worn.attributes.keys().map(String::as_str).collect();
            let error = BuildError::new(path, format!("the shape has no attribute \"{name}\""));
            return Err(match &known[..] {
                [] => error.help("only meshes have attributes: by properties of a PLY file, or given in place"),
                known => error.help(format!("it has: {}", known.join(", "))),
            });
        };
        let of_faces = name.starts_with("face_");
        let (wanted, of) = if of_faces { (worn.triangles, "triangles") } else { (worn.vertices, "vertices") };
        if values.len() != wanted {
            return Err(BuildError::new(path, format!("\"{name}\" has {} values for {wanted} {of}", values.len())));
        }
        let inside = |v: &[f32; 3]| (0..3).all(|c| (0.0..=1.0).contains(&(v[c] * scale.0[c])));
        let outside = values.iter().filter(|v| !inside(v)).count();
        if outside > 0 {
            let times = if scale.0 == [1.0; 3] { "" } else { ", times its scale," };
            let values = if outside == 1 { "1 value" } else { &*format!("{outside} values") };
            let are = if outside == 1 { "is" } else { "are" };
            let message = format!("{values} of \"{name}\"{times} {are} below 0, above 1 or not finite");
            return Err(BuildError::new(path, message).help(range));
        }
        if let Some(number) = worn.numbers.get(name) {
            return Ok(*number);
        }
        let number = self.varied.add_attribute(values, worn.first_vertex, of_faces);
        worn.numbers.insert(name.clone(), number);
        Ok(number)
    }

    /// The number of an image whose values lie within [0, 1].
    fn image_texture(&mut self, path: &str, texture: &ImageTexture, range: &str) -> Result<u32> {
        let ImageTexture { image: file, encoding, wrap, wrap_v, filter, .. } = texture;
        // Materials that are made for each mesh share theirs.
        let key = format!("{texture:?}");
        if let Some(number) = self.images.get(&key) {
            return Ok(*number);
        }
        let path = format!("{path}.image");
        let (size, texels) = self.image(&path, file, *encoding)?;
        let (mut over, mut negative) = (0, 0);
        for t in &texels {
            over += t.iter().any(|x| *x > 1.0) as u32;
            negative += t.iter().any(|x| x.is_nan() || *x < 0.0) as u32;
        }
        if over + negative > 0 {
            let message = format!("{over} texels of \"{file}\" are above 1 and {negative} below 0 or not finite");
            return Err(BuildError::new(path, message).help(range));
        }
        let map = uv_map(&path, texture)?;
        let texels = of_channel(texels, texture.channel);
        let number = self.textures.add(size, &texels, [*wrap, wrap_v.unwrap_or(*wrap)], *filter, map);
        self.images.insert(key, number);
        Ok(number)
    }

    /// A number in [0, 1]; or any, and the image that it is read from.
    fn number_texture(
        &mut self,
        path: &str,
        key: &str,
        texture: &NumberTexture,
        what: &str,
    ) -> Result<(f32, NumberFrom)> {
        let image = match texture {
            NumberTexture::Constant(x) => return Ok((unit(path, key, *x, what)?, NumberFrom::default())),
            NumberTexture::Image(image) => as_it_is(image),
            NumberTexture::Attribute(attribute) => {
                let place = format!("{path}.{key}");
                if attribute.image.is_some() {
                    let error = BuildError::new(format!("{place}.image"), "an image beside an attribute");
                    return Err(error.help("only colours may be both: give one of them"));
                }
                let number = self.attribute(&place, attribute, &format!("a {what} lies within [0, 1]"))?;
                let weights = std::array::from_fn(|c| LUMINANCE[c] * attribute.scale.0[c]);
                return Ok((1.0, NumberFrom { source: ATTRIBUTE | number, weights }));
            }
        };
        let mut weights = LUMINANCE;
        if let Some(channel) = image.channel {
            weights = [0.0; 3];
            weights[channel as usize] = 1.0;
        }
        let image = ImageTexture { channel: None, ..image };
        let number = self.image_texture(&format!("{path}.{key}"), &image, &format!("a {what} lies within [0, 1]"))?;
        Ok((1.0, NumberFrom { source: number + 1, weights }))
    }

    fn image(&self, path: &str, file: &str, encoding: Encoding) -> Result<([u32; 2], Vec<[f32; 3]>)> {
        let image = self.resources.image(file, encoding).map_err(|e| BuildError::new(path, e))?;
        let texels =
            image.rgb("").ok_or_else(|| BuildError::new(path, format!("\"{file}\" has no colour channels")))?;
        if texels.is_empty() {
            return Err(BuildError::new(path, format!("\"{file}\" is empty")));
        }
        Ok(([image.width, image.height], texels))
    }

    /// The parts of a material that shines, and its own path: image, factor, what scatters light.
    #[expect(clippy::type_complexity)]
    fn glow(
        &self,
        path: &str,
        material: &'a MaterialRef,
    ) -> Result<Option<(String, &'a ImageTexture, [f32; 3], &'a MaterialRef)>> {
        let (place, material) = match material {
            MaterialRef::Inline(m) => (path.to_owned(), &**m),
            MaterialRef::Named(name) => match self.description.materials.get(name) {
                Some(m) => (format!("materials.{name}"), m),
                None => return Ok(None),
            },
        };
        let MaterialDescription::Glow { radiance, scale, material } = material else { return Ok(None) };
        let scale = light(&format!("{place}.scale"), *scale)?;
        Ok(Some((place, radiance, scale, material)))
    }

    /// The number of an image of light. It is kept once, however many lamps show it.
    fn glowing_image(&mut self, path: &str, texture: &'a ImageTexture, scale: [f32; 3]) -> Result<u32> {
        let path = format!("{path}.radiance");
        let known = self.glow_images.iter().find(|(known, ..)| *known == texture);
        let (number, most) = match known {
            Some((_, number, most)) => (*number, *most),
            None => {
                let place = format!("{path}.image");
                let (size, texels) = self.image(&place, &texture.image, texture.encoding)?;
                let texels = of_channel(texels, texture.channel);
                let mut most = [0.0_f32; 3];
                for t in &texels {
                    let t = light(&place, Color(*t))?;
                    most = [0, 1, 2].map(|c| most[c].max(t[c]));
                }
                let map = uv_map(&path, texture)?;
                let wrap = [texture.wrap, texture.wrap_v.unwrap_or(texture.wrap)];
                let number = self.glow.add(size, &texels, wrap, texture.filter, map);
                self.glow_images.push((texture, number, most));
                (number, most)
            }
        };
        light(&format!("{path}.image"), Color([0, 1, 2].map(|c| most[c] * scale[c])))?;
        Ok(number)
    }

    /// α along both tangents, and where it is read.
    fn roughness(
        &mut self,
        path: &str,
        alpha: &'a Option<NumberTexture>,
        u: &'a Option<NumberTexture>,
        v: &'a Option<NumberTexture>,
    ) -> Result<([f32; 2], Row)> {
        if alpha.is_some() && u.is_some() && v.is_some() {
            let error = BuildError::new(format!("{path}.alpha"), "`alpha` beside `alpha_u` and `alpha_v` says nothing");
            return Err(error.help("leave it out, or one of the others"));
        }
        let alpha = alpha.as_ref().unwrap_or(&NumberTexture::Constant(0.0));
        let [u, v] = [u.as_ref(), v.as_ref()];
        let [u, v] = [("alpha_u", u), ("alpha_v", v)].map(|(key, own)| own.map_or(("alpha", alpha), |own| (key, own)));
        let (x, roughness) = self.number_texture(path, u.0, u.1, "roughness")?;
        let mut row = Row { roughness, aspect: 1.0, ..Row::default() };
        if u.1 == v.1 {
            return Ok(([x; 2], row));
        }
        let (y, across) = self.number_texture(path, v.0, v.1, "roughness")?;
        row.across = Some(across);
        self.features.tangents = true;
        Ok(([x, y], row))
    }

    fn material(&mut self, path: &str, material: &'a MaterialDescription, depth: u32) -> Result<u32> {
        use MaterialDescription as M;
        match material {
            M::Diffuse { reflectance } => {
                self.simple(Model::Diffuse, path, "reflectance", reflectance, [0.0; PARAMETERS])
            }
            M::Mirror { reflectance } => {
                self.simple(Model::Mirror, path, "reflectance", reflectance, [0.0; PARAMETERS])
            }
            M::Dielectric { int_ior, ext_ior, alpha, alpha_u, alpha_v, distribution, masking, tint } => {
                let eta = relative_index(path, *int_ior, *ext_ior)?;
                let ([u, v], row) = self.roughness(path, alpha, alpha_u, alpha_v)?;
                // With equal indices a rough boundary is no boundary either, and its half vectors are undefined.
                let smooth = u.max(v) < SMOOTH || eta == 1.0;
                let model = if smooth { Model::Dielectric } else { Model::RoughDielectric };
                let facets = facets(*distribution, *masking);
                let p = [eta, 0.0, 0.0, 0.0, 0.0, 0.0, u.max(SMOOTH), v.max(SMOOTH), facets];
                self.varying(model, path, "tint", tint, p, if smooth { Row::default() } else { row })
            }
            M::Conductor { metal, eta, k, alpha, alpha_u, alpha_v, distribution, masking, tint, compensate } => {
                let (eta, k) = match (metal, eta, k) {
                    (Some(metal), None, None) => index_of(*metal),
                    (None, Some(eta), Some(k)) => {
                        (light(&format!("{path}.eta"), *eta)?, light(&format!("{path}.k"), *k)?)
                    }
                    (None, None, None) => index_of(Metal::Aluminium),
                    _ => return Err(BuildError::new(path, "a conductor needs either `metal`, or both `eta` and `k`")),
                };
                let ([u, v], row) = self.roughness(path, alpha, alpha_u, alpha_v)?;
                if *compensate && row.across.is_some() {
                    let error = BuildError::new(format!("{path}.compensate"), "compensation of an anisotropic metal");
                    return Err(error.help("give one `alpha` for both directions, or leave out `compensate`"));
                }
                if *compensate && *distribution != Distribution::Ggx {
                    let what = "compensation of a distribution other than GGX";
                    let error = BuildError::new(format!("{path}.compensate"), what);
                    return Err(error.help("leave out `distribution`, or leave out `compensate`"));
                }
                if *compensate && *masking != Masking::Correlated {
                    let error = BuildError::new(format!("{path}.compensate"), "compensation of separable masking");
                    return Err(error.help("leave out `masking`, or leave out `compensate`"));
                }
                let model = match compensate {
                    _ if u.max(v) < SMOOTH => Model::Conductor,
                    true => Model::CompensatedConductor,
                    false => Model::RoughConductor,
                };
                let facets = facets(*distribution, *masking);
                let p = [eta[0], eta[1], eta[2], k[0], k[1], k[2], u.max(SMOOTH), v.max(SMOOTH), facets];
                self.varying(model, path, "tint", tint, p, row)
            }
            M::Phong { reflectance, exponent, form } => {
                let model = if *form == LobeForm::Lecture { Model::PhongLecture } else { Model::Phong };
                self.lobe(model, path, reflectance, *exponent)
            }
            M::BlinnPhong { reflectance, exponent, form } => {
                let model = if *form == LobeForm::Lecture { Model::BlinnPhongLecture } else { Model::BlinnPhong };
                self.lobe(model, path, reflectance, *exponent)
            }
            M::OrenNayar { reflectance, roughness } => {
                let r = unit(path, "roughness", *roughness, "roughness")?;
                self.simple(Model::OrenNayar, path, "reflectance", reflectance, first(&[r]))
            }
            M::AshikhminShirley { diffuse_reflectance, specular_reflectance, exponent_u, exponent_v } => {
                let rs = reflectance(&format!("{path}.specular_reflectance"), *specular_reflectance)?;
                let nu = exponent(&format!("{path}.exponent_u"), *exponent_u)?;
                let nv = exponent(&format!("{path}.exponent_v"), *exponent_v)?;
                self.features.tangents |= nu != nv;
                let p = first(&[rs[0], rs[1], rs[2], nu, nv]);
                self.simple(Model::AshikhminShirley, path, "diffuse_reflectance", diffuse_reflectance, p)
            }
            M::ThinDielectric { int_ior, ext_ior, tint } => {
                let eta = relative_index(path, *int_ior, *ext_ior)?;
                self.simple(Model::ThinDielectric, path, "tint", tint, first(&[eta]))
            }
            M::Plastic { diffuse_reflectance, int_ior, ext_ior, alpha, nonlinear } => {
                let eta = relative_index(path, *int_ior, *ext_ior)?;
                if eta < 1.0 {
                    let error = BuildError::new(format!("{path}.int_ior"), "a coat of lower index than the outside");
                    return Err(error.help("give an `int_ior` of at least `ext_ior`"));
                }
                let (alpha, roughness) = self.number_texture(path, "alpha", alpha, "roughness")?;
                let p = [eta, f32::from(u8::from(*nonlinear)), 0.0, 0.0, 0.0, 0.0, alpha.max(SMOOTH), 0.0, 0.0];
                let row = Row { roughness, aspect: 1.0, ..Row::default() };
                self.varying(Model::Plastic, path, "diffuse_reflectance", diffuse_reflectance, p, row)
            }
            M::Principled {
                base_color,
                metallic,
                roughness,
                anisotropic,
                specular,
                clearcoat,
                clearcoat_roughness,
                sheen,
                transmission,
                ior,
            } => {
                let (metallic, metal_from) = self.number_texture(path, "metallic", metallic, "share of metal")?;
                let transmission = unit(path, "transmission", *transmission, "share of glass")?;
                let (roughness, roughness_from) = self.number_texture(path, "roughness", roughness, "roughness")?;
                let anisotropic = unit(path, "anisotropic", *anisotropic, "anisotropy")?;
                let specular = unit(path, "specular", *specular, "strength of a reflection")?;
                let clearcoat = unit(path, "clearcoat", *clearcoat, "weight")?;
                let coat_alpha = unit(path, "clearcoat_roughness", *clearcoat_roughness, "roughness")?.powi(2);
                let sheen = unit(path, "sheen", *sheen, "weight")?;
                let ior = number(&format!("{path}.ior"), *ior, 1.0..=100.0, "index of refraction of at least 1")?;
                // Half vectors of refraction need some difference of the indices.
                let eta = ior.max(1.001);
                let f0 = (2.0 * specular * ((ior - 1.0) / (ior + 1.0)).powi(2)).min(1.0);
                let (aspect, [ax, ay]) = brushed(roughness.powi(2), anisotropic);
                self.features.tangents |= ax != ay || (aspect != 1.0 && roughness_from.source != 0);
                let p = [metallic, transmission, eta, f0, clearcoat, coat_alpha.max(SMOOTH), ax, ay, sheen];
                let row =
                    Row { roughness: roughness_from, is_root: true, aspect, metallic: metal_from, ..Row::default() };
                let number = self.varying(Model::Principled, path, "base_color", base_color, p, row)?;
                if transmission > 0.0 && (metallic < 1.0 || metal_from.source != 0) {
                    self.materials[(number * MATERIAL_RECORDS) as usize].0[3] = f32::from_bits(HAS_DIELECTRIC);
                }
                Ok(number)
            }
            M::PrincipledThin {
                base_color,
                roughness,
                anisotropic,
                transmission,
                ior,
                specular_tint,
                diffuse_transmission,
                flatness,
                sheen,
                sheen_tint,
            } => {
                let (roughness, roughness_from) = self.number_texture(path, "roughness", roughness, "roughness")?;
                let anisotropic = unit(path, "anisotropic", *anisotropic, "anisotropy")?;
                let transmission = unit(path, "transmission", *transmission, "share of glass")?;
                let ior = number(&format!("{path}.ior"), *ior, 1.0..=100.0, "index of refraction of at least 1")?;
                let specular_tint = unit(path, "specular_tint", *specular_tint, "share of a tint")?;
                let passes = unit(path, "diffuse_transmission", *diffuse_transmission, "share of light")?;
                let flatness = unit(path, "flatness", *flatness, "flatness")?;
                let sheen = unit(path, "sheen", *sheen, "weight")?;
                let sheen_tint = unit(path, "sheen_tint", *sheen_tint, "share of a tint")?;
                let (aspect, [ax, ay]) = brushed(roughness.powi(2), anisotropic);
                self.features.tangents |= ax != ay || (aspect != 1.0 && roughness_from.source != 0);
                let p = [transmission, ior, passes, flatness, sheen, specular_tint, ax, ay, sheen_tint];
                let row = Row { roughness: roughness_from, is_root: true, aspect, ..Row::default() };
                let number = self.varying(Model::PrincipledThin, path, "base_color", base_color, p, row)?;
                self.materials[(number * MATERIAL_RECORDS) as usize].0[3] = f32::from_bits(HAS_DIELECTRIC);
                Ok(number)
            }
            M::Measured { file } => {
                let (model, number) = self.measured(&format!("{path}.file"), file)?;
                self.features.models |= 1 << model as u32;
                Ok(self.push_material([model as u32, 0, 0, 0], [1.0; 3], first(&[f32::from_bits(number)])))
            }
            M::Mix { a, b, weight } => {
                let weight = number(&format!("{path}.weight"), *weight, 0.0..=1.0, "weight; it lies within [0, 1]")?;
                let a = self.material_ref(&format!("{path}.a"), a, depth + 1)?;
                let b = self.material_ref(&format!("{path}.b"), b, depth + 1)?;
                for (key, part) in [("a", a), ("b", b)] {
                    self.check_whole(&format!("{path}.{key}"), part)?;
                    if self.head(part)[0] == TWO_SIDED {
                        let error = BuildError::new(format!("{path}.{key}"), "a two-sided material within a mix");
                        return Err(error
                            .help("make the mix two-sided: the front and back of a two-sided material may be mixes"));
                    }
                }
                self.features.mixes = true;
                let inside = self.head(a)[3] | self.head(b)[3];
                Ok(self.push_material([MIX, a, b, inside], [weight, 0.0, 0.0], [0.0; PARAMETERS]))
            }
            M::Mask { opacity, material } => {
                let inner = self.material_ref(&format!("{path}.material"), material, depth + 1)?;
                self.check_whole(&format!("{path}.material"), inner)?;
                let path = format!("{path}.opacity");
                let (opacity, texture) = match opacity {
                    Texture::Constant(c) => {
                        let [r, g, b] = c.0;
                        if r != g || g != b {
                            let error = BuildError::new(path, "an opacity is one number");
                            return Err(error.help("light of all colours meets the same surface"));
                        }
                        (number(&path, r, 0.0..=1.0, "opacity; it lies within [0, 1]")?, 0)
                    }
                    Texture::Attribute(_) => {
                        let error = BuildError::new(path, "an attribute for an opacity");
                        return Err(error.help("give a number or an image"));
                    }
                    Texture::Image(image) => {
                        (1.0, 1 + self.image_texture(&path, &as_it_is(image), "an opacity lies within [0, 1]")?)
                    }
                };
                self.features.masks = true;
                let inside = self.head(inner)[3];
                Ok(self.push_material([MASK, inner, texture, inside], [opacity, 0.0, 0.0], [0.0; PARAMETERS]))
            }
            M::Glow { material, .. } if depth == 0 || path.starts_with("materials.") && depth == 1 => {
                // A material by itself; that of a shape was taken apart before.
                self.material_ref(&format!("{path}.material"), material, depth + 1)
            }
            M::Glow { .. } => {
                let error = BuildError::new(path, "a material that shines within another");
                Err(error.help("make it the outermost material of the shape"))
            }
            M::NormalMap { normal_map: image, scale, material } => {
                self.map(NORMAL_MAP, path, "normal_map", image, *scale, material, depth)
            }
            M::BumpMap { bump_map: image, scale, material } => {
                self.map(BUMP_MAP, path, "bump_map", image, *scale, material, depth)
            }
            M::TwoSided { front, back } => {
                let a = self.material_ref(&format!("{path}.front"), front, depth + 1)?;
                let b = match back {
                    Some(back) => self.material_ref(&format!("{path}.back"), back, depth + 1)?,
                    None => a,
                };
                for (key, part) in [("front", a), ("back", b)] {
                    self.check_opaque(&format!("{path}.{key}"), part)?;
                }
                self.features.two_sided = true;
                Ok(self.push_material([TWO_SIDED, a, b, 0], [0.0; 3], [0.0; PARAMETERS]))
            }
        }
    }

    /// The model and number of a file's measurements.
    fn measured(&mut self, path: &str, file: &'a str) -> Result<(Model, u32)> {
        if let Some(known) = self.measured_files.get(file) {
            return Ok(*known);
        }
        let measured = self.resources.measured(file).map_err(|e| BuildError::new(path, e))?;
        if let Measured::HalfDifference(table) = &measured
            && table.missing() > 0
        {
            let (missing, all) = (table.missing(), table.values().len());
            self.warnings.push(format!("{missing} of {all} values of \"{file}\" are missing: taken from next to them"));
        }
        self.features.tangents |= !measured.is_isotropic();
        let number = self.measured.add(&measured).map_err(|e| BuildError::new(path, e))?;
        let found = (measured.model(), number);
        self.measured_files.insert(file, found);
        Ok(found)
    }

    fn lobe(&mut self, model: Model, path: &str, reflectance: &Texture, r: f32) -> Result<u32> {
        let r = exponent(&format!("{path}.exponent"), r)?;
        self.simple(model, path, "reflectance", reflectance, first(&[r]))
    }

    /// The BSDFs of a material with their shares.
    fn parts(&self, material: u32, share: f32, parts: &mut Vec<(f32, Bsdf<'static, f32>)>) {
        let record = |n: u32| self.materials[(material * MATERIAL_RECORDS + n) as usize].0;
        let head = self.head(material);
        match head[0] {
            MIX => {
                let weight = record(1)[0];
                self.parts(head[1], share * (1.0 - weight), parts);
                self.parts(head[2], share * weight, parts);
            }
            TWO_SIDED | MASK | NORMAL_MAP | BUMP_MAP => self.parts(head[1], share, parts),
            model => {
                let ([r, g, b, last], p, q) = (record(1), record(2), record(3));
                let mut color = Rgb::new(r, g, b);
                if head[1] != 0 {
                    color *= self.textures.eval(Index1(head[1] - 1), [0.5, 0.5]);
                }
                let p = [p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3], last];
                let tables = VariedTables { textures: &self.textures, primitives: &[], shapes: &[] };
                let lobe = Lobe { color, p };
                let lobe = self.varied.apply(&tables, Index1(head[2]), Place::at([0.5, 0.5]), lobe, true);
                let axis = |x, y, z| crate::math::vec3(x, y, z);
                let frame = Frame { s: axis(1.0, 0.0, 0.0), t: axis(0.0, 1.0, 0.0), n: axis(0.0, 0.0, 1.0) };
                let bsdf = Bsdf::new(Index1(model), 1 << model, lobe, frame, frame.n, true);
                parts.push((share, bsdf));
            }
        }
    }

    fn head(&self, material: u32) -> [u32; 4] {
        self.materials[(material * MATERIAL_RECORDS) as usize].0.map(f32::to_bits)
    }

    /// A material whose frame an image tilts.
    #[expect(clippy::too_many_arguments)]
    fn map(
        &mut self,
        kind: u32,
        path: &str,
        key: &str,
        image: &ImageTexture,
        scale: f32,
        material: &'a MaterialRef,
        depth: u32,
    ) -> Result<u32> {
        let place = format!("{path}.material");
        let inner = self.material_ref(&place, material, depth + 1)?;
        self.check_whole(&place, inner)?;
        match self.head(inner)[0] {
            TWO_SIDED => {
                let error = BuildError::new(place, "a two-sided material under a map");
                return Err(error.help("make the mapped material two-sided"));
            }
            _ if self.has_map(inner) => return Err(BuildError::new(place, "a map under another")),
            _ => {}
        }
        let image = as_it_is(image);
        let texture = self.image_texture(&format!("{path}.{key}"), &image, "values of a map lie within [0, 1]")?;
        let scale = number(&format!("{path}.scale"), scale, -1e6..=1e6, "factor on a map")?;
        (self.features.maps, self.features.tangents) = (true, true);
        let inside = self.head(inner)[3];
        Ok(self.push_material([kind, inner, texture, inside], [scale, 0.0, 0.0], [0.0; PARAMETERS]))
    }

    fn has_map(&self, material: u32) -> bool {
        let head = self.head(material);
        match head[0] {
            NORMAL_MAP | BUMP_MAP => true,
            MIX => self.has_map(head[1]) || self.has_map(head[2]),
            _ => false,
        }
    }

    /// Holes are the whole material's.
    fn check_whole(&self, path: &str, part: u32) -> Result<()> {
        if self.head(part)[0] == MASK {
            let error = BuildError::new(path, "a mask within another material");
            return Err(error.help("make the mask the outermost material of the shape"));
        }
        Ok(())
    }

    fn check_opaque(&self, path: &str, material: u32) -> Result<()> {
        let head = self.head(material);
        self.check_whole(path, material)?;
        if head[3] & HAS_DIELECTRIC != 0 {
            return Err(BuildError::new(path, "a dielectric, or a sheet, already has two sides"));
        }
        if head[0] == TWO_SIDED {
            return Err(BuildError::new(path, "a two-sided material within another"));
        }
        Ok(())
    }

    // ---- shapes ----

    /// The geometry of a list of shapes. Only the world's shapes may shine, move, or be instances.
    fn geometry(&mut self, shapes: &'a [ShapeDescription], path: &str, world: bool) -> Result<Part> {
        let mut part = Part::default();
        for (i, shape) in shapes.iter().enumerate() {
            let path = format!("{path}[{i}]");
            self.shape(&mut part, shape, &path, world)?;
        }
        self.primitives_before += part.count();
        Ok(part)
    }

    fn shape(&mut self, part: &mut Part, shape: &'a ShapeDescription, path: &str, world: bool) -> Result<()> {
        use ShapeDescription as S;
        let (material, emission, to_world) = match shape {
            S::Instance(_) if world => return Ok(()),
            S::Instance(_) => {
                return Err(BuildError::new(path, "an instance within a group").help("list instances under [[shapes]]"));
            }
            S::Mesh(s) => (&s.material, s.emission, &s.to_world),
            S::Obj(s) | S::Ply(s) => (&s.material, s.emission, &s.to_world),
            S::Sphere(s) => (&s.material, s.emission, &s.to_world),
            S::Rectangle(s) | S::Disk(s) | S::Cube(s) => (&s.material, s.emission, &s.to_world),
        };
        let mut emission = emission.map(|e| light(&format!("{path}.emission"), e)).transpose()?;
        let round = matches!(shape, S::Sphere(_) | S::Disk(_));
        let mut mesh = match shape {
            S::Mesh(mesh) => Some(mesh_in_place(mesh, path)?),
            S::Obj(file) => Some(self.mesh_file(file, MeshSource::Obj, path)?),
            S::Ply(file) => Some(self.mesh_file(file, MeshSource::Ply, path)?),
            _ => None,
        };
        self.worn = Some(match &mut mesh {
            Some(mesh) => Worn {
                attributes: std::mem::take(&mut mesh.attributes),
                vertices: mesh.positions.len(),
                triangles: mesh.triangles.len(),
                first_vertex: self.vertices.len() as u32,
                ..Worn::default()
            },
            None => Worn::default(),
        });
        let mut picture = None;
        let material = match material {
            Some(m) => match self.glow(&format!("{path}.material"), m)? {
                Some((place, image, scale, inner)) => {
                    if emission.is_some() || round {
                        let what = if round { "an image on a sphere or a disk that shines" } else { "two emissions" };
                        let error = BuildError::new(format!("{path}.material"), what);
                        return Err(error.help("give `emission`, or the material \"glow\" to a mesh or a rectangle"));
                    }
                    picture = Some(self.glowing_image(&place, image, scale)?);
                    emission = Some(scale);
                    self.material_ref(&format!("{place}.material"), inner, 1)?
                }
                None => self.material_ref(&format!("{path}.material"), m, 0)?,
            },
            None => self.default_material()?,
        };
        self.worn = None;
        let head = self.head(material);
        if head[0] == MASK {
            if emission.is_some() {
                let error = BuildError::new(format!("{path}.emission"), "a shape with holes cannot shine");
                return Err(error.help("give it a material only, or make its mesh without what is not there"));
            }
            if round && head[2] != 0 {
                let error = BuildError::new(format!("{path}.material"), "an image of opacity on a sphere or a disk");
                return Err(error.help("give one number for its opacity, or use a mesh"));
            }
        }
        let motion = to_world.motion(&format!("{path}.to_world"))?;
        let placement = match motion.at_rest() {
            Some(m) if !m.is_finite() => {
                return Err(BuildError::new(format!("{path}.to_world"), "the transform is not finite"));
            }
            Some(m) if !round || is_similarity(m) => Placement { baked: *m, motion: None },
            _ => Placement { baked: DAffine3::IDENTITY, motion: Some(motion.clone()) },
        };
        if placement.motion.is_some() {
            let why = if round && motion.at_rest().is_some() { "is stretched out of round" } else { "moves" };
            if emission.is_some() && matches!(shape, S::Sphere(_)) && !motion.0.iter().all(|(_, m)| is_similarity(m)) {
                let error = BuildError::new(format!("{path}.emission"), "a sphere stretched out of round cannot shine");
                return Err(error.help("scale it alike along all axes, or give it a material only"));
            }
            if !world {
                let error = BuildError::new(format!("{path}.to_world"), format!("a shape within a group {why}"));
                return Err(error.help("move or stretch the instance of the group instead"));
            }
        }
        if emission.is_some() && !world {
            let error = BuildError::new(format!("{path}.emission"), "a shape within a group cannot shine");
            return Err(error.help("list lights under [[shapes]]"));
        }
        let look = Look { path, material, emission, picture };
        let mut own = Part::default();
        let first_emitter = self.emitters.len() as u32;
        let apart = placement.motion.is_some();
        let target = if apart { &mut own } else { part };
        match shape {
            S::Mesh(_) | S::Obj(_) | S::Ply(_) => {
                self.mesh(target, mesh.unwrap_or_default(), &placement, &look, false)?;
            }
            S::Cube(s) => self.mesh(target, flipped(MeshData::cube(), s.flip_normals), &placement, &look, false)?,
            S::Rectangle(s) => {
                self.mesh(target, flipped(MeshData::rectangle(), s.flip_normals), &placement, &look, true)?
            }
            S::Sphere(s) => {
                let center = finite_point(&format!("{path}.center"), s.center)?;
                if !(s.radius.is_finite() && s.radius > 0.0) {
                    return Err(BuildError::new(format!("{path}.radius"), format!("a sphere of radius {}", s.radius)));
                }
                self.round(target, center, s.radius, s.flip_normals, &placement, &look, true)?;
            }
            S::Disk(s) => self.round(target, Vec3::ZERO, 1.0, s.flip_normals, &placement, &look, false)?,
            S::Instance(_) => {}
        }
        if let Some(motion) = placement.motion {
            self.moves(first_emitter, &motion);
            self.apart.push((own, motion, format!("{path}.to_world")));
        }
        Ok(())
    }

    /// The emitters from this one on move.
    fn moves(&mut self, first: u32, motion: &Motion) {
        let emitters = first..self.emitters.len() as u32;
        if !emitters.is_empty() {
            self.moving.push((emitters, motion.0.iter().map(|(t, m)| (*t, rows(m))).collect()));
        }
    }

    fn default_material(&mut self) -> Result<u32> {
        if let Some(number) = self.named.get("") {
            return Ok(*number);
        }
        let number = self.simple(Model::Diffuse, "", "reflectance", &Texture::grey(0.5), [0.0; PARAMETERS])?;
        self.named.insert("", number);
        Ok(number)
    }

    fn mesh_file(&self, file: &MeshFile, source: MeshSource, path: &str) -> Result<MeshData> {
        let path = format!("{path}.file");
        let mut mesh = self.resources.mesh(&file.file, source).map_err(|e| BuildError::new(&path, e))?;
        if let Some(face) = mesh.triangles.iter().position(|t| t.iter().any(|i| *i as usize >= mesh.positions.len())) {
            let message = format!(
                "triangle {face} of \"{}\" names a vertex beyond the {} there are",
                file.file,
                mesh.positions.len()
            );
            return Err(BuildError::new(path, message));
        }
        if file.face_normals {
            mesh.normals = None;
        } else if file.smooth_normals && mesh.normals.is_none() {
            mesh.normals = Some(mesh.smooth_normals());
        }
        Ok(flipped(mesh, file.flip_normals))
    }

    fn push_shape(&mut self, look: &Look, flags: u32, first_primitive: u32) -> u32 {
        let emitter = if look.emission.is_some() { self.emitters.len() as u32 } else { NO_EMITTER };
        self.features.emissive_shapes |= look.emission.is_some();
        self.names.shapes.push(look.path.to_owned());
        self.shapes.push(Record::words([look.material, emitter, flags, first_primitive]));
        self.shapes.len() as u32 - 1
    }

    fn mesh(
        &mut self,
        part: &mut Part,
        mesh: MeshData,
        placement: &Placement,
        look: &Look,
        parallelogram: bool,
    ) -> Result<()> {
        let m = placement.baked;
        let mirrored = m.matrix3.determinant() < 0.0;
        let to_world = |p: [f32; 3]| m.transform_point3(DVec3::from(p.map(f64::from))).as_vec3();
        let normal_matrix = m.matrix3.inverse().transpose();
        let local_base = part.geometry.positions.len() as u32;
        // The geometry's own vertices follow those of earlier geometries in the table.
        let first = self.vertices.len() as u32;
        if self.vertices.len() + mesh.positions.len() > u32::MAX as usize {
            return Err(BuildError::new(look.path, "more than 2^32 vertices"));
        }
        let flags = if mesh.normals.is_some() { HAS_NORMALS } else { 0 } | if mesh.uvs.is_some() { HAS_UVS } else { 0 };
        let shines = look.emission.is_some();
        let flags = flags | if shines && !parallelogram { EMITTER_PER_PRIMITIVE } else { 0 };
        let first_primitive = self.primitives_before + part.triangles.len() as u32;
        let shape = self.push_shape(look, flags, first_primitive);
        if flags & (HAS_NORMALS | HAS_UVS) != 0 {
            self.features.normals = true;
        }
        part.geometry.positions.reserve(mesh.positions.len());
        part.geometry.triangles.reserve(mesh.triangles.len());
        part.triangles.reserve(mesh.triangles.len());
        self.vertices.reserve(mesh.positions.len());
        if self.features.normals {
            // Meshes before this one have none.
            self.normals.resize(self.vertices.len(), Record([0.0; 4]));
            self.normals.reserve(mesh.positions.len());
        }
        for (i, p) in mesh.positions.iter().enumerate() {
            let p = to_world(*p);
            let [u, v] = mesh.uvs.as_ref().map_or([0.0; 2], |uv| uv[i]);
            part.geometry.positions.push(p.to_array());
            self.vertices.push(Record([p.x, p.y, p.z, u]));
            let n = match &mesh.normals {
                Some(n) => (normal_matrix * DVec3::from(n[i].map(f64::from))).normalize_or_zero().as_vec3(),
                None => Vec3::ZERO,
            };
            if self.features.normals {
                self.normals.push(Record([n.x, n.y, n.z, v]));
            }
        }
        for t in &mesh.triangles {
            let [a, b, c] = if mirrored { [t[0], t[2], t[1]] } else { *t };
            part.geometry.triangles.push([a, b, c].map(|i| i + local_base));
            part.triangles.push(Record::words([a + first, b + first, c + first, shape]));
        }
        let Some(radiance) = look.emission else { return Ok(()) };
        let corner = |i: u32| Vec3::from_slice(&self.vertices[(first + i) as usize].0[..3]);
        let mut area = 0.0_f64;
        let mut emitters = Vec::new();
        let mut corners = Vec::new();
        for t in &mesh.triangles {
            let order = if mirrored { [t[0], t[2], t[1]] } else { *t };
            corners.push(order);
            let [a, b, c] = order.map(corner);
            let (e1, e2) = (b - a, c - a);
            let twice = area_vector(e1, e2).length();
            // A triangle without area, or not finite, is skipped by the rays and must not be drawn as a light either.
            let sound = twice.is_finite() && twice > SMALLEST_LIGHT;
            area += if sound { twice } else { 0.0 };
            emitters.push(if sound {
                Emitter::Triangle { p: [a, e1, e2], radiance }
            } else {
                Emitter::Triangle { p: [Vec3::ZERO, Vec3::X, Vec3::Y], radiance: [0.0; 3] }
            });
        }
        if parallelogram {
            // The corner beside the diagonal that the two triangles share, and the ones next to it in the order that
            // the shape's own triangles have.
            let in_order = (mesh.triangles[0] == [0, 1, 2]) != mirrored;
            corners = vec![if in_order { [1, 2, 0] } else { [1, 0, 2] }];
            let [a, b, c] = corners[0].map(corner);
            emitters = vec![Emitter::Parallelogram { p: [a, b - a, c - a], radiance }];
        }
        if area > LARGEST_LIGHT {
            let error = BuildError::new(format!("{}.emission", look.path), "a light too large to be sampled");
            return Err(error.help("its area in square units is beyond f32; use other units"));
        }
        if area <= 0.0 {
            let error = BuildError::new(format!("{}.emission", look.path), "a light of zero area");
            return Err(error.help("give the shape an extent, or use a point light"));
        }
        if let Some(texture) = look.picture {
            let uvs = mesh.uvs.as_ref().ok_or_else(|| {
                BuildError::new(format!("{}.material", look.path), "an image that shines on a mesh without uvs")
            })?;
            for (emitter, order) in (self.emitters.len() as u32..).zip(&corners) {
                let [a, b, c] = order.map(|i| uvs[i as usize]);
                let uv = [a, [b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]];
                self.pictures.push((Picture { emitter, texture, uv }, radiance));
            }
        }
        self.emitters.extend(emitters);
        Ok(())
    }

    #[expect(clippy::too_many_arguments)]
    fn round(
        &mut self,
        part: &mut Part,
        center: Vec3,
        radius: f32,
        flip: bool,
        placement: &Placement,
        look: &Look,
        sphere: bool,
    ) -> Result<()> {
        let m = placement.baked;
        let scale = m.matrix3.determinant().abs().cbrt();
        let center = m.transform_point3(center.as_dvec3()).as_vec3();
        let radius = (f64::from(radius) * scale) as f32;
        if !(radius.is_finite() && radius > 0.0 && center.is_finite()) {
            return Err(BuildError::new(format!("{}.to_world", look.path), "the shape vanishes or is not finite"));
        }
        let axis = |v: DVec3| (m.matrix3 * v).normalize().as_vec3();
        let (x, z) = (axis(DVec3::X), axis(DVec3::Z));
        let place = self.analytic.len() as u32;
        self.features.analytic = true;
        let sign = if flip { -1.0 } else { 1.0 };
        self.analytic.push(Record([center.x, center.y, center.z, radius]));
        self.analytic.push(Record([x.x, x.y, x.z, sign]));
        self.analytic.push(Record([z.x, z.y, z.z, if m.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 }]));
        let shape = self.push_shape(look, if sphere { IS_SPHERE } else { IS_DISK }, 0);
        let record = Record::words([place, 0, 0, shape]);
        let emission = look.emission;
        if sphere {
            part.geometry.spheres.push(Sphere { center: center.to_array(), radius });
            part.spheres.push(record);
            self.emitters.extend(emission.map(|radiance| Emitter::Sphere { center, radius, inwards: flip, radiance }));
        } else {
            part.geometry.disks.push(Disk { center: center.to_array(), normal: z.to_array(), radius });
            part.disks.push(record);
            self.emitters.extend(emission.map(|radiance| Emitter::Disk { center, normal: z * sign, radius, radiance }));
        }
        Ok(())
    }

    // ---- emitters ----

    fn emitters(&mut self) -> Result<()> {
        for (i, emitter) in self.description.emitters.iter().enumerate() {
            let path = format!("emitters[{i}]");
            let at = |key: &str| format!("{path}.{key}");
            let mut motion = Motion::rest(DAffine3::IDENTITY);
            let emitter = match emitter {
                EmitterDescription::Point { to_world, position, intensity } => {
                    let position = finite_point(&at("position"), *position)?;
                    motion = to_world.motion(&at("to_world"))?;
                    let m = motion.at_rest().copied().unwrap_or_default();
                    Emitter::Point {
                        position: m.transform_point3(position.as_dvec3()).as_vec3(),
                        intensity: light(&at("intensity"), *intensity)?,
                    }
                }
                EmitterDescription::Spot { to_world, intensity, cutoff_angle, beam_width } => {
                    motion = to_world.motion(&at("to_world"))?;
                    let m = motion.at_rest().copied().unwrap_or_default();
                    let outer = number(&at("cutoff_angle"), *cutoff_angle, 1e-3..=180.0, "angle of a spot")?;
                    let inner = number(
                        &at("beam_width"),
                        beam_width.unwrap_or(0.75 * outer),
                        0.0..=outer,
                        "beam within the cutoff",
                    )?;
                    Emitter::Spot {
                        position: m.translation.as_vec3(),
                        axis: (m.matrix3 * DVec3::Z).normalize().as_vec3(),
                        angles: [inner.to_radians(), outer.to_radians()],
                        intensity: light(&at("intensity"), *intensity)?,
                    }
                }
                EmitterDescription::Projector { .. } | EmitterDescription::Goniometric { .. } => {
                    self.projector(&path, emitter)?
                }
                EmitterDescription::Directional { direction, irradiance } => {
                    let direction = finite_point(&at("direction"), *direction)?.try_normalize();
                    let direction =
                        direction.ok_or_else(|| BuildError::new(at("direction"), "the direction is zero"))?;
                    Emitter::Directional { direction, irradiance: light(&at("irradiance"), *irradiance)? }
                }
                EmitterDescription::DirectionalArea { to_world, shape, irradiance } => {
                    let m = to_world.matrix(&at("to_world"), "a directional-area light")?;
                    let corner = |x: f64, y: f64| m.transform_point3(DVec3::new(x, y, 0.0)).as_vec3();
                    let (round, [p, a, b]) = match shape {
                        Outline::Rectangle => (false, [corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0)]),
                        Outline::Disk => (true, [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)]),
                    };
                    let (a, b) = (a - p, b - p);
                    let area = area_vector(a, b).length();
                    if !(area.is_finite() && area > SMALLEST_LIGHT && area < LARGEST_LIGHT) {
                        let error = BuildError::new(
                            at("to_world"),
                            "the transform leaves the light no area, or too large a one",
                        );
                        return Err(error.help("its sides are to be lengths in the units of the scene"));
                    }
                    // A transform that mirrors turns the order of edges; +z stays what it is.
                    let (a, b) = if m.matrix3.determinant() < 0.0 { (b, a) } else { (a, b) };
                    let irradiance = light(&at("irradiance"), *irradiance)?;
                    Emitter::DirectionalArea { p: [p, a, b], round, irradiance }
                }
                EmitterDescription::Constant { radiance } => {
                    self.environments.push(Environment::Constant(light(&at("radiance"), *radiance)?));
                    self.surroundings()
                }
                EmitterDescription::Envmap { file, scale, blur, to_world } => {
                    let environment = self.envmap(&path, file, *scale, *blur, to_world)?;
                    self.environments.push(environment);
                    self.surroundings()
                }
            };
            self.emitters.push(emitter);
            if motion.at_rest().is_none() {
                self.moves(self.emitters.len() as u32 - 1, &motion);
            }
        }
        Ok(())
    }

    /// The emitter of the surroundings added last.
    fn surroundings(&self) -> Emitter {
        let number = self.environments.len() - 1;
        Emitter::Environment { number: number as u32, mean: self.environments[number].mean() }
    }

    fn envmap(
        &self,
        path: &str,
        file: &str,
        scale: f32,
        blur: Option<f32>,
        to_world: &super::description::Transform,
    ) -> Result<Environment> {
        let at = |key: &str| format!("{path}.{key}");
        let (_, axes) = upright(&at("to_world"), to_world, "an environment")?;
        let scale = number(&at("scale"), scale, f32::MIN_POSITIVE..=f32::MAX, "factor on light")?;
        let (size, texels) = self.light_image(path, file, Encoding::Auto, ("scale", [scale; 3]))?;
        let image = EnvironmentImage::new(size, &texels, axes);
        let image = match blur {
            None => image,
            Some(r) => {
                let r = number(&at("blur"), r, 1.0..=2000.0, "exponent of a blur; it lies within [1, 2000]")?;
                image.and_then(|image| image.blurred(r))
            }
        };
        let image = image.ok_or_else(|| BuildError::new(at("file"), format!("\"{file}\" is black")))?;
        Ok(Environment::Image(Box::new(image)))
    }

    /// Texels of light, times a factor of that key.
    fn light_image(
        &self,
        path: &str,
        file: &str,
        encoding: Encoding,
        (key, factor): (&str, [f32; 3]),
    ) -> Result<([u32; 2], Vec<[f32; 3]>)> {
        let at = |key: &str| format!("{path}.{key}");
        let (size, mut texels) = self.image(&at("file"), file, encoding)?;
        if texels.iter().flatten().any(|x| !(x.is_finite() && *x >= 0.0)) {
            return Err(BuildError::new(at("file"), format!("\"{file}\" has texels that are negative or not finite")));
        }
        texels.iter_mut().for_each(|t| (0..3).for_each(|c| t[c] *= factor[c]));
        if texels.iter().flatten().any(|x| *x > BRIGHTEST) {
            return Err(BuildError::new(
                at(key),
                format!("\"{file}\" times this is brighter than a film can hold, {BRIGHTEST:e}"),
            ));
        }
        Ok((size, texels))
    }

    /// A point with an image.
    fn projector(&mut self, path: &str, description: &EmitterDescription) -> Result<Emitter> {
        let at = |key: &str| format!("{path}.{key}");
        let black = |file: &str| BuildError::new(at("file"), format!("\"{file}\" is black"));
        let (position, image) = match description {
            EmitterDescription::Projector {
                to_world,
                file,
                encoding,
                filter,
                wrap,
                fov,
                aspect,
                intensity,
                even,
                cutoff_angle,
                beam_width,
            } => {
                let (position, frame) = upright(&at("to_world"), to_world, "a projector")?;
                let intensity = light(&at("intensity"), *intensity)?;
                if intensity == [0.0; 3] {
                    return Ok(dark(position));
                }
                let fov = number(&at("fov"), *fov, 1e-3..=179.0, "field of view of a projector")?;
                let beam = match *cutoff_angle {
                    None if beam_width.is_some() => {
                        let error = BuildError::new(at("beam_width"), "a beam without a `cutoff_angle`");
                        return Err(error.help("give both, or none"));
                    }
                    None => None,
                    Some(none) => {
                        let none = number(&at("cutoff_angle"), none, 1e-3..=180.0, "angle of a projector")?;
                        let full = beam_width.unwrap_or(0.75 * none);
                        let full = number(&at("beam_width"), full, 0.0..=none, "beam within the cutoff")?;
                        Some([full, none].map(f32::to_radians))
                    }
                };
                let (size, texels) = self.light_image(path, file, *encoding, ("intensity", intensity))?;
                let half = (fov.to_radians() / 2.0).tan();
                let aspect = aspect.unwrap_or(size[0] as f32 / size[1] as f32);
                let extent = [half, half / number(&at("aspect"), aspect, 1e-3..=1e5, "width over height")?];
                let window = Window { extent, frame, even: *even, beam };
                let slide = Slide::new(window, size, &texels, *filter, *wrap).ok_or_else(|| black(file))?;
                (position, IntensityImage::Slide(Box::new(slide)))
            }
            EmitterDescription::Goniometric { to_world, file, intensity } => {
                let (position, frame) = upright(&at("to_world"), to_world, "a goniometric light")?;
                let intensity = light(&at("intensity"), *intensity)?;
                if intensity == [0.0; 3] {
                    return Ok(dark(position));
                }
                let (size, texels) = self.light_image(path, file, Encoding::Auto, ("intensity", intensity))?;
                let image = EnvironmentImage::new(size, &texels, frame).ok_or_else(|| black(file))?;
                (position, IntensityImage::Around(Box::new(image)))
            }
            _ => return Err(BuildError::new(path, "an emitter without an image")),
        };
        let number = self.projectors.len() as u32;
        let emitter = Emitter::Projector { number, position, cone: image.cone(), power: image.power() };
        self.projectors.push(image);
        Ok(emitter)
    }

    // ---- the whole ----

    /// `placed` are the instances of `parts`: which part, where, and the path of that transform in the description.
    fn finish(
        mut self,
        parts: Vec<Part>,
        placed: Vec<(u32, Motion, String)>,
        camera: Camera,
        filter: Filter,
    ) -> Result<Scene> {
        let mut primitives = Vec::new();
        let mut geometries = Vec::new();
        let mut extents: Vec<Extent> = Vec::new();
        for part in parts {
            extents.push([primitives.len() as u32, part.triangles.len() as u32, part.count()]);
            if primitives.is_empty() {
                primitives = part.triangles;
            } else {
                primitives.extend(part.triangles);
            }
            primitives.extend(part.spheres.into_iter().chain(part.disks));
            geometries.push(part.geometry);
        }
        self.features.instances = placed.len() > 1;
        self.features.hides_emitters = self.description.hide_emitters;
        let instances: Vec<Instance> = placed
            .iter()
            .map(|(geometry, motion, _)| {
                let keyframes = motion.0.iter().map(|(t, m)| (*t, rows(m))).collect();
                Instance { geometry: *geometry, keyframes }
            })
            .collect();
        let keyframes = Keyframes::new(instances.iter().map(|i| &i.keyframes[..]));
        let extents = placed.iter().map(|(geometry, ..)| extents[*geometry as usize]).collect();
        self.names.instances = placed.iter().map(|(_, _, path)| path.clone()).collect();
        let named = self.named.iter().filter(|(name, _)| !name.is_empty());
        self.names.materials.extend(named.map(|(name, number)| (*number, (*name).to_owned())));
        let count = |f: fn(&Geometry) -> usize| geometries.iter().map(|g| f(g) as u64).sum::<u64>();
        let mut statistics = SceneStatistics {
            triangles: count(|g| g.triangles.len()),
            analytic_shapes: count(|g| g.spheres.len() + g.disks.len()),
            instances: if self.features.instances { placed.len() as u64 } else { 0 },
            emitters: self.emitters.len() as u64,
            materials: self.materials.len() as u64 / u64::from(MATERIAL_RECORDS),
            ..SceneStatistics::default()
        };
        let start = std::time::Instant::now();
        let (accel, report) =
            Accel::build(geometries, instances, &BuildOptions::default()).map_err(|e| accelerator_error(e, &placed))?;
        statistics.accelerator_seconds = start.elapsed().as_secs_f64();
        statistics.accelerator_bytes = report.bytes;
        for (n, what) in [
            (report.degenerate_triangles, "have no area"),
            (report.non_finite_triangles, "have a corner that is not finite"),
        ] {
            if n > 0 {
                self.warnings.push(format!("{n} triangles {what}: skipped"));
            }
        }
        let (lo, hi) = accel.bounds();
        let radius = (Vec3::from(hi) - Vec3::from(lo)).length() / 2.0;
        let radius = if lo[0] <= hi[0] && radius > 0.0 { radius } else { 1.0 };
        if self.emitters.is_empty() {
            self.warnings.push("the scene has no light".into());
        }
        let mut known = self.emitters.clone();
        let triangle = |e: u32| matches!(self.emitters[e as usize], Emitter::Triangle { .. });
        let glow = (!self.pictures.is_empty())
            .then(|| Glow::new(std::mem::take(&mut self.glow), self.emitters.len(), &self.pictures, &triangle));
        if let Some(glow) = &glow {
            // A lamp may show what none of the points of its mean met: all are asked now and then.
            let sum = glow.means().iter().fold([0.0; 3], |s: [f32; 3], (_, m)| [0, 1, 2].map(|c| s[c] + m[c]));
            let least = sum.map(|x| 0.01 * x / glow.means().len() as f32);
            for (emitter, mean) in glow.means() {
                known[*emitter as usize].set_radiance([0, 1, 2].map(|c| mean[c].max(least[c])));
            }
        }
        for (emitters, motion) in &self.moving {
            for emitter in &mut known[emitters.start as usize..emitters.end as usize] {
                *emitter = emitter.hull(motion);
            }
        }
        let light_sampler = LightSampler::new(&known, radius, self.description.light_choice).ok_or_else(|| {
            BuildError::new("emitters", "the power of a light is not a finite number")
                .help("is a light or the scene too large?")
        })?;
        let center = if lo[0] <= hi[0] { (Vec3::from(lo) + Vec3::from(hi)) / 2.0 } else { Vec3::ZERO };
        // Where light may meet the lens it must be able to start before it.
        let to_lens = |(at, reach): ([f32; 3], f32)| (Vec3::from(at) - center).length() + reach;
        let reach = camera.lens_bounds().into_iter().map(to_lens).fold(radius, f32::max);
        let emitters = Emitters::new(&self.emitters, self.environments);
        let emitters = emitters.projecting(&self.emitters, self.projectors);
        let emitters = if let Some(glow) = glow { emitters.glowing(glow) } else { emitters };
        let emitters = emitters.moving(&self.moving);
        let emitters = emitters.around(center.to_array(), reach * 1.0001);
        let tables = [&primitives, &self.vertices, &self.normals, &self.shapes, &self.analytic, &self.materials];
        let bytes = tables.iter().map(|t| t.len() * size_of::<Record>()).sum::<usize>() + self.textures.bytes();
        let bytes = bytes + self.measured.bytes() + self.varied.bytes();
        let bytes = bytes + emitters.environments.iter().map(|(_, e)| e.bytes()).sum::<usize>();
        let bytes = bytes + emitters.image_bytes();
        statistics.table_bytes = (bytes + light_sampler.bytes()) as u64;
        statistics.warnings = self.warnings;
        let mut scene = Scene {
            accel,
            primitives,
            vertices: self.vertices,
            normals: self.normals,
            shapes: self.shapes,
            analytic: self.analytic,
            instances: keyframes,
            materials: self.materials,
            textures: self.textures,
            varied: self.varied,
            measured: self.measured,
            features: self.features,
            light_sampler,
            emitters,
            camera,
            filter,
            aovs: self.description.film.aovs.clone(),
            statistics,
            names: self.names,
            extents,
        };
        for (emitter, axis, one_minus_cos) in pilot::caps(&scene) {
            scene.emitters.set_cap(emitter, axis, one_minus_cos);
        }
        Ok(scene)
    }
}

/// Place and axes of what is turned and mirrored, but not sheared.
fn upright(path: &str, to_world: &super::description::Transform, what: &str) -> Result<(Vec3, [[f32; 3]; 3])> {
    let m = to_world.matrix(path, what)?;
    let axes = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
    let lengths = axes.map(|v| v.length());
    let axes = axes.map(|v| v.normalize());
    let place = m.translation.as_vec3();
    if !(place.is_finite() && axes.iter().all(|a| a.is_finite())) {
        return Err(BuildError::new(path, "the transform flattens what it places, or is not finite"));
    }
    if axes[0].dot(axes[1]).abs().max(axes[1].dot(axes[2]).abs()).max(axes[2].dot(axes[0]).abs()) > 1e-4 {
        return Err(BuildError::new(path, format!("{what} can be turned and mirrored, but not sheared")));
    }
    if lengths.iter().any(|l| (l / lengths[0] - 1.0).abs() > 1e-4) {
        let error = BuildError::new(path, format!("{what} can be turned and mirrored, but not stretched"));
        return Err(error.help("scale it alike along all axes, which changes nothing"));
    }
    Ok((place, axes.map(|a| a.as_vec3().to_array())))
}

/// A light that is switched off.
fn dark(position: Vec3) -> Emitter {
    Emitter::Point { position, intensity: [0.0; 3] }
}

/// What a scene file has to do with an error of the accelerator.
fn accelerator_error(error: rebond_bvh::BuildError, placed: &[(u32, Motion, String)]) -> BuildError {
    use rebond_bvh::BuildError::{NonFiniteMatrix, SingularMatrix};
    let (instance, message) = match error {
        SingularMatrix { instance } => (instance, "the transform flattens the shape, at all times or at one"),
        NonFiniteMatrix { instance } => (instance, "the transform is not finite"),
        other => return BuildError::new("shapes", other.to_string()),
    };
    BuildError::new(placed.get(instance).map_or("shapes", |(_, _, path)| path), message)
}

impl Part {
    fn count(&self) -> u32 {
        (self.triangles.len() + self.spheres.len() + self.disks.len()) as u32
    }
}

/// How a shape looks.
struct Look<'a> {
    path: &'a str,
    material: u32,
    emission: Option<[f32; 3]>,
    /// The image that it shines in.
    picture: Option<u32>,
}

fn is_similarity(m: &DAffine3) -> bool {
    let a = m.matrix3;
    let s2 = a.x_axis.length_squared();
    let even = [a.y_axis, a.z_axis].iter().all(|v| (v.length_squared() - s2).abs() < 1e-6 * s2);
    even && [a.x_axis.dot(a.y_axis), a.y_axis.dot(a.z_axis), a.z_axis.dot(a.x_axis)].iter().all(|d| d.abs() < 1e-6 * s2)
}

fn flipped(mut mesh: MeshData, flip: bool) -> MeshData {
    if flip {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

fn rows(m: &DAffine3) -> rebond_bvh::Affine {
    let c = m.to_cols_array_2d().map(|c| c.map(|x| x as f32));
    std::array::from_fn(|r| [c[0][r], c[1][r], c[2][r], c[3][r]])
}

fn mesh_in_place(mesh: &Mesh, path: &str) -> Result<MeshData> {
    let n = mesh.positions.len();
    let (mut triangles, mut faces) = (Vec::new(), Vec::new());
    for (i, face) in mesh.faces.iter().enumerate() {
        let place = format!("{path}.faces[{i}]");
        if let Some(bad) = face.iter().find(|v| **v as usize >= n) {
            let error = BuildError::new(place, format!("vertex {bad} of a mesh that has {n}"));
            return Err(error.help(if n == 0 {
                "give `positions`".into()
            } else {
                format!("vertices count from 0 to {}", n - 1)
            }));
        }
        match face[..] {
            [a, b, c] => triangles.push([a, b, c]),
            [a, b, c, d] => triangles.extend([[a, b, c], [a, c, d]]),
            _ => {
                return Err(
                    BuildError::new(place, format!("a face of {} vertices", face.len())).help("give three or four")
                );
            }
        }
        faces.resize(triangles.len(), i);
    }
    let fits = |key: &str, length: Option<usize>| match length {
        Some(l) if l != n => Err(BuildError::new(format!("{path}.{key}"), format!("{l} {key} for {n} positions"))),
        _ => Ok(()),
    };
    fits("normals", mesh.normals.as_ref().map(Vec::len))?;
    fits("uvs", mesh.uvs.as_ref().map(Vec::len))?;
    let mut attributes = BTreeMap::new();
    for (name, values) in &mesh.attributes {
        let path = format!("{path}.attributes.{name}");
        let (wanted, of) = match name.split_once('_') {
            Some(("vertex", _)) => (n, "positions"),
            Some(("face", _)) => (mesh.faces.len(), "faces"),
            _ => {
                let error = BuildError::new(path, format!("\"{name}\" is of neither vertices nor faces"));
                return Err(error.help("names of attributes start with `vertex_` or `face_`"));
            }
        };
        if values.len() != wanted {
            return Err(BuildError::new(path, format!("{} values for {wanted} {of}", values.len())));
        }
        let values: Vec<[f32; 3]> = match of {
            "faces" => faces.iter().map(|face: &usize| values[*face].0).collect(),
            _ => values.iter().map(|c| c.0).collect(),
        };
        attributes.insert(name.clone(), values);
    }
    let (positions, normals, uvs) = (mesh.positions.clone(), mesh.normals.clone(), mesh.uvs.clone());
    Ok(MeshData { positions, normals, uvs, triangles, attributes })
}

/// η and k at the wavelengths of red, green and blue, from measured spectra (Johnson and Christy 1972; aluminium:
/// Rakić 1995) weighted by the colour matching functions.
fn index_of(metal: Metal) -> ([f32; 3], [f32; 3]) {
    match metal {
        Metal::Silver => ([0.155, 0.117, 0.138], [4.828, 3.122, 2.147]),
        Metal::Aluminium => ([1.657, 0.880, 0.521], [9.224, 6.270, 4.837]),
        Metal::Gold => ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603]),
        Metal::Copper => ([0.200, 0.924, 1.102], [3.912, 2.452, 2.142]),
    }
}
