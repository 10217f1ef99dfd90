//! Rapier's other colliders as [`ConvexParts`] for the pipeline.

use std::sync::Arc;

use bevy_rapier3d::parry::{
    bounding_volume::Aabb as ParryAabb,
    math::Pose,
    query::details::contact_support_map_support_map,
    shape::{PolygonalFeature, Shape as ParryShape, SharedShape, SupportMap, TypedShape},
};
use glam::{Quat, Vec3};

use super::{primitive::SphereHull, shape::MedialShape};
use crate::{
    geometry::{Aabb, Pose3, Sphere},
    pipeline::{ConvexParts, Core, Hull, Part, Parts, ShapeId, Solid},
    query::SupportShape,
};

/// Largest coordinate of unbounded shapes, in metres. Products of larger coordinates lose all precision in f32.
const FARTHEST: f32 = 1.0e9;

/// A parry shape that is not medial.
pub(super) struct RapierShape<'a>(pub &'a dyn ParryShape);

impl ConvexParts for RapierShape<'_> {
    fn aabb(&self) -> Aabb {
        let aabb = self.0.compute_local_aabb();
        let ends = [aabb.mins, aabb.maxs].map(|corner| corner.clamp(Vec3::splat(-FARTHEST), Vec3::splat(FARTHEST)));
        Aabb { min: ends[0], max: ends[1] }
    }

    fn bounding_sphere(&self) -> Sphere {
        let sphere = self.0.compute_local_bounding_sphere();
        Sphere::new(sphere.center, sphere.radius.min(FARTHEST))
    }

    fn len(&self) -> usize {
        match self.0.as_typed_shape() {
            TypedShape::Compound(compound) => compound.shapes().len(),
            TypedShape::TriMesh(mesh) => mesh.indices().len(),
            TypedShape::Polyline(line) => line.indices().len(),
            // Includes removed triangles, because counting the others would take a loop over all cells.
            TypedShape::HeightField(field) => 2 * field.nrows() * field.ncols(),
            TypedShape::Voxels(voxels) => voxels.voxels().filter(|voxel| !voxel.state.is_empty()).count(),
            _ => 1,
        }
    }

    fn within(&self, reach: &Aabb) -> Parts<'_> {
        parts_within(self.0, reach)
    }
}

impl ConvexParts for SharedShape {
    fn aabb(&self) -> Aabb {
        RapierShape(&**self).aabb()
    }

    fn bounding_sphere(&self) -> Sphere {
        RapierShape(&**self).bounding_sphere()
    }

    fn len(&self) -> usize {
        RapierShape(&**self).len()
    }

    fn within(&self, reach: &Aabb) -> Parts<'_> {
        parts_within(&**self, reach)
    }

    /// Clones have the same address.
    fn address(&self) -> usize {
        Arc::as_ptr(&self.0).addr()
    }
}

/// Converts a shape for the pipeline. Returns `None` for a custom shape without a support map.
pub(super) fn solid(shape: &SharedShape) -> Option<Solid> {
    match shape.as_shape::<MedialShape>() {
        Some(medial) => Some(medial.shape.clone().into()),
        None => is_known(&**shape).then(|| Solid::Parts(Arc::new(shape.clone()))),
    }
}

/// Returns the identity of [`solid`].
pub(super) fn shape_id(shape: &SharedShape) -> ShapeId {
    shape.as_shape::<MedialShape>().map_or_else(|| ShapeId::of_parts(shape), MedialShape::id)
}

/// Returns false for a custom shape of another crate without a support map.
pub(super) fn is_known(shape: &dyn ParryShape) -> bool {
    let custom = matches!(shape.as_typed_shape(), TypedShape::Custom(_));
    !custom || shape.as_shape::<MedialShape>().is_some() || shape.as_support_map().is_some()
}

/// Returns the convex parts of a shape that overlap with `reach`, a box in the shape's frame.
pub(super) fn parts_within<'a>(shape: &'a dyn ParryShape, reach: &Aabb) -> Parts<'a> {
    let parry_reach = ParryAabb::new(reach.min, reach.max);
    let mut parts = Parts::new();
    match shape.as_typed_shape() {
        TypedShape::Compound(compound) => {
            for id in compound.bvh().intersect_aabb(&parry_reach) {
                let (pose, shape) = &compound.shapes()[id as usize];
                parts.extend(convex(id, *pose, &**shape, reach));
            }
        }
        TypedShape::TriMesh(mesh) => {
            parts.extend(mesh.bvh().intersect_aabb(&parry_reach).map(|id| {
                let triangle = mesh.triangle(id);
                slab(id, [triangle.a, triangle.b, triangle.c], 0.0)
            }));
        }
        TypedShape::Polyline(line) => {
            parts.extend(line.bvh().intersect_aabb(&parry_reach).map(|id| {
                let segment = line.segment(id);
                cone(id, [segment.a, segment.b], 0.0)
            }));
        }
        TypedShape::HeightField(field) => {
            field.map_elements_in_local_aabb(&parry_reach, &mut |id, triangle| {
                parts.push(slab(id, [triangle.a, triangle.b, triangle.c], 0.0));
            });
        }
        TypedShape::Voxels(voxels) => {
            let half = voxels.voxel_size() * 0.5;
            for voxel in voxels.voxels_intersecting_local_aabb(&parry_reach).filter(|voxel| !voxel.state.is_empty()) {
                let pose = Pose3::from_translation(voxel.center);
                parts.push(Part::of_cuboid(voxel.linear_id.flat_id() as u32, pose, half, 0.0, reach));
            }
        }
        _ => parts.extend(convex(0, Pose3::IDENTITY, shape, reach)),
    }
    // Cells of height fields and voxels are visited by columns or chunks, so the ids are not in order.
    parts.sort_unstable_by_key(|part| part.id);
    parts
}

