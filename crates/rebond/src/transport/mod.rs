//! What the algorithms share.

mod connections;
pub mod estimator;
mod eye;
pub mod form_factor;
pub mod irradiance;
mod kernel;
mod particles;
mod point_grid;
mod point_tree;
mod roulette;
mod sheets;
pub mod sub_path;
mod ways;

pub use connections::Connection;
pub use eye::{Seen, see, see_source};
pub use kernel::{Kernel, first_radius, shrunk};
pub use particles::{Near, Neighbours, Particle};
pub use point_grid::{Placed, PointGrid};
pub use point_tree::{NOTHING, Nearest, PointTree};
pub use roulette::Roulette;
pub use sheets::{Place, Sheets};
pub use sub_path::{Heuristic, Source, SubPath, Vertex, Walk};
pub use ways::Ways;

use rebond_lanes::Real;

/// What no walk of light brings to the eye, in words.
pub const NOT_BY_LIGHT: &str = "what the eye sees in mirrors and glass, and surroundings by parallel rays, are left out, \
                                unless the camera has a lens";

/// The power heuristic with β = 2 (Veach 1997, §9.2.4): the weight of a sample drawn with density `a` that another
/// sampler would have drawn with density `b`. An infinite `a` (a direction that only its sampler finds) has weight 1.
#[inline(always)]
pub fn power_heuristic<F: Real>(a: F, b: F) -> F {
    let ratio = b / a;
    (ratio * ratio + 1.0).recip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_and_limits_hold() {
        for (a, b) in [(1.0_f32, 2.0), (1e-3, 1e3), (0.5, 0.5), (1e20, 1e-20)] {
            assert!((power_heuristic(a, b) + power_heuristic(b, a) - 1.0).abs() < 1e-6);
        }
        assert_eq!((power_heuristic(f32::INFINITY, 3.0), power_heuristic(2.0_f32, 0.0)), (1.0, 1.0));
        assert!((power_heuristic(1.0_f32, 2.0) - 0.2).abs() < 1e-7);
    }
}
