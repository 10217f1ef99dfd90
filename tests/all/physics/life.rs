//! Changes at run time: bodies are spawned, changed, moved, paused, removed and restored, and messages report it.

use std::{fs, path::PathBuf, sync::LazyLock, time::Duration};

use bevy::{
    asset::{AssetServer, LoadState},
    ecs::schedule::ScheduleLabel,
    prelude::*,
    time::TimeUpdateStrategy,
};
use bevy_medial::{medial_axis::MedialAxis, plugin::MedialStep, prelude::*, rapier::ContactTable};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierRigidBodySet},
    prelude::{
        Collider, ColliderDisabled, CollisionGroups, Group, PhysicsSet, RapierColliderHandle, RapierConfiguration,
        RigidBody, RigidBodyDisabled, Sensor, Sleeping, TimestepMode, TransformInterpolation, Velocity,
    },
};

use crate::{common::*, log};

fn plate() -> MedialAxis {
    static PLATE: LazyLock<MedialAxis> =
        LazyLock::new(|| MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.1).unwrap());
    PLATE.clone()
}

fn ball() -> MedialAxis {
    MedialAxis::sphere(0.2).unwrap()
}

/// Position of an entity's collider in rapier.
fn collider_position(app: &mut App, entity: Entity) -> Vec3 {
    let handle = app.world().get::<RapierColliderHandle>(entity).unwrap().0;
    let mut contexts = app.world_mut().query::<&RapierContextColliders>();
    contexts.single(app.world()).unwrap().colliders[handle].translation()
}

fn set_active(app: &mut App, active: bool) {
    let mut configuration = app.world_mut().query::<&mut RapierConfiguration>();
    configuration.single_mut(app.world_mut()).unwrap().physics_pipeline_active = active;
}

/// Updates the app until the state of the load satisfies a condition.
fn wait(app: &mut App, mesh: &MedialMesh, is_over: impl Fn(&LoadState) -> bool) {
    for _ in 0..10_000 {
        app.update();
        if is_over(&app.world().resource::<AssetServer>().load_state(&mesh.0)) {
            return run(app, 2);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("the load does not end");
}

#[test]
fn bodies_rest_whether_spawned_before_or_after_loading() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let mesh = MedialMesh(app.world().resource::<Assets<MedialAxis>>().reserve_handle());
    let mut record = Record::default();
    let mut bodies = Vec::new();
    for frame in 0..60 {
        if frame == 30 {
            app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, plate()).unwrap();
        }
        if [0, 29, 30, 31, 59].contains(&frame) {
            let at = Transform::from_xyz(bodies.len() as f32, 0.3, 0.0);
            bodies.push(app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), at)).id());
        }
        record.run(&mut app, 1);
    }
    record.run(&mut app, 200);
    for body in bodies {
        assert!((position(&mut app, body).y - 0.1).abs() < 3e-3 && is_at_rest(&mut app, body));
        assert_eq!(record.counts(body, ground), [1, 0]);
    }
}

