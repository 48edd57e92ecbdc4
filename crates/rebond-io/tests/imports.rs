//! glTF and OBJ: each scene of `tests/data/gltf` and `obj` is the same picture as what the TOML beside it says by hand.

mod common;

use common::{Job, LEVEL, film, judge, same_materials};
use rebond::film::Image;
use rebond::sampling::SamplerSettings;
use rebond_io::{SceneFiles, SceneSource};
use std::path::{Path, PathBuf};

/// One pixel for so many of a film that is 540 high.
const SMALLER: u32 = 15;
/// A square that holds any of the pictures.
const WHOLE: u32 = 64;

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

fn open(path: &Path) -> SceneSource {
    SceneSource::open(&path.display().to_string()).unwrap_or_else(|e| panic!("{}", e.snippet()))
}

/// The scenes: files of other programs with a TOML file beside them.
fn scenes() -> Vec<(String, PathBuf, PathBuf)> {
    let folder =
        |name: &str| std::fs::read_dir(data().join(name)).expect("a folder").map(|e| e.expect("an entry").path());
    let mut scenes: Vec<_> = folder("gltf").chain(folder("obj")).collect();
    scenes.retain(|p| p.extension().is_some_and(|e| e != "toml") && p.with_extension("toml").exists());
    scenes.retain(|p| p.extension().is_some_and(|e| ["gltf", "glb", "obj"].iter().any(|known| e == *known)));
    scenes.sort();
    let name = |p: &Path| p.file_name().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    scenes.into_iter().map(|p| (name(&p), p.clone(), p.with_extension("toml"))).collect()
}

/// Scenes whose lamps are small, or seen through glass.
const NOISY: [&str; 2] = ["emission.gltf", "room.obj"];

fn picture(source: &SceneSource, seed: u64, samples: u32) -> Image {
    let job = Job { sampler: SamplerSettings::Independent {}, seed, samples: 0..samples, ..Job::default() };
    film(source, "path", &job).develop()
}

/// The same picture, brighter.
fn brighter(image: &Image, factor: f32) -> Image {
    let mut image = image.clone();
    for layer in &mut image.layers {
        let factor = match layer.name.as_str() {
            "" => factor,
            "variance" => factor * factor,
            _ => 1.0,
        };
        layer.channels.iter_mut().flat_map(|c| &mut c.data).for_each(|x| *x *= factor);
    }
    image
}

/// Blocks and the whole, three channels each, of all scenes are judged at one level. Two per cent are always seen.
#[test]
fn scenes_are_the_pictures_that_toml_says() {
    let scenes = scenes();
    assert!(scenes.len() >= 17, "{}", scenes.len());
    let level = LEVEL / (scenes.len() * 3 * 2) as f64;
    let mut odd = Vec::new();
    for (seed, (name, theirs, ours)) in scenes.iter().enumerate() {
        let [mut theirs, mut ours] = [theirs, ours].map(|p| open(p));
        let size = |s: &SceneSource| [s.description.film.width, s.description.film.height];
        assert_eq!(size(&theirs), size(&ours), "{name}");
        for source in [&mut theirs, &mut ours] {
            let film = &mut source.description.film;
            (film.width, film.height) = (film.width / SMALLER, film.height / SMALLER);
        }
        let samples = if NOISY.contains(&name.as_str()) { 1024 } else { 256 };
        let [a, b] = [picture(&theirs, 2 * seed as u64, samples), picture(&ours, 2 * seed as u64 + 1, samples)];
        for block in [8, WHOLE] {
            odd.extend(judge(&a, &b, block, level).err().map(|e| format!("{name}, blocks of {block}, {e}")));
        }
        if judge(&a, &brighter(&b, 1.02), WHOLE, level).is_ok() {
            odd.push(format!("{name}: two per cent are not seen"));
        }
    }
    assert!(odd.is_empty(), "{}", odd.join("\n"));
}

/// What pictures of this size do not show: numbers of materials.
#[test]
fn scenes_are_made_of_what_toml_says() {
    let odd = |theirs: &Path, ours: &Path, text: &str| {
        let folder = ours.parent().expect("a folder").to_path_buf();
        let twin =
            SceneSource::parse(text, "twin", "twin", SceneFiles::Folder(folder)).unwrap_or_else(|e| panic!("{e}"));
        same_materials(&open(theirs).description, &twin.description).err().map(|e| format!("{}: {e}", theirs.display()))
    };
    let text = |path: &Path| std::fs::read_to_string(path).expect("a twin");
    let wrong: Vec<String> = scenes().iter().filter_map(|(_, a, b)| odd(a, b, &text(b))).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    let (_, theirs, ours) = scenes().into_iter().find(|(name, ..)| name == "coats.gltf").expect("coats");
    let new = text(&ours).replace("sheen = 0.8", "sheen = 0.4");
    assert!(new != text(&ours) && odd(&theirs, &ours, &new).is_some(), "less sheen is not noticed");
}

#[test]
fn a_converted_scene_is_the_same_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, theirs, _) in scenes() {
        let mut source = open(&theirs);
        (source.description.film.width, source.description.film.height) = (24, 16);
        let out = folder.path().join(format!("{name}.toml"));
        rebond_io::convert(&source, &out).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let [a, b] = [&source, &open(&out)].map(|s| picture(s, 1, 4));
        assert!(a.rgb("").is_some_and(|p| p.iter().flatten().any(|x| *x > 0.0)), "{name} is black");
        assert_eq!(a, b, "{name}");
    }
}
