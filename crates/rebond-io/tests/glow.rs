//! Lamps in the colours of an image: as plain lamps that tile them, and alike for every integrator.

mod common;

use common::{LEVEL, judge, picture};
use rebond_io::{SceneFiles, SceneSource};

/// A room with a lamp on its wall and one that is mirrored and stands in it; `lamps` are their shapes.
fn room(lamps: &str) -> SceneSource {
    let text = format!(
        r#"
        film = {{ width = 32, height = 24, filter = {{ type = "box" }} }}
        materials.grey = {{ type = "diffuse", reflectance = 0.6 }}
        materials.black = {{ type = "diffuse", reflectance = 0 }}
        [camera]
        type = "perspective"
        fov = 60
        to_world.look_at = {{ origin = [0, 0, 3.6], target = [0, -0.1, 0], up = [0, 1, 0] }}
        [[shapes]]
        type = "rectangle"
        material = "grey"
        to_world = [{{ rotate = {{ axis = [1, 0, 0], angle = -90 }} }}, {{ scale = 2 }}, {{ translate = [0, -1, 0] }}]
        [[shapes]]
        type = "rectangle"
        material = "grey"
        to_world = [{{ scale = 2 }}, {{ translate = [0, 0, -1.5] }}]
        [[shapes]]
        type = "sphere"
        radius = 0.5
        center = [0.2, -0.5, 0]
        material = {{ type = "conductor", metal = "silver", alpha = 0.3 }}
        {lamps}
        "#
    );
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gltf");
    SceneSource::parse(&text, "glow.toml", "glow", SceneFiles::Folder(folder))
        .unwrap_or_else(|e| panic!("{}", e.snippet()))
}

/// Where the two lamps are: a rectangle, and two triangles of a mirrored mesh.
const PLACES: [&str; 2] = [
    "{ scale = [0.8, 0.5, 1] }, { rotate = { axis = [0, 1, 0], angle = 50 } }, { translate = [-1.3, 0.5, -0.4] }",
    "{ scale = [-0.6, 0.4, 1] }, { rotate = { axis = [1, 0, 0], angle = 70 } }, { translate = [0.8, 1, 0.3] }",
];

fn glowing() -> SceneSource {
    let material = r#"material = { type = "glow", radiance = { image = "quarters.png", filter = "nearest" }, scale = [6, 3, 6], material = "black" }"#;
    let [rectangle, mesh] = PLACES;
    room(&format!(
        r#"
        [[shapes]]
        type = "rectangle"
        {material}
        to_world = [{rectangle}]
        [[shapes]]
        type = "mesh"
        positions = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
        uvs = [[0, 0], [1, 0], [1, 1], [0, 1]]
        faces = [[0, 1, 2, 3]]
        {material}
        to_world = [{mesh}]
        "#
    ))
}

/// A plain lamp for each texel, decoded, times (6, 3, 6).
fn tiled() -> SceneSource {
    let texels = [
        ("-0.5, 0.5", "6, 3, 6"),
        ("0.5, 0.5", "4.294161, 0.063657, 0.1273141"),
        ("-0.5, -0.5", "0.1273141, 1.7327413, 0.2711172"),
        ("0.5, -0.5", "0.1913762, 0.1837382, 4.7477876"),
    ];
    let lamp = |place: &str| {
        let tile = |(center, radiance): (&str, &str)| {
            format!(
                r#"
                [[shapes]]
                type = "rectangle"
                material = "black"
                emission = [{radiance}]
                to_world = [{{ scale = 0.5 }}, {{ translate = [{center}, 0] }}, {place}]
                "#
            )
        };
        texels.map(tile).concat()
    };
    room(&PLACES.map(lamp).concat())
}

#[test]
fn images_shine_as_the_lamps_that_tile_them() {
    let reference = picture(&tiled(), "path:max_depth=4", 1000, 256);
    let glowing = glowing();
    let integrators = [
        ("path:max_depth=4", 256),
        ("path:mode=explicit,max_depth=4", 256),
        ("path:mode=implicit,max_depth=4", 512),
        ("bidirectional:max_depth=4", 64),
        ("light:max_depth=4", 512),
    ];
    for (i, (integrator, samples)) in integrators.into_iter().enumerate() {
        let other = picture(&glowing, integrator, 100 * i as u64, samples);
        judge(&other, &reference, 1, LEVEL / (3.0 * integrators.len() as f64))
            .unwrap_or_else(|e| panic!("{integrator}, {e}"));
    }
}

#[test]
fn what_cannot_glow_says_so() {
    let fails = |shape: &str| {
        let glow = r#"{ type = "glow", radiance = { image = "quarters.png" }, material = "black" }"#;
        let source = room(&format!("[[shapes]]\n{}", shape.replace("GLOW", glow)));
        source.build().err().map(|e| e.message).unwrap_or_default()
    };
    assert_eq!(fails("type = \"disk\"\nmaterial = GLOW"), "an image on a sphere or a disk that shines");
    assert_eq!(fails("type = \"rectangle\"\nemission = 1\nmaterial = GLOW"), "two emissions");
    assert_eq!(
        fails("type = \"rectangle\"\nmaterial = { type = \"two-sided\", front = GLOW }"),
        "a material that shines within another"
    );
    assert_eq!(
        fails("type = \"mesh\"\npositions = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nfaces = [[0, 1, 2]]\nmaterial = GLOW"),
        "an image that shines on a mesh without uvs"
    );
    let dark = r#"{ type = "glow", radiance = { image = "quarters.png" }, scale = -1, material = "black" }"#;
    assert_eq!(fails(&format!("type = \"rectangle\"\nmaterial = {dark}")), "light is finite and not negative");
}
