//! The choice is what it says it is, and the bounds hold.

use super::*;
use crate::emitter::{Emitters, LightChoice, LightSampler, LightSampling};
use crate::math::Frame;
use crate::sampling::warp::uniform_sphere;
use crate::sampling::{Sampler, SamplerSettings, Stream};
use crate::testing::chi2_counts;
use rebond_lanes::{F32x16, scalar::Index1};

/// Sample values, one after the other.
struct Values(Stream<f32>, u32);

impl Values {
    fn new(seed: u32) -> Self {
        Self(Sampler::new(SamplerSettings::Independent {}, 5).stream(Index1(seed), Index1(0)), 0)
    }
    fn pair(&mut self) -> [f32; 2] {
        self.1 += 1;
        self.0.pair(Index1(self.1))
    }
    fn one(&mut self) -> f32 {
        self.pair()[0]
    }
    fn direction(&mut self) -> V {
        V::from(uniform_sphere::<f32>(self.pair()).array())
    }
    /// Within a ball.
    fn place(&mut self, radius: f32) -> V {
        self.direction() * radius * self.one().cbrt()
    }
    fn radiance(&mut self) -> [f32; 3] {
        [10_f32.powf(4.0 * self.one() - 2.0), 1.0, self.one()]
    }
    /// One of each kind that has a place, in turn.
    fn emitter(&mut self, i: usize) -> Emitter {
        let (place, size, radiance) = (self.place(4.0), 0.5 * self.one() + 0.01, self.radiance());
        match i % 7 {
            0 | 6 => Emitter::Triangle { p: [place, self.direction() * size, self.direction() * size], radiance },
            1 => {
                let a = self.direction() * size;
                Emitter::Parallelogram { p: [place, a, a.any_orthogonal_vector() * self.one()], radiance }
            }
            2 => Emitter::Sphere { center: place, radius: size, inwards: self.one() < 0.3, radiance },
            3 => Emitter::Disk { center: place, normal: self.direction(), radius: size, radiance },
            4 => Emitter::Point { position: place, intensity: radiance },
            _ => {
                let outer = 3.0 * self.one() + 0.1;
                let angles = [outer * self.one(), outer];
                Emitter::Spot { position: place, axis: self.direction(), angles, intensity: radiance }
            }
        }
    }
}

fn lanes(v: V) -> Vec3<f32> {
    Vec3::splat(v.to_array())
}

/// Emitters of all kinds, some of them infinite, one without power, and the choice among them.
fn mixture(n: usize, infinite: bool, values: &mut Values) -> (Vec<Emitter>, LightSampler) {
    let mut emitters: Vec<Emitter> = (0..n).map(|i| values.emitter(i)).collect();
    emitters.insert(n / 2, Emitter::Point { position: V::ZERO, intensity: [0.0; 3] });
    if infinite {
        emitters.insert(n / 3, Emitter::Directional { direction: V::X, irradiance: [2.0; 3] });
        emitters.push(Emitter::Environment { number: 0, mean: [0.1; 3] });
    }
    let sampler = LightSampler::new(&emitters, 5.0, Some(LightChoice::Tree)).expect("finite powers");
    (emitters, sampler)
}

