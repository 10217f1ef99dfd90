//! Near misses: bodies that pass each other by 2 cm, which must not affect their flight.

use std::f32::consts::FRAC_PI_2;

use bevy_medial::random::Random;
use glam::{Quat, Vec3};

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const MISS: &str = "Two bodies pass each other by 2 cm by construction. They keep their velocities to 0.1 %, and their places are those of free flight, \
    to 1 % of their size";

/// Clearance in metres.
const CLEARANCE: f32 = 0.02;

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "near miss, 10 m/s", criterion: MISS, seeds: [4, 8], run: |m, s| miss(m, s, 10.0) },
    Hazard { name: "near miss, 100 m/s", criterion: MISS, seeds: [4, 8], run: |m, s| miss(m, s, 100.0) },
    Hazard { name: "near miss, 1000 m/s", criterion: MISS, seeds: [4, 8], run: |m, s| miss(m, s, 1000.0) },
];

/// Two bodies that miss each other. The first flies along x, and passes the origin.
fn flights(seed: u64, speed: f32) -> [Body; 2] {
    let mut random = Random(seed);
    let angle = Quat::from_rotation_x(std::f32::consts::TAU * random.unit());
    let beside = angle * Vec3::Y;
    let ball = |radius| Body::dynamic(Form::ball(radius)).fast();
    let spin = beside * 100.0;
    match seed % 4 {
        // Past each other.
        0 => [
            ball(0.2).moving(Vec3::X * speed),
            ball(0.15).at(beside * (0.35 + CLEARANCE)).moving(Vec3::X * -speed).spinning(random.in_ball() * 100.0),
        ],
        // Through a hole.
        1 => {
            let hole = Body::dynamic(Form::torus(0.3, 0.06)).turned(Quat::from_rotation_z(FRAC_PI_2)).fast();
            // Between the corners of the ring its tube is nearer to the middle.
            let inner = 0.3 * (std::f32::consts::PI / 24.0).cos() - 0.06;
            let rod = Body::dynamic(Form::capsule(0.5, 0.03)).at(beside * (inner - 0.03 - CLEARANCE));
            [rod.moving(Vec3::X * speed).fast(), hole]
        }
        // In parallel planes, turning in them.
        2 => {
            let rod = || Body::dynamic(Form::capsule(0.5, 0.03)).turned(angle).fast();
            [rod().moving(Vec3::X * speed).spinning(spin), rod().at(beside * (0.06 + CLEARANCE)).spinning(-spin)]
        }
        // Past the edge of a box.
        _ => {
            let edge = Body::fixed(Form::Cuboid(Vec3::new(0.5, 1.0, 0.5))).turned(angle);
            [ball(0.2).at(beside * (1.2 + CLEARANCE)).moving(Vec3::X * speed), edge]
        }
    }
}

fn miss(method: &Method, seed: u64, speed: f32) -> Result<(), String> {
    let setup = Setup::weightless();
    let mut world = World::new(method, setup)?;
    let [mut first, mut second] = flights(seed, speed);
    // The bodies pass each other within a step, at a random time.
    let steps = (3.0 / (speed * setup.dt)).ceil();
    let before = (steps + Random(seed + 100).unit()) * setup.dt;
    for body in [&mut first, &mut second] {
        body.pose.translation -= body.linear * before;
    }
    let flyers = [first, second];
    let bodies = [world.add(flyers[0].clone())?, world.add(flyers[1].clone())?];
    let count = 2 * steps as u32 + 2;
    world.step(count)?;
    for (flyer, body) in flyers.iter().zip(bodies) {
        let state = world.state(body);
        let change = state.linear.distance(flyer.linear) / speed;
        ensure(change < 1e-3, || format!("ghost: a velocity changes by {:.1} %", 100.0 * change))?;
        let place = flyer.pose.translation + flyer.linear * (count as f32 * setup.dt);
        let off = state.pose.translation.distance(place);
        // Rounding of a sum of steps in f32.
        let rounding = 1e-5 * flyer.linear.length() * count as f32 * setup.dt + 1e-4;
        ensure(off < 0.01 * flyer.size() + rounding, || format!("held up: {:.2} m off its free flight", off))?;
    }
    Ok(())
}
