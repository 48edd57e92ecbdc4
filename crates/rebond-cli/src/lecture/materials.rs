//! Materials in pictures: the two readings of Phong's lobe, mirrors, anisotropy, and a table in place of a formula.

use super::Section;
use super::page::Findings;
use super::workshop::Workshop;
use crate::Failure;
use crate::bsdf::open;
use crate::judge::Means;
use crate::lobe_plot::{self, ENGLISH, FRENCH, Plot};
use rebond::bsdf::capture::{CaptureSettings, capture, error};
use rebond::bsdf::check::Effort;
use rebond::bsdf::measured::Measured;
use serde_json::json;

pub const SECTION: Section = Section {
    name: "materials",
    title: ["Materials", "Matériaux"],
    makes: "Phong of r = 60 and 300 as a blurred mirror, and a mirror of a blurred light; a gallery, anisotropic ones in it",
    sources: &[
        "crates/rebond/src/bsdf/phong.rs",
        "crates/rebond/src/bsdf/blinn_phong.rs",
        "crates/rebond/src/bsdf/ashikhmin_shirley.rs",
        "crates/rebond/src/bsdf/check.rs",
        "crates/rebond/src/bsdf/measured",
    ],
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"f_r(\omega_i,\omega_o)=f_r(\omega_o,\omega_i),\qquad \int_{\Omega} f_r\cos\theta_i\,d\omega_i\le 1");
    claims(workshop, &mut out)?;
    readings(workshop, &mut out)?;
    gallery(workshop, &mut out)?;
    table(workshop, &mut out)?;
    Ok(out)
}

/// Who is a BRDF?
fn claims(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["What a BRDF must be", "Ce qu'une BRDF doit être"]);
    out.formula(r"f_r=\frac{r+1}{2\pi}\,\frac{(\omega_r\cdot\omega_o)^r}{\omega_i\cdot n}");
    out.text([
        "Reciprocal, never negative, and no source of light. Phong's lobe as the lecture prints it, divided by the cosine, breaks \
         two of these rules; in the form that rebond uses unless told otherwise it keeps them.",
        "Réciproque, jamais négative, et jamais source de lumière. Le lobe de Phong tel que le cours l'écrit, divisé par le cosinus, \
         enfreint deux de ces règles ; dans la forme que rebond emploie par défaut, il les respecte.",
    ]);
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
        let yes = |holds: bool| workshop.say(if holds { ["yes", "oui"] } else { ["no", "non"] }).to_owned();
        rows.push(vec![
            text.into(),
            yes(report.is_positive()),
            yes(report.is_reciprocal()),
            yes(report.conserves_energy()),
            format!(
                "{:.3} {} {:.0}°",
                report.energy.largest.mean,
                workshop.say(["at", "à"]),
                report.energy.largest.at.theta
            ),
        ]);
        numbers.insert(
            text.into(),
            json!({ "reciprocal": report.is_reciprocal(), "conserves_energy": report.conserves_energy(),
                "largest_albedo": report.energy.largest.mean }),
        );
    }
    out.table(
        "materials-claims",
        [
            "Random pairs of directions, and albedos over the hemisphere; each by rebond bsdf MATERIAL",
            "Des paires de directions tirées au hasard, et des albédos sur l'hémisphère ; chacun par rebond bsdf MATÉRIAU",
        ],
        &[
            ["material", "matériau"],
            ["positive", "positive"],
            ["reciprocal", "réciproque"],
            ["conserves energy", "conserve l'énergie"],
            ["largest albedo", "plus grand albédo"],
        ],
        rows,
    );
    let material = open("ashikhmin-shirley:exponent_u=400,exponent_v=20")?;
    let alone = "rebond bsdf ashikhmin-shirley:exponent_u=400,exponent_v=20 -o lobe.svg";
    let [title, titre] = [
        "An anisotropic lobe: Ashikhmin and Shirley, exponents 400 and 20",
        "Un lobe anisotrope : Ashikhmin et Shirley, exposants 400 et 20",
    ];
    out.drawing(
        "materials-anisotropic",
        lobe_plot::svg(&material, workshop.say([title, titre]), Plot::Hemisphere, workshop.say([ENGLISH, FRENCH])),
        [
            "Hemispheres from above: a highlight that is long in one direction and narrow in the other".to_owned(),
            "Des hémisphères vus d'en haut : un reflet long dans une direction et étroit dans l'autre".to_owned(),
        ],
        [format!("Alone: `{alone}`"), format!("Seul : `{alone}`")],
    );
    out.number("claims", numbers);
    Ok(())
}

fn readings(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading([
        "Phong twice: a blurred mirror, or a mirror of a blurred light",
        "Phong de deux façons : un miroir flou, ou le miroir d'une lumière floue",
    ]);
    let size = workshop.pick([[32, 18], [320, 180], [800, 450]]);
    let samples = workshop.pick([4, 48, 256]);
    let mut row = Vec::new();
    let (mut brightness, mut means) = (Vec::new(), Vec::new());
    for (scene, caption) in [
        ("phong-60", ["r = 60, sharp window", "r = 60, fenêtre nette"]),
        (
            "phong-60-blurred-light",
            ["a mirror, the window blurred by r = 60", "un miroir, la fenêtre rendue floue par r = 60"],
        ),
        ("phong-300", ["r = 300, sharp window", "r = 300, fenêtre nette"]),
        (
            "phong-300-blurred-light",
            ["a mirror, the window blurred by r = 300", "un miroir, la fenêtre rendue floue par r = 300"],
        ),
    ] {
        let stage = workshop.stage(scene, size)?;
        let [english, french] = caption;
        let (picture, film) = workshop.shot(
            &stage,
            "direct",
            samples,
            &format!("materials-{scene}"),
            caption,
            [
                format!("A ball and a turned ball on a table: {english}"),
                format!("Une boule et une boule tournée sur une table : {french}"),
            ],
        )?;
        brightness.push(film.mean()[1]);
        means.push(Means::of(&film));
        row.push(picture);
    }
    out.pictures(row);
    let [[at_60, off_60], [at_300, off_300]] = [0, 2].map(|i| {
        let [ratio, off] = means[i + 1].over(&means[i]);
        [100.0 * (ratio - 1.0), 100.0 * off]
    });
    out.proof([
        format!(
            "The brightness of the two readings differs by {at_60:+.2} ± {off_60:.2} % for r = 60 and {at_300:+.2} ± {off_300:.2} % \
             for r = 300."
        ),
        format!(
            "La luminosité des deux lectures diffère de {at_60:+.2} ± {off_60:.2} % pour r = 60 et de {at_300:+.2} ± {off_300:.2} % \
             pour r = 300."
        ),
    ]);
    out.number("readings", json!(brightness));
    Ok(())
}

