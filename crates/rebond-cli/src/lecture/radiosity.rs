//! Radiosity in pictures: patches, smooth and flat, beside path tracing; and a room relit by one product.

use super::Section;
use super::page::Findings;
use super::workshop::Workshop;
use crate::Failure;
use rebond::integrators::RadiositySettings;
use rebond::integrators::radiosity::{Solution, Solver, Unsolvable, sampler, solve};
use serde_json::json;
use std::num::NonZeroU32;
use std::time::Instant;

pub const SECTION: Section = Section {
    name: "radiosity",
    title: "Radiosity",
    makes: "the Cornell box by patches, flat and smooth, beside paths; relit by one product",
    run,
};

/// The lamp of the Cornell box, its light as the scene has it, and the radiance that it gets instead.
const LAMP: u32 = 0;
const WHITE: &str = "emission = [18.387, 13.9873, 6.75357]";
const BLUE: [f32; 3] = [2.0, 8.0, 20.0];

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"L=L_e+TL \quad\Rightarrow\quad L=(I-T)^{-1}L_e");
    out.formula(r"T_{xi}=\rho_x\,V(x\to i)\,\frac{\cos\theta_i\cos\theta_{x\to i}A_i}{\pi d^2}");
    out.text(
        "All surfaces are diffuse and cut into patches, each of one radiance. The system is solved once; the solution lies on the \
         surfaces, so that any view of it is free. Flat, the patches show; smooth, light is interpolated between their corners.",
    );
    views(workshop, &mut out)?;
    relit(workshop, &mut out)?;
    Ok(out)
}

fn views(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    let stage = workshop.stage("cornell-box", workshop.pick([[24, 24], [256, 256], [512, 512]]))?;
    let patches = workshop.pick([200, 2000, 8000]);
    let samples = workshop.pick([4, 16, 64]);
    let (flat, smooth) = (format!("radiosity:patches={patches},smooth=false"), format!("radiosity:patches={patches}"));
    let (flat, _) = workshop.shot(
        &stage,
        &flat,
        samples,
        ["radiosity-flat", &format!("{patches} patches, flat"), "The Cornell box in triangles of one colour each"],
    )?;
    let (smooth, by_patches) = workshop.shot(
        &stage,
        &smooth,
        samples,
        ["radiosity-smooth", "smooth", "The Cornell box, its light interpolated between corners of patches"],
    )?;
    let (paths, by_paths) = workshop.shot(
        &stage,
        "path",
        workshop.pick([16, 64, 512]),
        ["radiosity-path", "path tracing, for comparison", "The Cornell box by path tracing, with a little noise"],
    )?;
    out.pictures(vec![flat, smooth, paths]);
    let ratio = by_patches.mean()[1] / by_paths.mean()[1];
    out.proof(format!("Its light is {:.2} % of that of path tracing, which knows no patches.", 100.0 * ratio));
    out.number("over_path", ratio);
    Ok(())
}

fn solved(workshop: &Workshop, emission: Option<[f32; 3]>, patches: u32, solver: Solver) -> Result<Solution, Failure> {
    let stage = match emission {
        None => workshop.stage("cornell-box", [8, 8])?,
        Some([r, g, b]) => {
            workshop.stage_changed("cornell-box", WHITE, &format!("emission = [{r:?}, {g:?}, {b:?}]"))?
        }
    };
    let settings =
        RadiositySettings { patches: NonZeroU32::new(patches).expect("not 0"), solver, ..RadiositySettings::default() };
    let outcome = solve(stage.scene(), &settings, &sampler(workshop.seed(0)), &());
    Ok(outcome
        .map_err(|e| match e {
            Unsolvable::Settings(e) => Failure::usage(e.message, e.help),
            Unsolvable::Stopped => Failure::Interrupted,
        })?
        .0)
}

/// The inverse once, another lamp by one product: the same as solving again.
fn relit(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Another lamp, by one product");
    out.formula(r"L'=(I-T)^{-1}L_e'");
    let patches = workshop.pick([200, 1000, 2000]);
    let start = Instant::now();
    let mut solution = solved(workshop, None, patches, Solver::Inverse)?;
    let first = start.elapsed().as_secs_f64();
    let start = Instant::now();
    if !solution.relight(&[(LAMP, BLUE)]) {
        return Err(Failure::Run("the solution has no inverse".into()));
    }
    let product = start.elapsed().as_secs_f64();
    let again = solved(workshop, Some(BLUE), patches, Solver::GaussSeidel)?;
    let both = solution.radiance.iter().flatten().zip(again.radiance.iter().flatten());
    let (most, off) = both.fold((0.0_f32, 0.0_f32), |(most, off), (a, b)| (most.max(*b), off.max((a - b).abs())));
    let off = f64::from(off / most);
    out.text(format!(
        "With (I − T)⁻¹ at hand the lamp may change: {patches} patches took {first:.2} s to cut, to see each other and to invert, \
         and {:.1} ms to relight in blue.",
        1e3 * product
    ));
    out.proof(format!(
        "Against a solution made anew under the blue lamp, by Gauss and Seidel, no patch is off by more than {off:.1e} of the brightest."
    ));
    out.text(format!(
        "By hand: rebond radiosity cornell-box --patches {patches} --solver inverse -o box.safetensors, then rebond radiosity \
         cornell-box --load box.safetensors --relight {LAMP}={},{},{}",
        BLUE[0], BLUE[1], BLUE[2]
    ));
    out.number("relight", json!({ "seconds": product, "solve_seconds": first, "largest_difference": off }));
    Ok(())
}
