//! One ray, prepared for boxes and triangles.

use crate::MISS;
use crate::node::ONE_PLUS;
use crate::simd::{Lanes, Native, Simd};
use rebond_lanes::{F32x16, Index, Index16, Mask, Real};

/// A ray as the kernels want it.
///
/// A box is entered along axis k at `plane · inverse + near` and left at `plane · inverse_far + far`. The constants
/// are −o/d moved apart by a bound on every rounding error there is: that of o/d, of the planes' product, and of the
/// triangle test's shear (Woop, Benthin, Wald 2013, section 3.3, which see). So a box is never missed when the
/// triangle test would find a hit in it. What error remains is relative, and [`ONE_PLUS`](crate::node::ONE_PLUS)
/// covers it (Ize 2013): it is part of the far constants.
///
/// A triangle is seen in the frame of the ray: `axes` puts the largest component of d last, and `shear` moves it onto
/// that axis.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct SingleRay {
    pub o: [f32; 3],
    pub d: [f32; 3],
    pub inverse: [f32; 3],
    pub near: [f32; 3],
    /// `inverse` times [`ONE_PLUS`].
    pub inverse_far: [f32; 3],
    pub far: [f32; 3],
    /// o, its axes in the order of `axes`.
    pub origin: [f32; 3],
    /// d[axes[0]] / d[axes[2]], d[axes[1]] / d[axes[2]], 1 / d[axes[2]].
    pub shear: [f32; 3],
    /// Row of [`Node::planes`](crate::node::Node::planes) that is entered first, for each axis.
    near_plane: [u32; 3],
    axes: [u32; 3],
    /// 1 if the scene is too large or too small for f32's products: look at every primitive, in f64.
    in_f64: u32,
    /// Fills the record up to [`WORDS`] words.
    _unused: u32,
}

/// Words of a [`SingleRay`].
const WORDS: usize = 32;

