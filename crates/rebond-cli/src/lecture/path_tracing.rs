//! The rendering equation by Monte Carlo in pictures: recursion against one sample, implicit and explicit, clamped and with Russian
//! roulette, path by path.

use super::Section;
use super::page::Findings;
use super::workshop::{Shot, Stage, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test, verdict};
use crate::plot::{Axis, Chart, Curve, Legend, Mark};
use rebond::film::Film;
use rebond::math::Moments;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "path-tracing",
    title: "Path tracing",
    makes: "recursive, implicit, explicit; clamped depths, Russian roulette; particular paths; growing sample counts",
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"L(x,\omega_o)=L_e(x,\omega_o)+\int_{\Omega}L(x',-\omega_i)\,f_r(x,\omega_i,\omega_o)\,\cos\theta_i\,d\omega_i");
    recursion(workshop, &mut out)?;
    modes(workshop, &mut out)?;
    clamped(workshop, &mut out)?;
    roulette(workshop, &mut out)?;
    classes(workshop, &mut out)?;
    growing(workshop, &mut out)?;
    Ok(out)
}

/// The box of spheres, and samples per pixel.
fn spheres(workshop: &Workshop) -> Result<(Stage, u32), Failure> {
    let stage = workshop.stage("cornell-spheres", workshop.pick([[24, 24], [192, 192], [512, 512]]))?;
    Ok((stage, workshop.pick([4, 64, 256])))
}

/// Rays by segment: N^(d − 1) of them per camera ray, or at most one.
fn recursion(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Why one sample per hit is enough");
    out.formula(r"L \approx L_e+\frac{1}{N}\sum_{i=1}^{N}\frac{f_r\cos\theta_i}{p(\omega_i)}\,L(x_i,-\omega_i)");
    let depth = workshop.pick([4, 6, 8]);
    out.text(format!(
        "With N samples at every hit, segment d costs N^(d − 1) rays, and most rays go where they matter least. The \
         Cornell box, rays per camera ray up to {depth} segments; all three estimate the same picture.",
    ));
    let stage = workshop.stage("cornell-box", workshop.pick([[16, 16], [32, 32], [64, 64]]))?;
    let samples = workshop.pick([1, 4, 16]);
    let (mut curves, mut rows, mut numbers) = (Vec::new(), Vec::new(), serde_json::Map::new());
    for (color, (name, integrator)) in [
        ("path tracing", format!("path:max_depth={depth},roulette=none")),
        ("N = 2", format!("recursive:branching=2,depth={depth}")),
        ("N = 4", format!("recursive:branching=4,depth={depth}")),
    ]
    .into_iter()
    .enumerate()
    {
        let (film, statistics) = workshop.film(&stage, &Shot::new(&integrator, samples))?;
        let per_camera_ray = |rays: u64| rays as f64 / film.samples() as f64;
        let by_depth: Vec<f64> = statistics.rays.by_depth.iter().map(|n| per_camera_ray(*n)).collect();
        let points = by_depth.iter().enumerate().map(|(d, n)| [(d + 1) as f64, *n]).collect();
        curves.push(Curve { name: name.into(), mark: Mark::LineAndDots, color, points });
        let last = by_depth.last().copied().unwrap_or(0.0);
        let all = per_camera_ray(statistics.rays.total());
        rows.push(vec![name.into(), format!("{last:.2}"), format!("{all:.1}"), format!("{:.0} %", 100.0 * last / all)]);
        numbers.insert(name.into(), json!({ "by_depth": by_depth, "all": all }));
    }
    out.plot(
        "path-rays-by-depth",
        Chart {
            title: "Rays of each segment, per camera ray".into(),
            x: Axis { label: "segment", log: false, range: None },
            y: Axis { label: "rays", log: true, range: None },
            bands: vec![],
            curves,
            legend: Legend::UpperLeft,
        },
        "Two lines that rise exponentially, and that of path tracing, which stays below one",
    );
    out.table(
        "path-rays",
        "Rays per camera ray; shadow rays are among all",
        &["estimator", "of the last segment", "all", "the last segment's share"],
        rows,
    );
    out.number("recursion", numbers);
    Ok(())
}

fn modes(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Implicit and explicit");
    out.formula(r"L \approx L_e+L_d+L_{ind}");
    out.text(
        "Implicit: only paths that happen to meet a light count. Explicit: direct light is sampled on the lights, and \
         what a path meets by chance is not counted again. Or both, weighed against each other (mis).",
    );
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut means, mut verdicts) = (Vec::new(), Vec::new(), Vec::new());
    for mode in ["implicit", "explicit", "mis"] {
        let integrator = format!("path:mode={mode}");
        let words = [format!("path-{mode}"), mode.into(), format!("The box of spheres, {mode}")];
        row.push(workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?.0);
        let independent = Shot::new(&integrator, 4 * samples).independent(means.len() as u64 + 1);
        means.push(Means::of(&workshop.film(&stage, &independent)?.0));
    }
    out.pictures(row);
    let mut numbers = serde_json::Map::new();
    for (mode, other) in ["implicit", "explicit"].iter().zip(&means) {
        let test = other.test(&means[2], stage.size(), 8, 0.01);
        verdicts.push(format!(
            "{mode} against mis: {} of {} blocks below 1 %, {}",
            test.below_alpha,
            test.tested,
            verdict(&test)
        ));
        numbers.insert((*mode).into(), of_test(&test));
    }
    out.proof(format!("Welch's test, block by block. {}.", verdicts.join("; ")));
    out.number("modes", numbers);
    Ok(())
}

