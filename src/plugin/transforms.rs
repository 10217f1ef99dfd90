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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bevy::{
        asset::AssetPlugin, diagnostic::DiagnosticsPlugin, ecs::message::MessageCursor, time::TimeUpdateStrategy,
    };

    use super::*;
    use crate::plugin::{MedialBackend, MedialContactEnded, MedialContactStarted, MedialPhysicsPlugin};

    const RADIUS: f32 = 0.1;

    /// An app without rapier, each of whose updates is 1/60 s.
    fn app() -> App {
        let mut app = App::new();
        let physics = MedialPhysicsPlugin { add_systems, ..default() };
        app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin, physics))
            .insert_resource(MedialSettings { backend: MedialBackend::Cpu, ..default() })
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(1.0 / 60.0)));
        app
    }

    fn ball(app: &mut App, x: f32) -> Entity {
        let ball = app.world_mut().resource_mut::<Assets<MedialAxis>>().add(MedialAxis::sphere(RADIUS).unwrap());
        app.world_mut().spawn((MedialMesh(ball), Transform::from_xyz(x, 0.0, 0.0))).id()
    }

    /// A wall of 2 cm.
    fn wall(app: &mut App) -> Entity {
        app.world_mut().spawn((StaticObb::new(0.01, 1.0, 1.0), Transform::default())).id()
    }

    fn place(app: &mut App, entity: Entity, x: f32) {
        app.world_mut().get_mut::<Transform>(entity).unwrap().translation.x = x;
        app.update();
    }

    /// What has been told so far.
    fn told(app: &App) -> (Vec<MedialContactStarted>, Vec<MedialContactEnded>) {
        let world = app.world();
        let started = MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect();
        (started, MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect())
    }

    #[test]
    fn a_body_that_is_moved_through_a_wall_is_told_of_and_goes_on() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.update();
        app.update();
        assert_eq!(told(&app), (vec![], vec![]));
        place(&mut app, ball, 1.0);
        let (started, ended) = told(&app);
        let [hit] = started[..] else { panic!("{started:?}") };
        assert_eq!((hit.entity1, hit.entity2, hit.sensor, ended.len()), (ball, wall, false, 0));
        // Its side has two metres to go, and meets the wall after 89 cm.
        assert!((hit.touch.fraction - 0.445).abs() < 1e-3, "{hit:?}");
        assert!(
            hit.touch.normal.distance(Vec3::X) < 1e-4 && (hit.touch.approach_speed - 120.0).abs() < 0.01,
            "{hit:?}"
        );
        assert_eq!(app.world().get::<Transform>(ball).unwrap().translation, Vec3::X);
        app.update();
        let ended = told(&app).1;
        assert_eq!(ended, [MedialContactEnded { entity1: ball, entity2: wall }]);
    }

    #[test]
    fn two_bodies_meet_even_if_one_of_them_is_not_to_stop() {
        for enabled in [true, false] {
            let mut app = app();
            let [one, other] = [-1.0, 1.0].map(|x| ball(&mut app, x));
            app.world_mut().entity_mut(other).insert(MedialCcd { enabled });
            app.update();
            app.world_mut().get_mut::<Transform>(one).unwrap().translation.x = 1.0;
            place(&mut app, other, -1.0);
            let started = told(&app).0;
            let [hit] = started[..] else { panic!("{started:?}") };
            assert!((hit.touch.fraction - 0.45).abs() < 1e-3, "{hit:?}");
        }
    }

    #[test]
    fn a_wall_is_where_its_transform_says() {
        let mut app = app();
        let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
        app.update();
        place(&mut app, wall, 5.0);
        place(&mut app, ball, 1.0);
        assert_eq!(told(&app).0, []);
        place(&mut app, wall, 0.0);
        place(&mut app, ball, -1.0);
        assert_eq!(told(&app).0.len(), 1);
        app.world_mut().despawn(wall);
        app.update();
        assert_eq!(app.world().resource::<MedialStep>().statics.bodies().len(), 0);
    }
}
