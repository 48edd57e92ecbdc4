//! The rendering equation by Monte Carlo in pictures: recursion against one sample, implicit and explicit, clamped and with Russian
//! roulette, path by path.

use super::Section;
use super::language::{counted, told};
use super::page::Findings;
use super::workshop::{Shot, Stage, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test};
use crate::plot::{Axis, Chart, Curve, Legend, Mark};
use rebond::film::Film;
use rebond::math::Moments;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "path-tracing",
    title: ["Path tracing", "Tracé de chemins"],
    makes: "recursive, implicit, explicit; clamped depths, Russian roulette; particular paths; growing sample counts",
    sources: &[
        "crates/rebond/src/integrators/path.rs",
        "crates/rebond/src/integrators/recursive.rs",
        "crates/rebond/src/transport/roulette.rs",
        "crates/rebond/src/render/path_classes.rs",
        "docs/fifty_lines.rs",
    ],
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
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
    out.heading(["Why one sample per hit is enough", "Pourquoi un échantillon par impact suffit"]);
    out.formula(r"L \approx L_e+\frac{1}{N}\sum_{i=1}^{N}\frac{f_r\cos\theta_i}{p(\omega_i)}\,L(x_i,-\omega_i)");
    let depth = workshop.pick([4, 6, 8]);
    out.text([
        format!(
            "With N samples at every hit, segment d costs N^(d − 1) rays, and most rays go where they matter least. The \
             Cornell box, rays per camera ray up to {depth} segments; all three estimate the same picture."
        ),
        format!(
            "Avec N échantillons à chaque impact, le segment d coûte N^(d − 1) rayons, et la plupart des rayons vont là où ils importent \
             le moins. La boîte de Cornell, rayons par rayon de caméra jusqu'à {depth} segments ; les trois estiment la même image."
        ),
    ]);
    let stage = workshop.stage("cornell-box", workshop.pick([[16, 16], [48, 48], [96, 96]]))?;
    let samples = workshop.pick([1, 2, 8]);
    let (mut row, mut curves, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    let mut numbers = serde_json::Map::new();
    for (color, (key, name, file, integrator)) in [
        (
            "path tracing",
            workshop.say(["path tracing", "tracé de chemins"]),
            "path-one",
            format!("path:max_depth={depth},roulette=none"),
        ),
        ("N = 2", "N = 2", "path-two", format!("recursive:branching=2,depth={depth}")),
        ("N = 4", "N = 4", "path-four", format!("recursive:branching=4,depth={depth}")),
    ]
    .into_iter()
    .enumerate()
    {
        let shot = Shot::new(&integrator, samples);
        let (film, statistics) = workshop.film(&stage, &shot)?;
        let per_camera_ray = |rays: u64| rays as f64 / film.samples() as f64;
        let by_depth: Vec<f64> = statistics.rays.by_depth.iter().map(|n| per_camera_ray(*n)).collect();
        let points = by_depth.iter().enumerate().map(|(d, n)| [(d + 1) as f64, *n]).collect();
        curves.push(Curve { name: name.into(), mark: Mark::LineAndDots, color, points });
        let last = by_depth.last().copied().unwrap_or(0.0);
        let all = per_camera_ray(statistics.rays.total());
        rows.push(vec![name.into(), format!("{last:.2}"), format!("{all:.1}"), format!("{:.0} %", 100.0 * last / all)]);
        numbers.insert(key.into(), json!({ "by_depth": by_depth, "all": all }));
        let words =
            [format!("{name}: {all:.0} rays per camera ray"), format!("{name} : {all:.0} rayons par rayon de caméra")];
        let alt = [format!("The Cornell box, small, by {name}"), format!("La boîte de Cornell, en petit, par {name}")];
        row.push(workshop.picture(&stage, &shot, &film, file, words, alt)?);
    }
    out.pictures(row);
    out.plot(
        "path-rays-by-depth",
        Chart {
            title: workshop
                .say(["Rays of each segment, per camera ray", "Rayons de chaque segment, par rayon de caméra"])
                .into(),
            x: Axis { label: "segment", log: false, range: None },
            y: Axis { label: workshop.say(["rays", "rayons"]), log: true, range: None },
            bands: vec![],
            curves,
            legend: Legend::UpperLeft,
        },
        [
            "Two lines that rise exponentially, and that of path tracing, which stays below one",
            "Deux lignes qui montent exponentiellement, et celle du tracé de chemins, qui reste sous un",
        ],
    );
    out.table(
        "path-rays",
        [
            "Rays per camera ray; shadow rays are among all",
            "Rayons par rayon de caméra ; les rayons d'ombre comptent dans le total",
        ],
        &[
            ["estimator", "estimateur"],
            ["of the last segment", "du dernier segment"],
            ["all", "total"],
            ["the last segment's share", "part du dernier segment"],
        ],
        rows,
    );
    out.number("recursion", numbers);
    Ok(())
}

