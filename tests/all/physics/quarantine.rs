//! A body with an invalid value is disabled, is logged once, and returns after a repair. Other bodies are not affected.

use bevy::prelude::*;
use bevy_medial::prelude::*;
use bevy_rapier3d::prelude::{
    Collider, ColliderDisabled, Damping, ExternalForce, ExternalImpulse, GravityScale, RigidBody, RigidBodyDisabled,
    Velocity,
};

use crate::{common::*, log};

/// An invalid value: name, damage and repair.
type Spoil = (&'static str, fn(&mut EntityWorldMut), fn(&mut EntityWorldMut));

fn set_velocity(body: &mut EntityWorldMut, linear: Vec3, angular: Vec3) {
    body.insert(Velocity { linear, angular });
}

fn set_transform(body: &mut EntityWorldMut, edit: impl Fn(&mut Transform)) {
    edit(&mut body.get_mut::<Transform>().unwrap());
}

/// Moves the body to rest slightly above its place in [`stack`].
fn put_back(body: &mut EntityWorldMut) {
    set_transform(body, |transform| *transform = Transform::from_xyz(0.0, 0.35, 0.0));
    set_velocity(body, Vec3::ZERO, Vec3::ZERO);
}

const SPOILS: [Spoil; 12] = [
    ("translation", |b| set_transform(b, |t| t.translation.y = f32::NAN), put_back),
    ("endless translation", |b| set_transform(b, |t| t.translation.x = f32::INFINITY), put_back),
    ("far translation", |b| set_transform(b, |t| t.translation.x = 1e30), put_back),
    ("rotation", |b| set_transform(b, |t| t.rotation.x = f32::NAN), put_back),
    ("velocity", |b| set_velocity(b, Vec3::NAN, Vec3::ZERO), put_back),
    ("angular velocity", |b| set_velocity(b, Vec3::ZERO, Vec3::new(0.0, f32::NEG_INFINITY, 0.0)), put_back),
    ("huge velocity", |b| set_velocity(b, Vec3::X * 1e30, Vec3::ZERO), put_back),
    ("huge angular velocity", |b| set_velocity(b, Vec3::ZERO, Vec3::X * 1e30), put_back),
    (
        "force",
        |b| _ = b.insert(ExternalForce { force: Vec3::NAN, torque: Vec3::ZERO }),
        |b| _ = b.insert(ExternalForce::default()),
    ),
    (
        "torque",
        |b| _ = b.insert(ExternalForce { force: Vec3::ZERO, torque: Vec3::Z * f32::INFINITY }),
        |b| _ = b.remove::<ExternalForce>().insert(Velocity::zero()),
    ),
    ("gravity", |b| _ = b.insert(GravityScale(f32::NAN)), |b| _ = b.insert(GravityScale(1.0))),
    (
        "damping",
        |b| _ = b.insert(Damping { linear_damping: f32::NAN, angular_damping: 0.0 }),
        |b| _ = b.insert(Damping::default()),
    ),
];

/// A ground, a stack of three bodies on it and a body beside it. Returns the middle body, the other bodies, and the ground.
fn stack(app: &mut App, name: &str) -> (Entity, [Entity; 3], Entity) {
    let ground = spawn_ground(app);
    let [lower, middle, upper] =
        [0.101, 0.302, 0.503].map(|height| spawn_body(app, plate(), Transform::from_xyz(0.0, height, 0.0)));
    let beside = spawn_body(app, plate(), Transform::from_xyz(3.0, 0.101, 0.0));
    app.world_mut().entity_mut(middle).insert(Name::new(name.to_string()));
    (middle, [lower, upper, beside], ground)
}

#[test]
fn an_invalid_body_is_disabled_and_returns_after_repair() {
    log::keep();
    for (what, spoil, repair) in SPOILS {
        let name = format!("spoiled by {what}");
        let mut app = app();
        let (middle, [lower, upper, beside], ground) = stack(&mut app, &name);
        let mut record = Record::default();
        record.run(&mut app, 120);
        assert_eq!(record.counts(middle, lower), [1, 0], "{what}");
        spoil(&mut app.world_mut().entity_mut(middle));
        record.run(&mut app, 300);
        assert!(!rigid(&mut app, middle).is_enabled(), "{what}");
        assert!(app.world().get::<RigidBodyDisabled>(middle).is_some(), "{what}");
        assert_eq!(log::lines(&name).len(), 1, "{what}: {:?}", log::lines(&name));
        for pair in [(middle, lower), (middle, upper)] {
            assert_eq!(record.counts(pair.0, pair.1), [1, 1], "{what}");
        }
        // The body above has fallen, and the body below still stands.
        for (body, height) in [(lower, 0.1), (upper, 0.3), (beside, 0.1)] {
            let at = position(&mut app, body);
            assert!((at.y - height).abs() < 5e-3 && is_at_rest(&mut app, body), "{what}: {at}");
        }
        assert_eq!(record.counts(beside, ground), [1, 0], "{what}");
        // Despawn the body in its place, then repair it.
        app.world_mut().despawn(upper);
        repair(&mut app.world_mut().entity_mut(middle));
        record.run(&mut app, 300);
        let at = position(&mut app, middle);
        assert!((at.y - 0.3).abs() < 5e-3 && is_at_rest(&mut app, middle), "{what}: {at}");
        assert!(app.world().get::<RigidBodyDisabled>(middle).is_none(), "{what}");
        assert_eq!(record.counts(middle, lower), [2, 1], "{what}");
        assert_eq!(log::lines(&name).len(), 1, "{what}");
    }
}

#[test]
fn a_body_with_an_invalid_impulse_returns_with_a_new_velocity() {
    log::keep();
    let mut app = app();
    let (middle, [lower, ..], _) = stack(&mut app, "spoiled by impulse");
    run(&mut app, 120);
    app.world_mut().entity_mut(middle).insert(ExternalImpulse { impulse: Vec3::NAN, torque_impulse: Vec3::ZERO });
    run(&mut app, 10);
    assert_eq!(log::lines("spoiled by impulse").len(), 1);
    assert!(!rigid(&mut app, middle).is_enabled() && rigid(&mut app, lower).is_enabled());
    app.world_mut().entity_mut(middle).insert(Velocity::zero());
    run(&mut app, 10);
    assert!(rigid(&mut app, middle).is_enabled());
}

#[test]
fn a_body_spawned_invalid_appears_after_repair() {
    log::keep();
    for (what, transform, velocity) in [
        ("a place", Transform::from_xyz(0.0, f32::NAN, 0.0), Velocity::zero()),
        ("a far place", Transform::from_xyz(0.0, 1e20, 0.0), Velocity::zero()),
        ("a turn", Transform::from_rotation(Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0)), Velocity::zero()),
        ("a velocity", Transform::from_xyz(0.0, 1.0, 0.0), Velocity::linear(Vec3::INFINITY)),
    ] {
        for kind in [RigidBody::Dynamic, RigidBody::Fixed, RigidBody::KinematicPositionBased] {
            let name = format!("spawned with {what} {kind:?}");
            let mut app = app();
            let ground = spawn_ground(&mut app);
            let good = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.3, 0.0));
            let bad = spawn_body(&mut app, plate(), transform);
            app.world_mut().entity_mut(bad).insert((kind, velocity, Name::new(name.clone())));
            let mut record = Record::default();
            record.run(&mut app, 200);
            assert!((position(&mut app, good).y - 0.1).abs() < 5e-3, "{name}");
            assert_eq!(log::lines(&name).len(), 1, "{name}: {:?}", log::lines(&name));
            app.world_mut().entity_mut(bad).insert((Transform::from_xyz(1.5, 0.3, 0.0), Velocity::zero()));
            record.run(&mut app, 200);
            let height = if kind == RigidBody::Dynamic { 0.1 } else { 0.3 };
            assert!((position(&mut app, bad).y - height).abs() < 5e-3, "{name}");
            assert_eq!(record.counts(bad, ground), [usize::from(kind == RigidBody::Dynamic), 0], "{name}");
        }
    }
}

