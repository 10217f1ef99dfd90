//! Hybrid culling loses no pairs and adds no pairs.

use bevy::tasks::{ComputeTaskPool, TaskPool};
use bevy_medial::{
    geometry::Sweep,
    pipeline::{Body, Culling, Side, Statics, StepInput, StepOutput, step},
};
use bevy_medial_compare::baselines::Kind;
use glam::Vec3;

use crate::{
    common::Random,
    random_steps::{random_step, tally},
};

fn pool() -> &'static TaskPool {
    ComputeTaskPool::get_or_init(Default::default)
}

fn run(input: &StepInput, statics: &Statics) -> StepOutput {
    step(input, statics, pool())
}

/// Compares steps with and without culling on random input. Returns the numbers of impacts, contacts, stops and pairs.
fn compare(seed: u64, steps: usize, bodies: usize, statics: usize, room: f32) -> [usize; 4] {
    let mut random = Random(seed);
    let mut total = [0; 4];
    let (mut kept, mut all, mut unresolved, mut tests) = (0, 0, 0, 0);
    for number in 0..steps {
        let (mut input, statics) = random_step(&mut random, bodies, statics, room, Vec3::ZERO);
        let hybrid = run(&input, &statics);
        input.culling = Culling::None;
        let none = run(&input, &statics);
        assert_eq!(hybrid.pairs, none.pairs, "step {number}");
        assert_eq!(hybrid.manifolds, none.manifolds, "step {number}");
        assert_eq!(hybrid.stops, none.stops, "step {number}");
        unresolved += hybrid.counts.unresolved;
        tests += hybrid.counts.toi_tests;
        kept += hybrid.counts.candidates;
        all += none.counts.candidates;
        total.iter_mut().zip(tally(&hybrid)).for_each(|(sum, count)| *sum += count);
    }
    println!(
        "{steps} steps: impacts, contacts, stops, pairs {total:?}; {kept} of {all} candidates kept, {unresolved} of {tests} searches unresolved"
    );
    // Fast kinematic bodies push others through the whole room, so the share is limited.
    assert!(3 * kept < 2 * all, "too few candidates are culled");
    total
}

