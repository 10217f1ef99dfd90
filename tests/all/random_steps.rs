//! Random inputs of the pipeline.

use std::{f32::consts::TAU, sync::OnceLock};

use bevy_medial::{
    constants::CORE_DEPTH,
    geometry::{Obb, Pose3, Primitive, Sphere, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Groups, Shape, StaticBody, Statics, StepInput, StepOutput},
};
use glam::{Quat, Vec3};

use crate::common::Random;

/// Small shapes of all kinds of primitives, some of them off their origin.
pub fn shapes() -> &'static [MedialAxis] {
    static SHAPES: OnceLock<Vec<MedialAxis>> = OnceLock::new();
    let sphere = |x: f32, y: f32, z: f32, r: f32| Sphere::new(Vec3::new(x, y, z), r);
    SHAPES.get_or_init(|| {
        let slabs = vec![Primitive::Slab([0, 1, 2]), Primitive::Slab([1, 2, 3]), Primitive::Cone([3, 4])];
        let spheres = vec![
            sphere(0.3, 0.0, 0.0, 0.1),
            sphere(1.0, 0.1, 0.3, 0.2),
            sphere(0.4, 0.0, 0.8, 0.05),
            sphere(1.1, 0.6, 1.0, 0.1),
            sphere(1.5, 1.2, 1.0, 0.0),
        ];
        vec![
            MedialAxis::sphere(0.3).unwrap(),
            MedialAxis::capsule(Vec3::X * -0.6, Vec3::X * 0.5, 0.05).unwrap(),
            MedialAxis::cone(sphere(0.2, 0.5, 0.0, 0.3), sphere(0.0, -0.5, 0.0, 0.1)).unwrap(),
            MedialAxis::torus(0.5, 0.1, 6).unwrap(),
            MedialAxis::rounded_box(Vec3::new(0.5, 0.1, 0.3), 0.1).unwrap(),
            MedialAxis::new(spheres, slabs).unwrap().0,
        ]
    })
}

/// Rounds a vector so that adding 1024 to it is exact.
fn coarse(v: Vec3) -> Vec3 {
    (v * 512.0).round() / 512.0
}

fn groups(random: &mut Random) -> Groups {
    match random.below(4) {
        0 => Groups { memberships: 1 << random.below(3), filter: random.bits() as u32 & 7 },
        _ => Groups::ALL,
    }
}

/// The sweep of a rigid motion, given by its end poses and angular velocity as rapier gives it.
fn sweep(start: Pose3, center: Vec3, translation: Vec3, rotation: Vec3) -> Sweep {
    let turned = (Quat::from_scaled_axis(rotation) * start.rotation).normalize();
    let end = start.transform_point(center) + translation - turned * center;
    Sweep::between(start, Pose3::from_parts(end, turned), center, rotation)
}

/// Bodies and statics in a room of the given half size around `origin`. Some are fast, some spin up to six turns a step, some
/// sleep, some are sensors.
///
/// At a few turns per step chords are far from their arcs, and impacts are early by up to that distance. Culling considers only true motions
/// and the prediction distance, so it would skip such pairs. Therefore the prediction distance is large there.
pub fn random_step(
    random: &mut Random,
    bodies: usize,
    statics: usize,
    room: f32,
    origin: Vec3,
) -> (StepInput, Statics) {
    let shapes = shapes();
    let (fastest, prediction) = if random.below(3) == 0 { (6.0 * TAU, 1.0) } else { (3.0, 0.02) };
    let shape = |random: &mut Random| Shape {
        axis: shapes[random.below(shapes.len())].clone(),
        scale: [1.0, 1.0, 0.5, 1.7][random.below(4)],
    };
    let pose = |random: &mut Random| Pose3::from_parts(origin + coarse(random.in_ball() * room), random.rotation());
    let bodies = (0..bodies)
        .map(|_| {
            let shape = shape(random);
            let start = pose(random);
            let active = random.below(6) > 0;
            let speed = [0.0, 0.02, 0.3, 2.0, 20.0][random.below(5)];
            let turn = [0.0, 0.0, 0.0, 0.02, 0.02, 0.3, 0.3, 2.0, 3.0, fastest][random.below(10)];
            let center = if random.below(4) == 0 { random.in_ball() * 0.3 } else { shape.center_of_mass() };
            let sweep = if active {
                sweep(start, center, random.in_ball() * speed, random.in_ball() * turn)
            } else {
                Sweep::at_rest(start)
            };
            let stops = random.below(8) > 0;
            let core_depth = [0.0, 0.0, CORE_DEPTH][random.below(3)];
            let passes = random.below(12) == 0;
            Body { groups: groups(random), active, stops, passes, core_depth, ..Body::new(shape, sweep) }
        })
        .collect();
    let statics = (0..statics)
        .map(|_| {
            let pose = pose(random);
            let groups = groups(random);
            let passes = random.below(12) == 0;
            if random.below(3) == 0 {
                let solid = StaticBody::new(shape(random), pose);
                StaticBody { groups, passes, ..solid }
            } else {
                // Plates, rods and blocks, from 1 cm to the room's size.
                let size = |random: &mut Random| [0.01, 0.1, 0.5, 0.5 * room][random.below(4)] * (0.5 + random.unit());
                let half_extents = Vec3::new(size(random), size(random), size(random));
                StaticBody { groups, passes, ..StaticBody::solid_box(Obb { pose, half_extents }) }
            }
        })
        .collect();
    let input = StepInput { bodies, prediction, stop_at_impact: random.below(5) > 0, ..Default::default() };
    (input, Statics::new(statics))
}

/// Numbers of impacts, contacts, stops and pairs.
pub fn tally(output: &StepOutput) -> [usize; 4] {
    let impacts = output.pairs.iter().filter(|pair| pair.impact.is_some()).count();
    [impacts, output.counts.contacts, output.stops.len(), output.pairs.len()]
}