#[test]
fn a_failed_load_is_logged_once_and_can_be_repaired() {
    log::keep();
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("physics-failed-load");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("bad.ma"), "this is no mesh\n").unwrap();
    let mut app = app_with(MedialPhysicsPlugins::default(), &folder);
    spawn_ground(&mut app);
    let mesh = MedialMesh(app.world().resource::<AssetServer>().load("bad.ma"));
    let name = Name::new("of a bad file");
    let body = app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::from_xyz(0.0, 1.0, 0.0), name)).id();
    wait(&mut app, &mesh, |state| matches!(state, LoadState::Failed(_)));
    run(&mut app, 20);
    assert!(app.world().get::<Collider>(body).is_none());
    let lines = log::lines("of a bad file");
    assert_eq!(lines.len(), 1, "{lines:?}");
    assert!(lines[0].contains("bad.ma"), "{lines:?}");
    // The file is repaired.
    fs::copy(assets().join("models/torus.ma"), folder.join("bad.ma")).unwrap();
    app.world().resource::<AssetServer>().reload("bad.ma");
    wait(&mut app, &mesh, |state| matches!(state, LoadState::Loaded));
    run(&mut app, 300);
    assert!((position(&mut app, body).y - 0.0525).abs() < 2e-3, "{}", position(&mut app, body));
    // If the file is damaged again, the shape stays as it is.
    fs::write(folder.join("bad.ma"), "this is no mesh again\n").unwrap();
    app.world().resource::<AssetServer>().reload("bad.ma");
    wait(&mut app, &mesh, |state| matches!(state, LoadState::Failed(_)));
    run(&mut app, 20);
    assert!(app.world().get::<Collider>(body).is_some());
    assert!((position(&mut app, body).y - 0.0525).abs() < 2e-3 && is_at_rest(&mut app, body));
    // The asset server logs an error after it has set the state, on another thread.
    for _ in 0..1000 {
        if log::lines("bad.ma").len() < 3 {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    assert!(log::lines("bad.ma").len() >= 3, "the failed reload is not logged");
    assert_eq!(log::lines("of a bad file").len(), 1);
}

#[test]
fn a_substitute_collider_stays_if_the_shape_does_not_load() {
    let mut app = app();
    let mesh = MedialMesh(app.world().resource::<AssetServer>().load("no such.ma"));
    let body = (RigidBody::Dynamic, mesh.clone(), Collider::ball(0.5), Transform::from_scale(Vec3::splat(2.0)));
    let body = app.world_mut().spawn(body).id();
    wait(&mut app, &mesh, |state| matches!(state, LoadState::Failed(_)));
    run(&mut app, 5);
    let radius = |app: &App| app.world().get::<Collider>(body).unwrap().raw.as_ball().unwrap().radius;
    assert_eq!(radius(&app), 1.0);
    app.world_mut().entity_mut(body).remove::<MedialMesh>();
    run(&mut app, 5);
    assert_eq!(radius(&app), 1.0);
}

#[test]
fn a_static_without_its_unloaded_shape_becomes_a_box() {
    let mut app = app();
    // This asset never loads.
    let mesh = MedialMesh(app.world().resource::<Assets<MedialAxis>>().reserve_handle());
    let floor = app.world_mut().spawn((StaticObb::new(2.0, 0.5, 2.0), mesh, Transform::from_xyz(0.0, -0.5, 0.0))).id();
    app.update();
    assert!(app.world().get::<Collider>(floor).is_none());
    app.world_mut().entity_mut(floor).remove::<MedialMesh>();
    run(&mut app, 3);
    assert_eq!(app.world().get::<RigidBody>(floor), Some(&RigidBody::Fixed));
    assert!(app.world().get::<Collider>(floor).is_some_and(|collider| collider.as_cuboid().is_some()));
}

#[test]
fn an_invalid_scale_is_logged_once() {
    log::keep();
    let mut app = app();
    spawn_ground(&mut app);
    let good = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.3, 0.0));
    for (i, scale) in
        [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO, Vec3::splat(1e30), Vec3::splat(1e8), Vec3::new(1.0, f32::NAN, 1.0)]
            .into_iter()
            .enumerate()
    {
        let body = spawn_body(&mut app, plate(), Transform::from_xyz(3.0, 0.3, 0.0));
        app.world_mut().entity_mut(body).insert(Name::new(format!("scaled badly {i}")));
        run(&mut app, 5);
        app.world_mut().get_mut::<Transform>(body).unwrap().scale = scale;
        run(&mut app, 20);
        let lines = log::lines(&format!("scaled badly {i}"));
        let about_scale = lines.iter().filter(|line| line.contains("cannot be scaled")).count();
        assert!(about_scale == 1 && lines.len() <= 2, "{scale}: {lines:?}");
        assert!(app.world().get::<Collider>(body).is_none(), "{scale}");
        app.world_mut().entity_mut(body).insert((Transform::from_xyz(3.0, 0.3, 0.0), Velocity::zero()));
        run(&mut app, 120);
        assert!((position(&mut app, body).y - 0.1).abs() < 5e-3, "{scale}: {}", position(&mut app, body));
        app.world_mut().despawn(body);
    }
    assert!((position(&mut app, good).y - 0.1).abs() < 3e-3 && is_at_rest(&mut app, good));
}

#[test]
fn a_reloaded_shape_changes_all_its_bodies() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let mesh = mesh(&mut app, plate());
    let bodies: Vec<Entity> = (0..3)
        .map(|i| {
            let at = Transform::from_xyz(1.5 * i as f32, 0.101, 0.0);
            app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), at)).id()
        })
        .collect();
    let mut record = Record::default();
    record.run(&mut app, 200);
    let mass = rigid(&mut app, bodies[0]).mass();
    assert!(bodies.iter().all(|&body| is_at_rest(&mut app, body)));
    let thick = MedialAxis::rounded_box(Vec3::new(0.3, 0.2, 0.3), 0.02).unwrap();
    let expected = thick.mass().volume;
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, thick).unwrap();
    record.run(&mut app, 300);
    for body in bodies {
        assert!((position(&mut app, body).y - 0.2).abs() < 3e-3 && is_at_rest(&mut app, body));
        assert!((rigid(&mut app, body).mass() / expected - 1.0).abs() < 1e-4);
        assert_eq!(record.counts(body, ground), [1, 0]);
    }
    assert!(expected > 1.9 * mass);
}

#[test]
fn a_removed_and_replaced_shape_changes_its_bodies() {
    for frames_between in [0, 3] {
        let mut app = app();
        spawn_ground(&mut app);
        let mesh = mesh(&mut app, plate());
        let body = app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::from_xyz(0.0, 0.101, 0.0))).id();
        run(&mut app, 100);
        let thick = MedialAxis::rounded_box(Vec3::new(0.3, 0.2, 0.3), 0.02).unwrap();
        let expected = thick.mass().volume;
        app.world_mut().resource_mut::<Assets<MedialAxis>>().remove(&mesh.0).unwrap();
        run(&mut app, frames_between);
        app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, thick).unwrap();
        run(&mut app, 100);
        let mass = rigid(&mut app, body).mass();
        assert!((mass / expected - 1.0).abs() < 1e-4, "{frames_between} frames between: {mass} kg, not {expected}");
    }
}

