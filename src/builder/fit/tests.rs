use glam::{DQuat, DVec3, Vec3};

use super::*;
use crate::{
    builder::{
        Deviation, TwoSidedError,
        mesh::tests::{boxes, circle, prism},
    },
    medial_axis::MedialAxis,
    random::Random,
};

#[test]
fn a_level_no_better_than_a_coarser_one_is_left_out() {
    let kept = |errors: &[f32]| {
        let level = |&max: &f32| Level {
            axis: MedialAxis::torus(1.0, 0.2, 8).unwrap(),
            error: TwoSidedError { mesh_to_envelope: Deviation { max, mean: 0.1 }, ..TwoSidedError::default() },
        };
        let levels: Vec<Level> = errors.iter().map(level).collect();
        useful(levels).iter().map(|level| level.error.max()).collect::<Vec<_>>()
    };
    let cases: [(&[f32], &[f32]); 6] = [
        (&[], &[]),
        (&[3.0], &[3.0]),
        (&[1.0, 2.0, 4.0], &[1.0, 2.0, 4.0]),
        (&[1.0, 5.0, 4.0, 4.0, 7.0], &[1.0, 4.0, 7.0]),
        // The finest level is always kept.
        (&[2.0, 1.0, 3.0], &[2.0, 1.0, 3.0]),
        (&[2.0, 9.0, 8.0, 1.0], &[2.0, 1.0]),
    ];
    for (errors, expected) in cases {
        assert_eq!(kept(errors), expected, "{errors:?}");
    }
}

/// A closed shape with its exact volume.
struct Case {
    name: String,
    mesh: TriangleMesh,
    volume: f64,
}

fn case(name: &str, mesh: TriangleMesh, volume: f64) -> Case {
    Case { name: name.into(), mesh, volume }
}

fn plate(thickness: f64) -> Case {
    case(&format!("plate 1 m x {} mm", thickness * 1e3), boxes(&[[[0.0; 3], [1.0, thickness, 1.0]]]), thickness)
}

/// An octagonal rod with vertices at its ends only.
fn rod(width: f64) -> Case {
    let octagon = circle(8, 0.5 * width);
    let area = 2.0 * std::f64::consts::SQRT_2 * 0.25 * width * width;
    case(&format!("rod 1 m x {} mm", width * 1e3), prism(&octagon, 1.0), area)
}

/// A bottom and four walls, as one surface: a box with a pocket.
fn tray(wall: f64) -> Case {
    let mut mesh = boxes(&[[[0.0; 3], [1.0, 0.3, 1.0]], [[wall; 3], [1.0 - 2.0 * wall, 0.3 - wall, 1.0 - 2.0 * wall]]]);
    // The pocket faces in, and both tops become a rim between them. Quad 3 has the largest y.
    mesh.triangles[12..].iter_mut().for_each(|t| t.swap(1, 2));
    let tops: Vec<usize> = vec![6, 7, 18, 19];
    let mut number = 0..;
    mesh.triangles.retain(|_| number.next().is_some_and(|i: usize| !tops.contains(&i)));
    let (outer, inner) = ([2u32, 6, 7, 3], [10u32, 14, 15, 11]);
    for i in 0..4 {
        let j = (i + 1) % 4;
        mesh.triangles.extend([[outer[i], outer[j], inner[j]], [outer[i], inner[j], inner[i]]]);
    }
    case(&format!("tray, walls {} mm", wall * 1e3), mesh, 0.3 - (1.0 - 2.0 * wall).powi(2) * (0.3 - wall))
}

/// A bar with teeth that reach into it.
fn comb(teeth: u32) -> Case {
    let step = 1.0 / f64::from(teeth);
    let tooth = |i: u32| [[step * f64::from(i), 0.05, 0.0], [0.5 * step, 0.35, 0.1]];
    let each: Vec<_> = std::iter::once([[0.0; 3], [1.0, 0.1, 0.1]]).chain((0..teeth).map(tooth)).collect();
    case(&format!("comb of {} boxes", teeth + 1), boxes(&each), 0.01 + 0.5 * 0.3 * 0.1)
}

