//! Times of the GPU back end alone: each pass, as reported by the device, and a whole call with upload, wait and readback.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin gpu -- [--quick] [--out DIR]
//! ```
//!
//! - scenes: medians over the active steps of a run, whose inputs are culled again on the GPU and on all threads of the CPU;
//! - heaps: the round trip of a call for two bodies, heaps of 10 to 10,000 tori of 180 primitives, and the size from which the GPU is faster;
//! - saved work: how many primitive pairs the CPU evaluates exactly, with and without the bounds of the GPU. It does not depend on the device;
//! - brute force: bounds of all 2.1 million primitive pairs of two bodies, as in the paper.
//!
//! A warm-up of one second precedes each measurement, because an idle device is slower. The built program needs only a graphics driver. A software
//! driver is enough.

use std::{
    path::PathBuf,
    process::ExitCode,
    time::{Duration, Instant},
};

use bevy::{
    prelude::*,
    tasks::{ComputeTaskPool, TaskPool},
};
use bevy_medial::{
    builder::MedialLevels,
    geometry::{Obb, Pose3, Sphere, Sweep},
    gpu::{GpuCapacity, GpuCulling, GpuDevice, GpuError},
    pipeline::{
        Body, Candidates, PairFilter, Primitives, Shape, Side, StaticBody, Statics, StepInput, step,
        step_from_candidates,
    },
    plugin::MedialStep,
    prelude::{MedialAxis, MedialBudget},
    query::{Moving, times_of_impact},
    scenes::{Model, Monitor, Scene, headless_app, load_models, set_budget},
};
use bevy_medial_compare::{
    activity::{Activity, active, median},
    outcome,
    tables::{self, today},
};
use clap::Parser;
use serde::Serialize;

#[derive(Parser)]
struct Args {
    /// Few steps and small heaps: a short test of the program.
    #[arg(long)]
    quick: bool,
    /// Folder for `gpu.csv` and `gpu_saved.csv`.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Folder of models to use instead of the models of the crate.
    #[arg(long)]
    models: Option<PathBuf>,
}

macro_rules! models {
    ($($name:literal)*) => {
        [$(($name, include_bytes!(concat!("../assets/models/", $name, ".medial")).as_slice())),*]
    };
}

/// The models of the crate, embedded in the program.
const MODELS: [(&str, &[u8]); 10] =
    models!["armadillo" "bear" "bug" "bunny" "cow" "deer" "dinosaur" "dolphin" "spider" "torus"];

/// Scenes with their number of steps, and a budget in percent if it is not the default.
const SCENES: [(&str, usize, Option<f32>); 5] = [
    ("rods", 600, None),
    ("dinosaur", 120, None),
    ("dinosaur", 120, Some(0.3)),
    ("tori", 600, None),
    ("stairs", 600, None),
];

/// The passes, in order.
const PASSES: [&str; 7] = ["place", "sort", "tree", "broad", "chords", "mid", "narrow"];

/// Duration of the warm-up before a measurement.
const WARM_UP: Duration = Duration::from_secs(1);
/// Time limit of a measurement. After it, no further step is started.
const PATIENCE: Duration = Duration::from_secs(10);

