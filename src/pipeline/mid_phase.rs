//! Mid phase: which primitives of a body pair may touch within the step, or come within the prediction distance.
//!
//! The two hierarchies are traversed against each other in the frame of body 2 at the start; boxes move along their middles'
//! chords. The sagitta of the whole step and the prediction distance widen them, so no pair is lost.

use bevy::tasks::TaskPool;
use glam::Mat3;

use super::{
    Culling, Statics, StepInput,
    broad_phase::BodyPair,
    contact::Second,
    motion::{PairMotion, SweptBox, SweptBoxes},
    parallel,
};

/// Indices of a primitive of the first body and one of the second.
pub(super) type PrimitivePair = [u32; 2];

/// Candidate primitive pairs, in ascending order, of each body pair.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    pool: &TaskPool,
) -> Vec<Vec<PrimitivePair>> {
    parallel::map(pool, pairs, 8, |_, pair| {
        let motion = PairMotion::new(input, statics, pair, |body| input.bodies[body as usize].sweep);
        if input.culling == Culling::None {
            let count2 = motion.second.len() as u32;
            return (0..motion.shape1.len() as u32).flat_map(|i| (0..count2).map(move |j| [i, j])).collect();
        }
        candidates(&motion, input.prediction)
    })
}

/// Candidate primitive pairs of one body pair, in ascending order.
pub(super) fn candidates(motion: &PairMotion, prediction: f32) -> Vec<PrimitivePair> {
    let frame = Mat3::from_quat(motion.sweep2.start.rotation).transpose();
    let boxes1 = SweptBoxes::new(&motion.sweep1, frame, motion.shape1.scale);
    let margin = prediction + motion.whole_sagitta();
    let mut pairs = Vec::new();
    match motion.second {
        Second::Shape(shape2) => {
            let boxes2 = SweptBoxes::new(&motion.sweep2, frame, shape2.scale);
            motion.shape1.bvh().visit_pairs(
                shape2.bvh(),
                |aabb1, aabb2| boxes1.place(aabb1).meets(&boxes2.place(aabb2), margin),
                |i, j| pairs.push([i, j]),
            );
        }
        // One convex target; for a box the pair's frame is its own.
        Second::Cuboid(_) | Second::Hull(_) | Second::Support(_) => {
            let target = SweptBox::at_rest(&motion.second.aabb());
            motion.shape1.bvh().visit(|aabb| boxes1.place(aabb).meets(&target, margin), |i| pairs.push([i, 0]));
        }
    }
    pairs.sort_unstable();
    pairs
}
