//! Any other convex shape, given by its support map, because it has no closed form here.

use glam::Vec3;

use super::separation::{Convex, edge_directions, separation};
use crate::geometry::{Aabb, Sphere};

/// A convex shape that provides its support points, and its distance from a primitive by an iterative method.
pub trait SupportShape {
    /// The point farthest along `direction`, which need not be of unit length.
    fn support(&self, direction: Vec3) -> Vec3;

    /// Nearest points of the hull of `spheres` and of the shape, and the unit direction from the first to the second. For an overlap it is the
    /// direction of minimum depth. `None` if the method fails.
    fn nearest(&self, spheres: &[Sphere]) -> Option<(Vec3, Vec3, Vec3)>;

    /// Calls `visit` with the corners of the face, edge or vertex that is farthest along `direction`. For a curved side it gets points around
    /// `near`.
    fn face(&self, direction: Vec3, near: Vec3, visit: &mut dyn FnMut(Vec3));

    /// Axis-aligned box around the shape.
    fn aabb(&self) -> Aabb;
}

/// A [`SupportShape`] as the second side of a pair. Distances never exceed the true ones, however inaccurate the shape's method is.
#[derive(Clone, Copy)]
pub struct Support<'a>(pub &'a dyn SupportShape);

impl Support<'_> {
    /// Unit normal of the face that is farthest along `direction`. For an edge, the normal of the edge that is closest to `direction`.
    fn face_normal(&self, direction: Vec3, near: Vec3) -> Option<Vec3> {
        let (mut corners, mut count) = ([Vec3::ZERO; 3], 0);
        self.0.face(direction, near, &mut |corner| {
            if let Some(place) = corners.get_mut(count) {
                *place = corner;
                count += 1;
            }
        });
        let [a, b, c] = corners;
        let normal = match count {
            3 => (b - a).cross(c - a).try_normalize()?,
            2 => direction.reject_from((b - a).try_normalize()?).try_normalize()?,
            _ => return None,
        };
        Some(if normal.dot(direction) < 0.0 { -normal } else { normal })
    }
}

impl Convex for Support<'_> {
    fn low(&self, n: Vec3) -> f32 {
        self.0.support(-n).dot(n)
    }

    fn extent(&self) -> f32 {
        self.0.aabb().half_extents().length()
    }

    fn origin(&self) -> Vec3 {
        self.0.aabb().center()
    }

    fn features<const N: usize>(&self) -> usize {
        1
    }

    fn feature<const N: usize>(&self, first: &[Sphere; N], _: usize) -> (Sphere, Sphere) {
        let (point1, point2, _) = self.0.nearest(first).unwrap_or((first[0].center, self.origin(), Vec3::Y));
        (Sphere::new(point1, 0.0), Sphere::new(point2, 0.0))
    }

    fn normals<const N: usize>(&self, first: &[Sphere; N], apart: Vec3, visit: &mut impl FnMut(Vec3)) {
        if let Some((_, near, normal)) = self.0.nearest(first) {
            visit(normal);
            // At a round edge, the final point of an iteration yields a more accurate direction than its normal.
            visit(separation(first, &[Sphere::new(near, 0.0)], 0).normal);
            // Over a flat or straight feature that direction is tilted, and the error of the distance grows with the size of the feature.
            if let Some(outward) = self.face_normal(-normal, near) {
                visit(-outward);
            }
        }
        if let Some(direction) = (self.origin() - first.origin()).try_normalize() {
            visit(direction);
        }
        edge_directions(first, apart, visit);
    }
}
