use std::{fs, io::ErrorKind, ops::ControlFlow, path::Path};

use bevy::log::warn;

use crate::builder::{BuildError, FitOptions, MedialFileError, MedialLevels, TriangleMesh, fit};

/// Calls [`fit`], unless the directory contains the result. Saves a new result in the directory.
pub(super) fn fit_cached(
    directory: Option<&Path>,
    mesh: &TriangleMesh,
    options: &FitOptions,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<MedialLevels, BuildError> {
    let Some(directory) = directory else { return fit(mesh, options, progress) };
    let path = directory.join(format!("{}.medial", digest(mesh, options)));
    match MedialLevels::load(&path) {
        Ok(levels) => return Ok(levels),
        Err(MedialFileError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {}
        Err(error) => warn!("a cached medial mesh cannot be used, so it is built and written again: {error}"),
    }
    let levels = fit(mesh, options, progress)?;
    let made = fs::create_dir_all(directory).map_err(|source| MedialFileError::Io { path: directory.into(), source });
    if let Err(error) = made.and_then(|()| levels.save(&path)) {
        warn!(
            "{error}, so the next run builds it again; give MedialBuildPlugin::cache a directory that can be written"
        );
    }
    Ok(levels)
}

/// Hash of content, options and crate version, because another release may build other shapes. After a change of the builder within a version, the
/// cache has to be emptied by hand.
fn digest(mesh: &TriangleMesh, options: &FitOptions) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    let head = format!("{} {options:?} {} ", env!("CARGO_PKG_VERSION"), mesh.positions.len());
    hasher.update(head.as_bytes());
    hasher.update(bytemuck::cast_slice(&mesh.positions));
    hasher.update(bytemuck::cast_slice(&mesh.triangles));
    hasher.finalize()
}
