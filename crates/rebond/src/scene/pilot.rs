//! What paths from the camera meet: how much room that takes, and which part of a sphere that shines.
//!
//! A lamp may be sunk into a ceiling or stand in a shade; points drawn from all of it then are mostly in the dark. Before
//! anything is rendered some paths of directions drawn from BSDFs are followed from the camera. If most of what they meet of a sphere
//! lies within a small cap around the mean of the normals there, [`Emitters::set_cap`](crate::emitter::Emitters::set_cap) draws from
//! that cap mostly. From the rest of the sphere it draws too, so that what these paths missed is found.

use super::{Scene, Surface, is_hit};
use crate::bsdf::TransportMode;
use crate::math::Vec3;
use crate::sampling::{Sampler, SamplerSettings};
use rebond_bvh::Ray;
use rebond_lanes::scalar::Index1;
use std::collections::BTreeMap;

/// Paths that are followed.
const PATHS: u32 = 4096;
/// Their longest, in segments.
const LONGEST: u32 = 6;
/// The share of what was met that the box around the rest leaves out, at either end of each axis.
const STRAY: f32 = 0.01;
/// Fewest hits of a sphere that say something about it.
const FEWEST: usize = 64;
/// Caps hold this share of what was met, and are wider by this factor. A few paths may go astray behind the scenes.
const SHARE: f32 = 0.9;
const MARGIN: f32 = 1.15;
/// The widest cap, as 1 − cosine of its half-angle: an eighth of the sphere.
const WIDEST: f32 = 0.25;

/// Follows paths of the BSDFs' directions from the camera; `each` is told of the surfaces that they meet, and after how many segments.
fn follow(scene: &Scene, mut each: impl FnMut(u32, &Surface<f32>)) {
    let sampler = Sampler::new(SamplerSettings::Independent {}, 0);
    for path in 0..PATHS {
        let stream = sampler.stream::<f32>(Index1(path), Index1(0));
        let pair = |n: u32| stream.pair(Index1(n));
        let [u, v] = pair(0);
        let [width, height] = scene.camera.size();
        let start = scene.camera.ray([u * width, v * height], pair(1), stream.value(Index1(2)));
        let ray =
            |o: Vec3<f32>, d: Vec3<f32>| Ray { o: o.array(), d: d.array(), tmax: f32::INFINITY, time: start.time };
        let mut next = ray(start.o, start.d);
        for segment in 1..=LONGEST {
            let hit = scene.intersect(&next, true, false);
            if !is_hit(&hit) {
                break;
            }
            let surface = scene.surface(&next, &hit, true);
            each(segment, &surface);
            let u = |n: u32| Index1(3 * segment + n);
            let bsdf = scene.bsdf(&surface, || stream.value(u(0)), true);
            let way = bsdf.sample(surface.wo, stream.pair(u(1)), || stream.value(u(2)), TransportMode::Radiance, true);
            if !way.weight.is_lit() {
                break;
            }
            next = ray(surface.leave(way.w), way.w);
        }
    }
}

/// Caps of spheres that shine: emitter, axis and 1 − cosine of the half-angle.
pub(super) fn caps(scene: &Scene) -> Vec<(u32, Vec3<f32>, f32)> {
    let mut met: BTreeMap<u32, Vec<Vec3<f32>>> = BTreeMap::new();
    if !scene.emitters.has_spheres() {
        return Vec::new();
    }
    follow(scene, |segment, surface| {
        // What the camera sees itself needs no points on lights.
        if segment > 1 && surface.front() && scene.emitters.is_sphere(surface.emitter.0) {
            met.entry(surface.emitter.0).or_default().push(surface.ng);
        }
    });
    met.into_iter().filter_map(|(emitter, normals)| cap(&normals).map(|(axis, width)| (emitter, axis, width))).collect()
}

/// Diagonal of the box around what was met, but for what lies farthest out along each axis; 0 if nothing was met.
pub(super) fn extent(scene: &Scene) -> f32 {
    let mut places = [const { Vec::new() }; 3];
    follow(scene, |_, surface| places.iter_mut().zip(surface.p.array()).for_each(|(axis, x)| axis.push(x)));
    let sides = places.map(|mut axis| {
        axis.sort_by(f32::total_cmp);
        let beyond = (STRAY * axis.len() as f32) as usize;
        if axis.is_empty() { 0.0 } else { axis[axis.len() - 1 - beyond] - axis[beyond] }
    });
    sides[0].hypot(sides[1]).hypot(sides[2])
}

/// A small cap that holds these normals, if there is one.
fn cap(normals: &[Vec3<f32>]) -> Option<(Vec3<f32>, f32)> {
    let sum = normals.iter().fold(Vec3::zero(), |sum, n| sum + *n);
    if normals.len() < FEWEST || sum.length() < 0.5 * normals.len() as f32 {
        return None;
    }
    let axis = sum.normalized();
    // |n − a|² = 2 (1 − cos), without cancellation.
    let mut distances: Vec<f32> = normals.iter().map(|n| (*n - axis).length()).collect();
    distances.sort_by(f32::total_cmp);
    let far = distances[(SHARE * (normals.len() - 1) as f32) as usize] * MARGIN;
    let width = (0.5 * far * far).max(1e-6);
    (width <= WIDEST).then_some((axis, width))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::vec3;
    use crate::sampling::warp::uniform_cone;
    use crate::testing::random_pairs;

    #[test]
    fn caps_hold_what_was_met() {
        let mut near_z: Vec<Vec3<f32>> = random_pairs(1000).map(|u| uniform_cone(u, 1e-3)).collect();
        let few = near_z[..10].to_vec();
        // Some that are far off do not count.
        near_z.extend(random_pairs(50).map(|u| uniform_cone(u, 0.2)));
        let (axis, width) = cap(&near_z).expect("a cap");
        assert!((axis - vec3(0.0, 0.0, 1.0)).length() < 0.02 && (1e-3..2e-3).contains(&width), "{width}");
        let hemisphere: Vec<Vec3<f32>> = random_pairs(1000).map(|u| uniform_cone(u, 1.0)).collect();
        assert!(cap(&hemisphere).is_none() && cap(&few).is_none() && cap(&[]).is_none());
    }
}
