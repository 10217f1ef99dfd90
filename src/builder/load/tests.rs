use std::fmt::Write;

use glam::Vec3;

use super::*;
use crate::{
    builder::{MeshReport, NodeBody, NodeMark, mesh::tests::tetrahedron},
    random::Random,
};

/// A closed ring of 4 by 6 quads, split into triangles.
fn ring() -> TriangleMesh {
    let at = |i: u32, j: u32| (i % 6) * 4 + j % 4;
    let positions = (0..24).map(|k| {
        let [a, b] = [(k / 4) as f32 / 6.0, (k % 4) as f32 / 4.0].map(|turn| turn * std::f32::consts::TAU);
        let radius = 2.0 + 0.7 * b.cos();
        Vec3::new(radius * a.cos(), radius * a.sin(), 0.7 * b.sin())
    });
    let quads = (0..6).flat_map(|i| (0..4).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]));
    let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    TriangleMesh::new(positions.collect(), triangles.collect()).unwrap()
}

fn obj(mesh: &TriangleMesh) -> Vec<u8> {
    let mut text = String::from("# a comment\nmtllib none.mtl\no ring\n");
    mesh.positions.iter().for_each(|p| writeln!(text, "v {:?} {:?} {:?}", p.x, p.y, p.z).unwrap());
    text += "vn 0 0 1\nvt 0 0\ns off\n";
    for [a, b, c] in &mesh.triangles {
        writeln!(text, "f {}/1/1 {}//1 {}", a + 1, b + 1, c + 1).unwrap();
    }
    text.into_bytes()
}

fn stl_text(mesh: &TriangleMesh) -> Vec<u8> {
    let mut text = String::from("solid\n");
    for triangle in &mesh.triangles {
        text += " facet normal 0 0 0\n  outer loop\n";
        for p in mesh.corners(*triangle) {
            writeln!(text, "   vertex {:?} {:e} {:?}", p.x, p.y, p.z).unwrap();
        }
        text += "  endloop\n endfacet\n";
    }
    (text + "endsolid ring\n").into_bytes()
}

/// A binary file with a header that starts like a text file.
fn stl_binary(mesh: &TriangleMesh) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes[..10].copy_from_slice(b"solid ring");
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        bytes.extend(mesh.corners(*triangle).iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply(mesh: &TriangleMesh, encoding: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {encoding} 1.0\ncomment made by a test\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    let mut bytes = header.into_bytes();
    for p in &mesh.positions {
        match encoding {
            "ascii" => bytes.extend(format!("{:?} {:?} {:?} 255\n", p.x, p.y, p.z).bytes()),
            "binary_little_endian" => bytes.extend(p.to_array().iter().flat_map(|x| x.to_le_bytes()).chain([255])),
            _ => bytes.extend(p.to_array().iter().flat_map(|x| x.to_be_bytes()).chain([255])),
        }
    }
    for t in &mesh.triangles {
        match encoding {
            "ascii" => bytes.extend(format!("3 {} {} {}\n", t[0], t[1], t[2]).bytes()),
            "binary_little_endian" => bytes.extend([3].into_iter().chain(t.iter().flat_map(|i| i.to_le_bytes()))),
            _ => bytes.extend([3].into_iter().chain(t.iter().flat_map(|i| i.to_be_bytes()))),
        }
    }
    bytes
}

/// A glTF document of one node and one mesh. Its buffer contains positions, then u16 indices. The buffer has a URI, or none as in GLB.
fn gltf_document(mesh: &TriangleMesh, uri: Option<&str>) -> (String, Vec<u8>) {
    let mut buffer: Vec<u8> = mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let split = buffer.len();
    buffer.extend(mesh.triangles.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()));
    let uri = uri.map_or(String::new(), |uri| format!(r#", "uri": "{uri}""#));
    let (min, max) = (mesh.aabb().min.to_array(), mesh.aabb().max.to_array());
    let document = format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scene": 0, "scenes": [{{ "nodes": [0] }}], "nodes": [{{ "mesh": 0 }}],
  "meshes": [{{ "primitives": [{{ "attributes": {{ "POSITION": 0 }}, "indices": 1 }}] }}],
  "accessors": [
    {{ "bufferView": 0, "componentType": 5126, "count": {}, "type": "VEC3", "min": {min:?}, "max": {max:?} }},
    {{ "bufferView": 1, "componentType": 5123, "count": {}, "type": "SCALAR" }} ],
  "bufferViews": [ {{ "buffer": 0, "byteLength": {split} }},
    {{ "buffer": 0, "byteOffset": {split}, "byteLength": {} }} ],
  "buffers": [{{ "byteLength": {}{uri} }}] }}"#,
        mesh.positions.len(),
        3 * mesh.triangles.len(),
        buffer.len() - split,
        buffer.len()
    );
    (document, buffer)
}

