//! Skinned meshes.

use super::*;

/// Writes a closed torus as a glTF file. Vertices with x < 0 follow the joint `left`, others the joint `right`.
fn skinned_torus(folder: &Folder) -> String {
    let mesh = bevy_medial::builder::load::load(Path::new(&folder.file("torus.obj", &torus()))).unwrap();
    let mut positions: Vec<u8> = vec![];
    let (mut joints, mut weights): (Vec<u8>, Vec<u8>) = (vec![], vec![]);
    for position in &mesh.positions {
        positions.extend(position.to_array().iter().flat_map(|x| x.to_le_bytes()));
        joints.extend([u8::from(position.x >= 0.0), 0, 0, 0]);
        weights.extend([255, 0, 0, 0]);
    }
    let indices: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
    let (vertices, corners) = (mesh.positions.len(), 3 * mesh.triangles.len());
    let views = [positions.len(), joints.len(), weights.len(), indices.len()];
    fs::write(folder.0.join("torus.bin"), [positions, joints, weights, indices].concat()).unwrap();
    let starts = [0, views[0], views[0] + views[1], views[0] + views[1] + views[2]];
    let views: Vec<String> = views
        .iter()
        .zip(starts)
        .map(|(length, start)| format!(r#"{{ "buffer": 0, "byteOffset": {start}, "byteLength": {length} }}"#))
        .collect();
    let document = format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scene": 0, "scenes": [{{ "nodes": [0, 1, 2] }}],
  "nodes": [{{ "mesh": 0, "skin": 0 }}, {{ "name": "left" }}, {{ "name": "right" }}], "skins": [{{ "joints": [1, 2] }}],
  "meshes": [{{ "primitives": [{{ "attributes": {{ "POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2 }}, "indices": 3 }}] }}],
  "accessors": [
    {{ "bufferView": 0, "componentType": 5126, "count": {vertices}, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1] }},
    {{ "bufferView": 1, "componentType": 5121, "count": {vertices}, "type": "VEC4" }},
    {{ "bufferView": 2, "componentType": 5121, "count": {vertices}, "type": "VEC4", "normalized": true }},
    {{ "bufferView": 3, "componentType": 5125, "count": {corners}, "type": "SCALAR" }} ],
  "bufferViews": [{}], "buffers": [{{ "byteLength": {}, "uri": "torus.bin" }}] }}"#,
        views.join(", "),
        fs::metadata(folder.0.join("torus.bin")).unwrap().len()
    );
    folder.file("torus.gltf", &document)
}

#[test]
fn a_skinned_mesh_is_built_with_its_joints() {
    let folder = Folder::new("skinned");
    let mesh = skinned_torus(&folder);
    let out = folder.0.join("torus.medial").to_str().unwrap().to_owned();
    prints(&["build", &mesh, "-o", &out, "--skin", "--spheres", "16", "--searches", "1"]);
    let levels = MedialLevels::load(Path::new(&out)).unwrap().levels;
    assert!(levels.len() > 1, "{}", levels.len());
    let skin = levels[0].axis.skin().unwrap();
    for (sphere, weights) in levels[0].axis.spheres().iter().zip(skin.weights()) {
        let name = &skin.joints()[usize::from(weights[0].0)].name;
        assert!(sphere.center.x.abs() < 0.05 || (name == "right") == (sphere.center.x > 0.0), "{sphere:?} {name}");
    }
    let text = prints(&["info", &out]);
    assert!(text.contains("levels, finest first, bound to 2 joints\n"), "{text}");
    assert!(prints(&["info", &out, "--json"]).lines().all(|line| line.contains("\"joints\":2")));
}

#[test]
fn a_skin_needs_the_option_a_medial_file_and_a_skinned_mesh() {
    let folder = Folder::new("skin_errors");
    let mesh = skinned_torus(&folder);
    let [text, levels] = ["out.ma", "out.medial"].map(|name| folder.0.join(name).to_str().unwrap().to_owned());
    let rigid = fails(&["build", &mesh, "-o", &levels], 1);
    assert!(
        rigid.contains("node 0: it is deformed by skin 0") && rigid.contains("use `medial build --skin`"),
        "{rigid}"
    );
    let flat = fails(&["build", &mesh, "-o", &text, "--skin"], 1);
    assert!(flat.contains("a .ma file has no joints; name it ") && flat.ends_with("out.medial"), "{flat}");
    let plain = fails(&["build", &folder.file("plain.obj", &torus()), "-o", &levels, "--skin"], 1);
    assert!(plain.contains("the format Obj has no skins; build it without `--skin`"), "{plain}");
}
