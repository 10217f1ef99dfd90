//! This crate's plugin, in an app without a window.
//!
//! Systems run on one thread. The time of a step is that of the plugin, between rapier's reading of components and its writing back: snapshot, rapier's
//! step, pipeline and response. The time of collision is that of the pipeline plus the collision detection in rapier's own step.

use std::time::Duration;

use bevy::{ecs::schedule::SingleThreadedExecutor, prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{
    geometry::Pose3,
    medial_axis::MedialAxis,
    prelude::*,
    scenes::{Bullet, headless_app},
};
use bevy_rapier3d::{
    plugin::context::{RapierContextSimulation, RapierRigidBodySet},
    prelude::{
        CoefficientCombineRule, Collider, ColliderMassProperties, Damping, Friction, PhysicsSet, RapierConfiguration,
        RapierRigidBodyHandle, RigidBody, TimestepMode, Velocity,
    },
};

use super::{Clock, Engine, StepTimes, alternating};
use crate::{
    body::{Body, Form, Kind, Setup, State},
    renderer::rendering_app,
};

/// The back end of culling, or another search for impacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    Cpu,
    /// The GPU culls for later steps.
    Gpu,
    Alternating,
}

/// The plugin in a separate app.
pub struct Medial {
    app: App,
    entities: Vec<Entity>,
    dt: f32,
    budget: MedialBudget,
}

impl Medial {
    /// An empty world.
    pub fn new(setup: Setup, variant: Variant) -> Self {
        let on_gpu = variant == Variant::Gpu;
        let mut app = if on_gpu { rendering_app(setup.dt) } else { headless_app(setup.dt) };
        set_dt(&mut app, setup.dt);
        app.insert_resource(MedialSettings {
            backend: if on_gpu { MedialBackend::Gpu } else { MedialBackend::Cpu },
            pipelined: on_gpu,
            stop_at_impact: variant != Variant::Alternating,
            ..default()
        });
        app.edit_schedule(PostUpdate, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
        app.insert_resource(Clock::default()).add_systems(
            PostUpdate,
            (
                (calm_bullets, Clock::begin).chain().after(PhysicsSet::SyncBackend).before(MedialSystems::Snapshot),
                Clock::end.after(MedialSystems::Detect).before(PhysicsSet::Writeback),
            ),
        );
        if variant == Variant::Alternating {
            alternating::add(&mut app);
        }
        // The first update creates the context of rapier.
        app.update();
        let world = app.world_mut();
        let mut contexts = world.query::<(&mut RapierContextSimulation, &mut RapierConfiguration)>();
        for (mut simulation, mut configuration) in contexts.iter_mut(world) {
            simulation.integration_parameters.length_unit = setup.unit;
            configuration.gravity = Vec3::Y * -setup.gravity;
        }
        Self { app, entities: Vec::new(), dt: setup.dt, budget: MedialBudget::default() }
    }

    /// The same, with this error budget for bodies.
    pub fn with_budget(self, budget: MedialBudget) -> Self {
        Self { budget, ..self }
    }
}

/// Switches rapier's gyroscopic term off for bullets. It is explicit in time, and adds energy to a fast spin in free flight.
fn calm_bullets(
    bullets: Query<&RapierRigidBodyHandle, (With<Bullet>, Added<RapierRigidBodyHandle>)>,
    mut set: Single<&mut RapierRigidBodySet>,
) {
    for handle in &bullets {
        if let Some(body) = set.bodies.get_mut(handle.0) {
            body.enable_gyroscopic_forces(false);
        }
    }
}

fn set_dt(app: &mut App, dt: f32) {
    app.insert_resource(TimestepMode::Fixed { dt, substeps: 1 })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(dt)));
}

fn transform(body: &Body) -> Transform {
    Transform { translation: body.pose.translation, rotation: body.pose.rotation, scale: Vec3::splat(body.scale) }
}

