//! Direct light in pictures: shadows, Phong's lobe, linearity, factors of the integrand, seven samplings side by side.

use super::Section;
use super::page::{Findings, Picture};
use super::workshop::{Shot, Stage, Workshop, png};
use crate::Failure;
use crate::judge::{Means, of_test, verdict};
use rebond::film::Image;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "direct",
    title: "Direct light",
    makes: "shadows, Phong's lobe, sums of lights, factors of the integrand, seven samplings",
    run,
};

/// Each way to find light.
pub const SAMPLINGS: [&str; 7] = ["area", "solid-angle", "light", "cosine", "bsdf", "mis", "product"];

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
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
    out.heading("Point lights, with shadows and without");
    out.formula(r"L_o=\frac{I}{d^2}\,\frac{\rho}{\pi}\,V(x,\omega)\,(n\cdot\omega)");
    let (stage, samples) = points(workshop)?;
    let one = |i, words| workshop.shot(&stage, i, samples, words);
    let (without, a) = one(
        "direct:sampling=light,shadows=false",
        ["direct-no-shadows", "V = 1 everywhere", "Solids on a plane under three lights, without shadows"],
    )?;
    let (with, b) =
        one("direct:sampling=light", ["direct-shadows", "with V", "The same solids, each throwing its shadows"])?;
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
            alt: "The shadows alone, bright on black".into(),
            caption: "their difference: the light that shadows take".into(),
            command: None,
        },
    ]);
    out.proof(format!(
        "Of {} pixels {same} are the same to the last bit; {}.",
        difference.len(),
        if darker { "the others are darker with shadows, none is brighter" } else { "some are brighter with shadows" }
    ));
    out.number("shadows", json!({ "pixels": difference.len(), "same": same, "none_brighter": darker }));
    Ok(())
}

fn phong(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Phong's lobe under one point light");
    out.formula(r"L_o=\frac{I}{d^2}\,\frac{r+1}{2\pi}\,(\omega_o\cdot R(\omega))^r");
    let stage = workshop.stage("phong-lamp", workshop.pick([[48, 16], [480, 160], [960, 320]]))?;
    let samples = workshop.pick([4, 16, 64]);
    let (picture, _) = workshop.shot(
        &stage,
        "direct:sampling=light",
        samples,
        [
            "direct-phong",
            "From the left: diffuse; Phong of exponent 60 and of 300 as the lecture prints it; Phong of exponent 60 \
             in its energy-conserving form; Blinn-Phong of exponent 60",
            "Five balls in a row under one lamp: the first matt, the others with highlights of different width",
        ],
    )?;
    out.pictures(vec![picture]);
    Ok(())
}

fn linearity(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Light adds up");
    out.text("The picture under several lights is the sum of the pictures under each alone.");
    let (stage, samples) = points(workshop)?;
    let lights = stage.scene().emitters().len();
    let (mut row, mut parts) = (Vec::new(), Vec::new());
    for i in 0..lights {
        let integrator = format!("direct:light={i}");
        let words = [format!("direct-light-{i}"), format!("light {i}"), format!("The solids under light {i} alone")];
        let (picture, _) = workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?;
        row.push(picture);
        parts.push(workshop.film(&stage, &Shot::new(&integrator, samples).independent(100 + i as u64))?.0);
    }
    let words = ["direct-all-lights", "all of them", "The solids under all three lights"];
    row.push(workshop.shot(&stage, "direct", samples, words)?.0);
    out.pictures(row);
    // The whole with random numbers of its own, so that nothing but expectations can agree.
    let whole = workshop.film(&stage, &Shot::new("direct", 4 * samples).independent(99))?.0;
    let sum = Means::sum(&parts);
    let whole = Means::of(&whole);
    let test = sum.test(&whole, stage.size(), 8, 0.01);
    let ([a, a_error], [b, b_error]) = (sum.total(), whole.total());
    let (ratio, error) = (a / b, (a_error / b).hypot(a * b_error / (b * b)));
    out.proof(format!(
        "The sum of the single lights over the whole: {ratio:.5} ± {error:.5} over the picture. Welch's test, block \
         by block: {} of {} below 1 %, where chance makes {:.1}; {}.",
        test.below_alpha,
        test.tested,
        0.01 * test.tested as f64,
        verdict(&test)
    ));
    out.number(
        "linearity",
        json!({ "lights": lights, "ratio": ratio, "standard_error": error, "welch": of_test(&test) }),
    );
    Ok(())
}

fn factors(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("The factors of the integrand");
    let (stage, samples) = points(workshop)?;
    let mut row = Vec::new();
    for (factor, caption) in
        [("le", "Le: what the first light sends, I/d², three stops darker"), ("v", "V"), ("bsdf", "f_r cosθ")]
    {
        let integrator = format!("direct:sampling=light,light=0,factor={factor}");
        let words = [format!("direct-factor-{factor}"), caption.into(), format!("The factor {caption} alone")];
        row.push(workshop.shot(&stage, &integrator, samples, words.each_ref().map(String::as_str))?.0);
    }
    out.pictures(row);
    Ok(())
}

fn extended(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Extended lights, and many");
    let size = workshop.pick([[24, 16], [288, 192], [768, 512]]);
    let mut row = Vec::new();
    for (scene, caption, alt) in [
        ("veach-mis", "lamps of growing size", "Four plates that mirror four round lamps, from small to large"),
        ("many-lights", "13 788 lights", "A dragon on a plinth in a spiral of coloured lanterns"),
    ] {
        let stage = workshop.stage(scene, size)?;
        let name = format!("direct-{scene}");
        row.push(workshop.shot(&stage, "direct", workshop.pick([4, 32, 256]), [name.as_str(), caption, alt])?.0);
    }
    out.pictures(row);
    Ok(())
}

fn samplings(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("How to draw the samples");
    out.formula(r"\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i}{p(\omega_i)}");
    out.formula(r"\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i\cos\theta'}{d^2\,p(x_i)}");
    out.text(
        "Points of lights, by area, by solid angle, or by what they emit; directions, by the cosine or by f_r; one of \
         each, weighed by the power heuristic (mis); and one of 16 candidates, chosen in proportion to Le f_r cosθ \
         (product). 16 samples a pixel each.",
    );
    let size = workshop.pick([[24, 16], [192, 128], [384, 256]]);
    for (scene, what) in [("veach-mis", "Veach's plates"), ("sky", "the sphere and the trees under the sky")] {
        let stage = workshop.stage(scene, size)?;
        let mut row = Vec::new();
        for sampling in SAMPLINGS {
            let integrator = format!("direct:sampling={sampling}");
            let words = [
                format!("direct-{scene}-{sampling}"),
                format!("{scene}, {sampling}"),
                format!("Noise of {sampling} sampling on {what}"),
            ];
            row.push(workshop.shot(&stage, &integrator, 16, words.each_ref().map(String::as_str))?.0);
        }
        out.pictures(row);
    }
    Ok(())
}
