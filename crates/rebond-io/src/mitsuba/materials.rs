//! BSDFs.

use super::textures::Lie;
use super::{Importer, Object, Property, Result, Spot, Use, Value, color, metals};
use crate::import::free_name;
use rebond::scene::description::{
    Color, Distribution, ImageTexture, Masking, MaterialDescription, MaterialRef, NumberTexture, Texture,
};
use std::rc::Rc;

/// Roughness that both programs take for smooth, or as good as.
const SMOOTH: f32 = 1e-3;

impl Importer {
    /// A material by reference: by name if it has an id, since several shapes may then wear it.
    pub fn material(&mut self, o: &Rc<Object>, at: &Spot, lie: Lie) -> Result<MaterialRef> {
        let key = (Rc::as_ptr(o), lie);
        if let Some(name) = self.named.get(&key) {
            return Ok(MaterialRef::Named(name.clone()));
        }
        let description = self.within(o, at, |me| me.describe(o, lie))?;
        let Some(id) = &o.id else { return Ok(MaterialRef::Inline(Box::new(description))) };
        // The same for another lie of textures, if it has none.
        let others = self.named.iter().filter(|((other, _), _)| *other == key.0).map(|(_, name)| name);
        let same = others.into_iter().find(|name| self.scene.materials.get(*name) == Some(&description)).cloned();
        let name = same.unwrap_or_else(|| free_name(id, "", |n| self.scene.materials.contains_key(n)));
        self.scene.materials.insert(name.clone(), description);
        self.places.note(format!("materials.{name}"), o.at.part());
        self.named.insert(key, name.clone());
        Ok(MaterialRef::Named(name))
    }

    fn describe(&mut self, o: &Rc<Object>, lie: Lie) -> Result<MaterialDescription> {
        use MaterialDescription as M;
        let description = match o.plugin.as_str() {
            "diffuse" => M::Diffuse { reflectance: self.texture(o, "reflectance", 0.5, lie)? },
            "conductor" => self.conductor(o, (None, [None, None], Distribution::Ggx), lie)?,
            "roughconductor" => {
                let distribution = self.distribution(o)?;
                let (alpha, both) = self.roughness(o, lie)?;
                self.conductor(o, (alpha, both, distribution), lie)?
            }
            "dielectric" => {
                let (int_ior, ext_ior) = self.indices(o, "bk7")?;
                let tint = self.tint(o, lie)?;
                M::Dielectric {
                    int_ior,
                    ext_ior,
                    alpha: None,
                    alpha_u: None,
                    alpha_v: None,
                    distribution: Distribution::Ggx,
                    masking: Masking::Correlated,
                    tint,
                }
            }
            "roughdielectric" => {
                let distribution = self.distribution(o)?;
                let (int_ior, ext_ior) = self.indices(o, "bk7")?;
                let (alpha, [alpha_u, alpha_v]) = self.roughness(o, lie)?;
                let (masking, tint) = (Masking::Separable, self.tint(o, lie)?);
                M::Dielectric { int_ior, ext_ior, alpha, alpha_u, alpha_v, distribution, masking, tint }
            }
            "thindielectric" => {
                let (int_ior, ext_ior) = self.indices(o, "bk7")?;
                M::ThinDielectric { int_ior, ext_ior, tint: self.tint(o, lie)? }
            }
            "plastic" | "roughplastic" => self.plastic(o, lie)?,
            "principled" => self.principled(o, lie)?,
            "principledthin" => self.principled_thin(o, lie)?,
            "blendbsdf" => {
                let weight = self.one_number(o, "weight", 0.5)?;
                let [a, b] = self.two(o, lie)?;
                M::Mix { a, b, weight }
            }
            "mask" => {
                let opacity = match o.get("opacity") {
                    None => Texture::grey(0.5),
                    Some(p) => match self.texture_of(p, lie, false)? {
                        Texture::Attribute(_) => {
                            self.unsupported(&p.at, "an attribute of a mesh for an opacity")?;
                            Texture::grey(0.5)
                        }
                        other => grey(other),
                    },
                };
                M::Mask { opacity, material: self.inner(o, lie)? }
            }
            "null" => {
                let material = MaterialRef::Inline(Box::new(M::Diffuse { reflectance: Texture::grey(0.0) }));
                M::Mask { opacity: Texture::grey(0.0), material }
            }
            "twosided" => {
                let parts = self.children(o, &["bsdf"])?;
                let mut sides =
                    parts.iter().map(|(part, at)| self.material(part, at, lie)).collect::<Result<Vec<_>>>()?;
                match (sides.pop(), sides.pop(), sides.is_empty()) {
                    (Some(front), None, _) => M::TwoSided { front, back: None },
                    (Some(back), Some(front), true) => M::TwoSided { front, back: Some(back) },
                    _ => return Err(self.error(&o.at, "a two-sided material has one BSDF, or one for each side")),
                }
            }
            "normalmap" => {
                self.grazing(o);
                let material = self.inner(o, lie)?;
                match o.get("normalmap") {
                    Some(p) => match self.texture_of(p, lie, false)? {
                        Texture::Image(normal_map) => M::NormalMap { normal_map, scale: 1.0, material },
                        _ => return self.wrong(p, "an image"),
                    },
                    None => return Err(self.error(&o.at, "the normalmap is missing")),
                }
            }
            "bumpmap" => {
                self.grazing(o);
                let scale = self.number_or(o, "scale", 1.0)?;
                let material = self.inner(o, lie)?;
                match self.height_map(o, lie)? {
                    Some(bump_map) => M::BumpMap { bump_map, scale, material },
                    None => return Err(self.error(&o.at, "the texture of heights is missing")),
                }
            }
            "measured" => {
                let Some((file, at)) = self.text(o, "filename")? else {
                    return Err(self.error(&o.at, "the filename is missing"));
                };
                M::Measured { file: self.find(&file, &at)? }
            }
            _ => {
                self.unknown_plugin(o)?;
                // Nothing more of it would be understood.
                return Ok(M::Diffuse { reflectance: Texture::grey(0.5) });
            }
        };
        self.finish(o)?;
        Ok(description)
    }

