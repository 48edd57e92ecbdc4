//! Mitsuba's XML as a tree of objects with properties: includes opened, `$names` replaced, transforms multiplied out.
//!
//! Nothing here knows what a plugin is. Whoever reads a property marks it; [`Object::unused`] are the others.

use crate::document::place_of;
use crate::error::Error;
use crate::import::{self, Assets, Part};
use glam::{DMat3, DMat4, DVec3};
use roxmltree::{Node, ParsingOptions};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::{Bound, Range};
use std::rc::Rc;

/// Elements within elements.
const DEEPEST: u32 = 64;
/// Files of a scene, included ones counted as often as they are.
const MOST_FILES: usize = 256;
/// Elements of a scene in all.
const MOST_ELEMENTS: u32 = 4_000_000;
/// Letters of all values that have `$names` in them.
const MOST_LETTERS: usize = 1 << 24;

/// A place in one of the files.
#[derive(Clone, Debug, Default)]
pub struct Spot {
    file: usize,
    span: Range<usize>,
}

impl Spot {
    /// To be noted.
    pub fn part(&self) -> Part {
        (self.file, Some(self.span.clone()))
    }
}

/// The files read so far.
#[derive(Debug, Default)]
pub struct Sources(pub import::Sources);

impl Sources {
    /// An error at that place.
    pub fn error(&self, at: &Spot, message: impl Into<String>) -> Error {
        let error = Error::new(message);
        match self.0.get(at.file) {
            Some((file, text)) => {
                Error { file: Some(file.clone()), place: Some(Box::new(place_of(text, at.span.clone()))), ..error }
            }
            None => error,
        }
    }
}

/// Any plugin: a shape, a texture, the scene.
#[derive(Debug)]
pub struct Object {
    /// The element's name, such as `bsdf`.
    pub tag: String,
    /// Its `type`.
    pub plugin: String,
    /// Its `id`.
    pub id: Option<String>,
    /// Where it stands.
    pub at: Spot,
    /// What it has.
    pub properties: Vec<Property>,
}

/// A named value of an object.
#[derive(Debug)]
pub struct Property {
    /// Its name; empty for objects that have none.
    pub name: String,
    /// Where it stands.
    pub at: Spot,
    /// The value.
    pub value: Value,
    used: Cell<bool>,
}

/// A value.
#[derive(Debug)]
pub enum Value {
    /// `<boolean>`.
    Bool(bool),
    /// `<integer>` or `<float>`.
    Number(f64),
    /// `<string>`.
    Text(String),
    /// `<point>` or `<vector>`.
    Vector(DVec3),
    /// `<transform>`.
    Transform(DMat4),
    /// `<rgb>`.
    Rgb([f64; 3]),
    /// `<spectrum>` of one value at all wavelengths.
    Flat(f64),
    /// `<spectrum>` of values at wavelengths.
    Spectrum(Vec<(f64, f64)>),
    /// An object in place.
    Object(Rc<Object>),
    /// `<ref>`, to be looked up when all is read.
    Ref(String),
}

impl Object {
    /// The property of that name, which is thereby used.
    pub fn get(&self, name: &str) -> Option<&Property> {
        let found = self.properties.iter().find(|p| p.name == name && !name.is_empty());
        found.inspect(|p| p.used.set(true))
    }

    /// Whether there is such a property; it is not used thereby.
    pub fn has(&self, name: &str) -> bool {
        self.properties.iter().any(|p| p.name == name)
    }

    /// What nobody has asked for.
    pub fn unused(&self) -> impl Iterator<Item = &Property> {
        self.properties.iter().filter(|p| !p.used.get())
    }
}

impl Property {
    /// Marks it.
    pub fn mark(&self) -> &Self {
        self.used.set(true);
        self
    }

    /// What was written, in a word.
    pub fn kind(&self) -> &str {
        match &self.value {
            Value::Bool(_) => "a boolean",
            Value::Number(_) => "a number",
            Value::Text(_) => "a string",
            Value::Vector(_) => "a point",
            Value::Transform(_) => "a transform",
            Value::Rgb(_) => "a colour",
            Value::Flat(_) | Value::Spectrum(_) => "a spectrum",
            Value::Object(o) => &o.tag,
            Value::Ref(_) => "a reference",
        }
    }
}

