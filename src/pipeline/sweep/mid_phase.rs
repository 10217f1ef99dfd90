//! Mid phase: finds the pairs of primitives of a body pair that may touch within the step.
//!
//! The boxes of a body's BVH are computed at the start and at the end of the step, once for several pairs. The two BVHs of a pair are traversed against each
//! other. The result is the pairs of primitives whose moving boxes meet. The boxes include the arcs of their primitives, so no pair is missed while the bodies
//! stay on their paths.
//!
//! A step that is searched for impacts in intervals is culled in each of them. Boxes are then computed only for primitives that the other body may reach.

use std::cell::Cell;

use glam::{Quat, Vec3, Vec3A};

use crate::{
    constants::CONTACT_ROUNDING,
    geometry::{Aabb, Sweep},
    pipeline::{
        Culling, Shape,
        pairs::PrimitivePair,
        sweep::{
            motion::{OtherPart, PairMotion},
            moving_boxes::{self, MovingBox, MovingBoxes, TimedBoxes},
        },
    },
};

/// Returns a given primitive pair as a candidate of a motion. `None` if it belongs to another part.
pub(in crate::pipeline) fn of_motion(motion: &PairMotion, [first, second]: [u32; 2]) -> Option<PrimitivePair> {
    match &motion.other {
        OtherPart::Shape(_) => Some([first, second]),
        part => (second == part.id(0)).then_some([first, 0]),
    }
}

/// Adds the primitive pairs that may come within `reach` metres of each other over the motion. The search ends soon after `max` pairs.
///
/// `boxes`: cached boxes of each side over its motion, if there are any. `own`: buffers for boxes that are not cached.
pub(in crate::pipeline) fn candidates(
    motion: &PairMotion,
    culling: Culling,
    reach: f32,
    max: usize,
    boxes: [Option<TimedBoxes>; 2],
    own: &mut [MovingBoxes; 2],
    found: &mut Vec<PrimitivePair>,
) {
    if culling == Culling::None {
        return found.extend(all(motion.shape1.len(), motion.other.len()));
    }
    match &motion.other {
        OtherPart::Shape(shape2) => of_shapes(motion, shape2, boxes, reach, max, own, found),
        OtherPart::Part(part) => of_part(motion, [part.aabb(); 2], boxes[0], reach, &mut own[0], found),
        OtherPart::Moving(part) => of_part(motion, part.boxes(), boxes[0], reach, &mut own[0], found),
    }
}

/// Adds the primitives of a shape whose boxes come within `reach` metres of the box of a part. `parts`: boxes of the part in its frame, at the start and at the
/// end.
fn of_part(
    motion: &PairMotion,
    parts: [Aabb; 2],
    boxes: Option<TimedBoxes>,
    reach: f32,
    own: &mut MovingBoxes,
    found: &mut Vec<PrimitivePair>,
) {
    let [start, end] = parts;
    let target = [start.transformed(&motion.sweep2.start, 1.0), end.transformed(&motion.sweep2.end, 1.0)];
    let target = MovingBox::new(target);
    let margin = reach + motion.sweep2.sagitta(motion.arms[1]);
    // Cached boxes have the world's axes. They are usable if the part has the same axes.
    let (boxes, offset) = match boxes {
        Some(boxes) if motion.frame.rotation == Quat::IDENTITY => {
            (boxes, Vec3A::from(motion.frame.translation) - boxes.origin())
        }
        _ => {
            let seen = view(motion.shape1, &motion.sweep1, &motion.sweep2, &start.merge(end), reach);
            own.place(motion.shape1, &motion.sweep1, Vec3::ZERO, &seen);
            (own.whole(), Vec3A::ZERO)
        }
    };
    let meets = |node: usize| boxes.node(node).meets(&target, offset, margin);
    motion.shape1.bvh().visit_tested(meets, |i| found.push([i, 0]));
}

