//! From the public calls to the kernels: one ray or sixteen, one tree or two levels of them.

use crate::accel::{Accel, World};
use crate::instance::transform;
use crate::ray::{Best, SingleRay, lane, no_hit};
use crate::shape::Shape;
use crate::simd::{Native, Simd};
use crate::single::{self, Shapes, Solid};
use crate::tree::Tree;
use crate::{Filter, Hit, MISS, Ray};
use rebond_lanes::{F32x16, Index, Mask, Real};

/// What [`Accel`] forwards its calls to.
pub trait Query: Real {
    /// The nearest hit of each lane in `mask`.
    fn closest<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Self::Mask, coherent: bool, filter: &K) -> Hit<Self>;
    /// Which lanes of `mask` hit anything.
    fn occluded<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Self::Mask, filter: &K) -> Self::Mask;
}

impl Query for f32 {
    #[inline]
    fn closest<K: Filter>(accel: &Accel, ray: &Ray<f32>, mask: bool, _: bool, filter: &K) -> Hit<f32> {
        let best = if mask { closest::<Native, K>(accel, ray, filter) } else { Best::up_to(ray.tmax) };
        Hit {
            t: best.t,
            u: best.u,
            v: best.v,
            primitive: Index::splat(best.primitive),
            instance: Index::splat(best.instance),
        }
    }
    #[inline]
    fn occluded<K: Filter>(accel: &Accel, ray: &Ray<f32>, mask: bool, filter: &K) -> bool {
        mask && occluded::<Native, K>(accel, ray, filter)
    }
}

impl Query for F32x16 {
    fn closest<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Self::Mask, _: bool, filter: &K) -> Hit<Self> {
        let mut hit = no_hit(ray.tmax);
        let mut bits = mask.bits();
        while bits != 0 {
            let i = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let best = closest::<Native, K>(accel, &lane(ray, i), filter);
            if best.primitive != MISS {
                hit.t = hit.t.with_lane(i, best.t);
                hit.u = hit.u.with_lane(i, best.u);
                hit.v = hit.v.with_lane(i, best.v);
                hit.primitive = hit.primitive.with_lane(i, best.primitive);
                hit.instance = hit.instance.with_lane(i, best.instance);
            }
        }
        hit
    }
    fn occluded<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Self::Mask, filter: &K) -> Self::Mask {
        let mut bits = mask.bits();
        let mut hit = 0;
        while bits != 0 {
            let i = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            hit |= u32::from(occluded::<Native, K>(accel, &lane(ray, i), filter)) << i;
        }
        Mask::from_bits(hit)
    }
}

/// The nearest hit of one ray.
#[inline]
pub(crate) fn closest<S: Simd, K: Filter>(accel: &Accel, ray: &Ray<f32>, filter: &K) -> Best {
    let mut best = Best::up_to(ray.tmax);
    if !(ray.tmax >= 0.0) {
        return best;
    }
    match &accel.world {
        World::Nothing => {}
        World::One { tree, instance } => {
            let tree = &accel.trees[*tree];
            let solid = Solid { instance: *instance, filter };
            closest_in::<S, K>(tree, ray.o, ray.d, *instance, filter, &solid, &mut best);
        }
        World::Many(top) => {
            let placed = Placement::<S, K> { accel, time: ray.time, filter, simd: std::marker::PhantomData };
            closest_in::<S, K>(top, ray.o, ray.d, MISS, filter, &placed, &mut best);
        }
    }
    best
}

/// Whether one ray hits anything.
#[inline]
pub(crate) fn occluded<S: Simd, K: Filter>(accel: &Accel, ray: &Ray<f32>, filter: &K) -> bool {
    if !(ray.tmax >= 0.0) {
        return false;
    }
    match &accel.world {
        World::Nothing => false,
        World::One { tree, instance } => {
            let tree = &accel.trees[*tree];
            let solid = Solid { instance: *instance, filter };
            occluded_in::<S, K>(tree, ray.o, ray.d, *instance, filter, &solid, ray.tmax)
        }
        World::Many(top) => {
            let placed = Placement::<S, K> { accel, time: ray.time, filter, simd: std::marker::PhantomData };
            occluded_in::<S, K>(top, ray.o, ray.d, MISS, filter, &placed, ray.tmax)
        }
    }
}

