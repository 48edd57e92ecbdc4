//! PFM: a text header, then rows of 32-bit floats from the bottom up.
//! Debevec, "Portable Float Map format", <https://www.pauldebevec.com/Research/HDR/PFM/>.

use super::{check_size, from_interleaved};
use rebond::film::Image;

pub(super) fn read(bytes: &[u8]) -> Result<Image, String> {
    let mut rest = bytes;
    let mut word = |what: &str| {
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let length = rest[start..].iter().take(64).position(|b| b.is_ascii_whitespace());
        let length = length.ok_or_else(|| format!("its header has no {what}"))?;
        let word = String::from_utf8_lossy(&rest[start..start + length]);
        // One white space ends the word; after the last word the data begins.
        rest = &rest[start + length + 1..];
        Ok::<_, String>(word)
    };
    let names: &[&str] = match &*word("kind")? {
        "PF" => &["R", "G", "B"],
        _ => &["Y"],
    };
    let size = |word: &str| word.parse::<u32>().map_err(|_| format!("\"{word}\" is not a size"));
    let (width, height) = (size(&word("width")?)?, size(&word("height")?)?);
    let scale = word("scale")?;
    let scale: f32 = scale.parse().map_err(|_| format!("\"{scale}\" is not a scale"))?;
    if scale == 0.0 || !scale.is_finite() {
        return Err(format!("its scale is {scale}"));
    }
    let row = width as usize * names.len();
    let size = check_size(width as usize, height as usize, names.len(), bytes)? * names.len() * 4;
    if rest.len() < size {
        return Err(format!("it ends after {} of {size} bytes of pixels", rest.len()));
    }
    let value = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        // The scale's sign is the byte order, its size the unit.
        scale.abs() * if scale < 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    let values: Vec<f32> =
        rest[..size].chunks_exact(row * 4).rev().flat_map(|r| r.chunks_exact(4).map(value)).collect();
    Ok(from_interleaved(width, height, names, &values))
}

pub(super) fn write_colour(width: u32, height: u32, pixels: &[[f32; 3]]) -> Vec<u8> {
    write("PF", width, height, pixels.as_flattened())
}

pub(super) fn write_grey(width: u32, height: u32, values: &[f32]) -> Vec<u8> {
    write("Pf", width, height, values)
}

fn write(kind: &str, width: u32, height: u32, values: &[f32]) -> Vec<u8> {
    let mut bytes = format!("{kind}\n{width} {height}\n-1.0\n").into_bytes();
    for row in values.chunks_exact(values.len() / height as usize).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}
