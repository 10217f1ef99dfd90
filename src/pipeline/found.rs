//! Results of the contact search, pair by pair.

use std::ops::Range;

use super::{
    Contact, ContactMargin,
    contacts::{
        find,
        near_list::{NearList, NearPair},
        reduce,
    },
    parallel::Scratches,
};
use crate::geometry::Pose3;

/// A pair whose contacts were searched or recycled.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// Index of the pair.
    pub pair: u32,
    /// Number of manifolds.
    pub count: u32,
    /// Margin of the search.
    pub reach: ContactMargin,
    /// Bounds of the list of near primitives.
    pub near: NearList,
    /// The list, if the pair was searched.
    pub near_pairs: Range<u32>,
    /// Pose of the second side in the frame of the first.
    pub pose12: Pose3,
    /// Index of the pair in the cache, if its contacts were not searched.
    pub recycled: Option<u32>,
}

/// Buffers of a task for contacts, and the results that it keeps until all pairs are done.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub find: find::Scratch,
    pub contacts: Vec<Contact>,
    pub reduce: reduce::Scratch,
    pub found: AllFound,
}

/// Pairs whose contacts were searched or recycled.
#[derive(Debug, Default)]
pub(super) struct AllFound {
    pub pairs: Vec<Found>,
    /// Their lists of near primitives.
    pub near_pairs: Vec<NearPair>,
}

impl AllFound {
    /// Drops all pairs and keeps the allocations.
    pub fn clear(&mut self) {
        self.pairs.clear();
        self.near_pairs.clear();
    }

    /// Replaces the pairs with those of all tasks, in order.
    pub fn collect(&mut self, tasks: &mut Scratches<Scratch>) {
        self.clear();
        for AllFound { pairs, near_pairs } in tasks.iter_mut().map(|scratch| &mut scratch.found) {
            let before = self.near_pairs.len() as u32;
            self.near_pairs.append(near_pairs);
            self.pairs.extend(pairs.drain(..).map(|found| {
                let Range { start, end } = found.near_pairs;
                Found { near_pairs: before + start..before + end, ..found }
            }));
        }
        self.pairs.sort_unstable_by_key(|found| found.pair);
    }
}
