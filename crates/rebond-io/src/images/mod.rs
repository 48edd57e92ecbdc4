//! Image files: bytes in, linear values out, and back.
//!
//! | format | written | read |
//! |---|---|---|
//! | OpenEXR | every layer, 32-bit float, lossless | every layer of every part |
//! | Radiance HDR | the picture, 8 bits and a shared exponent | the same |
//! | PFM | the picture, 32-bit float, colour or grey | either byte order |
//! | PNG | the picture, exposed, tone-mapped, 8-bit sRGB | 8 and 16 bits, grey or colour, with or without alpha |
//! | JPEG | no | grey or colour |
//! | TGA | no | 8 bits, grey or colour, with or without alpha, packed or not |
//!
//! An image unpacks to at most 2²⁶ numbers, or 64 for each byte of its file if that is more: what claims to be larger is refused
//! before any memory is taken for it.

mod exr;
mod hdr;
mod pfm;
mod standard;

use crate::error::Error;
use rebond::film::{Channel, Image, Layer};
use std::path::Path;
use std::str::FromStr;

pub use standard::{PngOptions, Tonemap, srgb_decode, srgb_encode};

/// A kind of image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImageFormat {
    /// OpenEXR.
    Exr,
    /// Radiance RGBE.
    Hdr,
    /// Portable float map.
    Pfm,
    /// Portable network graphics.
    Png,
    /// JPEG; read only.
    Jpeg,
    /// Truevision TGA; read only, and known by its name.
    Tga,
}

impl ImageFormat {
    /// The format that a file's name asks for by its extension.
    pub fn of_name(name: &str) -> Result<Self, Error> {
        let extension = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        extension.parse().map_err(|e: Error| e.with_file(name))
    }

    /// The format that a file's first bytes show.
    fn of_bytes(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x76, 0x2f, 0x31, 0x01, ..] => Some(Self::Exr),
            [b'#', b'?', ..] => Some(Self::Hdr),
            [b'P', b'F' | b'f', space, ..] if space.is_ascii_whitespace() => Some(Self::Pfm),
            [0x89, b'P', b'N', b'G', ..] => Some(Self::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Self::Jpeg),
            _ => None,
        }
    }

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "OpenEXR",
            Self::Hdr => "Radiance HDR",
            Self::Pfm => "PFM",
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tga => "TGA",
        }
    }
}

impl FromStr for ImageFormat {
    type Err = Error;

    /// From an extension such as `exr`.
    fn from_str(extension: &str) -> Result<Self, Error> {
        match extension.to_ascii_lowercase().as_str() {
            "exr" => Ok(Self::Exr),
            "hdr" | "pic" => Ok(Self::Hdr),
            "pfm" => Ok(Self::Pfm),
            "png" => Ok(Self::Png),
            "jpg" | "jpeg" => Ok(Self::Jpeg),
            "tga" => Ok(Self::Tga),
            "" => Err(Error::new("no image format: the name has no extension")),
            other => Err(Error::new(format!("unknown image format \"{other}\""))),
        }
        .map_err(|e| e.with_help("valid extensions: exr, hdr, pfm, png (and to read: jpg, tga)"))
    }
}

/// Reads an image; colours stored as sRGB (PNG, JPEG) become linear. `name` is what errors call it.
///
/// The format is known by the content; the extension of `name` only serves the error if it is not.
pub fn read_image(bytes: &[u8], name: &str) -> Result<Image, Error> {
    read(bytes, name, false)
}

/// Reads an image whose numbers are not colours (a bump map, say): PNG and JPEG values are only scaled to 0…1.
pub fn read_image_raw(bytes: &[u8], name: &str) -> Result<Image, Error> {
    read(bytes, name, true)
}

