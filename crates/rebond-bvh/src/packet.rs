//! Sixteen rays at once: through the tree as long as enough of them stay together, or straight over all triangles.
//!
//! Whatever the path, a ray meets a triangle by the same arithmetic as in triangle.rs, to the bit; only the order of
//! the axes across the ray may differ, which changes no more than the sign that all edge functions share. One thing is
//! free: whether a hit within rounding of the end of the ray still stops it ([`scan_occluded`] does not divide).

use crate::node::{Child, Node, ONE_PLUS, Target};
use crate::ray::{Best, SingleRay};
use crate::shape::Shape;
use crate::simd::{Lanes, Simd};
use crate::single::{self, STACK, Shapes, Solid};
use crate::tree::{FEW_CORNERS, Pair, Tree};
use crate::{Filter, Hit, MISS, Ray, Sphere};
use rebond_lanes::{F32x16, Index, Index16, Mask, Mask16, Real};
use std::mem::MaybeUninit;

/// Sixteen rays, prepared as [`SingleRay`] is.
pub(crate) struct Packet<'a> {
    ray: &'a Ray<F32x16>,
    /// The lanes whose largest direction component is x, and z.
    along_x: Mask16,
    along_z: Mask16,
    /// −shear[0], −shear[1], shear[2].
    shear: [F32x16; 3],
    largest: F32x16,
    reach: F32x16,
}

/// What boxes need of sixteen rays.
struct Slabs<'a> {
    packet: &'a Packet<'a>,
    inverse: [F32x16; 3],
    near: [F32x16; 3],
    far: [F32x16; 3],
    /// The lanes that go down each axis.
    down: [Mask16; 3],
}

/// What sixteen rays found.
#[derive(Clone, Copy)]
pub(crate) struct Bests {
    pub t: F32x16,
    pub u: F32x16,
    pub v: F32x16,
    pub primitive: Index16,
    /// Lanes that passed an edge so closely that they had better go by themselves.
    pub again: Mask16,
}

impl Bests {
    fn up_to(tmax: F32x16) -> Self {
        Self {
            t: tmax,
            u: F32x16::zero(),
            v: F32x16::zero(),
            primitive: Index16::splat(MISS),
            again: Mask16::splat(false),
        }
    }
    /// What one lane found, to go on from.
    fn lane(&self, lane: usize, instance: u32) -> Best {
        let primitive = self.primitive.lane(lane);
        let instance = if primitive == MISS { MISS } else { instance };
        Best { t: self.t.lane(lane), u: self.u.lane(lane), v: self.v.lane(lane), primitive, instance }
    }
    fn set(&mut self, lane: usize, best: &Best) {
        self.t = self.t.with_lane(lane, best.t);
        self.u = self.u.with_lane(lane, best.u);
        self.v = self.v.with_lane(lane, best.v);
        self.primitive = self.primitive.with_lane(lane, best.primitive);
    }
    pub fn hit(self, instance: u32) -> Hit<F32x16> {
        let missed = self.primitive.eq(Index16::splat(MISS));
        Hit {
            t: self.t,
            u: self.u,
            v: self.v,
            primitive: self.primitive,
            instance: Index16::select(missed, Index16::splat(MISS), Index16::splat(instance)),
        }
    }
}

/// What the edges of a triangle say to the rays.
struct Edges {
    u: F32x16,
    v: F32x16,
    w: F32x16,
    /// The lanes that pass all edges on one side, and those of them where an edge function is zero.
    inside: Mask16,
    doubtful: Mask16,
}

/// Candidate hits of one triangle.
struct Candidates {
    hit: Mask16,
    /// Lanes in which an edge function is zero or the triangle is thin, so that only more digits can tell.
    doubtful: Mask16,
    t: F32x16,
    u: F32x16,
    v: F32x16,
}

