//! Materials: metallic-roughness and its extensions, as rebond's principled model.

use super::accessor::unescape;
use super::{Importer, Result, unused_name};
use ::gltf::json::material::AlphaMode;
use ::gltf::json::texture::{MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use glam::{DMat3, DVec3};
use rebond::film::Image;
use rebond::scene::description::{
    AttributeTexture, Channel, Color, ImageTexture, MaterialDescription, MaterialRef, NumberTexture, Texture,
};
use rebond::texture::{Encoding, SAME_UV, TextureFilter, UvMap, Wrap};

/// Roughness below which a pane of glass is taken for smooth.
const SMOOTH: f32 = 0.05;

/// How what wears a material shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shine {
    /// It does not.
    Not,
    /// With one radiance.
    Evenly(Color),
    /// The material says it: in the colours of an image.
    Itself,
}

/// A reference to a texture: where it stands in the file, and what it says.
struct TextureAt {
    pointer: String,
    texture: usize,
}

impl Importer<'_> {
    /// The name of a material, and how it shines; the default one if there is no number. It may be `colored` by vertices.
    pub fn material(&mut self, number: Option<usize>, colored: bool) -> Result<(String, Shine)> {
        // No list is that long.
        let key = (number.unwrap_or(usize::MAX), colored);
        if let Some(known) = self.materials.get(&key) {
            return Ok(known.clone());
        }
        let (description, emission, name) = match number {
            None => (principled(colored), Shine::Not, "default".to_string()),
            Some(n) => self.describe(n, colored).map_err(|e| self.within(&format!("materials[{n}]"), e))?,
        };
        let name = unused_name(&name, |n| self.scene.materials.contains_key(n));
        self.places.note(format!("materials.{name}"), (0, None));
        if let Some(n) = number {
            self.places.name(format!("materials.{name}"), self.named(&format!("materials[{n}]")));
        }
        self.scene.materials.insert(name.clone(), description);
        self.materials.insert(key, (name.clone(), emission));
        Ok((name, emission))
    }

    fn describe(&mut self, number: usize, colored: bool) -> Result<(MaterialDescription, Shine, String)> {
        let path = format!("materials[{number}]");
        let Some(material) = self.root.materials.get(number).cloned() else {
            return Err(self.error(&path, "there is no such material"));
        };
        let name =
            self.at(&format!("/materials/{number}/name")).and_then(|v| v.as_str()).unwrap_or_default().to_string();
        let own = format!("/materials/{number}");
        let extension = |name: &str| format!("{own}/extensions/KHR_materials_{name}");
        let pbr = format!("{own}/pbrMetallicRoughness");
        let [r, g, b, a] = material.pbr_metallic_roughness.base_color_factor.0;
        let base_texture = self.texture_at(&format!("{pbr}/baseColorTexture"));
        let base_color = match &base_texture {
            None => Texture::Constant(Color([r, g, b])),
            // Colours of vertices have their own factor.
            Some(t) if colored => Texture::Image(self.raw_texture(t)?),
            Some(t) => Texture::Image(self.image_texture(t, [r, g, b], None)?),
        };
        let base_color = if colored { by_vertices(base_color, [r, g, b]) } else { base_color };
        let metallic = material.pbr_metallic_roughness.metallic_factor.0;
        let roughness = material.pbr_metallic_roughness.roughness_factor.0;
        let [metallic, roughness] = match self.texture_at(&format!("{pbr}/metallicRoughnessTexture")) {
            None => [metallic, roughness].map(NumberTexture::Constant),
            Some(t) => self.metal_and_roughness(&t, metallic, roughness)?,
        };
        self.no_textures(
            &extension("clearcoat"),
            &["clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture"],
            &path,
        )?;
        self.no_textures(&extension("sheen"), &["sheenColorTexture", "sheenRoughnessTexture"], &path)?;
        self.no_textures(&extension("specular"), &["specularTexture", "specularColorTexture"], &path)?;
        self.no_textures(&extension("transmission"), &["transmissionTexture"], &path)?;
        self.no_textures(&extension("volume"), &["thicknessTexture"], &path)?;
        if self.texture_at(&format!("{own}/occlusionTexture")).is_some() {
            self.warn(&path, "its image of occlusion is left out: light is traced");
        }
        let number_of = |me: &Self, name: &str, key: &str, default: f32| -> Result<f32> {
            Ok(me.number(&format!("{}/{key}", extension(name)))?.unwrap_or(default))
        };
        let transmission = number_of(self, "transmission", "transmissionFactor", 0.0)?;
        let mut ior = number_of(self, "ior", "ior", 1.5)?;
        if ior == 0.0 {
            self.unsupported(&path, "an index of 0, with which everything is reflected: 1.5 is taken")?;
            ior = 1.5;
        }
        let specular = number_of(self, "specular", "specularFactor", 1.0)?;
        let tint = self.numbers::<3>(&format!("{}/specularColorFactor", extension("specular")))?.unwrap_or([1.0; 3]);
        if tint != [1.0; 3] {
            self.unsupported(&path, "coloured specular reflection")?;
        }
        let sheen = self.numbers::<3>(&format!("{}/sheenColorFactor", extension("sheen")))?.unwrap_or([0.0; 3]);
        if sheen != [0.0; 3] {
            self.warn(&path, "its sheen is rebond's own: white, and of no roughness");
        }
        let thick = number_of(self, "volume", "thicknessFactor", 0.0)? > 0.0;
        let absorbs =
            self.numbers::<3>(&format!("{}/attenuationColor", extension("volume")))?.is_some_and(|c| c != [1.0; 3])
                && self.number(&format!("{}/attenuationDistance", extension("volume")))?.is_some();
        if absorbs {
            self.unsupported(&path, "a volume that absorbs")?;
        }
        let thin = transmission > 0.0 && !thick;
        let smooth = metallic.constant() == Some(0.0) && roughness.constant().is_some_and(|r| r <= SMOOTH);
        let mut description = if thin && transmission == 1.0 && smooth {
            if base_color != Texture::grey(1.0) {
                self.warn(&path, "the colour of its thin glass is also that of its reflection");
            }
            MaterialDescription::ThinDielectric { int_ior: ior, ext_ior: 1.0, tint: base_color }
        } else {
            if thin {
                self.warn(&path, "its thin glass is solid: light is refracted");
            }
            MaterialDescription::Principled {
                base_color,
                metallic,
                roughness,
                anisotropic: 0.0,
                specular: 0.5 * specular,
                clearcoat: number_of(self, "clearcoat", "clearcoatFactor", 0.0)?,
                clearcoat_roughness: number_of(self, "clearcoat", "clearcoatRoughnessFactor", 0.0)?,
                sheen: sheen.iter().sum::<f32>() / 3.0,
                transmission,
                ior,
            }
        };
        let (mut emission, mut image) = self.emission(number)?;
        if self.at(&extension("unlit")).is_some() {
            self.warn(&path, "it is to be unlit: a lamp stands for it, which lights its neighbours");
            description = MaterialDescription::Diffuse { reflectance: Texture::grey(0.0) };
            (emission, image) = (Color([r, g, b]), base_texture.as_ref().map(|t| self.raw_texture(t)).transpose()?);
            if colored {
                self.unsupported(&path, "colours of vertices of what is unlit")?;
            }
        }
        let shines = emission.0 != [0.0; 3];
        if let Some(t) = self.texture_at(&format!("{own}/normalTexture")) {
            let scale = self.number(&format!("{own}/normalTexture/scale"))?.unwrap_or(1.0);
            let normal_map = ImageTexture { encoding: Encoding::Linear, ..self.raw_texture(&t)? };
            description = MaterialDescription::NormalMap { normal_map, scale, material: inline(description) };
        }
        if material.double_sided && transmission == 0.0 {
            description = MaterialDescription::TwoSided { front: inline(description), back: None };
            if shines {
                self.warn(&path, "it shines to the side of its normals only");
            }
        }
        let opacity =
            self.opacity(&material.alpha_mode, material.alpha_cutoff.map_or(0.5, |c| c.0), a, &base_texture)?;
        if let Some(opacity) = opacity {
            description = MaterialDescription::Mask { opacity, material: inline(description) };
            if shines {
                self.unsupported(&path, "light from a surface with holes")?;
            }
            return Ok((description, Shine::Not, name));
        }
        let shine = match image {
            _ if !shines => Shine::Not,
            None => Shine::Evenly(emission),
            Some(radiance) => {
                description = MaterialDescription::Glow { radiance, scale: emission, material: inline(description) };
                Shine::Itself
            }
        };
        Ok((description, shine, name))
    }

    /// What it emits, and the image that this multiplies.
    fn emission(&mut self, number: usize) -> Result<(Color, Option<ImageTexture>)> {
        let own = format!("/materials/{number}");
        let factor = self.numbers::<3>(&format!("{own}/emissiveFactor"))?.unwrap_or([0.0; 3]);
        let pointer = format!("{own}/extensions/KHR_materials_emissive_strength/emissiveStrength");
        let strength = self.number(&pointer)?.unwrap_or(1.0);
        let image = self.texture_at(&format!("{own}/emissiveTexture")).filter(|_| factor != [0.0; 3]);
        let image = image.map(|t| self.raw_texture(&t)).transpose()?;
        Ok((Color(factor.map(|c| c * strength)), image))
    }

    /// How opaque a material is; `None` if it is everywhere.
    fn opacity(
        &mut self,
        mode: &Checked<AlphaMode>,
        cutoff: f32,
        factor: f32,
        base: &Option<TextureAt>,
    ) -> Result<Option<Texture>> {
        let passes = |alpha: f32| match mode {
            Checked::Valid(AlphaMode::Mask) => f32::from(u8::from(alpha >= cutoff)),
            _ => alpha,
        };
        match mode {
            Checked::Valid(AlphaMode::Mask | AlphaMode::Blend) => {}
            _ => return Ok(None),
        }
        let Some(t) = base else {
            let opacity = passes(factor);
            return Ok((opacity < 1.0).then(|| Texture::grey(opacity)));
        };
        let Some(alpha) = self.channel(t, "A")? else {
            let opacity = passes(factor);
            return Ok((opacity < 1.0).then(|| Texture::grey(opacity)));
        };
        if alpha.iter().all(|x| passes(x * factor) >= 1.0) {
            return Ok(None);
        }
        let mut texture = self.image_texture(t, [1.0; 3], Some(&|x: f32| passes(x * factor).clamp(0.0, 1.0)))?;
        if matches!(mode, Checked::Valid(AlphaMode::Mask)) {
            // What is half opaque between texels would be neither.
            texture.filter = TextureFilter::Nearest;
        }
        Ok(Some(Texture::Image(texture)))
    }

    // ---- textures ----

    /// Which set of texture coordinates the images of a material are spread over.
    pub fn uv_set(&mut self, number: Option<usize>, path: &str) -> Result<u32> {
        let mut sets = Vec::new();
        if let Some(material) = number.and_then(|n| self.at(&format!("/materials/{n}"))) {
            texture_sets(material, &mut sets);
        }
        let first = sets.first().copied().unwrap_or(0);
        if sets.iter().any(|set| *set != first) {
            self.unsupported(path, format!("images over two sets of texture coordinates: all are over set {first}"))?;
        }
        Ok(first)
    }

    /// A reference to a texture, if there is one.
    fn texture_at(&self, pointer: &str) -> Option<TextureAt> {
        let texture = self.at(&format!("{pointer}/index"))?.as_u64()?;
        Some(TextureAt { pointer: pointer.to_string(), texture: usize::try_from(texture).unwrap_or(usize::MAX) })
    }

    fn no_textures(&mut self, extension: &str, names: &[&str], path: &str) -> Result<()> {
        for name in names {
            if self.texture_at(&format!("{extension}/{name}")).is_some() {
                self.unsupported(path, format!("an image for {name}: its factor is"))?;
            }
        }
        Ok(())
    }

    fn source(&self, t: &TextureAt) -> Result<usize> {
        let path = format!("textures[{}]", t.texture);
        let source = self.at(&format!("/textures/{}/source", t.texture)).and_then(|v| v.as_u64());
        source.map(|n| n as usize).ok_or_else(|| self.error(&path, "there is no such texture, or it has no image"))
    }

    /// The image of a texture, with all its channels.
    fn decoded(&mut self, t: &TextureAt, raw: bool) -> Result<&Image> {
        let number = self.source(t)?;
        if !self.images.contains_key(&(number, raw)) {
            let path = format!("images[{number}]");
            let Some(image) = self.root.images.get(number).cloned() else {
                return Err(self.error(&path, "there is no such image"));
            };
            let bytes = match (image.uri, image.buffer_view) {
                (Some(uri), _) => self.open(&uri).map_err(|m| self.error(&path, m))?,
                (None, Some(view)) => self.view_bytes(view.value())?,
                (None, None) => return Err(self.error(&path, "it has no bytes")),
            };
            let read = if raw { crate::read_image_raw(&bytes, "") } else { crate::read_image(&bytes, "") };
            let decoded = read.map_err(|e| self.error(&path, e.message))?;
            self.images.insert((number, raw), decoded);
        }
        Ok(&self.images[&(number, raw)])
    }

    fn channel(&mut self, t: &TextureAt, name: &str) -> Result<Option<Vec<f32>>> {
        let image = self.decoded(t, false)?;
        let found = image.layers.iter().flat_map(|l| &l.channels).find(|c| c.name == name);
        Ok(found.map(|c| c.data.clone()))
    }

    /// Metal is blue and roughness green, times these factors.
    fn metal_and_roughness(&mut self, t: &TextureAt, metallic: f32, roughness: f32) -> Result<[NumberTexture; 2]> {
        let whole = |factor: f32| factor == 0.0 || factor == 1.0;
        let image = if whole(metallic) && whole(roughness) {
            ImageTexture { encoding: Encoding::Linear, ..self.raw_texture(t)? }
        } else {
            let number = self.source(t)?;
            let image = self.decoded(t, true)?;
            let (width, height) = (image.width, image.height);
            let pixels = image.rgb("").unwrap_or_default();
            let pixels: Vec<[f32; 3]> =
                pixels.into_iter().map(|[_, g, b]| [0.0, g * roughness, b * metallic]).collect();
            if pixels.len() != width as usize * height as usize {
                return Err(self.error(&format!("images[{number}]"), "it has no colours"));
            }
            self.assets.has_room_for(width, height).map_err(|m| self.error(&format!("images[{number}]"), m))?;
            let image = Image::from_rgb(width, height, &pixels);
            let image = self.assets.add_image(&format!("image-{number}-metal-roughness"), image);
            self.placed(t, image)?
        };
        let channel = |factor: f32, channel: Channel| match factor {
            0.0 => NumberTexture::Constant(0.0),
            _ => NumberTexture::Image(ImageTexture { channel: Some(channel), ..image.clone() }),
        };
        Ok([channel(metallic, Channel::B), channel(roughness, Channel::G)])
    }

    /// A texture times a colour; or its alpha, changed.
    fn image_texture(
        &mut self,
        t: &TextureAt,
        factor: [f32; 3],
        alpha: Option<&dyn Fn(f32) -> f32>,
    ) -> Result<ImageTexture> {
        if alpha.is_none() && factor == [1.0; 3] {
            return self.raw_texture(t);
        }
        let number = self.source(t)?;
        let image = self.decoded(t, false)?;
        let (width, height) = (image.width, image.height);
        let pixels: Vec<[f32; 3]> = match alpha {
            None => {
                let pixels = image.rgb("").unwrap_or_default();
                pixels.into_iter().map(|p| std::array::from_fn(|c| p[c] * factor[c])).collect()
            }
            Some(f) => self.channel(t, "A")?.unwrap_or_default().into_iter().map(|x| [f(x); 3]).collect(),
        };
        if pixels.len() != width as usize * height as usize {
            return Err(self.error(&format!("images[{number}]"), "it has no colours"));
        }
        self.assets.has_room_for(width, height).map_err(|m| self.error(&format!("images[{number}]"), m))?;
        let kind = if alpha.is_some() { "opacity" } else { "color" };
        let image = self.assets.add_image(&format!("image-{number}-{kind}"), Image::from_rgb(width, height, &pixels));
        self.placed(t, image)
    }

    /// A texture as it is.
    fn raw_texture(&mut self, t: &TextureAt) -> Result<ImageTexture> {
        let number = self.source(t)?;
        let uri = self.root.images.get(number).and_then(|i| i.uri.clone()).filter(|u| !u.starts_with("data:"));
        let file = match uri {
            Some(uri) => {
                let file = unescape(&uri);
                self.assets.path(&file).map_err(|m| self.error(&format!("images[{number}]"), m))?;
                file
            }
            // Numbers of maps are taken as they are, colours decoded.
            None => {
                let raw = ["normalTexture", "metallicRoughnessTexture"].iter().any(|name| t.pointer.ends_with(name));
                let image = self.decoded(t, raw)?.clone();
                self.assets.add_image(&format!("image-{number}"), image)
            }
        };
        self.placed(t, file)
    }

    /// Where the image is, how it repeats, and between its texels.
    fn placed(&mut self, t: &TextureAt, image: String) -> Result<ImageTexture> {
        let transform = format!("{}/extensions/KHR_texture_transform", t.pointer);
        let sampler = self.root.textures.get(t.texture).and_then(|x| x.sampler).map(|s| s.value());
        let sampler = match sampler {
            Some(n) => match self.root.samplers.get(n) {
                Some(s) => Some((s.wrap_s, s.wrap_t, s.mag_filter)),
                None => return Err(self.error(&format!("samplers[{n}]"), "there is no such sampler")),
            },
            None => None,
        };
        let (s, v, filter) =
            sampler.unwrap_or((Checked::Valid(WrappingMode::Repeat), Checked::Valid(WrappingMode::Repeat), None));
        let [wrap, along_v] = [s, v].map(|mode| match mode {
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            _ => Wrap::Repeat,
        });
        let wrap_v = (along_v != wrap).then_some(along_v);
        let filter = match filter {
            Some(Checked::Valid(MagFilter::Nearest)) => TextureFilter::Nearest,
            _ => TextureFilter::Bilinear,
        };
        let offset = self.numbers::<2>(&format!("{transform}/offset"))?.unwrap_or([0.0; 2]);
        let scale = self.numbers::<2>(&format!("{transform}/scale"))?.unwrap_or([1.0; 2]);
        let rotation = self.number(&format!("{transform}/rotation"))?.unwrap_or(0.0);
        let to_uv = uv_map(offset, rotation, scale);
        let to_uv = (to_uv != SAME_UV).then_some(to_uv);
        Ok(ImageTexture {
            image,
            encoding: Encoding::Auto,
            wrap,
            wrap_v,
            filter,
            repeat: [1.0; 2],
            to_uv,
            channel: None,
        })
    }
}

