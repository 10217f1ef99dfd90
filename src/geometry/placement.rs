use glam::{Mat3A, Vec3, Vec3A};
use glamx::Pose3;

use super::{Aabb, aabb::rotated_extents};

/// A pose as a matrix, to transform many points.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    rotation: Mat3A,
    translation: Vec3A,
}

impl Placement {
    /// The identity transform.
    pub const IDENTITY: Placement = Placement { rotation: Mat3A::IDENTITY, translation: Vec3A::ZERO };

    /// Maps a local point to the parent frame.
    #[inline]
    pub fn point(&self, point: Vec3) -> Vec3 {
        (self.rotation * Vec3A::from(point) + self.translation).into()
    }

    /// Maps a local vector to the parent frame.
    #[inline]
    pub fn vector(&self, vector: Vec3) -> Vec3 {
        self.rotation * vector
    }

    /// Returns a box in the parent frame that contains a local box.
    #[inline]
    pub fn aabb(&self, aabb: &Aabb) -> Aabb {
        let (center, half) = (self.point(aabb.center()), rotated_extents(&self.rotation, aabb.half_extents()));
        Aabb { min: center - half, max: center + half }
    }
}

impl From<Pose3> for Placement {
    fn from(pose: Pose3) -> Self {
        Self { rotation: Mat3A::from_quat(pose.rotation), translation: pose.translation.into() }
    }
}
