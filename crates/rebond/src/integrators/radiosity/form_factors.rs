//! Form factors between patches,
//!
//! ```text
//! A_i F_ij = ∫∫ V cosθ_i cosθ_j / (π d²) dA_i dA_j  ≈  A_i F°_ij · Σ_k V_k K_k / Σ_k K_k
//! ```
//!
//! F° is what nothing in the way would leave: for patches near each other, or that reach behind each other's plane, the
//! contour integral of [`form_factor::between_polygons`], for others 49 points of the kernel K = cosθ_i cosθ_j / (π d²),
//! the products of a rule of seven points on each (Radon 1948). What is in the way is the share of rays between points of the two that
//! are stopped, each weighed by K: one from each of sixteen equal parts of a patch, of which a pair uses 1, 4, 16 or 64
//! together, by its hash.
//!
//! One number serves both directions, so that A_i F_ij = A_j F_ji by construction. It hangs on the seed and on the two
//! patches alone.

use super::patches::Patches;
use crate::emitter::POINT_ERROR;
use crate::math::Vec3;
use crate::render::Observer;
use crate::sampling::{mix, warp::uniform_triangle};
use crate::scene::Scene;
use crate::transport::form_factor;
use glam::DVec3;
use rayon::prelude::*;
use rebond_bvh::Ray;
use rebond_lanes::{F32x16, Mask, Mask16, Real, scalar::Index1};
use std::f32::consts::FRAC_1_PI;

/// Parts of a patch, each with a point that rays start and end at.
pub const POINTS: usize = 16;
const LANES: usize = F32x16::LANES;
/// Patches this many times the sum of their radii apart are far from each other: points of the kernel are right to 4·10⁻⁵ of it
/// (root mean square over random pairs that near; 2·10⁻⁴ at most).
const FAR: f32 = 2.0;
/// Points of a rule that is exact up to the fifth degree: weights of the corners, and of the point (Radon 1948).
const RULE: [([f64; 3], f32); 7] = {
    let (a, b, w) = (0.797_426_985_353_087, 0.101_286_507_323_456, 0.125_939_18);
    let (c, d, v) = (0.059_715_871_789_770, 0.470_142_064_105_115, 0.132_394_15);
    let third = 1.0 / 3.0;
    [
        ([third; 3], 0.225),
        ([a, b, b], w),
        ([b, a, b], w),
        ([b, b, a], w),
        ([c, d, d], v),
        ([d, c, d], v),
        ([d, d, c], v),
    ]
};

/// Triangles in columns, ready to be looked at sixteen at a time.
struct Columns {
    corners: [[Vec<f32>; 3]; 3],
    /// Points of [`RULE`].
    rule: [[Vec<f32>; 3]; RULE.len()],
    centre: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    radius: Vec<f32>,
    area: Vec<f32>,
}

/// Form factors between triangles of a mesh.
pub struct FormFactors<'a> {
    scene: &'a Scene,
    corners: Vec<[DVec3; 3]>,
    columns: Columns,
    /// Moved off the surface by as much as they may be wrong.
    points: Vec<[[f32; 3]; POINTS]>,
    ids: Vec<u32>,
    /// Areas.
    pub areas: Vec<f64>,
    /// Rays between two triangles; four times as many if one of them shines.
    rays: u32,
    kinds: Vec<Kind>,
    seed: u32,
    /// Heights over a plane that count as none.
    flat: f32,
}

/// What a triangle is to the number of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A patch.
    Patch,
    /// A patch that shines: four times as many rays.
    Light,
    /// A larger element: sixteen.
    Coarse,
}

/// What rays between two triangles found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples {
    all: f32,
    seen: f32,
    /// The least and the most of V K.
    pub range: [f32; 2],
}

impl Samples {
    /// How far V K may be from its mean: its range, or where nothing got through what one ray in sixteen may have missed. Where no
    /// ray saw both fronts there is no telling.
    pub fn spread(&self) -> f32 {
        let [least, most] = self.range;
        match (self.all > 0.0, most > 0.0) {
            (true, true) => most - least,
            (true, false) => self.all / (POINTS * POINTS) as f32,
            (false, _) => f32::INFINITY,
        }
    }