#[test]
fn a_shape_attaches_to_a_body_that_is_added_later() {
    let mut app = app();
    let mesh = mesh(&mut app, ball());
    // A shape without a body, and a shape on the child of a body.
    let alone = app.world_mut().spawn((mesh.clone(), Transform::from_xyz(0.0, 5.0, 0.0))).id();
    let parent = spawn_flying(&mut app, ball(), Transform::from_xyz(3.0, 5.0, 0.0), Velocity::zero());
    let child = app.world_mut().spawn((mesh, Transform::from_xyz(1.0, 0.0, 0.0), ChildOf(parent))).id();
    run(&mut app, 3);
    let both = rigid(&mut app, parent).mass();
    app.world_mut().entity_mut(alone).insert(RigidBody::Dynamic);
    app.world_mut()
        .entity_mut(child)
        .remove::<ChildOf>()
        .insert((RigidBody::Dynamic, Transform::from_xyz(4.0, 5.0, 0.0)));
    run(&mut app, 30);
    let weighs = |app: &mut App, entity| (2.0 * rigid(app, entity).mass() / both - 1.0).abs() < 1e-3;
    assert!([alone, parent, child].iter().all(|&entity| weighs(&mut app, entity)));
    for entity in [alone, child] {
        let (body, shape) = (position(&mut app, entity), collider_position(&mut app, entity));
        assert!(body.y < 4.9 && shape == body, "the body is at {body}, its shape at {shape}");
    }
    // The body is removed and added again.
    app.world_mut().entity_mut(alone).remove::<RigidBody>();
    run(&mut app, 3);
    app.world_mut().entity_mut(alone).insert(RigidBody::Dynamic);
    run(&mut app, 3);
    assert!(weighs(&mut app, alone));
}

#[test]
fn a_part_detached_between_fixed_steps_stays_in_place() {
    // A step has four frames. The part is detached in each of them.
    for frame in 0..4 {
        let mut app = app_with(MedialPhysicsPlugins::default().in_fixed_schedule(), &assets());
        app.insert_resource(Time::<Fixed>::from_hz(60.0));
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 240.0)));
        let parent = spawn_flying(&mut app, ball(), Transform::from_xyz(3.0, 5.0, 0.0), Velocity::zero());
        let mesh = mesh(&mut app, ball());
        let part = app.world_mut().spawn((mesh, Transform::from_xyz(1.0, 0.0, 0.0), ChildOf(parent))).id();
        run(&mut app, 12 + frame);
        let both = rigid(&mut app, parent).mass();
        app.world_mut().entity_mut(part).remove::<ChildOf>();
        run(&mut app, 12);
        let place = collider_position(&mut app, part);
        assert_eq!(place, Vec3::X, "frame {frame}: the collider is not at its entity");
        assert!((2.0 * rigid(&mut app, parent).mass() / both - 1.0).abs() < 1e-3, "frame {frame}");
    }
}

#[test]
fn a_body_spawned_asleep_does_not_fall_until_it_is_hit() {
    let mut app = app();
    let asleep = Sleeping { sleeping: true, ..default() };
    let hanging = spawn_body(&mut app, ball(), Transform::from_xyz(0.0, 5.0, 0.0));
    app.world_mut().entity_mut(hanging).insert(asleep);
    let other = spawn_body(&mut app, ball(), Transform::from_xyz(3.0, 5.0, 0.0));
    run(&mut app, 30);
    assert!(is_at_rest(&mut app, hanging) && position(&mut app, hanging).y == 5.0 && position(&mut app, other).y < 4.5);
    let hit = Velocity::linear(Vec3::X * 10.0);
    spawn_flying(&mut app, ball(), Transform::from_xyz(-1.0, 5.0, 0.0), hit);
    run(&mut app, 30);
    assert!(position(&mut app, hanging).x > 0.5);
}

#[test]
fn a_sensor_reports_touches_of_sleeping_bodies() {
    let mut app = app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.1, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 200);
    assert!(is_at_rest(&mut app, body));
    let zone = app.world_mut().spawn((StaticObb::new(1.0, 1.0, 1.0), Sensor, Transform::default())).id();
    record.run(&mut app, 3);
    assert_eq!(record.counts(zone, body), [1, 0]);
    record.run(&mut app, 20);
    app.world_mut().get_mut::<Transform>(zone).unwrap().translation.x = 20.0;
    record.run(&mut app, 3);
    assert_eq!(record.counts(zone, body), [1, 1]);
    assert!(is_at_rest(&mut app, body));
}

#[test]
fn a_sleeping_kinematic_body_reports_new_touches() {
    for sensor in [true, false] {
        let mut app = app();
        let shape = mesh(&mut app, plate());
        let zone = app.world_mut().spawn((RigidBody::KinematicPositionBased, shape)).id();
        if sensor {
            app.world_mut().entity_mut(zone).insert(Sensor);
        }
        let mut record = Record::default();
        record.run(&mut app, 200);
        assert!(rigid(&mut app, zone).is_sleeping());
        let door = app.world_mut().spawn((StaticObb::new(0.1, 0.1, 0.1), Transform::default())).id();
        record.run(&mut app, 3);
        assert_eq!(record.counts(zone, door), [1, 0], "sensor: {sensor}");
        record.run(&mut app, 20);
        app.world_mut().get_mut::<Transform>(door).unwrap().translation.x = 20.0;
        record.run(&mut app, 3);
        assert_eq!(record.counts(zone, door), [1, 1], "sensor: {sensor}");
        assert!(rigid(&mut app, zone).is_sleeping());
    }
}

