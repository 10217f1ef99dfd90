//! Kinematic bodies keep their motion and push the bodies that they hit.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::*;

use crate::common::*;

const HALF: Vec3 = Vec3::new(0.025, 1.0, 1.0);

/// A thin plate across x, as a medial mesh or as a box.
fn spawn_plate(app: &mut App, medial: bool, kind: RigidBody, at: Vec3) -> Entity {
    let plate = app.world_mut().spawn((kind, Transform::from_translation(at))).id();
    if medial {
        let mesh = mesh(app, MedialAxis::rounded_box(HALF, HALF.x).unwrap());
        app.world_mut().entity_mut(plate).insert(mesh);
    } else {
        app.world_mut().entity_mut(plate).insert(Collider::cuboid(HALF.x, HALF.y, HALF.z));
    }
    plate
}

/// A rod along x that turns, as a medial mesh or as a capsule. `half`: half of its length in metres.
fn spawn_turning_rod(app: &mut App, medial: bool, half: f32, radius: f32, spin: Vec3) -> Entity {
    let [start, end] = [-half, half].map(|x| Vec3::X * x);
    let turning = (RigidBody::KinematicVelocityBased, Velocity::angular(spin), Transform::default());
    let rod = app.world_mut().spawn(turning).id();
    if medial {
        let mesh = mesh(app, MedialAxis::capsule(start, end, radius).unwrap());
        app.world_mut().entity_mut(rod).insert(mesh);
    } else {
        app.world_mut().entity_mut(rod).insert(Collider::capsule(start, end, radius));
    }
    rod
}

#[test]
fn a_thin_plate_pushes_bodies_at_any_speed() {
    for medial in [false, true] {
        // The longer a step's displacement, the fewer bodies in a row stay in front of the plate.
        for (speed, most) in [(3.0, 3), (30.0, 2), (300.0, 1)] {
            for by_position in [false, true] {
                for row in 1..=most {
                    let mut app = app();
                    let kind =
                        if by_position { RigidBody::KinematicPositionBased } else { RigidBody::KinematicVelocityBased };
                    let plate = spawn_plate(&mut app, medial, kind, Vec3::X * -2.3 * speed * DT);
                    if !by_position {
                        app.world_mut().entity_mut(plate).insert(Velocity::linear(Vec3::X * speed));
                    }
                    // Tori in a row would interlock.
                    let shape = model(if row == 1 { "torus" } else { "bear" });
                    let size = 2.0 * shape.bounding_sphere().radius;
                    let at = |i: usize| Transform::from_xyz(0.5 * size + 1.3 * size * i as f32, 0.1, 0.05);
                    let bodies: Vec<Entity> =
                        (0..row).map(|i| spawn_flying(&mut app, shape.clone(), at(i), Velocity::zero())).collect();
                    let what = format!("medial {medial}, {speed} m/s, by position {by_position}, {row} in a row");
                    for _ in 0..40 {
                        if by_position {
                            app.world_mut().get_mut::<Transform>(plate).unwrap().translation.x += speed * DT;
                        }
                        app.update();
                        let x = position(&mut app, plate).x;
                        for &body in &bodies {
                            let place = position(&mut app, body);
                            // The body may have left the plate at its edge.
                            let within = place.yz().abs().max_element() < HALF.y;
                            assert!(place.x > x || !within, "{what}: at {place}, the plate at {x}");
                        }
                    }
                    // Bodies in a row may differ in speed, so only the mean is tested.
                    let reached = bodies.iter().map(|&body| rigid(&mut app, body).linvel().x).sum::<f32>() / row as f32;
                    assert!(reached > 0.8 * speed, "{what}: {reached} m/s");
                }
            }
        }
    }
}

#[test]
fn sleeping_bodies_are_pushed_as_well() {
    for medial in [false, true] {
        for speed in [30.0, 100.0] {
            let mut app = app();
            let plate = spawn_plate(&mut app, medial, RigidBody::KinematicVelocityBased, Vec3::X * -1.3 * speed * DT);
            let ball =
                spawn_flying(&mut app, MedialAxis::sphere(0.05).unwrap(), Transform::default(), Velocity::zero());
            run(&mut app, 200);
            assert!(is_at_rest(&mut app, ball), "the ball does not sleep");
            app.world_mut().entity_mut(plate).insert(Velocity::linear(Vec3::X * speed));
            for step in 0..10 {
                app.update();
                let [ball, plate] = [ball, plate].map(|entity| position(&mut app, entity).x);
                assert!(ball > plate, "medial {medial}, {speed} m/s, step {step}: at {ball}, the plate at {plate}");
            }
            let reached = rigid(&mut app, ball).linvel().x;
            assert!(reached > 0.8 * speed, "medial {medial}, {speed} m/s: {reached} m/s");
        }
    }
}

