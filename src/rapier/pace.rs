//! How far bodies go in a step, in their own sizes.
//!
//! Rapier keeps normals and lever arms of contacts for a whole step, which is next to exact for bodies that hardly move in it. Fast ones need finer
//! solver steps, see [`substeps`](super::substeps), and no contacts at a distance: the solver would stop them there, whether they come to
//! touch or turn away and pass. Their impacts are found by the sweep. What slides needs the contacts that will carry it next.

use std::f32::consts::PI;

use glam::Vec3;

use crate::{
    constants::AXIS_ASTRAY,
    geometry::{Pose3, Sweep},
    pipeline::{Pair, Side, contact::Reach},
    plugin::MedialStep,
};

/// What a collider moves by in a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Displacement of its body's centre of mass, in metres.
    way: Vec3,
    /// How far its farthest point goes by turning, in metres.
    turn: f32,
    /// Its bounding radius, in metres.
    radius: f32,
}

impl Pace {
    /// What does not move.
    pub const REST: Pace = Pace { way: Vec3::ZERO, turn: 0.0, radius: f32::INFINITY };

    /// The pace of a collider by its body's displacement in metres and turn in radians, and its bounding radius.
    pub fn new(way: Vec3, rotation: Vec3, radius: f32) -> Self {
        Self { way, turn: rotation.length() * radius, radius }
    }

    /// How far any point of one goes relative to the other at most, in metres.
    fn against(&self, other: &Self) -> f32 {
        self.way.distance(other.way) + self.turn + other.turn
    }

    /// Distance in metres up to which the solver is told of contacts.
    pub fn trusted_distance(&self, other: &Self, reach: Reach) -> f32 {
        reach.trusted(self.against(other))
    }
}

/// How far the sides of a pair have gone relative to each other in the last step, in radii of the smaller one.
pub(super) fn pace(step: &MedialStep, pair: &Pair) -> f32 {
    let [pace1, pace2] = [pair.first, pair.second].map(|side| {
        let Side::Body(body) = side else { return Pace::REST };
        let sweep = &step.input.bodies[body as usize].sweep;
        Pace::new(sweep.translation, sweep.rotation, step.solid(side).bounding_sphere().radius)
    });
    pace1.against(&pace2) / pace1.radius.min(pace2.radius)
}

/// How a dynamic body has moved from one pose to another, by its angular velocity times the step.
///
/// Beyond half a turn the poses do not tell it alone: what is left over whole turns may be about any axis, if a contact has changed the spin
/// within the step. Then the body goes on as it spins in the end, and ends elsewhere.
pub(super) fn motion(start: Pose3, end: Pose3, center: Vec3, turn: Vec3) -> Sweep {
    let sweep = Sweep::between(start, end, center, turn);
    let [axis, spin] = [sweep.rotation, turn].map(Vec3::normalize_or_zero);
    let astray = turn.length() > PI && axis.cross(spin).length() > AXIS_ASTRAY;
    if astray { Sweep::at_rates(start, center, sweep.translation, turn) } else { sweep }
}
