//! `rebond scenes`, `rebond info`, `rebond integrators`.

use crate::Failure;
use crate::open::{ImportArguments, open};
use crate::output::{answer, bytes, note, peak_memory_bytes};
use clap::Args;
use rebond::integrators::INTEGRATORS;
use rebond_io::{BUILT_IN_SCENES, SceneSource};
use serde_json::{Value, json};
use std::time::Instant;

#[derive(Args)]
pub struct JsonFlag {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
pub struct InfoArguments {
    /// A built-in scene, a .toml file or another program's scene (.xml of Mitsuba, .pbrt, .gltf, .glb, .obj).
    scene: String,
    #[command(flatten)]
    import: ImportArguments,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn scenes(a: &JsonFlag) -> Result<(), Failure> {
    let sources = BUILT_IN_SCENES.iter().map(|b| SceneSource::open(b.name)).collect::<Result<Vec<_>, _>>()?;
    if a.json {
        let all: Vec<Value> = sources.iter().map(|s| json!({ "name": s.name, "title": s.description.title })).collect();
        return answer(&Value::from(all).to_string());
    }
    let width = sources.iter().map(|s| s.name.len()).max().unwrap_or(0);
    sources.iter().try_for_each(|s| answer(&format!("{:<width$} {}", s.name, s.description.title)))
}

pub fn integrators(a: &JsonFlag) -> Result<(), Failure> {
    if a.json {
        let settings =
            |s: &[(&str, &str)]| s.iter().map(|(k, v)| (k.to_string(), json!(v))).collect::<serde_json::Map<_, _>>();
        let one = |i: &rebond::integrators::IntegratorInfo| json!({ "name": i.name, "summary": i.summary, "settings": settings(i.settings) });
        return answer(&Value::from(INTEGRATORS.iter().map(one).collect::<Vec<_>>()).to_string());
    }
    for i in INTEGRATORS {
        answer(&format!("{:<17} {}", i.name, i.summary))?;
        i.settings.iter().try_for_each(|(name, what)| answer(&format!("  {name:<15} {what}")))?;
    }
    Ok(())
}

pub fn info(a: &InfoArguments) -> Result<(), Failure> {
    let start = Instant::now();
    let source = open(&a.scene, &a.import, a.json)?;
    let scene = source.build()?;
    let seconds = start.elapsed().as_secs_f64();
    let (s, (lo, hi)) = (scene.statistics(), scene.bounds());
    let film = &source.description.film;
    if a.json {
        let of_import = source.warnings.iter().map(|w| w.to_string());
        let all_warnings: Vec<String> = of_import.chain(s.warnings.iter().cloned()).collect();
        return answer(
            &json!({
                "scene": source.name,
                "title": source.description.title,
                "width": film.width,
                "height": film.height,
                "triangles": s.triangles,
                "analytic_shapes": s.analytic_shapes,
                "instances": s.instances,
                "emitters": s.emitters,
                "materials": s.materials,
                "bounds": [lo, hi],
                "accelerator_bytes": s.accelerator_bytes,
                "table_bytes": s.table_bytes,
                "peak_memory_bytes": peak_memory_bytes(),
                "accelerator_seconds": s.accelerator_seconds,
                "load_and_build_seconds": seconds,
                "warnings": all_warnings,
            })
            .to_string(),
        );
    }
    let memory = bytes(s.accelerator_bytes + s.table_bytes);
    let rows = [
        ("title", source.description.title.clone()),
        ("film", format!("{} × {}", film.width, film.height)),
        ("triangles", s.triangles.to_string()),
        ("spheres, disks", s.analytic_shapes.to_string()),
        ("instances", s.instances.to_string()),
        ("emitters", s.emitters.to_string()),
        ("materials", s.materials.to_string()),
        ("bounds", format!("{lo:?} to {hi:?}")),
        ("memory", format!("{memory} ({} of it for ray queries)", bytes(s.accelerator_bytes))),
        ("peak memory", peak_memory_bytes().map_or("unknown".into(), bytes)),
        ("build time", format!("{:.3} s ({seconds:.3} s with loading)", s.accelerator_seconds)),
    ];
    rows.iter().try_for_each(|(name, value)| answer(&format!("{name:<16} {value}")))?;
    s.warnings.iter().for_each(|w| note(&format!("warning: {w}")));
    Ok(())
}
