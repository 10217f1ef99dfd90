//! The same input gives the same bits, for any number of threads and in every run.

use std::process::Command;

use bevy::{
    prelude::*,
    tasks::{ComputeTaskPool, TaskPool, TaskPoolBuilder},
};
use bevy_medial::{
    medial_axis::MedialAxis,
    pipeline::{Body, ContactCache, Side, Statics, StepInput, StepOutput, step},
    plugin::MedialStep,
    rapier::OwedTime,
    scenes::{SCENES, Scene, SceneEntity},
};
use bevy_rapier3d::{
    plugin::context::{
        RapierContextColliders, RapierContextEntityLink, RapierContextJoints, RapierContextSimulation,
        RapierRigidBodySet,
    },
    prelude::{RigidBody, Velocity},
    rapier::{
        dynamics::{CCDSolver, IslandManager},
        geometry::{DefaultBroadPhase, NarrowPhase},
        pipeline::PhysicsPipeline,
    },
};

use crate::{
    common::*,
    random_steps::{random_step, tally},
};

/// All results of a step as text, each number with enough digits to be unique.
fn bits(output: &StepOutput) -> String {
    format!("{:?} {:?} {:?}", output.stops, output.pairs, output.manifolds)
}

/// Runs the input on each of the pools, and again on the last one.
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
fn scene_steps_do_not_depend_on_the_number_of_threads() {
    let pools = pools();
    let mut total = [0; 4];
    for scene in SCENES {
        let mut app = app();
        scene.spawn(app.world_mut(), models(), 1);
        for number in 0..120 {
            app.update();
            let medial = app.world().resource::<MedialStep>();
            if number % 6 == 0 {
                check(&medial.input, &medial.statics, &pools);
                total.iter_mut().zip(tally(&medial.output)).for_each(|(sum, count)| *sum += count);
            }
        }
    }
    println!("impacts, contacts, stops, pairs {total:?}");
    assert!(total[0] > 50 && total[1] > 2500 && total[2] > 50);
}

#[test]
fn random_steps_do_not_depend_on_the_number_of_threads() {
    let pools = pools();
    for seed in 0..40 {
        let (input, statics) = random_step(&mut Random(seed), 60, 30, 4.0, Vec3::ZERO);
        check(&input, &statics, &pools);
    }
}

#[test]
fn a_static_far_away_changes_no_result() {
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
    state(&mut app)
}

/// Poses and velocities of a scene's bodies, in the order of spawning.
fn state(app: &mut App) -> Vec<String> {
    let mut bodies = app.world_mut().query_filtered::<Entity, With<SceneEntity>>();
    let mut bodies: Vec<Entity> = bodies.iter(app.world()).collect();
    bodies.sort();
    let mut state = |body: Entity| {
        let body = rigid(app, body);
        format!("{:?} {:?} {}", body.position(), body.vels(), body.is_sleeping())
    };
    bodies.into_iter().map(&mut state).collect()
}

/// Every scene with its number of steps.
fn scenes_for(steps: [u32; 7]) -> impl Iterator<Item = (&'static Scene, u32)> {
    assert_eq!(SCENES.len(), steps.len());
    SCENES.iter().zip(steps)
}

#[test]
fn a_scene_ends_the_same_in_every_run() {
    for (scene, steps) in scenes_for([300, 120, 150, 200, 100, 70, 60]) {
        let expected = outcome(scene, steps);
        assert!(expected.len() > 10);
        assert_eq!(expected, outcome(scene, steps), "{}", scene.name);
    }
}

/// Variable with the number of threads for [`child_process_that_prints_scenes`].
const THREADS: &str = "MEDIAL_TEST_THREADS";

/// The number applies to rapier's own threads as well, if its `parallel` feature is on.
#[test]
fn a_scene_ends_the_same_on_any_number_of_threads() {
    let ends = ["1", "2", "8"].map(|threads| {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "physics::determinism::child_process_that_prints_scenes", "--ignored", "--nocapture"])
            .envs([(THREADS, threads), ("RAYON_NUM_THREADS", threads)])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&child.stdout).into_owned();
        assert!(child.status.success() && text.contains("1 passed"), "{text}");
        let ends: Vec<String> = text.lines().filter(|line| line.contains("Pose")).map(str::to_owned).collect();
        assert!(ends.len() > 100, "{text}");
        ends
    });
    assert!(ends[0] == ends[1] && ends[0] == ends[2]);
}

/// Run by [`a_scene_ends_the_same_on_any_number_of_threads`] because a process has one pool for all apps.
#[test]
#[ignore = "needs a process of its own"]
fn child_process_that_prints_scenes() {
    let threads = std::env::var(THREADS).unwrap().parse().unwrap();
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(threads).build());
    assert_eq!(pool.thread_num(), threads);
    for (scene, steps) in scenes_for([200, 60, 100, 120, 60, 50, 60]) {
        outcome(scene, steps).iter().for_each(|body| println!("{} {body}", scene.name));
    }
}

