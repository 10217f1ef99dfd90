//! Steps culled on the GPU have results with the same bits as steps culled on the CPU.

use std::sync::Arc;

use bevy::tasks::{ComputeTaskPool, TaskPool};
use bevy_medial::{
    geometry::{Pose3, Sphere, Sweep},
    gpu::{GpuCapacity, GpuCulling},
    medial_axis::MedialAxis,
    pipeline::{
        Body, Candidates, PairFilter, Primitives, Shape, Side, Solid, Statics, StepInput, StepOutput, step,
        step_from_candidates,
    },
    query::Cuboid,
};
use bevy_medial_compare::paper::chains;
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

/// Culls a step and returns the number of bytes that it uploads.
pub fn uploaded(culling: &mut GpuCulling, input: &StepInput, statics: &Statics) -> u64 {
    let before = culling.uploaded();
    culling.cull(input, statics).unwrap();
    culling.uploaded() - before
}

/// Compares the GPU with the CPU and with itself on random steps. Returns the numbers of impacts, contacts, stops and pairs.
pub fn compare(
    culling: &mut GpuCulling,
    steps: usize,
    mut random_step: impl FnMut() -> (StepInput, Statics),
) -> [usize; 4] {
    let (mut total, mut exact) = ([0; 4], [0; 2]);
    for number in 0..steps {
        let (input, statics) = random_step();
        let cpu = step(&input, &statics, pool());
        let candidates = culling.cull(&input, &statics).unwrap();
        let again = culling.cull(&input, &statics).unwrap();
        assert_eq!(sorted(candidates.clone()), sorted(again), "step {number}, culled twice");
        let gpu = step_from_candidates(&input, &statics, candidates, |_, _| PairFilter::Stopping, pool());
        assert_same_items(&cpu.pairs, &gpu.pairs, &format!("step {number}: pair"));
        assert_same_items(&cpu.manifolds, &gpu.manifolds, &format!("step {number}: manifold"));
        assert_same_items(&cpu.stops, &gpu.stops, &format!("step {number}: stop"));
        total.iter_mut().zip(tally(&cpu)).for_each(|(sum, count)| *sum += count);
        exact[0] += cpu.counts.toi_tests;
        exact[1] += gpu.counts.toi_tests;
    }
    assert!(exact[0] < 1000 || 4 * exact[1] < 3 * exact[0], "bounds save no work: {exact:?} exact evaluations");
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
    // Poses are rounded to 2 mm there.
    let mut random = Random(4);
    let far = compare(&mut culling, steps, || random_step(&mut random, 6, 5, 2.0, Vec3::splat(16384.0)));
    let [_, contacts, ..] = far;
    assert!(contacts > steps);
    println!("{:?}", culling.times());
}

#[test]
fn shapes_are_uploaded_once() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let (mut input, statics) = random_step(&mut Random(2), 40, 10, 2.0, Vec3::ZERO);
    // Otherwise bodies push each other along, and a step is culled more than once.
    input.bodies.iter_mut().for_each(|body| body.stops = body.active);
    let mut uploaded = |input: &StepInput| uploaded(&mut culling, input, &statics);
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

/// Returns a box of random size that turns and moves, as a dynamic or kinematic body.
fn moving_box(random: &mut Random, body: &Body) -> Body {
    let half = Vec3::new(0.05 + random.unit(), 0.05 + 0.3 * random.unit(), 0.05 + random.unit());
    Body { solid: Solid::Parts(Arc::new(Cuboid { half })), stops: random.below(2) == 0, ..body.clone() }
}

#[test]
fn moving_boxes_are_second_sides() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let mut random = Random(11);
    let mut own = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let (mut bounded, mut turning) = (0, 0);
    let total = compare(&mut culling, 60, || {
        let (mut input, statics) = random_step(&mut random, 12, 2, 1.5, Vec3::ZERO);
        for index in (0..input.bodies.len()).step_by(2) {
            input.bodies[index] = moving_box(&mut random, &input.bodies[index]);
        }
        let is_box = |side: Side| side.body().is_some_and(|body| body % 2 == 0);
        for pair in own.cull(&input, &statics).unwrap().iter().filter(|pair| is_box(pair.sides[1])) {
            assert!(matches!(pair.primitives, Primitives::Bounded(_)), "{pair:?}");
            bounded += pair.primitives.indices().count();
            let body = &input.bodies[pair.sides[1].body().unwrap() as usize];
            turning += usize::from(body.sweep.rotation.length() > 0.1);
        }
        (input, statics)
    });
    let [impacts, contacts, stops, _] = total;
    assert!(impacts > 60 && contacts > 100 && stops > 30, "{total:?}");
    assert!(bounded > 300 && turning > 50, "{bounded} primitives against boxes, {turning} turning boxes");
}

