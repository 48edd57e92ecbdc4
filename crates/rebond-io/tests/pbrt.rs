//! pbrt's scenes beside the same scenes in rebond's own format, written for themselves from what pbrt's book and its file format
//! say: the pictures have one expectation. `REBOND_PICTURES=FOLDER` keeps them to be looked at.

mod common;

use common::{Job, LEVEL, judge, same_materials};
use rebond::film::{Film, Image};
use rebond::render::{Budget, Region, render};
use rebond::sampling::Sampler;
use rebond_io::{ImageFormat, PngOptions, SceneFiles, SceneSource, write_image};
use statrs::distribution::{ContinuousCDF, Normal};
use std::path::{Path, PathBuf};

const SCENES: &[&str] = &[
    "coats",
    "coordinates",
    "glass",
    "glow",
    "lights",
    "metals",
    "orthographic",
    "projection",
    "sky",
    "stretched",
    "structure",
    "surfaces",
    "textures",
    "thin-lens",
    "window",
];

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pbrt")
}

fn open(name: &str, extension: &str) -> SceneSource {
    let path = data().join(format!("{name}.{extension}"));
    SceneSource::open(&path.display().to_string()).unwrap_or_else(|e| panic!("{}", e.snippet()))
}

fn picture(source: &SceneSource, seed: u64, samples: u32) -> Image {
    let scene = source.build().unwrap_or_else(|e| panic!("{}", e.snippet()));
    let description = &source.description;
    let sampler = Sampler::new(description.sampler, seed);
    let integrator = description.integrator.integrator(&scene, sampler, Job::default().engine).expect("settings");
    let [width, height] = [description.film.width, description.film.height];
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(samples), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, 2, &());
    assert_eq!(film.dropped_samples(), 0);
    film.develop()
}

/// The chance of means as different as these, channel by channel: sums of thousands of pixels are normal.
fn chance_of_means(a: &Image, b: &Image) -> [f64; 3] {
    let sum = |image: &Image, layer: &str, c: usize| {
        let channel = &image.layer(layer).expect("a layer").channels[c];
        channel.data.iter().map(|x| f64::from(*x)).sum::<f64>()
    };
    std::array::from_fn(|c| {
        let variance = sum(a, "variance", c) + sum(b, "variance", c);
        let z = (sum(a, "", c) - sum(b, "", c)) / variance.sqrt();
        2.0 * Normal::standard().sf(z.abs())
    })
}

/// Whether two pictures have one expectation: by blocks, and as a whole.
fn same(a: &Image, b: &Image) -> Result<(), String> {
    let level = LEVEL / (2.0 * 3.0 * SCENES.len() as f64);
    judge(a, b, 8, level)?;
    let chances = chance_of_means(a, b);
    if chances.iter().any(|p| *p < level) {
        return Err(format!("means by chances of {chances:?}"));
    }
    Ok(())
}

/// The picture that the scene has if all of its light is brighter by this factor.
fn brighter(mut image: Image, factor: f32) -> Image {
    for layer in &mut image.layers {
        let factor = match &*layer.name {
            "" => factor,
            "variance" => factor * factor,
            _ => continue,
        };
        layer.channels.iter_mut().flat_map(|c| &mut c.data).for_each(|x| *x *= factor);
    }
    image
}

#[test]
fn pictures_are_those_of_the_same_scene() {
    let mut count = 0;
    for entry in std::fs::read_dir(data()).expect("a folder") {
        count += usize::from(entry.expect("an entry").path().extension().is_some_and(|e| e == "pbrt"));
    }
    assert_eq!(count, SCENES.len(), "all of them");
    let mut wrong = Vec::new();
    for name in SCENES {
        let (a, b) = (open(name, "pbrt"), open(name, "toml"));
        let what =
            |s: &SceneSource| (s.description.film.clone(), s.description.sampler, s.description.integrator.clone());
        assert_eq!(what(&a), what(&b), "{name}");
        assert_eq!(a.samples, Some(64), "{name}");
        let [a, b] = [picture(&a, 1, 256), picture(&b, 2, 256)];
        for (image, kind) in [(&a, "pbrt"), (&b, "toml")] {
            if let Ok(folder) = std::env::var("REBOND_PICTURES") {
                let png = write_image(image, ImageFormat::Png, &PngOptions::default()).expect("an image");
                std::fs::write(Path::new(&folder).join(format!("{name}-{kind}.png")), png).expect("a file");
            }
        }
        wrong.extend(same(&a, &b).err().map(|e| format!("{name}: {e}")));
        // What this may miss is small.
        if same(&a, &brighter(b, 1.02)).is_ok() {
            wrong.push(format!("{name}: two per cent more light are not noticed"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// What pictures of this size do not show: numbers of materials.
#[test]
fn materials_are_those_of_the_same_scene() {
    let odd = |name: &str, text: &str| {
        let twin = SceneSource::parse(text, name, name, SceneFiles::Folder(data())).unwrap_or_else(|e| panic!("{e}"));
        same_materials(&open(name, "pbrt").description, &twin.description).err().map(|e| format!("{name}: {e}"))
    };
    let text = |name: &str| std::fs::read_to_string(data().join(format!("{name}.toml"))).expect("a twin");
    let wrong: Vec<String> = SCENES.iter().filter_map(|name| odd(name, &text(name))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    for (name, from, to) in [
        ("glass", "ext_ior = 1.6727", "ext_ior = 1.6034"),
        ("coats", "alpha = 0.5", "alpha = 0.25"),
        ("coats", "\"dielectric\", int_ior = 1.4", "\"dielectric\", int_ior = 1.5"),
        ("metals", "metal = \"aluminium\"", "metal = \"silver\""),
    ] {
        let (old, new) = (text(name), text(name).replace(from, to));
        assert!(old != new && odd(name, &new).is_some(), "{name}: {to} is not noticed");
    }
}

#[test]
fn converted_scenes_are_the_same_pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in SCENES {
        let source = open(name, "pbrt");
        let out = folder.path().join(format!("{name}.toml"));
        rebond_io::convert(&source, &out).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let again = SceneSource::open(&out.display().to_string()).unwrap_or_else(|e| panic!("{}", e.snippet()));
        assert_eq!(picture(&source, 1, 1), picture(&again, 1, 1), "{name}");
    }
}
