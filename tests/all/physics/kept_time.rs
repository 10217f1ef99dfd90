//! Durations: scenes in steps of 1/60 s take as long as in finer steps, in theory, or with rapier's own shapes. Energy never rises.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use bevy::prelude::*;
use bevy_medial::{
    geometry::Sphere,
    medial_axis::MedialAxis,
    prelude::*,
    scenes::{Scene, headless_app},
};
use bevy_rapier3d::prelude::*;

use crate::common::*;

/// Length of a fine step, in seconds.
const FINE: f32 = DT / 16.0;

/// Kinetic and total energy of all bodies per mass, in J/kg, with gravity of 9.81 m/s2.
fn energies(app: &mut App, bodies: &[Entity]) -> [f32; 2] {
    let (mut kinetic, mut potential, mut mass) = (0.0, 0.0, 0.0);
    for &entity in bodies {
        let body = rigid(app, entity);
        kinetic += body.kinetic_energy();
        potential += body.mass() * 9.81 * body.center_of_mass().y;
        mass += body.mass();
    }
    [kinetic / mass, (kinetic + potential) / mass]
}

fn mean_height(app: &mut App, bodies: &[Entity]) -> f32 {
    bodies.iter().map(|&body| rigid(app, body).center_of_mass().y).sum::<f32>() / bodies.len() as f32
}

/// Runs until a condition holds. Returns the time in seconds, or infinity after `most` seconds.
fn time_until(app: &mut App, dt: f32, most: f32, mut is_done: impl FnMut(&mut App) -> bool) -> f32 {
    let steps = (most / dt) as u32;
    let step = (1..=steps).find(|_| {
        app.update();
        is_done(app)
    });
    step.map_or(f32::INFINITY, |step| step as f32 * dt)
}

/// A plane that slopes down by 20 degrees along x.
fn spawn_slope(app: &mut App) -> Quat {
    let tilt = Quat::from_rotation_z(-20f32.to_radians());
    let place = Transform::from_translation(tilt * Vec3::Y * -0.5).with_rotation(tilt);
    app.world_mut().spawn((StaticObb::new(60.0, 0.5, 15.0), place));
    tilt
}

#[test]
fn a_pile_comes_to_rest_as_fast_as_in_other_engines() {
    let mut app = headless_app(DT);
    Scene::by_name("pile").unwrap().spawn(app.world_mut(), models(), 1);
    app.update();
    let mut query = app.world_mut().query::<(Entity, &RigidBody)>();
    let dynamic = query.iter(app.world()).filter(|(_, kind)| **kind == RigidBody::Dynamic);
    let bodies: Vec<Entity> = dynamic.map(|(entity, _)| entity).collect();
    // With rapier's own shapes 0.6 J/kg are left after 80 steps, and 0.1 after 100.
    let left = [(59, 10.0..20.0), (20, 0.0..2.0), (20, 0.0..0.5), (20, 0.0..0.1)];
    for (steps, expected) in left {
        run(&mut app, steps);
        let [kinetic, _] = energies(&mut app, &bodies);
        assert!(expected.contains(&kinetic), "{kinetic} J/kg, not within {expected:?}");
    }
    run(&mut app, 180);
    let stops = (0..20).map(|_| {
        app.update();
        app.world().resource::<MedialStep>().output.stops.len()
    });
    // Contacts as soft as rapier's default would stop more than 100 bodies in these steps.
    let stops: usize = stops.sum();
    assert!(stops < 20, "{stops} bodies stopped in a pile at rest");
}

