//! Draws bullets in this crate, in rapier and in avian side by side, as an animated SVG.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin bullets -- [FILE]
//! ```
//!
//! Rods fly at 100 m/s, which is 1.7 m per step. The picture joins their poses at the ends of steps by straight paths. Default file:
//! `docs/images/bullets.svg`.

use std::{env, fmt::Write, path::PathBuf, process::ExitCode};

use bevy_medial_compare::{
    body::{Body, Form, Setup, State},
    charts::Drawing,
    outcome,
    stability::methods::{METHODS, Method},
    tables,
};
use glam::{Quat, Vec3};

const SPEED: f32 = 100.0;
const STEPS: usize = 6;
/// Seconds of the picture for each step, and after the last one.
const PACE: f32 = 0.8;
const REST: f32 = 1.2;
/// Half the length of a rod's axis and its radius, and half the thickness of the wall, in metres.
const ROD: [f32; 2] = [0.3, 0.05];
const WALL: f32 = 0.025;

/// Names of methods, and their labels.
const COLUMNS: [(&str, &str); 3] =
    [("medial, CPU", "this crate"), ("rapier, Ccd", "rapier, CCD on"), ("avian", "avian, swept CCD")];
/// Labels, and the other body beside a rod that flies along x.
const ROWS: [(&str, fn() -> Body); 3] = [
    ("a thin wall", || Body::fixed(Form::Cuboid(Vec3::new(WALL, 5.0, 5.0)))),
    ("a rod at rest", || rod(Vec3::ZERO, 1.3)),
    ("each other", || rod(Vec3::X * 1.5, 1.3).moving(Vec3::X * -SPEED)),
];

/// Size of the picture and of a cell in pixels, and place of the first cell.
const SIZE: [f64; 2] = [720.0, 380.0];
const CELL: [f64; 2] = [180.0, 84.0];
const FIRST: [f64; 2] = [160.0, 74.0];
/// Half the size of a cell in metres.
const VIEW: [f64; 2] = [1.8, 0.84];

fn main() -> ExitCode {
    outcome::of(draw())
}

fn draw() -> Result<(), String> {
    let file = env::args().nth(1).map_or_else(|| PathBuf::from("docs/images/bullets.svg"), PathBuf::from);
    let mut drawing = Drawing::new(SIZE);
    drawing.text("Bullets at 100 m/s, in steps of 1/60 s", [0.5 * SIZE[0], 30.0], 24.0, "middle");
    for (column, (name, label)) in COLUMNS.iter().enumerate() {
        let method = METHODS.iter().find(|method| method.name == *name).ok_or(format!("there is no method {name}"))?;
        let x = FIRST[0] + column as f64 * (CELL[0] + 6.0);
        drawing.text(label, [x + 0.5 * CELL[0], FIRST[1] - 12.0], 21.0, "middle");
        for (row, (target, other)) in ROWS.iter().enumerate() {
            let y = FIRST[1] + row as f64 * (CELL[1] + 18.0);
            if column == 0 {
                drawing.text(target, [FIRST[0] - 12.0, y + 0.5 * CELL[1] + 8.0], 21.0, "end");
            }
            let bodies = [rod(Vec3::X * -1.5, 1.9).moving(Vec3::X * SPEED), other()];
            let states = fly(method, &bodies)?;
            drawing.raw(&cell([x, y], &bodies, &states));
        }
    }
    tables::write(&file, &drawing.finish())
}

/// A rod in the plane of the picture at an angle to x, in radians.
fn rod(at: Vec3, angle: f32) -> Body {
    Body::dynamic(Form::capsule(ROD[0], ROD[1])).fast().at(at).turned(Quat::from_rotation_z(angle))
}

/// States of both bodies before the first step and after each step.
fn fly(method: &Method, bodies: &[Body; 2]) -> Result<Vec<[State; 2]>, String> {
    let setup = Setup::weightless();
    let mut engine = (method.make)(setup)?;
    bodies.iter().try_for_each(|body| engine.spawn(body))?;
    let start = [0, 1].map(|body| engine.state(body));
    let steps = (0..STEPS).map(|_| {
        engine.step(setup.dt);
        [0, 1].map(|body| engine.state(body))
    });
    Ok(std::iter::once(start).chain(steps).collect())
}

/// A cell of the picture as SVG, in metres.
fn cell([x, y]: [f64; 2], bodies: &[Body; 2], states: &[[State; 2]]) -> String {
    let ([width, height], [right, top]) = (CELL, VIEW);
    let mut text = format!(
        "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"{} {} {} {}\">\n\
         <rect class=\"rest\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" opacity=\"0.35\"/>\n",
        -right,
        -top,
        2.0 * right,
        2.0 * top,
        -right,
        -top,
        2.0 * right,
        2.0 * top
    );
    for (number, color) in [(1, "#0072b2"), (0, "#d55e00")] {
        if matches!(bodies[number].form, Form::Cuboid(_)) {
            _ = writeln!(
                text,
                "<rect x=\"{}\" y=\"-5\" width=\"{}\" height=\"10\" fill=\"{color}\"/>",
                -WALL,
                2.0 * WALL
            );
            continue;
        }
        _ = write!(text, "<line stroke=\"{color}\" stroke-width=\"{}\" stroke-linecap=\"round\"", 2.0 * ROD[1]);
        // The y axis of SVG points down.
        let coordinates: [(&str, f32, fn(Vec3) -> f32); 4] =
            [("x1", -1.0, |p| p.x), ("y1", -1.0, |p| -p.y), ("x2", 1.0, |p| p.x), ("y2", 1.0, |p| -p.y)];
        let value = |state: &[State; 2], side: f32, of: fn(Vec3) -> f32| {
            of(state[number].pose.transform_point(Vec3::X * side * ROD[0]))
        };
        for (name, side, of) in coordinates {
            _ = write!(text, " {name}=\"{:.3}\"", value(&states[0], side, of));
        }
        text += ">";
        let (all, times) = (STEPS as f32 * PACE + REST, (0..=STEPS).map(|step| step as f32 * PACE));
        let times: String = times.map(|time| format!("{:.3};", time / all)).collect();
        for (name, side, of) in coordinates {
            let values: String = states.iter().map(|state| format!("{:.3};", value(state, side, of))).collect();
            let last = value(&states[STEPS], side, of);
            _ = write!(
                text,
                "<animate attributeName=\"{name}\" dur=\"{all}s\" repeatCount=\"indefinite\" keyTimes=\"{times}1\" values=\"{values}{last:.3}\"/>"
            );
        }
        text += "</line>\n";
    }
    text + "</svg>\n"
}
