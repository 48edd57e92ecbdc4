//! Ray queries over triangles, spheres, disks and their instances. Knows no light.

use rebond_lanes::{F32x16, Index, Real};

/// The primitive of a [`Hit`] that hit nothing.
pub const MISS: u32 = u32::MAX;

/// One ray, or a lane's worth of them: the points `o + t·d`, 0 ≤ t ≤ `tmax`. `d` need not be normalised.
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
