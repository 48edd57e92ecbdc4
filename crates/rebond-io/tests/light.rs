//! Renders whose answer is known: by theory, by another engine, or by themselves in another order.

mod common;

use common::*;
use rebond::emitter::LightChoice;
use rebond::film::{Film, Image};
use rebond::render::{Engine, Pass, Region};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{BUILT_IN_SCENES, BuiltIn};
use std::sync::Mutex;

const LEVEL: f64 = 0.01;

/// Inside a sphere that shines with 1 and reflects ρ, L = 1 / (1 − ρ) everywhere.
#[test]
fn furnace_is_one_over_one_minus_albedo() {
    for albedo in [0.5, 0.8] {
        for (engine, sampler) in
            [(Engine::Wavefront, SamplerSettings::Sobol {}), (Engine::Scalar, SamplerSettings::Independent {})]
        {
            let text = BUILT_IN_SCENES.iter().find(|b| b.name == "furnace").expect("built in").text;
            let mut source = parse(&text.replace("reflectance = 0.5", &format!("reflectance = {albedo}")));
            (source.description.film.width, source.description.film.height) = (64, 64);
            let film = film(&source, "path", &Job { engine, sampler, samples: 0..64, ..Job::default() });
            let (mean, p) = t_test(&film, 1.0 / (1.0 - albedo));
            assert!(p > LEVEL, "albedo {albedo}, {engine:?}: mean {mean}, p = {p}");
        }
    }
}

/// Cut off at depth d, the furnace is the partial sum 1 + ρ + … + ρ^(d−1).
#[test]
fn depth_counts_segments() {
    for depth in 1..=4 {
        let source = small("furnace", [48, 48]);
        let film = film(&source, &format!("path:max_depth={depth}"), &Job { samples: 0..64, ..Job::default() });
        let expected = (1.0 - 0.5_f64.powi(depth)) / 0.5;
        let (mean, p) = t_test(&film, expected);
        assert!(p > LEVEL, "depth {depth}: mean {mean} for {expected}, p = {p}");
    }
}

/// (I/d²)(ρ/π) cosθ at the point of the plane that each pixel sees, to 1e-5.
#[test]
fn a_point_light_over_a_plane_is_exact() {
    let source = parse(
        r#"
        film = { width = 16, height = 16, filter = { type = "box", radius = 1e-6 } }
        integrator = { type = "path", max_depth = 2 }
        [camera]
        type = "orthographic"
        to_world = [{ scale = 2 }, { look_at = { origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] } }]
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 10 }
        material = { type = "diffuse", reflectance = 0.6 }
        [[emitters]]
        type = "point"
        position = [0.3, -0.2, 1.5]
        intensity = [7, 5, 3]
        "#,
    );
    for engine in [Engine::Wavefront, Engine::Scalar] {
        let film = film(&source, "path:max_depth=2", &Job { engine, samples: 0..4, ..Job::default() });
        for (i, pixel) in film.pixels().iter().enumerate() {
            // Local +x is to the left of the picture.
            let x = (1.0 - 2.0 * ((i % 16) as f64 + 0.5) / 16.0) * 2.0;
            let y = (1.0 - 2.0 * ((i / 16) as f64 + 0.5) / 16.0) * 2.0;
            // Looking along −z with y up, left is −x in the world.
            let to = [0.3 + x, -0.2 - y, 1.5];
            let d2 = to.iter().map(|c| c * c).sum::<f64>();
            let expected = 5.0 / d2 * (0.6 / std::f64::consts::PI) * (1.5 / d2.sqrt());
            let got = pixel.mean()[1];
            assert!((got / expected - 1.0).abs() < 1e-5, "pixel {i}: {got} for {expected}");
        }
    }
}

