//! The first impact of a pair within the step.

use std::time::Duration;

use bevy::platform::collections::HashMap;
use glam::Vec3;
use smallvec::SmallVec;

use crate::{
    constants::{FEW_PRIMITIVES, MAX_ITERATIONS},
    geometry::Sphere,
    pipeline::{
        Culling, Impact, Primitives, Statics, StepInput,
        contacts::EarlierPair,
        pairs::{BodyPair, PrimitivePair},
        sweep::{
            mid_phase,
            motion::{Motions, PairMotion, Paths, with_sides},
            moving_boxes::{BoxCache, MovingBoxes, TimedBoxes},
            separating_axis::SeparatingAxis,
            touch::{Touch, touch},
        },
    },
    query::{Chord, RigidStart, TimeOfImpact, rigid_start},
};

/// The first impact of a pair, and a hint for later searches.
#[derive(Clone, Debug, Default)]
pub(in crate::pipeline) struct ImpactResult {
    pub impact: Option<Impact>,
    /// Unit normal between the primitives that are nearest to each other at the start, in the world; zero if no primitives were tested.
    pub normal: Vec3,
}

/// Counters of searches.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Tally {
    /// Primitive pairs that culling leaves.
    pub candidates: usize,
    /// Primitive pairs whose distance and time of impact were computed.
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// Input of a search for the first impact of a pair.
#[derive(Clone, Copy)]
pub(in crate::pipeline) struct Question<'a> {
    pub input: &'a StepInput,
    pub statics: &'a Statics,
    pub pair: &'a BodyPair,
    pub known: &'a Primitives,
    /// The pair in the last step, at the start of the motion.
    pub earlier: Option<EarlierPair<'a>>,
    /// Per side, the fractions of its original motion between which the side moves. `None` for a side that is off its original path.
    pub times: [Option<[f32; 2]>; 2],
    /// A direction from the first body to the second, in the world, along which many of their primitives may be apart; zero if it is not known.
    pub normal: Vec3,
}

/// Buffers of a task, and the results that it keeps until all pairs are done.
#[derive(Debug, Default)]
pub(in crate::pipeline) struct Scratch {
    boxes: BoxCache,
    buffers: Buffers,
    /// Candidates of each pair after culling, if they are part of the output.
    pub reported: Vec<(usize, Vec<PrimitivePair>)>,
    pub tally: Tally,
    /// Times of culling and searching.
    pub laps: [Duration; 2],
}

impl Scratch {
    /// Drops the bodies and pairs of the last step, even if a panic has interrupted that step.
    pub fn forget(&mut self) {
        self.boxes.clear();
        self.reported.clear();
        self.tally = Tally::default();
    }

    /// Keeps the candidates of the last search as those of a pair.
    pub fn report(&mut self, pair: usize) {
        self.reported.push((pair, std::mem::take(&mut self.buffers.reported)));
    }
}

/// Buffers that are kept from search to search to avoid allocations.
#[derive(Debug, Default)]
struct Buffers {
    /// Boxes of both sides that are computed for a single search.
    own: [MovingBoxes; 2],
    /// Chords of the motions in an interval.
    chords: Vec<Chord>,
    /// Candidates of each motion that may be in touch at the start of the interval.
    candidates: Vec<Vec<PrimitivePair>>,
    /// Primitive pairs that may touch in the interval.
    approaching: Vec<Approaching>,
    /// Candidates of the last searched pair after culling, if they are part of the output.
    reported: Vec<PrimitivePair>,
    /// Spheres of both sides at the start and at the end of an interval.
    spheres: [Vec<[Sphere; 2]>; 2],
    /// Overlaps at the start of the step in metres.
    overlaps: HashMap<Key, f32>,
    /// Start of each touch of surfaces in an earlier interval of the step.
    grazes: Vec<(Key, Impact)>,
}

/// Index of a motion, and primitives of its sides.
type Key = (usize, PrimitivePair);

/// A primitive pair that may touch in an interval.
#[derive(Clone, Copy, Debug)]
struct Approaching {
    key: Key,
    /// Lower bound of the time of the first touch, in steps.
    bound: f32,
    /// State at the start of the interval, if it is known.
    start: Option<RigidStart>,
}

