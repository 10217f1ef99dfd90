//! Chooses edges and faces between the spheres.

use std::{collections::BTreeSet, ops::Range};

use arrayvec::ArrayVec;
use glam::DVec3;

use super::target::Target;
use crate::{
    builder::{
        envelope::{Complex, edges_of},
        hull::{Cone, Hull},
        parallel,
        points::Points,
        solid::Solid,
        surface_samples::Samples,
    },
    disjoint_sets::DisjointSets,
    geometry::Primitive,
};

/// Samples up to this many spacings apart are neighbours.
const NEIGHBOR_SPACINGS: f64 = 2.0;

/// Neighbours whose normals have a smaller dot product lie on opposite sides of a gap.
const LEAST_AGREEMENT: f64 = -0.2;

/// Pairs of spheres with clusters that are neighbours on the surface.
pub(super) fn touching(samples: &Samples, labels: &[u32]) -> BTreeSet<[u32; 2]> {
    let size = NEIGHBOR_SPACINGS * samples.spacing;
    let positions = &samples.points.positions;
    let cell = |i: usize| (positions[i] / size).floor().as_i64vec3().to_array();
    let mut cells: Vec<([i64; 3], u32)> =
        (0..samples.len()).filter(|&i| labels[i] != u32::MAX).map(|i| (cell(i), i as u32)).collect();
    cells.sort_unstable();
    let mut pairs = BTreeSet::new();
    for &(at, i) in &cells {
        let i = i as usize;
        for dx in -1..=1 {
            for dy in -1..=1 {
                let row = [at[0] + dx, at[1] + dy];
                let from = cells.partition_point(|c| c.0 < [row[0], row[1], at[2] - 1]);
                let row = cells[from..].iter().take_while(|c| c.0 <= [row[0], row[1], at[2] + 1]);
                for j in row.map(|c| c.1 as usize).filter(|&j| labels[i] < labels[j]) {
                    let near = positions[i].distance_squared(positions[j]) < size * size;
                    let agree = samples.normals[i].dot(samples.normals[j]) > LEAST_AGREEMENT;
                    if near && agree && samples.parts[i] == samples.parts[j] {
                        pairs.insert([labels[i], labels[j]]);
                    }
                }
            }
        }
    }
    pairs
}

/// Largest numbers of edges and faces.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub edges: usize,
    pub faces: usize,
}

/// Largest distance that the cone of two spheres protrudes from the solid.
fn protrusion(solid: &Solid, complex: &Complex, [i, j]: [u32; 2]) -> f64 {
    const STEPS: usize = 6;
    let hull = Hull::Cone(Cone::new(complex.balls[i as usize], complex.balls[j as usize]));
    let at = |step: usize| {
        let t = step as f64 / STEPS as f64;
        let ball = hull.blend(&[1.0 - t, t, 0.0]);
        let Some(nearest) = solid.tree.closest(ball.center, 1.0) else { return 1.0 };
        let distance = nearest.distance(ball.center);
        ball.radius + if solid.is_inside(ball.center) { -distance } else { distance }
    };
    (1..STEPS).map(at).fold(0.0, f64::max)
}

