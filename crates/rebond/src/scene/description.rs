//! A scene as plain data: what a scene file, an importer or a program writes, and the only way to make a
//! [`Scene`](super::Scene).
//!
//! The parameters carry the names of Mitsuba 3 or pbrt-v4 where those have one. A tagged enum such as
//! [`MaterialDescription`] is written as a table with a `type` key. Lengths are metres, angles degrees, colours linear
//! Rec. 709; [`Color`] may be one number, for grey.

use crate::emitter::LightChoice;
use crate::film::{Aov, FilterSettings};
use crate::integrators::IntegratorSettings;
use crate::sampling::SamplerSettings;
use crate::texture::{Encoding, TextureFilter, UvMap, Wrap};
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// A whole scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneDescription {
    /// A sentence about the scene.
    pub title: String,
    /// Where it is seen from.
    pub camera: CameraDescription,
    /// What the picture is made of.
    pub film: FilmDescription,
    /// Sample values.
    pub sampler: SamplerSettings,
    /// How an emitter is chosen to light a point; by power if there are few, else by a tree, if not given.
    pub light_choice: Option<LightChoice>,
    /// Whether the eye sees no lights: its rays pass those that have a surface, and find no surroundings. They light the rest as before.
    #[serde(skip_serializing_if = "is_false")]
    pub hide_emitters: bool,
    /// The algorithm to use unless another is asked for.
    pub integrator: IntegratorSettings,
    /// Materials by name.
    pub materials: BTreeMap<String, MaterialDescription>,
    /// Groups of shapes by name, which only `instance` shapes put into the scene.
    pub groups: BTreeMap<String, Vec<ShapeDescription>>,
    /// Surfaces.
    pub shapes: Vec<ShapeDescription>,
    /// Lights that are not surfaces.
    pub emitters: Vec<EmitterDescription>,
}

fn is_false(flag: &bool) -> bool {
    !flag
}

/// Size and filter of the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilmDescription {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Reconstruction filter.
    pub filter: FilterSettings,
    /// What camera rays meet, in layers beside the picture.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub aovs: Vec<Aov>,
}

impl Default for FilmDescription {
    fn default() -> Self {
        Self { width: 512, height: 512, filter: FilterSettings::default(), aovs: Vec::new() }
    }
}

/// Along which side of the picture a field of view is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FovAxis {
    /// The width.
    #[default]
    X,
    /// The height.
    Y,
    /// The shorter.
    Smaller,
    /// The longer.
    Larger,
}

/// A camera. It looks along its local +z with +y up (and, as in Mitsuba, +x to the left).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum CameraDescription {
    /// A pinhole.
    Perspective {
        /// Where it stands.
        #[serde(default)]
        to_world: Transform,
        /// Field of view, degrees.
        #[serde(default = "default_fov")]
        fov: f32,
        /// What `fov` measures.
        #[serde(default)]
        fov_axis: FovAxis,
        /// How far the picture is moved, in its width to the right and its height downwards: what is on the axis is off its centre by as
        /// much the other way.
        #[serde(default)]
        principal_point_offset: [f32; 2],
        /// Distance along the axis before which nothing is seen.
        #[serde(default)]
        near_clip: f32,
        /// Time at which the shutter opens.
        #[serde(default)]
        shutter_open: f32,
        /// Time at which the shutter closes.
        #[serde(default)]
        shutter_close: f32,
    },
    /// An ideal lens: depth of field.
    ThinLens {
        /// Where it stands.
        #[serde(default)]
        to_world: Transform,
        /// Field of view, degrees.
        #[serde(default = "default_fov")]
        fov: f32,
        /// What `fov` measures.
        #[serde(default)]
        fov_axis: FovAxis,
        /// How far the picture is moved, in its width to the right and its height downwards: what is on the axis is off its centre by as
        /// much the other way.
        #[serde(default)]
        principal_point_offset: [f32; 2],
        /// Distance along the axis before which nothing is seen.
        #[serde(default)]
        near_clip: f32,
        /// Radius of the lens.
        aperture_radius: f32,
        /// Blades of its iris: the opening is a regular polygon with its corners at `aperture_radius`. Round if 0.
        #[serde(default)]
        aperture_blades: u32,
        /// Degrees by which the iris is turned, counter-clockwise as seen from behind the camera; at 0 a corner is on top.
        #[serde(default)]
        aperture_rotation: f32,
        /// Distance along the axis that is in focus.
        focus_distance: f32,
        /// Time at which the shutter opens.
        #[serde(default)]
        shutter_open: f32,
        /// Time at which the shutter closes.
        #[serde(default)]
        shutter_close: f32,
    },
    /// Parallel rays; the picture is as wide as 2 units of local x, as in Mitsuba: scale `to_world` for more.
    Orthographic {
        /// Where it stands, and how wide it is.
        #[serde(default)]
        to_world: Transform,
        /// Time at which the shutter opens.
        #[serde(default)]
        shutter_open: f32,
        /// Time at which the shutter closes.
        #[serde(default)]
        shutter_close: f32,
    },
}

