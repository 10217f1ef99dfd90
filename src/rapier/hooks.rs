//! Evaluation of the user's physics hooks for the pairs of a step.

use bevy_rapier3d::{
    prelude::{BevyPhysicsHooks, PairFilterContextView},
    rapier::{
        dynamics::RigidBodySet,
        geometry::{ColliderHandle, ColliderSet, NarrowPhase, SolverFlags},
        pipeline::{ActiveHooks, PairFilterContext},
    },
};

use crate::pipeline::PairFilter;

/// Calls the user's hooks for a pair as rapier does. Rapier itself may not have called them, because it sees a fast pair only after the pair has stopped.
///
/// `MODIFY_SOLVER_CONTACTS` hooks change single contacts, so their effect is read from rapier's contacts at the start of the step. If such a hook has removed
/// all contacts of a touching pair, as for a one-way platform, the bodies do not stop at each other.
pub(super) fn meeting(
    hooks: &impl BevyPhysicsHooks,
    [first, second]: [ColliderHandle; 2],
    bodies: &RigidBodySet,
    colliders: &ColliderSet,
    narrow_phase: &NarrowPhase,
) -> PairFilter {
    // Rapier puts the lower handle first.
    let swapped = first.into_raw_parts() > second.into_raw_parts();
    let [first, second] = if swapped { [second, first] } else { [first, second] };
    let (Some(collider1), Some(collider2)) = (colliders.get(first), colliders.get(second)) else {
        return PairFilter::Apart;
    };
    let active = collider1.active_hooks() | collider2.active_hooks();
    let raw = PairFilterContext {
        bodies,
        colliders,
        collider1: first,
        collider2: second,
        rigid_body1: collider1.parent(),
        rigid_body2: collider2.parent(),
    };
    let context = PairFilterContextView { raw: &raw };
    if collider1.is_sensor() || collider2.is_sensor() {
        let filtered = active.contains(ActiveHooks::FILTER_INTERSECTION_PAIR);
        let apart = filtered && !hooks.filter_intersection_pair(context);
        return if apart { PairFilter::Apart } else { PairFilter::Passing };
    }
    let mut solved = true;
    if active.contains(ActiveHooks::FILTER_CONTACT_PAIRS) {
        let Some(flags) = hooks.filter_contact_pair(context) else { return PairFilter::Apart };
        solved = flags.contains(SolverFlags::COMPUTE_IMPULSES);
    }
    if active.contains(ActiveHooks::MODIFY_SOLVER_CONTACTS)
        && let Some(pair) = narrow_phase.contact_pair(first, second)
    {
        let touch = pair.manifolds.iter().any(|manifold| !manifold.points.is_empty());
        solved &= !touch || pair.has_any_active_contact();
    }
    if solved { PairFilter::Stopping } else { PairFilter::Passing }
}
