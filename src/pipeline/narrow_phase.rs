//! Narrow phase: the first impact of each body pair within the step, and its contacts at the end.

use bevy::tasks::TaskPool;
use glam::Vec3;

use super::{
    Contact, Impact, Statics, StepInput, Target,
    broad_phase::BodyPair,
    contact::{self, Second},
    mid_phase::PrimitivePair,
    motion::PairMotion,
    parallel,
    shape::{Hull, Placement, with_spheres},
    stop::Stops,
};
use crate::{
    constants::STOP_SLOP,
    geometry::Sphere,
    query::{Cuboid, Moving, MovingConvex, TimeOfImpact, TimeOfImpactStatus, time_of_impact, time_of_overlap},
};

/// The first impact of a body pair, and what it took to find.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ImpactResult {
    pub impact: Option<Impact>,
    pub toi_tests: usize,
    pub unresolved: usize,
}

/// The first impact of each body pair, were no body to stop.
pub(super) fn impacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<PrimitivePair>],
    pool: &TaskPool,
) -> Vec<ImpactResult> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let motion = PairMotion::new(input, statics, pair, |body| input.bodies[body as usize].sweep);
        first_impact(&motion, &candidates[i])
    })
}

/// The contacts of each body pair where its bodies end the step.
pub(super) fn contacts(
    input: &StepInput,
    statics: &Statics,
    pairs: &[BodyPair],
    candidates: &[Vec<PrimitivePair>],
    stops: &Stops,
    pool: &TaskPool,
) -> Vec<Vec<Contact>> {
    parallel::map(pool, pairs, 4, |i, pair| {
        let shape1 = &input.bodies[pair.body1 as usize].shape;
        let pose1 = stops.final_pose(input, pair.body1);
        let (second, pose2) = match pair.target {
            Target::Body(body) => (Second::Shape(&input.bodies[body as usize].shape), stops.final_pose(input, body)),
            Target::Static(body) => {
                let body = &statics.bodies()[body as usize];
                match &body.shape {
                    Some((shape, pose)) => (Second::Shape(shape), *pose),
                    None => (Second::Cuboid(body.obb.half_extents), body.obb.pose),
                }
            }
        };
        let pose12 = pose1.inv_mul(&pose2);
        let mut contacts = Vec::new();
        if stops.is_stopped(pair.body1) || matches!(pair.target, Target::Body(body) if stops.is_stopped(body)) {
            // The candidates are those of the whole motion.
            let near = contact::near(shape1, second, &pose12, input.prediction);
            contact::collect(shape1, second, &pose12, input.prediction, &near, &mut contacts);
        } else {
            contact::collect(shape1, second, &pose12, input.prediction, &candidates[i], &mut contacts);
        }
        contacts
    })
}

/// The earliest impact of the candidates, chord by chord.
///
/// An impact is where an overlap grows by more than a slop, which contacts never do that the solver knows about; for primitives
/// that are apart at the start it is told at the touch. Spheres of the first side are larger by the sagitta, so it is early by as
/// much at most, and never late.
pub(super) fn first_impact(motion: &PairMotion, candidates: &[PrimitivePair]) -> ImpactResult {
    let mut result = ImpactResult::default();
    if candidates.is_empty() {
        return result;
    }
    let mut start = motion.placements(0.0);
    for chord in 0..motion.chords {
        let end = motion.placements((chord + 1) as f32 / motion.chords as f32);
        let mut earliest: Option<(TimeOfImpact, PrimitivePair)> = None;
        for &pair in candidates {
            let limit = earliest.map_or(1.0, |(toi, _)| toi.fraction);
            let toi = chord_impact(motion, pair, &start, &end, limit);
            result.toi_tests += 1;
            result.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
            if toi.status != TimeOfImpactStatus::Separated
                && earliest.is_none_or(|(first, _)| toi.fraction < first.fraction)
            {
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
            break;
        }
        start = end;
    }
    result
}

/// The impact of two primitives along one chord.
fn chord_impact(
    motion: &PairMotion,
    [primitive1, primitive2]: PrimitivePair,
    start: &[Placement; 2],
    end: &[Placement; 2],
    limit: f32,
) -> TimeOfImpact {
    fn against<B: MovingConvex>(
        motion: &PairMotion,
        hull1: Hull,
        placements: [&Placement; 2],
        second: &B,
        limit: f32,
    ) -> TimeOfImpact {
        with_spheres!(hull1, |spheres| {
            let mut first = moving(&spheres, placements);
            first.start.iter_mut().for_each(|sphere| sphere.radius += motion.sagitta);
            let overlap = time_of_overlap(&first, second, limit, STOP_SLOP * motion.size);
            if overlap.status == TimeOfImpactStatus::Separated {
                return overlap;
            }
            let touch = time_of_impact(&first, second, overlap.fraction);
            if touch.status == TimeOfImpactStatus::Hit { touch } else { overlap }
        })
    }
    let hull1 = motion.shape1.hull(primitive1);
    let first = [&start[0], &end[0]];
    let hull2 = match motion.second {
        Second::Cuboid(half) => return against(motion, hull1, first, &Cuboid { half }, limit),
        Second::Hull(hull) => hull,
        Second::Shape(shape) => shape.hull(primitive2),
    };
    with_spheres!(hull2, |spheres| against(motion, hull1, first, &moving(&spheres, [&start[1], &end[1]]), limit))
}

fn moving<const N: usize>(spheres: &[Sphere; N], [start, end]: [&Placement; 2]) -> Moving<N> {
    let placed: [Sphere; N] = spheres.map(|s| Sphere::new(start.point(s.center), s.radius));
    let motion: [Vec3; N] = std::array::from_fn(|i| end.point(spheres[i].center) - placed[i].center);
    Moving { start: placed, motion }
}
