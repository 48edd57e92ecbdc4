//! Light tracing and bidirectional path tracing: they agree with path tracing, with closed forms and with themselves.

mod common;

use common::*;
use rebond::film::Film;
use rebond::integrators::IntegratorSettings;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, PathLayer, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{SceneFiles, SceneSource, from_settings};

#[test]
fn diffuse_room() {
    let source = small("cornell-box", [16, 16]);
    let all = [("path:max_depth=5", 128), ("light:max_depth=5", 64), ("bidirectional:max_depth=5", 32)];
    agree_on("cornell-box", &source, &all, 20.0);
}

#[test]
fn mirror_and_glass() {
    let source = small("cornell-spheres", [16, 16]);
    agree_on("cornell-spheres", &source, &[("path:max_depth=7", 128), ("bidirectional:max_depth=7", 64)], 20.0);
    // What the eye does not look at in mirrors.
    let paths = "paths=L.*(D|G)E|LE,max_depth=7";
    agree_on("cornell-spheres", &source, &[(&format!("path:{paths}"), 128), (&format!("light:{paths}"), 128)], 20.0);
}

/// Lights of several kinds on rough plates, so that no way to find light brings most of it by a few samples of large weight.
#[test]
fn rough_plates() {
    let source = changed(
        "veach-mis",
        &[("alpha = 0.005 ", "alpha = 0.15 "), ("alpha = 0.02 ", "alpha = 0.2 "), ("alpha = 0.05 ", "alpha = 0.3 ")],
        [16, 16],
    );
    let all = [("path:max_depth=4", 128), ("light:max_depth=4", 256), ("bidirectional:max_depth=4", 64)];
    agree_on("rough veach-mis", &source, &all, 20.0);
}

/// A point, a spot and a beam, through a lens, while a cube turns.
#[test]
fn lights_without_extent() {
    let source = small("point-lights", [16, 16]);
    let all = [("path:max_depth=4", 128), ("light:max_depth=4", 128), ("bidirectional:max_depth=4", 64)];
    agree_on("point-lights", &source, &all, 20.0);
}

/// Parallel rays, an image of the sky, rough metal, instances.
#[test]
fn sky() {
    let source = changed("sky", &[("{ scale = 30 }", "{ scale = 3 }")], [24, 16]);
    let all = [("path:max_depth=4", 128), ("bidirectional:max_depth=4", 64)];
    agree_on("sky", &source, &all, 20.0);
    // Parallel rays do not see the sky by light.
    let all = [("path:paths=L.+E,max_depth=4", 128), ("light:paths=L.+E,max_depth=4", 256)];
    agree_on("sky", &source, &all, 20.0);
}

/// Shading normals on triangles, the sky.
#[test]
fn dragon() {
    let source = changed("dragon", &[("{ scale = 20 }", "{ scale = 2 }")], [16, 16]);
    let all = [("path:max_depth=4", 64), ("light:max_depth=4", 256), ("bidirectional:max_depth=4", 32)];
    agree_on("dragon", &source, &all, 20.0);
}

/// Through a lens, which light may hit: then light tracing finds what the eye sees in mirrors and glass, too.
#[test]
fn through_a_lens() {
    let lens = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";
    let source = changed("cornell-spheres", &[("type = \"perspective\"", lens)], [16, 16]);
    let all = [("path:max_depth=5", 128), ("bidirectional:max_depth=5", 64), ("light:max_depth=5", 512)];
    agree_on("lens", &source, &all, 20.0);
}