/// A scene file with all it includes.
#[derive(Debug)]
pub struct Tree {
    /// The root.
    pub root: Rc<Object>,
    /// Objects by their ids.
    pub ids: BTreeMap<String, Rc<Object>>,
    /// Folders to look for files in, relative to the scene's.
    pub paths: Vec<String>,
    /// The files.
    pub sources: Sources,
}

/// Reads a scene's text and what it includes.
pub fn read(text: &str, file: &str, assets: &Assets) -> Result<Tree, Error> {
    let mut reader = Reader {
        assets,
        sources: Sources::default(),
        defaults: BTreeMap::new(),
        aliases: Vec::new(),
        ids: BTreeMap::new(),
        paths: Vec::new(),
        camel: false,
        elements: 0,
        letters: Cell::new(0),
    };
    let mut top = reader.file(text, file, "", 0)?;
    let root = match (top.pop(), top.is_empty()) {
        (Some(Property { value: Value::Object(o), .. }), true) => o,
        _ => return Err(Error::new("not a Mitsuba scene: its root is no <scene>").with_file(file)),
    };
    for (id, name, at) in std::mem::take(&mut reader.aliases) {
        let found = reader.ids.get(&id).cloned();
        let object =
            found.ok_or_else(|| reader.sources.error(&at, format!("there is no object with the id \"{id}\"")))?;
        reader.ids.insert(name, object);
    }
    Ok(Tree { root, ids: reader.ids, paths: reader.paths, sources: reader.sources })
}

struct Reader<'a> {
    assets: &'a Assets,
    sources: Sources,
    defaults: BTreeMap<String, String>,
    aliases: Vec<(String, String, Spot)>,
    ids: BTreeMap<String, Rc<Object>>,
    paths: Vec<String>,
    /// Whether names are written in the old way, `toWorld`.
    camel: bool,
    elements: u32,
    /// Letters made so far by replacing `$names`.
    letters: Cell<usize>,
}

/// A parsed element and the number of its file.
#[derive(Clone, Copy)]
struct Element<'t, 'i> {
    node: Node<'t, 'i>,
    file: usize,
}

impl<'t> Element<'t, '_> {
    /// The start tag's name, not the whole element.
    fn spot(&self) -> Spot {
        let start = self.node.range().start;
        Spot { file: self.file, span: start..start + 1 + self.node.tag_name().name().len() }
    }

    fn spot_of(&self, attribute: &str) -> Spot {
        let found = self.node.attribute_node(attribute);
        found.map_or_else(|| self.spot(), |a| Spot { file: self.file, span: a.range_value() })
    }

    fn name(&self) -> &'t str {
        self.node.tag_name().name()
    }
}

