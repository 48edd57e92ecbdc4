//! Surfaces: indexed triangle meshes. (Spheres, disks and rectangles are exact and live in the scene's tables.)

use glam::Vec3;
use std::collections::BTreeMap;

/// Triangles over shared vertices. Lists are as long as the positions and indices valid where a reader made it; positions
/// may still be NaN or infinite, and triangles degenerate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Corners.
    pub positions: Vec<[f32; 3]>,
    /// A shading normal for each position, of any length.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Texture coordinates for each position.
    pub uvs: Option<Vec<[f32; 2]>>,
    /// Three places in `positions` each, counter-clockwise seen from the side of the normal.
    pub triangles: Vec<[u32; 3]>,
    /// What else it knows of its vertices and triangles, by names that start with `vertex_` and `face_`: a value for each; what
    /// is one number is there three times.
    pub attributes: BTreeMap<String, Vec<[f32; 3]>>,
}

impl MeshData {
    /// The square from (−1, −1, 0) to (1, 1, 0).
    pub fn rectangle() -> Self {
        Self {
            positions: vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            normals: None,
            uvs: Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Self::default()
        }
    }

    /// The cube from (−1, −1, −1) to (1, 1, 1), each face with UVs of its own.
    pub fn cube() -> Self {
        let mut mesh = Self { uvs: Some(Vec::new()), ..Self::default() };
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let first = mesh.positions.len() as u32;
                for [a, b] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                    let mut p = [side; 3];
                    // Mirroring one axis on the negative side keeps every face counter-clockwise.
                    (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (a * side, b);
                    mesh.positions.push(p);
                    mesh.uvs.get_or_insert_default().push([(a + 1.0) / 2.0, (b + 1.0) / 2.0]);
                }
                mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
        mesh
    }

    /// At each vertex the sum of the unit normals of its faces, weighed by their angles there, which does not hang on how a
    /// polygon is cut into triangles (Thürmer and Wüthrich 1998). Triangles must name vertices that there are.
    pub fn smooth_normals(&self) -> Vec<[f32; 3]> {
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for t in &self.triangles {
            let p = t.map(|i| Vec3::from(self.positions[i as usize]));
            let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            for k in 0..3 {
                let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                let angle = a.normalize_or_zero().angle_between(b.normalize_or_zero());
                if angle.is_finite() {
                    sums[t[k] as usize] += normal * angle;
                }
            }
        }
        sums.iter().map(|n| n.normalize_or_zero().to_array()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_point_outwards() {
        for mesh in [MeshData::cube(), MeshData::rectangle()] {
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|i| Vec3::from(mesh.positions[i as usize]));
                let (n, centre) = ((b - a).cross(c - a), (a + b + c) / 3.0);
                assert!(n.dot(if mesh.triangles.len() == 2 { Vec3::Z } else { centre }) > 0.5);
            }
        }
    }

    #[test]
    fn smooth_normals_do_not_hang_on_diagonals() {
        // The corner of a cube whose faces are cut this way and that: its normal is the diagonal.
        let positions = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 1.0],
            [1.0, 0.0, 1.0],
        ];
        let triangles = vec![[0, 1, 4], [0, 4, 2], [0, 2, 3], [2, 5, 3], [0, 3, 1], [3, 6, 1]];
        let mesh = MeshData { positions, triangles, ..MeshData::default() };
        let n = Vec3::from(mesh.smooth_normals()[0]);
        assert!((n - Vec3::splat(3.0_f32.sqrt().recip())).length() < 1e-6, "{n}");
        assert_eq!(mesh.smooth_normals()[6], [0.0, 1.0, 0.0]);
    }
}
