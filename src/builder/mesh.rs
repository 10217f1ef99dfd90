//! Input of the builder.

use glam::Vec3;

/// Triangles over shared vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Triples of vertices, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
