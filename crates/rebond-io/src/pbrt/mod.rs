//! pbrt-v4 scenes (`.pbrt`), as its manual (Pharr, Jakob and Humphreys 2023) has them.
//!
//! | pbrt | rebond |
//! |---|---|
//! | the camera's x goes right | left: mirrored |
//! | a field of view across the shorter side | the same |
//! | `maxdepth` counts what comes after emission | `max_depth` counts that too: one more |
//! | opaque materials look the same from both sides | two-sided |
//! | spectra | linear Rec. 709 by [`spectra`](crate::mitsuba); light is scaled so that its luminance is what `scale` says |
//! | `roughness` is remapped unless told otherwise | α is its root |
//!
//! What rebond has no equal for is refused at its place, or left out with a warning if the import is lenient.

mod materials;
mod parse;
mod shapes;
mod textures;

use crate::error::Error;
use crate::import::{Assets, ImportOptions, Imported, Places, Report, even, field_of, steps};
use crate::mitsuba::spectra;
use glam::{DMat4, DVec3};
use parse::{Parameter, Parameters, Spot, Word, Words};
use rebond::film::FilterSettings;
use rebond::integrators::{BidirectionalSettings, IntegratorSettings, LightSettings, PathSettings};
use rebond::sampling::SamplerSettings;
use rebond::scene::SceneDescription;
use rebond::scene::description::{
    CameraDescription, Color, EmitterDescription, FovAxis, ImageTexture, InstanceDescription, MaterialRef,
    ShapeDescription, Transform,
};
use rebond::texture::{Encoding, TextureFilter, Wrap};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::io::Read;
use std::num::NonZeroU32;
use std::path::Path;

type Result<T, E = Error> = std::result::Result<T, E>;

/// Attributes within attributes.
const DEEPEST: usize = 4096;
/// How much larger than its file what was packed may become.
const MOST: u64 = 64;

/// Reads a scene; `file` is what errors call it, `folder` where its files are.
pub fn read_pbrt(text: &str, file: &str, folder: &Path, options: ImportOptions) -> Result<Imported> {
    let assets = Assets::new(folder, options);
    let opener = assets.clone();
    let mut importer = Importer {
        words: Words::new(text, file, &opener),
        report: Report { lenient: options.lenient, ..Report::default() },
        assets,
        scene: SceneDescription::default(),
        places: Places::default(),
        samples: None,
        state: State::default(),
        stack: Vec::new(),
        systems: BTreeMap::new(),
        textures: BTreeMap::new(),
        made: BTreeMap::new(),
        numbers: 0,
        group: None,
        camera: None,
        part: None,
        unnamed: Vec::new(),
        lying: BTreeSet::new(),
        cut: 0,
    };
    let filter = FilterSettings::Gaussian { stddev: 0.5, radius: Some(1.5) };
    (importer.scene.film.width, importer.scene.film.height) = (1280, 720);
    importer.scene.film.filter = filter;
    importer.scene.integrator = path(5);
    importer.run()?;
    Ok(Imported {
        description: importer.scene,
        files: importer.assets,
        warnings: importer.report.warnings,
        samples: importer.samples,
        places: importer.places.of(importer.words.sources.0),
    })
}

/// What a `.gz` file holds.
pub fn unpack(bytes: &[u8]) -> Result<Vec<u8>, String> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Err("it is not packed by gzip, though its name ends in .gz".into());
    }
    let limit = (bytes.len() as u64).saturating_mul(MOST).max(1 << 20);
    let mut out = Vec::new();
    flate2::read::MultiGzDecoder::new(bytes)
        .take(limit + 1)
        .read_to_end(&mut out)
        .map_err(|e| format!("cannot be unpacked: {e}"))?;
    if out.len() as u64 > limit {
        return Err(format!("it unpacks to more than {MOST} times its size"));
    }
    Ok(out)
}

fn path(depth: u32) -> IntegratorSettings {
    IntegratorSettings::Path(PathSettings {
        max_depth: NonZeroU32::new(depth.saturating_add(1)),
        ..PathSettings::default()
    })
}

/// What attributes save and bring back.
#[derive(Clone)]
struct State {
    matrix: DMat4,
    /// The name of the material.
    material: MaterialRef,
    /// What follows shines so.
    light: Option<Shine>,
    reverse: bool,
}

/// The radiance of an area light.
#[derive(Clone)]
struct Shine {
    /// What is the same everywhere,
    color: Color,
    /// times this.
    image: Option<ImageTexture>,
}

impl Default for State {
    fn default() -> Self {
        let grey = rebond::scene::description::Texture::grey(0.5);
        Self {
            matrix: DMat4::IDENTITY,
            material: materials::two_sided(materials::diffuse(grey)),
            light: None,
            reverse: false,
        }
    }
}