/// Finds the earliest impact of a pair's motions: the first touch of cores.
///
/// `lap`: a clock that measures culling and searching.
pub(in crate::pipeline) fn first_impact(
    question: &Question,
    mut motions: Motions,
    scratch: &mut Scratch,
    lap: impl FnMut() -> Duration,
) -> ImpactResult {
    let Scratch { boxes, buffers, tally, laps, .. } = scratch;
    buffers.reported.clear();
    buffers.overlaps.clear();
    buffers.grazes.clear();
    let result = ImpactResult { normal: question.normal, ..Default::default() };
    if motions.is_empty() {
        return result;
    }
    let mut search = Search { question, result, first: (0, [0; 2]), deepest: None, boxes, tally, buffers, laps, lap };
    search.interval(&mut motions, [0.0, 1.0]);
    search.result
}

impl Question<'_> {
    /// Returns the primitive pairs that may be within `reach` metres at the start of the motion, if a list of an earlier step has all of them.
    fn listed_within(&self, reach: f32) -> Option<impl Iterator<Item = PrimitivePair>> {
        self.earlier.filter(|_| self.input.culling != Culling::None)?.primitives_within(reach)
    }

    /// Returns the cached boxes of each side on its original path. `None` for a side that is off its path or is not medial.
    fn boxes<'c>(&self, cache: &'c mut BoxCache) -> [Option<TimedBoxes<'c>>; 2] {
        let places = [(self.pair.first, self.times[0]), (self.pair.second, self.times[1])].map(|(side, times)| {
            let (solid, sweep) = self.input.side(self.statics, side);
            let (shape, times) = (solid.medial()?, times?);
            Some((cache.place(side, shape, &sweep), times))
        });
        places.map(|place| place.map(|(place, times)| cache.between(place, times)))
    }
}

/// Returns an impact of two primitives in the world. `toi`: their touch in an interval. `times`: start and end of the interval, in steps.
fn in_world(motion: &PairMotion, [primitive1, second]: PrimitivePair, toi: &TimeOfImpact, times: [f32; 2]) -> Impact {
    let frame = motion.frame_at(toi.fraction);
    let normal = frame.rotation * toi.contact.normal;
    let primitive2 = motion.other.id(second);
    let middle = frame.transform_point((toi.contact.point1 + toi.contact.point2) * 0.5);
    let point = middle - normal * motion.other.rounding();
    let fraction = in_steps(toi.fraction, times);
    Impact { fraction, point, normal, primitive1, primitive2 }
}

/// A search for the first impact of a pair.
struct Search<'b, L> {
    question: &'b Question<'b>,
    result: ImpactResult,
    /// Motion and primitives of the impact, if there is one.
    first: Key,
    /// Largest overlap of the bodies at the start of the step, in metres. `None` if they are not in touch there.
    deepest: Option<f32>,
    boxes: &'b mut BoxCache,
    tally: &'b mut Tally,
    buffers: &'b mut Buffers,
    /// Times of culling and searching.
    laps: &'b mut [Duration; 2],
    lap: L,
}

