//! From the public calls to the kernels: one ray or sixteen, one tree or two levels of them.

use crate::accel::{Accel, Slices, World};
use crate::instance::transform;
use crate::packet::{self, Packet};
use crate::ray::{Best, Rays, SingleRay, no_hit};
use crate::shape::Shape;
use crate::simd::{Native, Simd};
use crate::single::{self, Shapes, Solid};
use crate::tree::Tree;
use crate::turns::{self, Among, Here};
use crate::{Filter, Hit, MISS, Ray};
use rebond_lanes::{F32x16, Index, Mask, Mask16, Real};
use std::marker::PhantomData;

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
    fn closest<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Mask16, coherent: bool, filter: &K) -> Hit<Self> {
        if let World::One { tree, instance } = accel.world {
            let tree = &accel.trees[tree];
            if tree.is_tiny() {
                let (packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = packet::scan_closest(tree, &packet, fit, instance, filter);
                let alone = unusual | found.again;
                let hit = found.hit(instance);
                return if alone.any() { each_closest(accel, ray, alone, filter, &hit) } else { hit };
            }
            if coherent {
                let (packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = if tree.large {
                    packet::closest::<Native, true, K>(tree, &packet, fit, instance, filter)
                } else {
                    packet::closest::<Native, false, K>(tree, &packet, fit, instance, filter)
                };
                let alone = unusual | found.again;
                let hit = found.hit(instance);
                return if alone.any() { each_closest(accel, ray, alone, filter, &hit) } else { hit };
            }
        }
        each_closest(accel, ray, mask, filter, &no_hit(ray.tmax))
    }

    fn occluded<K: Filter>(accel: &Accel, ray: &Ray<Self>, mask: Mask16, filter: &K) -> Mask16 {
        if let World::One { tree, instance } = accel.world {
            let tree = &accel.trees[tree];
            if tree.is_tiny() {
                let (packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = packet::scan_occluded(tree, &packet, fit, instance, filter);
                let alone = unusual | found.again;
                return if alone.any() { found.hit | each_occluded(accel, ray, alone, filter) } else { found.hit };
            }
            if tree.is_small() {
                let (packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = packet::occluded::<Native, K>(tree, &packet, fit, instance, filter);
                let alone = unusual | found.again;
                return if alone.any() { found.hit | each_occluded(accel, ray, alone, filter) } else { found.hit };
            }
        }
        each_occluded(accel, ray, mask, filter)
    }
}

/// The largest absolute coordinate of what there is, if rays may take turns there.
#[inline(always)]
fn in_turns(accel: &Accel) -> Option<f32> {
    match &accel.world {
        World::Nothing => None,
        World::One { tree, .. } => Some(accel.trees[*tree].extent),
        World::Many(slices) => slices.in_turns.then_some(slices.extent),
    }
}

/// The lanes of `mask`, in turns where that can be; the others keep what they hit before.
#[inline]
fn each_closest<K: Filter>(
    accel: &Accel,
    ray: &Ray<F32x16>,
    mask: Mask16,
    filter: &K,
    hit: &Hit<F32x16>,
) -> Hit<F32x16> {
    let mut hits = Hits {
        t: store(hit.t),
        u: store(hit.u),
        v: store(hit.v),
        primitive: store(F32x16::from_bits(hit.primitive)).map(f32::to_bits),
        instance: store(F32x16::from_bits(hit.instance)).map(f32::to_bits),
    };
    let mut left = mask;
    if let Some(extent) = in_turns(accel) {
        let (fit, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, extent);
        let usual = mask & fit & ray.tmax.ge(F32x16::zero());
        let rays = Rays::new(ray.o, ray.d, largest, reach);
        let tmax = store(ray.tmax);
        let found = |i: usize, best: &Best| hits.set(i, best);
        match &accel.world {
            World::Nothing => {}
            World::One { tree, instance } => {
                let here = Here { tree: &accel.trees[*tree], rays: &rays, instance: *instance };
                turns::closest::<Native, _, _>(here, &tmax, usual.bits(), filter, found, |_, _, _, _| ());
            }
            World::Many(slices) => {
                closest_among(accel, slices, &rays, [&tmax, &store(ray.time)], usual.bits(), filter, found);
            }
        }
        left = mask.and_not(usual);
    }
    if left.any() {
        let one = lane_of(ray);
        each(left.bits(), |i| hits.set(i, &closest::<Native, K>(accel, &one(i), filter)));
    }
    let words = |x: &[u32; 16]| F32x16::load(&x.map(f32::from_bits)).to_bits();
    Hit {
        t: F32x16::load(&hits.t),
        u: F32x16::load(&hits.u),
        v: F32x16::load(&hits.v),
        primitive: words(&hits.primitive),
        instance: words(&hits.instance),
    }
}

/// The nearest hits among instances, in turns.
#[inline(never)]
fn closest_among<K: Filter>(
    accel: &Accel,
    slices: &Slices,
    rays: &Rays,
    [tmax, times]: [&[f32; 16]; 2],
    lanes: u32,
    filter: &K,
    found: impl FnMut(usize, &Best),
) {
    let alone = |i: usize, shape: &Shape, ray: &SingleRay, best: &mut Best| {
        Placement::<Native, K> { accel, time: times[i], filter, simd: PhantomData }.closest(shape, ray, best);
    };
    turns::closest::<Native, _, _>(Among::new(accel, slices, rays, times), tmax, lanes, filter, found, alone);
}

/// The lanes that an instance stops, in turns.
#[inline(never)]
fn occluded_among<K: Filter>(
    accel: &Accel,
    slices: &Slices,
    rays: &Rays,
    [tmax, times]: [&[f32; 16]; 2],
    lanes: u32,
    filter: &K,
) -> u32 {
    let alone = |i: usize, shape: &Shape, ray: &SingleRay| {
        Placement::<Native, K> { accel, time: times[i], filter, simd: PhantomData }.occluded(shape, ray, tmax[i])
    };
    turns::occluded::<Native, _, _>(Among::new(accel, slices, rays, times), tmax, lanes, filter, alone)
}

/// What each lane found.
struct Hits {
    t: [f32; 16],
    u: [f32; 16],
    v: [f32; 16],
    primitive: [u32; 16],
    instance: [u32; 16],
}

impl Hits {
    #[inline(always)]
    fn set(&mut self, i: usize, best: &Best) {
        (self.t[i], self.u[i], self.v[i]) = (best.t, best.u, best.v);
        (self.primitive[i], self.instance[i]) = (best.primitive, best.instance);
    }
}

/// Calls `f` with each set bit.
#[inline(always)]
pub(crate) fn each(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize & 15);
        bits &= bits - 1;
    }
}

/// The rays one by one.
#[inline(always)]
fn lane_of(ray: &Ray<F32x16>) -> impl Fn(usize) -> Ray<f32> {
    let (o, d) = (ray.o.map(store), ray.d.map(store));
    let (tmax, time) = (store(ray.tmax), store(ray.time));
    move |i| Ray { o: o.map(|x| x[i]), d: d.map(|x| x[i]), tmax: tmax[i], time: time[i] }
}

#[inline]
fn each_occluded<K: Filter>(accel: &Accel, ray: &Ray<F32x16>, mask: Mask16, filter: &K) -> Mask16 {
    let (mut left, mut hit) = (mask, 0);
    if let Some(extent) = in_turns(accel) {
        let (fit, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, extent);
        let usual = mask & fit & ray.tmax.ge(F32x16::zero());
        let rays = Rays::new(ray.o, ray.d, largest, reach);
        let tmax = store(ray.tmax);
        match &accel.world {
            World::Nothing => {}
            World::One { tree, instance } => {
                let here = Here { tree: &accel.trees[*tree], rays: &rays, instance: *instance };
                hit = turns::occluded::<Native, _, _>(here, &tmax, usual.bits(), filter, |_, _, _| false);
            }
            World::Many(slices) => {
                hit = occluded_among(accel, slices, &rays, [&tmax, &store(ray.time)], usual.bits(), filter);
            }
        }
        left = mask.and_not(usual);
    }
    if left.any() {
        let one = lane_of(ray);
        each(left.bits(), |i| hit |= u32::from(occluded::<Native, K>(accel, &one(i), filter)) << i);
    }
    Mask::from_bits(hit)
}

#[inline(always)]
fn store(x: F32x16) -> [f32; 16] {
    let mut out = [0.0; 16];
    x.store(&mut out);
    out
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
        World::Many(slices) => {
            let top = slices.at(ray.time);
            let placed = Placement::<S, K> { accel, time: ray.time, filter, simd: PhantomData };
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
        World::Many(slices) => {
            let top = slices.at(ray.time);
            let placed = Placement::<S, K> { accel, time: ray.time, filter, simd: PhantomData };
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
    if let Some(sizes) = SingleRay::sizes(o, d, tree.extent) {
        let ray = SingleRay::usual(o, d, sizes);
        if tree.large {
            single::closest::<S, true, K>(tree, root, &ray, instance, filter, shapes, best);
        } else {
            single::closest::<S, false, K>(tree, root, &ray, instance, filter, shapes, best);
        }
    } else {
        unusual::<S, K>(tree, o, d, instance, filter, shapes, best);
    }
}

/// The same for directions that are scaled and for scenes beyond the boxes' arithmetic.
#[cold]
#[inline(never)]
fn unusual<S: Simd, K: Filter>(
    tree: &Tree,
    o: [f32; 3],
    d: [f32; 3],
    instance: u32,
    filter: &K,
    shapes: &impl Shapes,
    best: &mut Best,
) {
    let (Some(root), Some((ray, scale))) = (tree.root(), SingleRay::unusual(o, d, tree.extent)) else { return };
    let mut scaled = *best;
    scaled.t = (f64::from(best.t) / scale) as f32;
    let before = (scaled.t, scaled.primitive, scaled.instance);
    if ray.is_in_f64() {
        tree.scan(&ray, instance, filter, shapes, &mut scaled);
    } else {
        single::closest::<S, false, K>(tree, root, &ray, instance, filter, shapes, &mut scaled);
    }
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
    if let Some(sizes) = SingleRay::sizes(o, d, tree.extent) {
        let ray = SingleRay::usual(o, d, sizes);
        if tree.large {
            single::occluded::<S, true, K>(tree, root, &ray, instance, filter, shapes, tmax)
        } else {
            single::occluded::<S, false, K>(tree, root, &ray, instance, filter, shapes, tmax)
        }
    } else {
        let mut best = Best::up_to(tmax);
        unusual::<S, K>(tree, o, d, instance, filter, shapes, &mut best);
        best.primitive != MISS
    }
}

/// Instances as the leaves of the upper tree.
struct Placement<'a, S, K> {
    accel: &'a Accel,
    time: f32,
    filter: &'a K,
    simd: PhantomData<S>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Portable;
    use crate::{BuildOptions, Everything, Geometry, Instance, Preset, Sphere};

    /// A closed wavy cylinder around the y axis, with a ball in it.
    fn mesh(n: u32) -> Geometry {
        let mut geometry = Geometry::default();
        for i in 0..=n {
            for j in 0..n {
                let angle = j as f32 / n as f32 * std::f32::consts::TAU;
                let radius = 1.0 + 0.2 * (5.0 * angle + i as f32).sin();
                geometry.positions.push([radius * angle.cos(), i as f32 / n as f32 * 2.0 - 1.0, radius * angle.sin()]);
            }
        }
        let at = |i: u32, j: u32| i * n + j % n;
        for i in 0..n {
            for j in 0..n {
                geometry.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                geometry.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        for (i, y) in [(0, -1.0), (n, 1.0)] {
            let middle = geometry.positions.len() as u32;
            geometry.positions.push([0.0, y, 0.0]);
            geometry.triangles.extend((0..n).map(|j| [middle, at(i, j), at(i, j + 1)]));
        }
        geometry.spheres.push(Sphere { center: [0.3, 0.4, 0.0], radius: 0.2 });
        geometry
    }

    /// Sixteen rays that stay together, one moment in a narrow bundle and the next in a wide one, find what each finds alone.
    #[test]
    fn bundles_agree() {
        let here = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mut word = 1_u32;
        let mut random = || {
            word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (word >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let (n, bundles) = if cfg!(miri) { (6, 10) } else { (60, 20_000) };
        for offset in [[0.0; 3], [300.0, -7.0, 1e4]] {
            let mut geometry = mesh(n);
            geometry.positions.iter_mut().for_each(|p| *p = std::array::from_fn(|k| p[k] + offset[k]));
            geometry.spheres[0].center = std::array::from_fn(|k| geometry.spheres[0].center[k] + offset[k]);
            let corners = geometry.positions.clone();
            let instances = vec![Instance { geometry: 0, keyframes: vec![(0.0, here)] }];
            let options = BuildOptions::with_preset(Preset::Fast);
            let (accel, _) = Accel::build(vec![geometry], instances, &options).unwrap();
            let (mut hits, mut narrow) = (0, 0);
            for bundle in 0..bundles {
                let [wide, apart] = [0, 5].map(|shift| [0.0, 1e-4, 0.01, 0.1, 1.0][(bundle >> shift) % 5]);
                let axis = [random(), random(), random()];
                let from: [f32; 3] = std::array::from_fn(|k| offset[k] + 4.0 * random());
                let to = corners[bundle % corners.len()];
                let rays: [Ray<f32>; 16] = std::array::from_fn(|i| {
                    let o = from.map(|x| x + apart * random());
                    // Some go along an axis, to the bit.
                    let d = std::array::from_fn(|k| match bundle % 7 {
                        0 if k != bundle % 3 => 0.0,
                        1..4 => axis[k] + wide * random(),
                        _ => to[k] - from[k] + wide * random(),
                    });
                    Ray { o, d, tmax: if i == 3 { 1.0 } else { f32::INFINITY }, time: 0.0 }
                });
                let lanes = |f: &dyn Fn(&Ray<f32>) -> f32| F32x16::load(&rays.each_ref().map(f));
                let wide = Ray {
                    o: std::array::from_fn(|k| lanes(&|r| r.o[k])),
                    d: std::array::from_fn(|k| lanes(&|r| r.d[k])),
                    tmax: lanes(&|r| r.tmax),
                    time: lanes(&|r| r.time),
                };
                let mask = Mask16::from_bits([0xffff, 0xbff7, 0x00f1][bundle % 3]);
                let hit = accel.closest(&wide, mask, true);
                for (i, ray) in rays.iter().enumerate().filter(|(i, _)| mask.bits() >> i & 1 == 1) {
                    let one = closest::<Native, _>(&accel, ray, &Everything);
                    assert_eq!((one.primitive, one.t), (hit.primitive.lane(i), hit.t.lane(i)), "{bundle} {i} {ray:?}");
                    hits += usize::from(one.primitive != MISS);
                }
                let signs = |ray: &Ray<f32>| ray.d.map(f32::is_sign_negative);
                narrow += usize::from(rays.iter().all(|ray| signs(ray) == signs(&rays[0])));
            }
            assert!(cfg!(miri) || hits > 4 * bundles && narrow > bundles / 3, "{hits} {narrow}");
        }
    }

    /// Rays that take turns find `hit`, and are stopped if they go on beyond it but not if they end before.
    fn turns_agree<S: Simd>(tree: &Tree, ray: &Ray<F32x16>, lanes: u32, hit: &Hit<F32x16>) {
        let (_, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, tree.extent);
        let rays = Rays::new(ray.o, ray.d, largest, reach);
        let (t, mut found) = (store(hit.t), 0);
        let here = || Here { tree, rays: &rays, instance: 0 };
        let check = |i: usize, best: &Best| {
            assert_eq!(found >> i & 1, 0);
            found |= 1 << i;
            assert!((best.t - t[i]).abs() <= 1e-5 * t[i]);
        };
        turns::closest::<S, _, _>(here(), &store(ray.tmax), lanes, &Everything, check, |_, _, _, _| ());
        assert_eq!(found, lanes);
        let occluded =
            |f: f32| turns::occluded::<S, _, _>(here(), &t.map(|t| f * t), lanes, &Everything, |_, _, _| false);
        assert_eq!((occluded(1.001), occluded(0.999)), (lanes, 0));
    }

    /// Where the ways down two trees do not fit into one stack, rays go by themselves and find the same.
    #[test]
    #[cfg_attr(miri, ignore)]
    fn deep_trees_among_deep_trees() {
        let size = |i: u16, n: u16| (-60.0 * f32::from(i) / f32::from(n)).exp2();
        let mut geometry = Geometry::default();
        for s in (0..2000).map(|i| size(i, 2000)) {
            let first = geometry.positions.len() as u32;
            geometry.positions.extend([[0.0; 3], [s, s, 0.0], [s, 0.0, s / 2.0]]);
            geometry.triangles.push([first, first + 1, first + 2]);
        }
        let scaled = |s: f32| [[s, 0.0, 0.0, 0.0], [0.0, s, 0.0, 0.0], [0.0, 0.0, s, 0.0]];
        let placed = |i| Instance { geometry: 0, keyframes: vec![(0.0, scaled(size(i, 400)))] };
        let instances = (0..400).map(placed).collect();
        let (accel, _) = Accel::build(vec![geometry], instances, &BuildOptions::default()).unwrap();
        assert!(matches!(&accel.world, World::Many(slices) if !slices.in_turns));
        let mut hits = 0;
        for round in 0..20 {
            let s = size(round, 20);
            let along = |k: usize| {
                F32x16::load(&std::array::from_fn::<f32, 16, _>(|i| s * [0.9, 0.3, 0.1][k] + 0.01 * s * i as f32))
            };
            let o = [along(0), along(1), F32x16::splat(-s)];
            let d = [F32x16::zero(), F32x16::zero(), F32x16::one()];
            let wide = Ray { o, d, tmax: F32x16::splat(f32::INFINITY), time: F32x16::zero() };
            let hit = accel.closest(&wide, Mask16::splat(true), false);
            let dark = accel.occluded(&wide, Mask16::splat(true)).bits();
            for i in 0..16 {
                let ray = Ray { o: o.map(|x| x.lane(i)), d: [0.0, 0.0, 1.0], tmax: f32::INFINITY, time: 0.0 };
                let one = closest::<Native, _>(&accel, &ray, &Everything);
                assert_eq!(
                    (one.t, one.primitive, one.instance),
                    (hit.t.lane(i), hit.primitive.lane(i), hit.instance.lane(i))
                );
                assert_eq!(dark >> i & 1 == 1, one.primitive != MISS);
                hits += u32::from(one.primitive != MISS);
            }
        }
        assert!(hits > 100, "{hits}");
    }

    /// The arrays' kernel, the packets and the look at everything find the same; nothing gets out.
    #[test]
    fn all_paths_agree() {
        let few = if cfg!(miri) { 16 } else { 2000 };
        let here = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let there = [[0.0, -1.0, 0.0, 0.25], [2.0, 0.0, 0.0, 0.5], [0.0, 0.0, 0.5, 0.0]];
        // Tiny, small enough for packets of any kind, too large for that, two levels.
        let sizes = if cfg!(miri) { [3, 5, 6, 3] } else { [4, 9, 40, 6] };
        for (n, matrices) in sizes.into_iter().zip([vec![here], vec![here], vec![here], vec![here, there]]) {
            let geometry = mesh(n);
            let corners = geometry.positions.clone();
            let instances: Vec<_> =
                matrices.iter().map(|&m| Instance { geometry: 0, keyframes: vec![(0.0, m)] }).collect();
            let one = instances.len() == 1;
            let options = BuildOptions::with_preset(if cfg!(miri) { Preset::Fast } else { Preset::Quality });
            let (accel, _) = Accel::build(vec![geometry], instances, &options).unwrap();
            let mut word = 1_u32;
            let mut random = || {
                word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                (word >> 8) as f32 / (1 << 24) as f32 - 0.5
            };
            let rays: Vec<Ray<f32>> = (0..few)
                .map(|i| {
                    let o: [f32; 3] = [0.1 * random() - 0.2, 0.2 * random() - 0.3, 0.1 * random()];
                    let corner = corners[i % corners.len()];
                    let d = if i % 2 == 0 {
                        std::array::from_fn(|k| corner[k] - o[k])
                    } else {
                        [random(), random(), random()]
                    };
                    Ray { o, d, tmax: f32::INFINITY, time: 0.0 }
                })
                .collect();
            for group in rays.chunks_exact(16) {
                let lanes = |f: &dyn Fn(&Ray<f32>) -> f32| {
                    let lanes: [f32; 16] = std::array::from_fn(|i| f(&group[i]));
                    F32x16::load(&lanes)
                };
                let wide = Ray {
                    o: std::array::from_fn(|k| lanes(&|r| r.o[k])),
                    d: std::array::from_fn(|k| lanes(&|r| r.d[k])),
                    tmax: lanes(&|r| r.tmax),
                    time: lanes(&|r| r.time),
                };
                let all = Mask16::splat(true);
                let packet = accel.closest(&wide, all, true);
                let apart = accel.closest(&wide, all, false);
                assert!(accel.occluded(&wide, all).all());
                if one {
                    turns_agree::<Native>(&accel.trees[0], &wide, 0b1011_1111_1111_1101, &packet);
                    // Every other ray goes to a corner, and whether it just passes may depend on the machine.
                    turns_agree::<Portable>(&accel.trees[0], &wide, 0b1010_1010_1000_1010, &packet);
                }
                for (i, ray) in group.iter().enumerate() {
                    let native = closest::<Native, _>(&accel, ray, &Everything);
                    assert_eq!(native.primitive, packet.primitive.lane(i));
                    assert_eq!(native.t, packet.t.lane(i));
                    assert_eq!((native.t, native.primitive), (apart.t.lane(i), apart.primitive.lane(i)));
                    let portable = closest::<Portable, _>(&accel, ray, &Everything);
                    assert!(portable.primitive != MISS && occluded::<Portable, _>(&accel, ray, &Everything));
                    // As above.
                    if i % 2 == 0 {
                        continue;
                    }
                    assert!((portable.t - native.t).abs() <= 1e-5 * native.t);
                    if one {
                        let tree = &accel.trees[0];
                        let (prepared, scale) = SingleRay::unusual(ray.o, ray.d, tree.extent).unwrap();
                        let mut best = Best::up_to(ray.tmax);
                        let solid = Solid { instance: 0, filter: &Everything };
                        tree.scan(&prepared, 0, &Everything, &solid, &mut best);
                        assert!((f64::from(best.t) * scale - f64::from(native.t)).abs() <= 1e-5 * f64::from(native.t));
                    }
                }
            }
        }
    }
}
