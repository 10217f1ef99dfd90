//! Runs a scene in an engine, and measures times, overlaps and losses.

use std::time::Duration;

use bevy_medial::builder::Deviation;
use indicatif::ProgressBar;
use serde::Serialize;

use crate::{
    activity::{Activity, active, median},
    body::State,
    demo::Demo,
    engines::{Engine, StepTimes},
    overlap::Surfaces,
};

/// Figures of the shapes of a scene.
#[derive(Clone, Copy)]
pub struct ShapeFigures {
    /// Number of primitives, hulls or triangles: the mean over the models.
    pub parts: f64,
    /// Distance from the exact mesh to the shape, in percent of the mesh's diagonal: the max over all models, and the mean.
    pub error: Deviation,
}

/// A row of the table. Times are in milliseconds: medians, and sums over all steps.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub scene: &'static str,
    pub engine: &'static str,
    pub steps: usize,
    pub active_steps: usize,
    pub collision_ms: f64,
    pub collision_active_ms: f64,
    pub step_ms: f64,
    pub step_active_ms: f64,
    /// Over all steps.
    pub collision_sum_ms: f64,
    pub step_sum_ms: f64,
    pub contact_pairs_active: f64,
    pub overlap_max_percent: f32,
    pub overlap_median_percent: f64,
    pub bodies: usize,
    pub lost: usize,
    pub parts: f64,
    pub error_max_percent: f32,
    pub error_mean_percent: f32,
}

/// Max number of steps, evenly spread, in which overlaps are measured.
const SAMPLES: usize = 120;

/// Binds the process to one core. Threads that are started later inherit the binding.
pub fn bind_to_one_core() {
    let core = core_affinity::get_core_ids().and_then(|cores| cores.first().copied());
    if !core.is_some_and(core_affinity::set_for_current) {
        eprintln!("the process cannot be bound to one core: times are those of threads on several cores");
    }
}

/// Size of a measurement.
#[derive(Clone, Copy)]
pub struct Plan {
    /// Number of steps of a run.
    pub steps: usize,
    /// Number of equal runs. The fastest run of each step counts, which reduces the influence of other programs on the machine.
    pub runs: usize,
}

/// Runs an engine. Overlaps and losses are measured after the run, so that only the engine runs between its steps.
///
/// # Errors
/// If the engine cannot be made.
pub fn run(
    (scene, name): (&'static str, &'static str),
    demo: &Demo,
    surfaces: &Surfaces,
    shape: ShapeFigures,
    make: &dyn Fn() -> Result<Box<dyn Engine>, String>,
    Plan { steps, runs }: Plan,
) -> Result<Row, String> {
    let (mut times, mut states): (Vec<StepTimes>, Vec<Vec<State>>) = (Vec::new(), Vec::new());
    for run in 0..runs.max(1) {
        let mut engine = make()?;
        for step in 0..steps {
            let time = engine.step(demo.setup.dt);
            if run == 0 {
                times.push(time);
                states.push((0..demo.bodies.len()).map(|body| engine.state(body)).collect());
            } else {
                times[step].collision = times[step].collision.min(time.collision);
                times[step].whole = times[step].whole.min(time.whole);
            }
        }
    }
    let activities = times.iter().zip(&states);
    let activities = activities
        .map(|(time, states)| Activity { contact_pairs: time.contact_pairs, energy: demo.energy(states) })
        .collect::<Vec<_>>();
    let active = active(&activities);
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let collision: Vec<f64> = times.iter().map(|time| ms(time.collision)).collect();
    let whole: Vec<f64> = times.iter().map(|time| ms(time.whole)).collect();
    let pairs: Vec<f64> = times.iter().map(|time| time.contact_pairs as f64).collect();
    let [collision_ms, collision_active_ms] = medians(&collision, &active);
    let [step_ms, step_active_ms] = medians(&whole, &active);
    let [_, contact_pairs_active] = medians(&pairs, &active);

    let every = steps.div_ceil(SAMPLES).max(1);
    let samples = states.iter().step_by(every);
    let progress = ProgressBar::new(samples.len() as u64).with_message("overlaps");
    let overlaps: Vec<f32> = progress.wrap_iter(samples).map(|states| surfaces.deepest(states)).collect();
    let sampled_active = active.iter().step_by(every);
    let typical = overlaps.iter().zip(sampled_active).filter(|(_, active)| **active);
    Ok(Row {
        scene,
        engine: name,
        steps,
        active_steps: active.iter().filter(|active| **active).count(),
        collision_ms,
        collision_active_ms,
        step_ms,
        step_active_ms,
        collision_sum_ms: collision.iter().sum(),
        step_sum_ms: whole.iter().sum(),
        contact_pairs_active,
        overlap_max_percent: overlaps.iter().copied().fold(0.0, f32::max),
        overlap_median_percent: median(typical.map(|(overlap, _)| f64::from(*overlap))),
        bodies: demo.bodies.iter().filter(|body| body.is_dynamic()).count(),
        lost: states.last().map_or(0, |states| demo.lost(states)),
        parts: shape.parts,
        error_max_percent: shape.error.max,
        error_mean_percent: shape.error.mean,
    })
}

/// The medians over all steps and over the active ones.
fn medians(values: &[f64], active: &[bool]) -> [f64; 2] {
    let chosen = values.iter().zip(active).filter(|(_, active)| **active);
    [median(values.iter().copied()), median(chosen.map(|(value, _)| *value))]
}
