//! PLY, ascii and binary. Turk, "The PLY Polygon File Format" (1994).
//!
//! Parsed by `serde-ply`: two million triangles of binary PLY (38 MB) take it 0.5 s, `ply-rs-bw` 3.2 s.

use super::{MeshData, fan};
use crate::error::Error;
use serde::de::{self, DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{DeserializeError, ElementDef, PlyFormat, PlyReader, PropertyType, ScalarType};
use std::borrow::Cow;
use std::fmt;
use std::io::Cursor;

/// What texture coordinates may be called.
pub(crate) const UV_NAMES: [[&str; 2]; 4] =
    [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// Reads a mesh: of vertices the properties `x y z`, `nx ny nz` and `u v` (or `s t`, `texture_u texture_v`, `texture_s texture_t`), of faces
/// the list `vertex_indices` (or `vertex_index`). Polygons become fans. Further properties of vertices and faces are attributes, named as
/// Mitsuba 3 does: `r g b` (or `red green blue`) are `vertex_color`, `a_r a_g a_b` are `vertex_a_color`, `a_x a_y a_z` (or 0, 1 and 2, or 1, 2
/// and 3) are `vertex_a`, one of these alone is one number; whole numbers are shares of the largest of their
/// type. `name` is what errors call the file.
pub fn read_ply(bytes: &[u8], name: &str) -> Result<MeshData, Error> {
    read(bytes).map_err(|problem| Error::new(format!("not a valid PLY mesh: {problem}")).with_file(name))
}

fn read(bytes: &[u8]) -> Result<MeshData, String> {
    let reader = |bytes| PlyReader::from_reader(Cursor::new(bytes)).map_err(words);
    let mut ply = reader(Cow::Borrowed(bytes))?;
    if ply.header().format == PlyFormat::Ascii {
        // The parser wants white space after the last number.
        ply = reader(Cow::Owned([bytes, b"\n"].concat()))?;
    }
    let vertex = ply.header().get_element("vertex").ok_or("it has no vertices")?;
    let face = ply.header().get_element("face").ok_or("it has no faces")?;
    let scalar = |p: &str| vertex.get_property(p).is_some_and(|p| matches!(p.property_type, PropertyType::Scalar(_)));
    if let Some(missing) = ["x", "y", "z"].into_iter().find(|p| !scalar(p)) {
        return Err(format!("its vertices have no {missing}"));
    }
    let Some(list) = ["vertex_indices", "vertex_index"].into_iter().find_map(|p| face.get_property(p)) else {
        return Err("its faces have no vertex_indices".into());
    };
    if matches!(list.property_type, PropertyType::Scalar(_)) {
        return Err("the vertex_indices of its faces are not a list".into());
    }
    if vertex.count == 0 || face.count == 0 {
        return Err(format!("it has {} vertices and {} faces", vertex.count, face.count));
    }
    let normals = ["nx", "ny", "nz"].into_iter().all(scalar);
    let uvs = UV_NAMES.into_iter().any(|p| p.into_iter().all(scalar));

    let (of_vertices, of_faces) = (Columns::of(vertex, "vertex"), Columns::of(face, "face"));
    let (vertex_count, face_count) = (vertex.count, face.count);
    let mut mesh = MeshData {
        normals: normals.then(Vec::new),
        uvs: uvs.then(Vec::new),
        // A hostile count must not take memory that the file does not back.
        positions: Vec::with_capacity(vertex_count.min(bytes.len() / 3)),
        triangles: Vec::with_capacity(face_count.min(bytes.len() / 4)),
        ..MeshData::default()
    };
    let mut values = [vec![Vec::new(); of_vertices.names.len()], vec![Vec::new(); of_faces.names.len()]];
    let vertices = vertex_count;
    while let Some(element) = ply.current_element() {
        let name = element.name.clone();
        let result = match &*name {
            "vertex" => (&mut ply).next_value_seed(Rows(&of_vertices, |row: &mut Row| {
                mesh.positions.push(row.position);
                if let Some(normals) = &mut mesh.normals {
                    normals.push(row.normal);
                }
                if let Some(uvs) = &mut mesh.uvs {
                    uvs.push(row.uv);
                }
                values[0].iter_mut().zip(&row.values).for_each(|(all, value)| all.push(*value));
                Ok(())
            })),
            "face" => (&mut ply).next_value_seed(Rows(&of_faces, |row: &mut Row| {
                if row.polygon.len() < 3 {
                    return Err(format!("it has {} vertices", row.polygon.len()));
                }
                for &index in &row.polygon {
                    if !(0..vertices as i64).contains(&index) {
                        return Err(format!("its vertex {index} is none of the {vertices} vertices"));
                    }
                }
                row.corners.clear();
                row.corners.extend(row.polygon.iter().map(|&i| i as u32));
                mesh.triangles.extend(fan(&row.corners));
                let triangles = mesh.triangles.len();
                values[1].iter_mut().zip(&row.values).for_each(|(all, value)| all.resize(triangles, *value));
                Ok(())
            })),
            _ => (&mut ply).next_value_seed(Rows(&Columns::default(), |_: &mut Row| Ok(()))),
        };
        result.map_err(|e| match words(e) {
            // Our own, of a row.
            row if row.starts_with(|c: char| c.is_ascii_digit()) => format!("{name} {row}"),
            other => format!("in its {name} data: {other}"),
        })?;
    }
    let [of_vertex, of_face] = values;
    let names = of_vertices.names.into_iter().chain(of_faces.names);
    mesh.attributes = names.zip(of_vertex.into_iter().chain(of_face)).collect();
    Ok(mesh)
}

/// The properties of an element that are attributes.
#[derive(Default)]
struct Columns {
    names: Vec<String>,
    /// Name of the property, attribute, channel if it is one of three, and the value that is 1.
    columns: Vec<(String, usize, Option<usize>, f32)>,
}

impl Columns {
    fn of(element: &ElementDef, prefix: &str) -> Self {
        const ENDINGS: [[&str; 3]; 4] = [["r", "g", "b"], ["x", "y", "z"], ["0", "1", "2"], ["1", "2", "3"]];
        let most = |name: &str| match element.get_property(name).map(|p| &p.property_type) {
            Some(PropertyType::Scalar(kind)) => Some(match kind {
                ScalarType::I8 => f32::from(i8::MAX),
                ScalarType::U8 => f32::from(u8::MAX),
                ScalarType::I16 => f32::from(i16::MAX),
                ScalarType::U16 => f32::from(u16::MAX),
                ScalarType::I32 => i32::MAX as f32,
                ScalarType::U32 => u32::MAX as f32,
                ScalarType::F32 | ScalarType::F64 => 1.0,
            }),
            _ => None,
        };
        let mut found = Self::default();
        let mut add = |name: String, properties: &[String]| {
            let taken = |known: &str| found.columns.iter().any(|(column, ..)| column == known);
            let there = properties.iter().all(|p| most(p).is_some() && !taken(p));
            if !there || found.names.contains(&name) {
                return false;
            }
            for (channel, property) in properties.iter().enumerate() {
                let channel = (properties.len() == 3).then_some(channel);
                found.columns.push((property.clone(), found.names.len(), channel, most(property).unwrap_or(1.0)));
            }
            found.names.push(name);
            true
        };
        for colors in [["r", "g", "b"], ["red", "green", "blue"]] {
            add(format!("{prefix}_color"), &colors.map(String::from));
        }
        for name in element.properties.iter().map(|p| &p.name) {
            let Some((stem, end)) = name.rsplit_once('_').filter(|(stem, _)| !stem.is_empty()) else { continue };
            let is_there = |end: &&str| most(&format!("{stem}_{end}")).is_some();
            // 1 and 2 may be of 0, 1 and 2, or of 1, 2 and 3: of what is whole.
            let ending = |e: &&[&str; 3]| e.contains(&end) && (e.iter().all(is_there) || e[0] == end);
            let Some(ending) = ENDINGS.iter().find(ending) else { continue };
            let whole = if ending[0] == "r" { format!("{prefix}_{stem}_color") } else { format!("{prefix}_{stem}") };
            if !add(whole.clone(), &ending.map(|e| format!("{stem}_{e}"))) {
                add(whole, std::slice::from_ref(name));
            }
        }
        found
    }
}

/// The parser's error in its own words.
fn words(error: DeserializeError) -> String {
    match error.to_string().trim_start_matches("Error while deserializing ply: ") {
        "failed to fill whole buffer" => "it ends too early".into(),
        other => other.into(),
    }
}

/// Every row of an element, one after the other in the same place, handed to a function.
struct Rows<'a, F>(&'a Columns, F);

/// What a row may hold of interest.
#[derive(Default)]
struct Row {
    position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    polygon: Vec<i64>,
    corners: Vec<u32>,
    /// Of each attribute.
    values: Vec<[f32; 3]>,
}

impl<'de, F: FnMut(&mut Row) -> Result<(), String>> DeserializeSeed<'de> for Rows<'_, F> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, F: FnMut(&mut Row) -> Result<(), String>> Visitor<'de> for Rows<'_, F> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut rows: A) -> Result<(), A::Error> {
        let mut row = Row { values: vec![[0.0; 3]; self.0.names.len()], ..Row::default() };
        let mut index = 0usize;
        while rows.next_element_seed(OneRow(self.0, &mut row))?.is_some() {
            self.1(&mut row).map_err(|problem| de::Error::custom(format_args!("{index}: {problem}")))?;
            index += 1;
        }
        Ok(())
    }
}

