//! The charts of the reports, from the tables that the programs write.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy_medial::builder::MedialLevels;

use crate::{
    charts::{Axis, Bars, Chart, Curve},
    tables::Table,
};

/// The name of a chart, which is that of its file, and the chart as SVG.
pub type Figure = (String, String);

/// Scenes of the paper, and its mean times of culling and detection in milliseconds on an RTX 2060S: with the medial axis transform, with trees of oriented
/// boxes, of spheres.
pub const PAPER_MS: [(&str, Option<[f64; 3]>); 4] = [
    ("rods", Some([6.48, 16.76, 27.76])),
    ("dinosaur", Some([10.42, 27.81, 41.75])),
    ("tori", Some([1.67, 6.15, 8.84])),
    ("stairs", None),
];

/// A logarithmic axis whose smaller values are better.
const fn costs(label: &str) -> Axis<'_> {
    Axis { label, less_is_better: true, is_logarithmic: true }
}

/// Errors, times and sizes of queries: `queries.csv`.
pub fn queries(table: &Table) -> Vec<Figure> {
    let methods = [
        ("medial mesh", "medial mesh"),
        ("convex decomposition", "convex decomposition"),
        ("spheres only", "spheres only"),
        ("medial mesh, alternating TOI", "alternating TOI"),
    ];
    let cullings = [
        ("medial mesh", "hybrid"),
        ("medial mesh, BVH of spheres", "BVH of spheres"),
        ("medial mesh, BVH of AABBs", "BVH of AABBs"),
        ("medial mesh, BVH of OBBs", "BVH of OBBs"),
    ];
    let time = ("microseconds", "microseconds per query");
    let (median, p95) = (
        ("hit_error_median_percent", "median error of hits, % of the size"),
        ("hit_error_p95_percent", "95th percentile of errors of hits, %"),
    );
    let chart = |name: &str, title, methods: [(&str, &str); 4], x: (&str, &str), y: (&str, &str)| {
        let curves = methods.map(|(method, name)| curve(table, name, &[("method", method)], [x.0, y.0]));
        let (x, y) = (costs(x.1), costs(y.1));
        (name.to_owned(), Chart { title, note: "", x, y, curves: curves.into() }.svg())
    };
    vec![
        chart("error_time", "Median error and time of a query", methods, time, median),
        chart("great_error_time", "Large errors and time of a query", methods, time, p95),
        chart("error_bytes", "Large errors and size", methods, ("bytes", "bytes per shape"), p95),
        chart("culling_time", "Culling of a medial mesh", cullings, time, p95),
    ]
}

/// Errors and times of scenes: `scenes.csv`.
pub fn scenes(table: &Table) -> Vec<Figure> {
    let chart = |scene: &str| {
        let columns = ["step_ms", "surface_error_percent"];
        let curves = ["medial meshes", "convex pieces"]
            .map(|method| curve(table, method, &[("scene", scene), ("method", method)], columns));
        let (x, y) = (costs("milliseconds per active step"), costs("max error of the surface, %"));
        let chart = Chart { title: &format!("Scene {scene}"), note: "", x, y, curves: curves.into() };
        (scene.to_owned(), chart.svg())
    };
    let mut names: Vec<&str> = table.column("scene").collect();
    names.dedup();
    names.into_iter().map(chart).collect()
}

/// Times of impact of many primitive pairs at once: `batches.csv`.
pub fn batches(table: &Table) -> Option<Figure> {
    let gpu = table.column("gpu").next()?;
    let name = if gpu.contains("llvmpipe") { "llvmpipe, on the CPU" } else { "GPU, round trip" };
    let curves =
        [("CPU, one thread", "cpu_ms"), (name, "gpu_ms")].map(|(name, ms)| curve(table, name, &[], ["pairs", ms]));
    let x = Axis { label: "pairs of primitives", less_is_better: false, is_logarithmic: true };
    let chart = Chart {
        title: "Times of impact in batches",
        note: &format!("GPU: {gpu}"),
        x,
        y: costs("milliseconds per batch"),
        curves: curves.into(),
    };
    Some(("batches".into(), chart.svg()))
}

