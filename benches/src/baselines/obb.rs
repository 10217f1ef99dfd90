//! Oriented boxes.

use bevy_medial::{
    geometry::{Aabb, Obb, Pose3, Sphere},
    pipeline::Hull,
};
use glam::{Mat3, Quat, Vec3};

use super::tree::{Motion, Volume, spheres};

/// A box that moves on a line and keeps its orientation. It is large enough for the rotation of its content.
#[derive(Clone, Copy)]
pub struct MovingObb {
    /// Middle at the start.
    start: Vec3,
    motion: Vec3,
    axes: Mat3,
    half: Vec3,
}

impl MovingObb {
    /// The box around its whole path.
    fn swept(&self) -> Self {
        let half = self.half + (self.axes.transpose() * self.motion).abs() * 0.5;
        Self { start: self.start + self.motion * 0.5, motion: Vec3::ZERO, axes: self.axes, half }
    }
}

impl Volume for MovingObb {
    type Local = Obb;
    type Fixed = Self;

    fn fit(hulls: &[Hull]) -> Obb {
        let spheres: Vec<Sphere> = hulls.iter().flat_map(spheres).copied().collect();
        let [one, other] = starts(&spheres).map(|start| descend(&spheres, start));
        if surface(&one) <= surface(&other) { one } else { other }
    }

    fn refit(local: &Obb, motion: &Motion, _: Option<[&Self; 2]>) -> Self {
        let center = local.pose.translation;
        let [start, end] = motion.ends(center);
        // Relative to the orientation in the middle of the step, a corner turns by half of the angle in each direction.
        let turned = (0.5 * motion.angle).min(2.0) * local.half_extents.length();
        Self {
            start,
            motion: end - start,
            axes: Mat3::from_quat(motion.middle * local.pose.rotation),
            half: local.half_extents + (turned + motion.sagitta(center)),
        }
    }

    fn fixed(obb: &Obb) -> Self {
        let axes = Mat3::from_quat(obb.pose.rotation);
        Self { start: obb.pose.translation, motion: Vec3::ZERO, axes, half: obb.half_extents }
    }

    fn aabb(&self) -> Aabb {
        let Self { start, axes, half, .. } = self.swept();
        let reach = axes.x_axis.abs() * half.x + axes.y_axis.abs() * half.y + axes.z_axis.abs() * half.z;
        Aabb { min: start - reach, max: start + reach }
    }

    fn size(&self) -> f32 {
        self.half.length_squared()
    }

    /// Separating axes: two boxes are separated at an instant if their projections on one of 15 directions are. They meet if there is an instant at
    /// which no direction separates them.
    fn meets(&self, other: &Self, margin: f32) -> bool {
        let to_own = self.axes.transpose();
        let offset = to_own * (other.start - self.start);
        let motion = to_own * (other.motion - self.motion);
        // The axes of the other box. A small value is added, because cross products of parallel axes vanish.
        let turn = to_own * other.axes;
        let spread = Mat3::from_cols(turn.x_axis.abs(), turn.y_axis.abs(), turn.z_axis.abs());
        let spread = spread + Mat3::from_cols_array(&[1e-6; 9]);
        let half = self.half + margin;
        let (mut enter, mut leave) = (0.0f32, 1.0f32);
        let mut meet = |offset: f32, motion: f32, reach: f32| {
            let end = offset + motion;
            if offset.min(end) > reach || offset.max(end) < -reach {
                return false;
            }
            if motion.abs() > 1e-6 {
                let (one, other) = ((-reach - offset) / motion, (reach - offset) / motion);
                enter = enter.max(one.min(other));
                leave = leave.min(one.max(other));
            }
            enter <= leave
        };
        let own = spread * other.half;
        let theirs = spread.transpose() * half;
        for axis in 0..3 {
            if !meet(offset[axis], motion[axis], half[axis] + own[axis]) {
                return false;
            }
        }
        for axis in 0..3 {
            let direction = turn.col(axis);
            if !meet(offset.dot(direction), motion.dot(direction), theirs[axis] + other.half[axis]) {
                return false;
            }
        }
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            for axis in 0..3 {
                let (m, n) = ((axis + 1) % 3, (axis + 2) % 3);
                let (direction, width) = (turn.col(axis), spread.col(axis));
                let along = |v: Vec3| v[k] * direction[j] - v[j] * direction[k];
                let reach1 = half[j] * width[k] + half[k] * width[j];
                let reach2 = other.half[m] * spread.col(n)[i] + other.half[n] * spread.col(m)[i];
                if !meet(along(offset), along(motion), reach1 + reach2) {
                    return false;
                }
            }
        }
        true
    }

    fn meets_whenever(&self, other: &Self, margin: f32) -> bool {
        self.swept().meets(&other.swept(), margin)
    }

    fn meets_fixed(&self, fixed: &Self, margin: f32) -> bool {
        self.meets(fixed, margin)
    }
}

/// The smallest box of an orientation around spheres.
fn oriented_box(spheres: &[Sphere], rotation: Quat) -> Obb {
    let back = rotation.inverse();
    let aabb = Aabb::from_spheres(spheres.iter().map(|s| Sphere::new(back * s.center, s.radius)));
    Obb { pose: Pose3::from_parts(rotation * aabb.center(), rotation), half_extents: aabb.half_extents() }
}

/// Initial orientations: that of the frame, and one with an axis along spheres that are far apart.
fn starts(spheres: &[Sphere]) -> [Quat; 2] {
    let farthest = |from: Vec3| {
        let centers = spheres.iter().map(|sphere| sphere.center);
        centers.max_by(|a, b| from.distance(*a).total_cmp(&from.distance(*b))).unwrap_or(from)
    };
    let first = farthest(Aabb::from_spheres(spheres.iter().copied()).center());
    let along = (farthest(first) - first).normalize_or(Vec3::X);
    [Quat::IDENTITY, Quat::from_rotation_arc(Vec3::X, along)]
}

/// Searches for the box of smallest surface: rotates it about its own axes in both directions, by smaller and smaller angles.
fn descend(spheres: &[Sphere], start: Quat) -> Obb {
    let mut best = oriented_box(spheres, start);
    for angle in [0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01] {
        for axis in [1.0, -1.0].map(|side| Vec3::AXES.map(|axis| axis * side)).as_flattened().repeat(3) {
            let rotation = (best.pose.rotation * Quat::from_axis_angle(axis, angle)).normalize();
            let turned = oriented_box(spheres, rotation);
            if surface(&turned) < surface(&best) {
                best = turned;
            }
        }
    }
    best
}

/// An eighth of a box's surface.
fn surface(obb: &Obb) -> f32 {
    let half = obb.half_extents;
    half.dot(Vec3::new(half.y, half.z, half.x))
}
