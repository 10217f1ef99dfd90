//! Response: handles impacts in the order of time and decides which bodies leave their paths within the step.
//!
//! At an impact both bodies stop, unless one of them is a pusher: a kinematic body, or a body that one pushes. A pusher moves the other body along the
//! contact normal, and no farther than it moves itself, until it meets an obstacle that cannot be pushed.
//!
//! A body that has left its path invalidates the impacts of its pairs, which assume that path. They are searched again from that time on. A body goes
//! through a few states and a limited number of pushes, so the loop ends.

mod decision;
mod trajectory;

use std::{cmp::Ordering, collections::BinaryHeap, time::Duration};

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Impact, Primitives, Statics, StepInput,
    joint_islands::JointIslands,
    pairs::{BodyPair, PairsOf},
    parallel::{self, Scratches},
    sweep::{
        first_impact::{self, ImpactResult, Question, first_impact},
        motion::PairMotion,
    },
    tolerances::{Tolerances, slop},
};
use crate::{constants::MAX_PUSHES, geometry::Sweep};

use decision::{Obstacle, decide};
pub(super) use trajectory::Trajectories;
use trajectory::{State, Trajectory, displaced, displacement_at};

/// An impact of a pair in the queue. It is outdated if the time of the pair's next impact differs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Event {
    impact: Impact,
    pair: usize,
}

impl Event {
    /// Returns the time at which the bodies leave their paths, as a fraction less than 1.
    fn fraction(&self) -> f32 {
        self.impact.fraction.min(1.0f32.next_down())
    }
}

impl Eq for Event {}

impl PartialOrd for Event {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Event {
    /// The earliest event is the greatest, so a heap returns it first. Of events at the same time, the pair with the lowest index comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.impact.fraction.total_cmp(&self.impact.fraction).then(other.pair.cmp(&self.pair))
    }
}

/// Buffers that are reused from step to step.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    trajectories: Trajectories,
    pairs_of: PairsOf,
    joint_islands: JointIslands,
    queue: BinaryHeap<Event>,
    /// Per pair, time of the next impact as a fraction of the step; infinite without an impact.
    next: Vec<f32>,
    happened: Vec<bool>,
    outcomes: Vec<(u32, Trajectory)>,
    searches: Vec<(usize, f32)>,
    found: Vec<Option<Impact>>,
}

impl Scratch {
    /// Prepares for a step, and queues the impacts that stop a body. Returns false if the queue is empty.
    fn begin(&mut self, input: &StepInput, pairs: &[BodyPair], results: &[ImpactResult]) -> bool {
        self.trajectories.reset(input.bodies.len());
        self.queue.clear();
        self.queue.extend((0..pairs.len()).filter(|&pair| pairs[pair].stops).filter_map(|pair| {
            let impact = results[pair].impact.filter(|_| pairs[pair].bodies().any(|body| input.is_stopping(body)))?;
            Some(Event { impact, pair })
        }));
        if self.queue.is_empty() {
            return false;
        }
        self.pairs_of.set(input.bodies.len(), pairs);
        self.joint_islands.set(input);
        self.next.clear();
        self.next.extend(results.iter().map(|result| fraction_of(result.impact)));
        self.happened.clear();
        self.happened.resize(pairs.len(), false);
        true
    }
}

/// Handles impacts one after the other. Afterwards `results` holds the first impact of each pair that did happen.
pub(super) fn run<'b>(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    results: &mut [ImpactResult],
    buffers: &'b mut Scratch,
    tasks: &Scratches<first_impact::Scratch>,
    pool: &TaskPool,
) -> &'b Trajectories {
    if !buffers.begin(input, pairs, results) {
        return &buffers.trajectories;
    }
    let Scratch { trajectories, pairs_of, joint_islands, queue, next, happened, outcomes, searches, found } = buffers;
    let search =
        |trajectories: &Trajectories, results: &[ImpactResult], searches: &[(usize, f32)], found: &mut Vec<_>| {
            parallel::map(pool, tasks, searches, 4, found, |scratch, _, &(pair, fraction)| {
                impact_from(input, statics, &pairs[pair], trajectories, fraction, &results[pair], scratch)
            });
        };
    while let Some(event) = queue.pop() {
        if next[event.pair] != event.impact.fraction {
            continue;
        }
        next[event.pair] = f32::INFINITY;
        happened[event.pair] = true;
        outcomes.clear();
        respond(input, trajectories, joint_islands, &pairs[event.pair], &event, outcomes);
        outcomes.iter().for_each(|&(body, trajectory)| trajectories.set(body, trajectory));
        // A pusher that turns may hit the pushed body again.
        let pushes = outcomes.iter().any(|(_, trajectory)| trajectory.state == State::Pushed);
        let is_searched = |&pair: &usize| (pair != event.pair || pushes) && pairs[pair].stops;
        let affected = outcomes.iter().flat_map(|(body, _)| pairs_of.of(*body)).filter(is_searched);
        searches.clear();
        searches.extend(affected.map(|pair| (pair, event.fraction())));
        searches.sort_unstable_by_key(|(pair, _)| *pair);
        searches.dedup();
        search(trajectories, results, searches, found);
        for (&(pair, _), found) in searches.iter().zip(found.drain(..)) {
            next[pair] = fraction_of(found);
            if !happened[pair] {
                results[pair].impact = found;
            }
            queue.extend(found.map(|impact| Event { impact, pair }));
        }
    }
    // Impacts that stop no body are searched once, when all trajectories are known.
    searches.clear();
    searches.extend(
        (0..pairs.len()).filter(|&pair| !pairs[pair].stops).filter_map(|pair| {
            Some((pair, trajectories.searched_from(&pairs[pair], fraction_of(results[pair].impact))?))
        }),
    );
    search(trajectories, results, searches, found);
    for (&(pair, _), found) in searches.iter().zip(found.drain(..)) {
        results[pair].impact = found;
    }
    trajectories
}

