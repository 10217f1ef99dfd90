//! Mid phase: which primitives of a pair may touch within the step.
//!
//! The boxes of a body's hierarchy are placed at the start of the step and at its end, once for several pairs, and the two hierarchies of a pair are
//! traversed against each other: what is left are primitives whose boxes meet on their way. They have room for the arcs of what is in them, so no pair is
//! lost as long as the bodies keep to their way. A way that is searched for impacts in parts is culled in the same ones.

use glam::{Vec3, Vec3A};

use super::{
    Culling, Part, Shape,
    motion::{Facing, PairMotion},
    moving_boxes::{self, MovingBox, MovingBoxes, TimedBoxes},
};
use crate::constants::CONTACT_ROUNDING;

/// Indices of a primitive of the first body and one of the second; of a part, which is one, 0.
pub(super) type PrimitivePair = [u32; 2];

/// Primitives of a pair that may meet, in ascending order.
pub(super) type Candidates = Vec<PrimitivePair>;

/// Boxes that are placed for one look.
#[derive(Debug, Default)]
pub(super) struct OwnBoxes {
    sides: [MovingBoxes; 2],
    spheres: Vec<MovingBox>,
}

/// Those of given candidates of a pair that a motion is about.
pub(super) fn of_motion(motion: &PairMotion, primitives: &[PrimitivePair], found: &mut Candidates) {
    match &motion.facing {
        Facing::Shape(_) => found.extend(primitives),
        Facing::Part(part) => {
            found.extend(primitives.iter().filter(|[_, j]| *j == part.id).map(|&[i, _]| [i, 0]));
        }
    }
}

/// Adds the primitives that come within `reach` metres of each other on their way. `boxes`: of either side over its time, if they are known; what a body has
/// left its way by is part of `reach` then. `own`: room for others.
pub(super) fn candidates(
    motion: &PairMotion,
    culling: Culling,
    reach: f32,
    boxes: [Option<TimedBoxes>; 2],
    own: &mut OwnBoxes,
    found: &mut Candidates,
) {
    if culling == Culling::None {
        let count2 = if let Facing::Shape(shape2) = &motion.facing { shape2.len() } else { 1 };
        return found.extend(all(motion.shape1.len(), count2));
    }
    match &motion.facing {
        Facing::Shape(shape2) => of_shapes(motion, shape2, boxes, reach, own, found),
        Facing::Part(part) => of_part(motion, part, boxes[0], reach, own, found),
    }
    found.sort_unstable_by_key(|&[i, j]| u64::from(i) << u32::BITS | u64::from(j));
}

/// The primitives of a shape whose boxes, widened by `reach`, meet that of a part.
fn of_part(
    motion: &PairMotion,
    part: &Part,
    boxes: Option<TimedBoxes>,
    reach: f32,
    own: &mut OwnBoxes,
    found: &mut Candidates,
) {
    let [start, end] = [motion.sweep2.start, motion.sweep2.end];
    let target = MovingBox::new([start, end].map(|pose| part.aabb().transformed(&pose, 1.0)));
    let margin = reach + motion.sagitta_of_second();
    // Boxes with the world's axes do if those are the part's as well.
    let (boxes, offset) = match (boxes, motion.world_offset()) {
        (Some(boxes), Some(frame)) => (boxes, Vec3A::from(frame) - boxes.origin()),
        _ => {
            let around = MovingBox::around(motion.shape1, &motion.sweep1);
            if !around.meets(&target, Vec3A::ZERO, margin) {
                return;
            }
            let OwnBoxes { sides: [first, _], spheres } = own;
            first.place(motion.shape1, &motion.sweep1, Vec3::ZERO, spheres);
            (first.whole(), Vec3A::ZERO)
        }
    };
    let meets = |node: usize| boxes.node(node).meets(&target, offset, margin);
    motion.shape1.bvh().visit_tested(meets, |i| found.push([i, 0]));
}

/// The primitives of two shapes whose boxes, widened by `reach`, meet.
fn of_shapes(
    motion: &PairMotion,
    shape2: &Shape,
    boxes: [Option<TimedBoxes>; 2],
    reach: f32,
    own: &mut OwnBoxes,
    found: &mut Candidates,
) {
    let shapes = [motion.shape1, shape2];
    let reach = reach + CONTACT_ROUNDING * motion.size;
    let boxes = match boxes {
        [Some(boxes1), Some(boxes2)] => [boxes1, boxes2],
        _ => {
            let sides = [(motion.shape1, &motion.sweep1), (shape2, &motion.sweep2)];
            let [around1, around2] = sides.map(|(shape, sweep)| MovingBox::around(shape, sweep));
            if !around1.meets(&around2, Vec3A::ZERO, reach) {
                return;
            }
            for ((shape, sweep), boxes) in sides.into_iter().zip(&mut own.sides) {
                boxes.place(shape, sweep, Vec3::ZERO, &mut own.spheres);
            }
            own.sides.each_ref().map(MovingBoxes::whole)
        }
    };
    let meets = |box1: &MovingBox, box2: &MovingBox, offset| box1.meets(box2, offset, reach);
    moving_boxes::visit_pairs(shapes, boxes, meets, |i, j| found.push([i, j]));
}

/// Every pair of so many primitives with so many.
pub(super) fn all(count1: usize, count2: usize) -> impl Iterator<Item = PrimitivePair> {
    (0..count1 as u32).flat_map(move |i| (0..count2 as u32).map(move |j| [i, j]))
}
