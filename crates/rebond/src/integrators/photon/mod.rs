//! Photon mapping (Jensen 1996). Biased: light is blurred over the radius of its estimates.
//!
//! Particles of light are traced from the lights and stored where they land. What is reflected at a point is estimated from those
//! around it,
//!
//! ```text
//! Lr(x, ωo) ≈ Σ_p f_r(x, ω_p, ωo) ΔΦ_p / ΔA        ΔA = π r²: the disk that holds the k nearest, or one of a given radius
//! ```
//!
//! | setting | the eye sees |
//! |---|---|
//! | `gather=0` | the map itself, by way of mirrors and glass |
//! | `gather=N` | direct light that is sampled, caustics of a map of their own, and the rest by N directions that look at the map from afar |
//! | `progressive=true` | the mean of many maps, each by a smaller radius: without bias in the limit (`progressive.rs`) |
//!
//! A direction of the gather that meets a surface nearer than the radius of the estimate there would show its blur: it is followed
//! for one more bounce. Where the bias comes from, and how it vanishes, is in Jensen 2001, ch. 7. Photons keep no time: those of
//! things that move are blurred over the shutter, unless it is progressive.
//!
//! | counted | |
//! |---|---|
//! | `photons_emitted` | walks from the light |
//! | `photons_stored` | vertices of walks that are in the map |
//! | `photons_lost` | walks that left the scene, whatever they had stored |
//! | `photons_wasted` | walks that stored nothing |

mod emission;
mod map;
mod progressive;

use super::IntegratorError;
use crate::bsdf::{Event, TransportMode};
use crate::emitter::LightSampling;
use crate::film::{Batch, Film};
use crate::math::{Rgb, offset_from_surface, vec3};
use crate::render::{
    Dimensions, Engine, Integrator, Observer, Pass, PathState, Rays, Region, Sample, ShadowRay, TILE, Tiles, in_order,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, PER_BOUNCE};
use crate::transport::{Kernel, Nearest, Roulette, SubPath, Vertex, power_heuristic};
use emission::{Emission, Keep};
use map::{Estimate, PhotonMap, Stored};
use rebond_bvh::{Ray, Trace};
use rebond_lanes::scalar::Index1;
use rebond_lanes::{Index, Mask, Real};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::num::NonZeroU32;
use std::sync::{Mutex, OnceLock};

/// Settings of photon mapping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotonSettings {
    /// Photons that leave the lights; of each iteration, if it is progressive.
    pub photons: NonZeroU32,
    /// Photons that leave the lights for a map of caustics; 200 000 if there is a gather, which else finds them by itself.
    pub caustic_photons: Option<u32>,
    /// Photons in an estimate; 0 if only the radius counts, 500 if not given.
    pub nearest: Option<u32>,
    /// The most that the radius of an estimate may be; of a progressive one, that of its first iteration.
    pub radius: Option<f32>,
    /// Directions of the final gather; none if 0.
    pub gather: u32,
    /// Whether irradiance is computed once, at every fourth photon.
    pub precompute: bool,
    /// How much a photon counts by its distance.
    pub kernel: Kernel,
    /// Whether there are iterations, each with photons of its own and a smaller radius.
    pub progressive: bool,
    /// How much of the square of the radius an iteration leaves; 2/3 if not given.
    pub alpha: Option<f32>,
    /// Longest path in segments: 1 is emitted light only, 2 direct light too. Unlimited if not given.
    pub max_depth: Option<NonZeroU32>,
    /// Whether a layer shows the stored photons.
    pub show: bool,
}