/// Seconds until nine of ten capsules have fallen through a hopper.
fn hopper(dt: f32) -> f32 {
    let mut app = headless_app(dt);
    let capsule = MedialAxis::capsule(Vec3::Y * -0.12, Vec3::Y * 0.12, 0.08).unwrap();
    let (half_opening, length, thickness) = (0.6, 2.0, 0.1);
    for turn in 0..4 {
        let around = Quat::from_rotation_y(turn as f32 * FRAC_PI_2);
        let tilt = Quat::from_rotation_z(FRAC_PI_4);
        let center = Vec3::X * half_opening + tilt * Vec3::new(length, -thickness, 0.0);
        let place = Transform::from_translation(around * center).with_rotation(around * tilt);
        app.world_mut().spawn((StaticObb::new(length, thickness, 4.0), Friction::coefficient(0.1), place));
    }
    let mut random = Random(3);
    let at = |i: u32| Vec3::new((i % 4) as f32 - 1.5, (i / 16) as f32, (i / 4 % 4) as f32 - 1.5) * 0.45;
    let bodies: Vec<Entity> = (0..120)
        .map(|i| {
            let place = at(i) + Vec3::Y * 1.6 + random.in_cube() * 0.02;
            let transform = Transform::from_translation(place).with_rotation(random.rotation());
            let body = spawn_body(&mut app, capsule.clone(), transform);
            app.world_mut().entity_mut(body).insert(Friction::coefficient(0.1));
            body
        })
        .collect();
    time_until(&mut app, dt, 6.0, |app| {
        let out = bodies.iter().filter(|&&body| position(app, body).y < -0.2).count();
        10 * out >= 9 * bodies.len()
    })
}

#[test]
fn a_hopper_empties_almost_as_fast_as_in_fine_steps() {
    let [coarse, fine] = [DT, FINE].map(hopper);
    assert!(fine.is_finite() && coarse < 1.12 * fine, "{coarse} s, fine {fine} s");
}

/// Spawns dominoes in a row on a ground. The first one falls towards the others.
fn spawn_dominoes(app: &mut App, count: usize, friction: f32) -> Vec<Entity> {
    let friction = Friction::coefficient(friction);
    let ground = spawn_ground(app);
    app.world_mut().entity_mut(ground).insert(friction);
    let shape = MedialAxis::rounded_box(Vec3::new(0.01, 0.15, 0.075), 0.001).unwrap();
    let spawn = |i| {
        let domino = spawn_body(app, shape.clone(), Transform::from_xyz(0.12 * i as f32, 0.15, 0.0));
        app.world_mut().entity_mut(domino).insert(friction);
        domino
    };
    let dominoes: Vec<Entity> = (0..count).map(spawn).collect();
    app.world_mut().entity_mut(dominoes[0]).insert(Velocity::angular(Vec3::Z * -3.0));
    dominoes
}

/// Seconds until a domino leans by 45 degrees.
fn time_until_leaning(app: &mut App, dt: f32, domino: Entity) -> f32 {
    time_until(app, dt, 3.0, |app| (rigid(app, domino).rotation() * Vec3::Y).y < FRAC_PI_4.cos())
}

/// Seconds until the second of two dominoes leans.
fn second_domino(dt: f32) -> f32 {
    let mut app = headless_app(dt);
    let dominoes = spawn_dominoes(&mut app, 2, 0.0);
    time_until_leaning(&mut app, dt, dominoes[1])
}

#[test]
fn a_domino_falls_as_fast_as_in_fine_steps() {
    let [coarse, fine] = [DT, FINE].map(second_domino);
    assert!((coarse / fine - 1.0).abs() < 0.06, "{coarse} s, fine {fine} s");
}

/// Seconds from the fall of the sixth to that of the last of 20 dominoes.
fn wave(dt: f32) -> f32 {
    let mut app = headless_app(dt);
    let dominoes = spawn_dominoes(&mut app, 20, 0.2);
    assert!(time_until_leaning(&mut app, dt, dominoes[5]).is_finite());
    time_until_leaning(&mut app, dt, dominoes[19])
}

#[test]
fn a_wave_of_dominoes_is_hardly_slower_than_in_fine_steps() {
    let [coarse, fine] = [DT, FINE].map(wave);
    assert!(fine.is_finite() && coarse < 1.35 * fine, "{coarse} s, fine {fine} s");
}

