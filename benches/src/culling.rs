//! Comparison of the hybrid culling with others: each step's input is run again with both, alternately, on the same threads.

use std::fmt;

use bevy::{prelude::*, tasks::ComputeTaskPool};
use bevy_medial::{
    pipeline::{Culling, PairFilter, StepInput, StepOutput, Workspace},
    plugin::MedialStep,
    scenes::{Monitor, Row},
};

use crate::{
    activity::{Activity, active, median},
    baselines::{Baseline, Kind},
};

/// The culling to compare with.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Cull {
    /// No comparison: only the culling of the library.
    Hybrid,
    /// Every primitive pair of every body pair.
    None,
    /// Trees of oriented boxes.
    BvhObb,
    /// Trees of spheres.
    BvhSphere,
    /// Trees of world boxes.
    BvhAabb,
    /// Trees of medial primitives.
    BvhMedial,
}

/// A comparison with another culling during a run.
pub struct Comparison {
    name: String,
    baseline: Option<Box<dyn Baseline>>,
    /// The workspaces of the hybrid culling and of the other one.
    workspaces: [Workspace; 2],
    steps: Vec<Step>,
}

/// The figures of one step: of hybrid culling, and of the other.
struct Step {
    contact_pairs: usize,
    figures: [Figures; 2],
}

/// Cost and result of culling. Times are in milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    /// Broad and mid phase, and the updates of a baseline.
    pub culling_ms: f64,
    /// Narrow phase, stops and reduction.
    pub rest_ms: f64,
    /// Pairs of bodies that are left.
    pub body_pairs: f64,
    /// Pairs of primitives that are left.
    pub candidates: f64,
}

impl Figures {
    fn of(output: &StepOutput) -> Self {
        let times = &output.times;
        let culling = times.broad + times.mid;
        Self {
            culling_ms: culling.as_secs_f64() * 1e3,
            rest_ms: (times.total() - culling).as_secs_f64() * 1e3,
            body_pairs: output.counts.body_pairs as f64,
            candidates: output.counts.candidates as f64,
        }
    }

    /// Each figure by its own median.
    fn medians<'a>(steps: impl Iterator<Item = &'a Figures> + Clone) -> Self {
        let of = |value: fn(&Figures) -> f64| median(steps.clone().map(value));
        Self {
            culling_ms: of(|f| f.culling_ms),
            rest_ms: of(|f| f.rest_ms),
            body_pairs: of(|f| f.body_pairs),
            candidates: of(|f| f.candidates),
        }
    }

    /// The time of the whole collision.
    pub fn total_ms(&self) -> f64 {
        self.culling_ms + self.rest_ms
    }
}

/// Medians of a comparison.
#[derive(Clone, Debug)]
pub struct Report {
    /// The other culling.
    pub other: String,
    /// Number of steps, all of them and the active ones.
    pub steps: [usize; 2],
    /// Over all steps and over the active ones, of hybrid culling and of the other.
    pub figures: [[Figures; 2]; 2],
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ([all, active], other) = (self.steps, &self.other);
        writeln!(f, "the same results in every step; medians over {all} steps, and over {active} active ones:")?;
        writeln!(
            f,
            "{:14} {:>10} {other:>10} {:>7}   {:>10} {other:>10} {:>7}",
            "", "hybrid", "ratio", "hybrid", "ratio"
        )?;
        let lines: [(&str, usize, fn(&Figures) -> f64); 5] = [
            ("culling, ms", 4, |f| f.culling_ms),
            ("the rest, ms", 4, |f| f.rest_ms),
            ("collision, ms", 4, Figures::total_ms),
            ("body pairs", 0, |f| f.body_pairs),
            ("candidates", 0, |f| f.candidates),
        ];
        for (label, digits, value) in lines {
            write!(f, "{label:14}")?;
            for [hybrid, other] in self.figures.each_ref().map(|sides| sides.each_ref().map(value)) {
                write!(f, " {hybrid:10.digits$} {other:10.digits$} {:7.2}  ", other / hybrid)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

impl Comparison {
    /// `None` for the hybrid culling itself.
    pub fn with(cull: Cull) -> Option<Self> {
        let baseline = match cull {
            Cull::Hybrid => return None,
            Cull::None => None,
            Cull::BvhObb => Some(Kind::Obb.baseline()),
            Cull::BvhSphere => Some(Kind::Sphere.baseline()),
            Cull::BvhAabb => Some(Kind::Aabb.baseline()),
            Cull::BvhMedial => Some(Kind::Medial.baseline()),
        };
        let name = clap::ValueEnum::to_possible_value(&cull).map_or_else(String::new, |value| value.get_name().into());
        Some(Self { name, baseline, workspaces: Default::default(), steps: Vec::new() })
    }

    /// Runs the input of the last step again with both cullings. Which one is first alternates.
    ///
    /// # Errors
    /// If the result of a culling differs from that of the step.
    pub fn run(&mut self, world: &World) -> Result<(), String> {
        let step = world.resource::<MedialStep>();
        let pool = ComputeTaskPool::get_or_init(Default::default);
        let brute_force = StepInput { culling: Culling::None, ..step.input.clone() };
        let [workspace, another] = &mut self.workspaces;
        let run = |workspace: &mut Workspace, input| {
            let mut output = StepOutput::default();
            workspace.step(input, &step.statics, |_, _| PairFilter::Stopping, pool, &mut output);
            Ok(output)
        };
        let mut hybrid = || run(workspace, &step.input);
        let mut other = || match &mut self.baseline {
            Some(baseline) => baseline.step(&step.input, &step.statics, pool),
            None => run(another, &brute_force),
        };
        let outputs: [Result<StepOutput, String>; 2] = if self.steps.len().is_multiple_of(2) {
            [hybrid(), other()]
        } else {
            let last = other();
            [hybrid(), last]
        };
        let [hybrid, other] = outputs;
        let outputs = [hybrid?, other?];
        for (name, output) in ["hybrid", &self.name].into_iter().zip(&outputs) {
            let same = output.pairs == step.output.pairs
                && output.manifolds == step.output.manifolds
                && output.stops == step.output.stops;
            if !same {
                return Err(format!("step {}: culling `{name}` has changed the result", self.steps.len()));
            }
        }
        let contact_pairs = step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()).count();
        self.steps.push(Step { contact_pairs, figures: outputs.each_ref().map(Figures::of) });
        Ok(())
    }

    /// The name of the other culling.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The figures of the last step, of hybrid culling and of the other.
    pub fn last(&self) -> Option<[Figures; 2]> {
        self.steps.last().map(|step| step.figures)
    }

    /// The medians so far. `world` is the world of the run.
    pub fn report(&self, world: &World) -> Report {
        let rows = &world.resource::<Monitor>().rows;
        let activity = |(step, row): (&Step, &Row)| Activity {
            contact_pairs: step.contact_pairs,
            energy: row.kinetic_energy_per_kg,
        };
        let active = active(&self.steps.iter().zip(rows).map(activity).collect::<Vec<_>>());
        let medians = |chosen: &[bool]| {
            let steps = self.steps.iter().zip(chosen).filter(|(_, chosen)| **chosen);
            [0, 1].map(|side: usize| Figures::medians(steps.clone().map(|(step, _)| &step.figures[side])))
        };
        Report {
            other: self.name.clone(),
            steps: [active.len(), active.iter().filter(|active| **active).count()],
            figures: [medians(&vec![true; active.len()]), medians(&active)],
        }
    }
}
