//! A hierarchy over the emitters that have a place: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with
//! Adaptive Tree Splitting"; Pharr, Jakob, Humphreys 2023, §12.6.3.
//!
//! Each node bounds its emitters' places by a box (centre c, half a diagonal r), their normals by a cone (axis a, half-angle
//! θo) and what leaves around each normal by an angle θe. From the point p with normal n it looks as bright as
//!
//! ```text
//! I = Φ · cosθ' · cosθi' / max(d D, r²/3)    θ'    = max(0, ∠(a, p − c) − θo − θb), nothing where θ' ≥ θe
//!                                            cosθi' = min(1, h / d)
//! ```
//!
//! where Φ is the greatest intensity of its emitters, added up, θb the half-angle that the box's sphere fills as seen from p,
//! d and D the distances to the box's nearest and farthest point, and h how far it reaches from the plane through p. The
//! mean of 1/x² over a segment that is seen end on is 1/(d D), and 3/r² within a ball around p. The last bound keeps
//! lights beyond the neighbouring ones apart from those where they lie on a floor that they light; cones of spheres, as p
//! is within most of them, would not.
//!
//! A choice goes down the tree, to one of two children in proportion to I. A point without a normal, whose material sends light
//! into a lobe, hardly knows what counts: there in proportion to √I, so that choices are more alike. Light may come from
//! behind n, since it may go through what is there. Cosines have a floor: what the bounds rule out is drawn seldom, but it is
//! drawn, so that rounding biases nothing.

use super::{Emitter, area_vector, importance};
use crate::math::{Vec3, vec3};
use crate::sampling::mix;
use glam::{Quat, Vec3 as V};
use rebond_lanes::{Index, Mask, Real, Record};
use std::f32::consts::{FRAC_PI_2, PI};

/// Of a link: what follows is an emitter's number, not the place of a pair of nodes.
const LEAF: u32 = 1 << 31;
/// Least cosine.
const FLOOR: f32 = 1e-3;
/// Records of two children that stand beside each other.
const PAIR: u32 = 4;

/// The hierarchy.
#[derive(Clone, Debug)]
pub(super) struct LightTree {
    /// Pairs of nodes, two records each: [centre, half extents], [axis, cones, intensity, link] (words, but for centre and
    /// intensity).
    /// A cache line a pair.
    nodes: Vec<Record>,
    /// Where a descent begins.
    root: u32,
    /// The turns that lead to each emitter (word), lowest bit first.
    trails: Vec<Record>,
}

/// What is known of some emitters together.
#[derive(Clone, Copy, Debug)]
struct Summary {
    lo: V,
    hi: V,
    axis: V,
    /// Half-angle of the cone of normals, and of what leaves around each.
    angles: [f32; 2],
    intensity: f32,
}

/// An emitter, and what is known of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    summary: Summary,
    /// Among all emitters.
    pub number: u32,
}

impl Light {
    /// `None` for emitters that are infinitely far, or shine as if they were. The intensity is relative to `unit`.
    fn new(number: u32, emitter: &Emitter, unit: f64) -> Option<Self> {
        let flat = |corners: [V; 4], normal: V, reach: f32| (corners, reach, normal, [0.0, FRAC_PI_2], PI);
        let round = |center: V, reach: f32| ([center; 4], reach, V::Z, [PI, FRAC_PI_2], 4.0 * PI);
        let (corners, reach, axis, angles, solid_angle) = match *emitter {
            Emitter::Triangle { p: [p, a, b], .. } => {
                flat([p, p + a, p + b, p], area_vector(a, b).normalize().as_vec3(), 0.0)
            }
            Emitter::Parallelogram { p: [p, a, b], .. } => {
                flat([p, p + a, p + a + b, p + b], area_vector(a, b).normalize().as_vec3(), 0.0)
            }
            Emitter::Disk { center, normal, radius, .. } => flat([center; 4], normal, radius),
            Emitter::Sphere { center, radius, .. } => round(center, radius),
            Emitter::Point { position, .. } => round(position, 0.0),
            Emitter::Spot { position, axis, angles: [inner, outer], .. } => {
                let ramp = if outer > inner { (inner.sin() - outer.sin()) / (outer - inner) } else { -outer.cos() };
                ([position; 4], 0.0, axis, [inner, (outer - inner).min(FRAC_PI_2)], 2.0 * PI * (1.0 + ramp))
            }
            Emitter::Projector { position, cone: (axis, angle), .. } => {
                // As if it shone alike into all of its cone.
                ([position; 4], 0.0, axis, [angle, 0.0], 2.0 * PI * (1.0 - angle.cos()).max(1e-6))
            }
            Emitter::Directional { .. } | Emitter::DirectionalArea { .. } | Emitter::Environment { .. } => return None,
        };
        // Along the normal or axis. The bounds keep what is weakest well within f32.
        let intensity = (importance(emitter, 0.0) / f64::from(solid_angle) / unit).clamp(1e-20, 1e20) as f32;
        let lo = corners.into_iter().fold(V::INFINITY, V::min) - reach;
        let hi = corners.into_iter().fold(V::NEG_INFINITY, V::max) + reach;
        Some(Self { summary: Summary { lo, hi, axis, angles, intensity }, number })
    }

