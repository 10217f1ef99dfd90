//! Point queries on medial shapes and their primitives: the nearest point of the surface.

use std::cell::Cell;

use bevy_rapier3d::parry::{
    math::Vector,
    query::{PointProjection, PointQuery, Ray},
    shape::FeatureId,
};
use glam::Vec3;

use super::{primitive::PrimitiveShape, shape::MedialShape};
use crate::{
    constants::{CONTACT_ROUNDING, MAX_ITERATIONS},
    geometry::{Aabb, Sphere},
    pipeline::{Hull, with_spheres},
    query::{Separation, separation},
};

impl PointQuery for MedialShape {
    /// For a point inside, without `solid`, the result is a local minimum of the distance to the surface. On a shape whose primitives overlap deeply at oblique
    /// angles, another part of the surface may be nearer.
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        let (nearest, _) = self.nearest(point);
        match nearest.distance > 0.0 {
            true => PointProjection::new(false, nearest.point1),
            false if solid => PointProjection::new(true, point),
            false => PointProjection::new(true, self.project_from_inside(point).0),
        }
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        let (nearest, primitive) = self.nearest(point);
        let inside = nearest.distance <= 0.0;
        let (surface, primitive) = if inside { self.project_from_inside(point) } else { (nearest.point1, primitive) };
        (PointProjection::new(inside, surface), FeatureId::Face(primitive))
    }
}

impl PointQuery for PrimitiveShape {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        let nearest = to_point(&self.hull, point);
        let inside = nearest.distance <= 0.0;
        PointProjection::new(inside, if inside && solid { point } else { nearest.point1 })
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        (self.project_local_point(point, false), FeatureId::Face(0))
    }
}

/// Returns the separation from the primitive to the point.
fn to_point(hull: &Hull, point: Vec3) -> Separation {
    with_spheres!(hull, |spheres| separation(spheres, &[Sphere::new(point, 0.0)], 0))
}

/// The half-space on the outer side of a plane: all `x` with `normal . x >= offset`.
struct Outside {
    normal: Vec3,
    offset: f32,
}

impl MedialShape {
    /// Calls `visit` for each primitive whose box is within `limit` metres of the point. `visit` may lower the limit.
    fn visit_near(&self, point: Vec3, limit: &Cell<f32>, mut visit: impl FnMut(u32, Separation)) {
        let scale = self.shape.scale;
        let is_near = |aabb: &Aabb| aabb.distance(point / scale) * scale <= limit.get();
        self.shape.bvh().visit(is_near, |primitive| visit(primitive, to_point(&self.shape.hull(primitive), point)));
    }

    /// Finds the primitive nearest to the point, or the one that contains the point most deeply.
    fn nearest(&self, point: Vec3) -> (Separation, u32) {
        let limit = Cell::new(f32::INFINITY);
        let mut best: Option<(Separation, u32)> = None;
        self.visit_near(point, &limit, |primitive, found| {
            if best.is_none_or(|(best, _)| found.distance < best.distance) {
                limit.set(found.distance.max(0.0));
                best = Some((found, primitive));
            }
        });
        // Every shape has primitives, but none is near a point with NaN coordinates.
        best.unwrap_or_else(|| (to_point(&self.shape.hull(0), point), 0))
    }

    /// Finds a point of the surface near to a point inside, and its primitive.
    ///
    /// No point beyond a tangent plane of a primitive is inside the primitive. Take the tangent planes of all primitives at their points nearest to a point of
    /// the surface. The nearest point beyond all these planes is outside of all primitives, and it is not farther away than the point of the surface. Rays give
    /// the points of the surface to start from.
    fn project_from_inside(&self, point: Vec3) -> (Vec3, u32) {
        let mut directions: Vec<Vec3> = Vec::new();
        self.visit_near(point, &Cell::new(0.0), |_, held_by| {
            if held_by.distance <= 0.0 {
                directions.push(held_by.normal);
            }
        });
        directions.extend(directions.iter().sum::<Vec3>().try_normalize());
        directions.extend(Vec3::AXES.iter().flat_map(|&axis| [axis, -axis]));
        let exits = directions.iter().filter_map(|&direction| {
            let ray = Ray::new(point, direction);
            self.leave(&ray, f32::MAX).map(|hit| self.nearer_exit(point, ray.point_at(hit.time_of_impact)))
        });
        let exit = exits.min_by(|a, b| a.distance_squared(point).total_cmp(&b.distance_squared(point)));
        let exit = exit.unwrap_or(point);
        (exit, self.nearest(exit).1)
    }

    /// Moves a point of the surface towards `point`, along tangent planes, until an iteration gains no more.
    fn nearer_exit(&self, point: Vec3, mut exit: Vec3) -> Vec3 {
        let size = self.shape.bounding_sphere().radius;
        for _ in 0..MAX_ITERATIONS {
            let distance = exit.distance(point);
            let mut planes = Vec::new();
            self.visit_near(point, &Cell::new(distance), |primitive, _| {
                let touch = to_point(&self.shape.hull(primitive), exit);
                planes.push(Outside { normal: touch.normal, offset: touch.normal.dot(touch.point1) });
            });
            let accuracy = CONTACT_ROUNDING * size;
            let Some(next) = nearest_beyond(&planes, point, accuracy) else { break };
            let gained = next.distance(point) < distance - accuracy;
            if !gained {
                break;
            }
            exit = next;
        }
        exit
    }
}

/// Finds the point nearest to `point` beyond all planes with Hildreth's method. `accuracy` is in metres. Returns `None` if the method does not converge within
/// [`MAX_ITERATIONS`] iterations.
fn nearest_beyond(planes: &[Outside], point: Vec3, accuracy: f32) -> Option<Vec3> {
    let mut pushes = vec![0.0f32; planes.len()];
    let mut nearest = point;
    for _ in 0..MAX_ITERATIONS {
        let mut moved = 0.0f32;
        for (plane, push) in planes.iter().zip(&mut pushes) {
            let change = (plane.offset - plane.normal.dot(nearest)).max(-*push);
            *push += change;
            nearest += plane.normal * change;
            moved = moved.max(change.abs());
        }
        if moved <= accuracy {
            return Some(nearest);
        }
    }
    None
}
