//! Photon mapping: photons are where theory has them, and what they show tends to what path tracing shows.

mod common;

use common::*;
use rebond::compare::Pair;
use rebond::film::Film;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, Integrator, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond_io::{SceneSource, from_settings};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Runs `f` with an integrator whose first sample was rendered, and its film.
fn with_maps(source: &SceneSource, text: &str, sampler: Sampler, f: impl FnOnce(&dyn Integrator, &Film)) {
    let scene = source.build().expect("a good scene");
    let settings = settings(text);
    let integrator = settings.integrator(&scene, sampler, Engine::default()).expect("settings that go together");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let mut film = Film::try_new(width, height, &settings.own_layers()).expect("memory");
    let budget = Budget { samples: Some(1), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, 2, &());
    f(&*integrator, &film);
}

fn count(integrator: &dyn Integrator, name: &str) -> f64 {
    integrator.counts().iter().find(|(n, _)| *n == name).map_or(0.0, |(_, n)| *n as f64)
}

fn furnace(albedo: &str) -> SceneSource {
    changed("furnace", &[("reflectance = 0.5", &format!("reflectance = {albedo}"))], [8, 8])
}

/// Light of flux π A leaves a furnace's wall, 1/(1−ρ) of that arrives at it. Photons survive with probability ρ, so all have the
/// power π A / N: their number is their flux.
#[test]
fn stored_flux_is_that_of_theory() {
    for (albedo, value) in [("0.5", 2.0), ("0.8", 5.0)] {
        let source = furnace(albedo);
        let mut ratios = Moments::default();
        for seed in 0..32 {
            let sampler = Sampler::new(SamplerSettings::Independent {}, seed);
            with_maps(&source, "photon:photons=5000,nearest=10", sampler, |integrator, _| {
                let of = |name| count(integrator, name);
                ratios.add(of("photons_stored") / of("photons_emitted"));
                assert_eq!([of("photons_emitted"), of("photons_lost"), of("photons_wasted")], [5000.0, 0.0, 0.0]);
            });
        }
        assert!(ratios.p_value(value) > LEVEL / 2.0, "{albedo}: {} for {value}", ratios.mean());
    }
}

/// On a sphere the points within a distance r have the area π r², curved as they are. Only light that grazes a neighbour and comes
/// from below the point's own horizon is missed, r²/8 of it. So a furnace is seen almost without bias, by every kernel, by neighbours
/// and by radius, directly, with a final gather and with irradiance that was computed before.
#[test]
fn furnaces_are_their_closed_form() {
    let ways = [
        "nearest=50",
        "nearest=50,kernel=cone",
        "nearest=0,radius=0.1,kernel=epanechnikov",
        "nearest=50,gather=4",
        "nearest=50,gather=4,caustic_photons=0,precompute=true",
        "progressive=true,radius=0.1",
        "nearest=50,max_depth=3",
    ];
    let source = furnace("0.5");
    for way in ways {
        let films = films(&source, &format!("photon:photons=4000,{way}"), 1, 4, &[]);
        let means: Moments = films.iter().map(|f| f.mean()[1]).collect();
        let value = if way.contains("max_depth") { 1.75 } else { 2.0 };
        let p = means.p_value(value);
        assert!(p > LEVEL / ways.len() as f64, "{way}: {} for {value}, p {p:.1e}", means.mean());
    }
}

/// In a cube that shines evenly photons lie evenly. A walk of two segments meets a wall at most once, so that those on it are
/// independent: χ² of their numbers in the pixels of a camera that faces it.
#[test]
fn photons_lie_evenly() {
    let source = parse(
        r#"
        film = { width = 20, height = 20 }
        camera = { type = "orthographic", to_world.look_at = { origin = [0, 0, -0.9], target = [0, 0, 1], up = [0, 1, 0] } }
        [[shapes]]
        type = "cube"
        flip_normals = true
        emission = 1
        material = { type = "diffuse", reflectance = 0.7 }
        "#,
    );
    let sampler = Sampler::new(SamplerSettings::Independent {}, 3);
    with_maps(&source, "photon:photons=60000,max_depth=2,show=true", sampler, |integrator, film| {
        // One in six lies on the wall; all have the same power, but for rounding.
        let counts: Vec<f64> = film.layer_values(0).map(|v| v.mean[1]).collect();
        counts.iter().for_each(|n| assert!((n - n.round()).abs() < 1e-3, "{n} photons"));
        let (total, cells) = (counts.iter().sum::<f64>(), counts.len() as f64);
        assert!((total / count(integrator, "photons_stored") * 6.0 - 1.0).abs() < 0.05, "{total}");
        let chi2: f64 = counts.iter().map(|n| (n - total / cells).powi(2) / (total / cells)).sum();
        let law = ChiSquared::new(cells - 1.0).expect("degrees of freedom");
        let p = law.sf(chi2).min(law.cdf(chi2));
        assert!(p > LEVEL / 2.0, "χ² {chi2} of {cells} cells, p {p:.1e}");
    });
}

