//! The engines, behind a common interface.

mod alternating;
#[cfg(feature = "peers")]
mod avian;
mod medial;
mod rapier;
mod shapes;

use std::time::{Duration, Instant};

use bevy::prelude::{ResMut, Resource};
use bevy_medial::geometry::Pose3;
use bevy_rapier3d::parry::{mass_properties::MassProperties, math::Matrix};
use glam::Vec3;

use crate::body::{Body, State};

#[cfg(feature = "peers")]
pub use avian::Avian;
pub use medial::{Medial, Variant};
pub use rapier::{Ccd, Rapier};

/// Cost of a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepTimes {
    /// Contacts and impacts.
    pub collision: Duration,
    /// The whole step: collision, solver, integration, sleeping. Copies from and to components are not included.
    pub whole: Duration,
    /// Number of body pairs with contacts.
    pub contact_pairs: usize,
}

/// A world of an engine.
pub trait Engine {
    /// Adds a body. Bodies are numbered from 0 in the order in which they are added.
    ///
    /// # Errors
    /// If the engine has no such shape.
    fn spawn(&mut self, body: &Body) -> Result<(), String>;

    /// Runs a step of `dt` seconds.
    fn step(&mut self, dt: f32) -> StepTimes;

    /// Pose and velocity of a body that has not been despawned.
    fn state(&self, body: usize) -> State;

    /// Moves a body to another pose, at rest.
    fn teleport(&mut self, body: usize, pose: Pose3);

    /// Sets the linear velocity of a body.
    fn push(&mut self, body: usize, linear: Vec3);

    /// Removes a body.
    fn despawn(&mut self, body: usize);

    /// Gives a body the scale and mass of `description`, at its present pose.
    ///
    /// # Errors
    /// If the engine has no such shape.
    fn resize(&mut self, body: usize, description: &Body) -> Result<(), String>;
}

/// Measures systems of an app: [`Clock::begin`] runs before them, [`Clock::end`] after them.
#[derive(Resource, Default)]
struct Clock {
    begin: Option<Instant>,
    end: Option<Instant>,
}

impl Clock {
    fn begin(mut clock: ResMut<Self>) {
        clock.begin = Some(Instant::now());
    }

    fn end(mut clock: ResMut<Self>) {
        clock.end = Some(Instant::now());
    }

    /// The last measured time.
    fn whole(&self) -> Duration {
        self.begin.zip(self.end).map_or(Duration::ZERO, |(begin, end)| end.saturating_duration_since(begin))
    }
}

/// The mass properties of a body, in the type of parry.
pub fn mass(body: &Body) -> MassProperties {
    let mass = body.mass();
    let inertia = Matrix::from_cols_array(&mass.inertia.to_cols_array());
    MassProperties::with_inertia_matrix(mass.center_of_mass, mass.volume, inertia)
}
