//! The output: tables, charts, and pages that contain them.

use std::{fmt::Write, fs, path::Path};

use bevy_medial_compare::{
    figures,
    tables::{Table, csv, machine, today, write},
};

use crate::{
    batches::{BatchRow, crossover},
    queries::Row,
    scenes::SceneRow,
    verdict::{Verdict, verdicts},
};

type Written = Result<(), Box<dyn std::error::Error>>;

/// A line of text for a row of queries.
pub fn line(row: &Row) -> String {
    format!(
        "{:28} {:7.0} parts: {:9.2} us, error {:8.4} % (95 %: {:8.4}), grazes {:8.4} %, normal {:5.1} deg; missed {:5.2} + {:5.2} %, false positives {:5.1} %",
        row.method,
        row.parts,
        row.microseconds,
        row.hit_error_median_percent,
        row.hit_error_p95_percent,
        row.graze_error_median_percent,
        row.normal_error_median_degrees,
        row.missed_hits_percent,
        row.missed_grazes_percent,
        row.false_positives_percent
    )
}

/// A line of text for a row of scenes.
pub fn scene_line(row: &SceneRow) -> String {
    format!(
        "{:9} {:15} {:>5}: surface {:6.2} %, collision {:7.3} ms, step {:7.3} ms, overlap {:5.2} %",
        row.scene,
        row.method,
        row.budget_percent.map_or_else(|| "-".into(), |percent| percent.to_string()),
        row.surface_error_percent,
        row.collision_ms,
        row.step_ms,
        row.overlap_max_percent
    )
}

/// Writes all files to a folder. `models`: the folder of the medial meshes.
///
/// # Errors
/// If a file cannot be written.
pub fn write_all(
    folder: &Path,
    command: &str,
    models: &Path,
    rows: &[Row],
    scenes: &[SceneRow],
    batches: &[BatchRow],
) -> Written {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    write(&folder.join("queries.csv"), &csv(rows))?;
    write(&folder.join("scenes.csv"), &csv(scenes))?;
    let mut charts = figures::queries(&Table::new(&csv(rows)));
    charts.push(figures::levels(models)?);
    charts.extend(figures::scenes(&Table::new(&csv(scenes))));
    if !batches.is_empty() {
        write(&folder.join("batches.csv"), &csv(batches))?;
        charts.extend(figures::batches(&Table::new(&csv(batches))));
    }
    let run = Run { date: today(), machine: machine(), command, gpu: gpu_summary(batches) };
    for (name, svg) in &charts {
        write(&folder.join(name).with_extension("svg"), svg)?;
    }
    let text = markdown(&run, rows, scenes, charts.iter().map(|(name, _)| name.as_str()));
    write(&folder.join("README.md"), &text)?;
    Ok(())
}

/// A sentence that states from which batch size the GPU is faster.
fn gpu_summary(batches: &[BatchRow]) -> String {
    let Some(first) = batches.first() else { return "There was no GPU.".into() };
    let faster =
        crossover(batches).map_or("in no batch".into(), |pairs| format!("in batches of {pairs} pairs and more"));
    format!("GPU: {}, faster than a thread of the CPU {faster}.", first.gpu)
}

/// The circumstances of a run.
struct Run<'a> {
    date: String,
    machine: String,
    command: &'a str,
    gpu: String,
}

const HEAD: &str = "\
This page shows the error and the time of a query for medial meshes, convex decompositions and other shapes, so that you can choose a shape and a budget.

Two bodies approach each other within a step, and each method computes the time of their first touch. The reference is the first touch of the exact
triangle meshes, by conservative advancement in f64, confirmed by bisection. In a step, bodies move by 10 to 100 % of the smaller body's size, and
turn by up to a radian. Of five approaches, three are hits, one is a graze (the path of the contact point is within 12 degrees of the surface), and
one is a near miss (by less than 2 % of the size).

- *error*: path of the contact point between the true and the computed time, in percent of the smaller body's diagonal;
- *missed*: hits, and grazes, that a method does not report; *false positives*: near misses that a method reports as hits;
- *time*: of a query on one thread, the min of three, and the mean over all approaches (for triangle meshes one run of every tenth approach);
- *bytes*: vertices, spheres and index lists, without hierarchies; *preparation*: time to make the shape from a mesh.

By the median, a fine convex decomposition is better, if a query may take a millisecond, because its pieces contain vertices of the mesh where most
first touches are. One in twenty of its answers is wrong by several percent, because the pieces fill hollows. By the 95th percentile, a medial mesh is
better. A method misses touches where its shape is thinner than the body, and reports false positives where it is thicker.

Convex shapes and triangle meshes are queried by parry's nonlinear shape cast, which rapier's CCD uses. \"Spheres only\" are inscribed spheres.
\"Alternating TOI\" is the published scheme on the same medial meshes, for the pairs that a BVH of spheres finds. `queries.csv` has the rows of these
two, and of other cullings, which change only the time.
";

