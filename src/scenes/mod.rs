//! The demo scenes. The example shows them, tests check them, benchmarks measure them.
//!
//! [`SCENES`] lists them. [`Scene::spawn`] spawns their entities, and [`Monitor`] records each step. [`headless_app`] creates an app without a display.

pub mod characters;
mod models;
mod monitor;

use std::{
    f32::consts::{FRAC_PI_2, FRAC_PI_6},
    time::Duration,
};

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_rapier3d::{
    plugin::context::{DefaultRapierContext, RapierContextSimulation, RapierRigidBodySet},
    prelude::{Damping, PhysicsSet, RapierRigidBodyHandle, RigidBody, TimestepMode, Velocity},
};

use crate::{
    MedialPhysicsPlugins,
    medial_axis::MedialAxis,
    plugin::{MedialBudget, MedialMesh, MedialSystems, StaticObb},
    random::Random,
};

pub use models::{Model, ModelError, load_models};
pub use monitor::{Monitor, Row, StageSummary, Summary, add_monitor};

/// A scene.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Its name on the command line.
    pub name: &'static str,
    /// Description in one sentence.
    pub about: &'static str,
    /// Number of steps that show the main event of the scene.
    pub steps: u32,
    /// Position of the camera, and the point that it looks at.
    pub view: [Vec3; 2],
    build: fn(&mut Builder),
}

/// All scenes.
pub const SCENES: &[Scene] = &[
    Scene {
        name: "rods",
        about: "nine different models fall over a few thin rods",
        steps: 600,
        view: [Vec3::new(2.9, 2.4, 4.3), Vec3::new(0.0, 0.95, 0.0)],
        build: rods,
    },
    Scene {
        name: "dinosaur",
        about: "a dinosaur flies into a group of bodies at 100 m/s",
        steps: 120,
        view: [Vec3::new(1.5, 3.2, 8.0), Vec3::new(3.0, 1.6, 0.0)],
        build: dinosaur,
    },
    Scene {
        name: "tori",
        about: "51 tori fall to the ground",
        steps: 600,
        view: [Vec3::new(2.8, 2.6, 4.4), Vec3::new(0.0, 0.5, 0.0)],
        build: tori,
    },
    Scene {
        name: "stairs",
        about: "bodies tumble down stairs",
        steps: 600,
        view: [Vec3::new(5.0, 3.6, 5.6), Vec3::new(0.0, 1.1, 0.0)],
        build: stairs,
    },
    Scene {
        name: "bullets",
        about: "bodies are shot at a thin plate, at resting bodies and at each other, at 10 to 1000 m/s",
        steps: 240,
        view: [Vec3::new(-5.5, 4.5, 9.5), Vec3::new(0.5, 1.3, 0.0)],
        build: bullets,
    },
    Scene {
        name: "pile",
        about: "200 animals fall into a bin",
        steps: 240,
        view: [Vec3::new(4.5, 5.4, 7.2), Vec3::new(0.0, 1.5, 0.0)],
        build: pile,
    },
    Scene {
        name: "chain_mail",
        about: "a ball flies into a sheet of 10 x 10 linked rings that hangs at two corners",
        steps: 240,
        view: [Vec3::new(2.6, 2.9, 3.4), Vec3::new(0.0, 1.7, 0.0)],
        build: chain_mail,
    },
];

impl Scene {
    /// Returns the scene with this name.
    pub fn by_name(name: &str) -> Option<&'static Scene> {
        SCENES.iter().find(|scene| scene.name == name)
    }

    /// Spawns the scene's entities, each with a [`SceneEntity`]. The same seed gives the same scene.
    pub fn spawn(&self, world: &mut World, models: &[Model], seed: u64) {
        (self.build)(&mut Builder { world, models, random: Random(seed) });
    }
}

/// Marks the entities of a scene.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct SceneEntity;

/// Marks the fast body of the scene `dinosaur`.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct Projectile;

/// Marks a body of the scene `bullets`. Rapier would limit it to 400 m/s and an eighth of a turn per step. See [`lift_speed_limits`].
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct Bullet;

/// Distance from the origin in metres beyond which a body has escaped.
pub const WORLD_RADIUS: f32 = 40.0;

