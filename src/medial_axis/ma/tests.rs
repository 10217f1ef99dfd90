use proptest::prelude::*;

use super::*;
use crate::{medial_axis::oracle, random::Random};

const GOOD: &str = "# a comment\n\n4 2 1\nv 0 0 0 1\nv 1.5 0 -2e-3 .5\r\nv 0 3 0 0.25\n  # another\n\
                    v 0 0 9 0\ne 0 1\ne 2 3\n\nf 0 1 2\n\n";

#[test]
fn reads_comments_blank_lines_crlf_and_faces_without_edges() {
    let file = parse(GOOD.as_bytes()).unwrap();
    assert_eq!(file.spheres[1], Sphere::new(Vec3::new(1.5, 0.0, -2e-3), 0.5));
    assert_eq!((file.spheres.len(), &file.edges[..], &file.faces[..]), (4, &[[0, 1], [2, 3]][..], &[[0, 1, 2]][..]));
    assert_eq!(parse(GOOD.trim_end().as_bytes()), Ok(file.clone()), "no newline at the end");
    assert_eq!(parse(GOOD.replace('\n', "\r\n").as_bytes()), Ok(file));
}

#[test]
fn errors_name_line_and_cause() {
    let cases: &[(&str, &str)] = &[
        ("", "line 1: no header: expected `spheres edges faces`"),
        ("# only\n\n", "line 1: no header: expected `spheres edges faces`"),
        ("\n0 0 0\n", "line 2: an empty mesh: the header declares no spheres"),
        ("1 0\nv 0 0 0 1", "line 1: the number of faces is missing"),
        ("1 0 0 0\nv 0 0 0 1", "line 1: trailing `0`"),
        ("-1 0 0", "line 1: the number of spheres is `-1`, not a whole number from 0 to 4294967295"),
        ("1 4294967296 0", "line 1: the number of edges is `4294967296`, not a whole number from 0 to 4294967295"),
        ("4294967295 0 0\nv 0 0 0 1", "line 1: the header declares 4294967295 `v` records, the file has 1"),
        ("1 0 4294967295\nv 0 0 0 1", "line 1: the header declares 4294967295 `f` records, the file has 0"),
        ("# c\n1 1 0\nv 0 0 0 1", "line 2: the header declares 1 `e` records, the file has 0"),
        ("1 0 0\nv 0 0 0 1\n\nv 0 0 0 1", "line 4: one `v` record more than the 1 that the header declares"),
        ("2 0 0\nv 0 0 0 1\nv 0 0 1 1\ne 0 1", "line 4: one `e` record more than the 0 that the header declares"),
        ("1 0 0\nv 0 0 0", "line 2: the radius is missing"),
        ("1 0 0\nv 0 0 0 1 7", "line 2: trailing `7`"),
        ("1 0 0\nv 0 0 0 1 # no", "line 2: trailing `#`"),
        ("1 0 0\nv 0 0 0 1\nend", "line 3: expected a record `v`, `e` or `f`, found `end`"),
        ("1 0 0\nvt 0 0 0 1", "line 2: expected a record `v`, `e` or `f`, found `vt`"),
        ("1 0 0\nv 0 nan 0 1", "line 2: y is `nan`, not a finite number"),
        ("1 0 0\nv 0 0 -inf 1", "line 2: z is `-inf`, not a finite number"),
        ("1 0 0\nv 1e39 0 0 1", "line 2: x is `1e39`, not a finite number"),
        ("1 0 0\nv 0 0 0 one", "line 2: the radius is `one`, not a finite number"),
        ("1 0 0\nv 0 0 0 -0.5", "line 2: the radius is `-0.5`, which is negative"),
        ("2 1 0\nv 0 0 0 1\nv 0 0 1 1\ne 0 2", "line 4: there is no sphere 2: the header declares 2"),
        ("2 1 0\nv 0 0 0 1\nv 0 0 1 1\ne 1 1", "line 4: sphere 1 is repeated"),
        ("2 1 0\nv 0 0 0 1\nv 0 0 1 1\ne 1", "line 4: an index is missing"),
        ("2 1 0\nv 0 0 0 1\nv 0 0 1 1\ne 0 1.0", "line 4: an index is `1.0`, not a whole number from 0 to 4294967295"),
        ("2 0 1\nv 0 0 0 1\nv 0 0 1 1\nf 0 1 0", "line 4: sphere 0 is repeated"),
    ];
    for (text, message) in cases {
        assert_eq!(parse(text.as_bytes()).unwrap_err().to_string(), *message, "{text:?}");
    }
    assert_eq!(parse(b"1 0 0\nv 0 0 0 \xff").unwrap_err().to_string(), "line 2: not UTF-8 text");
}

