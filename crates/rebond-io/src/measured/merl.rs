//! MERL's `.binary` (Matusik et al. 2003): three 32-bit numbers of samples along θh, θd and φd, 90 × 90 × 180 in the
//! database, then all red values, all green and all blue ones as f64, φd varying fastest, little-endian; to be multiplied
//! by 1/1500, 1.15/1500 and 1.66/1500.

use rebond::bsdf::measured::HalfDifferenceTable;

const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

pub(super) fn read(bytes: &[u8]) -> Result<HalfDifferenceTable, String> {
    let Some((header, data)) = bytes.split_at_checked(12) else {
        return Err(format!("its header has 12 bytes, the file {}", bytes.len()));
    };
    let size: Vec<u32> = header.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    let size = [size[0], size[1], size[2]];
    let [h, d, p] = size;
    let count = u64::from(h) * u64::from(d);
    let wanted = count.checked_mul(u64::from(p)).and_then(|n| n.checked_mul(24)).filter(|n| *n > 0);
    if wanted != Some(data.len() as u64) {
        let wanted = wanted.map_or("no file".into(), |n| format!("a file of {} bytes", u128::from(n) + 12));
        return Err(format!("{h} × {d} × {p} values want {wanted}, it has {}; is it whole?", bytes.len()));
    }
    let numbers = data.as_chunks::<8>().0;
    let n = numbers.len() / 3;
    let value = |i: usize| std::array::from_fn(|c| (f64::from_le_bytes(numbers[c * n + i]) * SCALE[c]) as f32);
    HalfDifferenceTable::new(size, (0..n).map(value).collect())
}
