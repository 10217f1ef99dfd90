//! The velocity of skinned surfaces acts on the bodies that they touch.
//!
//! Rapier has one velocity per rigid body, but the surface of a skinned shape moves differently at each point. So rapier solves its contacts as if the
//! surface were at rest in the frame of its collider. After the step, a body in touch with a surface that moves faster towards it gets the impulse that
//! gives the point of contact the velocity of the surface along the normal, and half of the velocity that would end an overlap in a step. The impact is
//! inelastic, and friction is that of a surface at rest.

use bevy::prelude::*;
use bevy_rapier3d::rapier::dynamics::RigidBody;

use super::context::Context;
use crate::{
    constants::LINEAR_SLOP,
    pipeline::{Contact, Impact, Pair, Side},
    plugin::MedialStep,
};

/// Gives bodies the velocity of the skinned surfaces that push them.
pub(super) fn carry(step: &MedialStep, contexts: &mut Query<Context>) {
    for pair in step.output.pairs.iter().filter(|pair| pushes(step, pair)) {
        let Ok(context) = contexts.get_mut(step.context(pair.first)) else { continue };
        let bodies = context.bodies.into_inner();
        let collider = context.colliders.colliders.get(step.info(pair.first).collider());
        let Some(parent) = collider.and_then(|collider| collider.parent()) else { continue };
        let Some(body) = bodies.bodies.get_mut(parent) else { continue };
        for Touch { point, normal, surface, depth } in touches(step, pair) {
            push(body, point, normal, surface.dot(normal) - 0.5 * depth / step.dt);
        }
    }
}

/// A touch of a body and a surface in motion, at the end of the step in the world.
struct Touch {
    point: Vec3,
    /// From the body to the surface.
    normal: Vec3,
    /// Velocity of the surface in metres per second.
    surface: Vec3,
    /// Depth of the overlap beyond the one that the solver leaves, in metres.
    depth: f32,
}

/// Returns the touches of a pair. A body that has an impact is pushed along, so it may end the step just off the surface.
fn touches<'a>(step: &'a MedialStep, pair: &'a Pair) -> impl Iterator<Item = Touch> + use<'a> {
    let pose = step.final_pose(pair.first);
    let impact = pair.impact.map(|Impact { fraction, point, normal, primitive2, .. }| {
        let then = step.input.bodies[pair.first.body()? as usize].sweep.pose_at(fraction);
        let surface = step.velocity_at(pair.second, primitive2, point, fraction);
        Some(Touch { point: pose.transform_point(then.inverse_transform_point(point)), normal, surface, depth: 0.0 })
    });
    let touch = LINEAR_SLOP * step.input.length_unit;
    let contacts = step.output.manifolds[pair.manifolds.clone()].iter().filter_map(move |manifold| {
        let deepest = manifold.contacts().iter().min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        let &Contact { point1, normal1, primitive2, distance, .. } =
            Some(deepest).filter(|contact| contact.distance <= touch)?;
        let point = pose.transform_point(point1);
        let surface = step.velocity_at(pair.second, primitive2, point, 1.0);
        Some(Touch { point, normal: pose.rotation * normal1, surface, depth: (-distance - touch).max(0.0) })
    });
    impact.flatten().into_iter().chain(contacts)
}

/// Returns true if the second side of a pair is a skinned shape in motion that acts on the first one.
fn pushes(step: &MedialStep, pair: &Pair) -> bool {
    let (Side::Body(first), Side::Body(second)) = (pair.first, pair.second) else { return false };
    let [first, second] = [first, second].map(|body| &step.input.bodies[body as usize]);
    let moves = second.solid.deforming().is_some_and(|shape| shape.is_moving());
    moves && first.stops && !first.sensor && !second.sensor && first.stop_groups.test(&second.stop_groups)
}

/// Gives a point of a body the velocity of a surface along the normal, unless the body leaves the surface faster, or approaches it faster than the surface moves.
/// `normal`: towards the surface. `surface`: velocity of the surface along the normal in metres per second.
fn push(body: &mut RigidBody, point: Vec3, normal: Vec3, surface: f32) {
    let own = body.velocity_at_point(point).dot(normal);
    if surface >= 0.0 || own <= surface || own > -surface {
        return;
    }
    let mass = body.mass_properties();
    let turning = (point - mass.world_com).cross(normal);
    let yielding =
        normal.dot(mass.effective_inv_mass * normal) + turning.dot(mass.effective_world_inv_inertia * turning);
    if yielding > 0.0 {
        body.apply_impulse_at_point(normal * ((surface - own) / yielding), point, true);
    }
}