/// Numbers of primitives within an error, over the `.medial` files of a folder.
///
/// # Errors
/// If a file cannot be read. The message names it.
pub fn levels(folder: &Path) -> Result<Figure, String> {
    let files = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let paths = files.flatten().map(|file| file.path());
    let paths = paths.filter(|path| path.extension().is_some_and(|extension| extension == "medial"));
    let load = |path: PathBuf| MedialLevels::load(&path).map_err(|error| format!("{}: {error}", path.display()));
    let models = paths.map(load).collect::<Result<Vec<_>, _>>()?;
    let primitives = |percent: f64| {
        let of = |levels: &MedialLevels| Some(levels.coarsest_within(percent as f32)?.axis.primitives().len());
        let mut numbers: Vec<usize> = models.iter().filter_map(of).collect();
        numbers.sort_unstable();
        numbers
    };
    let errors = [0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0].map(|percent| (percent, primitives(percent)));
    let curve = |name, of: fn(&[usize]) -> Option<&usize>| {
        let points = errors.iter().filter_map(|(percent, numbers)| Some([*percent, *of(numbers)? as f64]));
        Curve { name, points: points.collect(), level: None }
    };
    let chart = Chart {
        title: "Primitives within an error",
        note: &format!("over {} models", models.len()),
        x: costs("max error, % of the diagonal"),
        y: costs("primitives"),
        curves: vec![
            curve("model with most", |numbers| numbers.last()),
            curve("median", |numbers| numbers.get(numbers.len() / 2)),
            curve("model with fewest", |numbers| numbers.first()),
        ],
    };
    Ok(("levels".into(), chart.svg()))
}

/// Figure 8 of the paper for the stairs, figure 10 for the other scenes: times over the frames, from `frames.csv`.
pub fn paper(table: &Table) -> Vec<Figure> {
    let scenes = PAPER_MS.iter().filter(|(scene, _)| table.column("scene").any(|name| name == *scene));
    let chart = |(scene, means): &(&str, Option<[f64; 3]>)| {
        let of = |method: &str, name, level| Curve {
            level,
            ..curve(table, name, &[("scene", scene), ("method", method)], ["frame", "ms"])
        };
        let level = |number: usize| means.map(|means| means[number]);
        let mut curves = vec![of("hybrid", "hybrid", level(0))];
        if means.is_some() {
            curves.push(of("trees of oriented boxes", "oriented boxes", level(1)));
            curves.push(of("trees of spheres", "spheres", level(2)));
        } else {
            curves.push(of("no culling of primitives", "no culling", None));
        }
        curves.push(of("flat, alternating", "paper's method", None));
        let note = if means.is_some() { "dashes: means in the paper, on an RTX 2060S" } else { "" };
        let x = Axis { label: "frame", less_is_better: false, is_logarithmic: false };
        let y = costs("milliseconds per frame, one CPU core");
        (scene.to_string(), Chart { title: &format!("Scene {scene}"), note, x, y, curves }.svg())
    };
    scenes.map(chart).collect()
}

/// Errors of posed medial meshes over the frames of a gait: `animated.csv`. Its first frame is the bind pose.
pub fn animated(table: &Table) -> Figure {
    let of = |name, character: &str, column| {
        let mut all = curve(table, name, &[("character", character)], ["frame", column]);
        let level = all.points.first().map(|point| point[1]);
        Curve { points: all.points.split_off(1.min(all.points.len())), level, ..all }
    };
    let chart = Chart {
        title: "Error of posed medial meshes",
        note: "dashes: bind pose",
        x: Axis { label: "frame", less_is_better: false, is_logarithmic: false },
        y: Axis { label: "mm", less_is_better: true, is_logarithmic: false },
        curves: vec![
            of("biped, max", "biped", "max"),
            of("biped, mean", "biped", "mean"),
            of("spider, max", "spider", "max"),
            of("spider, mean", "spider", "mean"),
        ],
    };
    ("animated".into(), chart.svg())
}

/// Seeds that each method passes: `stability.csv`.
pub fn stability(table: &Table) -> Figure {
    let mut rows: Vec<(&str, [usize; 2])> = Vec::new();
    for (method, passed) in table.column("method").zip(table.column("passed")) {
        let at = rows.iter().position(|(name, _)| *name == method).unwrap_or_else(|| {
            rows.push((method, [0; 2]));
            rows.len() - 1
        });
        rows[at].1[1] += 1;
        rows[at].1[0] += usize::from(passed == "true");
    }
    let note = "in hazards that we chose; on the GPU only the first seed is run";
    ("stability".into(), Bars { title: "Seeds passed", note, rows }.svg())
}

/// The curve of two columns over the rows whose text columns have the given values.
fn curve<'a>(table: &Table, name: &'a str, only: &[(&str, &str)], columns: [&str; 2]) -> Curve<'a> {
    let rows = table.rows().filter(|row| only.iter().all(|(column, value)| table.get(row, column) == Some(*value)));
    let number = |row, column| table.get(row, column).and_then(|text: &str| text.parse().ok());
    let points = rows.filter_map(|row| Some([number(row, columns[0])?, number(row, columns[1])?]));
    Curve { name, points: points.collect(), level: None }
}
