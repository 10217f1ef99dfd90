//! Renders pictures of scenes without a window.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy::{prelude::*, render::view::screenshot::ScreenshotCaptured};
use bevy_rapier3d::prelude::RapierConfiguration;
use indicatif::ProgressBar;

use crate::{
    common::studio::Studio,
    movie::Movie,
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

/// Steps between the pictures of a movie.
const MOVIE_STEPS: u32 = 3;

/// Max number of frames until the renderer has returned the last picture of a movie.
const MOVIE_PATIENCE: u32 = 20;

/// Runs the scene for `steps` steps and writes a movie that shows every third one.
pub fn movie(show: Show, steps: u32, size: UVec2, file: &Path) -> Result<(), String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
    if steps <= MOVIE_STEPS {
        return Err(format!("a movie of {steps} steps has no picture; run more than {MOVIE_STEPS}"));
    }
    bevy_medial::whole_file::check(file).map_err(|error| failed(&error))?;
    let seconds = show.dt * MOVIE_STEPS as f32;
    let mut studio = studio(show, size);
    studio.app.insert_resource(Movie::new(size, seconds));
    // The first frame is empty.
    studio.app.update();
    let progress = ProgressBar::new(steps.into());
    for step in 1..steps {
        let is_shown = step % MOVIE_STEPS == 0;
        set_camera(&mut studio.app, is_shown);
        if is_shown {
            studio.shoot(|picture: On<ScreenshotCaptured>, mut movie: ResMut<Movie>| {
                movie.add(picture.image.data.as_deref().unwrap_or_default());
            });
        }
        studio.app.update();
        progress.inc(1);
    }
    progress.finish_and_clear();
    let wanted = (steps.saturating_sub(1) / MOVIE_STEPS) as usize;
    for _ in 0..MOVIE_PATIENCE {
        if studio.app.world().resource::<Movie>().len() == wanted {
            let bytes = studio.app.world_mut().resource_mut::<Movie>().encode().map_err(|error| failed(&error))?;
            return fs::write(file, bytes).map_err(|error| failed(&error));
        }
        studio.app.update();
    }
    Err(failed(&"the renderer returned too few pictures"))
}

fn studio(show: Show, size: UVec2) -> Studio {
    Studio::new(size, |app, target| {
        if show.overlay {
            app.add_plugins(overlay::plugin);
        }
        add_scene(app, show, target);
    })
}

fn set_camera(app: &mut App, active: bool) {
    let mut cameras = app.world_mut().query::<&mut Camera>();
    cameras.iter_mut(app.world_mut()).for_each(|mut camera| camera.is_active = active);
}

/// Stops the simulation.
fn halt(app: &mut App) {
    let mut configurations = app.world_mut().query::<&mut RapierConfiguration>();
    configurations.iter_mut(app.world_mut()).for_each(|mut rapier| rapier.physics_pipeline_active = false);
}
