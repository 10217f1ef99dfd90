use bevy::prelude::*;
use bevy_rapier3d::prelude::RigidBody;

use crate::{builder::NodeBody, plugin::SceneBody};

/// Inserts the rigid body of a node in a scene, unless it has one.
pub(super) fn insert_body(added: On<Add, SceneBody>, bodies: Query<&SceneBody>, mut commands: Commands) {
    let body = match bodies.get(added.entity).map(|body| body.0) {
        Ok(NodeBody::Dynamic) => RigidBody::Dynamic,
        Ok(NodeBody::Fixed) => RigidBody::Fixed,
        Ok(NodeBody::Kinematic) => RigidBody::KinematicPositionBased,
        Ok(NodeBody::Part | NodeBody::NoShape) | Err(_) => return,
    };
    commands.entity(added.entity).insert_if_new(body);
}
