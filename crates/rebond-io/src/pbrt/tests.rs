use super::*;
use crate::SceneSource;
use rebond::scene::description::{MaterialDescription, MaterialRef, NumberTexture};
use rebond::shape::MeshData;

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mitsuba/parts")
}

fn strict(text: &str) -> Result<Imported> {
    read_pbrt(text, "a.pbrt", &folder(), ImportOptions::default())
}

fn read(text: &str) -> Imported {
    strict(text).unwrap_or_else(|e| panic!("{}", e.snippet()))
}

fn toml(text: &str) -> SceneDescription {
    crate::from_toml(text, "").unwrap_or_else(|e| panic!("{}", e.snippet())).0
}

/// The matrix of a transform, for comparisons of what is multiplied out.
fn near(a: &Transform, b: &Transform) -> bool {
    let (a, b) = (a.matrix("", "").expect("a matrix"), b.matrix("", "").expect("a matrix"));
    a.abs_diff_eq(b, 1e-5)
}

const CAMERA: &str = "Camera \"perspective\"\n";

#[test]
fn a_scene_is_what_toml_says() {
    let scene = read(
        r#"# a comment
LookAt 0 0 5  0 0 0  0 1 0
Camera "perspective" "float fov" [30] # after something
Film "rgb" "integer xresolution" [60] "integer yresolution" 40 "string filename" "a.exr"
Sampler "zsobol" "integer pixelsamples" [32]
Integrator "volpath" "integer maxdepth" 7
PixelFilter "triangle" "float xradius" 1 "float yradius" 1
WorldBegin
MakeNamedMaterial "red" "string type" "diffuse" "rgb reflectance" [ 0.5 0.2 0.1 ]
AttributeBegin
  Translate 1 2 3
  AreaLightSource "diffuse" "rgb L" [ 4 5 6 ] "float scale" 2
  NamedMaterial "red"
  Shape "sphere" "float radius" 0.5
AttributeEnd
AttributeBegin
  Scale 2 2 2
  ReverseOrientation
  Material "dielectric" "float eta" 1.25 "float roughness" 0.04
  Shape "disk" "float radius" 3 "float height" 1
AttributeEnd
Shape "plymesh" "string filename" "lump.ply"
LightSource "distant" "rgb L" [1 2 3] "point3 from" [0 10 0] "point3 to" [0 0 0]
LightSource "point" "rgb I" 7 "point3 from" [1 1 1]
"#
        .replace("\"rgb I\" 7", "\"rgb I\" [7 7 7]")
        .as_str(),
    );
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(scene.samples, Some(32));
    let wanted = toml(
        r#"
        film = { width = 60, height = 40, filter = { type = "tent", radius = 1 } }
        sampler = { type = "sobol" }
        integrator = { type = "path", max_depth = 8 }
        materials.red = { type = "two-sided", front = { type = "diffuse", reflectance = [0.5, 0.2, 0.1] } }
        materials."dielectric 1" = { type = "dielectric", int_ior = 1.25, ext_ior = 1, alpha = 0.2 }
        [camera]
        type = "perspective"
        fov = 30
        fov_axis = "smaller"
        to_world.matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5]]
        [[shapes]]
        type = "sphere"
        radius = 0.5
        material = "red"
        emission = [8, 10, 12]
        to_world.matrix = [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]]
        [[shapes]]
        type = "disk"
        flip_normals = true
        material = "dielectric 1"
        to_world.matrix = [[6, 0, 0, 0], [0, 6, 0, 0], [0, 0, 2, 2]]
        [[shapes]]
        type = "ply"
        file = "lump.ply"
        material = { type = "two-sided", front = { type = "diffuse", reflectance = 0.5 } }
        [[emitters]]
        type = "directional"
        direction = [0, -10, 0]
        irradiance = [1, 2, 3]
        [[emitters]]
        type = "point"
        position = [1, 1, 1]
        intensity = 7
    "#,
    );
    let found = &scene.description;
    assert_eq!((&found.film, &found.sampler, &found.integrator), (&wanted.film, &wanted.sampler, &wanted.integrator));
    assert_eq!(found.materials, wanted.materials);
    assert_eq!((&found.shapes, &found.emitters), (&wanted.shapes, &wanted.emitters));
    match (&found.camera, &wanted.camera) {
        (
            CameraDescription::Perspective { to_world: a, fov, fov_axis, .. },
            CameraDescription::Perspective { to_world: b, fov: f, fov_axis: x, .. },
        ) => assert!(near(a, b) && (fov, fov_axis) == (f, x), "{a:?}"),
        other => panic!("{other:?}"),
    }
    SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
}

