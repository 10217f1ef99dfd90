//! Without rapier: bodies move as their transforms say, from one frame to the next, and nothing stops them. Messages tell what they hit.

use std::collections::HashMap;

use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};

use super::{
    BodyInfo, Detail, DetailItem, MedialBudget, MedialCcd, MedialImportance, MedialLevel, MedialMesh, MedialSettings,
    MedialStep, MedialSystems, StaticObb,
};
use crate::{
    constants::DEFAULT_PREDICTION,
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Meeting, Shape, StaticBody, Statics},
};

pub(super) fn add_systems(app: &mut App, schedule: Interned<dyn ScheduleLabel>) {
    app.configure_sets(
        schedule,
        (MedialSystems::Detect, MedialSystems::Report).chain().after(TransformSystems::Propagate),
    )
    .add_systems(schedule, (gather_statics, detect).chain().in_set(MedialSystems::Detect));
}

fn pose_of(transform: &GlobalTransform) -> (Pose3, Vec3) {
    let (scale, rotation, translation) = transform.to_scale_rotation_translation();
    (Pose3::from_parts(translation, rotation), scale)
}

/// How exact a body has to be, and the level of detail that it has been told.
type Told = (Detail, Option<&'static MedialLevel>);

/// The shape at its level of detail, of which the entity is told.
fn shape_of(
    commands: &mut Commands,
    entity: Entity,
    axis: &MedialAxis,
    (detail, told): (DetailItem, Option<&MedialLevel>),
    scale: f32,
) -> Shape {
    let level = detail.level(axis, scale);
    if told != Some(&MedialLevel(level)) {
        commands.entity(entity).try_insert(MedialLevel(level));
    }
    Shape { axis: axis.level(level).clone(), scale }
}

fn gather_statics(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    changed: Query<
        (),
        (
            With<StaticObb>,
            Or<(
                Changed<GlobalTransform>,
                Changed<StaticObb>,
                Changed<MedialMesh>,
                Changed<MedialBudget>,
                Changed<MedialImportance>,
            )>,
        ),
    >,
    mut removed: (RemovedComponents<MedialBudget>, RemovedComponents<MedialImportance>),
    statics: Query<(Entity, &StaticObb, Option<&MedialMesh>, Told, &GlobalTransform)>,
    axes: Res<Assets<MedialAxis>>,
) {
    let known = step.static_infos.len();
    if changed.is_empty() && removed.0.read().count() + removed.1.read().count() == 0 && statics.iter().len() == known {
        return;
    }
    let mut infos = Vec::new();
    let mut bodies = Vec::new();
    for (entity, obb, mesh, detail, transform) in statics.iter().sort::<Entity>() {
        let (pose, scale) = pose_of(transform);
        let body = match mesh {
            None => StaticBody::solid_box(Obb { pose, half_extents: obb.half_extents * scale.abs() }),
            Some(mesh) => {
                let Some(axis) = axes.get(&mesh.0) else { continue };
                StaticBody::new(shape_of(&mut commands, entity, axis, detail, scale.x), pose)
            }
        };
        infos.push(BodyInfo::at_rest(entity));
        bodies.push(body);
    }
    step.static_infos = infos;
    step.statics = Statics::new(bodies);
}

fn detect(
    mut commands: Commands,
    mut step: ResMut<MedialStep>,
    settings: Res<MedialSettings>,
    time: Res<Time>,
    axes: Res<Assets<MedialAxis>>,
    bodies: Query<(Entity, &MedialMesh, Told, &GlobalTransform, Option<&MedialCcd>), Without<StaticObb>>,
    mut poses: Local<HashMap<Entity, Pose3>>,
) {
    let step = step.as_mut();
    step.settings = MedialSettings { stop_at_impact: false, ..*settings };
    step.dt = time.delta_secs();
    step.input.prediction = DEFAULT_PREDICTION;
    step.input.length_unit = 1.0;
    step.input.allowed_overlap = 0.0;
    step.input.bodies.clear();
    step.infos.clear();
    let before = std::mem::take(&mut *poses);
    for (entity, mesh, detail, transform, ccd) in bodies.iter().sort::<Entity>() {
        let Some(axis) = axes.get(&mesh.0) else { continue };
        let (end, scale) = pose_of(transform);
        let shape = shape_of(&mut commands, entity, axis, detail, scale.x);
        let start = before.get(&entity).copied().unwrap_or(end);
        poses.insert(entity, end);
        let sweep = Sweep::between(start, end, shape.center_of_mass(), Vec3::ZERO);
        let speed = if step.dt > 0.0 { 1.0 / step.dt } else { 0.0 };
        step.infos.push(BodyInfo {
            center: start.transform_point(sweep.local_center),
            linear: sweep.translation * speed,
            angular: sweep.rotation * speed,
            ..BodyInfo::at_rest(entity)
        });
        let passes = ccd.is_some_and(|ccd| !ccd.enabled);
        step.input.bodies.push(Body { stops: false, passes, ..Body::new(shape, sweep) });
    }
    step.run(|_, _, _| Meeting::Stopping);
}