fn read(bytes: &[u8], name: &str, raw: bool) -> Result<Image, Error> {
    // A TGA file begins with nothing of its own.
    let tga = || ImageFormat::of_name(name).ok().filter(|f| *f == ImageFormat::Tga);
    let Some(format) = ImageFormat::of_bytes(bytes).or_else(tga) else {
        let message = match ImageFormat::of_name(name) {
            Ok(format) => {
                let article = if format.name().starts_with('O') { "an" } else { "a" };
                format!("not {article} {} image, nor any other known one", format.name())
            }
            Err(_) => "not an image of a known format".to_string(),
        };
        let error = Error::new(message).with_help("readable are OpenEXR, Radiance HDR, PFM, PNG, JPEG and TGA");
        return Err(error.with_file(name));
    };
    let image = match format {
        ImageFormat::Exr => exr::read(bytes),
        ImageFormat::Hdr => hdr::read(bytes),
        ImageFormat::Pfm => pfm::read(bytes),
        ImageFormat::Png => standard::read(bytes, ::image::ImageFormat::Png, raw),
        ImageFormat::Jpeg => standard::read(bytes, ::image::ImageFormat::Jpeg, raw),
        ImageFormat::Tga => standard::read(bytes, ::image::ImageFormat::Tga, raw),
    };
    image.map_err(|problem| Error::new(format!("not a valid {} image: {problem}", format.name())).with_file(name))
}

/// Writes an image. Every format but OpenEXR holds the picture only; only PNG heeds the options.
pub fn write_image(image: &Image, format: ImageFormat, options: &PngOptions) -> Result<Vec<u8>, Error> {
    let (width, height) = (image.width, image.height);
    let count = width as usize * height as usize;
    if count == 0 {
        return Err(Error::new(format!("an image of {width}×{height} pixels cannot be written")));
    }
    let mut channels = image.layers.iter().flat_map(|l| &l.channels);
    if let Some(channel) = channels.find(|c| c.data.len() != count) {
        let (name, len) = (&channel.name, channel.data.len());
        return Err(Error::new(format!("the channel {name} has {len} values for {width}×{height} pixels")));
    }
    let written = match format {
        ImageFormat::Exr => exr::write(image),
        ImageFormat::Hdr => picture(image).and_then(|pixels| hdr::write(width, height, &pixels)),
        ImageFormat::Pfm => match image.layer("").map(|l| &l.channels[..]) {
            Some([grey]) => Ok(pfm::write_grey(width, height, &grey.data)),
            _ => picture(image).map(|pixels| pfm::write_colour(width, height, &pixels)),
        },
        ImageFormat::Png => picture(image).and_then(|pixels| standard::write_png(width, height, &pixels, options)),
        ImageFormat::Jpeg | ImageFormat::Tga => Err(format!("{} is only read, never written", format.name())),
    };
    written.map_err(|problem| Error::new(format!("cannot write a {} image: {problem}", format.name())))
}

/// The picture's colours.
fn picture(image: &Image) -> Result<Vec<[f32; 3]>, String> {
    image.rgb("").ok_or_else(|| "there is no layer of colours".to_string())
}

/// Values that any file may unpack to, a picture of 4096² in colour and alpha; and, if more, values per byte of the file. Deflate could
/// reach thousands of them, but only for a picture that is empty.
const ALWAYS: usize = 1 << 26;
const MAX_VALUES_PER_BYTE: usize = 64;

/// Checks a size told by a file's header before any memory is taken for it.
fn check_size(width: usize, height: usize, channels: usize, bytes: &[u8]) -> Result<usize, String> {
    if width == 0 || height == 0 {
        return Err(format!("its size is {width}×{height} pixels"));
    }
    let values = width.checked_mul(height).and_then(|n| n.checked_mul(channels.max(1)));
    let most = bytes.len().saturating_mul(MAX_VALUES_PER_BYTE).clamp(ALWAYS, 1 << 31);
    match values {
        Some(n) if n <= most && width <= 1 << 20 && height <= 1 << 20 => Ok(width * height),
        _ => Err(format!("its size of {width}×{height} pixels is too large for a file of {} bytes", bytes.len())),
    }
}

/// One layer, the picture, from values that take turns.
fn from_interleaved(width: u32, height: u32, names: &[&str], values: &[f32]) -> Image {
    let channel = |(i, name): (usize, &&str)| Channel {
        name: name.to_string(),
        data: values.iter().skip(i).step_by(names.len()).copied().collect(),
    };
    let channels = names.iter().enumerate().map(channel).collect();
    Image { width, height, layers: vec![Layer { name: String::new(), channels }] }
}

#[cfg(test)]
mod tests;