/// A light that is alone with a mirror is seen in it, whichever engine; glass of index 1 is not there.
#[test]
fn a_window_of_index_one_changes_nothing() {
    let scene = |window: &str| {
        parse(&format!(
            r#"
            film = {{ width = 24, height = 24, filter = {{ type = "box" }} }}
            [camera]
            type = "perspective"
            fov = 40
            to_world.look_at = {{ origin = [0, 0, 6], target = [0, 0, 0], up = [0, 1, 0] }}
            [[shapes]]
            type = "rectangle"
            to_world = [{{ translate = [0, 0, -1] }}]
            emission = [1, 2, 3]
            {window}
            "#
        ))
    };
    let window = "[[shapes]]\ntype = \"sphere\"\nradius = 0.9\nmaterial = { type = \"dielectric\", int_ior = 1.0 }\n";
    let (plain, seen) = (film(&scene(""), "path", &Job::default()), film(&scene(window), "path", &Job::default()));
    for (i, (a, b)) in plain.pixels().iter().zip(seen.pixels()).enumerate() {
        assert!((a.mean()[2] - b.mean()[2]).abs() < 1e-6, "pixel {i}: {:?} and {:?}", a.mean(), b.mean());
    }
}

/// The same bits for any number of threads.
#[test]
fn threads_do_not_show() {
    for BuiltIn { name, .. } in BUILT_IN_SCENES {
        for engine in [Engine::Wavefront, Engine::Scalar] {
            let source = small(name, [36, 20]);
            let films: Vec<Film> = [1, 2, 5]
                .iter()
                .map(|t| film(&source, "path", &Job { engine, threads: *t, ..Job::default() }))
                .collect();
            assert!(films[0] == films[1] && films[0] == films[2], "{name}, {engine:?}");
        }
    }
}

/// [0, 32) and [32, 64) apart and merged are [0, 64), bit for bit; and so is any division into passes.
#[test]
fn sample_ranges_merge() {
    for name in ["cornell-spheres", "glossy-spheres"] {
        let source = small(name, [40, 40]);
        let part = |samples| film(&source, "path", &Job { samples, ..Job::default() });
        let (mut first, whole) = (part(0..32), part(0..64));
        first.merge(&part(32..64));
        assert!(first == whole, "{name}");
        let mut thirds = part(0..7);
        thirds.merge(&part(7..50));
        thirds.merge(&part(50..64));
        assert!(thirds == whole, "{name}, uneven parts");
    }
}

/// A crop has the pixels of the whole.
#[test]
fn crops_are_cut_from_the_whole() {
    let source = small("cornell-box", [50, 50]);
    let scene = source.build().expect("a good scene");
    let sampler = Sampler::new(SamplerSettings::default(), 1);
    let integrator = settings("path").integrator(&scene, sampler, Engine::Wavefront).expect("settings");
    let crop = Region { x: 13, y: 21, width: 17, height: 9, full_width: 50 };
    let cut = Mutex::new(Film::new(17, 9));
    integrator.add_samples(&cut, &Pass { region: crop, samples: 0..8, threads: 2, shares: None }, &());
    let cut = cut.into_inner().expect("no panic");
    let whole = film(&source, "path", &Job { samples: 0..8, ..Job::default() });
    for y in 0..9 {
        for x in 0..17 {
            assert!(cut.pixels()[y * 17 + x] == whole.pixels()[(y + 21) * 50 + x + 13]);
        }
    }
}

/// The scalar and the wavefront engine estimate the same picture, on every scene, from independent samples.
#[test]
fn engines_agree_on_every_scene() {
    for b in BUILT_IN_SCENES {
        let source = small(b.name, [48, 48]);
        let one = |engine, seed| {
            let sampler = SamplerSettings::Independent {};
            film(&source, "path:max_depth=12", &Job { engine, seed, sampler, samples: 0..64, ..Job::default() })
                .develop()
        };
        let (a, b_) = (one(Engine::Scalar, 1), one(Engine::Wavefront, 2));
        agree(&a, &b_, LEVEL / (3 * BUILT_IN_SCENES.len()) as f64, b.name);
    }
}

