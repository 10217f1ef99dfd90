//! Makes the demo models, a torus and nine animals: closed triangle meshes from limbs, and medial meshes of these.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin make_models -- [FOLDER]
//! ```
//!
//! For each model it writes the triangles (`.obj`), levels of detail down to one sphere (`.medial`) and the finest level
//! (`.ma`). All runs write the same bytes.

mod animals;
mod limbs;
mod surface;

use std::{error::Error, fmt::Write, fs, ops::ControlFlow, path::PathBuf, time::Instant};

use animals::ANIMALS;
use bevy_medial::{
    builder::{FitOptions, MeshReport, TriangleMesh, fit, load},
    medial_axis::ma::{self, MaFile},
};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

/// Ticks of the progress bar for each model.
const TICKS: u64 = 1000;

#[derive(Parser)]
#[command(about = "Makes the demo models and fits medial meshes to them")]
struct Args {
    /// Output folder.
    #[arg(default_value = "assets/models")]
    folder: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Args { folder } = Args::parse();
    fs::create_dir_all(&folder)?;
    let style = ProgressStyle::with_template("{elapsed_precise} {msg:10} {wide_bar} {percent} %")?;
    let bar = ProgressBar::new(TICKS * ANIMALS.len() as u64).with_style(style);
    let mut table = String::from(
        "model      triangles  genus  spheres  edges  faces | mesh to envelope | envelope to mesh |  levels  seconds\n\
         \x20                                                 |   max %   mean % |   max %   mean % |\n",
    );
    for (animal, done) in ANIMALS.iter().zip((0..).step_by(TICKS as usize)) {
        bar.set_message(animal.name);
        let start = Instant::now();
        let path = folder.join(animal.name);
        let obj = path.with_extension("obj");
        let surface = surface::surface(&animal.solid(), animal.triangles, animal.size);
        fs::write(&obj, to_obj(&surface.map_err(|error| format!("{}: {error}", animal.name))?))?;
        // The medial mesh is fitted to the positions in the file, which are rounded.
        let mesh = load::load(&obj)?;
        let report = MeshReport::new(&mesh);
        if !report.flaws().is_empty() || report.components != 1 {
            return Err(format!("{}: {report}", animal.name).into());
        }
        let options = FitOptions {
            spheres: Some(animal.spheres),
            levels: true,
            searches: Some(animal.searches),
            ..FitOptions::default()
        };
        let chain = fit(&mesh, &options, &|part| {
            bar.set_position(done + (part * TICKS as f32) as u64);
            ControlFlow::Continue(())
        })?;
        chain.save(&path.with_extension("medial"))?;
        let finest = chain.levels.first().ok_or("the model has no level")?;
        let file = MaFile::from(&finest.axis);
        fs::write(path.with_extension("ma"), ma::write(&file))?;

        let counts = [file.spheres.len(), file.edges.len(), file.faces.len()];
        // By Euler's formula: a closed mesh has three edges per two triangles.
        let genus = (report.triangles / 2 + 2 - report.vertices) / 2;
        write!(table, "{:10} {:9}  {genus:5}", animal.name, report.triangles)?;
        write!(table, "  {:7}  {:5}  {:5}", counts[0], counts[1], counts[2])?;
        for deviation in [finest.error.mesh_to_envelope, finest.error.envelope_to_mesh] {
            write!(table, " | {:7.2} {:8.3}", deviation.max, deviation.mean)?;
        }
        writeln!(table, " | {:7} {:8.1}", chain.levels.len(), start.elapsed().as_secs_f32())?;
    }
    bar.finish_and_clear();
    print!("{table}");
    Ok(())
}

/// The text of an OBJ file. Coordinates are rounded to a hundredth of a millimetre.
fn to_obj(mesh: &TriangleMesh) -> String {
    let vertices = mesh.positions.iter().map(|p| format!("v {:.5} {:.5} {:.5}\n", p.x, p.y, p.z));
    let faces = mesh.triangles.iter().map(|t| t.map(|i| i + 1)).map(|[a, b, c]| format!("f {a} {b} {c}\n"));
    vertices.chain(faces).collect()
}
