//! `rebond render`.

use crate::Failure;
use crate::open::{ImportArguments, open};
use crate::output::{answer, check, check_place, layer_outputs, note, peak_memory_bytes, warn, write, write_text};
use crate::progress::{Progress, catch_interrupt};
use crate::pyramid;
use clap::Args;
use rebond::emitter::LightChoice;
use rebond::film::{Aov, Film, Image};
use rebond::integrators::{IntegratorError, IntegratorSettings};
use rebond::render::{Budget, Engine, PathExpression, PathLayer, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{Error, PngOptions, SceneFiles, SceneSource, Tonemap, from_settings};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Samples per pixel where no budget is given.
pub const DEFAULT_SAMPLES: u32 = 64;

#[derive(Args)]
pub struct Arguments {
    /// A built-in scene (see `rebond scenes`), a .toml file or another program's scene (.xml of Mitsuba, .pbrt, .gltf, .glb, .obj).
    scene: String,
    #[command(flatten)]
    import: ImportArguments,
    /// Integrator and settings, such as `path` or `path:max_depth=8`; the scene's own if not given.
    #[arg(short, long)]
    integrator: Option<String>,
    /// Samples per pixel [default: the scene's if it names them, else 64, unless --time or --error is given].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Time to render, such as 30s, 500ms, 2m.
    #[arg(long, value_parser = duration)]
    time: Option<Duration>,
    /// Relative error to reach, such as 0.01.
    #[arg(long, value_parser = positive)]
    error: Option<f64>,
    /// Size of the picture in pixels, in place of the scene's.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Let more samples go where the estimated error is larger; --error does.
    #[arg(long)]
    adaptive: bool,
    /// Lay light into layers too: `length` (by number of vertices), `class` (emission, direct, caustic, indirect; diffuse,
    /// glossy, specular) or expressions such as LDE,LS+DE.
    #[arg(long, value_parser = split)]
    split: Option<Split>,
    /// What camera rays meet, in layers too, beside those that the scene asks for: depth, position, uv, geo-normal, sh-normal,
    /// albedo, prim-index, shape-index.
    #[arg(long, value_delimiter = ',', value_parser = aov)]
    aov: Vec<Aov>,
    /// Render only this part, in pixels from the top left.
    #[arg(long, value_name = "X,Y,W,H", value_parser = crop)]
    crop: Option<[u32; 4]>,
    /// Seed of the sample values.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads to use [default: all].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// How an emitter is chosen to light a point, in place of the scene's own way.
    #[arg(long, value_enum)]
    light_choice: Option<LightChoiceName>,
    /// Many paths at once, or one after the other for reference.
    #[arg(long, value_enum, default_value_t = EngineName::Wavefront)]
    engine: EngineName,
    /// File to write (.exr .hdr .pfm .png); may be given several times [default: SCENE.png and SCENE.exr here].
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// One page with the pictures of all strategies, for bidirectional:strategies=true.
    #[arg(long, value_name = "FILE.html")]
    pyramid: Option<PathBuf>,
    /// Stops by which to brighten a PNG.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    exposure: f32,
    /// How a PNG fits bright colours.
    #[arg(long, value_enum, default_value_t = TonemapName::None)]
    tonemap: TonemapName,
    /// No progress and no notes.
    #[arg(long)]
    quiet: bool,
    /// Print one JSON object with the run's statistics.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum EngineName {
    Wavefront,
    Scalar,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum LightChoiceName {
    Power,
    Tree,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum TonemapName {
    None,
    Reinhard,
    Aces,
}

/// The layers that light is laid into.
#[derive(Clone)]
struct Split(Vec<PathLayer>);

/// Vertices of the longest paths that have a layer of their own.
const LONGEST: u32 = 10;

fn split(text: &str) -> Result<Split, String> {
    Ok(Split(match text {
        "length" => PathLayer::by_length(LONGEST),
        "class" => PathLayer::by_class(),
        _ => {
            // Commas within braces are of the expression.
            let mut depth = 0;
            let parts = text.split(|c: char| {
                depth += i32::from(c == '{') - i32::from(c == '}');
                c == ',' && depth == 0
            });
            let expressions = parts.map(|e| e.trim().parse()).collect::<Result<Vec<PathExpression>, _>>()?;
            if let Some(twice) = expressions.iter().enumerate().find(|(i, e)| expressions[..*i].contains(e)) {
                return Err(format!("{} is there twice", twice.1));
            }
            PathLayer::by_expressions(&expressions)
        }
    }))
}

fn aov(text: &str) -> Result<Aov, String> {
    let known = Aov::ALL.map(Aov::name);
    let found = Aov::ALL.into_iter().find(|aov| aov.name() == text);
    found.ok_or_else(|| format!("no layer \"{text}\": there are {}", known.join(", ")))
}

pub fn duration(text: &str) -> Result<Duration, String> {
    // From the back, so that the e of an exponent is not taken for a unit.
    let (number, unit) = text.split_at(text.trim_end_matches(|c: char| c.is_ascii_alphabetic()).len());
    let factor = match unit {
        "ms" => 1e-3,
        "s" | "" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("no unit of time \"{unit}\": use ms, s, m or h")),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| "not a time such as 30s".to_string())? * factor;
    if seconds > 0.0 {
        Duration::try_from_secs_f64(seconds).map_err(|e| e.to_string())
    } else {
        Err("not a positive time".into())
    }
}

pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("not a positive number".into()),
    }
}

