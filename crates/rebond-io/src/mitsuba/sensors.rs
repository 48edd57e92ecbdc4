//! Sensors, films, filters, samplers and integrators.

use super::{Importer, Object, Result};
use glam::{DMat4, DVec3};
use rebond::film::{Aov, FilterSettings};
use rebond::integrators::{AovSettings, DirectSettings, IntegratorSettings, LightSettings, PathSettings};
use rebond::sampling::SamplerSettings;
use rebond::scene::description::{CameraDescription, FovAxis};
use std::num::NonZeroU32;
use std::rc::Rc;

/// Diagonal of a frame of 35 mm film, mm.
const DIAGONAL: f64 = 43.266_615_305_567_87;

/// The distance before which nothing is seen, unless told otherwise.
const NEAR: f64 = 0.01;

impl Importer {
    /// The camera, its film and its sampler.
    pub fn sensor(&mut self, o: &Rc<Object>) -> Result<()> {
        let (mut size, mut part) = ([768, 576], [0, 0, 768, 576]);
        let films = self.children(o, &["film"])?;
        if let Some((film, _)) = films.first() {
            (size, part) = self.film(film)?;
        }
        (self.scene.film.width, self.scene.film.height) = (part[2], part[3]);
        for (sampler, _) in self.children(o, &["sampler"])? {
            self.sampler(&sampler)?;
        }
        let m = self.transform(o)?;
        let to_world = crate::import::steps(m);
        let (shutter_open, shutter_close) =
            (self.number_or(o, "shutter_open", 0.0)?, self.number_or(o, "shutter_close", 0.0)?);
        let mut camera = match o.plugin.as_str() {
            "perspective" | "thinlens" => {
                let (fov, fov_axis) = self.field_of_view(o, size)?;
                let near_clip = self.near_and_far(o)?;
                if o.plugin == "perspective" {
                    let offset = |name: &str| self.number_or(o, name, 0.0);
                    CameraDescription::Perspective {
                        to_world,
                        fov,
                        fov_axis,
                        principal_point_offset: [
                            offset("principal_point_offset_x")?,
                            offset("principal_point_offset_y")?,
                        ],
                        near_clip,
                        shutter_open,
                        shutter_close,
                    }
                } else {
                    let Some(radius) = self.number(o, "aperture_radius")? else {
                        return Err(self.error(&o.at, "the aperture_radius is missing"));
                    };
                    CameraDescription::ThinLens {
                        to_world,
                        fov,
                        fov_axis,
                        principal_point_offset: [0.0; 2],
                        near_clip,
                        aperture_radius: radius as f32,
                        aperture_blades: 0,
                        aperture_rotation: 0.0,
                        focus_distance: self.number_or(o, "focus_distance", 0.0)?,
                        shutter_open,
                        shutter_close,
                    }
                }
            }
            "orthographic" => {
                let near = f64::from(self.near_and_far(o)?);
                // Rays begin there.
                let to_world = crate::import::steps(m * DMat4::from_translation(DVec3::Z * near));
                CameraDescription::Orthographic { to_world, shutter_open, shutter_close }
            }
            _ => {
                self.unknown_plugin(o)?;
                let mut default = CameraDescription::default();
                if let CameraDescription::Perspective { to_world: place, .. } = &mut default {
                    *place = to_world;
                }
                default
            }
        };
        if part != [0, 0, size[0], size[1]] {
            crate::import::cut(&mut camera, size, part);
        }
        self.finish(o)?;
        self.places.note("camera", o.at.part());
        self.scene.camera = camera;
        Ok(())
    }

    /// The field of view of a picture of that size.
    pub(super) fn field_of_view(&mut self, o: &Object, size: [u32; 2]) -> Result<(f32, FovAxis)> {
        if let Some(fov) = self.number(o, "fov")? {
            let axis = match self.text(o, "fov_axis")? {
                None => FovAxis::X,
                Some((word, at)) => match word.as_str() {
                    "x" => FovAxis::X,
                    "y" => FovAxis::Y,
                    "smaller" => FovAxis::Smaller,
                    "larger" => FovAxis::Larger,
                    "diagonal" => return Ok((across(fov, size), FovAxis::X)),
                    _ => return Err(self.error(&at, format!("no axis \"{word}\": x, y, diagonal, smaller or larger"))),
                },
            };
            if o.has("focal_length") {
                return Err(self.error(&o.at, "either a fov or a focal_length, not both"));
            }
            return Ok((fov as f32, axis));
        }
        let length = match self.text(o, "focal_length")? {
            None => 50.0,
            Some((word, at)) => match word.trim().trim_end_matches("mm").trim().parse::<f64>() {
                Ok(x) if x > 0.0 && x.is_finite() => x,
                _ => return Err(self.error(&at, format!("\"{word}\" is no focal length such as 50mm"))),
            },
        };
        Ok((across((DIAGONAL / (2.0 * length)).atan().to_degrees() * 2.0, size), FovAxis::X))
    }

