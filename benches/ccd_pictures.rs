//! Draws the figures of `docs/step.md` from the results of real steps: a rod at a thin wall, and balls that stop at a floor.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin ccd_pictures -- [DIR]
//! ```
//!
//! Writes `step_sweep.svg` and `step_core.svg`. Default folder: `docs/images`.

use std::{env, error::Error, f32::consts::TAU, path::PathBuf};

use bevy::{
    math::{Quat, Vec2, Vec3},
    tasks::TaskPool,
};
use bevy_medial::{
    geometry::{Obb, Pose3, Sweep},
    medial_axis::MedialAxis,
    pipeline::{Body, Shape, StaticBody, Statics, StepInput, step},
};
use bevy_medial_compare::tables::write;
use plotters::{
    coord::{Shift, types::RangedCoordf32},
    prelude::*,
};

type Panel<'a> = DrawingArea<SVGBackend<'a>, Cartesian2d<RangedCoordf32, RangedCoordf32>>;
type Drawn = Result<(), Box<dyn Error>>;

/// Size of a figure of two panels, one above the other, in pixels.
const SIZE: (u32, u32) = (380, 500);
/// Colours on pages with dark colours.
const DARK: &str = "<style>@media(prefers-color-scheme:dark){[fill='#FFFFFF']{fill:#0d1117}[fill='#222222']{fill:#e6edf3}\
[stroke='#222222']{stroke:#e6edf3}}</style>";
/// Size of a panel, in metres of the scene.
const WIDTH: f32 = 3.8;
const HEIGHT: f32 = 2.5;
const BODY: RGBColor = RGBColor(217, 130, 43);
const FIXED: RGBColor = RGBColor(119, 119, 119);
const INK: RGBColor = RGBColor(34, 34, 34);

/// A body, its motion, and a box as an obstacle.
struct Scene {
    body: Body,
    obstacle: Obb,
}

impl Scene {
    fn new(axis: MedialAxis, start: Pose3, end: Pose3, center: Vec3, half_extents: Vec3) -> Self {
        let shape = Shape { axis, scale: 1.0 };
        let sweep = Sweep::between(start, end, shape.center_of_mass(), Vec3::ZERO);
        let obstacle = Obb { pose: Pose3::from_translation(center), half_extents };
        Self { body: Body::new(shape, sweep), obstacle }
    }

    /// The pose of the body at the end of the step.
    fn stop(&self) -> Pose3 {
        let statics = Statics::new(vec![StaticBody::solid_box(self.obstacle)]);
        let input = StepInput {
            bodies: vec![self.body.clone()],
            prediction: 0.02,
            stop_at_impact: true,
            ..StepInput::default()
        };
        let output = step(&input, &statics, &TaskPool::new());
        output.stop_of(0).map_or(self.body.sweep.end, |stop| stop.pose)
    }

    /// Draws the body, as an outline or filled.
    fn draw(&self, panel: &Panel, pose: Pose3, style: impl Into<ShapeStyle>) -> Drawn {
        let Some(shape) = self.body.solid.medial() else { return Ok(()) };
        let outline = (0..=96).filter_map(|i| {
            let direction = Vec2::from_angle(i as f32 / 96.0 * TAU).extend(0.0);
            let ends = shape
                .axis
                .spheres()
                .iter()
                .map(|sphere| pose.transform_point(sphere.center) + direction * sphere.radius);
            // The outline of the hull of the spheres: the farthest point in each direction.
            ends.max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))).map(|point| (point.x, point.y))
        });
        let (style, outline): (ShapeStyle, Vec<_>) = (style.into(), outline.collect());
        if style.filled {
            panel.draw(&Polygon::new(outline, style))?;
        } else {
            panel.draw(&PathElement::new(outline, style))?;
        }
        Ok(())
    }

    fn draw_obstacle(&self, panel: &Panel) -> Drawn {
        let (center, half) = (self.obstacle.pose.translation, self.obstacle.half_extents);
        let corners = [center - half, center + half].map(|corner| (corner.x, corner.y));
        Ok(panel.draw(&Rectangle::new(corners, FIXED.filled()))?)
    }
}

/// A panel with a title above and a sentence below.
fn panel<'a>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    title: &str,
    sentence: &str,
) -> Result<Panel<'a>, Box<dyn Error>> {
    let panel = area.apply_coord_spec(Cartesian2d::<RangedCoordf32, RangedCoordf32>::new(
        0.0..WIDTH,
        HEIGHT..0.0,
        area.get_pixel_range(),
    ));
    let bold = ("sans-serif", 18).into_font().style(FontStyle::Bold).color(&INK);
    panel.draw(&Text::new(title.to_owned(), (0.2, HEIGHT - 0.12), bold))?;
    label(&panel, (0.2, 0.22), sentence)?;
    Ok(panel)
}

