//! Converts a mesh to a `.medial` file with levels of detail and their errors. The program `medial build` does the same on the command line.
//!
//! ```text
//! cargo run --release --example bake [MESH [OUT]]
//! ```

use std::{env, error::Error, fs, ops::ControlFlow, path::PathBuf};

use bevy_medial::{
    builder::{FitOptions, fit, load},
    prelude::MedialBudget,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = env::args().skip(1).map(PathBuf::from);
    let models = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets/models");
    let mesh_file = args.next().unwrap_or_else(|| models.join("torus.obj"));
    let out = args.next().unwrap_or_else(|| env::temp_dir().join("baked.medial"));

    let mesh = load::load(&mesh_file)?;
    println!("{}: {} triangles", mesh_file.display(), mesh.triangles.len());
    let options = FitOptions { spheres: Some(40), levels: true, ..FitOptions::default() };
    // The callback receives the part of the work that is done, from 0 to 1, and can cancel the build.
    let levels = fit(&mesh, &options, &|_part| ControlFlow::Continue(()))?;
    for (number, level) in levels.levels.iter().enumerate() {
        let (axis, error) = (&level.axis, level.error.max());
        println!(
            "level {number}: {} spheres, {} primitives, error {error:.2} %",
            axis.spheres().len(),
            axis.primitives().len()
        );
    }
    fs::write(&out, levels.to_bytes())?;
    println!("{}: {} bytes", out.display(), fs::metadata(&out)?.len());

    // An app loads the file with `assets.load("baked.medial")`. The budget of a body selects the level.
    let axis = levels.into_medial_axis().ok_or("there are no levels")?;
    println!("within 2 % of the diagonal: level {}", MedialBudget::Percent(2.0).level(&axis, 1.0));
    Ok(())
}