fn l_shape(size: f64) -> Case {
    let polygon = [[0.0, 0.0], [1.0, 0.0], [1.0, size], [size, size], [size, 1.0], [0.0, 1.0]];
    case(&format!("L of width {size}"), prism(&polygon, size), size * size * (2.0 - size))
}

fn cube_in_cube() -> Case {
    case("cube in a cube", boxes(&[[[0.0; 3], [1.0; 3]], [[0.3; 3], [0.4; 3]]]), 1.0)
}

fn double_sided_cube() -> Case {
    let mut mesh = boxes(&[[[0.0; 3], [1.0; 3]]]);
    let backs: Vec<_> = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    mesh.triangles.extend(backs);
    case("double-sided cube", mesh, 1.0)
}

fn disc() -> Case {
    let mesh = prism(&circle(48, 1.0), 0.05);
    case("disc 2 m x 5 cm", mesh, 0.05 * 24.0 * (std::f64::consts::TAU / 48.0).sin())
}

/// A tetrahedron with three corners on a circle of radius 1, and a fourth far above.
fn needle(width: f64) -> Case {
    let mut mesh = prism(&circle(3, width), 1.0);
    mesh.positions.truncate(4);
    mesh.positions[3] = Vec3::new(0.0, 0.0, 1.0);
    mesh.triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    case(&format!("needle 1 m x {} mm", 2e3 * width), mesh, 0.75 * 3f64.sqrt() * width * width / 3.0)
}

/// Prints a row of a table. Returns false if the shape is refused. Panics if a mass property is wrong, or if an error names no remedy.
fn examine(case: &Case, options: &FitOptions) -> bool {
    let start = std::time::Instant::now();
    let found = fit(&case.mesh, options, &|_| ControlFlow::Continue(()));
    let seconds = start.elapsed().as_secs_f32();
    let right = Solid::new(&case.mesh).unwrap().mass.unwrap();
    let own = f64::from(right.volume) / case.volume;
    assert!((own - 1.0).abs() < 0.01, "{}: the volume of the mesh is {own} times the right one", case.name);
    match found {
        Ok(levels) => {
            let Level { axis, error } = &levels.levels[0];
            let mass = axis.mass();
            let ratio = f64::from(mass.volume) / case.volume;
            let shift = mass.center_of_mass.distance(right.center_of_mass) / case.mesh.diagonal();
            let [x, y, z] = [0, 1, 2].map(|i| mass.inertia.col(i)[i] / right.inertia.col(i)[i]);
            let [to, back] = [error.mesh_to_envelope.max, error.envelope_to_mesh.max];
            let row = format!(
                "| {} | {} | {ratio:.3} | {:.2} | {x:.2} {y:.2} {z:.2} | {to:.2} | {back:.2} | {seconds:.1} |",
                case.name,
                axis.spheres().len(),
                100.0 * shift
            );
            println!("{row}");
            assert!((ratio - 1.0).abs() < 0.11, "{row}");
            true
        }
        Err(error) => {
            let text = error.to_string();
            println!("| {} | refused in {seconds:.1} s: {text} |", case.name);
            assert!(
                ["allow more spheres", "give its sheets", "scale it up"].iter().any(|way| text.contains(way)),
                "{text}"
            );
            false
        }
    }
}

/// Prints the table of `docs/accuracy.md`.
#[test]
#[ignore = "table"]
fn table_of_thin_and_boxy_shapes() {
    let thin = [0.04, 0.01, 0.004, 0.002, 0.001];
    let cases = (thin.map(plate).into_iter())
        .chain(thin.map(rod))
        .chain([0.05, 0.02, 0.01].map(tray))
        .chain([0.02, 0.001].map(needle))
        .chain([comb(10), comb(40), double_sided_cube(), cube_in_cube(), l_shape(0.5), l_shape(0.1), disc()]);
    for case in cases {
        let of = |spheres: Option<usize>| examine(&case, &FitOptions { spheres, ..FitOptions::default() });
        if !of(Some(60)) {
            of(Some(200));
        }
    }
}

/// Options with which a build takes about a second.
fn quick(spheres: usize) -> FitOptions {
    FitOptions { spheres: Some(spheres), searches: Some(1), ..FitOptions::default() }
}

