use std::path::PathBuf;

use bevy_medial::{
    builder::{MeshReport, TriangleMesh, TwoSidedError},
    medial_axis::MedialAxis,
};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Outcome, load_mesh, write_axis};

#[derive(clap::Args)]
pub struct Args {
    /// The triangle mesh.
    mesh: PathBuf,
    /// Where to write the medial mesh.
    #[arg(short, long, value_name = "OUT.ma")]
    output: PathBuf,
    /// Most spheres of the finest level.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spheres: Option<u32>,
    /// Greatest error of the finest level, either way, in percent of the mesh's diagonal.
    #[arg(long, value_name = "PERCENT", value_parser = percent)]
    max_error: Option<f32>,
    /// Write all levels of detail, finest first: OUT.ma, OUT.1.ma, OUT.2.ma, ...
    #[arg(long)]
    levels: bool,
    /// The same seed gives the same result.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

fn percent(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "not a positive number".into())
}

pub fn run(args: &Args) -> Outcome {
    let mesh = load_mesh(&args.mesh)?;
    let mut text = String::new();
    for flaw in MeshReport::new(&mesh).flaws() {
        text += &format!("warning: {}: {flaw}\n", args.mesh.display());
    }
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} {wide_bar} {percent} %") {
        bar.set_style(style);
    }
    let levels = build(&mesh, args, &|fraction| bar.set_position((fraction * 1000.0) as u64));
    bar.finish_and_clear();
    let count = if args.levels { usize::MAX } else { 1 };
    for (number, (axis, error)) in levels?.iter().enumerate().take(count) {
        let path = match number {
            0 => args.output.clone(),
            _ => args.output.with_extension(format!("{number}.ma")),
        };
        write_axis(&path, axis)?;
        text += &format!("{}: {} spheres, {error}\n", path.display(), axis.spheres().len());
    }
    Ok(text)
}

/// The levels of detail, finest first, with their errors.
fn build(
    _mesh: &TriangleMesh,
    Args { spheres: _, max_error: _, seed: _, .. }: &Args,
    _progress: &dyn Fn(f32),
) -> Result<Vec<(MedialAxis, TwoSidedError)>, String> {
    Err("this program has no builder".into())
}
