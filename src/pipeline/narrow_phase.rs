//! Narrow phase: the first impact of each pair within the step, and its contacts at the final poses.

use std::ops::Range;

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    BoundedPair, CachedPair, ContactCache, ContactMargin, ConvexParts, Culling, Displacement, Manifold, OtherShape,
    Pair, Primitives, Shape, Side, Statics, StepInput, StepOutput,
    contacts::{
        EarlierPair,
        approach::Approach,
        find,
        gap::gap,
        near::near_shape,
        near_list::{NearList, NearPair},
        reduce,
    },
    found::{AllFound, Found, Scratch},
    output::laps,
    pairs::BodyPair,
    parallel::{self, Scratches},
    respond::Trajectories,
    solid::smaller_radius,
    sweep::{
        first_impact::{self, ImpactResult, Question, first_impact},
        mid_phase,
        motion::PairMotion,
    },
    tolerances::Tolerances,
};
use crate::{
    constants::{CONTACT_ROUNDING, MAX_NEAR_PAIRS, NEAR_MARGIN},
    geometry::{Pose3, Sweep},
};

/// Finds the first impact of each pair on the assumption that no body leaves its path. `known`: the primitive pairs of each pair; empty if no pair has any.
/// `cache`: the contacts of the last step.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    known: &[Primitives],
    cache: &ContactCache,
    tasks: &Scratches<first_impact::Scratch>,
    impacts: &mut Vec<ImpactResult>,
    pool: &TaskPool,
) {
    parallel::map(pool, tasks, pairs, 4, impacts, |scratch, i, pair| {
        let known = known.get(i).unwrap_or(&Primitives::Unknown);
        let earlier = at_start(input, statics, pair, cache);
        let gap = earlier.map_or(0.0, |earlier| earlier.near.gap());
        let is_idle = |path: f32, tolerances: &Tolerances| tolerances.is_short(path) || path + tolerances.reach() < gap;
        let motions = PairMotion::of_step(input, statics, pair, is_idle);
        let times = [Some([0.0, 1.0]); 2];
        let question = Question { input, statics, pair, known, earlier, times, normal: Vec3::ZERO };
        let result = first_impact(&question, motions, scratch, laps());
        if input.report_candidates {
            scratch.report(i);
        }
        result
    });
}

/// Returns a pair of the last step at the start of this one; `None` if results must not depend on earlier steps.
fn at_start<'c>(
    input: &'c StepInput,
    statics: &'c Statics,
    pair: &BodyPair,
    cache: &'c ContactCache,
) -> Option<EarlierPair<'c>> {
    // Candidates in the output do not depend on earlier steps.
    if input.report_candidates {
        return None;
    }
    let sides = [pair.first, pair.second];
    earlier(input, statics, sides, cache, || {
        input.pose12(statics, sides, |body| input.bodies[body as usize].sweep.start)
    })
}

/// Returns a pair of the last step at another pose, if contacts are kept between steps.
fn earlier<'c>(
    input: &'c StepInput,
    statics: &'c Statics,
    sides: [Side; 2],
    cache: &'c ContactCache,
    pose12: impl FnOnce() -> Pose3,
) -> Option<EarlierPair<'c>> {
    let [id1, id2] = sides.map(|side| input.id(statics, side));
    let ids = [id1?, id2?];
    input.recycle_contacts.then(|| cache.find(ids, sides.map(|side| input.side(statics, side).0), pose12()))?
}

/// Data for the contacts of a step.
pub(super) struct Ends<'a> {
    pub input: &'a StepInput,
    pub statics: &'a Statics,
    /// The primitive pairs of each pair; empty if no pair has any.
    pub known: &'a [Primitives],
    /// Where bodies end the step.
    pub trajectories: &'a Trajectories,
    /// Contacts of the last step.
    pub cache: &'a ContactCache,
}

/// A pair at the end of the step.
struct PairEnd<'a> {
    /// Index of the pair.
    index: usize,
    pair: &'a BodyPair,
    /// Pose of the second side in the frame of the first.
    pose12: Pose3,
    /// Margin of the contact search.
    reach: ContactMargin,
    /// Bounding radius of the smaller body, in metres.
    size: f32,
    /// See [`Ends::list_margin`].
    list_margin: Option<f32>,
}

