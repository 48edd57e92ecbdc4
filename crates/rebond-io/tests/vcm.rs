//! Vertex connection and merging: it agrees with closed forms, with what it is made of, and with itself in another order.

mod common;

use common::*;
use rebond::film::Film;
use rebond::integrators::IntegratorSettings;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::from_settings;
use std::f64::consts::PI;

const LENS: &str = "type = \"thin-lens\"\naperture_radius = 60\nfocus_distance = 1000";

/// In a sphere every density per area is the same everywhere, and the points within r have the area π r²: so a furnace shows merging
/// almost without its bias, which is of order r² here, and is 1/(1−ρ) only if all weights add up to 1.
#[test]
fn furnaces_are_their_closed_form() {
    let modes = [
        "radius=0.1",
        "radius=0.03",
        "radius=0.1,heuristic=balance,rr_depth=1",
        "mode=merging,radius=0.04",
        "mode=merging,radius=0.04,heuristic=balance",
        "mode=photon,radius=0.1",
        "mode=bidirectional",
        "mode=light",
        "radius=0.1,max_depth=4",
    ];
    for (albedo, value) in [("0.5", 2.0_f64), ("0.8", 5.0)] {
        let source = changed("furnace", &[("reflectance = 0.5", &format!("reflectance = {albedo}"))], [16, 16]);
        for mode in modes {
            let cut = mode.contains("max_depth");
            let value = if cut { value * (1.0 - (1.0 - 1.0 / value).powi(4)) } else { value };
            let films = films(&source, &format!("vcm:{mode}"), 1, 32, &[]);
            let means: Moments = films.iter().map(|f| f.mean()[1]).collect();
            let p = means.p_value(value);
            assert!(p > LEVEL / 18.0, "{albedo}, {mode}: {} for {value}, p {p:.1e}", means.mean());
        }
    }
}

/// Mirrors, glass and caustics; and its special cases.
#[test]
fn mirror_and_glass() {
    let source = small("cornell-spheres", [16, 16]);
    let all = [
        ("bidirectional:max_depth=6", 128),
        ("vcm:max_depth=6,radius=8", 64),
        ("vcm:max_depth=6,radius=8,heuristic=balance", 64),
        ("vcm:max_depth=6,mode=bidirectional", 64),
        ("vcm:max_depth=6,mode=merging,radius=8", 128),
        ("vcm:max_depth=6,mode=photon,radius=8", 128),
        ("photon:progressive=true,photons=4000,radius=4,max_depth=6", 32),
    ];
    agree_on("cornell-spheres", &source, &all, 20.0);
}

/// Where there are neither mirrors nor glass, light tracing is all of it.
#[test]
fn diffuse_room() {
    let source = small("cornell-box", [16, 16]);
    let all = [
        ("light:max_depth=5", 128),
        ("vcm:max_depth=5,mode=light", 128),
        ("vcm:max_depth=5,mode=bidirectional", 32),
        ("vcm:max_depth=5,radius=10", 32),
        ("vcm:max_depth=5,mode=merging,radius=8", 128),
    ];
    agree_on("cornell-box", &source, &all, 20.0);
}

/// A point, a spot and a beam, through a lens, while a cube turns.
#[test]
fn lights_without_extent() {
    let source = small("point-lights", [16, 16]);
    let all = [
        ("bidirectional:max_depth=4", 128),
        ("vcm:max_depth=4", 128),
        ("vcm:max_depth=4,radius=0.05", 128),
        // The weights leave merging little here: by itself it shows.
        ("vcm:max_depth=4,mode=merging,radius=0.1", 1024),
    ];
    agree_on("point-lights", &source, &all, 20.0);
}

/// Beams from surfaces, some of which meet the lens.
#[test]
fn beams_of_some_width() {
    let source = beams("type = \"thin-lens\"\naperture_radius = 0.5\nfocus_distance = 5");
    let all = [
        ("path:max_depth=4", 128),
        ("vcm:max_depth=4,radius=0.03", 64),
        ("vcm:max_depth=4,mode=bidirectional", 64),
        ("photon:progressive=true,photons=4000,radius=0.02,max_depth=4", 64),
    ];
    agree_on("beams", &source, &all, 20.0);
}