fn default_fov() -> f32 {
    45.0
}

impl Default for CameraDescription {
    fn default() -> Self {
        Self::Perspective {
            to_world: Transform::default(),
            fov: default_fov(),
            fov_axis: FovAxis::X,
            principal_point_offset: [0.0; 2],
            near_clip: 0.0,
            shutter_open: 0.0,
            shutter_close: 0.0,
        }
    }
}

/// A linear Rec. 709 colour, written as `[r, g, b]` or as one number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Color(pub [f32; 3]);

/// An image spread over a surface's UV coordinates, (0, 0) at its lower left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageTexture {
    /// File, relative to the scene's.
    pub image: String,
    /// Meaning of its numbers.
    #[serde(default)]
    pub encoding: Encoding,
    /// Outside the unit square.
    #[serde(default)]
    pub wrap: Wrap,
    /// The same along v, if it is otherwise than along u.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wrap_v: Option<Wrap>,
    /// Between texels.
    #[serde(default)]
    pub filter: TextureFilter,
    /// How often it repeats along u and v.
    #[serde(default = "one_by_one")]
    pub repeat: [f32; 2],
    /// Two rows of a matrix that is applied to (u, v, 1) before all that: turns it, moves it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_uv: Option<UvMap>,
    /// One channel alone: a grey image of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
}

/// A channel of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
}

fn one_by_one() -> [f32; 2] {
    [1.0, 1.0]
}

/// What a mesh knows of its vertices, which is interpolated between them, or of its faces.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AttributeTexture {
    /// The mesh's name for it, which starts with `vertex_` or `face_`.
    pub attribute: String,
    /// Factor on it.
    #[serde(skip_serializing_if = "is_white")]
    pub scale: Color,
    /// An image that it is multiplied with.
    #[serde(flatten)]
    pub image: Option<ImageTexture>,
}

fn is_white(c: &Color) -> bool {
    *c == white_light()
}

/// A colour that may vary over a surface: a [`Color`], or a table of an [`ImageTexture`] or an [`AttributeTexture`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Texture {
    /// The same everywhere.
    Constant(Color),
    /// An image.
    Image(ImageTexture),
    /// What a mesh knows.
    Attribute(AttributeTexture),
}

/// The keys of an image and of an attribute.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TextureTable {
    image: Option<String>,
    encoding: Option<Encoding>,
    wrap: Option<Wrap>,
    wrap_v: Option<Wrap>,
    filter: Option<TextureFilter>,
    repeat: Option<[f32; 2]>,
    to_uv: Option<UvMap>,
    channel: Option<Channel>,
    attribute: Option<String>,
    scale: Option<Color>,
}

/// One or the other, or both.
enum Varying {
    Image(ImageTexture),
    Attribute(AttributeTexture),
}

