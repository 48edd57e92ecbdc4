//! Paths from the light, and from both ends: caustics by light tracing, and bidirectional path tracing beside path tracing.

use super::Section;
use super::language::{times, told};
use super::page::Findings;
use super::workshop::{Shot, Workshop};
use crate::Failure;
use crate::judge::{Means, noise, of_test};
use rebond::compare::Pair;
use rebond::film::Film;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "both-ends",
    title: ["From the light, and from both ends", "Depuis la lumière, et depuis les deux extrémités"],
    makes: "light tracing, caustics; bidirectional path tracing of 25 paths beside 56 of path tracing; a room lit indirectly",
    sources: &[
        "crates/rebond/src/integrators/light.rs",
        "crates/rebond/src/integrators/bidirectional.rs",
        "crates/rebond/src/transport/ways.rs",
    ],
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"\hat I=\frac{1}{N}\sum_{i=1}^{N}\sum_{s,t} w_{s,t}(\bar x_{s,t})\,\frac{f(\bar x_{s,t})}{p_{s,t}(\bar x_{s,t})}");
    caustics(workshop, &mut out)?;
    rooms(workshop, &mut out)?;
    Ok(out)
}

fn caustics(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Light tracing", "Le tracé depuis la lumière"]);
    out.text([
        "Start at the light and connect each vertex to the eye: the roles of light and camera are exchanged. Caustics, which \
         paths from the eye meet by chance only, become easy; mirrors seen directly become impossible.",
        "On part de la lumière et on relie chaque sommet à l'œil : les rôles de la lumière et de la caméra sont échangés. Les \
         caustiques, que les chemins depuis l'œil ne rencontrent que par hasard, deviennent faciles ; les miroirs vus directement \
         deviennent impossibles.",
    ]);
    let stage = workshop.stage("cornell-spheres", workshop.pick([[24, 24], [192, 192], [512, 512]]))?;
    let samples = workshop.pick([4, 32, 256]);
    let caustics = "paths=L(S|T)+DE";
    let (mut row, mut films) = (Vec::new(), Vec::new());
    for (name, from, depuis) in [
        ("path", "from the eye", "depuis l'œil"),
        ("light", "from the light", "depuis la lumière"),
        ("bidirectional", "from both ends", "depuis les deux extrémités"),
    ] {
        let integrator = format!("{name}:{caustics}");
        let (picture, _) = workshop.shot(
            &stage,
            &integrator,
            samples,
            &format!("ends-caustic-{name}"),
            [format!("only caustics, {from}"), format!("les caustiques seules, {depuis}")],
            [
                format!("The caustics of the box of spheres alone, by paths {from}"),
                format!("Les caustiques seules de la boîte aux sphères, par des chemins tracés {depuis}"),
            ],
        )?;
        row.push(picture);
        let independent = Shot::new(&integrator, 4 * samples).independent(films.len() as u64 + 1);
        films.push(workshop.film(&stage, &independent)?.0);
    }
    out.pictures(row);
    let variance = |film: &Film| film.values().map(|v| v.variance[1]).sum::<f64>();
    let test = Means::of(&films[1]).test(&Means::of(&films[2]), stage.size(), workshop.pick([8, 16, 16]), 0.01);
    let ratio = variance(&films[0]) / variance(&films[1]);
    let [english, french] = told(&test);
    out.proof([
        format!(
            "From the light and from both ends: {english}. For as many samples the variance of paths from the eye is {ratio:.0} \
             times that of paths from the light."
        ),
        format!(
            "Depuis la lumière et depuis les deux extrémités : {french}. À nombre d'échantillons égal, la variance des chemins depuis l'œil est \
             {ratio:.0} fois celle des chemins depuis la lumière."
        ),
    ]);
    out.number("caustics", json!({ "welch": of_test(&test), "variance_ratio": ratio }));
    Ok(())
}