/// Lamps that spin, shear, shrink and fly, of all kinds that may, while the camera moves; enough of them for a tree.
#[test]
fn lights_that_move() {
    let source = parse(
        r#"
        film = { width = 16, height = 16 }
        [camera]
        type = "thin-lens"
        fov = 50
        aperture_radius = 0.15
        focus_distance = 4.8
        shutter_close = 1
        to_world = [
          { look_at = { origin = [0, -4, 3], target = [0, 0, 0.3], up = [0, 0, 1] } },
          { keyframes = [{ time = 0 }, { time = 1, to_world = { translate = [0.3, 0, 0] } }] },
        ]
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 4 }
        material = { type = "diffuse", reflectance = 0.5 }
        [[shapes]]
        type = "cube"
        emission = [4, 1, 1]
        to_world = [{ scale = 0.3 }, { keyframes = [{ time = 0 }, { time = 1, to_world = { rotate = { axis = [1, 2, 3], angle = 70 } } }] }, { translate = [-1, 0, 1] }]
        [[shapes]]
        type = "rectangle"
        emission = [1, 4, 1]
        flip_normals = true
        to_world = [{ keyframes = [{ time = 0, to_world = [{ scale = [-0.5, 0.3, 1] }] }, { time = 1, to_world = [{ scale = [-0.2, 0.9, 1] }, { rotate = { axis = [0, 1, 0], angle = 40 } }] }] }, { translate = [1, 0.5, 1] }]
        [[shapes]]
        type = "disk"
        emission = [1, 1, 4]
        to_world = [{ rotate = { axis = [1, 0, 0], angle = 150 } }, { keyframes = [{ time = 0, to_world = { scale = [0.5, 0.5, 1] } }, { time = 1, to_world = { matrix = [[0.9, 0.5, 0, 0], [0, 0.5, 0, 0.5], [0, 0, 1, 0]] } }] }, { translate = [0, 1, 1.2] }]
        [[shapes]]
        type = "sphere"
        emission = 3
        radius = 0.2
        to_world = [{ keyframes = [{ time = 0 }, { time = 1, to_world = [{ scale = 1.5 }, { translate = [0.5, -1, 0.5] }] }] }, { translate = [0, -0.5, 0.4] }]
        [[emitters]]
        type = "spot"
        intensity = [6, 2, 4]
        cutoff_angle = 40
        to_world = [{ look_at = { origin = [0.5, -1, 2.5], target = [0, 0, 0], up = [0, 1, 0] } }, { keyframes = [{ time = 0 }, { time = 1, to_world = { rotate = { axis = [1, 0, 0], angle = 25 } } }] }]
        [[emitters]]
        type = "point"
        position = [-1, -1, 1.5]
        intensity = [1, 2, 3]
        to_world = [{ keyframes = [{ time = 0 }, { time = 1, to_world = { translate = [1, 0.5, -0.5] } }] }]
        "#,
    );
    assert!(source.build().expect("a good scene").emitters().has_moving());
    let all = [("path:max_depth=3", 256), ("light:max_depth=3", 256), ("bidirectional:max_depth=3", 128)];
    agree_on("moving lights", &source, &all, 20.0);
}

/// What is nearer than the near clip is not seen, but shades and reflects; the lamp in part is nearer, too.
#[test]
fn near_clips() {
    let box_camera = "type = \"perspective\"\nfov = 39.3077";
    let pinhole = "type = \"perspective\"\nfov = 39.3077\nnear_clip = 1080";
    let lens = "type = \"thin-lens\"\nfov = 39.3077\nnear_clip = 1080\naperture_radius = 60\nfocus_distance = 1000";
    for camera in [pinhole, lens] {
        let source = changed("cornell-box", &[(box_camera, camera)], [16, 16]);
        let all = [("path:max_depth=4", 128), ("light:max_depth=4", 128), ("bidirectional:max_depth=4", 64)];
        agree_on(camera, &source, &all, 40.0);
    }
    // The sky beyond what is clipped.
    let source =
        changed("dragon", &[("{ scale = 20 }", "{ scale = 2 }"), ("fov = 32", "fov = 32\nnear_clip = 2.65")], [16, 16]);
    agree_on(
        "dragon",
        &source,
        &[("path:max_depth=3", 64), ("light:max_depth=3", 256), ("bidirectional:max_depth=3", 32)],
        40.0,
    );
}

