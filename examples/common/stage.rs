//! `DefaultPlugins` for the small programs, with a camera, a light, and a mode without a display.

use std::{path::Path, time::Duration};

use bevy::{
    app::ScheduleRunnerPlugin,
    light::GlobalAmbientLight,
    log::LogPlugin,
    prelude::*,
    render::{RenderPlugin, settings::WgpuSettings},
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_medial::prelude::*;

use super::{display::has_display, dress::Dress};

/// Length of a step without a display.
const STEP: Duration = Duration::from_micros(16_667);
/// Max number of frames until all bodies are loaded. After that, the program fails: a file probably does not load.
const PATIENCE: u32 = 2_000;

/// `DefaultPlugins` with a view of the scene. Without a display there is no window and no renderer. The app then prints the positions of the bodies
/// after `steps` steps, and exits.
pub struct Stage {
    pub steps: u32,
}

impl Plugin for Stage {
    fn build(&self, app: &mut App) {
        if has_display() {
            app.add_plugins(DefaultPlugins);
        } else {
            let no_renderer = WgpuSettings { backends: None, ..default() };
            app.add_plugins(
                DefaultPlugins
                    .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
                    .set(RenderPlugin { render_creation: no_renderer.into(), ..default() })
                    // Warnings about the missing renderer are expected.
                    .set(LogPlugin { filter: "warn,bevy_render=off,bevy_gizmos_render=off".into(), ..default() })
                    .disable::<WinitPlugin>(),
            )
            // A pause of 1 ms per frame leaves time for files to load.
            .add_plugins(ScheduleRunnerPlugin::run_loop(Duration::from_millis(1)))
            .insert_resource(TimeUpdateStrategy::ManualDuration(STEP))
            .insert_resource(StepsLeft { steps: self.steps, patience: PATIENCE })
            .add_systems(Last, count_down);
        }
        app.add_plugins(Dress { models: Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models") })
            .insert_resource(GlobalAmbientLight { brightness: 350.0, ..default() })
            .add_systems(Startup, light_up);
    }
}

fn light_up(mut commands: Commands) {
    let looking = |x: f32, y: f32, z: f32| Transform::from_xyz(x, y, z).looking_at(Vec3::Y, Vec3::Y);
    commands.spawn((Camera3d::default(), looking(4.0, 4.0, 8.0)));
    commands.spawn((DirectionalLight { shadow_maps_enabled: true, ..default() }, looking(4.0, 9.0, 5.0)));
}

#[derive(Resource)]
struct StepsLeft {
    steps: u32,
    patience: u32,
}

fn count_down(
    mut left: ResMut<StepsLeft>,
    step: Res<MedialStep>,
    bodies: Query<(NameOrEntity, &Transform), With<MedialMesh>>,
    loading: Query<(), (With<MedialMesh>, Without<MedialLevel>)>,
    mut exit: MessageWriter<AppExit>,
) {
    if left.steps == 0 {
        for (name, transform) in &bodies {
            println!("{name} is at {:.2}", transform.translation);
        }
        exit.write(AppExit::Success);
    } else if loading.is_empty() && !step.input.bodies.is_empty() {
        left.steps -= 1;
    } else if left.patience == 0 {
        eprintln!("error: some bodies did not load in time");
        exit.write(AppExit::error());
    } else {
        left.patience -= 1;
    }
}
