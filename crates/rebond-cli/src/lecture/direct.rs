//! Direct light: shadows, Phong's lobe, linearity, the factors of the integrand, and seven samplings side by side.

use super::Section;
use super::page::{Findings, Picture};
use super::workshop::{Shot, Stage, Workshop, png};
use crate::Failure;
use rebond::compare::{Estimate, Welch, welch};
use rebond::film::{Film, Image};
use serde_json::{Map, Value, json};

pub const SECTION: Section = Section {
    name: "direct",
    title: "Direct light",
    makes: "shadows, Phong's lobe, sums of lights, factors of the integrand, seven samplings and their errors",
    run,
};

const SAMPLINGS: [&str; 7] = ["area", "solid-angle", "light", "cosine", "bsdf", "mis", "product"];

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = Findings::default();
    out.formula(r"L_o=\int_{\Omega}L_e\,f_r\,V\cos\theta_i\,d\omega_i=\int_A L_e\,f_r\,V\cos\theta_i\,\frac{\cos\theta'}{d^2}\,dA");
    shadows(workshop, &mut out)?;
    phong(workshop, &mut out)?;
    linearity(workshop, &mut out)?;
    factors(workshop, &mut out)?;
    extended(workshop, &mut out)?;
    samplings(workshop, &mut out)?;
    table(workshop, &mut out)?;
    Ok(out)
}

fn points(workshop: &Workshop) -> Result<(Stage, u32), Failure> {
    let stage = workshop.stage("point-lights", workshop.pick([[32, 24], [256, 192], [512, 384]]))?;
    Ok((stage, workshop.pick([4, 16, 64])))
}

/// A picture by its command, and its film.
fn shot(
    workshop: &Workshop,
    stage: &Stage,
    integrator: &str,
    samples: u32,
    [name, caption, alt]: [&str; 3],
) -> Result<(Picture, Film), Failure> {
    let shot = Shot::new(integrator, samples);
    let (film, _) = workshop.film(stage, &shot)?;
    Ok((workshop.picture(stage, &shot, &film, name, caption.into(), alt.into())?, film))
}

fn shadows(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Point lights, with shadows and without");
    out.formula(r"L_o=\frac{I}{d^2}\,\frac{\rho}{\pi}\,V(x,\omega)\,(n\cdot\omega)");
    let (stage, samples) = points(workshop)?;
    let one = |i, words| shot(workshop, &stage, i, samples, words);
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
            png: png(&Image::from_rgb(width, height, &difference))?,
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
    let (picture, _) = shot(
        workshop,
        &stage,
        "direct:sampling=light",
        samples,
        [
            "direct-phong",
            "From the left: diffuse; Phong of exponent 60 and of 300 as the lecture prints it; Phong of exponent 60 in its \
             energy-conserving form; Blinn-Phong of exponent 60",
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
        let (picture, _) = shot(workshop, &stage, &integrator, samples, words.each_ref().map(String::as_str))?;
        row.push(picture);
        parts.push(workshop.film(&stage, &Shot::new(&integrator, samples).independent(100 + i as u64))?.0);
    }
    let words = ["direct-all-lights", "all of them", "The solids under all three lights"];
    row.push(shot(workshop, &stage, "direct", samples, words)?.0);
    out.pictures(row);
    // The whole with random numbers of its own, so that nothing but expectations can agree.
    let whole = workshop.film(&stage, &Shot::new("direct", 4 * samples).independent(99))?.0;
    let sum = Means::sum(&parts);
    let whole = Means::of(&whole);
    let (test, ratio) = (sum.test(&whole, stage.size()), sum.total() / whole.total());
    out.proof(format!(
        "The sum of the single lights over the whole: {ratio:.5} over the picture. Welch's test, block by block: {} of {} below \
         1 %, where chance makes {:.1}; {}.",
        test.below_alpha,
        test.tested,
        0.01 * test.tested as f64,
        verdict(&test)
    ));
    out.number("linearity", json!({ "lights": lights, "ratio": ratio, "welch": of_test(&test) }));
    Ok(())
}

fn factors(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("The factors of the integrand");
    let (stage, samples) = points(workshop)?;
    let mut row = Vec::new();
    for (factor, caption) in [("le", "Le: what the first light sends, I/d²"), ("v", "V"), ("bsdf", "f_r cosθ")] {
        let integrator = format!("direct:sampling=light,light=0,factor={factor}");
        let words = [format!("direct-factor-{factor}"), caption.into(), format!("The factor {caption} alone")];
        row.push(shot(workshop, &stage, &integrator, samples, words.each_ref().map(String::as_str))?.0);
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
        row.push(shot(workshop, &stage, "direct", workshop.pick([4, 32, 256]), [name.as_str(), caption, alt])?.0);
    }
    out.pictures(row);
    Ok(())
}

fn samplings(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("How to draw the samples");
    out.formula(r"\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i}{p(\omega_i)}\qquad\text{or}\qquad\frac{1}{N}\sum\frac{L_e f_r V\cos\theta_i\cos\theta'}{d^2\,p(x_i)}");
    out.text(
        "Points of lights, by area, by solid angle, or by what they emit; directions, by the cosine or by f_r; one of each, \
         weighed by the power heuristic (mis); and one of 16 candidates, chosen in proportion to Le f_r cosθ (product). 16 \
         samples a pixel each.",
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
            row.push(shot(workshop, &stage, &integrator, 16, words.each_ref().map(String::as_str))?.0);
        }
        out.pictures(row);
    }
    Ok(())
}

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

