//! A solution: what the patches of a scene send out. It lives on the surfaces, so any camera may look at it, and with
//! the inverse in it any light may change.

use super::patches::Patches;
use super::solvers::inverse::Inverse;
use super::solvers::{Channels, Problem};
use crate::scene::{Face, Scene};
use glam::DVec3;

/// Patches share the light of a corner if the angle between their normals is at most this many degrees.
const CREASE: f64 = 30.0;

/// What the patches of a scene send out.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Tells whether it is of a scene: a hash of its faces.
    pub key: u64,
    /// The patches.
    pub mesh: Patches,
    /// Radiance that each patch emits.
    pub emission: Vec<[f32; 3]>,
    /// Radiance that it reflects of lights that are no patches.
    pub external: Vec<[f32; 3]>,
    /// ρ, its mean over each patch; less where its row of F sums to more than 1.
    pub reflectance: Vec<[f32; 3]>,
    /// Radiance that each patch sends out, all together.
    pub radiance: Vec<[f32; 3]>,
    /// The inverse, if it was solved by that.
    pub inverse: Option<Inverse>,
    /// Whether it shines otherwise than its scene.
    pub relit: bool,
}

/// A hash of what a scene's faces are: where, of which shape, what they emit and reflect.
pub fn key(scene: &Scene, faces: &[Face]) -> u64 {
    // FNV-1a.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |word: u64| {
        for byte in word.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for f in faces {
        f.corners.iter().for_each(|p| p.to_array().iter().for_each(|x| add((*x as f32).to_bits().into())));
        add(u64::from(f.shape) << 1 | u64::from(f.behind));
        let reflectance = scene.diffuse_part(f.material, [0.5; 2], f.behind).reflectance;
        f.emission.iter().chain(&reflectance).for_each(|x| add(x.to_bits().into()));
    }
    hash
}

/// Colours of patches as one number for each colour of each.
pub(super) fn channels(colors: &[[f32; 3]]) -> Channels {
    std::array::from_fn(|c| colors.iter().map(|x| x[c]).collect())
}

/// … and back.
pub(super) fn colors(channels: &Channels) -> Vec<[f32; 3]> {
    (0..channels[0].len()).map(|i| [0, 1, 2].map(|c| channels[c][i])).collect()
}

