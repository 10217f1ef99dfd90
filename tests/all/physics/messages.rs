//! Messages, sensors, groups and the switch for continuous collision.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{CollisionGroups, Group, RigidBody, Sensor, Velocity};

use crate::common::*;

/// A thin wall across the x axis: a box, a static shape or a resting body.
fn spawn_wall(app: &mut App, kind: &str) -> Entity {
    let half = Vec3::new(0.05, 1.0, 1.0);
    let shape = MedialAxis::rounded_box(half, 0.02).unwrap();
    match kind {
        "box" => app.world_mut().spawn((StaticObb { half_extents: half }, Transform::default())).id(),
        "shape" => {
            let mesh = mesh(app, shape);
            app.world_mut().spawn((mesh, StaticObb::default(), RigidBody::Fixed, Transform::default())).id()
        }
        _ => spawn_flying(app, shape, Transform::default(), Velocity::zero()),
    }
}

/// Returns true if the ball is on the side of the wall that it was shot from, in the frame of the wall. A wall that is hit turns.
fn is_in_front(app: &mut App, wall: Entity, body: Entity) -> bool {
    let ball = position(app, body);
    rigid(app, wall).position().inverse_transform_point(ball).x < 0.0
}

const WALLS: [&str; 3] = ["box", "shape", "body"];

/// Shoots a ball at a wall; no step of the ball ends near the wall. Returns the wall, the ball and the messages.
fn shoot(
    kind: &str,
    wall_first: bool,
    speed: f32,
    edit: impl Fn(&mut App, Entity, Entity),
) -> (App, [Entity; 2], Record) {
    let mut app = app();
    let shot = |app: &mut App| {
        let velocity = Velocity::linear(Vec3::X * speed);
        spawn_flying(app, ball(), Transform::from_xyz(-1.5 * speed * DT, 0.1, 0.1), velocity)
    };
    let (wall, body) = if wall_first {
        let wall = spawn_wall(&mut app, kind);
        (wall, shot(&mut app))
    } else {
        let body = shot(&mut app);
        (spawn_wall(&mut app, kind), body)
    };
    edit(&mut app, wall, body);
    let mut record = Record::default();
    record.run(&mut app, 30);
    (app, [wall, body], record)
}

#[test]
fn a_shot_is_reported_once_with_position_and_speed() {
    for kind in WALLS {
        for wall_first in [true, false] {
            let (mut app, [wall, body], mut record) = shoot(kind, wall_first, 200.0, |_, _, _| {});
            assert!(is_in_front(&mut app, wall, body), "{kind}");
            assert_eq!(record.started.len(), 1, "{kind}: {:?}", record.started);
            let (step, message) = record.started[0];
            assert_eq!(step, 2, "{kind}");
            // The ball may be on either side of the pair; a static is always second.
            let sign = if message.entity1 == body { 1.0 } else { -1.0 };
            let [first, second] = if sign > 0.0 { [body, wall] } else { [wall, body] };
            assert_eq!([message.entity1, message.entity2], [first, second], "{kind}");
            assert!(kind == "body" || message.entity1 == body);
            assert!(!message.sensor);
            let touch = message.touch;
            // The second step starts half a step's displacement before the middle of the wall.
            let displacement = 200.0 * DT;
            assert!((touch.fraction - (0.5 * displacement - 0.25) / displacement).abs() < 1e-3, "{kind}: {touch:?}");
            assert!(touch.point.distance(Vec3::new(-0.05, 0.1, 0.1)) < 2e-3, "{kind}: {touch:?}");
            assert!(touch.normal.distance(Vec3::X * sign) < 1e-3, "{kind}: {touch:?}");
            assert!((touch.approach_speed - 200.0).abs() < 0.01, "{kind}: {touch:?}");
            assert_eq!(touch.separation, 0.0);
            // The touch ends once when the ball is moved away.
            app.world_mut().get_mut::<Transform>(body).unwrap().translation.y = 50.0;
            record.run(&mut app, 20);
            assert_eq!(record.counts(wall, body), [1, 1], "{kind}");
            let ended = record.ended[0].1;
            assert_eq!([ended.entity1, ended.entity2], [first, second], "{kind}");
        }
    }
}

#[test]
fn starts_and_ends_of_touches_alternate() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let resting = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.06, 0.0));
    let mut bodies = vec![resting];
    let mut random = Random(3);
    for i in 0..6 {
        let place = Vec3::new(2.0 + 2.5 * (i % 3) as f32, 2.0, 2.5 * (i / 3) as f32);
        let at = Transform::from_translation(place).with_rotation(random.rotation());
        bodies.push(spawn_body(&mut app, model(["bear", "bug", "cow", "deer", "bunny", "spider"][i]), at));
    }
    let mut record = Record::default();
    record.run(&mut app, 600);
    assert_eq!(record.counts(resting, ground), [1, 0]);
    let mut again = 0;
    for &body in &bodies {
        let [started, ended] = record.counts(body, ground);
        // There is one more start than ends because the body still lies on the ground.
        assert_eq!(started, ended + 1);
        again += ended;
        let mut reported: Vec<(u32, bool)> =
            record.started.iter().filter(|m| m.1.entity1 == body).map(|m| (m.0, true)).collect();
        reported.extend(record.ended.iter().filter(|m| m.1.entity1 == body).map(|m| (m.0, false)));
        reported.sort();
        for (i, (_, is_start)) in reported.iter().enumerate() {
            assert_eq!(*is_start, i % 2 == 0);
        }
    }
    assert!(again > 0, "no body has bounced");
    for (_, message) in &record.started {
        let touch = message.touch;
        assert_eq!(message.entity2, ground);
        assert!((0.0..=1.0).contains(&touch.fraction) && touch.normal.distance(-Vec3::Y) < 1e-3, "{touch:?}");
        assert!(touch.separation.abs() <= 2e-2 && touch.point.y.abs() < 2e-2, "{touch:?}");
    }
}