/// Points that shine through images: before a plane, through a beam, all around; enough of them for a tree.
#[test]
fn projectors() {
    let text = r#"
        film = { width = 16, height = 16 }
        [camera]
        type = "perspective"
        fov = 50
        to_world.look_at = { origin = [0, -4, 3], target = [0, 0, 0.3], up = [0, 0, 1] }
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 4 }
        material = { type = "diffuse", reflectance = 0.5 }
        [[shapes]]
        type = "sphere"
        center = [0.3, 0.2, 0.5]
        radius = 0.5
        material = { type = "conductor", metal = "copper", alpha = 0.3 }
        [[emitters]]
        type = "projector"
        file = "quarters.png"
        fov = 60
        intensity = 10
        even = true
        to_world.look_at = { origin = [-1, -0.5, 2], target = [0, 0, 0], up = [0, 1, 0] }
        [[emitters]]
        type = "projector"
        file = "quarters.png"
        filter = "nearest"
        fov = 80
        aspect = 2
        intensity = [4, 6, 8]
        cutoff_angle = 40
        beam_width = 10
        to_world.look_at = { origin = [1.5, 1, 1.5], target = [0.5, 0, 0], up = [0, 0, 1] }
        [[emitters]]
        type = "goniometric"
        file = "quarters.png"
        intensity = 2
        to_world = [{ rotate = { axis = [1, 2, 0], angle = 50 } }, { translate = [-0.5, -1, 0.8] }]
        "#;
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gltf");
    let source = SceneSource::parse(text, "test.toml", "test", SceneFiles::Folder(folder)).expect("a scene");
    let all = [("path:max_depth=3", 256), ("light:max_depth=3", 256), ("bidirectional:max_depth=3", 128)];
    agree_on("projectors", &source, &all, 20.0);
}

/// Beams from a square and from an ellipse, one of them mirrored, beside a lamp; through a pinhole, and through a lens that one
/// of them meets, and a point's light too: neither is seen by that.
#[test]
fn beams_of_some_width() {
    let lens = "type = \"thin-lens\"\naperture_radius = 0.5\nfocus_distance = 5";
    for camera in ["type = \"perspective\"", lens] {
        let source = beams(camera);
        let all = [("path:max_depth=4", 128), ("light:max_depth=4", 128), ("bidirectional:max_depth=4", 64)];
        agree_on(camera, &source, &all, 40.0);
    }
}

/// A point's light that crosses the lens is seen by no ray of the eye, so it is not shown by any way.
#[test]
fn points_before_a_lens_are_not_seen() {
    let source = parse(
        r#"
        film = { width = 8, height = 8 }
        [camera]
        type = "thin-lens"
        fov = 40
        aperture_radius = 0.3
        focus_distance = 4
        to_world.look_at = { origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }
        [[shapes]]
        type = "rectangle"
        material = { type = "diffuse", reflectance = 0 }
        [[emitters]]
        type = "point"
        position = [0, 0, 1]
        intensity = 1
        "#,
    );
    for integrator in ["path", "light", "bidirectional", "vcm:mode=bidirectional"] {
        assert_eq!(
            film(&source, integrator, &Job { samples: 0..256, ..Job::default() }).mean(),
            [0.0; 3],
            "{integrator}"
        );
    }
}

