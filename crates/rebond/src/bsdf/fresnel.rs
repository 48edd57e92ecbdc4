//! Fresnel's equations, for unpolarised light.

use crate::math::{Rgb, Vec3, vec3};
use rebond_lanes::Real;

/// Reflectance of a dielectric boundary and the cosine of the refracted ray (0 under total internal reflection).
/// `cos` ≥ 0 on the known side, `eta` the index of the other side over this one's.
#[inline(always)]
pub fn dielectric<F: Real>(cos: F, eta: F) -> (F, F) {
    let sin2_t = (F::one() - cos * cos).relu() / (eta * eta);
    let cos_t = (F::one() - sin2_t).safe_sqrt();
    let total = sin2_t.ge(F::one());
    (F::select(total, F::one(), of_cosines(cos, cos_t, eta)), F::select(total, F::zero(), cos_t))
}

/// Reflectance of a dielectric boundary, given both cosines: near total reflection neither has the other's digits.
#[inline(always)]
pub fn of_cosines<F: Real>(cos: F, cos_t: F, eta: F) -> F {
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    (parallel * parallel + perpendicular * perpendicular) * 0.5
}

/// The direction to which `w` refracts about the unit vector `h` (w·h = `cos` ≥ 0): on the other side of h.
#[inline(always)]
pub fn refract<F: Real>(w: Vec3<F>, h: Vec3<F>, cos: F, cos_t: F, eta: F) -> Vec3<F> {
    let inverse = eta.recip();
    h * (cos * inverse - cos_t) - w * inverse
}

/// The same about +z.
#[inline(always)]
pub fn refract_z<F: Real>(w: Vec3<F>, cos_t: F, eta: F) -> Vec3<F> {
    let inverse = eta.recip();
    vec3(-(w.x * inverse), -(w.y * inverse), -cos_t)
}

/// Reflectance of a conductor of complex index η + ik for each channel.
#[inline(always)]
pub fn conductor<F: Real>(cos: F, eta: Rgb<F>, k: Rgb<F>) -> Rgb<F> {
    let one = |eta: F, k: F| conductor_channel(cos, eta, k);
    Rgb::new(one(eta.r, k.r), one(eta.g, k.g), one(eta.b, k.b))
}

#[inline(always)]
fn conductor_channel<F: Real>(cos: F, eta: F, k: F) -> F {
    let cos2 = cos * cos;
    let sin2 = (F::one() - cos2).relu();
    let (eta2, k2) = (eta * eta, k * k);
    let t = eta2 - k2 - sin2;
    let a2_plus_b2 = (t * t + eta2 * k2 * 4.0).sqrt();
    let a = ((a2_plus_b2 + t) * 0.5).safe_sqrt();
    let t1 = a2_plus_b2 + cos2;
    let t2 = a * cos * 2.0;
    let perpendicular = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_plus_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let parallel = perpendicular * (t3 - t4) / (t3 + t4);
    (parallel + perpendicular) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms() {
        // Normal incidence: ((η−1)/(η+1))², from either side; and for a conductor ((η−1)²+k²)/((η+1)²+k²).
        assert!((dielectric(1.0_f32, 1.5).0 - 0.04).abs() < 1e-7);
        assert!((dielectric(1.0_f32, 1.0 / 1.5).0 - 0.04).abs() < 1e-7);
        let gold = conductor(1.0_f32, Rgb::grey(0.143), Rgb::grey(3.983)).r;
        let exact = ((0.143_f32 - 1.0).powi(2) + 3.983_f32.powi(2)) / ((0.143_f32 + 1.0).powi(2) + 3.983_f32.powi(2));
        assert!((gold - exact).abs() < 1e-6);
        // Grazing incidence reflects all; so does the inside beyond the critical angle, asin(1/1.5) = 41.81°.
        assert!((dielectric(0.0_f32, 1.5).0 - 1.0).abs() < 1e-6);
        assert_eq!(dielectric(41.9_f32.to_radians().cos(), 1.0 / 1.5), (1.0, 0.0));
        assert!(dielectric(41.7_f32.to_radians().cos(), 1.0 / 1.5).0 < 1.0);
        // At Brewster's angle, atan 1.5, only the perpendicular half is left: ((1−η²)/(1+η²))²/2.
        let brewster = dielectric(1.5_f32.atan().cos(), 1.5).0;
        assert!((brewster - (1.25_f32 / 3.25).powi(2) / 2.0).abs() < 1e-6);
        // A conductor without absorption is a dielectric.
        for cos in [0.1_f32, 0.5, 0.9] {
            assert!((conductor(cos, Rgb::grey(1.5), Rgb::grey(0.0)).g - dielectric(cos, 1.5).0).abs() < 1e-5);
        }
    }

    #[test]
    fn refraction_obeys_snell() {
        for (angle, eta) in [(0.3_f32, 1.5_f32), (1.2, 1.33), (0.4, 1.0 / 1.5)] {
            let w = vec3(angle.sin(), 0.0, angle.cos());
            let (_, cos_t) = dielectric(w.z, eta);
            let r = refract_z(w, cos_t, eta);
            assert!((r.length() - 1.0).abs() < 1e-6 && r.z < 0.0);
            assert!((r.x * eta + angle.sin()).abs() < 1e-6, "sinθ = η sinθ'");
            assert!((refract(w, Vec3::splat([0.0, 0.0, 1.0]), w.z, cos_t, eta) - r).length() < 1e-6);
        }
    }
}
