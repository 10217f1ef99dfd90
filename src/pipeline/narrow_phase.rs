//! Narrow phase: contacts at the end of the step, and the first impact within it, of each body pair.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Contact, Impact, Statics, StepInput,
    broad_phase::BodyPair,
    contact::{self, Second},
    mid_phase::PrimitivePair,
    motion::PairMotion,
    parallel,
    shape::{Hull, Placement, with_spheres},
};
use crate::{
    geometry::Sphere,
    query::{Cuboid, Moving, MovingConvex, TimeOfImpact, TimeOfImpactStatus, time_of_impact},
};

/// What the narrow phase finds for a body pair.
#[derive(Default)]
pub(super) struct PairResult {
    pub contacts: Vec<Contact>,
    pub impact: Option<Impact>,
    pub toi_tests: usize,
    pub unresolved: usize,
}

pub(super) fn run(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<PrimitivePair>],
    pool: &TaskPool,
) -> Vec<PairResult> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let mut result = PairResult::default();
        if candidates[i].is_empty() {
            return result;
        }
        let motion = PairMotion::new(input, statics, pair);
        contact::collect(
            motion.shape1,
            motion.second,
            &motion.end_pose12,
            input.prediction,
            &candidates[i],
            &mut result.contacts,
        );
        first_impact(&motion, &candidates[i], &mut result);
        result
    })
}

/// The earliest time of impact of the candidates, chord by chord. None if the bodies touch at the start.
///
/// Spheres of the first side are larger by the sagitta: an impact is early by as much at most, and never late.
fn first_impact(motion: &PairMotion, candidates: &[PrimitivePair], result: &mut PairResult) {
    let mut start = motion.placements(0.0);
    for chord in 0..motion.chords {
        let end = motion.placements((chord + 1) as f32 / motion.chords as f32);
        let mut earliest: Option<(TimeOfImpact, PrimitivePair)> = None;
        for &pair in candidates {
            let limit = earliest.map_or(1.0, |(toi, _)| toi.fraction);
            let toi = chord_impact(motion, pair, &start, &end, limit);
            result.toi_tests += 1;
            match toi.status {
                TimeOfImpactStatus::Separated => continue,
                TimeOfImpactStatus::Overlapping if chord == 0 => return,
                TimeOfImpactStatus::IterationLimit => result.unresolved += 1,
                TimeOfImpactStatus::Overlapping | TimeOfImpactStatus::Hit => {}
            }
            if earliest.is_none_or(|(first, _)| toi.fraction < first.fraction) {
                earliest = Some((toi, pair));
            }
        }
        if let Some((toi, [primitive1, primitive2])) = earliest {
            let point = (toi.contact.point1 + toi.contact.point2) * 0.5;
            result.impact = Some(Impact {
                fraction: (chord as f32 + toi.fraction) / motion.chords as f32,
                point: motion.frame.transform_point(point),
                normal: motion.frame.rotation * toi.contact.normal,
                primitive1,
                primitive2,
            });
            return;
        }
        start = end;
    }
}

/// Time of impact of two primitives along one chord.
fn chord_impact(
    motion: &PairMotion,
    [primitive1, primitive2]: PrimitivePair,
    start: &[Placement; 2],
    end: &[Placement; 2],
    limit: f32,
) -> TimeOfImpact {
    fn against<B: MovingConvex>(hull1: Hull, placements: [&Placement; 2], margin: f32, second: &B, limit: f32) -> TimeOfImpact {
        with_spheres!(hull1, |spheres| {
            let mut first = moving(&spheres, placements);
            first.start.iter_mut().for_each(|sphere| sphere.radius += margin);
            time_of_impact(&first, second, limit)
        })
    }
    let hull1 = motion.shape1.hull(primitive1);
    let first = [&start[0], &end[0]];
    let hull2 = match motion.second {
        Second::Cuboid(half) => return against(hull1, first, motion.sagitta, &Cuboid { half }, limit),
        Second::Hull(hull) => hull,
        Second::Shape(shape) => shape.hull(primitive2),
    };
    with_spheres!(hull2, |spheres| {
        against(hull1, first, motion.sagitta, &moving(&spheres, [&start[1], &end[1]]), limit)
    })
}

fn moving<const N: usize>(spheres: &[Sphere; N], [start, end]: [&Placement; 2]) -> Moving<N> {
    let placed: [Sphere; N] = spheres.map(|s| Sphere::new(start.point(s.center), s.radius));
    let motion: [Vec3; N] = std::array::from_fn(|i| end.point(spheres[i].center) - placed[i].center);
    Moving { start: placed, motion }
}
