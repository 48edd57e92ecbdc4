//! A description as a scene file, and all that it needs beside it.
//!
//! The text is what [`crate::deserialize`] reads: a serde serializer makes the same tree of values that it reads from, in which an enum
//! is a table with the key `type`. Options that are not given are left out.

use crate::document::{Entry, Node, Value};
use crate::error::Error;
use crate::images::{ImageFormat, PngOptions, write_image};
use crate::meshes::write_ply;
use crate::scene::{SceneFiles, SceneSource};
use rebond::scene::SceneDescription;
use rebond::scene::description::{
    AttributeTexture, EmitterDescription, ImageTexture, MaterialDescription, MaterialRef, NumberTexture,
    ShapeDescription, Texture,
};
use serde::Serialize;
use serde::ser::{
    self, SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple, SerializeTupleStruct,
    SerializeTupleVariant, Serializer,
};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A scene as TOML.
pub fn to_toml(scene: &SceneDescription) -> Result<String, Error> {
    let root = scene.serialize(Tree).map_err(|e| Error::new(e.0))?;
    let mut out = String::new();
    let Some(Value::Table(entries)) = root else { return Ok(out) };
    // What is no table comes first, or it would belong to the table before.
    let (tables, plain): (Vec<Entry>, Vec<Entry>) = entries.into_iter().partition(|e| is_section(&e.node.value));
    for e in plain {
        let _ = writeln!(out, "{} = {}", key(&e.key), inline(&e.node.value));
    }
    for e in tables {
        section(&mut out, &key(&e.key), e.node.value);
    }
    Ok(out)
}

fn is_section(value: &Value) -> bool {
    match value {
        Value::Table(_) => true,
        Value::Array(items) => !items.is_empty() && items.iter().all(|i| matches!(i.value, Value::Table(_))),
        _ => false,
    }
}

/// A table or a list of tables under its own header. Groups are lists of tables by name.
fn section(out: &mut String, name: &str, value: Value) {
    match value {
        Value::Table(entries) if entries.is_empty() => {}
        Value::Table(entries) if name == "groups" => {
            for e in entries {
                section(out, &format!("groups.{}", key(&e.key)), e.node.value);
            }
        }
        Value::Table(entries) => {
            let _ = writeln!(out, "\n[{name}]");
            for e in entries {
                let _ = writeln!(out, "{} = {}", key(&e.key), inline(&e.node.value));
            }
        }
        Value::Array(items) if items.is_empty() => {
            let _ = writeln!(out, "\n[{}]", name.split_once('.').map_or(name, |(table, _)| table));
            let _ = writeln!(out, "{} = []", name.split_once('.').map_or(name, |(_, item)| item));
        }
        Value::Array(items) => {
            for item in items {
                let Value::Table(entries) = item.value else { continue };
                let _ = writeln!(out, "\n[[{name}]]");
                for e in entries {
                    let _ = writeln!(out, "{} = {}", key(&e.key), inline(&e.node.value));
                }
            }
        }
        _ => {}
    }
}

fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'));
    if bare { name.to_string() } else { quoted(name) }
}

fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out += "\\\"",
            '\\' => out += "\\\\",
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04x}", c as u32);
            }
            c => out.push(c),
        }
    }
    out + "\""
}

fn inline(value: &Value) -> String {
    match value {
        Value::Bool(b) => b.to_string(),
        Value::Integer(i) => i.to_string(),
        // Whole numbers need no point.
        Value::Float(x) if x.fract() == 0.0 && x.abs() < 1e6 && !(*x == 0.0 && x.is_sign_negative()) => {
            format!("{x:.0}")
        }
        Value::Float(x) => format!("{x:?}"),
        Value::String(s) => quoted(s),
        Value::Array(items) => {
            format!("[{}]", items.iter().map(|i| inline(&i.value)).collect::<Vec<_>>().join(", "))
        }
        Value::Table(entries) if entries.is_empty() => "{}".into(),
        Value::Table(entries) => {
            let entry = |e: &Entry| format!("{} = {}", key(&e.key), inline(&e.node.value));
            format!("{{ {} }}", entries.iter().map(entry).collect::<Vec<_>>().join(", "))
        }
    }
}

