use bevy::{ecs::system::SystemParam, prelude::*};

use super::{MedialStep, TouchPoint, report::contact_points};

/// The contacts of the last step, by entity.
///
/// Pairs of sleeping bodies are not searched, so their contacts are missing.
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
        let pairs = self.step.output.pairs.iter().enumerate().filter(|(_, pair)| !pair.manifolds.is_empty());
        pairs.map(|(number, _)| MedialContactPair::new(&self.step, number))
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
    /// Index of the pair in the output of the step.
    number: usize,
    is_swapped: bool,
}

impl<'a> MedialContactPair<'a> {
    fn new(step: &'a MedialStep, number: usize) -> Self {
        let pair = &step.output.pairs[number];
        let [first, second] = [pair.first, pair.second].map(|side| step.info(side));
        let (entity1, entity2) = (first.entity, second.entity);
        Self { entity1, entity2, body1: first.body, body2: second.body, step, number, is_swapped: false }
    }

    fn swapped(self) -> Self {
        let Self { entity1, entity2, body1, body2, is_swapped, .. } = self;
        Self { entity1: entity2, entity2: entity1, body1: body2, body2: body1, is_swapped: !is_swapped, ..self }
    }

    /// Returns the contacts at the end of the step. Normals point from the first collider to the second.
    pub fn points(self) -> impl Iterator<Item = TouchPoint> + use<'a> {
        let is_swapped = self.is_swapped;
        let pair = &self.step.output.pairs[self.number];
        contact_points(self.step, pair).map(move |point| if is_swapped { point.swapped() } else { point })
    }

    /// Returns the impulse that rapier's solver has given to the second collider's body in the last step, in newton seconds, in the world. The first
    /// body has got the opposite impulse.
    ///
    /// It is the sum over all contacts along their normals, without friction, as in rapier's `ContactForceEvent`. Rapier includes the impulse with which
    /// its solver starts. So it is a quarter too large for bodies at rest with four solver iterations. It is zero if the contacts are new. If rapier has
    /// simulated several steps or substeps, it is that of the last one.
    #[cfg(feature = "rapier")]
    pub fn impulse(self) -> Vec3 {
        let impulse = self.step.impulses.get(self.number).copied().unwrap_or_default();
        if self.is_swapped { -impulse } else { impulse }
    }
}
