//! Bodies that cannot be computed with leave the simulation, and come back when they are set to what can: the rest goes on.
//!
//! Rapier takes out what is not finite at the start or at the end of its step. Here that is told, and found before the step where rapier would
//! find it after: in a force, say, whose contacts have it by then. What is finite and too large for the kernels goes the same way.

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierContextSimulation, RapierRigidBodySet},
    prelude::{
        AdditionalMassProperties, Collider, ColliderDisabled, Damping, ExternalForce, GravityScale,
        RapierColliderHandle, RapierRigidBodyHandle, RigidBodyDisabled, Velocity,
    },
    rapier::{
        dynamics::{RigidBody as RapierBody, RigidBodyHandle, RigidBodyType},
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use crate::{constants::MAX_MAGNITUDE, geometry::Pose3};

/// Marks an entity whose body, or whose collider alone, is out of the simulation.
#[derive(Component, Clone, Copy)]
pub(super) enum Quarantined {
    Body,
    Collider,
}

/// False for what is not a number, too.
fn is_bounded(v: Vec3) -> bool {
    v.abs().cmple(Vec3::splat(MAX_MAGNITUDE)).all()
}

fn is_sound_pose(pose: &Pose3) -> bool {
    is_bounded(pose.translation) && pose.rotation.is_finite()
}

fn is_sound_body(body: &RapierBody) -> bool {
    let numbers = [body.gravity_scale(), body.linear_damping(), body.angular_damping()];
    is_sound_pose(body.position())
        && is_sound_pose(body.next_position())
        && is_bounded(body.linvel())
        && is_bounded(body.angvel())
        && body.user_force().is_finite()
        && body.user_torque().is_finite()
        && numbers.into_iter().all(f32::is_finite)
}

fn is_sound_collider(collider: &RapierCollider) -> bool {
    is_sound_pose(collider.position_wrt_parent().unwrap_or(collider.position()))
}

/// Takes out what cannot be computed with, and tells so. Runs before rapier's step and after it.
pub(super) fn isolate(
    mut commands: Commands,
    mut contexts: Query<(&mut RapierRigidBodySet, &mut RapierContextColliders, &RapierContextSimulation)>,
    names: Query<NameOrEntity, Without<Quarantined>>,
) {
    for (mut bodies, mut colliders, simulation) in &mut contexts {
        let known = simulation.pipeline.quarantine();
        let is_out = |handle: &&RigidBodyHandle| bodies.bodies.get(**handle).is_some_and(|body| !body.is_enabled());
        let unsound = bodies.bodies.iter().filter(|(_, body)| body.is_enabled() && !is_sound_body(body));
        let found: Vec<RigidBodyHandle> =
            unsound.map(|(handle, _)| handle).chain(known.bodies().iter().filter(is_out).copied()).collect();
        for handle in found {
            let entity = bodies.rigid_body_entity(handle);
            let (Some(entity), Some(body)) = (entity, bodies.bodies.get_mut(handle)) else { continue };
            put_away(body, &mut colliders);
            let Ok(name) = names.get(entity) else { continue };
            warn!(
                "{name}: its transform, velocity, mass or a force on it is not finite or too large, so its body is disabled; \
                 set them to finite values, of at most {MAX_MAGNITUDE:e}, and it comes back"
            );
            commands.entity(entity).try_insert((Quarantined::Body, RigidBodyDisabled));
        }
        let is_out = |handle: &&ColliderHandle| colliders.colliders.get(**handle).is_some_and(|c| !c.is_enabled());
        let unsound = colliders.colliders.iter().filter(|(_, c)| c.is_enabled() && !is_sound_collider(c));
        let found: Vec<ColliderHandle> =
            unsound.map(|(handle, _)| handle).chain(known.colliders().iter().filter(is_out).copied()).collect();
        for handle in found {
            let entity = colliders.collider_entity(handle);
            let (Some(entity), Some(collider)) = (entity, colliders.colliders.get_mut(handle)) else { continue };
            if !is_sound_collider(collider) {
                collider.set_position_wrt_parent(Pose3::IDENTITY);
                collider.set_position(Pose3::IDENTITY);
            }
            collider.set_enabled(false);
            let Ok(name) = names.get(entity) else { continue };
            warn!(
                "{name}: its transform or size is not finite or too large, so its collider is disabled; set them to finite values, \
                 of at most {MAX_MAGNITUDE:e}, and it comes back"
            );
            commands.entity(entity).try_insert((Quarantined::Collider, ColliderDisabled));
        }
    }
}

/// Disables a body, with values that harm nothing until it comes back.
fn put_away(body: &mut RapierBody, colliders: &mut RapierContextColliders) {
    body.set_position(Pose3::IDENTITY, false);
    // What becomes fixed loses its velocity: the one way to take it from a body of any type.
    let kind = body.body_type();
    for kind in [RigidBodyType::Dynamic, RigidBodyType::Fixed, kind] {
        body.set_body_type(kind, false);
    }
    body.reset_forces(false);
    body.reset_torques(false);
    body.set_enabled(false);
    for &handle in body.colliders() {
        // One that has just been made has its place by the body's.
        if let Some(collider) = colliders.colliders.get_mut(handle)
            && let Some(&local) = collider.position_wrt_parent()
        {
            collider.set_position(local);
        }
    }
}

/// Takes back what has been set to finite values.
pub(super) fn release(
    mut commands: Commands,
    mut contexts: Query<(&mut RapierRigidBodySet, &mut RapierContextColliders)>,
    changed: Query<
        (
            Entity,
            &Quarantined,
            &RapierContextEntityLink,
            &GlobalTransform,
            Option<&RapierRigidBodyHandle>,
            Option<&RapierColliderHandle>,
            Option<&Velocity>,
            Option<&ExternalForce>,
        ),
        Or<(
            Changed<GlobalTransform>,
            Changed<Velocity>,
            Changed<ExternalForce>,
            Changed<GravityScale>,
            Changed<Damping>,
            Changed<AdditionalMassProperties>,
            Changed<Collider>,
        )>,
    >,
) {
    for (entity, quarantined, link, transform, body, collider, velocity, force) in &changed {
        let Ok((mut bodies, mut colliders)) = contexts.get_mut(link.0) else { continue };
        let (_, rotation, translation) = transform.to_scale_rotation_translation();
        let pose = Pose3::from_parts(translation, rotation);
        let velocity = velocity.copied().unwrap_or_default();
        let force = force.copied().unwrap_or_default();
        if !is_sound_pose(&pose)
            || !(is_bounded(velocity.linear) && is_bounded(velocity.angular))
            || !(force.force.is_finite() && force.torque.is_finite())
        {
            continue;
        }
        match quarantined {
            Quarantined::Body => {
                if let Some(body) = body.and_then(|handle| bodies.bodies.get_mut(handle.0)) {
                    body.set_position(pose, true);
                    body.set_linvel(velocity.linear, true);
                    body.set_angvel(velocity.angular, true);
                    body.set_enabled(true);
                    if !is_sound_body(body) {
                        put_away(body, &mut colliders);
                        continue;
                    }
                }
                commands.entity(entity).try_remove::<(Quarantined, RigidBodyDisabled)>();
            }
            Quarantined::Collider => {
                if let Some(collider) = collider.and_then(|handle| colliders.colliders.get_mut(handle.0)) {
                    let aabb = collider.shape().compute_local_aabb();
                    if !(aabb.mins.is_finite() && aabb.maxs.is_finite()) {
                        continue;
                    }
                    collider.set_position(pose);
                    collider.set_enabled(true);
                }
                commands.entity(entity).try_remove::<(Quarantined, ColliderDisabled)>();
            }
        }
    }
}
