//! Surfaces that shine in the colours of an image: radiance `L(p) = c · texel(u(p), v(p))`.
//!
//! Triangles and parallelograms only, on which (u, v) are affine in the point: `(u, v) = (u₀, v₀) + b₁ ∂(u, v)/∂b₁ + b₂ ∂(u, v)/∂b₂`
//! at `p₀ + b₁ e₁ + b₂ e₂`. Points are drawn as on any lamp, uniformly; what was drawn is then multiplied by its texel. Which
//! lamp is asked is chosen by the mean of its texels.

use super::Flat;
use crate::math::{Rgb, Vec3};
use crate::texture::Textures;
use rebond_lanes::{Index, Mask, Real, Record, scalar::Index1};

/// The image of an emitter: its number among the textures of [`Glow`], and (u, v) at the emitter's corner and along its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture {
    /// Which emitter.
    pub emitter: u32,
    /// Which texture.
    pub texture: u32,
    /// (u, v) at p₀, and their changes along e₁ and e₂.
    pub uv: [[f32; 2]; 3],
}

/// Images of emitters.
#[derive(Clone, Debug, Default)]
pub struct Glow {
    /// The images.
    pub textures: Textures,
    /// Two records an emitter: [texture + 1 (word), u, v, 0], [∂u/∂b₁, ∂v/∂b₁, ∂u/∂b₂, ∂v/∂b₂].
    table: Vec<Record>,
    /// Mean radiance of those with an image.
    means: Vec<(u32, [f32; 3])>,
}

const RECORDS: u32 = 2;
/// Most points along a side of a lamp at which its image is looked up for its mean.
const MOST_POINTS: usize = 64;

impl Glow {
    /// Images of `count` emitters, of these radiances before their texels.
    pub fn new(
        textures: Textures,
        count: usize,
        pictures: &[(Picture, [f32; 3])],
        triangle: &dyn Fn(u32) -> bool,
    ) -> Self {
        let mut table = vec![Record::words([0; 4]); count * RECORDS as usize];
        let mut means = Vec::new();
        for (picture, radiance) in pictures {
            let first = (picture.emitter * RECORDS) as usize;
            let [[u, v], along, across] = picture.uv;
            table[first] = Record([f32::from_bits(picture.texture + 1), u, v, 0.0]);
            table[first + 1] = Record([along[0], along[1], across[0], across[1]]);
            let mean = mean(&textures, picture, triangle(picture.emitter));
            means.push((picture.emitter, [0, 1, 2].map(|c| mean[c] * radiance[c])));
        }
        Self { textures, table, means }
    }

    /// Emitters with an image, by number, with their mean radiance.
    pub fn means(&self) -> &[(u32, [f32; 3])] {
        &self.means
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.textures.bytes() + self.table.len() * size_of::<Record>() + size_of_val(&*self.means)
    }

    /// The edges of an emitter change places.
    pub(super) fn swap_edges(&mut self, emitter: u32) {
        let Record([a, b, c, d]) = &mut self.table[(emitter * RECORDS + 1) as usize];
        std::mem::swap(a, c);
        std::mem::swap(b, d);
    }

    /// The texel at a point of an emitter, white if it has no image.
    #[inline(never)]
    pub(super) fn at<F: Real>(&self, emitter: F::Index, flat: &Flat<F>, p: Vec3<F>, mask: F::Mask) -> Rgb<F> {
        let first = F::Index::select(mask, emitter, F::Index::splat(0)) * F::Index::splat(RECORDS);
        let [texture, u, v, _] = F::record(&self.table, first);
        let texture = texture.to_bits();
        let shown = mask & texture.ne(F::Index::splat(0));
        let white = Rgb::new(F::one(), F::one(), F::one());
        if shown.none() {
            return white;
        }
        // Least squares for b₁ and b₂, in units of the longer edge.
        let [e1, e2] = flat.edges;
        let unit = e1.max_abs().max(e2.max_abs()).recip();
        let (e1, e2, d) = (e1 * unit, e2 * unit, (p - flat.p0) * unit);
        let (a, b, c) = (e1.length_squared(), e1.dot(e2), e2.length_squared());
        let (x, y) = (d.dot(e1), d.dot(e2));
        let scale = (a * c - b * b).recip();
        let (b1, b2) = ((c * x - b * y) * scale, (a * y - b * x) * scale);
        let [u1, v1, u2, v2] = F::record(&self.table, first + F::Index::splat(1));
        let uv = [b1.mul_add(u1, b2.mul_add(u2, u)), b1.mul_add(v1, b2.mul_add(v2, v))];
        let number = F::Index::select(shown, texture - F::Index::splat(1), F::Index::splat(0));
        Rgb::select(shown, self.textures.eval(number, uv), white)
    }
}

