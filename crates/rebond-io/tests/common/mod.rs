//! What tests of renders share. Not every file uses all of it.
#![allow(dead_code)]

use rebond::compare::{Estimate, welch};
use rebond::film::{Channel, Film, Image, Layer};
use rebond::integrators::IntegratorSettings;
use rebond::math::Moments;
use rebond::render::{Budget, Engine, PathLayer, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond::scene::SceneDescription;
use rebond::scene::description::{Color, MaterialDescription, MaterialRef, Metal, NumberTexture, ShapeDescription};
use rebond_io::{BUILT_IN_SCENES, SceneFiles, SceneSource, from_settings};
use std::collections::BTreeMap;

pub fn settings(text: &str) -> IntegratorSettings {
    from_settings(text).expect("settings").0
}

pub fn parse(text: &str) -> SceneSource {
    SceneSource::parse(text, "test.toml", "test", SceneFiles::BuiltIn).expect("a scene")
}

pub fn small(name: &str, size: [u32; 2]) -> SceneSource {
    let mut source = SceneSource::open(name).expect("a built-in scene");
    (source.description.film.width, source.description.film.height) = (size[0], size[1]);
    source
}

pub struct Job {
    pub engine: Engine,
    pub sampler: SamplerSettings,
    pub seed: u64,
    pub samples: std::ops::Range<u32>,
    pub threads: usize,
}

impl Default for Job {
    fn default() -> Self {
        let (engine, sampler) = (Engine::Wavefront, SamplerSettings::default());
        Self { engine, sampler, seed: 1, samples: 0..16, threads: 2 }
    }
}

pub fn film(source: &SceneSource, integrator: &str, job: &Job) -> Film {
    let scene = source.build().expect("a good scene");
    let integrator = settings(integrator).integrator(&scene, Sampler::new(job.sampler, job.seed), job.engine);
    let integrator = integrator.expect("settings that go together");
    let [width, height] = [source.description.film.width, source.description.film.height];
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(job.samples.len() as u32), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), job.samples.start, &budget, job.threads, &());
    assert_eq!(film.dropped_samples(), 0);
    film
}

struct Channels {
    mean: Vec<f32>,
    variance: Vec<f32>,
    samples: Vec<f32>,
}

fn channel(image: &Image, c: usize) -> Channels {
    let data = |layer: &str, c: usize| image.layer(layer).expect("a layer").channels[c].data.clone();
    Channels { mean: data("", c), variance: data("variance", c), samples: data("samples", 0) }
}

/// Whether two pictures have one expectation: Welch's test of blocks of pixels, each channel at `level`.
pub fn judge(a: &Image, b: &Image, block: u32, level: f64) -> Result<(), String> {
    for c in 0..3 {
        let (x, y) = (channel(a, c), channel(b, c));
        let first = Estimate { mean: &x.mean, variance: &x.variance, samples: &x.samples };
        let second = Estimate { mean: &y.mean, variance: &y.variance, samples: &y.samples };
        let w = welch(first, second, a.width, a.height, block, level).expect("a test");
        assert!(w.tested > 0);
        if !w.passes() {
            return Err(format!("channel {c}: {} of {} blocks, p {}", w.significant, w.tested, w.below_alpha_p));
        }
    }
    Ok(())
}

/// They have, in blocks of 8 × 8.
pub fn agree(a: &Image, b: &Image, level: f64, what: &str) {
    judge(a, b, 8, level).unwrap_or_else(|e| panic!("{what}, {e}"));
}

/// The mean of a picture's green, and the two-sided chance of one this far from `expected`. Pixels are independent:
/// their samples hang on their numbers.
pub fn t_test(film: &Film, expected: f64) -> (f64, f64) {
    let moments: Moments = film.pixels().iter().map(|p| p.mean()[1]).collect();
    // Where every pixel is the same number but for f32's rounding there is no noise to judge by.
    let exact = (moments.mean() - expected).abs() <= 1e-6 * expected;
    (moments.mean(), if exact { 1.0 } else { moments.p_value(expected) })
}

/// Significance of a test.
pub const LEVEL: f64 = 0.01;
/// Films of other seeds, by whose spread one is judged.
pub const FILMS: u64 = 16;
/// Side of a block in pixels.
pub const BLOCK: usize = 4;

