//! Seven samplings of direct light on three scenes: their variance, its bound, their cost, and whether they agree.

use super::Section;
use super::direct::SAMPLINGS;
use super::page::Findings;
use super::workshop::{Shot, Stage, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test, verdict};
use rebond::compare::Welch;
use serde_json::{Map, Value, json};

pub const SECTION: Section = Section {
    name: "direct-errors",
    title: ["Samplings of direct light, measured", "Échantillonner l'illumination directe : mesures"],
    makes: "a table: the variance of seven samplings on three scenes, the bound of MIS, cost, agreement",
    sources: &["crates/rebond/src/integrators/direct.rs", "crates/rebond/src/transport/mod.rs"],
    run,
};

/// What a sampling did on a scene.
struct Row {
    /// The variance of one sample over the squared mean (+ 0.01), averaged over pixels and channels.
    variance: f64,
    /// The same of the squared mean itself.
    squares: f64,
    /// Seconds for a million samples.
    seconds: f64,
    test: Welch,
}

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.text([
        "Independent samples. Variance is that of one sample, over the squared mean of its pixel (+ 0.01), averaged \
         over the picture: the relMSE of N samples is this over N. Pixels at or beside which a lamp itself shows are \
         left out: their noise is that of its edge, and the same for all. Agreement with path tracing cut off at two \
         segments is judged by Welch's test on small pictures, all rows together at 1 %.",
        "Des échantillons indépendants. La variance est celle d'un seul échantillon, divisée par le carré de la moyenne de son pixel \
         (+ 0.01), en moyenne sur l'image : la relMSE de N échantillons est cette valeur divisée par N. Les pixels où une lampe est visible, et leurs \
         voisins, sont écartés : leur bruit est celui de son bord, le même pour tous. L'accord avec le tracé de chemins tronqué à deux \
         segments est jugé par le test de Welch sur de petites images, toutes les lignes ensemble à 1 %.",
    ]);
    let (mut rows, mut numbers) = (Vec::new(), Map::new());
    for scene in ["veach-mis", "many-lights", "sky"] {
        let found = errors(workshop, scene)?;
        let (mis, light, bsdf) = (&found[5], &found[2], &found[4]);
        let best = found.iter().map(|r| r.variance).fold(f64::INFINITY, f64::min);
        let bound = |r: &Row| r.variance + 0.5 * (r.squares + r.variance);
        let bound = bound(light).min(bound(bsdf));
        let mut object = Map::new();
        for (sampling, r) in SAMPLINGS.iter().zip(&found) {
            rows.push(vec![
                format!("{scene}, {sampling}"),
                format!("{:.4}", r.variance),
                format!("{:.2}", r.variance / mis.variance),
                format!("{:.2}", r.seconds),
                format!("{:.2}", r.variance * r.seconds / (mis.variance * mis.seconds)),
                workshop.say([verdict(&r.test), if r.test.passes() { "accord" } else { "désaccord" }]).into(),
            ]);
            let one = json!({ "variance": r.variance, "seconds_per_million": r.seconds, "welch": of_test(&r.test) });
            object.insert(sampling.to_string(), one);
        }
        object.insert("bound_of_mis".into(), json!(bound));
        object.insert("mis_is_best".into(), json!(mis.variance <= best));
        numbers.insert(scene.into(), Value::Object(object));
        let [by_mis, by_light, by_bsdf] = [mis.variance, light.variance, bsdf.variance];
        out.proof([
            format!(
                "{scene}: variance {by_mis:.4} by mis, {by_light:.4} by light, {by_bsdf:.4} by bsdf; theory allows mis {bound:.4}, half \
                 of the second moment more than the better of the two."
            ),
            format!(
                "{scene} : variance {by_mis:.4} par mis, {by_light:.4} par light, {by_bsdf:.4} par bsdf ; la théorie accorde {bound:.4} \
                 à mis, soit la moitié du second moment de plus que le meilleur des deux."
            ),
        ]);
    }
    out.formula(r"\sigma^2_{mis}\le\min(\sigma^2_{light},\sigma^2_{bsdf})+\tfrac12\mu^2");
    out.text([
        "The bound is that of Veach (1997, second theorem of chapter 9) for the balance heuristic with one sample of each of two \
         kinds, and holds for the power heuristic with β = 2 too: Σ w²/p = (p₁³ + p₂³)/(p₁² + p₂²)² is nowhere above \
         1/p₁ or 1/p₂. It holds at every point; over a pixel μ² is its mean square, which its squared mean and any of \
         the variances bound together.",
        "La borne est celle de Veach (1997, second théorème du chapitre 9) pour l'heuristique de la balance avec un échantillon de \
         chacune des deux sortes ; elle vaut aussi pour l'heuristique de puissance avec β = 2 : Σ w²/p = (p₁³ + p₂³)/(p₁² + p₂²)² ne \
         dépasse nulle part 1/p₁ ni 1/p₂. Elle vaut en chaque point ; sur un pixel, μ² est la moyenne de son carré, que le carré de la \
         moyenne et n'importe laquelle des variances bornent ensemble.",
    ]);
    out.table(
        "direct-errors",
        [
            "Variance of one sample, alone and times its cost, and agreement",
            "Variance d'un échantillon, seule et fois son coût, et accord",
        ],
        &[
            ["sampling", "échantillonnage"],
            ["variance", "variance"],
            ["÷ mis", "÷ mis"],
            ["s per M samples", "s par M d'échantillons"],
            ["× time, ÷ mis", "× temps, ÷ mis"],
            ["agreement with path", "accord avec path"],
        ],
        rows,
    );
    out.number("scenes", numbers);
    Ok(out)
}

