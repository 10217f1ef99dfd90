use std::{
    borrow::Cow,
    collections::HashMap,
    fs,
    io::{self, Read},
    path::Path,
};

use glam::{DMat4, Mat4, Vec3};
use gltf::{Document, Glb, Mesh, Node, Primitive, Semantic, buffer::Source, json::Root, mesh::Mode};
use serde_json::Value;

use super::{
    FormatError,
    accessors::{Values, indices, values},
    clip::Clip,
    nodes::nodes,
    skins::Skins,
};
use crate::{
    builder::{
        MAX_MESH_SIZE, MeshError, SkinnedTriangleMesh, TriangleMesh,
        mesh::{list, strip},
    },
    medial_axis::SkinError,
};

/// Size of the header of a GLB file in bytes. The file's stated length includes it.
const GLB_HEADER: u32 = 12;

/// Prefixes of extensions that do not affect the shape, and the supported extension.
const KNOWN: [&str; 6] =
    ["KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "KHR_mesh_quantization"];

/// Reads all meshes of the default scene, or of the first one if there is no default, transformed by their nodes.
pub(super) fn parse(bytes: &[u8], folder: &Path, warnings: &mut Vec<String>) -> Result<TriangleMesh, FormatError> {
    let file = read(bytes, folder, None, warnings)?;
    Ok(TriangleMesh::new(file.positions, file.triangles)?)
}

/// Reads the same meshes in their bind poses. Each must have a skin.
pub(super) fn parse_skinned(
    bytes: &[u8],
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<SkinnedTriangleMesh, FormatError> {
    let file = read(bytes, folder, Some(Skins::default()), warnings)?;
    let Skins { joints, weights, .. } = file.skins.unwrap_or_default();
    let mesh = TriangleMesh::new(file.positions, file.triangles)?;
    let refused = |error: SkinError| {
        let message = error.to_string();
        let (problem, _) = message.split_once("; ").unwrap_or((&message, ""));
        FormatError::new("the skin", problem, "correct the joints and export it again")
    };
    SkinnedTriangleMesh::new(mesh, joints, &weights).map_err(refused)
}

/// Reads meshes, with their skins if `skins` are given.
fn read(bytes: &[u8], folder: &Path, skins: Option<Skins>, warnings: &mut Vec<String>) -> Result<Surface, FormatError> {
    let file = GltfFile::new(bytes, folder)?;
    let nodes = file.nodes()?;
    let mut surface = Surface { skins, ..Surface::default() };
    for (node, pose) in &nodes {
        if let Some(mesh) = node.mesh() {
            surface.add(&file.buffers, node, &mesh, pose)?;
        }
    }
    if let Some(skins) = &surface.skins {
        skins.check_scales(&nodes.iter().map(|(node, pose)| (node.index(), *pose)).collect())?;
    }
    if let (count, Some(first)) = &surface.left_out {
        let problem = format!("{count} primitives of lines or points, the first is {first}");
        if surface.triangles.is_empty() {
            let problem = format!("it has no triangles, only {problem}");
            return Err(FormatError::new("the glTF document", problem, "turn them into triangles"));
        }
        warnings.push(format!("left out: {problem}"));
    }
    Ok(surface)
}

/// A glTF document with its buffers.
pub(super) struct GltfFile {
    document: Document,
    buffers: Vec<Vec<u8>>,
}

impl GltfFile {
    pub fn new(bytes: &[u8], folder: &Path) -> Result<Self, FormatError> {
        let (document, blob) = document(bytes)?;
        Ok(Self { buffers: buffers(&document, blob, folder)?, document })
    }

    /// The nodes of the default scene, or of the first one if there is no default, with their transforms in the scene.
    pub fn nodes(&self) -> Result<Vec<(Node<'_>, DMat4)>, FormatError> {
        let mut found: Vec<(Node, DMat4)> = Vec::new();
        let mut poses: HashMap<usize, DMat4> = HashMap::new();
        for (node, parent) in nodes(&self.document)? {
            let above = parent.and_then(|parent| poses.get(&parent)).copied().unwrap_or(DMat4::IDENTITY);
            let pose = above * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
            poses.insert(node.index(), pose);
            found.push((node, pose));
        }
        Ok(found)
    }

    /// The welded triangles of the mesh of a node, in a pose.
    pub fn triangles(&self, node: &Node, mesh: &Mesh, pose: &DMat4) -> Result<TriangleMesh, FormatError> {
        let mut surface = Surface::default();
        surface.add(&self.buffers, node, mesh, pose)?;
        Ok(TriangleMesh::new(surface.positions, surface.triangles)?.welded())
    }
}

/// Reads the first animation; `None` without one.
pub(super) fn parse_clip(bytes: &[u8], folder: &Path) -> Result<Option<Clip>, FormatError> {
    let GltfFile { document, buffers } = GltfFile::new(bytes, folder)?;
    let Some(animation) = document.animations().next() else { return Ok(None) };
    Clip::read(&animation, nodes(&document)?, &buffers).map(Some)
}

/// The document of a file, and the binary part of a GLB file.
fn document(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), FormatError> {
    let length = bytes.get(8..12).and_then(|length| length.try_into().ok()).map(u32::from_le_bytes);
    if bytes.starts_with(b"glTF") && length.is_none_or(|length| length < GLB_HEADER) {
        return Err(FormatError::damaged("the GLB header", "it is truncated, or states an impossible length"));
    }
    let damaged = |error: gltf::Error| FormatError::damaged("the glTF document", error.to_string());
    let (text, blob) = if bytes.starts_with(b"glTF") {
        let Glb { json, bin, .. } = Glb::from_slice(bytes).map_err(damaged)?;
        (json, bin.map(Cow::into_owned))
    } else {
        (bytes.into(), None)
    };
    let json = serde_json::from_slice(&text).map(without_materials).and_then(serde_json::from_value);
    let mut json: Root = json.map_err(|error| damaged(error.into()))?;
    json.extensions_required.retain(|name| !KNOWN.iter().any(|prefix| name.starts_with(prefix)));
    // Exporters do not always list this extension as required.
    let places = json.extensions_used.iter().find(|name| *name == "EXT_mesh_gpu_instancing");
    if let Some(name) = json.extensions_required.first().or(places) {
        let remedy = "export it without compression and other extensions";
        return Err(FormatError::new("the glTF document", format!("it needs the extension {name}"), remedy));
    }
    // The validation of the crate uses these indices without a check.
    let mut attributes = json.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|p| p.attributes.values());
    if let Some(accessor) = attributes.find(|accessor| accessor.value() >= json.accessors.len()) {
        let problem = format!("a mesh refers to accessor {accessor}, which does not exist");
        return Err(FormatError::damaged("the glTF document", problem));
    }
    Ok((Document::from_json(json).map_err(damaged)?, blob))
}

/// Removes the description of colours. Textures of other formats are no valid glTF without their extensions.
fn without_materials(mut document: Value) -> Value {
    if let Some(document) = document.as_object_mut() {
        ["images", "materials", "samplers", "textures"].into_iter().for_each(|list| _ = document.remove(list));
    }
    let meshes = document.get_mut("meshes").and_then(Value::as_array_mut).into_iter().flatten();
    let primitives = meshes.filter_map(|mesh| mesh.get_mut("primitives")?.as_array_mut()).flatten();
    primitives.filter_map(Value::as_object_mut).for_each(|primitive| _ = primitive.remove("material"));
    document
}

/// Returns an error for a mesh that morph targets deform.
fn check_morph(node: &Node, mesh: &Mesh) -> Result<(), FormatError> {
    let mut weights = node.weights().or(mesh.weights()).into_iter().flatten();
    if weights.any(|&weight| weight != 0.0) && mesh.primitives().any(|p| p.morph_targets().len() > 0) {
        let problem = format!("mesh {} is deformed by its morph targets", mesh.index());
        let remedy = "apply its shape keys and export it without, or set their weights to 0";
        return Err(FormatError::new(format!("node {}", node.index()), problem, remedy));
    }
    Ok(())
}

/// The bytes of all buffers: of the GLB file itself, of `data:` URIs, and of other files.
fn buffers(document: &Document, mut blob: Option<Vec<u8>>, folder: &Path) -> Result<Vec<Vec<u8>>, FormatError> {
    let read = |buffer: gltf::Buffer| {
        let place = format!("buffer {}", buffer.index());
        let bytes = match buffer.source() {
            Source::Bin => blob.take().ok_or_else(|| "the GLB file has no binary part".into()),
            Source::Uri(uri) => read_uri(uri, folder, buffer.length()),
        };
        let bytes = bytes.map_err(|problem| {
            FormatError::new(place.clone(), problem, "export it as one .glb file, or put the .bin file beside it")
        })?;
        if bytes.len() < buffer.length() {
            let problem = format!("it declares {} bytes and has {}", buffer.length(), bytes.len());
            return Err(FormatError::damaged(place, problem));
        }
        Ok(bytes)
    };
    document.buffers().map(read).collect()
}

/// The content of a URI. Of a file, at most the first `length` bytes are read.
fn read_uri(uri: &str, folder: &Path, length: usize) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data.split_once(";base64,").ok_or("its data URI is not in base64")?;
        return data_encoding::BASE64.decode(text.as_bytes()).map_err(|error| format!("its data URI: {error}"));
    }
    let name = percent_decoded(uri).filter(|name| !name.contains(':') && !Path::new(name).has_root());
    let name = name.ok_or_else(|| format!("its URI is not a relative path: `{uri}`"))?;
    read_start(&folder.join(&name), length).map_err(|error| format!("it cannot be read: {error}: `{name}`"))
}

