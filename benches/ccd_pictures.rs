//! The figures of the page on continuous collision, from what a step finds: a rod and a thin wall, a ball that stops at a floor, one that slides
//! along it.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin ccd_pictures -- [DIR]
//! ```
//!
//! Writes `ccd_sweep.svg` and `ccd_stop_slide.svg`, into `docs/images` if no folder is named.

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
use plotters::{
    coord::{Shift, types::RangedCoordf32},
    prelude::*,
};

type Panel<'a> = DrawingArea<SVGBackend<'a>, Cartesian2d<RangedCoordf32, RangedCoordf32>>;
type Drawn = Result<(), Box<dyn Error>>;

/// Of a figure, in pixels; it has two panels.
const SIZE: (u32, u32) = (760, 250);
/// Of a panel, in metres of the scene.
const WIDTH: f32 = 3.8;
const HEIGHT: f32 = 2.5;
const BODY: RGBColor = RGBColor(217, 130, 43);
const FIXED: RGBColor = RGBColor(119, 119, 119);
const INK: RGBColor = RGBColor(34, 34, 34);

/// A body, its motion, and a box in its way.
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

    /// Where the step ends.
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
            // The hull of its spheres: the farthest point each way.
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
    let area = SVGBackend::new(&file, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let (left, right) = area.split_horizontally(SIZE.0 / 2);
    draw([&left, &right])?;
    area.present().map_err(|error| format!("{}: {error}", file.display()).into())
}

/// A rod turns and flies at a wall of 10 cm.
fn sweep(file: PathBuf) -> Drawn {
    let rod = MedialAxis::capsule(Vec3::NEG_Y * 0.3, Vec3::Y * 0.3, 0.1)?;
    let [start, end] = [(0.7, 0.5), (3.0, -0.5)]
        .map(|(x, angle)| Pose3::from_parts(Vec3::new(x, 1.4, 0.0), Quat::from_rotation_z(angle)));
    let scene = Scene::new(rod, start, end, Vec3::new(1.9, 1.4, 0.0), Vec3::new(0.05, 0.75, 1.0));
    let stop = scene.stop();
    figure(file, |[left, right]| {
        let ends = panel(left, "Ends of the step only", "Neither pose touches the wall: the rod is through.")?;
        scene.draw_obstacle(&ends)?;
        scene.draw(&ends, start, BODY.filled())?;
        scene.draw(&ends, end, BODY.mix(0.45).filled())?;
        let way = panel(right, "The way between them", "It meets the wall, and ends the step there.")?;
        for i in 1..12 {
            scene.draw(&way, scene.body.sweep.pose_at(i as f32 / 12.0), BODY.mix(0.35).stroke_width(1))?;
        }
        scene.draw_obstacle(&way)?;
        scene.draw(&way, start, BODY.filled())?;
        scene.draw(&way, end, BODY.mix(0.45).stroke_width(1))?;
        scene.draw(&way, stop, RGBColor(180, 67, 15).filled())?;
        for panel in [&ends, &way] {
            label(panel, (0.55, 0.75), "start")?;
            label(panel, (2.85, 0.75), "end")?;
        }
        Ok(())
    })
}

/// A ball that falls steeply to a floor, and one that comes in flat.
fn stop_and_slide(file: PathBuf) -> Drawn {
    let radius = 0.3;
    let ball = || MedialAxis::sphere(radius);
    let to_floor = |start: Vec2, end: Vec2| -> Result<Scene, Box<dyn Error>> {
        let [start, end] = [start, end].map(|place| Pose3::from_translation(place.extend(0.0)));
        Ok(Scene::new(ball()?, start, end, Vec3::new(1.85, 0.85, 0.0), Vec3::new(1.65, 0.08, 1.0)))
    };
    let floor = 0.93;
    let steep = to_floor(Vec2::new(0.6, 1.8), Vec2::new(2.4, 0.58))?;
    let flat = to_floor(Vec2::new(0.7, floor + radius + 0.001), Vec2::new(2.4, floor + radius - 0.008))?;
    figure(file, |[left, right]| {
        let texts = [
            ("A stop", "Much of the way goes into the floor: the rest is lost."),
            ("A slide", "Little of it does: only that much is taken away."),
        ];
        for ((area, (title, sentence)), scene) in [left, right].into_iter().zip(texts).zip([&steep, &flat]) {
            let panel = panel(area, title, sentence)?;
            let Sweep { start, end, .. } = scene.body.sweep;
            let stop = scene.stop();
            scene.draw_obstacle(&panel)?;
            scene.draw(&panel, start, BODY.mix(0.45).filled())?;
            scene.draw(&panel, stop, BODY.filled())?;
            scene.draw(&panel, end, INK.mix(0.6).stroke_width(1))?;
            let way = [start, stop, end].map(|pose| (pose.translation.x, pose.translation.y));
            panel.draw(&PathElement::new(way, INK.stroke_width(1)))?;
            label(&panel, (way[0].0 + 0.2, way[0].1 + 0.5), "start")?;
            label(&panel, (way[1].0 - 0.3, way[1].1 + 0.5), "it ends the step here")?;
        }
        Ok(())
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::args().nth(1).map_or_else(|| PathBuf::from("docs/images"), PathBuf::from);
    sweep(folder.join("ccd_sweep.svg"))?;
    stop_and_slide(folder.join("ccd_stop_slide.svg"))
}
