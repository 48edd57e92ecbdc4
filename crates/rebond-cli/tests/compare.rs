//! `rebond compare`, run as a program.

use rebond::film::Image;
use rebond_io::read_image;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

fn temporary() -> TempDir {
    TempDir::new().expect("a folder for temporary files")
}

fn run(folder: &TempDir, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rebond"));
    // References are not to be left in the cache of who runs the tests.
    command.current_dir(folder.path()).env("XDG_CACHE_HOME", folder.path().join("cache"));
    command.arg("compare").args(arguments).output().expect("the program runs")
}

fn json(folder: &TempDir, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--json", "--quiet"]].concat());
    let (said, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{arguments:?}: {failed}");
    serde_json::from_str(&said).expect("one JSON object")
}

fn image(path: &Path) -> Image {
    let bytes = std::fs::read(path).expect("a file");
    read_image(&bytes, &path.display().to_string()).expect("an image")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A floor under a lamp, this bright, that is not in the picture.
fn lamp(folder: &TempDir, name: &str, radiance: f64) {
    let text = format!(
        "sampler.type = \"independent\"\n\
         [film]\nwidth = 24\nheight = 16\n\
         [camera]\ntype = \"perspective\"\nfov = 50\n\
         to_world.look_at = {{ origin = [0, 3, 4], target = [0, 0, 0], up = [0, 1, 0] }}\n\
         [materials]\nfloor = {{ type = \"diffuse\", reflectance = 0.5 }}\n\
         [[shapes]]\ntype = \"rectangle\"\nmaterial = \"floor\"\n\
         to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = -90 }} }}, {{ scale = 4 }}]\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [0, 4, 0]\nradius = 0.5\nmaterial = \"floor\"\n\
         emission = [{radiance}, {radiance}, {radiance}]\n"
    );
    std::fs::write(folder.path().join(name), text).expect("a scene");
}

#[test]
fn a_comparison_is_a_page_with_all_that_it_says() {
    let folder = temporary();
    lamp(&folder, "lamp.toml", 4.0);
    let arguments =
        ["lamp.toml", "-i", "path", "-i", "bidirectional", "-i", "path:max_depth=2", "--spp", "64", "-o", "out"];
    let found = json(&folder, &[&arguments[..], &["--reference-spp", "256"]].concat());
    for name in found["outputs"].as_array().expect("names") {
        assert!(folder.path().join(name.as_str().expect("a name")).is_file(), "{name}");
    }
    let page = std::fs::read_to_string(folder.path().join("out/index.html")).expect("a page");
    assert!(!page.contains("src=\"http") && !page.contains("url(") && !page.contains("@import"));
    assert_eq!(page.matches("<img ").count(), page.matches("alt=\"").count());

    // Reference and figures, again from the files.
    let reference = image(&folder.path().join("out/reference.exr")).rgb("").expect("colours");
    let entries = found["integrators"].as_array().expect("a list");
    assert_eq!(entries.len(), 3);
    for e in entries {
        let file = folder.path().join("out").join(e["file"].as_str().expect("a name"));
        let pixels = image(&file).rgb("").expect("colours");
        let both = reference.iter().flatten().zip(pixels.iter().flatten()).map(|(r, x)| (f64::from(*r), f64::from(*x)));
        let n = 3.0 * reference.len() as f64;
        let mse = both.clone().map(|(r, x)| (x - r) * (x - r)).sum::<f64>() / n;
        let rel_mse = both.map(|(r, x)| (x - r) * (x - r) / (r * r + 0.01)).sum::<f64>() / n;
        assert!((number(&e["mse"]) / mse - 1.0).abs() < 1e-9);
        assert!((number(&e["rel_mse"]) / rel_mse - 1.0).abs() < 1e-9);
        let curve = e["curve"].as_array().expect("points");
        let samples: Vec<f64> = curve.iter().map(|p| number(&p["samples_per_pixel"])).collect();
        assert_eq!(samples, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0]);
        assert_eq!(curve.last().map(|p| number(&p["rel_mse"])), e["rel_mse"].as_f64());
    }
    assert!(entries[2]["biased"].is_string() && entries[0]["biased"].is_null());
    // What is unbiased agrees, with the reference and with each other.
    assert_eq!(entries[0]["against_reference"]["agrees"], true);
    assert_eq!(entries[1]["against_reference"]["agrees"], true);
    let pair = &found["pairs"][0];
    assert_eq!(
        (&pair["first"], &pair["second"], &pair["test"]["agrees"]),
        (&"path".into(), &"bidirectional".into(), &true.into())
    );

    // The picture is that of a render.
    let alone = ["render", "lamp.toml", "-i", "path", "--spp", "64", "--seed", "0", "-o", "alone.exr", "--quiet"];
    let alone =
        Command::new(env!("CARGO_BIN_EXE_rebond")).current_dir(folder.path()).args(alone).output().expect("runs");
    assert!(alone.status.success());
    assert_eq!(image(&folder.path().join("alone.exr")), image(&folder.path().join("out/1-path.exr")));

    // The second time the reference is there already, unless the scene, or what makes it, is another.
    let kept = |found: &Value| found["reference"]["cached"] == true;
    assert!(!kept(&found));
    let quick = ["lamp.toml", "-i", "path", "--spp", "2", "-o", "again", "--reference-spp"];
    let again = json(&folder, &[&quick[..], &["256"]].concat());
    assert!(kept(&again));
    assert!(
        std::fs::read(folder.path().join("again/reference.exr")).ok()
            == std::fs::read(folder.path().join("out/reference.exr")).ok()
    );
    assert!(!kept(&json(&folder, &[&quick[..], &["64"]].concat())));
    assert!(!kept(&json(&folder, &[&quick[..], &["256", "--size", "8x8"]].concat())));
    lamp(&folder, "lamp.toml", 5.0);
    assert!(!kept(&json(&folder, &[&quick[..], &["256"]].concat())));
}

#[test]
fn two_percent_more_light_is_flagged() {
    let folder = temporary();
    lamp(&folder, "right.toml", 4.0);
    lamp(&folder, "wrong.toml", 4.08);
    let right = json(&folder, &["right.toml", "-i", "path", "--spp", "256", "--reference-spp", "1024", "-o", "right"]);
    assert_eq!(right["integrators"][0]["against_reference"]["agrees"], true, "{right:#}");
    let reference = ["--reference", "right/reference.exr", "-o", "wrong"];
    let wrong = json(&folder, &[&["wrong.toml", "-i", "path", "--spp", "256"][..], &reference].concat());
    let verdict = &wrong["integrators"][0]["against_reference"];
    assert_eq!(verdict["agrees"], false, "{wrong:#}");
    assert!((number(&verdict["brightness"]) - 0.02).abs() < 0.005, "{verdict}");
}

#[test]
fn time_and_error_are_budgets_too() {
    let folder = temporary();
    lamp(&folder, "lamp.toml", 4.0);
    let reference = ["-i", "path", "--reference", "path", "--reference-spp", "64"];
    let by_time = json(&folder, &[&["lamp.toml", "--time", "200ms", "-o", "t"][..], &reference].concat());
    assert!(number(&by_time["integrators"][0]["seconds"]) >= 0.2);
    let by_error = json(&folder, &[&["lamp.toml", "--error", "0.05", "-o", "e"][..], &reference].concat());
    let samples = number(&by_error["integrators"][0]["samples_per_pixel"]);
    // Not at once, and not doubled far beyond what was needed.
    assert!((16.0..4096.0).contains(&samples), "{samples}");
}

#[test]
fn the_reference_is_found_where_paths_from_the_eye_miss_the_light() {
    let folder = temporary();
    let arguments =
        ["caustic-mirror", "-i", "path", "--spp", "1", "--size", "12x9", "--reference-spp", "4", "-o", "out"];
    assert_eq!(json(&folder, &arguments)["reference"]["integrator"], "bidirectional");
}

#[test]
fn a_reference_that_a_file_makes_is_not_kept() {
    let folder = temporary();
    let solve = ["radiosity", "cornell-box", "--patches", "50", "-o", "box.safetensors", "--quiet"];
    let solved = Command::new(env!("CARGO_BIN_EXE_rebond")).current_dir(folder.path()).args(solve).output();
    assert!(solved.expect("runs").status.success());
    let reference = ["--reference", "radiosity:solution=box.safetensors", "--reference-spp", "4", "-o", "out"];
    let found =
        json(&folder, &[&["cornell-box", "-i", "path", "--spp", "1", "--size", "8x8"][..], &reference].concat());
    assert!(found["reference"]["kept"].is_null(), "{found:#}");
}

#[test]
fn each_integrator_has_files_of_its_own() {
    let folder = temporary();
    lamp(&folder, "lamp.toml", 4.0);
    let long = format!("path:paths={}", ["LD*E"; 60].join("|"));
    let arguments = ["lamp.toml", "-i", "path:paths=LD*E", "-i", "path:paths=LD?E", "-i", &long, "--spp", "1"];
    let found = json(&folder, &[&arguments[..], &["--reference-spp", "2", "-o", "out"]].concat());
    let files: Vec<&str> =
        found["integrators"].as_array().expect("a list").iter().map(|e| e["file"].as_str().expect("a name")).collect();
    assert!(
        files[0] == "1-path_paths_LD_E.exr" && files[1] == "2-path_paths_LD_E.exr" && files[2].len() < 90,
        "{files:?}"
    );
    let page = std::fs::read_to_string(folder.path().join("out/index.html")).expect("a page");
    assert!(
        page.contains("-i &#39;path:paths=LD*E&#39;") || page.contains("-i 'path:paths=LD*E'"),
        "quoted for a shell"
    );
    let timed = json(&folder, &["lamp.toml", "-i", "path", "--time", "20ms", "--reference-spp", "2", "-o", "timed"]);
    assert_eq!(timed["integrators"][0]["file"], "1-path.exr");
    let page = std::fs::read_to_string(folder.path().join("timed/index.html")).expect("a page");
    assert!(!page.contains("rebond render"));
}

#[test]
fn what_cannot_be_compared_is_said() {
    let folder = temporary();
    lamp(&folder, "lamp.toml", 4.0);
    for (arguments, words) in [
        (vec!["lamp.toml"], "--integrator"),
        (vec!["lamp.toml", "-i", "path", "-i", "path"], "is there twice"),
        (vec!["lamp.toml", "-i", "paht"], "path"),
        (vec!["lamp.toml", "-i", "path", "--reference", "none.exr"], "cannot read \"none.exr\""),
        (vec!["lamp.toml", "-i", "path", "--reference", "lamp.toml"], "format"),
    ] {
        let output = run(&folder, &arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    let made = json(&folder, &["lamp.toml", "-i", "path", "--spp", "2", "--reference-spp", "4", "-o", "made"]);
    assert_eq!(made["width"], 24);
    let other = ["lamp.toml", "-i", "path", "--size", "8x8", "--reference", "made/reference.exr"];
    let output = run(&folder, &other);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("24x16"));
}
