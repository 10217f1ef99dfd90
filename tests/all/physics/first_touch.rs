//! The query for the first touch of two bodies, compared with the distances of all primitives at many times.

use bevy_medial::{
    constants::{CHORD_TOLERANCE, INTERVAL_PATH, MANY_PRIMITIVES},
    geometry::{Placement, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Culling, Hull, Shape, first_touch},
    query::separation,
};
use glam::Vec3;

use crate::common::Random;

/// Distance of the nearest primitives, in metres. All primitives are cones.
fn distance(shapes: [&Shape; 2], poses: [Pose3; 2]) -> f32 {
    let placed = [0, 1].map(|side: usize| {
        let placement = Placement::from(poses[side]);
        let cone = |i| match shapes[side].hull(i).placed(&placement) {
            Hull::Cone(cone) => cone,
            other => panic!("{other:?} is not a cone"),
        };
        (0..shapes[side].len() as u32).map(cone).collect::<Vec<_>>()
    });
    let pairs = placed[0].iter().flat_map(|a| placed[1].iter().map(move |b| separation(a, b, 0).distance));
    pairs.fold(f32::INFINITY, f32::min)
}

#[test]
fn a_first_touch_is_the_first_zero_of_the_distance() {
    assert_eq!(check([14, 9]), 0);
    // Long motions of fine shapes are searched in several intervals.
    let long = check([28, 18]);
    assert!(long > 150, "{long}");
}

/// Checks first touches of two rings with the given numbers of primitives. Returns how many motions without fast spin are searched in several
/// intervals.
fn check(counts: [u32; 2]) -> usize {
    const LOOKS: u32 = 200;
    let ring = Shape::new(MedialAxis::torus(0.6, 0.1, counts[0]).unwrap());
    let small = Shape::new(MedialAxis::torus(0.3, 0.05, counts[1]).unwrap());
    let shapes = [&ring, &small];
    // Largest deviation of the chords of both bodies from their paths, in metres.
    let early = 2.0 * CHORD_TOLERANCE * 0.7;
    let mut random = Random(5);
    let (mut hits, mut misses, mut long) = (0, 0, 0);
    for round in 0..300 {
        let spin = if round % 5 == 0 { 6.0 } else { 0.3 };
        let offset = random.in_ball().normalize_or(Vec3::X) * 1.2;
        let sweeps = shapes.map(|shape| {
            let center = if std::ptr::eq(shape, &ring) { Vec3::ZERO } else { offset };
            let start = Pose3::from_parts(center, random.rotation());
            let turn = random.in_ball() * spin;
            let displacement = (-center * 0.8 + random.in_ball() * 0.6) * random.unit();
            let rotation = glam::Quat::from_scaled_axis(turn) * start.rotation;
            let end = Pose3::from_parts(center + displacement, rotation.normalize());
            Sweep::between(start, end, shape.center_of_mass(), turn)
        });
        let bodies = || [0, 1].map(|side: usize| Body::new(shapes[side].clone(), sweeps[side]));
        let path = sweeps[0].translation.distance(sweeps[1].translation);
        let is_fine = (counts[0] * counts[1]) as usize > MANY_PRIMITIVES;
        long += usize::from(spin < 2.0 && is_fine && path > INTERVAL_PATH * 0.35);
        let found = first_touch(bodies(), Culling::Hybrid, None);
        assert_eq!(found, first_touch(bodies(), Culling::None, None), "round {round}: culling changes the result");
        let all: Vec<[u32; 2]> = (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| [i, j])).collect();
        assert_eq!(found, first_touch(bodies(), Culling::Hybrid, Some(&all)), "round {round}");
        let at = |fraction: f32| distance(shapes, sweeps.map(|sweep| sweep.pose_at(fraction)));
        let until = found.map_or(1.0, |impact| impact.fraction);
        for look in 0..LOOKS {
            let fraction = until * look as f32 / LOOKS as f32;
            assert!(at(fraction) > -1e-4, "round {round}: the rings overlap at {fraction}, before {until}");
        }
        match found {
            Some(impact) => {
                assert!(at(impact.fraction).abs() <= early, "round {round}: {}", at(impact.fraction));
                assert!(impact.normal.is_normalized());
                hits += 1;
            }
            None => misses += 1,
        }
    }
    assert!(hits >= 100 && misses >= 50, "{hits} hits, {misses} misses");
    long
}
