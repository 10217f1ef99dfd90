use std::ops::ControlFlow;

use glam::{DQuat, Vec3};

use super::*;
use crate::{
    builder::{
        FitOptions, MedialLevels, TriangleMesh, fit,
        mesh::tests::{boxes, circle, prism, triangulated},
    },
    random::Random,
};

/// The mesh, turned and moved.
fn turned(random: &mut Random, mesh: &TriangleMesh) -> TriangleMesh {
    let turn = DQuat::from_axis_angle(random.in_cube().as_dvec3().normalize(), f64::from(3.0 * random.unit()));
    let shift = random.in_cube().as_dvec3() * f64::from(mesh.diagonal());
    let mut mesh = mesh.clone();
    mesh.positions.iter_mut().for_each(|p| *p = (turn * p.as_dvec3() + shift).as_vec3());
    mesh
}

fn found(mesh: &TriangleMesh) -> Option<[Level; 2]> {
    exact(&Solid::new(mesh).unwrap(), 60, f64::INFINITY)
}

fn fitted(mesh: &TriangleMesh, options: &FitOptions) -> MedialLevels {
    fit(mesh, options, &|_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn boxes_of_all_proportions_are_built_without_a_search() {
    let mut random = Random(6);
    for number in 0..60 {
        let thin = 10f32.powf(-2.0 * random.unit());
        let size = match number % 3 {
            0 => Vec3::new(1.0, 0.2 + random.unit(), 0.2 + random.unit()),
            1 => Vec3::new(1.0, 1.0, thin),
            _ => Vec3::new(1.0, thin, thin),
        };
        let size = size.as_dvec3() * 3.0;
        let mesh = turned(&mut random, &boxes(&[[[0.0; 3], size.to_array()]]));
        let levels = fitted(&mesh, &FitOptions { levels: true, error_limit: 50.0, ..FitOptions::default() });
        let [finest, coarse] = &levels.levels[..] else { panic!("{size}: {} levels", levels.levels.len()) };
        assert!(finest.error.max() < 0.31, "{size}: {}", finest.error);
        let [fine, few] = [finest, coarse].map(|level| level.axis.primitives().len());
        assert!(few < fine && fine <= 22, "{size}: {fine} {few}");
        let ratio = f64::from(finest.axis.mass().volume) / size.element_product();
        assert!((ratio - 1.0).abs() < 0.02, "{size}: {ratio}");
        let mass = f64::from(levels.into_medial_axis().unwrap().mass().volume);
        assert!((mass / size.element_product() - 1.0).abs() < 1e-3, "{size}: {mass}");
    }
}

#[test]
fn unions_of_convex_regions_are_built_without_a_search() {
    let mut random = Random(8);
    let mut pyramid = prism(&circle(4, 1.0), 1.0);
    pyramid.positions[4..].fill(Vec3::new(0.1, 0.0, 1.5));
    let mut needle = prism(&circle(3, 1.0), 20.0);
    needle.positions[3..].fill(Vec3::new(0.0, 0.0, 20.0));
    let table: Vec<[[f64; 3]; 2]> = [[0.1, 0.1], [0.1, 1.0], [1.7, 0.1], [1.7, 1.0]]
        .map(|[x, y]| [[x, y, 0.0], [0.2, 0.2, 1.05]])
        .into_iter()
        .chain([[[0.0, 0.0, 1.0], [2.0, 1.3, 0.2]]])
        .collect();
    let l = [[1.0, 1.0], [1.0, 3.0], [0.0, 3.0], [0.0, 0.0], [2.5, 0.0], [2.5, 1.0]];
    let cross = [[[0.0, 1.0, 0.0], [3.0, 1.0, 1.0]], [[1.0, 0.0, 0.0], [1.0, 3.0, 1.0]]];
    // Name, mesh, and the number of primitives.
    let cases = [
        ("needle", needle, 6),
        ("pyramid", pyramid, 8),
        ("triangle", prism(&circle(3, 1.0), 3.0), 12),
        ("hexagon", prism(&circle(6, 1.0), 3.0), 24),
        ("L", prism(&l, 1.0), 32),
        ("two boxes", boxes(&[[[0.0; 3], [3.0, 2.0, 1.0]], [[5.0; 3], [3.0, 2.0, 1.0]]]), 44),
        ("boxes in contact", boxes(&[[[0.0; 3], [3.0, 2.0, 1.0]], [[3.0, 0.0, 0.0], [2.0, 2.0, 1.0]]]), 22),
        ("cross", boxes(&cross), 32),
        ("table", boxes(&table), 86),
    ];
    for (name, mesh, count) in cases {
        for _ in 0..3 {
            let mesh = turned(&mut random, &mesh);
            let [fine, coarse] = found(&mesh).unwrap_or_else(|| panic!("{name}"));
            assert!(fine.error.max() < 0.31, "{name}: {}", fine.error);
            assert_eq!(fine.axis.primitives().len(), count, "{name}");
            assert!(coarse.axis.primitives().len() < fine.axis.primitives().len(), "{name}");
            let mass = Solid::new(&mesh).unwrap().mass.unwrap();
            let ratio = fine.axis.mass().volume / mass.volume;
            assert!((ratio - 1.0).abs() < 0.03, "{name}: {ratio}");
        }
    }
}

#[test]
fn small_regions_have_round_edges_if_spheres_are_few() {
    let mut comb = vec![[[0.0; 3], [1.0, 0.1, 0.1]]];
    comb.extend((0..10).map(|i| [[0.1 * f64::from(i), 0.05, 0.0], [0.05, 0.5, 0.1]]));
    // Name, mesh, number of levels, and the largest error.
    for (name, mesh, count, most) in [("comb", boxes(&comb), 2, 1.9), ("disc", prism(&circle(48, 1.0), 0.1), 1, 0.8)] {
        assert!(found(&mesh).is_some(), "{name}");
        let levels = fitted(&mesh, &FitOptions { levels: true, ..FitOptions::default() }).levels;
        assert_eq!(levels.len(), count, "{name}");
        let finest = &levels[0];
        assert!(finest.axis.spheres().len() <= 60 && finest.error.max() < most, "{name}: {}", finest.error);
        let ratio = finest.axis.mass().volume / Solid::new(&mesh).unwrap().mass.unwrap().volume;
        assert!((ratio - 1.0).abs() < 0.1, "{name}: {ratio}");
    }
    // The error of round edges is too large.
    assert!(found(&prism(&circle(24, 1.0), 1.5)).is_none());
}

#[test]
fn other_solids_are_searched() {
    let capsule = MedialAxis::capsule(Vec3::ZERO, Vec3::X, 0.2).unwrap();
    let many: Vec<[[f64; 3]; 2]> = (0..8).map(|i| [[2.0 * f64::from(i), 0.0, 0.0], [1.0, 2.0, 3.0]]).collect();
    for (name, mesh) in [("curved", triangulated(&capsule, 16)), ("too many regions", boxes(&many))] {
        assert!(found(&mesh).is_none(), "{name}");
    }
    let cube = boxes(&[[[0.0; 3], [1.0; 3]]]);
    // Narrower edges for a smaller error.
    let levels = fitted(&cube, &FitOptions { max_error: Some(0.05), ..FitOptions::default() }).levels;
    assert!(levels[0].error.max() <= 0.05, "{}", levels[0].error);
    let few = FitOptions { spheres: Some(8), error_limit: 20.0, ..FitOptions::default() };
    assert!(fitted(&cube, &few).levels[0].axis.spheres().len() <= 8);
}
