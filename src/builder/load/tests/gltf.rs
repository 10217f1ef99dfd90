//! Nodes, primitives and accessors of glTF documents.

use super::*;

#[test]
fn gltf_nodes_place_their_meshes() {
    let json = gltf_json(&tetrahedron());
    let with_nodes = |nodes: &str| json.replace(r#""nodes": [{ "mesh": 0 }]"#, &format!(r#""nodes": [{nodes}]"#));
    let read = |nodes: &str| parse(MeshFormat::Gltf, with_nodes(nodes).as_bytes()).unwrap();
    let nested = r#"{ "translation": [10, 0, 0], "children": [1, 2] }, { "mesh": 0, "scale": [2, 2, 2] },
                    { "mesh": 0, "translation": [0, 5, 0], "scale": [-1, 1, 1] }, { "mesh": 0 }"#;
    let mesh = read(nested);
    let report = MeshReport::new(&mesh);
    assert_eq!(
        (report.triangles, report.components, report.is_closed()),
        (8, 2, true),
        "the fourth node is in no scene"
    );
    assert!((report.volume - 9.0 / 6.0).abs() < 1e-6, "the mirrored mesh is inside out: {report}");
    assert_eq!((mesh.aabb().min, mesh.aabb().max), (Vec3::new(9.0, 0.0, 0.0), Vec3::new(12.0, 6.0, 2.0)));

    let skinned = with_nodes(r#"{ "mesh": 0, "skin": 0, "scale": [0.01, 0.01, 0.01] }"#);
    let skinned = skinned.replacen('{', r#"{ "skins": [{ "joints": [0] }],"#, 1);
    assert!(
        error(MeshFormat::Gltf, &skinned).starts_with("node 0: it is deformed by skin 0"),
        "{}",
        error(MeshFormat::Gltf, &skinned)
    );

    let targets = r#""indices": 1, "targets": [{ "POSITION": 0 }] }"#;
    let bent = |weight: &str| {
        with_nodes(&format!(r#"{{ "mesh": 0, "weights": [{weight}] }}"#)).replace(r#""indices": 1 }"#, targets)
    };
    assert!(parse(MeshFormat::Gltf, bent("0").as_bytes()).is_ok());
    let reported = error(MeshFormat::Gltf, &bent("0.5"));
    assert!(
        reported.starts_with("node 0: mesh 0 is deformed by its morph targets; apply its shape keys"),
        "{reported}"
    );

    let cycle = error(MeshFormat::Gltf, &with_nodes(r#"{ "children": [1] }, { "children": [0], "mesh": 0 }"#));
    assert_eq!(cycle, "node 0: the scene reaches it twice, so its nodes are not a tree; export it again");
}

#[test]
fn gltf_modes_and_errors() {
    let json = gltf_json(&tetrahedron());
    let with_mode = |mode: u32| json.replace(r#""indices": 1 }"#, &format!(r#""indices": 1, "mode": {mode} }}"#));
    // In the strip, three triangles would repeat a corner.
    for (mode, count) in [(4, 4), (5, 7), (6, 10)] {
        assert_eq!(parse(MeshFormat::Gltf, with_mode(mode).as_bytes()).unwrap().triangles.len(), count);
    }
    let lines = "the glTF document: it has no triangles, only 1 primitives of lines or points, the first is mesh 0, primitive 0; \
                 turn them into triangles";
    assert_eq!(error(MeshFormat::Gltf, &with_mode(1)), lines);
    let wild = json.replace(r#""POSITION": 0"#, r#""POSITION": 9"#);
    let missing = "the glTF document: a mesh refers to accessor 9, which does not exist; export it again";
    assert_eq!(error(MeshFormat::Gltf, &wild), missing);
    let unindexed = json.replace(r#", "indices": 1 }"#, " }");
    assert_eq!(parse(MeshFormat::Gltf, unindexed.as_bytes()).unwrap().triangles, [[0, 1, 2]]);

    let beside = gltf_document(&tetrahedron(), Some("a%20file.bin"));
    let missing = parse(MeshFormat::Gltf, beside.0.as_bytes()).unwrap_err().to_string();
    assert!(
        missing.starts_with("buffer 0: it cannot be read: ")
            && missing.contains("a file.bin")
            && missing.contains(".glb"),
        "{missing}"
    );
    let folder = std::env::temp_dir().join(format!("bevy_medial_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("a file.bin"), &beside.1).unwrap();
    std::fs::write(folder.join("model.GLTF"), &beside.0).unwrap();
    assert_eq!(load(&folder.join("model.GLTF")).unwrap(), tetrahedron().welded());
    std::fs::write(folder.join("a file.bin"), &beside.1[1..]).unwrap();
    let short = load(&folder.join("model.GLTF")).unwrap_err().to_string();
    std::fs::write(folder.join("model.GLTF"), gltf_document(&tetrahedron(), Some(".")).0).unwrap();
    let no_file = load(&folder.join("model.GLTF")).unwrap_err().to_string();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(no_file.contains("buffer 0: it cannot be read: it is not a file"), "{no_file}");
    assert!(short.ends_with("model.GLTF: buffer 0: it declares 72 bytes and has 71; export it again"), "{short}");

    let device = gltf_document(&tetrahedron(), Some("/dev/zero")).0;
    assert!(error(MeshFormat::Gltf, &device).contains("its URI is not a relative path: `/dev/zero`"));
    let needing = |name: &str| json.replacen('{', &format!("{{ \"extensionsRequired\": [\"{name}\"],"), 1);
    assert!(parse(MeshFormat::Gltf, needing("KHR_materials_unlit").as_bytes()).is_ok());
    let webp = needing("EXT_texture_webp").replacen(
        '{',
        r#"{ "textures": [{ "extensions": { "EXT_texture_webp": { "source": 0 } } }], "images": [{ "uri": "a.webp" }],"#,
        1,
    );
    parse(MeshFormat::Gltf, webp.as_bytes()).unwrap();
    let instanced = json.replacen('{', r#"{ "extensionsUsed": ["KHR_materials_unlit", "EXT_mesh_gpu_instancing"],"#, 1);
    assert!(error(MeshFormat::Gltf, &instanced).contains("it needs the extension EXT_mesh_gpu_instancing"));
    let needed = error(MeshFormat::Gltf, &needing("KHR_draco_mesh_compression"));
    assert!(needed.contains("KHR_draco_mesh_compression; export it without compression"), "{needed}");

    let remote = gltf_document(&tetrahedron(), Some("https://example.org/a.bin")).0;
    assert!(error(MeshFormat::Gltf, &remote).contains("its URI is not a relative path: `https://"));
    assert!(load(Path::new("no such.obj")).unwrap_err().to_string().starts_with("no such.obj: cannot be read"));
}

#[test]
fn lines_and_points_beside_triangles_are_left_out() {
    let json = gltf_json(&tetrahedron());
    let line = r#"{ "attributes": { "POSITION": 0 }, "mode": 3 }"#;
    let beside = json.replace(r#""primitives": ["#, &format!(r#""primitives": [{line}, {line}, "#));
    let Loaded { mesh, warnings } = read_bytes(MeshFormat::Gltf, beside.as_bytes());
    assert_eq!(corners(&mesh), corners(&tetrahedron()));
    assert_eq!(warnings, ["left out: 2 primitives of lines or points, the first is mesh 0, primitive 0"]);
}

/// A document with a buffer of these bytes, each view as an offset and a length, and these accessors. The mesh uses accessor 0 without indices.
fn document(accessors: &str, parts: &[Vec<u8>]) -> String {
    let mut offset = 0;
    let views: Vec<String> = parts
        .iter()
        .map(|part| {
            offset += part.len();
            format!(r#"{{ "buffer": 0, "byteOffset": {}, "byteLength": {} }}"#, offset - part.len(), part.len())
        })
        .collect();
    let uri = format!("data:application/octet-stream;base64,{}", data_encoding::BASE64.encode(&parts.concat()));
    format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scenes": [{{ "nodes": [0] }}], "nodes": [{{ "mesh": 0 }}],
  "meshes": [{{ "primitives": [{{ "attributes": {{ "POSITION": 0 }} }}] }}],
  "accessors": [{accessors}], "bufferViews": [{}], "buffers": [{{ "byteLength": {offset}, "uri": "{uri}" }}] }}"#,
        views.join(", ")
    )
}

fn bytes_of(positions: &[Vec3]) -> Vec<u8> {
    positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect()
}

#[test]
fn sparse_accessors_replace_elements() {
    let dense = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let values = bytes_of(&[Vec3::Z, Vec3::ONE]);
    let sparse = |view: &str, count: usize, kind: u32| {
        format!(
            r#"{{ {view} "componentType": 5126, "count": {count}, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1], "sparse": {{ "count": 2,
                 "indices": {{ "bufferView": 1, "componentType": {kind} }}, "values": {{ "bufferView": 2 }} }} }}"#
        )
    };
    let indices =
        |at: [u32; 2], width: usize| at.iter().flat_map(|i| i.to_le_bytes()[..width].to_vec()).collect::<Vec<u8>>();
    for (width, kind) in [(1, 5121), (2, 5123), (4, 5125)] {
        let parts = [bytes_of(&dense), indices([0, 2], width), values.clone()];
        let replaced =
            read_bytes(MeshFormat::Gltf, document(&sparse(r#""bufferView": 0,"#, 3, kind), &parts).as_bytes());
        assert_eq!(corners(&replaced.mesh), [[Vec3::Z, Vec3::X, Vec3::ONE]]);
        // Without a view, the other elements are 0.
        let alone = read_bytes(MeshFormat::Gltf, document(&sparse("", 3, kind), &parts).as_bytes());
        assert_eq!(corners(&alone.mesh), [[Vec3::Z, Vec3::ZERO, Vec3::ONE]]);
        let wild = [bytes_of(&dense), indices([0, 3], width), values.clone()];
        let reported = error(MeshFormat::Gltf, &document(&sparse("", 3, kind), &wild));
        assert_eq!(reported, "accessor 0: it replaces an element that does not exist; export it again");
        let short = [bytes_of(&dense), indices([0, 2], width), values[1..].to_vec()];
        let reported = error(MeshFormat::Gltf, &document(&sparse("", 3, kind), &short));
        assert_eq!(reported, "accessor 0: its elements do not lie within its buffer; export it again");
    }
    let parts = [bytes_of(&dense), indices([0, 2], 1), values];
    let promised = error(MeshFormat::Gltf, &document(&sparse("", 4_000_000_000, 5121), &parts));
    assert!(promised.contains("the mesh has 4000000000 elements of an accessor, more than 16777216"), "{promised}");
}

#[test]
fn quantized_positions_are_numbers_or_parts_of_one() {
    // Two corners, and 0. The strides are multiples of 4 bytes, as the extension requires.
    let padded = |width: usize, values: [i32; 6]| -> Vec<u8> {
        let stride = usize::next_multiple_of(3 * width, 4);
        let vertices = [[0; 3], [values[0], values[1], values[2]], [values[3], values[4], values[5]]];
        let vertex = |vertex: [i32; 3]| {
            let mut bytes: Vec<u8> = vertex.iter().flat_map(|x| x.to_le_bytes()[..width].to_vec()).collect();
            bytes.resize(stride, 0xff);
            bytes
        };
        vertices.into_iter().flat_map(vertex).collect()
    };
    let signed = [Vec3::new(1.0, 0.0, -1.0), Vec3::new(0.0, 1.0, -1.0)];
    let unsigned = [Vec3::new(1.0, 0.0, 0.2), Vec3::new(0.0, 1.0, 0.0)];
    let cases = [
        (5120, 1, [127, 0, -127, 0, 127, -128], signed),
        (5122, 2, [32767, 0, -32767, 0, 32767, -32768], signed),
        (5121, 1, [255, 0, 51, 0, 255, 0], unsigned),
        (5123, 2, [65535, 0, 13107, 0, 65535, 0], unsigned),
    ];
    for (kind, width, values, expected) in cases {
        for normalized in [true, false] {
            let stride = usize::next_multiple_of(3 * width, 4);
            let accessor = format!(
                r#"{{ "bufferView": 0, "componentType": {kind}, "normalized": {normalized}, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1] }}"#
            );
            let json = document(&accessor, &[padded(width, values)])
                .replace(r#""byteOffset": 0,"#, &format!(r#""byteOffset": 0, "byteStride": {stride},"#))
                .replacen('{', r#"{ "extensionsRequired": ["KHR_mesh_quantization"],"#, 1);
            let read = read_bytes(MeshFormat::Gltf, json.as_bytes()).mesh;
            let plain = values.map(|x| x as f32);
            let plain = [Vec3::from_slice(&plain[..3]), Vec3::from_slice(&plain[3..])];
            let [a, b] = if normalized { expected } else { plain };
            assert_eq!(corners(&read), [[Vec3::ZERO, a, b]], "{kind} {normalized}");
        }
    }
}

#[test]
fn gltf_nodes_are_read_one_by_one() {
    let json = gltf_json(&tetrahedron());
    let read = |nodes: &str| {
        let json = json.replace(r#""nodes": [{ "mesh": 0 }]"#, &format!(r#""nodes": [{nodes}]"#));
        super::super::node_meshes::parse(json.as_bytes(), Path::new(""))
    };
    let extras = r#""extras": { "medial": { "budget": 2 } }"#;
    let nodes = read(&format!(r#"{{ "name": "a-medial", "mesh": 0, "scale": [4, -2, 2], {extras} }}"#)).unwrap();
    let [node] = &nodes[..] else { panic!("{nodes:?}") };
    assert_eq!((&*node.node, &*node.file), ("a-medial", &*format!("{}_1x0.5x0.5", node.mesh)));
    assert_eq!(node.mark, NodeMark { body: Some(NodeBody::Dynamic), budget: Some(2.0) });
    let box_of = node.triangles.as_ref().unwrap().aabb();
    assert_eq!((box_of.min, box_of.max), (Vec3::ZERO, Vec3::new(1.0, 0.5, 0.5)), "the node mirrors it, not its file");
    let reported = read(r#"{ "name": "a", "mesh": 0, "extras": { "medial": 7 } }"#).unwrap_err().to_string();
    let expected = "node 0 `a`: \"medial\" of its extras is invalid: it is neither an object nor true or false; correct it and export it again";
    assert_eq!(reported, expected);
    let flat = read(r#"{ "name": "flat", "mesh": 0, "scale": [1, 0, 1] }"#).unwrap();
    assert!(flat[0].triangles.as_ref().unwrap_err().contains("its scale is 0 or not finite"), "{flat:?}");
}