/// The means of blocks of one sheet of a film (0: the picture), row by row.
pub fn blocks(film: &Film, sheet: usize) -> Vec<[f64; 3]> {
    let values: Vec<[f64; 3]> = if sheet == 0 {
        film.values().map(|v| v.mean).collect()
    } else {
        film.layer_values(sheet - 1).map(|v| v.mean).collect()
    };
    let (columns, rows) = (film.width() as usize / BLOCK, film.height() as usize / BLOCK);
    let mean = |b: usize| {
        let (left, top) = (b % columns * BLOCK, b / columns * BLOCK);
        let pixels = (0..BLOCK * BLOCK).map(|i| values[(top + i / BLOCK) * columns * BLOCK + left + i % BLOCK]);
        pixels.fold([0.0; 3], |sum, p| std::array::from_fn(|c| sum[c] + p[c] / (BLOCK * BLOCK) as f64))
    };
    (0..columns * rows).map(mean).collect()
}

/// An image of blocks, of which the spread over films is known: splats tie the pixels of one film together.
pub fn image_of(films: &[Vec<[f64; 3]>], columns: usize) -> Image {
    let moments = |b: usize, c: usize| -> Moments { films.iter().map(|f| f[b][c]).collect() };
    let n = films[0].len();
    let layer = |name: &str, f: &dyn Fn(Moments) -> f64| {
        let block = |b: usize| std::array::from_fn(|c| f(moments(b, c)) as f32);
        Layer::rgb(name, &(0..n).map(block).collect::<Vec<_>>())
    };
    let samples = Channel { name: "Y".into(), data: vec![films.len() as f32; n] };
    let layers = vec![
        layer("", &|m| m.mean()),
        layer("variance", &|m| m.variance_of_mean()),
        Layer { name: "samples".into(), channels: vec![samples] },
    ];
    Image { width: columns as u32, height: (n / columns) as u32, layers }
}

/// Films of other seeds.
pub fn films(source: &SceneSource, integrator: &str, first_seed: u64, samples: u32, layers: &[PathLayer]) -> Vec<Film> {
    let scene = source.build().expect("a good scene");
    let settings = settings(integrator);
    let [width, height] = [source.description.film.width, source.description.film.height];
    let names: Vec<String> = layers.iter().map(|l| l.name.clone()).chain(settings.own_layers()).collect();
    let film = |seed: u64| {
        let sampler = Sampler::new(SamplerSettings::default(), first_seed + seed);
        let integrator = settings
            .layered_integrator(&scene, sampler, Job::default().engine, layers)
            .expect("settings that go together");
        let mut film = Film::try_new(width, height, &names).expect("memory");
        let budget = Budget { samples: Some(samples), ..Budget::default() };
        render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, 2, &());
        assert_eq!(film.dropped_samples(), 0);
        film
    };
    (0..FILMS).map(film).collect()
}

pub fn picture(source: &SceneSource, integrator: &str, first_seed: u64, samples: u32) -> Image {
    let films: Vec<_> = films(source, integrator, first_seed, samples, &[]).iter().map(|f| blocks(f, 0)).collect();
    image_of(&films, source.description.film.width as usize / BLOCK)
}

pub fn built_in(name: &str) -> String {
    BUILT_IN_SCENES.iter().find(|b| b.name == name).expect("built in").text.to_owned()
}

pub fn changed(name: &str, changes: &[(&str, &str)], size: [u32; 2]) -> SceneSource {
    let text = changes.iter().fold(built_in(name), |text, (from, to)| {
        assert!(text.contains(from), "{from} is in {name}");
        text.replace(from, to)
    });
    let mut source = parse(&text);
    (source.description.film.width, source.description.film.height) = (size[0], size[1]);
    source
}

/// Whether integrators agree with the first of them on a scene.
pub fn agree_on(name: &str, source: &SceneSource, integrators: &[(&str, u32)], tests: f64) {
    let (first, samples) = integrators[0];
    let reference = picture(source, first, 1000, samples);
    for (i, (integrator, samples)) in integrators[1..].iter().enumerate() {
        let other = picture(source, integrator, 100 * i as u64, *samples);
        judge(&other, &reference, 1, LEVEL / (3.0 * tests)).unwrap_or_else(|e| panic!("{name}, {integrator}, {e}"));
    }
}

