//! Ragdolls: the joints of a character become bodies.

use bevy::prelude::*;
use bevy_rapier3d::prelude::{
    CollisionGroups, Group, ImpulseJoint, JointAxis, RigidBody, SphericalJointBuilder, Velocity,
};

use crate::{
    geometry::{Pose3, Primitive, Sphere},
    medial_axis::MedialAxis,
    plugin::{MedialMesh, MedialStep, SkinPose, SkinnedMedialMesh, is_sound_pose},
};

/// A command that turns a character with a [`SkinnedMedialMesh`] into a ragdoll, at its current pose and velocities.
///
/// ```no_run
/// # use bevy::prelude::*;
/// # use bevy_medial::{prelude::*, rapier::MedialRagdoll};
/// fn die(mut commands: Commands, character: Single<Entity, With<SkinnedMedialMesh>>) {
///     commands.entity(*character).queue(MedialRagdoll::default());
/// }
/// ```
///
/// Each joint entity that moves a primitive gets a dynamic `RigidBody` and a `MedialMesh`: the primitives that it moves most, with their spheres. Mass and
/// inertia follow from them. A spherical joint links the body to that of the nearest ancestor with one. The skinned mesh follows the bodies, because they are
/// its joints. The command removes the `SkinnedMedialMesh`, and makes the joints children of its entity. The app has to stop the animation.
///
/// Bodies of all ragdolls are in [`groups`](Self::groups). The command has no effect, except a warning, on an entity without a [`SkinPose`], below one of its
/// own joints, or whose joints are mirrored or have no size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MedialRagdoll {
    /// Largest angle of a joint about each of its axes from the pose at the start, in radians. Default: 0.8.
    pub limit: f32,
    /// Collision groups of the bodies. Default: group 32, without collisions within the group, because neighbours overlap at the joints.
    pub groups: CollisionGroups,
}

impl Default for MedialRagdoll {
    fn default() -> Self {
        Self { limit: 0.8, groups: CollisionGroups::new(Group::GROUP_32, !Group::GROUP_32) }
    }
}

/// A joint that becomes a body.
struct Limb {
    entity: Entity,
    pose: Pose3,
    shape: MedialAxis,
    velocity: Velocity,
}

impl EntityCommand for MedialRagdoll {
    type Out = ();

    fn apply(self, mut entity: EntityWorldMut) {
        let name = entity.get::<Name>().map_or_else(|| entity.id().to_string(), Name::to_string);
        let Some(pose) = entity.take::<SkinPose>() else {
            warn!(
                "{name}: it has no SkinPose, so it does not become a ragdoll; add a SkinnedMedialMesh, and wait for its first step"
            );
            return;
        };
        let root = entity.id();
        let is_released = entity.world_scope(|world| {
            let dt = world.resource::<MedialStep>().dt;
            let shares = pose.axis().primitives_of_joints();
            let limbs: Vec<Limb> =
                shares.iter().enumerate().filter_map(|(joint, own)| limb(world, &pose, joint, own, dt)).collect();
            let above = |entity: &Entity| world.get::<ChildOf>(*entity).map(ChildOf::parent);
            let is_below_limb =
                std::iter::successors(above(&root), above).any(|above| limbs.iter().any(|limb| limb.entity == above));
            if limbs.is_empty() || is_below_limb {
                return false;
            }
            let links: Vec<Option<ImpulseJoint>> = limbs.iter().map(|limb| self.link(world, limb, &limbs)).collect();
            std::iter::zip(&limbs, links).for_each(|(limb, link)| self.release(world, root, limb, link));
            true
        });
        if is_released {
            entity.remove::<SkinnedMedialMesh>();
        } else {
            warn!(
                "{name}: it does not become a ragdoll; put its SkinnedMedialMesh above all joints, and give them a positive scale"
            );
            entity.insert(pose);
        }
    }
}

impl MedialRagdoll {
    /// Returns the joint of a limb with its nearest ancestor among the limbs.
    fn link(&self, world: &World, limb: &Limb, limbs: &[Limb]) -> Option<ImpulseJoint> {
        let above = |entity: &Entity| world.get::<ChildOf>(*entity).map(ChildOf::parent);
        let mut ancestors = std::iter::successors(above(&limb.entity), above);
        let parent = ancestors.find_map(|ancestor| limbs.iter().find(|other| other.entity == ancestor))?;
        let local = parent.pose.inv_mul(&limb.pose);
        let axes = [JointAxis::AngX, JointAxis::AngY, JointAxis::AngZ];
        let joint = SphericalJointBuilder::new().local_anchor1(local.translation).local_anchor2(Vec3::ZERO);
        let limited = axes.into_iter().fold(joint, |joint, axis| joint.limits(axis, [-self.limit, self.limit]));
        let mut joint = limited.build();
        joint.set_contacts_enabled(false);
        joint.data.set_local_basis1(local.rotation);
        Some(ImpulseJoint::new(parent.entity, joint))
    }

    /// Inserts the body of a limb, as a child of `root` at its place in the world. A body below another body would be moved with it.
    fn release(&self, world: &mut World, root: Entity, limb: &Limb, link: Option<ImpulseJoint>) {
        let mesh = MedialMesh(world.resource_mut::<Assets<MedialAxis>>().add(limb.shape.clone()));
        let above = world.get::<GlobalTransform>(root).copied().unwrap_or_default();
        let Ok(mut entity) = world.get_entity_mut(limb.entity) else { return };
        if let Some(place) = entity.get::<GlobalTransform>() {
            let local = place.reparented_to(&above);
            entity.insert(local);
        }
        if entity.id() != root {
            entity.insert(ChildOf(root));
        }
        entity.insert((RigidBody::Dynamic, mesh, limb.velocity, self.groups));
        if let Some(link) = link {
            entity.insert(link);
        }
    }
}

/// Returns the limb of a joint; `None` for a joint without primitives or without a usable transform. `own`: the primitives of the joint.
fn limb(world: &World, pose: &SkinPose, joint: usize, own: &[Primitive], dt: f32) -> Option<Limb> {
    let entity = pose.joints()[joint];
    let (scale, rotation, translation) = world.get::<GlobalTransform>(entity)?.to_scale_rotation_translation();
    let place = Pose3::from_parts(translation, rotation);
    // The spheres are those of the last update.
    let to_joint = pose.place_of(joint)?.inverse();
    let local = |(number, sphere): (usize, &Sphere)| {
        let center = to_joint.transform_point3(pose.frame().transform_point(sphere.center));
        Sphere::new(center, pose.unbent_radius(joint, number) / scale.x)
    };
    if own.is_empty() || !(scale.x > 0.0 && to_joint.is_finite()) {
        return None;
    }
    let spheres: Vec<Sphere> = pose.shape().axis().spheres().iter().enumerate().map(local).collect();
    let shape = MedialAxis::part_of(&spheres, own).ok()?;
    let center = place.transform_point(shape.mass().center_of_mass * scale.x);
    let [displacement, turn] = pose.moved_with(joint, center);
    let rate = if dt > 0.0 { 1.0 / dt } else { 0.0 };
    let velocity = Velocity { linear: displacement * rate, angular: turn * rate };
    is_sound_pose(&place).then_some(Limb { entity, pose: place, shape, velocity })
}
