//! Spheres go where they are needed: out where little is lost, in where the error is largest.

use std::collections::BTreeSet;

use super::{
    connect::{self, Limits},
    descent::{self, Anchor, Descent, Penalty},
    envelope::{Complex, Envelope, Hit, Hull},
    samples::{self, Random, Samples},
    solid::{Sets, Solid},
};
use crate::geometry::Primitive;

/// A shape with what is known of its error.
pub(super) struct State {
    pub envelope: Envelope,
    pub hits: Vec<Hit>,
    pub anchors: Vec<Anchor>,
}

impl State {
    /// The penalty that suits the errors of the samples.
    pub fn penalty(&self, samples: &Samples) -> Penalty {
        let squares = self.hits.iter().zip(&samples.weights).map(|(h, w)| w * h.distance * h.distance);
        Penalty::new(squares.sum())
    }
}

impl State {
    pub fn new(complex: &Complex, solid: &Solid, samples: &Samples, spacing: f64) -> Self {
        let envelope = complex.envelope();
        let hits = envelope.hits(&samples.points);
        let anchors = descent::anchors(solid, &envelope, spacing);
        Self { envelope, hits, anchors }
    }

    /// Samples of each primitive.
    fn samples_of_primitives(&self) -> Vec<Vec<u32>> {
        let mut samples = vec![vec![]; self.envelope.primitives.len()];
        for (i, hit) in self.hits.iter().enumerate() {
            samples[hit.primitive as usize].push(i as u32);
        }
        samples
    }