impl<'a> Packet<'a> {
    /// The packet, and the lanes of `mask` that can be traced in it; the others want [`SingleRay::unusual`]. Lanes that
    /// can hit nothing at all are in neither.
    #[inline(always)]
    pub fn new(ray: &'a Ray<F32x16>, mask: Mask16, extent: f32) -> (Self, Mask16, Mask16) {
        let (fit, largest, reach) = SingleRay::sizes_of(ray.o, ray.d, extent);
        let open = mask & ray.tmax.ge(F32x16::zero());
        let [x, y, z] = ray.d;
        let along_x = x.abs().eq(largest);
        let along_y = y.abs().eq(largest).and_not(along_x);
        let along_z = !(along_x | along_y);
        let choose = |x, y, z| F32x16::select(along_x, x, F32x16::select(along_z, z, y));
        let inverse = F32x16::one() / choose(x, y, z);
        let p = F32x16::select(along_x, y, x);
        let q = F32x16::select(along_z, y, z);
        let packet = Self { ray, along_x, along_z, shear: [-(p * inverse), -(q * inverse), inverse], largest, reach };
        (packet, open & fit, open.and_not(fit))
    }

    /// One corner in the rays' frames.
    #[inline(always)]
    fn corner(&self, p: [f32; 3]) -> [F32x16; 3] {
        let [x, y, z]: [F32x16; 3] = std::array::from_fn(|k| F32x16::splat(p[k]) - self.ray.o[k]);
        let p = F32x16::select(self.along_x, y, x);
        let q = F32x16::select(self.along_z, y, z);
        let r = F32x16::select(self.along_x, x, F32x16::select(self.along_z, z, y));
        [self.shear[0].mul_add(r, p), self.shear[1].mul_add(r, q), r]
    }

    /// The corners of a triangle in the rays' frames.
    #[inline(always)]
    fn corners(&self, [a, b, c]: [[f32; 3]; 3]) -> [[F32x16; 3]; 3] {
        [self.corner(a), self.corner(b), self.corner(c)]
    }

    /// The edge functions of a triangle, given its corners in the rays' frames; none if no lane passes inside.
    #[inline(always)]
    fn edges([a, b, c]: [[F32x16; 3]; 3], active: Mask16) -> Option<Edges> {
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let (inside, doubtful) = sides(u, v, w, active);
        if inside.none() { None } else { Some(Edges { u, v, w, inside, doubtful }) }
    }

    /// The lanes that hit a triangle, given its corners in the rays' frames, at 0 < t.
    #[inline(always)]
    fn triangle(&self, [a, b, c]: [[F32x16; 3]; 3], is_thin: bool, active: Mask16) -> Option<Candidates> {
        let Edges { u, v, w, inside, doubtful } = Self::edges([a, b, c], active)?;
        let doubtful = if is_thin { inside } else { doubtful };
        let determinant = u + v + w;
        let z = u * a[2] + v * b[2] + w * c[2];
        let inverse = F32x16::one() / determinant;
        let t = z * self.shear[2] * inverse;
        let hit = inside.and_not(doubtful) & F32x16::zero().lt(t);
        Some(Candidates { hit, doubtful, t, u: v * inverse, v: w * inverse })
    }

    /// Keeps what `filter` keeps.
    #[inline(always)]
    fn filtered<K: Filter>(found: &Candidates, hit: Mask16, primitive: u32, instance: u32, filter: &K) -> Mask16 {
        if K::KEEPS_ALL {
            return hit;
        }
        let kept = lanes(hit).filter(|&i| filter.keep(primitive, instance, found.u.lane(i), found.v.lane(i)));
        Mask16::from_bits(kept.fold(0, |bits, i| bits | 1 << i))
    }

    #[inline(always)]
    fn closest_triangle<K: Filter>(
        &self,
        corners: [[F32x16; 3]; 3],
        (primitive, is_thin): (u32, bool),
        active: Mask16,
        instance: u32,
        filter: &K,
        best: &mut Bests,
    ) {
        if let Some(found) = self.triangle(corners, is_thin, active) {
            best.again = best.again | found.doubtful;
            let number = Index16::splat(primitive);
            let nearer = found.t.lt(best.t) | (found.t.eq(best.t) & number.lt(best.primitive));
            let hit = Self::filtered(&found, found.hit & nearer, primitive, instance, filter);
            best.t = F32x16::select(hit, found.t, best.t);
            best.u = F32x16::select(hit, found.u, best.u);
            best.v = F32x16::select(hit, found.v, best.v);
            best.primitive = Index16::select(hit, number, best.primitive);
        }
    }

