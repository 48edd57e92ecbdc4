//! Scene files, images and measured materials to and from rebond's types: bytes in, values out.
#![forbid(unsafe_code)]

pub mod deserialize;
pub mod document;
mod error;
mod glb;
pub mod gltf;
pub mod images;
mod import;
pub mod measured;
pub mod meshes;
pub mod mitsuba;
pub mod pbrt;
mod scene;
mod solution;
pub mod wavefront;
mod write;

pub use deserialize::{from_settings, from_toml};
pub use document::Document;
pub use error::{Error, Place};
pub use glb::write_glb;
pub use gltf::read_gltf;
pub use images::{ImageFormat, PngOptions, Tonemap, read_image, read_image_raw, write_image};
pub use import::{Assets, ImportOptions, Imported, Places};
pub use measured::{read_measured, write_table};
pub use meshes::{MeshData, read_mesh, read_obj, read_ply, write_ply};
pub use mitsuba::read_mitsuba;
pub use pbrt::read_pbrt;
pub use scene::{BUILT_IN_SCENES, BuiltIn, SceneFiles, SceneSource};
pub use solution::{read_solution, write_solution};
pub use wavefront::read_obj_scene;
pub use write::{convert, to_toml};
