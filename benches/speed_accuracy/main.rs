//! Speed against accuracy: errors and times of the first touches that each method computes. The reference is the exact first touch of moving triangle
//! meshes.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin speed_accuracy -- [--out DIR] [--quick] [--approaches N] [--method NAME]
//! ```
//!
//! Writes `queries.csv`, `scenes.csv`, `batches.csv`, charts as SVG, and `README.md`.

mod approach;
mod batches;
mod methods;
mod models;
mod queries;
mod report;
mod scenes;
mod spheres;
mod truth;
mod verdict;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use approach::{Class, approaches};
use bevy_medial::scenes::load_models;
use bevy_medial_compare::{measure, outcome, stand_in::Kind};
use clap::Parser;
use indicatif::ProgressBar;
use methods::{DECOMPOSITIONS, Method};
use models::Model;
use queries::Case;

#[derive(Parser)]
#[command(about = "Speed against accuracy of collision queries and of the demo scenes")]
struct Args {
    /// Few approaches and coarse shapes: a test of the program in one or two minutes.
    #[arg(long)]
    quick: bool,
    /// Output folder.
    #[arg(long, default_value = "target/speed_accuracy")]
    out: PathBuf,
    /// Folder of meshes and their medial meshes.
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/models"))]
    models: PathBuf,
    /// Folder of research models that are compared as well, if it exists.
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models"))]
    research: PathBuf,
    /// Number of approaches of each pair of models.
    #[arg(long)]
    approaches: Option<usize>,
    /// Run only methods whose name contains this text, and no scenes.
    #[arg(long)]
    method: Option<String>,
}

/// Pairs of models that approach each other.
const PAIRS: [[&str; 2]; 6] = [
    ["bear", "deer"],
    ["bunny", "torus"],
    ["cow", "dolphin"],
    ["dinosaur", "armadillo"],
    ["spider", "bug"],
    ["torus", "torus"],
];

/// Pairs of research models that approach each other, if their folder exists.
const RESEARCH_PAIRS: [[&str; 2]; 2] = [["bear", "dolphin"], ["bug", "cow"]];

/// Numbers of spheres of the medial meshes, which have up to about 500 primitives.
const MEDIAL: [usize; 10] = [1, 2, 4, 8, 15, 30, 60, 120, 240, 360];

/// Numbers of spheres of shapes of spheres only.
const SPHERES: [usize; 6] = [4, 16, 64, 256, 1024, 4096];

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let research = if args.research.is_dir() && !args.quick { &RESEARCH_PAIRS[..] } else { &[] };
    let (pairs, medial, spheres, decompositions, count) = match args.quick {
        true => (&PAIRS[..2], &MEDIAL[3..6], &SPHERES[1..3], 1, 20),
        false => (&PAIRS[..], &MEDIAL[..], &SPHERES[..], DECOMPOSITIONS.len(), 500),
    };
    let count = args.approaches.unwrap_or(count);
    let paths_in = |folder: &Path, pair: &[&str; 2]| pair.map(|name| folder.join(name).with_extension("obj"));
    let own = pairs.iter().map(|pair| paths_in(&args.models, pair));
    let pairs: Vec<[PathBuf; 2]> = own.chain(research.iter().map(|pair| paths_in(&args.research, pair))).collect();
    let mut paths: Vec<&PathBuf> = pairs.iter().flatten().collect();
    paths.sort_unstable();
    paths.dedup();
    let progress = ProgressBar::new(paths.len() as u64).with_message("medial meshes");
    let load = |path: &&PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let kind = if path.starts_with(&args.models) { "" } else { " (research)" };
        Model::load(path, format!("{name}{kind}"), medial)
    };
    let models = progress.wrap_iter(paths.iter()).map(load).collect::<Result<Vec<Model>, String>>()?;
    progress.finish_and_clear();

    let mut cases = Vec::new();
    for (seed, pair) in (1..).zip(&pairs) {
        let [first, second] = pair.each_ref().map(|path| paths.binary_search(&path).map(|at| &models[at]));
        let (Ok(first), Ok(second)) = (first, second) else { continue };
        let models = [first, second];
        cases.push(Case { models, approaches: approaches(models, count, seed)? });
    }
    let of = |class| cases.iter().flat_map(|case| &case.approaches).filter(|a| a.class == class).count();
    println!("{} hits, {} grazes, {} near misses", of(Class::Hit), of(Class::Graze), of(Class::Miss));

    let plan = queries::Plan { sphere_counts: spheres, decompositions };
    let mut rows = Vec::new();
    let is_wanted = |method: &Method| args.method.as_deref().is_none_or(|part| method.name().contains(part));
    for method in Method::ALL.into_iter().filter(is_wanted) {
        let found = queries::rows(method, &models, &cases, &plan)?;
        found.iter().for_each(|row| println!("{}", report::line(row)));
        rows.extend(found);
    }

    let mut scene_rows = Vec::new();
    if args.method.is_none() {
        let known = load_models(&args.models)?;
        let (budgets, kinds, steps): (&[f32], &[Kind], usize) = match args.quick {
            true => (&[2.0, 0.0], &[Kind::Hull], 40),
            false => (
                &[8.0, 4.0, 2.0, 1.0, 0.5, 0.0],
                &[Kind::Hull, Kind::Decomposition, Kind::FineDecomposition],
                usize::MAX,
            ),
        };
        for name in ["rods", "tori", "stairs", "dinosaur"] {
            let plan = measure::Plan { steps, runs: if args.quick { 1 } else { 2 } };
            let found = scenes::rows(name, &known, &args.models, (budgets, kinds), plan)?;
            found.iter().for_each(|row| println!("{}", report::scene_line(row)));
            scene_rows.extend(found);
        }
    }
    let batches = batches::rows(if args.quick { 4 } else { 8 })?;
    match batches::crossover(&batches) {
        Some(pairs) => println!("in batches of {pairs} and more the GPU is faster"),
        None => println!("the GPU is not faster, or there is no GPU"),
    }
    let words: Vec<String> = std::env::args().skip(1).collect();
    let command = format!("cargo run --release -p bevy_medial_compare --bin speed_accuracy -- {}", words.join(" "));
    report::write_all(&args.out, &command, &args.models, &rows, &scene_rows, &batches)?;
    println!("written to {}", args.out.display());
    Ok(())
}
