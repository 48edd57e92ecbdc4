//! What camera rays meet: against closed forms, alone and beside a picture, which stays as it is.

mod common;

use common::*;
use rebond::film::{Aov, Film, Image};
use rebond::render::{Budget, Engine, Observer, Region, render};
use rebond::sampling::Sampler;
use rebond_io::SceneSource;
use std::sync::atomic::{AtomicU64, Ordering};

/// A ball and a floor, as seen by parallel rays from above; half of the picture is empty.
fn scene(more: &str) -> SceneSource {
    parse(&format!(
        r#"
        {more}
        [film]
        width = 32
        height = 32
        filter = {{ type = "box", radius = 1e-4 }}
        aovs = ["depth", "position", "uv", "geo-normal", "sh-normal", "albedo", "prim-index", "shape-index"]
        [camera]
        type = "orthographic"
        to_world.look_at = {{ origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }}
        [[shapes]]
        type = "rectangle"
        to_world = [{{ scale = [0.5, 1, 1] }}, {{ translate = [0.5, 0, -2] }}]
        material = {{ type = "two-sided", front = {{ type = "diffuse", reflectance = [0.2, 0.4, 0.6] }} }}
        [[shapes]]
        type = "sphere"
        radius = 0.4
        center = [0.5, 0.2, 1]
        emission = 2
        material = {{ type = "diffuse", reflectance = 0.7 }}
        "#
    ))
}

fn image(source: &SceneSource, integrator: &str, samples: u32, engine: Engine) -> Image {
    let scene = source.build().expect("a good scene");
    let names: Vec<String> = source.description.film.aovs.iter().map(|aov| aov.name().to_owned()).collect();
    let integrator = settings(integrator).integrator(&scene, Sampler::new(Job::default().sampler, 1), engine);
    let integrator = integrator.expect("settings that go together");
    let mut film = Film::try_new(32, 32, &names).expect("memory");
    let budget = Budget { samples: Some(samples), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(32, 32), 0, &budget, 2, &());
    film.develop()
}

#[test]
fn values_are_those_of_the_surface() {
    let source = scene("");
    for engine in [Engine::Wavefront, Engine::Scalar] {
        let image = image(&source, "path:max_depth=2", 8, engine);
        let layer = |aov: Aov| image.rgb(aov.name()).expect("a layer");
        let layers = Aov::ALL.map(layer);
        let mut on_ball = 0;
        for i in 0..32 * 32 {
            // +x is to the right, +y up.
            let (x, y) = (((i % 32) as f32 + 0.5) / 16.0 - 1.0, 1.0 - ((i / 32) as f32 + 0.5) / 16.0);
            let [depth, position, uv, ng, ns, albedo, prim, shape] = layers.each_ref().map(|l| l[i]);
            let near = |a: [f32; 3], b: [f32; 3], what: &str| {
                let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(apart < 2e-3, "{what} at ({x}, {y}): {a:?} for {b:?}");
            };
            let d2 = 0.16 - (x - 0.5).powi(2) - (y - 0.2).powi(2);
            if d2.abs() < 0.03 {
                // The rim is steep.
                continue;
            }
            if d2 > 0.0 {
                on_ball += 1;
                let z = 1.0 + d2.sqrt();
                let n = [(x - 0.5) / 0.4, (y - 0.2) / 0.4, d2.sqrt() / 0.4];
                near(depth, [5.0 - z; 3], "depth");
                near(position, [x, y, z], "position");
                near(ng, n, "normal");
                near(ns, n, "normal");
                near(albedo, [0.7; 3], "albedo");
                assert_eq!((prim, shape), ([0.0; 3], [1.0; 3]));
            } else if x > 0.0 {
                near(depth, [7.0; 3], "depth");
                near(position, [x, y, -2.0], "position");
                near(uv, [x, (y + 1.0) / 2.0, 0.0], "uv");
                near(ng, [0.0, 0.0, 1.0], "normal");
                near(ns, [0.0, 0.0, 1.0], "normal");
                near(albedo, [0.2, 0.4, 0.6], "albedo");
                assert_eq!(shape, [0.0; 3]);
                assert!(prim == [0.0; 3] || prim == [1.0; 3], "{prim:?}");
            } else {
                for value in [depth, position, uv, ng, ns, albedo, prim, shape] {
                    assert_eq!(value, [0.0; 3]);
                }
            }
        }
        assert!(on_ball > 50, "{on_ball}");
    }
}