    /// The lanes that may meet a sphere or disk; false only if they do not.
    #[inline(always)]
    fn near_shape(&self, shape: &Shape, active: Mask16) -> Mask16 {
        let Some((center, radius)) = shape.ball() else { return active };
        let [x, y, z] = std::array::from_fn(|k| F32x16::splat(center[k]) - self.ray.o[k]);
        let [dx, dy, dz] = self.ray.d;
        let along = (x * dx + y * dy + z * dz) / (dx * dx + dy * dy + dz * dz);
        let (px, py, pz) = (x - along * dx, y - along * dy, z - along * dz);
        let across = px * px + py * py + pz * pz;
        let slack = (x * x + y * y + z * z) * 1e-5 + radius * radius * 1.001;
        active.and_not(across.gt(slack))
    }

    /// Where the rays enter and leave a sphere.
    #[inline(always)]
    fn sphere(&self, sphere: &Sphere) -> [F32x16; 2] {
        let store = |x: F32x16| {
            let mut out = [0.0; 16];
            x.store(&mut out);
            out
        };
        sphere.roots_of_each(&self.ray.o.map(store), &self.ray.d.map(store)).map(|t| F32x16::load(&t))
    }

    fn shape<K: Filter>(&self, shape: &Shape, active: Mask16, solid: &Solid<K>, best: &mut Bests) {
        let near = self.near_shape(shape, active);
        if let Shape::Sphere(sphere, primitive) = shape
            && K::KEEPS_ALL
        {
            if near.none() {
                return;
            }
            let number = Index16::splat(*primitive);
            for t in self.sphere(sphere) {
                let nearer = t.lt(best.t) | (t.eq(best.t) & number.lt(best.primitive));
                let hit = near & F32x16::zero().lt(t) & nearer;
                best.t = F32x16::select(hit, t, best.t);
                best.u = F32x16::select(hit, F32x16::zero(), best.u);
                best.v = F32x16::select(hit, F32x16::zero(), best.v);
                best.primitive = Index16::select(hit, number, best.primitive);
            }
            return;
        }
        for i in lanes(near) {
            let mut one = best.lane(i, solid.instance);
            solid.closest(shape, &self.single(i), &mut one);
            best.set(i, &one);
        }
    }

    fn shape_occludes<K: Filter>(&self, shape: &Shape, active: Mask16, solid: &Solid<K>) -> Mask16 {
        let near = self.near_shape(shape, active);
        if let Shape::Sphere(sphere, _) = shape
            && K::KEEPS_ALL
        {
            if near.none() {
                return near;
            }
            let [first, second] = self.sphere(sphere);
            let stops = |t: F32x16| F32x16::zero().lt(t) & t.le(self.ray.tmax);
            return near & (stops(first) | stops(second));
        }
        let hit = lanes(near).filter(|&i| solid.occluded(shape, &self.single(i), self.ray.tmax.lane(i)));
        Mask16::from_bits(hit.fold(0, |bits, i| bits | 1 << i))
    }

    #[inline(always)]
    fn single(&self, lane: usize) -> SingleRay {
        let sizes = (self.largest.lane(lane), self.reach.lane(lane));
        SingleRay::usual(self.ray.o.map(|x| x.lane(lane)), self.ray.d.map(|x| x.lane(lane)), sizes)
    }
}

/// The largest of some lanes.
#[inline(always)]
fn largest<S: Simd>(x: F32x16, lanes: Mask16) -> f32 {
    let mut all = [0.0; 16];
    F32x16::select(lanes, x, F32x16::splat(f32::NEG_INFINITY)).store(&mut all);
    let half = |i: usize| S::F8::load(all[i..i + 8].try_into().expect("eight"));
    let eight = half(0).max(half(8));
    let [a, b, c, d] = S::low(eight).max(S::high(eight)).array();
    a.max(b).max(c.max(d))
}