impl TextureTable {
    fn sorted<E: de::Error>(self) -> Result<Varying, E> {
        let Self { image, encoding, wrap, wrap_v, filter, repeat, to_uv, channel, attribute, scale } = self;
        let of_image = [
            ("encoding", encoding.is_some()),
            ("wrap", wrap.is_some()),
            ("wrap_v", wrap_v.is_some()),
            ("filter", filter.is_some()),
            ("repeat", repeat.is_some()),
            ("to_uv", to_uv.is_some()),
            ("channel", channel.is_some()),
        ];
        if let (None, Some(_), Some((key, _))) = (&image, &attribute, of_image.iter().find(|(_, given)| *given)) {
            return Err(E::custom(format!("`{key}` is for an `image`")));
        }
        let image = image.map(|image| ImageTexture {
            image,
            encoding: encoding.unwrap_or_default(),
            wrap: wrap.unwrap_or_default(),
            wrap_v,
            filter: filter.unwrap_or_default(),
            repeat: repeat.unwrap_or(one_by_one()),
            to_uv,
            channel,
        });
        match (attribute, image, scale) {
            (Some(attribute), image, scale) => {
                Ok(Varying::Attribute(AttributeTexture { attribute, scale: scale.unwrap_or(white_light()), image }))
            }
            (None, Some(_), Some(_)) => Err(E::custom("`scale` is for an `attribute`")),
            (None, Some(image), None) => Ok(Varying::Image(image)),
            (None, None, _) => Err(E::missing_field("image")),
        }
    }
}

impl Texture {
    /// The grey of this value.
    pub fn grey(x: f32) -> Self {
        Self::Constant(Color([x; 3]))
    }
}

/// A number in [0, 1] that may vary over a surface: a number, or a table of an [`ImageTexture`], which is taken as it is, by its
/// luminance or one `channel`, or of an [`AttributeTexture`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum NumberTexture {
    /// The same everywhere.
    Constant(f32),
    /// An image.
    Image(ImageTexture),
    /// What a mesh knows.
    Attribute(AttributeTexture),
}

impl NumberTexture {
    /// The number, if it is the same everywhere.
    pub fn constant(&self) -> Option<f32> {
        match self {
            Self::Constant(x) => Some(*x),
            Self::Image(_) | Self::Attribute(_) => None,
        }
    }
}

impl From<f32> for NumberTexture {
    fn from(x: f32) -> Self {
        Self::Constant(x)
    }
}

fn zero() -> NumberTexture {
    NumberTexture::Constant(0.0)
}

fn half_texture() -> NumberTexture {
    NumberTexture::Constant(0.5)
}

fn half() -> Texture {
    Texture::grey(0.5)
}

fn half_number() -> f32 {
    0.5
}

fn five_percent() -> Color {
    Color([0.05; 3])
}

fn eighty_percent() -> Texture {
    Texture::grey(0.8)
}

fn tenth() -> NumberTexture {
    NumberTexture::Constant(0.1)
}

fn three_percent() -> f32 {
    0.03
}

fn white() -> Texture {
    Texture::grey(1.0)
}

/// Which form of a lobe of the lecture to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LobeForm {
    /// The energy-conserving one.
    #[default]
    Energy,
    /// As the lecture prints it.
    Lecture,
}

/// Distributions of facets of rough metal and glass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distribution {
    /// GGX, or Trowbridge and Reitz's.
    #[default]
    Ggx,
    /// Beckmann's, of Gaussian slopes.
    Beckmann,
}

/// How facets of rough metal and glass hide each other from both directions, after Smith.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Masking {
    /// What stands high is seen better from both.
    #[default]
    Correlated,
    /// From each independently, as in Mitsuba: a little darker where facets are rough.
    Separable,
}

/// A metal whose complex index of refraction is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metal {
    /// Ag.
    Silver,
    /// Al.
    Aluminium,
    /// Au.
    Gold,
    /// Cu.
    Copper,
}

/// A material given in place, or the name of one in [`SceneDescription::materials`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum MaterialRef {
    /// By name.
    Named(String),
    /// In place.
    Inline(Box<MaterialDescription>),
}

