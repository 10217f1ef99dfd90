//! Rapier's colliders in the terms of the pipeline: one convex part, or those of many that are near.

use bevy_rapier3d::parry::{
    bounding_volume::Aabb as ParryAabb,
    math::{Pose, Vector},
    query::details::contact_support_map_support_map,
    shape::{Shape as ParryShape, SupportMap, TypedShape},
};
use glam::{Quat, Vec3};

use super::shape::MedialShape;
use crate::{
    geometry::{Aabb, Pose3, Sphere},
    pipeline::{Hull, Second},
    query::SupportShape,
};

/// Calls `visit` with the parts of a collider's shape that come within `reach`, a box in the collider's frame: an id, the pose of the
/// part's frame in the collider's, and the part. False for a shape that nothing is known about.
pub(super) fn visit_parts(shape: &dyn ParryShape, reach: &Aabb, visit: &mut dyn FnMut(u32, &Pose3, Second)) -> bool {
    let parry_reach = ParryAabb::new(reach.min, reach.max);
    if let Some(composite) = shape.as_composite_shape() {
        let mut known = true;
        for part in composite.bvh().intersect_aabb(&parry_reach) {
            composite.map_part_at(part, &mut |pose, shape, _| {
                known &= visit_convex(shape, reach, &mut |local, second| {
                    visit(part, &pose.map_or(*local, |pose| pose * *local), second);
                });
            });
        }
        return known;
    }
    // The medial shape first: rapier knows its own shapes only.
    if shape.as_shape::<MedialShape>().is_none() {
        match shape.as_typed_shape() {
            TypedShape::HeightField(field) => {
                field.map_elements_in_local_aabb(&parry_reach, &mut |part, triangle| {
                    visit(part, &Pose3::IDENTITY, Second::Hull(slab([triangle.a, triangle.b, triangle.c], 0.0)));
                });
                return true;
            }
            TypedShape::Voxels(voxels) => {
                let half = voxels.voxel_size() * 0.5;
                for voxel in voxels.voxels_intersecting_local_aabb(&parry_reach).filter(|voxel| !voxel.state.is_empty())
                {
                    let pose = Pose3::from_translation(voxel.center);
                    visit(voxel.linear_id.flat_id() as u32, &pose, Second::Cuboid(half));
                }
                return true;
            }
            _ => {}
        }
    }
    visit_convex(shape, reach, &mut |local, second| visit(0, local, second))
}

/// The same for a shape of one part.
fn visit_convex(shape: &dyn ParryShape, reach: &Aabb, visit: &mut dyn FnMut(&Pose3, Second)) -> bool {
    let here = Pose3::IDENTITY;
    if let Some(medial) = shape.as_shape::<MedialShape>() {
        visit(&here, Second::Shape(&medial.shape));
        return true;
    }
    match shape.as_typed_shape() {
        TypedShape::Cuboid(cuboid) => visit(&here, Second::Cuboid(cuboid.half_extents)),
        TypedShape::Ball(ball) => visit(&here, Second::Hull(Hull::Sphere([Sphere::new(Vec3::ZERO, ball.radius)]))),
        TypedShape::Capsule(capsule) => {
            visit(&here, Second::Hull(cone([capsule.segment.a, capsule.segment.b], capsule.radius)))
        }
        TypedShape::Segment(segment) => visit(&here, Second::Hull(cone([segment.a, segment.b], 0.0))),
        TypedShape::Triangle(triangle) => visit(&here, Second::Hull(slab([triangle.a, triangle.b, triangle.c], 0.0))),
        TypedShape::RoundTriangle(round) => {
            let triangle = round.inner_shape;
            visit(&here, Second::Hull(slab([triangle.a, triangle.b, triangle.c], round.border_radius)));
        }
        TypedShape::HalfSpace(half_space) => {
            // A box below the plane, larger than what can reach it and centred under that.
            let center = reach.center();
            let height = half_space.normal.dot(center);
            let half = 4.0 * reach.half_extents().length() + height.abs();
            let turn = Quat::from_rotation_arc(Vec3::Y, half_space.normal);
            let pose = Pose3::from_parts(center - half_space.normal * (height + half), turn);
            visit(&pose, Second::Cuboid(Vec3::splat(half)));
        }
        _ => match shape.as_support_map() {
            Some(map) => visit(&here, Second::Support(&Mapped { shape, map })),
            None => return false,
        },
    }
    true
}

fn cone(ends: [Vec3; 2], radius: f32) -> Hull {
    Hull::Cone(ends.map(|center| Sphere::new(center, radius)))
}

fn slab(corners: [Vec3; 3], radius: f32) -> Hull {
    Hull::Slab(corners.map(|center| Sphere::new(center, radius)))
}

/// A convex shape of parry's.
struct Mapped<'a> {
    shape: &'a dyn ParryShape,
    map: &'a dyn SupportMap,
}

impl SupportShape for Mapped<'_> {
    fn support(&self, direction: Vec3) -> Vec3 {
        self.map.local_support_point(direction)
    }

    fn nearest(&self, spheres: &[Sphere]) -> Option<(Vec3, Vec3, Vec3)> {
        let contact = contact_support_map_support_map(&Pose::IDENTITY, &SphereHull(spheres), self.map, f32::MAX)?;
        Some((contact.point1, contact.point2, contact.normal1))
    }

    fn aabb(&self) -> Aabb {
        let aabb = self.shape.compute_local_aabb();
        Aabb { min: aabb.mins, max: aabb.maxs }
    }
}

/// The convex hull of spheres for parry's algorithms.
struct SphereHull<'a>(&'a [Sphere]);

impl SupportMap for SphereHull<'_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        self.local_support_point_toward(direction.try_normalize().unwrap_or(Vec3::Y))
    }

    fn local_support_point_toward(&self, direction: Vector) -> Vector {
        let reach = |sphere: &Sphere| sphere.center.dot(direction) + sphere.radius;
        let farthest = self.0.iter().max_by(|a, b| reach(a).total_cmp(&reach(b)));
        farthest.map_or(Vec3::ZERO, |sphere| sphere.center + direction * sphere.radius)
    }
}