#[test]
fn what_is_to_the_right_is_seen_on_the_right() {
    // pbrt's camera looks along +z with +x to the right: a lamp at x > 0 is on the picture's right.
    let scene = read(
        r#"Camera "perspective" "float fov" 90 Film "rgb" "integer xresolution" 2 "integer yresolution" 1 PixelFilter "box"
Sampler "independent" WorldBegin AttributeBegin Translate 1 0 1 AreaLightSource "diffuse" "rgb L" [1 1 1] Shape "sphere" "float radius" 0.4 AttributeEnd"#,
    );
    let source = SceneSource::imported(scene, "a");
    let scene = source.build().expect("a scene");
    let look = |x: f32| scene.camera().ray([x, 0.5_f32], [0.5; 2], 0.0).d.array();
    assert!(look(1.5)[0] > 0.0 && look(0.5)[0] < 0.0, "{:?}", look(1.5));
}

#[test]
fn objects_are_placed_and_attributes_come_back() {
    let scene = read(&format!(
        r#"{CAMERA}WorldBegin
AttributeBegin Translate 5 0 0 ObjectBegin "pair" Shape "sphere" Translate 0 1 0 Shape "sphere" ObjectEnd AttributeEnd
AttributeBegin Rotate 90 0 0 1 ObjectInstance "pair" AttributeEnd
TransformBegin Translate 1 0 0 Material "thindielectric" TransformEnd Shape "sphere"
CoordinateSystem "here" Translate 3 3 3 CoordSysTransform "here" Shape "cylinder" "float zmin" 0 "float zmax" 2 "float radius" 3"#
    ));
    let d = &scene.description;
    assert_eq!((d.groups["pair"].len(), d.shapes.len()), (2, 3));
    let at = |s: &ShapeDescription| match s {
        ShapeDescription::Sphere(s) => s.to_world.matrix("", "").expect("a matrix").translation,
        _ => panic!("a sphere"),
    };
    assert_eq!(
        (at(&d.groups["pair"][0]), at(&d.groups["pair"][1])),
        (DVec3::new(5.0, 0.0, 0.0), DVec3::new(5.0, 1.0, 0.0))
    );
    assert_eq!(at(&d.shapes[1]), DVec3::ZERO, "TransformEnd brings back the matrix, not the material");
    assert!(
        matches!(&d.shapes[1], ShapeDescription::Sphere(s) if s.material == Some(MaterialRef::Named("thindielectric 1".into())))
    );
    assert_eq!(scene.warnings.len(), 1, "the cylinder");
    SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
}

