//! Holes and relief: renders whose answer is known.

use rebond::bsdf::TransportMode;
use rebond::bsdf::check::Angles;
use rebond::film::{Film, Image};
use rebond::integrators::IntegratorSettings;
use rebond::render::{Budget, Engine, Region, render};
use rebond::sampling::{Sampler, SamplerSettings};
use rebond::scene::description::MaterialRef;
use rebond::scene::{MeshSource, Resources, Scene, SceneDescription, build};
use rebond::shape::MeshData;
use rebond::texture::Encoding;
use rebond_io::from_toml;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::f64::consts::PI;

/// Images by name: `holes` is a quarter opaque in squares, `tilted` leans by 30° along u, `ramp` rises by 1 along u.
struct Images;

impl Resources for Images {
    fn mesh(&self, file: &str, _: MeshSource) -> Result<MeshData, String> {
        Err(format!("no mesh {file}"))
    }

    fn image(&self, file: &str, encoding: Encoding) -> Result<Image, String> {
        assert_eq!(encoding, Encoding::Linear, "these numbers are no colours");
        let texels: Vec<[f32; 3]> = match file {
            "holes" => (0..64).map(|i| [f32::from(u8::from(i % 2 == 0 && i / 8 % 2 == 0)); 3]).collect(),
            "tilted" => vec![[0.5 + 0.25, 0.5, 0.5 + 0.5 * 0.75_f32.sqrt()]; 64],
            "ramp" => (0..64).map(|i| [((i % 8) as f32 + 0.5) / 8.0; 3]).collect(),
            _ => return Err(format!("no image {file}")),
        };
        Ok(Image::from_rgb(8, 8, &texels))
    }
}

fn scene(text: &str) -> (Scene, [u32; 2]) {
    let (description, _): (SceneDescription, _) = from_toml(text, "test.toml").expect("a scene");
    let size = [description.film.width, description.film.height];
    (build(&description, &Images).expect("a good scene"), size)
}

fn film(text: &str, engine: Engine, samples: u32) -> Film {
    let (scene, [width, height]) = scene(text);
    let integrator = IntegratorSettings::default()
        .integrator(&scene, Sampler::new(SamplerSettings::Independent {}, 5), engine)
        .expect("settings");
    let mut film = Film::new(width, height);
    let budget = Budget { samples: Some(samples), ..Budget::default() };
    render(&*integrator, &mut film, Region::whole(width, height), 0, &budget, 1, &());
    assert_eq!(film.dropped_samples(), 0);
    film
}

/// Whether the mean of all pixels may be `expected`, at 0.1 %.
fn may_be(text: &str, expected: f64) {
    for engine in [Engine::Wavefront, Engine::Scalar] {
        let values: Vec<f64> = film(text, engine, 64).pixels().iter().map(|p| p.mean()[1]).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        assert!(variance > 0.0, "chance decides");
        let t = (mean - expected) / (variance / n).sqrt();
        let p = 2.0 * StudentsT::new(0.0, 1.0, n - 1.0).expect("degrees").sf(t.abs());
        assert!(p > 1e-3, "{mean} for {expected}, p = {p:.1e}\n{text}");
    }
}

/// Whether every pixel is `expected` but for rounding.
fn is(text: &str, expected: f64) {
    for engine in [Engine::Wavefront, Engine::Scalar] {
        for pixel in film(text, engine, 4).pixels() {
            let mean = pixel.mean()[1];
            assert!((mean / expected - 1.0).abs() < 1e-4, "{mean} for {expected}\n{text}");
        }
    }
}

/// Looks straight down on the square from (−1, −1) to (1, 1), which fills the picture.
const CAMERA: &str = "
[camera]
type = 'orthographic'
to_world.look_at = { origin = [0, 0, 5], target = [0, 0, 0], up = [0, 1, 0] }
[film]
width = 32
height = 32
filter = 'box'
";

