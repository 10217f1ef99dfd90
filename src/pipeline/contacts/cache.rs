//! Contacts that are kept between steps: a pair that has hardly moved since its contacts were searched keeps its manifolds, and a slow pair keeps a
//! [list of near primitives](super::near_list).
//!
//! The contact points stay where they are on both bodies, and only their distances are computed again. The new distance is exact up to the second order of
//! the displacement, which is at most the [`slop`].

use std::ops::Range;

use bevy::platform::collections::HashMap;
use glam::Quat;

use crate::{
    geometry::Pose3,
    pipeline::{
        ContactMargin, Manifold, ShapeId, Solid,
        contacts::near_list::{NearList, NearPair},
        solid::smaller_radius,
        tolerances::slop,
    },
};

/// The contacts of all pairs of the last step, searched or recycled. It is part of the state of a simulation: steps with equal input and equal caches have equal
/// output.
///
/// A workspace has two caches of up to 300 bytes per pair of near bodies, 208 bytes per manifold, and 12 bytes per near primitive pair: at most
/// [`MAX_NEAR_PAIRS`](crate::constants::MAX_NEAR_PAIRS) of a pair of bodies.
#[derive(Clone, Debug, Default)]
pub struct ContactCache {
    places: HashMap<[u64; 2], u32>,
    pairs: Vec<CachedPair>,
    manifolds: Vec<Manifold>,
    near_pairs: Vec<NearPair>,
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
    /// Bounds of the list of near primitives at the pose `pose12`.
    near: NearList,
    /// True if the second body is the larger one.
    on_second: bool,
    /// The manifolds at the pose `searched`.
    manifolds: Range<u32>,
    /// The list of near primitives.
    near_pairs: Range<u32>,
}

/// A pair of the last step at a pose of this one.
#[derive(Clone, Copy, Debug)]
pub(in crate::pipeline) struct EarlierPair<'c> {
    cache: &'c ContactCache,
    /// Index in the cache.
    pub index: u32,
    solids: [&'c Solid; 2],
    /// Pose of the second side in the frame of the first in this step.
    pose12: Pose3,
    /// Bounds of the list of near primitives at this pose.
    pub near: NearList,
}

impl ContactCache {
    /// Removes all pairs and keeps the allocations.
    pub(in crate::pipeline) fn clear(&mut self) {
        self.places.clear();
        self.pairs.clear();
        self.manifolds.clear();
        self.near_pairs.clear();
    }

    /// Adds a pair that was searched in this step, with its manifolds and its list of near primitives.
    pub(in crate::pipeline) fn push(&mut self, pair: CachedPair, manifolds: &[Manifold], near_pairs: &[NearPair]) {
        self.places.insert(pair.ids, self.pairs.len() as u32);
        let manifolds = append(&mut self.manifolds, manifolds);
        let near_pairs = append(&mut self.near_pairs, near_pairs);
        self.pairs.push(CachedPair { manifolds, near_pairs, ..pair });
    }

    /// Adds a pair of an earlier cache at another pose. `reach`: margin for which its contacts are valid. `near`: bounds of its list at this pose.
    pub(in crate::pipeline) fn keep(
        &mut self,
        earlier: &ContactCache,
        index: u32,
        reach: ContactMargin,
        pose12: Pose3,
        near: NearList,
    ) {
        let pair = &earlier.pairs[index as usize];
        let kept = CachedPair { reach, pose12, near, ..pair.clone() };
        self.push(kept, part(&earlier.manifolds, &pair.manifolds), part(&earlier.near_pairs, &pair.near_pairs));
    }

