//! Radiance HDR: three 8-bit mantissas and a shared exponent. Ward, "Real Pixels", Graphics Gems II (1991).

use super::{check_size, from_interleaved};
use image::codecs::hdr::{HdrDecoder, HdrEncoder};
use image::{ImageDecoder, Rgb};
use rebond::film::Image;

pub(super) fn read(bytes: &[u8]) -> Result<Image, String> {
    // Not strict, since the signature of many files is `#?RGBE`.
    let decoder = HdrDecoder::new_nonstrict(bytes).map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let count = check_size(width as usize, height as usize, 3, bytes)?;
    let mut data = vec![0; count * 12];
    decoder.read_image(&mut data).map_err(|e| e.to_string())?;
    let values: Vec<f32> = data.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(from_interleaved(width, height, &["R", "G", "B"], &values))
}

pub(super) fn write(width: u32, height: u32, pixels: &[[f32; 3]]) -> Result<Vec<u8>, String> {
    let pixels: Vec<_> = pixels.iter().map(|&p| Rgb(nearest(p))).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&pixels, width as usize, height as usize).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// The nearest colour the format holds: the encoder itself rounds down, which darkens pictures by up to 0.4 %.
fn nearest(colour: [f32; 3]) -> [f32; 3] {
    // Mantissas up to 255/256 and exponents from -127 to 127; NaN counts as black.
    let colour = colour.map(|v| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.69e38) });
    let most = colour[0].max(colour[1]).max(colour[2]);
    if most < 1e-36 {
        return [0.0; 3];
    }
    // The least power of two above the largest component, from the bits of that normal number.
    let unit = |v: f32| f32::from_bits((v.to_bits() & 0x7f80_0000) + (1 << 23)) / 256.0;
    let step = unit(most);
    // Rounding may reach the next power of two, where steps are twice as wide.
    let step = unit((most / step).round() * step);
    colour.map(|v| (v / step).round() * step)
}
