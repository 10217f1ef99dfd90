//! Which bodies stop within the step, and when: impacts in the order of time.
//!
//! At an impact both bodies stop. A body that has stopped is no longer where others were swept against it, so their impacts with it
//! are found anew, from that instant on, with the one at rest: an impact that its stop prevents is none, and one that it causes is
//! found. Each body stops at most once, so this ends.

use std::{
    cmp::Ordering,
    collections::{BinaryHeap, HashMap},
};

use super::{
    Side, Statics, StepInput,
    broad_phase::BodyPair,
    mid_phase,
    motion::PairMotion,
    narrow_phase::{ImpactResult, first_impact},
};
use crate::geometry::{Pose3, Sweep};

/// The fraction at which each body stops; 1 for the others.
pub(super) struct Stops(Vec<f32>);

impl Stops {
    pub fn is_stopped(&self, body: u32) -> bool {
        self.0[body as usize] < 1.0
    }

    /// Where a body is at the end of the step.
    pub fn final_pose(&self, input: &StepInput, body: u32) -> Pose3 {
        input.bodies[body as usize].sweep.pose_at(self.0[body as usize])
    }

    /// The stopped bodies and their fractions.
    pub fn iter(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        (0..).zip(self.0.iter().copied()).filter(|(_, fraction)| *fraction < 1.0)
    }
}

/// A pair's impact in the queue, outdated if the pair has another by now.
#[derive(Clone, Copy, PartialEq)]
struct Event {
    fraction: f32,
    pair: usize,
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    /// The greatest is the earliest, of those the first pair.
    fn cmp(&self, other: &Self) -> Ordering {
        other.fraction.total_cmp(&self.fraction).then(other.pair.cmp(&self.pair))
    }
}

/// Stops bodies; `results` then holds the impacts that have happened.
pub(super) fn run(input: &StepInput, statics: &Statics, pairs: &[BodyPair], results: &mut [ImpactResult]) -> Stops {
    let mut stops = Stops(vec![1.0; input.bodies.len()]);
    let stopping = |body: u32| input.stop_at_impact && input.bodies[body as usize].stops;
    // A pair stops only if both sides consent.
    let consent = |side| match side {
        Side::Body(body) => (input.bodies[body as usize].passes, input.bodies[body as usize].stop_groups),
        Side::Static(body) => (statics.bodies[body as usize].passes, statics.bodies[body as usize].stop_groups),
    };
    let stops_both = |pair: &BodyPair| {
        let [(passes1, groups1), (passes2, groups2)] = [pair.first, pair.second].map(consent);
        !passes1 && !passes2 && groups1.test(&groups2)
    };
    let mut queue: BinaryHeap<Event> = BinaryHeap::new();
    for (pair, result) in results.iter().enumerate() {
        queue.extend(result.impact.filter(|_| stops_both(&pairs[pair])).map(|i| Event { fraction: i.fraction, pair }));
    }
    if queue.is_empty() {
        return stops;
    }
    let mut pairs_of: Vec<Vec<usize>> = vec![Vec::new(); input.bodies.len()];
    for (i, pair) in pairs.iter().enumerate() {
        pair.bodies().for_each(|body| pairs_of[body as usize].push(i));
    }
    let mut assembled: HashMap<u64, Vec<u32>> = HashMap::new();
    for (index, body) in (0..).zip(&input.bodies) {
        if let Some(assembly) = body.assembly {
            assembled.entry(assembly).or_default().push(index);
        }
    }
    let joined_with = |body: u32| match input.bodies[body as usize].assembly {
        Some(assembly) => assembled[&assembly].clone(),
        None => vec![body],
    };
    while let Some(Event { fraction, pair }) = queue.pop() {
        if results[pair].impact.is_none_or(|impact| impact.fraction != fraction) {
            continue;
        }
        let touching = pairs[pair].bodies();
        let stopped: Vec<u32> =
            touching.filter(|&body| stopping(body) && !stops.is_stopped(body)).flat_map(joined_with).collect();
        for &body in &stopped {
            // Never 1, which stands for a body that goes on.
            stops.0[body as usize] = fraction.min(1.0f32.next_down());
        }
        for body in stopped {
            for &other in &pairs_of[body as usize] {
                if other == pair || results[other].impact.is_some_and(|impact| impact.fraction <= fraction) {
                    continue;
                }
                results[other].impact = None;
                if !stops_both(&pairs[other]) {
                    continue;
                }
                let sweep_of = |index: u32| {
                    let sweep = &input.bodies[index as usize].sweep;
                    if stops.is_stopped(index) {
                        Sweep::at_rest(sweep.pose_at(stops.0[index as usize]))
                    } else {
                        sweep.rest_from(fraction)
                    }
                };
                let mut motions = PairMotion::all(input, statics, &pairs[other], sweep_of);
                motions.retain(|motion| !motion.is_at_rest());
                let candidates: Vec<_> = motions.iter().map(|motion| mid_phase::candidates(motion, 0.0)).collect();
                let found = first_impact(motions.iter().zip(&candidates));
                results[other].toi_tests += found.toi_tests;
                results[other].unresolved += found.unresolved;
                results[other].impact = found.impact.map(|mut impact| {
                    impact.fraction = fraction + (1.0 - fraction) * impact.fraction;
                    impact
                });
                queue.extend(results[other].impact.map(|i| Event { fraction: i.fraction, pair: other }));
            }
        }
    }
    stops
}