fn finite(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("not a number".into()),
    }
}

pub fn numbers<const N: usize>(text: &str, separator: &[char]) -> Option<[u32; N]> {
    let parts: Option<Vec<u32>> = text.split(separator).map(|p| p.trim().parse().ok()).collect();
    parts?.try_into().ok()
}

pub fn size(text: &str) -> Result<[u32; 2], String> {
    match numbers(text, &['x', 'X', '×']) {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err("not a size such as 640x480".into()),
    }
}

fn crop(text: &str) -> Result<[u32; 4], String> {
    match numbers(text, &[',']) {
        Some([x, y, w, h]) if w > 0 && h > 0 => Ok([x, y, w, h]),
        _ => Err("not four numbers X,Y,W,H with W and H above 0".into()),
    }
}

/// The scene's sample values, for a render of this many samples if they are known.
pub fn sampler(source: &SceneSource, spp: Option<u32>) -> SamplerSettings {
    match source.description.sampler {
        // Strata are those of the whole render.
        SamplerSettings::Stratified { samples: 0 } => {
            SamplerSettings::Stratified { samples: spp.unwrap_or(DEFAULT_SAMPLES) }
        }
        other => other,
    }
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let start = Instant::now();
    let integrator: Option<IntegratorSettings> =
        a.integrator.as_deref().map(|i| from_settings(i).map(|(s, _)| s)).transpose()?;
    let mut source = open(&a.scene, &a.import, a.quiet)?;
    let description = &mut source.description;
    if let Some([w, h]) = a.size {
        (description.film.width, description.film.height) = (w, h);
    }
    if let Some((_, twice)) = a.aov.iter().enumerate().find(|(i, aov)| a.aov[..*i].contains(aov)) {
        let message = format!("the layer \"{}\" of --aov is there twice", twice.name());
        return Err(Failure::usage(message, "name each once"));
    }
    for aov in &a.aov {
        if !description.film.aovs.contains(aov) {
            description.film.aovs.push(*aov);
        }
    }
    if let Some(choice) = a.light_choice {
        description.light_choice = Some(match choice {
            LightChoiceName::Power => LightChoice::Power,
            LightChoiceName::Tree => LightChoice::Tree,
        });
    }
    let [width, height] = [description.film.width, description.film.height];
    let region = match a.crop {
        None => Region::whole(width, height),
        Some([x, y, w, h]) => {
            if u64::from(x) + u64::from(w) > u64::from(width) || u64::from(y) + u64::from(h) > u64::from(height) {
                let message = format!("the crop {x},{y},{w},{h} leaves the picture of {width}x{height} pixels");
                return Err(Failure::usage(message, "give X,Y,W,H with X+W and Y+H within it"));
            }
            Region { x, y, width: w, height: h, full_width: width }
        }
    };
    let outputs = match a.output.is_empty() {
        false => a.output.clone(),
        true => ["png", "exr"].map(|e| PathBuf::from(format!("{}.{e}", source.name))).to_vec(),
    };
    let layers = a.split.as_ref().map_or(&[][..], |s| &s.0);
    // Files that the command line names are relative to where it is given, those of a scene to the scene.
    let files = if integrator.is_some() { &SceneFiles::Folder(PathBuf::new()) } else { source.files() };
    let mut settings = integrator.unwrap_or_else(|| source.description.integrator.clone());
    let layer_names = layers.iter().map(|l| l.name.clone()).chain(settings.own_layers());
    // They are the last.
    let aovs = source.description.film.aovs.iter().map(|aov| aov.name().to_owned());
    let layer_names: Vec<String> = layer_names.chain(aovs).collect();
    if let Some(page) = &a.pyramid {
        if !matches!(settings, IntegratorSettings::Bidirectional(_)) || settings.own_layers().is_empty() {
            let message =
                "a pyramid is made of the pictures of all strategies, and this integrator writes none".to_owned();
            return Err(Failure::usage(message, "use -i bidirectional:strategies=true,max_depth=5"));
        }
        check_place(page)?;
    }
    // The page has them all.
    let beside = if a.pyramid.is_some() { &layer_names[..layers.len()] } else { &layer_names[..] };
    let of_layers = layer_outputs(&outputs, beside.iter().map(|name| &**name));
    let all: Vec<PathBuf> = outputs.iter().chain(of_layers.iter().map(|(_, path)| path)).cloned().collect();
    check(&all)?;
    if !of_layers.is_empty()
        && let Some(twice) = all.iter().enumerate().find(|(i, path)| all[..*i].contains(path))
    {
        let message = format!("two pictures would be called \"{}\"", twice.1.display());
        return Err(Failure::usage(message, "write an .exr, which holds all layers, or give other names"));
    }
    if a.adaptive && !settings.is_adaptable() {
        let message = format!("the samples of {} are not alike: no pixel may have more than another", settings.name());
        return Err(Failure::usage(message, "leave out --adaptive"));
    }
    let adaptive = a.adaptive || a.error.is_some() && settings.is_adaptable();
    let mut budget = Budget { samples: a.spp, time: a.time, error: a.error, adaptive };
    if (a.spp, a.time, a.error) == (None, None, None) {
        budget.samples = Some(source.samples.unwrap_or(DEFAULT_SAMPLES));
    }
    let threads = a.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()), usize::from);
    let load_seconds = start.elapsed().as_secs_f64();

    let build_start = Instant::now();
    let scene = source.build().map_err(|e| match (a.size, e.path.as_str()) {
        // What the file says about the size is not at fault.
        (Some(_), "film" | "film.width" | "film.height") => Error { file: None, place: None, path: String::new(), ..e },
        _ => e,
    })?;
    let build_seconds = build_start.elapsed().as_secs_f64();
    if !a.quiet {
        scene.statistics().warnings.iter().for_each(|w| note(&format!("warning: {w}")));
    }

    catch_interrupt();
    let sampler = sampler(&source, budget.samples);
    let engine = match a.engine {
        EngineName::Wavefront => Engine::Wavefront,
        EngineName::Scalar => Engine::Scalar,
    };
    let refused = |e: IntegratorError| match &a.integrator {
        Some(text) => Failure::usage(format!("{text}: {}", e.message), e.help),
        None => source.refused(e).into(),
    };
    settings.open(|file| files.solution(file, &scene)).map_err(refused)?;
    let integrator =
        settings.layered_integrator(&scene, Sampler::new(sampler, a.seed), engine, layers).map_err(refused)?;
    if !a.quiet
        && !a.json
        && let Some(what) = settings.leaves_out()
    {
        note(&format!("note: biased: {what}"));
    }
    if !a.quiet {
        settings.warnings(&scene).iter().for_each(|w| note(&format!("warning: only the diffuse part of {w}")));
    }
    let mut film = Film::try_new(region.width, region.height, &layer_names).ok_or_else(|| {
        Failure::Run(format!(
            "not enough memory for a film of {}x{} pixels; render it in parts with --crop",
            region.width, region.height
        ))
    })?;
    let progress = Progress::new(budget, region.pixels(), a.quiet);
    let statistics = render(&*integrator, &mut film, region, 0, &budget, threads, &progress);
    progress.finish();
    if statistics.interrupted && !a.quiet {
        note("stopped: writing what there is; another Ctrl-C loses it");
    }

    if !a.quiet {
        warn(&*integrator, "");
    }

    let tonemap = match a.tonemap {
        TonemapName::None => Tonemap::None,
        TonemapName::Reinhard => Tonemap::Reinhard,
        TonemapName::Aces => Tonemap::Aces,
    };
    let (image, png) = (film.develop(), PngOptions { exposure: a.exposure, tonemap });
    write(&image, &outputs, &png)?;
    for (layer, path) in &of_layers {
        let alone = image.rgb(layer).map(|pixels| Image::from_rgb(image.width, image.height, &pixels));
        write(&alone.expect("a layer of the film"), std::slice::from_ref(path), &png)?;
    }
    if let Some(page) = &a.pyramid {
        let made = format!(
            "Made by rebond {}: rebond render {} -i {}, {} samples per pixel, {:.1} s.",
            env!("CARGO_PKG_VERSION"),
            a.scene,
            a.integrator.as_deref().unwrap_or(settings.name()),
            statistics.samples / region.pixels(),
            statistics.seconds
        );
        write_text(page, &pyramid::page(&image, &source.name, &made)?)?;
    }
    let dropped = film.dropped_samples();
    if dropped > 0 && !a.quiet {
        note(&format!("warning: {dropped} samples were not finite, or too bright for a film, and count as black"));
    }
    let written = outputs.iter().chain(of_layers.iter().map(|(_, path)| path)).chain(&a.pyramid);
    let names: Vec<String> = written.map(|p| p.display().to_string()).collect();
    if a.json {
        let error = film.relative_error();
        let counts: serde_json::Map<String, serde_json::Value> =
            integrator.counts().into_iter().map(|(name, n)| (name.into(), n.into())).collect();
        answer(
            &serde_json::json!({
                "scene": source.name,
                "integrator": settings.name(),
                "load_seconds": load_seconds,
                "build_seconds": build_seconds,
                "render_seconds": statistics.seconds,
                "samples": statistics.samples,
                "rays": statistics.rays.total(),
                "rays_by_depth": statistics.rays.by_depth,
                "shadow_rays": statistics.rays.shadow,
                "counts": counts,
                "dropped_samples": dropped,
                "peak_memory_bytes": peak_memory_bytes(),
                "error": error.is_finite().then_some(error),
                "biased": settings.is_biased(),
                "outputs": names,
            })
            .to_string(),
        )?;
    } else {
        names.iter().try_for_each(|n| answer(n))?;
    }
    if statistics.interrupted { Err(Failure::Interrupted) } else { Ok(()) }
}
