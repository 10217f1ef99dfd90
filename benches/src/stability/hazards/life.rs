//! Operations of a game on bodies in contact.

use bevy_medial::geometry::Pose3;
use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        name: "teleport",
        criterion: "A body in contact is moved to the other side of a wall and of a resting body. The resting body does not move by 7 mm. \
            Within 3 s the moved body rests at its new place, to 7 mm",
        seeds: [2, 4],
        run: teleport,
    },
    Hazard {
        name: "despawn in contact",
        criterion: "The middle body of a stack of three is removed. The upper body falls, and rests on the lower one within 3 s",
        seeds: [2, 4],
        run: despawn,
    },
    Hazard {
        name: "scale in contact",
        criterion: "The lower body of a stack of two grows by half. Within 3 s both rest at their new heights, to 15 mm. Neither is ever faster than 5 m/s",
        seeds: [2, 4],
        run: scale,
    },
];

/// A box or a torus, and half its height.
fn form(seed: u64) -> (Form, f32) {
    if seed.is_multiple_of(2) {
        (Form::rounded(Vec3::new(0.3, 0.15, 0.3), 0.03), 0.15)
    } else {
        (Form::torus(0.3, 0.1), 0.1)
    }
}

fn teleport(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    world.add(Body::fixed(Form::Cuboid(Vec3::new(0.05, 1.0, 2.0))).at(Vec3::new(1.0, 1.0, 0.0)))?;
    let (form, half) = form(seed);
    let body = world.add(Body::dynamic(form.clone()).at(Vec3::Y * half))?;
    let between = world.add(Body::dynamic(form).at(Vec3::new(2.0, half, 0.0)))?;
    world.run(2.0 * random.unit())?;
    let before = world.center(between);
    let place = Vec3::new(3.5, half, 0.2 * random.signed());
    world.teleport(body, Pose3::from_translation(place));
    world.run(3.0)?;
    let pushed = world.center(between).distance(before);
    ensure(pushed < 7e-3, || format!("hits: the body between is pushed by {:.0} mm", 1000.0 * pushed))?;
    let off = world.center(body).distance(place);
    ensure(off < 7e-3, || format!("misplaced: is {off:.2} m from its new place"))?;
    world.check_rest(2.0)
}

/// Three bodies of one form, and half its height, at rest on each other.
fn three(method: &Method, seed: u64, (form, half): (Form, f32)) -> Result<(World, [usize; 3], f32), String> {
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let mut add = |layer: f32| world.add(Body::dynamic(form.clone()).at(Vec3::Y * (half * (1.0 + 2.0 * layer))));
    let bodies = [add(0.0)?, add(1.0)?, add(2.0)?];
    world.run(3.0 * Random(seed).unit() + 1.0)?;
    Ok((world, bodies, half))
}

fn despawn(method: &Method, seed: u64) -> Result<(), String> {
    let (mut world, [_, middle, upper], half) = three(method, seed, form(seed))?;
    world.despawn(middle);
    world.run(3.0)?;
    let off = world.center(upper).y - 3.0 * half;
    ensure(off.abs() < 0.015, || format!("hangs: the upper one is {off:.2} m over its place"))?;
    world.check_rest(2.0)
}

fn scale(method: &Method, seed: u64) -> Result<(), String> {
    // No torus, because a ring would fall into a larger one.
    let half = Vec3::new(0.3, 0.1 + 0.1 * Random(seed + 50).unit(), 0.3);
    let form = (Form::rounded(half, 0.03), half.y);
    let (mut world, [lower, middle, upper], half) = three(method, seed, form)?;
    world.despawn(upper);
    world.resize(lower, 1.5)?;
    for _ in 0..180 {
        world.step(1)?;
        let speed = [lower, middle].map(|body| world.state(body).linear.length()).into_iter().fold(0.0, f32::max);
        ensure(speed < 5.0, || format!("thrown: at {speed:.1} m/s"))?;
    }
    for (body, height) in [(lower, 1.5 * half), (middle, 4.0 * half)] {
        let off = world.center(body).y - height;
        ensure(off.abs() < 0.015, || format!("height: is off its height by {off:.3} m"))?;
    }
    world.check_rest(2.0)
}
