//! Rapier's worlds and their colliders, as the systems around rapier's step read them.

use std::sync::Arc;

use bevy::{ecs::query::QueryData, prelude::*};
use bevy_rapier3d::{
    plugin::context::{
        RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierRigidBodySet,
        SimulationToRenderTime,
    },
    prelude::RapierConfiguration,
    rapier::{
        dynamics::RigidBody as RapierBody,
        geometry::{Collider as RapierCollider, ColliderHandle},
    },
};

use super::shape::MedialShape;
use crate::{
    geometry::Pose3,
    pipeline::{ContactMargin, Deforming, Displacement},
    plugin::BodyInfo,
};

impl BodyInfo {
    /// Returns the handle of its collider.
    pub fn collider(&self) -> ColliderHandle {
        let (index, generation) = self.collider;
        ColliderHandle::from_raw_parts(index, generation)
    }
}

/// A rapier context: a world. Bodies of different worlds do not collide.
#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct Context {
    pub entity: Entity,
    pub bodies: &'static mut RapierRigidBodySet,
    pub colliders: &'static RapierContextColliders,
    pub joints: &'static RapierContextJoints,
    pub simulation: &'static RapierContextSimulation,
    pub configuration: &'static RapierConfiguration,
    pub lead: &'static SimulationToRenderTime,
}

impl ContextReadOnlyItem<'_, '_> {
    pub fn reach(&self) -> ContactMargin {
        let parameters = &self.simulation.integration_parameters;
        ContactMargin::new(parameters.prediction_distance(), parameters.length_unit)
    }

    /// Returns true if the world has a medial collider.
    pub fn is_medial(&self) -> bool {
        self.colliders.colliders.iter().any(|(_, collider)| medial(collider).is_some())
    }

    /// Returns the colliders of bodies that are awake and not fixed, with their bodies.
    pub fn awake(&self) -> impl Iterator<Item = (ColliderHandle, &RapierCollider, &RapierBody)> {
        let awake = self.bodies.bodies.iter().filter(|(_, body)| !body.is_fixed() && !body.is_sleeping());
        let colliders = awake.flat_map(|(_, body)| body.colliders().iter().map(move |handle| (*handle, body)));
        colliders.filter_map(|(handle, body)| Some((handle, self.colliders.colliders.get(handle)?, body)))
    }

    pub fn body(&self, collider: &RapierCollider) -> Option<&RapierBody> {
        self.bodies.bodies.get(collider.parent()?)
    }
}

/// Returns the pose of a collider in the world, from the pose of its body. After a change by the user, the body's pose is newer than that of the collider.
pub(super) fn collider_pose(collider: &RapierCollider, body: Option<&RapierBody>) -> Pose3 {
    rigid(match (body, collider.position_wrt_parent()) {
        (Some(body), Some(local)) => body.position() * local,
        _ => *collider.position(),
    })
}

/// Returns the pose with a normalized rotation. Sheared transform hierarchies give rotations that are not normalized. Normalized poses keep their bits.
pub(super) fn rigid(pose: Pose3) -> Pose3 {
    let length = pose.rotation.length();
    if pose.rotation.is_normalized() || length == 0.0 {
        return pose;
    }
    Pose3::from_parts(pose.translation, pose.rotation / length)
}

/// Returns the motion of a skinned shape.
pub(super) fn skin(collider: &RapierCollider) -> Option<&Arc<Deforming>> {
    medial(collider)?.skin.as_ref()
}

fn medial(collider: &RapierCollider) -> Option<&MedialShape> {
    collider.shape().as_shape::<MedialShape>()
}

/// Returns the displacement of a collider in `dt` seconds at the velocity of its body. `gravity`: in metres per second squared.
pub(super) fn displacement(collider: &RapierCollider, body: &RapierBody, gravity: Vec3, dt: f32) -> Displacement {
    let fall = if body.is_dynamic() { gravity.length() * body.gravity_scale().abs() * dt * dt } else { 0.0 };
    let radius = collider.shape().compute_local_bounding_sphere().radius;
    Displacement { translation: body.linvel() * dt, rotation: body.angvel() * dt, radius, fall }
}
