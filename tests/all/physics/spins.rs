//! Bodies that turn by whole turns in a step, about an axis that changes within the step.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, plugin::MedialStep, scenes::Bullet};
use bevy_rapier3d::prelude::*;

use crate::common::*;

/// The remainder beyond whole turns may have any axis, so the end poses do not determine the motion.
#[test]
fn whole_turns_are_about_the_axis_of_the_spin() {
    let (mut by_poses, mut by_spin) = (0, 0);
    for i in 0..60 {
        let mut app = app();
        let spin = Velocity::angular(Vec3::X * (450.0 + i as f32));
        let ball = spawn_flying(&mut app, MedialAxis::sphere(0.2).unwrap(), Transform::default(), spin);
        // The torque adds some radians per second in each step, about another axis.
        let torque = Vec3::Y * if i % 2 == 0 { 0.0 } else { 0.16 };
        app.world_mut().entity_mut(ball).insert((Bullet, ExternalForce { torque, ..default() }));
        run(&mut app, 1);
        for _ in 0..4 {
            run(&mut app, 1);
            let body = rigid(&mut app, ball);
            let sweep = app.world().resource::<MedialStep>().input.bodies[0].sweep;
            let turn = body.angvel() * DT;
            // Rapier turns the body by slightly less.
            let astray = sweep.rotation.distance(turn);
            assert!(astray < 2.5, "{turn} but {}", sweep.rotation);
            assert!(body.position().rotation.angle_between(sweep.end.rotation) < 5e-3);
            *if astray < 1e-6 { &mut by_spin } else { &mut by_poses } += 1;
        }
    }
    println!("{by_poses} by their poses, {by_spin} by their spin");
    assert!(by_poses > 50 && by_spin > 20, "{by_poses} {by_spin}");
}
