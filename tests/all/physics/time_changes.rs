//! Frames without steps, steps of varying length, paused clocks and teleports.

use std::time::Duration;

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{medial_axis::MedialAxis, plugin::MedialStep, prelude::*};
use bevy_rapier3d::prelude::{PhysicsSet, RigidBody, TimestepMode, TransformInterpolation, Velocity};

use crate::common::*;

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
