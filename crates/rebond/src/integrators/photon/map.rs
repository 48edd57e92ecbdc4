//! Stored photons, and the light that they reflect to the eye.

use super::emission::{Counts, Emitted};
use crate::bsdf::{Model, TransportMode};
use crate::math::{Rgb, Vec3, vec3};
use crate::render::{Observer, Rays, in_order};
use crate::transport::{Kernel, NOTHING, Near, Nearest, Particle, PointTree, Vertex};
use std::f32::consts::PI;

/// How densities are estimated.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Photons of one; [`usize::MAX`] if only the radius counts.
    pub nearest: usize,
    /// The square of the most that the radius may be.
    pub most: f32,
    pub kernel: Kernel,
}

/// What an estimate found.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// Radiance, for one of throughput 1.
    pub light: Rgb<f32>,
    /// Of the photons that it looked at.
    pub squared_radius: f32,
}

/// A photon, and the normal of its side of the surface.
pub type Stored = (Particle, Vec3<f32>);

/// Photons in a tree.
#[derive(Default)]
pub struct PhotonMap {
    tree: PointTree,
    /// At the tree's places.
    photons: Vec<Stored>,
    /// 1/N.
    scale: f32,
    pub counts: Counts,
    /// What it took to fill it.
    pub rays: Rays,
    irradiance: Option<Irradiance>,
}

/// Irradiance at every fourth photon (Christensen 1999).
struct Irradiance {
    tree: PointTree,
    /// At the tree's places: irradiance, the normal of its side, and the squared radius that it was estimated from.
    known: Vec<([f32; 3], Vec3<f32>, f32)>,
}

/// One in so many photons has its irradiance computed.
const ONE_IN: usize = 4;
/// Cosine of the most that two normals may differ by to have one irradiance.
const SAME_SIDE: f32 = 0.9;
/// Photons whose irradiance is one job.
const JOB: usize = 1024;

impl PhotonMap {
    pub fn new(emitted: Emitted, threads: usize) -> Self {
        let all: Vec<Particle> = emitted.photons.concat();
        let normals: Vec<Vec3<f32>> = emitted.normals.concat();
        let places: Vec<[f32; 3]> = all.iter().map(|p| p.p).collect();
        let tree = PointTree::new(&places, threads);
        let at = |n: &u32| match *n {
            NOTHING => (Particle::default(), Vec3::zero()),
            n => (all[n as usize], normals[n as usize]),
        };
        let photons = tree.order().iter().map(at).collect();
        let scale = 1.0 / emitted.counts.emitted.max(1) as f32;
        Self { tree, photons, scale, counts: emitted.counts, rays: emitted.rays, irradiance: None }
    }

    /// Computes the irradiance at some of the photons; `None` if it was told to stop.
    pub fn precompute(mut self, how: &Estimate, threads: usize, observer: &dyn Observer) -> Option<Self> {
        let some: Vec<Stored> = self.stored().copied().step_by(ONE_IN).collect();
        let job = |number: usize| {
            if observer.should_stop() {
                return Vec::new();
            }
            let mut near = Nearest::default();
            let part = &some[number * JOB..some.len().min((number + 1) * JOB)];
            let one = |(at, normal): &Stored| {
                let lit = |photon: &Particle| if facing(photon, *normal) { photon.power } else { [0.0; 3] };
                let found = self.sum(at.p, how, &mut near, lit);
                (found.light.lane(0), *normal, found.squared_radius)
            };
            part.iter().map(one).collect::<Vec<_>>()
        };
        let all = in_order(some.len().div_ceil(JOB), threads, job).concat();
        if all.len() < some.len() {
            return None;
        }
        let tree = PointTree::new(&some.iter().map(|(photon, _)| photon.p).collect::<Vec<_>>(), threads);
        let at = |n: &u32| if *n == NOTHING { ([0.0; 3], Vec3::zero(), 0.0) } else { all[*n as usize] };
        let known = tree.order().iter().map(at).collect();
        self.irradiance = Some(Irradiance { tree, known });
        Some(self)
    }

