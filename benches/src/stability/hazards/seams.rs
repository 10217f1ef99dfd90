//! Seams: floors of many parts, which have to behave like floors of one piece.

use bevy_medial::geometry::{Primitive, Sphere};
use bevy_medial::random::Random;
use glam::{Quat, Vec3};

use super::{Hazard, ensure};
use crate::{
    body::{Body, Form, Setup},
    stability::{judge::World, methods::Method},
};

const SLIDE: &str = "A body slides without friction at 1 to 10 m/s for a second. It loses no more than 1 % of its speed per metre and 1 % of its path, \
    and does not hop by 5 mm";
const ROLL: &str = "A ball rolls at 2 to 5 m/s for 2 s. Its path is as long as on a floor of one piece, to 10 %, and it does not hop by 5 mm";

pub const HAZARDS: &[Hazard] = &[
    Hazard { name: "sliding over triangles", criterion: SLIDE, seeds: [5, 10], run: |m, s| slide(m, s, false) },
    Hazard { name: "sliding over slabs", criterion: SLIDE, seeds: [5, 10], run: |m, s| slide(m, s, true) },
    Hazard { name: "rolling over triangles", criterion: ROLL, seeds: [2, 4], run: |m, s| roll(m, s, false) },
    Hazard { name: "rolling over slabs", criterion: ROLL, seeds: [2, 4], run: |m, s| roll(m, s, true) },
];

/// A floor whose top is at height 0, from -2 m to 20 m along x, 3 m wide: cells of a quarter of a metre, of two parts each.
fn floor(slabs: bool) -> Form {
    let (columns, rows, cell) = (88, 12, 0.25);
    let at = |i: u32, k: u32| Vec3::new(i as f32 * cell - 2.0, 0.0, k as f32 * cell - 1.5);
    let points: Vec<Vec3> = (0..=columns).flat_map(|i| (0..=rows).map(move |k| at(i, k))).collect();
    let number = |i: u32, k: u32| i * (rows + 1) + k;
    let cells = (0..columns).flat_map(|i| (0..rows).map(move |k| (i, k)));
    let triangles = cells.flat_map(|(i, k)| {
        let [a, b, c, d] = [number(i, k), number(i, k + 1), number(i + 1, k + 1), number(i + 1, k)];
        [[a, b, c], [a, c, d]]
    });
    if !slabs {
        return Form::Triangles(points, triangles.collect());
    }
    let radius = 0.1;
    let spheres = points.into_iter().map(|point| Sphere::new(point - Vec3::Y * radius, radius));
    Form::medial(spheres.collect(), triangles.map(Primitive::Slab).collect())
}

fn slide(method: &Method, seed: u64, slabs: bool) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add(Body::fixed(floor(slabs)))?;
    let half = Vec3::new(0.3, 0.1, 0.2);
    let (form, height) = match seed % 5 {
        0 => (Form::ball(0.2), 0.2),
        1 => (Form::capsule(0.3, 0.1), 0.1),
        2 => (Form::rounded(half, 0.03), 0.1),
        3 => (Form::rounded(half, 0.0), 0.1),
        _ => (Form::torus(0.3, 0.08), 0.08),
    };
    // The direction is not along the grid.
    let forward = Quat::from_rotation_y(0.05 * random.signed());
    let body = Body::dynamic(form).slippery().turned(forward).at(Vec3::new(-1.0 + 0.3 * random.unit(), height, 0.019));
    let body = world.add(body)?;
    // The body settles first, because the overlap that an engine allows is not an effect of seams.
    world.run(0.5)?;
    let [speed, start] = [Vec3::new([1.0, 3.0, 10.0][seed as usize / 5 % 3], 0.0, 0.0), world.center(body)];
    let velocity = forward * speed;
    world.push(body, velocity);
    let mut hop = 0.0f32;
    for _ in 0..60 {
        world.step(1)?;
        hop = hop.max(world.center(body).y - start.y);
    }
    let (ahead, speed) = (velocity.normalize(), velocity.length());
    let way = (world.center(body) - start).dot(ahead);
    let lost = 100.0 * (1.0 - world.state(body).linear.dot(ahead) / speed) / speed;
    ensure(lost.abs() < 1.0, || format!("trips: loses {lost:.0} % of its speed a metre at {speed} m/s"))?;
    let short = 100.0 * (1.0 - way / speed);
    ensure(short.abs() < 1.0, || format!("held up: comes {short:.0} % short at {speed} m/s"))?;
    ensure(hop < 5e-3, || format!("hops: by {:.0} mm at {speed} m/s", 1000.0 * hop))
}

fn roll(method: &Method, seed: u64, slabs: bool) -> Result<(), String> {
    let mut random = Random(seed);
    let mut world = World::new(method, Setup::default())?;
    world.add(Body::fixed(floor(slabs)))?;
    let radius = 0.15 + 0.1 * random.unit();
    let speed = 2.0 + 3.0 * random.unit();
    let forward = Quat::from_rotation_y(0.03 * random.signed());
    let ball = Body::dynamic(Form::ball(radius)).at(Vec3::new(-1.0, radius, 0.019));
    let ball = ball.moving(forward * Vec3::X * speed).spinning(forward * Vec3::Z * (-speed / radius));
    let ball = world.add(ball)?;
    let mut hop = 0.0f32;
    for _ in 0..120 {
        world.step(1)?;
        hop = hop.max(world.center(ball).y - radius);
    }
    let way = (world.center(ball) + Vec3::X - Vec3::new(0.0, radius, 0.019)).dot(forward * Vec3::X);
    let short = 100.0 * (1.0 - way / (2.0 * speed));
    ensure(short.abs() < 10.0, || format!("held up: comes {short:.0} % short at {speed:.0} m/s"))?;
    ensure(hop < 5e-3, || format!("hops: by {:.0} mm at {speed:.0} m/s", 1000.0 * hop))
}
