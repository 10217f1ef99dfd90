use std::collections::HashMap;

use glam::{DVec3, Vec3};
use thiserror::Error;

use super::tree::TriangleTree;
use crate::{disjoint_sets::DisjointSets, geometry::Aabb, medial_axis::MAX_EXTENT};

/// Largest number of vertices, and of triangles, of a mesh.
pub const MAX_MESH_SIZE: usize = 1 << 24;

/// A surface made of triangles, in metres, in the shape's own frame.
///
/// Triangles of a closed surface are counter-clockwise as seen from outside. [`new`](Self::new) checks the lists; functions that take a
/// mesh rely on these checks.
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Three vertices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Reasons why lists do not describe a surface.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// There is no triangle.
    #[error("the mesh has no triangles")]
    Empty,
    /// There are more vertices or triangles than [`MAX_MESH_SIZE`].
    #[error("the mesh has {count} {what}, more than {MAX_MESH_SIZE}; reduce it first")]
    TooLarge {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// Number of vertices or triangles.
        count: usize,
    },
    /// A coordinate is NaN, infinite or beyond [`MAX_EXTENT`].
    #[error("vertex {vertex}: {value} is not a number from -{MAX_EXTENT} to {MAX_EXTENT}; move or scale the mesh")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// The invalid coordinate.
        value: f32,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle}: there is no vertex {index} among {vertices}")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The invalid index.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// All triangles lie in one point.
    #[error("the mesh has no size: all of its triangles lie in one point")]
    NoSize,
    /// A Bevy mesh does not consist of triangles, or its data is on the GPU only.
    #[cfg(feature = "bevy_mesh")]
    #[error("the Bevy mesh has no triangles: {0}; use a triangle list or strip with f32 positions in main memory")]
    Bevy(String),
}

impl TriangleMesh {
    /// Creates a mesh from its lists.
    ///
    /// # Errors
    /// If there is no triangle, if there are too many, if a coordinate is not finite or too large, if an index is out of range, or if
    /// all triangles lie in one point. Other flaws of a surface are not errors: see [`MeshReport`](super::MeshReport).
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        for (what, count) in [("vertices", positions.len()), ("triangles", triangles.len())] {
            if count > MAX_MESH_SIZE {
                return Err(MeshError::TooLarge { what, count });
            }
        }
        for (vertex, position) in positions.iter().enumerate() {
            // NaN is not contained in any range.
            if let Some(&value) = position.to_array().iter().find(|v| !(-MAX_EXTENT..=MAX_EXTENT).contains(*v)) {
                return Err(MeshError::NotFinite { vertex, value });
            }
        }
        let vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { triangle, index, vertices });
            }
        }
        let mesh = Self { positions, triangles };
        if mesh.diagonal() > 0.0 { Ok(mesh) } else { Err(MeshError::NoSize) }
    }

    /// Converts a Bevy mesh. Vertices at equal positions are merged, so that different normals and texture coordinates do not split the surface.
    ///
    /// # Errors
    /// If it is not a triangle list or strip, has no f32 positions or is on the GPU only; otherwise the errors of [`new`](Self::new).
    #[cfg(feature = "bevy_mesh")]
    pub fn from_bevy(mesh: &bevy::mesh::Mesh) -> Result<Self, MeshError> {
        Ok(Self::with_all_vertices(mesh)?.welded())
    }

    /// Converts a Bevy mesh with all of its vertices.
    #[cfg(feature = "bevy_mesh")]
    pub(super) fn with_all_vertices(mesh: &bevy::mesh::Mesh) -> Result<Self, MeshError> {
        use bevy::mesh::{Mesh, PrimitiveTopology};

        let refused = |why: &dyn std::fmt::Display| MeshError::Bevy(why.to_string());
        let positions = mesh.try_attribute(Mesh::ATTRIBUTE_POSITION).map_err(|error| refused(&error))?;
        let positions = positions.as_float3().ok_or_else(|| refused(&"its positions are not three f32 each"))?;
        let indices: Vec<u32> = match mesh.try_indices_option().map_err(|error| refused(&error))? {
            // The cast is lossless, because indices are at most u32.
            Some(indices) => indices.iter().map(|i| i as u32).collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let triangles = match mesh.primitive_topology() {
            PrimitiveTopology::TriangleList => list(&indices),
            PrimitiveTopology::TriangleStrip => strip(&indices),
            other => return Err(refused(&format!("it is a {other:?}"))),
        };
        Self::new(positions.iter().copied().map(Vec3::from).collect(), triangles)
    }

    /// Converts the triangles to a Bevy mesh, without normals.
    #[cfg(feature = "bevy_mesh")]
    pub fn to_bevy(&self) -> bevy::mesh::Mesh {
        use bevy::mesh::{Indices, Mesh, PrimitiveTopology};

        let positions: Vec<[f32; 3]> = self.positions.iter().map(Vec3::to_array).collect();
        Mesh::new(PrimitiveTopology::TriangleList, Default::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
            .with_inserted_indices(Indices::U32(self.triangles.as_flattened().to_vec()))
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
        triangle.map(|i| self.positions[i as usize])
    }

    /// The box around the triangles.
    pub fn aabb(&self) -> Aabb {
        let corners = self.triangles.iter().flatten().map(|&i| self.positions[i as usize]);
        corners.fold(Aabb::EMPTY, |aabb, p| aabb.merge(Aabb { min: p, max: p }))
    }

    /// Length of the diagonal of the bounding box in metres. Errors are given relative to it, as is usual for meshes of any size.
    pub fn diagonal(&self) -> f32 {
        let Aabb { min, max } = self.aabb();
        min.as_dvec3().distance(max.as_dvec3()) as f32
    }

    /// The vertices in coordinates with the centre of the bounding box as origin and its diagonal as unit.
    pub(super) fn unit_places(&self) -> Vec<DVec3> {
        let (middle, diagonal) = (self.aabb().center().as_dvec3(), f64::from(self.diagonal()));
        self.positions.iter().map(|p| (p.as_dvec3() - middle) / diagonal).collect()
    }

    /// The same triangles with one vertex per position and without unused vertices, in the order of first use.
    #[must_use]
    pub fn welded(&self) -> Self {
        self.welded_vertices().0
    }

    /// The welded mesh, and for each of its vertices the first one at the same position.
    pub(super) fn welded_vertices(&self) -> (Self, Vec<u32>) {
        let mut number = HashMap::with_capacity(self.positions.len());
        let mut sources = Vec::new();
        let triangles = self.triangles.iter().map(|triangle| {
            triangle.map(|vertex| {
                // Adding 0 turns -0 into 0, so both get the same key.
                let key = self.positions[vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
                *number.entry(key).or_insert_with(|| {
                    sources.push(vertex);
                    sources.len() as u32 - 1
                })
            })
        });
        let triangles = triangles.collect();
        let positions = sources.iter().map(|&vertex| self.positions[vertex as usize]).collect();
        (Self { positions, triangles }, sources)
    }

    /// The triangles of each connected piece; pieces and triangles are in ascending order. Triangles are connected if they share a vertex of
    /// the list, so the mesh should be welded first.
    pub fn components(&self) -> Vec<Vec<u32>> {
        let (pieces, count) = pieces(self.positions.len(), &self.triangles);
        let mut components = vec![Vec::new(); count];
        for (triangle, piece) in (0..).zip(pieces) {
            components[piece as usize].push(triangle);
        }
        components
    }
}

/// For each edge with the smaller vertex first, the number of triangles that run along it from the smaller to the larger vertex, and the number that run
/// back. Triangles with a repeated vertex are ignored.
pub(super) fn edge_uses(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], [u32; 2]> {
    let mut uses = HashMap::<[u32; 2], [u32; 2]>::with_capacity(2 * triangles.len());
    for &[a, b, c] in triangles.iter().filter(|triangle| is_proper(triangle)) {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            uses.entry([from.min(to), from.max(to)]).or_default()[usize::from(from > to)] += 1;
        }
    }
    uses
}

/// An edge of a triangle, with the smaller vertex first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EdgeUse {
    pub edge: [u32; 2],
    pub triangle: u32,
    /// True if the triangle runs from the smaller to the larger vertex.
    pub along: bool,
}

