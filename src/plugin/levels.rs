use bevy::prelude::*;

use crate::medial_axis::MedialAxis;

/// The error that a body's shape may have, if its asset has levels of detail, as those of `.medial` files do: of the levels that are within
/// it the coarsest is used, or the finest if none is. Without this component: 1 % of the diagonal.
///
/// It may be changed at any time, say by the distance to the camera. The mass stays that of the finest level.
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
    /// In metres, in the world: the larger the body, the finer its shape.
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
    /// The number of the level of detail to use for a body of a scale. What is negative or not a number counts as the default.
    pub fn level(self, axis: &MedialAxis, scale: f32) -> usize {
        let error = match if self.is_valid() { self } else { Self::default() } {
            Self::Metres(metres) => metres / scale,
            Self::Percent(percent) => percent / 100.0 * 2.0 * axis.aabb().half_extents().length(),
        };
        axis.level_within(error)
    }

    /// The budget of what is so many times as important.
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

/// The level of detail by which an entity collides, 0 being the finest. It comes with the shape, and is there to be read.
///
/// [`MedialAxis::level`] gives its shape: that whose primitives a [`TouchPoint`](super::TouchPoint) names.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialLevel(pub usize);

/// Tells once of each budget that is none.
pub(super) fn check_budgets(budgets: Query<(NameOrEntity, &MedialBudget), Changed<MedialBudget>>) {
    for (name, budget) in budgets.iter().filter(|(_, budget)| !budget.is_valid()) {
        error!(
            "{name}: MedialBudget::{budget:?} is no error that a shape may have, so {:?} holds; give it a number from 0 up",
            MedialBudget::default()
        );
    }
}