/// Writes a scene as a TOML file with all the meshes, images and measurements that it names in a folder beside it, called
/// as the file with `-files`; returns the paths written, the file first. Files that are in its folder already stay where they are,
/// and no file but `out` is replaced.
pub fn convert(source: &SceneSource, out: &Path) -> Result<Vec<PathBuf>, Error> {
    let folder = out.parent().map_or_else(PathBuf::new, Path::to_path_buf);
    let stem = out.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
    let beside = format!("{stem}-files");
    let mut description = source.description.clone();
    let mut used = Vec::new();
    each_file(&mut description, &mut |file| used.push(file.clone()));
    let old = match source.files() {
        SceneFiles::Folder(old) => Some(old.as_path()),
        SceneFiles::Imported(a) => Some(a.folder()),
        SceneFiles::BuiltIn => None,
    };
    let inputs = used.iter().filter_map(|file| Some(old?.join(file))).chain(source.path().map(Path::to_path_buf));
    if let Some(input) = inputs.into_iter().find(|input| same_path(input, out)) {
        let error = Error::new(format!("\"{}\" is what is to be converted", input.display()));
        return Err(error.with_help("write to another file"));
    }
    let mut names: BTreeMap<String, String> = BTreeMap::new();
    let mut failed = None;
    let mut written = vec![out.to_path_buf()];
    let save = |path: &Path, bytes: &[u8]| {
        let cannot = |e: std::io::Error| Error::new(format!("cannot write \"{}\": {e}", path.display()));
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(cannot)?;
        }
        replace(path, bytes).map_err(cannot)
    };
    each_file(&mut description, &mut |file: &mut String| {
        if failed.is_some() {
            return;
        }
        if let Some(known) = names.get(file) {
            *file = known.clone();
            return;
        }
        let mut keep = || -> Result<String, Error> {
            let original = file.clone();
            let stays = old.is_some_and(|old| same_path(old, &folder));
            let in_place = !made(source, &original) && stays;
            if in_place && Path::new(&original).is_relative() {
                return Ok(original);
            }
            let name = Path::new(&original).file_name().map_or("file".into(), |n| n.to_string_lossy().into_owned());
            let (stem, extension) = name.rsplit_once('.').map_or((&*name, ""), |(s, e)| (s, e));
            let bytes = contents(source, &original)?;
            // What is there already may be what an earlier conversion wrote.
            let taken = |n: &str| {
                let path = folder.join(n);
                // What stays where it is has its name.
                let given = names.values().any(|known| known == n) || stays && used.iter().any(|known| known == n);
                given || path.exists() && !std::fs::read(&path).is_ok_and(|there| there == bytes)
            };
            let numbered = |i: u32| match i {
                1 => format!("{beside}/{name}"),
                _ if extension.is_empty() => format!("{beside}/{stem}-{i}"),
                _ => format!("{beside}/{stem}-{i}.{extension}"),
            };
            let name = (1..).map(numbered).find(|n| !taken(n)).unwrap_or_default();
            let path = folder.join(&name);
            save(&path, &bytes)?;
            written.push(path);
            Ok(name)
        };
        match keep() {
            Ok(name) => {
                names.insert(std::mem::replace(file, name.clone()), name);
            }
            Err(e) => failed = Some(e),
        }
    });
    if let Some(error) = failed {
        return Err(error);
    }
    let mut text = to_toml(&description)?;
    if let Some(samples) = source.samples {
        text = format!("# The original asks for --spp {samples}.\n{text}");
    }
    save(out, text.as_bytes())?;
    Ok(written)
}

