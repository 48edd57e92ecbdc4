//! The path tracing family: its members agree, its layers add up, and its parts are their closed forms.

mod common;

use common::*;
use rebond::film::{Channel, Film, Image, Layer};
use rebond::integrators::IntegratorSettings;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, PathLayer, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{SceneSource, from_settings};

#[path = "../../../docs/fifty_lines.rs"]
mod fifty_lines;

const LEVEL: f64 = 0.01;

fn independent(seed: u64, samples: u32) -> Job {
    Job { seed, sampler: SamplerSettings::Independent {}, samples: 0..samples, ..Job::default() }
}

/// A film with layers.
fn layered(source: &SceneSource, integrator: &str, layers: &[PathLayer], job: &Job) -> Film {
    let scene = source.build().expect("a good scene");
    let sampler = Sampler::new(job.sampler, job.seed);
    let integrator = settings(integrator).layered_integrator(&scene, sampler, job.engine, layers).expect("settings");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let names: Vec<String> = layers.iter().map(|l| l.name.clone()).collect();
    let mut film = Film::try_new(width, height, &names).expect("memory");
    let budget = Budget { samples: Some(job.samples.len() as u32), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), job.samples.start, &budget, job.threads, &());
    film
}

/// Whatever finds light, and whatever ends paths, the expectation is one.
#[test]
fn modes_and_recursion_agree() {
    let others = ["path:mode=implicit,max_depth=4", "path:mode=explicit,max_depth=4", "recursive:branching=3,depth=4"];
    for (name, samples) in
        [("cornell-box", 4096), ("cornell-spheres", 4096), ("dragon", 1024), ("glossy-spheres", 1024), ("sky", 4096)]
    {
        let source = small(name, [16, 16]);
        let reference = film(&source, "path:max_depth=4", &independent(99, samples)).develop();
        for (i, integrator) in others.iter().enumerate() {
            // Nine camera rays' worth of branches each.
            let samples = if i == 2 { samples / 8 } else { samples };
            let other = film(&source, integrator, &independent(i as u64, samples)).develop();
            agree(&other, &reference, LEVEL / (3.0 * 5.0 * 3.0), &format!("{name}, {integrator}"));
        }
    }
}

#[test]
fn roulettes_agree() {
    // 24 segments are as good as all here: what is left is below 0.8²⁴ = 0.5 % of the light, the same for all.
    let source = small("cornell-spheres", [16, 16]);
    let reference = film(&source, "path:roulette=none,max_depth=24", &independent(99, 2048)).develop();
    for (i, roulette) in [
        "roulette=constant,survival=0.7,rr_depth=1",
        "roulette=albedo,rr_depth=1",
        "roulette=albedo,survival=0.6,rr_depth=3",
        "roulette=throughput,rr_depth=1",
        "roulette=throughput",
    ]
    .iter()
    .enumerate()
    {
        for mode in ["explicit", "mis"] {
            let integrator = format!("path:mode={mode},max_depth=24,{roulette}");
            let other = film(&source, &integrator, &independent(i as u64, 2048)).develop();
            agree(&other, &reference, LEVEL / (3.0 * 10.0), &integrator);
        }
    }
}

/// The picture of paths of at most p segments is the sum of the layers up to p + 1 vertices, and all layers are the whole.
#[test]
fn lengths_add_up() {
    let source = small("cornell-spheres", [24, 24]);
    let job = Job { samples: 0..64, ..Job::default() };
    let whole = layered(&source, "path", &PathLayer::by_length(8), &job);
    assert_eq!(whole.pixels(), film(&source, "path", &job).pixels(), "layers leave the picture as it is");
    let close = |sum: f64, one: f64| assert!((sum - one).abs() <= 2e-6 * one + 1e-9, "{sum} for {one}");
    for i in 0..whole.pixels().len() {
        for c in 0..3 {
            let sum: f64 = whole.layers().iter().map(|(_, pixels)| pixels[i].mean()[c]).sum();
            close(sum, whole.pixels()[i].mean()[c]);
        }
    }
    for depth in 1..=4 {
        let clamped = film(&source, &format!("path:max_depth={depth}"), &job);
        for (i, pixel) in clamped.pixels().iter().enumerate() {
            let sum: f64 = whole.layers()[..depth].iter().map(|(_, pixels)| pixels[i].mean()[0]).sum();
            close(sum, pixel.mean()[0]);
        }
    }
}

