//! Photons: the map seen directly, final gathering, and vertex connection and merging.

use super::Section;
use super::language::times;
use super::page::{Findings, Picture};
use super::workshop::{Shot, Workshop, png};
use crate::Failure;
use crate::judge::{Means, noise};
use crate::plot::{Axis, Chart, Curve, Legend, Mark};
use rebond::compare::Pair;
use rebond::film::{Film, Image};
use rebond::transport::estimator::log_log_slope;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "photons",
    title: ["Photon mapping", "Cartes de photons"],
    makes: "a map of 500 000 photons, 500 in each estimate; final gathering; error against photons; vertex connection and merging",
    sources: &[
        "crates/rebond/src/integrators/photon",
        "crates/rebond/src/transport/point_tree.rs",
        "crates/rebond/src/integrators/vcm.rs",
    ],
    run,
};

/// The map of the lecture.
const MAP: &str = "photon:photons=500000,nearest=500";

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    map(workshop, &mut out)?;
    errors(workshop, &mut out)?;
    merging(workshop, &mut out)?;
    Ok(out)
}

fn colours(film: &Film) -> Vec<[f32; 3]> {
    film.values().map(|v| v.mean.map(|x| x as f32)).collect()
}

/// The relMSE of a picture, without a share of its pixels, the worst.
fn error(reference: &Film, film: &Film, [width, height]: [u32; 2], trim: f64) -> Result<f64, Failure> {
    let (reference, film) = (colours(reference), colours(film));
    let pair = Pair::new(&reference, &film, width, height).map_err(|e| Failure::Run(e.to_string()))?;
    Ok(pair.rel_mse(trim))
}