fn modes(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Implicit and explicit", "Implicite et explicite"]);
    out.formula(r"L \approx L_e+L_d+L_{ind}");
    out.text([
        "Implicit: only paths that happen to meet a light count. Explicit: direct light is sampled on the lights, and \
         what a path meets by chance is not counted again. Or both, weighed against each other (mis).",
        "Implicite : seuls comptent les chemins qui rencontrent une lumière par hasard. Explicite : l'éclairage direct est échantillonné \
         sur les lumières, et ce qu'un chemin rencontre par hasard n'est pas compté une seconde fois. Ou les deux, pondérés l'un par \
         rapport à l'autre (mis).",
    ]);
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut means, mut verdicts) = (Vec::new(), Vec::new(), Vec::new());
    for mode in ["implicit", "explicit", "mis"] {
        let integrator = format!("path:mode={mode}");
        let alt = [format!("The box of spheres, {mode}"), format!("La boîte aux sphères, {mode}")];
        row.push(workshop.shot(&stage, &integrator, samples, &format!("path-{mode}"), [mode; 2], alt)?.0);
        let independent = Shot::new(&integrator, 4 * samples).independent(means.len() as u64 + 1);
        means.push(Means::of(&workshop.film(&stage, &independent)?.0));
    }
    out.pictures(row);
    let mut numbers = serde_json::Map::new();
    for (mode, other) in ["implicit", "explicit"].iter().zip(&means) {
        let test = other.test(&means[2], stage.size(), 8, 0.01);
        let [english, french] = told(&test);
        verdicts.push(workshop.say([format!("{mode} against mis: {english}"), format!("{mode} et mis : {french}")]));
        numbers.insert((*mode).into(), of_test(&test));
    }
    let verdicts = verdicts.join(workshop.say(["; ", " ; "]));
    out.proof([format!("Block by block, {verdicts}."), format!("Bloc par bloc, {verdicts}.")]);
    out.number("modes", numbers);
    Ok(())
}

fn clamped(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Paths cut off", "Des chemins tronqués"]);
    out.text([
        "At most p segments: p = 1, 2, 3, 4, and all. What is cut off is missing, so the first four are biased.",
        "Au plus p segments : p = 1, 2, 3, 4, puis tous. Ce qui est tronqué manque : les quatre premières images sont biaisées.",
    ]);
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut brightness) = (Vec::new(), Vec::new());
    let whole = ["The box of spheres", "La boîte aux sphères"];
    let whole = workshop.shot(&stage, "path", samples, "path-whole", ["all", "tous"], whole)?;
    let mean = |film: &Film| film.mean()[1];
    for depth in 1..=4 {
        let integrator = format!("path:max_depth={depth}");
        let (caption, alt) = (
            format!("p = {depth}"),
            [
                format!("The box of spheres by paths of {depth} segments at most"),
                format!("La boîte aux sphères par des chemins de longueur {depth} au plus"),
            ],
        );
        let name = format!("path-depth-{depth}");
        let (picture, film) = workshop.shot(&stage, &integrator, samples, &name, [&*caption; 2], alt)?;
        brightness.push(mean(&film) / mean(&whole.1));
        row.push(picture);
    }
    row.push(whole.0);
    out.pictures(row);
    let shares: Vec<String> = brightness.iter().map(|b| format!("{:.1} %", 100.0 * b)).collect();
    out.proof([
        format!("Of the whole picture's light they have {}.", shares.join(", ")),
        format!("De la lumière de l'image entière, elles ont {}.", shares.join(" ; ")),
    ]);
    out.number("clamped", json!(brightness));
    Ok(())
}