    /// Those of some emitters that shine from somewhere.
    pub fn all(emitters: &[Emitter]) -> Vec<Self> {
        let powers = || emitters.iter().map(|e| importance(e, 0.0));
        let most = powers().fold(0.0, f64::max);
        let numbered = emitters.iter().zip(0_u32..).zip(powers()).filter(|(_, power)| *power > 0.0);
        let mut lights: Vec<Self> = numbered.filter_map(|((e, i), _)| Self::new(i, e, most)).collect();
        // So that intensity over distance² is about 1 whatever the unit of length.
        let (lo, hi) = lights
            .iter()
            .fold((V::INFINITY, V::NEG_INFINITY), |(lo, hi), l| (lo.min(l.summary.lo), hi.max(l.summary.hi)));
        let scale = (hi - lo).as_dvec3().length_squared().clamp(1e-15, 1e15) as f32;
        lights.iter_mut().for_each(|l| l.summary.intensity = (l.summary.intensity * scale).clamp(1e-30, 1e30));
        lights
    }

    fn center(&self) -> V {
        self.summary.lo.midpoint(self.summary.hi)
    }

    /// What bounds it, alone.
    pub fn bounds(&self) -> Bounds<f32> {
        let Summary { lo, hi, axis, angles: [o, e], intensity } = self.summary;
        let lanes = |v: V| Vec3::splat(v.to_array());
        Bounds {
            center: lanes(self.center()),
            half: lanes((hi - lo) * 0.5),
            axis: lanes(axis),
            cos_o: o.min(PI).cos(),
            cos_e: (e + 1e-3).min(PI).cos(),
            intensity,
        }
    }
}

/// What bounds the emitters of a node: a box, their normals' cone, what leaves around each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds<F: Real> {
    center: Vec3<F>,
    /// Half extents.
    half: Vec3<F>,
    axis: Vec3<F>,
    cos_o: F,
    cos_e: F,
    intensity: F,
}

impl Bounds<f32> {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat<F: Real>(&self) -> Bounds<F> {
        let lanes = |v: Vec3<f32>| Vec3::splat(v.array());
        Bounds {
            center: lanes(self.center),
            half: lanes(self.half),
            axis: lanes(self.axis),
            cos_o: F::splat(self.cos_o),
            cos_e: F::splat(self.cos_e),
            intensity: F::splat(self.intensity),
        }
    }
}

impl<F: Real> Bounds<F> {
    /// Those of a node, from its records.
    #[inline(always)]
    fn unpack([x, y, z, extents]: [F; 4], [axis, cones, intensity, _]: [F; 4]) -> Self {
        let word = extents.to_bits();
        let unit = F::from_bits((word >> 24) << 23) * (1.0 / 255.0);
        let half = |shift: u32| F::from_index((word >> shift) & F::Index::splat(255)) * unit;
        let word = axis.to_bits();
        let coordinate = |shift: u32| F::from_index((word >> shift) & F::Index::splat(1023)) * (1.0 / 511.0) - 1.0;
        let cosine = |bits: F::Index| F::from_index(bits) * (1.0 / 32_767.5) - 1.0;
        Self {
            center: vec3(x, y, z),
            half: vec3(half(16), half(8), half(0)),
            axis: vec3(coordinate(20), coordinate(10), coordinate(0)),
            cos_o: cosine(cones.to_bits() >> 16),
            cos_e: cosine(cones.to_bits() & F::Index::splat(0xffff)),
            intensity,
        }
    }
}

