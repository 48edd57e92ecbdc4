//! Bad scenes and bad command lines: each ends with exit code 2, one report on standard error that names the place and
//! says what is wrong, nothing on standard output, and no file.

use std::path::Path;
use std::process::{Command, Output};

/// A scene that is right. Each of the mistakes below changes one part of it.
const GOOD: &str = r#"title = "A good scene"

[camera]
type = "thin-lens"
fov = 40
aperture_radius = 0.1
focus_distance = 4
shutter_open = 0
shutter_close = 1
to_world.look_at = { origin = [0, 1, 4], target = [0, 0, 0], up = [0, 1, 0] }

[film]
width = 8
height = 6
filter = { type = "tent", radius = 1 }

[sampler]
type = "sobol"

[integrator]
type = "path"
max_depth = 4

[materials]
grey = { type = "diffuse", reflectance = 0.5 }
shiny = { type = "phong", exponent = 20, reflectance = [0.2, 0.3, 0.4] }
both = { type = "mix", a = "grey", b = "shiny", weight = 0.5 }

[[groups.pair]]
type = "cube"
material = "grey"

[[shapes]]
type = "mesh"
material = "both"
positions = [[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]
faces = [[0, 1, 2, 3]]
normals = [[0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0]]

[[shapes]]
type = "sphere"
material = "shiny"
radius = 0.5

[[shapes]]
type = "instance"
group = "pair"
to_world = [{ scale = 0.2 }, { translate = [1, 0.5, 0] }]

[[shapes]]
type = "rectangle"
emission = 5
to_world = [{ rotate = { axis = [1, 0, 0], angle = 90 } }, { translate = [0, 3, 0] }]

[[emitters]]
type = "point"
position = [0, 2, 2]
intensity = 10
"#;

/// Shapes and lights of the good scene that give way to files.
const BALL: &str = "type = \"sphere\"\nmaterial = \"shiny\"\nradius = 0.5";
const LAMP: &str = "type = \"point\"\nposition = [0, 2, 2]\nintensity = 10";

/// What to replace in the good scene; by what, with an `@` before the place that the report must name; what the report
/// must say.
type Mistake = (&'static str, &'static str, &'static str);

const KEYS: &[Mistake] = &[
    (r#"title = "A good scene""#, "@tilte = 1", r#"did you mean "title"?"#),
    (r#"title = "A good scene""#, "title = @1", "expected text in quotes, found the whole number 1"),
    ("fov = 40", "@fvo = 40", r#"unknown key "fvo""#),
    ("fov = 40", "@fvo = 40", r#"did you mean "fov"?"#),
    ("width = 8", "@widht = 8", r#"did you mean "width"?"#),
    ("radius = 0.5", "@radus = 0.5", r#"did you mean "radius"?"#),
    ("emission = 5", "@radiance = 5", r#"unknown key "radiance""#),
    ("exponent = 20", "exponent = 20, @roughness = 1", "valid keys: reflectance, exponent, form"),
    ("reflectance = 0.5", "@refectance = 0.5", r#"did you mean "reflectance"?"#),
    ("intensity = 10", "intensity = 10\n@radius = 1", r#"unknown key "radius""#),
    ("{ scale = 0.2 }", "{ @scael = 0.2 }", r#"did you mean "scale"?"#),
    ("angle = 90", "angle = 90, @center = [0, 0, 0]", r#"unknown key "center""#),
    ("up = [0, 1, 0]", "@upp = [0, 1, 0]", r#"did you mean "up"?"#),
    ("max_depth = 4", "@max_dept = 4", r#"did you mean "max_depth"?"#),
    ("radius = 1 }", "@stddev = 1 }", r#"unknown key "stddev""#),
    (r#"type = "sobol""#, "type = \"sobol\"\n@samples = 4", r#"unknown key "samples""#),
    (r#""diffuse", reflectance = 0.5"#, r#""oren-nayar", @sigma = 20"#, "valid keys: reflectance, roughness"),
    (r#""diffuse", reflectance = 0.5"#, r#""thin-dielectric", @alpha = 0.1"#, "valid keys: int_ior, ext_ior, tint"),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""ashikhmin-shirley", exponent_u = 1, exponent_v = 1, @reflectance = 1"#,
        "valid keys: diffuse_reflectance, specular_reflectance, exponent_u, exponent_v",
    ),
    (r#""diffuse", reflectance = 0.5"#, r#""plastic", @reflectance = 1"#, "valid keys: diffuse_reflectance, int_ior"),
    (r#""diffuse", reflectance = 0.5"#, r#""principled", @metalic = 1"#, r#"did you mean "metallic"?"#),
    // Missing ones are missed where they belong.
    ("{ type = \"phong\", exponent = 20,", "@{ type = \"phong\",", r#"the key "exponent" is missing"#),
    (r#"{ type = "mix", a = "grey","#, r#"@{ type = "mix","#, r#"the key "a" is missing"#),
    ("[camera]\ntype = \"thin-lens\"", "@[camera]", r#"the key "type" is missing"#),
    (
        "[[emitters]]\ntype = \"point\"\nposition = [0, 2, 2]",
        "@[[emitters]]\ntype = \"point\"",
        r#"the key "position" is missing"#,
    ),
    ("[[emitters]]\ntype = \"point\"", "@[[emitters]]", r#"the key "type" is missing"#),
    (
        "[[shapes]]\ntype = \"instance\"\ngroup = \"pair\"",
        "@[[shapes]]\ntype = \"instance\"",
        r#"the key "group" is missing"#,
    ),
    ("{ origin = [0, 1, 4], target = [0, 0, 0],", "@{ origin = [0, 1, 4],", r#"the key "target" is missing"#),
];

const TYPES: &[Mistake] = &[
    (r#""thin-lens""#, r#"@"fisheye""#, "valid types: perspective, thin-lens, orthographic"),
    (r#""tent""#, r#"@"lanczos""#, "valid types: box, tent, gaussian, mitchell, blackman-harris"),
    (r#""sobol""#, r#"@"halton""#, "valid types: sobol, lattice, independent, stratified"),
    (r#""path""#, r#"@"pathh""#, r#"did you mean "path"?"#),
    (r#""diffuse""#, r#"@"difuse""#, r#"did you mean "diffuse"?"#),
    (r#""sphere""#, r#"@"shpere""#, r#"did you mean "sphere"?"#),
    (
        r#""point""#,
        r#"@"area""#,
        "valid types: point, spot, projector, goniometric, directional, directional-area, constant, envmap",
    ),
    ("fov = 40", "fov = @\"wide\"", r#"expected a number, found the text "wide""#),
    ("width = 8", "width = @8.5", "expected a whole number, found the number 8.5"),
    ("width = 8", "width = @-8", "expected a whole number that is not negative"),
    ("width = 8", "width = @{ pixels = 8 }", "expected a whole number, found a table"),
    ("radius = 0.5", "radius = @[0.5]", "expected a number, found an array"),
    ("reflectance = 0.5", "reflectance = @\"grey\"", "expected a number, three of them, or a table"),
    ("[0.2, 0.3, 0.4]", "@[0.2, 0.3]", "expected a number or three of them, found 2 values"),
    ("position = [0, 2, 2]", "position = @[0, 2]", "expected an array of 3 values, found 2 values"),
    ("[[-1, 0, -1],", "[@[-1, 0, -1, 1],", "expected an array of 3 values, found 4 values"),
    ("{ scale = 0.2 }", "@5", "expected"),
    (r#"material = "both""#, "material = @3", "expected the name of a material, or a table that describes one"),
    ("[0, 2, 2]", "[0, @nan, 2]", "expected a number, found `nan`"),
    ("intensity = 10", "intensity = @inf", "expected a finite number, found an infinite one"),
    ("intensity = 10", "intensity = [1, @-inf, 1]", "expected a finite number, found an infinite one"),
    ("fov = 40", "fov = @1e39", "too large for single precision"),
    ("[[-1, 0, -1],", "[[@nan, 0, -1],", "expected a number, found `nan`"),
];

const VALUES: &[Mistake] = &[
    ("max_depth = 4", "max_depth = @0", "expected a whole number of 1 or more, found the whole number 0"),
    (
        "[integrator]\ntype = \"path\"\nmax_depth = 4",
        "[@integrator]\ntype = \"vcm\"\nradius = 0",
        "radius = 0 is not above 0",
    ),
    ("width = 8", "@width = 0", "a film 0 pixels wide"),
    ("height = 6", "@height = 0", "a film 0 pixels high"),
    ("width = 8\nheight = 6", "@width = 0\nheight = 0", "a film 0 pixels wide"),
    ("width = 8", "@width = 65537", "a film 65537 pixels wide"),
    ("[film]\nwidth = 8\nheight = 6", "[@film]\nwidth = 20000\nheight = 20000", "more than"),
    ("filter = { type = \"tent\", radius = 1 }", "@filter = { type = \"tent\", radius = 0 }", "the filter's radius"),
    (
        "filter = { type = \"tent\", radius = 1 }",
        "@filter = { type = \"gaussian\", stddev = 0, radius = 1 }",
        "a Gaussian",
    ),
    ("fov = 40", "@fov = 0", "0 is no field of view"),
    ("fov = 40", "@fov = 180", "give degrees between 0 and 180"),
    ("aperture_radius = 0.1", "@aperture_radius = -0.1", "-0.1 is no radius of a lens"),
    (
        "aperture_radius = 0.1",
        "aperture_radius = 0.1\n@aperture_blades = 2",
        "give 3 to 64 blades, or 0 for a round opening",
    ),
    ("fov = 40", "fov = 40\n@near_clip = -1", "-1 is no distance in front of the camera"),
    ("fov = 40", "fov = 40\n@principal_point_offset = [1e9, 0]", "1000000000 is no offset of a picture"),
    ("focus_distance = 4", "@focus_distance = 0", "0 is no distance"),
    ("shutter_close = 1", "@shutter_close = -1", "the shutter closes before it opens"),
    ("target = [0, 0, 0]", "@target = [0, 1, 4]", "`target` and `origin` are the same point"),
    ("up = [0, 1, 0]", "@up = [0, 1, 4]", "`up` is zero or along the direction of view"),
    ("axis = [1, 0, 0]", "@axis = [0, 0, 0]", "the axis of a rotation is zero"),
    ("reflectance = 0.5", "@reflectance = 1.01", "a reflectance lies within [0, 1]"),
    ("reflectance = 0.5", "@reflectance = [0.5, -0.1, 0.5]", "a reflectance lies within [0, 1]"),
    ("exponent = 20", "@exponent = -1", "-1 is no exponent"),
    ("weight = 0.5", "@weight = 1.5", "1.5 is no weight"),
    (r#""diffuse", reflectance = 0.5"#, r#""conductor", @alpha_u = 2"#, "2 is no roughness"),
    (r#""diffuse", reflectance = 0.5"#, r#""conductor", @alpha = -1"#, "-1 is no roughness"),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""conductor", alpha_u = 0.2, alpha_v = 0.1, @alpha = 0"#,
        "`alpha` beside `alpha_u` and `alpha_v`",
    ),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""dielectric", @alpha = 0.3, alpha_u = 0.2, alpha_v = 0.1"#,
        "`alpha` beside `alpha_u` and `alpha_v`",
    ),
    (
        r#"grey = { type = "diffuse", reflectance = 0.5 }"#,
        r#"@grey = { type = "conductor", eta = 1 }"#,
        "both `eta` and `k`",
    ),
    (r#""diffuse", reflectance = 0.5"#, r#""dielectric", @int_ior = 0"#, "0 is no index of refraction"),
    (r#""diffuse", reflectance = 0.5"#, r#""oren-nayar", @roughness = 1.5"#, "1.5 is no roughness"),
    (r#""diffuse", reflectance = 0.5"#, r#""oren-nayar", @reflectance = 2"#, "a reflectance lies within [0, 1]"),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""ashikhmin-shirley", exponent_u = 1, @exponent_v = -2"#,
        "-2 is no exponent",
    ),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""ashikhmin-shirley", exponent_u = 1, exponent_v = 1, @specular_reflectance = [0, 0, 3]"#,
        "a reflectance lies within [0, 1]",
    ),
    (r#""diffuse", reflectance = 0.5"#, r#""thin-dielectric", @ext_ior = 1e9"#, "1000000000 is no index of refraction"),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""conductor", alpha_u = 0.2, alpha_v = 0.1, @compensate = true"#,
        "compensation of an anisotropic metal",
    ),
    (r#""diffuse", reflectance = 0.5"#, r#""plastic", @alpha = 1.1"#, "1.1 is no roughness"),
    (r#""diffuse", reflectance = 0.5"#, r#""plastic", @int_ior = 0.9"#, "a coat of lower index"),
    (r#""diffuse", reflectance = 0.5"#, r#""principled", @metallic = -0.1"#, "-0.1 is no share of metal"),
    (r#""diffuse", reflectance = 0.5"#, r#""principled", @ior = 0.5"#, "0.5 is no index of refraction"),
    (r#""diffuse", reflectance = 0.5"#, r#""principled", @base_color = 1.5"#, "a reflectance lies within [0, 1]"),
    ("emission = 5", "@emission = -5", "light is finite and not negative"),
    ("intensity = 10", "@intensity = [1, -1, 1]", "light is finite and not negative"),
    (LAMP, "type = \"constant\"\n@radiance = -1", "light is finite and not negative"),
    (LAMP, "type = \"envmap\"\nfile = \"bright.pfm\"\n@scale = 0", "0 is no factor on light"),
    (LAMP, "type = \"directional\"\nirradiance = 1\n@direction = [0, 0, 0]", "the direction is zero"),
    (LAMP, "type = \"spot\"\nintensity = 1\nto_world = {translate = [0, 1, 0]}\n@cutoff_angle = 0", "0 is no angle"),
    (
        LAMP,
        "type = \"projector\"\nfile = \"bright.pfm\"\nintensity = 1\nto_world = {translate = [0, 1, 0]}\n@fov = 180",
        "180 is no field of view",
    ),
    (
        LAMP,
        "type = \"projector\"\nfile = \"bright.pfm\"\nintensity = 1\nto_world = {translate = [0, 1, 0]}\n@beam_width = 10",
        "a beam without a `cutoff_angle`",
    ),
    (
        LAMP,
        "type = \"projector\"\nfile = \"bright.pfm\"\nintensity = 1\nto_world = {translate = [0, 1, 0]}\ncutoff_angle = 10\n@beam_width = 20",
        "20 is no beam",
    ),
    (
        LAMP,
        "type = \"projector\"\nfile = \"bright.pfm\"\nintensity = 1\nto_world = {translate = [0, 1, 0]}\n@aspect = 0",
        "0 is no width over height",
    ),
    (
        LAMP,
        "type = \"goniometric\"\nfile = \"bright.pfm\"\nintensity = 1\n@to_world = {matrix = [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}",
        "can be turned and mirrored, but not sheared",
    ),
    (LAMP, "type = \"goniometric\"\nfile = \"bright.pfm\"\n@intensity = -1", "light is finite and not negative"),
    (
        LAMP,
        "type = \"projector\"\nfile = \"bright.pfm\"\nintensity = 1\n@to_world = {scale = [1, 2, 1]}",
        "can be turned and mirrored, but not stretched",
    ),
    (
        LAMP,
        "type = \"directional-area\"\nirradiance = 1\n@to_world = {scale = 1e-20}",
        "the transform leaves the light no area",
    ),
    (LAMP, "type = \"directional-area\"\n@irradiance = -1", "light is finite and not negative"),
    (LAMP, "type = \"directional-area\"\nirradiance = 1\nshape = @\"sphere\"", "sphere"),
    ("radius = 0.5", "@radius = 0", "a sphere of radius 0"),
    ("radius = 0.5", "@radius = -0.5", "a sphere of radius -0.5"),
    ("{ scale = 0.2 }", "{ @scale = 0 }", "scaling by 0"),
    ("angle = 90 } }", "angle = 90 } }, { @scale = [1, 0, 1] }", "scaling by 0"),
    ("{ scale = 0.2 }", "@{ scale = 0.2, translate = [0, 0, 0] }", "several operations in one step"),
    ("{ scale = 0.2 }", "@{}", "an empty step in a transform"),
    ("{ scale = 0.2 }", "{ @matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]] }", "the matrix is singular"),
    ("{ scale = 0.2 }", "{ @matrix = [[1, 0, 0, 0], [0, 1, 0, 0]] }", "a matrix has three or four rows"),
    (
        "{ scale = 0.2 }",
        "{ @matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]] }",
        "the last row of an affine matrix",
    ),
    ("{ scale = 0.2 }", "{ keyframes = [{ time = 0 }, { @time = 0 }] }", "the times of keyframes must increase"),
    ("{ scale = 0.2 }", "{ @keyframes = [{ time = 0 }] }", "a motion needs two keyframes"),
    (
        "radius = 0.5",
        "radius = 0.5\n@emission = 1\nto_world = [{ keyframes = [{ time = 0 }, { time = 1, to_world = { scale = [1, 2, 1] } }] }]",
        "a sphere stretched out of round cannot shine",
    ),
    ("to_world = [{ scale = 0.2 }", "@to_world = [{ scale = 1e30 }, { scale = 1e30 }", "the transform is not finite"),
    (
        "to_world = [{ scale = 0.2 }",
        "@to_world = [{ keyframes = [{ time = 0 }, { time = 1, to_world = { scale = [-1, 1, 1] } }] }",
        "flattens the shape",
    ),
    ("faces = [[0, 1, 2, 3]]", "faces = [@[0, 1, 2, 4]]", "vertex 4 of a mesh that has 4"),
    ("faces = [[0, 1, 2, 3]]", "faces = [[0, 1, 2], @[0, 1]]", "a face of 2 vertices"),
    ("normals = [[0, 1, 0], ", "@normals = [", "3 normals for 4 positions"),
    ("normals =", "@uvs = [[0, 0]]\nnormals =", "1 uvs for 4 positions"),
    // Lights of zero area.
    ("[0, 1, 2, 3]]", "[0, 1, 1]]\n@emission = 1", "a light of zero area"),
    (
        "{ rotate = { axis = [1, 0, 0], angle = 90 } }",
        "{ @matrix = [[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]] }",
        "the matrix is singular",
    ),
    ("to_world = [{ rotate", "to_world = [{ @scale = [0, 1, 1] }, { rotate", "scaling by 0"),
];

const HOLES: &[Mistake] = &[
    (r#""diffuse", reflectance = 0.5"#, r#""mask", material = { type = "mirror" }, @opacity = 2"#, "2 is no opacity"),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""mask", material = { type = "mirror" }, @opacity = [0, 1, 1]"#,
        "an opacity is one number",
    ),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""mask", material = { type = "mirror" }, opacity = { @image = "none.png" }"#,
        "none.png",
    ),
    (
        r#"{ type = "mix", a = "grey","#,
        r#"{ type = "mix", @a = { type = "mask", opacity = 1, material = "grey" },"#,
        "a mask within another material",
    ),
    (
        r#"{ type = "mix", a = "grey", b = "shiny", weight = 0.5 }"#,
        r#"{ type = "two-sided", @front = { type = "mask", opacity = 1, material = "grey" } }"#,
        "a mask within another material",
    ),
    (
        BALL,
        "type = \"sphere\"\n@material = { type = \"mask\", opacity = { image = \"grey.pfm\" }, material = \"grey\" }",
        "an image of opacity on a sphere",
    ),
    (
        "emission = 5",
        "@emission = 5\nmaterial = { type = \"mask\", opacity = 0.5, material = \"grey\" }",
        "a shape with holes cannot shine",
    ),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""bump-map", material = { type = "mirror" }, scale = 1, bump_map = { @image = "bright.pfm" }"#,
        "values of a map lie within [0, 1]",
    ),
    (
        r#""diffuse", reflectance = 0.5"#,
        r#""normal-map", @material = { type = "two-sided", front = "shiny" }, normal_map = { image = "grey.pfm" }"#,
        "a two-sided material under a map",
    ),
    (
        r#"{ type = "diffuse", reflectance = 0.5 }"#,
        r#"@{ type = "bump-map", material = "shiny", bump_map = { image = "grey.pfm" } }"#,
        r#"the key "scale" is missing"#,
    ),
];

const NAMES: &[Mistake] = &[
    (r#"material = "both""#, r#"@material = "bothh""#, r#"did you mean "both"?"#),
    (r#"material = "both""#, r#"@material = "gold""#, "there are: both, grey, shiny"),
    (r#"a = "grey""#, r#"@a = "gray""#, r#"did you mean "grey"?"#),
    (r#"a = "grey""#, r#"@a = "both""#, r#"the material "both" contains itself"#),
    (r#"group = "pair""#, r#"@group = "pear""#, r#"did you mean "pair"?"#),
    ("material = \"grey\"\n", "material = \"grey\"\n@emission = 1\n", "a shape within a group cannot shine"),
    (
        "[[groups.pair]]\ntype = \"cube\"\nmaterial = \"grey\"",
        "@[[groups.pair]]\ntype = \"instance\"\ngroup = \"pair\"",
        "an instance within a group",
    ),
];

const FILES: &[Mistake] = &[
    (BALL, "type = \"ply\"\n@file = \"none.ply\"", "cannot read"),
    (BALL, "type = \"obj\"\n@file = \"none.obj\"", "none.obj"),
    (BALL, "type = \"ply\"\n@file = \"folder\"", "cannot read"),
    (BALL, "type = \"ply\"\n@file = \"corrupt.ply\"", "not a valid PLY mesh"),
    (BALL, "type = \"ply\"\n@file = \"short.ply\"", "it ends too early"),
    (BALL, "type = \"ply\"\n@file = \"index.ply\"", "its vertex 7 is none of the 3 vertices"),
    (BALL, "type = \"obj\"\n@file = \"index.obj\"", "index.obj:4:7"),
    (BALL, "type = \"obj\"\n@file = \"edge.obj\"", "a face of 2 vertices"),
    (BALL, "type = \"obj\"\n@file = \"empty.obj\"", "it has no vertices"),
    ("reflectance = 0.5", "reflectance = { @image = \"none.png\" }", "none.png"),
    ("reflectance = 0.5", "reflectance = { @image = \"cut.png\" }", "not a valid PNG image"),
    ("reflectance = 0.5", "reflectance = { @image = \"index.obj\" }", "not an image of a known format"),
    ("reflectance = 0.5", "reflectance = { @image = \"bright.pfm\" }", "above 1"),
    ("reflectance = 0.5", "reflectance = { @imag = \"none.png\" }", r#"did you mean "image"?"#),
    (LAMP, "type = \"envmap\"\n@file = \"none.hdr\"", "none.hdr"),
];

/// The files that mistakes name.
fn write_files(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file");
    let ply = |faces: &str| {
        let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let header = format!("{header}element face 1\nproperty list uchar int vertex_indices\nend_header\n");
        format!("{header}0 0 0\n1 0 0\n0 1 0\n{faces}")
    };
    std::fs::create_dir(folder.join("folder")).expect("a folder");
    write("corrupt.ply", b"ply\nformat ascii 1.0\nelement vertex three\nend_header\n");
    write("short.ply", ply("3 0 1").as_bytes());
    write("index.ply", ply("3 0 1 7\n").as_bytes());
    write("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    write("edge.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n");
    write("empty.obj", b"# nothing\n");
    let png = include_bytes!("../../../scenes/checker.png");
    write("cut.png", &png[..png.len() / 2]);
    write("grey.pfm", &[b"PF\n1 1\n-1.0\n".as_slice(), &0.5f32.to_le_bytes().repeat(3)].concat());
    write("bright.pfm", &[b"PF\n1 1\n-1.0\n".as_slice(), &2f32.to_le_bytes().repeat(3)].concat());
}

fn rebond(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rebond")).args(arguments).current_dir(folder).output().expect("the program runs")
}

/// Every file of a folder with its size.
fn listing(folder: &Path) -> Vec<(String, u64)> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry"));
    let mut all: Vec<_> =
        entries.map(|e| (e.file_name().to_string_lossy().into_owned(), e.metadata().expect("a size").len())).collect();
    all.sort();
    all
}

/// What is wrong with how the program refused these arguments, if anything. `place` is what follows the arrow.
fn refusal(folder: &Path, arguments: &[&str], says: &str, place: Option<&str>) -> Result<(), String> {
    let before = listing(folder);
    let output = rebond(folder, arguments);
    let report = String::from_utf8_lossy(&output.stderr).into_owned();
    let check = |right: bool, what: &str| {
        if right { Ok(()) } else { Err(format!("{what}\n  arguments: {arguments:?}\n{report}")) }
    };
    check(output.status.code() == Some(2), &format!("ends with {:?} instead of exit code 2", output.status))?;
    check(output.stdout.is_empty(), "something on standard output")?;
    check(report.starts_with("error:") && report.matches("error:").count() == 1, "not exactly one report")?;
    check(!report.contains("panicked"), "a panic")?;
    check(report.contains(says), &format!("does not say \"{says}\""))?;
    check(listing(folder) == before, "a file was written")?;
    let arrow = report.lines().find_map(|l| l.trim_start().strip_prefix("--> "));
    check(arrow == place, &format!("the place is {arrow:?} instead of {place:?}"))
}

fn report(failures: Vec<String>) {
    assert!(failures.is_empty(), "{} failures:\n\n{}", failures.len(), failures.join("\n\n"));
}

/// Makes each of the mistakes in the good scene and renders it.
fn refuse_all(mistakes: &[Mistake]) {
    let folder = tempfile::tempdir().expect("a folder");
    write_files(folder.path());
    let mut failures = Vec::new();
    for (what, by, says) in mistakes {
        assert_eq!(GOOD.matches(what).count(), 1, "{what:?} is to be replaced");
        let marked = GOOD.replace(what, by);
        let (before, _) = marked.split_once('@').unwrap_or_else(|| panic!("no place in {by:?}"));
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
        std::fs::write(folder.path().join("bad.toml"), marked.replace('@', "")).expect("a scene file");
        let place = format!("bad.toml:{line}:{column}");
        let refused = refusal(folder.path(), &["render", "bad.toml"], says, Some(&place));
        failures.extend(refused.err().map(|failure| format!("{by}: {failure}")));
    }
    report(failures);
}

#[test]
fn the_good_scene_is_good() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("good.toml"), GOOD).expect("a scene file");
    let output = rebond(folder.path(), &["render", "good.toml", "--spp", "1"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(said, "note: biased: paths of more than max_depth=4 segments are left out\n", "no warning");
}

#[test]
fn wrong_and_missing_keys() {
    refuse_all(KEYS);
}

#[test]
fn wrong_types() {
    refuse_all(TYPES);
}

#[test]
fn wrong_values() {
    refuse_all(VALUES);
}

#[test]
fn wrong_holes_and_maps() {
    refuse_all(HOLES);
}

#[test]
fn wrong_names() {
    refuse_all(NAMES);
}

#[test]
fn bad_files() {
    refuse_all(FILES);
}

/// A whole file, what the report must say, and the place it must name.
const TEXTS: &[(&[u8], &str, &str)] = &[
    (b"[camera\nfov = 40\n", "not valid TOML", "bad.toml:1:8"),
    (b"[film]\nwidth = \n", "not valid TOML", "bad.toml:2:9"),
    (b"title = 'one'\ntitle = 'two'\n", "not valid TOML: duplicate key", "bad.toml:2:1"),
    (b"[film]\nwidth = 8\n[film]\nheight = 8\n", "not valid TOML: duplicate key", "bad.toml:3:2"),
    (b"title = 2026-10-01\n", "dates and times mean nothing here", "bad.toml:1:9"),
    (b"[film]\nwidth = 99999999999999999999\n", "is too large", "bad.toml:2:9"),
    (b"[film]\n# caf\xe9\nwidth = 8\n", "not UTF-8 text", "bad.toml:2:6"),
    (b"\xff\xfet\0i\0t\0l\0e\0", "not UTF-8 text", "bad.toml:1:1"),
    (b"\x89PNG\r\n\x1a\n", "not UTF-8 text", "bad.toml:1:1"),
    (b"shapes = 3\n", "expected an array, found the whole number 3", "bad.toml:1:10"),
    (b"\xef\xbb\xbffilm = 'big'\n", "expected a table", "bad.toml:1:8"),
];

#[test]
fn texts_that_are_no_scenes() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut failures = Vec::new();
    for (text, says, place) in TEXTS {
        std::fs::write(folder.path().join("bad.toml"), text).expect("a scene file");
        failures.extend(refusal(folder.path(), &["render", "bad.toml"], says, Some(place)).err());
    }
    report(failures);
}

/// Arguments, what the report must say, and the place it must name, if any.
const COMMANDS: &[(&[&str], &str, Option<&str>)] = &[
    (&["render", "cornel-box"], r#"did you mean "cornell-box"?"#, None),
    (&["render", "xyzzy"], "built-in scenes: caustic-mirror, cornell-box, cornell-spheres", None),
    (&["render", "none.toml"], "cannot read", None),
    (&["render", "folder.toml"], "cannot read", None),
    (&["render", "picture.png"], "scene files end in .toml", None),
    (&["info", "cornel-box"], r#"did you mean "cornell-box"?"#, None),
    (&["render", "furnace", "-i", "paht"], r#"did you mean "path"?"#, Some("column 1 of `paht`")),
    (
        &["render", "furnace", "-i", "path:max_dept=3"],
        r#"did you mean "max_depth"?"#,
        Some("column 6 of `path:max_dept=3`"),
    ),
    (
        &["render", "furnace", "-i", "path:max_depth=deep"],
        "expected a whole number",
        Some("column 16 of `path:max_depth=deep`"),
    ),
    (&["render", "furnace", "-i", "path:max_depth=-1"], "not negative", Some("column 16 of `path:max_depth=-1`")),
    (&["render", "furnace", "-i", "vcm:radius=0"], "vcm:radius=0: radius = 0 is not above 0", None),
    (&["render", "furnace", "-i", "path:mode=best"], r#"unknown value "best""#, Some("column 11 of `path:mode=best`")),
    (&["render", "furnace", "-i", "path:max_depth"], "has no value", Some("column 6 of `path:max_depth`")),
    (&["render", "furnace", "-i", ""], "a name is missing", Some("column 1 of ``")),
    (&["bsdf", "phnog:exponent=3"], r#"did you mean "phong"?"#, Some("column 1 of `phnog:exponent=3`")),
    (&["bsdf", "phong"], r#"the key "exponent" is missing"#, Some("column 1 of `phong`")),
    (&["bsdf", "phong:exponent=-3"], "-3 is no exponent", Some("column 7 of `phong:exponent=-3`")),
    (&["bsdf", "diffuse:reflectance=[1,2,0]"], "within [0, 1]", Some("column 9 of `diffuse:reflectance=[1,2,0]`")),
    (&["bsdf", "mix:a=x,b=y,weight=0.5"], "give SCENE#MATERIAL", Some("column 5 of `mix:a=x,b=y,weight=0.5`")),
    (&["bsdf", "diffuse:reflectance=x.png"], "give SCENE#MATERIAL", Some("column 21 of `diffuse:reflectance=x.png`")),
    (
        &["bsdf", "normal-map:normal_map=x.png,material=y"],
        "give SCENE#MATERIAL",
        Some("column 23 of `normal-map:normal_map=x.png,material=y`"),
    ),
    (&["bsdf", "glossy-spheres#silver"], "there are: blinn300, blinn60,", None),
    (&["bsdf", "glossy-sphere#gold"], r#"did you mean "glossy-spheres"?"#, None),
    (&["bsdf", "diffuse", "-o", "x.png"], "neither a folder nor an SVG file", None),
    (&["bsdf", "diffuse", "-o", "/no/such/folder/x.svg"], r#"there is no folder "/no/such/folder""#, None),
    (&["render", "furnace", "-o", "x.bmp"], r#"unknown image format "bmp""#, Some("x.bmp")),
    (&["render", "furnace", "-o", "x.jpg"], "JPEG is only read, never written", Some("x.jpg")),
    (&["render", "furnace", "-o", "x"], "the name has no extension", Some("x")),
    (&["render", "furnace", "-o", "/no/such/folder/x.png"], r#"there is no folder "/no/such/folder""#, None),
    (&["render", "furnace", "-o", "folder.png"], "is a folder", None),
    (&["render", "furnace", "-o", "a.png", "-o", "b.tiff"], r#"unknown image format "tiff""#, Some("b.tiff")),
    (&["render", "furnace", "-o", "b.tga"], "TGA is only read, never written", Some("b.tga")),
    (&["render", "furnace", "--spp", "0"], "--spp", None),
    (&["render", "furnace", "--spp", "-4"], "", None),
    (&["render", "furnace", "--spp", "many"], "--spp", None),
    (&["render", "furnace", "--time", "0s"], "not a positive time", None),
    (&["render", "furnace", "--time", "5 parsecs"], "use ms, s, m or h", None),
    (&["render", "furnace", "--time", "99999999999999999999999h"], "--time", None),
    (&["render", "furnace", "--error", "0"], "not a positive number", None),
    (&["render", "furnace", "--error", "nan"], "not a positive number", None),
    (&["render", "furnace", "--size", "0x5"], "not a size such as 640x480", None),
    (&["render", "furnace", "--size", "5"], "not a size such as 640x480", None),
    (&["render", "furnace", "--size", "100000x1"], "a film 100000 pixels wide", None),
    (&["render", "furnace", "--size", "20000x20000"], "more than", None),
    (&["render", "furnace", "--crop", "120,0,9,1"], "leaves the picture of 128x128 pixels", None),
    (&["render", "furnace", "--crop", "4294967295,0,4294967295,1"], "leaves the picture", None),
    (&["render", "furnace", "--crop", "1,2,3"], "not four numbers", None),
    (&["render", "furnace", "--crop", "1,2,0,3"], "with W and H above 0", None),
    (&["render", "furnace", "--size", "8x8", "--crop", "4,4,5,4"], "leaves the picture of 8x8 pixels", None),
    (&["render", "furnace", "--seed", "x"], "--seed", None),
    (&["render", "furnace", "--threads", "0"], "--threads", None),
    (&["render", "furnace", "--threads", "1025"], "--threads", None),
    (&["render", "furnace", "--engine", "steam"], "wavefront, scalar", None),
    (&["render", "furnace", "--tonemap", "film"], "none, reinhard, aces", None),
    (&["render", "furnace", "--exposure", "nan"], "--exposure", None),
    (&["render", "furnace", "--aov", "uv,depth,uv"], r#"the layer "uv" of --aov is there twice"#, None),
    (&["render", "furnace", "--aov", "depth", "--aov", "depth"], r#"the layer "depth" of --aov is there twice"#, None),
    (&["render", "furnace", "--sp", "4"], "'--spp'", None),
    (&["render"], "<SCENE>", None),
    (&["rendre", "furnace"], "'render'", None),
    (&["diff", "picture.png"], "<IMAGE>", None),
    (&["diff", "picture.png", "none.png"], "cannot read", None),
    (&["diff", "picture.png", "not.exr"], "not an OpenEXR image", Some("not.exr")),
];

#[test]
fn bad_command_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["folder.toml", "folder.png"] {
        std::fs::create_dir(folder.path().join(name)).expect("a folder");
    }
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/checker.png"), folder.path().join("picture.png"))
        .expect("a picture");
    std::fs::write(folder.path().join("not.exr"), "nothing").expect("a file");
    let refuse = |(arguments, says, place): &(&[&str], &str, Option<&str>)| {
        refusal(folder.path(), arguments, says, *place).err()
    };
    report(COMMANDS.iter().filter_map(refuse).collect());
}

/// A scene may be dark: that is a warning, not an error.
#[test]
fn an_empty_scene_is_black() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("empty.toml"), "").expect("a scene file");
    let output = rebond(folder.path(), &["render", "empty.toml", "--size", "20x10", "--spp", "2", "-o", "black.pfm"]);
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "warning: the scene has no light\n");
    let bytes = std::fs::read(folder.path().join("black.pfm")).expect("a picture");
    let image = rebond_io::read_image(&bytes, "black.pfm").expect("a picture");
    assert_eq!((image.width, image.height), (20, 10));
    assert!(image.rgb("").expect("colours").iter().all(|c| *c == [0.0; 3]));
}
