//! Bodies that fly about in a room with thin walls, with steps of several lengths.

use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};
use bevy_medial::geometry::Sphere;

const ROOM: &str = "Six bodies thrown at 5 to 15 m/s in a room with walls of 5 cm stay in it for 10 s, and their energy never exceeds the initial one. \
    At the end they rest (0.1 J/kg), and no overlap is deeper than twice the allowed depth";

/// Half of the room's size in metres.
const HALF: Vec3 = Vec3::new(2.0, 1.5, 2.0);

/// Half of the walls' thickness.
const WALL: f32 = 0.025;

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "steps of 1/240 s", criterion: ROOM, seeds: [1, 2], run: |m, s| room(m, s, 1.0 / 240.0, false) },
    Hazard { name: "steps of 1/60 s", criterion: ROOM, seeds: [1, 2], run: |m, s| room(m, s, 1.0 / 60.0, false) },
    Hazard { name: "steps of 1/10 s", criterion: ROOM, seeds: [1, 2], run: |m, s| room(m, s, 0.1, false) },
    Hazard { name: "one step of 0.5 s", criterion: ROOM, seeds: [1, 2], run: |m, s| room(m, s, 1.0 / 60.0, true) },
];

/// One of six shapes of about half a metre.
pub fn piece(number: usize) -> Form {
    match number % 6 {
        0 => Form::ball(0.2),
        1 => Form::capsule(0.25, 0.05),
        2 => Form::rounded(Vec3::new(0.2, 0.1, 0.15), 0.02),
        3 => Form::torus(0.2, 0.05),
        4 => Form::cone(Sphere::new(Vec3::X * -0.15, 0.15), Sphere::new(Vec3::X * 0.15, 0.05)),
        _ => Form::rounded(Vec3::new(0.15, 0.15, 0.15), 0.0),
    }
}

/// The six walls of the room, whose floor is at height 0.
fn add_walls(world: &mut World) -> Result<(), String> {
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let mut half = HALF + 2.0 * WALL;
            half[axis] = WALL;
            let mut place = Vec3::Y * HALF.y;
            place[axis] += side * (HALF[axis] + WALL);
            world.add(Body::fixed(Form::Cuboid(half)).at(place))?;
        }
    }
    Ok(())
}

fn room(method: &Method, seed: u64, dt: f32, hitch: bool) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup { dt, ..Setup::default() })?;
    add_walls(&mut world)?;
    for i in 0..6 {
        let place = Vec3::new((i % 3) as f32 * 1.2 - 1.2, 0.8 + (i / 3) as f32 * 0.9, (i % 2) as f32 * 1.4 - 0.7);
        let direction = random.in_ball().normalize_or(Vec3::X);
        let body = Body::dynamic(piece(i)).at(place).turned(random.rotation()).damped().fast();
        world.add(body.moving(direction * (5.0 + 10.0 * random.unit())).spinning(random.in_ball() * 5.0))?;
    }
    let energy = world.energy();
    let hitch_at = 0.2 + 0.6 * random.unit();
    let mut hitch = hitch;
    while world.time < 10.0 {
        let dt = if hitch && world.time > hitch_at { 0.5 } else { dt };
        hitch &= dt < 0.5;
        world.step_of(dt)?;
        for body in world.dynamic() {
            let out = (world.center(body) - Vec3::Y * HALF.y).abs() - HALF;
            ensure(out.max_element() < 0.0, || format!("escaped: a body leaves the room after {:.2} s", world.time))?;
        }
        let gained = world.energy_gain(energy);
        ensure(gained < 0.01, || format!("energy: grows by {:.0} % until {:.2} s", 100.0 * gained, world.time))?;
    }
    for body in world.dynamic() {
        let left = world.kinetic(body) / world.mass(body);
        ensure(left < 0.1, || format!("unrest: a body still has {left:.2} J/kg after 10 s"))?;
    }
    world.check_overlaps(2.0)
}
