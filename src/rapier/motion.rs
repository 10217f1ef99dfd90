//! How bodies have moved in a step of rapier.

use std::f32::consts::PI;

use glam::Vec3;

use crate::{
    constants::AXIS_ASTRAY,
    geometry::{Pose3, Sweep},
};

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
