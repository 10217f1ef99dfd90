//! Spheres go where they are needed: out where little is lost, in where the error is largest.

use std::{collections::BTreeSet, ops::ControlFlow};

use super::{
    connect::{self, Limits},
    descent::{self, Anchor, Penalty, Target},
    envelope::{Complex, Envelope, Hit},
    exchange::exchange,
    hull::Hull,
    points::Points,
    progress::Progress,
    solid::{Sets, Solid},
    surface_samples::Samples,
};
use crate::geometry::Primitive;

/// A shape with what is known of its error.
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

    /// Samples of each primitive.
    pub fn samples_of_primitives(&self) -> Vec<Vec<u32>> {
        let mut samples = vec![vec![]; self.envelope.primitives.len()];
        for (i, hit) in self.hits.iter().enumerate() {
            samples[hit.primitive as usize].push(i as u32);
        }
        samples
    }

    /// The sphere that a point of a primitive is nearest to.
    pub fn sphere(&self, primitive: u32, weights: &[f64; 3]) -> u32 {
        let indices = self.envelope.primitives[primitive as usize].indices();
        let heaviest = (0..indices.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]).then(b.cmp(&a)));
        indices[heaviest.unwrap_or(0)]
    }
}

fn incident(envelope: &Envelope, count: usize) -> Vec<Vec<u32>> {
    let mut of_sphere = vec![vec![]; count];
    for (p, primitive) in (0..).zip(&envelope.primitives) {
        primitive.indices().iter().for_each(|&i| of_sphere[i as usize].push(p));
    }
    of_sphere
}

/// The primitive with `from` replaced by `to`.
pub(super) fn renamed(primitive: &Primitive, from: u32, to: u32) -> Option<Primitive> {
    let mut indices: Vec<u32> = primitive.indices().iter().map(|&i| if i == from { to } else { i }).collect();
    indices.sort_unstable();
    indices.dedup();
    match *indices {
        [i] => Some(Primitive::Sphere([i])),
        [i, j] => Some(Primitive::Cone([i, j])),
        [i, j, k] => Some(Primitive::Slab([i, j, k])),
        _ => None,
    }
}

/// What it costs to merge a sphere into a neighbour, least first: cost, sphere, neighbour.
pub(super) fn mergers(complex: &Complex, state: &State, samples: &Samples, target: &Target) -> Vec<(f64, u32, u32)> {
    let count = complex.balls.len();
    let buckets = state.samples_of_primitives();
    let incident = incident(&state.envelope, count);
    let mut neighbors = vec![vec![]; count];
    complex.edges.iter().flat_map(|&[i, j]| [[i, j], [j, i]]).for_each(|[i, j]| neighbors[i as usize].push(j));
    let costs = super::parallel::map(count, 2, |from| {
        let gone = &incident[from];
        let mut near: BTreeSet<u32> = BTreeSet::new();
        for &p in gone {
            for &i in state.envelope.primitives[p as usize].indices() {
                near.extend(incident[i as usize].iter().filter(|q| !gone.contains(q)));
            }
        }
        let bereft: Vec<u32> = gone.iter().flat_map(|&p| &buckets[p as usize]).copied().collect();
        let points = Points::new(bereft.iter().map(|&i| samples.points.positions[i as usize]).collect());
        let near: Vec<u32> = near.into_iter().collect();
        let kept = state.envelope.distances_among(&points, &near);
        let cost = |to: u32| {
            let fresh: BTreeSet<Primitive> =
                gone.iter().filter_map(|&p| renamed(&state.envelope.primitives[p as usize], from as u32, to)).collect();
            let fresh: Vec<Hull> = fresh.iter().map(|p| Hull::new(&complex.balls, p)).collect();
            let cost = |(at, &i): (usize, &u32)| {
                let fresh = fresh.iter().map(|hull| hull.distance(points.positions[at]));
                let (old, new) = (state.hits[i as usize].distance, fresh.fold(kept[at], f64::min));
                samples.weights[i as usize] * (target.cost_of(new) - target.cost_of(old))
            };
            bereft.iter().enumerate().map(cost).sum::<f64>()
        };
        neighbors[from].iter().map(|&to| (cost(to), from as u32, to)).collect::<Vec<_>>()
    });
    let mut mergers: Vec<(f64, u32, u32)> = costs.into_iter().flatten().collect();
    mergers.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    mergers
}

