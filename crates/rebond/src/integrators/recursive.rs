//! Recursive shading: N samples at every hit, each of which asks for N more (Cook, Porter, Carpenter 1984, taken to all
//! surfaces).
//!
//! ```text
//! L(x, ωo) ≈ Le + 1/N Σ_i (Ld_i + Lind_i)
//! Ld_i     = Le(y_i → x) f_r V |cosθ| / pdf(light)        a point y_i of one emitter
//! Lind_i   = f_r |cosθ| / pdf(bsdf) · L(x_i, −ω_i)        a direction ω_i; its Le counts only if no Ld could find it
//! ```
//!
//! Segment d costs N^(d−1) rays per camera ray: most of them where they matter least. With N = 1 it is explicit path
//! tracing. It must end, so it is biased by what paths of more than `depth` segments bring.

use super::IntegratorError;
use crate::bsdf::TransportMode;
use crate::emitter::LightSampling;
use crate::film::{Batch, Film};
use crate::math::{Rgb, Vec3};
use crate::render::{Dimensions, Integrator, Observer, Pass, PathState, Rays, ShadowRay, TILE, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use rebond_bvh::Ray;
use rebond_lanes::scalar::Index1;
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;
use std::sync::Mutex;

/// Settings of recursive shading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecursiveSettings {
    /// Samples at every hit.
    pub branching: NonZeroU32,
    /// Longest path in segments.
    pub depth: NonZeroU32,
}

impl Default for RecursiveSettings {
    fn default() -> Self {
        let n = |n| NonZeroU32::new(n).expect("not 0");
        Self { branching: n(4), depth: n(4) }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] =
    &[("branching", "samples at every hit; 4"), ("depth", "longest path in segments; 4")];

/// The most rays that one camera ray may lead to.
const MOST_RAYS: u64 = 1 << 24;

/// The deepest recursion.
const MOST_DEPTH: u32 = 256;

/// The estimator at work.
pub struct Recursive<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    branching: u32,
    depth: u32,
}

/// Dimensions of the sample values of one hit.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;
const BSDF_CHOICE: u32 = 2;
const BSDF_DIRECTION: u32 = 3;
const MIX_CHOICE: u32 = 4;
const PER_HIT: u32 = 5;

/// A hit in the tree of one camera ray.
#[derive(Clone, Copy)]
struct Node {
    /// Its number: the children of n are n N + 1 to n N + N.
    number: u32,
    /// Segments down to it.
    depth: u32,
    /// Pixel and sample of the camera ray.
    pixel: u32,
    sample: u32,
}

impl<'a> Recursive<'a> {
    pub(super) fn new(
        settings: RecursiveSettings,
        scene: &'a Scene,
        sampler: Sampler,
    ) -> Result<Self, IntegratorError> {
        let (branching, depth) = (settings.branching.get(), settings.depth.get());
        if u64::from(branching).checked_pow(depth - 1).is_none_or(|rays| rays > MOST_RAYS) {
            return Err(IntegratorError {
                message: format!("branching={branching} leads to more than {MOST_RAYS} rays of segment {depth}"),
                help: "use fewer branches or less depth: there are branching^(depth − 1) of them".into(),
            });
        }
        if depth > MOST_DEPTH {
            let message = format!("depth={depth} nests too deeply");
            return Err(IntegratorError { message, help: format!("at most {MOST_DEPTH}; `path` goes on for ever") });
        }
        Ok(Self { scene, sampler, branching, depth })
    }

    /// L along a ray. `emission` says whether Le of what it meets counts.
    fn radiance(&self, sampler: &Sampler, ray: &Ray<f32>, emission: bool, node: Node, rays: &mut Rays) -> Rgb<f32> {
        let scene = self.scene;
        rays.add(node.depth, 1);
        let hit = scene.meet(ray, true, node.depth == 1);
        if !is_hit(&hit) {
            let hidden = scene.hides_emitters() && node.depth == 1;
            return if emission && !hidden { scene.sky(Vec3::splat(ray.d)) } else { Rgb::black() };
        }
        let surface = scene.surface(ray, &hit, true);
        let le = if emission { scene.emitted(&surface, true) } else { Rgb::black() };
        if node.depth == self.depth {
            return le;
        }
        let mut sum = Rgb::black();
        for i in 0..self.branching {
            // The samples of one hit are a run of one sequence, so that they are spread well.
            let index = node.sample.wrapping_mul(self.branching).wrapping_add(i);
            let stream = sampler.stream(Index1(node.pixel), Index1(index));
            let u = Dimensions::new(stream, Index1(node.number), PER_HIT).apart();
            let bsdf = scene.bsdf(&surface, || u.value(MIX_CHOICE), true);

            // Ld: a point on a light, unless only a sampled direction can find it.
            let n = bsdf.normal();
            let (choice, place) = (|| u.value(LIGHT_CHOICE), u.pair(LIGHT_POINT));
            if !bsdf.is_specular()
                && let Some(light) =
                    scene.sample_light(surface.p, n, ray.time, LightSampling::Area, choice, place, true)
            {
                let f = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, true).f;
                let contribution = f * light.weight * n.dot(light.wi).abs();
                let event = bsdf.event(surface.wo, light.wi);
                if let Some(shadow) = ShadowRay::new(&surface, &light, ray.time, contribution, event, true) {
                    rays.shadow += 1;
                    sum += contribution.masked(!scene.occluded(&shadow.ray, true));
                }
            }

            // Lind: a direction of the BSDF, and all that comes along it.
            let (direction, choice) = (u.pair(BSDF_DIRECTION), || u.value(BSDF_CHOICE));
            let next = bsdf.sample(surface.wo, direction, choice, TransportMode::Radiance, true);
            if next.weight.is_lit() {
                let o = surface.leave(next.w);
                let ray = Ray { o: o.array(), d: next.w.array(), tmax: f32::INFINITY, time: ray.time };
                let number = node.number.wrapping_mul(self.branching).wrapping_add(i + 1);
                let child = Node { number, depth: node.depth + 1, ..node };
                sum += next.weight * self.radiance(sampler, &ray, next.specular, child, rays);
            }
        }
        le + sum * (self.branching as f32).recip()
    }
}

impl Integrator for Recursive<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| {
            let sampler = tiles.sampler(&self.sampler);
            while let Some(tile) = tiles.next() {
                let (mut pixels, mut rays) = ([Batch::default(); TILE], Rays::default());
                for s in tiles.samples_from(&tile, 0) {
                    let [x, y, pixel, index, slot] = [s.x, s.y, s.pixel, s.index, s.slot].map(Index1);
                    let path = PathState::start(self.scene, &sampler, x, y, pixel, index, slot);
                    let root = Node { number: 0, depth: 1, pixel: s.pixel, sample: s.index };
                    let light = path.throughput() * self.radiance(&sampler, &path.ray(), true, root, &mut rays);
                    pixels[s.slot as usize].add(light.lane(0), tile.weight);
                }
                tiles.done(&tile, &[pixels], &mut rays);
            }
        })
    }
}
