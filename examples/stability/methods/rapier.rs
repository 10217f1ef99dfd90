//! Rapier alone, in a world of its own.

use bevy_medial::geometry::Pose3;
use bevy_rapier3d::{parry::mass_properties::MassProperties, rapier::prelude::*};
use glam::Vec3;

use super::Engine;
use crate::{
    shapes::rapier_shape,
    world::{Body, Kind, Setup, State},
};

/// What is asked of it about bullets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Care {
    /// Nothing.
    None,
    /// Its continuous collision detection.
    Ccd,
    /// Contacts as far ahead as a step goes.
    SoftCcd,
    /// As [`Care::Ccd`], of triangle meshes.
    Triangles,
}

/// A world of rapier.
pub struct Rapier {
    physics: PhysicsWorld,
    care: Care,
    handles: Vec<(RigidBodyHandle, ColliderHandle)>,
}

impl Rapier {
    pub fn new(setup: Setup, care: Care) -> Self {
        let mut physics = PhysicsWorld::new();
        physics.gravity = Vec3::Y * -setup.gravity;
        physics.integration_parameters.length_unit = setup.unit;
        physics.integration_parameters.dt = setup.dt;
        Self { physics, care, handles: Vec::new() }
    }
}

fn mass(body: &Body) -> MassProperties {
    let mass = body.mass();
    let inertia = bevy_rapier3d::parry::math::Matrix::from_cols_array(&mass.inertia.to_cols_array());
    MassProperties::with_inertia_matrix(mass.center_of_mass, mass.volume, inertia)
}

impl Engine for Rapier {
    fn spawn(&mut self, body: &Body) -> Result<(), String> {
        let mut shape =
            ColliderBuilder::new(rapier_shape(body, self.care == Care::Triangles)?).mass_properties(mass(body));
        if body.slippery {
            shape = shape.friction(0.0).friction_combine_rule(CoefficientCombineRule::Min);
        }
        let rigid = match body.kind {
            Kind::Fixed => RigidBodyBuilder::fixed(),
            Kind::Kinematic => RigidBodyBuilder::kinematic_velocity_based(),
            Kind::Dynamic => RigidBodyBuilder::dynamic(),
        };
        let mut rigid = rigid
            .pose(body.pose)
            .linvel(body.linear)
            .angvel(body.angular)
            .linear_damping(body.damping)
            .angular_damping(body.damping);
        if body.fast {
            self.physics.integration_parameters.normalized_max_linear_velocity = f32::MAX;
            let way = body.linear.length() * self.physics.integration_parameters.dt + body.size();
            rigid = rigid
                .allow_fast_rotation(true)
                .ccd_enabled(matches!(self.care, Care::Ccd | Care::Triangles))
                .soft_ccd_prediction(if self.care == Care::SoftCcd { way } else { 0.0 });
        }
        let handles = self.physics.insert(rigid, shape);
        if body.fast {
            self.physics.bodies[handles.0].enable_gyroscopic_forces(false);
        }
        self.handles.push(handles);
        Ok(())
    }

    fn step(&mut self, dt: f32) {
        self.physics.integration_parameters.dt = dt;
        self.physics.step();
    }

    fn state(&self, body: usize) -> State {
        let body = &self.physics.bodies[self.handles[body].0];
        State { pose: *body.position(), linear: body.linvel(), angular: body.angvel() }
    }

    fn teleport(&mut self, body: usize, pose: Pose3) {
        let body = &mut self.physics.bodies[self.handles[body].0];
        body.set_position(pose, true);
        body.set_linvel(Vec3::ZERO, true);
        body.set_angvel(Vec3::ZERO, true);
    }

    fn push(&mut self, body: usize, linear: Vec3) {
        self.physics.bodies[self.handles[body].0].set_linvel(linear, true);
    }

    fn despawn(&mut self, body: usize) {
        self.physics.remove_body(self.handles[body].0);
    }

    fn resize(&mut self, body: usize, description: &Body) -> Result<(), String> {
        let (rigid, collider) = self.handles[body];
        let shape = rapier_shape(description, self.care == Care::Triangles)?;
        let collider = &mut self.physics.colliders[collider];
        collider.set_shape(shape);
        collider.set_mass_properties(mass(description));
        self.physics.wake_up(rigid, true);
        Ok(())
    }
}
