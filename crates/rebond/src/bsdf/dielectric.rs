//! Smooth glass: reflection and refraction by Fresnel's equations. `p[0]` is the index of the inside (below z) over
//! the outside; `color` tints both.

use super::{BsdfSample, Lobe, TransportMode, fresnel, reflect};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::PdfSolidAngle;
use rebond_lanes::{Mask, Real};

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, choice: F, mode: TransportMode) -> BsdfSample<F> {
    let outside = a.z.gt(F::zero());
    let eta = F::select(outside, lobe.p[0], lobe.p[0].recip());
    let above = vec3(a.x, a.y, a.z.abs());
    let (reflectance, cos_t) = fresnel::dielectric(above.z, eta);
    let reflects = choice.lt(reflectance);
    let refracted = fresnel::refract_z(above, cos_t, eta);
    let w = Vec3::select(reflects, reflect(above), refracted);
    // Radiance is squeezed into a smaller or larger cone; power is not.
    let squeeze = match mode {
        TransportMode::Radiance => (eta * eta).recip(),
        TransportMode::Importance => F::one(),
    };
    BsdfSample {
        w: vec3(w.x, w.y, F::select(outside, w.z, -w.z)),
        weight: lobe.color * F::select(reflects, F::one(), squeeze),
        pdf: PdfSolidAngle(F::select(reflects, reflectance, F::one() - reflectance)),
        specular: F::Mask::splat(true),
        eta: F::select(reflects, F::one(), eta),
    }
    .checked()
}

impl<F: Real> BsdfSample<F> {
    /// Black where the branch had no chance.
    #[inline(always)]
    fn checked(mut self) -> Self {
        self.weight = Rgb::select(self.pdf.0.gt(F::zero()), self.weight, Rgb::black());
        self
    }
}