/// Merges up to `count` spheres into neighbours, apart from one another, where it costs least.
pub(super) fn merge(
    complex: &mut Complex,
    parts: &mut Vec<u32>,
    state: &State,
    samples: &Samples,
    count: usize,
    target: &Target,
) {
    let mut busy = vec![false; complex.balls.len()];
    let mut heir: Vec<u32> = (0..complex.balls.len() as u32).collect();
    let mut left = count;
    for (_, from, to) in mergers(complex, state, samples, target) {
        if left == 0 {
            break;
        }
        if busy[from as usize] || busy[to as usize] {
            continue;
        }
        for e in complex.edges.iter().filter(|e| e.contains(&from)) {
            e.iter().for_each(|&i| busy[i as usize] = true);
        }
        heir[from as usize] = to;
        left -= 1;
    }
    let mut next = 0;
    let numbers: Vec<u32> = (0..heir.len())
        .map(|i| {
            next += u32::from(heir[i] == i as u32);
            next - 1
        })
        .collect();
    let kept = |i: usize| heir[i] == i as u32;
    let number = |i: u32| numbers[heir[i as usize] as usize];
    complex.edges = complex
        .edges
        .iter()
        .map(|e| {
            let mut e = e.map(number);
            e.sort_unstable();
            e
        })
        .filter(|[i, j]| i != j)
        .collect();
    complex.faces = complex
        .faces
        .iter()
        .map(|f| {
            let mut f = f.map(number);
            f.sort_unstable();
            f
        })
        .filter(|[i, j, k]| i != j && j != k)
        .collect();
    complex.edges.sort_unstable();
    complex.edges.dedup();
    complex.faces.sort_unstable();
    complex.faces.dedup();
    complex.balls = (0..heir.len()).filter(|&i| kept(i)).map(|i| complex.balls[i]).collect();
    *parts = (0..heir.len()).filter(|&i| kept(i)).map(|i| parts[i]).collect();
}

/// Drops edges and faces that keep nothing together and do little good.
pub(super) fn prune(complex: &mut Complex, state: &State, samples: &Samples, target: &Target) {
    let buckets = state.samples_of_primitives();
    let mut harms = vec![0.0; buckets.len()];
    for anchor in &state.anchors {
        harms[anchor.primitive as usize] += anchor.weight * target.penalty.of(anchor.error(&state.envelope));
    }
    let all: f64 = state.hits.iter().zip(&samples.weights).map(|(h, w)| w * target.cost_of(h.distance)).sum();
    let threshold = 0.05 * all / complex.balls.len() as f64;
    let hulls = &state.envelope.hulls;
    let loss = |p: usize| {
        let primitive = state.envelope.primitives[p];
        let edges = if let Primitive::Slab(f) = primitive { super::envelope::edges_of(f).to_vec() } else { vec![] };
        let edges: Vec<Hull> = edges.into_iter().map(|e| Hull::new(&complex.balls, &Primitive::Cone(e))).collect();
        let points = Points::new(buckets[p].iter().map(|&i| samples.points.positions[i as usize]).collect());
        let others: Vec<u32> = (0..hulls.len() as u32).filter(|&q| q != p as u32).collect();
        let others = state.envelope.distances_among(&points, &others);
        let more = |(at, &i): (usize, &u32)| {
            let edges = edges.iter().map(|edge| edge.distance(points.positions[at]));
            let (old, new) = (state.hits[i as usize].distance, edges.fold(others[at], f64::min));
            samples.weights[i as usize] * (target.cost_of(new) - target.cost_of(old))
        };
        let more: f64 = buckets[p].iter().enumerate().map(more).sum();
        (more - harms[p], primitive)
    };
    let joining: Vec<usize> = (0..hulls.len()).filter(|&p| !matches!(hulls[p], Hull::Sphere(_))).collect();
    let mut losses = super::parallel::map(joining.len(), 4, |i| loss(joining[i]));
    losses.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (loss, primitive) in losses {
        if loss > threshold {
            break;
        }
        match primitive {
            // A face fills creases besides.
            Primitive::Slab(f) if loss < 0.0 => complex.faces.retain(|g| *g != f),
            Primitive::Slab(_) => {}
            Primitive::Cone(e) => {
                let mut sets = Sets::new(complex.balls.len());
                complex.edges.iter().filter(|o| **o != e).for_each(|&[i, j]| {
                    sets.join(i, j);
                });
                if sets.find(e[0]) == sets.find(e[1]) {
                    complex.edges.retain(|o| *o != e);
                }
            }
            Primitive::Sphere(_) => {}
        }
    }
}