    /// What Mitsuba does with normals that point away from the viewer.
    fn grazing(&mut self, o: &Object) {
        self.passed_over(o, &["flip_invalid_normals", "use_shadowing_function"]);
        self.warn(&o.at, format!("at grazing angles a \"{}\" is treated otherwise", o.plugin));
    }

    fn height_map(&mut self, o: &Object, lie: Lie) -> Result<Option<ImageTexture>> {
        for p in &o.properties {
            if self.object(p)?.is_some_and(|t| t.tag == "texture") {
                return match self.texture_of(p.mark(), lie, false)? {
                    Texture::Image(image) => Ok(Some(image)),
                    _ => self.wrong(p, "an image"),
                };
            }
        }
        Ok(None)
    }

    /// The one BSDF within another.
    fn inner(&mut self, o: &Object, lie: Lie) -> Result<MaterialRef> {
        match &self.children(o, &["bsdf"])?[..] {
            [(part, at)] => self.material(part, at, lie),
            parts => Err(self.error(&o.at, format!("a {} has one BSDF within, not {}", o.plugin, parts.len()))),
        }
    }

    fn two(&mut self, o: &Object, lie: Lie) -> Result<[MaterialRef; 2]> {
        match &self.children(o, &["bsdf"])?[..] {
            [(a, at_a), (b, at_b)] => Ok([self.material(a, at_a, lie)?, self.material(b, at_b, lie)?]),
            parts => Err(self.error(&o.at, format!("a {} has two BSDFs within, not {}", o.plugin, parts.len()))),
        }
    }

    /// `int_ior` and `ext_ior`, numbers or names.
    fn indices(&self, o: &Object, inside: &str) -> Result<(f32, f32)> {
        let index = |name: &str, default: &str| match o.get(name) {
            None => Ok(metals::dielectric(default).unwrap_or(1.0)),
            Some(Property { value: Value::Number(x), .. }) => Ok(*x as f32),
            Some(Property { value: Value::Text(word), at, .. }) => metals::dielectric(word).ok_or_else(|| {
                let error = self.error(at, format!("no index of refraction is known for \"{word}\""));
                error.with_help(format!("known are: {}", metals::dielectric_names().join(", ")))
            }),
            Some(p) => self.wrong(p, "a number or a name"),
        };
        Ok((index("int_ior", inside)?, index("ext_ior", "air")?))
    }

    fn distribution(&mut self, o: &Object) -> Result<Distribution> {
        self.passed_over(o, &["sample_visible"]);
        match self.text(o, "distribution")? {
            None => Ok(Distribution::Beckmann),
            Some((word, at)) => match word.as_str() {
                "ggx" => Ok(Distribution::Ggx),
                "beckmann" => Ok(Distribution::Beckmann),
                _ => Err(self.error(&at, format!("no distribution \"{word}\": ggx or beckmann"))),
            },
        }
    }

