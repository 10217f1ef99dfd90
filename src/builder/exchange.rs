//! Local trials: the change of the cost by one sphere more or less, after the spheres around it are fitted again.

use std::collections::BTreeSet;

use super::{
    connect, descent,
    envelope::{Complex, edges_of},
    hull::{Ball, Hull},
    merge::{mergers, renamed},
    parallel,
    points::Points,
    refine::{Plan, State},
    surface_samples::{self, Samples},
    target::{Rest, Target},
};
use crate::geometry::Primitive;

/// A change of a complex. A new sphere gets the index after the last one.
#[derive(Clone, Debug, Default)]
struct Edit {
    removed: Option<u32>,
    inserted: Option<(Ball, u32)>,
    cut_edges: Vec<[u32; 2]>,
    new_edges: Vec<[u32; 2]>,
    cut_faces: Vec<[u32; 3]>,
    new_faces: Vec<[u32; 3]>,
}

/// Result of a tried edit.
struct Outcome {
    /// Change of the cost, negative if it decreased.
    change: f64,
    /// New states of moved spheres.
    moved: Vec<(u32, Ball)>,
    /// All spheres that the outcome depends on.
    touched: Vec<u32>,
    /// Placeholder index of a new sphere.
    placeholder: u32,
    edit: Edit,
}

impl Edit {
    /// Replaces `from` by its neighbour `to`.
    fn merger(complex: &Complex, from: u32, to: u32) -> Self {
        let mut edit = Self { removed: Some(from), ..Self::default() };
        edit.cut_edges = complex.edges.iter().copied().filter(|e| e.contains(&from)).collect();
        edit.cut_faces = complex.faces.iter().copied().filter(|f| f.contains(&from)).collect();
        for e in &edit.cut_edges {
            if let Some(Primitive::Cone(e)) = renamed(&Primitive::Cone(*e), from, to)
                && complex.edges.binary_search(&e).is_err()
            {
                edit.new_edges.push(e);
            }
        }
        for f in &edit.cut_faces {
            if let Some(Primitive::Slab(f)) = renamed(&Primitive::Slab(*f), from, to)
                && complex.faces.binary_search(&f).is_err()
            {
                edit.new_faces.push(f);
            }
        }
        edit
    }

    fn apply(&self, complex: &mut Complex) {
        complex.balls.extend(self.inserted.map(|i| i.0));
        complex.edges.retain(|e| !self.cut_edges.contains(e));
        complex.faces.retain(|f| !self.cut_faces.contains(f));
        complex.edges.extend(&self.new_edges);
        complex.faces.extend(&self.new_faces);
        complex.edges.sort_unstable();
        complex.faces.sort_unstable();
    }

    /// The spheres around the change, which may move.
    fn free(&self, count: usize) -> BTreeSet<u32> {
        let mut free: BTreeSet<u32> = self.cut_edges.iter().chain(&self.new_edges).flatten().copied().collect();
        free.extend(self.cut_faces.iter().chain(&self.new_faces).flatten());
        free.extend(self.inserted.map(|_| count as u32));
        if let Some(removed) = self.removed {
            free.remove(&removed);
        }
        free
    }
}

const STEPS: usize = 4;

/// Ratio of the distance between points of the envelope in a trial to the usual distance.
const COARSER: f64 = 1.3;

