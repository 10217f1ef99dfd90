//! Reach of the contact search: only as far as the solver needs contacts.
//!
//! A solver keeps the normals and lever arms of contacts for a whole step. This is accurate for bodies that hardly move, so contacts of slow bodies are
//! searched as far as the bodies can move. A fast body that is apart would be stopped too early by such contacts, even if it only passes. The sweep finds its
//! impact instead. A fast body in touch needs the contacts that carry it next.

use glam::Vec3;

use crate::constants::{LINEAR_SLOP, REST_REACH};

/// Motion of a collider in a step at the current velocity of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Displacement of its body's centre of mass, in metres.
    pub way: Vec3,
    /// Rotation over the step: axis times angle in radians.
    pub rotation: Vec3,
    /// Bounding radius of the collider, in metres.
    pub radius: f32,
}

impl Pace {
    /// No motion.
    pub const REST: Pace = Pace { way: Vec3::ZERO, rotation: Vec3::ZERO, radius: 0.0 };

    /// Returns the motion in a step that is longer by a factor.
    pub fn times(self, factor: f32) -> Self {
        Self { way: self.way * factor, rotation: self.rotation * factor, ..self }
    }

    /// Returns an upper bound of the relative displacement of any points of both colliders, in metres.
    pub fn against(&self, other: &Self) -> f32 {
        let turn = |pace: &Self| pace.rotation.length() * pace.radius;
        self.way.distance(other.way) + (turn(self) + turn(other))
    }
}

/// Reach of the contact search of a pair, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Largest distance of contacts.
    pub prediction: f32,
    /// Largest distance of contacts if the bodies touch: at least [`prediction`](Self::prediction).
    pub in_touch: f32,
    /// [`StepInput::length_unit`](super::StepInput::length_unit).
    pub length_unit: f32,
}

impl Reach {
    /// Creates a reach that does not depend on the motion of the pair.
    pub fn new(prediction: f32, length_unit: f32) -> Self {
        Self { prediction, in_touch: prediction, length_unit }
    }

    /// Returns the reach for a pair with this relative displacement in the coming step, in metres.
    ///
    /// The reach is the displacement plus a margin for accelerations, up to the prediction distance. If the pair is apart and moves farther than the prediction
    /// distance in the step, the reach falls with the square of the speed.
    ///
    /// The reach is the prediction distance halved a number of times, or the touch distance if that is larger. So it stays the same when velocities change a
    /// little.
    pub fn of_pair(self, displacement: f32) -> Self {
        let Self { length_unit, .. } = self;
        // Halving infinity would not end.
        let prediction = self.prediction.min(f32::MAX);
        let least = prediction.min(LINEAR_SLOP * length_unit);
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

    /// Returns the distance at which bodies touch, in metres.
    pub fn touch(&self) -> f32 {
        LINEAR_SLOP * self.length_unit
    }
}

impl From<f32> for Reach {
    /// Creates a reach from a prediction distance in metres, with a length unit of 1 m.
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
        // All lengths are proportional to the length unit.
        let large = Reach::new(2.0, 100.0);
        assert_eq!([0.0, 7.0, 20.0].map(|way| large.of_pair(way).prediction), [0.5, 0.125, 0.1]);
    }
}
