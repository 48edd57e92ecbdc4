//! RGL's `.bsdf` (Dupuy and Jakob 2018): a file of named tensors.
//!
//! ```text
//! "tensor_file\0"   version: two bytes, 1 and 0   number of fields: u32
//! each field:       length of its name: u16   name   dimensions: u16   type: u8   place in the file: u64   shape: u64 each
//! ```
//!
//! Little-endian; types are u8 = 1 and f32 = 10 where they matter here. The fields are
//!
//! | name | shape | |
//! |---|---|---|
//! | `theta_i`, `phi_i` | θ; φ | directions that were measured, radians |
//! | `ndf` | y, x | normals |
//! | `sigma` | y, x | their projected area |
//! | `vndf` | φ, θ, y, x | visible normals |
//! | `rgb` | φ, θ, 3, y, x | values, linear Rec. 709 |
//! | `spectra`, `wavelengths` | φ, θ, λ, y, x; λ | values in place of `rgb`; nm |
//! | `luminance` | φ, θ, y, x | not needed: directions are drawn from what `rgb` says |
//! | `jacobian` | 1 | whether values are to be multiplied by `ndf / 4 sigma` |
//! | `description` | n | words |
//!
//! Colours out of gamut are cut off at 0.

use super::spectrum;
use rebond::bsdf::measured::{AdaptiveTable, Grid2};
use std::collections::BTreeMap;

pub(super) const MAGIC: &[u8] = b"tensor_file\0";

struct Field<'a> {
    kind: u8,
    shape: Vec<usize>,
    data: &'a [u8],
}

/// The bytes that are left.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.0.split_at_checked(n).ok_or("it ends within its header")?;
        self.0 = rest;
        Ok(taken)
    }
    fn number(&mut self, bytes: usize) -> Result<u64, String> {
        let mut number = [0; 8];
        number[..bytes].copy_from_slice(self.take(bytes)?);
        Ok(u64::from_le_bytes(number))
    }
}

const U8: u8 = 1;
const F32: u8 = 10;

/// Bytes of a number of each type.
const WIDTHS: [usize; 12] = [0, 1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8];

fn fields(bytes: &[u8]) -> Result<BTreeMap<String, Field<'_>>, String> {
    let mut rest = Rest(&bytes[MAGIC.len()..]);
    let version = rest.take(2)?;
    if version != [1, 0] {
        return Err(format!("it is of version {}.{}; 1.0 is read", version[0], version[1]));
    }
    let count = rest.number(4)?;
    let mut fields = BTreeMap::new();
    for _ in 0..count {
        let length = rest.number(2)? as usize;
        let name = String::from_utf8_lossy(rest.take(length)?).into_owned();
        let dimensions = rest.number(2)?;
        let kind = rest.number(1)? as u8;
        let place = rest.number(8)?;
        let shape = (0..dimensions).map(|_| rest.number(8)).collect::<Result<Vec<u64>, _>>()?;
        let width = WIDTHS.get(usize::from(kind)).filter(|w| **w > 0);
        let width = *width.ok_or_else(|| format!("its field `{name}` is of the unknown type {kind}"))?;
        let size = shape.iter().try_fold(width as u64, |product, n| product.checked_mul(*n));
        let end = size.and_then(|s| s.checked_add(place)).filter(|end| *end <= bytes.len() as u64);
        let Some(end) = end else {
            let (shape, all) = (format!("{shape:?}"), bytes.len());
            return Err(format!(
                "its field `{name}` of shape {shape} at {place} goes beyond its end at {all}; is it whole?"
            ));
        };
        let shape = shape.iter().map(|n| *n as usize).collect();
        let field = Field { kind, shape, data: &bytes[place as usize..end as usize] };
        if fields.insert(name.clone(), field).is_some() {
            return Err(format!("it has two fields `{name}`"));
        }
    }
    Ok(fields)
}

