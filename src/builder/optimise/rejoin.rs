//! Chooses edges and faces again: removes those of little use, and adds others within the limits where they reduce the cost most.

use glam::DVec3;

use super::{
    connect::{self, Limits},
    state::State,
    target::Target,
};
use crate::{
    builder::{
        envelope::{Complex, edges_of},
        hull::Hull,
        parallel,
        points::Points,
        surface_samples::Samples,
    },
    disjoint_sets::DisjointSets,
    geometry::Primitive,
};

/// Removes edges and faces of little use, except edges that connect the shape.
pub(super) fn prune(complex: &mut Complex, state: &State, samples: &Samples, target: &Target) {
    let buckets = state.samples_of_primitives();
    let mut harms = vec![0.0; buckets.len()];
    for anchor in &state.anchors {
        harms[anchor.place.primitive as usize] += anchor.weight * target.penalty.of(anchor.error(&state.envelope));
    }
    let all: f64 = state.hits.iter().zip(&samples.weights).map(|(h, w)| w * target.cost_of(h.distance)).sum();
    let threshold = 0.05 * all / complex.balls.len() as f64;
    let hulls = &state.envelope.hulls;
    let loss = |p: usize| {
        let primitive = state.envelope.primitives[p];
        let edges = if let Primitive::Slab(f) = primitive { edges_of(f).to_vec() } else { vec![] };
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
    let mut losses = parallel::map(joining.len(), 4, |i| loss(joining[i]));
    losses.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (loss, primitive) in losses {
        if loss > threshold {
            break;
        }
        match primitive {
            // A face fills creases as well, so it is removed only if that reduces the cost.
            Primitive::Slab(f) if loss < 0.0 => complex.faces.retain(|g| *g != f),
            Primitive::Slab(_) => {}
            Primitive::Cone(e) => {
                let mut sets = DisjointSets::new(complex.balls.len());
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

/// Adds edges and faces within the limits.
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
        .map(|(i, h)| if samples.normals[i] == DVec3::ZERO { u32::MAX } else { state.sphere(h.primitive, &h.weights) })
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
    let mut places: Vec<DVec3> = vec![];
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
