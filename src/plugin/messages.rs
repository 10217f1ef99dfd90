use bevy::prelude::*;

/// Where and how two bodies touch.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
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
    /// Which primitive of the second's; of a collider that is not medial which part, such as a triangle, and 0 for one of a single part.
    pub primitive2: u32,
}

impl TouchPoint {
    /// The same from the second entity's side.
    pub(crate) fn swapped(self) -> Self {
        Self { normal: -self.normal, primitive1: self.primitive2, primitive2: self.primitive1, ..self }
    }
}

/// Two bodies have begun to touch: told once, in the step in which they first come within
/// [`TOUCH_DISTANCE`](crate::constants::TOUCH_DISTANCE) of each other or have an impact, however short.
///
/// It is written as a message once for the pair, and triggered as an event on each of the two entities, on which it has the observed entity
/// first. Observers run after rapier has written back poses and velocities, so what they change holds in the next step.
///
/// It is told of bodies whose groups, hooks and types let them collide, as rapier's own events are; and of kinematic bodies and what they go
/// through, whatever their `ActiveCollisionTypes`.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands
///         .spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.ma"))))
///         .observe(|started: On<MedialContactStarted>| {
///             info!("the bear hit {} at {} m/s", started.entity2, started.touch.approach_speed);
///         });
/// }
///
/// fn read(mut started: MessageReader<MedialContactStarted>) {
///     for started in started.read() {
///         info!("{} touches {}", started.entity1, started.entity2);
///     }
/// }
/// ```
#[derive(Message, EntityEvent, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct MedialContactStarted {
    /// The first entity: that of a collider with a medial mesh, on a body or fixed. To an observer: the entity that it observes.
    #[event_target]
    pub entity1: Entity,
    /// The second: that of another such collider, or of any other. To an observer: the other one.
    pub entity2: Entity,
    /// Where and how.
    pub touch: TouchPoint,
    /// True if either of them is a sensor.
    pub sensor: bool,
}

impl MedialContactStarted {
    /// The same from the second entity's side.
    pub(crate) fn swapped(self) -> Self {
        Self { entity1: self.entity2, entity2: self.entity1, touch: self.touch.swapped(), ..self }
    }
}

/// Two bodies have ceased to touch: no contact of theirs is found any more, as far as contacts of [such a pair](crate::pipeline::Reach::of_pair) are
/// looked for, they may not collide, or one of them is gone.
/// Told once for each [`MedialContactStarted`], as a message and as an event on those of the two entities that still exist.
#[derive(Message, EntityEvent, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct MedialContactEnded {
    /// The first entity. It may have been despawned. To an observer: the entity that it observes.
    #[event_target]
    pub entity1: Entity,
    /// The second. It may have been despawned. To an observer: the other one.
    pub entity2: Entity,
}
