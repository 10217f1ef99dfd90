//! Large ratios of mass and size, very small and very large bodies, and bodies far from the origin.

use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const SCALED: &str = "Three stacked boxes, a torus and a capsule of this size fall by half their size. They rest on the floor for 5 s: \
    no body drifts by 1 %, and no overlap is deeper than allowed. All engines get the unit of length, and gravity is proportional to it \
    for small bodies";

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        name: "mass ratio 1:1000",
        criterion: "A box comes to rest on a box of a thousandth of its mass, and their overlap is no deeper than twice the allowed depth. \
            A heavy ball carries a light one along at its own speed, to 2 %",
        seeds: [2, 4],
        run: masses,
    },
    Hazard {
        name: "size ratio 1:1000",
        criterion: "Balls, boxes and tori of 2 cm fall on a box of 20 m at 5 to 30 m/s. They come to rest at most 6 mm inside or above its surface",
        seeds: [6, 12],
        run: sizes,
    },
    Hazard { name: "bodies of 1 mm", criterion: SCALED, seeds: [1, 2], run: |m, s| scaled(m, s, 1e-3, Vec3::ZERO) },
    Hazard { name: "bodies of 1 km", criterion: SCALED, seeds: [1, 2], run: |m, s| scaled(m, s, 1e3, Vec3::ZERO) },
    Hazard {
        name: "10 km from the origin",
        criterion: "The same with bodies of half a metre at 10 km from the origin, where coordinates are exact to half a millimetre",
        seeds: [1, 2],
        run: |m, s| scaled(m, s, 0.5, Vec3::new(7000.0, 0.0, -7000.0)),
    },
];

fn masses(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    if seed.is_multiple_of(2) {
        let mut world = World::new(method, Setup::default())?;
        world.add_floor()?;
        let half = Vec3::splat(0.2 + 0.1 * random.unit());
        let form = Form::rounded(half, 0.02);
        world.add(Body::dynamic(form.clone()).at(Vec3::Y * half.y))?;
        let heavy = Body::dynamic(form).dense(1000.0).at(Vec3::Y * (3.0 * half.y + 0.01));
        let heavy = world.add(heavy)?;
        world.run(8.0)?;
        let height = world.center(heavy).y;
        ensure(height > 2.5 * half.y, || "falls: the heavy box is beside or inside the light one".into())?;
        return world.check_overlaps(2.0);
    }
    let mut world = World::new(method, Setup::weightless())?;
    let speed = 5.0 + 15.0 * random.unit();
    let heavy = Body::dynamic(Form::ball(0.2)).dense(1000.0).at(Vec3::X * -1.0).moving(Vec3::X * speed);
    let heavy = world.add(heavy.slippery().fast())?;
    let light = world.add(Body::dynamic(Form::ball(0.2)).slippery())?;
    world.run(1.5 / speed + 0.5)?;
    for (name, body) in [("heavy", heavy), ("light", light)] {
        let found = world.state(body).linear;
        let off = found.distance(Vec3::X * speed) / speed;
        ensure(off < 0.02, || format!("momentum: the {name} ball is off the common speed by {:.0} %", 100.0 * off))?;
    }
    world.check_overlaps(1.0)
}

fn sizes(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let large = Vec3::splat(10.0);
    let ground = world.add(Body::dynamic(Form::rounded(large, 0.5)).at(Vec3::Y * large.y))?;
    let form = match seed % 3 {
        0 => Form::ball(0.01),
        1 => Form::rounded(Vec3::splat(0.01), 1e-3),
        _ => Form::torus(8e-3, 2e-3),
    };
    // The place is so far from the edges that no body bounces over them.
    let place = Vec3::new(2.0 * random.signed(), 20.2, 2.0 * random.signed());
    let small = Body::dynamic(form).at(place).turned(random.rotation()).damped().fast();
    let small = world.add(small.moving(Vec3::Y * -(5.0 + 25.0 * random.unit())))?;
    for _ in 0..600 {
        world.step(1)?;
        let top = world.state(ground).pose.translation.y + large.y;
        let depth = top - world.lowest(small);
        ensure(depth < 0.02, || format!("sinks: is {depth:.3} m within the large one after {:.2} s", world.time))?;
    }
    let off = (world.lowest(small) - 20.0).abs();
    ensure(off < 6e-3, || format!("height: is off the top of the large one by {off:.3} m in the end"))?;
    let speed = world.state(small).linear.length();
    ensure(speed < 0.1, || format!("unrest: still moves at {speed:.2} m/s"))
}

/// Bodies of a size in metres, near `origin`.
fn scaled(method: &Method, seed: u64, size: f32, origin: Vec3) -> Result<(), String> {
    let mut random = Random(seed);
    let unit = if origin == Vec3::ZERO { size } else { 1.0 };
    // In true gravity, a step is as long for bodies of 1 mm as half a second for bodies of 1 m. No engine keeps them at rest.
    let gravity = Setup::default().gravity * unit.min(1.0);
    let mut world = World::new(method, Setup { unit, gravity, ..Setup::default() })?;
    // The floor is as thick as it is long, because this hazard does not test tunnelling.
    let ground = Vec3::splat(20.0) * size;
    world.add(Body::fixed(Form::Cuboid(ground)).at(origin - Vec3::Y * ground.y))?;
    let half = 0.5 * size;
    let mut add = |form: Form, place: Vec3| {
        let aside = random.in_ball() * Vec3::new(0.02, 0.0, 0.02);
        world.add(Body::dynamic(form).at(origin + (place + aside) * size).damped())
    };
    for layer in 0..3 {
        add(Form::rounded(Vec3::new(half, 0.5 * half, half), 0.1 * half), Vec3::Y * (0.26 + 0.51 * layer as f32))?;
    }
    add(Form::torus(0.75 * half, 0.25 * half), Vec3::new(3.0, 0.6, 0.0))?;
    add(Form::capsule(0.7 * half, 0.3 * half), Vec3::new(-3.0, 0.6, 0.0))?;
    // Larger bodies fall longer.
    world.run(5.0 + 3.0 * size.sqrt().min(10.0))?;
    for body in world.dynamic() {
        let center = world.center(body) - origin;
        let inside = center.y > 0.0 && center.y < 2.0 * size && center.abs().max_element() < 5.0 * size;
        ensure(inside, || format!("escaped: a body is {:.1} sizes away", center.length() / size))?;
    }
    world.check_rest(5.0)
}
