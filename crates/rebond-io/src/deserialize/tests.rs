use super::*;
use proptest::prelude::*;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use std::collections::BTreeMap;

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Scene {
    #[serde(default)]
    name: Option<String>,
    #[serde(default)]
    max_depth: Option<u32>,
    #[serde(default)]
    camera: Option<Camera>,
    #[serde(default)]
    materials: BTreeMap<String, Material>,
    #[serde(default)]
    shapes: Vec<Shape>,
    #[serde(default)]
    mode: Mode,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Mode {
    #[default]
    Mis,
    Implicit,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Camera {
    origin: [f32; 3],
    fov: f32,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
enum Material {
    Diffuse(Diffuse),
    Conductor {
        roughness: f32,
    },
    Mirror,
    #[serde(alias = "glass")]
    Dielectric(Dielectric),
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Diffuse {
    reflectance: Rgb,
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
struct Dielectric {
    ior: f32,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Shape {
    radius: f32,
    material: String,
    #[serde(default)]
    transform: Ops,
    #[serde(default)]
    emission: Option<Emission>,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Emission {
    radiance: Rgb,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
enum Op {
    Scale { by: f32 },
    Translate { by: [f32; 3] },
    Identity,
}

/// A number or `[r, g, b]`.
#[derive(Debug, PartialEq)]
struct Rgb([f32; 3]);

impl<'de> Deserialize<'de> for Rgb {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct V;
        impl<'de> Visitor<'de> for V {
            type Value = Rgb;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number or [r, g, b]")
            }
            fn visit_f64<E>(self, v: f64) -> Result<Rgb, E> {
                Ok(Rgb([v as f32; 3]))
            }
            fn visit_i64<E>(self, v: i64) -> Result<Rgb, E> {
                Ok(Rgb([v as f32; 3]))
            }
            fn visit_seq<A: de::SeqAccess<'de>>(self, seq: A) -> Result<Rgb, A::Error> {
                Deserialize::deserialize(SeqAccessDeserializer::new(seq)).map(Rgb)
            }
        }
        deserializer.deserialize_any(V)
    }
}

/// One operation or a list of them.
#[derive(Debug, Default, PartialEq)]
struct Ops(Vec<Op>);

impl<'de> Deserialize<'de> for Ops {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct V;
        impl<'de> Visitor<'de> for V {
            type Value = Ops;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("an operation or a list of operations")
            }
            fn visit_str<E: de::Error>(self, v: &str) -> Result<Ops, E> {
                Op::deserialize(de::value::StrDeserializer::new(v)).map(|op| Ops(vec![op]))
            }
            fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<Ops, A::Error> {
                Op::deserialize(MapAccessDeserializer::new(map)).map(|op| Ops(vec![op]))
            }
            fn visit_seq<A: de::SeqAccess<'de>>(self, seq: A) -> Result<Ops, A::Error> {
                Deserialize::deserialize(SeqAccessDeserializer::new(seq)).map(Ops)
            }
        }
        deserializer.deserialize_any(V)
    }
}

const GOOD: &str = r#"
name = "été"
max-depth = 8

[camera]
origin = [0, 1, 2.5]
fov = 40

[materials]
red = { type = "diffuse", reflectance = [0.6, 0.1, 0.1] }
mirror = "mirror"
glass = "glass"

[materials.white]
reflectance = 1
type = "diffuse"

[materials.gold]
type = "conductor"
roughness = 0.1

[[shapes]]
radius = 1
material = "white"
transform = { by = 2, type = "scale" }

[[shapes]]
radius = 2.5
material = "mirror"
transform = [{ type = "translate", by = [1, 2, 3] }, "identity"]
emission.radiance = [1, 2, 3]
"#;

#[test]
fn reads_a_scene() {
    let (scene, document) = from_toml::<Scene>(GOOD, "scene.toml").unwrap();
    assert_eq!(scene.camera, Some(Camera { origin: [0.0, 1.0, 2.5], fov: 40.0 }));
    assert_eq!(scene.materials["white"], Material::Diffuse(Diffuse { reflectance: Rgb([1.0; 3]) }));
    assert_eq!(scene.materials["gold"], Material::Conductor { roughness: 0.1 });
    assert_eq!(scene.materials["mirror"], Material::Mirror);
    assert_eq!(scene.materials["glass"], Material::Dielectric(Dielectric { ior: 0.0 }));
    assert_eq!(scene.shapes[0].transform, Ops(vec![Op::Scale { by: 2.0 }]));
    assert_eq!(scene.shapes[1].transform.0.len(), 2);
    let place = |path: &str| {
        let error = document.error_at(path, "");
        (error.line().unwrap(), error.column().unwrap())
    };
    assert_eq!(place("camera.fov"), (7, 1));
    assert_eq!(place("camera"), (5, 2));
    assert_eq!(place("camera.origin[2]"), (6, 17));
    assert_eq!(place("camera.shutter"), (5, 2));
    assert_eq!(place("materials.white"), (14, 12));
    assert_eq!(place("materials.white.reflectance"), (15, 1));
    assert_eq!(place("materials.\"white\".reflectance"), (15, 1));
    assert_eq!(place("materials.red.reflectance"), (10, 27));
    assert_eq!(place("materials.mirror.ior"), (11, 1));
    assert_eq!(place("max_depth"), (3, 1));
    assert_eq!(place("shapes[1]"), (27, 1));
    assert_eq!(place("shapes[1].emission.radiance"), (31, 10));
    assert_eq!(place("shapes[1].emission.radiance[2]"), (31, 28));
    assert_eq!(place("shapes[1].transform[0].by[1]"), (30, 45));
    assert_eq!(place("shapes[7].radius"), (22, 3));
    assert_eq!(place("nowhere"), (1, 1));
    assert_eq!(place(""), (1, 1));
    assert_eq!(place("[[[.."), (1, 1));
}

/// Text, line, column, part of the message, part of the help.
const BAD: &[(&str, usize, usize, &str, &str)] = &[
    ("\u{feff}nmae = 3", 1, 1, "unknown key", ""),
    ("name = ", 1, 8, "not valid TOML", ""),
    ("name = 'a'\nname = 'b'", 2, 1, "duplicate key", ""),
    ("nmae = 'x'", 1, 1, "unknown key \"nmae\"", "did you mean \"name\"? valid keys: name, max-depth"),
    ("max_depth = 4", 1, 1, "unknown key \"max_depth\"", "did you mean \"max-depth\"?"),
    ("zzzzzz = 4", 1, 1, "unknown key \"zzzzzz\"", "valid keys: name"),
    ("name = 3", 1, 8, "expected text in quotes, found the whole number 3", ""),
    ("max-depth = 'a'", 1, 13, "expected a whole number, found the text \"a\"", ""),
    ("max-depth = 0.5", 1, 13, "expected a whole number, found the number 0.5", ""),
    ("max-depth = -1", 1, 13, "expected a whole number that is not negative, found the whole number -1", ""),
    ("max-depth = 5000000000", 1, 13, "a whole number from 0 to 4294967295, found the whole number 5000000000", ""),
    ("max-depth = 99999999999999999999", 1, 13, "too large", ""),
    ("max-depth = 1979-05-27", 1, 13, "dates", "quote"),
    ("camera = 3", 1, 10, "expected a table, found the whole number 3", ""),
    ("\n[camera]\nfov = 3", 2, 1, "the key \"origin\" is missing", ""),
    ("[camera]\nfov = nan\norigin=[0,0,0]", 2, 7, "`nan`", ""),
    ("[camera]\nfov = inf\norigin=[0,0,0]", 2, 7, "infinite", ""),
    ("[camera]\nfov = 1e300\norigin=[0,0,0]", 2, 7, "too large", ""),
    ("[camera]\nfov = 1e999\norigin=[0,0,0]", 2, 7, "infinite", ""),
    ("[camera]\nfov = true", 2, 7, "expected a number, found `true`", ""),
    ("[camera]\norigin = [0,1]\nfov=3", 2, 10, "expected an array of 3 values, found 2 values", ""),
    ("[camera]\norigin = [0,1,2,3]\nfov=3", 2, 10, "expected an array of 3 values, found 4 values", ""),
    ("[camera]\n  origin = [0, 'ü', nan]\nfov=3", 2, 16, "expected a number, found the text \"ü\"", ""),
    ("[camera]\n  origin = ['ü', 0, 0]\nfov=3", 2, 13, "expected a number", ""),
    (
        "materials.a.type = 'difuse'",
        1,
        20,
        "unknown type \"difuse\"",
        "did you mean \"diffuse\"? valid types: diffuse, con",
    ),
    ("materials.a = 'difuse'", 1, 15, "unknown value \"difuse\"", "did you mean \"diffuse\"? valid values: diffuse"),
    ("mode = 'mid'", 1, 8, "unknown value \"mid\"", "did you mean \"mis\"? valid values: mis, implicit"),
    ("mode = 3", 1, 8, "expected a name or a table with the key \"type\", found the whole number 3", "mis, implicit"),
    ("[materials.a]\nreflectance = 1", 1, 1, "the key \"type\" is missing", "valid types: diffuse, conductor, mirror"),
    ("[materials.a]\ntype = 1", 2, 8, "expected the name of a type in quotes, found the whole number 1", "valid types"),
    ("[materials.a]\ntype = 'diffuse'", 1, 1, "the key \"reflectance\" is missing", ""),
    ("[materials]\na = 'diffuse'", 2, 5, "the key \"reflectance\" is missing", ""),
    ("[materials]\na = 'conductor'", 2, 5, "the key \"roughness\" is missing", ""),
    (
        "[materials.a]\ntype = 'diffuse'\nrefectance = 0.5",
        3,
        1,
        "unknown key \"refectance\"",
        "did you mean \"reflectance\"? valid keys: reflectance",
    ),
    ("[materials.a]\ntype = 'mirror'\nior = 0.5", 3, 1, "unknown key \"ior\"", "valid keys: type"),
    ("[materials.a]\ntype = 'conductor'\nroughnes = 0.5", 3, 1, "unknown key \"roughnes\"", "roughness"),
    (
        "[materials.a]\ntype='diffuse'\nreflectance='w'",
        3,
        13,
        "expected a number or [r, g, b], found the text \"w\"",
        "",
    ),
    ("[materials.a]\ntype='diffuse'\nreflectance=[1,nan,1]", 3, 16, "`nan`", ""),
    ("[materials.a]\ntype='diffuse'\nreflectance=[1,1]", 3, 13, "expected an array of length 3, found 2 values", ""),
    ("[materials.a]\ntype='diffuse'\nreflectance=[1,1,1,1]", 3, 13, "expected an array of 3 values, found 4", ""),
    ("[materials.a]\ntype='diffuse'\nreflectance=nan", 3, 13, "`nan`", ""),
    ("[[shapes]]\nradius=1", 1, 1, "the key \"material\" is missing", ""),
    ("shapes = 1", 1, 10, "expected an array, found the whole number 1", ""),
    ("[[shapes]]\ntransform={type='scale', by='x'}", 2, 29, "expected a number, found the text \"x\"", ""),
    ("[[shapes]]\ntransform={type='scale', bi=1}", 2, 26, "unknown key \"bi\"", "did you mean \"by\"? valid keys: by"),
    ("[[shapes]]\ntransform={type='scal', by=1}", 2, 17, "unknown type \"scal\"", "did you mean \"scale\"?"),
    ("[[shapes]]\ntransform={by=1}", 2, 11, "the key \"type\" is missing", ""),
    ("[[shapes]]\ntransform={type=2}", 2, 17, "expected the name of a type in quotes", ""),
    ("[[shapes]]\ntransform=[{type='scale', bi=1}]", 2, 27, "unknown key \"bi\"", "did you mean \"by\"?"),
    ("[[shapes]]\ntransform='identty'", 2, 11, "unknown value \"identty\"", "did you mean \"identity\"?"),
];

#[test]
fn errors_stand_at_their_place() {
    for (text, line, column, message, help) in BAD {
        let error = from_toml::<Scene>(text, "scene.toml").expect_err(text);
        let shown = format!("{text:?} gave\n{}", error.snippet());
        assert_eq!((error.line(), error.column()), (Some(*line), Some(*column)), "{shown}");
        assert!(error.message.contains(message), "{shown}");
        assert!(error.help.clone().unwrap_or_default().contains(help), "{shown}");
    }
}

#[test]
fn errors_know_their_path() {
    let path = |text: &str| from_toml::<Scene>(text, "").unwrap_err().path;
    assert_eq!(
        path("[[shapes]]\nradius=1\nmaterial='a'\n[[shapes]]\nemission.radiance=[1,nan,1]"),
        "shapes[1].emission.radiance[1]"
    );
    assert_eq!(path("[materials.'my white']\ntype='diffuse'\nreflectance='w'"), "materials.\"my white\".reflectance");
}

#[test]
fn errors_show_themselves() {
    let error = from_toml::<Scene>("[camera]\n\tfov = nan # ö\r\norigin=[0,0,0]", "a/b.toml").unwrap_err();
    assert_eq!(error.to_string(), "a/b.toml:2:8: expected a number, found `nan`");
    let snippet =
        "error: expected a number, found `nan`\n --> a/b.toml:2:8\n  |\n2 | \tfov = nan # ö\n  | \t      ^^^\n";
    assert_eq!(error.snippet(), snippet);
    let error = from_toml::<Scene>("nmae = 1", "s.toml").unwrap_err();
    assert_eq!(error.to_string(), format!("s.toml:1:1: unknown key \"nmae\"\n  help: {}", error.help.unwrap()));
    let tree = Document::from_tree(Node { value: Value::Integer(3), span: None }, None);
    assert_eq!(tree.read::<Scene>().unwrap_err().to_string(), "expected a table, found the whole number 3");
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
enum Integrator {
    Path(PathSettings),
    Light(PathSettings),
}

#[derive(Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
struct PathSettings {
    max_depth: Option<u32>,
    mode: Mode,
    clamp: f32,
    tint: Vec<f32>,
    regularize: bool,
}

#[test]
fn reads_settings() {
    let read = |text: &str| from_settings::<Integrator>(text).map(|(i, _)| i);
    let settings =
        PathSettings { max_depth: Some(4), mode: Mode::Implicit, clamp: 2.0, tint: vec![1.0, 0.5], regularize: true };
    assert_eq!(read("path"), Ok(Integrator::Path(PathSettings::default())));
    assert_eq!(read("path:"), Err(read("path:").unwrap_err()));
    assert_eq!(
        read("path:mode=implicit, max_depth=4,clamp=2,tint=[1,.5],regularize=true"),
        Ok(Integrator::Path(settings))
    );
    for (text, column, message) in [
        ("", 1, "a name is missing"),
        (":a=b", 1, "a name is missing"),
        ("pth", 1, "unknown type \"pth\""),
        ("path:", 6, "a setting is missing"),
        ("path:mode=implicit,,", 20, "a setting is missing"),
        ("path:mode", 6, "the setting \"mode\" has no value"),
        ("path:mode=", 6, "the setting \"mode\" has no value"),
        ("path:=3", 6, "a key is missing"),
        ("path:mode=mis,mode=mis", 15, "given twice"),
        ("path:moed=mis", 6, "unknown key \"moed\""),
        ("path:mode=mid", 11, "unknown value \"mid\""),
        ("path:max_depth=x", 16, "expected a whole number, found the text \"x\""),
        ("path:clamp=nan", 12, "`nan`"),
        ("path:tint=[1,[2]", 11, "brackets that do not match"),
        ("path:mode=a]b[", 11, "brackets that do not match"),
        ("path:mode=L[DG]*E", 11, "unknown value \"L[DG]*E\""),
        ("path:tint=[1,a]", 14, "expected a number, found the text \"a\""),
        ("päth:moed=é", 1, "unknown type \"päth\""),
    ] {
        let error = read(text).expect_err(text);
        assert_eq!((error.line(), error.column()), (Some(1), Some(column)), "{text}: {error}");
        assert!(error.message.contains(message), "{text}: {error}");
    }
    let error = read("path:moed=mis").unwrap_err().to_string();
    assert!(
        error.starts_with("column 6 of `path:moed=mis`: unknown key \"moed\"\n  help: did you mean \"mode\"?"),
        "{error}"
    );
}

#[test]
fn numbers_in_every_notation() {
    let (numbers, _) =
        from_toml::<BTreeMap<String, i64>>("a=0xFF\nb=1_000\nc=0b11\nd=-7\ne=4.0\nf=-9223372036854775808", "").unwrap();
    assert_eq!(numbers.into_values().collect::<Vec<_>>(), [255, 1000, 3, -7, 4, i64::MIN]);
    let (numbers, _) = from_toml::<BTreeMap<String, f32>>("a=1_0.5e-1\nb=3", "").unwrap();
    assert_eq!(numbers.into_values().collect::<Vec<_>>(), [1.05, 3.0]);
}

#[test]
fn buffered_types_work() {
    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(untagged, expecting = "a number or a list")]
    enum Either {
        One(f32),
        Many(Vec<f32>),
    }
    #[derive(Debug, Deserialize, PartialEq)]
    struct Flat {
        id: u32,
        #[serde(flatten)]
        rest: Internal,
    }
    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(tag = "type", rename_all = "kebab-case")]
    enum Internal {
        Sphere { radius: f32 },
    }
    let (map, _) = from_toml::<BTreeMap<String, Either>>("a = 1\nb = [1, 2]", "").unwrap();
    assert_eq!(map.into_values().collect::<Vec<_>>(), [Either::One(1.0), Either::Many(vec![1.0, 2.0])]);
    let error = from_toml::<BTreeMap<String, Either>>("a = 1\nb = 'x'", "").unwrap_err();
    assert_eq!((error.line(), error.column(), &*error.message), (Some(2), Some(5), "a number or a list"));
    let (flat, _) = from_toml::<Flat>("id = 1\ntype = 'sphere'\nradius = 1", "").unwrap();
    assert_eq!(flat, Flat { id: 1, rest: Internal::Sphere { radius: 1.0 } });
    assert!(from_toml::<Flat>("id = 1\ntype = 'sphere'\nradius = 'x'", "").is_err());
}

#[test]
fn enum_keys_and_newtypes() {
    #[derive(Debug, Deserialize, PartialEq, PartialOrd, Eq, Ord)]
    #[serde(rename_all = "kebab-case")]
    enum Aov {
        Depth,
        Normal,
    }
    #[derive(Debug, Deserialize, PartialEq)]
    struct On(bool);
    let (map, _) = from_toml::<BTreeMap<Aov, On>>("type = true", "").map(|_| ()).map_or_else(
        |e| {
            assert_eq!(e.message, "unknown value \"type\"");
            from_toml::<BTreeMap<Aov, On>>("depth = true\nnormal = false", "").unwrap()
        },
        |()| unreachable!(),
    );
    assert_eq!(map, BTreeMap::from([(Aov::Depth, On(true)), (Aov::Normal, On(false))]));
}

#[test]
fn nesting_does_not_overflow_the_stack() {
    let deep = "[".repeat(100_000);
    assert!(from_toml::<Scene>(&format!("name = {deep}"), "").is_err());
    assert!(from_toml::<Scene>(&format!("{}=1", "a.".repeat(50_000) + "a"), "").is_err());
    assert!(from_settings::<Integrator>(&format!("path:tint={deep}{}", "]".repeat(100_000))).is_err());
}

proptest! {
    #[test]
    fn no_text_panics(text in "\\PC*", path in "[a-z.\\[\\]0-9\"']*") {
        if let Err(e) = from_toml::<Scene>(&text, "") { let _ = e.snippet(); }
        if let Err(e) = from_settings::<Integrator>(&text) { let _ = e.snippet(); }
        if let Ok(d) = Document::parse_toml(&text, "") { let _ = d.error_at(&path, "").snippet(); }
    }

    #[test]
    fn no_broken_scene_panics(cut in 0..GOOD.len(), insert in "[\\[\\]{}=.,'\"#\n\réa1-]{0,4}", skip in 0..8usize, path in "shapes\\[[0-3]\\].[a-z]*") {
        let start = GOOD.floor_char_boundary(cut);
        let end = GOOD.ceil_char_boundary((start + skip).min(GOOD.len()));
        let text = format!("{}{insert}{}", &GOOD[..start], &GOOD[end..]);
        match from_toml::<Scene>(&text, "scene.toml") {
            Ok((_, document)) => { let _ = document.error_at(&path, "").snippet(); }
            Err(error) => { prop_assert!(error.line().is_some()); let _ = error.snippet(); }
        }
    }

    #[test]
    fn no_setting_panics(text in "[a-z]{0,2}[:=,\\[\\]a0.e-]{0,20}") {
        if let Err(e) = from_settings::<Integrator>(&text) { prop_assert!(e.column().is_some()); let _ = e.snippet(); }
    }
}
