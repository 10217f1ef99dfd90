//! The checked and normalized input of all later stages.

use glam::DVec3;

use super::{
    BuildError, TriangleMesh, TwoSidedError,
    clean::Cleaned,
    interior::Interior,
    measure::measure_shown,
    mesh::{FLAT, edge_uses, is_flat, pieces, tree_of},
    parallel,
    tree::TriangleTree,
};
use crate::medial_axis::{MassProperties, MedialAxis};

/// The triangles that bound a solid, translated and scaled so that the diagonal of their bounding box is 1.
pub(super) struct Solid {
    /// The bounding triangles of the mesh and of the caps over its holes, outward.
    pub mesh: TriangleMesh,
    pub tree: TriangleTree,
    /// All triangles, if the tree lacks some: those inside the solid, where pieces overlap.
    whole: Option<TriangleTree>,
    /// Part of each triangle, in the order of the tree: its piece, with all pieces that overlap it.
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
    /// Mass properties in the units of the mesh. `None` if the surface has a large opening.
    pub mass: Option<MassProperties>,
}

/// Distance from a surface at which its sides are probed, as a part of the diagonal.
const PROBE: f64 = 1e-4;

/// Returns the first flaw of the lists.
fn check(mesh: &TriangleMesh) -> Result<(), BuildError> {
    for (triangle, indices) in mesh.triangles.iter().enumerate() {
        for &index in indices {
            let position = mesh.positions.get(index as usize);
            let position = position.ok_or(BuildError::IndexOutOfRange { triangle, index })?;
            if !position.is_finite() {
                return Err(BuildError::NotFinite { vertex: index });
            }
        }
    }
    if mesh.triangles.is_empty() || mesh.diagonal() <= 0.0 { Err(BuildError::Empty) } else { Ok(()) }
}

impl Solid {
    pub fn new(source: &TriangleMesh) -> Result<Self, BuildError> {
        check(source)?;
        let mut mesh = Cleaned::new(source).mesh;
        if mesh.triangles.is_empty() || mesh.diagonal() <= 0.0 {
            return Err(BuildError::NoVolume);
        }
        let (min, max) = (mesh.aabb().min.as_dvec3(), mesh.aabb().max.as_dvec3());
        let (origin, diagonal) = ((min + max) * 0.5, (max - min).length());
        let places: Vec<DVec3> = mesh.positions.iter().map(|p| (p.as_dvec3() - origin) / diagonal).collect();
        let corners = |triangle: [u32; 3]| triangle.map(|i| places[i as usize]);
        let all = std::mem::take(&mut mesh.triangles);
        let mut proper: Vec<[u32; 3]> = all.iter().copied().filter(|&t| !is_flat(&corners(t), FLAT)).collect();
        let (piece_of, piece_count) = pieces(places.len(), &proper);
        let metres: Vec<[DVec3; 3]> = proper.iter().map(|&t| corners(t).map(|p| p * diagonal)).collect();
        let Interior { mass, bodies, body_count, buried } = Interior::new(&metres, &piece_of, piece_count, origin);
        let overlap = buried.iter().filter(|&&buried| !buried).count() > body_count;
        let whole = overlap.then(|| tree_of(proper.iter().map(|&t| corners(t))));
        let bounds: Vec<bool> = parallel::map(proper.len(), 64, |i| {
            let hidden = |whole: &TriangleTree| probes(corners(proper[i])).all(|p| is_within(whole, p));
            !buried[piece_of[i] as usize] && !whole.as_ref().is_some_and(hidden)
        });
        let kept = |i: &usize| bounds[*i];
        let of_source: Vec<u32> = (0..proper.len()).filter(kept).map(|i| bodies[piece_of[i] as usize]).collect();
        proper = (0..proper.len()).filter(kept).map(|i| proper[i]).collect();
        if proper.is_empty() {
            return Err(BuildError::NoVolume);
        }
        let tree = TriangleTree::new(&proper.iter().map(|&t| corners(t)).collect::<Vec<_>>());
        let mut boxes = vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; body_count];
        for (&triangle, &part) in proper.iter().zip(&of_source) {
            let [min, max] = &mut boxes[part as usize];
            corners(triangle).iter().for_each(|&corner| (*min, *max) = (min.min(corner), max.max(corner)));
        }
        let part_radii = boxes.iter().map(|[min, max]| (0.5 * (1.0 + 1e-9) * (max - min).length()).min(0.5)).collect();
        let open_of_source = open_edges(&all, &proper);
        let open_edges = tree.order().iter().map(|&i| open_of_source[i as usize]).collect();
        let parts = tree.order().iter().map(|&i| of_source[i as usize]).collect();
        let mut seen = vec![false; places.len()];
        let first_seen = |&triangle: &u32| {
            let fresh =
                proper[triangle as usize].into_iter().filter(|&i| !std::mem::replace(&mut seen[i as usize], true));
            fresh.map(|i| places[i as usize]).collect()
        };
        let vertices = tree.order().iter().map(first_seen).collect();
        mesh.triangles = proper;
        let part_count = body_count;
        Ok(Self { mesh, parts, part_count, part_radii, open_edges, vertices, tree, whole, origin, diagonal, mass })
    }

    /// True inside the solid.
    pub fn is_inside(&self, point: DVec3) -> bool {
        self.whole.as_ref().unwrap_or(&self.tree).is_inside(point)
    }

    /// The two-sided error of a shape, relative to the surface that bounds the solid.
    pub fn measure(&self, axis: &MedialAxis) -> TwoSidedError {
        measure_shown(&self.mesh, axis, |point| self.is_hidden((point - self.origin) / self.diagonal))
    }

    /// True for a point of the surface with the solid on both sides, as where pieces overlap.
    pub fn is_hidden(&self, point: DVec3) -> bool {
        self.whole.as_ref().is_some_and(|whole| is_within(whole, point))
    }

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
        if along.abs() > SURE * away.length() { along > 0.0 } else { !self.is_inside(point) }
    }
}

/// True if the surroundings of a point are inside: the corners of a small tetrahedron, which lie on both sides of any plane through the point.
pub(super) fn is_within(whole: &TriangleTree, point: DVec3) -> bool {
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    corners.into_iter().all(|corner| whole.is_inside(point + PROBE * DVec3::from_array(corner)))
}

/// Points near the corners of a triangle, its middle, and more of them for a larger triangle.
pub(super) fn probes([a, b, c]: [DVec3; 3]) -> impl Iterator<Item = DVec3> {
    /// Distance between the points, as a part of the diagonal, and largest number along an edge.
    const SPACING: f64 = 0.02;
    const MOST: f64 = 60.0;
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let count = (longest / SPACING).ceil().clamp(2.0, MOST) as u32;
    let inset = move |i: u32| (f64::from(i) + 0.1) / (f64::from(count) + 0.3);
    (0..=count).flat_map(move |i| (0..=count - i).map(move |j| a + (b - a) * inset(i) + (c - a) * inset(j)))
}

/// For each edge of the triangles `of`, true if no other triangle of `all` has it. `all` contains triangles without area, which close gaps without area.
fn open_edges(all: &[[u32; 3]], of: &[[u32; 3]]) -> Vec<[bool; 3]> {
    let uses = edge_uses(all);
    let is_open = |[i, j]: [u32; 2]| uses[&[i.min(j), i.max(j)]].iter().sum::<u32>() == 1;
    of.iter().map(|&[a, b, c]| [[a, b], [b, c], [c, a]].map(is_open)).collect()
}