/// The same beams on the floor alone, by merging alone. Merging blurs their edges, which lie within the picture or far beyond it: what
/// all pixels get together stays. (With the rest of the scene, a small radius has a few particles of the lens's neighbourhood bring most of
/// the light, and sixteen films do not show their own spread.)
#[test]
fn beams_merge_alone() {
    let mut source = beams("type = \"thin-lens\"\naperture_radius = 0.5\nfocus_distance = 5");
    source.description.shapes.truncate(1);
    source.description.emitters.pop();
    let films = |integrator: &str, seed, samples| films(&source, integrator, seed, samples, &[]);
    let path = films("path:max_depth=2", 1000, 64);
    for (i, radius) in [0.16, 0.08].into_iter().enumerate() {
        let merged = films(&format!("vcm:mode=merging,radius={radius}"), 100 * i as u64, 1024);
        let both = merged.iter().zip(&path);
        let difference: Moments = both.map(|(a, b)| a.mean()[1] / b.mean()[1] - 1.0).collect();
        let p = difference.p_value(0.0);
        assert!(p > LEVEL / 2.0, "radius {radius}: {} too much, p {p:.1e}", difference.mean());
    }
}

/// Parallel rays, an image of the sky, rough metal, instances.
#[test]
fn sky() {
    let source = changed("sky", &[("{ scale = 30 }", "{ scale = 3 }")], [24, 16]);
    let all =
        [("bidirectional:max_depth=4", 64), ("vcm:max_depth=4", 64), ("vcm:max_depth=4,mode=merging,radius=0.15", 128)];
    agree_on("sky", &source, &all, 20.0);
}

/// Light that crosses the lens.
#[test]
fn through_a_lens() {
    let source = changed("cornell-spheres", &[("type = \"perspective\"", LENS)], [16, 16]);
    let all =
        [("bidirectional:max_depth=5", 64), ("vcm:max_depth=5,radius=8", 64), ("vcm:max_depth=5,mode=light", 512)];
    agree_on("lens", &source, &all, 20.0);
}

/// Photons count flux through the surface as it is; the surface reflects as it is shaded.
#[test]
fn shading_normals() {
    for material in [
        "{ type = \"diffuse\", reflectance = 0.8 }",
        "{ type = \"dielectric\", int_ior = 1.5, alpha = 0.4 }",
        "{ type = \"plastic\", diffuse_reflectance = 0.6, alpha = 0.3 }",
    ] {
        let source = coarse_ball(material);
        let all = [
            ("bidirectional:max_depth=4", 64),
            ("vcm:max_depth=4,radius=0.05", 64),
            ("vcm:max_depth=4,mode=merging,radius=0.03", 256),
        ];
        agree_on(material, &source, &all, 60.0);
    }
}

/// Same bits for any number of threads, and in parts.
#[test]
fn same_bits() {
    let lens = changed("cornell-spheres", &[("type = \"perspective\"", LENS)], [40, 24]);
    // Of more tiles than a band has.
    let bands = small("cornell-spheres", [1, 16 * 1030]);
    let modes = ["vcm:radius=10", "vcm:mode=merging,radius=10", "vcm:mode=light"];
    for (source, text) in modes.map(|text| (&lens, text)).into_iter().chain([(&bands, "vcm:radius=10,max_depth=5")]) {
        let scene = source.build().expect("a good scene");
        let [width, height] = [source.description.film.width, source.description.film.height];
        let film = |first: u32, samples: u32, threads: usize| {
            let sampler = Sampler::new(SamplerSettings::default(), 1);
            let integrator = settings(text).integrator(&scene, sampler, Engine::default());
            let integrator = integrator.expect("settings that go together");
            let mut film = Film::new(width, height);
            let budget = Budget { samples: Some(samples), ..Budget::default() };
            render(&*integrator, &mut film, Region::whole(width, height), first, &budget, threads, &());
            film
        };
        let whole = film(0, 9, 1);
        for threads in [2, 5] {
            assert!(film(0, 9, threads) == whole, "{text}: {threads} threads");
        }
        // Both where weights change and where they do not.
        let mut parts = film(0, 3, 2);
        parts.merge(&film(3, 1, 2));
        parts.merge(&film(4, 5, 2));
        assert!(parts == whole, "{text}: in parts");
    }
}

