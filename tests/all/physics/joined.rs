//! Bodies on joints.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, pipeline::Side, prelude::*};
use bevy_rapier3d::prelude::*;

use crate::common::*;

const HALF: f32 = 0.3;

fn rod() -> MedialAxis {
    MedialAxis::capsule(Vec3::X * -HALF, Vec3::X * HALF, 0.05).unwrap()
}

/// A joint from the end of one rod to the start of the next rod.
fn ball_joint() -> TypedJoint {
    let length = HALF + 0.06;
    SphericalJointBuilder::new().local_anchor1(Vec3::X * length).local_anchor2(Vec3::X * -length).into()
}

/// A chain of rods along x, all with the same velocity.
fn spawn_chain(app: &mut App, count: usize, turn: Quat, velocity: Vec3, multibody: bool) -> Vec<Entity> {
    let mut chain: Vec<Entity> = Vec::new();
    for i in 0..count {
        let at = Transform::from_translation(turn * Vec3::X * (i as f32 * 2.0 * (HALF + 0.06))).with_rotation(turn);
        let rod = spawn_flying(app, rod(), at, Velocity::linear(velocity));
        if let Some(&parent) = chain.last() {
            let data = ball_joint();
            let mut entity = app.world_mut().entity_mut(rod);
            if multibody {
                entity.insert(MultibodyJoint::new(parent, data));
            } else {
                entity.insert(ImpulseJoint::new(parent, data));
            }
        }
        chain.push(rod);
    }
    chain
}

/// Largest distance between the two anchors of a joint.
fn torn(app: &mut App, chain: &[Entity]) -> f32 {
    let gaps = chain.windows(2).map(|pair| {
        let [a, b] = [(pair[0], 1.0), (pair[1], -1.0)]
            .map(|(rod, side)| rigid(app, rod).position() * (Vec3::X * side * (HALF + 0.06)));
        a.distance(b)
    });
    gaps.fold(0.0, f32::max)
}

#[test]
fn a_chain_that_hits_a_wall_holds_together() {
    for speed in [10.0, 100.0, 300.0] {
        for turn in [0.0, 0.8, 1.5] {
            let mut app = app();
            app.world_mut().spawn((StaticObb::new(0.05, 900.0, 900.0), Transform::from_xyz(8.0, 0.0, 0.0)));
            let turn = Quat::from_rotation_z(turn);
            let chain = spawn_chain(&mut app, 4, turn, Vec3::X * speed, false);
            let (mut worst, mut stops) = (0.0f32, 0);
            for _ in 0..120 {
                app.update();
                worst = worst.max(torn(&mut app, &chain));
                stops += app.world().resource::<MedialStep>().output.stops.len();
                for &rod in &chain {
                    let x = position(&mut app, rod).x;
                    assert!(x < 8.0, "{speed} m/s, {turn}: {x}");
                }
            }
            assert!(worst < 0.25 && torn(&mut app, &chain) < 0.05, "{speed} m/s, {turn}: torn by {worst} m");
            assert!(stops >= 4);
        }
    }
}

#[test]
fn links_of_a_multibody_collide_except_with_neighbours() {
    let mut app = app();
    spawn_ground(&mut app);
    let base = app.world_mut().spawn((RigidBody::Fixed, Transform::from_xyz(0.0, 1.2, 0.0))).id();
    let mut parent = base;
    let mut links = Vec::new();
    for i in 0..3 {
        let at = Transform::from_xyz(0.36 + 0.72 * i as f32, 1.2, 0.0);
        let link = spawn_body(&mut app, rod(), at);
        let anchor = if i == 0 { Vec3::ZERO } else { Vec3::X * 0.36 };
        let joint: TypedJoint =
            RevoluteJointBuilder::new(Vec3::Z).local_anchor1(anchor).local_anchor2(Vec3::X * -0.36).into();
        app.world_mut().entity_mut(link).insert(MultibodyJoint::new(parent, joint));
        links.push(link);
        parent = link;
    }
    let mut record = Record::default();
    for _ in 0..240 {
        record.run(&mut app, 1);
        for &link in &links {
            let pose = *rigid(&mut app, link).position();
            for end in [-HALF, HALF] {
                let height = (pose * (Vec3::X * end)).y;
                assert!(height > 0.0, "an end of {link} is at {height}");
            }
            assert!(pose.translation.is_finite());
        }
    }
    assert!(links.iter().any(|&link| record.started.iter().any(|(_, m)| m.entity1 == link || m.entity2 == link)));
    assert!(rigid(&mut app, links[2]).linvel().length() < 1.0);
}

#[test]
fn a_link_is_not_stopped_with_a_body_jointed_to_it() {
    let mut app = app();
    app.world_mut().spawn((StaticObb::new(0.05, 90.0, 90.0), Transform::from_xyz(4.0, 0.0, 0.0)));
    let velocity = Vec3::X * 100.0;
    let links = spawn_chain(&mut app, 2, Quat::IDENTITY, velocity, true);
    let at = Transform::from_xyz(4.0 * (HALF + 0.06), 0.0, 0.0);
    let sword = spawn_flying(&mut app, rod(), at, Velocity::linear(velocity));
    app.world_mut().entity_mut(sword).insert(ImpulseJoint::new(links[1], ball_joint()));
    let mut stopped = Vec::new();
    for _ in 0..10 {
        app.update();
        let step = app.world().resource::<MedialStep>();
        stopped.extend(step.output.stops.iter().map(|stop| step.info(Side::Body(stop.body)).entity));
    }
    assert!(stopped.contains(&sword), "the sword does not reach the wall");
    assert!(!links.iter().any(|link| stopped.contains(link)), "{links:?} among {stopped:?}");
}