/// The first bytes of a file. Devices and pipes are refused, because they may have no end.
fn read_start(path: &Path, length: usize) -> io::Result<Vec<u8>> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is not a file"));
    }
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(length as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A relative URI as a file name: `%20` is a space. `None` if the result is not UTF-8 text.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, after @ ..] = rest {
        let code = after.get(..2).filter(|_| *first == b'%').and_then(|code| std::str::from_utf8(code).ok());
        let decoded = code.and_then(|code| u8::from_str_radix(code, 16).ok());
        bytes.push(decoded.unwrap_or(*first));
        rest = if decoded.is_some() { &after[2..] } else { after };
    }
    String::from_utf8(bytes).ok()
}

/// The surface that has been read from a file.
#[derive(Default)]
struct Surface {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// Number of primitives without a surface, and the place of the first.
    left_out: (usize, Option<String>),
    /// The skins, if they are read.
    skins: Option<Skins>,
}

impl Surface {
    /// Adds the mesh of a node.
    fn add(&mut self, buffers: &[Vec<u8>], node: &Node, mesh: &Mesh, pose: &DMat4) -> Result<(), FormatError> {
        check_morph(node, mesh)?;
        let refused = |problem, remedy| Err(FormatError::new(format!("node {}", node.index()), problem, remedy));
        match (&mut self.skins, node.skin()) {
            (None, None) => self.add_triangles(buffers, mesh, pose, None),
            (None, Some(skin)) => {
                let problem = format!("it is deformed by skin {}, and its own transform does not count", skin.index());
                refused(problem, "use `medial build --skin`, or apply the armature's pose and all transforms")
            }
            (Some(_), None) => {
                let problem = format!("its mesh {} has no skin", mesh.index());
                refused(problem, "bind it to a joint, or remove it")
            }
            (Some(skins), Some(skin)) => {
                let joints = skins.add(&skin, buffers)?;
                // The transform of the node does not count.
                self.add_triangles(buffers, mesh, &DMat4::IDENTITY, Some(&joints))
            }
        }
    }

