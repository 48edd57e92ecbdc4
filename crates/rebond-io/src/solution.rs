//! Solutions of radiosity in safetensors files. For N patches:
//!
//! | tensor | shape | |
//! |---|---|---|
//! | `vertices` | V, 3 | f64, metres |
//! | `triangles` | N, 3 | u32, places in `vertices` |
//! | `radiance`, `emission`, `external`, `reflectance` | N, 3 | f32: all that a patch sends out; what it emits; what it reflects of lights that are no patches; ρ |
//! | `inverse` | 3, N(N+1)/2 | f32, if there is one: X of each colour (`solvers::inverse`), row after row up to the diagonal |
//! | `cuts` | M, 2 | u32: first half of each triangle of the mesh, or 2³²−1, and the edge that is cut |
//!
//! The metadata `rebond` begins with `version=1;` and names the scene by a hash of its faces. Vertices and triangles are for other
//! readers: rebond cuts the scene again, as `cuts` says.

use crate::error::Error;
use rebond::integrators::radiosity::{Parts, Solution};
use rebond::scene::Scene;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;

const METADATA: &str = "rebond";
const VERSION: &str = "version=1; radiosity; ";

fn floats<'a>(values: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    values.into_iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn words<'a>(values: impl IntoIterator<Item = &'a u32>) -> Vec<u8> {
    values.into_iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Writes a solution as safetensors; `scene` is what it is called.
pub fn write_solution(solution: &Solution, scene: &str) -> Vec<u8> {
    let mesh = &solution.mesh;
    let n = mesh.len();
    let triangles: Vec<[u32; 3]> = (0..n).map(|p| mesh.triangle(p)).collect();
    let vertices: Vec<u8> = mesh.vertices.iter().flat_map(|v| v.to_array()).flat_map(|x| x.to_le_bytes()).collect();
    let cuts = mesh.cuts();
    let mut tensors = vec![
        ("vertices", Dtype::F64, vec![mesh.vertices.len(), 3], vertices),
        ("triangles", Dtype::U32, vec![n, 3], words(triangles.as_flattened())),
        ("cuts", Dtype::U32, vec![cuts.len(), 2], words(cuts.as_flattened())),
    ];
    for (name, values) in [
        ("radiance", &solution.radiance),
        ("emission", &solution.emission),
        ("external", &solution.external),
        ("reflectance", &solution.reflectance),
    ] {
        tensors.push((name, Dtype::F32, vec![n, 3], floats(values.as_flattened())));
    }
    if let Some(inverse) = &solution.inverse {
        let mut bytes = Vec::with_capacity(6 * n * (n + 1));
        for c in 0..3 {
            inverse.lower(c).for_each(|row| bytes.extend(row.iter().flat_map(|x| x.to_le_bytes())));
        }
        tensors.push(("inverse", Dtype::F32, vec![3, n * (n + 1) / 2], bytes));
    }
    let says = format!("{VERSION}key={:016x}; relit={}; scene={scene}", solution.key, u8::from(solution.relit));
    let views = tensors.iter().map(|(name, dtype, shape, data)| {
        (*name, TensorView::new(*dtype, shape.clone(), data).expect("as many values as the shape says"))
    });
    let metadata = HashMap::from([(METADATA.to_string(), says)]);
    serialize(views, Some(metadata)).expect("a header of plain text")
}

/// Reads a solution of this scene; `name` is what errors call the file.
pub fn read_solution(bytes: &[u8], name: &str, scene: &Scene) -> Result<Solution, Error> {
    parts(bytes).and_then(|parts| Solution::restore(scene, parts)).map_err(|problem| {
        let error = Error::new(format!("not a usable solution of radiosity: {problem}")).with_file(name);
        error.with_help("`rebond radiosity SCENE -o FILE` writes them")
    })
}

fn parts(bytes: &[u8]) -> Result<Parts, String> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let says = header.metadata().as_ref().and_then(|m| m.get(METADATA)).ok_or("it has no metadata `rebond`")?;
    let says = says
        .strip_prefix(VERSION)
        .ok_or_else(|| format!("its metadata `{METADATA}` begin with {says:.20?}; this program reads \"{VERSION}\""))?;
    let field = |name: &str| says.split("; ").find_map(|f| f.strip_prefix(name)?.strip_prefix('='));
    let key = field("key").and_then(|k| u64::from_str_radix(k, 16).ok()).ok_or("its metadata have no `key`")?;
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let tensor = |name: &str, dtype: Dtype, last: Option<usize>| {
        let t =
            file.tensor(name).map_err(|_| format!("it has no tensor `{name}`, only: {}", file.names().join(", ")))?;
        let fits = t.dtype() == dtype && t.shape().len() == 2 && last.is_none_or(|l| t.shape()[1] == l);
        if fits { Ok(t) } else { Err(format!("`{name}` is {:?} of the shape {:?}", t.dtype(), t.shape())) }
    };
    let read = |data: &[u8]| -> Vec<f32> { data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect() };
    let colors = |name: &str| tensor(name, Dtype::F32, Some(3)).map(|t| read(t.data()).as_chunks().0.to_vec());
    let cuts: Vec<u32> =
        tensor("cuts", Dtype::U32, Some(2))?.data().as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    let inverse = match file.names().contains(&"inverse") {
        false => None,
        true => {
            let t = tensor("inverse", Dtype::F32, None)?;
            let all = read(t.data());
            let row = t.shape()[1];
            if t.shape()[0] != 3 {
                return Err(format!("`inverse` has the shape {:?}, not 3 rows", t.shape()));
            }
            if all.iter().any(|x| !x.is_finite()) {
                return Err("`inverse` has values that are not finite".into());
            }
            Some([0, 1, 2].map(|c| all[c * row..(c + 1) * row].to_vec()))
        }
    };
    Ok(Parts {
        key,
        cuts: cuts.as_chunks().0.to_vec(),
        emission: colors("emission")?,
        external: colors("external")?,
        reflectance: colors("reflectance")?,
        radiance: colors("radiance")?,
        inverse,
        relit: field("relit") == Some("1"),
    })
}
