use bevy::{platform::collections::HashSet, prelude::*};

use super::MedialMesh;
use crate::medial_axis::MedialAxis;

/// The error that a body's shape may have, if its asset has levels of detail, as assets from `.medial` files do. The coarsest level within the error
/// is used, or the finest if no level is within it. Default without this component: 1 % of the diagonal.
///
/// A `.ma` file has a single level, so no budget has an effect on it. The log warns once about each such file.
///
/// It may be changed at any time, for example by the distance to the camera. The mass stays that of the finest level.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// # use bevy_rapier3d::prelude::RigidBody;
/// fn spawn(mut commands: Commands, assets: Res<AssetServer>) {
///     commands.spawn((RigidBody::Dynamic, MedialMesh(assets.load("models/bear.medial")), MedialBudget::Metres(0.02)));
/// }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub enum MedialBudget {
    /// In metres, in the world. The larger the body, the finer its shape.
    Metres(f32),
    /// In percent of the diagonal of the finest level's bounding box. Default: 1.
    Percent(f32),
}

impl Default for MedialBudget {
    fn default() -> Self {
        Self::Percent(1.0)
    }
}

impl MedialBudget {
    /// Returns the number of the level of detail to use for a body of a scale. A budget that is negative or not a number counts as the default.
    pub fn level(self, axis: &MedialAxis, scale: f32) -> usize {
        let error = match if self.is_valid() { self } else { Self::default() } {
            Self::Metres(metres) => metres / scale,
            Self::Percent(percent) => percent / 100.0 * 2.0 * axis.aabb().half_extents().length(),
        };
        axis.level_within(error)
    }

    /// The budget of a body whose importance has this value.
    pub(super) fn over(self, importance: f32) -> Self {
        match self {
            Self::Metres(metres) => Self::Metres(metres / importance),
            Self::Percent(percent) => Self::Percent(percent / importance),
        }
    }

    fn is_valid(self) -> bool {
        let (Self::Metres(value) | Self::Percent(value)) = self;
        value >= 0.0
    }
}

/// The level of detail with which an entity collides; 0 is the finest. It is added with the shape and is written by the plugin only.
///
/// An observer of `On<Add, MedialLevel>` runs when a body gets its shape, for example after its file is loaded. Before that, the body has the `Collider`
/// that the user has given it, or it stands still.
///
/// [`MedialAxis::level`] returns its shape. The primitives of a [`TouchPoint`](super::TouchPoint) are primitives of that shape.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialLevel(pub usize);

/// Logs each invalid budget once.
pub(super) fn check_budgets(budgets: Query<(NameOrEntity, &MedialBudget), Changed<MedialBudget>>) {
    for (name, budget) in budgets.iter().filter(|(_, budget)| !budget.is_valid()) {
        error!(
            "{name}: MedialBudget::{budget:?} is not a valid error, so {:?} is used; give it a number from 0 up",
            MedialBudget::default()
        );
    }
}

/// Warns once about each file whose shape has no levels of detail.
pub(super) fn check_levels(
    shapes: Query<&MedialMesh, Added<MedialLevel>>,
    mut known: Local<HashSet<AssetId<MedialAxis>>>,
) {
    for mesh in &shapes {
        let path = mesh.0.path().filter(|path| path.path().extension().is_some_and(|extension| extension == "ma"));
        if let Some(path) = path.filter(|_| known.insert(mesh.0.id())) {
            let levels = path.path().with_extension("medial");
            warn!(
                "{path}: a .ma file has no levels of detail, so a MedialBudget has no effect; \
                 write them with `medial build MESH -o {}` and load this file",
                levels.display()
            );
        }
    }
}
