use glam::{Mat3, Vec3};
use glamx::Pose3;

/// A pose as a matrix, for placing many points.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Rotation.
    pub rotation: Mat3,
    /// Translation.
    pub translation: Vec3,
}

impl Placement {
    /// Where things are already.
    pub const IDENTITY: Placement = Placement { rotation: Mat3::IDENTITY, translation: Vec3::ZERO };

    /// The point in the parent frame.
    pub fn point(&self, point: Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }
}

impl From<Pose3> for Placement {
    fn from(pose: Pose3) -> Self {
        Self { rotation: Mat3::from_quat(pose.rotation), translation: pose.translation }
    }
}
