//! The page of a comparison. Pictures lie in it as half floats, so that their exposure can be chosen there (page.js).

use super::contest::Run;
use super::measure::{Fit, LEVEL, Verdict, colour};
use super::{Entry, Report};
use crate::Failure;
use crate::output::bytes;
use crate::page::{self, Table, base64, drawing};
use crate::plot::{Axis, Chart, Curve, GREY, Legend, Mark};
use maud::{Markup, PreEscaped, html};
use rebond::film::Image;
use rebond_io::{ImageFormat, PngOptions, write_image};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A number with three digits that say something.
fn short(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        1.0..1e4 if x.fract() == 0.0 => format!("{x}"),
        1e-2..1e4 => {
            let digits = (2 - x.abs().log10().floor() as i32).max(0) as usize;
            format!("{x:.digits$}")
        }
        _ => format!("{x:.2e}"),
    }
}

/// How many there are of something.
fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// A slope, with a minus sign for a hyphen.
fn signed(x: f64) -> String {
    format!("{x:.2}").replace('-', "−")
}

/// What each did, in numbers.
pub fn table(report: &Report) -> Table {
    let head = [
        "integrator",
        "samples per pixel",
        "seconds",
        "M samples/s",
        "M rays/s",
        "relMSE",
        "relMSE without the worst 0.1 %",
        "relMSE × seconds",
        "FLIP",
        "HDR-FLIP",
        "slope by samples",
        "slope by time",
        "brightness",
        "peak memory",
    ];
    let slope = |fit: Option<Fit>| fit.map_or_else(|| "–".into(), |f| format!("{:.2}", f.slope));
    let row = |e: &Entry| {
        let (run, m) = (&e.run, &e.measured);
        vec![
            run.contender.text.clone(),
            short(run.samples_per_pixel()),
            short(run.seconds),
            short(run.samples as f64 / run.seconds / 1e6),
            short(run.rays as f64 / run.seconds / 1e6),
            format!("{:.3e}", m.rel_mse),
            format!("{:.3e}", m.rel_mse_trimmed),
            format!("{:.3e}", m.rel_mse * run.seconds),
            format!("{:.4}", m.flip.mean),
            format!("{:.4}", m.hdr_flip.mean),
            slope(m.slopes[0]),
            slope(m.slopes[1]),
            e.verdict.as_ref().map_or_else(|| "–".into(), |v| format!("{:+.2} %", 100.0 * v.brightness)),
            run.memory.map_or_else(|| "–".into(), bytes),
        ]
    };
    Table {
        name: "results".into(),
        caption: "All that was measured; less is better but for the speeds. The picture's brightness is relative to the reference's."
            .into(),
        head: head.map(String::from).into(),
        rows: report.entries.iter().map(row).collect(),
    }
}

/// As it is read: numbers, which the first column has not, with minus signs for hyphens.
fn read(mut table: Table) -> Table {
    table.rows.iter_mut().flat_map(|row| &mut row[1..]).for_each(|cell| *cell = cell.replace('-', "−"));
    table
}

/// The error against samples, and against time.
pub fn charts(report: &Report) -> [Chart; 2] {
    let chart = |k: usize, label: &'static str, title: &str| {
        let (mut curves, mut ends) = (Vec::new(), [f64::INFINITY, 0.0]);
        for (color, e) in report.entries.iter().enumerate() {
            let of = |p: &super::contest::Point| [[p.samples, p.seconds][k], p.rel_mse];
            let points: Vec<[f64; 2]> = e.run.curve.iter().map(of).filter(|p| p[0] > 0.0 && p[1] > 0.0).collect();
            ends = points.iter().fold(ends, |[a, b], p| [a.min(p[0]), b.max(p[0])]);
            let name = match e.measured.slopes[k] {
                Some(fit) => format!("{}, slope {}", e.run.contender.text, signed(fit.slope)),
                None => e.run.contender.text.clone(),
            };
            let color = color % GREY;
            curves.push(Curve { name, mark: Mark::LineAndDots, color, points });
            if let Some(fit) = e.measured.slopes[k] {
                let at = |x: f64| [x, fit.factor * x.powf(fit.slope)];
                let points = vec![at(fit.from), at(fit.to)];
                curves.push(Curve { name: String::new(), mark: Mark::Dashes, color, points });
            }
        }
        if let Some(noise) = report.reference.noise.filter(|n| *n > 0.0 && ends[0] < ends[1]) {
            let points = vec![[ends[0], noise], [ends[1], noise]];
            curves.push(Curve { name: "the reference's own noise".into(), mark: Mark::Dashes, color: GREY, points });
        }
        Chart {
            title: title.into(),
            x: Axis { label, log: true, range: None },
            y: Axis { label: "relMSE", log: true, range: None },
            bands: vec![],
            curves,
            legend: Legend::LowerLeft,
        }
    };
    [chart(0, "samples per pixel", "Error against samples"), chart(1, "seconds", "Error against time")]
}

