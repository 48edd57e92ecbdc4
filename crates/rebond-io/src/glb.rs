//! A solution of radiosity as binary glTF 2.0 (Khronos 2021): a mesh whose colours are its light, for Blender, three.js
//! and the like.
//!
//! The attribute `COLOR_0` is radiance, linear Rec. 709, cut off at 1; `_RADIANCE` is all of it. The material is unlit
//! (`KHR_materials_unlit`), since all light is in the colours. Faces are seen from their front.

use rebond::integrators::radiosity::Solution;
use serde_json::json;
use std::collections::HashMap;

const FLOAT: u32 = 5126;
const UNSIGNED: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes the patches with their light, multiplied by `factor`, at their corners; smoothed between them, or flat.
pub fn write_glb(solution: &Solution, smooth: bool, factor: f32) -> Vec<u8> {
    let mesh = &solution.mesh;
    let (corners, groups) = (solution.at_corners(smooth), solution.smoothing_groups());
    let (mut positions, mut normals, mut radiance) = (Vec::new(), Vec::new(), Vec::new());
    let mut known: HashMap<(u32, [u32; 6]), u32> = HashMap::new();
    let mut indices: Vec<u32> = Vec::with_capacity(3 * mesh.len());
    for (patch, light) in corners.iter().enumerate() {
        let normal = mesh.normal(mesh.leaves[patch]).as_vec3().to_array();
        let (emitted, rho) = (solution.emission[patch], solution.reflectance[patch]);
        for (k, vertex) in mesh.triangle(patch).into_iter().enumerate() {
            let color = [0, 1, 2].map(|c| factor * (emitted[c] + rho[c] * light[k][c]));
            let mut add = || {
                positions.push(mesh.vertices[vertex as usize].as_vec3().to_array());
                normals.push(normal);
                radiance.push(color);
                positions.len() as u32 - 1
            };
            // Patches around a corner share it where they are of one colour.
            let look = [rho, emitted].as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
            let look: [u32; 6] = look.try_into().unwrap_or_default();
            indices.push(if smooth { *known.entry((groups.of[patch][k], look)).or_insert_with(add) } else { add() });
        }
    }
    let count = positions.len();
    let bound =
        |f: fn(f32, f32) -> f32, start: f32| positions.iter().fold([start; 3], |m, p| [0, 1, 2].map(|x| f(m[x], p[x])));
    let (lo, hi) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
    let colors: Vec<[f32; 3]> = radiance.iter().map(|c| c.map(|x| x.clamp(0.0, 1.0))).collect();
    let mut buffer = Vec::with_capacity(48 * count + 4 * indices.len());
    let mut views = Vec::new();
    for column in [&positions, &normals, &colors, &radiance] {
        views
            .push(json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": 12 * count, "target": ARRAY_BUFFER }));
        buffer.extend(column.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    }
    let start = buffer.len();
    views.push(
        json!({ "buffer": 0, "byteOffset": start, "byteLength": 4 * indices.len(), "target": ELEMENT_ARRAY_BUFFER }),
    );
    buffer.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    let vectors = |view: u32| json!({ "bufferView": view, "componentType": FLOAT, "count": count, "type": "VEC3" });
    let mut position = vectors(0);
    (position["min"], position["max"]) = (json!(lo), json!(hi));
    let index = json!({ "bufferView": 4, "componentType": UNSIGNED, "count": indices.len(), "type": "SCALAR" });
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "COLOR_0": 2, "_RADIANCE": 3 });
    let scene = json!({
        "asset": { "version": "2.0", "generator": "rebond" },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "radiosity" }],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": 4, "material": 0 }] }],
        "materials": [{
            "name": "light in the colours of the vertices",
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
            "extensions": { "KHR_materials_unlit": {} },
        }],
        "accessors": [position, vectors(1), vectors(2), vectors(3), index],
        "bufferViews": views,
        "buffers": [{ "byteLength": buffer.len() }],
    });
    assemble(scene.to_string().into_bytes(), buffer)
}

/// Header, and two chunks, each padded to four bytes.
fn assemble(mut json: Vec<u8>, mut buffer: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let mut out = Vec::with_capacity(28 + json.len() + buffer.len());
    let length = 28 + json.len() + buffer.len();
    out.extend(*b"glTF");
    [2, length as u32, json.len() as u32].iter().for_each(|n| out.extend(n.to_le_bytes()));
    out.extend(*b"JSON");
    out.extend(json);
    out.extend((buffer.len() as u32).to_le_bytes());
    out.extend(*b"BIN\0");
    out.extend(buffer);
    out
}