impl Ends<'_> {
    /// Finds the manifolds of each pair at the final poses of its bodies. The pairs are listed in the tasks' scratch buffers.
    pub fn manifolds(
        &self,
        pairs: &[BodyPair],
        tasks: &Scratches<Scratch>,
        manifolds: &mut Vec<Manifold>,
        pool: &TaskPool,
    ) {
        let Self { input, trajectories, .. } = *self;
        parallel::gather(pool, tasks, pairs, 4, manifolds, |scratch, i, pair, manifolds| {
            // Rapier needs no contacts between sleeping bodies that are not pushed.
            if pair.bodies().any(|body| input.bodies[body as usize].active || trajectories.leaves_path(body)) {
                self.manifolds_of(i, pair, scratch, manifolds);
            }
        });
    }

    fn manifolds_of(&self, index: usize, pair: &BodyPair, scratch: &mut Scratch, manifolds: &mut Vec<Manifold>) {
        let Self { input, statics, trajectories, cache, .. } = *self;
        let sides = [pair.first, pair.second];
        let solids = sides.map(|side| input.side(statics, side).0);
        let Some(shape1) = solids[0].medial() else { return };
        let pose12 = input.pose12(statics, sides, |body| trajectories.final_pose(input, body));
        let reach = self.margin(sides);
        let earlier = earlier(input, statics, sides, cache, || pose12);
        let recycled = earlier.filter(|earlier| earlier.is_recyclable(reach));
        let [before, first] = [manifolds.len(), scratch.found.near_pairs.len()];
        let near = if let Some(recycled) = &recycled {
            manifolds.extend(recycled.manifolds());
            recycled.near
        } else {
            let size = smaller_radius(solids);
            let end = PairEnd { index, pair, pose12, reach, size, list_margin: self.list_margin(sides, size) };
            scratch.contacts.clear();
            let near = match solids[1].second() {
                OtherShape::Shape(shape2) => self.search([shape1, shape2], &end, earlier, scratch),
                OtherShape::Parts(parts) => self.search_parts(shape1, parts, &end, scratch),
            };
            let Scratch { contacts, reduce, .. } = scratch;
            let approach = if reach.is_fast { self.approach(sides) } else { None };
            reach.keep_reached(contacts, |contact| {
                approach.is_some_and(|approach| approach.reaches(contact, shape1, solids[1].second()))
            });
            reduce::reduce(contacts, input.length_unit, reduce, |manifold| manifolds.push(manifold));
            near
        };
        let near_pairs = first as u32..scratch.found.near_pairs.len() as u32;
        let (count, recycled) = ((manifolds.len() - before) as u32, recycled.map(|recycled| recycled.index));
        scratch.found.pairs.push(Found { pair: index as u32, count, reach, near, near_pairs, pose12, recycled });
    }

    /// Finds the contacts of two medial shapes. Returns the bounds of the list of near primitives, which is kept for later steps if the pair is slow.
    fn search(
        &self,
        [shape1, shape2]: [&Shape; 2],
        end: &PairEnd,
        earlier: Option<EarlierPair>,
        Scratch { find: buffers, contacts, found: AllFound { near_pairs, .. }, .. }: &mut Scratch,
    ) -> NearList {
        let &PairEnd { pose12, reach, list_margin, .. } = end;
        let begin = near_pairs.len();
        let (mut list, is_kept) = if self.input.culling == Culling::None {
            near_pairs.extend(mid_phase::all(shape1.len(), shape2.len()).map(NearPair::always));
            (NearList::default(), false)
        } else if let Some(earlier) = earlier.filter(|earlier| earlier.near.covers(reach.prediction)) {
            near_pairs.extend_from_slice(earlier.near_pairs());
            (earlier.near, true)
        } else if list_margin.is_none() && self.list_known(end, near_pairs) {
            (NearList::default(), false)
        } else {
            let within = reach.prediction + list_margin.unwrap_or(0.0);
            let list = near_shape(shape1, shape2, &pose12, within, &mut buffers.near, near_pairs);
            (list, list_margin.is_some())
        };
        find::of_shapes(shape1, shape2, &pose12, reach, &list, &mut near_pairs[begin..], contacts, buffers);
        if !is_kept || near_pairs.len() - begin > MAX_NEAR_PAIRS {
            near_pairs.truncate(begin);
            return NearList::default();
        }
        list.update_gap(&near_pairs[begin..]);
        list
    }

    /// Finds the contacts of a medial shape and another collider. Returns the bounds of an empty list if they are slow and apart.
    fn search_parts(
        &self,
        shape1: &Shape,
        parts: &dyn ConvexParts,
        end: &PairEnd,
        Scratch { find: buffers, contacts, found: AllFound { near_pairs, .. }, .. }: &mut Scratch,
    ) -> NearList {
        let &PairEnd { pose12, reach, size, list_margin, .. } = end;
        let begin = near_pairs.len();
        let is_known = self.list_known(end, near_pairs);
        find::of_parts(shape1, parts, &pose12, reach, is_known.then_some(&near_pairs[begin..]), contacts, buffers);
        near_pairs.truncate(begin);
        // A fast pair closes its gap within a few steps, so computing it does not pay.
        match list_margin {
            Some(margin) if contacts.is_empty() => {
                let gap = gap(shape1, parts, &pose12, reach.prediction + margin);
                let mut list = NearList::new(gap, CONTACT_ROUNDING * size);
                list.update_gap(&[]);
                list
            }
            _ => NearList::default(),
        }
    }

    /// Returns the margin in metres of a list that a pair can use in the next step; `None` if it moves farther, or if contacts are not kept between steps.
    /// `size`: bounding radius of the smaller body, in metres.
    fn list_margin(&self, sides: [Side; 2], size: f32) -> Option<f32> {
        let [first, second] = sides.map(|side| self.next_displacement(side));
        let margin = NEAR_MARGIN * size;
        (first?.against(&second?) <= margin && self.input.recycle_contacts).then_some(margin)
    }

    /// Returns the relative motion of a pair in the coming step; `None` if the second side is skinned, because its next pose is not known.
    fn approach(&self, sides: [Side; 2]) -> Option<Approach> {
        let Self { input, statics, trajectories, .. } = *self;
        if input.side(statics, sides[1]).0.deforming().is_some() {
            return None;
        }
        let sweep = |side: Side| match side {
            Side::Static(body) => Some(Sweep::at_rest(statics.bodies[body as usize].pose)),
            Side::Body(body) => {
                let next = self.next_displacement(side)?;
                let center = input.bodies[body as usize].sweep.local_center;
                Some(Sweep::at_rates(trajectories.final_pose(input, body), center, next.translation, next.rotation))
            }
        };
        Some(Approach::new(&[sweep(sides[0])?, sweep(sides[1])?]))
    }

    /// Appends the primitive pairs that may have contacts, in ascending order. Returns false if they are not known.
    fn list_known(&self, &PairEnd { index, pair, .. }: &PairEnd, near_pairs: &mut Vec<NearPair>) -> bool {
        // The bounds hold while both bodies are on their own paths at the same time.
        let mut ends = pair.bodies().map(|body| self.trajectories.path_end(body));
        let (Some(Primitives::Bounded(known)), Some(Some(end))) = (self.known.get(index), ends.next()) else {
            return false;
        };
        if self.input.culling == Culling::None || ends.any(|other| other != Some(end)) {
            return false;
        }
        let begin = near_pairs.len();
        let is_near = |bounded: &&BoundedPair| end < 1.0 || bounded.is_near_at_end;
        let known = known.iter().filter(is_near);
        near_pairs.extend(known.map(|bounded| NearPair::always(bounded.primitives)));
        near_pairs[begin..].sort_unstable_by_key(|pair| pair.primitives);
        true
    }

    /// Returns the margin of the contact search of a pair at the end of the step.
    fn margin(&self, sides: [Side; 2]) -> ContactMargin {
        let margin = ContactMargin::new(self.input.prediction, self.input.length_unit);
        match sides.map(|side| self.next_displacement(side)) {
            [Some(first), Some(second)] => margin.of_pair([&first, &second]),
            _ => margin,
        }
    }

    /// Returns the displacement of a side in the next step, which is longer by the time that the body has lost. `None` if no solver acts on it.
    fn next_displacement(&self, side: Side) -> Option<Displacement> {
        let Some(body) = side.body() else { return Some(Displacement::REST) };
        Some(self.input.bodies[body as usize].next_displacement?.times(2.0 - self.trajectories.moved_until(body)))
    }

    /// Adds the pairs with manifolds or an impact to the output, whose manifolds are set.
    pub fn report(&self, pairs: &[BodyPair], impacts: &[ImpactResult], found: &AllFound, output: &mut StepOutput) {
        let mut found = found.pairs.iter().peekable();
        let mut begin = 0;
        for (i, (pair, ImpactResult { impact, .. })) in pairs.iter().zip(impacts).enumerate() {
            let search = found.next_if(|found| found.pair as usize == i);
            let count = search.map_or(0, |found| found.count as usize);
            let manifolds = begin..begin + count;
            begin = manifolds.end;
            if count > 0 || impact.is_some() {
                let points = output.manifolds[manifolds.clone()].iter().map(|manifold| manifold.contacts().len());
                output.counts.contacts += points.sum::<usize>();
                let &BodyPair { first, second, .. } = pair;
                let reach = search.map_or_else(|| self.margin([first, second]), |found| found.reach);
                output.pairs.push(Pair { first, second, manifolds, reach, impact: *impact });
            }
        }
    }

    /// Lists the contacts for the next step. `manifolds`: those of all pairs.
    pub fn fill(&self, pairs: &[BodyPair], found: &AllFound, manifolds: &[Manifold], next: &mut ContactCache) {
        let Self { input, statics, cache, .. } = *self;
        next.clear();
        let mut begin = 0;
        for &Found { pair, count, reach, near, near_pairs: Range { start, end }, pose12, recycled } in &found.pairs {
            let manifolds = &manifolds[begin..begin + count as usize];
            begin += manifolds.len();
            let BodyPair { first, second, .. } = pairs[pair as usize];
            let sides = [first, second];
            if let Some(index) = recycled {
                next.keep(cache, index, reach, pose12, near);
            } else if let [Some(id1), Some(id2)] = sides.map(|side| input.id(statics, side)) {
                let solids = sides.map(|side| input.side(statics, side).0);
                let pair = CachedPair::new([id1, id2], solids, reach, pose12, near);
                next.push(pair, manifolds, &found.near_pairs[start as usize..end as usize]);
            }
        }
    }
}