/// Worlds, compounds and levels of detail: bodies of other worlds and of the same rigid body do not meet, and shapes change between steps.
#[test]
fn worlds_compounds_and_levels_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    let coarser = MedialAxis::torus(0.5, 0.1, 6).unwrap();
    let torus = MedialAxis::torus(0.5, 0.1, 40).unwrap().with_coarser(vec![(coarser, 0.01)]);
    let mut random = Random(12);
    let (mut fine, mut coarse) = (0, 0);
    let total = compare(&mut culling, 60, || {
        let (mut input, statics) = random_step(&mut random, 14, 4, 1.5, Vec3::ZERO);
        for body in &mut input.bodies {
            body.world = u32::from(random.below(4) == 0);
            body.rigid_body = Some(random.below(8) as u64).filter(|id| *id < 4);
            if random.below(3) == 0 {
                let level = random.below(2);
                body.solid = Solid::Medial(Shape::new(torus.level(level).clone()));
                (fine, coarse) = if level == 0 { (fine + 1, coarse) } else { (fine, coarse + 1) };
            }
        }
        (input, statics)
    });
    let [impacts, contacts, stops, _] = total;
    assert!(impacts > 50 && contacts > 200 && stops > 30, "{total:?}");
    assert!(fine > 50 && coarse > 50, "{fine} fine, {coarse} coarse shapes");
}

#[test]
fn flat_mode_tests_all_primitives_of_near_bodies() {
    let Some(gpu) = device() else { return };
    let [mut flat, mut trees] = [(); 2].map(|()| GpuCulling::new(gpu, GpuCapacity::default()).unwrap());
    flat.set_flat(true);
    let mut random = Random(13);
    let mut tested = [0; 2];
    for _ in 0..10 {
        let (input, statics) = random_step(&mut random, 12, 4, 1.5, Vec3::ZERO);
        let [all, few] = [&mut flat, &mut trees].map(|culling| sorted(culling.cull(&input, &statics).unwrap()));
        assert_eq!(all.len(), few.len());
        for (all, few) in all.iter().zip(&few) {
            let listed: Vec<[u32; 2]> = all.primitives.indices().collect();
            let missing = few.primitives.indices().find(|pair| !listed.contains(pair));
            assert_eq!((all.sides, missing), (few.sides, None));
        }
        tested[0] += flat.counts()[2];
        tested[1] += trees.counts()[2];
    }
    assert!(tested[0] > 2 * tested[1] && tested[1] > 0, "{tested:?}");
}

/// 200 clubs with the centre of mass at one end spin at 30 rad/s and fly at up to 5 m/s. The motion is that of four steps, as in the look-ahead.
#[test]
fn chains_of_cones_leave_half_of_the_pairs_of_clubs_that_spin_for_several_steps() {
    let club = MedialAxis::cone(Sphere::new(Vec3::ZERO, 0.25), Sphere::new(Vec3::X, 0.02)).unwrap();
    let shape = Shape::new(club);
    let (mut random, spacing) = (Random(3), 3.0 * shape.bounding_sphere().radius);
    let mut body = |number: usize| {
        let place = Vec3::new((number % 6) as f32, (number / 6 % 6) as f32, (number / 36) as f32) * spacing;
        let pose = Pose3::from_parts(place + random.in_cube() * 0.2 * spacing, random.rotation());
        let [translation, rotation] = [random.in_cube() * 5.0 / 60.0, random.direction().as_vec3() * 30.0 / 60.0];
        Body::new(shape.clone(), Sweep::at_rates(pose, shape.center_of_mass(), translation, rotation))
    };
    let input = StepInput { bodies: (0..200).map(&mut body).collect(), ..Default::default() };
    let (input, statics) = (chains::continued(&input, 4), Statics::default());
    let [single, links] = [1, 8].map(|links| chains::pairs(&input, &statics, links));
    let cpu = step(&input, &statics, pool()).counts.body_pairs;
    assert!(links <= cpu && 2 * cpu <= single, "{single} pairs with single cones, {cpu} with chains");
    let Some(gpu) = device() else { return };
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default()).unwrap();
    culling.cull(&input, &statics).unwrap();
    let left = culling.counts()[0] as usize;
    assert!(cpu <= left && 2 * left <= single, "{single} pairs with single cones, {left} with chains on the GPU");
}
