//! Updates of an app with medial physics beside those of an app with rapier alone.

use std::{
    path::Path,
    time::{Duration, Instant},
};

use bevy::{diagnostic::DiagnosticsPlugin, prelude::*, time::TimeUpdateStrategy};
use bevy_medial::{builder::load::load, prelude::*};
use bevy_rapier3d::prelude::*;

/// Length of a step in seconds.
const DT: f32 = 1.0 / 60.0;

/// Bodies of rapier's own shapes: sum of the times of all updates, and mean of the last ones, in milliseconds. Each for an app without and with
/// `MedialPhysicsPlugins`.
pub struct Own {
    pub sums_ms: [f64; 2],
    pub last_ms: [f64; 2],
}

/// Updates at the end whose mean is taken.
const LAST: usize = 30;

/// Bears as convex decompositions of rapier, no medial body, fall into a bin.
///
/// # Errors
/// If the mesh cannot be read.
pub fn own_shapes(bodies: usize, steps: usize) -> Result<Own, Box<dyn std::error::Error>> {
    let mesh = load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/models/bear.obj"))?;
    let scale = 1.0 / mesh.diagonal();
    let vertices: Vec<Vec3> = mesh.positions.iter().map(|&position| position * scale).collect();
    let shape = Collider::convex_decomposition(&vertices, &mesh.triangles);
    let apps = [false, true].map(|with_plugin| {
        let mut app = app(with_plugin);
        bin(app.world_mut(), 1.5);
        for index in 0..bodies {
            let cell = [index % 3, index / 9, index / 3 % 3].map(|i| i as f32);
            let place = (Vec3::from(cell) - Vec3::new(1.0, 0.0, 1.0)) * 0.9 + Vec3::Y;
            let turn = Quat::from_rotation_y(index as f32);
            let transform = Transform::from_translation(place).with_rotation(turn);
            app.world_mut().spawn((RigidBody::Dynamic, shape.clone(), transform));
        }
        app
    });
    let [sums_ms, last_ms] = alternately(apps, steps);
    Ok(Own { sums_ms, last_ms })
}

/// Mean time of an update with sleeping boxes, in milliseconds: rapier's cuboids without the plugin, and medial boxes.
pub fn sleeping(bodies: usize, steps: usize) -> Result<[f64; 2], Box<dyn std::error::Error>> {
    let half = Vec3::splat(0.25);
    let medial = MedialAxis::rounded_box(half, 0.05)?;
    let apps = [false, true].map(|is_medial| {
        let mut app = app(is_medial);
        let side = (bodies as f32).sqrt().ceil() as usize;
        let mesh = app.world_mut().get_resource_mut::<Assets<MedialAxis>>().map(|mut axes| axes.add(medial.clone()));
        let extent = side as f32;
        app.world_mut().spawn((Collider::cuboid(extent, 0.5, extent), Transform::from_xyz(0.0, -0.5, 0.0)));
        for index in 0..bodies {
            let cell = Vec3::new((index % side) as f32, half.y, (index / side) as f32);
            let place = Transform::from_translation(cell - Vec3::new(0.5, 0.0, 0.5) * extent);
            let mut body = app.world_mut().spawn((RigidBody::Dynamic, place));
            match &mesh {
                Some(mesh) if is_medial => body.insert(MedialMesh(mesh.clone())),
                _ => body.insert(Collider::cuboid(half.x, half.y, half.z)),
            };
        }
        app
    });
    Ok(alternately(apps, steps)[1])
}

/// An app without a window, with rapier alone or with medial physics.
fn app(with_plugin: bool) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin, DiagnosticsPlugin))
        .insert_resource(TimestepMode::Fixed { dt: DT, substeps: 1 })
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(DT)));
    if with_plugin {
        app.add_plugins(MedialPhysicsPlugins::default());
    } else {
        app.add_plugins(RapierPhysicsPlugin::<NoUserData>::default());
    }
    app.finish();
    app.cleanup();
    app
}

/// A floor and four walls.
fn bin(world: &mut World, half: f32) {
    world.spawn((Collider::cuboid(half + 1.0, 0.5, half + 1.0), Transform::from_xyz(0.0, -0.5, 0.0)));
    for side in [-1.0, 1.0] {
        let middle = side * (half + 0.25);
        world.spawn((Collider::cuboid(0.25, 20.0, half + 0.5), Transform::from_xyz(middle, 20.0, 0.0)));
        world.spawn((Collider::cuboid(half, 20.0, 0.25), Transform::from_xyz(0.0, 20.0, middle)));
    }
}

/// Updates both apps in turns. Returns the sums of the times in milliseconds, and the means of the last updates.
fn alternately(mut apps: [App; 2], steps: usize) -> [[f64; 2]; 2] {
    let (mut sums, mut last) = ([0.0; 2], [0.0; 2]);
    for step in 0..steps {
        for (i, app) in apps.iter_mut().enumerate() {
            let clock = Instant::now();
            app.update();
            let took = clock.elapsed().as_secs_f64() * 1e3;
            sums[i] += took;
            last[i] += if step + LAST >= steps { took / LAST as f64 } else { 0.0 };
        }
    }
    [sums, last]
}
