//! When two bodies touch first, asked of one pair by itself.

use std::time::Duration;

use glam::Vec3;

use super::{
    Body, Culling, Impact, Scratch, Side, Statics, StepInput,
    broad_phase::meet,
    first_impact::{Question, first_impact},
    motion::{Motions, PairMotion},
    pairs::BodyPair,
};

/// The first impact of two bodies on their ways, with no overlap allowed: where they touch, or where an overlap that they have from the
/// start on grows. None if neither happens, or if the first is not medial.
///
/// A step searches in the same way for cores instead of surfaces. Chords stray a little from the true motion: the result is early by at most that distance. It
/// is late only by rounding. The function does not consider collision groups.
///
/// `primitives` of the first and the second, in any order, that may meet, if culling is done elsewhere. The second has to be medial as well then. They count
/// for a way that is searched at once: a longer one has to be cut into its [parts](search_parts) first.
pub fn first_touch(bodies: [Body; 2], culling: Culling, primitives: Option<&[[u32; 2]]>) -> Option<Impact> {
    if primitives.is_none() && !meet(&bodies) {
        return None;
    }
    let input = StepInput { bodies: bodies.into(), culling, ..Default::default() };
    let statics = Statics::default();
    let mut motions = motions(&input, &statics);
    motions.iter_mut().for_each(|motion| motion.tolerances.use_surfaces());
    let question = Question {
        input: &input,
        statics: &statics,
        pair: &PAIR,
        known: primitives,
        // Their boxes are of no use to another pair.
        times: [None; 2],
        normal: Vec3::ZERO,
    };
    first_impact(&question, motions, &mut Scratch::default(), || Duration::ZERO).impact
}

/// In how many parts of equal length [`first_touch`] searches the way of two bodies, one after the other.
pub fn search_parts(bodies: [Body; 2]) -> usize {
    let input = StepInput { bodies: bodies.into(), ..Default::default() };
    motions(&input, &Statics::default()).iter().map(PairMotion::parts).max().unwrap_or(1)
}

/// The bodies of an input that has two.
const PAIR: BodyPair = BodyPair { first: Side::Body(0), second: Side::Body(1), stops: true };

/// Their motions.
fn motions<'a>(input: &'a StepInput, statics: &'a Statics) -> Motions<'a> {
    PairMotion::all(input, statics, &PAIR, |body| input.bodies[body as usize].sweep)
}
