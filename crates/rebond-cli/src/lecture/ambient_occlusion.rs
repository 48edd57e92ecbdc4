//! Ambient occlusion by three samplings: pictures, a sphere sampled right and wrong, two experiments, and variances.

use super::Section;
use super::page::{Findings, Picture};
use super::workshop::{Shot, Stage, Workshop, png};
use crate::Failure;
use crate::plot::{Axis, Band, Chart, Curve, GREY, Mark};
use rebond::film::Image;
use rebond::math::Moments;
use rebond::sampling::SamplerSettings;
use rebond::sampling::warp::uniform_sphere;
use rebond::transport::estimator::numbers;
use serde_json::json;
use std::f64::consts::PI;
use std::fmt::Write;

pub const SECTION: Section = Section {
    name: "ambient-occlusion",
    title: ["Ambient occlusion", "Occlusion ambiante"],
    makes: "pictures by three samplings of N = 10, 100, 1000; a sphere right and wrong; convergence; variances",
    sources: &["crates/rebond/src/integrators/ambient_occlusion.rs", "crates/rebond/src/sampling/warp.rs"],
    run,
};

/// What is farther away than this hides nothing, so that there are places which surely see no occluder.
const REACH: &str = "max_distance=2";
/// Each sampling, and the variance of one of its samples where nothing is in the way.
const SAMPLINGS: [(&str, f64); 3] = [("sphere", 5.0 / 3.0), ("hemisphere", 1.0 / 3.0), ("cosine", 0.0)];
const SAMPLES: [u32; 3] = [10, 100, 1000];

fn integrator(sampling: &str) -> String {
    format!("ambient-occlusion:sampling={sampling},{REACH}")
}

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"L_{ao}(x)=\int_{\Omega}\frac{\max(n\cdot\omega,0)}{\pi}\,V(x,\omega)\,d\omega");
    out.formula(r"\approx\frac{4}{N}\sum_i\max(n\cdot\omega_i,0)\,V_i");
    out.formula(r"\approx\frac{2}{N}\sum_i\max(n\cdot\omega_i,0)\,V_i\qquad\approx\frac{1}{N}\sum_i V_i");
    out.text([
        "The share of an even sky that a point sees, weighed by the cosine. Directions are drawn uniformly over the \
         sphere (half of them in vain), uniformly over the hemisphere, or in proportion to the cosine, which leaves \
         no noise but that of visibility. What is more than 2 m away hides nothing here.",
        "La part d'un ciel uniforme qu'un point voit, pondérée par le cosinus. Les directions sont tirées uniformément sur la sphère \
         (sphere, la moitié en vain), uniformément sur l'hémisphère (hemisphere), ou en proportion du cosinus (cosine), ce qui ne laisse \
         d'autre bruit que celui de la visibilité. Ce qui est à plus de 2 m ne cache rien ici.",
    ]);
    let side = workshop.pick([24, 160, 512]);
    let stage = workshop.stage("dragon", [side, side])?;
    let last = pictures(workshop, &stage, &mut out)?;
    spheres(workshop, &mut out);
    experiments(workshop, &stage, &last, &mut out)?;
    Ok(out)
}

/// Pictures of 10, 100 and 1000 samples by each sampling; returns the last.
fn pictures(workshop: &Workshop, stage: &Stage, out: &mut Findings) -> Result<Image, Failure> {
    let mut last = Image::default();
    for (sampling, _) in SAMPLINGS {
        let (integrator, mut row) = (integrator(sampling), Vec::new());
        for n in SAMPLES {
            let shot = Shot::new(&integrator, n);
            let (film, _) = workshop.film(stage, &shot)?;
            let name = format!("ao-{sampling}-{n}");
            let caption = format!("{sampling}, N = {n}");
            let alt = [
                format!("The dragon by ambient occlusion, {sampling} sampling, {n} samples a pixel"),
                format!("Le dragon par occlusion ambiante, échantillonnage {sampling}, {n} échantillons par pixel"),
            ];
            row.push(workshop.picture(stage, &shot, &film, &name, [&*caption; 2], alt)?);
            last = film.develop();
        }
        out.pictures(row);
    }
    Ok(last)
}

/// How many points are drawn on each sphere, and how many are counted.
const POINTS: u32 = 1500;
const COUNTED: u32 = 100_000;

/// A direction by θ = πξ₁: dense at the poles.
fn wrong_sphere([u, v]: [f64; 2]) -> [f64; 3] {
    let ((sin, cos), phi) = ((PI * u).sin_cos(), 2.0 * PI * v);
    [sin * phi.cos(), sin * phi.sin(), cos]
}

