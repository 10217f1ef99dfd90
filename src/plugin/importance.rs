use bevy::{ecs::query::QueryData, prelude::*};

use super::{MedialBudget, MedialMesh, SkinnedMedialMesh, StaticObb};
use crate::medial_axis::MedialAxis;

/// Accuracy of an entity's shape relative to others with the same budget: its error may be [`MedialBudget`] divided by this value.
///
/// A value of 2 halves the permitted error, and 0.1 allows ten times as much. A value that is not a positive number counts as 1. Default: 1.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
pub struct MedialImportance(pub f32);

impl Default for MedialImportance {
    fn default() -> Self {
        Self(1.0)
    }
}

/// A point of interest, such as a camera or a player. Medial bodies that have no [`StaticObb`] and are farther than `near` metres from every such
/// point may have a larger error. The error grows in proportion to the distance, because it looks the same from there.
///
/// A body changes its level of detail only after its distance has changed by a fifth. It needs no [`MedialImportance`]; with one, both apply.
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize), reflect(Serialize, Deserialize))]
#[reflect(Component, Default, Clone, PartialEq)]
#[require(Transform)]
pub struct MedialFocus {
    /// Distance in metres up to which bodies have the error of their budget. Default: 10.
    pub near: f32,
}

impl Default for MedialFocus {
    fn default() -> Self {
        Self { near: 10.0 }
    }
}

/// Factor on a body's importance due to its distance from points of interest, from 0 to 1.
#[derive(Component, Clone, Copy, Debug)]
pub(crate) struct Nearness(f32);

impl Nearness {
    /// Returns true for a body that is farther than the distance `near` from every point of interest.
    pub fn is_far(&self) -> bool {
        self.0 < 1.0
    }
}

/// Smallest ratio between two values of [`Nearness`] that counts as a change.
const HYSTERESIS: f32 = 1.2;

/// Components that determine the accuracy of an entity's shape.
#[derive(QueryData)]
pub(crate) struct Detail {
    budget: Option<&'static MedialBudget>,
    importance: Option<&'static MedialImportance>,
    nearness: Option<&'static Nearness>,
}

impl DetailItem<'_, '_> {
    /// Returns the number of the level of detail to use for a body of a scale.
    pub fn level(&self, axis: &MedialAxis, scale: f32) -> usize {
        let weight = self.importance.map_or(1.0, |importance| importance.0);
        let weight = if weight > 0.0 && weight.is_finite() { weight } else { 1.0 };
        let nearness = self.nearness.map_or(1.0, |nearness| nearness.0);
        self.budget.copied().unwrap_or_default().over(weight * nearness).level(axis, scale)
    }
}

/// Updates how near bodies are to points of interest.
pub(crate) fn look_from_focuses(
    mut commands: Commands,
    focuses: Query<(Entity, &MedialFocus)>,
    bodies: Query<
        (Entity, &GlobalTransform, Option<&Nearness>, Has<StaticObb>),
        Or<(With<MedialMesh>, With<SkinnedMedialMesh>)>,
    >,
    hierarchy: TransformHelper,
) {
    // The `GlobalTransform` of a new entity has not been propagated yet.
    let place = |entity| hierarchy.compute_global_transform(entity).map_or(Vec3::ZERO, |place| place.translation());
    let focuses: Vec<(f32, Vec3)> = focuses.iter().map(|(entity, focus)| (focus.near, place(entity))).collect();
    for (entity, known_place, known, is_static) in &bodies {
        let at = if known.is_some() { known_place.translation() } else { place(entity) };
        let nearness = focuses
            .iter()
            .map(|(near, from)| near / from.distance(at).max(*near))
            .fold(None, |best: Option<f32>, nearness| Some(best.map_or(nearness, |best| best.max(nearness))))
            .filter(|nearness| *nearness > 0.0 && !is_static);
        match (nearness, known) {
            (Some(now), Some(Nearness(before))) if (now / before).max(before / now) < HYSTERESIS && now < 1.0 => {}
            (Some(now), known) if known.is_none_or(|known| known.0 != now) => {
                commands.entity(entity).try_insert(Nearness(now));
            }
            (None, Some(_)) => {
                commands.entity(entity).try_remove::<Nearness>();
            }
            _ => {}
        }
    }
}
