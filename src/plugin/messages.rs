use bevy::prelude::*;

/// Place and time of the touch of two bodies.
#[derive(Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct TouchPoint {
    /// Time as a fraction of the step: that of the impact, or 1 for a contact at the end of the step.
    pub fraction: f32,
    /// Point of the touch, in the world.
    pub point: Vec3,
    /// Unit normal from the first entity to the second, in the world.
    pub normal: Vec3,
    /// Distance along the normal at the end of the step, in metres. It is 0 at an impact, and negative for the depth of an overlap.
    pub separation: f32,
    /// Approach speed of the bodies along the normal at the point, before the step, in metres per second. It is negative if they move apart.
    pub approach_speed: f32,
    /// Index of the touching primitive of the first entity's shape.
    pub primitive1: u32,
    /// Index of the touching primitive of the second entity's shape. For a collider that is not medial it is the index of the part, such as a
    /// triangle, or 0 for a single part.
    pub primitive2: u32,
    /// The joint with the largest weight at the point, if the first entity has a [`SkinnedMedialMesh`](super::SkinnedMedialMesh).
    pub joint1: Option<Entity>,
    /// The same for the second entity.
    pub joint2: Option<Entity>,
}

impl TouchPoint {
    /// The same touch from the second entity's side.
    pub(crate) fn swapped(self) -> Self {
        let Self { primitive1, primitive2, joint1, joint2, .. } = self;
        let (primitive1, primitive2, joint1, joint2) = (primitive2, primitive1, joint2, joint1);
        Self { normal: -self.normal, primitive1, primitive2, joint1, joint2, ..self }
    }
}

/// Two bodies have begun to touch. It is sent once, in the step in which they first come within [`LINEAR_SLOP`](crate::constants::LINEAR_SLOP)
/// of each other or have an impact, however short.
///
/// It is written as a message once for the pair. It is also triggered as an event on each of the two entities, with the observed entity first. The event
/// propagates to the ancestors of the entity, so a body observes the contacts of its child colliders. A global observer receives it at each of them;
/// `On::original_event_target` is the collider. Observers run after rapier has written back poses and velocities, so their changes take effect in the
/// next step.
///
/// It is sent for bodies whose groups, hooks and types let them collide, as rapier's own events are. It is also sent for kinematic bodies and the
/// bodies that they pass through, regardless of their `ActiveCollisionTypes`.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands
///         .spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.medial"))))
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
#[entity_event(propagate, auto_propagate)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct MedialContactStarted {
    /// The first entity: a collider with a medial mesh, on a body or fixed. For an observer: the observed entity, which may be an ancestor of the collider.
    #[event_target]
    pub entity1: Entity,
    /// The second entity: another such collider, or any other collider. For an observer: the other entity.
    pub entity2: Entity,
    /// The rigid body of the first collider, which may be the same entity. `None` for a collider without a rigid body.
    pub body1: Option<Entity>,
    /// The rigid body of the second collider.
    pub body2: Option<Entity>,
    /// Place and time of the touch.
    pub touch: TouchPoint,
    /// True if one of them is a sensor.
    pub sensor: bool,
}

impl MedialContactStarted {
    /// The same message from the second entity's side.
    pub(crate) fn swapped(self) -> Self {
        let Self { entity1, entity2, body1, body2, touch, sensor } = self;
        Self { entity1: entity2, entity2: entity1, body1: body2, body2: body1, touch: touch.swapped(), sensor }
    }
}

/// Two bodies have ceased to touch: no contact is found within the search distance of [such a pair](crate::pipeline::ContactMargin::of_pair), they may not
/// collide, or one of them is gone. It is sent once for each [`MedialContactStarted`], as a message and as an event on those of the two entities that
/// still exist.
#[derive(Message, EntityEvent, Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[entity_event(propagate, auto_propagate)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Clone, PartialEq)]
pub struct MedialContactEnded {
    /// The first entity. It may have been despawned. For an observer: the observed entity.
    #[event_target]
    pub entity1: Entity,
    /// The second entity. It may have been despawned. For an observer: the other entity.
    pub entity2: Entity,
    /// The rigid body of the first collider when the touch began. `None` for a collider without a rigid body.
    pub body1: Option<Entity>,
    /// The rigid body of the second collider when the touch began.
    pub body2: Option<Entity>,
}

impl MedialContactEnded {
    /// The same message from the second entity's side.
    pub(crate) fn swapped(self) -> Self {
        Self { entity1: self.entity2, entity2: self.entity1, body1: self.body2, body2: self.body1 }
    }
}
