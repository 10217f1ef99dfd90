//! Static boxes and static shapes at any scale, moved and removed at run time.

use std::time::Duration;

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{
    Collider, ColliderDisabled, ColliderScale, CollisionGroups, Group, RigidBody, RigidBodyDisabled, Sensor, Velocity,
};

use crate::common::*;

fn sharp_plate() -> MedialAxis {
    MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.02).unwrap()
}

#[test]
fn a_static_box_follows_its_scale() {
    let mut app = app();
    let turn = Quat::from_rotation_y(0.5);
    let scale = Vec3::new(6.0, 0.5, 3.0);
    let floor =
        app.world_mut().spawn((StaticObb::new(0.5, 1.0, 0.5), Transform::from_rotation(turn).with_scale(scale))).id();
    // These positions are above the box only because of its scale, one along each wide axis.
    let bodies = [Vec3::new(2.5, 1.0, 0.0), Vec3::new(0.0, 1.0, 1.1)]
        .map(|at| spawn_body(&mut app, sharp_plate(), Transform::from_translation(turn * at).with_rotation(turn)));
    // This position is beside the scaled box, but within its largest extent.
    let outside = spawn_body(&mut app, sharp_plate(), Transform::from_translation(turn * Vec3::new(0.0, 1.0, 2.2)));
    run(&mut app, 300);
    for body in bodies {
        assert!((position(&mut app, body).y - 0.6).abs() < 2e-3, "{}", position(&mut app, body));
        assert!(is_at_rest(&mut app, body));
    }
    assert!(position(&mut app, outside).y < -2.0);
    app.world_mut().get_mut::<Transform>(floor).unwrap().scale.y = 0.25;
    run(&mut app, 300);
    for body in bodies {
        assert!((position(&mut app, body).y - 0.35).abs() < 2e-3, "{}", position(&mut app, body));
    }
    app.world_mut().get_mut::<StaticObb>(floor).unwrap().half_extents.y = 2.0;
    run(&mut app, 400);
    for body in bodies {
        assert!((position(&mut app, body).y - 0.6).abs() < 2e-3, "{}", position(&mut app, body));
    }
}

/// A static of the given kind. Its top is 0.5 m above its entity.
fn spawn_static(app: &mut App, kind: &str, at: Vec3) -> Entity {
    let transform = Transform::from_translation(at);
    match kind {
        "box" => app.world_mut().spawn((StaticObb::new(1.0, 0.5, 1.0), transform)).id(),
        "shape" => {
            let mesh = mesh(app, MedialAxis::rounded_box(Vec3::new(1.0, 0.5, 1.0), 0.1).unwrap());
            app.world_mut().spawn((mesh, StaticObb::default(), RigidBody::Fixed, transform)).id()
        }
        _ => app.world_mut().spawn((Collider::cuboid(1.0, 0.5, 1.0), RigidBody::Fixed, transform)).id(),
    }
}

#[test]
fn contacts_follow_a_moved_static() {
    for kind in ["box", "shape", "rapier"] {
        let mut app = app();
        let floor = spawn_static(&mut app, kind, Vec3::ZERO);
        let body = spawn_body(&mut app, sharp_plate(), Transform::from_xyz(0.0, 0.7, 0.0));
        run(&mut app, 200);
        assert!(is_at_rest(&mut app, body) && (position(&mut app, body).y - 0.6).abs() < 2e-3, "{kind}");
        // The static moves down, and the body must wake up and follow. Then it moves up a little and pushes the body out.
        for height in [-0.8, -0.75] {
            app.world_mut().get_mut::<Transform>(floor).unwrap().translation.y = height;
            run(&mut app, 300);
            let found = position(&mut app, body).y;
            assert!((found - (height + 0.6)).abs() < 2e-3, "{kind} {height}: {found}");
        }
        // The static moves away, and the body falls.
        app.world_mut().get_mut::<Transform>(floor).unwrap().translation.x = 50.0;
        run(&mut app, 60);
        assert!(position(&mut app, body).y < -3.0, "{kind}");
    }
}

#[test]
fn a_fast_body_stops_at_the_current_pose_of_a_static() {
    for kind in ["box", "shape"] {
        let mut app = app();
        let wall = spawn_static(&mut app, kind, Vec3::new(0.0, 0.0, 5.0));
        run(&mut app, 10);
        // The wall moves into the path in the same frame in which the body is spawned.
        app.world_mut().get_mut::<Transform>(wall).unwrap().translation.z = 0.0;
        let velocity = Velocity::linear(Vec3::X * 300.0);
        let body = spawn_flying(&mut app, ball(), Transform::from_xyz(-4.0, 0.0, 0.0), velocity);
        run(&mut app, 3);
        assert!(position(&mut app, body).x < -1.19, "{kind}: {}", position(&mut app, body));
        run(&mut app, 60);
        assert!(position(&mut app, body).x < -1.19, "{kind}: {}", position(&mut app, body));
    }
}

