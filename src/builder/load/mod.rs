//! Reads triangle meshes from files: OBJ, glTF and GLB, STL, PLY.
//!
//! Only the surface is read: positions and faces, as one mesh in the units of the file, which count as metres. Polygons are split into
//! triangles, and vertices at equal positions are merged. Lines and points have no surface: they are left out with a warning. Other unsupported
//! content is an error, never a partial mesh.
//!
//! OBJ and STL have their own parsers. Errors of the crate `tobj` contain no line numbers, and the crate `stl_io` parses binary files that
//! start with `solid` as text, although such files are common.

mod accessors;
mod clip;
mod gltf;
mod node_meshes;
mod nodes;
mod obj;
mod ply;
mod polygon;
mod skins;
mod stl;

use std::path::{Path, PathBuf};

use bevy::log::warn;
use glam::Vec3;
use thiserror::Error;

pub use clip::Clip;
pub use node_meshes::NodeMesh;

use super::{MeshError, SkinnedTriangleMesh, TriangleMesh};
use crate::medial_axis::ma::without_mark;

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ: all `v` and `f` records of all objects; free-form surfaces are refused, and the rest is skipped.
    Obj,
    /// glTF 2.0, as JSON or as GLB: all meshes of the default scene, placed by their nodes.
    Gltf,
    /// STL, as text or binary.
    Stl,
    /// PLY, as text or binary of either byte order: the elements `vertex`, `face` and `tristrips`.
    Ply,
}

/// Reasons why a file contains no usable mesh.
#[derive(Debug, Error)]
pub enum LoadError {
    /// The file could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the file system.
        source: std::io::Error,
    },
    /// Neither the content nor the extension of the file name is that of a known format.
    #[error("{}: the extension is not .obj, .gltf, .glb, .stl or .ply; convert the mesh to one of these", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The content is not in the format, or is not usable.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The place in the file and the reason.
        source: FormatError,
    },
}

/// The mesh of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded<M = TriangleMesh> {
    /// The surface.
    pub mesh: M,
    /// Content that was left out, and assumptions about content that contradicts itself.
    pub warnings: Vec<String>,
}

/// An error in the content of a file, and its place.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{place}: {problem}; {remedy}")]
pub struct FormatError {
    /// Line, element or byte.
    pub place: String,
    /// Description of the error.
    pub problem: String,
    /// Advice for the user.
    pub remedy: &'static str,
}

/// Maximum number of characters of a problem's text.
const LONGEST_PROBLEM: usize = 240;

/// Advice for content that a program has written incorrectly, or that was truncated or altered later.
const EXPORT_AGAIN: &str = "export it again";

impl FormatError {
    /// The problem may quote the file, so it is truncated and control characters are replaced.
    fn new(place: impl Into<String>, problem: impl Into<String>, remedy: &'static str) -> Self {
        let printable = |c: char| if c.is_control() { ' ' } else { c };
        let problem = problem.into().chars().map(printable).take(LONGEST_PROBLEM).collect();
        Self { place: place.into(), problem, remedy }
    }

    fn damaged(place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::new(place, problem, EXPORT_AGAIN)
    }
}

impl From<MeshError> for FormatError {
    fn from(error: MeshError) -> Self {
        let remedy = match error {
            MeshError::TooLarge { .. } => "reduce it first",
            MeshError::NotFinite { .. } => "move or scale it, and export it again",
            _ => "repair it in a modelling program and export it again",
        };
        let message = error.to_string();
        let (problem, _) = message.split_once("; ").unwrap_or((&message, ""));
        Self::new("the mesh", problem, remedy)
    }
}

impl MeshFormat {
    /// The format for the extension of a file name.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "gltf" | "glb" => Some(Self::Gltf),
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// The format of the content of a file. The extension of its name decides if the content has no mark of a format, as in OBJ files.
    pub fn detect(bytes: &[u8], path: &Path) -> Option<Self> {
        let text = without_mark(bytes).trim_ascii_start();
        if stl::is_stl(bytes) {
            Some(Self::Stl)
        } else if text.starts_with(b"glTF") || text.starts_with(b"{") {
            Some(Self::Gltf)
        } else if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else {
            Self::of(path)
        }
    }

    /// Parses the bytes of a file. A glTF file may refer to other files by paths relative to `folder`.
    ///
    /// # Errors
    /// The first error. Memory and time are bounded by the size of the files and by [`MAX_MESH_SIZE`](super::MAX_MESH_SIZE), whatever sizes they
    /// declare.
    pub fn parse(self, bytes: &[u8], folder: &Path) -> Result<Loaded, FormatError> {
        let mut warnings = Vec::new();
        let mesh = match self {
            Self::Obj => obj::parse(bytes, &mut warnings),
            Self::Gltf => gltf::parse(bytes, folder, &mut warnings),
            Self::Stl => stl::parse(bytes, &mut warnings),
            Self::Ply => ply::parse(bytes),
        }?;
        Ok(Loaded { mesh: mesh.welded(), warnings })
    }

