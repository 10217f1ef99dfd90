//! The first impact of a pair within the step.

use std::{slice, time::Duration};

use glam::Vec3;
use smallvec::SmallVec;

use super::{
    Impact, Scratch, Statics, StepInput,
    mid_phase::{self, Candidates, OwnBoxes},
    motion::{Facing, Motions, PairMotion, with_sides},
    moving_boxes::{BoxCache, TimedBoxes},
    pairs::{BodyPair, PrimitivePair},
    parting::{Parting, Room},
};
use crate::{
    constants::FEW_PRIMITIVES,
    geometry::Sweep,
    query::{Chords, RigidStart, TimeOfImpactStatus, rigid_impact, rigid_start},
};

/// The first impact of a pair, and what a search from later on takes from it.
#[derive(Clone, Debug, Default)]
pub(super) struct ImpactResult {
    pub impact: Option<Impact>,
    /// Overlap that the pair may gain, in metres.
    pub slop: f32,
    /// True if the pair was in touch at the start.
    pub in_touch: bool,
    /// [`Question::near`].
    pub near: f32,
    /// Unit normal between the primitives that were nearest to each other at the start, in the world; zero if none was looked at.
    pub normal: Vec3,
}

/// What searches took.
#[derive(Debug, Default)]
pub(super) struct Tally {
    /// How many primitive pairs were left by culling.
    pub candidates: usize,
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// What is asked about a pair.
#[derive(Clone, Copy)]
pub(super) struct Question<'a> {
    pub input: &'a StepInput,
    pub statics: &'a Statics,
    pub pair: &'a BodyPair,
    /// What culling has left of the pair, if that is known, for a step that is searched at once.
    pub known: Option<&'a [PrimitivePair]>,
    /// Between which times of its motion in the step either side is, if it is anywhere near it.
    pub times: [Option<[f32; 2]>; 2],
    /// How far both may be from there, together, in metres.
    pub slack: f32,
    /// Up to which distance at the start the solver knows of contacts, in metres, and holds their places up as they are then. What slides or turns
    /// may overlap all the same, and would stop at each touch.
    pub near: f32,
    /// A direction in the world, from the first body to the second, along which many of their primitives may be apart; zero if none is known.
    pub normal: Vec3,
}

/// What is kept from search to search, so that nothing has to be allocated anew.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    own: OwnBoxes,
    /// Of each motion.
    candidates: Vec<Candidates>,
    /// What culling has left of the pair that was searched last, if that is to be reported.
    pub reported: Vec<PrimitivePair>,
    search: SearchBuffers,
}

#[derive(Debug, Default)]
struct SearchBuffers {
    /// Of each motion.
    chords: Vec<Chords>,
    room: Room,
    /// The motion of primitives that come nearer to each other, and how they begin the part.
    approaching: Vec<(usize, PrimitivePair, RigidStart)>,
    /// The overlaps of single primitives of a motion at the start of the step.
    overlaps: Vec<((usize, PrimitivePair), f32)>,
}