/// Spends what the limits leave on edges and faces.
pub(super) fn respend(
    complex: &mut Complex,
    parts: &[u32],
    state: &State,
    samples: &Samples,
    limits: Limits,
    target: &Target,
) {
    let labels: Vec<u32> = state
        .hits
        .iter()
        .enumerate()
        .map(
            |(i, h)| {
                if samples.normals[i] == glam::DVec3::ZERO { u32::MAX } else { state.sphere(h.primitive, &h.weights) }
            },
        )
        .collect();
    let mut touching = connect::touching(samples, &labels);
    touching.extend(&complex.edges);
    let mut candidates = connect::candidates(&touching);
    candidates.extend(fillings(complex, parts, state, target));
    candidates.sort_unstable();
    candidates.dedup();
    connect::spend(complex, candidates, samples, limits, target);
}

/// Cones and slabs that would fill the deepest creases and voids.
fn fillings(complex: &Complex, parts: &[u32], state: &State, target: &Target) -> Vec<Primitive> {
    const MOST: usize = 12;
    const NEAREST: usize = 6;
    let mut creases = target.creases(&state.envelope);
    creases.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut places: Vec<glam::DVec3> = vec![];
    let mut found = vec![];
    for (place, _) in creases {
        if places.len() == MOST {
            break;
        }
        if places.iter().any(|p| p.distance(place) < 2.0 * target.spacing) {
            continue;
        }
        places.push(place);
        let mut near: Vec<(f64, u32)> = (0..).zip(&complex.balls).map(|(i, b)| (b.distance(place), i)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(NEAREST);
        let mut near: Vec<u32> = near.into_iter().map(|n| n.1).collect();
        near.sort_unstable();
        for (at, &i) in near.iter().enumerate() {
            for (next, &j) in near.iter().enumerate().skip(at + 1) {
                let fill = near[next + 1..].iter().map(|&k| Primitive::Slab([i, j, k]));
                found.extend(std::iter::once(Primitive::Cone([i, j])).chain(fill).filter(|p| {
                    let one = p.indices().iter().all(|&k| parts[k as usize] == parts[i as usize]);
                    one && Hull::new(&complex.balls, p).distance(place) < 0.0
                }));
            }
        }
    }
    found
}

/// How far to go.
#[derive(Clone, Copy)]
pub(super) struct Plan {
    /// Largest numbers.
    pub spheres: usize,
    pub edges: usize,
    pub faces: usize,
    /// Rounds of exchanges.
    pub rounds: usize,
    /// Steps of a descent.
    pub steps: usize,
    /// Distance of points of the envelope.
    pub spacing: f64,
}

impl Plan {
    pub const MOST_ROUNDS: usize = 18;

    /// Rounds that the time allows which a mesh of this size may take.
    pub fn rounds(triangles: usize) -> usize {
        const TRIANGLES_PER_ROUND: usize = 5000;
        const LEAST_ROUNDS: usize = 3;
        (2 + triangles / TRIANGLES_PER_ROUND).clamp(LEAST_ROUNDS, Self::MOST_ROUNDS)
    }
}

/// How much a sample outside of the envelope counts beside one within while spheres are sought: it stands for the way back as well, which is
/// longer in a crease.
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
        rest: None,
    }
}

/// The target with the penalty that suits the errors of a shape.
pub(super) fn target_for<'a>(complex: &Complex, solid: &'a Solid, samples: &'a Samples, spacing: f64) -> Target<'a> {
    let hits = complex.envelope().hits(&samples.points);
    let squares = hits.iter().zip(&samples.weights).map(|(h, w)| w * h.distance * h.distance);
    target(solid, samples, Penalty::new(squares.sum()), spacing)
}

/// Of so many rounds the last is about edges and faces, the others about spheres.
const CYCLE: usize = 3;

/// Rounds of a cycle that leave more than this part of the cost end the search.
const ENOUGH: f64 = 0.97;

/// The whole: first fewer spheres, then better ones.
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
        descent::descend(complex, &target, plan.steps / 2, descent::ROUGH);
        progress(0.0)?;
    }
    let target = target_for(complex, solid, samples, plan.spacing);
    let mut cost = descent::descend(complex, &target, plan.steps, descent::ROUGH);
    let mut count = plan.spheres.div_ceil(6);
    let mut cycle_start = cost;
    for round in 0..plan.rounds {
        progress(round as f32 / plan.rounds as f32)?;
        let (mut trial, mut trial_parts) = (complex.clone(), parts.clone());
        let connects = round % CYCLE == CYCLE - 1;
        if connects {
            let state = State::new(&trial, &target);
            prune(&mut trial, &state, samples, &target);
            let state = State::new(&trial, &target);
            let limits = Limits { edges: plan.edges, faces: plan.faces };
            respend(&mut trial, &trial_parts, &state, samples, limits, &target);
        } else {
            exchange(&mut trial, &mut trial_parts, &target, samples, plan, count);
        }
        let trial_cost = descent::descend(&mut trial, &target, plan.steps / 2, descent::ROUGH);
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
