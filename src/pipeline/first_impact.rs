//! The first impact of a pair within the step.

use std::time::Duration;

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
    query::{Chords, RigidStart, TimeOfImpact, TimeOfImpactStatus, rigid_end, rigid_impact, rigid_start},
};

/// The first impact of a pair, and a hint for later searches.
#[derive(Clone, Debug, Default)]
pub(super) struct ImpactResult {
    pub impact: Option<Impact>,
    /// Unit normal between the primitives that are nearest to each other at the start, in the world; zero if no primitives were tested.
    pub normal: Vec3,
}

/// Counters of searches.
#[derive(Debug, Default)]
pub(super) struct Tally {
    /// Primitive pairs that culling leaves.
    pub candidates: usize,
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// Input of a search for the first impact of a pair.
#[derive(Clone, Copy)]
pub(super) struct Question<'a> {
    pub input: &'a StepInput,
    pub statics: &'a Statics,
    pub pair: &'a BodyPair,
    /// Primitive pairs that culling leaves, if they are known. Used only for a step that is searched in one part.
    pub known: Option<&'a [PrimitivePair]>,
    /// Per side, the fractions of its original motion between which the side moves. `None` for a side that is off its original path.
    pub times: [Option<[f32; 2]>; 2],
    /// A direction from the first body to the second, in the world, along which many of their primitives may be apart; zero if it is not known.
    pub normal: Vec3,
}

/// Buffers that are kept from search to search to avoid allocations.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    own: OwnBoxes,
    /// Candidates of each motion.
    candidates: Vec<Candidates>,
    /// Candidates of the last searched pair after culling, if they are part of the output.
    pub reported: Vec<PrimitivePair>,
    search: SearchBuffers,
}

#[derive(Debug, Default)]
struct SearchBuffers {
    /// Chords of each motion.
    chords: Vec<Chords>,
    room: Room,
    /// Primitive pairs that may touch in the part: index of the motion, primitives, and state at the start of the part.
    approaching: Vec<(usize, PrimitivePair, RigidStart)>,
    grazes: Vec<Graze>,
}

/// Finds the earliest impact of a pair's motions: the first touch of cores. Motions with a path shorter than the slop have no impact, so that piles come to
/// rest.
///
/// The step is searched in parts if bodies spin fast or move far.
///
/// `lap`: a clock that measures culling and searching.
pub(super) fn first_impact(
    question: &Question,
    mut motions: Motions,
    scratch: &mut Scratch,
    mut lap: impl FnMut() -> Duration,
) -> ImpactResult {
    let Question { input, known, normal, .. } = *question;
    let Scratch {
        boxes: cache,
        first_impact: Buffers { own, candidates, reported, search: buffers },
        tally,
        laps: [culling, searching],
        ..
    } = scratch;
    reported.clear();
    motions.retain(|motion| !motion.is_short());
    let result = ImpactResult { normal, ..Default::default() };
    if motions.is_empty() {
        return result;
    }
    let count = motions.iter().map(PairMotion::parts).max().unwrap_or(1);
    buffers.grazes.clear();
    let mut search = Search { result, deepest: None, tally, buffers };
    // Cached boxes have margins for the whole path, so they are too large for a search in parts.
    let boxes = if count == 1 && known.is_none() { question.boxes(cache) } else { [None; 2] };
    let parts = Parts::new(&motions, count);
    candidates.resize_with(motions.len().max(candidates.len()), Vec::new);
    for part in 0..count {
        parts.cut(&mut motions, part);
        for (motion, found) in motions.iter().zip(candidates.iter_mut()) {
            found.clear();
            match known {
                Some(known) if count == 1 => mid_phase::of_motion(motion, known, found),
                _ => mid_phase::candidates(motion, input.culling, motion.reach(), boxes, own, found),
            }
            search.tally.candidates += found.len();
            if input.report_candidates {
                reported.extend_from_slice(found);
            }
        }
        *culling += lap();
        search.run(&motions, candidates, [part, count]);
        *searching += lap();
        if search.result.impact.is_some() {
            break;
        }
    }
    search.result
}

impl Question<'_> {
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

/// Equal parts of a step.
struct Parts {
    /// Motions of both sides over the whole step.
    whole: SmallVec<[[Sweep; 2]; 1]>,
    count: usize,
}

impl Parts {
    fn new(motions: &[PairMotion], count: usize) -> Self {
        Self { whole: motions.iter().map(|motion| [motion.sweep1, motion.sweep2]).collect(), count }
    }

    /// Restricts the motions to one part of the step.
    fn cut(&self, motions: &mut [PairMotion], part: usize) {
        let times = [part, part + 1].map(|i| i as f32 / self.count as f32);
        for (motion, whole) in motions.iter_mut().zip(&self.whole) {
            [motion.sweep1, motion.sweep2] = *whole;
            motion.cut(times);
        }
    }
}

/// The kind of touch of two primitives in a part of the step.
enum Touch {
    /// An impact: cores touch, or surfaces touch and separate again.
    Stop(TimeOfImpact),
    /// Surfaces touch and are still in touch at the end of the part. Cores do not touch.
    Graze(TimeOfImpact),
    /// Surfaces separate after a graze that began in an earlier part. The value is the index of the graze.
    Known(usize),
}

/// The start of a touch of surfaces in an earlier part of the step.
#[derive(Debug)]
struct Graze {
    index: usize,
    pair: PrimitivePair,
    impact: Impact,
}

