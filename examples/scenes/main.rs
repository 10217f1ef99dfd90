//! The demo scenes, in a window or headless.
//!
//! ```text
//! cargo run --release --example scenes -- NAME [--headless] [--steps N] [--dt S] [--seed S] [--models DIR]
//!                                         [--budget PERCENT] [--backend auto|cpu|gpu]
//!                                         [--cull hybrid|none|bvh-obb|bvh-sphere|bvh-aabb|bvh-medial]
//!                                         [--csv FILE] [--json FILE] [--list]
//!                                         [--screenshot FILE] [--frames DIR] [--movie FILE] [--overlay] [--layers NAME,NAME]
//! ```

#[path = "../common/mod.rs"]
mod common;
mod control;
mod grab;
mod offscreen;
mod overlay;
mod panel;
mod view;

use std::{
    fmt::Write,
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy::prelude::*;
use bevy_medial::{
    prelude::*,
    scenes::{Model, Monitor, Row, SCENES, Scene, StageSummary, Summary, headless_app, load_models, set_budget},
};
use bevy_medial_compare::{
    culling::{Comparison, Cull},
    outcome,
};
use clap::{Parser, ValueEnum};
use common::display::has_display;
use indicatif::ProgressBar;
use view::Show;

/// Size of pictures, in pixels.
const PICTURE: UVec2 = UVec2::new(1280, 720);

/// Size of movies, in pixels.
const MOVIE: UVec2 = UVec2::new(528, 297);

#[derive(Parser)]
#[command(about = "Demo scenes of bevy_medial")]
struct Args {
    /// Name of the scene. `--list` prints all names.
    name: Option<String>,
    /// List the scenes.
    #[arg(long)]
    list: bool,
    /// Run the steps without a window and print the measurements. Implied if there is no display.
    #[arg(long)]
    headless: bool,
    /// Number of steps. Default: the number of the scene.
    #[arg(long)]
    steps: Option<u32>,
    /// Length of a step in seconds.
    #[arg(long, default_value_t = 1.0 / 60.0)]
    dt: f32,
    /// Seed of the scene's random placement.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of `.medial` or `.ma` files to use as models. Default: `assets/models`.
    #[arg(long)]
    models: Option<PathBuf>,
    /// Back end that culls pairs.
    #[arg(long, value_enum, default_value_t = Backend::Auto)]
    backend: Backend,
    /// Max error of bodies, in percent of their diagonal: the coarsest level of detail within it is used.
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, value_parser = percent)]
    budget: f32,
    /// Also run every step's input with another culling, and print both side by side.
    #[arg(long, value_enum, default_value_t = Cull::Hybrid)]
    cull: Cull,
    /// Write a row for each step.
    #[arg(long)]
    csv: Option<PathBuf>,
    /// Write the summary.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Run the steps, write a picture of the last one as PNG and exit. Needs a graphics adapter (a software adapter is enough), but no display.
    #[arg(long)]
    screenshot: Option<PathBuf>,
    /// Write a picture of every step, `0001.png` and so on, into a folder and exit. Needs a graphics adapter, but no display.
    #[arg(long, value_name = "DIR", conflicts_with = "screenshot")]
    frames: Option<PathBuf>,
    /// Run the steps, write an animated GIF of every third one and exit. Needs a graphics adapter, but no display.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["screenshot", "frames"])]
    movie: Option<PathBuf>,
    /// Show the figures and the graph of the window in pictures.
    #[arg(long)]
    overlay: bool,
    /// Layers of the debug view to start with: spheres, cones, slabs, levels, boxes, hierarchy, swept-cones, candidates, contacts, stops.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = view::layer_name)]
    layers: Vec<String>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Backend {
    Auto,
    Cpu,
    Gpu,
}

impl From<Backend> for MedialBackend {
    fn from(backend: Backend) -> Self {
        match backend {
            Backend::Auto => MedialBackend::Auto,
            Backend::Cpu => MedialBackend::Cpu,
            Backend::Gpu => MedialBackend::Gpu,
        }
    }
}

