//! Several rapier contexts, and every mode of time.

use std::time::Duration;

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{medial_axis::MedialAxis, prelude::*, rapier::OwedTime};
use bevy_rapier3d::{
    plugin::context::{RapierContextEntityLink, RapierContextSimulation, RapierRigidBodySet},
    prelude::*,
};

use crate::common::*;

#[test]
fn bodies_of_two_contexts_do_not_collide() {
    let mut app = app();
    app.update();
    let second = app.world_mut().spawn(RapierContextSimulation::default()).id();
    let link = RapierContextEntityLink(second);
    // The first context has a floor at height 0, the second one at height -1.
    spawn_ground(&mut app);
    let floor = (StaticObb::new(10.0, 1.0, 10.0), Transform::from_xyz(0.0, -2.0, 0.0), link);
    let floor = app.world_mut().spawn(floor).id();
    let here = spawn_body(&mut app, ball(), Transform::from_xyz(0.0, 0.5, 0.0));
    let there = spawn_body(&mut app, ball(), Transform::from_xyz(0.0, 0.6, 0.0));
    app.world_mut().entity_mut(there).insert(link);
    let shot = mesh(&mut app, ball());
    let fast = (RigidBody::Dynamic, shot, Transform::from_xyz(-9.0, -0.8, 0.0), Velocity::linear(Vec3::X * 200.0));
    let fast = app.world_mut().spawn((fast, GravityScale(0.0), link)).id();
    let mut record = Record::default();
    record.run(&mut app, 240);
    for (body, height) in [(here, 0.2), (there, -0.8)] {
        assert!((position_of(&app, body).y - height).abs() < 2e-3, "{}", position_of(&app, body));
    }
    assert_eq!(record.counts(here, there), [0, 0]);
    assert!(position_of(&app, fast).x > 100.0);
    // Rapier requires that the bodies of a context are despawned first.
    app.world_mut().despawn(there);
    app.world_mut().despawn(fast);
    app.world_mut().despawn(floor);
    app.update();
    app.world_mut().despawn(second);
    record.run(&mut app, 5);
    assert!((position_of(&app, here).y - 0.2).abs() < 2e-3);
}

fn position_of(app: &App, entity: Entity) -> Vec3 {
    app.world().get::<Transform>(entity).unwrap().translation
}

#[test]
fn a_spinning_shot_stops_at_a_thin_wall_in_every_mode_of_time() {
    let modes = [
        TimestepMode::Fixed { dt: DT, substeps: 1 },
        TimestepMode::Fixed { dt: DT, substeps: 4 },
        TimestepMode::Variable { max_dt: DT, time_scale: 1.0, substeps: 1 },
        TimestepMode::Variable { max_dt: DT, time_scale: 0.3, substeps: 2 },
        TimestepMode::Variable { max_dt: 0.1, time_scale: 3.0, substeps: 1 },
        TimestepMode::Interpolated { dt: DT, time_scale: 1.0, substeps: 1 },
        TimestepMode::Interpolated { dt: 0.3 * DT, time_scale: 1.0, substeps: 2 },
        TimestepMode::Interpolated { dt: 1.7 * DT, time_scale: 0.5, substeps: 1 },
    ];
    for mode in modes {
        for (speed, spin) in [(3.0, 0.0), (200.0, 0.0), (200.0, 100.0)] {
            let mut app = app();
            app.insert_resource(mode);
            app.world_mut().spawn((StaticObb::new(0.01, 5.0, 5.0), Transform::from_xyz(2.0, 0.0, 0.0)));
            let rod = MedialAxis::capsule(Vec3::X * -0.5, Vec3::X * 0.5, 0.02).unwrap();
            let velocity = Velocity { linear: Vec3::X * speed, angular: Vec3::new(0.1, 0.3, 0.9) * spin };
            let body = spawn_flying(&mut app, rod, Transform::default(), velocity);
            let mut stops = 0;
            for _ in 0..150 {
                app.update();
                stops += app.world().resource::<MedialStep>().output.stops.len();
                let x = position(&mut app, body).x;
                assert!(x < 2.0, "{mode:?}, {speed} m/s, {spin} rad/s: {x}");
            }
            assert!(
                (stops > 0 || speed < 10.0) && rigid(&mut app, body).linvel().x < 0.5 * speed,
                "{mode:?} {speed} {spin}"
            );
        }
    }
}

