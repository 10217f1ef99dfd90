//! Impacts compared with the true rigid motion, sampled finely in f64.

use bevy::{
    prelude::*,
    tasks::{ComputeTaskPool, TaskPool},
};
use bevy_medial::{
    constants::{CHORD_TOLERANCE, LINEAR_SLOP},
    geometry::{Obb, Pose3, Primitive, Sphere, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Impact, Shape, StaticBody, Statics, StepInput, step},
};

use crate::{
    common::*,
    true_motion::{Motion, MovingPair, corners_of, corners_of_box},
};

fn pool() -> &'static TaskPool {
    ComputeTaskPool::get_or_init(Default::default)
}

/// Shapes of one primitive each, about a metre in size.
fn primitives(random: &mut Random) -> Vec<MedialAxis> {
    (0..30)
        .map(|i| {
            let mut sphere = || Sphere::new(random.in_ball() * 0.5, [0.0, 0.02, 0.2][random.below(3)]);
            let spheres = [sphere(), sphere(), sphere()];
            let (spheres, primitive) = match i % 3 {
                0 => (spheres[..1].to_vec(), Primitive::Sphere([0])),
                1 => (spheres[..2].to_vec(), Primitive::Cone([0, 1])),
                _ => (spheres.to_vec(), Primitive::Slab([0, 1, 2])),
            };
            MedialAxis::new(spheres, vec![primitive]).unwrap().0
        })
        .filter(|axis| axis.primitives().len() == 1 && axis.bounding_sphere().radius > 0.05)
        .collect()
}

/// A random pair of a body and another body or a box. It is apart at the start and likely to touch.
struct Case {
    input: StepInput,
    statics: Statics,
    pair: MovingPair,
    /// Distance from the centre of mass to the farthest point of the smaller body, with the pipeline's bound.
    size: f64,
}

fn arm(shape: &Shape, sweep: &Sweep) -> f64 {
    let bound = shape.bounding_sphere();
    f64::from(bound.center.distance(sweep.local_center) + bound.radius)
}

fn random_case(random: &mut Random, shapes: &[MedialAxis], turn: f32) -> Case {
    let body = |random: &mut Random, place: Vec3, translation: Vec3| {
        let shape = Shape { axis: shapes[random.below(shapes.len())].clone(), scale: 0.5 + random.unit() };
        let center = if random.below(2) == 0 { shape.center_of_mass() } else { random.in_ball() * 0.2 };
        let start = Pose3::from_parts(place, random.rotation());
        let rotation = random.in_ball() * turn;
        let turned = (Quat::from_scaled_axis(rotation) * start.rotation).normalize();
        let end = Pose3::from_parts(start.transform_point(center) + translation - turned * center, turned);
        let sweep = Sweep::between(start, end, center, rotation);
        Body { core_depth: 0.0, ..Body::new(shape, sweep) }
    };
    let speed = [0.01, 0.1, 1.0, 5.0][random.below(4)];
    let toward = random.in_ball().normalize_or(Vec3::X);
    let offset = toward * (0.3 + random.unit() * (0.5 + speed)) + random.in_ball() * 0.4;
    let drifts = [0, 1].map(|_| random.in_ball() * 0.1 * speed);
    let mut first = body(random, Vec3::ZERO, drifts[0]);
    let corners1 = corners_of(first.solid.medial().unwrap(), 0);
    let origin = glam::DVec3::ZERO;
    let motion1 = Motion::new(&first.sweep, origin);
    let size1 = arm(first.solid.medial().unwrap(), &first.sweep);
    if random.below(2) == 0 {
        let second = body(random, offset, drifts[1] - toward * speed);
        let sides =
            [(corners1, motion1), (corners_of(second.solid.medial().unwrap(), 0), Motion::new(&second.sweep, origin))];
        let size = size1.min(arm(second.solid.medial().unwrap(), &second.sweep));
        let input = StepInput { bodies: vec![first, second], ..default() };
        Case { input, statics: Statics::default(), pair: MovingPair { sides }, size }
    } else {
        // The body flies towards the box.
        let sweep = &mut first.sweep;
        sweep.translation += toward * speed;
        sweep.end.translation += toward * speed;
        let motion1 = Motion::new(sweep, origin);
        let half_extents = Vec3::new(0.02 + random.unit(), 0.02 + 0.3 * random.unit(), 0.02 + random.unit()) * 0.7;
        let obb = Obb { pose: Pose3::from_parts(offset, random.rotation()), half_extents };
        let motion2 = Motion::new(&Sweep::at_rest(obb.pose), origin);
        let sides = [(corners1, motion1), (corners_of_box(&obb), motion2)];
        let statics = Statics::new(vec![StaticBody::solid_box(obb)]);
        Case { input: StepInput { bodies: vec![first], ..default() }, statics, pair: MovingPair { sides }, size: size1 }
    }
}