/// A change of a body between the ground and another body: name, change, reversal, and whether the touches end and start again.
type Change = (&'static str, fn(&mut App, Entity), fn(&mut App, Entity), bool);

const CHANGES: [Change; 9] = [
    (
        "handle",
        |app, body| {
            let other = mesh(app, MedialAxis::rounded_box(Vec3::new(0.32, 0.1, 0.32), 0.02).unwrap());
            app.world_mut().entity_mut(body).insert(other);
        },
        |app, body| {
            let first = mesh(app, plate());
            app.world_mut().entity_mut(body).insert(first);
        },
        false,
    ),
    (
        "scale",
        |app, body| app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::splat(1.1),
        |app, body| app.world_mut().get_mut::<Transform>(body).unwrap().scale = Vec3::ONE,
        false,
    ),
    (
        "settings",
        |app, _| app.insert_resource(MedialSettings { stop_at_impact: false, brute_force: true, ..default() }).update(),
        |app, _| app.insert_resource(MedialSettings::default()).update(),
        false,
    ),
    (
        "continuous collision",
        |app, body| _ = app.world_mut().entity_mut(body).insert(MedialCcd::DISABLED),
        |app, body| _ = app.world_mut().entity_mut(body).remove::<MedialCcd>(),
        false,
    ),
    (
        "kinematic",
        |app, body| _ = app.world_mut().entity_mut(body).insert(RigidBody::KinematicVelocityBased),
        |app, body| _ = app.world_mut().entity_mut(body).insert(RigidBody::Dynamic),
        false,
    ),
    (
        "groups",
        |app, body| _ = app.world_mut().entity_mut(body).insert(CollisionGroups::new(Group::NONE, Group::NONE)),
        |app, body| {
            app.world_mut().entity_mut(body).remove::<CollisionGroups>().insert(CollisionGroups::default());
        },
        true,
    ),
    (
        "disabled collider",
        |app, body| _ = app.world_mut().entity_mut(body).insert(ColliderDisabled),
        |app, body| _ = app.world_mut().entity_mut(body).remove::<ColliderDisabled>(),
        true,
    ),
    (
        "disabled body",
        |app, body| _ = app.world_mut().entity_mut(body).insert(RigidBodyDisabled),
        |app, body| _ = app.world_mut().entity_mut(body).remove::<RigidBodyDisabled>(),
        true,
    ),
    (
        "no shape",
        |app, body| _ = app.world_mut().entity_mut(body).remove::<MedialMesh>(),
        |app, body| {
            let first = mesh(app, plate());
            app.world_mut().entity_mut(body).insert(first);
        },
        true,
    ),
];

#[test]
fn a_touch_continues_through_changes_that_keep_it() {
    for (what, change, back, ends) in CHANGES {
        for asleep in [false, true] {
            let mut app = app();
            let ground = spawn_ground(&mut app);
            let body = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
            let upper = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.302, 0.0));
            let mut record = Record::default();
            record.run(&mut app, if asleep { 300 } else { 20 });
            assert_eq!(asleep, is_at_rest(&mut app, body), "{what}");
            for other in [ground, upper] {
                assert_eq!(record.counts(body, other), [1, 0], "{what}");
            }
            change(&mut app, body);
            record.run(&mut app, 2);
            for other in [ground, upper] {
                assert_eq!(record.counts(body, other), [1, usize::from(ends)], "{what}, asleep {asleep}");
            }
            back(&mut app, body);
            // Bodies that have fallen a little are put back.
            app.world_mut().get_mut::<Transform>(body).unwrap().translation = Vec3::Y * 0.1;
            app.world_mut().get_mut::<Transform>(upper).unwrap().translation = Vec3::Y * 0.301;
            app.world_mut().entity_mut(body).insert(Velocity::zero());
            app.world_mut().entity_mut(upper).insert(Velocity::zero());
            record.run(&mut app, 200);
            let expected = if ends { [2, 1] } else { [1, 0] };
            assert_eq!(record.counts(body, ground), expected, "{what}, asleep {asleep}");
            assert_eq!(record.counts(body, upper), expected, "{what}, asleep {asleep}");
        }
    }
}

#[test]
fn two_fixed_bodies_report_no_touch() {
    let mut app = app();
    spawn_ground(&mut app);
    let lower = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
    let upper = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.302, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 60);
    assert_eq!(record.counts(lower, upper), [1, 0]);
    app.world_mut().entity_mut(lower).insert(RigidBody::Fixed);
    record.run(&mut app, 60);
    assert_eq!(record.counts(lower, upper), [1, 0]);
    app.world_mut().entity_mut(upper).insert(RigidBody::Fixed);
    record.run(&mut app, 2);
    assert_eq!(record.counts(lower, upper), [1, 1]);
    app.world_mut().get_mut::<Transform>(upper).unwrap().translation.x = 100.0;
    record.run(&mut app, 10);
    app.world_mut().entity_mut(upper).insert((RigidBody::Dynamic, Transform::from_xyz(0.0, 0.302, 0.0)));
    record.run(&mut app, 60);
    assert_eq!(record.counts(lower, upper), [2, 1]);
}

/// The app for a schedule and a mode of time.
fn app_of(kind: &str) -> App {
    match kind {
        "fixed schedule" => {
            let mut app = app_with(MedialPhysicsPlugins::default().in_fixed_schedule(), &assets());
            app.insert_resource(Time::<Fixed>::from_duration(Duration::from_secs_f32(DT)));
            app
        }
        "interpolated" => {
            let mut app = app();
            app.insert_resource(TimestepMode::Interpolated { dt: DT, time_scale: 1.0, substeps: 1 });
            app
        }
        _ => app(),
    }
}