#[test]
fn an_invalid_child_collider_does_not_disable_its_body() {
    log::keep();
    // One of two shapes of a body.
    let mut app = app();
    spawn_ground(&mut app);
    let [near, far] = [-0.5, 0.5].map(|x| {
        let mesh = mesh(&mut app, plate());
        app.world_mut().spawn((mesh, Transform::from_xyz(x, 0.0, 0.0), Name::new("spoiled child"))).id()
    });
    let body =
        app.world_mut().spawn((RigidBody::Dynamic, Transform::from_xyz(0.0, 0.2, 0.0))).add_children(&[near, far]).id();
    run(&mut app, 200);
    assert!(is_at_rest(&mut app, body));
    app.world_mut().get_mut::<Transform>(far).unwrap().translation.z = f32::NAN;
    run(&mut app, 200);
    assert!(rigid(&mut app, body).is_enabled() && position(&mut app, body).is_finite());
    assert!(app.world().get::<ColliderDisabled>(far).is_some() && app.world().get::<ColliderDisabled>(near).is_none());
    assert_eq!(log::lines("spoiled child").len(), 1);
    app.world_mut().entity_mut(far).insert(Transform::from_xyz(0.5, 0.0, 0.0));
    app.world_mut().entity_mut(body).insert(Transform::from_xyz(0.0, 0.2, 0.0));
    run(&mut app, 200);
    assert!(app.world().get::<ColliderDisabled>(far).is_none());
    assert!((position(&mut app, body).y - 0.1).abs() < 5e-3 && is_at_rest(&mut app, body));

    // A box whose size is not a number and is repaired later.
    app.world_mut().entity_mut(body).insert(Transform::from_xyz(0.0, 0.2, 0.0));
    let shelf = app.world_mut().spawn((
        StaticObb::new(2.0, f32::NAN, 2.0),
        Transform::from_xyz(0.0, 1.0, 0.0),
        Name::new("spoiled shelf"),
    ));
    let shelf = shelf.id();
    let falling = spawn_body(&mut app, plate(), Transform::from_xyz(1.5, 2.0, 1.5));
    run(&mut app, 200);
    assert!((position(&mut app, falling).y - 0.1).abs() < 5e-3, "{}", position(&mut app, falling));
    assert_eq!(log::lines("spoiled shelf").len(), 1);
    app.world_mut().entity_mut(shelf).insert(StaticObb::new(2.0, 0.1, 2.0));
    app.world_mut().entity_mut(falling).insert(Transform::from_xyz(1.5, 2.0, 1.5));
    run(&mut app, 200);
    assert!((position(&mut app, falling).y - 1.2).abs() < 5e-3, "{}", position(&mut app, falling));
}

