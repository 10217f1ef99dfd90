//! Narrow phase: the first impact of each pair within the step, and its contacts at the final poses.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Manifold, Pair, Reach, Scratch, Side, Statics, StepInput, StepOutput, contact,
    first_impact::{ImpactResult, Question, first_impact},
    laps,
    motion::PairMotion,
    pairs::{BodyPair, PrimitivePair},
    parallel::{self, Scratches},
    reduce, relative_pose,
    respond::Courses,
};
use crate::geometry::Pose3;

/// Finds the first impact of each pair on the assumption that no body leaves its path. `known`: the candidate primitive pairs of each pair, where they are
/// known.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    known: &[Option<Vec<PrimitivePair>>],
    tasks: &Scratches<Scratch>,
    impacts: &mut Vec<ImpactResult>,
    pool: &TaskPool,
) {
    parallel::map(pool, tasks, pairs, 4, impacts, |scratch, i, pair| {
        let known = known.get(i).and_then(Option::as_deref);
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        let times = [Some([0.0, 1.0]); 2];
        let question = Question { input, statics, pair, known, times, normal: Vec3::ZERO };
        let result = first_impact(&question, motions, scratch, laps());
        if input.report_candidates {
            scratch.reported.push((i, std::mem::take(&mut scratch.first_impact.reported)));
        }
        result
    });
}

/// Finds the manifolds of each pair at the final poses of its bodies. The numbers of manifolds are stored in the tasks' scratch buffers.
pub(super) fn manifolds(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    courses: &Courses,
    tasks: &Scratches<Scratch>,
    manifolds: &mut Vec<Manifold>,
    pool: &TaskPool,
) {
    parallel::gather(pool, tasks, pairs, 4, manifolds, |scratch, i, pair, manifolds| {
        // Rapier needs no contacts between sleeping bodies that are not pushed.
        if !pair.bodies().any(|body| input.bodies[body as usize].active || courses.leaves_path(body)) {
            return;
        }
        let Scratch { contact: buffers, contacts, reduce, found, laps: [finding, reducing], .. } = scratch;
        let mut lap = laps();
        let sides = [pair.first, pair.second];
        let [(first, _), (second, _)] = sides.map(|side| input.side(statics, side));
        let pose12 =
            relative_pose(sides.map(|side| place(input, statics, side, |body| courses.final_pose(input, body))));
        let Some(shape1) = first.medial() else { return };
        let reach = input.reach(sides, |body| courses.moved_until(body));
        contacts.clear();
        contact::find_with(shape1, second.second(), &pose12, reach, input.culling, contacts, buffers);
        *finding += lap();
        if contacts.is_empty() {
            return;
        }
        let before = manifolds.len();
        reduce::reduce(contacts, input.length_unit, reduce, |manifold| manifolds.push(manifold));
        found.push((i, manifolds.len() - before));
        *reducing += lap();
    });
}

/// Adds the pairs with manifolds or an impact to the output, whose manifolds are set. `found`: index of each pair with manifolds, and their number. `reach`:
/// reach of the contact search of a pair.
pub(super) fn tell(
    pairs: &[BodyPair],
    impacts: &[ImpactResult],
    found: &[(usize, usize)],
    reach: impl Fn(&BodyPair) -> Reach,
    output: &mut StepOutput,
) {
    let mut found = found.iter().peekable();
    let mut begin = 0;
    for (i, (pair, ImpactResult { impact, .. })) in pairs.iter().zip(impacts).enumerate() {
        let count = found.next_if(|(pair, _)| *pair == i).map_or(0, |(_, count)| *count);
        let manifolds = begin..begin + count;
        begin = manifolds.end;
        if count > 0 || impact.is_some() {
            let points = output.manifolds[manifolds.clone()].iter().map(|manifold| manifold.contacts().len());
            output.counts.contacts += points.sum::<usize>();
            let (first, second, reach) = (pair.first, pair.second, reach(pair));
            output.pairs.push(Pair { first, second, manifolds, reach, impact: *impact });
        }
    }
}

/// Returns the pose of a side of a pair, and its [`Body::order`](super::Body::order).
fn place(input: &StepInput, statics: &Statics, side: Side, pose_of: impl Fn(u32) -> Pose3) -> (Pose3, u32) {
    match side {
        Side::Body(body) => (pose_of(body), input.bodies[body as usize].order),
        Side::Static(body) => (statics.bodies[body as usize].pose, statics.bodies[body as usize].order),
    }
}