fn clamped(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Paths cut off");
    out.text("At most p segments: p = 1, 2, 3, 4, and all. What is cut off is missing, so the first four are biased.");
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut brightness) = (Vec::new(), Vec::new());
    let whole = workshop.shot(&stage, "path", samples, ["path-whole", "all", "The box of spheres"])?;
    let mean = |film: &Film| film.mean()[1];
    for depth in 1..=4 {
        let integrator = format!("path:max_depth={depth}");
        let words = [
            format!("path-depth-{depth}"),
            format!("p = {depth}"),
            format!("The box of spheres by paths of at most {depth} segments"),
        ];
        let (picture, film) = workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?;
        brightness.push(mean(&film) / mean(&whole.1));
        row.push(picture);
    }
    row.push(whole.0);
    out.pictures(row);
    let shares: Vec<String> = brightness.iter().map(|b| format!("{:.1} %", 100.0 * b)).collect();
    out.proof(format!("Of the whole picture's light they have {}.", shares.join(", ")));
    out.number("clamped", json!(brightness));
    Ok(())
}

fn roulette(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Russian roulette");
    out.formula(r"L \approx \begin{cases} L/q & \xi<q \\ 0 & \text{else}\end{cases}");
    out.text(
        "A path goes on with probability q and then counts 1/q: nothing is missing. The furnace reflects half of all \
         light and shines with radiance 1, so everything is 1/(1 − 1/2) = 2. Roulette from the first hit on:",
    );
    let stage = workshop.stage("furnace", workshop.pick([[16, 16], [48, 48], [96, 96]]))?;
    let samples = workshop.pick([64, 256, 1024]);
    let (mut rows, mut numbers) = (Vec::new(), serde_json::Map::new());
    for (seed, (name, settings)) in [
        ("q = 0.5", "roulette=constant,survival=0.5"),
        ("q = 0.8", "roulette=constant,survival=0.8"),
        ("q = ρ", "roulette=albedo"),
        ("q = throughput", "roulette=throughput"),
    ]
    .into_iter()
    .enumerate()
    {
        let integrator = format!("path:mode=implicit,rr_depth=0,{settings}");
        let (film, statistics) = workshop.film(&stage, &Shot::new(&integrator, samples).independent(seed as u64))?;
        let pixels: Moments = film.pixels().iter().map(|p| p.mean()[1]).collect();
        let variance: Moments = film.pixels().iter().map(|p| p.variance()[1]).collect();
        let rays = statistics.rays.total() as f64 / film.samples() as f64;
        rows.push(vec![
            name.into(),
            format!("{:.4} ± {:.4}", pixels.mean(), pixels.standard_error()),
            format!("{:.3}", variance.mean()),
            format!("{rays:.2}"),
        ]);
        numbers.insert(
            name.into(),
            json!({ "mean": pixels.mean(), "standard_error": pixels.standard_error(), "p": pixels.p_value(2.0),
                "variance": variance.mean(), "rays": rays }),
        );
    }
    out.table(
        "path-roulette",
        "The furnace by implicit paths: mean (2 by theory), variance of one path, rays per path",
        &["survival", "mean", "variance", "rays"],
        rows,
    );
    out.number("roulette", numbers);
    Ok(())
}

/// Each picture of the lecture's own paths.
fn classes(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Particular paths");
    out.text(
        "By what happened from the light (L) to the eye (E): D is a diffuse reflection, S a mirror's, T light that \
         passes. The number of vertices counts both ends.",
    );
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut sum, mut numbers) = (Vec::new(), 0.0, serde_json::Map::new());
    for (name, paths, caption) in [
        ("emission", "LE", "emission, 2 vertices"),
        ("direct-diffuse", "LDE", "direct diffuse, 3"),
        ("direct-specular", "L(S|T)E", "direct specular, 3"),
        ("indirect-diffuse", "L(D|S|T)DE", "indirect diffuse, one bounce, 4"),
        ("indirect-specular", "L(D|S|T)(S|T)E", "indirect specular, one bounce, 4"),
        ("caustic", "L(S|T)+DE", "caustics"),
        ("longer", "5..", "5 vertices and more"),
    ] {
        let integrator = format!("path:paths={paths}");
        let words = [format!("path-{name}"), format!("{caption}: {paths}"), format!("The box of spheres, {caption}")];
        let (picture, film) = workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?;
        row.push(picture);
        numbers.insert(name.into(), film.mean()[1].into());
        // Caustics are in the others too.
        sum += if name == "caustic" { 0.0 } else { film.mean()[1] };
    }
    out.pictures(row);
    let (film, _) = workshop.film(&stage, &Shot::new("path", samples))?;
    let whole = film.mean()[1];
    out.proof(format!(
        "Without the caustics, which are among the others, they add up to {:.7} of the whole picture's light.",
        sum / whole
    ));
    numbers.insert("sum_over_whole".into(), (sum / whole).into());
    out.number("classes", numbers);
    Ok(())
}

fn growing(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("What is slow about it");
    out.text("The noise falls with the root of the number of samples only; caustics and what lamps do not see keep it longest.");
    let (stage, _) = spheres(workshop)?;
    let mut row = Vec::new();
    for samples in [1, 4, 16, 64, 256].into_iter().take(workshop.pick([2, 5, 5])) {
        let words = [
            format!("path-{samples}-spp"),
            format!("{samples} paths per pixel"),
            format!("The box of spheres with the noise of {samples} paths per pixel"),
        ];
        row.push(workshop.shot(&stage, "path", samples, words.each_ref().map(String::as_str))?.0);
    }
    out.pictures(row);
    Ok(())
}
