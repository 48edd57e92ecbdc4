//! Images spread over surfaces.

use rebond_lanes::{Index, Real, Record};
use serde::{Deserialize, Serialize};

/// How the numbers of an image file stand for colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// By the file: 8 and 16-bit files are sRGB, floating-point files linear.
    #[default]
    Auto,
    /// Linear, whatever the file.
    Linear,
}

/// What a texture is outside of the unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrap {
    /// Repeated.
    #[default]
    Repeat,
    /// Its own edge.
    Clamp,
    /// Repeated, every second one mirrored.
    Mirror,
}

/// How a texture is looked up between its texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TextureFilter {
    /// Interpolated linearly in both directions.
    #[default]
    Bilinear,
    /// The nearest texel.
    Nearest,
}

/// All textures of a scene, texel after texel.
#[derive(Clone, Debug, Default)]
pub struct Textures {
    texels: Vec<Record>,
    /// Three records a texture: [start, width, height, flags] (words); the two rows of its map of (u, v, 1).
    table: Vec<Record>,
}

const CLAMP: u32 = 1;
const NEAREST: u32 = 2;
const MIRROR: u32 = 4;
/// The same along v, as flags of u moved by so many bits.
const ALONG_V: u32 = 4;
const RECORDS: u32 = 3;

/// Where an image is on a surface: the rows of a matrix that takes (u, v, 1) to the image's own (u, v).
pub type UvMap = [[f32; 3]; 2];

/// The image's own (u, v) are the surface's.
pub const SAME_UV: UvMap = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

impl Textures {
    /// Adds an image (linear RGB, row by row from the top) and returns its number. It goes on along u and along v as `wrap` says.
    pub fn add(
        &mut self,
        size: [u32; 2],
        texels: &[[f32; 3]],
        wrap: [Wrap; 2],
        filter: TextureFilter,
        map: UvMap,
    ) -> u32 {
        let number = self.table.len() as u32 / RECORDS;
        let [along_u, along_v] = wrap.map(|wrap| match wrap {
            Wrap::Repeat => 0,
            Wrap::Clamp => CLAMP,
            Wrap::Mirror => CLAMP | MIRROR,
        });
        let flags = along_u | along_v << ALONG_V | if filter == TextureFilter::Nearest { NEAREST } else { 0 };
        self.table.push(Record::words([self.texels.len() as u32, size[0], size[1], flags]));
        self.table.extend(map.map(|[a, b, c]| Record([a, b, c, 0.0])));
        self.texels.extend(texels.iter().map(|t| Record([t[0], t[1], t[2], 0.0])));
        number
    }

