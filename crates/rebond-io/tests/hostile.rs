//! Files from strangers: whatever they hold, an importer ends, soon, with a scene or an error, and with little memory.
//!
//! `REBOND_FUZZ_SECONDS=600 cargo test --release -p rebond-io --test hostile for_a_long_time -- --ignored --nocapture` goes on for so
//! long with each format, or with that which `REBOND_FUZZ_FORMAT` names.

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rebond_io::{
    ImportOptions, SceneSource, read_gltf, read_image, read_mitsuba, read_obj, read_obj_scene, read_pbrt, read_ply,
};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mitsuba")
}

fn pbrt() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pbrt")
}

const LENIENT: ImportOptions = ImportOptions { lenient: true, allow_outside: false };

/// Reads and, if it is a scene that is not too large, builds it.
/// The files of a library of materials are in `folder`.
fn swallow(format: Format, bytes: &[u8], folder: &Path) {
    for options in [ImportOptions::default(), LENIENT] {
        let read = match format {
            Format::Meshes => {
                return match bytes.starts_with(b"ply") {
                    true => drop(read_ply(bytes, "a.ply")),
                    false => drop(read_obj(bytes, "a.obj")),
                };
            }
            Format::Images => {
                return ["a.png", "a.pfm", "a.hdr"].iter().for_each(|name| drop(read_image(bytes, name)));
            }
            Format::Mitsuba => read_mitsuba(&String::from_utf8_lossy(bytes), "a.xml", &data(), options),
            Format::Pbrt => read_pbrt(&String::from_utf8_lossy(bytes), "a.pbrt", &pbrt(), options),
            Format::Gltf => read_gltf(bytes, "a.gltf", &data().join("../gltf"), options),
            Format::Obj => read_obj_scene(bytes, "a.obj", &data().join("../obj"), options),
            Format::Mtl => {
                std::fs::write(folder.join("room.mtl"), bytes).expect("a file");
                let room = std::fs::read(data().join("../obj/room.obj")).expect("a scene");
                read_obj_scene(&room, "a.obj", folder, options)
            }
        };
        match read {
            Ok(scene) => drop(SceneSource::imported(scene, "a").build()),
            Err(e) => drop(e.snippet()),
        }
    }
}

#[derive(Clone, Copy, Debug)]
enum Format {
    Mitsuba,
    Pbrt,
    Gltf,
    Obj,
    Mtl,
    Meshes,
    Images,
}

/// The files of a folder with one of these extensions.
fn files(folder: &Path, extensions: &[&str]) -> Vec<Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path());
    let wanted = |p: &PathBuf| p.extension().is_some_and(|e| extensions.contains(&&*e.to_string_lossy()));
    let mut files: Vec<PathBuf> = entries.filter(wanted).collect();
    files.sort();
    files.iter().map(|p| std::fs::read(p).expect("a file")).collect()
}

