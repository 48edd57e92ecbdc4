//! Radiosity (Goral, Torrance, Greenberg, Battaile 1984): all surfaces diffuse, cut into N patches of one radiance each.
//!
//! ```text
//! L_i = S_i + Σ_j T_ij L_j,    T_ij = ρ_i F_ij ≈ ρ_i V cosθ_i cosθ_j A_j / (π d²)
//! L   = (I − T)⁻¹ S
//! ```
//!
//! S is what patches emit, and what they reflect of lights that are no patches, which rays find. The solution lives on the
//! surfaces: any camera may look at it, and where the inverse is there other lights cost one product. Biased: light is
//! constant over a patch, smoothed between the corners for the eye.
//!
//! | file | |
//! |---|---|
//! | [`patches`] | the mesh |
//! | [`form_factors`] | F |
//! | [`solvers`] | L |
//! | [`solution`] | what comes out |
//! | `view` | what a camera sees of it |
//!
//! With `gather=N` each camera hit collects light over N directions from the solution, and one point of one light itself: shadows are
//! then as fine as pixels, and only what is reflected at least twice comes from patches.

pub mod form_factors;
pub mod patches;
pub mod solution;
pub mod solvers;
mod view;

pub use solution::{Parts, Solution};

use super::IntegratorError;
use crate::emitter::LightSampling;
use crate::film::Film;
use crate::math::{Vec3, offset_from_surface};
use crate::render::{Engine, Integrator, Observer, Pass, Rays};
use crate::sampling::{Sampler, SamplerSettings};
use crate::scene::{Face, Scene};
use form_factors::{Closure, FormFactors, Kind, Symmetric};
use glam::DVec3;
use patches::{NONE, Patches};
use rayon::prelude::*;
use rebond_bvh::Ray;
use rebond_lanes::{F32x16, Index, Index16, Mask, Mask16, Real, scalar::Index1};
use serde::{Deserialize, Serialize};
use solution::{channels, colors};
use solvers::hierarchical::Unsolved;
use solvers::inverse::Inverse;
use solvers::progressive::{ENOUGH, Shooting};
use solvers::{Channels, MOST_ITERATIONS, Problem, hierarchical, inverse, iterative, residual};
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex};
use std::time::Instant;
use view::{Shown, View};

/// How the equation is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// By the inverse, which serves for other lights too.
    Inverse,
    /// By Jacobi's iteration.
    Jacobi,
    /// By Gauss and Seidel's iteration.
    #[default]
    GaussSeidel,
    /// By shooting, brightest patch first.
    Progressive,
    /// By links between parts as large as an error allows.
    Hierarchical,
}

impl Solver {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Inverse, Self::Jacobi, Self::GaussSeidel, Self::Progressive, Self::Hierarchical];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inverse => "inverse",
            Self::Jacobi => "jacobi",
            Self::GaussSeidel => "gauss-seidel",
            Self::Progressive => "progressive",
            Self::Hierarchical => "hierarchical",
        }
    }

    /// Bytes that N patches need at least.
    pub fn bytes(self, n: usize, threads: usize) -> u64 {
        let all = n as u64 * BYTES_OF_A_PATCH;
        all + match self {
            Self::Inverse => inverse::bytes_of(n, threads),
            Self::Jacobi | Self::GaussSeidel => Symmetric::bytes_of(n),
            Self::Progressive => 0,
            Self::Hierarchical => n as u64 * (hierarchical::PATCH_BYTES + USUAL_LINKS * hierarchical::LINK_BYTES),
        }
    }
}

/// Bytes of the mesh and of light, for each patch.
const BYTES_OF_A_PATCH: u64 = 1000;
/// Links of a patch that are reckoned with before there are any.
const USUAL_LINKS: u64 = 50;

