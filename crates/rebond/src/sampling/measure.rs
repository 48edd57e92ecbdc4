//! Densities that cannot be mixed up: per steradian, and per square metre.

use crate::math::Vec3;
use rebond_lanes::Real;

/// A density over directions, in sr⁻¹.
#[derive(Clone, Copy, Debug, Default)]
pub struct PdfSolidAngle<F: Real>(pub F);

/// A density over surfaces, in m⁻².
#[derive(Clone, Copy, Debug, Default)]
pub struct PdfArea<F: Real>(pub F);

impl<F: Real> PdfArea<F> {
    /// The same density per solid angle: `pdf_ω = pdf_A · d² / |cosθ'|`, with `to` the vector to the surface point and
    /// `n` the unit normal there; 0 for a surface seen edge-on.
    #[inline(always)]
    pub fn to_solid_angle(self, to: Vec3<F>, n: Vec3<F>) -> PdfSolidAngle<F> {
        let d2 = to.length_squared();
        let area_factor = to.dot(n).abs(); // |cosθ'| · d
        let value = self.0 * d2 * d2.sqrt() / area_factor;
        PdfSolidAngle(F::select(area_factor.gt(F::zero()), value, F::zero()))
    }
}

impl<F: Real> PdfSolidAngle<F> {
    /// The same density per area of the surface with unit normal `n`, reached by the vector `to`.
    #[inline(always)]
    pub fn to_area(self, to: Vec3<F>, n: Vec3<F>) -> PdfArea<F> {
        let d2 = to.length_squared();
        PdfArea(self.0 * to.dot(n).abs() / (d2 * d2.sqrt()))
    }
}