#[test]
fn a_body_nearby_causes_no_contact_search_in_a_sleeping_pile() {
    let mut app = app();
    spawn_ground(&mut app);
    let axis = MedialAxis::rounded_box(Vec3::splat(0.2), 0.02).unwrap();
    let pile: Vec<Entity> = (0..2)
        .map(|i| spawn_body(&mut app, axis.clone(), Transform::from_xyz(0.0, 0.2 + 0.4 * i as f32, 0.0)))
        .collect();
    let walker = spawn_plate(&mut app, false, RigidBody::KinematicVelocityBased, Vec3::new(-0.6, 1.1, 0.0));
    run(&mut app, 200);
    assert!(pile.iter().all(|&body| is_at_rest(&mut app, body)), "the pile does not sleep");
    app.world_mut().entity_mut(walker).insert(Velocity::linear(Vec3::Z));
    let mut looked_at = 0;
    for _ in 0..10 {
        app.update();
        let output = &app.world().resource::<MedialStep>().output;
        looked_at = looked_at.max(output.counts.body_pairs);
        assert_eq!(output.counts.contacts, 0);
    }
    // Each box with the ground, both boxes with each other, and at least one box with the plate.
    assert!(looked_at >= 4, "only {looked_at} pairs are near");
    assert!(pile.iter().all(|&body| is_at_rest(&mut app, body)));
}

#[test]
fn a_sleeping_body_is_not_pushed_through_a_wall_or_body() {
    for kind in ["wall", "ball", "wall, all pairs"] {
        let mut app = app();
        app.world_mut().resource_mut::<MedialSettings>().brute_force = kind.ends_with("all pairs");
        let speed = 12.0;
        let plate = spawn_plate(&mut app, false, RigidBody::KinematicVelocityBased, Vec3::X * -(0.12 + 0.02));
        let sphere = || MedialAxis::sphere(0.05).unwrap();
        let ball = spawn_flying(&mut app, sphere(), Transform::default(), Velocity::zero());
        let wall = app.world_mut().spawn((StaticObb::new(0.02, 1.0, 1.0), Transform::from_xyz(0.1, 0.0, 0.0))).id();
        let next = (kind == "ball").then(|| {
            app.world_mut().get_mut::<Transform>(wall).unwrap().translation.x = 0.25;
            spawn_flying(&mut app, sphere(), Transform::from_xyz(0.13, 0.0, 0.0), Velocity::zero())
        });
        run(&mut app, 200);
        assert!(is_at_rest(&mut app, ball), "{kind}: the ball does not sleep");
        app.world_mut().entity_mut(plate).insert(Velocity::linear(Vec3::X * speed));
        app.update();
        let step = app.world().resource::<MedialStep>();
        assert!(step.infos.iter().any(|info| info.entity == ball && info.asleep), "{kind}: rapier has woken the ball");
        let x = position(&mut app, ball).x;
        assert!(x > 0.01, "{kind}: the ball is not pushed, at {x}");
        let limit = match next {
            Some(next) => position(&mut app, next).x - 0.1,
            None => 0.08 - 0.05,
        };
        assert!(x < limit + 2e-3, "{kind}: at {x}, beyond {limit}");
    }
}

#[test]
fn a_swinging_bat_hits_the_ball() {
    for medial in [false, true] {
        for spin in [5.0, 30.0, 90.0] {
            let mut app = app();
            spawn_turning_rod(&mut app, medial, 1.2, 0.03, Vec3::Y * spin);
            // The ball is a quarter of a turn away.
            let ball = MedialAxis::sphere(0.05).unwrap();
            let ball = spawn_flying(&mut app, ball, Transform::from_xyz(0.0, 0.01, -1.0), Velocity::zero());
            let mut fastest = 0.0f32;
            for _ in 0..40 {
                app.update();
                fastest = fastest.max(rigid(&mut app, ball).linvel().length());
            }
            assert!(fastest > 0.5 * spin && fastest < 2.0 * spin, "medial {medial}, {spin} rad/s: {fastest} m/s");
        }
    }
}

