//! Which emitter a point asks for light.

use super::light_list::LightList;
use super::light_tree::{Light, LightTree};
use super::{Emitter, importance};
use crate::math::Vec3;
use crate::sampling::Discrete;
use rebond_lanes::{Index, Mask, Real, Record};
use serde::{Deserialize, Serialize};

/// How an emitter is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightChoice {
    /// In proportion to power, the same from everywhere.
    Power,
    /// By a hierarchy that knows how near emitters are and which way they shine.
    Tree,
}

/// Emitters with a place from which on where they are counts, if nothing else is asked for. Two already gain much.
const TREE_FROM: usize = 2;

/// A choice among the emitters.
#[derive(Clone, Debug, Default)]
pub struct LightSampler {
    choice: Choice,
    /// In proportion to power, for light that leaves to where it will.
    by_power: Option<Discrete>,
}

#[derive(Clone, Debug, Default)]
enum Choice {
    #[default]
    Nothing,
    Power(Discrete),
    Tree(Box<Apart>),
}

/// Emitters that have a place, and those that are infinitely far, or whose light does not grow with nearness.
#[derive(Clone, Debug)]
struct Apart {
    placed: Placed,
    /// [probability of choosing among its like, whether it has a place (word), number among the infinite (word), –] of
    /// each emitter.
    kinds: Vec<Record>,
    infinite: Option<Infinite>,
}

/// How those with a place are chosen from.
#[derive(Clone, Debug)]
enum Placed {
    List(LightList),
    Tree(LightTree),
}

#[derive(Clone, Debug)]
struct Infinite {
    by_power: Discrete,
    /// The probability that one of these is chosen.
    share: f32,
    /// The number of each among all emitters (word).
    numbers: Vec<Record>,
}

/// The share of infinite emitters, together, beside a tree. In the light of the whole they may be little or almost all; it is
/// not known how much of that reaches a point.
const INFINITE_SHARE: [f64; 2] = [0.25, 0.5];

impl LightSampler {
    /// A choice among these; `scene_radius` is what infinite ones shine on. `None` if a power is not finite.
    pub fn new(emitters: &[Emitter], scene_radius: f32, choice: Option<LightChoice>) -> Option<Self> {
        let power: Vec<f64> = emitters.iter().map(|e| importance(e, scene_radius)).collect();
        if !power.iter().all(|p| p.is_finite()) {
            return None;
        }
        let placed = |e: &Emitter| {
            use Emitter::{Directional, DirectionalArea, Environment};
            !matches!(e, Directional { .. } | DirectionalArea { .. } | Environment { .. })
        };
        let few = emitters.iter().filter(|e| placed(e)).count() < TREE_FROM;
        let lights = match choice {
            Some(LightChoice::Power) => vec![],
            None if few => vec![],
            _ => Light::all(emitters),
        };
        if lights.is_empty() {
            let by_power = by_power(&power);
            let choice = by_power.clone().map_or(Choice::Nothing, Choice::Power);
            return Some(Self { choice, by_power });
        }
        let listed = lights.len() <= LightList::MOST;
        let placed_ones = if listed {
            Placed::List(LightList::new(&lights, emitters.len()))
        } else {
            Placed::Tree(LightTree::new(lights, emitters.len()))
        };
        let far: Vec<usize> = (0..emitters.len()).filter(|i| !placed(&emitters[*i])).collect();
        let power_of_far: Vec<f64> = far.iter().map(|i| power[*i]).collect();
        let infinite = by_power(&power_of_far).map(|by_power| Infinite {
            by_power,
            share: (power_of_far.iter().sum::<f64>() / power.iter().sum::<f64>())
                .clamp(INFINITE_SHARE[0], INFINITE_SHARE[1]) as f32,
            numbers: far.iter().map(|i| Record::words([*i as u32, 0, 0, 0])).collect(),
        });
        let share = infinite.as_ref().map_or(0.0, |i| i.share);
        let mut kinds: Vec<Record> = power.iter().map(|p| kind(1.0 - share, *p > 0.0, 0)).collect();
        for (number, i) in far.iter().enumerate() {
            kinds[*i] = kind(share, false, number as u32);
        }
        for (kind, power) in kinds.iter_mut().zip(&power) {
            if *power == 0.0 {
                *kind = Record::default();
            }
        }
        let choice = Choice::Tree(Box::new(Apart { placed: placed_ones, kinds, infinite }));
        Some(Self { choice, by_power: by_power(&power) })
    }