    /// Every photon that is stored.
    pub fn stored(&self) -> impl Iterator<Item = &Stored> {
        self.tree.order().iter().zip(&self.photons).filter(|(n, _)| **n != NOTHING).map(|(_, p)| p)
    }

    /// What a vertex of the eye's walk reflects of the photons near by whose paths have up to `longest` segments.
    pub fn reflected(&self, vertex: &Vertex<'_>, longest: u32, how: &Estimate, near: &mut Nearest) -> Found {
        let (surface, bsdf) = (&vertex.surface, &vertex.bsdf);
        let p = surface.p.array();
        // A diffuse surface reflects all directions alike, if they are above it.
        let n = bsdf.normal();
        if bsdf.model() == Model::Diffuse {
            let f = bsdf.eval(surface.wo, n, TransportMode::Radiance, true).f;
            if let Some(found) = self.known_irradiance(p, surface.ng.facing(surface.wo), how) {
                return Found { light: f * found.light, ..found };
            }
            if (n - surface.ng.facing(n)).max_abs() == 0.0 {
                let counts = |photon: &Particle| photon.segments <= longest && facing(photon, n);
                let found = self.sum(p, how, near, |photon| if counts(photon) { photon.power } else { [0.0; 3] });
                return Found { light: f * found.light, ..found };
            }
        }
        self.sum(p, how, near, |photon| {
            let ([x, y, z], [r, g, b]) = (photon.w, photon.power);
            let mask = photon.segments <= longest;
            let near = Near { w: vec3(x, y, z), power: Rgb::new(r, g, b), sums: [0.0; 2], squared: 0.0, mask };
            near.reflected(vertex, vertex.eval(near.w, TransportMode::Radiance, mask).f).lane(0)
        })
    }

    /// What was computed at the nearest photon of such a surface, if p lies within the disk of that estimate.
    fn known_irradiance(&self, p: [f32; 3], n: Vec3<f32>, how: &Estimate) -> Option<Found> {
        let irradiance = self.irradiance.as_ref()?;
        let same_side = |place: usize| irradiance.known[place].1.dot(n) > SAME_SIDE;
        let (place, d2) = irradiance.tree.nearest_where(p, how.most, same_side)?;
        let (light, _, squared_radius) = irradiance.known[place];
        (d2 < squared_radius).then_some(Found { light: Rgb::splat(light), squared_radius })
    }

    /// ```text
    /// Σ_p value(p) K(d_p / r) / (N π r²)
    /// ```
    ///
    /// over the photons nearer than r: the distance of the k-th, which itself does not count, so that an even density is found
    /// without bias; or the most there is.
    #[inline(always)]
    fn sum(&self, p: [f32; 3], how: &Estimate, near: &mut Nearest, value: impl Fn(&Particle) -> [f32; 3]) -> Found {
        let all = self.counts.stored as usize;
        let k = if how.nearest == usize::MAX { usize::MAX } else { how.nearest.min(all) };
        let squared_radius = self.tree.nearest(p, k, how.most, near);
        let mut sum = [0.0; 3];
        if squared_radius > 0.0 {
            let inverse = 1.0 / squared_radius;
            for (place, d2) in near.iter().filter(|(_, d2)| *d2 < squared_radius) {
                let weight = how.kernel.value(d2 * inverse);
                sum.iter_mut().zip(value(&self.photons[place].0)).for_each(|(sum, x)| *sum += x * weight);
            }
        }
        let light = Rgb::splat(sum) * (self.scale / (PI * squared_radius));
        Found { light: light.masked(squared_radius > 0.0 && squared_radius.is_finite()), squared_radius }
    }
}

/// Whether a photon came from the side of this normal.
#[inline(always)]
fn facing(photon: &Particle, n: Vec3<f32>) -> bool {
    photon.w[0] * n.x + photon.w[1] * n.y + photon.w[2] * n.z > 0.0
}