impl Default for PhotonSettings {
    fn default() -> Self {
        Self {
            photons: NonZeroU32::new(500_000).expect("not 0"),
            caustic_photons: None,
            nearest: None,
            radius: None,
            gather: 0,
            precompute: false,
            kernel: Kernel::default(),
            progressive: false,
            alpha: None,
            max_depth: None,
            show: false,
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("photons", "photons that leave the lights, in each iteration if progressive; 500000"),
    ("nearest", "photons in an estimate, 0: all within radius; 500"),
    (
        "radius",
        "the most that the radius of an estimate may be; progressive: the first radius, 0.3 % of half the diagonal of what is seen",
    ),
    ("kernel", "how photons count by distance: constant, cone or epanechnikov; constant"),
    ("gather", "directions of the final gather, 0: the map is seen directly; 0"),
    ("caustic_photons", "photons that leave the lights for the gather's map of caustics, 0: none; 200000"),
    ("precompute", "true: the gather looks up irradiance that was computed at every fourth photon; false"),
    ("progressive", "true: each sample has a map of its own, seen with a radius that shrinks; false"),
    ("alpha", "progressive: how slowly the radius shrinks, between 0 and 1; 2/3"),
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("show", "true: a layer of the photons, each where it is seen as the shutter opens; false"),
];

/// What there is if nothing else is asked for: photons of a map of caustics, and of an estimate, and how slowly its radius shrinks.
const CAUSTIC_PHOTONS: u32 = 200_000;
const NEAREST: u32 = 500;
const ALPHA: f32 = 2.0 / 3.0;

impl PhotonSettings {
    pub(super) fn leaves_out(&self) -> String {
        let blurred = match self.progressive {
            true => "light is blurred by a radius that shrinks with every sample",
            false => "light is blurred over the photons of an estimate",
        };
        match self.max_depth {
            Some(d) => format!("paths of more than max_depth={d} segments are left out, and {blurred}"),
            None => blurred.into(),
        }
    }

    pub(super) fn layers(&self) -> Vec<String> {
        if self.show { vec!["photons".into()] } else { Vec::new() }
    }

    /// The integrator.
    pub(super) fn integrator<'a>(
        &self,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
    ) -> Result<Box<dyn Integrator + 'a>, IntegratorError> {
        let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
        super::check_radius(self.radius, self.alpha.unwrap_or(ALPHA))?;
        if self.progressive {
            let given = [
                (self.nearest.is_some(), "nearest"),
                (self.gather > 0, "gather"),
                (self.precompute, "precompute"),
                (self.caustic_photons.is_some(), "caustic_photons"),
                (self.show, "show"),
            ];
            if let Some((_, name)) = given.iter().find(|(given, _)| *given) {
                let message = format!("{name} is a matter of one map, and progressive=true has one for every sample");
                return error(message, &format!("leave out {name}, or progressive"));
            }
            return Ok(Box::new(progressive::Progressive::new(self, scene, sampler, engine)));
        }
        if self.alpha.is_some() {
            let message = "alpha says how a radius shrinks from map to map, and there is one map".to_owned();
            return error(message, "add progressive=true, or leave out alpha");
        }
        let nearest = self.nearest.unwrap_or(NEAREST);
        if nearest == 1 {
            let message = "nearest = 1 leaves nothing: the last of an estimate only says how wide it is".to_owned();
            return error(message, "give nearest=N of at least 2, or 0 and a radius");
        }
        if nearest == 0 && self.radius.is_none() {
            let message = "without a number of nearest photons an estimate has no end".to_owned();
            return error(message, "give radius=R, in the units of the scene, or nearest=N");
        }
        if self.gather == 0 && (self.precompute || self.caustic_photons.is_some()) {
            let name = if self.precompute { "precompute" } else { "caustic_photons" };
            return error(format!("{name} is for a final gather"), "add gather=N, such as 64");
        }
        if self.precompute && self.max_depth.is_some() {
            let message = "irradiance that is computed once holds paths of every length".to_owned();
            return error(message, "leave out max_depth, or precompute");
        }
        Ok(Box::new(PhotonMapping {
            scene,
            sampler,
            engine,
            settings: self.clone(),
            max_depth: self.max_depth.map_or(u32::MAX, NonZeroU32::get),
            estimate: Estimate {
                nearest: if nearest == 0 { usize::MAX } else { nearest as usize },
                most: self.radius.map_or(f32::INFINITY, |r| r * r),
                kernel: self.kernel,
            },
            maps: OnceLock::new(),
        }))
    }
}