/// Shoots a ball along the x axis through the origin. Returns true if it stops before `x = 0`.
fn is_shot_stopped(app: &mut App) -> bool {
    let body = spawn_flying(app, ball(), Transform::from_xyz(-4.0, 0.0, 0.0), Velocity::linear(Vec3::X * 300.0));
    run(app, 10);
    let x = position(app, body).x;
    app.world_mut().despawn(body);
    assert!(!(-1.19..=40.0).contains(&x), "neither stopped nor let through: {x}");
    x < 0.0
}

#[test]
fn a_despawned_or_disabled_static_stops_nothing() {
    for kind in ["box", "shape"] {
        let mut app = app();
        let wall = spawn_static(&mut app, kind, Vec3::ZERO);
        run(&mut app, 10);
        assert!(is_shot_stopped(&mut app), "{kind}");
        // Each change must take effect in the same frame.
        app.world_mut().entity_mut(wall).insert(ColliderDisabled);
        assert!(!is_shot_stopped(&mut app), "{kind}: disabled");
        app.world_mut().entity_mut(wall).remove::<ColliderDisabled>();
        assert!(is_shot_stopped(&mut app), "{kind}: enabled");
        app.world_mut().entity_mut(wall).insert(Sensor);
        assert!(!is_shot_stopped(&mut app), "{kind}: a sensor");
        app.world_mut().entity_mut(wall).remove::<Sensor>();
        assert!(is_shot_stopped(&mut app), "{kind}: no sensor");
        app.world_mut().entity_mut(wall).insert(CollisionGroups::new(Group::NONE, Group::NONE));
        assert!(!is_shot_stopped(&mut app), "{kind}: in no group");
        app.world_mut().entity_mut(wall).insert(CollisionGroups::default());
        assert!(is_shot_stopped(&mut app), "{kind}: in all groups");
        app.world_mut().entity_mut(wall).insert(RigidBodyDisabled);
        assert!(!is_shot_stopped(&mut app), "{kind}: its body disabled");
        app.world_mut().entity_mut(wall).remove::<RigidBodyDisabled>();
        assert!(is_shot_stopped(&mut app), "{kind}: its body enabled");
        app.world_mut().despawn(wall);
        assert!(!is_shot_stopped(&mut app), "{kind}: despawned");
    }
}

#[test]
fn removing_a_shape_removes_its_collider() {
    let mut app = app();
    let wall = app.world_mut().spawn((StaticObb::new(1.0, 1.0, 1.0), Transform::from_xyz(0.0, -1.0, 0.0))).id();
    let body = spawn_body(&mut app, MedialAxis::sphere(0.2).unwrap(), Transform::from_xyz(0.0, 0.4, 0.0));
    run(&mut app, 60);
    assert!((position(&mut app, body).y - 0.2).abs() < 5e-3);
    app.world_mut().entity_mut(wall).remove::<StaticObb>();
    run(&mut app, 60);
    assert!(app.world().get::<Collider>(wall).is_none(), "the box still has a collider");
    assert!(app.world().get::<RigidBody>(wall).is_none(), "the box still has a body");
    assert!(position(&mut app, body).y < -1.0, "the ball does not fall");
    app.world_mut().entity_mut(body).remove::<MedialMesh>();
    run(&mut app, 2);
    assert!(app.world().get::<Collider>(body).is_none(), "the ball still has a collider");
}

