//! Medial bodies with every standard collider of rapier: distance, time of impact, rest, fast impacts, sensors.

use bevy::{
    prelude::*,
    tasks::{ComputeTaskPool, TaskPool},
};
use bevy_medial::{
    geometry::{Pose3, Primitive, Sphere, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Manifold, OtherShape, Shape, Solid, StaticBody, Statics, StepInput, contacts, step},
    rapier::{ContactTable, MedialDispatcher, MedialShape},
    scenes::Monitor,
};
use bevy_rapier3d::{
    parry::{
        query::{self, QueryDispatcher},
        shape::Shape as ParryShape,
    },
    prelude::*,
};
use std::{f32::consts::FRAC_PI_2, sync::Arc};

use crate::common::*;

mod cases;

use cases::*;

#[test]
fn distances_are_exact() {
    let dispatcher = MedialDispatcher { table: ContactTable::default() };
    let mut random = Random(1);
    for (case, axis) in cases().into_iter().flat_map(|case| probes().map(|axis| (case.clone(), axis))) {
        let medial = MedialShape::new(Shape::new(axis.clone()), 1);
        let truth_shape = reference(&case.collider.raw);
        let (mut apart, mut together, mut off) = (0, 0, 0.0f32);
        for _ in 0..1000 {
            let pose12 = Pose3::from_parts(random.in_ball() * 2.0, random.rotation());
            let other = &*case.collider.raw;
            let Some(truth) = true_distance(&axis, &pose12, &*truth_shape) else { continue };
            *if truth > 0.0 { &mut apart } else { &mut together } += 1;
            for found in [
                dispatcher.distance(&pose12, &medial, other).unwrap(),
                dispatcher.distance(&pose12.inverse(), other, &medial).unwrap(),
            ] {
                off = off.max((found - truth.max(0.0)).abs());
            }
            // Contacts also report the depth of an overlap.
            for (pose12, found) in [
                (pose12, dispatcher.contact(&pose12, &medial, other, 0.05).unwrap()),
                (pose12.inverse(), dispatcher.contact(&pose12.inverse(), other, &medial, 0.05).unwrap()),
            ] {
                assert!(
                    found.is_some() || truth > 0.05 - case.tolerance(),
                    "{}: no contact, {truth} m apart",
                    case.name
                );
                let Some(found) = found else { continue };
                let offset = pose12.transform_point(found.point2) - found.point1;
                off = off.max((found.dist - truth).abs()).max(offset.distance(found.normal1 * found.dist));
                assert!((found.normal1 + pose12.rotation * found.normal2).length() < 1e-3, "{}", case.name);
            }
        }
        let of = axis.primitives().len();
        println!("{}, {of} primitives: {apart} apart, {together} together, off by {off} m at most", case.name);
        assert!(apart > 50 && together > 5, "{}: {apart} {together}", case.name);
        assert!(off < case.tolerance(), "{}", case.name);
    }
}

/// First fraction at which both come within `close`. The steps of the search are so short that they cannot skip it.
fn first_touch(axis: &MedialAxis, sweeps: [&Sweep; 2], shape: &dyn ParryShape, close: f32) -> Option<f32> {
    let speed = (sweeps[0].translation - sweeps[1].translation).length();
    let mut fraction = 0.0;
    while fraction <= 1.0 {
        let [pose1, pose2] = sweeps.map(|sweep| sweep.pose_at(fraction));
        let distance = true_distance(axis, &pose1.inv_mul(&pose2), shape).unwrap_or(0.0);
        if distance <= close {
            return Some(fraction);
        }
        fraction += distance.abs().max(2e-4) / speed;
    }
    None
}

