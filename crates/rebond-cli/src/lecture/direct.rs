//! Direct light in pictures: shadows, Phong's lobe, linearity, factors of the integrand, seven samplings side by side.

use super::Section;
use super::language::told;
use super::page::{Findings, Picture};
use super::workshop::{Shot, Stage, Workshop, png};
use crate::Failure;
use crate::judge::{Means, of_test};
use rebond::film::Image;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "direct",
    title: ["Direct light", "Illumination directe"],
    makes: "shadows, Phong's lobe, sums of lights, factors of the integrand, seven samplings",
    sources: &["crates/rebond/src/integrators/direct.rs", "crates/rebond/src/emitter/light_sampler.rs"],
    run,
};

/// Each way to find light.
pub const SAMPLINGS: [&str; 7] = ["area", "solid-angle", "light", "cosine", "bsdf", "mis", "product"];

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(
        r"L_o=\int_{\Omega}L_e f_r V\cos\theta_i\,d\omega_i=\int_A L_e f_r V\cos\theta_i\frac{\cos\theta'}{d^2}\,dA",
    );
    shadows(workshop, &mut out)?;
    phong(workshop, &mut out)?;
    linearity(workshop, &mut out)?;
    factors(workshop, &mut out)?;
    extended(workshop, &mut out)?;
    samplings(workshop, &mut out)?;
    Ok(out)
}

fn points(workshop: &Workshop) -> Result<(Stage, u32), Failure> {
    let stage = workshop.stage("point-lights", workshop.pick([[32, 24], [256, 192], [512, 384]]))?;
    Ok((stage, workshop.pick([4, 16, 64])))
}

fn shadows(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Point lights, with shadows and without", "Lumières ponctuelles, avec et sans ombres"]);
    out.formula(r"L_o=\frac{I}{d^2}\,\frac{\rho}{\pi}\,V(x,\omega)\,(n\cdot\omega)");
    let (stage, samples) = points(workshop)?;
    let (without, a) = workshop.shot(
        &stage,
        "direct:sampling=light,shadows=false",
        samples,
        "direct-no-shadows",
        ["V = 1 everywhere", "V = 1 partout"],
        [
            "Solids on a plane under three lights, without shadows",
            "Des solides sur un plan sous trois lumières, sans ombres",
        ],
    )?;
    let (with, b) = workshop.shot(
        &stage,
        "direct:sampling=light",
        samples,
        "direct-shadows",
        ["with V", "avec V"],
        ["The same solids, each throwing its shadows", "Les mêmes solides, chacun avec ses ombres"],
    )?;
    let difference: Vec<[f32; 3]> =
        a.pixels().iter().zip(b.pixels()).map(|(a, b)| [0, 1, 2].map(|c| (a.mean()[c] - b.mean()[c]) as f32)).collect();
    let same = difference.iter().filter(|d| **d == [0.0; 3]).count();
    let darker = difference.iter().flatten().all(|d| *d >= 0.0);
    let [width, height] = stage.size();
    out.pictures(vec![
        without,
        with,
        Picture {
            name: "direct-shadows-alone".into(),
            png: png(&Image::from_rgb(width, height, &difference), 0.0)?,
            alt: workshop
                .say(["The shadows alone, bright on black", "Les ombres seules, claires sur fond noir"])
                .into(),
            caption: workshop
                .say([
                    "their difference: the light that shadows take",
                    "leur différence : la lumière que les ombres enlèvent",
                ])
                .into(),
            command: None,
        },
    ]);
    let pixels = difference.len();
    out.proof(if darker {
        [
            format!(
                "Of {pixels} pixels {same} are the same to the last bit; the others are darker with shadows, none is brighter."
            ),
            format!(
                "Sur {pixels} pixels, {same} sont les mêmes au bit près ; les autres sont plus sombres avec les ombres, aucun n'est plus \
                 clair."
            ),
        ]
    } else {
        [
            format!("Of {pixels} pixels {same} are the same to the last bit; some are brighter with shadows."),
            format!(
                "Sur {pixels} pixels, {same} sont les mêmes au bit près ; certains sont plus clairs avec les ombres."
            ),
        ]
    });
    out.number("shadows", json!({ "pixels": pixels, "same": same, "none_brighter": darker }));
    Ok(())
}

