//! Rapier alone, in a separate world.
//!
//! The world has the parameters that `bevy_rapier3d` gives it, except that the limits of speed of bodies that are `fast` are lifted. There are no
//! components, whose cost is the same for medial meshes. Collision is broad and narrow phase, and the search for times of impact.

use std::time::Instant;

use bevy_medial::geometry::Pose3;
use bevy_rapier3d::rapier::prelude::*;
use glam::Vec3;

use super::{Engine, StepTimes, mass, shapes::rapier_shape};
use crate::body::{Body, Kind, Setup, State};

/// Continuous collision detection of rapier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ccd {
    /// The default: fast bodies are swept against fixed ones.
    Default,
    /// `ccd_enabled` for bullets: they are swept against all bodies. Two bodies with this flag are not swept against each other.
    Bullets,
    /// A `soft_ccd_prediction` for bullets: contacts are predicted over the displacement in a step and the size of the body.
    Soft,
    /// No continuous collision detection.
    Off,
}

/// A world of rapier.
pub struct Rapier {
    physics: PhysicsWorld,
    ccd: Ccd,
    /// True if dynamic bodies are hollow triangle meshes.
    hollow: bool,
    handles: Vec<(RigidBodyHandle, ColliderHandle)>,
}

impl Rapier {
    /// An empty world.
    pub fn new(setup: Setup, ccd: Ccd) -> Self {
        let mut physics = PhysicsWorld::new();
        physics.gravity = Vec3::Y * -setup.gravity;
        physics.integration_parameters.length_unit = setup.unit;
        physics.integration_parameters.dt = setup.dt;
        if ccd == Ccd::Off {
            physics.integration_parameters.max_ccd_substeps = 0;
        }
        Self { physics, ccd, hollow: false, handles: Vec::new() }
    }

    /// The same, with dynamic bodies as triangle meshes.
    pub fn hollow(self) -> Self {
        Self { hollow: true, ..self }
    }

    fn shape(&self, body: &Body) -> Result<SharedShape, String> {
        if self.hollow && body.kind == Kind::Dynamic {
            rapier_shape(&body.clone().hollow()?)
        } else {
            rapier_shape(body)
        }
    }
}

impl Engine for Rapier {
    fn spawn(&mut self, body: &Body) -> Result<(), String> {
        let mut shape = ColliderBuilder::new(self.shape(body)?).mass_properties(mass(body));
        if body.slippery {
            shape = shape.friction(0.0).friction_combine_rule(CoefficientCombineRule::Min);
        }
        let rigid = match body.kind {
            Kind::Fixed => RigidBodyBuilder::fixed(),
            Kind::Kinematic => RigidBodyBuilder::kinematic_velocity_based(),
            Kind::Dynamic => RigidBodyBuilder::dynamic(),
        };
        let [linear_damping, angular_damping] = body.damping;
        let mut rigid = rigid
            .pose(body.pose)
            .linvel(body.linear)
            .angvel(body.angular)
            .linear_damping(linear_damping)
            .angular_damping(angular_damping)
            .ccd_enabled(self.ccd == Ccd::Bullets && body.is_bullet());
        if body.fast {
            self.physics.integration_parameters.normalized_max_linear_velocity = f32::MAX;
            let displacement = body.linear.length() * self.physics.integration_parameters.dt + body.size();
            rigid = rigid.allow_fast_rotation(true).soft_ccd_prediction(if self.ccd == Ccd::Soft {
                displacement
            } else {
                0.0
            });
        }
        let handles = self.physics.insert(rigid, shape);
        if body.fast {
            self.physics.bodies[handles.0].enable_gyroscopic_forces(false);
        }
        self.handles.push(handles);
        Ok(())
    }

    fn step(&mut self, dt: f32) -> StepTimes {
        self.physics.integration_parameters.dt = dt;
        let begin = Instant::now();
        self.physics.step();
        let whole = begin.elapsed();
        let counters = &self.physics.physics_pipeline.counters;
        let pairs = self.physics.contact_pairs();
        StepTimes {
            collision: counters.stages.collision_detection_time.time() + counters.ccd.toi_computation_time.time(),
            whole,
            contact_pairs: pairs.filter(|pair| pair.has_any_active_contact()).count(),
        }
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
        let shape = self.shape(description)?;
        let collider = &mut self.physics.colliders[collider];
        collider.set_shape(shape);
        collider.set_mass_properties(mass(description));
        self.physics.wake_up(rigid, true);
        Ok(())
    }
}
