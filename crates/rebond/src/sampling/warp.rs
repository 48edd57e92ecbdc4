//! Warps of the unit square to directions and surfaces, each beside its density.

use super::PdfSolidAngle;
use crate::math::{Vec3, vec3};
use rebond_lanes::{Real, math};
use std::f32::consts::{FRAC_1_PI, PI};

/// The unit disk, uniformly, by the concentric map (Shirley and Chiu 1997); the density is 1/π.
#[inline(always)]
pub fn uniform_disk<F: Real>(u: [F; 2]) -> [F; 2] {
    let (a, b) = (u[0] * 2.0 - 1.0, u[1] * 2.0 - 1.0);
    let wide = a.abs().gt(b.abs());
    let (r, other) = (F::select(wide, a, b), F::select(wide, b, a));
    let ratio = F::select(r.eq(F::zero()), F::zero(), other / r) * (PI / 4.0);
    let (sin, cos) = math::sin_cos(ratio);
    [r * F::select(wide, cos, sin), r * F::select(wide, sin, cos)]
}

/// The concentric map of [`uniform_disk`] as distance from the centre and angle in turns.
#[inline(always)]
fn concentric<F: Real>(u: [F; 2]) -> [F; 2] {
    let (a, b) = (u[0] * 2.0 - 1.0, u[1] * 2.0 - 1.0);
    let wide = a.abs().gt(b.abs());
    let (r, other) = (F::select(wide, a, b), F::select(wide, b, a));
    let eighth = F::select(r.eq(F::zero()), F::zero(), other / r) * 0.125;
    let turns = F::select(wide, eighth, F::splat(0.25) - eighth) + F::select(r.lt(F::zero()), F::splat(0.5), F::zero());
    [r.abs(), turns - turns.floor()]
}

/// The regular polygon of at least three `sides` with its corners on the unit circle, the first at (1, 0), uniformly; the
/// density is 2/(n sin(2π/n)). The concentric map's angle becomes the way along the polygon's edge.
#[inline(always)]
pub fn uniform_polygon<F: Real>(u: [F; 2], sides: u32) -> [F; 2] {
    let [r, turns] = concentric(u);
    let n = sides as f32;
    let edge = (turns * n).floor().min(F::splat(n - 1.0));
    let along = (turns * n - edge) * 2.0 - 1.0;
    let half = PI / n;
    // Out to the middle of the edge, and along it.
    let (sin, cos) = math::sin_cos((edge * 2.0 + 1.0) * half);
    let (out, along) = (r * half.cos(), r * along * half.sin());
    [out * cos - along * sin, out * sin + along * cos]
}

/// The hemisphere around +z, density cosθ/π: a disk lifted to the sphere (Malley's method).
#[inline(always)]
pub fn cosine_hemisphere<F: Real>(u: [F; 2]) -> Vec3<F> {
    let [x, y] = uniform_disk(u);
    vec3(x, y, (F::one() - x * x - y * y).safe_sqrt())
}

/// Density of [`cosine_hemisphere`].
#[inline(always)]
pub fn cosine_hemisphere_pdf<F: Real>(w: Vec3<F>) -> PdfSolidAngle<F> {
    PdfSolidAngle(w.z.relu() * FRAC_1_PI)
}

/// The direction of given cosine from +z and azimuth 2πu.
#[inline(always)]
pub fn around_z<F: Real>(cos: F, u: F) -> Vec3<F> {
    let sin = ((F::one() - cos) * (F::one() + cos)).safe_sqrt();
    let (s, c) = math::sin_cos(u * (2.0 * PI));
    vec3(sin * c, sin * s, cos)
}

/// The whole sphere, uniformly: `θ = acos(1 − 2ξ₁)`, `φ = 2πξ₂`.
#[inline(always)]
pub fn uniform_sphere<F: Real>(u: [F; 2]) -> Vec3<F> {
    around_z(F::one() - u[0] * 2.0, u[1])
}

/// Density of [`uniform_sphere`], 1/4π.
#[inline(always)]
pub fn uniform_sphere_pdf<F: Real>() -> PdfSolidAngle<F> {
    PdfSolidAngle(F::splat(FRAC_1_PI / 4.0))
}

/// The hemisphere around +z, uniformly.
#[inline(always)]
pub fn uniform_hemisphere<F: Real>(u: [F; 2]) -> Vec3<F> {
    around_z(F::one() - u[0], u[1])
}

/// Density of [`uniform_hemisphere`], 1/2π above.
#[inline(always)]
pub fn uniform_hemisphere_pdf<F: Real>(w: Vec3<F>) -> PdfSolidAngle<F> {
    PdfSolidAngle(F::select(w.z.ge(F::zero()), F::splat(FRAC_1_PI / 2.0), F::zero()))
}

