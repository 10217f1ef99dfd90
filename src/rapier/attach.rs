//! Colliders of medial meshes and static boxes: inserted when the shape is loaded, replaced when it changes, and removed with it.

use std::{
    collections::{HashMap, HashSet},
    iter::once,
    sync::{Arc, OnceLock, Weak},
};

use bevy::{asset::LoadState, prelude::*};
use bevy_rapier3d::{
    parry::shape::{Compound, SharedShape},
    plugin::context::{RapierContextColliders, RapierContextEntityLink, RapierContextSimulation, RapierRigidBodySet},
    prelude::{ActiveHooks, Collider, ColliderScale, RapierColliderHandle, RapierRigidBodyHandle, RigidBody},
    rapier::{
        dynamics::{RigidBody as RapierBody, SpringCoefficients},
        geometry::Collider as RapierCollider,
        pipeline::ActiveHooks as RapierHooks,
    },
};

use super::{AnyShape, shape::MedialShape};
use crate::{
    constants::SAME_LENGTH,
    medial_axis::MedialAxis,
    pipeline::Shape,
    plugin::{Detail, MedialLevel, MedialMesh, SkinnedMedialMesh, StaticObb, uniform_scale},
};

/// The shape and scale from which the collider of an entity was made. Present as well if no collider could be made.
#[derive(Component, Clone)]
pub(super) struct Attached {
    asset: AssetId<MedialAxis>,
    /// The medial axis at the level of detail; `None` if it is not loaded.
    axis: Option<MedialAxis>,
    scale: Vec3,
}

impl Attached {
    /// Returns true if the collider was made from the shape. Otherwise the user has inserted it.
    fn has_collider(&self) -> bool {
        self.axis.is_some()
    }

    /// Returns true if asset and content are unchanged. An asset may get new content under the same id.
    fn is_of(&self, asset: AssetId<MedialAxis>, axis: Option<&MedialAxis>) -> bool {
        self.asset == asset && self.axis.as_ref().map(MedialAxis::address) == axis.map(MedialAxis::address)
    }
}

fn is_same_scale(scale: Vec3, wanted: Vec3) -> bool {
    match (scale.is_finite(), wanted.is_finite()) {
        (true, true) => (scale - wanted).abs().max_element() <= SAME_LENGTH * wanted.abs().max_element(),
        (finite, wanted_finite) => finite == wanted_finite,
    }
}

/// Returns the scale of an entity in the world: positive, or negative along x only if an odd number of axes is mirrored.
fn scale_of(entity: Entity, transform: &Transform, is_child: bool, hierarchy: &TransformHelper) -> Vec3 {
    let may_differ = is_child || transform.scale.min_element() < 0.0;
    let global = may_differ.then(|| hierarchy.compute_global_transform(entity).ok());
    global.flatten().map_or(transform.scale, |global| global.scale())
}

