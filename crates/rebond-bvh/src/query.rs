//! From the public calls to the kernels: one ray or sixteen, one tree or two levels of them.

use crate::accel::{Accel, World};
use crate::instance::transform;
use crate::packet::{self, Packet};
use crate::ray::{Best, Rays, SingleRay, no_hit};
use crate::shape::Shape;
use crate::simd::{Native, Simd};
use crate::single::{self, Places, Shapes, Solid, Step};
use crate::tree::Tree;
use crate::{Filter, Hit, MISS, Ray};
use rebond_lanes::{F32x16, Index, Mask, Mask16, Real};
use std::mem::MaybeUninit;

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
                let mut hit = found.hit(instance);
                each_closest(accel, ray, alone, filter, &mut hit);
                return hit;
            }
            if coherent || tree.is_small() {
                let (mut packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = if tree.large {
                    packet::closest::<Native, true, K>(tree, &mut packet, fit, instance, filter)
                } else {
                    packet::closest::<Native, false, K>(tree, &mut packet, fit, instance, filter)
                };
                let alone = unusual | found.again;
                let mut hit = found.hit(instance);
                each_closest(accel, ray, alone, filter, &mut hit);
                return hit;
            }
        }
        let mut hit = no_hit(ray.tmax);
        each_closest(accel, ray, mask, filter, &mut hit);
        hit
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
                let (mut packet, fit, unusual) = Packet::new(ray, mask, tree.extent);
                let found = packet::occluded::<Native, K>(tree, &mut packet, fit, instance, filter);
                let alone = unusual | found.again;
                return if alone.any() { found.hit | each_occluded(accel, ray, alone, filter) } else { found.hit };
            }
        }
        each_occluded(accel, ray, mask, filter)
    }
}

/// The lanes of `mask`, one by one.
#[inline]
fn each_closest<K: Filter>(accel: &Accel, ray: &Ray<F32x16>, mask: Mask16, filter: &K, hit: &mut Hit<F32x16>) {
    if mask.none() {
        return;
    }
    let mut hits = Hits {
        t: store(hit.t),
        u: store(hit.u),
        v: store(hit.v),
        primitive: store(F32x16::from_bits(hit.primitive)).map(f32::to_bits),
        instance: store(F32x16::from_bits(hit.instance)).map(f32::to_bits),
    };
    let mut left = mask;
    if let World::One { tree, instance } = accel.world {
        let tree = &accel.trees[tree];
        let (fit, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, tree.extent);
        let usual = mask & fit & ray.tmax.ge(F32x16::zero());
        let rays = Rays::new(ray.o, ray.d, largest, reach);
        let tmax = store(ray.tmax);
        if tree.large {
            closest_of_each::<Native, true, K>(tree, &rays, &tmax, usual.bits(), instance, filter, &mut hits);
        } else {
            closest_of_each::<Native, false, K>(tree, &rays, &tmax, usual.bits(), instance, filter, &mut hits);
        }
        left = mask.and_not(usual);
    }
    if left.any() {
        let one = lane_of(ray);
        each(left.bits(), |i| hits.set(i, &closest::<Native, K>(accel, &one(i), filter)));
    }
    let words = |x: &[u32; 16]| F32x16::load(&x.map(f32::from_bits)).to_bits();
    (hit.t, hit.u, hit.v) = (F32x16::load(&hits.t), F32x16::load(&hits.u), F32x16::load(&hits.v));
    (hit.primitive, hit.instance) = (words(&hits.primitive), words(&hits.instance));
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
fn each(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize & 15);
        bits &= bits - 1;
    }
}

/// How many rays take turns in a large tree, so that what one waits for arrives while the others work.
const TURNS: usize = 12;

/// Starts a walk for each set bit, and lets [`TURNS`] of them take turns until `turn` says of each that it is over.
#[inline(always)]
fn in_turns<T, W>(
    mut bits: u32,
    mut start: impl FnMut(usize) -> W,
    mut turn: impl FnMut(usize, &mut W, &mut Places<T>) -> bool,
) {
    let mut next = || {
        let i = bits.trailing_zeros() as usize & 15;
        (bits != 0).then(|| {
            bits &= bits - 1;
            (i, start(i))
        })
    };
    let mut places: [Places<T>; TURNS] = std::array::from_fn(|_| single::no_places());
    let mut walks: [MaybeUninit<(usize, W)>; TURNS] = [const { MaybeUninit::uninit() }; TURNS];
    // Those that are under way.
    let mut slots = [0; TURNS];
    let mut busy = 0;
    while busy < TURNS
        && let Some(walk) = next()
    {
        walks[busy].write(walk);
        slots[busy] = busy;
        busy += 1;
    }
    while busy > 0 {
        let mut at = 0;
        while at < busy {
            let slot = slots[at];
            // SAFETY: what is under way was written.
            let (i, walk) = unsafe { walks[slot].assume_init_mut() };
            if turn(*i, walk, &mut places[slot]) {
                at += 1;
            } else if let Some(walk) = next() {
                walks[slot].write(walk);
                at += 1;
            } else {
                busy -= 1;
                slots[at] = slots[busy];
            }
        }
    }
}

