//! Isotropic materials over the angles of Rusinkiewicz (1998), as the MERL database tabulates them (Matusik et al. 2003).
//!
//! θh is the angle of the half vector from the normal, θd that of the light from the half vector, φd the light's angle
//! about it, from the plane of normal and half vector. Both directions being interchangeable, φd has a period of 180°.
//! Sample k of n stands for
//!
//! ```text
//! θh in [k², (k+1)²] · 90°/n²,    θd in [k, k+1] · 90°/n,    φd in [k, k+1] · 180°/n
//! ```
//!
//! so values are interpolated linearly between the middles of those, in √θh, θd and φd: in the middles they are what a
//! look-up of the nearest gives. A negative value was not measured. It is taken from the nearest θd below that was, at the
//! same θh and φd; where there is none, from the nearest above; where there is none at all it is 0.
//!
//! In memory a value takes 16 bytes, of which the colour fills 12: 23 MB for the 90 × 90 × 180 of the database.

use super::{Between, Tables, turn};
use crate::math::{Rgb, Vec3, vec3};
use rebond_lanes::{Real, Record, math};
use std::f32::consts::FRAC_1_PI;

/// The table.
#[derive(Clone, Debug, PartialEq)]
pub struct HalfDifferenceTable {
    size: [u32; 3],
    values: Vec<[f32; 3]>,
    missing: usize,
}

impl HalfDifferenceTable {
    /// A table of so many θh, θd and φd; the values with φd varying fastest, in sr⁻¹, negative where they are missing.
    ///
    /// # Errors
    /// If the size is not that of the values, or one of them is not finite.
    pub fn new(size: [u32; 3], mut values: Vec<[f32; 3]>) -> Result<Self, String> {
        let count = size.iter().try_fold(1_u64, |product, n| product.checked_mul(u64::from(*n)));
        if count != Some(values.len() as u64) || values.is_empty() || values.len() > 1 << 28 {
            return Err(format!("{} values for {}", values.len(), size.map(|n| n.to_string()).join(" × ")));
        }
        if let Some(i) = values.as_flattened().iter().position(|x| !x.is_finite()) {
            return Err(format!("value {i} is {}; values are finite", values.as_flattened()[i]));
        }
        let measured: Vec<bool> = values.iter().map(|v| v.iter().all(|x| *x >= 0.0)).collect();
        let [_, rows, columns] = size.map(|n| n as usize);
        for first in (0..size[0] as usize).flat_map(|slice| (0..columns).map(move |c| slice * rows * columns + c)) {
            let column = || (0..rows).map(move |row| first + row * columns);
            let mut nearest = column().find(|i| measured[*i]).map_or([0.0; 3], |i| values[i]);
            for i in column() {
                if measured[i] {
                    nearest = values[i];
                } else {
                    values[i] = nearest;
                }
            }
        }
        Ok(Self { size, missing: measured.iter().filter(|known| !**known).count(), values })
    }

    /// Samples along θh, θd and φd.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// The values, φd varying fastest.
    pub fn values(&self) -> &[[f32; 3]] {
        &self.values
    }

    /// How many values were missing.
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// Bytes of its numbers.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.values)
    }

    pub(super) fn store(&self, heads: &mut Vec<Record>, values: &mut Vec<Record>) {
        let [h, d, p] = self.size;
        heads.push(Record::words([h, d, p, 0]));
        values.extend(self.values.iter().map(|v| Record([v[0], v[1], v[2], 0.0])));
    }
}

#[inline(always)]
pub(super) fn f<F: Real>(tables: &Tables, table: F::Index, light: Vec3<F>, viewer: Vec3<F>) -> Rgb<F> {
    let [start, ..] = tables.head::<F>(table, 0);
    let [rows, columns, depth, _] = tables.head::<F>(table, 1);
    let h = (light + viewer).normalized();
    let sin = (h.x * h.x + h.y * h.y).sqrt();
    let theta_h = math::atan2(sin, h.z) * (2.0 * FRAC_1_PI);
    // About the normal the half vector has no azimuth.
    let inverse = F::select(sin.gt(F::zero()), sin.recip(), F::zero());
    let (cos_phi, sin_phi) = (F::select(sin.gt(F::zero()), h.x * inverse, F::one()), h.y * inverse);
    // The light in the frame of the half vector.
    let x = (light.x * cos_phi + light.y * sin_phi) * h.z - light.z * sin;
    let y = light.y * cos_phi - light.x * sin_phi;
    let difference = vec3(x, y, light.dot(h));
    let theta_d = math::atan2((x * x + y * y).sqrt(), difference.z) * (2.0 * FRAC_1_PI);
    let a = Between::clamped(theta_h.sqrt() * F::from_index(rows) - 0.5, rows);
    let b = Between::clamped(theta_d * F::from_index(columns) - 0.5, columns);
    let half_step = F::splat(0.5) / F::from_index(depth);
    let c = Between::around(turn(difference) * 2.0 - half_step, depth);
    let mut sum = Rgb::black();
    for i in [0, 1] {
        for j in [0, 1] {
            let row = (a.at[i] * columns + b.at[j]) * depth + start;
            let weight = a.weight[i] * b.weight[j];
            for k in [0, 1] {
                sum += Rgb::of_record(F::record(&tables.values, row + c.at[k])) * (weight * c.weight[k]);
            }
        }
    }
    sum
}
