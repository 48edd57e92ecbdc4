//! An eye that sees no lights: it sees through them what is behind, lit as before.

mod common;

use common::*;
use rebond_io::SceneSource;

/// A wall behind a lamp and a ball that shines; `camera` and `more` are added.
fn scene(camera: &str, more: &str) -> SceneSource {
    parse(&format!(
        r#"
        {more}
        film = {{ width = 16, height = 16 }}
        [camera]
        {camera}
        to_world.look_at = {{ origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }}
        [[shapes]]
        type = "rectangle"
        material = {{ type = "diffuse", reflectance = [0.8, 0.5, 0.3] }}
        to_world = [{{ scale = 1.4 }}, {{ translate = [0, 0, -1] }}]
        [[shapes]]
        type = "cube"
        material = {{ type = "conductor", metal = "copper", alpha = 0.4 }}
        to_world = [{{ scale = 0.3 }}, {{ rotate = {{ axis = [1, 2, 3], angle = 50 }} }}, {{ translate = [0.7, -0.7, -0.4] }}]
        [[shapes]]
        type = "rectangle"
        flip_normals = true
        material = {{ type = "diffuse", reflectance = 0.5 }}
        emission = [4, 5, 6]
        to_world = [{{ scale = 0.4 }}, {{ translate = [-0.2, 0.2, 1] }}]
        [[shapes]]
        type = "sphere"
        material = {{ type = "diffuse", reflectance = 0.7 }}
        emission = 3
        radius = 0.25
        to_world = {{ translate = [0.6, 0.5, 1.2] }}
        "#
    ))
}

const PINHOLE: &str = "type = \"perspective\"\nfov = 35";
const LENS: &str = "type = \"thin-lens\"\nfov = 35\naperture_radius = 0.3\nfocus_distance = 5.5";
const PARALLEL: &str = "type = \"orthographic\"";
const HIDE: &str = "hide_emitters = true";

/// What a near clip beyond the lights shows, since nothing else is before it.
#[test]
fn what_is_behind_lights_is_seen() {
    for camera in [PINHOLE, LENS] {
        let clipped = format!("{camera}\nnear_clip = 4.3");
        let samples = 64;
        let reference = picture(&scene(&clipped, ""), "path:max_depth=4", 1000, samples);
        for (i, integrator) in ["path:max_depth=4", "direct", "recursive:depth=3,branching=2"].iter().enumerate() {
            let of = match *integrator {
                "direct" => picture(&scene(&clipped, ""), "path:max_depth=2", 500, samples),
                "recursive:depth=3,branching=2" => picture(&scene(&clipped, ""), "path:max_depth=3", 600, samples),
                _ => reference.clone(),
            };
            let hidden = picture(&scene(camera, HIDE), integrator, 100 * i as u64, samples);
            judge(&hidden, &of, 1, LEVEL / 18.0).unwrap_or_else(|e| panic!("{camera}, {integrator}: {e}"));
        }
        // It is not what is seen otherwise.
        let shown = picture(&scene(camera, ""), "path:max_depth=4", 300, samples);
        judge(&shown, &reference, 1, LEVEL / 18.0).expect_err("lights are seen");
    }
}

#[test]
fn all_integrators_agree() {
    for camera in [PINHOLE, LENS, PARALLEL] {
        let source = scene(camera, HIDE);
        let all = [
            ("path:max_depth=4", 128),
            ("bidirectional:max_depth=4", 32),
            ("light:max_depth=4", 128),
            ("vcm:max_depth=4,radius=0.03", 32),
            ("photon:progressive=true,photons=4000,radius=0.03,max_depth=4", 32),
        ];
        agree_on(camera, &source, &all, 30.0);
    }
}

/// Surroundings are not seen, but in mirrors; nothing that they light is darker.
#[test]
fn surroundings_are_hidden() {
    let source = |more: &str, reflectance: &str| {
        parse(&format!(
            r#"
            {more}
            film = {{ width = 16, height = 8, filter = {{ type = "box" }} }}
            [camera]
            type = "orthographic"
            to_world.look_at = {{ origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }}
            [[shapes]]
            type = "rectangle"
            to_world = [{{ scale = [0.5, 0.5, 1] }}, {{ translate = [0.5, 0, 0] }}]
            material = {{ type = "{reflectance}", reflectance = 0.5 }}
            [[emitters]]
            type = "constant"
            radiance = 0.6
            "#
        ))
    };
    for integrator in [
        "path",
        "direct",
        "bidirectional",
        "vcm:mode=bidirectional",
        "recursive",
        "photon:progressive=true,photons=100",
    ] {
        for material in ["diffuse", "mirror"] {
            for (more, sky) in [("", 0.6), (HIDE, 0.0)] {
                let film = film(&source(more, material), integrator, &Job { samples: 0..64, ..Job::default() });
                let colours = film.develop().rgb("").expect("colours");
                let image = &colours;
                // +x is to the right.
                let mean = |columns: std::ops::Range<usize>| {
                    let pixels = (0..8).flat_map(|y| columns.clone().map(move |x| image[16 * y + x][1]));
                    pixels.sum::<f32>() / (8 * columns.len()) as f32
                };
                let (lit, free) = (mean(8..16), mean(0..8));
                assert!((free - sky).abs() < 1e-5, "{integrator}, {material}, {more}: {free} for {sky}");
                assert!((lit - 0.3).abs() < 0.01, "{integrator}, {material}, {more}: {lit}");
            }
        }
    }
}