/// Methods whose queries are only in the CSV.
const OTHERS: [&str; 3] = ["BVH", "alternating", "spheres"];

fn queries_table(rows: &[Row]) -> Vec<Vec<String>> {
    let head = [
        "method",
        "parts",
        "surface, %",
        "error, %",
        "95 %",
        "grazes, %",
        "normal, degrees",
        "missed, %",
        "false positives, %",
        "time, us",
        "bytes",
        "preparation, s",
    ];
    let row = |row: &Row| {
        vec![
            row.method.into(),
            format!("{:.0}", row.parts),
            format!("{:.2}", row.surface_error_percent),
            format!("{:.3}", row.hit_error_median_percent),
            format!("{:.3}", row.hit_error_p95_percent),
            format!("{:.3}", row.graze_error_median_percent),
            format!("{:.1}", row.normal_error_median_degrees),
            format!("{:.1}, {:.1}", row.missed_hits_percent, row.missed_grazes_percent),
            format!("{:.1}", row.false_positives_percent),
            format!("{:.2}", row.microseconds),
            format!("{:.0}", row.bytes),
            format!("{:.2}", row.preparation_s),
        ]
    };
    let rows = rows.iter().filter(|row| !OTHERS.iter().any(|other| row.method.contains(other)));
    std::iter::once(head.map(String::from).into()).chain(rows.map(row)).collect()
}

fn verdicts_table(rows: &[Row]) -> Vec<Vec<String>> {
    let head = [
        "beside",
        "parts",
        "times as fast at its median error",
        "at its 95 %",
        "times less median error in its time",
        "95 %",
    ];
    let times = |ratio: Option<f64>, none: &str| ratio.map_or_else(|| none.to_owned(), |ratio| format!("{ratio:.1}"));
    let row = |Verdict { rival, parts, by: [median, p95] }: Verdict| {
        vec![
            rival.into(),
            format!("{parts:.0}"),
            times(median.faster, "never that good"),
            times(p95.faster, "never that good"),
            times(median.nearer, "never that fast"),
            times(p95.nearer, "never that fast"),
        ]
    };
    std::iter::once(head.map(String::from).into())
        .chain(verdicts(rows).into_iter().filter(|verdict| !verdict.rival.contains("alternating")).map(row))
        .collect()
}

/// A row for each kind of shapes, and a column for each scene.
fn scenes_table(rows: &[SceneRow]) -> Vec<Vec<String>> {
    let scenes: Vec<&[SceneRow]> = rows.chunk_by(|a, b| a.scene == b.scene).collect();
    let names = scenes.iter().map(|rows| rows[0].scene.into());
    let head = std::iter::once("surface, %; step, ms; deepest overlap, %".into()).chain(names).collect();
    let row = |(number, first): (usize, &SceneRow)| {
        let shapes = match first.budget_percent {
            None => first.method.into(),
            Some(percent) if percent > 0.0 => format!("{}, {percent} %", first.method),
            Some(_) => format!("{}, finest", first.method),
        };
        let figures = scenes
            .iter()
            .filter_map(|rows| rows.get(number))
            .map(|row| format!("{:.2}; {:.3}; {:.2}", row.surface_error_percent, row.step_ms, row.overlap_max_percent));
        std::iter::once(shapes).chain(figures).collect()
    };
    let rows = scenes.first().into_iter().flat_map(|rows| rows.iter()).enumerate();
    std::iter::once(head).chain(rows.map(row)).collect()
}

/// All tables, with their titles.
fn tables(rows: &[Row], scenes: &[SceneRow]) -> [(&'static str, Vec<Vec<String>>); 3] {
    [
        ("The medial mesh beside the others", verdicts_table(rows)),
        ("Queries", queries_table(rows)),
        ("Scenes", scenes_table(scenes)),
    ]
}

fn markdown<'a>(run: &Run, rows: &[Row], scenes: &[SceneRow], charts: impl Iterator<Item = &'a str>) -> String {
    let mut text = {
        let Run { date, machine, command, gpu } = run;
        format!("# Speed against accuracy\n\n{HEAD}\n{date}. Machine: {machine}. Command: `{command}`. {gpu}\n")
    };
    let (of_scenes, others): (Vec<&str>, Vec<&str>) =
        charts.partition(|name| scenes.iter().any(|row| row.scene == *name));
    for name in others {
        let _ = writeln!(text, "\n![{name}]({name}.svg)");
    }
    let links: Vec<String> = of_scenes.iter().map(|name| format!("[{name}]({name}.svg)")).collect();
    let _ = writeln!(text, "\nCharts of the scenes: {}.", links.join(", "));
    for (title, table) in tables(rows, scenes) {
        let _ = writeln!(text, "\n## {title}\n");
        for (i, row) in table.iter().enumerate() {
            let _ = writeln!(text, "| {} |", row.join(" | "));
            if i == 0 {
                let _ = writeln!(text, "|{}", "---|".repeat(row.len()));
            }
        }
    }
    text
}