/// The least of some lanes.
#[inline(always)]
fn least<S: Simd>(x: F32x16, lanes: Mask16) -> f32 {
    -largest::<S>(-x, lanes)
}

/// On which side of the edge from `p` to `q` the rays pass: positive, negative, or exactly through it.
#[inline(always)]
fn edge(p: [F32x16; 3], q: [F32x16; 3]) -> F32x16 {
    p[0] * q[1] - p[1] * q[0]
}

/// The lanes that pass three edges all on one side, and those of them where an edge function is zero.
#[inline(always)]
fn sides(u: F32x16, v: F32x16, w: F32x16, active: Mask16) -> (Mask16, Mask16) {
    // Negative if and only if the two are of different sign: the product may vanish, not change sign.
    let product = u.min(v).min(w) * u.max(v).max(w);
    let inside = active & product.ge(F32x16::zero());
    (inside, inside & product.le(F32x16::zero()))
}

/// The set lane, if it is alone: in a subtree that one ray enters, it goes on by itself.
#[inline(always)]
fn only(mask: Mask16) -> Option<usize> {
    let bits = mask.bits();
    bits.is_power_of_two().then(|| bits.trailing_zeros() as usize & 15)
}

/// The set lanes.
#[inline(always)]
fn lanes(mask: Mask16) -> impl Iterator<Item = usize> {
    let mut bits = mask.bits();
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        (bits != 0).then(|| {
            bits &= bits - 1;
            lane & 15
        })
    })
}

impl<'a> Slabs<'a> {
    #[inline(always)]
    fn new(packet: &'a Packet) -> Self {
        let least = packet.largest * SingleRay::FLAT;
        let error = packet.reach * SingleRay::POSITION_ERROR;
        let sign = Index16::splat(0x8000_0000);
        let zero = [F32x16::zero(); 3];
        let mut slabs = Self { packet, inverse: zero, near: zero, far: zero, down: [Mask16::splat(false); 3] };
        for k in 0..3 {
            let d = packet.ray.d[k];
            let inverse = F32x16::one() / d.abs().max(least);
            let signed = inverse.copy_sign(d);
            let center = -(packet.ray.o[k] * signed);
            slabs.inverse[k] = signed;
            slabs.near[k] = center - error * inverse;
            slabs.far[k] = center + error * inverse;
            slabs.down[k] = (d.to_bits() & sign).eq(sign);
        }
        slabs
    }

    /// A ray that enters no box later and leaves none earlier than any of the lanes does, for boxes within `bounds`.
    ///
    /// Along an axis that all go the same way, the least of their distances to a plane is a concave function of its
    /// place, and no less than its chord; the largest is convex, and no more than its chord. The chords go from behind
    /// all origins to the farther bound. Rays that go both ways leave the axis out.
    fn beam<S: Simd>(&self, lanes: Mask16, bounds: &([f32; 3], [f32; 3])) -> SingleRay {
        let (mut inverse, mut near) = ([0.0; 3], [f32::NEG_INFINITY; 3]);
        let (mut inverse_far, mut far) = ([0.0; 3], [f32::INFINITY; 3]);
        let mut down = [false; 3];
        let reach = largest::<S>(self.packet.reach, lanes);
        let margin = reach * 1e-3;
        for k in 0..3 {
            let all_down = (self.down[k] & lanes).bits();
            if all_down != 0 && all_down != lanes.bits() {
                continue;
            }
            down[k] = all_down != 0;
            let (first, last) = (least::<S>(self.packet.ray.o[k], lanes), largest::<S>(self.packet.ray.o[k], lanes));
            // From before all origins, beyond all rounding.
            let (from, to) = if down[k] {
                (last + margin, bounds.0[k].min(first) - margin)
            } else {
                (first - margin, bounds.1[k].max(last) + margin)
            };
            let at = |p: f32| {
                let t = self.inverse[k] * p;
                (least::<S>(t + self.near[k], lanes), largest::<S>(t + self.far[k], lanes))
            };
            let ((near_from, far_from), (near_to, far_to)) = (at(from), at(to));
            let slope = |a: f32, b: f32| (b - a) / (to - from);
            inverse[k] = slope(near_from, near_to);
            inverse_far[k] = slope(far_from, far_to);
            // What rounding takes from the ends of the chords, and from the constants.
            let ends = near_from.abs().max(near_to.abs()).max(far_from.abs()).max(far_to.abs());
            let slack = 1e-5 * ends + 1e-6 * reach * largest::<S>(self.inverse[k].abs(), lanes);
            near[k] = near_from - inverse[k] * from - slack;
            far[k] = far_from - inverse_far[k] * from + slack;
        }
        SingleRay::beam([inverse, near, inverse_far, far], down)
    }

