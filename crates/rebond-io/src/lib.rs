//! Scene files, images and measured materials to and from rebond's types: bytes in, values out.
#![forbid(unsafe_code)]

pub mod deserialize;
pub mod document;
mod error;
mod glb;
pub mod images;
pub mod measured;
pub mod meshes;
mod scene;
mod solution;

pub use deserialize::{from_settings, from_toml};
pub use document::Document;
pub use error::{Error, Place};
pub use glb::write_glb;
pub use images::{ImageFormat, PngOptions, Tonemap, read_image, read_image_raw, write_image};
pub use measured::{read_measured, write_table};
pub use meshes::{MeshData, read_mesh, read_obj, read_ply, write_ply};
pub use scene::{BUILT_IN_SCENES, BuiltIn, SceneFiles, SceneSource};
pub use solution::{read_solution, write_solution};
