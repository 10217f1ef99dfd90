use std::{
    ops::ControlFlow,
    path::{Path, PathBuf},
};

use bevy_medial::builder::{DEFAULT_SEED, FitOptions, Level, MeshReport, fit, load::MeshFormat};
use indicatif::{ProgressBar, ProgressStyle};

use super::{Outcome, info, load_mesh, write_axis};

#[derive(clap::Args)]
pub struct Args {
    /// The triangle mesh.
    mesh: PathBuf,
    /// Where to write the medial mesh.
    #[arg(short, long, value_name = "OUT.ma")]
    output: PathBuf,
    /// Largest number of spheres of the finest level.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spheres: Option<u32>,
    /// Largest error of the finest level, in either direction, in percent of the mesh's diagonal.
    #[arg(long, value_name = "PERCENT", value_parser = percent)]
    max_error: Option<f32>,
    /// Also write all levels of detail with their errors beside the finest level: OUT.medial.
    #[arg(long)]
    levels: bool,
    /// Number of searches for each level; the best result is used. More searches give a better result and take longer. Default: one or two for the
    /// finest level (shorter ones with fewer than 100 triangles per sphere), up to four for levels of few spheres.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    searches: Option<u32>,
    /// The same seed gives the same result.
    #[arg(long, default_value_t = DEFAULT_SEED)]
    seed: u64,
}

fn percent(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "not a positive number".into())
}

/// Checks the output path before the work, which would fail or overwrite a triangle mesh.
pub fn check_output(output: &Path) -> Result<(), String> {
    if info::has_levels(output) {
        let text = output.with_extension("ma");
        return Err(format!(
            "{}: the output is the finest level, as text: name it {}; --levels writes the .medial file beside it",
            output.display(),
            text.display()
        ));
    }
    if output.is_dir() || output.as_os_str().to_string_lossy().ends_with(std::path::is_separator) {
        return Err(format!("{}: it is a folder; name a file in it", output.display()));
    }
    if MeshFormat::of(output).is_some() {
        let named = output.with_extension("ma");
        return Err(format!("{}: that is the name of a triangle mesh; name it {}", output.display(), named.display()));
    }
    match output.parent() {
        Some(folder) if folder != Path::new("") && !folder.is_dir() => {
            Err(format!("{}: there is no such folder; make it first", folder.display()))
        }
        _ => Ok(()),
    }
}

/// Returns the path of the file with all levels.
fn beside(output: &Path) -> PathBuf {
    if output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ma")) {
        output.with_extension("medial")
    } else {
        // Another extension is a part of the name.
        let mut name = output.as_os_str().to_owned();
        name.push(".medial");
        name.into()
    }
}

pub fn run(args: &Args) -> Outcome {
    let mesh = load_mesh(&args.mesh)?;
    check_output(&args.output)?;
    // Printed first, because a flaw may explain why the build fails.
    for flaw in MeshReport::new(&mesh).flaws() {
        eprintln!("warning: {}: {flaw}", args.mesh.display());
    }
    let mut text = String::new();
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} {wide_bar} {percent} %") {
        bar.set_style(style);
    }
    let options = FitOptions {
        spheres: args.spheres.map(|spheres| spheres as usize),
        max_error: args.max_error,
        levels: args.levels,
        searches: args.searches.map(|searches| searches as usize),
        seed: args.seed,
    };
    let levels = fit(&mesh, &options, &|fraction| {
        bar.set_position((fraction * 1000.0) as u64);
        ControlFlow::Continue(())
    });
    bar.finish_and_clear();
    let chain = levels.map_err(|error| format!("{}: {error}", args.mesh.display()))?;
    for (number, Level { axis, error }) in chain.levels.iter().enumerate() {
        text += &format!("level {number}: {} spheres, {error}\n", axis.spheres().len());
    }
    if let Some(finest) = chain.levels.first() {
        if let Some(asked) = args.max_error.filter(|asked| finest.error.max() > *asked) {
            eprintln!("warning: {}: the error is more than {asked} %; allow more spheres", args.mesh.display());
        }
        write_axis(&args.output, &finest.axis)?;
    }
    if args.levels {
        chain.save(&beside(&args.output)).map_err(|error| error.to_string())?;
    }
    Ok(text)
}
