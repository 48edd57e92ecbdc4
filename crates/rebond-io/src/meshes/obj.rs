//! Wavefront OBJ: its polygons, and which material they wear; groups, lines and curves are passed over.
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
    File::read(bytes, name).map(File::mesh)
}

/// What a file asks for by name, and where.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Named {
    pub name: String,
    pub place: Place,
}

/// An OBJ file by materials.
#[derive(Debug)]
pub(crate) struct Parts {
    /// Files of materials.
    pub libraries: Vec<Named>,
    /// Faces of one material each, in the order in which those are first used.
    pub parts: Vec<(Option<Named>, MeshData)>,
}

/// Reads the meshes of a file, one for each material.
pub(crate) fn read_obj_parts(bytes: &[u8], name: &str) -> Result<Parts, Error> {
    let mut file = File::read(bytes, name)?;
    let corners = std::mem::take(&mut file.corners);
    let mut ranges: Vec<(Option<Named>, Vec<[Corner; 3]>)> = Vec::new();
    let mut numbers: HashMap<Option<String>, usize> = HashMap::new();
    let ends = file.uses.iter().skip(1).map(|(first, _)| *first).chain([corners.len()]);
    for ((first, material), end) in file.uses.iter().zip(ends) {
        if *first == end {
            continue;
        }
        let number = *numbers.entry(material.as_ref().map(|m| m.name.clone())).or_insert(ranges.len());
        if number == ranges.len() {
            ranges.push((material.clone(), Vec::new()));
        }
        ranges[number].1.extend_from_slice(&corners[*first..end]);
    }
    let parts = ranges.into_iter().map(|(material, corners)| (material, file.part(&corners))).collect();
    Ok(Parts { libraries: file.libraries, parts })
}

/// The place of a word in its line.
pub(crate) fn place_in(line: &str, word: &str, number: usize) -> Place {
    // The word is a part of the line, hence the difference of their addresses its place.
    let start = (word.as_ptr() as usize).saturating_sub(line.as_ptr() as usize);
    let column = line.get(..start).map_or(1, |before| before.chars().count() + 1);
    Place { line: number, column, width: word.chars().count().max(1), source_line: line.trim_end().to_string() }
}

/// No texture coordinate, no normal.
const NONE: u32 = u32::MAX;

/// A vertex of a face: its position, texture coordinate and normal.
type Corner = [u32; 3];

struct File {
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    corners: Vec<[Corner; 3]>,
    polygon: Vec<Corner>,
    has_uvs: bool,
    has_normals: bool,
    libraries: Vec<Named>,
    /// From which triangle on which material is worn.
    uses: Vec<(usize, Option<Named>)>,
}

impl File {
    fn read(bytes: &[u8], name: &str) -> Result<Self, Error> {
        let mut file = Self {
            positions: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            corners: Vec::new(),
            polygon: Vec::new(),
            has_uvs: false,
            has_normals: false,
            libraries: Vec::new(),
            uses: vec![(0, None)],
        };
        for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
            let line = String::from_utf8_lossy(line);
            file.line(&line, number + 1).map_err(|(word, message)| {
                let place = place_in(&line, word, number + 1);
                Error { place: Some(Box::new(place)), ..Error::new(message) }.with_file(name)
            })?;
        }
        if file.corners.is_empty() {
            let message =
                if file.positions.is_empty() { "not an OBJ mesh: it has no vertices" } else { "it has no faces" };
            return Err(Error::new(message).with_file(name));
        }
        Ok(file)
    }

    /// Reads a line, or says which word of it is wrong and why.
    fn line<'l>(&mut self, line: &'l str, number: usize) -> Result<(), (&'l str, String)> {
        let whole = line;
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
            // Names may have spaces in them.
            Some(key @ ("usemtl" | "mtllib")) => {
                let name = line.trim().get(key.len()..).unwrap_or_default().trim();
                let named = Named { name: name.to_string(), place: place_in(whole, name, number) };
                match key {
                    "usemtl" => self.uses.push((self.corners.len(), Some(named))),
                    _ => self.libraries.push(named),
                }
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

    fn mesh(mut self) -> MeshData {
        if !self.has_uvs && !self.has_normals {
            let triangles = self.corners.iter().map(|t| t.map(|[position, ..]| position)).collect();
            return MeshData { positions: self.positions, triangles, ..MeshData::default() };
        }
        let corners = std::mem::take(&mut self.corners);
        self.part(&corners)
    }

    /// The mesh of some faces, with the vertices that they use.
    fn part(&self, corners: &[[Corner; 3]]) -> MeshData {
        let has = |i: usize| corners.iter().flatten().any(|c| c[i] != NONE);
        let (has_uvs, has_normals) = (has(1), has(2));
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
                    None if has_normals => add(geometric_normal(triangle.map(|c| self.positions[c[0] as usize]))),
                    normal => *known.entry(corner).or_insert_with(|| add(normal.copied().unwrap_or_default())),
                }
            })
        };
        let triangles = corners.iter().map(triangle).collect();
        let (normals, uvs) = (has_normals.then_some(normals), has_uvs.then_some(uvs));
        MeshData { positions, normals, uvs, triangles, ..MeshData::default() }
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
