//! Mitsuba 3 scenes (XML), read as its `rgb` variants read them.
//!
//! | Mitsuba | rebond |
//! |---|---|
//! | v of textures grows downwards | upwards: every image gets a map of (u, v) that puts it upright for the shape it is on |
//! | an environment's rows reach from pole to pole | are bands: it is resampled (`emitters.rs`) |
//! | a cylinder | a prism of many sides with smooth normals (`shapes.rs`) |
//! | spectra | integrated into linear Rec. 709 (`spectra.rs`) |
//!
//! All else has the same meaning, since rebond took Mitsuba's names. What rebond has no equal for is refused at its place, or left
//! out with a warning if the import is lenient. A few models are only nearly the same; that is always said.

mod emitters;
mod materials;
pub(crate) mod metals;
mod sensors;
mod serialized;
mod shapes;
pub(crate) mod spectra;
mod textures;
mod xml;

use crate::error::Error;
use crate::import::{Assets, ImportOptions, Imported, Places, Report};
use glam::{DMat4, DVec3};
use rebond::scene::SceneDescription;
use rebond::scene::description::Color;
use spectra::Use;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::rc::Rc;
use xml::{Object, Property, Spot, Value};

/// Reads a scene; `file` is what errors call it, `folder` where its files are.
pub fn read_mitsuba(text: &str, file: &str, folder: &Path, options: ImportOptions) -> Result<Imported, Error> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let assets = Assets::new(folder, options);
    let tree = xml::read(text, file, &assets)?;
    let mut importer = Importer {
        root: tree.root,
        ids: tree.ids,
        paths: tree.paths,
        sources: tree.sources,
        report: Report { lenient: options.lenient, ..Report::default() },
        assets,
        scene: SceneDescription::default(),
        places: Places::default(),
        samples: None,
        named: HashMap::new(),
        groups: BTreeMap::new(),
        resolving: Vec::new(),
    };
    importer.scene()?;
    Ok(Imported {
        description: importer.scene,
        files: importer.assets,
        warnings: importer.report.warnings,
        samples: importer.samples,
        places: importer.places.of(importer.sources.0),
    })
}

/// A scene on its way from objects to a description.
struct Importer {
    root: Rc<Object>,
    ids: BTreeMap<String, Rc<Object>>,
    paths: Vec<String>,
    sources: xml::Sources,
    report: Report,
    assets: Assets,
    scene: SceneDescription,
    places: Places,
    samples: Option<u32>,
    /// Materials known so far, by object and by how its textures lie, with their names.
    named: HashMap<(*const Object, textures::Lie), String>,
    /// Groups by the address of their object.
    groups: BTreeMap<usize, String>,
    /// Objects that are being translated; one that refers to itself is among them.
    resolving: Vec<*const Object>,
}

type Result<T, E = Error> = std::result::Result<T, E>;

/// Objects within each other, by reference or in place.
const DEEPEST: usize = 32;

impl Importer {
    fn error(&self, at: &Spot, message: impl Into<String>) -> Error {
        self.sources.error(at, message)
    }

    /// Something that rebond has no equal for.
    fn unsupported(&mut self, at: &Spot, message: impl Into<String>) -> Result<()> {
        let error = self.sources.error(at, message);
        self.report.unsupported(error)
    }

    fn warn(&mut self, at: &Spot, message: impl Into<String>) {
        let error = self.sources.error(at, message);
        self.report.warn(error);
    }

    /// A plugin that rebond does not have.
    fn unknown_plugin(&mut self, o: &Object) -> Result<()> {
        self.unsupported(&o.at, format!("the {} \"{}\" is not supported", o.tag, o.plugin))
    }

    /// What of an object nobody has read.
    fn finish(&mut self, o: &Object) -> Result<()> {
        for p in o.unused() {
            let what = if p.name.is_empty() { p.kind().to_string() } else { format!("\"{}\"", p.name) };
            let message = format!("{what} means nothing to the {} \"{}\"", o.tag, o.plugin);
            self.unsupported(&p.at, message)?;
        }
        Ok(())
    }

    /// The object that a property is or refers to.
    fn object(&self, p: &Property) -> Result<Option<Rc<Object>>> {
        match &p.value {
            Value::Object(o) => Ok(Some(o.clone())),
            Value::Ref(id) => match self.ids.get(id) {
                Some(o) => Ok(Some(o.clone())),
                None => {
                    let known: Vec<&str> = self.ids.keys().map(String::as_str).collect();
                    let error = self.error(&p.at, format!("there is no object with the id \"{id}\""));
                    Err(match crate::deserialize::nearest(id, &known) {
                        Some(near) => error.with_help(format!("did you mean \"{near}\"?")),
                        None => error,
                    })
                }
            },
            _ => Ok(None),
        }
    }