/// Settings of radiosity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RadiositySettings {
    /// Patches to cut surfaces into, at least.
    pub patches: NonZeroU32,
    /// How the equation is solved.
    pub solver: Solver,
    /// Whether light is interpolated between the corners of patches.
    pub smooth: bool,
    /// Directions of a final gather at each camera hit; none if 0.
    pub gather: u32,
    /// Rays between two patches: 1, 4, 16 or 64; four times as many, up to 64, if one of them shines.
    pub rays: u32,
    /// Whether half of the patches are spent where the solution of fewer varies most.
    pub adaptive: bool,
    /// The largest error of a link of the hierarchical solver, over what the sources send.
    pub error: f32,
    /// Whether materials that are not diffuse count as their diffuse part.
    pub diffuse_only: bool,
    /// Memory it may take, in GB.
    pub memory: f32,
    /// File of a solution, in place of solving.
    pub solution: Option<String>,
    /// What was in that file.
    #[serde(skip)]
    pub loaded: Option<Arc<Solution>>,
}

impl Default for RadiositySettings {
    fn default() -> Self {
        Self {
            patches: NonZeroU32::new(5000).expect("5000 is not 0"),
            solver: Solver::default(),
            smooth: true,
            gather: 0,
            rays: 4,
            adaptive: false,
            error: 1e-6,
            diffuse_only: false,
            memory: 8.0,
            solution: None,
            loaded: None,
        }
    }
}

/// The settings, for lists.
pub(super) const SETTINGS: &[(&str, &str)] = &[
    ("patches", "patches to cut surfaces into, at least; 5000"),
    ("solver", "inverse, jacobi, gauss-seidel, progressive or hierarchical; gauss-seidel"),
    ("smooth", "whether light is interpolated between the corners of patches; true"),
    ("gather", "directions of a final gather at each camera hit; 0, for none"),
    ("rays", "rays between two patches: 1, 4, 16 or 64, four times as many at a light; 4"),
    ("adaptive", "whether half of the patches go where light varies most; false"),
    ("error", "largest error of a link of the hierarchical solver, over what the sources send; 1e-6"),
    ("diffuse_only", "whether materials that are not diffuse count as their diffuse part; false"),
    ("memory", "GB that it may take; 8"),
    ("solution", "file of `rebond radiosity`, in place of solving"),
];

/// What a solution took.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Sides of triangles that the patches were cut from.
    pub faces: u64,
    /// Patches.
    pub patches: u64,
    /// Seconds for the mesh.
    pub mesh_seconds: f64,
    /// Seconds for light of what is no patch.
    pub external_seconds: f64,
    /// Seconds for form factors, or links.
    pub form_factor_seconds: f64,
    /// Seconds for the inverse.
    pub inverse_seconds: f64,
    /// Seconds to solve.
    pub solve_seconds: f64,
    /// Sums of the rows of F, where all of them are known.
    pub closure: Option<Closure>,
    /// Rounds of an iteration, or patches that were shot.
    pub iterations: u64,
    /// Links of the hierarchical solver.
    pub links: u64,
    /// Rays traced.
    pub rays: u64,
    /// Bytes of what the solver stores.
    pub bytes: u64,
    /// What was not diffuse and counts as its diffuse part.
    pub dropped: Vec<String>,
    /// The residual of the equation, Σ A |S + T L − L| over Σ A S, where the solver could not bring it down.
    pub residual: Option<f64>,
}

/// The residual that an inverse may have.
const LARGEST_RESIDUAL: f64 = 1e-3;

/// What is to be said of a solution with a residual.
fn unconverged(residual: f64) -> String {
    format!("the solution of radiosity has not converged: its residual is {residual:.1e} of what the sources send")
}

impl Report {
    /// What is wrong with the solution, in words.
    pub fn warning(&self) -> Option<String> {
        self.residual.map(unconverged)
    }
}

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unsolvable {
    /// Settings that do not go together, or not with the scene.
    Settings(IntegratorError),
    /// Told to stop.
    Stopped,
}

impl From<IntegratorError> for Unsolvable {
    fn from(e: IntegratorError) -> Self {
        Self::Settings(e)
    }
}

fn error(message: String, help: &str) -> IntegratorError {
    IntegratorError { message, help: help.into() }
}

/// The seed that a sampler's values stand for.
fn seed_of(sampler: &Sampler) -> u32 {
    sampler.stream::<f32>(Index1(0), Index1(0)).value(Index1(0)).to_bits()
}

