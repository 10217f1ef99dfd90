//! The tables, as CSV and Markdown.

use std::{fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    culling::Report,
    measure::Row,
    tables::{csv, machine, write},
};
use serde::Serialize;

/// A scene with the hybrid culling, and beside it another.
pub struct Culling {
    pub scene: &'static str,
    /// Of all bodies.
    pub budget_percent: f64,
    pub report: Report,
}

impl Culling {
    /// A row for either culling, over all steps and over the active ones.
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

Made by the command below. All engines have the same bodies, masses, inertias, poses, gravity, damping and step,
and run on one and the same core, as often as `--runs` says (3 times if it says nothing), where of each step the fastest counts. Times are medians in milliseconds, of the *active* steps and, in brackets, of all: active are those with at
least 30 % of the greatest number of contact pairs and 3 % of the greatest kinetic energy.

- *collision*: finding contacts and impacts; *step*: all of a step, without copies from and to components.
- *sums*: collision and step, over all steps of the scene. They compare engines whose bodies come to rest at different times.
- *overlap*: deepest overlap of the exact meshes of two bodies, in percent of the smaller body's size: the greatest in 120 steps that
  are spread evenly, and the median over those of them that are active.
- *lost*: bodies that have fallen through the ground or left the square that it covers.
- *error*: from the exact mesh to the shape that stands for it, in percent of the mesh's diagonal: the greatest of any model, and the mean.
- *half the error*: medial meshes with a budget of half the greatest error that the decompositions have in the scene.

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
            Each step's input with the hybrid culling and with another, all else the same, and the same results: at the default budget, and at one of \
            which bodies have about as many primitives as those of the paper. The ratio is of the whole collision, over active steps and in brackets \
            over all: above 1 the hybrid one is faster. Over all steps the median may be one in which all sleep: microseconds of setting up, of which \
            the trees take more, and no culling least. *At most* is the ratio, over active steps, if the hybrid culling took no time at all: what \
            follows is the same for all.\n\n\
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