/// A point's light that a mirror sends through the lens is found by the light's walk alone, by whatever integrator.
#[test]
fn points_in_a_mirror_before_a_lens() {
    let source = parse(
        r#"
        film = { width = 8, height = 8 }
        [camera]
        type = "thin-lens"
        fov = 50
        aperture_radius = 0.5
        focus_distance = 5
        to_world.look_at = { origin = [0, -4, 3], target = [0.1, -2.1, 0], up = [0, 0, 1] }
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 4 }
        material = { type = "mirror", reflectance = 1 }
        [[emitters]]
        type = "point"
        position = [0.2, -1, 1.8]
        intensity = 1
        "#,
    );
    for integrator in ["bidirectional", "vcm:mode=light"] {
        let (mut light, mut difference) = (Moments::default(), Moments::default());
        for seed in 0..16 {
            let job = |seed| Job { samples: 0..512, seed, ..Job::default() };
            let mean = |integrator: &str, seed| film(&source, integrator, &job(seed)).mean()[1];
            let reference = mean("light", seed);
            light.add(reference);
            difference.add(mean(integrator, 100 + seed) - reference);
        }
        assert!(light.mean() > 0.0);
        assert!(difference.p_value(0.0) > LEVEL, "{integrator}: {} beside {}", difference.mean(), light.mean());
    }
}

/// A wall before a beam: E ρ/π where it is met, nothing elsewhere, and all of the power A E in the room.
#[test]
fn beams_are_their_closed_form() {
    let text = |shape: &str, scale: &str| {
        format!(
            r#"
            film = {{ width = 64, height = 64, filter = {{ type = "box" }} }}
            [camera]
            type = "orthographic"
            to_world.look_at = {{ origin = [0, 0, 2], target = [0, 0, 0], up = [0, 1, 0] }}
            [[shapes]]
            type = "rectangle"
            material = {{ type = "diffuse", reflectance = 0.5 }}
            [[emitters]]
            type = "directional-area"
            shape = "{shape}"
            irradiance = [1, 2, 4]
            to_world = [{{ scale = {scale} }}, {{ rotate = {{ axis = [1, 0, 0], angle = 180 }} }}, {{ translate = [0.1, 0.2, 3] }}]
            "#
        )
    };
    let pi = std::f64::consts::PI;
    for (shape, scale, area) in [
        ("rectangle", "[0.5, 0.25, 1]", 0.5),
        ("rectangle", "[-0.5, 0.25, 1]", 0.5),
        ("disk", "[0.5, 0.25, 3]", pi * 0.125),
        ("disk", "[0.5, -0.25, 1]", pi * 0.125),
    ] {
        let source = parse(&text(shape, scale));
        for integrator in [
            "path",
            "direct",
            "direct:sampling=product",
            "recursive:depth=2",
            "bidirectional",
            "light",
            "vcm:radius=0.01",
            "vcm:mode=merging,radius=0.03",
        ] {
            let films = films(&source, integrator, 1, 8, &[]);
            let means: Moments = films.iter().map(|f| f.mean()[1]).collect();
            // Of the picture's area 4.
            let value = 2.0 * 0.5 / pi * area / 4.0;
            let p = if (means.mean() / value - 1.0).abs() < 1e-5 { 1.0 } else { means.p_value(value) };
            assert!(p > LEVEL / 32.0, "{shape}, {scale}, {integrator}: {} for {value}, p {p:.1e}", means.mean());
            if integrator != "light" && integrator != "bidirectional" && !integrator.starts_with("vcm") {
                let image = films[0].develop().rgb("").expect("colours");
                let values: std::collections::BTreeSet<u32> =
                    image.iter().map(|c| (c[1] * 1e4).round() as u32).collect();
                let (first, last) = (values.first().expect("some"), values.last().expect("some"));
                assert_eq!((*first, *last), (0, (1e4 / pi).round() as u32), "{shape}, {integrator}");
            }
        }
    }
    // From behind, and beside it, there is none.
    let behind = parse(&text("rectangle", "0.5").replace("angle = 180", "angle = 0"));
    for integrator in ["path", "light", "bidirectional"] {
        assert_eq!(film(&behind, integrator, &Job::default()).mean(), [0.0; 3], "{integrator}");
    }
}

