//! Files of programs that interpret a format freely, and parts of formats that few programs write.

use super::*;

#[test]
fn the_size_of_a_binary_stl_file_need_not_match_its_header() {
    let (mesh, good) = (tetrahedron(), stl_binary(&tetrahedron()));
    assert!(good.starts_with(b"solid"));
    let with_count = |count: u32| {
        let mut bytes = good.clone();
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        bytes
    };
    let cases = [
        (good.clone(), 4, vec![]),
        ([&good[..], &[0; 2]].concat(), 4, vec!["2 bytes after the last triangle are left out"]),
        (with_count(3), 3, vec!["50 bytes after the last triangle are left out"]),
        (with_count(0), 4, vec!["the header declares 0 triangles, the 4 in the file are read"]),
        (
            [&with_count(0)[..], &[0; 2]].concat(),
            4,
            vec![
                "the header declares 0 triangles, the 4 in the file are read",
                "2 bytes after the last triangle are left out",
            ],
        ),
    ];
    for (bytes, count, expected) in cases {
        let Loaded { mesh: read, warnings } = read_bytes(MeshFormat::Stl, &bytes);
        assert_eq!(
            (corners(&read), warnings),
            (corners(&mesh)[..count].to_vec(), expected.iter().map(|w| w.to_string()).collect())
        );
    }
    let cut = parse(MeshFormat::Stl, &with_count(5)).unwrap_err().to_string();
    assert_eq!(cut, "the end of the file: the header declares 334 bytes, there are 284; export it again");
    let empty = parse(MeshFormat::Stl, &with_count(0)[..84]).unwrap_err().to_string();
    assert!(empty.starts_with("the mesh: the mesh has no triangles"), "{empty}");
}

#[test]
fn text_has_any_line_end_and_byte_order_mark() {
    let mesh = tetrahedron();
    let normals = String::from_utf8(stl_text(&mesh)).unwrap().replace("normal 0 0 0", "normal nan -nan(ind) NaN");
    assert!(normals.contains("nan(ind)"));
    let texts = [
        (MeshFormat::Obj, String::from_utf8(obj(&mesh)).unwrap()),
        (MeshFormat::Stl, normals),
        (MeshFormat::Ply, String::from_utf8(ply(&mesh, "ascii")).unwrap()),
    ];
    for (format, text) in texts {
        for (mark, end) in ["\n", "\r\n", "\r"].into_iter().flat_map(|end| [("", end), ("\u{feff}", end)]) {
            // The parser of PLY headers accepts no mark.
            if format == MeshFormat::Ply && !mark.is_empty() {
                continue;
            }
            let bytes = format!("{mark}{}", text.replace('\n', end)).into_bytes();
            let read = read_bytes(format, &bytes);
            assert_eq!((corners(&read.mesh), read.warnings), (corners(&mesh), vec![]), "{format:?} {mark:?} {end:?}");
        }
    }
    // Errors count lines with all ends.
    for end in ["\n", "\r\n", "\r"] {
        let text = "v 0 0 0\nv 0 nan 0\n".replace('\n', end);
        assert!(error(MeshFormat::Obj, &text).starts_with("line 2: `nan`"), "{end:?}");
    }
    // The first byte of a body may be an LF after a header whose lines end in CR.
    let binary =
        ply(&TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap(), "binary_little_endian");
    let split = binary.windows(11).position(|bytes| bytes == b"end_header\n").unwrap() + 11;
    let head = String::from_utf8_lossy(&binary[..split]).replace('\n', "\r");
    let mut body = binary[split..].to_vec();
    body[0] = b'\n';
    let read = read_bytes(MeshFormat::Ply, &[head.as_bytes(), &body].concat()).mesh;
    assert_eq!(read.positions[0], Vec3::X * f32::from_bits(u32::from(b'\n')));
}

#[test]
fn objects_of_an_obj_file_are_one_mesh() {
    let head = "o one\nv 0 0 0\nv 1 0 0\nv 0 1 0\ng front back\nusemtl red\nf 1 2 3\no two\n";
    let two = read_bytes(MeshFormat::Obj, format!("{head}v 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\nf 4 5 3\n").as_bytes());
    assert_eq!((two.mesh.triangles, two.warnings), (vec![[0, 1, 2], [3, 4, 5], [3, 4, 2]], vec![]));
    let lines = read_bytes(MeshFormat::Obj, format!("{head}l 1 2\np 1 2 3\n").as_bytes());
    assert_eq!(
        (lines.mesh.triangles.len(), &lines.warnings[..]),
        (1, &["2 records of lines or points are left out".into()][..])
    );
    let reported = error(MeshFormat::Obj, &format!("{head}surf 0 1 0 1 1 2 3\n"));
    assert_eq!(reported, "line 9: it is a free-form surface; convert it to triangles and export it again");
}

#[test]
fn content_determines_the_format() {
    let mesh = ring();
    for (name, format, bytes) in files(&mesh) {
        let found = MeshFormat::detect(&bytes, Path::new("scan"));
        // OBJ files have no mark, so the extension decides.
        let expected = Some(format).filter(|format| *format != MeshFormat::Obj);
        assert_eq!(found, expected, "{name}");
        assert_eq!(
            MeshFormat::detect(&bytes, Path::new("scan.OBJ")),
            Some(expected.unwrap_or(MeshFormat::Obj)),
            "{name}"
        );
    }
    let folder = std::env::temp_dir().join(format!("bevy_medial_detect_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let [wrong, unknown] = ["really stl.ply", "model.fbx"].map(|name| folder.join(name));
    std::fs::write(&wrong, [&stl_binary(&mesh)[..], &[0; 2]].concat()).unwrap();
    std::fs::write(&unknown, obj(&mesh)).unwrap();
    let results = [read(&wrong), read(&unknown)].map(|result| result.map_err(|error| error.to_string()));
    std::fs::write(&wrong, stl_binary(&mesh)).unwrap();
    let whole = load(&wrong);
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(matches!(&results[0], Err(error) if error.contains("really stl.ply: ")), "{results:?}");
    assert!(matches!(&results[1], Err(error) if error.contains("the extension is not .obj")), "{results:?}");
    assert_eq!(corners(&whole.unwrap()), corners(&mesh));
}
