use thiserror::Error;

use super::{MeshError, TriangleMesh};
use crate::medial_axis::{JointPose, JointWeights, Skin, SkinError, SkinJoint};

/// A triangle mesh in the bind pose, with joints and the weights of each vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinnedTriangleMesh {
    mesh: TriangleMesh,
    skin: Skin,
}

/// Reasons why a mesh is not a skinned triangle mesh.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SkinnedMeshError {
    /// The triangles are invalid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The joints or weights are invalid. A point is a vertex.
    #[error(transparent)]
    Skin(#[from] SkinError),
    /// A Bevy mesh has no weights.
    #[error(
        "the Bevy mesh has no attribute {0} with four values per vertex; use a mesh with joint indices and weights in main memory"
    )]
    NoWeights(&'static str),
}

impl SkinnedTriangleMesh {
    /// Binds a mesh to joints, with the weights of each vertex.
    ///
    /// # Errors
    /// The errors of [`Skin::new`], and those of a list with another number of vertices.
    pub fn new(mesh: TriangleMesh, joints: Vec<SkinJoint>, weights: &[JointWeights]) -> Result<Self, SkinError> {
        if weights.len() != mesh.positions.len() {
            return Err(SkinError::Count { weights: weights.len(), points: mesh.positions.len() });
        }
        Ok(Self { mesh, skin: Skin::new(joints, weights)? })
    }

    /// Converts a Bevy mesh with joint indices and weights. `joints` are those of its `SkinnedMesh`, in the same order. Vertices at equal positions are merged
    /// and keep the weights of the first one.
    ///
    /// # Errors
    /// The errors of [`TriangleMesh::from_bevy`] and [`new`](Self::new), and those of a mesh without joint indices or weights.
    #[cfg(feature = "bevy_mesh")]
    pub fn from_bevy(mesh: &bevy::mesh::Mesh, joints: Vec<SkinJoint>) -> Result<Self, SkinnedMeshError> {
        use bevy::mesh::{Mesh, VertexAttributeValues};

        let triangles = TriangleMesh::with_all_vertices(mesh)?;
        let [indices, weights] =
            [Mesh::ATTRIBUTE_JOINT_INDEX, Mesh::ATTRIBUTE_JOINT_WEIGHT].map(|a| (mesh.attribute(a), a.name));
        let (Some(VertexAttributeValues::Uint16x4(indices)), _) = indices else {
            return Err(SkinnedMeshError::NoWeights(indices.1));
        };
        let (Some(VertexAttributeValues::Float32x4(weights)), _) = weights else {
            return Err(SkinnedMeshError::NoWeights(weights.1));
        };
        let of_vertex = |(joints, weights): (&[u16; 4], &[f32; 4])| std::array::from_fn(|at| (joints[at], weights[at]));
        let weights: Vec<JointWeights> = indices.iter().zip(weights).map(of_vertex).collect();
        Ok(Self::new(triangles, joints, &weights)?.welded())
    }

    /// The same triangles with one vertex per position, which has the weights of the first one there.
    #[must_use]
    pub fn welded(&self) -> Self {
        let (mesh, sources) = self.mesh.welded_vertices();
        let weights = sources.iter().map(|&vertex| self.skin.weights()[vertex as usize]).collect();
        Self { mesh, skin: self.skin.with_weights(weights) }
    }

    /// The triangles in the bind pose.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The joints, and the weights of each vertex.
    pub fn skin(&self) -> &Skin {
        &self.skin
    }

    /// The triangles in another pose: each vertex moves by linear blend skinning.
    ///
    /// # Panics
    /// If there are fewer poses than joints.
    #[must_use]
    pub fn posed(&self, poses: &[JointPose]) -> TriangleMesh {
        let vertices = self.mesh.positions.iter().enumerate();
        let positions = vertices.map(|(vertex, &position)| self.skin.pose_point(vertex, position, poses)).collect();
        TriangleMesh { positions, triangles: self.mesh.triangles.clone() }
    }

    /// Converts the triangles to a Bevy mesh with joint indices and weights, without normals.
    #[cfg(feature = "bevy_mesh")]
    pub fn to_bevy(&self) -> bevy::mesh::Mesh {
        use bevy::mesh::{Mesh, VertexAttributeValues};

        let weights = self.skin.weights();
        let joints: Vec<[u16; 4]> = weights.iter().map(|weights| weights.map(|(joint, _)| joint)).collect();
        let weights: Vec<[f32; 4]> = weights.iter().map(|weights| weights.map(|(_, weight)| weight)).collect();
        let mesh = self.mesh.to_bevy();
        mesh.with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(joints))
            .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights)
    }
}