#[test]
fn light_passes_where_there_is_nothing() {
    // Black in front of white: what is seen is what is not there.
    let before = |shape: &str, opacity: &str| {
        format!(
            "{CAMERA}[[emitters]]\ntype = 'constant'\nradiance = 1\n[[shapes]]\ntype = '{shape}'\n\
             material = {{ type = 'mask', opacity = {opacity}, material = {{ type = 'diffuse', reflectance = 0 }} }}\n"
        )
    };
    may_be(&before("rectangle", "0.3"), 0.7);
    // A sphere is passed twice, wherever it is hit.
    let wide = "radius = 2";
    may_be(&format!("{}{wide}\n", before("sphere", "0.4")), 0.36);
    // Squares: a quarter of the texels are opaque.
    let holes = "{ image = 'holes', filter = 'nearest' }";
    for engine in [Engine::Wavefront, Engine::Scalar] {
        let film = film(&before("rectangle", holes), engine, 16);
        let mean = film.pixels().iter().map(|p| p.mean()[1]).sum::<f64>() / film.pixels().len() as f64;
        assert!((mean - 0.75).abs() < 1e-6, "pixels stand on texels: {mean}");
    }
    is(&before("rectangle", "0"), 1.0);
}

#[test]
fn shadows_have_holes() {
    // Under the sun, below a plate that the camera does not see.
    let under = |opacity: f64| {
        format!(
            "{CAMERA}[[emitters]]\ntype = 'directional'\ndirection = [-1, 0, -1]\nirradiance = 3\n\
             [[shapes]]\ntype = 'rectangle'\n[[shapes]]\ntype = 'rectangle'\n\
             to_world = [{{ scale = 2 }}, {{ translate = [4, 0, 4] }}]\n\
             material = {{ type = 'mask', opacity = {opacity}, material = {{ type = 'diffuse', reflectance = 0 }} }}\n"
        )
    };
    let lit = 3.0 * 0.5_f64.sqrt() * 0.5 / PI;
    is(&under(0.0), lit);
    may_be(&under(0.25), 0.75 * lit);
}

/// A plane of albedo 0.5 whose relief is the same everywhere, under a sun of irradiance 1.
fn plane(material: &str, direction: [f64; 3], mesh: &str) -> String {
    format!(
        "{CAMERA}[[emitters]]\ntype = 'directional'\ndirection = {direction:?}\nirradiance = 1\n[[shapes]]\n{mesh}\n\
         material = {{ {material}, material = {{ type = 'diffuse' }} }}\n"
    )
}

#[test]
fn normals_lean_as_their_map_says() {
    let (rectangle, map) = ("type = 'rectangle'", "type = 'normal-map', normal_map = { image = 'tilted' }");
    let (sin, cos) = (0.5, 0.75_f64.sqrt());
    is(&plane(map, [0.0, 0.0, -1.0], rectangle), cos * 0.5 / PI);
    // From +x, 45° high, the light is 15° off the tilted normal; from −x 75°.
    let light = 0.5_f64.sqrt();
    is(&plane(map, [-1.0, 0.0, -1.0], rectangle), (light * cos + light * sin) * 0.5 / PI);
    is(&plane(map, [1.0, 0.0, -1.0], rectangle), (light * cos - light * sin) * 0.5 / PI);
    // Twice the tilt.
    let steep = format!("{map}, scale = 2");
    is(&plane(&steep, [0.0, 0.0, -1.0], rectangle), cos / (1.0_f64 + cos * cos).sqrt() * 0.5 / PI);
    // Where u goes along y, the normal leans along y; mirrored, to the other side.
    let square = "type = 'mesh'\npositions = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\nfaces = [[0, 1, 2, 3]]";
    let along_y = format!("{square}\nuvs = [[0, 0], [0, 1], [1, 1], [1, 0]]");
    is(&plane(map, [0.0, -1.0, -1.0], &along_y), (light * cos + light * sin) * 0.5 / PI);
    let mirrored = format!("{square}\nuvs = [[1, 0], [0, 0], [0, 1], [1, 1]]");
    is(&plane(map, [1.0, 0.0, -1.0], &mirrored), (light * cos + light * sin) * 0.5 / PI);
}

#[test]
fn maps_lie_between_mixes() {
    let grey = "{ type = 'diffuse' }";
    let inner = format!("{{ type = 'mix', weight = 0.5, a = {grey}, b = {grey} }}");
    let map = format!("{{ type = 'normal-map', normal_map = {{ image = 'tilted' }}, material = {inner} }}");
    let outer = format!("{{ type = 'mix', weight = 1, a = {grey}, b = {map} }}");
    let text = plane("type = 'diffuse'", [0.0, 0.0, -1.0], "type = 'rectangle'");
    let whole = text.find("material = {").expect("a material");
    is(&format!("{}material = {outer}\n", &text[..whole]), 0.75_f64.sqrt() * 0.5 / PI);
}

