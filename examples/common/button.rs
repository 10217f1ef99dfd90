//! A button with a text label.

use bevy::{
    prelude::*,
    ui_widgets::{Activate, Button, observe},
};

const IDLE: Color = Color::srgba(0.1, 0.12, 0.15, 0.75);
const LIT: Color = Color::srgba(0.1, 0.4, 0.55, 0.9);
const DOWN: Color = Color::srgba(0.3, 0.6, 0.75, 0.9);

/// A button that triggers an event when it is pressed. Its only child is its text.
pub fn button<E>(event: E) -> impl Bundle
where
    E: Event + Copy,
    for<'a> E::Trigger<'a>: Default,
{
    (
        Button,
        Node { padding: UiRect::axes(px(8), px(3)), ..default() },
        BackgroundColor(IDLE),
        observe(move |_: On<Activate>, mut commands: Commands| commands.trigger(event)),
        children![(Text::default(), TextFont::from_font_size(12.0))],
    )
}

/// The background of a button.
pub fn shade(is_on: bool, is_pressed: bool) -> BackgroundColor {
    BackgroundColor(if is_pressed {
        DOWN
    } else if is_on {
        LIT
    } else {
        IDLE
    })
}
