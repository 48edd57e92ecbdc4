//! What many paths per pixel give for nothing: antialiasing, motion blur, depth of field.

use super::Section;
use super::language::told;
use super::page::Findings;
use super::workshop::{Shot, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test};

pub const SECTION: Section = Section {
    name: "camera",
    title: ["Antialiasing, motion blur, depth of field", "Anticrénelage, flou de mouvement, profondeur de champ"],
    makes: "one scene with a lens and a shutter at growing sample counts",
    sources: &[
        "crates/rebond/src/camera/mod.rs",
        "crates/rebond/src/camera/lens.rs",
        "crates/rebond/src/film/filter.rs",
    ],
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"I=\int_{A}\int_{D}\int_{T} h(x)\,L(x,u,t)\,dt\,du\,dx");
    out.text([
        "A pixel is an integral over its area A, the lens D and the time T that the shutter is open. Each path draws a point of each, \
         so edges, blur behind the focus and the streaks of a spinning cube take no work of their own: only samples.",
        "Un pixel est une intégrale sur son aire A, sur la lentille D et sur le temps T d'ouverture de l'obturateur. Chaque chemin tire un \
         point de chacun, de sorte que les bords, le flou hors du plan de mise au point et les traînées d'un cube qui tourne ne \
         demandent aucun travail particulier : seulement des échantillons.",
    ]);
    let stage = workshop.stage("point-lights", workshop.pick([[32, 24], [320, 240], [640, 480]]))?;
    let mut row = Vec::new();
    for samples in [1, 8, workshop.pick([16, 128, 512])] {
        let (picture, _) = workshop.shot(
            &stage,
            "path",
            samples,
            &format!("camera-{samples}-spp"),
            [format!("samples per pixel: {samples}"), format!("échantillons par pixel : {samples}")],
            [
                format!("Solids and a spinning cube through a lens, samples per pixel: {samples}"),
                format!(
                    "Des solides et un cube qui tourne vus à travers une lentille, échantillons par pixel : {samples}"
                ),
            ],
        )?;
        row.push(picture);
    }
    out.pictures(row);
    // All drawn twice.
    let samples = workshop.pick([16, 64, 256]);
    let halves = [1, 2].map(|seed| workshop.film(&stage, &Shot::new("path", samples).independent(seed)));
    let [first, second] = halves;
    let test = Means::of(&first?.0).test(&Means::of(&second?.0), stage.size(), 8, 0.01);
    let [english, french] = told(&test);
    out.proof([
        format!("Pixel, lens and shutter drawn anew: {english}."),
        format!("Pixel, lentille et obturateur tirés à nouveau : {french}."),
    ]);
    out.number("anew", of_test(&test));
    Ok(out)
}
