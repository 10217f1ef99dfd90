//! Margin of the contact search: how far apart surfaces may be for the solver to need their contact.
//!
//! A solver keeps the normals and lever arms of contacts for a whole step. This is accurate for bodies that hardly move, so contacts of slow bodies are
//! searched as far as the bodies can move. A fast body that is apart would be stopped too early by such contacts, even if it only passes. The sweep finds its
//! impact instead. A fast body in touch needs the contacts that carry it next.

use glam::Vec3;

use crate::constants::{LINEAR_SLOP, REST_MARGIN};

/// Displacement of a collider in a step at the current velocity of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Displacement of its body's centre of mass, in metres.
    pub translation: Vec3,
    /// Rotation over the step: axis times angle in radians.
    pub rotation: Vec3,
    /// Bounding radius of the collider, in metres.
    pub radius: f32,
    /// Displacement by gravity in a step from rest, in metres.
    pub fall: f32,
}

impl Displacement {
    /// No motion.
    pub const REST: Displacement =
        Displacement { translation: Vec3::ZERO, rotation: Vec3::ZERO, radius: 0.0, fall: 0.0 };

    /// Returns the displacement in a step that is longer by a factor, without more gravity.
    pub fn times(self, factor: f32) -> Self {
        Self { translation: self.translation * factor, rotation: self.rotation * factor, ..self }
    }

    /// Returns an upper bound of the relative displacement of any points of both colliders, in metres.
    pub fn against(&self, other: &Self) -> f32 {
        let turn = |side: &Self| side.rotation.length() * side.radius;
        self.translation.distance(other.translation) + (turn(self) + turn(other))
    }
}

/// Margin of the contact search of a pair, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactMargin {
    /// Largest distance of contacts.
    pub prediction: f32,
    /// Largest distance of contacts if the bodies touch: at least [`prediction`](Self::prediction).
    pub in_touch: f32,
    /// [`StepInput::length_unit`](crate::pipeline::StepInput::length_unit).
    pub length_unit: f32,
}

impl ContactMargin {
    /// Creates a margin that does not depend on the motion of the pair.
    pub fn new(prediction: f32, length_unit: f32) -> Self {
        Self { prediction, in_touch: prediction, length_unit }
    }

    /// Returns the margin for a pair with these displacements in the coming step.
    ///
    /// The margin is the relative displacement plus an allowance for accelerations, up to the prediction distance. If the pair is apart and moves farther than
    /// the prediction distance in the step, the margin falls with the square of the speed.
    ///
    /// The margin is the prediction distance halved a number of times, or the touch distance if that is larger. So it stays the same when velocities change a
    /// little.
    pub fn of_pair(self, [first, second]: [&Displacement; 2]) -> Self {
        let Self { length_unit, .. } = self;
        // Halving infinity would not end.
        let prediction = self.prediction.min(f32::MAX);
        let least = prediction.min(LINEAR_SLOP * length_unit);
        let displacement = first.against(second);
        let needed = displacement + REST_MARGIN * prediction;
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

    /// Returns the distance below which the larger margin applies, in metres; −∞ if both margins are equal.
    pub fn enlarging_distance(&self) -> f32 {
        if self.in_touch > self.prediction { self.touch() } else { f32::NEG_INFINITY }
    }

    /// Returns the distance at which bodies touch, in metres.
    pub fn touch(&self) -> f32 {
        LINEAR_SLOP * self.length_unit
    }
}

impl From<f32> for ContactMargin {
    /// Creates a margin from a prediction distance in metres, with a length unit of 1 m.
    fn from(prediction: f32) -> Self {
        Self::new(prediction, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The margin of a body that moves towards a body at rest.
    fn of_moving(margin: ContactMargin, displacement: f32) -> f32 {
        let moving = Displacement { translation: Vec3::new(displacement, 0.0, 0.0), ..Displacement::REST };
        margin.of_pair([&moving, &Displacement::REST]).prediction
    }

    #[test]
    fn slow_and_fast_pairs_have_smaller_margins() {
        let margin = |displacement: f32| of_moving(ContactMargin::from(0.02), displacement);
        assert_eq!([0.0, 1.0e-3, 5.0e-3, 0.019].map(margin), [0.005, 0.01, 0.01, 0.02]);
        assert_eq!([0.021, 0.04, 0.07, 0.2, f32::INFINITY].map(margin), [0.01, 0.005, 1.25e-3, 1.0e-3, 1.0e-3]);
        assert_eq!(margin(f32::NAN), 0.02);
        for displacement in [0.0, 1.0, f32::INFINITY, f32::NAN] {
            assert_eq!(of_moving(ContactMargin::from(0.0), displacement), 0.0);
            assert!(of_moving(ContactMargin::from(f32::INFINITY), displacement) >= 1.0e-3);
        }
        // All lengths are proportional to the length unit.
        let large = ContactMargin::new(2.0, 100.0);
        assert_eq!([0.0, 7.0, 20.0].map(|displacement| of_moving(large, displacement)), [0.5, 0.125, 0.1]);
    }
}
