//! `rebond trace`: one path, vertex by vertex.

use crate::Failure;
use crate::output::{answer, note};
use crate::render::{numbers, sampler, size};
use clap::Args;
use rebond::integrators::IntegratorSettings;
use rebond::render::Engine;
use rebond::render::journal::{Place, Story, Vertex, Weight};
use rebond::sampling::Sampler;
use rebond::scene::Scene;
use rebond_io::{SceneFiles, SceneSource, from_settings};
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(Args)]
pub struct Arguments {
    /// A built-in scene (see `rebond scenes`) or a scene file.
    scene: String,
    /// Integrator and settings, such as `path` or `path:mode=explicit`; the scene's own if not given.
    #[arg(short, long)]
    integrator: Option<String>,
    /// Which pixel, from the top left.
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
    pixel: [u32; 2],
    /// Which of its samples, from 0.
    #[arg(long, default_value_t = 0, value_name = "K")]
    sample: u32,
    /// Samples per pixel of the render that it is of, for samplers that need to know.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Size of the picture in pixels, in place of the scene's.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Seed of the sample values.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

fn pixel(text: &str) -> Result<[u32; 2], String> {
    numbers(text, &[',']).ok_or_else(|| "not a pixel such as 120,80".into())
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    let mut source = SceneSource::open(&a.scene)?;
    if let Some([width, height]) = a.size {
        (source.description.film.width, source.description.film.height) = (width, height);
    }
    let chosen =
        a.integrator.as_deref().map(from_settings::<IntegratorSettings>).transpose()?.map(|(chosen, _)| chosen);
    let [width, height] = [source.description.film.width, source.description.film.height];
    let [x, y] = a.pixel;
    if x >= width || y >= height {
        let message = format!("the pixel {x},{y} is not in the picture of {width}x{height} pixels");
        return Err(Failure::usage(message, "pixels are counted from 0, from the top left"));
    }
    let scene = source.build()?;
    let files = if chosen.is_some() { &SceneFiles::Folder(PathBuf::new()) } else { source.files() };
    let mut settings = chosen.unwrap_or_else(|| source.description.integrator.clone());
    settings.open(|file| files.solution(file, &scene)).map_err(|e| Failure::usage(e.message, e.help))?;
    let sampler = Sampler::new(sampler(&source, a.spp), a.seed);
    let refused = || {
        let message = format!("{} does not tell of single paths", settings.name());
        Failure::usage(message, "use path, direct or ambient-occlusion")
    };
    if !settings.is_adaptable() {
        return Err(refused());
    }
    let integrator =
        settings.integrator(&scene, sampler, Engine::Scalar).map_err(|e| Failure::usage(e.message, e.help))?;
    let story = integrator.tell(a.pixel, width, a.sample).ok_or_else(refused)?;
    if a.json {
        let vertices: Vec<Value> = story.vertices.iter().map(|v| of_vertex(&scene, v)).collect();
        let object = json!({ "scene": source.name, "integrator": settings.name(), "pixel": a.pixel, "sample": a.sample,
            "seed": a.seed, "vertices": vertices, "sum": story.radiance });
        return answer(&object.to_string());
    }
    note(&format!("{}, {}: sample {} of pixel {x},{y}, seed {}", source.name, settings.name(), a.sample, a.seed));
    tell(&scene, &story)
}

fn material(scene: &Scene, place: &Place) -> String {
    scene.material_name(place.material).map_or_else(|| format!("material {}", place.material), str::to_owned)
}

/// A density, which may be infinite.
fn density(x: f32) -> Value {
    if x.is_finite() { json!(x) } else { Value::Null }
}

fn of_vertex(scene: &Scene, v: &Vertex) -> Value {
    let place = v.place.map(
        |p| json!({ "position": p.position, "normal": p.normal, "material": material(scene, &p), "emits": p.emits }),
    );
    let weight = |w: &Weight| {
        json!({ "way": if w.found { "found" } else { "drawn" }, "pdf": density(w.pdf), "other_pdf": density(w.other),
            "weight": w.weight })
    };
    let asked = v.asked.map(|a| {
        json!({ "direction": a.direction, "distance": density(a.distance), "light": a.light, "blocked": a.blocked })
    });
    json!({
        "depth": v.depth,
        "origin": v.origin,
        "direction": v.direction,
        "pdf": density(v.pdf),
        "throughput": v.throughput,
        "surface": place,
        "weights": v.weights.iter().map(weight).collect::<Vec<_>>(),
        "found": v.found,
        "asked": asked,
        "contribution": v.contribution,
        "survival": v.survival,
        "event": v.event.map(|e| format!("{e:?}").to_lowercase()),
    })
}

/// Numbers as short as they can be and still be these very ones.
fn triple(x: [f32; 3]) -> String {
    format!("{:?} {:?} {:?}", x[0], x[1], x[2])
}

fn tell(scene: &Scene, story: &Story) -> Result<(), Failure> {
    let line = |name: &str, text: String| answer(&format!("   {name:<12} {text}"));
    for v in &story.vertices {
        match &v.place {
            None => answer(&format!("{}  leaves the scene", v.depth))?,
            Some(p) => {
                let light = if p.emits { ", a light" } else { "" };
                answer(&format!("{}  {}{light}", v.depth, material(scene, p)))?;
                line("position", triple(p.position))?;
                line("normal", triple(p.normal))?;
            }
        }
        line("direction", triple(v.direction))?;
        line(
            "density",
            if v.pdf.is_finite() {
                format!("{:?} per steradian", v.pdf)
            } else {
                "∞: only its sampler finds it".into()
            },
        )?;
        line("throughput", triple(v.throughput))?;
        for w in &v.weights {
            let (way, other) = if w.found { ("found", "drawing it") } else { ("drawn", "finding it") };
            line("weight", format!("{:?} of light {way}: density {:?}, by {other} {:?}", w.weight, w.pdf, w.other))?;
        }
        if v.found != [0.0; 3] {
            line("found", triple(v.found))?;
        }
        if let Some(a) = &v.asked {
            let arrives = if a.blocked { "blocked" } else { "arrives" };
            line(
                "asked",
                format!("{}, {arrives} from {:?} away, towards {}", triple(a.light), a.distance, triple(a.direction)),
            )?;
        }
        line("contributes", triple(v.contribution))?;
        if let Some(survival) = v.survival {
            let outcome = if v.event.is_some() { "goes on" } else { "ended by roulette, would go on" };
            line("roulette", format!("{outcome} with probability {survival:?}"))?;
        }
        line("goes on", v.event.map_or_else(|| "no".into(), |e| format!("{e:?}").to_lowercase()))?;
    }
    answer(&format!("sum             {}", triple(story.radiance)))
}
