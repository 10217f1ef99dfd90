//! Which bodies stop within the step, and when: impacts in the order of time.
//!
//! At an impact both bodies stop. A body that has stopped is no longer where others were swept against it, so their impacts with it
//! are found anew, from that instant on, with the one at rest: an impact that its stop prevents is none, and one that it causes is
//! found. Each body stops at most once, so this ends.
//!
//! What is left of the step is lost to a body that stops. Bodies that part after an impact lose one step at most each time they meet. Thin ones
//! that slide along each other at high speed stop again and again, wherever their overlap has grown by a slop: they come through it with the
//! right momentum, and late.

use std::{
    cmp::Ordering,
    collections::{BinaryHeap, HashMap},
};

use super::{
    Statics, StepInput, Target,
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
    let stops_both = |pair: &BodyPair| {
        let body1 = &input.bodies[pair.body1 as usize];
        let (passes, groups) = match pair.target {
            Target::Body(body) => (input.bodies[body as usize].passes, input.bodies[body as usize].stop_groups),
            Target::Static(body) => (statics.bodies[body as usize].passes, statics.bodies[body as usize].stop_groups),
        };
        !body1.passes && !passes && body1.stop_groups.test(&groups)
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
        pairs_of[pair.body1 as usize].push(i);
        if let Target::Body(body) = pair.target {
            pairs_of[body as usize].push(i);
        }
    }
    let mut shapes_of: HashMap<u32, Vec<u32>> = HashMap::new();
    for (index, body) in (0..).zip(&input.bodies) {
        if let Some(owner) = body.owner {
            shapes_of.entry(owner).or_default().push(index);
        }
    }
    let shapes_beside = |body: u32| match input.bodies[body as usize].owner {
        Some(owner) => shapes_of[&owner].clone(),
        None => vec![body],
    };
    while let Some(Event { fraction, pair }) = queue.pop() {
        if results[pair].impact.is_none_or(|impact| impact.fraction != fraction) {
            continue;
        }
        let BodyPair { body1, target } = pairs[pair];
        let second = match target {
            Target::Body(body) => Some(body),
            Target::Static(_) => None,
        };
        let touching = [Some(body1), second].into_iter().flatten();
        let stopped: Vec<u32> =
            touching.filter(|&body| stopping(body) && !stops.is_stopped(body)).flat_map(shapes_beside).collect();
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
                let motion = PairMotion::new(input, statics, &pairs[other], sweep_of);
                if motion.is_at_rest() {
                    continue;
                }
                let found = first_impact(&motion, &mid_phase::candidates(&motion, 0.0));
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
