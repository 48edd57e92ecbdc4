//! What the camera's rays meet first: how far it is, where, which way it faces. Of itself, or in layers beside another picture.
//!
//! ```text
//! I_j ≈ 1/N Σ a(x_1(X_i))        X_i camera rays of pixel j, drawn by its filter; a = 0 where they meet nothing
//! ```
//!
//! Unbiased, but no light. The rays are those of path tracing's samples. A picture that layers stand beside hangs on nothing of
//! them; they cost a camera ray more for each of its samples. Lights are shown even where they are hidden from the eye.

use crate::film::{Aov, Batch, Film};
use crate::math::{Rgb, Vec3};
use crate::render::{Engine, Integrator, Observer, Pass, PathState, Rays, Samples, Story, TILE, Tiles};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use rebond_bvh::Trace;
use rebond_lanes::{F32x16, Index, Mask};
use serde::{Deserialize, Serialize};
use std::sync::Mutex;

/// Settings of what is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AovSettings {
    /// What.
    pub show: Aov,
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[(
    "show",
    "depth, position, uv, geo-normal, sh-normal, albedo, prim-index or shape-index of what camera rays meet; depth",
)];

/// What looks.
struct Look<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    shown: Vec<Aov>,
}

impl Look<'_> {
    fn trace<F: Trace>(&self, samples: &Samples<F>, sampler: &Sampler, rays: &mut Rays) -> Vec<Rgb<F>> {
        let Samples { x, y, pixel, index, slot, mask } = *samples;
        let path = PathState::start(self.scene, sampler, x, y, pixel, index, slot);
        rays.add(1, mask.count());
        let hit = self.scene.intersect(&path.ray(), mask, true);
        let found = mask & is_hit(&hit);
        if found.none() {
            return vec![Rgb::black(); self.shown.len()];
        }
        let surface = self.scene.surface(&path.ray(), &hit, found);
        let of = |v: Vec3<F>| Rgb::new(v.x, v.y, v.z);
        let number = |f: &dyn Fn(usize) -> u32| {
            let mut number = F::zero();
            (0..F::LANES)
                .filter(|l| found.bits() >> l & 1 == 1)
                .for_each(|l| number = number.with_lane(l, f(l) as f32));
            Rgb::grey(number)
        };
        let value = |aov: &Aov| match aov {
            Aov::Depth => Rgb::grey(hit.t),
            Aov::Position => of(surface.p),
            Aov::Uv => Rgb::new(surface.uv[0], surface.uv[1], F::zero()),
            Aov::GeoNormal => of(surface.ng),
            Aov::ShNormal => of(surface.frame.n),
            Aov::Albedo => {
                let mut albedo: Rgb<F> = Rgb::black();
                for l in (0..F::LANES).filter(|l| found.bits() >> l & 1 == 1) {
                    let (material, behind) = (surface.material.lane(l), surface.front().bits() >> l & 1 == 0);
                    let [r, g, b] = self.scene.albedo(material, surface.uv.map(|x| x.lane(l)), behind);
                    albedo.r = albedo.r.with_lane(l, r);
                    albedo.g = albedo.g.with_lane(l, g);
                    albedo.b = albedo.b.with_lane(l, b);
                }
                albedo
            }
            Aov::PrimIndex => number(&|l| self.scene.numbers(surface.primitive.lane(l))[1]),
            Aov::ShapeIndex => number(&|l| self.scene.numbers(surface.primitive.lane(l))[0]),
        };
        // What a sample counts may be negative, by its filter.
        self.shown.iter().map(|aov| (path.throughput() * value(aov)).masked(found)).collect()
    }

    /// Does the tiles: their sums are the picture's, or those of a film's layers from the one of this number on.
    fn run<F: Trace>(&self, tiles: &Tiles<'_>, layer: Option<usize>) {
        let sampler = tiles.sampler(&self.sampler);
        let mut rays = Rays::default();
        while let Some(tile) = tiles.next() {
            let mut pixels = vec![[Batch::default(); TILE]; self.shown.len()];
            for samples in tiles.lanes_of::<F>(&tile) {
                for (batches, value) in pixels.iter_mut().zip(self.trace(&samples, &sampler, &mut rays)) {
                    for lane in 0..samples.mask.count() as usize {
                        batches[samples.slot.lane(lane) as usize].add(value.lane(lane), tile.weight);
                    }
                }
            }
            match layer {
                None => tiles.done(&tile, &pixels, &mut rays),
                Some(first) => tiles.beside(&tile, first, &pixels, &mut rays),
            }
        }
    }

    fn look(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer, layer: Option<usize>) -> Rays {
        Tiles::new(film, pass, observer).run(|tiles| match self.engine {
            Engine::Wavefront => self.run::<F32x16>(tiles, layer),
            Engine::Scalar => self.run::<f32>(tiles, layer),
        })
    }
}

/// One of them as the picture.
struct Shown<'a>(Look<'a>);

impl Integrator for Shown<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        self.0.look(film, pass, observer, None)
    }
}

/// Some of them in layers beside a picture.
struct Beside<'a> {
    picture: Box<dyn Integrator + 'a>,
    look: Look<'a>,
}

/// Samples of the picture between those of the layers.
const TURN: u32 = 16;

/// Lets nobody know of samples, which are those of the picture.
struct Silent<'a>(&'a dyn Observer);

impl Observer for Silent<'_> {
    fn should_stop(&self) -> bool {
        self.0.should_stop()
    }
}

impl Integrator for Beside<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        // They are the film's last layers, if it has them.
        let first = {
            let film = film.lock().unwrap_or_else(|e| e.into_inner());
            let first = film.layers().len().checked_sub(self.look.shown.len());
            let names = |first: &usize| film.layers()[*first..].iter().map(|(name, _)| &**name);
            first.filter(|first| names(first).eq(self.look.shown.iter().map(|aov| aov.name())))
        };
        // In turns, so that whatever ends early has both. An adaptive pass is one whole.
        let (mut rays, mut at, end) = (Rays::default(), pass.samples.start, pass.samples.end);
        let most = if first.is_some() && pass.shares.is_none() { TURN } else { u32::MAX };
        while at < end && !observer.should_stop() {
            let part = Pass { samples: at..end.min(at.saturating_add(most)), ..pass.clone() };
            at = part.samples.end;
            if first.is_some() {
                rays.merge(&self.look.look(film, &part, &Silent(observer), first));
            }
            rays.merge(&self.picture.add_samples(film, &part, observer));
        }
        rays
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.picture.counts()
    }

    fn tell(&self, pixel: [u32; 2], full_width: u32, sample: u32) -> Option<Story> {
        self.picture.tell(pixel, full_width, sample)
    }
}

impl AovSettings {
    pub(super) fn integrator(self, scene: &Scene, sampler: Sampler, engine: Engine) -> Box<dyn Integrator + '_> {
        Box::new(Shown(Look { scene, sampler, engine, shown: vec![self.show] }))
    }
}

/// The same picture, with the layers that the scene's film asks for.
pub(super) fn beside<'a>(
    picture: Box<dyn Integrator + 'a>,
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
) -> Box<dyn Integrator + 'a> {
    let shown = scene.aovs().to_vec();
    if shown.is_empty() {
        return picture;
    }
    Box::new(Beside { picture, look: Look { scene, sampler, engine, shown } })
}
