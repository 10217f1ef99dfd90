//! Animated characters: the cost of a step, 10,000 bullets against fine steps on the skinned triangles, and a crowd of bodies.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin characters -- [cost] [hits] [crowd] [--quick] [--out FOLDER]
//! ```
//!
//! - **cost**: an update with 100 bipeds of about 60 primitives that run on the spot, with rigid bodies of the same shape, and with joints alone, in turns.
//!   Once without other bodies, and with a quarter of the number knee-deep in 20 balls each, within four walls.
//!   The cost is the time beyond that of the joints and balls alone. Processor time is the sum over all threads;
//! - **hits**: bullets of 3 cm radius at 10 to 1,000 m/s from random directions at a biped that runs at 5 m/s. Steps 100 times as fine on its skinned
//!   triangles are the truth. The tolerance is the fit error: the largest distance of the posed medial mesh from these triangles over the gait;
//! - **crowd**: this biped runs through 100 bodies, in steps of 1/60 s and in steps 16 times as fine.
//!
//! Without a name it runs all three. With `--out` it writes `characters.csv`.

use std::{error::Error, path::PathBuf, process::ExitCode};

use bevy_medial::scenes::characters::Character;
use bevy_medial_compare::{
    characters::{
        Actor,
        cost::{self, Shapes},
        crowd, hits,
    },
    outcome, tables,
};
use clap::{Parser, ValueEnum};
use serde::Serialize;

#[derive(Parser)]
#[command(about = "Animated characters: cost of a step, hits of bullets, a crowd of bodies")]
struct Args {
    /// Measurements to run. Default: all.
    what: Vec<What>,
    /// Few characters, bullets and runs: a short test of the program.
    #[arg(long)]
    quick: bool,
    /// Folder for `characters.csv`.
    #[arg(long)]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum What {
    Cost,
    Hits,
    Crowd,
}

/// A measured value.
#[derive(Serialize)]
struct Row {
    what: &'static str,
    of: String,
    value: f64,
    unit: &'static str,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn Error>> {
    let mut rows = Vec::new();
    let mut put = |what, of: &str, value, unit| {
        println!("{what:36} {of:24} {value:12.4} {unit}");
        rows.push(Row { what, of: of.into(), value, unit });
    };
    let runs = |what| args.what.is_empty() || args.what.contains(&what);
    if runs(What::Cost) {
        cost(args.quick, &mut put)?;
    }
    if runs(What::Hits) {
        hits(args.quick, &mut put)?;
    }
    if runs(What::Crowd) {
        crowd(args.quick, &mut put)?;
    }
    println!("{}", tables::machine());
    if let Some(folder) = &args.out {
        tables::write(&folder.join("characters.csv"), &tables::csv(&rows))?;
    }
    Ok(())
}

/// Reports a value: its name, the case, the value and its unit.
type Put<'a> = &'a mut dyn FnMut(&'static str, &str, f64, &'static str);

/// Number of spheres of a biped whose medial mesh has about 60 primitives.
const SMALL: usize = 26;

fn cost(quick: bool, put: Put) -> Result<(), Box<dyn Error>> {
    let actor = Actor::new(Character::biped(), SMALL, 0.0)?;
    put("primitives of a character", "", actor.axis.primitives().len() as f64, "");
    let (characters, steps, runs) = if quick { (10, 10, 1) } else { (100, 60, 5) };
    for (case, balls, characters) in [("without contact", 0, characters), ("20 balls each", 20, characters / 4)] {
        let shapes = [Shapes::Nothing, Shapes::Rigid, Shapes::Skinned];
        let (mut least, mut processor, mut pairs) = ([f64::INFINITY; 3], [f64::INFINITY; 3], [0.0; 3]);
        for _ in 0..runs {
            for (at, shapes) in shapes.into_iter().enumerate() {
                let cost = cost::Scene { shapes, characters, balls, steps }.run(&actor);
                least[at] = cost.update.min(least[at]);
                processor[at] = cost.processor.min(processor[at]);
                pairs[at] = cost.contact_pairs;
            }
        }
        let [joints, rigid, skinned] = least;
        put("an update, joints alone", case, joints, "ms");
        put("an update, rigid bodies", case, rigid, "ms");
        put("an update, skinned shapes", case, skinned, "ms");
        put("pairs in contact, rigid", case, pairs[1], "");
        put("pairs in contact, skinned", case, pairs[2], "");
        put("cost of the skinned shapes", case, skinned - joints, "ms");
        put("cost, processor time", case, processor[2] - processor[0], "ms");
        put("skinned over rigid, update", case, skinned / rigid, "");
        put("skinned over rigid, processor time", case, processor[2] / processor[1], "");
    }
    Ok(())
}

