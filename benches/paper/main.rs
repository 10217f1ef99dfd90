//! The tables and figures of the paper beside those of this crate.
//!
//! ```text
//! cargo bench --bench paper -- [--quick] [--scene NAME] [--out DIR]
//! ```
//!
//! Runs the scenes of the paper with about as many primitive pairs as there. In each frame, the same input is run again with the hybrid culling, with trees
//! of bounding volumes, without culling, and with the paper's own method. Also compares the paper's criteria with those of this crate on random input.
//!
//! The process is bound to one core.

mod chains;
mod device;
mod hierarchies;
mod page;
mod report;
mod scenes;
mod techniques;
mod times;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_medial::{
    builder::{TwoSidedError, load::load, measure},
    geometry::Primitive,
    medial_axis::MedialAxis,
    scenes::{Model, load_models},
};
use bevy_medial_compare::{
    measure::bind_to_one_core,
    outcome,
    paper::{conic, slabs},
    tables,
};
use clap::Parser;

#[derive(Parser)]
#[command(about = "The tables and figures of the paper beside those of this crate")]
struct Args {
    /// A few frames of each scene at a coarse level, and fewer random cases: a short test of the program.
    #[arg(long)]
    quick: bool,
    /// Run only this scene.
    #[arg(long)]
    scene: Option<String>,
    /// Folder for the page, its tables and charts. Without it, figures are only printed.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Passed by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A row of Table 1 of the paper: name, triangles, cones, slabs, and the distance from the mesh to the medial mesh in percent.
const TABLE_1: [(&str, [usize; 3], f64); 10] = [
    ("deer", [16_932, 100, 42], 2.02),
    ("cow", [19_324, 163, 80], 1.03),
    ("armadillo", [86_382, 210, 116], 1.21),
    ("bear", [20_278, 119, 60], 0.61),
    ("bug", [17_276, 61, 17], 0.47),
    ("dolphin", [10_506, 121, 62], 0.55),
    ("spider", [22_098, 56, 7], 0.71),
    ("bunny", [69_630, 201, 125], 1.10),
    ("dinosaur", [30_000, 318, 170], 0.78),
    ("torus", [1152, 26, 0], 0.03),
];

/// A model at the level of detail whose number of primitives is nearest to that of the paper.
struct ModelRow {
    name: &'static str,
    /// Triangles, cones and slabs in the paper, and here.
    paper: [usize; 3],
    ours: [usize; 3],
    paper_error: f64,
    error: TwoSidedError,
}

/// All results of a run.
struct Findings {
    models: Vec<ModelRow>,
    criteria: (slabs::Verdicts, conic::Verdicts),
    hierarchies: Vec<hierarchies::HierarchyRow>,
    chains: Vec<chains::ChainRow>,
    scenes: Vec<scenes::SceneResult>,
    /// Name of the adapter, and a row for each scene.
    device: Option<(String, Vec<device::DeviceRow>)>,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), String> {
    // The number of threads is that before the binding.
    let machine = tables::machine();
    bind_to_one_core();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models");
    let models = load_models(&folder).map_err(|error| error.to_string())?;
    if let Some(name) = args.scene.as_deref().filter(|name| scenes::SCENES.iter().all(|scene| scene.name != *name)) {
        let names = scenes::SCENES.map(|scene| scene.name).join(", ");
        return Err(format!("the paper has no scene `{name}`; its scenes are {names}"));
    }
    let cases = if args.quick { 20_000 } else { 1_000_000 };
    let criteria = (slabs::compare(cases, 1), conic::compare(cases, 2));
    println!("{criteria:#?}");
    let table = TABLE_1.iter().map(|row| model_row(row, &models, &folder)).collect::<Result<Vec<_>, _>>()?;
    let hierarchies = hierarchies::rows(
        &TABLE_1.iter().filter_map(|&(name, paper, _)| axis(&models, name, paper)).collect::<Vec<_>>(),
        args.quick,
    );
    hierarchies.iter().for_each(|row| println!("{row:?}"));
    let chains = chains::rows(&models, args.quick);
    chains.iter().for_each(|row| println!("{}, {} steps: {:?}", row.name, row.look_ahead, row.pairs));
    let mut results = Vec::new();
    for scene in scenes::SCENES.iter().filter(|scene| args.scene.as_deref().is_none_or(|only| only == scene.name)) {
        let result = scenes::run(scene, &models, args.quick)?;
        println!("{}", report::summary(&result));
        results.push(result);
    }
    let device = match device::Device::request() {
        Some(mut device) => {
            let rows =
                results.iter().map(|result| device.run((result.scene.name, result.busiest.0), &result.busiest.1));
            let rows = rows.collect::<Result<Vec<_>, _>>()?;
            Some((device.name, rows.into_iter().flatten().collect()))
        }
        None => None,
    };
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let command = format!("cargo bench --bench paper -- {}", words.join(" "));
    let findings = Findings { models: table, criteria, hierarchies, chains, scenes: results, device };
    match &args.out {
        Some(out) => report::write_all(out, [&machine, &command], &findings),
        None => Ok(()),
    }
}

/// The model at the level of detail whose number of primitives is nearest to that of the paper.
fn axis(models: &[Model], name: &str, [_, cones, slabs]: [usize; 3]) -> Option<MedialAxis> {
    let model = models.iter().find(|model| model.name == name)?;
    let count = |number: usize| model.axis.level(number).primitives().len();
    let level = (0..=model.axis.coarser().len()).min_by_key(|&number| count(number).abs_diff(cones + slabs))?;
    Some(model.axis.level(level).clone())
}

fn model_row(
    &(name, paper, paper_error): &(&'static str, [usize; 3], f64),
    models: &[Model],
    folder: &Path,
) -> Result<ModelRow, String> {
    let axis = axis(models, name, paper).ok_or_else(|| format!("there is no model `{name}`"))?;
    let mesh = load(&folder.join(name).with_extension("obj")).map_err(|error| error.to_string())?;
    let of_kind = |is: fn(&Primitive) -> bool| axis.primitives().iter().filter(|primitive| is(primitive)).count();
    let cones = of_kind(|primitive| matches!(primitive, Primitive::Cone(_)));
    let slabs = of_kind(|primitive| matches!(primitive, Primitive::Slab(_)));
    let ours = [mesh.triangles.len(), cones, slabs];
    Ok(ModelRow { name, paper, ours, paper_error, error: measure(&mesh, &axis) })
}