/// Good files to begin with.
fn seeds(format: Format) -> Vec<Vec<u8>> {
    match format {
        Format::Obj => vec![std::fs::read(data().join("../obj/room.obj")).expect("a scene")],
        Format::Mtl => vec![std::fs::read(data().join("../obj/room.mtl")).expect("a library")],
        Format::Mitsuba => files(&data(), &["xml"]),
        Format::Meshes => files(&data().join("parts"), &["ply", "obj"]),
        Format::Images => {
            let sky = include_bytes!("../../../scenes/window.hdr").to_vec();
            files(&data().join("parts"), &["png", "pfm"]).into_iter().chain([sky]).collect()
        }
        Format::Pbrt => {
            let text = r#"LookAt 3 4 1.5 .5 .5 0 0 0 1 Camera "perspective" "float fov" 45 "float lensradius" 0.1
Film "rgb" "integer xresolution" 8 "integer yresolution" 6 Sampler "halton" "integer pixelsamples" 4 Integrator "bdpt" "integer maxdepth" 3
PixelFilter "mitchell" WorldBegin LightSource "infinite" "blackbody L" 5000 "float scale" .4
AttributeBegin Rotate -90 1 0 0 Scale 2 2 2 ReverseOrientation AreaLightSource "diffuse" "spectrum L" [400 1 500 2 700 3] Shape "disk" AttributeEnd
Texture "q" "spectrum" "imagemap" "string filename" "parts/quarters.png" "float scale" .5 "bool invert" true "float uscale" 3
Texture "c" "spectrum" "checkerboard" "rgb tex1" [.8 .8 .8] Texture "h" "float" "imagemap" "string filename" "parts/holes.png"
MakeNamedMaterial "a" "string type" "diffuse" "texture reflectance" "q" MakeNamedMaterial "b" "string type" "conductor" "spectrum eta" "metal-Ag-eta"
Material "mix" "string materials" ["a" "b"] "float amount" .3 ObjectBegin "o" Shape "plymesh" "string filename" "parts/lump.ply" ObjectEnd
AttributeBegin ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1] ObjectInstance "o" AttributeEnd Material "coateddiffuse" "float roughness" .1
Shape "loopsubdiv" "integer levels" 2 "point3 P" [1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1] "integer indices" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5]
Shape "bilinearmesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 1] "texture alpha" "h" Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "point2 uv" [0 0 1 0 0 1]
"#;
            files(&pbrt(), &["pbrt"]).into_iter().chain([text.as_bytes().to_vec()]).collect()
        }
        Format::Gltf => {
            let text = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual","KHR_texture_transform"],
"extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","intensity":3,"spot":{"innerConeAngle":0.2}},{"type":"point","range":4}]}},
"scene":0,"scenes":[{"nodes":[0,1,2]}],
"nodes":[{"mesh":0,"children":[3]},{"camera":0,"translation":[0,0,5],"rotation":[0,0,0,1]},{"extensions":{"KHR_lights_punctual":{"light":0}}},
{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,1,2,3,1]}],
"cameras":[{"type":"perspective","perspective":{"yfov":0.3,"znear":0.1,"aspectRatio":1.5}}],
"images":[{"uri":"quarters.png"}],"samplers":[{"magFilter":9728,"wrapS":33648,"wrapT":33648}],"textures":[{"source":0,"sampler":0}],
"materials":[{"doubleSided":true,"alphaMode":"MASK","emissiveFactor":[0,0,0],"normalTexture":{"index":0,"scale":0.5},
"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"rotation":0.3}}},"baseColorFactor":[1,0.5,1,1],"roughnessFactor":0.4}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":2},"indices":1,"mode":5,"material":0}]}],
"accessors":[{"bufferView":0,"componentType":5121,"count":4,"type":"VEC3"},{"bufferView":1,"componentType":5121,"count":4,"type":"SCALAR"},
{"componentType":5126,"count":4,"type":"VEC2","sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":0}}}],
"bufferViews":[{"buffer":0,"byteLength":16,"byteStride":4},{"buffer":0,"byteOffset":16,"byteLength":4}],
"buffers":[{"byteLength":20,"uri":"data:;base64,AAAAAAEAAAAAAQAAAQEBAAABAgM="}]}"#;
            let mut json = text.as_bytes().to_vec();
            json.resize(json.len().next_multiple_of(4), b' ');
            let mut glb = b"glTF\x02\0\0\0".to_vec();
            glb.extend(((20 + json.len()) as u32).to_le_bytes());
            glb.extend((json.len() as u32).to_le_bytes());
            glb.extend(b"JSON");
            glb.extend(&json);
            let mut seeds = vec![text.as_bytes().to_vec(), glb];
            seeds.extend(files(&data().join("../gltf"), &["gltf", "glb"]));
            seeds
        }
    }
}

/// One change of a file: bytes, words or pieces of it, or of another.
#[derive(Clone, Debug)]
enum Change {
    Byte(f64, u8),
    Cut(f64, f64),
    Copy(f64, f64, f64),
    Word(f64, usize),
}