    /// One α, or one for each direction.
    fn roughness(&mut self, o: &Object, lie: Lie) -> Result<(Option<NumberTexture>, [Option<NumberTexture>; 2])> {
        if o.has("alpha_u") || o.has("alpha_v") {
            let along = self.number_texture(o, "alpha_u", 0.1, SMOOTH, lie)?;
            let across = self.number_texture(o, "alpha_v", 0.1, SMOOTH, lie)?;
            return Ok((None, [Some(along), Some(across)]));
        }
        Ok((Some(self.number_texture(o, "alpha", 0.1, SMOOTH, lie)?), [None, None]))
    }

    fn conductor(
        &mut self,
        o: &Object,
        (alpha, [alpha_u, alpha_v], distribution): (Option<NumberTexture>, [Option<NumberTexture>; 2], Distribution),
        lie: Lie,
    ) -> Result<MaterialDescription> {
        let tint = self.texture(o, "specular_reflectance", 1.0, lie)?;
        let (eta, k) = match (self.text(o, "material")?, o.get("eta"), o.get("k")) {
            (Some((name, at)), None, None) => metals::index(&name).ok_or_else(|| {
                let error = self.error(&at, format!("no metal \"{name}\" is known"));
                error.with_help(format!("known are: none, {}", metals::names().join(", ")))
            })?,
            (None, None, None) => ([0.0; 3], [1.0; 3]),
            (None, eta, k) => {
                let mut part = |p: Option<&Property>, default: f64| match p {
                    None => Ok([default; 3]),
                    Some(p) => match self.color(p, Use::Unbounded)? {
                        Some(c) => Ok(c),
                        None => {
                            self.unsupported(&p.at, format!("a texture for \"{}\"", p.name))?;
                            Ok([default; 3])
                        }
                    },
                };
                let (eta, k) = (part(eta, 0.0)?, part(k, 1.0)?);
                (color(eta).0, color(k).0)
            }
            (Some((_, at)), ..) => return Err(self.error(&at, "either a material, or eta and k")),
        };
        let smooth = alpha.as_ref().is_none_or(|a| *a == NumberTexture::Constant(0.0)) && alpha_u.is_none();
        if eta == [0.0; 3] && smooth {
            return Ok(MaterialDescription::Mirror { reflectance: tint });
        }
        Ok(MaterialDescription::Conductor {
            metal: None,
            eta: Some(Color(eta)),
            k: Some(Color(k)),
            alpha,
            alpha_u,
            alpha_v,
            distribution,
            masking: if smooth { Masking::Correlated } else { Masking::Separable },
            tint,
            compensate: false,
        })
    }

    /// One factor for what is reflected and what passes.
    fn tint(&mut self, o: &Object, lie: Lie) -> Result<Texture> {
        let reflected = self.texture(o, "specular_reflectance", 1.0, lie)?;
        let passed = self.texture(o, "specular_transmittance", 1.0, lie)?;
        if reflected != passed {
            self.unsupported(
                &o.at,
                format!("a {} that tints what it reflects otherwise than what passes it", o.plugin),
            )?;
        }
        Ok(passed)
    }

    fn plastic(&mut self, o: &Object, lie: Lie) -> Result<MaterialDescription> {
        let (int_ior, ext_ior) = self.indices(o, "polypropylene")?;
        let diffuse_reflectance = self.texture(o, "diffuse_reflectance", 0.5, lie)?;
        let nonlinear = self.flag(o, "nonlinear", false)?;
        let mut alpha = NumberTexture::Constant(SMOOTH);
        if o.plugin == "roughplastic" {
            // The coat is GGX in any case, as is said below.
            self.passed_over(o, &["sample_visible"]);
            match self.text(o, "distribution")? {
                Some((word, at)) if !matches!(word.as_str(), "ggx" | "beckmann") => {
                    return Err(self.error(&at, format!("no distribution \"{word}\": ggx or beckmann")));
                }
                _ => {}
            }
            alpha = self.one_number(o, "alpha", 0.1)?.max(SMOOTH).into();
        }
        if let Some(p) = o.get("specular_reflectance")
            && self.color(p, Use::Reflectance)? != Some([1.0; 3])
        {
            self.unsupported(&p.at, "a tint of what plastic reflects")?;
        }
        self.warn(&o.at, format!("\"{}\" is rendered as rebond's own plastic, which is nearly the same", o.plugin));
        Ok(MaterialDescription::Plastic { diffuse_reflectance, int_ior, ext_ior, alpha, nonlinear })
    }

