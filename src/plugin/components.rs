use bevy::prelude::*;

use crate::medial_axis::MedialAxis;

/// Makes an entity collide with its medial mesh. The handle refers to the shape that all instances share, from a `.ma` file, or from a `.medial` file
/// with levels of detail.
///
/// A body needs only this component and a `RigidBody`: collider, mass and inertia are added when the asset has loaded. Until then a dynamic body stands
/// still and keeps its velocity and all impulses, unless a `Collider` on it or on a child stands in for the shape. Without a `RigidBody` the
/// entity is a fixed collider, or, on a child of a body, one of that body's shapes. The `Transform` may scale it uniformly and
/// mirror it.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands.spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.medial")), Transform::from_xyz(0.0, 5.0, 0.0)));
/// }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Deref, DerefMut, Reflect)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct MedialMesh(pub Handle<MedialAxis>);

/// A static box, centred at the entity. Any scale is allowed.
///
/// Alone it is a solid box: a wall, a floor, a stair. On an entity that also has a [`MedialMesh`] it makes that shape static. The hierarchy of
/// statics then contains the shape's own bounding box, and the extents given here are ignored.
///
/// With rapier, the `RigidBody` decides whether an entity is static. A box without a `RigidBody` gets a fixed one, and another `RigidBody` on the
/// entity takes precedence.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct StaticObb {
    /// Half of the size along each of the box's own axes, in metres. Default: 0.5 each.
    pub half_extents: Vec3,
}

impl StaticObb {
    /// Creates a box from its size along each of its own axes, in metres.
    pub fn from_size(size: Vec3) -> Self {
        Self { half_extents: 0.5 * size }
    }

    /// Creates a box from its half extents in metres.
    pub fn new(x: f32, y: f32, z: f32) -> Self {
        Self { half_extents: Vec3::new(x, y, z) }
    }
}

impl Default for StaticObb {
    fn default() -> Self {
        Self { half_extents: Vec3::splat(0.5) }
    }
}

/// Whether a body stops at its first impact within a step. Without this component it stops.
///
/// A pair stops only if both sides have it enabled. Otherwise a fast body can pass through the other; contacts and messages stay. The component
/// belongs on the entity of the collider. For a body of several shapes, that is each child to which it applies.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialCcd {
    /// Default: true.
    pub enabled: bool,
    /// [`MedialSettings::core_depth`](super::MedialSettings::core_depth) of this body. Default: the value of the settings.
    pub core_depth: Option<f32>,
}

impl MedialCcd {
    /// The body never stops at an impact.
    pub const DISABLED: Self = Self { enabled: false, core_depth: None };
}

impl Default for MedialCcd {
    fn default() -> Self {
        Self { enabled: true, core_depth: None }
    }
}