impl Summary {
    fn union(self, o: Self) -> Self {
        let (axis, cone) = cone_union((self.axis, self.angles[0]), (o.axis, o.angles[0]));
        Self {
            lo: self.lo.min(o.lo),
            hi: self.hi.max(o.hi),
            axis,
            angles: [cone, self.angles[1].max(o.angles[1])],
            intensity: self.intensity + o.intensity,
        }
    }

    /// What it costs to have these in one node (Conty Estevez and Kulla, eq. 1–2), with the square of the diagonal for the
    /// area of the box, which is 0 for lights on a line.
    fn cost(&self) -> f32 {
        let [o, e] = self.angles;
        let w = (o + e).min(PI);
        let (sin, cos) = o.sin_cos();
        let orientation =
            2.0 * PI * (1.0 - cos) + FRAC_PI_2 * (2.0 * w * sin - (o - 2.0 * w).cos() - 2.0 * o * sin + cos);
        self.intensity * orientation * (self.hi - self.lo).length_squared()
    }

    /// Its records, rounded to what is wider.
    fn records(&self, link: u32) -> [Record; 2] {
        let center = self.lo.midpoint(self.hi);
        // Half extents: 255ths of a power of two that is above all of them.
        let half = (self.hi - center).max(center - self.lo);
        let exponent = (half.max_element().max(1e-30).to_bits() >> 23) + 1;
        let unit = f32::from_bits(exponent << 23) / 255.0;
        let [x, y, z] = half.to_array().map(|h| ((h / unit).ceil() as u32).min(255));
        let extents = exponent << 24 | x << 16 | y << 8 | z;
        let axis = self.axis.to_array().map(|x| (x * 511.0 + 511.5) as u32);
        let kept = V::from(axis.map(|q| q as f32 / 511.0 - 1.0));
        let cosine = |angle: f32| ((angle.min(PI).cos() + 1.0) * 32_767.5) as u32;
        let [o, e] = [self.angles[0] + angle(kept, self.axis), self.angles[1] + 1e-3].map(cosine);
        let word = f32::from_bits;
        let axis = axis[0] << 20 | axis[1] << 10 | axis[2];
        [
            Record([center.x, center.y, center.z, word(extents)]),
            Record([word(axis), word(o << 16 | e), self.intensity, word(link)]),
        ]
    }
}

/// The angle between two directions; exact where they are close, as acos is not.
fn angle(a: V, b: V) -> f32 {
    a.cross(b).length().atan2(a.dot(b))
}

/// A cone, as axis and half-angle, that holds both.
fn cone_union(a: (V, f32), b: (V, f32)) -> (V, f32) {
    let (a, b) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    let between = angle(a.0, b.0);
    if (between + b.1).min(PI) <= a.1 {
        return a;
    }
    let half = 0.5 * (a.1 + b.1 + between);
    match a.0.cross(b.0).try_normalize() {
        Some(turn) if half < PI => ((Quat::from_axis_angle(turn, half - a.1) * a.0).normalize(), half),
        _ => (a.0, PI),
    }
}

/// Bins along an axis, between which a node may be split.
const BINS: usize = 12;

struct Builder {
    nodes: Vec<Record>,
    trails: Vec<Record>,
}

impl Builder {
    /// The nodes over some lights, reached by these `depth` turns; what is known of them, and the link to them.
    fn build(&mut self, lights: &mut [Light], trail: u32, depth: u32) -> (Summary, u32) {
        if let [light] = lights {
            self.trails[light.number as usize] = Record::words([trail, 0, 0, 0]);
            return (light.summary, LEAF | light.number);
        }
        let middle = split(lights, 31 - depth);
        let at = self.nodes.len();
        self.nodes.resize(at + PAIR as usize, Record::default());
        let (first, second) = lights.split_at_mut(middle);
        let (a, link_a) = self.build(first, trail, depth + 1);
        let (b, link_b) = self.build(second, trail | 1 << depth, depth + 1);
        self.nodes[at..at + 2].copy_from_slice(&a.records(link_a));
        self.nodes[at + 2..at + 4].copy_from_slice(&b.records(link_b));
        (a.union(b), at as u32)
    }
}

