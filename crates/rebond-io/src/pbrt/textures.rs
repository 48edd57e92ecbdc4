//! Textures. What pbrt computes for each hit is worked out once, for each texel:
//!
//! ```text
//! texel ↦ clamp(1 − s·texel or s·texel) ↦ a·that + b
//! ```
//!
//! the first by the `imagemap` itself (`scale`, `invert`), the second by the `scale` and `mix` textures around it. Nothing is
//! worked out before a material asks for it, so that textures of textures cost only what is used.

use super::parse::{Parameter, Parameters, Spot};
use super::{Importer, Result};
use crate::import::squares;
use crate::mitsuba::spectra::{self, Use};
use rebond::film::Image;
use rebond::scene::description::{Color, ImageTexture, Texture};
use rebond::texture::{Encoding, TextureFilter, Wrap};

/// Numbers in all images that have to be made for a scene.
const MOST_NUMBERS: usize = 1 << 27;

/// A texture by name.
#[derive(Clone, Debug)]
pub enum Known {
    /// The same everywhere.
    Flat([f32; 3]),
    /// An image.
    Picture(Box<Picture>),
}

/// An image, and what is done to its texels.
#[derive(Clone, Debug)]
pub struct Picture {
    image: ImageTexture,
    /// The exponent of its encoding, if that is neither sRGB nor linear.
    gamma: Option<f32>,
    /// Of numbers: the mean of the channels.
    mean: bool,
    /// The imagemap's own factor and summand, and whether what comes of them is cut off at 1.
    own: [f32; 2],
    cut: bool,
    /// Factor and summand of each channel.
    after: [[f32; 3]; 2],
    /// Of what comes of all that, the root.
    root: bool,
}

impl Picture {
    fn of(image: ImageTexture) -> Self {
        let after = [[1.0; 3], [0.0; 3]];
        Self { image, gamma: None, mean: false, own: [1.0, 0.0], cut: false, after, root: false }
    }

    /// Whether the file is what it is.
    fn is_plain(&self) -> bool {
        self.gamma.is_none() && !self.mean && !self.root && self.own == [1.0, 0.0] && self.after == [[1.0; 3], [0.0; 3]]
    }

    fn texel(&self, t: [f32; 3]) -> [f32; 3] {
        let t = self.gamma.map_or(t, |g| t.map(|x| x.max(0.0).powf(g)));
        let t = if self.mean { [(t[0] + t[1] + t[2]) / 3.0; 3] } else { t };
        let t = t.map(|x| (x * self.own[0] + self.own[1]).clamp(0.0, if self.cut { 1.0 } else { f32::MAX }));
        // Shares of light, both colours and opacities.
        let t = std::array::from_fn(|c| (t[c] * self.after[0][c] + self.after[1][c]).clamp(0.0, 1.0));
        if self.root { t.map(f32::sqrt) } else { t }
    }
}

impl Known {
    /// a·x + b.
    fn then(self, a: [f32; 3], b: [f32; 3]) -> Self {
        let of = |x: [f32; 3]| std::array::from_fn(|c| a[c] * x[c] + b[c]);
        match self {
            Self::Flat(x) => Self::Flat(of(x)),
            Self::Picture(mut p) => {
                p.after = [std::array::from_fn(|c| a[c] * p.after[0][c]), of(p.after[1])];
                Self::Picture(p)
            }
        }
    }
}

