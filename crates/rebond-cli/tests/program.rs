//! What the program does, seen from outside.

use rebond::film::Image;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn temporary() -> TempDir {
    tempfile::tempdir().expect("a folder")
}

fn rebond(folder: &TempDir, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rebond"));
    command.args(arguments).current_dir(folder);
    command
}

fn run(folder: &TempDir, arguments: &[&str]) -> Output {
    rebond(folder, arguments).output().expect("the program runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// Runs to a good end without a word on standard error; returns what it answered.
fn answer(folder: &TempDir, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "", "{arguments:?}");
    text(&output.stdout)
}

fn json(answer: &str) -> Value {
    assert_eq!(answer.matches('\n').count(), 1, "one line: {answer}");
    serde_json::from_str(answer).expect("JSON")
}

fn bytes(folder: &TempDir, name: &str) -> Vec<u8> {
    std::fs::read(folder.path().join(name)).expect(name)
}

fn image(folder: &TempDir, name: &str) -> Image {
    rebond_io::read_image(&bytes(folder, name), name).expect(name)
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A small render of the Cornell box.
const SMALL: [&str; 6] = ["render", "cornell-box", "--size", "20x18", "--spp", "4"];

fn small<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&SMALL, more].concat()
}

#[test]
fn a_render_writes_png_and_exr_and_prints_where() {
    let folder = temporary();
    assert_eq!(answer(&folder, &SMALL), "cornell-box.png\ncornell-box.exr\n");
    assert_eq!(names_in(folder.path()), ["cornell-box.exr", "cornell-box.png"]);
    let exr = image(&folder, "cornell-box.exr");
    assert_eq!((exr.width, exr.height), (20, 18));
    let layers: Vec<&str> = exr.layers.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(layers[0], "");
    assert!(layers.contains(&"variance") && layers.contains(&"samples"), "{layers:?}");
    let samples = &exr.layer("samples").expect("samples").channels[0].data;
    assert!(samples.iter().all(|n| *n == 4.0));
    assert_eq!(image(&folder, "cornell-box.png").width, 20);
}

#[test]
fn json_is_one_object_with_the_statistics() {
    let folder = temporary();
    let object = json(&answer(&folder, &small(&["--json", "-i", "path:max_depth=3"])));
    let keys: BTreeSet<&str> = object.as_object().expect("an object").keys().map(String::as_str).collect();
    let wanted = [
        "scene",
        "integrator",
        "load_seconds",
        "build_seconds",
        "render_seconds",
        "samples",
        "rays",
        "rays_by_depth",
        "shadow_rays",
        "dropped_samples",
        "counts",
        "peak_memory_bytes",
        "error",
        "biased",
        "outputs",
    ];
    assert_eq!(keys, BTreeSet::from(wanted));
    assert_eq!(object["scene"], "cornell-box");
    assert_eq!(object["integrator"], "path");
    assert_eq!(object["samples"], 20 * 18 * 4);
    assert!(object["rays"].as_u64() > object["samples"].as_u64());
    let by_depth = object["rays_by_depth"].as_array().expect("a list");
    assert_eq!((by_depth.len(), &by_depth[0]), (3, &object["samples"]));
    let all = by_depth.iter().chain([&object["shadow_rays"]]).map(|n| n.as_u64().expect("a number")).sum::<u64>();
    assert_eq!(object["rays"], all);
    assert_eq!(object["dropped_samples"], 0);
    assert_eq!(object["biased"], true);
    assert_eq!(object["outputs"], serde_json::json!(["cornell-box.png", "cornell-box.exr"]));
    for key in ["load_seconds", "build_seconds", "render_seconds", "error"] {
        assert!(object[key].as_f64().expect(key) > 0.0, "{key}");
    }
}

#[test]
fn every_format_is_written_and_read_back() {
    let folder = temporary();
    let written = answer(&folder, &small(&["-o", "a.exr", "-o", "a.hdr", "-o", "a.pfm", "-o", "a.png"]));
    assert_eq!(written, "a.exr\na.hdr\na.pfm\na.png\n");
    let mse = |a: &str, b: &str| json(&answer(&folder, &["diff", "--json", a, b]))["mse"].as_f64().expect("a number");
    for name in ["a.exr", "a.hdr", "a.pfm", "a.png"] {
        assert_eq!(mse(name, name), 0.0, "{name}");
    }
    assert_eq!(mse("a.exr", "a.pfm"), 0.0, "both hold every bit");
    let hdr = mse("a.exr", "a.hdr");
    assert!(hdr > 0.0 && hdr < 1e-3, "eight bits a channel: {hdr}");
    // The same picture, in words.
    let words = answer(&folder, &["diff", "a.exr", "a.exr", "--flip-map", "map.png"]);
    assert!(words.starts_with("MSE                              0.000000e0\n"), "{words}");
    assert_eq!(words.matches("agree").count(), 3, "{words}");
    assert!(image(&folder, "map.png").rgb("").expect("colours").iter().all(|c| *c == [0.0; 3]));
}

#[test]
fn a_seed_is_a_picture() {
    let folder = temporary();
    for (name, seed) in [("a.exr", "7"), ("b.exr", "7"), ("c.exr", "8"), ("d.exr", "18446744073709551615")] {
        answer(&folder, &small(&["--seed", seed, "-o", name]));
    }
    assert!(bytes(&folder, "a.exr") == bytes(&folder, "b.exr"));
    assert!(image(&folder, "a.exr") != image(&folder, "c.exr"));
    assert!(image(&folder, "a.exr") != image(&folder, "d.exr"));
}

#[test]
fn threads_change_nothing() {
    let folder = temporary();
    for (name, threads) in [("one.exr", "1"), ("two.exr", "2"), ("many.exr", "64")] {
        answer(&folder, &["render", "sky", "--size", "50x40", "--spp", "4", "--threads", threads, "-o", name]);
    }
    assert!(bytes(&folder, "one.exr") == bytes(&folder, "two.exr"));
    assert!(bytes(&folder, "one.exr") == bytes(&folder, "many.exr"));
}

