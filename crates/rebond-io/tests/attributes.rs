//! What meshes know of their vertices and faces: as colours and numbers of materials.

mod common;

use common::{Job, LEVEL, film, judge, t_test};
use rebond_io::{SceneFiles, SceneSource};

/// A square of two triangles and another mesh before it, in light of 1 from everywhere, seen from straight above: what is diffuse
/// is as bright as its reflectance.
fn square(mesh: &str) -> String {
    format!(
        r#"
        film = {{ width = 8, height = 8, filter = {{ type = "box" }} }}
        [camera]
        type = "orthographic"
        to_world = [{{ rotate = {{ axis = [0, 1, 0], angle = 180 }} }}, {{ translate = [0, 0, 3] }}]
        [[emitters]]
        type = "constant"
        radiance = 1
        [[shapes]]
        type = "mesh"
        positions = [[7, 0, 0], [8, 0, 0], [8, 1, 0], [7, 1, 0]]
        faces = [[0, 1, 2, 3]]
        [[shapes]]
        type = "mesh"
        positions = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
        faces = [[0, 1, 2], [0, 2, 3]]
        {mesh}
        "#
    )
}

fn parse(text: &str) -> SceneSource {
    SceneSource::parse(text, "attributes.toml", "attributes", SceneFiles::BuiltIn)
        .unwrap_or_else(|e| panic!("{}", e.snippet()))
}

fn job(samples: u32, seed: u64) -> Job {
    Job { samples: 0..samples, seed, ..Job::default() }
}

const DIFFUSE: &str = "type = \"diffuse\", reflectance = { attribute = \"vertex_color\" }";
/// Of what is diffuse it has no noise, its directions being drawn as the cosine has it.
const EXACT: &str = "path:mode=implicit,max_depth=2";
const CORNERS: &str = "[[0.9, 0.1, 0], [0.2, 0.8, 0], [0.1, 0.3, 0], [0.7, 0.6, 0]]";

/// The mean over a triangle is that of its corners, and the two are alike in size.
#[test]
fn colours_of_vertices_are_interpolated() {
    let mesh = format!("attributes.vertex_color = {CORNERS}\nmaterial = {{ {DIFFUSE} }}");
    let expected = ((0.1 + 0.8 + 0.3) + (0.1 + 0.3 + 0.6)) / 6.0;
    for placed in ["", "to_world = { scale = [-1, 1, 1] }", "to_world = [{ keyframes = [{ time = 0 }, { time = 1 }] }]"]
    {
        // Mirrored, it is turned over: seen from behind.
        let mesh =
            mesh.replace(&format!("{{ {DIFFUSE} }}"), &format!("{{ type = \"two-sided\", front = {{ {DIFFUSE} }} }}"));
        let film = film(&parse(&square(&format!("{mesh}\n{placed}"))), "path:max_depth=2", &job(64, 1));
        let (mean, p) = t_test(&film, expected);
        assert!(p > LEVEL / 3.0, "{placed}: {mean} for {expected}, p {p}");
        // The corners are where they belong: the camera's x goes to the left.
        let image = film.develop();
        let green = &image.layer("").expect("a picture").channels[1].data;
        let (left, right) = (green[56], green[63]);
        let (low, high) = if placed.contains("-1") { (right, left) } else { (left, right) };
        assert!((low - 0.1).abs() < 0.12 && (high - 0.8).abs() < 0.12, "{placed}: {left}, {right}");
    }
    // Half of the red with a scale of 2.
    let half = mesh.replace("0.9", "0.45").replace("{ attribute", "{ scale = [2, 1, 1], attribute");
    let red = |mesh: &str| film(&parse(&square(mesh)), EXACT, &job(4, 1)).mean()[0];
    let half = half.replace("0.2,", "0.1,").replace("[0.1, 0.3", "[0.05, 0.3").replace("0.7", "0.35");
    assert!((red(&half) / red(&mesh) - 1.0).abs() < 1e-6, "{} for {}", red(&half), red(&mesh));
}

