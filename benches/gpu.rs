//! The GPU back end by itself: time of each pass, told by the device, and of a whole call with upload, wait and readback.
//!
//! ```text
//! cargo bench --bench gpu -- [--quick] [--out DIR]
//! ```
//!
//! - the scenes: the inputs of a run's steps, culled again on the GPU and on the CPU (with all its threads); medians of the active steps;
//! - 100, 1,000 and 10,000 tori of 180 primitives in a heap;
//! - times of impact of 2.1 million primitive pairs, the paper's brute force.
//!
//! The built program needs nothing but `assets/models` beside it and a graphics driver; a software one will do.

#[path = "common/activity.rs"]
mod activity;
#[path = "common/outcome.rs"]
mod outcome;

use std::{
    fmt::Write,
    path::PathBuf,
    process::ExitCode,
    time::{Duration, Instant},
};

use activity::{Activity, active, median};
use bevy::{
    prelude::*,
    tasks::{ComputeTaskPool, TaskPool},
};
use bevy_medial::{
    geometry::{Obb, Pose3, Sphere, Sweep},
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError, GpuImpacts, MovingPair},
    pipeline::{Body, Shape, StaticBody, Statics, StepInput, step},
    plugin::MedialStep,
    prelude::MedialAxis,
    query::Moving,
    scenes::{Monitor, Scene, headless_app, load_models},
};
use clap::Parser;

#[derive(Parser)]
struct Args {
    /// Few steps and small heaps, to try it.
    #[arg(long)]
    quick: bool,
    /// Folder for `gpu.csv`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Folder of the models.
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/models"))]
    models: PathBuf,
    /// What `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

/// The passes, in order.
const PASSES: [&str; 7] = ["place", "sort", "tree", "broad", "chords", "mid", "narrow"];

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let gpu = GpuDevice::request()?;
    println!("GPU: {}", gpu.name());
    let mut csv = format!(
        "gpu,what,bodies,primitive_pairs,{},call_ms,cpu_ms\n",
        PASSES.map(|pass| format!("{pass}_ms")).join(",")
    );
    println!(
        "{:24} {:>10} | {} | {:>9} {:>9}",
        "ms",
        "pairs",
        PASSES.map(|p| format!("{p:>8}")).join(" "),
        "call",
        "CPU"
    );
    let models = load_models(&args.models)?;
    for (name, steps) in [("rods", 600), ("dinosaur", 120), ("tori", 600), ("stairs", 600)] {
        let steps = if args.quick { 40 } else { steps };
        let mut app = headless_app(1.0 / 60.0);
        let scene = Scene::by_name(name).ok_or("no such scene")?;
        scene.spawn(app.world_mut(), &models, 1);
        let mut culling = GpuCulling::new(&gpu, GpuCapacity::default())?;
        let (mut rows, mut activities) = (Vec::new(), Vec::new());
        for _ in 0..steps {
            app.update();
            let step = app.world().resource::<MedialStep>();
            rows.push(Row::measure(&mut culling, &step.input, &step.statics)?);
            let row = app.world().resource::<Monitor>().rows.last();
            activities.push(Activity {
                contact_pairs: step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count(),
                energy: row.map_or(0.0, |row| row.kinetic_energy_per_kg),
            });
        }
        let active = active(&activities);
        let rows: Vec<Row> = rows.into_iter().zip(active).filter(|(_, active)| *active).map(|(row, _)| row).collect();
        tell(&mut csv, gpu.name(), name, &rows);
    }
    for bodies in [100, 1000, 10_000] {
        if args.quick && bodies > 100 {
            continue;
        }
        let (input, statics) = heap(bodies);
        let mut culling = GpuCulling::new(&gpu, GpuCapacity::default())?;
        // The first call makes room.
        Row::measure(&mut culling, &input, &statics)?;
        let rows: Result<Vec<Row>, GpuError> = (0..5).map(|_| Row::measure(&mut culling, &input, &statics)).collect();
        tell(&mut csv, gpu.name(), &format!("heap of {bodies}"), &rows?);
    }
    brute_force(&gpu, if args.quick { 20_000 } else { 2_100_000 }, &mut csv)?;
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)?;
        let file = folder.join("gpu.csv");
        std::fs::write(&file, csv).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    Ok(())
}

/// What one step took.
struct Row {
    bodies: usize,
    pairs: usize,
    passes: Vec<Duration>,
    call: Duration,
    /// Broad and mid phase.
    cpu: Duration,
}

