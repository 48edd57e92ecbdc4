//! Ambient occlusion (Zhukov, Iones, Kronin 1998): how much of an even sky of radiance 1 a point sees.
//!
//! ```text
//! L(x) = ∫ max(n·ω, 0)/π · V(x, ω) dω
//!      ≈ 4/N Σ max(n·ω, 0) V     uniform over the sphere:      pdf = 1/4π
//!      ≈ 2/N Σ max(n·ω, 0) V     uniform over the hemisphere:  pdf = 1/2π
//!      ≈ 1/N Σ V                 cosine:                       pdf = n·ω/π
//! ```
//!
//! One direction for each camera ray. Where nothing is in the way (V = 1) the variances of one sample are 5/3, 1/3 and 0.
//! Unbiased; what a camera ray misses is black. n is the shading normal on the viewer's side, and directions below the
//! geometric surface see nothing.

use super::IntegratorError;
use crate::math::{Frame, Rgb, Vec3};
use crate::render::{Bounce, PathState, Shade, ShadowRay};
use crate::sampling::warp::{cosine_hemisphere, uniform_hemisphere, uniform_sphere};
use crate::scene::{Scene, is_hit};
use rebond_bvh::{Hit, Ray};
use rebond_lanes::{Index, Mask, Real};
use serde::{Deserialize, Serialize};

/// How directions are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AmbientOcclusionSampling {
    /// Uniformly over the sphere; half of them in vain.
    Sphere,
    /// Uniformly over the hemisphere.
    Hemisphere,
    /// In proportion to the cosine.
    #[default]
    Cosine,
}

/// Settings of ambient occlusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AmbientOcclusionSettings {
    /// How directions are drawn.
    pub sampling: AmbientOcclusionSampling,
    /// What is farther away than this hides nothing, in metres. Unlimited if not given.
    pub max_distance: Option<f32>,
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("sampling", "how directions are drawn: sphere, hemisphere or cosine; cosine"),
    ("max_distance", "what is farther away hides nothing, in metres; unlimited if not given"),
];

/// The estimator.
pub struct AmbientOcclusion(AmbientOcclusionSettings);

impl AmbientOcclusion {
    pub(super) fn new(settings: AmbientOcclusionSettings) -> Result<Self, IntegratorError> {
        match settings.max_distance {
            Some(d) if d <= 0.0 || d.is_nan() => Err(IntegratorError {
                message: format!("max_distance = {d} hides nothing"),
                help: "give a length above 0, in metres".into(),
            }),
            _ => Ok(Self(settings)),
        }
    }
}

const DIRECTION: u32 = 0;
const PER_BOUNCE: u32 = 1;

impl Shade for AmbientOcclusion {
    fn shade<F: Real>(&self, scene: &Scene, path: &mut PathState<F>, hit: &Hit<F>, active: F::Mask) -> Bounce<F> {
        let found = active & is_hit(hit);
        if found.none() {
            return Bounce::end();
        }
        let surface = scene.surface(&path.ray(), hit, found);
        let n = surface.frame.n.facing(surface.wo);
        let u = path.dimensions(PER_BOUNCE).pair(DIRECTION);
        let (w, factor) = match self.0.sampling {
            AmbientOcclusionSampling::Sphere => (uniform_sphere(u), 4.0),
            AmbientOcclusionSampling::Hemisphere => (uniform_hemisphere(u), 2.0),
            AmbientOcclusionSampling::Cosine => (cosine_hemisphere(u), 1.0),
        };
        let value = match self.0.sampling {
            AmbientOcclusionSampling::Cosine => F::one(),
            _ => w.z.relu() * factor,
        };
        let w: Vec3<F> = Frame::around(n).to_world(w);
        let above = (w.dot(surface.ng) * surface.wo.dot(surface.ng)).gt(F::zero());
        let mask = found & above & value.gt(F::zero());
        let ray = Ray {
            o: surface.leave(w).array(),
            d: w.array(),
            tmax: F::splat(self.0.max_distance.unwrap_or(f32::INFINITY)),
            time: path.time,
        };
        let contribution = path.throughput() * Rgb::grey(value);
        Bounce::last(Some(ShadowRay { ray, contribution, event: F::Index::splat(0), mask }))
    }
}