/// The page.
pub fn html(report: &Report) -> Result<String, Failure> {
    let [width, height] = report.size;
    let names: Vec<&str> = report.entries.iter().map(|e| &*e.run.contender.text).collect();
    let alone: Vec<&Run> =
        report.entries.iter().map(|e| &e.run).filter(|run| report.alone && !run.interrupted).collect();
    let mut views = vec![view("reference", &report.reference.image, &[])?];
    for e in &report.entries {
        let maps = [
            ("relmse", "relMSE", e.measured.error_map(report.size)?),
            ("flip", "FLIP", e.measured.flip_map(report.size)?),
        ];
        views.push(view(&e.run.contender.text, &e.run.image, &maps)?);
    }
    let title = format!("{}: {}", report.scene, names.join(", "));
    let [by_samples, by_time] = charts(report);
    let body = html! {
        header {
            h1 { (report.scene) ": a comparison" }
            p {
                (counted(names.len(), "integrator")) ", each " (report.budget) ", at " (width) "×" (height) " pixels on "
                (counted(report.threads, "thread")) ", held to a reference: " (report.reference.story) "."
                @if let Some(what) = &report.reference.biased { " It is biased: " (what) "." }
            }
        }
        main {
            (viewer(report, &views))
            h2 { "Numbers" }
            (read(table(report)).html())
            (verdicts(report))
            h2 { "Convergence" }
            p {
                "Dashes are straight lines fitted by least squares where the error is more than four times the reference's own "
                "noise. Without bias relMSE falls like 1/N, a slope of −1; well spread samples can do better, and bias shows as a "
                "level that no curve gets below."
            }
            figure { (drawing(&by_samples.svg(), "Curves of relMSE over samples per pixel, both logarithmic")) }
            figure { (drawing(&by_time.svg(), "Curves of relMSE over seconds, both logarithmic")) }
        }
        footer {
            p { "Made by rebond " (env!("CARGO_PKG_VERSION")) ". Beside this page: the pictures (EXR with their variance, PNG), "
                "results.json, results.csv and convergence.csv." @if !alone.is_empty() { " Each picture alone:" } }
            @for run in alone {
                p { code {
                    "rebond render " (page::shell(&report.scene)) " -i " (page::shell(&run.contender.text))
                    " --size " (width) "x" (height) " --spp " (run.samples_per_pixel().round())
                    " --seed " (run.contender.seed) " -o " (run.contender.file) ".exr"
                } }
            }
        }
        script { (PreEscaped(SCRIPT)) }
    };
    Ok(page::document("en", &title, STYLE, &body))
}

/// What a picture is on the page.
struct View {
    name: String,
    markup: Markup,
}

fn view(name: &str, image: &Image, maps: &[(&str, &str, Vec<u8>)]) -> Result<View, Failure> {
    let png = write_image(image, ImageFormat::Png, &PngOptions::default())?;
    let pixels = image.rgb("").unwrap_or_default();
    let halves: Vec<u8> =
        pixels.iter().flatten().flat_map(|x| half::f16::from_f32(x.clamp(-65504.0, 65504.0)).to_le_bytes()).collect();
    let markup = html! {
        div class="pane" data-layer="picture" data-width=(image.width) data-height=(image.height) {
            (page::image(&png, &format!("The picture: {name}")))
            script type="text/plain" class="halves" { (base64(&halves)) }
        }
        @for (kind, title, png) in maps {
            div class="pane" data-layer=(kind) { (page::image(png, &format!("{title} of {name}, pixel by pixel"))) }
        }
    };
    Ok(View { name: name.into(), markup })
}