fn percent(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|value: &f32| *value >= 0.0).ok_or_else(|| "not a number of 0 or more".into())
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    if args.list {
        for scene in SCENES {
            println!("{:10} {} ({} steps)", scene.name, scene.about, scene.steps);
        }
        return Ok(());
    }
    let names = SCENES.iter().map(|scene| scene.name).collect::<Vec<_>>().join(", ");
    let name = args.name.as_deref().ok_or_else(|| format!("name a scene: one of {names}"))?;
    let scene = Scene::by_name(name).ok_or_else(|| format!("there is no scene `{name}`; the scenes are {names}"))?;
    if !(args.dt > 0.0 && args.dt <= 1.0) {
        return Err(format!("--dt {} is not a step between 0 and 1 s", args.dt).into());
    }
    let folder = args.models.clone().unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets/models"));
    let models = load_models(&folder)?;
    let steps = args.steps.unwrap_or(scene.steps);
    let backend = args.backend.into();
    let show = || Show {
        scene,
        models: models.clone(),
        seed: args.seed,
        dt: args.dt,
        backend,
        budget_percent: args.budget,
        level: None,
        folder: folder.clone(),
        overlay: args.overlay,
        layers: args.layers.clone(),
    };
    if let Some(file) = &args.screenshot {
        return Ok(offscreen::screenshot(show(), steps, PICTURE, file)?);
    }
    if let Some(folder) = &args.frames {
        return Ok(offscreen::frames(show(), steps, PICTURE, folder)?);
    }
    if let Some(file) = &args.movie {
        return Ok(offscreen::movie(show(), steps, MOVIE, file)?);
    }
    // With these options the program runs the steps and exits, so it opens no window.
    let wants_figures = args.csv.is_some() || args.json.is_some() || args.cull != Cull::Hybrid || args.steps.is_some();
    if args.headless || wants_figures || !has_display() {
        return headless(args, scene, &models);
    }
    view::window(show());
    Ok(())
}

fn headless(args: &Args, scene: &Scene, models: &[Model]) -> Result<(), Box<dyn std::error::Error>> {
    let mut app = headless_app(args.dt);
    app.world_mut().resource_mut::<MedialSettings>().backend = args.backend.into();
    set_budget(&mut app, MedialBudget::Percent(args.budget));
    scene.spawn(app.world_mut(), models, args.seed);
    let steps = args.steps.unwrap_or(scene.steps);
    let progress = ProgressBar::new(steps.into());
    let mut comparison = Comparison::with(args.cull);
    for _ in 0..steps {
        app.update();
        if let Some(comparison) = &mut comparison {
            comparison.run(app.world())?;
        }
        progress.inc(1);
    }
    progress.finish_and_clear();
    let summary =
        app.world_mut().resource_scope(|world, monitor: Mut<Monitor>| monitor.summary(scene.name, args.seed, world));
    print_summary(&summary);
    let rows = &app.world().resource::<Monitor>().rows;
    if let Some(comparison) = &comparison {
        println!("\n{}", comparison.report(app.world()));
    }
    if let Some(path) = &args.csv {
        write_csv(path, rows).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&summary)?;
        std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(())
}

/// Writes a header with the field names of [`Row`], and a line for each step.
fn write_csv(path: &Path, rows: &[Row]) -> Result<(), Box<dyn std::error::Error>> {
    let mut text = String::new();
    for (step, row) in rows.iter().enumerate() {
        let serde_json::Value::Object(fields) = serde_json::to_value(row)? else { continue };
        if step == 0 {
            let names: Vec<&str> = fields.keys().map(String::as_str).collect();
            writeln!(text, "step,{}", names.join(","))?;
        }
        let values: Vec<String> = fields.values().map(ToString::to_string).collect();
        writeln!(text, "{step},{}", values.join(","))?;
    }
    Ok(std::fs::write(path, text)?)
}

fn print_summary(summary: &Summary) {
    println!("{}: {} steps, seed {}", summary.scene, summary.steps, summary.seed);
    let stages = &summary.stages;
    println!("\n{:10} {:>10} {:>10}", "stage", "median ms", "p95 ms");
    for (name, StageSummary { median_ms, p95_ms }) in [
        ("broad", stages.broad),
        ("mid", stages.mid),
        ("narrow", stages.narrow),
        ("stop", stages.stop),
        ("contacts", stages.contact_search),
        ("response", stages.response),
    ] {
        println!("{name:10} {median_ms:10.4} {p95_ms:10.4}");
    }
    let counts = &summary.counts;
    println!("\n{:26} {:>10} {:>10}", "count", "median", "most");
    for (name, median, most) in [
        ("bodies", counts.bodies, counts.bodies),
        ("primitive pairs in total", counts.primitive_pairs, counts.primitive_pairs),
        ("body pairs", counts.body_pairs, counts.body_pairs_max),
        ("candidate primitive pairs", counts.candidates, counts.candidates_max),
        ("time of impact tests", counts.toi_tests, counts.toi_tests_max),
        ("contacts", counts.contacts, counts.contacts_max),
    ] {
        println!("{name:26} {median:10} {most:10}");
    }
    println!();
    println!("deepest overlap  {:.3} % of a body's size", summary.deepest_overlap_percent);
    println!("lowest point     {:.4} m", summary.lowest_y);
    println!(
        "kinetic energy   {:.2e} J/kg at the end, {} of {} asleep",
        summary.kinetic_energy_per_kg, summary.asleep, summary.bodies
    );
    println!("escaped {}, tunnelled {}, ghosts {}", summary.escaped, summary.tunnelled, summary.ghosts);
}