/// The earliest impact of a pair's motions: where an overlap grows by more than a slop, which contacts never do that the
/// solver knows about and whose places stay; for primitives that it knows nothing of, where they touch. None where what is left of the
/// motion is less than a slop itself: a pile that settles must come to rest.
///
/// What slides over a seam takes the overlap that it has along to the next part. Where bodies spin or go far, the step is searched in parts.
///
/// `lap`: a clock for culling and searching.
pub(super) fn first_impact(
    question: &Question,
    mut motions: Motions,
    scratch: &mut Scratch,
    mut lap: impl FnMut() -> Duration,
) -> ImpactResult {
    let Question { input, known, slack, near, normal, .. } = *question;
    let Scratch {
        boxes: cache,
        first_impact: Buffers { own, candidates, reported, search: buffers },
        tally,
        laps: [culling, searching],
        ..
    } = scratch;
    reported.clear();
    let slop = motions.iter().map(|motion| motion.slop).fold(0.0, f32::max);
    let result = ImpactResult { slop, near, normal, ..Default::default() };
    // On a shorter way no overlap grows by that.
    if motions.iter().all(|motion| motion.way() <= motion.slop) {
        return result;
    }
    buffers.overlaps.clear();
    let count = motions.iter().map(PairMotion::parts).max().unwrap_or(1);
    let mut search = Search { result, carried: 0.0, met: None, tally, buffers };
    // Those of the bodies are for all of the way.
    let boxes = if count == 1 && known.is_none() { question.boxes(cache) } else { [None; 2] };
    let parts = Parts::new(&motions, count);
    candidates.resize_with(motions.len().max(candidates.len()), Vec::new);
    for part in 0..count {
        parts.cut(&mut motions, part);
        for (motion, found) in motions.iter().zip(candidates.iter_mut()) {
            found.clear();
            match known {
                Some(known) if count == 1 => mid_phase::of_motion(motion, known, found),
                _ => mid_phase::candidates(motion, input.culling, slack + motion.reach(), boxes, own, found),
            }
            search.tally.candidates += found.len();
            if input.report_candidates {
                reported.extend_from_slice(found);
            }
        }
        *culling += lap();
        search.run(&motions, |motion| &candidates[motion], [part, count]);
        let is_met = search.result.impact.is_some();
        if is_met {
            search.go_back(&mut motions, &parts, part);
        }
        *searching += lap();
        if is_met {
            break;
        }
    }
    search.result
}

impl Question<'_> {
    /// The boxes of either side on its way, as far as it is near it.
    fn boxes<'c>(&self, cache: &'c mut BoxCache) -> [Option<TimedBoxes<'c>>; 2] {
        let places = [(self.pair.first, self.times[0]), (self.pair.second, self.times[1])].map(|(side, times)| {
            let (solid, sweep) = self.input.side(self.statics, side);
            let (shape, times) = (solid.medial()?, times?);
            Some((cache.place(side, shape, &sweep), times))
        });
        places.map(|place| place.map(|(place, times)| cache.between(place, times)))
    }
}

/// The parts of a step of equal length.
struct Parts {
    /// The motions of either side over the whole step.
    whole: SmallVec<[[Sweep; 2]; 1]>,
    count: usize,
}

impl Parts {
    fn new(motions: &[PairMotion], count: usize) -> Self {
        Self { whole: motions.iter().map(|motion| [motion.sweep1, motion.sweep2]).collect(), count }
    }

    /// Leaves one part of the motions.
    fn cut(&self, motions: &mut [PairMotion], part: usize) {
        let times = [part, part + 1].map(|i| i as f32 / self.count as f32);
        for (motion, whole) in motions.iter_mut().zip(&self.whole) {
            [motion.sweep1, motion.sweep2] = *whole;
            motion.cut(times);
        }
    }
}

/// A search for the first impact of a pair, part by part of the step.
struct Search<'b> {
    result: ImpactResult,
    /// How deep primitives may be that were less deep at the start of the step, in metres.
    carried: f32,
    /// The motion and the primitives that meet first so far, and whether they have touched at the start of the part.
    met: Option<(usize, PrimitivePair, bool)>,
    tally: &'b mut Tally,
    buffers: &'b mut SearchBuffers,
}