/// Bounds of the ranges of speeds in metres per second.
const SPEEDS: [f32; 5] = [10.0, 30.0, 100.0, 300.0, 1001.0];

fn hits(quick: bool, put: Put) -> Result<(), Box<dyn Error>> {
    let actor = Actor::new(Character::biped(), 60, 5.0)?;
    let tolerance = actor.fit_error(60)?;
    put("fit error", "biped", f64::from(tolerance) * 1e3, "mm");
    let flights = hits::shoot(&actor, if quick { 400 } else { 10_000 }, tolerance, 71)?;
    let mut ranges: Vec<[f32; 2]> = SPEEDS.windows(2).map(|pair| [pair[0], pair[1]]).collect();
    ranges.push([0.0, f32::INFINITY]);
    for range in ranges {
        let all = "all speeds".to_owned();
        let of = if range[0] > 0.0 { format!("{:.0} to {:.0} m/s", range[0], range[1]) } else { all };
        let score = hits::Score::new(&flights, tolerance, range);
        let share = |part: usize| 100.0 * part as f64 / score.hits as f64;
        put("bullets", &of, score.bullets as f64, "");
        put("bullets that touch the triangles", &of, score.touching as f64, "");
        put("hits", &of, score.hits as f64, "");
        put("lost", &of, score.lost as f64, "");
        put("false hits", &of, score.false_hits as f64, "");
        put("near misses", &of, score.near_misses as f64, "");
        put("disturbed near misses", &of, score.disturbed as f64, "");
        put("within the fit error at the hit", &of, share(score.in_place), "%");
        put("in time: fit error over speed", &of, share(score.in_time), "%");
        put("same joint, at the first touch", &of, share(score.same_joint), "%");
        put("same joint, at the hit", &of, share(score.same_joint_at_hit), "%");
        put("a joint within the fit error", &of, share(score.joint_within), "%");
    }
    Ok(())
}

fn crowd(quick: bool, put: Put) -> Result<(), Box<dyn Error>> {
    let actor = Actor::new(Character::biped(), 60, 5.0)?;
    let (seeds, mut energies) = (if quick { 1 } else { 5 }, [0.0; 2]);
    for (at, (case, dt)) in [("1/60 s", 1.0 / 60.0), ("1/960 s", 1.0 / 960.0)].into_iter().enumerate() {
        let runs: Vec<crowd::Outcome> =
            (0..seeds).map(|seed| crowd::run(&actor, dt, seed)).collect::<Result<_, _>>()?;
        let mean = |value: fn(&crowd::Outcome) -> f64| runs.iter().map(value).sum::<f64>() / runs.len() as f64;
        let most = |value: fn(&crowd::Outcome) -> f32| f64::from(runs.iter().map(value).fold(0.0, f32::max));
        energies[at] = mean(|run| run.energy);
        put("energy of a body", case, energies[at], "J");
        put("bodies that were moved", case, mean(|run| run.moved as f64), "");
        put("bodies inside at the end", case, runs.iter().map(|run| run.inside as f64).sum(), "");
        put("deepest overlap at the end", case, most(|run| run.deepest[0]) * 1e3, "mm");
        put("deepest overlap of a step", case, most(|run| run.deepest[1]) * 1e3, "mm");
    }
    put("energy over that of fine steps", "1/60 s", energies[0] / energies[1], "");
    Ok(())
}