#[test]
fn culling_changes_no_result_of_few_bodies() {
    compare_few(4000);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_culling_changes_no_result_of_few_bodies() {
    compare_few(10_000);
}

fn compare_few(steps: usize) {
    let [impacts, contacts, stops, _] = compare(1, steps, 6, 5, 2.0);
    assert!(2 * impacts > 3 * steps && 2 * contacts > 11 * steps && stops > steps);
}

#[test]
fn culling_changes_no_result_of_many_bodies() {
    let [impacts, contacts, stops, _] = compare(2, 200, 50, 20, 5.0);
    assert!(impacts > 3000 && contacts > 9_000 && stops > 1500);
}

#[test]
fn baselines_give_the_same_results() {
    compare_baselines(1000);
}

#[test]
#[ignore = "exhaustive"]
fn exhaustive_baselines_give_the_same_results() {
    compare_baselines(3000);
}

fn compare_baselines(steps: usize) {
    let mut random = Random(3);
    let (mut totals, mut kept, mut hybrids) = ([0; 4], [0; 4], 0);
    for number in 0..steps {
        let (mut input, statics) = random_step(&mut random, 12, 6, 2.0, Vec3::ZERO);
        // The baselines do not support bodies that push others.
        input.bodies.iter_mut().for_each(|body| body.stops = body.active);
        let hybrid = run(&input, &statics);
        for (kind, kept) in [Kind::Obb, Kind::Sphere, Kind::Aabb, Kind::Medial].into_iter().zip(&mut kept) {
            let other = kind.baseline().step(&input, &statics, pool()).unwrap();
            assert_eq!(hybrid.pairs, other.pairs, "step {number}, {kind:?}");
            assert_eq!(hybrid.manifolds, other.manifolds, "step {number}, {kind:?}");
            assert_eq!(hybrid.stops, other.stops, "step {number}, {kind:?}");
            *kept += other.counts.candidates;
        }
        hybrids += hybrid.counts.candidates;
        totals.iter_mut().zip(tally(&hybrid)).for_each(|(sum, count)| *sum += count);
    }
    let [impacts, contacts, stops, _] = totals;
    println!("{impacts} impacts, {contacts} contacts, {stops} stops; candidates {kept:?}, hybrid {hybrids}");
    assert!(impacts > 3 * steps && contacts > 6 * steps && stops > 2 * steps);
    assert!(kept.iter().all(|&kept| kept < 2 * hybrids), "the baselines cull too few candidates");
}

#[test]
fn baselines_refuse_unsupported_steps() {
    let mut random = Random(4);
    let (mut input, statics) = random_step(&mut random, 4, 1, 2.0, Vec3::ZERO);
    let body = &mut input.bodies[0];
    (body.stops, body.sweep.translation) = (false, Vec3::X);
    let result = Kind::Aabb.baseline().step(&input, &statics, pool());
    assert_eq!(result.err().as_deref(), Some("body 0 moves and does not stop"));
}

/// Depth of the overlap of two sides at the start of a step, in metres.
fn depth_at_start(input: &StepInput, statics: &Statics, sides: (Side, Side)) -> f32 {
    let mut input = input.clone();
    input.bodies.iter_mut().for_each(|body| body.sweep = Sweep::at_rest(body.sweep.start));
    let output = run(&input, statics);
    let pair = output.pairs.iter().find(|pair| (pair.first, pair.second) == sides).expect("an overlap");
    let depths = output.manifolds[pair.manifolds.clone()].iter().map(|manifold| -manifold.contacts()[0].distance);
    depths.fold(0.0, f32::max)
}

#[test]
fn impacts_far_from_the_origin_are_the_same() {
    // At this distance the bits of all starts are the same, and ends differ by up to 0.06 mm.
    let far = Vec3::new(1024.0, -1024.0, 1024.0);
    let (mut impacts, mut exact, mut late, mut alone) = (0, 0, 0, 0);
    for seed in 0..2000 {
        let [(near, input, statics), (remote, ..)] = [Vec3::ZERO, far].map(|origin| {
            let (mut input, statics) = random_step(&mut Random(seed), 10, 6, 2.0, origin);
            // One additional stop would change all later results.
            input.stop_at_impact = false;
            // The depth at the start decides where cores touch, and rounding changes it.
            input.core_depth = 0.0;
            input.bodies.iter_mut().for_each(|body| body.core_depth = 0.0);
            (run(&input, &statics), input, statics)
        });
        let impacts_of = |output: &StepOutput| {
            let impacts = output.pairs.iter().filter_map(|pair| Some(((pair.first, pair.second), pair.impact?)));
            impacts.collect::<Vec<_>>()
        };
        let (near, mut remote) = (impacts_of(&near), impacts_of(&remote));
        for (pair, a) in &near {
            let Some(index) = remote.iter().position(|(other, _)| other == pair) else {
                println!("seed {seed}: {pair:?} {a:?} only near");
                alone += 1;
                continue;
            };
            let (_, b) = remote.swap_remove(index);
            let [reach1, reach2] = [pair.0, pair.1].map(|side| {
                side.body().map_or(0.0, |body| {
                    let Body { sweep, solid, .. } = &input.bodies[body as usize];
                    sweep.reach(solid.bounding_sphere().radius)
                })
            });
            // Grazing bodies differ, and so do spinning ones if the number of chords changes. If bodies overlap deeply at the start, the overlap may
            // hardly grow, and another one may be reported instead.
            let displacement = (a.fraction - b.fraction).abs() * (reach1 + reach2);
            if displacement >= 0.05 {
                let depth = depth_at_start(&input, &statics, *pair);
                let bodies = [pair.0, pair.1].into_iter().filter_map(Side::body);
                let radii = bodies.map(|body| input.bodies[body as usize].solid.bounding_sphere().radius);
                let size = radii.fold(f32::INFINITY, f32::min);
                assert!(depth > 0.05 * size, "seed {seed}, {depth} m deep of {size} m: {a:?} {b:?}");
                late += 1;
            }
            exact += usize::from(displacement < 1e-3 && (a.point + far).distance(b.point) < 2e-3);
            impacts += 1;
        }
        alone += remote.len();
    }
    println!(
        "{impacts} impacts, {exact} of them the same within 2 mm, {late} not within 5 cm, {alone} in one place only"
    );
    assert!(impacts > 9_000 && 1000 * exact > 995 * impacts && 1000 * alone < impacts && 2000 * late < impacts);
}
