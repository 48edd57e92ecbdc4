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

mod emission;
mod map;
mod progressive;

use super::IntegratorError;
use crate::bsdf::{Event, TransportMode};
use crate::emitter::LightSampling;
use crate::film::{Batch, Film};
use crate::math::{Rgb, offset_from_surface, vec3};
use crate::render::{
    Dimensions, Integrator, Observer, Pass, PathState, Rays, Region, Sample, ShadowRay, TILE, Tiles, in_order,
};
use crate::sampling::Sampler;
use crate::scene::{Scene, is_hit};
use crate::transport::sub_path::{Ending, PER_BOUNCE};
use crate::transport::{Kernel, Nearest, Roulette, SubPath, Vertex, power_heuristic};
use emission::{Emission, Keep, Photon};
use map::{Estimate, PhotonMap};
use rebond_bvh::Ray;
use rebond_lanes::scalar::Index1;
use serde::{Deserialize, Serialize};
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
    /// Photons in an estimate; 0 if only the radius counts.
    pub nearest: u32,
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
    /// How much of the square of the radius an iteration leaves.
    pub alpha: f32,
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
            nearest: 500,
            radius: None,
            gather: 0,
            precompute: false,
            kernel: Kernel::default(),
            progressive: false,
            alpha: 2.0 / 3.0,
            max_depth: None,
            show: false,
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("photons", "photons that leave the lights, in each iteration if progressive; 500000"),
    ("nearest", "photons in an estimate, 0: all within radius; 500"),
    ("radius", "the most that the radius of an estimate may be; progressive: the first radius, 0.3 % of half the scene's diagonal"),
    ("kernel", "how photons count by distance: constant, cone or epanechnikov; constant"),
    ("gather", "directions of the final gather, 0: the map is seen directly; 0"),
    ("caustic_photons", "photons that leave the lights for the gather's map of caustics, 0: none; 200000"),
    ("precompute", "true: the gather looks up irradiance that was computed at every fourth photon; false"),
    ("progressive", "true: each sample has a map of its own, seen with a radius that shrinks; false"),
    ("alpha", "progressive: how slowly the radius shrinks, between 0 and 1; 2/3"),
    ("max_depth", "longest path in segments, which leaves out longer ones; unlimited if not given"),
    ("show", "true: a layer of the photons, each where it is seen; false"),
];

