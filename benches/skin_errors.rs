//! Errors of posed medial meshes over the gait of the animated characters: against the triangle mesh in the same pose, by linear blend skinning.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin skin_errors -- [--spheres N] [--frames N] [--out FOLDER]
//! ```
//!
//! Errors are two-sided, as in `medial measure`, and in millimetres. Folds of the skin, where it lies inside the body, do not count. With `--out` it writes
//! `animated.csv`, a row for each frame, and `animated.svg`. Frame 0 of the table is the bind pose.

use std::{error::Error, path::PathBuf, process::ExitCode};

use bevy_medial::scenes::characters::Character;
use bevy_medial_compare::{
    characters::Actor,
    figures, outcome,
    tables::{self, Table},
};
use clap::Parser;
use serde::Serialize;

#[derive(Parser)]
#[command(about = "Errors of posed medial meshes over the gait of animated characters")]
struct Args {
    /// Number of spheres of each character before the binding, which adds some at the joints.
    #[arg(long, default_value_t = 60)]
    spheres: usize,
    /// Number of frames of a cycle.
    #[arg(long, default_value_t = 60)]
    frames: u32,
    /// Folder for the table and the chart.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Errors in millimetres.
#[derive(Serialize)]
struct Row {
    character: &'static str,
    /// 0 is the bind pose.
    frame: u32,
    max: f32,
    mean: f32,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn Error>> {
    println!(
        "| character | spheres | primitives | bind pose: max | mean | clip: max | mean | max / bind | mean / bind | worst frame |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut rows: Vec<Row> = vec![];
    for character in [Character::biped(), Character::spider()] {
        let actor = Actor::new(character, args.spheres, 0.0)?;
        let Actor { character, axis, .. } = &actor;
        let clip = (0..args.frames).map(|frame| character.pose(frame as f32 / args.frames as f32 * character.period));
        let poses = std::iter::once(character.bind_pose()).chain(clip);
        let first = rows.len();
        for (frame, joints) in (0..).zip(poses) {
            let [max, mean] = actor.error(&joints)?.map(|metres| metres * 1000.0);
            rows.push(Row { character: character.name, frame, max, mean });
        }
        let [bind, clip @ ..] = &rows[first..] else { return Err("there are no frames".into()) };
        let worst = clip.iter().max_by(|a, b| a.max.total_cmp(&b.max)).ok_or("there are no frames")?;
        let mean = clip.iter().map(|row| row.mean).fold(0.0, f32::max);
        println!(
            "| {} | {} | {} | {:.2} | {:.3} | {:.2} | {mean:.3} | {:.2} | {:.2} | {} |",
            character.name,
            axis.spheres().len(),
            axis.primitives().len(),
            bind.max,
            bind.mean,
            worst.max,
            worst.max / bind.max,
            mean / bind.mean,
            worst.frame
        );
    }
    if let Some(folder) = &args.out {
        let table = tables::csv(&rows);
        tables::write(&folder.join("animated.csv"), &table)?;
        let (name, chart) = figures::animated(&Table::new(&table));
        tables::write(&folder.join(name + ".svg"), &chart)?;
    }
    Ok(())
}