/// Bodies are checked only while a medial mesh or a static box exists. The return of a disabled body must not depend on that.
#[test]
fn an_invalid_body_returns_without_medial_meshes() {
    let mut app = app();
    let own = (RigidBody::Dynamic, Collider::ball(0.1), GravityScale(0.0), Transform::from_xyz(5.0, 0.0, 0.0));
    let own = app.world_mut().spawn(own).id();
    let is_disabled = |app: &App| app.world().get::<RigidBodyDisabled>(own).is_some();
    let medial = spawn_body(&mut app, plate(), Transform::default());
    run(&mut app, 3);
    set_velocity(&mut app.world_mut().entity_mut(own), Vec3::NAN, Vec3::ZERO);
    run(&mut app, 3);
    assert!(is_disabled(&app));
    app.world_mut().despawn(medial);
    run(&mut app, 3);
    assert!(is_disabled(&app) && app.world().resource::<MedialStep>().input.bodies.is_empty());
    app.world_mut().entity_mut(own).insert(Velocity::linear(Vec3::X));
    run(&mut app, 30);
    assert!(!is_disabled(&app));
    assert!((position(&mut app, own).x - 5.5).abs() < 0.1);
}

#[test]
fn a_collider_and_its_body_can_be_repaired_in_any_order() {
    log::keep();
    let size = |size: f32| StaticObb::new(size, 0.1, 0.3);
    let spoil_body = |body: &mut EntityWorldMut| set_velocity(body, Vec3::NAN, Vec3::ZERO);
    for collider_first in [true, false] {
        let name = format!("spoiled twice, collider first: {collider_first}");
        let mut app = app();
        let ground = spawn_ground(&mut app);
        let at = Transform::from_xyz(0.0, 0.3, 0.0);
        let body = app.world_mut().spawn((RigidBody::Dynamic, size(0.3), at, Name::new(name.clone()))).id();
        let medial = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.6, 0.0));
        run(&mut app, 60);
        app.world_mut().entity_mut(body).insert(size(f32::NAN));
        run(&mut app, 5);
        assert!(app.world().get::<ColliderDisabled>(body).is_some(), "{name}");
        spoil_body(&mut app.world_mut().entity_mut(body));
        run(&mut app, 5);
        assert!(app.world().get::<RigidBodyDisabled>(body).is_some(), "{name}");
        assert_eq!(log::lines(&name).len(), 2, "{:?}", log::lines(&name));
        app.world_mut().entity_mut(medial).insert(Transform::from_xyz(0.0, 0.6, 0.0));
        for repairs_collider in [collider_first, !collider_first] {
            let mut body = app.world_mut().entity_mut(body);
            if repairs_collider {
                body.insert(size(0.3));
            } else {
                body.insert((at, Velocity::zero()));
            }
            run(&mut app, 2);
        }
        assert!(app.world().get::<ColliderDisabled>(body).is_none(), "{name}");
        assert!(app.world().get::<RigidBodyDisabled>(body).is_none(), "{name}");
        app.world_mut().entity_mut(body).insert(at);
        app.world_mut().entity_mut(medial).insert(Transform::from_xyz(0.0, 0.6, 0.0));
        let mut record = Record::default();
        record.run(&mut app, 200);
        for (what, height) in [(body, 0.1), (medial, 0.3)] {
            assert!((position(&mut app, what).y - height).abs() < 5e-3, "{name}: {}", position(&mut app, what));
        }
        assert!(record.counts(medial, ground) == [0, 0] && record.counts(medial, body)[0] > 0, "{name}");
    }
}