/// The sets that references to textures within a value name; those of images that are not read do not count.
fn texture_sets(value: &serde_json::Value, sets: &mut Vec<u32>) {
    let Some(object) = value.as_object() else { return };
    for (key, inner) in object {
        if key.ends_with("Texture") && key != "occlusionTexture" && inner.get("index").is_some() {
            let own = inner.pointer("/extensions/KHR_texture_transform/texCoord").or(inner.get("texCoord"));
            sets.push(own.and_then(|n| n.as_u64()).map_or(0, |n| n as u32));
        } else {
            texture_sets(inner, sets);
        }
    }
}

/// `KHR_texture_transform` where v grows upwards: scaled, turned counter-clockwise as one sees it (so that the image turns clockwise, as in
/// the specification's words and example, three.js, Babylon.js and Khronos's own test; its GLSL says otherwise), moved.
fn uv_map(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> UvMap {
    let [tx, ty] = offset.map(f64::from);
    let [sx, sy] = scale.map(f64::from);
    let (sin, cos) = f64::from(rotation).sin_cos();
    // v grows downwards in it: seen so, a turn counter-clockwise is (cos, sin; −sin, cos).
    let turned = DMat3::from_cols(
        DVec3::new(cos * sx, -sin * sx, 0.0),
        DVec3::new(sin * sy, cos * sy, 0.0),
        DVec3::new(tx, ty, 1.0),
    );
    let flip = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::new(0.0, 1.0, 1.0));
    let m = flip * turned * flip;
    // −0 is 0.
    let row = |i: usize| [m.x_axis[i] as f32 + 0.0, m.y_axis[i] as f32 + 0.0, m.z_axis[i] as f32 + 0.0];
    [row(0), row(1)]
}