#[test]
fn impacts_are_exact() {
    let pool = ComputeTaskPool::get_or_init(TaskPool::default);
    let mut random = Random(2);
    let axis = capsule();
    let capsule = Shape::new(axis.clone());
    for case in cases() {
        let shape = case.collider.raw.clone();
        let truth_shape = reference(&shape);
        let (mut hits, mut misses, mut off) = (0, 0, 0.0f32);
        for _ in 0..300 {
            let places = [random.in_ball().normalize() * 3.0, Vec3::ZERO];
            let [start1, start2] = places.map(|place| Pose3::from_parts(place, random.rotation()));
            if true_distance(&axis, &start1.inv_mul(&start2), &*truth_shape).is_none_or(|distance| distance < 0.05) {
                continue;
            }
            let moved = |start: Pose3, by: Vec3| {
                let end = Pose3::from_parts(start.translation + by, start.rotation);
                Sweep::between(start, end, Vec3::ZERO, Vec3::ZERO)
            };
            let sweep1 = moved(start1, -start1.translation * 1.5 + random.in_ball() * 2.0);
            for sweep2 in [Sweep::at_rest(start2), moved(start2, random.in_ball())] {
                let body = Body { core_depth: 0.0, ..Body::new(capsule.clone(), sweep1) };
                let other = Solid::Parts(Arc::new(shape.clone()));
                let (bodies, statics) = if sweep2.is_at_rest() {
                    (vec![body], Statics::new(vec![StaticBody::new(other, start2)]))
                } else {
                    (vec![Body::new(other, sweep2), body], Statics::default())
                };
                let output = step(&StepInput { bodies, ..default() }, &statics, pool);
                let impact = output.pairs.first().and_then(|pair| pair.impact).map(|impact| impact.fraction);
                // A graze that is shallower than the slop is not an impact.
                let [outer, inner] =
                    [1e-4, -1e-3].map(|close| first_touch(&axis, [&sweep1, &sweep2], &*truth_shape, close));
                let displacement = (sweep1.translation - sweep2.translation).length();
                match (impact, outer) {
                    (Some(impact), touch) => {
                        hits += 1;
                        off = touch.map_or(off, |touch| off.max((impact - touch) * displacement));
                        let [pose1, pose2] = [&sweep1, &sweep2].map(|sweep| sweep.pose_at(impact));
                        let distance = true_distance(&axis, &pose1.inv_mul(&pose2), &*truth_shape).unwrap_or(0.0);
                        let sunk = inner.is_some_and(|inner| (impact - inner) * displacement > 2.0 * case.tolerance());
                        assert!(
                            distance.abs() < 2.0 * case.tolerance() && !sunk,
                            "{}: {impact}, {outer:?} to {inner:?}, {distance} m apart",
                            case.name
                        );
                    }
                    (None, _) => {
                        misses += 1;
                        assert!(inner.is_none_or(|inner| inner > 0.999), "{}: no impact, {inner:?}", case.name);
                    }
                }
            }
        }
        println!("{}: {hits} hits, late by {off} m at most, {misses} misses", case.name);
        assert!(hits > 40 && misses > 10, "{}", case.name);
    }
}

/// Asserts that no overlap of any step was deeper than a hundredth of the smaller body's size.
fn assert_hardly_overlapped(app: &App, name: &str) {
    let deepest = app.world().resource::<Monitor>().deepest_overlap_percent;
    assert!(deepest < 1.0, "{name}: {deepest} %");
}

#[test]
fn bodies_rest_on_every_collider() {
    for case in cases() {
        for medial_first in [false, true] {
            let mut app = app();
            if !medial_first {
                spawn_fixed(&mut app, &case, Transform::IDENTITY);
            }
            let body = spawn_body(&mut app, capsule(), Transform::from_xyz(0.05, 0.4, 0.1));
            if !case.flat {
                // The locked axes keep the body balanced on a ridge or a dome.
                let lock =
                    LockedAxes::TRANSLATION_LOCKED_X | LockedAxes::TRANSLATION_LOCKED_Z | LockedAxes::ROTATION_LOCKED;
                let across = Transform::from_xyz(0.0, 0.4, 0.0).with_rotation(Quat::from_rotation_y(1.5));
                app.world_mut().entity_mut(body).insert((lock, across));
            }
            if medial_first {
                spawn_fixed(&mut app, &case, Transform::IDENTITY);
            }
            run(&mut app, 300);
            let height = position(&mut app, body).y;
            assert!((height - RADIUS).abs() < 0.003, "{}: the middle rests at {height}", case.name);
            assert_hardly_overlapped(&app, case.name);
            assert!(is_at_rest(&mut app, body), "{}", case.name);
        }
    }
}

