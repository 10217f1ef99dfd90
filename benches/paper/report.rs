//! The page, its table of frames and its charts.

use std::{error::Error, fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    charts::{Curve, over_frames},
    tables::{csv, write},
};
use serde::Serialize;

use crate::{
    Findings,
    page::page,
    scenes::{CULLS, SceneResult},
    times::{Cost, METHODS, Over, cost, time},
};

/// A paragraph for the terminal.
pub fn summary(result: &SceneResult) -> String {
    let mut text = format!(
        "{}: {} bodies, budget {:.2} %, {} primitive pairs, {} active frames",
        result.scene.name,
        result.bodies,
        result.budget,
        result.pairs,
        result.frames.iter().filter(|frame| frame.is_active).count()
    );
    for (method, name) in METHODS.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  {name:26} awake {:9.3} ms, {:7.2} times the hybrid; active {:9.3} ms, {:7.2} times",
            Over::Awake.mean_ms(result, method),
            Over::Awake.ratio(result, method),
            Over::Active.mean_ms(result, method),
            Over::Active.ratio(result, method)
        );
    }
    text
}

#[derive(Serialize)]
struct FrameRow {
    scene: &'static str,
    frame: usize,
    method: &'static str,
    ms: f64,
    body_pairs: f64,
    primitive_pairs: f64,
    active: bool,
}

fn frame_rows(result: &SceneResult) -> impl Iterator<Item = FrameRow> {
    result.frames.iter().enumerate().flat_map(move |(number, frame)| {
        (0..METHODS.len()).filter_map(move |method| {
            let Cost { ms, body_pairs, primitive_pairs } = cost(frame, method)?;
            let (scene, name) = (result.scene.name, METHODS[method]);
            // A tenth of a microsecond.
            let (ms, active) = ((ms * 1e4).round() / 1e4, frame.is_active);
            Some(FrameRow { scene, frame: number, method: name, ms, body_pairs, primitive_pairs, active })
        })
    })
}

/// Writes the page and its files to a folder.
///
/// # Errors
/// If a file cannot be written or a chart cannot be drawn; the message names it.
pub fn write_all(folder: &Path, provenance: [&str; 2], findings: &Findings) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    write(&folder.join("frames.csv"), &csv(findings.scenes.iter().flat_map(frame_rows)))?;
    for result in &findings.scenes {
        let path = folder.join(result.scene.name).with_extension("svg");
        let chart = chart(result).map_err(|error| format!("{}: {error}", path.display()))?;
        write(&path, &chart)?;
    }
    write(&folder.join("README.md"), &page(provenance, findings))
}

/// Figure 8 for the stairs, figure 10 for the other scenes: times over the frames, with the means of the paper as dashes.
fn chart(result: &SceneResult) -> Result<String, Box<dyn Error>> {
    let curve = |name, method: usize, level: Option<f64>| {
        let points =
            result.frames.iter().enumerate().filter_map(|(number, frame)| Some((number as f64, time(frame, method)?)));
        Curve { name, points: points.collect(), level }
    };
    let level = |method: usize| result.scene.paper_ms.map(|ms| ms[method]);
    let mut curves = vec![curve("hybrid", 0, level(0))];
    match result.scene.paper_ms {
        Some(_) => curves.extend([curve("oriented boxes", 1, level(1)), curve("spheres", 2, level(2))]),
        None => curves.push(curve("no culling of primitives", CULLS.len(), None)),
    }
    curves.push(curve("paper's method", CULLS.len() + 1, None));
    over_frames(&format!("{}: collision per frame", result.scene.name), "ms, one CPU core", &curves)
}
