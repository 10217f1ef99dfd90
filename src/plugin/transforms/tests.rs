use std::time::Duration;

use bevy::{asset::AssetPlugin, diagnostic::DiagnosticsPlugin, ecs::message::MessageCursor, time::TimeUpdateStrategy};

use super::*;
use crate::plugin::{MedialBackend, MedialCollisionPlugin, MedialContactEnded, MedialContactStarted};

const RADIUS: f32 = 0.1;

#[test]
fn a_stretched_parent_turns_a_child_by_no_other_length() {
    let parent = Transform::from_scale(Vec3::new(1.0, 1.4, 1.0));
    let child = Transform::from_rotation(Quat::from_rotation_x(0.25 * std::f32::consts::PI));
    let place = GlobalTransform::from(parent) * child;
    let reported = place.to_scale_rotation_translation().1.length();
    assert!((reported - 1.0).abs() > 1e-3, "{reported}: the rotation has unit length already");
    let (pose, _) = pose_of(&place).unwrap();
    assert!(pose.rotation.is_normalized());
}

#[test]
fn a_mirrored_mesh_is_where_it_is_drawn() {
    let turn = Quat::from_euler(EulerRot::XYZ, 0.3, -0.7, 1.1);
    let mut placed = [0; 2];
    for number in 0..64u8 {
        let scale = |bits: u8| Vec3::from_array([0, 1, 2].map(|k| 1.0 - 2.0 * f32::from(bits >> k & 1))) * 1.5;
        let [parent, child] =
            [number % 8, number / 8].map(|bits| Transform { translation: Vec3::X, rotation: turn, scale: scale(bits) });
        let place = GlobalTransform::from(parent) * child;
        let (pose, factor) = uniform_pose_of(&place).unwrap();
        placed[usize::from(factor < 0.0)] += 1;
        assert_eq!(factor > 0.0, number.count_ones() % 2 == 0, "{} {}", parent.scale, child.scale);
        for point in [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z] {
            let found = pose.transform_point(point * Vec3::new(factor, factor.abs(), factor.abs()));
            assert!(found.distance(place.transform_point(point)) < 1e-5, "{} {}", parent.scale, child.scale);
        }
    }
    assert_eq!(placed, [32, 32]);
}

/// An app without rapier. Each update takes 1/60 s.
fn app() -> App {
    app_with(PostUpdate)
}

fn app_with(schedule: impl ScheduleLabel) -> App {
    let schedule = schedule.intern();
    let physics = (MedialCollisionPlugin { schedule }, MedialTransformPlugin { schedule });
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin, physics))
        .insert_resource(MedialSettings { backend: MedialBackend::Cpu, ..default() })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(1.0 / 60.0)));
    app
}

fn ball(app: &mut App, x: f32) -> Entity {
    let ball = app.world_mut().resource_mut::<Assets<MedialAxis>>().add(MedialAxis::sphere(RADIUS).unwrap());
    app.world_mut().spawn((MedialMesh(ball), Transform::from_xyz(x, 0.0, 0.0))).id()
}

/// A wall of 2 cm thickness.
fn wall(app: &mut App) -> Entity {
    app.world_mut().spawn((StaticObb::new(0.01, 1.0, 1.0), Transform::default())).id()
}

fn place(app: &mut App, entity: Entity, x: f32) {
    app.world_mut().get_mut::<Transform>(entity).unwrap().translation.x = x;
    app.update();
}

/// Returns all messages so far.
fn reported(app: &App) -> (Vec<MedialContactStarted>, Vec<MedialContactEnded>) {
    let world = app.world();
    let started = MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect();
    (started, MessageCursor::default().read(world.resource::<Messages<_>>()).copied().collect())
}