/// A row and its attributes.
struct OneRow<'a>(&'a Columns, &'a mut Row);

impl<'de> DeserializeSeed<'de> for OneRow<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for OneRow<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a row")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut row: A) -> Result<(), A::Error> {
        let Self(columns, found) = self;
        while let Some(key) = row.next_key_seed(Name(columns))? {
            match key {
                Key::Position(i) => found.position[i] = row.next_value()?,
                Key::Normal(i) => found.normal[i] = row.next_value()?,
                Key::Uv(i) => found.uv[i] = row.next_value()?,
                Key::Polygon => row.next_value_seed(Polygon(&mut found.polygon))?,
                Key::Attribute(i) => {
                    let (_, attribute, channel, most) = columns.columns[i];
                    let value = row.next_value::<f32>()? / most;
                    match channel {
                        Some(channel) => found.values[attribute][channel] = value,
                        None => found.values[attribute] = [value; 3],
                    }
                }
                Key::Other => drop(row.next_value::<IgnoredAny>()?),
            }
        }
        Ok(())
    }
}

enum Key {
    Position(usize),
    Normal(usize),
    Uv(usize),
    Polygon,
    Attribute(usize),
    Other,
}

/// What a property's name stands for.
struct Name<'a>(&'a Columns);

impl<'de> DeserializeSeed<'de> for Name<'_> {
    type Value = Key;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Key, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl Visitor<'_> for Name<'_> {
    type Value = Key;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a property")
    }

    fn visit_bytes<E>(self, name: &[u8]) -> Result<Key, E> {
        Ok(match name {
            b"x" => Key::Position(0),
            b"y" => Key::Position(1),
            b"z" => Key::Position(2),
            b"nx" => Key::Normal(0),
            b"ny" => Key::Normal(1),
            b"nz" => Key::Normal(2),
            b"u" | b"s" | b"texture_u" | b"texture_s" => Key::Uv(0),
            b"v" | b"t" | b"texture_v" | b"texture_t" => Key::Uv(1),
            b"vertex_indices" | b"vertex_index" => Key::Polygon,
            _ => match self.0.columns.iter().position(|(column, ..)| column.as_bytes() == name) {
                Some(i) => Key::Attribute(i),
                None => Key::Other,
            },
        })
    }
}

