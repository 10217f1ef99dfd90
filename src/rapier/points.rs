//! Points against medial shapes and their primitives: the nearest point of the surface.

use std::cell::Cell;

use bevy_rapier3d::parry::{
    math::Vector,
    query::{PointProjection, PointQuery, Ray},
    shape::FeatureId,
};
use glam::Vec3;

use super::{primitive::PrimitiveShape, shape::MedialShape};
use crate::{
    constants::{NEAREST_BEYOND_ROUNDS, WAY_OUT_ACCURACY, WAY_OUT_ROUNDS},
    geometry::{Aabb, Sphere},
    pipeline::{Hull, with_spheres},
    query::{Separation, separation},
};

impl PointQuery for MedialShape {
    /// From inside and not `solid`: a point of the surface from which every near one is farther. On a shape whose primitives overlap deeply
    /// and askew another part of the surface may be nearer.
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        let (nearest, _) = self.nearest(point);
        match nearest.distance > 0.0 {
            true => PointProjection::new(false, nearest.point1),
            false if solid => PointProjection::new(true, point),
            false => PointProjection::new(true, self.way_out(point).0),
        }
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        let (nearest, primitive) = self.nearest(point);
        let inside = nearest.distance <= 0.0;
        let (surface, primitive) = if inside { self.way_out(point) } else { (nearest.point1, primitive) };
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

/// From the primitive to the point.
fn to_point(hull: &Hull, point: Vec3) -> Separation {
    with_spheres!(hull, |spheres| separation(spheres, &[Sphere::new(point, 0.0)], 0))
}

/// What lies on the outer side of a plane.
struct Outside {
    normal: Vec3,
    offset: f32,
}

impl MedialShape {
    /// Calls `visit` with the primitives whose boxes come nearer to the point than `limit` holds.
    fn visit_near(&self, point: Vec3, limit: &Cell<f32>, mut visit: impl FnMut(u32, Separation)) {
        let scale = self.shape.scale;
        let is_near = |aabb: &Aabb| aabb.distance(point / scale) * scale <= limit.get();
        self.shape.bvh().visit(is_near, |primitive| visit(primitive, to_point(&self.shape.hull(primitive), point)));
    }

    /// The primitive nearest to the point, or the one that it lies deepest in.
    fn nearest(&self, point: Vec3) -> (Separation, u32) {
        let limit = Cell::new(f32::INFINITY);
        let mut best: Option<(Separation, u32)> = None;
        self.visit_near(point, &limit, |primitive, found| {
            if best.is_none_or(|(best, _)| found.distance < best.distance) {
                limit.set(found.distance.max(0.0));
                best = Some((found, primitive));
            }
        });
        // A shape has primitives; those of a point that is not a number are not near.
        best.unwrap_or_else(|| (to_point(&self.shape.hull(0), point), 0))
    }

    /// A point of the surface near to one that lies inside, and its primitive.
    ///
    /// Beyond the plane that touches a primitive nothing is inside of it. So the nearest point that is beyond the planes of all primitives,
    /// as they touch seen from a point of the surface, is outside of all and not farther than that one. Rays give the points to start from.
    fn way_out(&self, point: Vec3) -> (Vec3, u32) {
        let mut ways: Vec<Vec3> = Vec::new();
        self.visit_near(point, &Cell::new(0.0), |_, held_by| {
            if held_by.distance <= 0.0 {
                ways.push(held_by.normal);
            }
        });
        ways.extend(ways.iter().sum::<Vec3>().try_normalize());
        ways.extend(Vec3::AXES.iter().flat_map(|&axis| [axis, -axis]));
        let exits = ways.iter().filter_map(|&way| {
            let ray = Ray::new(point, way);
            self.leave(&ray, f32::MAX).map(|hit| self.nearer_exit(point, ray.point_at(hit.time_of_impact)))
        });
        let exit = exits.min_by(|a, b| a.distance_squared(point).total_cmp(&b.distance_squared(point)));
        let exit = exit.unwrap_or(point);
        (exit, self.nearest(exit).1)
    }

    /// From a point of the surface to one from which there is no nearer to `point` beyond the same planes.
    fn nearer_exit(&self, point: Vec3, mut exit: Vec3) -> Vec3 {
        let size = self.shape.bounding_sphere().radius;
        for _ in 0..WAY_OUT_ROUNDS {
            let way = exit.distance(point);
            let mut planes = Vec::new();
            self.visit_near(point, &Cell::new(way), |primitive, _| {
                let touch = to_point(&self.shape.hull(primitive), exit);
                planes.push(Outside { normal: touch.normal, offset: touch.normal.dot(touch.point1) });
            });
            let accuracy = WAY_OUT_ACCURACY * size;
            let Some(next) = nearest_beyond(&planes, point, accuracy) else { break };
            let gained = next.distance(point) < way - accuracy;
            if !gained {
                break;
            }
            exit = next;
        }
        exit
    }
}

/// The point nearest to `point` beyond all planes, but for an accuracy in metres (Hildreth's method). None if it takes too long.
fn nearest_beyond(planes: &[Outside], point: Vec3, accuracy: f32) -> Option<Vec3> {
    let mut pushes = vec![0.0f32; planes.len()];
    let mut nearest = point;
    for _ in 0..NEAREST_BEYOND_ROUNDS {
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
