//! PLY, ascii and binary. Turk, "The PLY Polygon File Format" (1994).
//!
//! Parsed by `serde-ply`: two million triangles of binary PLY (38 MB) take it 0.5 s, `ply-rs-bw` 3.2 s.

use super::{MeshData, fan};
use crate::error::Error;
use serde::de::{self, DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{DeserializeError, PlyFormat, PlyReader, PropertyType};
use std::borrow::Cow;
use std::fmt;
use std::io::Cursor;

/// What texture coordinates may be called.
pub(crate) const UV_NAMES: [[&str; 2]; 4] =
    [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// Reads a mesh: of vertices the properties `x y z`, `nx ny nz` and `u v` (or `s t`, `texture_u texture_v`, `texture_s texture_t`), of faces
/// the list `vertex_indices` (or `vertex_index`). Polygons become fans. `name` is what errors call the file.
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

    let mut mesh = MeshData {
        normals: normals.then(Vec::new),
        uvs: uvs.then(Vec::new),
        // A hostile count must not take memory that the file does not back.
        positions: Vec::with_capacity(vertex.count.min(bytes.len() / 3)),
        triangles: Vec::with_capacity(face.count.min(bytes.len() / 4)),
    };
    let vertices = vertex.count;
    while let Some(element) = ply.current_element() {
        let name = element.name.clone();
        let result = match &*name {
            "vertex" => (&mut ply).next_value_seed(Rows(|row: &mut Row| {
                mesh.positions.push(row.position);
                if let Some(normals) = &mut mesh.normals {
                    normals.push(row.normal);
                }
                if let Some(uvs) = &mut mesh.uvs {
                    uvs.push(row.uv);
                }
                Ok(())
            })),
            "face" => (&mut ply).next_value_seed(Rows(|row: &mut Row| {
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
                Ok(())
            })),
            _ => (&mut ply).next_value_seed(Rows(|_: &mut Row| Ok(()))),
        };
        result.map_err(|e| match words(e) {
            // Our own, of a row.
            row if row.starts_with(|c: char| c.is_ascii_digit()) => format!("{name} {row}"),
            other => format!("in its {name} data: {other}"),
        })?;
    }
    Ok(mesh)
}

/// The parser's error in its own words.
fn words(error: DeserializeError) -> String {
    match error.to_string().trim_start_matches("Error while deserializing ply: ") {
        "failed to fill whole buffer" => "it ends too early".into(),
        other => other.into(),
    }
}

/// Every row of an element, one after the other in the same place, handed to a function.
struct Rows<F>(F);

/// What a row may hold of interest.
#[derive(Default)]
struct Row {
    position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    polygon: Vec<i64>,
    corners: Vec<u32>,
}

impl<'de, F: FnMut(&mut Row) -> Result<(), String>> DeserializeSeed<'de> for Rows<F> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de, F: FnMut(&mut Row) -> Result<(), String>> Visitor<'de> for Rows<F> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("rows")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut rows: A) -> Result<(), A::Error> {
        let mut row = Row::default();
        let mut index = 0usize;
        while rows.next_element_seed(&mut row)?.is_some() {
            self.0(&mut row).map_err(|problem| de::Error::custom(format_args!("{index}: {problem}")))?;
            index += 1;
        }
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for &mut Row {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for &mut Row {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a row")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut row: A) -> Result<(), A::Error> {
        while let Some(key) = row.next_key::<Key>()? {
            match key {
                Key::Position(i) => self.position[i] = row.next_value()?,
                Key::Normal(i) => self.normal[i] = row.next_value()?,
                Key::Uv(i) => self.uv[i] = row.next_value()?,
                Key::Polygon => row.next_value_seed(Polygon(&mut self.polygon))?,
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
    Other,
}

impl<'de> de::Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Name;
        impl Visitor<'_> for Name {
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
                    _ => Key::Other,
                })
            }
        }
        deserializer.deserialize_identifier(Name)
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
    header += &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.triangles.len());
    let mut bytes = header.into_bytes();
    bytes.reserve(mesh.positions.len() * 32 + mesh.triangles.len() * 13);
    for i in 0..mesh.positions.len() {
        let row = [
            Some(&mesh.positions[i][..]),
            mesh.normals.as_ref().map(|n| &n[i][..]),
            mesh.uvs.as_ref().map(|t| &t[i][..]),
        ];
        bytes.extend(row.into_iter().flatten().flatten().flat_map(|v| v.to_le_bytes()));
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}
