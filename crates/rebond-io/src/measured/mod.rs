//! Measured materials: bytes in, tables out.
//!
//! | file | known by | what it is |
//! |---|---|---|
//! | `.safetensors` | its header | the lecture's table `f_r[θi][φi][θo][φo][colour]`; `rebond capture` writes it |
//! | `.bsdf` | `tensor_file` | the RGL database (Dupuy and Jakob 2018) |
//! | `.binary` | neither | the MERL database (Matusik et al. 2003) |
//!
//! Every length in a file is held against the file's own before memory is taken for it.

mod angles;
mod merl;
mod rgl;
mod spectrum;

pub use angles::write_table;

use crate::error::Error;
use rebond::bsdf::measured::Measured;

/// Reads a measured material; the format is known by the content. `name` is what errors call it.
pub fn read_measured(bytes: &[u8], name: &str) -> Result<Measured, Error> {
    let (format, table) = if bytes.starts_with(rgl::MAGIC) {
        ("RGL material", rgl::read(bytes).map(Measured::Adaptive))
    } else if matches!(bytes.get(8..10), Some([b'{', b'"' | b'}' | b' ' | b'\n'])) {
        ("safetensors table", angles::read(bytes).map(Measured::Angles))
    } else {
        ("MERL material", merl::read(bytes).map(Measured::HalfDifference))
    };
    table.map_err(|problem| {
        let error = Error::new(format!("not a valid {format}: {problem}")).with_file(name);
        error.with_help("readable are rebond's tables (.safetensors), MERL's (.binary) and RGL's (.bsdf)")
    })
}