/// The ball slides outwards, to points of the rod that move faster.
#[test]
fn a_ball_that_slides_along_a_turning_rod_stays_in_front_of_it() {
    for medial in [false, true] {
        for spin in [5.0, 10.0, 20.0, 30.0, 40.0] {
            let mut app = app();
            let smooth = Friction { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min };
            let rod = spawn_turning_rod(&mut app, medial, 1.0, 0.05, Vec3::Z * spin);
            let place = Transform::from_translation(Quat::from_rotation_z(64.0_f32.to_radians()) * Vec3::X * 0.5);
            let ball = spawn_flying(&mut app, MedialAxis::sphere(0.1).unwrap(), place, Velocity::zero());
            for entity in [rod, ball] {
                app.world_mut().entity_mut(entity).insert(smooth);
            }
            let mut pushed = 0;
            for step in 0..80 {
                app.update();
                pushed += app.world().resource::<MedialStep>().output.stops.len();
                let pose = *rigid(&mut app, rod).position();
                let local = pose.inverse_transform_point(position(&mut app, ball));
                let what = format!("medial {medial}, {spin} rad/s, step {step}");
                if local.x > 1.0 {
                    break;
                }
                assert!(local.y > 0.1, "{what}: the ball is at {local} in the frame of the rod");
            }
            let speed = rigid(&mut app, ball).linvel().length();
            assert!(pushed > 0, "medial {medial}, {spin} rad/s: the ball was not pushed");
            // In steps of 1/1920 s the ball leaves at 1.23 m/s per rad/s.
            assert!((0.9..1.35).contains(&(speed / spin)), "medial {medial}, {spin} rad/s: {speed} m/s");
        }
    }
}

#[test]
fn a_body_is_not_pushed_through_a_wall() {
    for medial in [false, true] {
        let mut app = app();
        app.world_mut().spawn((StaticObb::new(0.025, 5.0, 5.0), Transform::from_xyz(4.0, 0.0, 0.0)));
        let plate = spawn_plate(&mut app, medial, RigidBody::KinematicVelocityBased, Vec3::X * -3.0);
        app.world_mut().entity_mut(plate).insert(Velocity::linear(Vec3::X * 200.0));
        let torus = model("torus");
        let body = spawn_flying(&mut app, torus, Transform::from_xyz(0.0, 0.1, 0.05), Velocity::zero());
        for step in 0..60 {
            app.update();
            let pushed = position(&mut app, body);
            assert!(pushed.x < 4.0 && pushed.is_finite(), "medial {medial}, step {step}: {pushed}");
            if position(&mut app, plate).x > 3.0 {
                app.world_mut().entity_mut(plate).insert(Velocity::zero());
            }
        }
    }
}

#[test]
fn a_pushed_body_keeps_its_locked_axes() {
    let capsule = || MedialAxis::capsule(Vec3::Y * -0.4, Vec3::Y * 0.4, 0.2).unwrap();
    for locked in [LockedAxes::ROTATION_LOCKED, LockedAxes::TRANSLATION_LOCKED, LockedAxes::TRANSLATION_LOCKED_Z] {
        let mut app = app();
        // The plate moves at an angle and turns.
        let spin = Velocity { linear: Vec3::new(60.0, 0.0, 25.0), angular: Vec3::new(3.0, 5.0, 30.0) };
        let plate = spawn_plate(&mut app, true, RigidBody::KinematicVelocityBased, Vec3::new(-1.3, 0.0, -0.4));
        app.world_mut().entity_mut(plate).insert(spin);
        let body = spawn_flying(&mut app, capsule(), Transform::default(), Velocity::zero());
        app.world_mut().entity_mut(body).insert(locked);
        let mut pushed = 0;
        for _ in 0..4 {
            app.update();
            pushed += app.world().resource::<MedialStep>().output.stops.len();
        }
        assert!(pushed > 0, "{locked:?}: the body is not hit");
        let pose = *rigid(&mut app, body).position();
        let [displacement, turn] = [pose.translation, pose.rotation.to_scaled_axis()];
        assert_eq!(displacement.length() > 0.1, locked != LockedAxes::TRANSLATION_LOCKED, "{locked:?}: {displacement}");
        assert_eq!(turn.length() > 0.1, locked != LockedAxes::ROTATION_LOCKED, "{locked:?}: {turn}");
        if locked == LockedAxes::ROTATION_LOCKED {
            assert!(turn.length() < 1e-5, "{turn}");
        } else {
            let held = if locked == LockedAxes::TRANSLATION_LOCKED { displacement } else { displacement * Vec3::Z };
            assert!(held.length() < 1e-5, "{locked:?}: {displacement}");
        }
    }
}
