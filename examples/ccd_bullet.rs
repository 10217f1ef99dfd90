//! Two rings fly at 200 m/s, more than 3 m per step, at a wall of 2 cm. One stops at its impact. The other has `MedialCcd` disabled, and passes through.
//!
//! ```text
//! cargo run --release --example ccd_bullet
//! ```

mod common;

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{GravityScale, RigidBody, Velocity};
use common::stage::Stage;

/// Position of the wall along x, in metres.
const WALL: f32 = 2.0;

fn main() -> AppExit {
    App::new()
        .add_plugins((Stage { steps: 30 }, MedialPhysicsPlugins::default()))
        .add_systems(Startup, setup)
        .add_systems(Last, report_once_passed)
        .run()
}

fn setup(mut commands: Commands, mut axes: ResMut<Assets<MedialAxis>>) -> Result {
    commands.spawn((StaticObb::new(0.01, 4.0, 4.0), Transform::from_xyz(WALL, 1.0, 0.0)));
    let ring = MedialMesh(axes.add(MedialAxis::torus(0.6, 0.15, 16)?));
    for (name, z, enabled) in [("ring", -1.5, true), ("ring without MedialCcd", 1.5, false)] {
        commands
            .spawn((
                Name::new(name),
                RigidBody::Dynamic,
                ring.clone(),
                Transform::from_xyz(-6.0, 1.0, z),
                Velocity::linear(Vec3::X * 200.0),
                GravityScale(0.0),
                // Stops are also enabled without this component.
                MedialCcd { enabled, ..default() },
            ))
            .observe(report_impact);
    }
    Ok(())
}

fn report_impact(hit: On<MedialContactStarted>, names: Query<&Name>) {
    let touch = &hit.touch;
    if let Ok(name) = names.get(hit.entity1) {
        println!("{name} hits at x = {:.3}, {:.0} % into the step", touch.point.x, touch.fraction * 100.0);
    }
}

fn report_once_passed(bodies: Query<(Entity, &Name, &Transform), With<MedialMesh>>, mut logged: Local<Vec<Entity>>) {
    for (entity, name, transform) in &bodies {
        if transform.translation.x > WALL + 2.0 && !logged.contains(&entity) {
            println!("{name} is behind the wall");
            logged.push(entity);
        }
    }
}