/// How a surface scatters light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum MaterialDescription {
    /// Lambert's `ρ/π`.
    Diffuse {
        /// ρ.
        #[serde(default = "half")]
        reflectance: Texture,
    },
    /// A perfect mirror.
    Mirror {
        /// Share of light it reflects.
        #[serde(default = "white")]
        reflectance: Texture,
    },
    /// Glass, water and the like: smooth, or rough.
    Dielectric {
        /// Index of refraction inside (against the normal).
        #[serde(default = "glass")]
        int_ior: f32,
        /// Index of refraction outside.
        #[serde(default = "air")]
        ext_ior: f32,
        /// Roughness; 0, which is smooth, if not given.
        #[serde(default)]
        alpha: Option<NumberTexture>,
        /// Roughness along the tangent, in place of `alpha`.
        #[serde(default)]
        alpha_u: Option<NumberTexture>,
        /// Roughness across the tangent, in place of `alpha`.
        #[serde(default)]
        alpha_v: Option<NumberTexture>,
        /// How facets are distributed.
        #[serde(default)]
        distribution: Distribution,
        /// How they hide each other.
        #[serde(default)]
        masking: Masking,
        /// Factor on all it scatters; 1 for what is physical.
        #[serde(default = "white")]
        tint: Texture,
    },
    /// Metal: smooth, or rough.
    Conductor {
        /// Take η and k of this metal.
        #[serde(default)]
        metal: Option<Metal>,
        /// Real part of the index of refraction, per channel.
        #[serde(default)]
        eta: Option<Color>,
        /// Imaginary part.
        #[serde(default)]
        k: Option<Color>,
        /// Roughness; 0, which is smooth, if not given.
        #[serde(default)]
        alpha: Option<NumberTexture>,
        /// Roughness along the tangent, in place of `alpha`.
        #[serde(default)]
        alpha_u: Option<NumberTexture>,
        /// Roughness across the tangent, in place of `alpha`.
        #[serde(default)]
        alpha_v: Option<NumberTexture>,
        /// How facets are distributed.
        #[serde(default)]
        distribution: Distribution,
        /// How they hide each other.
        #[serde(default)]
        masking: Masking,
        /// Factor on the reflectance; 1 for what is physical.
        #[serde(default = "white")]
        tint: Texture,
        /// Give back the light that the facets of rough metal exchange.
        #[serde(default)]
        compensate: bool,
    },
    /// Phong's lobe around the mirror direction.
    Phong {
        /// ρ.
        #[serde(default = "half")]
        reflectance: Texture,
        /// r.
        exponent: f32,
        /// Which form.
        #[serde(default)]
        form: LobeForm,
    },
    /// Blinn and Phong's lobe of the half vector.
    BlinnPhong {
        /// ρ.
        #[serde(default = "half")]
        reflectance: Texture,
        /// r.
        exponent: f32,
        /// Which form.
        #[serde(default)]
        form: LobeForm,
    },
    /// Oren and Nayar's rough diffuse surface, in its energy-preserving form.
    OrenNayar {
        /// ρ.
        #[serde(default = "half")]
        reflectance: Texture,
        /// Roughness in [0, 1]; 0 is Lambert's.
        #[serde(default = "half_number")]
        roughness: f32,
    },
    /// Ashikhmin and Shirley's anisotropic lobe over a diffuse base.
    AshikhminShirley {
        /// Rd.
        #[serde(default = "half")]
        diffuse_reflectance: Texture,
        /// Rs, the lobe's at normal incidence.
        #[serde(default = "five_percent")]
        specular_reflectance: Color,
        /// Exponent along the tangent.
        exponent_u: f32,
        /// Exponent across the tangent.
        exponent_v: f32,
    },
    /// A pane of glass without thickness.
    ThinDielectric {
        /// Index of refraction inside.
        #[serde(default = "glass")]
        int_ior: f32,
        /// Index of refraction outside.
        #[serde(default = "air")]
        ext_ior: f32,
        /// Factor on all it scatters; 1 for what is physical.
        #[serde(default = "white")]
        tint: Texture,
    },
    /// A diffuse base under a coat: plastic, varnish.
    Plastic {
        /// ρ of the base.
        #[serde(default = "half")]
        diffuse_reflectance: Texture,
        /// Index of refraction of the coat.
        #[serde(default = "glass")]
        int_ior: f32,
        /// Index of refraction outside.
        #[serde(default = "air")]
        ext_ior: f32,
        /// GGX roughness of the coat.
        #[serde(default = "tenth")]
        alpha: NumberTexture,
        /// Whether light that the coat throws back to the base is coloured again.
        #[serde(default)]
        nonlinear: bool,
    },
    /// Metal, plastic or glass under sheen and clearcoat, in the terms of glTF and Blender.
    Principled {
        /// Colour of the base.
        #[serde(default = "eighty_percent")]
        base_color: Texture,
        /// 0 for plastic or glass, 1 for metal.
        #[serde(default = "zero")]
        metallic: NumberTexture,
        /// Roughness of the base; α is its square.
        #[serde(default = "half_texture")]
        roughness: NumberTexture,
        /// How much the base is brushed along its tangent, in [0, 1].
        #[serde(default)]
        anisotropic: f32,
        /// Strength of the reflection of what is no metal; 0.5 for what `ior` says.
        #[serde(default = "half_number")]
        specular: f32,
        /// Weight of a clear varnish over all.
        #[serde(default)]
        clearcoat: f32,
        /// Its roughness.
        #[serde(default = "three_percent")]
        clearcoat_roughness: f32,
        /// Weight of light that grazes the fibres of a cloth.
        #[serde(default)]
        sheen: f32,
        /// 0 for plastic, 1 for glass.
        #[serde(default)]
        transmission: f32,
        /// Index of refraction inside.
        #[serde(default = "glass")]
        ior: f32,
    },
    /// A sheet without thickness, such as a leaf or paper: the thin form of Disney's BSDF. The same from both sides.
    PrincipledThin {
        /// Its colour.
        #[serde(default = "eighty_percent")]
        base_color: Texture,
        /// Roughness; α is its square. What passes is less rough, up to an index of 2.07.
        #[serde(default = "half_texture")]
        roughness: NumberTexture,
        /// How much it is brushed along its tangent, in [0, 1].
        #[serde(default)]
        anisotropic: f32,
        /// 0 for a diffuse sheet, 1 for one that reflects and passes light as glass does.
        #[serde(default)]
        transmission: f32,
        /// Index of refraction.
        #[serde(default = "glass")]
        ior: f32,
        /// How much the colour tints what a sheet of glass reflects.
        #[serde(default)]
        specular_tint: f32,
        /// Share of a diffuse sheet's light that passes it, in [0, 1].
        #[serde(default)]
        diffuse_transmission: f32,
        /// How flat a diffuse sheet looks, as if light travelled within it.
        #[serde(default)]
        flatness: f32,
        /// Weight of light that grazes its fibres.
        #[serde(default)]
        sheen: f32,
        /// How much the colour tints that.
        #[serde(default)]
        sheen_tint: f32,
    },
    /// What was measured, or captured from another material: a `.safetensors` table of rebond's, MERL's `.binary` or RGL's
    /// `.bsdf`.
    Measured {
        /// File, relative to the scene's.
        file: String,
    },
    /// A share `weight` of `b`, the rest of `a`; linear in f_r.
    Mix {
        /// The material at weight 0.
        a: MaterialRef,
        /// The material at weight 1.
        b: MaterialRef,
        /// Share of `b`, in [0, 1].
        weight: f32,
    },
    /// A material with holes: light passes straight through where it is not opaque.
    Mask {
        /// Share of light that meets the material, in [0, 1]. Images are taken as they are, by their luminance, and want a
        /// mesh.
        opacity: Texture,
        /// The material where it is opaque.
        material: MaterialRef,
    },
    /// A material that shines as well, in the colours of an image: of meshes and rectangles, to the side of their normals.
    Glow {
        /// Radiance, W·sr⁻¹·m⁻².
        radiance: ImageTexture,
        /// Factor on it.
        #[serde(default = "white_light")]
        scale: Color,
        /// How it scatters light.
        material: MaterialRef,
    },
    /// A material whose shading normals are those of an image: (2r − 1, 2g − 1, 2b − 1) along ∂p/∂u, ∂p/∂v and the normal.
    NormalMap {
        /// The image; taken as it is.
        normal_map: ImageTexture,
        /// Factor on the tilt.
        #[serde(default = "unit_radius")]
        scale: f32,
        /// What the surface is made of.
        material: MaterialRef,
    },
    /// A material whose shading normals are those of a relief.
    BumpMap {
        /// Heights, by the luminance of an image; taken as it is.
        bump_map: ImageTexture,
        /// Height of white over black.
        scale: f32,
        /// What the surface is made of.
        material: MaterialRef,
    },
    /// The same from both sides, or another one behind. Other opaque materials are black from behind.
    TwoSided {
        /// The material in front.
        front: MaterialRef,
        /// The material behind; as in front if not given.
        #[serde(default)]
        back: Option<MaterialRef>,
    },
}

