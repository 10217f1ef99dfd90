//! Bodies that are spawned and despawned thousands of times.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, plugin::MedialStep, prelude::*, rapier::ContactTable};
use bevy_rapier3d::plugin::context::{
    RapierContextColliders, RapierContextJoints, RapierContextSimulation, RapierRigidBodySet,
};

use crate::common::*;

/// Sizes of all collections that might grow.
fn inventory(app: &mut App) -> [usize; 8] {
    let world = app.world_mut();
    let mut contexts =
        world.query::<(&RapierRigidBodySet, &RapierContextColliders, &RapierContextJoints, &RapierContextSimulation)>();
    let (bodies, colliders, _, simulation) = contexts.single(world).unwrap();
    let rapier = [
        bodies.bodies.len(),
        colliders.colliders.len(),
        bodies.entity2body().len(),
        colliders.entity2collider().len(),
        simulation.narrow_phase.contact_pairs().count(),
    ];
    let step = world.resource::<MedialStep>();
    let assets = world.resource::<Assets<MedialAxis>>().len();
    let [a, b, c, d, e] = rapier;
    [a, b, c, d, e, step.infos.len() + step.static_infos.len(), world.resource::<ContactTable>().len(), assets]
}

/// Spawns 10,000 bodies and statics, and despawns each after a few steps.
fn come_and_go(app: &mut App, record: &mut Record) {
    let shape = ball();
    let mut random = Random(8);
    let mut alive = std::collections::VecDeque::new();
    for _ in 0..250 {
        for _ in 0..40 {
            let at = Transform::from_translation(Vec3::new(3.0, 0.3, 0.0) + random.in_ball() * 2.0);
            // A body with an asset of its own, or a static box.
            let entity = if random.below(4) > 0 {
                spawn_body(app, shape.clone(), at)
            } else {
                app.world_mut().spawn((StaticObb::new(0.1, 0.1, 0.1), at)).id()
            };
            alive.push_back(entity);
        }
        while alive.len() > 40 {
            app.world_mut().despawn(alive.pop_front().unwrap());
        }
        record.run(app, 1);
    }
    alive.into_iter().for_each(|entity| _ = app.world_mut().despawn(entity));
    record.run(app, 200);
}

#[test]
fn ten_thousand_spawns_and_despawns_leave_nothing_behind() {
    let mut app = app();
    spawn_ground(&mut app);
    let kept = spawn_body(&mut app, plate(), Transform::from_xyz(0.0, 0.101, 0.0));
    let mut record = Record::default();
    record.run(&mut app, 200);
    let before = inventory(&mut app);
    come_and_go(&mut app, &mut record);
    assert!(record.started.len() > 1000, "too few touches: {}", record.started.len());
    assert_eq!(inventory(&mut app), before);
    assert!(is_at_rest(&mut app, kept));
    assert_eq!(record.started.len(), record.ended.len() + 1);
}

/// Resident memory of this process, in bytes.
#[cfg(target_os = "linux")]
fn resident() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * pages.split(' ').nth(1).unwrap().parse::<usize>().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn ten_thousand_spawns_and_despawns_leak_no_memory() {
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "physics::life::child_process_that_measures_memory", "--ignored", "--nocapture"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&child.stdout).into_owned();
    assert!(child.status.success() && text.contains("1 passed"), "{text}");
}

/// Run by [`ten_thousand_spawns_and_despawns_leak_no_memory`].
#[test]
#[cfg(target_os = "linux")]
#[ignore = "needs a process of its own"]
fn child_process_that_measures_memory() {
    let mut app = app();
    // The search for a GPU loads libraries, and starts when a step takes long.
    app.world_mut().resource_mut::<MedialSettings>().backend = MedialBackend::Cpu;
    spawn_ground(&mut app);
    let taken: Vec<usize> = (0..6)
        .map(|_| {
            come_and_go(&mut app, &mut Record::default());
            resident()
        })
        .collect();
    println!("{taken:?}");
    // bevy_rapier keeps 16 bytes of each removed collider. A body with its shape takes many hundreds of bytes.
    assert!(taken[5] < taken[1] + 40_000 * 64, "{taken:?}");
}