#[test]
fn a_crop_is_a_part_of_the_picture() {
    let folder = temporary();
    let size = ["render", "cornell-spheres", "--size", "40x30", "--spp", "4"];
    answer(&folder, &[&size[..], &["-o", "whole.exr"]].concat());
    answer(&folder, &[&size[..], &["--crop", "11,7,21,19", "-o", "part.exr"]].concat());
    let (whole, part) = (image(&folder, "whole.exr"), image(&folder, "part.exr"));
    assert_eq!((part.width, part.height), (21, 19));
    assert_eq!(part.layers.len(), whole.layers.len());
    for (w, p) in whole.layers.iter().zip(&part.layers) {
        for (w, p) in w.channels.iter().zip(&p.channels) {
            let expected: Vec<f32> = (7..26).flat_map(|y| w.data[y * 40 + 11..y * 40 + 32].to_vec()).collect();
            assert!(p.data == expected, "{}", p.name);
        }
    }
}

/// Layers stand in the EXR, and beside the other formats; with the sum of the picture.
#[test]
fn light_is_split_into_layers() {
    let folder = temporary();
    let written = answer(&folder, &small(&["--split", "LE,L.*DE", "-o", "a.exr", "-o", "a.png"]));
    assert_eq!(written, "a.exr\na.png\na-LE.png\na-L._DE.png\na-rest.png\n");
    let exr = image(&folder, "a.exr");
    // Names of channels cannot hold what expressions can: the file keeps them as they are, but for dots.
    let layers: Vec<&str> = exr.layers.iter().map(|l| &*l.name).collect();
    assert_eq!(exr.layers.len(), 6, "{layers:?}");
    let whole = exr.rgb("").expect("colours");
    let parts: Vec<_> = ["LE", "L.*DE", "rest"].iter().map(|l| exr.rgb(l).unwrap_or_else(|| panic!("{l}"))).collect();
    for (i, pixel) in whole.iter().enumerate() {
        let sum: f32 = parts.iter().map(|p| p[i][1]).sum();
        assert!((sum - pixel[1]).abs() <= 1e-5 * pixel[1], "{sum} for {}", pixel[1]);
    }
    // Commas within braces part nothing, on either side.
    answer(&folder, &small(&["--split", "LD{1,2}E,LE", "-o", "b.exr"]));
    answer(&folder, &small(&["-i", "path:paths=LD{1,2}E", "-o", "b.exr", "--json"]));
    // What is left out is said, unless nothing is to be said or JSON says it.
    let clamped = run(&folder, &small(&["-i", "path:max_depth=2"]));
    assert_eq!(text(&clamped.stderr), "note: biased: paths of more than max_depth=2 segments are left out\n");
    for (arguments, part) in [
        (["--split", "LXE"], "'X' stands for nothing"),
        (["--split", "LE,LE"], "twice"),
        (["--split", "L(S|T)E,L[S|T]E"], "two pictures"),
        (["-i", "path:paths=DE"], "begin with L"),
        (["-i", "path:mode=explicitly"], "explicit"),
    ] {
        let output = run(&folder, &small(&arguments));
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(part), "{}", text(&output.stderr));
    }
}

/// Samples of an adaptive render differ from tile to tile.
#[test]
fn an_error_is_reached_by_samples_where_they_help() {
    let folder = temporary();
    let arguments = ["render", "veach-mis", "--size", "96x64", "--error", "0.2", "-o", "a.exr", "--json"];
    let object = json(&answer(&folder, &arguments));
    assert!(object["error"].as_f64().expect("a number") <= 0.2);
    let samples = image(&folder, "a.exr").layer("samples").expect("samples").channels[0].data.clone();
    let most = samples.iter().fold(0.0_f32, |a, b| a.max(*b));
    assert!(samples.iter().any(|n| *n < most), "all have {most}");
}

/// Whether the process has come to catch SIGINT (2), where the system tells.
#[cfg(unix)]
fn catches_interrupts(process: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let caught = status.lines().find_map(|l| l.strip_prefix("SigCgt:"));
    caught.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).is_ok_and(|mask| mask & 0b10 != 0))
}

#[cfg(unix)]
#[test]
fn an_interrupt_still_writes_the_picture() {
    for budget in [["--time", "60s"], ["--spp", "17000000"]] {
        interrupt(budget);
    }
}

#[cfg(unix)]
fn interrupt(budget: [&str; 2]) {
    let folder = temporary();
    let start = Instant::now();
    let [kind, amount] = budget;
    let arguments = ["render", "furnace", "--size", "16x16", kind, amount, "--json", "-o", "part.pfm"];
    let child = rebond(&folder, &arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("a process");
    let (process, patience) = (child.id(), Duration::from_secs(10));
    while !catches_interrupts(process) && start.elapsed() < patience {
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(300));
    let sent = Command::new("kill").args(["-INT", &process.to_string()]).status().expect("a signal");
    assert!(sent.success());
    let output = child.wait_with_output().expect("an end");
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "stopped: writing what there is; another Ctrl-C loses it\ninterrupted\n");
    assert!(start.elapsed() < Duration::from_secs(20));
    assert_eq!(json(&text(&output.stdout))["outputs"], serde_json::json!(["part.pfm"]));
    // Wherever it was stopped, what was rendered is right.
    let picture = image(&folder, "part.pfm").rgb("").expect("colours");
    assert!(picture.iter().all(|c| c[0] > 1.0 && c[0] < 3.0), "{picture:?}");
}

#[test]
fn time_is_kept() {
    let folder = temporary();
    let start = Instant::now();
    let object = json(&answer(&folder, &["render", "cornell-box", "--size", "32x32", "--time", "1s", "--json"]));
    let seconds = start.elapsed().as_secs_f64();
    assert!((1.0..6.0).contains(&seconds), "{seconds} s");
    assert!(object["samples"].as_u64() >= Some(32 * 32));
    assert_eq!(names_in(folder.path()), ["cornell-box.exr", "cornell-box.png"]);
}

#[test]
fn an_error_is_reached() {
    let folder = temporary();
    let object = json(&answer(&folder, &["render", "cornell-box", "--size", "16x16", "--error", "0.2", "--json"]));
    let error = object["error"].as_f64().expect("an error");
    assert!(error > 0.0 && error <= 0.2, "{error}");
    // A samples budget ends first where it is the smaller.
    let more = ["--error", "1e-9", "--spp", "32", "--json", "--size", "16x16"];
    let object = json(&answer(&folder, &[&["render", "cornell-box"], &more[..]].concat()));
    assert_eq!(object["samples"], 16 * 16 * 32);
    // A picture without light has no error.
    std::fs::write(folder.path().join("dark.toml"), "").expect("a scene");
    let dark = ["render", "dark.toml", "--size", "4x4", "--error", "0.1", "--quiet"];
    assert_eq!(answer(&folder, &dark), "dark.png\ndark.exr\n");
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = temporary();
    for arguments in [&SMALL[..], &["scenes"], &["integrators"], &["info", "furnace"], &["--help"], &["--version"]] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let output = rebond(&folder, arguments).stdout(writer).stderr(Stdio::piped()).output().expect("an end");
        assert!(output.status.success(), "{arguments:?}: {:?} {}", output.status, text(&output.stderr));
        assert_eq!(text(&output.stderr), "", "{arguments:?}");
    }
    assert_eq!(names_in(folder.path()), ["cornell-box.exr", "cornell-box.png"]);
}

