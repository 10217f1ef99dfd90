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
pub(super) mod tests {
    use super::*;
    use crate::medial_axis::{MedialAxis, triangulate};

    /// Boxes by their lower corners and sizes, each of 12 triangles.
    pub fn boxes(each: &[[[f64; 3]; 2]]) -> TriangleMesh {
        let mut mesh = TriangleMesh { positions: vec![], triangles: vec![] };
        each.iter().map(|b| b.map(DVec3::from_array)).for_each(|[min, size]| add_box(&mut mesh, min, size));
        mesh
    }

    /// A prism over a polygon in x and y, counter-clockwise and star-shaped around its first corner.
    pub fn prism(polygon: &[[f64; 2]], height: f64) -> TriangleMesh {
        let count = polygon.len() as u32;
        let level = |z: f64| polygon.iter().map(move |&[x, y]| DVec3::new(x, y, z).as_vec3());
        let mut mesh = TriangleMesh { positions: level(0.0).chain(level(height)).collect(), triangles: vec![] };
        for i in 0..count {
            let j = (i + 1) % count;
            mesh.triangles.extend([[i, j, count + j], [i, count + j, count + i]]);
            if i > 0 && j > 0 {
                mesh.triangles.extend([[0, j, i], [count, count + i, count + j]]);
            }
        }
        mesh
    }

    /// A regular polygon.
    pub fn circle(corners: u32, radius: f64) -> Vec<[f64; 2]> {
        let corner = |i: u32| {
            let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(corners)).sin_cos();
            [x * radius, y * radius]
        };
        (0..corners).map(corner).collect()
    }

    /// The surfaces of a shape's primitives, including the parts inside other primitives.
    pub fn triangulated(axis: &MedialAxis, segments: u32) -> TriangleMesh {
        let surface = triangulate(axis.spheres(), axis.primitives(), segments);
        let positions = surface.positions.into_iter().map(Vec3::from).collect();
        TriangleMesh::new(positions, surface.indices.as_chunks().0.to_vec()).unwrap()
    }

    /// Adds a box of 12 outward triangles.
    pub fn add_box(mesh: &mut TriangleMesh, min: DVec3, size: DVec3) {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend((0..8u32).map(|corner| {
            let unit = DVec3::new((corner & 1).into(), (corner >> 1 & 1).into(), (corner >> 2).into());
            (min + unit * size).as_vec3()
        }));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in quads.map(|q: [u32; 4]| q.map(|i| first + i)) {
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }

    /// A unit tetrahedron with outward triangles.
    pub fn tetrahedron() -> TriangleMesh {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        TriangleMesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()
    }

    #[test]
    fn errors_name_what_and_where() {
        let good = tetrahedron();
        let with = |at: usize, position: Vec3| {
            let mut positions = good.positions.clone();
            positions[at] = position;
            positions
        };
        let range = "is not a number from -1000000 to 1000000; move or scale the mesh";
        let cases = [
            (good.positions.clone(), vec![], "the mesh has no triangles".into()),
            (with(2, Vec3::new(0.0, f32::NAN, 0.0)), vec![[0, 1, 2]], format!("vertex 2: NaN {range}")),
            (with(3, Vec3::INFINITY), vec![[0, 1, 2]], format!("vertex 3: inf {range}")),
            (with(0, Vec3::X * 2e6), vec![[0, 1, 2]], format!("vertex 0: 2000000 {range}")),
            (good.positions.clone(), vec![[0, 1, 2], [1, 2, 4]], "triangle 1: there is no vertex 4 among 4".into()),
            (vec![Vec3::ONE; 3], vec![[0, 1, 2]], "the mesh has no size: all of its triangles lie in one point".into()),
            (
                vec![Vec3::ONE; MAX_MESH_SIZE + 1],
                vec![[0, 1, 2]],
                "the mesh has 16777217 vertices, more than 16777216; reduce it first".into(),
            ),
        ];
        for (positions, triangles, message) in cases {
            assert_eq!(TriangleMesh::new(positions, triangles).unwrap_err().to_string(), message);
        }
    }

    #[test]
    fn welding_joins_equal_places_and_drops_unused_ones() {
        let good = tetrahedron();
        // Each triangle has its own vertices, one of them at -0, and one vertex is unused.
        let mut positions = vec![Vec3::splat(9.0)];
        positions.extend(good.triangles.iter().flat_map(|t| good.corners(*t)));
        positions[1] = -Vec3::ZERO;
        let soup = TriangleMesh::new(positions, (0..4).map(|i| [0, 1, 2].map(|k| 1 + 3 * i + k)).collect()).unwrap();
        assert_eq!((soup.components().len(), good.components().len()), (4, 1));
        let welded = soup.welded();
        assert_eq!((welded.positions.len(), welded.components()), (4, vec![vec![0, 1, 2, 3]]));
        for (a, b) in welded.triangles.iter().zip(&good.triangles) {
            assert_eq!(welded.corners(*a), good.corners(*b));
        }
        assert_eq!(soup.diagonal(), 3f32.sqrt(), "the unused vertex is counted");
    }

    #[cfg(feature = "bevy_mesh")]
    #[test]
    fn bevy_meshes_of_triangles_are_taken() {
        use bevy::{
            asset::RenderAssetUsages,
            mesh::{Indices, Mesh, MeshBuilder, Meshable, PrimitiveTopology},
        };

        let cuboid = bevy::math::primitives::Cuboid::new(1.0, 2.0, 3.0).mesh().build();
        let mesh = TriangleMesh::from_bevy(&cuboid).unwrap();
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 12), "24 vertices with normals are 8 places");
        let report = super::super::MeshReport::new(&mesh);
        assert!(report.is_closed() && (report.volume - 6.0).abs() < 1e-5, "{report:?}");

        let square = vec![[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        let of = |topology| {
            Mesh::new(topology, RenderAssetUsages::default())
                .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, square.clone())
        };
        let strip = TriangleMesh::from_bevy(&of(PrimitiveTopology::TriangleStrip)).unwrap();
        assert_eq!(strip.triangles, [[0, 1, 2], [2, 1, 3]]);
        let unindexed = TriangleMesh::from_bevy(&of(PrimitiveTopology::TriangleList)).unwrap();
        assert_eq!(unindexed.triangles, [[0, 1, 2]]);
        let wild = of(PrimitiveTopology::TriangleList).with_inserted_indices(Indices::U32(vec![0, 1, 4]));
        assert!(matches!(TriangleMesh::from_bevy(&wild), Err(MeshError::IndexOutOfRange { index: 4, .. })));
        for (mesh, why) in [
            (of(PrimitiveTopology::LineList), "LineList"),
            (Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default()), "wasn't found"),
        ] {
            let error = TriangleMesh::from_bevy(&mesh).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
