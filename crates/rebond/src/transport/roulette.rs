//! How long paths go on: Russian roulette (Arvo and Kirk 1990).
//!
//! A path survives with probability q, and counts 1/q when it does.
//!
//! | `roulette` | q |
//! |---|---|
//! | `none` | 1 |
//! | `constant` | `survival` |
//! | `albedo` | max channel of f_r \|cosθ\| / pdf(bsdf), which is ρ for a diffuse surface; at most `survival` |
//! | `throughput` | max channel of the throughput · η², which undoes what refraction did to radiance; at most `survival` |

use crate::math::Rgb;
use rebond_lanes::Real;
use serde::{Deserialize, Serialize};

/// The probability with which a path survives Russian roulette.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Roulette {
    /// One: paths end by `max_depth` alone.
    None,
    /// The same everywhere.
    Constant,
    /// What the surface reflects.
    Albedo,
    /// What the path still counts.
    #[default]
    Throughput,
}

impl Roulette {
    /// q, for a path whose last bounce weighed it by `weight`, and which counts `throughput` now; η² is taken into it.
    #[inline(always)]
    pub fn survival<F: Real>(self, most: f32, weight: Rgb<F>, throughput: Rgb<F>) -> F {
        let most = F::splat(most);
        match self {
            Self::None => F::one(),
            Self::Constant => most,
            Self::Albedo => weight.map(F::abs).max().min(most),
            Self::Throughput => throughput.map(F::abs).max().min(most),
        }
    }
}
