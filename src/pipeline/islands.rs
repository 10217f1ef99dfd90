//! Islands: bodies that may have to do with each other within a step, wherever each of them stops.
//!
//! A body that stops or slides stays near its own way, so that bodies whose ways are apart do not meet. One that is pushed may go anywhere: among those
//! that it could reach, all that are near are taken to meet.

use std::cell::Cell;

use bevy::tasks::TaskPool;

use super::{
    Culling, Scratch, Shape, Side, Statics, StepInput,
    assemblies::Assemblies,
    first_impact::ImpactResult,
    moving_boxes::{self, BoxCache, MovingBox},
    pairs::BodyPair,
    parallel::{self, Scratches},
};
use crate::{
    constants::{CHORD_TOLERANCE, CONTACT_ROUNDING},
    disjoint_sets::DisjointSets,
    geometry::Sweep,
};

/// Which pairs may meet, and the sets of bodies that these join.
#[derive(Debug, Default)]
pub(super) struct Islands {
    /// Of each body the one that stands for its island.
    sets: DisjointSets,
    may_meet: Vec<bool>,
    /// Which bodies are joined with others, and slide with them.
    joined: Vec<bool>,
    /// Islands in which a body pushes, and those in which there is an impact.
    pushed: Vec<bool>,
    eventful: Vec<bool>,
}

impl Islands {
    /// Finds the islands of a step. `results`: of each pair, were no body to stop.
    pub fn set(
        &mut self,
        input: &StepInput,
        statics: &Statics,
        pairs: &[BodyPair],
        results: &[ImpactResult],
        assemblies: &Assemblies,
        tasks: &Scratches<Scratch>,
        pool: &TaskPool,
    ) {
        let Self { sets, may_meet, joined, pushed, eventful } = self;
        for flags in [&mut *joined, pushed, eventful] {
            flags.clear();
            flags.resize(input.bodies.len(), false);
        }
        let stopping = |members: &[(u64, u32)]| members.iter().any(|&(_, body)| input.is_stopping(body));
        let several = assemblies.iter().filter(|members| members.len() > 1 && stopping(members));
        several.flatten().for_each(|&(_, body)| joined[body as usize] = true);
        // A kinematic body stops with what it is joined to.
        let stops = |body: u32| input.is_stopping(body) || joined[body as usize];
        let join = |sets: &mut DisjointSets, may_meet: &dyn Fn(usize) -> bool| {
            sets.reset(input.bodies.len());
            for (_, pair) in pairs.iter().enumerate().filter(|(i, _)| may_meet(*i)) {
                if let [Some(a), Some(b)] =
                    [pair.first, pair.second].map(|side| side.body().filter(|&body| stops(body)))
                {
                    sets.join(a, b);
                }
            }
            for members in assemblies.iter() {
                members.windows(2).for_each(|pair| _ = sets.join(pair[0].1, pair[1].1));
            }
            sets.flatten();
        };
        join(sets, &|i| pairs[i].stops);
        let near = |body: u32| sets.of(body) as usize;
        for (pair, result) in pairs.iter().zip(results).filter(|(pair, _)| pair.stops) {
            let pushes =
                pair.bodies().any(|body| !input.is_stopping(body) && !input.bodies[body as usize].sweep.is_at_rest());
            for body in pair.bodies().filter(|&body| stops(body)) {
                pushed[near(body)] |= pushes;
                eventful[near(body)] |= result.impact.is_some();
            }
        }
        parallel::map(pool, tasks, pairs, 16, may_meet, |scratch, i, pair| {
            let among = |islands: &[bool]| pair.bodies().any(|body| islands[near(body)]);
            pair.stops
                && among(eventful)
                && (results[i].impact.is_some()
                    || among(pushed)
                    || ways_meet(input, statics, pair, joined, &mut scratch.boxes))
        });
        join(sets, &|i| may_meet[i]);
    }

    /// The body that stands for the island.
    pub fn of(&self, body: u32) -> u32 {
        self.sets.of(body)
    }

    /// False if the bodies of a pair do not meet, wherever they stop.
    pub fn may_meet(&self, pair: usize) -> bool {
        self.may_meet[pair]
    }
}

