//! Margin of the contact search: how far apart surfaces may be for the solver to need their contact.
//!
//! A solver keeps the normals and lever arms of contacts for a whole step. This is accurate for bodies that hardly move, so contacts of slow bodies are
//! searched as far as the bodies can move. A fast body that is apart would be stopped by such contacts even if it only passes. So such a pair gets only
//! the contacts that it [reaches](super::approach::Approach). A fast body in touch needs the contacts that carry it next.

use glam::Vec3;

use super::Contact;
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
    /// True if the pair moves farther than its prediction distance in the step. If it is apart, it needs only the contacts that it will reach.
    pub is_fast: bool,
    /// [`StepInput::length_unit`](crate::pipeline::StepInput::length_unit).
    pub length_unit: f32,
}

impl ContactMargin {
    /// Creates a margin that does not depend on the motion of the pair.
    pub fn new(prediction: f32, length_unit: f32) -> Self {
        Self { prediction, is_fast: false, length_unit }
    }

    /// Returns the margin for a pair with these displacements in the coming step.
    ///
    /// The margin is the relative displacement plus an allowance for accelerations, up to the prediction distance.
    ///
    /// The margin is the prediction distance halved a number of times, or the touch distance if that is larger. So it stays the same when velocities change a
    /// little.
    pub fn of_pair(self, [first, second]: [&Displacement; 2]) -> Self {
        // Halving infinity would not end.
        let prediction = self.prediction.min(f32::MAX);
        let least = prediction.min(self.touch());
        let displacement = first.against(second);
        let needed = displacement + REST_MARGIN * prediction;
        let mut reach = prediction;
        while reach > least && 0.5 * reach >= needed {
            reach *= 0.5;
        }
        Self { prediction: reach.max(least), is_fast: displacement > prediction, ..self }
    }

    /// Removes the contacts of a fast pair that is apart, except those that it reaches in the step.
    pub fn keep_reached(&self, contacts: &mut Vec<Contact>, reaches: impl FnMut(&Contact) -> bool) {
        if self.is_fast && contacts.iter().all(|contact| contact.distance > self.touch()) {
            contacts.retain(reaches);
        }
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
    fn slow_pairs_have_smaller_margins() {
        let margin = |displacement: f32| of_moving(ContactMargin::from(0.02), displacement);
        assert_eq!([0.0, 1.0e-3, 5.0e-3, 0.019].map(margin), [0.005, 0.01, 0.01, 0.02]);
        assert_eq!(margin(f32::NAN), 0.02);
        for displacement in [0.0, 1.0, f32::INFINITY, f32::NAN] {
            assert_eq!(of_moving(ContactMargin::from(0.0), displacement), 0.0);
            assert!(of_moving(ContactMargin::from(f32::INFINITY), displacement) >= 1.0e-3);
        }
        // All lengths are proportional to the length unit.
        let large = ContactMargin::new(2.0, 100.0);
        assert_eq!([0.0, 7.0, 20.0].map(|displacement| of_moving(large, displacement)), [0.5, 2.0, 2.0]);
    }
}
