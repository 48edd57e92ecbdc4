//! Wavefront OBJ: its polygons; groups, materials, lines and curves are passed over.
//! Alias Wavefront, "Advanced Visualizer manual", appendix B1: Object files.
//!
//! Own code, since no kept crate does this part well: `tobj` mixes up normals once some faces have none, splits vertices
//! at every group, and neither it nor `obj` can say which face names a missing vertex.

use super::{MeshData, fan};
use crate::error::{Error, Place};
use std::collections::HashMap;

/// Reads a mesh; `name` is what errors call the file.
///
/// Where some faces have normals, those without get their geometric one; where some have texture coordinates, the
/// others get (0, 0).
pub fn read_obj(bytes: &[u8], name: &str) -> Result<MeshData, Error> {
    let mut file = File::default();
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        file.line(&line).map_err(|(word, message)| {
            // The word is a part of the line, hence the difference of their addresses its place.
            let start = (word.as_ptr() as usize).saturating_sub(line.as_ptr() as usize);
            let column = line.get(..start).map_or(1, |before| before.chars().count() + 1);
            let place = Place {
                line: number + 1,
                column,
                width: word.chars().count().max(1),
                source_line: line.trim_end().to_string(),
            };
            Error { place: Some(Box::new(place)), ..Error::new(message) }.with_file(name)
        })?;
    }
    if file.corners.is_empty() {
        let message = if file.positions.is_empty() { "not an OBJ mesh: it has no vertices" } else { "it has no faces" };
        return Err(Error::new(message).with_file(name));
    }
    Ok(file.mesh())
}

/// No texture coordinate, no normal.
const NONE: u32 = u32::MAX;

/// A vertex of a face: its position, texture coordinate and normal.
type Corner = [u32; 3];

#[derive(Default)]
struct File {
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    corners: Vec<[Corner; 3]>,
    polygon: Vec<Corner>,
    has_uvs: bool,
    has_normals: bool,
}

impl File {
    /// Reads a line, or says which word of it is wrong and why.
    fn line<'l>(&mut self, line: &'l str) -> Result<(), (&'l str, String)> {
        let line = line.split('#').next().unwrap_or_default();
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => self.positions.push(numbers(line, words, 3)?),
            Some("vn") => self.normals.push(numbers(line, words, 3)?),
            Some("vt") => self.uvs.push(numbers(line, words, 1)?),
            Some("f") => {
                self.polygon.clear();
                for word in words {
                    let corner = self.corner(word).map_err(|message| (word, message))?;
                    self.polygon.push(corner);
                    self.has_uvs |= corner[1] != NONE;
                    self.has_normals |= corner[2] != NONE;
                }
                if self.polygon.len() < 3 {
                    return Err((line.trim(), format!("a face of {} vertices", self.polygon.len())));
                }
                let order: Vec<u32> = (0..self.polygon.len() as u32).collect();
                self.corners.extend(fan(&order).map(|t| t.map(|i| self.polygon[i as usize])));
            }
            _ => {}
        }
        Ok(())
    }

    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let mut next = |what, count| index(parts.next().unwrap_or_default(), what, count);
        let corner = [
            next("vertex", self.positions.len())?,
            next("texture coordinate", self.uvs.len())?,
            next("normal", self.normals.len())?,
        ];
        match corner[0] {
            NONE => Err(format!("\"{word}\" names no vertex")),
            _ => Ok(corner),
        }
    }

    fn mesh(self) -> MeshData {
        let all = self.corners.iter();
        if !self.has_uvs && !self.has_normals {
            let triangles = all.map(|t| t.map(|[position, ..]| position)).collect();
            return MeshData { positions: self.positions, triangles, ..MeshData::default() };
        }
        let (mut positions, mut uvs, mut normals) = (Vec::new(), Vec::new(), Vec::new());
        let mut known: HashMap<Corner, u32> = HashMap::new();
        let triangle = |triangle: &[Corner; 3]| {
            triangle.map(|corner| {
                let [position, uv, normal] = corner.map(|i| i as usize);
                let mut add = |normal| {
                    positions.push(self.positions[position]);
                    uvs.push(self.uvs.get(uv).copied().unwrap_or_default());
                    normals.push(normal);
                    (positions.len() - 1) as u32
                };
                match self.normals.get(normal) {
                    None if self.has_normals => add(geometric_normal(triangle.map(|c| self.positions[c[0] as usize]))),
                    normal => *known.entry(corner).or_insert_with(|| add(normal.copied().unwrap_or_default())),
                }
            })
        };
        let triangles = all.map(triangle).collect();
        let (has_uvs, has_normals) = (self.has_uvs, self.has_normals);
        MeshData { positions, normals: has_normals.then_some(normals), uvs: has_uvs.then_some(uvs), triangles }
    }
}

/// The first numbers of a line, of which some must be there.
fn numbers<'l, const N: usize>(
    line: &'l str,
    words: impl Iterator<Item = &'l str>,
    needed: usize,
) -> Result<[f32; N], (&'l str, String)> {
    let mut values = [0.0; N];
    let mut found = 0;
    for (value, word) in values.iter_mut().zip(words) {
        *value = word.parse().map_err(|_| (word, format!("\"{word}\" is not a number")))?;
        found += 1;
    }
    match found < needed {
        true => Err((line.trim(), format!("expected {needed} numbers, found {found}"))),
        false => Ok(values),
    }
}

/// The place in a list that a number from 1, or back from -1, or nothing stands for.
fn index(word: &str, what: &str, count: usize) -> Result<u32, String> {
    if word.is_empty() {
        return Ok(NONE);
    }
    let number: i64 = word.parse().map_err(|_| format!("\"{word}\" is not the number of a {what}"))?;
    let index = if number < 0 { count as i64 + number } else { number - 1 };
    match u32::try_from(index) {
        Ok(index) if (index as usize) < count && index != NONE => Ok(index),
        _ => Err(format!("this face wants {what} {number}, but there are {count} before it")),
    }
}

fn geometric_normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let edge = |p: [f32; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v) = (edge(b), edge(c));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}
