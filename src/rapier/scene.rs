use bevy::prelude::*;
use bevy_rapier3d::prelude::RigidBody;

use crate::builder::NodeBody;

/// Inserts the body of a node in a scene, unless it has one.
pub(crate) fn insert_body(entity: &mut EntityCommands, body: NodeBody) {
    let body = match body {
        NodeBody::Dynamic => RigidBody::Dynamic,
        NodeBody::Fixed => RigidBody::Fixed,
        NodeBody::Kinematic => RigidBody::KinematicPositionBased,
        NodeBody::Part | NodeBody::NoShape => return,
    };
    entity.insert_if_new(body);
}
