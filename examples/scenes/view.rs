//! The scenes on a screen, or rendered to a picture without one.

use std::path::{Path, PathBuf};

use bevy::{
    camera::RenderTarget,
    input::mouse::{AccumulatedMouseMotion, AccumulatedMouseScroll},
    light::GlobalAmbientLight,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
    render::{
        RenderPlugin,
        render_resource::TextureFormat,
        view::screenshot::{Screenshot, save_to_disk},
    },
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_medial::{
    medial_axis::{MedialAxis, triangulate},
    prelude::*,
    scenes::{Model, Monitor, Scene, SceneEntity, add_monitor, lift_speed_limits, set_budget},
};
use bevy_rapier3d::prelude::{RapierConfiguration, TimestepMode};

/// What the window shows, for starting again.
#[derive(Resource, Clone)]
pub struct Show {
    pub scene: &'static Scene,
    pub models: Vec<Model>,
    pub seed: u64,
    pub dt: f32,
    pub backend: MedialBackend,
    pub budget: MedialBudget,
}

/// Whether time runs, and for how many steps if not.
#[derive(Resource, Default)]
struct Clock {
    paused: bool,
    single_steps: u32,
}

#[derive(Component)]
struct StatusText;

/// Opens a window and runs until it is closed.
pub fn window(show: Show) {
    let title = format!("bevy_medial: {}", show.scene.name);
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins.set(WindowPlugin { primary_window: Some(Window { title, ..default() }), ..default() }),
    )
    .init_resource::<Clock>()
    .add_systems(Startup, spawn_status)
    .add_systems(Update, (control, orbit, update_status));
    add_scene(&mut app, show, RenderTarget::default());
    app.run();
}

/// Runs the scene for `steps` and writes what the camera then sees.
pub fn screenshot(show: Show, steps: u32, size: UVec2, file: &Path) -> Result<(), String> {
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
            .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
            .disable::<WinitPlugin>(),
    );
    let target = Image::new_target_texture(size.x, size.y, TextureFormat::Rgba8UnormSrgb, None);
    let target = app.world_mut().resource_mut::<Assets<Image>>().add(target);
    // Rendering every step would take most of the time: the camera stays off until the last ones.
    add_scene(&mut app, show, RenderTarget::Image(target.clone().into()));
    app.finish();
    app.cleanup();
    let set_camera = |app: &mut App, active: bool| {
        let mut cameras = app.world_mut().query::<&mut Camera>();
        cameras.iter_mut(app.world_mut()).for_each(|mut camera| camera.is_active = active);
    };
    app.update();
    set_camera(&mut app, false);
    for _ in 1..steps {
        app.update();
    }
    let mut configurations = app.world_mut().query::<&mut RapierConfiguration>();
    configurations.iter_mut(app.world_mut()).for_each(|mut rapier| rapier.physics_pipeline_active = false);
    set_camera(&mut app, true);
    let path = PathBuf::from(file);
    app.update();
    app.world_mut().spawn(Screenshot::image(target)).observe(save_to_disk(path.clone()));
    for _ in 0..20 {
        app.update();
        if path.exists() {
            return Ok(());
        }
    }
    Err(format!("{}: no picture came back from the renderer", path.display()))
}

