//! The queries of every method for every approach.

use std::time::Instant;

use indicatif::ProgressBar;
use serde::Serialize;

use crate::{
    approach::{Approach, Class},
    methods::{Asked, Method, Prepared, prepare, resolutions},
    models::Model,
};

/// Number of runs of each query. The min time counts, which reduces the influence of other programs on the machine.
const ROUNDS: usize = 3;

/// Triangle meshes are queried for one of this number of approaches, because their queries take tenths of a second.
const SLOW_STRIDE: usize = 10;

/// Two models and their approaches.
pub struct Case<'a> {
    pub models: [&'a Model; 2],
    pub approaches: Vec<Approach>,
}

/// A method at a resolution, over all approaches. An error is the path of the contact point between the true and the computed time, in percent of
/// the smaller model's diagonal. Missed hits and grazes are percentages of all hits and grazes, and false positives of all near misses.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub method: &'static str,
    pub resolution: usize,
    /// Mean over the models, like bytes and preparation.
    pub parts: f64,
    pub bytes: f64,
    pub preparation_s: f64,
    /// Max distance from the exact mesh to the shape over all models, in percent of the diagonal.
    pub surface_error_percent: f32,
    pub hit_error_median_percent: f64,
    pub hit_error_p95_percent: f64,
    pub graze_error_median_percent: f64,
    pub graze_error_p95_percent: f64,
    pub normal_error_median_degrees: f64,
    pub normal_error_p95_degrees: f64,
    pub missed_hits_percent: f64,
    pub missed_grazes_percent: f64,
    pub false_positives_percent: f64,
    /// Mean over all queries.
    pub microseconds: f64,
    pub queries: usize,
}

/// The resolutions of a run.
pub struct Plan<'a> {
    pub sphere_counts: &'a [usize],
    pub decompositions: usize,
}

/// All rows of a method, the coarsest first.
///
/// # Errors
/// If a shape cannot be made.
pub fn rows(method: Method, models: &[Model], cases: &[Case], plan: &Plan) -> Result<Vec<Row>, String> {
    let count = models.iter().map(|model| resolutions(method, model, plan.sphere_counts, plan.decompositions)).min();
    let progress = ProgressBar::new(count.unwrap_or(0) as u64).with_message(method.name());
    let (mut rows, mut before) = (Vec::new(), Vec::new());
    for resolution in 0..count.unwrap_or(0) {
        let make = |model| Ok((model, prepare(method, model, resolution, plan.sphere_counts)?));
        let prepared = models.iter().map(make).collect::<Result<Vec<(&Model, Prepared)>, String>>()?;
        progress.inc(1);
        // A resolution that does not change the size of any shape is left out.
        let sizes: Vec<usize> = prepared.iter().map(|(_, prepared)| prepared.bytes).collect();
        if sizes != before {
            rows.push(row(method, resolution, &prepared, cases));
            before = sizes;
        }
    }
    progress.finish_and_clear();
    Ok(rows)
}

fn row(method: Method, resolution: usize, prepared: &[(&Model, Prepared)], cases: &[Case]) -> Row {
    let mut tally = Tally::default();
    for case in cases {
        let of =
            |model: &Model| prepared.iter().find(|(other, _)| other.name == model.name).map(|(_, p)| p.body.clone());
        let [Some(first), Some(second)] = case.models.map(of) else { continue };
        let mut asked = Asked::new(method, [first, second]);
        let size = f64::from(case.models[0].diagonal.min(case.models[1].diagonal));
        let (stride, rounds) = if method == Method::TriMesh { (SLOW_STRIDE, 1) } else { (1, ROUNDS) };
        for approach in case.approaches.iter().step_by(stride) {
            tally.ask(&mut asked, approach, size, rounds);
        }
    }
    let mean = |value: fn(&Prepared) -> f64| {
        prepared.iter().map(|(_, prepared)| value(prepared)).sum::<f64>() / prepared.len().max(1) as f64
    };
    let [hits, grazes, misses] = &mut tally.classes;
    let mut normals: Vec<f64> = hits.normals.iter().chain(&grazes.normals).copied().collect();
    Row {
        method: method.name(),
        resolution,
        parts: mean(|p| p.parts as f64),
        bytes: mean(|p| p.bytes as f64),
        preparation_s: mean(|p| p.preparation.as_secs_f64()),
        surface_error_percent: prepared.iter().map(|(_, p)| p.error.max).fold(0.0, f32::max),
        hit_error_median_percent: quantile(&mut hits.errors, 0.5),
        hit_error_p95_percent: quantile(&mut hits.errors, 0.95),
        graze_error_median_percent: quantile(&mut grazes.errors, 0.5),
        graze_error_p95_percent: quantile(&mut grazes.errors, 0.95),
        normal_error_median_degrees: quantile(&mut normals, 0.5),
        normal_error_p95_degrees: quantile(&mut normals, 0.95),
        missed_hits_percent: hits.wrong_percent(),
        missed_grazes_percent: grazes.wrong_percent(),
        false_positives_percent: misses.wrong_percent(),
        microseconds: tally.seconds * 1e6 / tally.queries.max(1) as f64,
        queries: tally.queries,
    }
}

#[derive(Default)]
struct Tally {
    /// Hits, grazes, misses.
    classes: [Found; 3],
    seconds: f64,
    queries: usize,
}

#[derive(Default)]
struct Found {
    asked: usize,
    wrong: usize,
    errors: Vec<f64>,
    normals: Vec<f64>,
}

impl Found {
    fn wrong_percent(&self) -> f64 {
        100.0 * self.wrong as f64 / self.asked.max(1) as f64
    }
}

impl Tally {
    fn ask(&mut self, asked: &mut Asked, approach: &Approach, size: f64, rounds: usize) {
        let mut answer = None;
        let mut least = f64::INFINITY;
        for _ in 0..rounds {
            let clock = Instant::now();
            answer = asked.first_touch(&approach.sweeps);
            least = least.min(clock.elapsed().as_secs_f64());
        }
        self.seconds += least;
        self.queries += 1;
        let class = match approach.class {
            Class::Hit => &mut self.classes[0],
            Class::Graze => &mut self.classes[1],
            Class::Miss => &mut self.classes[2],
        };
        class.asked += 1;
        match (&approach.truth, answer) {
            (Some(truth), Some(answer)) => {
                let late = (f64::from(answer.fraction) - truth.fraction).abs();
                class.errors.push(100.0 * late * approach.speed / size);
                let cosine = answer.normal.as_dvec3().dot(truth.normal).clamp(-1.0, 1.0);
                class.normals.push(cosine.acos().to_degrees());
            }
            (Some(_), None) | (None, Some(_)) => class.wrong += 1,
            (None, None) => {}
        }
    }
}

/// The quantile of the values at `part`. NaN without values.
fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(((values.len() as f64 * part) as usize).min(values.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}
