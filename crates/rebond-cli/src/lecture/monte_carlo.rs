//! Monte Carlo in one dimension: ∫₀¹ √(1 − x²) dx = π/4, by four kinds of samples.

use super::Section;
use super::page::Findings;
use super::workshop::Workshop;
use crate::Failure;
use crate::plot::{Axis, Band, Chart, Curve, GREY, Legend, Mark};
use rebond::math::Moments;
use rebond::sampling::SamplerSettings;
use rebond::transport::estimator::{Drawn, estimate, log_log_slope, numbers, quarter_disk};
use serde_json::json;

pub const SECTION: Section = Section {
    name: "monte-carlo",
    title: ["Monte Carlo", "Monte-Carlo"],
    makes: "an integral of one variable by four kinds of samples: error against N, slopes, convergence",
    sources: &["crates/rebond/src/transport/estimator.rs", "crates/rebond/src/sampling/sampler.rs"],
    run,
};

/// A way to draw samples.
struct Method {
    /// In English, for programs too, and in French.
    name: [&'static str; 2],
    settings: fn(u32) -> SamplerSettings,
    warp: fn(f64) -> Drawn<f64>,
    /// The variance of an estimate of N samples, by theory.
    variance: fn(u32) -> f64,
}

fn methods() -> [Method; 4] {
    let independent = |_| SamplerSettings::Independent {};
    let uniform = quarter_disk::uniform;
    [
        Method {
            name: ["uniform", "uniforme"],
            settings: independent,
            warp: uniform,
            variance: |n| quarter_disk::variance_uniform() / f64::from(n),
        },
        Method {
            name: ["importance", "préférentiel"],
            settings: independent,
            warp: quarter_disk::importance,
            variance: |n| quarter_disk::variance_importance() / f64::from(n),
        },
        Method {
            name: ["stratified", "stratifié"],
            settings: |samples| SamplerSettings::Stratified { samples },
            warp: uniform,
            variance: variance_stratified,
        },
        Method {
            name: ["Owen-Sobol"; 2],
            settings: |_| SamplerSettings::Sobol {},
            warp: uniform,
            variance: variance_stratified,
        },
    ]
}

/// The variance of one jittered sample in each of n strata: 1/n² Σ Var_i, with Var_i = n ∫f² − (n ∫f)² over stratum i.
/// From ∫f = (x√(1 − x²) + asin x)/2 and ∫f² = x − x³/3. f has an infinite slope at 1, so it falls like log n/n³.
fn variance_stratified(n: u32) -> f64 {
    let (f, square) = (|x: f64| 0.5 * (x * quarter_disk::f(x) + x.asin()), |x: f64| x - x * x * x / 3.0);
    let count = f64::from(n);
    let one = |i: u32| {
        let (a, b) = (f64::from(i) / count, f64::from(i + 1) / count);
        count * (square(b) - square(a)) - (count * (f(b) - f(a))).powi(2)
    };
    (0..n).map(one).sum::<f64>() / (count * count)
}

impl Method {
    fn estimate(&self, seed: u64, n: u32) -> Moments {
        estimate(numbers((self.settings)(n), seed, n), self.warp, quarter_disk::f)
    }
}

/// Powers of two, from 4 to 4096 samples.
const POWERS: std::ops::RangeInclusive<u32> = 2..=12;

fn run(workshop: &Workshop) -> Result<Findings, Failure> {
    let mut out = workshop.findings();
    out.formula(r"\int_0^1 f(x)\,dx \approx \frac{1}{N}\sum_{i=1}^{N}\frac{f(X_i)}{p(X_i)}");
    out.formula(r"f(x)=\sqrt{1-x^2},\qquad \int_0^1 f(x)\,dx=\frac{\pi}{4}\approx 0.785398");
    out.text([
        "An estimator is three choices: the density p, the numbers from which the X are drawn, and the integrand. \
         Below, X is uniform with independent numbers; uniform with one number in each of N strata; uniform with \
         Owen-scrambled Sobol points; and drawn with independent numbers from p(x) = 6/5 (1 − x²/2), which is nearly \
         proportional to f.",
        "Un estimateur est fait de trois choix : la densité p, les nombres dont on tire les X, et l'intégrande. Ci-dessous, X est \
         uniforme avec des nombres indépendants ; uniforme avec un nombre dans chacune de N strates (échantillonnage stratifié) ; \
         uniforme avec les points de Sobol brouillés par Owen ; et tiré avec des nombres indépendants de p(x) = 6/5 (1 − x²/2), presque \
         proportionnelle à f (échantillonnage préférentiel, ou par importance).",
    ]);
    errors(workshop, &mut out);
    running(workshop, &mut out);
    Ok(out)
}

/// The error against N.
fn errors(workshop: &Workshop, out: &mut Findings) {
    let repeats = workshop.pick([200, 1000, 10_000]);
    let (mut curves, mut rows, mut slopes) = (Vec::new(), Vec::new(), serde_json::Map::new());
    for (color, method) in methods().iter().enumerate() {
        let points: Vec<[f64; 2]> = POWERS
            .map(|k| {
                let n = 1 << k;
                // Numbers of its own for every point, so that no two err together.
                let first = (color as u64 * 100 + u64::from(k)) * repeats;
                let off = |r| (method.estimate(workshop.seed(first + r), n).mean() - quarter_disk::VALUE).powi(2);
                let squares: Moments = (0..repeats).map(off).collect();
                [f64::from(n), squares.mean().sqrt()]
            })
            .collect();
        let theory: Vec<[f64; 2]> = POWERS.map(|k| [f64::from(1 << k), (method.variance)(1 << k).sqrt()]).collect();
        let (slope, expected) = (log_log_slope(&points), log_log_slope(&theory));
        let error = slope_error(&points, repeats);
        slopes.insert(method.name[0].into(), json!({ "theory": expected, "measured": slope, "standard_error": error }));
        let last = |points: &[[f64; 2]]| points.last().map_or("–".into(), |p| format!("{:.3e}", p[1]));
        let name = workshop.say(method.name);
        rows.push(vec![
            name.into(),
            minus(format!("{expected:.3}")),
            minus(format!("{slope:.3} ± {error:.3}")),
            minus(last(&theory)),
            minus(last(&points)),
        ]);
        curves.push(Curve {
            name: workshop.say([format!("{name}: theory"), format!("{name} : théorie")]),
            mark: Mark::Dashes,
            color: GREY,
            points: theory,
        });
        let name = minus(workshop.say([format!("{name}: slope {slope:.2}"), format!("{name} : pente {slope:.2}")]));
        curves.push(Curve { name, mark: Mark::LineAndDots, color, points });
    }
    let theory = workshop.say(["theory", "théorie"]);
    let of = |row: &Vec<String>| format!("{} {} ({theory} {})", row[0], row[2], row[1]);
    let all: Vec<String> = rows.iter().map(of).collect();
    out.proof([
        format!("Slope of log error over log N: {}.", all.join("; ")),
        format!("Pente du log de l'erreur selon log N : {}.", all.join(" ; ")),
    ]);
    out.plot(
        "monte-carlo-error",
        Chart {
            title: workshop.say([
                format!("RMS error of {repeats} estimates against the number of samples"),
                format!("Racine de l'erreur quadratique moyenne de {repeats} estimations selon le nombre d'échantillons"),
            ]),
            x: Axis { label: workshop.say(["samples N", "échantillons N"]), log: true, range: None },
            y: Axis { label: workshop.say(["RMS error", "racine de l'erreur quadratique"]), log: true, range: None },
            bands: vec![],
            curves,
            legend: Legend::LowerLeft,
        },
        [
            "Four falling lines: uniform and importance sampling along the dashed σ/√N, stratified and Owen-Sobol much \
             steeper",
            "Quatre lignes qui descendent : uniforme et préférentiel le long de σ/√N en tirets, stratifié et Owen-Sobol bien plus \
             raides",
        ],
    );
    out.table(
        "monte-carlo-slopes",
        [
            "Fitted slopes ± one standard error, and the RMS error of 4096 samples",
            "Pentes ajustées ± une erreur type, et racine de l'erreur quadratique de 4096 échantillons",
        ],
        &[
            ["samples", "échantillons"],
            ["slope, theory", "pente, théorie"],
            ["slope, measured", "pente, mesurée"],
            ["error at 4096, theory", "erreur à 4096, théorie"],
            ["error at 4096, measured", "erreur à 4096, mesurée"],
        ],
        rows,
    );
    out.text([
        "The theory of strata is exact: the variances within all of them, summed. It falls a little more slowly than \
         N^(−3/2), since f has an infinite slope at 1. Importance sampling divides the error by a factor; only how \
         the numbers are spread changes the slope. In one dimension the first 2ᵏ Owen-scrambled Sobol points are \
         jittered strata: the two lines are one. They part where there are more dimensions, and where N is not known \
         beforehand.",
        "La théorie des strates est exacte : la somme des variances dans chacune. Elle décroît un peu moins vite que N^(−3/2), car f a \
         une pente infinie en 1. L'échantillonnage préférentiel divise l'erreur par un facteur ; seule la répartition des nombres change \
         la pente. En une dimension, les 2ᵏ premiers points de Sobol brouillés par Owen sont des strates : les deux lignes n'en font \
         qu'une. Elles se séparent quand il y a plus de dimensions, ou quand N n'est pas connu d'avance.",
    ]);
    out.number("slopes", slopes);
    out.number("repeats", repeats);
}

/// With minus signs for hyphens.
fn minus(text: String) -> String {
    text.replace('-', "−").replace("Owen−", "Owen-")
}

/// The standard error of the slope: a root mean square of R normal errors is off by a share of 1/√(2R).
fn slope_error(points: &[[f64; 2]], repeats: u64) -> f64 {
    let logs: Moments = points.iter().map(|p| p[0].ln()).collect();
    let spread = logs.variance() * (logs.count() - 1) as f64;
    (0.5 / repeats as f64 / spread).sqrt()
}

/// One estimate as it grows.
fn running(workshop: &Workshop, out: &mut Findings) {
    let n: u32 = 10_000;
    let sigma = quarter_disk::variance_uniform().sqrt();
    // Evenly over the logarithm.
    let mut shown: Vec<u32> = (0..=160).map(|i| 10_f64.powf(f64::from(i) / 40.0).round() as u32).collect();
    shown.dedup();
    let mut curves = Vec::new();
    for run in 0..3 {
        let (mut so_far, mut points) = (Moments::default(), Vec::new());
        for (i, u) in (1..).zip(numbers(SamplerSettings::Independent {}, workshop.seed(1_000_000_000 + run), n)) {
            so_far.add(quarter_disk::f(u));
            if shown.binary_search(&i).is_ok() {
                points.push([f64::from(i), so_far.mean()]);
            }
        }
        if run == 0 {
            let [low, high] = so_far.confidence_interval(0.99);
            out.number("mean", so_far.mean());
            out.number("confidence_99", json!([low, high]));
            let (mean, value, variance) = (so_far.mean(), quarter_disk::VALUE, so_far.variance());
            let by_theory = quarter_disk::variance_uniform();
            out.proof([
                format!(
                    "{n} uniform samples: {mean:.5}, 99 % confidence interval [{low:.5}, {high:.5}]; π/4 = {value:.5}. Variance of one \
                     sample: measured {variance:.5}, theory 2/3 − π²/16 = {by_theory:.5}."
                ),
                format!(
                    "{n} échantillons uniformes : {mean:.5}, intervalle de confiance à 99 % [{low:.5} ; {high:.5}] ; π/4 = {value:.5}. \
                     Variance d'un échantillon : mesurée {variance:.5}, en théorie 2/3 − π²/16 = {by_theory:.5}."
                ),
            ]);
            out.number(
                "variance",
                json!({ "theory": quarter_disk::variance_uniform(), "measured": so_far.variance() }),
            );
        }
        let name = format!("{} {}", workshop.say(["run", "essai"]), run + 1);
        curves.push(Curve { name, mark: Mark::Line, color: run as usize, points });
    }
    let value = quarter_disk::VALUE;
    let band = |times: f64| {
        let reach = |i: &u32| times * sigma / f64::from(*i).sqrt();
        shown.iter().map(|i| [f64::from(*i), value - reach(i), value + reach(i)]).collect()
    };
    let line = [1.0, f64::from(n)].map(|x| [x, value]).to_vec();
    curves.push(Curve { name: "π/4".into(), mark: Mark::Dashes, color: GREY, points: line });
    out.plot(
        "monte-carlo-convergence",
        Chart {
            title: workshop
                .say([
                    "Three estimates as they grow, uniform samples",
                    "Trois estimations en cours, échantillons uniformes",
                ])
                .into(),
            x: Axis {
                label: workshop.say(["samples N", "échantillons N"]),
                log: true,
                range: Some([1.0, f64::from(n)]),
            },
            y: Axis {
                label: workshop.say(["estimate", "estimation"]),
                log: false,
                range: Some([value - 0.4, value + 0.4]),
            },
            bands: vec![
                Band { name: "π/4 ± 2σ/√N".into(), color: GREY, points: band(2.0) },
                Band { name: "π/4 ± σ/√N".into(), color: GREY, points: band(1.0) },
            ],
            curves,
            legend: Legend::UpperRight,
        },
        [
            "Three wavering lines that draw near π/4 within a band of width σ/√N",
            "Trois lignes qui fluctuent et s'approchent de π/4 dans une bande de largeur σ/√N",
        ],
    );
}
