//! Compares the demo scenes with medial meshes and in other engines: rapier alone and avian, with convex decompositions, hulls and
//! triangle meshes. Also compares the culling with its baselines.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin peers -- [--quick] [--scene NAME] [--engine NAME] [--runs N] [--out DIR] [--list]
//! ```
//!
//! Without `--out`, tables are only printed. `--quick` is a short test of the program: it runs a few steps of each scene, without the shapes that take
//! long to prepare.
//!
//! The process is bound to one core. Rapier alone has one thread, and the threads of Bevy's pools share the core.

mod report;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_medial::{
    builder,
    prelude::MedialBudget,
    scenes::{Model, Scene, headless_app, load_models, set_budget},
};
use bevy_medial_compare::{
    culling::{Comparison, Cull},
    demo::{Demo, SEED, SceneModel},
    engines::{Avian, Ccd, Engine, Medial, Rapier, Variant},
    measure::{self, Plan, Row, ShapeFigures},
    outcome,
    overlap::Surfaces,
    stand_in::{Kind, ModelShape, Shapes, stand_ins, worst},
};
use clap::Parser;
use report::Culling;

#[derive(Parser)]
#[command(about = "The demo scenes in several engines")]
struct Args {
    /// A few steps of each scene: a short test of the program.
    #[arg(long)]
    quick: bool,
    /// Run only this scene.
    #[arg(long)]
    scene: Option<String>,
    /// Run only engines whose name contains this text. `culling` selects the baselines of culling.
    #[arg(long)]
    engine: Option<String>,
    /// Number of runs of each engine and scene. The fastest run of each step counts, which reduces the influence of other programs
    /// on the machine.
    #[arg(long, default_value_t = 3)]
    runs: usize,
    /// Folder for the tables.
    #[arg(long)]
    out: Option<PathBuf>,
    /// List scenes and engines.
    #[arg(long)]
    list: bool,
}

/// The scenes. For the comparison of culling, each has a budget in percent at which bodies have about as many primitives as in the paper: 0.3 to
/// 2 million pairs in total. The pile has more pairs at any budget, so its culling is not compared.
const SCENES: [(&str, Option<f64>); 5] =
    [("rods", Some(0.4)), ("tori", Some(0.5)), ("stairs", Some(0.6)), ("dinosaur", Some(0.6)), ("pile", None)];

/// The default budget of bodies, in percent.
const DEFAULT_PERCENT: f64 = 1.0;

/// An engine with its shapes.
enum Setup {
    /// With the default budget.
    Medial,
    /// With a budget of half the max error of the decompositions in the scene.
    MedialOfHalfTheError,
    Rapier(Kind, Ccd),
    Avian,
}

const SETUPS: [(&str, Setup); 9] = [
    ("medial meshes", Setup::Medial),
    ("medial meshes, half the error", Setup::MedialOfHalfTheError),
    ("rapier, decomposition", Setup::Rapier(Kind::Decomposition, Ccd::Default)),
    ("rapier, decomposition, bullets", Setup::Rapier(Kind::Decomposition, Ccd::Bullets)),
    ("rapier, decomposition, no CCD", Setup::Rapier(Kind::Decomposition, Ccd::Off)),
    ("rapier, fine decomposition", Setup::Rapier(Kind::FineDecomposition, Ccd::Default)),
    ("rapier, hull", Setup::Rapier(Kind::Hull, Ccd::Default)),
    ("rapier, triangle mesh", Setup::Rapier(Kind::TriMesh, Ccd::Default)),
    ("avian, decomposition", Setup::Avian),
];

const CULLS: [Cull; 4] = [Cull::None, Cull::BvhObb, Cull::BvhSphere, Cull::BvhAabb];

/// Length of a step in seconds.
const DT: f32 = 1.0 / 60.0;

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), String> {
    let names = SCENES.map(|(name, _)| name);
    if args.list {
        println!("scenes: {}", names.join(", "));
        SETUPS.iter().for_each(|(name, _)| println!("engine: {name}"));
        return Ok(());
    }
    if let Some(name) = args.scene.as_deref().filter(|name| !names.contains(name)) {
        return Err(format!("there is no scene `{name}` here; the scenes are {}", names.join(", ")));
    }
    measure::bind_to_one_core();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/models");
    let models = load_models(&folder).map_err(|error| error.to_string())?;
    let (mut peers, mut culling) = (Vec::new(), Vec::new());
    let mut shapes = Shapes::default();
    for (name, percent) in SCENES.iter().filter(|(name, _)| args.scene.as_deref().is_none_or(|only| only == *name)) {
        let Some(scene) = Scene::by_name(name) else { continue };
        run_scene(args, scene, &models, &folder, &mut shapes, &mut peers)?;
        for percent in percent.iter().flat_map(|&percent| [DEFAULT_PERCENT, percent]) {
            culling.extend(run_culling(args, scene, &models, percent)?);
        }
    }
    let words: Vec<String> = std::env::args().skip(1).collect();
    let command = format!("cargo run --release -p bevy_medial_compare --bin peers -- {}", words.join(" "));
    match &args.out {
        Some(folder) => report::write_all(folder, &command, &peers, &culling),
        None => Ok(()),
    }
}

