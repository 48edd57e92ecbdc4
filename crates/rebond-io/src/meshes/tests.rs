use super::*;
use proptest::prelude::*;

fn quad() -> MeshData {
    MeshData {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, f32::INFINITY]],
        normals: Some(vec![[0.0, 0.0, 1.0]; 4]),
        uvs: Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshData::default()
    }
}

#[test]
fn ply_comes_back() {
    for (normals, uvs) in [(false, false), (true, false), (false, true), (true, true)] {
        let mut mesh = quad();
        mesh.normals = mesh.normals.filter(|_| normals);
        mesh.uvs = mesh.uvs.filter(|_| uvs);
        assert_eq!(read_mesh(&write_ply(&mesh), "a.ply"), Ok(mesh));
    }
}

const ASCII: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 5\nproperty double x\nproperty float y\n\
    property float z\nproperty uchar red\nproperty float s\nproperty float t\nelement edge 1\nproperty int vertex1\n\
    property list uchar float lengths\nelement face 2\nproperty int id\nproperty list uchar ushort vertex_index\n\
    property list uchar float texcoord\nend_header\n\
    0 0 0 255 0 0\n1 0 0 255 1 0\n1 1 0 255 1 1\n0 1 nan 0 0 1\n0.5 2 0 0 0 0\n3 2 0.5 0.5\n1 4 0 1 2 3 2 0.5 0.5\n2 3 2 3 4 0";

#[test]
fn ply_of_any_kind() {
    let mesh = read_ply(ASCII.as_bytes(), "a.ply").unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [2, 3, 4]]);
    assert_eq!(mesh.positions.len(), 5);
    assert!(mesh.positions[3][2].is_nan());
    assert_eq!(mesh.uvs.unwrap()[2], [1.0, 1.0]);
    assert_eq!(mesh.normals, None);
    let other = ASCII.replace("float s\n", "float texture_s\n").replace("float t\n", "float texture_t\n");
    assert_eq!(read_ply(other.as_bytes(), "a.ply").unwrap().uvs.unwrap()[2], [1.0, 1.0]);
    let with_crlf = ASCII.replace('\n', "\r\n");
    assert_eq!(read_ply(with_crlf.as_bytes(), "a.ply").unwrap().triangles.len(), 3);

    let mut big = b"ply\nformat binary_big_endian 1.0\nelement face 1\nproperty list int int vertex_indices\n\
        element vertex 3\nproperty float x\nproperty double y\nproperty short z\nend_header\n"
        .to_vec();
    for value in [3i32, 2, 1, 0] {
        big.extend(value.to_be_bytes());
    }
    for i in 0..3u8 {
        big.extend(f32::from(i).to_be_bytes());
        big.extend((f64::from(i) * 0.5).to_be_bytes());
        big.extend((-i16::from(i)).to_be_bytes());
    }
    let mesh = read_ply(&big, "a.ply").unwrap();
    assert_eq!(mesh.positions[2], [2.0, 1.0, -2.0]);
    assert_eq!(mesh.triangles, [[2, 1, 0]]);
}

#[test]
fn ply_errors() {
    let error = |text: &str| read_ply(text.as_bytes(), "a.ply").unwrap_err().to_string();
    let edit = |from: &str, to: &str| error(&ASCII.replace(from, to));
    assert_eq!(error("hello"), "a.ply: not a valid PLY mesh: File must start with 'ply'");
    assert!(edit("2 3 2 3 4 0", "2 3 2 3 5 0").ends_with("face 1: its vertex 5 is none of the 5 vertices"));
    assert!(edit("2 3 2 3 4 0", "2 3 2 3 4").ends_with("in its face data: it ends too early"));
    assert!(edit("2 3 2 3 4 0", "2 2 2 3 0").ends_with("face 1: it has 2 vertices"));
    assert!(edit("element face", "element fase").contains("it has no faces"));
    assert!(edit("element vertex", "element vertices").contains("it has no vertices"));
    assert!(edit("double x", "double xx").contains("its vertices have no x"));
    assert!(edit("vertex_index", "vertices").contains("its faces have no vertex_indices"));
    assert!(edit("list uchar ushort", "list uchar foo").contains("foo"));
    assert!(edit("0.5 2 0 0 0 0", "0.5 two 0 0 0 0").contains("vertex"));
    assert!(edit("element vertex 5", "element vertex 9999999999999").contains("a.ply"));
}