/// The axes across a ray and the one along it, by the number of the latter.
const AXES: [[u32; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

/// Beyond these, products of three coordinates and an inverse direction could overflow or vanish.
const HUGE: f32 = (1_u64 << 34) as f32;
const TINY: f32 = 1.0 / (1_u64 << 30) as f32;
/// Largest components of d that need no scaling lie between 1/this and this.
const FAR: f32 = (1_u64 << 20) as f32;

impl SingleRay {
    /// Components of d below this part of the largest are raised to it for the boxes.
    pub const FLAT: f32 = 1.0 / (1_u64 << 40) as f32;
    /// This times |o| + |scene| bounds the error of position that the boxes allow for. In units of half an ulp: 4 for a
    /// corner's shear along each of its two axes, and 2 to 4 for the products and the constants of the box's planes.
    pub const POSITION_ERROR: f32 = 6.0 * f32::EPSILON;

    /// Row of the node's planes that is entered first, for each axis: 2k or 2k + 1 for axis k.
    #[inline(always)]
    pub fn near_plane(&self) -> [usize; 3] {
        self.near_plane.map(|row| row as usize)
    }
    /// A permutation of 0, 1, 2; the largest component of d comes last.
    #[inline(always)]
    pub fn axes(&self) -> [usize; 3] {
        self.axes.map(|axis| axis as usize)
    }
    /// Whether the scene is too large or too small for f32's products: look at every primitive, in f64.
    pub fn is_in_f64(&self) -> bool {
        self.in_f64 == 1
    }
    /// Which rays [`SingleRay::usual`] is right for, the largest component of d, and that of o plus `extent`, which is
    /// the largest absolute coordinate of what is to be hit.
    #[inline(always)]
    pub fn sizes_of<F: Real>(o: [F; 3], d: [F; 3], extent: f32) -> (F::Mask, F, F) {
        let [x, y, z] = d.map(F::abs);
        let largest = z.max(x.max(y));
        let [x, y, z] = o.map(F::abs);
        let reach = z.max(x.max(y)) + extent;
        // Each comparison is false for NaN; one that hid in the maxima shows in the sums.
        let sum = (o[0] + o[1] + o[2]) + (d[0] + d[1] + d[2]);
        let fit = largest.le(F::splat(FAR))
            & largest.ge(F::splat(1.0 / FAR))
            & reach.le(F::splat(HUGE))
            & reach.ge(F::splat(TINY))
            & sum.lt(F::splat(f32::INFINITY));
        (fit, largest, reach)
    }

    /// The same for one ray; none if it does not fit.
    #[inline(always)]
    pub fn sizes(o: [f32; 3], d: [f32; 3], extent: f32) -> Option<(f32, f32)> {
        let (fit, largest, reach) = Self::sizes_of(o, d, extent);
        fit.then_some((largest, reach))
    }

    /// The ray, its sizes being known.
    #[inline(always)]
    pub fn usual(o: [f32; 3], d: [f32; 3], (largest, reach): (f32, f32)) -> Self {
        Self::prepared(o, d, d.map(f32::abs), largest, reach, false)
    }

    /// Any ray, and what its `t` is to be multiplied by; none if nothing can be hit: NaN, infinite or no direction.
    /// Directions that are very long or short are scaled by a power of two.
    #[cold]
    #[inline(never)]
    pub fn unusual(o: [f32; 3], d: [f32; 3], extent: f32) -> Option<(Self, f64)> {
        let size = d.map(f32::abs);
        let largest = size[0].max(size[1]).max(size[2]);
        let finite = o.iter().chain(&d).all(|x| x.is_finite());
        if !finite || largest == 0.0 {
            return None;
        }
        let scale = (-f64::from(largest).log2().floor()).exp2();
        let d = d.map(|x| (f64::from(x) * scale) as f32);
        let size = d.map(f32::abs);
        let largest = size[0].max(size[1]).max(size[2]);
        let reach = o.iter().fold(extent, |m, x| m + x.abs());
        Some((Self::prepared(o, d, size, largest, reach, !(TINY..=HUGE).contains(&reach)), scale))
    }

    /// Only what boxes need: `inverse`, `near`, `inverse_far` and `far`, and which axes it goes down.
    #[inline(always)]
    pub fn beam([inverse, near, inverse_far, far]: [[f32; 3]; 4], down: [bool; 3]) -> Self {
        let nothing = [0.0; 3];
        let near_plane = std::array::from_fn(|k| 2 * k as u32 + u32::from(down[k]));
        Self {
            o: nothing,
            d: nothing,
            inverse,
            near,
            inverse_far,
            far,
            origin: nothing,
            shear: nothing,
            near_plane,
            axes: AXES[0],
            in_f64: 0,
            _unused: 0,
        }
    }

    #[inline(always)]
    fn prepared(o: [f32; 3], d: [f32; 3], size: [f32; 3], largest: f32, reach: f32, in_f64: bool) -> Self {
        let z = if size[0] == largest {
            0
        } else if size[1] == largest {
            1
        } else {
            2
        };
        let axes = AXES[z];
        let least = largest * Self::FLAT;
        let error = Self::POSITION_ERROR * reach;
        let mut ray = Self {
            o,
            d,
            inverse: [0.0; 3],
            near: [0.0; 3],
            inverse_far: [0.0; 3],
            far: [0.0; 3],
            near_plane: [0; 3],
            axes,
            _unused: 0,
            origin: axes.map(|k| o[k as usize]),
            shear: [0.0; 3],
            in_f64: u32::from(in_f64),
        };
        for k in 0..3 {
            let sign = d[k].to_bits() & 0x8000_0000;
            let size = if size[k] > least { size[k] } else { least };
            let inverse = 1.0 / size; // positive
            let signed = f32::from_bits(inverse.to_bits() | sign);
            let center = -(o[k] * signed);
            ray.inverse[k] = signed;
            ray.near[k] = center - error * inverse;
            ray.inverse_far[k] = signed * ONE_PLUS;
            ray.far[k] = (center + error * inverse) * ONE_PLUS;
            ray.near_plane[k] = 2 * k as u32 + (sign >> 31);
        }
        // The component is at least `least`, so this is 1/d[z] as above.
        let inverse = ray.inverse[z];
        let [x, y, _] = axes.map(|k| d[k as usize]);
        ray.shear = [x * inverse, y * inverse, inverse];
        ray
    }
}

/// Sixteen rays, each prepared as a [`SingleRay`] is, to the bit.
#[derive(Clone)]
pub(crate) struct Rays([SingleRay; 16]);

impl Rays {
    /// Rays that [`SingleRay::usual`] is right for, with their sizes.
    #[inline(always)]
    pub fn new(o: [F32x16; 3], d: [F32x16; 3], largest: F32x16, reach: F32x16) -> Self {
        let size = d.map(F32x16::abs);
        let least = largest * SingleRay::FLAT;
        let error = reach * SingleRay::POSITION_ERROR;
        let sign_bit = Index16::splat(0x8000_0000);
        let along_x = size[0].eq(largest);
        let along_y = size[1].eq(largest).and_not(along_x);
        let choose = |[x, y, z]: [F32x16; 3]| F32x16::select(along_x, x, F32x16::select(along_y, y, z));
        let turned = |[x, y, z]: [F32x16; 3]| [choose([y, z, x]), choose([z, x, y]), choose([x, y, z])];
        let word = |x: u32| F32x16::from_bits(Index16::splat(x));
        let mut inverse = [F32x16::zero(); 3];
        // One column for every word of a ray.
        let mut columns = [[0.0; 16]; WORDS];
        let mut write = |row: usize, x: F32x16| x.store(&mut columns[row]);
        for k in 0..3 {
            let length = F32x16::one() / F32x16::select(size[k].gt(least), size[k], least);
            inverse[k] = length.copy_sign(d[k]);
            let center = -(o[k] * inverse[k]);
            let down = (d[k].to_bits() & sign_bit).eq(sign_bit);
            write(k, o[k]);
            write(3 + k, d[k]);
            write(6 + k, inverse[k]);
            write(9 + k, center - error * length);
            write(12 + k, inverse[k] * ONE_PLUS);
            write(15 + k, (center + error * length) * ONE_PLUS);
            write(24 + k, F32x16::select(down, word(2 * k as u32 + 1), word(2 * k as u32)));
        }
        let (origin, [x, y, _], axes) = (turned(o), turned(d), turned([0, 1, 2].map(word)));
        let inverse = choose(inverse);
        for (k, shear) in [x * inverse, y * inverse, inverse].into_iter().enumerate() {
            write(18 + k, origin[k]);
            write(21 + k, shear);
            write(27 + k, axes[k]);
        }
        let mut rows = [[0.0; WORDS]; 16];
        for (row, column) in (0..16).step_by(8).flat_map(|row| (0..WORDS).step_by(8).map(move |column| (row, column))) {
            let part =
                |i: usize| <Native as Simd>::F8::load(columns[column + i][row..row + 8].try_into().expect("eight"));
            for (i, x) in Native::transpose(std::array::from_fn(part)).into_iter().enumerate() {
                rows[row + i][column..column + 8].copy_from_slice(&x.array());
            }
        }
        // SAFETY: a ray is `WORDS` words of four bytes, of which any are good, in the order in which they were written.
        Self(unsafe { std::mem::transmute::<[[f32; WORDS]; 16], [SingleRay; 16]>(rows) })
    }

    /// One of them.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> &SingleRay {
        &self.0[i % 16]
    }
    /// Puts another in the place of one.
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: SingleRay) {
        self.0[i % 16] = ray;
    }
}

/// The nearest hit so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    pub t: f32,
    pub u: f32,
    pub v: f32,
    pub primitive: u32,
    pub instance: u32,
}

impl Best {
    #[inline(always)]
    pub fn up_to(tmax: f32) -> Self {
        Self { t: tmax, u: 0.0, v: 0.0, primitive: MISS, instance: MISS }
    }

    /// Whether a hit there comes before this one. Of two at the same distance the lower number comes first, so that
    /// the answer does not depend on the way through the tree.
    #[inline(always)]
    pub fn yields_to(&self, t: f32, primitive: u32, instance: u32) -> bool {
        t > 0.0 && (t < self.t || t == self.t && (instance, primitive) < (self.instance, self.primitive))
    }
}

/// A hit of nothing in every lane.
pub(crate) fn no_hit<F: Real>(tmax: F) -> crate::Hit<F> {
    crate::Hit {
        t: tmax,
        u: F::zero(),
        v: F::zero(),
        primitive: F::Index::splat(MISS),
        instance: F::Index::splat(MISS),
    }
}