/// Creates an app that runs medial physics with rapier and nothing else, with one step of `dt` seconds per update.
pub fn headless_app(dt: f32) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        bevy::asset::AssetPlugin::default(),
        TransformPlugin,
        bevy::diagnostic::DiagnosticsPlugin,
        MedialPhysicsPlugins::default(),
    ))
    .insert_resource(TimestepMode::Fixed { dt, substeps: 1 })
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(dt)));
    add_monitor(&mut app);
    lift_speed_limits(&mut app);
    app.finish();
    app.cleanup();
    app
}

/// Sets the budget of all bodies that scenes spawn in an app after this call.
pub fn set_budget(app: &mut App, budget: MedialBudget) {
    app.add_observer(
        move |added: On<Add, SceneEntity>, bodies: Query<(), With<MedialMesh>>, mut commands: Commands| {
            if bodies.contains(added.entity) {
                commands.entity(added.entity).insert(budget);
            }
        },
    );
}

/// Removes rapier's speed limits from every [`Bullet`] of an app.
pub fn lift_speed_limits(app: &mut App) {
    app.add_systems(PostUpdate, lift_limits.after(PhysicsSet::SyncBackend).before(MedialSystems::Snapshot));
}

fn lift_limits(
    bullets: Query<&RapierRigidBodyHandle, (With<Bullet>, Added<RapierRigidBodyHandle>)>,
    context: Single<(&mut RapierContextSimulation, &mut RapierRigidBodySet), With<DefaultRapierContext>>,
) {
    let (mut simulation, mut set) = context.into_inner();
    for handle in &bullets {
        simulation.integration_parameters.normalized_max_linear_velocity = f32::MAX;
        if let Some(body) = set.bodies.get_mut(handle.0) {
            body.set_allow_fast_rotation(true);
        }
    }
}

/// A random rotation, uniformly distributed.
fn rotation(random: &mut Random) -> Quat {
    loop {
        let (v, w) = (random.in_cube(), random.signed());
        let length_squared = v.length_squared() + w * w;
        if (0.01..1.0).contains(&length_squared) {
            return Quat::from_xyzw(v.x, v.y, v.z, w).normalize();
        }
    }
}

/// Spawns the parts of scenes.
struct Builder<'a> {
    world: &'a mut World,
    models: &'a [Model],
    random: Random,
}

impl Builder<'_> {
    fn add(&mut self, axis: MedialAxis) -> MedialMesh {
        MedialMesh(self.world.resource_mut::<Assets<MedialAxis>>().add(axis))
    }

    fn fixed_box(&mut self, name: &'static str, center: Vec3, half: Vec3) {
        let obb = StaticObb { half_extents: half };
        self.world.spawn((SceneEntity, Name::new(name), obb, Transform::from_translation(center)));
    }

    fn ground(&mut self) {
        self.fixed_box("ground", Vec3::new(0.0, -1.0, 0.0), Vec3::new(20.0, 1.0, 20.0));
    }

    /// A static rod, one medial cone, 3 m long.
    fn rod(&mut self, center: Vec3, direction: Vec3) {
        let half = direction.normalize() * 1.5;
        // The points and the radius are always valid.
        let Ok(axis) = MedialAxis::capsule(-half, half, 0.03) else { return };
        let mesh = self.add(axis);
        self.world.spawn((
            SceneEntity,
            Name::new("rod"),
            mesh,
            StaticObb::default(),
            RigidBody::Fixed,
            Transform::from_translation(center),
        ));
    }

    /// A body of the given model, scaled to fit a ball with a diameter of `size` metres, so that any rotation is possible.
    fn body(&mut self, model: usize, size: f32, center: Vec3, velocity: Velocity) -> Entity {
        let model = &self.models[model % self.models.len()];
        self.body_of(model.name.clone(), model.axis.clone(), size, center, velocity)
    }

    /// The same for a shape that is not a model.
    fn body_of(&mut self, name: String, axis: MedialAxis, size: f32, center: Vec3, velocity: Velocity) -> Entity {
        let bound = axis.bounding_sphere();
        let scale = 0.5 * size / bound.radius;
        let rotation = rotation(&mut self.random);
        let mesh = self.add(axis);
        let center = center - rotation * bound.center * scale;
        let transform = Transform::from_translation(center).with_rotation(rotation).with_scale(Vec3::splat(scale));
        // Damping stands in for rolling friction, which rapier lacks.
        let damping = Damping { linear_damping: 0.1, angular_damping: 1.0 };
        self.world.spawn((SceneEntity, Name::new(name), RigidBody::Dynamic, mesh, transform, velocity, damping)).id()
    }

    /// A bullet within 10 cm of a position along each axis: a rod for every third number, otherwise a model.
    fn bullet(&mut self, number: usize, center: Vec3, speed: f32) {
        let center = center + self.random.in_cube() * 0.1;
        let angular = if speed == 0.0 { Vec3::ZERO } else { self.random.in_cube() * 50.0 };
        let velocity = Velocity { linear: Vec3::X * speed, angular };
        let entity = match MedialAxis::capsule(Vec3::X * -0.5, Vec3::X * 0.5, 0.02) {
            Ok(rod) if number.is_multiple_of(3) => self.body_of("rod".into(), rod, 1.0, center, velocity),
            _ => self.body(number, 0.9, center, velocity),
        };
        self.world.entity_mut(entity).insert(Bullet);
    }

    fn model_named(&self, part: &str) -> Option<usize> {
        self.models.iter().position(|model| model.name.contains(part))
    }
}

