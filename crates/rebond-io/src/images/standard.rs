//! PNG and JPEG: 8- or 16-bit sRGB.

use super::{check_size, from_interleaved};
use crate::error::Error;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use rebond::film::Image;
use std::io::Cursor;
use std::str::FromStr;

/// How linear values become a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PngOptions {
    /// Stops: the picture is first multiplied by 2 to this power.
    pub exposure: f32,
    /// The curve that brings what is too bright into range.
    pub tonemap: Tonemap,
}

/// A curve from radiance to 0…1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tonemap {
    /// Everything above 1 is cut off.
    #[default]
    None,
    /// $L/(1+L)$ of the luminance. Reinhard, Stark, Shirley, Ferwerda, "Photographic Tone Reproduction for Digital
    /// Images" (2002), eq. 3.
    Reinhard,
    /// A filmic curve per channel. Narkowicz, "ACES Filmic Tone Mapping Curve" (2015): a rational fit of the ACES
    /// reference and output transforms.
    Aces,
}

impl FromStr for Tonemap {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        match name {
            "none" => Ok(Self::None),
            "reinhard" => Ok(Self::Reinhard),
            "aces" => Ok(Self::Aces),
            _ => Err(Error::new(format!("unknown tone map \"{name}\"")).with_help("valid: none, reinhard, aces")),
        }
    }
}

impl Tonemap {
    /// The mapped colour; not yet cut to 0…1.
    pub fn apply(self, colour: [f32; 3]) -> [f32; 3] {
        match self {
            Self::None => colour,
            Self::Reinhard => {
                let [r, g, b] = colour;
                let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
                colour.map(|v| v / (1.0 + luminance.max(0.0)))
            }
            Self::Aces => colour.map(|v| {
                // The curve's limit is reached long before the products overflow.
                let v = v.clamp(0.0, 1e6);
                v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14)
            }),
        }
    }
}

/// From linear 0…1 to sRGB 0…1 (IEC 61966-2-1).
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// From sRGB 0…1 to linear 0…1 (IEC 61966-2-1).
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

pub(super) fn read(bytes: &[u8], format: ImageFormat, raw: bool) -> Result<Image, String> {
    let decoder = ImageReader::with_format(Cursor::new(bytes), format).into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    check_size(width as usize, height as usize, decoder.color_type().channel_count() as usize, bytes)?;
    let image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    let colour = image.color();
    let names: &[&str] = match (colour.has_color(), colour.has_alpha()) {
        (true, true) => &["R", "G", "B", "A"],
        (true, false) => &["R", "G", "B"],
        // Grey with alpha is spread to colour, so that the picture can still be told from its alpha.
        (false, true) => &["R", "G", "B", "A"],
        (false, false) => &["Y"],
    };
    let mut values: Vec<f32> = match names.len() {
        1 => image.into_luma16().iter().map(|&v| f32::from(v) / 65535.0).collect(),
        3 => image.into_rgb32f().into_vec(),
        _ => image.into_rgba32f().into_vec(),
    };
    if !raw {
        for (i, value) in values.iter_mut().enumerate() {
            if i % names.len() < 3 {
                *value = srgb_decode(*value);
            }
        }
    }
    Ok(from_interleaved(width, height, names, &values))
}

pub(super) fn write_png(width: u32, height: u32, pixels: &[[f32; 3]], options: &PngOptions) -> Result<Vec<u8>, String> {
    let gain = options.exposure.exp2();
    let pixel = |p: &[f32; 3]| {
        // `as` turns NaN into 0.
        let mapped = options.tonemap.apply(p.map(|v| v * gain));
        mapped.map(|v| (srgb_encode(v.clamp(0.0, 1.0)) * 255.0).round() as u8)
    };
    let data: Vec<u8> = pixels.iter().flat_map(pixel).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|e| e.to_string())?;
    writer.write_image_data(&data).map_err(|e| e.to_string())?;
    writer.finish().map_err(|e| e.to_string())?;
    Ok(bytes)
}