impl Engine for Medial {
    fn spawn(&mut self, body: &Body) -> Result<(), String> {
        let world = self.app.world_mut();
        let axis = match &body.form {
            Form::Medial(axis) => Some(axis.clone()),
            form if body.kind != Kind::Fixed => form.axis(),
            _ => None,
        };
        let mesh = axis.map(|axis| MedialMesh(world.resource_mut::<Assets<MedialAxis>>().add(axis)));
        let mut entity = world.spawn(transform(body));
        match (&body.form, mesh) {
            (_, Some(mesh)) => _ = entity.insert((mesh, self.budget)),
            (Form::Triangles(positions, indices), None) => {
                let collider = Collider::trimesh(positions.clone(), indices.clone());
                entity.insert((RigidBody::Fixed, collider.map_err(|error| error.to_string())?));
            }
            (Form::Cuboid(half), None) => _ = entity.insert(StaticObb { half_extents: *half }),
            (Form::Medial(_), None) => {}
        }
        let velocity = Velocity { linear: body.linear, angular: body.angular };
        let mass = ColliderMassProperties::Density(body.density);
        match (body.kind, &body.form) {
            (Kind::Fixed, Form::Medial(_)) => _ = entity.insert((RigidBody::Fixed, StaticObb::default())),
            (Kind::Fixed, _) => {}
            (Kind::Kinematic, _) => _ = entity.insert((RigidBody::KinematicVelocityBased, velocity)),
            (Kind::Dynamic, _) => {
                let [linear_damping, angular_damping] = body.damping;
                let damping = Damping { linear_damping, angular_damping };
                entity.insert((RigidBody::Dynamic, velocity, mass, damping));
            }
        }
        if body.slippery {
            entity.insert(Friction { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min });
        }
        if body.fast {
            entity.insert(Bullet);
        }
        self.entities.push(entity.id());
        Ok(())
    }

    fn step(&mut self, dt: f32) -> StepTimes {
        if dt != self.dt {
            set_dt(&mut self.app, dt);
            self.dt = dt;
        }
        self.app.update();
        let world = self.app.world_mut();
        let mut simulation = world.query::<&RapierContextSimulation>();
        let counters = simulation.iter(world).map(|simulation| simulation.pipeline.counters);
        let rapier: Duration = counters.map(|counters| counters.stages.collision_detection_time.time()).sum();
        let output = &world.resource::<MedialStep>().output;
        StepTimes {
            collision: output.times.total() + rapier,
            whole: world.resource::<Clock>().whole(),
            contact_pairs: output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count(),
        }
    }

    fn state(&self, body: usize) -> State {
        let (world, entity) = (self.app.world(), self.entities[body]);
        let set = world.try_query::<&RapierRigidBodySet>().and_then(|mut query| query.iter(world).next());
        let handle = world.get::<RapierRigidBodyHandle>(entity);
        match handle.and_then(|handle| set?.bodies.get(handle.0)) {
            Some(rigid) => State { pose: *rigid.position(), linear: rigid.linvel(), angular: rigid.angvel() },
            None => {
                // The next step creates the rigid body.
                let transform = world.get::<Transform>(entity).copied().unwrap_or_default();
                let velocity = world.get::<Velocity>(entity).copied().unwrap_or_default();
                State {
                    pose: Pose3::from_parts(transform.translation, transform.rotation),
                    linear: velocity.linear,
                    angular: velocity.angular,
                }
            }
        }
    }

    fn teleport(&mut self, body: usize, pose: Pose3) {
        let mut entity = self.app.world_mut().entity_mut(self.entities[body]);
        if let Some(mut transform) = entity.get_mut::<Transform>() {
            (transform.translation, transform.rotation) = (pose.translation, pose.rotation);
        }
        entity.insert(Velocity::zero());
    }

    fn push(&mut self, body: usize, linear: Vec3) {
        if let Some(mut velocity) = self.app.world_mut().get_mut::<Velocity>(self.entities[body]) {
            velocity.linear = linear;
        }
    }

    fn despawn(&mut self, body: usize) {
        self.app.world_mut().despawn(self.entities[body]);
    }

    fn resize(&mut self, body: usize, description: &Body) -> Result<(), String> {
        if let Some(mut transform) = self.app.world_mut().get_mut::<Transform>(self.entities[body]) {
            transform.scale = Vec3::splat(description.scale);
        }
        Ok(())
    }
}
