//! Time: motion in steps of 1/60 s takes as long as in finer steps or in theory. Bodies that are stopped at contacts would be late.

use bevy_medial::random::Random;
use glam::{Quat, Vec3};

use super::{Hazard, ensure, rooms::piece};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const PILE: &str = "The mean height of 36 bodies that fall in a heap is the same as in steps of 1/480 s with the same method, in every sixth of a second for 2 s, \
    to 3 % of the drop";
const ROLL: &str = "A ball rolls 20 m down a slope of 20 degrees, in the time of theory to 1 %. A capsule that lies across the slope does so to 2 %";

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "falling pile keeps time", criterion: PILE, seeds: [2, 2], run: pile },
    Hazard { name: "rolling keeps time", criterion: ROLL, seeds: [2, 2], run: roll },
];

fn pile(method: &Method, seed: u64) -> Result<(), String> {
    let coarse = heights(method, seed, 1.0 / 60.0)?;
    let fine = heights(method, seed, 1.0 / 480.0)?;
    let drop = fine[0] - fine[fine.len() - 1];
    for (i, (coarse, fine)) in coarse.iter().zip(&fine).enumerate() {
        let error = (coarse - fine) / drop;
        ensure(error.abs() < 0.03, || {
            format!("time: the pile is {:.1} % of the drop off after {:.2} s", 100.0 * error, i as f32 / 6.0)
        })?;
    }
    Ok(())
}

/// Returns the mean height of the bodies of a falling pile in every sixth of a second, in metres. `dt`: length of a step in
/// seconds.
fn heights(method: &Method, seed: u64, dt: f32) -> Result<Vec<f32>, String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup { dt, ..Setup::default() })?;
    world.add_floor()?;
    for i in 0..36 {
        let (layer, rest) = (i / 9, i % 9);
        let place = Vec3::new((rest % 3) as f32 - 1.0, 0.0, (rest / 3) as f32 - 1.0) * 0.75;
        let center = place + Vec3::Y * (2.6 + 0.75 * layer as f32) + random.in_ball() * 0.05;
        world.add(Body::dynamic(piece(i)).at(center).turned(random.rotation()).damped())?;
    }
    let mean = |world: &World| {
        let bodies = world.dynamic();
        bodies.iter().map(|&body| world.center(body).y).sum::<f32>() / bodies.len() as f32
    };
    let mut heights = vec![mean(&world)];
    for _ in 0..12 {
        world.run(1.0 / 6.0)?;
        heights.push(mean(&world));
    }
    Ok(heights)
}

fn roll(method: &Method, seed: u64) -> Result<(), String> {
    let radius = 0.3 + 0.1 * Random(seed).unit();
    let across = Quat::from_rotation_y(90f32.to_radians());
    descend(method, "ball", &Body::dynamic(Form::ball(radius)), radius, 0.01)?;
    descend(method, "capsule", &Body::dynamic(Form::capsule(0.4, radius)).turned(across), radius, 0.02)
}

/// Lets a round body roll 20 m down a slope, and compares the time with theory. The body's axis is along its x axis.
///
/// `radius`: in metres. `tolerance`: fraction of the time of theory.
fn descend(method: &Method, name: &str, body: &Body, radius: f32, tolerance: f32) -> Result<(), String> {
    let (angle, distance, start) = (20f32.to_radians(), 20.0, -12.0);
    let tilt = Quat::from_rotation_z(-angle);
    let setup = Setup::default();
    let mut world = World::new(method, setup)?;
    world.add(Body::fixed(Form::Cuboid(Vec3::new(15.0, 0.5, 5.0))).at(tilt * Vec3::Y * -0.5).turned(tilt))?;
    let turned = tilt * body.pose.rotation;
    let rolling = world.add(body.clone().at(tilt * Vec3::new(start, radius, 0.0)).turned(turned))?;
    let mass = body.mass();
    let inertia = mass.inertia.x_axis.x / (mass.volume * radius * radius);
    let acceleration = setup.gravity * angle.sin() / (1.0 + inertia);
    let expected = (2.0 * distance / acceleration).sqrt();
    let slope = tilt * Vec3::X;
    let mut path = 0.0;
    while path < distance {
        ensure(world.time < 2.0 * expected, || format!("time: the {name} has rolled {path:.1} m of {distance} m"))?;
        world.step(1)?;
        path = world.center(rolling).dot(slope) - start;
    }
    let time = world.time - (path - distance) / world.state(rolling).linear.dot(slope);
    let error = time / expected - 1.0;
    ensure(error.abs() < tolerance, || format!("time: the {name} takes {:.1} % too long", 100.0 * error))
}