#[test]
fn a_teleport_hits_no_body_on_its_path() {
    for kind in ["every frame", "fixed schedule", "interpolated"] {
        for body_kind in [RigidBody::Dynamic, RigidBody::KinematicVelocityBased, RigidBody::KinematicPositionBased] {
            let mut app = app_of(kind);
            let wall = app.world_mut().spawn((StaticObb::new(0.05, 5.0, 5.0), Transform::from_xyz(4.0, 0.0, 0.0))).id();
            let between = spawn_flying(&mut app, ball(), Transform::from_xyz(5.0, 0.0, 0.0), Velocity::zero());
            let body = spawn_flying(&mut app, ball(), Transform::default(), Velocity::zero());
            let child_mesh = mesh(&mut app, ball());
            let child = app.world_mut().spawn((child_mesh, Transform::from_xyz(0.0, 1.0, 0.0))).id();
            app.world_mut().entity_mut(body).insert((body_kind, TransformInterpolation::default())).add_child(child);
            let mut record = Record::default();
            record.run(&mut app, 10);
            for x in [8.0, 0.0, 8.0] {
                app.world_mut().get_mut::<Transform>(body).unwrap().translation.x = x;
                record.run(&mut app, 10);
                assert!(
                    (position(&mut app, body).x - x).abs() < 1e-3,
                    "{kind} {body_kind:?} to {x}: {}",
                    position(&mut app, body)
                );
            }
            // A body that is moved by its positions sweeps the whole path and hits the bodies on it.
            let reported = usize::from(body_kind == RigidBody::KinematicPositionBased) * 3;
            for (one, other) in [(body, wall), (child, wall)] {
                assert_eq!(record.counts(one, other), [reported; 2], "{kind} {body_kind:?} {one} {other}");
            }
            assert_eq!(record.counts(body, between)[0] > 0, reported > 0, "{kind} {body_kind:?}");
            if reported == 0 {
                assert!(record.started.is_empty(), "{kind} {body_kind:?}: {:?}", record.started);
            }
        }
    }
}

#[test]
fn despawning_ends_each_touch_once() {
    // Despawning during contact, in the frame of spawning, and of a parent.
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let ends = [-0.5, 0.5].map(|x| {
        let mesh = mesh(&mut app, plate());
        app.world_mut().spawn((mesh, Transform::from_xyz(x, 0.0, 0.0))).id()
    });
    let parent =
        app.world_mut().spawn((RigidBody::Dynamic, Transform::from_xyz(0.0, 0.101, 0.0))).add_children(&ends).id();
    let rider = spawn_body(&mut app, plate(), Transform::from_xyz(0.5, 0.302, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 30);
    assert_eq!(record.counts(ends[0], ground), [1, 0]);
    assert_eq!(record.counts(ends[1], rider), [1, 0]);
    for _ in 0..5 {
        let brief = spawn_body(&mut app, plate(), Transform::from_xyz(-0.5, 0.302, 0.0));
        app.world_mut().despawn(brief);
        record.run(&mut app, 1);
        assert_eq!(record.counts(brief, ends[0]), [0, 0]);
    }
    // A child without a body of its own is despawned.
    app.world_mut().despawn(ends[0]);
    record.run(&mut app, 2);
    assert_eq!(record.counts(ends[0], ground), [1, 1]);
    assert_eq!(record.counts(ends[1], ground), [1, 0]);
    app.world_mut().despawn(parent);
    record.run(&mut app, 2);
    assert_eq!(record.counts(ends[1], ground), [1, 1]);
    assert_eq!(record.counts(ends[1], rider), [1, 1]);
    record.run(&mut app, 200);
    assert!((position(&mut app, rider).y - 0.1).abs() < 3e-3);
    assert_eq!(record.counts(rider, ground), [1, 0]);
    app.world_mut().despawn(ground);
    record.run(&mut app, 2);
    assert_eq!(record.counts(rider, ground), [1, 1]);
    assert_eq!(record.started.len(), record.ended.len());
}

#[test]
fn statics_may_change_while_the_world_is_paused() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let shelves: Vec<Entity> = (0..3)
        .map(|i| {
            let at = Transform::from_xyz(2.0 * i as f32, 1.0, 0.0);
            app.world_mut().spawn((StaticObb::new(0.5, 0.1, 0.5), at)).id()
        })
        .collect();
    let bodies: Vec<Entity> =
        (0..3).map(|i| spawn_body(&mut app, plate(), Transform::from_xyz(2.0 * i as f32, 1.201, 0.0))).collect();
    let mut record = Record::default();
    record.run(&mut app, 20);
    set_active(&mut app, false);
    record.run(&mut app, 3);
    app.world_mut().despawn(shelves[0]);
    record.run(&mut app, 3);
    app.world_mut().entity_mut(shelves[1]).insert(ColliderDisabled);
    record.run(&mut app, 3);
    app.world_mut().entity_mut(shelves[1]).remove::<ColliderDisabled>();
    app.world_mut().despawn(bodies[2]);
    record.run(&mut app, 10);
    set_active(&mut app, true);
    record.run(&mut app, 300);
    assert_eq!(record.counts(bodies[0], shelves[0]), [1, 1]);
    assert_eq!(record.counts(bodies[0], ground), [1, 0]);
    assert_eq!(record.counts(bodies[1], shelves[1]), [1, 0]);
    assert_eq!(record.counts(bodies[2], shelves[2]), [1, 1]);
    assert!((position(&mut app, bodies[1]).y - 1.2).abs() < 3e-3);
}

