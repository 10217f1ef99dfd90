use glam::{Mat3A, Vec3};
use glamx::Pose3;

use super::{Aabb, aabb::rotated_extents};

/// Oriented box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obb {
    /// Pose of the centre.
    pub pose: Pose3,
    /// Half of the size along each of the box's own axes, in metres.
    pub half_extents: Vec3,
}

impl Obb {
    /// The axis-aligned box around this box.
    pub fn aabb(&self) -> Aabb {
        let half = rotated_extents(&Mat3A::from_quat(self.pose.rotation), self.half_extents);
        Aabb { min: self.pose.translation - half, max: self.pose.translation + half }
    }
}

/// Centre and half extents of the part of a box `[-half, half]` that is relevant for shapes inside `reach`.
///
/// The part ends at the box's own faces, or at the width of `reach` beyond `reach`. Deep inside, this width is at least twice the distance to the nearest
/// face, so that a cut is never nearer than the box's own face. Coordinates relative to the part are then of the size of the shapes near it,
/// however large the box is: contacts of a pebble on a plain are computed as accurately as between pebbles.
pub(crate) fn part_within(half: Vec3, reach: &Aabb) -> (Vec3, Vec3) {
    let depth = (half - reach.max).min(half + reach.min).min_element();
    let width = (reach.max - reach.min).max_element().max(2.0 * depth);
    let thickness = (half * 2.0).min(Vec3::splat(width));
    let min = (reach.min - width).clamp(-half, half - thickness);
    let max = (reach.max + width).clamp(thickness - half, half);
    ((min + max) * 0.5, (max - min) * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_ends_with_the_box_or_out_of_reach() {
        let half = Vec3::new(100.0, 1.0, 0.1);
        for (reach, expected) in [
            // Above the centre of the top face: the top face stays, the distant sides are cut off.
            (
                Aabb { min: Vec3::new(-0.5, 1.1, -0.5), max: Vec3::new(0.5, 2.1, 0.5) },
                [[-1.5, 0.0, -0.1], [1.5, 1.0, 0.1]],
            ),
            // Beyond a side: this side stays.
            (
                Aabb { min: Vec3::new(101.0, 0.0, 0.0), max: Vec3::new(102.0, 1.0, 1.0) },
                [[99.0, -1.0, -0.1], [100.0, 1.0, 0.1]],
            ),
            // Deep inside: the nearest side stays, and the cuts are farther away.
            (
                Aabb { min: Vec3::new(60.0, -0.005, -0.005), max: Vec3::new(60.01, 0.005, 0.005) },
                [[59.81, -0.195, -0.1], [60.2, 0.195, 0.1]],
            ),
            // Larger than the box: the whole box stays.
            (Aabb { min: Vec3::splat(-200.0), max: Vec3::splat(200.0) }, [[-100.0, -1.0, -0.1], [100.0, 1.0, 0.1]]),
        ] {
            let (center, part) = part_within(half, &reach);
            let found = [center - part, center + part];
            for (found, expected) in found.iter().zip(expected) {
                assert!(found.distance(Vec3::from(expected)) < 1e-5, "{found} instead of {expected:?}");
            }
        }
    }
}