/// Beams of some width on a floor, a glossy ball and a mirror, one of them towards the camera, a lamp and a point.
pub fn beams(camera: &str) -> SceneSource {
    parse(&format!(
        r#"
        film = {{ width = 16, height = 16 }}
        [camera]
        {camera}
        fov = 50
        to_world.look_at = {{ origin = [0, -4, 3], target = [0, 0, 0.3], up = [0, 0, 1] }}
        [[shapes]]
        type = "rectangle"
        to_world = {{ scale = 4 }}
        material = {{ type = "diffuse", reflectance = 0.5 }}
        [[shapes]]
        type = "sphere"
        center = [0.3, 0.2, 0.5]
        radius = 0.5
        material = {{ type = "conductor", metal = "copper", alpha = 0.3 }}
        [[shapes]]
        type = "rectangle"
        material = {{ type = "diffuse", reflectance = 0.3 }}
        to_world = [{{ scale = [0.6, 0.4, 1] }}, {{ rotate = {{ axis = [1, 1, 0], angle = 160 }} }}, {{ translate = [-0.6, 0, 2] }}]
        [[shapes]]
        type = "disk"
        emission = [0.5, 0.7, 1]
        to_world = [{{ scale = 0.3 }}, {{ rotate = {{ axis = [0, 1, 0], angle = 120 }} }}, {{ translate = [-1.5, 0, 1] }}]
        [[emitters]]
        type = "directional-area"
        irradiance = [4, 3, 2]
        to_world = [{{ scale = [0.6, 0.4, 1] }}, {{ rotate = {{ axis = [1, 1, 0], angle = 160 }} }}, {{ translate = [-0.6, 0, 2] }}]
        [[emitters]]
        type = "directional-area"
        shape = "disk"
        irradiance = [2, 4, 6]
        to_world = [{{ scale = [-0.9, 0.5, 1] }}, {{ rotate = {{ axis = [1, 0, 0.2], angle = 170 }} }}, {{ translate = [0.9, 0.4, 2.5] }}]
        [[emitters]]
        type = "directional-area"
        irradiance = 5
        to_world = [{{ scale = 0.8 }}, {{ look_at = {{ origin = [-1.5, 1.5, 0.6], target = [0, -4, 3], up = [0, 0, 1] }} }}]
        [[emitters]]
        type = "point"
        position = [0.2, -1, 1.8]
        intensity = 0.5
        "#
    ))
}

/// A coarse ball with the normals of a sphere, in light from everywhere.
pub fn coarse_ball(material: &str) -> SceneSource {
    let (rings, sides) = (5, 7);
    let (mut positions, mut normals, mut faces) = (String::new(), String::new(), String::new());
    for ring in 0..=rings {
        for side in 0..sides {
            let (theta, phi) = (
                std::f64::consts::PI * f64::from(ring) / f64::from(rings),
                std::f64::consts::TAU * f64::from(side) / f64::from(sides),
            );
            let n = [theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()];
            positions += &format!("[{}, {}, {}],", n[0], n[1], n[2]);
            normals += &format!("[{}, {}, {}],", n[0], n[1], n[2]);
            if ring < rings {
                let (a, b) = (ring * sides + side, ring * sides + (side + 1) % sides);
                faces += &format!("[{a}, {b}, {}, {}],", b + sides, a + sides);
            }
        }
    }
    parse(&format!(
        r#"
        film = {{ width = 16, height = 16 }}
        [camera]
        type = "perspective"
        fov = 50
        to_world.look_at = {{ origin = [0.5, 0.8, 2.8], target = [0, 0, 0], up = [0, 1, 0] }}
        [[shapes]]
        type = "mesh"
        positions = [{positions}]
        normals = [{normals}]
        faces = [{faces}]
        material = {material}
        [[shapes]]
        type = "rectangle"
        to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = -90 }} }}, {{ scale = 2.5 }}, {{ translate = [0, -1, 0] }}]
        material = {{ type = "diffuse", reflectance = 0.7 }}
        [[emitters]]
        type = "constant"
        radiance = 1
        "#
    ))
}

/// The numbers of all that a scene's shapes are made of, by kind; images and attributes stand for themselves.
pub fn numbers_of_materials(scene: &SceneDescription) -> BTreeMap<String, Vec<Vec<f64>>> {
    use ShapeDescription as S;
    let mut found: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    for shape in scene.shapes.iter().chain(scene.groups.values().flatten()) {
        let material = match shape {
            S::Obj(s) | S::Ply(s) => &s.material,
            S::Mesh(s) => &s.material,
            S::Sphere(s) => &s.material,
            S::Rectangle(s) | S::Disk(s) | S::Cube(s) => &s.material,
            S::Instance(_) => continue,
        };
        material.iter().for_each(|m| numbers_of(scene, m, &mut found));
    }
    found
}

