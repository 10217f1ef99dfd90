//! Contact events: messages report the contacts of all bodies, an observer those of one body. A rubber ring jumps off every body that it touches.
//!
//! ```text
//! cargo run --release --example events
//! ```

mod common;

use bevy::prelude::*;
use bevy_medial::{medial_axis::MedialAxis, prelude::*};
use bevy_rapier3d::prelude::{RigidBody, Velocity};
use common::stage::Stage;

fn main() -> AppExit {
    App::new()
        .add_plugins((Stage { steps: 240 }, MedialPhysicsPlugins::default()))
        .add_systems(Startup, setup)
        .add_systems(Last, (report_started, report_ended))
        .run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>, mut axes: ResMut<Assets<MedialAxis>>) -> Result {
    commands.spawn((Name::new("ground"), StaticObb::new(10.0, 0.5, 10.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    commands.spawn((
        Name::new("bear"),
        RigidBody::Dynamic,
        MedialMesh(assets.load("models/bear.medial")),
        Transform::from_xyz(0.0, 1.5, 0.0),
    ));
    let ring = axes.add(MedialAxis::torus(0.4, 0.1, 16)?);
    commands
        .spawn((
            Name::new("ring"),
            RigidBody::Dynamic,
            MedialMesh(ring),
            Transform::from_xyz(1.5, 2.5, 0.0),
            Velocity::zero(),
        ))
        .observe(jump);
    Ok(())
}

/// In an observer, `entity1` is the observed entity, and the normal points away from it. Changes take effect in the next step.
fn jump(hit: On<MedialContactStarted>, mut bodies: Query<&mut Velocity>) {
    if let Ok(mut velocity) = bodies.get_mut(hit.entity1) {
        velocity.linear -= hit.touch.normal * (1.8 * hit.touch.approach_speed);
    }
}

/// An entity of a message may be despawned before the message is read.
fn report_started(mut started: MessageReader<MedialContactStarted>, names: Query<NameOrEntity>) {
    for MedialContactStarted { entity1, entity2, touch, .. } in started.read() {
        if let [Ok(name1), Ok(name2)] = [entity1, entity2].map(|entity| names.get(*entity)) {
            let (point, speed) = (touch.point, touch.approach_speed);
            println!("{name1} touches {name2} at {point:.2}, closing in at {speed:.1} m/s");
        }
    }
}

fn report_ended(mut ended: MessageReader<MedialContactEnded>, names: Query<NameOrEntity>) {
    for MedialContactEnded { entity1, entity2, .. } in ended.read() {
        if let [Ok(name1), Ok(name2)] = [entity1, entity2].map(|entity| names.get(*entity)) {
            println!("{name1} leaves {name2}");
        }
    }
}
