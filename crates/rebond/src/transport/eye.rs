//! Connections of light's paths to the eye.

use super::Vertex;
use crate::bsdf::{BsdfValue, TransportMode};
use crate::camera::Sight;
use crate::emitter::Emission;
use crate::math::Rgb;
use crate::scene::{Scene, Surface};
use rebond_bvh::Ray;

/// What the eye sees of a path of light, if nothing is in the way.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Where and how.
    pub sight: Sight<f32>,
    /// What it counts there.
    pub light: Rgb<f32>,
    /// |cosθ| to the geometric normal of what is seen; 1 if it has none.
    pub cos: f32,
    /// The ray that must be free.
    pub ray: Ray<f32>,
}

/// The light itself, where a path of it begins; `None` if it is a point or a beam, or brings nothing.
pub fn see_source(
    scene: &Scene,
    emitter: u32,
    probability: f32,
    emission: &Emission,
    lens: [f32; 2],
    time: f32,
) -> Option<Seen> {
    let (camera, emitters) = (scene.camera(), scene.emitters());
    if !emitters.is_hittable(emitter) {
        return None;
    }
    let infinite = emitters.is_infinite(emitter);
    let (sight, value, cos) = if infinite {
        // Its direction was drawn, and counts Le / pdf(direction).
        (camera.see_far(-emission.d, lens, time), emission.weight * emission.pdf.position.0, 1.0)
    } else {
        let sight = camera.see(emission.o, lens, time);
        let cos = emission.normal.dot(sight.w).max(0.0);
        (sight, scene.emitters().radiance(rebond_lanes::scalar::Index1(emitter)) * (cos / emission.pdf.position.0), cos)
    };
    let light = value * (sight.importance / probability);
    let ray = if infinite {
        Ray { o: sight.lens.array(), d: (-sight.w).array(), tmax: f32::INFINITY, time }
    } else {
        let o = crate::math::offset_from_surface(emission.o, emission.error, emission.normal, sight.w);
        Ray { o: o.array(), d: (sight.lens - o).array(), tmax: 1.0, time }
    };
    light.is_lit().then_some(Seen { sight, light, cos, ray })
}

/// A vertex of light's path; `None` if it scatters in single directions only, or brings nothing. With its BSDF's value, and the
/// number of the event.
pub fn see(scene: &Scene, vertex: &Vertex<'_>, lens: [f32; 2], time: f32) -> Option<(Seen, BsdfValue<f32>, u32)> {
    let Vertex { surface, bsdf, .. } = vertex;
    if bsdf.is_specular() {
        return None;
    }
    let sight = scene.camera().see(surface.p, lens, time);
    let value = bsdf.eval(surface.wo, sight.w, TransportMode::Importance, true);
    let light = vertex.throughput * value.f * (bsdf.normal().dot(sight.w).abs() * sight.importance);
    let seen = Seen { sight, light, cos: vertex.cos(sight.w), ray: between(surface, sight.lens, time) };
    light.is_lit().then(|| (seen, value, bsdf.event(surface.wo, sight.w).0))
}

/// The ray from a surface to a point.
fn between(surface: &Surface<f32>, to: crate::math::Vec3<f32>, time: f32) -> Ray<f32> {
    let o = surface.leave((to - surface.p).normalized());
    Ray { o: o.array(), d: (to - o).array(), tmax: 1.0, time }
}