/// Tries an edit: applies it to a copy and runs a descent of the spheres around it.
fn try_out(complex: &Complex, state: &State, target: &Target, edit: Edit) -> Outcome {
    let free = edit.free(complex.balls.len());
    let mut edited = complex.clone();
    edit.apply(&mut edited);
    let moving: Vec<Primitive> =
        edited.primitives().into_iter().filter(|p| p.indices().iter().any(|i| free.contains(i))).collect();
    let is_old = |p: &Primitive| p.indices().iter().any(|i| free.contains(i) || edit.removed == Some(*i));
    let old: Vec<bool> = state.envelope.primitives.iter().map(is_old).collect();
    let rest: Vec<u32> = (0..old.len() as u32).filter(|&p| !old[p as usize]).collect();

    // The moving part as a complex of its own.
    let ids: Vec<u32> =
        moving.iter().flat_map(|p| p.indices()).copied().collect::<BTreeSet<u32>>().into_iter().collect();
    let local = |i: &u32| ids.binary_search(i).unwrap_or(0) as u32;
    let mut part = Complex { balls: ids.iter().map(|&i| edited.balls[i as usize]).collect(), ..Complex::default() };
    for p in &moving {
        match p {
            Primitive::Sphere(_) => {}
            Primitive::Cone(e) => part.edges.push(e.each_ref().map(local)),
            Primitive::Slab(f) => {
                part.faces.push(f.each_ref().map(local));
                part.edges.extend(edges_of(f.each_ref().map(local)));
            }
        }
    }
    part.edges.sort_unstable();
    part.edges.dedup();

    // The samples that the edit may affect.
    const MARGIN: f64 = 0.01;
    let mut least = vec![f32::INFINITY; target.points.blocks.len()];
    for hull in moving.iter().map(|p| Hull::new(&edited.balls, p)) {
        least.iter_mut().zip(target.points.gaps(&hull)).for_each(|(least, gap)| *least = least.min(gap));
    }
    let mut chosen: Vec<usize> = vec![];
    for (block, gap) in least.into_iter().enumerate() {
        let range = target.points.range(block);
        let hits = &state.hits[range.clone()];
        let reach = hits.iter().map(|h| h.distance).fold(0.0, f64::max) + MARGIN;
        if hits.iter().any(|h| old[h.primitive as usize]) || f64::from(gap) < reach {
            chosen.extend(range);
        }
    }
    let points = Points::new(chosen.iter().map(|&i| target.points.positions[i]).collect());
    let weights: Vec<f64> = chosen.iter().map(|&i| target.weights[i]).collect();
    let distances = state.envelope.distances_among(&points, &rest);
    let penalty = target.penalty;
    let before: f64 = chosen.iter().map(|&i| target.weights[i] * target.cost_of(state.hits[i].distance)).sum::<f64>()
        + state
            .anchors
            .iter()
            .filter(|a| old[a.primitive as usize])
            .map(|a| a.weight * target.penalty.of(a.error(&state.envelope)))
            .sum::<f64>();
    let local_target = Target {
        solid: target.solid,
        points: &points,
        weights: &weights,
        area: target.area,
        penalty,
        spacing: target.spacing * COARSER,
        uncovered: target.uncovered,
        creases: 0.0,
        worst: target.worst,
        rest: Some(Rest {
            envelope: &state.envelope,
            primitives: rest,
            distances,
            frozen: ids.iter().map(|i| !free.contains(i)).collect(),
        }),
    };
    let after = descent::descend(&mut part, &local_target, STEPS, descent::ROUGH);
    let moved = ids.iter().zip(&part.balls).filter(|(i, _)| free.contains(i)).map(|(&i, &b)| (i, b)).collect();
    let mut touched = ids;
    touched.extend(edit.removed);
    Outcome { change: after - before, moved, touched, placeholder: complex.balls.len() as u32, edit }
}

impl Outcome {
    /// True if one outcome moves or removes a sphere that the other depends on.
    fn clashes(&self, other: &Outcome) -> bool {
        let moves = |a: &Outcome, i: &u32| a.edit.removed == Some(*i) || a.moved.iter().any(|(moved, _)| moved == i);
        let new = |i: &&u32| **i != self.placeholder;
        self.touched.iter().filter(new).any(|i| moves(other, i))
            || other.touched.iter().filter(new).any(|i| moves(self, i))
    }
}

/// Edits that insert a sphere at the worst sample of a region, for the `count` regions with the largest costs. A region may have several edits.
fn insertions(
    complex: &Complex,
    parts: &[u32],
    state: &State,
    target: &Target,
    samples: &Samples,
    count: usize,
) -> Vec<Edit> {
    // For the region of each sphere: the sum of the costs, the largest distance and its sample.
    let mut regions = vec![(0.0, 0.0, u32::MAX); complex.balls.len()];
    for (i, hit) in state.hits.iter().enumerate().filter(|(i, _)| samples.normals[*i] != glam::DVec3::ZERO) {
        let region = &mut regions[state.sphere(hit.primitive, &hit.weights) as usize];
        region.0 += samples.weights[i] * target.cost_of(hit.distance);
        if hit.distance.abs() > region.1 {
            (region.1, region.2) = (hit.distance.abs(), i as u32);
        }
    }
    for anchor in &state.anchors {
        let region = &mut regions[state.sphere(anchor.primitive, &anchor.weights) as usize];
        region.0 += anchor.weight * target.penalty.of(anchor.error(&state.envelope));
    }
    let mut worst: Vec<(f64, u32)> = regions.iter().filter(|r| r.2 != u32::MAX).map(|r| (r.0, r.2)).collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    worst.truncate(count);
    let distances: Vec<f64> = state.hits.iter().map(|h| h.distance).collect();
    let edits = parallel::map(worst.len(), 1, |at| {
        let sample = worst[at].1 as usize;
        let part = samples.parts[sample];
        let (point, normal) = (samples.points.positions[sample], samples.normals[sample]);
        let ball = surface_samples::medial_ball(target.solid, part, point, normal);
        let new = complex.balls.len() as u32;
        let hit = &state.hits[sample];
        let home = state.envelope.primitives[hit.primitive as usize];
        let mut around: BTreeSet<u32> = home.indices().iter().copied().collect();
        around.extend(complex.edges.iter().filter(|e| e.iter().any(|i| home.indices().contains(i))).flatten());
        around.retain(|&i| parts[i as usize] == part);
        let mut balls = complex.clone();
        balls.balls.push(ball);
        let score = |i: u32| {
            let cone = Primitive::Cone([i, new]);
            connect::relief(&balls, &cone, samples, &distances, target) - connect::harm(&balls, &cone, target)
        };
        let leaf = around.iter().map(|&i| (score(i), i)).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let inserted = Some((ball, part));
        let mut edits: Vec<Edit> =
            leaf.map(|(_, i)| Edit { inserted, new_edges: vec![[i, new]], ..Edit::default() }).into_iter().collect();
        if let Primitive::Cone(ends) = home
            && hit.weights[1] > 0.05
            && hit.weights[1] < 0.95
            && ends.iter().all(|&i| parts[i as usize] == part)
        {
            let split = ends.map(|i| [i, new]).to_vec();
            edits.push(Edit { inserted, cut_edges: vec![ends], new_edges: split.clone(), ..Edit::default() });
            // The same with a sphere on the cone, which does not change the shape at the start.
            let t = hit.weights[1];
            let (a, b) = (complex.balls[ends[0] as usize], complex.balls[ends[1] as usize]);
            let middle = Ball { center: a.center.lerp(b.center, t), radius: a.radius + t * (b.radius - a.radius) };
            edits.push(Edit {
                inserted: Some((middle, part)),
                cut_edges: vec![ends],
                new_edges: split,
                ..Edit::default()
            });
        }
        edits
    });
    edits.into_iter().flatten().collect()
}