impl<L: FnMut() -> Duration> Search<'_, L> {
    /// Searches an interval of the step, given in steps. An interval that is too long for one search is split unless culling clears it. The second part
    /// is skipped after an impact in the first.
    fn interval<'a>(&mut self, motions: &mut [PairMotion<'a>], times: [f32; 2]) {
        self.buffers.chords.clear();
        self.buffers.chords.extend(motions.iter().map(PairMotion::chord));
        let mut all = motions.iter().zip(&self.buffers.chords);
        let is_one = (times[1] - times[0]) * MAX_ITERATIONS as f32 <= 1.0
            || all.all(|(motion, chord)| motion.is_one_interval(chord));
        let is_clear = !self.cull(motions, times, if is_one { usize::MAX } else { 1 });
        self.laps[0] += (self.lap)();
        if is_clear {
            return;
        }
        if is_one {
            self.search(motions, times);
            self.laps[1] += (self.lap)();
            return;
        }
        let whole: SmallVec<[Paths<'a>; 1]> = motions.iter().map(PairMotion::paths).collect();
        // Primitives of one body have their corners at the same times.
        let split = motions.first().and_then(PairMotion::first_corner).unwrap_or(0.5);
        let middle = times[0] + split * (times[1] - times[0]);
        for (part, of_step) in [([0.0, split], [times[0], middle]), ([split, 1.0], [middle, times[1]])] {
            motions.iter_mut().zip(&whole).for_each(|(motion, paths)| motion.follow(paths, part));
            self.interval(motions, of_step);
            if self.result.impact.is_some() {
                return;
            }
        }
    }

    /// Finds the candidates of each motion in an interval, and stops soon after `max` of them. Returns true if there are candidates.
    fn cull(&mut self, motions: &[PairMotion], times: [f32; 2], max: usize) -> bool {
        let Buffers { own, candidates, approaching, .. } = &mut *self.buffers;
        candidates.resize_with(motions.len().max(candidates.len()), Vec::new);
        candidates.iter_mut().for_each(Vec::clear);
        approaching.clear();
        let (known, is_whole) = (self.question.known, times == [0.0, 1.0]);
        let is_unknown = is_whole && matches!(known, Primitives::Unknown);
        if let ([motion], true) = (motions, is_unknown)
            && let Some(listed) = self.question.listed_within(motion.path() + motion.tolerances.reach())
        {
            candidates[0].extend(listed);
            return !candidates[0].is_empty();
        }
        // Cached boxes have margins for the whole path, so they are too large for a part of it.
        let boxes = if is_unknown { self.question.boxes(self.boxes) } else { [None; 2] };
        // Bounds clear intervals before the first touch. Trees find the primitives that are near in a part of the step.
        if let Primitives::Bounded(known) = known
            && known.iter().all(|bounded| bounded.touch_bound > times[1])
        {
            return false;
        }
        for (index, (motion, found)) in motions.iter().zip(candidates.iter_mut()).enumerate() {
            match known {
                Primitives::Bounded(known) if is_whole => {
                    for bounded in known.iter().filter(|bounded| bounded.touch_bound <= times[1]) {
                        let Some(pair) = mid_phase::of_motion(motion, bounded.primitives) else { continue };
                        if bounded.touch_bound <= times[0] {
                            found.push(pair);
                        } else {
                            approaching.push(Approaching {
                                key: (index, pair),
                                bound: bounded.touch_bound,
                                start: None,
                            });
                        }
                    }
                    found.sort_unstable();
                }
                Primitives::MayTouch(known) if is_whole => {
                    found.extend(known.iter().filter_map(|pair| mid_phase::of_motion(motion, *pair)));
                }
                _ => mid_phase::candidates(
                    motion,
                    self.question.input.culling,
                    motion.tolerances.reach(),
                    max,
                    boxes,
                    own,
                    found,
                ),
            }
        }
        !approaching.is_empty() || candidates[..motions.len()].iter().any(|found| !found.is_empty())
    }

    /// Searches the candidates of an interval in the order of their bounds, until the next bound is later than the earliest impact.
    fn search(&mut self, motions: &[PairMotion], times: [f32; 2]) {
        self.find_approaching(motions, times);
        let mut approaching = std::mem::take(&mut self.buffers.approaching);
        approaching.sort_unstable_by(|a, b| a.bound.total_cmp(&b.bound).then_with(|| a.key.cmp(&b.key)));
        for &Approaching { key, bound, start } in &approaching {
            if self.result.impact.is_some_and(|first| first.fraction < bound) {
                break;
            }
            let start = start.unwrap_or_else(|| {
                self.tally.toi_tests += 1;
                start_of(&motions[key.0], &self.buffers.chords[key.0], key.1)
            });
            self.search_pair(motions, key, &start, times);
        }
        self.buffers.approaching = approaching;
    }

    /// Searches a primitive pair in an interval up to the earliest impact so far. The result of the interval does not depend on the order of the pairs.
    fn search_pair(&mut self, motions: &[PairMotion], key: Key, start: &RigidStart, times: [f32; 2]) {
        let (index, pair) = key;
        let motion = &motions[index];
        let Buffers { chords, overlaps, grazes, .. } = &mut *self.buffers;
        let graze = grazes.iter().find(|(known, _)| *known == key).map(|(_, impact)| *impact);
        let limit = match self.result.impact {
            // Rounded up, so that equal times are not missed.
            Some(first) if graze.is_none() => {
                ((first.fraction - times[0] + f32::EPSILON) / (times[1] - times[0])).min(1.0)
            }
            _ => 1.0,
        };
        let overlap = overlaps.get(&key).copied().unwrap_or(0.0);
        let known_overlap =
            |deepest| motion.tolerances.known_overlap(motion.thickness(pair), overlap, deepest).max(start.overlap());
        let shallow = self.deepest.map_or(0.0, known_overlap);
        let found = match touch(
            motion,
            &chords[index],
            pair,
            start,
            limit,
            shallow,
            graze.is_some(),
            &mut self.tally.unresolved,
        ) {
            Some(Touch::Stop(toi)) => in_world(motion, pair, &toi, times),
            Some(Touch::GrazeEnd) => graze.expect("only known grazes end"),
            Some(Touch::Graze(toi)) => {
                grazes.push((key, in_world(motion, pair, &toi, times)));
                return;
            }
            None => return,
        };
        let is_first = self
            .result
            .impact
            .is_none_or(|first| found.fraction.total_cmp(&first.fraction).then_with(|| key.cmp(&self.first)).is_lt());
        if is_first {
            (self.result.impact, self.first) = (Some(found), key);
        }
    }

    /// Tests the candidates at the start of an interval, and adds those that may touch within it to the list.
    fn find_approaching(&mut self, motions: &[PairMotion], times: [f32; 2]) {
        let Buffers { chords, candidates, reported, spheres, approaching, overlaps, grazes, .. } = &mut *self.buffers;
        self.tally.candidates += approaching.len();
        if self.question.input.report_candidates {
            reported.extend(approaching.iter().map(|approaching| approaching.key.1));
        }
        let mut nearest = f32::INFINITY;
        for (index, ((motion, chord), candidates)) in motions.iter().zip(chords.iter()).zip(candidates).enumerate() {
            if candidates.is_empty() {
                continue;
            }
            if self.question.input.report_candidates {
                reported.extend_from_slice(candidates);
            }
            self.tally.candidates += candidates.len();
            let direction = match self.result.normal {
                normal if normal == Vec3::ZERO => motion.center_line(),
                normal => motion.to_chord(normal),
            };
            let many = candidates.len() > FEW_PRIMITIVES;
            let mut separating_axis = many.then(|| SeparatingAxis::new(motion, chord, direction, spheres));
            for &pair in candidates.iter() {
                if separating_axis.as_ref().is_some_and(|separating_axis| separating_axis.is_apart(pair)) {
                    continue;
                }
                self.tally.toi_tests += 1;
                let start = start_of(motion, chord, pair);
                if let Some(separating_axis) = &mut separating_axis {
                    separating_axis.push_axis(start.normal());
                }
                if start.distance() < nearest {
                    nearest = start.distance();
                    self.result.normal = motion.frame_at(0.0).rotation * start.normal();
                }
                if times[0] == 0.0 && start.distance() <= motion.tolerances.touch {
                    self.deepest = Some(start.overlap().max(self.deepest.unwrap_or(0.0)));
                    if start.overlap() > 0.0 {
                        overlaps.insert((index, pair), start.overlap());
                    }
                }
                let key = (index, pair);
                // The impact of a graze may lie in an earlier interval.
                let grazes = grazes.iter().any(|(known, _)| *known == key);
                if start.touch_bound() <= 1.0 || grazes {
                    let bound = if grazes { 0.0 } else { in_steps(start.touch_bound(), times) };
                    approaching.push(Approaching { key, bound, start: Some(start) });
                }
            }
        }
    }
}

/// Converts a fraction of an interval to a fraction of the step.
fn in_steps(fraction: f32, times: [f32; 2]) -> f32 {
    times[0] + fraction * (times[1] - times[0])
}

/// Returns the relative position of two primitives at the start of an interval.
fn start_of(motion: &PairMotion, chord: &Chord, [first, second]: PrimitivePair) -> RigidStart {
    with_sides!(motion.other, motion.shape1.hull(first), second, |first, second| rigid_start(&first, second, chord))
}

#[cfg(test)]
mod tests;