#[test]
fn a_paused_clock_stops_bodies_and_keeps_touches() {
    let mut app = app();
    app.insert_resource(TimestepMode::Variable { max_dt: 0.05, time_scale: 1.0, substeps: 1 });
    let ground = spawn_ground(&mut app);
    let resting = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
    let falling = spawn_body(&mut app, plate(), Transform::from_xyz(2.0, 1.0, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 15);
    app.world_mut().resource_mut::<Time<Virtual>>().pause();
    record.run(&mut app, 2);
    let places = [resting, falling].map(|body| position(&mut app, body));
    assert!(places[1].y > 0.3);
    record.run(&mut app, 60);
    assert_eq!(places, [resting, falling].map(|body| position(&mut app, body)));
    assert_eq!(record.counts(resting, ground), [1, 0]);
    app.world_mut().resource_mut::<Time<Virtual>>().unpause();
    record.run(&mut app, 300);
    for body in [resting, falling] {
        assert!((position(&mut app, body).y - 0.1).abs() < 3e-3 && is_at_rest(&mut app, body));
        assert_eq!(record.counts(body, ground), [1, 0]);
    }
}

#[test]
fn steps_may_change_their_length_and_number() {
    let mut random = Random(5);
    let mut app = app();
    let ground = spawn_ground(&mut app);
    app.world_mut().spawn((StaticObb::new(0.05, 3.0, 3.0), Transform::from_xyz(8.0, 3.0, 0.0)));
    app.world_mut().spawn((StaticObb::new(0.05, 3.0, 3.0), Transform::from_xyz(-8.0, 3.0, 0.0)));
    let resting = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
    let mut record = Record::default();
    for step in 0..400 {
        let dt = [1.0 / 240.0, 1.0 / 60.0, 1.0 / 30.0, 1.0 / 144.0][random.below(4)];
        let substeps = 1 + random.below(4);
        let frame = Duration::from_secs_f32([0.5, 1.0, 2.5][random.below(3)] * dt);
        app.insert_resource(TimeUpdateStrategy::ManualDuration(frame));
        app.insert_resource(match random.below(3) {
            0 => TimestepMode::Fixed { dt, substeps },
            1 => TimestepMode::Variable { max_dt: 0.05, time_scale: 0.25 + random.unit(), substeps },
            _ => TimestepMode::Interpolated { dt, time_scale: 0.25 + random.unit(), substeps },
        });
        if step % 40 == 0 {
            let velocity = Velocity { linear: Vec3::X * 150.0, angular: random.in_ball() * 100.0 };
            spawn_flying(&mut app, ball(), Transform::from_xyz(0.0, 3.0, 0.2 * (step / 40) as f32 - 1.0), velocity);
        }
        record.run(&mut app, 1);
        let mut bodies = app.world_mut().query_filtered::<&Transform, With<MedialMesh>>();
        for transform in bodies.iter(app.world()) {
            assert!(transform.translation.x.abs() < 7.8, "step {step}: {}", transform.translation);
        }
    }
    assert!((position(&mut app, resting).y - 0.1).abs() < 5e-3);
    assert_eq!(record.counts(resting, ground), [1, 0]);
}

#[test]
fn a_fast_spin_has_its_full_turn_at_any_time_scale() {
    for (frame, time_scale, spin) in [(DT, 0.05, 250.0), (12.0 * DT, 1.0, 40.0)] {
        let mut app = app();
        app.insert_resource(TimestepMode::Interpolated { dt: DT, time_scale, substeps: 1 });
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(frame)));
        let velocity = Velocity { linear: Vec3::X, angular: Vec3::Y * spin };
        let rod = MedialAxis::capsule(Vec3::X * -0.4, Vec3::X * 0.4, 0.05).unwrap();
        spawn_flying(&mut app, rod, Transform::default(), velocity);
        run(&mut app, 5);
        let expected = spin * frame * time_scale;
        for _ in 0..10 {
            app.update();
            let step = app.world().resource::<MedialStep>();
            let turn = step.input.bodies[0].sweep.rotation.length();
            assert!((turn - expected).abs() < 0.05 * expected, "{turn}, not {expected}");
            assert!((step.dt - frame * time_scale).abs() < 1e-4, "{}", step.dt);
        }
    }
}

/// Three rods that hit each other at 60 m/s, after `steps` steps of `frames` frames each: their poses, the numbers of messages, and the number of
/// steps with additional solver iterations.
fn struck(frames: u32, steps: u32) -> (Vec<Transform>, [usize; 2], usize) {
    // Powers of two, so that frames add up to steps exactly.
    let dt = 1.0 / 64.0;
    let mut app = app();
    app.insert_resource(TimestepMode::Interpolated { dt, time_scale: 1.0, substeps: 1 });
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(dt / frames as f32)));
    let rods = [-2.0f32, 0.0, 2.0].map(|x| {
        let rod = MedialAxis::capsule(Vec3::Y * -0.4, Vec3::Y * 0.4, 0.05).unwrap();
        let velocity = Velocity { linear: Vec3::X * x * -30.0, angular: Vec3::ONE * x };
        spawn_flying(&mut app, rod, Transform::from_xyz(x, 0.3 * x, 0.0), velocity)
    });
    // The first frame takes no time.
    app.update();
    let (mut record, mut finer) = (Record::default(), 0);
    for _ in 0..steps {
        record.run(&mut app, frames);
        finer += usize::from(rods.iter().any(|&rod| rigid(&mut app, rod).additional_solver_iterations() > 0));
    }
    let places = rods.map(|rod| {
        Transform::from_translation(position(&mut app, rod)).with_rotation(*rigid(&mut app, rod).rotation())
    });
    (places.to_vec(), [record.started.len(), record.ended.len()], finer)
}

