//! Renders pictures without a window, on any graphics adapter.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use bevy::{
    camera::RenderTarget,
    ecs::system::IntoObserverSystem,
    log::LogPlugin,
    prelude::*,
    render::{
        RenderPlugin,
        render_resource::TextureFormat,
        view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk},
    },
    window::ExitCondition,
    winit::WinitPlugin,
};

/// Max number of frames until the renderer returns a picture.
const PATIENCE: u32 = 20;

/// An app that renders to an image.
pub struct Studio {
    pub app: App,
    /// Size of pictures, in pixels.
    pub size: UVec2,
    target: Handle<Image>,
}

impl Studio {
    /// `DefaultPlugins` without a window. `build` adds a camera with the given target.
    pub fn new(size: UVec2, build: impl FnOnce(&mut App, RenderTarget)) -> Self {
        Self::with_assets(size, AssetPlugin::default(), build)
    }

    /// The same with other assets.
    pub fn with_assets(size: UVec2, assets: AssetPlugin, build: impl FnOnce(&mut App, RenderTarget)) -> Self {
        let mut app = App::new();
        app.add_plugins(
            DefaultPlugins
                .set(assets)
                .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
                .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
                .set(LogPlugin { filter: "error".into(), ..default() })
                .disable::<WinitPlugin>(),
        );
        let target = Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
        build(&mut app, RenderTarget::Image(target.clone().into()));
        app.finish();
        app.cleanup();
        Self { app, size, target }
    }

    /// Requests a picture of this frame.
    ///
    /// # Errors
    /// If there is a file of that name and it cannot be removed.
    pub fn take(&mut self, file: &Path) -> Result<(), String> {
        if let Err(error) = fs::remove_file(file)
            && error.kind() != io::ErrorKind::NotFound
        {
            return Err(format!("{}: {error}", file.display()));
        }
        self.shoot(save_to_disk(PathBuf::from(file)));
        Ok(())
    }

    /// Requests a picture of this frame for an observer.
    pub fn shoot<M>(&mut self, observer: impl IntoObserverSystem<ScreenshotCaptured, (), M>) {
        let picture = Screenshot::image(self.target.clone());
        self.app.world_mut().spawn(picture).observe(observer);
    }

    /// Updates the app until the requested picture is written.
    ///
    /// # Errors
    /// If the renderer returns no picture within a fixed number of frames.
    pub fn wait_for(&mut self, file: &Path) -> Result<(), String> {
        for _ in 0..PATIENCE {
            self.app.update();
            if file.exists() {
                return Ok(());
            }
        }
        Err(format!("{}: the renderer returned no picture", file.display()))
    }
}

/// Turns all cameras on or off.
pub fn set_camera(app: &mut App, active: bool) {
    let mut cameras = app.world_mut().query::<&mut Camera>();
    cameras.iter_mut(app.world_mut()).for_each(|mut camera| camera.is_active = active);
}
