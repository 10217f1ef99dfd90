//! Shapes that are difficult for kernels: sharp, degenerate and nearly degenerate ones.

use bevy_medial::geometry::{Primitive, Sphere};
use bevy_medial::random::Random;
use glam::Vec3;

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

pub const HAZARDS: &[Hazard] = &[
    Hazard {
        name: "sharp features",
        criterion: "Boxes and spikes of radius 0 fall on their corners and tips at 3 to 10 m/s. They do not sink into the floor by more than 5 % \
            of their size, and rest at the end",
        seeds: [4, 8],
        run: sharp,
    },
    Hazard {
        name: "degenerate shapes",
        criterion: "Degenerate and nearly degenerate shapes (a cone of two equal balls, a slab on a line, slivers, needles, balls within balls) \
            fall. They do not sink into the floor by more than 5 % of their size, and rest at the end",
        seeds: [6, 6],
        run: degenerate,
    },
];

/// Lets a body fall, and checks that it comes to rest on the floor.
fn falls_and_rests(world: &mut World, body: usize) -> Result<(), String> {
    for _ in 0..480 {
        world.step(1)?;
        let depth = -world.lowest(body);
        let share = depth / world.size(body);
        ensure(share < 0.05, || format!("sinks: into the floor by {:.0} % of its size", 100.0 * share))?;
    }
    let height = world.lowest(body);
    ensure(height < 0.01 * world.size(body), || format!("hangs: {height:.3} m over the floor"))?;
    world.check_rest(3.0)
}

fn sharp(method: &Method, seed: u64) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let form = match seed % 4 {
        0 => Form::rounded(Vec3::new(0.3, 0.2, 0.1), 0.0),
        1 => Form::cone(Sphere::new(Vec3::Y * 0.3, 0.15), Sphere::new(Vec3::Y * -0.3, 0.0)),
        2 => Form::slab([
            Sphere::new(Vec3::Y * -0.3, 0.0),
            Sphere::new(Vec3::new(-0.2, 0.2, 0.0), 0.1),
            Sphere::new(Vec3::new(0.2, 0.2, 0.0), 0.1),
        ]),
        _ => Form::rounded(Vec3::splat(0.2), 0.0),
    };
    let tilt = if seed % 4 == 1 || seed % 4 == 2 { 0.1 } else { 3.0 };
    let rotation = glam::Quat::from_scaled_axis(random.in_ball() * tilt);
    let body = Body::dynamic(form).turned(rotation).at(Vec3::Y * 1.0).damped().fast();
    let body = world.add(body.moving(Vec3::Y * -(3.0 + 7.0 * random.unit())))?;
    falls_and_rests(&mut world, body)
}

fn degenerate(method: &Method, seed: u64) -> Result<(), String> {
    let ball = |x: f32, y: f32, z: f32, radius: f32| Sphere::new(Vec3::new(x, y, z), radius);
    let slab = |balls: [Sphere; 3]| Form::slab(balls);
    let form = match seed % 6 {
        0 => Form::cone(ball(0.0, 0.0, 0.0, 0.2), ball(0.0, 0.0, 0.0, 0.2)),
        // On a line.
        1 => slab([ball(-0.3, 0.0, 0.0, 0.1), ball(0.0, 0.0, 0.0, 0.1), ball(0.3, 0.0, 0.0, 0.1)]),
        // A sliver.
        2 => slab([ball(-0.3, 0.0, 0.0, 0.05), ball(0.3, 0.0, 0.0, 0.05), ball(0.1, 0.0, 1e-5, 0.05)]),
        // One ball is almost within the other.
        3 => Form::cone(ball(0.0, 0.0, 0.0, 0.2), ball(0.1 + 1e-6, 0.0, 0.0, 0.1)),
        // A needle.
        4 => Form::cone(ball(-0.5, 0.0, 0.0, 1e-3), ball(0.5, 0.0, 0.0, 1e-3)),
        // Several copies of the same ball.
        _ => Form::medial(
            vec![
                ball(-0.2, 0.0, 0.0, 0.1),
                ball(0.2, 0.0, 0.0, 0.1),
                ball(0.2, 0.0, 1e-7, 0.1),
                ball(0.2, 0.0, 0.0, 0.1),
            ],
            vec![Primitive::Cone([0, 1]), Primitive::Cone([0, 2]), Primitive::Slab([0, 2, 3]), Primitive::Cone([1, 3])],
        ),
    };
    let mut world = World::new(method, Setup::default())?;
    world.add_floor()?;
    let rotation = Random(seed).rotation();
    let body = world.add(Body::dynamic(form).at(Vec3::Y).turned(rotation).damped())?;
    falls_and_rests(&mut world, body)
}