    /// Where the lanes enter and leave a child's box.
    #[inline(always)]
    fn enter(&self, node: &Node, slot: usize, limit: F32x16) -> (Mask16, F32x16) {
        let mut enter = F32x16::zero();
        let mut leave = limit;
        for k in 0..3 {
            let (lo, hi) = (F32x16::splat(node.planes[2 * k][slot]), F32x16::splat(node.planes[2 * k + 1][slot]));
            let near = F32x16::select(self.down[k], hi, lo).mul_add(self.inverse[k], self.near[k]);
            let far = F32x16::select(self.down[k], lo, hi).mul_add(self.inverse[k], self.far[k]);
            enter = near.max(enter);
            leave = (far * ONE_PLUS).min(leave);
        }
        (enter.le(leave), enter)
    }
}

/// The corners of a small tree in the rays' frames. Triangles share most of them.
struct Sheared {
    corners: [MaybeUninit<F32x16>; 3 * FEW_CORNERS],
}

impl Sheared {
    /// A place for them, in the caller's own frame: it is too large to hand around.
    #[inline(always)]
    fn nothing() -> Self {
        Self { corners: [const { MaybeUninit::uninit() }; 3 * FEW_CORNERS] }
    }

    #[inline(always)]
    fn fill(&mut self, tree: &Tree, packet: &Packet) {
        for (place, &p) in self.corners.chunks_exact_mut(3).zip(tree.corners()) {
            let [x, y, z] = packet.corner(p);
            place[0].write(x);
            place[1].write(y);
            place[2].write(z);
        }
    }

    /// The lanes whose lines go through a pair of triangles of the tree that this was filled with; none if none do.
    ///
    /// # Safety
    /// The pair is one of that tree's own.
    #[inline(always)]
    unsafe fn crossing(&self, pair: &Pair, active: Mask16) -> Option<Crossing> {
        let at = |corner: usize, k: usize| {
            // SAFETY: the numbers are those of corners of the tree, times three, and `fill` wrote all of these.
            unsafe { self.corners.get_unchecked(pair.corners[corner] as usize + k).assume_init() }
        };
        let corner = |i: usize| [at(i, 0), at(i, 1), at(i, 2)];
        let (a, b, c, d) = (corner(0), corner(1), corner(2), corner(3));
        // The triangles a b c and a c d; the same edge functions as if each stood alone.
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let (u2, v2, w2) = (edge(d, c), edge(a, d), -v);
        let (first, doubtful) = sides(u, v, w, active);
        let (second, also_doubtful) = sides(u2, v2, w2, active);
        let either = first | second;
        if either.none() {
            return None;
        }
        // A line through both is in doubt too.
        let doubtful = doubtful | also_doubtful | (first & second);
        let choose = |x, y| F32x16::select(second, y, x);
        let (u, v, w) = (choose(u, u2), choose(v, v2), choose(w, w2));
        let z = u * a[2] + v * choose(b[2], c[2]) + w * choose(c[2], d[2]);
        Some(Crossing { inside: either.and_not(doubtful), doubtful, second, v, w, z, determinant: u + v + w })
    }
}