/// What stands where a number or a name stood.
const WORDS: &[&str] = &[
    "-1",
    "0",
    "1e39",
    "-1e-39",
    "nan",
    "inf",
    "4294967296",
    "18446744073709551615",
    "\"\"",
    "$spp",
    "$",
    "null",
    "[]",
    "{}",
    "true",
    "<scene>",
    "</scene>",
    "<ref id=\"white\"/>",
    "parts/two.serialized",
    "..",
    "../mitsuba",
    "\u{0}",
    "ö",
    "0, 0, 0",
    "twosided",
    "shapegroup",
    "instance",
    "mask",
    "merge",
    "envmap",
    "bumpmap",
    "blackbody",
    "300:1, 400:2",
];

fn changed(seed: &[u8], changes: &[Change]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for change in changes {
        let at = |share: f64, bytes: &[u8]| ((share * bytes.len() as f64) as usize).min(bytes.len());
        // Up to 60 bytes from there.
        let piece = |from: f64, length: f64, bytes: &[u8]| {
            let start = at(from, bytes);
            start..(start + (length * 60.0) as usize).min(bytes.len())
        };
        match *change {
            Change::Byte(share, value) => {
                let i = at(share, &bytes);
                if let Some(byte) = bytes.get_mut(i) {
                    *byte = value;
                }
            }
            Change::Cut(from, length) => drop(bytes.drain(piece(from, length, &bytes))),
            Change::Copy(from, length, to) => {
                let copy = bytes[piece(from, length, &bytes)].to_vec();
                let to = at(to, &bytes);
                drop(bytes.splice(to..to, copy));
            }
            Change::Word(share, word) => {
                // In place of what stands between the next two quotes.
                let start = at(share, &bytes);
                let quotes: Vec<usize> =
                    (start..bytes.len()).filter(|i| matches!(bytes[*i], b'"' | b':' | b',')).take(2).collect();
                if let [a, b] = quotes[..] {
                    drop(bytes.splice(a + 1..b, WORDS[word % WORDS.len()].bytes()));
                }
            }
        }
    }
    bytes
}

fn change() -> impl Strategy<Value = Change> {
    let share = 0.0..1.0f64;
    prop_oneof![
        (share.clone(), any::<u8>()).prop_map(|(a, b)| Change::Byte(a, b)),
        (share.clone(), share.clone()).prop_map(|(a, b)| Change::Cut(a, b)),
        (share.clone(), share.clone(), share.clone()).prop_map(|(a, b, c)| Change::Copy(a, b, c)),
        (share.clone(), any::<usize>()).prop_map(|(a, b)| Change::Word(a, b)),
        (share, any::<usize>()).prop_map(|(a, b)| Change::Word(a, b)),
    ]
}

/// Small files take milliseconds, and those with the largest numbers that are allowed seconds: what takes longer than this will not
/// end, on the slowest of machines.
const HANG: Duration = Duration::from_secs(600);

/// How many cases, and how long the longest of them took.
fn fuzz(format: Format, cases: u32) -> (u32, Duration) {
    let seeds = seeds(format);
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let folder = tempfile::tempdir().expect("a folder");
    for image in ["quarters.png", "holes.png"] {
        std::fs::copy(data().join("../obj").join(image), folder.path().join(image)).expect("an image");
    }
    let strategy = (0..seeds.len(), proptest::collection::vec(change(), 1..6));
    let longest = std::cell::Cell::new(Duration::ZERO);
    let outcome = TestRunner::new(config).run(&strategy, |(seed, changes)| {
        let bytes = changed(&seeds[seed], &changes);
        let start = Instant::now();
        let (done, ended) = mpsc::channel();
        let path = folder.path().to_path_buf();
        let thread = std::thread::spawn(move || {
            swallow(format, &bytes, &path);
            let _ = done.send(());
        });
        // A panic closes the channel too.
        prop_assert!(ended.recv_timeout(HANG) != Err(mpsc::RecvTimeoutError::Timeout), "it hangs");
        prop_assert!(thread.join().is_ok(), "it panics");
        longest.set(longest.get().max(start.elapsed()));
        Ok(())
    });
    outcome.unwrap_or_else(|e| panic!("{format:?}: {e}"));
    (cases, longest.get())
}