/// An eye that sees no lights sees the photons behind one, and none on it.
#[test]
fn photons_show_behind_hidden_lights() {
    let shown = |hide: bool| {
        let source = parse(&format!(
            r#"
            hide_emitters = {hide}
            film = {{ width = 16, height = 16, filter = {{ type = "box" }} }}
            camera = {{ type = "orthographic", to_world.look_at = {{ origin = [0, 0, 4], target = [0, 0, 0], up = [0, 1, 0] }} }}
            [[shapes]]
            type = "rectangle"
            material = {{ type = "diffuse", reflectance = 0.5 }}
            [[shapes]]
            type = "rectangle"
            emission = 1
            to_world = [{{ scale = 0.5 }}, {{ translate = [0, 0, 1] }}]
            material = {{ type = "two-sided", front = {{ type = "diffuse", reflectance = 0.5 }} }}
            [[emitters]]
            type = "point"
            position = [0, 0, 3]
            intensity = 1
            [[emitters]]
            type = "point"
            position = [0, 0, 0.5]
            intensity = 1
            "#
        ));
        let mut light = [0.0; 2];
        with_maps(
            &source,
            "photon:photons=40000,max_depth=2,show=true",
            Sampler::new(Default::default(), 1),
            |_, film| {
                let layer = film.develop().rgb("photons").expect("a layer");
                // The middle, which the lamp covers, and the rest.
                for (i, value) in layer.iter().enumerate() {
                    let middle = (5..11).contains(&(i % 16)) && (5..11).contains(&(i / 16));
                    light[usize::from(!middle)] += f64::from(value[1]);
                }
            },
        );
        light
    };
    let ([seen, _], [hidden, around]) = (shown(false), shown(true));
    // On the lamp lie those of the point above; on the wall below it those of the point that hangs there, which shines on all of the
    // wall: fewer, but many.
    assert!(hidden > 0.2 * around && seen > 0.0 && (hidden / seen - 1.0).abs() > 0.05, "{seen}, {hidden}, {around}");
}

/// Light of one room is not looked up in the next, however far its photons are from there.
#[test]
fn a_dark_room_stays_dark() {
    let source = parse(
        r#"
        film = { width = 16, height = 16 }
        camera = { type = "perspective", fov = 70, to_world.look_at = { origin = [2.5, 0, 0.9], target = [2.5, 0, -1], up = [0, 1, 0] } }
        materials = { grey = { type = "diffuse", reflectance = 0.7 } }
        [[shapes]]
        type = "cube"
        flip_normals = true
        material = "grey"
        [[shapes]]
        type = "cube"
        flip_normals = true
        material = "grey"
        to_world = [{ translate = [2.5, 0, 0] }]
        [[shapes]]
        type = "sphere"
        radius = 0.2
        emission = 10
        "#,
    );
    for more in ["", ",precompute=true"] {
        let text = format!("photon:photons=20000,nearest=50,radius=0.1,gather=4{more}");
        let picture = pixels(&film(&source, &text, &Job::default()));
        assert!(picture.iter().flatten().all(|x| *x == 0.0), "{text}");
    }
}

fn pixels(film: &Film) -> Vec<[f32; 3]> {
    film.values().map(|v| v.mean.map(|x| x as f32)).collect()
}

/// The squared error against path tracing: with sixteen times the photons and four times as many in an estimate, both its variance
/// and its area fall to a quarter. The worst pixels, at the lamp's edge, are left out: their noise is that of the eye's rays.
#[test]
fn bias_and_noise_vanish() {
    let source = small("cornell-box", [24, 24]);
    let reference = pixels(&film(&source, "path", &Job { samples: 0..4096, ..Job::default() }));
    let error = |photons: u32, nearest: u32, more: &str| {
        let text = format!("photon:photons={photons},nearest={nearest}{more}");
        let picture = pixels(&film(&source, &text, &Job::default()));
        Pair::new(&reference, &picture, 24, 24).expect("pictures of one size").rel_mse(0.05)
    };
    let direct: Vec<f64> = [(4_000, 20), (64_000, 80), (1_024_000, 320)].map(|(p, k)| error(p, k, "")).to_vec();
    assert!(direct[1] < 0.5 * direct[0] && direct[2] < 0.5 * direct[1], "{direct:?}");
    // From afar the same map shows less of its errors.
    let gathered = error(64_000, 80, ",gather=16");
    assert!(gathered < 0.5 * direct[1], "{gathered} by a gather, {} directly", direct[1]);
}