/// How the eye's walks end in mirrors and glass, and those of the gather near surfaces.
const ENDING: Ending = Ending { roulette: Roulette::Throughput, survival: 0.95, rr_depth: 5 };

/// Dimensions of the sample values that a bounce uses for its light.
const LIGHT_CHOICE: u32 = 0;
const LIGHT_POINT: u32 = 1;

/// The maps of a render, filled when its first samples are asked for.
struct Maps {
    all: PhotonMap,
    caustics: Option<PhotonMap>,
    /// What the eye sees of them, if that was asked for, in which region.
    picture: OnceLock<(Region, Vec<[f32; 3]>)>,
}

/// The estimator at work.
struct PhotonMapping<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    /// Of the photons; the eye's walks go one by one.
    engine: Engine,
    settings: PhotonSettings,
    max_depth: u32,
    estimate: Estimate,
    maps: OnceLock<Maps>,
}

/// What a worker keeps from sample to sample.
struct Work {
    sampler: Sampler,
    near: Nearest,
    rays: Rays,
}

impl<'a> PhotonMapping<'a> {
    /// Fills the maps; `None` if it was told to stop.
    fn fill(&self, threads: usize, observer: &dyn Observer) -> Option<Maps> {
        let (scene, sampler, engine, max_depth) = (self.scene, self.sampler, self.engine, self.max_depth);
        let emission = |keep| Emission { scene, sampler, engine, max_depth, keep };
        let photons = self.settings.photons.get();
        let all = PhotonMap::new(emission(Keep::All).emit(photons, 0, None, threads, observer)?, threads);
        let all = if self.settings.precompute { all.precompute(&self.estimate, threads, observer)? } else { all };
        let caustics = match self.settings.caustic_photons.unwrap_or(CAUSTIC_PHOTONS) {
            photons if self.settings.gather > 0 && photons > 0 => {
                let emitted = emission(Keep::Caustic).emit(photons, 1, None, threads, observer)?;
                Some(PhotonMap::new(emitted, threads))
            }
            _ => None,
        };
        Some(Maps { all, caustics, picture: OnceLock::new() })
    }

    /// L along a ray of the eye, times what it counts.
    fn radiance(&self, maps: &Maps, s: &Sample, work: &mut Work) -> Rgb<f32> {
        let [x, y, pixel, index] = [s.x, s.y, s.pixel, s.index].map(Index1);
        let eye = PathState::start(self.scene, &work.sampler, x, y, pixel, index, Index1(0));
        let (mut landed, mut rays) = (None, std::mem::take(&mut work.rays));
        let light = look(self.scene, &eye, true, self.max_depth, &mut rays, |path, vertex, _| {
            landed = Some((*path, *vertex));
            Rgb::black()
        });
        work.rays = rays;
        let Some((path, vertex)) = landed else { return light };
        if self.settings.gather > 0 {
            return light + self.gather(maps, &path, &vertex, s, work);
        }
        let found = maps.all.reflected(&vertex, self.max_depth - path.segments, &self.estimate, &mut work.near);
        light + vertex.throughput * found.light
    }

    /// What caustics there are at a vertex, if they have a map.
    fn caustics(&self, maps: &Maps, path: &SubPath<'a>, vertex: &Vertex<'a>, work: &mut Work) -> Rgb<f32> {
        let Some(map) = &maps.caustics else { return Rgb::black() };
        let found = map.reflected(vertex, self.max_depth - path.segments, &self.estimate, &mut work.near);
        vertex.throughput * found.light
    }