/// Returns an impact of two primitives in the world.
fn in_world(motion: &PairMotion, [primitive1, second]: PrimitivePair, toi: &TimeOfImpact) -> Impact {
    let frame = motion.frame_at(toi.fraction);
    let normal = frame.rotation * toi.contact.normal;
    let primitive2 = match &motion.facing {
        Facing::Shape(_) => second,
        Facing::Part(part) => part.id,
    };
    let middle = frame.transform_point((toi.contact.point1 + toi.contact.point2) * 0.5);
    let point = middle - normal * motion.facing.rounding();
    Impact { fraction: toi.fraction, point, normal, primitive1, primitive2 }
}

/// A search for the first impact of a pair, part by part of the step.
struct Search<'b> {
    result: ImpactResult,
    /// Largest overlap of the bodies at the start of the step, in metres. `None` if they are not in touch there.
    deepest: Option<f32>,
    tally: &'b mut Tally,
    buffers: &'b mut SearchBuffers,
}

impl Search<'_> {
    /// Searches one part of the step. `candidates`: those of each motion. The last argument is the index of the part and the number of parts.
    fn run(&mut self, motions: &[PairMotion], candidates: &[Candidates], [part, parts]: [usize; 2]) {
        let deepest = self.find_approaching(motions, candidates);
        if part == 0 {
            self.deepest = deepest;
        }
        let (result, SearchBuffers { chords: all_chords, approaching, grazes, .. }) =
            (&mut self.result, &mut *self.buffers);
        // The nearest primitives are likely to touch first. An early impact shortens the search of later pairs.
        approaching.sort_unstable_by(|a, b| {
            let order = a.2.distance().total_cmp(&b.2.distance());
            order.then_with(|| (a.0, a.1).cmp(&(b.0, b.1)))
        });
        for (index, pair, start) in approaching.iter() {
            let (motion, chords) = (&motions[*index], &all_chords[*index]);
            let limit = result.impact.map_or(1.0, |impact| impact.fraction * parts as f32 - part as f32);
            let known_overlap =
                |deepest| motion.tolerances.known_overlap(motion.thickness(*pair), start.overlap(), deepest);
            let shallow = self.deepest.map_or(0.0, known_overlap);
            let core = motion.core_overlap(*pair);
            let known = grazes.iter().position(|graze| (graze.index, graze.pair) == (*index, *pair));
            let touch = with_sides!(motion.facing, motion.shape1.hull(pair[0]), pair[1], |first, second| {
                let mut impact = |depth: f32| {
                    let toi = rigid_impact(&first, second, chords, start, limit, depth);
                    self.tally.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
                    (toi.status != TimeOfImpactStatus::Separated).then_some(toi)
                };
                // Test surfaces before cores, because most candidates do not even touch with their surfaces.
                let is_above = core > shallow && start.distance() > -shallow;
                let surface = if is_above { impact(shallow) } else { None };
                if is_above && surface.is_none() {
                    continue;
                }
                let core = impact(core.max(shallow));
                match (core, surface) {
                    (Some(core), _) => Touch::Stop(core),
                    (None, surface) => {
                        let apart = rigid_end(&first, second, chords) > motion.tolerances.touch;
                        match (surface, known) {
                            (Some(surface), _) if apart => Touch::Stop(surface),
                            (Some(surface), _) => Touch::Graze(surface),
                            (None, Some(known)) if apart => Touch::Known(known),
                            (None, _) => continue,
                        }
                    }
                }
            });
            let impact = |toi: &TimeOfImpact| {
                let impact = in_world(motion, *pair, toi);
                Impact { fraction: (part as f32 + impact.fraction) / parts as f32, ..impact }
            };
            let found = match &touch {
                Touch::Stop(toi) => impact(toi),
                Touch::Known(graze) => grazes[*graze].impact,
                Touch::Graze(toi) => {
                    if part + 1 < parts {
                        grazes.push(Graze { index: *index, pair: *pair, impact: impact(toi) });
                    }
                    continue;
                }
            };
            if result.impact.is_none_or(|first| found.fraction < first.fraction) {
                result.impact = Some(found);
            }
        }
    }

    /// Collects the primitive pairs that may touch in this part. Returns the largest overlap at the start in metres, or `None` if the bodies are not in touch
    /// there.
    fn find_approaching(&mut self, motions: &[PairMotion], candidates: &[Candidates]) -> Option<f32> {
        let SearchBuffers { chords: all_chords, room, approaching, .. } = &mut *self.buffers;
        all_chords.resize_with(motions.len().max(all_chords.len()), Chords::default);
        approaching.clear();
        let mut nearest = f32::INFINITY;
        let mut deepest = None;
        for (index, ((motion, chords), candidates)) in
            motions.iter().zip(all_chords.iter_mut()).zip(candidates).enumerate()
        {
            if candidates.is_empty() {
                continue;
            }
            motion.set_chords(chords);
            self.tally.toi_tests += candidates.len();
            let direction = match self.result.normal {
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
                    self.result.normal = motion.frame_at(0.0).rotation * start.normal();
                }
                if start.distance() <= motion.tolerances.touch {
                    deepest = Some(start.overlap().max(deepest.unwrap_or(0.0)));
                }
                if !start.stay_apart() {
                    approaching.push((index, pair, start));
                }
            }
        }
        deepest
    }
}
