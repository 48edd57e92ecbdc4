//! Textures: images and checkerboards, put upright for the shapes that they are on.

use super::{Importer, Object, Property, Result, Spot, Use, Value, color};
use crate::import::squares;
use glam::{DMat3, DMat4, DVec3};
use rebond::film::Image;
use rebond::scene::description::{AttributeTexture, Color, ImageTexture, NumberTexture, Texture};
use rebond::texture::{Encoding, TextureFilter, UvMap, Wrap};
use std::rc::Rc;

/// How a shape's (u, v) in rebond relate to those in Mitsuba. There v of an image grows downwards, here upwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Lie {
    /// They are the same.
    Same,
    /// Mitsuba's v is 1 − v: spheres, and the texture coordinates of OBJ files.
    Flipped,
    /// Mitsuba's are (v, u): disks.
    Swapped,
}

impl Lie {
    /// Takes rebond's (u, v, 1) to Mitsuba's.
    fn matrix(self) -> DMat3 {
        match self {
            Self::Same => DMat3::IDENTITY,
            Self::Flipped => FLIP,
            Self::Swapped => DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z),
        }
    }
}

/// (u, 1 − v).
const FLIP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 1.0));

/// The part of a transform that is two-dimensional.
fn flat_part(m: DMat4) -> DMat3 {
    let column = |c: glam::DVec4, last: f64| DVec3::new(c.x, c.y, last);
    DMat3::from_cols(column(m.x_axis, 0.0), column(m.y_axis, 0.0), column(m.w_axis, 1.0))
}

impl Importer {
    /// A texture that a shape wears, or its default.
    pub fn texture(&mut self, o: &Object, name: &str, default: f32, lie: Lie) -> Result<Texture> {
        match o.get(name) {
            None => Ok(Texture::grey(default)),
            Some(p) => self.texture_of(p, lie, true),
        }
    }

    /// A texture; if it is not of `colours`, its numbers are taken as they are by whoever reads it.
    pub fn texture_of(&mut self, p: &Property, lie: Lie, colours: bool) -> Result<Texture> {
        if let Some(c) = self.color(p, Use::Reflectance)? {
            return Ok(Texture::Constant(color(c)));
        }
        let Some(o) = self.object(p)? else { return self.wrong(p, "a texture") };
        match o.plugin.as_str() {
            "bitmap" => Ok(Texture::Image(self.bitmap(&o, lie, colours)?)),
            "checkerboard" => Ok(Texture::Image(self.checkerboard(&o, lie, colours)?)),
            "mesh_attribute" => Ok(Texture::Attribute(self.mesh_attribute(&o)?)),
            _ => {
                self.unknown_plugin(&o)?;
                Ok(Texture::grey(0.5))
            }
        }
    }

    /// What a mesh knows of its vertices or faces.
    fn mesh_attribute(&mut self, o: &Object) -> Result<AttributeTexture> {
        let Some((attribute, at)) = self.text(o, "name")? else {
            return Err(self.error(&o.at, "the name of the attribute is missing"));
        };
        if !attribute.starts_with("vertex_") && !attribute.starts_with("face_") {
            return Err(self.error(&at, format!("\"{attribute}\" starts with neither vertex_ nor face_")));
        }
        let scale = Color([self.number_or(o, "scale", 1.0)?; 3]);
        self.finish(o)?;
        Ok(AttributeTexture { attribute, scale, image: None })
    }

    fn uv_map(&mut self, o: &Object, lie: Lie) -> Result<UvMap> {
        let to_uv = match o.get("to_uv") {
            None => DMat3::IDENTITY,
            Some(Property { value: Value::Transform(m), .. }) => flat_part(*m),
            Some(p) => return self.wrong(p, "a transform"),
        };
        let m = FLIP * to_uv * lie.matrix();
        let row = |i: usize| [m.x_axis[i] as f32, m.y_axis[i] as f32, m.z_axis[i] as f32];
        Ok([row(0), row(1)])
    }

    /// An image; see [`texture_of`](Self::texture_of).
    pub fn bitmap(&mut self, o: &Object, lie: Lie, colours: bool) -> Result<ImageTexture> {
        let (mut file, at) = match self.text(o, "filename")? {
            Some(found) => found,
            None => return Err(self.error(&o.at, "the filename is missing")),
        };
        file = self.find(&file, &at)?;
        let raw = self.flag(o, "raw", false)?;
        let wrap = match self.text(o, "wrap_mode")? {
            None => Wrap::Repeat,
            Some((word, at)) => match word.as_str() {
                "repeat" => Wrap::Repeat,
                "mirror" => Wrap::Mirror,
                "clamp" => Wrap::Clamp,
                _ => return Err(self.error(&at, format!("no wrap mode \"{word}\": repeat, mirror or clamp"))),
            },
        };
        let filter = match self.text(o, "filter_type")? {
            None => TextureFilter::Bilinear,
            Some((word, at)) => match word.as_str() {
                "bilinear" => TextureFilter::Bilinear,
                "nearest" => TextureFilter::Nearest,
                _ => return Err(self.error(&at, format!("no filter \"{word}\": nearest or bilinear"))),
            },
        };
        // How it is kept in memory.
        self.passed_over(o, &["format", "accel"]);
        let to_uv = self.uv_map(o, lie)?;
        self.finish(o)?;
        if !raw && !colours {
            // Numbers that Mitsuba takes from a colour image by its decoded values.
            let image = self.image(&file, &at)?;
            let stem =
                std::path::Path::new(&file).file_stem().map_or("image".into(), |s| s.to_string_lossy().into_owned());
            file = self.assets.add_image(&format!("{stem} linear"), image);
        }
        let encoding = if raw { Encoding::Linear } else { Encoding::Auto };
        Ok(ImageTexture {
            image: file,
            encoding,
            wrap,
            wrap_v: None,
            filter,
            repeat: [1.0; 2],
            to_uv: Some(to_uv),
            channel: None,
        })
    }