#[cfg(target_os = "linux")]
#[test]
fn an_answer_that_cannot_be_written_is_a_failure() {
    let folder = temporary();
    for arguments in [&SMALL[..], &["scenes"], &["info", "furnace", "--json"], &["bsdf", "diffuse"], &["--help"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("a full disk");
        let output = rebond(&folder, arguments).stdout(full).stderr(Stdio::piped()).output().expect("an end");
        let report = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {report}");
        assert!(report.starts_with("error: cannot write the answer: "), "{arguments:?}: {report}");
    }
    assert_eq!(names_in(folder.path()), ["cornell-box.exr", "cornell-box.png"]);
}

#[test]
fn a_picture_that_cannot_be_written_is_saved_elsewhere() {
    let (folder, elsewhere) = (temporary(), temporary());
    // A file is first written under this name.
    std::fs::create_dir(folder.path().join("a.png.part")).expect("a folder");
    let arguments = small(&["-o", "a.png", "-o", "a.pfm"]);
    let output = rebond(&folder, &arguments).env("TMPDIR", elsewhere.path()).output().expect("an end");
    let report = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{report}");
    assert!(report.starts_with("error: cannot write \"a.png\": "), "{report}");
    assert_eq!(names_in(folder.path()), ["a.pfm", "a.png.part"], "the other picture is written");
    let saved = names_in(elsewhere.path());
    assert_eq!(saved.len(), 1);
    assert!(report.contains(&format!("the picture was saved as \"{}\"", elsewhere.path().join(&saved[0]).display())));
    let (saved, right) = (image(&elsewhere, &saved[0]), image(&folder, "a.pfm"));
    assert_eq!(saved.rgb(""), right.rgb(""));
}

#[test]
fn scenes_are_listed() {
    let folder = temporary();
    let names = [
        "caustic-mirror",
        "cornell-box",
        "cornell-spheres",
        "dragon",
        "furnace",
        "glossy-spheres",
        "indirect-room",
        "many-lights",
        "material-gallery",
        "phong-300",
        "phong-300-blurred-light",
        "phong-60",
        "phong-60-blurred-light",
        "phong-lamp",
        "point-lights",
        "sky",
        "smallpt",
        "veach-bidir",
        "veach-mis",
    ];
    let list = answer(&folder, &["scenes"]);
    let first_words: Vec<&str> = list.lines().filter_map(|l| l.split_whitespace().next()).collect();
    assert_eq!(first_words, names);
    assert!(list.contains("The Cornell box"));
    let array = json(&answer(&folder, &["scenes", "--json"]));
    let listed: Vec<&str> = array.as_array().expect("a list").iter().filter_map(|s| s["name"].as_str()).collect();
    assert_eq!(listed, names);
    assert_eq!(array[1]["title"], "The Cornell box");
}

#[test]
fn integrators_are_listed() {
    let folder = temporary();
    let list = answer(&folder, &["integrators"]);
    assert!(list.starts_with("ambient-occlusion ") && list.contains("\npath "), "{list}");
    assert!(list.contains("\n  max_depth "), "{list}");
    let array = json(&answer(&folder, &["integrators", "--json"]));
    let path = array.as_array().expect("a list").iter().find(|i| i["name"] == "path").expect("path");
    assert!(path["summary"].is_string());
    // Every setting listed is one that can be set.
    let settings: Vec<&String> = path["settings"].as_object().expect("settings").keys().collect();
    assert_eq!(settings, ["light_sampling", "max_depth", "mode", "paths", "roulette", "rr_depth", "survival"]);
    let all = "path:max_depth=2,rr_depth=1,mode=mis,light_sampling=solid-angle,paths=2..,roulette=albedo,survival=0.9";
    answer(&folder, &small(&["--json", "-i", all]));
}

#[test]
fn photons_are_counted_and_shown() {
    let folder = temporary();
    let photons = "photon:photons=2000,nearest=20,show=true";
    let object = json(&answer(&folder, &small(&["--json", "-i", photons, "-o", "map.exr"])));
    let count = |name: &str| object["counts"][name].as_u64().unwrap_or_else(|| panic!("{name} in {object}"));
    let [emitted, stored] = ["photons_emitted", "photons_stored"].map(count);
    // The box is open at the front.
    assert!(emitted == 2000 && stored > emitted && count("photons_lost") > 0 && count("photons_wasted") > 0);
    assert_eq!(object["biased"], true);
    let layer = image(&folder, "map.exr").rgb("photons").expect("a layer");
    // In units of their mean power: the green of all pixels is about the number of photons that are seen.
    let seen: f32 = layer.iter().map(|p| p[1]).sum();
    assert!(seen > 0.2 * stored as f32 && seen < stored as f32, "{seen} of {stored}");
}

#[test]
fn info_says_what_a_scene_is_made_of() {
    let folder = temporary();
    let object = json(&answer(&folder, &["info", "cornell-spheres", "--json"]));
    let counts = ["triangles", "analytic_shapes", "instances", "emitters", "width"].map(|key| object[key].as_u64());
    assert_eq!(counts, [12, 2, 0, 1, 512].map(Some));
    assert_eq!(object["warnings"], serde_json::json!([]));
    for key in ["accelerator_bytes", "table_bytes", "accelerator_seconds", "load_and_build_seconds"] {
        assert!(object[key].as_f64().expect(key) > 0.0, "{key}");
    }
    let words = answer(&folder, &["info", "cornell-spheres"]);
    for row in ["triangles        12\n", "emitters         1\n", "memory ", "build time "] {
        assert!(words.contains(row), "{row}: {words}");
    }
}

#[test]
fn info_counts_what_is_wrong_with_a_mesh() {
    let folder = temporary();
    let mesh = rebond_io::MeshData {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f32::NAN, 0.0, 0.0], [2.0, 0.0, 0.0]],
        triangles: vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 1, 2], [3, 3, 3], [2, 3, 4]],
        ..Default::default()
    };
    std::fs::write(folder.path().join("bad.ply"), rebond_io::write_ply(&mesh)).expect("a mesh");
    let scene = "[[shapes]]\ntype = 'ply'\nfile = 'bad.ply'\n[[emitters]]\ntype = 'constant'\nradiance = 1\n";
    std::fs::write(folder.path().join("bad.toml"), scene).expect("a scene");
    let warnings = ["2 triangles have no area: skipped", "3 triangles have a corner that is not finite: skipped"];
    let output = run(&folder, &["info", "bad.toml"]);
    assert!(output.status.success());
    assert_eq!(text(&output.stderr), warnings.map(|w| format!("warning: {w}\n")).concat());
    let object = json(&answer(&folder, &["info", "bad.toml", "--json"]));
    assert_eq!(object["warnings"], serde_json::json!(warnings));
    assert_eq!(object["bounds"], serde_json::json!([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]));
    // The rest of it renders.
    let picture = ["render", "bad.toml", "--size", "4x4", "--spp", "1", "-o", "a.pfm", "--quiet", "--json"];
    assert_eq!(json(&answer(&folder, &picture))["dropped_samples"], 0);
}