fn add_scene(app: &mut App, show: Show, target: RenderTarget) {
    let ([eye, focus], budget) = (show.scene.view, show.budget);
    app.add_plugins(MedialPhysicsPlugin::default())
        .insert_resource(MedialSettings { backend: show.backend, ..default() })
        .insert_resource(TimestepMode::Fixed { dt: show.dt, substeps: 1 })
        .insert_resource(ClearColor(Color::srgb(0.72, 0.82, 0.92)))
        .insert_resource(GlobalAmbientLight { brightness: 350.0, ..default() })
        .insert_resource(show)
        .add_systems(Startup, start)
        .add_systems(Update, (dress_medial, dress_boxes));
    set_budget(app, budget);
    add_monitor(app);
    lift_speed_limits(app);
    app.world_mut().spawn((Camera3d::default(), target, Transform::from_translation(eye).looking_at(focus, Vec3::Y)));
    app.world_mut().spawn((
        DirectionalLight { shadow_maps_enabled: true, illuminance: 9000.0, ..default() },
        Transform::from_xyz(4.0, 9.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

fn start(world: &mut World) {
    let Show { scene, models, seed, .. } = world.resource::<Show>().clone();
    scene.spawn(world, &models, seed);
}

/// Gives new medial bodies the surface of their shape.
fn dress_medial(
    mut commands: Commands,
    bodies: Query<(Entity, &MedialMesh, Has<StaticObb>), (With<SceneEntity>, Without<Mesh3d>)>,
    axes: Res<Assets<MedialAxis>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (entity, medial, is_static) in &bodies {
        let Some(axis) = axes.get(&medial.0) else { continue };
        let surface = triangulate(axis.spheres(), axis.primitives(), 24);
        let mesh = Mesh::new(PrimitiveTopology::TriangleList, default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, surface.positions)
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, surface.normals)
            .with_inserted_indices(Indices::U32(surface.indices));
        // The golden angle keeps neighbours apart in hue.
        let color = match is_static {
            true => Color::srgb(0.55, 0.57, 0.6),
            false => Color::hsl((entity.index_u32() as f32 * 137.5) % 360.0, 0.55, 0.58),
        };
        let material = StandardMaterial { base_color: color, perceptual_roughness: 0.55, ..default() };
        commands.entity(entity).insert((Mesh3d(meshes.add(mesh)), MeshMaterial3d(materials.add(material))));
    }
}

/// Gives new static boxes their faces.
fn dress_boxes(
    mut commands: Commands,
    boxes: Query<(Entity, &StaticObb, &Name), (With<SceneEntity>, Without<Mesh3d>, Without<MedialMesh>)>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (entity, obb, name) in &boxes {
        if name.as_str() == "wall" {
            continue;
        }
        let shade = if name.as_str() == "ground" { 0.5 } else { 0.62 };
        let material = StandardMaterial {
            base_color: Color::srgb(shade, shade, shade * 0.95),
            perceptual_roughness: 0.9,
            ..default()
        };
        let mesh = meshes.add(Cuboid::from_size(obb.half_extents * 2.0));
        commands.entity(entity).insert((Mesh3d(mesh), MeshMaterial3d(materials.add(material))));
    }
}

fn spawn_status(mut commands: Commands) {
    let node = Node { position_type: PositionType::Absolute, top: px(8), left: px(8), ..default() };
    commands.spawn((StatusText, Text::default(), TextFont::from_font_size(14.0), node));
}

fn update_status(
    mut text: Single<&mut Text, With<StatusText>>,
    monitor: Res<Monitor>,
    step: Res<MedialStep>,
    clock: Res<Clock>,
) {
    let times = &step.output.times;
    let counts = &step.output.counts;
    text.0 = format!(
        "step {}{}\ncollision {:.2} ms\n{} body pairs, {} candidates, {} contacts\n\nspace  pause\nN      one step\nR      restart\ndrag   turn, wheel: zoom",
        monitor.rows.len(),
        if clock.paused { "  (paused)" } else { "" },
        times.total().as_secs_f64() * 1e3,
        counts.body_pairs,
        counts.candidates,
        counts.contacts,
    );
}

/// Space pauses, N makes one step, R starts again.
fn control(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    mut clock: ResMut<Clock>,
    mut monitor: ResMut<Monitor>,
    mut rapier: Query<&mut RapierConfiguration>,
    spawned: Query<Entity, With<SceneEntity>>,
) {
    if keys.just_pressed(KeyCode::Space) {
        clock.paused = !clock.paused;
    }
    if keys.just_pressed(KeyCode::KeyN) {
        clock.paused = true;
        clock.single_steps += 1;
    }
    if keys.just_pressed(KeyCode::KeyR) {
        spawned.iter().for_each(|entity| commands.entity(entity).despawn());
        *monitor = Monitor::default();
        commands.queue(start);
    }
    let active = !clock.paused || clock.single_steps > 0;
    clock.single_steps = clock.single_steps.saturating_sub(1);
    for mut rapier in &mut rapier {
        rapier.physics_pipeline_active = active;
    }
}

/// Turns the camera about what it looks at.
fn orbit(
    mut camera: Single<&mut Transform, With<Camera3d>>,
    show: Res<Show>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    scroll: Res<AccumulatedMouseScroll>,
) {
    let focus = show.scene.view[1];
    if buttons.pressed(MouseButton::Left) {
        let right = camera.right();
        camera.rotate_around(focus, Quat::from_rotation_y(-motion.delta.x * 0.006));
        camera.rotate_around(focus, Quat::from_axis_angle(*right, -motion.delta.y * 0.006));
    }
    let offset = camera.translation - focus;
    camera.translation = focus + offset * (1.0 - 0.1 * scroll.delta.y).clamp(0.5, 2.0);
}
