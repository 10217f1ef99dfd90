//! The page, its table of frames and its charts.

use std::{fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    figures,
    tables::{Table, csv, write},
};
use serde::Serialize;

use crate::{
    Findings,
    page::page,
    scenes::SceneResult,
    times::{Cost, METHODS, Over, cost},
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
/// If a file cannot be written; the message names it.
pub fn write_all(folder: &Path, provenance: [&str; 2], findings: &Findings) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let frames = csv(findings.scenes.iter().flat_map(frame_rows));
    write(&folder.join("frames.csv"), &frames)?;
    for (name, chart) in figures::paper(&Table::new(&frames)) {
        write(&folder.join(name).with_extension("svg"), &chart)?;
    }
    write(&folder.join("README.md"), &page(provenance, findings))
}