pub(super) fn read(bytes: &[u8]) -> Result<AdaptiveTable, String> {
    let fields = fields(bytes)?;
    let field = |name: &str, kind: u8, dimensions: usize| -> Result<&Field, String> {
        let field = fields.get(name).ok_or_else(|| {
            let names = fields.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            format!("it has no field `{name}`, only: {names}")
        })?;
        if field.kind != kind || field.shape.len() != dimensions {
            let (shape, kind) = (&field.shape, field.kind);
            return Err(format!(
                "its field `{name}` has type {kind} and shape {shape:?}, not {dimensions} dimensions of f32"
            ));
        }
        Ok(field)
    };
    let floats =
        |field: &Field| -> Vec<f32> { field.data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect() };
    let list = |name: &str| field(name, F32, 1).map(floats);
    let (theta, phi) = (list("theta_i")?, list("phi_i")?);
    let grid = |name: &str, dimensions: usize| -> Result<Grid2<f32>, String> {
        let field = field(name, F32, dimensions)?;
        let side = |i: usize| u32::try_from(field.shape[dimensions - i]).unwrap_or(u32::MAX);
        if dimensions == 4 {
            measured_directions(name, &field.shape, &phi, &theta)?;
        }
        Ok(Grid2 { size: [side(1), side(2)], values: floats(field) })
    };
    let (normals, area, visible) = (grid("ndf", 2)?, grid("sigma", 2)?, grid("vndf", 4)?);
    let (colors, name, weights) = if fields.contains_key("rgb") {
        (field("rgb", F32, 5)?, "rgb", vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    } else {
        let spectra = field("spectra", F32, 5).map_err(|e| format!("{e}; nor has it a field `rgb`"))?;
        let wavelengths = list("wavelengths")?;
        let finite = wavelengths.iter().all(|w| w.is_finite());
        if wavelengths.is_empty() || !finite || !wavelengths.windows(2).all(|w| w[0] < w[1]) {
            return Err("the wavelengths are not finite numbers that grow from one to the next".into());
        }
        (spectra, "spectra", spectrum::weights(&wavelengths))
    };
    measured_directions(name, &colors.shape, &phi, &theta)?;
    let [.., channels, rows, columns] = colors.shape[..] else { return Err(format!("`{name}` has no shape")) };
    if channels != weights.len() {
        return Err(format!("its field `{name}` has {channels} channels where {} are wanted", weights.len()));
    }
    let numbers = floats(colors);
    if let Some(i) = numbers.iter().position(|x| !x.is_finite()) {
        return Err(format!("value {i} of `{name}` is {}; values are finite", numbers[i]));
    }
    let too_large = || format!("its field `{name}` has the shape {:?}", colors.shape);
    let cells = rows.checked_mul(columns).ok_or_else(too_large)?;
    let color = numbers.chunks(channels.checked_mul(cells).ok_or_else(too_large)?.max(1)).flat_map(|grid| {
        let weights = &weights;
        (0..cells).map(move |cell| {
            let channel =
                |c: usize| weights.iter().enumerate().map(|(i, w)| w[c] * f64::from(grid[i * cells + cell])).sum();
            std::array::from_fn(|c| f64::max(channel(c), 0.0) as f32)
        })
    });
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let color = Grid2 { size: [side(columns), side(rows)], values: color.collect() };
    let jacobian = field("jacobian", U8, 1).map_err(|e| e.replace("f32", "u8"))?.data;
    let &[jacobian] = jacobian else { return Err("its field `jacobian` is not one number".into()) };
    AdaptiveTable::new(theta, phi, normals, area, visible, color, jacobian != 0)
}

/// The first two sides of a tensor are those of the directions.
fn measured_directions(name: &str, shape: &[usize], phi: &[f32], theta: &[f32]) -> Result<(), String> {
    if shape[..2] == [phi.len(), theta.len()] {
        return Ok(());
    }
    let (p, t) = (phi.len(), theta.len());
    Err(format!("its field `{name}` has the shape {shape:?} for {p} angles phi_i and {t} theta_i"))
}
