//! Motion of bodies in a step of rapier.

use std::f32::consts::PI;

use glam::Vec3;

use crate::{
    constants::AXIS_ASTRAY,
    geometry::{Pose3, Sweep},
};

/// Returns the motion of a dynamic body from one pose to another. `turn`: its angular velocity times the length of the step, in radians.
///
/// If the body turns by more than half a turn, both poses do not determine the axis: after a contact has changed the spin within the step, the rotation between
/// the poses may have any axis. In this case the body turns at its final angular velocity, and the motion does not end at `end`.
pub(super) fn motion(start: Pose3, end: Pose3, center: Vec3, turn: Vec3) -> Sweep {
    let sweep = Sweep::between(start, end, center, turn);
    let [axis, spin] = [sweep.rotation, turn].map(Vec3::normalize_or_zero);
    let astray = turn.length() > PI && axis.cross(spin).length() > AXIS_ASTRAY;
    if astray { Sweep::at_rates(start, center, sweep.translation, turn) } else { sweep }
}
