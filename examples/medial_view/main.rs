//! Shows a triangle mesh and its medial mesh side by side, with the error as colour, and spheres, cones and slabs as lines. Sliders select the level of
//! detail. With `--skin` it shows the binding of a skinned glTF file instead, with a colour for each joint, and plays the first animation.
//!
//! ```text
//! cargo run --release --example medial_view -- MESH [--spheres N] [--medial FILE] [--budget PERCENT] [--save FILE]
//!                                              [--skin] [--time SECONDS] [--screenshot FILE]
//! ```
//!
//! Without `--medial`, the medial mesh is built while the window shows the progress. Without a display, or with `--screenshot`, no window opens.

#[path = "../common/mod.rs"]
mod common;

mod binding;
mod job;
mod panel;
mod shown;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy::{camera::RenderTarget, light::GlobalAmbientLight, prelude::*};
use bevy_medial::{
    builder::{
        FitOptions, Level, MedialLevels, TriangleMesh, fit, fit_skinned,
        load::{load, read_clip, read_skinned},
        measure,
    },
    medial_axis::ma,
    plugin::MedialDebugPlugin,
};
use bevy_medial_compare::outcome;
use bevy_panorbit_camera::{PanOrbitCamera, PanOrbitCameraPlugin};
use binding::Binding;
use clap::Parser;
use common::{display::has_display, studio::Studio};
use job::Job;
use shown::Shown;

#[derive(Parser)]
#[command(about = "Shows the medial mesh of a triangle mesh")]
struct Args {
    /// Triangle mesh: .obj, .gltf, .glb, .stl, .ply.
    mesh: PathBuf,
    /// Max number of spheres of the finest level.
    #[arg(long, default_value_t = 60)]
    spheres: usize,
    /// A `.medial` or `.ma` file of the mesh, used instead of a build.
    #[arg(long, value_name = "FILE")]
    medial: Option<PathBuf>,
    /// Max error in percent of the diagonal: the coarsest level within it is shown first. Default: the finest level.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    budget: f32,
    /// File for the levels. They are saved at once if no window opens, else by a button. Default: the mesh's name with `.medial`, saved only by the button.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Show the binding to the joints of a skinned glTF file, and play its first animation.
    #[arg(long)]
    skin: bool,
    /// Time of the animation in a picture, in seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    time: f32,
    /// Write a picture as PNG and exit. Needs a graphics adapter (a software adapter is enough), but no display.
    #[arg(long, value_name = "FILE")]
    screenshot: Option<PathBuf>,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let skinned = if args.skin { Some(read_skinned(&args.mesh)?.mesh) } else { None };
    let mesh = match &skinned {
        Some(skinned) => skinned.mesh().clone(),
        None => load(&args.mesh)?,
    };
    let options = FitOptions { spheres: Some(args.spheres), levels: true, ..default() };
    let job = match (&args.medial, mesh.clone(), skinned.clone()) {
        (Some(file), mesh, _) => Job::done(read(file, &mesh)?),
        (None, _, Some(skinned)) => Job::start(move |progress| fit_skinned(&skinned, &options, progress)),
        (None, mesh, None) => Job::start(move |progress| fit(&mesh, &options, progress)),
    };
    let still = args.screenshot.as_ref().map(|_| args.time);
    let binding = match skinned {
        Some(mesh) => Some(Binding { mesh, clip: read_clip(&args.mesh)?, still }),
        None => None,
    };
    let save_as = args.save.clone().unwrap_or_else(|| args.mesh.with_extension("medial"));
    let shown = Shown::new(mesh, args.budget, save_as);
    if args.screenshot.is_none() && has_display() {
        let mut app = App::new();
        let title = format!("medial_view: {}", args.mesh.display());
        app.add_plugins(
            DefaultPlugins.set(WindowPlugin { primary_window: Some(Window { title, ..default() }), ..default() }),
        )
        .add_plugins(PanOrbitCameraPlugin);
        add_view(&mut app, shown, job, binding, RenderTarget::default());
        app.run();
        return Ok(());
    }
    let levels = job.wait()?;
    for (number, level) in levels.levels.iter().enumerate() {
        println!("level {number}: {} spheres, {}", level.axis.spheres().len(), level.error);
    }
    if let Some(file) = &args.save {
        levels.save(file)?;
    }
    if let Some(file) = &args.screenshot {
        let mut studio = Studio::new(UVec2::new(1280, 640), |app, target| {
            add_view(app, shown, Job::done(levels), binding, target);
        });
        // New meshes and text take a frame or two to reach the renderer.
        (0..6).for_each(|_| studio.app.update());
        studio.take(file)?;
        studio.wait_for(file)?;
    }
    Ok(())
}

/// Reads the levels of a `.medial` file, or the single level of a `.ma` file. The error of the latter is measured, because the file does not contain it.
fn read(file: &Path, mesh: &TriangleMesh) -> Result<MedialLevels, Box<dyn std::error::Error>> {
    if !file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ma")) {
        return Ok(MedialLevels::load(file)?);
    }
    let at = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
    let bytes = std::fs::read(file).map_err(|error| at(&error))?;
    let (axis, _) = ma::parse(&bytes).map_err(|error| at(&error))?.into_medial_axis().map_err(|error| at(&error))?;
    Ok(MedialLevels { levels: vec![Level { error: measure(mesh, &axis), axis }], ..MedialLevels::default() })
}

fn add_view(app: &mut App, shown: Shown, job: Job, binding: Option<Binding>, target: RenderTarget) {
    if let Some(binding) = binding {
        app.insert_resource(binding);
    }
    app.add_plugins((MedialDebugPlugin::default(), shown::plugin, panel::plugin, binding::plugin))
        .insert_resource(ClearColor(Color::srgb(0.93, 0.94, 0.95)))
        .insert_resource(GlobalAmbientLight { brightness: 450.0, ..default() })
        .insert_resource(shown)
        .insert_resource(job);
    app.world_mut().spawn((
        Camera3d::default(),
        IsDefaultUiCamera,
        target,
        PanOrbitCamera::default(),
        Transform::from_xyz(0.15, 0.4, 1.4).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    app.world_mut().spawn((
        DirectionalLight { shadow_maps_enabled: true, illuminance: 6000.0, ..default() },
        Transform::from_xyz(-1.5, 4.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}
