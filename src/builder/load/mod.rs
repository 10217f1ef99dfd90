//! Triangle meshes from files: OBJ, glTF and GLB, STL, PLY.
//!
//! Only the surface is read: positions and faces, as one mesh in the units of the file, which count as metres. Polygons are cut into
//! triangles, vertices at equal places become one. What a file asks for that this cannot give is an error, never a partial mesh.
//!
//! OBJ and STL have readers of their own: of the crates for them, `tobj` names no lines in its errors, and `stl_io` takes binary files that
//! start with `solid`, which are common, for text.

mod gltf;
mod obj;
mod ply;
mod polygon;
mod stl;

use std::path::{Path, PathBuf};

use glam::Vec3;
use thiserror::Error;

use super::{MeshError, TriangleMesh};

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ: all `v` and `f` records; the rest is skipped.
    Obj,
    /// glTF 2.0, as JSON or as GLB: all meshes of the default scene, placed by their nodes.
    Gltf,
    /// STL, as text or binary.
    Stl,
    /// PLY, as text or binary of either byte order: the elements `vertex`, `face` and `tristrips`.
    Ply,
}

/// Why a file gives no mesh.
#[derive(Debug, Error)]
pub enum LoadError {
    /// The file could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The name's extension is none of those known.
    #[error("{}: the extension is not .obj, .gltf, .glb, .stl or .ply; convert the mesh to one of these", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The content is not in the format, or not usable.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: FormatError,
    },
}

/// What is wrong with the content of a file, and where.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{place}: {problem}; {remedy}")]
pub struct FormatError {
    /// Line, element or byte.
    pub place: String,
    /// What is wrong there.
    pub problem: String,
    /// What to do about it.
    pub remedy: &'static str,
}

/// Most characters of a problem's text.
const LONGEST_PROBLEM: usize = 240;

/// The remedy for content that some program has written wrongly, or that was cut or altered on its way.
const EXPORT_AGAIN: &str = "export it again";

impl FormatError {
    /// The problem may quote the file: it is cut, and made one line.
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
    /// The format that the extension of a file name stands for.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "gltf" | "glb" => Some(Self::Gltf),
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// Reads the bytes of a file. A glTF file may name others, which lie relative to `folder`.
    ///
    /// # Errors
    /// The first thing that is wrong. Memory and time are bounded by the size of the files, whatever they promise.
    pub fn parse(self, bytes: &[u8], folder: &Path) -> Result<TriangleMesh, FormatError> {
        let mesh = match self {
            Self::Obj => obj::parse(bytes),
            Self::Gltf => gltf::parse(bytes, folder),
            Self::Stl => stl::parse(bytes),
            Self::Ply => ply::parse(bytes),
        }?;
        Ok(mesh.welded())
    }
}

/// Reads a mesh file by the extension of its name.
///
/// # Errors
/// Names the file, the place in it and the remedy.
pub fn load(path: &Path) -> Result<TriangleMesh, LoadError> {
    let format = MeshFormat::of(path).ok_or_else(|| LoadError::UnknownFormat { path: path.into() })?;
    let bytes = std::fs::read(path).map_err(|source| LoadError::Io { path: path.into(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    format.parse(&bytes, folder).map_err(|source| LoadError::Format { path: path.into(), source })
}

/// Three coordinates, or what is wrong with them.
fn position<'a>(fields: &mut impl Iterator<Item = &'a str>) -> Result<Vec3, String> {
    let mut position = Vec3::ZERO;
    for axis in 0..3 {
        let field = fields.next().ok_or("a vertex has fewer than 3 coordinates")?;
        let value = field.parse().ok().filter(|value: &f32| value.is_finite());
        position[axis] = value.ok_or_else(|| format!("`{field}` is no finite number"))?;
    }
    Ok(position)
}

#[cfg(test)]
mod tests;
