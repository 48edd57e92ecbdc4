//! The ways to find a path: walks from both ends, connected, each path weighed by all ways to find it.
//!
//! A walk from the eye, z_0 z_1 …, and one from a light, y_0 y_1 …: s vertices of the light's and t of the eye's make a path of
//! s + t vertices, which counts
//!
//! ```text
//! w_{s,t} C_{s,t}        C_{s,t} = α_y f_r(y) |cosθ_y| V/d² |cosθ_z| f_r(z) α_z
//! ```
//!
//! | s, t | the path is found |
//! |---|---|
//! | s = 0 | by the eye's walk, which hits the light |
//! | s = 1 | by a point of a light, drawn for the end of the eye's walk: y_0 itself is not used |
//! | s ≥ 2, t ≥ 2 | by connecting two walks |
//! | t = 1 | by connecting the light's walk to a point of the lens: light for whichever pixel sees it |
//! | t = 0 | by the light's walk, which crosses the lens (if it is none of a pinhole) |
//!
//! `sub_path.rs` has the sums that weights are made of. For each sample of a pixel there is one walk from the light, so that ways
//! with t ≤ 1 have as many samples as the region has pixels; their densities count that often.

use super::{Connection, Heuristic, Sheets, Source, SubPath, Vertex, see, see_source};
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::math::Vec3;
use crate::render::{Dimensions, PathClasses, ShadowRay};
use crate::scene::Scene;
use rebond_bvh::{Ray, Trace};
use rebond_lanes::{Index, Mask, Real};
use std::iter::once_with;

/// Dimensions of the sample values that a bounce of the eye's walk uses for its light.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;

/// What finds paths, and where their light goes.
pub struct Ways<'a, F: Real> {
    /// What they lead through.
    pub scene: &'a Scene,
    /// How ways are weighed.
    pub heuristic: Heuristic,
    /// Whether each path has one way only, which counts in full.
    pub alone: bool,
    /// Longest path in segments.
    pub max_depth: u32,
    /// Light's walks for each of the eye's.
    pub light_paths: f32,
    /// Whether each (s, t) has layers of its own.
    pub strategies: bool,
    /// Where light goes.
    pub sheets: Sheets<'a, F>,
}

/// The place of a pair (s, t) among those of paths of at most so many segments, by length and s.
fn strategy(s: u32, t: u32) -> usize {
    let vertices = s + t;
    // 3 + 4 + … + vertices pairs of shorter paths.
    (vertices * (vertices + 1) / 2 - 3 + s) as usize
}

impl<'a, F: Trace> Ways<'a, F> {
    /// The layers of a pair.
    fn strategy(&self, s: u32, t: u32) -> Option<usize> {
        self.strategies.then(|| strategy(s, t))
    }

    /// The weight of a way, as [`Heuristic::weight`] has it, if there are others.
    #[inline(always)]
    pub fn weight(&self, others: [F; 2]) -> F {
        if self.alone { F::one() } else { self.heuristic.weight(others) }
    }

    /// s = 1, t = 1.
    pub fn connect_source(&mut self, source: &Source<F>, [lens, pixel]: [[F; 2]; 2], time: F, mask: F::Mask) {
        let Some(seen) = see_source(self.scene, source, lens, time, mask) else { return };
        let infinite = self.scene.emitters().is_infinite::<F>(source.emitter);
        let drawn = &source.emission.pdf;
        let here = F::select(infinite, drawn.direction.0, drawn.position.0) * source.probability;
        let by_eye = seen.sight.importance * seen.cos / (here * self.light_paths);
        let weight = self.weight([by_eye, seen.pdf * seen.sight.found]);
        let connection = seen.connection(PathClasses::start::<F>(), self.strategy(1, 1), weight);
        self.sheets.connect_to_lens(&connection, (seen.sight.raster, pixel), seen.mask);
    }

