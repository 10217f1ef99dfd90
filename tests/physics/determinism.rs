//! The same input gives the same bits: for any number of threads, in every run.

use bevy::{
    prelude::*,
    tasks::{TaskPool, TaskPoolBuilder},
};
use bevy_medial::{
    pipeline::{Statics, StepInput, StepOutput, step},
    plugin::MedialStep,
    scenes::{SCENES, Scene, SceneEntity},
};

use crate::{
    common::*,
    random_steps::{random_step, tally},
};

/// All that a step finds, as text: every number in as many digits as tell it from all others.
fn bits(output: &StepOutput) -> String {
    format!("{:?} {:?} {:?}", output.stops, output.pairs, output.manifolds)
}

/// Runs the input on pools of 1, 2 and 8 threads, and twice on the last.
fn check(input: &StepInput, statics: &Statics, pools: &[TaskPool]) {
    let expected = bits(&step(input, statics, &pools[0]));
    for pool in pools.iter().chain(pools.last()) {
        assert!(bits(&step(input, statics, pool)) == expected, "{} threads", pool.thread_num());
    }
}

fn pools() -> Vec<TaskPool> {
    [1, 2, 8].into_iter().map(|threads| TaskPoolBuilder::new().num_threads(threads).build()).collect()
}

#[test]
fn a_step_of_a_scene_does_not_depend_on_the_number_of_threads() {
    let pools = pools();
    let mut total = [0; 4];
    for scene in SCENES {
        let mut app = app();
        scene.spawn(app.world_mut(), models(), 1);
        for number in 0..120 {
            app.update();
            let medial = app.world().resource::<MedialStep>();
            if number % 3 == 0 {
                check(&medial.input, &medial.statics, &pools);
                total.iter_mut().zip(tally(&medial.output)).for_each(|(sum, count)| *sum += count);
            }
        }
    }
    println!("impacts, contacts, stops, pairs {total:?}");
    assert!(total[0] > 100 && total[1] > 5000 && total[2] > 100);
}

#[test]
fn a_random_step_does_not_depend_on_the_number_of_threads() {
    let pools = pools();
    for seed in 0..100 {
        let (input, statics) = random_step(&mut Random(seed), 60, 30, 4.0, Vec3::ZERO);
        check(&input, &statics, &pools);
    }
}

#[test]
fn a_static_far_away_changes_nothing() {
    let pool = &pools()[1];
    for seed in 0..200 {
        let (input, statics) = random_step(&mut Random(seed), 20, 10, 3.0, Vec3::ZERO);
        let expected = bits(&step(&input, &statics, pool));
        let mut bodies = statics.bodies().to_vec();
        let mut far = bodies[0].clone();
        far.pose.translation += Vec3::new(500.0, 300.0, -200.0);
        bodies.push(far);
        assert!(bits(&step(&input, &Statics::new(bodies), pool)) == expected, "seed {seed}");
    }
}

/// Final poses and velocities of a scene's bodies, in the order of spawning.
fn outcome(scene: &Scene, steps: u32) -> Vec<String> {
    let mut app = app();
    scene.spawn(app.world_mut(), models(), 7);
    run(&mut app, steps);
    let mut bodies = app.world_mut().query_filtered::<Entity, With<SceneEntity>>();
    let mut bodies: Vec<Entity> = bodies.iter(app.world()).collect();
    bodies.sort();
    let mut state = |body: Entity| {
        let body = rigid(&mut app, body);
        format!("{:?} {:?} {}", body.position(), body.vels(), body.is_sleeping())
    };
    bodies.into_iter().map(&mut state).collect()
}

#[test]
fn a_scene_ends_the_same_in_every_run() {
    for (scene, steps) in SCENES.iter().zip([300, 120, 150, 200]) {
        let expected = outcome(scene, steps);
        assert!(expected.len() > 10);
        assert_eq!(expected, outcome(scene, steps), "{}", scene.name);
    }
}
