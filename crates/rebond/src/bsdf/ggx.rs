//! The GGX (Trowbridge–Reitz) distribution of facets, anisotropic, with Smith's height-correlated masking.
//!
//! Walter et al. 2007 (distribution, transmission); Heitz 2014 (masking); Dupuy and Benyoub 2023 (sampling of visible
//! normals by spherical caps). All directions with z > 0.

use crate::math::{Vec3, vec3};
use crate::sampling::warp::around_z;
use rebond_lanes::Real;
use std::f32::consts::PI;

/// Facets of roughness αx, αy.
#[derive(Clone, Copy, Debug)]
pub struct Ggx<F: Real> {
    pub ax: F,
    pub ay: F,
}

impl<F: Real> Ggx<F> {
    /// Density of facet normals over projected area, sr⁻¹: ∫ D cosθ dω = 1.
    #[inline(always)]
    pub fn d(&self, h: Vec3<F>) -> F {
        let (x, y) = (h.x / self.ax, h.y / self.ay);
        let e = x.mul_add(x, y.mul_add(y, h.z * h.z));
        (self.ax * self.ay * e * e * PI).recip()
    }

    /// Smith's Λ.
    #[inline(always)]
    pub fn lambda(&self, w: Vec3<F>) -> F {
        let (x, y) = (w.x * self.ax, w.y * self.ay);
        let slope = x.mul_add(x, y * y) / (w.z * w.z);
        ((slope + 1.0).sqrt() - 1.0) * 0.5
    }

    /// A facet normal as seen along `w`: density `D(h) max(0, w·h) / (w_z (1 + Λ(w)))`.
    #[inline(always)]
    pub fn sample_visible(&self, w: Vec3<F>, u: [F; 2]) -> Vec3<F> {
        let stretched = vec3(w.x * self.ax, w.y * self.ay, w.z).normalized();
        let z = (F::one() - u[1]).mul_add(stretched.z + 1.0, -stretched.z);
        let h = around_z(z, u[0]) + stretched;
        vec3(h.x * self.ax, h.y * self.ay, h.z.relu()).normalized()
    }
}

/// α below which a surface is treated as smooth: its lobe is narrower than f32 directions resolve.
pub const SMOOTH: f32 = 1e-3;