#[test]
fn broken_mitsuba_scenes_end() {
    fuzz(Format::Mitsuba, 150);
}

#[test]
fn broken_pbrt_scenes_end() {
    fuzz(Format::Pbrt, 100);
}

#[test]
fn broken_gltf_scenes_end() {
    fuzz(Format::Gltf, 300);
}

#[test]
fn broken_obj_scenes_end() {
    fuzz(Format::Obj, 300);
    fuzz(Format::Mtl, 300);
}

#[test]
fn broken_meshes_and_images_end() {
    fuzz(Format::Meshes, 100);
    fuzz(Format::Images, 100);
}

#[test]
#[expect(clippy::print_stdout)]
#[ignore = "as long as REBOND_FUZZ_SECONDS says, with each format"]
fn for_a_long_time() {
    let seconds = std::env::var("REBOND_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(60);
    let only = std::env::var("REBOND_FUZZ_FORMAT").ok();
    for format in
        [Format::Pbrt, Format::Mitsuba, Format::Gltf, Format::Obj, Format::Mtl, Format::Meshes, Format::Images]
    {
        if only.as_ref().is_some_and(|name| !format!("{format:?}").eq_ignore_ascii_case(name)) {
            continue;
        }
        let (start, mut cases, mut longest) = (Instant::now(), 0, Duration::ZERO);
        while start.elapsed() < Duration::from_secs(seconds) {
            let (more, longer) = fuzz(format, 200);
            (cases, longest) = (cases + more, longest.max(longer));
        }
        println!("{format:?}: {cases} cases in {:?}, the longest in {longest:?}", start.elapsed());
    }
}

fn sensor(more: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><sensor type="perspective"><film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor>{more}</scene>"#
    )
}

