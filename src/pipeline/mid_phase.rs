//! Mid phase: which primitives of a pair may touch within the step, or come within the prediction distance.
//!
//! The boxes of each body's hierarchy are placed once, at the start of the step and at its end, and the two hierarchies of a pair are traversed against
//! each other: what is left are primitives whose boxes meet on their way. They have room for the arcs of what is in them, and the prediction distance
//! widens them, so no pair is lost as long as the bodies keep to their way. Of a way that is searched for impacts in parts it is the last part that counts.

use bevy::tasks::TaskPool;
use glam::{Vec3, Vec3A};

use super::{
    Culling, Shape, Statics, StepInput,
    broad_phase::BodyPair,
    motion::{Facing, PairMotion},
    moving_boxes::{self, BodyBoxes, MovingBox, MovingBoxes, TimedBoxes},
    parallel,
};
use crate::constants::CONTACT_ROUNDING;

/// Indices of a primitive of the first body and one of the second; of a part, which is one, 0.
pub(super) type PrimitivePair = [u32; 2];

/// Primitives of a pair that may meet, in ascending order.
pub(super) type Candidates = Vec<PrimitivePair>;

/// Candidate primitive pairs for each motion of each pair. Of what is searched for impacts in parts, those of the last part: where contacts are.
pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    boxes: &BodyBoxes,
    pool: &TaskPool,
) -> Vec<Vec<Candidates>> {
    parallel::map(pool, pairs, 8, |_, pair| {
        let mut motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        let parts = motions.iter().map(PairMotion::parts).max().unwrap_or(1);
        let times = [1.0 - 1.0 / parts as f32, 1.0];
        if parts > 1 {
            motions.iter_mut().for_each(|motion| motion.cut(times));
        }
        let boxes = [pair.first, pair.second].map(|side| boxes.between(side, times));
        motions.iter().map(|motion| candidates(motion, input.culling, input.prediction, boxes)).collect()
    })
}

/// Given primitive pairs of each pair, for each of its motions.
pub(super) fn from_candidates(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    primitives: Vec<Option<Vec<PrimitivePair>>>,
    boxes: &BodyBoxes,
) -> Vec<Vec<Candidates>> {
    let of_motion = |motion: &PairMotion, primitives: &[PrimitivePair]| match &motion.facing {
        Facing::Shape(_) => primitives.to_vec(),
        Facing::Part(part) => primitives.iter().filter(|[_, j]| *j == part.id).map(|&[i, _]| [i, 0]).collect(),
    };
    let of_pair = |(pair, primitives): (&BodyPair, Option<Vec<PrimitivePair>>)| {
        let motions = PairMotion::all(input, statics, pair, |body| input.bodies[body as usize].sweep);
        let boxes = [pair.first, pair.second].map(|side| boxes.between(side, [0.0, 1.0]));
        let of_motion = |motion| match &primitives {
            Some(primitives) => of_motion(motion, primitives),
            None => candidates(motion, input.culling, input.prediction, boxes),
        };
        motions.iter().map(of_motion).collect()
    };
    pairs.iter().zip(primitives).map(of_pair).collect()
}

/// The primitives that come within `reach` metres of each other on their way. `boxes`: of either side over its time, if they are known; what a body has
/// left its way by is part of `reach` then.
pub(super) fn candidates(
    motion: &PairMotion,
    culling: Culling,
    reach: f32,
    boxes: [Option<TimedBoxes>; 2],
) -> Candidates {
    if culling == Culling::None {
        return all(motion);
    }
    match &motion.facing {
        Facing::Shape(shape2) => of_shapes(motion, shape2, boxes, reach),
        Facing::Part(part) => {
            let [start, end] = [motion.sweep2.start, motion.sweep2.end];
            let target = MovingBox::new([start, end].map(|pose| part.aabb().transformed(&pose, 1.0)));
            let margin = reach + motion.sagitta_of_second();
            // Boxes with the world's axes do if those are the part's as well.
            let own;
            let (boxes, offset) = match (boxes[0], motion.world_offset()) {
                (Some(boxes), Some(frame)) => (boxes, Vec3A::from(frame) - boxes.origin()),
                _ => {
                    let around = MovingBox::around(motion.shape1, &motion.sweep1);
                    if !around.meets(&target, Vec3A::ZERO, margin) {
                        return Vec::new();
                    }
                    own = MovingBoxes::new(motion.shape1, &motion.sweep1, Vec3::ZERO);
                    (own.whole(), Vec3A::ZERO)
                }
            };
            let mut pairs = Vec::new();
            let meets = |node: usize| boxes.node(node).meets(&target, offset, margin);
            motion.shape1.bvh().visit_tested(meets, |i| pairs.push([i, 0]));
            pairs.sort_unstable();
            pairs
        }
    }
}

/// The primitives of two shapes whose boxes, widened by `reach`, meet.
fn of_shapes(motion: &PairMotion, shape2: &Shape, boxes: [Option<TimedBoxes>; 2], reach: f32) -> Candidates {
    let mut pairs = Vec::new();
    let shapes = [motion.shape1, shape2];
    let reach = reach + CONTACT_ROUNDING * motion.size;
    let meets = |box1: &MovingBox, box2: &MovingBox, offset| box1.meets(box2, offset, reach);
    let mut visit = |boxes| moving_boxes::visit_pairs(shapes, boxes, meets, |i, j| pairs.push([i, j]));
    match boxes {
        [Some(boxes1), Some(boxes2)] => visit([boxes1, boxes2]),
        _ => {
            let sides = [(motion.shape1, &motion.sweep1), (shape2, &motion.sweep2)];
            let [around1, around2] = sides.map(|(shape, sweep)| MovingBox::around(shape, sweep));
            if around1.meets(&around2, Vec3A::ZERO, reach) {
                let boxes = sides.map(|(shape, sweep)| MovingBoxes::new(shape, sweep, Vec3::ZERO));
                visit(boxes.each_ref().map(MovingBoxes::whole));
            }
        }
    }
    pairs.sort_unstable();
    pairs
}

fn all(motion: &PairMotion) -> Candidates {
    let count2 = match &motion.facing {
        Facing::Shape(shape2) => shape2.len() as u32,
        Facing::Part(_) => 1,
    };
    (0..motion.shape1.len() as u32).flat_map(|i| (0..count2).map(move |j| [i, j])).collect()
}