/// What the lines of the rays say to a pair of triangles.
struct Crossing {
    /// The lanes that go through one of the two, and those that had better go by themselves.
    inside: Mask16,
    doubtful: Mask16,
    /// The lanes that go through the second one.
    second: Mask16,
    v: F32x16,
    w: F32x16,
    /// Over the determinant, the distance along the rays' largest axes.
    z: F32x16,
    determinant: F32x16,
}

impl Crossing {
    /// What `filter` keeps of `hit`.
    #[inline(always)]
    fn filtered<K: Filter>(&self, hit: Mask16, pair: &Pair, instance: u32, filter: &K) -> Mask16 {
        if K::KEEPS_ALL {
            return hit;
        }
        let inverse = F32x16::one() / self.determinant;
        let (u, v, second) = (self.v * inverse, self.w * inverse, self.second.bits());
        let kept = lanes(hit)
            .filter(|&i| filter.keep(pair.primitives[(second >> i & 1) as usize], instance, u.lane(i), v.lane(i)));
        Mask16::from_bits(kept.fold(0, |bits, i| bits | 1 << i))
    }
}

/// Sixteen rays against every primitive of a small tree.
#[inline(always)]
pub(crate) fn scan_closest<K: Filter>(
    tree: &Tree,
    packet: &Packet,
    active: Mask16,
    instance: u32,
    filter: &K,
) -> Bests {
    let mut sheared = Sheared::nothing();
    sheared.fill(tree, packet);
    let mut best = Bests::up_to(packet.ray.tmax);
    for pair in tree.pairs() {
        // SAFETY: the pair is the tree's own.
        let Some(found) = (unsafe { sheared.crossing(pair, active) }) else { continue };
        let inverse = F32x16::one() / found.determinant;
        let t = found.z * packet.shear[2] * inverse;
        let [first, second] = pair.primitives.map(Index16::splat);
        let number = Index16::select(found.second, second, first);
        let nearer = t.lt(best.t) | (t.eq(best.t) & number.lt(best.primitive));
        let hit = found.inside & F32x16::zero().lt(t) & nearer;
        let hit = found.filtered(hit, pair, instance, filter);
        best.t = F32x16::select(hit, t, best.t);
        best.u = F32x16::select(hit, found.v * inverse, best.u);
        best.v = F32x16::select(hit, found.w * inverse, best.v);
        best.primitive = Index16::select(hit, number, best.primitive);
        best.again = best.again | found.doubtful;
    }
    // Another variable, because the loop above must keep its own in registers.
    let mut all = best;
    for shape in tree.shapes() {
        packet.shape(shape, active, &Solid { instance, filter }, &mut all);
    }
    all
}

/// The lanes that something stops, and those that passed an edge so closely that they had better go by themselves.
pub(crate) struct Stopped {
    pub hit: Mask16,
    pub again: Mask16,
}

/// Sixteen rays against every primitive of a small tree, until all are stopped.
#[inline(always)]
pub(crate) fn scan_occluded<K: Filter>(
    tree: &Tree,
    packet: &Packet,
    active: Mask16,
    instance: u32,
    filter: &K,
) -> Stopped {
    let tmax = packet.ray.tmax;
    let mut left = active;
    let mut again = Mask16::splat(false);
    let mut sheared = Sheared::nothing();
    sheared.fill(tree, packet);
    for pair in tree.pairs() {
        // SAFETY: the pair is the tree's own.
        let Some(found) = (unsafe { sheared.crossing(pair, left) }) else { continue };
        // 0 < z / determinant ≤ tmax, without the division.
        let sign = found.determinant.to_bits() & Index16::splat(0x8000_0000);
        let z = F32x16::from_bits((found.z * packet.shear[2]).to_bits() ^ sign);
        let hit = found.inside & F32x16::zero().lt(z) & z.le(found.determinant.abs() * tmax);
        left = left.and_not(found.filtered(hit, pair, instance, filter));
        again = again | found.doubtful;
        if left.none() {
            return Stopped { hit: active, again: left };
        }
    }
    for shape in tree.shapes() {
        left = left.and_not(packet.shape_occludes(shape, left, &Solid { instance, filter }));
    }
    Stopped { hit: active.and_not(left), again: again & left }
}