fn gigabytes(bytes: u64) -> String {
    let gb = bytes as f64 / 1e9;
    if gb < 0.1 { format!("{:.0} MB", gb * 1e3) } else { format!("{gb:.1} GB") }
}

impl RadiositySettings {
    fn memory_bytes(&self) -> u64 {
        (f64::from(self.memory) * 1e9) as u64
    }

    fn check(&self) -> Result<(), IntegratorError> {
        if ![1, 4, 16, 64].contains(&self.rays) {
            return Err(error(
                format!("rays = {}", self.rays),
                "give 1, 4, 16 or 64: they share parts of patches evenly",
            ));
        }
        if !(self.error > 0.0 && self.error.is_finite()) {
            return Err(error(format!("error = {}", self.error), "give a share above 0, such as 1e-6"));
        }
        if !(self.memory > 0.0 && self.memory.is_finite()) {
            return Err(error(format!("memory = {}", self.memory), "give GB above 0"));
        }
        if self.gather > 1 << 16 {
            return Err(error(format!("gather = {}", self.gather), "65536 directions are the most"));
        }
        if self.solution.is_some() && self.loaded.is_none() {
            let message = "the file of the solution was not opened".to_owned();
            return Err(error(message, "settings are read with `IntegratorSettings::open`"));
        }
        Ok(())
    }

    /// Whether N patches fit.
    fn check_memory(&self, n: usize) -> Result<(), IntegratorError> {
        let threads = rayon::current_num_threads();
        let needs = self.solver.bytes(n, threads);
        let limit = self.memory_bytes();
        if needs <= limit {
            return Ok(());
        }
        let fitting = Solver::ALL.into_iter().filter(|s| s.bytes(n, threads) <= limit);
        let list: Vec<String> = fitting.map(|s| format!("{} ({})", s.name(), gigabytes(s.bytes(n, threads)))).collect();
        let help = if list.is_empty() {
            "give fewer patches, or more memory".to_owned()
        } else {
            format!("give fewer patches, or more memory, or a solver that fits: {}", list.join(", "))
        };
        let message = format!(
            "{n} patches need {} by {}, more than the {} that it may take",
            gigabytes(needs),
            self.solver.name(),
            gigabytes(limit)
        );
        Err(IntegratorError { message, help })
    }
}

/// A scene's faces, or what is wrong with them; and what counts as its diffuse part.
fn faces_of(scene: &Scene, settings: &RadiositySettings) -> Result<(Vec<Face>, Vec<String>), IntegratorError> {
    let (mut wrong, mut dropped, mut hopeless) = (Vec::new(), Vec::new(), false);
    for o in scene.obstacles() {
        let said = format!("{}: {}", o.place, o.what);
        if o.has_diffuse_part && settings.diffuse_only {
            dropped.push(said);
        } else {
            hopeless |= !o.has_diffuse_part;
            wrong.push(said);
        }
    }
    if !wrong.is_empty() {
        let more = wrong.len().saturating_sub(4);
        let mut list = wrong[..wrong.len() - more].join("; ");
        if more > 0 {
            list += &format!("; and {more} more");
        }
        let help = if hopeless {
            "radiosity is for triangles at rest without holes: give meshes for what is round, and let it stand still"
        } else {
            "diffuse_only=true (--diffuse-only) takes the diffuse part of such materials alone; `path` takes all"
        };
        return Err(error(format!("radiosity is for diffuse surfaces. {list}"), help));
    }
    let faces = scene.faces();
    if faces.is_empty() {
        return Err(error("the scene has no triangle".into(), "radiosity is for meshes, rectangles and cubes"));
    }
    Ok((faces, dropped))
}

/// A scene cut into patches: all but the solution.
struct Prepared {
    mesh: Patches,
    emission: Vec<[f32; 3]>,
    reflectance: Vec<[f32; 3]>,
    external: Vec<[f32; 3]>,
    problem: Problem,
}

