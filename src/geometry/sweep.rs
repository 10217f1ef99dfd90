use std::f32::consts::TAU;

use glam::{Quat, Vec3};
use glamx::Pose3;

use super::Aabb;

/// Rigid motion over one step: the centre of mass moves on a line, and the body rotates about it at a constant rate.
///
/// The start and end poses alone do not determine whole turns, so the rotation is stored as well.
/// Fractions run from 0 (start) to 1 (end).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Pose at fraction 0.
    pub start: Pose3,
    /// Pose at fraction 1, bit for bit.
    pub end: Pose3,
    /// Displacement of the centre of mass, in metres.
    pub translation: Vec3,
    /// Rotation over the step, in the parent frame: axis times angle in radians. May exceed a full turn.
    pub rotation: Vec3,
    /// Centre of mass in the body's frame.
    pub local_center: Vec3,
}

impl Sweep {
    /// A body at rest.
    pub fn at_rest(pose: Pose3) -> Self {
        Self { start: pose, end: pose, translation: Vec3::ZERO, rotation: Vec3::ZERO, local_center: Vec3::ZERO }
    }

    /// The motion from `start` to `end`. Among all rotations that end there, the one nearest to `rotation_hint` is used
    /// (axis times angle: angular velocity times step, or zero for the shortest rotation).
    pub fn between(start: Pose3, end: Pose3, local_center: Vec3, rotation_hint: Vec3) -> Self {
        let turn = end.rotation * start.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let shortest = turn.to_scaled_axis();
        let angle = shortest.length();
        // The axis of a rotation by (nearly) zero is undefined: whole turns use the axis of the hint.
        let axis = if angle > 1e-6 { shortest / angle } else { rotation_hint.normalize_or_zero() };
        let turns = ((rotation_hint.dot(axis) - angle) / TAU).round();
        Self {
            start,
            end,
            translation: end.transform_point(local_center) - start.transform_point(local_center),
            rotation: axis * (angle + turns * TAU),
            local_center,
        }
    }

    /// The motion from `start` at constant rates. `translation` is the displacement of the centre of mass in metres. `rotation` is the rotation about it:
    /// axis times angle in radians.
    pub fn at_rates(start: Pose3, local_center: Vec3, translation: Vec3, rotation: Vec3) -> Self {
        let mut sweep = Self { start, end: start, translation, rotation, local_center };
        sweep.end = sweep.integrated(1.0);
        sweep
    }

    /// Pose at `fraction`.
    pub fn pose_at(&self, fraction: f32) -> Pose3 {
        if fraction == 0.0 {
            return self.start;
        }
        if fraction == 1.0 {
            return self.end;
        }
        self.integrated(fraction)
    }

    fn integrated(&self, fraction: f32) -> Pose3 {
        let center = self.start.transform_point(self.local_center) + self.translation * fraction;
        let rotation = (Quat::from_scaled_axis(self.rotation * fraction) * self.start.rotation).normalize();
        Pose3::from_parts(center - rotation * self.local_center, rotation)
    }

    /// The part of the motion from `fraction` on.
    pub fn rest_from(&self, fraction: f32) -> Self {
        self.part([fraction, 1.0])
    }

    /// The part of the motion between two fractions.
    pub fn part(&self, [from, to]: [f32; 2]) -> Self {
        Self {
            start: self.pose_at(from),
            end: self.pose_at(to),
            translation: self.translation * (to - from),
            rotation: self.rotation * (to - from),
            ..*self
        }
    }

    /// True if the body does not move.
    pub fn is_at_rest(&self) -> bool {
        self.translation == Vec3::ZERO && self.rotation == Vec3::ZERO
    }

    /// The motion of a part that has the pose `local` in the body's frame.
    pub fn of_part(&self, local: &Pose3) -> Self {
        Self {
            start: self.start * *local,
            end: self.end * *local,
            local_center: local.inverse_transform_point(self.local_center),
            ..*self
        }
    }

    /// The same motion in the frame with the pose `frame`.
    pub fn seen_from(&self, frame: &Pose3) -> Self {
        let turn = frame.rotation.inverse();
        Self {
            start: frame.inv_mul(&self.start),
            end: frame.inv_mul(&self.end),
            translation: turn * self.translation,
            rotation: turn * self.rotation,
            local_center: self.local_center,
        }
    }