impl Reader<'_> {
    fn fail<T>(&self, at: &Spot, message: impl Into<String>) -> Result<T, Error> {
        Err(self.sources.error(at, message))
    }

    /// The top of a file: its scene, or the object that it is.
    fn file(&mut self, text: &str, file: &str, folder: &str, depth: u32) -> Result<Vec<Property>, Error> {
        let number = self.sources.0.len();
        self.sources.0.push((file.to_string(), text.into()));
        let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_ELEMENTS, ..ParsingOptions::default() };
        let document = roxmltree::Document::parse_with_options(text, options).map_err(|e| {
            let at = e.pos();
            let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1));
            let start = lines.into_iter().nth(at.row.saturating_sub(1) as usize).unwrap_or(text.len());
            let columns = text[start..].char_indices().map(|(i, _)| start + i);
            let place = columns.into_iter().nth(at.col.saturating_sub(1) as usize).unwrap_or(text.len());
            let span = place..place;
            // The place is told apart from the words.
            let words = e.to_string();
            let words = words.rsplit_once(" at ").map_or(&*words, |(words, _)| words);
            self.sources.error(&Spot { file: number, span }, format!("not valid XML: {words}"))
        })?;
        let element = Element { node: document.root_element(), file: number };
        if let Some(version) = element.node.attribute("version") {
            let mut parts = version.split('.').map(|p| p.trim().parse::<u32>());
            let major = match parts.next() {
                Some(Ok(major)) if parts.all(|p| p.is_ok()) => major,
                _ => return self.fail(&element.spot_of("version"), format!("\"{version}\" is no version")),
            };
            if major > 3 {
                return self.fail(&element.spot_of("version"), format!("version {version} is newer than 3"));
            }
            self.camel = major < 2;
        } else if number == 0 {
            return self
                .fail(&element.spot(), "the scene's version is missing")
                .map_err(|e: Error| e.with_help("write <scene version=\"3.0.0\">"));
        }
        let mut properties = Vec::new();
        if element.name() == "scene" && number > 0 {
            self.children(element, folder, depth, &mut properties)?;
        } else {
            self.element(element, folder, depth, &mut properties)?;
        }
        Ok(properties)
    }

    fn children(&mut self, e: Element, folder: &str, depth: u32, into: &mut Vec<Property>) -> Result<(), Error> {
        for node in e.node.children() {
            let child = Element { node, ..e };
            if node.is_element() {
                self.element(child, folder, depth + 1, into)?;
            } else if node.is_text()
                && let Some(blank) = node.text().and_then(|text| text.find(|c: char| !c.is_whitespace()))
            {
                let start = node.range().start + blank;
                return self.fail(&Spot { file: e.file, span: start..start + 1 }, "text means nothing here");
            }
        }
        Ok(())
    }

    /// An attribute with its `$names` replaced.
    fn attribute(&self, e: Element, name: &str) -> Result<Option<String>, Error> {
        let Some(raw) = e.node.attribute(name) else { return Ok(None) };
        if !raw.contains('$') {
            return Ok(Some(raw.to_string()));
        }
        let mut out = String::new();
        let mut rest = raw;
        while let Some(i) = rest.find('$') {
            out += &rest[..i];
            rest = &rest[i + 1..];
            let Some((known, value)) = self.longest_name(rest) else {
                let word: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                return self
                    .fail(&e.spot_of(name), format!("the parameter ${word} has no value"))
                    .map_err(|e: Error| e.with_help(format!("give one by <default name=\"{word}\" value=\"…\"/>")));
            };
            self.letters.set(self.letters.get().saturating_add(value.len()));
            if self.letters.get() > MOST_LETTERS {
                let message = format!("the values of parameters come to more than {MOST_LETTERS} letters");
                return self.fail(&e.spot_of(name), message);
            }
            out += value;
            rest = &rest[known.len()..];
        }
        Ok(Some(out + rest))
    }

    /// The longest name of a parameter that a text begins with, and its value; names hold anything.
    fn longest_name(&self, text: &str) -> Option<(&str, &str)> {
        let mut text = text;
        loop {
            // What begins a text is not after it, and the longest comes last.
            let until = (Bound::Unbounded, Bound::Included(text));
            let (name, value) = self.defaults.range::<str, _>(until).next_back()?;
            if text.starts_with(name.as_str()) {
                return Some((name, value));
            }
            // Nor is it longer than what the text shares with any name in between.
            let shared = name.bytes().zip(text.bytes()).take_while(|(a, b)| a == b).count();
            text = &text[..text.floor_char_boundary(shared)];
        }
    }

    fn needed(&self, e: Element, name: &str) -> Result<String, Error> {
        let found = self.attribute(e, name)?;
        found.ok_or_else(|| self.sources.error(&e.spot(), format!("<{}> without a {name}", e.name())))
    }

    fn only(&self, e: Element, allowed: &[&str]) -> Result<(), Error> {
        match e.node.attributes().find(|a| !allowed.contains(&a.name())) {
            Some(a) => {
                let message = format!("<{}> has no attribute \"{}\"", e.name(), a.name());
                let span = a.range();
                self.fail(&Spot { file: e.file, span }, message)
                    .map_err(|e: Error| e.with_help(format!("it may have: {}", allowed.join(", "))))
            }
            None => Ok(()),
        }
    }

    fn childless(&self, e: Element) -> Result<(), Error> {
        match e.node.children().find(|n| n.is_element()) {
            Some(node) => self.fail(&Element { node, ..e }.spot(), format!("nothing can stand within <{}>", e.name())),
            None => Ok(()),
        }
    }

    fn numbers(&self, e: Element, attribute: &str) -> Result<Vec<f64>, Error> {
        let text = self.needed(e, attribute)?;
        let words = text.split([',', ' ', '\t', '\n', '\r']).filter(|w| !w.is_empty());
        words.map(|w| self.number(e, attribute, w)).collect()
    }

    fn number(&self, e: Element, attribute: &str, word: &str) -> Result<f64, Error> {
        match word.trim().parse::<f64>() {
            Ok(x) if x.is_finite() && (x as f32).is_finite() => Ok(x),
            Ok(_) => self.fail(&e.spot_of(attribute), format!("{word} is no finite number of single precision")),
            Err(_) => self.fail(&e.spot_of(attribute), format!("\"{word}\" is not a number")),
        }
    }

    fn one_number(&self, e: Element, attribute: &str) -> Result<f64, Error> {
        let text = self.needed(e, attribute)?;
        self.number(e, attribute, &text)
    }

    /// `value="x, y, z"` or `x="…" y="…" z="…"`, what is missing being `rest`.
    fn vector(&self, e: Element, rest: f64) -> Result<DVec3, Error> {
        if e.node.has_attribute("value") {
            return match self.numbers(e, "value")?[..] {
                [x] => Ok(DVec3::splat(x)),
                [x, y] => Ok(DVec3::new(x, y, rest)),
                [x, y, z] => Ok(DVec3::new(x, y, z)),
                ref other => self.fail(&e.spot_of("value"), format!("expected three numbers, found {}", other.len())),
            };
        }
        let mut v = [rest; 3];
        for (axis, name) in v.iter_mut().zip(["x", "y", "z"]) {
            if e.node.has_attribute(name) {
                *axis = self.one_number(e, name)?;
            }
        }
        Ok(DVec3::from(v))
    }

    fn element(&mut self, e: Element, folder: &str, depth: u32, into: &mut Vec<Property>) -> Result<(), Error> {
        self.elements += 1;
        if depth > DEEPEST || self.elements > MOST_ELEMENTS {
            return self
                .fail(&e.spot(), format!("more than {DEEPEST} elements within each other, or too many of them"));
        }
        let value = match e.name() {
            "default" => {
                self.only(e, &["name", "value"])?;
                let (name, value) = (self.needed(e, "name")?, self.needed(e, "value")?);
                if name.is_empty() {
                    return self.fail(&e.spot_of("name"), "a parameter without a name");
                }
                self.defaults.entry(name).or_insert(value);
                return Ok(());
            }
            "path" => {
                self.only(e, &["value"])?;
                let path = self.needed(e, "value")?;
                self.paths.push(join(folder, &path));
                return Ok(());
            }
            "include" => {
                self.only(e, &["filename"])?;
                let name = self.needed(e, "filename")?;
                if self.sources.0.len() >= MOST_FILES || depth > DEEPEST / 4 {
                    return self.fail(
                        &e.spot_of("filename"),
                        format!("more than {MOST_FILES} files, or files within files without end"),
                    );
                }
                let at = e.spot_of("filename");
                let file = find(self.assets, &self.paths, folder, &name).unwrap_or(name);
                let bytes = self.assets.read(&file).map_err(|m| self.sources.error(&at, m))?;
                let text = String::from_utf8(bytes)
                    .map_err(|_| self.sources.error(&at, format!("\"{file}\" is not UTF-8 text")))?;
                let inner = file.rsplit_once('/').map_or("", |(folder, _)| folder).to_string();
                let shown = self.assets.folder().join(&file).display().to_string();
                let camel = self.camel;
                let properties = self.file(&text, &shown, &inner, depth + 1)?;
                self.camel = camel;
                into.extend(properties);
                return Ok(());
            }
            "alias" => {
                self.only(e, &["id", "as"])?;
                let alias = (self.needed(e, "id")?, self.needed(e, "as")?, e.spot());
                self.aliases.push(alias);
                return Ok(());
            }
            "boolean" => {
                self.only(e, &["name", "value"])?;
                match self.needed(e, "value")?.trim().to_ascii_lowercase().as_str() {
                    "true" => Value::Bool(true),
                    "false" => Value::Bool(false),
                    other => return self.fail(&e.spot_of("value"), format!("\"{other}\" is neither true nor false")),
                }
            }
            "integer" => {
                self.only(e, &["name", "value"])?;
                match self.one_number(e, "value")? {
                    x if x.fract() == 0.0 => Value::Number(x),
                    x => return self.fail(&e.spot_of("value"), format!("{x} is not a whole number")),
                }
            }
            "float" => {
                self.only(e, &["name", "value"])?;
                Value::Number(self.one_number(e, "value")?)
            }
            "string" => {
                self.only(e, &["name", "value"])?;
                Value::Text(self.needed(e, "value")?)
            }
            "point" | "vector" => {
                self.only(e, &["name", "value", "x", "y", "z"])?;
                Value::Vector(self.vector(e, 0.0)?)
            }
            "rgb" => {
                self.only(e, &["name", "value"])?;
                match self.numbers(e, "value")?[..] {
                    [x] => Value::Rgb([x; 3]),
                    [r, g, b] => Value::Rgb([r, g, b]),
                    ref other => {
                        return self
                            .fail(&e.spot_of("value"), format!("expected one number or three, found {}", other.len()));
                    }
                }
            }
            "srgb" => {
                self.only(e, &["name", "value"])?;
                let text = self.needed(e, "value")?;
                let hex = text
                    .trim()
                    .strip_prefix('#')
                    .filter(|h| h.len() == 6)
                    .and_then(|h| u32::from_str_radix(h, 16).ok());
                let encoded = match hex {
                    Some(h) => [16, 8, 0].map(|shift| f64::from(h >> shift & 255) / 255.0),
                    None => match self.numbers(e, "value")?[..] {
                        [x] => [x; 3],
                        [r, g, b] => [r, g, b],
                        _ => return self.fail(&e.spot_of("value"), "expected #rrggbb, or three numbers"),
                    },
                };
                Value::Rgb(encoded.map(|x| f64::from(crate::images::srgb_decode(x as f32))))
            }
            "spectrum" if !e.node.has_attribute("type") => self.spectrum(e, folder)?,
            "transform" => {
                self.only(e, &["name"])?;
                Value::Transform(self.transform(e)?)
            }
            "ref" => {
                self.only(e, &["name", "id"])?;
                Value::Ref(self.needed(e, "id")?)
            }
            _ => {
                let scene = e.name() == "scene";
                self.only(e, if scene { &["version", "type", "id"] } else { &["type", "id", "name", "version"] })?;
                let plugin = if scene { "scene".into() } else { self.needed(e, "type")? };
                let id = self.attribute(e, "id")?;
                let mut properties = Vec::new();
                self.children(e, folder, depth, &mut properties)?;
                for (i, p) in properties.iter().enumerate() {
                    if !p.name.is_empty() && properties[..i].iter().any(|q| q.name == p.name) {
                        return self.fail(&p.at, format!("\"{}\" is given twice", p.name));
                    }
                }
                let object = Rc::new(Object { tag: e.name().into(), plugin, id: id.clone(), at: e.spot(), properties });
                if let Some(id) = id
                    && self.ids.insert(id.clone(), object.clone()).is_some()
                {
                    return self.fail(&e.spot_of("id"), format!("the id \"{id}\" is given twice"));
                }
                Value::Object(object)
            }
        };
        if !matches!(value, Value::Object(_) | Value::Transform(_)) {
            self.childless(e)?;
        }
        let name = match &value {
            Value::Object(_) | Value::Ref(_) => self.attribute(e, "name")?.unwrap_or_default(),
            _ => self.needed(e, "name")?,
        };
        let name = if self.camel { snake(&name) } else { name };
        into.push(Property { name, at: e.spot(), value, used: Cell::new(false) });
        Ok(())
    }

    fn spectrum(&self, e: Element, folder: &str) -> Result<Value, Error> {
        self.only(e, &["name", "value", "filename"])?;
        let at = e.spot_of(if e.node.has_attribute("value") { "value" } else { "filename" });
        let mut pairs = Vec::new();
        if let Some(name) = self.attribute(e, "filename")? {
            let file = find(self.assets, &self.paths, folder, &name).unwrap_or(name);
            let bytes = self.assets.read(&file).map_err(|m| self.sources.error(&at, m))?;
            pairs =
                super::spectra::read_spd(&bytes).map_err(|m| self.sources.error(&at, format!("\"{file}\": {m}")))?;
        } else {
            let text = self.needed(e, "value")?;
            if !text.contains(':') {
                return Ok(Value::Flat(self.number(e, "value", &text)?));
            }
            for pair in text.split([',', ' ', '\t', '\n', '\r']).filter(|w| !w.is_empty()) {
                let Some((wavelength, value)) = pair.split_once(':') else {
                    return self.fail(&at, format!("\"{pair}\" is no wavelength:value"));
                };
                pairs.push((self.number(e, "value", wavelength)?, self.number(e, "value", value)?));
            }
        }
        if !pairs.windows(2).all(|p| p[0].0 < p[1].0) {
            return self.fail(&at, "wavelengths must grow");
        }
        Ok(Value::Spectrum(pairs))
    }

    /// Later steps stand to the left: they are applied to what the earlier ones give.
    fn transform(&self, e: Element) -> Result<DMat4, Error> {
        let mut matrix = DMat4::IDENTITY;
        for node in e.node.children().filter(Node::is_element) {
            let step = Element { node, ..e };
            self.childless(step)?;
            let m = match step.name() {
                "translate" => {
                    self.only(step, &["value", "x", "y", "z"])?;
                    DMat4::from_translation(self.vector(step, 0.0)?)
                }
                "scale" => {
                    self.only(step, &["value", "x", "y", "z"])?;
                    DMat4::from_scale(self.vector(step, 1.0)?)
                }
                "rotate" => {
                    self.only(step, &["value", "x", "y", "z", "angle"])?;
                    let axis = self.vector(step, 0.0)?;
                    if axis == DVec3::ZERO {
                        return self.fail(&step.spot(), "the axis of a rotation is zero");
                    }
                    rotation(axis, self.one_number(step, "angle")?.to_radians())
                }
                "lookat" | "look_at" => {
                    self.only(step, &["origin", "target", "up"])?;
                    let point = |name: &str| -> Result<DVec3, Error> {
                        match self.numbers(step, name)?[..] {
                            [x, y, z] => Ok(DVec3::new(x, y, z)),
                            _ => self.fail(&step.spot_of(name), "expected three numbers"),
                        }
                    };
                    let (origin, target) = (point("origin")?, point("target")?);
                    let Some(z) = (target - origin).try_normalize() else {
                        return self.fail(&step.spot(), "origin and target are the same point");
                    };
                    // Without `up` any will do.
                    let up = if step.node.has_attribute("up") { point("up")? } else { z.any_orthogonal_vector() };
                    let Some(x) = up.cross(z).try_normalize() else {
                        return self.fail(&step.spot(), "up is zero or along the direction of view");
                    };
                    DMat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), origin.extend(1.0))
                }
                "matrix" => {
                    self.only(step, &["value"])?;
                    match self.numbers(step, "value")?[..] {
                        [a, b, c, d, e, f, g, h, i] => {
                            DMat4::from_cols_array(&[a, d, g, 0.0, b, e, h, 0.0, c, f, i, 0.0, 0.0, 0.0, 0.0, 1.0])
                        }
                        ref all => match <[f64; 16]>::try_from(all) {
                            Ok(all) => DMat4::from_cols_array(&all).transpose(),
                            Err(_) => {
                                let message = format!("expected 9 or 16 numbers, found {}", all.len());
                                return self.fail(&step.spot_of("value"), message);
                            }
                        },
                    }
                }
                other => return self.fail(&step.spot(), format!("<{other}> is no step of a transform")),
            };
            matrix = m * matrix;
        }
        Ok(matrix)
    }
}

