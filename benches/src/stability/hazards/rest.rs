//! Rest: stacks, degenerate contacts, bodies that overlap at the start, and squeezed bodies.

use std::f32::consts::FRAC_PI_2;

use bevy_medial::random::Random;
use glam::{Quat, Vec3};

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const REST: &str = "After 5 s all bodies rest for 5 s: no body drifts or turns by 1 % of its size, or moves at 0.1 m/s. At the end no overlap \
    is deeper than allowed (6 mm and 2 % of the smaller body's size)";

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "parallel cones", criterion: REST, seeds: [1, 2], run: parallel },
    Hazard { name: "coplanar slabs", criterion: REST, seeds: [1, 2], run: coplanar },
    Hazard {
        name: "deep overlap at start",
        criterion: "Two bodies on a floor overlap by half at the start. Within 5 s their overlap shrinks to the allowed depth. They are never faster than \
            5 m/s, or higher than twice their size above their start",
        seeds: [3, 6],
        run: deep,
    },
    Hazard { name: "stack of ten boxes", criterion: STACK, seeds: [1, 2], run: |m, s| stack(m, s, false) },
    Hazard { name: "stack of ten tori", criterion: STACK, seeds: [1, 2], run: |m, s| stack(m, s, true) },
    Hazard {
        name: "squeezed",
        criterion: "Two moving walls squeeze a body to 95 % of its thickness. It is never behind a wall, and never faster than 5 m/s",
        seeds: [3, 6],
        run: squeezed,
    },
];

const STACK: &str = "The stack stands: after 10 s the height of each body is exact to 5 mm and 1 % of its thickness per layer, and all bodies rest for 5 s";

/// Two capsules side by side between walls, and one in the groove on top of them.
fn parallel(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let radius = 0.1 + 0.05 * random.unit();
    let across = Quat::from_rotation_y(FRAC_PI_2);
    for side in [-1.0, 1.0] {
        let place = Vec3::new(side * (2.0 * radius + 0.1), 0.5, 0.0);
        world.add(Body::fixed(Form::Cuboid(Vec3::new(0.1, 0.5, 1.0))).at(place))?;
        let log = Body::dynamic(Form::capsule(0.3 + 0.2 * random.unit(), radius)).turned(across).damped();
        world.add(log.at(Vec3::new(side * radius, radius, 0.0)))?;
    }
    let top = Body::dynamic(Form::capsule(0.4, radius)).turned(across).damped();
    world.add(top.at(Vec3::Y * (radius * (1.0 + 3f32.sqrt()) + 0.01)))?;
    world.run(5.0)?;
    world.check_rest(5.0)
}

/// Two plates of two slabs each side by side, two more flush on top of them, and one on top across the gap.
fn coplanar(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let half = Vec3::new(0.3 + 0.1 * random.unit(), 0.05, 0.3);
    let plate = || Body::dynamic(Form::rounded(half, half.y));
    for layer in 0..2 {
        for side in [-1.0, 1.0] {
            let place = Vec3::new(side * (half.x + 5e-4), half.y * (1.0 + 2.0 * layer as f32), 0.0);
            world.add(plate().at(place))?;
        }
    }
    world.add(plate().at(Vec3::Y * (5.0 * half.y + 5e-3)))?;
    world.run(5.0)?;
    world.check_rest(5.0)
}

fn deep(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let (form, half) = match seed % 3 {
        0 => (Form::ball(0.2), 0.2),
        1 => (Form::rounded(Vec3::splat(0.2), 0.02), 0.2),
        _ => (Form::torus(0.25, 0.08), 0.08),
    };
    let aside = random.in_ball() * Vec3::new(1.0, 0.0, 1.0);
    let aside = aside.normalize_or(Vec3::X) * half;
    let mut bodies = Vec::new();
    for side in [-0.5, 0.5] {
        let body = Body::dynamic(form.clone()).damped();
        bodies.push(world.add(body.at(Vec3::Y * half + aside * side))?);
    }
    let highest = half + 2.0 * world.size(bodies[0]);
    for _ in 0..300 {
        world.step(1)?;
        for &body in &bodies {
            let (speed, height) = (world.state(body).linear.length(), world.center(body).y);
            ensure(speed < 5.0 && height < highest, || format!("thrown: {speed:.1} m/s at a height of {height:.1} m"))?;
            ensure(height > 0.0, || "through: is pressed through the floor".into())?;
        }
    }
    world.check_overlaps(1.0)
}

fn stack(method: &Method, seed: u64, tori: bool) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let (form, half) =
        if tori { (Form::torus(0.4, 0.1), 0.1) } else { (Form::rounded(Vec3::new(0.3, 0.15, 0.3), 0.02), 0.15) };
    let mut bodies = Vec::new();
    for layer in 0..10 {
        // Slightly displaced and rotated, as in a real stack.
        let aside = random.in_ball() * Vec3::new(0.01, 0.0, 0.01);
        let place = Vec3::Y * (half * (1.0 + 2.0 * layer as f32) + 1e-3 * layer as f32) + aside;
        let turned = Quat::from_rotation_y(0.2 * random.signed());
        bodies.push(world.add(Body::dynamic(form.clone()).at(place).turned(turned))?);
    }
    world.run(10.0)?;
    for (layer, body) in bodies.iter().enumerate() {
        let off = (world.state(*body).pose.translation.y - half * (1.0 + 2.0 * layer as f32)).abs();
        let allowed = (5e-3 + 0.01 * 2.0 * half) * (layer + 1) as f32;
        ensure(off < allowed, || format!("falls: body {} of the stack is off its height by {off:.3} m", layer + 1))?;
    }
    world.check_rest(5.0)
}

fn squeezed(method: &Method, seed: u64) -> Result<(), String> {
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let (form, half) = match seed % 3 {
        0 => (Form::ball(0.25), 0.25),
        1 => (Form::rounded(Vec3::splat(0.25), 0.03), 0.25),
        _ => (Form::capsule(0.2, 0.1), 0.3),
    };
    let thickness = 0.1;
    let gap = 0.05 + 0.05 * Random(seed).unit();
    let body = world.add(Body::dynamic(form).at(Vec3::Y * (if seed % 3 == 2 { 0.1 } else { half })))?;
    let walls = [-1.0, 1.0].map(|side| {
        let wall = Body::kinematic(Form::Cuboid(Vec3::new(thickness, 0.5, 0.5)));
        // At this speed the walls squeeze the body to 95 % in one second.
        let speed = gap + 0.05 * half;
        world.add(wall.at(Vec3::new(side * (half + gap + thickness), 0.5, 0.0)).moving(Vec3::X * -side * speed))
    });
    let walls = [walls[0].clone()?, walls[1].clone()?];
    for step in 0..240 {
        if step == 60 {
            for (wall, side) in walls.iter().zip([-1.0, 1.0]) {
                world.push(*wall, Vec3::X * side * 0.5);
            }
        }
        if step == 120 {
            walls.iter().for_each(|&wall| world.push(wall, Vec3::ZERO));
        }
        world.step(1)?;
        let speed = world.state(body).linear.length();
        ensure(speed < 5.0, || format!("thrown: shot out at {speed:.1} m/s"))?;
        let center = world.center(body);
        ensure(center.y > 0.0, || "through: is pressed through the floor".into())?;
        let [left, right] = walls.map(|wall| world.center(wall).x);
        let beside = center.y < 1.0 && center.z.abs() < 0.5;
        ensure(!beside || (left < center.x && center.x < right), || "through: is behind a wall".into())?;
    }
    Ok(())
}
