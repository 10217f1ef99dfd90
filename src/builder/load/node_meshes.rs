//! The meshes of a glTF scene, one for each file of shapes.

use std::path::Path;

use glam::{DMat4, Mat3};
use gltf::{Mesh, Node};

use super::{FormatError, gltf::GltfFile, nodes::name};
use crate::builder::{
    TriangleMesh,
    nodes::{NodeMark, Proportions},
};

/// The mesh of a node in a glTF scene.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeMesh {
    /// Name of the node, or its number, such as `GltfNode3`.
    pub node: String,
    /// Name of the mesh, or its number, such as `GltfMesh3`.
    pub mesh: String,
    /// The marks of the node.
    pub mark: NodeMark,
    /// Name of the file of its shape, without the extension. Nodes with the same mesh in the same proportions have the same name.
    pub file: String,
    /// The triangles in the node's own frame, or the reason why they cannot be used. A non-uniform scale is applied; its largest factor becomes 1.
    pub triangles: Result<TriangleMesh, String>,
}

/// Reads the nodes with a mesh.
pub(super) fn parse(bytes: &[u8], folder: &Path) -> Result<Vec<NodeMesh>, FormatError> {
    let file = GltfFile::new(bytes, folder)?;
    let mut nodes = file.nodes()?;
    nodes.sort_by_key(|(node, _)| node.index());
    let with_mesh = nodes.iter().filter_map(|(node, pose)| Some((node, pose, node.mesh()?)));
    with_mesh.map(|(node, pose, mesh)| of_node(&file, node, &mesh, pose)).collect()
}

fn of_node(file: &GltfFile, node: &Node, mesh: &Mesh, pose: &DMat4) -> Result<NodeMesh, FormatError> {
    let name = name(node);
    let extras = [node.extras(), mesh.extras()].into_iter().flatten().map(|extras| extras.get());
    let mark = NodeMark::new(&name, extras).map_err(|problem| {
        FormatError::new(format!("node {} `{name}`", node.index()), problem, "correct it and export it again")
    })?;
    let mesh_name = mesh.name().map_or_else(|| format!("GltfMesh{}", mesh.index()), str::to_owned);
    let shaped = Proportions::of(Mat3::from_mat4(pose.as_mat4()));
    let triangles = match shaped {
        Ok((Proportions(scale), _)) => file.triangles(node, mesh, &DMat4::from_scale(scale.as_dvec3())),
        Err(problem) => Err(FormatError::new("its transform", problem, "export it again")),
    };
    Ok(NodeMesh {
        file: shaped.map_or_else(|_| mesh_name.clone(), |(proportions, _)| proportions.file_name(&mesh_name)),
        node: name,
        mesh: mesh_name,
        mark,
        triangles: triangles.map_err(|error| error.to_string()),
    })
}