    fn principled(&mut self, o: &Object, lie: Lie) -> Result<MaterialDescription> {
        let base_color = self.texture(o, "base_color", 0.5, lie)?;
        let metallic = self.number_texture(o, "metallic", 0.0, 0.0, lie)?;
        let roughness = self.number_texture(o, "roughness", 0.5, 0.0, lie)?;
        let anisotropic = self.one_number(o, "anisotropic", 0.0)?;
        let transmission = self.one_number(o, "spec_trans", 0.0)?;
        let clearcoat = self.one_number(o, "clearcoat", 0.0)?;
        let gloss = self.one_number(o, "clearcoat_gloss", 0.0)?;
        let sheen = self.one_number(o, "sheen", 0.0)?;
        // `eta` and `specular` say the same: η = 2 / (1 − √(0.08 s)) − 1.
        let ior = match (self.number(o, "eta")?, self.number(o, "specular")?) {
            (Some(eta), None) => eta as f32,
            (None, specular) => 2.0 / (1.0 - (0.08 * specular.unwrap_or(0.5) as f32).sqrt()) - 1.0,
            (Some(_), Some(_)) => return Err(self.error(&o.at, "either eta or specular, not both")),
        };
        for name in ["spec_tint", "sheen_tint", "flatness"] {
            if self.one_number(o, name, 0.0)? != 0.0
                && let Some(p) = o.get(name)
            {
                self.unsupported(&p.at, format!("the \"{name}\" of a principled BSDF"))?;
            }
        }
        self.passed_over(
            o,
            &["main_specular_sampling_rate", "clearcoat_sampling_rate", "diffuse_reflectance_sampling_rate"],
        );
        self.warn(&o.at, "\"principled\" is rendered as rebond's own model of that name: highlights, sheen and coats differ a little");
        // Burley's coat is of α from 0.1 to 0.001 and a quarter as strong as a varnish.
        let clearcoat_roughness = (0.1 + (0.001 - 0.1) * gloss).max(0.0).sqrt();
        Ok(MaterialDescription::Principled {
            base_color,
            metallic,
            roughness,
            anisotropic,
            specular: 0.5,
            clearcoat: 0.25 * clearcoat,
            clearcoat_roughness,
            sheen,
            transmission,
            ior,
        })
    }

    fn principled_thin(&mut self, o: &Object, lie: Lie) -> Result<MaterialDescription> {
        let base_color = self.texture(o, "base_color", 0.5, lie)?;
        let roughness = self.number_texture(o, "roughness", 0.5, 0.0, lie)?;
        let anisotropic = self.one_number(o, "anisotropic", 0.0)?;
        let transmission = self.one_number(o, "spec_trans", 0.0)?;
        let ior = self.one_number(o, "eta", 1.5)?;
        let specular_tint = self.one_number(o, "spec_tint", 0.0)?;
        let diffuse_transmission = self.one_number(o, "diff_trans", 0.0)? / 2.0;
        let flatness = self.one_number(o, "flatness", 0.0)?;
        let sheen = self.one_number(o, "sheen", 0.0)?;
        let sheen_tint = self.one_number(o, "sheen_tint", 0.0)?;
        self.passed_over(
            o,
            &[
                "specular_reflectance_sampling_rate",
                "specular_transmittance_sampling_rate",
                "diffuse_reflectance_sampling_rate",
                "diffuse_transmittance_sampling_rate",
            ],
        );
        // Mitsuba wants both directions on their sides of the facet that would reflect one to the mirrored other, so that nothing
        // that comes from straight above leaves further than 60° from it: more than 0.1 % if α' is above 0.0183.
        let alpha = roughness.constant().unwrap_or(1.0).powi(2);
        if transmission > 0.0 && (0.65 * ior - 0.35).powi(2) * alpha > 0.0183 {
            self.warn(&o.at, "what a rough sheet passes far from straight on, Mitsuba cuts off, and rebond does not");
        }
        if alpha / (1.0 - 0.9 * anisotropic).max(0.1).sqrt() > 1.0 {
            self.warn(&o.at, "along its tangent a sheet is of α = 1 at most here");
        }
        Ok(MaterialDescription::PrincipledThin {
            base_color,
            roughness,
            anisotropic,
            transmission,
            ior,
            specular_tint,
            diffuse_transmission,
            flatness,
            sheen,
            sheen_tint,
        })
    }
}

/// An opacity is one number.
fn grey(texture: Texture) -> Texture {
    match texture {
        Texture::Constant(Color([r, g, b])) if r != g || g != b => {
            Texture::grey(0.212_671 * r + 0.715_160 * g + 0.072_169 * b)
        }
        other => other,
    }
}
