//! Materials.

use super::parse::{Parameter, Parameters, Spot};
use super::{Importer, Result};
use crate::import::free_name;
use crate::mitsuba::metals;
use crate::mitsuba::spectra::{self, Use};
use rebond::scene::description::{
    Color, Distribution, Masking, MaterialDescription, MaterialRef, Metal, NumberTexture, ShapeDescription, Texture,
};
use std::collections::BTreeMap;

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

fn rename(material: &mut MaterialRef, names: &BTreeMap<String, String>) {
    match material {
        MaterialRef::Named(name) => {
            if let Some(new) = names.get(name) {
                name.clone_from(new);
            }
        }
        MaterialRef::Inline(m) => rename_within(m, names),
    }
}

fn rename_within(material: &mut MaterialDescription, names: &BTreeMap<String, String>) {
    use MaterialDescription as M;
    match material {
        M::TwoSided { front: inner, .. } | M::Mask { material: inner, .. } | M::Glow { material: inner, .. } => {
            rename(inner, names);
        }
        M::Mix { a, b, .. } => [a, b].into_iter().for_each(|m| rename(m, names)),
        _ => {}
    }
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
            let number = self.unnamed.len() + 1;
            self.unnamed(format!("{kind} {number}"), at)
        };
        if named {
            self.places.note(format!("materials.{name}"), at.part());
        }
        let description = match material {
            MaterialRef::Inline(m) => *m,
            MaterialRef::Named(_) => return Err(self.error(at, "a material that is another")),
        };
        if self.spread(&description) {
            self.lying.insert(name.clone());
        }
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
                let (alpha, [along, _]) = self.roughness(p, 0.0)?;
                let alpha = alpha.or(along).unwrap_or(0.0.into());
                let int_ior = self.eta(p, 1.5)?;
                for name in ["thickness", "albedo", "g", "maxdepth", "nsamples"] {
                    let _ = p.get(name);
                }
                self.warn(at, "a coated diffuse surface is rendered as rebond's plastic, which is nearly the same");
                two_sided(M::Plastic { diffuse_reflectance, int_ior, ext_ior: 1.0, alpha, nonlinear: true })
            }
            "conductor" => {
                let (alpha, [alpha_u, alpha_v]) = self.roughness(p, 0.0)?;
                let (mut eta, mut k) = metals::index("Cu").unwrap_or_default();
                if p.get("reflectance").is_some() {
                    // With k alone: η = 1, R = k² / (4 + k²).
                    let r = match self.reflectance(p, "reflectance", 0.5)? {
                        Texture::Constant(c) => c.0,
                        _ => {
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
                    alpha,
                    alpha_u,
                    alpha_v,
                    distribution: Distribution::Ggx,
                    masking: Masking::Correlated,
                    tint: Texture::grey(1.0),
                    compensate: false,
                })
            }
            "dielectric" => {
                let (alpha, [alpha_u, alpha_v]) = self.roughness(p, 0.0)?;
                inline(M::Dielectric {
                    int_ior: self.eta(p, 1.5)?,
                    ext_ior: 1.0,
                    alpha,
                    alpha_u,
                    alpha_v,
                    distribution: Distribution::Ggx,
                    masking: Masking::Correlated,
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
                let weight = self.number_of(p, "amount", 0.5)?;
                let ((a, opaque_a), (b, opaque_b)) = (self.part(a, at)?, self.part(b, at)?);
                if opaque_a != opaque_b {
                    self.warn(at, "of a mix of what is opaque and what is not, the opaque part is black from behind");
                }
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

    /// A part of a mix, and whether it is opaque. It must not be two-sided by itself: the mix is. A mix of mixes has those by name, or it
    /// would double with each that is within it.
    fn part(&mut self, name: &str, at: Spot) -> Result<(MaterialRef, bool)> {
        use MaterialDescription as M;
        let Some(material) = self.scene.materials.get(name) else {
            return Err(self.error(at, format!("there is no material \"{name}\"")));
        };
        let M::TwoSided { front, back: None } = material else { return Ok((MaterialRef::Named(name.into()), false)) };
        let mix = match front {
            MaterialRef::Inline(m) if matches!(**m, M::Mix { .. }) => (**m).clone(),
            _ => return Ok((front.clone(), true)),
        };
        let side = self.unnamed(format!("{name} side"), at);
        if self.lying.contains(name) {
            self.lying.insert(side.clone());
        }
        self.scene.materials.insert(side.clone(), mix);
        let front = MaterialRef::Named(side.clone());
        self.scene.materials.insert(name.to_string(), M::TwoSided { front, back: None });
        Ok((MaterialRef::Named(side), true))
    }

    /// The name, until the end of the scene, of a material that the scene gives none: no name of the scene's has a quote.
    fn unnamed(&mut self, wish: String, at: Spot) -> String {
        let name = format!("\"{}", self.unnamed.len());
        self.unnamed.push((name.clone(), wish, at));
        name
    }

    /// Names what has no name yet as none of the scene's is called.
    pub fn name_materials(&mut self) {
        let mut names = BTreeMap::new();
        for (name, wish, at) in std::mem::take(&mut self.unnamed) {
            if let Some(material) = self.scene.materials.remove(&name) {
                let free = free_name(&wish, "", |n| self.scene.materials.contains_key(n));
                self.places.note(format!("materials.{free}"), at.part());
                self.scene.materials.insert(free.clone(), material);
                names.insert(name, free);
            }
        }
        self.scene.materials.values_mut().for_each(|m| rename_within(m, &names));
        for shape in self.scene.groups.values_mut().flatten().chain(&mut self.scene.shapes) {
            let material = match shape {
                ShapeDescription::Ply(s) => &mut s.material,
                ShapeDescription::Sphere(s) => &mut s.material,
                ShapeDescription::Disk(s) => &mut s.material,
                _ => continue,
            };
            material.iter_mut().for_each(|m| rename(m, &names));
        }
    }

    /// α, and those along u and v if they are not the same: the root of roughness, unless it is not to be remapped.
    fn roughness(
        &mut self,
        p: &Parameters,
        default: f64,
    ) -> Result<(Option<NumberTexture>, [Option<NumberTexture>; 2])> {
        let remap = self.flag(p, "remaproughness", true)?;
        let both = p.get("roughness");
        let (u, v) = (p.get("uroughness").or(both), p.get("vroughness").or(both));
        let mut one = |q: Option<&Parameter>| -> Result<NumberTexture> {
            let Some(q) = q else { return Ok((default as f32).into()) };
            if let Some(image) = self.number_image(q, remap)? {
                return Ok(NumberTexture::Image(image));
            }
            let x = self.number_of(p, &q.name, default)?;
            Ok(if remap { x.max(0.0).sqrt() } else { x }.into())
        };
        let along = one(u)?;
        if let (Some(u), Some(v)) = (u, v)
            && u.kind == v.kind
            && u.words == v.words
            && u.numbers == v.numbers
        {
            return Ok((Some(along), [None, None]));
        }
        let across = one(v)?;
        if along == across {
            return Ok((Some(along), [None, None]));
        }
        Ok((None, [Some(along), Some(across)]))
    }

    fn eta(&mut self, p: &Parameters, default: f64) -> Result<f32> {
        let Some(q) = p.get("eta") else { return Ok(default as f32) };
        match (&q.numbers[..], &q.words[..]) {
            ([x], []) => Ok(*x as f32),
            ([], [name]) => {
                // pbrt's names; behind those of F5, F10 and F11 are the glasses SF5, SF10 and SF11.
                let known = [
                    ("glass-BK7", 1.5168),
                    ("glass-BAF10", 1.67),
                    ("glass-FK51A", 1.4866),
                    ("glass-LASF9", 1.8503),
                    ("glass-F5", 1.6727),
                    ("glass-F10", 1.7283),
                    ("glass-F11", 1.7847),
                ];
                match known.iter().find(|(n, _)| n == name) {
                    Some((_, n)) => {
                        self.warn(q.at, format!("\"{name}\" has one index for all colours: that at 587.6 nm"));
                        Ok(*n)
                    }
                    None => {
                        let message = format!("no index of refraction is known for \"{name}\": {default} is taken");
                        self.unsupported(q.at, message)?;
                        Ok(default as f32)
                    }
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
                    None => {
                        self.unsupported(q.at, format!("no metal is known for \"{name}\": copper is taken"))?;
                        let (eta, k) = metals::index("Cu").unwrap_or_default();
                        Ok(if which == 0 { eta } else { k })
                    }
                }
            }
            _ => Err(self.error(q.at, format!("\"{}\" is a spectrum", q.name))),
        }
    }

    /// A colour or a texture of colours.
    fn reflectance(&mut self, p: &Parameters, name: &str, default: f32) -> Result<Texture> {
        match p.get(name) {
            None => Ok(Texture::grey(default)),
            Some(q) => self.texture_of(q, false),
        }
    }

    /// How opaque a shape is; `None` if it is.
    pub fn alpha(&mut self, p: &Parameters) -> Result<Option<Texture>> {
        let Some(q) = p.get("alpha") else { return Ok(None) };
        Ok(Some(self.texture_of(q, true)?).filter(|t| *t != Texture::grey(1.0)))
    }

    /// Whether it matters where on a surface a material is: it has an image, or is brushed. So it does if it is not known yet.
    pub fn lies(&self, material: &MaterialRef) -> bool {
        match material {
            MaterialRef::Named(name) => self.lying.contains(name) || !self.scene.materials.contains_key(name),
            MaterialRef::Inline(m) => self.spread(m),
        }
    }

    fn spread(&self, description: &MaterialDescription) -> bool {
        use MaterialDescription as M;
        let image = |t: &Texture| matches!(t, Texture::Image(_));
        let varies = |t: &NumberTexture| t.constant().is_none();
        match description {
            M::Mask { opacity, material } => image(opacity) || self.lies(material),
            M::TwoSided { front, .. } => self.lies(front),
            M::Mix { a, b, .. } => self.lies(a) || self.lies(b),
            M::Diffuse { reflectance } => image(reflectance),
            M::Plastic { diffuse_reflectance, alpha, .. } => image(diffuse_reflectance) || varies(alpha),
            M::Dielectric { alpha, alpha_u, .. } | M::Conductor { alpha, alpha_u, .. } => {
                alpha_u.is_some() || alpha.as_ref().is_some_and(varies)
            }
            M::Measured { .. } | M::Glow { .. } => true,
            _ => false,
        }
    }
}