    /// Parses the bytes of a file with skinned meshes, in their bind poses. Only glTF files have skins.
    ///
    /// # Errors
    /// The errors of [`parse`](Self::parse), those of a mesh without a skin or without weights, and those of a joint whose scale is not uniform.
    pub fn parse_skinned(self, bytes: &[u8], folder: &Path) -> Result<Loaded<SkinnedTriangleMesh>, FormatError> {
        if self != Self::Gltf {
            let remedy = "build it without `--skin`, or export it as .glb";
            return Err(FormatError::new("the file", format!("the format {self:?} has no skins"), remedy));
        }
        let mut warnings = Vec::new();
        let mesh = gltf::parse_skinned(bytes, folder, &mut warnings)?;
        Ok(Loaded { mesh: mesh.welded(), warnings })
    }
}

/// Reads the nodes of a glTF file that have a mesh, in the order of the file.
///
/// # Errors
/// The path of the file, the place in it, the reason and advice. A mesh that cannot be used is an error of its node.
pub fn read_nodes(path: &Path) -> Result<Vec<NodeMesh>, LoadError> {
    read_with(path, |format, bytes, folder| match format {
        MeshFormat::Gltf => node_meshes::parse(bytes, folder),
        _ => Err(FormatError::new("the file", format!("the format {format:?} has no nodes"), "export it as .glb")),
    })
}

/// Reads a mesh file and logs its warnings: see [`read`].
///
/// # Errors
/// Those of [`read`].
pub fn load(path: &Path) -> Result<TriangleMesh, LoadError> {
    let Loaded { mesh, warnings } = read(path)?;
    warnings.iter().for_each(|warning| warn!("{}: {warning}", path.display()));
    Ok(mesh)
}

/// Reads a mesh file. Its content determines the format, or the extension of its name: see [`MeshFormat::detect`].
///
/// # Errors
/// The path of the file, the place in it, the reason and advice.
pub fn read(path: &Path) -> Result<Loaded, LoadError> {
    read_with(path, MeshFormat::parse)
}

/// Reads the skinned meshes of a glTF file in their bind poses.
///
/// # Errors
/// The path of the file, the place in it, the reason and advice.
pub fn read_skinned(path: &Path) -> Result<Loaded<SkinnedTriangleMesh>, LoadError> {
    read_with(path, MeshFormat::parse_skinned)
}

/// Reads the first animation of a glTF file; `None` without one, and for other formats.
///
/// # Errors
/// The path of the file, the place in it, the reason and advice.
pub fn read_clip(path: &Path) -> Result<Option<Clip>, LoadError> {
    read_with(path, |format, bytes, folder| match format {
        MeshFormat::Gltf => gltf::parse_clip(bytes, folder),
        _ => Ok(None),
    })
}

fn read_with<M>(
    path: &Path,
    parse: impl Fn(MeshFormat, &[u8], &Path) -> Result<M, FormatError>,
) -> Result<M, LoadError> {
    let bytes = std::fs::read(path).map_err(|source| LoadError::Io { path: path.into(), source })?;
    parse_as(&bytes, path, path.parent().unwrap_or(Path::new("")), parse)
}

/// Parses the content of a mesh file. `path`: its name, for the format and for messages. `folder`: the folder of the files that it refers to.
pub(crate) fn parse_as<M>(
    bytes: &[u8],
    path: &Path,
    folder: &Path,
    parse: impl Fn(MeshFormat, &[u8], &Path) -> Result<M, FormatError>,
) -> Result<M, LoadError> {
    let format = MeshFormat::detect(bytes, path).ok_or_else(|| LoadError::UnknownFormat { path: path.into() })?;
    parse(format, bytes, folder).map_err(|source| LoadError::Format { path: path.into(), source })
}

/// The lines of a text without its byte order mark. They end in LF, CR LF, or CR alone.
fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let lines = without_mark(bytes).split(|&byte| byte == b'\n');
    lines.flat_map(|line| line.strip_suffix(b"\r").unwrap_or(line).split(|&byte| byte == b'\r'))
}

/// Three coordinates, or a description of the error.
fn position<'a>(fields: &mut impl Iterator<Item = &'a str>) -> Result<Vec3, String> {
    let mut position = Vec3::ZERO;
    for axis in 0..3 {
        let field = fields.next().ok_or("a vertex has fewer than 3 coordinates")?;
        let value = field.parse().ok().filter(|value: &f32| value.is_finite());
        position[axis] = value.ok_or_else(|| format!("`{field}` is not a finite number"))?;
    }
    Ok(position)
}

#[cfg(test)]
mod tests;