/// Writes beside the file and renames: a failure leaves no half of one, and what else has the same bytes by a link keeps them.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let beside = (1_u32..).map(|i| {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".part{i}"));
        PathBuf::from(name)
    });
    for beside in beside {
        // Not over what is there, whatever it is.
        let mut file = match std::fs::File::create_new(&beside) {
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => continue,
            file => file?,
        };
        let written = std::io::Write::write_all(&mut file, bytes).and_then(|()| std::fs::rename(&beside, path));
        if written.is_err() {
            let _ = std::fs::remove_file(&beside);
        }
        return written;
    }
    Ok(())
}

fn same_path(a: &Path, b: &Path) -> bool {
    let whole = |p: &Path| if p.as_os_str().is_empty() { Path::new(".").canonicalize() } else { p.canonicalize() };
    matches!((whole(a), whole(b)), (Ok(a), Ok(b)) if a == b)
}

/// Whether an importer made that file.
fn made(source: &SceneSource, file: &str) -> bool {
    matches!(source.files(), SceneFiles::Imported(a) if a.meshes.contains_key(file) || a.images.contains_key(file))
}

fn contents(source: &SceneSource, file: &str) -> Result<Vec<u8>, Error> {
    if let SceneFiles::Imported(assets) = source.files() {
        if let Some(mesh) = assets.meshes.get(file) {
            return Ok(write_ply(mesh));
        }
        if let Some(image) = assets.images.get(file) {
            return write_image(image, ImageFormat::Exr, &PngOptions::default());
        }
    }
    source.files().read(file).map_err(Error::new)
}

/// Every name of a file in a description.
fn each_file(scene: &mut SceneDescription, f: &mut dyn FnMut(&mut String)) {
    scene.materials.values_mut().for_each(|m| files_of_material(m, f));
    for shape in scene.groups.values_mut().flatten().chain(&mut scene.shapes) {
        use ShapeDescription as S;
        let material = match shape {
            S::Obj(s) | S::Ply(s) => {
                f(&mut s.file);
                &mut s.material
            }
            S::Mesh(s) => &mut s.material,
            S::Sphere(s) => &mut s.material,
            S::Rectangle(s) | S::Disk(s) | S::Cube(s) => &mut s.material,
            S::Instance(_) => continue,
        };
        if let Some(m) = material {
            files_of_reference(m, f);
        }
    }
    for emitter in &mut scene.emitters {
        if let EmitterDescription::Envmap { file, .. }
        | EmitterDescription::Projector { file, .. }
        | EmitterDescription::Goniometric { file, .. } = emitter
        {
            f(file);
        }
    }
}

fn files_of_reference(material: &mut MaterialRef, f: &mut dyn FnMut(&mut String)) {
    if let MaterialRef::Inline(m) = material {
        files_of_material(m, f);
    }
}

fn files_of_material(material: &mut MaterialDescription, f: &mut dyn FnMut(&mut String)) {
    use MaterialDescription as M;
    fn image(texture: &mut Texture, f: &mut dyn FnMut(&mut String)) {
        if let Texture::Image(ImageTexture { image, .. })
        | Texture::Attribute(AttributeTexture { image: Some(ImageTexture { image, .. }), .. }) = texture
        {
            f(image);
        }
    }
    fn number(texture: &mut NumberTexture, f: &mut dyn FnMut(&mut String)) {
        if let NumberTexture::Image(ImageTexture { image, .. }) = texture {
            f(image);
        }
    }
    match material {
        M::Diffuse { reflectance: t }
        | M::Mirror { reflectance: t }
        | M::Phong { reflectance: t, .. }
        | M::BlinnPhong { reflectance: t, .. }
        | M::OrenNayar { reflectance: t, .. }
        | M::AshikhminShirley { diffuse_reflectance: t, .. }
        | M::ThinDielectric { tint: t, .. } => image(t, f),
        M::Dielectric { tint: t, alpha, alpha_u, alpha_v, .. }
        | M::Conductor { tint: t, alpha, alpha_u, alpha_v, .. } => {
            image(t, f);
            alpha.iter_mut().chain(alpha_u).chain(alpha_v).for_each(|own| number(own, f));
        }
        M::Plastic { diffuse_reflectance: t, alpha, .. } => {
            image(t, f);
            number(alpha, f);
        }
        M::Principled { base_color, metallic, roughness, .. } => {
            image(base_color, f);
            number(metallic, f);
            number(roughness, f);
        }
        M::PrincipledThin { base_color, roughness, .. } => {
            image(base_color, f);
            number(roughness, f);
        }
        M::Measured { file } => f(file),
        M::Mix { a, b, .. } => {
            files_of_reference(a, f);
            files_of_reference(b, f);
        }
        M::Mask { opacity, material } => {
            image(opacity, f);
            files_of_reference(material, f);
        }
        M::Glow { radiance: map, material, .. }
        | M::NormalMap { normal_map: map, material, .. }
        | M::BumpMap { bump_map: map, material, .. } => {
            f(&mut map.image);
            files_of_reference(material, f);
        }
        M::TwoSided { front, back } => {
            files_of_reference(front, f);
            if let Some(back) = back {
                files_of_reference(back, f);
            }
        }
    }
}

