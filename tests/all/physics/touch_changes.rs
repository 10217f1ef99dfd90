//! Messages of touches while bodies are put to sleep, changed, paused or despawned.

use std::time::Duration;

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{medial_axis::MedialAxis, plugin::MedialStep, prelude::*};
use bevy_rapier3d::prelude::{
    ColliderDisabled, CollisionGroups, Group, RapierConfiguration, RigidBody, RigidBodyDisabled, Sensor, Sleeping,
    TimestepMode, Velocity,
};

use crate::common::*;

fn set_active(app: &mut App, active: bool) {
    let mut configuration = app.world_mut().query::<&mut RapierConfiguration>();
    configuration.single_mut(app.world_mut()).unwrap().physics_pipeline_active = active;
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
