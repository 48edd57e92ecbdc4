//! Radiosity in pictures: patches, smooth and flat, beside path tracing; and a room relit by one product.

use super::Section;
use super::page::Findings;
use super::workshop::Workshop;
use crate::Failure;
use crate::judge::Means;
use rebond::integrators::RadiositySettings;
use rebond::integrators::radiosity::{Solution, Solver, Unsolvable, sampler, solve};
use serde_json::json;
use std::num::NonZeroU32;
use std::time::Instant;

pub const SECTION: Section = Section {
    name: "radiosity",
    title: ["Radiosity", "Radiosité"],
    makes: "the Cornell box by patches, flat and smooth, beside paths; relit by one product",
    sources: &["crates/rebond/src/integrators/radiosity", "crates/rebond/src/transport/form_factor.rs"],
    run,
};

/// The lamp of the Cornell box, its light as the scene has it, and the radiance that it gets instead.
const LAMP: u32 = 0;
const WHITE: &str = "emission = [18.387, 13.9873, 6.75357]";
const BLUE: [f32; 3] = [2.0, 8.0, 20.0];

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"L=L_e+TL \quad\Rightarrow\quad L=(I-T)^{-1}L_e");
    out.formula(r"T_{xi}=\rho_x\,V(x\to i)\,\frac{\cos\theta_i\cos\theta_{x\to i}A_i}{\pi d^2}");
    out.text([
        "All surfaces are diffuse and cut into patches, each of one radiance. The system is solved once; the solution lies on the \
         surfaces, so that any view of it is free. Flat, the patches show; smooth, light is interpolated between their corners.",
        "Toutes les surfaces sont diffuses et découpées en éléments, chacun de radiance constante. Le système est résolu une fois ; la \
         solution repose sur les surfaces, si bien que toute vue en est gratuite. Sans interpolation, on voit les éléments ; avec, la \
         lumière est interpolée entre leurs coins.",
    ]);
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
        "radiosity-flat",
        [format!("{patches} patches, flat"), format!("{patches} éléments, sans interpolation")],
        [
            "The Cornell box in triangles of one colour each",
            "La boîte de Cornell en triangles d'une seule couleur chacun",
        ],
    )?;
    let (smooth, by_patches) = workshop.shot(
        &stage,
        &smooth,
        samples,
        "radiosity-smooth",
        ["smooth", "avec interpolation"],
        [
            "The Cornell box, its light interpolated between corners of patches",
            "La boîte de Cornell, sa lumière interpolée entre les coins des éléments",
        ],
    )?;
    let (paths, by_paths) = workshop.shot(
        &stage,
        "path",
        workshop.pick([16, 64, 512]),
        "radiosity-path",
        ["path tracing, for comparison", "tracé de chemins, pour comparer"],
        [
            "The Cornell box by path tracing, with a little noise",
            "La boîte de Cornell par tracé de chemins, avec un peu de bruit",
        ],
    )?;
    out.pictures(vec![flat, smooth, paths]);
    let [ratio, off] = Means::of(&by_patches).over(&Means::of(&by_paths));
    let [percent, points] = [ratio, off].map(|x| 100.0 * x);
    out.proof([
        format!("Its light is {percent:.2} ± {points:.2} % of that of path tracing, which knows no patches."),
        format!(
            "Sa lumière vaut {percent:.2} ± {points:.2} % de celle du tracé de chemins, qui ne connaît pas d'éléments."
        ),
    ]);
    out.number("over_path", ratio);
    out.number("standard_error", off);
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
    out.heading(["Another lamp, by one product", "Une autre lampe, par un seul produit"]);
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
    let microseconds = 1e6 * product;
    out.text([
        format!(
            "With (I − T)⁻¹ at hand the lamp may change: {patches} patches took {first:.2} s to cut, to see each other and to invert, \
             and {microseconds:.0} µs to relight in blue."
        ),
        format!(
            "Une fois (I − T)⁻¹ connue, la lampe peut changer : il a fallu {first:.2} s pour découper {patches} éléments, calculer qui \
             voit qui et inverser, puis {microseconds:.0} µs pour rééclairer en bleu."
        ),
    ]);
    out.proof([
        format!(
            "Against a solution made anew under the blue lamp, by Gauss and Seidel, no patch is off by more than {off:.1e} of the \
             brightest."
        ),
        format!(
            "Par rapport à une solution refaite sous la lampe bleue, par Gauss et Seidel, aucun élément ne s'écarte de plus de {off:.1e} \
             fois la radiance du plus clair."
        ),
    ]);
    let [r, g, b] = BLUE;
    let solve = format!("rebond radiosity cornell-box --patches {patches} --solver inverse -o box.safetensors");
    let relight = format!("rebond radiosity cornell-box --load box.safetensors --relight {LAMP}={r},{g},{b}");
    out.text([format!("By hand: `{solve}`, then `{relight}`."), format!("À la main : `{solve}`, puis `{relight}`.")]);
    out.number("relight", json!({ "seconds": product, "solve_seconds": first, "largest_difference": off }));
    Ok(())
}
