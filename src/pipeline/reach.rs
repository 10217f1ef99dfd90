//! How far contacts are searched: only as far as the solver needs them.
//!
//! A solver keeps the normals and lever arms of contacts for a whole step. That is accurate for bodies that hardly move, so slow bodies are searched as far
//! as they can move. A fast body that is still apart would be stopped ahead of time by such contacts, whether it comes to touch or passes; the sweep finds its impact. A fast
//! body in touch needs the contacts that carry it next.

use glam::Vec3;

use crate::constants::{REST_REACH, TOUCH_DISTANCE};

/// What a collider moves by in a step, at the velocity that its body has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Displacement of its body's centre of mass, in metres.
    pub way: Vec3,
    /// Rotation vector of the turn, in radians.
    pub rotation: Vec3,
    /// Its bounding radius, in metres.
    pub radius: f32,
}

impl Pace {
    /// What does not move.
    pub const REST: Pace = Pace { way: Vec3::ZERO, rotation: Vec3::ZERO, radius: 0.0 };

    /// The pace in a step that is so many times as long.
    pub fn times(self, factor: f32) -> Self {
        Self { way: self.way * factor, rotation: self.rotation * factor, ..self }
    }

    /// How far any point of one goes relative to the other at most, in metres.
    pub fn against(&self, other: &Self) -> f32 {
        let turn = |pace: &Self| pace.rotation.length() * pace.radius;
        self.way.distance(other.way) + (turn(self) + turn(other))
    }
}

/// How far contacts of a pair are searched, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Contacts are found up to this distance.
    pub prediction: f32,
    /// The same for bodies that touch: at least [`prediction`](Self::prediction).
    pub in_touch: f32,
    /// [`StepInput::length_unit`](super::StepInput::length_unit).
    pub length_unit: f32,
}

impl Reach {
    /// The same distance for all pairs.
    pub fn new(prediction: f32, length_unit: f32) -> Self {
        Self { prediction, in_touch: prediction, length_unit }
    }

    /// The reach for a pair with this relative displacement in the coming step, in metres: as far as the pair moves, and a margin for accelerations. While the pair is apart and faster
    /// than the prediction distance in a step, the reach falls with the square of the speed.
    ///
    /// One of a few distances, so that it stays the same when velocities change a little.
    pub fn of_pair(self, displacement: f32) -> Self {
        let Self { length_unit, .. } = self;
        // Infinity cannot be halved.
        let prediction = self.prediction.min(f32::MAX);
        let least = prediction.min(TOUCH_DISTANCE * length_unit);
        let needed = displacement + REST_REACH * prediction;
        let ratio = (prediction / displacement).min(1.0);
        let trusted = prediction * ratio * ratio;
        let mut reach = prediction;
        while reach > least && 0.5 * reach >= needed {
            reach *= 0.5;
        }
        let in_touch = reach.max(least);
        while reach > least && reach > trusted {
            reach *= 0.5;
        }
        Self { prediction: reach.max(least), in_touch, length_unit }
    }

    /// The distance at which bodies touch, in metres.
    pub fn touch(&self) -> f32 {
        TOUCH_DISTANCE * self.length_unit
    }
}

impl From<f32> for Reach {
    /// A prediction distance, among bodies of about a metre.
    fn from(prediction: f32) -> Self {
        Self::new(prediction, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slow_or_fast_has_less_reach() {
        let reach = |way: f32| Reach::from(0.02).of_pair(way).prediction;
        assert_eq!([0.0, 1.0e-3, 5.0e-3, 0.019].map(reach), [0.005, 0.01, 0.01, 0.02]);
        assert_eq!([0.021, 0.04, 0.07, 0.2, f32::INFINITY].map(reach), [0.01, 0.005, 1.25e-3, 1.0e-3, 1.0e-3]);
        assert_eq!(reach(f32::NAN), 0.02);
        for way in [0.0, 1.0, f32::INFINITY, f32::NAN] {
            assert_eq!(Reach::from(0.0).of_pair(way).prediction, 0.0);
            assert!(Reach::from(f32::INFINITY).of_pair(way).prediction >= 1.0e-3);
        }
        // In another length unit all is in proportion.
        let large = Reach::new(2.0, 100.0);
        assert_eq!([0.0, 7.0, 20.0].map(|way| large.of_pair(way).prediction), [0.5, 0.125, 0.1]);
    }
}