    /// Adds the triangles of a mesh, and their weights if the joints of its skin are given.
    fn add_triangles(
        &mut self,
        buffers: &[Vec<u8>],
        mesh: &Mesh,
        pose: &DMat4,
        joints: Option<&[u16]>,
    ) -> Result<(), FormatError> {
        for primitive in mesh.primitives() {
            let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
            if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
                let (count, first) = &mut self.left_out;
                // Several nodes may use one mesh, so the size of the file does not bound the number.
                *count += 1;
                first.get_or_insert(place);
                if *count > MAX_MESH_SIZE {
                    return Err(FormatError::new(
                        "the glTF document",
                        "it has too many primitives of lines or points",
                        "remove them",
                    ));
                }
                continue;
            }
            let accessor = primitive.get(&Semantic::Positions);
            let accessor = accessor.ok_or_else(|| FormatError::damaged(place.clone(), "it has no positions"))?;
            let local = values(&accessor, buffers, &place, Values::Positions)?;
            let local: Vec<Vec3> = local.as_chunks().0.iter().copied().map(Vec3::from_array).collect();
            let corners = corners(buffers, &primitive, local.len(), &place)?;
            if let Some(index) = corners.iter().flatten().find(|&&index| index as usize >= local.len()) {
                let problem = format!("there is no vertex {index} among {}", local.len());
                return Err(FormatError::damaged(place, problem));
            }
            // Several nodes may use one mesh, so the size of the file does not bound the total.
            let vertices = ("vertices", self.positions.len() + local.len());
            for (what, count) in [vertices, ("triangles", self.triangles.len() + corners.len())] {
                if count > MAX_MESH_SIZE {
                    return Err(MeshError::TooLarge { what, count }.into());
                }
            }
            if let (Some(skins), Some(joints)) = (&mut self.skins, joints) {
                skins.add_weights(&primitive, joints, local.len(), buffers, &place)?;
            }
            let first = self.positions.len() as u32;
            self.positions.extend(local.iter().map(|p| pose.transform_point3(p.as_dvec3()).as_vec3()));
            // A mirroring transform turns triangles inside out.
            let mirrored = pose.determinant() < 0.0;
            self.triangles.extend(corners.iter().map(|&[a, b, c]| {
                let triangle = if mirrored { [a, c, b] } else { [a, b, c] };
                triangle.map(|i| first + i)
            }));
        }
        Ok(())
    }
}

/// The triangles of a primitive, as indices of its own vertices.
fn corners(
    buffers: &[Vec<u8>],
    primitive: &Primitive,
    vertices: usize,
    place: &str,
) -> Result<Vec<[u32; 3]>, FormatError> {
    let indices = match primitive.indices() {
        None => (0..vertices as u32).collect(),
        Some(accessor) => indices(&accessor, buffers, place)?,
    };
    Ok(match (primitive.mode(), indices.split_first()) {
        (Mode::TriangleStrip, _) => strip(&indices),
        (Mode::TriangleFan, Some((&apex, rim))) => rim.windows(2).map(|w| [apex, w[0], w[1]]).collect(),
        _ => list(&indices),
    })
}