/// A radius that is small against the scene shows path tracing's picture, mirrors, glass and caustics included.
#[test]
fn progressive_agrees_with_path() {
    let source = small("cornell-spheres", [16, 16]);
    let progressive = ("photon:progressive=true,photons=8000,radius=3,max_depth=6", 48);
    agree_on("cornell-spheres", &source, &[("path:max_depth=6", 128), progressive], 4.0);
    // Glossy surfaces find direct light by directions, too.
    let metal = "{ type = \"conductor\", metal = \"aluminium\", alpha = 0.2 }";
    let source = changed("cornell-spheres", &[("{ type = \"mirror\", reflectance = 0.95 }", metal)], [16, 16]);
    let progressive = ("photon:progressive=true,photons=8000,radius=3,max_depth=4", 32);
    agree_on("a ball of metal", &source, &[("path:max_depth=4", 128), progressive], 4.0);
}

/// So does a gather over a fine map.
#[test]
fn gather_agrees_with_path() {
    let source = small("cornell-spheres", [16, 16]);
    let gather = ("photon:photons=400000,nearest=30,gather=4,caustic_photons=100000,max_depth=6", 8);
    agree_on("cornell-spheres", &source, &[("path:max_depth=6", 128), gather], 2.0);
}

/// Same bits for any number of threads, in parts, and of a part of the picture.
#[test]
fn same_bits() {
    let source = small("cornell-spheres", [36, 20]);
    let scene = source.build().expect("a good scene");
    for text in [
        "photon:photons=3000,nearest=20,gather=2,caustic_photons=3000,precompute=true",
        "photon:photons=3000,nearest=20,show=true",
        "photon:photons=3000,progressive=true",
    ] {
        let settings = settings(text);
        let film = |region: Region, first: u32, samples: u32, threads: usize| {
            let sampler = Sampler::new(SamplerSettings::default(), 1);
            let integrator = settings.integrator(&scene, sampler, Engine::default()).expect("settings");
            let mut film = Film::try_new(region.width, region.height, &settings.own_layers()).expect("memory");
            let budget = Budget { samples: Some(samples), ..Budget::default() };
            render(&*integrator, &mut film, region, first, &budget, threads, &());
            film
        };
        let all = Region::whole(36, 20);
        let whole = film(all, 0, 5, 1);
        for threads in [2, 5] {
            assert!(film(all, 0, 5, threads) == whole, "{text}: {threads} threads");
        }
        let mut parts = film(all, 0, 2, 2);
        parts.merge(&film(all, 2, 3, 2));
        assert!(parts == whole, "{text}: in parts");
        let crop = film(Region { x: 7, y: 5, width: 20, height: 9, full_width: 36 }, 0, 5, 2);
        for (i, pixel) in crop.pixels().iter().enumerate() {
            assert!(*pixel == whole.pixels()[(i / 20 + 5) * 36 + i % 20 + 7], "{text}: a part, pixel {i}");
        }
    }
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let scene = small("cornell-box", [4, 4]).build().expect("a good scene");
    for (text, part) in [
        ("photon:nearest=0", "no end"),
        ("photon:nearest=1", "leaves nothing"),
        ("photon:progressive=true,radius=1e-30", "no area"),
        ("photon:radius=-1", "not above 0"),
        ("photon:progressive=true,alpha=1", "between 0 and 1"),
        ("photon:progressive=true,gather=8", "gather is a matter of one map"),
        ("photon:precompute=true", "for a final gather"),
        ("photon:gather=8,precompute=true,max_depth=4", "paths of every length"),
    ] {
        let sampler = Sampler::new(SamplerSettings::default(), 0);
        let settings = from_settings::<rebond::integrators::IntegratorSettings>(text).expect("settings").0;
        let refused = settings.integrator(&scene, sampler, Engine::default()).err().map(|e| e.message);
        assert!(refused.as_ref().is_some_and(|m| m.contains(part)), "{text}: {refused:?}");
    }
}
