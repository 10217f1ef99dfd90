//! Reduces the number of spheres: a sphere is merged into a neighbour where the cost increases little.

use std::collections::BTreeSet;

use super::{state::State, target::Target};
use crate::{
    builder::{
        envelope::{Complex, Envelope},
        hull::Hull,
        parallel,
        points::Points,
        surface_samples::Samples,
    },
    geometry::Primitive,
    medial_axis::numbers_of_kept,
};

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

/// Costs of merging a sphere into a neighbour, in ascending order: cost, sphere, neighbour.
pub(super) fn mergers(complex: &Complex, state: &State, samples: &Samples, target: &Target) -> Vec<(f64, u32, u32)> {
    let count = complex.balls.len();
    let buckets = state.samples_of_primitives();
    let incident = incident(&state.envelope, count);
    let mut neighbors = vec![vec![]; count];
    complex.edges.iter().flat_map(|&[i, j]| [[i, j], [j, i]]).for_each(|[i, j]| neighbors[i as usize].push(j));
    let costs = parallel::map(count, 2, |from| {
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

/// Merges up to `count` spheres into neighbours where it costs least. Merged spheres are not adjacent to each other.
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
    let kept = |i: usize| heir[i] == i as u32;
    let numbers = numbers_of_kept((0..heir.len()).map(kept));
    let number = |i: u32| numbers[heir[i as usize] as usize];
    renumber(&mut complex.edges, number);
    renumber(&mut complex.faces, number);
    complex.balls = (0..heir.len()).filter(|&i| kept(i)).map(|i| complex.balls[i]).collect();
    *parts = (0..heir.len()).filter(|&i| kept(i)).map(|i| parts[i]).collect();
}

/// Renumbers the spheres of edges or faces. Removes edges or faces with a repeated sphere, and duplicates.
fn renumber<const N: usize>(simplices: &mut Vec<[u32; N]>, number: impl Fn(u32) -> u32) {
    for simplex in simplices.iter_mut() {
        *simplex = simplex.map(&number);
        simplex.sort_unstable();
    }
    simplices.retain(|simplex| simplex.windows(2).all(|pair| pair[0] != pair[1]));
    simplices.sort_unstable();
    simplices.dedup();
}