/// Textures of textures cost what is used of them: of a hundred factors on an image there is one image.
#[test]
fn chained_textures_are_worked_out_once() {
    let mut text = String::from("Texture \"t0\" \"spectrum\" \"imagemap\" \"string filename\" \"quarters.png\"\n");
    for i in 0..100 {
        let factor = if i % 2 == 0 { 0.5 } else { 1.9 };
        text += &format!(
            "Texture \"t{}\" \"spectrum\" \"scale\" \"texture tex\" \"t{i}\" \"float scale\" {factor}\n",
            i + 1
        );
    }
    let scene = read(&format!(
        "{CAMERA}WorldBegin {text} Material \"diffuse\" \"texture reflectance\" \"t100\" Shape \"sphere\" \
        Material \"diffuse\" \"texture reflectance\" \"t100\" Shape \"sphere\""
    ));
    let images: Vec<_> = scene.files.images.values().map(|i| i.rgb("").expect("colours")).collect();
    assert_eq!(images.len(), 1);
    // The corner is white: 0.95 to the power of 50.
    assert!((images[0][0][1] - 0.95_f32.powi(50)).abs() < 1e-5, "{:?}", images[0][0]);
}

/// What has to be one number is, where a texture is; of an image its mean, which is not the same.
#[test]
fn textures_of_numbers_are_numbers() {
    let flat = r#"Texture "r" "float" "constant" "float value" 0.5 Texture "s" "float" "scale" "texture tex" "r" "float scale" 0.5"#;
    let image = r#"Texture "s" "float" "imagemap" "string filename" "holes.png""#;
    let weight = |texture: &str, lenient: bool| -> Result<f32> {
        let parts = r#"MakeNamedMaterial "a" "string type" "diffuse" MakeNamedMaterial "b" "string type" "diffuse""#;
        let mix = r#"MakeNamedMaterial "m" "string type" "mix" "string materials" ["a" "b"] "texture amount" "s""#;
        let text = format!("{CAMERA}WorldBegin {texture} {parts} {mix} NamedMaterial \"m\" Shape \"sphere\"");
        let scene = read_pbrt(&text, "a.pbrt", &folder(), ImportOptions { lenient, ..ImportOptions::default() })?;
        let MaterialDescription::TwoSided { front: MaterialRef::Inline(mix), .. } = &scene.description.materials["m"]
        else {
            panic!("{:?}", scene.description.materials)
        };
        match &**mix {
            MaterialDescription::Mix { weight, .. } => Ok(*weight),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(weight(flat, false).expect("a scene"), 0.25);
    assert_eq!(weight(image, false).expect_err("an image").message, "a texture for \"amount\": its mean is");
    // Of 64 texels 16 are black.
    assert!((weight(image, true).expect("a scene") - 0.75).abs() < 1e-5);
}

/// Images of roughness are images of its root, unless they are to be taken as they are; there may be another for each direction.
#[test]
fn roughness_may_be_an_image() {
    let image = r#"Texture "s" "float" "imagemap" "string filename" "holes.png" "float scale" 0.25 Texture "t" "float" "imagemap" "string filename" "holes.png""#;
    let alpha = |parameters: &str| -> Result<(NumberTexture, Vec<f32>)> {
        let text = format!("{CAMERA}WorldBegin {image} Material \"dielectric\" {parameters} Shape \"sphere\"");
        let scene = read_pbrt(&text, "a.pbrt", &folder(), ImportOptions::default())?;
        let Some(MaterialDescription::Dielectric { alpha: Some(alpha), alpha_u: None, alpha_v: None, .. }) =
            scene.description.materials.values().next()
        else {
            panic!("{:?}", scene.description.materials)
        };
        let texels = match alpha {
            NumberTexture::Image(t) => {
                scene.files.images[&t.image].rgb("").expect("colours").iter().map(|t| t[0]).collect()
            }
            _ => Vec::new(),
        };
        Ok((alpha.clone(), texels))
    };
    for (parameters, most) in [
        (r#""texture roughness" "s""#, 0.5_f32),
        (r#""texture uroughness" "s" "texture vroughness" "s""#, 0.5),
        (r#""texture roughness" "s" "bool remaproughness" false"#, 0.25),
    ] {
        let (_, texels) = alpha(parameters).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let black = texels.iter().filter(|x| **x == 0.0).count();
        assert!(black == 16 && texels.iter().all(|x| *x == 0.0 || (x - most).abs() < 1e-6), "{parameters}: {texels:?}");
    }
    assert_eq!(alpha(r#""float roughness" 0.25"#).expect("a scene").0, NumberTexture::Constant(0.5));
    let both = |parameters: &str| {
        let text = format!("{CAMERA}WorldBegin {image} Material \"dielectric\" {parameters} Shape \"sphere\"");
        let scene = read_pbrt(&text, "a.pbrt", &folder(), ImportOptions::default())
            .unwrap_or_else(|e| panic!("{}", e.snippet()));
        let Some(MaterialDescription::Dielectric { alpha_u: Some(u), alpha_v: Some(v), .. }) =
            scene.description.materials.values().next()
        else {
            panic!("{:?}", scene.description.materials)
        };
        // The largest value, and whether it is an image's.
        [u, v].map(|alpha| match alpha {
            NumberTexture::Image(t) => {
                let texels = scene.files.images[&t.image].rgb("").expect("colours");
                (texels.iter().fold(0.0, |most, t| f32::max(most, t[0])), true)
            }
            other => (other.constant().expect("a number"), false),
        })
    };
    assert_eq!(both(r#""texture uroughness" "s" "float vroughness" 0.09"#), [(0.5, true), (0.3, false)]);
    assert_eq!(both(r#""texture uroughness" "s" "texture vroughness" "t""#), [(0.5, true), (1.0, true)]);
    assert_eq!(both(r#""texture roughness" "s" "texture vroughness" "t""#), [(0.5, true), (1.0, true)]);
    assert_eq!(both(r#""texture uroughness" "s""#), [(0.5, true), (0.0, false)]);
}

/// Images shine on meshes: round shapes become some, and triangles get coordinates.
#[test]
fn lamps_with_images_are_meshes() {
    let scene = read(&format!(
        "{CAMERA}WorldBegin AreaLightSource \"diffuse\" \"string filename\" \"quarters.png\" \"float scale\" 2
        Shape \"sphere\" Shape \"disk\" Shape \"cylinder\" Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]"
    ));
    assert_eq!((scene.warnings.len(), scene.description.shapes.len()), (3, 4), "{:?}", scene.warnings);
    for shape in &scene.description.shapes {
        let ShapeDescription::Ply(mesh) = shape else { panic!("{shape:?}") };
        let Some(MaterialRef::Inline(material)) = &mesh.material else { panic!("{mesh:?}") };
        let MaterialDescription::Glow { radiance, scale, .. } = &**material else { panic!("{material:?}") };
        assert_eq!(
            (&*radiance.image, radiance.wrap, *scale, mesh.emission),
            ("quarters.png", Wrap::Clamp, Color([2.0; 3]), None)
        );
    }
    SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
}

/// A round shape that is stretched is itself where the library can have it so, and a mesh where it cannot.
#[test]
fn stretched_spheres_are_kept_or_cut() {
    let shapes = |text: &str| {
        let scene = read(&format!("{CAMERA}WorldBegin {text}"));
        let shapes =
            [&scene.description.shapes[..], &scene.description.groups.values().flatten().cloned().collect::<Vec<_>>()]
                .concat();
        SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
        shapes.first().map(|s| matches!(s, ShapeDescription::Ply(_)))
    };
    let light = "AreaLightSource \"diffuse\"";
    assert_eq!(shapes("Scale 1 2 1 Shape \"sphere\""), Some(false));
    assert_eq!(shapes(&format!("Scale 2 2 2 {light} Shape \"sphere\"")), Some(false));
    assert_eq!(shapes(&format!("Scale 1 2 1 {light} Shape \"sphere\"")), Some(true));
    assert_eq!(shapes("Scale 1 2 1 ObjectBegin \"o\" Shape \"sphere\" ObjectEnd"), Some(true));
    assert_eq!(shapes("ObjectBegin \"o\" Shape \"sphere\" ObjectEnd"), Some(false));
    assert_eq!(shapes("Scale 1 2 1 ObjectBegin \"o\" Shape \"disk\" ObjectEnd"), Some(true));
}

#[test]
fn meshes_of_every_kind() {
    let mesh = |text: &str| {
        let scene = read(&format!("{CAMERA}WorldBegin Shape {text}"));
        let mesh = scene.files.meshes.values().next().map(|m| MeshData::clone(m)).expect("a mesh");
        SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
        mesh
    };
    let corners = "\"point3 P\" [0 0 0  1 0 0  0 1 0  1 1 0]";
    let triangles =
        mesh(&format!(r#""trianglemesh" {corners} "integer indices" [0 1 3 0 3 2] "point2 uv" [0 0 1 0 0 1 1 1]"#));
    assert_eq!(triangles.triangles, [[0, 1, 3], [0, 3, 2]]);
    assert_eq!(triangles.uvs.expect("coordinates")[3], [1.0, 1.0]);
    let patch = mesh(&format!(r#""bilinearmesh" {corners}"#));
    assert_eq!((patch.triangles.len(), patch.normals.expect("normals")[0]), (2, [0.0, 0.0, 1.0]));
    let solid = r#""loopsubdiv" "integer levels" 2 "point3 P" [1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1]
        "integer indices" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5]"#;
    assert_eq!(mesh(solid).triangles.len(), 8 * 16);
    // A packed PLY file, and one that is a bomb.
    let folder = tempfile::tempdir().expect("a folder");
    let pack = |name: &str, bytes: &[u8]| {
        let mut z = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        std::io::Write::write_all(&mut z, bytes).expect("in memory");
        std::fs::write(folder.path().join(name), z.finish().expect("in memory")).expect("a file");
    };
    pack("a.ply.gz", &crate::write_ply(&MeshData::cube()));
    pack("bomb.ply.gz", &vec![0; 1 << 24]);
    let open = |name: &str| {
        let text = format!("{CAMERA}WorldBegin Shape \"plymesh\" \"string filename\" \"{name}\"");
        read_pbrt(&text, "a.pbrt", folder.path(), ImportOptions::default())
    };
    assert_eq!(MeshData::clone(&open("a.ply.gz").expect("a scene").files.meshes["mesh.ply"]), MeshData::cube());
    let bomb = "unpacks to more than 64 times its size";
    assert!(open("bomb.ply.gz").expect_err("a bomb").message.contains(bomb));
    // The scene itself may be packed.
    pack("c.pbrt.gz", format!("{CAMERA}WorldBegin Shape \"sphere\"").as_bytes());
    pack("bomb.pbrt.gz", &vec![b' '; 1 << 24]);
    let open = |name: &str| SceneSource::open(&folder.path().join(name).display().to_string());
    std::fs::write(folder.path().join("plain.pbrt.gz"), "WorldBegin").expect("a file");
    assert!(open("plain.pbrt.gz").expect_err("no gzip").message.contains("it is not packed by gzip"));
    let scene = open("c.pbrt.gz").unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert_eq!((scene.name.as_str(), scene.description.shapes.len()), ("c", 1));
    assert!(open("bomb.pbrt.gz").expect_err("a bomb").message.contains(bomb));
}

#[test]
fn materials_textures_and_spectra() {
    let describe = |text: &str| {
        let scene = read(&format!("{CAMERA}WorldBegin {text} Shape \"disk\""));
        let source = SceneSource::imported(scene, "a");
        source.build().unwrap_or_else(|e| panic!("{}", e.snippet()));
        source.description
    };
    let is = |text: &str, wanted: &str| {
        let materials = describe(text).materials;
        let wanted = toml(&format!("materials.m = {wanted}")).materials.remove("m").expect("m");
        // Those of no name come after "a" and "b".
        assert_eq!(materials.values().next_back(), Some(&wanted), "{text}");
    };
    is(
        r#"Material "conductor" "rgb eta" [1 2 3] "rgb k" [4 5 6] "float roughness" 0.25 "bool remaproughness" false"#,
        "{ type = \"two-sided\", front = { type = \"conductor\", eta = [1, 2, 3], k = [4, 5, 6], alpha = 0.25 } }",
    );
    is(
        r#"Material "conductor" "rgb eta" [1 2 3] "rgb k" [4 5 6] "float uroughness" 0.25 "float vroughness" 0.04"#,
        "{ type = \"two-sided\", front = { type = \"conductor\", eta = [1, 2, 3], k = [4, 5, 6], alpha_u = 0.5, alpha_v = 0.2 } }",
    );
    is(
        r#"MakeNamedMaterial "a" "string type" "diffuse" MakeNamedMaterial "b" "string type" "diffuse" "rgb reflectance" [1 0 0]
           Material "mix" "string materials" ["a" "b"] "float amount" 0.25"#,
        "{ type = \"two-sided\", front = { type = \"mix\", a = { type = \"diffuse\" }, b = { type = \"diffuse\", reflectance = [1, 0, 0] }, weight = 0.25 } }",
    );
    is(
        r#"Texture "t" "spectrum" "imagemap" "string filename" "quarters.png" "float uscale" 2 "string wrap" "clamp" "string filter" "point"
           Texture "u" "spectrum" "scale" "texture tex" "t" "float scale" 1 Material "diffuse" "texture reflectance" "u""#,
        "{ type = \"two-sided\", front = { type = \"diffuse\", reflectance = { image = \"quarters.png\", wrap = \"clamp\", filter = \"nearest\", to_uv = [[2, 0, 0], [0, 1, 0]] } } }",
    );
    is(
        r#"Material "interface""#,
        "{ type = \"mask\", opacity = 0, material = { type = \"diffuse\", reflectance = 0 } }",
    );
    // Gold by name is Mitsuba's gold; glass by name is one number, with a warning.
    let gold = describe(r#"Material "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k""#);
    let text = format!("{:?}", gold.materials);
    assert!(text.contains("0.143") && text.contains("3.983"), "{text}");
    // Names that are pbrt's, and such as are not known.
    let glass = |name: &str, lenient: bool| -> Result<f32> {
        let text = format!("{CAMERA}WorldBegin Material \"dielectric\" \"spectrum eta\" \"glass-{name}\"");
        let scene = read_pbrt(&text, "a.pbrt", &folder(), ImportOptions { lenient, ..ImportOptions::default() })?;
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
        match scene.description.materials.values().next() {
            Some(MaterialDescription::Dielectric { int_ior, .. }) => Ok(*int_ior),
            other => panic!("{other:?}"),
        }
    };
    for (name, index) in [("BK7", 1.5168), ("FK51A", 1.4866), ("F5", 1.6727), ("F10", 1.7283), ("F11", 1.7847)] {
        assert_eq!(glass(name, false).expect("a scene"), index, "{name}");
    }
    assert!(glass("SF10", false).expect_err("a name").message.contains("no index of refraction is known"));
    assert_eq!(glass("SF10", true).expect("a scene"), 1.5);
    let brass = format!("{CAMERA}WorldBegin Material \"conductor\" \"spectrum eta\" \"metal-Xy-eta\"");
    assert!(strict(&brass).expect_err("a name").message.contains("no metal is known"));
    let options = ImportOptions { lenient: true, ..ImportOptions::default() };
    assert_eq!(read_pbrt(&brass, "a.pbrt", &folder(), options).expect("a scene").warnings.len(), 1);
    // A black body's light has the luminance that its scale says.
    let scene = describe(r#"LightSource "infinite" "blackbody L" 4000 "float scale" 3"#);
    let EmitterDescription::Constant { radiance: Color([r, g, b]) } = scene.emitters[0] else { panic!("a sky") };
    assert!((0.212_671 * r + 0.715_16 * g + 0.072_169 * b - 3.0).abs() < 1e-4 && r > g && g > b);
    // A masked shape.
    let masked = describe(
        r#"Texture "holes" "float" "imagemap" "string filename" "holes.png" Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "texture alpha" "holes""#,
    );
    let ShapeDescription::Ply(shape) = &masked.shapes[0] else { panic!("a mesh") };
    assert!(format!("{:?}", shape.material).contains("Mask"));
}

/// The names that materials without one get are none of the scene's, even if it comes to those later.
#[test]
fn materials_without_a_name_take_none() {
    let scene = read(&format!(
        r#"{CAMERA}WorldBegin Material "diffuse" "rgb reflectance" [1 0 0] Shape "sphere"
        MakeNamedMaterial "diffuse 1" "string type" "diffuse" "rgb reflectance" [0 1 0] NamedMaterial "diffuse 1" Shape "sphere""#
    ));
    let d = scene.description;
    let of = |i: usize| match &d.shapes[i] {
        ShapeDescription::Sphere(s) => match &s.material {
            Some(MaterialRef::Named(name)) => (name.as_str(), format!("{:?}", d.materials[name])),
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    };
    assert!(of(0).0 == "diffuse 1-2" && of(0).1.contains("[1.0, 0.0, 0.0]"), "{:?}", of(0));
    assert!(of(1).0 == "diffuse 1" && of(1).1.contains("[0.0, 1.0, 0.0]"), "{:?}", of(1));
}

#[test]
fn what_says_nothing_is_accepted() {
    let film = |more: &str| strict(&format!("\u{feff}Film \"rgb\" {more} {CAMERA}WorldBegin"));
    let scene = film("\"float iso\" 100 \"float exposuretime\" 1 \"float cropwindow\" [0 1 0 1]");
    assert!(scene.unwrap_or_else(|e| panic!("{}", e.snippet())).warnings.is_empty());
    let of = |more: &str| film(&format!("\"integer xresolution\" 60 \"integer yresolution\" 40 {more}"));
    let scene = of("\"float cropwindow\" [0.25 0.5 0.51 2]").expect("a part").description;
    assert_eq!((scene.film.width, scene.film.height), (15, 19), "from 20.4, so from 21, to 40");
    for (wrong, message) in [
        ("\"float cropwindow\" [0.5 0.5 0 1]", "nothing of the picture is left"),
        ("\"integer pixelbounds\" [0 1 70 80]", "nothing of the picture is left"),
        ("\"integer pixelbounds\" [0 1 70]", "a pixelbounds is four numbers"),
        (
            "\"integer pixelbounds\" [0 1 7 8] \"float cropwindow\" [0 1 0 1]",
            "either pixelbounds or a cropwindow, not both",
        ),
    ] {
        assert_eq!(of(wrong).expect_err(wrong).message, message);
    }
    assert_eq!(film("\"float iso\" 200").expect_err("an exposure").message, "a film's iso");
    let mesh = r#"WorldBegin Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "vector3 S" [1 0 0 1 0 0 1 0 0]"#;
    assert_eq!(read(&format!("{CAMERA}{mesh}")).warnings.len(), 1);
}

#[test]
fn mistakes_have_their_places() {
    let fails = |text: &str| {
        let error = match strict(&format!("{CAMERA}WorldBegin {text}")) {
            Err(e) => e,
            Ok(scene) => SceneSource::imported(scene, "a").build().map(|_| ()).expect_err(text),
        };
        assert_eq!((error.line(), error.file.as_deref()), (Some(2), Some("a.pbrt")), "{error}");
        (error.column().unwrap_or(0), error.message)
    };
    let say = |column: usize, message: &str| (column, message.to_string());
    assert_eq!(fails("Shap \"sphere\""), say(12, "Shap is no directive of pbrt-v4"));
    assert_eq!(fails("Shape \"bunny\""), say(18, "the shape \"bunny\" is not supported"));
    assert_eq!(
        fails("Shape \"sphere\" \"float radios\" 2"),
        say(27, "\"radios\" means nothing to the shape \"sphere\"")
    );
    assert_eq!(fails("Shape \"sphere\" \"float radius\" two"), say(42, "\"two\" is not a number"));
    assert_eq!(fails("Shape \"sphere\" \"float radius\" -2"), say(18, "a sphere of radius -2"));
    assert_eq!(
        fails("AreaLightSource \"diffuse\" \"string filename\" \"quarters.png\" \"rgb L\" [1 1 1]"),
        say(71, "an area light has either L or an image, not both")
    );
    assert_eq!(fails("Translate 1 2"), say(24, "expected 3 numbers"));
    assert_eq!(fails("Material \"diffuse"), say(21, "a quote without its end"));
    assert_eq!(fails("Material \"dif\\quse\""), say(21, "a backslash that means nothing: \\\\ stands for one"));
    assert_eq!(fails("Shape \"a\\\"b\"").1, "the shape \"a\"b\" is not supported");
    assert_eq!(fails("AttributeEnd"), say(12, "AttributeEnd without a beginning"));
    assert_eq!(fails("AttributeBegin TransformEnd"), say(27, "TransformEnd, where what began last is AttributeBegin"));
    assert_eq!(fails("TransformBegin AttributeEnd").0, 27);
    assert_eq!(fails("AttributeBegin"), say(12, "this does not end"));
    assert_eq!(fails("Include \"no.pbrt\"").0, 20);
    assert!(fails("Include \"../../../../src/lib.rs\"").1.contains("--allow-outside"));
    assert_eq!(
        fails("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]").1,
        "an index that is none of the 3 points"
    );
    let fine =
        "Shape \"loopsubdiv\" \"integer levels\" 30 \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2]";
    assert!(fails(fine).1.contains("would come to more than"), "{}", fails(fine).1);
    let projective = "Transform [1 0 0 0 0 1 0 0 0 0 1 0.5 0 0 0 1]";
    assert_eq!(fails(projective), say(12, "this transform is not affine"));
    for stretched in ["Scale 1 2 1", "ConcatTransform [1 0 0 0 0.5 1 0 0 0 0 1 0 0 0 0 1]"] {
        let fails = |light: &str| fails(&format!("{stretched} LightSource {light}")).1;
        assert!(
            fails("\"infinite\" \"string filename\" \"sky.pfm\"").contains("not stretched or sheared"),
            "{stretched}"
        );
        assert!(fails("\"spot\"").contains("a spot whose cone is stretched"), "{stretched}");
    }
    for flat in ["Scale 0 0 0", "Scale 1 0 1", "Transform [0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1]"] {
        let error = strict(&format!("{flat}\n{CAMERA}WorldBegin")).expect_err(flat);
        assert_eq!((error.line(), &*error.message), (Some(2), "the camera's transform has no inverse"), "{flat}");
    }
    assert!(strict("WorldBegin").is_err_and(|e| e.message == "the scene has no Camera"));
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("b.pbrt"), "Include \"b.pbrt\" Include \"b.pbrt\"").expect("a file");
    let error = read_pbrt("Include \"b.pbrt\"", "a.pbrt", folder.path(), ImportOptions::default()).expect_err("no end");
    assert!(error.message.contains("files within files without end"), "{error}");
    let lenient = ImportOptions { lenient: true, ..ImportOptions::default() };
    let scene = read_pbrt(
        &format!("{CAMERA}WorldBegin Shape \"curve\" \"float width\" 1 Shape \"sphere\""),
        "a.pbrt",
        folder.path(),
        lenient,
    );
    let scene = scene.unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert_eq!((scene.warnings.len(), scene.description.shapes.len()), (1, 1), "{:?}", scene.warnings);
}
