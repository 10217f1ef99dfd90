use glam::{Mat3A, Vec3, Vec3A};
use glamx::Pose3;

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
}

impl From<Pose3> for Placement {
    fn from(pose: Pose3) -> Self {
        Self { rotation: Mat3A::from_quat(pose.rotation), translation: pose.translation.into() }
    }
}