    /// An emitter for the point `p` with normal `n` (zero if it has none), and the probability of that choice; `None` in a
    /// scene without light.
    #[inline(always)]
    pub fn sample<F: Real>(
        &self,
        p: Vec3<F>,
        n: Vec3<F>,
        u: impl FnOnce() -> F,
        mask: F::Mask,
    ) -> Option<(F::Index, F)> {
        match &self.choice {
            Choice::Nothing => None,
            Choice::Power(by_power) => {
                let u = if by_power.len() == 1 { F::zero() } else { u() };
                Some(by_power.sample(u))
            }
            Choice::Tree(apart) => Some(apart.sample(p, n, u(), mask)),
        }
    }

    /// The probability with which [`LightSampler::sample`] chooses this emitter.
    #[inline(always)]
    pub fn probability<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, emitter: F::Index, mask: F::Mask) -> F {
        match &self.choice {
            Choice::Nothing => F::zero(),
            Choice::Power(by_power) => by_power.probability(emitter),
            Choice::Tree(apart) => apart.probability(p, n, emitter, mask),
        }
    }

    /// An emitter that light leaves from, and the probability of that choice: by power. `None` in a scene without light.
    #[inline(always)]
    pub fn source<F: Real>(&self, u: impl FnOnce() -> F) -> Option<(F::Index, F)> {
        let by_power = self.by_power.as_ref()?;
        let u = if by_power.len() == 1 { F::zero() } else { u() };
        Some(by_power.sample(u))
    }

    /// The probability with which [`LightSampler::source`] chooses this emitter.
    #[inline(always)]
    pub fn source_probability<F: Real>(&self, emitter: F::Index) -> F {
        self.by_power.as_ref().map_or(F::zero(), |by_power| by_power.probability(emitter))
    }

    /// Bytes of a tree.
    pub fn bytes(&self) -> usize {
        match &self.choice {
            Choice::Tree(apart) => apart.placed.bytes() + apart.kinds.len() * size_of::<Record>(),
            _ => 0,
        }
    }
}

/// In proportion to power; `None` if there is none. Relative to the strongest, so that no scale of units overflows.
fn by_power(power: &[f64]) -> Option<Discrete> {
    let most = power.iter().fold(0.0, |m: f64, p| m.max(*p));
    let weights: Vec<f32> = power.iter().map(|p| if most > 0.0 { (p / most) as f32 } else { 0.0 }).collect();
    Discrete::new(&weights)
}

fn kind(probability: f32, in_tree: bool, number: u32) -> Record {
    Record([probability, f32::from_bits(in_tree.into()), f32::from_bits(number), 0.0])
}

impl Placed {
    #[inline(always)]
    fn sample<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, u: F, mask: F::Mask) -> (F::Index, F) {
        match self {
            Self::List(list) => list.sample(p, n, u),
            Self::Tree(tree) => tree.sample(p, n, u, mask),
        }
    }

    #[inline(always)]
    fn probability<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, emitter: F::Index, mask: F::Mask) -> F {
        match self {
            Self::List(list) => list.probability(p, n, emitter),
            Self::Tree(tree) => tree.probability(p, n, emitter, mask),
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::List(list) => list.bytes(),
            Self::Tree(tree) => tree.bytes(),
        }
    }
}

impl Apart {
    // Apart, so that scenes without a tree keep their loops short.
    #[inline(never)]
    fn sample<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, u: F, mask: F::Mask) -> (F::Index, F) {
        let Some(Infinite { by_power, share, numbers }) = &self.infinite else {
            return self.placed.sample(p, n, u, mask);
        };
        let far = u.lt(F::splat(*share));
        let (number, among) = by_power.sample((u * (1.0 / share)).min(F::splat(1.0 - f32::EPSILON / 2.0)));
        let (placed, probability) = self.placed.sample(p, n, (u - *share) * (1.0 / (1.0 - share)), mask.and_not(far));
        let infinite = F::words(numbers, number)[0];
        (F::Index::select(far, infinite, placed), F::select(far, among * *share, probability * (1.0 - share)))
    }

    #[inline(never)]
    fn probability<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, emitter: F::Index, mask: F::Mask) -> F {
        let [share, in_tree, number, _] = F::record(&self.kinds, emitter);
        let in_tree = mask & in_tree.to_bits().ne(F::Index::splat(0));
        let mut among = F::zero();
        if in_tree.any() {
            among = self.placed.probability(p, n, emitter, in_tree);
        }
        if let Some(infinite) = &self.infinite {
            among = F::select(in_tree, among, infinite.by_power.probability(number.to_bits()));
        }
        among * share
    }
}