/// Results of a step for the bodies to which `number` assigns a number, with these numbers.
fn bits_of(output: &StepOutput, number: impl Fn(u32) -> Option<u32>) -> String {
    let mut text = String::new();
    for stop in &output.stops {
        if let Some(body) = number(stop.body) {
            text += &format!("{body} {} {:?}", stop.fraction, stop.pose);
        }
    }
    for pair in &output.pairs {
        let sides = [pair.first, pair.second].map(|side| match side {
            Side::Body(body) => number(body).map(Side::Body),
            Side::Static(_) => Some(side),
        });
        if let [Some(first), Some(second)] = sides {
            let manifolds = &output.manifolds[pair.manifolds.clone()];
            text += &format!("{first:?} {second:?} {:?} {manifolds:?}", pair.impact);
        }
    }
    text
}

/// This holds for steps, but not for whole worlds: the order of contacts in rapier's solver depends on the order in which its broad phase has found
/// the pairs of all bodies.
#[test]
fn bodies_far_away_change_no_result_of_a_step() {
    let pool = &pools()[1];
    let mut stops = 0;
    for seed in 0..200 {
        let mut random = Random(1000 + seed);
        let (mut input, statics) = random_step(&mut Random(seed), 20, 10, 3.0, Vec3::ZERO);
        let output = step(&input, &statics, pool);
        let expected = bits_of(&output, Some);
        stops += output.stops.len();
        let (others, _) = random_step(&mut random, 10, 0, 3.0, Vec3::new(400.0, 200.0, -300.0));
        let mut bodies: Vec<(Option<u32>, Body)> = (0..).map(Some).zip(input.bodies.drain(..)).collect();
        for other in others.bodies {
            bodies.insert(random.below(bodies.len() + 1), (None, Body { rigid_body: None, ..other }));
        }
        let (numbers, bodies): (Vec<_>, Vec<_>) = bodies.into_iter().unzip();
        input.bodies = bodies;
        let output = step(&input, &statics, pool);
        assert!(bits_of(&output, |body| numbers[body as usize]) == expected, "seed {seed}");
    }
    assert!(stops > 500, "{stops}");
}

#[test]
fn spawning_entities_without_bodies_changes_no_result() {
    for (scene, steps) in scenes_for([200, 120, 150, 150, 100, 50, 60]) {
        let expected = outcome(scene, steps);
        let mut app = app();
        scene.spawn(app.world_mut(), models(), 7);
        app.update();
        let mut random = Random(2);
        let mut others: Vec<Entity> = Vec::new();
        for _ in 1..steps {
            if others.len() < 20 || random.below(2) == 0 {
                others.push(app.world_mut().spawn((Transform::default(), Bystander)).id());
            } else {
                let gone = others.swap_remove(random.below(others.len()));
                app.world_mut().despawn(gone);
            }
            app.update();
        }
        assert!(expected == state(&mut app), "{}", scene.name);
    }
}

/// Bodies of the same context would change the order of contacts in rapier's solver.
#[test]
fn spawning_in_another_context_changes_no_result() {
    for (scene, steps) in scenes_for([150, 120, 150, 150, 100, 80, 100]) {
        let expected = outcome(scene, steps);
        let mut app = app();
        scene.spawn(app.world_mut(), models(), 7);
        app.update();
        let second = app.world_mut().spawn(RapierContextSimulation::default()).id();
        let ball = mesh(&mut app, MedialAxis::sphere(0.1).unwrap());
        let mut random = Random(3);
        let mut others: Vec<Entity> = Vec::new();
        let mut touching = 0;
        for _ in 1..steps {
            if others.len() < 20 || random.below(2) == 0 {
                // The balls are in the middle of the scene and touch each other.
                let at = Transform::from_translation(random.in_ball() * Vec3::new(1.0, 0.5, 1.0));
                let body = (RigidBody::Dynamic, ball.clone(), at, RapierContextEntityLink(second));
                others.push(app.world_mut().spawn(body).id());
            } else {
                let gone = others.swap_remove(random.below(others.len()));
                app.world_mut().despawn(gone);
            }
            app.update();
            let step = app.world().resource::<MedialStep>();
            touching += step.output.pairs.iter().filter(|pair| step.context(pair.first) == second).count();
        }
        assert!(expected == state(&mut app), "{}", scene.name);
        assert!(touching > 100, "{}: {touching}", scene.name);
    }
}

#[derive(Component)]
struct Bystander;