fn numbers_of(scene: &SceneDescription, material: &MaterialRef, found: &mut BTreeMap<String, Vec<Vec<f64>>>) {
    use MaterialDescription as M;
    let mut description = match material {
        MaterialRef::Named(name) => scene.materials[name].clone(),
        MaterialRef::Inline(m) => (**m).clone(),
    };
    match &mut description {
        M::TwoSided { front, back } => {
            return std::iter::once(&*front).chain(&*back).for_each(|m| numbers_of(scene, m, found));
        }
        M::NormalMap { material, .. }
        | M::BumpMap { material, .. }
        | M::Mask { material, .. }
        | M::Glow { material, .. } => return numbers_of(scene, material, found),
        M::Mix { a, b, weight } => {
            found.entry("mix".into()).or_default().push(vec![f64::from(*weight)]);
            return [a, b].into_iter().for_each(|m| numbers_of(scene, m, found));
        }
        M::Conductor { metal, eta, k, alpha, alpha_u, alpha_v, .. } => {
            let (n, kappa) = match metal.take() {
                Some(Metal::Silver) => ([0.155, 0.117, 0.138], [4.828, 3.122, 2.147]),
                Some(Metal::Aluminium) => ([1.657, 0.880, 0.521], [9.224, 6.270, 4.837]),
                Some(Metal::Gold) => ([0.143, 0.375, 1.442], [3.983, 2.386, 1.603]),
                Some(Metal::Copper) => ([0.200, 0.924, 1.102], [3.912, 2.452, 2.142]),
                None => (eta.expect("an index").0, k.expect("an index").0),
            };
            (*eta, *k) = (Some(Color(n)), Some(Color(kappa)));
            both_ways(alpha, alpha_u, alpha_v);
        }
        M::Dielectric { alpha, alpha_u, alpha_v, .. } => both_ways(alpha, alpha_u, alpha_v),
        // A coat that is not there has no roughness.
        M::Principled { clearcoat: 0.0, clearcoat_roughness, .. } => *clearcoat_roughness = 0.0,
        _ => {}
    }
    let value = serde_json::to_value(&description).expect("a value");
    let (kind, fields) = value.as_object().and_then(|o| o.iter().next()).expect("a kind");
    let mut numbers = Vec::new();
    flatten(fields, &mut numbers);
    found.entry(kind.clone()).or_default().push(numbers);
}

/// A roughness along both tangents.
fn both_ways(alpha: &mut Option<NumberTexture>, along: &mut Option<NumberTexture>, across: &mut Option<NumberTexture>) {
    if alpha.as_ref().is_some_and(|alpha| alpha.constant().is_none()) {
        return;
    }
    let alpha = alpha.take().unwrap_or(0.0.into());
    along.get_or_insert_with(|| alpha.clone());
    across.get_or_insert(alpha);
}

fn flatten(value: &serde_json::Value, numbers: &mut Vec<f64>) {
    match value {
        serde_json::Value::Number(x) => numbers.extend(x.as_f64()),
        serde_json::Value::Array(list) => list.iter().for_each(|v| flatten(v, numbers)),
        serde_json::Value::Object(o) if !o.contains_key("image") && !o.contains_key("attribute") => {
            o.values().for_each(|v| flatten(v, numbers))
        }
        _ => {}
    }
}

/// Whether the shapes of two scenes are made of the same: each material of one is there in the other, where that has any of its kind.
pub fn same_materials(a: &SceneDescription, b: &SceneDescription) -> Result<(), String> {
    let (a, b) = (numbers_of_materials(a), numbers_of_materials(b));
    let near = |kind: &str, x: &Vec<f64>, y: &Vec<f64>| {
        // Metals are given by three digits; spectra are sums over wavelengths, by which an even 0.4 comes to 0.3996. What is inside
        // and what outside change places with a shape's side.
        let within = match kind {
            "conductor" => 2e-3,
            "diffuse" => 5e-4,
            _ => 1e-5,
        };
        let ordered = |x: &Vec<f64>| {
            let mut x = x.clone();
            if kind == "dielectric" {
                x.sort_by(f64::total_cmp);
            }
            x
        };
        // Of an image nothing is known here.
        let unknown = x.is_empty() || y.is_empty();
        let close = |(x, y): (f64, f64)| (x - y).abs() <= within * x.abs().max(1.0);
        unknown || (x.len() == y.len() && ordered(x).into_iter().zip(ordered(y)).all(close))
    };
    let shared = a.keys().filter(|kind| b.contains_key(*kind)).collect::<Vec<_>>();
    for kind in &shared {
        for (these, those) in [(&a[*kind], &b[*kind]), (&b[*kind], &a[*kind])] {
            if let Some(odd) = these.iter().find(|x| !those.iter().any(|y| near(kind, x, y))) {
                return Err(format!("{kind} {odd:?} is none of {those:?}"));
            }
        }
    }
    if shared.is_empty() { Err(format!("{a:?} and {b:?} share no kind")) } else { Ok(()) }
}
