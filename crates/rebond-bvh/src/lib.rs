//! Ray queries over triangles, spheres, disks and their instances. Knows no light.
//!
//! ```
//! use rebond_bvh::{Accel, BuildOptions, Geometry, Instance, Ray};
//! use rebond_lanes::Index;
//! let triangle = Geometry {
//!     positions: vec![[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]],
//!     triangles: vec![[0, 1, 2]],
//!     ..Default::default()
//! };
//! let here = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
//! let instance = Instance { geometry: 0, keyframes: vec![(0.0, here)] };
//! let (accel, _) = Accel::build(vec![triangle], vec![instance], &BuildOptions::default()).unwrap();
//! let ray = Ray { o: [0.25, 0.5, 0.0], d: [0.0, 0.0, 2.0], tmax: f32::INFINITY, time: 0.0 };
//! let hit = accel.closest(&ray, true, false);
//! assert_eq!((hit.t, hit.u, hit.v, hit.primitive.lane(0)), (0.5, 0.25, 0.5, 0));
//! ```
//!
//! A file is one idea: [`Accel`] (accel.rs) holds trees (tree.rs) of eight-wide nodes (node.rs) over blocks of
//! triangles (triangle.rs) and other shapes (shape.rs), made by `build/`. query.rs takes rays to them: one at a time
//! (ray.rs, single.rs) or sixteen, together (packet.rs) or in turns (turns.rs), through instances (instance.rs) or
//! straight.

// An axis or a slot indexes several arrays at once; `!(a >= b)` is meant to be true for NaN.
#![allow(clippy::needless_range_loop, clippy::neg_cmp_op_on_partial_ord)]

mod accel;
mod build;
mod instance;
mod node;
mod packet;
mod query;
mod ray;
mod shape;
mod simd;
mod single;
mod tree;
mod triangle;
mod turns;

pub use accel::{Accel, BuildError, BuildOptions, BuildReport, Preset};

use rebond_lanes::{F32x16, Real};

/// The primitive of a [`Hit`] that hit nothing.
pub const MISS: u32 = u32::MAX;

/// One ray, or a lane's worth of them: the points `o + t·d`, 0 < t ≤ `tmax`. `d` need not be normalised.
#[derive(Clone, Copy, Debug)]
pub struct Ray<F: Real> {
    /// Origin.
    pub o: [F; 3],
    /// Direction.
    pub d: [F; 3],
    /// Where the ray ends.
    pub tmax: F,
    /// When it was sent; moving instances are where they are at that time.
    pub time: F,
}

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit<F: Real> {
    /// Ray parameter.
    pub t: F,
    /// Barycentric coordinate of a triangle's second vertex; unspecified for other primitives.
    pub u: F,
    /// Barycentric coordinate of a triangle's third vertex; unspecified for other primitives.
    pub v: F,
    /// Primitive, counted over all geometries in order (a geometry's triangles, then its spheres, then its disks), or
    /// [`MISS`].
    pub primitive: F::Index,
    /// Instance, as its place in the list that [`Accel::build`] was given.
    pub instance: F::Index,
}

/// A sphere, seen from inside and outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius.
    pub radius: f32,
}

/// A flat round disk, seen from both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disk {
    /// Centre.
    pub center: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Radius.
    pub radius: f32,
}

/// Surfaces in one common space.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Corners of the triangles.
    pub positions: Vec<[f32; 3]>,
    /// Triangles, three places in `positions` each.
    pub triangles: Vec<[u32; 3]>,
    /// Spheres.
    pub spheres: Vec<Sphere>,
    /// Disks.
    pub disks: Vec<Disk>,
}

/// A 3×4 matrix, row by row: p ↦ the first three columns times p, plus the last.
pub type Affine = [[f32; 4]; 3];

/// A geometry put somewhere in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Which of the geometries.
    pub geometry: u32,
    /// (time, object-to-world) at one or more times, increasing; in between, matrices are interpolated linearly, and
    /// outside the first or last holds. Invertible at all times.
    pub keyframes: Vec<(f32, Affine)>,
}

/// Numbers that rays can be traced in: `f32` and [`F32x16`].
pub trait Trace: query::Query {}
impl Trace for f32 {}
impl Trace for F32x16 {}

/// Says which hits count: a texture with holes, a surface that some rays do not see.
pub trait Filter: Sync {
    /// Whether it keeps every hit, so that it need not be asked.
    const KEEPS_ALL: bool = false;
    /// Whether the ray stops at this point of a primitive. `u` and `v` are a triangle's barycentric coordinates as in
    /// [`Hit`]; for other primitives u is the distance along the ray and v is 0. Called for any candidate on the way, in no order, more than once for some.
    fn keep(&self, primitive: u32, instance: u32, u: f32, v: f32) -> bool;
}

/// Keeps every hit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Everything;

impl Filter for Everything {
    const KEEPS_ALL: bool = true;
    #[inline(always)]
    fn keep(&self, _: u32, _: u32, _: f32, _: f32) -> bool {
        true
    }
}

impl<T: Fn(u32, u32, f32, f32) -> bool + Sync> Filter for T {
    #[inline(always)]
    fn keep(&self, primitive: u32, instance: u32, u: f32, v: f32) -> bool {
        self(primitive, instance, u, v)
    }
}