impl Prepared {
    fn new(scene: &Scene, faces: &[Face], mesh: Patches, sampler: &Sampler, report: &mut Report) -> Self {
        let start = Instant::now();
        let face = |patch: usize| mesh.elements[mesh.leaves[patch] as usize].face as usize;
        let emission: Vec<[f32; 3]> = (0..mesh.len()).map(|p| faces[face(p)].emission).collect();
        let reflectance: Vec<[f32; 3]> =
            (0..mesh.len()).into_par_iter().map(|p| mean_reflectance(scene, &faces[face(p)], &mesh, p)).collect();
        let (received, rays) = external_irradiance(scene, &mesh, sampler);
        report.rays += rays;
        let reflect = |(e, r): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| e[c] * r[c] * std::f32::consts::FRAC_1_PI);
        let external: Vec<[f32; 3]> = received.iter().zip(&reflectance).map(reflect).collect();
        let sum = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| a[c] + b[c]);
        let source: Vec<[f32; 3]> = emission.iter().zip(&external).map(sum).collect();
        let areas = mesh.leaves.iter().map(|e| mesh.area(*e)).collect();
        let problem = Problem { areas, source: channels(&source), reflectance: channels(&reflectance) };
        report.external_seconds += start.elapsed().as_secs_f64();
        Self { mesh, emission, reflectance, external, problem }
    }

    fn kinds(&self) -> Vec<Kind> {
        let of = |e: &[f32; 3]| if *e == [0.0; 3] { Kind::Patch } else { Kind::Light };
        self.emission.iter().map(of).collect()
    }

    /// Patches whose rows of F sum to more than 1 reflect as much less.
    fn bring_down(&mut self, scale: &[f32]) {
        for (i, s) in scale.iter().enumerate() {
            for c in 0..3 {
                self.reflectance[i][c] *= s;
                self.problem.reflectance[c][i] *= s;
            }
        }
    }

    fn factors<'a>(&self, scene: &'a Scene, settings: &RadiositySettings, seed: u32) -> FormFactors<'a> {
        FormFactors::new(scene, &self.mesh, &self.mesh.leaves, self.kinds(), settings.rays, seed)
    }

    fn solution(self, scene: &Scene, faces: &[Face], light: &Channels, inverse: Option<Inverse>) -> Solution {
        Solution {
            key: solution::key(scene, faces),
            mesh: self.mesh,
            emission: self.emission,
            external: self.external,
            reflectance: self.reflectance,
            radiance: colors(light),
            inverse,
            relit: false,
        }
    }
}

/// The mean of a patch's reflectance, over the centres of sixteen parts where it varies.
fn mean_reflectance(scene: &Scene, face: &Face, mesh: &Patches, patch: usize) -> [f32; 3] {
    let corners = mesh.corners(mesh.leaves[patch]);
    let at = |[a, b, c]: [f64; 3]| {
        let p = corners[0] * a + corners[1] * b + corners[2] * c;
        let w = patches::weights_of(p, face.corners);
        let uv = [0, 1].map(|k| (0..3).map(|i| w[i] as f32 * face.uv[i][k]).sum());
        scene.diffuse_part(face.material, uv, face.behind).reflectance
    };
    if !scene.is_textured(face.material) {
        return at([1.0 / 3.0; 3]);
    }
    // Centres of the sixteen triangles of a quarter's side, upright ones and upside-down ones.
    let mut sum = [0.0; 3];
    for i in 0..4 {
        for j in 0..4 - i {
            let mut add = |third: f64| {
                let (x, y) = ((f64::from(i) + third) / 4.0, (f64::from(j) + third) / 4.0);
                let r = at([1.0 - x - y, x, y]);
                (0..3).for_each(|c| sum[c] += r[c] / 16.0);
            };
            add(1.0 / 3.0);
            if i + j < 3 {
                add(2.0 / 3.0);
            }
        }
    }
    sum
}

