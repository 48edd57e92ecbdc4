//! What a material of a library becomes. Wavefront, "MTL material format" (Ramey, Rose, Tyerman 1995).
//!
//! ```text
//! illum 0, 1, 2  Kd/π, and with Ks a lobe of the half vector, (N·H)^Ns (energy-conserving; also without illum)
//! illum 3, 5, 8  Kd/π, and with Ks a mirror
//! illum 4, 9     a pane of glass of index Ni and colour Tf
//! illum 6, 7     glass of index Ni and colour Tf, which refracts
//! d, Tr, map_d   opacity d = 1 − Tr of what is no glass
//! ```
//!
//! A sum of two lobes is a mix: shares w = max Ks/(max Kd + max Ks) of Ks/w and 1 − w of Kd/(1 − w). What reflects more than
//! all is dimmed, with a warning. What is not given is black, or white under an image.

use super::library::{Line, Material};
use super::{Importer, two_sided};
use crate::error::Error;
use rebond::film::Image;
use rebond::scene::description::{
    Color, Distribution, ImageTexture, LobeForm, Masking, MaterialDescription, MaterialRef, Texture,
};
use rebond::texture::{Encoding, SAME_UV, TextureFilter, Wrap};

type Result<T> = std::result::Result<T, Error>;

/// What the lines of a material say.
#[derive(Default)]
struct Said {
    kd: Option<[f32; 3]>,
    ks: [f32; 3],
    ns: f32,
    tf: Option<([f32; 3], Line)>,
    ni: f32,
    illum: u32,
    opacity: Option<(f32, Line)>,
    map_kd: Option<ImageTexture>,
    map_d: Option<ImageTexture>,
}

fn largest(c: [f32; 3]) -> f32 {
    c.into_iter().fold(0.0, f32::max)
}

fn inline(material: MaterialDescription) -> MaterialRef {
    MaterialRef::Inline(Box::new(material))
}

impl Importer {
    /// What it emits.
    pub fn emission(&mut self, material: &Material) -> Result<Option<Color>> {
        let line = material.lines.iter().rfind(|l| l.key == "Ke");
        let Some((line, color)) = line.map(|l| l.color().map(|c| (l, c))).transpose()? else { return Ok(None) };
        if color == [0.0; 3] {
            return Ok(None);
        }
        if material.lines.iter().any(holes) {
            self.report.unsupported(line.error("light from a surface that is not opaque"))?;
            return Ok(None);
        }
        self.report.warn(line.error("it shines to the side of its normals only"));
        Ok(Some(Color(color)))
    }

    /// How it scatters light.
    pub fn describe(&mut self, material: &Material) -> Result<MaterialDescription> {
        let said = self.said(material)?;
        let glass = matches!(said.illum, 4 | 6 | 7 | 9);
        if let Some((tf, line)) = &said.tf
            && !glass
            && *tf != [1.0; 3]
            && *tf != [0.0; 3]
        {
            self.report.warn(line.error(format!("Tf means nothing to illum {}", said.illum)));
        }
        if glass {
            if let Some((_, line)) = said.opacity.as_ref().filter(|(d, _)| *d < 1.0) {
                self.report.warn(line.error("its opacity means nothing to glass"));
            }
            let tint = Texture::Constant(Color(said.tf.map_or([1.0; 3], |(tf, _)| tf)));
            return Ok(match said.illum {
                4 | 9 => MaterialDescription::ThinDielectric { int_ior: said.ni, ext_ior: 1.0, tint },
                _ => MaterialDescription::Dielectric {
                    int_ior: said.ni,
                    ext_ior: 1.0,
                    alpha: None,
                    alpha_u: None,
                    alpha_v: None,
                    distribution: Distribution::Ggx,
                    masking: Masking::Correlated,
                    tint,
                },
            });
        }
        let opacity = said.opacity.as_ref().map_or(1.0, |(d, _)| *d);
        let opacity = match &said.map_d {
            Some(map) => Some(Texture::Image(self.times(map, [opacity; 3])?)),
            None => (opacity < 1.0).then(|| Texture::grey(opacity)),
        };
        let opaque = self.opaque(material, said)?;
        Ok(match opacity {
            Some(opacity) => MaterialDescription::Mask { opacity, material: inline(opaque) },
            None => opaque,
        })
    }

