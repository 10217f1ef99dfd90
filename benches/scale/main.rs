//! Growth of collision with the number of bodies, the gain of a second thread, and the memory of a body and of a step.
//!
//! ```text
//! cargo run --release -p bevy_medial_compare --bin scale -- [--quick] [--out DIR]
//! ```
//!
//! - **rain**: 100, 1,000 and 10,000 deer of about 180 primitives and 1 m in size fall on a ground with boxes. The numbers per square metre are constant.
//!   Medians on one thread, over the steps with at least one pair in contact per two bodies;
//! - **fall**: 10,000 such bodies fall without coming near each other;
//! - **threads**: steps of 1,000 bodies in the rain run again on one thread and on two, alternately; the min of several runs;
//! - **stops**: the time that stops at impacts add to a step of the scene `dinosaur`, on one thread. The same steps run with and without stops;
//! - **view**: the time of an update while physics is paused, with 1,000 bodies of the rain in contact: with the debug view off, with shapes, with all
//!   layers except the candidates, and with all layers. On the CPU, without a renderer;
//! - **own shapes**: 120 convex decompositions of rapier fall into a bin, with the plugin and without it, in turns;
//! - **sleeping**: an update with 5,000 sleeping medial boxes, and with rapier's cuboids without the plugin, in turns;
//! - **memory**: bytes of a step's input per body, bytes kept between steps without the output, and allocations of a step, from a counting allocator.

mod beside_rapier;

use std::{
    ops::ControlFlow,
    path::{Path, PathBuf},
    process::ExitCode,
    time::{Duration, Instant},
};

use allocation_counter::measure;
use bevy::{
    prelude::*,
    tasks::{TaskPool, TaskPoolBuilder},
};
use bevy_medial::{
    builder::{BuildOptions, build, load::load},
    geometry::{Pose3, Sweep},
    pipeline::{Body, Manifold, Pair, PairFilter, Shape, Statics, StepInput, StepOutput, Stop, Workspace},
    plugin::{MedialDebugPlugin, MedialGizmos, MedialStep},
    prelude::*,
    scenes::{Scene, headless_app, load_models},
};
use bevy_medial_compare::{activity::median, outcome, tables};
use bevy_rapier3d::prelude::{RapierConfiguration, RigidBody};
use clap::Parser;
use indicatif::ProgressBar;
use serde::Serialize;

