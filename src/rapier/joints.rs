//! What joints mean for the step: which bodies do not collide, and which stop together.

use bevy::platform::collections::HashMap;
use bevy_rapier3d::{
    plugin::context::RapierContextJoints,
    rapier::dynamics::{RigidBodyHandle, RigidBodySet},
};

use crate::disjoint_sets::DisjointSets;

/// Pairs of bodies that a joint keeps from colliding.
pub(super) fn kept_apart(joints: &RapierContextJoints) -> Vec<[RigidBodyHandle; 2]> {
    let impulse = joints.impulse_joints.iter().filter(|(_, joint)| !joint.data.contacts_enabled);
    let mut pairs: Vec<_> = impulse.map(|(_, joint)| [joint.body1(), joint.body2()]).collect();
    for (_, _, multibody, link) in joints.multibody_joints.iter() {
        let body = link.rigid_body_handle();
        if !multibody.self_contacts_enabled() {
            pairs.extend(multibody.links().map(|other| [body, other.rigid_body_handle()]));
        } else if !link.joint.data.contacts_enabled {
            let parent = link.parent_id().and_then(|parent| multibody.link(parent));
            pairs.extend(parent.map(|parent| [body, parent.rigid_body_handle()]));
        }
    }
    pairs
}

/// For each dynamic body on an enabled impulse joint one that stands for all that are joined with it, directly or by others.
///
/// If one of them stopped by itself, the joints would be torn, and the solver would make up for it with a jerk.
pub(super) fn assemblies(
    joints: &RapierContextJoints,
    bodies: &RigidBodySet,
) -> HashMap<RigidBodyHandle, RigidBodyHandle> {
    // Rapier solves no joint of a disabled body.
    let is_solved =
        |body: &RigidBodyHandle| bodies.get(*body).is_some_and(|body| body.is_dynamic() && body.is_enabled());
    let enabled = joints.impulse_joints.iter().filter(|(_, joint)| joint.data.is_enabled());
    let pairs = enabled.map(|(_, joint)| [joint.body1(), joint.body2()]);
    let pairs: Vec<_> = pairs.filter(|pair| pair.iter().all(is_solved)).collect();
    // Of a body that is there several times one place stands for all.
    let joined = pairs.as_flattened();
    let numbers: HashMap<RigidBodyHandle, u32> = joined.iter().copied().zip(0..).collect();
    let mut sets = DisjointSets::new(joined.len());
    for pair in &pairs {
        let [a, b] = pair.map(|body| numbers[&body]);
        sets.join(a, b);
    }
    numbers.iter().map(|(&body, &number)| (body, joined[sets.find(number) as usize])).collect()
}
