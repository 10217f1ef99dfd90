//! Files are written in full or not at all, and nothing but files is replaced.

use std::{
    io::{BufRead, BufReader},
    process::Stdio,
};

use super::*;

fn names(folder: &Folder) -> Vec<String> {
    let names = fs::read_dir(&folder.0).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<_> = names.collect();
    names.sort();
    names
}

fn clean(output: &Path) -> String {
    prints(&["clean", &format!("{MODELS}bear.ma"), "-o", output.to_str().unwrap()])
}

fn spheres(content: &[u8]) -> usize {
    ma::parse(content).unwrap().spheres.len()
}

#[cfg(unix)]
#[test]
fn pipes_are_written_and_links_followed() {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};

    let folder = Folder::new("kinds");
    let [pipe, link, file] = ["pipe.ma", "link.ma", "file.ma"].map(|name| folder.0.join(name));
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || fs::read(pipe).unwrap()
    });
    clean(&pipe);
    assert!(spheres(&reader.join().unwrap()) > 10);
    assert!(fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());

    fs::write(&file, "before").unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o604)).unwrap();
    symlink("file.ma", &link).unwrap();
    clean(&link);
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(spheres(&fs::read(&file).unwrap()) > 10);
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o604);
    assert_eq!(names(&folder), ["file.ma", "link.ma", "pipe.ma"]);
}

#[test]
fn names_may_have_any_length_of_the_file_system() {
    let folder = Folder::new("long");
    let longest = folder.0.join(format!("{}.ma", "n".repeat(252)));
    clean(&longest);
    assert!(spheres(&fs::read(&longest).unwrap()) > 10);
    assert_eq!(names(&folder).len(), 1);
    // The name with `.medial` is too long. The mesh has no volume, so the error comes before the build.
    let mesh = folder.file("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let before = fs::read(&longest).unwrap();
    let error = fails(&["build", &mesh, "-o", longest.to_str().unwrap(), "--levels"], 1);
    assert!(error.contains(".medial: cannot be written: ") && error.lines().count() == 1, "{error}");
    assert_eq!((names(&folder).len(), fs::read(&longest).unwrap()), (2, before));
}

#[test]
fn both_files_or_none_are_written() {
    let folder = Folder::new("both");
    let mesh = folder.file("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    fs::create_dir(folder.0.join("out.medial")).unwrap();
    let out = folder.0.join("out.ma");
    let error = fails(&["build", &mesh, "-o", out.to_str().unwrap(), "--levels"], 1);
    assert!(error.contains("out.medial: it is a folder") && error.lines().count() == 1, "{error}");
    let triangle = "solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let scan = folder.file("scan", triangle);
    let itself = fails(&["build", &scan, "-o", folder.0.join("./scan").to_str().unwrap()], 1);
    assert!(itself.contains("scan: it is the triangle mesh; name another file"), "{itself}");
    assert_eq!(fs::read_to_string(scan).unwrap(), triangle);
    assert_eq!(names(&folder), ["open.obj", "out.medial", "scan"]);
}

#[test]
fn an_interrupted_build_leaves_nothing() {
    let folder = Folder::new("interrupted");
    // A hole causes a warning, which is printed after the check of the output and before the build.
    let torus = torus();
    let mesh = folder.file("torus.obj", &torus[..torus.rfind('f').unwrap()]);
    let out = folder.0.join("out.medial");
    let args = ["build", &mesh, "-o", out.to_str().unwrap(), "--spheres", "300", "--searches", "1000"];
    let mut build = Command::new(env!("CARGO_BIN_EXE_medial"))
        .args(args)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut warning = String::new();
    BufReader::new(build.stderr.take().unwrap()).read_line(&mut warning).unwrap();
    build.kill().unwrap();
    let status = build.wait().unwrap();
    assert!(warning.contains("boundary edges") && status.code().is_none(), "{warning} {status}");
    assert_eq!(names(&folder), ["torus.obj"]);
}
