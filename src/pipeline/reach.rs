//! How far contacts are looked for: only as far as the solver has use for them.
//!
//! A solver keeps normals and lever arms of contacts for a whole step, which is next to exact for bodies that hardly move in it. Of fast ones it is told
//! of no contacts at a distance: it would stop them there, whether they come to touch or turn away and pass. Their impacts are found by the
//! sweep. What is slow does not get as far in a step. What slides needs the contacts that will carry it next.

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

    /// How far any point of one goes relative to the other at most, in metres.
    pub fn against(&self, other: &Self) -> f32 {
        let turn = |pace: &Self| pace.rotation.length() * pace.radius;
        self.way.distance(other.way) + (turn(self) + turn(other))
    }
}

/// How far contacts are looked for, and what is small among them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Contacts are found up to this distance, in metres.
    pub prediction: f32,
    /// [`StepInput::length_unit`](super::StepInput::length_unit).
    pub length_unit: f32,
}

impl Reach {
    /// The reach for a pair that goes so far in a step, in metres. It is the least for what goes as far as the prediction distance many times over; for
    /// what is slow, that far and a little more. One of a few distances, so that it is the same still when velocities change a little.
    pub fn of_pair(self, way: f32) -> Self {
        let Self { prediction, length_unit } = self;
        // Halves of what is infinite would be no less.
        let prediction = prediction.min(f32::MAX);
        let trust = (prediction / way).min(1.0);
        let [trusted, needed] = [prediction * trust * trust, way + REST_REACH * prediction];
        let least = prediction.min(TOUCH_DISTANCE * length_unit);
        let mut reach = prediction;
        while reach > least && (reach > trusted || 0.5 * reach >= needed) {
            reach *= 0.5;
        }
        Self { prediction: reach.max(least), length_unit }
    }
}

impl From<f32> for Reach {
    /// A prediction distance, among bodies of about a metre.
    fn from(prediction: f32) -> Self {
        Self { prediction, length_unit: 1.0 }
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
        let large = Reach { prediction: 2.0, length_unit: 100.0 };
        assert_eq!([0.0, 7.0, 20.0].map(|way| large.of_pair(way).prediction), [0.5, 0.125, 0.1]);
    }
}
