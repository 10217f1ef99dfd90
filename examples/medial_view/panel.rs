//! Sliders, buttons, and a text with figures.

use bevy::{
    prelude::*,
    ui::Pressed,
    ui_widgets::{SliderRange, SliderValue, ValueChange, observe},
};
use bevy_medial::{geometry::Primitive, plugin::MedialGizmos};
use bevy_panorbit_camera::PanOrbitCamera;

use crate::{
    common::{
        button::{button, shade},
        slider::{place_thumbs, slider},
    },
    job::Job,
    shown::{self, Shown},
};

/// Upper end of the slider of the budget, in percent.
const MOST_BUDGET: f32 = 10.0;

/// The action of a button.
#[derive(Event, Component, Clone, Copy, PartialEq)]
enum Switch {
    Surface,
    Spheres,
    Cones,
    Slabs,
    Save,
}

/// The quantity that a slider sets.
#[derive(Component, Clone, Copy, PartialEq)]
enum Dial {
    Level,
    Budget,
}

#[derive(Component)]
struct Figures;

pub fn plugin(app: &mut App) {
    app.add_observer(switch)
        .add_systems(Startup, spawn)
        .add_systems(Update, (follow, relabel, write_figures, place_thumbs, leave_pointer));
}

fn text(content: &str) -> impl Bundle {
    (Text::new(content), TextFont::from_font_size(14.0), TextColor(Color::BLACK))
}

fn spawn(mut commands: Commands) {
    let column = |side: Node| Node {
        position_type: PositionType::Absolute,
        padding: UiRect::all(px(10)),
        flex_direction: FlexDirection::Column,
        row_gap: px(6),
        ..side
    };
    let turn = |dial: Dial| {
        observe(move |change: On<ValueChange<f32>>, mut shown: ResMut<Shown>| match dial {
            Dial::Level => shown.set_level(change.value.round() as usize),
            Dial::Budget => shown.set_budget(change.value),
        })
    };
    commands.spawn((
        column(Node { top: px(0), left: px(0), ..default() }),
        children![
            text("level of detail"),
            (Dial::Level, slider(SliderRange::new(0.0, 1.0), 0.0), turn(Dial::Level)),
            text("budget in percent"),
            (Dial::Budget, slider(SliderRange::new(0.0, MOST_BUDGET), 0.0), turn(Dial::Budget)),
            (Figures, text("")),
        ],
    ));
    let row = Node { flex_direction: FlexDirection::Row, column_gap: px(6), ..default() };
    let stops = (0..=16).map(|part| {
        let [r, g, b, _] = shown::shade(part as f32 / 16.0);
        ColorStop::auto(Color::linear_rgb(r, g, b))
    });
    let legend = BackgroundGradient::from(LinearGradient::to_right(stops.collect()));
    commands.spawn((
        column(Node { bottom: px(0), left: px(0), ..default() }),
        children![
            (
                row.clone(),
                children![
                    (Switch::Surface, button(Switch::Surface)),
                    (Switch::Spheres, button(Switch::Spheres)),
                    (Switch::Cones, button(Switch::Cones)),
                    (Switch::Slabs, button(Switch::Slabs)),
                    (Switch::Save, button(Switch::Save)),
                ]
            ),
            (
                row,
                children![
                    text("0"),
                    (Node { width: px(180), height: px(14), ..default() }, legend),
                    text("largest distance of a vertex"),
                ]
            ),
        ],
    ));
}

fn switch(switch: On<Switch>, mut shown: ResMut<Shown>, mut store: ResMut<GizmoConfigStore>) {
    let (_, layers) = store.config_mut::<MedialGizmos>();
    let flip = |on: &mut bool| *on = !*on;
    match *switch {
        Switch::Surface => flip(&mut shown.surface),
        Switch::Spheres => flip(&mut layers.spheres.enabled),
        Switch::Cones => flip(&mut layers.cones.enabled),
        Switch::Slabs => flip(&mut layers.slabs.enabled),
        Switch::Save => {
            let Some(levels) = &shown.levels else { return };
            shown.message = match levels.save(&shown.save_as) {
                Ok(()) => format!("saved as {}", shown.save_as.display()),
                Err(error) => error.to_string(),
            };
        }
    }
}

/// Moves the sliders to the level and the budget that are shown. Each slider changes both, and so does the end of a build.
fn follow(mut commands: Commands, shown: Res<Shown>, sliders: Query<(Entity, &Dial, &SliderRange, &SliderValue)>) {
    let most = shown.levels.as_ref().map_or(1, |levels| levels.levels.len().saturating_sub(1)) as f32;
    for (entity, dial, range, value) in &sliders {
        let (wanted, end) = match dial {
            Dial::Level => (shown.level as f32, most),
            Dial::Budget => (shown.budget.min(MOST_BUDGET), MOST_BUDGET),
        };
        let mut slider = commands.entity(entity);
        if range.end() != end {
            slider.insert(SliderRange::new(0.0, end));
        }
        if value.0 != wanted {
            slider.insert(SliderValue(wanted));
        }
    }
}

fn relabel(
    shown: Res<Shown>,
    store: Res<GizmoConfigStore>,
    mut buttons: Query<(&Switch, &Children, &mut BackgroundColor, Has<Pressed>)>,
    mut texts: Query<&mut Text>,
) {
    let (_, layers) = store.config::<MedialGizmos>();
    for (switch, children, mut background, is_pressed) in &mut buttons {
        let (what, is_on) = match switch {
            Switch::Surface => ("surface", shown.surface),
            Switch::Spheres => ("spheres", layers.spheres.enabled),
            Switch::Cones => ("cones", layers.cones.enabled),
            Switch::Slabs => ("slabs", layers.slabs.enabled),
            Switch::Save => ("save", false),
        };
        background.set_if_neq(shade(is_on, is_pressed));
        for &child in children {
            if let Ok(mut text) = texts.get_mut(child) {
                text.set_if_neq(Text(what.into()));
            }
        }
    }
}

fn write_figures(shown: Res<Shown>, job: Res<Job>, mut figures: Single<&mut Text, With<Figures>>) {
    let reported = match (shown.current(), &shown.levels) {
        (Some(level), Some(levels)) => {
            let count = |kind: fn(&Primitive) -> bool| level.axis.primitives().iter().filter(|p| kind(p)).count();
            let (to, from) = (level.error.mesh_to_envelope, level.error.envelope_to_mesh);
            format!(
                "level {} of {}\n{} spheres, {} cones, {} slabs\nmesh to shape: {:.2} %, mean {:.3} %\nshape to mesh: {:.2} %, mean \
                 {:.3} %\nvertices: up to {:.2} %",
                shown.level,
                levels.levels.len(),
                level.axis.spheres().len(),
                count(|primitive| matches!(primitive, Primitive::Cone(_))),
                count(|primitive| matches!(primitive, Primitive::Slab(_))),
                to.max,
                to.mean,
                from.max,
                from.mean,
                shown.worst,
            )
        }
        _ if shown.message.is_empty() => format!("building: {:.0} %", job.progress() * 100.0),
        _ => String::new(),
    };
    figures.set_if_neq(Text(format!("{reported}\n{}", shown.message)));
}

/// Disables the camera while a slider or a button is held.
fn leave_pointer(
    pressed: Query<(), With<Pressed>>,
    dragged: Query<&bevy::ui_widgets::SliderDragState>,
    mut camera: Single<&mut PanOrbitCamera>,
) {
    let is_free = pressed.is_empty() && !dragged.iter().any(|state| state.dragging);
    if camera.enabled != is_free {
        camera.enabled = is_free;
    }
}
