//! Fast impacts: of bodies at thin walls, of two bodies, and of spinning bodies.

use std::f32::consts::TAU;

use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{
        judge::{World, first_touch, impulse},
        methods::Method,
    },
};

const WALL: &str =
    "No sphere centre of the body ever passes the middle of a wall of 5 cm. At the end the body does not fly into it";
const TRANSFER: &str = "At least half of the impulse of a frictionless impact without restitution is transferred. Momentum is kept to 1 %, \
    energy does not grow, and at the end the overlap is no deeper than allowed";
const SPIN: &str = "A rod that turns by 720 degrees per step hits a ball or a post. The velocity of the ball, or of the rod at a post, changes by 1 m/s. \
    Momentum is kept to 1 %, and energy does not grow";

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "thin wall, 1 m/s", criterion: WALL, seeds: [4, 8], run: |m, s| thin_wall(m, s, 1.0) },
    Hazard { name: "thin wall, 10 m/s", criterion: WALL, seeds: [4, 8], run: |m, s| thin_wall(m, s, 10.0) },
    Hazard { name: "thin wall, 100 m/s", criterion: WALL, seeds: [4, 8], run: |m, s| thin_wall(m, s, 100.0) },
    Hazard { name: "thin wall, 1000 m/s", criterion: WALL, seeds: [4, 8], run: |m, s| thin_wall(m, s, 1000.0) },
    Hazard { name: "body at rest, 10 m/s", criterion: TRANSFER, seeds: [4, 8], run: |m, s| meet(m, s, 10.0, false) },
    Hazard { name: "body at rest, 100 m/s", criterion: TRANSFER, seeds: [4, 8], run: |m, s| meet(m, s, 100.0, false) },
    Hazard {
        name: "body at rest, 1000 m/s",
        criterion: TRANSFER,
        seeds: [4, 8],
        run: |m, s| meet(m, s, 1000.0, false),
    },
    Hazard { name: "two bullets, 100 m/s", criterion: TRANSFER, seeds: [4, 8], run: |m, s| meet(m, s, 100.0, true) },
    Hazard { name: "two bullets, 1000 m/s", criterion: TRANSFER, seeds: [4, 8], run: |m, s| meet(m, s, 1000.0, true) },
    Hazard { name: "spin of 720° a step", criterion: SPIN, seeds: [4, 8], run: spin },
];

/// A ball, a rod, a box or a torus, by the seed.
fn bullet(seed: u64) -> Body {
    Body::dynamic(match seed % 4 {
        0 => Form::ball(0.2),
        1 => Form::capsule(0.5, 0.02),
        2 => Form::rounded(Vec3::new(0.2, 0.1, 0.3), 0.02),
        _ => Form::torus(0.3, 0.06),
    })
    .fast()
}

fn thin_wall(method: &Method, seed: u64, speed: f32) -> Result<(), String> {
    let mut random = Random(seed);
    let setup = Setup::weightless();
    let mut world = World::new(method, setup)?;
    let wall = Vec3::new(0.025, 5.0, 5.0);
    world.add(Body::fixed(Form::Cuboid(wall)))?;
    let body = bullet(seed);
    let direction = (Vec3::X + random.in_ball() * Vec3::new(0.0, 0.3, 0.3)).normalize();
    let away = 0.5 * body.size() + 0.1 + random.unit() * speed * setup.dt;
    let body = body
        .at(direction * -away)
        .turned(random.rotation())
        .moving(direction * speed)
        .spinning(random.in_ball() * 10.0);
    let time = (away + 3.0 * body.size()) / speed + 0.5;
    let body = world.add(body)?;
    for _ in 0..(time / setup.dt) as u32 {
        world.step(1)?;
        let behind = |center: &Vec3| center.x > 0.0 && center.abs().yz_max() < wall.y;
        ensure(!world.sphere_centers(body).iter().any(behind), || "through: a part is behind the wall".into())?;
    }
    let left = world.state(body).linear.x / speed;
    ensure(left < 0.1, || format!("flies on: into the wall at {:.0} % of its speed", 100.0 * left))
}

