//! The lecture's table `f_r[θi][φi][θo][φo][colour]`, linearly interpolated along its four angles.
//!
//! Sample k of n stands at `θ = k · 90°/n` and `φ = k · 360°/n`. Angles about the normal are periodic; beyond the last θ,
//! which is short of 90°, values stay as they are there. A single φi says that the material is isotropic: φo then counts
//! from φi.
//!
//! In memory a value takes 16 bytes, of which the colour fills 12.

use super::{Between, Tables, check_values, tilt, turn};
use crate::math::{Rgb, Vec3};
use rebond_lanes::{Index, Mask, Real, Record};

/// The table; i is the light's side, o the viewer's.
#[derive(Clone, Debug, PartialEq)]
pub struct AngleTable {
    size: [u32; 4],
    values: Vec<[f32; 3]>,
}

/// Values that a table may have.
const MOST_VALUES: u64 = 1 << 28;

impl AngleTable {
    /// How many values a table of so many θi, φi, θo and φo has.
    ///
    /// # Errors
    /// If an axis is empty, or there are more than 2²⁸ values.
    pub fn count(size: [u32; 4]) -> Result<usize, String> {
        let names = ["θi", "φi", "θo", "φo"];
        if let Some((name, _)) = names.iter().zip(size).find(|(_, n)| *n == 0) {
            return Err(format!("there are no samples along {name}"));
        }
        let count = size.iter().try_fold(1_u64, |product, n| product.checked_mul(u64::from(*n)));
        match count {
            Some(n) if n <= MOST_VALUES => Ok(n as usize),
            _ => Err(format!("{} values are more than 2^28", size.map(|n| n.to_string()).join(" × "))),
        }
    }

    /// A table of so many θi, φi, θo and φo; the values with φo varying fastest, in sr⁻¹.
    ///
    /// # Errors
    /// If the size is not that of the values, or one of them is negative or not finite.
    pub fn new(size: [u32; 4], values: Vec<[f32; 3]>) -> Result<Self, String> {
        let count = Self::count(size)?;
        if values.len() != count {
            return Err(format!("{} values where {count} are wanted", values.len()));
        }
        check_values("the table", values.as_flattened())?;
        Ok(Self { size, values })
    }

    /// Samples along θi, φi, θo and φo.
    pub fn size(&self) -> [u32; 4] {
        self.size
    }

    /// The values, φo varying fastest.
    pub fn values(&self) -> &[[f32; 3]] {
        &self.values
    }

    /// Whether φo counts from φi.
    pub fn is_isotropic(&self) -> bool {
        self.size[1] == 1
    }

    /// Bytes of its numbers.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.values)
    }

    pub(super) fn store(&self, heads: &mut Vec<Record>, values: &mut Vec<Record>) {
        heads.push(Record::words(self.size));
        values.extend(self.values.iter().map(|v| Record([v[0], v[1], v[2], 0.0])));
    }
}

#[inline(always)]
pub(super) fn f<F: Real>(tables: &Tables, table: F::Index, light: Vec3<F>, viewer: Vec3<F>) -> Rgb<F> {
    let [start, _, isotropic, _] = tables.head::<F>(table, 0);
    let size = tables.head::<F>(table, 1);
    let isotropic = isotropic.ne(F::Index::splat(0));
    let (phi_i, phi_o) = (turn(light), turn(viewer));
    let axes = [
        Between::clamped(tilt(light) * F::from_index(size[0]), size[0]),
        Between::around(phi_i, size[1]),
        Between::clamped(tilt(viewer) * F::from_index(size[2]), size[2]),
        Between::around(F::select(isotropic, phi_o - phi_i, phi_o), size[3]),
    ];
    // With one φi its neighbour is itself.
    let turned: &[usize] = if isotropic.all() { &[0] } else { &[0, 1] };
    let second = F::select(isotropic, F::zero(), axes[1].weight[1]);
    let turn_weight = [F::one() - second, second];
    let mut sum = Rgb::black();
    for i in [0, 1] {
        for &j in turned {
            let row = axes[0].at[i] * size[1] + axes[1].at[j];
            let weight = axes[0].weight[i] * turn_weight[j];
            for k in [0, 1] {
                let row = (row * size[2] + axes[2].at[k]) * size[3] + start;
                let weight = weight * axes[2].weight[k];
                for l in [0, 1] {
                    let value = F::record(&tables.values, row + axes[3].at[l]);
                    sum += Rgb::of_record(value) * (weight * axes[3].weight[l]);
                }
            }
        }
    }
    sum
}
