//! Narrow phase: the first impact of each pair within the step, and its contacts at the final poses.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    BoundedPair, CachedPair, Contact, ContactCache, ContactMargin, Culling, Displacement, Manifold, Pair, Primitives,
    Side, Statics, StepInput, StepOutput,
    contacts::{
        approach::Approach,
        find::{self, Listed},
        gap, reduce,
    },
    output::laps,
    pairs::BodyPair,
    parallel::{self, Scratches},
    respond::Trajectories,
    sweep::{
        first_impact::{self, ImpactResult, Question, first_impact},
        motion::PairMotion,
    },
    tolerances::Tolerances,
};
use crate::geometry::{Pose3, Sweep};

/// Finds the first impact of each pair on the assumption that no body leaves its path. `known`: the primitive pairs of each pair; empty if no pair has any.
/// `cache`: the contacts of the last step.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    known: &[Primitives],
    cache: &ContactCache,
    tasks: &Scratches<first_impact::Scratch>,
    impacts: &mut Vec<ImpactResult>,
    pool: &TaskPool,
) {
    parallel::map(pool, tasks, pairs, 4, impacts, |scratch, i, pair| {
        let known = known.get(i).unwrap_or(&Primitives::Unknown);
        let gap = gap_at_start(input, statics, pair, cache);
        let is_idle = |path: f32, tolerances: &Tolerances| tolerances.is_short(path) || path + tolerances.reach() < gap;
        let motions = PairMotion::of_step(input, statics, pair, is_idle);
        let times = [Some([0.0, 1.0]); 2];
        let question = Question { input, statics, pair, known, times, normal: Vec3::ZERO };
        let result = first_impact(&question, motions, scratch, laps());
        if input.report_candidates {
            scratch.report(i);
        }
        result
    });
}

/// Returns a lower bound of the distance of a pair at the start of the step, in metres; 0 if it is not known.
fn gap_at_start(input: &StepInput, statics: &Statics, pair: &BodyPair, cache: &ContactCache) -> f32 {
    let sides = [pair.first, pair.second];
    let [Some(id1), Some(id2)] = sides.map(|side| input.id(statics, side)) else { return 0.0 };
    // Candidates in the output do not depend on earlier steps.
    if !input.recycle_contacts || input.report_candidates {
        return 0.0;
    }
    let pose12 = input.pose12(statics, sides, |body| input.bodies[body as usize].sweep.start);
    cache.gap([id1, id2], sides.map(|side| input.side(statics, side).0), &pose12)
}

/// Buffers of a task for contacts, and the results that it keeps until all pairs are done.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    find: find::Scratch,
    contacts: Vec<Contact>,
    /// Primitive pairs of a pair that may have contacts.
    listed: Vec<[u32; 2]>,
    reduce: reduce::Scratch,
    pub found: Vec<Found>,
}

/// A pair whose contacts were searched or recycled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// Index of the pair.
    pub pair: usize,
    /// Number of manifolds.
    pub count: usize,
    /// Margin of the search.
    pub reach: ContactMargin,
    /// Lower bound of the distance of the bodies in metres, from the search; 0 if they have contacts.
    pub gap: f32,
    /// Pose of the second side in the frame of the first, to which the manifolds refer.
    pub pose12: Pose3,
    /// Index of the pair in the cache, if its contacts were not searched.
    pub recycled: Option<u32>,
}

/// Data for the contacts of a step.
pub(super) struct Ends<'a> {
    pub input: &'a StepInput,
    pub statics: &'a Statics,
    /// The primitive pairs of each pair; empty if no pair has any.
    pub known: &'a [Primitives],
    /// Where bodies end the step.
    pub trajectories: &'a Trajectories,
    /// Contacts of the last step.
    pub cache: &'a ContactCache,
}

