//! Switches of a running scene. This module handles their keys, and the panel their buttons.

use bevy::prelude::*;
use bevy_medial::{
    plugin::MedialGizmos,
    prelude::*,
    scenes::{Monitor, SCENES, SceneEntity},
};
use bevy_rapier3d::prelude::RapierConfiguration;

use crate::view::{Show, start};

/// Budgets to choose from, in percent.
const BUDGETS: [f32; 6] = [0.0, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Back ends to choose from, and whether they look ahead.
const BACKENDS: [(MedialBackend, bool); 4] = [
    (MedialBackend::Auto, false),
    (MedialBackend::Cpu, false),
    (MedialBackend::Gpu, false),
    (MedialBackend::Gpu, true),
];
/// Speeds to choose from, relative to real time.
const SPEEDS: [f32; 3] = [1.0, 0.25, 0.0625];

/// A switch.
#[derive(Event, Component, Clone, Copy, Debug, PartialEq)]
pub enum Switch {
    Pause,
    Step,
    Speed,
    Restart,
    Scene,
    Backend,
    Culling,
    Budget,
    Level,
    Gizmos,
    Levels,
    Layer(usize),
}

/// All switches with their keys.
pub const SWITCHES: [(Switch, KeyCode, &str); 20] = [
    (Switch::Pause, KeyCode::Space, "space"),
    (Switch::Step, KeyCode::KeyN, "N"),
    (Switch::Speed, KeyCode::KeyT, "T"),
    (Switch::Restart, KeyCode::KeyR, "R"),
    (Switch::Scene, KeyCode::Tab, "tab"),
    (Switch::Backend, KeyCode::KeyB, "B"),
    (Switch::Culling, KeyCode::KeyC, "C"),
    (Switch::Budget, KeyCode::KeyE, "E"),
    (Switch::Level, KeyCode::KeyD, "D"),
    (Switch::Gizmos, KeyCode::KeyG, "G"),
    (Switch::Levels, KeyCode::KeyL, "L"),
    (Switch::Layer(0), KeyCode::Digit1, "1"),
    (Switch::Layer(1), KeyCode::Digit2, "2"),
    (Switch::Layer(2), KeyCode::Digit3, "3"),
    (Switch::Layer(3), KeyCode::Digit4, "4"),
    (Switch::Layer(4), KeyCode::Digit5, "5"),
    (Switch::Layer(5), KeyCode::Digit6, "6"),
    (Switch::Layer(6), KeyCode::Digit7, "7"),
    (Switch::Layer(7), KeyCode::Digit8, "8"),
    (Switch::Layer(8), KeyCode::Digit9, "9"),
];

/// The clock of the simulation.
#[derive(Resource)]
pub struct Clock {
    pub paused: bool,
    /// Speed relative to real time.
    pub speed: f32,
    single_steps: u32,
    /// Seconds of simulated time that are due and not yet stepped.
    owed: f32,
}

impl Default for Clock {
    fn default() -> Self {
        Self { paused: false, speed: SPEEDS[0], single_steps: 0, owed: 0.0 }
    }
}

pub fn plugin(app: &mut App) {
    app.init_resource::<Clock>().add_observer(switch).add_systems(Update, (press_keys, run_clock).chain());
}

fn press_keys(mut commands: Commands, keys: Res<ButtonInput<KeyCode>>) {
    for (switch, key, _) in SWITCHES {
        if keys.just_pressed(key) {
            commands.trigger(switch);
        }
    }
}

/// The choice after the current one. The first follows the last.
fn next<T: Copy + PartialEq>(choices: &[T], current: T) -> T {
    let at = choices.iter().position(|choice| *choice == current).map_or(0, |at| at + 1);
    choices[at % choices.len()]
}

fn switch(
    switch: On<Switch>,
    mut commands: Commands,
    mut show: ResMut<Show>,
    mut clock: ResMut<Clock>,
    mut settings: ResMut<MedialSettings>,
    mut store: ResMut<GizmoConfigStore>,
) {
    let (group, layers) = store.config_mut::<MedialGizmos>();
    match *switch {
        Switch::Pause => clock.paused = !clock.paused,
        Switch::Step => {
            clock.paused = true;
            clock.single_steps += 1;
        }
        Switch::Speed => clock.speed = next(&SPEEDS, clock.speed),
        Switch::Restart => {
            commands.queue(restart);
            // One step shows the new scene even if the clock is paused.
            clock.single_steps += 1;
        }
        Switch::Scene => {
            let at = SCENES.iter().position(|scene| scene.name == show.scene.name).map_or(0, |at| at + 1);
            show.scene = &SCENES[at % SCENES.len()];
            commands.queue(restart);
            clock.single_steps += 1;
        }
        Switch::Backend => {
            (settings.backend, settings.pipelined) = next(&BACKENDS, (settings.backend, settings.pipelined));
        }
        Switch::Culling => settings.brute_force = !settings.brute_force,
        Switch::Budget => show.budget_percent = next(&BUDGETS, show.budget_percent),
        Switch::Level => {
            let coarsest = show.models.iter().map(|model| model.axis.coarser().len()).max().unwrap_or(0);
            show.level = match show.level {
                None => Some(0),
                Some(level) => Some(level + 1).filter(|level| *level <= coarsest),
            };
        }
        Switch::Gizmos => group.enabled = !group.enabled,
        Switch::Levels => layers.color_by_level = !layers.color_by_level,
        Switch::Layer(number) => {
            if let Some((_, layer)) = layers.layers_mut().into_iter().nth(number) {
                layer.enabled = !layer.enabled;
            }
        }
    }
}

fn restart(world: &mut World) {
    let spawned: Vec<Entity> = world.query_filtered::<Entity, With<SceneEntity>>().iter(world).collect();
    for entity in spawned {
        world.despawn(entity);
    }
    world.insert_resource(Monitor::default());
    start(world);
}

/// Enables a step of rapier if one is due. There is at most one step per frame.
fn run_clock(mut clock: ResMut<Clock>, time: Res<Time>, show: Res<Show>, mut rapier: Query<&mut RapierConfiguration>) {
    let is_single = clock.single_steps > 0;
    clock.single_steps = clock.single_steps.saturating_sub(1);
    if !clock.paused {
        // At most one step is due, so a slow machine does not catch up.
        clock.owed = (clock.owed + time.delta_secs() * clock.speed).min(show.dt);
    }
    // The tolerance of 5 % prevents skipped steps if the frame rate of a display of 60 Hz varies a little.
    let is_due = !clock.paused && clock.owed >= 0.95 * show.dt;
    if is_due {
        clock.owed -= show.dt;
    }
    for mut rapier in &mut rapier {
        rapier.physics_pipeline_active = is_due || is_single;
    }
}

/// The text of a switch, and true if its button is lit.
pub fn label(
    switch: Switch,
    show: &Show,
    clock: &Clock,
    settings: &MedialSettings,
    store: &GizmoConfigStore,
) -> (String, bool) {
    let (group, layers) = store.config::<MedialGizmos>();
    match switch {
        Switch::Pause => (if clock.paused { "run" } else { "pause" }.into(), clock.paused),
        Switch::Step => ("one step".into(), false),
        Switch::Speed => (format!("speed 1/{}", 1.0 / clock.speed), clock.speed != 1.0),
        Switch::Restart => ("restart".into(), false),
        Switch::Scene => (format!("scene: {}", show.scene.name), false),
        Switch::Backend => {
            let ahead = if settings.pipelined { ", ahead" } else { "" };
            (format!("back end: {:?}{ahead}", settings.backend).to_lowercase(), settings.pipelined)
        }
        Switch::Culling => (format!("culling: {}", if settings.brute_force { "none" } else { "hybrid" }), false),
        Switch::Budget => (format!("budget: {} %", show.budget_percent), false),
        Switch::Level => match show.level {
            None => ("level: by budget".into(), false),
            Some(level) => (format!("level: {level}"), true),
        },
        Switch::Gizmos => ("debug view".into(), group.enabled),
        Switch::Levels => ("by level".into(), layers.color_by_level),
        Switch::Layer(number) => match layers.clone().layers_mut().into_iter().nth(number) {
            Some((name, layer)) => (name.into(), layer.enabled),
            None => (String::new(), false),
        },
    }
}

#[cfg(test)]
mod tests {
    use bevy_medial::{
        medial_axis::MedialAxis,
        scenes::{Model, Scene},
    };

    use super::*;

    #[test]
    fn switches_of_level_and_back_end_go_around() {
        let ring = |segments| MedialAxis::torus(1.0, 0.2, segments).unwrap();
        let axis = ring(24).with_coarser(vec![(ring(12), 0.1), (ring(6), 0.2)]);
        let mut app = App::new();
        app.add_plugins(plugin).init_resource::<MedialSettings>().init_resource::<GizmoConfigStore>();
        app.world_mut().resource_mut::<GizmoConfigStore>().insert(default(), MedialGizmos::default());
        app.insert_resource(Show {
            scene: Scene::by_name("rods").unwrap(),
            models: vec![Model { name: "ring".into(), axis }],
            seed: 1,
            dt: 1.0 / 60.0,
            backend: MedialBackend::Auto,
            budget_percent: 1.0,
            level: None,
            folder: default(),
            overlay: false,
            layers: Vec::new(),
        });
        let mut levels = Vec::new();
        let mut back_ends = Vec::new();
        for _ in 0..5 {
            let world = app.world_mut();
            levels.push(world.resource::<Show>().level);
            let settings = world.resource::<MedialSettings>();
            back_ends.push((settings.backend, settings.pipelined));
            world.trigger(Switch::Level);
            world.trigger(Switch::Backend);
        }
        assert_eq!(levels, [None, Some(0), Some(1), Some(2), None]);
        assert_eq!(back_ends[..4], BACKENDS);
        assert_eq!(back_ends[4], BACKENDS[0]);
    }
}
