//! Buttons for all switches.

use bevy::{prelude::*, ui::Pressed};
use bevy_medial::prelude::*;

use crate::{
    common::button::{button, shade},
    control::{Clock, SWITCHES, Switch, label},
    view::Show,
};

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn).add_systems(Update, relabel);
}

fn spawn(mut commands: Commands) {
    let column = Node {
        position_type: PositionType::Absolute,
        top: px(8),
        right: px(8),
        width: px(180),
        flex_direction: FlexDirection::Column,
        row_gap: px(3),
        ..default()
    };
    let panel = commands.spawn(column).id();
    for (switch, ..) in SWITCHES {
        commands.spawn((switch, button(switch), ChildOf(panel)));
    }
}

/// Updates the texts and colours of the buttons.
fn relabel(
    show: Res<Show>,
    clock: Res<Clock>,
    settings: Res<MedialSettings>,
    store: Res<GizmoConfigStore>,
    mut buttons: Query<(&Switch, &Children, &mut BackgroundColor, Has<Pressed>)>,
    mut texts: Query<&mut Text>,
) {
    for (switch, children, mut background, is_pressed) in &mut buttons {
        let (what, is_on) = label(*switch, &show, &clock, &settings, &store);
        let key = SWITCHES.iter().find(|(other, ..)| other == switch).map_or("", |(.., key)| key);
        background.set_if_neq(shade(is_on, is_pressed));
        for &child in children {
            if let Ok(mut text) = texts.get_mut(child) {
                text.set_if_neq(Text(format!("{what}  [{key}]")));
            }
        }
    }
}
