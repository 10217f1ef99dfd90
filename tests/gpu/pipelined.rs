//! Where the GPU looks ahead and nobody waits for it, steps end as on the CPU, to the bit.

use std::time::Duration;

use bevy::{
    app::PluginsState, camera::CameraPlugin, diagnostic::DiagnosticsPlugin, mesh::MeshPlugin, prelude::*,
    render::RenderPlugin, time::TimeUpdateStrategy, window::ExitCondition,
};
use bevy_medial::{
    prelude::*,
    scenes::{Scene, lift_speed_limits},
};
use bevy_rapier3d::prelude::TimestepMode;

use crate::{common::models, device, faults::assert_same};

/// An app with a renderer that draws nothing.
fn rendering_app(scene: &str, backend: MedialBackend) -> App {
    let dt = 1.0 / 60.0;
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() },
        AssetPlugin::default(),
        RenderPlugin { synchronous_pipeline_compilation: true, ..default() },
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        TransformPlugin,
        DiagnosticsPlugin,
        MedialPhysicsPlugin::default(),
    ))
    .insert_resource(MedialSettings { backend, pipelined: true, ..default() })
    .insert_resource(TimestepMode::Fixed { dt, substeps: 1 })
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(dt)));
    lift_speed_limits(&mut app);
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    Scene::by_name(scene).unwrap().spawn(app.world_mut(), models(), 1);
    app
}

#[test]
fn looking_ahead_loses_nothing() {
    if device().is_none() {
        return;
    }
    for (scene, steps) in [("tori", 240), ("rods", 240), ("dinosaur", 60), ("bullets", 60)] {
        let [mut cpu, mut gpu] = [MedialBackend::Cpu, MedialBackend::Gpu].map(|backend| rendering_app(scene, backend));
        let mut latencies = [0; 5];
        let mut contacts = 0;
        for step in 0..steps {
            cpu.update();
            gpu.update();
            assert_same(&cpu, &gpu, &format!("{scene}, step {step}"));
            let step = gpu.world().resource::<MedialStep>();
            latencies[step.gpu_latency.unwrap_or(0) as usize] += 1;
            contacts += step.output.counts.contacts;
        }
        println!("{scene}: steps by the CPU, and with answers 1 to 4 steps late {latencies:?}; {contacts} contacts");
        assert!(latencies[0] < steps / 2 && contacts > 100);
    }
}