fn rods(builder: &mut Builder) {
    builder.ground();
    for i in 0..4 {
        let x = i as f32 - 1.5;
        builder.rod(Vec3::new(x * 0.75, 1.0 + 0.1 * x, 0.0), Vec3::new(0.1 * x, 0.05, 1.0));
    }
    builder.rod(Vec3::new(0.0, 1.6, 0.6), Vec3::new(1.0, 0.05, 0.1));
    for i in 0..9 {
        let place = Vec3::new((i % 3) as f32 * 1.4 - 1.4, 2.8 + (i / 3) as f32 * 1.5, (i / 3) as f32 * 0.3 - 0.3);
        let center = place + builder.random.in_cube() * 0.1;
        builder.body(i, 1.15, center, Velocity::zero());
    }
}

fn dinosaur(builder: &mut Builder) {
    builder.ground();
    for side in [-1.0, 1.0] {
        builder.fixed_box("wall", Vec3::new(side * 20.0, 10.0, 0.0), Vec3::new(0.5, 10.0, 20.0));
        builder.fixed_box("wall", Vec3::new(0.0, 10.0, side * 20.0), Vec3::new(20.0, 10.0, 0.5));
    }
    let dinosaur = builder.model_named("dinosaur").unwrap_or(0);
    let mut others: Vec<usize> = (0..builder.models.len()).filter(|&i| i != dinosaur).collect();
    if others.is_empty() {
        others.push(dinosaur);
    }
    let mut number = 0;
    for x in 0..3 {
        for y in 0..3 {
            for z in 0..3 {
                let place = Vec3::new(x as f32, y as f32, z as f32) * 1.25 + Vec3::new(2.4, 0.9, -1.25);
                let center = place + builder.random.in_cube() * 0.05;
                builder.body(others[number % others.len()], 1.0, center, Velocity::zero());
                number += 1;
            }
        }
    }
    let aim = Vec3::new(0.3, 2.15, 0.0) + builder.random.in_cube() * Vec3::new(0.0, 0.6, 0.6);
    let spin = builder.random.in_cube() * 5.0;
    let velocity = Velocity { linear: Vec3::X * 100.0, angular: spin };
    let entity = builder.body(dinosaur, 1.5, aim, velocity);
    builder.world.entity_mut(entity).insert(Projectile);
}

fn bullets(builder: &mut Builder) {
    builder.ground();
    for side in [-1.0, 1.0] {
        builder.fixed_box("wall", Vec3::new(side * 20.0, 10.0, 0.0), Vec3::new(0.5, 10.0, 20.0));
        builder.fixed_box("wall", Vec3::new(0.0, 10.0, side * 20.0), Vec3::new(20.0, 10.0, 0.5));
    }
    builder.fixed_box("wall", Vec3::new(0.0, 20.0, 0.0), Vec3::new(20.0, 0.5, 20.0));
    // 5 cm thick.
    builder.fixed_box("plate", Vec3::new(4.0, 1.5, -2.4), Vec3::new(0.025, 1.5, 2.4));
    for (lane, speed) in [10.0, 50.0, 100.0, 300.0, 1000.0].into_iter().enumerate() {
        let z = 0.95 * lane as f32;
        builder.bullet(lane, Vec3::new(-5.0, 1.6, z - 4.3), speed);
        // Bullets against resting bodies. In the two fastest lanes, two bullets meet head-on.
        let (place, other) = if speed > 200.0 { (9.0, -speed) } else { (2.0, 0.0) };
        builder.bullet(lane + 1, Vec3::new(-5.0, 1.1, z + 0.8), speed);
        builder.bullet(lane + 1, Vec3::new(place, 1.1, z + 0.8), other);
    }
}