/// A picture is the same to the bit with layers and without; alone each is what it is as a layer. Hidden lights are there.
#[test]
fn layers_stand_beside() {
    let with = scene("");
    let mut without = with.clone();
    without.description.film.aovs.clear();
    for integrator in ["path:max_depth=3", "bidirectional:max_depth=3", "vcm:max_depth=3,radius=0.05"] {
        // More than one turn of each.
        let [a, b] = [&with, &without].map(|s| image(s, integrator, 40, Engine::Wavefront));
        for layer in ["", "variance"] {
            assert_eq!(a.rgb(layer), b.rgb(layer), "{integrator}");
        }
        assert_eq!((a.layers.len(), b.layers.len()), (11, 3));
        for aov in Aov::ALL {
            let alone = image(&without, &format!("aov:show={}", aov.name()), 40, Engine::Wavefront);
            assert_eq!(alone.rgb(""), a.rgb(aov.name()), "{}", aov.name());
        }
    }
    let hidden = image(&scene("hide_emitters = true"), "path:max_depth=3", 8, Engine::Wavefront);
    let seen = image(&with, "path:max_depth=3", 8, Engine::Wavefront);
    assert_eq!(hidden.rgb("depth"), seen.rgb("depth"));
    assert_ne!(hidden.rgb(""), seen.rgb(""));
}

/// Whenever a render is stopped but at its very beginning, the picture has samples as its layers have.
#[test]
fn what_ends_early_has_both() {
    struct Stop(AtomicU64);
    impl Observer for Stop {
        fn advance(&self, samples: u64, _: u64) {
            self.0.fetch_add(samples, Ordering::Relaxed);
        }
        fn should_stop(&self) -> bool {
            self.0.load(Ordering::Relaxed) > 32 * 32 * 20
        }
    }
    let source = scene("");
    let built = source.build().expect("a good scene");
    let names: Vec<String> = source.description.film.aovs.iter().map(|aov| aov.name().to_owned()).collect();
    for text in [
        "path:max_depth=2",
        "bidirectional:max_depth=3",
        "vcm:max_depth=3,radius=0.05",
        "photon:progressive=true,photons=100",
    ] {
        let integrator = settings(text).integrator(&built, Sampler::new(Job::default().sampler, 1), Engine::default());
        let integrator = integrator.expect("settings that go together");
        let mut film = Film::try_new(32, 32, &names).expect("memory");
        let budget = Budget { samples: Some(100_000), ..Budget::default() };
        render(&*integrator, &mut film, Region::whole(32, 32), 0, &budget, 2, &Stop(AtomicU64::new(0)));
        let image = film.develop();
        let bright = |layer: &str| image.rgb(layer).expect("a layer").iter().map(|c| c[0]).sum::<f32>();
        assert!(bright("") > 0.0 && bright("depth") > 0.0, "{text}: {} and {}", bright(""), bright("depth"));
    }
}

/// What of a sheet is neither glass nor passes is its albedo.
#[test]
fn albedo_of_sheets() {
    let source = parse(
        r#"
        film = { width = 32, height = 32, aovs = ["albedo"] }
        camera = { type = "orthographic", to_world.look_at = { origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] } }
        [[shapes]]
        type = "rectangle"
        material = { type = "principled-thin", base_color = [0.8, 0.6, 0.3], transmission = 0.5, diffuse_transmission = 0.4 }
        "#,
    );
    let albedo = image(&source, "path:max_depth=2", 4, Engine::default()).rgb("albedo").expect("a layer")[32 * 16 + 16];
    albedo.iter().zip([0.24, 0.18, 0.09]).for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{albedo:?}"));
}

/// Of a film that has no such layers the picture is rendered alone.
#[test]
fn films_without_layers_are_filled() {
    let film = film(&scene(""), "path:max_depth=2", &Job::default());
    assert!(film.layers().is_empty() && film.mean()[0] > 0.0);
}
