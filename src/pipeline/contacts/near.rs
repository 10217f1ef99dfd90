//! Primitives that are near each other at one instant.

use crate::{
    geometry::{Aabb, Box3A, Placement, Pose3},
    pipeline::{ConvexParts, Hull, Part, Parts, Shape},
};

/// Buffers for the primitives that are near.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    in_reach: Vec<u32>,
    first: Vec<(u32, Hull, Box3A)>,
    second: Vec<(u32, Box3A)>,
}

/// Calls `visit` in ascending order for each pair of primitives of two shapes whose boxes are within `reach` metres of each other. The second argument of
/// `visit` is the first primitive in the frame of the second shape. `pose12`: pose of the second shape in the frame of the first.
///
/// Only few primitives of a shape are near the other shape, so these are compared pair by pair.
pub(in crate::pipeline) fn near_shape(
    shape1: &Shape,
    shape2: &Shape,
    pose12: &Pose3,
    reach: f32,
    Scratch { in_reach, first, second }: &mut Scratch,
    mut visit: impl FnMut([u32; 2], Hull),
) {
    let to_second = Placement::from(pose12.inverse());
    first.clear();
    let mut around1 = Aabb::EMPTY;
    let target = shape2.aabb().inflated(reach);
    find_in_reach(shape1, &target.transformed(pose12, 1.0), in_reach);
    for &primitive in in_reach.iter() {
        let hull = shape1.hull(primitive).placed(&to_second);
        let aabb = hull.aabb();
        if aabb.overlaps(&target) {
            first.push((primitive, hull, Box3A::from(aabb.inflated(reach))));
            around1 = around1.merge(aabb);
        }
    }
    if first.is_empty() {
        return;
    }
    find_in_reach(shape2, &around1.inflated(reach), in_reach);
    second.clear();
    second.extend(in_reach.iter().map(|&primitive| (primitive, Box3A::from(shape2.hull(primitive).aabb()))));
    for (primitive1, hull, box1) in first.iter() {
        for (primitive2, box2) in second.iter() {
            if box1.overlaps(box2) {
                visit([*primitive1, *primitive2], *hull);
            }
        }
    }
}

/// [`near_shape`] for the primitives of a shape that are near a part. Primitives are visited in the part's frame. `pose12`: pose of the part in the frame of
/// the shape.
pub(in crate::pipeline) fn near_part(
    shape1: &Shape,
    part: &Part,
    pose12: &Pose3,
    reach: f32,
    Scratch { in_reach, .. }: &mut Scratch,
    mut visit: impl FnMut(u32, Hull),
) {
    let to_part = Placement::from(pose12.inverse());
    let target = part.aabb().inflated(reach);
    find_in_reach(shape1, &target.transformed(pose12, 1.0), in_reach);
    for &primitive1 in in_reach.iter() {
        let hull = shape1.hull(primitive1).placed(&to_part);
        if hull.aabb().overlaps(&target) {
            visit(primitive1, hull);
        }
    }
}

/// Returns the parts of another collider whose boxes are within `reach` metres of the shape's box. `pose12`: pose of the collider in the frame of the shape.
pub(in crate::pipeline) fn near_parts<'p>(
    shape1: &Shape,
    parts: &'p dyn ConvexParts,
    pose12: &Pose3,
    reach: f32,
) -> Parts<'p> {
    parts.within(&shape1.aabb().transformed(&pose12.inverse(), 1.0).inflated(reach))
}

/// Finds the primitives whose boxes overlap with a box in the shape's frame, in ascending order.
fn find_in_reach(shape: &Shape, reach: &Aabb, found: &mut Vec<u32>) {
    let unscaled = Aabb { min: reach.min / shape.scale, max: reach.max / shape.scale };
    found.clear();
    shape.bvh().overlapping(&unscaled, |primitive| found.push(primitive));
    found.sort_unstable();
}