/// Number of steps of a scene.
fn steps(args: &Args, scene: &Scene) -> usize {
    // After 50 steps, bodies touch in every scene.
    if args.quick { 50.min(scene.steps as usize) } else { scene.steps as usize }
}

fn is_wanted(args: &Args, name: &str) -> bool {
    args.engine.as_deref().is_none_or(|part| name.contains(part))
}

fn run_scene(
    args: &Args,
    scene: &Scene,
    models: &[Model],
    folder: &Path,
    shapes: &mut Shapes,
    rows: &mut Vec<Row>,
) -> Result<(), String> {
    let demo = &Demo::new(scene, models, folder, DT)?;
    let surfaces = Surfaces::new(demo)?;
    for (name, setup) in &SETUPS {
        let slow = matches!(setup, Setup::Rapier(Kind::FineDecomposition, _));
        let same =
            matches!(setup, Setup::Rapier(_, Ccd::Bullets)) && !demo.bodies.iter().any(|body| body.body.is_bullet());
        if !is_wanted(args, name) || (args.quick && slow) || same {
            continue;
        }
        type Make<'a> = Box<dyn Fn() -> Result<Box<dyn Engine>, String> + 'a>;
        let (figures, make): (ShapeFigures, Make) = match setup {
            Setup::Medial | Setup::MedialOfHalfTheError => {
                let budget = match setup {
                    Setup::Medial => MedialBudget::default(),
                    _ => {
                        let made = shapes.of_demo(Kind::Decomposition, demo);
                        MedialBudget::Percent(0.5 * hull_figures(&made).error.max)
                    }
                };
                let engine = move || Medial::new(demo.setup, Variant::Cpu).with_budget(budget);
                (medial_figures(demo, budget), Box::new(move || demo.fill(engine(), &[])))
            }
            Setup::Rapier(kind, ccd) => {
                let made = shapes.of_demo(*kind, demo);
                let parts = stand_ins(&made);
                (hull_figures(&made), Box::new(move || demo.fill(Rapier::new(demo.setup, *ccd), &parts)))
            }
            Setup::Avian => {
                let made = shapes.of_demo(Kind::Decomposition, demo);
                let parts = stand_ins(&made);
                (hull_figures(&made), Box::new(move || demo.fill(Avian::new(demo.setup), &parts)))
            }
        };
        let plan = Plan { steps: steps(args, scene), runs: if args.quick { 1 } else { args.runs } };
        let row = measure::run((scene.name, name), demo, &surfaces, figures, &*make, plan)?;
        println!(
            "{:9} {name:34} {:3} active: collision {:8.3} ms, step {:8.3} ms; sums {:6.0}, {:6.0} ms; overlap {:6.2} %, {} of {} lost",
            row.scene,
            row.active_steps,
            row.collision_active_ms,
            row.step_active_ms,
            row.collision_sum_ms,
            row.step_sum_ms,
            row.overlap_max_percent,
            row.lost,
            row.bodies
        );
        rows.push(row);
    }
    Ok(())
}

/// Figures of the medial meshes at the levels of detail that the budget selects.
fn medial_figures(demo: &Demo, budget: MedialBudget) -> ShapeFigures {
    let count = demo.models.len().max(1);
    let level = |model: &SceneModel| model.axis.level(budget.level(&model.axis, 1.0)).clone();
    let errors = demo.models.iter().map(|model| builder::measure(&model.mesh, &level(model)).mesh_to_envelope);
    let parts: usize = demo.models.iter().map(|model| level(model).primitives().len()).sum();
    ShapeFigures { parts: parts as f64 / count as f64, error: worst(errors) }
}

fn hull_figures(made: &[ModelShape]) -> ShapeFigures {
    let parts: usize = made.iter().map(|shape| shape.parts).sum();
    ShapeFigures { parts: parts as f64 / made.len().max(1) as f64, error: worst(made.iter().map(|shape| shape.error)) }
}

/// Compares the hybrid culling with each baseline in a scene.
fn run_culling(args: &Args, scene: &Scene, models: &[Model], budget_percent: f64) -> Result<Vec<Culling>, String> {
    let mut rows = Vec::new();
    for cull in CULLS.into_iter().filter(|_| is_wanted(args, "culling")) {
        let Some(mut comparison) = Comparison::with(cull) else { continue };
        let mut app = headless_app(DT);
        set_budget(&mut app, MedialBudget::Percent(budget_percent as f32));
        scene.spawn(app.world_mut(), models, SEED);
        for _ in 0..steps(args, scene) {
            app.update();
            comparison.run(app.world())?;
        }
        let report = comparison.report(app.world());
        println!("{}, budget {budget_percent} %, culling: {report}", scene.name);
        rows.push(Culling { scene: scene.name, budget_percent, report });
    }
    Ok(rows)
}
