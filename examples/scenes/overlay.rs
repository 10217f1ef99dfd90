//! Times and counts of the last step as text, and the times of many steps as a graph.

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_medial::{
    prelude::*,
    scenes::{Monitor, Row},
};

/// Size of the graph, in pixels. Each step has a column.
const SIZE: UVec2 = UVec2::new(240, 72);
const FIELD: [u8; 4] = [20, 24, 30, 190];
/// Part of the steps whose columns fit in the height of the graph. The others are cut.
const WITHIN: f64 = 0.97;

/// A stage: its name, its colour, and its time in milliseconds.
type Stage = (&'static str, [u8; 3], fn(&Row) -> f64);

/// All stages, in the order in which they are stacked.
const STAGES: [Stage; 6] = [
    ("response", [200, 200, 210], |row| row.response_ms),
    ("broad", [90, 160, 240], |row| row.broad_ms),
    ("mid", [80, 200, 160], |row| row.mid_ms),
    ("narrow", [240, 200, 70], |row| row.narrow_ms),
    ("stop", [240, 120, 60], |row| row.stop_ms),
    ("contacts", [220, 90, 190], |row| row.contact_search_ms),
];

/// A text with figures: the time of a stage, or all counts.
#[derive(Component, Clone, Copy)]
enum Figure {
    Stage(usize),
    Counts,
}

#[derive(Component)]
struct Graph;

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn).add_systems(Update, (write_figures, draw_graph));
}

fn spawn(mut commands: Commands, mut images: ResMut<Assets<Image>>) {
    let size = Extent3d { width: SIZE.x, height: SIZE.y, depth_or_array_layers: 1 };
    let usages = RenderAssetUsages::MAIN_WORLD | RenderAssetUsages::RENDER_WORLD;
    let image = Image::new_fill(size, TextureDimension::D2, &FIELD, TextureFormat::Rgba8UnormSrgb, usages);
    let graph = (Graph, ImageNode::new(images.add(image)), Node { width: px(SIZE.x), height: px(SIZE.y), ..default() });
    let column = Node {
        position_type: PositionType::Absolute,
        top: px(8),
        left: px(8),
        padding: UiRect::all(px(8)),
        flex_direction: FlexDirection::Column,
        row_gap: px(2),
        ..default()
    };
    let font = TextFont::from_font_size(13.0);
    let column = commands.spawn((column, BackgroundColor(Color::srgba(0.08, 0.1, 0.12, 0.85)), Pickable::IGNORE)).id();
    for (number, (_, [r, g, b], _)) in STAGES.iter().enumerate() {
        let color = TextColor(Color::srgb_u8(*r, *g, *b));
        commands.spawn((Figure::Stage(number), Text::default(), font.clone(), color, ChildOf(column)));
    }
    commands.spawn((graph, ChildOf(column)));
    commands.spawn((Figure::Counts, Text::default(), font, ChildOf(column)));
}

fn write_figures(
    monitor: Res<Monitor>,
    step: Res<MedialStep>,
    levels: Query<&MedialLevel>,
    mut figures: Query<(&Figure, &mut Text)>,
) {
    let Some(row) = monitor.rows.last() else { return };
    for (figure, mut text) in &mut figures {
        text.0 = match figure {
            Figure::Stage(number) => {
                let (name, _, time) = STAGES[*number];
                format!("{name:9} {:.2} ms", time(row))
            }
            Figure::Counts => counts(&monitor, row, &step, &levels),
        };
    }
}

fn counts(monitor: &Monitor, row: &Row, step: &MedialStep, levels: &Query<&MedialLevel>) -> String {
    let asleep = step.infos.iter().filter(|info| info.asleep).count();
    let mut histogram = Vec::new();
    for MedialLevel(level) in levels {
        histogram.resize(histogram.len().max(level + 1), 0);
        histogram[*level] += 1;
    }
    let Row { body_pairs, candidates, toi_tests, contacts, stopped, .. } = row;
    format!(
        "0 to {:.2} ms, the last {} steps\n\nstep {}\n{} bodies, {asleep} asleep\n{body_pairs} body pairs\n{candidates} candidates of {}\n{toi_tests} times of impact\n\
         {contacts} contacts, {stopped} stopped\nshapes by level, finest first: {histogram:?}",
        height_of(shown(monitor)),
        SIZE.x,
        monitor.rows.len(),
        step.input.bodies.len(),
        step.output.counts.primitive_pairs,
    )
}

/// The rows that the graph shows.
fn shown(monitor: &Monitor) -> &[Row] {
    &monitor.rows[monitor.rows.len().saturating_sub(SIZE.x as usize)..]
}

/// The height of the graph, in milliseconds.
fn height_of(rows: &[Row]) -> f64 {
    let mut totals: Vec<f64> = rows.iter().map(|row| STAGES.iter().map(|(.., time)| time(row)).sum()).collect();
    totals.sort_by(f64::total_cmp);
    let at = (totals.len() as f64 * WITHIN) as usize;
    totals.get(at).copied().unwrap_or(1.0).max(f64::MIN_POSITIVE)
}

/// Draws a column of stacked stages for each of the last steps.
fn draw_graph(monitor: Res<Monitor>, graph: Single<&ImageNode, With<Graph>>, mut images: ResMut<Assets<Image>>) {
    let Some(mut image) = images.get_mut(&graph.image) else { return };
    let rows = shown(&monitor);
    let most = height_of(rows);
    for x in 0..SIZE.x {
        let mut tops = [0.0; STAGES.len()];
        if let Some(row) = rows.get(x as usize) {
            let mut height = 0.0;
            for (top, (.., time)) in tops.iter_mut().zip(&STAGES) {
                height += time(row);
                *top = height / most * f64::from(SIZE.y);
            }
        }
        for y in 0..SIZE.y {
            let height = f64::from(SIZE.y - y) - 0.5;
            let stage = tops.iter().position(|top| height < *top);
            let [r, g, b, a] = stage.map_or(FIELD, |stage| {
                let [r, g, b] = STAGES[stage].1;
                [r, g, b, 255]
            });
            // An error is impossible, because the pixel is inside the image.
            let _ = image.set_color_at(x, y, Color::srgba_u8(r, g, b, a));
        }
    }
}