fn gltf_json(mesh: &TriangleMesh) -> String {
    let (_, buffer) = gltf_document(mesh, None);
    let uri = format!("data:application/octet-stream;base64,{}", data_encoding::BASE64.encode(&buffer));
    gltf_document(mesh, Some(&uri)).0
}

fn glb(mesh: &TriangleMesh) -> Vec<u8> {
    let (document, mut buffer) = gltf_document(mesh, None);
    let mut json = document.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((12 + 8 + json.len() as u32 + 8 + buffer.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", buffer)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// One mesh in all formats.
fn files(mesh: &TriangleMesh) -> [(&'static str, MeshFormat, Vec<u8>); 8] {
    [
        ("OBJ", MeshFormat::Obj, obj(mesh)),
        ("glTF", MeshFormat::Gltf, gltf_json(mesh).into_bytes()),
        ("GLB", MeshFormat::Gltf, glb(mesh)),
        ("STL text", MeshFormat::Stl, stl_text(mesh)),
        ("STL binary", MeshFormat::Stl, stl_binary(mesh)),
        ("PLY text", MeshFormat::Ply, ply(mesh, "ascii")),
        ("PLY little endian", MeshFormat::Ply, ply(mesh, "binary_little_endian")),
        ("PLY big endian", MeshFormat::Ply, ply(mesh, "binary_big_endian")),
    ]
}

fn parsed(format: MeshFormat, bytes: &[u8]) -> Result<Loaded, FormatError> {
    format.parse(bytes, Path::new("no such folder"))
}

fn parse(format: MeshFormat, bytes: &[u8]) -> Result<TriangleMesh, FormatError> {
    Ok(parsed(format, bytes)?.mesh)
}

/// The corners of all triangles.
fn corners(mesh: &TriangleMesh) -> Vec<[Vec3; 3]> {
    mesh.triangles.iter().map(|t| mesh.corners(*t)).collect()
}

fn read_bytes(format: MeshFormat, bytes: &[u8]) -> Loaded {
    parsed(format, bytes).unwrap_or_else(|error| panic!("{error}: {:?}", String::from_utf8_lossy(bytes)))
}

fn error(format: MeshFormat, text: &str) -> String {
    parse(format, text.as_bytes()).expect_err(text).to_string()
}

#[test]
fn all_formats_give_the_same_mesh() {
    let mesh = ring();
    for (name, format, bytes) in files(&mesh) {
        let Loaded { mesh: read, warnings } = parsed(format, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(warnings.is_empty(), "{name}: {warnings:?}");
        let corners = |mesh: &TriangleMesh| mesh.triangles.iter().map(|t| mesh.corners(*t)).collect::<Vec<_>>();
        assert_eq!(corners(&read), corners(&mesh), "{name}");
        let report = MeshReport::new(&read);
        assert!(report.is_closed() && report.volume > 0.0 && report.vertices == 24, "{name}: {report}");
    }
}

/// Damages a file at a random place. There are six kinds of damage.
fn damage(bytes: &mut Vec<u8>, kind: usize, random: &mut Random) {
    const TOKENS: [&str; 16] = [
        "nan",
        "-inf",
        "1e39",
        "0",
        "-1",
        "4294967295",
        "4294967296",
        "18446744073709551615",
        "-9223372036854775808",
        "x",
        "",
        "\n",
        "\\\n",
        "\"",
        "null",
        "1e6",
    ];
    let [a, b] = [0; 2].map(|_| random.below(bytes.len() + 1));
    let (from, to) = (a.min(b), a.max(b));
    match kind {
        0 => bytes.truncate(from),
        1 => drop(bytes.drain(from..to.min(from + 40))),
        2 => {
            let part = bytes[from..to.min(from + 200)].to_vec();
            drop(bytes.splice(to..to, part));
        }
        3 => bytes.iter_mut().skip(from).take(1).for_each(|byte| *byte ^= 1 << random.below(8)),
        4 => bytes.iter_mut().skip(from).take(4).for_each(|byte| *byte = random.bits() as u8),
        // A word is replaced by another token.
        _ => {
            let is_word = |byte: &u8| byte.is_ascii_alphanumeric() || b".-+".contains(byte);
            let start = from + bytes[from..].iter().position(is_word).unwrap_or(0);
            let length = bytes[start..].iter().position(|byte| !is_word(byte)).unwrap_or(0);
            let token = TOKENS[random.below(TOKENS.len())];
            drop(bytes.splice(start..start + length, token.bytes()));
        }
    }
}

/// Checks the result for a damaged file. Returns true for a mesh.
fn is_mesh_or_clear_error(name: &str, result: Result<TriangleMesh, FormatError>) -> bool {
    match &result {
        Ok(mesh) => {
            let _ = MeshReport::new(mesh).to_string();
            assert!(mesh.triangles.len() < 1000, "{name}: {} triangles", mesh.triangles.len());
            TriangleMesh::new(mesh.positions.clone(), mesh.triangles.clone()).unwrap();
        }
        Err(error) => {
            let lengths = [error.place.len(), error.problem.len(), error.remedy.len()];
            assert!(lengths.iter().all(|length| (1..600).contains(length)), "{name}: {error}");
            assert!(!error.to_string().contains('\n'), "{name}: {error}");
        }
    }
    result.is_ok()
}

#[test]
fn damaged_files_are_meshes_or_clear_errors() {
    const ROUNDS: usize = 1200;
    let mut random = Random(17);
    for (name, format, good) in files(&ring()) {
        let damaged = (0..ROUNDS).map(|round| {
            let mut bytes = good.clone();
            for _ in 0..1 + random.below(3) {
                damage(&mut bytes, round % 6, &mut random);
            }
            bytes
        });
        let meshes = damaged.filter(|bytes| is_mesh_or_clear_error(name, parse(format, bytes))).count();
        let errors = ROUNDS - meshes;
        println!("{name}: {meshes} meshes, {errors} errors");
        assert!(meshes > 20 && errors > 300, "{name}: {meshes} meshes, {errors} errors");
        assert!(parse(format, b"").is_err() && parse(format, b"\n").is_err(), "{name}");
        for length in [3, 83, 84, 85, 5000] {
            let noise: Vec<u8> = (0..length).map(|_| random.bits() as u8).collect();
            assert!(parse(format, &noise).is_err(), "{name}");
        }
    }
}

#[test]
fn promises_cost_nothing() {
    let mut stl = stl_binary(&tetrahedron());
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    stl[..5].copy_from_slice(b"other");
    let promised = "the end of the file: the header declares 214748364834 bytes, there are 284; export it again";
    assert_eq!(parse(MeshFormat::Stl, &stl).unwrap_err().to_string(), promised);
    let text = String::from_utf8(ply(&tetrahedron(), "ascii")).unwrap();
    for (from, to) in [("vertex 4\n", "vertex 4000000000\n"), ("face 4\n", "face 18446744073709551615\n")] {
        let error = error(MeshFormat::Ply, &text.replace(from, to));
        assert!(
            error.contains("the file is too short for 4000000000") || error.contains("18446744073709551615"),
            "{error}"
        );
    }
    let nothing = "ply\nformat binary_little_endian 1.0\nelement air 4000000000\nend_header\n";
    assert_eq!(error(MeshFormat::Ply, nothing), "element `air`: it has no property; export it again");
    let json = gltf_json(&tetrahedron());
    for (from, to) in
        [("\"count\": 4,", "\"count\": 4000000000,"), ("\"count\": 12,", "\"count\": 18446744073709551615,")]
    {
        let error = error(MeshFormat::Gltf, &json.replace(from, to));
        assert!(error.contains("its elements do not lie within its buffer"), "{error}");
    }
}

#[test]
fn obj_records_and_errors() {
    let head = "v 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\n";
    let triangles = |faces: &str| parse(MeshFormat::Obj, format!("{head}{faces}").as_bytes()).unwrap().triangles;
    assert_eq!(triangles("f 1 2 3 4"), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(triangles("f -4/1 -3/2/3 -2//1\r\n"), [[0, 1, 2]]);
    assert_eq!(triangles("f 1 2 \\\n 3\nl 1 2\n# \u{e9}"), [[0, 1, 2]]);
    assert_eq!(triangles("f 1 2 3 # 4"), [[0, 1, 2]]);
    assert_eq!(triangles("f 1 2 3 \\"), [[0, 1, 2]], "the last line ends with a continuation mark");
    assert_eq!(triangles("f 1 2\\\n3 4"), [[0, 1, 2], [0, 2, 3]], "numbers on two lines are separate");
    assert_eq!(triangles("# c:\\\nf 1 2 3"), [[0, 1, 2]], "a comment ends with its line");
    assert_eq!(parse(MeshFormat::Obj, format!("\u{feff}{head}f 1 2 3").as_bytes()).unwrap().positions.len(), 3);
    assert_eq!(parse(MeshFormat::Obj, format!("f 1 2 3\n{head}").as_bytes()).unwrap().triangles, [[0, 1, 2]]);
    for (faces, expected) in [
        ("f 1 2", "line 5: a face has fewer than 3 corners; export it again"),
        ("\nf 1 2 0", "line 6: `0` is not the index of a vertex; export it again"),
        ("f 1 2 -5", "line 5: `-5` is not the index of a vertex; export it again"),
        ("f 1 2 x/1", "line 5: `x/1` is not the index of a vertex; export it again"),
        ("f 1 2 9", "line 5: there is no vertex 9: the file has 4; export it again"),
        ("v 0 nan 0", "line 5: `nan` is not a finite number; export it again"),
        ("v 0 0", "line 5: a vertex has fewer than 3 coordinates; export it again"),
        ("", "the mesh: the mesh has no triangles; repair it in a modelling program and export it again"),
    ] {
        assert_eq!(error(MeshFormat::Obj, &format!("{head}{faces}")), expected);
    }
}

#[test]
fn stl_errors_name_the_line() {
    let good = String::from_utf8(stl_text(&tetrahedron())).unwrap();
    for (from, to, expected) in [
        ("endloop", "vertex 1 2 3\n endloop", "line 8: a facet has 4 corners, not 3; export it again"),
        ("vertex 0.0", "vertex zero", "line 4: `zero` is not a finite number; export it again"),
        ("endsolid ring", "", "the end of the file: `endsolid` is missing; export it again"),
        ("outer", "inner", "line 3: unexpected `inner`; export it again"),
    ] {
        assert_eq!(error(MeshFormat::Stl, &good.replacen(from, to, 1)), expected);
    }
    let read = |text: &str| parse(MeshFormat::Stl, text.as_bytes());
    let whole = read(&good).unwrap();
    assert_eq!(read(&good.to_ascii_uppercase()).unwrap(), whole);
    // A second solid: complete, truncated within a loop, and truncated between facets.
    assert_eq!(read(&(good.clone() + &good)).unwrap().triangles.len(), 2 * whole.triangles.len());
    for last in ["vertex", "endfacet"] {
        let cut = &good[..good.find(last).unwrap() + last.len()];
        let cut = cut.trim_end_matches("vertex");
        assert!(error(MeshFormat::Stl, &(good.clone() + cut)).contains("`endsolid` is missing"), "{last}");
    }
}

#[test]
fn ply_polygons_are_cut_and_errors_name_line_and_element() {
    let head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 1\nproperty list uchar uint vertex_index\nend_header\n0 0 0\n1 0 0\n1 1 0\n";
    let mesh = parse(MeshFormat::Ply, format!("{head}0 1 0\n4 0 1 2 3\n").as_bytes()).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    for (rest, expected) in [
        ("0 1 0\n3 0 1 4\n", "face 0: there is no vertex 4 among 4; export it again"),
        ("0 1 0\n2 0 1\n", "face 0: it has 2 corners in `vertex_indices`, not 3 or more; export it again"),
        ("0 1\n3 0 1 2\n", "line 13: "),
        ("0 1 0\n", "the end of the file: face 0 is missing"),
        ("0 1 0\n4 0 1 2\n", "line 14: it ends before `vertex_index` does"),
        ("0 1 zero\n3 0 1 2\n", "line 13: `zero` is not a number"),
        ("0 1 0\n3 0 1 one\n", "line 14: `one` is not the index of a vertex"),
    ] {
        let error = error(MeshFormat::Ply, &format!("{head}{rest}"));
        assert!(error.starts_with(expected) && error.ends_with("; export it again"), "{error}");
    }
}

/// Unused properties of a text file, and comments, may contain any bytes.
#[test]
fn ply_numbers_and_comments_may_be_any() {
    let header = |encoding: &str| {
        let head = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
                    element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n";
        [format!("ply\nformat {encoding} 1.0\ncomment ").as_bytes(), b"\xe9\n", head.as_bytes()].concat()
    };
    let expected = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y * 0.5], vec![[0, 1, 2]]).unwrap();
    let text = [&header("ascii")[..], b"0 0 0 nan\n1. 0 0 -inf\n\n0 .5 0 1e999\r\n3 0 1 2 2 .5 nan\n"].concat();
    assert_eq!(parse(MeshFormat::Ply, &text).unwrap(), expected);
    let mut binary = header("binary_little_endian");
    binary.extend([0.0, 0.0, 0.0, f32::NAN, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0].map(f32::to_le_bytes).concat());
    binary.push(3);
    binary.extend([0i32, 1, 2].map(i32::to_le_bytes).concat());
    binary.push(0);
    assert_eq!(parse(MeshFormat::Ply, &binary).unwrap(), expected);
}

#[test]
fn ply_strips_turn_to_and_fro_and_start_anew_at_negative_indices() {
    let head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n";
    let read = |strip: &str| parse(MeshFormat::Ply, format!("{head}{strip}\n").as_bytes());
    assert_eq!(read("9 0 1 2 3 -1 0 2 1 4").unwrap().triangles, [[0, 1, 2], [2, 1, 3], [0, 2, 1], [1, 2, 4]]);
    assert_eq!(read("6 0 1 2 2 3 4").unwrap().triangles, [[0, 1, 2], [3, 2, 4]], "a repeat continues the strip");
    assert_eq!(read("3 0 1 5").unwrap_err().to_string(), "strip 0: there is no vertex 5 among 5; export it again");
    assert!(read("5 0 1 -1 2 3").unwrap_err().to_string().contains("the mesh has no triangles"));
}

mod gltf;
mod kinds;
mod skins;
