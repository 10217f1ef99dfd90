//! Builds, measures and cleans medial meshes: `medial --help`.

mod build;
mod files;
mod info;
mod rows;
mod scene;

use std::{
    fmt::Write as _,
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_medial::{builder::measure, medial_axis::MedialAxis};
use clap::{Parser, Subcommand};

use files::{Content, at, check_output, is_levels, load_mesh};
use rows::{Percent, Row, json};

#[derive(Parser)]
#[command(version, about = "Builds, measures and cleans medial meshes")]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Builds a medial mesh from a triangle mesh (OBJ, glTF, STL, PLY).
    Build(build::Args),
    /// Prints the two-sided error of medial meshes in percent of the triangle mesh's diagonal.
    Measure {
        /// The triangle mesh.
        mesh: PathBuf,
        /// The medial meshes (.ma, or .medial with a row for each level).
        #[arg(required = true)]
        medial: Vec<PathBuf>,
        /// Measure against the triangle mesh with flat caps over its holes, as `build` does.
        #[arg(long)]
        close_holes: bool,
        /// Print a JSON object per line for each row. Lengths are in metres, errors in percent.
        #[arg(long)]
        json: bool,
    },
    /// Describes medial meshes (.ma), levels of detail (.medial), or triangle meshes and their flaws.
    Info {
        /// The files. An error in one of them does not affect the others.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// Print a JSON object per line for each mesh or level. Lengths are in metres.
        #[arg(long)]
        json: bool,
    },
    /// Writes a medial mesh without degenerate, duplicate and covered parts, which fills the same volume.
    Clean {
        /// The medial mesh (.ma).
        medial: PathBuf,
        /// Where to write the clean medial mesh.
        #[arg(short, long, value_name = "OUT.ma")]
        output: PathBuf,
    },
}

fn main() -> ExitCode {
    let succeeded = match Args::parse().command {
        Command::Build(args) if args.per_mesh => scene::run(&args),
        Command::Build(args) => print(build::run(&args)),
        Command::Measure { mesh, medial, close_holes, json } => print(measured(&mesh, &medial, close_holes, json)),
        Command::Info { files, json } => files.iter().filter(|file| !print(info::of(file, json))).count() == 0,
        Command::Clean { medial, output } => print(cleaned(&medial, &output)),
    };
    if succeeded { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The text to print, or an error message.
type Outcome = Result<String, String>;

/// Returns true for a text. The reader may have closed the pipe before the end.
fn print(outcome: Outcome) -> bool {
    let _ = match &outcome {
        Ok(text) => std::io::stdout().write_all(text.as_bytes()),
        Err(message) => writeln!(std::io::stderr(), "error: {message}"),
    };
    outcome.is_ok()
}

fn measured(mesh: &Path, medial: &[PathBuf], close_holes: bool, as_json: bool) -> Outcome {
    let mut mesh = load_mesh(mesh)?;
    if close_holes {
        mesh = mesh.with_holes_closed();
    }
    let axes: Vec<_> = medial.iter().map(|path| read_axes(path)).collect::<Result<_, _>>()?;
    let rows = axes.into_iter().zip(medial).flat_map(|(axes, path)| axes.into_iter().map(move |axis| (path, axis)));
    let rows = rows.map(|(path, (level, axis))| Row::new(path, level, &axis, &measure(&mesh, &axis)));
    if as_json {
        return Ok(rows.map(|row| json(&row)).collect());
    }
    let rows: Vec<Row> = rows.collect();
    let width = rows.iter().map(|row| row.name().len()).max().unwrap_or(0).max("medial mesh".len());
    let mut text = format!("diagonal {} m; errors in percent of it\n", mesh.diagonal());
    let _ = writeln!(text, "{:width$}  spheres  cones  slabs |   mesh to envelope |   envelope to mesh", "medial mesh");
    let _ = writeln!(text, "{:width$}                        |      max      mean |      max      mean", "");
    for row in rows {
        let _ = write!(text, "{:width$}  {:7}  {:5}  {:5}", row.name(), row.spheres, row.cones, row.slabs);
        for Percent { max, mean } in [row.mesh_to_envelope, row.envelope_to_mesh] {
            let _ = write!(text, " | {max:8.3} {mean:9.4}");
        }
        text.push('\n');
    }
    Ok(text)
}

fn cleaned(medial: &Path, output: &Path) -> Outcome {
    if is_levels(output) {
        let text = output.with_extension("ma");
        return Err(at(output, format!("a clean medial mesh has one level, as text: name it {}", text.display())));
    }
    let (axis, report) = match Content::read(medial)? {
        Content::Medial(file) => file.into_medial_axis().map_err(|error| at(medial, error))?,
        Content::Levels(_) => {
            return Err(at(medial, "levels of detail are clean already; only .ma files can be cleaned"));
        }
        Content::Mesh(_) => return Err(at(medial, "it is a triangle mesh; only .ma files can be cleaned")),
    };
    check_output(output)?;
    files::write(&[(output.to_owned(), files::text(&axis))])?;
    Ok(format!("{}: {report}\n", output.display()))
}

/// Returns the medial meshes of a file: one, or one for each level with its number.
fn read_axes(path: &Path) -> Result<Vec<(Option<usize>, MedialAxis)>, String> {
    match Content::read(path)? {
        Content::Levels(chain) => {
            Ok(chain.levels.into_iter().enumerate().map(|(number, level)| (Some(number), level.axis)).collect())
        }
        Content::Medial(file) => {
            let (axis, _) = file.into_medial_axis().map_err(|error| at(path, error))?;
            Ok(vec![(None, axis)])
        }
        Content::Mesh(_) => Err(at(path, "it is a triangle mesh; build a medial mesh of it first")),
    }
}