fn table(workshop: &Workshop, out: &mut Findings) -> Result<(), Failure> {
    out.heading("Their errors");
    out.text(
        "Independent samples. Variance is that of one sample, over the squared mean of its pixel (+ 0.01), averaged over the \
         picture: the relMSE of N samples is this over N. Agreement with path tracing cut off at two segments is judged by \
         Welch's test over blocks of a small picture, at 1 % for all of a scene.",
    );
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
                format!("{} ({} of {})", verdict(&r.test), r.test.below_alpha, r.test.tested),
            ]);
            let one = json!({ "variance": r.variance, "seconds_per_million": r.seconds, "welch": of_test(&r.test) });
            object.insert(sampling.to_string(), one);
        }
        object.insert("bound_of_mis".into(), json!(bound));
        object.insert("mis_is_best".into(), json!(mis.variance <= best));
        numbers.insert(scene.into(), Value::Object(object));
        out.proof(format!(
            "{scene}: variance {:.4} by mis, {:.4} by light, {:.4} by bsdf; theory allows mis {bound:.4}, half of the second \
             moment more than the better of the two.",
            mis.variance, light.variance, bsdf.variance
        ));
    }
    out.formula(r"\sigma^2_{mis}\le\min(\sigma^2_{light},\sigma^2_{bsdf})+\tfrac12\mu^2");
    out.text(
        "The bound is that of Veach (1997, theorem 9.2) for the balance heuristic with one sample of each of two kinds, and holds \
         for the power heuristic with β = 2 too: Σ w²/p = (p₁³ + p₂³)/(p₁² + p₂²)² is nowhere above 1/p₁ or 1/p₂. It holds at \
         every point; over a pixel μ² is its mean square, which its squared mean and any of the variances bound together.",
    );
    out.table(
        "direct-errors",
        "Variance of one sample, alone and times its cost, and agreement (blocks below 1 %)",
        &["sampling", "variance", "÷ mis", "s per M samples", "× time, ÷ mis", "agreement with path"],
        rows,
    );
    out.number("samplings", numbers);
    Ok(())
}

fn errors(workshop: &Workshop, scene: &str) -> Result<Vec<Row>, Failure> {
    let stage = workshop.stage(scene, workshop.pick([[24, 16], [96, 64], [192, 128]]))?;
    let samples = workshop.pick([16, 128, 1024]);
    let reference = workshop.film(&stage, &Shot { seed: 5, ..Shot::new("direct", workshop.pick([64, 512, 8192])) })?.0;
    // Small pictures, so that each pixel can have many samples.
    let small = workshop.stage(scene, [24, 16])?;
    let many = workshop.pick([256, 4096, 65_536]);
    let path = Means::of(&workshop.film(&small, &Shot::new("path:max_depth=2", many).independent(300))?.0);
    let one = |(i, sampling): (usize, &&str)| {
        let integrator = format!("direct:sampling={sampling}");
        let (film, statistics) = workshop.film(&stage, &Shot::new(&integrator, samples).independent(200 + i as u64))?;
        let (long, _) = workshop.film(&small, &Shot::new(&integrator, many).independent(310 + i as u64))?;
        let pairs = || {
            film.pixels().iter().zip(reference.pixels()).flat_map(|(p, r)| {
                let (variance, mean) = (p.variance(), r.mean());
                [0, 1, 2].map(|c| (variance[c], mean[c] * mean[c]))
            })
        };
        let count = 3.0 * film.pixels().len() as f64;
        Ok(Row {
            variance: pairs().map(|(v, square)| v / (square + 0.01)).sum::<f64>() / count,
            squares: pairs().map(|(_, square)| square / (square + 0.01)).sum::<f64>() / count,
            seconds: 1e6 * statistics.seconds / statistics.samples as f64,
            test: Means::of(&long).test(&path, small.size()),
        })
    };
    SAMPLINGS.iter().enumerate().map(one).collect()
}

/// The green of a picture, with what is known of it.
struct Means {
    mean: Vec<f32>,
    variance: Vec<f32>,
    samples: Vec<f32>,
}

impl Means {
    fn of(film: &Film) -> Self {
        Self::sum(std::slice::from_ref(film))
    }

    /// Of the sum of pictures.
    fn sum(films: &[Film]) -> Self {
        let pixels = films.first().map_or(0, |f| f.pixels().len());
        let all = |i: usize| films.iter().map(move |f| f.pixels()[i].moments(1));
        let per_pixel = |f: &dyn Fn(usize) -> f64| (0..pixels).map(|i| f(i) as f32).collect();
        Self {
            mean: per_pixel(&|i| all(i).map(|m| m.mean()).sum()),
            variance: per_pixel(&|i| all(i).map(|m| m.variance_of_mean()).sum()),
            samples: per_pixel(&|i| all(i).map(|m| m.count() as f64).fold(f64::INFINITY, f64::min)),
        }
    }

    fn total(&self) -> f64 {
        self.mean.iter().map(|m| f64::from(*m)).sum()
    }

    fn estimate(&self) -> Estimate<'_> {
        Estimate { mean: &self.mean, variance: &self.variance, samples: &self.samples }
    }

    /// Whether another picture has the same expectation.
    fn test(&self, other: &Self, [width, height]: [u32; 2]) -> Welch {
        welch(self.estimate(), other.estimate(), width, height, 8, 0.01).expect("pictures of one size")
    }
}

fn verdict(test: &Welch) -> &'static str {
    if test.passes() { "they agree" } else { "they differ" }
}

fn of_test(test: &Welch) -> Value {
    json!({ "blocks": test.tested, "below_level": test.below_alpha, "significant": test.significant,
        "below_level_p": test.below_alpha_p, "passes": test.passes() })
}
