//! Which emitter a point asks for light.

use super::{Emitter, importance};
use crate::math::Vec3;
use crate::sampling::Discrete;
use rebond_lanes::Real;

/// A choice among the emitters: in proportion to their power, the same from everywhere. A hierarchy that knows where
/// the receiving point is takes its place behind the same two functions.
#[derive(Clone, Debug, Default)]
pub struct LightSampler {
    by_power: Option<Discrete>,
}

impl LightSampler {
    /// A choice among these; `scene_radius` is what infinite ones shine on. `None` if a power is not finite.
    pub fn new(emitters: &[Emitter], scene_radius: f32) -> Option<Self> {
        let power: Vec<f64> = emitters.iter().map(|e| importance(e, scene_radius)).collect();
        let most = power.iter().fold(0.0, |m: f64, p| m.max(*p));
        if !power.iter().all(|p| p.is_finite()) {
            return None;
        }
        // Relative to the strongest, so that no scale of units overflows.
        let weights: Vec<f32> = power.iter().map(|p| if most > 0.0 { (p / most) as f32 } else { 0.0 }).collect();
        Some(Self { by_power: Discrete::new(&weights) })
    }

    /// An emitter for the point `p` with normal `n`, and the probability of that choice; `None` in a scene without light.
    #[inline(always)]
    pub fn sample<F: Real>(&self, _p: Vec3<F>, _n: Vec3<F>, u: impl FnOnce() -> F) -> Option<(F::Index, F)> {
        let by_power = self.by_power.as_ref()?;
        let u = if by_power.len() == 1 { F::zero() } else { u() };
        Some(by_power.sample(u))
    }

    /// The probability with which [`LightSampler::sample`] chooses this emitter.
    #[inline(always)]
    pub fn probability<F: Real>(&self, _p: Vec3<F>, _n: Vec3<F>, emitter: F::Index) -> F {
        self.by_power.as_ref().map_or(F::zero(), |d| d.probability(emitter))
    }
}