/// The mean texel of a lamp, from about as many points as it has texels.
fn mean(textures: &Textures, picture: &Picture, triangle: bool) -> [f32; 3] {
    let [[u, v], [u1, v1], [u2, v2]] = picture.uv;
    let [width, height] = textures.size(picture.texture);
    let longest = [[u1, v1], [u2, v2]].map(|[du, dv]| (du * width as f32).abs().max((dv * height as f32).abs()));
    let side = (longest[0].max(longest[1]).ceil() as usize).clamp(8, MOST_POINTS);
    let mut sum = [0.0_f64; 3];
    for i in 0..side {
        for j in 0..side {
            let (b1, b2) = ((i as f32 + 0.5) / side as f32, (j as f32 + 0.5) / side as f32);
            // Folded over along the diagonal.
            let (b1, b2) = if triangle && b1 + b2 > 1.0 { (1.0 - b1, 1.0 - b2) } else { (b1, b2) };
            let texel = textures.eval::<f32>(Index1(picture.texture), [u + b1 * u1 + b2 * u2, v + b1 * v1 + b2 * v2]);
            for (sum, x) in sum.iter_mut().zip([texel.r, texel.g, texel.b]) {
                *sum += f64::from(x);
            }
        }
    }
    sum.map(|x| (x / (side * side) as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{Emitter, Emitters, LightSampling};
    use super::*;
    use crate::math::vec3;
    use crate::testing::{random_pairs, seeded_pairs};
    use crate::texture::{SAME_UV, TextureFilter, Wrap};
    use glam::Vec3 as V;

    const RADIANCE: [f32; 3] = [2.0, 3.0, 4.0];
    const P: [V; 3] = [V::new(0.0, 0.0, 1.0), V::new(2.0, 0.0, 0.5), V::new(0.3, 1.0, 0.0)];

    /// A plain lamp, and a triangle and a parallelogram over a bilinear image, whose texels are affine: r = u, g = v within.
    fn lamps() -> Emitters {
        let texels: Vec<[f32; 3]> = (0..64).map(|i| [(i % 8) as f32 / 8.0, (i / 8) as f32 / 8.0, 1.0]).collect();
        let mut textures = Textures::default();
        let texture = textures.add([8, 8], &texels, [Wrap::Clamp; 2], TextureFilter::Bilinear, SAME_UV);
        let uv = [[0.2, 0.7], [0.5, 0.1], [0.1, -0.4]];
        let emitters = [
            Emitter::Triangle { p: P, radiance: RADIANCE },
            Emitter::Triangle { p: P, radiance: RADIANCE },
            Emitter::Parallelogram { p: P, radiance: RADIANCE },
        ];
        let pictures = [1, 2].map(|emitter| (Picture { emitter, texture, uv }, RADIANCE));
        Emitters::new(&emitters, vec![]).glowing(Glow::new(textures, 3, &pictures, &|e| e < 2))
    }

    /// What the image says at b₁, b₂.
    fn wanted(b1: f32, b2: f32) -> [f32; 3] {
        let (u, v) = (0.2 + 0.5 * b1 + 0.1 * b2, 0.7 + 0.1 * b1 - 0.4 * b2);
        let texel = [u - 0.5 / 8.0, 1.0 - v - 0.5 / 8.0, 1.0];
        [0, 1, 2].map(|c| texel[c] * RADIANCE[c])
    }

    #[test]
    fn what_a_lamp_shows_is_its_image() {
        let lamps = lamps();
        for [b1, b2] in random_pairs(200) {
            let p = P[0] + P[1] * b1 + P[2] * b2;
            for (emitter, wanted) in [(0, RADIANCE), (1, wanted(b1, b2)), (2, wanted(b1, b2))] {
                let shown = lamps.radiance_at::<f32>(Index1(emitter), vec3(p.x, p.y, p.z), 0.0, true);
                for (c, wanted) in [shown.r, shown.g, shown.b].into_iter().zip(wanted) {
                    assert!((c - wanted).abs() < 1e-4, "{emitter}: {c} for {wanted}");
                }
            }
        }
    }

    /// Points drawn towards a receiver, and rays that leave, carry the radiance of where they are.
    #[test]
    fn what_is_drawn_carries_the_radiance_of_its_point() {
        let lamps = lamps();
        let normal = P[1].cross(P[2]).normalize();
        let from = P[0] + normal * 3.0;
        for (u, v) in seeded_pairs(200, 1).zip(seeded_pairs(200, 2)) {
            for emitter in [0, 1, 2] {
                for sampling in [LightSampling::Area, LightSampling::SolidAngle] {
                    let from = vec3(from.x, from.y, from.z);
                    let sample = lamps.sample::<f32>(Index1(emitter), from, 0.0, sampling, u, true);
                    let shown = lamps.radiance_at::<f32>(Index1(emitter), sample.point, 0.0, true);
                    assert!((sample.weight.r * sample.pdf.0 / shown.r - 1.0).abs() < 1e-3);
                    assert!((sample.weight.g * sample.pdf.0 / shown.g - 1.0).abs() < 1e-3);
                }
                let ray = lamps.emit::<f32>(Index1(emitter), 0.0, u, v, true);
                let shown = lamps.radiance_at::<f32>(Index1(emitter), ray.o, 0.0, true);
                let cos = ray.normal.dot(ray.d);
                let weight = shown * (cos / (ray.pdf.position.0 * ray.pdf.direction.0));
                assert!((ray.weight.g / weight.g - 1.0).abs() < 1e-3 && (ray.weight.r / weight.r - 1.0).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn means_are_those_of_the_image() {
        let lamps = lamps();
        let means = lamps.glow.as_ref().expect("images").means();
        // An affine image has its mean in the middle.
        for ((emitter, mean), wanted) in means.iter().zip([wanted(1.0 / 3.0, 1.0 / 3.0), wanted(0.5, 0.5)]) {
            for (m, w) in mean.iter().zip(wanted) {
                assert!((m / w - 1.0).abs() < 0.03, "{emitter}: {m} for {w}");
            }
        }
    }
}
