//! Shapes that are loaded, fail to load, or change at run time.

use std::{fs, path::PathBuf, time::Duration};

use bevy::{
    asset::{AssetServer, LoadState},
    ecs::schedule::ScheduleLabel,
    prelude::*,
    time::TimeUpdateStrategy,
};
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{
    plugin::context::RapierContextColliders,
    prelude::{Collider, RapierColliderHandle, RigidBody, RigidBodyDisabled, Velocity},
};

use crate::{common::*, log};

/// Position of an entity's collider in rapier.
fn collider_position(app: &mut App, entity: Entity) -> Vec3 {
    let handle = app.world().get::<RapierColliderHandle>(entity).unwrap().0;
    let mut contexts = app.world_mut().query::<&RapierContextColliders>();
    contexts.single(app.world()).unwrap().colliders[handle].translation()
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
