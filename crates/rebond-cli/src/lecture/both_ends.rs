//! Paths from the light, and from both ends: caustics by light tracing, and bidirectional path tracing beside path tracing.

use super::Section;
use super::page::Findings;
use super::workshop::{Shot, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test, verdict};
use rebond::compare::Pair;
use rebond::film::Film;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "both-ends",
    title: "From the light, and from both ends",
    makes: "light tracing, caustics; bidirectional path tracing of 25 paths beside 56 of path tracing; a room lit indirectly",
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"\hat I=\frac{1}{N}\sum_{i=1}^{N}\sum_{s,t} w_{s,t}(\bar x_{s,t})\,\frac{f(\bar x_{s,t})}{p_{s,t}(\bar x_{s,t})}");
    caustics(workshop, &mut out)?;
    rooms(workshop, &mut out)?;
    Ok(out)
}

fn caustics(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Light tracing");
    out.text(
        "Start at the light and connect each vertex to the eye: the roles of light and camera are exchanged. Caustics, which \
         paths from the eye meet by chance only, become easy; mirrors seen directly become impossible.",
    );
    let stage = workshop.stage("cornell-spheres", workshop.pick([[24, 24], [192, 192], [512, 512]]))?;
    let samples = workshop.pick([4, 64, 256]);
    let caustics = "paths=L(S|T)+DE";
    let (mut row, mut films) = (Vec::new(), Vec::new());
    for (name, caption) in [("path", "from the eye"), ("light", "from the light"), ("bidirectional", "from both ends")]
    {
        let words = [
            format!("ends-caustic-{name}"),
            format!("only caustics, {caption}"),
            format!("The caustics of the box of spheres alone, by paths {caption}"),
        ];
        let integrator = format!("{name}:{caustics}");
        row.push(workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?.0);
        let independent = Shot::new(&integrator, 4 * samples).independent(films.len() as u64 + 1);
        films.push(workshop.film(&stage, &independent)?.0);
    }
    out.pictures(row);
    let variance = |film: &Film| film.values().map(|v| v.variance[1]).sum::<f64>();
    let test = Means::of(&films[1]).test(&Means::of(&films[2]), stage.size(), workshop.pick([8, 16, 16]), 0.01);
    let ratio = variance(&films[0]) / variance(&films[1]);
    out.proof(format!(
        "From the light and from both ends: {} of {} blocks below 1 % by Welch's test, {}. For as many samples the variance of paths \
         from the eye is {ratio:.0} times that of paths from the light.",
        test.below_alpha,
        test.tested,
        verdict(&test)
    ));
    out.number("caustics", json!({ "welch": of_test(&test), "variance_ratio": ratio }));
    Ok(())
}

fn rooms(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("56 paths, or 25 from both ends");
    out.text(
        "A path of N vertices can be found in N − 1 ways with at least one vertex at each end; every connection of the two walks is one \
         of them, weighed by how likely each way was. A lamp that lights the ceiling only, a spotlight on a glass egg; and a room \
         whose lamp is next door.",
    );
    let size = workshop.pick([[24, 18], [240, 180], [512, 384]]);
    let mut rows = Vec::new();
    for (scene, title) in [("veach-bidir", "The ceiling lamp and the egg"), ("indirect-room", "The door ajar")] {
        let stage = workshop.stage(scene, size)?;
        let long = Shot::new("bidirectional", workshop.pick([64, 256, 4096])).independent(9);
        let (reference, _) = workshop.film(&stage, &long)?;
        let colours = |film: &Film| film.values().map(|v| v.mean.map(|x| x as f32)).collect::<Vec<_>>();
        let reference = colours(&reference);
        let mut row = Vec::new();
        for (integrator, samples) in [("path", 56), ("bidirectional", 25)] {
            let shot = Shot::new(integrator, samples);
            let (film, statistics) = workshop.film(&stage, &shot)?;
            let caption = format!("{integrator}, {samples} samples per pixel, {:.2} s", statistics.seconds);
            let alt = format!("{title} by {integrator}");
            row.push(workshop.picture(&stage, &shot, &film, &format!("ends-{scene}-{integrator}"), caption, alt)?);
            let pixels = colours(&film);
            let pair = Pair::new(&reference, &pixels, size[0], size[1]).map_err(|e| Failure::Run(e.to_string()))?;
            rows.push((scene, integrator, samples, statistics.seconds, pair.rel_mse(0.0)));
        }
        out.pictures(row);
    }
    out.table(
        "ends-errors",
        "Against a long bidirectional render; less is better",
        &["scene", "estimator", "samples per pixel", "seconds", "relMSE", "relMSE × seconds"],
        rows.iter()
            .map(|(scene, integrator, samples, seconds, error)| {
                let cells = [scene, integrator].map(|s| (*s).to_owned()).into_iter();
                let numbers = [format!("{seconds:.2}"), format!("{error:.3}"), format!("{:.3}", error * seconds)];
                cells.chain([samples.to_string()]).chain(numbers).collect()
            })
            .collect(),
    );
    let gain = |at: usize| rows[at].4 * rows[at].3 / (rows[at + 1].4 * rows[at + 1].3);
    out.proof(format!(
        "In the same time bidirectional path tracing has {:.1} times less error in the first room, and {:.1} times in the second.",
        gain(0),
        gain(2)
    ));
    out.number("equal_time_gain", json!({ "veach-bidir": gain(0), "indirect-room": gain(2) }));
    Ok(())
}
