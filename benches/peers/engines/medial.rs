//! Medial meshes, with rapier for the response.
//!
//! The step is that of the plugin, between rapier's taking over of components and its writing back: snapshot, rapier's step, the
//! pipeline and what follows from it. Collision is the pipeline, and what rapier spends on collision detection in its own step.

use std::time::{Duration, Instant};

use bevy::{ecs::schedule::SingleThreadedExecutor, prelude::*};
use bevy_medial::{
    geometry::Pose3,
    plugin::{MedialStep, MedialSystems},
    prelude::MedialBudget,
    scenes::{Model, Scene, SceneEntity, headless_app, set_budget},
};
use bevy_rapier3d::{
    plugin::context::{RapierContextSimulation, RapierRigidBodySet},
    prelude::{PhysicsSet, RapierRigidBodyHandle},
};

use super::{Engine, StepTimes};
use crate::world::{SEED, State, World};

#[derive(Resource)]
struct Clock {
    begin: Instant,
    whole: Duration,
}

/// The plugin in an app without a window.
pub struct Medial {
    app: App,
    /// Of the bodies, with where they start.
    entities: Vec<(Entity, Pose3)>,
}

impl Medial {
    /// The scene that the world was read from.
    pub fn new(world: &World, scene: &Scene, models: &[Model], budget: MedialBudget) -> Self {
        let mut app = headless_app(world.dt);
        set_budget(&mut app, budget);
        app.edit_schedule(PostUpdate, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
        app.insert_resource(Clock { begin: Instant::now(), whole: Duration::ZERO }).add_systems(
            PostUpdate,
            (
                begin.after(PhysicsSet::SyncBackend).before(MedialSystems::Snapshot),
                end.after(MedialSystems::Detect).before(PhysicsSet::Writeback),
            ),
        );
        scene.spawn(app.world_mut(), models, SEED);
        let mut query = app.world_mut().query_filtered::<(Entity, &Transform), With<SceneEntity>>();
        // No two bodies start at one place.
        let entity_at = |pose: Pose3| {
            let found = query.iter(app.world()).find(|(_, transform)| transform.translation == pose.translation);
            (found.map_or(Entity::PLACEHOLDER, |(entity, _)| entity), pose)
        };
        let entities = world.bodies.iter().map(|body| body.pose).map(entity_at).collect();
        Self { app, entities }
    }
}

fn begin(mut clock: ResMut<Clock>) {
    clock.begin = Instant::now();
}

fn end(mut clock: ResMut<Clock>) {
    clock.whole = clock.begin.elapsed();
}

impl Engine for Medial {
    fn step(&mut self) -> StepTimes {
        self.app.update();
        let world = self.app.world_mut();
        let mut simulation = world.query::<&RapierContextSimulation>();
        let counters = simulation.iter(world).map(|simulation| simulation.pipeline.counters);
        let rapier: Duration = counters.map(|counters| counters.stages.collision_detection_time.time()).sum();
        let output = &world.resource::<MedialStep>().output;
        StepTimes {
            collision: output.times.total() + rapier,
            whole: world.resource::<Clock>().whole,
            contact_pairs: output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count(),
        }
    }

    fn states(&self) -> Vec<State> {
        let app = self.app.world();
        let set = app.try_query::<&RapierRigidBodySet>().and_then(|mut query| query.iter(app).next());
        let state = |(entity, start): &(Entity, Pose3)| {
            let handle = app.get::<RapierRigidBodyHandle>(*entity);
            match handle.and_then(|handle| set?.bodies.get(handle.0)) {
                Some(rigid) => State { pose: *rigid.position(), linear: rigid.linvel(), angular: rigid.angvel() },
                // A box has no rigid body.
                None => State { pose: *start, linear: Vec3::ZERO, angular: Vec3::ZERO },
            }
        };
        self.entities.iter().map(state).collect()
    }
}
