//! Roughness and metal by images: as the numbers that are their texels, for every integrator.

mod common;

use common::{Job, LEVEL, film, judge, picture};
use rebond::render::Engine;
use rebond_io::{SceneFiles, SceneSource};
use std::path::Path;

/// Rows from the bottom up.
fn pfm(folder: &Path, name: &str, size: [u32; 2], texels: &[[f32; 3]]) {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", size[0], size[1]).into_bytes();
    bytes.extend(texels.iter().flatten().flat_map(|x| x.to_le_bytes()));
    std::fs::write(folder.join(name), bytes).expect("an image");
}

/// A floor and a back wall in the light of a lamp and a sky; `shapes` are what stands between.
fn room(folder: &Path, shapes: &str) -> SceneSource {
    let text = format!(
        r#"
        film = {{ width = 32, height = 24, filter = {{ type = "box" }} }}
        [camera]
        type = "perspective"
        fov = 50
        to_world.look_at = {{ origin = [0, 0.6, 4], target = [0, 0, 0], up = [0, 1, 0] }}
        [[emitters]]
        type = "constant"
        radiance = [0.3, 0.4, 0.5]
        [[shapes]]
        type = "rectangle"
        emission = 12
        material = {{ type = "diffuse", reflectance = 0 }}
        to_world = [{{ scale = 0.5 }}, {{ rotate = {{ axis = [1, 0, 0], angle = 90 }} }}, {{ translate = [0.4, 2, 1] }}]
        [[shapes]]
        type = "rectangle"
        material = {{ type = "diffuse", reflectance = [0.7, 0.4, 0.3] }}
        to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = -90 }} }}, {{ scale = 2.5 }}, {{ translate = [0, -1, 0] }}]
        {shapes}
        "#
    );
    SceneSource::parse(&text, "varied.toml", "varied", SceneFiles::Folder(folder.to_path_buf()))
        .unwrap_or_else(|e| panic!("{}", e.snippet()))
}

/// Materials with numbers R, G and B.
const MATERIALS: [&str; 9] = [
    r#"{ type = "principled", base_color = [0.9, 0.6, 0.3], roughness = R, metallic = G }"#,
    r#"{ type = "principled", roughness = R, metallic = B, anisotropic = 0.7, transmission = 0.5, clearcoat = 0.5, sheen = 0.3 }"#,
    r#"{ type = "conductor", metal = "gold", alpha = R }"#,
    r#"{ type = "conductor", metal = "copper", alpha = G, compensate = true }"#,
    r#"{ type = "dielectric", alpha = B }"#,
    r#"{ type = "conductor", metal = "silver", alpha_u = R, alpha_v = G, distribution = "beckmann", masking = "separable" }"#,
    r#"{ type = "dielectric", alpha = 0.2, alpha_v = B }"#,
    r#"{ type = "principled-thin", roughness = R, anisotropic = 0.4, transmission = 0.4, diffuse_transmission = 0.3 }"#,
    r#"{ type = "plastic", diffuse_reflectance = [0.2, 0.3, 0.6], alpha = R, nonlinear = true }"#,
];

#[test]
fn an_image_of_one_number_is_that_number_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    pfm(folder.path(), "even.pfm", [2, 2], &[[0.3, 0.6, 0.45]; 4]);
    let ball = |material: &str| {
        let shape = "[[shapes]]\ntype = \"sphere\"\nmaterial = ";
        room(folder.path(), &format!("{shape}{material}"))
    };
    let places = [("R", "r", "0.3"), ("G", "g", "0.6"), ("B", "b", "0.45")];
    for material in MATERIALS {
        let (mut numbers, mut images) = (material.to_owned(), material.to_owned());
        for (place, channel, number) in places {
            let image = format!("= {{ image = \"even.pfm\", channel = \"{channel}\", filter = \"nearest\" }}");
            numbers = numbers.replace(&format!("= {place}"), &format!("= {number}"));
            images = images.replace(&format!("= {place}"), &image);
        }
        assert!(numbers != material && images != material && !images.contains("= 0.3,"), "{images}");
        let both = [ball(&numbers), ball(&images)];
        for engine in [Engine::Wavefront, Engine::Scalar] {
            for integrator in ["path:max_depth=5", "bidirectional:max_depth=4"] {
                let job = || Job { engine, samples: 0..4, ..Job::default() };
                let [a, b] = both.each_ref().map(|source| film(source, integrator, &job()).develop());
                assert_eq!(a, b, "{material}, {integrator}");
            }
        }
    }
}