/// Pictures off the axis: the density of directions is that about the axis.
#[test]
fn shifted_pictures() {
    let box_camera = "type = \"perspective\"\nfov = 39.3077";
    let offset = "fov = 25\nprincipal_point_offset = [-0.7, 0.4]";
    for camera in [
        format!("type = \"perspective\"\n{offset}"),
        format!("type = \"thin-lens\"\n{offset}\naperture_radius = 60\nfocus_distance = 1000"),
    ] {
        let source = changed("cornell-box", &[(box_camera, &camera)], [16, 16]);
        let all = [("path:max_depth=4", 128), ("light:max_depth=4", 128), ("bidirectional:max_depth=4", 64)];
        agree_on(&camera, &source, &all, 40.0);
    }
}

/// One path at a time and sixteen in lanes: the same estimate. With samples of equal numbers all but rounding is the same.
#[test]
fn engines_agree() {
    let lens = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";
    for (name, change) in
        [("cornell-spheres", lens), ("sky", "type = \"orthographic\""), ("point-lights", "type = \"thin-lens\"")]
    {
        let old = built_in(name).lines().find(|l| l.starts_with("type = ")).expect("a camera").to_owned();
        let source = if name == "sky" { small(name, [24, 16]) } else { changed(name, &[(&old, change)], [24, 16]) };
        let scene = source.build().expect("a good scene");
        for integrator in ["light:max_depth=5", "bidirectional:max_depth=5"] {
            let film = |engine: Engine| {
                let sampler = Sampler::new(SamplerSettings::default(), 3);
                let integrator = settings(integrator).integrator(&scene, sampler, engine).expect("settings");
                let mut film = Film::new(24, 16);
                let budget = Budget { samples: Some(16), ..Budget::default() };
                render(&*integrator, &mut film, Region::whole(24, 16), 0, &budget, 2, &());
                film
            };
            let [wide, narrow] = [Engine::Wavefront, Engine::Scalar].map(film);
            // A ray that just meets an edge, and roulette on its edge, may differ.
            let apart = wide
                .values()
                .zip(narrow.values())
                .filter(|(a, b)| (0..3).any(|c| (a.mean[c] - b.mean[c]).abs() > 1e-3 * b.mean[c].abs() + 1e-6));
            let apart = apart.count();
            assert!(apart <= 8, "{name}, {integrator}: {apart} of 384 pixels");
        }
    }
}

/// Filters wider than a pixel, one of them negative in parts, and how ways are weighed.
#[test]
fn filters_and_heuristics() {
    for filter in ["{ type = \"mitchell\" }", "{ type = \"box\", radius = 0.8 }"] {
        let film = format!("[film]\nfilter = {filter}");
        let source = changed("cornell-box", &[("[film]", &film)], [16, 16]);
        let all = [
            ("path:max_depth=3", 128),
            ("light:max_depth=3", 128),
            ("bidirectional:max_depth=3,heuristic=balance", 32),
        ];
        agree_on(filter, &source, &all, 40.0);
    }
}

/// The room that is lit through a door ajar, of which the eye sees no light directly.
#[test]
fn door_ajar() {
    let source = small("indirect-room", [24, 16]);
    agree_on("indirect-room", &source, &[("path:max_depth=5", 512), ("bidirectional:max_depth=5", 64)], 20.0);
}

/// Walks that end by chance, and those that do not.
#[test]
fn roulettes_agree() {
    let source = small("cornell-spheres", [16, 16]);
    let all = [
        ("bidirectional:roulette=none,max_depth=16", 16),
        ("bidirectional:roulette=albedo,rr_depth=1,max_depth=16", 32),
        ("bidirectional:roulette=constant,survival=0.7,rr_depth=2,max_depth=16", 32),
        ("bidirectional:rr_depth=1,max_depth=16", 32),
        ("path:max_depth=16", 128),
    ];
    agree_on("cornell-spheres", &source, &all, 20.0);
}