/// Inserts a collider on every entity with a loaded [`MedialMesh`], and replaces it when shape, level of detail or scale change.
pub(super) fn attach_shapes(
    mut commands: Commands,
    meshes: Query<
        (NameOrEntity, &MedialMesh, Detail, &Transform, Has<ChildOf>, Option<&Attached>),
        Without<SkinnedMedialMesh>,
    >,
    assets: Res<Assets<MedialAxis>>,
    server: Option<Res<AssetServer>>,
    hierarchy: TransformHelper,
    mut next_key: Local<u64>,
    // Compounds by axis and scale, for as long as a collider uses them.
    mut shared: Local<HashMap<(usize, u32), Weak<OnceLock<Compound>>>>,
) {
    shared.retain(|_, primitives| primitives.strong_count() > 0);
    for (name, mesh, detail, transform, is_child, attached) in &meshes {
        let scale = scale_of(name.entity, transform, is_child, &hierarchy);
        // A scale that differs only by rounding does not change the level of detail either.
        let known = attached.filter(|attached| is_same_scale(attached.scale, scale));
        let scale = known.map_or(scale, |known| known.scale);
        let asset = mesh.0.id();
        let leveled = assets.get(asset).map(|finest| {
            let level = detail.level(finest, scale.x.abs());
            (finest, level, finest.level(level))
        });
        let axis = leveled.map(|(.., axis)| axis);
        if known.is_some_and(|known| known.is_of(asset, axis)) {
            continue;
        }
        let wanted = Attached { asset, axis: axis.cloned(), scale };
        let mut entity = commands.entity(name.entity);
        let Some((finest, level, axis)) = leveled else {
            if let Some(LoadState::Failed(error)) = server.as_ref().and_then(|server| server.get_load_state(&mesh.0)) {
                error!("{name}: its medial mesh did not load, so it collides with nothing: {error}");
                // Keep a collider that the user has inserted as a placeholder.
                if attached.is_some_and(Attached::has_collider) {
                    entity.try_remove::<(Collider, MedialLevel)>();
                }
                entity.try_insert(wanted);
            }
            continue;
        };
        entity.try_insert(wanted);
        let uniform = uniform_scale(scale).filter(|scale| (finest.mass().inertia * scale.powi(5)).is_finite());
        let Some(uniform) = uniform else {
            error!(
                "{name}: a medial mesh cannot be scaled by {scale}, so it collides with nothing; \
                 give it a uniform, moderate Transform::scale, or build a mesh of the wanted proportions"
            );
            entity.try_remove::<(Collider, MedialLevel)>();
            continue;
        };
        *next_key += 1;
        let shape = Shape::scaled(axis, uniform);
        let same = shared.entry((shape.axis.address(), shape.scale.to_bits())).or_default();
        let primitives = same.upgrade().unwrap_or_default();
        *same = Arc::downgrade(&primitives);
        let shape = MedialShape::sharing(shape, *next_key, primitives);
        entity.try_insert((Collider::from(SharedShape::new(shape)), UNSCALED, MedialLevel(level)));
    }
}

/// Scale of medial colliders: the medial shape itself includes the scale.
pub(super) const UNSCALED: ColliderScale = ColliderScale::Absolute(Vec3::ONE);

/// Resets a `ColliderScale` that the user has set on a medial collider, because rapier would replace the medial shape by a compound of other shapes.
pub(super) fn keep_unscaled(
    mut commands: Commands,
    attached: Query<(Entity, Option<&ColliderScale>, &Attached), With<Collider>>,
) {
    for (entity, scale, attached) in &attached {
        if attached.has_collider() && scale != Some(&UNSCALED) {
            commands.entity(entity).try_insert(UNSCALED);
        }
    }
}

/// Removes the collider immediately when its [`MedialMesh`] is removed, so that a collider which the user inserts next is kept. If the entity has a
/// [`StaticObb`], its box collider is inserted again.
pub(super) fn detach_shape(
    removed: On<Remove, MedialMesh>,
    mut commands: Commands,
    shapes: Query<(Option<&Attached>, Has<StaticObb>)>,
) {
    let Ok((attached, has_box)) = shapes.get(removed.entity) else { return };
    let mut entity = commands.entity(removed.entity);
    if attached.is_some_and(Attached::has_collider) {
        entity.try_remove::<(Collider, ColliderScale, MedialLevel)>();
    }
    entity.try_remove::<Attached>();
    if has_box {
        // Fails silently if the entity is despawned.
        entity.queue_silenced(|mut entity: EntityWorldMut| {
            if let Some(mut obb) = entity.get_mut::<StaticObb>() {
                obb.set_changed();
            }
        });
    }
}

/// Marks an entity whose `RigidBody` was inserted for its [`StaticObb`].
#[derive(Component)]
pub(super) struct BodyOfBox;

/// Removes the collider, and the body that was inserted with it, when its [`StaticObb`] is removed.
pub(super) fn detach_box(
    removed: On<Remove, StaticObb>,
    mut commands: Commands,
    boxes: Query<(Option<&RigidBody>, Has<BodyOfBox>), Without<MedialMesh>>,
) {
    let Ok((body, was_given)) = boxes.get(removed.entity) else { return };
    let mut entity = commands.entity(removed.entity);
    entity.try_remove::<(Collider, BodyOfBox)>();
    if was_given && body == Some(&RigidBody::Fixed) {
        entity.try_remove::<RigidBody>();
    }
}

