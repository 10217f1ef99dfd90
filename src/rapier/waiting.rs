//! Dynamic bodies that wait for their shapes: they stand still, and get their impulses with the shape.
//!
//! Rapier would move such a body at its velocity, without collisions. It would drop an impulse, because a body without a collider has no mass.

use std::iter::once;

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierRigidBodySet},
    prelude::{Collider, ExternalImpulse, RapierRigidBodyHandle, RigidBody, RigidBodyDisabled},
};

use crate::plugin::MedialMesh;

/// Marks a body that has no collider yet, but a medial mesh on the body or on a child. Value: the impulses that it has been given.
#[derive(Component, Default)]
pub(super) struct Waiting(ExternalImpulse);

/// Selects shapes without a collider.
type Unloaded = (With<MedialMesh>, Without<Collider>);

/// Finds new bodies that wait.
pub(super) fn find(
    mut commands: Commands,
    shapes: Query<Entity, Unloaded>,
    colliders: Query<(), With<Collider>>,
    bodies: Query<Has<Waiting>, With<RigidBody>>,
    parents: Query<&ChildOf>,
    children: Query<&Children>,
) {
    for shape in &shapes {
        let body = once(shape).chain(parents.iter_ancestors(shape)).find(|entity| bodies.contains(*entity));
        let Some(body) = body.filter(|body| bodies.get(*body) == Ok(false)) else { continue };
        if !once(body).chain(children.iter_descendants(body)).any(|entity| colliders.contains(entity)) {
            commands.entity(body).try_insert(Waiting::default());
        }
    }
}

/// Takes the impulses of bodies that wait, before rapier does.
pub(super) fn hold_impulses(mut bodies: Query<(&mut Waiting, &mut ExternalImpulse), Changed<ExternalImpulse>>) {
    for (mut waiting, mut impulse) in &mut bodies {
        waiting.0 += *impulse;
        impulse.reset();
    }
}

/// Disables bodies while they wait. Enables them with their impulses when they have got a collider, or when they have lost their shape.
pub(super) fn release(
    mut commands: Commands,
    waiting: Query<(Entity, &Waiting, &RapierRigidBodyHandle, &RapierContextEntityLink, Has<RigidBodyDisabled>)>,
    shapes: Query<(), Unloaded>,
    children: Query<&Children>,
    mut contexts: Query<(&mut RapierRigidBodySet, &RapierContextColliders)>,
) {
    for (entity, Waiting(impulse), handle, link, is_disabled) in &waiting {
        let Ok((mut set, colliders)) = contexts.get_mut(link.0) else { continue };
        let Some(body) = set.bodies.get(handle.0) else { continue };
        let (is_bare, is_running) = (body.colliders().is_empty(), body.is_dynamic() && body.is_enabled());
        let waits =
            is_bare && once(entity).chain(children.iter_descendants(entity)).any(|shape| shapes.contains(shape));
        if waits && !is_running {
            continue;
        }
        // Rapier registers the change of a body that is accessed mutably.
        let body = &mut set.bodies[handle.0];
        if waits {
            body.set_enabled(false);
        } else {
            body.recompute_mass_properties_from_colliders(&colliders.colliders);
            body.apply_impulse(impulse.impulse, true);
            body.apply_torque_impulse(impulse.torque_impulse, true);
            body.set_enabled(!is_disabled);
            commands.entity(entity).try_remove::<Waiting>();
        }
    }
}
