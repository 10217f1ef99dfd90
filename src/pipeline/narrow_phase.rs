//! Narrow phase: the first impact of each body pair within the step, and its contacts at the end.

use bevy::tasks::TaskPool;

use super::{
    Contact, Impact, Statics, StepInput, Target,
    broad_phase::BodyPair,
    contact::{self, Second},
    mid_phase::PrimitivePair,
    motion::PairMotion,
    parallel,
    stop::Stops,
    with_spheres,
};
use crate::query::{Cuboid, Support, TimeOfImpactStatus, rigid_impact};

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
            Target::Static(body) => statics.bodies[body as usize].side(),
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

/// The earliest impact of the candidates: where an overlap grows by more than a slop, which contacts never do that the solver knows
/// about; for primitives that are apart before that, where they touch. None where what is left of the motion is less than a slop itself: a
/// pile that settles must come to rest.
pub(super) fn first_impact(motion: &PairMotion, candidates: &[PrimitivePair]) -> ImpactResult {
    let mut result = ImpactResult::default();
    if candidates.is_empty() {
        return result;
    }
    let chords = motion.chords();
    let slop = motion.slop;
    let mut limit = 1.0;
    for &[primitive1, primitive2] in candidates {
        let toi = with_spheres!(motion.shape1.hull(primitive1), |first| match motion.second {
            Second::Cuboid(half) => rigid_impact(&first, &Cuboid { half }, &chords, limit, slop),
            Second::Support(shape) => rigid_impact(&first, &Support(shape), &chords, limit, slop),
            Second::Hull(hull) => with_spheres!(hull, |other| rigid_impact(&first, &other, &chords, limit, slop)),
            Second::Shape(shape) => {
                with_spheres!(shape.hull(primitive2), |other| rigid_impact(&first, &other, &chords, limit, slop))
            }
        });
        result.toi_tests += 1;
        result.unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
        if toi.status != TimeOfImpactStatus::Separated
            && result.impact.is_none_or(|first| toi.fraction < first.fraction)
        {
            limit = toi.fraction;
            let point = (toi.contact.point1 + toi.contact.point2) * 0.5;
            result.impact = Some(Impact {
                fraction: toi.fraction,
                point: motion.frame.transform_point(point),
                normal: motion.frame.rotation * toi.contact.normal,
                primitive1,
                primitive2,
            });
        }
    }
    let way = motion.way();
    result.impact = result.impact.filter(|impact| (1.0 - impact.fraction) * way > slop);
    result
}
