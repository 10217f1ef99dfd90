//! Building medial meshes when assets are processed.

use std::{ops::ControlFlow, path::Path};

use bevy::{
    asset::{
        AssetApp, AsyncWriteExt,
        io::Writer,
        processor::{Process, ProcessContext, ProcessError},
    },
    log::warn,
    prelude::*,
    reflect::TypePath,
};

use super::{MedialLoader, init_medial_axis};
use crate::builder::{
    FitOptions, fit,
    load::{Loaded, MeshFormat, parse_as},
    on_this_thread,
};

/// Builds the `.medial` content of a mesh file with all levels of detail, as the program `medial` does. [`MedialProcessPlugin`] registers it.
///
/// The settings are those of a fit, except that all levels are always built. Fields that a meta file leaves out have their defaults:
///
/// ```ron
/// (
///     meta_format_version: "1.0",
///     asset: Process(processor: "MedialProcess", settings: (spheres: Some(40))),
/// )
/// ```
///
/// # Errors
/// The place in the file, the reason and advice, and the errors of [`fit`]. The files of a `.gltf` file are not read: it has to contain its buffers, as a
/// `.glb` file does.
#[derive(Clone, Copy, Debug, Default, TypePath)]
pub struct MedialProcess;

impl Process for MedialProcess {
    type Settings = FitOptions;
    type OutputLoader = MedialLoader;

    async fn process(
        &self,
        context: &mut ProcessContext<'_>,
        settings: &FitOptions,
        writer: &mut Writer,
    ) -> Result<(), ProcessError> {
        let path = context.path().clone();
        let mut bytes = Vec::new();
        let read = context.asset_reader().read_to_end(&mut bytes).await;
        read.map_err(|error| ProcessError::AssetTransformError(error.into()))?;
        let built = built(&bytes, path.path(), settings).map_err(ProcessError::AssetTransformError)?;
        let written = writer.write_all(&built).await;
        written.map_err(|error| ProcessError::AssetWriterError { path, err: error.into() })
    }
}

/// The content of the `.medial` file for a mesh file.
fn built(
    bytes: &[u8],
    path: &Path,
    settings: &FitOptions,
) -> Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
    let Loaded { mesh, warnings } = parse_as(bytes, path, Path::new(""), MeshFormat::parse)?;
    warnings.iter().for_each(|warning| warn!("{}: {warning}", path.display()));
    let options = FitOptions { levels: true, ..*settings };
    // The pool of the frame's systems stays free. Several files are built at the same time.
    let levels = on_this_thread(|| fit(&mesh, &options, &|_| ControlFlow::Continue(())))?;
    Ok(levels.to_bytes())
}

/// Registers [`MedialProcess`], for apps with [`AssetMode::Processed`](bevy::asset::AssetMode::Processed). Add it after `AssetPlugin`.
///
/// It processes files whose name ends in `.medial.glb`, `.medial.obj`, `.medial.stl` or `.medial.ply`, and other files whose meta file names the processor.
/// They load as [`MedialAxis`](crate::medial_axis::MedialAxis):
///
/// ```no_run
/// # use bevy::{asset::AssetMode, prelude::*};
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands.spawn((RigidBody::Dynamic, MedialMesh(assets.load("rock.medial.glb"))));
/// }
///
/// App::new()
///     .add_plugins(DefaultPlugins.set(AssetPlugin { mode: AssetMode::Processed, ..default() }))
///     .add_plugins((MedialPhysicsPlugins::default(), MedialProcessPlugin))
///     .add_systems(Startup, spawn)
///     .run();
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct MedialProcessPlugin;

/// File names that end in these extensions are processed without a meta file.
const EXTENSIONS: [&str; 4] = ["medial.glb", "medial.obj", "medial.ply", "medial.stl"];

impl Plugin for MedialProcessPlugin {
    fn build(&self, app: &mut App) {
        init_medial_axis(app);
        app.register_asset_processor(MedialProcess);
        for extension in EXTENSIONS {
            app.set_default_asset_processor::<MedialProcess>(extension);
        }
    }
}
