//! Rapier's solver and events treat medial contacts like those of its own shapes.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{prelude::*, rapier::dynamics::SpringCoefficients};

use crate::common::*;

const RADIUS: f32 = 0.2;

/// A medial ball, and a ball of rapier with the same radius.
fn spawn_both(app: &mut App, at: [Vec3; 2], extra: impl Bundle + Clone) -> [Entity; 2] {
    let medial = spawn_body(app, MedialAxis::sphere(RADIUS).unwrap(), Transform::from_translation(at[0]));
    let own = (RigidBody::Dynamic, Collider::ball(RADIUS), Transform::from_translation(at[1]));
    let own = app.world_mut().spawn(own).id();
    for entity in [medial, own] {
        app.world_mut().entity_mut(entity).insert(extra.clone());
    }
    [medial, own]
}

const RULES: [CoefficientCombineRule; 4] = [
    CoefficientCombineRule::Average,
    CoefficientCombineRule::Min,
    CoefficientCombineRule::Multiply,
    CoefficientCombineRule::Max,
];

#[test]
fn friction_combines_by_every_rule() {
    let mut speeds = Vec::new();
    for combine_rule in RULES {
        let mut app = app();
        let slope = Quat::from_rotation_z(-0.5);
        let friction = Friction { coefficient: 0.2, combine_rule };
        app.world_mut().spawn((StaticObb::new(50.0, 0.5, 5.0), friction, Transform::from_rotation(slope)));
        let friction = Friction { coefficient: 0.9, combine_rule };
        let at = [-1.0, 1.0].map(|z| slope * Vec3::new(0.0, 0.5 + RADIUS, z));
        let bodies = spawn_both(&mut app, at, (friction, LockedAxes::ROTATION_LOCKED));
        run(&mut app, 60);
        let [medial, own] = bodies.map(|body| rigid(&mut app, body).linvel().length());
        assert!((medial - own).abs() < 0.05, "{combine_rule:?}: {medial} {own}");
        speeds.push(medial);
    }
    // The lowest friction gives the highest speed; a friction of 0.9 holds the body.
    assert!(speeds[2] > speeds[0] && speeds[1] > speeds[0] && speeds[3] < 0.05, "{speeds:?}");
}

#[test]
fn restitution_combines_by_every_rule() {
    let mut heights = Vec::new();
    for combine_rule in RULES {
        let mut app = app();
        let restitution = Restitution { coefficient: 0.4, combine_rule };
        let ground = spawn_ground(&mut app);
        app.world_mut().entity_mut(ground).insert(restitution);
        let restitution = Restitution { coefficient: 0.9, combine_rule };
        let bodies = spawn_both(&mut app, [Vec3::new(-2.0, 1.5, 0.0), Vec3::new(2.0, 1.5, 0.0)], restitution);
        let mut highest = [0.0f32; 2];
        let mut bounced = [false; 2];
        for _ in 0..90 {
            app.update();
            for i in 0..2 {
                let body = rigid(&mut app, bodies[i]);
                bounced[i] |= body.linvel().y > 0.1;
                if bounced[i] {
                    highest[i] = highest[i].max(body.translation().y - RADIUS);
                }
            }
        }
        assert!((highest[0] - highest[1]).abs() < 0.1, "{combine_rule:?}: {highest:?}");
        heights.push(highest[0]);
    }
    assert!(heights[3] > heights[0] && heights[0] > heights[1] && heights[1] > heights[2], "{heights:?}");
}

#[test]
fn dominance_acts_alike_on_medial_and_rapier_bodies() {
    for group in [-10, 0, 10] {
        let mut app = app();
        let still = spawn_both(&mut app, [Vec3::ZERO, Vec3::Y * 5.0], GravityScale(0.0));
        let flight = (GravityScale(0.0), Velocity::linear(Vec3::X * 4.0), Dominance::group(group));
        let fast = spawn_both(&mut app, [Vec3::X * -1.0, Vec3::new(-1.0, 5.0, 0.0)], flight);
        run(&mut app, 30);
        for bodies in [still, fast] {
            let [medial, own] = bodies.map(|body| rigid(&mut app, body).linvel().x);
            assert!((medial - own).abs() < 0.02, "group {group}: {medial} {own}");
        }
        let speed = rigid(&mut app, fast[0]).linvel().x;
        assert!((group > 0) == (speed > 3.9), "group {group}: {speed}");
    }
}

#[test]
fn a_light_box_carries_a_thousand_times_its_mass() {
    for half in [0.2, 0.23, 0.275, 0.3] {
        let mut app = app();
        spawn_ground(&mut app);
        app.update();
        let axis = MedialAxis::rounded_box(Vec3::splat(half), 0.02).unwrap();
        let [_, heavy] = [(1.0, half), (1000.0, 3.0 * half + 0.01)].map(|(density, height)| {
            let body = spawn_body(&mut app, axis.clone(), Transform::from_xyz(0.0, height, 0.0));
            app.world_mut().entity_mut(body).insert(ColliderMassProperties::Density(density));
            body
        });
        run(&mut app, 720);
        let sunk = 3.0 * half - position(&mut app, heavy).y;
        assert!(sunk < 0.03, "{half}: sunk by {sunk} m");
    }
}

