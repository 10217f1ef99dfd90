//! Contacts that are kept between steps: a pair that has hardly moved since its contacts were searched keeps its manifolds, and a pair that was apart is not
//! searched until it has moved by its distance.
//!
//! The contact points stay where they are on both bodies, and only their distances are computed again. The new distance is exact up to the second order of
//! the displacement, which is at most the [`slop`].

use std::ops::Range;

use bevy::platform::collections::HashMap;
use glam::Quat;

use crate::{
    constants::CONTACT_ROUNDING,
    geometry::Pose3,
    pipeline::{ContactMargin, Manifold, ShapeId, Solid, tolerances::slop},
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
    /// Lower bound of the distance of the bodies at that pose, in metres; 0 if they have contacts.
    gap: f32,
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

    /// Adds a pair of an earlier cache at another pose. `reach`: margin for which its contacts are valid.
    pub(in crate::pipeline) fn keep(
        &mut self,
        earlier: &ContactCache,
        index: u32,
        reach: ContactMargin,
        pose12: Pose3,
    ) {
        let pair = &earlier.pairs[index as usize];
        self.push(CachedPair { reach, pose12, ..pair.clone() }, &earlier.manifolds[pair.manifolds.clone()]);
    }

    /// Returns the index of a pair, if its manifolds are valid for these shapes at this pose. A pair without manifolds has to be apart.
    pub(in crate::pipeline) fn find(
        &self,
        ids: [u64; 2],
        solids: [&Solid; 2],
        reach: ContactMargin,
        pose12: &Pose3,
    ) -> Option<u32> {
        let index = *self.places.get(&ids)?;
        let pair = &self.pairs[index as usize];
        let is_valid = if pair.manifolds.is_empty() {
            pair.gap_at(solids, pose12) > reach.prediction
        } else {
            let size = smaller_radius(solids);
            let tolerance = slop(reach.length_unit, size).min(0.25 * reach.prediction);
            !reach.is_fast && pair.reach == reach && pair.displacement(solids, pose12) <= tolerance
        };
        (is_valid && pair.is_of(solids)).then_some(index)
    }

    /// Returns a lower bound of the distance of two bodies, in metres. 0 if the pair has contacts or is not in the cache.
    pub(in crate::pipeline) fn gap(&self, ids: [u64; 2], solids: [&Solid; 2], pose12: &Pose3) -> f32 {
        let Some(&index) = self.places.get(&ids) else { return 0.0 };
        let pair = &self.pairs[index as usize];
        if pair.is_of(solids) { pair.gap_at(solids, pose12) } else { 0.0 }
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
    /// Creates a pair that was searched at this pose, without manifolds. `gap`: lower bound of the distance of the bodies, in metres.
    pub(in crate::pipeline) fn new(
        ids: [u64; 2],
        solids: [&Solid; 2],
        reach: ContactMargin,
        pose12: Pose3,
        gap: f32,
    ) -> Self {
        let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
        let shapes = solids.map(Solid::id);
        Self { ids, shapes, reach, pose12, searched: pose12, gap, on_second: radius1 < radius2, manifolds: 0..0 }
    }

    /// Returns true if the pair was searched with these shapes.
    fn is_of(&self, solids: [&Solid; 2]) -> bool {
        self.shapes == solids.map(Solid::id)
    }

    /// Returns a lower bound of the distance of the bodies at another pose, in metres.
    fn gap_at(&self, solids: [&Solid; 2], pose12: &Pose3) -> f32 {
        // Skip the bound of the displacement if the bodies were not apart.
        if self.gap == 0.0 {
            return 0.0;
        }
        let rounding = CONTACT_ROUNDING * smaller_radius(solids);
        (self.gap - rounding - self.displacement(solids, pose12)).max(0.0)
    }

    /// Returns an upper bound of the relative displacement of any point within both bounding spheres since the search, in metres.
    fn displacement(&self, solids: [&Solid; 2], pose12: &Pose3) -> f32 {
        let [bound1, bound2] = solids.map(Solid::bounding_sphere);
        let poses = [&self.searched, pose12];
        let [from, to] = poses.map(|pose| pose.rotation);
        let angle = 2.0 * (from.inverse() * to).xyz().length().min(1.0).asin();
        let (radius, [from, to]) = if bound1.radius < bound2.radius {
            (bound1.radius, poses.map(|pose| pose.inverse_transform_point(bound1.center)))
        } else {
            (bound2.radius, poses.map(|pose| pose.transform_point(bound2.center)))
        };
        from.distance(to) + angle * radius
    }
}

/// Returns the bounding radius of the smaller body, in metres.
fn smaller_radius(solids: [&Solid; 2]) -> f32 {
    let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
    radius1.min(radius2)
}