/// Irradiance of each patch from lights that are no surfaces, by sixteen rays to each; sixty-four to surroundings.
fn external_irradiance(scene: &Scene, mesh: &Patches, sampler: &Sampler) -> (Vec<[f32; 3]>, u64) {
    let emitters = scene.emitters();
    let environments: Vec<u32> = emitters.environments.iter().map(|(n, _)| *n).collect();
    let lights: Vec<u32> = (0..emitters.len() as u32).filter(|e| emitters.area(*e).is_none()).collect();
    if lights.is_empty() {
        return (vec![[0.0; 3]; mesh.len()], 0);
    }
    let of = |patch: usize| {
        let [a, b, c] = mesh.corners(mesh.leaves[patch]);
        let v = |p: DVec3| Vec3::<F32x16>::splat(p.as_vec3().to_array());
        let (origin, e1, e2, n) = (v(a), v(b - a), v(c - a), v(mesh.normal(mesh.leaves[patch])));
        let error = (origin.max_abs() + e1.max_abs() + e2.max_abs()) * crate::emitter::POINT_ERROR;
        let (mut sum, mut rays) = ([0.0_f64; 3], 0);
        for (k, light) in lights.iter().enumerate() {
            let rounds = if environments.contains(light) { 4 } else { 1 };
            for round in 0..rounds {
                let lane = (0..16).fold(Index16::splat(0), |i, l| i.with_lane(l, 16 * round + l as u32));
                let stream = sampler.stream::<F32x16>(Index16::splat(patch as u32), lane);
                let [x, y] = crate::sampling::warp::uniform_triangle(stream.pair(Index16::splat(1)));
                let p = e1.mul_add(x, e2.mul_add(y, origin));
                let every = Mask16::splat(true);
                let u = stream.pair(Index16::splat(2 + k as u32));
                let (light, still) = (Index16::splat(*light), F32x16::zero());
                let light = emitters.sample(light, p, still, LightSampling::Area, u, every);
                let cos = n.dot(light.wi);
                let lit = cos.gt(F32x16::zero()) & light.weight.is_lit();
                let o = offset_from_surface(p, error, n, light.wi);
                let d = Vec3::select(light.infinite, light.wi, light.point - o);
                let tmax = F32x16::select(light.infinite, F32x16::splat(f32::INFINITY), F32x16::one());
                let ray = Ray { o: o.array(), d: d.array(), tmax, time: F32x16::zero() };
                let seen = if lit.any() { lit.and_not(scene.occluded(&ray, lit)) } else { lit };
                rays += u64::from(lit.count());
                let arriving = (light.weight * cos).masked(seen);
                for l in 0..16 {
                    let [r, g, b] = arriving.lane(l).map(f64::from);
                    let share = 1.0 / f64::from(16 * rounds);
                    sum = [sum[0] + r * share, sum[1] + g * share, sum[2] + b * share];
                }
            }
        }
        (sum.map(|x| x as f32), rays)
    };
    let found: Vec<([f32; 3], u64)> = (0..mesh.len()).into_par_iter().map(of).collect();
    let rays = found.iter().map(|(_, r)| r).sum();
    (found.into_iter().map(|(e, _)| e).collect(), rays)
}

/// What a patch is worth cutting for: how far its light varies, by the root of its area.
fn urgency(solution: &Solution) -> Vec<f64> {
    let corners = solution.at_corners(true);
    let of = |patch: usize| {
        let r = solution.reflectance[patch];
        let light = corners[patch].map(|c| [0, 1, 2].map(|k| c[k] * r[k]).into_iter().fold(0.0, f32::max));
        let most = light.into_iter().fold(0.0, f32::max);
        let least = light.into_iter().fold(f32::INFINITY, f32::min);
        f64::from(most - least) * solution.mesh.area(solution.mesh.leaves[patch]).sqrt()
    };
    (0..solution.mesh.len()).map(of).collect()
}

/// Solves a scene. Sums are the same for any number of threads.
pub fn solve(
    scene: &Scene,
    settings: &RadiositySettings,
    sampler: &Sampler,
    observer: &dyn Observer,
) -> Result<(Solution, Report), Unsolvable> {
    settings.check()?;
    let (faces, dropped) = faces_of(scene, settings)?;
    let count = settings.patches.get() as usize;
    settings.check_memory(count.max(faces.len()))?;
    let mut report = Report { faces: faces.len() as u64, dropped, ..Report::default() };
    let start = Instant::now();
    let mut mesh = Patches::new(scene, &faces, if settings.adaptive { count.div_ceil(4) } else { count });
    report.mesh_seconds += start.elapsed().as_secs_f64();
    if settings.adaptive {
        // The last solution is the one that counts; what leads to it need not give an inverse.
        let solver = match settings.solver {
            Solver::Inverse | Solver::Jacobi => Solver::GaussSeidel,
            other => other,
        };
        for share in [2, 1] {
            let prepared = Prepared::new(scene, &faces, mesh, sampler, &mut report);
            let coarse = solve_prepared(scene, &faces, prepared, settings, solver, sampler, observer, &mut report)?;
            mesh = coarse.mesh.refined(&urgency(&coarse), count.div_ceil(share));
        }
    }
    settings.check_memory(mesh.len())?;
    let prepared = Prepared::new(scene, &faces, mesh, sampler, &mut report);
    let solution = solve_prepared(scene, &faces, prepared, settings, settings.solver, sampler, observer, &mut report)?;
    report.patches = solution.mesh.len() as u64;
    Ok((solution, report))
}

