use super::*;
use crate::SceneSource;
use base64::Engine as _;
use serde_json::json;

fn data(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn read(value: &Value) -> Result<Imported> {
    read_gltf(value.to_string().as_bytes(), "a.gltf", Path::new(""), ImportOptions::default())
}

fn lenient(value: &Value) -> Imported {
    let options = ImportOptions { lenient: true, ..ImportOptions::default() };
    read_gltf(value.to_string().as_bytes(), "a.gltf", Path::new(""), options)
        .unwrap_or_else(|e| panic!("{}", e.snippet()))
}

/// A square of two triangles at z = 0, with normals and texture coordinates; a lamp, a camera 5 before it.
fn square() -> Value {
    let corners = [[-1.0_f32, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let normals = [[0.0_f32, 0.0, 1.0]; 4];
    // (0, 0) is the image's upper left.
    let uvs = [[0.0_f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let mut bytes: Vec<u8> = Vec::new();
    let floats = corners.as_flattened().iter().chain(normals.as_flattened()).chain(uvs.as_flattened());
    bytes.extend(floats.flat_map(|x| x.to_le_bytes()));
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "directional", "intensity": 3, "color": [1, 0.5, 0.25] }] } },
        "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [
            { "mesh": 0 },
            { "camera": 0, "translation": [0, 0, 5] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.3, "znear": 0.1, "aspectRatio": 1.5 } }],
        "materials": [{ "name": "paint", "pbrMetallicRoughness": { "baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": 0, "roughnessFactor": 1 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3, "material": 0 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 128, "byteLength": 12 },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": data(&bytes) }],
    })
}

/// The same file as one of two chunks.
fn glb(mut value: Value) -> Vec<u8> {
    let uri = value["buffers"][0]["uri"].as_str().expect("data").split_once(',').expect("data").1.to_string();
    let mut bin = base64::engine::general_purpose::STANDARD.decode(uri).expect("base64");
    value["buffers"][0].as_object_mut().expect("a buffer").remove("uri");
    let mut json = value.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    out.extend([2, (28 + json.len() + bin.len()) as u32, json.len() as u32].iter().flat_map(|n| n.to_le_bytes()));
    out.extend(b"JSON");
    out.extend(json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

fn mesh(scene: &Imported, name: &str) -> MeshData {
    MeshData::clone(&scene.files.meshes[name])
}

#[test]
fn a_square_is_the_scene_that_toml_says() {
    let scene = read(&square()).unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let text = r#"
        film = { width = 810, height = 540 }
        materials.paint = { type = "principled", base_color = [0.8, 0.4, 0.2], metallic = 0, roughness = 1, clearcoat_roughness = 0 }
        [camera]
        type = "perspective"
        fov = 17.188734
        fov_axis = "y"
        near_clip = 0.1
        to_world.matrix = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5]]
        [[shapes]]
        type = "ply"
        file = "mesh-0-0.ply"
        material = "paint"
        [[emitters]]
        type = "directional"
        direction = [0, 0, -1]
        irradiance = [3, 1.5, 0.75]
    "#;
    let (wanted, _): (SceneDescription, _) = crate::from_toml(text, "").unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert_eq!(scene.description, wanted);
    let square = MeshData { normals: Some(vec![[0.0, 0.0, 1.0]; 4]), ..MeshData::rectangle() };
    assert_eq!(mesh(&scene, "mesh-0-0.ply"), square);
    let binary = read_gltf(&glb(self::square()), "a.glb", Path::new(""), ImportOptions::default()).expect("binary");
    assert_eq!((&binary.description, &binary.files), (&scene.description, &scene.files));
    SceneSource::imported(scene, "a").build().expect("a scene");
}

