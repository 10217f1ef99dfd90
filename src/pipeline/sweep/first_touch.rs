//! First touch of a single pair of bodies, outside of a step.

use std::time::Duration;

use glam::Vec3;

use crate::pipeline::{
    Body, Culling, Impact, Primitives, Side, Statics, StepInput,
    broad::meet,
    pairs::BodyPair,
    sweep::{
        first_impact::{Question, Scratch, first_impact},
        motion::PairMotion,
    },
};

/// Computes the first impact of two moving bodies without any allowed overlap: the first touch of their surfaces, or the growth of an overlap that they have at
/// the start. Returns `None` without an impact, or if the first body is not medial.
///
/// A step uses the same search for cores instead of surfaces. Chords deviate a little from the true motion, so the result may be early by that distance. It
/// is late only by rounding. The function ignores collision groups.
///
/// `primitives`: the primitive pairs that may touch, in any order, from an external culling. The second body has to be medial in this case. The halves of a
/// long motion are culled again.
pub fn first_touch(bodies: [Body; 2], culling: Culling, primitives: Option<&[[u32; 2]]>) -> Option<Impact> {
    if primitives.is_none() && !meet(&bodies) {
        return None;
    }
    let input = StepInput { bodies: bodies.into(), culling, ..Default::default() };
    let statics = Statics::default();
    let mut motions = PairMotion::of_step(&input, &statics, &PAIR, |path, _| path == 0.0);
    motions.iter_mut().for_each(|motion| motion.tolerances.use_surfaces());
    let question = Question {
        input: &input,
        statics: &statics,
        pair: &PAIR,
        known: &primitives.map_or(Primitives::Unknown, |primitives| Primitives::MayTouch(primitives.to_vec())),
        earlier: None,
        // Cached boxes would not be used by another pair.
        times: [None; 2],
        normal: Vec3::ZERO,
    };
    first_impact(&question, motions, &mut Scratch::default(), || Duration::ZERO).impact
}

/// The pair of the two bodies of an input.
const PAIR: BodyPair = BodyPair { first: Side::Body(0), second: Side::Body(1), stops: true };