fn white_light() -> Color {
    Color([1.0; 3])
}

fn glass() -> f32 {
    1.5
}

fn air() -> f32 {
    1.0
}

/// One step of a [`Transform`]; exactly one key is given.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransformStep {
    /// Move.
    pub translate: Option<[f32; 3]>,
    /// Scale by one factor or one per axis.
    pub scale: Option<Color>,
    /// Turn.
    pub rotate: Option<Rotate>,
    /// Stand at `origin`, +z towards `target`.
    pub look_at: Option<LookAt>,
    /// Any affine matrix, three or four rows of four.
    pub matrix: Option<Vec<[f32; 4]>>,
    /// A motion: where things are at two or more times.
    pub keyframes: Option<Vec<Keyframe>>,
}

/// A rotation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotate {
    /// Around this axis.
    pub axis: [f32; 3],
    /// By this many degrees.
    pub angle: f32,
}

/// A point of view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LookAt {
    /// From here.
    pub origin: [f32; 3],
    /// To there.
    pub target: [f32; 3],
    /// With this direction upwards.
    pub up: [f32; 3],
}

/// Where a moving thing is at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Keyframe {
    /// When.
    pub time: f32,
    /// Where; without keyframes of its own.
    #[serde(default)]
    pub to_world: Transform,
}