/// Photons of a map of caustics, if nothing else is asked for.
const CAUSTIC_PHOTONS: u32 = 200_000;

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
    ) -> Result<Box<dyn Integrator + 'a>, IntegratorError> {
        let error = |message: String, help: &str| Err(IntegratorError { message, help: help.into() });
        super::check_light_walks(scene)?;
        super::check_radius(self.radius, self.alpha)?;
        if self.progressive {
            let given = [
                (self.gather > 0, "gather"),
                (self.precompute, "precompute"),
                (self.caustic_photons.is_some(), "caustic_photons"),
                (self.show, "show"),
            ];
            if let Some((_, name)) = given.iter().find(|(given, _)| *given) {
                let message = format!("{name} is a matter of one map, and progressive=true has one for every sample");
                return error(message, &format!("leave out {name}, or progressive"));
            }
            return Ok(Box::new(progressive::Progressive::new(self, scene, sampler)));
        }
        if self.nearest == 0 && self.radius.is_none() {
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
            settings: self.clone(),
            max_depth: self.max_depth.map_or(u32::MAX, NonZeroU32::get),
            estimate: Estimate {
                nearest: if self.nearest == 0 { usize::MAX } else { self.nearest as usize },
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
}

/// The estimator at work.
struct PhotonMapping<'a> {
    scene: &'a Scene,
    sampler: Sampler,
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
        let emission = |keep| Emission { scene: self.scene, sampler: self.sampler, max_depth: self.max_depth, keep };
        let photons = self.settings.photons.get();
        let all = PhotonMap::new(emission(Keep::All).emit(photons, 0, None, threads, observer)?, threads);
        let all = if self.settings.precompute { all.precompute(&self.estimate, threads) } else { all };
        let caustics = match self.settings.caustic_photons.unwrap_or(CAUSTIC_PHOTONS) {
            photons if self.settings.gather > 0 && photons > 0 => {
                let emitted = emission(Keep::Caustic).emit(photons, 1, None, threads, observer)?;
                Some(PhotonMap::new(emitted, threads))
            }
            _ => None,
        };
        Some(Maps { all, caustics })
    }

    /// L along a ray of the eye, times what it counts.
    fn radiance(&self, maps: &Maps, s: &Sample, work: &mut Work) -> Rgb<f32> {
        let [x, y, pixel, index] = [s.x, s.y, s.pixel, s.index].map(Index1);
        let eye = PathState::start(self.scene, &work.sampler, x, y, pixel, index, Index1(0));
        let (light, seen) = look(self.scene, &eye, self.max_depth, &mut work.rays);
        let Some((path, vertex)) = seen else { return light };
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
                let u = Dimensions::new(stream, Index1(path.segments - 1), PER_BOUNCE);
                sum += ask_light(self.scene, &path, &vertex, &u, true, &mut work.rays);
                if !first {
                    sum += self.caustics(maps, &path, &vertex, work);
                }
                if !path.scatter(&mut vertex, &u, &ENDING) {
                    break;
                }
                let (light, next) = self.follow(maps, &mut path, &vertex, stream, &mut work.rays);
                sum += light;
                let Some((there, distance)) = next else { break };
                let found =
                    maps.all.reflected(&there, self.max_depth - path.segments, &self.estimate, &mut work.near);
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
            let u = Dimensions::new(stream, Index1(path.segments - 1), PER_BOUNCE);
            rays.add(path.segments, 1);
            let hit = self.scene.intersect(&path.ray, true, false);
            let there = is_hit(&hit).then(|| path.arrive(&hit, &u));
            // Caustics that have a map are not found here.
            if direct {
                light += found_light(self.scene, path, from, there.as_ref());
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
        let photons: Vec<&Photon> = maps.all.stored().chain(maps.caustics.iter().flat_map(PhotonMap::stored)).collect();
        let sum: f64 = photons.iter().map(|p| f64::from(crate::math::luminance(p.power))).sum();
        let scale = (photons.len() as f64 / sum) as f32;
        let camera = self.scene.camera();
        let see = |photon: &Photon| {
            let p = vec3(photon.p[0], photon.p[1], photon.p[2]);
            let sight = camera.see(p, [0.5; 2], camera.time(0.0));
            let at = [sight.raster[0] - region.x as f32, sight.raster[1] - region.y as f32];
            let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] < region.width as f32 && at[1] < region.height as f32;
            if !(inside && sight.importance > 0.0 && sight.w.dot(photon.normal) > 0.0) {
                return None;
            }
            let error = p.max_abs() * crate::emitter::POINT_ERROR * 2.0;
            let o = offset_from_surface(p, error, photon.normal, sight.w);
            let ray = Ray { o: o.array(), d: (sight.lens - o).array(), tmax: 1.0, time: camera.time(0.0) };
            let free = !self.scene.occluded(&ray, true);
            free.then(|| (at[1] as usize * region.width as usize + at[0] as usize, photon.power))
        };
        let job = |n: usize| {
            let part = &photons[n * JOB..photons.len().min((n + 1) * JOB)];
            part.iter().filter_map(|p| see(p)).collect::<Vec<_>>()
        };
        let mut picture = vec![[0.0; 3]; region.pixels() as usize];
        for (pixel, power) in in_order(photons.len().div_ceil(JOB), threads, job).into_iter().flatten() {
            picture[pixel].iter_mut().zip(power).for_each(|(sum, x)| *sum += x * scale);
        }
        picture
    }
}

