//! A pane of smooth glass, too thin to shift what is seen through it. `p[0]` is the index of the inside over the outside;
//! `color` tints.
//!
//! Light bounces between the two faces, each of reflectance R, and leaves on either side:
//!
//! ```text
//! R' = R + (1−R)² R / (1−R²) = 2R / (1+R),    T' = 1 − R'
//! ```
//!
//! (Stokes 1862; Pharr, Jakob, Humphreys 2023, §9.5.1). Its direction does not change on the way through, and no radiance
//! is squeezed.

use super::{BsdfSample, Lobe, fresnel, reflect};
use crate::math::{Rgb, Vec3, vec3};
use crate::sampling::PdfSolidAngle;
use rebond_lanes::{Mask, Real};

#[inline(always)]
pub fn sample<F: Real>(lobe: &Lobe<F>, a: Vec3<F>, choice: F) -> BsdfSample<F> {
    let (face, _) = fresnel::dielectric(a.z.abs(), lobe.p[0]);
    let reflectance = face * 2.0 / (face + 1.0);
    let reflects = choice.lt(reflectance);
    let mirrored = reflect(a);
    let w = Vec3::select(reflects, vec3(mirrored.x, mirrored.y, a.z), -a);
    let pdf = F::select(reflects, reflectance, F::one() - reflectance);
    BsdfSample {
        w,
        weight: Rgb::select(pdf.gt(F::zero()), lobe.color, Rgb::black()),
        pdf: PdfSolidAngle(pdf),
        specular: F::Mask::splat(true),
        eta: F::one(),
    }
}
