//! What many paths per pixel give for nothing: antialiasing, motion blur, depth of field.

use super::Section;
use super::page::Findings;
use super::workshop::{Shot, Workshop};
use crate::Failure;
use crate::judge::{Means, of_test, verdict};

pub const SECTION: Section = Section {
    name: "camera",
    title: "Antialiasing, motion blur, depth of field",
    makes: "one scene with a lens and a shutter at growing sample counts",
    run,
};

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"I=\int_{pixel}\int_{lens}\int_{shutter} h(x)\,L(x,u,t)\,dt\,du\,dx");
    out.text(
        "A pixel is an integral over its area, the lens and the time that the shutter is open. Each path draws a point of each, \
         so edges, blur behind the focus and the streaks of a spinning cube take no work of their own: only samples.",
    );
    let stage = workshop.stage("point-lights", workshop.pick([[32, 24], [320, 240], [640, 480]]))?;
    let mut row = Vec::new();
    for samples in [1, 8, workshop.pick([16, 128, 512])] {
        let words = [
            format!("camera-{samples}-spp"),
            format!("{samples} samples per pixel"),
            format!("Solids and a spinning cube through a lens, {samples} samples per pixel"),
        ];
        row.push(workshop.shot(&stage, "path", samples, words.each_ref().map(String::as_str))?.0);
    }
    out.pictures(row);
    // Two halves of the samples, apart.
    let samples = workshop.pick([16, 64, 256]);
    let halves = [1, 2].map(|seed| workshop.film(&stage, &Shot::new("path", samples).independent(seed)));
    let [first, second] = halves;
    let test = Means::of(&first?.0).test(&Means::of(&second?.0), stage.size(), 8, 0.01);
    out.proof(format!(
        "Pixel, lens and shutter drawn anew: {} of {} blocks below 1 % by Welch's test, {}: what is blurred is the mean of what is sharp.",
        test.below_alpha,
        test.tested,
        verdict(&test)
    ));
    out.number("anew", of_test(&test));
    Ok(out)
}