    /// What a vertex reflects: direct light, caustics, and the map as N directions see it.
    fn gather(&self, maps: &Maps, start: &SubPath<'a>, at: &Vertex<'a>, s: &Sample, work: &mut Work) -> Rgb<f32> {
        let mut sum = Rgb::black();
        let n = self.settings.gather;
        for i in 0..n {
            // The directions of a pixel are one sequence, so that they are spread well.
            let index = s.index.wrapping_mul(n).wrapping_add(i);
            let stream = work.sampler.stream(Index1(s.pixel), Index1(index));
            let (mut path, mut vertex, mut first) = (*start, *at, true);
            loop {
                let u = Dimensions::new(stream, Index1(path.segments - 1), PER_BOUNCE).apart();
                sum += ask_light(self.scene, &path, &vertex, &u, true, true, &mut work.rays);
                if !first {
                    sum += self.caustics(maps, &path, &vertex, work);
                }
                if !path.scatter(&mut vertex, &u, &ENDING) {
                    break;
                }
                let (light, next) = self.follow(maps, &mut path, &vertex, stream, &mut work.rays);
                sum += light;
                let Some((there, distance)) = next else { break };
                let found = maps.all.reflected(&there, self.max_depth - path.segments, &self.estimate, &mut work.near);
                if distance * distance >= found.squared_radius {
                    sum += there.throughput * found.light;
                    break;
                }
                (vertex, first) = (there, false);
            }
        }
        sum * (1.0 / n as f32) + self.caustics(maps, start, at, work)
    }

    /// A direction of the gather: the lights that it meets, and the first vertex, not counting mirrors and glass, with its
    /// distance.
    fn follow(
        &self,
        maps: &Maps,
        path: &mut SubPath<'a>,
        from: &Vertex<'a>,
        stream: crate::sampling::Stream<f32>,
        rays: &mut Rays,
    ) -> (Rgb<f32>, Option<(Vertex<'a>, f32)>) {
        let (mut light, mut distance, mut direct) = (Rgb::black(), 0.0, true);
        loop {
            let u = Dimensions::new(stream, Index1(path.segments - 1), PER_BOUNCE).apart();
            rays.add(path.segments, 1);
            let hit = self.scene.intersect(&path.ray, true, false);
            let found = is_hit(&hit);
            let there = found.then(|| path.arrive(&hit, &u, true));
            // Caustics that have a map are not found here.
            if direct {
                light += found_light(self.scene, path, from, there.as_ref(), true);
            } else if maps.caustics.is_none() {
                light += path.throughput() * emitted(self.scene, path, there.as_ref());
            }
            let Some(mut vertex) = there else { return (light, None) };
            distance += hit.t;
            if path.segments >= self.max_depth {
                return (light, None);
            }
            if !vertex.bsdf.is_specular() {
                return (light, Some((vertex, distance)));
            }
            direct = false;
            if !path.scatter(&mut vertex, &u, &ENDING) {
                return (light, None);
            }
        }
    }

    /// The photons that the eye sees, in units of their mean power, pixel by pixel of a region.
    fn picture(&self, maps: &Maps, region: &Region, threads: usize) -> Vec<[f32; 3]> {
        const JOB: usize = 4096;
        let photons: Vec<&Stored> = maps.all.stored().chain(maps.caustics.iter().flat_map(PhotonMap::stored)).collect();
        let sum: f64 = photons.iter().map(|(p, _)| f64::from(crate::math::luminance(p.power))).sum();
        let scale = (photons.len() as f64 / sum) as f32;
        let camera = self.scene.camera();
        let see = |(photon, normal): &Stored| {
            let p = vec3(photon.p[0], photon.p[1], photon.p[2]);
            let sight = camera.see(p, [0.5; 2], camera.time(0.0));
            let at = [sight.raster[0] - region.x as f32, sight.raster[1] - region.y as f32];
            let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] < region.width as f32 && at[1] < region.height as f32;
            if !(inside && sight.importance > 0.0 && sight.w.dot(*normal) > 0.0) {
                return None;
            }
            let time = camera.time(0.0);
            let free = if self.scene.hides_emitters() {
                // Nor does the eye see those that lie on lights: what it meets must be here.
                let ray = Ray { o: sight.end.array(), d: (p - sight.end).array(), tmax: 1.001, time };
                let hit = self.scene.see(&ray, true);
                is_hit(&hit) && hit.t > 0.999
            } else {
                let error = p.max_abs() * crate::emitter::POINT_ERROR * 2.0;
                let o = offset_from_surface(p, error, *normal, sight.w);
                !self.scene.occluded(&Ray { o: o.array(), d: (sight.end - o).array(), tmax: 1.0, time }, true)
            };
            free.then(|| (at[1] as usize * region.width as usize + at[0] as usize, photon.power))
        };
        let job = |n: usize| {
            let part = &photons[n * JOB..photons.len().min((n + 1) * JOB)];
            part.iter().copied().filter_map(see).collect::<Vec<_>>()
        };
        let mut picture = vec![[0.0; 3]; region.pixels() as usize];
        for (pixel, power) in in_order(photons.len().div_ceil(JOB), threads, job).into_iter().flatten() {
            picture[pixel].iter_mut().zip(power).for_each(|(sum, x)| *sum += x * scale);
        }
        picture
    }
}