/// Inserts a fixed box collider on every entity with a [`StaticObb`] and without a [`MedialMesh`].
///
/// A mirrored entity gets a `ColliderScale` that undoes the mirroring, because rapier would scale the box to a negative size.
pub(super) fn attach_boxes(
    mut commands: Commands,
    boxes: Query<
        (Entity, Ref<StaticObb>, Has<RigidBody>, Option<&ColliderScale>),
        // Rapier applies a parent's transform to a child in this step, but the child's `GlobalTransform` changes only in the next. So all children are checked.
        (
            Or<(Changed<StaticObb>, Changed<Transform>, Changed<GlobalTransform>, With<ChildOf>)>,
            Without<MedialMesh>,
            Without<SkinnedMedialMesh>,
        ),
    >,
    hierarchy: TransformHelper,
) {
    for (id, obb, has_body, scale) in &boxes {
        let mut entity = commands.entity(id);
        if obb.is_changed() {
            let half = obb.half_extents;
            entity.try_insert(Collider::cuboid(half.x, half.y, half.z));
            if !has_body {
                entity.try_insert((RigidBody::Fixed, BodyOfBox));
            }
        }
        let is_mirrored =
            hierarchy.compute_global_transform(id).is_ok_and(|place| place.affine().matrix3.determinant() < 0.0);
        match scale {
            None | Some(&PLAIN) if is_mirrored => _ = entity.try_insert(MIRRORED),
            // Rapier does not react to the removal of the component, so the scale is replaced.
            Some(&MIRRORED) if !is_mirrored => _ = entity.try_insert(PLAIN),
            _ => {}
        }
    }
}

/// Entities that have lost their parent or their body since the last step. `RemovedComponents` is no alternative, because several frames may pass between two
/// steps and Bevy drops removal events earlier.
#[derive(Resource, Default)]
pub(super) struct Freed(Vec<Entity>);

pub(super) fn note_freed<C: Component>(
    removed: On<Remove, C>,
    physical: Query<(), Or<(With<RigidBody>, With<RapierColliderHandle>, With<Children>)>>,
    shapes: Query<(), AnyShape>,
    mut freed: ResMut<Freed>,
) {
    // Skip other entities with a parent, such as UI nodes. Without shapes nothing empties the list.
    if !shapes.is_empty() && physical.contains(removed.entity) {
        freed.0.push(removed.entity);
    }
}

/// Attaches a collider to its current body, if the shape was moved to another body or the body was added after the collider. Removing the handle makes rapier
/// create the collider again; otherwise rapier keeps it on its old body.
pub(super) fn follow_bodies(
    mut commands: Commands,
    changed: Query<Entity, Or<(Added<RigidBody>, Changed<ChildOf>)>>,
    mut freed: ResMut<Freed>,
    children: Query<&Children>,
    parents: Query<&ChildOf>,
    bodies: Query<Option<&RapierRigidBodyHandle>, With<RigidBody>>,
    shapes: Query<(&RapierColliderHandle, &RapierContextEntityLink), (With<Collider>, AnyShape)>,
    contexts: Query<&RapierContextColliders>,
) {
    for entity in changed.iter().chain(freed.0.drain(..)) {
        for shape in once(entity).chain(children.iter_descendants(entity)) {
            let Ok((handle, link)) = shapes.get(shape) else { continue };
            let Some(collider) = contexts.get(link.0).ok().and_then(|context| context.colliders.get(handle.0)) else {
                continue;
            };
            let body = once(shape).chain(parents.iter_ancestors(shape)).find_map(|entity| bodies.get(entity).ok());
            // A body without a handle is new.
            let is_there = match body {
                Some(body) => body.is_some_and(|body| collider.parent() == Some(body.0)),
                None => collider.parent().is_none(),
            };
            if !is_there {
                commands.entity(shape).try_remove::<RapierColliderHandle>();
            }
        }
    }
}

/// Scale of a mirrored box: Bevy's decomposition of a mirrored transform has the negative sign along x.
const MIRRORED: ColliderScale = ColliderScale::Relative(Vec3::new(-1.0, 1.0, 1.0));
const PLAIN: ColliderScale = ColliderScale::Relative(Vec3::ONE);

/// Marks a body that was spawned asleep, until its first collider exists.
#[derive(Component)]
pub(super) struct SpawnedAsleep;

/// A bit of `ActiveHooks` that enables no hook. Rapier never recycles the contacts of a collider with active hooks.
const NO_RECYCLING: RapierHooks = RapierHooks::from_bits_retain(1 << 31);

