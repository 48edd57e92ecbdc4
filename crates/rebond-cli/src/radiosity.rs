//! `rebond radiosity`.

use crate::Failure;
use crate::capture::check_output;
use crate::output::{answer, available_memory_bytes, bytes, note, peak_memory_bytes, write_bytes};
use crate::progress::{catch_interrupt, is_interrupted};
use clap::Args;
use indicatif::ProgressBar;
use rebond::integrators::RadiositySettings;
use rebond::integrators::radiosity::{Report, Solution, Solver, Unsolvable, sampler, solve};
use rebond::render::Observer;
use rebond::scene::Scene;
use rebond_io::{SceneFiles, SceneSource, write_glb, write_solution};
use serde_json::{Value, json};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

#[derive(Args)]
pub struct Arguments {
    /// A built-in scene (see `rebond scenes`) or a .toml file.
    scene: String,
    /// Patches to cut surfaces into, at least.
    #[arg(long, default_value = "5000")]
    patches: NonZeroU32,
    /// How the equation is solved; only the inverse can be relit.
    #[arg(long, value_enum, default_value_t = SolverName::Inverse)]
    solver: SolverName,
    /// Rays between two patches: 1, 4, 16 or 64; four times as many if one of them shines.
    #[arg(long, default_value_t = 4)]
    rays: u32,
    /// Largest error of a link of the hierarchical solver, over what the sources send.
    #[arg(long, default_value_t = 1e-6)]
    error: f32,
    /// Spend half of the patches where light varies most.
    #[arg(long)]
    adaptive: bool,
    /// Take the diffuse part of materials that are not diffuse, and say so.
    #[arg(long)]
    diffuse_only: bool,
    /// Memory it may take, in GB [default: what is free].
    #[arg(long)]
    memory: Option<f32>,
    /// Seed of the rays.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads to use [default: all].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Begin with this solution of the scene, in place of solving.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["patches", "solver", "rays", "error", "adaptive", "diffuse_only", "memory", "seed"])]
    load: Option<PathBuf>,
    /// Let a shape emit another radiance, such as 0=18,14,7 or shapes[3]=5; may be given several times.
    #[arg(long, value_name = "SHAPE=RADIANCE")]
    relight: Vec<String>,
    /// Save the solution (.safetensors), for --load or `render -i radiosity:solution=FILE`.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the mesh with its light as colours (.glb), for Blender, three.js and the like.
    #[arg(long, value_name = "FILE")]
    bake: Option<PathBuf>,
    /// Bake each patch in one colour.
    #[arg(long, requires = "bake")]
    flat: bool,
    /// Stops by which to brighten baked colours, which end at 1.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, requires = "bake")]
    exposure: f32,
    /// Write over files that exist.
    #[arg(long)]
    force: bool,
    /// No progress and no notes.
    #[arg(long)]
    quiet: bool,
    /// Print one JSON object with all that was found.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum SolverName {
    Inverse,
    Jacobi,
    GaussSeidel,
    Progressive,
    Hierarchical,
}

impl From<SolverName> for Solver {
    fn from(name: SolverName) -> Self {
        match name {
            SolverName::Inverse => Self::Inverse,
            SolverName::Jacobi => Self::Jacobi,
            SolverName::GaussSeidel => Self::GaussSeidel,
            SolverName::Progressive => Self::Progressive,
            SolverName::Hierarchical => Self::Hierarchical,
        }
    }
}

/// Shows that something is going on, from the first second on; and hears Ctrl-C.
struct Watch {
    bar: Option<ProgressBar>,
    start: Instant,
    rays: AtomicU64,
}

impl Observer for Watch {
    fn advance(&self, _: u64, rays: u64) {
        let rays = self.rays.fetch_add(rays, Ordering::Relaxed) + rays;
        let seconds = self.start.elapsed().as_secs_f64();
        if let Some(bar) = self.bar.as_ref().filter(|_| seconds > 1.0) {
            bar.set_message(format!("{:.0} M rays, {:.1} M rays/s", rays as f64 / 1e6, rays as f64 / seconds / 1e6));
            bar.tick();
        }
    }
    fn should_stop(&self) -> bool {
        is_interrupted()
    }
}

