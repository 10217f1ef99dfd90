//! Rapier alone.
//!
//! Its own world is stepped, with the parameters that `bevy_rapier3d` gives it: components add nothing that is measured here, for medial
//! meshes either. Collision is broad and narrow phase, and the search for times of impact.

use std::time::Instant;

use bevy_rapier3d::rapier::prelude::*;

use super::{Engine, StepTimes};
use crate::{
    shapes::{ModelShape, collider},
    world::{Body, State, World},
};

/// What rapier does about fast bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ccd {
    /// What it does unasked: sweeps fast bodies against fixed ones.
    Default,
    /// Also sweeps those against all that are fast at the start, as one would ask of it. (Of all bodies would be the same as of none: two that
    /// this is asked for are not swept against each other.)
    Bullets,
    /// None at all.
    Off,
}

/// True for a body that starts at more than 20 m/s.
pub fn is_fast(body: &Body) -> bool {
    body.velocity.linear.length() > 20.0
}

/// A world of rapier.
pub struct Rapier {
    physics: PhysicsWorld,
    handles: Vec<RigidBodyHandle>,
}

impl Rapier {
    /// The world with these shapes for its models.
    ///
    /// # Errors
    /// If a shape cannot be made.
    pub fn new(world: &World, models: &[ModelShape], ccd: Ccd) -> Result<Self, String> {
        let mut physics = PhysicsWorld::new();
        physics.integration_parameters.dt = world.dt;
        if ccd == Ccd::Off {
            physics.integration_parameters.max_ccd_substeps = 0;
        }
        let mut handles = Vec::new();
        for body in &world.bodies {
            let shape = ColliderBuilder::new(collider(world, body, models)?).mass_properties(body.mass);
            let rigid = if body.dynamic { RigidBodyBuilder::dynamic() } else { RigidBodyBuilder::fixed() };
            let rigid = rigid
                .pose(body.pose)
                .linvel(body.velocity.linear)
                .angvel(body.velocity.angular)
                .linear_damping(body.damping.linear_damping)
                .angular_damping(body.damping.angular_damping)
                .ccd_enabled(ccd == Ccd::Bullets && is_fast(body));
            handles.push(physics.insert(rigid, shape).0);
        }
        Ok(Self { physics, handles })
    }
}

impl Engine for Rapier {
    fn step(&mut self) -> StepTimes {
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

    fn states(&self) -> Vec<State> {
        let bodies = self.handles.iter().map(|handle| &self.physics.bodies[*handle]);
        bodies.map(|body| State { pose: *body.position(), linear: body.linvel(), angular: body.angvel() }).collect()
    }
}
