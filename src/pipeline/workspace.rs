//! What steps work with, kept from one to the next: once there is room for what a scene needs, a step allocates nothing.

use std::time::Duration;

use bevy::tasks::TaskPool;

use super::{
    Candidates, Contact, Counts, Meeting, Side, Statics, StepInput, StepOutput, Stop, broad_phase, contact,
    first_impact::{self, ImpactResult, Tally},
    laps,
    moving_boxes::BoxCache,
    narrow_phase,
    pairs::{BodyPair, PrimitivePair},
    parallel::Scratches,
    reduce, respond,
};

/// Buffers for steps. Those of a scene take the same from step to step.
#[derive(Debug, Default)]
pub struct Workspace {
    tasks: Scratches<Scratch>,
    broad: broad_phase::Buffers,
    pairs: Vec<BodyPair>,
    impacts: Vec<ImpactResult>,
    respond: respond::Buffers,
    /// The pairs that have manifolds, and how many.
    found: Vec<(usize, usize)>,
}

/// What a task works with, and what it keeps of pairs until all have been looked at.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub boxes: BoxCache,
    pub first_impact: first_impact::Buffers,
    pub contact: contact::Buffers,
    pub contacts: Vec<Contact>,
    pub reduce: reduce::Room,
    /// What culling has left of pairs, if that is to be reported.
    pub reported: Vec<(usize, Vec<PrimitivePair>)>,
    /// The pairs that have manifolds, and how many.
    pub found: Vec<(usize, usize)>,
    pub tally: Tally,
    /// What the two parts of its work took that are told apart.
    pub laps: [Duration; 2],
}

impl Scratch {
    /// Forgets the bodies and pairs of a step, also of one that a panic has broken off.
    fn forget(&mut self) {
        self.boxes.clear();
        self.reported.clear();
        self.found.clear();
        self.tally = Tally::default();
    }
}

impl Workspace {
    /// Runs stages 2 to 5 of a step. The filter is asked once about each pair that the broad phase finds, in their order.
    ///
    /// On one thread nothing is allocated once there is room. Other threads take some memory for each chunk of work, and so do bodies that face a
    /// collider of several parts.
    pub fn step(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        filter: impl Fn(Side, Side) -> Meeting,
        pool: &TaskPool,
        output: &mut StepOutput,
    ) {
        output.clear();
        let mut lap = laps();
        broad_phase::run(input, statics, filter, (&mut self.broad, &self.tasks), &mut self.pairs, pool);
        output.times.broad = lap();
        self.finish(input, statics, &[], output, pool);
    }

    /// Runs what follows culling, where that was done elsewhere. The filter is asked once about each pair that may collide, in their order.
    ///
    /// Of the candidates, pairs of bodies that may not collide are left out. Whatever is found by searching again within the step, where
    /// bodies spin fast, go far or have stopped, is culled as in any other step.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn step_from_candidates(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        candidates: Vec<Candidates>,
        filter: impl Fn(Side, Side) -> Meeting,
        pool: &TaskPool,
        output: &mut StepOutput,
    ) {
        output.clear();
        let mut lap = laps();
        let (pairs, known): (_, Vec<_>) =
            broad_phase::from_candidates(input, statics, candidates, filter).into_iter().unzip();
        self.pairs = pairs;
        output.times.broad = lap();
        self.finish(input, statics, &known, output, pool);
    }

    /// Runs what follows the broad phase. `known`: of each pair the primitives that may meet, where that is known.
    fn finish(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        known: &[Option<Vec<PrimitivePair>>],
        output: &mut StepOutput,
        pool: &TaskPool,
    ) {
        let Self { tasks, pairs, impacts, respond, found, .. } = self;
        tasks.iter_mut().for_each(Scratch::forget);
        let mut lap = laps();
        narrow_phase::impacts(input, statics, pairs, known, tasks, impacts, pool);
        [output.times.mid, output.times.narrow] = split(lap(), tasks);
        let first = tally(tasks);

        let courses = respond::run(input, statics, pairs, impacts, respond, tasks, pool);
        output.times.stop = lap();
        let again = tally(tasks);

        narrow_phase::manifolds(input, statics, pairs, courses, tasks, &mut output.manifolds, pool);
        let [contacts, reduction] = split(lap(), tasks);
        output.times.narrow += contacts;

        output.counts = Counts {
            bodies: input.bodies.len(),
            primitive_pairs: broad_phase::primitive_pairs(input, statics),
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
                primitives: Some(primitives),
            }));
        }
        output.stops.extend(courses.bodies().map(|body| Stop {
            body,
            fraction: courses.moved_until(body),
            pose: courses.final_pose(input, body),
        }));
        let reach = |pair: &BodyPair| input.reach([pair.first, pair.second], |body| courses.moved_until(body));
        found.clear();
        found.extend(tasks.iter_mut().flat_map(|scratch| scratch.found.drain(..)));
        found.sort_unstable();
        narrow_phase::tell(pairs, impacts, found, reach, output);
        output.times.reduce = reduction + lap();
    }
}

/// What the tasks' searches took since this was asked last.
fn tally(tasks: &mut Scratches<Scratch>) -> Tally {
    tasks.iter_mut().map(|scratch| std::mem::take(&mut scratch.tally)).fold(Tally::default(), |sum, more| Tally {
        candidates: sum.candidates + more.candidates,
        toi_tests: sum.toi_tests + more.toi_tests,
        unresolved: sum.unresolved + more.unresolved,
    })
}

/// The time of a stage in proportion to what its tasks have told of two parts of their work, which go on side by side.
fn split(took: Duration, tasks: &mut Scratches<Scratch>) -> [Duration; 2] {
    let parts = tasks
        .iter_mut()
        .map(|scratch| std::mem::take(&mut scratch.laps))
        .fold([0.0; 2], |sum, laps| [0, 1].map(|i: usize| sum[i] + laps[i].as_secs_f64()));
    let second = took.mul_f64(parts[1] / (parts[0] + parts[1]).max(f64::MIN_POSITIVE));
    [took.saturating_sub(second), second]
}