fn map(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["500 000 photons, 500 in each estimate", "500 000 photons, 500 par estimation"]);
    out.formula(r"L_r(x,\omega_o)\approx\sum_{p=1}^{k} f_r(x,\omega_p,\omega_o)\,\frac{\Delta\Phi_p}{\Delta A},\qquad \Delta A=\pi r_k^2");
    out.text([
        "Photons leave the lights, each with its share of their power, and are stored in a kd-tree wherever they meet a surface that \
         does not merely mirror. The light at a point is that of the k nearest photons over the disk that holds them. It is smooth \
         where path tracing is grainy, caustics above all; but it is blurred over the disk, spotted where photons are few, and dark \
         in corners where the disk reaches beyond the surface. Final gathering looks at the map from one bounce away instead: direct \
         light is sampled, caustics have a map of their own, and the rest is gathered by directions over the hemisphere.",
        "Des photons quittent les lumières, chacun avec sa part de leur puissance, et sont rangés dans un arbre k-d partout où ils \
         rencontrent une surface qui n'est pas un simple miroir. La lumière en un point est celle des k photons les plus proches, \
         divisée par l'aire du disque qui les contient. L'image est lisse là où le tracé de chemins est bruité, surtout dans les \
         caustiques ; mais elle est floue à l'échelle du disque, tachetée là où les photons sont rares, et sombre dans les coins où \
         le disque dépasse la surface. La collecte finale (« final gathering ») regarde plutôt la carte un rebond plus loin : \
         l'éclairage direct est échantillonné, les caustiques ont leur propre carte, et le reste est recueilli par des directions \
         sur l'hémisphère.",
    ]);
    let stage = workshop.stage("cornell-spheres", workshop.pick([[24, 24], [192, 192], [512, 512]]))?;
    let [width, height] = stage.size();
    let map = workshop.pick(["photon:photons=5000,nearest=50", MAP, MAP]);
    let (seen, seen_film) = workshop.shot(
        &stage,
        map,
        workshop.pick([1, 4, 16]),
        "photons-map",
        ["the map, seen directly", "la carte, vue directement"],
        [
            "The box of spheres by the photon map: smooth, with spots of some centimetres",
            "La boîte aux sphères par la carte de photons : lisse, avec des taches de quelques centimètres",
        ],
    )?;
    let gathering = workshop.pick([
        "photon:photons=5000,nearest=50,gather=4",
        "photon:photons=500000,nearest=500,gather=16,precompute=true",
        "photon:photons=500000,nearest=500,gather=16,precompute=true",
    ]);
    let (gathered, gathered_film) = workshop.shot(
        &stage,
        gathering,
        workshop.pick([1, 4, 16]),
        "photons-gather",
        ["a final gather of 16 directions", "une collecte finale de 16 directions"],
        [
            "The box of spheres by final gathering: crisp, with a fine grain",
            "La boîte aux sphères par collecte finale : nette, avec un grain fin",
        ],
    )?;
    let samples = workshop.pick([64, 256, 1024]);
    let (paths, reference) = workshop.shot(
        &stage,
        "path",
        samples,
        "photons-path",
        [format!("path tracing, {samples} samples"), format!("tracé de chemins, {samples} échantillons")],
        [
            "The box of spheres by path tracing, with specks in its caustic",
            "La boîte aux sphères par tracé de chemins, avec des points brillants dans la caustique",
        ],
    )?;
    let shown = "photon:photons=20000,nearest=50,show=true";
    let film = workshop.film(&stage, &Shot::new(shown, 1))?.0.develop();
    let photons = Picture {
        name: "photons-stored".into(),
        png: png(&Image::from_rgb(width, height, &film.rgb("photons").unwrap_or_default()), -4.0)?,
        alt: workshop
            .say([
                "Dots on black, dense under the lamp and in a bright spot behind the ball of glass",
                "Des points sur fond noir, denses sous la lampe et dans une tache claire derrière la boule de verre",
            ])
            .into(),
        caption: workshop.say([
            format!("photons of 20 000 walks, where the eye sees them: layer of `-i {shown}`"),
            format!("les photons de 20 000 trajets, là où l'œil les voit : couche de `-i {shown}`"),
        ]),
        command: None,
    };
    out.pictures(vec![photons, seen, gathered, paths]);
    let reference = Means::of(&reference);
    let share = |film: &Film| Means::of(film).over(&reference);
    let [map, gather] = [share(&seen_film), share(&gathered_film)];
    let [[seen, seen_off], [gathered, gathered_off]] = [map, gather].map(|of| of.map(|x| 100.0 * x));
    out.proof([
        format!(
            "The map has {seen:.1} ± {seen_off:.1} % of the light of path tracing, which stores nothing; the gather has \
             {gathered:.1} ± {gathered_off:.1} %. The errors are those of the paths from the eye; the photons are drawn once."
        ),
        format!(
            "La carte a {seen:.1} ± {seen_off:.1} % de la lumière du tracé de chemins, qui ne stocke rien ; la collecte en a \
             {gathered:.1} ± {gathered_off:.1} %. Ces erreurs sont celles des chemins depuis l'œil ; les photons sont tirés une seule fois."
        ),
    ]);
    out.number(
        "light_over_path",
        json!({ "map": map[0], "gather": gather[0], "standard_errors": [map[1], gather[1]] }),
    );
    Ok(())
}

