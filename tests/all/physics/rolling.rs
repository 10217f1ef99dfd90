//! Round bodies roll as far as rapier's own. A body that turns far in each step sinks in between two solves, and impacts there must not cost
//! time.

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::*;

use crate::common::*;

/// Seconds that bodies roll.
const SECONDS: f32 = 3.0;

/// Result of a rolling body.
struct Rolled {
    displacement: f32,
    /// Lowest and highest position of its centre relative to the start, in metres.
    heights: [f32; 2],
}

/// Rolls a body along x at a speed in metres per second, without slip at the start. `late`: the ground is older than the body in rapier, so the
/// normal of their contact turns with the ground and not with the body.
fn roll(body: impl FnOnce(&mut App) -> Entity, radius: f32, speed: f32, late: bool) -> Rolled {
    let mut app = app();
    app.world_mut().spawn((StaticObb::new(200.0, 0.5, 200.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    if late {
        run(&mut app, 2);
    }
    let velocity = Velocity { linear: Vec3::X * speed, angular: Vec3::Z * (-speed / radius) };
    let body = body(&mut app);
    app.world_mut().entity_mut(body).insert((velocity, Friction::coefficient(0.5)));
    let mut rolled = Rolled { displacement: 0.0, heights: [f32::MAX, f32::MIN] };
    for _ in 0..(SECONDS / DT) as u32 {
        run(&mut app, 1);
        let height = position(&mut app, body).y - radius;
        rolled.heights = [rolled.heights[0].min(height), rolled.heights[1].max(height)];
    }
    rolled.displacement = position(&mut app, body).x;
    rolled
}

#[test]
fn balls_and_rollers_roll_as_far_as_rapier_bodies() {
    let shapes = [
        ("ball", MedialAxis::sphere(0.15).unwrap(), Collider::ball(0.15), 0.15),
        (
            "roller",
            MedialAxis::capsule(Vec3::Z * -0.3, Vec3::Z * 0.3, 0.1).unwrap(),
            Collider::capsule_z(0.3, 0.1),
            0.1,
        ),
    ];
    for (name, axis, collider, radius) in shapes {
        for (speed, late) in [1.0, 3.0, 10.0, 30.0].into_iter().flat_map(|speed| [(speed, false), (speed, true)]) {
            let transform = Transform::from_xyz(0.0, radius, 0.0);
            let ours = roll(|app| spawn_body(app, axis.clone(), transform), radius, speed, late);
            let spawn = |app: &mut App| app.world_mut().spawn((RigidBody::Dynamic, collider.clone(), transform)).id();
            let rapiers = roll(spawn, radius, speed, late);
            println!(
                "{name} at {speed} m/s, late {late}: {:.2} m, rapier's {:.2}; height {:?}, rapier's {:?}",
                ours.displacement, rapiers.displacement, ours.heights, rapiers.heights
            );
            assert!(ours.displacement > 0.97 * rapiers.displacement && ours.displacement < 1.05 * SECONDS * speed);
            assert!(ours.heights[0] > rapiers.heights[0] - 1e-3 && ours.heights[1] < 0.01);
        }
    }
}

/// The tyre consists of 104 cones. At each corner the next cone touches down.
#[test]
fn a_tyre_of_many_cones_keeps_rolling() {
    let upright = Transform::from_xyz(0.0, 0.3, 0.0).with_rotation(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2));
    for speed in [5.0, 10.0, 30.0] {
        let tyre = MedialAxis::torus(0.25, 0.05, 104).unwrap();
        let rolled = roll(|app| spawn_body(app, tyre, upright), 0.3, speed, false);
        println!("{speed} m/s: {:.2} m, height {:?}", rolled.displacement, rolled.heights);
        assert!(rolled.displacement > 0.7 * SECONDS * speed && rolled.heights[0] > -0.01, "{:?}", rolled.heights);
    }
}