/// Seconds until a tube with twelve flat sides has rolled 20 m down a slope.
fn tube(dt: f32) -> f32 {
    let mut app = headless_app(dt);
    let tilt = spawn_slope(&mut app);
    let rims = (0..12).flat_map(|i| {
        let (sin, cos) = (i as f32 / 12.0 * TAU).sin_cos();
        [-0.2, 0.2].map(|z| Sphere::new(Vec3::new(0.25 * cos, 0.25 * sin, z), 0.02))
    });
    let sides = (0..12).flat_map(|i| {
        let [a, b, c, d] = [2 * i, 2 * i + 1, 2 * ((i + 1) % 12), 2 * ((i + 1) % 12) + 1];
        [[a, b, c], [b, c, d]]
    });
    let sides: Vec<[u32; 3]> = sides.collect();
    let axis = MedialAxis::from_lists(rims.collect(), &[], &sides).unwrap().0;
    let body = spawn_body(&mut app, axis, Transform::from_translation(tilt * Vec3::Y * 0.272));
    let velocity = Velocity { linear: tilt * Vec3::X * 5.0, angular: Vec3::Z * -5.0 / 0.27 };
    app.world_mut().entity_mut(body).insert(velocity);
    time_until(&mut app, dt, 8.0, |app| position(app, body).dot(tilt * Vec3::X) > 20.0)
}

#[test]
fn a_tube_with_flat_sides_rolls_as_fast_as_in_fine_steps() {
    let [coarse, fine] = [DT, FINE].map(tube);
    // A step is 0.6 % of the time.
    assert!((coarse / fine - 1.0).abs() < 0.056, "{coarse} s, fine {fine} s");
}

#[test]
fn a_ball_rolls_down_as_fast_as_a_ball_of_rapier() {
    let seconds = |spawn: fn(&mut App, Transform) -> Entity| {
        let mut app = headless_app(DT);
        let tilt = spawn_slope(&mut app);
        let ball = spawn(&mut app, Transform::from_translation(tilt * Vec3::Y * 0.15));
        time_until(&mut app, DT, 10.0, |app| position(app, ball).dot(tilt * Vec3::X) > 20.0)
    };
    let medial = seconds(|app, transform| spawn_body(app, MedialAxis::sphere(0.15).unwrap(), transform));
    let own =
        seconds(|app, transform| app.world_mut().spawn((RigidBody::Dynamic, Collider::ball(0.15), transform)).id());
    assert!((medial / own - 1.0).abs() < 0.01, "{medial} s, rapier's {own} s");
}

#[test]
fn a_ball_bounces_as_high_and_as_often_as_in_theory() {
    let (radius, height, restitution) = (0.2, 5.0, 0.8f32);
    let mut app = headless_app(DT);
    let ground = spawn_ground(&mut app);
    app.world_mut().entity_mut(ground).insert(Restitution::coefficient(restitution));
    let ball =
        spawn_body(&mut app, MedialAxis::sphere(radius).unwrap(), Transform::from_xyz(0.0, height + radius, 0.0));
    app.world_mut().entity_mut(ball).insert(Restitution::coefficient(restitution));
    let (mut rose, mut last, mut peaks) = (false, height, Vec::new());
    for step in 0..390 {
        app.update();
        let now = position(&mut app, ball).y - radius;
        if rose && now < last {
            peaks.push((last, step as f32 * DT));
        }
        (rose, last) = (now > last, now);
    }
    assert!(peaks.len() >= 5, "{peaks:?}");
    let fall = (2.0 * height / 9.81).sqrt();
    for (n, (peak, time)) in (1..=5).zip(peaks) {
        let expected_height = height * restitution.powi(2 * n);
        let flights: f32 = (1..n).map(|k| 2.0 * restitution.powi(k)).sum();
        let expected_time = fall * (1.0 + flights + restitution.powi(n));
        // Rapier's integration loses up to 3 % of the height of a bounce, even in steps an eighth as long.
        assert!((peak / expected_height - 1.0).abs() < 0.08, "bounce {n}: {peak} m, not {expected_height} m");
        assert!((time / expected_time - 1.0).abs() < 0.01, "bounce {n}: at {time} s, not {expected_time} s");
    }
}

