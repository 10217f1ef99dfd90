//! Bodies come to rest at the right height on any floor and in any order: asleep, with speed zero and hardly any overlap.

use std::f32::consts::FRAC_PI_2;

use bevy::prelude::*;
use bevy_medial::{
    geometry::Sphere,
    medial_axis::MedialAxis,
    prelude::*,
    scenes::{Monitor, headless_app},
};
use bevy_rapier3d::prelude::{CoefficientCombineRule, Collider, ContactSkin, Damping, Friction, RigidBody, Velocity};

use crate::common::*;

/// Kinds of floors. Their top is at height 0, at least around the origin.
const FLOORS: [&str; 6] = ["box", "shape", "cuboid", "ball", "capsule", "half space"];

fn spawn_floor(app: &mut App, kind: &str) -> Entity {
    let at = |y: f32| Transform::from_xyz(0.0, y, 0.0);
    let world = app.world_mut();
    match kind {
        "box" => world.spawn((StaticObb::new(5.0, 1.0, 5.0), at(-1.0))).id(),
        "shape" => {
            let floor = mesh(app, MedialAxis::rounded_box(Vec3::new(5.0, 1.0, 5.0), 0.1).unwrap());
            app.world_mut().spawn((RigidBody::Fixed, floor, StaticObb::default(), at(-1.0))).id()
        }
        "cuboid" => world.spawn((RigidBody::Fixed, Collider::cuboid(5.0, 1.0, 5.0), at(-1.0))).id(),
        "ball" => world.spawn((RigidBody::Fixed, Collider::ball(5.0), at(-5.0))).id(),
        // Lying along x.
        "capsule" => {
            let turned = at(-1.0).with_rotation(Quat::from_rotation_z(FRAC_PI_2));
            world.spawn((RigidBody::Fixed, Collider::capsule_y(4.0, 1.0), turned)).id()
        }
        _ => world.spawn((RigidBody::Fixed, Collider::halfspace(Vec3::Y).unwrap(), at(0.0))).id(),
    }
}

/// Bodies, their initial transforms, and the height of their origin above a flat floor at rest.
fn solids() -> Vec<(&'static str, MedialAxis, Transform, f32)> {
    let lying = |radius: f32| MedialAxis::capsule(Vec3::X * -0.4, Vec3::X * 0.4, radius).unwrap();
    let (thick, thin) = (Sphere::new(Vec3::X * -0.3, 0.3), Sphere::new(Vec3::X * 0.3, 0.2));
    // A tapered capsule rests on its side: the line of its lowest points is level.
    let slope = (0.1f32 / 0.6).asin();
    let at = |y: f32| Transform::from_xyz(0.0, y, 0.0);
    vec![
        ("capsule", lying(0.2), at(0.5), 0.2),
        ("thin capsule", lying(0.03), at(0.3), 0.03),
        ("small capsule", lying(0.2), at(0.3).with_scale(Vec3::splat(0.1)), 0.02),
        (
            "tapered capsule",
            MedialAxis::cone(thick, thin).unwrap(),
            at(0.6).with_rotation(Quat::from_rotation_z(-slope)),
            0.25,
        ),
        ("torus", MedialAxis::torus(0.4, 0.1, 24).unwrap(), at(0.5), 0.1),
        ("box", MedialAxis::rounded_box(Vec3::new(0.4, 0.2, 0.3), 0.05).unwrap(), at(0.5), 0.2),
        ("sharp box", MedialAxis::rounded_box(Vec3::new(0.3, 0.2, 0.4), 0.0).unwrap(), at(0.5), 0.2),
        ("model torus", model("torus"), at(0.3), 0.0525),
    ]
}

/// Adds damping, because a rolling body comes to rest only with it: rapier has no rolling friction.
fn damp(app: &mut App, body: Entity) {
    app.world_mut().entity_mut(body).insert(Damping { linear_damping: 0.1, angular_damping: 1.0 });
}