#[test]
fn a_shape_removed_between_steps_removes_only_its_collider() {
    let mut app = app_with(MedialPhysicsPlugins::default().in_fixed_schedule(), &assets());
    app.insert_resource(Time::<Fixed>::from_duration(Duration::from_secs_f32(8.0 * DT)));
    let wall = app.world_mut().spawn((StaticObb::default(), Transform::default())).id();
    let body = spawn_flying(&mut app, ball(), Transform::from_xyz(9.0, 0.0, 0.0), Velocity::zero());
    let [replaced, swapped] = [wall, body].map(|entity| {
        let copy = app.world_mut().entity_mut(entity).clone_and_spawn();
        app.world_mut().get_mut::<Transform>(copy).unwrap().translation.y = 5.0;
        copy
    });
    run(&mut app, 30);
    for entity in [wall, body, replaced, swapped] {
        assert!(app.world().get::<Collider>(entity).is_some(), "{entity}");
    }
    app.world_mut().entity_mut(wall).remove::<StaticObb>();
    app.world_mut().entity_mut(body).remove::<MedialMesh>();
    let own = || (Collider::ball(0.3), ColliderScale::Absolute(Vec3::splat(2.0)));
    app.world_mut().entity_mut(replaced).remove::<StaticObb>().insert(own());
    app.world_mut().entity_mut(swapped).remove::<MedialMesh>().insert(own());
    run(&mut app, 30);
    for entity in [wall, body] {
        assert!(app.world().get::<Collider>(entity).is_none(), "{entity} still has its collider");
    }
    for entity in [replaced, swapped] {
        let radius = app.world().get::<Collider>(entity).and_then(Collider::as_ball).map(|ball| ball.radius());
        assert_eq!(radius, Some(0.6), "{entity}");
    }
}

#[test]
fn a_mirrored_box_collides_like_a_box() {
    let mut app = app();
    let mirror = app.world_mut().spawn(Transform::from_scale(Vec3::new(1.0, 1.0, -1.0))).id();
    let at = |x: f32, scale: Vec3| (StaticObb::new(2.0, 0.5, 2.0), Transform::from_xyz(x, -0.5, 0.0).with_scale(scale));
    let floors = [
        at(0.0, Vec3::new(-1.0, 1.0, 1.0)),
        at(10.0, Vec3::new(1.0, -1.0, 1.0)),
        at(20.0, Vec3::ONE),
        at(30.0, Vec3::NEG_ONE),
    ];
    let floors = floors.map(|floor| app.world_mut().spawn(floor).id());
    app.world_mut().entity_mut(mirror).add_child(floors[2]);
    let bodies = [0.0, 10.0, 20.0, 30.0].map(|x| spawn_body(&mut app, sharp_plate(), Transform::from_xyz(x, 0.3, 0.0)));
    let stand = |app: &mut App| {
        // The colliders are valid from the first step on.
        run(app, 1);
        for floor in floors {
            let half = app.world().get::<Collider>(floor).unwrap().as_cuboid().unwrap().half_extents();
            assert!((half - Vec3::new(2.0, 0.5, 2.0)).abs().max_element() < 1e-3, "{half}");
        }
        run(app, 59);
        for body in bodies {
            assert!((position(app, body).y - 0.1).abs() < 5e-3, "{}", position(app, body));
        }
    };
    stand(&mut app);
    // Mirror both boxes back and forth.
    for sign in [1.0, -1.0] {
        app.world_mut().get_mut::<Transform>(floors[0]).unwrap().scale = Vec3::new(sign, 1.0, 1.0);
        app.world_mut().get_mut::<Transform>(mirror).unwrap().scale = Vec3::new(1.0, 1.0, sign);
        stand(&mut app);
    }
}

/// Sheared hierarchies of transforms produce such statics.
#[test]
fn touches_of_a_sheared_static_have_valid_normals() {
    for stretch in [0.8, 1.3] {
        let mut app = app();
        let turned = Transform::from_rotation(Quat::from_rotation_x(0.3));
        let floor = app.world_mut().spawn((StaticObb::new(2.0, 0.5, 2.0), turned)).id();
        app.world_mut().spawn(Transform::from_scale(Vec3::new(1.0, stretch, 1.0))).add_child(floor);
        app.update();
        let rotation = app.world().get::<GlobalTransform>(floor).unwrap().rotation();
        assert!(!rotation.is_normalized(), "{rotation} is normalised");
        let mut record = Record::default();
        for speed in [0.0, 100.0] {
            let body = spawn_body(&mut app, sharp_plate(), Transform::from_xyz(0.01 * speed, 1.2, 0.0));
            app.world_mut().entity_mut(body).insert(Velocity::linear(Vec3::NEG_Y * speed));
            record.run(&mut app, 30);
        }
        let of_floor = |started: &MedialContactStarted| started.entity2 == floor;
        let touches = record.started.iter().filter(|(_, started)| of_floor(started)).count();
        assert!(touches >= 2, "{stretch}: {touches}");
        for (_, started) in &record.started {
            let touch = &started.touch;
            assert!(touch.normal.is_normalized(), "{stretch}: {touch:?}");
            assert!(!of_floor(started) || touch.normal.y.abs() > 0.9, "{stretch}: {touch:?}");
        }
    }
}