/// True if two bodies come near each other, each wherever on its way, or if that is not known. `joined`: which bodies are joined with others,
/// and slide with them.
fn ways_meet(input: &StepInput, statics: &Statics, pair: &BodyPair, joined: &[bool], cache: &mut BoxCache) -> bool {
    if input.culling == Culling::None {
        return true;
    }
    let of = |side: Side| -> Option<(&Shape, Sweep)> {
        side.body().filter(|&body| !joined[body as usize])?;
        let (solid, sweep) = input.side(statics, side);
        Some((solid.medial()?, sweep))
    };
    let (Some((shape1, sweep1)), Some((shape2, sweep2))) = (of(pair.first), of(pair.second)) else { return true };
    let places = [cache.place(pair.first, shape1, &sweep1), cache.place(pair.second, shape2, &sweep2)];
    let boxes = places.map(|place| cache.between(place, [0.0, 1.0]));
    let size = shape1.bounding_sphere().radius.max(shape2.bounding_sphere().radius);
    let reach = 2.0 * input.slide_way() + (2.0 * CHORD_TOLERANCE + CONTACT_ROUNDING) * size;
    let found = Cell::new(false);
    let test =
        |box1: &MovingBox, box2: &MovingBox, offset| !found.get() && box1.span().is_near(&box2.span(), offset, reach);
    moving_boxes::visit_pairs([shape1, shape2], boxes, test, |_, _| found.set(true));
    found.get()
}

#[cfg(test)]
mod tests {
    use bevy::tasks::TaskPoolBuilder;
    use glam::Vec3;

    use super::*;
    use crate::{
        geometry::{Pose3, Sweep},
        medial_axis::MedialAxis,
        pipeline::{Body, Impact, Shape},
    };

    /// Four rings in a row that go down, all near each other; the ways of the first two meet, and those of the last two, and these two have an impact.
    fn input() -> (StepInput, Vec<BodyPair>, Vec<ImpactResult>) {
        let ring = Shape { axis: MedialAxis::torus(0.2, 0.05, 12).unwrap(), scale: 1.0 };
        let body = |x: f32| {
            let [start, end] = [0.0, -0.3].map(|y| Pose3::from_translation(Vec3::new(x, y, 0.0)));
            Body {
                assembly: Some(x.to_bits().into()),
                ..Body::new(ring.clone(), Sweep::between(start, end, Vec3::ZERO, Vec3::ZERO))
            }
        };
        let bodies = [0.0, 0.49, 1.1, 1.59].map(body).to_vec();
        let input = StepInput { bodies, stop_at_impact: true, prediction: 0.02, ..Default::default() };
        let pair = |[a, b]: [u32; 2]| BodyPair { first: Side::Body(a), second: Side::Body(b), stops: true };
        let pairs = [[0, 1], [1, 2], [2, 3]].map(pair).to_vec();
        let impact = Impact { fraction: 0.5, point: Vec3::ZERO, normal: Vec3::X, primitive1: 0, primitive2: 0 };
        let mut results = vec![ImpactResult::default(); 3];
        results[2].impact = Some(impact);
        (input, pairs, results)
    }

    fn islands((input, pairs, results): (StepInput, Vec<BodyPair>, Vec<ImpactResult>)) -> (Vec<u32>, Vec<bool>) {
        let pool = TaskPoolBuilder::new().num_threads(0).build();
        let (mut islands, mut assemblies) = (Islands::default(), Assemblies::default());
        assemblies.set(&input);
        islands.set(&input, &Statics::default(), &pairs, &results, &assemblies, &Scratches::default(), &pool);
        ((0..4).map(|body| islands.of(body)).collect(), islands.may_meet)
    }

    #[test]
    fn bodies_whose_ways_are_apart_are_no_island() {
        assert_eq!(islands(input()), (vec![0, 0, 2, 2], vec![true, false, true]));
    }

    #[test]
    fn a_long_way_to_slide_joins() {
        let (input, pairs, results) = input();
        let input = StepInput { fall: 0.1, ..input };
        assert_eq!(islands((input, pairs, results)), (vec![0; 4], vec![true; 3]));
    }

    #[test]
    fn what_is_pushed_may_go_anywhere() {
        let (mut input, pairs, results) = input();
        input.bodies[0].stops = false;
        assert_eq!(islands((input, pairs, results)), (vec![0, 1, 1, 1], vec![true; 3]));
    }

    #[test]
    fn joined_bodies_stop_together() {
        let (mut input, pairs, results) = input();
        input.bodies[3].assembly = input.bodies[0].assembly;
        assert_eq!(islands((input, pairs, results)), (vec![0; 4], vec![true, false, true]));
    }

    #[test]
    fn where_nothing_happens_nothing_is_looked_at() {
        let (input, pairs, mut results) = input();
        results[2].impact = None;
        assert_eq!(islands((input, pairs, results)), (vec![0, 1, 2, 3], vec![false; 3]));
    }
}