#[test]
fn an_invalid_rapier_body_does_not_affect_medial_bodies() {
    log::keep();
    let mut app = app();
    spawn_ground(&mut app);
    let crate_ = (RigidBody::Dynamic, Collider::cuboid(0.3, 0.1, 0.3), Transform::from_xyz(0.0, 0.101, 0.0));
    let lower = app.world_mut().spawn((crate_, Name::new("spoiled crate"))).id();
    let upper = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.302, 0.0));
    run(&mut app, 60);
    app.world_mut().entity_mut(lower).insert(ExternalForce { force: Vec3::NAN, torque: Vec3::ZERO });
    run(&mut app, 200);
    assert_eq!(log::lines("spoiled crate").len(), 1);
    assert!((position(&mut app, upper).y - 0.1).abs() < 5e-3 && is_at_rest(&mut app, upper));
}

#[test]
fn steps_at_the_largest_speed_end_with_finite_poses() {
    for velocity in [
        Velocity::linear(Vec3::new(-9e8, 3e8, 9e8)),
        Velocity { linear: Vec3::X * 9e8, angular: Vec3::new(9e8, -9e8, 1e8) },
        Velocity { linear: Vec3::ZERO, angular: Vec3::Y * 9e8 },
    ] {
        let mut app = app();
        spawn_ground(&mut app);
        let others: Vec<Entity> =
            (0..4).map(|i| spawn_body(&mut app, plate(), Transform::from_xyz(i as f32, 0.101, 0.0))).collect();
        let fast = spawn_flying(&mut app, model("bear"), Transform::from_xyz(-3.0, 1.0, 0.0), velocity);
        for _ in 0..30 {
            app.update();
            assert!(others.iter().all(|&body| position(&mut app, body).is_finite()));
            assert!(app.world().get::<Transform>(fast).unwrap().translation.is_finite());
        }
    }
}
