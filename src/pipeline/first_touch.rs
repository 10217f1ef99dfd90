//! First touch of a single pair of bodies, outside of a step.

use std::time::Duration;

use glam::Vec3;

use super::{
    Body, Culling, Impact, Scratch, Side, Statics, StepInput,
    broad_phase::meet,
    first_impact::{Question, first_impact},
    motion::{Motions, PairMotion},
    pairs::BodyPair,
};

/// Computes the first impact of two moving bodies without any allowed overlap: the first touch of their surfaces, or the growth of an overlap that they have at
/// the start. Returns `None` without an impact, or if the first body is not medial.
///
/// A step uses the same search for cores instead of surfaces. Chords deviate a little from the true motion, so the result may be early by that distance. It
/// is late only by rounding. The function ignores collision groups.
///
/// `primitives`: the primitive pairs that may touch, in any order, from an external culling. The second body has to be medial in this case. The pairs are used
/// only for a motion that is searched in one part: cut a longer one into [`search_parts`] equal parts first.
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
        // Cached boxes would not be used by another pair.
        times: [None; 2],
        normal: Vec3::ZERO,
    };
    first_impact(&question, motions, &mut Scratch::default(), || Duration::ZERO).impact
}

/// Returns the number of equal parts in which [`first_touch`] searches the motion of two bodies, one after the other.
pub fn search_parts(bodies: [Body; 2]) -> usize {
    let input = StepInput { bodies: bodies.into(), ..Default::default() };
    motions(&input, &Statics::default()).iter().map(PairMotion::parts).max().unwrap_or(1)
}

/// The pair of the two bodies of an input.
const PAIR: BodyPair = BodyPair { first: Side::Body(0), second: Side::Body(1), stops: true };

/// Returns the motions of the pair.
fn motions<'a>(input: &'a StepInput, statics: &'a Statics) -> Motions<'a> {
    PairMotion::all(input, statics, &PAIR, |body| input.bodies[body as usize].sweep)
}
