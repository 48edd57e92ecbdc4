//! Looks at a solution: what a camera sees of the patches, or one more bounce by Monte Carlo.

use super::patches::NONE;
use super::solution::Solution;
use crate::emitter::LightSampling;
use crate::math::{Frame, Rgb, Vec3};
use crate::render::{Bounce, PathState, Shade, ShadowRay};
use crate::sampling::warp::cosine_hemisphere;
use crate::scene::{Scene, Surface, is_hit};
use rebond_bvh::Hit;
use rebond_lanes::{Index, Mask, Real};
use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

/// Irradiance over π at the corners of each patch.
pub type Shown = Vec<[[f32; 3]; 3]>;

/// What there is to see.
#[derive(Clone)]
pub struct View {
    /// The patches.
    pub solution: Arc<Solution>,
    /// Material of each face, or [`NONE`] if its patches' mean reflectance is all there is to know.
    pub materials: Arc<Vec<u32>>,
    /// The solution as it was after each stage: sample n of a pixel sees the n-th. There is at least one.
    pub stages: Vec<Arc<Shown>>,
    /// Directions of the final gather; none if 0.
    pub gather: u32,
}

/// Dimensions of the sample values.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;
const DIRECTION: u32 = 2;
const PER_BOUNCE: u32 = 3;

/// What a surface sends out: what it emits, its reflectance, and what it reflects.
struct Seen<F: Real> {
    emitted: Rgb<F>,
    reflectance: Rgb<F>,
    reflected: Rgb<F>,
}

impl View {
    /// Irradiance over π as sample `n` of a pixel sees it, at corner weights of a patch. Where there are stages, sample n counts
    ///
    /// ```text
    /// (n + 1) H_n − n H_{n−1}
    /// ```
    ///
    /// so that the mean of samples 0 to n is H_n, however they were divided into passes.
    fn irradiance(&self, n: u32, patch: usize, w: [f32; 3]) -> [f32; 3] {
        let at = |stage: usize| {
            let corners = &self.stages[stage][patch];
            [0, 1, 2].map(|c| (0..3).map(|k| w[k] * corners[k][c]).sum::<f32>())
        };
        let last = self.stages.len() - 1;
        let stage = (n as usize).min(last);
        let now = at(stage);
        if n == 0 || n as usize > last || last == 0 {
            return now;
        }
        let (before, n) = (at(stage - 1), n as f32);
        [0, 1, 2].map(|c| (n + 1.0) * now[c] - n * before[c])
    }

    fn see<F: Real>(
        &self,
        scene: &Scene,
        hit: &Hit<F>,
        surface: &Surface<F>,
        sample: F::Index,
        mask: F::Mask,
    ) -> Seen<F> {
        let (mut emitted, mut reflectance, mut reflected) = (Rgb::black(), Rgb::black(), Rgb::black());
        let (front, mut lanes) = (surface.front().bits(), mask.bits());
        let mesh = &self.solution.mesh;
        while lanes != 0 {
            let l = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let behind = front >> l & 1 == 0;
            let instance = hit.instance.lane(l);
            let Some(face) = mesh.face(instance, hit.primitive.lane(l), behind) else { continue };
            let weights = scene.face_weights(instance, behind, [hit.u.lane(l), hit.v.lane(l)]);
            let (patch, w) = mesh.locate(face, weights);
            let rho = match self.materials[face as usize] {
                NONE => self.solution.reflectance[patch],
                m => scene.diffuse_part(m, surface.uv.map(|x| x.lane(l)), behind).reflectance,
            };
            let irradiance = self.irradiance(sample.lane(l), patch, w);
            let set = |color: &mut Rgb<F>, value: [f32; 3]| {
                color.r = color.r.with_lane(l, value[0]);
                color.g = color.g.with_lane(l, value[1]);
                color.b = color.b.with_lane(l, value[2]);
            };
            set(&mut emitted, self.solution.emission[patch]);
            set(&mut reflectance, rho);
            set(&mut reflected, [0, 1, 2].map(|c| rho[c] * irradiance[c]));
        }
        Seen { emitted, reflectance, reflected }
    }

    /// The next direction of the gather, from where the path stands.
    fn gather_on<F: Real>(path: &mut PathState<F>, n: Vec3<F>, u: [F; 2]) {
        let w = Frame::around(n).to_world(cosine_hemisphere(u));
        [path.dx, path.dy, path.dz] = w.array();
        path.depth = path.depth + F::Index::splat(1);
    }
}

impl Shade for View {
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F> {
        let found = active & is_hit(hit);
        let first = path.depth.eq(F::Index::splat(1));
        // The surfaces of a relit solution do not shine as the scene's do: their light is found by directions.
        let (gathers, relit) = (self.gather > 0, self.solution.relit);
        let missed = active.and_not(found) & if gathers { first } else { F::Mask::splat(true) };
        if missed.any() {
            for (radiance, _) in scene.surroundings(path.origin(), path.normal(), path.direction()) {
                path.add(radiance, missed);
            }
        }
        let u = path.dimensions(PER_BOUNCE);
        let surface = scene.surface(&path.ray(), hit, found);
        let seen = self.see(scene, hit, &surface, path.sample, found);
        if self.gather == 0 {
            path.add(seen.emitted + seen.reflected, found);
            return Bounce::end();
        }

        // The camera's own hit: its emission, one point of one light, and the first direction.
        let here = found & first;
        path.add(seen.emitted, here);
        let n = surface.ng.facing(surface.wo);
        let starts = here & seen.reflectance.is_lit();
        let mut shadow = None;
        if starts.any()
            && let Some(light) = scene.sample_light(
                surface.p,
                n,
                path.time,
                LightSampling::Area,
                || u.value(LIGHT_CHOICE),
                u.pair(LIGHT_POINT),
                starts,
            )
        {
            let cos = n.dot(light.wi).relu();
            let counts = light.infinite | light.pdf.0.le(F::zero()) | F::Mask::splat(!relit);
            let weight = light.weight.masked(counts);
            let contribution = path.throughput() * seen.reflectance * weight * (cos * FRAC_1_PI);
            shadow = ShadowRay::new(&surface, &light, path.time, contribution, F::Index::splat(0), starts);
        }

        // What a direction of the gather found.
        let there = found.and_not(first);
        path.add(seen.reflected, there);
        if relit {
            path.add(seen.emitted, there);
        }
        let going_on = active.and_not(first) & path.depth.lt(F::Index::splat(self.gather + 1));
        let alive = starts | going_on;
        if alive.none() {
            return Bounce::last(shadow);
        }
        let origin = Vec3::select(starts, surface.leave(n), path.origin());
        let normal = Vec3::select(starts, n, path.normal());
        [path.ox, path.oy, path.oz] = origin.array();
        [path.nx, path.ny, path.nz] = normal.array();
        let share = seen.reflectance * F::splat(1.0 / self.gather as f32);
        let scale = Rgb::select(starts, share, Rgb::white());
        (path.tr, path.tg, path.tb) = (path.tr * scale.r, path.tg * scale.g, path.tb * scale.b);
        Self::gather_on(path, normal, u.pair(DIRECTION));
        Bounce { alive, event: F::Index::splat(0), shadow }
    }
}