#[test]
fn a_body_moved_through_a_wall_is_reported_and_does_not_stop() {
    let mut app = app();
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    app.update();
    app.update();
    assert_eq!(reported(&app), (vec![], vec![]));
    place(&mut app, ball, 1.0);
    let (started, ended) = reported(&app);
    let [hit] = started[..] else { panic!("{started:?}") };
    assert_eq!((hit.entity1, hit.entity2, hit.sensor, ended.len()), (ball, wall, false, 0));
    // Its surface moves by two metres and meets the wall after 89 cm.
    assert!((hit.touch.fraction - 0.445).abs() < 1e-3, "{hit:?}");
    assert!(hit.touch.normal.distance(Vec3::X) < 1e-4 && (hit.touch.approach_speed - 120.0).abs() < 0.01, "{hit:?}");
    assert_eq!(app.world().get::<Transform>(ball).unwrap().translation, Vec3::X);
    app.update();
    let ended = reported(&app).1;
    assert_eq!(ended, [MedialContactEnded { entity1: ball, entity2: wall, body1: Some(ball), body2: None }]);
}

#[test]
fn a_level_of_detail_is_removed_with_the_shape() {
    let mut app = app();
    let ball = ball(&mut app, 0.0);
    let scale = |app: &mut App, scale: f32| {
        app.world_mut().get_mut::<Transform>(ball).unwrap().scale = Vec3::splat(scale);
        app.update();
    };
    let has_level = |app: &App| app.world().get::<MedialLevel>(ball).is_some();
    for obb in [false, true] {
        if obb {
            app.world_mut().entity_mut(ball).insert(StaticObb::default());
        }
        scale(&mut app, 1.0);
        assert!(has_level(&app));
        scale(&mut app, 0.0);
        assert!(!has_level(&app), "an entity without size has a level");
        scale(&mut app, 1.0);
        assert!(has_level(&app));
    }
    let mesh = app.world().get::<MedialMesh>(ball).unwrap().clone();
    app.world_mut().resource_mut::<Assets<MedialAxis>>().remove(&mesh.0).unwrap();
    app.update();
    assert!(!has_level(&app), "an entity without its asset has a level");
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, MedialAxis::sphere(0.2).unwrap()).unwrap();
    app.update();
    assert!(has_level(&app));
    app.world_mut().entity_mut(ball).remove::<MedialMesh>();
    assert!(!has_level(&app), "an entity without a shape has a level");
}

#[test]
fn the_fixed_schedule_needs_no_transform_plugin() {
    let mut app = App::new();
    let schedule = FixedUpdate.intern();
    let physics = (MedialCollisionPlugin { schedule }, MedialTransformPlugin { schedule });
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), physics))
        .insert_resource(Time::<Fixed>::from_hz(60.0))
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    (0..3).for_each(|_| app.update());
    place(&mut app, ball, 1.0);
    app.update();
    let hits: Vec<_> = reported(&app).0.iter().map(|hit| (hit.entity1, hit.entity2)).collect();
    assert_eq!(hits, [(ball, wall)]);
}

#[test]
fn a_touch_is_reported_without_continuous_collision() {
    for enabled in [true, false] {
        let mut app = app();
        let [one, other] = [-1.0, 1.0].map(|x| ball(&mut app, x));
        app.world_mut().entity_mut(other).insert(MedialCcd { enabled, ..default() });
        app.update();
        app.world_mut().get_mut::<Transform>(one).unwrap().translation.x = 1.0;
        place(&mut app, other, -1.0);
        let started = reported(&app).0;
        let [hit] = started[..] else { panic!("{started:?}") };
        assert!((hit.touch.fraction - 0.45).abs() < 1e-3, "{hit:?}");
    }
}

#[test]
fn each_fixed_step_sweeps_a_part_of_the_path() {
    let mut app = app_with(FixedUpdate);
    // Each update has two steps.
    app.insert_resource(Time::<Fixed>::from_hz(120.0));
    let ball = ball(&mut app, 0.0);
    app.add_systems(
        FixedUpdate,
        (move |mut transforms: Query<&mut Transform>, step: Res<MedialStep>, mut seen: Local<u32>| {
            transforms.get_mut(ball).unwrap().translation.x += 1.0;
            if let Some(info) = step.infos.first() {
                *seen += 1;
                assert!(*seen < 2 || (info.linear.x - 120.0).abs() < 1e-3, "step {}: {}", *seen, info.linear);
            }
        })
        .before(TransformSystems::Propagate),
    );
    (0..8).for_each(|_| app.update());
    assert!(app.world().get::<Transform>(ball).unwrap().translation.x > 10.0);
}

