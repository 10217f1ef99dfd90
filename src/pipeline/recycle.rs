//! Contacts that are kept between steps: a pair that has hardly moved since its contacts were searched keeps its manifolds.
//!
//! The contact points stay where they are on both bodies, and only their distances are computed again. The new distance is exact up to the second order of
//! the displacement, which is at most [`LINEAR_SLOP`].

use std::ops::Range;

use bevy::platform::collections::HashMap;

use super::{Manifold, Reach, ShapeId, Solid};
use crate::{
    constants::LINEAR_SLOP,
    geometry::{Pose3, Sphere},
};

/// The contacts of all pairs that the last step has searched. It is part of the state of a simulation: steps with equal input and equal caches have equal
/// output.
///
/// A workspace has two caches of up to 300 bytes per pair of near bodies, and 208 bytes per manifold.
#[derive(Clone, Debug, Default)]
pub struct ContactCache {
    places: HashMap<[u64; 2], u32>,
    pairs: Vec<CachedPair>,
    manifolds: Vec<Manifold>,
}

/// A pair in the cache.
#[derive(Clone, Debug)]
pub struct CachedPair {
    /// [`Body::id`](super::Body::id) of both sides.
    pub ids: [u64; 2],
    /// The shapes of both sides.
    pub shapes: [ShapeId; 2],
    /// Reach of the search.
    pub reach: Reach,
    /// Pose of the second side in the frame of the first, to which the manifolds refer.
    pub pose12: Pose3,
    /// That pose when the contacts were searched.
    pub(super) searched: Pose3,
    manifolds: Range<usize>,
}

impl ContactCache {
    /// Removes all pairs and keeps the allocations.
    pub(super) fn clear(&mut self) {
        self.places.clear();
        self.pairs.clear();
        self.manifolds.clear();
    }

    /// Adds a pair with its manifolds.
    pub(super) fn push(&mut self, pair: CachedPair, manifolds: &[Manifold]) {
        let begin = self.manifolds.len();
        self.manifolds.extend_from_slice(manifolds);
        self.places.insert(pair.ids, self.pairs.len() as u32);
        self.pairs.push(CachedPair { manifolds: begin..self.manifolds.len(), ..pair });
    }

    /// Returns a pair and its manifolds, if they are valid for these shapes at this pose.
    pub(super) fn get(
        &self,
        ids: [u64; 2],
        solids: [&Solid; 2],
        reach: Reach,
        pose12: &Pose3,
    ) -> Option<(&CachedPair, &[Manifold])> {
        let pair = &self.pairs[*self.places.get(&ids)? as usize];
        let tolerance = LINEAR_SLOP * reach.length_unit;
        let is_valid = pair.reach == reach
            && pair.shapes == solids.map(Solid::id)
            && relative_displacement(&pair.searched, pose12, solids.map(Solid::bounding_sphere)) <= tolerance;
        is_valid.then(|| (pair, self.manifolds(pair)))
    }

    /// Returns the manifolds of a pair of this cache.
    pub fn manifolds(&self, pair: &CachedPair) -> &[Manifold] {
        &self.manifolds[pair.manifolds.clone()]
    }

    /// Returns all pairs.
    pub fn pairs(&self) -> &[CachedPair] {
        &self.pairs
    }
}

impl CachedPair {
    /// Creates a pair without manifolds.
    pub(super) fn new(ids: [u64; 2], shapes: [ShapeId; 2], reach: Reach, pose12: Pose3, searched: Pose3) -> Self {
        Self { ids, shapes, reach, pose12, searched, manifolds: 0..0 }
    }
}

/// Returns an upper bound of the relative displacement between two relative poses of a pair, of any point within both bounding spheres, in metres.
fn relative_displacement(from: &Pose3, to: &Pose3, [bound1, bound2]: [Sphere; 2]) -> f32 {
    let [a, b] = [from.rotation, to.rotation];
    let angle = 2.0 * (a.inverse() * b).xyz().length().min(1.0).asin();
    let (radius, center) = if bound1.radius < bound2.radius {
        let [from, to] = [from, to].map(|pose| pose.inverse_transform_point(bound1.center));
        (bound1.radius, from.distance(to))
    } else {
        let [from, to] = [from, to].map(|pose| pose.transform_point(bound2.center));
        (bound2.radius, from.distance(to))
    };
    center + angle * radius
}