#[derive(Parser)]
struct Args {
    /// Few bodies and steps: a short test of the program.
    #[arg(long)]
    quick: bool,
    /// Folder for `scale.csv`.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// A measured value.
#[derive(Serialize)]
struct Row {
    what: &'static str,
    bodies: usize,
    value: f64,
    unit: &'static str,
}

fn main() -> ExitCode {
    outcome::of(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    // The thread that waits for a pool executes its tasks as well, so a pool of 0 threads has one thread.
    let (one, two) = (pool(0), pool(1));
    let deer = deer()?;
    println!("a deer of {} primitives", deer.axis.primitives().len());
    let (counts, steps): (&[usize], usize) = if args.quick { (&[20, 100], 60) } else { (&[100, 1000, 10_000], 60) };
    let mut rows = Vec::new();
    let mut report = |what, bodies, value, unit| {
        println!("{what:36} {bodies:6} bodies {value:12.3} {unit}");
        rows.push(Row { what, bodies, value, unit });
    };

    let (mut ends, mut kept, mut recorded) = (Vec::new(), Vec::new(), Vec::new());
    for &count in counts {
        let rain = rain(&deer, count, steps, count == counts[counts.len().min(2) - 1], &one);
        let collision = median(rain.steps.iter().map(|step| step.collision.as_secs_f64() * 1e3));
        let pairs = median(rain.steps.iter().map(|step| step.contact_pairs as f64));
        report("rain: collision", count, collision, "ms");
        report("rain: pairs in contact", count, pairs, "");
        report("rain: collision of a pair", count, collision * 1e3 / pairs, "us");
        ends.push(((count as f64).ln(), collision.ln()));
        let bytes = kept_by(&rain.last, &one);
        report("memory: kept, contacts aside", count, bytes / 1e3, "kB");
        kept.push((count as f64, bytes));
        if !rain.recorded.is_empty() {
            recorded = rain.recorded;
        }
    }
    if let (Some(first), Some(last)) = (ends.first(), ends.last()) {
        report("rain: exponent of time", counts[counts.len() - 1], (last.1 - first.1) / (last.0 - first.0), "");
    }

    if let [.., before, last] = kept[..] {
        let more = (last.1 - before.1) / (last.0 - before.0);
        report("memory: of it for one body more", counts[counts.len() - 1], more, "bytes");
    }

    let count = counts[counts.len() - 1];
    let (mut input, statics) = (fall(&deer, count), Statics::default());
    let mut falling = Stepper::default();
    let times = (0..21).map(|_| {
        let took = falling.step(&input, &statics, &one).times.total();
        for Body { sweep, .. } in &mut input.bodies {
            *sweep = Sweep::at_rates(sweep.end, sweep.local_center, sweep.translation, sweep.rotation);
        }
        took.as_secs_f64() * 1e3
    });
    report("fall: collision", count, median(times), "ms");

    let bodies = recorded.first().map_or(0, |(input, _): &(StepInput, Statics)| input.bodies.len());
    let mut totals = [Duration::ZERO; 2];
    let mut steppers = [Stepper::default(), Stepper::default()];
    for (input, statics) in &recorded {
        let mut least = [Duration::MAX; 2];
        for _ in 0..if args.quick { 1 } else { 7 } {
            for ((stepper, pool), least) in steppers.iter_mut().zip([&one, &two]).zip(&mut least) {
                let clock = Instant::now();
                stepper.step(input, statics, pool);
                *least = clock.elapsed().min(*least);
            }
            let [Stepper { output: first, .. }, Stepper { output: second, .. }] = &steppers;
            if first.pairs != second.pairs || first.manifolds != second.manifolds || first.stops != second.stops {
                return Err("two threads and one thread give different results".into());
            }
        }
        totals = [0, 1].map(|i: usize| totals[i] + least[i]);
    }
    report("threads: one over two", bodies, totals[0].as_secs_f64() / totals[1].as_secs_f64(), "");

    let mut extra = stops(if args.quick { 30 } else { 120 }, &one)?;
    extra.sort_by(f64::total_cmp);
    report("stops: extra time, median", 0, median(extra.iter().copied()), "ms");
    report("stops: extra time, 95 of 100", 0, extra[extra.len() * 95 / 100], "ms");
    report("stops: extra time, most", 0, extra[extra.len() - 1], "ms");

    let (own, asleep) = if args.quick { (9, 50) } else { (120, 5000) };
    let beside_rapier::Own { sums_ms, last_ms } = beside_rapier::own_shapes(own, if args.quick { 40 } else { 300 })?;
    report("own shapes: sum, rapier alone", own, sums_ms[0], "ms");
    report("own shapes: sum with the plugin, ratio", own, sums_ms[1] / sums_ms[0], "");
    report("own shapes: last updates, ratio", own, last_ms[1] / last_ms[0], "");
    let updates = beside_rapier::sleeping(asleep, if args.quick { 60 } else { 300 })?;
    report("sleeping: an update, rapier's cuboids", asleep, updates[0], "ms");
    report("sleeping: an update, medial, ratio", asleep, updates[1] / updates[0], "");

    let viewed = counts[counts.len().min(2) - 1];
    for (what, median) in view(&deer, viewed, steps) {
        report(what, viewed, median, "ms");
    }

    if let Some((input, statics)) = recorded.last() {
        let copied = measure(|| drop(std::hint::black_box(input.clone())));
        report("memory: input of a body", bodies, copied.bytes_total as f64 / bodies as f64, "bytes");
        let mut stepper = Stepper::default();
        stepper.step(input, statics, &one);
        report("memory: pairs of bodies that are near", bodies, stepper.output.counts.body_pairs as f64, "");
        let warm = measure(|| _ = stepper.step(input, statics, &one));
        report("memory: allocations of a warm step", bodies, warm.count_total as f64, "");
        let mut stepper = Stepper::default();
        (0..2).for_each(|_| _ = stepper.step(input, statics, &two));
        let warm = measure(|| _ = stepper.step(input, statics, &two));
        report("memory: the same on two threads", bodies, warm.count_total as f64, "");
    }
    let mut stepper = Stepper::default();
    let first = measure(|| _ = stepper.step(&input, &statics, &one));
    report("memory: kept of a fall, of a body", count, first.bytes_current as f64 / count as f64, "bytes");

    println!("{}", tables::machine());
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        tables::write(&folder.join("scale.csv"), &tables::csv(&rows))?;
    }
    Ok(())
}

/// The body, a metre in size.
fn deer() -> Result<Shape, Box<dyn std::error::Error>> {
    let mesh = load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/models/deer.obj"))?;
    let options = BuildOptions { spheres: SPHERES, searches: Some(1), ..default() };
    let axis = build(&mesh, &options, &|_| ControlFlow::Continue(()))?.axis;
    let scale = 0.5 / axis.bounding_sphere().radius;
    Ok(Shape { axis, scale })
}

/// Runs steps in the same memory.
#[derive(Default)]
struct Stepper {
    workspace: Workspace,
    output: StepOutput,
}

impl Stepper {
    fn step(&mut self, input: &StepInput, statics: &Statics, pool: &TaskPool) -> &StepOutput {
        self.workspace.step(input, statics, |_, _| PairFilter::Stopping, pool, &mut self.output);
        &self.output
    }
}

/// A pool with the given number of threads besides the one that waits.
fn pool(threads: usize) -> TaskPool {
    TaskPoolBuilder::new().num_threads(threads).build()
}

/// A step of the rain.
struct Step {
    collision: Duration,
    contact_pairs: usize,
}

struct Rain {
    /// The steps with at least one pair in contact per two bodies.
    steps: Vec<Step>,
    /// The inputs of some of these steps, if they are recorded.
    recorded: Vec<(StepInput, Statics)>,
    /// The input of the last step.
    last: (StepInput, Statics),
}

/// Number of spheres of the deer, which then has about 180 primitives.
const SPHERES: usize = 144;
/// Distance between neighbours in a layer, in metres.
const SPACING: f32 = 1.0;
/// Number of bodies above each other.
const LAYERS: usize = 5;

/// An app with the bodies above the ground.
fn rainy(deer: &Shape, count: usize) -> App {
    let mut app = headless_app(1.0 / 60.0);
    let mesh = MedialMesh(app.world_mut().resource_mut::<Assets<MedialAxis>>().add(deer.axis.clone()));
    let side = ((count / LAYERS) as f32).sqrt().ceil() as usize;
    let extent = side as f32 * SPACING;
    let world = app.world_mut();
    let middle = Vec3::new(0.5 * extent, 0.0, 0.5 * extent);
    world.spawn((StaticObb::new(extent, 0.5, extent), Transform::from_translation(middle - Vec3::Y * 0.5)));
    for x in (0..side).step_by(2) {
        for z in (0..side).step_by(2) {
            let place = Vec3::new(x as f32 + 0.5, 0.0, z as f32 + 0.5) * SPACING;
            let turn = Quat::from_rotation_y((x * 7 + z * 3) as f32);
            world.spawn((StaticObb::new(0.25, 0.4, 0.25), Transform::from_translation(place).with_rotation(turn)));
        }
    }
    for index in 0..count {
        let (column, layer) = (index / LAYERS, index % LAYERS);
        let cell = Vec3::new((column % side) as f32, layer as f32 + 0.9, (column / side) as f32);
        let angle = index as f32;
        let turn = Quat::from_rotation_y(angle) * Quat::from_rotation_x(0.5 * angle.sin());
        let place = Transform::from_translation(cell * SPACING).with_rotation(turn).with_scale(Vec3::splat(deer.scale));
        world.spawn((RigidBody::Dynamic, mesh.clone(), place));
    }
    app
}

/// Runs the app, and repeats its steps on a pool.
fn rain(deer: &Shape, count: usize, steps: usize, record: bool, pool: &TaskPool) -> Rain {
    let mut app = rainy(deer, count);
    let mut stepper = Stepper::default();
    let (mut taken, mut recorded) = (Vec::new(), Vec::new());
    let progress = ProgressBar::new(steps as u64).with_message(format!("{count} bodies"));
    for number in 0..steps {
        app.update();
        progress.inc(1);
        let step = app.world().resource::<MedialStep>();
        let output = stepper.step(&step.input, &step.statics, pool);
        let contact_pairs = output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count();
        if contact_pairs * 2 >= count {
            taken.push(Step { collision: output.times.total(), contact_pairs });
            if record && number % 4 == 0 {
                recorded.push((step.input.clone(), step.statics.clone()));
            }
        }
    }
    progress.finish_and_clear();
    let step = app.world().resource::<MedialStep>();
    Rain { steps: taken, recorded, last: (step.input.clone(), step.statics.clone()) }
}

/// Bytes that are kept from one step to the next, without the output of the step.
fn kept_by((input, statics): &(StepInput, Statics), pool: &TaskPool) -> f64 {
    let mut stepper = Stepper::default();
    let kept = measure(|| _ = stepper.step(input, statics, pool)).bytes_current;
    let StepOutput { stops, pairs, manifolds, .. } = &stepper.output;
    let reported = stops.capacity() * size_of::<Stop>()
        + pairs.capacity() * size_of::<Pair>()
        + manifolds.capacity() * size_of::<Manifold>();
    kept as f64 - reported as f64
}

/// Median time of an update in milliseconds while physics is paused, with more and more layers of the debug view.
fn view(deer: &Shape, count: usize, steps: usize) -> [(&'static str, f64); 4] {
    let shapes = ["spheres", "cones", "slabs"];
    let mut app = rainy(deer, count);
    MedialDebugPlugin { enabled: false }.build(&mut app);
    let switch = |app: &mut App, is_on: &dyn Fn(&str) -> bool| {
        let mut store = app.world_mut().resource_mut::<GizmoConfigStore>();
        let (group, layers) = store.config_mut::<MedialGizmos>();
        layers.layers_mut().into_iter().for_each(|(name, layer)| layer.enabled = is_on(name));
        group.enabled = layers.layers_mut().iter().any(|(_, layer)| layer.enabled);
    };
    // Steps keep their candidates only if a layer draws them.
    switch(&mut app, &|_| true);
    (0..steps).for_each(|_| app.update());
    let mut contexts = app.world_mut().query::<&mut RapierConfiguration>();
    contexts.iter_mut(app.world_mut()).for_each(|mut rapier| rapier.physics_pipeline_active = false);
    let mut updates = |is_on: &dyn Fn(&str) -> bool| {
        switch(&mut app, is_on);
        // The first updates create the lines of the shapes.
        app.update();
        app.update();
        median((0..30).map(|_| {
            let clock = Instant::now();
            app.update();
            clock.elapsed().as_secs_f64() * 1e3
        }))
    };
    [
        ("view: an update, view off", updates(&|_| false)),
        ("view: an update, shapes", updates(&|name| shapes.contains(&name))),
        ("view: an update, all but candidates", updates(&|name| name != "candidates")),
        ("view: an update, all layers", updates(&|_| true)),
    ]
}

/// Additional time of stops in the steps of `dinosaur`, in milliseconds: the min of several runs.
fn stops(steps: u32, pool: &TaskPool) -> Result<Vec<f64>, Box<dyn std::error::Error>> {
    let models = load_models(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/models"))?;
    let scene = Scene::by_name("dinosaur").ok_or("there is no scene `dinosaur`")?;
    let mut app = headless_app(1.0 / 60.0);
    scene.spawn(app.world_mut(), &models, 1);
    let (mut extra, mut stepper) = (Vec::new(), Stepper::default());
    for _ in 0..steps {
        app.update();
        let medial = app.world().resource::<MedialStep>();
        let inputs = [false, true].map(|stop_at_impact| StepInput { stop_at_impact, ..medial.input.clone() });
        let mut least = [f64::INFINITY; 2];
        for _ in 0..5 {
            let took = inputs.each_ref().map(|input| stepper.step(input, &medial.statics, pool).times.total());
            least = [0, 1].map(|i: usize| least[i].min(took[i].as_secs_f64() * 1e3));
        }
        extra.push(least[1] - least[0]);
    }
    Ok(extra)
}

/// Bodies two metres apart. All of them fall.
fn fall(shape: &Shape, count: usize) -> StepInput {
    let side = (count as f32).cbrt().ceil() as usize;
    let body = |index: usize| {
        let cell = [index % side, index / side % side, index / (side * side)].map(|i| i as f32);
        let rotation = Quat::from_rotation_y(index as f32);
        let center = Vec3::from(cell) * 2.0;
        let start = Pose3::from_parts(center - rotation * shape.bounding_sphere().center, rotation);
        let turn = Vec3::new(0.01, 0.02, 0.0);
        let end = Pose3::from_parts(start.translation - Vec3::Y * 0.1, Quat::from_scaled_axis(turn) * start.rotation);
        Body::new(shape.clone(), Sweep::between(start, end, shape.center_of_mass(), turn))
    };
    StepInput { bodies: (0..count).map(body).collect(), prediction: 0.02, ..default() }
}