/// Deepest overlap so far of all pairs of the steps, in percent of the smaller body's size.
fn deepest_percent(app: &App) -> f32 {
    app.world().resource::<Monitor>().deepest_overlap_percent
}

#[test]
fn bodies_rest_on_flat_floors_at_the_height_of_their_shape() {
    let mut rested = 0;
    for kind in ["box", "shape", "cuboid", "half space"] {
        for floor_first in [true, false] {
            let mut app = app();
            if floor_first {
                spawn_floor(&mut app, kind);
            }
            let bodies: Vec<_> = solids()
                .into_iter()
                .enumerate()
                .map(|(i, (name, axis, mut transform, height))| {
                    transform.translation += Vec3::new((i % 3) as f32 * 1.5 - 1.5, 0.0, (i / 3) as f32 * 1.5 - 1.5);
                    (name, spawn_body(&mut app, axis, transform), height)
                })
                .collect();
            if !floor_first {
                spawn_floor(&mut app, kind);
            }
            run(&mut app, 400);
            for (name, body, height) in bodies {
                assert_rests_at(&mut app, body, height, &format!("{name} on {kind}, floor first {floor_first}"));
                rested += 1;
            }
            assert!(deepest_percent(&app) < 2.0, "{kind}, floor first {floor_first}: {}", deepest_percent(&app));
        }
    }
    assert_eq!(rested, 64);
}

#[test]
fn bodies_rest_on_round_floors() {
    for kind in ["ball", "capsule"] {
        for floor_first in [true, false] {
            for (name, axis, height) in [
                // The plate touches with its middle. The ring touches along a circle on the ball, and at two points on the capsule.
                ("plate", MedialAxis::rounded_box(Vec3::new(0.6, 0.1, 0.6), 0.05).unwrap(), 0.1),
                ("ring", MedialAxis::torus(0.4, 0.1, 48).unwrap(), f32::NAN),
            ] {
                let mut app = app();
                if floor_first {
                    spawn_floor(&mut app, kind);
                }
                let body = spawn_body(&mut app, axis, Transform::from_xyz(0.0, 0.3, 0.0));
                damp(&mut app, body);
                if !floor_first {
                    spawn_floor(&mut app, kind);
                }
                run(&mut app, 600);
                // The ring's middle line has a constant distance from the ball's centre; on the capsule its ends hang beside the
                // ridge and it rests on the two points over the ridge.
                let height = match (name, kind) {
                    ("ring", "ball") => (5.1f32 * 5.1 - 0.16).sqrt() - 5.0,
                    ("ring", _) => 0.1,
                    _ => height,
                };
                assert_rests_at(&mut app, body, height, &format!("{name} on {kind}, floor first {floor_first}"));
            }
        }
    }
}

#[test]
fn models_rest_on_every_floor() {
    for kind in FLOORS {
        // Bodies may roll off a round floor.
        let flat = !matches!(kind, "ball" | "capsule");
        let mut asleep = 0;
        for (i, model) in models().iter().enumerate() {
            let mut app = app();
            let floor_first = i % 2 == 0;
            if floor_first {
                spawn_floor(&mut app, kind);
            }
            let bound = model.axis.bounding_sphere();
            let at = Transform::from_xyz(0.0, bound.radius + bound.center.length() + 0.1, 0.0);
            let body = spawn_body(&mut app, model.axis.clone(), at.with_rotation(Random(i as u64).rotation()));
            damp(&mut app, body);
            if !floor_first {
                spawn_floor(&mut app, kind);
            }
            run(&mut app, 600);
            assert!(deepest_percent(&app) < 2.0, "{} on {kind}: {}", model.name, deepest_percent(&app));
            let pose = *rigid(&mut app, body).position();
            let level = app.world().get::<MedialLevel>(body).unwrap();
            let spheres = model.axis.level(level.0).spheres().iter();
            let lowest = spheres.map(|s| pose.transform_point(s.center).y - s.radius).fold(f32::INFINITY, f32::min);
            assert!(!flat || lowest.abs() < 0.01 * bound.radius, "{} on {kind}: {lowest}", model.name);
            asleep += usize::from(is_at_rest(&mut app, body));
        }
        // As compounds of balls, half of the models would never stop rocking on their feet.
        assert!(!flat || asleep == models().len(), "{kind}: {asleep}");
    }
}