/// Rapier's context, and the components that rapier reads from the world. Rapier's pipeline is not saved because it is only a workspace.
struct Saved {
    bodies: RapierRigidBodySet,
    colliders: RapierContextColliders,
    joints: RapierContextJoints,
    islands: IslandManager,
    broad_phase: DefaultBroadPhase,
    narrow_phase: NarrowPhase,
    ccd_solver: CCDSolver,
    components: Vec<(Entity, Transform, Option<Velocity>)>,
    owed: OwedTime,
    contacts: ContactCache,
}

fn save(app: &mut App) -> Saved {
    let world = app.world_mut();
    let mut components = world.query_filtered::<(Entity, &Transform, Option<&Velocity>), With<SceneEntity>>();
    let components =
        components.iter(world).map(|(e, transform, velocity)| (e, *transform, velocity.copied())).collect();
    let mut contexts =
        world.query::<(&RapierRigidBodySet, &RapierContextColliders, &RapierContextJoints, &RapierContextSimulation)>();
    let (bodies, colliders, joints, simulation) = contexts.single(world).unwrap();
    Saved {
        bodies: bodies.clone(),
        colliders: colliders.clone(),
        joints: joints.clone(),
        islands: simulation.islands.clone(),
        broad_phase: simulation.broad_phase.clone(),
        narrow_phase: simulation.narrow_phase.clone(),
        ccd_solver: simulation.ccd_solver.clone(),
        components,
        owed: app.world().resource::<OwedTime>().clone(),
        contacts: app.world().resource::<MedialStep>().contacts().clone(),
    }
}

fn restore(app: &mut App, saved: &Saved) {
    let world = app.world_mut();
    let mut contexts = world.query::<(
        &mut RapierRigidBodySet,
        &mut RapierContextColliders,
        &mut RapierContextJoints,
        &mut RapierContextSimulation,
    )>();
    let (mut bodies, mut colliders, mut joints, mut simulation) = contexts.single_mut(world).unwrap();
    *bodies = saved.bodies.clone();
    *colliders = saved.colliders.clone();
    *joints = saved.joints.clone();
    simulation.islands = saved.islands.clone();
    simulation.broad_phase = saved.broad_phase.clone();
    simulation.narrow_phase = saved.narrow_phase.clone();
    simulation.ccd_solver = saved.ccd_solver.clone();
    simulation.pipeline = PhysicsPipeline::new();
    world.insert_resource(saved.owed.clone());
    world.resource_mut::<MedialStep>().set_contacts(saved.contacts.clone());
    for &(entity, transform, velocity) in &saved.components {
        let mut entity = world.entity_mut(entity);
        entity.insert(transform);
        if let Some(velocity) = velocity {
            entity.insert(velocity);
        }
    }
}

/// Runs a scene, saves it on the way, and replays it twice from the saved state.
fn assert_replays(scene: &Scene, [before, after]: [u32; 2]) {
    let mut app = app();
    scene.spawn(app.world_mut(), models(), 7);
    run(&mut app, before);
    let saved = save(&mut app);
    let start = state(&mut app);
    run(&mut app, after);
    let expected = state(&mut app);
    assert!(start != expected);
    for _ in 0..2 {
        restore(&mut app, &saved);
        assert!(start == state(&mut app), "{}", scene.name);
        run(&mut app, after);
        assert!(expected == state(&mut app), "{} from step {before} on", scene.name);
    }
}

#[test]
fn a_saved_context_can_be_replayed_exactly() {
    let plans = [
        ("rods", [150, 100]),
        ("dinosaur", [60, 40]),
        ("tori", [100, 60]),
        ("stairs", [100, 60]),
        ("bullets", [40, 30]),
        ("pile", [50, 15]),
        ("chain_mail", [20, 20]),
    ];
    for (name, plan) in plans {
        assert_replays(Scene::by_name(name).unwrap(), plan);
    }
    assert_eq!(plans.len(), SCENES.len());
}

#[test]
fn touches_changed_by_a_restore_are_reported_once() {
    let mut app = app();
    let ground = spawn_ground(&mut app);
    let ball = spawn_body(&mut app, MedialAxis::sphere(0.2).unwrap(), Transform::from_xyz(0.0, 0.5, 0.0));
    app.world_mut().entity_mut(ball).insert(SceneEntity);
    let mut record = Record::default();
    record.run(&mut app, 2);
    let apart = save(&mut app);
    record.run(&mut app, 60);
    let touching = save(&mut app);
    assert_eq!(record.counts(ball, ground), [1, 0]);
    for (saved, counts) in [(&apart, [1, 1]), (&touching, [2, 1]), (&touching, [2, 1]), (&apart, [2, 2])] {
        restore(&mut app, saved);
        record.run(&mut app, 5);
        assert_eq!(record.counts(ball, ground), counts);
    }
}

/// The saved state contains the raised solver iterations.
#[test]
fn raised_solver_iterations_are_reset_after_a_restore() {
    for before in [3, 5, 8, 12] {
        assert_replays(Scene::by_name("bullets").unwrap(), [before, 30]);
    }
}
