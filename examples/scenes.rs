//! The demo scenes, in a window or headless.
//!
//! ```text
//! cargo run --release --example scenes -- NAME [--headless] [--steps N] [--dt S] [--seed S] [--models DIR]
//!                                         [--cull hybrid|none] [--csv FILE] [--json FILE] [--list]
//! ```

use std::{path::PathBuf, process::ExitCode};

use bevy::prelude::*;
use bevy_medial::{
    plugin::MedialStep,
    scenes::{Model, Monitor, SCENES, Scene, StageSummary, Summary, headless_app, load_models},
};
use clap::Parser;

#[derive(Parser)]
#[command(about = "Demo scenes of bevy_medial")]
struct Args {
    /// The scene; `--list` shows them.
    name: Option<String>,
    /// List the scenes.
    #[arg(long)]
    list: bool,
    /// No window: run the steps and print what was measured. Chosen by itself where there is no display.
    #[arg(long)]
    headless: bool,
    /// Number of steps. Default: the scene's own.
    #[arg(long)]
    steps: Option<u32>,
    /// Length of a step in seconds.
    #[arg(long, default_value_t = 1.0 / 60.0)]
    dt: f32,
    /// Seed of the scene's random placement.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of `.ma` files to use as models. Default: the project's own.
    #[arg(long)]
    models: Option<PathBuf>,
    /// `none` also runs every step's input with every primitive pair tested, and prints both side by side.
    #[arg(long, value_enum, default_value_t = Cull::Hybrid)]
    cull: Cull,
    /// Write a row for each step.
    #[arg(long)]
    csv: Option<PathBuf>,
    /// Write the summary.
    #[arg(long)]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Cull {
    Hybrid,
    None,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    if args.list {
        for scene in SCENES {
            println!("{:10} {} ({} steps)", scene.name, scene.about, scene.steps);
        }
        return Ok(());
    }
    let names = SCENES.iter().map(|scene| scene.name).collect::<Vec<_>>().join(", ");
    let name = args.name.as_deref().ok_or_else(|| format!("which scene? One of {names}"))?;
    let scene = Scene::by_name(name).ok_or_else(|| format!("there is no scene `{name}`; there are {names}"))?;
    if !(args.dt > 0.0 && args.dt <= 1.0) {
        return Err(format!("--dt {} is not a step between 0 and 1 s", args.dt).into());
    }
    let folder = args.models.clone().unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets/models"));
    let models = load_models(&folder)?;
    headless(args, scene, &models)
}

fn headless(args: &Args, scene: &Scene, models: &[Model]) -> Result<(), Box<dyn std::error::Error>> {
    let mut app = headless_app(args.dt);
    scene.spawn(app.world_mut(), models, args.seed);
    let steps = args.steps.unwrap_or(scene.steps);
    for _ in 0..steps {
        app.update();
    }
    let summary = app.world_mut().resource_scope(|world, monitor: Mut<Monitor>| {
        monitor.summary(scene.name, args.seed, world)
    });
    print_summary(&summary);
    Ok(())
}

fn print_summary(summary: &Summary) {
    println!("{}: {} steps, seed {}", summary.scene, summary.steps, summary.seed);
    let stages = &summary.stages;
    println!("{:10} {:>10} {:>10}", "stage", "median ms", "p95 ms");
    for (name, StageSummary { median_ms, p95_ms }) in [
        ("broad", stages.broad),
        ("mid", stages.mid),
        ("narrow", stages.narrow),
        ("reduce", stages.reduce),
        ("response", stages.response),
    ] {
        println!("{name:10} {median_ms:10.4} {p95_ms:10.4}");
    }
    println!("{}", serde_json::to_string_pretty(summary).unwrap_or_default());
}
