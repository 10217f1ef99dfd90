//! Steps culled on the GPU have results with the same bits as steps culled on the CPU.

use bevy::tasks::{ComputeTaskPool, TaskPool};
use bevy_medial::{
    gpu::{GpuCapacity, GpuCulling},
    medial_axis::MedialAxis,
    pipeline::{
        Candidates, PairFilter, Primitives, Shape, Solid, Statics, StepInput, StepOutput, step, step_from_candidates,
    },
};
use glam::Vec3;

use super::{device, parity::assert_same_items};
use crate::{
    common::Random,
    random_steps::{random_step, tally},
};

pub fn pool() -> &'static TaskPool {
    ComputeTaskPool::get_or_init(Default::default)
}

pub fn run_on_gpu(culling: &mut GpuCulling, input: &StepInput, statics: &Statics) -> StepOutput {
    let candidates = culling.cull(input, statics).unwrap();
    step_from_candidates(input, statics, candidates, |_, _| PairFilter::Stopping, pool())
}

/// Compares the GPU with the CPU and with itself on random steps. Returns the numbers of impacts, contacts, stops and pairs.
pub fn compare(
    culling: &mut GpuCulling,
    steps: usize,
    mut random_step: impl FnMut() -> (StepInput, Statics),
) -> [usize; 4] {
    let mut total = [0; 4];
    for number in 0..steps {
        let (input, statics) = random_step();
        let cpu = step(&input, &statics, pool());
        let candidates = sorted(culling.cull(&input, &statics).unwrap());
        assert_eq!(candidates, sorted(culling.cull(&input, &statics).unwrap()), "step {number}, culled twice");
        let gpu = step_from_candidates(&input, &statics, candidates, |_, _| PairFilter::Stopping, pool());
        assert_same_items(&cpu.pairs, &gpu.pairs, &format!("step {number}: pair"));
        assert_same_items(&cpu.manifolds, &gpu.manifolds, &format!("step {number}: manifold"));
        assert_same_items(&cpu.stops, &gpu.stops, &format!("step {number}: stop"));
        total.iter_mut().zip(tally(&cpu)).for_each(|(sum, count)| *sum += count);
    }
    println!("{steps} steps: impacts, contacts, stops, pairs {total:?}; GPU {:?}", culling.counts());
    total
}

/// Sorts pairs, and the primitives of each pair.
fn sorted(mut candidates: Vec<Candidates>) -> Vec<Candidates> {
    for pair in &mut candidates {
        if let Primitives::Bounded(bounded) = &mut pair.primitives {
            bounded.sort_unstable_by_key(|pair| pair.primitives);
        }
    }
    candidates.sort_unstable_by_key(|pair| pair.sides);
    candidates
}

#[test]
fn random_steps_equal_those_of_the_cpu() {
    check_random_steps(30);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_random_steps_equal_those_of_the_cpu() {
    check_random_steps(300);
}

fn check_random_steps(steps: usize) {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(1);
    let few = compare(&mut culling, steps, || random_step(&mut random, 6, 5, 2.0, Vec3::ZERO));
    let [impacts, contacts, stops, _] = few;
    assert!(impacts > steps && 3 * contacts > 10 * steps && 3 * stops > 2 * steps);
    // More bodies than a workgroup sorts, far from the origin.
    let mut random = Random(3);
    let many = compare(&mut culling, 5, || {
        let (mut input, statics) = random_step(&mut random, 1100, 20, 12.0, Vec3::splat(1024.0));
        // Otherwise bodies push each other through the whole room.
        input.bodies.iter_mut().for_each(|body| body.stops = body.active);
        (input, statics)
    });
    let [impacts, contacts, stops, _] = many;
    assert!(impacts > 300 && contacts > 1000 && stops > 200);
    println!("{:?}", culling.times());
}

#[test]
fn shapes_are_uploaded_once() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let (mut input, statics) = random_step(&mut Random(2), 40, 10, 2.0, Vec3::ZERO);
    // Otherwise bodies push each other along, and a step is culled more than once.
    input.bodies.iter_mut().for_each(|body| body.stops = body.active);
    let mut uploaded = |input: &StepInput| {
        let before = culling.uploaded();
        culling.cull(input, &statics).unwrap();
        culling.uploaded() - before
    };
    let shapes = uploaded(&input);
    let poses = uploaded(&input);
    assert!(poses <= 112 + 144 * 40 && shapes > poses + 1000, "{shapes} bytes, then {poses}");
    for _ in 0..30 {
        input.bodies.iter_mut().for_each(|body| body.sweep.start.translation.x += 0.01);
        assert_eq!(uploaded(&input), poses);
    }

    // The first new shape makes the table grow. The second one uploads only itself: a sphere as a primitive, a node, and their
    // positions in the table.
    let mut with_ball = |radius: f32| {
        input.bodies[0].solid = Solid::Medial(Shape::new(MedialAxis::sphere(radius).unwrap()));
        uploaded(&input)
    };
    assert!(with_ball(0.25) < shapes);
    assert_eq!(with_ball(0.3), poses + 16 + 12 + 32 + 20);
    assert_eq!(uploaded(&input), poses);
}
