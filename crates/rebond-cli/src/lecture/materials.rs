//! Materials in pictures: the two readings of Phong's lobe, mirrors, anisotropy, and a table in place of a formula.

use super::Section;
use super::page::Findings;
use super::workshop::Workshop;
use crate::Failure;
use crate::bsdf::open;
use crate::lobe_plot::{self, Plot};
use rebond::bsdf::capture::{CaptureSettings, capture, error};
use rebond::bsdf::check::Effort;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "materials",
    title: "Materials",
    makes: "Phong of r = 60 and 300 as a blurred mirror, and a mirror of a blurred light; a gallery, anisotropic ones in it",
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"f_r(\omega_i,\omega_o)=f_r(\omega_o,\omega_i),\qquad \int_{\Omega} f_r\cos\theta_i\,d\omega_i\le 1");
    claims(workshop, &mut out)?;
    readings(workshop, &mut out)?;
    gallery(workshop, &mut out)?;
    table(workshop, &mut out)?;
    Ok(out)
}

/// Who is a BRDF?
fn claims(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("What a BRDF must be");
    out.formula(r"f_r=\frac{r+1}{2\pi}\,\frac{(\omega_r\cdot\omega_o)^r}{\omega_i\cdot n}");
    out.text(
        "Reciprocal, never negative, and no source of light. Phong's lobe as the lecture prints it, divided by the cosine, breaks \
         two of these rules; in the form that rebond uses unless told otherwise it keeps them.",
    );
    let pairs = workshop.pick([500, 5000, 20_000]);
    let effort = Effort { pairs, albedo_samples: pairs, chi2_samples: 10_000, seed: workshop.seed(1) };
    let (mut rows, mut numbers) = (Vec::new(), serde_json::Map::new());
    for text in [
        "diffuse:reflectance=1",
        "phong:form=lecture,exponent=60,reflectance=1",
        "phong:exponent=60,reflectance=1",
        "blinn-phong:form=lecture,exponent=60,reflectance=1",
        "blinn-phong:exponent=60,reflectance=1",
        "ashikhmin-shirley:exponent_u=400,exponent_v=20",
    ] {
        let report = open(text)?.check(&effort);
        let yes = |holds: bool| if holds { "yes" } else { "no" }.to_owned();
        rows.push(vec![
            text.into(),
            yes(report.is_positive()),
            yes(report.is_reciprocal()),
            yes(report.conserves_energy()),
            format!("{:.3} at {:.0}°", report.energy.largest.mean, report.energy.largest.at.theta),
        ]);
        numbers.insert(
            text.into(),
            json!({ "reciprocal": report.is_reciprocal(), "conserves_energy": report.conserves_energy(),
                "largest_albedo": report.energy.largest.mean }),
        );
    }
    out.table(
        "materials-claims",
        "Random pairs of directions, and albedos over the hemisphere; each by `rebond bsdf MATERIAL`",
        &["material", "positive", "reciprocal", "conserves energy", "largest albedo"],
        rows,
    );
    let material = open("ashikhmin-shirley:exponent_u=400,exponent_v=20")?;
    out.drawing(
        "materials-anisotropic",
        lobe_plot::svg(&material, "An anisotropic lobe: Ashikhmin and Shirley, exponents 400 and 20", Plot::Hemisphere),
        "Hemispheres from above: a highlight that is long in one direction and narrow in the other",
        "Alone: rebond bsdf ashikhmin-shirley:exponent_u=400,exponent_v=20 -o lobe.svg",
    );
    out.number("claims", numbers);
    Ok(())
}

fn readings(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Phong twice: a blurred mirror, or a mirror of a blurred light");
    let size = workshop.pick([[32, 18], [320, 180], [800, 450]]);
    let samples = workshop.pick([4, 48, 256]);
    let mut row = Vec::new();
    let mut brightness = Vec::new();
    for (scene, caption) in [
        ("phong-60", "r = 60, sharp window"),
        ("phong-60-blurred-light", "a mirror, the window blurred by r = 60"),
        ("phong-300", "r = 300, sharp window"),
        ("phong-300-blurred-light", "a mirror, the window blurred by r = 300"),
    ] {
        let stage = workshop.stage(scene, size)?;
        let (name, alt) = (format!("materials-{scene}"), format!("A ball and a turned ball on a table: {caption}"));
        let (picture, film) = workshop.shot(&stage, "direct", samples, [&name, caption, &alt])?;
        brightness.push(film.mean()[1]);
        row.push(picture);
    }
    out.pictures(row);
    out.proof(format!(
        "The brightness of the two readings differs by {:+.2} % for r = 60 and {:+.2} % for r = 300.",
        100.0 * (brightness[1] / brightness[0] - 1.0),
        100.0 * (brightness[3] / brightness[2] - 1.0)
    ));
    out.number("readings", json!(brightness));
    Ok(())
}

fn gallery(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("A gallery");
    let stage = workshop.stage("material-gallery", workshop.pick([[64, 31], [640, 310], [1280, 620]]))?;
    let (picture, _) = workshop.shot(
        &stage,
        "path",
        workshop.pick([2, 32, 256]),
        [
            "materials-gallery",
            "Eighteen materials: diffuse and coated behind, textbook lobes and metals in the middle, metal and glass in front",
            "Balls of eighteen materials in three rows",
        ],
    )?;
    out.pictures(vec![picture]);
    Ok(())
}

/// The table of the lecture, and what it gets wrong.
fn table(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("A table in place of a formula");
    out.formula(r"f_r[\theta_i][\phi_i][\theta_o][\phi_o][c]");
    out.text(
        "Any material that neither mirrors nor transmits can be tabulated. A table of few angles misses the lobe; a fine one is \
         large. `rebond capture` makes it, and measures what it gets wrong.",
    );
    let material = open("phong:exponent=20")?;
    let (mut rows, mut errors) = (Vec::new(), Vec::new());
    for n in workshop.pick([vec![8, 16], vec![8, 16, 32, 64], vec![8, 16, 32, 64, 90]]) {
        // Of an isotropic material one azimuth of the light is enough.
        let settings = CaptureSettings { size: [n, 1, n, n], samples: 0, noise: 0.0, seed: workshop.seed(0) };
        let refuse = |e: String| Failure::usage(e, "tabulate another material");
        let captured = capture(&material, &settings).map_err(refuse)?;
        let found = error(&material, &captured, workshop.pick([8, 32, 64]), workshop.seed(0)).map_err(refuse)?;
        let kilobytes = f64::from(n).powi(3) * 12.0 / 1e3;
        rows.push(vec![
            format!("{n} × 1 × {n} × {n}"),
            format!("{kilobytes:.0} kB"),
            format!("{:.2} %", 100.0 * found.rms),
        ]);
        errors.push([f64::from(n), found.rms]);
    }
    let [first, last] = [errors[0], errors[errors.len() - 1]];
    out.table(
        "materials-table",
        "Phong's lobe of exponent 20, tabulated",
        &["angles θi × φi × θo × φo", "size", "root of the mean square error"],
        rows,
    );
    out.proof(format!(
        "With {} times as many angles each way the error is {:.1} times smaller.",
        last[0] / first[0],
        first[1] / last[1]
    ));
    out.number("table", json!(errors));
    Ok(())
}
