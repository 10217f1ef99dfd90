use bevy::prelude::*;

/// Where and how two bodies touch.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
pub struct TouchPoint {
    /// When, as a fraction of the step: that of their impact, or 1 where they touch gently, as found at its end.
    pub fraction: f32,
    /// Where, in the world.
    pub point: Vec3,
    /// Unit normal from the first entity to the second, in the world.
    pub normal: Vec3,
    /// Distance along the normal in metres at the end of the step, 0 at an impact; negative for the depth of an overlap.
    pub separation: f32,
    /// Speed in metres per second, before the step, at which the bodies close in along the normal there; negative if they part.
    pub approach_speed: f32,
    /// Which primitive of the first entity's shape touches.
    pub primitive1: u32,
    /// Which primitive of the second's; 0 for a box.
    pub primitive2: u32,
}

/// Two bodies have begun to touch: written once, in the step in which they first come within
/// [`TOUCH_DISTANCE`](crate::constants::TOUCH_DISTANCE) of each other or have an impact, however short.
#[derive(Message, Clone, Copy, Debug, PartialEq, Reflect)]
pub struct MedialContactStarted {
    /// The first entity: a body with a medial mesh.
    pub entity1: Entity,
    /// The second: another such body, or a static.
    pub entity2: Entity,
    /// Where and how.
    pub touch: TouchPoint,
    /// True if either of them is a sensor.
    pub sensor: bool,
}

/// Two bodies have ceased to touch: they are farther apart than the prediction distance, or one of them is gone. Written once for
/// each [`MedialContactStarted`].
#[derive(Message, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
pub struct MedialContactEnded {
    /// The first entity. It may have been despawned.
    pub entity1: Entity,
    /// The second. It may have been despawned.
    pub entity2: Entity,
}
