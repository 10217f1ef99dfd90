//! A glTF scene in which everything collides. The scene is made by code, written as .glb, and loaded by Bevy. Marks in the file select the bodies, and
//! `MedialScene` builds a medial mesh for each mesh.
//!
//! ```text
//! cargo run --release --example gltf_scene [-- --frames N] [--screenshot FILE] [--medial] [--glb FILE]
//! ```

#[path = "../common/mod.rs"]
mod common;
mod yard;

use std::{
    env,
    error::Error,
    fs,
    path::{Path, PathBuf},
    thread::sleep,
    time::Duration,
};

use bevy::{
    camera::RenderTarget,
    diagnostic::DiagnosticsPlugin,
    gltf::{GltfAssetLabel, GltfPlugin},
    image::ImagePlugin,
    light::GlobalAmbientLight,
    log::LogPlugin,
    prelude::*,
    time::TimeUpdateStrategy,
    world_serialization::WorldSerializationPlugin,
};
use bevy_medial::{
    builder::{FitOptions, load},
    prelude::*,
};
use bevy_rapier3d::prelude::{RapierConfiguration, TimestepMode};
use clap::Parser;
use common::{display::has_display, studio::Studio};
use yard::{MOVING, STILL, register, yard};

/// A glTF scene in which everything collides.
#[derive(Parser)]
struct Options {
    /// Number of frames, after which the program exits. Default without a display: 180
    #[arg(long)]
    frames: Option<u32>,
    /// Writes a picture of the last frame. It needs a graphics adapter, but no display
    #[arg(long)]
    screenshot: Option<PathBuf>,
    /// Draws the lines of the medial meshes
    #[arg(long)]
    medial: bool,
    /// Where to write the scene. Default: a temporary file
    #[arg(long)]
    glb: Option<PathBuf>,
}

/// Length of a step in seconds.
const DT: f32 = 1.0 / 60.0;

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let animal = load::load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/models/deer.obj")))?;
    let glb = options.glb.clone().unwrap_or_else(|| env::temp_dir().join("bevy_medial_yard.glb"));
    fs::write(&glb, yard(&animal))?;
    let folder = glb.parent().filter(|folder| *folder != Path::new("")).map_or(env::current_dir(), fs::canonicalize)?;
    let file = glb.file_name().ok_or("the scene needs a file name")?.to_string_lossy().into_owned();
    let assets = AssetPlugin { file_path: folder.to_string_lossy().into_owned(), ..default() };
    if options.frames.is_none() && options.screenshot.is_none() && has_display() {
        let mut app = App::new();
        app.add_plugins(DefaultPlugins.set(assets));
        build(&mut app, file, options.medial, RenderTarget::default());
        app.run();
        return Ok(());
    }
    let frames = options.frames.unwrap_or(180);
    let Some(picture) = options.screenshot else {
        let mut app = App::new();
        let log = LogPlugin { filter: "warn".into(), ..default() };
        app.add_plugins((MinimalPlugins, log, assets, TransformPlugin, DiagnosticsPlugin));
        app.add_plugins((ImagePlugin::default(), WorldSerializationPlugin, GltfPlugin::default()));
        simulate(&mut app, file);
        app.finish();
        app.cleanup();
        run(&mut app, frames);
        return report(&mut app);
    };
    let mut studio =
        Studio::with_assets(UVec2::new(960, 540), assets, |app, target| build(app, file, options.medial, target));
    run(&mut studio.app, frames);
    studio.take(&picture)?;
    studio.wait_for(&picture)?;
    report(&mut studio.app)
}

/// Name of the file of the scene.
#[derive(Resource)]
struct Scene(String);

/// Adds everything that does not draw.
fn simulate(app: &mut App, file: String) {
    register(app);
    app.add_plugins((MedialPhysicsPlugins::default(), MedialBuildPlugin::default()))
        .insert_resource(Scene(file))
        .insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)))
        .add_systems(Startup, spawn)
        .add_systems(Update, start);
}

fn spawn(mut commands: Commands, assets: Res<AssetServer>, scene: Res<Scene>) {
    let options = FitOptions { spheres: Some(40), ..default() };
    let scene = assets.load(GltfAssetLabel::Scene(0).from_asset(scene.0.clone()));
    commands.spawn((WorldAssetRoot(scene), MedialScene { options, ..default() }));
}

/// Starts the simulation when all shapes have been built. Bodies would fall through a ground without a shape.
fn start(mut worlds: Query<&mut RapierConfiguration>, builds: Query<&MedialBuildStatus>) {
    let is_over =
        |status: &MedialBuildStatus| matches!(status, MedialBuildStatus::Built | MedialBuildStatus::Failed(_));
    let all = !builds.is_empty() && builds.iter().all(is_over);
    worlds.iter_mut().for_each(|mut world| world.physics_pipeline_active = all);
}

/// The same with a camera, light and lines.
fn build(app: &mut App, file: String, medial: bool, target: RenderTarget) {
    simulate(app, file);
    app.add_plugins(MedialDebugPlugin { enabled: medial })
        .insert_resource(GlobalAmbientLight { brightness: 450.0, ..default() });
    let looking = |x: f32, y: f32, z: f32| Transform::from_xyz(x, y, z).looking_at(Vec3::Y * 0.3, Vec3::Y);
    app.world_mut().spawn((Camera3d::default(), target, looking(6.0, 5.5, 7.5)));
    app.world_mut().spawn((DirectionalLight { shadow_maps_enabled: true, ..default() }, looking(3.0, 8.0, 4.0)));
}

/// Updates the app until all shapes are built, and then for a number of frames.
fn run(app: &mut App, frames: u32) {
    let mut left = frames;
    while left > 0 {
        app.update();
        let mut worlds = app.world_mut().query::<&RapierConfiguration>();
        if worlds.iter(app.world()).any(|world| world.physics_pipeline_active) {
            left -= 1;
        } else {
            sleep(Duration::from_millis(1));
        }
    }
}

/// Prints where the bodies are. It is an error if a shape is missing, or if a body has left the yard.
fn report(app: &mut App) -> Result<(), Box<dyn Error>> {
    let mut shapes = app.world_mut().query::<(&Name, &MedialBuildStatus, &GlobalTransform)>();
    for node in MOVING.iter().chain(&STILL) {
        let found = shapes.iter(app.world()).find(|(name, ..)| name.as_str() == *node);
        let (name, status, place) = found.ok_or_else(|| format!("{node} has no shape"))?;
        let at = place.translation();
        println!("{name}: {status:?} at {at:.2}");
        if *status != MedialBuildStatus::Built || at.abs().max_element() > 6.0 || at.y < -0.3 {
            return Err(format!("{name}: {status:?} at {at}").into());
        }
    }
    Ok(())
}
