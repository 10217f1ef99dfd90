//! Moves spheres where they are needed: removes them where the cost increases little, and inserts them where the error is largest.

use std::ops::ControlFlow;

use super::{
    connect, descent,
    exchange::exchange,
    merge::merge,
    rejoin::{prune, respend},
    state::{Plan, State, target_for},
    target::Target,
};
use crate::builder::{envelope::Complex, progress::Progress, solid::Solid, surface_samples::Samples};

/// The change of one iteration.
pub(super) enum Change {
    /// Exchanges up to this many spheres.
    Spheres(usize),
    /// Chooses edges and faces again.
    Connectivity,
}

impl Change {
    /// Makes the change, even if the cost increases, and runs a descent. Returns the cost.
    pub fn make(
        self,
        complex: &mut Complex,
        parts: &mut Vec<u32>,
        samples: &Samples,
        plan: &Plan,
        target: &Target,
    ) -> f64 {
        match self {
            Self::Spheres(count) => exchange(complex, parts, target, samples, plan, count),
            Self::Connectivity => {
                prune(complex, &State::new(complex, target), samples, target);
                respend(complex, parts, &State::new(complex, target), samples, plan.limits(), target);
            }
        }
        descent::descend(complex, target, plan.steps, descent::ROUGH)
    }
}

/// Iterations of a cycle. The last one changes edges and faces, the others change spheres.
const CYCLE: usize = 3;

/// The search ends after a cycle that leaves more than this part of the cost.
const ENOUGH: f64 = 0.97;

/// The whole refinement: first reduces the number of spheres, then improves them.
pub(super) fn refine(
    complex: &mut Complex,
    parts: &mut Vec<u32>,
    solid: &Solid,
    samples: &Samples,
    plan: &Plan,
    progress: &Progress,
) -> ControlFlow<()> {
    while complex.balls.len() > plan.spheres {
        let target = target_for(complex, solid, samples, plan.spacing);
        let state = State::new(complex, &target);
        let before = complex.balls.len();
        let count = (before - plan.spheres).min(before.div_ceil(8));
        merge(complex, parts, &state, samples, count, &target);
        if complex.balls.len() == before {
            break;
        }
        descent::descend(complex, &target, plan.steps, descent::ROUGH);
        progress(0.0)?;
    }
    let target = target_for(complex, solid, samples, plan.spacing);
    let limits = plan.limits();
    if complex.edges.len() > limits.edges || complex.faces.len() > limits.faces {
        // The edges and faces are those of a finer shape, after merging: a part of them is chosen.
        let touching = complex.edges.iter().copied().collect();
        connect::connect(complex, parts, &touching, connect::candidates(&touching), samples, limits, &target);
    }
    let mut cost = descent::descend(complex, &target, 2 * plan.steps, descent::ROUGH);
    let mut count = plan.most_exchanged();
    let mut cycle_start = cost;
    for round in 0..plan.rounds {
        progress(round as f32 / plan.rounds as f32)?;
        let connects = round % CYCLE == CYCLE - 1;
        let change = if connects { Change::Connectivity } else { Change::Spheres(count) };
        let (mut trial, mut trial_parts) = (complex.clone(), parts.clone());
        let trial_cost = change.make(&mut trial, &mut trial_parts, samples, plan, &target);
        if trial_cost < cost {
            (*complex, *parts, cost) = (trial, trial_parts, trial_cost);
        } else if !connects {
            count = (count / 2).max(1);
        }
        if connects {
            if cost > ENOUGH * cycle_start {
                break;
            }
            cycle_start = cost;
        }
    }
    progress(1.0)
}
