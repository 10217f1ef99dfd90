//! Colliders that are not medial, as the convex parts that are in reach.

use glam::Vec3;
use smallvec::{SmallVec, smallvec};

use super::Hull;
use crate::{
    geometry::{Aabb, Pose3, Sphere, part_within},
    query::{Cuboid, Separation, Support, SupportShape, separation},
};

/// A collider that is made of convex parts: one box, the triangles of a terrain.
pub trait ConvexParts: Send + Sync {
    /// Box around it, in its own frame.
    fn aabb(&self) -> Aabb;

    /// Sphere around it, in its own frame.
    fn bounding_sphere(&self) -> Sphere;

    /// Number of parts.
    fn len(&self) -> usize;

    /// True if it has none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The parts that come within `reach`, a box in its own frame, in ascending order of their numbers.
    fn within(&self, reach: &Aabb) -> Parts<'_>;

    /// A number that nothing of another shape has as long as this one is kept: what was found for it goes on to hold.
    fn address(&self) -> usize {
        std::ptr::from_ref(self).addr()
    }
}

/// A convex part of a collider.
pub struct Part<'a> {
    /// Which: its number.
    pub id: u32,
    /// Pose of its frame in the collider's.
    pub pose: Pose3,
    /// The part without its rounding, in its frame.
    pub core: Core<'a>,
    /// How far its surface is outside of that, in metres.
    pub rounding: f32,
}

/// Parts of a collider in ascending order of their numbers: most are one by themselves.
pub type Parts<'a> = SmallVec<[Part<'a>; 1]>;

/// A convex shape.
pub enum Core<'a> {
    /// A box `[-half, half]`.
    Cuboid(Vec3),
    /// A primitive: a ball, a capsule, a triangle.
    Hull(Hull),
    /// Any other.
    Support(Box<dyn SupportShape + 'a>),
}

impl Part<'_> {
    /// Box around it, in its frame.
    pub fn aabb(&self) -> Aabb {
        let core = match &self.core {
            Core::Cuboid(half) => Aabb { min: -half, max: *half },
            Core::Hull(hull) => hull.aabb(),
            Core::Support(shape) => shape.aabb(),
        };
        core.inflated(self.rounding)
    }

    /// The largest radius of a primitive, or half of the least width of any other part, in metres.
    pub fn thickness(&self) -> f32 {
        let core = match &self.core {
            Core::Hull(hull) => hull.max_radius(),
            Core::Cuboid(half) => half.min_element(),
            Core::Support(shape) => shape.aabb().half_extents().min_element(),
        };
        core + self.rounding
    }

    /// How the point `point + offset` and the part lie to each other, all in the collider's frame.
    pub(super) fn separation_from(&self, point: Vec3, offset: Vec3) -> Separation {
        let turn = self.pose.rotation.inverse();
        let (local, offset) = (self.pose.inverse_transform_point(point), turn * offset);
        let sphere = |center: Vec3| [Sphere::new(center, self.rounding)];
        let found = match &self.core {
            Core::Cuboid(half) => separation(&sphere(local + offset), &Cuboid { half: *half }, 0),
            Core::Hull(hull) => hull.separation_from(local, sphere(offset)),
            Core::Support(shape) => separation(&sphere(local + offset), &Support(&**shape), 0),
        };
        Separation { normal: self.pose.rotation * found.normal, ..found }
    }
}

impl<'a> Part<'a> {
    /// What is within reach of a box `[-half, half]` that has the pose `pose` in the collider's frame.
    pub fn of_cuboid(id: u32, pose: Pose3, half: Vec3, rounding: f32, reach: &Aabb) -> Self {
        let (center, half) = part_within(half, &reach.transformed(&pose.inverse(), 1.0));
        Self { id, pose: pose * Pose3::from_translation(center), core: Core::Cuboid(half), rounding }
    }
}

/// One box.
impl ConvexParts for Cuboid {
    fn aabb(&self) -> Aabb {
        Aabb { min: -self.half, max: self.half }
    }

    fn bounding_sphere(&self) -> Sphere {
        Sphere::new(Vec3::ZERO, self.half.length())
    }

    fn len(&self) -> usize {
        1
    }

    fn within(&self, reach: &Aabb) -> Parts<'_> {
        smallvec![Part::of_cuboid(0, Pose3::IDENTITY, self.half, 0.0, reach)]
    }
}