#[test]
fn every_solid_collider_rests_on_a_medial_floor() {
    for case in cases().into_iter().filter(|case| case.solid) {
        let mut app = app();
        let plate = MedialAxis::rounded_box(Vec3::new(6.0, 0.2, 6.0), 0.2).unwrap();
        let floor = mesh(&mut app, plate);
        app.world_mut().spawn((RigidBody::Fixed, floor, Transform::from_xyz(0.0, -0.2, 0.0)));
        let damping = Damping { linear_damping: 0.5, angular_damping: 2.0 };
        let at = Transform::from_xyz(0.1, 2.0 * case.half_height + 0.2, 0.0) * case.pose;
        let body = app.world_mut().spawn((RigidBody::Dynamic, case.collider.clone(), damping, at)).id();
        run(&mut app, 300);
        let top = rigid(&mut app, body).position() * case.pose.compute_affine().inverse().transform_point3(Vec3::ZERO);
        assert!((top.y - 2.0 * case.half_height).abs() < 0.005, "{}: its top is at {}", case.name, top.y);
        assert_hardly_overlapped(&app, case.name);
        assert!(is_at_rest(&mut app, body), "{}", case.name);
    }
}

#[test]
fn no_body_tunnels_at_100_metres_per_second() {
    for case in cases() {
        for (spin, offset) in [(0.0, 0.1), (0.0, 0.7), (40.0, 0.3)] {
            // A medial body shot at a fixed collider, and at one that flies towards the body.
            for moving in [false, true] {
                if moving && case.name == "half-space" {
                    continue;
                }
                let mut app = app();
                let place = upright(Vec3::new(3.0 + offset, 0.0, 0.0)) * case.pose;
                let target = app.world_mut().spawn((case.collider.clone(), place)).id();
                if moving {
                    let flight = Velocity::linear(Vec3::X * -100.0);
                    let mass = AdditionalMassProperties::MassProperties(MassProperties {
                        mass: 10.0,
                        principal_inertia: Vec3::splat(5.0),
                        ..default()
                    });
                    app.world_mut().entity_mut(target).insert((RigidBody::Dynamic, GravityScale(0.0), flight, mass));
                }
                let flight = Velocity { linear: Vec3::X * 100.0, angular: Vec3::new(0.3, 0.5, 0.8) * spin };
                let body = spawn_flying(&mut app, capsule(), Transform::from_xyz(0.0, 0.02, 0.03), flight);
                let mut record = Record::default();
                record.run(&mut app, 60);
                let (place, speed) = (position(&mut app, body), rigid(&mut app, body).linvel().x);
                let to = if moving { position(&mut app, target).x } else { 3.0 + offset };
                // The shot may pass a narrow target, and a deflected body is not behind the target.
                let beside = !case.flat || place.yz().length() > 3.0;
                let what = format!("{}, spin {spin}, moving {moving}", case.name);
                assert!(place.x < to || beside, "{what}: {place}, beyond {to}");
                assert!(speed < 95.0, "{}, spin {spin}, moving {moving}: {speed} m/s", case.name);
                assert!(record.counts(body, target)[0] >= 1, "{}, spin {spin}, moving {moving}", case.name);
            }
        }
        // A collider shot at a medial wall.
        if case.solid {
            let mut app = app();
            let plate = MedialAxis::rounded_box(Vec3::new(0.05, 3.0, 3.0), 0.05).unwrap();
            let wall = mesh(&mut app, plate);
            app.world_mut().spawn((RigidBody::Fixed, wall, Transform::from_xyz(5.0, 0.0, 0.0)));
            let flight = Velocity { linear: Vec3::X * 100.0, angular: Vec3::new(0.0, 1.0, 3.0) };
            let body = (RigidBody::Dynamic, GravityScale(0.0), case.collider.clone(), flight, Transform::default());
            let body = app.world_mut().spawn(body).id();
            run(&mut app, 60);
            let x = rigid(&mut app, body).center_of_mass().x;
            assert!(x < 5.0, "{} ends at {x}, behind the wall", case.name);
        }
    }
}

