//! Local trials: the change of the cost by one sphere more or less, after the spheres around it are fitted again.

use std::collections::BTreeSet;

use super::{
    connect, descent,
    merge::{mergers, renamed},
    state::{Plan, State},
    target::{Rest, Target},
};
use crate::{
    builder::{
        envelope::{Complex, edges_of},
        hull::{Ball, Hull},
        parallel,
        points::Points,
        surface_samples::{self, Samples},
    },
    geometry::Primitive,
};

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
    let is_moving = |p: &Primitive| p.indices().iter().any(|i| free.contains(i));
    let moving: Vec<Primitive> = edited.primitives().into_iter().filter(is_moving).collect();
    let is_old = |p: &Primitive| is_moving(p) || edit.removed.is_some_and(|removed| p.indices().contains(&removed));
    let old: Vec<bool> = state.envelope.primitives.iter().map(is_old).collect();

    let (mut part, ids) = isolated(&edited.balls, &moving);
    let samples = affected_samples(&edited.balls, &moving, &old, state, target);
    let points = Points::new(samples.iter().map(|&i| target.points.positions[i]).collect());
    let weights: Vec<f64> = samples.iter().map(|&i| target.weights[i]).collect();
    let primitives: Vec<u32> = (0..old.len() as u32).filter(|&p| !old[p as usize]).collect();
    let rest = Rest {
        envelope: &state.envelope,
        distances: state.envelope.distances_among(&points, &primitives),
        primitives,
        frozen: ids.iter().map(|i| !free.contains(i)).collect(),
    };
    let local_target = Target {
        points: &points,
        weights: &weights,
        spacing: target.spacing * COARSER,
        creases: 0.0,
        rest: Some(rest),
        ..*target
    };
    let before = cost(&samples, &old, state, target);
    let after = descent::descend(&mut part, &local_target, STEPS, descent::ROUGH);
    let moved = ids.iter().zip(&part.balls).filter(|(i, _)| free.contains(i)).map(|(&i, &b)| (i, b)).collect();
    let mut touched = ids;
    touched.extend(edit.removed);
    Outcome { change: after - before, moved, touched, placeholder: complex.balls.len() as u32, edit }
}