    /// The share of light that gets through: 1 where no ray saw both fronts, since next to no light is on its way there.
    pub fn visibility(&self) -> f32 {
        if self.all > 0.0 { self.seen / self.all } else { 1.0 }
    }
}

/// A pair on its way through [`FormFactors::row`].
struct Candidate {
    j: usize,
    /// By the kernel; none if that is not good enough.
    unoccluded: Option<f64>,
    samples: Samples,
}

/// Rays waiting to be traced together.
#[derive(Default)]
struct Packet {
    o: [[f32; LANES]; 3],
    d: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
    candidate: [usize; LANES],
    count: usize,
}

impl<'a> FormFactors<'a> {
    /// Form factors between these elements of a mesh.
    pub fn new(scene: &'a Scene, mesh: &Patches, elements: &[u32], kinds: Vec<Kind>, rays: u32, seed: u32) -> Self {
        let corners: Vec<[DVec3; 3]> = elements.iter().map(|e| mesh.corners(*e)).collect();
        let (lo, hi) = scene.bounds();
        let extent = lo.iter().chain(&hi).fold(0.0_f32, |m, x| m.max(x.abs()));
        let column = |f: &dyn Fn(&[DVec3; 3]) -> f64| -> Vec<f32> {
            corners.iter().map(|c| f(c) as f32).chain([0.0; LANES]).collect()
        };
        let normal = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a);
        let weights = |k: usize, c: &[DVec3; 3]| {
            let [a, b, d] = RULE[k].0;
            c[0] * a + c[1] * b + c[2] * d
        };
        let centre = |c: &[DVec3; 3]| (c[0] + c[1] + c[2]) / 3.0;
        let columns = Columns {
            corners: std::array::from_fn(|k| std::array::from_fn(|x| column(&|c| c[k][x]))),
            rule: std::array::from_fn(|k| std::array::from_fn(|x| column(&|c| weights(k, c)[x]))),
            centre: std::array::from_fn(|x| column(&|c| centre(c)[x])),
            normal: std::array::from_fn(|x| column(&|c| normal(c).normalize()[x])),
            radius: column(&|c| c.iter().map(|p| p.distance(centre(c))).fold(0.0, f64::max)),
            area: column(&|c| normal(c).length() / 2.0),
        };
        let points = corners.iter().zip(elements).map(|(c, e)| points(c, *e, seed, extent)).collect();
        let areas = corners.iter().map(|c| normal(c).length() / 2.0).collect();
        let flat = POINT_ERROR * extent;
        Self { scene, corners, columns, points, ids: elements.to_vec(), areas, rays, kinds, seed, flat }
    }

    /// How many triangles there are.
    pub fn count(&self) -> usize {
        self.corners.len()
    }

    /// `A_i F_ij` for all j of a range, i itself apart, into `out`. Returns the rays traced.
    pub fn row(&self, i: usize, range: std::ops::Range<usize>, out: &mut [f32]) -> u64 {
        out.fill(0.0);
        let mut candidates = Vec::new();
        for first in range.clone().step_by(LANES) {
            self.look(i, first, LANES.min(range.end - first), &mut candidates);
        }
        let mut packet = Packet::default();
        let mut traced = 0;
        for n in 0..candidates.len() {
            traced += self.shoot(i, &mut candidates, n, &mut packet);
        }
        traced += self.trace(i, &mut candidates, &mut packet);
        for c in &candidates {
            out[c.j - range.start] = self.exchange(i, c.j, c.unoccluded, &c.samples);
        }
        traced
    }

    /// `A_i F_ij` from what [`FormFactors::samples`] gave.
    pub fn exchange(&self, i: usize, j: usize, unoccluded: Option<f64>, samples: &Samples) -> f32 {
        let visibility = f64::from(samples.visibility());
        if visibility == 0.0 {
            return 0.0;
        }
        let unoccluded = unoccluded.unwrap_or_else(|| {
            // The same number whichever of the two asks.
            let (a, b) = if self.ids[i] < self.ids[j] { (i, j) } else { (j, i) };
            form_factor::between_polygons(&self.corners[a], &self.corners[b])
        });
        (unoccluded * visibility) as f32
    }

    /// What rays between two triangles find; none if neither sees the other's front.
    pub fn samples(&self, i: usize, j: usize) -> Option<(Samples, Option<f64>)> {
        let mut candidates = Vec::new();
        self.look(i, j, 1, &mut candidates);
        if candidates.is_empty() {
            return None;
        }
        let mut packet = Packet::default();
        self.shoot(i, &mut candidates, 0, &mut packet);
        self.trace(i, &mut candidates, &mut packet);
        candidates.pop().map(|c| (c.samples, c.unoccluded))
    }

    /// Those of `count` triangles from `first` on that see the front of triangle i and are seen by it, with what nothing in the way
    /// would leave.
    fn look(&self, i: usize, first: usize, count: usize, candidates: &mut Vec<Candidate>) {
        type V = Vec3<F32x16>;
        let at = |column: &[Vec<f32>; 3]| -> V {
            let [x, y, z] = column.each_ref().map(|c| F32x16::load(&c[first..]));
            Vec3 { x, y, z }
        };
        let of = |column: &[Vec<f32>; 3]| -> V { Vec3::splat(column.each_ref().map(|c| c[i])) };
        let c = &self.columns;
        let (ni, nj) = (of(&c.normal), at(&c.normal));
        let heights = |n: V, corners: [V; 3], plane: V| corners.map(|p| (p - plane).dot(n));
        let above = heights(ni, c.corners.each_ref().map(at), of(&c.corners[0]));
        let below = heights(nj, c.corners.each_ref().map(of), at(&c.corners[0]));
        let most = |h: [F32x16; 3]| h[0].max(h[1]).max(h[2]);
        let least = |h: [F32x16; 3]| h[0].min(h[1]).min(h[2]);
        let flat = F32x16::splat(self.flat);
        let some = most(above).gt(flat) & most(below).gt(flat);
        let some = some & Mask16::from_bits(((1_u32 << count) - 1) & 0xffff);
        if some.none() {
            return;
        }
        let whole = least(above).ge(-flat) & least(below).ge(-flat);
        let between = at(&c.centre) - of(&c.centre);
        let reach = (F32x16::load(&c.radius[first..]) + c.radius[i]) * FAR;
        let far = (whole & between.length_squared().gt(reach * reach)).bits();
        let mut kernel = F32x16::zero();
        let theirs = c.rule.each_ref().map(at);
        for (x, (_, weight)) in c.rule.each_ref().map(of).into_iter().zip(RULE) {
            let mut sum = F32x16::zero();
            for (y, (_, weight)) in theirs.into_iter().zip(RULE) {
                sum = kernel_of(y - x, ni, nj).mul_add(F32x16::splat(weight), sum);
            }
            kernel = sum.mul_add(F32x16::splat(weight), kernel);
        }
        let value = kernel * F32x16::load(&c.area[first..]) * c.area[i];
        let mut bits = some.bits();
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let j = first + lane;
            if j == i {
                continue;
            }
            let unoccluded = (far >> lane & 1 != 0).then(|| f64::from(value.lane(lane)));
            let samples = Samples { range: [f32::MAX, 0.0], ..Samples::default() };
            candidates.push(Candidate { j, unoccluded, samples });
        }
    }

    /// Puts the rays of a pair into the packet, which is traced when it is full.
    fn shoot(&self, i: usize, candidates: &mut [Candidate], n: usize, packet: &mut Packet) -> u64 {
        let j = candidates[n].j;
        let (low, high) = (self.ids[i].min(self.ids[j]), self.ids[i].max(self.ids[j]));
        let hash = mix(Index1(mix(Index1(low ^ self.seed)).0.wrapping_add(high))).0;
        let kinds = [self.kinds[i], self.kinds[j]];
        let rays = match kinds {
            _ if kinds.contains(&Kind::Coarse) => 16,
            _ if kinds.contains(&Kind::Light) => (4 * self.rays).min(64),
            _ => self.rays,
        };
        let mut traced = 0;
        for k in 0..rays {
            let [p, q] = matched(hash, rays, k);
            let [p, q] = if self.ids[i] == low { [p, q] } else { [q, p] };
            let (from, to) = (self.points[i][p], self.points[j][q]);
            let lane = packet.count;
            for x in 0..3 {
                packet.o[x][lane] = from[x];
                packet.d[x][lane] = to[x] - from[x];
                packet.normal[x][lane] = self.columns.normal[x][j];
            }
            packet.candidate[lane] = n;
            packet.count += 1;
            if packet.count == LANES {
                traced += self.trace(i, candidates, packet);
            }
        }
        traced
    }

    /// Traces a packet and adds up what it found.
    fn trace(&self, i: usize, candidates: &mut [Candidate], packet: &mut Packet) -> u64 {
        if packet.count == 0 {
            return 0;
        }
        let load = |a: &[[f32; LANES]; 3]| -> Vec3<F32x16> {
            let [x, y, z] = a.each_ref().map(|c| F32x16::load(c));
            Vec3 { x, y, z }
        };
        let (o, d) = (load(&packet.o), load(&packet.d));
        let n = Vec3::splat(self.columns.normal.each_ref().map(|c| c[i]));
        let kernel = kernel_of(d, n, load(&packet.normal));
        let mask = Mask16::from_bits(((1_u64 << packet.count) - 1) as u32) & kernel.gt(F32x16::zero());
        let ray = Ray { o: o.array(), d: d.array(), tmax: F32x16::one(), time: F32x16::zero() };
        let stopped = if mask.any() { self.scene.occluded(&ray, mask) } else { mask };
        let seen = mask.and_not(stopped).bits();
        for lane in 0..packet.count {
            let samples = &mut candidates[packet.candidate[lane]].samples;
            let k = kernel.lane(lane);
            let passed = if seen >> lane & 1 != 0 { k } else { 0.0 };
            samples.all += k;
            samples.seen += passed;
            samples.range = [samples.range[0].min(passed), samples.range[1].max(passed)];
        }
        packet.count = 0;
        u64::from(mask.count())
    }
}