/// Follows the eye through mirrors and glass: what it meets that shines, and what `land` says of the vertices that are neither, for
/// the lanes whose first they are.
#[inline(always)]
fn look<'a, F: Trace>(
    scene: &'a Scene,
    eye: &PathState<F>,
    mask: F::Mask,
    max_depth: u32,
    rays: &mut Rays,
    mut land: impl FnMut(&SubPath<'a, F>, &Vertex<'a, F>, &mut Rays) -> Rgb<F>,
) -> Rgb<F> {
    let mut path = SubPath::from_eye(scene, None, eye, 1.0);
    let (mut light, mut alive) = (Rgb::black(), mask);
    while alive.any() {
        let u = Dimensions::new(eye.stream(), F::Index::splat(path.segments - 1), PER_BOUNCE);
        rays.add(path.segments, alive.count());
        let hit = scene.meet(&path.ray, alive, path.segments == 1);
        let found = alive & is_hit(&hit);
        let escaped = alive.and_not(found);
        if escaped.any() && !(scene.hides_emitters() && path.segments == 1) {
            light += (path.throughput() * emitted(scene, &path, None)).masked(escaped);
        }
        if found.none() {
            break;
        }
        let mut vertex = path.arrive(&hit, &u, found);
        light += (path.throughput() * emitted(scene, &path, Some(&vertex))).masked(found);
        if path.segments >= max_depth {
            break;
        }
        let specular = found & vertex.bsdf.is_specular();
        vertex.mask = found.and_not(specular);
        if vertex.mask.any() {
            light += land(&path, &vertex, rays).masked(vertex.mask);
        }
        vertex.mask = specular;
        if specular.none() {
            break;
        }
        alive = path.scatter(&mut vertex, &u, &ENDING);
    }
    light
}

/// Le of what rays met: surfaces, or the surroundings. Lanes that met none have any number.
fn emitted<F: Real>(scene: &Scene, path: &SubPath<'_, F>, there: Option<&Vertex<'_, F>>) -> Rgb<F> {
    there.map_or_else(|| scene.sky(path.direction()), |vertex| scene.emitted(&vertex.surface, vertex.mask))
}

/// Le of what rays met that left vertices, weighed against light that was asked for there, and what it counts.
fn found_light<F: Real>(
    scene: &Scene,
    path: &SubPath<'_, F>,
    from: &Vertex<'_, F>,
    there: Option<&Vertex<'_, F>>,
    mask: F::Mask,
) -> Rgb<F> {
    let pdf = from.eval(path.direction(), TransportMode::Radiance, mask).pdf.0;
    let (p, n) = (from.surface.p, from.bsdf.receiving_normal());
    let light = match there {
        None => {
            let all = scene.surroundings(p, n, path.direction());
            all.fold(Rgb::black(), |sum, (radiance, drawn)| sum + radiance * power_heuristic(pdf, drawn))
        }
        Some(there) => {
            let radiance = scene.emitted(&there.surface, mask).masked(mask);
            let lit = mask & radiance.is_lit();
            if lit.none() {
                return Rgb::black();
            }
            let drawn = scene.light_pdf(p, n, &there.surface.seen_from(p), LightSampling::Area, lit);
            (radiance * power_heuristic(pdf, drawn)).masked(lit)
        }
    };
    (path.throughput() * light).masked(mask)
}