/// Two readings of Phong's lobe: what it does to a mirror under a sharp light a mirror shows under the light so blurred,
/// wherever the lobe stays above the horizon.
#[test]
fn phong_blurs_a_mirror_or_its_light() {
    // The middle of the sphere: normals of up to 45°.
    let camera = "[camera]\ntype = 'orthographic'\nto_world = [{ scale = 0.5 }, { look_at = { origin = [-1.2, 1, 5], \
                  target = [-1.2, 1, 0], up = [0, 1, 0] } }]\n";
    let picture = |name: &str, seed| {
        let mut source = small(name, [48, 48]);
        source.description.shapes.truncate(1);
        source.description.camera = parse(camera).description.camera;
        let sampler = SamplerSettings::Independent {};
        film(&source, "path:max_depth=2", &Job { seed, sampler, samples: 0..512, ..Job::default() }).develop()
    };
    // Large blocks: beside the window few of Phong's samples find it, and means of few such are not normal.
    let agree = |a: &Image, b: &Image| judge(a, b, 16, LEVEL / 6.0).is_ok();
    let [sharp60, sharp300] = ["phong-60", "phong-300"].map(|name| picture(name, 1));
    let [light60, light300] = ["phong-60-blurred-light", "phong-300-blurred-light"].map(|name| picture(name, 2));
    assert!(agree(&sharp60, &light60), "exponent 60");
    assert!(agree(&sharp300, &light300), "exponent 300");
    assert!(!agree(&sharp60, &light300) && !agree(&sharp300, &light60));
}

/// Given the same samples, the engines trace the same paths: pixels agree but for rounding in the ray kernels.
#[test]
fn engines_draw_the_same_numbers() {
    for BuiltIn { name, .. } in BUILT_IN_SCENES {
        let source = small(name, [40, 40]);
        let one = |engine| film(&source, "path:max_depth=6", &Job { engine, samples: 0..4, ..Job::default() });
        let (a, b) = (one(Engine::Scalar), one(Engine::Wavefront));
        let differ = a.pixels().iter().zip(b.pixels()).filter(|(p, q)| {
            let (p, q) = (p.mean()[1], q.mean()[1]);
            (p - q).abs() > 1e-3 * p.abs().max(1e-3)
        });
        // A path that a rounding sends past the other side of an edge is another path.
        let share = differ.count() as f64 / 1600.0;
        assert!(share < 0.01, "{name}: {share} of the pixels differ");
    }
}

/// A scene does not know its units: a lamp over a floor looks the same in nanometres and in light years.
#[test]
fn units_do_not_show() {
    let mean = |s: f64| {
        let text = format!(
            r#"
            film = {{ width = 16, height = 16 }}
            camera = {{ type = "perspective", fov = 50, to_world.look_at = {{ origin = [0, {y}, {z}], target = [0, 0, 0], up = [0, 1, 0] }} }}
            [[shapes]]
            type = "rectangle"
            material = {{ type = "diffuse", reflectance = 0.5 }}
            to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = -90 }} }}, {{ scale = {s} }}]
            [[shapes]]
            type = "rectangle"
            emission = 10
            material = {{ type = "diffuse", reflectance = 0.2 }}
            to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = 90 }} }}, {{ scale = {lamp} }}, {{ translate = [0, {s}, 0] }}]
            "#,
            y = 0.5 * s,
            z = 3.0 * s,
            lamp = 0.3 * s,
        );
        film(&parse(&text), "path", &Job { samples: 0..64, ..Job::default() }).mean()[1]
    };
    let one = mean(1.0);
    assert!(one > 0.05);
    for s in [1e-9, 1e-6, 1e-3, 1e3, 1e7, 1e10, 1e13, 1e16] {
        let other = mean(s);
        assert!((other / one - 1.0).abs() < 2e-3, "in units of {s}: {other} for {one}");
    }
}

