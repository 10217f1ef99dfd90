//! Times of impact of moving primitive pairs, from a file: one answer per line, then nanoseconds per pair for each kind.
//!
//! ```text
//! cargo run --release --example pairs -- FILE [--repeat N] [--method advancement|alternating]
//! ```
//!
//! A line of the file is `category kindA kindB | A | B | ...`; what follows the third `|` is ignored, `#` starts a comment.
//! Kinds are `sphere`, `cone`, `slab` and, for B, `box`. A and B give `x y z r vx vy vz` per sphere (position and displacement
//! over the step), a box `cx cy cz qx qy qz qw hx hy hz`. Answers: a fraction of the step, `none`, or `overlap`.

use std::{collections::BTreeMap, fmt, hint::black_box, io::Write, path::PathBuf, process::ExitCode, time::Instant};

use bevy_medial::{
    geometry::Sphere,
    query::{Cuboid, Moving, TimeOfImpact, TimeOfImpactStatus, alternating, time_of_impact},
};
use clap::{Parser, ValueEnum};
use glam::{DQuat, DVec3, Quat, Vec3};

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
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Conservative advancement: the library's own.
    Advancement,
    /// The published alternation of nearest spheres and their contact: a baseline.
    Alternating,
}

#[derive(Clone, Copy)]
enum Primitive {
    Sphere(Moving<1>),
    Cone(Moving<2>),
    Slab(Moving<3>),
}

#[derive(Clone, Copy)]
enum Second {
    Primitive(Primitive),
    Box { half: Vec3 },
}

/// A pair in relative coordinates.
struct Pair {
    first: Primitive,
    second: Second,
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
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        if !line.is_empty() {
            let (kind, pair) = parse(line).map_err(|error| format!("{path}:{}: {error}", index + 1))?;
            kinds.entry(kind).or_default().push((count, pair));
            count += 1;
        }
    }

    let mut answers = vec![String::new(); count];
    let mut timings = Vec::new();
    for (kind, pairs) in &kinds {
        let mut best = f64::INFINITY;
        for _ in 0..args.repeat.max(1) {
            let start = Instant::now();
            for (_, pair) in pairs {
                black_box(solve(black_box(pair), args.method));
            }
            best = best.min(start.elapsed().as_secs_f64());
        }
        timings.push((kind, best * 1e9 / pairs.len() as f64));
        for (line, pair) in pairs {
            let result = solve(pair, args.method);
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

/// What is wrong with a line.
#[derive(Debug)]
enum LineError {
    Fields(usize),
    Header(String),
    Kind { side: char, kind: String },
    Number { side: char, text: String },
    NotFinite { side: char, text: String },
    Count { side: char, kind: String, wanted: usize, found: usize },
    NegativeSize { side: char },
    Rotation,
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            LineError::Fields(found) => {
                write!(f, "found {found} fields split by `|`, wanted at least 3: `category kindA kindB | A | B`")
            }
            LineError::Header(head) => write!(f, "`{head}` is not `category kindA kindB`"),
            LineError::Kind { side, kind } => {
                write!(f, "{side} is of the unknown kind `{kind}`; known are sphere, cone, slab and, for B, box")
            }
            LineError::Number { side, text } => write!(f, "{side}: `{text}` is not a number"),
            LineError::NotFinite { side, text } => write!(f, "{side}: `{text}` is not finite"),
            LineError::Count { side, kind, wanted, found } => {
                write!(f, "{side} is a {kind} of {found} numbers, wanted {wanted}")
            }
            LineError::NegativeSize { side } => write!(f, "{side} has a negative radius or half extent"),
            LineError::Rotation => write!(f, "B: the box's rotation is not a unit quaternion"),
        }
    }
}

fn parse(line: &str) -> Result<(String, Pair), LineError> {
    let fields: Vec<&str> = line.split('|').collect();
    let [head, first, second, ..] = fields[..] else { return Err(LineError::Fields(fields.len())) };
    let head: Vec<&str> = head.split_whitespace().collect();
    let [_, kind1, kind2] = head[..] else { return Err(LineError::Header(head.join(" "))) };

    let first_numbers = numbers('A', first)?;
    let second_numbers = numbers('B', second)?;
    // Relative to one of the first primitive's centres, so that positions far from the origin lose nothing.
    let origin = first_numbers.get(..3).map_or(Vec3::ZERO, Vec3::from_slice);
    let (pose_rotation, pose_origin, second) = if kind2 == "box" {
        let [cx, cy, cz, qx, qy, qz, qw, hx, hy, hz] = count('B', kind2, &second_numbers)?;
        let rotation = Quat::from_xyzw(qx, qy, qz, qw);
        if (rotation.length() - 1.0).abs() > 1e-3 {
            return Err(LineError::Rotation);
        }
        let half = Vec3::new(hx, hy, hz);
        if half.min_element() < 0.0 {
            return Err(LineError::NegativeSize { side: 'B' });
        }
        // A box is at rest: work in its frame.
        (rotation.as_dquat().normalize().inverse(), Vec3::new(cx, cy, cz), Second::Box { half })
    } else {
        let second = primitive('B', kind2, &second_numbers, origin, DQuat::IDENTITY)?;
        (DQuat::IDENTITY, origin, Second::Primitive(second))
    };
    let first = primitive('A', kind1, &first_numbers, pose_origin, pose_rotation)?;
    Ok((format!("{kind1}-{kind2}"), Pair { first, second }))
}

fn numbers(side: char, text: &str) -> Result<Vec<f32>, LineError> {
    text.split_whitespace()
        .map(|word| {
            let number: f32 = word.parse().map_err(|_| LineError::Number { side, text: word.into() })?;
            if number.is_finite() { Ok(number) } else { Err(LineError::NotFinite { side, text: word.into() }) }
        })
        .collect()
}

fn count<const K: usize>(side: char, kind: &str, numbers: &[f32]) -> Result<[f32; K], LineError> {
    numbers.try_into().map_err(|_| LineError::Count { side, kind: kind.into(), wanted: K, found: numbers.len() })
}

fn primitive(side: char, kind: &str, numbers: &[f32], origin: Vec3, rotation: DQuat) -> Result<Primitive, LineError> {
    let wanted = match kind {
        "sphere" => 1,
        "cone" => 2,
        "slab" => 3,
        _ => return Err(LineError::Kind { side, kind: kind.into() }),
    };
    if numbers.len() != 7 * wanted {
        return Err(LineError::Count { side, kind: kind.into(), wanted: 7 * wanted, found: numbers.len() });
    }
    let spheres: Vec<(Sphere, Vec3)> = numbers
        .chunks_exact(7)
        .map(|n| {
            // In f64, so that turning into a box's frame costs no more than one rounding.
            let turned = |v: DVec3| (rotation * v).as_vec3();
            let center = turned(Vec3::from_slice(n).as_dvec3() - origin.as_dvec3());
            (Sphere::new(center, n[3]), turned(Vec3::from_slice(&n[4..]).as_dvec3()))
        })
        .collect();
    if spheres.iter().any(|(sphere, _)| sphere.radius < 0.0) {
        return Err(LineError::NegativeSize { side });
    }
    Ok(match wanted {
        1 => Primitive::Sphere(moving(&spheres)),
        2 => Primitive::Cone(moving(&spheres)),
        _ => Primitive::Slab(moving(&spheres)),
    })
}

fn moving<const N: usize>(spheres: &[(Sphere, Vec3)]) -> Moving<N> {
    Moving { start: std::array::from_fn(|i| spheres[i].0), motion: std::array::from_fn(|i| spheres[i].1) }
}
