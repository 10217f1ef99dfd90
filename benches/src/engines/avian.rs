//! Avian, in a separate app, with its default settings and `SweptCcd` for bodies that are `fast`.
//!
//! An update of the app is one step. The time of a step is that of the physics schedule. The time of collision is the sum that avian's diagnostics report for
//! the collider tree, broad phase and narrow phase.

use std::time::Duration;

use avian3d::{
    collider_tree::ColliderTreeDiagnostics,
    collision::CollisionDiagnostics,
    prelude::{
        AngularDamping, AngularInertia, AngularVelocity, CenterOfMass, CoefficientCombine, ContactGraph, Friction,
        Gravity, LinearDamping, LinearVelocity, Mass, NoAutoAngularInertia, NoAutoCenterOfMass, NoAutoMass,
        PhysicsPlugins, PhysicsSystems, Position, RigidBody, Rotation, SweptCcd,
    },
};
use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::geometry::Pose3;

use super::{Clock, Engine, StepTimes, shapes::avian_shape};
use crate::body::{Body, Kind, Setup, State};

/// Avian in an app without a window.
pub struct Avian {
    app: App,
    entities: Vec<Entity>,
}

impl Avian {
    /// An empty world.
    pub fn new(setup: Setup) -> Self {
        let mut app = App::new();
        app.add_plugins((MinimalPlugins, TransformPlugin, PhysicsPlugins::default().with_length_unit(setup.unit)))
            .insert_resource(Gravity(Vec3::Y * -setup.gravity))
            .insert_resource(Clock::default())
            .add_systems(
                FixedPostUpdate,
                (
                    Clock::begin.after(PhysicsSystems::Prepare).before(PhysicsSystems::StepSimulation),
                    Clock::end.after(PhysicsSystems::StepSimulation).before(PhysicsSystems::Writeback),
                ),
            );
        set_dt(&mut app, setup.dt);
        app.finish();
        app.cleanup();
        // The time step of the first update of an app is zero.
        app.update();
        Self { app, entities: Vec::new() }
    }
}

fn set_dt(app: &mut App, dt: f32) {
    let dt = Duration::from_secs_f32(dt);
    // A new clock discards the remainder of a step of another length.
    app.insert_resource(Time::<Fixed>::from_duration(dt)).insert_resource(TimeUpdateStrategy::ManualDuration(dt));
    // Steps above the max delta would be cut.
    app.world_mut().resource_mut::<Time<Virtual>>().set_max_delta(dt.max(Duration::from_millis(250)));
}

type MassBundle = ((Mass, NoAutoMass), (CenterOfMass, NoAutoCenterOfMass), (AngularInertia, NoAutoAngularInertia));

fn mass(body: &Body) -> MassBundle {
    let mass = super::mass(body);
    let inertia =
        AngularInertia { principal: mass.principal_inertia(), local_frame: mass.principal_inertia_local_frame };
    (
        (Mass(mass.mass()), NoAutoMass),
        (CenterOfMass(mass.local_com), NoAutoCenterOfMass),
        (inertia, NoAutoAngularInertia),
    )
}

impl Engine for Avian {
    fn spawn(&mut self, body: &Body) -> Result<(), String> {
        let transform = Transform::from_translation(body.pose.translation).with_rotation(body.pose.rotation);
        let kind = match body.kind {
            Kind::Fixed => RigidBody::Static,
            Kind::Kinematic => RigidBody::Kinematic,
            Kind::Dynamic => RigidBody::Dynamic,
        };
        let mut entity = self.app.world_mut().spawn((avian_shape(body)?, kind, transform));
        if body.kind != Kind::Fixed {
            entity.insert((LinearVelocity(body.linear), AngularVelocity(body.angular)));
        }
        if body.kind == Kind::Dynamic {
            let [linear, angular] = body.damping;
            entity.insert((LinearDamping(linear), AngularDamping(angular), mass(body)));
        }
        if body.slippery {
            entity.insert(Friction::new(0.0).with_combine_rule(CoefficientCombine::Min));
        }
        if body.fast {
            entity.insert(SweptCcd::default());
        }
        self.entities.push(entity.id());
        Ok(())
    }

    fn step(&mut self, dt: f32) -> StepTimes {
        set_dt(&mut self.app, dt);
        self.app.update();
        let world = self.app.world();
        let (tree, collision) = (world.resource::<ColliderTreeDiagnostics>(), world.resource::<CollisionDiagnostics>());
        let contacts = world.resource::<ContactGraph>();
        StepTimes {
            collision: tree.optimize + tree.update + collision.broad_phase + collision.narrow_phase,
            whole: world.resource::<Clock>().whole(),
            contact_pairs: contacts.iter_active_touching().chain(contacts.iter_sleeping_touching()).count(),
        }
    }

    fn state(&self, body: usize) -> State {
        let part = self.app.world().entity(self.entities[body]);
        let transform = part.get::<Transform>().copied().unwrap_or_default();
        State {
            pose: Pose3::from_parts(
                part.get::<Position>().map_or(transform.translation, |position| position.0),
                part.get::<Rotation>().map_or(transform.rotation, |rotation| rotation.0),
            ),
            linear: part.get::<LinearVelocity>().map_or(Vec3::ZERO, |linear| linear.0),
            angular: part.get::<AngularVelocity>().map_or(Vec3::ZERO, |angular| angular.0),
        }
    }

    fn teleport(&mut self, body: usize, pose: Pose3) {
        let mut entity = self.app.world_mut().entity_mut(self.entities[body]);
        entity.insert((Position(pose.translation), Rotation(pose.rotation)));
        entity.insert((LinearVelocity::ZERO, AngularVelocity::ZERO));
    }

    fn push(&mut self, body: usize, linear: Vec3) {
        self.app.world_mut().entity_mut(self.entities[body]).insert(LinearVelocity(linear));
    }

    fn despawn(&mut self, body: usize) {
        self.app.world_mut().despawn(self.entities[body]);
    }

    fn resize(&mut self, body: usize, description: &Body) -> Result<(), String> {
        let bundle = (avian_shape(description)?, mass(description));
        self.app.world_mut().entity_mut(self.entities[body]).insert(bundle);
        Ok(())
    }
}