/// Each bounce in the furnace brings ρ times as much as the one before.
#[test]
fn furnace_layers_are_their_closed_form() {
    let source = small("furnace", [16, 16]);
    for (m, mode) in ["implicit", "explicit", "mis"].iter().enumerate() {
        for seed in 0..3 {
            let job = independent(10 * m as u64 + seed, 256);
            let integrator = format!("path:mode={mode},rr_depth=2");
            let whole = layered(&source, &integrator, &PathLayer::by_length(7), &job);
            for (k, (name, pixels)) in whole.layers().iter().enumerate() {
                let expected = if k < 6 { 0.5_f64.powi(k as i32) } else { 2.0 * 0.5_f64.powi(6) };
                let moments: Moments = pixels.iter().map(|p| p.mean()[1]).collect();
                let exact = (moments.mean() - expected).abs() <= 2e-6 * expected;
                let p = moments.p_value(expected);
                assert!(exact || p > LEVEL / 63.0, "{mode}, {name}: {} for {expected}, p {p:.1e}", moments.mean());
            }
        }
    }
}

/// A layer is what its expression selects, to the last bit; and both engines sort light alike.
#[test]
fn expressions_select_what_layers_hold() {
    let source = small("cornell-spheres", [16, 16]);
    let job = Job { samples: 0..64, ..Job::default() };
    let classes = layered(&source, "path", &PathLayer::by_class(), &job);
    let mean = |pixels: &[rebond::film::Pixel]| pixels.iter().map(|p| p.mean()[1]).sum::<f64>();
    for (layer, paths) in [
        ("emission", "LE"),
        ("direct-diffuse", "LDE"),
        ("direct-specular", "L(S|T)E"),
        ("caustic", "L(S|T|G)*(S|T)(S|T|G)*DE"),
    ] {
        let alone = film(&source, &format!("path:paths={paths}"), &job);
        let (_, pixels) = classes.layers().iter().find(|(name, _)| name == layer).expect("a layer");
        assert!(mean(pixels) > 0.0, "{layer} has light");
        for (a, b) in alone.pixels().iter().zip(pixels) {
            assert_eq!(a.mean(), b.mean(), "{layer}");
        }
    }
    let scalar = Job { engine: Engine::Scalar, samples: 0..64, ..Job::default() };
    let scalar = layered(&source, "path", &PathLayer::by_class(), &scalar);
    assert_eq!(scalar.layers(), classes.layers());
    for threads in [1, 5] {
        let job = Job { threads, samples: 0..64, ..Job::default() };
        assert_eq!(layered(&source, "path", &PathLayer::by_class(), &job), classes, "{threads} threads");
    }
}

#[test]
fn fifty_lines_are_a_path_tracer() {
    for name in ["cornell-spheres", "sky"] {
        let source = small(name, [16, 16]);
        let scene = source.build().expect("a good scene");
        // It keeps no variance: that of several pictures has to do.
        let pictures: Vec<Vec<[f32; 3]>> =
            (0..12).map(|seed| fifty_lines::render(&scene, 16, 16, 256, seed).rgb("").expect("colours")).collect();
        let moments = |i: usize, c: usize| -> Moments { pictures.iter().map(|p| f64::from(p[i][c])).collect() };
        let layer = |name: &str, f: &dyn Fn(Moments) -> f64| {
            let pixel = |i: usize| std::array::from_fn(|c| f(moments(i, c)) as f32);
            Layer::rgb(name, &(0..256).map(pixel).collect::<Vec<_>>())
        };
        let samples = Channel { name: "Y".into(), data: vec![12.0; 256] };
        let layers = vec![
            layer("", &|m| m.mean()),
            layer("variance", &|m| m.variance_of_mean()),
            Layer { name: "samples".into(), channels: vec![samples] },
        ];
        let short = Image { width: 16, height: 16, layers };
        let long = film(&source, "path", &independent(1, 3072)).develop();
        agree(&short, &long, LEVEL / 6.0, name);
    }
}

/// A floor and a small lamp over one end of it: the farther away, the fewer paths meet it, and for most pixels none has
/// when samples are first shared out.
fn rare_light() -> SceneSource {
    parse(
        r#"
        film = { width = 48, height = 48 }
        integrator = { type = "path", mode = "implicit", max_depth = 2 }
        [camera]
        type = "orthographic"
        to_world = [{ scale = 2 }, { look_at = { origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] } }]
        [[shapes]]
        type = "rectangle"
        to_world = { scale = 3 }
        material = { type = "diffuse", reflectance = 0.5 }
        [[shapes]]
        type = "sphere"
        center = [-1.7, 1.7, 0.5]
        radius = 0.1
        emission = 100
        "#,
    )
}

