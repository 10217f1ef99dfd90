//! The tables, as CSV and Markdown.

use std::{fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    culling::Report,
    measure::Row,
    tables::{csv, machine, write},
};
use serde::Serialize;

/// A comparison of the hybrid culling with another one in a scene.
pub struct Culling {
    pub scene: &'static str,
    /// Budget of all bodies, in percent.
    pub budget_percent: f64,
    pub report: Report,
}

impl Culling {
    /// A row for each of the two cullings, over all steps and over the active ones.
    fn rows(&self) -> impl Iterator<Item = CullingRow<'_>> {
        let Report { other, steps, figures } = &self.report;
        [0, 1].into_iter().flat_map(move |over| {
            ["hybrid", other].into_iter().zip(&figures[over]).map(move |(culling, figures)| CullingRow {
                scene: self.scene,
                budget_percent: self.budget_percent,
                beside: other,
                over: ["all", "active"][over],
                steps: steps[over],
                culling,
                culling_ms: figures.culling_ms,
                rest_ms: figures.rest_ms,
                body_pairs: figures.body_pairs,
                candidates: figures.candidates,
            })
        })
    }
}

#[derive(Serialize)]
struct CullingRow<'a> {
    scene: &'a str,
    budget_percent: f64,
    beside: &'a str,
    over: &'a str,
    steps: usize,
    culling: &'a str,
    culling_ms: f64,
    rest_ms: f64,
    body_pairs: f64,
    candidates: f64,
}

/// Writes all tables to a folder.
///
/// # Errors
/// If a file cannot be written; the message names it.
pub fn write_all(folder: &Path, command: &str, peers: &[Row], culling: &[Culling]) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    write(&folder.join("peers.csv"), &csv(peers))?;
    write(&folder.join("culling.csv"), &csv(culling.iter().flat_map(Culling::rows)))?;
    write(&folder.join("README.md"), &markdown(command, peers, culling))
}

const HEAD: &str = "\
# Results

The command below makes this page. All engines have the same bodies, masses, inertias, poses, gravity, damping and step, and run on the same core. The number
of runs is that of `--runs` (default: 3), and the fastest run of each step counts. Times are medians in milliseconds over the *active* steps and, in brackets,
over all steps. A step is active if it has at least 30 % of the max number of contact pairs and 3 % of the max kinetic energy.

- *collision*: search for contacts and impacts; *step*: the whole step, without copies from and to components.
- *sums*: collision and step, over all steps of the scene. They compare engines whose bodies come to rest at different times.
- *overlap*: deepest overlap of the exact meshes of two bodies, in percent of the smaller body's size: the max over 120 evenly spread
  steps, and the median over the active ones among them.
- *lost*: bodies that have fallen through the ground or left the square of the ground.
- *error*: distance from the exact mesh to its shape in the engine, in percent of the mesh's diagonal: the max over all models, and the mean.
- *half the error*: medial meshes with a budget of half the max error of the decompositions in the scene.

`benches/src/engines` and `benches/src/baselines` document the setup of each engine and baseline.
";

fn markdown(command: &str, peers: &[Row], culling: &[Culling]) -> String {
    let mut text = format!("{HEAD}\nMachine: {}. Command: `{command}`.\n", machine());
    // Writing to a string cannot fail.
    for rows in peers.chunk_by(|a, b| a.scene == b.scene) {
        let _ = write!(
            text,
            "\n## {}: {} bodies, {} steps\n\n\
             | engine and shapes | parts | error: max, mean | active steps | collision | step | sums | overlap: max, median | lost |\n\
             |---|---|---|---|---|---|---|---|---|\n",
            rows[0].scene, rows[0].bodies, rows[0].steps
        );
        for row in rows {
            let _ = writeln!(
                text,
                "| {} | {:.0} | {:.2}, {:.2} | {} | {:.3} ({:.3}) | {:.3} ({:.3}) | {:.0}, {:.0} | {:.2}, {:.2} % | {} |",
                row.engine,
                row.parts,
                row.error_max_percent,
                row.error_mean_percent,
                row.active_steps,
                row.collision_active_ms,
                row.collision_ms,
                row.step_active_ms,
                row.step_ms,
                row.collision_sum_ms,
                row.step_sum_ms,
                row.overlap_max_percent,
                row.overlap_median_percent,
                row.lost,
            );
        }
    }
    if !culling.is_empty() {
        text += "\n## Culling\n\n\
            Each step's input is run with the hybrid culling and with another culling. Everything else is the same, and so are the results. Scenes run at the \
            default budget, and at one that gives bodies about as many primitives as in the paper. The ratio is that of the whole collision, over active \
            steps and in brackets over all steps. Above 1, the hybrid culling is faster. Where bodies sleep in most steps, the median over all steps \
            consists of some microseconds of setup, which is longest for trees and shortest without culling. *At most* is the ratio over active steps if \
            the hybrid culling took no time, because the later stages are the same for all.\n\n\
            | scene, budget | beside | culling, hybrid | other | collision, hybrid | other | ratio | at most | candidates, hybrid | other |\n\
            |---|---|---|---|---|---|---|---|---|---|\n";
        for Culling { scene, budget_percent, report } in culling {
            let [all, [hybrid, other]] = report.figures;
            let _ = writeln!(
                text,
                "| {scene}, {budget_percent} % | {} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} ({:.2}) | {:.1} | {:.0} | {:.0} |",
                report.other,
                hybrid.culling_ms,
                other.culling_ms,
                hybrid.total_ms(),
                other.total_ms(),
                other.total_ms() / hybrid.total_ms(),
                all[1].total_ms() / all[0].total_ms(),
                other.total_ms() / hybrid.rest_ms,
                hybrid.candidates,
                other.candidates,
            );
        }
    }
    text
}
