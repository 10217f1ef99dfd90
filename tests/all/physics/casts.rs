//! Shape casts with medial shapes, compared with f64 times of impact.

use bevy_medial::{
    geometry::Pose3,
    pipeline::Shape,
    rapier::{ContactTable, MedialDispatcher, MedialShape},
};
use bevy_rapier3d::parry::{
    query::{DefaultQueryDispatcher, QueryDispatcher, ShapeCastStatus, details::ShapeCastOptions},
    shape::{Ball as RapierBall, Capsule, Cuboid, Shape as ParryShape, TriMesh, Triangle},
};
use glam::{DVec3, Vec3};

use crate::{
    common::*,
    random_steps,
    reference::{Ball, Difference},
};

/// A collider, and the hulls of balls whose union has the same shape.
struct Target {
    name: &'static str,
    shape: Box<dyn ParryShape>,
    hulls: Vec<Vec<Ball>>,
}

fn ball(center: Vec3, radius: f32) -> Ball {
    Ball { center: center.as_dvec3(), radius: radius.into(), motion: DVec3::ZERO }
}

fn hulls(shape: &Shape) -> Vec<Vec<Ball>> {
    let spheres = shape.axis.spheres();
    let ball = |&i: &u32| ball(spheres[i as usize].center * shape.scale, spheres[i as usize].radius * shape.scale);
    shape.axis.primitives().iter().map(|primitive| primitive.indices().iter().map(ball).collect()).collect()
}

fn corners(half: Vec3) -> Vec<Ball> {
    let corner =
        |i: u32| Vec3::new([-1.0, 1.0][i as usize & 1], [-1.0, 1.0][i as usize >> 1 & 1], [-1.0, 1.0][i as usize >> 2]);
    (0..8).map(|i| ball(corner(i) * half, 0.0)).collect()
}

fn targets(random: &mut Random) -> Vec<Target> {
    let half = Vec3::new(0.2, 0.3, 0.5) * (0.3 + random.unit());
    let radius = 0.1 + 0.4 * random.unit();
    let ends = [random.in_ball() * 0.5, random.in_ball() * 0.5];
    let vertices =
        [Vec3::new(-1.0, 0.2, -1.0), Vec3::new(1.0, 0.0, -1.0), Vec3::new(1.0, 0.3, 1.0), Vec3::new(-1.0, 0.0, 1.0)];
    let faces = [[0, 2, 1], [0, 3, 2]];
    let face_hulls = faces.map(|face: [u32; 3]| face.map(|i| ball(vertices[i as usize], 0.0)).to_vec());
    let shapes = random_steps::shapes();
    let medial = Shape { axis: shapes[random.below(shapes.len())].clone(), scale: 0.5 + random.unit() };
    vec![
        Target { name: "ball", shape: Box::new(RapierBall::new(radius)), hulls: vec![vec![ball(Vec3::ZERO, radius)]] },
        Target { name: "cuboid", shape: Box::new(Cuboid::new(half)), hulls: vec![corners(half)] },
        Target {
            name: "ground",
            shape: Box::new(Cuboid::new(Vec3::new(50.0, 0.5, 50.0))),
            hulls: vec![corners(Vec3::new(50.0, 0.5, 50.0))],
        },
        Target {
            name: "capsule",
            shape: Box::new(Capsule::new(ends[0], ends[1], radius)),
            hulls: vec![ends.map(|end| ball(end, radius)).to_vec()],
        },
        Target {
            name: "triangle",
            shape: Box::new(Triangle::new(vertices[0], vertices[2], vertices[1])),
            hulls: vec![face_hulls[0].clone()],
        },
        Target {
            name: "triangle mesh",
            shape: Box::new(TriMesh::new(vertices.to_vec(), faces.to_vec()).unwrap()),
            hulls: face_hulls.to_vec(),
        },
        Target { name: "medial", hulls: hulls(&medial), shape: Box::new(MedialShape::new(medial, 1)) },
    ]
}

/// Time at which two unions of hulls come within a distance. The second one moves from `pose` with `velocity`, in the frame of the first.
fn first_within(
    first: &[Vec<Ball>],
    second: &[Vec<Ball>],
    pose: &Pose3,
    velocity: Vec3,
    max: f32,
    level: f64,
) -> Option<f64> {
    let turn = pose.rotation.as_dquat().normalize();
    let place = |ball: &Ball| Ball {
        center: turn * ball.center + pose.translation.as_dvec3(),
        motion: velocity.as_dvec3() * f64::from(max),
        ..*ball
    };
    let second: Vec<Vec<Ball>> = second.iter().map(|hull| hull.iter().map(place).collect()).collect();
    let pairs = first.iter().flat_map(|a| second.iter().map(move |b| Difference::new(a, b)));
    pairs
        .filter_map(|pair| pair.first_within(level, 1.0))
        .map(|fraction| fraction * f64::from(max))
        .min_by(f64::total_cmp)
}

