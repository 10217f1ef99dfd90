//! A bear tumbles down stairs that the app builds from static boxes.
//!
//! ```text
//! cargo run --release --example minimal
//! ```

mod common;

use bevy::prelude::*;
use bevy_medial::prelude::*;
use bevy_rapier3d::prelude::{RigidBody, Velocity};
use common::stage::Stage;

fn main() -> AppExit {
    // `Stage` adds `DefaultPlugins`, a camera and a light.
    App::new().add_plugins((Stage { steps: 300 }, MedialPhysicsPlugins::default())).add_systems(Startup, setup).run()
}

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((Name::new("ground"), StaticObb::new(10.0, 0.5, 10.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    for i in 0..6 {
        let half_height = 0.15 * (6 - i) as f32;
        let place = Transform::from_xyz(i as f32 * 0.6 - 2.4, half_height, 0.0);
        commands.spawn((StaticObb::new(0.3, half_height, 1.5), place));
    }
    commands.spawn((
        Name::new("bear"),
        RigidBody::Dynamic,
        MedialMesh(assets.load("models/bear.medial")),
        Transform::from_xyz(-2.4, 3.0, 0.0),
        Velocity { linear: Vec3::X, angular: Vec3::new(0.0, 1.0, -6.0) },
    ));
}
