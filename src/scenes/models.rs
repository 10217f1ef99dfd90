use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use thiserror::Error;

use crate::{
    builder::{MedialFileError, MedialLevels, MedialLevelsError},
    medial_axis::{MedialAxis, MedialAxisError, ma},
};

/// A shape with its name.
#[derive(Clone, Debug)]
pub struct Model {
    /// Name of the file without its extension.
    pub name: String,
    /// The shape, with its coarser levels if the file has any.
    pub axis: MedialAxis,
}

/// Reason why models could not be read.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The folder or a file in it could not be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The folder or file.
        path: PathBuf,
        /// The error.
        source: std::io::Error,
    },
    /// A file is not in the format.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The error.
        source: ma::MaError,
    },
    /// A file does not describe a shape.
    #[error("{}: {source}", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// The error.
        source: MedialAxisError,
    },
    /// A `.medial` file cannot be used.
    #[error(transparent)]
    Levels(#[from] MedialFileError),
    /// The folder holds no medial mesh.
    #[error("{}: no .medial or .ma file in this folder; `--models` expects a folder of medial meshes", .0.display())]
    None(PathBuf),
}

/// Reads every `.medial` file of a folder, and every `.ma` file without a `.medial` file of the same name, in the order of their names.
///
/// # Errors
/// If the folder or a file cannot be read, or if a file is not a shape. The message names the file and, for text, the line.
pub fn load_models(folder: &Path) -> Result<Vec<Model>, ModelError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| ModelError::Io { path, source }
    };
    let mut files: BTreeMap<PathBuf, bool> = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(io(folder))? {
        let path = entry.map_err(io(folder))?.path();
        let ending = path.extension().unwrap_or_default();
        if ending == "ma" || ending == "medial" {
            *files.entry(path.with_extension("")).or_default() |= ending == "medial";
        }
    }
    if files.is_empty() {
        return Err(ModelError::None(folder.to_owned()));
    }
    files
        .into_iter()
        .map(|(stem, has_levels)| {
            let axis = if has_levels { with_levels(&stem) } else { without_levels(&stem) }?;
            let name = stem.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
            Ok(Model { name, axis })
        })
        .collect()
}

fn with_levels(stem: &Path) -> Result<MedialAxis, ModelError> {
    let path = with_ending(stem, "medial");
    let empty = || MedialFileError::Content { path: path.clone(), source: MedialLevelsError::Empty };
    Ok(MedialLevels::load(&path)?.into_medial_axis().ok_or_else(empty)?)
}

fn without_levels(stem: &Path) -> Result<MedialAxis, ModelError> {
    let path = with_ending(stem, "ma");
    let bytes = std::fs::read(&path).map_err(|source| ModelError::Io { path: path.clone(), source })?;
    let file = ma::parse(&bytes).map_err(|source| ModelError::Format { path: path.clone(), source })?;
    let (axis, _) = file.into_medial_axis().map_err(|source| ModelError::Shape { path, source })?;
    Ok(axis)
}

/// Appends an extension. The name itself may contain dots.
fn with_ending(stem: &Path, ending: &str) -> PathBuf {
    let mut path = stem.as_os_str().to_owned();
    path.push(".");
    path.push(ending);
    path.into()
}
