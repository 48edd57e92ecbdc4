//! `rebond compare`: several integrators on one scene, at equal samples, time or error, and how wrong each still is.

mod contest;
mod measure;
mod page;
mod reference;

use crate::Failure;
use crate::judge::of_test;
use crate::output::{answer, make_folder, note, write, write_bytes, write_text};
use crate::plot::quoted;
use crate::progress::catch_interrupt;
use crate::render::{DEFAULT_SAMPLES, duration, positive, size};
use clap::Args;
use contest::{Contender, Run, Stage};
use measure::{Measured, Verdict};
use rebond::render::Budget;
use rebond_io::{PngOptions, SceneSource};
use reference::Reference;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

#[derive(Args)]
pub struct Arguments {
    /// A built-in scene (see `rebond scenes`) or a scene file.
    scene: String,
    /// An integrator and its settings, such as `path:mode=implicit`; give several.
    #[arg(short, long = "integrator", required = true)]
    integrator: Vec<String>,
    /// Samples per pixel of each [default: 64, unless --time or --error is given].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Time of each, such as 30s, 500ms, 2m.
    #[arg(long, value_parser = duration)]
    time: Option<Duration>,
    /// Estimated relative error that each is to reach, such as 0.01.
    #[arg(long, value_parser = positive)]
    error: Option<f64>,
    /// What they are held to: an image file; an integrator; or `auto`: bidirectional, or path where that cannot run.
    #[arg(long, default_value = "auto")]
    reference: String,
    /// Samples per pixel of a reference that is made [default: 16 times --spp, at least 1024].
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..))]
    reference_spp: Option<u32>,
    /// Folder that keeps references for the next time [default: rebond/references in the user's cache folder].
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Size of the pictures in pixels, in place of the scene's.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Seed of the sample values: the first integrator's; each other has the next, so that no two share random numbers.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads to use [default: all].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Folder for the page (index.html), pictures (EXR, PNG) and numbers (JSON, CSV); made if there is none.
    #[arg(short, long, value_name = "DIR", default_value = "compare")]
    output: PathBuf,
    /// No progress and no notes.
    #[arg(long)]
    quiet: bool,
    /// Print one JSON object with all numbers.
    #[arg(long)]
    json: bool,
}

/// One of the integrators: what it did, and how wrong it is.
pub struct Entry {
    pub run: Run,
    pub measured: Measured,
    /// Against the reference, where that knows its variance.
    pub verdict: Option<Verdict>,
}

/// All that was found.
pub struct Report {
    pub scene: String,
    pub size: [u32; 2],
    pub budget: String,
    /// Whether `rebond render` makes the same pictures: it spends a time or an error in passes of its own.
    pub alone: bool,
    pub threads: usize,
    pub reference: Reference,
    pub entries: Vec<Entry>,
    /// Of each against each: numbers of the two, and the outcome.
    pub pairs: Vec<(usize, usize, Verdict)>,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let mut source = SceneSource::open(&a.scene)?;
    if let Some([width, height]) = a.size {
        (source.description.film.width, source.description.film.height) = (width, height);
    }
    if let Some(twice) = a.integrator.iter().enumerate().find(|(i, text)| a.integrator[..*i].contains(text)) {
        return Err(Failure::usage(format!("the integrator {} is there twice", twice.1), "give each once"));
    }
    let contender = |(k, text): (u64, &String)| Ok(Contender::parse(text, a.seed.wrapping_add(k))?.numbered(k + 1));
    let contenders = (0..).zip(&a.integrator).map(contender);
    let mut contenders = contenders.collect::<Result<Vec<_>, Failure>>()?;
    let mut budget = Budget { samples: a.spp, time: a.time, error: a.error, adaptive: false };
    if (a.spp, a.time, a.error) == (None, None, None) {
        budget.samples = Some(DEFAULT_SAMPLES);
    }
    let wanted = reference::Wanted::parse(&a.reference)?;
    make_folder(&a.output)?;
    let threads = a.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()), usize::from);
    let mut stage = Stage::new(source, threads, a.quiet)?;
    if !a.quiet {
        stage.scene.statistics().warnings.iter().for_each(|w| note(&format!("warning: {w}")));
    }
    // Whether all of them can run at all, before any does.
    contenders.iter_mut().try_for_each(|c| stage.check(c))?;
    catch_interrupt();

    let reference_spp = a.reference_spp.unwrap_or_else(|| a.spp.unwrap_or(0).saturating_mul(16).max(1024));
    let reference = reference::find(&wanted, reference_spp, a.cache.as_deref(), &mut stage)?;
    if !a.quiet {
        note(&format!("reference: {}", reference.story));
    }
    let (mut entries, mut outcome) = (Vec::new(), Ok(()));
    for contender in contenders {
        let run = contest::run(&stage, contender, &reference, &budget)?;
        let interrupted = run.interrupted;
        let measured = Measured::new(&reference, &run)?;
        if !a.quiet {
            let error = measured.rel_mse;
            let seconds = run.seconds;
            note(&format!("{}: relMSE {error:.3e} after {seconds:.2} s", run.contender.text));
            if reference.noise.is_some_and(|noise| 4.0 * noise > error) {
                note("  the reference is hardly better: raise --reference-spp");
            }
        }
        let verdict = Verdict::new(&reference.image, &run.image);
        entries.push(Entry { run, measured, verdict });
        if interrupted {
            outcome = Err(Failure::Interrupted);
            break;
        }
    }
    let pairs = (0..entries.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
    let pairs = pairs.filter_map(|(j, i)| Some((j, i, Verdict::new(&entries[j].run.image, &entries[i].run.image)?)));
    let pairs = pairs.collect();
    let report = Report {
        scene: a.scene.clone(),
        size: stage.size(),
        budget: words(&budget),
        alone: (a.time, a.error) == (None, None),
        threads,
        reference,
        entries,
        pairs,
    };
    let numbers = numbers(&report);
    let outputs = write_report(a, &report, &numbers)?;
    if a.json {
        let mut numbers = numbers;
        numbers["outputs"] = json!(outputs);
        answer(&numbers.to_string())?;
    } else {
        outputs.iter().take(1).try_for_each(|n| answer(n))?;
    }
    outcome
}

