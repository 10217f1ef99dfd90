//! Shared helpers: they create apps and bodies, and read back their state.

use std::{
    path::{Path, PathBuf},
    sync::{LazyLock, OnceLock},
    time::Duration,
};

use bevy::{
    app::Plugins,
    asset::{AssetPlugin, LoadState},
    ecs::message::MessageCursor,
    prelude::*,
    time::TimeUpdateStrategy,
};
pub use bevy_medial::random::Random;
use bevy_medial::{
    medial_axis::MedialAxis,
    prelude::*,
    scenes::{Model, headless_app, load_models},
};
use bevy_rapier3d::{
    plugin::context::{RapierContextEntityLink, RapierContextSimulation, RapierRigidBodySet},
    prelude::{RapierRigidBodyHandle, RigidBody, TimestepMode, Velocity},
    rapier::dynamics::{RigidBody as RapierBody, SpringCoefficients},
};

/// Length of a step in seconds.
pub const DT: f32 = 1.0 / 60.0;

/// Speeds below these count as rest, in metres and radians per second.
pub const STILL: f32 = 1e-3;

/// An app that runs one step per update.
pub fn app() -> App {
    headless_app(DT)
}

/// The crate's own assets.
pub fn assets() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets")
}

/// An app with the given physics plugins and asset folder, in steps of [`DT`].
pub fn app_with<M>(physics: impl Plugins<M>, assets: &Path) -> App {
    let mut app = app_without_steps(physics, assets);
    app.insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)));
    app
}

/// [`app_with`] with the plugins' own mode of time.
pub fn app_without_steps<M>(physics: impl Plugins<M>, assets: &Path) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin { file_path: assets.to_string_lossy().into_owned(), ..default() },
        TransformPlugin,
        bevy::diagnostic::DiagnosticsPlugin,
        physics,
    ));
    app.finish();
    app.cleanup();
    app
}

/// The crate's models.
pub fn models() -> &'static [Model] {
    static MODELS: OnceLock<Vec<Model>> = OnceLock::new();
    MODELS.get_or_init(|| load_models(&assets().join("models")).unwrap())
}

/// The model with this name at a single level of about a hundred spheres.
pub fn model(name: &str) -> MedialAxis {
    let axis = &models().iter().find(|model| model.name == name).unwrap().axis;
    let error = 0.006 * 2.0 * axis.aabb().half_extents().length();
    axis.level(axis.level_within(error)).clone()
}

pub fn run(app: &mut App, steps: u32) {
    for _ in 0..steps {
        app.update();
    }
}

/// Updates the app until the asset server has loaded or refused the file. The limit is a number of updates, not a time.
pub fn wait(app: &mut App, mesh: &MedialMesh) -> LoadState {
    for _ in 0..10_000 {
        app.update();
        let state = app.world().resource::<AssetServer>().load_state(&mesh.0);
        if matches!(state, LoadState::Loaded | LoadState::Failed(_)) {
            app.update();
            return state;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("the file is neither loaded nor refused");
}

pub fn mesh(app: &mut App, axis: MedialAxis) -> MedialMesh {
    MedialMesh(app.world_mut().resource_mut::<Assets<MedialAxis>>().add(axis))
}

/// A ball with a radius of 0.2 m.
pub fn ball() -> MedialAxis {
    MedialAxis::sphere(0.2).unwrap()
}

/// A plate of 0.6 m x 0.2 m x 0.6 m with round edges.
pub fn plate() -> MedialAxis {
    static PLATE: LazyLock<MedialAxis> =
        LazyLock::new(|| MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.1).unwrap());
    PLATE.clone()
}

/// A dynamic body.
pub fn spawn_body(app: &mut App, axis: MedialAxis, transform: Transform) -> Entity {
    let mesh = mesh(app, axis);
    app.world_mut().spawn((RigidBody::Dynamic, mesh, transform)).id()
}

/// A dynamic body without gravity and damping.
pub fn spawn_flying(app: &mut App, axis: MedialAxis, transform: Transform, velocity: Velocity) -> Entity {
    let body = spawn_body(app, axis, transform);
    app.world_mut().entity_mut(body).insert((velocity, bevy_rapier3d::prelude::GravityScale(0.0)));
    body
}

/// A ground whose top is at height 0.
pub fn spawn_ground(app: &mut App) -> Entity {
    app.world_mut().spawn((StaticObb::new(10.0, 1.0, 10.0), Transform::from_xyz(0.0, -1.0, 0.0))).id()
}

/// The softness of contacts between moving bodies.
pub fn contact_softness(app: &mut App) -> Mut<'_, SpringCoefficients<f32>> {
    let mut contexts = app.world_mut().query::<&mut RapierContextSimulation>();
    let simulation = contexts.single_mut(app.world_mut()).unwrap();
    simulation.map_unchanged(|simulation| &mut simulation.integration_parameters.contact_softness)
}

/// The current rapier body of an entity.
pub fn rigid(app: &mut App, entity: Entity) -> RapierBody {
    let world = app.world();
    let handle = world.get::<RapierRigidBodyHandle>(entity).expect("a rigid body").0;
    let context = world.get::<RapierContextEntityLink>(entity).expect("a context").0;
    world.get::<RapierRigidBodySet>(context).unwrap().bodies[handle].clone()
}

pub fn position(app: &mut App, entity: Entity) -> Vec3 {
    rigid(app, entity).translation()
}

/// True if the body neither moves nor turns, and rapier has put it to sleep.
pub fn is_at_rest(app: &mut App, entity: Entity) -> bool {
    let body = rigid(app, entity);
    body.is_sleeping() && body.linvel().length() < STILL && body.angvel().length() < STILL
}

/// Messages, each with the number of its step.
#[derive(Default)]
pub struct Record {
    pub started: Vec<(u32, MedialContactStarted)>,
    pub ended: Vec<(u32, MedialContactEnded)>,
    cursors: (MessageCursor<MedialContactStarted>, MessageCursor<MedialContactEnded>),
    steps: u32,
}

impl Record {
    /// Runs steps and records their messages.
    pub fn run(&mut self, app: &mut App, steps: u32) {
        for _ in 0..steps {
            app.update();
            self.steps += 1;
            let world = app.world();
            let started = self.cursors.0.read(world.resource::<Messages<MedialContactStarted>>());
            self.started.extend(started.map(|message| (self.steps, *message)));
            let ended = self.cursors.1.read(world.resource::<Messages<MedialContactEnded>>());
            self.ended.extend(ended.map(|message| (self.steps, *message)));
        }
    }

    /// Numbers of start and end messages of the pair, in either order.
    pub fn counts(&self, one: Entity, other: Entity) -> [usize; 2] {
        let are = |a: Entity, b: Entity| (a, b) == (one, other) || (a, b) == (other, one);
        let started = self.started.iter().filter(|(_, m)| are(m.entity1, m.entity2)).count();
        let ended = self.ended.iter().filter(|(_, m)| are(m.entity1, m.entity2)).count();
        [started, ended]
    }
}