#[test]
fn a_stack_of_three_stands() {
    let flat = MedialAxis::rounded_box(Vec3::new(0.5, 0.2, 0.5), 0.05).unwrap();
    let ring = MedialAxis::torus(0.4, 0.1, 32).unwrap();
    for (name, axis, half) in [("boxes", flat, 0.2), ("rings", ring, 0.1)] {
        for top_first in [false, true] {
            let mut app = app();
            spawn_ground(&mut app);
            let mut order: Vec<usize> = (0..3).collect();
            if top_first {
                order.reverse();
            }
            let mut bodies: Vec<(usize, Entity)> = order
                .into_iter()
                .map(|i| {
                    let height = half + i as f32 * (2.0 * half + 0.05) + 0.05;
                    // Each body is slightly offset and turned, as in an inexact stack.
                    let at = Vec3::new(0.02 * i as f32, height, -0.01 * i as f32);
                    let turned = Transform::from_translation(at).with_rotation(Quat::from_rotation_y(0.3 * i as f32));
                    (i, spawn_body(&mut app, axis.clone(), turned))
                })
                .collect();
            bodies.sort();
            run(&mut app, 600);
            for (i, body) in bodies {
                let height = half + 2.0 * half * i as f32;
                let found = position(&mut app, body).y;
                assert!((found - height).abs() < 4e-3 * (i + 1) as f32, "{name}, top first {top_first}, {i}: {found}");
                assert!(
                    is_at_rest(&mut app, body),
                    "{name}, top first {top_first}, {i}: {:?}",
                    rigid(&mut app, body).vels()
                );
            }
            assert!(deepest_percent(&app) < 2.0, "{name}, top first {top_first}: {}", deepest_percent(&app));
        }
    }
}

#[test]
fn a_body_that_starts_inside_a_floor_gets_out() {
    for kind in FLOORS {
        for depth in [0.02, 0.1, 0.19] {
            let mut app = app();
            spawn_floor(&mut app, kind);
            let plate = MedialAxis::rounded_box(Vec3::new(0.5, 0.2, 0.5), 0.05).unwrap();
            let body = spawn_body(&mut app, plate, Transform::from_xyz(0.0, 0.2 - depth, 0.0));
            damp(&mut app, body);
            run(&mut app, 600);
            let found = position(&mut app, body).y;
            // On a round floor the plate keeps rocking, as a box of rapier does, and its position varies.
            let round = matches!(kind, "ball" | "capsule");
            let tolerance = if round { 1e-2 } else { 2e-3 };
            assert!((found - 0.2).abs() < tolerance, "{kind} {depth}: {found}");
            let slow = round && rigid(&mut app, body).linvel().length() < 0.3;
            assert!(slow || is_at_rest(&mut app, body), "{kind} {depth}: {:?}", rigid(&mut app, body).vels());
        }
    }
}

#[test]
fn a_ball_rolls_on_a_large_floor_like_a_ball_of_rapier() {
    // Rounding grows with the size of the floor, and the allowed overlap with the size of the body. Neither may stop the ball.
    for half in [10.0, 100.0, 400.0] {
        for radius in [0.02, 0.1, 0.5] {
            let start = Vec3::new(0.3 * half, radius, 0.3 * half);
            let [displacement, expected] = [true, false].map(|is_medial| {
                let mut app = app();
                app.world_mut().spawn((StaticObb::new(half, half, half), Transform::from_xyz(0.0, -half, 0.0)));
                let body = if is_medial {
                    spawn_body(&mut app, MedialAxis::sphere(radius).unwrap(), Transform::from_translation(start))
                } else {
                    let ball = (RigidBody::Dynamic, Collider::ball(radius), Transform::from_translation(start));
                    app.world_mut().spawn(ball).id()
                };
                app.world_mut().entity_mut(body).insert(Velocity::linear(Vec3::X));
                run(&mut app, 120);
                position(&mut app, body) - start
            });
            assert!(expected.x > 1.3, "the ball of rapier does not roll: {expected}");
            assert!(
                (displacement.x / expected.x - 1.0).abs() < 0.05 && (displacement.y - expected.y).abs() < 1e-3,
                "{half} {radius}: {displacement} {expected}"
            );
        }
    }
}