/// Steps applied one after the other, the first first. Written as a list of steps, or as a single one.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Transform(pub Vec<TransformStep>);

macro_rules! shape {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $type,)*
            /// How it scatters light; diffuse of reflectance 0.5 if not given.
            #[serde(default)]
            pub material: Option<MaterialRef>,
            /// Radiance it emits, to the side of its normal, W·sr⁻¹·m⁻².
            #[serde(default)]
            pub emission: Option<Color>,
            /// Where it is.
            #[serde(default)]
            pub to_world: Transform,
        }
    };
}

shape! {
    /// Triangles given in place.
    Mesh {
        /// Corners.
        positions: Vec<[f32; 3]>,
        /// Places in `positions`, three for a triangle or four for a quadrilateral, counter-clockwise seen from the
        /// side of the normal.
        faces: Vec<Vec<u32>>,
        /// Normal at each position, for smooth shading.
        #[serde(default)]
        normals: Option<Vec<[f32; 3]>>,
        /// Texture coordinates at each position.
        #[serde(default)]
        uvs: Option<Vec<[f32; 2]>>,
        /// What else is known of each position or face, by names that start with `vertex_` or `face_`.
        #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
        attributes: BTreeMap<String, Vec<Color>>,
    }
}
shape! {
    /// Triangles in a file.
    MeshFile {
        /// File, relative to the scene's.
        file: String,
        /// Ignore the file's normals.
        #[serde(default)]
        face_normals: bool,
        /// If the file has no normals, take at each vertex the mean of its faces', by their angles there.
        #[serde(default)]
        smooth_normals: bool,
        /// Normals, and so emission, point the other way.
        #[serde(default)]
        flip_normals: bool,
    }
}
shape! {
    /// A sphere, exact.
    Sphere {
        /// Centre.
        #[serde(default)]
        center: [f32; 3],
        /// Radius.
        #[serde(default = "unit_radius")]
        radius: f32,
        /// Normals, and so emission, point inwards.
        #[serde(default)]
        flip_normals: bool,
    }
}
shape! {
    /// The square from (−1, −1, 0) to (1, 1, 0), the unit disk, or the cube from (−1, −1, −1) to (1, 1, 1); the normal
    /// of the flat ones is +z.
    Simple {
        /// Normals, and so emission, point the other way.
        #[serde(default)]
        flip_normals: bool,
    }
}

/// A group of shapes, placed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstanceDescription {
    /// Name of the group.
    pub group: String,
    /// Where it is.
    #[serde(default)]
    pub to_world: Transform,
}

fn unit_radius() -> f32 {
    1.0
}

/// A surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShapeDescription {
    /// Triangles given in place.
    Mesh(Mesh),
    /// A Wavefront OBJ file.
    Obj(MeshFile),
    /// A PLY file.
    Ply(MeshFile),
    /// A sphere.
    Sphere(Sphere),
    /// The square from (−1, −1, 0) to (1, 1, 0).
    Rectangle(Simple),
    /// The unit disk, normal +z.
    Disk(Simple),
    /// The cube from (−1, −1, −1) to (1, 1, 1).
    Cube(Simple),
    /// A group of shapes, placed.
    Instance(InstanceDescription),
}

