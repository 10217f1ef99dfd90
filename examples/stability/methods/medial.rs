//! This crate's plugin, in an app without a window.

use std::time::Duration;

use bevy::{prelude::*, time::TimeUpdateStrategy};
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

use super::{Engine, alternating, renderer::rendering_app};
use crate::world::{Body, Form, Kind, Setup, State};

/// Where pairs are culled, or what finds impacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    Cpu,
    Gpu,
    GpuAhead,
    Alternating,
}

/// The plugin in an app of its own.
pub struct Medial {
    app: App,
    entities: Vec<Entity>,
    dt: f32,
}

impl Medial {
    pub fn new(setup: Setup, variant: Variant) -> Self {
        let mut app = if variant == Variant::GpuAhead { rendering_app(setup.dt) } else { headless_app(setup.dt) };
        set_dt(&mut app, setup.dt);
        let on_gpu = matches!(variant, Variant::Gpu | Variant::GpuAhead);
        app.insert_resource(MedialSettings {
            backend: if on_gpu { MedialBackend::Gpu } else { MedialBackend::Cpu },
            pipelined: variant == Variant::GpuAhead,
            stop_at_impact: variant != Variant::Alternating,
            ..default()
        });
        app.add_systems(PostUpdate, calm_bullets.after(PhysicsSet::SyncBackend).before(MedialSystems::Snapshot));
        if variant == Variant::Alternating {
            alternating::add(&mut app);
        }
        // Brings the world of rapier.
        app.update();
        let world = app.world_mut();
        let mut contexts = world.query::<(&mut RapierContextSimulation, &mut RapierConfiguration)>();
        for (mut simulation, mut configuration) in contexts.iter_mut(world) {
            simulation.integration_parameters.length_unit = setup.unit;
            configuration.gravity = Vec3::Y * -setup.gravity;
        }
        Self { app, entities: Vec::new(), dt: setup.dt }
    }
}

/// Rapier's gyroscopic term is explicit in time: it makes energy out of a fast spin in free flight.
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
            (_, Some(mesh)) => _ = entity.insert(mesh),
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
                let damping = Damping { linear_damping: body.damping, angular_damping: body.damping };
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

    fn step(&mut self, dt: f32) {
        if dt != self.dt {
            set_dt(&mut self.app, dt);
            self.dt = dt;
        }
        self.app.update();
    }

    fn state(&self, body: usize) -> State {
        let (world, entity) = (self.app.world(), self.entities[body]);
        let set = world.try_query::<&RapierRigidBodySet>().and_then(|mut query| query.iter(world).next());
        let handle = world.get::<RapierRigidBodyHandle>(entity);
        match handle.and_then(|handle| set?.bodies.get(handle.0)) {
            Some(rigid) => State { pose: *rigid.position(), linear: rigid.linvel(), angular: rigid.angvel() },
            None => {
                // It comes with the next step.
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