/// Cost of a step. Times are in milliseconds.
#[derive(Clone, Debug, Default, Serialize)]
struct Row {
    date: String,
    gpu: String,
    what: String,
    bodies: usize,
    /// Primitive pairs that brute force would test.
    primitive_pairs: usize,
    /// Primitive pairs whose time of impact the GPU computed.
    tested: usize,
    place_ms: f64,
    sort_ms: f64,
    tree_ms: f64,
    broad_ms: f64,
    chords_ms: f64,
    mid_ms: f64,
    narrow_ms: f64,
    /// Time of a call with upload, wait and readback.
    call_ms: f64,
    /// Broad and mid phase on the CPU. For brute force: the times of impact on one thread.
    cpu_ms: f64,
    /// Primitive pairs that the narrow phase tests per second of GPU time.
    pairs_per_second: f64,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let gpu = GpuDevice::request()?;
    println!("GPU: {}, {}", gpu.name(), today());
    let passes = PASSES.map(|pass| format!("{pass:>8}")).join(" ");
    println!("{:16} {:>11} {:>9} | {passes} | {:>9} {:>9} {:>9}", "ms", "pairs", "tested", "call", "CPU", "pairs/s");
    let models = models(args)?;
    let (mut rows, mut saved) = (Vec::new(), Vec::new());
    for (name, steps, budget) in SCENES {
        let what = budget.map_or_else(|| name.into(), |budget| format!("{name}, {budget} %"));
        let steps = scene(&models, name, if args.quick { 40 } else { steps }, budget)?;
        rows.extend(measure(&gpu, &what, &steps)?);
        saved.push(Saved::measure(&gpu, &what, &steps)?);
    }
    let heaps: &[usize] = if args.quick { &[2, 10, 100] } else { &[2, 10, 32, 100, 316, 1000, 3162, 10_000] };
    let mut crossover = None;
    for &bodies in heaps {
        let name = if bodies == 2 { "round trip".into() } else { format!("heap of {bodies}") };
        let row = measure(&gpu, &name, &vec![heap(bodies); 5])?;
        if let Some(row) = &row {
            let from = crossover.filter(|_| row.call_ms < row.cpu_ms);
            crossover = from.or((row.call_ms < row.cpu_ms).then_some(row.primitive_pairs));
        }
        rows.extend(row);
    }
    match crossover {
        Some(pairs) => println!("the GPU is faster in heaps from {pairs} primitive pairs on"),
        None => println!("the CPU is faster in the largest heap"),
    }
    rows.push(brute_force(&gpu, if args.quick { 141 } else { 1_449 })?.named(&gpu, "brute force"));
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)?;
        tables::write(&folder.join("gpu.csv"), &tables::csv(&rows))?;
        tables::write(&folder.join("gpu_saved.csv"), &tables::csv(&saved))?;
    }
    Ok(())
}

fn models(args: &Args) -> Result<Vec<Model>, Box<dyn std::error::Error>> {
    if let Some(folder) = &args.models {
        return Ok(load_models(folder)?);
    }
    let model = |(name, bytes): (&str, &[u8])| {
        let axis = MedialLevels::from_bytes(bytes)?.into_medial_axis().ok_or("a model without levels")?;
        Ok(Model { name: name.into(), axis })
    };
    MODELS.into_iter().map(model).collect()
}

/// The input of a step.
type Given = (StepInput, Statics);

/// The inputs of the active steps of a scene.
fn scene(
    models: &[Model],
    name: &str,
    steps: usize,
    budget: Option<f32>,
) -> Result<Vec<Given>, Box<dyn std::error::Error>> {
    let mut app = headless_app(1.0 / 60.0);
    if let Some(percent) = budget {
        set_budget(&mut app, MedialBudget::Percent(percent));
    }
    Scene::by_name(name).ok_or("no such scene")?.spawn(app.world_mut(), models, 1);
    let (mut given, mut activities) = (Vec::new(), Vec::new());
    for _ in 0..steps {
        app.update();
        let step = app.world().resource::<MedialStep>();
        given.push((step.input.clone(), step.statics.clone()));
        let row = app.world().resource::<Monitor>().rows.last();
        activities.push(Activity {
            contact_pairs: step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count(),
            energy: row.map_or(0.0, |row| row.kinetic_energy_per_kg),
        });
    }
    let active = active(&activities);
    Ok(given.into_iter().zip(active).filter(|(_, active)| *active).map(|(given, _)| given).collect())
}

/// Work of the CPU in the active steps of a scene, alone and with the bounds of the GPU. Impacts and contacts are the same.
#[derive(Clone, Debug, Default, Serialize)]
struct Saved {
    what: String,
    steps: usize,
    /// Body pairs with an impact.
    impacts: usize,
    /// Primitive pairs of these body pairs whose distance and time of impact the CPU computed.
    exact_of_impacts: usize,
    bounded_of_impacts: usize,
    /// The same for all body pairs.
    exact: usize,
    bounded: usize,
    /// Mid and narrow phase, without the time of the GPU.
    exact_ms: f64,
    bounded_ms: f64,
}

