//! The lecture's table in a safetensors file: the tensor `f_r`, shape `[θi, φi, θo, φo, 3]`, the last varying fastest, f32
//! or f64, in sr⁻¹ and linear Rec. 709; i is the light's side, o the viewer's. Sample k of n stands at `θ = k · 90°/n` and
//! `φ = k · 360°/n`; with a single φi the material is isotropic, and φo counts from φi. The metadata `rebond` says so in
//! words and begins with `version=1;`; a file without it counts as that version.
//!
//! In Python: `safetensors.numpy.save_file({"f_r": array}, "material.safetensors")`.

use rebond::bsdf::measured::AngleTable;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;

const TENSOR: &str = "f_r";
const METADATA: &str = "rebond";
const VERSION: &str = "version=1;";

pub(super) fn read(bytes: &[u8]) -> Result<AngleTable, String> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    if let Some(words) = header.metadata().as_ref().and_then(|m| m.get(METADATA))
        && !words.starts_with(VERSION)
    {
        return Err(format!("its metadata `{METADATA}` begin with {words:.20?}; this program reads \"{VERSION}\""));
    }
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let tensor =
        file.tensor(TENSOR).map_err(|_| format!("it has no tensor `{TENSOR}`, only: {}", file.names().join(", ")))?;
    let &[a, b, c, d, 3] = tensor.shape() else {
        return Err(format!("`{TENSOR}` has the shape {:?}, not [θi, φi, θo, φo, 3]", tensor.shape()));
    };
    let axis = |n: usize| u32::try_from(n).map_err(|_| format!("{n} samples along an axis of `{TENSOR}`"));
    let size = [axis(a)?, axis(b)?, axis(c)?, axis(d)?];
    AngleTable::count(size)?;
    let numbers: Vec<f32> = match tensor.dtype() {
        Dtype::F32 => tensor.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        Dtype::F64 => tensor.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
        other => return Err(format!("`{TENSOR}` is of the type {other:?}; F32 and F64 are read")),
    };
    AngleTable::new(size, numbers.as_chunks().0.to_vec()).map_err(|e| format!("`{TENSOR}`: {e}"))
}

/// Writes a table as safetensors; `material` says what it was captured from.
pub fn write_table(table: &AngleTable, material: &str) -> Vec<u8> {
    let shape: Vec<usize> = table.size().iter().map(|n| *n as usize).chain([3]).collect();
    let data: Vec<u8> = table.values().as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    // One entry: a map of more would be written in any order.
    let words = format!(
        "{VERSION} f_r[theta_i][phi_i][theta_o][phi_o][colour] in 1/sr, linear Rec. 709; i: light, o: viewer; \
         theta = k*90deg/n, phi = k*360deg/n{}; material={material}",
        if table.is_isotropic() { "; isotropic: phi_o counts from phi_i" } else { "" }
    );
    let metadata = HashMap::from([(METADATA.to_string(), words)]);
    let tensor = TensorView::new(Dtype::F32, shape, &data).expect("as many values as the shape says");
    serialize([(TENSOR, tensor)], Some(metadata)).expect("a header of plain text")
}
