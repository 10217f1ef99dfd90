//! Mid phase: which primitives of a pair may touch within the step, or come within the prediction distance.
//!
//! The two hierarchies are traversed against each other in the frame of body 2 at the start; boxes move along their middles'
//! chords. The sagitta of the whole step and the prediction distance widen them, so no pair is lost.

use super::{
    Culling, Statics, StepInput,
    broad_phase::BodyPair,
    motion::{Facing, PairMotion, SweptBoxes},
    parallel,
};
use bevy::tasks::TaskPool;

/// Indices of a primitive of the first body and one of the second; of a part, which is one, 0.
pub(super) type PrimitivePair = [u32; 2];

/// Candidate primitive pairs, in ascending order, for each motion of each pair.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    pool: &TaskPool,
) -> Vec<Vec<Vec<PrimitivePair>>> {
    parallel::map(pool, pairs, 8, |_, pair| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        motions.iter().map(|motion| candidates(motion, input.culling, input.prediction)).collect()
    })
}

/// Given primitive pairs of each pair, for each of its motions.
pub(super) fn from_candidates(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    primitives: Vec<Vec<PrimitivePair>>,
) -> Vec<Vec<Vec<PrimitivePair>>> {
    let of_motion = |motion: &PairMotion, primitives: &[PrimitivePair]| match &motion.facing {
        Facing::Shape(_) => primitives.to_vec(),
        Facing::Part(part) => primitives.iter().filter(|[_, j]| *j == part.id).map(|&[i, _]| [i, 0]).collect(),
    };
    let of_pair = |(pair, primitives): (&BodyPair, Vec<PrimitivePair>)| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        motions.iter().map(|motion| of_motion(motion, &primitives)).collect()
    };
    pairs.iter().zip(primitives).map(of_pair).collect()
}

/// Candidate primitive pairs of one motion, in ascending order.
pub(super) fn candidates(motion: &PairMotion, culling: Culling, prediction: f32) -> Vec<PrimitivePair> {
    if culling == Culling::None {
        return all(motion);
    }
    let frame = motion.sweep2.start.rotation.inverse();
    let boxes1 = SweptBoxes::new(&motion.sweep1, frame, motion.shape1.scale);
    let margin = prediction + motion.whole_sagitta();
    let mut pairs = Vec::new();
    match &motion.facing {
        Facing::Shape(shape2) => {
            let boxes2 = SweptBoxes::new(&motion.sweep2, frame, shape2.scale);
            motion.shape1.bvh().visit_pairs(
                shape2.bvh(),
                |aabb1| boxes1.place(aabb1),
                |aabb2| boxes2.place(aabb2),
                |swept1, swept2| swept1.meets(swept2, margin),
                |i, j| pairs.push([i, j]),
            );
        }
        Facing::Part(part) => {
            let target = SweptBoxes::new(&motion.sweep2, frame, 1.0).place(&part.aabb());
            motion.shape1.bvh().visit(|aabb| boxes1.place(aabb).meets(&target, margin), |i| pairs.push([i, 0]));
        }
    }
    pairs.sort_unstable();
    pairs
}

fn all(motion: &PairMotion) -> Vec<PrimitivePair> {
    let count2 = match &motion.facing {
        Facing::Shape(shape2) => shape2.len() as u32,
        Facing::Part(_) => 1,
    };
    (0..motion.shape1.len() as u32).flat_map(|i| (0..count2).map(move |j| [i, j])).collect()
}
