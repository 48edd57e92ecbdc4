//! The choice among a few emitters that have a place: each is looked at, as the leaves of a
//! [`LightTree`](super::light_tree::LightTree) would be. No bounds of several together, no descent: for so few that is
//! faster, and closer to what arrives.

use super::light_tree::{Bounds, Light, Receiver};
use crate::math::Vec3;
use rebond_lanes::{Index, Mask, Real, Record};

/// Some emitters.
#[derive(Clone, Debug)]
pub(super) struct LightList {
    lights: Vec<(Bounds<f32>, u32)>,
    /// The place in the list (word) of each of all emitters.
    places: Vec<Record>,
}

impl LightList {
    /// How many may be in a list.
    pub const MOST: usize = 8;

    /// A list of these, which are one or more, of so many emitters.
    pub fn new(lights: &[Light], emitters: usize) -> Self {
        debug_assert!((1..=Self::MOST).contains(&lights.len()), "{}", lights.len());
        let mut places = vec![Record::default(); emitters];
        for (light, place) in lights.iter().zip(0..) {
            places[light.number as usize] = Record::words([place, 0, 0, 0]);
        }
        Self { lights: lights.iter().map(|light| (light.bounds(), light.number)).collect(), places }
    }

    /// How bright each looks from a point, and all together.
    #[inline(always)]
    fn importance<F: Real>(&self, p: Vec3<F>, n: Vec3<F>) -> ([F; Self::MOST], F) {
        let receiver = Receiver::new(p, n);
        let (mut each, mut sum) = ([F::zero(); Self::MOST], F::zero());
        for (kept, (bounds, _)) in each.iter_mut().zip(&self.lights) {
            *kept = receiver.importance(bounds.splat());
            sum += *kept;
        }
        // False for NaN as well.
        let sound = sum.gt(F::zero()) & sum.is_finite();
        if !sound.all() {
            each = each.map(|importance| F::select(sound, importance, F::one()));
            sum = F::select(sound, sum, F::splat(self.lights.len() as f32));
        }
        (each, sum)
    }

    /// An emitter for the point `p` with normal `n`, and the probability of that choice, for u in [0, 1).
    #[inline(always)]
    pub fn sample<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, u: F) -> (F::Index, F) {
        let (each, sum) = self.importance(p, n);
        let target = u * sum;
        let (mut emitter, mut share) = (F::Index::splat(self.lights[0].1), each[0]);
        let mut before = each[0];
        for (importance, (_, number)) in each.iter().zip(&self.lights).skip(1) {
            let beyond = target.ge(before);
            emitter = F::Index::select(beyond, F::Index::splat(*number), emitter);
            share = F::select(beyond, *importance, share);
            before += *importance;
        }
        (emitter, share / sum)
    }

    /// The probability with which [`LightList::sample`] chooses this emitter, which is in the list.
    #[inline(always)]
    pub fn probability<F: Real>(&self, p: Vec3<F>, n: Vec3<F>, emitter: F::Index) -> F {
        let (each, sum) = self.importance(p, n);
        let place = F::words(&self.places, emitter)[0];
        let mut share = each[0];
        for (i, importance) in (1..).zip(&each[1..self.lights.len()]) {
            share = F::select(place.eq(F::Index::splat(i)), *importance, share);
        }
        share / sum
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.lights.len() * size_of::<(Bounds<f32>, u32)>() + self.places.len() * size_of::<Record>()
    }
}
