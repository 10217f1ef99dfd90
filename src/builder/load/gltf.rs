use std::{
    fs,
    io::{self, Read},
    path::Path,
};

use glam::{DMat4, Mat4, Vec3};
use gltf::{
    Accessor, Document, Gltf, Mesh, Node, Primitive, Semantic,
    accessor::{DataType, Dimensions},
    buffer::Source,
    mesh::Mode,
};

use super::FormatError;
use crate::builder::{
    MAX_MESH_SIZE, MeshError, TriangleMesh,
    mesh::{list, strip},
};

/// Size of the header of a GLB file in bytes. The file's stated length includes it.
const GLB_HEADER: u32 = 12;

/// Prefixes of extensions that do not affect the shape.
const COLOURS: [&str; 5] = ["KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"];

/// Reads all meshes of the default scene, or of the first one if there is no default, transformed by their nodes.
pub(super) fn parse(bytes: &[u8], folder: &Path) -> Result<TriangleMesh, FormatError> {
    let length = bytes.get(8..12).and_then(|length| length.try_into().ok()).map(u32::from_le_bytes);
    if bytes.starts_with(b"glTF") && length.is_none_or(|length| length < GLB_HEADER) {
        return Err(FormatError::damaged("the GLB header", "it is truncated, or states an impossible length"));
    }
    let damaged = |error: gltf::Error| FormatError::damaged("the glTF document", error.to_string());
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(damaged)?;
    let mut json = document.into_json();
    // Extensions for colours and lights do not change the surface.
    json.extensions_required.retain(|name| !COLOURS.iter().any(|prefix| name.starts_with(prefix)));
    // Exporters do not always list this extension as required.
    let places = json.extensions_used.iter().find(|name| *name == "EXT_mesh_gpu_instancing");
    if let Some(name) = json.extensions_required.first().or(places) {
        let remedy = "export it without quantization, compression and other extensions";
        return Err(FormatError::new("the glTF document", format!("it needs the extension {name}"), remedy));
    }
    // The validation of the crate uses these indices without a check.
    let mut attributes = json.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|p| p.attributes.values());
    if let Some(accessor) = attributes.find(|accessor| accessor.value() >= json.accessors.len()) {
        let problem = format!("a mesh refers to accessor {accessor}, which does not exist");
        return Err(FormatError::damaged("the glTF document", problem));
    }
    let document = Document::from_json(json).map_err(damaged)?;
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let scene = scene.ok_or_else(|| {
        FormatError::new("the glTF document", "it has no scene", "put the meshes into a scene and export it again")
    })?;
    let file = File { buffers: buffers(&document, blob, folder)? };

    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut seen = vec![false; document.nodes().len()];
    let mut open: Vec<(Node, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((node, parent)) = open.pop() {
        if std::mem::replace(&mut seen[node.index()], true) {
            let place = format!("node {}", node.index());
            return Err(FormatError::damaged(place, "the scene reaches it twice, so its nodes are not a tree"));
        }
        let pose = parent * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        if let Some(skin) = node.skin() {
            let problem = format!("it is deformed by skin {}, and its own transform does not count", skin.index());
            let remedy = "apply the armature's pose and all transforms, and export it without";
            return Err(FormatError::new(format!("node {}", node.index()), problem, remedy));
        }
        if let Some(mesh) = node.mesh() {
            let mut weights = node.weights().or(mesh.weights()).into_iter().flatten();
            if weights.any(|&weight| weight != 0.0) && mesh.primitives().any(|p| p.morph_targets().len() > 0) {
                let problem = format!("mesh {} is deformed by its morph targets", mesh.index());
                let remedy = "apply its shape keys and export it without, or set their weights to 0";
                return Err(FormatError::new(format!("node {}", node.index()), problem, remedy));
            }
            file.add(&mesh, &pose, &mut positions, &mut triangles)?;
        }
        open.extend(node.children().map(|child| (child, pose)));
    }
    Ok(TriangleMesh::new(positions, triangles)?)
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

struct File {
    buffers: Vec<Vec<u8>>,
}

impl File {
    /// Adds the triangles of a mesh.
    fn add(
        &self,
        mesh: &Mesh,
        pose: &DMat4,
        positions: &mut Vec<Vec3>,
        triangles: &mut Vec<[u32; 3]>,
    ) -> Result<(), FormatError> {
        for primitive in mesh.primitives() {
            let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
            let corners = self.triangles(&primitive, &place)?;
            let accessor = primitive.get(&Semantic::Positions);
            let accessor = accessor.ok_or_else(|| FormatError::damaged(place.clone(), "it has no positions"))?;
            let (kind, shape) = (accessor.data_type(), accessor.dimensions());
            if (kind, shape) != (DataType::F32, Dimensions::Vec3) {
                let remedy = "export it without quantization";
                return Err(FormatError::new(place, format!("its positions are {kind:?} {shape:?}"), remedy));
            }
            let local: Vec<[f32; 3]> = self
                .elements::<12>(&accessor)?
                .map(|bytes| bytemuck::pod_read_unaligned::<[[u8; 4]; 3]>(&bytes).map(f32::from_le_bytes))
                .collect();
            if let Some(index) = corners.iter().flatten().find(|&&index| index as usize >= local.len()) {
                let problem = format!("there is no vertex {index} among {}", local.len());
                return Err(FormatError::damaged(place, problem));
            }
            // Several nodes may use one mesh, so the size of the file does not bound the total.
            for (what, count) in
                [("vertices", positions.len() + local.len()), ("triangles", triangles.len() + corners.len())]
            {
                if count > MAX_MESH_SIZE {
                    return Err(MeshError::TooLarge { what, count }.into());
                }
            }
            let first = positions.len() as u32;
            positions.extend(local.iter().map(|&p| pose.transform_point3(Vec3::from(p).as_dvec3()).as_vec3()));
            // A mirroring transform turns triangles inside out.
            let mirrored = pose.determinant() < 0.0;
            triangles.extend(corners.iter().map(|&[a, b, c]| {
                let triangle = if mirrored { [a, c, b] } else { [a, b, c] };
                triangle.map(|i| first + i)
            }));
        }
        Ok(())
    }

    /// The triangles of a primitive, as indices of its own vertices.
    fn triangles(&self, primitive: &Primitive, place: &str) -> Result<Vec<[u32; 3]>, FormatError> {
        let indices: Vec<u32> = match primitive.indices() {
            None => {
                let count = primitive.get(&Semantic::Positions).map_or(0, |accessor| accessor.count());
                (0..count.min(MAX_MESH_SIZE) as u32).collect()
            }
            Some(accessor) => match (accessor.data_type(), accessor.dimensions()) {
                (DataType::U8, Dimensions::Scalar) => self.elements(&accessor)?.map(|[i]| i.into()).collect(),
                (DataType::U16, Dimensions::Scalar) => {
                    self.elements(&accessor)?.map(|i| u16::from_le_bytes(i).into()).collect()
                }
                (DataType::U32, Dimensions::Scalar) => self.elements(&accessor)?.map(u32::from_le_bytes).collect(),
                (kind, shape) => {
                    return Err(FormatError::damaged(place, format!("its indices are {kind:?} {shape:?}")));
                }
            },
        };
        match primitive.mode() {
            Mode::Triangles => Ok(list(&indices)),
            Mode::TriangleStrip => Ok(strip(&indices)),
            Mode::TriangleFan => Ok(match indices.split_first() {
                Some((&apex, rim)) => rim.windows(2).map(|w| [apex, w[0], w[1]]).collect(),
                None => Vec::new(),
            }),
            mode => {
                let problem = format!("it is drawn as {mode:?}, not as triangles");
                Err(FormatError::new(place, problem, "remove it, or turn it into triangles"))
            }
        }
    }

    /// The elements of an accessor, of `N` bytes each.
    fn elements<const N: usize>(&self, accessor: &Accessor) -> Result<impl Iterator<Item = [u8; N]>, FormatError> {
        let place = || format!("accessor {}", accessor.index());
        let view = accessor.view().filter(|_| accessor.sparse().is_none());
        let view = view.ok_or_else(|| {
            FormatError::new(
                place(),
                "it is sparse or compressed",
                "export it without sparse accessors and compression",
            )
        })?;
        let stride = view.stride().unwrap_or(N);
        let buffer = self.buffers.get(view.buffer().index());
        let end = view.offset().checked_add(view.length());
        let bytes = buffer.zip(end).and_then(|(buffer, end)| buffer.get(view.offset()..end));
        let bytes = bytes.and_then(|bytes| bytes.get(accessor.offset()..));
        let count = accessor.count();
        let needed = count.checked_sub(1).map_or(Some(0), |gaps| gaps.checked_mul(stride)?.checked_add(N));
        let bytes = bytes.zip(needed).and_then(|(bytes, needed)| bytes.get(..needed)).filter(|_| stride >= N);
        let bytes = bytes.ok_or_else(|| FormatError::damaged(place(), "its elements do not lie within its buffer"))?;
        Ok((0..count).map(move |i| std::array::from_fn(|byte| bytes[i * stride + byte])))
    }
}