impl Importer<'_> {
    /// The texture that a parameter is, of numbers or of colours.
    pub fn texture_of(&mut self, q: &Parameter, float: bool) -> Result<Texture> {
        match self.known(q, float)? {
            Known::Flat(c) if q.kind == "texture" => Ok(Texture::Constant(Color(c.map(|x| x.clamp(0.0, 1.0))))),
            Known::Flat(c) => Ok(Texture::Constant(Color(c))),
            Known::Picture(p) => Ok(Texture::Image(self.made(*p, q.at)?)),
        }
    }

    /// The image that a parameter is, or the root of it.
    pub fn number_image(&mut self, q: &Parameter, root: bool) -> Result<Option<ImageTexture>> {
        if q.kind != "texture" {
            return Ok(None);
        }
        let Known::Picture(picture) = self.known(q, true)? else { return Ok(None) };
        if root && picture.image.filter == TextureFilter::Bilinear {
            self.warn(q.at, "between the texels of a roughness its root is interpolated");
        }
        Ok(Some(self.made(Picture { root, ..*picture }, q.at)?))
    }

    /// A number where rebond has no texture; the mean of what varies.
    pub fn number_of(&mut self, p: &Parameters, name: &str, default: f64) -> Result<f32> {
        let Some(q) = p.get(name).filter(|q| q.kind == "texture") else { return self.number(p, name, default) };
        match self.known(q, true)? {
            Known::Flat([x, ..]) => Ok(x),
            Known::Picture(picture) => {
                self.unsupported(q.at, format!("a texture for \"{name}\": its mean is"))?;
                let (_, texels) = self.decoded(&picture.image.image, picture.image.encoding, q.at)?;
                let sum: f64 = texels.iter().map(|t| f64::from(picture.texel(*t)[0])).sum();
                Ok((sum / texels.len().max(1) as f64) as f32)
            }
        }
    }

    fn known(&mut self, q: &Parameter, float: bool) -> Result<Known> {
        match (&*q.kind, &q.numbers[..], &q.words[..]) {
            ("texture", _, [name]) => match self.textures.get(&(float, name.clone())) {
                Some(known) => Ok(known.clone()),
                None => {
                    let of = if float { "numbers" } else { "colours" };
                    Err(self.error(q.at, format!("there is no texture of {of} \"{name}\"")))
                }
            },
            ("rgb", &[r, g, b], _) if !float => Ok(Known::Flat([r, g, b].map(|x| x as f32))),
            ("float", &[x], _) => Ok(Known::Flat([x as f32; 3])),
            ("spectrum", [_, _, ..], []) if !float => {
                let c = spectra::of_samples(&self.samples(q)?, Use::Reflectance);
                Ok(Known::Flat(c.map(|x| x as f32)))
            }
            _ if float => Err(self.error(q.at, format!("\"{}\" is a number or a texture of numbers", q.name))),
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
        let mut part = |name: &str, default: f32, float: bool| match p.get(name) {
            Some(q) => self.known(q, float),
            None => Ok(Known::Flat([default; 3])),
        };
        let texture = match &*kind {
            "constant" => part("value", 1.0, float)?,
            "scale" => {
                let (texture, factor) = (part("tex", 1.0, float)?, part("scale", 1.0, true)?);
                self.product(texture, factor, at_kind)?
            }
            "mix" => {
                let (a, b) = (part("tex1", 0.0, float)?, part("tex2", 1.0, float)?);
                let amount = part("amount", 0.5, true)?;
                self.mixture(a, b, amount, at_kind)?
            }
            "checkerboard" => {
                let sides = (part("tex1", 1.0, float)?, part("tex2", 0.0, float)?);
                self.checkerboard(sides, &p, at_kind)?
            }
            "imagemap" => Known::Picture(Box::new(self.imagemap(&p, at_kind, float)?)),
            _ => {
                self.unsupported(at_kind, format!("the texture \"{kind}\" is not supported"))?;
                for q in &p.0 {
                    let _ = p.get(&q.name);
                }
                Known::Flat([0.5; 3])
            }
        };
        self.finish(&p, &format!("the texture \"{kind}\""))?;
        self.textures.insert((float, name), texture);
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

    fn checkerboard(&mut self, sides: (Known, Known), p: &Parameters, at: Spot) -> Result<Known> {
        let mut color = |side: Known| match side {
            Known::Flat(c) => Ok(c),
            Known::Picture(_) => {
                self.unsupported(at, "a texture within a checkerboard: grey is")?;
                Ok([0.5; 3])
            }
        };
        let (a, b) = (color(sides.0)?, color(sides.1)?);
        if self.count(p, "dimension", 2)? != 2 {
            self.unsupported(at, "a checkerboard of three dimensions")?;
        }
        // A period is two squares.
        let image = self.assets.add_image("checkerboard", Image::from_rgb(2, 2, &[b, a, a, b]));
        let to_uv = self.mapping(p, at, 0.5)?;
        Ok(Known::Picture(Box::new(Picture::of(squares(image, to_uv)))))
    }

    fn imagemap(&mut self, p: &Parameters, at: Spot, float: bool) -> Result<Picture> {
        let Some((name, at_name)) = self.word(p, "filename")? else {
            return Err(self.error(at, "the filename is missing"));
        };
        let image = self.find(&name, at_name)?;
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
        let (encoding, gamma) = match self.word(p, "encoding")?.as_ref().map(|(w, at)| (&**w, *at)) {
            None | Some(("sRGB", _)) => (Encoding::Auto, None),
            Some(("linear", _)) => (Encoding::Linear, None),
            Some((other, at)) => match other.strip_prefix("gamma ").and_then(|g| g.trim().parse::<f32>().ok()) {
                Some(g) if g > 0.0 && g.is_finite() => (Encoding::Linear, Some(g)),
                _ => return Err(self.error(at, format!("no encoding \"{other}\": sRGB, linear, or gamma 2.2"))),
            },
        };
        let _ = p.get("maxanisotropy");
        let (scale, invert) = (self.number(p, "scale", 1.0)?, self.flag(p, "invert", false)?);
        let to_uv = self.mapping(p, at, 1.0)?;
        let to_uv = (to_uv != rebond::texture::SAME_UV).then_some(to_uv);
        let image =
            ImageTexture { image, encoding, wrap, wrap_v: None, filter, repeat: [1.0; 2], to_uv, channel: None };
        let own = if invert { [-scale, 1.0] } else { [scale, 0.0] };
        Ok(Picture { gamma, mean: float, own, cut: !float, ..Picture::of(image) })
    }

    /// One texture times another, of which at most one is an image.
    fn product(&mut self, a: Known, b: Known, at: Spot) -> Result<Known> {
        match (a, b) {
            (texture, Known::Flat(factor)) | (Known::Flat(factor), texture) => Ok(texture.then(factor, [0.0; 3])),
            (image, Known::Picture(_)) => {
                self.unsupported(at, "an image times another: the first is")?;
                Ok(image)
            }
        }
    }

    /// (1 − t)·a + t·b, of which at most one is an image.
    fn mixture(&mut self, a: Known, b: Known, t: Known, at: Spot) -> Result<Known> {
        let rest = |t: [f32; 3]| t.map(|t| 1.0 - t);
        let times = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|c| a[c] * b[c]);
        match (a, b, t) {
            (Known::Flat(a), b, Known::Flat(t)) => Ok(b.then(t, times(a, rest(t)))),
            (a, Known::Flat(b), Known::Flat(t)) => Ok(a.then(rest(t), times(b, t))),
            (Known::Flat(a), Known::Flat(b), t) => Ok(t.then(std::array::from_fn(|c| b[c] - a[c]), a)),
            _ => {
                self.unsupported(at, "a mix of several images: grey is")?;
                Ok(Known::Flat([0.5; 3]))
            }
        }
    }

    /// The image that a picture is: its file, or one that is made of it.
    fn made(&mut self, picture: Picture, at: Spot) -> Result<ImageTexture> {
        if picture.is_plain() {
            return Ok(picture.image);
        }
        let what = format!(
            "{:?}",
            Picture { image: ImageTexture { to_uv: None, ..picture.image.clone() }, ..picture.clone() }
        );
        let image = match self.made.get(&what) {
            Some(name) => name.clone(),
            None => {
                let (size, texels) = self.decoded(&picture.image.image, picture.image.encoding, at)?;
                self.make(3 * texels.len(), at)?;
                let texels: Vec<[f32; 3]> = texels.into_iter().map(|t| picture.texel(t)).collect();
                let name = self.assets.add_image("texture", Image::from_rgb(size[0], size[1], &texels));
                self.made.insert(what, name.clone());
                name
            }
        };
        Ok(ImageTexture { image, encoding: Encoding::Linear, ..picture.image })
    }

    /// Counts numbers of images that stand in no file.
    pub fn make(&mut self, numbers: usize, at: Spot) -> Result<()> {
        self.numbers = self.numbers.saturating_add(numbers);
        if self.numbers > MOST_NUMBERS {
            let message = format!("images that have to be made would come to more than {MOST_NUMBERS} numbers");
            return Err(self.error(at, message));
        }
        Ok(())
    }

    fn decoded(&self, file: &str, encoding: Encoding, at: Spot) -> Result<([u32; 2], Vec<[f32; 3]>)> {
        let image = match self.assets.images.get(file) {
            Some(image) => Image::clone(image),
            None => {
                let bytes = self.assets.read(file).map_err(|m| self.error(at, m))?;
                let read = match encoding {
                    Encoding::Linear => crate::read_image_raw(&bytes, file),
                    Encoding::Auto => crate::read_image(&bytes, file),
                };
                read.map_err(|e| self.error(at, format!("\"{file}\": {}", e.message)))?
            }
        };
        let pixels = image.rgb("").ok_or_else(|| self.error(at, format!("\"{file}\" has no colours")))?;
        Ok(([image.width, image.height], pixels))
    }
}
