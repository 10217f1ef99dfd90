//! Primitives that are near each other at one instant.

use crate::{
    constants::CONTACT_ROUNDING,
    geometry::{Aabb, Box3A, Placement, Pose3},
    pipeline::{
        ConvexParts, Hull, Part, Parts, Shape,
        contacts::near_list::{NearList, NearPair},
    },
};

/// Buffers for the primitives that are near.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    in_reach: Vec<u32>,
    first: Vec<(u32, Box3A)>,
    second: Vec<(u32, Box3A)>,
}

/// Appends the pairs of primitives of two shapes whose boxes are within `reach` metres of each other to a list, in ascending order. `pose12`: pose of the
/// second shape in the frame of the first.
///
/// Only few primitives of a shape are near the other shape, so these are compared pair by pair.
pub(in crate::pipeline) fn near_shape(
    shape1: &Shape,
    shape2: &Shape,
    pose12: &Pose3,
    reach: f32,
    Scratch { in_reach, first, second }: &mut Scratch,
    pairs: &mut Vec<NearPair>,
) -> NearList {
    let [size1, size2] = [shape1, shape2].map(|shape| shape.bounding_sphere().radius);
    let rounding = CONTACT_ROUNDING * (size1 + size2);
    // With this allowance, the list covers the given reach.
    let reach = reach + 2.0 * rounding;
    let list = NearList::new(reach, rounding);
    let to_second = Placement::from(pose12.inverse());
    first.clear();
    let mut around1 = Aabb::EMPTY;
    let target = shape2.aabb().inflated(reach);
    find_in_reach(shape1, &target.transformed(pose12, 1.0), in_reach);
    for &primitive in in_reach.iter() {
        let aabb = shape1.hull(primitive).placed(&to_second).aabb();
        if aabb.overlaps(&target) {
            first.push((primitive, Box3A::from(aabb)));
            around1 = around1.merge(aabb);
        }
    }
    if first.is_empty() {
        return list;
    }
    find_in_reach(shape2, &around1.inflated(reach), in_reach);
    second.clear();
    second.extend(in_reach.iter().map(|&primitive| (primitive, Box3A::from(shape2.hull(primitive).aabb()))));
    for (primitive1, box1) in first.iter() {
        for (primitive2, box2) in second.iter() {
            let distance = box1.distance_to(box2);
            if distance <= reach {
                pairs.push(NearPair { primitives: [*primitive1, *primitive2], apart_until: distance });
            }
        }
    }
    list
}

/// Calls `visit` in ascending order for each primitive of a shape whose box is within `reach` metres of the box of a part, with the primitive in the part's
/// frame. `pose12`: pose of the part in the frame of the shape.
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
