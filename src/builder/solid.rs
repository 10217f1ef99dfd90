//! The checked and normalized input of all later stages.

use glam::DVec3;

use super::{
    BuildError, TriangleMesh,
    mesh::{edge_uses, is_flat, pieces},
    orient::oriented,
    tree::TriangleTree,
};

/// The proper triangles of a mesh and of the caps over its holes, translated and scaled so that the diagonal of their bounding box is 1.
pub(super) struct Solid {
    /// The mesh with its holes closed, and its pieces turned the same way.
    pub mesh: TriangleMesh,
    pub tree: TriangleTree,
    /// Part of each triangle, in the order of the tree.
    pub parts: Vec<u32>,
    pub part_count: usize,
    /// Half of the diagonal of the box around each part, rounded up.
    pub part_radii: Vec<f64>,
    /// For each triangle, true for those of its edges 01, 12 and 20 that have no other triangle.
    pub open_edges: Vec<[bool; 3]>,
    /// For each triangle in the order of the tree, its vertices that no earlier triangle uses.
    pub vertices: Vec<Vec<DVec3>>,
    /// Middle of the bounding box and length of its diagonal, in the units of the mesh.
    pub origin: DVec3,
    pub diagonal: f64,
}

/// The tree of the triangles, except those with almost no height relative to their longest side.
pub(super) fn tree_of(triangles: impl Iterator<Item = [DVec3; 3]>) -> TriangleTree {
    TriangleTree::new(&triangles.filter(|triangle| !is_flat(triangle, FLAT)).collect::<Vec<_>>())
}

/// Triangles with a height of less than this part of their longest side are omitted.
const FLAT: f64 = 1e-9;

impl Solid {
    pub fn new(mesh: &TriangleMesh) -> Result<Self, BuildError> {
        for (triangle, indices) in mesh.triangles.iter().enumerate() {
            for &index in indices {
                let position = mesh.positions.get(index as usize);
                let position = position.ok_or(BuildError::IndexOutOfRange { triangle, index })?;
                if !position.is_finite() {
                    return Err(BuildError::NotFinite { vertex: index });
                }
            }
        }
        let corners = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize].as_dvec3());
        let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let (origin, diagonal) = ((min + max) * 0.5, (max - min).length());
        if mesh.triangles.is_empty() || diagonal <= 0.0 {
            return Err(BuildError::Empty);
        }
        let mesh = oriented(mesh.with_holes_closed());
        let place = |i: u32| (mesh.positions[i as usize].as_dvec3() - origin) / diagonal;
        let proper: Vec<[u32; 3]> =
            mesh.triangles.iter().copied().filter(|triangle| !is_flat(&triangle.map(place), FLAT)).collect();
        if proper.is_empty() {
            return Err(BuildError::Empty);
        }
        let source: Vec<[DVec3; 3]> = proper.iter().map(|t| t.map(place)).collect();
        let tree = TriangleTree::new(&source);
        let (of_source, part_count) = pieces(mesh.positions.len(), &proper);
        let mut boxes = vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; part_count];
        for (corners, &part) in source.iter().zip(&of_source) {
            let [min, max] = &mut boxes[part as usize];
            corners.iter().for_each(|&corner| (*min, *max) = (min.min(corner), max.max(corner)));
        }
        let part_radii = boxes.iter().map(|[min, max]| (0.5 * (1.0 + 1e-9) * (max - min).length()).min(0.5)).collect();
        let open_of_source = open_edges(&mesh.triangles, &proper);
        let open_edges = tree.order().iter().map(|&i| open_of_source[i as usize]).collect();
        let parts = tree.order().iter().map(|&i| of_source[i as usize]).collect();
        let mut seen = vec![false; mesh.positions.len()];
        let first_seen = |&triangle: &u32| {
            let fresh =
                proper[triangle as usize].into_iter().filter(|&i| !std::mem::replace(&mut seen[i as usize], true));
            fresh.map(place).collect()
        };
        let vertices = tree.order().iter().map(first_seen).collect();
        Ok(Self { mesh, parts, part_count, part_radii, open_edges, vertices, tree, origin, diagonal })
    }
}

impl Solid {
    /// The nearest point of the surface, or `None` if it lies on the rim of a hole. There the part of the surface that belongs to `point` is missing.
    ///
    /// `near`: a triangle that may be nearby, for speed. Returns the triangle of the point as well, in the order of the tree.
    pub fn closest_off_rims(&self, point: DVec3, near: Option<u32>) -> Option<(DVec3, u32)> {
        const ON_EDGE: f64 = 1e-6;
        let (closest, triangle) = self.tree.closest_with_triangle(point, near)?;
        let (corners, open) = (&self.tree.triangles()[triangle as usize], &self.open_edges[triangle as usize]);
        let on_rim = (0..3).filter(|&e| open[e]).any(|e| {
            let (a, b) = (corners[e], corners[(e + 1) % 3]);
            let along = (b - a).normalize_or_zero();
            (closest - a).reject_from_normalized(along).length() < ON_EDGE
        });
        (!on_rim).then_some((closest, triangle))
    }

    /// True if a point of an envelope, `away` from the nearest point of the surface, is outside of the solid.
    ///
    /// In most cases the normal of the envelope decides: inside the solid it points towards the surface.
    pub fn is_out(&self, point: DVec3, away: DVec3, normal: DVec3) -> bool {
        const SURE: f64 = 0.5;
        let along = away.dot(normal);
        if along.abs() > SURE * away.length() { along > 0.0 } else { !self.tree.is_inside(point) }
    }
}

/// For each edge of the triangles `of`, true if no other triangle of `all` has it. `all` contains triangles without area, which close gaps without area.
fn open_edges(all: &[[u32; 3]], of: &[[u32; 3]]) -> Vec<[bool; 3]> {
    let uses = edge_uses(all);
    let is_open = |[i, j]: [u32; 2]| uses[&[i.min(j), i.max(j)]].iter().sum::<u32>() == 1;
    of.iter().map(|&[a, b, c]| [[a, b], [b, c], [c, a]].map(is_open)).collect()
}
