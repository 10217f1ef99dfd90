//! Arguments, warnings and output for other programs.

use serde_json::Value;

use super::*;

/// The JSON objects of an output, one per line.
fn objects(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

#[test]
fn numbers_out_of_range_are_refused_with_the_range() {
    let spheres = "it is not a whole number from 1 to 1048576";
    let cases = [
        ("--spheres", "4294967295", spheres),
        ("--spheres", "1048577", spheres),
        ("--spheres", "-3", spheres),
        ("--spheres", "1.5", spheres),
        ("--searches", "-1", "it is not a whole number from 1 to 4294967295"),
        ("--seed", "-1", "it is not a whole number from 0 to 18446744073709551615"),
        ("--max-error", "-1", "it is not a positive number"),
        ("--max-error", "0", "it is not a positive number"),
    ];
    for (option, value, expected) in cases {
        let error = fails(&["build", "mesh.obj", "-o", "out.ma", option, value], 2);
        assert!(error.contains(&format!("'{value}' for '{option}")) && error.contains(expected), "{error}");
    }
}

#[test]
fn info_goes_on_after_a_file_with_an_error() {
    let folder = Folder::new("several");
    let mesh = folder.file("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nl 1 2\n");
    let bad = folder.file("bad.ma", "1 0 0\nv 0 0 0 -1\n");
    let bear = format!("{MODELS}bear.ma");
    for (option, marks) in [(None, ["triangles: 1", "slabs"]), (Some("--json"), ["\"triangles\":1", "\"slabs\":"])] {
        let args: Vec<&str> = ["info", &mesh, &bad, "missing.ma", &bear].into_iter().chain(option).collect();
        let output = medial(&args);
        let [text, errors] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(output.status.code(), Some(1), "{errors}");
        assert!(marks.iter().all(|mark| text.contains(mark)), "{text}");
        let lines: Vec<&str> = errors.lines().collect();
        assert_eq!(lines.len(), 3, "{errors}");
        assert_eq!(lines[0], format!("warning: {mesh}: 1 records of lines or points are left out"));
        assert!(lines[1].starts_with("error: ") && lines[1].contains("bad.ma: line 2"), "{errors}");
        assert!(lines[2].starts_with("error: missing.ma: cannot be read"), "{errors}");
    }
}

#[test]
fn json_has_the_numbers_of_the_text() {
    let bear = format!("{MODELS}bear.ma");
    let [medial] = &objects(&prints(&["info", "--json", &bear]))[..] else { panic!("not one object") };
    let (axis, _) = ma::parse(&fs::read(&bear).unwrap()).unwrap().into_medial_axis().unwrap();
    assert_eq!((&medial["file"], &medial["spheres"]), (&Value::from(bear.clone()), &axis.spheres().len().into()));
    let volume = medial["volume"].as_f64().unwrap() as f32;
    assert_eq!((volume, medial["inertia"][2].as_array().map(Vec::len)), (axis.mass().volume, Some(3)));

    let folder = Folder::new("json");
    let mesh = folder.file("bear.obj", &obj("bear"));
    let [row] = &objects(&prints(&["measure", &mesh, &bear, "--json"]))[..] else { panic!("not one object") };
    assert_eq!((row.get("level"), row["spheres"].as_u64()), (None, Some(axis.spheres().len() as u64)));
    let error = measure(&bevy_medial::builder::load::load(Path::new(&mesh)).unwrap(), &axis);
    for (name, deviation) in
        [("mesh_to_envelope", error.mesh_to_envelope), ("envelope_to_mesh", error.envelope_to_mesh)]
    {
        let found = ["max", "mean"].map(|field| row[name][field].as_f64().unwrap() as f32);
        assert_eq!(found, [deviation.max, deviation.mean], "{name}");
    }
    let [surface] = &objects(&prints(&["info", &mesh, "--json"]))[..] else { panic!("not one object") };
    assert_eq!(surface["diagonal"], row["diagonal"]);
    assert!(surface["triangles"].as_u64() > Some(1000) && surface["flaws"].is_array(), "{surface}");
}

/// The name of the output determines what a build writes.
#[test]
fn a_medial_file_has_all_levels() {
    let folder = Folder::new("medial_file");
    let mesh = folder.file("torus.obj", &torus());
    let out = folder.0.join("out.medial");
    let rows = objects(&prints(&["build", &mesh, "-o", out.to_str().unwrap(), "--spheres", "12", "--json"]));
    let levels = MedialLevels::load(&out).unwrap().levels;
    assert!(levels.len() > 2 && rows.len() == levels.len(), "{rows:?}");
    for (number, (row, level)) in rows.iter().zip(&levels).enumerate() {
        assert_eq!((&row["level"], &row["spheres"]), (&number.into(), &level.axis.spheres().len().into()));
        assert_eq!(
            row["mesh_to_envelope"]["max"].as_f64().map(|max| max as f32),
            Some(level.error.mesh_to_envelope.max)
        );
    }
    assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 2, "the finest level is not written as text");
    // The content determines the type.
    let renamed = folder.0.join("levels");
    fs::rename(&out, &renamed).unwrap();
    assert_eq!(objects(&prints(&["info", renamed.to_str().unwrap(), "--json"])).len(), levels.len());
}
