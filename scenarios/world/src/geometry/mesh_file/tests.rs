use proptest::prelude::*;

use super::*;

/// Corners of a tetrahedron, m, and its faces seen from outside.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn ascii_stl() -> Vec<u8> {
    let facet = |face: &[u32; 3]| {
        let corner = |n: u32| {
            let [x, y, z] = CORNERS[n as usize];
            format!("vertex {x} {y} {z}\n")
        };
        format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", face.map(corner).concat())
    };
    format!("solid tetrahedron\n{}endsolid tetrahedron\n", FACES.iter().map(facet).collect::<String>()).into_bytes()
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((FACES.len() as u32).to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|n| CORNERS[*n as usize]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ascii_ply() -> Vec<u8> {
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 4\nproperty list uchar int vertex_indices\nend_header\n";
    let vertices: String = CORNERS.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let faces: String = FACES.iter().map(|[a, b, c]| format!("3 {a} {b} {c}\n")).collect();
    (header.to_owned() + &vertices + &faces).into_bytes()
}

/// Returns a binary glTF with y up, raised by a node: (x, y, z) here is (x, z, -y) in the file.
fn glb() -> Vec<u8> {
    let positions = CORNERS.iter().flat_map(|[x, y, z]| [*x, *z, -*y]).flat_map(f32::to_le_bytes);
    let binary: Vec<u8> = positions.chain(FACES.iter().flatten().flat_map(|n| n.to_le_bytes())).collect();
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"mesh":0,"translation":[0,0.01,0]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "buffers":[{"byteLength":96}],
        "bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":48}],
        "accessors":[
            {"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,-0.05],"max":[0.05,0.05,0]},
            {"bufferView":1,"componentType":5125,"count":12,"type":"SCALAR"}]}"#;
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 12 + 8 + json.len() + 8 + binary.len();
    for number in [2, total as u32, json.len() as u32] {
        file.extend(number.to_le_bytes());
    }
    file.extend(b"JSON");
    file.extend(json);
    file.extend((binary.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(binary);
    file
}

fn volume((vertices, triangles): Triangles) -> f64 {
    Mesh::new(vertices, triangles).expect("a closed mesh").volume()
}

/// The same tetrahedron is closed and has the same volume in every file format.
#[test]
fn all_kinds_give_the_same_solid() {
    let path = Path::new("thing");
    let expected = 0.05f64.powi(3) / 6.0;
    for (kind, read) in [
        ("text STL", stl(&ascii_stl(), path)),
        ("binary STL", stl(&binary_stl(), path)),
        ("PLY", ply(&ascii_ply(), path)),
        ("glTF", gltf(&glb(), path)),
    ] {
        let read = read.unwrap_or_else(|error| panic!("{kind}: {error}"));
        assert_eq!((read.0.len(), read.1.len()), (4, 4), "{kind}: corners in one place are one vertex");
        let lowest = read.0.iter().map(|vertex| vertex.z).fold(f64::INFINITY, f64::min);
        assert!((lowest - if kind == "glTF" { 0.01 } else { 0.0 }).abs() < 1e-8, "{kind}: z is up");
        assert!((volume(read) / expected - 1.0).abs() < 1e-6, "{kind}");
    }
}

/// A mesh written as OBJ text is read back as the same mesh, bit by bit.
#[test]
fn obj_text_is_the_same_mesh() {
    let mesh = ply(&ascii_ply(), Path::new("thing")).expect("a mesh");
    assert_eq!(parse_triangles(&to_obj(&mesh), Path::new("thing.obj")).expect("OBJ"), mesh);
}

/// Damaged files and unknown formats are refused with the file's name.
#[test]
fn what_is_no_mesh_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes, expected) in [
        ("a.step", &b"ISO-10303"[..], "found `.step`, expected .obj, .stl, .ply, .gltf, .glb or .dae"),
        ("a.stl", b"solid", "expected an STL file"),
        ("a.ply", b"ply\nformat", "expected a PLY file"),
        ("a.glb", b"glTF", "expected a glTF 2.0 file"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("written");
        let error = read_triangles(&path).expect_err("refused").to_string();
        assert!(error.contains(name) && error.contains(expected), "{error}");
    }
    let absent = read_triangles(Path::new("/nowhere/thing.stl")).expect_err("refused").to_string();
    assert!(absent.starts_with("/nowhere/thing.stl: "), "{absent}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Arbitrary bytes at any place do not make a reader panic.
    #[test]
    fn no_bytes_make_it_panic(kind in 0usize..4, at in 0usize..900, cut in 0usize..40, bytes in proptest::collection::vec(any::<u8>(), 0..24)) {
        let whole = [ascii_stl(), binary_stl(), ascii_ply(), glb()][kind].clone();
        let start = at % whole.len();
        let end = (start + cut).min(whole.len());
        let changed = [&whole[..start], &bytes, &whole[end..]].concat();
        let path = Path::new("thing");
        let _ = match kind {
            0 | 1 => stl(&changed, path),
            2 => ply(&changed, path),
            _ => gltf(&changed, path),
        };
    }
}