/// The same on other scenes, walks short enough that those without roulette end.
#[test]
fn roulettes_agree_everywhere() {
    let lens = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";
    let rough =
        [("alpha = 0.005 ", "alpha = 0.15 "), ("alpha = 0.02 ", "alpha = 0.2 "), ("alpha = 0.05 ", "alpha = 0.3 ")];
    let sources = [
        ("cornell-box", small("cornell-box", [16, 16])),
        ("veach-mis", changed("veach-mis", &rough, [16, 16])),
        ("indirect-room", small("indirect-room", [24, 16])),
        ("point-lights", small("point-lights", [16, 16])),
        ("dragon", changed("dragon", &[("{ scale = 20 }", "{ scale = 2 }")], [16, 16])),
        ("lens", changed("cornell-spheres", &[("type = \"perspective\"", lens)], [16, 16])),
        ("furnace", furnace("0.8")),
        ("rough glass ball", coarse_ball("{ type = \"dielectric\", int_ior = 1.5, alpha = 0.4 }")),
    ];
    for (name, source) in &sources {
        let all = [("bidirectional:roulette=none,max_depth=5", 32), ("bidirectional:rr_depth=1,max_depth=5", 48)];
        agree_on(name, source, &all, 20.0 * sources.len() as f64);
    }
}

/// A ball of rough glass in a room.
#[test]
fn rough_glass() {
    let glass = "{ type = \"dielectric\", int_ior = 1.5, alpha = 0.3 }";
    let source = changed("cornell-spheres", &[("{ type = \"dielectric\", int_ior = 1.5 }", glass)], [16, 16]);
    let paths = "paths=L.*(D|G|T)E|LE,max_depth=6";
    let all =
        [(&*format!("path:{paths}"), 256), (&*format!("bidirectional:{paths}"), 64), (&*format!("light:{paths}"), 128)];
    agree_on("rough glass", &source, &all, 20.0);
}

/// Shading normals make scattering asymmetric; what light carries is corrected for that, or these would differ.
#[test]
fn shading_normals() {
    for material in [
        "{ type = \"diffuse\", reflectance = 0.8 }",
        "{ type = \"dielectric\", int_ior = 1.5, alpha = 0.4 }",
        "{ type = \"plastic\", diffuse_reflectance = 0.6, alpha = 0.3 }",
    ] {
        let source = coarse_ball(material);
        let all = [("path:max_depth=5", 128), ("bidirectional:max_depth=5", 64), ("light:max_depth=5", 256)];
        agree_on(material, &source, &all, 60.0);
    }
}

fn furnace(albedo: &str) -> SceneSource {
    changed("furnace", &[("reflectance = 0.5", &format!("reflectance = {albedo}"))], [16, 16])
}

/// 1/(1−ρ), whatever finds the light.
#[test]
fn furnaces_are_their_closed_form() {
    for (albedo, value) in [("0.5", 2.0), ("0.8", 5.0)] {
        let source = furnace(albedo);
        for integrator in ["bidirectional", "bidirectional:heuristic=balance,rr_depth=1", "light"] {
            let means: Moments = films(&source, integrator, 1, 64, &[]).iter().map(|f| f.mean()[1]).collect();
            let p = means.p_value(value);
            assert!(p > LEVEL / 6.0, "{albedo}, {integrator}: {} for {value}, p {p:.1e}", means.mean());
        }
    }
}