#[test]
fn thin_and_boxy_shapes_have_their_mass_or_are_refused() {
    let built = [
        (plate(0.04), 20),
        (rod(0.04), 12),
        (rod(0.004), 12),
        (rod(0.001), 30),
        (tray(0.05), 30),
        (comb(10), 40),
        (l_shape(0.1), 20),
        (double_sided_cube(), 20),
        (cube_in_cube(), 20),
    ];
    for (case, spheres) in built {
        assert!(examine(&case, &quick(spheres)), "{}", case.name);
    }
    // Either result is right here.
    for (case, spheres) in [(plate(0.002), 20), (plate(0.001), 60), (needle(0.001), 60)] {
        examine(&case, &quick(spheres));
    }
    for (case, spheres) in [(tray(0.01), 12), (plate(0.001), 3), (disc(), 3)] {
        assert!(!examine(&case, &quick(spheres)), "{}", case.name);
    }
}

#[test]
fn what_encloses_no_volume_is_left_out_or_refused() {
    let mut random = Random(7);
    let one = boxes(&[[[0.0; 3], [1.0; 3]]]);
    let mut leaves = TriangleMesh { positions: vec![], triangles: vec![] };
    for i in 0..1000 {
        let at = random.in_cube() * 4.0;
        leaves.positions.extend([0, 1, 2].map(|_| at + random.in_cube() * 0.3));
        leaves.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let refused = |mesh: &TriangleMesh| fit(mesh, &quick(20), &|_| ControlFlow::Continue(())).unwrap_err();
    assert_eq!(refused(&leaves), BuildError::NoVolume);
    let mut among = leaves.clone();
    among.triangles.extend(one.triangles.iter().map(|t| t.map(|i| i + 3000)));
    among.positions.extend(&one.positions);
    assert!(examine(&case("cube among leaves", among, 1.0), &quick(20)));
    let mut flat = one.clone();
    flat.positions.iter_mut().for_each(|p| p.z = 0.0);
    assert!(matches!(refused(&flat), BuildError::Empty | BuildError::NoVolume));
    for size in [1e-23, 1e-9] {
        let mut tiny = one.clone();
        tiny.positions.iter_mut().for_each(|p| *p *= size);
        assert!(matches!(refused(&tiny), BuildError::TooSmall { .. }), "{size}");
    }
}

#[test]
fn the_best_number_of_spheres_is_used() {
    let error = |max_error: f32| {
        let options = FitOptions { max_error: Some(max_error), ..quick(40) };
        fit(&rod(0.004).mesh, &options, &|_| ControlFlow::Continue(())).unwrap().levels[0].error.max()
    };
    let [strict, loose] = [0.01, 3.0].map(error);
    assert!(strict <= loose && loose <= 3.0, "{strict} {loose}");
}

#[test]
fn random_thin_shapes_have_their_mass_or_are_refused() {
    examine_random_shapes(24);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_random_thin_shapes_have_their_mass_or_are_refused() {
    examine_random_shapes(500);
}

fn examine_random_shapes(count: usize) {
    let mut random = Random(12);
    let (mut built, mut refused) = (0, 0);
    for number in 0..count {
        let thickness = 10f64.powf(-1.0 - 2.5 * random.unit_f64());
        let mut case = match number % 8 {
            0 => plate(thickness),
            1 => rod(thickness),
            2 => tray(0.5 * thickness + 0.01),
            3 => needle(thickness),
            4 => comb(2 + random.below(12) as u32),
            5 => l_shape(thickness + 0.02),
            6 => double_sided_cube(),
            _ => cube_in_cube(),
        };
        let scale = 10f64.powf(3.0 * random.unit_f64() - 1.5);
        let turn = DQuat::from_scaled_axis(random.in_cube().as_dvec3() * 3.0);
        let stretch = DVec3::new(1.0, 0.2 + random.unit_f64(), 0.2 + random.unit_f64());
        case.mesh.positions.iter_mut().for_each(|p| *p = (turn * (p.as_dvec3() * stretch) * scale).as_vec3());
        case.volume *= scale.powi(3) * stretch.element_product();
        case.name = format!("{number}: {}", case.name);
        if examine(&case, &quick(4 + random.below(30))) { built += 1 } else { refused += 1 }
    }
    println!("{built} built, {refused} refused");
    assert!(built > count / 2 && refused > 0, "{built} built, {refused} refused");
}
