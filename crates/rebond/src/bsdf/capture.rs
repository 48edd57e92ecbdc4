//! A virtual gonioreflectometer: tabulates a material as the lecture's table, and says what the table gets wrong.
//!
//! A value of the table is f at its angles, or with samples the mean of f over what it stands for: half a step to either
//! side of each of its angles, even in solid angle. What the table T then gets wrong for a viewer at ωo is
//!
//! ```text
//! even(ωo)  = |∫ (T − f) cosθi dωi| / ∫ f cosθi dωi      under the same radiance from everywhere
//! bound(ωo) = ∫ |T − f| cosθi dωi / ∫ f cosθi dωi        at most, times the largest radiance there is
//! rms²      = ∫∫ (T − f)² cosθi cosθo dωi dωo / ∫∫ f² cosθi cosθo dωi dωo
//! ```
//!
//! estimated with directions drawn by the material, by the table and by cosine, weighed by the balance heuristic (Veach
//! 1997, §9.2.2). In a picture of a convex thing under light of radiance up to L, a pixel is thus off by at most
//! `L bound(ωo)` times the albedo, and under even light by `even(ωo)` of its value.

use super::TransportMode;
use super::check::{Angles, Material, numbers};
use super::measured::{AngleTable, Measured};
use crate::math::Vec3;
use crate::sampling::warp::{cosine_hemisphere, cosine_hemisphere_pdf};
use crate::sampling::{Sampler, SamplerSettings};
use rayon::prelude::*;
use rebond_lanes::scalar::Index1;
use std::f64::consts::{PI, TAU};

/// How to capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Samples along θi, φi, θo and φo. One φi says that the material is isotropic.
    pub size: [u32; 4],
    /// Samples of each value; 0 for f at its very angles.
    pub samples: u32,
    /// Standard deviation of the error that the instrument makes, over the value.
    pub noise: f32,
    /// Of random numbers.
    pub seed: u64,
}

/// What a table gets wrong for one direction of the viewer, over what the material reflects to there.
#[derive(Clone, Copy, Debug)]
pub struct DirectionError {
    /// The viewer.
    pub at: Angles,
    /// Albedo of the material, by channel.
    pub albedo: [f64; 3],
    /// Under even light.
    pub even: f64,
    /// Under any light, at most.
    pub bound: f64,
}

/// What a table gets wrong.
#[derive(Clone, Debug)]
pub struct CaptureError {
    /// Root of the mean square, weighted by both cosines, over that of the material.
    pub rms: f64,
    /// By direction of the viewer, from the normal to the horizon.
    pub directions: Vec<DirectionError>,
}

impl CaptureError {
    /// The mean of an error over the hemisphere, weighted by the cosine.
    pub fn mean(&self, error: impl Fn(&DirectionError) -> f64) -> f64 {
        let weight = |d: &DirectionError| (2.0 * d.at.theta.to_radians()).sin();
        let sum: f64 = self.directions.iter().map(|d| weight(d) * error(d)).sum();
        sum / self.directions.iter().map(weight).sum::<f64>()
    }

    /// The direction with the largest error.
    pub fn largest(&self, error: impl Fn(&DirectionError) -> f64) -> Option<&DirectionError> {
        self.directions.iter().max_by(|a, b| error(a).total_cmp(&error(b)))
    }
}

/// Whether turning both directions about the normal changes nothing, as far as random pairs tell.
pub fn is_isotropic(material: &Material, seed: u64) -> bool {
    numbers(seed, 2000).all(|u| {
        let (a, b) = (cosine_hemisphere(u.pair(0)), cosine_hemisphere(u.pair(1)));
        let (sin, cos) = (u.value(2) * std::f32::consts::TAU).sin_cos();
        let turned = |w: Vec3<f32>| Vec3 { x: w.x * cos - w.y * sin, y: w.x * sin + w.y * cos, z: w.z };
        let f = |a: Vec3<f32>, b: Vec3<f32>| material.eval(a, b, TransportMode::Radiance).0;
        let (here, there) = (f(a, b), f(turned(a), turned(b)));
        here.iter().zip(there).all(|(x, y)| (x - y).abs() <= 1e-3 * (x.max(y) + 0.05))
    })
}

/// Tabulates a material.
///
/// # Errors
/// If the material has no table: it mirrors, or lets light through; or the table would be too large, or f is not finite.
pub fn capture(material: &Material, settings: &CaptureSettings) -> Result<AngleTable, String> {
    if material.is_partly_specular() {
        return Err("the material mirrors: light that leaves in single directions has no values to tabulate".into());
    }
    if material.transmits() {
        return Err("light passes through the material, and the table has room for one side only".into());
    }
    let CaptureSettings { size, samples, noise, seed } = *settings;
    if !(noise >= 0.0 && noise.is_finite()) {
        return Err(format!("a noise of {noise}; it is finite and not negative"));
    }
    let count = AngleTable::count(size)?;
    let [tilts_i, turns_i, tilts_o, turns_o] = size;
    let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
    let value = |i: usize| {
        let i = i as u32;
        let l = i % turns_o;
        let k = i / turns_o % tilts_o;
        let j = i / turns_o / tilts_o % turns_i;
        let of_light =
            Place { tilt: i / turns_o / tilts_o / turns_i, tilts: tilts_i, turn: j, turns: turns_i, everywhere: false };
        let of_viewer = Place { tilt: k, tilts: tilts_o, turn: l, turns: turns_o, everywhere: true };
        let f = |light: Vec3<f32>, viewer: Vec3<f32>| material.eval(viewer, light, TransportMode::Radiance).0;
        let mut mean = if samples == 0 { f(of_light.direction(), of_viewer.direction()) } else { [0.0; 3] };
        let pair =
            |sample: u32, dimension: u32| sampler.stream::<f32>(Index1(i), Index1(sample)).pair(Index1(dimension));
        for s in 0..samples {
            let value = f(of_light.around(pair(s, 0)), of_viewer.around(pair(s, 1)));
            mean.iter_mut().zip(value).for_each(|(sum, x)| *sum += x / samples as f32);
        }
        if noise > 0.0 {
            // Box and Muller 1958.
            let [u, v] = pair(samples, 2);
            let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (std::f32::consts::TAU * v).cos();
            mean = mean.map(|x| (x * (1.0 + noise * normal)).max(0.0));
        }
        mean
    };
    AngleTable::new(size, (0..count).into_par_iter().map(value).collect())
}