#[test]
fn frames_between_steps_change_nothing() {
    let expected = struck(1, 30);
    assert!(expected.1[0] > 1 && expected.2 > 0, "{expected:?}");
    for frames in [2, 4] {
        assert_eq!(struck(frames, 30), expected, "{frames} frames a step");
    }
}

#[test]
fn despawning_the_last_medial_body_ends_its_touch() {
    let mut app = app();
    app.insert_resource(TimestepMode::Interpolated { dt: DT, time_scale: 1.0, substeps: 1 });
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(0.3 * DT)));
    let ground = spawn_ground(&mut app);
    let body = spawn_body(&mut app, ball(), Transform::from_xyz(0.0, 0.21, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 60);
    assert_eq!(record.counts(body, ground), [1, 0]);
    app.world_mut().despawn(body);
    record.run(&mut app, 8);
    assert_eq!(record.counts(body, ground), [1, 1]);
    assert!(app.world().resource::<MedialStep>().input.bodies.is_empty());
}

/// True if rapier's step runs.
#[derive(Resource)]
struct Playing(bool);

#[test]
fn skipped_steps_of_rapier_change_nothing() {
    let mut app = app();
    app.insert_resource(Playing(true))
        .configure_sets(PostUpdate, PhysicsSet::StepSimulation.run_if(|playing: Res<Playing>| playing.0));
    let rods = [-1.0f32, 1.0].map(|x| {
        let rod = MedialAxis::capsule(Vec3::Y * -0.4, Vec3::Y * 0.4, 0.05).unwrap();
        spawn_flying(&mut app, rod, Transform::from_xyz(x, 0.0, 0.0), Velocity::linear(Vec3::X * x * -60.0))
    });
    let far = spawn_flying(&mut app, ball(), Transform::from_xyz(0.0, 9.0, 0.0), Velocity::zero());
    let other = spawn_flying(&mut app, ball(), Transform::from_xyz(3.0, 9.0, 0.0), Velocity::zero());
    let mut record = Record::default();
    let finer = |app: &mut App| rods.map(|rod| rigid(app, rod).additional_solver_iterations());
    for _ in 0..10 {
        record.run(&mut app, 1);
        if finer(&mut app)[0] > 0 {
            break;
        }
    }
    let (hit, poses) = (finer(&mut app), rods.map(|rod| *rigid(&mut app, rod).position()));
    assert!(hit[0] > 0, "the rods do not hit each other");
    app.world_mut().resource_mut::<Playing>().0 = false;
    app.world_mut().get_mut::<Transform>(other).unwrap().translation.x = 0.39;
    record.run(&mut app, 5);
    assert_eq!(finer(&mut app), hit);
    assert_eq!(rods.map(|rod| *rigid(&mut app, rod).position()), poses);
    assert_eq!(record.counts(far, other), [0, 0]);
    app.world_mut().resource_mut::<Playing>().0 = true;
    record.run(&mut app, 3);
    assert_eq!(record.counts(far, other)[0], 1);
    assert_ne!(rods.map(|rod| *rigid(&mut app, rod).position()), poses);
}

#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Rarely;

#[test]
fn a_shape_changed_between_runs_of_a_schedule_is_updated() {
    let mut app = app_with(MedialPhysicsPlugins::default().in_schedule(Rarely), &assets());
    let mesh = mesh(&mut app, ball());
    let body = app.world_mut().spawn((RigidBody::Dynamic, mesh.clone(), Transform::default())).id();
    app.update();
    let step = |app: &mut App| (0..2).for_each(|_| app.world_mut().run_schedule(Rarely));
    let radius = |app: &mut App| {
        let handle = app.world().get::<RapierColliderHandle>(body).unwrap().0;
        let mut contexts = app.world_mut().query::<&RapierContextColliders>();
        let context = contexts.single(app.world()).unwrap();
        context.colliders[handle].shape().compute_local_bounding_sphere().radius
    };
    step(&mut app);
    assert!((radius(&mut app) - 0.2).abs() < 1e-3);
    let larger = MedialAxis::sphere(0.4).unwrap();
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, larger).unwrap();
    run(&mut app, 5);
    step(&mut app);
    assert!((radius(&mut app) - 0.4).abs() < 1e-3);
}

/// Sizes of all collections that might grow.
fn inventory(app: &mut App) -> [usize; 8] {
    let world = app.world_mut();
    let mut contexts =
        world.query::<(&RapierRigidBodySet, &RapierContextColliders, &RapierContextJoints, &RapierContextSimulation)>();
    let (bodies, colliders, _, simulation) = contexts.single(world).unwrap();
    let rapier = [
        bodies.bodies.len(),
        colliders.colliders.len(),
        bodies.entity2body().len(),
        colliders.entity2collider().len(),
        simulation.narrow_phase.contact_pairs().count(),
    ];
    let step = world.resource::<MedialStep>();
    let assets = world.resource::<Assets<MedialAxis>>().len();
    let [a, b, c, d, e] = rapier;
    [a, b, c, d, e, step.infos.len() + step.static_infos.len(), world.resource::<ContactTable>().len(), assets]
}

