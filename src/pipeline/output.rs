//! What a step yields.

use std::{ops::Range, time::Duration};

use glam::Vec3;

use super::{Manifold, Reach, Side};
use crate::geometry::Pose3;

/// First impact of a pair within the step: the first touch of cores, or of surfaces if these part again within the step. Bodies that are in touch at the
/// start may gain some overlap first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// When, as a fraction of the step.
    pub fraction: f32,
    /// Where, in the world, at that instant.
    pub point: Vec3,
    /// Unit normal from the first side to the second, in the world.
    pub normal: Vec3,
    /// Primitive of the first side.
    pub primitive1: u32,
    /// Primitive of the second, or its part.
    pub primitive2: u32,
}

/// A pair of bodies that touch, touched within the step, or are within [`Reach`](super::Reach) of each other at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The first side, which is medial.
    pub first: Side,
    /// The second; if it is medial as well, a body of a higher index or a static.
    pub second: Side,
    /// Its manifolds where the bodies end the step: a range of [`StepOutput::manifolds`].
    pub manifolds: Range<usize>,
    /// How far its contacts were searched.
    pub reach: Reach,
    /// Their first impact, if there is one.
    pub impact: Option<Impact>,
}

/// A body that does not end the step where its motion would take it: it stops at an impact, or is pushed by a kinematic body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The body.
    pub body: u32,
    /// When it stopped, as a fraction of the step; 1 for a pushed body.
    pub fraction: f32,
    /// Its pose at the end of the step.
    pub pose: Pose3,
}

/// Two bodies that may come within the prediction distance of each other in the step, wherever each stops, and those of their primitives that may touch
/// if none does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidates {
    /// The bodies, in any order. One of them at least is medial.
    pub sides: [Side; 2],
    /// Primitives of the first side and the second, in any order; of a side that is not medial the parts. None if they are not known: the mid
    /// phase finds them.
    pub primitives: Option<Vec<[u32; 2]>>,
}

/// What a step yields, sorted by body indices.
#[derive(Clone, Debug, Default)]
pub struct StepOutput {
    /// Bodies that stop at an impact or are pushed.
    pub stops: Vec<Stop>,
    /// Pairs with something to tell.
    pub pairs: Vec<Pair>,
    /// Their manifolds.
    pub manifolds: Vec<Manifold>,
    /// What the mid phase has left, if it was to be reported; of a way that is searched in parts, up to the first impact. Of a second side that is not medial,
    /// the number of the part is not told: it is 0.
    pub candidates: Vec<Candidates>,
    /// What was counted.
    pub counts: Counts,
    /// What it took.
    pub times: Times,
}

impl StepOutput {
    /// Forgets all, but for the room that it has taken.
    pub(super) fn clear(&mut self) {
        let Self { stops, pairs, manifolds, candidates, counts, times } = self;
        stops.clear();
        pairs.clear();
        manifolds.clear();
        candidates.clear();
        (*counts, *times) = Default::default();
    }

    /// The stop of a body, if it has one.
    pub fn stop_of(&self, body: u32) -> Option<&Stop> {
        self.stops.binary_search_by_key(&body, |stop| stop.body).ok().map(|i| &self.stops[i])
    }
}

/// Counts of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bodies.
    pub bodies: usize,
    /// Primitive pairs of all body pairs that may collide: what brute force would test.
    pub primitive_pairs: usize,
    /// Body pairs that the broad phase leaves.
    pub body_pairs: usize,
    /// Primitive pairs that the mid phase leaves.
    pub candidates: usize,
    /// Time of impact queries.
    pub toi_tests: usize,
    /// Contact points after reduction.
    pub contacts: usize,
    /// Time of impact queries that ran out of rounds.
    pub unresolved: usize,
}

/// Wall time of the stages of one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    /// Broad phase.
    pub broad: Duration,
    /// Mid phase.
    pub mid: Duration,
    /// Narrow phase: first impacts, and contacts.
    pub narrow: Duration,
    /// Where bodies stop, and what that changes.
    pub stop: Duration,
    /// Reduction.
    pub reduce: Duration,
}

impl Times {
    /// All stages.
    pub fn total(&self) -> Duration {
        self.broad + self.mid + self.narrow + self.stop + self.reduce
    }
}
