//! Moves spheres where they are needed: removes them where the cost increases little, and inserts them where the error is largest.

use std::ops::ControlFlow;

use super::{
    connect::{self, Limits},
    descent,
    envelope::{Complex, Envelope, Hit},
    exchange::exchange,
    merge::merge,
    progress::Progress,
    rejoin::{prune, respend},
    solid::Solid,
    surface_samples::Samples,
    target::{Anchor, Penalty, Target},
};

/// A shape with the errors at its samples.
pub(super) struct State {
    pub envelope: Envelope,
    pub hits: Vec<Hit>,
    pub anchors: Vec<Anchor>,
}

impl State {
    pub fn new(complex: &Complex, target: &Target) -> Self {
        let envelope = complex.envelope();
        let hits = envelope.hits(target.points);
        let anchors = target.anchors(&envelope);
        Self { envelope, hits, anchors }
    }

    /// The samples that each primitive is nearest to.
    pub fn samples_of_primitives(&self) -> Vec<Vec<u32>> {
        let mut samples = vec![vec![]; self.envelope.primitives.len()];
        for (i, hit) in self.hits.iter().enumerate() {
            samples[hit.primitive as usize].push(i as u32);
        }
        samples
    }

    /// The sphere of a primitive with the largest weight at a point.
    pub fn sphere(&self, primitive: u32, weights: &[f64; 3]) -> u32 {
        let indices = self.envelope.primitives[primitive as usize].indices();
        let heaviest = (0..indices.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]).then(b.cmp(&a)));
        indices[heaviest.unwrap_or(0)]
    }
}

/// Limits and effort of a search.
#[derive(Clone, Copy)]
pub(super) struct Plan {
    /// Largest numbers of spheres, edges and faces.
    pub spheres: usize,
    pub edges: usize,
    pub faces: usize,
    /// Number of iterations with exchanges.
    pub rounds: usize,
    /// Number of iterations for the worst places.
    pub mends: usize,
    /// Number of steps of a descent within an iteration.
    pub steps: usize,
    /// True if the last descent is a short one, and the only one.
    pub hurried: bool,
    /// Distance between points of the envelope.
    pub spacing: f64,
}

impl Plan {
    pub const MOST_ROUNDS: usize = 18;

    /// Number of iterations within the time that a mesh of this size may take.
    pub fn rounds(triangles: usize, spheres: usize) -> usize {
        const TRIANGLES_PER_ROUND: usize = 5000;
        let least = if is_quick(triangles, spheres) { 9 } else { 3 };
        (2 + triangles / TRIANGLES_PER_ROUND).clamp(least, Self::MOST_ROUNDS)
    }

    pub fn limits(&self) -> Limits {
        Limits { edges: self.edges, faces: self.faces }
    }

    /// Largest number of spheres that an iteration may exchange.
    pub fn most_exchanged(&self) -> usize {
        self.spheres.div_ceil(6)
    }
}

/// True for few spheres and few triangles, as in low-poly models: even a more thorough search is fast.
pub(super) fn is_quick(triangles: usize, spheres: usize) -> bool {
    const TRIANGLES: usize = 2000;
    const SPHERES: usize = 60;
    triangles < TRIANGLES && spheres <= SPHERES
}

/// True for so few triangles per sphere that the time allowed for the mesh does not suffice for a full search.
pub(super) fn is_hurried(triangles: usize, spheres: usize) -> bool {
    const TRIANGLES_PER_SPHERE: usize = 100;
    triangles < TRIANGLES_PER_SPHERE * spheres && !is_quick(triangles, spheres)
}

/// Weight of a sample outside the envelope, relative to one inside, during the search for spheres. It also stands for the opposite direction, which
/// is longer in a crease.
const UNCOVERED: f64 = 1.5;

pub(super) fn target<'a>(solid: &'a Solid, samples: &'a Samples, penalty: Penalty, spacing: f64) -> Target<'a> {
    Target {
        solid,
        points: &samples.points,
        weights: &samples.weights,
        area: samples.area,
        penalty,
        spacing,
        uncovered: UNCOVERED,
        creases: 0.0,
        worst: &[],
        rest: None,
    }
}

/// The target with a penalty that suits the errors of a shape.
pub(super) fn target_for<'a>(complex: &Complex, solid: &'a Solid, samples: &'a Samples, spacing: f64) -> Target<'a> {
    let distances = complex.envelope().distances(&samples.points);
    let squares = distances.iter().zip(&samples.weights).map(|(d, w)| w * d * d);
    target(solid, samples, Penalty::new(squares.sum()), spacing)
}

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