#[inline]
fn closest_in<S: Simd, K: Filter>(
    tree: &Tree,
    o: [f32; 3],
    d: [f32; 3],
    instance: u32,
    filter: &K,
    shapes: &impl Shapes,
    best: &mut Best,
) {
    let Some(root) = tree.root() else { return };
    let Some((ray, scale)) = SingleRay::new(o, d, tree.extent) else { return };
    if scale == 1.0 && !ray.huge {
        if tree.large {
            single::closest::<S, true, K>(tree, root, &ray, instance, filter, shapes, best);
        } else {
            single::closest::<S, false, K>(tree, root, &ray, instance, filter, shapes, best);
        }
    } else {
        unusual(scale, best, |best| {
            if ray.huge {
                tree.scan(&ray, instance, filter, shapes, best);
            } else {
                single::closest::<S, false, K>(tree, root, &ray, instance, filter, shapes, best);
            }
        });
    }
}

/// Runs a query whose `t` is to be multiplied by `scale`.
#[cold]
fn unusual(scale: f64, best: &mut Best, query: impl FnOnce(&mut Best)) {
    let mut scaled = *best;
    scaled.t = (f64::from(best.t) / scale) as f32;
    let before = (scaled.t, scaled.primitive, scaled.instance);
    query(&mut scaled);
    if before != (scaled.t, scaled.primitive, scaled.instance) {
        scaled.t = (f64::from(scaled.t) * scale) as f32;
        if scaled.t.is_finite() && scaled.t <= best.t {
            *best = scaled;
        }
    }
}

#[inline]
fn occluded_in<S: Simd, K: Filter>(
    tree: &Tree,
    o: [f32; 3],
    d: [f32; 3],
    instance: u32,
    filter: &K,
    shapes: &impl Shapes,
    tmax: f32,
) -> bool {
    let Some(root) = tree.root() else { return false };
    let Some((ray, scale)) = SingleRay::new(o, d, tree.extent) else { return false };
    if scale == 1.0 && !ray.huge {
        if tree.large {
            single::occluded::<S, true, K>(tree, root, &ray, instance, filter, shapes, tmax)
        } else {
            single::occluded::<S, false, K>(tree, root, &ray, instance, filter, shapes, tmax)
        }
    } else {
        let mut best = Best::up_to(tmax);
        closest_in::<S, K>(tree, o, d, instance, filter, shapes, &mut best);
        best.primitive != MISS
    }
}

/// Instances as the leaves of the upper tree.
struct Placement<'a, S, K> {
    accel: &'a Accel,
    time: f32,
    filter: &'a K,
    simd: std::marker::PhantomData<S>,
}

impl<S: Simd, K: Filter> Shapes for Placement<'_, S, K> {
    #[inline(never)]
    fn closest(&self, shape: &Shape, ray: &SingleRay, best: &mut Best) {
        let instance = shape.primitive();
        let placed = &self.accel.instances[instance as usize];
        let tree = &self.accel.trees[placed.geometry as usize];
        let solid = Solid { instance, filter: self.filter };
        if placed.is_identity() {
            closest_in::<S, K>(tree, ray.o, ray.d, instance, self.filter, &solid, best);
        } else if let Some(matrix) = placed.to_object(self.time) {
            let (o, d) = transform(&matrix, ray.o, ray.d);
            closest_in::<S, K>(tree, o, d, instance, self.filter, &solid, best);
        }
    }
    #[inline(never)]
    fn occluded(&self, shape: &Shape, ray: &SingleRay, tmax: f32) -> bool {
        let instance = shape.primitive();
        let placed = &self.accel.instances[instance as usize];
        let tree = &self.accel.trees[placed.geometry as usize];
        let solid = Solid { instance, filter: self.filter };
        if placed.is_identity() {
            occluded_in::<S, K>(tree, ray.o, ray.d, instance, self.filter, &solid, tmax)
        } else if let Some(matrix) = placed.to_object(self.time) {
            let (o, d) = transform(&matrix, ray.o, ray.d);
            occluded_in::<S, K>(tree, o, d, instance, self.filter, &solid, tmax)
        } else {
            false
        }
    }
}
