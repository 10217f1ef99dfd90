//! `medial build --per-mesh`.

use bevy::math::Vec3;
use bevy_medial::builder::load;

use super::*;

#[allow(dead_code)]
#[path = "../../examples/gltf_scene/yard.rs"]
mod yard;

/// Writes a scene.
fn scene(folder: &Folder) -> String {
    let animal = load::load(Path::new(&folder.file("torus.obj", &torus()))).unwrap();
    let path = folder.0.join("yard.glb");
    fs::write(&path, yard::yard(&animal)).unwrap();
    path.to_str().unwrap().to_owned()
}

fn names(folder: &str) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const FEW: [&str; 4] = ["--spheres", "16", "--searches", "1"];

#[test]
fn each_mesh_of_a_scene_gets_a_file() {
    let folder = Folder::new("scene");
    let (glb, out) = (scene(&folder), folder.0.join("baked").to_str().unwrap().to_owned());
    let text = prints(&[&["build", &glb, "--per-mesh", "-o", &out], &FEW[..]].concat());
    let expected = [
        "animal.medial",
        "ball.medial",
        "box_0.05555x0.1111x1.medial",
        "box_1x0.05x0.2.medial",
        "box_1x0.05x1.medial",
        "crate.medial",
        "crate_1x0.5x0.6667.medial",
    ];
    assert_eq!(names(&out), expected);
    assert!(expected.iter().all(|name| text.contains(&format!("{name} level 0: "))), "{text}");
    let wall = MedialLevels::load(&Path::new(&out).join("box_0.05555x0.1111x1.medial")).unwrap();
    let half = wall.levels[0].axis.aabb().half_extents();
    assert!(half.abs_diff_eq(0.5 * Vec3::new(1.0 / 18.0, 1.0 / 9.0, 1.0), 1e-4), "{half}");
    assert!((wall.mass.unwrap().volume * 162.0 - 1.0).abs() < 1e-2);
    // Filters use the names of nodes and of meshes.
    let few = folder.0.join("few").to_str().unwrap().to_owned();
    prints(
        &[
            &["build", &glb, "--per-mesh", "-o", &few, "--only", "crate*", "--only", "box", "--skip", "*wall*"],
            &FEW[..],
        ]
        .concat(),
    );
    assert_eq!(
        names(&few),
        ["box_1x0.05x0.2.medial", "box_1x0.05x1.medial", "crate.medial", "crate_1x0.5x0.6667.medial"]
    );
}

#[test]
fn failures_name_the_node_and_stop_no_other() {
    let folder = Folder::new("scene_failures");
    let (glb, out) = (scene(&folder), folder.0.join("baked").to_str().unwrap().to_owned());
    let output =
        medial(&[&["build", &glb, "--per-mesh", "-o", &out, "--only", "lawn*", "--only", "ball"], &FEW[..]].concat());
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), names(&out)), (Some(1), vec!["ball.medial".into()]), "{errors}");
    assert!(errors.contains("yard.glb: node `lawn-noshape`: the mesh encloses no volume"), "{errors}");
    let errors = fails(&["build", &glb, "--per-mesh", "-o", &out, "--only", "no such node"], 1);
    assert!(errors.contains("no node gets a shape; check --only, --skip and the marks"), "{errors}");
    let obj = folder.0.join("torus.obj").to_str().unwrap().to_owned();
    assert!(
        fails(&["build", &obj, "--per-mesh", "-o", &out], 1).contains("the format Obj has no nodes; export it as .glb")
    );
    fails(&["build", &glb, "--per-mesh", "--levels", "-o", &out], 2);
    fails(&["build", &glb, "--only", "ball", "-o", &out], 2);
}

#[test]
fn limits_of_the_sides_are_kept_and_stated() {
    let folder = Folder::new("sides");
    let mesh = folder.file("torus.obj", &torus());
    let (ma, medial) = (folder.0.join("torus.ma"), folder.0.join("torus.medial"));
    let out = ma.to_str().unwrap();
    prints(&[&["build", &mesh, "-o", out, "--levels", "--inside", "0.1"], &FEW[..]].concat());
    let line = "# protrudes from the mesh by at most 0.1 % of the diagonal\n";
    assert!(fs::read_to_string(&ma).unwrap().starts_with(line));
    assert!(prints(&["info", medial.to_str().unwrap()]).contains(line));
    let free = folder.0.join("free.ma");
    prints(&[&["build", &mesh, "-o", free.to_str().unwrap()], &FEW[..]].concat());
    assert!(!fs::read_to_string(&free).unwrap().contains('#'));
    let errors = fails(&["build", &mesh, "-o", out, "--inside", "0.001", "--enclose", "0.001", "--spheres", "8"], 1);
    assert!(errors.contains("the shape with 8 spheres exceeds the limits of its sides"), "{errors}");
}