#[test]
fn bodies_rest_on_their_contact_skins() {
    for kind in FLOORS {
        for (own, floors) in [(0.01, 0.01), (0.03, 0.0), (0.0, 0.002)] {
            let mut app = app();
            let floor = spawn_floor(&mut app, kind);
            app.world_mut().entity_mut(floor).insert(ContactSkin(floors));
            let plate = MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.02).unwrap();
            let body = spawn_body(&mut app, plate, Transform::from_xyz(0.0, 0.3, 0.0));
            app.world_mut().entity_mut(body).insert(ContactSkin(own));
            run(&mut app, 300);
            assert_rests_at(&mut app, body, 0.1 + own + floors, &format!("skins of {own} and {floors} on {kind}"));
        }
    }
}

#[test]
fn fast_bodies_slide_on_their_contact_skins() {
    let skin = 0.01;
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let smooth = Friction { coefficient: 0.0, combine_rule: CoefficientCombineRule::Min };
    app.world_mut().entity_mut(ground).insert(smooth);
    let plate = MedialAxis::rounded_box(Vec3::new(0.3, 0.1, 0.3), 0.02).unwrap();
    let body = spawn_body(&mut app, plate, Transform::from_xyz(0.0, 0.1 + skin, 0.0));
    app.world_mut().entity_mut(body).insert((smooth, ContactSkin(skin), Velocity::linear(Vec3::X * 3.0)));
    for step in 0..60 {
        app.update();
        let height = position(&mut app, body).y - 0.1;
        assert!((height - skin).abs() < 2e-3, "step {step}: {height} m above the ground");
    }
    assert!(rigid(&mut app, body).linvel().x > 2.9, "the body was held up");
}

fn assert_rests_at(app: &mut App, body: Entity, height: f32, what: &str) {
    let found = position(app, body).y;
    assert!((found - height).abs() < 2e-3, "{what}: {found} not {height}");
    assert!(is_at_rest(app, body), "{what}: {:?}", rigid(app, body).vels());
}

#[test]
fn thrown_bodies_fall_flat_in_long_steps() {
    let shapes = [MedialAxis::capsule(Vec3::X * -0.25, Vec3::X * 0.25, 0.05), MedialAxis::torus(0.2, 0.05, 24)];
    let mut app = headless_app(0.1);
    app.world_mut().spawn((StaticObb::new(20.0, 0.025, 20.0), Transform::from_xyz(0.0, -0.025, 0.0)));
    let mut random = Random(1);
    let bodies: Vec<Entity> = (0..98)
        .map(|i| {
            let place = Vec3::new((i % 7) as f32 * 4.0 - 12.0, 0.8, (i / 7) as f32 * 2.0 - 13.0);
            let transform = Transform::from_translation(place).with_rotation(random.rotation());
            let body = spawn_body(&mut app, shapes[i % 2].clone().unwrap(), transform);
            let linear = random.in_ball() * 5.0;
            let damping = Damping { linear_damping: 0.2, angular_damping: 0.5 };
            app.world_mut().entity_mut(body).insert((Velocity { linear, angular: random.in_ball() * 5.0 }, damping));
            body
        })
        .collect();
    run(&mut app, 100);
    for body in bodies {
        let (place, body) = (position(&mut app, body), rigid(&mut app, body));
        let kinetic = body.kinetic_energy() / body.mass();
        // A torus may lie on a capsule.
        assert!(place.y > 0.03 && place.y < 0.11 && kinetic < 0.05, "{place}, {kinetic} J/kg");
    }
}
