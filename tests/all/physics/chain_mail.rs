//! Links of the scene `chain_mail`.

use std::f32::consts::TAU;

use bevy::prelude::*;
use bevy_medial::scenes::Scene;

use crate::common::*;

/// Number of corners of the polygon that stands for the centre line of a ring.
const CORNERS: usize = 24;
/// Radius of the centre line in metres.
const RADIUS: f32 = 0.15;

/// Returns the linking number of the centre lines of two rings around the y axes of their transforms: the signed number of times that the first one passes
/// through the disc of the second.
fn linking_number(first: &Transform, second: &Transform) -> i32 {
    if first.translation.distance(second.translation) > 2.0 * RADIUS {
        return 0;
    }
    let to_second = second.to_matrix().inverse();
    let corner = |i: usize| {
        let (sin, cos) = (i as f32 / CORNERS as f32 * TAU).sin_cos();
        to_second.transform_point3(first.transform_point(Vec3::new(cos, 0.0, sin) * RADIUS))
    };
    let crossing = |i: usize| {
        let [a, b] = [corner(i), corner((i + 1) % CORNERS)];
        let crosses = (a.y < 0.0) != (b.y < 0.0) && a.lerp(b, a.y / (a.y - b.y)).length() < RADIUS;
        if crosses { (b.y - a.y).signum() as i32 } else { 0 }
    };
    (0..CORNERS).map(crossing).sum()
}

/// Returns the linked pairs of rings.
fn links(app: &mut App, rings: &[Entity]) -> Vec<[usize; 2]> {
    let transforms: Vec<Transform> = rings.iter().map(|&ring| *app.world().get::<Transform>(ring).unwrap()).collect();
    let pairs = (0..rings.len()).flat_map(|i| (0..i).map(move |j| [i, j]));
    pairs.filter(|&[i, j]| linking_number(&transforms[i], &transforms[j]) != 0).collect()
}

/// Runs the scene and returns the number of links that are lost, and the largest distance that the ball has moved a ring, in metres.
fn run_sheet(steps: usize) -> (usize, f32) {
    let mut app = app();
    Scene::by_name("chain_mail").unwrap().spawn(app.world_mut(), models(), 1);
    let mut names = app.world_mut().query::<(Entity, &Name)>();
    let rings: Vec<Entity> =
        names.iter(app.world()).filter(|(_, name)| name.as_str() == "ring").map(|(entity, _)| entity).collect();
    let start = links(&mut app, &rings);
    // Each of nine pairs of neighbouring rows has a zigzag of 19 links.
    assert_eq!((rings.len(), start.len()), (100, 9 * 19));
    let (mut lost, mut farthest) = (0, 0.0f32);
    for step in 0..steps {
        app.update();
        farthest = rings.iter().map(|&ring| position(&mut app, ring).z).fold(farthest, f32::max);
        if step % 20 == 19 {
            lost = lost.max(start.len() - links(&mut app, &rings).iter().filter(|link| start.contains(link)).count());
        }
    }
    (lost, farthest)
}

#[test]
fn a_ball_pulls_no_ring_out_of_chain_mail() {
    let (lost, farthest) = run_sheet(1_000);
    println!("the sheet moved by {farthest} m");
    assert_eq!(lost, 0);
    assert!(farthest > 0.2, "the ball moved the sheet by {farthest} m");
}

/// The same over the time of three minutes. Runs with `cargo test --release -- --ignored`.
#[test]
#[ignore = "takes minutes"]
fn no_ring_leaves_chain_mail_in_ten_thousand_steps() {
    assert_eq!(run_sheet(10_000).0, 0);
}

#[test]
fn linked_rings_have_a_linking_number() {
    let upright = Transform::from_rotation(Quat::from_rotation_x(TAU / 4.0));
    for (distance, is_linked) in [(0.1, true), (0.2, true), (0.29, true), (0.31, false)] {
        let flat = Transform::from_xyz(distance, 0.0, 0.0);
        assert_eq!(linking_number(&flat, &upright) != 0, is_linked, "at {distance} m");
    }
    assert_eq!(linking_number(&Transform::IDENTITY, &Transform::from_xyz(0.1, 0.05, 0.0)), 0);
}
