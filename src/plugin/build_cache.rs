use std::{fs, io::ErrorKind, ops::ControlFlow, path::Path};

use bevy::log::warn;

use crate::builder::{BuildError, FitOptions, MedialFileError, MedialLevels, TriangleMesh, fit};

/// As [`fit`], but what a directory holds is not built again, and what is built is put there.
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
        Err(error) => warn!("what the cache holds is not used, but built and written anew: {error}"),
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

/// Tells content and options from all others, and this release of the builder, which may build otherwise, from others. Who works on the builder
/// empties the cache.
fn digest(mesh: &TriangleMesh, options: &FitOptions) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    let head = format!("{} {options:?} {} ", env!("CARGO_PKG_VERSION"), mesh.positions.len());
    hasher.update(head.as_bytes());
    hasher.update(bytemuck::cast_slice(&mesh.positions));
    hasher.update(bytemuck::cast_slice(&mesh.triangles));
    hasher.finalize()
}
