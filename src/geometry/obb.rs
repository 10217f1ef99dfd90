use glam::Vec3;
use glamx::Pose3;

use super::{Aabb, aabb::rotated_extents};

/// Oriented box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obb {
    /// Pose of the middle.
    pub pose: Pose3,
    /// Half of the size along each of the box's own axes, in metres.
    pub half_extents: Vec3,
}

impl Obb {
    /// The box around it.
    pub fn aabb(&self) -> Aabb {
        let half = rotated_extents(self.pose.rotation, self.half_extents);
        Aabb { min: self.pose.translation - half, max: self.pose.translation + half }
    }
}