    /// Width and height of a texture.
    pub fn size(&self, texture: u32) -> [u32; 2] {
        let Record([_, width, height, _]) = self.table[(texture * RECORDS) as usize];
        [width, height].map(f32::to_bits)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.texels.len() + self.table.len()) * size_of::<Record>()
    }

    /// The colour of a texture at (u, v); (0, 0) is the lower left corner.
    pub fn eval<F: Real>(&self, texture: F::Index, uv: [F; 2]) -> crate::math::Rgb<F> {
        let at = texture * F::Index::splat(RECORDS);
        let [start, width, height, flags] = F::record(&self.table, at).map(F::to_bits);
        let [u, v] = self.map(at, uv);
        let flag = |f: u32| (flags & F::Index::splat(f)).ne(F::Index::splat(0));
        let nearest = flag(NEAREST);
        let clamp = [flag(CLAMP), flag(CLAMP << ALONG_V)];
        let mirror = [flag(MIRROR), flag(MIRROR << ALONG_V)];
        let wrap = |x: F, along: usize| {
            let repeated = x - x.floor();
            // There and back within a period of 2.
            let mirrored = F::one() - ((x * 0.5 - (x * 0.5).floor()) * 2.0 - 1.0).abs();
            F::select(mirror[along], mirrored, F::select(clamp[along], x.clamp(0.0, 1.0), repeated))
        };
        let (w, h) = (F::from_index(width), F::from_index(height));
        // Texel centres are at half-integers; the nearest texel is what a bilinear look-up at its centre gives.
        let place = |x: F| F::select(nearest, x.floor(), x - 0.5);
        let (x, y) = (place(wrap(u, 0) * w), place((F::one() - wrap(v, 1)) * h));
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let inside = |i: F, n: F, along: usize| {
            let around = F::select(i.lt(F::zero()), i + n, F::select(i.ge(n), i - n, i));
            let edge = i.max(F::zero()).min(n - 1.0);
            F::select(clamp[along], edge, around.max(F::zero()).min(n - 1.0)).to_index()
        };
        let texel = |x: F, y: F| {
            crate::math::Rgb::of_record(F::record(&self.texels, start + inside(y, h, 1) * width + inside(x, w, 0)))
        };
        let row = |y: F| texel(x0, y) * (F::one() - fx) + texel(x0 + 1.0, y) * fx;
        row(y0) * (F::one() - fy) + row(y0 + 1.0) * fy
    }

    /// The place in the image of a place on the surface.
    #[inline(always)]
    fn map<F: Real>(&self, at: F::Index, [u, v]: [F; 2]) -> [F; 2] {
        let row = |n: u32| {
            let [a, b, c, _] = F::record(&self.table, at + F::Index::splat(n));
            a.mul_add(u, b.mul_add(v, c))
        };
        [row(1), row(2)]
    }

    /// ∂/∂u and ∂/∂v of a texture's luminance at (u, v): differences over one texel.
    pub fn slope<F: Real>(&self, texture: F::Index, uv: [F; 2]) -> [F; 2] {
        let at = texture * F::Index::splat(RECORDS);
        let [_, width, height, _] = F::words(&self.table, at);
        let row = |n: u32| F::record(&self.table, at + F::Index::splat(n));
        let ([a, b, ..], [c, d, ..]) = (row(1), row(2));
        let (w, h) = (F::from_index(width), F::from_index(height));
        let texel = |along_x: F, along_y: F| {
            let step = (along_x * w).abs().max((along_y * h).abs()).recip();
            F::select(step.is_finite(), step, F::one())
        };
        let (du, dv) = (texel(a, c), texel(b, d));
        let h = |u: F, v: F| self.eval(texture, [u, v]).luminance();
        let along_u = h(uv[0] + du * 0.5, uv[1]) - h(uv[0] - du * 0.5, uv[1]);
        let along_v = h(uv[0], uv[1] + dv * 0.5) - h(uv[0], uv[1] - dv * 0.5);
        [along_u / du, along_v / dv]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rebond_lanes::scalar::Index1;

    #[test]
    fn texels_are_where_they_belong() {
        let mut textures = Textures::default();
        textures.add([1, 1], &[[9.0; 3]], [Wrap::Repeat; 2], TextureFilter::Bilinear, SAME_UV);
        // 2×2: top row 0, 1; bottom row 2, 3.
        let texels = [0.0, 1.0, 2.0, 3.0].map(|x| [x; 3]);
        let bilinear = textures.add([2, 2], &texels, [Wrap::Repeat; 2], TextureFilter::Bilinear, SAME_UV);
        let nearest = textures.add([2, 2], &texels, [Wrap::Clamp; 2], TextureFilter::Nearest, SAME_UV);
        let mirrored = textures.add([2, 2], &texels, [Wrap::Mirror; 2], TextureFilter::Bilinear, SAME_UV);
        let quarter_turn = [[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]];
        let turned = textures.add([2, 2], &texels, [Wrap::Repeat; 2], TextureFilter::Bilinear, quarter_turn);
        let eval = |t: u32, u: f32, v: f32| textures.eval(Index1(t), [u, v]).r;
        for t in [bilinear, nearest] {
            assert_eq!(
                [eval(t, 0.25, 0.75), eval(t, 0.75, 0.75), eval(t, 0.25, 0.25), eval(t, 0.75, 0.25)],
                [0.0, 1.0, 2.0, 3.0]
            );
        }
        assert_eq!(eval(bilinear, 0.5, 0.5), 1.5);
        assert_eq!(eval(bilinear, 0.0, 0.25), 2.5, "repeats from the other edge");
        assert_eq!((eval(nearest, -3.0, 0.9), eval(nearest, 7.0, -1.0)), (0.0, 3.0));
        assert_eq!(eval(0, 0.3, -12.7), 9.0);
        // Between texel centres the slope is that of the plane through them: one texel is half of the square.
        let slope = textures.slope(Index1(bilinear), [0.5_f32, 0.5]);
        assert!((slope[0] - 2.0).abs() < 1e-5 && (slope[1] + 4.0).abs() < 1e-5, "{slope:?}");
        for u in [f32::NAN, f32::INFINITY, 1e30, -1e30] {
            let _ = eval(bilinear, u, u);
        }
        // Mirrored at its edges, there and back again.
        for (u, v) in [(0.3, 0.4), (0.01, 0.98), (0.75, 0.5)] {
            let here = eval(mirrored, u, v);
            for (x, y) in [(-u, v), (2.0 - u, v), (u + 2.0, v), (u, -v), (u - 4.0, 2.0 - v)] {
                assert!((eval(mirrored, x, y) - here).abs() < 1e-5, "({x}, {y})");
            }
        }
        assert_eq!(eval(mirrored, 0.0, 0.25), 2.0, "its edge is next to itself");
        // Each direction in its own way.
        let both = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror];
        let alike = both.map(|w| textures.add([2, 2], &texels, [w; 2], TextureFilter::Bilinear, SAME_UV));
        for (i, along_u) in both.into_iter().enumerate() {
            for (j, along_v) in both.into_iter().enumerate() {
                let mixed = textures.add([2, 2], &texels, [along_u, along_v], TextureFilter::Bilinear, SAME_UV);
                let eval = |t: u32, u: f32, v: f32| textures.eval(Index1(t), [u, v]).r;
                for [u, v] in [[-0.6, 0.3], [0.1, 0.95], [1.3, 0.5]] {
                    assert_eq!(eval(mixed, u, 0.5), eval(alike[i], u, 0.5), "{along_u:?} along u");
                    assert_eq!(eval(mixed, 0.5, u), eval(alike[j], 0.5, u), "{along_v:?} along v");
                    let [x, y] = [eval(alike[i], u, 0.5) - 1.5, eval(alike[j], 0.5, v) - 1.5];
                    // The texels are a plane.
                    assert!((eval(mixed, u, v) - (1.5 + x + y)).abs() < 1e-5, "({u}, {v})");
                }
            }
        }
        let eval = |t: u32, u: f32, v: f32| textures.eval(Index1(t), [u, v]).r;
        // A quarter turn about the centre: (u, v) shows what was at (v, 1 − u).
        for (u, v) in [(0.3, 0.4), (0.62, 0.58)] {
            assert!((eval(turned, u, v) - eval(bilinear, v, 1.0 - u)).abs() < 1e-6);
        }
        let [du, dv] = textures.slope(Index1(turned), [0.5_f32, 0.5]);
        assert!((du - 4.0).abs() < 1e-5 && (dv - 2.0).abs() < 1e-5, "{du} {dv}");
    }
}