/// A light that is not a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum EmitterDescription {
    /// A point that shines alike in all directions.
    Point {
        /// Where.
        position: [f32; 3],
        /// What moves it.
        #[serde(default)]
        to_world: Transform,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Color,
    },
    /// A point that shines into a cone around its local +z.
    Spot {
        /// Where it stands and points.
        to_world: Transform,
        /// Radiant intensity on the axis, W·sr⁻¹.
        intensity: Color,
        /// Half-angle beyond which there is no light, degrees.
        #[serde(default = "default_cutoff")]
        cutoff_angle: f32,
        /// Half-angle up to which the intensity is full; three quarters of the cutoff if not given. Between them it
        /// falls linearly with the angle.
        #[serde(default)]
        beam_width: Option<f32>,
    },
    /// A point that shines through an image, which stands across its local +z as a camera there would see it: its upper left corner is
    /// towards +x and +y.
    Projector {
        /// Where it stands and points.
        to_world: Transform,
        /// File, relative to the scene's.
        file: String,
        /// Meaning of its numbers.
        #[serde(default)]
        encoding: Encoding,
        /// Between texels.
        #[serde(default)]
        filter: TextureFilter,
        /// What is interpolated with at the image's edges: themselves (`clamp`), or those on the other side (`repeat`).
        #[serde(default = "clamp")]
        wrap: Wrap,
        /// Field of view across the image's width, degrees.
        #[serde(default = "default_fov")]
        fov: f32,
        /// Width over height; that of the image if not given.
        #[serde(default)]
        aspect: Option<f32>,
        /// Radiant intensity on the axis where the image is white, W·sr⁻¹.
        intensity: Color,
        /// Whether a wall that it faces receives what the image says: the intensity grows as 1/cos³ of the angle to the axis.
        #[serde(default)]
        even: bool,
        /// Half-angle beyond which there is no light, degrees; as far as the image reaches if not given.
        #[serde(default)]
        cutoff_angle: Option<f32>,
        /// Half-angle up to which that takes nothing; three quarters of it if not given.
        #[serde(default)]
        beam_width: Option<f32>,
    },
    /// A point whose intensity over directions is an image of everywhere: equirectangular, its centre towards local −z, its top towards
    /// +y.
    Goniometric {
        /// Where it stands and how it is turned.
        #[serde(default)]
        to_world: Transform,
        /// File, relative to the scene's.
        file: String,
        /// Radiant intensity where the image is white, W·sr⁻¹.
        intensity: Color,
    },
    /// Parallel light, from infinitely far.
    Directional {
        /// Where the light goes.
        direction: [f32; 3],
        /// Irradiance on a surface that faces it, W·m⁻².
        irradiance: Color,
    },
    /// Parallel light from a surface that shines along its normal, local +z, only. It is light alone: a shape may stand where it starts.
    DirectionalArea {
        /// Where it stands and points, and how large it is.
        #[serde(default)]
        to_world: Transform,
        /// Its outline.
        #[serde(default)]
        shape: Outline,
        /// Irradiance on a surface that faces it, W·m⁻².
        irradiance: Color,
    },
    /// The same radiance from everywhere.
    Constant {
        /// Radiance, W·sr⁻¹·m⁻².
        radiance: Color,
    },
    /// An image of everywhere: equirectangular, its centre towards local −z, its top towards +y.
    Envmap {
        /// File, relative to the scene's.
        file: String,
        /// Factor.
        #[serde(default = "unit_radius")]
        scale: f32,
        /// Exponent of a lobe (r+1)/2π cosʳ to blur it with; sharp if not given.
        #[serde(default)]
        blur: Option<f32>,
        /// How it is turned.
        #[serde(default)]
        to_world: Transform,
    },
}

/// Flat shapes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outline {
    /// The square from (−1, −1, 0) to (1, 1, 0).
    #[default]
    Rectangle,
    /// The unit disk.
    Disk,
}

fn clamp() -> Wrap {
    Wrap::Clamp
}

fn default_cutoff() -> f32 {
    20.0
}

/// Numbers: one, or exactly three.
struct ColorVisitor;

