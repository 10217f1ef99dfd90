//! Contacts by entity, in messages, events and the system parameter [`MedialContacts`].

use bevy::{ecs::system::RunSystemOnce, prelude::*};
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{RigidBody, Velocity};

use crate::common::*;

/// A dumbbell whose shapes are two children of the body. Returns the body and the children.
fn spawn_dumbbell(app: &mut App, height: f32) -> (Entity, [Entity; 2]) {
    let ball = mesh(app, MedialAxis::sphere(0.2).unwrap());
    let body = app.world_mut().spawn((RigidBody::Dynamic, Transform::from_xyz(0.0, height, 0.0))).id();
    let child = |x: f32| (ball.clone(), Transform::from_xyz(x, 0.0, 0.0), ChildOf(body));
    let children = [-0.5, 0.5].map(|x| app.world_mut().spawn(child(x)).id());
    (body, children)
}

/// The bodies and the pairs of colliders of all events that an entity received.
#[derive(Resource, Default)]
struct Heard(Vec<(Option<Entity>, Option<Entity>, Entity)>);

#[test]
fn a_body_observes_the_contacts_of_its_child_colliders() {
    let mut app = app();
    app.init_resource::<Heard>();
    let ground = spawn_ground(&mut app);
    let (body, children) = spawn_dumbbell(&mut app, 0.3);
    app.world_mut()
        .entity_mut(body)
        .observe(|on: On<MedialContactStarted>, mut heard: ResMut<Heard>| {
            assert!(on.touch.normal.y < -0.99, "{:?}", on.touch);
            heard.0.push((on.body1, on.body2, on.original_event_target()));
        })
        .observe(|on: On<MedialContactEnded>, mut heard: ResMut<Heard>| {
            heard.0.push((on.body1, on.body2, on.original_event_target()));
        });
    let mut record = Record::default();
    record.run(&mut app, 60);
    for (_, started) in &record.started {
        let bodies = [(started.entity1, started.body1), (started.entity2, started.body2)];
        for (entity, rigid_body) in bodies {
            assert_eq!(rigid_body, Some(if children.contains(&entity) { body } else { ground }));
        }
    }
    let started = children.map(|child| (Some(body), Some(ground), child));
    let mut heard = std::mem::take(&mut app.world_mut().resource_mut::<Heard>().0);
    heard.sort_by_key(|(_, _, child)| *child != children[0]);
    assert_eq!(heard, started);
    app.world_mut().entity_mut(body).insert(Velocity::linear(Vec3::Y * 5.0));
    run(&mut app, 10);
    assert_eq!(app.world().resource::<Heard>().0.len(), 2, "each child has left the ground");
}

#[test]
fn contacts_of_a_body_are_those_of_its_colliders() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let (body, mut children) = spawn_dumbbell(&mut app, 0.3);
    children.sort();
    let other = spawn_body(&mut app, MedialAxis::sphere(0.2).unwrap(), Transform::from_xyz(3.0, 0.3, 0.0));
    run(&mut app, 40);
    let check = move |contacts: MedialContacts| {
        assert_eq!(contacts.iter().count(), 3);
        let mut found: Vec<Entity> = contacts.of(body).map(|pair| pair.entity1).collect();
        found.sort();
        assert_eq!(found, children);
        assert_eq!(contacts.of(children[1]).count(), 1);
        for (entity, down) in [(body, -1.0), (other, -1.0), (ground, 1.0)] {
            for pair in contacts.of(entity) {
                assert!([pair.body1, pair.body2].contains(&Some(ground)));
                assert!(pair.entity1 == entity || pair.body1 == Some(entity));
                let points: Vec<_> = pair.points().collect();
                assert!(!points.is_empty());
                for point in points {
                    assert!(point.normal.y * down > 0.99 && point.separation.abs() < 5e-3, "{point:?}");
                    assert!(point.point.y.abs() < 5e-3, "{point:?}");
                }
            }
        }
        assert_eq!(contacts.of(ground).count(), 3);
    };
    app.world_mut().run_system_once(check).unwrap();
}

/// Sums of the impulses on a body, in newton seconds.
fn impulse_on(app: &mut App, body: Entity) -> Vec3 {
    let sum = move |contacts: MedialContacts| contacts.of(body).map(|pair| -pair.impulse()).sum::<Vec3>();
    app.world_mut().run_system_once(sum).unwrap()
}

#[test]
fn impulses_of_a_resting_stack_carry_its_weight() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let plate = MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.05).unwrap();
    let [lower, upper] = [0.1, 0.3].map(|y| spawn_body(&mut app, plate.clone(), Transform::from_xyz(0.0, y, 0.0)));
    // Long enough to settle, but not to fall asleep.
    run(&mut app, 25);
    let weight = rigid(&mut app, upper).mass() * 9.81 * DT;
    for (body, weights) in [(upper, 1.0), (lower, 1.0), (ground, -2.0)] {
        assert!(!rigid(&mut app, body).is_sleeping() || body == ground);
        let ratio = impulse_on(&mut app, body) / (weights * weight);
        // Rapier counts the first of four substeps twice.
        assert!((0.98..1.27).contains(&ratio.y) && ratio.with_y(0.0).length() < 0.01, "{body}: {ratio}");
    }
}

#[test]
fn the_impulse_of_a_push_changes_the_momentum_of_both_bodies() {
    let mut app = app();
    let ball = MedialAxis::sphere(0.2).unwrap();
    let velocity = Velocity::linear(Vec3::X * 3.0);
    let pushed = spawn_flying(&mut app, ball.clone(), Transform::from_xyz(0.5, 0.0, 0.0), Velocity::zero());
    let pusher = spawn_flying(&mut app, ball, Transform::default(), velocity);
    let mut sum = Vec3::ZERO;
    for _ in 0..20 {
        app.update();
        let impulse = impulse_on(&mut app, pushed);
        assert_eq!(impulse_on(&mut app, pusher), -impulse);
        sum += impulse;
    }
    let momentum = rigid(&mut app, pushed).linvel() * rigid(&mut app, pushed).mass();
    assert!(momentum.x > 0.04 && sum.distance(momentum) < 0.01 * momentum.x, "{sum} {momentum}");
}