/// A subtree to visit.
#[derive(Clone, Copy)]
struct Entry {
    /// Where each lane enters it; ∞ for those that do not.
    enter: F32x16,
    child: Child,
    /// Where one of them does: what the children of a node are ordered by.
    order: f32,
}

/// Sixteen rays through the tree together.
#[inline(never)]
pub(crate) fn closest<S: Simd, const PREFETCH: bool, K: Filter>(
    tree: &Tree,
    packet: &Packet,
    active: Mask16,
    instance: u32,
    filter: &K,
) -> Bests {
    let mut best = Bests::up_to(packet.ray.tmax);
    let Some(root) = tree.root() else { return best };
    let slabs = Slabs::new(packet);
    let beam = slabs.beam::<S>(active, &tree.bounds);
    // No nearest hit so far is farther.
    let mut farthest = largest::<S>(best.t, active);
    let all = active;
    let solid = Solid { instance, filter };
    let mut singles = Singles::new();
    let mut places: [MaybeUninit<Entry>; STACK] = [const { MaybeUninit::uninit() }; STACK];
    let mut len = 0;
    let (mut current, mut active) = (root, active);
    loop {
        if let Some(i) = only(active) {
            let ray = singles.get(packet, i);
            let mut one = best.lane(i, instance);
            single::closest::<S, PREFETCH, K>(tree, current, ray, instance, filter, &solid, &mut one);
            best.set(i, &one);
        } else {
            match current.target() {
                Target::Node(index) => {
                    // SAFETY: `Tree::new` has checked every child.
                    let node = unsafe { tree.nodes().get_unchecked(index as usize) };
                    let limit = best.t * ONE_PLUS;
                    let bottom = len;
                    let (mut mask, _) = node.enter::<S>(&beam, S::F8::splat(farthest * ONE_PLUS));
                    while mask != 0 {
                        let slot = mask.trailing_zeros() as usize & 7;
                        mask &= mask - 1;
                        let (entered, enter) = slabs.enter(node, slot, limit);
                        let entered = entered & active;
                        if entered.none() {
                            continue;
                        }
                        let order = enter.lane(entered.bits().trailing_zeros() as usize & 15);
                        let enter = F32x16::select(entered, enter, F32x16::splat(f32::INFINITY));
                        let child = node.children[slot];
                        if PREFETCH {
                            single::prefetch(tree, child);
                        }
                        let entry = Entry { enter, child, order };
                        let mut i = len;
                        // SAFETY: places from `bottom` to `len` were written, and `Tree::new` has checked that the
                        // stack is large enough for all pushes on the way.
                        unsafe {
                            while i > bottom && places.get_unchecked(i - 1).assume_init_ref().order < order {
                                *places.get_unchecked_mut(i) = *places.get_unchecked(i - 1);
                                i -= 1;
                            }
                            places.get_unchecked_mut(i).write(entry);
                        }
                        len += 1;
                    }
                }
                Target::Blocks { first, count } => {
                    for i in first..first + count {
                        // SAFETY: `Tree::new` has checked every child.
                        let block = unsafe { tree.blocks().get_unchecked(i as usize) };
                        for i in 0..4 {
                            let primitive = block.primitive(i);
                            if i == 0 || primitive != block.primitive(i - 1) {
                                packet.closest_triangle(
                                    packet.corners(block.corners(i)),
                                    (primitive, block.is_thin(i)),
                                    active,
                                    instance,
                                    filter,
                                    &mut best,
                                );
                            }
                        }
                    }
                    farthest = largest::<S>(best.t, all);
                }
                Target::Shape(index) => {
                    packet.shape(&tree.shapes()[index as usize], active, &solid, &mut best);
                }
            }
        }
        let limit = best.t * ONE_PLUS;
        loop {
            if len == 0 {
                return best;
            }
            len -= 1;
            // SAFETY: everything below `len` was written.
            let entry = unsafe { places.get_unchecked(len).assume_init() };
            active = entry.enter.lt(limit);
            if active.any() {
                current = entry.child;
                break;
            }
        }
    }
}

