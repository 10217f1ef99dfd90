//! The touch of two primitives in an interval of the step.

use crate::{
    pipeline::{
        pairs::PrimitivePair,
        sweep::motion::{PairMotion, with_sides},
    },
    query::{Chord, RigidStart, TimeOfImpact, TimeOfImpactStatus, rigid_end, rigid_impact},
};

/// The kind of touch of two primitives in an interval.
pub(super) enum Touch {
    /// An impact: cores touch, or surfaces touch and separate again.
    Stop(TimeOfImpact),
    /// Surfaces touch and are still in touch at the end of the interval. Cores do not touch.
    Graze(TimeOfImpact),
    /// Surfaces that touched in an earlier interval separate.
    GrazeEnd,
}

/// Returns the touch of two primitives in an interval, up to a fraction of it.
///
/// `shallow`: overlap of the surfaces that the solver handles. `grazes`: true if the surfaces touched in an earlier interval. `unresolved`: a counter of
/// searches that reach the limit of iterations.
pub(super) fn touch(
    motion: &PairMotion,
    chord: &Chord,
    pair: PrimitivePair,
    start: &RigidStart,
    limit: f32,
    shallow: f32,
    grazes: bool,
    unresolved: &mut usize,
) -> Option<Touch> {
    let core = motion.core_overlap(pair);
    with_sides!(motion.other, motion.shape1.hull(pair[0]), pair[1], |first, second| {
        let mut impact = |depth: f32, limit: f32| {
            let toi = rigid_impact(&first, second, chord, start, limit, depth);
            *unresolved += usize::from(toi.status == TimeOfImpactStatus::IterationLimit);
            (toi.status != TimeOfImpactStatus::Separated).then_some(toi)
        };
        // Test surfaces before cores, because most candidates do not even touch with their surfaces.
        let is_above = core > shallow && start.distance() > -shallow;
        let surface = if is_above { impact(shallow, limit) } else { None };
        let may_reach_core = !is_above || surface.is_some();
        // Surfaces whose cores touch after the limit do not separate before.
        let limit = if surface.is_some() { 1.0 } else { limit };
        if may_reach_core && let Some(core) = impact(core.max(shallow), limit) {
            return Some(Touch::Stop(core));
        }
        let separates = || rigid_end(&first, second, chord) > motion.tolerances.touch;
        match surface {
            Some(surface) if separates() => Some(Touch::Stop(surface)),
            Some(surface) => Some(Touch::Graze(surface)),
            None => (grazes && separates()).then_some(Touch::GrazeEnd),
        }
    })
}