fn errors(workshop: &Workshop, scene: &str) -> Result<Vec<Row>, Failure> {
    let stage = workshop.stage(scene, workshop.pick([[24, 16], [96, 64], [192, 128]]))?;
    let samples = workshop.pick([16, 128, 512]);
    let reference = workshop.film(&stage, &Shot { seed: 5, ..Shot::new("direct", workshop.pick([64, 512, 2048])) })?.0;
    let dark = dark(workshop, &stage)?;
    // Small pictures, so that each pixel can have many samples.
    let small = workshop.stage(scene, [24, 16])?;
    let many = workshop.pick([256, 32_768, 32_768]);
    // Few samples find the smallest lamps by chance: only all pixels together have enough to be judged by.
    let (block, level) = (workshop.pick([24, 24, 8]), 0.01 / (3 * SAMPLINGS.len()) as f64);
    let path = Means::of(&workshop.film(&small, &Shot::new("path:max_depth=2", many).independent(300))?.0);
    let one = |(i, sampling): (usize, &&str)| {
        let integrator = format!("direct:sampling={sampling}");
        let (film, statistics) = workshop.film(&stage, &Shot::new(&integrator, samples).independent(200 + i as u64))?;
        let (long, _) = workshop.film(&small, &Shot::new(&integrator, many).independent(310 + i as u64))?;
        let pairs = || {
            dark.iter().flat_map(|i| {
                let (variance, mean) = (film.pixels()[*i].variance(), reference.pixels()[*i].mean());
                [0, 1, 2].map(|c| (variance[c], mean[c] * mean[c]))
            })
        };
        let count = 3.0 * dark.len() as f64;
        Ok(Row {
            variance: pairs().map(|(v, square)| v / (square + 0.01)).sum::<f64>() / count,
            squares: pairs().map(|(_, square)| square / (square + 0.01)).sum::<f64>() / count,
            seconds: 1e6 * statistics.seconds / statistics.samples as f64,
            test: Means::of(&long).test(&path, small.size(), block, level),
        })
    };
    SAMPLINGS.iter().enumerate().map(one).collect()
}

/// The pixels in and near which no lamp shows.
fn dark(workshop: &Workshop, stage: &Stage) -> Result<Vec<usize>, Failure> {
    let lamps = workshop.film(stage, &Shot::new("path:max_depth=1", workshop.pick([64, 256, 1024])))?.0;
    let [width, height] = stage.size().map(|n| n as usize);
    let shows = |i: usize| lamps.pixels()[i].mean().iter().any(|x| *x > 0.0);
    // Filters reach no farther.
    let near = |i: usize| {
        let (x, y) = (i % width, i / width);
        let rows = y.saturating_sub(2)..(y + 3).min(height);
        rows.flat_map(|y| (x.saturating_sub(2)..(x + 3).min(width)).map(move |x| y * width + x)).any(shows)
    };
    Ok((0..width * height).filter(|i| !near(*i)).collect())
}