#[test]
fn every_sensor_reports_a_crossing_body_once() {
    for case in cases() {
        // The body crosses within one step or in many, and one of both is the sensor.
        for (speed, steps, medial) in [(300.0, 10, false), (300.0, 10, true), (3.0, 150, false), (3.0, 150, true)] {
            let mut app = app();
            let target = spawn_fixed(&mut app, &case, upright(Vec3::new(2.5, 0.0, 0.0)));
            let velocity = Velocity::linear(Vec3::X * speed);
            let body = spawn_flying(&mut app, capsule(), Transform::from_xyz(0.0, 0.02, 0.03), velocity);
            app.world_mut().entity_mut(if medial { body } else { target }).insert(Sensor);
            let mut record = Record::default();
            record.run(&mut app, steps);
            let expected = if case.name == "half-space" { [1, 0] } else { [1, 1] };
            let name = format!("{} at {speed} m/s, medial {medial}", case.name);
            assert_eq!(record.counts(body, target), expected, "{name}");
            assert!(record.started.iter().all(|(_, message)| message.sensor), "{name}");
            assert_eq!(rigid(&mut app, body).linvel(), Vec3::X * speed, "{name}");
        }
    }
}

/// The older collider is the first one of a pair in rapier.
#[test]
fn hits_do_not_depend_on_the_age_of_a_collider() {
    for case in cases() {
        let mut random = Random(5);
        let mut hits = 0;
        for _ in 0..10 {
            let turn = random.rotation();
            let (spin, offset) = (random.in_ball() * 20.0, random.in_ball() * 0.4);
            let place = Transform::from_rotation(turn) * upright(Vec3::X * 3.0) * case.pose;
            let forward = turn * Vec3::X * 30.0;
            let mut apps = [false, true].map(|body_first| {
                let mut app = app();
                let spawn_target = |app: &mut App| {
                    app.world_mut().spawn((case.collider.clone(), place));
                    app.update();
                };
                if !body_first {
                    spawn_target(&mut app);
                }
                let flight = Velocity { linear: forward, angular: spin };
                let body = spawn_flying(&mut app, capsule(), Transform::from_translation(turn * offset), flight);
                app.update();
                if body_first {
                    spawn_target(&mut app);
                } else {
                    app.update();
                }
                (app, body)
            });
            // Only the first impact is compared, because the motion after it may be chaotic.
            for _ in 0..10 {
                let [one, other] = apps.each_mut().map(|(app, body)| {
                    app.update();
                    let rigid = rigid(app, *body);
                    (rigid.linvel(), rigid.angvel())
                });
                if one.0.distance(forward) > 1.0 {
                    let off = one.0.distance(other.0) + 0.3 * one.1.distance(other.1);
                    // This is the accuracy of parry's iteration and of rapier's friction.
                    assert!(off < 3.0, "{}: {off} m/s, {one:?} and {other:?}", case.name);
                    hits += 1;
                    break;
                }
            }
        }
        assert!(hits > 5, "{}: {hits}", case.name);
    }
}

#[test]
fn a_passing_ball_causes_no_contact() {
    // The ball moves a metre per step. The starts differ, so the step in which it passes ends at different positions.
    for start in (0..50).map(|i| -3.0 - 0.02 * i as f32) {
        let mut app = app();
        let collider = Collider::ball(0.2);
        // Slow balls are spawned before and after the fast one.
        for (height, speed) in [(-9.0, 0.0), (0.0, 60.0), (9.0, 0.0)] {
            let flight = (RigidBody::Dynamic, GravityScale(0.0), Velocity::linear(Vec3::X * speed));
            app.world_mut().spawn((flight, collider.clone(), Transform::from_xyz(start, height, 0.0)));
        }
        let sphere = MedialAxis::sphere(0.2).unwrap();
        let passed = spawn_flying(&mut app, sphere, Transform::from_xyz(0.0, 0.402, 0.0), Velocity::zero());
        run(&mut app, 12);
        let speed = rigid(&mut app, passed).linvel();
        assert!(speed.length() < 1e-3, "from {start}: {speed}");
    }
}

