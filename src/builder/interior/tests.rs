use glam::{DMat3, Vec3};

use super::*;
use crate::{
    builder::{
        TriangleMesh,
        mesh::{pieces, tests::add_box},
    },
    random::Random,
};

/// Boxes by their lower corners and sizes, inside out if the flag of a cavity is set.
fn boxes(each: &[(Vec3, Vec3, bool)]) -> TriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    for &(min, size, cavity) in each {
        let first = mesh.triangles.len();
        add_box(&mut mesh, min.as_dvec3(), size.as_dvec3());
        mesh.triangles[first..].iter_mut().filter(|_| cavity).for_each(|triangle| triangle.swap(1, 2));
    }
    mesh
}

fn interior(mesh: &TriangleMesh) -> Interior {
    let (piece_of, count) = pieces(mesh.positions.len(), &mesh.triangles);
    let triangles: Vec<_> = mesh.triangles.iter().map(|t| mesh.corners(*t).map(|p| p.as_dvec3())).collect();
    Interior::new(&triangles, &piece_of, count, DVec3::ZERO)
}

/// Volume, centre of mass and inertia of a closed surface without overlaps, by the divergence theorem.
fn by_divergence(mesh: &TriangleMesh) -> (f64, DVec3, DMat3) {
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(*triangle).map(|p| p.as_dvec3());
        let part = a.dot(b.cross(c)) / 6.0;
        volume += part;
        first += part * (a + b + c) / 4.0;
        let outer = |p: DVec3| DMat3::from_cols(p * p.x, p * p.y, p * p.z);
        second += (outer(a) + outer(b) + outer(c) + outer(a + b + c)) * (part / 20.0);
    }
    let center = first / volume;
    second -= DMat3::from_cols(center * center.x, center * center.y, center * center.z) * volume;
    let trace = second.x_axis.x + second.y_axis.y + second.z_axis.z;
    (volume, center, DMat3::from_diagonal(DVec3::splat(trace)) - second)
}

/// Compares with expected values. The tolerance is a part of the volume, of the size 1 and of the moments.
fn check(name: &str, mass: &MassProperties, volume: f64, center: DVec3, inertia: DMat3, tolerance: f64) {
    let error = f64::from(mass.volume) / volume - 1.0;
    let shift = mass.center_of_mass.as_dvec3().distance(center);
    let turn = (mass.inertia.as_dmat3() - inertia).to_cols_array().map(f64::abs).into_iter().fold(0.0, f64::max);
    let turn = turn / inertia.to_cols_array().map(f64::abs).into_iter().fold(0.0, f64::max);
    println!("{name}: volume {error:+.1e}, centre {shift:.1e}, inertia {turn:.1e}");
    assert!(error.abs() < tolerance && shift < tolerance && turn < tolerance, "{name}");
}

fn of_box(size: Vec3) -> DMat3 {
    let square = (size * size).as_dvec3();
    let sum = square.element_sum();
    DMat3::from_diagonal((DVec3::splat(sum) - square) / 12.0) * f64::from(size.element_product())
}

#[test]
fn boxes_overlaps_and_cavities_have_their_exact_mass() {
    let (one, half) = (Vec3::ONE, Vec3::splat(0.5));
    let cube = of_box(one);
    let middle = DVec3::splat(0.5);
    let whole = boxes(&[(Vec3::ZERO, one, false)]);
    check("cube", &interior(&whole).mass.unwrap(), 1.0, middle, cube, 3e-3);

    let overlapping = boxes(&[(Vec3::ZERO, one, false), (Vec3::X * 0.5, one, false)]);
    let found = interior(&overlapping);
    check("overlap", &found.mass.unwrap(), 1.5, DVec3::new(0.75, 0.5, 0.5), of_box(Vec3::new(1.5, 1.0, 1.0)), 3e-3);
    assert_eq!((found.body_count, found.buried), (1, vec![false; 2]));

    let quarter = Vec3::splat(0.25);
    let nested = interior(&boxes(&[(Vec3::ZERO, one, false), (quarter, half, false)]));
    check("nested", &nested.mass.unwrap(), 1.0, middle, cube, 3e-3);
    assert_eq!((nested.body_count, nested.buried), (1, vec![false, true]));

    let hollow = interior(&boxes(&[(Vec3::ZERO, one, false), (quarter, half, true)]));
    check("hollow", &hollow.mass.unwrap(), 0.875, middle, cube - of_box(half), 3e-3);
    assert_eq!((hollow.body_count, hollow.buried), (1, vec![false, false]));

    let touching = interior(&boxes(&[(Vec3::ZERO, one, false), (Vec3::X, one, false)]));
    check("touching", &touching.mass.unwrap(), 2.0, DVec3::new(1.0, 0.5, 0.5), of_box(Vec3::new(2.0, 1.0, 1.0)), 3e-3);
    assert_eq!(touching.body_count, 1);
    let apart = interior(&boxes(&[(Vec3::ZERO, one, false), (Vec3::X * 1.1, one, false)]));
    assert_eq!((apart.body_count, apart.bodies), (2, vec![0, 1]));
}

#[test]
fn thin_plates_and_rods_have_their_exact_mass() {
    for size in [Vec3::new(1.0, 1e-3, 1.0), Vec3::new(1.0, 1e-3, 1e-3), Vec3::new(1.0, 1e-5, 1.0)] {
        let found = interior(&boxes(&[(size * -0.5, size, false)])).mass.unwrap();
        check(&format!("{size}"), &found, f64::from(size.element_product()), DVec3::ZERO, of_box(size), 0.02);
    }
}

#[test]
fn closed_surfaces_agree_with_the_divergence_theorem() {
    let mut random = Random(3);
    for case in 0..20 {
        // A star around the origin: a subdivided octahedron whose vertices have random distances, or a tetrahedron.
        let mut mesh = TriangleMesh {
            positions: vec![Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z],
            triangles: vec![[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
        };
        if case % 4 == 0 {
            mesh.positions = (0..4).map(|_| random.in_cube()).collect();
            mesh.triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            if by_divergence(&mesh).0 < 0.0 {
                mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
            }
        } else {
            let turn = glam::Quat::from_scaled_axis(random.in_cube() * 3.0);
            mesh.positions.iter_mut().for_each(|p| *p = turn * *p * (0.3 + 0.4 * random.unit_f64() as f32));
        }
        let (volume, center, inertia) = by_divergence(&mesh);
        check(&format!("case {case}"), &interior(&mesh).mass.unwrap(), volume, center, inertia, 5e-3);
    }
}

#[test]
fn lines_without_an_end_do_not_count() {
    let mut mesh = boxes(&[(Vec3::ZERO, Vec3::ONE, false)]);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::splat(-0.1), Vec3::new(-0.1, 0.0, -0.1), Vec3::new(0.0, -0.1, -0.1)]);
    mesh.triangles.push([first, first + 1, first + 2]);
    let volume = interior(&mesh).mass.unwrap().volume;
    assert!(volume > 0.9 && volume < 1.01, "{volume}");
    let mut open = boxes(&[(Vec3::ZERO, Vec3::ONE, false)]);
    open.triangles.truncate(open.triangles.len() - 2);
    assert!(interior(&open).mass.is_none());
}