/// A megabyte of what each format allows most of: nesting, names within names, includes within includes, empty buffers.
#[test]
fn a_megabyte_of_malice_is_refused() {
    let nested = |open: &str, close: &str, n: usize| sensor(&format!("{}{}", open.repeat(n), close.repeat(n)));
    let deep = nested(r#"<bsdf type="twosided">"#, "</bsdf>", 30_000);
    let error = |text: &str| match read_mitsuba(text, "a.xml", &data(), LENIENT) {
        Err(e) => e.message,
        Ok(_) => "it is a scene".into(),
    };
    assert!(error(&deep).contains("within each other"), "{}", error(&deep));
    // Each parameter is a thousand times the one before.
    let grow = (0..20).map(|i| format!(r#"<default name="p{}" value="{}"/>"#, i + 1, format!("$p{i}").repeat(1000)));
    let grow = format!(r#"<default name="p0" value="a"/>{}<string name="x" value="$p20"/>"#, grow.collect::<String>());
    assert!(
        error(&sensor(&grow)).contains("letters") || error(&sensor(&grow)).contains("means nothing"),
        "{}",
        error(&sensor(&grow))
    );
    let folder = tempfile::tempdir().expect("a folder");
    // A file that includes the next one twice, forty times over; and one that includes itself.
    for i in 0..40 {
        let include = format!(
            r#"<scene version="3.0.0"><include filename="{0}.xml"/><include filename="{0}.xml"/></scene>"#,
            i + 1
        );
        std::fs::write(folder.path().join(format!("{i}.xml")), include).expect("a file");
    }
    std::fs::write(folder.path().join("40.xml"), r#"<scene version="3.0.0"><include filename="40.xml"/></scene>"#)
        .expect("a file");
    for first in ["0.xml", "40.xml"] {
        let text = sensor(&format!(r#"<include filename="{first}"/>"#));
        let error = read_mitsuba(&text, "a.xml", folder.path(), LENIENT).expect_err("too many files").message;
        assert!(error.contains("files within files without end"), "{error}");
    }
    let entity = r#"<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><scene version="3.0.0">&b;</scene>"#;
    assert!(error(entity).contains("not valid XML"), "{}", error(entity));
    // pbrt: attributes without end, round shapes that have to be meshes, and textures of a texture, each worked out.
    let pbrt = |text: &str| match read_pbrt(
        &format!("Camera \"perspective\" WorldBegin {text}"),
        "a.pbrt",
        &pbrt(),
        LENIENT,
    ) {
        Err(e) => e.message,
        Ok(scene) => format!("{} images", scene.files.images.len()),
    };
    assert!(pbrt(&"AttributeBegin ".repeat(70_000)).contains("within each other"));
    assert!(pbrt(&"Shape \"sphere\" \"float phimax\" 9 ".repeat(30_000)).contains("would come to more than"));
    assert!(pbrt(&"Shape \"cylinder\" ".repeat(50_000)).contains("would come to more than"));
    let many: String = (0..60_000).map(|i| format!("\"float p{i}\" 1 ")).collect();
    assert!(pbrt(&format!("Shape \"sphere\" {many}")).contains("more than 256 parameters"));
    let image = "Texture \"0\" \"spectrum\" \"imagemap\" \"string filename\" \"parts/quarters.png\" ";
    let scale = |i: usize| {
        let of = format!("\"texture tex\" \"{i}\" \"float scale\" 0.9999");
        format!(
            "Texture \"{}\" \"spectrum\" \"scale\" {of} Material \"diffuse\" \"texture reflectance\" \"{i}\" ",
            i + 1
        )
    };
    assert_eq!(pbrt(&format!("{image}{}", (0..3000).map(scale).collect::<String>())), "2999 images");
    // Mixes of mixes: each names the one before twice, and is kept once.
    let mix = |i: usize| {
        let made = format!("MakeNamedMaterial \"m{}\" \"string type\" \"mix\" \"string materials\"", i + 1);
        format!("{made} [\"m{i}\" \"m{i}\"] ")
    };
    for kind in ["diffuse", "dielectric"] {
        let of = |n: usize, shapes: std::ops::Range<usize>| {
            let mixes: String = (0..n).map(mix).collect();
            let shapes: String = shapes.map(|i| format!("NamedMaterial \"m{i}\" Shape \"sphere\" ")).collect();
            let text = format!(
                "Camera \"perspective\" WorldBegin MakeNamedMaterial \"m0\" \"string type\" \"{kind}\" {mixes}{shapes}"
            );
            read_pbrt(&text, "a.pbrt", &data(), LENIENT).expect("a scene")
        };
        // Each is a step from one that is known; the last by itself is three thousand of them.
        let scene = of(3000, 0..3000);
        assert!(scene.description.materials.len() <= 6001, "{}", scene.description.materials.len());
        SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
        let last = SceneSource::imported(of(3000, 2999..3000), "a").build();
        let error = last.map(|_| ()).expect_err("too deep").message;
        assert!(error.contains("nested too deeply"), "{error}");
    }
    // glTF: what is said to be there and is not, and nodes that double a thousand times.
    let gltf = |value: &str| match read_gltf(value.as_bytes(), "a.gltf", &data(), LENIENT) {
        Err(e) => e.message,
        Ok(_) => "it is a scene".into(),
    };
    let nodes: Vec<String> =
        (0..200).map(|i| format!(r#"{{"children":[{0},{0}]}}"#, i + 1)).chain(["{}".into()]).collect();
    let doubling =
        format!(r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{}]}}"#, nodes.join(","));
    assert!(gltf(&doubling).contains("there are too many"), "{}", gltf(&doubling));
    let zeros = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"componentType":5126,"count":4000000000,"type":"VEC3"}]}"#;
    assert!(gltf(zeros).contains("zeros are more than"), "{}", gltf(zeros));
    assert!(gltf(&format!("{}{}", "[".repeat(500_000), "]".repeat(500_000))).contains("not valid glTF"));
}