struct Importer<'a> {
    words: Words<'a>,
    report: Report,
    assets: Assets,
    scene: SceneDescription,
    places: Places,
    samples: Option<u32>,
    state: State,
    /// What has begun, by its directive.
    stack: Vec<(State, Spot, &'static str)>,
    systems: BTreeMap<String, DMat4>,
    /// By whether they are of numbers, not of colours, and by name.
    textures: BTreeMap<(bool, String), textures::Known>,
    /// Images made of others, by what they are.
    made: BTreeMap<String, String>,
    /// Numbers in them.
    numbers: usize,
    /// The object that is being defined: its name, and its shapes.
    group: Option<(String, Vec<ShapeDescription>)>,
    camera: Option<(String, Parameters, Spot, DMat4)>,
    /// The part of the picture that is wanted: its place and its size.
    part: Option<[u32; 4]>,
    /// Materials without a name: what stands for it, what they are to be called, and where they are.
    unnamed: Vec<(String, String, Spot)>,
    /// Names of those materials of which it matters where on a surface they are.
    lying: BTreeSet<String>,
    /// Triangles made by cutting so far.
    cut: usize,
}

impl Importer<'_> {
    fn error(&self, at: Spot, message: impl Into<String>) -> Error {
        self.words.sources.error(at, message)
    }

    fn unsupported(&mut self, at: Spot, message: impl Into<String>) -> Result<()> {
        let error = self.error(at, message);
        self.report.unsupported(error)
    }

    fn warn(&mut self, at: Spot, message: impl Into<String>) {
        let error = self.error(at, message);
        self.report.warn(error);
    }

    fn finish(&mut self, p: &Parameters, what: &str) -> Result<()> {
        for unused in p.unused() {
            self.unsupported(unused.at, format!("\"{}\" means nothing to {what}", unused.name))?;
        }
        Ok(())
    }

    fn number(&self, p: &Parameters, name: &str, default: f64) -> Result<f32> {
        match p.get(name) {
            None => Ok(default as f32),
            Some(q) => match q.numbers[..] {
                [x] => Ok(x as f32),
                _ => Err(self.error(q.at, format!("\"{name}\" is one number"))),
            },
        }
    }

    fn count(&self, p: &Parameters, name: &str, default: u32) -> Result<u32> {
        match p.get(name) {
            None => Ok(default),
            Some(q) => match q.numbers[..] {
                [x] if x >= 0.0 && x.fract() == 0.0 && x <= f64::from(u32::MAX) => Ok(x as u32),
                _ => Err(self.error(q.at, format!("\"{name}\" is a whole number that is not negative"))),
            },
        }
    }

    fn flag(&self, p: &Parameters, name: &str, default: bool) -> Result<bool> {
        match p.get(name).map(|q| (q, &q.words[..])) {
            None => Ok(default),
            Some((_, [word])) if word == "true" => Ok(true),
            Some((_, [word])) if word == "false" => Ok(false),
            Some((q, _)) => Err(self.error(q.at, format!("\"{name}\" is true or false"))),
        }
    }

    fn word(&self, p: &Parameters, name: &str) -> Result<Option<(String, Spot)>> {
        match p.get(name).map(|q| (q, &q.words[..])) {
            None => Ok(None),
            Some((q, [word])) => Ok(Some((word.clone(), q.at))),
            Some((q, _)) => Err(self.error(q.at, format!("\"{name}\" is one string"))),
        }
    }

    fn vector(&self, p: &Parameters, name: &str, default: DVec3) -> Result<DVec3> {
        match p.get(name) {
            None => Ok(default),
            Some(q) => match q.numbers[..] {
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                _ => Err(self.error(q.at, format!("\"{name}\" is three numbers"))),
            },
        }
    }

    /// Where a file is: in the scene's folder, whichever file names it.
    fn find(&self, name: &str, at: Spot) -> Result<String> {
        self.assets.path(name).map_err(|m| self.error(at, m))?;
        Ok(name.to_string())
    }

    fn run(&mut self) -> Result<()> {
        while self.step()? {}
        if let Some((_, at, _)) = self.stack.last() {
            return Err(self.error(*at, "this does not end"));
        }
        if self.group.is_some() {
            return self.words.fail("ObjectBegin without ObjectEnd");
        }
        self.name_materials();
        self.finish_camera()
    }

    /// The next directive, if there is one.
    fn step(&mut self) -> Result<bool> {
        match self.words.next()? {
            Some((Word::Bare(directive), at)) => self.directive(&directive, at).map(|()| true),
            Some((_, at)) => Err(self.error(at, "expected a directive such as Shape")),
            None => Ok(false),
        }
    }

    fn directive(&mut self, directive: &str, at: Spot) -> Result<()> {
        match directive {
            "Identity" => self.state.matrix = DMat4::IDENTITY,
            "Translate" => {
                let [x, y, z] = self.words.numbers()?;
                self.state.matrix *= DMat4::from_translation(DVec3::new(x, y, z));
            }
            "Scale" => {
                let [x, y, z] = self.words.numbers()?;
                self.state.matrix *= DMat4::from_scale(DVec3::new(x, y, z));
            }
            "Rotate" => {
                let [angle, x, y, z] = self.words.numbers()?;
                let axis = DVec3::new(x, y, z).try_normalize();
                let axis = axis.ok_or_else(|| self.error(at, "the axis of a rotation is zero"))?;
                self.state.matrix *= DMat4::from_axis_angle(axis, angle.to_radians());
            }
            "LookAt" => {
                let [ex, ey, ez, lx, ly, lz, ux, uy, uz] = self.words.numbers()?;
                let (eye, look, up) = (DVec3::new(ex, ey, ez), DVec3::new(lx, ly, lz), DVec3::new(ux, uy, uz));
                let z = (look - eye).try_normalize().ok_or_else(|| self.error(at, "the eye is where it looks"))?;
                let x =
                    up.cross(z).try_normalize().ok_or_else(|| self.error(at, "up is along the direction of view"))?;
                // pbrt is left-handed: up × forward is right.
                let place = DMat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), eye.extend(1.0));
                self.state.matrix *= place.inverse();
            }
            "Transform" | "ConcatTransform" => {
                let m = DMat4::from_cols_array(&self.words.numbers()?);
                if m.row(3) != glam::DVec4::W {
                    let error = self.error(at, "this transform is not affine");
                    return Err(error.with_help("the last of each four numbers are 0, 0, 0 and 1"));
                }
                self.state.matrix = if directive == "Transform" { m } else { self.state.matrix * m };
            }
            "CoordinateSystem" => {
                let (name, _) = self.words.quoted("a name")?;
                self.systems.insert(name, self.state.matrix);
            }
            "CoordSysTransform" => {
                let (name, at) = self.words.quoted("a name")?;
                match self.systems.get(&name) {
                    Some(m) => self.state.matrix = *m,
                    None => return Err(self.error(at, format!("there is no coordinate system \"{name}\""))),
                }
            }
            "ReverseOrientation" => self.state.reverse = !self.state.reverse,
            "AttributeBegin" | "TransformBegin" => {
                if self.stack.len() > DEEPEST {
                    return Err(self.error(at, format!("more than {DEEPEST} attributes within each other")));
                }
                let begun = if directive == "AttributeBegin" { "AttributeBegin" } else { "TransformBegin" };
                self.stack.push((self.state.clone(), at, begun));
            }
            "AttributeEnd" | "TransformEnd" => match self.stack.pop() {
                Some((state, _, "AttributeBegin")) if directive == "AttributeEnd" => self.state = state,
                Some((state, _, "TransformBegin")) if directive == "TransformEnd" => self.state.matrix = state.matrix,
                Some((_, _, begun)) => {
                    return Err(self.error(at, format!("{directive}, where what began last is {begun}")));
                }
                None => return Err(self.error(at, format!("{directive} without a beginning"))),
            },
            "WorldBegin" => {
                self.state.matrix = DMat4::IDENTITY;
                self.systems.insert("world".into(), DMat4::IDENTITY);
            }
            "Include" => {
                let (name, at) = self.words.quoted("a file")?;
                let file = self.find(&name, at)?;
                self.words.include(&file, at)?;
            }
            "Import" => self.import()?,
            "ObjectBegin" => {
                let (name, at) = self.words.quoted("a name")?;
                if self.group.is_some() || self.scene.groups.contains_key(&name) {
                    return Err(self.error(at, format!("the object \"{name}\" is within another, or there twice")));
                }
                self.stack.push((self.state.clone(), at, "ObjectBegin"));
                self.group = Some((name, Vec::new()));
            }
            "ObjectEnd" => {
                let (Some((name, shapes)), Some((state, _, "ObjectBegin"))) = (self.group.take(), self.stack.pop())
                else {
                    return Err(self.error(at, "ObjectEnd without ObjectBegin"));
                };
                self.state = state;
                self.scene.groups.insert(name, shapes);
            }
            "ObjectInstance" => {
                let (name, at) = self.words.quoted("a name")?;
                if self.group.is_some() {
                    return self.unsupported(at, "an instance within an object");
                }
                let instance = InstanceDescription { group: name, to_world: steps(self.state.matrix) };
                self.push(at, ShapeDescription::Instance(instance));
            }
            "Camera" => {
                let (kind, at) = self.words.quoted("a camera")?;
                let parameters = self.words.parameters()?;
                // The matrix takes the world to the camera.
                let place = self.state.matrix.inverse();
                if self.state.matrix.determinant() == 0.0 || !self.state.matrix.is_finite() || !place.is_finite() {
                    return Err(self.error(at, "the camera's transform has no inverse"));
                }
                self.systems.insert("camera".into(), place);
                self.camera = Some((kind, parameters, at, place));
            }
            "Film" => self.film()?,
            "Sampler" => self.sampler()?,
            "Integrator" => self.integrator()?,
            "PixelFilter" => self.filter()?,
            "Shape" => self.shape()?,
            "Material" | "MakeNamedMaterial" => self.material(directive == "MakeNamedMaterial")?,
            "NamedMaterial" => {
                let (name, _) = self.words.quoted("a name")?;
                self.state.material = MaterialRef::Named(name);
            }
            "Texture" => self.define_texture()?,
            "LightSource" => self.light()?,
            "AreaLightSource" => {
                let (kind, at) = self.words.quoted("a light")?;
                let p = self.words.parameters()?;
                if kind != "diffuse" {
                    self.unsupported(at, format!("the area light \"{kind}\" is not supported"))?;
                    return Ok(());
                }
                let image = self.shining_image(&p)?;
                if self.flag(&p, "twosided", false)? {
                    self.unsupported(at, "a light that shines to both sides: it shines to that of its normal")?;
                }
                if let Some(q) = p.get("power") {
                    self.unsupported(q.at, "an area light given by its power")?;
                }
                self.state.light = Some(Shine { color: self.emitted(&p, "L")?, image });
                self.finish(&p, "an area light")?;
            }
            "Accelerator" | "ColorSpace" | "Option" => {
                // How pbrt finds hits and what else only it has; colours are Rec. 709 unless told otherwise.
                if directive == "Option" {
                    self.words.parameters()?;
                } else {
                    let (name, at) = self.words.quoted("a name")?;
                    self.words.parameters()?;
                    if directive == "ColorSpace" && name != "srgb" {
                        self.unsupported(at, format!("the colour space \"{name}\": sRGB's primaries are"))?;
                    }
                }
            }
            "MediumInterface" | "MakeNamedMedium" => {
                self.unsupported(at, "media are not supported")?;
                while let Some(Word::Quoted(_)) = self.words.peek()? {
                    // Names of media have no type; what follows them does.
                    if directive == "MediumInterface" {
                        self.words.next()?;
                    } else {
                        self.words.next()?;
                        self.words.parameters()?;
                    }
                }
            }
            "Attribute" => {
                self.unsupported(at, "parameters that hold for all that follows")?;
                self.words.quoted("what they are for")?;
                self.words.parameters()?;
            }
            "ActiveTransform" | "TransformTimes" => {
                self.unsupported(at, "motion")?;
                while matches!(self.words.peek()?, Some(Word::Bare(w)) if w.parse::<f64>().is_ok() || matches!(&**w, "All" | "StartTime" | "EndTime"))
                {
                    self.words.next()?;
                }
            }
            _ => return Err(self.error(at, format!("{directive} is no directive of pbrt-v4"))),
        }
        Ok(())
    }

    /// A file whose attributes are its own.
    fn import(&mut self) -> Result<()> {
        let (name, at) = self.words.quoted("a file")?;
        let file = self.find(&name, at)?;
        let (state, depth, outer) = (self.state.clone(), self.words.depth(), self.stack.len());
        self.words.include(&file, at)?;
        // A file is closed when something is wanted beyond its end.
        while self.words.peek()?.is_some() && self.words.depth() > depth {
            self.step()?;
        }
        if self.stack.len() != outer {
            return Err(self.error(at, "attributes begin or end in this file that do not within it"));
        }
        self.state = state;
        Ok(())
    }

    fn push(&mut self, at: Spot, shape: ShapeDescription) {
        let path = match &self.group {
            Some((name, shapes)) => format!("groups.{name}[{}]", shapes.len()),
            None => format!("shapes[{}]", self.scene.shapes.len()),
        };
        self.places.note(path, at.part());
        match &mut self.group {
            Some((_, shapes)) => shapes.push(shape),
            None => self.scene.shapes.push(shape),
        }
    }

    // ---- light ----

    /// The factor by which a light of luminance 1 has the `power` or `illuminance` that is asked for, where that is `whole`.
    fn power(&mut self, p: &Parameters, name: &str, whole: f64) -> Result<f32> {
        Ok(match self.number(p, name, -1.0)? {
            x if x > 0.0 => (f64::from(x) / whole) as f32,
            _ => 1.0,
        })
    }

    /// What a light sends out, of luminance `scale` if it is a spectrum.
    fn emitted(&mut self, p: &Parameters, name: &str) -> Result<Color> {
        let scale = self.number(p, "scale", 1.0)?;
        let color = match p.get(name) {
            None => [1.0; 3],
            Some(q) => self.light_color(q)?,
        };
        Ok(Color(color.map(|x| x as f32 * scale)))
    }

    /// The image of an area light: linear between its texels, and beyond its rim as there.
    fn shining_image(&mut self, p: &Parameters) -> Result<Option<ImageTexture>> {
        let Some((name, at)) = self.word(p, "filename")? else { return Ok(None) };
        if let Some(q) = p.get("L") {
            return Err(self.error(q.at, "an area light has either L or an image, not both"));
        }
        Ok(Some(ImageTexture {
            image: self.find(&name, at)?,
            encoding: Encoding::Auto,
            wrap: Wrap::Clamp,
            wrap_v: None,
            filter: TextureFilter::Bilinear,
            repeat: [1.0; 2],
            to_uv: None,
            channel: None,
        }))
    }

    fn light_color(&mut self, q: &Parameter) -> Result<[f64; 3]> {
        let of_luminance_one = |c: [f64; 3]| {
            let y = 0.212_671 * c[0] + 0.715_160 * c[1] + 0.072_169 * c[2];
            if y > 0.0 { c.map(|x| x / y) } else { c }
        };
        match (&*q.kind, &q.numbers[..], &q.words[..]) {
            ("rgb", &[r, g, b], _) => Ok([r, g, b]),
            ("blackbody", &[t], _) if t > 0.0 => Ok(of_luminance_one(spectra::blackbody(t))),
            ("spectrum", pairs, []) if !pairs.is_empty() => {
                let samples = self.samples(q)?;
                Ok(of_luminance_one(spectra::of_samples(&samples, spectra::Use::Light)))
            }
            ("spectrum", _, [name]) if name.starts_with("stdillum-D65") => Ok([1.0; 3]),
            ("spectrum", _, [name]) => {
                self.unsupported(q.at, format!("the spectrum \"{name}\": white is"))?;
                Ok([1.0; 3])
            }
            _ => Err(self.error(q.at, format!("\"{}\" is a colour: rgb, blackbody or spectrum", q.name))),
        }
    }

    fn samples(&self, q: &Parameter) -> Result<Vec<(f64, f64)>> {
        let samples: Vec<(f64, f64)> = q.numbers.chunks_exact(2).map(|p| (p[0], p[1])).collect();
        if !q.numbers.len().is_multiple_of(2) || !samples.windows(2).all(|p| p[0].0 < p[1].0) {
            return Err(self.error(q.at, "a spectrum is pairs of growing wavelengths and values"));
        }
        Ok(samples)
    }

    fn light(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a light")?;
        let p = self.words.parameters()?;
        let m = self.state.matrix;
        let point = |p: DVec3| m.transform_point3(p);
        let (from, to) = (self.vector(&p, "from", DVec3::ZERO)?, self.vector(&p, "to", DVec3::Z)?);
        let array = |v: DVec3| v.as_vec3().to_array();
        let emitter = match &*kind {
            "point" => {
                let intensity = times(self.emitted(&p, "I")?, self.power(&p, "power", 4.0 * PI)?);
                EmitterDescription::Point { position: array(point(from)), to_world: Transform::default(), intensity }
            }
            "distant" => {
                let irradiance = times(self.emitted(&p, "L")?, self.power(&p, "illuminance", 1.0)?);
                EmitterDescription::Directional { direction: array(m.transform_vector3(to - from)), irradiance }
            }
            "spot" => {
                let (cone, delta) = (self.number(&p, "coneangle", 30.0)?, self.number(&p, "conedeltaangle", 5.0)?);
                let beam = (cone - delta).max(0.0);
                let [full, none] = [beam, cone].map(|a| f64::from(a).to_radians().cos());
                let whole = 2.0 * PI * (1.0 - full + (full - none) / 2.0);
                let intensity = times(self.emitted(&p, "I")?, self.power(&p, "power", whole)?);
                if beam != cone {
                    self.warn(at, "towards its edge a spot's light falls off linearly with the angle");
                }
                if !even(m) {
                    self.unsupported(at, "a spot whose cone is stretched or sheared: it is round")?;
                }
                let Some(z) = m.transform_vector3(to - from).try_normalize() else {
                    return Err(self.error(at, "a spot that points nowhere"));
                };
                let (x, y) = z.any_orthonormal_pair();
                let place = DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), point(from).extend(1.0));
                EmitterDescription::Spot {
                    to_world: steps(place),
                    intensity,
                    cutoff_angle: cone,
                    beam_width: Some(beam),
                }
            }
            "projection" => {
                let Some((name, at)) = self.word(&p, "filename")? else {
                    return Err(self.error(at, "a projection light without a filename"));
                };
                if let Some(q) = p.get("power") {
                    self.unsupported(q.at, "a projection light given by its power")?;
                }
                if !even(m) {
                    return Err(
                        self.error(at, "a projection light can be turned and mirrored, but not stretched or sheared")
                    );
                }
                let (file, scale, fov) =
                    (self.find(&name, at)?, self.number(&p, "scale", 1.0)?, self.number(&p, "fov", 90.0)?);
                let [width, height] = self.size_of(&file, at)?.map(f64::from);
                EmitterDescription::Projector {
                    // The image's left is towards −x.
                    to_world: steps(m * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0))),
                    file,
                    encoding: Encoding::Auto,
                    filter: TextureFilter::Nearest,
                    wrap: Wrap::Clamp,
                    fov: field_of(width, fov, width.min(height)),
                    aspect: None,
                    intensity: Color([scale; 3]),
                    even: false,
                    cutoff_angle: None,
                    beam_width: None,
                }
            }
            "goniometric" if p.get("filename").is_none() => {
                let intensity = times(self.emitted(&p, "I")?, self.power(&p, "power", 4.0 * PI)?);
                let position = array(m.w_axis.truncate());
                EmitterDescription::Point { position, to_world: Transform::default(), intensity }
            }
            "goniometric" => {
                let Some((name, at)) = self.word(&p, "filename")? else { return Ok(()) };
                let (file, intensity) = (self.find(&name, at)?, self.emitted(&p, "I")?);
                if let Some(q) = p.get("power") {
                    self.unsupported(q.at, "a goniometric light given by its power")?;
                }
                if !even(m) {
                    let message = "a goniometric light can be turned and mirrored, but not stretched or sheared";
                    return Err(self.error(at, message));
                }
                self.warn(at, "its square is resampled to an equirectangular image");
                // The mean of the channels counts.
                let image = self.sky(&file, at)?;
                let grey = |c: &[f32; 3]| [c.iter().sum::<f32>() / 3.0; 3];
                let texels: Vec<[f32; 3]> = image.rgb("").unwrap_or_default().iter().map(grey).collect();
                let image = rebond::film::Image::from_rgb(image.width, image.height, &texels);
                // Here y is up, and x where φ is 0.
                let axes =
                    DMat4::from_cols(DVec3::Z.extend(0.0), DVec3::Y.extend(0.0), DVec3::X.extend(0.0), glam::DVec4::W);
                let file = self.assets.add_image("goniometric", image);
                EmitterDescription::Goniometric { to_world: steps(m * axes), file, intensity }
            }
            "infinite" if p.get("filename").is_none() => {
                let radiance = times(self.emitted(&p, "L")?, self.power(&p, "illuminance", PI)?);
                EmitterDescription::Constant { radiance }
            }
            "infinite" => {
                let Some((name, at)) = self.word(&p, "filename")? else { return Ok(()) };
                let file = self.find(&name, at)?;
                let scale = self.number(&p, "scale", 1.0)?;
                if let Some(q) = p.get("illuminance") {
                    self.unsupported(q.at, "an image of everywhere given by its illuminance")?;
                }
                if !even(m) {
                    return Err(
                        self.error(at, "an environment can be turned and mirrored, but not stretched or sheared")
                    );
                }
                self.warn(at, "its square is resampled to an equirectangular image");
                let image = self.sky(&file, at)?;
                let file = self.assets.add_image("sky", image);
                // The image's z is up, and x where φ is 0; rebond's y is up, and −z its centre.
                let axes =
                    DMat4::from_cols(DVec3::Y.extend(0.0), DVec3::Z.extend(0.0), DVec3::X.extend(0.0), glam::DVec4::W);
                let mut turned = m * axes;
                turned.w_axis = glam::DVec4::W;
                EmitterDescription::Envmap { file, scale, blur: None, to_world: steps(turned) }
            }
            _ => {
                self.unsupported(at, format!("the light \"{kind}\" is not supported"))?;
                return Ok(());
            }
        };
        self.finish(&p, &format!("the light \"{kind}\""))?;
        self.places.note(format!("emitters[{}]", self.scene.emitters.len()), at.part());
        self.scene.emitters.push(emitter);
        Ok(())
    }

    // ---- what comes before the world ----

    /// The part of the screen that the picture shows: its centre and its size.
    fn window(&mut self, p: &Parameters, aspect: f64) -> Result<[[f64; 2]; 2]> {
        if let Some(q) = p.get("frameaspectratio")
            && (f64::from(self.number(p, "frameaspectratio", aspect)?) / aspect - 1.0).abs() > 1e-3
        {
            self.unsupported(q.at, "a frameaspectratio that is not the picture's: pixels are square")?;
        }
        let whole = [2.0 * aspect.max(1.0), 2.0 / aspect.min(1.0)];
        let Some(q) = p.get("screenwindow") else { return Ok([[0.0; 2], whole]) };
        let [x0, x1, y0, y1] = q.numbers[..] else {
            return Err(self.error(q.at, "a screenwindow is four numbers"));
        };
        let (w, h) = (x1 - x0, y1 - y0);
        if !(w > 0.0 && h > 0.0) {
            return Err(self.error(q.at, "a screenwindow without an area"));
        }
        if (w / h / aspect - 1.0).abs() > 1e-3 {
            self.unsupported(q.at, "a screenwindow of other proportions than the picture: pixels are square")?;
        }
        Ok([[(x0 + x1) / 2.0, (y0 + y1) / 2.0], [w, h]])
    }

    fn finish_camera(&mut self) -> Result<()> {
        let Some((kind, p, at, place)) = self.camera.take() else {
            return self.words.fail("the scene has no Camera");
        };
        let (w, h) = (f64::from(self.scene.film.width), f64::from(self.scene.film.height));
        // pbrt's x goes right.
        let m = place * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let [centre, window] = self.window(&p, w / h)?;
        // How much larger it is than without `screenwindow`.
        let larger = window[0].min(window[1]) / 2.0;
        let (shutter_open, shutter_close) =
            (self.number(&p, "shutteropen", 0.0)?, self.number(&p, "shutterclose", 1.0)?);
        // Nothing moves: when it is open does not matter.
        let (shutter_open, shutter_close) =
            if shutter_open <= shutter_close { (0.0, 0.0) } else { (shutter_open, shutter_close) };
        let radius = self.number(&p, "lensradius", 0.0)?;
        let focus = self.number(&p, "focaldistance", 1e6)?;
        let to_world = steps(m);
        let mut camera = match &*kind {
            "perspective" => {
                let fov = f64::from(self.number(&p, "fov", 90.0)?);
                let wider = ((fov.to_radians() / 2.0).tan() * larger).atan().to_degrees() * 2.0;
                let fov = (if larger == 1.0 { fov } else { wider }) as f32;
                let fov_axis = FovAxis::Smaller;
                let offset = [centre[0] / window[0], -centre[1] / window[1]].map(|x| x as f32);
                if radius > 0.0 {
                    CameraDescription::ThinLens {
                        to_world,
                        fov,
                        fov_axis,
                        principal_point_offset: offset,
                        near_clip: 0.0,
                        aperture_radius: radius,
                        aperture_blades: 0,
                        aperture_rotation: 0.0,
                        focus_distance: focus,
                        shutter_open,
                        shutter_close,
                    }
                } else {
                    CameraDescription::Perspective {
                        to_world,
                        fov,
                        fov_axis,
                        principal_point_offset: offset,
                        near_clip: 0.0,
                        shutter_open,
                        shutter_close,
                    }
                }
            }
            "orthographic" => {
                if radius > 0.0 {
                    self.unsupported(at, "a lens of an orthographic camera")?;
                }
                let scale = (w / h).max(1.0) * larger;
                // m's x goes left.
                let moved = DMat4::from_translation(DVec3::new(-centre[0], centre[1], 0.0));
                let to_world = steps(m * moved * DMat4::from_scale(DVec3::new(scale, scale, 1.0)));
                CameraDescription::Orthographic { to_world, shutter_open, shutter_close }
            }
            _ => {
                self.unsupported(at, format!("the camera \"{kind}\" is not supported"))?;
                CameraDescription::default()
            }
        };
        self.finish(&p, &format!("the camera \"{kind}\""))?;
        if let Some(part) = self.part {
            crate::import::cut(&mut camera, [self.scene.film.width, self.scene.film.height], part);
            (self.scene.film.width, self.scene.film.height) = (part[2], part[3]);
        }
        self.places.note("camera", at.part());
        self.scene.camera = camera;
        Ok(())
    }

    fn film(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a film")?;
        let p = self.words.parameters()?;
        if !matches!(&*kind, "rgb" | "gbuffer") {
            self.unsupported(at, format!("the film \"{kind}\" is not supported"))?;
        }
        (self.scene.film.width, self.scene.film.height) =
            (self.count(&p, "xresolution", 1280)?, self.count(&p, "yresolution", 720)?);
        for name in ["filename", "diagonal", "savefp16", "coordinatesystem"] {
            // How pbrt writes its picture.
            let _ = p.get(name);
        }
        // pbrt's own values say nothing.
        let own: [(&str, &[f64]); 5] = [
            ("sensor", &[]),
            ("iso", &[100.0]),
            ("exposuretime", &[1.0]),
            ("whitebalance", &[0.0]),
            ("maxcomponentvalue", &[]),
        ];
        for (name, value) in own {
            if let Some(q) = p.get(name)
                && q.words[..] != ["cie1931"]
                && (value.is_empty() || q.numbers[..] != *value)
            {
                self.unsupported(q.at, format!("a film's {name}"))?;
            }
        }
        self.part = self.part_of_film(&p)?;
        self.places.note("film", at.part());
        self.finish(&p, "a film")
    }

    /// The part of the picture that a film keeps, if it is not the whole.
    fn part_of_film(&self, p: &Parameters) -> Result<Option<[u32; 4]>> {
        let full = [self.scene.film.width, self.scene.film.height].map(f64::from);
        let (q, pixels) = match (p.get("pixelbounds"), p.get("cropwindow")) {
            (None, None) => return Ok(None),
            (Some(q), None) => (q, [1.0; 2]),
            (None, Some(q)) => (q, full),
            (Some(_), Some(q)) => return Err(self.error(q.at, "either pixelbounds or a cropwindow, not both")),
        };
        let [x0, x1, y0, y1] = q.numbers[..] else {
            return Err(self.error(q.at, format!("a {} is four numbers", q.name)));
        };
        let along = |from: f64, to: f64, i: usize| {
            let [from, to] = [from, to].map(|x| (x * pixels[i]).ceil().clamp(0.0, full[i]));
            [from, (to - from).max(0.0)]
        };
        let ([x, w], [y, h]) = (along(x0, x1, 0), along(y0, y1, 1));
        if !(w > 0.0 && h > 0.0) {
            return Err(self.error(q.at, "nothing of the picture is left"));
        }
        let part = [x, y, w, h].map(|x| x as u32);
        Ok((part != [0, 0, self.scene.film.width, self.scene.film.height]).then_some(part))
    }

    fn filter(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a filter")?;
        let p = self.words.parameters()?;
        let (dx, third) = (
            if kind == "box" {
                0.5
            } else if kind == "gaussian" {
                1.5
            } else {
                2.0
            },
            1.0 / 3.0,
        );
        let (x, y) = (self.number(&p, "xradius", dx)?, self.number(&p, "yradius", dx)?);
        if x != y {
            self.unsupported(at, "a filter that is wider one way than the other")?;
        }
        self.scene.film.filter = match &*kind {
            "box" => FilterSettings::Box { radius: x },
            "triangle" => FilterSettings::Tent { radius: x },
            "gaussian" => {
                let stddev = self.number(&p, "sigma", 0.5)?;
                // Farther off it is nothing.
                FilterSettings::Gaussian { stddev, radius: Some(x.min(8.0 * stddev)) }
            }
            "mitchell" if x == 2.0 => {
                FilterSettings::Mitchell { b: self.number(&p, "B", third)?, c: self.number(&p, "C", third)? }
            }
            _ => {
                self.unsupported(at, format!("the filter \"{kind}\" of this width is not supported"))?;
                return Ok(());
            }
        };
        self.finish(&p, &format!("the filter \"{kind}\""))
    }

    fn sampler(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("a sampler")?;
        let p = self.words.parameters()?;
        let mut samples = self.count(&p, "pixelsamples", 16)?;
        self.scene.sampler = match &*kind {
            "independent" => SamplerSettings::Independent {},
            "stratified" => {
                samples = self.count(&p, "xsamples", 4)?.saturating_mul(self.count(&p, "ysamples", 4)?);
                SamplerSettings::Stratified { samples: 0 }
            }
            // All are low-discrepancy sequences.
            "halton" | "sobol" | "paddedsobol" | "zsobol" | "pmj02bn" => SamplerSettings::Sobol {},
            _ => {
                self.unsupported(at, format!("the sampler \"{kind}\" is not supported"))?;
                SamplerSettings::Sobol {}
            }
        };
        for name in ["seed", "randomization", "jitter"] {
            let _ = p.get(name);
        }
        self.samples = Some(samples.max(1));
        self.finish(&p, &format!("the sampler \"{kind}\""))
    }

    fn integrator(&mut self) -> Result<()> {
        let (kind, at) = self.words.quoted("an integrator")?;
        let p = self.words.parameters()?;
        let depth = self.count(&p, "maxdepth", 5)?;
        let max_depth = NonZeroU32::new(depth.saturating_add(1));
        for name in [
            "lightsampler",
            "regularize",
            "rrthreshold",
            "samplelights",
            "samplebsdf",
            "visualizestrategies",
            "visualizeweights",
        ] {
            if let Some(q) = p.get(name)
                && name == "regularize"
                && q.words[..] == ["true"]
            {
                self.unsupported(q.at, "regularised materials")?;
            }
        }
        self.scene.integrator = match &*kind {
            "path" | "volpath" | "simplepath" | "randomwalk" => path(depth),
            "bdpt" => IntegratorSettings::Bidirectional(BidirectionalSettings {
                max_depth,
                ..BidirectionalSettings::default()
            }),
            "lightpath" => IntegratorSettings::Light(LightSettings { max_depth, ..LightSettings::default() }),
            _ => {
                self.unsupported(at, format!("the integrator \"{kind}\": path is"))?;
                path(depth)
            }
        };
        self.places.note("integrator", at.part());
        self.finish(&p, &format!("the integrator \"{kind}\""))
    }
}

/// A factor on a colour.
fn times(Color(c): Color, factor: f32) -> Color {
    Color(c.map(|x| x * factor))
}

#[cfg(test)]
mod tests;
