//! An app with a renderer that draws nothing, for culling on the GPU ahead of the steps.

use std::time::Duration;

use bevy::{
    app::PluginsState,
    camera::CameraPlugin,
    diagnostic::DiagnosticsPlugin,
    mesh::MeshPlugin,
    prelude::*,
    render::{RenderPlugin, settings::WgpuSettings},
    time::TimeUpdateStrategy,
    window::ExitCondition,
};
use bevy_medial::{prelude::*, scenes::lift_speed_limits};
use bevy_rapier3d::prelude::TimestepMode;

/// An app with this crate's plugin. Each update is a step of `dt` seconds.
pub fn rendering_app(dt: f32) -> App {
    rendering_app_with(dt, WgpuSettings::default())
}

/// The same with settings for the device.
pub fn rendering_app_with(dt: f32, device: WgpuSettings) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() },
        AssetPlugin::default(),
        RenderPlugin { render_creation: device.into(), synchronous_pipeline_compilation: true, ..default() },
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        TransformPlugin,
        DiagnosticsPlugin,
        MedialPhysicsPlugins::default(),
    ))
    .insert_resource(TimestepMode::Fixed { dt, substeps: 1 })
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f32(dt)));
    lift_speed_limits(&mut app);
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    app
}
