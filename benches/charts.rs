//! Draws the charts of the reports again from their committed tables, without a measurement.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin charts -- [DIR]
//! ```
//!
//! Writes below `DIR/docs`. Default: the root of the repository.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_medial_compare::{
    figures::{self, Figure},
    outcome,
    tables::{Table, write},
};

fn main() -> ExitCode {
    outcome::of(draw())
}

fn draw() -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let out = env::args().nth(1).map_or_else(|| root.clone(), PathBuf::from).join("docs");
    let table = |path: &str| Table::read(&root.join(path));
    let mut accuracy = figures::queries(&table("docs/speed_accuracy/queries.csv")?);
    accuracy.push(figures::levels(&root.join("assets/models"))?);
    accuracy.extend(figures::scenes(&table("docs/speed_accuracy/scenes.csv")?));
    accuracy.extend(figures::batches(&table("docs/speed_accuracy/batches.csv")?));
    write_all(&out.join("speed_accuracy"), accuracy)?;
    write_all(&out.join("paper"), figures::paper(&table("docs/paper/frames.csv")?))?;
    let own = vec![
        figures::stability(&table("benches/results/stability.csv")?),
        figures::animated(&table("benches/results/animated.csv")?),
    ];
    write_all(&out.join("images"), own)
}

fn write_all(folder: &Path, figures: Vec<Figure>) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    figures.iter().try_for_each(|(name, svg)| write(&folder.join(name).with_extension("svg"), svg))
}
