//! The tree of nodes of a glTF document.

use std::collections::HashSet;

use gltf::{Document, Node};

use super::FormatError;

/// The nodes of the default scene, or of the first one if there is no default, each with the index of its parent. Parents come before their children.
pub(super) fn nodes(document: &Document) -> Result<Vec<(Node<'_>, Option<usize>)>, FormatError> {
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let scene = scene.ok_or_else(|| {
        FormatError::new("the glTF document", "it has no scene", "put the meshes into a scene and export it again")
    })?;
    let (mut nodes, mut known) = (vec![], HashSet::new());
    let mut open: Vec<(Node, Option<usize>)> = scene.nodes().map(|node| (node, None)).collect();
    while let Some((node, parent)) = open.pop() {
        if !known.insert(node.index()) {
            let place = format!("node {}", node.index());
            return Err(FormatError::damaged(place, "the scene reaches it twice, so its nodes are not a tree"));
        }
        open.extend(node.children().map(|child| (child, Some(node.index()))));
        nodes.push((node, parent));
    }
    Ok(nodes)
}

/// The name of a node. Bevy gives the same names to nodes without a name.
pub(super) fn name(node: &Node) -> String {
    node.name().map_or_else(|| format!("GltfNode{}", node.index()), Into::into)
}