/// Rodrigues' formula for an axis as it is given. Mitsuba does not bring it to unit length, so that a longer or shorter one shears:
/// scenes were made to look right so.
fn rotation(axis: DVec3, angle: f64) -> DMat4 {
    let (sin, cos) = angle.sin_cos();
    let [x, y, z] = axis.to_array();
    let cross = DMat3::from_cols(DVec3::new(0.0, z, -y), DVec3::new(-z, 0.0, x), DVec3::new(y, -x, 0.0));
    let outer = DMat3::from_cols(axis * x, axis * y, axis * z);
    DMat4::from_mat3(outer * (1.0 - cos) + DMat3::from_diagonal(DVec3::splat(cos)) + cross * sin)
}

/// The file of that name: in the scene's `<path>`s, the including file's folder or the scene's.
pub fn find(assets: &Assets, paths: &[String], folder: &str, name: &str) -> Option<String> {
    let places = paths.iter().map(String::as_str).chain([folder, ""]);
    places.map(|p| join(p, name)).find(|p| assets.folder().join(p).is_file())
}

fn join(folder: &str, name: &str) -> String {
    // Files written elsewhere may have the other kind of slash.
    let name = name.replace('\\', "/");
    let absolute = name.starts_with('/');
    if folder.is_empty() || absolute { name } else { format!("{}/{name}", folder.trim_end_matches('/')) }
}