#[test]
fn a_static_despawned_while_another_loads_stops_nothing() {
    let mut app = app();
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    let handle = app.world().resource::<Assets<MedialAxis>>().reserve_handle();
    let loading =
        app.world_mut().spawn((StaticObb::default(), MedialMesh(handle.clone()), Transform::from_xyz(5.0, 0.0, 0.0)));
    let loading = loading.id();
    app.update();
    app.world_mut().despawn(wall);
    place(&mut app, ball, 1.0);
    assert_eq!(reported(&app).0, []);
    let sphere = MedialAxis::sphere(RADIUS).unwrap();
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&handle, sphere).unwrap();
    place(&mut app, loading, 0.0);
    place(&mut app, ball, -1.0);
    assert_eq!(reported(&app).0.len(), 1);
}

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Rarely;

#[test]
fn a_shape_changed_between_runs_of_a_schedule_is_updated() {
    let mut app = app_with(Rarely);
    let fixed = ball(&mut app, 0.0);
    app.world_mut().entity_mut(fixed).insert(StaticObb::default());
    let radius = |app: &mut App| {
        app.world_mut().run_schedule(Rarely);
        app.world().resource::<MedialStep>().statics.bodies()[0].solid.bounding_sphere().radius
    };
    app.update();
    assert!((radius(&mut app) - RADIUS).abs() < 1e-3);
    let mesh = app.world().get::<MedialMesh>(fixed).unwrap().clone();
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, MedialAxis::sphere(0.4).unwrap()).unwrap();
    (0..5).for_each(|_| app.update());
    assert!((radius(&mut app) - 0.4).abs() < 1e-3);
}

#[test]
fn an_invalid_transform_affects_no_other_body() {
    let mut app = app();
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    app.update();
    let [flat, stray] = [0.3, 0.4].map(|x| self::ball(&mut app, x));
    app.world_mut().get_mut::<Transform>(flat).unwrap().scale = Vec3::new(1.0, 0.0, 1.0);
    app.world_mut().get_mut::<Transform>(stray).unwrap().translation.y = f32::NAN;
    let broken = app.world_mut().spawn((StaticObb::default(), Transform::from_xyz(f32::INFINITY, 0.0, 0.0))).id();
    app.update();
    place(&mut app, ball, 1.0);
    let step = app.world().resource::<MedialStep>();
    assert_eq!((step.input.bodies.len(), step.statics.bodies().len()), (1, 1));
    let hits: Vec<_> = reported(&app).0.iter().map(|hit| (hit.entity1, hit.entity2)).collect();
    assert_eq!(hits, [(ball, wall)]);
    place(&mut app, broken, 5.0);
    assert_eq!(app.world().resource::<MedialStep>().statics.bodies().len(), 2);
}

/// Hierarchies of transforms with uneven scales cause such rotations.
#[test]
fn a_sheared_wall_collides() {
    let mut app = app();
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    app.world_mut().get_mut::<Transform>(wall).unwrap().rotation = Quat::from_rotation_x(0.3);
    app.world_mut().spawn(Transform::from_scale(Vec3::new(1.0, 1.3, 1.0))).add_child(wall);
    app.update();
    let rotation = app.world().get::<GlobalTransform>(wall).unwrap().rotation();
    assert!(!rotation.is_normalized(), "{rotation} is normalized");
    place(&mut app, ball, 1.0);
    assert_eq!(reported(&app).0.len(), 1);
}

#[test]
fn a_wall_follows_its_transform() {
    let mut app = app();
    let (wall, ball) = (wall(&mut app), ball(&mut app, -1.0));
    app.update();
    place(&mut app, wall, 5.0);
    place(&mut app, ball, 1.0);
    assert_eq!(reported(&app).0, []);
    place(&mut app, wall, 0.0);
    place(&mut app, ball, -1.0);
    assert_eq!(reported(&app).0.len(), 1);
    app.world_mut().despawn(wall);
    app.update();
    assert_eq!(app.world().resource::<MedialStep>().statics.bodies().len(), 0);
}