impl Saved {
    fn measure(gpu: &GpuDevice, what: &str, steps: &[Given]) -> Result<Self, GpuError> {
        let mut culling = GpuCulling::new(gpu, GpuCapacity::default())?;
        let mut saved = Self { what: what.into(), steps: steps.len(), ..default() };
        for (input, statics) in steps {
            let bounded = culling.cull(input, statics)?;
            let unknown: Vec<Candidates> =
                bounded.iter().map(|pair| Candidates { primitives: Primitives::Unknown, ..pair.clone() }).collect();
            // Searches after an impact are those of other paths, to which the bounds do not apply.
            let input = &StepInput { stop_at_impact: false, ..input.clone() };
            let run = |candidates: &[Candidates]| {
                let filter = |_, _| PairFilter::Stopping;
                let output = step_from_candidates(input, statics, candidates.to_vec(), filter, pool());
                let time = milliseconds(output.times.mid + output.times.narrow);
                (output, time)
            };
            let ((output, exact_ms), (with_bounds, bounded_ms)) = (run(&unknown), run(&bounded));
            assert_eq!(output.pairs, with_bounds.pairs, "bounds change a step of {what}");
            saved.exact += output.counts.toi_tests;
            saved.bounded += with_bounds.counts.toi_tests;
            saved.exact_ms += exact_ms;
            saved.bounded_ms += bounded_ms;
            let hit: Vec<[Side; 2]> = output
                .pairs
                .iter()
                .filter(|pair| pair.impact.is_some())
                .map(|pair| [pair.first, pair.second])
                .collect();
            let of_impacts = |candidates: &[Candidates]| {
                let is_hit = |pair: &&Candidates| {
                    let [first, second] = pair.sides;
                    hit.contains(&[first, second]) || hit.contains(&[second, first])
                };
                let candidates: Vec<_> = candidates.iter().filter(is_hit).cloned().collect();
                run(&candidates).0.counts.toi_tests
            };
            saved.impacts += hit.len();
            saved.exact_of_impacts += of_impacts(&unknown);
            saved.bounded_of_impacts += of_impacts(&bounded);
        }
        let Self { impacts, exact_of_impacts, bounded_of_impacts, exact, bounded, exact_ms, bounded_ms, .. } = &saved;
        println!(
            "{what:16} exact evaluations with bounds over without: {bounded} / {exact}, {bounded_of_impacts} / {exact_of_impacts} in {impacts} \
             body pairs with impacts; mid and narrow phase {bounded_ms:.1} / {exact_ms:.1} ms"
        );
        Ok(saved)
    }
}

fn pool() -> &'static TaskPool {
    ComputeTaskPool::get_or_init(TaskPool::default)
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

impl Row {
    fn measure(culling: &mut GpuCulling, (input, statics): &Given) -> Result<Self, GpuError> {
        let clock = Instant::now();
        culling.cull(input, statics)?;
        let call_ms = milliseconds(clock.elapsed());
        let mut row = Self { bodies: input.bodies.len(), tested: culling.counts()[2] as usize, call_ms, ..default() };
        for (place, (_, time)) in row.passes().into_iter().zip(culling.times()) {
            *place = milliseconds(*time);
        }
        Ok(row)
    }

    fn measure_cpu(&mut self, (input, statics): &Given) {
        let cpu = step(input, statics, pool());
        self.primitive_pairs = cpu.counts.primitive_pairs;
        self.cpu_ms = milliseconds(cpu.times.broad + cpu.times.mid);
    }

    /// Completes the row with the date, its subject and the device, and prints it.
    fn named(mut self, gpu: &GpuDevice, what: &str) -> Self {
        (self.date, self.gpu, self.what) = (today(), gpu.name().into(), what.into());
        if self.narrow_ms > 0.0 {
            self.pairs_per_second = (self.tested as f64 * 1e3 / self.narrow_ms).round();
        }
        let passes = self.passes().map(|ms| format!("{ms:8.3}")).join(" ");
        let Self { primitive_pairs, tested, call_ms, cpu_ms, pairs_per_second, .. } = self;
        println!(
            "{what:16} {primitive_pairs:11} {tested:9} | {passes} | {call_ms:9.3} {cpu_ms:9.3} {pairs_per_second:9.2e}"
        );
        self
    }