/// Whichever way an emitter is chosen, the picture is the same.
#[test]
fn light_choices_agree() {
    let scenes = ["many-lights", "cornell-spheres", "glossy-spheres", "point-lights", "sky", "veach-mis"];
    for name in scenes {
        let one = |choice, seed| {
            let mut source = small(name, [48, 48]);
            source.description.light_choice = Some(choice);
            let sampler = SamplerSettings::Independent {};
            film(&source, "path:max_depth=6", &Job { sampler, seed, samples: 0..256, ..Job::default() }).develop()
        };
        agree(&one(LightChoice::Power, 1), &one(LightChoice::Tree, 2), LEVEL / (3 * scenes.len()) as f64, name);
    }
}

/// Every sampler gives the same picture.
#[test]
fn samplers_agree() {
    let source = small("cornell-box", [48, 48]);
    let one = |sampler, seed| film(&source, "path", &Job { sampler, seed, samples: 0..64, ..Job::default() }).develop();
    let reference = one(SamplerSettings::Independent {}, 1);
    for sampler in [SamplerSettings::Sobol {}, SamplerSettings::Stratified { samples: 64 }] {
        agree(&one(sampler, 2), &reference, LEVEL / 6.0, &format!("{sampler:?}"));
    }
}

/// A flat light shines to the side of its normal, however it is flipped, mirrored and turned, and sampling it agrees
/// with hitting it: below it the irradiance of the closed form, above it nothing.
#[test]
fn lights_shine_to_one_side() {
    for shape in ["rectangle", "disk"] {
        for flip in [false, true] {
            for scale in ["[1, 1, 1]", "[-1, 1, 1]", "[1, -1, 1]", "[1, 1, -1]", "[-1, -1, -1]"] {
                // The normal is +z, turned by flipping and, for a shape in the plane z = 0, by mirroring z.
                let mirrored_z = scale.ends_with("-1]");
                let up = flip == mirrored_z;
                let radiance = |above: bool| {
                    let z = if above { 5 } else { -5 };
                    let text = format!(
                        r#"
                        film = {{ width = 8, height = 8, filter = {{ type = "box" }} }}
                        camera = {{ type = "orthographic", to_world = [{{ scale = 0.002 }}, {{ look_at = {{ origin = [4, 0, 0], target = [0, 0, {z}], up = [0, 1, 0] }} }}] }}
                        [[shapes]]
                        type = "{shape}"
                        emission = 10
                        flip_normals = {flip}
                        material = {{ type = "diffuse", reflectance = 0 }}
                        to_world = {{ scale = {scale} }}
                        [[shapes]]
                        type = "rectangle"
                        material = {{ type = "two-sided", front = {{ type = "diffuse", reflectance = 0.5 }} }}
                        to_world = [{{ scale = 3 }}, {{ translate = [0, 0, {z}] }}]
                        "#
                    );
                    film(&parse(&text), "path:max_depth=2", &Job { samples: 0..64, ..Job::default() })
                };
                let (lit, dark) = (radiance(up), radiance(!up));
                assert_eq!(dark.mean(), [0.0; 3], "{shape}, flip {flip}, scale {scale}: the dark side");
                // On the axis at distance 5: L ρ × form factor of the disk, 1/(1 + h²), or of the square.
                let form_factor = if shape == "disk" {
                    1.0 / 26.0
                } else {
                    let (x, root) = (0.2_f64, 1.04_f64.sqrt());
                    4.0 * 2.0 * x / root * (x / root).atan() / std::f64::consts::TAU
                };
                let (mean, p) = t_test(&lit, 10.0 * 0.5 * form_factor);
                // Twenty tests; the patch that is seen is so small that the closed form holds all over it.
                assert!(p > LEVEL / 20.0, "{shape}, flip {flip}, scale {scale}: {mean}, p {p}");
            }
        }
    }
}
