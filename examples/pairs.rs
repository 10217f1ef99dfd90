//! Times of impact of moving primitive pairs, from a file: one answer per line, then nanoseconds per pair for each kind.
//!
//! ```text
//! cargo run --release --example pairs -- FILE [--repeat N] [--method advancement|alternating] [--backend cpu|gpu]
//! ```
//!
//! A line of the file is `category kindA kindB | A | B | ...`; what follows the third `|` is ignored, `#` starts a comment.
//! Kinds are `sphere`, `cone`, `slab` and, for B, `box`. A and B give `x y z r vx vy vz` per sphere (position and displacement
//! over the step), a box `cx cy cz qx qy qz qw hx hy hz`. Answers: a fraction of the step, `none`, or `overlap`.

#[path = "../benches/common/pairs.rs"]
mod pairs;

use std::{collections::BTreeMap, hint::black_box, io::Write, path::PathBuf, process::ExitCode, time::Instant};

use bevy_medial::{
    gpu::{GpuDevice, GpuError, GpuImpacts, MovingPair},
    query::{Cuboid, Moving, TimeOfImpact, TimeOfImpactStatus, alternating, time_of_impact},
};
use clap::{Parser, ValueEnum};
use pairs::{Pair, Primitive, Second};

#[derive(Parser)]
#[command(about = "Times of impact of moving primitive pairs")]
struct Args {
    /// The pairs.
    file: PathBuf,
    /// How often each kind's pairs are computed for the timing; the fastest pass counts.
    #[arg(long, default_value_t = 1)]
    repeat: u32,
    /// The kernel.
    #[arg(long, value_enum, default_value_t = Method::Advancement)]
    method: Method,
    /// Where it runs; on the GPU with uploads and readback, all pairs of a kind at a time, and by advancement only.
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    backend: Backend,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Conservative advancement: the library's own.
    Advancement,
    /// The published alternation of nearest spheres and their contact: a baseline.
    Alternating,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Backend {
    Cpu,
    Gpu,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let path = args.file.display();
    let text = std::fs::read_to_string(&args.file).map_err(|error| format!("{path}: {error}"))?;
    let mut kinds: BTreeMap<String, Vec<(usize, Pair)>> = BTreeMap::new();
    let mut count = 0;
    for pair in pairs::read(&text) {
        let pair = pair.map_err(|(line, error)| format!("{path}:{line}: {error}"))?;
        let [kind, _] = &pair.labels;
        kinds.entry(kind.clone()).or_default().push((count, pair));
        count += 1;
    }

    let mut solver = Solver::new(args)?;
    let mut answers = vec![String::new(); count];
    let mut timings = Vec::new();
    for (kind, pairs) in &kinds {
        let mut results = Vec::new();
        let mut best = f64::INFINITY;
        for _ in 0..args.repeat.max(1) {
            let start = Instant::now();
            results = black_box(solver.solve(black_box(pairs))?);
            best = best.min(start.elapsed().as_secs_f64());
        }
        timings.push((kind, best * 1e9 / pairs.len() as f64));
        for ((line, _), result) in pairs.iter().zip(&results) {
            answers[*line] = match result.status {
                TimeOfImpactStatus::Separated => "none".into(),
                TimeOfImpactStatus::Overlapping => "overlap".into(),
                TimeOfImpactStatus::Hit | TimeOfImpactStatus::IterationLimit => result.fraction.to_string(),
            };
        }
    }
    let mut out = std::io::BufWriter::new(std::io::stdout().lock());
    for answer in &answers {
        writeln!(out, "{answer}")?;
    }
    for (kind, nanoseconds) in timings {
        writeln!(out, "# {kind} {nanoseconds:.1} ns/pair")?;
    }
    Ok(())
}

/// What computes the pairs of a kind.
enum Solver {
    Cpu(Method),
    Gpu(GpuImpacts),
}

impl Solver {
    fn new(args: &Args) -> Result<Self, Box<dyn std::error::Error>> {
        match (args.backend, args.method) {
            (Backend::Cpu, method) => Ok(Self::Cpu(method)),
            (Backend::Gpu, Method::Advancement) => {
                let gpu = GpuDevice::request()?;
                eprintln!("GPU: {}", gpu.name());
                Ok(Self::Gpu(GpuImpacts::new(&gpu)?))
            }
            (Backend::Gpu, Method::Alternating) => Err("the GPU knows no other method than advancement".into()),
        }
    }

    fn solve(&mut self, pairs: &[(usize, Pair)]) -> Result<Vec<TimeOfImpact>, GpuError> {
        match self {
            Self::Cpu(method) => Ok(pairs.iter().map(|(_, pair)| solve(pair, *method)).collect()),
            Self::Gpu(impacts) => impacts.run(&pairs.iter().map(|(_, pair)| for_gpu(pair)).collect::<Vec<_>>()),
        }
    }
}

fn for_gpu(pair: &Pair) -> MovingPair {
    match &pair.first {
        Primitive::Sphere(first) => with_second(first, &pair.second),
        Primitive::Cone(first) => with_second(first, &pair.second),
        Primitive::Slab(first) => with_second(first, &pair.second),
    }
}

fn with_second<const N: usize>(first: &Moving<N>, second: &Second) -> MovingPair {
    match second {
        Second::Box { half } => MovingPair::with_cuboid(first, &Cuboid { half: *half }),
        Second::Primitive(Primitive::Sphere(second)) => MovingPair::new(first, second),
        Second::Primitive(Primitive::Cone(second)) => MovingPair::new(first, second),
        Second::Primitive(Primitive::Slab(second)) => MovingPair::new(first, second),
    }
}

fn solve(pair: &Pair, method: Method) -> TimeOfImpact {
    match &pair.first {
        Primitive::Sphere(first) => solve_first(first, &pair.second, method),
        Primitive::Cone(first) => solve_first(first, &pair.second, method),
        Primitive::Slab(first) => solve_first(first, &pair.second, method),
    }
}

fn solve_first<const N: usize>(first: &Moving<N>, second: &Second, method: Method) -> TimeOfImpact {
    match (second, method) {
        (Second::Box { half }, _) => time_of_impact(first, &Cuboid { half: *half }, 1.0),
        (Second::Primitive(Primitive::Sphere(second)), Method::Advancement) => time_of_impact(first, second, 1.0),
        (Second::Primitive(Primitive::Cone(second)), Method::Advancement) => time_of_impact(first, second, 1.0),
        (Second::Primitive(Primitive::Slab(second)), Method::Advancement) => time_of_impact(first, second, 1.0),
        (Second::Primitive(Primitive::Sphere(second)), Method::Alternating) => alternating(first, second),
        (Second::Primitive(Primitive::Cone(second)), Method::Alternating) => alternating(first, second),
        (Second::Primitive(Primitive::Slab(second)), Method::Alternating) => alternating(first, second),
    }
}