/// Counts of cases by outcome, and the largest error of a cast for one dispatcher.
#[derive(Default, Debug)]
struct Score {
    hits: u32,
    misses: u32,
    overlaps: u32,
    lost: u32,
    false_positives: u32,
    /// Casts with a wrong status, or with witness points at a wrong distance.
    gaps: u32,
    worst: f64,
}

#[test]
fn linear_casts_stop_at_the_target_distance() {
    let mut random = Random(3);
    let ours = MedialDispatcher { table: ContactTable::default() };
    let shapes = random_steps::shapes();
    let mut scores = [Score::default(), Score::default()];
    for _ in 0..90 {
        let shape = Shape { axis: shapes[random.below(shapes.len())].clone(), scale: 0.4 + random.unit() };
        let (medial, first) = (MedialShape::new(shape.clone(), 0), hulls(&shape));
        for target in targets(&mut random) {
            let size = f64::from(shape.bounding_sphere().radius);
            let away = [0.6, 3.0, 40.0][random.below(3)];
            let offset = random.in_ball() * away;
            let offset = if target.name == "ground" { offset.with_y(-1.0 - offset.y.abs()) } else { offset };
            let pose12 = Pose3::from_parts(
                offset,
                if target.name == "ground" { glam::Quat::IDENTITY } else { random.rotation() },
            );
            let velocity = (random.in_ball() * 0.8 - offset) * (0.1 + random.unit());
            let max = 12.0;
            let level = [0.0, 0.05][random.below(2)];
            let options = ShapeCastOptions { max_time_of_impact: max, target_distance: level, ..Default::default() };
            let truth = first_within(&first, &target.hulls, &pose12, velocity, max, level.into());
            let swapped = random.below(2) == 1;
            let pose21 = pose12.inverse();
            for (dispatcher, score) in [&ours as &dyn QueryDispatcher, &DefaultQueryDispatcher].iter().zip(&mut scores)
            {
                let hit = if swapped {
                    let velocity21 = pose21.rotation * -velocity;
                    dispatcher
                        .cast_shapes(&pose21, velocity21, &*target.shape, &medial, options)
                        .unwrap()
                        .map(|hit| hit.swapped())
                } else {
                    dispatcher.cast_shapes(&pose12, velocity, &medial, &*target.shape, options).unwrap()
                };
                match (hit, truth) {
                    (None, None) => score.misses += 1,
                    (None, Some(_)) => score.lost += 1,
                    (Some(_), None) => score.false_positives += 1,
                    (Some(hit), Some(truth)) => {
                        score.hits += 1;
                        let speed = f64::from(velocity.length());
                        let distance = |time: f64| {
                            let pose = Pose3::from_parts(
                                (pose12.translation.as_dvec3() + velocity.as_dvec3() * time).as_vec3(),
                                pose12.rotation,
                            );
                            first_within(&first, &target.hulls, &pose, Vec3::ZERO, 1.0, f64::from(level) + 1e-4 * size)
                        };
                        // At a graze the error in time is larger than the error in distance.
                        let time = f64::from(hit.time_of_impact);
                        let off = (time - truth).abs() * speed;
                        let near = time < truth && distance(time).is_some();
                        if off > 1e-4 * size && !near {
                            score.worst = score.worst.max(off / size);
                        }
                        if truth == 0.0 {
                            score.overlaps += 1;
                            score.gaps += u32::from(hit.status != ShapeCastStatus::PenetratingOrWithinTargetDist);
                            continue;
                        }
                        // The witness points are the target distance apart along the normal.
                        let witness2 = pose12.transform_point(hit.witness2) + velocity * hit.time_of_impact;
                        let gap = witness2 - hit.witness1 - hit.normal1 * level;
                        let accuracy = 2e-3 * size as f32 + 1e-6 * offset.length();
                        score.gaps += u32::from(gap.is_nan() || gap.length() >= accuracy);
                        assert!((hit.normal1 + pose12.rotation * hit.normal2).length() < 1e-3);
                    }
                }
            }
        }
    }
    println!("ours {:?}\nparry's {:?}", scores[0], scores[1]);
    let [ours, _] = &scores;
    assert!(ours.hits > 250 && ours.misses > 50 && ours.overlaps > 30, "{ours:?}");
    // Parry's algorithms find every hit through the compound, but less exactly.
    assert!(scores[1].lost == 0 && scores[1].false_positives == 0, "{:?}", scores[1]);
    assert!(ours.lost == 0 && ours.false_positives == 0 && ours.gaps == 0 && ours.worst == 0.0, "{ours:?}");
}