/// Direct light at vertices by a point of a light: weighed against directions of the BSDF in the lanes of `weighed`, else all there
/// is.
fn ask_light<F: Trace>(
    scene: &Scene,
    path: &SubPath<'_, F>,
    vertex: &Vertex<'_, F>,
    u: &Dimensions<F>,
    weighed: F::Mask,
    mask: F::Mask,
    rays: &mut Rays,
) -> Rgb<F> {
    let (surface, bsdf, time) = (&vertex.surface, &vertex.bsdf, path.ray.time);
    let (choice, point, n) = (|| u.value(LIGHT_CHOICE), u.pair(LIGHT_POINT), bsdf.receiving_normal());
    let Some(light) = scene.sample_light(surface.p, n, time, LightSampling::Area, choice, point, mask) else {
        return Rgb::black();
    };
    let value = vertex.eval(light.wi, TransportMode::Radiance, mask);
    let by_both = weighed & light.pdf.0.gt(F::zero());
    let weight = F::select(by_both, power_heuristic(light.pdf.0, value.pdf.0), F::one());
    let contribution = vertex.throughput * value.f * light.weight * (bsdf.normal().dot(light.wi).abs() * weight);
    let event = F::Index::splat(Event::Diffuse as u32);
    let Some(shadow) = ShadowRay::new(surface, &light, time, contribution, event, mask) else {
        return Rgb::black();
    };
    rays.shadow += u64::from(shadow.mask.count());
    contribution.masked(shadow.mask.and_not(scene.occluded(&shadow.ray, shadow.mask)))
}

impl Integrator for PhotonMapping<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let mut all = Rays::default();
        if self.maps.get().is_none() {
            let Some(maps) = self.fill(pass.threads, observer) else { return all };
            all.merge(&maps.all.rays);
            maps.caustics.iter().for_each(|map| all.merge(&map.rays));
            // Whoever came first filled them with the same.
            let _ = self.maps.set(maps);
        }
        let Some(maps) = self.maps.get() else { return all };
        let picture = self.settings.show.then(|| {
            let draw = || self.picture(maps, &pass.region, pass.threads);
            let (region, picture) = maps.picture.get_or_init(|| (pass.region, draw()));
            if *region == pass.region { Cow::Borrowed(&picture[..]) } else { Cow::Owned(draw()) }
        });
        all.merge(&Tiles::new(film, pass, observer).run(|tiles| {
            let mut work =
                Work { sampler: tiles.sampler(&self.sampler), near: Nearest::default(), rays: Rays::default() };
            while let Some(tile) = tiles.next() {
                let mut pixels = vec![[Batch::default(); TILE]; 1 + usize::from(picture.is_some())];
                for s in tiles.samples_from(&tile, 0) {
                    let light = self.radiance(maps, &s, &mut work);
                    pixels[0][s.slot as usize].add(light.lane(0), tile.weight);
                    if let Some(picture) = &picture {
                        let at = (s.y - pass.region.y) * pass.region.width + s.x - pass.region.x;
                        pixels[1][s.slot as usize].add(picture[at as usize], tile.weight);
                    }
                }
                tiles.done(&tile, &pixels, &mut work.rays);
            }
        }));
        all
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        let Some(maps) = self.maps.get() else { return Vec::new() };
        let mut counts = maps.all.counts.named().to_vec();
        if let Some(map) = &maps.caustics {
            let names = ["caustic_photons_emitted", "caustic_photons_stored"];
            counts.extend(names.into_iter().zip([map.counts.emitted, map.counts.stored]));
        }
        counts
    }
}
