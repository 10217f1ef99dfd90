//! Bodies and colliders in hierarchies. An even number of mirrored axes is a rotation, but bevy_rapier multiplies rotations and scales of a hierarchy
//! separately, which gives other rotations and positions if a scale is negative. It also writes other positions to bodies below a turned parent.

use std::iter::once;

use bevy::{math::Affine3A, prelude::*};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierRigidBodySet, SimulationToRenderTime},
    prelude::{
        RapierColliderHandle, RapierConfiguration, RapierRigidBodyHandle, RigidBody, RigidBodyDisabled, TimestepMode,
        TransformInterpolation,
    },
};

use super::attach::Attached;
use crate::{
    geometry::Pose3,
    plugin::{MedialMesh, is_sound_pose},
};

/// Returns the same transform with a scale that is positive, or negative along x only, as in Bevy's decomposition. `None` if it has such a scale already.
fn straightened(transform: &Transform) -> Option<Transform> {
    let Transform { translation, rotation, scale } = *transform;
    // The product of the factors could underflow.
    let is_mirrored = scale.signum().element_product() < 0.0;
    let signs = Vec3::new(if is_mirrored { -1.0 } else { 1.0 }, 1.0, 1.0);
    let turn = Mat3::from_diagonal(scale.signum() * signs);
    let is_turned = scale.is_finite() && scale.min_element() < 0.0 && turn != Mat3::IDENTITY;
    is_turned.then(|| Transform {
        translation,
        rotation: rotation * Quat::from_mat3(&turn),
        scale: scale.abs() * signs,
    })
}

/// Turns negative scales of bodies with medial meshes into rotations, because rapier writes the rotation of the body's pose beside the scale.
pub(super) fn straighten(
    mut bodies: Query<(Entity, &mut Transform), With<RigidBody>>,
    meshes: Query<(), With<MedialMesh>>,
    children: Query<&Children>,
) {
    for (body, mut transform) in &mut bodies {
        if let Some(straight) = straightened(&transform)
            && has_mesh(body, &meshes, &children)
        {
            *transform = straight;
        }
    }
}

/// Returns true if an entity or one of its descendants has a medial mesh.
fn has_mesh(entity: Entity, meshes: &Query<(), With<MedialMesh>>, children: &Query<&Children>) -> bool {
    meshes.contains(entity) || children.iter_descendants(entity).any(|child| meshes.contains(child))
}

/// Corrects the poses of colliders in the frames of their bodies if a scale between them is negative.
pub(super) fn place_colliders(
    shapes: Query<(Entity, &RapierColliderHandle, &RapierContextEntityLink), (With<Attached>, With<ChildOf>)>,
    parents: Query<&ChildOf>,
    hierarchy: TransformHelper,
    transforms: Query<&Transform>,
    mut contexts: Query<(&RapierRigidBodySet, &mut RapierContextColliders)>,
) {
    let of = |entity| transforms.get(entity).ok();
    for (shape, handle, link) in &shapes {
        let chain = || once(shape).chain(parents.iter_ancestors(shape));
        if !chain().filter_map(of).any(|transform| transform.scale.min_element() < 0.0) {
            continue;
        }
        let Ok((bodies, mut colliders)) = contexts.get_mut(link.0) else { continue };
        let Some(collider) = colliders.colliders.get(handle.0) else { continue };
        let Some((parent, frame)) =
            collider.parent().and_then(|parent| Some((parent, bodies.bodies.get(parent)?.position())))
        else {
            continue;
        };
        let Some(body) = bodies.rigid_body_entity(parent).filter(|body| *body != shape) else { continue };
        let Ok(place) = hierarchy.compute_global_transform(body) else { continue };
        let below = chain().take_while(|entity| *entity != body).filter_map(of);
        let local = below.fold(Affine3A::IDENTITY, |local, transform| transform.compute_affine() * local);
        let (_, rotation, translation) = (Affine3A::from_scale(place.scale()) * local).to_scale_rotation_translation();
        let pose = Pose3::from_parts(translation, rotation.normalize());
        let is_known = collider.position_wrt_parent().is_some_and(|known| *known == pose);
        if let Some(collider) = colliders.colliders.get_mut(handle.0).filter(|_| !is_known && is_sound_pose(&pose)) {
            collider.set_position_wrt_parent(pose);
            collider.set_position(*frame * pose);
        }
    }
}

/// The transform that rapier has written to a body below a turned or mirrored parent, the correct one, and that of the parent.
#[derive(Component)]
pub(super) struct Corrected {
    written: Transform,
    shown: Transform,
    parent: GlobalTransform,
}

/// Returns the global transform of an entity in the order of Bevy's propagation, so that it has the same bits. `None` if an ancestor has no transform.
fn propagated(entity: Entity, parents: &Query<&ChildOf>, transforms: &Query<&Transform>) -> Option<GlobalTransform> {
    let chain: Vec<Entity> = once(entity).chain(parents.iter_ancestors(entity)).collect();
    let mut from_root = chain.into_iter().rev().map(|entity| transforms.get(entity).ok().copied());
    let root = GlobalTransform::from(from_root.next()??);
    from_root.try_fold(root, |above, transform| Some(above.mul_transform(transform?)))
}