/// Adds the new trajectories of the bodies of a pair after an impact, and of the bodies that are joined with them.
fn respond(
    input: &StepInput,
    trajectories: &Trajectories,
    joint_islands: &JointIslands,
    pair: &BodyPair,
    event: &Event,
    outcomes: &mut Vec<(u32, Trajectory)>,
) {
    let (impact, fraction) = (&event.impact, event.fraction());
    let sides = [(pair.first, pair.second, -impact.normal), (pair.second, pair.first, impact.normal)];
    for (side, other, away) in sides {
        let Some(body) = side.body().filter(|&body| input.is_stopping(body)) else { continue };
        let own = trajectories.sweep_from(input, body, fraction);
        let pusher = |other: u32| {
            let theirs = trajectories.sweep_from(input, other, fraction);
            let within = match input.bodies[other as usize].solid.deforming() {
                Some(shape) => shape.displacement_from(impact.primitive2, &theirs, impact.point, fraction),
                None => Vec3::ZERO,
            };
            Obstacle::Pusher {
                approach: approach(&own, &theirs, within, impact.point, away),
                exhausted: trajectories.pushed(body) >= trajectories.push_reach(input, other),
            }
        };
        let obstacle = match other.body() {
            None => Obstacle::Fixed,
            Some(other) if !input.is_stopping(other) || trajectories.state(other) == State::Pushed => pusher(other),
            Some(other) => Obstacle::Stopping(trajectories.state(other)),
        };
        let Some(state) = decide(trajectories.state(body), obstacle) else { continue };
        let (mut displacement, mut pushed, mut push_reach) = (Vec3::ZERO, trajectories.pushed(body), 0.0);
        if let (Obstacle::Pusher { approach, .. }, Some(other)) = (obstacle, other.body()) {
            push_reach = trajectories.push_reach(input, other);
            // Without the slop, bodies at their largest overlap would have the next impact at once.
            let radius = input.bodies[body as usize].solid.bounding_sphere().radius;
            let length = (approach + slop(input.length_unit, radius)).clamp(0.0, (push_reach - pushed).max(0.0));
            displacement = away * length;
            // A push counts at least this much, even without a displacement. This limits the number of pushes to MAX_PUSHES.
            pushed += length.max(push_reach / MAX_PUSHES as f32);
        }
        outcomes.extend(joint_islands.of(input, body).map(|body| {
            let now = trajectories.sweep_from(input, body, fraction);
            let rest = match state {
                State::Pushed => displaced(&now, input.bodies[body as usize].free_path(displacement)),
                _ => Sweep::at_rest(now.start),
            };
            (body, Trajectory { from: fraction, rest, state, pushed, push_reach })
        }));
    }
}

/// Returns how far a body has to be pushed along `away` so that it ends in front of the pusher, in metres: the point of contact ends on the plane that touches
/// the pusher there and turns with it. `own`, `theirs`: motions of body and pusher over the rest of the step. `within`: displacement of the point of contact in
/// the frame of the pusher.
///
/// A body that slides outwards on a turning pusher needs more than the displacement of the touched point. After turns of more than 60 degrees the function
/// returns that displacement, because the exact length grows without limit towards a quarter turn.
fn approach(own: &Sweep, theirs: &Sweep, within: Vec3, point: Vec3, away: Vec3) -> f32 {
    const LEAST_COSINE: f32 = 0.5;
    let relative = displacement_at(theirs, point) + within - displacement_at(own, point);
    let normal = theirs.end.rotation * theirs.start.rotation.inverse() * away;
    let cosine = normal.dot(away);
    if cosine > LEAST_COSINE { relative.dot(normal) / cosine } else { relative.dot(away) }
}

/// Returns the time of an impact as a fraction of the step; infinite without an impact.
fn fraction_of(impact: Option<Impact>) -> f32 {
    impact.map_or(f32::INFINITY, |impact| impact.fraction)
}

/// Finds the first impact of a pair from a fraction of the step on. `before`: the last result of the pair, whose normal is a hint for the search.
fn impact_from(
    input: &StepInput,
    statics: &Statics,
    pair: &BodyPair,
    trajectories: &Trajectories,
    fraction: f32,
    before: &ImpactResult,
    scratch: &mut first_impact::Scratch,
) -> Option<Impact> {
    let is_short = |path: f32, tolerances: &Tolerances| tolerances.is_short(path);
    let motions = PairMotion::all(input, statics, pair, is_short, fraction, |body| {
        trajectories.sweep_from(input, body, fraction)
    });
    let times = [pair.first, pair.second].map(|side| trajectories.times(side, fraction));
    let (known, normal) = (&Primitives::Unknown, before.normal);
    let question = Question { input, statics, pair, known, earlier: None, times, normal };
    // The time of searches after impacts is not split between stages.
    let found = first_impact(&question, motions, scratch, || Duration::ZERO).impact?;
    Some(Impact { fraction: fraction + (1.0 - fraction) * found.fraction, ..found })
}