fn phong(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Phong's lobe under one point light", "Le lobe de Phong sous une lumière ponctuelle"]);
    out.formula(r"L_o=\frac{I}{d^2}\,\frac{r+1}{2\pi}\,(\omega_o\cdot R(\omega))^r");
    let stage = workshop.stage("phong-lamp", workshop.pick([[48, 16], [480, 160], [960, 320]]))?;
    let samples = workshop.pick([4, 16, 64]);
    let (picture, _) = workshop.shot(
        &stage,
        "direct:sampling=light",
        samples,
        "direct-phong",
        [
            "From the left: diffuse; Phong of exponent 60 and of 300 as the lecture prints it; Phong of exponent 60 \
             in its energy-conserving form; Blinn-Phong of exponent 60",
            "De gauche à droite : diffus ; Phong d'exposant 60 et 300 tel que le cours l'écrit ; Phong d'exposant 60 dans sa forme \
             qui conserve l'énergie ; Blinn-Phong d'exposant 60",
        ],
        [
            "Five balls in a row under one lamp: the first matt, the others with highlights of different width",
            "Cinq boules en rang sous une lampe : la première mate, les autres avec des reflets de largeurs différentes",
        ],
    )?;
    out.pictures(vec![picture]);
    Ok(())
}

fn linearity(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Light adds up", "La lumière s'additionne"]);
    out.text([
        "The picture under several lights is the sum of the pictures under each alone.",
        "L'image sous plusieurs lumières est la somme des images sous chacune d'elles.",
    ]);
    let (stage, samples) = points(workshop)?;
    let lights = stage.scene().emitters().len();
    let (mut row, mut parts) = (Vec::new(), Vec::new());
    for i in 0..lights {
        let integrator = format!("direct:light={i}");
        let (picture, _) = workshop.shot(
            &stage,
            &integrator,
            samples,
            &format!("direct-light-{i}"),
            [format!("light {i}"), format!("lumière {i}")],
            [format!("The solids under light {i} alone"), format!("Les solides sous la seule lumière {i}")],
        )?;
        row.push(picture);
        parts.push(workshop.film(&stage, &Shot::new(&integrator, samples).independent(100 + i as u64))?.0);
    }
    let (all, _) = workshop.shot(
        &stage,
        "direct",
        samples,
        "direct-all-lights",
        ["all of them", "toutes ensemble"],
        ["The solids under all three lights", "Les solides sous les trois lumières"],
    )?;
    row.push(all);
    out.pictures(row);
    // The whole with random numbers of its own, so that nothing but expectations can agree.
    let whole = workshop.film(&stage, &Shot::new("direct", 4 * samples).independent(99))?.0;
    let sum = Means::sum(&parts);
    let whole = Means::of(&whole);
    let test = sum.test(&whole, stage.size(), 8, 0.01);
    let ([a, a_error], [b, b_error]) = (sum.total(), whole.total());
    let (ratio, error) = (a / b, (a_error / b).hypot(a * b_error / (b * b)));
    let ([english, french], by_chance) = (told(&test), 0.01 * test.tested as f64);
    out.proof([
        format!(
            "The sum of the single lights over the whole: {ratio:.5} ± {error:.5} over the picture. Block by block: {english}, where \
             chance makes {by_chance:.1}."
        ),
        format!(
            "La somme des lumières seules divisée par le tout : {ratio:.5} ± {error:.5} sur l'image. Bloc par bloc : {french}, là où le \
             hasard en donne {by_chance:.1}."
        ),
    ]);
    out.number(
        "linearity",
        json!({ "lights": lights, "ratio": ratio, "standard_error": error, "welch": of_test(&test) }),
    );
    Ok(())
}

