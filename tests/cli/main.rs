//! Tests of the program `medial` as a process: arguments, output and exit codes.

mod arguments;
mod outputs;
mod scenes;
mod skins;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use bevy_medial::{
    builder::{Level, MedialLevels, TriangleMesh, measure},
    medial_axis::{MedialAxis, ma, triangulate},
};

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/models/");

fn medial(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_medial")).args(args).output().unwrap()
}

/// Runs the program, asserts that it succeeds, and returns its standard output.
fn prints(args: &[&str]) -> String {
    let output = medial(args);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the program, asserts that it fails with the exit code, and returns its error output.
fn fails(args: &[&str], code: i32) -> String {
    let output = medial(args);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{args:?}: {errors}");
    assert!(errors.starts_with("error: ") && !errors.contains("panicked"), "{args:?}: {errors}");
    assert!(output.stdout.is_empty(), "{args:?}");
    errors.trim_end().into()
}

/// A folder that is deleted when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}_{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    /// Writes a file and returns its path.
    fn file(&self, name: &str, content: &str) -> String {
        let path = self.0.join(name).to_str().unwrap().to_owned();
        fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A model of the project as an OBJ file.
fn obj(name: &str) -> String {
    let bytes = fs::read(format!("{MODELS}{name}.ma")).unwrap();
    let (axis, _) = ma::parse(&bytes).unwrap().into_medial_axis().unwrap();
    let surface = triangulate(axis.spheres(), axis.primitives(), 24);
    let vertices = surface.positions.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces = surface.indices.chunks_exact(3).map(|f| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
    vertices.chain(faces).collect()
}

/// A closed torus as an OBJ file.
fn torus() -> String {
    let (rings, around) = (64, 24);
    let mut text = String::new();
    for i in 0..rings {
        for j in 0..around {
            let [u, v] = [(i, rings), (j, around)].map(|(k, n)| std::f32::consts::TAU * k as f32 / n as f32);
            let reach = 0.2 + 0.05 * v.cos();
            text += &format!("v {} {} {}\n", reach * u.cos(), reach * u.sin(), 0.05 * v.sin());
        }
    }
    let at = |i: usize, j: usize| (i % rings) * around + j % around + 1;
    for (i, j) in (0..rings).flat_map(|i| (0..around).map(move |j| (i, j))) {
        text += &format!("f {} {} {} {}\n", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
    }
    text
}

#[test]
fn measure_prints_a_row_for_each_medial_mesh() {
    let folder = Folder::new("measure");
    let mesh = folder.file("bear.obj", &obj("bear"));
    let [bear, cow] = ["bear", "cow"].map(|name| format!("{MODELS}{name}.ma"));
    let text = prints(&["measure", &mesh, &bear, &cow]);
    let row = |name: &str| -> Vec<f32> {
        let row = text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name} in\n{text}"));
        row[name.len()..].split_whitespace().filter_map(|field| field.parse().ok()).collect()
    };
    let (bear, cow) = (row(&bear), row(&cow));
    assert_eq!((bear.len(), cow.len()), (7, 7), "{text}");
    // The triangles come from the bear's own medial mesh, so its error is small. The cow is a different shape.
    assert!(bear[5] < 0.5 && cow[3] > 2.0 && cow[5] > 2.0, "{text}");
}

#[test]
fn measure_closes_holes_on_request() {
    let folder = Folder::new("holes");
    // A pyramid without its base.
    let open = folder
        .file("open.obj", "v 1 0 1\nv -1 0 1\nv -1 0 -1\nv 1 0 -1\nv 0 2 0\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n");
    let ball = folder.file("ball.ma", "1 0 0\nv 0 0.6 0 0.6\n");
    let greatest_back = |args: &[&str]| -> f32 {
        let text = prints(args);
        text.lines().last().unwrap().rsplit_once('|').unwrap().1.split_whitespace().next().unwrap().parse().unwrap()
    };
    let [as_it_is, closed] = [&["measure", &open, &ball][..], &["measure", "--close-holes", &open, &ball][..]];
    // Expected errors in percent of the diagonal: distance to the sides from the ball's lowest point, and from its highest point.
    let [lowest, highest] = [2.0, 0.8].map(|above: f32| 100.0 * above / 5f32.sqrt() / 12f32.sqrt());
    let (as_it_is, closed) = (greatest_back(as_it_is), greatest_back(closed));
    assert!((as_it_is - lowest).abs() < 0.5 && (closed - highest).abs() < 0.5, "{as_it_is} {closed}");
}

#[test]
fn info_describes_medial_and_triangle_meshes() {
    let folder = Folder::new("info");
    let text = prints(&["info", &format!("{MODELS}dinosaur.ma")]);
    for word in ["in the file: ", "clean-up: ", "slabs", "bounds: ", "radii: ", "volume: ", "inertia"] {
        assert!(text.contains(word), "{word} in\n{text}");
    }
    let open = folder.file("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n");
    let text = prints(&["info", &open]);
    assert!(text.contains("triangles: 1") && text.contains("3 boundary edges: "), "{text}");
}

#[test]
fn info_and_measure_list_each_level() {
    let folder = Folder::new("levels");
    let level = |segments| {
        let axis = MedialAxis::torus(1.0, 0.2, segments).unwrap();
        let surface = triangulate(axis.spheres(), axis.primitives(), 24);
        let positions = surface.positions.into_iter().map(Into::into).collect();
        let mesh = TriangleMesh::new(positions, surface.indices.as_chunks().0.to_vec()).unwrap();
        Level { error: measure(&mesh, &axis), axis }
    };
    let chain = MedialLevels { levels: vec![level(24), level(6)], ..MedialLevels::default() };
    let path = folder.0.join("torus.medial");
    chain.save(&path).unwrap();
    let path = path.to_str().unwrap();
    let text = prints(&["info", path]);
    assert!(text.contains("2 levels") && text.contains("level 1: 6 spheres, 6 cones, 0 slabs; mesh to "), "{text}");
    let mesh = folder.file("bear.obj", &obj("bear"));
    let text = prints(&["measure", &mesh, path]);
    assert!(text.contains("torus.medial level 0 ") && text.contains("torus.medial level 1 "), "{text}");
    fs::write(path, b"medial").unwrap();
    assert!(fails(&["info", path], 1).contains("torus.medial: it is not a .medial file"));
}

/// Builds by a number of spheres, with levels, and by a maximum error. A warning follows if the spheres are too few for that error.
#[test]
fn build_keeps_sphere_limit_and_max_error() {
    let folder = Folder::new("build");
    let mesh = folder.file("torus.obj", &torus());
    let [by_number, by_error] = ["number.ma", "error.ma"].map(|name| folder.file(name, ""));
    let error = |mat: &str| {
        let mesh = bevy_medial::builder::load::load(Path::new(&mesh)).unwrap();
        let (axis, _) = ma::parse(&fs::read(mat).unwrap()).unwrap().into_medial_axis().unwrap();
        (axis.spheres().len(), measure(&mesh, &axis).max())
    };

    let printed = prints(&["build", &mesh, "-o", &by_number, "--spheres", "26", "--levels"]);
    let (spheres, found) = error(&by_number);
    assert!(spheres <= 26 && found < 0.5, "{spheres} spheres, {found} %");
    let levels = MedialLevels::load(Path::new(&by_number).with_extension("medial").as_path()).unwrap().levels;
    assert!(levels.len() >= 5 && printed.lines().count() == levels.len(), "{printed}");
    assert!(levels[0].error.max() < levels[1].error.max() && levels.last().unwrap().axis.spheres().len() == 1);

    let errors = |args: &[&str]| String::from_utf8(medial(args).stderr).unwrap();
    assert!(!errors(&["build", &mesh, "-o", &by_error, "--max-error", "2"]).contains("warning"));
    let (spheres, found) = error(&by_error);
    assert!(found <= 2.0 && spheres < 64, "{spheres} spheres, {found} %");
    let few = ["build", &mesh, "-o", &by_error, "--max-error", "0.01", "--spheres", "12"];
    assert!(errors(&few).contains("warning: ") && errors(&few).contains("torus.obj: the error is more than 0.01 %"));
}

#[test]
fn clean_removes_redundant_primitives() {
    let folder = Folder::new("clean");
    // A cone within a slab, a ball within a ball, and an unused sphere.
    let raw = "5 2 1\nv 0 0 0 1\nv 4 0 0 1\nv 0 4 0 1\nv 0 0 0 0.5\nv 9 9 9 1\ne 0 1\ne 0 3\nf 0 1 2\n";
    let raw = folder.file("raw.ma", raw);
    let out = folder.0.join("out.ma");
    let text = prints(&["clean", &raw, "-o", out.to_str().unwrap()]);
    assert!(text.contains("degenerate cones simplified: 1") && text.contains("isolated spheres"), "{text}");
    let clean = ma::parse(&fs::read(&out).unwrap()).unwrap();
    assert_eq!((clean.spheres.len(), clean.edges.len(), clean.faces.len()), (4, 0, 1));
    assert!(prints(&["clean", out.to_str().unwrap(), "-o", out.to_str().unwrap()]).contains("isolated spheres"));
}

#[test]
fn errors_are_one_line_with_an_exit_code() {
    let folder = Folder::new("errors");
    let bad_mesh = folder.file("bad.obj", "v 0 0 0\nf 1 2 3\n");
    let bad_axis = folder.file("bad.ma", "1 0 0\nv 0 0 0 -1\n");
    let good_mesh = folder.file("good.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let bear = format!("{MODELS}bear.ma");
    let levels = format!("{MODELS}bear.medial");
    let itself = fs::read(&good_mesh).unwrap();
    let new_folder = folder.0.join("new/").to_str().unwrap().to_owned();
    let cases: [(&[&str], &str); 15] = [
        (&["measure", &good_mesh, &good_mesh], "good.obj: it is a triangle mesh; build a medial mesh of it first"),
        (&["info", "no such.ma"], "no such.ma: cannot be read"),
        (&["info", "no such.obj"], "no such.obj: cannot be read"),
        (&["info", &bad_mesh], "bad.obj: line 2: there is no vertex 2"),
        (&["info", &bad_axis], "bad.ma: line 2: the radius is `-1`"),
        (&["measure", &good_mesh, &bad_axis], "bad.ma: line 2"),
        (&["measure", &bear, &bear], "the extension is not .obj"),
        (&["clean", &bear, "-o", "/no such folder/out.ma"], "/no such folder: there is no such folder"),
        (&["build", &bad_mesh, "-o", "out.ma"], "bad.obj: line 2"),
        (&["build", &good_mesh, "-o", &good_mesh], "good.obj: that is the name of a triangle mesh; name it "),
        (&["build", &good_mesh, "-o", MODELS], "it is a folder; name a file in it"),
        (&["build", &good_mesh, "-o", &new_folder], "it is a folder; name a file in it"),
        (&["clean", &bear, "-o", "out.medial"], "out.medial: a clean medial mesh has one level, as text"),
        (&["clean", &levels, "-o", "out.ma"], "bear.medial: levels of detail are clean already"),
        (&["build", &good_mesh, "-o", "/no such folder/out.ma"], "/no such folder: there is no such folder"),
    ];
    for (args, expected) in cases {
        let errors = fails(args, 1);
        assert!(errors.contains(expected) && errors.lines().count() == 1, "{args:?}: {errors}");
    }
    assert_eq!(fs::read(&good_mesh).unwrap(), itself);
    // Flaws of the mesh are printed first because they may be the reason for the failure.
    let output = medial(&["build", &good_mesh, "-o", folder.0.join("out.ma").to_str().unwrap()]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && errors.starts_with("warning: "), "{errors}");
    assert!(errors.contains("boundary edges") && errors.lines().last().unwrap().starts_with("error: "), "{errors}");
    let usage: [&[&str]; 6] = [
        &["measure", &good_mesh],
        &["build", &good_mesh],
        &["build", &good_mesh, "-o", "out.ma", "--spheres", "0"],
        &["build", &good_mesh, "-o", "out.ma", "--max-error", "nan"],
        &["build", &good_mesh, "-o", "out.ma", "--max-error", "-1"],
        &["polish"],
    ];
    for args in usage {
        fails(args, 2);
    }
    assert!(prints(&["--help"]).contains("measure") && prints(&["build", "--help"]).contains("--max-error"));
}