const OBJ: &str = "# a comment\nmtllib x.mtl\no thing\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 nan\nvt 0 0\nvt 1\nvt 1 1\nvn 0 0 1\n\
    g one\nusemtl m\ns off\nf 1/1/1 2/2/1 3/3/1\ng two\nf -4/1/1 -2/3/1 -1/1/1\n";

#[test]
fn obj_unifies_its_indices() {
    let mesh = read_mesh(OBJ.as_bytes(), "a.obj").unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.normals, Some(vec![[0.0, 0.0, 1.0]; 4]));
    assert_eq!(mesh.uvs, Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]]));
    let plain = read_obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 2 0\r\nf 1 2 3 4 5\r\n", "a.obj").unwrap();
    assert_eq!(plain.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    assert_eq!((plain.positions.len(), plain.normals, plain.uvs), (5, None, None));
    let mixed =
        read_obj(b"v 0 0 0\nv 2 0 0\nv 2 2 0\nvn 0 1 0\nvt 1 1\nf 1//1 2//1 3//1\nf 1 2 3\nf 1/1 2/1 3/1\n", "")
            .unwrap();
    assert_eq!(mixed.triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    assert_eq!(mixed.normals.unwrap()[2..5], [[0.0, 1.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 4.0]]);
    assert_eq!(mixed.uvs.unwrap()[5..7], [[0.0, 0.0], [1.0, 1.0]]);
}

#[test]
fn obj_errors_have_their_place() {
    let edit = |from: &str, to: &str| {
        let error = read_obj(OBJ.replace(from, to).as_bytes(), "a.obj").unwrap_err();
        (error.line().unwrap_or(0), error.column().unwrap_or(0), error.message)
    };
    let message = "this face wants vertex 9, but there are 4 before it".to_string();
    assert_eq!(edit("2/2/1", "9/2/1"), (15, 9, message));
    assert_eq!(edit("-4/1/1", "-5/1/1"), (17, 3, "this face wants vertex -5, but there are 4 before it".into()));
    assert_eq!(edit("3/3/1", "0/3/1"), (15, 15, "this face wants vertex 0, but there are 4 before it".into()));
    assert_eq!(edit("3/3/1", "3/3/2"), (15, 15, "this face wants normal 2, but there are 1 before it".into()));
    assert_eq!(edit("3/3/1", "3/a/1"), (15, 15, "\"a\" is not the number of a texture coordinate".into()));
    assert_eq!(edit("3/3/1", "/3/1"), (15, 15, "\"/3/1\" names no vertex".into()));
    assert_eq!(edit("3/3/1", ""), (15, 1, "a face of 2 vertices".into()));
    assert_eq!(edit("v 0 1 nan", "v 0 ö nan"), (7, 5, "\"ö\" is not a number".into()));
    assert_eq!(edit("v 0 1 nan", "v 0 1"), (7, 1, "expected 3 numbers, found 2".into()));
    assert_eq!(edit("f ", "l "), (0, 0, "it has no faces".into()));
    assert_eq!(read_obj(b"\xff\xfe", "a.obj").unwrap_err().to_string(), "a.obj: not an OBJ mesh: it has no vertices");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn no_broken_mesh_panics(which in 0..3usize, cut in 0.0..1.0f64, changes in proptest::collection::vec((0.0..1.0f64, any::<u8>()), 0..6)) {
        let mut bytes = [OBJ.as_bytes().to_vec(), ASCII.as_bytes().to_vec(), write_ply(&quad())][which].clone();
        for (at, value) in changes {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        if cut < 0.5 { bytes.truncate((cut * 2.0 * bytes.len() as f64) as usize); }
        for mesh in [read_mesh(&bytes, ""), read_obj(&bytes, ""), read_ply(&bytes, "")].into_iter().flatten() {
            let count = mesh.positions.len();
            prop_assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < count));
            prop_assert!(mesh.normals.is_none_or(|n| n.len() == count) && mesh.uvs.is_none_or(|n| n.len() == count));
        }
    }

    #[test]
    fn every_mesh_comes_back(positions in proptest::collection::vec(any::<[f32; 3]>(), 1..20), corners in proptest::collection::vec(any::<[u32; 3]>(), 1..20)) {
        let count = positions.len() as u32;
        let triangles = corners.into_iter().map(|t| t.map(|i| i % count)).collect();
        let mesh = MeshData { positions, triangles, ..MeshData::default() };
        prop_assert_eq!(read_ply(&write_ply(&mesh), "").map(|m| write_ply(&m)), Ok(write_ply(&mesh)));
    }
}

