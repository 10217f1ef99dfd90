use bevy::{ecs::system::SystemParam, prelude::*};

use super::{MedialStep, TouchPoint, report::contact_points};
use crate::pipeline::Pair;

/// The contacts of the last step, by entity.
///
/// Pairs of sleeping bodies are not searched, so their contacts are missing. Rapier has the impulses of contacts:
/// `ReadRapierContext` and its method `contact_pair`.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::prelude::*;
/// #[derive(Component)]
/// struct Player;
///
/// fn stand(player: Single<Entity, With<Player>>, contacts: MedialContacts) {
///     let mut points = contacts.of(*player).flat_map(|pair| pair.points());
///     if points.any(|point| point.normal.y < -0.7 && point.separation < 0.01) {
///         info!("the player stands");
///     }
/// }
/// ```
#[derive(SystemParam)]
pub struct MedialContacts<'w> {
    step: Res<'w, MedialStep>,
}

impl MedialContacts<'_> {
    /// Returns all pairs of colliders with contacts.
    pub fn iter(&self) -> impl Iterator<Item = MedialContactPair<'_>> {
        let pairs = self.step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty());
        pairs.map(|pair| MedialContactPair::new(&self.step, pair))
    }

    /// Returns the pairs of an entity, which is a collider or a rigid body. The entity is on the first side of each pair.
    pub fn of(&self, entity: Entity) -> impl Iterator<Item = MedialContactPair<'_>> {
        self.iter().filter_map(move |pair| {
            let is_first = |pair: &MedialContactPair| pair.entity1 == entity || pair.body1 == Some(entity);
            [pair, pair.swapped()].into_iter().find(is_first)
        })
    }
}

/// Two colliders with contacts, from [`MedialContacts`].
#[derive(Clone, Copy)]
pub struct MedialContactPair<'a> {
    /// The first collider.
    pub entity1: Entity,
    /// The second collider.
    pub entity2: Entity,
    /// The rigid body of the first collider, which may be the same entity. `None` for a collider without a rigid body.
    pub body1: Option<Entity>,
    /// The rigid body of the second collider.
    pub body2: Option<Entity>,
    step: &'a MedialStep,
    pair: &'a Pair,
    is_swapped: bool,
}

impl<'a> MedialContactPair<'a> {
    fn new(step: &'a MedialStep, pair: &'a Pair) -> Self {
        let [first, second] = [pair.first, pair.second].map(|side| step.info(side));
        let (entity1, entity2) = (first.entity, second.entity);
        Self { entity1, entity2, body1: first.body, body2: second.body, step, pair, is_swapped: false }
    }

    fn swapped(self) -> Self {
        let Self { entity1, entity2, body1, body2, is_swapped, .. } = self;
        Self { entity1: entity2, entity2: entity1, body1: body2, body2: body1, is_swapped: !is_swapped, ..self }
    }

    /// Returns the contacts at the end of the step. Normals point from the first collider to the second.
    pub fn points(self) -> impl Iterator<Item = TouchPoint> + use<'a> {
        let is_swapped = self.is_swapped;
        contact_points(self.step, self.pair).map(move |point| if is_swapped { point.swapped() } else { point })
    }
}
