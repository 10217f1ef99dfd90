//! Bodies and statics in the layout of the GPU.

use glam::{Quat, Vec3};

use super::{
    layout::{self, BOX_SHAPE, NO_RIGID_BODY, OTHER_SHAPE},
    shapes::Shapes,
};
use crate::{
    geometry::Pose3,
    pipeline::{Body, ConvexParts, Core, Deforming, OtherShape, Side, Solid, StaticBody},
};

/// Returns the first of these bodies and statics whose numbers, as far as the passes use them, are NaN or infinite.
pub(super) fn not_finite(bodies: &[Body], statics: &[StaticBody]) -> Option<Side> {
    let is_finite = |body: &Body| {
        let sweep = &body.sweep;
        let vectors = [sweep.translation, sweep.rotation, sweep.local_center];
        is_finite_solid(&body.solid)
            && body.solid.deforming().is_none_or(Deforming::is_finite)
            && is_finite_pose(&sweep.start)
            && vectors.into_iter().all(Vec3::is_finite)
    };
    let is_finite_static = |body: &StaticBody| is_finite_solid(&body.solid) && is_finite_pose(&body.pose);
    let body = bodies.iter().position(|body| !is_finite(body)).map(|i| Side::Body(i as u32));
    body.or_else(|| statics.iter().position(|body| !is_finite_static(body)).map(|i| Side::Static(i as u32)))
}

fn is_finite_pose(pose: &Pose3) -> bool {
    pose.translation.is_finite() && pose.rotation.is_finite()
}

fn is_finite_solid(solid: &Solid) -> bool {
    let bound = solid.bounding_sphere();
    bound.center.is_finite() && bound.radius.is_finite()
}

/// Layout of a body. `margin`: distance from its bounding sphere within which it may meet others, in metres. `slack`: largest deviation from its
/// path, in metres. The shape of a deforming body is set later, because it is replaced in each step.
pub(super) fn body(body: &Body, is_awake: bool, [margin, slack]: [f32; 2], shapes: &mut Shapes) -> layout::Body {
    let sweep = &body.sweep;
    let bound = body.solid.bounding_sphere();
    let (shape, scale, arm, (half, rounding)) = match body.solid.second() {
        OtherShape::Shape(shape) => {
            (shapes.index_of(&shape.axis), shape.scale, shape.arm(sweep.local_center), (Vec3::ZERO, 0.0))
        }
        OtherShape::Parts(parts) => {
            let single_box = single_box(parts).filter(|_| parts.aabb().center() == bound.center);
            let shape = if single_box.is_some() { BOX_SHAPE } else { OTHER_SHAPE };
            (shape, 1.0, bound.farthest(sweep.local_center), single_box.unwrap_or_default())
        }
    };
    layout::Body {
        position: sweep.start.translation,
        shape,
        rotation: sweep.start.rotation,
        translation: sweep.translation,
        scale,
        turn: sweep.rotation,
        arm,
        local_center: sweep.local_center,
        margin: margin + slack,
        bound: bound.center.extend(bound.radius),
        memberships: body.groups.memberships,
        collides_with: body.groups.filter,
        rigid_body: rigid_body(body.rigid_body),
        world: body.world,
        is_active: is_awake.into(),
        slack,
        rounding,
        half,
        unused: 0,
    }
}

pub(super) fn still(body: &StaticBody, shapes: &mut Shapes) -> layout::Static {
    let obb = body.obb();
    let (shape, scale, half, rounding) = match body.solid.second() {
        OtherShape::Shape(shape) => (shapes.index_of(&shape.axis), shape.scale, obb.half_extents, 0.0),
        OtherShape::Parts(parts) => match single_box(parts) {
            Some((half, rounding)) => (BOX_SHAPE, 1.0, half, rounding),
            None => (OTHER_SHAPE, 1.0, obb.half_extents, 0.0),
        },
    };
    layout::Static {
        center: obb.pose.translation,
        shape,
        rotation: obb.pose.rotation,
        half,
        rounding,
        position: body.pose.translation,
        scale,
        radius: body.solid.bounding_sphere().radius,
        memberships: body.groups.memberships,
        collides_with: body.groups.filter,
        rigid_body: rigid_body(body.rigid_body),
        world: body.world,
        unused: [0; 2],
    }
}

/// Splits 64 bits into two words, the lower one first.
fn rigid_body(id: Option<u64>) -> [u32; 2] {
    let id = id.unwrap_or(NO_RIGID_BODY);
    [id as u32, (id >> 32) as u32]
}

/// Returns half extents and rounding of a collider that is one box, part 0, with the axes of its body. `None` for other colliders.
fn single_box(parts: &dyn ConvexParts) -> Option<(Vec3, f32)> {
    if parts.len() != 1 {
        return None;
    }
    let aabb = parts.aabb();
    match &parts.within(&aabb.inflated(aabb.half_extents().max_element()))[..] {
        [part] if part.id == 0 && part.pose.rotation == Quat::IDENTITY && part.pose.translation == aabb.center() => {
            match part.core {
                Core::Cuboid(half) => Some((half, part.rounding)),
                _ => None,
            }
        }
        _ => None,
    }
}
