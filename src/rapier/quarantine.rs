//! Disables bodies with invalid values, so that the rest of the simulation continues. Enables them again when the user sets valid values.
//!
//! Rapier itself disables bodies with values that are not finite at the start or at the end of its step. This module reports them. It also finds some before
//! the step that rapier finds too late: a force that is not finite would spread through contacts within the step. Values that are finite but too large for
//! the kernels are handled in the same way.

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierRigidBodySet},
    prelude::{
        AdditionalMassProperties, Collider, ColliderDisabled, Damping, ExternalForce, GravityScale,
        RapierColliderHandle, RapierRigidBodyHandle, RigidBodyDisabled, Velocity,
    },
    rapier::{
        dynamics::{RigidBody as RapierBody, RigidBodyHandle, RigidBodyType},
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use crate::{
    constants::MAX_MAGNITUDE,
    geometry::Pose3,
    plugin::{is_bounded, is_sound_pose},
};

/// Marks an entity whose body this module has disabled.
#[derive(Component)]
pub(super) struct QuarantinedBody;

/// Marks an entity whose collider this module has disabled. This does not depend on its body.
#[derive(Component)]
pub(super) struct QuarantinedCollider;

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

/// Bodies and colliders that are enabled when rapier's step begins, with the entity of their context. Those that are disabled after the step were disabled by
/// rapier.
#[derive(Resource, Default)]
pub(super) struct Running {
    bodies: Vec<(Entity, RigidBodyHandle)>,
    colliders: Vec<(Entity, ColliderHandle)>,
}

type Contexts<'w, 's> = Query<'w, 's, (Entity, &'static mut RapierRigidBodySet, &'static mut RapierContextColliders)>;

/// Disables bodies and colliders with invalid values. Runs right before rapier's step.
pub(super) fn isolate(
    mut commands: Commands,
    mut contexts: Contexts,
    mut running: ResMut<Running>,
    names: Query<NameOrEntity>,
) {
    let running = running.as_mut();
    running.bodies.clear();
    running.colliders.clear();
    for (context, mut bodies, mut colliders) in &mut contexts {
        let mut unsound = Vec::new();
        for (handle, body) in bodies.bodies.iter().filter(|(_, body)| body.is_enabled()) {
            if is_sound_body(body) {
                running.bodies.push((context, handle));
            } else {
                unsound.push(handle);
            }
        }
        for handle in unsound {
            take_body(handle, &mut bodies, &mut colliders, &names, &mut commands);
        }
        let mut unsound = Vec::new();
        for (handle, collider) in colliders.colliders.iter().filter(|(_, collider)| collider.is_enabled()) {
            if let Some(parent) = collider.parent()
                && let Some(body) = bodies.bodies.get(parent)
                && !body.is_enabled()
            {
                // Rapier disables the colliders of a body at the moment when the body is disabled. Colliders that are added or enabled later have to be
                // disabled here.
                let body = &mut bodies.bodies[parent];
                body.set_enabled(true);
                body.set_enabled(false);
            }
            if is_sound_collider(collider) {
                running.colliders.push((context, handle));
            }
            if !is_sound_pose(collider.position()) || !is_sound_collider(collider) {
                unsound.push(handle);
            }
        }
        for handle in unsound {
            let collider = &colliders.colliders[handle];
            let parent = collider.parent().and_then(|parent| bodies.bodies.get(parent));
            match (parent, collider.position_wrt_parent()) {
                // The local pose is valid, but the body's pose was invalid when the collider was made, or is invalid and the body is disabled.
                (Some(body), Some(local)) if is_sound_pose(local) => {
                    let pose = body.position() * local;
                    let pose = if is_sound_pose(&pose) { pose } else { Pose3::IDENTITY };
                    colliders.colliders[handle].set_position(pose);
                }
                _ => take_collider(handle, &mut colliders, &names, &mut commands),
            }
        }
    }
}

/// Disables bodies whose values have become invalid, and reports bodies and colliders that rapier has disabled. Runs right after rapier's step.
pub(super) fn isolate_results(
    mut commands: Commands,
    mut contexts: Contexts,
    mut running: ResMut<Running>,
    names: Query<NameOrEntity>,
) {
    let Running { bodies, colliders } = running.as_mut();
    for (context, handle) in bodies.drain(..) {
        let Ok((_, mut bodies, mut colliders)) = contexts.get_mut(context) else { continue };
        if bodies.bodies.get(handle).is_some_and(|body| !(body.is_enabled() && is_sound_body(body))) {
            take_body(handle, &mut bodies, &mut colliders, &names, &mut commands);
        }
    }
    for (context, handle) in colliders.drain(..) {
        let Ok((_, bodies, mut colliders)) = contexts.get_mut(context) else { continue };
        let Some(collider) = colliders.colliders.get(handle).filter(|collider| !collider.is_enabled()) else {
            continue;
        };
        if collider.parent().and_then(|parent| bodies.bodies.get(parent)).is_none_or(RapierBody::is_enabled) {
            take_collider(handle, &mut colliders, &names, &mut commands);
        }
    }
}

fn take_body(
    handle: RigidBodyHandle,
    bodies: &mut RapierRigidBodySet,
    colliders: &mut RapierContextColliders,
    names: &Query<NameOrEntity>,
    commands: &mut Commands,
) {
    let entity = bodies.rigid_body_entity(handle);
    put_away(&mut bodies.bodies[handle], colliders);
    let Some(name) = entity.and_then(|entity| names.get(entity).ok()) else { return };
    warn!(
        "{name}: its transform, velocity, mass or a force on it is not finite, too large or sheared, so its body is disabled; \
         set finite values of at most {MAX_MAGNITUDE:e} to enable it again"
    );
    commands.entity(name.entity).try_insert((QuarantinedBody, RigidBodyDisabled));
}

fn take_collider(
    handle: ColliderHandle,
    colliders: &mut RapierContextColliders,
    names: &Query<NameOrEntity>,
    commands: &mut Commands,
) {
    let entity = colliders.collider_entity(handle);
    let collider = &mut colliders.colliders[handle];
    if !is_sound_collider(collider) {
        collider.set_position_wrt_parent(Pose3::IDENTITY);
        collider.set_position(Pose3::IDENTITY);
    }
    collider.set_enabled(false);
    let Some(name) = entity.and_then(|entity| names.get(entity).ok()) else { return };
    warn!(
        "{name}: its transform or size is not finite, too large or sheared, so its collider is disabled; set finite values \
         of at most {MAX_MAGNITUDE:e} to enable it again"
    );
    commands.entity(name.entity).try_insert((QuarantinedCollider, ColliderDisabled));
}

/// Disables a body and gives it harmless values until it is enabled again.
fn put_away(body: &mut RapierBody, colliders: &mut RapierContextColliders) {
    body.set_position(Pose3::IDENTITY, false);
    // A body that becomes fixed loses its velocity. This is the only way to reset the velocity of a body of any type.
    let kind = body.body_type();
    for kind in [RigidBodyType::Dynamic, RigidBodyType::Fixed, kind] {
        body.set_body_type(kind, false);
    }
    body.reset_forces(false);
    body.reset_torques(false);
    body.set_enabled(false);
    for &handle in body.colliders() {
        // A collider that was just created still has a pose from the old pose of the body.
        if let Some(collider) = colliders.colliders.get_mut(handle)
            && let Some(&local) = collider.position_wrt_parent()
        {
            collider.set_position(local);
        }
    }
}

/// Selects entities with new values, or with a body that is enabled.
type MayBeCorrected = Or<(
    Changed<GlobalTransform>,
    Changed<Velocity>,
    Changed<ExternalForce>,
    Changed<GravityScale>,
    Changed<Damping>,
    Changed<AdditionalMassProperties>,
    Changed<Collider>,
    Without<RigidBodyDisabled>,
)>;

/// Enables quarantined bodies and colliders again after the user has set valid values.
pub(super) fn release(
    mut commands: Commands,
    mut contexts: Query<(&mut RapierRigidBodySet, &mut RapierContextColliders)>,
    changed: Query<
        (
            Entity,
            Has<QuarantinedBody>,
            Has<QuarantinedCollider>,
            &RapierContextEntityLink,
            &GlobalTransform,
            Option<&RapierRigidBodyHandle>,
            Option<&RapierColliderHandle>,
            Option<&Velocity>,
            Option<&ExternalForce>,
        ),
        (Or<(With<QuarantinedBody>, With<QuarantinedCollider>)>, MayBeCorrected),
    >,
    disabled: Query<(), With<ColliderDisabled>>,
) {
    for (entity, body_is_out, collider_is_out, link, transform, body, collider, velocity, force) in &changed {
        let Ok((mut bodies, mut colliders)) = contexts.get_mut(link.0) else { continue };
        let values = Values::new(transform, velocity, force);
        let sound = values.are_sound();
        if collider_is_out
            && sound
            && enable_collider(collider.and_then(|handle| colliders.colliders.get_mut(handle.0)), values.pose)
        {
            commands.entity(entity).try_remove::<(QuarantinedCollider, ColliderDisabled)>();
        }
        if !body_is_out {
            continue;
        }
        if let Some(body) = body.and_then(|handle| bodies.bodies.get_mut(handle.0)) {
            if sound {
                values.enable_body(body);
            }
            if !sound || !is_sound_body(body) {
                // The user may have enabled the body without correcting its values.
                if body.is_enabled() {
                    put_away(body, &mut colliders);
                    commands.entity(entity).try_insert(RigidBodyDisabled);
                }
                continue;
            }
            enable_colliders_of(body, &mut colliders, &disabled);
        }
        commands.entity(entity).try_remove::<(QuarantinedBody, RigidBodyDisabled)>();
    }
}

/// Pose, velocity and force that the user has set for a quarantined entity.
struct Values {
    pose: Pose3,
    velocity: Velocity,
    force: ExternalForce,
}

impl Values {
    fn new(transform: &GlobalTransform, velocity: Option<&Velocity>, force: Option<&ExternalForce>) -> Self {
        let (_, rotation, translation) = transform.to_scale_rotation_translation();
        Self {
            pose: Pose3::from_parts(translation, rotation),
            velocity: velocity.copied().unwrap_or_default(),
            force: force.copied().unwrap_or_default(),
        }
    }

    fn are_sound(&self) -> bool {
        is_sound_pose(&self.pose)
            && is_bounded(self.velocity.linear)
            && is_bounded(self.velocity.angular)
            && self.force.force.is_finite()
            && self.force.torque.is_finite()
    }

    /// Enables a body with these values.
    fn enable_body(&self, body: &mut RapierBody) {
        body.set_position(self.pose, true);
        body.set_linvel(self.velocity.linear, true);
        body.set_angvel(self.velocity.angular, true);
        body.reset_forces(true);
        body.reset_torques(true);
        body.add_force(self.force.force, true);
        body.add_torque(self.force.torque, true);
        body.set_enabled(true);
    }
}

/// Enables a collider, if rapier has it, at a pose. Returns false and leaves it disabled if its shape is not finite.
fn enable_collider(collider: Option<&mut RapierCollider>, pose: Pose3) -> bool {
    let Some(collider) = collider else { return true };
    let aabb = collider.shape().compute_local_aabb();
    let sound = aabb.mins.is_finite() && aabb.maxs.is_finite();
    if sound {
        collider.set_position(pose);
        collider.set_enabled(true);
    }
    sound
}

/// Enables the colliders of a body that the user has not disabled. Rapier may have disabled single colliders that had invalid poses.
fn enable_colliders_of(
    body: &RapierBody,
    colliders: &mut RapierContextColliders,
    disabled: &Query<(), With<ColliderDisabled>>,
) {
    for &handle in body.colliders() {
        if !colliders.collider_entity(handle).is_some_and(|entity| disabled.contains(entity))
            && let Some(collider) = colliders.colliders.get_mut(handle)
        {
            collider.set_enabled(true);
        }
    }
}
