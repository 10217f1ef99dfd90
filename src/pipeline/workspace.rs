//! Buffers that are kept from step to step: once they are large enough for a scene, a step allocates no memory.

use std::time::Duration;

use bevy::tasks::TaskPool;

use super::{
    Candidates, Contact, ContactCache, Counts, PairFilter, Primitives, Side, Statics, StepInput, StepOutput, Stop,
    broad,
    contacts::{find, reduce},
    laps,
    narrow_phase::{self, Ends, Found},
    pairs::{BodyPair, PrimitivePair},
    parallel::Scratches,
    respond,
    sweep::{
        first_impact::{self, ImpactResult, Tally},
        moving_boxes::BoxCache,
    },
};

/// Buffers for steps. Use one workspace per scene.
#[derive(Debug, Default)]
pub struct Workspace {
    tasks: Scratches<TaskScratch>,
    broad: broad::Scratch,
    pairs: Vec<BodyPair>,
    impacts: Vec<ImpactResult>,
    respond: respond::Scratch,
    found: Vec<Found>,
    contacts: ContactCache,
    /// A buffer for the contacts of the next step.
    next_contacts: ContactCache,
}

/// Buffers of a task, and the results that it keeps until all pairs are done.
#[derive(Debug, Default)]
pub(super) struct TaskScratch {
    pub boxes: BoxCache,
    pub first_impact: first_impact::Scratch,
    pub contact: find::Scratch,
    pub contacts: Vec<Contact>,
    /// Primitive pairs of a pair that may have contacts.
    pub listed: Vec<[u32; 2]>,
    pub reduce: reduce::Scratch,
    /// Candidates of each pair after culling, if they are part of the output.
    pub reported: Vec<(usize, Vec<PrimitivePair>)>,
    pub found: Vec<Found>,
    pub tally: Tally,
    /// Time spent on each of the two parts of the work of the stage.
    pub laps: [Duration; 2],
}

impl TaskScratch {
    /// Drops the bodies and pairs of the last step, even if a panic has interrupted that step.
    fn forget(&mut self) {
        self.boxes.clear();
        self.reported.clear();
        self.found.clear();
        self.tally = Tally::default();
    }
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

    /// Runs stages 2 to 5 of a step. Calls the filter once for each pair that the broad phase finds, in order.
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
        broad::run(input, statics, filter, (&mut self.broad, &self.tasks), &mut self.pairs, pool);
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
        let Self { tasks, pairs, impacts, respond, found, contacts: cache, next_contacts, .. } = self;
        tasks.iter_mut().for_each(TaskScratch::forget);
        let mut lap = laps();
        narrow_phase::impacts(input, statics, pairs, known, cache, tasks, impacts, pool);
        [output.times.mid, output.times.narrow] = split(lap(), tasks);
        let first = tally(tasks);

        let trajectories = respond::run(input, statics, pairs, impacts, respond, tasks, pool);
        output.times.stop = lap();
        let again = tally(tasks);

        let ends = Ends { input, statics, known, trajectories, cache };
        ends.manifolds(pairs, tasks, &mut output.manifolds, pool);
        let [contacts, reduction] = split(lap(), tasks);
        output.times.narrow += contacts;

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
            let mut reported: Vec<_> = tasks.iter_mut().flat_map(|scratch| scratch.reported.drain(..)).collect();
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
        let reach =
            |pair: &BodyPair| input.contact_margin([pair.first, pair.second], |body| trajectories.moved_until(body));
        found.clear();
        found.extend(tasks.iter_mut().flat_map(|scratch| scratch.found.drain(..)));
        found.sort_unstable_by_key(|found| found.pair);
        narrow_phase::tell(pairs, impacts, found, reach, output);
        ends.fill(pairs, found, &output.manifolds, next_contacts);
        std::mem::swap(cache, next_contacts);
        output.times.reduce = reduction + lap();
    }
}

/// Returns the counters of all tasks and resets them.
fn tally(tasks: &mut Scratches<TaskScratch>) -> Tally {
    tasks.iter_mut().map(|scratch| std::mem::take(&mut scratch.tally)).fold(Tally::default(), |sum, more| Tally {
        candidates: sum.candidates + more.candidates,
        toi_tests: sum.toi_tests + more.toi_tests,
        unresolved: sum.unresolved + more.unresolved,
    })
}

/// Splits the wall time of a stage into two parts, in proportion to the times that its tasks have measured. Resets the tasks' times.
fn split(took: Duration, tasks: &mut Scratches<TaskScratch>) -> [Duration; 2] {
    let parts = tasks
        .iter_mut()
        .map(|scratch| std::mem::take(&mut scratch.laps))
        .fold([0.0; 2], |sum, laps| [0, 1].map(|i: usize| sum[i] + laps[i].as_secs_f64()));
    let second = took.mul_f64(parts[1] / (parts[0] + parts[1]).max(f64::MIN_POSITIVE));
    [took.saturating_sub(second), second]
}