/// A face's vertices, read over those of the face before.
struct Polygon<'a>(&'a mut Vec<i64>);

impl<'de> DeserializeSeed<'de> for Polygon<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Polygon<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of vertices")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        self.0.clear();
        while let Some(index) = list.next_element()? {
            self.0.push(index);
        }
        Ok(())
    }
}

/// Writes a mesh as binary little-endian PLY.
pub fn write_ply(mesh: &MeshData) -> Vec<u8> {
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", mesh.positions.len());
    let names = [
        (true, &["x", "y", "z"][..]),
        (mesh.normals.is_some(), &["nx", "ny", "nz"]),
        (mesh.uvs.is_some(), &["u", "v"]),
    ];
    for name in names.into_iter().filter(|(present, _)| *present).flat_map(|(_, names)| names) {
        header += &format!("property float {name}\n");
    }
    let attributes = |(prefix, count): (&str, usize)| -> Vec<(String, &Vec<[f32; 3]>)> {
        let fitting = mesh.attributes.iter().filter(|(_, values)| values.len() == count);
        fitting.filter_map(|(name, values)| Some((name.strip_prefix(prefix)?.into(), values))).collect()
    };
    let counts = [("vertex_", mesh.positions.len()), ("face_", mesh.triangles.len())];
    let [of_vertices, of_faces] = counts.map(attributes);
    let properties = |attributes: &[(String, &Vec<[f32; 3]>)]| -> String {
        let ends = |name: &str| match name {
            "color" => ["r", "g", "b"].map(String::from),
            _ => ["x", "y", "z"].map(|end| format!("{name}_{end}")),
        };
        attributes.iter().flat_map(|(name, _)| ends(name)).map(|name| format!("property float {name}\n")).collect()
    };
    header += &properties(&of_vertices);
    header += &format!("element face {}\nproperty list uchar int vertex_indices\n", mesh.triangles.len());
    header += &properties(&of_faces);
    header += "end_header\n";
    let mut bytes = header.into_bytes();
    bytes.reserve(mesh.positions.len() * 32 + mesh.triangles.len() * 13);
    for i in 0..mesh.positions.len() {
        let row = [
            Some(&mesh.positions[i][..]),
            mesh.normals.as_ref().map(|n| &n[i][..]),
            mesh.uvs.as_ref().map(|t| &t[i][..]),
        ];
        let more = of_vertices.iter().flat_map(|(_, values)| values[i]);
        bytes.extend(row.into_iter().flatten().flatten().copied().chain(more).flat_map(f32::to_le_bytes));
    }
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
        bytes.extend(of_faces.iter().flat_map(|(_, values)| values[i]).flat_map(f32::to_le_bytes));
    }
    bytes
}
