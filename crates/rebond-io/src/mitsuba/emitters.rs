//! Emitters that are no shapes.
//!
//! An environment of Mitsuba's has its centre towards +z, and its first and last row are the poles; rebond's has its centre
//! towards −z, and rows are bands of equal height, linear between their middles. So it is turned by half a turn, and its h rows
//! become m (h − 1): between two rows of the old ones lie m of the new, exactly on the line between them. Only around an old row, for
//! 1/m of the distance to the next, is the bend rounded off.

use super::textures::Lie;
use super::{Importer, Object, Result, Use, color};
use crate::import::{even, field_of, side, squares, steps};
use glam::{DMat4, DVec3, DVec4};
use rebond::film::Image;
use rebond::scene::description::{Color, EmitterDescription, ImageTexture, Transform};
use rebond::texture::SAME_UV;
use std::f64::consts::PI;
use std::rc::Rc;

/// Rows that an environment is brought to by a larger m.
const ROWS: usize = 2048;
const LARGEST_M: usize = 16;

impl Importer {
    /// An emitter of the scene.
    pub fn emitter(&mut self, o: &Rc<Object>) -> Result<()> {
        let m = self.transform(o)?;
        self.passed_over(o, &["sampling_weight"]);
        let emitter = match o.plugin.as_str() {
            "point" => {
                let position = match self.vector(o, "position")? {
                    Some(p) if !o.has("to_world") => p,
                    Some(_) => return Err(self.error(&o.at, "either a position or a to_world, not both")),
                    None => m.w_axis.truncate(),
                };
                EmitterDescription::Point {
                    position: position.as_vec3().to_array(),
                    to_world: Transform::default(),
                    intensity: self.light(o, "intensity")?,
                }
            }
            "spot" => {
                let cutoff_angle = self.number_or(o, "cutoff_angle", 20.0)?;
                let beam_width = self.number_or(o, "beam_width", 0.75 * f64::from(cutoff_angle))?;
                let (intensity, beam_width) = (self.light(o, "intensity")?, Some(beam_width));
                if !even(m) {
                    self.unsupported(&o.at, "a spot that is stretched or sheared")?;
                    return Ok(());
                }
                match self.slide(o, "texture")? {
                    None => EmitterDescription::Spot { to_world: steps(m), intensity, cutoff_angle, beam_width },
                    Some(_) if !(cutoff_angle > 0.0 && cutoff_angle < 89.5) => {
                        return Err(
                            self.error(&o.at, "the cutoff_angle of a spot with a texture is between 0 and 89.5")
                        );
                    }
                    Some((image, _)) => EmitterDescription::Projector {
                        // Its image is upside down, in a square around its cone.
                        to_world: steps(m * DMat4::from_scale(DVec3::new(-1.0, -1.0, 1.0))),
                        file: image.image,
                        encoding: image.encoding,
                        filter: image.filter,
                        wrap: image.wrap,
                        fov: 2.0 * cutoff_angle,
                        aspect: Some(1.0),
                        intensity,
                        even: false,
                        cutoff_angle: Some(cutoff_angle),
                        beam_width,
                    },
                }
            }
            "projector" => {
                let Some((image, size)) = self.slide(o, "irradiance")? else {
                    if o.has("irradiance") {
                        return Ok(());
                    }
                    return Err(self.error(&o.at, "the irradiance is missing"));
                };
                if !even(m) {
                    self.unsupported(&o.at, "a projector that is stretched or sheared")?;
                    return Ok(());
                }
                let (fov, axis) = self.field_of_view(o, size)?;
                let size = size.map(f64::from);
                // At distance 1 a white wall sends back what the image says.
                let intensity = f64::from(self.number_or(o, "scale", 1.0)?) * PI * m.z_axis.length();
                EmitterDescription::Projector {
                    to_world: steps(m),
                    file: image.image,
                    encoding: image.encoding,
                    filter: image.filter,
                    wrap: image.wrap,
                    fov: field_of(size[0], fov, side(axis, size)),
                    aspect: None,
                    intensity: Color([intensity as f32; 3]),
                    even: true,
                    cutoff_angle: None,
                    beam_width: None,
                }
            }
            "directional" => {
                let direction = match self.vector(o, "direction")? {
                    Some(d) if !o.has("to_world") => d,
                    Some(_) => return Err(self.error(&o.at, "either a direction or a to_world, not both")),
                    None => m.transform_vector3(DVec3::Z),
                };
                let irradiance = self.light(o, "irradiance")?;
                EmitterDescription::Directional { direction: direction.as_vec3().to_array(), irradiance }
            }
            "constant" => EmitterDescription::Constant { radiance: self.light(o, "radiance")? },
            "envmap" => self.environment(o, m)?,
            _ => return self.unknown_plugin(o),
        };
        self.finish(o)?;
        self.places.note(format!("emitters[{}]", self.scene.emitters.len()), o.at.part());
        self.scene.emitters.push(emitter);
        Ok(())
    }