#[test]
fn loaded_contacts_sink_less_than_with_the_default_of_rapier() {
    // A light ball between a floor and a heavy ball, which only move vertically.
    let sunk = |softness: Option<SpringCoefficients<f32>>| {
        let mut app = app();
        spawn_ground(&mut app);
        let upright = LockedAxes::all() & !LockedAxes::TRANSLATION_LOCKED_Y;
        let [_, heavy] = [(1.0, RADIUS), (60.0, 3.0 * RADIUS)].map(|(density, height)| {
            let ball = MedialAxis::sphere(RADIUS).unwrap();
            let body = spawn_body(&mut app, ball, Transform::from_xyz(0.0, height, 0.0));
            app.world_mut().entity_mut(body).insert((ColliderMassProperties::Density(density), upright));
            body
        });
        run(&mut app, 2);
        if let Some(softness) = softness {
            *contact_softness(&mut app) = softness;
        }
        run(&mut app, 300);
        3.0 * RADIUS - position(&mut app, heavy).y
    };
    let [stiff, soft] = [None, Some(SpringCoefficients::contact_defaults())].map(sunk);
    // A quarter of the overlap with the light ball, and the same overlap with the floor.
    assert!(stiff < 0.01 && soft > 0.018, "{stiff} m, {soft} m");
}

#[test]
fn contacts_are_stiffer_only_in_worlds_with_medial_shapes_and_without_own_coefficients() {
    let default = SpringCoefficients::contact_defaults();
    let own = SpringCoefficients { damping_ratio: 7.0, ..default };
    for (before, expected) in [(default, SpringCoefficients::contact_static_defaults()), (own, own)] {
        let mut app = app();
        app.world_mut().spawn((RigidBody::Dynamic, Collider::ball(RADIUS)));
        run(&mut app, 2);
        assert_eq!(*contact_softness(&mut app), default, "rapier's bodies alone");
        *contact_softness(&mut app) = before;
        spawn_body(&mut app, MedialAxis::sphere(RADIUS).unwrap(), Transform::from_xyz(2.0, 0.0, 0.0));
        run(&mut app, 2);
        assert_eq!(*contact_softness(&mut app), expected);
        *contact_softness(&mut app) = default;
        spawn_body(&mut app, MedialAxis::sphere(RADIUS).unwrap(), Transform::from_xyz(4.0, 0.0, 0.0));
        run(&mut app, 2);
        assert_eq!(*contact_softness(&mut app), default, "a later change is kept");
    }
}

/// Rapier reports more than the weight of a body at rest, also for its own bodies.
#[test]
fn contact_forces_equal_those_of_rapier_bodies() {
    let loads = [false, true].map(|own| {
        let mut app = app();
        spawn_ground(&mut app);
        let events =
            (ActiveEvents::CONTACT_FORCE_EVENTS | ActiveEvents::COLLISION_EVENTS, ContactForceEventThreshold(0.0));
        let body = if own {
            let collider = Collider::cuboid(0.2, 0.05, 0.2);
            app.world_mut().spawn((RigidBody::Dynamic, collider, Transform::from_xyz(0.0, 0.2, 0.0))).id()
        } else {
            spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.2, 0.0))
        };
        app.world_mut().entity_mut(body).insert((events, Sleeping::disabled()));
        run(&mut app, 200);
        app.world_mut().resource_mut::<Messages<ContactForceEvent>>().clear();
        run(&mut app, 1);
        let forces = app.world_mut().resource_mut::<Messages<ContactForceEvent>>().drain().collect::<Vec<_>>();
        assert_eq!(forces.len(), 1);
        forces[0].total_force.y.abs() / (rigid(&mut app, body).mass() * 9.81)
    });
    println!("{loads:?}");
    assert!((loads[0] / loads[1] - 1.0).abs() < 0.01 && loads[1] > 0.9, "{loads:?}");
}

#[test]
fn collision_events_of_rapier_start_and_stop_once() {
    let mut app = app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.5, 0.0));
    app.world_mut().entity_mut(body).insert((ActiveEvents::COLLISION_EVENTS, Restitution::coefficient(0.0)));
    let (mut started, mut stopped) = (0, 0);
    for step in 0..200 {
        if step == 150 {
            app.world_mut().get_mut::<Transform>(body).unwrap().translation.y = 5.0;
        }
        if step < 160 {
            app.update();
        }
        for event in app.world_mut().resource_mut::<Messages<CollisionEvent>>().drain() {
            match event {
                CollisionEvent::Started(..) => started += 1,
                CollisionEvent::Stopped(..) => stopped += 1,
            }
        }
    }
    assert_eq!((started, stopped), (1, 1));
}

#[test]
fn sleeping_bodies_wake_when_hit_or_without_floor() {
    let mut app = app();
    spawn_ground(&mut app);
    let plate = mesh(&mut app, MedialAxis::rounded_box(Vec3::new(1.0, 0.1, 1.0), 0.1).unwrap());
    // Outside the path of the flying ball.
    let at = |y: f32| Transform::from_xyz(0.0, y, 5.0);
    let floor = app.world_mut().spawn((RigidBody::Fixed, plate, at(1.0))).id();
    let above = spawn_body(&mut app, model("torus"), at(1.3));
    let hit = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.1, 0.0));
    run(&mut app, 200);
    assert!(is_at_rest(&mut app, above) && is_at_rest(&mut app, hit));
    let axis = MedialAxis::sphere(RADIUS).unwrap();
    spawn_flying(&mut app, axis, Transform::from_xyz(-3.0, 0.1, 0.0), Velocity::linear(Vec3::X * 60.0));
    app.world_mut().despawn(floor);
    run(&mut app, 6);
    assert!(rigid(&mut app, hit).linvel().length() > 1.0);
    run(&mut app, 60);
    assert!(position(&mut app, above).y < 0.2, "{}", position(&mut app, above));
}
