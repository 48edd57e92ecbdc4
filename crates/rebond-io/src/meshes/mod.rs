//! Mesh files: bytes in, indexed triangles out.

mod obj;
mod ply;

use crate::error::Error;

pub use obj::read_obj;
pub use ply::{read_ply, write_ply};

/// Triangles over shared vertices. Every index is valid and the optional lists are as long as the positions; positions
/// may still be NaN or infinite, and triangles degenerate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Where the vertices are.
    pub positions: Vec<[f32; 3]>,
    /// The vertices' shading normals as the file has them, of any length.
    pub normals: Option<Vec<[f32; 3]>>,
    /// The vertices' texture coordinates.
    pub uvs: Option<Vec<[f32; 2]>>,
    /// Three vertices each, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

/// Reads a mesh in either format, known by its content; `name` is what errors call it.
pub fn read_mesh(bytes: &[u8], name: &str) -> Result<MeshData, Error> {
    if bytes.starts_with(b"ply") { read_ply(bytes, name) } else { read_obj(bytes, name) }
}

/// The triangles of a polygon, all at its first vertex.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    polygon.windows(2).skip(1).map(|edge| [polygon[0], edge[0], edge[1]])
}

#[cfg(test)]
mod tests;
