//! Mesh files: bytes in, indexed triangles out.

mod obj;
mod ply;

use crate::error::Error;

pub use obj::read_obj;
pub(crate) use obj::{Named, place_in, read_obj_parts};
pub(crate) use ply::UV_NAMES;
pub use ply::{read_ply, write_ply};
pub use rebond::shape::MeshData;

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
