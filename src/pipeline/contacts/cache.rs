//! Contacts that are kept between steps: a pair that has hardly moved since its contacts were searched keeps its manifolds.
//!
//! The contact points stay where they are on both bodies, and only their distances are computed again. The new distance is exact up to the second order of
//! the displacement, which is at most [`LINEAR_SLOP`] and less for small bodies.

use std::ops::Range;

use bevy::platform::collections::HashMap;
use glam::Quat;

use crate::{
    constants::{LINEAR_SLOP, SLOP_OF_SIZE},
    geometry::{Pose3, Sphere},
    pipeline::{ContactMargin, Manifold, ShapeId, Solid},
};

/// The contacts of all pairs of the last step, searched or recycled. It is part of the state of a simulation: steps with equal input and equal caches have equal
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
    /// [`Body::id`](crate::pipeline::Body::id) of both sides.
    pub ids: [u64; 2],
    /// The shapes of both sides.
    pub shapes: [ShapeId; 2],
    /// Margin of the search.
    pub reach: ContactMargin,
    /// Pose of the second side in the frame of the first at the end of the last step.
    pub pose12: Pose3,
    /// That pose when the contacts were searched.
    searched: Pose3,
    /// True if the second body is the larger one.
    on_second: bool,
    /// The manifolds at the pose `searched`.
    manifolds: Range<usize>,
}

impl ContactCache {
    /// Removes all pairs and keeps the allocations.
    pub(in crate::pipeline) fn clear(&mut self) {
        self.places.clear();
        self.pairs.clear();
        self.manifolds.clear();
    }

    /// Adds a pair that was searched in this step, with its manifolds.
    pub(in crate::pipeline) fn push(&mut self, pair: CachedPair, manifolds: &[Manifold]) {
        let begin = self.manifolds.len();
        self.manifolds.extend_from_slice(manifolds);
        self.places.insert(pair.ids, self.pairs.len() as u32);
        self.pairs.push(CachedPair { manifolds: begin..self.manifolds.len(), ..pair });
    }

    /// Adds a pair of an earlier cache at another pose.
    pub(in crate::pipeline) fn keep(&mut self, earlier: &ContactCache, index: u32, pose12: Pose3) {
        let pair = &earlier.pairs[index as usize];
        self.push(CachedPair { pose12, ..pair.clone() }, &earlier.manifolds[pair.manifolds.clone()]);
    }

    /// Returns the index of a pair, if it has manifolds that are valid for these shapes at this pose.
    ///
    /// Pairs without manifolds are searched in every step. Otherwise contacts would depend on the step in which culling has first listed the pair.
    pub(in crate::pipeline) fn find(
        &self,
        ids: [u64; 2],
        solids: [&Solid; 2],
        reach: ContactMargin,
        pose12: &Pose3,
    ) -> Option<u32> {
        let index = *self.places.get(&ids)?;
        let pair = &self.pairs[index as usize];
        if pair.manifolds.is_empty() || pair.reach != reach || pair.shapes != solids.map(Solid::id) {
            return None;
        }
        let bounds = solids.map(Solid::bounding_sphere);
        let size = bounds[0].radius.min(bounds[1].radius);
        let tolerance = (LINEAR_SLOP * reach.length_unit).min(SLOP_OF_SIZE * size).min(0.25 * reach.prediction);
        (relative_displacement(&pair.searched, pose12, bounds) <= tolerance).then_some(index)
    }

    /// Returns the manifolds of a pair at another pose.
    pub(in crate::pipeline) fn manifolds_at(&self, index: u32, pose12: Pose3) -> impl Iterator<Item = Manifold> {
        let CachedPair { searched, on_second, manifolds, .. } = &self.pairs[index as usize];
        // Normals keep their direction on the larger body. On a ball that rolls they would turn, and push the ball forward.
        let turn = if *on_second { pose12.rotation * searched.rotation.inverse() } else { Quat::IDENTITY };
        let is_new = pose12 == *searched;
        self.manifolds[manifolds.clone()].iter().map(move |found| if is_new { *found } else { found.at(&pose12, turn) })
    }

    /// Returns all pairs, each with its manifolds.
    pub fn pairs(&self) -> impl Iterator<Item = (&CachedPair, impl Iterator<Item = Manifold>)> {
        (0..).zip(&self.pairs).map(|(index, pair)| (pair, self.manifolds_at(index, pair.pose12)))
    }

    /// Returns the number of pairs.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Returns true if there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }
}

impl CachedPair {
    /// Creates a pair that was searched at this pose, without manifolds.
    pub(in crate::pipeline) fn new(ids: [u64; 2], solids: [&Solid; 2], reach: ContactMargin, pose12: Pose3) -> Self {
        let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
        let shapes = solids.map(Solid::id);
        Self { ids, shapes, reach, pose12, searched: pose12, on_second: radius1 < radius2, manifolds: 0..0 }
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