#[test]
fn a_lying_cylinder_or_cone_touches_a_slab_along_its_length() {
    let sphere = |x: f32, z: f32| Sphere::new(Vec3::new(x, 0.0, z), 0.05);
    let spheres = vec![sphere(-2.0, -2.0), sphere(2.0, -2.0), sphere(0.0, 2.0)];
    let slab = Shape::new(MedialAxis::new(spheres, vec![Primitive::Slab([0, 1, 2])]).unwrap().0);
    let tip = 0.1f32.atan2(0.6);
    for (name, collider, turn, height) in [
        ("cylinder", Collider::cylinder(0.3, 0.1), -FRAC_PI_2, 0.1),
        ("cone", Collider::cone(0.3, 0.1), -FRAC_PI_2 - tip, 0.3 * tip.sin()),
    ] {
        for yaw in (0..16).map(|i| 0.4 * i as f32) {
            let pose12 = Pose3::from_parts(
                Vec3::new(0.1, 0.05 + height, 0.0),
                Quat::from_rotation_y(yaw) * Quat::from_rotation_z(turn),
            );
            let manifolds = contacts::manifolds(&slab, OtherShape::Parts(&collider.raw), &pose12, 0.01);
            let along: Vec<f32> = manifolds
                .iter()
                .flat_map(Manifold::contacts)
                .filter(|contact| contact.distance.abs() < 1e-3)
                .map(|contact| contact.point2.y)
                .collect();
            let reach = along.iter().fold([0.0f32; 2], |[low, high], &y| [low.min(y), high.max(y)]);
            assert!(reach[0] < -0.29 && reach[1] > 0.29, "{name}, {yaw}: touches at {along:?}");
        }
    }
}

#[test]
fn a_body_across_a_beam_touches_both_edges_of_it() {
    let half = Vec3::new(0.15, 0.5, 2.0);
    let beam = Shape::new(MedialAxis::rounded_box(half, 0.02).unwrap());
    let cuboid = Collider::cuboid(half.x, half.y, half.z);
    let corners: Vec<Vec3> =
        (0..8).map(|i| half * Vec3::from([0, 1, 2].map(|bit| if i >> bit & 1 == 0 { -1.0 } else { 1.0 }))).collect();
    let hull = Collider::convex_hull(&corners).unwrap();
    let rod = MedialAxis::capsule(Vec3::X * -1.0, Vec3::X, 0.05).unwrap();
    let plank = MedialAxis::rounded_box(Vec3::new(1.0, 0.05, 0.4), 0.05).unwrap();
    for (what, axis, width) in [("rod", rod, 0.0), ("plank", plank, 0.35)] {
        let shape = Shape::new(axis);
        let seconds = [
            ("box", OtherShape::Parts(&cuboid.raw)),
            ("hull", OtherShape::Parts(&hull.raw)),
            ("medial", OtherShape::Shape(&beam)),
        ];
        for (name, second) in seconds {
            for tilt in [-1e-4, 0.0, 1e-4] {
                let pose12 = Pose3::from_parts(Vec3::Y * -(half.y + 0.05), Quat::from_rotation_z(tilt));
                let places: Vec<Vec3> = contacts::manifolds(&shape, second, &pose12, 0.01)
                    .iter()
                    .flat_map(Manifold::contacts)
                    .map(|contact| contact.point1)
                    .collect();
                let rests_at = |x: f32, z: f32| places.iter().any(|p| p.x * x > 0.12 && p.z * z >= width - 0.01);
                let all = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(x, z)| rests_at(x, z));
                assert_eq!(all, [true; 4], "{what} on {name}, tilted by {tilt}: {places:?}");
            }
        }
    }
}