fn adaptive(
    source: &SceneSource,
    integrator: &IntegratorSettings,
    sampler: SamplerSettings,
    seed: u64,
    samples: u32,
    threads: usize,
) -> Film {
    let scene = source.build().expect("a good scene");
    let sampler = Sampler::new(sampler, seed);
    let integrator = integrator.integrator(&scene, sampler, Engine::Wavefront).expect("settings");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(samples), adaptive: true, ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, threads, &());
    film
}

/// Where samples go hangs on what they found, and the mean does not; neither where points are to fill each other's gaps.
#[test]
fn adaptive_sampling_is_unbiased() {
    let source = rare_light();
    let reference = film(&source, "path:max_depth=2", &independent(99, 4096));
    for sampler in [SamplerSettings::Independent {}, SamplerSettings::Sobol {}] {
        is_unbiased(&source, &reference, sampler);
    }
}

fn is_unbiased(source: &SceneSource, reference: &Film, sampler: SamplerSettings) {
    let integrator = source.description.integrator.clone();
    let films: Vec<Film> = (0..48).map(|seed| adaptive(source, &integrator, sampler, seed, 64, 2)).collect();
    let samples: Vec<u64> = films[0].pixels().iter().map(|p| p.samples()).collect();
    assert!(samples.iter().max() > samples.iter().min().map(|n| n * 4).as_ref(), "samples are not spread evenly");
    let total = samples.iter().sum::<u64>() as f64 / samples.len() as f64;
    assert!(total > 32.0 && total < 66.0, "{total} samples per pixel for 64");
    // Tile by tile: the mean over seeds against the reference, whose noise is small beside theirs.
    for tile in 0..9 {
        let pixels: Vec<usize> = (0..256).map(|i| (tile / 3 * 16 + i / 16) * 48 + tile % 3 * 16 + i % 16).collect();
        let mean = |f: &Film| pixels.iter().map(|i| f.pixels()[*i].mean()[1]).sum::<f64>() / 256.0;
        let means: Moments = films.iter().map(mean).collect();
        let p = means.p_value(mean(reference));
        assert!(p > LEVEL / 18.0, "tile {tile}: {means:?} for {}, p {p:.1e}", mean(reference));
    }
    if sampler != (SamplerSettings::Independent {}) {
        return;
    }
    // The error it states is the error it has.
    let stated: Moments = films
        .iter()
        .map(|f| {
            let errors = f.pixels().iter().zip(reference.pixels());
            errors.map(|(a, b)| (a.mean()[1] - b.mean()[1]).powi(2) - a.moments()[1].variance_of_mean()).sum()
        })
        .collect();
    let noise: f64 = reference.pixels().iter().map(|p| p.moments()[1].variance_of_mean()).sum();
    assert!(stated.p_value(noise) > LEVEL, "{stated:?} for {noise}");
}

#[test]
fn adaptive_sampling_helps_and_has_the_same_bits() {
    let source = small("veach-mis", [96, 64]);
    let integrator = settings("path:max_depth=2");
    let even = film(&source, "path:max_depth=2", &independent(1, 64));
    let film = adaptive(&source, &integrator, SamplerSettings::default(), 1, 64, 2);
    assert_eq!(film, adaptive(&source, &integrator, SamplerSettings::default(), 1, 64, 5));
    assert!(film.samples() <= even.samples());
    assert!(film.relative_error() < 0.9 * even.relative_error(), "{} {}", film.relative_error(), even.relative_error());
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let scene = small("point-lights", [4, 4]).build().expect("a good scene");
    let refused = |text: &str| {
        let settings: IntegratorSettings = from_settings(text).expect("settings").0;
        let sampler = Sampler::new(SamplerSettings::default(), 0);
        settings.integrator(&scene, sampler, Engine::Scalar).err().map(|e| e.message).unwrap_or_default()
    };
    for (text, part) in [
        ("path:roulette=none", "never end"),
        ("path:survival=1", "never end"),
        ("path:survival=0", "no probability"),
        ("path:mode=implicit", "points and beams"),
        ("recursive:branching=10,depth=12", "rays"),
        ("recursive:branching=1,depth=2000", "too deeply"),
    ] {
        assert!(refused(text).contains(part), "{text}: {}", refused(text));
    }
    for (text, part) in [("path:paths=LXE", "'X'"), ("path:paths=1", "2 to 1000"), ("path:paths=true", "expression")] {
        let error = from_settings::<IntegratorSettings>(text).expect_err(text);
        assert!(error.message.contains(part) && error.column() == Some(12), "{text}: {error:?}");
    }
}