fn gallery(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["A gallery", "Une galerie"]);
    let stage = workshop.stage("material-gallery", workshop.pick([[64, 31], [640, 310], [1280, 620]]))?;
    let (picture, _) = workshop.shot(
        &stage,
        "path",
        workshop.pick([2, 32, 256]),
        "materials-gallery",
        [
            "Eighteen materials: diffuse and coated behind, textbook lobes and metals in the middle, metal and glass in front",
            "Dix-huit matériaux : diffus et vernis derrière, lobes des manuels et métaux au milieu, métal et verre devant",
        ],
        ["Balls of eighteen materials in three rows", "Des boules de dix-huit matériaux en trois rangs"],
    )?;
    out.pictures(vec![picture]);
    Ok(())
}

/// Angles each way of the table that is drawn.
const DRAWN: u32 = 16;

/// The table of the lecture, and what it gets wrong.
fn table(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["A table in place of a formula", "Une table au lieu d'une formule"]);
    out.formula(r"f_r[\theta_i][\phi_i][\theta_o][\phi_o][c]");
    out.text([
        "Any material that neither mirrors nor transmits can be tabulated. A table of few angles misses the lobe; a fine one is \
         large. `rebond capture` makes it, and measures what it gets wrong.",
        "Tout matériau qui n'est ni un miroir ni transparent peut être tabulé. Une table de peu d'angles rate le lobe ; une \
         table fine est grande. `rebond capture` la fait, et mesure ses erreurs.",
    ]);
    let material = open("phong:exponent=20")?;
    let (mut rows, mut errors) = (Vec::new(), Vec::new());
    let mut drawn = Err(Failure::Run(format!("no table has {DRAWN} angles")));
    for n in workshop.pick([vec![8, 16], vec![8, 16, 32, 64], vec![8, 16, 32, 64, 90]]) {
        // Of an isotropic material one azimuth of the light is enough.
        let settings = CaptureSettings { size: [n, 1, n, n], samples: 0, noise: 0.0, seed: workshop.seed(0) };
        let refuse = |e: String| Failure::usage(e, "tabulate another material");
        let captured = capture(&material, &settings).map_err(refuse)?;
        if n == DRAWN {
            drawn = Measured::Angles(captured.clone()).material().map_err(Failure::Run);
        }
        let found = error(&material, &captured, workshop.pick([8, 32, 64]), workshop.seed(0)).map_err(refuse)?;
        let kilobytes = f64::from(n).powi(3) * 12.0 / 1e3;
        rows.push(vec![
            format!("{n} × 1 × {n} × {n}"),
            format!("{kilobytes:.0} {}", workshop.say(["kB", "ko"])),
            format!("{:.2} %", 100.0 * found.rms),
        ]);
        errors.push([f64::from(n), found.rms]);
    }
    let titles = [
        format!("Phong's lobe of exponent 20, from a table of {DRAWN} angles each way"),
        format!("Le lobe de Phong d'exposant 20, d'une table de {DRAWN} angles par dimension"),
    ];
    let alone = [
        format!("rebond capture phong:exponent=20 -r {DRAWN},1,{DRAWN},{DRAWN} -o table.safetensors"),
        "rebond bsdf measured:file=table.safetensors -o lobe.svg".to_owned(),
    ];
    let svg = lobe_plot::svg(&drawn?, &workshop.say(titles), Plot::Polar, workshop.say([ENGLISH, FRENCH]));
    out.drawing(
        "materials-table-lobe",
        svg,
        [
            "Lobes towards the mirror's direction, with corners where the table has its angles",
            "Des lobes vers la direction du miroir, avec des coins là où la table a ses angles",
        ]
        .map(String::from),
        [
            format!("Interpolated between angles, the lobe has corners. Alone: `{}`, then `{}`", alone[0], alone[1]),
            format!("Interpolé entre les angles, le lobe a des coins. Seul : `{}`, puis `{}`", alone[0], alone[1]),
        ],
    );
    let [first, last] = [errors[0], errors[errors.len() - 1]];
    out.table(
        "materials-table",
        ["Phong's lobe of exponent 20, tabulated", "Le lobe de Phong d'exposant 20, tabulé"],
        &[
            ["angles θi × φi × θo × φo", "angles θi × φi × θo × φo"],
            ["size", "taille"],
            ["root of the mean square error", "racine de l'erreur quadratique moyenne"],
        ],
        rows,
    );
    let (finer, better) = (last[0] / first[0], first[1] / last[1]);
    out.proof([
        format!("With {finer} times as many angles each way the error is {better:.1} times smaller."),
        format!("Avec {finer} fois plus d'angles dans chaque dimension, l'erreur est {better:.1} fois plus petite."),
    ]);
    out.number("table", json!(errors));
    Ok(())
}