    /// t = 1, for the vertex of a light's walk that comes after these.
    pub fn connect_to_lens(
        &mut self,
        before: &[Vertex<'a, F>],
        vertex: &Vertex<'a, F>,
        [lens, pixel]: [[F; 2]; 2],
        time: F,
    ) {
        let Some(seen) = see(self.scene, vertex, lens, time) else { return };
        let (h, sight) = (self.heuristic, seen.sight);
        let last = || vertex.bsdf.event(vertex.surface.wo, sight.w);
        let events = once_with(last).chain(events_before(before));
        let state = self.sheets.state(PathClasses::start::<F>(), events);
        let by_eye = vertex.others(h, sight.importance * seen.cos / F::splat(self.light_paths), seen.back);
        let weight = self.weight([by_eye, seen.pdf * sight.found]);
        let connection = seen.connection(state, self.strategy(before.len() as u32 + 2, 1), weight);
        self.sheets.connect_to_lens(&connection, (sight.raster, pixel), seen.mask);
    }

    /// t = 0: light whose walk has these vertices crosses the lens before it meets anything at distance `end`. Where it is the only
    /// way, only light does that no connection finds.
    pub fn cross_lens(
        &mut self,
        before: &[Vertex<'a, F>],
        path: &SubPath<'a, F>,
        end: F,
        pixel: [F; 2],
        alive: F::Mask,
    ) {
        let (camera, h, time) = (self.scene.camera(), self.heuristic, path.ray.time);
        let crossing = camera.crossing(path.origin(), path.direction(), time);
        let mut mask = (alive & crossing.mask).and_not(path.hidden);
        if self.alone {
            mask = mask & path.specular;
        }
        mask = mask & crossing.free.lt(path.end(end, mask));
        if mask.none() {
            return;
        }
        let state = self.sheets.state(PathClasses::start::<F>(), events_before(before));
        let (g, lens) = (camera.density(path.direction(), time).0, camera.lens_pdf(time).0);
        let per_cos = crossing.cos.recip();
        let light = path.throughput() * (g * lens * per_cos);
        let distance = F::select(path.from_far, F::one(), crossing.t * crossing.t);
        let near = path.near * distance;
        let by_eye = lens * per_cos * h.sum(near, path.far * (g / F::splat(self.light_paths)));
        let (weight, at) = (self.weight([by_eye, F::zero()]), (crossing.raster, pixel));
        self.sheets.splat(state, self.strategy(path.segments + 1, 0), at, light, weight, mask);
    }

    /// s = 0: the surroundings.
    pub fn escape(&mut self, path: &SubPath<'a, F>, state: F::Index, mask: F::Mask) {
        if mask.none() || (self.scene.hides_emitters() && path.segments == 1) {
            return;
        }
        let (scene, h, w) = (self.scene, self.heuristic, path.direction());
        for (number, environment) in &scene.emitters().environments {
            let (radiance, pdf) = environment.eval(w);
            let emitter = F::Index::splat(*number);
            let source = scene.light_sampler().source_probability::<F>(emitter);
            let position = scene.emitters().emission_pdf(emitter, path.ray.time, Vec3::zero(), -w, mask).position.0;
            let drawn = match path.segments {
                // The eye draws no points of lights; parallel rays of it meet none that light draws.
                1 if scene.camera().is_parallel() => F::zero(),
                1 => source,
                _ => scene.light_sampler().probability(path.from, path.normal, emitter, mask),
            };
            let by_light = pdf.0 * h.sum(drawn * path.near, source * position * path.far);
            let weight = self.weight([by_light, F::zero()]);
            let light = path.throughput() * radiance;
            self.sheets.add(state, self.strategy(0, path.segments + 1), light, weight, mask & radiance.is_lit());
        }
    }

    /// s = 0: a surface that shines.
    pub fn hit_light(&mut self, path: &SubPath<'a, F>, vertex: &Vertex<'a, F>, state: F::Index) {
        let (scene, h, surface) = (self.scene, self.heuristic, &vertex.surface);
        let radiance = scene.emitted(surface, vertex.mask);
        let lit = vertex.mask & radiance.is_lit();
        if lit.none() {
            return;
        }
        let (emitters, choice) = (scene.emitters(), scene.light_sampler());
        let source = choice.source_probability::<F>(surface.emitter);
        let pdf = emitters.emission_pdf(surface.emitter, surface.time, surface.ng, surface.wo, lit);
        let drawn = if path.segments == 1 {
            source * pdf.position.0
        } else {
            let hit = surface.seen_from(path.from);
            choice.probability(path.from, path.normal, surface.emitter, lit)
                * emitters.pdf(&hit, LightSampling::Area, lit).to_area(hit.to, hit.normal).0
        };
        let by_light = h.sum(drawn * vertex.near, source * pdf.position.0 * pdf.direction.0 * vertex.far);
        let weight = self.weight([by_light, F::zero()]);
        self.sheets.add(state, self.strategy(0, path.segments + 1), vertex.throughput * radiance, weight, lit);
    }

    /// s = 1: a point of a light, drawn for this vertex.
    pub fn ask_light(
        &mut self,
        path: &SubPath<'a, F>,
        vertex: &Vertex<'a, F>,
        state: F::Index,
        u: &Dimensions<F>,
        mask: F::Mask,
    ) {
        let (scene, h, surface, bsdf) = (self.scene, self.heuristic, &vertex.surface, &vertex.bsdf);
        let choice = || u.value(LIGHT_CHOICE);
        let Some((emitter, choice)) = scene.light_sampler().sample(surface.p, bsdf.normal(), choice, mask) else {
            return;
        };
        let (place, time) = (u.pair(LIGHT_POINT), path.ray.time);
        let light = scene.emitters().sample(emitter, surface.p, time, LightSampling::Area, place, mask);
        let (value, back) = vertex.eval_both_ways(light.wi, TransportMode::Radiance, mask);
        let brings = value.f * light.weight * (bsdf.normal().dot(light.wi).abs() / choice);
        let contribution = vertex.throughput * brings;
        let state = self.sheets.state(state, once_with(|| bsdf.event(surface.wo, light.wi)));
        let Some(shadow) = ShadowRay::new(surface, &light, time, contribution, F::Index::splat(0), mask) else {
            return;
        };
        // What is not drawn, as the place of a point, has the density 1 here and there.
        let hittable = light.pdf.0.gt(F::zero());
        let to = light.point - surface.p;
        let by_area = F::select(light.infinite, light.pdf.0, light.pdf.to_area(to, light.normal).0);
        let drawn = F::select(hittable, by_area, F::one());
        let source = scene.light_sampler().source_probability::<F>(emitter);
        let pdf = scene.emitters().emission_pdf(emitter, time, light.normal, -light.wi, shadow.mask);
        let distance = F::select(scene.emitters().is_parallel::<F>(emitter), F::one(), to.length_squared());
        let found = source * pdf.position.0 * pdf.direction.0 * vertex.cos(light.wi) / (distance * choice * drawn);
        let by_light = F::select(hittable, value.pdf.0 / (choice * light.pdf.0), F::zero());
        let weight = self.weight([by_light, vertex.others(h, found, back)]);
        let strategy = self.strategy(1, path.segments + 1);
        let connection = Connection { ray: shadow.ray, light: contribution, weight, state, strategy };
        self.sheets.connect(&connection, shadow.mask);
    }

    /// s ≥ 2 and t ≥ 2: to every vertex of the light's walk.
    pub fn connect_walks(
        &mut self,
        light_walk: &[Vertex<'a, F>],
        path: &SubPath<'a, F>,
        z: &Vertex<'a, F>,
        state: F::Index,
        mask: F::Mask,
    ) {
        let h = self.heuristic;
        // Segments: those of the eye's walk, the connection, and s − 1 of the light's.
        let most = (self.max_depth - path.segments - 1) as usize;
        for (number, y) in light_walk.iter().enumerate().take(most) {
            let mask = mask & y.mask.and_not(y.bsdf.is_specular());
            if mask.none() {
                continue;
            }
            let across = y.surface.p - z.surface.p;
            let d2 = across.length_squared();
            let w = across * d2.sqrt().recip();
            let (at_z, back_z) = z.eval_both_ways(w, TransportMode::Radiance, mask);
            let mask = mask & at_z.f.is_lit();
            if mask.none() {
                continue;
            }
            let (at_y, back_y) = y.eval_both_ways(-w, TransportMode::Importance, mask);
            let cosines = (z.bsdf.normal().dot(w) * y.bsdf.normal().dot(w)).abs();
            let light = z.throughput * at_z.f * at_y.f * y.throughput * (cosines / d2);
            let of_both = [(z, w), (y, -w)].into_iter().map(|(v, w)| v.bsdf.event(v.surface.wo, w));
            let state = self.sheets.state(state, of_both.chain(events_before(&light_walk[..number])));
            let mask = mask & light.is_lit();
            if mask.none() {
                continue;
            }
            let o = z.surface.leave(w);
            let d = y.surface.leave(-w) - o;
            let ray = Ray { o: o.array(), d: d.array(), tmax: F::one(), time: path.ray.time };
            let by_eye = y.others(h, at_z.pdf.0 * y.cos(w) / d2, back_y);
            let by_light = z.others(h, at_y.pdf.0 * z.cos(w) / d2, back_z);
            let weight = self.weight([by_eye, by_light]);
            let strategy = self.strategy(number as u32 + 2, path.segments + 1);
            self.sheets.connect(&Connection { ray, light, weight, state, strategy }, mask);
        }
    }
}

/// The events of walks from the light, the last first.
fn events_before<F: Real>(vertices: &[Vertex<'_, F>]) -> impl Iterator<Item = F::Index> {
    vertices.iter().rev().map(|v| v.event)
}