trait YzMax {
    fn yz_max(self) -> f32;
}

impl YzMax for Vec3 {
    fn yz_max(self) -> f32 {
        self.y.max(self.z)
    }
}

fn meet(method: &Method, seed: u64, speed: f32, head_on: bool) -> Result<(), String> {
    let mut random = Random(seed);
    let setup = Setup::weightless();
    let (first, second, impulse, time) = loop {
        let second = bullet(seed).slippery().turned(random.rotation());
        let second = if head_on { second.moving(Vec3::X * -speed) } else { second };
        let away = second.size() + 0.2 + random.unit() * speed * setup.dt;
        let aside = random.in_ball() * Vec3::new(0.0, 0.4, 0.4) * second.size();
        let first = bullet(seed).slippery().at(aside - Vec3::X * away).turned(random.rotation());
        let first = first.moving(Vec3::X * speed);
        let touch = first_touch(&first, &second, 2.0 * away / speed);
        let Some(touch) = touch else { continue };
        let impulse = impulse(&first, &second, touch);
        // Grazes are left out, because their small impulse may be lost to rounding.
        if impulse > 0.25 * speed * first.mass().volume {
            break (first, second, impulse * touch.2, touch.0);
        }
    };
    let mut world = World::new(method, setup)?;
    let size = first.size();
    let bodies = [world.add(first)?, world.add(second)?];
    let before = bodies.map(|body| world.momentum(body));
    let energy = world.energy();
    world.run(time + size / speed + 0.2)?;
    let after = bodies.map(|body| world.momentum(body));
    let change = (after[0] + after[1] - before[0] - before[1]).length() / before[0].length();
    ensure(change < 0.01, || format!("momentum: changes by {:.0} %", 100.0 * change))?;
    let gained = world.energy_gain(energy);
    ensure(gained < 0.01, || format!("energy: grows by {:.0} %", 100.0 * gained))?;
    let transfer = (before[0] - after[0]).dot(impulse) / impulse.length_squared();
    ensure(transfer > 0.5, || format!("through: transfers {:.0} % of the impulse", 100.0 * transfer))?;
    world.check_overlaps(1.0)
}

fn spin(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let setup = Setup::weightless();
    let mut world = World::new(method, setup)?;
    let against_ball = seed.is_multiple_of(2);
    let target = if against_ball {
        Body::dynamic(Form::ball(0.15)).slippery().fast()
    } else {
        Body::fixed(Form::Cuboid(Vec3::new(0.05, 0.05, 1.0)))
    };
    let target = world.add(target)?;
    let rod = Body::dynamic(Form::capsule(0.5, 0.03))
        .at(Vec3::new(-1.0 - random.unit(), 0.2 * random.signed(), 0.0))
        .turned(glam::Quat::from_rotation_z(TAU * random.unit()))
        .moving(Vec3::X * 5.0)
        .spinning(Vec3::Z * (2.0 * TAU / setup.dt))
        .slippery()
        .fast();
    let rod = world.add(rod)?;
    let [energy, mut momentum] = [world.energy(), world.momentum(rod).x];
    let start = world.state(rod).linear;
    world.run(1.0)?;
    let gained = world.energy_gain(energy);
    ensure(gained < 0.01, || format!("energy: grows by {:.0} %", 100.0 * gained))?;
    let hit = world.state(rod).linear.distance(start);
    if against_ball {
        let ball = world.state(target).linear.length();
        let total = world.momentum(rod) + world.momentum(target);
        momentum = (total.x - momentum).hypot(total.y) / (world.mass(rod) * 5.0);
        ensure(momentum < 0.01, || format!("momentum: changes by {:.0} %", 100.0 * momentum))?;
        return ensure(ball > 1.0, || "through: the ball stays where it is".into());
    }
    ensure(hit > 1.0, || "through: the post does not change the velocity of the rod".into())
}