    /// Returns a pair of the last step, if it had these shapes. `pose12`: pose of the second side in the frame of the first in this step.
    pub(in crate::pipeline) fn find<'c>(
        &'c self,
        ids: [u64; 2],
        solids: [&'c Solid; 2],
        pose12: Pose3,
    ) -> Option<EarlierPair<'c>> {
        let index = *self.places.get(&ids)?;
        let pair = &self.pairs[index as usize];
        if pair.shapes != solids.map(Solid::id) {
            return None;
        }
        let is_used_up = !pair.near.covers(0.0);
        let near = if is_used_up {
            NearList::default()
        } else {
            pair.near.moved(displacement(solids, [&pair.pose12, &pose12]))
        };
        Some(EarlierPair { cache: self, index, solids, pose12, near })
    }

    /// Returns the manifolds of a pair at another pose.
    pub(in crate::pipeline) fn manifolds_at(&self, index: u32, pose12: Pose3) -> impl Iterator<Item = Manifold> {
        let CachedPair { searched, on_second, manifolds, .. } = &self.pairs[index as usize];
        // Normals keep their direction on the larger body. On a ball that rolls they would turn, and push the ball forward.
        let turn = if *on_second { pose12.rotation * searched.rotation.inverse() } else { Quat::IDENTITY };
        let is_new = pose12 == *searched;
        part(&self.manifolds, manifolds).iter().map(move |found| if is_new { *found } else { found.at(&pose12, turn) })
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
    /// Creates a pair that was searched at this pose, without manifolds and near primitives. `near`: bounds of its list.
    pub(in crate::pipeline) fn new(
        ids: [u64; 2],
        solids: [&Solid; 2],
        reach: ContactMargin,
        pose12: Pose3,
        near: NearList,
    ) -> Self {
        let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
        let shapes = solids.map(Solid::id);
        let on_second = radius1 < radius2;
        Self { ids, shapes, reach, pose12, searched: pose12, near, on_second, manifolds: 0..0, near_pairs: 0..0 }
    }
}

impl<'c> EarlierPair<'c> {
    fn pair(&self) -> &'c CachedPair {
        &self.cache.pairs[self.index as usize]
    }

    /// Returns true if the manifolds of the pair are valid at this pose. A pair without manifolds has to be apart.
    pub fn is_recyclable(&self, reach: ContactMargin) -> bool {
        let pair = self.pair();
        if pair.manifolds.is_empty() {
            return self.near.gap() > reach.prediction;
        }
        let Self { solids, pose12, .. } = self;
        let tolerance = slop(reach.length_unit, smaller_radius(*solids)).min(0.25 * reach.prediction);
        !reach.is_fast && pair.reach == reach && displacement(*solids, [&pair.searched, pose12]) <= tolerance
    }

    /// Returns the manifolds of the pair at this pose.
    pub fn manifolds(&self) -> impl Iterator<Item = Manifold> + use<'c> {
        self.cache.manifolds_at(self.index, self.pose12)
    }

    /// Returns the list of near primitives.
    pub fn near_pairs(&self) -> &'c [NearPair] {
        part(&self.cache.near_pairs, &self.pair().near_pairs)
    }

    /// Returns the primitive pairs that may be within `reach` metres of each other at this pose; `None` if they are not known.
    pub fn primitives_within(self, reach: f32) -> Option<impl Iterator<Item = [u32; 2]> + use<'c>> {
        let Self { near, .. } = self;
        let pairs = near.covers(reach).then(|| self.near_pairs().iter())?;
        Some(pairs.filter(move |pair| near.is_near(pair, reach)).map(|pair| pair.primitives))
    }
}

/// Appends items to a list. Returns their places.
fn append<T: Clone>(list: &mut Vec<T>, items: &[T]) -> Range<u32> {
    let begin = list.len() as u32;
    list.extend_from_slice(items);
    begin..list.len() as u32
}

/// Returns the items at some places of a list.
fn part<'l, T>(list: &'l [T], &Range { start, end }: &Range<u32>) -> &'l [T] {
    &list[start as usize..end as usize]
}

/// Returns an upper bound of the relative displacement of any point within both bounding spheres between two poses of the second body, in metres.
fn displacement(solids: [&Solid; 2], poses: [&Pose3; 2]) -> f32 {
    let [bound1, bound2] = solids.map(Solid::bounding_sphere);
    let [from, to] = poses.map(|pose| pose.rotation);
    let angle = 2.0 * (from.inverse() * to).xyz().length().min(1.0).asin();
    let (radius, [from, to]) = if bound1.radius < bound2.radius {
        (bound1.radius, poses.map(|pose| pose.inverse_transform_point(bound1.center)))
    } else {
        (bound2.radius, poses.map(|pose| pose.transform_point(bound2.center)))
    };
    from.distance(to) + angle * radius
}
