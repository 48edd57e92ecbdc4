use super::*;
use crate::SceneSource;

/// A scene of one triangle with that library, and the folder of its files.
fn placed(library: &str, options: ImportOptions) -> (Result<Imported, Error>, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("a b.mtl"), format!("newmtl m\n{library}")).expect("a file");
    std::fs::write(folder.path().join("i.png"), include_bytes!("../../tests/data/obj/quarters.png")).expect("a file");
    let obj = "mtllib a b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    (read_obj_scene(obj.as_bytes(), "a.obj", folder.path(), options), folder)
}

fn triangle(library: &str, options: ImportOptions) -> Result<Imported, Error> {
    placed(library, options).0
}

fn material(library: &str) -> MaterialDescription {
    let (scene, _folder) = placed(library, ImportOptions::default());
    let scene = scene.unwrap_or_else(|e| panic!("{}", e.snippet()));
    SceneSource::imported(scene.clone(), "a").material("m").unwrap_or_else(|e| panic!("{}", e.snippet()));
    scene.description.materials["m"].clone()
}

#[test]
fn materials_are_what_toml_says() {
    let is = |library: &str, toml: &str| {
        #[derive(serde::Deserialize)]
        struct One {
            m: MaterialDescription,
        }
        let wanted = crate::from_toml::<One>(&format!("m = {toml}"), "").unwrap_or_else(|e| panic!("{}", e.snippet()));
        assert_eq!(material(library), wanted.0.m, "{library}");
    };
    let two_sided = |front: &str| format!("{{ type = \"two-sided\", front = {front} }}");
    is("Kd 0.25 0.5 1", &two_sided("{ type = \"diffuse\", reflectance = [0.25, 0.5, 1] }"));
    // Without a highlight Ks is nothing.
    is("Kd 0.5 0.5 0.5\nKs 1 1 1\nillum 1", &two_sided("{ type = \"diffuse\", reflectance = 0.5 }"));
    is(
        "Kd 0.25 0.25 0.125\nKs 0.25\nNs 7",
        &two_sided(
            "{ type = \"mix\", a = { type = \"diffuse\", reflectance = [0.5, 0.5, 0.25] }, b = { type = \"blinn-phong\", reflectance = 0.5, exponent = 7 }, weight = 0.5 }",
        ),
    );
    // Twice too bright: half of each.
    is(
        "Kd 1 1 1\nKs 1 1 1\nNs 7\nillum 3",
        &two_sided(
            "{ type = \"mix\", a = { type = \"diffuse\", reflectance = 1 }, b = { type = \"mirror\", reflectance = 1 }, weight = 0.5 }",
        ),
    );
    is("Ks 0.5 0.25 0.5\nillum 5", &two_sided("{ type = \"mirror\", reflectance = [0.5, 0.25, 0.5] }"));
    is("Ni 1.25\nTf 0.5 1 1\nd 0.5\nillum 6", "{ type = \"dielectric\", int_ior = 1.25, tint = [0.5, 1, 1] }");
    is("Ni 1.25\nillum 9", "{ type = \"thin-dielectric\", int_ior = 1.25, tint = 1 }");
    is(
        "Kd 1 1 1\nTr 0.75",
        "{ type = \"mask\", opacity = 0.25, material = { type = \"two-sided\", front = { type = \"diffuse\", reflectance = 1 } } }",
    );
    is(
        "map_Kd -clamp on -o 0.5 0.25 -s 2 3 1 i.png",
        &two_sided(
            "{ type = \"diffuse\", reflectance = { image = \"i.png\", wrap = \"clamp\", to_uv = [[2, 0, 0.5], [0, 3, 0.25]] } }",
        ),
    );
}

#[test]
fn faces_of_a_material_are_one_mesh() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nusemtl\tlamp\nusemtl a b # what it is\nf 2 4 3\nusemtl a\nf 1 2 4\nusemtl a b\nf 1 2 4\n";
    let lenient = ImportOptions { lenient: true, ..ImportOptions::default() };
    let scene = read_obj_scene(obj.as_bytes(), "dir/c.obj", Path::new(""), lenient).expect("a scene");
    let faces = |s: &ShapeDescription| match s {
        ShapeDescription::Ply(s) => scene.files.meshes[&s.file].triangles.len(),
        other => panic!("{other:?}"),
    };
    let parts: Vec<usize> = scene.description.shapes.iter().map(faces).collect();
    // "a" and "a b" are not in any library: all three are of the default material, but meshes of their own.
    assert_eq!(parts, [1, 2, 1]);
    assert_eq!(scene.description.materials.len(), 1);
    assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
    let error =
        read_obj_scene(obj.as_bytes(), "c.obj", Path::new(""), ImportOptions::default()).expect_err("no library");
    assert_eq!((error.line(), error.column()), (Some(7), Some(8)));
    assert_eq!(error.message, "there is no material \"a b\" in its libraries");
}

#[test]
fn mistakes_have_their_places() {
    let fails = |library: &str| {
        let error = match triangle(library, ImportOptions::default()) {
            Err(e) => e,
            Ok(scene) => SceneSource::imported(scene, "a").build().err().expect("a mistake"),
        };
        (error.file.unwrap_or_default(), error.place.map_or(0, |p| p.line), error.message)
    };
    let say = |line: usize, message: &str| ("a b.mtl".to_string(), line, message.to_string());
    assert_eq!(fails("Kd 1 1"), say(2, "Kd is three numbers, or one"));
    assert_eq!(fails("Kd 1 1 red"), say(2, "\"red\" is not a number"));
    assert_eq!(fails("\nKd spectral a.rfl"), say(3, "a colour given as spectral is not supported"));
    assert_eq!(fails("illum 12"), say(2, "illum 12: there are 0 to 9"));
    assert_eq!(fails("map_bump i.png"), say(2, "\"map_bump\" is not supported"));
    assert_eq!(fails("map_Kd -bm 2 i.png"), say(2, "the option -bm of an image"));
    assert_eq!(fails("map_Kd"), say(2, "map_Kd names no file"));
    assert!(fails("map_Kd ../../etc/passwd").2.contains("passwd"));
    assert_eq!(fails("Ke 1 1 1\nd 0.5"), say(2, "light from a surface that is not opaque"));
    let (file, _, message) = fails("Ni 0\nillum 7");
    assert_eq!((&*file, &*message), ("a.obj", "the material \"m\": 0 is no index of refraction"));
    let scene =
        triangle("Kd 2 1 1\nKa 1 1 1\nTf 0.5\nmap_bump i.png", ImportOptions { lenient: true, ..Default::default() });
    let warnings: Vec<usize> = scene.expect("a scene").warnings.iter().filter_map(Error::line).collect();
    assert_eq!(warnings, [2, 3, 5, 4]);
}
