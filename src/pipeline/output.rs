//! Output of a step.

use std::{ops::Range, time::Duration};

use bevy::platform::time::Instant;
use glam::Vec3;

use super::{ContactMargin, Manifold, Side};
use crate::geometry::Pose3;

/// First impact of a pair within the step: the first touch of cores, or the first touch of surfaces that separate again within the step. Bodies that are
/// in touch at the start may gain some overlap before the impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// Time of the impact, as a fraction of the step.
    pub fraction: f32,
    /// Point of the impact at that time, in the world.
    pub point: Vec3,
    /// Unit normal from the first side to the second, in the world.
    pub normal: Vec3,
    /// Primitive of the first side.
    pub primitive1: u32,
    /// Primitive or part of the second side.
    pub primitive2: u32,
}

/// A pair of bodies that touch, touched within the step, or have contacts within [`ContactMargin`](super::ContactMargin) at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The first side. It is medial.
    pub first: Side,
    /// The second side. If it is medial too, it is a body of a higher index or a static.
    pub second: Side,
    /// Manifolds at the final poses of the step, as a range of [`StepOutput::manifolds`].
    pub manifolds: Range<usize>,
    /// Margin of the contact search.
    pub reach: ContactMargin,
    /// The first impact, if there is one.
    pub impact: Option<Impact>,
}

/// A body that leaves its path, because it stops at an impact or because a kinematic body pushes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// The body.
    pub body: u32,
    /// Time of the stop, as a fraction of the step; 1 for a pushed body.
    pub fraction: f32,
    /// Pose of the body at the end of the step.
    pub pose: Pose3,
}

/// A candidate pair: two bodies that may come within the prediction distance of each other in the step, wherever each of them stops.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidates {
    /// The bodies, in any order. At least one of them is medial.
    pub sides: [Side; 2],
    /// Their primitives. A side that is not medial has parts instead of primitives.
    pub primitives: Primitives,
}

/// The primitive pairs of a candidate pair, in any order: a primitive of the first side and one of the second.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Primitives {
    /// The mid phase finds the pairs.
    #[default]
    Unknown,
    /// The pairs that may touch if no body stops. Searches of halved steps and of contacts cull on their own.
    MayTouch(Vec<[u32; 2]>),
    /// The pairs that may come within the prediction distance if no body stops. They replace the searches of the CPU.
    Bounded(Vec<BoundedPair>),
}

impl Primitives {
    /// Returns the primitive pairs; none if they are not known.
    pub fn indices(&self) -> Box<dyn Iterator<Item = [u32; 2]> + '_> {
        match self {
            Primitives::Unknown => Box::new(std::iter::empty()),
            Primitives::MayTouch(pairs) => Box::new(pairs.iter().copied()),
            Primitives::Bounded(pairs) => Box::new(pairs.iter().map(|pair| pair.primitives)),
        }
    }

    /// Exchanges the sides.
    pub(super) fn reverse(&mut self) {
        match self {
            Primitives::Unknown => {}
            Primitives::MayTouch(pairs) => pairs.iter_mut().for_each(|pair| pair.reverse()),
            Primitives::Bounded(pairs) => pairs.iter_mut().for_each(|pair| pair.primitives.reverse()),
        }
    }
}

/// A primitive pair with bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundedPair {
    /// Primitive of the first side, and primitive or part of the second.
    pub primitives: [u32; 2],
    /// Lower bound of the time of the first touch, as a fraction of the step. It exceeds 1 if they do not touch within the step.
    pub touch_bound: f32,
    /// True if they may be within the prediction distance at the end of the step.
    pub is_near_at_end: bool,
}

/// Output of a step. All lists are sorted by body indices.
#[derive(Clone, Debug, Default)]
pub struct StepOutput {
    /// Bodies that stop at an impact or are pushed.
    pub stops: Vec<Stop>,
    /// Pairs with contacts or an impact.
    pub pairs: Vec<Pair>,
    /// Manifolds of the pairs.
    pub manifolds: Vec<Manifold>,
    /// Candidate pairs that the mid phase leaves, if [`StepInput::report_candidates`](super::StepInput::report_candidates) is set. If a long motion
    /// is split into intervals, the list contains the candidates of the intervals up to the first impact. The index of a part of another collider is reported
    /// as 0.
    pub candidates: Vec<Candidates>,
    /// Counters of the step.
    pub counts: Counts,
    /// Wall time of the stages.
    pub times: Times,
}

impl StepOutput {
    /// Clears everything and keeps the allocations.
    pub(super) fn clear(&mut self) {
        let Self { stops, pairs, manifolds, candidates, counts, times } = self;
        stops.clear();
        pairs.clear();
        manifolds.clear();
        candidates.clear();
        (*counts, *times) = Default::default();
    }

    /// Returns the stop of a body, if it has one.
    pub fn stop_of(&self, body: u32) -> Option<&Stop> {
        self.stops.binary_search_by_key(&body, |stop| stop.body).ok().map(|i| &self.stops[i])
    }
}

/// Counts of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bodies.
    pub bodies: usize,
    /// Primitive pairs of all body pairs with a medial side: the number of tests without culling.
    pub primitive_pairs: usize,
    /// Body pairs that the broad phase leaves.
    pub body_pairs: usize,
    /// Primitive pairs that the mid phase leaves.
    pub candidates: usize,
    /// Primitive pairs whose distance and time of impact were computed.
    pub toi_tests: usize,
    /// Contact points after reduction.
    pub contacts: usize,
    /// Time-of-impact queries that reached the iteration limit.
    pub unresolved: usize,
}

/// Wall time of the stages of one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    /// Broad phase.
    pub broad: Duration,
    /// Mid phase.
    pub mid: Duration,
    /// Narrow phase: first impacts.
    pub narrow: Duration,
    /// Response: stopped and pushed bodies, and new searches of their pairs.
    pub stop: Duration,
    /// Search and reduction of contacts.
    pub contacts: Duration,
}

impl Times {
    /// Returns the sum of all stages.
    pub fn total(&self) -> Duration {
        self.broad + self.mid + self.narrow + self.stop + self.contacts
    }
}

/// Returns a clock: each call returns the time since the last call.
pub(super) fn laps() -> impl FnMut() -> Duration {
    let mut clock = Instant::now();
    move || {
        let now = Instant::now();
        now - std::mem::replace(&mut clock, now)
    }
}
