//! Collision without response.

use std::collections::{HashMap, HashSet};

use bevy::{
    ecs::{intern::Interned, name::NameOrEntityItem, schedule::ScheduleLabel},
    prelude::*,
    transform::{
        StaticTransformOptimizations,
        systems::{mark_dirty_trees, propagate_parent_transforms, sync_simple_transforms},
    },
};

use super::{
    BodyInfo, Detail, DetailItem, MedialCcd, MedialLevel, MedialMesh, MedialSettings, MedialStep, MedialSystems,
    Skeletons, SkinPose, SkinnedMedialMesh, StaticObb, is_bounded, is_sound_pose, uniform_scale,
};
use crate::{
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, PairFilter, Shape, Solid, StaticBody, Statics},
};

/// Collision without response: transforms move the bodies from one frame to the next, impacts do not stop them, and messages report the impacts and
/// contacts, the latter up to a distance of 2 cm. Without the feature `rapier` it is part of [`MedialPhysicsPlugins`](crate::MedialPhysicsPlugins).
#[derive(Clone, Copy, Debug)]
pub struct MedialTransformPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl MedialTransformPlugin {
    /// Runs in the given schedule, which has to be that of the [`MedialCollisionPlugin`](super::MedialCollisionPlugin).
    pub fn in_schedule(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for MedialTransformPlugin {
    /// Runs in `PostUpdate`.
    fn default() -> Self {
        Self::in_schedule(PostUpdate)
    }
}

impl Plugin for MedialTransformPlugin {
    fn build(&self, app: &mut App) {
        app.configure_sets(
            self.schedule,
            (MedialSystems::Detect, MedialSystems::Report).chain().after(TransformSystems::Propagate),
        )
        .add_systems(self.schedule, (pose_skins, gather_statics, detect).chain().in_set(MedialSystems::Detect))
        .add_observer(forget_level);
        // In other schedules, transforms have not been propagated yet.
        if self.schedule != PostUpdate.intern() {
            app.init_resource::<StaticTransformOptimizations>().add_systems(
                self.schedule,
                (mark_dirty_trees, propagate_parent_transforms, sync_simple_transforms)
                    .chain()
                    .in_set(TransformSystems::Propagate),
            );
        }
    }
}

/// Returns pose and scale. None if they are not finite or too large.
fn pose_of(transform: &GlobalTransform) -> Option<(Pose3, Vec3)> {
    let (scale, rotation, translation) = transform.to_scale_rotation_translation();
    let sound = is_sound_pose(&Pose3::from_parts(translation, rotation)) && is_bounded(scale);
    // The rotation of a turned child of a stretched parent is not of unit length.
    sound.then(|| (Pose3::from_parts(translation, rotation.normalize()), scale))
}

/// The same for a medial mesh, which has one scale. It is negative if the mesh is mirrored.
fn uniform_pose_of(transform: &GlobalTransform) -> Option<(Pose3, f32)> {
    pose_of(transform).and_then(|(pose, scale)| Some((pose, uniform_scale(scale)?)))
}

/// Entities that cannot be placed. This has been logged.
#[derive(Default)]
struct Refused(HashSet<Entity>);

impl Refused {
    /// Logs once for each entity that it collides with nothing, until it can be placed.
    fn check<T>(&mut self, name: NameOrEntityItem, transform: &GlobalTransform, placed: Option<T>) -> Option<T> {
        if placed.is_some() {
            self.0.remove(&name.entity);
        } else if self.0.insert(name.entity) {
            let transform = transform.compute_transform();
            error!(
                "{name}: the entity collides with nothing at {transform:?}; give it finite values and, if it has a medial mesh, a uniform scale"
            );
        }
        placed
    }
}

/// Components that determine the accuracy of a body, and its current level of detail.
type Accuracy = (Detail, Option<&'static MedialLevel>);

/// Returns pose and shape of an entity that is loaded and can be placed. The entity gets its level of detail; without a shape the level is removed.
fn place(
    commands: &mut Commands,
    refused: &mut Refused,
    name: NameOrEntityItem,
    axis: Option<&MedialAxis>,
    (detail, current): (DetailItem, Option<&MedialLevel>),
    transform: &GlobalTransform,
) -> Option<(Pose3, Shape)> {
    let mut entity = commands.entity(name.entity);
    let placed = axis.and_then(|axis| Some((axis, refused.check(name, transform, uniform_pose_of(transform))?)));
    let Some((axis, (pose, scale))) = placed else {
        if current.is_some() {
            entity.try_remove::<MedialLevel>();
        }
        return None;
    };
    let level = detail.level(axis, scale.abs());
    if current != Some(&MedialLevel(level)) {
        entity.try_insert(MedialLevel(level));
    }
    Some((pose, Shape::scaled(axis.level(level), scale)))
}

/// Removes the level of detail together with the shape.
fn forget_level(removed: On<Remove, MedialMesh>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<MedialLevel>();
}

/// A static, with all values on which its place in the hierarchy depends.
#[derive(Clone, PartialEq)]
struct Known {
    entity: Entity,
    pose: Pose3,
    solid: KnownSolid,
}

#[derive(Clone)]
enum KnownSolid {
    /// A box with these half extents.
    Box(Vec3),
    Medial(Shape),
}

impl PartialEq for KnownSolid {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (KnownSolid::Box(a), KnownSolid::Box(b)) => a == b,
            (KnownSolid::Medial(a), KnownSolid::Medial(b)) => {
                a.axis.address() == b.axis.address() && a.scale == b.scale
            }
            _ => false,
        }
    }
}

fn gather_statics(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    statics: Query<
        (NameOrEntity, &StaticObb, Option<&MedialMesh>, Accuracy, &GlobalTransform),
        Without<SkinnedMedialMesh>,
    >,
    axes: Res<Assets<MedialAxis>>,
    mut known: Local<Vec<Known>>,
    mut refused: Local<Refused>,
) {
    refused.0.retain(|entity| statics.contains(*entity));
    let (mut found, mut bodies) = (Vec::new(), Vec::new());
    for (name, obb, mesh, current, transform) in statics.iter().sort::<Entity>() {
        let entity = name.entity;
        let (pose, solid) = match mesh {
            None => {
                let Some((pose, scale)) = refused.check(name, transform, pose_of(transform)) else { continue };
                let half_extents = obb.half_extents * scale.abs();
                bodies.push(StaticBody::solid_box(Obb { pose, half_extents }));
                (pose, KnownSolid::Box(half_extents))
            }
            Some(mesh) => {
                let placed = place(&mut commands, &mut refused, name, axes.get(&mesh.0), current, transform);
                let Some((pose, shape)) = placed else { continue };
                bodies.push(StaticBody::new(shape.clone(), pose));
                (pose, KnownSolid::Medial(shape))
            }
        };
        found.push(Known { entity, pose, solid });
    }
    // The resource may have been replaced, and its statics are gone then.
    if found == *known && step.static_infos.len() == found.len() {
        return;
    }
    step.static_infos = found.iter().map(|found| BodyInfo::at_rest(found.entity)).collect();
    step.statics = Statics::new(bodies);
    *known = found;
}

/// Poses all skinned shapes by their joints.
fn pose_skins(mut skeletons: Skeletons) {
    skeletons.pose(|_| true, |_| None);
}

fn detect(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    settings: Res<MedialSettings>,
    time: Res<Time>,
    axes: Res<Assets<MedialAxis>>,
    bodies: Query<
        (NameOrEntity, &MedialMesh, Accuracy, &GlobalTransform, Option<&MedialCcd>),
        (Without<StaticObb>, Without<SkinnedMedialMesh>),
    >,
    skins: Query<(Entity, &SkinPose, Option<&MedialCcd>)>,
    mut poses: Local<HashMap<Entity, Pose3>>,
    mut refused: Local<Refused>,
) {
    let step = step.as_mut();
    step.settings = MedialSettings { stop_at_impact: false, ..*settings };
    step.dt = time.delta_secs();
    // In metres, the default of rapier.
    step.input.prediction = 0.02;
    step.input.length_unit = 1.0;
    step.input.bodies.clear();
    step.infos.clear();
    let before = std::mem::take(&mut *poses);
    refused.0.retain(|entity| bodies.contains(*entity));
    for (name, mesh, current, transform, ccd) in bodies.iter().sort::<Entity>() {
        let entity = name.entity;
        let placed = place(&mut commands, &mut refused, name, axes.get(&mesh.0), current, transform);
        let Some((end, shape)) = placed else { continue };
        let start = before.get(&entity).copied().unwrap_or(end);
        poses.insert(entity, end);
        let sweep = Sweep::between(start, end, shape.center_of_mass(), Vec3::ZERO);
        let speed = if step.dt > 0.0 { 1.0 / step.dt } else { 0.0 };
        step.infos.push(BodyInfo {
            body: Some(entity),
            center: start.transform_point(sweep.local_center),
            linear: sweep.translation * speed,
            angular: sweep.rotation * speed,
            ..BodyInfo::at_rest(entity)
        });
        let passes = ccd.is_some_and(|ccd| !ccd.enabled);
        step.input.bodies.push(Body { stops: false, passes, ..Body::new(shape, sweep) });
    }
    for (entity, pose, ccd) in skins.iter().sort::<Entity>() {
        step.infos.push(BodyInfo { body: Some(entity), ..BodyInfo::at_rest(entity) });
        let passes = ccd.is_some_and(|ccd| !ccd.enabled);
        let solid = Solid::Deforming(pose.shape().clone());
        step.input.bodies.push(Body { stops: false, passes, ..Body::new(solid, Sweep::at_rest(pose.frame())) });
    }
    step.run(|_, _, _| PairFilter::Stopping);
}

#[cfg(test)]
mod tests;
