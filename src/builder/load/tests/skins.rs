//! Skins of glTF documents.

use glam::Affine3A;

use super::*;
use crate::{builder::SkinnedTriangleMesh, medial_axis::SkinJoint};

/// A tetrahedron that follows two joints, `root` at x = 1 and `tip` at y = 2, with the weights of each vertex.
fn skinned(joints: [[u8; 4]; 4], weights: [[f32; 4]; 4]) -> String {
    let mesh = tetrahedron();
    let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let positions: Vec<f32> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
    let binds = [Vec3::X, Vec3::Y * 2.0].map(|at| glam::Mat4::from_translation(-at).to_cols_array());
    let parts = [
        (floats(&positions), 5126, 4, "VEC3"),
        (mesh.triangles.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()).collect(), 5123, 12, "SCALAR"),
        (joints.concat(), 5121, 4, "VEC4"),
        (floats(&weights.concat()), 5126, 4, "VEC4"),
        (floats(&binds.concat()), 5126, 2, "MAT4"),
    ];
    let (mut buffer, mut accessors, mut views) = (vec![], vec![], vec![]);
    for (view, (bytes, kind, count, shape)) in parts.into_iter().enumerate() {
        let bounds = if view == 0 { r#", "min": [0, 0, 0], "max": [1, 1, 1]"# } else { "" };
        accessors.push(format!(
            r#"{{ "bufferView": {view}, "componentType": {kind}, "count": {count}, "type": "{shape}"{bounds} }}"#
        ));
        views.push(format!(r#"{{ "buffer": 0, "byteOffset": {}, "byteLength": {} }}"#, buffer.len(), bytes.len()));
        buffer.extend(bytes);
    }
    format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scene": 0, "scenes": [{{ "nodes": [0, 1] }}],
  "nodes": [{{ "mesh": 0, "skin": 0, "scale": [9, 9, 9] }},
    {{ "name": "root", "translation": [1, 0, 0], "children": [2] }}, {{ "name": "tip", "translation": [-1, 2, 0] }}],
  "skins": [{{ "joints": [1, 2], "inverseBindMatrices": 4 }}],
  "meshes": [{{ "primitives": [{{ "attributes": {{ "POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3 }}, "indices": 1 }}] }}],
  "accessors": [{}], "bufferViews": [{}],
  "buffers": [{{ "byteLength": {}, "uri": "data:application/octet-stream;base64,{}" }}] }}"#,
        accessors.join(", "),
        views.join(", "),
        buffer.len(),
        data_encoding::BASE64.encode(&buffer)
    )
}

const JOINTS: [[u8; 4]; 4] = [[0, 1, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 9, 0]];
const WEIGHTS: [[f32; 4]; 4] = [[0.5, 0.5, 0., 0.], [1., 0., 0., 0.], [2., 0., 0., 0.], [0.25, 0.75, 0., 0.]];

fn read(json: &str) -> Result<SkinnedTriangleMesh, FormatError> {
    Ok(MeshFormat::Gltf.parse_skinned(json.as_bytes(), Path::new("no such folder"))?.mesh)
}

#[test]
fn a_skinned_mesh_is_read_in_its_bind_pose() {
    let mesh = read(&skinned(JOINTS, WEIGHTS)).unwrap();
    // Welding numbers vertices in the order of their first use.
    let positions = [Vec3::ZERO, Vec3::Y, Vec3::X, Vec3::Z];
    assert_eq!(mesh.mesh().positions, positions, "the scale of the node does not count");
    let joint = |name: &str, at: Vec3| SkinJoint { name: name.into(), inverse_bind: Affine3A::from_translation(-at) };
    assert_eq!(mesh.skin().joints()[..], [joint("root", Vec3::X), joint("tip", Vec3::Y * 2.0)]);
    let main = mesh.skin().weights().iter().map(|[first, second, ..]| (first.0, first.1, second.1));
    assert_eq!(main.collect::<Vec<_>>(), [(0, 0.5, 0.5), (1, 1.0, 0.0), (0, 1.0, 0.0), (1, 0.75, 0.25)]);
}

#[test]
fn errors_of_skins_name_node_vertex_and_remedy() {
    let good = skinned(JOINTS, WEIGHTS);
    let change = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        read(&good.replacen(from, to, 1)).expect_err(to).to_string()
    };
    let vertex = "mesh 0, primitive 0, vertex 2: ";
    let weight = |weight: f32| {
        let mut weights = WEIGHTS;
        weights[2][0] = weight;
        read(&skinned(JOINTS, weights)).unwrap_err().to_string()
    };
    assert_eq!(weight(0.0), format!("{vertex}all of its weights are 0; assign it to a joint"));
    assert_eq!(weight(-1.0), format!("{vertex}its weight -1 is negative or not finite; normalize its weights"));
    assert_eq!(weight(f32::NAN), format!("{vertex}its weight NaN is negative or not finite; normalize its weights"));
    let mut joints = JOINTS;
    joints[2][0] = 2;
    let unknown = read(&skinned(joints, WEIGHTS)).unwrap_err().to_string();
    assert_eq!(unknown, format!("{vertex}there is no joint 2 among the 2 of its skin; export it again"));
    let cases = [
        (
            r#", "WEIGHTS_0": 3"#,
            "",
            "mesh 0, primitive 0: it has a skin and no weights (JOINTS_0, WEIGHTS_0); assign its vertices to joints, or remove it",
        ),
        (r#", "skin": 0"#, "", "node 0: its mesh 0 has no skin; bind it to a joint, or remove it"),
        (
            r#""name": "tip""#,
            r#""name": "root""#,
            "the skin: joints 0 and 1 are both named `root`; correct the joints and export it again",
        ),
        (
            r#""name": "tip","#,
            r#""name": "tip", "scale": [1, 2, 1],"#,
            "node 2: joint `tip` scales by [1, 2, 1], different in different directions; apply its scale, or make it uniform",
        ),
        (
            r#""inverseBindMatrices": 4"#,
            r#""inverseBindMatrices": 3"#,
            "skin 0: its inverse bind poses are F32 Vec4; export it again",
        ),
        (
            r#""joints": [1, 2]"#,
            r#""joints": [1, 2, 0]"#,
            "skin 0: it has 2 inverse bind poses for 3 joints; export it again",
        ),
        (r#""JOINTS_0": 2"#, r#""JOINTS_0": 3"#, "mesh 0, primitive 0: its joints are F32 Vec4; export it again"),
    ];
    for (from, to, message) in cases {
        assert_eq!(change(from, to), message);
    }
    let unnamed = read(&good.replace(r#""name": "tip","#, "")).unwrap();
    assert_eq!(unnamed.skin().joints()[1].name, "GltfNode2");
    let rigid = error(MeshFormat::Gltf, &good);
    assert!(rigid.starts_with("node 0: it is deformed by skin 0") && rigid.contains("medial build --skin"), "{rigid}");
    let other = MeshFormat::Obj.parse_skinned(b"", Path::new("")).unwrap_err().to_string();
    assert_eq!(other, "the file: the format Obj has no skins; build it without `--skin`, or export it as .glb");
}

#[test]
fn damaged_skins_are_meshes_or_clear_errors() {
    const ROUNDS: usize = 2000;
    let mut random = Random(23);
    let good = skinned(JOINTS, WEIGHTS);
    let meshes = (0..ROUNDS).filter(|round| {
        let mut bytes = good.clone().into_bytes();
        for _ in 0..1 + random.below(3) {
            damage(&mut bytes, round % 6, &mut random);
        }
        let read = MeshFormat::Gltf.parse_skinned(&bytes, Path::new("no such folder"));
        is_mesh_or_clear_error("skinned", read.map(|loaded| loaded.mesh.mesh().clone()))
    });
    let meshes = meshes.count();
    println!("{meshes} meshes, {} errors", ROUNDS - meshes);
    assert!(meshes > 20 && ROUNDS - meshes > 300, "{meshes}");
}

#[test]
fn a_clip_moves_the_joints_of_a_file() {
    let json = skinned(JOINTS, WEIGHTS);
    assert_eq!(super::super::gltf::parse_clip(json.as_bytes(), Path::new("no such folder")).unwrap(), None);
    // The root moves by 2 m along x in a second, and the tip makes half a turn about z.
    let numbers: [&[f32]; 3] =
        [&[0.0, 1.0], &[1.0, 0.0, 0.0, 3.0, 0.0, 0.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]];
    let bytes: Vec<u8> = numbers.concat().iter().flat_map(|number| number.to_le_bytes()).collect();
    let uri = format!("data:application/octet-stream;base64,{}", data_encoding::BASE64.encode(&bytes));
    let view =
        |start: usize, length: usize| format!(r#", {{ "buffer": 1, "byteOffset": {start}, "byteLength": {length} }}"#);
    let views = [view(0, 8), view(8, 24), view(32, 32)].concat();
    let accessors = r#", { "bufferView": 5, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1] },
      { "bufferView": 6, "componentType": 5126, "count": 2, "type": "VEC3" },
      { "bufferView": 7, "componentType": 5126, "count": 2, "type": "VEC4" }]"#;
    let animations = r#"{ "animations": [{ "channels": [
        { "sampler": 0, "target": { "node": 1, "path": "translation" } },
        { "sampler": 1, "target": { "node": 2, "path": "rotation" } }],
      "samplers": [{ "input": 5, "output": 6 }, { "input": 5, "output": 7 }] }],"#;
    let json = json
        .replacen('{', animations, 1)
        .replacen("], \"bufferViews\"", &format!("{accessors}, \"bufferViews\""), 1)
        .replacen("],\n  \"buffers\"", &format!("{views}],\n  \"buffers\""), 1)
        .replacen("\" }] }", &format!("\" }}, {{ \"byteLength\": {}, \"uri\": \"{uri}\" }}] }}", bytes.len()), 1);
    let clip = super::super::gltf::parse_clip(json.as_bytes(), Path::new("no such folder")).unwrap().unwrap();
    assert_eq!(clip.duration, 1.0);
    let mesh = read(&json).unwrap();
    for (time, root, along) in
        [(0.0, 1.0, Vec3::X), (0.5, 2.0, Vec3::Y), (1.25, 1.5, Vec3::new(0.5, 0.5, 0.0).normalize())]
    {
        let places = clip.places(mesh.skin().joints(), time).unwrap();
        let tip = places[1].transform_vector3(Vec3::X);
        assert!((places[0].translation.x - root).abs() < 1e-5, "{time}: {}", places[0].translation);
        assert!(tip.distance(along) < 1e-5 && (places[1].translation.x - (root - 1.0)).abs() < 1e-5, "{time}: {tip}");
    }
    let mut unknown = mesh.skin().joints().to_vec();
    unknown[1].name = "wing".into();
    assert_eq!(clip.places(&unknown, 0.0), None);
}