/// One mesh of two faces is two meshes of one each, to the bit.
#[test]
fn colours_of_faces_are_those_of_meshes() {
    let both = square(
        "attributes.face_color = [[0.9, 0.1, 0.3], 0.25]\nmaterial = { type = \"diffuse\", reflectance = { attribute = \"face_color\" } }",
    );
    let one = |faces: &str, color: &str| {
        format!("faces = [{faces}]\nmaterial = {{ type = \"diffuse\", reflectance = {color} }}")
    };
    let positions = "[[shapes]]\ntype = \"mesh\"\npositions = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\n";
    let apart = square("").replace(
        "faces = [[0, 1, 2], [0, 2, 3]]",
        &format!("{}\n{positions}{}", one("[0, 1, 2]", "[0.9, 0.1, 0.3]"), one("[0, 2, 3]", "0.25")),
    );
    for integrator in ["path", "bidirectional:max_depth=3", "light:max_depth=3"] {
        let [a, b] = [&both, &apart].map(|text| film(&parse(text), integrator, &job(16, 1)).develop());
        assert_eq!(a, b, "{integrator}");
    }
    // Polygons are one face each, however they are cut.
    let whole = both.replace("[[0, 1, 2], [0, 2, 3]]\n        attributes", "[[0, 1, 2, 3]]\n        attributes");
    let whole = whole.replace("[[0.9, 0.1, 0.3], 0.25]", "[[0.9, 0.1, 0.3]]");
    let mean = film(&parse(&whole), EXACT, &job(4, 1)).mean();
    assert!((mean[0] - 0.9).abs() < 1e-6 && (mean[2] - 0.3).abs() < 1e-6, "{mean:?}");
}

#[test]
fn numbers_may_be_attributes() {
    let lamp = "[[emitters]]\ntype = \"directional\"\ndirection = [0.3, 0.1, -1]\nirradiance = 2\n[[shapes]]\ntype = \"mesh\"\npositions = [[7";
    let lit =
        |text: String| parse(&text.replacen("[[shapes]]\n        type = \"mesh\"\n        positions = [[7", lamp, 1));
    let metal = |roughness: &str, metallic: &str| {
        format!(
            "{{ type = \"principled\", base_color = [0.9, 0.6, 0.3], roughness = {roughness}, metallic = {metallic} }}"
        )
    };
    let worn = metal("{ attribute = \"face_rough\" }", "{ attribute = \"face_metal\", scale = 0.5 }");
    let both =
        lit(square(&format!("attributes = {{ face_rough = [0.3, 0.5], face_metal = [1, 0.2] }}\nmaterial = {worn}")));
    let positions = "[[shapes]]\ntype = \"mesh\"\npositions = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\n";
    let apart = |other: &str| {
        lit(square("").replace(
            "faces = [[0, 1, 2], [0, 2, 3]]",
            &format!(
                "faces = [[0, 1, 2]]\nmaterial = {}\n{positions}faces = [[0, 2, 3]]\nmaterial = {other}",
                metal("0.3", "0.5")
            ),
        ))
    };
    let picture = |source: &SceneSource, seed| film(source, "path:max_depth=2", &job(256, seed)).develop();
    let reference = picture(&apart(&metal("0.5", "0.1")), 1);
    judge(&picture(&both, 2), &reference, 8, LEVEL / 3.0).unwrap_or_else(|e| panic!("{e}"));
    for wrong in [metal("0.65", "0.1"), metal("0.5", "0.6")] {
        assert!(judge(&picture(&apart(&wrong), 3), &reference, 8, LEVEL / 3.0).is_err(), "{wrong}");
    }
}