#[test]
fn pictures_of_different_sizes_are_not_compared() {
    let folder = temporary();
    answer(&folder, &small(&["-o", "a.pfm"]));
    answer(&folder, &["render", "furnace", "--size", "9x8", "--spp", "1", "-o", "b.pfm"]);
    let output = run(&folder, &["diff", "a.pfm", "b.pfm"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(output.stdout.is_empty());
    assert!(text(&output.stderr).starts_with("error: the images have different sizes, 20x18 and 9x8\n"));
}

/// What radiosity does otherwise than it was asked to is a warning, which --quiet leaves out.
#[test]
fn radiosity_warns() {
    let folder = temporary();
    let room = "[camera]\ntype = \"perspective\"\nfov = 90\n[[shapes]]\ntype = \"cube\"\nflip_normals = true\nemission = 1\nmaterial = { type = \"diffuse\", reflectance = 1 }\n";
    std::fs::write(folder.path().join("white.toml"), room).expect("a file");
    let few = "radiosity:solver=hierarchical,patches=300,error=1e-9,memory=0.001";
    let white = ["jacobi", "progressive"].map(|solver| format!("radiosity:solver={solver},patches=12"));
    let render = |scene, integrator, says: &[&str]| {
        let arguments = ["render", scene, "-i", integrator, "--size", "8x8", "--spp", "1", "-o", "a.png"];
        let output = run(&folder, &arguments);
        let said = text(&output.stderr);
        assert!(output.status.success(), "{said}");
        let warnings: Vec<&str> = said.lines().filter(|l| l.starts_with("warning: ")).collect();
        assert!(warnings.len() == 1 && says.iter().all(|s| warnings[0].contains(s)), "{integrator}: {said}");
        answer(&folder, &[&arguments[..], &["--quiet"]].concat());
    };
    let shot = ["links and more do not fit into", "solved by progressive shooting instead", "give a larger error"];
    render("cornell-box", few, &shot);
    white.iter().for_each(|integrator| render("white.toml", integrator, &["has not converged: its residual is"]));
    // Beside others it says whose it is.
    let [jacobi, _] = &white;
    let few = ["--size", "8x8", "--spp", "1"];
    let contest = ["compare", "white.toml", "-i", jacobi, "-i", "path", "--reference", "a.pfm", "-o", "page"];
    answer(&folder, &[&["render", "white.toml", "-i", "path", "-o", "a.pfm"][..], &few].concat());
    let output = run(&folder, &[&contest[..], &few].concat());
    let said = text(&output.stderr);
    let warnings: Vec<&str> = said.lines().filter(|l| l.starts_with("warning: ")).collect();
    let [warning] = warnings[..] else { panic!("one warning: {said}") };
    assert!(warning.starts_with(&format!("warning: {jacobi}: the solution of radiosity has not converged")), "{said}");
    let solve = ["radiosity", "white.toml", "--patches", "12", "--solver", "gauss-seidel"];
    let output = run(&folder, &solve);
    assert!(text(&output.stderr).starts_with("warning: the solution of radiosity has not converged"), "{output:?}");
    let found = json(&answer(&folder, &[&solve[..], &["--quiet", "--json"]].concat()));
    assert!((found["residual"].as_f64().expect("a residual") - 1.0).abs() < 0.02, "{found}");
}

#[test]
fn materials_are_what_they_claim() {
    let folder = temporary();
    let good = answer(&folder, &["bsdf", "oren-nayar:reflectance=0.9,roughness=0.8"]);
    for property in ["positivity", "reciprocity", "energy", "sampling"] {
        let line = good.lines().find(|l| l.starts_with(property)).expect(property);
        assert_eq!(line.split_whitespace().take(3).collect::<Vec<_>>(), [property, "yes", "yes"], "{good}");
    }
    // The lecture's Phong says where it breaks its word.
    let lecture = run(&folder, &["bsdf", "phong:form=lecture,exponent=60,reflectance=1"]);
    assert_eq!((lecture.status.code(), text(&lecture.stderr).as_str()), (Some(1), ""));
    let said = text(&lecture.stdout);
    for (property, holds) in [("positivity", "yes"), ("reciprocity", "NO"), ("energy", "NO"), ("sampling", "yes")] {
        let line = said.lines().find(|l| l.starts_with(property)).expect(property);
        assert_eq!(line.split_whitespace().nth(2), Some(holds), "{said}");
        assert_eq!(line.contains('°'), holds == "NO", "{said}");
    }
    let lecture = run(&folder, &["bsdf", "phong:form=lecture,exponent=60,reflectance=1", "--json"]);
    let found = json(&text(&lecture.stdout));
    assert_eq!((&found["holds"], &found["reciprocity"]["holds"]), (&Value::from(false), &Value::from(false)));
    let first = &found["energy"]["first_excess"];
    assert!(first["theta"].as_f64() > Some(45.0) && first["albedo"].as_f64() > Some(1.0), "{first}");
    // Its energy-conserving form does not, nor does a mix of a scene.
    for material in ["phong:exponent=60,reflectance=1", "glossy-spheres#lacquer", "point-lights#plane"] {
        let found = json(&answer(&folder, &["bsdf", material, "--json"]));
        assert_eq!(found["holds"], true, "{material}: {found}");
    }
}

#[test]
fn lobes_are_drawn() {
    let folder = temporary();
    let glass = "dielectric:alpha=0.3";
    answer(&folder, &["bsdf", glass, "-o", "glass.svg"]);
    std::fs::create_dir(folder.path().join("plots")).expect("a folder");
    answer(&folder, &["bsdf", glass, "-o", "plots"]);
    assert_eq!(names_in(&folder.path().join("plots")), ["hemisphere.svg", "polar.svg"]);
    for name in ["glass.svg", "plots/hemisphere.svg", "plots/polar.svg"] {
        let svg = text(&bytes(&folder, name));
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{name}");
        assert!(svg.contains("light from 60°"), "{name}");
    }
}

#[test]
fn a_material_is_captured_and_read_back() {
    let folder = temporary();
    let arguments = ["capture", "phong:exponent=20", "-r", "24", "-o", "a.safetensors"];
    let words = answer(&folder, &[&arguments[..], &["--plot", "a.svg"]].concat());
    let rows = words.lines().filter(|l| l.contains(" × 1 × ")).collect::<Vec<_>>();
    assert_eq!(rows.len(), 4, "{words}");
    assert!(rows[3].starts_with("24 × 1 × 24 × 48"), "{words}");
    assert!(words.ends_with("kB)\na.svg\n"), "{words}");
    assert!(text(&bytes(&folder, "a.svg")).starts_with("<svg"));
    let (captured, plot) = (bytes(&folder, "a.safetensors"), bytes(&folder, "a.svg"));

    // The same again, as an object; what exists is not written over unless asked for.
    let object =
        json(&answer(&folder, &["capture", "phong:exponent=20", "-r", "24,1,24,48", "-o", "b.safetensors", "--json"]));
    assert_eq!(bytes(&folder, "b.safetensors"), captured);
    let tables = object["tables"].as_array().expect("tables");
    let number = |i: usize, key: &str| tables[i][key].as_f64().expect(key);
    assert_eq!((tables.len(), &object["outputs"]), (4, &serde_json::json!(["b.safetensors"])));
    assert_eq!(number(3, "bytes"), 24.0 * 24.0 * 48.0 * 12.0);
    for key in ["rms", "even_light", "bound"] {
        assert!((1..4).all(|i| number(i, key) < 0.7 * number(i - 1, key)), "{key} falls with size: {object}");
    }
    for over in ["a.safetensors", "a.svg"] {
        let other = if over == "a.svg" { "c.safetensors" } else { over };
        let output = run(&folder, &["capture", "diffuse", "-o", other, "--plot", over]);
        assert_eq!(output.status.code(), Some(2));
    }
    let output = run(&folder, &["capture", "diffuse", "-o", "a.safetensors"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--force"), "{}", text(&output.stderr));
    assert_eq!((bytes(&folder, "a.safetensors"), bytes(&folder, "a.svg")), (captured.clone(), plot));
    assert_eq!(names_in(folder.path()), ["a.safetensors", "a.svg", "b.safetensors"]);
    answer(&folder, &["capture", "diffuse", "-r", "4", "-o", "b.safetensors", "--force"]);
    assert_ne!(bytes(&folder, "b.safetensors"), captured);

    // A table is a material like any other.
    let object = json(&answer(&folder, &["bsdf", "measured:file=a.safetensors", "--json"]));
    let is = |property: &str, key: &str| object[property][key].as_bool().expect(key);
    assert!(object["holds"] == true && is("sampling", "holds") && is("positivity", "holds"), "{object}");
    assert!(is("energy", "holds") && is("reciprocity", "holds"), "{object}");
    // One that reflects more than it receives is told, though it claims nothing.
    answer(
        &folder,
        &["capture", "blinn-phong:form=lecture,exponent=60,reflectance=1", "-r", "30", "-o", "d.safetensors"],
    );
    let object = json(&answer(&folder, &["bsdf", "measured:file=d.safetensors", "--seed", "2", "--json"]));
    assert_eq!((&object["holds"], &object["energy"]["holds"]), (&true.into(), &false.into()), "{object}");
}

#[test]
fn what_has_no_table_is_not_captured() {
    let folder = temporary();
    for (material, reason) in [
        ("mirror", "mirrors"),
        ("dielectric:alpha=0.3", "passes through"),
        ("glossy-spheres#nothing", "no material"),
        ("diffuse", "no resolution"),
        ("measured:file=none.binary", "none.binary"),
    ] {
        let output = run(&folder, &["capture", material, "-r", "3,4", "-o", "x.safetensors"]);
        let output = if reason == "no resolution" {
            output
        } else {
            run(&folder, &["capture", material, "-o", "x.safetensors"])
        };
        assert_eq!(output.status.code(), Some(2), "{material}");
        assert!(text(&output.stderr).contains(reason), "{material}: {}", text(&output.stderr));
    }
    assert_eq!(run(&folder, &["capture", "diffuse", "-o", "x.png"]).status.code(), Some(2));
    assert!(names_in(folder.path()).is_empty());
}

/// What shows each of the lecture's algorithms, in its order.
const ROWS: &[(&str, &[&str])] = &[
    ("point lights, shadows off and on", &["direct-no-shadows.png", "direct-shadows.png"]),
    ("linearity", &["direct-light-0.png", "direct-light-1.png", "direct-light-2.png", "direct-all-lights.png"]),
    ("area lights, many lights", &["direct-veach-mis.png", "direct-many-lights.png"]),
    ("Phong of 60 and 300", &["direct-phong.png", "materials-phong-60.png", "materials-phong-300.png"]),
    ("mirrors of blurred lights", &["materials-phong-60-blurred-light.png", "materials-phong-300-blurred-light.png"]),
    ("anisotropic and tabulated", &["materials-anisotropic.svg", "materials-table-lobe.svg", "materials-gallery.png"]),
    ("factors of the integrand", &["direct-factor-le.png", "direct-factor-v.png", "direct-factor-bsdf.png"]),
    ("radiosity", &["radiosity-flat.png", "radiosity-smooth.png"]),
    ("one dimension, strata, importance", &["monte-carlo-error.svg", "monte-carlo-convergence.svg"]),
    ("ambient occlusion, whole sphere", &["ao-sphere-10.png", "ao-sphere-100.png", "ao-sphere-1000.png"]),
    ("hemisphere", &["ao-hemisphere-10.png", "ao-hemisphere-100.png", "ao-hemisphere-1000.png"]),
    ("cosine", &["ao-cosine-10.png", "ao-cosine-100.png", "ao-cosine-1000.png"]),
    ("two experiments", &["ao-experiment-occluded.svg", "ao-experiment-open.svg", "ao-spheres.svg"]),
    (
        "direct by area, solid angle, product",
        &["direct-veach-mis-area.png", "direct-veach-mis-solid-angle.png", "direct-sky-product.png"],
    ),
    ("recursive", &["path-four.png", "path-rays-by-depth.svg"]),
    ("implicit, explicit", &["path-implicit.png", "path-explicit.png"]),
    ("clamped", &["path-depth-1.png", "path-depth-2.png", "path-depth-3.png", "path-depth-4.png"]),
    ("Russian roulette", &["path-roulette.csv"]),
    ("emission and direct", &["path-emission.png", "path-direct-diffuse.png", "path-direct-specular.png"]),
    ("one bounce", &["path-indirect-diffuse.png", "path-indirect-specular.png"]),
    ("antialiasing, motion blur, depth of field", &["camera-1-spp.png", "camera-8-spp.png"]),
    ("caustics by light tracing", &["ends-caustic-path.png", "ends-caustic-light.png"]),
    ("56 and 25", &["ends-veach-bidir-path.png", "ends-veach-bidir-bidirectional.png"]),
    ("indirect room", &["ends-indirect-room-path.png", "ends-indirect-room-bidirectional.png"]),
    ("photon map, final gathering", &["photons-map.png", "photons-gather.png", "photons-stored.png"]),
    ("vertex connection and merging", &["photons-mirror-vcm.png"]),
];

/// The tests of pictures that did not pass, by name.
fn failed(value: &Value, name: &str) -> Vec<String> {
    let Some(object) = value.as_object() else { return Vec::new() };
    let own = (object.get("passes") == Some(&false.into())).then(|| name.to_owned());
    own.into_iter().chain(object.iter().flat_map(|(key, inner)| failed(inner, &format!("{name}/{key}")))).collect()
}

/// The lecture's page: every file it names, pictures that commands make again, and numbers as theory has them.
#[test]
fn the_lecture_is_a_page_that_needs_nothing_else() {
    let folder = temporary();
    let object = json(&answer(&folder, &["lecture", "--quality", "draft", "-o", "page", "--json", "--quiet"]));
    let names = names_in(&folder.path().join("page"));
    let written = object["outputs"].as_array().expect("names").iter();
    let mut written: Vec<&str> = written.map(|n| n.as_str().expect("a name").trim_start_matches("page/")).collect();
    written.sort_unstable();
    assert_eq!(names, written);
    for (row, files) in ROWS {
        let missing: Vec<&&str> = files.iter().filter(|file| !written.contains(file)).collect();
        assert!(missing.is_empty(), "{row}: {missing:?}");
    }

    let page = text(&bytes(&folder, "page/index.html"));
    for section in [
        "direct",
        "materials",
        "radiosity",
        "monte-carlo",
        "ambient-occlusion",
        "direct-errors",
        "path-tracing",
        "camera",
        "both-ends",
        "photons",
    ] {
        assert!(page.contains(&format!("<section id=\"{section}\"")), "{section}");
        assert!(object["sections"][section]["seconds"].as_f64() > Some(0.0), "{section}");
    }
    // Nothing is fetched: what is referred to is on the page itself. Names of formats are no addresses.
    for reference in ["src=\"", "href=\""] {
        for place in page.split(reference).skip(1) {
            assert!(place.starts_with("data:") || place.starts_with('#'), "{}", &place[..60]);
        }
    }
    assert_eq!(page.replace("http://www.w3.org/", "").matches("://").count(), 0);
    // No formula was too hard for its typesetter.
    assert_eq!(page.matches("<div class=\"formula\"><math").count(), page.matches("class=\"formula\"").count());
    let pictures = page.matches("<img ").count();
    assert_eq!(pictures, names.iter().filter(|n| n.ends_with(".png")).count());
    assert_eq!(page.matches(" alt=\"").count(), pictures);
    assert_eq!(page.matches("alt=\"\"").count(), 0);
    assert_eq!(
        page.matches("role=\"img\" aria-label=\"").count(),
        names.iter().filter(|n| n.ends_with(".svg")).count()
    );

    // Each command makes its picture to the last bit.
    let commands = page.split("<code class=\"command\">").skip(1).map(|c| &c[..c.find("</code>").expect("an end")]);
    let commands = commands.map(|c| c.replace("<span>", "").replace("</span>", ""));
    let commands: Vec<String> = commands.filter_map(|c| Some(c.strip_prefix("rebond render ")?.to_owned())).collect();
    assert!(commands.len() > 30);
    for command in commands.iter().step_by(5) {
        let words = command.split(' ').map(|w| w.trim_matches('\''));
        let arguments: Vec<&str> = ["render"].into_iter().chain(words).collect();
        let file = arguments[arguments.len() - 1];
        answer(&folder, &[&arguments[..], &["--quiet"]].concat());
        assert!(bytes(&folder, file) == bytes(&folder, &format!("page/{file}")), "{command}");
    }

    // z, the distance from theory in standard errors: a sound build exceeds 4 once in 16 000.
    let close = |of: &Value, what: &str| {
        let number = |key: &str| of[key].as_f64().expect(key);
        let off = (number("measured") - number("theory")).abs();
        assert!(off <= 4.0 * number("standard_error"), "{what}: {of}");
    };
    for sampling in ["uniform", "importance", "stratified", "Owen-Sobol"] {
        close(&object["sections"]["monte-carlo"]["slopes"][sampling], sampling);
    }
    for sampling in ["sphere", "hemisphere", "cosine"] {
        close(&object["sections"]["ambient-occlusion"]["variances"][sampling], sampling);
    }
    for key in ["within_30_degrees_of_a_pole", "open_plane"] {
        for way in ["right", "wrong"] {
            let p = object["sections"]["ambient-occlusion"][key][way]["p"].as_f64();
            assert!(p > Some(1e-4), "{key}, {way}: {p:?}");
        }
    }
    assert_eq!(failed(&object["sections"], ""), [""; 0]);
    let direct = &object["sections"]["direct"];
    assert_eq!(
        (&direct["linearity"]["welch"]["passes"], &direct["shadows"]["none_brighter"]),
        (&true.into(), &true.into())
    );
    assert!(direct["shadows"]["same"].as_u64() > Some(0));
    let paths = &object["sections"]["path-tracing"];
    for (survival, found) in paths["roulette"].as_object().expect("roulette") {
        assert!(found["p"].as_f64() > Some(1e-4), "{survival}: {found}");
    }
    assert!((paths["classes"]["sum_over_whole"].as_f64().expect("a number") - 1.0).abs() < 1e-5);
    let clamped: Vec<f64> = serde_json::from_value(paths["clamped"].clone()).expect("numbers");
    assert!(clamped.is_sorted() && clamped[0] > 0.0 && clamped[3] < 1.0, "{clamped:?}");
    // Relit by the inverse, or solved anew by other means.
    let relit = object["sections"]["radiosity"]["relight"]["largest_difference"].as_f64();
    assert!(relit > Some(0.0) && relit < Some(1e-4), "{relit:?}");
    let claims = &object["sections"]["materials"]["claims"];
    for (material, right) in claims.as_object().expect("claims") {
        let lecture = material.contains("lecture");
        assert_eq!(right["conserves_energy"], !lecture, "{material}: {right}");
        assert_eq!(right["reciprocal"], !lecture || material.contains("blinn"), "{material}: {right}");
    }
    let ends = &object["sections"]["both-ends"];
    assert_eq!(ends["caustics"]["welch"]["passes"], true, "{ends}");
    let photons = &object["sections"]["photons"];
    let number = |of: &Value| of.as_f64().expect("a number");
    // More photons, less error; the gather hides what is left of it.
    let errors = |of: &str| -> Vec<[f64; 2]> {
        serde_json::from_value(photons["errors"][of]["points"].clone()).expect("points")
    };
    let (map, gather) = (errors("map"), errors("gather"));
    assert!(map.windows(2).all(|pair| pair[1][1] < pair[0][1]), "{map:?}");
    assert!(gather[0][1] < map[0][1], "{map:?} {gather:?}");
    let merging = &photons["merging"];
    assert!(number(&merging["rel_mse"]["vcm"]) < 0.2 * number(&merging["rel_mse"]["path"]), "{merging}");
    let off = (number(&merging["over_path"]) - 1.0).abs();
    assert!(off < 4.0 * number(&merging["standard_error"]), "{merging}");
    // N rays for each of the segment before, but for those that left or were absorbed.
    let by_depth =
        |n: &str| -> Vec<f64> { serde_json::from_value(paths["recursion"][n]["by_depth"].clone()).expect("numbers") };
    for (n, branching) in [("N = 2", 2.0), ("N = 4", 4.0)] {
        let rays = by_depth(n);
        assert_eq!(rays[0], 1.0);
        assert!(rays.windows(2).all(|w| w[1] > 0.6 * branching * w[0] && w[1] <= branching * w[0]), "{n}: {rays:?}");
    }
}

#[test]
fn sections_of_the_lecture_are_chosen_by_name() {
    let folder = temporary();
    let list = answer(&folder, &["lecture", "--list"]);
    assert!(list.contains("monte-carlo ") && list.contains("direct "), "{list}");
    let name = answer(&folder, &["lecture", "--quality", "draft", "--only", "monte-carlo", "--quiet", "-o", "a/b"]);
    assert_eq!(name, "a/b/index.html\n");
    assert!(!text(&bytes(&folder, "a/b/index.html")).contains("id=\"direct\""));
    let again = answer(
        &folder,
        &["lecture", "--quality", "draft", "--only", "monte-carlo", "--quiet", "-o", "c", "--threads", "1"],
    );
    assert_eq!(again, "c/index.html\n");
    assert!(
        bytes(&folder, "a/b/index.html") == bytes(&folder, "c/index.html"),
        "the same page for any number of threads"
    );

    let output = run(&folder, &["lecture", "--only", "direct,monte-calro"]);
    assert_eq!(output.status.code(), Some(2));
    let words = text(&output.stderr);
    assert!(
        words.contains("there is no section \"monte-calro\"") && words.contains("did you mean \"monte-carlo\"?"),
        "{words}"
    );
    assert!(words.contains("monte-carlo, ambient-occlusion, direct-errors"), "{words}");
    let output = run(&folder, &["lecture", "--only", "monte-carlo", "-o", "c/index.html"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    // A README that is of no book stays.
    std::fs::write(folder.path().join("README.md"), "mine").expect("a file");
    let output = run(&folder, &["lecture", "--only", "camera", "--quality", "draft", "--book", "."]);
    assert_eq!((output.status.code(), &*bytes(&folder, "README.md")), (Some(2), &b"mine"[..]));
}

/// What stands between tags, but for code and formulas.
fn texts(page: &str) -> Vec<String> {
    let body = page.split_once("<body").expect("a body").1;
    let mut all = Vec::new();
    let mut skipped = None;
    for piece in body.split('<').skip(1) {
        let Some((tag, words)) = piece.split_once('>') else { continue };
        let name = tag.split([' ', '/']).find(|n| !n.is_empty()).unwrap_or_default();
        match skipped {
            None if ["code", "math"].contains(&name) => skipped = Some(name),
            Some(skipping) if tag == format!("/{skipping}") => skipped = None,
            _ => {}
        }
        if skipped.is_none() {
            all.push(words.to_owned());
        }
        // What is said to who does not see.
        all.extend(["alt=\"", "aria-label=\""].iter().filter_map(|of| {
            let said = tag.split_once(of)?.1;
            Some(said.split_once('"')?.0.to_owned())
        }));
    }
    all
}

/// The same page in French: the same numbers, no sentence of the English one, and commas in numbers.
#[test]
fn the_lecture_speaks_french() {
    let folder = temporary();
    let make = |language: &str, name: &str| {
        let arguments = ["lecture", "--quality", "draft", "--only", "monte-carlo,camera", "--quiet", "--json"];
        json(&answer(
            &folder,
            &[&arguments[..], &["--lang", language, "-o", name, "--book", &format!("{name}-book")]].concat(),
        ))
    };
    let (mut english, mut french) = (make("en", "en"), make("fr", "fr"));
    for object in [&mut english, &mut french] {
        object["outputs"].take();
        object["sections"].as_object_mut().expect("sections").values_mut().for_each(|s| {
            s["seconds"].take();
        });
    }
    assert_eq!(english, french);
    let [english, french] = ["en", "fr"].map(|name| text(&bytes(&folder, &format!("{name}/index.html"))));
    assert!(french.contains("<html lang=\"fr\">") && french.contains("0,78540"));
    let [english, french] = [english, french].map(|page| texts(&page));
    assert_eq!(english.len(), french.len());
    let is_sentence = |words: &&String| words.split_whitespace().filter(|word| word.len() > 3).count() > 2;
    assert!(english.iter().filter(is_sentence).count() > 20);
    let same: Vec<&String> = french.iter().filter(is_sentence).filter(|words| english.contains(words)).collect();
    assert!(same.is_empty(), "{same:?}");
    let points: Vec<&String> = french
        .iter()
        .filter(|words| {
            words.as_bytes().windows(3).any(|w| w[0].is_ascii_digit() && w[1] == b'.' && w[2].is_ascii_digit())
        })
        .filter(|words| !words.contains("rebond"))
        .collect();
    assert!(points.is_empty(), "{points:?}");

    // The book has a chapter for each, and what it refers to.
    let summary = text(&bytes(&folder, "fr-book/SUMMARY.md"));
    assert!(summary.contains("- [Monte-Carlo](monte-carlo.md)\n"), "{summary}");
    for chapter in ["monte-carlo", "camera"] {
        let chapter = text(&bytes(&folder, &format!("fr-book/{chapter}.md")));
        assert!(chapter.contains("<math") && chapter.contains("`crates/rebond/src/"), "{chapter}");
        let pictures: Vec<&str> =
            chapter.split("src=\"").skip(1).map(|p| p.split_once('"').expect("an end").0).collect();
        assert!(pictures.len() > 1 && pictures.iter().all(|p| !bytes(&folder, &format!("fr-book/{p}")).is_empty()));
    }
}

const OF_MITSUBA: &str = r#"<scene version="3.0.0">
<integrator type="path"/>
<sensor type="perspective">
<transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
<sampler type="independent"><integer name="sample_count" value="3"/></sampler>
<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/></film>
</sensor>
<emitter type="constant"/>
<shape type="sphere">
<bsdf type="roughconductor"><float name="glitter" value="1"/></bsdf>
</shape>
</scene>"#;

#[test]
fn scenes_of_other_programs_are_opened_and_converted() {
    let folder = temporary();
    std::fs::write(folder.path().join("theirs.xml"), OF_MITSUBA).expect("a file");
    for arguments in [&["info", "theirs.xml"][..], &["render", "theirs.xml"], &["convert", "theirs.xml", "mine.toml"]] {
        let refused = run(&folder, arguments);
        let error = text(&refused.stderr);
        assert_eq!((refused.status.code(), text(&refused.stdout)), (Some(2), String::new()), "{error}");
        assert!(
            error.contains("--> theirs.xml:10:29") && error.contains("glitter") && error.contains("--lenient"),
            "{error}"
        );
    }
    let rendered = run(&folder, &["render", "theirs.xml", "--lenient", "-o", "a.exr"]);
    assert!(rendered.status.success());
    assert!(text(&rendered.stderr).starts_with("warning: theirs.xml:10:29: \"glitter\" means nothing"));
    let samples = &image(&folder, "a.exr").layer("samples").expect("samples").channels[0].data.clone();
    assert!(samples.iter().all(|n| *n == 3.0), "as many as the file asks for");
    assert_eq!(answer(&folder, &["convert", "theirs.xml", "mine.toml", "--lenient", "--quiet"]), "mine.toml\n");
    answer(&folder, &["render", "mine.toml", "--spp", "3", "-o", "b.exr"]);
    assert_eq!(image(&folder, "a.exr"), image(&folder, "b.exr"));
    let wrong = run(&folder, &["convert", "mine.toml", "mine.xml"]);
    assert!(wrong.status.code() == Some(2) && text(&wrong.stderr).contains("ends in .toml"));
}

/// What `trace` prints adds up to the film's sample, and its numbers are read back as they were.
#[test]
fn a_path_is_told_vertex_by_vertex() {
    let folder = temporary();
    let size = ["--size", "16x16", "--seed", "3", "--sample", "0"];
    let trace = |more: &[&str]| run(&folder, &[&["trace", "cornell-box", "--pixel", "7,9"], &size[..], more].concat());
    let object = json(&text(&trace(&["--json"]).stdout));
    let vertices = object["vertices"].as_array().expect("vertices");
    let number = |v: &Value| v.as_f64().expect("a number") as f32;
    let rgb = |v: &Value| [0, 1, 2].map(|c| number(&v[c]));
    let sum =
        vertices.iter().map(|v| rgb(&v["contribution"])).fold([0.0_f32; 3], |s, v| [0, 1, 2].map(|c| s[c] + v[c]));
    assert_eq!(sum, rgb(&object["sum"]));
    assert!(vertices[0]["surface"]["material"].is_string() && vertices[0]["pdf"].is_null());
    let alone =
        ["cornell-box", "--crop", "7,9,1,1", "--engine", "scalar", "--spp", "1", "--size", "16x16", "--seed", "3"];
    answer(&folder, &[&["render"][..], &alone, &["-o", "one.exr", "--quiet"]].concat());
    assert_eq!(image(&folder, "one.exr").rgb(""), Some(vec![sum]));

    let said = text(&trace(&[]).stdout);
    let last = said.lines().last().expect("a line").strip_prefix("sum").expect("the sum").split_whitespace();
    assert_eq!(last.map(|x| x.parse::<f32>().expect("a number")).collect::<Vec<_>>(), sum);

    for (more, words) in [
        (vec!["-i", "bidirectional"], "bidirectional does not tell of single paths"),
        (vec!["-i", "radiosity"], "radiosity does not tell"),
        (vec!["--pixel", "16,0"], "not in the picture"),
    ] {
        let arguments = if more[0] == "-i" {
            [&["trace", "cornell-box", "--pixel", "7,9"][..], &more].concat()
        } else {
            [&["trace", "cornell-box"][..], &more, &["--size", "16x16"]].concat()
        };
        let output = run(&folder, &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(words), "{arguments:?}: {}", text(&output.stderr));
    }
}