#[test]
fn an_image_of_two_numbers_is_two_surfaces() {
    let folder = tempfile::tempdir().expect("a folder");
    // Left and right: roughness red, metal green.
    pfm(folder.path(), "halves.pfm", [2, 1], &[[0.25, 1.0, 0.0], [0.7, 0.2, 0.0]]);
    let image = |channel: &str| format!("{{ image = \"halves.pfm\", channel = \"{channel}\", filter = \"nearest\" }}");
    let principled = |roughness: &str, metallic: &str| {
        format!(
            "{{ type = \"two-sided\", front = {{ type = \"principled\", base_color = [0.9, 0.6, 0.3], roughness = {roughness}, metallic = {metallic} }} }}"
        )
    };
    let wall = |place: &str, material: &str| {
        let turned = "{ rotate = { axis = [0, 1, 0], angle = 25 } }, { rotate = { axis = [1, 0, 0], angle = -25 } }";
        format!("[[shapes]]\ntype = \"rectangle\"\nto_world = [{place}, {turned}]\nmaterial = {material}\n")
    };
    let halves = |left: &str, right: &str| {
        let half = |x: f64, material: &str| {
            wall(&format!("{{ scale = [0.5, 1, 1] }}, {{ translate = [{x}, 0, 0] }}"), material)
        };
        room(folder.path(), &format!("{}{}", half(-0.5, left), half(0.5, right)))
    };
    let whole = room(folder.path(), &wall("{ scale = 1 }", &principled(&image("r"), &image("g"))));
    let reference =
        picture(&halves(&principled("0.25", "1"), &principled("0.7", "0.2")), "path:max_depth=4", 1000, 256);
    let integrators = [("path:max_depth=4", 256), ("bidirectional:max_depth=4", 64), ("light:max_depth=4", 512)];
    let level = LEVEL / (3.0 * integrators.len() as f64);
    for (i, (integrator, samples)) in integrators.into_iter().enumerate() {
        let other = picture(&whole, integrator, 100 * i as u64, samples);
        judge(&other, &reference, 1, level).unwrap_or_else(|e| panic!("{integrator}, {e}"));
    }
    // Either of the two alone would be seen.
    for (roughness, metallic) in [("0.25", &*image("g")), (&*image("r"), "1")] {
        let wrong = room(folder.path(), &wall("{ scale = 1 }", &principled(roughness, metallic)));
        let wrong = picture(&wrong, "path:max_depth=4", 500, 256);
        assert!(judge(&wrong, &reference, 1, level).is_err(), "{roughness}, {metallic}");
    }
}

#[test]
fn what_is_no_image_of_numbers_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    pfm(folder.path(), "bright.pfm", [1, 1], &[[1.5, 0.5, 0.5]]);
    pfm(folder.path(), "even.pfm", [1, 1], &[[0.5; 3]]);
    let fails = |material: &str| {
        let source = room(folder.path(), &format!("[[shapes]]\ntype = \"sphere\"\nmaterial = {material}"));
        let error = source.build().err().unwrap_or_else(|| panic!("{material}"));
        (error.path, error.message)
    };
    let (path, message) = fails(r#"{ type = "principled", roughness = { image = "bright.pfm" } }"#);
    assert_eq!(path, "shapes[2].material.roughness.image");
    assert_eq!(message, "1 texels of \"bright.pfm\" are above 1 and 0 below 0 or not finite");
    let (path, message) =
        fails(r#"{ type = "conductor", alpha_u = { image = "even.pfm" }, alpha_v = 0.1, compensate = true }"#);
    assert_eq!(path, "shapes[2].material.compensate");
    assert_eq!(message, "compensation of an anisotropic metal");
    assert_eq!(
        fails(r#"{ type = "conductor", alpha_v = { image = "bright.pfm" } }"#).0,
        "shapes[2].material.alpha_v.image"
    );
    assert_eq!(fails(r#"{ type = "plastic", alpha = { image = "none.pfm" } }"#).0, "shapes[2].material.alpha.image");
}