#[expect(clippy::too_many_arguments)]
fn solve_prepared(
    scene: &Scene,
    faces: &[Face],
    mut prepared: Prepared,
    settings: &RadiositySettings,
    solver: Solver,
    sampler: &Sampler,
    observer: &dyn Observer,
    report: &mut Report,
) -> Result<Solution, Unsolvable> {
    let (seed, n) = (seed_of(sampler), prepared.mesh.len());
    let start = Instant::now();
    match solver {
        Solver::Inverse | Solver::Jacobi | Solver::GaussSeidel => {
            let factors = prepared.factors(scene, settings, seed);
            let (matrix, closure) = Symmetric::form_factors(&factors, observer).ok_or(Unsolvable::Stopped)?;
            report.form_factor_seconds += start.elapsed().as_secs_f64();
            report.rays += closure.rays;
            prepared.bring_down(&closure.scale);
            let problem = &prepared.problem;
            report.closure = Some(closure);
            report.bytes = Symmetric::bytes_of(n);
            let start = Instant::now();
            if solver == Solver::Inverse {
                let inverse = Inverse::new(&matrix, problem, observer);
                report.inverse_seconds += start.elapsed().as_secs_f64();
                let Some(inverse) = inverse else {
                    return Err(if observer.should_stop() {
                        Unsolvable::Stopped
                    } else {
                        let message = "the equation has no solution that could be found by an inverse".into();
                        error(message, "is it a closed room that absorbs nothing?").into()
                    });
                };
                report.bytes += 12 * (n as u64).pow(2);
                let start = Instant::now();
                let light = inverse.solve(problem);
                report.solve_seconds += start.elapsed().as_secs_f64();
                let residual = residual(&matrix, problem, &light);
                report.residual = (residual.is_nan() || residual > LARGEST_RESIDUAL).then_some(residual);
                return Ok(prepared.solution(scene, faces, &light, Some(inverse)));
            }
            let iterate = if solver == Solver::Jacobi { iterative::jacobi } else { iterative::gauss_seidel };
            let (light, rounds) = iterate(&matrix, problem, observer).ok_or(Unsolvable::Stopped)?;
            report.solve_seconds += start.elapsed().as_secs_f64();
            report.iterations += u64::from(rounds);
            report.residual = (rounds == MOST_ITERATIONS).then(|| residual(&matrix, problem, &light));
            Ok(prepared.solution(scene, faces, &light, None))
        }
        Solver::Progressive => {
            let problem = &prepared.problem;
            let factors = prepared.factors(scene, settings, seed);
            let mut shooting = Shooting::new(problem, room_for_rows(settings, n));
            if !shooting.shoot_until(ENOUGH, &factors, problem, observer) {
                return Err(Unsolvable::Stopped);
            }
            report.solve_seconds += start.elapsed().as_secs_f64();
            report.iterations += shooting.shots;
            report.rays += shooting.rays;
            report.bytes = shooting.bytes();
            report.residual = shooting.residual(problem);
            let light = shooting.with_ambient(problem);
            Ok(prepared.solution(scene, faces, &light, None))
        }
        Solver::Hierarchical => {
            let (mesh, problem) = (&prepared.mesh, &prepared.problem);
            let kind = |e: u32| match mesh.patch_of[e as usize] {
                NONE => Kind::Coarse,
                p if prepared.emission[p as usize] != [0.0; 3] => Kind::Light,
                _ => Kind::Patch,
            };
            let all: Vec<u32> = (0..mesh.elements.len() as u32).collect();
            let kinds = all.iter().map(|e| kind(*e)).collect();
            let factors = FormFactors::new(scene, mesh, &all, kinds, settings.rays, seed);
            let fixed = n as u64 * (BYTES_OF_A_PATCH + hierarchical::PATCH_BYTES);
            let most = settings.memory_bytes().saturating_sub(fixed) / (2 * hierarchical::LINK_BYTES);
            let solved = hierarchical::solve(&factors, mesh, problem, settings.error, most, observer);
            let (light, effort) = solved.map_err(|e| match e {
                Unsolved::Stopped => Unsolvable::Stopped,
                Unsolved::Memory(links) => {
                    let message =
                        format!("{links} links and more do not fit into {}", gigabytes(settings.memory_bytes()));
                    error(message, "give a larger error, fewer patches, or more memory").into()
                }
            })?;
            report.form_factor_seconds += effort.linking_seconds;
            report.solve_seconds += start.elapsed().as_secs_f64() - effort.linking_seconds;
            report.iterations += u64::from(effort.iterations);
            report.links = effort.links;
            report.rays += effort.rays;
            report.bytes = effort.links * hierarchical::LINK_BYTES;
            report.residual = effort.residual;
            prepared.bring_down(&effort.closure.scale);
            report.closure = Some(effort.closure);
            Ok(prepared.solution(scene, faces, &light, None))
        }
    }
}