impl Ends<'_> {
    /// Finds the manifolds of each pair at the final poses of its bodies. The pairs are listed in the tasks' scratch buffers.
    pub fn manifolds(
        &self,
        pairs: &[BodyPair],
        tasks: &Scratches<Scratch>,
        manifolds: &mut Vec<Manifold>,
        pool: &TaskPool,
    ) {
        let Self { input, trajectories, .. } = *self;
        parallel::gather(pool, tasks, pairs, 4, manifolds, |scratch, i, pair, manifolds| {
            // Rapier needs no contacts between sleeping bodies that are not pushed.
            if pair.bodies().any(|body| input.bodies[body as usize].active || trajectories.leaves_path(body)) {
                self.manifolds_of(i, pair, scratch, manifolds);
            }
        });
    }

    fn manifolds_of(&self, index: usize, pair: &BodyPair, scratch: &mut Scratch, manifolds: &mut Vec<Manifold>) {
        let Self { input, statics, trajectories, .. } = *self;
        let Scratch { find: buffers, contacts, listed, reduce, found } = scratch;
        let sides = [pair.first, pair.second];
        let [(first, _), (second, _)] = sides.map(|side| input.side(statics, side));
        let pose12 = input.pose12(statics, sides, |body| trajectories.final_pose(input, body));
        let Some(shape1) = first.medial() else { return };
        let reach = self.margin(sides);
        let before = manifolds.len();
        let recycled = self.recycled(sides, reach, &pose12);
        let mut gap = 0.0;
        if let Some(index) = recycled {
            manifolds.extend(self.cache.manifolds_at(index, pose12));
        } else {
            contacts.clear();
            let listed = self.listed(index, pair, listed);
            find::find_with(shape1, second.second(), &pose12, reach, listed, contacts, buffers);
            let approach = if reach.is_fast { self.approach(sides) } else { None };
            reach.keep_reached(contacts, |contact| {
                approach.is_some_and(|approach| approach.reaches(contact, shape1, second.second()))
            });
            // The gap lets later steps skip the search. A fast pair closes it within a few steps, so computing it does not pay.
            let is_slow = reach.prediction < input.prediction;
            if contacts.is_empty() && is_slow && input.recycle_contacts {
                gap = gap::gap(shape1, second.second(), &pose12, 2.0 * input.prediction).max(0.0);
            }
            reduce::reduce(contacts, input.length_unit, reduce, |manifold| manifolds.push(manifold));
        }
        found.push(Found { pair: index, count: manifolds.len() - before, reach, gap, pose12, recycled });
    }

    /// Returns the relative motion of a pair in the coming step; `None` if the second side is skinned, because its next pose is not known.
    fn approach(&self, sides: [Side; 2]) -> Option<Approach> {
        let Self { input, statics, trajectories, .. } = *self;
        if input.side(statics, sides[1]).0.deforming().is_some() {
            return None;
        }
        let sweep = |side: Side| match side {
            Side::Static(body) => Some(Sweep::at_rest(statics.bodies[body as usize].pose)),
            Side::Body(body) => {
                let next = self.next_displacement(side)?;
                let center = input.bodies[body as usize].sweep.local_center;
                Some(Sweep::at_rates(trajectories.final_pose(input, body), center, next.translation, next.rotation))
            }
        };
        Some(Approach::new(&[sweep(sides[0])?, sweep(sides[1])?]))
    }

    /// Returns the primitive pairs that may have contacts, if they are known. `listed`: a buffer for them.
    fn listed<'l>(&self, index: usize, pair: &BodyPair, listed: &'l mut Vec<[u32; 2]>) -> Listed<'l> {
        let Self { input, known, trajectories, .. } = *self;
        if input.culling == Culling::None {
            return Listed::All;
        }
        // The bounds hold while both bodies are on their own paths at the same time.
        let mut ends = pair.bodies().map(|body| trajectories.path_end(body));
        let (Some(Primitives::Bounded(known)), Some(Some(end))) = (known.get(index), ends.next()) else {
            return Listed::Unknown;
        };
        if ends.any(|other| other != Some(end)) {
            return Listed::Unknown;
        }
        listed.clear();
        let is_near = |bounded: &&BoundedPair| end < 1.0 || bounded.is_near_at_end;
        listed.extend(known.iter().filter(is_near).map(|bounded| bounded.primitives));
        listed.sort_unstable();
        Listed::Pairs(listed)
    }

    /// Returns the index of a pair in the cache, if its contacts are still valid.
    fn recycled(&self, sides: [Side; 2], reach: ContactMargin, pose12: &Pose3) -> Option<u32> {
        let Self { input, statics, cache, .. } = *self;
        if !input.recycle_contacts {
            return None;
        }
        let [id1, id2] = sides.map(|side| input.id(statics, side));
        cache.find([id1?, id2?], sides.map(|side| input.side(statics, side).0), reach, pose12)
    }

    /// Returns the margin of the contact search of a pair at the end of the step.
    fn margin(&self, sides: [Side; 2]) -> ContactMargin {
        let margin = ContactMargin::new(self.input.prediction, self.input.length_unit);
        match sides.map(|side| self.next_displacement(side)) {
            [Some(first), Some(second)] => margin.of_pair([&first, &second]),
            _ => margin,
        }
    }

    /// Returns the displacement of a side in the next step, which is longer by the time that the body has lost. `None` if no solver acts on it.
    fn next_displacement(&self, side: Side) -> Option<Displacement> {
        let Some(body) = side.body() else { return Some(Displacement::REST) };
        Some(self.input.bodies[body as usize].next_displacement?.times(2.0 - self.trajectories.moved_until(body)))
    }

    /// Adds the pairs with manifolds or an impact to the output, whose manifolds are set.
    pub fn report(&self, pairs: &[BodyPair], impacts: &[ImpactResult], found: &[Found], output: &mut StepOutput) {
        let mut found = found.iter().peekable();
        let mut begin = 0;
        for (i, (pair, ImpactResult { impact, .. })) in pairs.iter().zip(impacts).enumerate() {
            let search = found.next_if(|found| found.pair == i);
            let count = search.map_or(0, |found| found.count);
            let manifolds = begin..begin + count;
            begin = manifolds.end;
            if count > 0 || impact.is_some() {
                let points = output.manifolds[manifolds.clone()].iter().map(|manifold| manifold.contacts().len());
                output.counts.contacts += points.sum::<usize>();
                let &BodyPair { first, second, .. } = pair;
                let reach = search.map_or_else(|| self.margin([first, second]), |found| found.reach);
                output.pairs.push(Pair { first, second, manifolds, reach, impact: *impact });
            }
        }
    }

    /// Lists the contacts for the next step. `manifolds`: those of all pairs.
    pub fn fill(&self, pairs: &[BodyPair], found: &[Found], manifolds: &[Manifold], next: &mut ContactCache) {
        let Self { input, statics, cache, .. } = *self;
        next.clear();
        let mut begin = 0;
        for &Found { pair, count, reach, gap, pose12, recycled } in found {
            let manifolds = &manifolds[begin..begin + count];
            begin += count;
            let sides = [pairs[pair].first, pairs[pair].second];
            if let Some(index) = recycled {
                next.keep(cache, index, reach, pose12);
            } else if let [Some(id1), Some(id2)] = sides.map(|side| input.id(statics, side)) {
                let solids = sides.map(|side| input.side(statics, side).0);
                next.push(CachedPair::new([id1, id2], solids, reach, pose12, gap), manifolds);
            }
        }
    }
}
