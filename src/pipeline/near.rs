//! Primitives that are near each other at an instant.

use arrayvec::ArrayVec;
use glam::Vec3;

use super::{Hull, Part, Shape};
use crate::{
    constants::PARTING_DIRECTIONS,
    geometry::{Aabb, Placement, Pose3, Sphere},
    query::Convex,
};

/// Calls `visit` with the primitives of two shapes whose boxes come within `reach` metres of each other, and with the first one in the
/// frame of the second shape. `pose12`: pose of the second shape in the frame of the first.
pub(super) fn near_shape(
    shape1: &Shape,
    shape2: &Shape,
    pose12: &Pose3,
    reach: f32,
    mut visit: impl FnMut([u32; 2], Hull),
) {
    let to_second = Placement::from(pose12.inverse());
    in_reach(shape1, &shape2.aabb().transformed(pose12, 1.0).inflated(reach), |primitive1| {
        let hull = shape1.hull(primitive1).placed(&to_second);
        in_reach(shape2, &hull.aabb().inflated(reach), |primitive2| visit([primitive1, primitive2], hull));
    });
}

/// The same for the primitives of a shape that are near a part, in the part's frame. `pose12`: pose of the part in the frame of the shape.
pub(super) fn near_part(shape1: &Shape, part: &Part, pose12: &Pose3, reach: f32, mut visit: impl FnMut(u32, Hull)) {
    let to_part = Placement::from(pose12.inverse());
    let target = part.aabb().inflated(reach);
    in_reach(shape1, &target.transformed(pose12, 1.0), |primitive1| {
        let hull = shape1.hull(primitive1).placed(&to_part);
        if hull.aabb().overlaps(&target) {
            visit(primitive1, hull);
        }
    });
}

/// The primitives whose boxes overlap with a box in the shape's frame.
fn in_reach(shape: &Shape, reach: &Aabb, visit: impl FnMut(u32)) {
    let unscaled = Aabb { min: reach.min / shape.scale, max: reach.max / shape.scale };
    shape.bvh().visit(|aabb| aabb.overlaps(&unscaled), visit);
}

/// Directions along which some primitives of a pair are far from each other: most others are as well.
pub(super) struct Directions {
    /// The latest that was of use comes first.
    known: ArrayVec<Vec3, PARTING_DIRECTIONS>,
}

impl Directions {
    /// `likely`: a unit vector from the first side to the second.
    pub fn new(likely: Vec3) -> Self {
        Self { known: ArrayVec::from_iter([likely]) }
    }

    /// True if two primitives are farther apart than `reach` metres along a direction that is known.
    pub fn part<const N: usize, B: Convex>(&mut self, first: &[Sphere; N], second: &B, reach: f32) -> bool {
        let found = self.known.iter().position(|&n| second.low(n) + first.low(-n) > reach);
        if let Some(i) = found {
            self.known[..=i].rotate_right(1);
        }
        found.is_some()
    }

    /// Remembers a unit vector from a first side to a second.
    pub fn learn(&mut self, direction: Vec3) {
        if self.known.is_full() {
            self.known.pop();
        }
        self.known.insert(0, direction);
    }
}
