//! More solver iterations for fast bodies in contact.
//!
//! Rapier's solver keeps the normal and the lever arms of a contact for the whole step, but updates its distance after each substep. Fast bodies have moved
//! far by then, so the next substeps undo or repeat the effect of the first one. Therefore a pair that ends a step in contact gets enough substeps in the next
//! step that it hardly moves within one substep.
//!
//! Measured with 120 hits of rods at 100 m/s: without this rule 17 hits gain energy, up to eight times the initial energy. With it, no hit does.

use bevy::prelude::*;
use bevy_rapier3d::{
    plugin::context::RapierContextEntityLink,
    prelude::{AdditionalSolverIterations, RapierRigidBodyHandle},
    rapier::geometry::Collider,
};

use super::{context::Context, snapshot::RapierStep};
use crate::{
    constants::{MAX_ITERATIONS, SUBSTEP_DISPLACEMENT},
    geometry::Sweep,
    pipeline::{Displacement, Pair, Side},
    plugin::MedialStep,
};

/// Sets the number of solver iterations of the next step, after resetting all bodies to the user's value. The reset covers values from a restored context
/// too. Paused worlds keep their values.
pub(super) fn refine(
    step: Res<MedialStep>,
    rapier: RapierStep,
    bodies: Query<(&RapierRigidBodyHandle, &RapierContextEntityLink, Option<&AdditionalSolverIterations>)>,
    mut contexts: Query<Context>,
) {
    let resting: Vec<Entity> =
        contexts.iter().filter(|context| !rapier.runs(context)).map(|context| context.entity).collect();
    for (handle, link, own) in bodies.iter().filter(|(_, link, _)| !resting.contains(&link.0)) {
        let Ok(mut context) = contexts.get_mut(link.0) else { continue };
        let set = &mut context.bodies;
        let own = own.map_or(0, |own| own.0);
        // Compare before the mutable access, because `get_mut` marks a body as changed.
        if set.bodies.get(handle.0).is_some_and(|body| body.additional_solver_iterations() != own)
            && let Some(body) = set.bodies.get_mut(handle.0)
        {
            body.set_additional_solver_iterations(own);
        }
    }
    for pair in step.output.pairs.iter().filter(|pair| !pair.manifolds.is_empty()) {
        let sides = [pair.first, pair.second];
        let displacement = sizes_moved(&step, pair);
        // Bodies that fall or tumble are not fast.
        if displacement < 1.0 {
            continue;
        }
        let Ok(mut context) = contexts.get_mut(step.context(pair.first)) else { continue };
        let substeps = ((displacement / SUBSTEP_DISPLACEMENT).ceil() as usize).min(MAX_ITERATIONS as usize);
        let additional = substeps.saturating_sub(context.simulation.integration_parameters.num_solver_iterations);
        for side in sides {
            let collider = context.colliders.colliders.get(step.info(side).collider());
            let Some(handle) = collider.and_then(Collider::parent) else { continue };
            let Some(body) = context.bodies.bodies.get_mut(handle) else { continue };
            if body.is_dynamic() && additional > body.additional_solver_iterations() {
                body.set_additional_solver_iterations(additional);
            }
        }
    }
}

/// Returns the relative displacement of the sides of a pair in the last step, in bounding radii of the smaller one.
fn sizes_moved(step: &MedialStep, pair: &Pair) -> f32 {
    let [first, second] = [pair.first, pair.second].map(|side| {
        let Side::Body(body) = side else { return Displacement::REST };
        let Sweep { translation, rotation, .. } = step.input.bodies[body as usize].sweep;
        Displacement { translation, rotation, radius: step.solid(side).bounding_sphere().radius, fall: 0.0 }
    });
    let radius = |side: &Displacement| if side.radius > 0.0 { side.radius } else { f32::INFINITY };
    first.against(&second) / radius(&first).min(radius(&second))
}