/// Follows the eye through mirrors and glass: what it meets that shines, and the first vertex that neither is.
fn look<'a>(
    scene: &'a Scene,
    eye: &PathState<f32>,
    max_depth: u32,
    rays: &mut Rays,
) -> (Rgb<f32>, Option<(SubPath<'a>, Vertex<'a>)>) {
    let mut path = SubPath::from_eye(scene, None, eye, 1.0);
    let mut light = Rgb::black();
    loop {
        let u = Dimensions::new(eye.stream(), Index1(path.segments - 1), PER_BOUNCE);
        rays.add(path.segments, 1);
        let hit = scene.intersect(&path.ray, true, true);
        let there = is_hit(&hit).then(|| path.arrive(&hit, &u));
        light += path.throughput() * emitted(scene, &path, there.as_ref());
        let Some(mut vertex) = there.filter(|_| path.segments < max_depth) else { return (light, None) };
        if !vertex.bsdf.is_specular() {
            return (light, Some((path, vertex)));
        }
        if !path.scatter(&mut vertex, &u, &ENDING) {
            return (light, None);
        }
    }
}

/// Le of what a ray met: a surface, or the surroundings.
fn emitted(scene: &Scene, path: &SubPath<'_>, there: Option<&Vertex<'_>>) -> Rgb<f32> {
    there.map_or_else(|| scene.sky(path.direction()), |vertex| scene.emitted(&vertex.surface, true))
}

/// Le of what a ray met that left a vertex, weighed against light that was asked for there, and what it counts.
fn found_light(scene: &Scene, path: &SubPath<'_>, from: &Vertex<'_>, there: Option<&Vertex<'_>>) -> Rgb<f32> {
    let pdf = || from.bsdf.eval(from.surface.wo, path.direction(), TransportMode::Radiance, true).pdf.0;
    let (p, n) = (from.surface.p, from.bsdf.normal());
    let Some(there) = there else {
        let weighed = |(radiance, drawn): (Rgb<f32>, f32)| radiance * power_heuristic(pdf(), drawn);
        let all = scene.surroundings(p, n, path.direction()).map(weighed);
        return path.throughput() * all.fold(Rgb::black(), |sum, light| sum + light);
    };
    let radiance = scene.emitted(&there.surface, true);
    if !radiance.is_lit() {
        return Rgb::black();
    }
    let drawn = scene.light_pdf(p, n, &there.surface, LightSampling::Area, true);
    path.throughput() * radiance * power_heuristic(pdf(), drawn)
}

/// Direct light at a vertex by a point of a light: weighed against directions of the BSDF, or all there is.
fn ask_light(
    scene: &Scene,
    path: &SubPath<'_>,
    vertex: &Vertex<'_>,
    u: &Dimensions<f32>,
    weighed: bool,
    rays: &mut Rays,
) -> Rgb<f32> {
    let (surface, bsdf, time) = (&vertex.surface, &vertex.bsdf, path.ray.time);
    let (choice, point) = (|| u.value(LIGHT_CHOICE), u.pair(LIGHT_POINT));
    let Some(light) = scene.sample_light(surface.p, bsdf.normal(), time, LightSampling::Area, choice, point, true)
    else {
        return Rgb::black();
    };
    let value = bsdf.eval(surface.wo, light.wi, TransportMode::Radiance, true);
    let weight = if weighed && light.pdf.0 > 0.0 { power_heuristic(light.pdf.0, value.pdf.0) } else { 1.0 };
    let contribution = vertex.throughput * value.f * light.weight * (bsdf.normal().dot(light.wi).abs() * weight);
    let Some(shadow) = ShadowRay::new(surface, &light, time, contribution, Index1(Event::Diffuse as u32), true) else {
        return Rgb::black();
    };
    rays.shadow += 1;
    contribution.masked(!scene.occluded(&shadow.ray, true))
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
        let picture = self.settings.show.then(|| self.picture(maps, &pass.region, pass.threads));
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
