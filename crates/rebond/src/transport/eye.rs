//! Connections of light's paths to the eye.

use super::sub_path::Source;
use super::{Connection, Vertex};
use crate::bsdf::TransportMode;
use crate::camera::Sight;
use crate::math::{Rgb, Vec3, offset_from_surface};
use crate::scene::Scene;
use rebond_bvh::Ray;
use rebond_lanes::{Mask, Real};

/// What the eye sees of paths of light, if nothing is in the way.
#[derive(Clone, Copy, Debug)]
pub struct Seen<F: Real> {
    /// Where and how.
    pub sight: Sight<F>,
    /// What it counts there.
    pub light: Rgb<F>,
    /// |cosθ| to the geometric normal of what is seen; 1 if it has none.
    pub cos: F,
    /// Density with which light would have gone there by itself.
    pub pdf: F,
    /// Density with which the eye would go on from there to the vertex before; 0 at a light.
    pub back: F,
    /// The ray that must be free.
    pub ray: Ray<F>,
    /// Lanes in which it counts.
    pub mask: F::Mask,
}

/// The lights themselves, where paths of them begin; `None` if they are points or beams, hidden from the eye, or bring nothing.
pub fn see_source<F: Real>(scene: &Scene, source: &Source<F>, lens: [F; 2], time: F, mask: F::Mask) -> Option<Seen<F>> {
    let (camera, emitters) = (scene.camera(), scene.emitters());
    let (emitter, emission) = (source.emitter, &source.emission);
    let mask = mask & emitters.is_hittable::<F>(emitter);
    if mask.none() || scene.hides_emitters() {
        return None;
    }
    let infinite = emitters.is_infinite::<F>(emitter);
    let near = camera.see(emission.o, lens, time);
    let cos = emission.normal.dot(near.w).relu();
    let value = emitters.radiance_at(emitter, emission.o, time, mask) * (cos / emission.pdf.position.0);
    let o = offset_from_surface(emission.o, emission.error, emission.normal, near.w);
    let ray = Ray { o: o.array(), d: (near.end - o).array(), tmax: F::one(), time };
    let mut seen = Seen { sight: near, light: value, cos, pdf: F::zero(), back: F::zero(), ray, mask };
    if infinite.any() {
        // Their direction was drawn, and counts Le / pdf(direction).
        let far = camera.see_far(-emission.d, lens, time);
        let value = emission.weight * emission.pdf.position.0;
        let ray = Ray { o: far.end.array(), d: (-far.w).array(), tmax: F::splat(f32::INFINITY), time };
        let far = Seen { sight: far, light: value, cos: F::one(), pdf: F::zero(), back: F::zero(), ray, mask };
        seen = Seen::select(infinite, far, seen);
    }
    seen.light = seen.light * (seen.sight.importance / source.probability);
    seen.mask = mask & seen.light.is_lit();
    // The direction towards the lens is another than the walk's.
    let pdf = emitters.emission_pdf(emitter, time, emission.normal, seen.sight.w, seen.mask);
    seen.pdf = F::select(infinite, pdf.position.0, pdf.direction.0);
    seen.mask.any().then_some(seen)
}

/// Vertices of light's paths; `None` if they scatter in single directions only, are hidden from the eye, or bring nothing.
pub fn see<F: Real>(scene: &Scene, vertex: &Vertex<'_, F>, lens: [F; 2], time: F) -> Option<Seen<F>> {
    let (surface, bsdf) = (&vertex.surface, &vertex.bsdf);
    let mut mask = vertex.mask.and_not(bsdf.is_specular());
    if scene.hides_emitters() {
        mask = mask.and_not(surface.is_emitter());
    }
    if mask.none() {
        return None;
    }
    let sight = scene.camera().see(surface.p, lens, time);
    let (value, back) = vertex.eval_both_ways(sight.w, TransportMode::Importance, mask);
    let light = vertex.throughput * value.f * (bsdf.normal().dot(sight.w).abs() * sight.importance);
    let o = surface.leave(sight.w);
    let ray = Ray { o: o.array(), d: (sight.end - o).array(), tmax: F::one(), time };
    let mask = mask & light.is_lit();
    mask.any().then(|| Seen { sight, light, cos: vertex.cos(sight.w), pdf: value.pdf.0, back, ray, mask })
}

impl<F: Real> Seen<F> {
    /// What arrives if the way is free.
    pub fn connection(&self, state: F::Index, strategy: Option<usize>, weight: F) -> Connection<F> {
        Connection { ray: self.ray, light: self.light, weight, state, strategy }
    }

    #[inline(always)]
    fn select(mask: F::Mask, a: Self, b: Self) -> Self {
        let pick = |a: Vec3<F>, b: Vec3<F>| Vec3::select(mask, a, b);
        let triple = |a: [F; 3], b: [F; 3]| [0, 1, 2].map(|i| F::select(mask, a[i], b[i]));
        let number = |a: F, b: F| F::select(mask, a, b);
        Self {
            sight: Sight {
                lens: pick(a.sight.lens, b.sight.lens),
                end: pick(a.sight.end, b.sight.end),
                w: pick(a.sight.w, b.sight.w),
                raster: [0, 1].map(|i| number(a.sight.raster[i], b.sight.raster[i])),
                importance: number(a.sight.importance, b.sight.importance),
                found: number(a.sight.found, b.sight.found),
            },
            light: Rgb::select(mask, a.light, b.light),
            cos: number(a.cos, b.cos),
            pdf: number(a.pdf, b.pdf),
            back: number(a.back, b.back),
            ray: Ray {
                o: triple(a.ray.o, b.ray.o),
                d: triple(a.ray.d, b.ray.d),
                tmax: number(a.ray.tmax, b.ray.tmax),
                time: a.ray.time,
            },
            mask: (mask & a.mask) | b.mask.and_not(mask),
        }
    }
}
