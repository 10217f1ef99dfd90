//! Bodies before and after their shape is loaded.

use bevy::prelude::*;
use bevy_medial::{geometry::Pose3, medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{
    prelude::{
        AdditionalMassProperties, Collider, ExternalImpulse, GravityScale, RigidBody, RigidBodyDisabled, Velocity,
    },
    rapier::dynamics::SpringCoefficients,
};

use crate::common::*;

/// A shape that [`load`] loads.
fn reserve(app: &App) -> MedialMesh {
    MedialMesh(app.world().resource::<Assets<MedialAxis>>().reserve_handle())
}

fn load(app: &mut App, mesh: &MedialMesh, axis: MedialAxis) {
    app.world_mut().resource_mut::<Assets<MedialAxis>>().insert(&mesh.0, axis).unwrap();
}

const IMPULSE: ExternalImpulse = ExternalImpulse { impulse: Vec3::X, torque_impulse: Vec3::new(0.0, 0.02, 0.0) };

#[test]
fn a_body_stands_still_until_its_shape_is_loaded() {
    for on_child in [false, true] {
        let mut app = app();
        let mesh = reserve(&app);
        let velocity = Velocity { linear: Vec3::X, angular: Vec3::Y };
        let mass = AdditionalMassProperties::Mass(1.0);
        let body = app.world_mut().spawn((RigidBody::Dynamic, Transform::default(), velocity, mass)).id();
        let shape = if on_child { app.world_mut().spawn(ChildOf(body)).id() } else { body };
        app.world_mut().entity_mut(shape).insert(mesh.clone());
        run(&mut app, 100);
        assert_eq!(*rigid(&mut app, body).position(), Pose3::IDENTITY, "{on_child}");
        load(&mut app, &mesh, ball());
        run(&mut app, 10);
        let moved = rigid(&mut app, body);
        assert!((moved.translation().x - 10.0 * DT).abs() < 1e-3 && moved.translation().y < -0.05, "{on_child}");
        assert!((moved.angvel().y - 1.0).abs() < 1e-3, "{on_child}");
    }
}

#[test]
fn a_disabled_body_stays_disabled_and_a_body_without_its_shape_moves() {
    let mut app = app();
    let mesh = reserve(&app);
    let [disabled, free] = [0.0, 5.0].map(|y| {
        let body = (RigidBody::Dynamic, mesh.clone(), Transform::from_xyz(0.0, y, 0.0), Velocity::linear(Vec3::X));
        app.world_mut().spawn(body).id()
    });
    app.world_mut().entity_mut(disabled).insert(RigidBodyDisabled);
    run(&mut app, 5);
    assert!([disabled, free].iter().all(|&body| position(&mut app, body).x == 0.0));
    app.world_mut().entity_mut(free).remove::<MedialMesh>();
    load(&mut app, &mesh, ball());
    run(&mut app, 5);
    assert!(position(&mut app, disabled).x == 0.0 && !rigid(&mut app, disabled).is_enabled());
    assert!(position(&mut app, free).x > 3.0 * DT);
    app.world_mut().entity_mut(disabled).remove::<RigidBodyDisabled>();
    run(&mut app, 5);
    assert!(position(&mut app, disabled).x > 3.0 * DT);
}

#[test]
fn impulses_before_a_shape_is_loaded_act_with_it() {
    // The shape is on the body or on its child.
    for on_child in [false, true] {
        // The number of frames before each impulse; the shape is loaded in the frame of the fourth one, before the step.
        for frames in [[0, 0, 0], [1, 5, 100], [0, 100, 5]] {
            let mut app = app();
            let mesh = reserve(&app);
            let loaded = spawn_flying(&mut app, ball(), Transform::from_xyz(0.0, 5.0, 0.0), Velocity::zero());
            let body = app.world_mut().spawn((RigidBody::Dynamic, Transform::default(), GravityScale(0.0))).id();
            if on_child {
                app.world_mut().spawn((mesh.clone(), Transform::default(), ChildOf(body)));
            } else {
                app.world_mut().entity_mut(body).insert(mesh.clone());
            }
            for wait in frames {
                run(&mut app, wait);
                let known = app.world().get::<ExternalImpulse>(body).copied().unwrap_or_default();
                app.world_mut().entity_mut(body).insert(known + IMPULSE);
            }
            load(&mut app, &mesh, ball());
            let mut sum = ExternalImpulse::default();
            (0..3).for_each(|_| sum += IMPULSE);
            app.world_mut().entity_mut(loaded).insert(sum);
            run(&mut app, 10);
            let [expected, got] = [loaded, body].map(|entity| rigid(&mut app, entity));
            assert!(expected.linvel().x > 50.0 * DT && expected.angvel().y > 1.0);
            assert!(got.linvel().distance(expected.linvel()) < 1e-4 * expected.linvel().x, "{on_child} {frames:?}");
            assert!(got.angvel().distance(expected.angvel()) < 1e-4 * expected.angvel().y, "{on_child} {frames:?}");
            let [expected, got] = [loaded, body].map(|entity| position(&mut app, entity));
            assert!((got - expected + 5.0 * Vec3::Y).length() < 1e-3, "{on_child} {frames:?}: {got} {expected}");
        }
    }
}

#[test]
fn a_collider_stands_in_until_the_shape_is_loaded() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let mesh = reserve(&app);
    let stand_in = (RigidBody::Dynamic, mesh.clone(), Collider::ball(0.5), Transform::from_xyz(0.0, 0.6, 0.0));
    let body = app.world_mut().spawn(stand_in).id();
    let mut record = Record::default();
    record.run(&mut app, 60);
    assert!((position(&mut app, body).y - 0.5).abs() < 3e-3, "{}", position(&mut app, body));
    assert!(app.world().get::<MedialLevel>(body).is_none());
    assert_eq!(*contact_softness(&mut app), SpringCoefficients::contact_defaults());
    let mass = rigid(&mut app, body).mass();
    load(&mut app, &mesh, ball());
    record.run(&mut app, 1);
    assert_eq!(*contact_softness(&mut app), SpringCoefficients::contact_static_defaults());
    assert!(app.world().get::<MedialLevel>(body).is_some());
    assert!((mass / rigid(&mut app, body).mass() / 2.5_f32.powi(3) - 1.0).abs() < 1e-3);
    record.run(&mut app, 60);
    assert!((position(&mut app, body).y - 0.2).abs() < 3e-3, "{}", position(&mut app, body));
    assert_eq!(record.counts(body, ground)[0], 1);
}