/// Excludes medial colliders from rapier's contact recycling, which keeps the contacts of a pair that has hardly moved. A pair that has just stopped at
/// an impact may have hardly moved either, but its new contact must not be missed. Rapier still recycles pairs of its own shapes.
pub(super) fn keep_contacts_fresh(
    changed: Query<
        (&RapierColliderHandle, &RapierContextEntityLink, &Collider),
        Or<(Changed<RapierColliderHandle>, Changed<Collider>, Changed<ActiveHooks>)>,
    >,
    mut contexts: Query<&mut RapierContextColliders>,
) {
    for (handle, link, shape) in &changed {
        if shape.raw.as_shape::<MedialShape>().is_none() {
            continue;
        }
        let Ok(mut colliders) = contexts.get_mut(link.0) else { continue };
        if let Some(collider) = colliders.colliders.get_mut(handle.0) {
            collider.set_active_hooks(collider.active_hooks() | NO_RECYCLING);
        }
    }
}

/// Marks a context that has had a medial shape.
#[derive(Component)]
pub(super) struct Stiff;

/// Makes contacts between moving bodies as stiff as rapier's contacts with fixed bodies, once a context has a medial shape. With rapier's default a contact that
/// carries several bodies is at rest at an overlap that impacts do not allow, so the bodies of a pile would stop in every step. A frequency or damping that is
/// not rapier's default is kept.
pub(super) fn stiffen_contacts(
    mut commands: Commands,
    changed: Query<(&RapierContextEntityLink, &Collider), Or<(Added<RapierColliderHandle>, Changed<Collider>)>>,
    mut contexts: Query<&mut RapierContextSimulation, Without<Stiff>>,
) {
    for (link, _) in changed.iter().filter(|(_, shape)| shape.raw.as_shape::<MedialShape>().is_some()) {
        let Ok(mut simulation) = contexts.get_mut(link.0) else { continue };
        let parameters = &mut simulation.integration_parameters;
        if parameters.contact_softness == SpringCoefficients::contact_defaults() {
            parameters.contact_softness = parameters.static_contact_softness;
        }
        commands.entity(link.0).try_insert(Stiff);
    }
}

/// Wakes bodies that get a new collider. A body without a collider has no mass and falls asleep, and rapier does not wake it when a collider is added. A body
/// that was spawned asleep stays asleep when it gets its first collider.
pub(super) fn wake_attached(
    mut commands: Commands,
    spawned: Query<(Entity, &RapierRigidBodyHandle, &RapierContextEntityLink), Added<RapierRigidBodyHandle>>,
    waiting: Query<(), With<SpawnedAsleep>>,
    attached: Query<
        (&RapierColliderHandle, &RapierContextEntityLink),
        (Or<(Added<RapierColliderHandle>, Changed<Collider>)>, With<MedialMesh>),
    >,
    mut contexts: Query<(&mut RapierRigidBodySet, &RapierContextColliders)>,
) {
    let is_asleep = |(_, handle, link): &(Entity, &RapierRigidBodyHandle, &RapierContextEntityLink)| {
        let body = contexts.get(link.0).ok().and_then(|(bodies, _)| bodies.bodies.get(handle.0));
        body.is_some_and(RapierBody::is_sleeping)
    };
    let asleep: HashSet<Entity> = spawned.iter().filter(is_asleep).map(|(entity, ..)| entity).collect();
    let mut shaped = HashSet::new();
    for (handle, link) in &attached {
        let Ok((mut bodies, colliders)) = contexts.get_mut(link.0) else { continue };
        let Some(parent) = colliders.colliders.get(handle.0).and_then(RapierCollider::parent) else { continue };
        let entity = bodies.rigid_body_entity(parent);
        if let Some(entity) = entity.filter(|entity| asleep.contains(entity) || waiting.contains(*entity)) {
            shaped.insert(entity);
        } else if let Some(body) = bodies.bodies.get_mut(parent) {
            body.wake_up(true);
        }
    }
    asleep.difference(&shaped).for_each(|&entity| _ = commands.entity(entity).try_insert(SpawnedAsleep));
    shaped.iter().for_each(|&entity| _ = commands.entity(entity).try_remove::<SpawnedAsleep>());
}
