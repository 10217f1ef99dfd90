use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::medial_axis::{CleanupReport, MedialAxis, MedialAxisError, ma};

/// A shape with its name.
#[derive(Clone, Debug)]
pub struct Model {
    /// The file's name without its ending.
    pub name: String,
    /// The shape.
    pub axis: MedialAxis,
    /// What clean-up changed in the file's lists.
    pub report: CleanupReport,
}

/// Why models could not be read.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The folder or a file in it could not be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not in the format.
    #[error("{}: {source}", path.display())]
    Format {
        /// Which.
        path: PathBuf,
        /// Why.
        source: ma::MaError,
    },
    /// A file does not describe a shape.
    #[error("{}: {source}", path.display())]
    Shape {
        /// Which.
        path: PathBuf,
        /// Why.
        source: MedialAxisError,
    },
    /// The folder holds no `.ma` file.
    #[error("{}: no .ma file in this folder; `--models` wants a folder of medial meshes", .0.display())]
    None(PathBuf),
}

/// Reads every `.ma` file of a folder, in the order of their names.
///
/// # Errors
/// If the folder or a file cannot be read, or a file is no shape; the message names the file and, for its text, the line.
pub fn load_models(folder: &Path) -> Result<Vec<Model>, ModelError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| ModelError::Io { path, source }
    };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io(folder))? {
        let path = entry.map_err(io(folder))?.path();
        if path.extension().is_some_and(|extension| extension == "ma") {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(ModelError::None(folder.to_owned()));
    }
    paths.sort();
    paths
        .into_iter()
        .map(|path| {
            let bytes = std::fs::read(&path).map_err(io(&path))?;
            let file = ma::parse(&bytes).map_err(|source| ModelError::Format { path: path.clone(), source })?;
            let (axis, report) =
                file.into_medial_axis().map_err(|source| ModelError::Shape { path: path.clone(), source })?;
            let name = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
            Ok(Model { name, axis, report })
        })
        .collect()
}
