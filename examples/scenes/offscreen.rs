//! Renders pictures of scenes without a window.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy::prelude::*;
use bevy_rapier3d::prelude::RapierConfiguration;

use crate::{
    common::{
        movie,
        studio::{Studio, set_camera},
    },
    overlay,
    view::{Show, add_scene},
};

/// Runs the scene for `steps` steps and writes a picture of the last one.
pub fn screenshot(show: Show, steps: u32, size: UVec2, file: &Path) -> Result<(), String> {
    let mut studio = studio(show, size);
    // Rendering every step would take most of the time, so the camera is off until the last steps.
    studio.app.update();
    set_camera(&mut studio.app, false);
    for _ in 1..steps {
        studio.app.update();
    }
    halt(&mut studio.app);
    set_camera(&mut studio.app, true);
    studio.app.update();
    studio.take(file)?;
    studio.wait_for(file)
}

/// Runs the scene for `steps` steps and writes a picture of each.
pub fn frames(show: Show, steps: u32, size: UVec2, folder: &Path) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut studio = studio(show, size);
    let mut last = PathBuf::new();
    for step in 1..=steps {
        studio.app.update();
        last = folder.join(format!("{step:04}.png"));
        studio.take(&last)?;
    }
    halt(&mut studio.app);
    studio.wait_for(&last)
}

/// Runs the scene for `steps` steps and writes a movie.
pub fn movie(show: Show, steps: u32, size: UVec2, file: &Path) -> Result<(), String> {
    let dt = show.dt;
    movie::record(&mut studio(show, size), steps, dt, file)
}

fn studio(show: Show, size: UVec2) -> Studio {
    Studio::new(size, |app, target| {
        if show.overlay {
            app.add_plugins(overlay::plugin);
        }
        add_scene(app, show, target);
    })
}

/// Stops the simulation.
fn halt(app: &mut App) {
    let mut configurations = app.world_mut().query::<&mut RapierConfiguration>();
    configurations.iter_mut(app.world_mut()).for_each(|mut rapier| rapier.physics_pipeline_active = false);
}