/// Parts two lights or more where they cost least (the surface area and orientation heuristic); returns how many are before
/// that. No path may be longer than `levels`.
fn split(lights: &mut [Light], levels: u32) -> usize {
    let (lo, hi) =
        lights.iter().map(Light::center).fold((V::INFINITY, V::NEG_INFINITY), |(lo, hi), c| (lo.min(c), hi.max(c)));
    let extent = hi - lo;
    let half = lights.len() / 2;
    // Halves of halves fit into as many levels as their number has bits.
    let shallow = (lights.len() as u32).next_power_of_two().ilog2() < levels;
    let mut best = (f32::INFINITY, 0, 0);
    if shallow && lights.len() > 2 {
        for axis in 0..3 {
            if extent[axis] <= 0.0 {
                continue;
            }
            let mut bins = [None; BINS];
            for l in &*lights {
                let b = &mut bins[bin(l, axis, lo, extent)];
                *b = join(*b, Some(l.summary));
            }
            let mut after = [None; BINS];
            for i in (0..BINS - 1).rev() {
                after[i] = join(after[i + 1], bins[i + 1]);
            }
            let mut before = None;
            for i in 0..BINS - 1 {
                before = join(before, bins[i]);
                let (Some(a), Some(b)) = (before, after[i]) else { continue };
                // Long thin nodes cost more.
                let cost = (a.cost() + b.cost()) * extent.max_element() / extent[axis];
                if cost < best.0 {
                    best = (cost, axis, i);
                }
            }
        }
    }
    let (cost, axis, last) = best;
    if cost.is_finite() {
        let mut before = 0;
        for i in 0..lights.len() {
            if bin(&lights[i], axis, lo, extent) <= last {
                lights.swap(i, before);
                before += 1;
            }
        }
        return before;
    }
    let axis = extent.max_position();
    lights.select_nth_unstable_by(half, |a, b| a.center()[axis].total_cmp(&b.center()[axis]));
    half
}

fn bin(light: &Light, axis: usize, lo: V, extent: V) -> usize {
    let x = (light.center()[axis] - lo[axis]) / extent[axis];
    ((x * BINS as f32) as usize).min(BINS - 1)
}

fn join(a: Option<Summary>, b: Option<Summary>) -> Option<Summary> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(b)),
        (a, b) => a.or(b),
    }
}

/// cos(max(0, a − b)).
#[inline(always)]
fn cos_difference<F: Real>([sin_a, cos_a]: [F; 2], [sin_b, cos_b]: [F; 2]) -> F {
    F::select(cos_a.gt(cos_b), F::one(), cos_a.mul_add(cos_b, sin_a * sin_b))
}

/// sin(max(0, a − b)).
#[inline(always)]
fn sin_difference<F: Real>([sin_a, cos_a]: [F; 2], [sin_b, cos_b]: [F; 2]) -> F {
    F::select(cos_a.gt(cos_b), F::zero(), sin_a.mul_add(cos_b, -(cos_a * sin_b)))
}

#[inline(always)]
fn with_sine<F: Real>(cos: F) -> [F; 2] {
    [(F::one() - cos * cos).safe_sqrt(), cos]
}

/// A point that asks for light.
pub(super) struct Receiver<F: Real> {
    p: Vec3<F>,
    n: Vec3<F>,
    /// It has no normal, and receives the same from everywhere.
    bare: F::Mask,
}

impl<F: Real> Receiver<F> {
    #[inline(always)]
    pub fn new(p: Vec3<F>, n: Vec3<F>) -> Self {
        Self { p, n, bare: !n.length_squared().gt(F::zero()) }
    }

    /// How bright a node looks from here.
    #[inline(always)]
    pub fn importance(&self, Bounds { center, half, axis, cos_o, cos_e, intensity }: Bounds<F>) -> F {
        let to = center - self.p;
        let tiny = F::splat(1e-30);
        let (d2, r2) = (to.length_squared(), half.length_squared());
        let away = to.map(F::abs);
        let near = (away - half).map(F::relu).length_squared().max(tiny).sqrt();
        let far = (away + half).length();
        let sin2_b = r2 / d2.max(tiny);
        let b = [sin2_b.sqrt(), (F::one() - sin2_b).safe_sqrt()];
        let inverse = d2.max(tiny).sqrt().recip();

        let o = with_sine(cos_o);
        let w = with_sine(-(axis.dot(to) * inverse));
        let emitter = cos_difference([sin_difference(w, o), cos_difference(w, o)], b);
        let emitter = F::select(emitter.gt(cos_e), emitter, F::zero()).max(F::splat(FLOOR));

        let height = self.n.dot(to).abs() + self.n.map(F::abs).dot(half);
        let receiver = F::select(self.bare, F::one(), (height / near).clamp(FLOOR, 1.0));
        let emitter = F::select(d2.gt(r2), emitter, F::one());
        let brightness = intensity * emitter * receiver / (near * far).max(r2 * (1.0 / 3.0)).max(tiny);
        if self.bare.none() { brightness } else { F::select(self.bare, brightness.sqrt(), brightness) }
    }

