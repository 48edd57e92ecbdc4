//! The opening of a lens: round, or a regular polygon between the blades of an iris.
//!
//! In the coordinates of the camera as it looks along +z: x to its left, y up. Points are uniform over the opening:
//!
//! ```text
//! pdf_A = 1/A,   A = π R²  or  ½ n R² sin(2π/n)
//! ```

use crate::sampling::PdfArea;
use crate::sampling::warp::{uniform_disk, uniform_polygon};
use rebond_lanes::{Real, math};
use std::f32::consts::{PI, TAU};

/// Fewest blades of an iris.
pub const FEWEST_BLADES: u32 = 3;
/// Most blades; so many are hardly told from a circle.
pub const MOST_BLADES: u32 = 64;

/// An opening, centred.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aperture {
    radius: f32,
    iris: Option<Iris>,
}

/// Corners on the circle of the aperture's radius.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Iris {
    blades: u32,
    /// Cosine and sine of the turn.
    turn: [f32; 2],
}

impl Aperture {
    /// A round opening.
    pub fn round(radius: f32) -> Self {
        Self { radius, iris: None }
    }

    /// A regular polygon with its corners at `radius`. One of them is on top, turned by `rotation` radians counter-clockwise as
    /// seen from behind the camera. There are at least [`FEWEST_BLADES`].
    pub fn polygon(radius: f32, blades: u32, rotation: f32) -> Self {
        debug_assert!(blades >= FEWEST_BLADES);
        Self { radius, iris: Some(Iris { blades, turn: [rotation.cos(), rotation.sin()] }) }
    }

    /// Radius of the circle around it.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Area, 0 of a pinhole.
    pub fn area(&self) -> f32 {
        let r2 = self.radius * self.radius;
        match self.iris {
            None => PI * r2,
            Some(iris) => 0.5 * r2 * iris.blades as f32 * (TAU / iris.blades as f32).sin(),
        }
    }

    /// A point of the opening, from u in [0, 1)².
    #[inline(always)]
    pub fn sample<F: Real>(&self, u: [F; 2]) -> [F; 2] {
        let Some(Iris { blades, turn: [cos, sin] }) = self.iris else {
            return uniform_disk(u).map(|x| x * self.radius);
        };
        // The polygon's first axis is up, its second one to the left.
        let [up, left] = uniform_polygon(u, blades);
        [(left * cos + up * sin) * self.radius, (up * cos - left * sin) * self.radius]
    }

    /// Density of [`Aperture::sample`]; ∞ of a pinhole.
    #[inline(always)]
    pub fn pdf<F: Real>(&self, p: [F; 2]) -> PdfArea<F> {
        let [x, y] = p;
        let distance2 = x * x + y * y;
        let open = match self.iris {
            None => distance2.le(F::splat(self.radius * self.radius)),
            Some(Iris { blades, turn: [cos, sin] }) => {
                let (up, left) = (y * cos + x * sin, x * cos - y * sin);
                let half = PI / blades as f32;
                // Within each blade's share of the circle, as far from the centre as its edge at most.
                let blade = math::atan2(left, up) * (0.5 / half);
                let from_middle = (blade - blade.floor() - 0.5) * (2.0 * half);
                (distance2.sqrt() * math::sin_cos(from_middle).1).le(F::splat(self.radius * half.cos()))
            }
        };
        PdfArea(F::select(open, F::splat(self.area().recip()), F::zero()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{chi2_square, random_pairs};

    #[test]
    fn points_follow_their_density() {
        // χ² in the square of side 2R, of which the opening is a part.
        let r = 0.3;
        let apertures = [
            ("round", Aperture::round(r)),
            ("triangle", Aperture::polygon(r, 3, 0.0)),
            ("square", Aperture::polygon(r, 4, 0.5)),
            ("pentagon", Aperture::polygon(r, 5, -2.0)),
            ("six blades", Aperture::polygon(r, 6, 0.1)),
            ("most blades", Aperture::polygon(r, MOST_BLADES, 0.0)),
        ];
        for (name, a) in apertures {
            let to_unit = |p: [f32; 2]| p.map(|x| x / (2.0 * r) + 0.5);
            let pdf = |p: [f32; 2]| a.pdf(p.map(|x| (x - 0.5) * 2.0 * r)).0 * 4.0 * r * r;
            chi2_square(name, |u| to_unit(a.sample(u)), pdf);
        }
    }

    #[test]
    fn a_corner_is_on_top_and_turns_to_the_left() {
        let top = |a: Aperture| {
            let highest = |p: [f32; 2], q: [f32; 2]| if q[1] > p[1] { q } else { p };
            random_pairs(20_000).map(|u| a.sample(u)).fold([0.0, -1.0], highest)
        };
        let [x, y] = top(Aperture::polygon(2.0, 5, 0.0));
        assert!(x.abs() < 0.05 && y > 1.95 && y <= 2.0, "{x}, {y}");
        let turn = 0.3_f32; // less than half a blade's share: the same corner is the highest
        let [x, y] = top(Aperture::polygon(2.0, 5, turn));
        assert!((x - 2.0 * turn.sin()).abs() < 0.1 && (y - 2.0 * turn.cos()).abs() < 0.1, "{x}, {y}");
    }

    #[test]
    fn many_blades_are_round() {
        let a = Aperture::polygon(1.0, MOST_BLADES, 1.0);
        assert!((a.area() / PI - 1.0).abs() < 2e-3);
        for u in random_pairs(1000) {
            let p = a.sample(u);
            assert!(p[0].hypot(p[1]) <= 1.0 + 1e-6);
        }
    }
}