/// cosθ_i cosθ_j / (π d²), 0 where one is seen from behind; `d` leads from i to j.
#[inline(always)]
fn kernel_of(d: Vec3<F32x16>, ni: Vec3<F32x16>, nj: Vec3<F32x16>) -> F32x16 {
    let d2 = d.length_squared();
    ni.dot(d).relu() * (-nj.dot(d)).relu() * FRAC_1_PI / (d2 * d2)
}

/// Which points of two triangles the k-th of a pair's rays joins. Four of them take every quarter of both once, sixteen every
/// quarter of one with every quarter of the other.
fn matched(hash: u32, rays: u32, k: u32) -> [usize; 2] {
    let two = |shift: u32| hash >> shift & 3;
    let [p, q] = match rays {
        1 => [hash & 15, hash >> 4 & 15],
        4 => [4 * k + two(2 * k), 4 * (k ^ two(8)) + two(10 + 2 * k)],
        _ => {
            let hash = mix(Index1(hash.wrapping_add(k >> 4))).0;
            let k = k & 15;
            [k ^ (hash & 15), ((k & 3) << 2 | k >> 2) ^ (hash >> 4 & 15)]
        }
    };
    [p as usize, q as usize]
}

/// A point in each of sixteen equal parts of a triangle, the four of a quarter side by side.
fn points(corners: &[DVec3; 3], id: u32, seed: u32, extent: f32) -> [[f32; 3]; POINTS] {
    let quarter = |[a, b, c]: [DVec3; 3], k: usize| {
        let (ab, bc, ca) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]][k]
    };
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
    let off = normal * (f64::from(3.0 * POINT_ERROR * extent) * (normal.x.abs() + normal.y.abs() + normal.z.abs()));
    let first = mix(Index1(id)).0 ^ seed.rotate_left(16);
    std::array::from_fn(|k| {
        let [a, b, c] = quarter(quarter(*corners, k / 4), k % 4);
        let random = |n: u32| mix(Index1(mix(Index1(first.wrapping_add(2 * k as u32 + n))).0));
        let u = [0, 1].map(|n| (random(n).0 >> 8) as f32 / 16_777_216.0);
        let [v, w] = uniform_triangle(u).map(f64::from);
        (a + (b - a) * v + (c - a) * w + off).as_vec3().to_array()
    })
}

