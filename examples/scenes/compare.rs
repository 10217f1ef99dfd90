//! The hybrid culling beside others: each step's input is run again with both, in turns, on the same threads.

use bevy::{prelude::*, tasks::ComputeTaskPool};
use bevy_medial::{
    pipeline::{self, Culling, StepInput, StepOutput},
    plugin::MedialStep,
    scenes::Row,
};

use crate::{
    activity::{Activity, active, medians},
    baselines::{Baseline, Kind},
};

/// Which culling to compare with.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Cull {
    /// Nothing: the library's alone.
    Hybrid,
    /// Every primitive pair of every body pair.
    None,
    /// Trees of oriented boxes.
    BvhObb,
    /// Trees of spheres.
    BvhSphere,
    /// Trees of world boxes.
    BvhAabb,
}

/// A run beside another culling.
pub struct Comparison {
    name: String,
    baseline: Option<Box<dyn Baseline>>,
    steps: Vec<Step>,
}

/// The figures of one step: of hybrid culling, and of the other.
struct Step {
    contact_pairs: usize,
    figures: [Figures; 2],
}

#[derive(Clone, Copy)]
struct Figures {
    culling_ms: f64,
    rest_ms: f64,
    body_pairs: usize,
    candidates: usize,
}

impl Figures {
    fn of(output: &StepOutput) -> Self {
        let times = &output.times;
        let culling = times.broad + times.mid;
        Self {
            culling_ms: culling.as_secs_f64() * 1e3,
            rest_ms: (times.total() - culling).as_secs_f64() * 1e3,
            body_pairs: output.counts.body_pairs,
            candidates: output.counts.candidates,
        }
    }
}

impl Comparison {
    /// Nothing to compare with is none.
    pub fn with(cull: Cull) -> Option<Self> {
        let baseline = match cull {
            Cull::Hybrid => return None,
            Cull::None => None,
            Cull::BvhObb => Some(Kind::Obb.baseline()),
            Cull::BvhSphere => Some(Kind::Sphere.baseline()),
            Cull::BvhAabb => Some(Kind::Aabb.baseline()),
        };
        let name = clap::ValueEnum::to_possible_value(&cull).map_or_else(String::new, |value| value.get_name().into());
        Some(Self { name, baseline, steps: Vec::new() })
    }

    /// Runs the input of the last step again, both ways, the one and the other first in turns.
    ///
    /// # Errors
    /// If either finds anything else than the step has.
    pub fn run(&mut self, world: &World) -> Result<(), String> {
        let step = world.resource::<MedialStep>();
        let pool = ComputeTaskPool::get_or_init(Default::default);
        let brute_force = StepInput { culling: Culling::None, ..step.input.clone() };
        let hybrid = || Ok(pipeline::step(&step.input, &step.statics, pool));
        let mut other = || match &mut self.baseline {
            Some(baseline) => baseline.step(&step.input, &step.statics, pool),
            None => Ok(pipeline::step(&brute_force, &step.statics, pool)),
        };
        let outputs: [Result<StepOutput, String>; 2] = if self.steps.len() % 2 == 0 {
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

    /// Prints medians. `rows`: of the same steps.
    pub fn print(&self, rows: &[Row]) {
        let activities = self.steps.iter().zip(rows);
        let activities = activities
            .map(|(step, row)| Activity { contact_pairs: step.contact_pairs, energy: row.kinetic_energy_per_kg });
        let active = active(&activities.collect::<Vec<_>>());
        let count = active.iter().filter(|active| **active).count();
        let name = &self.name;
        println!(
            "\nthe same results in every step; medians over {} steps, and over {count} active ones:",
            active.len()
        );
        println!("{:14} {:>10} {name:>10} {:>7}   {:>10} {name:>10} {:>7}", "", "hybrid", "ratio", "hybrid", "ratio");
        let line = |label: &str, digits: usize, value: &dyn Fn(&Figures) -> f64| {
            let [hybrid, other] = [0, 1].map(|side: usize| {
                medians(&self.steps.iter().map(|step| value(&step.figures[side])).collect::<Vec<_>>(), &active)
            });
            print!("{label:14}");
            for (hybrid, other) in hybrid.into_iter().zip(other) {
                print!(" {hybrid:10.digits$} {other:10.digits$} {:7.2}  ", other / hybrid);
            }
            println!();
        };
        line("culling, ms", 4, &|f| f.culling_ms);
        line("the rest, ms", 4, &|f| f.rest_ms);
        line("collision, ms", 4, &|f| f.culling_ms + f.rest_ms);
        line("body pairs", 0, &|f| f.body_pairs as f64);
        line("candidates", 0, &|f| f.candidates as f64);
    }
}