/// Fewer errors by more photons.
fn errors(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Error against photons", "L'erreur selon le nombre de photons"]);
    out.text([
        "The Cornell box against path tracing, without the worst 5 % of pixels (the lamp's edge). k grows as the root of the number \
         of photons N, so that the disk shrinks while there are ever more photons in it: the variance falls as 1/k = N^(−1/2), and so \
         does the disk's area, on which the blur depends. The gather's error hardly depends on the map: it is the noise of its \
         directions.",
        "La boîte de Cornell comparée au tracé de chemins, sans les 5 % de pixels les pires (le bord de la lampe). k croît comme la \
         racine du nombre de photons N, si bien que le disque rétrécit tout en contenant toujours plus de photons : la variance \
         décroît comme 1/k = N^(−1/2), tout comme l'aire du disque, dont dépend le flou. L'erreur de la collecte ne dépend guère de la carte : \
         c'est le bruit de ses directions.",
    ]);
    let size = workshop.pick([[16, 16], [64, 64], [96, 96]]);
    let stage = workshop.stage("cornell-box", size)?;
    let reference = workshop.film(&stage, &Shot { seed: 7, ..Shot::new("path", workshop.pick([256, 1024, 4096])) })?.0;
    let counts: &[(u32, u32)] = workshop.pick([
        &[(2_000, 12), (8_000, 25), (32_000, 50)][..],
        &[(2_000, 12), (8_000, 25), (32_000, 50), (128_000, 100), (512_000, 200)],
        &[(2_000, 12), (8_000, 25), (32_000, 50), (128_000, 100), (512_000, 200), (2_048_000, 400)],
    ]);
    let samples = workshop.pick([4, 8, 16]);
    let (mut curves, mut rows, mut numbers) = (Vec::new(), Vec::new(), serde_json::Map::new());
    for (color, (key, name, more)) in [
        ("map", workshop.say(["the map itself", "la carte elle-même"]), ""),
        ("gather", workshop.say(["final gather", "collecte finale"]), ",gather=8,precompute=true"),
    ]
    .into_iter()
    .enumerate()
    {
        let mut points = Vec::new();
        for (photons, nearest) in counts {
            let integrator = format!("photon:photons={photons},nearest={nearest}{more}");
            let (film, _) = workshop.film(&stage, &Shot::new(&integrator, samples))?;
            points.push([f64::from(*photons), error(&reference, &film, size, 0.05)?]);
        }
        let slope = log_log_slope(&points);
        let [first, last] = [points[0][1], points[points.len() - 1][1]];
        rows.push(vec![name.into(), format!("{first:.2e}"), format!("{last:.2e}"), format!("{slope:.2}")]);
        numbers.insert(key.into(), json!({ "points": points, "slope": slope }));
        curves.push(Curve { name: name.into(), mark: Mark::LineAndDots, color, points });
    }
    out.plot(
        "photons-error",
        Chart {
            title: workshop.say(["relMSE against the number of photons", "relMSE selon le nombre de photons"]).into(),
            x: Axis { label: workshop.say(["photons emitted", "photons émis"]), log: true, range: None },
            y: Axis { label: "relMSE", log: true, range: None },
            bands: vec![],
            curves,
            legend: Legend::UpperRight,
        },
        [
            "Two lines: the map's falls steadily, the gather's lies lower and falls less",
            "Deux lignes : celle de la carte descend régulièrement, celle de la collecte est plus basse et descend moins",
        ],
    );
    out.proof([
        format!(
            "From {} to {} photons the map's error falls from {} to {}: slope {}, where variance and area alone have −0.5.",
            counts[0].0,
            counts[counts.len() - 1].0,
            rows[0][1],
            rows[0][2],
            rows[0][3].replace('-', "−")
        ),
        format!(
            "De {} à {} photons, l'erreur de la carte passe de {} à {} : pente {}, là où la variance et l'aire seules donnent −0.5.",
            counts[0].0,
            counts[counts.len() - 1].0,
            rows[0][1],
            rows[0][2],
            rows[0][3].replace('-', "−")
        ),
    ]);
    out.number("errors", numbers);
    Ok(())
}

