//! Computes times of impact of moving primitive pairs from a file. Prints one answer per line, then the nanoseconds per pair of each kind.
//!
//! ```text
//! cargo run --release --example pairs -- FILE [--repeat N] [--method advancement|single|alternating] [--backend cpu|gpu]
//! ```
//!
//! A line of the file is `category kindA kindB | A | B | ...`. Text after the third `|` is ignored, and `#` starts a comment.
//! Kinds are `sphere`, `cone`, `slab` and, for B, `box`. A and B give `x y z r vx vy vz` per sphere (position and displacement
//! over the step), a box `cx cy cz qx qy qz qw hx hy hz`. Answers: a fraction of the step, `none`, or `overlap`. The GPU answers
//! with lower bounds of the fraction, so the answer of an overlap is 0.

use std::{collections::BTreeMap, hint::black_box, io::Write, path::PathBuf, process::ExitCode, time::Instant};

use bevy_medial::{
    gpu::{GpuBounds, GpuDevice, GpuError, MovingPair},
    query::{Cuboid, Moving, TimeOfImpact, TimeOfImpactStatus, Touch, alternating, time_of_impact, times_of_impact},
};
use bevy_medial_compare::{
    outcome,
    pairs::{self, Pair, Primitive, Second},
};
use clap::{Parser, ValueEnum};

#[derive(Parser)]
#[command(about = "Times of impact of moving primitive pairs")]
struct Args {
    /// The pairs.
    file: PathBuf,
    /// Number of passes over the pairs of each kind. The time is that of the fastest pass.
    #[arg(long, default_value_t = 1)]
    repeat: u32,
    /// The kernel.
    #[arg(long, value_enum, default_value_t = Method::Advancement)]
    method: Method,
    /// Processor of the kernel. The GPU computes lower bounds by advancement, and its times include upload, kernel and readback.
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    backend: Backend,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Conservative advancement, all pairs of a kind at once; boxes one by one.
    Advancement,
    /// Conservative advancement, one pair at a time.
    Single,
    /// The published alternation of nearest spheres and their contact: a baseline.
    Alternating,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Backend {
    Cpu,
    Gpu,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
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

    let mut gpu = match (args.backend, args.method) {
        (Backend::Cpu, _) => None,
        (Backend::Gpu, Method::Advancement) => Some(GpuBounds::new(&GpuDevice::request()?)?),
        (Backend::Gpu, _) => return Err("the GPU supports no method except advancement".into()),
    };
    let mut answers = vec![String::new(); count];
    let mut timings = Vec::new();
    for (kind, pairs) in &kinds {
        let pairs_of_kind: Vec<&Pair> = pairs.iter().map(|(_, pair)| pair).collect();
        let (touches, seconds) = match &mut gpu {
            None => solve(&pairs_of_kind, args),
            Some(bounds) => solve_on_gpu(&pairs_of_kind, args, bounds)?,
        };
        timings.push((kind, seconds * 1e9 / pairs.len() as f64));
        for ((line, _), touch) in pairs.iter().zip(touches) {
            answers[*line] = match touch.status {
                TimeOfImpactStatus::Separated => "none".into(),
                TimeOfImpactStatus::Overlapping => "overlap".into(),
                TimeOfImpactStatus::Hit | TimeOfImpactStatus::IterationLimit => touch.fraction.to_string(),
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

/// The answers for pairs of one kind, and the seconds of the fastest pass.
fn solve(pairs: &[&Pair], args: &Args) -> (Vec<Touch>, f64) {
    match pairs[0].first {
        Primitive::Sphere(_) => solve_first::<1>(pairs, args),
        Primitive::Cone(_) => solve_first::<2>(pairs, args),
        Primitive::Slab(_) => solve_first::<3>(pairs, args),
    }
}

fn solve_first<const N: usize>(pairs: &[&Pair], args: &Args) -> (Vec<Touch>, f64) {
    match pairs[0].second {
        Second::Primitive(Primitive::Sphere(_)) => solve_hulls::<N, 1>(pairs, args),
        Second::Primitive(Primitive::Cone(_)) => solve_hulls::<N, 2>(pairs, args),
        Second::Primitive(Primitive::Slab(_)) => solve_hulls::<N, 3>(pairs, args),
        Second::Box { .. } => {
            let pairs: Vec<(Moving<N>, Cuboid)> = pairs::against_boxes(pairs.iter().copied());
            fastest(args, || pairs.iter().map(|(a, b)| touch(&time_of_impact(black_box(a), b, 1.0))).collect())
        }
    }
}

fn solve_hulls<const N: usize, const M: usize>(pairs: &[&Pair], args: &Args) -> (Vec<Touch>, f64) {
    let pairs = pairs::of_kind::<N, M>(pairs.iter().copied());
    match args.method {
        Method::Advancement => fastest(args, || times_of_impact(black_box(&pairs), 1.0)),
        Method::Single => {
            fastest(args, || pairs.iter().map(|(a, b)| touch(&time_of_impact(black_box(a), b, 1.0))).collect())
        }
        Method::Alternating => {
            fastest(args, || pairs.iter().map(|(a, b)| touch(&alternating(black_box(a), b))).collect())
        }
    }
}

/// Lower bounds of the answers.
fn solve_on_gpu(pairs: &[&Pair], args: &Args, bounds: &mut GpuBounds) -> Result<(Vec<Touch>, f64), GpuError> {
    let pairs: Vec<MovingPair> = pairs.iter().map(|pair| for_gpu(pair)).collect();
    let mut failure = None;
    let touch = |bound: &f32| {
        let is_apart = *bound > 1.0;
        Touch {
            status: if is_apart { TimeOfImpactStatus::Separated } else { TimeOfImpactStatus::Hit },
            fraction: *bound,
        }
    };
    let found = fastest(args, || match bounds.run(&pairs) {
        Ok(found) => found.iter().map(touch).collect(),
        Err(error) => {
            failure = Some(error);
            Vec::new()
        }
    });
    failure.map_or(Ok(found), Err)
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

fn touch(found: &TimeOfImpact) -> Touch {
    Touch { status: found.status, fraction: found.fraction }
}

/// Runs the passes. Returns the answers, which are the same in each pass, and the seconds of the fastest pass.
fn fastest(args: &Args, mut pass: impl FnMut() -> Vec<Touch>) -> (Vec<Touch>, f64) {
    let mut best = f64::INFINITY;
    let mut touches = Vec::new();
    for _ in 0..args.repeat.max(1) {
        let start = Instant::now();
        touches = pass();
        best = best.min(start.elapsed().as_secs_f64());
    }
    (touches, best)
}