/// The rays one by one.
#[inline(always)]
fn lane_of(ray: &Ray<F32x16>) -> impl Fn(usize) -> Ray<f32> {
    let (o, d) = (ray.o.map(store), ray.d.map(store));
    let (tmax, time) = (store(ray.tmax), store(ray.time));
    move |i| Ray { o: o.map(|x| x[i]), d: d.map(|x| x[i]), tmax: tmax[i], time: time[i] }
}

#[inline(never)]
fn closest_of_each<S: Simd, const PREFETCH: bool, K: Filter>(
    tree: &Tree,
    rays: &Rays,
    tmax: &[f32; 16],
    lanes: u32,
    instance: u32,
    filter: &K,
    hits: &mut Hits,
) {
    let Some(root) = tree.root() else { return };
    let solid = Solid { instance, filter };
    if PREFETCH {
        let start = |i: usize| (rays.lane(i), single::Nearest::new(root, tmax[i]), Best::up_to(tmax[i]));
        in_turns(lanes, start, |i, (ray, walk, best), places| {
            while walk.step::<S, true, K>(places, tree, ray, instance, filter, &solid, best) {
                if walk.current.is_leaf() {
                    single::prefetch(tree, walk.current);
                    return true;
                }
            }
            hits.set(i, best);
            false
        });
    } else {
        each(lanes, |i| {
            let mut best = Best::up_to(tmax[i]);
            single::closest::<S, false, K>(tree, root, &rays.lane(i), instance, filter, &solid, &mut best);
            hits.set(i, &best);
        });
    }
}

#[inline]
fn each_occluded<K: Filter>(accel: &Accel, ray: &Ray<F32x16>, mask: Mask16, filter: &K) -> Mask16 {
    let (mut left, mut hit) = (mask, 0);
    if let World::One { tree, instance } = accel.world {
        let tree = &accel.trees[tree];
        let (fit, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, tree.extent);
        let usual = mask & fit & ray.tmax.ge(F32x16::zero());
        let rays = Rays::new(ray.o, ray.d, largest, reach);
        hit = occluded_of_each::<Native, K>(tree, &rays, &store(ray.tmax), usual.bits(), instance, filter);
        left = mask.and_not(usual);
    }
    if left.any() {
        let one = lane_of(ray);
        each(left.bits(), |i| hit |= u32::from(occluded::<Native, K>(accel, &one(i), filter)) << i);
    }
    Mask::from_bits(hit)
}

#[inline(never)]
fn occluded_of_each<S: Simd, K: Filter>(
    tree: &Tree,
    rays: &Rays,
    tmax: &[f32; 16],
    lanes: u32,
    instance: u32,
    filter: &K,
) -> u32 {
    let Some(root) = tree.root() else { return 0 };
    let solid = Solid { instance, filter };
    let mut hit = 0;
    if tree.large {
        let start = |i: usize| (rays.lane(i), single::Any::new(root));
        in_turns(lanes, start, |i, (ray, walk), places| {
            let step = walk.step::<S, true, false, K>(places, tree, ray, instance, filter, &solid, tmax[i]);
            hit |= u32::from(step == Step::Blocked) << i;
            if step == Step::GoOn {
                single::prefetch(tree, walk.current);
            }
            step == Step::GoOn
        });
    } else {
        each(lanes, |i| {
            let blocked = single::occluded::<S, false, K>(tree, root, &rays.lane(i), instance, filter, &solid, tmax[i]);
            hit |= u32::from(blocked) << i;
        });
    }
    hit
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
        World::Many(slices) => {
            let top = slices.at(ray.time);
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
    if ray.in_f64 {
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

    /// The arrays' kernel, the packets and the look at everything find the same; nothing gets out.
    #[test]
    fn all_paths_agree() {
        let few = if cfg!(miri) { 16 } else { 2000 };
        let here = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let there = [[0.0, -1.0, 0.0, 0.25], [2.0, 0.0, 0.0, 0.5], [0.0, 0.0, 0.5, 0.0]];
        // Tiny, small enough for packets of any kind, two levels.
        let sizes = if cfg!(miri) { [3, 5, 3] } else { [4, 9, 6] };
        for (n, matrices) in sizes.into_iter().zip([vec![here], vec![here], vec![here, there]]) {
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
                assert!(accel.occluded(&wide, all).all());
                for (i, ray) in group.iter().enumerate() {
                    let native = closest::<Native, _>(&accel, ray, &Everything);
                    assert_eq!(native.primitive, packet.primitive.lane(i));
                    assert_eq!(native.t, packet.t.lane(i));
                    let portable = closest::<Portable, _>(&accel, ray, &Everything);
                    assert!(portable.primitive != MISS && occluded::<Portable, _>(&accel, ray, &Everything));
                    // Whether a ray just passes a corner may depend on the machine.
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