    /// The image that a light shines through, upright, and its size.
    fn slide(&mut self, o: &Object, name: &str) -> Result<Option<(ImageTexture, [u32; 2])>> {
        let Some(p) = o.get(name) else { return Ok(None) };
        if let Some(c) = self.color(p, Use::Light)? {
            let image = self.assets.add_image("slide", Image::from_rgb(1, 1, &[color(c).0]));
            return Ok(Some((squares(image, SAME_UV), [1, 1])));
        }
        let Some(texture) = self.object(p)? else { return self.wrong(p, "a texture") };
        if texture.plugin != "bitmap" {
            self.unsupported(&p.at, format!("a {} for the \"{name}\" of a light: only bitmaps are", texture.plugin))?;
            return Ok(None);
        }
        let image = self.bitmap(&texture, Lie::Flipped, true)?;
        if image.to_uv.is_some_and(|m| m != SAME_UV) {
            self.unsupported(&p.at, "an image that a light shines through and a to_uv moves: it stays")?;
        }
        let decoded = self.image(&image.image, &p.at)?;
        Ok(Some((image, [decoded.width, decoded.height])))
    }

    fn environment(&mut self, o: &Object, m: DMat4) -> Result<EmitterDescription> {
        let Some((name, at)) = self.text(o, "filename")? else {
            return Err(self.error(&o.at, "the filename is missing"));
        };
        let file = self.find(&name, &at)?;
        let image = self.image(&file, &at)?;
        let Some(texels) = image.rgb("").filter(|t| !t.is_empty()) else {
            return Err(self.error(&at, format!("\"{file}\" has no colours")));
        };
        let stem = std::path::Path::new(&file).file_stem().map_or("sky".into(), |s| s.to_string_lossy().into_owned());
        let bands = bands([image.width as usize, image.height as usize], &texels);
        let file = self.assets.add_image(&format!("{stem} bands"), bands);
        let half_turn = DMat4::from_diagonal(DVec4::new(-1.0, 1.0, -1.0, 1.0));
        // Only directions count.
        let mut turned = m * half_turn;
        turned.w_axis = DVec4::W;
        let scale = self.number_or(o, "scale", 1.0)?;
        Ok(EmitterDescription::Envmap { file, scale, blur: None, to_world: steps(turned) })
    }
}

/// The same environment in bands.
fn bands([w, h]: [usize; 2], texels: &[[f32; 3]]) -> Image {
    let gaps = h.saturating_sub(1).max(1);
    let m = (ROWS / gaps).clamp(1, LARGEST_M);
    let rows = m * gaps;
    let mut out = Vec::with_capacity(rows * w);
    for i in 0..rows {
        let at = (i as f32 + 0.5) / m as f32;
        let above = (at as usize).min(h - 1);
        let (below, share) = ((above + 1).min(h - 1), at - above as f32);
        for x in 0..w {
            let (a, b) = (texels[above * w + x], texels[below * w + x]);
            out.push(std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share));
        }
    }
    Image::from_rgb(w as u32, rows as u32, &out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_lie_on_the_line_between_rows() {
        // Three rows: 0, 4, 1.
        let texels: Vec<[f32; 3]> = [0.0, 4.0, 1.0].into_iter().flat_map(|v| [[v; 3]; 2]).collect();
        let image = bands([2, 3], &texels);
        assert_eq!((image.width, image.height), (2, 32));
        let rows = image.rgb("").expect("colours");
        for (i, row) in rows.chunks(2).enumerate() {
            let at = (i as f32 + 0.5) / 16.0;
            let want = if at < 1.0 { 4.0 * at } else { 4.0 - 3.0 * (at - 1.0) };
            assert!((row[0][1] - want).abs() < 1e-5 && row[0] == row[1], "row {i}");
        }
        assert_eq!(bands([1, 1], &[[2.0; 3]]).rgb("").expect("colours"), [[2.0; 3]; 16]);
        assert_eq!(bands([1, 4097], &[[2.0; 3]; 4097]).height, 4096);
    }
}
