//! Stability: situations in which collision methods fail, and the pass rate of each method.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin stability -- [--out DIR] [--quick] [--hazard NAME] [--method NAME] [--list]
//! ```
//!
//! Each hazard has a physical criterion, the same for all methods, and is run with one or more seeds. Without `--out`, the table is only printed.
//! The run fails if this crate fails anywhere.

mod report;

use std::{path::PathBuf, process::ExitCode};

use bevy_medial::gpu::GpuDevice;
use bevy_medial_compare::{
    outcome,
    stability::{hazards, methods::METHODS, run},
};
use clap::Parser;

#[derive(Parser)]
#[command(about = "Hazards in which collision methods fail")]
struct Args {
    /// Fewer seeds, no pile of 60 s, and no software GPU.
    #[arg(long)]
    quick: bool,
    /// Run only hazards whose name contains this text.
    #[arg(long)]
    hazard: Option<String>,
    /// Run only methods whose name contains this text.
    #[arg(long)]
    method: Option<String>,
    /// Folder for the table of all runs, the report and the chart.
    #[arg(long)]
    out: Option<PathBuf>,
    /// List hazards and methods.
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    outcome::of(compare(&Args::parse()))
}

fn compare(args: &Args) -> Result<(), String> {
    let mut hazards = hazards::all();
    if args.list {
        hazards.iter().for_each(|hazard| println!("{:24} {}", hazard.name, hazard.criterion));
        METHODS.iter().for_each(|method| println!("method {:17} {}", method.name, method.about));
        return Ok(());
    }
    let is_wanted = |part: &Option<String>, name: &str| part.as_deref().is_none_or(|part| name.contains(part));
    hazards.retain(|hazard| is_wanted(&args.hazard, hazard.name) && hazard.seeds[usize::from(!args.quick)] > 0);
    let mut methods = METHODS.to_vec();
    methods.retain(|method| is_wanted(&args.method, method.name));
    if methods.iter().any(|method| method.needs_adapter) {
        match GpuDevice::request() {
            Ok(device) if args.quick && device.is_software() => {
                println!("without the GPU, because the adapter is a software adapter: {}", device.name());
                methods.retain(|method| !method.needs_adapter);
            }
            Ok(device) => println!("GPU: {}", device.name()),
            Err(error) => {
                println!("without the GPU: {error}");
                methods.retain(|method| !method.needs_adapter);
            }
        }
    }
    let cells = run::all(&hazards, &methods, args.quick);
    let words: Vec<String> = std::env::args().skip(1).collect();
    let command = format!("cargo run --release -p bevy_medial_compare --bin stability -- {}", words.join(" "));
    let report = report::Report { hazards: &hazards, methods: &methods, cells: &cells, command: command.trim() };
    println!("{}", report.table());
    println!("{}", report.faults());
    if let Some(folder) = &args.out {
        report.write(folder)?;
    }
    let failed = cells.iter().filter(|cell| methods[cell.method].is_ours && cell.passed() < cell.results.len());
    match failed.count() {
        0 => Ok(()),
        failed => Err(format!("this crate fails in {failed} cells")),
    }
}