/// Joins the spheres of each part to a tree, then adds candidates within the limits.
pub(super) fn connect(
    complex: &mut Complex,
    parts: &[u32],
    touching: &BTreeSet<[u32; 2]>,
    candidates: Vec<Primitive>,
    samples: &Samples,
    limits: Limits,
    target: &Target,
) {
    complex.faces.clear();
    let pairs: Vec<[u32; 2]> = touching.iter().copied().collect();
    let protrusions = parallel::map(pairs.len(), 8, |i| protrusion(target.solid, complex, pairs[i]));
    let length = |[i, j]: [u32; 2]| complex.balls[i as usize].center.distance(complex.balls[j as usize].center);
    let mut ranked: Vec<(f64, [u32; 2])> =
        pairs.iter().zip(&protrusions).map(|(&pair, out)| (out + 0.02 * length(pair), pair)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut sets = DisjointSets::new(complex.balls.len());
    complex.edges = ranked.iter().filter(|(_, [i, j])| sets.join(*i, *j)).map(|r| r.1).collect();
    // Spheres that no touching pair joins are joined where their part has the shortest gap.
    let mut rest = vec![];
    for i in 0..complex.balls.len() as u32 {
        for j in i + 1..complex.balls.len() as u32 {
            if parts[i as usize] == parts[j as usize] && sets.find(i) != sets.find(j) {
                rest.push((length([i, j]), [i, j]));
            }
        }
    }
    rest.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    complex.edges.extend(rest.iter().filter(|(_, [i, j])| sets.join(*i, *j)).map(|r| r.1));
    complex.edges.sort_unstable();
    spend(complex, candidates, samples, limits, target);
}

/// The edges and faces whose spheres have pairwise touching clusters.
pub(super) fn candidates(touching: &BTreeSet<[u32; 2]>) -> Vec<Primitive> {
    let mut candidates: Vec<Primitive> = touching.iter().map(|&p| Primitive::Cone(p)).collect();
    for &[i, j] in touching {
        let third = touching.range([j, 0]..[j + 1, 0]).filter(|[_, k]| touching.contains(&[i, *k]));
        candidates.extend(third.map(|&[_, k]| Primitive::Slab([i, j, k])));
    }
    candidates
}

/// Adds the candidates that reduce the error most.
pub(super) fn spend(
    complex: &mut Complex,
    mut candidates: Vec<Primitive>,
    samples: &Samples,
    limits: Limits,
    target: &Target,
) {
    candidates.retain(|c| !has(complex, c));
    let envelope = complex.envelope();
    let mut distances = envelope.distances(&samples.points);
    let slabs = candidates.iter().any(|c| matches!(c, Primitive::Slab(_)));
    let creases = if slabs { target.creases(&envelope) } else { vec![] };
    let (places, mut costs): (Vec<DVec3>, Vec<f64>) = creases.into_iter().unzip();
    let creases = Points::new(places);
    let gain = |complex: &Complex, candidate: &Primitive, distances: &[f64], costs: &[f64]| {
        let filled: f64 = filled(&Hull::new(&complex.balls, candidate), &creases).map(|i| costs[i]).sum();
        relief(complex, candidate, samples, distances, target) + filled
    };
    let reliefs = parallel::map(candidates.len(), 2, |i| gain(complex, &candidates[i], &distances, &costs));
    let mut waiting: Vec<(f64, Primitive, Option<f64>)> =
        reliefs.into_iter().zip(candidates).map(|(relief, c)| (relief, c, None)).collect();
    waiting.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // The harm of the likely candidates is computed in parallel. The harm of the others counts as zero until it is computed.
    let [edges, faces] = [limits.edges, limits.faces];
    let room = edges.saturating_sub(complex.edges.len()).saturating_add(faces.saturating_sub(complex.faces.len()));
    waiting.retain(|(gain, c, _)| *gain > 0.0 && fits(complex, c, limits));
    let likely = LOOKED_AT.saturating_mul(room).min(waiting.len());
    let harms = parallel::map(likely, 2, |i| harm(complex, &waiting[i].1, target, waiting[i].0));
    waiting.iter_mut().zip(harms).for_each(|(waiting, harm)| waiting.2 = Some(harm));
    // Gains only decrease. So the leading candidate is the best one if its recomputed gain has not decreased.
    let best = |waiting: &[(f64, Primitive, Option<f64>)]| {
        let best = (0..waiting.len())
            .max_by(|&a, &b| waiting[a].0.total_cmp(&waiting[b].0).then(waiting[b].1.cmp(&waiting[a].1)));
        best.filter(|&best| waiting[best].0 > 0.0)
    };
    while let Some(best) = best(&waiting) {
        let (before, first, harm) = waiting[best];
        let harm = harm.unwrap_or_else(|| self::harm(complex, &first, target, before));
        let fresh =
            (gain(complex, &first, &distances, &costs) - harm) / missing_edges(complex, &first).len().max(1) as f64;
        waiting[best] = (fresh, first, Some(harm));
        if fresh < before {
            continue;
        }
        add(complex, &first);
        waiting.retain(|(_, c, _)| !has(complex, c) && fits(complex, c, limits));
        let hull = Hull::new(&complex.balls, &first);
        let nearer: Vec<(usize, f64)> = nearer(&hull, samples, &distances).collect();
        nearer.into_iter().for_each(|(i, distance)| distances[i] = distance);
        filled(&hull, &creases).for_each(|i| costs[i] = 0.0);
    }
}

/// Approximate number of candidates examined for each added one.
const LOOKED_AT: usize = 5;

fn missing_edges(complex: &Complex, candidate: &Primitive) -> ArrayVec<[u32; 2], 3> {
    let edges = match *candidate {
        Primitive::Sphere(_) => ArrayVec::new(),
        Primitive::Cone(e) => ArrayVec::from_iter([e]),
        Primitive::Slab(f) => ArrayVec::from(edges_of(f)),
    };
    edges.into_iter().filter(|e| complex.edges.binary_search(e).is_err()).collect()
}

fn has(complex: &Complex, candidate: &Primitive) -> bool {
    match candidate {
        Primitive::Slab(f) => complex.faces.binary_search(f).is_ok(),
        _ => missing_edges(complex, candidate).is_empty(),
    }
}

fn fits(complex: &Complex, candidate: &Primitive, limits: Limits) -> bool {
    let faces = complex.faces.len() + usize::from(matches!(candidate, Primitive::Slab(_)));
    complex.edges.len() + missing_edges(complex, candidate).len() <= limits.edges && faces <= limits.faces
}

fn add(complex: &mut Complex, candidate: &Primitive) {
    complex.edges.extend(missing_edges(complex, candidate));
    complex.edges.sort_unstable();
    if let Primitive::Slab(f) = candidate {
        complex.faces.push(*f);
        complex.faces.sort_unstable();
    }
}

/// Depth inside a primitive from which on a point is not at the bottom of a crease, as a part of the diagonal.
const DEEP: f64 = 5e-4;

/// Indices of the points deep inside a primitive.
fn filled(hull: &Hull, points: &Points) -> impl Iterator<Item = usize> {
    points
        .distances(hull, |_, least| f64::from(least) <= -DEEP)
        .filter(|(_, distance)| *distance <= -DEEP)
        .map(|(i, _)| i)
}

/// Reduction of the samples' cost by a candidate.
pub(super) fn relief(
    complex: &Complex,
    candidate: &Primitive,
    samples: &Samples,
    distances: &[f64],
    target: &Target,
) -> f64 {
    let hull = Hull::new(&complex.balls, candidate);
    let relief = nearer(&hull, samples, distances)
        .map(|(i, distance)| samples.weights[i] * (target.cost_of(distances[i]) - target.cost_of(distance)));
    relief.sum()
}

/// The samples that are nearer to a primitive than given distances, with their new distances.
fn nearer(hull: &Hull, samples: &Samples, distances: &[f64]) -> impl Iterator<Item = (usize, f64)> {
    // If the primitive is farther from a block than the block's largest distance, it is nearer to none of its points.
    let reach = |block: Range<usize>| distances[block].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let near = samples.points.distances(hull, move |block, least| f64::from(least) <= reach(block));
    near.filter(|&(i, distance)| distance < distances[i])
}

/// Cost of the part of a candidate's surface outside the solid. The sum stops once it exceeds `most`.
pub(super) fn harm(complex: &Complex, candidate: &Primitive, target: &Target, most: f64) -> f64 {
    const SPACING: f64 = 0.02;
    let hull = Hull::new(&complex.balls, candidate);
    let (mut harm, mut near) = (0.0, None);
    hull.sample(SPACING, |weights, normal, area| {
        if harm > most {
            return;
        }
        let point = hull.point(&weights, normal);
        let closest = target.solid.closest_off_rims(point, near);
        near = closest.map_or(near, |(_, triangle)| Some(triangle));
        let away = closest.map_or(DVec3::ZERO, |(nearest, _)| point - nearest);
        if target.solid.is_out(point, away, normal) {
            harm += area / target.area * target.penalty.of(away.length());
        }
    });
    harm
}