/// Returns the complex of some primitives alone, and the indices of its spheres in the list of all.
fn isolated(balls: &[Ball], primitives: &[Primitive]) -> (Complex, Vec<u32>) {
    let ids: BTreeSet<u32> = primitives.iter().flat_map(|p| p.indices()).copied().collect();
    let ids: Vec<u32> = ids.into_iter().collect();
    let local = |i: &u32| ids.binary_search(i).unwrap_or(0) as u32;
    let mut part = Complex { balls: ids.iter().map(|&i| balls[i as usize]).collect(), ..Complex::default() };
    for p in primitives {
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
    (part, ids)
}

/// Returns the samples that an edit may affect: blocks with a sample nearest to an old primitive, and blocks near a moving primitive.
fn affected_samples(balls: &[Ball], moving: &[Primitive], old: &[bool], state: &State, target: &Target) -> Vec<usize> {
    const MARGIN: f64 = 0.01;
    let mut least = vec![f32::INFINITY; target.points.blocks.len()];
    for hull in moving.iter().map(|p| Hull::new(balls, p)) {
        least.iter_mut().zip(target.points.gaps(&hull)).for_each(|(least, gap)| *least = least.min(gap));
    }
    let mut affected: Vec<usize> = vec![];
    for (block, gap) in least.into_iter().enumerate() {
        let range = target.points.range(block);
        let hits = &state.hits[range.clone()];
        let reach = hits.iter().map(|h| h.distance).fold(0.0, f64::max) + MARGIN;
        if hits.iter().any(|h| old[h.primitive as usize]) || f64::from(gap) < reach {
            affected.extend(range);
        }
    }
    affected
}

/// Returns the cost of some samples, and of the points of the envelope on old primitives.
fn cost(samples: &[usize], old: &[bool], state: &State, target: &Target) -> f64 {
    let of_samples = samples.iter().map(|&i| target.weights[i] * target.cost_of(state.hits[i].distance));
    let anchors = state.anchors.iter().filter(|a| old[a.place.primitive as usize]);
    let of_anchors = anchors.map(|a| a.weight * target.penalty.of(a.error(&state.envelope)));
    of_samples.sum::<f64>() + of_anchors.sum::<f64>()
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

/// Returns edits that insert a sphere at the worst sample of a region, for the `count` regions with the largest costs. A region may have several edits.
fn insertions(
    complex: &Complex,
    parts: &[u32],
    state: &State,
    target: &Target,
    samples: &Samples,
    count: usize,
) -> Vec<Edit> {
    let worst = worst_samples(complex, state, target, samples, count);
    let distances: Vec<f64> = state.hits.iter().map(|h| h.distance).collect();
    let edits = parallel::map(worst.len(), 1, |at| {
        let sample = worst[at] as usize;
        let part = samples.parts[sample];
        let (point, normal) = (samples.points.positions[sample], samples.normals[sample]);
        let inserted = (surface_samples::medial_ball(target.solid, part, point, normal), part);
        let hit = &state.hits[sample];
        let home = &state.envelope.primitives[hit.primitive as usize];
        let gain = |complex: &Complex, cone: &Primitive| {
            connect::relief(complex, cone, samples, &distances, target)
                - connect::harm(complex, cone, target, f64::INFINITY)
        };
        let leaf = leaf(complex, parts, home, inserted, gain);
        leaf.into_iter().chain(splits(complex, parts, home, hit.weights[1], inserted)).collect::<Vec<Edit>>()
    });
    edits.into_iter().flatten().collect()
}

/// Returns the sample with the largest distance of each region, for the `count` regions with the largest costs. Each sphere has a region.
fn worst_samples(complex: &Complex, state: &State, target: &Target, samples: &Samples, count: usize) -> Vec<u32> {
    // For each region: the sum of the costs, the largest distance and its sample.
    let mut regions = vec![(0.0, 0.0, u32::MAX); complex.balls.len()];
    for (i, hit) in state.hits.iter().enumerate().filter(|(i, _)| samples.normals[*i] != glam::DVec3::ZERO) {
        let region = &mut regions[state.sphere(hit.primitive, &hit.weights) as usize];
        region.0 += samples.weights[i] * target.cost_of(hit.distance);
        if hit.distance.abs() > region.1 {
            (region.1, region.2) = (hit.distance.abs(), i as u32);
        }
    }
    for anchor in &state.anchors {
        let region = &mut regions[state.sphere(anchor.place.primitive, &anchor.place.weights) as usize];
        region.0 += anchor.weight * target.penalty.of(anchor.error(&state.envelope));
    }
    let mut worst: Vec<(f64, u32)> = regions.iter().filter(|r| r.2 != u32::MAX).map(|r| (r.0, r.2)).collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    worst.truncate(count);
    worst.into_iter().map(|(_, sample)| sample).collect()
}

/// Returns the edit that joins a new sphere to another one by the cone with the largest gain. The other sphere belongs to the primitive `home` or is a
/// neighbour of it.
fn leaf(
    complex: &Complex,
    parts: &[u32],
    home: &Primitive,
    inserted: (Ball, u32),
    gain: impl Fn(&Complex, &Primitive) -> f64,
) -> Option<Edit> {
    let (ball, part) = inserted;
    let new = complex.balls.len() as u32;
    let mut around: BTreeSet<u32> = home.indices().iter().copied().collect();
    around.extend(complex.edges.iter().filter(|e| e.iter().any(|i| home.indices().contains(i))).flatten());
    around.retain(|&i| parts[i as usize] == part);
    let mut enlarged = complex.clone();
    enlarged.balls.push(ball);
    let gains = around.into_iter().map(|i| (gain(&enlarged, &Primitive::Cone([i, new])), i));
    let (_, end) = gains.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
    Some(Edit { inserted: Some(inserted), new_edges: vec![[end, new]], ..Edit::default() })
}

/// Returns the edits that split the primitive `home`, if it is a cone of the new sphere's part and the fraction `t` along it is not near an end. One edit
/// splits it at the new sphere. The other splits it at a sphere on the cone, which does not change the shape at the start.
fn splits(complex: &Complex, parts: &[u32], home: &Primitive, t: f64, inserted: (Ball, u32)) -> Vec<Edit> {
    let (ball, part) = inserted;
    let new = complex.balls.len() as u32;
    match *home {
        Primitive::Cone(ends) if t > 0.05 && t < 0.95 && ends.iter().all(|&i| parts[i as usize] == part) => {
            let [a, b] = ends.map(|i| complex.balls[i as usize]);
            let on_cone = Ball { center: a.center.lerp(b.center, t), radius: a.radius + t * (b.radius - a.radius) };
            let split = |ball| Edit {
                inserted: Some((ball, part)),
                cut_edges: vec![ends],
                new_edges: ends.map(|i| [i, new]).to_vec(),
                ..Edit::default()
            };
            vec![split(ball), split(on_cone)]
        }
        _ => vec![],
    }
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