#[test]
fn real_files_survive_a_round_trip() {
    let research = ["dinosaur.ma", "bug.ma", "torus.ma", "qmat/cow_q82.ma"];
    for path in oracle::model_files(&["cow.ma", "deer.ma", "torus.ma"], &research) {
        let name = path.display();
        let file = parse(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!(parse(write(&file).as_bytes()), Ok(file.clone()), "{name}");
        let (axis, _) = file.into_medial_axis().unwrap();
        let (again, report) = MaFile::from(&axis).into_medial_axis().unwrap();
        assert_eq!((axis.spheres(), axis.primitives()), (again.spheres(), again.primitives()), "{name}: {report}");
    }
}

proptest! {
    #[test]
    fn every_finite_f32_survives_a_round_trip(bits in proptest::collection::vec(any::<[u32; 4]>(), 3..9)) {
        let number = |bits: u32| Some(f32::from_bits(bits)).filter(|n| n.is_finite()).unwrap_or(0.1);
        let spheres = bits.iter().map(|&[x, y, z, r]| {
            Sphere::new(Vec3::new(number(x), number(y), number(z)), number(r).abs())
        });
        let file = MaFile { spheres: spheres.collect(), edges: vec![[0, 1]], faces: vec![[2, 1, 0]] };
        prop_assert_eq!(parse(write(&file).as_bytes()), Ok(file));
    }
}

#[test]
fn mutated_files_never_panic() {
    const TOKENS: [&str; 12] =
        ["nan", "-1", "1e999", "4294967295", "99999999999", "#", "v", "f 0 1 2\n", "\n", "\r", " ", "\u{e9}"];
    let mut random = Random(7);
    let (mut accepted, mut refused, mut shapes) = (0, 0, 0);
    for _ in 0..100_000 {
        let mut bytes = GOOD.as_bytes().to_vec();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len() + 1);
            match random.below(5) {
                0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << random.below(8)),
                1 => bytes.truncate(bytes.len() - at.min(random.below(8))),
                2 => drop(bytes.splice(at..at, TOKENS[random.below(12)].bytes())),
                3 => {
                    let mut lines: Vec<_> = bytes.split_inclusive(|&byte| byte == b'\n').collect();
                    let count = lines.len();
                    if count > 0 {
                        lines.swap(random.below(count), random.below(count));
                    }
                    bytes = lines.concat();
                }
                _ => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte = b"0123456789.-e v\n"[at % 16]),
            }
        }
        match parse(&bytes) {
            Ok(file) => {
                accepted += 1;
                let text = write(&file);
                assert_eq!(parse(text.as_bytes()).as_ref(), Ok(&file), "{text}");
                // Only numbers beyond the extent are valid in the format and invalid in a shape.
                shapes += usize::from(super::super::validate(&file.spheres, &file.primitives()).is_ok());
            }
            Err(error) => {
                refused += 1;
                assert!(error.line >= 1 && error.line <= bytes.split(|&byte| byte == b'\n').count(), "{error}");
            }
        }
    }
    println!("{accepted} accepted, {refused} refused, {shapes} shapes");
    assert!(accepted > 10_000 && refused > 10_000 && shapes > 0 && shapes <= accepted);
}