#[test]
fn a_paused_context_keeps_its_additional_iterations() {
    let mut app = app();
    app.update();
    let second = app.world_mut().spawn(RapierContextSimulation::default()).id();
    spawn_body(&mut app, ball(), Transform::default());
    let rods = [-1.0f32, 1.0].map(|x| {
        let rod = MedialAxis::capsule(Vec3::Y * -0.4, Vec3::Y * 0.4, 0.05).unwrap();
        let rod = spawn_flying(&mut app, rod, Transform::from_xyz(x, 0.0, 0.0), Velocity::linear(Vec3::X * x * -60.0));
        app.world_mut().entity_mut(rod).insert(RapierContextEntityLink(second));
        rod
    });
    let finer = |app: &App| {
        let bodies = &app.world().get::<RapierRigidBodySet>(second).unwrap().bodies;
        rods.map(|rod| {
            let handle = app.world().get::<RapierRigidBodyHandle>(rod).unwrap().0;
            bodies.get(handle).unwrap().additional_solver_iterations()
        })
    };
    for _ in 0..10 {
        app.update();
        if finer(&app)[0] > 0 {
            break;
        }
    }
    let hit = finer(&app);
    assert!(hit[0] > 0, "the rods do not hit each other");
    app.world_mut().get_mut::<RapierConfiguration>(second).unwrap().physics_pipeline_active = false;
    run(&mut app, 5);
    assert_eq!(finer(&app), hit);
    app.world_mut().get_mut::<RapierConfiguration>(second).unwrap().physics_pipeline_active = true;
    run(&mut app, 10);
    assert_eq!(finer(&app), [0; 2]);
}

#[test]
fn a_paused_context_keeps_the_time_that_is_owed_to_its_bodies() {
    let mut app = app();
    app.update();
    let second = app.world_mut().spawn(RapierContextSimulation::default()).id();
    let link = RapierContextEntityLink(second);
    spawn_body(&mut app, ball(), Transform::default());
    app.world_mut().spawn((StaticObb::new(0.01, 5.0, 5.0), Transform::from_xyz(2.0, 0.0, 0.0), link));
    let shot = spawn_flying(&mut app, ball(), Transform::default(), Velocity::linear(Vec3::X * 200.0));
    app.world_mut().entity_mut(shot).insert(link);
    let owed = |app: &App| format!("{:?}", app.world().resource::<OwedTime>());
    let nothing = owed(&app);
    let hits = (0..5).any(|_| {
        app.update();
        owed(&app) != nothing
    });
    assert!(hits, "the shot does not stop at the wall");
    let at_impact = owed(&app);
    app.world_mut().get_mut::<RapierConfiguration>(second).unwrap().physics_pipeline_active = false;
    run(&mut app, 5);
    assert_eq!(owed(&app), at_impact);
    app.world_mut().get_mut::<RapierConfiguration>(second).unwrap().physics_pipeline_active = true;
    run(&mut app, 5);
    assert_eq!(owed(&app), nothing);
}

#[test]
fn a_stopped_shot_is_drawn_in_front_of_the_wall() {
    let mut app = app();
    app.insert_resource(TimestepMode::Interpolated { dt: DT, time_scale: 1.0, substeps: 1 });
    app.world_mut().spawn((StaticObb::new(0.01, 2.0, 2.0), Transform::from_xyz(3.0, 0.0, 0.0)));
    let shot = spawn_flying(&mut app, ball(), Transform::default(), Velocity::linear(Vec3::X * 150.0));
    app.world_mut().entity_mut(shot).insert(TransformInterpolation::default());
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(2.5 * DT)));
    let mut early = 0;
    for frame in 0..8 {
        app.update();
        let step = app.world().resource::<MedialStep>();
        early += step.output.stops.iter().filter(|stop| stop.fraction < 0.5).count();
        let x = position_of(&app, shot).x;
        assert!(x < 2.8, "frame {frame}: shown at {x}");
    }
    assert!(early > 0, "the shot does not stop in the first step of a frame");
}

#[test]
fn fixed_steps_are_interpolated_at_any_frame_rate() {
    let app_at = |rate: f32| {
        let mut app = app_without_steps(MedialPhysicsPlugins::fixed(rate), &assets());
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(0.01)));
        app
    };
    let mut app = app_at(20.0);
    let ball = spawn_body(&mut app, MedialAxis::sphere(0.2).unwrap(), Transform::default());
    run(&mut app, 20);
    let height = |app: &App| app.world().get::<Transform>(ball).unwrap().translation.y;
    let (mut heights, mut steps) = (vec![height(&app)], 0);
    for _ in 0..50 {
        let before = position(&mut app, ball).y;
        app.update();
        heights.push(height(&app));
        steps += u32::from(position(&mut app, ball).y < before);
    }
    // Half a second.
    assert!((9..=11).contains(&steps), "{steps} steps");
    assert!(heights.is_sorted_by(|a, b| a > b), "a frame shows no motion: {heights:?}");
    for rate in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let mode = *app_at(rate).world().resource::<TimestepMode>();
        assert!(matches!(mode, TimestepMode::Interpolated { dt, .. } if (dt - 1.0 / 60.0).abs() < 1e-6), "{mode:?}");
    }
}