    /// The sphere that a point of a primitive is nearest to.
    fn sphere(&self, primitive: u32, weights: &[f64; 3]) -> u32 {
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
fn renamed(primitive: &Primitive, from: u32, to: u32) -> Option<Primitive> {
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
fn mergers(complex: &Complex, state: &State, samples: &Samples, penalty: Penalty, random: &mut Random) -> Vec<(f64, u32, u32)> {
    let buckets = state.samples_of_primitives();
    let incident = incident(&state.envelope, complex.balls.len());
    let merger = |from: u32, to: u32| {
        let gone = &incident[from as usize];
        let mut near: BTreeSet<u32> = BTreeSet::new();
        for &p in gone {
            for &i in state.envelope.primitives[p as usize].indices() {
                near.extend(incident[i as usize].iter().filter(|q| !gone.contains(q)));
            }
        }
        let fresh: Vec<Hull> = gone
            .iter()
            .filter_map(|&p| renamed(&state.envelope.primitives[p as usize], from, to))
            .map(|p| Hull::new(&complex.balls, &p))
            .collect();
        let mut cost = 0.0;
        for &i in gone.iter().flat_map(|&p| &buckets[p as usize]) {
            let point = samples.points.positions[i as usize];
            let old = near.iter().map(|&p| state.envelope.hulls[p as usize].distance(point));
            let distance = old.chain(fresh.iter().map(|h| h.distance(point))).fold(f64::INFINITY, f64::min);
            cost += samples.weights[i as usize] * (penalty.of(distance) - penalty.of(state.hits[i as usize].distance));
        }
        cost
    };
    let directed: Vec<[u32; 2]> = complex.edges.iter().flat_map(|&[i, j]| [[i, j], [j, i]]).collect();
    let costs = super::parallel::map(directed.len(), 4, |e| merger(directed[e][0], directed[e][1]));
    let mut mergers: Vec<(f64, u32, u32)> = costs.into_iter().zip(directed).map(|(c, [i, j])| (c * random.about_one(), i, j)).collect();
    mergers.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    mergers
}

/// Merges up to `count` spheres into neighbours, apart from one another, where it costs least.
pub(super) fn merge(complex: &mut Complex, parts: &mut Vec<u32>, state: &State, samples: &Samples, count: usize, penalty: Penalty, random: &mut Random) {
    let mut busy = vec![false; complex.balls.len()];
    let mut target: Vec<u32> = (0..complex.balls.len() as u32).collect();
    let mut left = count;
    for (_, from, to) in mergers(complex, state, samples, penalty, random) {
        if left == 0 {
            break;
        }
        if busy[from as usize] || busy[to as usize] {
            continue;
        }
        for e in complex.edges.iter().filter(|e| e.contains(&from)) {
            e.iter().for_each(|&i| busy[i as usize] = true);
        }
        target[from as usize] = to;
        left -= 1;
    }
    let mut next = 0;
    let numbers: Vec<u32> = (0..target.len())
        .map(|i| {
            next += u32::from(target[i] == i as u32);
            next - 1
        })
        .collect();
    let kept = |i: usize| target[i] == i as u32;
    let number = |i: u32| numbers[target[i as usize] as usize];
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
    complex.balls = (0..target.len()).filter(|&i| kept(i)).map(|i| complex.balls[i]).collect();
    *parts = (0..target.len()).filter(|&i| kept(i)).map(|i| parts[i]).collect();
}

/// Adds up to `count` spheres where the error is largest.
pub(super) fn insert(
    complex: &mut Complex,
    parts: &mut Vec<u32>,
    state: &State,
    solid: &Solid,
    samples: &Samples,
    count: usize,
    penalty: Penalty,
    random: &mut Random,
) {
    // Of the region of each sphere: the sum of the penalties, and the worst sample.
    let mut regions = vec![(0.0, 0.0, u32::MAX); complex.balls.len()];
    for (i, hit) in state.hits.iter().enumerate().filter(|(i, _)| samples.normals[*i] != glam::DVec3::ZERO) {
        let region = &mut regions[state.sphere(hit.primitive, &hit.weights) as usize];
        region.0 += samples.weights[i] * penalty.of(hit.distance);
        if hit.distance.abs() > region.1 {
            (region.1, region.2) = (hit.distance.abs(), i as u32);
        }
    }
    for anchor in &state.anchors {
        let region = &mut regions[state.sphere(anchor.primitive, &anchor.weights) as usize];
        region.0 += anchor.weight * penalty.of(anchor.error(&state.envelope));
    }
    let mut worst: Vec<(f64, u32)> = regions.iter().filter(|r| r.2 != u32::MAX).map(|r| (r.0 * random.about_one(), r.2)).collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    worst.truncate(count);
    let distances: Vec<f64> = state.hits.iter().map(|h| h.distance).collect();
    for (_, sample) in worst {
        let sample = sample as usize;
        let ball = samples::medial_ball(solid, samples.points.positions[sample], samples.normals[sample]);
        let new = complex.balls.len() as u32;
        let part = samples.parts[sample];
        // To which sphere? Those of the nearest primitive and around.
        let home = state.envelope.primitives[state.hits[sample].primitive as usize];
        let mut around: BTreeSet<u32> = home.indices().iter().copied().collect();
        around.extend(complex.edges.iter().filter(|e| e.iter().any(|i| home.indices().contains(i))).flatten());
        around.retain(|&i| parts[i as usize] == part);
        complex.balls.push(ball);
        let score = |primitive: Primitive| {
            connect::relief(complex, &primitive, samples, &distances, penalty)
                - connect::harm(complex, &primitive, solid, samples, penalty)
        };
        let best = around
            .iter()
            .map(|&i| (score(Primitive::Cone([i, new])), [i, new]))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, edge)) = best else {
            complex.balls.pop();
            continue;
        };
        parts.push(part);
        // Between the ends of a cone, the new sphere takes the cone's place.
        let hit = &state.hits[sample];
        if let Primitive::Cone(ends) = home
            && ends.contains(&edge[0])
            && hit.weights[1] > 0.05
            && hit.weights[1] < 0.95
            && complex.edges.contains(&ends)
        {
            complex.edges.retain(|e| *e != ends);
            complex.edges.extend(ends.map(|i| [i, new]));
        } else {
            complex.edges.push(edge);
        }
        complex.edges.sort_unstable();
    }
}

/// Drops edges and faces that keep nothing together and do little good.
pub(super) fn prune(complex: &mut Complex, state: &State, samples: &Samples, penalty: Penalty) {
    let buckets = state.samples_of_primitives();
    let mut harms = vec![0.0; buckets.len()];
    for anchor in &state.anchors {
        harms[anchor.primitive as usize] += anchor.weight * penalty.of(anchor.error(&state.envelope));
    }
    let all: f64 = state.hits.iter().zip(&samples.weights).map(|(h, w)| w * penalty.of(h.distance)).sum();
    let threshold = 0.2 * all / complex.balls.len() as f64;
    let mut losses: Vec<(f64, Primitive)> = vec![];
    for (p, primitive) in state.envelope.primitives.iter().enumerate() {
        if let Primitive::Sphere(_) = primitive {
            continue;
        }
        let hulls = &state.envelope.hulls;
        let loss: f64 = buckets[p]
            .iter()
            .map(|&i| {
                let point = samples.points.positions[i as usize];
                let others = (0..hulls.len()).filter(|&q| q != p).map(|q| hulls[q].distance(point));
                let mut distance = others.fold(f64::INFINITY, f64::min);
                if let Primitive::Slab(f) = primitive {
                    for e in super::envelope::edges_of(*f) {
                        distance = distance.min(Hull::new(&complex.balls, &Primitive::Cone(e)).distance(point));
                    }
                }
                samples.weights[i as usize] * (penalty.of(distance) - penalty.of(state.hits[i as usize].distance))
            })
            .sum();
        losses.push((loss - harms[p], *primitive));
    }
    losses.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (loss, primitive) in losses {
        if loss > threshold {
            break;
        }
        match primitive {
            Primitive::Slab(f) => complex.faces.retain(|g| *g != f),
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
pub(super) fn respend(complex: &mut Complex, state: &State, solid: &Solid, samples: &Samples, limits: Limits, penalty: Penalty) {
    let labels: Vec<u32> = state
        .hits
        .iter()
        .enumerate()
        .map(|(i, h)| {
            if samples.normals[i] == glam::DVec3::ZERO { u32::MAX } else { state.sphere(h.primitive, &h.weights) }
        })
        .collect();
    let mut touching = connect::touching(samples, &labels);
    touching.extend(&complex.edges);
    let candidates = connect::candidates(&touching);
    connect::spend(complex, candidates, solid, samples, limits, penalty);
}

pub(super) struct Plan {
    pub spheres: usize,
    pub extra_edges: usize,
    pub faces: usize,
    pub rounds: usize,
    pub seed: u64,
    pub descent: Descent,
}

/// The whole: first fewer spheres, then better ones.
pub(super) fn refine(complex: &mut Complex, parts: &mut Vec<u32>, solid: &Solid, samples: &Samples, plan: &Plan) {
    let spacing = plan.descent.spacing;
    let random = &mut Random(plan.seed);
    while complex.balls.len() > plan.spheres {
        let state = State::new(complex, solid, samples, spacing);
        let penalty = state.penalty(samples);
        let before = complex.balls.len();
        let count = (before - plan.spheres).min(before.div_ceil(8));
        merge(complex, parts, &state, samples, count, penalty, &mut Random(0));
        if complex.balls.len() == before {
            break;
        }
        descent::descend(complex, solid, samples, penalty, plan.descent);
    }
    let limits =
        |complex: &Complex| Limits { edges: complex.balls.len() + plan.extra_edges, faces: plan.faces };
    let state = State::new(complex, solid, samples, spacing);
    let penalty = state.penalty(samples);
    let mut cost = descent::descend(complex, solid, samples, penalty, plan.descent);
    let mut count = plan.spheres.div_ceil(8);
    for round in 0..plan.rounds {
        let (mut trial, mut trial_parts) = (complex.clone(), parts.clone());
        let state = State::new(&trial, solid, samples, spacing);
        prune(&mut trial, &state, samples, penalty);
        let state = State::new(&trial, solid, samples, spacing);
        merge(&mut trial, &mut trial_parts, &state, samples, count, penalty, random);
        let state = State::new(&trial, solid, samples, spacing);
        let more = plan.spheres.saturating_sub(trial.balls.len());
        insert(&mut trial, &mut trial_parts, &state, solid, samples, more, penalty, random);
        let state = State::new(&trial, solid, samples, spacing);
        let limit = limits(&trial);
        respend(&mut trial, &state, solid, samples, limit, penalty);
        let trial_cost = descent::descend(&mut trial, solid, samples, penalty, plan.descent);
        eprintln!(
            "round {round} count {count} cost {cost:.3e} -> {trial_cost:.3e} spheres {} edges {} faces {}",
            trial.balls.len(),
            trial.edges.len(),
            trial.faces.len()
        );
        if trial_cost < cost {
            (*complex, *parts, cost) = (trial, trial_parts, trial_cost);
        } else {
            count = (count / 2).max(1);
        }
    }
}
