//! Linked rings, which have to stay linked.

use std::f32::consts::{FRAC_PI_2, TAU};

use bevy_medial::random::Random;
use glam::{Quat, Vec3};

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        name: "linked tori, thrown",
        criterion: "One of two linked tori is thrown at 5 to 20 m/s. They are linked in every step of 5 s, and energy does not grow",
        seeds: [3, 6],
        run: thrown,
    },
    Hazard {
        name: "chain under load",
        criterion: "Six rings hang from a fixed ring. The last one has twenty times the mass of the others. For 10 s each ring is linked with the next, and at the \
            end no overlap is deeper than five times the allowed depth",
        seeds: [1, 2],
        run: chain,
    },
];

/// Radii of the rings.
const MAJOR: f32 = 0.25;
const MINOR: f32 = 0.05;

/// True if the middle line of one ring passes through the other.
fn are_linked(world: &World, one: usize, other: usize) -> bool {
    let to_one = world.state(one).pose.inv_mul(&world.state(other).pose);
    let point = |i: usize| {
        let (sin, cos) = (TAU * (i % 96) as f32 / 96.0).sin_cos();
        to_one.transform_point(Vec3::new(MAJOR * cos, 0.0, MAJOR * sin))
    };
    let crosses = |i: &usize| {
        let (a, b) = (point(*i), point(i + 1));
        let through = |t: f32| a.lerp(b, t).length() < MAJOR;
        (a.y > 0.0) != (b.y > 0.0) && through(a.y / (a.y - b.y))
    };
    (0..96).filter(crosses).count() % 2 == 1
}

fn thrown(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::weightless())?;
    let ring = || Body::dynamic(Form::torus(MAJOR, MINOR)).fast();
    let first = world.add(ring())?;
    let velocity = random.in_ball().normalize_or(Vec3::X) * (5.0 + 15.0 * random.unit());
    let second = ring().at(Vec3::X * MAJOR).turned(Quat::from_rotation_x(FRAC_PI_2)).moving(velocity);
    let second = world.add(second.spinning(random.in_ball() * 10.0))?;
    let energy = world.energy();
    for _ in 0..300 {
        world.step(1)?;
        ensure(are_linked(&world, first, second), || format!("unlinked: after {:.2} s", world.time))?;
        let gained = world.energy_gain(energy);
        ensure(gained < 0.01, || format!("energy: grows by {:.0} % until {:.2} s", 100.0 * gained, world.time))?;
    }
    Ok(())
}

fn chain(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    let ring = Form::torus(MAJOR, MINOR);
    // Each ring hangs in the one above it. They are 1 cm apart.
    let pitch = 2.0 * (MAJOR - MINOR) - 0.01;
    let upright = Quat::from_rotation_x(FRAC_PI_2);
    let mut rings = vec![world.add(Body::fixed(ring.clone()).turned(upright))?];
    for i in 1..=6 {
        let turned = Quat::from_rotation_y(if i % 2 == 0 { 0.0 } else { FRAC_PI_2 }) * upright;
        let body = Body::dynamic(ring.clone()).at(Vec3::Y * (-pitch * i as f32)).turned(turned).damped();
        let body = body.dense(if i == 6 { 20.0 } else { 1.0 }).moving(random.in_ball());
        rings.push(world.add(body)?);
    }
    for _ in 0..600 {
        world.step(1)?;
        for pair in rings.windows(2) {
            ensure(are_linked(&world, pair[0], pair[1]), || {
                format!("unlinked: the chain breaks after {:.2} s", world.time)
            })?;
        }
    }
    world.check_overlaps(5.0)
}