fn right_sphere(u: [f64; 2]) -> [f64; 3] {
    let w = uniform_sphere(u.map(|u| u as f32));
    [w.x, w.y, w.z].map(f64::from)
}

fn spheres(workshop: &Workshop, out: &mut Findings) {
    out.heading(["A sphere sampled right and wrong", "Une sphère bien et mal échantillonnée"]);
    out.formula(r"\theta=\arccos(1-2\xi_1),\;\varphi=2\pi\xi_2\qquad\ne\qquad\theta=\pi\xi_1");
    let pairs = |n| {
        let of = |seed| numbers(SamplerSettings::Independent {}, workshop.seed(seed), n);
        of(11).zip(of(12)).map(|(u, v)| [u, v])
    };
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 760 400\" font-family=\"sans-serif\" font-size=\"15\">\
         <rect width=\"760\" height=\"400\" fill=\"#FFFFFF\"/>\n",
    );
    let cap = 30_f64.to_radians().cos();
    let mut shares = Vec::new();
    type Warp = fn([f64; 2]) -> [f64; 3];
    for (warp, title, cx) in [
        (right_sphere as Warp, ["θ = acos(1 − 2ξ): uniform", "θ = acos(1 − 2ξ) : uniforme"], 190.0),
        (wrong_sphere, ["θ = πξ: clustered at the poles", "θ = πξ : concentré aux pôles"], 570.0),
    ] {
        let title = workshop.say(title);
        // Writing to a string cannot fail.
        let _ = writeln!(svg, "<text x=\"{cx}\" y=\"28\" text-anchor=\"middle\" fill=\"#000000\">{title}</text>");
        let _ = writeln!(svg, "<circle cx=\"{cx}\" cy=\"215\" r=\"165\" fill=\"none\" stroke=\"#808080\"/>");
        for [x, y, z] in pairs(POINTS).map(warp) {
            // Seen from 35° above the equator; what is behind is pale.
            let (sin, cos) = 35_f64.to_radians().sin_cos();
            let (depth, up) = (y * cos + z * sin, z * cos - y * sin);
            let opacity = if depth > 0.0 { 0.9 } else { 0.18 };
            let _ = writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.8\" fill=\"#007fc4\" fill-opacity=\"{opacity}\"/>",
                cx + 165.0 * x,
                215.0 - 165.0 * up
            );
        }
        let near_pole: Moments = pairs(COUNTED).map(|u| f64::from(warp(u)[2].abs() > cap)).collect();
        let open: Moments = pairs(COUNTED).map(|u| 4.0 * warp(u)[2].max(0.0)).collect();
        shares.push((near_pole, open));
    }
    svg.push_str("</svg>\n");
    out.drawing(
        "ao-spheres",
        svg,
        [
            "Points on two spheres: spread evenly on the left, crowded about the pole on the right",
            "Des points sur deux sphères : répartis également à gauche, concentrés près du pôle à droite",
        ],
        [
            "The same random numbers, made directions in two ways; paler points are behind",
            "Les mêmes nombres aléatoires, transformés en directions de deux façons ; les points pâles sont derrière",
        ],
    );
    let [(right, open), (wrong, too_much)] = [shares[0], shares[1]];
    let (share, error, by_theory) = (right.mean(), right.standard_error(), 1.0 - cap);
    let (crowded, bright, bright_error, bright_theory) =
        (wrong.mean(), too_much.mean(), too_much.standard_error(), 4.0 / PI);
    let as_it_is = open.mean();
    out.proof([
        format!(
            "Share of directions within 30° of a pole: {share:.4} ± {error:.4} by the right way (theory 1 − cos 30° = {by_theory:.4}), \
             {crowded:.4} by the wrong one (theory 1/3). Taken for uniform, the wrong one makes an open plane {bright:.3} ± \
             {bright_error:.3} bright (theory 4/π = {bright_theory:.3}) where the right one makes it {as_it_is:.3} (1)."
        ),
        format!(
            "Part des directions à moins de 30° d'un pôle : {share:.4} ± {error:.4} par la bonne façon (théorie 1 − cos 30° = \
             {by_theory:.4}), {crowded:.4} par la mauvaise (théorie 1/3). Prise pour uniforme, la mauvaise donne à un plan dégagé la \
             luminosité {bright:.3} ± {bright_error:.3} (théorie 4/π = {bright_theory:.3}) là où la bonne donne {as_it_is:.3} (1)."
        ),
    ]);
    let value = |m: &Moments, theory: f64| json!({ "theory": theory, "measured": m.mean(), "p": m.p_value(theory) });
    out.number(
        "within_30_degrees_of_a_pole",
        json!({ "right": value(&right, 1.0 - cap), "wrong": value(&wrong, 1.0 / 3.0) }),
    );
    out.number("open_plane", json!({ "right": value(&open, 1.0), "wrong": value(&too_much, 4.0 / PI) }));
}

