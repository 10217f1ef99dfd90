//! The error of a posed medial mesh, relative to a posed mesh with folds.

use glam::DVec3;

use super::{
    TriangleMesh, TwoSidedError,
    measure::measure_shown,
    mesh::tree_of,
    parallel,
    solid::{is_within, probes},
};
use crate::medial_axis::MedialAxis;

/// Measures the two-sided error of a medial mesh relative to the surface that bounds the solid within a mesh. A bent joint folds the skin of a character
/// into the body. The folds, with the solid on both sides, do not count.
///
/// # Panics
/// If an index of the mesh is out of range.
pub fn measure_without_folds(mesh: &TriangleMesh, axis: &MedialAxis) -> TwoSidedError {
    let places = mesh.unit_places();
    let corners = |triangle: [u32; 3]| triangle.map(|i| places[i as usize]);
    let tree = tree_of(mesh.triangles.iter().map(|&triangle| corners(triangle)));
    let is_shown = |i: usize| !probes(corners(mesh.triangles[i])).all(|point| is_within(&tree, point));
    let shown = parallel::map(mesh.triangles.len(), 64, is_shown);
    let triangles = mesh.triangles.iter().zip(shown).filter(|(_, shown)| *shown).map(|(triangle, _)| *triangle);
    let outer = TriangleMesh { positions: mesh.positions.clone(), triangles: triangles.collect() };
    let (middle, diagonal) = (mesh.aabb().center().as_dvec3(), f64::from(mesh.diagonal()));
    let is_hidden = |point: DVec3| is_within(&tree, (point - middle) / diagonal);
    measure_shown(&outer, axis, is_hidden)
}