    /// The distance before which nothing is seen; that behind which nothing is seen is not heeded.
    fn near_and_far(&mut self, o: &Object) -> Result<f32> {
        if let Some(p) = o.get("far_clip") {
            self.warn(&p.at, "\"far_clip\" is not heeded: what is farther off is seen too");
        }
        self.number_or(o, "near_clip", NEAR)
    }

    /// The size of the whole picture, and which part of it is wanted: its place and its size.
    fn film(&mut self, o: &Rc<Object>) -> Result<([u32; 2], [u32; 4])> {
        if !matches!(o.plugin.as_str(), "hdrfilm" | "ldrfilm") {
            self.unknown_plugin(o)?;
        }
        let size = [self.count(o, "width", 768)?, self.count(o, "height", 576)?];
        let part = [
            self.count(o, "crop_offset_x", 0)?,
            self.count(o, "crop_offset_y", 0)?,
            self.count(o, "crop_width", size[0])?,
            self.count(o, "crop_height", size[1])?,
        ];
        let within = |i: usize| part[i + 2] > 0 && part[i].checked_add(part[i + 2]).is_some_and(|end| end <= size[i]);
        if part != [0, 0, size[0], size[1]] && !(within(0) && within(1)) {
            return Err(self.error(&o.at, "the crop is empty, or leaves the film"));
        }
        // What the file is to be.
        let file =
            ["file_format", "pixel_format", "component_format", "sample_border", "compensate", "banner", "gamma"];
        self.passed_over(o, &file);
        let mut filter = FilterSettings::default();
        for (f, _) in self.children(o, &["rfilter"])? {
            filter = match f.plugin.as_str() {
                "box" => FilterSettings::Box { radius: self.number_or(&f, "radius", 0.5)? },
                "tent" => FilterSettings::Tent { radius: self.number_or(&f, "radius", 1.0)? },
                "gaussian" => FilterSettings::Gaussian { stddev: self.number_or(&f, "stddev", 0.5)?, radius: None },
                "mitchell" => {
                    let third = 1.0 / 3.0;
                    FilterSettings::Mitchell { b: self.number_or(&f, "B", third)?, c: self.number_or(&f, "C", third)? }
                }
                "catmullrom" => FilterSettings::Mitchell { b: 0.0, c: 0.5 },
                _ => {
                    self.unknown_plugin(&f)?;
                    continue;
                }
            };
            self.finish(&f)?;
        }
        self.scene.film.filter = filter;
        self.finish(o)?;
        self.places.note("film", o.at.part());
        Ok((size, part))
    }

    fn sampler(&mut self, o: &Rc<Object>) -> Result<()> {
        let count = self.count(o, "sample_count", 4)?.max(1);
        // Seeds are given on the command line.
        self.passed_over(o, &["seed", "jitter"]);
        self.samples = o.has("sample_count").then_some(count);
        self.scene.sampler = match o.plugin.as_str() {
            "independent" => SamplerSettings::Independent {},
            "stratified" | "multijitter" => SamplerSettings::Stratified { samples: 0 },
            // Orthogonal arrays and (0, 2)-sequences: the nearest in kind.
            "orthogonal" | "ldsampler" => SamplerSettings::Sobol {},
            _ => return self.unknown_plugin(o),
        };
        self.finish(o)
    }

