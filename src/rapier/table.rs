use std::{
    ops::Range,
    sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard},
};

use bevy::{platform::collections::HashMap, prelude::*};
use bevy_rapier3d::{parry::shape::Shape, plugin::context::RapierContextColliders};

use super::{parts::shape_id, shape::MedialShape};
use crate::{
    geometry::Pose3,
    pipeline::{CachedPair, ContactCache, ContactMargin, Displacement, Manifold},
};

/// The manifolds of the last step, by pair and relative pose, and the displacements of the bodies in the next step. The dispatcher reads it.
///
/// Manifolds depend on shapes, relative pose, reach and length unit, and those of fast bodies that are apart also on the motion. An entry is used for the same
/// shapes, pose and unit, and for about the same reach. It is missing if a body has been moved after the step.
///
/// Reflection shows the resource without its content, because the content consists of memory addresses.
#[derive(Resource, Clone, Default, Reflect)]
#[reflect(Resource, Default, Clone)]
pub struct ContactTable(#[reflect(ignore, clone)] Arc<RwLock<Entries>>);

/// Displacements of colliders in the next step, by shape.
pub(super) type Displacements = HashMap<SecondKey, Displacement>;

struct Entries {
    /// ContactMargin and range of manifolds of each pair.
    pairs: HashMap<PairKey, (ContactMargin, Range<usize>)>,
    manifolds: Vec<Manifold>,
    /// Displacements of awake bodies. The others are at rest.
    displacements: Displacements,
    /// Prediction distance of colliders without contact skin, in metres.
    prediction: f32,
    length_unit: f32,
}

impl Default for Entries {
    fn default() -> Self {
        let (pairs, manifolds, displacements) = Default::default();
        Self { pairs, manifolds, displacements, prediction: f32::INFINITY, length_unit: 1.0 }
    }
}

/// The key of a pair: its shapes and its relative pose.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct PairKey {
    first: u64,
    second: SecondKey,
    pose12: [u32; 7],
}

/// The second side of a pair.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum SecondKey {
    Medial(u64),
    /// Memory address of another shape. The step keeps the shape alive while the table has its contacts.
    Address(usize),
}

impl SecondKey {
    /// Returns the key of a shape.
    pub fn of(shape: &dyn Shape) -> Self {
        match shape.as_shape::<MedialShape>() {
            Some(medial) => Self::Medial(medial.key),
            None => Self::Address(std::ptr::from_ref(shape).cast::<()>() as usize),
        }
    }
}

impl PairKey {
    pub fn new(first: u64, second: SecondKey, pose12: &Pose3) -> Self {
        let [qx, qy, qz, qw] = pose12.rotation.to_array();
        let [x, y, z] = pose12.translation.to_array();
        Self { first, second, pose12: [qx, qy, qz, qw, x, y, z].map(f32::to_bits) }
    }
}

/// Returns the key of a pair. `None` if the pair is in another world, or if one of its shapes has been replaced since the contacts were searched.
fn key(pair: &CachedPair, colliders: &RapierContextColliders) -> Option<PairKey> {
    let [first, second] = std::array::from_fn(|side| {
        let entity = Entity::try_from_bits(pair.ids[side])?;
        let collider = colliders.colliders.get(*colliders.entity2collider().get(&entity)?)?;
        let shape = collider.shared_shape();
        (shape_id(shape) == pair.shapes[side]).then_some(&**shape)
    });
    let first = first?.as_shape::<MedialShape>()?;
    Some(PairKey::new(first.key, SecondKey::of(second?), &pair.pose12))
}

impl ContactTable {
    /// Locks the table for reading. Ignores poisoning, because the next step replaces the content.
    fn read(&self) -> RwLockReadGuard<'_, Entries> {
        self.0.read().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn write(&self) -> RwLockWriteGuard<'_, Entries> {
        self.0.write().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Returns the manifolds of a pair if the table has an entry for exactly this pose and about this reach.
    ///
    /// A body that stops loses the velocity of the time that is owed to it after its contacts are searched, which may halve or double the reach.
    pub(super) fn get(&self, key: &PairKey, reach: ContactMargin, has_skins: bool) -> Option<Vec<Manifold>> {
        let table = self.read();
        let (found, range) = table.pairs.get(key)?;
        // Contacts within contact skins have to be searched.
        let about = |a: f32, b: f32| a <= 2.0 * b && b <= 2.0 * a;
        let has_all = about(found.prediction, reach.prediction) && (reach.is_fast || !found.is_fast);
        (has_all && !has_skins).then(|| table.manifolds[range.clone()].to_vec())
    }

    /// Replaces all content: the motion of the colliders of awake bodies in the next step, the prediction distance, the length unit, and the contacts of the last step.
    /// `displacements` gets those of the step before, as a buffer.
    pub(super) fn prepare<'a>(
        &self,
        displacements: &mut Displacements,
        ContactMargin { prediction, length_unit, .. }: ContactMargin,
        contacts: &ContactCache,
        worlds: impl Iterator<Item = &'a RapierContextColliders>,
    ) {
        let mut table = self.write();
        let Entries { pairs, manifolds, .. } = &mut *table;
        pairs.clear();
        manifolds.clear();
        for colliders in worlds {
            for (pair, found) in contacts.pairs().filter(|(pair, _)| pair.reach.length_unit == length_unit) {
                if let Some(key) = key(pair, colliders) {
                    let begin = manifolds.len();
                    manifolds.extend(found);
                    pairs.insert(key, (pair.reach, begin..manifolds.len()));
                }
            }
        }
        std::mem::swap(&mut table.displacements, displacements);
        (table.prediction, table.length_unit) = (prediction, length_unit);
    }

    /// Returns the length unit in metres.
    pub(super) fn length_unit(&self) -> f32 {
        self.read().length_unit
    }

    /// Returns true if the table has an entry for exactly this pose.
    pub(super) fn contains(&self, key: &PairKey) -> bool {
        self.read().pairs.contains_key(key)
    }

    /// Returns the reach of the contact search of a pair, and true if it includes contact skins.
    ///
    /// `prediction`: rapier's prediction distance for the pair, in metres. The excess over the world's prediction distance is the sum of the colliders' contact
    /// skins. It is added to the reach at any speed, because colliders with skins touch at this distance.
    pub(super) fn reach(&self, first: u64, second: SecondKey, prediction: f32) -> (ContactMargin, bool) {
        let table = self.read();
        let skins = (prediction - table.prediction).max(0.0);
        let displacements =
            [SecondKey::Medial(first), second].map(|key| table.displacements.get(&key).unwrap_or(&Displacement::REST));
        let bare = ContactMargin::new(prediction.min(table.prediction), table.length_unit);
        let reach = bare.of_pair(displacements);
        if skins == 0.0 {
            return (reach, false);
        }
        let within = if reach.is_fast { reach.touch() } else { reach.prediction };
        (ContactMargin::new(within + skins, reach.length_unit), true)
    }

    /// Returns the number of pairs.
    pub fn len(&self) -> usize {
        self.read().pairs.len()
    }

    /// Returns true if the table has no pairs.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