#[test]
fn a_sensor_reports_touches_and_stops_no_body() {
    for kind in WALLS {
        for wall_is_sensor in [true, false] {
            for wall_first in [true, false] {
                let (mut app, [wall, body], record) = shoot(kind, wall_first, 200.0, |app, wall, body| {
                    app.world_mut().entity_mut(if wall_is_sensor { wall } else { body }).insert(Sensor);
                });
                let x = position(&mut app, body).x;
                assert!((x - 28.5 * 200.0 * DT).abs() < 0.01, "{kind}: {x}");
                assert_eq!(record.counts(wall, body), [1, 1], "{kind}");
                assert!(record.started.iter().all(|(_, message)| message.sensor), "{kind}");
                // A body without response is not pushed.
                assert!(rigid(&mut app, wall).linvel().length() < 1e-4, "{kind}");
            }
        }
    }
}

#[test]
fn a_sensor_behind_a_wall_does_not_report_stopped_bodies() {
    for kind in ["box", "shape"] {
        for stops in [true, false] {
            let sensor = std::cell::Cell::new(Entity::PLACEHOLDER);
            let (_, [wall, body], record) = shoot(kind, true, 200.0, |app, _, body| {
                // In the path of the ball in the step of its impact on the wall.
                let place = Transform::from_xyz(1.0, 0.0, 0.0);
                sensor.set(app.world_mut().spawn((StaticObb::new(0.1, 1.0, 1.0), Sensor, place)).id());
                if !stops {
                    app.world_mut().entity_mut(body).insert(MedialCcd::DISABLED);
                }
            });
            assert_eq!(record.counts(wall, body)[0], 1, "{kind}, stops {stops}");
            assert_eq!(record.counts(sensor.get(), body)[0], usize::from(!stops), "{kind}, stops {stops}");
        }
    }
}

#[test]
fn groups_prevent_contacts_and_stops() {
    let (mut passed, mut stopped) = (0, 0);
    for kind in WALLS {
        for (wall_group, filter) in [(0b01, 0b10), (0b10, 0b10), (0b11, 0b01)] {
            let (mut app, [wall, body], record) = shoot(kind, true, 200.0, |app, wall, body| {
                let groups = |memberships, filter| {
                    CollisionGroups::new(Group::from_bits_retain(memberships), Group::from_bits_retain(filter))
                };
                app.world_mut().entity_mut(wall).insert(groups(wall_group, u32::MAX));
                app.world_mut().entity_mut(body).insert(groups(u32::MAX, filter));
            });
            let x = position(&mut app, body).x;
            if wall_group & filter == 0 {
                assert!((x - 28.5 * 200.0 * DT).abs() < 0.01, "{kind}: {x}");
                assert_eq!(record.counts(wall, body), [0, 0], "{kind}");
                passed += 1;
            } else {
                assert!(is_in_front(&mut app, wall, body), "{kind}: {x}");
                stopped += 1;
            }
        }
    }
    assert_eq!((passed, stopped), (3, 6));
}

#[test]
fn without_continuous_collision_a_fast_body_passes_walls() {
    for kind in WALLS {
        for on_wall in [false, true] {
            let (mut app, [wall, body], _) = shoot(kind, true, 200.0, |app, wall, body| {
                app.world_mut().entity_mut(if on_wall { wall } else { body }).insert(MedialCcd::DISABLED);
            });
            let passes = position(&mut app, body).x > position(&mut app, wall).x + 1.0;
            assert!(passes, "{kind} {on_wall}");
        }
        let mut app = app();
        app.insert_resource(MedialSettings { stop_at_impact: false, ..default() });
        let wall = spawn_wall(&mut app, kind);
        let velocity = Velocity::linear(Vec3::X * 200.0);
        let body = spawn_flying(&mut app, ball(), Transform::from_xyz(-1.5 * 200.0 * DT, 0.1, 0.1), velocity);
        run(&mut app, 10);
        assert!(position(&mut app, body).x > position(&mut app, wall).x + 1.0, "{kind}");
    }
}

#[test]
fn a_slow_body_rests_without_continuous_collision() {
    let mut app = app();
    spawn_ground(&mut app);
    let body = spawn_body(&mut app, model("torus"), Transform::from_xyz(0.0, 0.3, 0.0));
    app.world_mut().entity_mut(body).insert(MedialCcd::DISABLED);
    run(&mut app, 300);
    assert!((position(&mut app, body).y - 0.0525).abs() < 2e-3 && is_at_rest(&mut app, body));
}
