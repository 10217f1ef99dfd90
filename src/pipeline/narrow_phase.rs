//! Narrow phase: the first impact of each pair within the step, and its contacts at the end.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Contact, Culling, Impact, Second, Side, Solid, Statics, StepInput,
    broad_phase::BodyPair,
    contact::{self, Reach},
    first_impact::{ImpactResult, first_impact},
    mid_phase::Candidates,
    motion::PairMotion,
    parallel, relative_pose,
    stop::Stops,
};
use crate::geometry::Pose3;

/// The first impact of each pair, were no body to stop.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<Candidates>],
    pool: &TaskPool,
) -> Vec<ImpactResult> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        first_impact(input.culling, motions, Some(&candidates[i]), [None; 2], 0.0, Vec3::ZERO)
    })
}

/// The contacts of each pair where its bodies end the step.
pub(super) fn contacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<Candidates>],
    stops: &Stops,
    pool: &TaskPool,
) -> Vec<Vec<Contact>> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let sides = [pair.first, pair.second];
        let [first, second] = sides.map(|side| solid(input, statics, side));
        let places = sides.map(|side| place(input, statics, side, |body| stops.final_pose(input, body)));
        let mut contacts = Vec::new();
        let reach = Reach { prediction: input.prediction, length_unit: input.length_unit };
        let Some(shape1) = first.medial() else { return contacts };
        let pose12 = relative_pose(places);
        match second.second() {
            Second::Shape(shape2) => {
                // What was found holds as long as both keep to their way.
                let known = input.culling == Culling::None || !pair.bodies().any(|body| stops.is_stopped(body));
                let candidates = known.then(|| candidates[i][0].iter().copied());
                contact::of_shapes(shape1, shape2, &pose12, reach, candidates, &mut contacts);
            }
            second => contact::find(shape1, second, &pose12, reach, &mut contacts),
        }
        contacts
    })
}

/// True if a pair that has met is in touch where its bodies are, or in a long step near enough.
pub(super) fn are_in_touch(
    input: &StepInput,
    statics: &Statics,
    pair: &BodyPair,
    met: &Impact,
    pose_of: impl Fn(u32) -> Pose3,
) -> bool {
    let sides = [pair.first, pair.second];
    let [first, second] = sides.map(|side| solid(input, statics, side));
    let pose12 = relative_pose(sides.map(|side| place(input, statics, side, &pose_of)));
    let met = [met.primitive1, met.primitive2];
    let is_within = |shape1| contact::is_within(shape1, second.second(), &pose12, input.parting_way(), met);
    first.medial().is_some_and(is_within)
}

/// What a side of a pair is made of.
fn solid<'a>(input: &'a StepInput, statics: &'a Statics, side: Side) -> &'a Solid {
    match side {
        Side::Body(body) => &input.bodies[body as usize].solid,
        Side::Static(body) => &statics.bodies[body as usize].solid,
    }
}

/// Where a side of a pair is, and its place in the order of all.
fn place(input: &StepInput, statics: &Statics, side: Side, pose_of: impl Fn(u32) -> Pose3) -> (Pose3, u32) {
    match side {
        Side::Body(body) => (pose_of(body), input.bodies[body as usize].order),
        Side::Static(body) => (statics.bodies[body as usize].pose, statics.bodies[body as usize].order),
    }
}