    /// Two by two texels, whatever their size is. Where Mitsuba asks it for a number, not a colour, it gives that of the other squares.
    fn checkerboard(&mut self, o: &Object, lie: Lie, colours: bool) -> Result<ImageTexture> {
        let mut side = |name: &str, default: f64| match o.get(name) {
            None => Ok([default; 3]),
            Some(p) => match self.color(p, Use::Reflectance)? {
                Some(c) => Ok(c),
                None => {
                    self.unsupported(&p.at, "a texture within a checkerboard")?;
                    Ok([default; 3])
                }
            },
        };
        let colors = [side("color0", 0.4)?, side("color1", 0.2)?].map(|c| c.map(|x| x as f32));
        let to_uv = self.uv_map(o, lie)?;
        self.finish(o)?;
        let [a, b] = if colours { colors } else { [colors[1], colors[0]] };
        let image = self.assets.add_image("checkerboard", Image::from_rgb(2, 2, &[a, b, b, a]));
        Ok(squares(image, to_uv))
    }

    /// Where a file is; it must be there, and may be opened.
    pub fn find(&self, name: &str, at: &Spot) -> Result<String> {
        let found = super::xml::find(&self.assets, &self.paths, "", name).unwrap_or_else(|| name.replace('\\', "/"));
        self.assets.path(&found).map_err(|m| self.error(at, m))?;
        Ok(found)
    }

    /// An image of the scene, decoded.
    pub fn image(&self, file: &str, at: &Spot) -> Result<Image> {
        let bytes = self.assets.read(file).map_err(|m| self.error(at, m))?;
        crate::read_image(&bytes, file).map_err(|e| self.error(at, format!("\"{file}\": {}", e.message)))
    }

    /// A number that may vary over the surface, at least `least`.
    pub fn number_texture(
        &mut self,
        o: &Object,
        name: &str,
        default: f64,
        least: f32,
        lie: Lie,
    ) -> Result<NumberTexture> {
        if let Some(p) = o.get(name)
            && self.color(p, Use::Unbounded)?.is_none()
        {
            match self.texture_of(p, lie, false)? {
                Texture::Image(image) => return Ok(NumberTexture::Image(image)),
                Texture::Attribute(attribute) => return Ok(NumberTexture::Attribute(attribute)),
                Texture::Constant(_) => {}
            }
        }
        Ok(NumberTexture::Constant(self.one_number(o, name, default)?.max(least)))
    }

    /// The one number that a property is, where rebond has no texture; the mean of what varies.
    pub fn one_number(&mut self, o: &Object, name: &str, default: f64) -> Result<f32> {
        let Some(p) = o.get(name) else { return Ok(default as f32) };
        if let Some(c) = self.color(p, Use::Unbounded)? {
            return Ok((0.212_671 * c[0] + 0.715_160 * c[1] + 0.072_169 * c[2]) as f32).map(|x| match &p.value {
                Value::Number(x) => *x as f32,
                _ => x,
            });
        }
        let Some(texture) = self.object(p)? else { return self.wrong(p, "a number") };
        self.unsupported(&p.at, format!("a {} for \"{name}\": one number is", texture.plugin))?;
        Ok(self.mean(&texture)?.map_or(default as f32, |c| 0.212_671 * c[0] + 0.715_160 * c[1] + 0.072_169 * c[2]))
    }

    /// The mean of a bitmap.
    pub fn mean(&mut self, o: &Rc<Object>) -> Result<Option<[f32; 3]>> {
        let Some((file, at)) = (if o.plugin == "bitmap" { self.text(o, "filename")? } else { None }) else {
            return Ok(None);
        };
        let raw = self.flag(o, "raw", false)?;
        let file = self.find(&file, &at)?;
        let bytes = self.assets.read(&file).map_err(|m| self.error(&at, m))?;
        let image = if raw { crate::read_image_raw(&bytes, &file) } else { crate::read_image(&bytes, &file) };
        let pixels = image.ok().and_then(|i| i.rgb("")).filter(|p| !p.is_empty());
        Ok(pixels
            .map(|p| std::array::from_fn(|c| (p.iter().map(|t| f64::from(t[c])).sum::<f64>() / p.len() as f64) as f32)))
    }
}