/// A material by name is made for each mesh that it asks for something, and once for all others.
#[test]
fn materials_are_shared_by_what_has_the_attribute() {
    let mesh = |x: f64, color: &str| {
        format!(
            "[[shapes]]\ntype = \"mesh\"\npositions = [[{x}, -1, 0], [{0}, -1, 0], [{0}, 1, 0], [{x}, 1, 0]]\nfaces = [[0, 1, 2, 3]]\n\
             attributes.face_color = [{color}]\nmaterial = \"worn\"\n",
            x + 1.0
        )
    };
    let text = format!(
        "{}\n{}{}[materials]\nworn = {{ type = \"two-sided\", front = \"half\" }}\nhalf = {{ type = \"mix\", a = \"own\", b = \"own\", weight = 0.5 }}\nown = {{ type = \"diffuse\", reflectance = {{ attribute = \"face_color\" }} }}\n",
        square("").replace("positions = [[-1, -1, 0]", "positions = [[-1, -1, -9]"),
        mesh(-1.0, "[0.8, 0.2, 0.2]"),
        mesh(0.0, "[0.2, 0.6, 0.2]")
    );
    let source = parse(&text);
    let mean = film(&source, EXACT, &job(4, 1)).mean();
    assert!((mean[0] - 0.5).abs() < 1e-6 && (mean[1] - 0.4).abs() < 1e-6, "{mean:?}");
    // One for what wears nothing, and three for each.
    assert_eq!(source.build().expect("a scene").statistics().materials, 7);
}

#[test]
fn mistakes_say_so() {
    let fails = |text: String| {
        let error = parse(&text).build().err().unwrap_or_else(|| panic!("{text}"));
        format!("{}: {} ({})", error.path, error.message, error.help.unwrap_or_default())
    };
    let material = format!("material = {{ {DIFFUSE} }}");
    let named = |attributes: &str| fails(square(&format!("attributes = {{ {attributes} }}\n{material}")));
    let place = "shapes[1].material.reflectance.attribute";
    assert_eq!(
        named("vertex_colour = [1, 1, 1, 1]"),
        format!("{place}: the shape has no attribute \"vertex_color\" (it has: vertex_colour)")
    );
    assert_eq!(
        named("vertex_color = [1, 1, 1, 1.5]"),
        format!(
            "{place}: 1 value of \"vertex_color\" is below 0, above 1 or not finite (a reflectance lies within [0, 1])"
        )
    );
    assert_eq!(named("vertex_color = [1, 1]"), "shapes[1].attributes.vertex_color: 2 values for 4 positions ()");
    assert_eq!(named("face_color = [1, 1, 1, 1]"), "shapes[1].attributes.face_color: 4 values for 2 faces ()");
    assert!(named("color = [1, 1, 1, 1]").contains("\"color\" is of neither vertices nor faces"));
    let sphere = fails(format!("{}\n[[shapes]]\ntype = \"sphere\"\n{material}", square("")));
    assert!(sphere.contains("only meshes have attributes"), "{sphere}");
    let mask =
        "material = { type = \"mask\", opacity = { attribute = \"vertex_color\" }, material = { type = \"diffuse\" } }";
    assert!(fails(square(mask)).contains("an attribute for an opacity"));
    let text = "type = 'diffuse', reflectance = { image = 'a.png', scale = 2 }";
    let error = SceneSource::parse(&square(&format!("material = {{ {text} }}")), "a", "a", SceneFiles::BuiltIn);
    assert!(error.is_err_and(|e| e.message.contains("`scale` is for an `attribute`")));
    let text = "type = 'diffuse', reflectance = { attribute = 'vertex_color', channel = 'g' }";
    let error = SceneSource::parse(&square(&format!("material = {{ {text} }}")), "a", "a", SceneFiles::BuiltIn);
    assert!(error.is_err_and(|e| e.message.contains("`channel` is for an `image`")));
    // Radiosity has one reflectance for a patch.
    let text = square(&format!("attributes.vertex_color = {CORNERS}\n{material}"));
    let scene = parse(&text).build().expect("a scene");
    assert!(scene.obstacles().iter().any(|o| o.what == "an attribute of vertices or faces" && !o.has_diffuse_part));
}