fn rooms(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["56 paths, or 25 from both ends", "56 chemins, ou 25 depuis les deux extrémités"]);
    out.text([
        "A path of N vertices can be found in N − 1 ways with at least one vertex at each end; every connection of the two walks is one \
         of them, weighed by how likely each way was. A lamp that lights the ceiling only, a spotlight on a glass egg; and a room \
         whose lamp is next door.",
        "Un chemin de N sommets peut être trouvé de N − 1 façons avec au moins un sommet à chaque extrémité ; chaque connexion des deux \
         sous-chemins en est une, pondérée selon la probabilité de chaque façon. Une lampe qui n'éclaire que le plafond, un projecteur sur \
         un œuf de verre ; puis une pièce dont la lampe est dans la pièce voisine.",
    ]);
    let size = workshop.pick([[24, 18], [192, 144], [512, 384]]);
    let mut rows = Vec::new();
    for (scene, title, titre) in [
        ("veach-bidir", "The ceiling lamp and the egg", "La lampe vers le plafond et l'œuf"),
        ("indirect-room", "The door ajar", "La porte entrouverte"),
    ] {
        let stage = workshop.stage(scene, size)?;
        let long = Shot::new("bidirectional", workshop.pick([64, 128, 4096])).independent(9);
        let (reference, _) = workshop.film(&stage, &long)?;
        let colours = |film: &Film| film.values().map(|v| v.mean.map(|x| x as f32)).collect::<Vec<_>>();
        let (noise, reference) = (noise(&reference), colours(&reference));
        let mut row = Vec::new();
        for (integrator, samples) in [("path", 56), ("bidirectional", 25)] {
            let shot = Shot::new(integrator, samples);
            let (film, statistics) = workshop.film(&stage, &shot)?;
            let seconds = statistics.seconds;
            let caption = [
                format!("{integrator}, {samples} samples per pixel, {seconds:.2} s"),
                format!("{integrator}, {samples} échantillons par pixel, {seconds:.2} s"),
            ];
            let alt = [format!("{title} by {integrator}"), format!("{titre} par {integrator}")];
            row.push(workshop.picture(&stage, &shot, &film, &format!("ends-{scene}-{integrator}"), caption, alt)?);
            let pixels = colours(&film);
            let pair = Pair::new(&reference, &pixels, size[0], size[1]).map_err(|e| Failure::Run(e.to_string()))?;
            // The reference is noisy too, on its own.
            rows.push((scene, integrator, samples, seconds, pair.rel_mse(0.0) - noise));
        }
        out.pictures(row);
    }
    out.table(
        "ends-errors",
        [
            "Against a long bidirectional render, less that one's own noise; less is better",
            "Par rapport à un rendu long bidirectionnel, moins le bruit de celui-ci ; plus c'est petit, mieux c'est",
        ],
        &[
            ["scene", "scène"],
            ["estimator", "estimateur"],
            ["samples per pixel", "échantillons par pixel"],
            ["seconds", "secondes"],
            ["relMSE", "relMSE"],
            ["relMSE × seconds", "relMSE × secondes"],
        ],
        rows.iter()
            .map(|(scene, integrator, samples, seconds, error)| {
                let cells = [scene, integrator].map(|s| (*s).to_owned()).into_iter();
                let numbers = [format!("{seconds:.2}"), format!("{error:.3}"), format!("{:.3}", error * seconds)];
                cells.chain([samples.to_string()]).chain(numbers).collect()
            })
            .collect(),
    );
    let gain = |at: usize| rows[at].4 * rows[at].3 / (rows[at + 1].4 * rows[at + 1].3);
    let (first, second) = (gain(0), gain(2));
    let [[here, ici], [there, la]] = [first, second].map(times);
    out.proof([
        format!(
            "In the same time bidirectional path tracing has {here} than path tracing in the first room, and {there} in the second."
        ),
        format!(
            "À temps égal, le tracé bidirectionnel a {ici} que le tracé de chemins dans la première pièce, et {la} dans la seconde."
        ),
    ]);
    out.number("equal_time_gain", json!({ "veach-bidir": first, "indirect-room": second }));
    Ok(())
}
