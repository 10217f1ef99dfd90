//! When two bodies touch first, asked of one pair by itself.

use glam::Vec3;

use super::{
    Body, Culling, Impact, Side, Statics, StepInput, broad_phase::BodyPair, first_impact::first_impact,
    mid_phase::Candidates, motion::PairMotion,
};
use crate::constants::{CHORD_TOLERANCE, CLOSE_LOOK, FINE_CHORD_TOLERANCE};

/// The first impact of two bodies on their ways, with no overlap allowed: where they touch, or where an overlap that they have from the
/// start on grows. None if neither happens, or if the first is not medial.
///
/// Found as in a step, but for the slop, and looked at closely from there on: up to [`FINE_CHORD_TOLERANCE`] of the smaller one's size before the true
/// touch for either side, and never after it but for rounding. Whether the bodies may collide at all is not asked.
///
/// `primitives` of the first and the second, in any order, that may meet, if culling is done elsewhere. The second has to be medial as well then.
pub fn first_touch(bodies: [Body; 2], culling: Culling, primitives: Option<&[[u32; 2]]>) -> Option<Impact> {
    let mut from = 0.0;
    while from < 1.0 {
        let early = search(&bodies, culling, primitives, [from, 1.0], CHORD_TOLERANCE)?;
        let until = (early.fraction + CLOSE_LOOK).min(1.0);
        let found = search(&bodies, culling, primitives, [early.fraction, until], FINE_CHORD_TOLERANCE);
        if found.is_some() {
            return found;
        }
        // They have passed each other by less than what the chords have added.
        from = until;
    }
    None
}

/// The first impact between two fractions of the step, by chords of a tolerance.
fn search(
    bodies: &[Body; 2],
    culling: Culling,
    primitives: Option<&[[u32; 2]]>,
    times: [f32; 2],
    tolerance: f32,
) -> Option<Impact> {
    let bodies = bodies.clone().map(|body| Body { sweep: body.sweep.part(times), ..body });
    let input = StepInput { bodies: bodies.into(), culling, ..Default::default() };
    let statics = Statics::default();
    let pair = BodyPair { first: Side::Body(0), second: Side::Body(1), stops: true };
    let mut motions = PairMotion::all(&input, &statics, &pair, |body| input.bodies[body as usize].sweep);
    motions.iter_mut().for_each(|motion| (motion.slop, motion.tolerance) = (0.0, tolerance));
    let candidates = primitives.map(|pairs| [Candidates::all(pairs.iter().copied(), None)]);
    let candidates = candidates.as_ref().map(|candidates| &candidates[..]);
    let impact = first_impact(culling, motions, candidates, [None; 2], 0.0, Vec3::ZERO).impact?;
    Some(Impact { fraction: times[0] + (times[1] - times[0]) * impact.fraction, ..impact })
}