impl Case {
    fn impact(&self) -> Option<Impact> {
        let output = step(&self.input, &self.statics, pool());
        assert_eq!(output.counts.unresolved, 0);
        output.pairs.first().and_then(|pair| pair.impact)
    }
}

/// Counts and errors of all cases.
#[derive(Debug, Default)]
struct Tally {
    hits: usize,
    apart: usize,
    gentle: usize,
    /// Largest distance at an impact, in sizes.
    earliest: f64,
    /// Deepest overlap before an impact, in sizes; then the deepest overlap without an impact.
    latest: f64,
    deepest_untold: f64,
}

/// Compares `count` random pairs that turn by up to `turn` radians.
fn compare(seed: u64, count: usize, turn: f32) -> Tally {
    let mut random = Random(seed);
    let shapes = primitives(&mut random);
    let mut tally = Tally::default();
    while tally.hits + tally.apart + tally.gentle < count {
        let case = random_case(&mut random, &shapes, turn);
        let size = case.size;
        if case.pair.distance(0.0) < f64::from(LINEAR_SLOP).max(0.01 * size) {
            continue;
        }
        let touch = case.pair.first_below(0.0, 1e-6 * size);
        match (case.impact(), touch) {
            (Some(impact), touch) => {
                let fraction = f64::from(impact.fraction);
                tally.hits += 1;
                tally.earliest = tally.earliest.max(case.pair.distance(fraction) / size);
                if touch.is_some_and(|touch| touch < fraction) {
                    let depth = |i: i32| -case.pair.distance(fraction * f64::from(i) / 1000.0) / size;
                    tally.latest = tally.latest.max((0..=1000).map(depth).fold(0.0, f64::max));
                }
            }
            (None, Some(touch)) => {
                // The bodies touch, and then overlap by less than the slop.
                tally.gentle += 1;
                let depth = |i: i32| -case.pair.distance(touch + (1.0 - touch) * f64::from(i) / 1000.0) / size;
                let deepest = (0..=1000).map(depth).fold(0.0, f64::max);
                tally.deepest_untold = tally.deepest_untold.max(deepest);
            }
            (None, None) => tally.apart += 1,
        }
    }
    tally
}

#[test]
fn impacts_without_rotation_are_exact() {
    let tally = compare(1, 5000, 0.0);
    println!("{tally:?}");
    assert!(tally.hits > 1000 && tally.apart > 1000);
    assert!(tally.earliest < 2e-5 && tally.latest < 1e-5 && tally.deepest_untold < 1e-5);
}

#[test]
fn impacts_of_turning_bodies_are_within_tolerance_and_never_late() {
    for turn in [0.1, 1.0, 3.0] {
        let tally = compare(2, 2000, turn);
        println!("{turn}: {tally:?}");
        assert!(tally.hits > 500 && tally.apart > 500);
        // Each side deviates from its chords by up to the tolerance, and is enlarged by the same amount.
        assert!(tally.earliest < 4.0 * f64::from(CHORD_TOLERANCE), "early by {} sizes", tally.earliest);
        assert!(tally.latest < 1e-5, "late by {} sizes", tally.latest);
        assert!(tally.deepest_untold < 1e-5, "an overlap of {} sizes without an impact", tally.deepest_untold);
    }
}

#[test]
fn a_slow_spinning_body_is_stopped_at_the_surface() {
    // The capsule spins about its own axis, so its surface does not move. The step is divided into many chords, and the body descends little in each.
    let (half, radius) = (0.4, 0.2);
    let axis = MedialAxis::capsule(Vec3::X * -half, Vec3::X * half, radius).unwrap();
    let obb = Obb { pose: Pose3::from_translation(Vec3::Y * -1.0), half_extents: Vec3::splat(1.0) };
    let statics = Statics::new(vec![StaticBody::solid_box(obb)]);
    let mut impacts = 0;
    for turn in [0.0, 0.5, 3.0, 30.0] {
        for descent in [0.01, 0.03, 0.1, 0.3] {
            let gap = 0.3 * descent;
            let start = Pose3::from_translation(Vec3::Y * (radius + gap));
            let end = Pose3::from_parts(start.translation - Vec3::Y * descent, Quat::from_rotation_x(turn));
            let sweep = Sweep::between(start, end, Vec3::ZERO, Vec3::X * turn);
            let shape = Shape::new(axis.clone());
            let body = Body { core_depth: 0.0, ..Body::new(shape, sweep) };
            let output = step(&StepInput { bodies: vec![body], ..default() }, &statics, pool());
            let impact = output.pairs.first().and_then(|pair| pair.impact);
            let overlap = descent * impact.map_or(1.0, |impact| impact.fraction) - gap;
            let allowed = 1e-5;
            assert!(overlap < allowed, "turn {turn}, descent {descent}: overlap {overlap}, {impact:?}");
            impacts += usize::from(impact.is_some());
        }
    }
    assert_eq!(impacts, 16);
}