fn merging(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Vertex connection and merging", "Connexion et fusion de sommets"]);
    out.formula(r"p_{M}=p(y_0\ldots y)\;p(z\ldots z_0)\;N\pi r^2,\qquad |y-z|<r");
    out.text([
        "Both in one: a photon near a vertex of the eye's walk is one more way to find the path, with a density like every other, and \
         multiple importance sampling weighs connecting against merging. A lamp in a globe of glass, seen with its caustics in a mirror: \
         light that neither paths from the eye nor connections find but by chance.",
        "Les deux en un : un photon proche d'un sommet du sous-chemin de l'œil est une façon de plus de trouver le chemin, avec une densité \
         comme les autres, et l'échantillonnage préférentiel multiple pondère connexions et fusions. Une lampe dans un globe de verre, \
         vue avec ses caustiques dans un miroir : de la lumière que ni les chemins depuis l'œil ni les connexions ne trouvent, sinon par \
         hasard.",
    ]);
    let size = workshop.pick([[48, 36], [192, 144], [512, 384]]);
    let stage = workshop.stage("caustic-mirror", size)?;
    let long = Shot::new("vcm", workshop.pick([128, 128, 1024]));
    let reference = workshop.film(&stage, &Shot { seed: 11, ..long })?.0;
    let (mut row, mut rows, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for (integrator, samples) in workshop.pick([
        [("path", 32), ("bidirectional", 16), ("vcm", 16)],
        [("path", 96), ("bidirectional", 16), ("vcm", 16)],
        [("path", 384), ("bidirectional", 64), ("vcm", 64)],
    ]) {
        let shot = Shot::new(integrator, samples);
        let (film, statistics) = workshop.film(&stage, &shot)?;
        let (seconds, error) = (statistics.seconds, error(&reference, &film, size, 0.001)?);
        row.push(workshop.picture(
            &stage,
            &shot,
            &film,
            &format!("photons-mirror-{integrator}"),
            [
                format!("{integrator}, {samples} samples per pixel, {seconds:.2} s"),
                format!("{integrator}, {samples} échantillons par pixel, {seconds:.2} s"),
            ],
            [
                format!("A room with a lamp in a globe and its mirror image, by {integrator}"),
                format!("Une pièce avec une lampe dans un globe, et son reflet, par {integrator}"),
            ],
        )?);
        rows.push(vec![
            integrator.into(),
            samples.to_string(),
            format!("{seconds:.2}"),
            format!("{error:.3}"),
            format!("{:.3}", error * seconds),
        ]);
        found.push((seconds, error));
    }
    out.pictures(row);
    out.table(
        "photons-mirror",
        [
            "Against a long render by vcm, without the worst 0.1 % of pixels; less is better",
            "Par rapport à un rendu long par vcm, sans le 0.1 % de pixels les pires ; plus c'est petit, mieux c'est",
        ],
        &[
            ["estimator", "estimateur"],
            ["samples per pixel", "échantillons par pixel"],
            ["seconds", "secondes"],
            ["relMSE", "relMSE"],
            ["relMSE × seconds", "relMSE × secondes"],
        ],
        rows,
    );
    let [path, both_ends, vcm] = [found[0], found[1], found[2]];
    let gain = |of: (f64, f64)| of.0 * of.1 / (vcm.0 * vcm.1);
    let [[than_path, que_path], [than_both, que_both]] = [path, both_ends].map(|of| times(gain(of)));
    let noise = noise(&reference);
    // Where all find everything they must find the same.
    let small = workshop.stage("cornell-spheres", workshop.pick([[16, 16], [64, 64], [96, 96]]))?;
    let many = workshop.pick([64, 128, 512]);
    let of = |integrator, seed, samples| -> Result<Means, Failure> {
        Ok(Means::of(&workshop.film(&small, &Shot::new(integrator, samples).independent(seed))?.0))
    };
    let [ratio, off] = of("vcm", 31, many)?.over(&of("path", 32, 8 * many)?);
    out.proof([
        format!(
            "In the same time vcm has {than_path} than path tracing here, and {than_both} than bidirectional path tracing; each \
             error includes the reference's own noise, a relMSE of {noise:.3}. In the box of spheres its light over that of path \
             tracing is {ratio:.4} ± {off:.4}."
        ),
        format!(
            "À temps égal, vcm a ici {que_path} que le tracé de chemins, et {que_both} que le tracé bidirectionnel ; chaque erreur \
             contient celle du bruit de la référence, une relMSE de {noise:.3}. Dans la boîte aux sphères, sa lumière divisée par celle \
             du tracé de chemins vaut {ratio:.4} ± {off:.4}."
        ),
    ]);
    out.number(
        "merging",
        json!({ "rel_mse": { "path": path.1, "bidirectional": both_ends.1, "vcm": vcm.1 }, "equal_time_gain": gain(path),
            "over_path": ratio, "standard_error": off }),
    );
    Ok(())
}