/// Bytes for rows that shooting may keep.
fn room_for_rows(settings: &RadiositySettings, n: usize) -> u64 {
    settings.memory_bytes().saturating_sub(n as u64 * BYTES_OF_A_PATCH)
}

/// Radiosity as an integrator. It solves when it is first asked for samples.
pub struct Radiosity<'a> {
    scene: &'a Scene,
    sampler: Sampler,
    engine: Engine,
    settings: RadiositySettings,
    state: Mutex<State<'a>>,
    warnings: Mutex<Vec<String>>,
}

/// How far the solution is.
enum State<'a> {
    Nothing,
    Shooting(Box<(Shooting, FormFactors<'a>, Arc<Problem>, View)>),
    Solved(View),
}

/// What the first stage of shooting may leave unshot: of most rooms, all but the light of the lamps themselves.
const FIRST: f64 = 0.7;
/// By how much each further stage brings that down.
const STAGE: f64 = 0.25;

impl<'a> Radiosity<'a> {
    pub(super) fn new(
        settings: RadiositySettings,
        scene: &'a Scene,
        sampler: Sampler,
        engine: Engine,
    ) -> Result<Self, IntegratorError> {
        settings.check()?;
        let (faces, _) = faces_of(scene, &settings)?;
        match &settings.loaded {
            Some(solution) if solution.key != solution::key(scene, &faces) => {
                let file = settings.solution.as_deref().unwrap_or_default();
                let message = format!("the solution \"{file}\" is of another scene");
                return Err(error(message, "solve this one with `rebond radiosity`"));
            }
            Some(_) => {}
            None => settings.check_memory((settings.patches.get() as usize).max(faces.len()))?,
        }
        Ok(Self { scene, sampler, engine, settings, state: Mutex::new(State::Nothing), warnings: Mutex::default() })
    }

    fn view(&self, solution: Solution) -> View {
        let faces = self.scene.faces();
        let material = |f: &Face| if self.scene.is_textured(f.material) { f.material } else { NONE };
        let shown = Arc::new(solution.at_corners(self.settings.smooth));
        View {
            solution: Arc::new(solution),
            materials: Arc::new(faces.iter().map(material).collect()),
            stages: vec![shown],
            gather: self.settings.gather,
        }
    }

    /// What the samples before the `end`-th of each pixel see; none if told to stop.
    fn prepare(&self, end: u32, observer: &dyn Observer) -> Option<View> {
        let mut state = self.state.lock().unwrap_or_else(|e| e.into_inner());
        if matches!(*state, State::Nothing) {
            *state = self.begin(observer)?;
        }
        if let State::Shooting(at_work) = &mut *state {
            let (shooting, factors, problem, view) = &mut **at_work;
            while view.stages.len() < end as usize {
                let share = (FIRST * STAGE.powi(view.stages.len() as i32)).max(ENOUGH);
                if !shooting.shoot_until(share, factors, problem, observer) {
                    return None;
                }
                view.stages.push(Arc::new(self.shown(view, &shooting.with_ambient(problem))));
                shooting.residual(problem).into_iter().for_each(|r| self.warn(unconverged(r)));
                if share == ENOUGH {
                    break;
                }
            }
            if view.stages.len() < end as usize {
                *state = State::Solved(view.clone());
            }
        }
        match &*state {
            State::Nothing => None,
            State::Shooting(at_work) => Some(at_work.3.clone()),
            State::Solved(view) => Some(view.clone()),
        }
    }

    /// Something to be said once.
    fn warn(&self, message: String) {
        let mut warnings = self.warnings.lock().unwrap_or_else(|e| e.into_inner());
        if !warnings.contains(&message) {
            warnings.push(message);
        }
    }

    fn shown(&self, view: &View, light: &Channels) -> Shown {
        let solution = Solution { radiance: colors(light), ..(*view.solution).clone() };
        solution.at_corners(self.settings.smooth)
    }

    fn begin(&self, observer: &dyn Observer) -> Option<State<'a>> {
        if let Some(solution) = &self.settings.loaded {
            return Some(State::Solved(self.view((**solution).clone())));
        }
        // Shooting is shown stage by stage, unless the mesh is to follow a solution.
        if self.settings.solver != Solver::Progressive || self.settings.adaptive {
            match solve(self.scene, &self.settings, &self.sampler, observer) {
                Ok((solution, report)) => {
                    report.warning().into_iter().for_each(|w| self.warn(w));
                    return Some(State::Solved(self.view(solution)));
                }
                Err(Unsolvable::Stopped) => return None,
                // What does not fit is shot.
                Err(Unsolvable::Settings(e)) => {
                    self.warn(format!("{}: solved by progressive shooting instead; {}", e.message, e.help));
                }
            }
        }
        let (faces, _) = faces_of(self.scene, &self.settings).ok()?;
        let mesh = Patches::new(self.scene, &faces, self.settings.patches.get() as usize);
        let prepared = Prepared::new(self.scene, &faces, mesh, &self.sampler, &mut Report::default());
        let factors = prepared.factors(self.scene, &self.settings, seed_of(&self.sampler));
        let problem = Arc::new(prepared.problem.clone());
        let mut shooting = Shooting::new(&problem, room_for_rows(&self.settings, prepared.mesh.len()));
        if !shooting.shoot_until(FIRST, &factors, &problem, observer) {
            return None;
        }
        shooting.residual(&problem).into_iter().for_each(|r| self.warn(unconverged(r)));
        let light = shooting.with_ambient(&problem);
        let view = self.view(prepared.solution(self.scene, &faces, &light, None));
        Some(State::Shooting(Box::new((shooting, factors, problem, view))))
    }
}

impl Integrator for Radiosity<'_> {
    fn add_samples(&self, film: &Mutex<Film>, pass: &Pass, observer: &dyn Observer) -> Rays {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(pass.threads.clamp(1, 1024)).build();
        let prepare = || self.prepare(pass.samples.end, observer);
        let view = match pool {
            Ok(pool) => pool.install(prepare),
            Err(_) => prepare(),
        };
        let Some(view) = view else { return Rays::default() };
        self.engine.integrator(self.scene, self.sampler, view, None).add_samples(film, pass, observer)
    }

    fn warnings(&self) -> Vec<String> {
        self.warnings.lock().unwrap_or_else(|e| e.into_inner()).clone()
    }
}

/// What `diffuse_only` drops of a scene, in words.
pub(super) fn dropped(scene: &Scene, settings: &RadiositySettings) -> Vec<String> {
    faces_of(scene, settings).map_or(Vec::new(), |(_, dropped)| dropped)
}

/// A sampler for solutions that belong to no render.
pub fn sampler(seed: u64) -> Sampler {
    Sampler::new(SamplerSettings::default(), seed)
}
