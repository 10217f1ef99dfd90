//! The builder on generated shapes, intact and damaged.

use std::{collections::HashSet, f32::consts::TAU, ops::ControlFlow, sync::Mutex};

use bevy_medial::{
    builder::{BuildError, BuildOptions, Built, TriangleMesh, build, build_levels, measure},
    geometry::Primitive,
    medial_axis::{MedialAxis, ma},
    random::Random,
};
use glam::Vec3;

fn with(spheres: usize) -> BuildOptions {
    BuildOptions { spheres, ..BuildOptions::default() }
}

fn built(mesh: &TriangleMesh, options: &BuildOptions) -> Result<Built, BuildError> {
    build(mesh, options, &|_| ControlFlow::Continue(()))
}

/// A closed torus of `rings` times `around` quads.
fn torus(major: f32, minor: f32, rings: u32, around: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    for i in 0..rings {
        for j in 0..around {
            let (u, v) = (TAU * i as f32 / rings as f32, TAU * j as f32 / around as f32);
            let reach = major + minor * v.cos();
            mesh.positions.push(Vec3::new(reach * u.cos(), reach * u.sin(), minor * v.sin()));
            let at = |i: u32, j: u32| (i % rings) * around + j % around;
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    mesh
}

/// Adds a box.
fn add_box(mesh: &mut TriangleMesh, min: Vec3, size: Vec3) {
    let first = mesh.positions.len() as u32;
    for corner in 0..8u32 {
        let unit = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
        mesh.positions.push(min + unit * size);
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in quads.map(|q: [u32; 4]| q.map(|i| first + i)) {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// Boxes, side by side along x with gaps of half their size.
fn boxes(count: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    (0..count).for_each(|number| add_box(&mut mesh, Vec3::X * (1.5 * number as f32), Vec3::ONE));
    mesh
}

/// Number of connected components. Primitives are connected by shared spheres.
fn components(axis: &MedialAxis) -> usize {
    let mut label: Vec<u32> = (0..axis.spheres().len() as u32).collect();
    for _ in 0..label.len() {
        for primitive in axis.primitives() {
            let least = primitive.indices().iter().map(|&i| label[i as usize]).min().unwrap();
            primitive.indices().iter().for_each(|&i| label[i as usize] = least);
        }
    }
    label.into_iter().collect::<HashSet<_>>().len()
}

/// Number of edges, including those of faces, and number of faces.
fn counts(axis: &MedialAxis) -> (usize, usize) {
    let mut edges = HashSet::new();
    let mut faces = 0;
    for primitive in axis.primitives() {
        match *primitive {
            Primitive::Sphere(_) => {}
            Primitive::Cone(e) => {
                edges.insert(e);
            }
            Primitive::Slab([i, j, k]) => {
                edges.extend([[i, j], [j, k], [i, k]]);
                faces += 1;
            }
        }
    }
    (edges.len(), faces)
}

#[test]
fn a_torus_is_built_as_a_closed_ring() {
    let (major, minor) = (0.2, 0.0525);
    let mesh = torus(major, minor, 200, 64);
    let Built { axis, report } = built(&mesh, &with(26)).unwrap();
    assert_eq!(components(&axis), 1);
    assert!(axis.spheres().len() <= 26);
    println!("{report:?}");
    // The error of a regular ring of 26 spheres is 0.0010.
    assert!(report.max_error < 0.0012, "{report:?}");
    // The hole stays open.
    let (edges, _) = counts(&axis);
    assert!(edges >= axis.spheres().len(), "too few edges for a ring: {edges}");
}

#[test]
fn pieces_too_small_for_samples_get_spheres() {
    for seed in 1..4 {
        let mut house = TriangleMesh { positions: vec![], triangles: vec![] };
        add_box(&mut house, Vec3::ZERO, Vec3::new(10.0, 10.0, 5.0));
        // The knobs are so far away that the error of the house does not cover them.
        let knobs = [0.05, 0.02, 0.01].map(|size| (Vec3::new(11.5, 3.0 + 100.0 * size, 1.07), size));
        knobs.iter().for_each(|&(min, size)| add_box(&mut house, min, Vec3::splat(size)));
        let axis = built(&house, &BuildOptions { seed, ..with(20) }).unwrap().axis;
        assert_eq!(components(&axis), 4, "seed {seed}");
        for (min, size) in knobs {
            let within = |center: Vec3| (center - min).min_element() > 0.0 && (center - min).max_element() < size;
            assert!(axis.spheres().iter().any(|sphere| within(sphere.center)), "seed {seed}: no sphere in {size} m");
        }
    }
}

#[test]
fn each_of_many_pieces_gets_a_sphere() {
    let mut tree = TriangleMesh { positions: vec![], triangles: vec![] };
    add_box(&mut tree, Vec3::ZERO, Vec3::new(1.0, 1.0, 20.0));
    // The leaves enclose no volume.
    for i in 0..1500 {
        let first = tree.positions.len() as u32;
        let at = Vec3::new(2.0 + 0.1 * (i % 40) as f32, 0.0, 0.5 * (i / 40) as f32);
        tree.positions.extend([Vec3::ZERO, Vec3::X, Vec3::Z].map(|corner| at + 0.05 * corner));
        tree.triangles.push([first, first + 1, first + 2]);
    }
    let fruits: Vec<Vec3> = (0..20).map(|i| Vec3::new(-3.0, 0.0, i as f32)).collect();
    fruits.iter().for_each(|&min| add_box(&mut tree, min, Vec3::splat(0.1)));
    let axis = built(&tree, &with(60)).unwrap().axis;
    for min in fruits {
        let within = |center: Vec3| (center - min).min_element() > 0.0 && (center - min).max_element() < 0.1;
        assert!(axis.spheres().iter().any(|sphere| within(sphere.center)), "no sphere in the fruit at {min}");
    }
    // The error counts all components.
    let error = built(&boxes(1500), &with(60)).unwrap_err();
    assert_eq!(error, BuildError::TooFewSpheres { components: 1500, spheres: 60 });
}

#[test]
fn thin_sheets_and_rods_are_solid() {
    for size in [Vec3::new(20.0, 20.0, 0.002), Vec3::new(100.0, 0.008, 0.008)] {
        let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
        add_box(&mut mesh, Vec3::ZERO, size);
        let error = measure(&mesh, &built(&mesh, &with(30)).unwrap().axis);
        assert!(error.max() < 3.0, "{size}: {error}");
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    check_bytes(&torus(0.3, 0.1, 20, 8));
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_the_same_input_gives_the_same_bytes() {
    check_bytes(&torus(0.3, 0.1, 60, 20));
}

fn check_bytes(mesh: &TriangleMesh) {
    let text = |seed: u64| {
        let options = BuildOptions { seed, ..with(12) };
        let levels = build_levels(mesh, &options, &|_| ControlFlow::Continue(())).unwrap();
        levels.iter().map(|level| ma::write(&ma::MaFile::from(&level.axis))).collect::<String>()
    };
    let first = text(1);
    assert_eq!(first, text(1));
    assert_ne!(first, text(2), "the seed has no effect, so equal bytes prove nothing");
}

#[test]
fn each_component_becomes_one_shape() {
    for (count, spheres) in [(1, 1), (1, 5), (3, 3), (3, 20), (5, 23)] {
        let Built { axis, report } = built(&boxes(count), &with(spheres)).unwrap();
        assert_eq!((components(&axis), report.components), (count as usize, count as usize), "{spheres} spheres");
        assert!(axis.spheres().len() <= spheres);
    }
    assert_eq!(built(&boxes(4), &with(3)).unwrap_err(), BuildError::TooFewSpheres { components: 4, spheres: 3 });
}

#[test]
fn spheres_do_not_bulge_out_of_a_hole() {
    let mut mesh = boxes(1);
    // Each side in turn is removed.
    for side in 0..6 {
        mesh.triangles.rotate_left(2);
        let open = TriangleMesh { triangles: mesh.triangles[2..].to_vec(), ..mesh.clone() };
        let axis = built(&open, &with(20)).unwrap().axis;
        let error = measure(&mesh, &axis);
        assert!(error.max() < 6.0, "side {side}: {error}");
        assert!(measure(&open, &axis).max() > 20.0, "side {side} is not open");
    }
}

/// Number of spheres of each level, for a finest level of 20.
const CHAIN_OF_20: [usize; 11] = [20, 17, 14, 11, 9, 7, 5, 4, 3, 2, 1];

#[test]
fn limits_on_edges_and_faces_hold() {
    check_limits(&[(22, 1)]);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_limits_on_edges_and_faces_hold() {
    check_limits(&[(19, 0), (22, 1), (30, 5)]);
}

/// Checks limits on the numbers of edges and faces.
fn check_limits(limits: &[(usize, usize)]) {
    let mesh = boxes(1);
    let free = built(&mesh, &with(20)).unwrap();
    let (edges, faces) = counts(&free.axis);
    assert!(edges > 19 || faces > 0, "nothing to limit: {edges} edges, {faces} faces");
    let none = BuildOptions { edges: Some(usize::MAX), faces: Some(usize::MAX), ..with(20) };
    built(&mesh, &BuildOptions { spheres: 3, ..none }).expect("the largest limits are valid");
    for &(edges, faces) in limits {
        let options = BuildOptions { edges: Some(edges), faces: Some(faces), ..with(20) };
        let levels = build_levels(&mesh, &options, &|_| ControlFlow::Continue(())).unwrap();
        for (level, spheres) in levels.iter().zip(CHAIN_OF_20) {
            let found = counts(&level.axis);
            assert!(found.0 <= edges && found.1 <= faces, "{found:?} of {edges} and {faces}");
            // Merged spheres may leave up to two edges or faces above the share of a coarser level.
            let [edges, faces] = [edges, faces].map(|limit| limit * spheres / 20 + 2);
            assert!(found.0 <= edges && found.1 <= faces, "{found:?} of {edges} and {faces}, {spheres} spheres");
        }
    }
}

#[test]
fn levels_shrink_down_to_one_sphere() {
    let mesh = torus(0.3, 0.1, 60, 20);
    let options = BuildOptions { edges: Some(20), faces: Some(0), ..with(20) };
    let reported = Mutex::new(Vec::new());
    let report = |part: f32| {
        reported.lock().unwrap().push(part);
        ControlFlow::Continue(())
    };
    let levels = build_levels(&mesh, &options, &report).unwrap();
    let reported = reported.into_inner().unwrap();
    assert!(reported.is_sorted() && reported[0] >= 0.0, "progress decreases: {reported:?}");
    assert!((0.9..=1.0).contains(reported.last().unwrap()), "{reported:?}");
    let spheres: Vec<usize> = levels.iter().map(|l| l.axis.spheres().len()).collect();
    println!("{spheres:?} {:?}", levels.iter().map(|l| l.report.rms_error).collect::<Vec<_>>());
    assert_eq!(spheres, CHAIN_OF_20);
    assert!(levels.iter().all(|l| components(&l.axis) == 1));
    for level in &levels {
        let (spheres, (edges, faces)) = (level.axis.spheres().len(), counts(&level.axis));
        assert!(edges <= spheres && faces == 0, "{edges} edges and {faces} faces of {spheres} spheres");
    }
}

#[test]
fn more_searches_find_better_shapes() {
    let cases = [(torus(0.3, 0.1, 60, 20), 12), (torus(0.3, 0.1, 60, 20), 7), (boxes(1), 5), (boxes(2), 9)];
    let error = |mesh: &TriangleMesh, spheres: usize, searches: usize| {
        let options = BuildOptions { searches: Some(searches), ..with(spheres) };
        let error = measure(mesh, &built(mesh, &options).unwrap().axis);
        let [to, back] = [&error.mesh_to_envelope, &error.envelope_to_mesh];
        to.max * back.max * to.mean.max(back.mean)
    };
    let ratios = cases.map(|(mesh, spheres)| error(&mesh, spheres, 5) / error(&mesh, spheres, 1));
    println!("{ratios:?}");
    // The builder and `measure` use different samples.
    assert!(ratios.iter().all(|&ratio| ratio < 1.05), "{ratios:?}");
    assert!(ratios.iter().any(|&ratio| ratio < 0.98), "{ratios:?}");
}

#[test]
fn an_inside_out_mesh_is_built_as_well() {
    let mut mesh = boxes(2);
    let right = built(&mesh, &with(10)).unwrap();
    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    let turned = built(&mesh, &with(10)).unwrap();
    assert!(turned.report.max_error < 2.0 * right.report.max_error, "{:?}", turned.report);
}

#[test]
fn invalid_meshes_and_cancelled_builds_are_errors() {
    let empty = TriangleMesh { positions: vec![], triangles: vec![] };
    assert_eq!(built(&empty, &with(5)).unwrap_err(), BuildError::Empty);
    let sheet = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE.with_z(0.0)],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
    };
    assert_eq!(built(&sheet, &with(5)).unwrap_err(), BuildError::NoVolume);
    let mut broken = boxes(1);
    broken.triangles[3][1] = 99;
    assert_eq!(built(&broken, &with(5)).unwrap_err(), BuildError::IndexOutOfRange { triangle: 3, index: 99 });
    let mut broken = boxes(1);
    broken.positions[2].y = f32::NAN;
    assert_eq!(built(&broken, &with(5)).unwrap_err(), BuildError::NotFinite { vertex: 2 });
    let stop =
        build(&boxes(1), &with(5), &|part| if part > 0.3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) });
    assert_eq!(stop.unwrap_err(), BuildError::Cancelled);
}

#[test]
fn damaged_meshes_are_built_or_refused() {
    build_damaged_meshes(4, 20);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_damaged_meshes_are_built_or_refused() {
    build_damaged_meshes(8, 1000);
}

fn build_damaged_meshes(seed: u64, cases: u32) {
    let mut source = Random(seed);
    let mut random = |below: usize| source.below(below);
    let (mut whole, mut refused) = (0, 0);
    for case in 0..cases {
        let mut mesh = if case % 2 == 0 { boxes(1 + case % 3) } else { torus(0.3, 0.1, 8, 6) };
        for _ in 0..1 + random(12) {
            let triangle = random(mesh.triangles.len());
            let vertex = random(mesh.positions.len());
            match random(7) {
                0 => drop(mesh.triangles.swap_remove(triangle)),
                1 => mesh.triangles[triangle].swap(0, 1),
                2 => mesh.triangles.push(mesh.triangles[triangle]),
                3 => mesh.triangles[triangle][random(3)] = vertex as u32,
                4 => mesh.positions[vertex] *= [0.0, 2.0, -3.0, 1e-8, 1e5][random(5)],
                5 => mesh.positions[vertex] = mesh.positions[random(mesh.positions.len())],
                _ => mesh.positions.push(Vec3::splat(50.0)),
            }
        }
        let quick = BuildOptions { searches: Some(1), ..with(1 + random(12)) };
        match built(&mesh, &quick) {
            Ok(Built { axis, .. }) => {
                whole += 1;
                let (_, again) = MedialAxis::new(axis.spheres().to_vec(), axis.primitives().to_vec()).unwrap();
                assert!(again.is_empty(), "case {case}: {again}");
            }
            Err(error) => {
                refused += 1;
                assert!(!error.to_string().is_empty());
            }
        }
    }
    println!("{whole} built, {refused} refused");
    assert!(whole > cases / 2 && refused > cases / 100, "{whole} built, {refused} refused");
}