/// The edges of the triangles in ascending order. Triangles with a repeated vertex are ignored.
pub(super) fn sorted_edges(triangles: &[[u32; 3]]) -> Vec<EdgeUse> {
    let proper = (0..).zip(triangles).filter(|(_, triangle)| is_proper(triangle));
    let mut edges: Vec<EdgeUse> = proper
        .flat_map(|(triangle, &[a, b, c])| {
            let edge = move |[i, j]: [u32; 2]| EdgeUse { edge: [i.min(j), i.max(j)], triangle, along: i < j };
            [[a, b], [b, c], [c, a]].map(edge)
        })
        .collect();
    edges.sort_unstable();
    edges
}

/// True for triangles without a repeated vertex.
fn is_proper([a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// Triangles with a height of less than this part of their longest side are omitted.
pub(super) const FLAT: f64 = 1e-9;

/// The tree of the triangles, except those with almost no height relative to their longest side.
pub(super) fn tree_of(triangles: impl Iterator<Item = [DVec3; 3]>) -> TriangleTree {
    TriangleTree::new(&triangles.filter(|triangle| !is_flat(triangle, FLAT)).collect::<Vec<_>>())
}

/// True for triangles with a height of at most the fraction `part` of their longest side.
pub(super) fn is_flat([a, b, c]: &[DVec3; 3], part: f64) -> bool {
    let longest = a.distance_squared(*b).max(b.distance_squared(*c)).max(c.distance_squared(*a));
    (b - a).cross(c - a).length() <= part * longest
}

/// The connected piece of each triangle, and the number of pieces. Pieces are numbered in the order of their first triangles.
pub(super) fn pieces(vertices: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, usize) {
    let mut sets = DisjointSets::new(vertices);
    for &[a, b, c] in triangles {
        sets.join(a, b);
        sets.join(a, c);
    }
    let mut numbers = HashMap::new();
    let of_triangle = triangles.iter().map(|corners| {
        let next = numbers.len() as u32;
        *numbers.entry(sets.find(corners[0])).or_insert(next)
    });
    (of_triangle.collect(), numbers.len())
}

/// Triangles of three indices each. One or two remaining indices are ignored.
#[cfg(any(feature = "bevy_mesh", feature = "mesh_files"))]
pub(super) fn list(indices: &[u32]) -> Vec<[u32; 3]> {
    indices.as_chunks().0.to_vec()
}

/// Triangles of a strip: each index forms one with the two indices before it, with alternating winding. Triangles with a repeated index are omitted.
#[cfg(any(feature = "bevy_mesh", feature = "mesh_files"))]
pub(super) fn strip(indices: &[u32]) -> Vec<[u32; 3]> {
    let turned = |(at, w): (usize, &[u32])| if at % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
    indices.windows(3).enumerate().map(turned).filter(is_proper).collect()
}

#[cfg(test)]
pub(super) mod tests;
