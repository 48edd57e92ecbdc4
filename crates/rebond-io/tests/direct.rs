//! Ambient occlusion and direct light against closed forms, theory's variances, and each other.

mod common;

use common::*;
use glam::DVec3;
use rebond::film::Film;
use rebond::math::Moments;
use rebond::render::Engine;
use rebond::sampling::SamplerSettings;
use rebond::transport::irradiance::{from_polygon, from_sphere};
use rebond_io::{BUILT_IN_SCENES, SceneSource};

const LEVEL: f64 = 0.01;
const SEEDS: [u64; 3] = [1, 2, 3];
const AO: [&str; 3] = ["sphere", "hemisphere", "cosine"];

fn independent(seed: u64, samples: u32) -> Job {
    Job { seed, sampler: SamplerSettings::Independent {}, samples: 0..samples, ..Job::default() }
}

/// A camera over the origin of a floor z = 0, which sees so little of it that all pixels are one point; `more` stands
/// about it. The floor is small: how far its points are off, and so where rays start, goes by its size.
fn floor(more: &str) -> SceneSource {
    floor_of(r#"{ type = "diffuse", reflectance = 0.5 }"#, more)
}

/// The same of another material.
fn floor_of(material: &str, more: &str) -> SceneSource {
    parse(&format!(
        r#"
        film = {{ width = 24, height = 24 }}
        [camera]
        type = "orthographic"
        to_world = [{{ scale = 1e-5 }}, {{ look_at = {{ origin = [0, 0, 0.5], target = [0, 0, 0], up = [0, 1, 0] }} }}]
        [[shapes]]
        type = "rectangle"
        to_world = {{ scale = 1e-2 }}
        material = {material}
        {more}
        "#
    ))
}

/// A wall, as good as endless.
fn wall(axis: &str, at: f64) -> String {
    let (turn, place) = match axis {
        "x" => ("axis = [0, 1, 0]", format!("[{at}, 0, 0]")),
        _ => ("axis = [1, 0, 0]", format!("[0, {at}, 0]")),
    };
    format!(
        "[[shapes]]\ntype = \"rectangle\"\nto_world = [{{ scale = 1e3 }}, {{ rotate = {{ {turn}, angle = 90 }} }}, {{ translate = {place} }}]\n"
    )
}

/// A half-plane z = `h` over all x > `a`: it fills ½(1 − a/√(a² + h²)) of the projected hemisphere.
fn half_plane(a: f64, h: f64) -> String {
    format!(
        "[[shapes]]\ntype = \"rectangle\"\nto_world = [{{ scale = 1e3 }}, {{ translate = [{}, 0, {h}] }}]\n",
        a + 1e3
    )
}

#[test]
fn ambient_occlusion_is_its_closed_form() {
    let (a, h) = (0.3, 0.7);
    let cases = [
        ("an open plane", String::new(), 1.0),
        ("beside a wall", wall("x", -0.4), 0.5),
        ("in a corner", wall("x", -0.4) + &wall("y", 0.2), 0.25),
        ("under a half plane", half_plane(a, h), 1.0 - 0.5 * (1.0 - a / a.hypot(h))),
    ];
    for (what, more, expected) in cases {
        let source = floor(&more);
        for sampling in AO {
            for seed in SEEDS {
                let film = film(&source, &format!("ambient-occlusion:sampling={sampling}"), &independent(seed, 64));
                let (mean, p) = t_test(&film, expected);
                assert!(p > LEVEL / 36.0, "{what}, {sampling}: {mean} for {expected}, p {p:.1e}");
            }
        }
    }
}

/// A ceiling at distance 0.7 hides nothing from rays that end at 0.5.
#[test]
fn far_things_hide_nothing() {
    let source = floor(&half_plane(-1e3, 0.7));
    let mean = |settings: &str| film(&source, settings, &independent(1, 16)).mean()[1];
    assert_eq!(mean("ambient-occlusion"), 0.0);
    assert!((mean("ambient-occlusion:max_distance=0.5") - 1.0).abs() < 1e-6);
}

/// With V = 1 one sample has the variance E[X²] − 1: 8/3 − 1 over the sphere, 4/3 − 1 over the hemisphere, and 0.
#[test]
#[allow(clippy::print_stdout)] // the table is there to be read
fn variances_of_ambient_occlusion_are_those_of_theory() {
    println!("sampling      theory  measured");
    for (sampling, theory) in AO.into_iter().zip([5.0 / 3.0, 1.0 / 3.0, 0.0]) {
        for seed in SEEDS {
            let film = film(&floor(""), &format!("ambient-occlusion:sampling={sampling}"), &independent(seed, 256));
            let variances: Moments = film.pixels().iter().map(|p| p.variance()[1]).collect();
            println!("{sampling:12} {theory:7.4} {:9.4}", variances.mean());
            if theory == 0.0 {
                assert_eq!(variances.mean(), 0.0);
            } else {
                assert!(variances.p_value(theory) > LEVEL / 6.0, "{sampling}: {variances:?}");
            }
        }
    }
}

/// Surroundings of two colours, so that choosing between them shows.
const TWO_SKIES: &str = "[[emitters]]\ntype = \"constant\"\nradiance = [1, 0, 0]\n\
                         [[emitters]]\ntype = \"constant\"\nradiance = [0, 1, 1]\n";

const SAMPLINGS: [&str; 7] = ["area", "solid-angle", "light", "cosine", "bsdf", "mis", "product"];

/// A polygon and a sphere that nothing hides, by Lambert's formula and the sphere's, whichever way they are found.
#[test]
fn area_lights_are_their_closed_forms() {
    let panel = "[[shapes]]\ntype = \"rectangle\"\nemission = 3\nmaterial = { type = \"diffuse\", reflectance = 0 }\n\
                 to_world = [{ rotate = { axis = [1, 0, 0], angle = 180 } }, { scale = 0.1 }, { translate = [0.2, 0.05, 0.3] }]\n";
    let ball = "[[shapes]]\ntype = \"sphere\"\nemission = 3\nmaterial = { type = \"diffuse\", reflectance = 0 }\n\
                center = [0.25, -0.1, 0.3]\nradius = 0.15\n";
    let corners = [[0.1, -0.05], [0.3, -0.05], [0.3, 0.15], [0.1, 0.15]].map(|[x, y]| DVec3::new(x, y, 0.3));
    let of_panel = from_polygon(DVec3::ZERO, DVec3::Z, &corners);
    let of_ball = from_sphere(DVec3::ZERO, DVec3::Z, DVec3::new(0.25, -0.1, 0.3), 0.15);
    let brdf = 0.5 / std::f64::consts::PI;
    for (what, light, irradiance) in [("polygon", panel, of_panel), ("sphere", ball, of_ball)] {
        let (source, expected) = (floor(light), 3.0 * irradiance * brdf);
        for sampling in SAMPLINGS {
            for seed in SEEDS {
                let film = film(&source, &format!("direct:sampling={sampling}"), &independent(seed, 64));
                let (mean, p) = t_test(&film, expected);
                assert!(p > LEVEL / 42.0, "{what}, {sampling}: {mean} for {expected}, p {p:.1e}");
            }
        }
    }
}

/// A lamp that also reflects, under another one. On its own surface the choice among lamps looks at itself from no distance at all: the
/// probability that weights are made of must be that of the very same place.
#[test]
fn lamps_light_each_other() {
    let panel = "[[shapes]]\ntype = \"rectangle\"\nemission = 3\nmaterial = { type = \"diffuse\", reflectance = 0 }\n\
                 to_world = [{ rotate = { axis = [1, 0, 0], angle = 180 } }, { scale = 0.1 }, { translate = [0.2, 0.05, 0.3] }]\n";
    let corners = [[0.1, -0.05], [0.3, -0.05], [0.3, 0.15], [0.1, 0.15]].map(|[x, y]| DVec3::new(x, y, 0.3));
    let expected = 1.0 + 3.0 * from_polygon(DVec3::ZERO, DVec3::Z, &corners) * 0.5 / std::f64::consts::PI;
    let source = floor_of("{ type = \"diffuse\", reflectance = 0.5 }\nemission = 1", panel);
    let direct = SAMPLINGS.map(|sampling| format!("direct:sampling={sampling}"));
    let others =
        ["path:max_depth=2", "path:mode=explicit,max_depth=2", "recursive:depth=2", "bidirectional:max_depth=2"];
    for integrator in direct.into_iter().chain(others.map(String::from)) {
        for seed in SEEDS {
            let film = film(&source, &integrator, &independent(seed, 64));
            let (mean, p) = t_test(&film, expected);
            assert!(p > LEVEL / 33.0, "{integrator}: {mean} for {expected}, p {p:.1e}");
        }
    }
}

/// The lecture's formula of a Phong surface under a point light, I/d² ρ (r+1)/2π (ωo·R(ω))ʳ.
#[test]
fn a_point_light_on_phong_is_exact() {
    let lamp = "[[emitters]]\ntype = \"point\"\nposition = [0, 0.4, 0.3]\nintensity = 2\n";
    for r in [1, 8, 60] {
        let phong = format!(r#"{{ type = "phong", form = "lecture", exponent = {r}, reflectance = 0.5 }}"#);
        let mean = film(&floor_of(&phong, lamp), "direct:sampling=light", &independent(1, 4)).mean()[1];
        // From above, at 0.6 to the mirrored lamp. The power is taken in f32: its relative error grows with r.
        let expected = 2.0 / 0.25 * 0.5 * f64::from(r + 1) / (2.0 * std::f64::consts::PI) * 0.6_f64.powi(r);
        assert!((mean - expected).abs() < 1e-5 * f64::from(r) * expected, "r = {r}: {mean} for {expected}");
    }
}

/// Pixels in and near which no lamp shows: the noise of a lamp's edge is no matter of how light is sampled.
fn dark(source: &SceneSource) -> Vec<usize> {
    let lamps = film(source, "path:max_depth=1", &independent(7, 256));
    let (w, h) = (lamps.width() as usize, lamps.height() as usize);
    let near = |i: usize| {
        let (x, y) = (i % w, i / w);
        let rows = y.saturating_sub(2)..(y + 3).min(h);
        rows.flat_map(|y| (x.saturating_sub(2)..(x + 3).min(w)).map(move |x| y * w + x))
            .any(|i| lamps.pixels()[i].mean() != [0.0; 3])
    };
    (0..w * h).filter(|i| !near(*i)).collect()
}

/// For f ≥ 0, one sample of each of two kinds and the power heuristic, Σ wᵢ²/pᵢ = (p₁³ + p₂³)/(p₁² + p₂²)² ≤ 1/pᵢ for
/// both i, and Σ (∫ wᵢf)² ≥ μ²/2. So σ² ≤ σᵢ² + μ²/2 at each point, as Veach (1997, theorem 9.2) has it for the balance
/// heuristic. Over a pixel, E[μ²] is at most its squared mean and the variance of either kind together.
#[test]
#[allow(clippy::print_stdout)] // the table is there to be read
fn mis_is_within_its_bound() {
    for name in ["veach-mis", "many-lights", "sky"] {
        let source = small(name, [48, 32]);
        let dark = dark(&source);
        assert!(dark.len() > 1000, "{name}: {}", dark.len());
        let films: Vec<Film> = SAMPLINGS
            .iter()
            .zip(1..)
            .map(|(s, seed)| film(&source, &format!("direct:sampling={s}"), &independent(seed, 512)))
            .collect();
        let means: Vec<f64> = films[5].pixels().iter().map(|p| p.mean()[1].powi(2)).collect();
        let weighed = |of: &dyn Fn(usize) -> f64| {
            dark.iter().map(|i| of(*i) / (means[*i] + 0.01)).sum::<f64>() / dark.len() as f64
        };
        let variance = |k: usize| weighed(&|i| films[k].pixels()[i].variance()[1]);
        let variances: Vec<f64> = (0..SAMPLINGS.len()).map(variance).collect();
        let (light, bsdf, mis) = (variances[2], variances[4], variances[5]);
        let bound = |v: f64| v + 0.5 * (v + weighed(&|i| means[i]));
        println!("{name}: bound {:.3}", bound(light.min(bsdf)));
        SAMPLINGS.iter().zip(&variances).for_each(|(s, v)| println!("  {s:12} {v:10.4}"));
        assert!(mis <= bound(light.min(bsdf)), "{name}: {mis} by mis, {light} by light, {bsdf} by bsdf");
        if name == "veach-mis" {
            for (sampling, v) in SAMPLINGS.iter().zip(&variances) {
                assert!(mis <= *v, "{mis} by mis, {v} by {sampling}");
            }
        }
    }
}

/// Every sampling has one expectation: that of paths of at most two segments.
#[test]
fn samplings_agree() {
    // Small bright lights are met by one direction in ten thousand: few pixels, many samples. In plates as smooth as
    // Veach's, points of lights bring most light by so few of very large weight that no test of means can judge them.
    let veach = BUILT_IN_SCENES.iter().find(|b| b.name == "veach-mis").expect("built in").text;
    let rough = ["0.005", "0.02", "0.05"].iter().fold(veach.to_owned(), |text, alpha| {
        let from = format!("alpha = {alpha} ");
        assert!(text.contains(&from));
        text.replace(&from, "alpha = 0.1 ")
    });
    for (name, source, side, samples) in [
        ("rough veach-mis", parse(&rough), 16, 16384),
        ("sky", small("sky", [1, 1]), 16, 16384),
        ("many-lights", small("many-lights", [1, 1]), 16, 16384),
        ("cornell-spheres", small("cornell-spheres", [1, 1]), 48, 256),
        ("point-lights", small("point-lights", [1, 1]), 48, 256),
        ("two skies", floor(TWO_SKIES), 24, 1024),
    ] {
        let mut source = source;
        (source.description.film.width, source.description.film.height) = (side, side);
        let path = film(&source, "path:max_depth=2", &independent(99, samples)).develop();
        for (i, sampling) in SAMPLINGS.into_iter().enumerate() {
            let integrator = format!("direct:sampling={sampling}");
            let direct = film(&source, &integrator, &independent(i as u64 + 1, samples)).develop();
            agree(&direct, &path, LEVEL / (3.0 * 6.0 * 7.0), &format!("{name}, {sampling}"));
        }
    }
}

/// Veach's plates as they are, by the samplings that do not leave much to chance there.
#[test]
fn mis_agrees_on_smooth_plates() {
    let source = small("veach-mis", [32, 32]);
    let path = film(&source, "path:max_depth=2", &independent(1, 1024)).develop();
    agree(&film(&source, "direct", &independent(2, 1024)).develop(), &path, LEVEL / 3.0, "veach-mis");
}

/// smallpt's lamp is drawn from by the cap of it that shows; directions and points find the same light. Judged on open floor:
/// where light is rare, a few directions of large weight are too few for a test of means.
#[test]
fn a_sunken_lamp_is_found_either_way() {
    let mut source = small("smallpt", [48, 40]);
    let camera = "camera = { type = 'orthographic', to_world = [{ scale = 12 }, { look_at = { origin = [50, 40, 115], \
                  target = [50, 0, 115], up = [0, 0, 1] } }] }";
    source.description.camera = parse(camera).description.camera;
    let one = |sampling, seed| film(&source, &format!("direct:sampling={sampling}"), &independent(seed, 256)).develop();
    let reference = one("bsdf", 1);
    for (sampling, seed) in [("light", 2), ("mis", 3)] {
        agree(&one(sampling, seed), &reference, LEVEL / 6.0, sampling);
    }
}

#[test]
fn engines_agree_on_each_sampling() {
    let source = small("cornell-spheres", [32, 32]);
    for sampling in SAMPLINGS {
        let integrator = format!("direct:sampling={sampling}");
        let one = |engine, seed| film(&source, &integrator, &Job { engine, ..independent(seed, 64) }).develop();
        agree(&one(Engine::Scalar, 1), &one(Engine::Wavefront, 2), LEVEL / 21.0, sampling);
    }
}

/// The picture under all lights is the sum of those under each.
#[test]
fn light_is_linear() {
    let source = small("point-lights", [32, 32]);
    let lights = source.build().expect("a good scene").emitters().len();
    assert!(lights > 1);
    let whole = film(&source, "direct", &independent(1, 256));
    let parts: Vec<_> =
        (0..lights).map(|i| film(&source, &format!("direct:light={i}"), &independent(2 + i as u64, 256))).collect();
    // Over each row of pixels the differences have the mean 0.
    for row in 0..32 {
        for c in 0..3 {
            let difference = |i: usize| {
                let sum: f64 = parts.iter().map(|f| f.pixels()[i].mean()[c]).sum();
                sum - whole.pixels()[i].mean()[c]
            };
            let differences: Moments = (32 * row..32 * row + 32).map(difference).collect();
            assert!(differences.p_value(0.0) > LEVEL / 96.0, "row {row}, channel {c}: {differences:?}");
        }
    }
}

/// Without shadows a wall between light and floor is not there; its factors multiply to the whole under one point light.
#[test]
fn shadows_and_factors() {
    let lamp = "[[emitters]]\ntype = \"point\"\nposition = [0, 0.4, 0.3]\nintensity = 2\n";
    let board = "[[shapes]]\ntype = \"rectangle\"\nto_world = [{ scale = 0.05 }, { translate = [0, 0.2, 0.15] }]\n";
    let (open, shaded) = (floor(lamp), floor(&format!("{board}{lamp}")));
    let mean = |source: &SceneSource, settings: &str| film(source, settings, &independent(1, 4)).mean()[1];
    let d2 = 0.4 * 0.4 + 0.3 * 0.3;
    let (le, cos) = (2.0 / d2, 0.3 / f64::sqrt(d2));
    let close = |x: f64, y: f64| assert!((x - y).abs() < 1e-5 * y, "{x} for {y}");
    let brdf = 0.5 / std::f64::consts::PI;
    for sampling in SAMPLINGS {
        close(mean(&open, &format!("direct:sampling={sampling}")), le * brdf * cos);
        assert_eq!(mean(&shaded, &format!("direct:sampling={sampling}")), 0.0);
    }
    for sampling in ["area", "solid-angle", "light", "product"] {
        close(mean(&shaded, &format!("direct:sampling={sampling},shadows=false")), le * brdf * cos);
    }
    close(mean(&shaded, "direct:sampling=light,factor=le"), le);
    close(mean(&shaded, "direct:sampling=light,factor=bsdf"), brdf * cos);
    assert_eq!(mean(&shaded, "direct:sampling=light,factor=v"), 0.0);
    close(mean(&open, "direct:sampling=light,factor=v"), 1.0);
}
