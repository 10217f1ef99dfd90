//! A server without a window and a renderer. It runs sixty steps per second, and prints once a second the state that it would send to its clients.
//!
//! ```text
//! cargo run --release --example headless_server [SECONDS]
//! ```

use std::{env, time::Duration};

use bevy::{app::ScheduleRunnerPlugin, asset::AssetPlugin, diagnostic::DiagnosticsPlugin, log::LogPlugin, prelude::*};
use bevy_medial::prelude::*;
use bevy_rapier3d::prelude::{RigidBody, TimestepMode, Velocity};

const STEPS_PER_SECOND: f64 = 60.0;

fn main() -> AppExit {
    let seconds: u32 = env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(5);
    let frame = Duration::from_secs_f64(1.0 / STEPS_PER_SECOND);
    App::new()
        .add_plugins((
            MinimalPlugins.set(ScheduleRunnerPlugin::run_loop(frame)),
            LogPlugin::default(),
            AssetPlugin::default(),
            TransformPlugin,
            DiagnosticsPlugin,
            // Steps have a constant length, regardless of the time of a frame.
            MedialPhysicsPlugins::default().in_fixed_schedule(),
        ))
        .insert_resource(Time::<Fixed>::from_hz(STEPS_PER_SECOND))
        .insert_resource(TimestepMode::Fixed { dt: frame.as_secs_f32(), substeps: 1 })
        .insert_resource(SecondsLeft(seconds))
        .add_systems(Startup, setup)
        .add_systems(FixedLast, send)
        .run()
}

#[derive(Resource)]
struct SecondsLeft(u32);

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((StaticObb::new(10.0, 0.5, 10.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    for (i, name) in ["bear", "cow", "spider"].into_iter().enumerate() {
        commands.spawn((
            Name::new(name),
            RigidBody::Dynamic,
            MedialMesh(assets.load(format!("models/{name}.medial"))),
            Transform::from_xyz(i as f32 * 0.5, 2.0 + 1.5 * i as f32, 0.0),
            Velocity::zero(),
        ));
    }
}

fn send(
    mut steps: Local<u32>,
    mut left: ResMut<SecondsLeft>,
    step: Res<MedialStep>,
    bodies: Query<(&Name, &Transform, &Velocity)>,
    mut exit: MessageWriter<AppExit>,
) {
    *steps += 1;
    if !steps.is_multiple_of(STEPS_PER_SECOND as u32) {
        return;
    }
    println!("step {}: {} bodies, {:.2?} for collision", *steps, step.input.bodies.len(), step.output.times.total());
    for (name, transform, velocity) in &bodies {
        println!("  {name:6} at {:.2}, {:.2} m/s", transform.translation, velocity.linear.length());
    }
    left.0 = left.0.saturating_sub(1);
    if left.0 == 0 {
        exit.write(AppExit::Success);
    }
}