/// Properties have the names that Mitsuba 3.9 gives them, where it takes them; it takes whole numbers as they are.
#[test]
fn further_properties_are_attributes() {
    let names = |of_vertices: &str, of_faces: &str| -> Vec<(String, Vec<[f32; 3]>)> {
        let mut text = String::from("ply\nformat ascii 1.0\nelement vertex 4\n");
        let columns = |text: &mut String, list: &str| {
            let mut values = String::new();
            for column in list.split_whitespace() {
                let (name, value) = column.split_once('=').expect("a value");
                let (kind, name) = name.split_once(':').unwrap_or(("float", name));
                *text += &format!("property {kind} {name}\n");
                values += &format!(" {value}");
            }
            values
        };
        let vertex = columns(&mut text, &format!("x=0 y=1 z=2 {of_vertices}"));
        text += "element face 1\nproperty list uchar int vertex_indices\n";
        let face = columns(&mut text, of_faces);
        text += &format!("end_header\n{}4 0 1 2 3{face}\n", format!("{}\n", vertex.trim()).repeat(4));
        let mesh = read_ply(text.as_bytes(), "a.ply").unwrap_or_else(|e| panic!("{e}\n{text}"));
        let again = read_ply(&write_ply(&mesh), "b.ply").expect("a mesh");
        assert_eq!(again, mesh, "{text}");
        // A value for each vertex, and for each triangle of the polygon.
        let count = |name: &str| if name.starts_with("vertex_") { 4 } else { 2 };
        assert!(mesh.attributes.iter().all(|(name, values)| values == &vec![values[0]; count(name)]), "{mesh:?}");
        mesh.attributes.into_iter().map(|(name, values)| (name, values[..1].to_vec())).collect()
    };
    let is = |of_vertices: &str, of_faces: &str, wanted: &[(&str, [f32; 3])]| {
        let wanted: Vec<_> = wanted.iter().map(|(name, value)| (name.to_string(), vec![*value])).collect();
        assert_eq!(names(of_vertices, of_faces), wanted, "{of_vertices}, {of_faces}");
    };
    is("", "", &[]);
    is("r=0.25 g=0.5 b=0.75", "", &[("vertex_color", [0.25, 0.5, 0.75])]);
    is("uchar:red=255 uchar:green=0 uchar:blue=51 uchar:alpha=255", "", &[("vertex_color", [1.0, 0.0, 0.2])]);
    is(
        "red=0 green=1 blue=0",
        "r=0.25 g=0.5 b=1",
        &[("face_color", [0.25, 0.5, 1.0]), ("vertex_color", [0.0, 1.0, 0.0])],
    );
    is("a_r=0 a_g=1 a_b=0", "b_0=1 b_1=2 b_2=3", &[("face_b", [1.0, 2.0, 3.0]), ("vertex_a_color", [0.0, 1.0, 0.0])]);
    is("a_x=0 a_y=1 a_z=0", "b_1=1 b_2=2 b_3=3", &[("face_b", [1.0, 2.0, 3.0]), ("vertex_a", [0.0, 1.0, 0.0])]);
    is("a_b_x=0.5", "c_r=0.25 d_0=1", &[("face_c_color", [0.25; 3]), ("face_d", [1.0; 3]), ("vertex_a_b", [0.5; 3])]);
    is("nx=0 ny=0 nz=1 u=0 v=1 rough_x=0.5 foo=1 texture_u=0", "id=3", &[("vertex_rough", [0.5; 3])]);
}