impl<'de> Visitor<'de> for ColorVisitor {
    type Value = Color;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number or three of them")
    }
    fn visit_f64<E: de::Error>(self, x: f64) -> Result<Color, E> {
        Ok(Color([x as f32; 3]))
    }
    fn visit_i64<E: de::Error>(self, x: i64) -> Result<Color, E> {
        self.visit_f64(x as f64)
    }
    fn visit_u64<E: de::Error>(self, x: u64) -> Result<Color, E> {
        self.visit_f64(x as f64)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Color, A::Error> {
        let mut c = [0.0; 3];
        for (i, x) in c.iter_mut().enumerate() {
            *x = seq.next_element()?.ok_or_else(|| de::Error::invalid_length(i, &self))?;
        }
        match seq.next_element::<f32>()? {
            None => Ok(Color(c)),
            Some(_) => Err(de::Error::invalid_length(4, &self)),
        }
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(ColorVisitor)
    }
}

impl<'de> Deserialize<'de> for Texture {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct TextureVisitor;
        impl<'de> Visitor<'de> for TextureVisitor {
            type Value = Texture;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a number, three of them, or a table with an `image` or an `attribute`")
            }
            fn visit_f64<E: de::Error>(self, x: f64) -> Result<Texture, E> {
                ColorVisitor.visit_f64(x).map(Texture::Constant)
            }
            fn visit_i64<E: de::Error>(self, x: i64) -> Result<Texture, E> {
                ColorVisitor.visit_i64(x).map(Texture::Constant)
            }
            fn visit_u64<E: de::Error>(self, x: u64) -> Result<Texture, E> {
                ColorVisitor.visit_u64(x).map(Texture::Constant)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Texture, A::Error> {
                ColorVisitor.visit_seq(seq).map(Texture::Constant)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Texture, A::Error> {
                Ok(match TextureTable::deserialize(MapAccessDeserializer::new(map))?.sorted()? {
                    Varying::Image(image) => Texture::Image(image),
                    Varying::Attribute(attribute) => Texture::Attribute(attribute),
                })
            }
        }
        d.deserialize_any(TextureVisitor)
    }
}

impl<'de> Deserialize<'de> for NumberTexture {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct NumberVisitor;
        impl<'de> Visitor<'de> for NumberVisitor {
            type Value = NumberTexture;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a number, or a table with an `image` or an `attribute`")
            }
            fn visit_f64<E: de::Error>(self, x: f64) -> Result<NumberTexture, E> {
                Ok(NumberTexture::Constant(x as f32))
            }
            fn visit_i64<E: de::Error>(self, x: i64) -> Result<NumberTexture, E> {
                Ok(NumberTexture::Constant(x as f32))
            }
            fn visit_u64<E: de::Error>(self, x: u64) -> Result<NumberTexture, E> {
                Ok(NumberTexture::Constant(x as f32))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<NumberTexture, A::Error> {
                Ok(match TextureTable::deserialize(MapAccessDeserializer::new(map))?.sorted()? {
                    Varying::Image(image) => NumberTexture::Image(image),
                    Varying::Attribute(attribute) => NumberTexture::Attribute(attribute),
                })
            }
        }
        d.deserialize_any(NumberVisitor)
    }
}

impl<'de> Deserialize<'de> for Transform {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct TransformVisitor;
        impl<'de> Visitor<'de> for TransformVisitor {
            type Value = Transform;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a step such as { translate = [x, y, z] }, or a list of steps")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Transform, A::Error> {
                let mut steps = Vec::new();
                while let Some(step) = seq.next_element()? {
                    steps.push(step);
                }
                Ok(Transform(steps))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Transform, A::Error> {
                TransformStep::deserialize(MapAccessDeserializer::new(map)).map(|step| Transform(vec![step]))
            }
        }
        d.deserialize_any(TransformVisitor)
    }
}

impl<'de> Deserialize<'de> for MaterialRef {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct RefVisitor;
        impl<'de> Visitor<'de> for RefVisitor {
            type Value = MaterialRef;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("the name of a material, or a table that describes one")
            }
            fn visit_str<E: de::Error>(self, name: &str) -> Result<MaterialRef, E> {
                Ok(MaterialRef::Named(name.to_string()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<MaterialRef, A::Error> {
                let description = MaterialDescription::deserialize(MapAccessDeserializer::new(map))?;
                Ok(MaterialRef::Inline(Box::new(description)))
            }
        }
        d.deserialize_any(RefVisitor)
    }
}