fn tori(builder: &mut Builder) {
    builder.ground();
    let torus = builder.model_named("torus").unwrap_or(0);
    for i in 0..51 {
        let (layer, rest) = (i / 9, i % 9);
        let place = Vec3::new((rest % 3) as f32 - 1.0, 0.6 + layer as f32 * 0.8, (rest / 3) as f32 - 1.0);
        let center = place * Vec3::new(0.95, 1.0, 0.95) + builder.random.in_cube() * 0.1;
        builder.body(torus, 0.6, center, Velocity::zero());
    }
}

/// Eight layers of 5 x 5 animals of one metre, 1.1 m apart, above a bin that is 5.5 m wide.
fn pile(builder: &mut Builder) {
    const HALF: f32 = 2.75;
    builder.ground();
    for side in [-1.0, 1.0] {
        let middle = side * (HALF + 0.25);
        builder.fixed_box("bin", Vec3::new(middle, 5.0, 0.0), Vec3::new(0.25, 5.0, HALF + 0.5));
        builder.fixed_box("bin", Vec3::new(0.0, 5.0, middle), Vec3::new(HALF, 5.0, 0.25));
    }
    for i in 0..200 {
        let (layer, rest) = (i / 25, i % 25);
        let place = Vec3::new((rest % 5) as f32 - 2.0, layer as f32, (rest / 5) as f32 - 2.0);
        let center = place * 1.1 + Vec3::Y * 0.6 + builder.random.in_cube() * 0.04;
        builder.body(i, 1.0, center, Velocity::zero());
    }
}

fn stairs(builder: &mut Builder) {
    builder.ground();
    for i in 0..8 {
        let height = 0.35 * (8 - i) as f32;
        let center = Vec3::new(i as f32 * 0.6 - 2.4, 0.5 * height, 0.0);
        builder.fixed_box("stair", center, Vec3::new(0.3, 0.5 * height, 2.5));
    }
    for side in [-1.0, 1.0] {
        builder.fixed_box("wall", Vec3::new(0.0, 2.0, side * 2.6), Vec3::new(6.0, 2.0, 0.1));
    }
    let kinds = [builder.model_named("deer"), builder.model_named("cow")];
    let kinds = kinds.map(|kind| kind.unwrap_or(0));
    for i in 0..12 {
        let place = Vec3::new(-2.4 + 0.3 * (i % 2) as f32, 3.8 + 1.3 * (i / 3) as f32, (i % 3) as f32 * 1.3 - 1.3);
        let center = place + builder.random.in_cube() * 0.1;
        let velocity = Velocity { linear: Vec3::new(1.5, 0.0, 0.0), angular: Vec3::ZERO };
        builder.body(if kinds[0] == kinds[1] { i } else { kinds[i % 2] }, 1.1, center, velocity);
    }
}

/// Each ring of the sheet is linked with four others, two in the row above and two in the row below. Rows are tilted to alternate sides.
fn chain_mail(builder: &mut Builder) {
    const RADIUS: f32 = 0.15;
    const ROWS: usize = 10;
    builder.ground();
    // The radii are always valid.
    let Ok(axis) = MedialAxis::torus(RADIUS, 0.15 * RADIUS, 16) else { return };
    let mesh = builder.add(axis);
    for row in 0..ROWS {
        let side = if row.is_multiple_of(2) { 1.0 } else { -1.0 };
        for column in 0..ROWS {
            let place = Vec3::new(2.5 * (column as f32 + 0.25 * side - 4.5), -0.7 * row as f32, 0.0);
            let transform = Transform::from_translation(place * RADIUS + Vec3::Y * 2.8)
                .with_rotation(Quat::from_rotation_x(FRAC_PI_2 - side * FRAC_PI_6));
            let is_corner = row == 0 && (column == 0 || column == ROWS - 1);
            let body = if is_corner { RigidBody::Fixed } else { RigidBody::Dynamic };
            let damping = Damping { linear_damping: 0.1, angular_damping: 1.0 };
            builder.world.spawn((SceneEntity, Name::new("ring"), body, mesh.clone(), transform, damping));
        }
    }
    let Ok(ball) = MedialAxis::sphere(0.25) else { return };
    let center = Vec3::new(0.0, 1.6, -4.0) + builder.random.in_cube() * 0.2;
    builder.body_of("ball".into(), ball, 0.5, center, Velocity { linear: Vec3::Z * 10.0, angular: Vec3::ZERO });
}