#[test]
fn nodes_stand_where_their_parents_put_them() {
    let mut value = square();
    // Above the mesh a node that moves by (1, 2, 3), above that one that turns by a quarter about z and doubles.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    value["nodes"] = json!([
        { "children": [3], "rotation": [0, 0, half, half], "scale": [2, 2, 2] },
        { "camera": 0 },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "rotation": [half, 0, 0, half] },
        { "children": [4], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1] },
        { "mesh": 0 },
    ]);
    let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
    let ShapeDescription::Ply(shape) = &scene.description.shapes[0] else { panic!("a mesh") };
    let m = shape.to_world.matrix("", "").expect("a matrix");
    // (0, 0, 0) → (1, 2, 3) → (−2, 1, 3) · 2.
    assert!((m.transform_point3(DVec3::ZERO) - DVec3::new(-4.0, 2.0, 6.0)).length() < 1e-5);
    assert!((m.transform_vector3(DVec3::X) - DVec3::new(0.0, 2.0, 0.0)).length() < 1e-5);
    // A quarter turn about x takes −z to +y.
    let EmitterDescription::Directional { direction, .. } = scene.description.emitters[0] else { panic!("a beam") };
    assert!((DVec3::from(direction.map(f64::from)) - DVec3::Y).length() < 1e-6);
    // A mesh that is there twice is stored once.
    value["nodes"][0]["children"] = json!([3, 4]);
    value["nodes"][2]["mesh"] = json!(0);
    let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert_eq!((scene.description.groups.len(), scene.description.shapes.len()), (1, 3));
    value["nodes"][4]["children"] = json!([0]);
    assert_eq!(
        read(&value).expect_err("a cycle").message,
        "nodes[0]: this node is within itself, or there are too many"
    );
}

#[test]
fn lights_and_cameras_of_every_kind() {
    let mut value = square();
    value["extensions"]["KHR_lights_punctual"]["lights"] = json!([{ "type": "point", "intensity": 7 }]);
    value["nodes"][2]["translation"] = json!([1, 2, 3]);
    let light = |value: &Value| lenient(value).description.emitters.remove(0);
    let seven = Color([7.0; 3]);
    let point =
        EmitterDescription::Point { position: [1.0, 2.0, 3.0], to_world: Transform::default(), intensity: seven };
    assert_eq!(light(&value), point);
    value["extensions"]["KHR_lights_punctual"]["lights"] =
        json!([{ "type": "spot", "intensity": 7, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.5 } }]);
    let EmitterDescription::Spot { to_world, intensity, cutoff_angle, beam_width } = light(&value) else {
        panic!("a spot")
    };
    let m = to_world.matrix("", "").expect("a matrix");
    assert!(
        (m.transform_vector3(DVec3::Z) - DVec3::NEG_Z).length() < 1e-6 && m.translation == DVec3::new(1.0, 2.0, 3.0)
    );
    assert_eq!((intensity, cutoff_angle, beam_width), (seven, 0.5_f32.to_degrees(), Some(0.1_f32.to_degrees())));
    value["cameras"] =
        json!([{ "type": "orthographic", "orthographic": { "xmag": 3, "ymag": 2, "znear": 0, "zfar": 9 } }]);
    let scene = lenient(&value).description;
    assert_eq!((scene.film.width, scene.film.height), (810, 540));
    let CameraDescription::Orthographic { to_world, .. } = scene.camera else { panic!("it is orthographic") };
    let m = to_world.matrix("", "").expect("a matrix");
    assert!((m.transform_vector3(DVec3::X) - DVec3::new(-3.0, 0.0, 0.0)).length() < 1e-6);
    assert!((m.transform_vector3(DVec3::Z) - DVec3::NEG_Z).length() < 1e-6);
    // Without a camera all is seen, without a light it is day; both are said.
    value["scenes"] = json!([{ "nodes": [0] }]);
    let scene = lenient(&value);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert!(matches!(scene.description.emitters[..], [EmitterDescription::Constant { .. }]));
}

