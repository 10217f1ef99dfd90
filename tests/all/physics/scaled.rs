//! A world of a thousandth of the size behaves like the large one if rapier's unit of length is set. So no length of this crate is fixed in metres.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::{plugin::context::RapierContextSimulation, prelude::RapierConfiguration};

use crate::common::*;

/// Positions of the bodies after every 30 steps, in units, and the number of contacts in all steps. `unit` is in metres.
fn run_world(unit: f32) -> (Vec<Vec3>, usize) {
    let mut app = app();
    // The first update creates rapier's context.
    app.update();
    let world = app.world_mut();
    let mut contexts = world.query::<(&mut RapierContextSimulation, &mut RapierConfiguration)>();
    for (mut simulation, mut configuration) in contexts.iter_mut(world) {
        simulation.integration_parameters.length_unit = unit;
        configuration.gravity = Vec3::Y * (-9.81 * unit);
    }
    // A floor of two parts, with a seam beneath the plates.
    for side in [-1.0, 1.0] {
        let half = Vec3::new(5.0, 1.0, 10.0) * unit;
        let place = Transform::from_translation(Vec3::new(5.0 * side, -1.0, 0.0) * unit);
        app.world_mut().spawn((StaticObb { half_extents: half }, place));
    }
    let mut bodies = Vec::new();
    let mut spawn = |axis: MedialAxis, place: Vec3, turn: Quat| {
        let transform = Transform::from_translation(place * unit).with_rotation(turn);
        bodies.push(spawn_body(&mut app, axis, transform));
    };
    for layer in 0..3 {
        let plate = MedialAxis::rounded_box(Vec3::new(0.5, 0.25, 0.5) * unit, 0.05 * unit).unwrap();
        spawn(plate, Vec3::new(0.02 * layer as f32, 0.26 + 0.51 * layer as f32, 0.0), Quat::IDENTITY);
    }
    let torus = MedialAxis::torus(0.4 * unit, 0.1 * unit, 24).unwrap();
    spawn(torus, Vec3::new(2.0, 0.6, 0.0), Quat::from_rotation_x(0.3));
    let rod = MedialAxis::capsule(Vec3::X * (-0.4 * unit), Vec3::X * (0.4 * unit), 0.1 * unit).unwrap();
    spawn(rod, Vec3::new(-2.0, 0.6, 0.0), Quat::from_rotation_z(0.4));
    let (mut places, mut contacts) = (Vec::new(), 0);
    for step in 1..=180 {
        app.update();
        contacts += app.world().resource::<MedialStep>().output.counts.contacts;
        if step % 30 == 0 {
            places.extend(bodies.iter().map(|&body| app.world().get::<Transform>(body).unwrap().translation / unit));
        }
    }
    (places, contacts)
}

#[test]
fn a_world_in_millimetres_behaves_like_one_in_metres() {
    let (large, contacts) = run_world(1.0);
    assert!(contacts > 500, "{contacts}");
    // Scaling by a power of two changes no mantissa.
    let (small, contacts_of_small) = run_world(1.0 / 1024.0);
    assert!(contacts_of_small.abs_diff(contacts) < contacts / 10, "{contacts_of_small} {contacts}");
    for (large, small) in large.iter().zip(&small) {
        assert!(large.distance(*small) < 2e-3, "{large} {small}");
    }
}