impl Row {
    fn measure(culling: &mut GpuCulling, input: &StepInput, statics: &Statics) -> Result<Self, GpuError> {
        let clock = Instant::now();
        culling.cull(input, statics)?;
        let call = clock.elapsed();
        let cpu = step(input, statics, ComputeTaskPool::get_or_init(TaskPool::default));
        Ok(Self {
            bodies: input.bodies.len(),
            pairs: cpu.counts.primitive_pairs,
            passes: culling.times().iter().map(|(_, time)| *time).collect(),
            call,
            cpu: cpu.times.broad + cpu.times.mid,
        })
    }
}

fn tell(csv: &mut String, gpu: &str, what: &str, rows: &[Row]) {
    let Some(first) = rows.first() else { return println!("{what}: no step is active") };
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let middle = |time: &dyn Fn(&Row) -> Duration| median(rows.iter().map(|row| milliseconds(time(row))));
    let passes: Vec<f64> =
        (0..PASSES.len()).map(|pass| middle(&|row| row.passes.get(pass).copied().unwrap_or_default())).collect();
    let (call, cpu) = (middle(&|row| row.call), middle(&|row| row.cpu));
    let text = passes.iter().map(|ms| format!("{ms:8.3}")).collect::<Vec<_>>().join(" ");
    println!("{what:24} {:10} | {text} | {call:9.3} {cpu:9.3}", first.pairs);
    let text = passes.iter().map(|ms| format!("{ms:.4}")).collect::<Vec<_>>().join(",");
    // A string can be written to.
    let _ = writeln!(csv, "{gpu},{what},{},{},{text},{call:.4},{cpu:.4}", first.bodies, first.pairs);
}

/// Falling tori in layers on a ground, each near its neighbours.
fn heap(bodies: usize) -> (StepInput, Statics) {
    let axis = MedialAxis::torus(0.2, 0.05, 180).expect("it has proper radii");
    let side = (bodies as f32).cbrt().ceil() as usize;
    let body = |index: usize| {
        let cell = [index % side, index / (side * side), index / side % side].map(|i| i as f32);
        let angle = index as f32;
        let place = Vec3::from(cell) * Vec3::new(0.52, 0.16, 0.52);
        let start = Pose3::from_parts(place, Quat::from_rotation_y(angle) * Quat::from_rotation_x(0.2 * angle.sin()));
        let shape = Shape::new(axis.clone());
        let end = Pose3::from_parts(place - Vec3::Y * 0.02, Quat::from_rotation_y(0.02) * start.rotation);
        Body::new(shape.clone(), Sweep::between(start, end, shape.center_of_mass(), Vec3::ZERO))
    };
    let ground = Obb { pose: Pose3::from_translation(Vec3::NEG_Y), half_extents: Vec3::new(100.0, 0.8, 100.0) };
    let input = StepInput { bodies: (0..bodies).map(body).collect(), prediction: 0.01, ..default() };
    (input, Statics::new(vec![StaticBody::solid_box(ground)]))
}

/// Times of impact of moving cones, in as many parts as the device wants.
fn brute_force(gpu: &GpuDevice, count: usize, csv: &mut String) -> Result<(), GpuError> {
    let mut impacts = GpuImpacts::new(gpu)?;
    let cone = |i: usize, x: f32| {
        let angle = i as f32;
        let axis = Vec3::new(angle.cos(), angle.sin(), (0.7 * angle).sin());
        let center = Vec3::X * x;
        Moving {
            start: [Sphere::new(center - axis, 0.1), Sphere::new(center + axis, 0.2)],
            motion: [Vec3::X * -x * (0.5 + (0.3 * angle).sin().abs()); 2],
        }
    };
    const PART: usize = 1 << 17;
    let mut time = Duration::ZERO;
    for part in (0..count).step_by(PART) {
        let pairs: Vec<MovingPair> =
            (part..count.min(part + PART)).map(|i| MovingPair::new(&cone(i, -3.0), &cone(i + 7, 0.0))).collect();
        impacts.run(&pairs)?;
        time += impacts.time().unwrap_or_default();
    }
    let milliseconds = time.as_secs_f64() * 1e3;
    println!(
        "brute force: {count} pairs of cones in {milliseconds:.2} ms, {:.1} ns each",
        milliseconds * 1e6 / count as f64
    );
    // A string can be written to.
    let _ = writeln!(csv, "{},brute force,,{count},,,,,,,{milliseconds:.4},,", gpu.name());
    Ok(())
}
