//! The shaders compute the same times of impact as the CPU, and as accurately.

use std::sync::Mutex;

use bevy_medial::{
    geometry::Sphere,
    gpu::{GpuImpacts, MovingPair},
    query::{Cuboid, Moving, MovingConvex, TimeOfImpact, TimeOfImpactStatus, Touch, time_of_impact},
};
use glam::Vec3;

use super::device;
use crate::{
    common::Random,
    pairs::{KINDS, Pair},
    score::{Score, assert_all_good, for_each_case, setting},
};

/// A primitive of about unit size near `center` that moves by about `motion`.
fn moving<const N: usize>(random: &mut Random, center: Vec3, motion: Vec3) -> Moving<N> {
    Moving {
        start: std::array::from_fn(|_| Sphere::new(center + random.in_ball() * 0.5, 0.2 * random.unit())),
        motion: std::array::from_fn(|_| motion + random.in_ball() * 0.1),
    }
}

/// Adds pairs of a kind, each with the result of the CPU.
fn add<const N: usize, B: MovingConvex>(
    random: &mut Random,
    pairs: &mut Vec<(MovingPair, TimeOfImpact)>,
    mut second: impl FnMut(&mut Random) -> B,
    pack: impl Fn(&Moving<N>, &B) -> MovingPair,
) {
    for _ in 0..400 {
        let offset = random.in_ball() * 2.0;
        let motion = random.in_ball() * 1.5 - offset * 1.2;
        let (first, second) = (moving(random, offset, motion), second(random));
        pairs.push((pack(&first, &second), time_of_impact(&first, &second, 1.0)));
    }
}

#[test]
fn times_of_impact_agree_with_the_cpu() {
    let Some(gpu) = device() else { return };
    let mut random = Random(3);
    let mut pairs = Vec::new();
    fn still<const M: usize>(random: &mut Random) -> Moving<M> {
        moving(random, Vec3::ZERO, Vec3::ZERO)
    }
    let cuboid = |random: &mut Random| Cuboid { half: Vec3::new(random.unit(), random.unit(), random.unit()) };
    add::<1, Moving<2>>(&mut random, &mut pairs, still, MovingPair::new);
    add::<2, Moving<1>>(&mut random, &mut pairs, still, MovingPair::new);
    add::<2, Moving<2>>(&mut random, &mut pairs, still, MovingPair::new);
    add::<2, Moving<3>>(&mut random, &mut pairs, still, MovingPair::new);
    add::<3, Moving<3>>(&mut random, &mut pairs, still, MovingPair::new);
    add::<1, Cuboid>(&mut random, &mut pairs, cuboid, MovingPair::with_cuboid);
    add::<2, Cuboid>(&mut random, &mut pairs, cuboid, MovingPair::with_cuboid);
    add::<3, Cuboid>(&mut random, &mut pairs, cuboid, MovingPair::with_cuboid);

    let mut impacts = GpuImpacts::new(gpu).unwrap();
    let found = impacts.run(&pairs.iter().map(|(pair, _)| *pair).collect::<Vec<_>>()).unwrap();
    let mut counts = [0; 4];
    let mut differ = 0;
    for ((number, (_, cpu)), gpu) in pairs.iter().enumerate().zip(&found) {
        counts[cpu.status as usize] += 1;
        if cpu.status != gpu.status {
            // Borderline pairs may differ.
            differ += 1;
            continue;
        }
        match cpu.status {
            TimeOfImpactStatus::Hit => {
                let apart = (cpu.fraction - gpu.fraction).abs();
                assert!(apart < 1e-4, "pair {number}: {} on the CPU, {} on the GPU", cpu.fraction, gpu.fraction);
            }
            TimeOfImpactStatus::Overlapping => {
                let [cpu, gpu] = [cpu.contact.distance, gpu.contact.distance];
                assert!((cpu - gpu).abs() < 2e-5, "pair {number}: {cpu} m on the CPU, {gpu} m on the GPU");
            }
            TimeOfImpactStatus::Separated | TimeOfImpactStatus::IterationLimit => {}
        }
    }
    println!("separated, hits, overlapping, undecided: {counts:?}; {differ} differ");
    assert!(counts[..3].iter().all(|count| *count > 50), "{counts:?}");
    assert!(differ <= 3, "{differ} of {}", pairs.len());
}

#[test]
fn empty_input_gives_empty_output() {
    let Some(gpu) = device() else { return };
    assert!(GpuImpacts::new(gpu).unwrap().run(&[]).unwrap().is_empty());
}

/// Pairs of every category and kind, judged by the same reference as the CPU's kernels.
#[test]
fn times_of_impact_agree_with_reference() {
    let Some(gpu) = device() else { return };
    let impacts = Mutex::new(GpuImpacts::new(gpu).unwrap());
    let pack = |pair: &Pair| {
        let (first, second) = pair.relative();
        for_kinds!(first, second, |a, b| hulls: MovingPair::new(&a, &b), cuboid: MovingPair::with_cuboid(&a, &b))
    };
    let pairs = setting("KERNEL_PAIRS", 1_000);
    let scores = for_each_case(5, |category, kind, random| {
        Score::of(category, kind, random, pairs, |pairs| {
            let pairs: Vec<MovingPair> = pairs.iter().map(pack).collect();
            let found = impacts.lock().unwrap().run(&pairs).unwrap();
            found.iter().map(|found| Touch { status: found.status, fraction: found.fraction }).collect()
        })
    });
    assert_all_good(&scores, pairs, KINDS.len());
}