/// Moves spheres from places where they reduce the cost little to places where they reduce it more.
pub(super) fn exchange(
    complex: &mut Complex,
    parts: &mut Vec<u32>,
    target: &Target,
    samples: &Samples,
    plan: &Plan,
    count: usize,
) {
    let state = State::new(complex, target);
    let cheapest = mergers(complex, &state, samples, target);
    let mut seen = BTreeSet::new();
    let cheapest = cheapest.into_iter().filter(|(_, from, _)| seen.insert(*from)).take(count);
    let mut edits: Vec<Edit> = cheapest.map(|(_, from, to)| Edit::merger(complex, from, to)).collect();
    edits.extend(insertions(complex, parts, &state, target, samples, count));
    let mut outcomes = parallel::map(edits.len(), 1, |i| try_out(complex, &state, target, edits[i].clone()));
    outcomes.sort_by(|a, b| a.change.total_cmp(&b.change));
    let (insertions, mergers): (Vec<Outcome>, Vec<Outcome>) =
        outcomes.into_iter().partition(|o| o.edit.inserted.is_some());

    let mut taken: Vec<&Outcome> = vec![];
    let mut left = plan.spheres.saturating_sub(complex.balls.len());
    for insertion in insertions.iter().filter(|o| o.change < 0.0) {
        if taken.iter().any(|o| o.clashes(insertion)) {
            continue;
        }
        if left > 0 {
            left -= 1;
        } else {
            let fits = |m: &&Outcome| !m.clashes(insertion) && taken.iter().all(|o| !o.clashes(m));
            let Some(merger) = mergers.iter().find(fits) else { continue };
            if merger.change + insertion.change >= 0.0 {
                continue;
            }
            taken.push(merger);
        }
        taken.push(insertion);
    }
    commit(complex, parts, &taken);
}

/// Applies outcomes that do not clash, and renumbers the spheres.
fn commit(complex: &mut Complex, parts: &mut Vec<u32>, outcomes: &[&Outcome]) {
    let placeholder = complex.balls.len() as u32;
    let mut gone = BTreeSet::new();
    for outcome in outcomes {
        let new = complex.balls.len() as u32;
        let number = |i: u32| if i == placeholder { new } else { i };
        let edit = &outcome.edit;
        if let Some((ball, part)) = edit.inserted {
            complex.balls.push(ball);
            parts.push(part);
        }
        complex.edges.retain(|e| !edit.cut_edges.contains(e));
        complex.faces.retain(|f| !edit.cut_faces.contains(f));
        complex.edges.extend(edit.new_edges.iter().map(|e| e.map(number)));
        complex.faces.extend(edit.new_faces.iter().map(|f| f.map(number)));
        for &(i, ball) in &outcome.moved {
            complex.balls[number(i) as usize] = ball;
        }
        gone.extend(edit.removed);
    }
    complex.compact(&gone);
    let mut index = 0;
    parts.retain(|_| {
        index += 1;
        !gone.contains(&(index - 1))
    });
}
