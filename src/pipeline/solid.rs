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
    /// Returns the medial mesh; `None` for any other collider.
    pub fn medial(&self) -> Option<&Shape> {
        match self {
            Solid::Medial(shape) => Some(shape),
            Solid::Parts(_) => None,
        }
    }

    /// Returns the motion of the parts within the step, if they move in the body's frame.
    pub fn deforming(&self) -> Option<&Deforming> {
        match self {
            Solid::Medial(_) => None,
            Solid::Parts(parts) => parts.deforming(),
        }
    }

    /// Returns the shape as the second side of a pair.
    pub fn second(&self) -> OtherShape<'_> {
        match self {
            Solid::Medial(shape) => OtherShape::Shape(shape),
            Solid::Parts(parts) => OtherShape::Parts(&**parts),
        }
    }

    /// Returns the number of primitives or parts.
    pub fn len(&self) -> usize {
        match self {
            Solid::Medial(shape) => shape.len(),
            Solid::Parts(parts) => parts.len(),
        }
    }

    /// Returns true if there are no primitives or parts.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the bounding box in the body's frame.
    pub fn aabb(&self) -> Aabb {
        match self {
            Solid::Medial(shape) => shape.aabb(),
            Solid::Parts(parts) => parts.aabb(),
        }
    }

    /// Returns a bounding sphere in the body's frame.
    pub fn bounding_sphere(&self) -> Sphere {
        match self {
            Solid::Medial(shape) => shape.bounding_sphere(),
            Solid::Parts(parts) => parts.bounding_sphere(),
        }
    }
}

impl fmt::Debug for Solid {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Solid::Medial(shape) => f.debug_tuple("Medial").field(shape).finish(),
            Solid::Parts(parts) => f.debug_tuple("Parts").field(&parts.aabb()).finish(),
        }
    }
}

impl From<Shape> for Solid {
    fn from(shape: Shape) -> Self {
        Solid::Medial(shape)
    }
}

/// Identity of a shape. It distinguishes shapes that exist at the same time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeId {
    address: usize,
    scale: f32,
}

impl Solid {
    /// Returns the identity of the shape.
    pub fn id(&self) -> ShapeId {
        match self {
            Solid::Medial(shape) => shape.into(),
            Solid::Parts(parts) => ShapeId::of_parts(&**parts),
        }
    }
}

impl From<&Shape> for ShapeId {
    fn from(shape: &Shape) -> Self {
        Self { address: shape.axis.address(), scale: shape.scale }
    }
}

impl ShapeId {
    /// Returns the identity of a collider that is not medial.
    pub fn of_parts(parts: &dyn ConvexParts) -> Self {
        Self { address: parts.address(), scale: 1.0 }
    }
}

/// Returns the number of primitives and parts, and the number of medial primitives among them.
pub(super) fn count<'a>(solids: impl Iterator<Item = &'a Solid>) -> [usize; 2] {
    solids.fold([0, 0], |[all, medial], solid| [all + solid.len(), medial + solid.medial().map_or(0, Shape::len)])
}
