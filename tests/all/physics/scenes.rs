//! Results of the demo scenes: no body sinks, escapes, tunnels or moves without a cause, and all bodies come to rest.

use std::path::PathBuf;

use bevy::prelude::Assets;
use bevy_medial::{
    medial_axis::MedialAxis,
    prelude::{MedialBudget, MedialLevel, MedialMesh},
    scenes::{Model, Monitor, Scene, Summary, load_models, set_budget},
};

use crate::common::*;

/// Runs a scene for its number of steps.
fn run_scene(name: &str, models: &[Model], seed: u64) -> Summary {
    let scene = Scene::by_name(name).unwrap();
    let mut app = app();
    scene.spawn(app.world_mut(), models, seed);
    run(&mut app, scene.steps);
    app.world_mut().resource_scope(|world, monitor: bevy::prelude::Mut<Monitor>| monitor.summary(name, seed, world))
}

/// `size`: largest extent of a body, in metres. With some seeds a body in a pile keeps creeping by millimetres, which keeps the bodies that touch it
/// awake. So most bodies must sleep with most seeds only.
fn accept(name: &str, models: &[Model], bodies: usize, size: f32, seeds: u64) {
    let mut asleep = 0;
    for seed in 1..=seeds {
        let summary = run_scene(name, models, seed);
        println!("{summary:?}");
        assert_eq!((summary.steps, summary.bodies), (600, bodies));
        assert!(summary.counts.contacts_max > bodies, "too few contacts");
        assert!(summary.lowest_y >= -0.02 * size, "sunk to {}", summary.lowest_y);
        assert_eq!((summary.escaped, summary.tunnelled, summary.ghosts), (0, 0, 0));
        assert!(summary.deepest_overlap_percent < 2.0, "{} %", summary.deepest_overlap_percent);
        // Round bodies keep rolling because rapier has no rolling friction.
        let energy = summary.kinetic_energy_per_kg;
        assert!(summary.asleep == bodies || energy < 5e-3, "{} of {bodies} asleep, {energy} J/kg", summary.asleep);
        asleep += u64::from(2 * summary.asleep > bodies);
    }
    assert!(2 * asleep > seeds, "asleep in {asleep} of {seeds}");
}

#[test]
fn rods_come_to_rest() {
    accept("rods", models(), 9, 1.15, 1);
    let research = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/models/qmat");
    if research.is_dir() {
        accept("rods", &load_models(&research).unwrap(), 9, 1.15, 1);
    }
}

#[test]
fn tori_come_to_rest() {
    accept("tori", models(), 51, 0.6, 3);
}

#[test]
fn bodies_on_stairs_come_to_rest() {
    accept("stairs", models(), 12, 1.1, 1);
}

/// Checks a scene of 240 steps. Bodies may still move at its end, and its busiest step must have more than `contacts` contacts.
fn accept_moving(name: &str, bodies: usize, contacts: usize) {
    let summary = run_scene(name, models(), 1);
    println!("{summary:?}");
    assert_eq!((summary.steps, summary.bodies), (240, bodies));
    assert!(summary.counts.contacts_max > contacts, "too few contacts");
    assert_eq!((summary.escaped, summary.tunnelled, summary.ghosts), (0, 0, 0));
    assert!(summary.lowest_y >= -0.02, "sunk to {}", summary.lowest_y);
    assert!(summary.deepest_overlap_percent < 2.0, "{} %", summary.deepest_overlap_percent);
}

#[test]
fn bullets_do_not_tunnel() {
    accept_moving("bullets", 15, 0);
}

#[test]
fn a_pile_does_not_sink_or_overlap() {
    accept_moving("pile", 200, 1000);
}

#[test]
fn bodies_of_a_scene_have_the_given_budget() {
    let primitives = |budget: Option<f32>| {
        let mut app = app();
        if let Some(percent) = budget {
            set_budget(&mut app, MedialBudget::Percent(percent));
        }
        Scene::by_name("stairs").unwrap().spawn(app.world_mut(), models(), 1);
        run(&mut app, 2);
        let mut levels = app.world_mut().query::<(&MedialMesh, &MedialLevel)>();
        let assets = app.world().resource::<Assets<MedialAxis>>();
        let of_body =
            |(mesh, level): (&MedialMesh, &MedialLevel)| assets.get(&mesh.0).unwrap().level(level.0).primitives().len();
        levels.iter(app.world()).map(of_body).sum::<usize>()
    };
    let [finest, default, one, coarse] = [Some(0.0), None, Some(1.0), Some(4.0)].map(primitives);
    assert_eq!(default, one);
    assert!(one <= finest && 2 * coarse < one, "{finest}, {one} and {coarse} primitives");
}

#[test]
fn the_monitor_counts_tunnelled_bodies() {
    let scene = Scene::by_name("bullets").unwrap();
    let mut app = app();
    app.world_mut().resource_mut::<bevy_medial::prelude::MedialSettings>().stop_at_impact = false;
    scene.spawn(app.world_mut(), models(), 1);
    run(&mut app, scene.steps);
    let tunnelled = app.world().resource::<Monitor>().tunnelled;
    assert!(tunnelled >= 3, "{tunnelled}");
}