/// Two pixels, by their places in parts of the picture: within the dragon's arch, and on the open ground
/// far behind.
const OCCLUDED: [f64; 2] = [0.59, 0.617];
const OPEN: [f64; 2] = [0.1, 0.2];

fn experiments(workshop: &Workshop, stage: &Stage, picture: &Image, out: &mut Findings) -> Result<(), Failure> {
    out.heading(["Two experiments", "Deux expériences"]);
    let [width, height] = stage.size();
    let pixel = |[x, y]: [f64; 2]| [(x * f64::from(width)) as u32, (y * f64::from(height)) as u32];
    let (occluded, open) = (pixel(OCCLUDED), pixel(OPEN));
    out.pictures(vec![Picture {
        name: "ao-pixels".into(),
        png: png(&ringed(picture, &[(occluded, [0.85, 0.11, 0.0]), (open, [0.0, 0.2, 0.55])]), 0.0)?,
        alt: workshop
            .say([
                "The dragon with two rings, one under its arched back and one on the ground far behind it",
                "Le dragon avec deux anneaux, l'un sous son dos voûté et l'autre sur le sol loin derrière lui",
            ])
            .into(),
        caption: workshop.say([
            format!("Red: pixel {occluded:?}, which sees occluders. Blue: pixel {open:?}, which sees none."),
            format!(
                "Rouge : le pixel {occluded:?}, qui voit des obstacles. Bleu : le pixel {open:?}, qui n'en voit pas."
            ),
        ]),
        command: None,
    }]);
    let reference = workshop.film(
        stage,
        &Shot::new(&integrator("cosine"), workshop.pick([10_000, 1_000_000, 10_000_000])).independent(77).of(occluded),
    )?;
    let truth = reference.0.pixels()[0].moments()[1];
    let mut measured = Vec::new();
    for (name, pixel, expected) in [("occluded", occluded, truth.mean()), ("open", open, 1.0)] {
        let (mut curves, mut bands) = (Vec::new(), Vec::new());
        for (color, (sampling, _)) in SAMPLINGS.into_iter().enumerate() {
            let seed = 20 + color as u64;
            let (points, end) = growing(workshop, stage, &integrator(sampling), pixel, seed)?;
            curves.push(Curve { name: sampling.into(), mark: Mark::Line, color, points });
            measured.push((name, sampling, expected, end));
            if color == 0 {
                let sigma = end.variance().sqrt();
                let reach = |n: &u32| sigma / f64::from(*n).sqrt();
                let points =
                    steps().iter().map(|n| [f64::from(*n), expected - reach(n), expected + reach(n)]).collect();
                bands.push(Band { name: "±σ/√N, sphere".into(), color: GREY, points });
            }
        }
        let line = [1.0, f64::from(MOST)].map(|n| [n, expected]).to_vec();
        curves.push(Curve {
            name: format!("{} {expected:.4}", workshop.say(["expectation", "espérance"])),
            mark: Mark::Dashes,
            color: GREY,
            points: line,
        });
        let title = if name == "open" {
            [
                "Value of the pixel that sees no occluder, as samples are added",
                "Valeur du pixel qui ne voit pas d'obstacle, selon le nombre d'échantillons",
            ]
        } else {
            [
                "Value of the pixel that sees occluders, as samples are added",
                "Valeur du pixel qui voit des obstacles, selon le nombre d'échantillons",
            ]
        };
        out.plot(
            &format!("ao-experiment-{name}"),
            Chart {
                title: workshop.say(title).into(),
                x: Axis { label: workshop.say(["samples N", "échantillons N"]), log: true, range: Some([1.0, f64::from(MOST)]) },
                y: Axis { label: workshop.say(["ambient occlusion", "occlusion ambiante"]), log: false, range: Some([0.0, 2.0]) },
                bands,
                curves,
                legend: Default::default(),
            },
            [
                format!("Three curves draw near {expected:.3}: sphere sampling wavers most, cosine sampling least"),
                format!(
                    "Trois courbes s'approchent de {expected:.3} : celle de la sphère fluctue le plus, celle du cosinus le moins"
                ),
            ],
        );
    }
    out.text([
        "Where nothing is in the way the cosine's estimate is exact from its first sample on. Where something is, its \
         noise is that of V, which is 0 or 1: σ² = L(1 − L).",
        "Là où rien ne fait obstacle, l'estimation par le cosinus est exacte dès son premier échantillon. Ailleurs, son bruit est celui \
         de V, qui vaut 0 ou 1 : σ² = L(1 − L).",
    ]);
    variances(workshop, stage, open, &measured, truth.mean(), out)
}

