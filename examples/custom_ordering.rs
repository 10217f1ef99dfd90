//! Systems of an app around a step: wind before the step, a list of the impacts within it, and a reaction after it.
//!
//! ```text
//! cargo run --release --example custom_ordering
//! ```

mod common;

use bevy::prelude::*;
use bevy_medial::prelude::*;
use bevy_rapier3d::prelude::{PhysicsSet, RigidBody, TimestepMode, Velocity};
use common::stage::Stage;

fn main() -> AppExit {
    App::new()
        .add_plugins((Stage { steps: 120 }, MedialPhysicsPlugins::default().in_fixed_schedule()))
        .insert_resource(Time::<Fixed>::from_hz(60.0))
        .insert_resource(TimestepMode::Fixed { dt: 1.0 / 60.0, substeps: 1 })
        .add_systems(Startup, setup)
        .add_systems(
            FixedUpdate,
            (
                // Rapier reads transforms, velocities and forces in this set. Changes made before it take effect in this step.
                blow.before(PhysicsSet::SyncBackend),
                // Impacts, contacts and stops are known, but transforms are not yet written. In a frame without a step, `MedialStep` holds the previous step.
                report_impacts
                    .run_if(resource_changed::<MedialStep>)
                    .after(MedialSystems::Detect)
                    .before(PhysicsSet::Writeback),
                // Transforms and velocities are those of the end of the step, and messages are written. Systems that despawn bodies belong here,
                // because rapier writes its results to the bodies before.
                bring_back.after(MedialSystems::Report),
            ),
        )
        .run()
}

/// Marks a body that the wind accelerates.
#[derive(Component)]
struct InTheWind;

fn setup(mut commands: Commands, assets: Res<AssetServer>) {
    commands.spawn((Name::new("ground"), StaticObb::new(3.0, 0.5, 3.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    commands.spawn((
        Name::new("spider"),
        InTheWind,
        RigidBody::Dynamic,
        MedialMesh(assets.load("models/spider.medial")),
        Velocity::zero(),
        Transform::from_xyz(0.0, 2.0, 0.0),
    ));
}

fn blow(time: Res<Time>, mut bodies: Query<&mut Velocity, With<InTheWind>>) {
    for mut velocity in &mut bodies {
        let acceleration = 8.0 + 4.0 * (3.0 * time.elapsed_secs()).sin();
        velocity.linear.x += acceleration * time.delta_secs();
    }
}

fn report_impacts(step: Res<MedialStep>, names: Query<NameOrEntity>) {
    for pair in &step.output.pairs {
        let Some(impact) = pair.impact else { continue };
        if let [Ok(name1), Ok(name2)] = [pair.first, pair.second].map(|side| names.get(step.info(side).entity)) {
            println!("{name1} hits {name2} {:.0} % into the step, at {:.2}", impact.fraction * 100.0, impact.point);
        }
    }
}

fn bring_back(mut bodies: Query<(&Name, &mut Transform), With<InTheWind>>) {
    for (name, mut transform) in &mut bodies {
        if transform.translation.y < -2.0 {
            println!("{name} has been blown off the ground and is put back");
            transform.translation = Vec3::Y * 2.0;
        }
    }
}
