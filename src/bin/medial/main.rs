//! Builds, measures and cleans medial meshes: `medial --help`.

mod build;
mod info;

use std::{
    fmt::Write as _,
    fs,
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_medial::{
    builder::{MedialLevels, TriangleMesh, load, measure},
    medial_axis::{MedialAxis, ma},
};
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(version, about = "Builds, measures and cleans medial meshes")]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Builds a medial mesh from a triangle mesh (.obj, .gltf, .glb, .stl, .ply).
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
    },
    /// Describes a medial mesh (.ma), levels of detail (.medial), or a triangle mesh and its flaws.
    Info {
        /// The file.
        file: PathBuf,
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
    let result = match Args::parse().command {
        Command::Build(args) => build::run(&args),
        Command::Measure { mesh, medial, close_holes } => measured(&mesh, &medial, close_holes),
        Command::Info { file } => info::of(&file),
        Command::Clean { medial, output } => cleaned(&medial, &output),
    };
    match result {
        Ok(text) => {
            // The reader may have closed the pipe before the end.
            let _ = std::io::stdout().write_all(text.as_bytes());
            ExitCode::SUCCESS
        }
        Err(message) => {
            let _ = writeln!(std::io::stderr(), "error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// The text to print, or an error message.
type Outcome = Result<String, String>;

fn measured(mesh: &Path, medial: &[PathBuf], close_holes: bool) -> Outcome {
    let mut mesh = load_mesh(mesh)?;
    if close_holes {
        mesh = mesh.with_holes_closed();
    }
    let rows: Vec<_> = medial.iter().map(|path| read_axes(path)).collect::<Result<_, _>>()?;
    let rows: Vec<_> = rows.into_iter().flatten().collect();
    let width = rows.iter().map(|row| row.0.len()).max().unwrap_or(0).max("medial mesh".len());
    let mut text = format!("diagonal {} m; errors in percent of it\n", mesh.diagonal());
    let _ = writeln!(text, "{:width$}  spheres  cones  slabs |   mesh to envelope |   envelope to mesh", "medial mesh");
    let _ = writeln!(text, "{:width$}                        |      max      mean |      max      mean", "");
    for (name, axis) in rows {
        let error = measure(&mesh, &axis);
        let [_, cones, slabs] = info::kinds(axis.primitives());
        let _ = write!(text, "{name:width$}  {:7}  {cones:5}  {slabs:5}", axis.spheres().len());
        for deviation in [error.mesh_to_envelope, error.envelope_to_mesh] {
            let _ = write!(text, " | {:8.3} {:9.4}", deviation.max, deviation.mean);
        }
        text.push('\n');
    }
    Ok(text)
}

fn cleaned(medial: &Path, output: &Path) -> Outcome {
    build::check_output(output)?;
    if info::has_levels(medial) {
        return Err(at(medial, "levels of detail are clean already; only .ma files can be cleaned"));
    }
    let (axis, report) = read_file(medial)?.into_medial_axis().map_err(|error| at(medial, error))?;
    write_axis(output, &axis)?;
    Ok(format!("{}: {report}\n", output.display()))
}

/// Returns the medial meshes of a file with their names: one, or one for each level.
fn read_axes(path: &Path) -> Result<Vec<(String, MedialAxis)>, String> {
    let name = path.display().to_string();
    if !info::has_levels(path) {
        let (axis, _) = read_file(path)?.into_medial_axis().map_err(|error| at(path, error))?;
        return Ok(vec![(name, axis)]);
    }
    let levels = MedialLevels::load(path).map_err(|error| error.to_string())?.levels;
    Ok(levels.into_iter().enumerate().map(|(number, level)| (format!("{name} level {number}"), level.axis)).collect())
}

fn load_mesh(path: &Path) -> Result<TriangleMesh, String> {
    load::load(path).map_err(|error| error.to_string())
}

fn read_file(path: &Path) -> Result<ma::MaFile, String> {
    let bytes = fs::read(path).map_err(|error| at(path, format!("cannot be read: {error}")))?;
    ma::parse(&bytes).map_err(|error| at(path, error))
}

fn write_axis(path: &Path, axis: &MedialAxis) -> Result<(), String> {
    ma::save(path, &axis.into()).map_err(|error| at(path, format!("cannot be written: {error}")))
}

fn at(path: &Path, error: impl std::fmt::Display) -> String {
    format!("{}: {error}", path.display())
}
