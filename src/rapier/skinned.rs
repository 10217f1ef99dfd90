//! Colliders of skinned shapes. The shape of such a collider is replaced after each step of rapier. So rapier solves contacts with the pose at the start of
//! the step, as for a body, and the step sweeps the shape to the next pose.

use bevy::{ecs::entity::EntityHashSet, prelude::*};
use bevy_rapier3d::{
    parry::shape::SharedShape,
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierContextSimulation, RapierRigidBodySet},
    prelude::{Collider, ColliderScale, RapierColliderHandle},
    rapier::geometry::Collider as RapierCollider,
};

use super::{
    attach::UNSCALED,
    context::{Context, collider_pose, skin},
    shape::MedialShape,
    snapshot::RapierStep,
};
use crate::plugin::{Skeletons, SkinPose};

type Handles<'w, 's> = Query<'w, 's, (&'static RapierColliderHandle, &'static RapierContextEntityLink)>;

/// Poses all skinned shapes by their joints, in worlds in which rapier has stepped. A collider of a body has the frame that its body gives it.
pub(super) fn follow_joints(mut skeletons: Skeletons, handles: Handles, rapier: RapierStep, contexts: Query<Context>) {
    let is_running = |entity| {
        let context = handles.get(entity).ok().and_then(|(_, link)| contexts.get(link.0).ok());
        context.is_none_or(|context| rapier.runs(&context))
    };
    skeletons.pose(is_running, |entity| {
        let (handle, link) = handles.get(entity).ok()?;
        let context = contexts.get(link.0).ok()?;
        let collider = context.colliders.colliders.get(handle.0)?;
        context.body(collider).map(|body| collider_pose(collider, Some(body)))
    });
}

/// Passes the new poses to rapier, and inserts the collider of a shape that was placed for the first time.
pub(super) fn replace_shapes(
    mut commands: Commands,
    mut poses: Query<(Entity, &SkinPose, Option<&mut Collider>, Option<&RapierColliderHandle>), Changed<SkinPose>>,
    handles: Handles,
    mut contexts: Query<(&RapierRigidBodySet, &mut RapierContextColliders, &mut RapierContextSimulation)>,
) {
    for (entity, pose, collider, handle) in &mut poses {
        let shape = || SharedShape::new(MedialShape::deforming(pose.shape().clone()));
        let is_own =
            |collider: &Collider| collider.raw.as_shape::<MedialShape>().is_some_and(|shape| shape.skin.is_some());
        let Some(mut known) = collider.filter(|collider| is_own(collider)) else {
            commands.entity(entity).try_insert((Collider::from(shape()), UNSCALED));
            continue;
        };
        let Some((handle, (_, link))) = handle.zip(handles.get(entity).ok()) else { continue };
        let Ok((bodies, mut colliders, mut simulation)) = contexts.get_mut(link.0) else { continue };
        let Some(collider) = colliders.colliders.get(handle.0) else { continue };
        if skin(collider).is_some_and(|skin| std::sync::Arc::ptr_eq(skin, pose.shape())) {
            continue;
        }
        let body = collider.parent().and_then(|parent| bodies.bodies.get(parent));
        let place = body.map_or(pose.frame(), |body| collider_pose(collider, Some(body)));
        let shape = shape();
        // Rapier has the shape already.
        known.bypass_change_detection().raw = shape.clone();
        let is_free = body.is_none();
        if let Some(collider) = colliders.colliders.get_mut(handle.0) {
            let aabb = shape.compute_aabb(&place);
            collider.set_shape(shape);
            if is_free {
                collider.set_position(place);
            }
            let RapierContextSimulation { broad_phase, integration_parameters, .. } = &mut *simulation;
            broad_phase.set_aabb(integration_parameters, handle.0, aabb);
        }
    }
}

/// Logs once that a skinned shape has a dynamic body.
pub(super) fn check_bodies(
    poses: Query<(NameOrEntity, &RapierColliderHandle, &RapierContextEntityLink), With<SkinPose>>,
    contexts: Query<(&RapierRigidBodySet, &RapierContextColliders)>,
    mut logged: Local<EntityHashSet>,
) {
    logged.retain(|entity| poses.contains(*entity));
    for (name, handle, link) in &poses {
        let Ok((bodies, colliders)) = contexts.get(link.0) else { continue };
        let parent = colliders.colliders.get(handle.0).and_then(RapierCollider::parent);
        let is_dynamic = parent.and_then(|parent| bodies.bodies.get(parent)).is_some_and(|body| body.is_dynamic());
        if is_dynamic && logged.insert(name.entity) {
            error!(
                "{name}: its joints place it, but its RigidBody is dynamic; make it RigidBody::KinematicPositionBased, or remove it"
            );
        }
    }
}

/// Puts the colliders of skinned shapes without a body back to the frame of their shapes. Rapier moves them with the transforms of their entities, but
/// the joints alone place the shapes.
pub(super) fn hold(
    poses: Query<(&SkinPose, &RapierColliderHandle, &RapierContextEntityLink)>,
    mut contexts: Query<&mut RapierContextColliders>,
) {
    let is_astray = |collider: &RapierCollider, pose: &SkinPose| {
        collider.parent().is_none() && *collider.position() != pose.frame()
    };
    for (pose, handle, link) in &poses {
        let Ok(mut colliders) = contexts.get_mut(link.0) else { continue };
        if colliders.colliders.get(handle.0).is_some_and(|collider| is_astray(collider, pose))
            && let Some(collider) = colliders.colliders.get_mut(handle.0)
        {
            collider.set_position(pose.frame());
        }
    }
}

/// Removes the collider with the pose.
pub(super) fn detach_skin(removed: On<Remove, SkinPose>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<(Collider, ColliderScale)>();
}