/// The most samples of an experiment.
const MOST: u32 = 10_000;

/// Numbers of samples, evenly over the logarithm.
fn steps() -> Vec<u32> {
    let mut steps: Vec<u32> = (0..=120).map(|i| 10_f64.powf(f64::from(i) / 30.0).round() as u32).collect();
    steps.dedup();
    steps
}

/// The value of a pixel as samples are added, and all that is known of it in the end.
fn growing(
    workshop: &Workshop,
    stage: &Stage,
    integrator: &str,
    pixel: [u32; 2],
    seed: u64,
) -> Result<(Vec<[f64; 2]>, Moments), Failure> {
    let (mut points, mut end, mut first) = (Vec::new(), Moments::default(), 0);
    for n in steps() {
        let shot = Shot { samples: first..n, ..Shot::new(integrator, n).independent(seed).of(pixel) };
        end.merge(&workshop.film(stage, &shot)?.0.pixels()[0].moments()[1]);
        points.push([f64::from(n), end.mean()]);
        first = n;
    }
    Ok((points, end))
}

/// Variances of one sample at the open pixel: theory's beside what is measured.
fn variances(
    workshop: &Workshop,
    stage: &Stage,
    open: [u32; 2],
    experiments: &[(&str, &str, f64, Moments)],
    occluded: f64,
    out: &mut Findings,
) -> Result<(), Failure> {
    let (batches, size) = workshop.pick([(20, 200), (100, 1000), (400, 5000)]);
    let (mut rows, mut numbers, mut words) = (Vec::new(), serde_json::Map::new(), Vec::new());
    for (sampling, theory) in SAMPLINGS {
        let integrator = integrator(sampling);
        let mut variances = Moments::default();
        for batch in 0..batches {
            let samples = batch * size..(batch + 1) * size;
            let shot = Shot { samples, ..Shot::new(&integrator, 1).independent(40).of(open) };
            variances.add(workshop.film(stage, &shot)?.0.pixels()[0].variance()[1]);
        }
        let p = variances.p_value(theory);
        let at_occluded = experiments.iter().find(|(name, s, ..)| *name == "occluded" && *s == sampling);
        let there = at_occluded.map_or(0.0, |(.., m)| m.variance());
        let expected_there = if theory == 0.0 { format!("{:.4}", occluded * (1.0 - occluded)) } else { "–".into() };
        rows.push(vec![
            sampling.into(),
            format!("{theory:.4}"),
            format!("{:.4} ± {:.4}", variances.mean(), variances.standard_error()),
            expected_there,
            format!("{there:.4}"),
        ]);
        let by_theory = workshop.say(["theory", "théorie"]);
        words.push(format!("{sampling} {:.4} ({by_theory} {theory:.4})", variances.mean()));
        numbers.insert(
            sampling.into(),
            json!({ "theory": theory, "measured": variances.mean(), "standard_error": variances.standard_error(),
                "p": p, "occluded": there }),
        );
    }
    out.formula(r"V=1:\quad \sigma^2=\int\frac{f^2}{p}-1=\tfrac{5}{3},\;\tfrac{1}{3},\;0");
    out.proof([
        format!("Variance of one sample where V = 1: {}.", words.join(", ")),
        format!("Variance d'un échantillon là où V = 1 : {}.", words.join(" ; ")),
    ]);
    out.table(
        "ao-variances",
        [
            "Variance of one sample, theory beside measurement",
            "Variance d'un échantillon, la théorie à côté de la mesure",
        ],
        &[
            ["sampling", "échantillonnage"],
            ["V = 1, theory", "V = 1, théorie"],
            ["V = 1, measured", "V = 1, mesurée"],
            ["with occluders, theory", "avec obstacles, théorie"],
            ["with occluders, measured", "avec obstacles, mesurée"],
        ],
        rows,
    );
    out.number("variances", numbers);
    out.number("occluded_pixel", json!({ "pixel": OCCLUDED, "value": occluded }));
    Ok(())
}

/// The picture with rings about pixels.
fn ringed(image: &Image, rings: &[([u32; 2], [f32; 3])]) -> Image {
    let mut pixels = image.rgb("").unwrap_or_default();
    let radius = f64::from(image.width) * 0.03;
    for ([cx, cy], color) in rings {
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let (x, y) = (i as u32 % image.width, i as u32 / image.width);
            let distance = (f64::from(x) - f64::from(*cx)).hypot(f64::from(y) - f64::from(*cy));
            if (distance - radius).abs() < (0.25 * radius).max(0.6) {
                *pixel = *color;
            }
        }
    }
    Image::from_rgb(image.width, image.height, &pixels)
}