/// Pictures side by side, swiped or flipped, under one exposure and one zoom.
fn viewer(report: &Report, views: &[View]) -> Markup {
    let ratio = format!("--ratio: {} / {}", report.size[0], report.size[1]);
    let stops: Vec<String> = (0..=8)
        .map(|k| {
            let [r, g, b] = colour(f64::from(k) / 8.0);
            format!("rgb({r} {g} {b})")
        })
        .collect();
    let bar = format!("background: linear-gradient(to right, {})", stops.join(", "));
    let choice = |id: &str, chosen: usize| {
        html! {
            select id=(id) {
                @for (i, v) in views.iter().enumerate() {
                    option value=(i) selected[i == chosen] { (v.name) }
                }
            }
        }
    };
    html! {
        section id="viewer" style=(ratio) data-mode="side" data-layer="picture" {
            div class="tools" {
                div class="group" role="group" aria-label="view" {
                    button type="button" data-mode="side" { "side by side" }
                    button type="button" data-mode="swipe" { "swipe" }
                    button type="button" data-mode="flip" { "flip" }
                }
                div class="group" role="group" aria-label="layer" {
                    button type="button" data-layer="picture" { "picture" }
                    button type="button" data-layer="relmse" { "relMSE" }
                    button type="button" data-layer="flip" { "FLIP" }
                }
                label { "exposure "
                    input id="exposure" type="range" min="-8" max="8" step="0.25" value="0";
                    output id="stops" { "0" }
                }
                button type="button" id="reset" { "reset zoom" }
            }
            div class="tools pair" { label { "left " (choice("left", 0)) } label { "right " (choice("right", 1)) } }
            div class="tools which" {
                label class="switch" { input id="auto" type="checkbox"; " by itself" }
            }
            div class="views" {
                @for (i, v) in views.iter().enumerate() {
                    figure class="view" data-view=(i) {
                        div class="frame" tabindex="0" aria-label={ (v.name) ": wheel or + and − zoom, dragging or arrows move" } {
                            div class="zoomed" { (v.markup) }
                        }
                        figcaption { (v.name) }
                    }
                }
                input id="divider" type="range" min="0" max="1000" value="500" aria-label="where the left picture ends";
            }
            p class="legend relmse" { "relMSE of a pixel, logarithmic: 10⁻⁴ " span class="bar" style=(bar) {} " 1" }
            p class="legend flip" { "FLIP, at exposure 0: 0 " span class="bar" style=(bar) {} " 1" }
            p class="keys" { "Wheel, pinch, or + and −: zoom. Drag or arrows: move. 0 or a double click: all. In flip, space and 1, 2, … choose." }
        }
    }
}

/// Who agrees with whom.
fn verdicts(report: &Report) -> Markup {
    let say = |v: &Verdict| {
        let ([odd, all], side) = (v.odd_blocks(), v.side);
        format!(
            "{}: {:+.2} % in brightness (p = {}), {odd} of {all} blocks of {side}×{side} differ",
            if v.agrees() { "agrees" } else { "differs" },
            100.0 * v.brightness,
            short(v.brightness_p())
        )
        .replace('-', "−")
    };
    html! {
        h2 { "Right, or only less noisy?" }
        p {
            "Welch's t-test of blocks of pixels (of 8×8, or as many as have 16\u{202f}384 samples) and of the whole picture, in each "
            "channel, at a level of " (100.0 * LEVEL) " % in all: can both have one expectation? A verdict “differs” means bias, or "
            "light so rare that the samples have not met it yet."
        }
        @if report.entries.iter().all(|e| e.verdict.is_none()) {
            p class="proof" { "Not possible against this reference, which does not know its variance." }
        }
        ul {
            @for e in &report.entries {
                @if let Some(v) = &e.verdict {
                    li class=(if v.agrees() { "agrees" } else { "differs" }) {
                        b { (e.run.contender.text) } " against the reference " (say(v)) "."
                        @if let Some(what) = e.run.contender.settings.leaves_out() { " It is biased: " (what) "." }
                    }
                }
            }
            @for (i, j, v) in &report.pairs {
                li class=(if v.agrees() { "agrees" } else { "differs" }) {
                    b { (report.entries[*j].run.contender.text) } " against " b { (report.entries[*i].run.contender.text) } " "
                    (say(v)) "."
                }
            }
        }
    }
}