/// Heights of a tilted rod that falls flat on the floor, after every 1/60 s.
fn falling_rod(dt: f32) -> Vec<f32> {
    let mut app = headless_app(dt);
    spawn_ground(&mut app);
    let rod = MedialAxis::capsule(Vec3::X * -0.5, Vec3::X * 0.5, 0.05).unwrap();
    let tilted = Transform::from_xyz(0.0, 1.0, 0.0).with_rotation(Quat::from_rotation_z(0.3));
    let rod = spawn_body(&mut app, rod, tilted);
    let steps = (DT / dt).round() as u32;
    let height = |_| {
        run(&mut app, steps);
        position(&mut app, rod).y
    };
    (0..90).map(height).collect()
}

#[test]
fn a_rod_falls_flat_as_in_fine_steps() {
    let [coarse, fine] = [DT, FINE].map(falling_rod);
    let off = coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // A body at an impact of 4 m/s is late by up to half a step.
    assert!(off < 0.03, "{off} m");
}

/// Largest gain of total energy since the start, in J/kg, of falling linked tori. The first torus is fixed. `closed`: the tori form a horizontal
/// ring instead of a row along x.
fn energy_gained(count: usize, closed: bool) -> f32 {
    let mut app = headless_app(DT);
    let axis = MedialAxis::torus(0.25, 0.05, 12).unwrap();
    let (spacing, flat) = (0.38, |i: usize| Quat::from_rotation_x(if i.is_multiple_of(2) { 0.0 } else { FRAC_PI_2 }));
    let links: Vec<Entity> = (0..count)
        .map(|i| {
            let transform = if closed {
                let (angle, radius) = (i as f32 / count as f32 * TAU, count as f32 * spacing / TAU);
                let turn = Quat::from_rotation_y(FRAC_PI_2 - angle);
                Transform::from_translation(Vec3::new(angle.cos(), 0.0, angle.sin()) * radius)
                    .with_rotation(turn * flat(i))
            } else {
                Transform::from_xyz(spacing * i as f32, 0.0, 0.0).with_rotation(flat(i))
            };
            spawn_body(&mut app, axis.clone(), transform)
        })
        .collect();
    app.world_mut().entity_mut(links[0]).insert(RigidBody::Fixed);
    app.update();
    let [_, start] = energies(&mut app, &links[1..]);
    let mut most = f32::MIN;
    for _ in 0..240 {
        app.update();
        let [_, now] = energies(&mut app, &links[1..]);
        most = most.max(now - start);
    }
    most
}

#[test]
fn linked_tori_gain_no_energy() {
    let rows = [2, 20, 24, 28].map(|count| (count, false));
    let rings = [24, 28, 30, 32].map(|count| (count, true));
    for (count, closed) in rows.into_iter().chain(rings) {
        let gained = energy_gained(count, closed);
        assert!(gained < 0.1, "{count} links, closed {closed}: {gained} J/kg");
    }
}

#[test]
fn bodies_spawned_at_one_position_separate_and_land() {
    let mut app = headless_app(DT);
    spawn_ground(&mut app);
    let place = Transform::from_xyz(0.0, 4.0, 0.0);
    let bears: Vec<Entity> = (0..3).map(|_| spawn_body(&mut app, model("bear"), place)).collect();
    // A free fall takes 0.9 s.
    let landed = time_until(&mut app, DT, 5.0, |app| mean_height(app, &bears) < 0.8);
    assert!(landed < 2.4, "after {landed} s");
}
