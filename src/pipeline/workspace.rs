//! Buffers that are kept from step to step: once they are large enough for a scene, a step allocates no memory.

use std::time::Duration;

use bevy::tasks::TaskPool;

use super::{
    Candidates, ContactCache, Counts, PairFilter, Primitives, Side, Statics, StepInput, StepOutput, Stop, broad,
    found::{self, AllFound},
    narrow_phase::{self, Ends},
    output::laps,
    pairs::BodyPair,
    parallel::Scratches,
    respond,
    sweep::first_impact::{self, ImpactResult, Tally},
};

/// Buffers for steps. Use one workspace per scene.
#[derive(Debug, Default)]
pub struct Workspace {
    searches: Scratches<first_impact::Scratch>,
    contact_searches: Scratches<found::Scratch>,
    broad: broad::Scratch,
    pairs: Vec<BodyPair>,
    impacts: Vec<ImpactResult>,
    respond: respond::Scratch,
    found: AllFound,
    contacts: ContactCache,
    /// A buffer for the contacts of the next step.
    next_contacts: ContactCache,
}

impl Workspace {
    /// Returns the contacts of the last step. Pairs that hardly move keep them in the next one.
    pub fn contacts(&self) -> &ContactCache {
        &self.contacts
    }

    /// Replaces the contacts of the last step, as part of a saved state.
    pub fn set_contacts(&mut self, contacts: ContactCache) {
        self.contacts = contacts;
    }

    /// Runs all stages of a step, from the broad phase to the reduction of contacts. Calls the filter once for each pair that the broad phase finds, in order.
    ///
    /// On one thread, no memory is allocated once the buffers are large enough. Several threads allocate for each chunk of work, and so do pairs with a
    /// collider of several parts.
    pub fn step(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        filter: impl Fn(Side, Side) -> PairFilter,
        pool: &TaskPool,
        output: &mut StepOutput,
    ) {
        output.clear();
        let mut lap = laps();
        broad::run(input, statics, filter, &mut self.broad, &mut self.pairs, pool);
        output.times.broad = lap();
        self.finish(input, statics, &[], output, pool);
    }

    /// Runs the stages after culling, with candidates from an external search. Calls the filter once for each pair that may collide, in order.
    ///
    /// Skips candidate pairs that may not collide. Searches after an impact cull on their own: they do not use the candidates' primitive pairs.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn step_from_candidates(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        candidates: Vec<Candidates>,
        filter: impl Fn(Side, Side) -> PairFilter,
        pool: &TaskPool,
        output: &mut StepOutput,
    ) {
        output.clear();
        let mut lap = laps();
        let (pairs, known): (_, Vec<_>) =
            broad::from_candidates(input, statics, candidates, filter).into_iter().unzip();
        self.pairs = pairs;
        output.times.broad = lap();
        self.finish(input, statics, &known, output, pool);
    }

    /// Runs the stages after the broad phase. `known`: the primitive pairs of each body pair; empty if no pair has any.
    fn finish(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        known: &[Primitives],
        output: &mut StepOutput,
        pool: &TaskPool,
    ) {
        let Self { searches, contact_searches, pairs, impacts, respond, found, contacts: cache, next_contacts, .. } =
            self;
        searches.iter_mut().for_each(first_impact::Scratch::forget);
        contact_searches.iter_mut().for_each(|scratch| scratch.found.clear());
        let mut lap = laps();
        narrow_phase::impacts(input, statics, pairs, known, cache, searches, impacts, pool);
        let laps = searches.iter_mut().map(|scratch| std::mem::take(&mut scratch.laps));
        [output.times.mid, output.times.narrow] = split(lap(), laps);
        let first = tally(searches);

        let trajectories = respond::run(input, statics, pairs, impacts, respond, searches, pool);
        output.times.stop = lap();
        let again = tally(searches);

        let ends = Ends { input, statics, known, trajectories, cache };
        ends.manifolds(pairs, contact_searches, &mut output.manifolds, pool);

        output.counts = Counts {
            bodies: input.bodies.len(),
            primitive_pairs: broad::primitive_pairs(input, statics),
            body_pairs: pairs.len(),
            candidates: first.candidates,
            toi_tests: first.toi_tests + again.toi_tests,
            unresolved: first.unresolved + again.unresolved,
            contacts: 0,
        };
        if input.report_candidates {
            let mut reported: Vec<_> = searches.iter_mut().flat_map(|scratch| scratch.reported.drain(..)).collect();
            reported.sort_unstable_by_key(|(pair, _)| *pair);
            output.candidates.extend(pairs.iter().zip(reported).map(|(pair, (_, primitives))| Candidates {
                sides: [pair.first, pair.second],
                primitives: Primitives::MayTouch(primitives),
            }));
        }
        output.stops.extend(trajectories.bodies().map(|body| Stop {
            body,
            fraction: trajectories.moved_until(body),
            pose: trajectories.final_pose(input, body),
        }));
        found.collect(contact_searches);
        ends.report(pairs, impacts, found, output);
        ends.fill(pairs, found, &output.manifolds, next_contacts);
        std::mem::swap(cache, next_contacts);
        output.times.contacts = lap();
    }
}

/// Returns the counters of all tasks and resets them.
fn tally(tasks: &mut Scratches<first_impact::Scratch>) -> Tally {
    tasks.iter_mut().map(|scratch| std::mem::take(&mut scratch.tally)).fold(Tally::default(), |sum, more| Tally {
        candidates: sum.candidates + more.candidates,
        toi_tests: sum.toi_tests + more.toi_tests,
        unresolved: sum.unresolved + more.unresolved,
    })
}

/// Splits the wall time of a stage into two parts, in proportion to the times that its tasks have measured.
fn split(took: Duration, tasks: impl Iterator<Item = [Duration; 2]>) -> [Duration; 2] {
    let parts = tasks.fold([0.0; 2], |sum, laps| [0, 1].map(|i: usize| sum[i] + laps[i].as_secs_f64()));
    let second = took.mul_f64(parts[1] / (parts[0] + parts[1]).max(f64::MIN_POSITIVE));
    [took.saturating_sub(second), second]
}