    /// A box in this body's frame around the relative motion of another body. It contains all points of the other body at all times at which they are within
    /// `radius` metres of this body's centre of mass. `aabb` is the other body's box in its own frame.
    ///
    /// In this body's frame a point strays from the chord between its start and end positions by at most `b / 8`. `b` is the largest acceleration `|x''|` for
    /// times from 0 to 1.
    pub fn view(&self, radius: f32, other: &Sweep, aabb: &Aabb) -> Aabb {
        let [start, end] = [(self.start, other.start), (self.end, other.end)]
            .map(|(own, other)| aabb.transformed(&own.inv_mul(&other), 1.0));
        let [turn, turn2] = [self, other].map(|sweep| sweep.rotation.length());
        let arm = aabb.center().distance(other.local_center) + aabb.half_extents().length();
        let speed = self.translation.distance(other.translation) + turn2 * arm;
        // Acceleration: rotation of the other body about its own centre of mass, Coriolis and centrifugal terms.
        let bend = turn2 * turn2 * arm + 2.0 * turn * speed + turn * turn * (radius + speed);
        start.merge(end).inflated(bend / 8.0)
    }

    /// Deviation of a point at the distance `radius` from the centre of mass from the chord of its arc: the sagitta, `radius (1 - cos(angle / 2))`.
    pub fn sagitta(&self, radius: f32) -> f32 {
        let half_angle = self.rotation.length() / 2.0;
        // 1 - cos x = 2 sin^2(x / 2), which avoids cancellation.
        let sin = (half_angle.min(std::f32::consts::PI) * 0.5).sin();
        2.0 * radius * sin * sin
    }

    /// Upper bound of the distance between the end of a point's path and the end of the line on which it begins, in metres: `radius angle^2 / 2`. The point is
    /// within `radius` of the centre of mass.
    pub(crate) fn turning(&self, radius: f32) -> f32 {
        0.5 * radius * self.rotation.length_squared()
    }

    /// Upper bound of the path length of a point within `radius` of the centre of mass, in metres.
    pub fn reach(&self, radius: f32) -> f32 {
        self.translation.length() + self.rotation.length() * radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn turning_bounds_the_distance_from_the_line_closely() {
        let mut random = Random(4);
        for _ in 0..1000 {
            let [angle, radius] = [(); 2].map(|()| 0.01 + 2.0 * random.unit());
            let axis = random.in_ball().normalize_or(Vec3::X);
            let sweep = Sweep::at_rates(Pose3::IDENTITY, Vec3::ZERO, random.in_cube(), axis * angle);
            let point = axis.any_orthonormal_vector() * radius;
            let line = point + sweep.translation + sweep.rotation.cross(point);
            let (distance, bound) = (sweep.end.transform_point(point).distance(line), sweep.turning(radius));
            assert!(distance < bound + 1e-5 && distance > 0.8 * bound - 1e-5, "{distance}, {bound}, {angle} rad");
        }
    }

    #[test]
    fn points_that_come_near_are_in_view() {
        let mut random = Random(9);
        let (mut near, mut bent, mut out_of_view) = (0, 0, 0);
        for case in 0..300 {
            let turn = [0.05, 0.5, 2.0][case % 3];
            let mut sweep = |distance: f32| {
                let start =
                    Pose3::from_parts(random.in_cube() * distance, Quat::from_scaled_axis(random.in_cube() * 3.0));
                Sweep::at_rates(start, random.in_cube() * 0.3, random.in_cube(), random.in_cube() * turn)
            };
            let (own, other) = (sweep(0.0), sweep(1.5));
            let half = random.in_cube().abs() * 0.4;
            let middle = random.in_cube() * 0.3;
            let aabb = Aabb { min: middle - half, max: middle + half };
            let view = own.view(1.0, &other, &aabb);
            let at = |time: f32| own.pose_at(time).inv_mul(&other.pose_at(time));
            let ends = [0.0, 1.0].map(|time| aabb.transformed(&at(time), 1.0));
            for _ in 0..20 {
                let point = aabb.min + 2.0 * half * Vec3::from_array([(); 3].map(|()| random.unit()));
                for time in (0..=16).map(|i| i as f32 / 16.0) {
                    let seen = at(time).transform_point(point);
                    let is_near = seen.distance(own.local_center) < 1.0;
                    assert!(!is_near || view.inflated(1e-5).contains_point(seen), "{seen} at {time} of case {case}");
                    near += usize::from(is_near);
                    bent += usize::from(is_near && !ends[0].merge(ends[1]).contains_point(seen));
                }
            }
            let corner = own.local_center + Vec3::splat(0.5);
            out_of_view += usize::from(!view.contains_point(corner));
        }
        assert!(near > 10_000 && bent > 100 && out_of_view > 50, "{near} {bent} {out_of_view}");
    }
}
