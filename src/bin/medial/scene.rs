//! `medial build SCENE --per-mesh -o FOLDER`: a medial mesh for each mesh of a glTF scene.

use std::{collections::BTreeMap, fs, path::PathBuf};

use bevy_medial::builder::{
    MedialLevels, MeshReport, NodeBody, TriangleMesh, is_named,
    load::{NodeMesh, read_nodes},
};

use super::{
    build::{Args, described, fitted},
    files::{self, at, check_output},
    print,
};

/// Builds the meshes and prints each result. Returns true if all of them are written.
pub fn run(args: &Args) -> bool {
    let nodes = match wanted(args) {
        Ok(nodes) => nodes,
        Err(error) => return print(Err(error)),
    };
    let (mut files, mut built) = (BTreeMap::new(), Vec::new());
    let outcomes = nodes.iter().map(|node| {
        let outcome = match &node.triangles {
            Ok(triangles) => write(args, node, triangles, &mut files, &mut built),
            Err(error) => Err(error.clone()),
        };
        print(outcome.map_err(|error| at(&args.mesh, format!("node `{}`: {error}", node.node))))
    });
    outcomes.filter(|is_written| !is_written).count() == 0
}

/// The nodes that get a shape.
fn wanted(args: &Args) -> Result<Vec<NodeMesh>, String> {
    let is_any = |names: &[String], node: &NodeMesh| {
        names.iter().any(|name| is_named(&node.node, name) || is_named(&node.mesh, name))
    };
    let mut nodes = read_nodes(&args.mesh).map_err(|error| error.to_string())?;
    nodes.retain(|node| {
        let is_chosen = args.only.is_empty() && node.mark.body != Some(NodeBody::NoShape) || is_any(&args.only, node);
        is_chosen && !is_any(&args.skip, node)
    });
    if nodes.is_empty() {
        return Err(at(&args.mesh, "no node gets a shape; check --only, --skip and the marks of the nodes"));
    }
    fs::create_dir_all(&args.output)
        .map_err(|error| at(&args.output, format!("the folder cannot be made: {error}")))?;
    Ok(nodes)
}

/// Builds and writes the shape of a node, unless the file has been written for another node. Equal meshes are built once.
fn write<'a>(
    args: &Args,
    node: &'a NodeMesh,
    triangles: &'a TriangleMesh,
    files: &mut BTreeMap<String, &'a NodeMesh>,
    built: &mut Vec<(&'a TriangleMesh, MedialLevels)>,
) -> Result<String, String> {
    let path: PathBuf = args.output.join(format!("{}.medial", node.file));
    if let Some(other) = files.get(&node.file) {
        return match other.triangles.as_ref() == Ok(triangles) {
            true => Ok(String::new()),
            false => {
                Err(format!("its mesh and that of node `{}` are both named `{}`; rename one", other.node, node.mesh))
            }
        };
    }
    files.insert(node.file.clone(), node);
    check_output(&path)?;
    if !built.iter().any(|(known, _)| *known == triangles) {
        for flaw in MeshReport::new(triangles).flaws() {
            eprintln!("warning: {}", at(&args.mesh, format!("node `{}`: {flaw}", node.node)));
        }
        built.push((triangles, fitted(args, triangles, true)?));
    }
    let (_, chain) = built.iter().find(|(known, _)| *known == triangles).ok_or("it was not built")?;
    files::write(&[(path.clone(), chain.to_bytes())])?;
    Ok(described(args, &path, chain))
}
