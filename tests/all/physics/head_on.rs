//! Bodies that are shot at each other report their touch once.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, scenes::Bullet};
use bevy_rapier3d::prelude::Velocity;

use crate::common::*;

/// Number of pairs per shot.
const PAIRS: usize = 60;

/// Shoots pairs of capsules with random rotations, spins and lateral offsets at each other. Their centres come within one radius of each other. Returns the
/// numbers of start and end messages of each pair after `steps` steps.
fn shoot(seed: u64, speed: f32, radius: f32, steps: u32) -> Vec<[usize; 2]> {
    let mut app = app();
    let mut random = Random(seed);
    let capsule = MedialAxis::capsule(Vec3::X * -0.4, Vec3::X * 0.4, radius).unwrap();
    let pairs: Vec<[Entity; 2]> = (0..PAIRS)
        .map(|i| {
            let ahead = (0.5 + random.unit()) * speed * DT;
            let middle = Vec3::Y * 20.0 * i as f32;
            [-1.0, 1.0].map(|side| {
                let place = middle + Vec3::X * side * ahead + 0.5 * radius * random.in_ball();
                let at = Transform::from_translation(place).with_rotation(random.rotation());
                let velocity = Velocity { linear: Vec3::X * -side * speed, angular: 50.0 * random.in_ball() };
                let body = spawn_flying(&mut app, capsule.clone(), at, velocity);
                app.world_mut().entity_mut(body).insert(Bullet);
                body
            })
        })
        .collect();
    let mut record = Record::default();
    record.run(&mut app, steps);
    pairs.iter().map(|&[one, other]| record.counts(one, other)).collect()
}

/// Slower capsules touch more than once, because the other ends of both hit each other as well.
#[test]
fn a_head_on_hit_is_reported_once() {
    let mut ends = 0;
    for (seed, speed) in (0..).zip([100.0, 200.0, 400.0, 700.0, 1000.0]) {
        for radius in [0.01, 0.05, 0.1] {
            for (pair, [started, ended]) in shoot(seed, speed, radius, 12).into_iter().enumerate() {
                assert_eq!(started, 1, "pair {pair} at {speed} m/s, radius {radius}");
                ends += ended;
            }
        }
    }
    assert!(ends > 10 * PAIRS, "only {ends} touches end");
    let again = shoot(0, 20.0, 0.05, 20).into_iter().filter(|counts| counts[0] > 1).count();
    assert!(again > 0, "slow capsules touch only once");
}