    /// Times of the passes, in order.
    fn passes(&mut self) -> [&mut f64; 7] {
        let Self { place_ms, sort_ms, tree_ms, broad_ms, chords_ms, mid_ms, narrow_ms, .. } = self;
        [place_ms, sort_ms, tree_ms, broad_ms, chords_ms, mid_ms, narrow_ms]
    }
}

/// Measures the steps until [`PATIENCE`] is over, and returns the medians. `None` if there are no steps.
fn measure(gpu: &GpuDevice, what: &str, steps: &[Given]) -> Result<Option<Row>, GpuError> {
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default())?;
    let clock = Instant::now();
    for (input, statics) in steps.iter().cycle().take_while(|_| clock.elapsed() < WARM_UP) {
        culling.cull(input, statics)?;
    }
    let (clock, mut rows) = (Instant::now(), Vec::new());
    for step in steps.iter().take_while(|_| clock.elapsed() < PATIENCE) {
        rows.push(Row::measure(&mut culling, step)?);
    }
    for (row, step) in rows.iter_mut().zip(steps) {
        row.measure_cpu(step);
    }
    let Some(mut row) = rows.first().cloned() else {
        println!("{what}: no step is active");
        return Ok(None);
    };
    for pass in 0..PASSES.len() {
        *row.passes()[pass] = median(rows.iter_mut().map(|row| *row.passes()[pass]));
    }
    row.tested = median(rows.iter().map(|row| row.tested as f64)) as usize;
    row.call_ms = median(rows.iter().map(|row| row.call_ms));
    row.cpu_ms = median(rows.iter().map(|row| row.cpu_ms));
    Ok(Some(row.named(gpu, what)))
}

/// Falling tori in layers on a ground, each near its neighbours.
fn heap(bodies: usize) -> Given {
    let axis = MedialAxis::torus(0.2, 0.05, 180).expect("the radii are valid");
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

/// Two tori of cones that fly through each other. All primitive pairs are tested, without hierarchies, as in the paper.
fn brute_force(gpu: &GpuDevice, primitives: u32) -> Result<Row, GpuError> {
    let axis = MedialAxis::torus(0.2, 0.05, primitives).expect("the radii are valid");
    let body = |x: f32| {
        let sweep = Sweep::at_rates(Pose3::from_translation(Vec3::X * x), Vec3::ZERO, Vec3::X * -2.0 * x, Vec3::ZERO);
        Body::new(Shape::new(axis.clone()), sweep)
    };
    let given = (StepInput { bodies: vec![body(0.6), body(-0.6)], prediction: 0.01, ..default() }, Statics::default());
    let mut culling = GpuCulling::new(gpu, GpuCapacity::default())?;
    culling.set_flat(true);
    let clock = Instant::now();
    while clock.elapsed() < WARM_UP {
        culling.cull(&given.0, &given.1)?;
    }
    let mut row = Row::measure(&mut culling, &given)?;
    row.primitive_pairs = row.tested;
    let approaching = |i: u32| axis.spheres()[i as usize % axis.spheres().len()];
    let moving = |i: u32, x: f32| Moving {
        start: [approaching(i), approaching(i + 1)]
            .map(|sphere| Sphere::new(sphere.center + Vec3::X * x, sphere.radius)),
        motion: [Vec3::X * -2.0 * x; 2],
    };
    let pairs: Vec<_> = (0..primitives)
        .flat_map(|i| (0..primitives).map(move |j| (i, j)))
        .map(|(i, j)| (moving(i, 0.6), moving(j, -0.6)))
        .collect();
    let clock = Instant::now();
    std::hint::black_box(times_of_impact(&pairs, 1.0));
    row.cpu_ms = milliseconds(clock.elapsed());
    Ok(row)
}
