use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy_medial::{
    builder::{
        MedialLevels, MedialLevelsError, SkinnedTriangleMesh, TriangleMesh,
        load::{self, Loaded, MeshFormat},
    },
    medial_axis::{MedialAxis, ma},
    whole_file::{self, Staged},
};

/// The content of a file. The content determines the type, or the extension of the name.
pub enum Content {
    Mesh(TriangleMesh),
    Levels(MedialLevels),
    Medial(ma::MaFile),
}

impl Content {
    pub fn read(path: &Path) -> Result<Self, String> {
        let bytes = fs::read(path).map_err(|error| at(path, format!("cannot be read: {error}")))?;
        match MedialLevels::from_bytes(&bytes) {
            Err(MedialLevelsError::Magic) if !is_levels(path) => {}
            levels => return Ok(Self::Levels(levels.map_err(|error| at(path, error))?)),
        }
        let Some(format) = MeshFormat::detect(&bytes, path) else {
            return Ok(Self::Medial(ma::parse(&bytes).map_err(|error| at(path, error))?));
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Self::Mesh(with_warnings(path, format.parse(&bytes, folder).map_err(|error| at(path, error))?)))
    }
}

/// Returns true if the name is that of a file of levels.
pub fn is_levels(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("medial"))
}

/// Reads a triangle mesh and prints its warnings.
pub fn load_mesh(path: &Path) -> Result<TriangleMesh, String> {
    Ok(with_warnings(path, load::read(path).map_err(|error| error.to_string())?))
}

/// Reads a skinned triangle mesh in its bind pose and prints its warnings.
pub fn load_skinned_mesh(path: &Path) -> Result<SkinnedTriangleMesh, String> {
    Ok(with_warnings(path, load::read_skinned(path).map_err(|error| error.to_string())?))
}

fn with_warnings<M>(path: &Path, Loaded { mesh, warnings }: Loaded<M>) -> M {
    warnings.iter().for_each(|warning| eprintln!("warning: {}", at(path, warning)));
    mesh
}

/// Checks a path for a medial mesh before the work, which would fail or overwrite a triangle mesh.
pub fn check_output(output: &Path) -> Result<(), String> {
    if output.is_dir() || output.as_os_str().to_string_lossy().ends_with(std::path::is_separator) {
        return Err(at(output, "it is a folder; name a file in it"));
    }
    if MeshFormat::of(output).is_some() {
        let named = output.with_extension("ma");
        return Err(at(output, format!("that is the name of a triangle mesh; name it {}", named.display())));
    }
    match output.parent() {
        Some(folder) if folder != Path::new("") && !folder.is_dir() => {
            Err(at(folder, "there is no such folder; make it first"))
        }
        _ => whole_file::check(output).map_err(|error| not_written(output, &error)),
    }
}

/// Writes all files, or none if one of them cannot be written.
pub fn write(files: &[(PathBuf, Vec<u8>)]) -> Result<(), String> {
    let staged =
        |(path, content): &(PathBuf, Vec<u8>)| Staged::new(path, content).map_err(|error| not_written(path, &error));
    let mut staged: Vec<(&PathBuf, Staged)> =
        files.iter().map(|file| Ok((&file.0, staged(file)?))).collect::<Result<_, String>>()?;
    // Devices and pipes come first, because a rename rarely fails.
    staged.sort_by_key(|(_, staged)| staged.is_file());
    staged.into_iter().try_for_each(|(path, staged)| staged.commit().map_err(|error| not_written(path, &error)))
}

/// The content of a `.ma` file.
pub fn text(axis: &MedialAxis) -> Vec<u8> {
    ma::write(&axis.into()).into_bytes()
}

fn not_written(path: &Path, error: &std::io::Error) -> String {
    at(path, format!("cannot be written: {error}"))
}

pub fn at(path: &Path, error: impl std::fmt::Display) -> String {
    format!("{}: {error}", path.display())
}