fn roulette(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Russian roulette", "La roulette russe"]);
    out.formula(r"L \approx \begin{cases} L/q & \xi<q \\ 0 & \xi\ge q\end{cases}");
    out.text([
        "A path goes on with probability q and then counts 1/q: nothing is missing. The furnace reflects half of all \
         light and shines with radiance 1, so everything is 1/(1 − 1/2) = 2. Roulette from the first hit on:",
        "Un chemin continue avec la probabilité q et compte alors 1/q : rien ne manque. La fournaise réfléchit la moitié de toute lumière \
         et émet une radiance de 1 ; tout y vaut donc 1/(1 − 1/2) = 2. Roulette dès le premier impact :",
    ]);
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
        [
            "The furnace by implicit paths: mean (2 by theory), variance of one path, rays per path",
            "La fournaise par des chemins implicites : moyenne (2 en théorie), variance d'un chemin, rayons par chemin",
        ],
        &[["survival", "survie"], ["mean", "moyenne"], ["variance", "variance"], ["rays", "rayons"]],
        rows,
    );
    out.number("roulette", numbers);
    Ok(())
}

/// Each picture of the lecture's own paths.
fn classes(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Particular paths", "Des chemins particuliers"]);
    out.text([
        "By what happened from the light (L) to the eye (E): D is a diffuse reflection, S a mirror's, T light that \
         passes. The number of vertices counts both ends.",
        "Selon ce qui arrive de la lumière (L) à l'œil (E) : D est une réflexion diffuse, S celle d'un miroir, T la lumière qui traverse. \
         Le nombre de sommets compte les deux extrémités.",
    ]);
    let (stage, samples) = spheres(workshop)?;
    let (mut row, mut sum, mut numbers) = (Vec::new(), 0.0, serde_json::Map::new());
    for (name, paths, [caption, legend]) in [
        ("emission", "LE", ["emission, 2 vertices", "émission, 2 sommets"]),
        ("direct-diffuse", "LDE", ["direct diffuse, 3", "direct diffus, 3"]),
        ("direct-specular", "L(S|T)E", ["direct specular, 3", "direct spéculaire, 3"]),
        ("indirect-diffuse", "L(D|S|T)DE", ["indirect diffuse, one bounce, 4", "indirect diffus, un rebond, 4"]),
        (
            "indirect-specular",
            "L(D|S|T)(S|T)E",
            ["indirect specular, one bounce, 4", "indirect spéculaire, un rebond, 4"],
        ),
        ("caustic", "L(S|T)+DE", ["caustics", "caustiques"]),
        ("longer", "5..", ["5 vertices and more", "5 sommets et plus"]),
    ] {
        let integrator = format!("path:paths={paths}");
        let words = [format!("{caption}: `{paths}`"), format!("{legend} : `{paths}`")];
        let alt = [format!("The box of spheres, {caption}"), format!("La boîte aux sphères, {legend}")];
        let (picture, film) = workshop.shot(&stage, &integrator, samples, &format!("path-{name}"), words, alt)?;
        row.push(picture);
        numbers.insert(name.into(), film.mean()[1].into());
        // Caustics are in the others too.
        sum += if name == "caustic" { 0.0 } else { film.mean()[1] };
    }
    out.pictures(row);
    let (film, _) = workshop.film(&stage, &Shot::new("path", samples))?;
    let whole = film.mean()[1];
    let share = sum / whole;
    out.proof([
        format!("Without the caustics, which are among the others, they add up to {share:.7} of the whole picture's light."),
        format!(
            "Sans les caustiques, déjà comprises dans les autres, leur somme est {share:.7} fois la lumière de l'image entière."
        ),
    ]);
    numbers.insert("sum_over_whole".into(), share.into());
    out.number("classes", numbers);
    Ok(())
}

fn growing(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["What is slow about it", "Sa lenteur"]);
    out.text([
        "The noise falls with the root of the number of samples only; caustics and what lamps do not see keep it longest.",
        "Le bruit ne décroît que comme la racine du nombre d'échantillons ; les caustiques et ce que les lampes ne voient pas le gardent \
         le plus longtemps.",
    ]);
    let (stage, _) = spheres(workshop)?;
    let mut row = Vec::new();
    for samples in [1, 4, 16, 64, 256].into_iter().take(workshop.pick([2, 5, 5])) {
        let (picture, _) = workshop.shot(
            &stage,
            "path",
            samples,
            &format!("path-{samples}-spp"),
            [format!("paths per pixel: {samples}"), format!("chemins par pixel : {samples}")],
            [
                format!("The box of spheres with the noise of {} per pixel", counted(samples.into(), "path")),
                format!("La boîte aux sphères avec le bruit de {} par pixel", counted(samples.into(), "chemin")),
            ],
        )?;
        row.push(picture);
    }
    out.pictures(row);
    Ok(())
}
