//! Colliders that are not medial: sets of convex parts.

use glam::Vec3;
use smallvec::{SmallVec, smallvec};

use super::Hull;
use crate::{
    geometry::{Aabb, Pose3, Sphere, part_within},
    query::{Cuboid, Separation, Support, SupportShape, separation},
};

/// A collider that consists of convex parts, such as one box or the triangles of a terrain.
pub trait ConvexParts: Send + Sync {
    /// Returns the bounding box in the collider's frame.
    fn aabb(&self) -> Aabb;

    /// Returns a bounding sphere in the collider's frame.
    fn bounding_sphere(&self) -> Sphere;

    /// Returns the number of parts.
    fn len(&self) -> usize;

    /// Returns true if there are no parts.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the parts that overlap with `reach`, a box in the collider's frame, in ascending order of their ids.
    fn within(&self, reach: &Aabb) -> Parts<'_>;

    /// Returns an id that no other shape has while this one exists. Results can be cached under this id.
    fn address(&self) -> usize {
        std::ptr::from_ref(self).addr()
    }
}

/// A convex part of a collider.
pub struct Part<'a> {
    /// Index of the part in the collider.
    pub id: u32,
    /// Pose of the part's frame in the collider's frame.
    pub pose: Pose3,
    /// The part without its rounding, in the part's frame.
    pub core: Core<'a>,
    /// Distance of the surface from the core, in metres.
    pub rounding: f32,
}

/// Parts of a collider in ascending order of their ids. Most colliders have one part.
pub type Parts<'a> = SmallVec<[Part<'a>; 1]>;

/// The convex shape of a part without its rounding.
pub enum Core<'a> {
    /// A box `[-half, half]`.
    Cuboid(Vec3),
    /// A primitive: a ball, a capsule or a triangle.
    Hull(Hull),
    /// Any other shape with a support function.
    Support(Box<dyn SupportShape + 'a>),
}

impl Part<'_> {
    /// Returns the bounding box in the part's frame.
    pub fn aabb(&self) -> Aabb {
        let core = match &self.core {
            Core::Cuboid(half) => Aabb { min: -half, max: *half },
            Core::Hull(hull) => hull.aabb(),
            Core::Support(shape) => shape.aabb(),
        };
        core.inflated(self.rounding)
    }

    /// Returns the thickness in metres: the largest radius of a primitive, or half of the smallest width of any other part.
    pub fn thickness(&self) -> f32 {
        let core = match &self.core {
            Core::Hull(hull) => hull.max_radius(),
            Core::Cuboid(half) => half.min_element(),
            Core::Support(shape) => shape.aabb().half_extents().min_element(),
        };
        core + self.rounding
    }

    /// Returns the separation of the point `point + offset` and the part, in the collider's frame. The distance and the normal are valid, but not the points.
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
    /// Creates the part of a box `[-half, half]` that overlaps with `reach`. `pose`: pose of the box in the collider's frame.
    pub fn of_cuboid(id: u32, pose: Pose3, half: Vec3, rounding: f32, reach: &Aabb) -> Self {
        let (center, half) = part_within(half, &reach.transformed(&pose.inverse(), 1.0));
        Self { id, pose: pose * Pose3::from_translation(center), core: Core::Cuboid(half), rounding }
    }
}

/// A collider with a single box as its part.
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