    /// The probabilities of the children at `at`, and their links.
    #[inline(always)]
    fn children(&self, nodes: &[Record], at: F::Index) -> ([F; 2], [F::Index; 2]) {
        let record = |n: u32| F::record(nodes, at + F::Index::splat(n));
        let (a, b) = ([record(0), record(1)], [record(2), record(3)]);
        let importance = [a, b].map(|[place, cone]| self.importance(Bounds::unpack(place, cone)));
        let sum = importance[0] + importance[1];
        // False for NaN as well.
        let sound = sum.gt(F::zero()) & sum.is_finite();
        let probability = importance.map(|i| F::select(sound, i / sum, F::splat(0.5)));
        (probability, [a[1][3].to_bits(), b[1][3].to_bits()])
    }
}

impl LightTree {
    /// A hierarchy over these, which are one or more, of so many emitters.
    pub fn new(mut lights: Vec<Light>, emitters: usize) -> Self {
        let mut builder = Builder { nodes: Vec::new(), trails: vec![Record::default(); emitters] };
        let (_, root) = builder.build(&mut lights, 0, 0);
        Self { nodes: builder.nodes, root, trails: builder.trails }
    }

    /// An emitter for the point `p` with normal `n`, and the probability of that choice, for u in [0, 1).
    #[inline(always)]
    pub fn sample<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, u: F, mask: F::Mask) -> (F::Index, F) {
        let receiver = Receiver::new(p, n);
        let (mut u, mut probability, mut link) = (u, F::one(), F::Index::splat(self.root));
        // What is left of u within a child's share has fewer digits the smaller that is. New ones come from a hash of
        // what changes with every sample, stepped by a linear congruence (Knuth's, of which the upper bits are good).
        let mut digits = mix(mix(mix(p.x.to_bits()) + p.y.to_bits()) + p.z.to_bits() + u.to_bits());
        loop {
            let inner = mask & link.lt(F::Index::splat(LEAF));
            if inner.none() {
                break;
            }
            let ([first, second], links) = receiver.children(&self.nodes, link);
            let takes_first = u.lt(first);
            let share = F::select(takes_first, first, second);
            let below = F::select(takes_first, u, u - first);
            let fresh = F::from_index(digits >> 8) * (1.0 / 16_777_216.0 / 16_777_216.0);
            digits = digits * F::Index::splat(1_664_525) + F::Index::splat(1_013_904_223);
            let rest = ((below + fresh) / share).min(F::splat(1.0 - f32::EPSILON / 2.0));
            u = F::select(inner, rest, u);
            probability = F::select(inner, probability * share, probability);
            link = F::Index::select(inner, F::Index::select(takes_first, links[0], links[1]), link);
        }
        (link & F::Index::splat(!LEAF), probability)
    }

    /// The probability with which [`LightTree::sample`] chooses this emitter, which shines from somewhere.
    #[inline(always)]
    pub fn probability<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, emitter: F::Index, mask: F::Mask) -> F {
        let receiver = Receiver::new(p, n);
        let (mut probability, mut link) = (F::one(), F::Index::splat(self.root));
        let mut trail = F::words(&self.trails, emitter)[0];
        loop {
            let inner = mask & link.lt(F::Index::splat(LEAF));
            if inner.none() {
                break;
            }
            let ([first, second], links) = receiver.children(&self.nodes, link);
            let takes_first = (trail & F::Index::splat(1)).eq(F::Index::splat(0));
            trail = trail >> 1;
            let share = F::select(takes_first, first, second);
            probability = F::select(inner, probability * share, probability);
            link = F::Index::select(inner, F::Index::select(takes_first, links[0], links[1]), link);
        }
        probability
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.nodes.len() + self.trails.len()) * size_of::<Record>()
    }
}

#[cfg(test)]
mod tests;
