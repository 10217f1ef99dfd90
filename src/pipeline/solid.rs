//! Shapes of bodies.

use std::{fmt, sync::Arc};

use super::{ConvexParts, Deforming, Shape};
use crate::geometry::{Aabb, Sphere};

/// The shape of a body.
#[derive(Clone)]
pub enum Solid {
    /// A medial mesh.
    Medial(Shape),
    /// Any other collider.
    Parts(Arc<dyn ConvexParts>),
    /// A medial mesh whose spheres move in the body's frame.
    Deforming(Arc<Deforming>),
}

/// The second side of a pair.
#[derive(Clone, Copy)]
pub enum OtherShape<'a> {
    /// A medial shape.
    Shape(&'a Shape),
    /// Any other collider.
    Parts(&'a dyn ConvexParts),
}

impl Solid {
    /// Returns the medial mesh of a rigid body; `None` for any other collider.
    pub fn medial(&self) -> Option<&Shape> {
        match self.second() {
            OtherShape::Shape(shape) => Some(shape),
            OtherShape::Parts(_) => None,
        }
    }

    /// Returns the motion of the spheres within the step, if they move in the body's frame.
    pub fn deforming(&self) -> Option<&Deforming> {
        match self {
            Solid::Deforming(shape) => Some(shape),
            Solid::Medial(_) | Solid::Parts(_) => None,
        }
    }

    /// Returns the shape as the second side of a pair. A deforming shape is that at the end of the step.
    pub fn second(&self) -> OtherShape<'_> {
        match self {
            Solid::Medial(shape) => OtherShape::Shape(shape),
            Solid::Parts(parts) => OtherShape::Parts(&**parts),
            Solid::Deforming(shape) => OtherShape::Parts(&**shape),
        }
    }

    /// Returns the number of primitives or parts.
    pub fn len(&self) -> usize {
        match self.second() {
            OtherShape::Shape(shape) => shape.len(),
            OtherShape::Parts(parts) => parts.len(),
        }
    }

    /// Returns true if there are no primitives or parts.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the bounding box in the body's frame. A deforming shape has that of its motion.
    pub fn aabb(&self) -> Aabb {
        match self.second() {
            OtherShape::Shape(shape) => shape.aabb(),
            OtherShape::Parts(parts) => parts.aabb(),
        }
    }

    /// Returns a bounding sphere in the body's frame.
    pub fn bounding_sphere(&self) -> Sphere {
        match self.second() {
            OtherShape::Shape(shape) => shape.bounding_sphere(),
            OtherShape::Parts(parts) => parts.bounding_sphere(),
        }
    }

    /// Returns the identity of the shape.
    pub fn id(&self) -> ShapeId {
        match self.second() {
            OtherShape::Shape(shape) => shape.into(),
            OtherShape::Parts(parts) => ShapeId::of_parts(parts),
        }
    }
}

impl fmt::Debug for Solid {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Solid::Medial(shape) => f.debug_tuple("Medial").field(shape).finish(),
            Solid::Parts(parts) => f.debug_tuple("Parts").field(&parts.aabb()).finish(),
            Solid::Deforming(shape) => f.debug_tuple("Deforming").field(&shape.aabb()).finish(),
        }
    }
}

impl From<Shape> for Solid {
    fn from(shape: Shape) -> Self {
        Solid::Medial(shape)
    }
}

/// Identity of a shape. It distinguishes shapes that exist at the same time. Shapes with the same identity have the same number of primitives, even if one
/// has replaced the other in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeId {
    address: usize,
    scale: f32,
    len: u32,
}

impl From<&Shape> for ShapeId {
    fn from(shape: &Shape) -> Self {
        Self { address: shape.axis.address(), scale: shape.scale, len: shape.len() as u32 }
    }
}

impl ShapeId {
    /// Returns the identity of a collider that is not medial.
    pub fn of_parts(parts: &dyn ConvexParts) -> Self {
        Self { address: parts.address(), scale: 1.0, len: parts.len() as u32 }
    }
}

/// Returns the number of primitives and parts, and the number of medial primitives among them.
pub(super) fn count<'a>(solids: impl Iterator<Item = &'a Solid>) -> [usize; 2] {
    solids.fold([0, 0], |[all, medial], solid| [all + solid.len(), medial + solid.medial().map_or(0, Shape::len)])
}

/// Returns the bounding radius of the smaller body, in metres.
pub(super) fn smaller_radius(solids: [&Solid; 2]) -> f32 {
    let [radius1, radius2] = solids.map(|solid| solid.bounding_sphere().radius);
    radius1.min(radius2)
}
