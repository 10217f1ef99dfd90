//! The view of a scene: camera, light, and the settings that are shown.

use std::path::PathBuf;

use bevy::{camera::RenderTarget, core_pipeline::tonemapping::DebandDither, light::GlobalAmbientLight, prelude::*};
use bevy_medial::{
    plugin::{MedialDebugPlugin, MedialGizmos, MedialPickingPlugin},
    prelude::*,
    scenes::{Model, Scene, SceneEntity, add_monitor, lift_speed_limits},
};
use bevy_panorbit_camera::{PanOrbitCamera, PanOrbitCameraPlugin};
use bevy_rapier3d::prelude::TimestepMode;

use crate::{common::dress::Dress, control, grab, overlay, panel};

/// The scene and its settings, kept for restarts.
#[derive(Resource, Clone)]
pub struct Show {
    pub scene: &'static Scene,
    pub models: Vec<Model>,
    pub seed: u64,
    pub dt: f32,
    pub backend: MedialBackend,
    /// Max error of bodies, in percent of their diagonal.
    pub budget_percent: f32,
    /// The level of detail of all bodies. If set, the budget is ignored.
    pub level: Option<usize>,
    /// Folder of the models.
    pub folder: PathBuf,
    /// True if pictures show the overlay.
    pub overlay: bool,
    /// Layers of the debug view that are on at the start.
    pub layers: Vec<String>,
}

/// Name of a layer of the debug view on the command line.
fn dashed(name: &str) -> String {
    name.replace(' ', "-")
}

/// Checks the name of a layer.
pub fn layer_name(text: &str) -> Result<String, String> {
    let mut layers = MedialGizmos::default();
    let mut names: Vec<String> = layers.layers_mut().iter().map(|(name, _)| dashed(name)).collect();
    names.push("levels".into());
    if names.iter().any(|name| name == text) { Ok(text.into()) } else { Err(format!("layers: {}", names.join(", "))) }
}

/// Opens a window and runs until it is closed.
pub fn window(show: Show) {
    let title = "bevy_medial".into();
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins.set(WindowPlugin { primary_window: Some(Window { title, ..default() }), ..default() }),
    )
    .add_plugins((PanOrbitCameraPlugin, MedialPickingPlugin, control::plugin, grab::plugin, panel::plugin))
    .add_plugins(overlay::plugin)
    .add_systems(Update, look_at_scene);
    add_scene(&mut app, show, RenderTarget::default());
    app.run();
}

/// Adds physics, the scene, a camera and light.
pub fn add_scene(app: &mut App, show: Show, target: RenderTarget) {
    let [eye, focus] = show.scene.view;
    let debug = MedialDebugPlugin { enabled: !show.layers.is_empty() };
    app.add_plugins((MedialPhysicsPlugins::default(), debug, Dress { models: show.folder.clone() }))
        .insert_resource(MedialSettings { backend: show.backend, ..default() })
        .insert_resource(TimestepMode::Fixed { dt: show.dt, substeps: 1 })
        .insert_resource(ClearColor(Color::srgb(0.72, 0.82, 0.92)))
        .insert_resource(GlobalAmbientLight { brightness: 350.0, ..default() })
        .insert_resource(show)
        .add_systems(Startup, (start, switch_layers))
        .add_systems(Update, keep_budget);
    add_monitor(app);
    lift_speed_limits(app);
    app.world_mut().spawn((
        Camera3d::default(),
        IsDefaultUiCamera,
        // The noise of dithering makes large picture files.
        DebandDither::Disabled,
        target,
        Transform::from_translation(eye).looking_at(focus, Vec3::Y),
    ));
    app.world_mut().spawn((
        DirectionalLight { shadow_maps_enabled: true, illuminance: 9000.0, ..default() },
        Transform::from_xyz(4.0, 9.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

/// Spawns the scene.
pub fn start(world: &mut World) {
    let Show { scene, models, seed, .. } = world.resource::<Show>().clone();
    scene.spawn(world, &models, seed);
}

/// Enables the requested layers of the debug view.
fn switch_layers(show: Res<Show>, mut store: ResMut<GizmoConfigStore>) {
    let (group, layers) = store.config_mut::<MedialGizmos>();
    // Lines are drawn in front of the surface on which they lie.
    group.depth_bias = -0.002;
    group.line.width = 1.5;
    if show.layers.is_empty() {
        return;
    }
    layers.color_by_level = show.layers.iter().any(|name| name == "levels");
    for (name, layer) in layers.layers_mut() {
        layer.enabled = show.layers.contains(&dashed(name));
    }
}

/// Gives bodies the budget of the show, or the budget that selects its level.
fn keep_budget(
    mut commands: Commands,
    show: Res<Show>,
    bodies: Query<(Entity, &MedialMesh, &Transform, Option<&MedialBudget>), With<SceneEntity>>,
    axes: Res<Assets<MedialAxis>>,
) {
    for (entity, mesh, transform, own) in &bodies {
        let budget = match show.level.zip(axes.get(&mesh.0)) {
            Some((level, axis)) => budget_of_level(axis, level, transform.scale.x),
            None => MedialBudget::Percent(show.budget_percent),
        };
        if own != Some(&budget) {
            commands.entity(entity).try_insert(budget);
        }
    }
}

/// The budget that selects a level of detail, or the coarsest level if there are fewer levels.
pub fn budget_of_level(axis: &MedialAxis, level: usize, scale: f32) -> MedialBudget {
    /// Covers the rounding error of a division by the scale.
    const ROUNDING: f32 = 1.0 + 1e-5;
    let levels = axis.coarser();
    let error = level.min(levels.len()).checked_sub(1).map_or(0.0, |at| levels[at].1);
    MedialBudget::Metres(error * scale * ROUNDING)
}

/// Moves the camera to the view of the scene when the scene changes.
fn look_at_scene(
    mut commands: Commands,
    show: Res<Show>,
    camera: Single<Entity, With<Camera3d>>,
    mut shown: Local<Option<&'static str>>,
) {
    if shown.replace(show.scene.name) == Some(show.scene.name) {
        return;
    }
    let [eye, focus] = show.scene.view;
    let place = Transform::from_translation(eye).looking_at(focus, Vec3::Y);
    commands.entity(*camera).insert((place, PanOrbitCamera { focus, target_focus: focus, ..default() }));
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use bevy_medial::scenes::load_models;

    use super::*;

    #[test]
    fn the_budget_of_a_level_is_that_of_no_other() {
        let models = load_models(&Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models")).unwrap();
        for Model { axis, name } in &models {
            let coarsest = axis.coarser().len();
            for level in 0..=coarsest + 1 {
                for scale in [0.3, 1.0, 7.7] {
                    let budget = budget_of_level(axis, level, scale);
                    assert_eq!(budget.level(axis, scale), level.min(coarsest), "{name}, level {level}, scale {scale}");
                }
            }
        }
        assert!(models.iter().any(|model| model.axis.coarser().len() > 2));
    }
}