    fn opaque(&mut self, material: &Material, said: Said) -> Result<MaterialDescription> {
        let mut kd = said.kd.unwrap_or(if said.map_kd.is_some() { [1.0; 3] } else { [0.0; 3] });
        let mut ks = if said.illum < 2 { [0.0; 3] } else { said.ks };
        let all = largest(std::array::from_fn(|c| kd[c] + ks[c]));
        if all > 1.0 {
            if let Some(line) = material.lines.iter().find(|l| matches!(&*l.key, "Kd" | "Ks")) {
                self.report.warn(line.error(format!("Kd and Ks reflect {all} of the light: dimmed to all of it")));
            }
            (kd, ks) = (kd.map(|x| x / all), ks.map(|x| x / all));
        }
        let diffuse = |me: &mut Self, kd: [f32; 3]| -> Result<MaterialDescription> {
            let reflectance = match &said.map_kd {
                Some(map) => Texture::Image(me.times(map, kd)?),
                None => Texture::Constant(Color(kd)),
            };
            Ok(MaterialDescription::Diffuse { reflectance })
        };
        if ks == [0.0; 3] {
            return Ok(two_sided(diffuse(self, kd)?));
        }
        // Shares by their largest; where colours differ, no part may reflect more than all.
        let w = largest(ks) / (largest(kd) + largest(ks));
        let reflectance = Texture::Constant(Color(ks.map(|x| (x / w).min(1.0))));
        let lobe = match said.illum {
            3 | 5 | 8 => MaterialDescription::Mirror { reflectance },
            _ => MaterialDescription::BlinnPhong { reflectance, exponent: said.ns, form: LobeForm::Energy },
        };
        if w >= 1.0 {
            return Ok(two_sided(lobe));
        }
        let base = diffuse(self, kd.map(|x| (x / (1.0 - w)).min(1.0)))?;
        Ok(two_sided(MaterialDescription::Mix { a: inline(base), b: inline(lobe), weight: w }))
    }

    fn said(&mut self, material: &Material) -> Result<Said> {
        let mut said = Said { ni: 1.0, illum: 2, ..Said::default() };
        for line in &material.lines {
            match &*line.key {
                "Kd" => said.kd = Some(self.reflectance(line)?),
                "Ks" => said.ks = self.reflectance(line)?,
                "Ns" => said.ns = line.number()?.max(0.0),
                "Ni" => said.ni = line.number()?,
                "Tf" => said.tf = Some((self.reflectance(line)?, line.clone())),
                "Ke" => {}
                "d" if line.words.first().is_some_and(|w| w == "-halo") => {
                    self.report.unsupported(line.error("an opacity that depends on the angle"))?;
                }
                "d" => said.opacity = Some((line.number()?.clamp(0.0, 1.0), line.clone())),
                "Tr" => said.opacity = Some((1.0 - line.number()?.clamp(0.0, 1.0), line.clone())),
                "illum" => {
                    let number = line.number()?;
                    if number.fract() == 0.0 && (0.0..=9.0).contains(&number) {
                        said.illum = number as u32;
                    } else {
                        self.report.unsupported(line.error(format!("illum {number}: there are 0 to 9")))?;
                    }
                }
                "map_Kd" => said.map_kd = self.map(line, Encoding::Auto)?,
                "map_d" => said.map_d = self.map(line, Encoding::Linear)?,
                "Ka" | "map_Ka" => {
                    if line.words.iter().any(|w| w.parse() != Ok(0.0_f32)) {
                        self.report.warn(line.error("ambient light is left out: light is traced"));
                    }
                }
                other => self.report.unsupported(line.error(format!("\"{other}\" is not supported")))?,
            }
        }
        Ok(said)
    }

    /// A colour within [0, 1].
    fn reflectance(&mut self, line: &Line) -> Result<[f32; 3]> {
        let color = line.color()?;
        if color.iter().any(|x| !(0.0..=1.0).contains(x)) {
            self.report.warn(line.error(format!("{} lies within [0, 1]: cut to that", line.key)));
        }
        Ok(color.map(|x| x.clamp(0.0, 1.0)))
    }