/// `toWorld` as `to_world`, as scenes before version 2 have it.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_uppercase() && !out.is_empty() {
            out.push('_');
        }
        out.push(c.to_ascii_lowercase());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::ImportOptions;

    fn tree(text: &str) -> Result<Tree, Error> {
        read(text, "a.xml", &Assets::new(std::path::Path::new(""), ImportOptions::default()))
    }

    #[test]
    fn the_longest_name_of_a_parameter_counts() {
        let names = ["a", "ab", "abcd", "abd", "ä", "äö"];
        let defaults = names.map(|n| format!("<default name=\"{n}\" value=\"[{n}]\"/>")).concat();
        let value = |text: &str| {
            let text = format!("<scene version=\"3.0.0\">{defaults}<string name=\"x\" value=\"{text}\"/></scene>");
            match tree(&text).map(|t| t.root.get("x").map(|p| format!("{:?}", p.value))) {
                Ok(Some(value)) => value,
                other => panic!("{other:?}"),
            }
        };
        for (text, wanted) in [("$abce", "[ab]ce"), ("$abcd$a", "[abcd][a]"), ("$aze", "[a]ze"), ("$äü", "[ä]ü")] {
            assert_eq!(value(text), format!("Text({wanted:?})"));
        }
        let none = format!("<scene version=\"3.0.0\">{defaults}<string name=\"x\" value=\"$öa\"/></scene>");
        assert!(tree(&none).is_err_and(|e| e.message == "the parameter $öa has no value"));
    }

    #[test]
    fn parameters_do_not_blow_up() {
        let doubling: String =
            (1..16).map(|i| format!("<default name=\"{i}.\" value=\"{0}{0}\"/>", format!("${}.", i - 1))).collect();
        let uses = "<string name=\"x\" value=\"$15.\"/>".repeat(100);
        let start = "<default name=\"0.\" value=\"0123456789abcdef\"/>";
        let text = format!("<scene version=\"3.0.0\">{start}{doubling}<shape type=\"a\">{uses}</shape></scene>");
        let error = tree(&text).expect_err("fifty million letters");
        assert!(error.message.contains("come to more than"), "{error}");
    }
}
