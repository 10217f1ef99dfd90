//! The engines, all run the same way.

pub mod avian;
pub mod medial;
pub mod rapier;

use std::time::Duration;

use crate::world::State;

/// What a step took.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepTimes {
    /// Finding contacts and impacts.
    pub collision: Duration,
    /// All of the step: collision, solver, integration, sleeping. Not the copies from and to components.
    pub whole: Duration,
    /// Pairs of bodies with contacts.
    pub contact_pairs: usize,
}

/// An engine with a world.
pub trait Engine {
    /// Runs a step.
    fn step(&mut self) -> StepTimes;

    /// Where bodies are, in the world's order.
    fn states(&self) -> Vec<State>;
}