/// Spawns 10,000 bodies and statics, and despawns each after a few steps.
fn come_and_go(app: &mut App, record: &mut Record) {
    let shape = ball();
    let mut random = Random(8);
    let mut alive = std::collections::VecDeque::new();
    for _ in 0..250 {
        for _ in 0..40 {
            let at = Transform::from_translation(Vec3::new(3.0, 0.3, 0.0) + random.in_ball() * 2.0);
            // A body with an asset of its own, or a static box.
            let entity = if random.below(4) > 0 {
                spawn_body(app, shape.clone(), at)
            } else {
                app.world_mut().spawn((StaticObb::new(0.1, 0.1, 0.1), at)).id()
            };
            alive.push_back(entity);
        }
        while alive.len() > 40 {
            app.world_mut().despawn(alive.pop_front().unwrap());
        }
        record.run(app, 1);
    }
    alive.into_iter().for_each(|entity| _ = app.world_mut().despawn(entity));
    record.run(app, 200);
}

#[test]
fn ten_thousand_spawns_and_despawns_leave_nothing_behind() {
    let mut app = app();
    spawn_ground(&mut app);
    let kept = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 200);
    let before = inventory(&mut app);
    come_and_go(&mut app, &mut record);
    assert!(record.started.len() > 1000, "too few touches: {}", record.started.len());
    assert_eq!(inventory(&mut app), before);
    assert!(is_at_rest(&mut app, kept));
    assert_eq!(record.started.len(), record.ended.len() + 1);
}

/// Resident memory of this process, in bytes.
#[cfg(target_os = "linux")]
fn resident() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * pages.split(' ').nth(1).unwrap().parse::<usize>().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn ten_thousand_spawns_and_despawns_leak_no_memory() {
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "physics::life::child_process_that_measures_memory", "--ignored", "--nocapture"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&child.stdout).into_owned();
    assert!(child.status.success() && text.contains("1 passed"), "{text}");
}

/// Run by [`ten_thousand_spawns_and_despawns_leak_no_memory`].
#[test]
#[cfg(target_os = "linux")]
#[ignore = "needs a process of its own"]
fn child_process_that_measures_memory() {
    let mut app = app();
    // The search for a GPU loads libraries, and starts when a step takes long.
    app.world_mut().resource_mut::<MedialSettings>().backend = MedialBackend::Cpu;
    spawn_ground(&mut app);
    let taken: Vec<usize> = (0..6)
        .map(|_| {
            come_and_go(&mut app, &mut Record::default());
            resident()
        })
        .collect();
    println!("{taken:?}");
    // bevy_rapier keeps 16 bytes of each removed collider. A body with its shape takes many hundreds of bytes.
    assert!(taken[5] < taken[1] + 40_000 * 64, "{taken:?}");
}

#[test]
fn a_shape_loaded_by_a_disabled_body_hits_nothing() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let mesh = MedialMesh(app.world().resource::<Assets<MedialAxis>>().reserve_handle());
    let at = Transform::from_xyz(0.0, 0.5, 0.0);
    let disabled = app.world_mut().spawn((RigidBody::Dynamic, RigidBodyDisabled, mesh.clone(), at)).id();
    run(&mut app, 5);
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, plate()).unwrap();
    run(&mut app, 5);
    assert!(app.world().get::<Collider>(disabled).is_some());
    let falling = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 1.0, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 200);
    assert!((position(&mut app, falling).y - 0.1).abs() < 3e-3, "{}", position(&mut app, falling));
    assert_eq!(record.counts(falling, disabled), [0, 0]);
    app.world_mut().entity_mut(disabled).remove::<RigidBodyDisabled>();
    record.run(&mut app, 200);
    assert!((position(&mut app, disabled).y - 0.3).abs() < 3e-3, "{}", position(&mut app, disabled));
    assert_eq!(record.counts(falling, disabled), [1, 0]);
    assert_eq!(record.counts(falling, ground), [1, 0]);
}

#[test]
fn a_static_may_replace_another_within_a_frame() {
    let mut app = app();
    let old = app.world_mut().spawn((StaticObb::new(0.05, 2.0, 2.0), Transform::from_xyz(4.0, 0.0, 0.0))).id();
    let wall = MedialAxis::rounded_box(Vec3::new(0.05, 2.0, 2.0), 0.02).unwrap();
    let new = spawn_body(&mut app, wall, Transform::from_xyz(8.0, 0.0, 0.0));
    app.world_mut().entity_mut(new).insert(RigidBody::Fixed);
    run(&mut app, 5);
    app.world_mut().despawn(old);
    app.world_mut().entity_mut(new).insert(StaticObb::default());
    let body = spawn_flying(&mut app, ball(), Transform::default(), Velocity::linear(Vec3::X * 200.0));
    let mut record = Record::default();
    record.run(&mut app, 20);
    assert_eq!(record.counts(body, old), [0, 0]);
    assert_eq!(record.counts(body, new)[0], 1);
    let step = app.world().resource::<MedialStep>();
    assert_eq!(step.static_infos.iter().map(|info| info.entity).collect::<Vec<_>>(), [new]);
}
