//! Observers of an entity receive each touch once, from the entity's side.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{RigidBody, Velocity};

use crate::common::*;

/// Events that observers received.
#[derive(Resource, Default)]
struct Heard {
    started: Vec<(Entity, MedialContactStarted)>,
    ended: Vec<(Entity, MedialContactEnded)>,
}

/// Records the events of the entity.
fn listen(app: &mut App, entity: Entity) {
    app.init_resource::<Heard>();
    app.world_mut()
        .entity_mut(entity)
        .observe(move |on: On<MedialContactStarted>, mut heard: ResMut<Heard>| {
            heard.started.push((entity, *on.event()))
        })
        .observe(move |on: On<MedialContactEnded>, mut heard: ResMut<Heard>| heard.ended.push((entity, *on.event())));
}

/// A ball that hits a wall. The events of both are recorded.
fn shot() -> (App, Entity, Entity) {
    let mut app = app();
    let wall = app.world_mut().spawn((StaticObb::new(0.1, 2.0, 2.0), Transform::from_xyz(4.0, 0.0, 0.0))).id();
    let body = spawn_flying(&mut app, ball(), Transform::default(), Velocity::linear(Vec3::X * 100.0));
    listen(&mut app, wall);
    listen(&mut app, body);
    (app, wall, body)
}

#[test]
fn both_entities_observe_a_touch_once_from_their_side() {
    let (mut app, wall, body) = shot();
    let mut record = Record::default();
    record.run(&mut app, 30);
    app.world_mut().get_mut::<Transform>(body).unwrap().translation.x = -50.0;
    record.run(&mut app, 10);
    assert_eq!(record.counts(body, wall), [1, 1]);
    let (message, ended) = (record.started[0].1, record.ended[0].1);
    let heard = app.world().resource::<Heard>();
    assert_eq!(heard.started.len(), 2);
    assert_eq!(heard.ended.len(), 2);
    for (entity, other) in [(body, wall), (wall, body)] {
        let started = heard.started.iter().find(|(listener, _)| *listener == entity).unwrap().1;
        assert_eq!([started.entity1, started.entity2], [entity, other]);
        let sign = if entity == message.entity1 { 1.0 } else { -1.0 };
        assert_eq!(started.touch.normal, message.touch.normal * sign);
        assert_eq!(started.touch.point, message.touch.point);
        assert_eq!(started.touch.approach_speed, message.touch.approach_speed);
        assert!(started.touch.normal.x * if entity == body { 1.0 } else { -1.0 } > 0.99);
        let reported = heard.ended.iter().find(|(listener, _)| *listener == entity).unwrap().1;
        assert_eq!([reported.entity1, reported.entity2], [entity, other]);
    }
    assert_eq!([ended.entity1, ended.entity2], [message.entity1, message.entity2]);
}

#[test]
fn the_remaining_entity_observes_the_end() {
    let (mut app, wall, body) = shot();
    let mut record = Record::default();
    record.run(&mut app, 3);
    assert_eq!(record.counts(body, wall), [1, 0]);
    app.world_mut().despawn(body);
    record.run(&mut app, 3);
    assert_eq!(record.counts(body, wall), [1, 1]);
    let heard = app.world().resource::<Heard>();
    let ended = MedialContactEnded { entity1: wall, entity2: body, body1: Some(wall), body2: Some(body) };
    assert_eq!(heard.ended, [(wall, ended)]);
}

#[test]
fn changes_by_an_observer_take_effect() {
    let (mut app, wall, body) = shot();
    app.world_mut().entity_mut(body).observe(
        |on: On<MedialContactStarted>, mut bodies: Query<(&Transform, &mut Velocity)>| {
            let (transform, mut velocity) = bodies.get_mut(on.entity1).unwrap();
            // The transform is already that of the impact.
            assert!((transform.translation.x - 3.7).abs() < 0.01, "{}", transform.translation);
            velocity.linear = Vec3::Y * 5.0;
        },
    );
    let mut record = Record::default();
    record.run(&mut app, 10);
    assert_eq!(record.counts(body, wall)[0], 1);
    let velocity = rigid(&mut app, body).linvel();
    assert!(velocity.distance(Vec3::Y * 5.0) < 0.5, "{velocity}");
}

#[test]
fn an_observer_may_despawn_its_entity() {
    let (mut app, wall, body) = shot();
    app.world_mut()
        .entity_mut(body)
        .observe(|on: On<MedialContactStarted>, mut commands: Commands| commands.entity(on.entity1).despawn());
    let mut record = Record::default();
    record.run(&mut app, 10);
    assert!(app.world().get_entity(body).is_err());
    assert_eq!(record.counts(body, wall), [1, 1]);
    let heard = app.world().resource::<Heard>();
    assert_eq!(heard.ended.len(), 1, "{:?}", heard.ended);
}

#[test]
fn a_global_observer_receives_both_sides_of_a_touch() {
    let (mut app, ..) = shot();
    app.add_observer(|on: On<MedialContactStarted>, mut commands: Commands| {
        let (entity1, entity2) = (on.entity1, on.entity2);
        commands.queue(move |world: &mut World| world.get_resource_or_init::<All>().0.push([entity1, entity2]));
    });
    run(&mut app, 10);
    let all = &app.world().resource::<All>().0;
    assert_eq!(all.len(), 2);
    assert_eq!(all[0], [all[1][1], all[1][0]]);
}

#[derive(Resource, Default)]
struct All(Vec<[Entity; 2]>);

#[test]
fn a_pair_whose_order_changes_keeps_its_touch() {
    let mut app = app();
    spawn_ground(&mut app);
    let flat = MedialAxis::rounded_box(Vec3::new(0.5, 0.1, 0.5), 0.05).unwrap();
    let lower = spawn_body(&mut app, flat.clone(), Transform::from_xyz(0.0, 0.101, 0.0));
    let upper = spawn_body(&mut app, flat, Transform::from_xyz(0.0, 0.302, 0.0));
    listen(&mut app, lower);
    let mut record = Record::default();
    record.run(&mut app, 60);
    let before = record
        .started
        .iter()
        .find(|(_, m)| m.entity1.min(m.entity2) == lower.min(upper) && record.counts(lower, upper) == [1, 0]);
    assert_eq!(before.unwrap().1.entity1, lower, "a body comes before one that was spawned later");
    // A static is always second.
    app.world_mut().entity_mut(lower).insert((StaticObb::default(), RigidBody::Fixed));
    record.run(&mut app, 60);
    let step = app.world().resource::<bevy_medial::plugin::MedialStep>();
    assert!(step.output.pairs.iter().any(|pair| step.info(pair.first).entity == upper) || is_at_rest(&mut app, upper));
    assert_eq!(record.counts(lower, upper), [1, 0]);
}