/// Restores the transform that rapier has written, because rapier would take the correct one for a change by the user. After such a change the transform
/// stays as it is.
pub(super) fn restore(
    mut commands: Commands,
    bodies: Query<
        (Entity, &Transform, &ChildOf, &Corrected, &RapierContextEntityLink),
        (With<RigidBody>, Without<RigidBodyDisabled>),
    >,
    configurations: Query<&RapierConfiguration>,
    parents: Query<&ChildOf>,
    transforms: Query<&Transform>,
) {
    for (body, transform, child_of, known, link) in &bodies {
        let is_active = configurations.get(link.0).is_ok_and(|configuration| configuration.physics_pipeline_active);
        if is_active
            && *transform == known.shown
            && propagated(child_of.parent(), &parents, &transforms) == Some(known.parent)
        {
            commands.entity(body).try_insert(known.written);
        }
    }
}

/// Corrects the transform that rapier has written to a body below a turned or mirrored parent.
pub(super) fn correct(
    mut commands: Commands,
    bodies: Query<
        (
            Entity,
            &Transform,
            &ChildOf,
            &RapierRigidBodyHandle,
            &RapierContextEntityLink,
            Option<&TransformInterpolation>,
            Has<RigidBodyDisabled>,
        ),
        With<RigidBody>,
    >,
    contexts: Query<(&RapierRigidBodySet, &RapierConfiguration, &SimulationToRenderTime)>,
    mode: Res<TimestepMode>,
    places: Query<&GlobalTransform>,
    meshes: Query<(), With<MedialMesh>>,
    children: Query<&Children>,
) {
    for (body, transform, child_of, handle, link, interpolation, is_disabled) in &bodies {
        let parent = places.get(child_of.parent()).ok().filter(|parent| is_turned(parent));
        let (Some(parent), Ok((rapier, configuration, time))) = (parent, contexts.get(link.0)) else { continue };
        if is_disabled || !configuration.physics_pipeline_active {
            // Rapier takes the correct transform for a change by the user, so there is nothing to restore.
            commands.entity(body).try_remove::<Corrected>();
            continue;
        }
        let Some(rigid) = rapier.bodies.get(handle.0).filter(|_| has_mesh(body, &meshes, &children)) else { continue };
        let between = match *mode {
            TimestepMode::Interpolated { dt, .. } => {
                interpolation.and_then(|interpolation| interpolation.lerp_slerp((dt + time.diff) / dt))
            }
            _ => None,
        };
        let shown = below(parent, &between.unwrap_or(*rigid.position()), transform.scale);
        commands.entity(body).try_insert((shown, Corrected { written: *transform, shown, parent: *parent }));
    }
}

/// Returns true for a parent that does not only move and stretch its children along the axes.
fn is_turned(parent: &GlobalTransform) -> bool {
    let matrix = Mat3::from(parent.affine().matrix3);
    let diagonal = Vec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z);
    diagonal.min_element() <= 0.0 || matrix != Mat3::from_diagonal(diagonal)
}

/// The local transform of a body with this pose below a parent with a uniform scale. Below a sheared parent the rotation is approximate.
fn below(parent: &GlobalTransform, pose: &Pose3, scale: Vec3) -> Transform {
    let inverse = parent.affine().inverse();
    let (inverse_scale, turn, _) = inverse.to_scale_rotation_translation();
    let [x, y, z, w] = pose.rotation.to_array();
    // The decomposition mirrors along x, before the rotation.
    let rotation = if inverse_scale.x < 0.0 { Quat::from_xyzw(x, -y, -z, w) } else { pose.rotation };
    let translation = inverse.transform_point3(pose.translation);
    Transform { translation, rotation: (turn * rotation).normalize(), scale }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_transform_maps_points_to_the_same_places() {
        let mut turned = 0;
        for signs in 0..8 {
            let scale =
                Vec3::new(1.0, 2.0, 3.0) * Vec3::from_array([0, 1, 2].map(|k| 1.0 - 2.0 * f32::from(signs >> k & 1u8)));
            let rotation = Quat::from_euler(EulerRot::XYZ, 0.3, -0.7, 1.1);
            let transform = Transform { translation: Vec3::new(1.0, 2.0, 3.0), rotation, scale };
            let Some(straight) = straightened(&transform) else {
                assert!(signs <= 1, "{scale}");
                continue;
            };
            turned += 1;
            assert!(straight.scale.y > 0.0 && straight.scale.z > 0.0 && straightened(&straight).is_none());
            for point in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z] {
                let [a, b] = [transform, straight].map(|transform| transform.transform_point(point));
                assert!(a.distance(b) < 1e-5, "{scale}: {a} {b}");
            }
        }
        assert_eq!(turned, 6);
    }
}
