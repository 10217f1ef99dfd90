//! The first impact of a pair within the step.

use glam::Vec3;

use super::{
    Culling, Impact,
    mid_phase::{self, Candidates, PrimitivePair},
    motion::{Facing, PairMotion, with_sides},
    moving_boxes::TimedBoxes,
    parting::Parting,
};
use crate::{
    constants::FEW_PRIMITIVES,
    geometry::Sweep,
    query::{TimeOfImpactStatus, rigid_impact, rigid_start},
};

/// The first impact of a pair, and what it took to find.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ImpactResult {
    pub impact: Option<Impact>,
    /// Overlap that the pair may gain, in metres.
    pub slop: f32,
    /// True if the pair was in touch at the start.
    pub in_touch: bool,
    /// Unit normal between the primitives that were nearest to each other at the start, in the world; zero if none was looked at.
    pub normal: Vec3,
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// The earliest impact of a pair's motions: where an overlap grows by more than a slop, which contacts never do that the
/// solver knows about; for primitives that are apart before that, where they touch. None where what is left of the motion is less than a
/// slop itself: a pile that settles must come to rest.
///
/// What slides over a seam takes the overlap that it has along to the next part. Where bodies spin or go far, the step is searched in parts.
///
/// `candidates` of each motion over the whole step, if they are known, for a step that is searched at once; else the `boxes` of either side over the
/// motion's time, as far as they are, and how far the bodies may be from there, in metres. `normal`: a direction in the world, from the first body to the
/// second, along which many of them may be apart; zero if none is known.
pub(super) fn first_impact(
    culling: Culling,
    mut motions: Vec<PairMotion>,
    candidates: Option<&[Candidates]>,
    boxes: [Option<TimedBoxes>; 2],
    slack: f32,
    normal: Vec3,
) -> ImpactResult {
    let slop = motions.iter().map(|motion| motion.slop).fold(0.0, f32::max);
    let mut search = Search { result: ImpactResult { slop, normal, ..Default::default() }, ..Default::default() };
    // On a shorter way no overlap grows by that.
    if motions.iter().all(|motion| motion.way() <= motion.slop) {
        return search.result;
    }
    let count = motions.iter().map(PairMotion::parts).max().unwrap_or(1);
    // They are those of one part.
    let boxes = if count == 1 { boxes } else { [None; 2] };
    let parts = Parts::new(&motions, count);
    for part in 0..count {
        parts.cut(&mut motions, part);
        let found: Vec<_>;
        let candidates = match candidates {
            Some(known) if count == 1 => known,
            _ => {
                let of = |motion: &PairMotion| mid_phase::candidates(motion, culling, slack + motion.stray(), boxes);
                found = motions.iter().map(of).collect();
                &found
            }
        };
        search.run(&motions, candidates, [part, count]);
        if search.result.impact.is_some() {
            search.go_back(&mut motions, &parts, part);
            break;
        }
    }
    search.result
}

/// The parts of a step of equal length.
struct Parts {
    /// The motions of either side over the whole step.
    whole: Vec<[Sweep; 2]>,
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
#[derive(Default)]
struct Search {
    result: ImpactResult,
    /// How deep primitives may be that were less deep at the start of the step, in metres.
    carried: f32,
    /// The overlaps of single primitives of a motion there.
    overlaps: Vec<((usize, PrimitivePair), f32)>,
    /// The motion and the primitives that meet first so far, and whether they have touched at the start of the part.
    met: Option<(usize, PrimitivePair, bool)>,
}

impl Search {
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
            let mut candidates = vec![Candidates::new(); motions.len()];
            candidates[index].push(pair);
            let later = self.result.impact.take();
            self.run(motions, &candidates, [part, parts.count]);
            self.result.impact = self.result.impact.or(later);
        }
    }

    /// Searches a part of the step, of so many.
    fn run(&mut self, motions: &[PairMotion], candidates: &[Candidates], [part, parts]: [usize; 2]) {
        let result = &mut self.result;
        let (mut sides, mut approaching) = (Vec::new(), Vec::new());
        let mut nearest = f32::INFINITY;
        for (index, (motion, candidates)) in motions.iter().zip(candidates).enumerate() {
            if candidates.is_empty() {
                continue;
            }
            let chords = motion.chords();
            result.toi_tests += candidates.len();
            let direction = match result.normal {
                normal if normal == Vec3::ZERO => motion.center_line(),
                normal => motion.to_chords(normal),
            };
            let many = candidates.len() > FEW_PRIMITIVES;
            let mut parting = many.then(|| Parting::new(motion, &chords, direction)).flatten();
            let side = sides.len();
            for &pair in candidates {
                if parting.as_mut().is_some_and(|parting| parting.is_apart(pair)) {
                    continue;
                }
                let start = with_sides!(motion.facing, motion.shape1.hull(pair[0]), pair[1], |first, second| {
                    rigid_start(&first, second, &chords)
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
                    self.overlaps.push(((index, pair), start.overlap()));
                }
                if !start.stay_apart() {
                    result.in_touch |= part == 0 && start.distance() <= motion.touch;
                    approaching.push((side, pair, start));
                }
            }
            sides.push((index, motion, chords));
        }
        // The nearest are likely to meet first, and what is farther off than they leave time for is not looked at.
        approaching.sort_by(|a, b| a.2.distance().total_cmp(&b.2.distance()));
        for (side, pair, start) in &approaching {
            let (index, motion, chords) = &sides[*side];
            let limit = result.impact.map_or(1.0, |impact| impact.fraction);
            let own = self.overlaps.iter().find(|(key, _)| *key == (*index, *pair));
            let overlap = own.map_or(self.carried, |(_, own)| own.max(self.carried));
            let toi = with_sides!(motion.facing, motion.shape1.hull(pair[0]), pair[1], |first, second| {
                rigid_impact(&first, second, chords, start, limit, [overlap, motion.slop])
            });
            result.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
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
