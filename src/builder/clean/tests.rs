use glam::Vec3;

use super::*;
use crate::builder::{
    MeshReport,
    mesh::tests::{add_box, tetrahedron},
};

/// Adds triangles with their own vertices.
fn add(mesh: &mut TriangleMesh, positions: &[Vec3], triangles: &[[u32; 3]]) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(positions);
    mesh.triangles.extend(triangles.iter().map(|t| t.map(|i| first + i)));
}

/// Checks that the result is closed and encloses `volume`. Returns the number of triangles, and of pieces that were left out.
fn cleaned(mesh: &TriangleMesh, volume: f64) -> (usize, usize) {
    let Cleaned { mesh, sheets } = Cleaned::new(mesh);
    let report = MeshReport::new(&mesh);
    assert!((report.volume - volume).abs() < 1e-6 && (report.is_closed() || volume == 0.0), "{report}");
    (mesh.triangles.len(), sheets)
}

#[test]
fn repeated_triangles_and_backs_are_left_out() {
    let whole = tetrahedron();
    let back = |t: &[u32; 3]| [t[0], t[2], t[1]];
    let volume = 1.0 / 6.0;
    assert_eq!(cleaned(&whole, volume), (4, 0));
    let mut twice = whole.clone();
    twice.triangles.extend(whole.triangles.clone());
    assert_eq!(cleaned(&twice, volume), (4, 0));
    // Each triangle with its back, in each order.
    for first in 0..16 {
        let mut doubled = whole.clone();
        doubled.triangles.clear();
        for (i, triangle) in whole.triangles.iter().enumerate() {
            let both = [*triangle, back(triangle)];
            doubled.triangles.extend(if first >> i & 1 == 0 { both } else { [both[1], both[0]] });
        }
        assert_eq!(cleaned(&doubled, volume), (4, 0));
    }
    // One triangle with a back.
    let mut one = whole.clone();
    one.triangles.push(back(&whole.triangles[2]));
    assert_eq!(cleaned(&one, volume), (4, 0));
    // A wall between two tetrahedra, and a fin on one.
    let mut pair = whole.clone();
    pair.positions.push(Vec3::ONE);
    pair.triangles.extend([back(&whole.triangles[3]), [1, 2, 4], [2, 3, 4], [3, 1, 4]]);
    assert_eq!(cleaned(&pair, volume + 1.0 / 3.0), (6, 0));
    let mut fin = whole.clone();
    fin.positions.push(Vec3::NEG_ONE);
    fin.triangles.extend([[0, 1, 4], [1, 0, 4]]);
    assert_eq!(cleaned(&fin, volume), (4, 0));
}

#[test]
fn triangles_that_face_the_other_way_are_turned() {
    for turned in 0..16 {
        let mut mesh = tetrahedron();
        let chosen = mesh.triangles.iter_mut().enumerate().filter(|(i, _)| turned >> i & 1 == 1);
        chosen.for_each(|(_, triangle)| triangle.swap(0, 1));
        assert_eq!(cleaned(&mesh, 1.0 / 6.0), (4, 0), "{turned:b}");
    }
}

/// A strip around the z axis with half turns.
fn strip(half_turns: u32, width: f32) -> TriangleMesh {
    let count = 48;
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    for i in 0..count {
        let u = i as f32 / count as f32 * std::f32::consts::TAU;
        let half = 0.5 * half_turns as f32 * u;
        for side in [-0.5, 0.5] {
            let radius = 1.0 + side * width * half.cos();
            mesh.positions.push(Vec3::new(radius * u.cos(), radius * u.sin(), side * width * half.sin()));
        }
        let [a, b] = [2 * i, 2 * i + 1];
        let [c, d] = if i + 1 < count { [a + 2, a + 3] } else { [half_turns % 2, 1 - half_turns % 2] };
        mesh.triangles.extend([[a, c, b], [b, c, d]]);
    }
    mesh
}

#[test]
fn sheets_and_one_sided_strips_are_left_out() {
    for width in [0.1, 0.4, 0.9] {
        assert_eq!(cleaned(&strip(1, width), 0.0).1, 1, "width {width}");
    }
    let square = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.2)].map(|p| p * 0.3 + Vec3::Z * 2.0);
    let mut mesh = tetrahedron();
    add(&mut mesh, &square, &[[0, 1, 2], [1, 3, 2]]);
    add(&mut mesh, &square.map(|p| p - Vec3::X * 3.0), &[[0, 1, 2]]);
    // A sheet through the tetrahedron.
    add(&mut mesh, &square.map(|p| p - Vec3::Z * 1.8), &[[0, 1, 2]]);
    assert_eq!(cleaned(&mesh, 1.0 / 6.0), (4, 3));
    // Both sides of a sheet.
    let mut mesh = tetrahedron();
    add(&mut mesh, &square, &[[0, 1, 2], [1, 3, 2], [1, 0, 2], [3, 1, 2]]);
    assert_eq!(cleaned(&mesh, 1.0 / 6.0), (4, 1));
}

#[test]
fn a_flat_solid_without_its_underside_is_no_sheet() {
    let mut mesh = tetrahedron();
    mesh.positions.iter_mut().for_each(|p| p.z *= 0.3);
    let volume = 0.3 / 6.0;
    mesh.triangles.remove(0);
    assert_eq!(cleaned(&mesh, volume), (4, 0));
}

/// Unit cubes, each with all of its faces, in a random order.
fn voxels(side: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
    for number in 0..side.pow(3) {
        let cell = [number % side, number / side % side, number / side / side].map(|i| i as f64);
        add_box(&mut mesh, DVec3::from_array(cell), DVec3::ONE);
    }
    let mut random = crate::random::Random(1);
    (1..mesh.triangles.len()).rev().for_each(|i| mesh.triangles.swap(i, random.below(i + 1)));
    mesh
}

#[test]
fn inner_walls_between_voxels_are_left_out() {
    for side in [2usize, 3, 5] {
        let shell = 12 * side.pow(2);
        assert_eq!(cleaned(&voxels(side), side.pow(3) as f64), (shell, 0));
    }
}

/// A triangle without area remained alone, and a build panicked.
#[test]
fn a_sheet_with_a_triangle_of_one_point_is_refused() {
    let mut sheet = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap();
    add(&mut sheet, &[Vec3::ONE; 3], &[[0, 1, 2]]);
    let solid = crate::builder::solid::Solid::new(&sheet);
    assert_eq!(solid.err(), Some(crate::builder::BuildError::NoVolume));
}
