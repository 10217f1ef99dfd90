//! Errors of shapes that approximate triangle meshes: medial meshes and rapier's convex decomposition, as a Markdown table.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin shape_errors -- [MESH ...] [--spheres N] [--fine]
//! ```
//!
//! `coarse medial` is the coarsest level of detail with at least as many parts as the decomposition. `better medial` is the coarsest level with a
//! smaller max and a smaller mean error from the mesh.
//!
//! Errors are two-sided, in percent of the diagonal of the mesh's bounding box, as in `medial measure`: max and mean distance from the
//! surface of the mesh to that of the shape, and back. For a decomposition only the first is printed, because the cuts between its parts are
//! not part of the surface. Default: the meshes in `assets/models`.

use std::{ops::ControlFlow, path::PathBuf, process::ExitCode, time::Instant};

use bevy_medial::builder::{Deviation, FitOptions, Level, TwoSidedError, fit, load::load};
use bevy_medial_compare::{hulls::hull_error, outcome};
use bevy_rapier3d::parry::{
    shape::{ConvexPolyhedron, SharedShape},
    transformation::vhacd::VHACDParameters,
};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

#[derive(Parser)]
#[command(about = "Errors of medial meshes and of convex decomposition")]
struct Args {
    /// Triangle meshes: .obj, .gltf, .glb, .stl, .ply.
    meshes: Vec<PathBuf>,
    /// Number of spheres of the medial meshes.
    #[arg(long, default_value_t = 60)]
    spheres: usize,
    /// Also decompose at resolution 128 and concavity 0.005, which is slow.
    #[arg(long)]
    fine: bool,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let mut meshes = args.meshes.clone();
    if meshes.is_empty() {
        for entry in std::fs::read_dir("assets/models")? {
            meshes.push(entry?.path());
        }
        meshes.retain(|path| path.extension().is_some_and(|extension| extension == "obj"));
        meshes.sort();
    }
    println!("| mesh | shape | parts | mesh to shape: max | mean | shape to mesh: max | mean | seconds |");
    println!("|---|---|---|---|---|---|---|---|");
    let bar = ProgressBar::new(meshes.len() as u64);
    bar.set_style(ProgressStyle::with_template("{pos}/{len} {msg} {wide_bar}")?);
    for path in &meshes {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        bar.set_message(name.clone());
        let mesh = load(path)?;
        let row = |shape: &str, parts: usize, to: Deviation, from: Option<Deviation>, seconds: Option<f32>| {
            let back = from.map_or(" | ".into(), |from| format!("{:.2} | {:.3}", from.max, from.mean));
            let errors = format!("{:.2} | {:.3} | {back}", to.max, to.mean);
            let seconds = seconds.map_or(String::new(), |seconds| format!("{seconds:.2}"));
            bar.suspend(|| println!("| {name} | {shape} | {parts} | {errors} | {seconds} |"));
        };
        let begin = Instant::now();
        let options = FitOptions { spheres: Some(args.spheres), ..FitOptions::default() };
        let one = fit(&mesh, &options, &|_| ControlFlow::Continue(()))?;
        let seconds = begin.elapsed().as_secs_f32();
        let chain = fit(&mesh, &FitOptions { levels: true, ..options }, &|_| ControlFlow::Continue(()))?;
        for level in &one.levels {
            let TwoSidedError { mesh_to_envelope, envelope_to_mesh, .. } = level.error;
            let parts = level.axis.primitives().len();
            row("medial", parts, mesh_to_envelope, Some(envelope_to_mesh), Some(seconds));
        }
        let mut decompositions = vec![("convex decomposition", VHACDParameters::default())];
        if args.fine {
            let fine = VHACDParameters { resolution: 128, concavity: 0.005, ..VHACDParameters::default() };
            decompositions.push(("the same, fine", fine));
        }
        for (index, (shape, parameters)) in decompositions.into_iter().enumerate() {
            let begin = Instant::now();
            let compound = SharedShape::convex_decomposition_with_params(&mesh.positions, &mesh.triangles, &parameters);
            let seconds = begin.elapsed().as_secs_f32();
            let parts = compound.as_compound().map_or(&[][..], |compound| compound.shapes());
            let hulls: Vec<&ConvexPolyhedron> =
                parts.iter().filter_map(|(_, part)| part.as_convex_polyhedron()).collect();
            let of_hulls = hull_error(&mesh, &hulls);
            row(shape, hulls.len(), of_hulls, None, Some(seconds));
            if index > 0 {
                continue;
            }
            let as_many = |level: &&Level| level.axis.primitives().len() >= hulls.len();
            let better = |level: &&Level| {
                let Deviation { max, mean } = level.error.mesh_to_envelope;
                max < of_hulls.max && mean < of_hulls.mean
            };
            let coarsest = |is_right: &dyn Fn(&&Level) -> bool| chain.levels.iter().rev().find(is_right);
            for (shape, level) in [("coarse medial", coarsest(&as_many)), ("better medial", coarsest(&better))] {
                if let Some(Level { axis, error: TwoSidedError { mesh_to_envelope, envelope_to_mesh, .. } }) = level {
                    row(shape, axis.primitives().len(), *mesh_to_envelope, Some(*envelope_to_mesh), None);
                }
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}