/// A budget in words.
fn words(budget: &Budget) -> String {
    let samples = budget.samples.map(|n| format!("{n} samples per pixel"));
    let time = budget.time.map(|t| format!("{} s", t.as_secs_f64()));
    let error = budget.error.map(|e| format!("an estimated relative error of {e}"));
    [samples, time, error].into_iter().flatten().collect::<Vec<_>>().join(" or ")
}

fn of_verdict(verdict: &Verdict) -> Value {
    let channels = |tests: &[(&'static str, rebond::compare::Welch)]| {
        tests.iter().map(|(c, w)| ((*c).to_owned(), of_test(w))).collect::<serde_json::Map<_, _>>()
    };
    json!({ "agrees": verdict.agrees(), "brightness": verdict.brightness, "brightness_p": verdict.brightness_p(), "side": verdict.side,
        "blocks": channels(&verdict.blocks), "whole": channels(&verdict.whole) })
}

/// All numbers, for programs.
fn numbers(report: &Report) -> Value {
    let reference = &report.reference;
    let entry = |e: &Entry| {
        let (run, m) = (&e.run, &e.measured);
        json!({
            "integrator": run.contender.text,
            "seed": run.contender.seed,
            "biased": run.contender.settings.leaves_out(),
            "seconds": run.seconds,
            "samples_per_pixel": run.samples_per_pixel(),
            "samples": run.samples,
            "rays": run.rays,
            "samples_per_second": run.samples as f64 / run.seconds,
            "rays_per_second": run.rays as f64 / run.seconds,
            "dropped_samples": run.dropped,
            "peak_memory_bytes": run.memory,
            "mse": m.mse,
            "rel_mse": m.rel_mse,
            "rel_mse_trimmed": m.rel_mse_trimmed,
            "flip": m.flip.mean,
            "hdr_flip": m.hdr_flip.mean,
            "mean_signed_error": m.bias,
            "rel_mse_times_seconds": m.rel_mse * run.seconds,
            "slope_by_samples": m.slopes[0].map(|f| f.slope),
            "slope_by_seconds": m.slopes[1].map(|f| f.slope),
            "curve": run.curve.iter().map(|p| json!({ "samples_per_pixel": p.samples, "seconds": p.seconds,
                "rays": p.rays, "mse": p.mse, "rel_mse": p.rel_mse })).collect::<Vec<_>>(),
            "against_reference": e.verdict.as_ref().map(of_verdict),
            "file": format!("{}.exr", run.contender.file),
        })
    };
    let pair = |(i, j, verdict): &(usize, usize, Verdict)| {
        let name = |k: usize| report.entries[k].run.contender.text.clone();
        json!({ "first": name(*i), "second": name(*j), "test": of_verdict(verdict) })
    };
    json!({
        "scene": report.scene,
        "width": report.size[0],
        "height": report.size[1],
        "threads": report.threads,
        "budget": report.budget,
        "reference": {
            "integrator": reference.integrator,
            "samples_per_pixel": reference.samples,
            "cached": reference.cached,
            "kept": reference.path.as_ref().map(|p| p.display().to_string()),
            "rel_mse_of_its_own": reference.noise,
            "file": "reference.exr",
        },
        "integrators": report.entries.iter().map(entry).collect::<Vec<_>>(),
        "pairs": report.pairs.iter().map(pair).collect::<Vec<_>>(),
    })
}

/// Writes the page and what lies beside it; returns the names, the page's first.
fn write_report(a: &Arguments, report: &Report, numbers: &Value) -> Result<Vec<String>, Failure> {
    let folder = &a.output;
    let mut names = Vec::new();
    let mut place = |name: String| {
        let path = folder.join(name);
        names.push(path.display().to_string());
        path
    };
    write_text(&place("index.html".into()), &page::html(report)?)?;
    write_text(&place("results.json".into()), &format!("{numbers:#}\n"))?;
    write_text(&place("results.csv".into()), &page::table(report).csv())?;
    let mut curves = String::from("integrator,samples_per_pixel,seconds,rays,mse,rel_mse\n");
    for run in report.entries.iter().map(|e| &e.run) {
        for p in &run.curve {
            let name = quoted(&run.contender.text);
            // Writing to a string cannot fail.
            let _ = writeln!(curves, "{name},{},{},{},{},{}", p.samples, p.seconds, p.rays, p.mse, p.rel_mse);
        }
    }
    write_text(&place("convergence.csv".into()), &curves)?;
    let [by_samples, by_time] = page::charts(report);
    write_text(&place("error-samples.svg".into()), &by_samples.svg())?;
    write_text(&place("error-time.svg".into()), &by_time.svg())?;
    let png = PngOptions::default();
    write(&report.reference.image, &[place("reference.exr".into())], &png)?;
    for e in &report.entries {
        let file = &e.run.contender.file;
        write(&e.run.image, &[place(format!("{file}.exr")), place(format!("{file}.png"))], &png)?;
        for (kind, map) in [("flip", e.measured.flip_map(report.size)?), ("relmse", e.measured.error_map(report.size)?)]
        {
            let path = place(format!("{file}-{kind}.png"));
            let shown = path.display().to_string();
            write_bytes(&path, &map).map_err(|e| Failure::Run(format!("cannot write \"{shown}\": {e}")))?;
        }
    }
    Ok(names)
}