/// The cone around +z of given `1 − cosθmax`, uniformly. The difference is asked for instead of the cosine since it
/// keeps its digits for narrow cones.
#[inline(always)]
pub fn uniform_cone<F: Real>(u: [F; 2], one_minus_cos: F) -> Vec3<F> {
    let delta = u[0] * one_minus_cos;
    let sin = (delta * (F::splat(2.0) - delta)).safe_sqrt();
    let (s, c) = math::sin_cos(u[1] * (2.0 * PI));
    vec3(sin * c, sin * s, F::one() - delta)
}

/// Density of [`uniform_cone`], inside the cone.
#[inline(always)]
pub fn uniform_cone_pdf<F: Real>(one_minus_cos: F) -> PdfSolidAngle<F> {
    PdfSolidAngle((one_minus_cos * (2.0 * PI)).recip())
}

/// The hemisphere around +z, density `(r+1)/2π · cosʳθ`.
#[inline(always)]
pub fn power_cosine<F: Real>(u: [F; 2], r: F) -> Vec3<F> {
    around_z(math::pow(F::one() - u[0], (r + 1.0).recip()), u[1])
}

/// Density of [`power_cosine`].
#[inline(always)]
pub fn power_cosine_pdf<F: Real>(w: Vec3<F>, r: F) -> PdfSolidAngle<F> {
    PdfSolidAngle((r + 1.0) * (0.5 * FRAC_1_PI) * power_of_cosine(w.z, r))
}

/// cosʳ, 0 below the horizon.
#[inline(always)]
pub fn power_of_cosine<F: Real>(cos: F, r: F) -> F {
    F::select(cos.gt(F::zero()), math::pow(cos, r), F::zero())
}

/// Barycentric coordinates (of the second and third corner) uniform over a triangle; the density is 1/area.
/// (Heitz, "A low-distortion map between triangle and square", 2019.)
#[inline(always)]
pub fn uniform_triangle<F: Real>(u: [F; 2]) -> [F; 2] {
    let first = u[1].gt(u[0]);
    let half_small = F::select(first, u[0], u[1]) * 0.5;
    let (x, y) = (half_small, F::select(first, u[1], u[0]) - half_small);
    [F::select(first, x, y), F::select(first, y, x)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{chi2_sphere, chi2_square};

    #[test]
    fn directions_follow_their_densities() {
        chi2_sphere("cosine hemisphere", cosine_hemisphere, |w| cosine_hemisphere_pdf(w).0);
        chi2_sphere("uniform sphere", uniform_sphere, |_| uniform_sphere_pdf().0);
        chi2_sphere("uniform hemisphere", uniform_hemisphere, |w| uniform_hemisphere_pdf(w).0);
        for r in [0.0, 1.0, 7.5, 60.0, 300.0] {
            chi2_sphere(&format!("power cosine {r}"), |u| power_cosine(u, r), |w| power_cosine_pdf(w, r).0);
        }
        for degrees in [90.0_f32, 45.0, 9.0] {
            // A multiple of the test's bins of 4.5°, so that no bin is cut.
            let cos = degrees.to_radians().cos();
            let pdf = |w: Vec3<f32>| if w.z >= cos { uniform_cone_pdf(1.0 - cos).0 } else { 0.0 };
            chi2_sphere(&format!("cone {degrees}°"), |u| uniform_cone(u, 1.0 - cos), pdf);
        }
    }

    #[test]
    fn surfaces_follow_their_densities() {
        // A disk and a triangle within the unit square, densities over that square.
        let disk = |u| uniform_disk::<f32>(u).map(|x| x * 0.5 + 0.5);
        let in_disk = |p: [f32; 2]| (p[0] - 0.5).powi(2) + (p[1] - 0.5).powi(2) <= 0.25;
        chi2_square("disk", disk, |p| if in_disk(p) { 4.0 * FRAC_1_PI } else { 0.0 });
        chi2_square("triangle", uniform_triangle, |p| if p[0] + p[1] <= 1.0 { 2.0 } else { 0.0 });
        // The square with corners on the axes.
        let square = |u| uniform_polygon::<f32>(u, 4).map(|x| x * 0.5 + 0.5);
        let in_square = |p: [f32; 2]| (p[0] - 0.5).abs() + (p[1] - 0.5).abs() <= 0.5;
        chi2_square("polygon", square, |p| if in_square(p) { 2.0 } else { 0.0 });
    }
}