    /// The algorithm.
    pub fn integrator(&mut self, o: &Rc<Object>) -> Result<()> {
        let depth = |x: Option<f64>| x.filter(|d| *d >= 0.0).map(|d| d as u32);
        let max_depth = |me: &Self| -> Result<Option<NonZeroU32>> {
            match depth(me.number(o, "max_depth")?) {
                Some(0) => Err(me.error(&o.at, "a max_depth of 0: the picture is black")),
                d => Ok(d.and_then(NonZeroU32::new)),
            }
        };
        let settings = match o.plugin.as_str() {
            "path" => {
                let (max_depth, rr_depth) = (max_depth(self)?, self.count(o, "rr_depth", 5)?);
                IntegratorSettings::Path(PathSettings { max_depth, rr_depth, ..PathSettings::default() })
            }
            "volpath" | "volpathmis" => {
                // Where there is no medium, they are path tracing.
                let (max_depth, rr_depth) = (max_depth(self)?, self.count(o, "rr_depth", 5)?);
                IntegratorSettings::Path(PathSettings { max_depth, rr_depth, ..PathSettings::default() })
            }
            "direct" => {
                // How many samples go where; what they have for an expectation is the same.
                self.passed_over(o, &["shading_samples", "emitter_samples", "bsdf_samples"]);
                IntegratorSettings::Direct(DirectSettings::default())
            }
            "ptracer" => {
                self.passed_over(o, &["samples_per_pass"]);
                let (max_depth, rr_depth) = (max_depth(self)?, self.count(o, "rr_depth", 5)?);
                IntegratorSettings::Light(LightSettings { max_depth, rr_depth, ..LightSettings::default() })
            }
            "moment" => {
                // rebond writes the variance of every pixel anyhow.
                let inner = self.children(o, &["integrator"])?;
                self.finish(o)?;
                return match &inner[..] {
                    [(inner, at)] => self.within(inner, at, |me| me.integrator(inner)),
                    _ => Err(self.error(&o.at, "a \"moment\" has one integrator within")),
                };
            }
            "aov" => {
                let inner = self.children(o, &["integrator"])?;
                let mut aovs = self.aovs(o)?;
                // Where Mitsuba puts the picture, in files.
                self.passed_over(o, &["img", "hide_emitters", "samples_per_pass", "block_size", "timeout"]);
                self.finish(o)?;
                for (_, at) in inner.iter().skip(1) {
                    self.unsupported(at, "a second integrator of an \"aov\": the first makes the picture")?;
                }
                if let Some((inner, at)) = inner.first() {
                    self.scene.film.aovs = aovs;
                    return self.within(inner, at, |me| me.integrator(inner));
                }
                if aovs.is_empty() {
                    return Err(self.error(&o.at, "an \"aov\" that shows nothing"));
                }
                self.warn(&o.at, "an \"aov\" without an integrator within: the first is the picture");
                let show = aovs.remove(0);
                self.scene.film.aovs = aovs;
                self.places.note("integrator", o.at.part());
                self.scene.integrator = IntegratorSettings::Aov(AovSettings { show });
                return Ok(());
            }
            "depth" => IntegratorSettings::Aov(AovSettings { show: Aov::Depth }),
            _ => return self.unknown_plugin(o),
        };
        self.passed_over(o, &["samples_per_pass", "block_size", "timeout"]);
        let hides = self.flag(o, "hide_emitters", false)?;
        // Depths are those of all there is.
        self.scene.hide_emitters = hides && !matches!(settings, IntegratorSettings::Aov(_));
        if hides
            && matches!(settings, IntegratorSettings::Light(_))
            && let Some(p) = o.get("hide_emitters")
        {
            self.warn(
                &p.at,
                "hidden emitters are not seen and in the way of nothing; those of a \"ptracer\" are in the way",
            );
        }
        self.finish(o)?;
        self.places.note("integrator", o.at.part());
        self.scene.integrator = settings;
        Ok(())
    }

    /// What an "aov" shows, by pairs of a name, which is Mitsuba's for the layer, and what it is.
    fn aovs(&mut self, o: &Object) -> Result<Vec<Aov>> {
        let Some((text, at)) = self.text(o, "aovs")? else {
            return Err(self.error(&o.at, "the \"aovs\" are missing"));
        };
        let mut aovs = Vec::new();
        for pair in text.split([',', ' ']).filter(|pair| !pair.is_empty()) {
            let Some((_, what)) = pair.split_once(':').filter(|(name, what)| !name.is_empty() && !what.is_empty())
            else {
                return Err(self.error(&at, format!("\"{pair}\" is not a name and what it shows, such as dd:depth")));
            };
            match Aov::ALL.into_iter().find(|aov| aov.name().replace('-', "_") == what) {
                Some(aov) if aovs.contains(&aov) => {}
                Some(aov) => aovs.push(aov),
                None if MITSUBAS_AOVS.contains(&what) => self.unsupported(&at, format!("the aov \"{what}\""))?,
                None => return Err(self.error(&at, format!("there is no aov \"{what}\""))),
            }
        }
        Ok(aovs)
    }

    fn count(&self, o: &Object, name: &str, default: u32) -> Result<u32> {
        match self.number(o, name)? {
            None => Ok(default),
            Some(x) if x >= 0.0 && x.fract() == 0.0 && x <= f64::from(u32::MAX) => Ok(x as u32),
            Some(x) => match o.get(name) {
                Some(p) => Err(self.error(&p.at, format!("{x} is no number of that kind: it counts from 0"))),
                None => Ok(default),
            },
        }
    }
}

/// What an "aov" of Mitsuba's may show and rebond does not.
const MITSUBAS_AOVS: [&str; 5] = ["dp_du", "dp_dv", "duv_dx", "duv_dy", "boundary_test"];

/// The horizontal field of view of one across the diagonal.
fn across(fov: f64, [w, h]: [u32; 2]) -> f32 {
    let (w, h) = (f64::from(w), f64::from(h));
    let half = (fov.to_radians() / 2.0).tan() * w / w.hypot(h);
    (2.0 * half.atan()).to_degrees() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_of_view_of_a_focal_length() {
        // A frame of 36 mm by 24 mm at 50 mm: 2 atan(18/50) across.
        let diagonal = (DIAGONAL / 100.0).atan().to_degrees() * 2.0;
        assert!((across(diagonal, [30, 20]) - 39.59775).abs() < 1e-4);
        assert!((across(90.0, [1, 1]) - 2.0 * 0.5_f32.sqrt().atan().to_degrees()).abs() < 1e-4);
    }
}