fn factors(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["The factors of the integrand", "Les facteurs de l'intégrande"]);
    let (stage, samples) = points(workshop)?;
    let mut row = Vec::new();
    for (factor, caption, legend) in [
        (
            "le",
            "Le: what the first light sends, I/d², three stops darker",
            "Le : ce qu'envoie la première lumière, I/d², assombri de trois crans",
        ),
        ("v", "V: whether it arrives", "V : si elle arrive"),
        ("bsdf", "f_r cosθ: what is reflected", "f_r cosθ : ce qui est réfléchi"),
    ] {
        let (picture, _) = workshop.shot(
            &stage,
            &format!("direct:sampling=light,light=0,factor={factor}"),
            samples,
            &format!("direct-factor-{factor}"),
            [caption, legend],
            [format!("One factor alone, {caption}"), format!("Un facteur seul, {legend}")],
        )?;
        row.push(picture);
    }
    out.pictures(row);
    Ok(())
}

fn extended(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Extended lights, and many", "Lumières étendues, et nombreuses"]);
    let size = workshop.pick([[24, 16], [288, 192], [768, 512]]);
    let mut row = Vec::new();
    for (scene, caption, alt) in [
        (
            "veach-mis",
            ["lamps of growing size", "des lampes de taille croissante"],
            [
                "Four plates that mirror four round lamps, from small to large",
                "Quatre plaques qui reflètent quatre lampes rondes, de la petite à la grande",
            ],
        ),
        (
            "many-lights",
            ["13 788 lights", "13 788 lumières"],
            [
                "A dragon on a plinth in a spiral of coloured lanterns",
                "Un dragon sur un socle dans une spirale de lanternes colorées",
            ],
        ),
    ] {
        let stage = workshop.stage(scene, size)?;
        let name = format!("direct-{scene}");
        row.push(workshop.shot(&stage, "direct", workshop.pick([4, 32, 256]), &name, caption, alt)?.0);
    }
    out.pictures(row);
    Ok(())
}

fn samplings(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["How to draw the samples", "Comment tirer les échantillons"]);
    out.formula(r"\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i}{p(\omega_i)}");
    out.formula(r"\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i\cos\theta'}{d^2\,p(x_i)}");
    out.text([
        "Points of lights, by area, by solid angle, or by what they emit; directions, by the cosine or by f_r; one of \
         each, weighed by the power heuristic (mis); and one of 16 candidates, chosen in proportion to Le f_r cosθ \
         (product). 16 samples a pixel each.",
        "Des points des lumières, selon l'aire, selon l'angle solide, ou selon ce qu'ils émettent (area, solid-angle, light) ; des \
         directions, selon le cosinus ou selon f_r (cosine, bsdf) ; un de chaque, pondérés par l'heuristique de puissance (mis) ; et un \
         parmi 16 candidats, choisi en proportion de Le f_r cosθ (product). 16 échantillons par pixel pour chacun.",
    ]);
    let size = workshop.pick([[24, 16], [192, 128], [384, 256]]);
    for (scene, what, quoi) in [
        ("veach-mis", "Veach's plates", "les plaques de Veach"),
        ("sky", "the sphere and the trees under the sky", "la sphère et les arbres sous le ciel"),
    ] {
        let stage = workshop.stage(scene, size)?;
        let mut row = Vec::new();
        for sampling in SAMPLINGS {
            let integrator = format!("direct:sampling={sampling}");
            let name = format!("direct-{scene}-{sampling}");
            let caption = format!("{scene}, {sampling}");
            let alt = [
                format!("Noise of {sampling} sampling on {what}"),
                format!("Le bruit de l'échantillonnage {sampling} sur {quoi}"),
            ];
            row.push(workshop.shot(&stage, &integrator, 16, &name, [&*caption; 2], alt)?.0);
        }
        out.pictures(row);
    }
    Ok(())
}