    /// An image with its options; none if it is left out.
    fn map(&mut self, line: &Line, encoding: Encoding) -> Result<Option<ImageTexture>> {
        let mut map = ImageTexture {
            image: String::new(),
            encoding,
            wrap: Wrap::Repeat,
            wrap_v: None,
            filter: TextureFilter::Bilinear,
            repeat: [1.0; 2],
            to_uv: None,
            channel: None,
        };
        let (mut scale, mut offset) = ([1.0; 2], [0.0; 2]);
        let mut words = &line.words[..];
        while let Some((option, rest)) = words.split_first().filter(|(w, _)| w.starts_with('-')) {
            // Up to three numbers follow these two, of which the third is for solid textures.
            let count = rest.iter().take(3).take_while(|w| w.parse::<f32>().is_ok()).count();
            let pair = |default: f32| -> Result<[f32; 2]> {
                let numbers = line.numbers(&rest[..count])?;
                Ok([0, 1].map(|i| numbers.get(i).copied().unwrap_or(default)))
            };
            let mut taken = 1;
            match &**option {
                "-s" => (scale, taken) = (pair(1.0)?, count),
                "-o" => (offset, taken) = (pair(0.0)?, count),
                "-clamp" => map.wrap = if rest.first().is_some_and(|w| w == "on") { Wrap::Clamp } else { Wrap::Repeat },
                other => {
                    self.report.unsupported(line.error(format!("the option {other} of an image")))?;
                    taken = if other == "-mm" { 2 } else { 1 };
                    taken = if matches!(other, "-t") { count } else { taken };
                }
            }
            words = &rest[taken.min(rest.len())..];
        }
        map.image = words.join(" ").replace('\\', "/");
        if map.image.is_empty() {
            return Err(line.error(format!("{} names no file", line.key)));
        }
        if let Err(message) = self.assets.path(&map.image) {
            self.report.unsupported(line.error(message))?;
            return Ok(None);
        }
        let to_uv = [[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]]];
        map.to_uv = (to_uv != SAME_UV).then_some(to_uv);
        Ok(Some(map))
    }

    /// An image times a colour.
    fn times(&mut self, map: &ImageTexture, factor: [f32; 3]) -> Result<ImageTexture> {
        if factor == [1.0; 3] {
            return Ok(map.clone());
        }
        let key = (map.image.clone(), map.encoding == Encoding::Linear, factor.map(f32::to_bits));
        if let Some(known) = self.tinted.get(&key) {
            return Ok(ImageTexture { image: known.clone(), encoding: Encoding::Linear, ..map.clone() });
        }
        let fail = |message: String| Error::new(message).with_file(&map.image);
        let bytes = self.assets.read(&map.image).map_err(fail)?;
        let read = match map.encoding {
            Encoding::Auto => crate::read_image(&bytes, &map.image),
            Encoding::Linear => crate::read_image_raw(&bytes, &map.image),
        }?;
        let pixels = read.rgb("").ok_or_else(|| fail("it has no colours".into()))?;
        let pixels: Vec<[f32; 3]> = pixels.into_iter().map(|p| std::array::from_fn(|c| p[c] * factor[c])).collect();
        self.assets.has_room_for(read.width, read.height).map_err(fail)?;
        let stem = std::path::Path::new(&map.image).file_stem().map_or("image".into(), |s| s.to_string_lossy());
        let image = self.assets.add_image(&format!("{stem} tinted"), Image::from_rgb(read.width, read.height, &pixels));
        self.tinted.insert(key, image.clone());
        Ok(ImageTexture { image, encoding: Encoding::Linear, ..map.clone() })
    }
}

/// Whether a line makes holes.
fn holes(line: &Line) -> bool {
    match &*line.key {
        "map_d" => true,
        "d" => line.number().is_ok_and(|d| d < 1.0),
        "Tr" => line.number().is_ok_and(|t| t > 0.0),
        _ => false,
    }
}
