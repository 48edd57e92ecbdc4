//! Materials and textures.

use super::parse::{Parameter, Parameters, Spot};
use super::{Importer, Result};
use crate::import::free_name;
use crate::mitsuba::metals;
use crate::mitsuba::spectra::{self, Use};
use rebond::film::Image;
use rebond::scene::description::{Color, ImageTexture, MaterialDescription, MaterialRef, Metal, Texture};
use rebond::texture::{Encoding, TextureFilter, Wrap};

/// A texture by name: what it is, and a factor on it.
#[derive(Clone, Debug)]
pub struct Known {
    texture: Texture,
    /// Whether it is of numbers, not of colours.
    float: bool,
}

pub fn diffuse(reflectance: Texture) -> MaterialDescription {
    MaterialDescription::Diffuse { reflectance }
}

/// Opaque materials of pbrt's look the same from both sides.
pub fn two_sided(front: MaterialDescription) -> MaterialRef {
    let description = MaterialDescription::TwoSided { front: MaterialRef::Inline(Box::new(front)), back: None };
    MaterialRef::Inline(Box::new(description))
}

fn inline(m: MaterialDescription) -> MaterialRef {
    MaterialRef::Inline(Box::new(m))
}

impl Importer<'_> {
    pub fn material(&mut self, named: bool) -> Result<()> {
        let (word, at) = self.words.quoted("a material")?;
        let p = self.words.parameters()?;
        let kind = if named { self.word(&p, "type")?.map_or("diffuse".into(), |(kind, _)| kind) } else { word.clone() };
        let material = self.describe(&kind, &p, at)?;
        self.finish(&p, &format!("the material \"{kind}\""))?;
        let name = if named {
            word
        } else {
            self.materials += 1;
            free_name(&format!("{kind} {}", self.materials), "", |n| self.scene.materials.contains_key(n))
        };
        self.places.note(format!("materials.{name}"), at.part());
        let description = match material {
            MaterialRef::Inline(m) => *m,
            MaterialRef::Named(_) => return Err(self.error(at, "a material that is another")),
        };
        if self.scene.materials.insert(name.clone(), description).is_some() {
            return Err(self.error(at, format!("the material \"{name}\" is there twice")));
        }
        if !named {
            self.state.material = MaterialRef::Named(name);
        }
        Ok(())
    }

    fn describe(&mut self, kind: &str, p: &Parameters, at: Spot) -> Result<MaterialRef> {
        use MaterialDescription as M;
        for name in ["displacement", "normalmap"] {
            if let Some(q) = p.get(name) {
                self.unsupported(q.at, format!("a material's {name}"))?;
            }
        }
        Ok(match kind {
            "diffuse" => two_sided(diffuse(self.reflectance(p, "reflectance", 0.5)?)),
            "coateddiffuse" => {
                let diffuse_reflectance = self.reflectance(p, "reflectance", 0.5)?;
                let alpha = self.roughness(p, 0.0)?[0];
                let int_ior = self.eta(p, 1.5)?;
                for name in ["thickness", "albedo", "g", "maxdepth", "nsamples"] {
                    let _ = p.get(name);
                }
                self.warn(at, "a coated diffuse surface is rendered as rebond's plastic, which is nearly the same");
                two_sided(M::Plastic { diffuse_reflectance, int_ior, ext_ior: 1.0, alpha, nonlinear: true })
            }
            "conductor" => {
                let [alpha_u, alpha_v] = self.roughness(p, 0.0)?;
                let (mut eta, mut k) = metals::index("Cu").unwrap_or_default();
                if p.get("reflectance").is_some() {
                    // With k alone: η = 1, R = k² / (4 + k²).
                    let r = match self.reflectance(p, "reflectance", 0.5)? {
                        Texture::Constant(c) => c.0,
                        Texture::Image(_) => {
                            self.unsupported(at, "an image for what a conductor reflects")?;
                            [0.5; 3]
                        }
                    };
                    eta = [1.0; 3];
                    k = r.map(|r| 2.0 * (r.clamp(0.0, 0.9999) / (1.0 - r.clamp(0.0, 0.9999))).sqrt());
                } else {
                    for (name, target, which) in [("eta", &mut eta, 0), ("k", &mut k, 1)] {
                        if let Some(q) = p.get(name) {
                            *target = self.index(q, which)?;
                        }
                    }
                }
                two_sided(M::Conductor {
                    metal: None::<Metal>,
                    eta: Some(Color(eta)),
                    k: Some(Color(k)),
                    alpha: alpha_u,
                    alpha_u: (alpha_u != alpha_v).then_some(alpha_u),
                    alpha_v: (alpha_u != alpha_v).then_some(alpha_v),
                    tint: Texture::grey(1.0),
                    compensate: false,
                })
            }
            "dielectric" => {
                let [alpha_u, alpha_v] = self.roughness(p, 0.0)?;
                let both = alpha_u != alpha_v;
                inline(M::Dielectric {
                    int_ior: self.eta(p, 1.5)?,
                    ext_ior: 1.0,
                    alpha: alpha_u,
                    alpha_u: both.then_some(alpha_u),
                    alpha_v: both.then_some(alpha_v),
                    tint: Texture::grey(1.0),
                })
            }
            "thindielectric" => {
                inline(M::ThinDielectric { int_ior: self.eta(p, 1.5)?, ext_ior: 1.0, tint: Texture::grey(1.0) })
            }
            "measured" => {
                let Some((name, at)) = self.word(p, "filename")? else {
                    return Err(self.error(at, "the filename is missing"));
                };
                two_sided(M::Measured { file: self.find(&name, at)? })
            }
            "interface" | "" | "none" => {
                inline(M::Mask { opacity: Texture::grey(0.0), material: inline(diffuse(Texture::grey(0.0))) })
            }
            "mix" => {
                let names = p.get("materials").map(|q| q.words.clone()).unwrap_or_default();
                let [a, b] = &names[..] else { return Err(self.error(at, "a mix is of two materials")) };
                let weight = match p.get("amount") {
                    Some(q) if q.kind == "texture" => {
                        self.unsupported(q.at, "an image for the amount of a mix: half is")?;
                        0.5
                    }
                    _ => self.number(p, "amount", 0.5)?,
                };
                // What is mixed must not be two-sided by itself: the mix is.
                let part = |name: &String| match self.scene.materials.get(name) {
                    Some(M::TwoSided { front, back: None }) => Ok((front.clone(), true)),
                    Some(_) => Ok((MaterialRef::Named(name.clone()), false)),
                    None => Err(self.error(at, format!("there is no material \"{name}\""))),
                };
                let ((a, opaque_a), (b, opaque_b)) = (part(a)?, part(b)?);
                let mix = M::Mix { a, b, weight };
                if opaque_a && opaque_b { two_sided(mix) } else { inline(mix) }
            }
            _ => {
                self.unsupported(at, format!("the material \"{kind}\" is not supported"))?;
                for q in &p.0 {
                    let _ = p.get(&q.name);
                }
                two_sided(diffuse(Texture::grey(0.5)))
            }
        })
    }

    /// α along u and v: the root of roughness, unless it is not to be remapped.
    fn roughness(&mut self, p: &Parameters, default: f64) -> Result<[f32; 2]> {
        let remap = self.flag(p, "remaproughness", true)?;
        let mut one = |name: &str, default: f64| match p.get(name) {
            Some(q) if q.kind == "texture" => {
                self.unsupported(q.at, format!("a texture for \"{name}\""))?;
                Ok(default as f32)
            }
            _ => self.number(p, name, default),
        };
        let both = f64::from(one("roughness", default)?);
        let (u, v) = (one("uroughness", both)?, one("vroughness", both)?);
        Ok([u, v].map(|x| if remap { x.max(0.0).sqrt() } else { x }))
    }

    fn eta(&mut self, p: &Parameters, default: f64) -> Result<f32> {
        let Some(q) = p.get("eta") else { return Ok(default as f32) };
        match (&q.numbers[..], &q.words[..]) {
            ([x], []) => Ok(*x as f32),
            ([], [name]) => {
                let known = [
                    ("glass-BK7", 1.5168),
                    ("glass-BAF10", 1.67),
                    ("glass-F5", 1.6034),
                    ("glass-LASF9", 1.8503),
                    ("glass-SF10", 1.7283),
                    ("glass-SF11", 1.7847),
                ];
                match known.iter().find(|(n, _)| n == name) {
                    Some((_, n)) => {
                        self.warn(q.at, format!("\"{name}\" has one index for all colours: that at 587.6 nm"));
                        Ok(*n)
                    }
                    None => Err(self.error(q.at, format!("no index of refraction is known for \"{name}\""))),
                }
            }
            _ => Err(self.error(q.at, "an index of refraction is one number, or the name of a glass")),
        }
    }

    /// η or k of a conductor.
    fn index(&mut self, q: &Parameter, which: usize) -> Result<[f32; 3]> {
        match (&*q.kind, &q.numbers[..], &q.words[..]) {
            ("rgb", &[r, g, b], _) => Ok([r, g, b].map(|x| x as f32)),
            (_, &[x], _) => Ok([x as f32; 3]),
            ("spectrum", [_, _, ..], []) => {
                Ok(spectra::of_samples(&self.samples(q)?, Use::Unbounded).map(|x| x as f32))
            }
            ("spectrum", [], [name]) => {
                let metal = name.strip_prefix("metal-").and_then(|n| n.rsplit_once('-'));
                match metal.and_then(|(metal, _)| metals::index(metal)) {
                    Some((eta, k)) => Ok(if which == 0 { eta } else { k }),
                    None => Err(self.error(q.at, format!("no metal is known for \"{name}\""))),
                }
            }
            _ => Err(self.error(q.at, format!("\"{}\" is a spectrum", q.name))),
        }
    }

    /// A colour or a texture of colours.
    fn reflectance(&mut self, p: &Parameters, name: &str, default: f32) -> Result<Texture> {
        match p.get(name) {
            None => Ok(Texture::grey(default)),
            Some(q) => self.texture_of(q),
        }
    }

    pub fn texture_of(&mut self, q: &Parameter) -> Result<Texture> {
        match (&*q.kind, &q.numbers[..], &q.words[..]) {
            ("texture", _, [name]) => match self.textures.get(name) {
                Some(known) => Ok(known.texture.clone()),
                None => Err(self.error(q.at, format!("there is no texture \"{name}\""))),
            },
            ("rgb", &[r, g, b], _) => Ok(Texture::Constant(Color([r, g, b].map(|x| x as f32)))),
            ("float", &[x], _) => Ok(Texture::grey(x as f32)),
            ("spectrum", [_, _, ..], []) => {
                let c = spectra::of_samples(&self.samples(q)?, Use::Reflectance);
                Ok(Texture::Constant(Color(c.map(|x| x as f32))))
            }
            _ => Err(self.error(q.at, format!("\"{}\" is a colour or a texture", q.name))),
        }
    }

    /// `Texture "name" "spectrum" "imagemap" …`.
    pub fn define_texture(&mut self) -> Result<()> {
        let (name, _) = self.words.quoted("a name")?;
        let (values, at) = self.words.quoted("spectrum or float")?;
        let (kind, at_kind) = self.words.quoted("a texture")?;
        let p = self.words.parameters()?;
        let float = match &*values {
            "float" => true,
            "spectrum" | "color" => false,
            _ => return Err(self.error(at, format!("a texture of \"{values}\": spectrum or float"))),
        };
        let texture = match &*kind {
            "constant" => match p.get("value") {
                Some(q) => self.texture_of(q)?,
                None => Texture::grey(1.0),
            },
            "imagemap" => self.imagemap(&p, at_kind, float)?,
            "checkerboard" => {
                let mut side = |name: &str, default: f32| match p.get(name) {
                    None => Ok([default; 3]),
                    Some(q) => match self.texture_of(q)? {
                        Texture::Constant(c) => Ok(c.0),
                        Texture::Image(_) => {
                            self.unsupported(q.at, "a texture within a checkerboard")?;
                            Ok([default; 3])
                        }
                    },
                };
                let (a, b) = (side("tex1", 1.0)?, side("tex2", 0.0)?);
                if self.count(&p, "dimension", 2)? != 2 {
                    self.unsupported(at_kind, "a checkerboard of three dimensions")?;
                }
                // A period is two squares.
                let image = self.assets.add_image("checkerboard", Image::from_rgb(2, 2, &[b, a, a, b]));
                let to_uv = self.mapping(&p, at_kind, 0.5)?;
                Texture::Image(ImageTexture {
                    image,
                    encoding: Encoding::Linear,
                    wrap: Wrap::Repeat,
                    wrap_v: None,
                    filter: TextureFilter::Nearest,
                    repeat: [1.0; 2],
                    to_uv: Some(to_uv),
                })
            }
            "scale" => {
                let tex = match p.get("tex") {
                    Some(q) => self.texture_of(q)?,
                    None => Texture::grey(1.0),
                };
                let scale = match p.get("scale") {
                    Some(q) => self.texture_of(q)?,
                    None => Texture::grey(1.0),
                };
                self.product(tex, scale, at_kind)?
            }
            "mix" => {
                let mut side = |name: &str, default: f32| match p.get(name) {
                    None => Ok(Texture::grey(default)),
                    Some(q) => self.texture_of(q),
                };
                let (a, b, amount) = (side("tex1", 0.0)?, side("tex2", 1.0)?, side("amount", 0.5)?);
                match (a, b, amount) {
                    (Texture::Constant(a), Texture::Constant(b), Texture::Constant(t)) => {
                        Texture::Constant(Color(std::array::from_fn(|c| a.0[c] + (b.0[c] - a.0[c]) * t.0[c])))
                    }
                    _ => {
                        self.unsupported(at_kind, "a mix of images: grey is")?;
                        Texture::grey(0.5)
                    }
                }
            }
            _ => {
                self.unsupported(at_kind, format!("the texture \"{kind}\" is not supported"))?;
                for q in &p.0 {
                    let _ = p.get(&q.name);
                }
                Texture::grey(0.5)
            }
        };
        self.finish(&p, &format!("the texture \"{kind}\""))?;
        self.textures.insert(name, Known { texture, float });
        Ok(())
    }

    /// Where a texture is on a surface.
    fn mapping(&mut self, p: &Parameters, at: Spot, factor: f32) -> Result<[[f32; 3]; 2]> {
        if self.word(p, "mapping")?.is_some_and(|(m, _)| m != "uv") {
            self.unsupported(at, "a texture that is not placed by u and v")?;
        }
        let (su, sv) = (self.number(p, "uscale", 1.0)?, self.number(p, "vscale", 1.0)?);
        let (du, dv) = (self.number(p, "udelta", 0.0)?, self.number(p, "vdelta", 0.0)?);
        Ok([[su * factor, 0.0, du * factor], [0.0, sv * factor, dv * factor]])
    }

    fn imagemap(&mut self, p: &Parameters, at: Spot, float: bool) -> Result<Texture> {
        let Some((name, at_name)) = self.word(p, "filename")? else {
            return Err(self.error(at, "the filename is missing"));
        };
        let mut image = self.find(&name, at_name)?;
        let wrap = match self.word(p, "wrap")?.as_ref().map(|(w, at)| (&**w, *at)) {
            None | Some(("repeat", _)) => Wrap::Repeat,
            Some(("clamp", _)) => Wrap::Clamp,
            Some((other, at)) => {
                self.unsupported(at, format!("the wrap mode \"{other}\": repeat is"))?;
                Wrap::Repeat
            }
        };
        let filter = match self.word(p, "filter")?.map(|(w, _)| w).as_deref() {
            Some("point") => TextureFilter::Nearest,
            // Where it matters how small the image is seen, paths see all of it.
            _ => TextureFilter::Bilinear,
        };
        let encoding = match self.word(p, "encoding")?.as_ref().map(|(w, at)| (&**w, *at)) {
            None => Encoding::Auto,
            Some(("sRGB", _)) => Encoding::Auto,
            Some(("linear", _)) => Encoding::Linear,
            Some((other, at)) => {
                self.unsupported(at, format!("the encoding \"{other}\": sRGB is"))?;
                Encoding::Auto
            }
        };
        let _ = p.get("maxanisotropy");
        let (scale, invert) = (self.number(p, "scale", 1.0)?, self.flag(p, "invert", false)?);
        let to_uv = self.mapping(p, at, 1.0)?;
        let changed = scale != 1.0 || invert || float && encoding == Encoding::Auto;
        if changed {
            let pixels = self.decoded(&image, encoding, at_name)?;
            let f = |x: f32| if invert { (1.0 - x * scale).max(0.0) } else { x * scale };
            let values: Vec<[f32; 3]> = pixels.1.iter().map(|p| p.map(f)).collect();
            image = self.assets.add_image("texture", Image::from_rgb(pixels.0[0], pixels.0[1], &values));
        }
        let to_uv = (to_uv != rebond::texture::SAME_UV).then_some(to_uv);
        Ok(Texture::Image(ImageTexture { image, encoding, wrap, wrap_v: None, filter, repeat: [1.0; 2], to_uv }))
    }

    fn decoded(&self, file: &str, encoding: Encoding, at: Spot) -> Result<([u32; 2], Vec<[f32; 3]>)> {
        let image = match self.assets.images.get(file) {
            Some(image) => rebond::film::Image::clone(image),
            None => {
                let bytes = self.assets.read(file).map_err(|m| self.error(at, m))?;
                let read = if encoding == Encoding::Linear {
                    crate::read_image_raw(&bytes, file)
                } else {
                    crate::read_image(&bytes, file)
                };
                read.map_err(|e| self.error(at, format!("\"{file}\": {}", e.message)))?
            }
        };
        let pixels = image.rgb("").ok_or_else(|| self.error(at, format!("\"{file}\" has no colours")))?;
        Ok(([image.width, image.height], pixels))
    }

    /// One texture times another, of which at most one is an image.
    fn product(&mut self, a: Texture, b: Texture, at: Spot) -> Result<Texture> {
        Ok(match (a, b) {
            (Texture::Constant(a), Texture::Constant(b)) => {
                Texture::Constant(Color(std::array::from_fn(|c| a.0[c] * b.0[c])))
            }
            (Texture::Image(image), Texture::Constant(c)) | (Texture::Constant(c), Texture::Image(image)) => {
                if c.0 == [1.0; 3] {
                    return Ok(Texture::Image(image));
                }
                let (size, pixels) = self.decoded(&image.image, image.encoding, at)?;
                let values: Vec<[f32; 3]> = pixels.iter().map(|p| std::array::from_fn(|k| p[k] * c.0[k])).collect();
                let name = self.assets.add_image("texture", Image::from_rgb(size[0], size[1], &values));
                Texture::Image(ImageTexture { image: name, ..image })
            }
            (image, Texture::Image(_)) => {
                self.unsupported(at, "an image times another: the first is")?;
                image
            }
        })
    }

    /// How opaque a shape is; `None` if it is.
    pub fn alpha(&mut self, p: &Parameters) -> Result<Option<Texture>> {
        let Some(q) = p.get("alpha") else { return Ok(None) };
        if let ("texture", [name]) = (&*q.kind, &q.words[..])
            && self.textures.get(name).is_some_and(|t| !t.float)
        {
            return Err(self.error(q.at, format!("\"{name}\" is a texture of colours, not of numbers")));
        }
        Ok(Some(self.texture_of(q)?).filter(|t| *t != Texture::grey(1.0)))
    }
}