/// Adds the primitive pairs of two shapes whose boxes come within `reach` metres of each other.
fn of_shapes(
    motion: &PairMotion,
    shape2: &Shape,
    boxes: [Option<TimedBoxes>; 2],
    reach: f32,
    max: usize,
    own: &mut [MovingBoxes; 2],
    found: &mut Vec<PrimitivePair>,
) {
    let shapes = [motion.shape1, shape2];
    let reach = reach + CONTACT_ROUNDING * motion.tolerances.size;
    let boxes = match boxes {
        [Some(boxes1), Some(boxes2)] => [boxes1, boxes2],
        _ => {
            let [(shape1, sweep1), (shape2, sweep2)] = [(motion.shape1, &motion.sweep1), (shape2, &motion.sweep2)];
            let [own1, own2] = own;
            own1.place(shape1, sweep1, Vec3::ZERO, &view(shape1, sweep1, sweep2, &shape2.aabb(), reach));
            own2.place(shape2, sweep2, Vec3::ZERO, &view(shape2, sweep2, sweep1, &shape1.aabb(), reach));
            [own1.whole(), own2.whole()]
        }
    };
    let left = Cell::new(max);
    let meets = |box1: &MovingBox, box2: &MovingBox, offset| left.get() > 0 && box1.meets(box2, offset, reach);
    moving_boxes::visit_pairs(shapes, boxes, meets, |i, j| {
        found.push([i, j]);
        left.set(left.get().saturating_sub(1));
    });
}

/// Returns the box in the shape's frame that contains all points of the other body within `reach` metres of the moving shape. `aabb`: bounding box of the other
/// body in its own frame.
fn view(shape: &Shape, sweep: &Sweep, other: &Sweep, aabb: &Aabb, reach: f32) -> Aabb {
    sweep.view(shape.radius_about(sweep.local_center) + reach, other, aabb).inflated(reach)
}

/// Returns every pair of `count1` and `count2` primitives.
pub(in crate::pipeline) fn all(count1: usize, count2: usize) -> impl Iterator<Item = PrimitivePair> {
    (0..count1 as u32).flat_map(move |i| (0..count2 as u32).map(move |j| [i, j]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        geometry::{Obb, Pose3},
        medial_axis::MedialAxis,
        pipeline::{Body, Side, StaticBody, Statics, StepInput, pairs::BodyPair},
        random::Random,
    };

    /// Returns the smallest sampled distance of two primitives over the motion, in metres: an upper bound of the minimum.
    fn distance(motion: &PairMotion, pair: PrimitivePair) -> f32 {
        (0..=16).map(|i| motion.distance_at(i as f32 / 16.0, pair)).fold(f32::INFINITY, f32::min)
    }

    #[test]
    fn primitives_near_each_other_on_turning_paths_are_candidates() {
        let mut random = Random(8);
        let shape = Shape { axis: MedialAxis::torus(0.3, 0.05, 24).unwrap(), scale: 1.5 };
        let (mut near, mut left_out) = (0, 0);
        for case in 0..90 {
            let turn = [0.1, 0.6, 1.5][case % 3];
            let mut sweep = |distance: f32| {
                let start =
                    Pose3::from_parts(random.in_cube() * distance, Quat::from_scaled_axis(random.in_cube() * 3.0));
                Sweep::at_rates(start, Vec3::ZERO, random.in_cube() * 0.4, random.in_cube() * turn)
            };
            let bodies = vec![Body::new(shape.clone(), sweep(0.2)), Body::new(shape.clone(), sweep(0.8))];
            let wall = Obb { pose: sweep(0.6).start, half_extents: Vec3::new(0.4, 0.02, 0.1) };
            let statics = Statics::new(vec![StaticBody::solid_box(wall)]);
            let input = StepInput { bodies, ..Default::default() };
            for (second, count) in [(Side::Body(1), shape.len()), (Side::Static(0), 1)] {
                let pair = BodyPair { first: Side::Body(0), second, stops: true };
                for motion in PairMotion::of_step(&input, &statics, &pair, |_, _| false) {
                    let (mut own, mut found) = (<[MovingBoxes; 2]>::default(), Vec::new());
                    candidates(&motion, Culling::Hybrid, 0.01, usize::MAX, [None; 2], &mut own, &mut found);
                    for pair in all(shape.len(), count) {
                        let is_near = distance(&motion, pair) <= 0.01;
                        assert!(!is_near || found.contains(&pair), "{pair:?} of case {case} is missing");
                        near += usize::from(is_near);
                        left_out += usize::from(!found.contains(&pair));
                    }
                }
            }
        }
        assert!(near > 500 && left_out > 20_000, "{near} near, {left_out} left out");
    }
}