/// Whether sixteen rays meet anything.
#[inline(never)]
pub(crate) fn occluded<S: Simd, K: Filter>(
    tree: &Tree,
    packet: &Packet,
    active: Mask16,
    instance: u32,
    filter: &K,
) -> Stopped {
    let nothing = Mask16::splat(false);
    let Some(root) = tree.root() else { return Stopped { hit: nothing, again: nothing } };
    let slabs = Slabs::new(packet);
    let solid = Solid { instance, filter };
    let mut singles = Singles::new();
    let mut places: [MaybeUninit<(Child, u32)>; STACK] = [const { MaybeUninit::uninit() }; STACK];
    let mut len = 0;
    let limit = packet.ray.tmax * ONE_PLUS;
    let all = active;
    let mut left = active;
    let mut again = Mask16::splat(false);
    let (mut current, mut active) = (root, active);
    loop {
        if let Some(i) = only(active) {
            let (ray, tmax) = (singles.get(packet, i), packet.ray.tmax.lane(i));
            if single::occluded::<S, false, K>(tree, current, ray, instance, filter, &solid, tmax) {
                left = left.and_not(Mask16::from_bits(1 << i));
            }
        } else {
            match current.target() {
                Target::Node(index) => {
                    // SAFETY: `Tree::new` has checked every child.
                    let node = unsafe { tree.nodes().get_unchecked(index as usize) };
                    for slot in 0..8 {
                        let (entered, _) = slabs.enter(node, slot, limit);
                        let bits = (entered & active).bits();
                        if bits != 0 {
                            let child = node.children[slot];
                            // SAFETY: `Tree::new` has checked that the stack is large enough for all pushes on the way.
                            unsafe { places.get_unchecked_mut(len) }.write((child, bits));
                            len += 1;
                        }
                    }
                }
                Target::Blocks { first, count } => {
                    for i in first..first + count {
                        // SAFETY: `Tree::new` has checked every child.
                        let block = unsafe { tree.blocks().get_unchecked(i as usize) };
                        for i in 0..4 {
                            let primitive = block.primitive(i);
                            if i > 0 && primitive == block.primitive(i - 1) {
                                continue;
                            }
                            if let Some(found) =
                                packet.triangle(packet.corners(block.corners(i)), block.is_thin(i), active)
                            {
                                let hit = found.hit & found.t.le(packet.ray.tmax);
                                let hit = Packet::filtered(&found, hit, primitive, instance, filter);
                                active = active.and_not(hit);
                                left = left.and_not(hit);
                                again = again | found.doubtful;
                            }
                        }
                    }
                }
                Target::Shape(index) => {
                    let shape = &tree.shapes()[index as usize];
                    left = left.and_not(packet.shape_occludes(shape, active, &solid));
                }
            }
        }
        loop {
            if len == 0 || left.none() {
                return Stopped { hit: all.and_not(left), again: again & left };
            }
            len -= 1;
            // SAFETY: everything below `len` was written.
            let (child, bits) = unsafe { places.get_unchecked(len).assume_init() };
            active = Mask16::from_bits(bits) & left;
            if active.any() {
                current = child;
                break;
            }
        }
    }
}

/// The lanes' own rays, made when they are first wanted.
struct Singles {
    rays: [MaybeUninit<SingleRay>; 16],
    made: u32,
}

impl Singles {
    #[inline(always)]
    fn new() -> Self {
        Self { rays: [const { MaybeUninit::uninit() }; 16], made: 0 }
    }
    #[inline(always)]
    fn get(&mut self, packet: &Packet, lane: usize) -> &SingleRay {
        let place = &mut self.rays[lane];
        if self.made >> lane & 1 == 0 {
            self.made |= 1 << lane;
            place.write(packet.single(lane));
        }
        // SAFETY: it was written when its bit in `made` was set.
        unsafe { place.assume_init_ref() }
    }
}