fn inline(material: MaterialDescription) -> MaterialRef {
    MaterialRef::Inline(Box::new(material))
}

/// A colour of 1 or an image, times a factor and the colours of vertices.
fn by_vertices(color: Texture, factor: [f32; 3]) -> Texture {
    let image = if let Texture::Image(image) = color { Some(image) } else { None };
    Texture::Attribute(AttributeTexture { attribute: "vertex_color".into(), scale: Color(factor), image })
}

/// What wears no material.
fn principled(colored: bool) -> MaterialDescription {
    MaterialDescription::Principled {
        base_color: if colored { by_vertices(Texture::grey(1.0), [1.0; 3]) } else { Texture::grey(1.0) },
        metallic: 1.0.into(),
        roughness: 1.0.into(),
        anisotropic: 0.0,
        specular: 0.5,
        clearcoat: 0.0,
        clearcoat_roughness: 0.0,
        sheen: 0.0,
        transmission: 0.0,
        ior: 1.5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The specification's example: "only the lower left quadrant of the source image, rotated clockwise 90°".
    #[test]
    fn images_turn_clockwise() {
        let [row_u, row_v] = uv_map([0.0, 1.0], std::f32::consts::FRAC_PI_2, [0.5, 0.5]);
        let shown = |[u, v]: [f32; 2]| [row_u, row_v].map(|[a, b, c]| a * u + b * v + c);
        // Upper left, upper right, lower right and lower left of what wears it, v upwards; and what of the image is there.
        let corners = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
        for (corner, [u, v]) in corners.into_iter().zip([[0.0, 0.0], [0.0, 0.5], [0.5, 0.5], [0.5, 0.0]]) {
            let found = shown(corner);
            assert!((found[0] - u).abs() < 1e-6 && (found[1] - v).abs() < 1e-6, "{corner:?}: {found:?} for {u}, {v}");
        }
    }
}