#[test]
fn relief_has_its_slope() {
    // Over the two units of the square the height rises by `scale`. At the very edge the image ends, so look within.
    let within = "to_world = { scale = 1.5 }\ntype = 'rectangle'";
    let bump =
        |scale: f64| format!("type = 'bump-map', bump_map = {{ image = 'ramp', wrap = 'clamp' }}, scale = {scale}");
    for scale in [0.0, 1.0, -3.0] {
        let slope = scale / 3.0;
        let upright = 1.0 / (1.0_f64 + slope * slope).sqrt();
        is(&plane(&bump(scale), [0.0, 0.0, -1.0], within), upright * 0.5 / PI);
        // Rising along +x, it leans towards −x.
        let light = 0.8 * upright - 0.6 * slope * upright;
        is(&plane(&bump(scale), [-0.6, 0.0, -0.8], within), light * 0.5 / PI);
    }
}

/// In a white furnace rough metal and rough glass show what one bounce off their facets gives back, ∫ f |cosθ|.
#[test]
fn rough_surfaces_lose_what_their_facets_exchange() {
    // k → ∞ reflects all: (η − 1)² + k² over (η + 1)² + k² at η = 0 is 1.
    let white_metal = |alpha: f64| format!("{{ type = 'conductor', eta = 0, k = 9, alpha = {alpha} }}");
    let glass = |alpha: f64, ior: f64| format!("{{ type = 'dielectric', int_ior = {ior}, alpha = {alpha} }}");
    let materials = [white_metal(0.3), white_metal(1.0), glass(0.3, 1.5), glass(0.8, 1.5), glass(0.5, 0.7)];
    for material in materials {
        for angle in [0.0_f64, 50.0, 75.0] {
            let text = format!(
                "{CAMERA}[[emitters]]\ntype = 'constant'\nradiance = 1\n[materials]\nm = {material}\n[[shapes]]\n\
                 type = 'rectangle'\nmaterial = 'm'\n\
                 to_world = [{{ scale = 20 }}, {{ rotate = {{ axis = [1, 0, 0], angle = {angle} }} }}]\n"
            );
            let (description, _): (SceneDescription, _) = from_toml(&text, "test.toml").expect("a scene");
            let alone = rebond::scene::material(&description, &MaterialRef::Named("m".into()), &Images).expect("one");
            let known = Angles { theta: angle, phi: 90.0 }.direction();
            let (rows, columns) = (900, 600);
            let mut sum = 0.0;
            for i in 0..rows * columns {
                let theta = (f64::from(i / columns) + 0.5) * 180.0 / f64::from(rows);
                let other = Angles { theta, phi: (f64::from(i % columns) + 0.5) * 360.0 / f64::from(columns) };
                let (f, _) = alone.eval(known, other.direction(), TransportMode::Radiance);
                sum += f64::from(f[1]) * theta.to_radians().cos().abs() * theta.to_radians().sin();
            }
            let given_back = sum * 2.0 * PI * PI / f64::from(rows * columns);
            may_be(&text, given_back);
        }
    }
}

#[test]
fn a_relief_is_the_same_from_behind() {
    let mapped = "{ type = 'normal-map', normal_map = { image = 'tilted' }, material = { type = 'diffuse' } }";
    let turned = format!(
        "{CAMERA}[[emitters]]\ntype = 'directional'\ndirection = [-1, 0, -1]\nirradiance = 1\n[[shapes]]\n\
         type = 'rectangle'\nflip_normals = true\nmaterial = {{ type = 'two-sided', front = {mapped} }}\n"
    );
    // The map leans the normal of the front, which is below, by 30° along u; the back's is its opposite. Turning a
    // rectangle over keeps its corners and their u, so the back leans towards −x.
    let light = 0.5_f64.sqrt();
    let (sin, cos) = (0.5, 0.75_f64.sqrt());
    is(&turned, (light * cos - light * sin) * 0.5 / PI);
}
