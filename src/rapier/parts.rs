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

/// A convex part of a collider's shape.
pub(super) struct Part<'a> {
    /// Which.
    pub id: u32,
    /// Pose of its frame in the collider's.
    pub pose: Pose3,
    /// The part without its rounding.
    pub second: Second<'a>,
    /// How far its surface is outside of that, in metres.
    pub rounding: f32,
}

impl<'a> Part<'a> {
    /// The only part of a shape, in the shape's own frame.
    fn whole(second: Second<'a>, rounding: f32) -> Self {
        Self { id: 0, pose: Pose3::IDENTITY, second, rounding }
    }
}

/// Calls `visit` with the parts of a collider's shape that come within `reach`, a box in the collider's frame. False for a shape that nothing
/// is known about.
pub(super) fn visit_parts(shape: &dyn ParryShape, reach: &Aabb, visit: &mut dyn FnMut(Part)) -> bool {
    let parry_reach = ParryAabb::new(reach.min, reach.max);
    if let Some(composite) = shape.as_composite_shape() {
        let mut known = true;
        for id in composite.bvh().intersect_aabb(&parry_reach) {
            composite.map_part_at(id, &mut |pose, shape, _| {
                known &= visit_convex(shape, reach, &mut |part| {
                    visit(Part { id, pose: pose.map_or(part.pose, |pose| pose * part.pose), ..part });
                });
            });
        }
        return known;
    }
    // The medial shape first: parry knows its own shapes only.
    if shape.as_shape::<MedialShape>().is_none() {
        match shape.as_typed_shape() {
            TypedShape::HeightField(field) => {
                field.map_elements_in_local_aabb(&parry_reach, &mut |id, triangle| {
                    let second = Second::Hull(slab([triangle.a, triangle.b, triangle.c], 0.0));
                    visit(Part { id, pose: Pose3::IDENTITY, second, rounding: 0.0 });
                });
                return true;
            }
            TypedShape::Voxels(voxels) => {
                let second = Second::Cuboid(voxels.voxel_size() * 0.5);
                for voxel in voxels.voxels_intersecting_local_aabb(&parry_reach).filter(|voxel| !voxel.state.is_empty())
                {
                    let pose = Pose3::from_translation(voxel.center);
                    visit(Part { id: voxel.linear_id.flat_id() as u32, pose, second, rounding: 0.0 });
                }
                return true;
            }
            _ => {}
        }
    }
    visit_convex(shape, reach, visit)
}

/// The same for a shape of one part.
fn visit_convex(shape: &dyn ParryShape, reach: &Aabb, visit: &mut dyn FnMut(Part)) -> bool {
    if let Some(medial) = shape.as_shape::<MedialShape>() {
        visit(Part::whole(Second::Shape(&medial.shape), 0.0));
        return true;
    }
    match shape.as_typed_shape() {
        TypedShape::Cuboid(cuboid) => visit(Part::whole(Second::Cuboid(cuboid.half_extents), 0.0)),
        TypedShape::RoundCuboid(round) => {
            visit(Part::whole(Second::Cuboid(round.inner_shape.half_extents), round.border_radius))
        }
        TypedShape::Ball(ball) => {
            visit(Part::whole(Second::Hull(Hull::Sphere([Sphere::new(Vec3::ZERO, ball.radius)])), 0.0))
        }
        TypedShape::Capsule(capsule) => {
            visit(Part::whole(Second::Hull(cone([capsule.segment.a, capsule.segment.b], capsule.radius)), 0.0));
        }
        TypedShape::Segment(segment) => visit(Part::whole(Second::Hull(cone([segment.a, segment.b], 0.0)), 0.0)),
        TypedShape::Triangle(triangle) => {
            visit(Part::whole(Second::Hull(slab([triangle.a, triangle.b, triangle.c], 0.0)), 0.0))
        }
        TypedShape::RoundTriangle(round) => {
            let triangle = round.inner_shape;
            visit(Part::whole(Second::Hull(slab([triangle.a, triangle.b, triangle.c], round.border_radius)), 0.0));
        }
        TypedShape::RoundCylinder(round) => return visit_mapped(&round.inner_shape, round.border_radius, visit),
        TypedShape::RoundCone(round) => return visit_mapped(&round.inner_shape, round.border_radius, visit),
        TypedShape::RoundConvexPolyhedron(round) => {
            return visit_mapped(&round.inner_shape, round.border_radius, visit);
        }
        TypedShape::HalfSpace(half_space) => {
            // A box below the plane, larger than what can reach it and centred under that.
            let center = reach.center();
            let height = half_space.normal.dot(center);
            let half = 4.0 * reach.half_extents().length() + height.abs();
            let turn = Quat::from_rotation_arc(Vec3::Y, half_space.normal);
            let pose = Pose3::from_parts(center - half_space.normal * (height + half), turn);
            visit(Part { id: 0, pose, second: Second::Cuboid(Vec3::splat(half)), rounding: 0.0 });
        }
        _ => return visit_mapped(shape, 0.0, visit),
    }
    true
}

/// The same for a shape that has a support map, and a rounding outside of that.
fn visit_mapped(shape: &dyn ParryShape, rounding: f32, visit: &mut dyn FnMut(Part)) -> bool {
    let Some(map) = shape.as_support_map() else { return false };
    visit(Part::whole(Second::Support(&Mapped { shape, map }), rounding));
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