impl Search<'_> {
    /// Takes the impact back to where its primitives touched, if that was in an earlier part and not from the start on.
    fn go_back(&mut self, motions: &mut [PairMotion], parts: &Parts, found_in: usize) {
        let found = self.result.impact;
        let mut earlier = (0..found_in).rev();
        while let Some((index, pair, true)) = self.met.take() {
            let Some(part) = earlier.next() else {
                self.result.impact = found;
                return;
            };
            parts.cut(motions, part);
            motions[index].slop = 0.0;
            let later = self.result.impact.take();
            let alone = |motion| if motion == index { slice::from_ref(&pair) } else { &[] };
            self.run(motions, alone, [part, parts.count]);
            self.result.impact = self.result.impact.or(later);
        }
    }

    /// Searches a part of the step, of so many. `candidates` of each motion.
    fn run<'c>(
        &mut self,
        motions: &[PairMotion],
        candidates: impl Fn(usize) -> &'c [PrimitivePair],
        [part, parts]: [usize; 2],
    ) {
        let result = &mut self.result;
        let near = if parts == 1 { result.near } else { 0.0 };
        let SearchBuffers { chords: all_chords, room, approaching, overlaps } = &mut *self.buffers;
        all_chords.resize_with(motions.len().max(all_chords.len()), Chords::default);
        approaching.clear();
        let mut nearest = f32::INFINITY;
        for (index, (motion, chords)) in motions.iter().zip(all_chords.iter_mut()).enumerate() {
            let candidates = candidates(index);
            if candidates.is_empty() {
                continue;
            }
            motion.set_chords(chords);
            self.tally.toi_tests += candidates.len();
            let direction = match result.normal {
                normal if normal == Vec3::ZERO => motion.center_line(),
                normal => motion.to_chords(normal),
            };
            let many = candidates.len() > FEW_PRIMITIVES;
            let mut parting = if many { Parting::new(motion, chords, direction, room) } else { None };
            for &pair in candidates {
                if parting.as_ref().is_some_and(|parting| parting.is_apart(pair)) {
                    continue;
                }
                let start = with_sides!(motion.facing, motion.shape1.hull(pair[0]), pair[1], |first, second| {
                    rigid_start(&first, second, chords)
                });
                if let Some(parting) = &mut parting {
                    parting.learn(start.normal());
                }
                if start.distance() < nearest {
                    nearest = start.distance();
                    result.normal = motion.frame_at(0.0).rotation * start.normal();
                }
                if part == 0 && start.overlap() > 0.0 {
                    self.carried = self.carried.max(motion.carried(start.overlap()));
                    overlaps.push(((index, pair), start.overlap()));
                }
                if !start.stay_apart() {
                    result.in_touch |= part == 0 && start.distance() <= motion.touch;
                    approaching.push((index, pair, start));
                }
            }
        }
        overlaps.sort_unstable_by_key(|(key, _)| *key);
        // The nearest are likely to meet first, and what is farther off than they leave time for is not looked at.
        approaching.sort_unstable_by(|a, b| {
            let order = a.2.distance().total_cmp(&b.2.distance());
            order.then_with(|| (a.0, a.1).cmp(&(b.0, b.1)))
        });
        for (index, pair, start) in approaching.iter() {
            let (motion, chords) = (&motions[*index], &all_chords[*index]);
            let limit = result.impact.map_or(1.0, |impact| impact.fraction);
            let own = overlaps.binary_search_by_key(&(*index, *pair), |(key, _)| *key);
            let overlap = own.map_or(self.carried, |own| overlaps[own].1.max(self.carried));
            let toi = with_sides!(motion.facing, motion.shape1.hull(pair[0]), pair[1], |first, second| {
                rigid_impact(&first, second, chords, start, limit, [overlap, motion.slop, near])
            });
            self.tally.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
            let earlier = result.impact.is_none_or(|first| toi.fraction < first.fraction);
            let left = (parts - part) as f32 - toi.fraction;
            if toi.status == TimeOfImpactStatus::Separated || !earlier || left * motion.way() <= motion.slop {
                continue;
            }
            let frame = motion.frame_at(toi.fraction);
            let normal = frame.rotation * toi.contact.normal;
            let primitive2 = match &motion.facing {
                Facing::Shape(_) => pair[1],
                Facing::Part(part) => part.id,
            };
            let middle = frame.transform_point((toi.contact.point1 + toi.contact.point2) * 0.5);
            let point = middle - normal * motion.facing.rounding();
            self.met = Some((*index, *pair, start.overlap() > 0.0));
            result.impact = Some(Impact { fraction: toi.fraction, point, normal, primitive1: pair[0], primitive2 });
        }
        if let Some(impact) = &mut result.impact {
            impact.fraction = (part as f32 + impact.fraction) / parts as f32;
        }
    }
}