/// Memory if neither the user nor the system says.
const DEFAULT_MEMORY: u64 = 8_000_000_000;

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if let Some(output) = &a.output {
        check_output(output, "safetensors", a.force)?;
    }
    if let Some(bake) = &a.bake {
        check_output(bake, "glb", a.force)?;
    }
    if !a.relight.is_empty() && a.load.is_none() && a.solver != SolverName::Inverse {
        let message = "only the inverse can be relit";
        return Err(Failure::usage(message, "add --solver inverse, or --load a solution that was solved by it"));
    }
    let start = Instant::now();
    let source = SceneSource::open(&a.scene)?;
    let scene = source.build()?;
    let build_seconds = start.elapsed().as_secs_f64();
    if !a.quiet {
        scene.statistics().warnings.iter().for_each(|w| note(&format!("warning: {w}")));
    }
    let lights = a.relight.iter().map(|l| light(l, &scene)).collect::<Result<Vec<_>, _>>()?;
    catch_interrupt();
    let threads = usize::from(a.threads.unwrap_or(0));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| Failure::Run(format!("cannot start threads: {e}")))?;
    let (mut solution, report, load_seconds) = match &a.load {
        Some(file) => {
            let start = Instant::now();
            (load(file, &scene)?, None, Some(start.elapsed().as_secs_f64()))
        }
        None => {
            let (solution, report) = pool.install(|| solved(a, &scene))?;
            (solution, Some(report), None)
        }
    };
    let relight_seconds = match lights.is_empty() {
        true => None,
        false => {
            let start = Instant::now();
            if !pool.install(|| solution.relight(&lights)) {
                let message = "the solution has no inverse to relight it by";
                return Err(Failure::usage(message, "solve it with --solver inverse"));
            }
            Some(start.elapsed().as_secs_f64())
        }
    };
    let mut outputs = Vec::new();
    if let Some(file) = &a.output {
        save(file, &write_solution(&solution, &source.name), &mut outputs)?;
    }
    if let Some(file) = &a.bake {
        save(file, &write_glb(&solution, !a.flat, a.exposure.exp2()), &mut outputs)?;
    }
    let means = mean(&solution);
    if a.json {
        let mut found = report.as_ref().map_or_else(|| json!({}), |r| as_json(r, a.solver.into()));
        found["scene"] = json!(source.name);
        found["build_seconds"] = json!(build_seconds);
        found["load_seconds"] = json!(load_seconds);
        found["relight_seconds"] = json!(relight_seconds);
        found["patches"] = json!(solution.mesh.len());
        found["mean_radiance"] = json!(means);
        found["peak_memory_bytes"] = json!(peak_memory_bytes());
        found["biased"] = json!(true);
        found["outputs"] = json!(outputs);
        return answer(&found.to_string());
    }
    let mut lines = vec![format!("{}: {} patches", source.name, solution.mesh.len())];
    if let Some(r) = &report {
        lines.extend(as_lines(r, a.solver.into()));
    }
    let seconds = |what: &str, s: Option<f64>| s.map(|s| format!("{what:<28} {s:.4} s"));
    lines.extend(seconds("loaded", load_seconds));
    lines.extend(seconds("relit", relight_seconds));
    lines.push(format!("{:<28} {:.6} {:.6} {:.6}", "mean radiance (R, G, B)", means[0], means[1], means[2]));
    lines.extend(outputs);
    lines.iter().try_for_each(|l| answer(l))
}

fn solved(a: &Arguments, scene: &Scene) -> Result<(Solution, Report), Failure> {
    let memory = a.memory.unwrap_or(available_memory_bytes().unwrap_or(DEFAULT_MEMORY) as f32 / 1e9);
    let settings = RadiositySettings {
        patches: a.patches,
        solver: a.solver.into(),
        rays: a.rays,
        error: a.error,
        adaptive: a.adaptive,
        diffuse_only: a.diffuse_only,
        memory,
        ..RadiositySettings::default()
    };
    let bar = (!a.quiet).then(ProgressBar::new_spinner);
    let watch = Watch { bar, start: Instant::now(), rays: AtomicU64::new(0) };
    let outcome = solve(scene, &settings, &sampler(a.seed), &watch);
    if let Some(bar) = &watch.bar {
        bar.finish_and_clear();
    }
    let (solution, report) = outcome.map_err(|e| match e {
        Unsolvable::Settings(e) => Failure::usage(e.message, e.help),
        Unsolvable::Stopped => Failure::Interrupted,
    })?;
    if !a.quiet {
        report.dropped.iter().for_each(|d| note(&format!("warning: {d}: only its diffuse part counts")));
        report.warning().iter().for_each(|w| note(&format!("warning: {w}")));
    }
    Ok((solution, report))
}