/// A symmetric matrix of which half is stored, with zeros on its diagonal.
#[derive(Clone, Debug, PartialEq)]
pub struct Symmetric {
    n: usize,
    lower: Vec<f32>,
}

/// What a row of F is multiplied by for its sum not to be above 1; just below it, for what rounding to f32 may add.
pub fn scale_of(sum: f64) -> f32 {
    if sum > 1.0 { ((1.0 - 1e-7) / sum) as f32 } else { 1.0 }
}

/// Sums of the rows of F: how much of what a patch sends out arrives anywhere. Errors of visibility bring some above 1; a
/// patch for which that is so reflects as much less ([`scale_of`]), so that no row of T is above ρ and `A_i F_ij` stays what it is in
/// both directions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Closure {
    /// The least.
    pub least: f64,
    /// The mean by area; 1 in a closed room.
    pub mean: f64,
    /// The largest.
    pub most: f64,
    /// What each row is multiplied by.
    pub scale: Vec<f32>,
    /// Rays traced.
    pub rays: u64,
}

impl Symmetric {
    /// Bytes of a matrix.
    pub fn bytes_of(n: usize) -> u64 {
        2 * n as u64 * (n as u64).saturating_sub(1)
    }

    /// All form factors `A_i F_ij`. None if told to stop.
    pub fn form_factors(factors: &FormFactors, observer: &dyn Observer) -> Option<(Self, Closure)> {
        let n = factors.count();
        let mut lower = vec![0.0; n * n.saturating_sub(1) / 2];
        let mut rows: Vec<(usize, &mut [f32])> = Vec::with_capacity(n);
        let mut rest = &mut lower[..];
        for i in 0..n {
            let (row, others) = rest.split_at_mut(i);
            rows.push((i, row));
            rest = others;
        }
        // The longest rows first, so that no thread is left with one at the end.
        rows.reverse();
        let traced = rows.into_par_iter().with_max_len(1).map(|(i, row)| {
            if observer.should_stop() {
                return 0;
            }
            let rays = factors.row(i, 0..i, row);
            observer.advance(0, rays);
            rays
        });
        let rays = traced.sum();
        if observer.should_stop() {
            return None;
        }
        let matrix = Self { n, lower };
        let sums: Vec<f64> = matrix.row_sums().iter().zip(&factors.areas).map(|(s, a)| s / a).collect();
        let total: f64 = factors.areas.iter().sum();
        let closure = Closure {
            least: sums.iter().copied().fold(f64::INFINITY, f64::min),
            mean: sums.iter().zip(&factors.areas).map(|(s, a)| s * a).sum::<f64>() / total,
            most: sums.iter().copied().fold(0.0, f64::max),
            scale: sums.iter().map(|s| scale_of(*s)).collect(),
            rays,
        };
        Some((matrix, closure))
    }

    /// How many rows and columns there are.
    pub fn side(&self) -> usize {
        self.n
    }

    /// What stands before the diagonal in a row.
    pub fn row(&self, i: usize) -> &[f32] {
        let start = i * i.saturating_sub(1) / 2;
        &self.lower[start..start + i]
    }

    /// Sums of whole rows.
    pub fn row_sums(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.n];
        for i in 0..self.n {
            let mut sum = 0.0;
            for (x, other) in self.row(i).iter().zip(&mut sums) {
                sum += f64::from(*x);
                *other += f64::from(*x);
            }
            sums[i] += sum;
        }
        sums
    }
}
