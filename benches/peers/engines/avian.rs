//! Avian with convex decomposition.
//!
//! It lives in an app of its own, one step an update. The step is its physics schedule; collision is what its diagnostics tell of
//! the hierarchy of colliders, broad and narrow phase. Settings are its defaults.

use std::time::{Duration, Instant};

use avian3d::{
    collider_tree::ColliderTreeDiagnostics,
    collision::CollisionDiagnostics,
    prelude::{
        AngularDamping, AngularInertia, AngularVelocity, CenterOfMass, Collider, ContactGraph, LinearDamping,
        LinearVelocity, Mass, NoAutoAngularInertia, NoAutoCenterOfMass, NoAutoMass, PhysicsPlugins, PhysicsSystems,
        Position, RigidBody, Rotation,
    },
};
use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::geometry::Pose3;

use super::{Engine, StepTimes};
use crate::{
    shapes::ModelShape,
    world::{Body, Form, State, World},
};

#[derive(Resource)]
struct Clock {
    begin: Instant,
    /// Of the last step; none if there was none.
    whole: Option<Duration>,
}

/// Avian in an app without a window.
pub struct Avian {
    app: App,
    entities: Vec<Entity>,
}

impl Avian {
    /// The world with these hulls for its models.
    ///
    /// # Errors
    /// If a shape cannot be made.
    pub fn new(world: &World, models: &[ModelShape]) -> Result<Self, String> {
        let dt = Duration::from_secs_f32(world.dt);
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, TransformPlugin, PhysicsPlugins::default()))
            .insert_resource(Time::<Fixed>::from_duration(dt))
            .insert_resource(TimeUpdateStrategy::ManualDuration(dt))
            .insert_resource(Clock { begin: Instant::now(), whole: None })
            .add_systems(
                FixedPostUpdate,
                (
                    begin.after(PhysicsSystems::Prepare).before(PhysicsSystems::StepSimulation),
                    end.after(PhysicsSystems::StepSimulation).before(PhysicsSystems::Writeback),
                ),
            );
        app.finish();
        app.cleanup();
        let mut entities = Vec::new();
        for body in &world.bodies {
            let collider = collider(body, models)?;
            let transform = Transform::from_translation(body.pose.translation).with_rotation(body.pose.rotation);
            let mut entity = app.world_mut().spawn((collider, transform));
            if body.dynamic {
                entity.insert((
                    RigidBody::Dynamic,
                    LinearVelocity(body.velocity.linear),
                    AngularVelocity(body.velocity.angular),
                    LinearDamping(body.damping.linear_damping),
                    AngularDamping(body.damping.angular_damping),
                    (Mass(body.mass.mass()), NoAutoMass),
                    (CenterOfMass(body.mass.local_com), NoAutoCenterOfMass),
                    (inertia(body), NoAutoAngularInertia),
                ));
            } else {
                entity.insert(RigidBody::Static);
            }
            entities.push(entity.id());
        }
        Ok(Self { app, entities })
    }
}

fn inertia(body: &Body) -> AngularInertia {
    AngularInertia { principal: body.mass.principal_inertia(), local_frame: body.mass.principal_inertia_local_frame }
}

fn collider(body: &Body, models: &[ModelShape]) -> Result<Collider, String> {
    let (index, scale) = match body.form {
        Form::Cuboid(half) => return Ok(Collider::cuboid(2.0 * half.x, 2.0 * half.y, 2.0 * half.z)),
        Form::Capsule([a, b], radius) => return Ok(Collider::capsule_endpoints(radius, a, b)),
        Form::Model(index, scale) => (index, scale),
    };
    let hulls = models[index].hulls.iter().map(|hull| {
        let corners = hull.iter().map(|point| *point * scale).collect();
        let hull = Collider::convex_hull(corners).ok_or("a hull without a volume")?;
        Ok((Vec3::ZERO, Quat::IDENTITY, hull))
    });
    Ok(Collider::compound(hulls.collect::<Result<Vec<_>, &str>>()?))
}

fn begin(mut clock: ResMut<Clock>) {
    clock.begin = Instant::now();
}

fn end(mut clock: ResMut<Clock>) {
    clock.whole = Some(clock.begin.elapsed());
}

impl Engine for Avian {
    fn step(&mut self) -> StepTimes {
        // The first update of an app has no time, and no step.
        let whole = loop {
            self.app.update();
            if let Some(whole) = self.app.world_mut().resource_mut::<Clock>().whole.take() {
                break whole;
            }
        };
        let world = self.app.world();
        let (tree, collision) = (world.resource::<ColliderTreeDiagnostics>(), world.resource::<CollisionDiagnostics>());
        let contacts = world.resource::<ContactGraph>();
        StepTimes {
            collision: tree.optimize + tree.update + collision.broad_phase + collision.narrow_phase,
            whole,
            contact_pairs: contacts.iter_active_touching().chain(contacts.iter_sleeping_touching()).count(),
        }
    }

    fn states(&self) -> Vec<State> {
        let world = self.app.world();
        let state = |entity: &Entity| {
            let part = world.entity(*entity);
            let zero = (Vec3::ZERO, Vec3::ZERO);
            let (linear, angular) = part
                .get::<LinearVelocity>()
                .zip(part.get::<AngularVelocity>())
                .map_or(zero, |(linear, angular)| (linear.0, angular.0));
            let translation = part.get::<Position>().map_or(Vec3::NAN, |position| position.0);
            let rotation = part.get::<Rotation>().map_or(Quat::IDENTITY, |rotation| rotation.0);
            State { pose: Pose3::from_parts(translation, rotation), linear, angular }
        };
        self.entities.iter().map(state).collect()
    }
}