/// A direction of the table: the angles of sample `tilt` of `tilts` and `turn` of `turns`.
struct Place {
    tilt: u32,
    tilts: u32,
    turn: u32,
    turns: u32,
    /// Whether a single turn stands for all azimuths, and not for itself.
    everywhere: bool,
}

impl Place {
    fn direction(&self) -> Vec3<f32> {
        let theta = 90.0 * f64::from(self.tilt) / f64::from(self.tilts);
        Angles { theta, phi: 360.0 * f64::from(self.turn) / f64::from(self.turns) }.direction()
    }

    /// One of the directions that the sample stands for.
    fn around(&self, u: [f32; 2]) -> Vec3<f32> {
        let cos = |tilt: f64| (PI / 2.0 * (tilt / f64::from(self.tilts)).clamp(0.0, 1.0)).cos();
        let last = self.tilt + 1 == self.tilts;
        let (from, to) = (cos(f64::from(self.tilt) - 0.5), if last { 0.0 } else { cos(f64::from(self.tilt) + 0.5) });
        let theta = (from + (to - from) * f64::from(u[0])).acos();
        // The one φi of an isotropic material stands for itself.
        let offset = if self.turns == 1 && !self.everywhere { 0.0 } else { f64::from(u[1]) - 0.5 };
        let phi = TAU * (f64::from(self.turn) + offset) / f64::from(self.turns);
        Angles { theta: theta.to_degrees(), phi: phi.to_degrees() }.direction()
    }
}

/// What a table gets wrong about the material that it was captured from, seen from `directions` angles of the viewer.
///
/// # Errors
/// If the table is too large.
pub fn error(material: &Material, table: &AngleTable, directions: u32, seed: u64) -> Result<CaptureError, String> {
    /// Of each way to draw directions.
    const SAMPLES: u32 = 512;
    let captured = Measured::Angles(table.clone()).material()?;
    let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
    let one = |i: u32| {
        let [u, v] = sampler.stream::<f32>(Index1(i), Index1(0)).pair(Index1(0)).map(f64::from);
        let at = Angles { theta: 90.0 * (f64::from(i) + u) / f64::from(directions), phi: 360.0 * v };
        let (a, mode) = (at.direction(), TransportMode::Radiance);
        let (mut albedo, mut signed, mut absolute) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let (mut squares, mut of_material) = (0.0, 0.0);
        for (n, u) in numbers(seed ^ (u64::from(i) << 32), 3 * SAMPLES).enumerate() {
            let b = match n % 3 {
                0 => material.sample(a, u.value(4), u.pair(1), u.value(3), mode).w,
                1 => captured.sample(a, u.value(4), u.pair(1), u.value(3), mode).w,
                _ => cosine_hemisphere(u.pair(1)),
            };
            if b.z <= 0.0 {
                continue;
            }
            let ((f, p), (t, q)) = (material.eval(a, b, mode), captured.eval(a, b, mode));
            // Where a density is said to be 0, its own samples do not count: the others' reach there as well.
            if [p, q, 1.0][n % 3] <= 0.0 {
                continue;
            }
            let density = f64::from(p + q + cosine_hemisphere_pdf(b).0);
            let weight = f64::from(b.z) / density / f64::from(SAMPLES);
            for c in 0..3 {
                let (f, difference) = (f64::from(f[c]), f64::from(t[c]) - f64::from(f[c]));
                albedo[c] += weight * f;
                signed[c] += weight * difference;
                absolute[c] += weight * difference.abs();
                squares += weight * difference * difference;
                of_material += weight * f * f;
            }
        }
        let largest = |x: [f64; 3]| x.into_iter().fold(0.0, |most, x| f64::max(most, x.abs()));
        let over = |x: [f64; 3]| if largest(albedo) > 0.0 { largest(x) / largest(albedo) } else { largest(x) };
        (DirectionError { at, albedo, even: over(signed), bound: over(absolute) }, squares, of_material)
    };
    let all: Vec<(DirectionError, f64, f64)> = (0..directions).into_par_iter().map(one).collect();
    let weighted = |f: fn(&(DirectionError, f64, f64)) -> f64| {
        all.iter().map(|x| f(x) * (2.0 * x.0.at.theta.to_radians()).sin()).sum::<f64>()
    };
    let (squares, of_material) = (weighted(|x| x.1), weighted(|x| x.2));
    let rms = if of_material > 0.0 { (squares / of_material).sqrt() } else { squares.sqrt() };
    Ok(CaptureError { rms, directions: all.into_iter().map(|x| x.0).collect() })
}