/// In the furnace every way to find paths of k + 2 vertices brings ρᵏ by itself; weighed they add up to it.
#[test]
fn each_strategy_alone_is_the_whole() {
    let source = furnace("0.5");
    let integrator = "bidirectional:max_depth=5,strategies=true";
    let films = films(&source, integrator, 1, 64, &[]);
    let means = |sheet: usize| -> Vec<f64> {
        films.iter().map(|f| f.layer_values(sheet).map(|v| v.mean[1]).sum::<f64>() / 256.0).collect()
    };
    let names: Vec<String> = films[0].layers().iter().map(|l| l.0.clone()).collect();
    let number = |name: &str| names.iter().position(|n| n == name).expect("a layer");
    for vertices in 2..=6_usize {
        let expected = 0.5_f64.powi(vertices as i32 - 2);
        let mut sums = vec![0.0; films.len()];
        for s in 0..=vertices {
            let name = format!("s{s}-t{}", vertices - s);
            sums.iter_mut().zip(means(number(&name))).for_each(|(sum, x)| *sum += x);
            let alone: Moments = means(number(&format!("{name}-unweighted"))).into_iter().collect();
            if s == vertices {
                // There is no lens to hit.
                assert_eq!(alone.mean(), 0.0, "{name}");
                continue;
            }
            let (mean, p) = (alone.mean(), alone.p_value(expected));
            let exact = (mean - expected).abs() <= 1e-5 * expected;
            assert!(exact || p > LEVEL / 20.0, "{name}: {mean} for {expected}, p {p:.1e}");
        }
        let sum: Moments = sums.into_iter().collect();
        let exact = (sum.mean() - expected).abs() <= 1e-5 * expected;
        assert!(exact || sum.p_value(expected) > LEVEL / 5.0, "{vertices} vertices: {sum:?} for {expected}");
    }
}

/// The weighed layers of all strategies add up to the picture.
#[test]
fn strategies_add_up() {
    let lens = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";
    let source = changed("cornell-spheres", &[("type = \"perspective\"", lens)], [16, 16]);
    let film = &films(&source, "bidirectional:max_depth=4,strategies=true", 1, 16, &[])[0];
    let weighed: Vec<usize> =
        (0..film.layers().len()).filter(|i| !film.layers()[*i].0.ends_with("unweighted")).collect();
    assert_eq!(weighed.len(), 3 + 4 + 5 + 6);
    let layers: Vec<Vec<_>> = weighed.iter().map(|i| film.layer_values(*i).collect()).collect();
    for (i, whole) in film.values().enumerate() {
        for c in 0..3 {
            let sum: f64 = layers.iter().map(|l| l[i].mean[c]).sum();
            assert!((sum - whole.mean[c]).abs() <= 1e-5 * whole.mean[c] + 1e-9, "{sum} for {}", whole.mean[c]);
        }
    }
    let lit = |name: &str| {
        let layer = film.layers().iter().position(|l| l.0 == name).expect("a layer");
        film.layer_values(layer).any(|v| v.mean[1] > 0.0)
    };
    for name in ["s0-t2", "s1-t1", "s0-t3", "s1-t2", "s2-t1", "s4-t0", "s2-t2", "s3-t2"] {
        assert!(lit(name), "{name} has light");
    }
}

/// Light is sorted by the paths it took, and not by how they were found.
#[test]
fn classes_agree() {
    let source = small("cornell-spheres", [16, 16]);
    let layers = PathLayer::by_class();
    let [path, both] = [("path:max_depth=5", 256), ("bidirectional:max_depth=5", 64)]
        .map(|(integrator, samples)| films(&source, integrator, u64::from(samples), samples, &layers));
    for (number, layer) in layers.iter().enumerate() {
        let image = |films: &[Film]| image_of(&films.iter().map(|f| blocks(f, number + 1)).collect::<Vec<_>>(), 4);
        let (a, b) = (image(&both), image(&path));
        let what = &layer.name;
        judge(&a, &b, 1, LEVEL / (3.0 * 8.0 * 20.0)).unwrap_or_else(|e| panic!("{what}, {e}"));
    }
}

