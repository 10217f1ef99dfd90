use bevy::{
    asset::{AssetLoader, LoadContext, io::Reader},
    reflect::TypePath,
};
use thiserror::Error;

use crate::{
    builder::{MedialLevels, MedialLevelsError},
    medial_axis::{MedialAxis, MedialAxisError, ma},
};

/// Loads `.ma` files as [`MedialAxis`] assets.
#[derive(Default, TypePath)]
pub struct MaLoader;

/// Why a `.ma` file did not load.
#[derive(Debug, Error)]
pub enum MaLoaderError {
    /// The file could not be read.
    #[error("the file could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The text is not in the format.
    #[error(transparent)]
    Format(#[from] ma::MaError),
    /// The content does not describe a shape.
    #[error(transparent)]
    Shape(#[from] MedialAxisError),
}

impl AssetLoader for MaLoader {
    type Asset = MedialAxis;
    type Settings = ();
    type Error = MaLoaderError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<MedialAxis, MaLoaderError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let (axis, report) = ma::parse(&bytes)?.into_medial_axis()?;
        if !report.is_empty() {
            bevy::log::debug!("{}: {report}", context.path());
        }
        // Loading runs in the background, so the mass is computed here.
        axis.mass();
        Ok(axis)
    }

    fn extensions(&self) -> &[&str] {
        &["ma"]
    }
}

/// Loads `.medial` files as [`MedialAxis`] assets with their levels of detail.
#[derive(Default, TypePath)]
pub struct MedialLoader;

/// Why a `.medial` file did not load.
#[derive(Debug, Error)]
pub enum MedialLoaderError {
    /// The file could not be read.
    #[error("the file could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The content is not a valid chain of levels.
    #[error(transparent)]
    Levels(#[from] MedialLevelsError),
}

impl AssetLoader for MedialLoader {
    type Asset = MedialAxis;
    type Settings = ();
    type Error = MedialLoaderError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _: &(),
        _: &mut LoadContext<'_>,
    ) -> Result<MedialAxis, MedialLoaderError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        Ok(MedialLevels::from_bytes(&bytes)?.into_medial_axis().ok_or(MedialLevelsError::Empty)?)
    }

    fn extensions(&self) -> &[&str] {
        &["medial"]
    }
}