fn label(panel: &Panel, place: (f32, f32), text: &str) -> Drawn {
    Ok(panel.draw(&Text::new(text.to_owned(), place, ("sans-serif", 17).into_font().color(&INK)))?)
}

/// A figure of two panels.
fn figure(file: PathBuf, draw: impl FnOnce([&DrawingArea<SVGBackend, Shift>; 2]) -> Drawn) -> Drawn {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let (upper, lower) = area.split_vertically(SIZE.1 / 2);
        draw([&upper, &lower])?;
        area.present()?;
    }
    Ok(write(&file, &svg.replacen(">\n", &format!(">\n{DARK}\n"), 1))?)
}

/// A rod turns and flies at a wall of 10 cm.
fn sweep(file: PathBuf) -> Drawn {
    let rod = MedialAxis::capsule(Vec3::NEG_Y * 0.3, Vec3::Y * 0.3, 0.1)?;
    let [start, end] = [(0.7, 0.5), (3.0, -0.5)]
        .map(|(x, angle)| Pose3::from_parts(Vec3::new(x, 1.4, 0.0), Quat::from_rotation_z(angle)));
    let scene = Scene::new(rod, start, end, Vec3::new(1.9, 1.4, 0.0), Vec3::new(0.05, 0.75, 1.0));
    let stop = scene.stop();
    figure(file, |[upper, lower]| {
        let ends = panel(upper, "Ends of the step only", "Neither pose touches the wall: the rod is through.")?;
        scene.draw_obstacle(&ends)?;
        scene.draw(&ends, start, BODY.filled())?;
        scene.draw(&ends, end, BODY.mix(0.45).filled())?;
        let path = panel(lower, "The path between them", "It meets the wall, and ends the step there.")?;
        for i in 1..12 {
            scene.draw(&path, scene.body.sweep.pose_at(i as f32 / 12.0), BODY.mix(0.35).stroke_width(1))?;
        }
        scene.draw_obstacle(&path)?;
        scene.draw(&path, start, BODY.filled())?;
        scene.draw(&path, end, BODY.mix(0.45).stroke_width(1))?;
        scene.draw(&path, stop, RGBColor(180, 67, 15).filled())?;
        for panel in [&ends, &path] {
            label(panel, (0.55, 0.75), "start")?;
            label(panel, (2.85, 0.75), "end")?;
        }
        Ok(())
    })
}

/// Two balls at a floor: one stops at the first touch of its surface, the other at the first touch of its core.
fn cores(file: PathBuf) -> Drawn {
    let (radius, depth, floor) = (0.4, 0.25, 0.93);
    let [start, end] = [1.8, 0.85].map(|y| Pose3::from_translation(Vec3::new(1.85, y, 0.0)));
    figure(file, |[upper, lower]| {
        let panels = [
            (upper, "First touch of surfaces", "The solver has no overlap to work with.", 0.0),
            (lower, "First touch of cores", "The solver handles the overlap (exaggerated).", depth),
        ];
        for (area, title, sentence, core_depth) in panels {
            let half_extents = Vec3::new(1.65, 0.08, 1.0);
            let center = Vec3::new(1.85, floor - half_extents.y, 0.0);
            let mut scene = Scene::new(MedialAxis::sphere(radius)?, start, end, center, half_extents);
            scene.body.core_depth = core_depth;
            let stop = scene.stop();
            let panel = panel(area, title, sentence)?;
            scene.draw_obstacle(&panel)?;
            scene.draw(&panel, start, BODY.mix(0.45).filled())?;
            scene.draw(&panel, stop, BODY.mix(0.7).filled())?;
            scene.draw(&panel, end, INK.mix(0.6).stroke_width(1))?;
            let core = MedialAxis::sphere(radius * (1.0 - core_depth))?;
            let core = Scene { body: Body::new(Shape { axis: core, scale: 1.0 }, scene.body.sweep), ..scene };
            core.draw(&panel, stop, INK.stroke_width(2))?;
            // The end is labelled below the floor.
            for (pose, text, offset) in [(start, "start", 0.0), (stop, "it stops here", 0.0), (end, "end", -0.16)] {
                label(&panel, (pose.translation.x + radius + 0.1, pose.translation.y + offset), text)?;
            }
        }
        Ok(())
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::args().nth(1).map_or_else(|| PathBuf::from("docs/images"), PathBuf::from);
    sweep(folder.join("step_sweep.svg"))?;
    cores(folder.join("step_core.svg"))
}
