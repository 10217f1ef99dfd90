use bevy::prelude::*;

use crate::medial_axis::MedialAxis;

/// Makes an entity collide by its medial mesh: a handle to the shape that all instances share, of a `.ma` file, or of a `.medial` file with its
/// levels of detail.
///
/// Beside a `RigidBody` nothing else is needed: collider, mass and inertia appear when the asset has loaded. Without one it is a fixed collider, or,
/// on a child of a body, one of that body's shapes. The `Transform` may scale it uniformly.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands.spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.ma")), Transform::from_xyz(0.0, 5.0, 0.0)));
/// }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq, Eq, Deref, DerefMut, Reflect)]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct MedialMesh(pub Handle<MedialAxis>);

/// A static box, centred at the entity. Any scale will do.
///
/// Alone it is a solid box: a wall, a floor, a stair. On an entity that also has a [`MedialMesh`] it makes that shape
/// static: the shape's own box goes into the hierarchy of statics, and the extents given here do not count.
///
/// With rapier it is the `RigidBody` that says what is static: a box alone gets a fixed one, and an entity with another one goes by that.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct StaticObb {
    /// Half of the size along each of the box's own axes, in metres. Default: 0.5 each.
    pub half_extents: Vec3,
}

impl StaticObb {
    /// A box by its half extents in metres.
    pub fn new(x: f32, y: f32, z: f32) -> Self {
        Self { half_extents: Vec3::new(x, y, z) }
    }
}

impl Default for StaticObb {
    fn default() -> Self {
        Self { half_extents: Vec3::splat(0.5) }
    }
}

/// Whether a body stops at its first impact within a step. Without this component it does.
///
/// A pair stops only if both sides have it enabled. Otherwise a fast body can pass through the other; contacts and messages stay. It belongs on the
/// entity of the collider: of a body of several shapes, on each child that it is meant for.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialCcd {
    /// Default: true.
    pub enabled: bool,
    /// [`MedialSettings::core_depth`](super::MedialSettings::core_depth) of this body. Default: that of the settings.
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