#[test]
fn probabilities_add_up_to_one() {
    let mut values = Values::new(1);
    for n in [1, 2, 3, 7, 100, 1000] {
        for infinite in [false, true] {
            let (emitters, sampler) = mixture(n, infinite, &mut values);
            for _ in 0..20 {
                let (p, normal) = (lanes(values.place(8.0)), lanes(values.direction()));
                for normal in [normal, Vec3::zero()] {
                    let probability = |i: usize| sampler.probability(p, normal, Index1(i as u32), true);
                    let all: Vec<f32> = (0..emitters.len()).map(probability).collect();
                    let sum = all.iter().map(|x| f64::from(*x)).sum::<f64>();
                    assert!((sum - 1.0).abs() < 1e-5, "{n} emitters: {sum}");
                    for (e, p) in emitters.iter().zip(all) {
                        assert_eq!(p > 0.0, importance(e, 5.0) > 0.0, "{e:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn lanes_choose_as_one_does_and_know_its_probability() {
    let mut values = Values::new(2);
    for n in [5, 300] {
        lanes_choose(n, &mut values);
    }
}

fn lanes_choose(n: usize, values: &mut Values) {
    let (emitters, sampler) = mixture(n, true, values);
    let mut lane_of = |f: &mut dyn FnMut(&mut Values) -> f32| {
        (0..16).fold(F32x16::splat(0.0), |v, lane| v.with_lane(lane, f(values)))
    };
    for _ in 0..200 {
        let mut vector = |radius: f32| {
            let mut c = || lane_of(&mut |v| radius * (2.0 * v.one() - 1.0));
            vec3(c(), c(), c())
        };
        let (p, n) = (vector(5.0), vector(1.0).normalized());
        // The lanes that look down have none.
        let n = Vec3::select(n.z.gt(F32x16::splat(-0.3)), n, Vec3::zero());
        let u = lane_of(&mut Values::one);
        let (all, none) = (Mask::splat(true), Mask::splat(false));
        let (emitter, probability) = sampler.sample(p, n, || u, all).expect("light");
        let again = sampler.probability(p, n, emitter, all);
        for lane in 0..16 {
            let (p, n) = (Vec3::<f32>::splat(p.lane(lane)), Vec3::splat(n.lane(lane)));
            let (e, q) = sampler.sample(p, n, || u.lane(lane), true).expect("light");
            assert_eq!((e.0, q), (emitter.lane(lane), probability.lane(lane)));
            assert_eq!(q, again.lane(lane));
            assert!((e.0 as usize) < emitters.len() && q > 0.0);
        }
        // Lanes that are not asked must end, whatever is in them.
        let nan = F32x16::splat(f32::NAN);
        sampler.probability(vec3(nan, nan, nan), n, Index::splat(u32::MAX), none);
        sampler.sample(vec3(nan, nan, nan), n, || nan, all);
    }
}

#[test]
fn draws_follow_their_probabilities() {
    let mut values = Values::new(3);
    for (n, infinite) in [(5, false), (7, true), (10, false), (40, true), (200, false)] {
        let (emitters, sampler) = mixture(n, infinite, &mut values);
        for round in 0..3 {
            let normal = if round == 2 { Vec3::zero() } else { lanes(values.direction()) };
            let p = lanes(values.place(6.0));
            let draws = 100_000;
            let mut counts = vec![0; emitters.len()];
            for u in crate::testing::random_pairs(draws) {
                let (e, _) = sampler.sample(p, normal, || u[0], true).expect("light");
                counts[e.0 as usize] += 1;
            }
            let expected =
                |i: usize| f64::from(draws) * f64::from(sampler.probability::<f32>(p, normal, Index1(i as u32), true));
            let expected: Vec<f64> = (0..emitters.len()).map(expected).collect();
            chi2_counts(&format!("{n} emitters"), &counts, &expected);
        }
    }
}

/// Of 4096 emitters that share the 65 000th part of what there is, 256 could be told apart by what is left of u.
#[test]
fn digits_do_not_run_out() {
    let n = 4096_u32;
    let mut values = Values::new(4);
    let mut emitters = vec![Emitter::Point { position: V::new(10.0, 0.0, 0.0), intensity: [1.0; 3] }];
    for _ in 0..n {
        let position = V::new(-10.0, 0.0, 0.0) + values.place(0.1);
        emitters.push(Emitter::Point { position, intensity: [1.0 / (65_536.0 * n as f32); 3] });
    }
    let tree = LightTree::new(Light::all(&emitters), emitters.len());
    let normal = lanes(V::X);
    let weak_first = tree.sample(Vec3::zero(), normal, 0.0_f32, true).0.0 != 0;
    let (mut counts, mut draws, mut expected) = (vec![0; n as usize], 0, vec![0.0; n as usize]);
    for k in 0..256 {
        let u = if weak_first { k as f32 } else { (1 << 24) as f32 - 1.0 - k as f32 } / (1 << 24) as f32;
        for _ in 0..200 {
            let p = lanes(values.place(1e-3));
            let (e, _) = tree.sample(p, normal, u, true);
            assert!(e.0 > 0);
            counts[e.0 as usize - 1] += 1;
            draws += 1;
        }
    }
    let mut total = 0.0;
    for (e, x) in expected.iter_mut().enumerate() {
        *x = f64::from(tree.probability::<f32>(Vec3::zero(), normal, Index1(e as u32 + 1), true));
        total += *x;
    }
    assert!((total * 65_537.0 - 1.0).abs() < 1e-3, "{total}");
    expected.iter_mut().for_each(|x| *x *= f64::from(draws) / total);
    chi2_counts("weak emitters", &counts, &expected);
}

/// The cosines of a node are at least those of any point of any of its emitters.
#[test]
fn bounds_hold() {
    let mut values = Values::new(5);
    let mut tight = 0;
    for round in 0..3000 {
        let n = 1 + round % 5;
        // From all over, or close together and turned alike.
        let first = values.emitter(round / 5);
        let emitters: Vec<Emitter> = (0..n).map(|i| if i == 0 { first } else { values.emitter(i) }).collect();
        let lights: Vec<Light> = (0..).zip(&emitters).map(|(i, e)| Light::new(i, e, 1.0).expect("a place")).collect();
        let all = lights.iter().map(|l| l.summary).reduce(Summary::union).expect("one");
        let [place, cone] = all.records(0).map(|r| r.0);
        // Of the box, as kept.
        let half = |shift: u32| {
            (place[3].to_bits() >> shift & 255) as f32 / 255.0 * f32::from_bits(place[3].to_bits() >> 24 << 23)
        };
        let (center, half) = (V::new(place[0], place[1], place[2]), V::new(half(16), half(8), half(0)));
        assert!((all.lo - center + half).min_element() >= -1e-6 && (center + half - all.hi).min_element() >= -1e-6);
        assert!((half - 0.5 * (all.hi - all.lo)).max_element() < 0.01 * half.max_element() + 1e-6);
        let table = Emitters::new(&emitters, vec![]);
        for _ in 0..20 {
            let (p, normal) = (values.place(12.0), values.direction());
            let receiver = Receiver::new(lanes(p), lanes(normal));
            let away = (p - center).abs();
            let (near, far) = ((away - half).max(V::ZERO).length(), (away + half).length());
            let d2 = (near * far).max(half.length_squared() / 3.0);
            let cosines = receiver.importance(Bounds::unpack(place, cone)) * d2 / all.intensity;
            for (i, e) in (0..).zip(&emitters) {
                let s = table.sample(Index1(i), lanes(p), 0.0, LightSampling::Area, values.pair(), true);
                if s.weight.g == 0.0 {
                    continue;
                }
                let leaves = -V::from(s.wi.array());
                let around = match e {
                    Emitter::Spot { axis, angles, .. } => (angle(leaves, *axis) - angles[0]).max(0.0).cos(),
                    Emitter::Point { .. } | Emitter::Sphere { .. } => 1.0,
                    _ => V::from(s.normal.array()).dot(leaves),
                };
                let exact = around * leaves.dot(normal).abs();
                assert!(cosines > exact * 0.995 - 2e-3, "{exact} but {cosines}: {e:?} of {n}");
                tight += u32::from(n == 1 && exact > 0.5 * cosines);
            }
        }
    }
    assert!(tight > 3000, "bounds that say something: {tight}");
}

#[test]
fn cones_hold_their_parts() {
    let mut values = Values::new(6);
    for _ in 0..2000 {
        let mut cone = || (values.direction(), 2.0 * values.one());
        let (a, b) = (cone(), cone());
        let union = cone_union(a, b);
        for (axis, half) in [a, b] {
            let frame = Frame::<f32>::around(lanes(axis));
            for k in 0..8 {
                let (sin, cos) = half.sin_cos();
                let (y, x) = (k as f32).sin_cos();
                let edge = V::from(frame.to_world(Vec3::splat([sin * x, sin * y, cos])).array());
                assert!(angle(edge, union.0) <= union.1 + 1e-3);
            }
        }
    }
}

/// Lights on one spot or on a line, and ever smaller clusters: trees stay flat enough for a trail.
#[test]
fn degenerate_places_make_trees() {
    let places: [fn(f32) -> V; 3] = [|_| V::ONE, |i| V::X * i, |i| V::Y * (-0.4 * i).exp2()];
    for place in places {
        let emitter = |i: u16| Emitter::Point { position: place(f32::from(i)), intensity: [1.0; 3] };
        let emitters: Vec<Emitter> = (0..300).map(emitter).collect();
        let tree = LightTree::new(Light::all(&emitters), emitters.len());
        let probability = |i: u32| tree.probability::<f32>(Vec3::splat([1.0; 3]), Vec3::zero(), Index1(i), true);
        let sum: f32 = (0..300).map(probability).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }
}
