//! Turns a mesh outward, and with it the pieces that are inside out, as mirrored parts often are. Where they overlap with others, they would cut into them.

use glam::DVec3;

use super::{
    TriangleMesh,
    mesh::{pieces, tree_of},
};

/// Smaller volumes, relative to the cube of the diagonal, have an unreliable sign because of rounding.
const LEAST_VOLUME: f64 = 1e-9;

/// Turns a welded mesh outward, and the pieces that face the opposite way of the whole mesh, except cavities, which lie inside other pieces.
pub(super) fn oriented(mut mesh: TriangleMesh) -> TriangleMesh {
    let (piece_of, count) = pieces(mesh.positions.len(), &mesh.triangles);
    let places = mesh.unit_places();
    let corners: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(|i| places[i as usize])).collect();
    let mut volumes = vec![0.0; count];
    for (&piece, [a, b, c]) in piece_of.iter().zip(&corners) {
        volumes[piece as usize] += a.dot(b.cross(*c)) / 6.0;
    }
    let whole = volumes.iter().sum::<f64>().signum();
    let mut turned: Vec<bool> = volumes.iter().map(|volume| volume * whole < -LEAST_VOLUME).collect();
    // For each of these pieces: the winding number of the other pieces around it, integrated over its area, and its area.
    let mut around = vec![[0.0; 2]; count];
    let any = turned.contains(&true);
    let tree = tree_of(corners.iter().copied().filter(|_| any));
    for (&piece, [a, b, c]) in piece_of.iter().zip(&corners).filter(|(piece, _)| turned[**piece as usize]) {
        const OFF: f64 = 1e-4;
        let normal = (b - a).cross(c - a);
        let (area, off) = (normal.length(), normal.normalize_or_zero() * OFF);
        let middle = (a + b + c) / 3.0;
        // The winding number of the piece itself is 0 on one side of its surface and plus or minus 1 on the other. Its mean is cancelled by 0.5 below.
        let all = 0.5 * (tree.winding(middle - off) + tree.winding(middle + off));
        let [sum, whole_area] = &mut around[piece as usize];
        *sum += area * (whole * all + 0.5);
        *whole_area += area;
    }
    for (turned, [sum, area]) in turned.iter_mut().zip(around) {
        *turned &= sum < 0.5 * area;
    }
    for (triangle, &piece) in mesh.triangles.iter_mut().zip(&piece_of) {
        if turned[piece as usize] != (whole < 0.0) {
            triangle.swap(1, 2);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::builder::mesh::tests::tetrahedron;

    /// Tetrahedra with a size and a position each, inside out for negative sizes.
    fn tetrahedra(each: &[(f32, Vec3)]) -> TriangleMesh {
        let one = tetrahedron();
        let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
        for &(size, at) in each {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(one.positions.iter().map(|&p| p * size.abs() + at));
            mesh.triangles.extend(one.triangles.iter().map(|t| {
                let [a, b, c] = t.map(|i| first + i);
                if size < 0.0 { [a, c, b] } else { [a, b, c] }
            }));
        }
        mesh
    }

    #[test]
    fn pieces_that_are_inside_out_are_turned_and_cavities_are_not() {
        let (within, across, beside) = (Vec3::splat(0.1), Vec3::new(-0.3, 0.1, 0.1), Vec3::X * 2.0);
        for (each, expected) in [
            (&[(1.0, Vec3::ZERO), (0.5, across)][..], &[1.0, 0.5][..]),
            (&[(1.0, Vec3::ZERO), (-0.5, across)], &[1.0, 0.5]),
            (&[(1.0, Vec3::ZERO), (-0.2, within)], &[1.0, -0.2]),
            (&[(1.0, Vec3::ZERO), (-0.5, beside), (-0.2, within)], &[1.0, 0.5, -0.2]),
            // The whole mesh is inside out. A piece inside another one is a cavity as well.
            (&[(-1.0, Vec3::ZERO), (0.2, within), (0.5, across)], &[1.0, -0.2, 0.5]),
        ] {
            let at = |i: usize| each[i].1;
            let expected: Vec<(f32, Vec3)> = expected.iter().enumerate().map(|(i, &size)| (size, at(i))).collect();
            let (found, expected) = (oriented(tetrahedra(each)), tetrahedra(&expected));
            let turns = |mesh: &TriangleMesh| -> Vec<Vec3> {
                let normal = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a);
                mesh.triangles.iter().map(|t| normal(mesh.corners(*t))).collect()
            };
            for (found, expected) in turns(&found).iter().zip(turns(&expected)) {
                assert!(found.dot(expected) > 0.0, "{each:?}");
            }
        }
    }
}
