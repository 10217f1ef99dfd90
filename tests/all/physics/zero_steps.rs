//! Steps without length change nothing.

use std::time::Duration;

use bevy::{prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{plugin::MedialStep, rapier::OwedTime, scenes::Scene};
use bevy_rapier3d::{
    plugin::context::{RapierContextColliders, RapierContextSimulation, RapierRigidBodySet, SimulationToRenderTime},
    prelude::{TimestepMode, Velocity},
};

use crate::common::*;

/// All of rapier's bodies as text, each number with enough digits to be unique. Rapier also marks the bodies that its plugin has accessed.
fn bodies(app: &mut App) -> Vec<String> {
    let mut contexts = app.world_mut().query::<&RapierRigidBodySet>();
    let bodies = contexts.iter(app.world()).flat_map(|set| set.bodies.iter());
    bodies
        .map(|body| format!("{body:?}").replace("RigidBodyChanges(IN_MODIFIED_SET)", "RigidBodyChanges(0x0)"))
        .collect()
}

/// The whole state of a world as text. It contains memory addresses.
fn bits(app: &mut App) -> Vec<String> {
    let mut text = bodies(app);
    let world = app.world_mut();
    let mut contexts = world.query::<(&RapierContextColliders, &RapierContextSimulation, &SimulationToRenderTime)>();
    for (colliders, simulation, lead) in contexts.iter(world) {
        text.extend(colliders.colliders.iter().map(|(handle, collider)| {
            format!("{handle:?} {:?} {:?} {:?}", collider.position(), collider.parent(), collider.mass_properties())
        }));
        for pair in simulation.narrow_phase.contact_pairs() {
            for manifold in pair.solver_manifolds() {
                text.push(format!("{:?} {:?} {:?}", pair.collider1, pair.collider2, manifold));
            }
        }
        text.push(format!("{}", lead.diff));
    }
    let mut entities = world.query::<(Entity, &Transform, &GlobalTransform, Option<&Velocity>)>();
    text.extend(entities.iter(world).map(|entity| format!("{entity:?}")));
    let step = world.resource::<MedialStep>();
    let output = &step.output;
    text.push(format!("{:?} {:?} {:?} {:?}", output.stops, output.pairs, output.manifolds, step.contacts()));
    let mut owed: Vec<String> =
        format!("{:?}", world.resource::<OwedTime>()).split("Owed").map(str::to_owned).collect();
    owed.sort();
    text.extend(owed);
    text
}

/// Modes of time whose steps have a length of zero.
fn stand_still(app: &mut App, mode: usize) {
    let (mode, frame) = match mode {
        0 => (TimestepMode::Fixed { dt: 0.0, substeps: 1 }, DT),
        1 => (TimestepMode::Variable { max_dt: 0.1, time_scale: 1.0, substeps: 2 }, 0.0),
        2 => (TimestepMode::Variable { max_dt: 0.1, time_scale: 0.0, substeps: 1 }, DT),
        _ => (TimestepMode::Interpolated { dt: DT, time_scale: 0.0, substeps: 1 }, DT),
    };
    app.insert_resource(mode).insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(frame)));
}

#[test]
fn a_step_of_no_time_changes_no_bit() {
    let mut moving = 0;
    for (name, steps) in [("rods", 60), ("dinosaur", 10), ("bullets", 10)] {
        let scene = Scene::by_name(name).unwrap();
        let [mut app, mut control] = std::array::from_fn(|_| {
            let mut app = app();
            scene.spawn(app.world_mut(), models(), 7);
            app
        });
        for mode in 0..4 {
            let go_on = |app: &mut App| {
                app.insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 });
                app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)));
                run(app, steps);
                bodies(app)
            };
            assert!(go_on(&mut app) == go_on(&mut control), "{}, before mode {mode}", scene.name);
            let before = bits(&mut app);
            stand_still(&mut app, mode);
            run(&mut app, 3);
            let after = bits(&mut app);
            let changed = before.iter().zip(&after).find(|(before, after)| before != after);
            assert!(changed.is_none() && before.len() == after.len(), "{}, mode {mode}: {changed:?}", scene.name);
            moving += usize::from(app.world().resource::<MedialStep>().input.bodies.iter().any(|body| body.active));
        }
    }
    assert_eq!(moving, 12);
}