/// Converts a convex shape to a part. `pose`: pose of the shape in the collider's frame.
fn convex<'a>(id: u32, pose: Pose3, shape: &'a dyn ParryShape, reach: &Aabb) -> Option<Part<'a>> {
    let at = |part: Part<'a>| Part { pose: pose * part.pose, ..part };
    Some(match shape.as_typed_shape() {
        TypedShape::Cuboid(cuboid) => Part::of_cuboid(id, pose, cuboid.half_extents, 0.0, reach),
        TypedShape::RoundCuboid(round) => {
            Part::of_cuboid(id, pose, round.inner_shape.half_extents, round.border_radius, reach)
        }
        TypedShape::Ball(ball) => {
            let core = Core::Hull(Hull::Sphere([Sphere::new(Vec3::ZERO, ball.radius)]));
            Part { id, pose, core, rounding: 0.0 }
        }
        TypedShape::Capsule(capsule) => at(cone(id, [capsule.segment.a, capsule.segment.b], capsule.radius)),
        TypedShape::Segment(segment) => at(cone(id, [segment.a, segment.b], 0.0)),
        TypedShape::Triangle(triangle) => at(slab(id, [triangle.a, triangle.b, triangle.c], 0.0)),
        TypedShape::RoundTriangle(round) => {
            let triangle = round.inner_shape;
            at(slab(id, [triangle.a, triangle.b, triangle.c], round.border_radius))
        }
        TypedShape::RoundCylinder(round) => mapped(id, pose, &round.inner_shape, round.border_radius)?,
        TypedShape::RoundCone(round) => mapped(id, pose, &round.inner_shape, round.border_radius)?,
        TypedShape::RoundConvexPolyhedron(round) => mapped(id, pose, &round.inner_shape, round.border_radius)?,
        TypedShape::HalfSpace(half_space) => {
            // A box below the plane stands in for the half-space. It is larger than the reach and centred below it.
            let reach = reach.transformed(&pose.inverse(), 1.0);
            let center = reach.center();
            let height = half_space.normal.dot(center);
            let half = 4.0 * reach.half_extents().length() + height.abs();
            let turn = Quat::from_rotation_arc(Vec3::Y, half_space.normal);
            let pose = pose * Pose3::from_parts(center - half_space.normal * (height + half), turn);
            Part { id, pose, core: Core::Cuboid(Vec3::splat(half)), rounding: 0.0 }
        }
        _ => mapped(id, pose, shape, 0.0)?,
    })
}

/// Converts a shape with a support map to a part. `rounding`: distance of the surface from the shape, in metres.
fn mapped<'a>(id: u32, pose: Pose3, shape: &'a dyn ParryShape, rounding: f32) -> Option<Part<'a>> {
    let map = shape.as_support_map()?;
    Some(Part { id, pose, core: Core::Support(Box::new(Mapped { shape, map })), rounding })
}

/// Converts a capsule or segment to a part. The origin of its frame is the first end, so coordinates are no larger than the part.
fn cone<'a>(id: u32, [a, b]: [Vec3; 2], radius: f32) -> Part<'a> {
    let spheres = [Vec3::ZERO, b - a].map(|center| Sphere::new(center, radius));
    Part { id, pose: Pose3::from_translation(a), core: Core::Hull(Hull::Cone(spheres)), rounding: 0.0 }
}

/// Converts a triangle or round triangle to a part. The origin of its frame is the first corner.
fn slab<'a>(id: u32, [a, b, c]: [Vec3; 3], radius: f32) -> Part<'a> {
    let spheres = [Vec3::ZERO, b - a, c - a].map(|center| Sphere::new(center, radius));
    Part { id, pose: Pose3::from_translation(a), core: Core::Hull(Hull::Slab(spheres)), rounding: 0.0 }
}

/// A convex parry shape.
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

    fn face(&self, direction: Vec3, near: Vec3, visit: &mut dyn FnMut(Vec3)) {
        if let Some((map, _)) = self.shape.as_polygonal_feature_map() {
            let mut face = PolygonalFeature::default();
            map.local_support_feature_toward(direction, near, &mut face);
            face.vertices[..face.num_vertices].iter().for_each(|vertex| visit(*vertex));
        }
    }

    fn aabb(&self) -> Aabb {
        let aabb = self.shape.compute_local_aabb();
        Aabb { min: aabb.mins, max: aabb.maxs }
    }
}
