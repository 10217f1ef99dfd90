//! The motion of a joint between two poses: it turns about an axis and moves along it at constant rates.

use bevy::math::Affine3A;
use glam::{Mat3, Mat3A, Quat, Vec3};

use crate::medial_axis::JointPose;

/// A joint's motion from one pose to the next. Joints that turn about a common point, such as those of a limb about its shoulder, all follow its arcs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Screw {
    ends: [JointPose; 2],
    /// Rotation of the whole motion: axis times angle in radians. `None` for a pose without a rotation, because its scale is 0 or mirrors.
    turn: Option<Vec3>,
}

impl Screw {
    pub fn new(ends: [JointPose; 2]) -> Self {
        let [start, end] = ends.map(|pose| rotation(&pose));
        let turn = start.zip(end).map(|(start, end)| {
            let turn = end * start.inverse();
            if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis()
        });
        Self { ends, turn }
    }

    /// Returns the rotation of the motion: axis times angle in radians.
    pub fn turn(&self) -> Vec3 {
        self.turn.unwrap_or_default()
    }

    /// Returns the angle of the motion in radians.
    pub fn angle(&self) -> f32 {
        self.turn().length()
    }

    /// Returns the pose at a fraction of the motion.
    ///
    /// The motion maps a point `x` to `R x + d`. With `d = V(turn) u`, the motion up to a fraction `f` has the rotation `f turn` and the displacement
    /// `V(f turn) f u`.
    pub fn at(&self, fraction: f32) -> JointPose {
        let [start, end] = self.ends.map(|pose| pose.transform);
        let mix = |a: f32, b: f32| a + (b - a) * fraction;
        let Some(turn) = self.turn else {
            let matrix3 = start.matrix3 * (1.0 - fraction) + end.matrix3 * fraction;
            let translation = start.translation.lerp(end.translation, fraction);
            return JointPose::new(Affine3A { matrix3, translation });
        };
        let [from, to] = [start, end].map(|transform| Vec3::from(transform.translation));
        let whole = to - Quat::from_scaled_axis(turn) * from;
        let rate = drift(turn).inverse() * whole;
        let part = Quat::from_scaled_axis(turn * fraction);
        let scale = mix(self.ends[0].scale, self.ends[1].scale);
        let matrix3 = Mat3A::from_quat(part) * start.matrix3 * (scale / self.ends[0].scale);
        let translation = part * from + drift(turn * fraction) * (rate * fraction);
        JointPose { transform: Affine3A { matrix3, translation: translation.into() }, scale }
    }
}

/// Returns true if a joint turns by more than an angle in radians, below half a turn.
pub(super) fn turns_by_more([start, end]: [&JointPose; 2], angle: f32) -> bool {
    let [a, b] = [start, end].map(|pose| pose.transform.matrix3);
    // The trace of a rotation by an angle is 1 + 2 cos(angle).
    let trace = a.x_axis.dot(b.x_axis) + a.y_axis.dot(b.y_axis) + a.z_axis.dot(b.z_axis);
    trace < (1.0 + 2.0 * angle.cos()) * start.scale * end.scale
}

/// Returns the rotation of a pose.
fn rotation(pose: &JointPose) -> Option<Quat> {
    let matrix = pose.transform.matrix3;
    (matrix.determinant() > 0.0).then(|| Quat::from_mat3a(&(matrix * pose.scale.recip())).normalize())
}

/// Returns the matrix `V` that maps the rate of a displacement to the displacement of a motion that turns meanwhile.
fn drift(turn: Vec3) -> Mat3 {
    let square = turn.length_squared();
    let cross = Mat3::from_cols(turn.cross(Vec3::X), turn.cross(Vec3::Y), turn.cross(Vec3::Z));
    // Below this angle the series are exact in f32.
    let [first, second] = if square < 1.0e-2 {
        [0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0]
    } else {
        let angle = square.sqrt();
        [(1.0 - angle.cos()) / square, (angle - angle.sin()) / (square * angle)]
    };
    Mat3::IDENTITY + cross * first + cross * cross * second
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn points_stay_on_the_arcs_about_a_common_point() {
        let mut random = Random(21);
        for case in 0..200 {
            let start = Affine3A::from_rotation_translation(random.rotation(), random.in_cube() * 2.0);
            let (shoulder, axis) = (random.in_cube(), random.in_cube().normalize());
            let angle = [1.0e-3, 0.05, 0.3, 2.5][case % 4];
            let about = |angle: f32| {
                let turn = Affine3A::from_quat(Quat::from_axis_angle(axis, angle));
                Affine3A::from_translation(shoulder) * turn * Affine3A::from_translation(-shoulder) * start
            };
            let screw = Screw::new([start, about(angle)].map(JointPose::new));
            assert!((screw.angle() - angle).abs() < 1e-5);
            let ends = [start, about(angle)].map(JointPose::new);
            // The trace of a small rotation is rounded.
            for (factor, is_more) in [(0.9, true), (1.1, false)].into_iter().filter(|_| angle > 0.1) {
                assert_eq!(turns_by_more([&ends[0], &ends[1]], factor * angle), is_more, "case {case}");
            }
            let point = random.in_cube();
            for fraction in [0.0, 0.25, 0.7, 1.0] {
                let found = screw.at(fraction).transform.transform_point3(point);
                let expected = about(angle * fraction).transform_point3(point);
                assert!(found.distance(expected) < 3e-5, "case {case}: {found} instead of {expected}");
            }
        }
    }

    #[test]
    fn scales_are_mixed_and_a_vanished_joint_moves_on_a_line() {
        let [small, large] = [1.0, 3.0].map(|scale| JointPose::new(Affine3A::from_scale(Vec3::splat(scale))));
        let half = Screw::new([small, large]).at(0.5);
        assert!(
            (half.scale - 2.0).abs() < 1e-6 && half.transform.transform_point3(Vec3::X).distance(Vec3::X * 2.0) < 1e-6
        );
        let gone = JointPose::new(Affine3A::from_scale_rotation_translation(Vec3::ZERO, Quat::IDENTITY, Vec3::X));
        let half = Screw::new([gone, small]).at(0.5);
        assert!(
            half.transform.is_finite() && half.transform.transform_point3(Vec3::ZERO).distance(Vec3::X * 0.5) < 1e-6
        );
    }
}