impl Solution {
    /// The equation that it solves.
    pub fn problem(&self) -> Problem {
        let sum = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| a[c] + b[c]);
        let source: Vec<[f32; 3]> = self.emission.iter().zip(&self.external).map(sum).collect();
        let areas = self.mesh.leaves.iter().map(|e| self.mesh.area(*e)).collect();
        Problem { areas, source: channels(&source), reflectance: channels(&self.reflectance) }
    }

    /// Lets shapes emit other radiances, and solves again by the inverse. Without one nothing changes, and it says so.
    pub fn relight(&mut self, lights: &[(u32, [f32; 3])]) -> bool {
        let Some(inverse) = &self.inverse else { return false };
        let mut problem = self.problem();
        for (shape, radiance) in lights {
            for (patch, e) in self.mesh.leaves.iter().enumerate() {
                let [_, _, behind, of] = self.mesh.faces[self.mesh.elements[*e as usize].face as usize];
                if of == *shape && behind == 0 {
                    self.emission[patch] = *radiance;
                    (0..3).for_each(|c| problem.source[c][patch] = radiance[c] + self.external[patch][c]);
                }
            }
        }
        self.radiance = colors(&inverse.solve(&problem));
        self.relit = true;
        true
    }

    /// The mean irradiance of each patch over π: what it reflects, over ρ; 0 where it is black.
    pub fn irradiance(&self) -> Vec<[f32; 3]> {
        let of = |i: usize| {
            let (all, own, r) = (self.radiance[i], self.emission[i], self.reflectance[i]);
            [0, 1, 2].map(|c| if r[c] > 1e-6 { (all[c] - own[c]).max(0.0) / r[c] } else { 0.0 })
        };
        (0..self.mesh.len()).map(of).collect()
    }

    /// Irradiance over π at the corners of each patch: the mean over the patches around the corner, by their angles in it, as far
    /// as they belong to one smooth surface. Flat: the patch's own.
    pub fn at_corners(&self, smooth: bool) -> Vec<[[f32; 3]; 3]> {
        let irradiance = self.irradiance();
        if !smooth {
            return irradiance.into_iter().map(|e| [e; 3]).collect();
        }
        let mesh = &self.mesh;
        let groups = self.smoothing_groups();
        let mut sums = vec![[[0.0_f64; 2]; 3]; groups.count];
        for (patch, of) in groups.of.iter().enumerate() {
            let corners = mesh.corners(mesh.leaves[patch]);
            for k in 0..3 {
                let (a, b) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
                let angle = a.angle_between(b);
                for c in 0..3 {
                    // What reaches black patches is not known.
                    if self.reflectance[patch][c] > 1e-6 {
                        sums[of[k] as usize][c][0] += angle * f64::from(irradiance[patch][c]);
                        sums[of[k] as usize][c][1] += angle;
                    }
                }
            }
        }
        let mean =
            |g: u32| sums[g as usize].map(|[sum, weight]| if weight > 0.0 { (sum / weight) as f32 } else { 0.0 });
        groups.of.iter().map(|of| of.map(mean)).collect()
    }

    /// For each corner of each patch, the number of the group of patches that share its light.
    pub fn smoothing_groups(&self) -> Groups {
        let mesh = &self.mesh;
        let mut around: Vec<Vec<(u32, u8)>> = vec![Vec::new(); mesh.vertices.len()];
        for patch in 0..mesh.len() {
            for (k, v) in mesh.triangle(patch).into_iter().enumerate() {
                around[v as usize].push((patch as u32, k as u8));
            }
        }
        let normals: Vec<DVec3> = mesh.leaves.iter().map(|e| mesh.normal(*e)).collect();
        let limit = CREASE.to_radians().cos();
        let mut groups = Groups { of: vec![[u32::MAX; 3]; mesh.len()], count: 0, vertices: Vec::new() };
        for (vertex, all) in around.iter().enumerate() {
            for (patch, k) in all {
                if groups.of[*patch as usize][usize::from(*k)] != u32::MAX {
                    continue;
                }
                // All that hang together with this one over small angles.
                let mut reached = vec![(*patch, *k)];
                let mut next = 0;
                groups.of[*patch as usize][usize::from(*k)] = groups.count as u32;
                while let Some((from, _)) = reached.get(next).copied() {
                    next += 1;
                    for (to, k) in all {
                        let group = &mut groups.of[*to as usize][usize::from(*k)];
                        if *group == u32::MAX && normals[from as usize].dot(normals[*to as usize]) >= limit {
                            *group = groups.count as u32;
                            reached.push((*to, *k));
                        }
                    }
                }
                groups.vertices.push(vertex as u32);
                groups.count += 1;
            }
        }
        groups
    }

    /// A solution from its parts, as a file holds them, for the scene that it is of; or what is wrong with them.
    pub fn restore(scene: &Scene, parts: Parts) -> Result<Self, String> {
        let faces = scene.faces();
        if key(scene, &faces) != parts.key {
            return Err("it is of another scene, or of another state of this one".into());
        }
        let mesh =
            Patches::from_cuts(scene, &faces, &parts.cuts).ok_or("its cuts are none of this scene's surfaces")?;
        let n = mesh.len();
        for (name, values) in [
            ("emission", &parts.emission),
            ("external", &parts.external),
            ("reflectance", &parts.reflectance),
            ("radiance", &parts.radiance),
        ] {
            if values.len() != n {
                return Err(format!("`{name}` has {} rows for {n} patches", values.len()));
            }
            if values.as_flattened().iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
                return Err(format!("`{name}` has values that are negative or not finite"));
            }
        }
        let inverse = match parts.inverse {
            None => None,
            Some(lower) => {
                let rows = Inverse::from_lower(n, lower.each_ref().map(Vec::as_slice));
                Some(rows.ok_or_else(|| format!("`inverse` is not made of three triangles of {n} rows"))?)
            }
        };
        let Parts { key, emission, external, reflectance, radiance, relit, .. } = parts;
        Ok(Self { key, mesh, emission, external, reflectance, radiance, inverse, relit })
    }
}

/// What a file holds of a solution. The mesh is that of the scene, cut again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// As in [`Solution`].
    pub key: u64,
    /// Child and edge of each element.
    pub cuts: Vec<[u32; 2]>,
    /// As in [`Solution`].
    pub emission: Vec<[f32; 3]>,
    /// As in [`Solution`].
    pub external: Vec<[f32; 3]>,
    /// As in [`Solution`].
    pub reflectance: Vec<[f32; 3]>,
    /// As in [`Solution`].
    pub radiance: Vec<[f32; 3]>,
    /// The lower triangle of each colour's X, as [`Inverse::lower`] gives it.
    pub inverse: Option<[Vec<f32>; 3]>,
    /// As in [`Solution`].
    pub relit: bool,
}

/// Corners of patches that share their light.
#[derive(Clone, Debug)]
pub struct Groups {
    /// Group of each corner of each patch.
    pub of: Vec<[u32; 3]>,
    /// How many there are.
    pub count: usize,
    /// Vertex of each group.
    pub vertices: Vec<u32>,
}
