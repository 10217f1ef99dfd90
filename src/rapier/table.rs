use std::{
    ops::Range,
    sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard},
};

use bevy::{platform::collections::HashMap, prelude::*};
use bevy_rapier3d::parry::shape::Shape;

use super::shape::MedialShape;
use crate::{
    geometry::Pose3,
    pipeline::{Manifold, Pace, Reach},
};

/// The manifolds that the last step found, for rapier to fetch by pair and relative pose; and the paces of the bodies.
///
/// Manifolds are a pure function of shapes, relative pose, prediction distance and length unit, which are in the key but for the last: an
/// entry is never wrong, only missing once a body has been moved in between.
///
/// Reflection sees that it is there, and nothing in it: it is full of addresses of this run.
#[derive(Resource, Clone, Default, Reflect)]
#[reflect(Resource, Default, Clone)]
pub struct ContactTable(#[reflect(ignore, clone)] Arc<RwLock<Entries>>);

struct Entries {
    /// Of each pair a range of the manifolds.
    pairs: HashMap<PairKey, Range<usize>>,
    manifolds: Vec<Manifold>,
    paces: HashMap<SecondKey, Pace>,
    /// In metres, of colliders without skins.
    prediction: f32,
    length_unit: f32,
}

impl Default for Entries {
    fn default() -> Self {
        let (pairs, manifolds, paces) = Default::default();
        Self { pairs, manifolds, paces, prediction: f32::INFINITY, length_unit: 1.0 }
    }
}

/// What a pair's manifolds depend on.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct PairKey {
    first: u64,
    second: SecondKey,
    pose12: [u32; 7],
    /// Both distances of the reach.
    reach: [u32; 2],
}

/// The second side of a pair.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum SecondKey {
    Medial(u64),
    /// Where another shape is in memory: the step keeps it there as long as the table has its contacts.
    Address(usize),
}

impl SecondKey {
    /// The key of a shape.
    pub fn of(shape: &dyn Shape) -> Self {
        match shape.as_shape::<MedialShape>() {
            Some(medial) => Self::Medial(medial.key),
            None => Self::Address(std::ptr::from_ref(shape).cast::<()>() as usize),
        }
    }
}

impl PairKey {
    pub fn new(first: u64, second: SecondKey, pose12: &Pose3, reach: Reach) -> Self {
        let [qx, qy, qz, qw] = pose12.rotation.to_array();
        let [x, y, z] = pose12.translation.to_array();
        let reach = [reach.prediction, reach.in_touch].map(f32::to_bits);
        Self { first, second, pose12: [qx, qy, qz, qw, x, y, z].map(f32::to_bits), reach }
    }
}

impl ContactTable {
    /// A panic of another thread while it held the lock leaves nothing half done here.
    fn read(&self) -> RwLockReadGuard<'_, Entries> {
        self.0.read().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn write(&self) -> RwLockWriteGuard<'_, Entries> {
        self.0.write().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Replaces all entries.
    pub(super) fn fill(&self, manifolds: &[Manifold], pairs: impl Iterator<Item = (PairKey, Range<usize>)>) {
        let mut table = self.write();
        table.pairs.clear();
        table.pairs.extend(pairs);
        table.manifolds.clear();
        table.manifolds.extend_from_slice(manifolds);
    }

    /// The manifolds of a pair, if they are known for this very pose.
    pub(super) fn get(&self, key: &PairKey) -> Option<Vec<Manifold>> {
        let table = self.read();
        table.pairs.get(key).map(|range| table.manifolds[range.clone()].to_vec())
    }

    /// Sets the paces of all that moves in the step to come, and the prediction distance of the worlds. With another length unit nothing is known.
    pub(super) fn prepare(&self, paces: HashMap<SecondKey, Pace>, Reach { prediction, length_unit, .. }: Reach) {
        let mut table = self.write();
        table.paces = paces;
        table.prediction = prediction;
        if std::mem::replace(&mut table.length_unit, length_unit) != length_unit {
            table.pairs.clear();
        }
    }

    /// The length unit in metres.
    pub(super) fn length_unit(&self) -> f32 {
        self.read().length_unit
    }

    /// True if a medial shape is one of a body that is not fixed.
    pub(super) fn moves(&self, key: u64) -> bool {
        self.read().paces.contains_key(&SecondKey::Medial(key))
    }

    /// How far contacts of a pair are looked for, with rapier's prediction distance in metres: what it has beyond that of the world are the skins of the
    /// colliders, at whose distance they touch, however slow.
    pub(super) fn reach(&self, first: u64, second: SecondKey, prediction: f32) -> Reach {
        let table = self.read();
        let skins = (prediction - table.prediction).max(0.0);
        let [pace1, pace2] =
            [SecondKey::Medial(first), second].map(|key| table.paces.get(&key).copied().unwrap_or(Pace::REST));
        let bare = Reach::new(prediction.min(table.prediction), table.length_unit);
        let reach = bare.of_pair(pace1.against(&pace2));
        Reach { prediction: reach.prediction + skins, in_touch: reach.in_touch + skins, ..reach }
    }

    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.read().pairs.len()
    }

    /// True if no pair is near another.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
