//! A slider whose thumb follows its value.

use bevy::{
    prelude::*,
    ui_widgets::{Slider, SliderRange, SliderThumb, SliderValue, TrackClick},
};

const THUMB: f32 = 14.0;

/// A slider. A drag triggers a `ValueChange<f32>`, and the owner of the slider sets its `SliderValue`.
pub fn slider(range: SliderRange, value: f32) -> impl Bundle {
    let rail = Node { height: px(6), width: percent(100), ..default() };
    // Shorter than the rail by the width of the thumb, because the position of the thumb is that of its left edge.
    let track = Node {
        position_type: PositionType::Absolute,
        left: px(0),
        right: px(THUMB),
        top: px(0),
        bottom: px(0),
        ..default()
    };
    let thumb = Node {
        width: px(THUMB),
        height: px(THUMB),
        position_type: PositionType::Absolute,
        border_radius: BorderRadius::MAX,
        ..default()
    };
    (
        Node { align_items: AlignItems::Center, height: px(THUMB), width: px(220), ..default() },
        Slider { track_click: TrackClick::Snap, ..default() },
        SliderValue(value),
        range,
        children![
            (rail, BackgroundColor(Color::srgb(0.3, 0.33, 0.38))),
            (track, children![(SliderThumb, thumb, BackgroundColor(Color::srgb(0.4, 0.75, 0.9)))]),
        ],
    )
}

/// Places the thumbs at the values of their sliders.
pub fn place_thumbs(
    sliders: Query<(Entity, &SliderValue, &SliderRange), Or<(Changed<SliderValue>, Changed<SliderRange>)>>,
    children: Query<&Children>,
    mut thumbs: Query<&mut Node, With<SliderThumb>>,
) {
    for (slider, value, range) in &sliders {
        for child in children.iter_descendants(slider) {
            if let Ok(mut thumb) = thumbs.get_mut(child) {
                thumb.left = percent(range.thumb_position(value.0) * 100.0);
            }
        }
    }
}