fn load(file: &Path, scene: &Scene) -> Result<Solution, Failure> {
    let name = file.to_string_lossy();
    let files = SceneFiles::Folder(PathBuf::new());
    files.solution(&name, scene).map_err(|e| Failure::usage(e, "`rebond radiosity SCENE -o FILE` writes solutions"))
}

fn save(path: &Path, content: &[u8], outputs: &mut Vec<String>) -> Result<(), Failure> {
    write_bytes(path, content).map_err(|e| Failure::Run(format!("cannot write \"{}\": {e}", path.display())))?;
    outputs.push(path.display().to_string());
    Ok(())
}

/// `SHAPE=RADIANCE`: a shape's number or name, and one number or three.
fn light(text: &str, scene: &Scene) -> Result<(u32, [f32; 3]), Failure> {
    let usage = |message: String| {
        let help = "give SHAPE=RADIANCE: the number of a shape in the scene, from 0, or its place such as shapes[3]; and one number or R,G,B";
        Failure::usage(message, help)
    };
    let (name, value) = text.rsplit_once('=').ok_or_else(|| usage(format!("\"{text}\" names no radiance")))?;
    let place = if name.parse::<u32>().is_ok() { format!("shapes[{name}]") } else { name.to_owned() };
    let shape = (0..scene.shape_count()).find(|s| scene.shape_name(*s) == place);
    let shape = shape.ok_or_else(|| usage(format!("there is no shape \"{place}\"")))?;
    let numbers: Option<Vec<f32>> =
        value.split(',').map(|x| x.trim().parse().ok().filter(|x: &f32| x.is_finite() && *x >= 0.0)).collect();
    match numbers.as_deref() {
        Some(&[x]) => Ok((shape, [x; 3])),
        Some(&[r, g, b]) => Ok((shape, [r, g, b])),
        _ => Err(usage(format!("\"{value}\" is no radiance"))),
    }
}

/// The mean over all surfaces.
fn mean(solution: &Solution) -> [f64; 3] {
    let areas: Vec<f64> = solution.mesh.leaves.iter().map(|e| solution.mesh.area(*e)).collect();
    let total: f64 = areas.iter().sum();
    let of = |c: usize| solution.radiance.iter().zip(&areas).map(|(l, a)| f64::from(l[c]) * a).sum::<f64>() / total;
    [of(0), of(1), of(2)]
}

fn as_json(r: &Report, solver: Solver) -> Value {
    json!({
        "solver": solver.name(),
        "faces": r.faces,
        "mesh_seconds": r.mesh_seconds,
        "external_seconds": r.external_seconds,
        "form_factor_seconds": r.form_factor_seconds,
        "inverse_seconds": r.inverse_seconds,
        "solve_seconds": r.solve_seconds,
        "row_sums": r.closure.as_ref().map(|c| json!({ "least": c.least, "mean": c.mean, "most": c.most })),
        "iterations": r.iterations,
        "links": r.links,
        "rays": r.rays,
        "solver_bytes": r.bytes,
        "dropped": r.dropped,
        "residual": r.residual,
    })
}

fn as_lines(r: &Report, solver: Solver) -> Vec<String> {
    let line = |what: &str, value: String| format!("{what:<28} {value}");
    let mut lines = vec![line("cut from faces", r.faces.to_string())];
    for (what, seconds) in [
        ("mesh", r.mesh_seconds),
        ("light of what is no patch", r.external_seconds),
        (if solver == Solver::Hierarchical { "links" } else { "form factors" }, r.form_factor_seconds),
        ("inverse", r.inverse_seconds),
        ("solution", r.solve_seconds),
    ] {
        if seconds >= 5e-5 {
            lines.push(line(what, format!("{seconds:.4} s")));
        }
    }
    if let Some(c) = &r.closure {
        lines.push(line("Σ_j F_ij, mean", format!("{:.6} (from {:.6} to {:.6})", c.mean, c.least, c.most)));
    }
    lines.push(line("rays", r.rays.to_string()));
    let what = if solver == Solver::Progressive { "patches shot" } else { "rounds" };
    if r.iterations > 0 {
        lines.push(line(what, r.iterations.to_string()));
    }
    if r.links > 0 {
        lines.push(line("links", r.links.to_string()));
    }
    lines.push(line(&format!("memory of {}", solver.name()), bytes(r.bytes)));
    lines
}