    /// The objects of an object that have one of these tags, in order. They are used thereby.
    fn children(&self, o: &Object, tags: &[&str]) -> Result<Vec<(Rc<Object>, Spot)>> {
        let mut found = Vec::new();
        for p in &o.properties {
            if let Some(child) = self.object(p)?
                && tags.contains(&child.tag.as_str())
            {
                found.push((child, p.mark().at.clone()));
            }
        }
        Ok(found)
    }

    /// Goes on with an object, unless it contains itself.
    fn within<T>(&mut self, o: &Rc<Object>, at: &Spot, f: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let address = Rc::as_ptr(o);
        if self.resolving.contains(&address) || self.resolving.len() > DEEPEST {
            return Err(self.error(at, format!("this {} contains itself, or is nested too deeply", o.tag)));
        }
        self.resolving.push(address);
        let result = f(self);
        self.resolving.pop();
        result
    }

    fn wrong<T>(&self, p: &Property, wanted: &str) -> Result<T> {
        Err(self.error(&p.at, format!("\"{}\" is {wanted}, not {}", p.name, p.kind())))
    }

    fn number(&self, o: &Object, name: &str) -> Result<Option<f64>> {
        match o.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Number(x), .. }) => Ok(Some(*x)),
            Some(p) => self.wrong(p, "a number"),
        }
    }

    fn number_or(&self, o: &Object, name: &str, default: f64) -> Result<f32> {
        Ok(self.number(o, name)?.unwrap_or(default) as f32)
    }

    fn flag(&self, o: &Object, name: &str, default: bool) -> Result<bool> {
        match o.get(name) {
            None => Ok(default),
            Some(Property { value: Value::Bool(b), .. }) => Ok(*b),
            Some(p) => self.wrong(p, "true or false"),
        }
    }

    fn text(&self, o: &Object, name: &str) -> Result<Option<(String, Spot)>> {
        match o.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Text(s), at, .. }) => Ok(Some((s.clone(), at.clone()))),
            Some(p) => self.wrong(p, "a string"),
        }
    }

    fn vector(&self, o: &Object, name: &str) -> Result<Option<DVec3>> {
        match o.get(name) {
            None => Ok(None),
            Some(Property { value: Value::Vector(v), .. }) => Ok(Some(*v)),
            Some(p) => self.wrong(p, "a point or vector"),
        }
    }

    fn transform(&self, o: &Object) -> Result<DMat4> {
        match o.get("to_world") {
            None => Ok(DMat4::IDENTITY),
            Some(Property { value: Value::Transform(m), at, .. }) => {
                let bottom = m.row(3);
                if !m.is_finite() || (bottom - glam::DVec4::W).abs().max_element() > 1e-9 {
                    return Err(self.error(at, "this transform is not affine"));
                }
                Ok(*m)
            }
            Some(p) => self.wrong(p, "a transform"),
        }
    }

    /// Notes a setting that changes nothing here, such as how Mitsuba is to write its picture.
    fn passed_over(&self, o: &Object, names: &[&str]) {
        for name in names {
            let _ = o.get(name);
        }
    }

    /// A colour that is the same everywhere.
    fn color(&mut self, p: &Property, purpose: Use) -> Result<Option<[f64; 3]>> {
        Ok(Some(match &p.value {
            Value::Number(x) => [*x; 3],
            Value::Rgb(c) => *c,
            Value::Flat(x) => spectra::flat(*x, purpose),
            Value::Spectrum(samples) => spectra::of_samples(samples, purpose),
            Value::Object(_) | Value::Ref(_) => match self.object(p)? {
                Some(o) => return self.color_of(&o, purpose),
                None => return Ok(None),
            },
            _ => return Ok(None),
        }))
    }

    /// The same for an object, such as `<spectrum type="blackbody">`; `None` if it varies over a surface, or is no spectrum.
    fn color_of(&mut self, o: &Object, purpose: Use) -> Result<Option<[f64; 3]>> {
        let color = match o.plugin.as_str() {
            "uniform" => {
                // Outside of which the spectrum is 0; nothing in rgb.
                self.passed_over(o, &["wavelength_min", "wavelength_max"]);
                [self.number(o, "value")?.unwrap_or(1.0); 3]
            }
            "rgb" | "srgb" => match (o.get("color"), o.get("value")) {
                (Some(p), _) | (None, Some(p)) => match &p.value {
                    Value::Rgb(c) => *c,
                    Value::Vector(v) => v.to_array(),
                    Value::Number(x) => [*x; 3],
                    _ => return self.wrong(p, "a colour"),
                },
                (None, None) => return Err(self.error(&o.at, "the colour is missing")),
            },
            "d65" => {
                let scale = self.number(o, "scale")?.unwrap_or(1.0);
                match o.get("color") {
                    Some(Property { value: Value::Rgb(c), .. }) => c.map(|x| x * scale),
                    Some(p) => return self.wrong(p, "a colour"),
                    None => [scale; 3],
                }
            }
            "blackbody" => {
                self.passed_over(o, &["wavelength_min", "wavelength_max"]);
                match self.number(o, "temperature")? {
                    Some(t) if t > 0.0 => spectra::blackbody(t),
                    Some(_) => return Err(self.error(&o.at, "a temperature is above 0")),
                    None => return Err(self.error(&o.at, "the temperature is missing")),
                }
            }
            "regular" | "irregular" => spectra::of_samples(&self.samples_of(o)?, purpose),
            _ => return Ok(None),
        };
        self.finish(o)?;
        Ok(Some(color))
    }

    fn samples_of(&self, o: &Object) -> Result<Vec<(f64, f64)>> {
        let list = |name: &str| -> Result<Vec<f64>> {
            let Some((text, at)) = self.text(o, name)? else {
                return Err(self.error(&o.at, format!("the {name} are missing")));
            };
            let words = text.split([',', ' ', '\t', '\n', '\r']).filter(|w| !w.is_empty());
            let number = |w: &str| w.parse::<f64>().ok().filter(|x| x.is_finite());
            words.map(|w| number(w).ok_or_else(|| self.error(&at, format!("\"{w}\" is not a number")))).collect()
        };
        let values = list("values")?;
        let wavelengths = if o.plugin == "irregular" {
            list("wavelengths")?
        } else {
            let end = |name: &str| -> Result<f64> {
                self.number(o, name)?.ok_or_else(|| self.error(&o.at, format!("\"{name}\" is missing")))
            };
            let (from, to) = (end("wavelength_min")?, end("wavelength_max")?);
            let step = (to - from) / (values.len().max(2) - 1) as f64;
            (0..values.len()).map(|i| from + step * i as f64).collect()
        };
        if values.len() != wavelengths.len() || values.len() < 2 || !wavelengths.windows(2).all(|w| w[0] < w[1]) {
            return Err(self.error(&o.at, "a spectrum needs a value for each of two or more growing wavelengths"));
        }
        Ok(wavelengths.into_iter().zip(values).collect())
    }

    fn scene(&mut self) -> Result<()> {
        let root = self.root.clone();
        if root.tag != "scene" {
            return Err(self.error(&root.at, format!("not a scene: its root is <{}>", root.tag)));
        }
        self.scene.sampler = rebond::sampling::SamplerSettings::Independent {};
        let mut seen: Vec<&str> = Vec::new();
        for p in &root.properties {
            let Some(o) = self.object(p)? else { continue };
            p.mark();
            let once = |me: &Self, seen: &mut Vec<&'static str>, what: &'static str| {
                if seen.contains(&what) {
                    return Err(me.error(&p.at, format!("a second {what}")));
                }
                seen.push(what);
                Ok(())
            };
            match o.tag.as_str() {
                "shape" => self.top_shape(&o)?,
                "emitter" => self.emitter(&o)?,
                "sensor" => {
                    if seen.contains(&"sensor") {
                        self.unsupported(&p.at, "a second sensor: the first is used")?;
                        continue;
                    }
                    seen.push("sensor");
                    self.sensor(&o)?;
                }
                "integrator" => {
                    once(self, &mut seen, "integrator")?;
                    self.integrator(&o)?;
                }
                // They are translated where they are used.
                "bsdf" | "texture" | "spectrum" => {}
                _ => self.unsupported(&o.at, format!("a <{}> means nothing to a scene", o.tag))?,
            }
        }
        if !seen.contains(&"sensor") {
            return Err(self.error(&root.at, "the scene has no sensor"));
        }
        self.finish(&root)?;
        // What is defined, but used by no shape, is not translated, nor are its mistakes found.
        Ok(())
    }
}

/// A colour in single precision.
fn color(c: [f64; 3]) -> Color {
    Color(c.map(|x| x as f32))
}