#[test]
fn materials_keep_their_numbers() {
    let mut value = square();
    let material = |value: &Value, m: Value| {
        let mut value = value.clone();
        value["materials"] = json!([m]);
        let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let description = scene.description.materials.values().next().cloned().expect("a material");
        let ShapeDescription::Ply(shape) = &scene.description.shapes[0] else { panic!("a mesh") };
        let emission = shape.emission;
        SceneSource::imported(scene, "a").build().unwrap_or_else(|e| panic!("{}", e.snippet()));
        (description, emission)
    };
    value["extensionsUsed"] = json!(KNOWN);
    let of_toml = |text: &str| -> MaterialRef {
        #[derive(serde::Deserialize)]
        struct One {
            m: MaterialRef,
        }
        crate::from_toml::<One>(&format!("m = {text}"), "").unwrap_or_else(|e| panic!("{}", e.snippet())).0.m
    };
    let is = |m: Value, toml: &str, emission: Option<Color>| {
        let (found, shines) = material(&value, m);
        assert_eq!((MaterialRef::Inline(Box::new(found)), shines), (of_toml(toml), emission));
    };
    let plain = "metallic = 1, roughness = 1, clearcoat_roughness = 0";
    is(json!({}), &format!("{{ type = \"principled\", base_color = 1, {plain} }}"), None);
    is(
        json!({ "emissiveFactor": [1, 0.5, 0], "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4 } } }),
        &format!("{{ type = \"principled\", base_color = 1, {plain} }}"),
        Some(Color([4.0, 2.0, 0.0])),
    );
    is(
        json!({ "doubleSided": true, "extensions": {
            "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25 },
            "KHR_materials_ior": { "ior": 1.25 },
            "KHR_materials_specular": { "specularFactor": 0.5 },
        } }),
        "{ type = \"two-sided\", front = { type = \"principled\", base_color = 1, metallic = 1, roughness = 1, specular = 0.25, clearcoat = 0.5, clearcoat_roughness = 0.25, ior = 1.25 } }",
        None,
    );
    let glass = json!({ "metallicFactor": 0, "roughnessFactor": 0 });
    is(
        json!({ "pbrMetallicRoughness": glass, "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } } }),
        "{ type = \"thin-dielectric\", int_ior = 1.5, ext_ior = 1, tint = 1 }",
        None,
    );
    is(
        json!({ "pbrMetallicRoughness": glass, "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1 }, "KHR_materials_volume": { "thicknessFactor": 1 } } }),
        "{ type = \"principled\", base_color = 1, metallic = 0, roughness = 0, transmission = 1, clearcoat_roughness = 0 }",
        None,
    );
    is(
        json!({ "alphaMode": "BLEND", "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.25] } }),
        &format!(
            "{{ type = \"mask\", opacity = 0.25, material = {{ type = \"principled\", base_color = 1, {plain} }} }}"
        ),
        None,
    );
    let cut = json!({ "alphaMode": "MASK", "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.25] } });
    is(
        cut,
        &format!("{{ type = \"mask\", opacity = 0, material = {{ type = \"principled\", base_color = 1, {plain} }} }}"),
        None,
    );
    is(
        json!({ "extensions": { "KHR_materials_unlit": {} }, "pbrMetallicRoughness": { "baseColorFactor": [0.5, 1, 0.25, 1] } }),
        "{ type = \"diffuse\", reflectance = 0 }",
        Some(Color([0.5, 1.0, 0.25])),
    );
}

fn png(pixels: &[[u8; 4]], width: u32) -> String {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, pixels.len() as u32 / width);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().and_then(|mut w| w.write_image_data(pixels.as_flattened())).expect("in memory");
    data(&bytes)
}

#[test]
fn images_stand_upright_and_turn_as_they_should() {
    use rebond::scene::description::{MaterialDescription, Texture};
    use rebond::texture::{TextureFilter, Textures, Wrap};
    let mut value = square();
    value["extensionsUsed"] = json!(KNOWN);
    // White, and red, green, blue: upper left, upper right, lower left, lower right. Half of it is transparent.
    let pixels = [[255, 255, 255, 255], [255, 0, 0, 255], [0, 255, 0, 100], [0, 0, 255, 100]];
    value["images"] = json!([{ "uri": png(&pixels, 2) }]);
    value["samplers"] = json!([{ "magFilter": 9728, "wrapS": 33648, "wrapT": 33648 }]);
    value["textures"] = json!([{ "source": 0, "sampler": 0 }]);
    let turned = json!({ "index": 0, "extensions": { "KHR_texture_transform": { "rotation": std::f32::consts::FRAC_PI_2, "offset": [0, 1] } } });
    let look = |value: &Value, texture: Value, mode: &str| {
        let mut value = value.clone();
        value["materials"] = json!([{ "alphaMode": mode, "pbrMetallicRoughness": { "baseColorTexture": texture, "metallicFactor": 0 } }]);
        let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
        let material = scene.description.materials.values().next().cloned().expect("a material");
        let (base, opacity) = match material {
            MaterialDescription::Principled { base_color, .. } => (base_color, None),
            MaterialDescription::Mask { opacity, material: MaterialRef::Inline(m) } => match *m {
                MaterialDescription::Principled { base_color, .. } => (base_color, Some(opacity)),
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        };
        // What it shows at the square's corners: upper left and right, lower left and right.
        let show = |t: &Texture| {
            let Texture::Image(t) = t else { panic!("an image") };
            let image = &scene.files.images[&t.image];
            let mut textures = Textures::default();
            let map = t.to_uv.unwrap_or(rebond::texture::SAME_UV);
            let n =
                textures.add([image.width, image.height], &image.rgb("").expect("colours"), [t.wrap; 2], t.filter, map);
            let at = |u: f32, v: f32| {
                let c = textures.eval(rebond_lanes::scalar::Index1(n), [u, v]);
                [c.r, c.g, c.b]
            };
            ([at(0.2, 0.8), at(0.8, 0.8), at(0.2, 0.2), at(0.8, 0.2)], t.wrap, t.filter)
        };
        (show(&base), opacity.map(|o| show(&o)))
    };
    let (white, red, green, blue) = ([1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let plain = look(&value, json!({ "index": 0 }), "OPAQUE");
    assert_eq!(plain, (([white, red, green, blue], Wrap::Mirror, TextureFilter::Nearest), None));
    // (u, v) turned counter-clockwise as one sees them, the image therefore clockwise: what was at its lower left is at its upper left.
    let (turned, _) = look(&value, turned, "OPAQUE");
    assert_eq!(turned.0, [green, white, blue, red]);
    let (_, cut) = look(&value, json!({ "index": 0 }), "MASK");
    assert_eq!(cut.expect("holes").0, [[1.0; 3], [1.0; 3], [0.0; 3], [0.0; 3]]);
    let (_, blended) = look(&value, json!({ "index": 0 }), "BLEND");
    assert_eq!(blended.expect("half holes").0, [[1.0; 3], [1.0; 3], [100.0 / 255.0; 3], [100.0 / 255.0; 3]]);
}

#[test]
fn numbers_of_any_kind() {
    // Quantised positions, strides, a sparse accessor without a buffer, a strip and a fan.
    let mut value = square();
    value["extensionsUsed"] = json!(["KHR_mesh_quantization", "KHR_lights_punctual"]);
    value["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let mut bytes: Vec<u8> = Vec::new();
    for [x, y, z] in [[-127i8, -127, 0], [127, -127, 0], [127, 127, 0], [-127, 127, 64]] {
        bytes.extend([x as u8, y as u8, z as u8, 0]);
    }
    bytes.extend([0, 1, 2, 3]); // a strip's order
    bytes.extend([1u8, 0]); // sparse: row 1
    bytes.extend([0u8; 2]);
    bytes.extend([7.0_f32, 8.0].iter().flat_map(|x| x.to_le_bytes()));
    value["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data(&bytes) }]);
    value["bufferViews"] = json!([
        { "buffer": 0, "byteOffset": 0, "byteLength": 16, "byteStride": 4 },
        { "buffer": 0, "byteOffset": 16, "byteLength": 4 },
        { "buffer": 0, "byteOffset": 20, "byteLength": 2 },
        { "buffer": 0, "byteOffset": 24, "byteLength": 8 },
    ]);
    value["accessors"] = json!([
        { "bufferView": 0, "componentType": 5120, "count": 4, "type": "VEC3", "normalized": true },
        { "bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR" },
        { "componentType": 5126, "count": 4, "type": "VEC2", "sparse": { "count": 1,
            "indices": { "bufferView": 2, "componentType": 5121 }, "values": { "bufferView": 3 } } },
    ]);
    value["meshes"] = json!([{ "primitives": [
        { "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "indices": 1, "mode": 5, "material": 0 },
        { "attributes": { "POSITION": 0 }, "indices": 1, "mode": 6 },
    ] }]);
    let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
    let strip = mesh(&scene, "mesh-0-0.ply");
    assert_eq!(strip.positions, [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 64.0 / 127.0]]);
    assert_eq!(strip.triangles, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(strip.uvs, Some(vec![[0.0, 1.0], [7.0, -7.0], [0.0, 1.0], [0.0, 1.0]]));
    assert_eq!(mesh(&scene, "mesh-0-1.ply").triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(scene.description.materials.contains_key("default"));
}

#[test]
fn mistakes_say_what_they_are_of() {
    let fails = |pointer: &str, new: Value| {
        let mut value = square();
        *value.pointer_mut(pointer).expect(pointer) = new;
        read(&value).err().map(|e| e.message).unwrap_or_default()
    };
    assert_eq!(
        fails("/accessors/0/count", json!(5)),
        "accessors[0]: 5 rows do not fit into the 48 bytes of its view, of meshes[0].primitives[0]"
    );
    assert_eq!(
        fails("/accessors/0/count", json!(u64::MAX)),
        format!("accessors[0]: {} rows do not fit into the 48 bytes of its view, of meshes[0].primitives[0]", u64::MAX)
    );
    assert_eq!(
        fails("/bufferViews/3/byteLength", json!(13)),
        "bufferViews[3]: it reaches beyond the 140 bytes of its buffer, of meshes[0].primitives[0]"
    );
    assert_eq!(fails("/meshes/0/primitives/0/indices", json!(9)), "meshes[0].primitives[0]: there is no accessor 9");
    assert_eq!(
        fails("/meshes/0/primitives/0/attributes/POSITION", json!(2)),
        "meshes[0].primitives[0]: accessor 2 has rows of 2 numbers, not 3"
    );
    // What is there and is no number is not taken for what would be if it were not.
    let lamp = "/extensions/KHR_lights_punctual/lights/0";
    let list = format!("{lamp}/color is no list of 3 numbers of single precision");
    assert_eq!(fails(&format!("{lamp}/color"), json!("red")), list);
    assert_eq!(fails(&format!("{lamp}/color"), json!([1, 1])), list);
    let number = format!("{lamp}/intensity is no number of single precision");
    assert_eq!(fails(&format!("{lamp}/intensity"), json!("9")), number);
    assert_eq!(fails(&format!("{lamp}/intensity"), json!(1e39)), number);
    let strength = json!({ "name": "lamp", "emissiveFactor": [1, 1, 1], "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 1e39 } } });
    assert!(
        fails("/materials/0", strength)
            .starts_with("/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength is no number")
    );
    assert!(
        fails("/materials/0", json!({ "extensions": { "KHR_materials_ior": { "ior": 0 } } })).contains("an index of 0")
    );
    assert!(fails("/asset", json!({ "version": "2.0", "minVersion": "2.1" })).contains("needs glTF of version 2.1"));
    assert_eq!(fails("/scenes/0/nodes", json!([7])), "nodes[7]: there is no such node");
    assert_eq!(fails("/asset/version", json!("1.0")), "glTF of version 1.0 is not supported: 2.0 is");
    assert!(fails("/extensionsUsed", json!(["EXT_magic"])).starts_with("the extension EXT_magic is not supported"));
    assert!(fails("/buffers/0/uri", json!("../../../etc/passwd")).starts_with("buffers[0]:"));
    assert!(fails("/buffers/0/uri", json!("https://example.org/a.bin")).contains("is not a file"));
    let error =
        read_gltf(b"{\n \"asset\": 3 ]", "a.gltf", Path::new(""), ImportOptions::default()).expect_err("no JSON");
    assert_eq!((error.line(), error.file.as_deref()), (Some(2), Some("a.gltf")));
    for cut in 0..60 {
        assert!(read_gltf(&glb(square())[..cut], "a.glb", Path::new(""), ImportOptions::default()).is_err());
    }
}

#[test]
fn rows_without_a_buffer_are_few() {
    let mut value = square();
    let zeros = json!({ "componentType": 5126, "count": 1 << 18, "type": "VEC3" });
    value["accessors"] = Value::Array(vec![zeros; 5]);
    let primitive = |accessor: usize| json!({ "attributes": { "POSITION": accessor }, "material": 0 });
    value["meshes"][0]["primitives"] = (0..4).map(primitive).collect();
    assert!(read(&value).is_ok());
    value["meshes"][0]["primitives"] = (0..5).map(primitive).collect();
    let error = read(&value).expect_err("a million and a quarter");
    assert!(error.message.contains("rows of zeros are more than 1048576"), "{error}");
}

#[test]
fn what_is_shared_is_stored_once() {
    let mut value = square();
    let other = json!({ "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3 });
    let third = json!({ "attributes": { "POSITION": 0 }, "indices": 4 });
    let own = value["meshes"][0]["primitives"][0].clone();
    value["meshes"][0]["primitives"] = json!([own, other, third, third]);
    value["meshes"] = json!([value["meshes"][0], { "primitives": [third] }]);
    value["nodes"][1]["mesh"] = json!(1);
    // The second triangle alone: three of the four vertices.
    value["accessors"]
        .as_array_mut()
        .expect("a list")
        .push(json!({ "bufferView": 3, "byteOffset": 6, "componentType": 5123, "count": 3, "type": "SCALAR" }));
    let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
    let files: Vec<&str> = (scene.description.shapes.iter())
        .map(|s| if let ShapeDescription::Ply(s) = s { s.file.as_str() } else { panic!("a mesh") })
        .collect();
    assert_eq!(files, ["mesh-0-0.ply", "mesh-0-0.ply", "mesh-0-2.ply", "mesh-0-2.ply", "mesh-0-2.ply"]);
    let half = mesh(&scene, "mesh-0-2.ply");
    assert_eq!(half.positions, [[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]);
    assert_eq!((half.triangles, scene.files.meshes.len()), (vec![[0, 1, 2]], 2));
}

/// A file of a few thousand bytes that would be gigabytes if each of its primitives had numbers of its own.
#[test]
fn numbers_are_not_repeated_without_end() {
    let mut value = square();
    let bytes = vec![0_u8; 1 << 16];
    value["buffers"] = json!([{ "byteLength": bytes.len(), "uri": data(&bytes) }]);
    value["bufferViews"] = json!([{ "buffer": 0, "byteLength": bytes.len() }]);
    let accessor = json!({ "bufferView": 0, "componentType": 5120, "count": 1 << 14, "type": "VEC3" });
    value["accessors"] = Value::Array(vec![accessor; 300]);
    value["meshes"][0]["primitives"] = (0..300).map(|a| json!({ "attributes": { "POSITION": a } })).collect();
    let error = read(&value).expect_err("too many numbers");
    assert!(error.message.contains("repeats its numbers more often than is allowed"), "{error}");
}

#[test]
fn extensions_that_are_required_are_needed() {
    let mut value = square();
    value["extensionsRequired"] = json!(["EXT_magic"]);
    let error = read(&value).expect_err("magic");
    assert_eq!(error.message, "the extension EXT_magic is not supported, which the file requires");
    assert_eq!(lenient(&value).warnings.len(), 1);
}

/// Colours of vertices outside of [0, 1] are found where they stand: here those of a corner's place.
#[test]
fn colours_beyond_white_are_named() {
    let mut value = square();
    value["meshes"][0]["name"] = json!("tile");
    value["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(0);
    let Err(error) = read(&value) else { panic!("colours below 0") };
    assert!(error.message.contains("its COLOR_0 (accessor 0) has 4 numbers outside of [0, 1]"), "{error}");
    assert!(error.message.contains("tile") || error.snippet().contains("tile"), "{}", error.snippet());
}

#[test]
fn what_is_only_nearly_the_same_is_said() {
    let warnings = |value: &Value| {
        let scene = read(value).unwrap_or_else(|e| panic!("{}", e.snippet()));
        scene.warnings.into_iter().map(|w| w.message).collect::<Vec<_>>()
    };
    let mut value = square();
    value["extensionsUsed"] = json!(KNOWN);
    value["materials"][0]["extensions"] = json!({ "KHR_materials_unlit": {} });
    let unlit = "materials[0] (\"paint\"): it is to be unlit: a lamp stands for it, which lights its neighbours";
    assert_eq!(warnings(&value), [unlit]);
    let pane = |color: [f32; 4]| {
        let glass = json!({ "metallicFactor": 0, "roughnessFactor": 0, "baseColorFactor": color });
        let mut value = value.clone();
        value["materials"][0] = json!({ "pbrMetallicRoughness": glass, "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } } });
        warnings(&value)
    };
    assert_eq!(pane([1.0; 4]), [""; 0]);
    assert_eq!(
        pane([1.0, 0.5, 1.0, 1.0]),
        ["materials[0]: the colour of its thin glass is also that of its reflection"]
    );
    // The square is 5 before the camera.
    let mut value = square();
    for (far, seen) in [(5.1, false), (4.9, true)] {
        value["cameras"][0]["perspective"]["zfar"] = json!(far);
        assert_eq!(warnings(&value) == ["cameras[0]: what is farther than its zfar is seen too"], seen);
    }
    for (near, seen) in [(5.1, true), (4.9, false)] {
        let orthographic = json!({ "xmag": 3, "ymag": 2, "znear": near, "zfar": 9 });
        value["cameras"] = json!([{ "type": "orthographic", "orthographic": orthographic }]);
        assert_eq!(warnings(&value) == ["cameras[0]: what is nearer than its znear is seen too"], seen);
    }
}

#[test]
fn errors_of_a_build_name_the_files_elements() {
    let build = |value: &Value| {
        let scene = read(value).unwrap_or_else(|e| panic!("{}", e.snippet()));
        SceneSource::imported(scene, "a").build()
    };
    let mut value = square();
    value["extensionsUsed"] = json!(KNOWN);
    value["nodes"][0]["name"] = json!("wall");
    value["materials"][0]["emissiveFactor"] = json!([1, 1, 1]);
    value["materials"][0]["extensions"] = json!({ "KHR_materials_emissive_strength": { "emissiveStrength": 1e30 } });
    let error = build(&value).err().expect("too bright a lamp");
    assert!(error.message.starts_with("nodes[0] (\"wall\"), meshes[0], primitives[0]: light of more than"), "{error}");
    let mut value = square();
    value["extensionsUsed"] = json!(KNOWN);
    value["materials"][0]["extensions"] = json!({ "KHR_materials_ior": { "ior": 0.5 } });
    let error = build(&value).err().expect("an index below 1");
    assert!(error.message.starts_with("materials[0] (\"paint\"): 0.5 is no index of refraction"), "{error}");
    assert_eq!(error.file.as_deref(), Some("a.gltf"));
}

#[test]
fn what_is_flattened_is_refused_and_what_is_hidden_is_not_there() {
    let mut value = square();
    value["nodes"][0]["scale"] = json!([1, 1, 0]);
    assert_eq!(read(&value).expect_err("flat").message, "nodes[0]: a transform that flattens its mesh");
    value["nodes"][0]["scale"] = json!([0, 0, 0]);
    let scene = read(&value).unwrap_or_else(|e| panic!("{}", e.snippet()));
    assert!(scene.description.shapes.is_empty());
}

#[test]
fn one_set_of_texture_coordinates_is_used() {
    let mut value = square();
    value["images"] = json!([{ "uri": png(&[[255; 4]], 1) }]);
    value["textures"] = json!([{ "source": 0 }]);
    let second = json!({ "index": 0, "texCoord": 1 });
    value["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": second }, "normalTexture": second }]);
    value["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0, "TEXCOORD_0": 2, "TEXCOORD_1": 4 });
    let corner = json!({ "bufferView": 2, "byteOffset": 24, "componentType": 5126, "count": 1, "type": "VEC2" });
    value["accessors"].as_array_mut().expect("a list").push(corner);
    // One row for four vertices: it is the second set that is asked for.
    assert!(read(&value).is_err_and(|e| e.message.ends_with("its attributes are not of one length")));
    value["materials"][0]["normalTexture"]["texCoord"] = json!(0);
    let error = read(&value).expect_err("two sets");
    assert!(error.message.contains("two sets of texture coordinates"), "{error}");
}

#[test]
fn indices_are_whole_numbers() {
    // Positions, texture coordinates, and what is whole, but two to a row.
    let mut value = square();
    value["accessors"][3] = json!({ "bufferView": 3, "componentType": 5123, "count": 3, "type": "VEC2" });
    for accessor in [0, 2, 3] {
        value["meshes"][0]["primitives"][0]["indices"] = json!(accessor);
        let error = read(&value).expect_err("no indices");
        assert!(error.message.contains(&format!("accessor {accessor} has no whole numbers")), "{error}");
    }
    value["accessors"][3] = json!({ "bufferView": 3, "componentType": 5126, "count": 3, "type": "SCALAR" });
    assert!(read(&value).is_err_and(|e| e.message.contains("accessor 3 has no whole numbers")));
}