/// A point shines on a square below, a sixth of all directions; a mirror above shows it the square at three times the distance. All
/// other walks are lost. The eye looks at each sixteenth of the square's side once a sample, anywhere within it: particles within the
/// disks around these points are merged with, the rest is wasted.
#[test]
fn lost_walks_and_wasted_particles() {
    let source = parse(
        r#"
        film = { width = 16, height = 16, filter = { type = "box" } }
        camera = { type = "orthographic", to_world.look_at = { origin = [0, 0, 0.5], target = [0, 0, -1], up = [0, 1, 0] } }
        sampler = { type = "independent" }
        [[shapes]]
        type = "rectangle"
        to_world = [{ translate = [0, 0, -1] }]
        material = { type = "diffuse", reflectance = 0.5 }
        [[shapes]]
        type = "rectangle"
        to_world = [{ rotate = { axis = [1, 0, 0], angle = 180 } }, { translate = [0, 0, 1] }]
        material = { type = "mirror", reflectance = 1 }
        [[emitters]]
        type = "point"
        position = [0, 0, 0]
        intensity = 1
        "#,
    );
    let scene = source.build().expect("a good scene");
    let counts = |text: &str, seed: u64| {
        let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
        let integrator = settings(text).integrator(&scene, sampler, Engine::default()).expect("settings");
        let (mut film, budget) = (Film::new(16, 16), Budget { samples: Some(16), ..Budget::default() });
        render(&*integrator, &mut film, Region::whole(16, 16), 0, &budget, 2, &());
        let counts = integrator.counts();
        ["light_walks", "light_walks_lost", "particles_stored", "particles_wasted"]
            .map(|name| counts.iter().find(|(n, _)| *n == name).map_or(0.0, |(_, n)| *n as f64))
    };
    // Of the sphere of directions, a square of half side 1 at distance d covers asin(1 / (1 + d²)) / π.
    let square = |d: f64| (1.0 / (1.0 + d * d)).asin() / PI;
    let (mut lost, mut merged) = (Moments::default(), Moments::default());
    for seed in 0..32 {
        let [all, gone, stored, wasted] = counts("vcm:mode=photon,radius=0.0125,alpha=0.999999", seed);
        lost.add(gone / all);
        merged.add((stored - wasted) / stored);
    }
    for (found, expected, what) in
        [(lost, 1.0 - square(1.0) - square(3.0), "lost"), (merged, PI * 0.1_f64.powi(2), "merged")]
    {
        assert!(found.p_value(expected) > LEVEL / 2.0, "{what}: {} for {expected}", found.mean());
    }
    // From anywhere all are near by.
    let [.., stored, wasted] = counts("vcm:radius=9,alpha=0.999999", 1);
    assert!(stored > 0.0 && wasted == 0.0, "{wasted} of {stored}");
}

/// A pixel's own variance is what the film says it is. In the furnace hardly anything but particles varies: two samples that were
/// merged with the same ones would show there.
#[test]
fn variances_are_known() {
    for (name, text, samples) in [
        ("cornell-box", "vcm:max_depth=3", 16),
        ("cornell-box", "vcm:mode=photon,max_depth=3", 16),
        ("cornell-box", "photon:progressive=true,photons=64,max_depth=3", 16),
        ("furnace", "vcm:mode=photon,radius=0.5", 4),
        ("furnace", "photon:progressive=true,photons=64,radius=0.5", 4),
    ] {
        let scene = small(name, [8, 8]).build().expect("a good scene");
        let (mut stated, mut means) = ([Moments::default(); 64], [Moments::default(); 64]);
        for seed in 0..400 {
            let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
            let integrator = settings(text).integrator(&scene, sampler, Engine::default()).expect("settings");
            let (mut film, budget) = (Film::new(8, 8), Budget { samples: Some(samples), ..Budget::default() });
            render(&*integrator, &mut film, Region::whole(8, 8), 0, &budget, 2, &());
            for ((value, stated), mean) in film.values().zip(&mut stated).zip(&mut means) {
                stated.add(value.variance[1]);
                mean.add(value.mean[1]);
            }
        }
        let ratio = stated.iter().map(Moments::mean).sum::<f64>() / means.iter().map(Moments::variance).sum::<f64>();
        assert!((ratio - 1.0).abs() < 0.1, "{name}, {text}: {ratio} of the variance");
    }
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let scene = small("cornell-box", [4, 4]).build().expect("a good scene");
    for (text, part) in
        [("vcm:radius=0", "not above 0"), ("vcm:alpha=0", "between 0 and 1"), ("vcm:roulette=none", "never end")]
    {
        let settings: IntegratorSettings = from_settings(text).expect("settings").0;
        let sampler = Sampler::new(SamplerSettings::default(), 0);
        let refused = settings.integrator(&scene, sampler, Engine::default()).err().map(|e| e.message);
        assert!(refused.as_ref().is_some_and(|m| m.contains(part)), "{text}: {refused:?}");
    }
}