/// A pixel's own variance is what the film says it is, splats included.
#[test]
fn variances_are_known() {
    let source = small("cornell-box", [8, 8]);
    for integrator in ["light:max_depth=3", "bidirectional:max_depth=3"] {
        let scene = source.build().expect("a good scene");
        let films: Vec<Film> = (0..200)
            .map(|seed| {
                let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
                let settings = settings(integrator);
                let integrator = settings.integrator(&scene, sampler, Job::default().engine).expect("settings");
                let (mut film, budget) = (Film::new(8, 8), Budget { samples: Some(16), ..Budget::default() });
                render(&*integrator, &mut film, Region::whole(8, 8), 0, &budget, 2, &());
                film
            })
            .collect();
        // Over all pixels: the mean of the stated variances over the variance there is. 64 pixels of 199 degrees of freedom
        // each, some of them tied together: 0.1 is more than five standard errors.
        let (mut stated, mut real) = (0.0, 0.0);
        let values: Vec<Vec<_>> = films.iter().map(|f| f.values().collect()).collect();
        for pixel in 0..64 {
            let means: Moments = values.iter().map(|v| v[pixel].mean[1]).collect();
            real += means.variance();
            stated += values.iter().map(|v| v[pixel].variance[1]).sum::<f64>() / 200.0;
        }
        assert!((stated / real - 1.0).abs() < 0.1, "{integrator}: {stated} for {real}");
    }
}

/// Same bits for any number of threads, and in parts.
#[test]
fn same_bits() {
    let lens = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";
    let source = changed("cornell-spheres", &[("type = \"perspective\"", lens)], [40, 24]);
    let scene = source.build().expect("a good scene");
    let layers = PathLayer::by_class();
    let names: Vec<String> = layers.iter().map(|l| l.name.clone()).collect();
    for integrator in ["light", "bidirectional"] {
        let sampler = Sampler::new(SamplerSettings::default(), 1);
        let integrator = settings(integrator);
        let integrator =
            integrator.layered_integrator(&scene, sampler, Job::default().engine, &layers).expect("settings");
        let film = |first: u32, samples: u32, threads: usize| {
            let mut film = Film::try_new(40, 24, &names).expect("memory");
            let budget = Budget { samples: Some(samples), ..Budget::default() };
            render(&*integrator, &mut film, Region::whole(40, 24), first, &budget, threads, &());
            film
        };
        let whole = film(0, 40, 1);
        for threads in [2, 5] {
            assert_eq!(film(0, 40, threads), whole, "{threads} threads");
        }
        let mut parts = film(0, 7, 2);
        parts.merge(&film(7, 33, 2));
        assert_eq!(parts, whole, "in parts");
    }
}

/// A part of a picture has the light of that part, though fewer walks from the light make it.
#[test]
fn crops_agree() {
    let source = small("cornell-box", [32, 32]);
    let scene = source.build().expect("a good scene");
    let region = Region { x: 9, y: 13, width: 16, height: 16, full_width: 32 };
    let image = |integrator: &str, first: u64, samples: u32| {
        let films: Vec<_> = (0..FILMS)
            .map(|seed| {
                let sampler = Sampler::new(SamplerSettings::default(), first + seed);
                let integrator =
                    settings(integrator).integrator(&scene, sampler, Job::default().engine).expect("settings");
                let mut film = Film::new(16, 16);
                let budget = Budget { samples: Some(samples), ..Budget::default() };
                render(&*integrator, &mut film, region, 0, &budget, 2, &());
                blocks(&film, 0)
            })
            .collect();
        image_of(&films, 4)
    };
    let path = image("path:max_depth=3", 100, 128);
    for (integrator, samples) in [("light:max_depth=3", 512), ("bidirectional:max_depth=3", 64)] {
        judge(&image(integrator, 1, samples), &path, 1, LEVEL / 6.0).unwrap_or_else(|e| panic!("{integrator}, {e}"));
    }
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let scene = small("cornell-box", [4, 4]).build().expect("a good scene");
    for (text, part) in [
        ("light:roulette=none", "never end"),
        ("bidirectional:survival=0", "no probability"),
        ("bidirectional:strategies=true", "at most 8 segments"),
        ("bidirectional:strategies=true,max_depth=9", "at most 8 segments"),
    ] {
        let settings: IntegratorSettings = from_settings(text).expect("settings").0;
        let sampler = Sampler::new(SamplerSettings::default(), 0);
        let refused =
            settings.integrator(&scene, sampler, Job::default().engine).err().map(|e| e.message).unwrap_or_default();
        assert!(refused.contains(part), "{text}: {refused}");
    }
}