/// Makes a value of whatever serializes; `None` of what is not there.
struct Tree;

/// What cannot be written.
#[derive(Debug)]
struct Failed(String);

impl std::fmt::Display for Failed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Failed {}

impl ser::Error for Failed {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

type Written = Result<Option<Value>, Failed>;

fn value_of<T: Serialize + ?Sized>(value: &T) -> Written {
    value.serialize(Tree)
}

/// The table of an enum's variant: its content, after its name.
fn tagged(variant: &str, content: Option<Value>) -> Written {
    let tag = Entry { key: "type".into(), key_span: None, node: Value::String(variant.into()).into() };
    match content {
        Some(Value::Table(entries)) => Ok(Some(Value::Table([vec![tag], entries].concat()))),
        _ => Err(Failed(format!("\"{variant}\" has no table for its content"))),
    }
}

/// Values in order.
#[derive(Default)]
struct List(Vec<Node>, Option<&'static str>);

/// Named values.
#[derive(Default)]
struct Table(Vec<Entry>, Option<&'static str>, String);

impl List {
    fn add<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Failed> {
        let value = value_of(value)?.ok_or_else(|| Failed("a list with a hole".into()))?;
        self.0.push(value.into());
        Ok(())
    }
}

impl Table {
    fn add<T: Serialize + ?Sized>(&mut self, key: &str, value: &T) -> Result<(), Failed> {
        if let Some(value) = value_of(value)? {
            self.0.push(Entry { key: key.into(), key_span: None, node: value.into() });
        }
        Ok(())
    }

    fn end(self) -> Written {
        match self.1 {
            Some(variant) => tagged(variant, Some(Value::Table(self.0))),
            None => Ok(Some(Value::Table(self.0))),
        }
    }
}

macro_rules! numbers {
    ($($method:ident $type:ty),*) => {$(
        fn $method(self, v: $type) -> Written {
            i64::try_from(v).map(|i| Some(Value::Integer(i))).map_err(|_| Failed(format!("{v} is too large")))
        }
    )*};
}

impl Serializer for Tree {
    type Ok = Option<Value>;
    type Error = Failed;
    type SerializeSeq = List;
    type SerializeTuple = List;
    type SerializeTupleStruct = List;
    type SerializeTupleVariant = List;
    type SerializeMap = Table;
    type SerializeStruct = Table;
    type SerializeStructVariant = Table;

    numbers!(
        serialize_i8 i8, serialize_i16 i16, serialize_i32 i32, serialize_i64 i64,
        serialize_u8 u8, serialize_u16 u16, serialize_u32 u32, serialize_u64 u64
    );

    fn serialize_bool(self, v: bool) -> Written {
        Ok(Some(Value::Bool(v)))
    }
    /// The shortest number that is this one in single precision.
    fn serialize_f32(self, v: f32) -> Written {
        self.serialize_f64(v.to_string().parse().unwrap_or(f64::from(v)))
    }
    fn serialize_f64(self, v: f64) -> Written {
        match v.is_finite() {
            true => Ok(Some(Value::Float(v))),
            false => Err(Failed(format!("{v} is no number of a scene file"))),
        }
    }
    fn serialize_char(self, v: char) -> Written {
        Ok(Some(Value::String(v.into())))
    }
    fn serialize_str(self, v: &str) -> Written {
        Ok(Some(Value::String(v.into())))
    }
    fn serialize_bytes(self, _: &[u8]) -> Written {
        Err(Failed("bytes cannot be written".into()))
    }
    fn serialize_none(self) -> Written {
        Ok(None)
    }
    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Written {
        value_of(value)
    }
    fn serialize_unit(self) -> Written {
        Ok(None)
    }
    fn serialize_unit_struct(self, _: &'static str) -> Written {
        Ok(None)
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, variant: &'static str) -> Written {
        Ok(Some(Value::String(variant.into())))
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Written {
        value_of(value)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> Written {
        tagged(variant, value_of(value)?)
    }
    fn serialize_seq(self, _: Option<usize>) -> Result<List, Failed> {
        Ok(List::default())
    }
    fn serialize_tuple(self, _: usize) -> Result<List, Failed> {
        Ok(List::default())
    }
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<List, Failed> {
        Ok(List::default())
    }
    fn serialize_tuple_variant(self, _: &'static str, _: u32, variant: &'static str, _: usize) -> Result<List, Failed> {
        Ok(List(Vec::new(), Some(variant)))
    }
    fn serialize_map(self, _: Option<usize>) -> Result<Table, Failed> {
        Ok(Table::default())
    }
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Table, Failed> {
        Ok(Table::default())
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Table, Failed> {
        Ok(Table(Vec::new(), Some(variant), String::new()))
    }
}

macro_rules! lists {
    ($($trait:ident $method:ident),*) => {$(
        impl $trait for List {
            type Ok = Option<Value>;
            type Error = Failed;
            fn $method<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Failed> {
                self.add(value)
            }
            fn end(self) -> Written {
                match self.1 {
                    Some(variant) => Err(Failed(format!("\"{variant}\" has no table for its content"))),
                    None => Ok(Some(Value::Array(self.0))),
                }
            }
        }
    )*};
}
lists!(SerializeSeq serialize_element, SerializeTuple serialize_element);
lists!(SerializeTupleStruct serialize_field, SerializeTupleVariant serialize_field);

macro_rules! tables {
    ($($trait:ident),*) => {$(
        impl $trait for Table {
            type Ok = Option<Value>;
            type Error = Failed;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, key: &'static str, value: &T) -> Result<(), Failed> {
                self.add(key, value)
            }
            fn end(self) -> Written {
                Table::end(self)
            }
        }
    )*};
}
tables!(SerializeStruct, SerializeStructVariant);

impl SerializeMap for Table {
    type Ok = Option<Value>;
    type Error = Failed;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Failed> {
        match value_of(key)? {
            Some(Value::String(s)) => self.2 = s,
            _ => return Err(Failed("a key that is no text".into())),
        }
        Ok(())
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Failed> {
        let key = std::mem::take(&mut self.2);
        self.add(&key, value)
    }
    fn end(self) -> Written {
        Table::end(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BUILT_IN_SCENES;

    #[test]
    fn every_built_in_scene_comes_back() {
        for b in BUILT_IN_SCENES {
            let scene = SceneSource::open(b.name).expect("built in").description;
            let text = to_toml(&scene).expect(b.name);
            let (again, _): (SceneDescription, _) =
                crate::from_toml(&text, b.name).unwrap_or_else(|e| panic!("{}\n{text}", e.snippet()));
            assert_eq!(again, scene, "{}", b.name);
        }
    }

    #[test]
    fn names_and_numbers_of_any_kind_come_back() {
        let mut scene = SceneDescription { title: "a \"b\" \\ \u{7} ö\n".into(), ..SceneDescription::default() };
        let grey = |x: f32| MaterialDescription::Diffuse { reflectance: Texture::grey(x) };
        for (name, x) in [("a b.c", 0.1), ("", 1e-30), ("ö", -0.0), ("\"", 16_777_216.0)] {
            scene.materials.insert(name.into(), grey(x));
        }
        scene.groups.insert("x.y z".into(), Vec::new());
        let text = to_toml(&scene).expect("text");
        let (again, _): (SceneDescription, _) =
            crate::from_toml(&text, "").unwrap_or_else(|e| panic!("{}", e.snippet()));
        assert_eq!(again, scene, "{text}");
        scene.film.filter = rebond::film::FilterSettings::Box { radius: f32::NAN };
        assert!(to_toml(&scene).is_err());
    }

    #[test]
    fn a_scene_is_written_with_its_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("out/gallery.toml");
        let source = SceneSource::open("material-gallery").expect("built in");
        let written = convert(&source, &out).expect("written");
        assert!(written.len() > 3 && written.iter().all(|p| p.is_file()), "{written:?}");
        let again = SceneSource::open(&out.display().to_string()).expect("a scene");
        assert_eq!(again.description.shapes.len(), source.description.shapes.len());
        again.build().expect("all of its files are there");
        // Beside its files it needs no others.
        let second = out.with_file_name("again.toml");
        assert_eq!(convert(&again, &second).expect("written"), [second]);
        // Elsewhere they have the names that they had.
        let third = folder.path().join("elsewhere/gallery.toml");
        let there = convert(&again, &third).expect("written");
        let names = |files: &[PathBuf], from: &Path| -> Vec<PathBuf> {
            let within = files.iter().map(|f| f.strip_prefix(from).expect("within").to_path_buf());
            within.collect()
        };
        assert_eq!(names(&there, &folder.path().join("elsewhere")), names(&written, &folder.path().join("out")));
    }

    #[test]
    fn no_file_of_the_user_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name).display().to_string();
        std::fs::create_dir(at("d-files")).expect("a folder");
        let theirs = write_ply(&crate::import::tube());
        std::fs::write(at("d-files/cylinder.ply"), [&theirs[..], b"\n"].concat()).expect("a mesh");
        let xml = r#"<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/><shape type="cylinder"/>
            <shape type="ply"><string name="filename" value="d-files/cylinder.ply"/></shape></scene>"#;
        std::fs::write(at("s.xml"), xml).expect("a scene");
        let source = SceneSource::open(&at("s.xml")).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let out = folder.path().join("d.toml");
        let written = convert(&source, &out).expect("written");
        assert_eq!(written, [out.clone(), folder.path().join("d-files/cylinder-2.ply")]);
        assert_eq!(std::fs::read(at("d-files/cylinder.ply")).expect("theirs"), [&theirs[..], b"\n"].concat());
        // Once more it is the same files.
        assert_eq!(convert(&source, &out).expect("written"), written);
        // Nor are the scene itself and what it names, however they are called.
        for name in ["s.xml", "d-files/../s.xml", "d-files/cylinder.ply"] {
            let error = convert(&source, &folder.path().join(name)).expect_err(name);
            assert!(error.message.contains("is what is to be converted"), "{error}");
        }
        let again = SceneSource::open(&at("d.toml")).expect("a scene");
        assert!(convert(&again, &out).is_err());
        // By another name the scene stays what it is.
        let text = std::fs::read(&out).expect("the scene");
        std::fs::hard_link(at("s.xml"), at("linked.toml")).expect("a link");
        assert_eq!(convert(&source, &folder.path().join("linked.toml")).expect("written").len(), 2);
        assert_ne!(std::fs::read(at("linked.toml")).expect("a scene"), xml.as_bytes());
        assert_eq!(std::fs::read(&out).expect("the scene"), text);
        // Nothing is left of a failure.
        std::fs::create_dir(at("folder.toml")).expect("a folder");
        assert!(convert(&source, &folder.path().join("folder.toml")).is_err());
        let mut names = std::fs::read_dir(folder.path()).expect("a folder").map(|e| e.expect("an entry").file_name());
        assert!(names.all(|n| !n.to_string_lossy().contains(".part")));
        assert_eq!(std::fs::read_to_string(at("s.xml")).expect("the scene"), xml);
    }
}
