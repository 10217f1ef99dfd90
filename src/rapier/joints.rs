//! Effects of joints on the step: pairs of bodies that do not collide, and bodies that stop together.

use bevy::platform::collections::HashMap;
use bevy_rapier3d::{
    plugin::context::RapierContextJoints,
    rapier::dynamics::{RigidBodyHandle, RigidBodySet},
};

use crate::disjoint_sets::DisjointSets;

/// Returns the pairs of bodies whose collisions a joint disables.
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

/// Maps each dynamic body on an enabled impulse joint to a representative of all bodies that are joined with it, directly or through others.
///
/// These bodies stop together. If one of them stopped alone, the joints would be violated and the solver would correct them with a jerk.
pub(super) fn joint_islands(
    joints: &RapierContextJoints,
    bodies: &RigidBodySet,
) -> HashMap<RigidBodyHandle, RigidBodyHandle> {
    // Rapier solves no joint of a disabled body.
    let is_solved =
        |body: &RigidBodyHandle| bodies.get(*body).is_some_and(|body| body.is_dynamic() && body.is_enabled());
    let enabled = joints.impulse_joints.iter().filter(|(_, joint)| joint.data.is_enabled());
    let pairs = enabled.map(|(_, joint)| [joint.body1(), joint.body2()]);
    let pairs: Vec<_> = pairs.filter(|pair| pair.iter().all(is_solved)).collect();
    // A body on several joints is in the list several times. The map keeps one index per body.
    let joined = pairs.as_flattened();
    let numbers: HashMap<RigidBodyHandle, u32> = joined.iter().copied().zip(0..).collect();
    let mut sets = DisjointSets::new(joined.len());
    for pair in &pairs {
        let [a, b] = pair.map(|body| numbers[&body]);
        sets.join(a, b);
    }
    numbers.iter().map(|(&body, &number)| (body, joined[sets.find(number) as usize])).collect()
}
